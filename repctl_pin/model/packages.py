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
    """Find a mesh file by its name in a URDF; None if it is missing.

    If there is no file of that name, ever shorter ends of the name are looked up: for
    ``package://a/b/meshes/x.stl``, first ``b/meshes/x.stl``, then ``meshes/x.stl``, in the folder
    of the URDF, its parents and ``package_dirs``. The bare file name ``x.stl`` is looked up only
    beside the URDF, and in those of ``package_dirs`` that are not parents of it.

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
    """Find the mesh file that a URDF names; None if there is no file of that name.

    ``package://name/rest`` is looked up as ``folder/name/rest``, then as ``folder/rest`` if the
    folder itself is called ``name`` or is given as ``name=folder``. ``model://``, and the
    misspelling ``package:///``, are read as ``package://``. ``file://`` and plain names are paths;
    relative paths start at the URDF's folder, or at those of ``package_dirs``. ``filename`` is the
    name in the file ``urdf``.
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
