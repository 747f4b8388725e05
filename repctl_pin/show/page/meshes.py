"""What a page's viewer is told: meshcat's own commands, recorded instead of sent to a server.

Every distinct body goes in once, as ``/library/k``; the page places copies of it.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable
from typing import Any

import meshcat
import numpy as np
import umsgpack
from meshcat import geometry as g
from numpy.typing import ArrayLike, NDArray

from ...errors import InputError
from ...robot.visuals import Shape
from .surfaces import MOST_FACES, Surface, read_surface

Key = tuple[Any, ...]
"""What shapes share: the mesh file, or kind and size; not the scale, colour or place."""

_LIGHTS = ("AmbientLight", "FillLight", "PointLightNegativeX", "PointLightPositiveX")
HIDDEN = ("/Grid", "/Axes", *(f"/Lights/{light}" for light in _LIGHTS), "/library", "/Background")
"""What meshcat's viewer shows by itself, and the page has its own of."""

_ARRAYS = {"Int8Array": (0x11, "<i1"), "Uint8Array": (0x12, "<u1"), "Uint16Array": (0x14, "<u2"),
           "Uint32Array": (0x16, "<u4"), "Float32Array": (0x17, "<f4")}  # fmt: skip
MOST_IN_ALL = 2_000_000
"""The most triangles of mesh files on a page."""

_GLOSS = {"specular": 0x1C1C1C, "shininess": 28}


class Recorder:
    """Stands where meshcat expects its server's window, and keeps what is sent.

    meshcat names things by the clock; here they are named by their order, so that the same scene is
    the same bytes.

    Attributes
    ----------
    commands : list of bytes
        Each command, as msgpack.
    """

    def __init__(self) -> None:
        self.commands: list[bytes] = []

    def send(self, command: Any) -> None:
        """Keep one command."""
        data = command.lower()
        self.commands.append(
            umsgpack.packb(_renamed(data, {u: f"{k}" for k, u in enumerate(_uuids(data))}))
        )


def record(shapes: Iterable[Shape]) -> tuple[list[bytes], dict[Key, int], list[str]]:
    """Record the commands that fill a viewer's library with every distinct body among some shapes.

    Returns
    -------
    The commands, each body's number in the library by its :func:`key`, and what could not be read,
    in words; such a body has no number."""
    recorder = Recorder()
    viewer = meshcat.Visualizer(window=recorder)
    for name in HIDDEN:
        viewer[name].set_property("visible", False)
    distinct: dict[Key, Shape] = {}
    for shape in shapes:
        distinct.setdefault(key(shape), shape)
    problems: list[str] = []
    library: dict[Key, int] = {}
    room = MOST_IN_ALL
    for body, shape in distinct.items():
        try:
            thing = _object(shape, min(room, MOST_FACES))
        except InputError as error:
            problems.append(str(error))
            continue
        if isinstance(thing, _Painted):
            room -= len(thing.surface.faces)
        library[body] = len(library)
        viewer[f"/library/{library[body]}"].set_object(thing)
    return recorder.commands, library, problems


def key(shape: Shape) -> Key:
    """Tell which body a shape shows."""
    return ("mesh", str(shape.path)) if shape.kind == "mesh" else (shape.kind, *shape.size)


def _object(shape: Shape, most: int) -> g.Object:
    """Make meshcat's object for a shape, of so many triangles at most; a cylinder's axis is z here,
    as in a URDF."""
    size = [float(s) for s in shape.size]
    if shape.kind == "mesh":
        assert shape.path is not None
        if most <= 0:
            raise InputError(
                f"mesh {shape.path} is left out: the page holds {MOST_IN_ALL} triangles already"
            )
        return _Painted(read_surface(shape.path, most))
    if shape.kind == "box":
        return g.Mesh(g.Box(size))
    if shape.kind == "sphere":
        return g.Mesh(_round(size[0], 0.0))
    if shape.kind == "capsule":
        return g.Mesh(_round(size[0], size[1]))
    if shape.kind == "cylinder":
        return g.Mesh(_UprightCylinder(size[1], size[0]))
    raise InputError(
        f"shape {shape.name!r} has kind {shape.kind!r}; there is mesh, box, cylinder, sphere, capsule"
    )


class _Triangles(g.Geometry):
    """A surface as three.js' BufferGeometry: 8 bits a normal's coordinate, and a colour's."""

    def __init__(self, surface: Surface) -> None:
        super().__init__()
        self.surface = surface

    def lower(self, object_data: dict[str, Any]) -> dict[str, Any]:
        s = self.surface
        attributes = {
            "position": _array("Float32Array", s.points, 3),
            "normal": _array("Int8Array", np.round(s.normals * 127), 3, normalized=True),
            "color": _array("Uint8Array", np.round(lifted(s.colors) * 255), 3, normalized=True),
        }
        if s.uv is not None:
            attributes["uv"] = _array("Float32Array", s.uv, 2)
        groups = [
            {"start": start, "count": count, "materialIndex": k}
            for k, (start, count, _) in enumerate(s.groups)
        ]
        small = len(s.points) < 2**16
        data = {
            "attributes": attributes,
            "index": _array("Uint16Array" if small else "Uint32Array", s.faces, 1),
            "groups": groups,
        }
        return {"uuid": self.uuid, "type": "BufferGeometry", "data": data}


class _Painted(g.Object):
    """A surface in the colours and textures of its file: one material a texture."""

    _type = "Mesh"

    def __init__(self, surface: Surface) -> None:
        super().__init__(_Triangles(surface))
        self.surface = surface
        self.materials = [
            g.MeshPhongMaterial(color=0xFFFFFF, vertexColors=True, map=_texture(image), **_GLOSS)
            for *_, image in surface.groups
        ]
        self.material = self.materials[0]

    def lower(self) -> dict[str, Any]:
        data = super().lower()
        for material in self.materials[1:]:
            material.lower_in_object(data)
        data["object"]["material"] = [material.uuid for material in self.materials]
        return data


class _UprightCylinder(g.Cylinder):
    """meshcat's cylinder stands along y; a URDF's along z."""

    def intrinsic_transform(self) -> NDArray[np.float64]:
        # meshcat writes this row by row where three.js reads columns: the transpose is meant.
        return np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def _uuids(data: Any) -> list[str]:
    if isinstance(data, dict):
        own = [data["uuid"]] if "uuid" in data else []
        return own + [u for value in data.values() for u in _uuids(value)]
    return [u for value in data for u in _uuids(value)] if isinstance(data, list) else []


def _renamed(data: Any, names: dict[str, str]) -> Any:
    if isinstance(data, dict):
        return {k: _renamed(value, names) for k, value in data.items()}
    if isinstance(data, list):
        return [_renamed(value, names) for value in data]
    return names.get(data, data) if isinstance(data, str) else data


def lifted(color: ArrayLike) -> NDArray[np.float64]:
    """Soften a colour: pure black and pure white hide the shading."""
    return 0.06 + 0.9 * np.asarray(color, float)


def _texture(image: bytes | None) -> g.ImageTexture | None:
    if image is None:
        return None
    picture = g.PngImage(image)
    picture.lower = lambda data: {
        "uuid": picture.uuid,
        "url": f"data:image/jpeg;base64,{base64.b64encode(image).decode()}",
    }
    return g.ImageTexture(picture, wrap=[1000, 1000])


def _array(
    kind: str, values: NDArray[Any], size: int, *, normalized: bool = False
) -> dict[str, Any]:
    code, dtype = _ARRAYS[kind]
    data = umsgpack.Ext(code, np.ascontiguousarray(values).astype(dtype).tobytes())
    return {"itemSize": size, "type": kind, "array": data, "normalized": normalized}


def _round(radius: float, length: float, n: int = 24) -> g.TriangularMeshGeometry:
    """Make a capsule along z (a sphere where length is 0)."""
    polar = np.concatenate(
        [np.linspace(0, np.pi / 2, n // 2), np.linspace(np.pi / 2, np.pi, n // 2)]
    )
    height = radius * np.cos(polar) + np.repeat([length / 2, -length / 2], n // 2)  # (n,)
    turn = np.linspace(0, 2 * np.pi, n, endpoint=False)
    ring = radius * np.sin(polar)[:, None]
    z = np.broadcast_to(height[:, None], (n, n))
    points = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], -1).reshape(-1, 3)
    i, j = (a.ravel() for a in np.indices((n - 1, n)))
    a, b, c, d = i * n + j, i * n + (j + 1) % n, (i + 1) * n + j, (i + 1) * n + (j + 1) % n
    return g.TriangularMeshGeometry(
        points, np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])
    )
