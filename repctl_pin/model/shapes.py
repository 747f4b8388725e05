"""Visual and collision shapes of a checked URDF as plain data, and lookup of mesh files."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from .urdf_rules import numbers
from .urdf_xml import package_folder

Color = tuple[float, float, float, float]


@dataclass(frozen=True)
class Shape:
    """A ``<visual>`` or ``<collision>`` shape, or another shape to draw, as plain data.

    Attributes
    ----------
    name
        Name of the link, ``_``, and number of the shape on it.
    link
        Name of the link.
    kind
        ``mesh``, ``box``, ``cylinder``, ``sphere`` or ``capsule``.
    size
        Box: three edges; cylinder and capsule: radius, and length along z; sphere: radius. All are
        in m. Empty for a mesh.
    color
        Red, green, blue and opacity, 0 to 1; None if the URDF gives none. A mesh is then drawn in
        the colours of its file.
    xyz, rpy
        Origin of the shape on its link: position, m, and roll, pitch and yaw, rad.
    filename
        Mesh file name as written in the URDF; ``""`` for primitives.
    scale
        Scale of a mesh along its own axes, negative if mirrored.
    path
        Mesh file, if it was looked up and found.
    standing
        True for a drawn shape of the surroundings.
    """

    name: str
    link: str
    kind: str
    size: tuple[float, ...] = ()
    color: Color | None = None
    xyz: tuple[float, ...] = (0.0, 0.0, 0.0)
    rpy: tuple[float, ...] = (0.0, 0.0, 0.0)
    filename: str = ""
    scale: tuple[float, ...] = (1.0, 1.0, 1.0)
    path: Path | None = None
    standing: bool = False


def shapes_of(robot: etree._Element, tag: str) -> list[Shape]:
    """Read all ``visual`` or all ``collision`` elements (``tag``) of a checked URDF.

    A shape is named after its link, with a number.
    """
    colors: dict[str, Color] = {}
    for material in robot.iterchildren("material"):
        _color(material, colors)
    return [
        _solid(link.get("name"), k, element, colors)
        for link in robot.iterchildren("link")
        for k, element in enumerate(link.iterchildren(tag))
    ]


def _solid(link: str, k: int, element: etree._Element, colors: dict[str, Color]) -> Shape:
    shape = element.find("geometry")[0]
    origin = element.find("origin")
    sizes = {"box": ("size",), "sphere": ("radius",)}.get(shape.tag, ("radius", "length"))
    values = [] if shape.tag == "mesh" else [numbers(shape, size) or () for size in sizes]
    return Shape(
        name=f"{link}_{k}",
        link=link,
        kind=shape.tag,
        size=tuple(number for part in values for number in part),
        color=_color(element.find("material"), colors),
        xyz=_three(origin, "xyz", 0.0),
        rpy=_three(origin, "rpy", 0.0),
        filename=shape.get("filename", "") if shape.tag == "mesh" else "",
        scale=_three(shape if shape.tag == "mesh" else None, "scale", 1.0),
    )


def _three(element: etree._Element | None, attribute: str, default: float) -> tuple[float, ...]:
    return tuple((None if element is None else numbers(element, attribute)) or (default,) * 3)


def _color(material: etree._Element | None, known: dict[str, Color]) -> Color | None:
    """Read the colour of a material, (r, g, b, a) from 0 to 1; None if it has none.

    ``known`` are the colours of named materials, to which a new one is added. Among materials with
    the same name, the first counts, as in Pinocchio.
    """
    if material is None:
        return None
    name = material.get("name", "")
    color = material.find("color")
    values = None if color is None else numbers(color, "rgba")
    if values is not None and name not in known:
        r, g, b, a = values
        if not name:
            return (r, g, b, a)
        known[name] = (r, g, b, a)
    return known.get(name)


def find_mesh(filename: str, urdf: Path, package_dirs: Sequence[str | Path]) -> Path | None:
    """Find a mesh file by its name in a URDF; None if it is missing.

    If there is no file of that name (:func:`named_mesh`), the end of the name is looked up in the
    URDF's folder, its parents and ``package_dirs``: ``package://a/b/meshes/x.stl`` is then
    ``b/meshes/x.stl`` or ``meshes/x.stl`` there, the longest end first. ``x.stl`` alone must lie
    beside the URDF, or in a folder that is not a parent of it.

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
    folder itself is called ``name`` or given as ``name=folder``; so is the misspelling
    ``package:///name/rest``. ``file://`` and plain names are paths; relative paths start at the
    URDF's folder. The parameters are those of :func:`find_mesh`.
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
