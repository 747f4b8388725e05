"""Folders of ROS packages, and the mesh files that a URDF names in them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path


def package_folder(given: str | Path) -> tuple[str, Path]:
    """Split ``NAME=DIR`` into the name of a package and its folder; the name is empty for ``DIR``.

    A text with ``=`` is read as a path if its part before ``=`` contains a separator, or if a
    folder of this name exists.
    """
    name, mark, folder = str(given).partition("=")
    if not (mark and name) or "/" in name or os.path.isdir(given):
        return "", Path(given)
    return name, Path(os.path.expanduser(folder))


def find_mesh(filename: str, urdf: Path, package_dirs: Sequence[str | Path]) -> Path | None:
    """Find a mesh file, also in a folder other than the one that the URDF names; None if missing.

    If :func:`named_mesh` finds no file, leading folders of the name are left out one by one. For
    ``package://a/b/meshes/x.stl``, the names ``b/meshes/x.stl`` and then ``meshes/x.stl`` are
    looked up in the folder of the URDF, in the folders above it, and in ``package_dirs``. The bare
    file name ``x.stl`` is looked up only in the folder of the URDF, and in those of
    ``package_dirs`` that are not among the folders above it.

    Parameters
    ----------
    filename
        Name of the mesh, as written in the URDF.
    urdf
        The URDF file.
    package_dirs
        Folders in which packages are looked up, or the folder of one package as ``NAME=DIR``.
    """
    found = named_mesh(filename, urdf, package_dirs)
    scheme, mark, rest = filename.replace("\\", "/").partition("://")
    if found is not None or (mark and scheme not in ("file", "package", "model")):
        return found
    parts = [part for part in (rest or scheme).split("/") if part not in ("", ".", "..")]
    parents = [Path(parent) for parent in urdf.absolute().parents]
    given = [package_folder(folder)[1] for folder in package_dirs]
    given = [folder for folder in given if folder.absolute() not in parents]
    ends = [(folder, "/".join(parts[k:])) for k in range(1, len(parts) - 1) for folder in parents]
    for k in range(len(parts)):
        ends += [(folder, "/".join(parts[k:])) for folder in given]
        ends += [(folder, "/".join(parts[k + 1 :])) for folder in given if folder.name == parts[k]]
    beside = [(urdf.parent, parts[-1])] if parts else []
    return _first(folder / end for folder, end in [*ends, *beside] if end)


def named_mesh(filename: str, urdf: Path, package_dirs: Sequence[str | Path]) -> Path | None:
    """Find a mesh file exactly where a URDF names it; None if there is no file in that place.

    ``filename`` is the name in the file ``urdf``. For ``package://name/rest``, the places are
    ``folder/rest`` if ``package_dirs`` has ``name=folder``, then ``folder/name/rest`` for each
    folder of ``package_dirs``, then ``folder/rest`` if the folder itself is called ``name``.
    ``model://``, and the misspelling ``package:///``, mean the same as ``package://``. ``file://``
    is followed by a path. A name without a scheme is a path relative to the URDF's folder or, if
    there is no such file, to a folder of ``package_dirs``.
    """
    scheme, mark, rest = filename.partition("://")
    folders = [package_folder(folder) for folder in package_dirs]
    if not mark:
        return _first([urdf.parent / filename, *(folder / filename for _, folder in folders)])
    if scheme == "file":
        return _first([Path(rest)])
    if scheme not in ("package", "model"):
        return None
    rest = rest.lstrip("/")
    package, _, inside = rest.partition("/")
    own = [folder / inside for name, folder in folders if name == package]
    named = [folder / inside for _, folder in folders if folder.name == package]
    return _first([*own, *(folder / rest for _, folder in folders), *named])


def _first(paths: Iterable[Path]) -> Path | None:
    """Return the first path that is a file; None if none is."""
    # unlike Path.is_file, also for invalid names
    return next((path.resolve() for path in paths if os.path.isfile(path)), None)
