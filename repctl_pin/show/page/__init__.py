"""The page that moves: meshcat's viewer, with all that it shows."""

from ...errors import needed

needed("PIL", "collada", "jinja2", "meshcat", "tornado", "trimesh", "umsgpack", by="an animation")
