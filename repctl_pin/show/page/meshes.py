"""Commands for meshcat's viewer that define the bodies of a page, encoded as msgpack.

Each distinct body is defined once, as ``/library/k``, and the page places copies of it. The
commands equal those of meshcat's Python package, which is not used because it would import IPython
and a web server.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable
from itertools import count
from typing import Any

import numpy as np
import umsgpack
from numpy.typing import ArrayLike, NDArray

from ...errors import InputError
from ...model.surfaces import Surface, Surfaces
from ...model.visuals import Shape

Key = tuple[Any, ...]
"""Identity of a body: its mesh file, or kind and size; not its scale, colour or placement."""

_Element = dict[str, Any]
"""Element of a three.js scene, in its JSON format."""

_LIGHTS = ("AmbientLight", "FillLight", "PointLightNegativeX", "PointLightPositiveX")
_HIDDEN = (
    "/Grid",
    "/Axes",
    *(f"/Lights/{light}" for light in _LIGHTS),
    "/library",
    "/Background",
)
"""Elements that meshcat's viewer shows by default and the page replaces."""

_ARRAYS = {"Int8Array": (0x11, "<i1"), "Uint8Array": (0x12, "<u1"), "Uint16Array": (0x14, "<u2"),
           "Uint32Array": (0x16, "<u4"), "Float32Array": (0x17, "<f4")}  # fmt: skip
_GLOSS = {"specular": 0x1C1C1C, "shininess": 28}
_REPEAT = [1000, 1000]  # three.js' RepeatWrapping
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
    """Record the commands that fill a viewer's library with every distinct body of some shapes.

    The output is deterministic. ``surfaces`` are the contents of the mesh files.

    Returns
    -------
    commands : list of bytes
        Commands, each encoded as msgpack.
    library : dict
        Number of each body in the library, by its :func:`key`; without unreadable bodies.
    problems : list of str
        Messages about unreadable bodies.
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
    """Return the key of the body that a shape shows; shapes of equal bodies have equal keys."""
    return (
        ("mesh", str(shape.path)) if shape.kind == "mesh" else (shape.kind, *shape.size)
    )


def _object(shape: Shape, surfaces: Surfaces) -> _Element:
    """Make the three.js object of a shape; the axis of a cylinder is z, as in a URDF."""
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
        f"shape {shape.name!r} has kind {shape.kind!r}; use mesh, box, cylinder, sphere or capsule"
    )


def _plain(geometry: _Element, matrix: list[float] = _IDENTITY) -> _Element:
    """Make a three.js object of one geometry in meshcat's default material."""
    return _scene({"uuid": "0", **geometry}, [_material("1")], "1", matrix)


def _painted(surface: Surface) -> _Element:
    """Make a three.js object with the colours and textures of its mesh file.

    Each texture has its own material.
    """
    images = [image for *_, image in surface.groups]
    numbers = map(str, count(1))
    names = [next(numbers) for _ in images]
    own_name = next(numbers)
    urls = {
        k: f"data:image/jpeg;base64,{base64.b64encode(image).decode()}"
        for k, image in enumerate(images)
        if image is not None
    }
    textures = {k: next(numbers) for k in urls}
    pictures = {k: next(numbers) for k in urls}
    materials = [
        _material(name, vertexColors=_VERTEX_COLORS, **_GLOSS)
        | ({"map": textures[k]} if k in textures else {})
        for k, name in enumerate(names)
    ]
    geometry = {"uuid": "0", **_triangles(surface)}
    scene = _scene(geometry, materials, names, _IDENTITY, own_name)
    if urls:
        scene["textures"] = [
            {
                "uuid": textures[k],
                "wrap": _REPEAT,
                "repeat": [1, 1],
                "image": pictures[k],
            }
            for k in urls
        ]
        scene["images"] = [{"uuid": pictures[k], "url": url} for k, url in urls.items()]
    return scene


def _scene(
    geometry: _Element,
    materials: list[_Element],
    material: str | list[str],
    matrix: list[float],
    name: str = "2",
) -> _Element:
    """Make a three.js scene of one mesh."""
    return {
        "metadata": {"version": 4.5, "type": "Object"},
        "geometries": [geometry],
        "materials": materials,
        "object": {
            "uuid": name,
            "type": "Mesh",
            "geometry": geometry["uuid"],
            "material": material,
            "matrix": matrix,
        },
    }


def _material(name: str, **more: Any) -> _Element:
    """Make a three.js material with meshcat's defaults."""
    return {
        "uuid": name,
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
    """Make the three.js geometry of a surface; normals and colours have 8 bits per component."""
    s = surface
    attributes = {
        "position": _array("Float32Array", s.points, 3),
        "normal": _array("Int8Array", np.round(s.normals * 127), 3, normalized=True),
        "color": _array(
            "Uint8Array", np.round(lifted(s.colors) * 255), 3, normalized=True
        ),
    }
    if s.uv is not None:
        attributes["uv"] = _array("Float32Array", s.uv, 2)
    groups = [
        {"start": start, "count": corners, "materialIndex": k}
        for k, (start, corners, _) in enumerate(s.groups)
    ]
    small = len(s.points) < 2**16
    index = _array("Uint16Array" if small else "Uint32Array", s.faces, 1)
    return {
        "type": "BufferGeometry",
        "data": {"attributes": attributes, "index": index, "groups": groups},
    }


def lifted(color: ArrayLike) -> NDArray[np.float64]:
    """Narrow the range of a colour, because pure black and pure white hide the shading."""
    return 0.06 + 0.9 * np.asarray(color, float)


def _array(
    kind: str, values: NDArray[Any], size: int, *, normalized: bool = False
) -> dict[str, Any]:
    code, dtype = _ARRAYS[kind]
    data = umsgpack.Ext(code, np.ascontiguousarray(values).astype(dtype).tobytes())
    return {"itemSize": size, "type": kind, "array": data, "normalized": normalized}


def _capsule(radius: float, length: float) -> _Element:
    """Make the three.js geometry of a capsule along y: its outline from below, turned around y."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, _RINGS)
    x = radius * np.cos(angles)
    y = radius * np.sin(angles) + length / 2 * np.sign(angles)
    outline = [{"x": float(a), "y": float(b)} for a, b in zip(x, y, strict=True)]
    return {"type": "LatheGeometry", "points": outline, "segments": _RINGS}
