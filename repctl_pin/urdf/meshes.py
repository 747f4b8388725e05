"""Where the mesh files are that a URDF names."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path


def find_mesh(filename: str, urdf: Path, package_dirs: Sequence[str | Path]) -> Path | None:
    """Find a mesh file by the name a URDF gives it, or None.

    ``package://name/rest`` is looked up as ``folder/name/rest``, then as ``folder/rest`` where the folder
    itself is called ``name``; the typing slip ``package:///name/rest`` too. ``file://`` and plain names are
    paths, relative ones beside the URDF first.
    """
    scheme, mark, rest = filename.partition("://")
    folders = [Path(folder) for folder in package_dirs]
    if not mark:
        candidates = [urdf.parent / filename, *(folder / filename for folder in folders)]
    elif scheme == "file":
        candidates = [Path(rest)]
    elif scheme in ("package", "model"):
        rest = rest.lstrip("/")
        package, _, inside = rest.partition("/")
        candidates = [folder / rest for folder in folders]
        candidates += [folder / inside for folder in folders if folder.name == package]
    else:
        candidates = []
    return next((path.resolve() for path in candidates if os.path.isfile(path)), None)  # False for any name
