"""Commands for meshcat's viewer that define the bodies of a page, encoded as msgpack.

meshcat is a viewer of three.js scenes in the browser. Each distinct body is defined once, as
``/library/k``, and the page places copies of it. The commands equal those of meshcat's Python
package, which is not used because it would import IPython and a web server. A surface is the
content of a mesh file: points, normals, colours and triangles.

``Shape`` is a shape of a URDF as plain data: its kind, its size or mesh file, its link, and its
placement on the link.
``Surface`` is a triangle mesh: points, normals, colours (V, 3) and faces (F, 3). ``Surfaces`` are
the triangle meshes of mesh files by path, with the error instead if a file is unreadable.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import umsgpack
from numpy.typing import ArrayLike, NDArray

from ...base.errors import InputError
from ...model.shapes import Shape
from ...model.surfaces import Surface, Surfaces

Key = tuple[Any, ...]
"""Identity of a body: its mesh file, or kind and size; not its scale, colour or placement."""

_Element = dict[str, Any]
"""Element of a three.js scene, in its JSON format."""

_LIGHTS = ("AmbientLight", "FillLight", "PointLightNegativeX", "PointLightPositiveX")
_HIDDEN = ("/Grid", "/Axes", *(f"/Lights/{light}" for light in _LIGHTS), "/library", "/Background")
"""Elements that meshcat's viewer shows by default and the page replaces."""

_ARRAYS = {"Int8Array": (0x11, "<i1"), "Uint8Array": (0x12, "<u1"), "Uint16Array": (0x14, "<u2"),
           "Uint32Array": (0x16, "<u4"), "Float32Array": (0x17, "<f4")}  # fmt: skip
_GLOSS = {"specular": 0x1C1C1C, "shininess": 28}
_BOTH_SIDES = 2  # three.js' DoubleSide
_VERTEX_COLORS = 2  # three.js' VertexColors

# Rotates a three.js cylinder, whose axis is y, to the z axis of a URDF's; column by column.
_COLUMNS = [[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]
_UPRIGHT = np.array(_COLUMNS).ravel().tolist()
_RINGS = 24
"""Number of rings of a sphere or capsule, and of corners of each ring."""

_IDENTITY = np.eye(4).ravel().tolist()


def record(
    shapes: Iterable[Shape], surfaces: Surfaces
) -> tuple[list[bytes], dict[Key, int], list[str]]:
    """Record the commands that fill the viewer's library with each distinct body of some shapes.

    A shape is a mesh or primitive at one place on the robot; equal shapes share one body.
    ``surfaces`` are the contents of the mesh files, by path. The output is deterministic.

    Returns
    -------
    commands : list of bytes
        Commands, each encoded as msgpack.
    library : dict
        Number k of each body in the library, by its :func:`key`; unreadable bodies have none.
    problems : list of str
        Error messages, one per unreadable body.
    """
    commands = [
        {"type": "set_property", "path": name, "property": "visible", "value": False}
        for name in _HIDDEN
    ]
    distinct: dict[Key, Shape] = {}
    for shape in shapes:
        distinct.setdefault(key(shape), shape)
    problems: list[str] = []
    library: dict[Key, int] = {}
    for body, shape in distinct.items():
        try:
            scene = _object(shape, surfaces)
        except InputError as error:
            problems.append(str(error))
            continue
        library[body] = len(library)
        path = f"/library/{library[body]}"
        commands.append({"type": "set_object", "object": scene, "path": path})
    return [umsgpack.packb(command) for command in commands], library, problems


def key(shape: Shape) -> Key:
    """Return the key of the body that a shape shows: its mesh file, or its kind and size.

    Shapes of equal bodies have equal keys, so that the page holds each body only once.
    """
    return ("mesh", str(shape.path)) if shape.kind == "mesh" else (shape.kind, *shape.size)


def _object(shape: Shape, surfaces: Surfaces) -> _Element:
    """Make the three.js object of a shape, in three.js' JSON format.

    The axis of a cylinder or capsule is z, as in a URDF. InputError is raised for a mesh file that
    cannot be read, and for an unknown kind.
    """
    size = [float(s) for s in shape.size]
    if shape.kind == "mesh":
        assert shape.path is not None
        surface = surfaces[shape.path]
        if isinstance(surface, InputError):
            raise surface
        return _painted(surface)
    if shape.kind == "box":
        width, height, depth = size
        box = {"type": "BoxGeometry", "width": width, "height": height, "depth": depth}
        return _plain(box)
    if shape.kind == "sphere":
        around = {"widthSegments": _RINGS, "heightSegments": _RINGS}
        return _plain({"type": "SphereGeometry", "radius": size[0], **around})
    if shape.kind == "capsule":
        return _plain(_capsule(*size), _UPRIGHT)
    if shape.kind == "cylinder":
        radius, height = size
        cylinder = {
            "type": "CylinderGeometry",
            "radiusTop": radius,
            "radiusBottom": radius,
            "height": height,
            "radialSegments": 50,
        }
        return _plain(cylinder, _UPRIGHT)
    raise InputError(
        f"shape {shape.name!r} has the unknown kind {shape.kind!r}; "
        "use mesh, box, cylinder, sphere or capsule"
    )


def _plain(geometry: _Element, matrix: list[float] = _IDENTITY) -> _Element:
    """Make a three.js object of one geometry in meshcat's default material.

    ``matrix`` is the placement of the geometry, 4 × 4, as 16 numbers column by column.
    """
    return _scene(geometry, _material(), matrix)


def _painted(surface: Surface) -> _Element:
    """Make a three.js object of a mesh, with the colours of its mesh file."""
    material = _material(vertexColors=_VERTEX_COLORS, **_GLOSS)
    return _scene(_triangles(surface), material, _IDENTITY)


def _scene(geometry: _Element, material: _Element, matrix: list[float]) -> _Element:
    """Make a three.js scene of one mesh, in JSON format, from its geometry, material and placement.

    ``matrix`` is the placement, 4 × 4, as 16 numbers column by column.
    """
    return {
        "metadata": {"version": 4.5, "type": "Object"},
        "geometries": [{"uuid": "0", **geometry}],
        "materials": [material],
        "object": {
            "uuid": "2",
            "type": "Mesh",
            "geometry": "0",
            "material": material["uuid"],
            "matrix": matrix,
        },
    }


def _material(**more: Any) -> _Element:
    """Make a three.js material with meshcat's defaults, which ``more`` replaces by name."""
    return {
        "uuid": "1",
        "type": "MeshPhongMaterial",
        "color": 0xFFFFFF,
        "reflectivity": 0.5,
        "side": _BOTH_SIDES,
        "transparent": False,
        "opacity": 1.0,
        "linewidth": 1.0,
        "wireframe": False,
        "wireframeLinewidth": 1.0,
        "vertexColors": 0,
    } | more


def _triangles(surface: Surface) -> _Element:
    """Make the three.js geometry of a surface, the triangles of a mesh file.

    Normals and colours have 8 bits per component, which keeps the page small without a visible
    difference.
    """
    s = surface
    attributes = {
        "position": _array("Float32Array", s.points, 3),
        "normal": _array("Int8Array", np.round(s.normals * 127), 3, normalized=True),
        "color": _array("Uint8Array", np.round(lifted(s.colors) * 255), 3, normalized=True),
    }
    small = len(s.points) < 2**16
    index = _array("Uint16Array" if small else "Uint32Array", s.faces, 1)
    return {"type": "BufferGeometry", "data": {"attributes": attributes, "index": index}}


def lifted(color: ArrayLike) -> NDArray[np.float64]:
    """Map colours, an array of any shape, from the range 0 to 1 to the range 0.06 to 0.96.

    The shading of a body shows its shape; on pure black or white it would be invisible.
    """
    return 0.06 + 0.9 * np.asarray(color, float)


def _array(
    kind: str, values: NDArray[Any], size: int, *, normalized: bool = False
) -> dict[str, Any]:
    """Encode an array for a three.js geometry as a typed array of JavaScript.

    ``kind`` is the name of the JavaScript type, such as ``Float32Array``, and ``size`` the number
    of values per point. If ``normalized``, three.js divides integers by the largest of their type.
    """
    code, dtype = _ARRAYS[kind]
    data = umsgpack.Ext(code, np.ascontiguousarray(values).astype(dtype).tobytes())
    return {"itemSize": size, "type": kind, "array": data, "normalized": normalized}


def _capsule(radius: float, length: float) -> _Element:
    """Make the three.js geometry of a capsule along y.

    ``radius`` is the radius of the capsule, ``length`` the length of its cylinder, both in m. The
    geometry is an outline, a list of points from bottom to top, that three.js rotates about y.
    """
    angles = np.linspace(-np.pi / 2, np.pi / 2, _RINGS)
    x = radius * np.cos(angles)
    y = radius * np.sin(angles) + length / 2 * np.sign(angles)
    outline = [{"x": float(a), "y": float(b)} for a, b in zip(x, y, strict=True)]
    return {"type": "LatheGeometry", "points": outline, "segments": _RINGS}
