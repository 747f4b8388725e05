"""Animation page: meshcat's viewer, with all data that it shows."""

from ...errors import needed

needed("PIL", "collada", "jinja2", "meshcat", "tornado", "trimesh", "umsgpack", by="an animation")
