"""Animation page: a self-contained HTML file with meshcat's viewer and all data that it shows."""

from ...base.errors import needed

needed("PIL", "collada", "jinja2", "meshcat", "tornado", "trimesh", "umsgpack", by="an animation")
