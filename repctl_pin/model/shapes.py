"""Visual and collision shapes of a checked URDF as plain data.

``Shape`` is a shape of a URDF as plain data: its kind, size, link and place, or its mesh file.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from .urdf_rules import numbers

Color = tuple[float, float, float, float]


@dataclass(frozen=True)
class Shape:
    """A ``<visual>`` or ``<collision>`` shape, or another shape to draw, as plain data.

    Attributes
    ----------
    name
        Name of the link, ``_``, and number of the shape on the link.
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
        Mesh file name as written in the URDF; empty for other shapes.
    scale
        Factors of a mesh along its own axes, negative if mirrored.
    path
        Mesh file, if it was looked up and found; else None.
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
    """Read the shapes of a checked URDF: all ``<visual>`` or all ``<collision>`` elements.

    ``tag`` is ``visual`` or ``collision``.
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
    """Read the colour (r, g, b, a), 0 to 1, of a ``<material>``; None if it has no colour.

    ``known`` are the colours of the named materials read so far, to which this one is added. Among
    materials with the same name, the first counts, as in Pinocchio.
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
