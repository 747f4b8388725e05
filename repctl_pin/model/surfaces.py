"""Mesh files as compact triangle meshes, smoothly shaded, in the colours of the file.

``Surface`` is a triangle mesh: points, normals, colours (V, 3) and faces (F, 3). ``Shape`` is a
shape of a URDF as plain data: its kind, size, link and place, or its mesh file. ``_Beside`` is a
resolver by which trimesh reads only files near the mesh. ``Surfaces`` are the triangle meshes of
mesh files by path, with the error instead if a file is unreadable.
"""

from __future__ import annotations

import io
import logging
import math
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import get_ident
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import Array, read_only
from ..base.errors import InputError
from .mesh_cache import cached
from .shapes import Shape

HEAD = 20_000
"""Number of bytes at the beginning of a COLLADA file that hold its unit of length."""

KINDS = (".stl", ".dae", ".obj", ".ply", ".off", ".glb", ".gltf")
"""Mesh formats that are read. Archives are not: a few bytes can expand to gigabytes."""

_MOST_BYTES = 50_000_000
"""Maximum size of a mesh file or texture, bytes."""

_MOST_FACES = 500_000
"""Maximum number of triangles of a file."""

_MOST_IN_ALL = 2_000_000
"""Maximum number of triangles of all mesh files on a page."""

_CREASE = np.cos(np.deg2rad(38))
"""Cosine of the crease angle: faces that meet at a smaller angle are shaded smoothly."""

_HALF = np.cos(np.deg2rad(18.99))
"""Cosine of just under half the crease angle.

Any two faces within this angle of one direction are within the crease angle of each other.
"""

_MANY = 48
"""Number of face corners at one point above which its faces are shaded flat, as at a fan's tip."""


@dataclass(frozen=True, eq=False)
@read_only
class Surface:
    """Triangle mesh in the frame of its file, with V vertices and F faces, ready to be drawn.

    Attributes
    ----------
    points, normals : (V, 3) arrays
        Vertices, m, and their unit normals.
    colors : (V, 3) array
        Red, green and blue of each vertex, 0 to 1, from the mesh file or its textures.
    faces : (F, 3) array of int
        Vertex numbers of each triangle.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    colors: NDArray[np.float64]
    faces: NDArray[np.int64]


Surfaces = dict[Path, Surface | InputError]
"""Contents of mesh files, by path; an error for a file that cannot be drawn."""


_ALONE = (".stl", ".dae", ".ply", ".off", ".glb")
"""Formats whose files depend on no other files, except for textures."""

_CACHED = (".stl", ".dae", ".off")
"""Formats whose surfaces are cached on disk; those of .dae files only without textures."""

_KEPT_FACES = 300_000
_kept: dict[tuple[Path, int, int], Surface] = {}
"""Surfaces read last, by file, modification time and ``most``; the terminal and the page share
them."""


def read_surface(path: Path, most: int = _MOST_FACES) -> Surface:
    """Read the surface in a mesh file; it is cached until the file changes.

    Raises
    ------
    InputError
        If the file cannot be read, or has over ``most`` triangles.
    """
    changed = path.stat().st_mtime_ns if path.is_file() else 0
    key = path, changed, most
    if key not in _kept:
        surface = _cached(path, most) if path.suffix.lower() in _CACHED else _read(path, most)
        if path.suffix.lower() not in _ALONE:
            return surface
        if sum(len(each.faces) for each in _kept.values()) > _KEPT_FACES:
            _kept.clear()
        _kept[key] = surface
    return _kept[key]


def _cached(path: Path, most: int) -> Surface:
    """Read a mesh file of at most ``most`` triangles, from the cache on disk if it is there.

    InputError is raised for a mesh with more triangles, or one that cannot be read.
    """
    arrays = cached(
        path,
        f"surface of at most {most} triangles",
        lambda: {name: np.asarray(values) for name, values in vars(_read(path, most)).items()},
        textures=True,
    )
    return Surface(arrays["points"], arrays["normals"], arrays["colors"], arrays["faces"])


def _read(path: Path, most: int) -> Surface:
    """Read a mesh file of at most ``most`` triangles: .stl, .dae, .obj, .ply, .off, .glb or .gltf.

    Raises
    ------
    InputError
        If the file cannot be read, has another format, or is too large to draw.
    """
    import trimesh  # type: ignore[import-untyped, unused-ignore]

    kind = path.suffix.lower()
    if kind not in KINDS:
        raise InputError(
            f"mesh {path} has an unsupported format; convert it to one of {', '.join(KINDS)}"
        )
    try:
        data = _read_bytes(path)
        with np.errstate(all="ignore"):  # values that are not finite are refused below
            scene = _scene(data, kind[1:], _Beside(path))
        pieces, faces = [], 0
        for node in scene.graph.nodes_geometry:
            transform, name = scene.graph[node]
            mesh = scene.geometry[name]
            if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
                faces += len(mesh.faces)
                if faces > most:
                    raise InputError(f"the mesh has over {most:,} triangles; simplify it")
                pieces.append(_piece(mesh, np.asarray(transform)))
        scale = unit(data) if kind == ".dae" else 1.0
    except InputError as error:
        raise InputError(f"mesh {path} cannot be drawn: {error}") from error
    except Exception as error:  # readers of many formats, each with its own errors
        raise InputError(
            f"mesh {path} cannot be read ({type(error).__name__}: {error})",
            remedy="check the file, or export it again",
        ) from error
    if not any(len(points) for points, *_ in pieces):
        raise InputError(f"mesh {path} contains no triangles; export it again")
    points, normals, colors = map(np.concatenate, zip(*pieces, strict=True))
    return _join(points, normals, colors, scale)


def read_surfaces(shapes: Iterable[Shape]) -> Surfaces:
    """Read the mesh files of shapes; return a dict from each file to its surface, or to its error.

    The error is an InputError: the file cannot be read, has too many triangles, or would exceed the
    limit of two million triangles in all files together, which keeps a page usable.
    """
    found: Surfaces = {}
    budget = _MOST_IN_ALL
    for path in dict.fromkeys(shape.path for shape in shapes if shape.kind == "mesh"):
        assert path is not None
        try:
            surface = read_surface(path)
            if len(surface.faces) > budget:
                raise InputError(
                    f"mesh {path} is left out: with it, the page would have over "
                    f"{_MOST_IN_ALL:,} triangles; simplify the meshes"
                )
        except InputError as error:
            found[path] = error
            continue
        found[path] = surface
        budget -= len(surface.faces)
    return found


def _scene(data: bytes, file_type: str, resolver: _Beside) -> Any:
    """Parse the content of a mesh file to a scene of the library trimesh.

    Vertices are not merged or reordered. ``file_type`` is the suffix without a dot, and
    ``resolver`` reads other files that the mesh names.
    """
    import trimesh  # type: ignore[import-untyped, unused-ignore]

    file = io.BytesIO(data)
    with without_tracebacks():
        return _parsed(trimesh, file, file_type, resolver)


def _parsed(trimesh: Any, file: io.BytesIO, file_type: str, resolver: _Beside) -> Any:
    """Parse an open mesh file to a scene of ``trimesh``, which is the imported library."""
    if file_type != "dae":
        return trimesh.load_scene(file, file_type=file_type, resolver=resolver, process=False)
    # load_scene does not pass process= on to the meshes of a COLLADA file
    parts = trimesh.exchange.load.mesh_loaders["dae"](file, resolver=resolver)
    for mesh in parts["geometry"].values():
        mesh["process"] = not np.isfinite(mesh["vertices"]).all()
        mesh.pop("vertex_normals", None)  # not used, and costly to keep
    return trimesh.load_scene(parts)


@contextmanager
def without_tracebacks() -> Iterator[None]:
    """Keep trimesh from logging messages on this thread, as a context manager.

    trimesh continues without a missing texture, but logs a traceback.
    """
    thread = get_ident()
    logger = logging.getLogger("trimesh.util")

    def of_others(record: logging.LogRecord) -> bool:
        return record.thread != thread

    logger.addFilter(of_others)
    try:
        yield
    finally:
        logger.removeFilter(of_others)


def _read_bytes(path: Path) -> bytes:
    """Read a regular file of limited size.

    Raises
    ------
    InputError
        If the file is missing, not a regular file, or too large.
    """
    if not path.is_file():
        raise InputError(f"{path.name} is not a regular file; give a mesh file")
    with path.open("rb") as file:
        data = file.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        raise InputError(f"{path.name} is larger than {_MOST_BYTES / 1e6:g} MB; simplify the mesh")
    return data


class _Beside:
    """Resolver for trimesh: it reads the textures and buffers that the mesh file ``path`` names.

    Only regular files in or below the parent of the mesh's folder are read: for
    ``robot/meshes/x.dae``, those in or below ``robot``. So a mesh cannot make the program read
    other files of the computer.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def get(self, name: str) -> bytes:
        """Read a file that the mesh names.

        FileNotFoundError is raised for a missing file, which trimesh then ignores. InputError is
        raised for a file that must not be read.
        """
        folder = self.path.parent.resolve()
        file = (folder / name.strip()).resolve()
        if not file.is_relative_to(folder.parent):  # ../textures is common
            raise InputError(
                f"the mesh names the file {name[:60]!r}, which is neither in the folder of the "
                "mesh nor in the folder above; move the file beside the mesh, and change its name "
                "in the mesh"
            )
        if not file.exists():
            raise FileNotFoundError(name)
        return _read_bytes(file)


def unit(data: bytes) -> float:
    """Read the unit of length of a COLLADA file, in metres; 1 if the file names none.

    InputError is raised if the unit is not a positive number.
    """
    found = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']+)", data[:HEAD])
    try:
        meters = float(found[1].replace(b",", b".")) if found else 1.0
    except ValueError:
        meters = math.nan
    if not 0 < meters < math.inf:
        text = found[1].decode(errors="replace")[:40] if found else ""
        raise InputError(
            f"the mesh file has the unit of length {text!r} m, which is not a positive number",
            remedy="correct <unit meter=…> in the file",
        )
    return meters


def _piece(mesh: Any, transform: NDArray[np.float64]) -> tuple[Array, Array, Array]:
    """Extract (points, normals, colours) of one mesh of a trimesh scene, each (3F, 3).

    There is one row per corner of its F faces. Points are in the file's frame and unit of length,
    and colours from 0 to 1. ``transform`` (4, 4) is the mesh's placement in the scene.
    """
    vertices = np.asarray(mesh.vertices, float)
    if not (np.abs(vertices) < 1e9).all() or not (np.abs(transform) < 1e9).all():
        raise InputError("a coordinate is over 1e9, or not finite; export the mesh again")
    points = vertices @ transform[:3, :3].T + transform[:3, 3]
    faces = np.asarray(mesh.faces)
    triangles = points.take(faces, 0)
    # (F, 3), twice the area
    flat = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    real = (flat[:, 0] != 0) | (flat[:, 1] != 0) | (flat[:, 2] != 0)
    faces, flat = faces[real], flat[real]
    corners = faces.ravel()
    places = points.take(corners, 0)
    return places, smooth(places, flat), _colors(mesh, corners)


def _colors(mesh: Any, corners: NDArray[np.int64]) -> NDArray[np.float64]:
    """Read the colours (3F, 3), red, green and blue from 0 to 1, of the corners of F faces.

    ``corners`` (3F,) are the vertex numbers of the corners. A texture gives a corner the colour at
    its vertex. A mesh without colours is grey.
    """
    from trimesh.visual.color import uv_to_color

    visual = mesh.visual
    if visual.kind in ("vertex", "face"):
        return np.asarray(visual.vertex_colors, float)[corners, :3] / 255
    if visual.kind != "texture":
        return np.full((len(corners), 3), 0.8)
    material = visual.material
    pictures = (getattr(material, name, None) for name in ("baseColorTexture", "image"))
    image = next(filter(None, pictures), None)
    if image is None or visual.uv is None:
        color = np.asarray(material.main_color, float)[:3] / 255
        return np.broadcast_to(color, (len(corners), 3))
    return uv_to_color(visual.uv, image)[corners, :3] / 255


def smooth(corners: NDArray[np.float64], flat: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute averaged unit normals (3F, 3) of the corners of F faces, for smooth shading.

    Corners of several faces can lie at one point. The normal of a corner is an average of the
    normals of these faces, weighted by area. It includes only the faces whose normals differ from
    that of the corner's own face by at most the crease angle, ``arccos(_CREASE)``. Where more than
    ``_MANY`` corners lie at one point, each corner has the normal of its own face.

    Parameters
    ----------
    corners : (3F, 3) array
        Positions of the face corners, three consecutive rows per face.
    flat : (F, 3) array
        Normals of the faces, whose lengths are proportional to the faces' areas.
    """
    grid = 1e-6 * (_extent(corners) or 1.0)
    point = distinct(np.round(corners / grid).astype(np.int64))[1]  # of each corner
    count = np.bincount(point)
    face = np.arange(len(corners)) // 3
    unit_normal = _unit(flat, np.zeros_like(flat))
    own = unit_normal.take(face, 0)
    total = _sums(point, flat.take(face, 0), len(count))  # of all faces at a point
    normals = _unit(total, total).take(point, 0)
    steep = _dot(own, normals) < _HALF
    mixed = np.bincount(point, steep) > 0  # some may meet at more than the angle
    many = count > _MANY
    normals[many[point]] = own[many[point]]
    uneven = np.flatnonzero((mixed & ~many)[point])
    _by_pairs(normals, uneven, point[uneven], unit_normal, flat)
    return normals


def _by_pairs(
    normals: NDArray[np.float64],
    corner: NDArray[np.intp],
    point: NDArray[np.intp],
    unit_normal: NDArray[np.float64],
    flat: NDArray[np.float64],
) -> None:
    """Write averaged normals of K face corners into their rows of ``normals`` (3F, 3).

    The average is over the faces at the corner's point whose normals differ from that of the
    corner's own face by at most the crease angle; each pair of corners at one point is compared.
    ``corner`` (K,) are the numbers of the corners, and ``point`` (K,) the numbers of the points at
    which the corners lie. ``flat`` (F, 3) are the normals of the faces, weighted by area, and
    ``unit_normal`` (F, 3) the unit normals of the faces.
    """
    order = np.argsort(point, kind="stable")
    corner, point = corner[order], point[order]
    starts = np.searchsorted(point, point)  # of the corners at the same point
    counts = np.searchsorted(point, point, side="right") - starts
    mine = np.repeat(np.arange(len(corner)), counts)
    before = np.repeat(np.cumsum(counts) - counts, counts)
    partner = corner[starts[mine] + np.arange(len(mine)) - before] // 3
    own = unit_normal.take(corner // 3, 0)
    near = _dot(own.take(mine, 0), unit_normal.take(partner, 0)) > _CREASE
    total = _sums(mine[near], flat.take(partner[near], 0), len(corner))
    normals[corner] = _unit(total, own)


def _sums(place: NDArray[np.intp], vectors: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Sum K vectors (K, 3) in groups: (count, 3).

    ``place`` (K,) is the number, 0 to count − 1, of each vector's group.
    """
    return np.stack([np.bincount(place, vectors[:, k], count) for k in range(3)], 1)


def _extent(points: NDArray[np.float64]) -> float:
    """Compute the longest edge of the bounding box of points (K, 3)."""
    return max(float(np.ptp(column)) for column in points.T)


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute dot products of vectors (K, 3), row by row: (K,).

    This is faster than a sum over an axis of 3.
    """
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]


def _unit(vectors: NDArray[np.float64], zero: NDArray[np.float64]) -> NDArray[np.float64]:
    """Normalise vectors (K, 3); take the rows of ``zero`` for vectors of length 0."""
    length = np.sqrt(_dot(vectors, vectors))[:, None]
    return np.divide(vectors, length, out=zero.copy(), where=length > 0)


def distinct(rows: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Find the distinct rows of an array (K, k).

    The rows are compared by a hash of 64 bits, which NumPy sorts several times as fast as rows.
    Among a million rows, two different ones share a hash with a probability of 1e-7.

    Returns
    -------
    first : (G,) array of int
        Index of the first one of each group of equal rows; the groups are in any order.
    group : (K,) array of int
        Group of each row.
    """
    random = np.random.default_rng(0)
    factors = random.integers(2**62, size=rows.shape[1], dtype=np.int64)
    hashed = rows @ (2 * factors + 1)  # modulo 2^64
    _, first, group = np.unique(hashed, return_index=True, return_inverse=True)
    return first, group


def _join(points: Array, normals: Array, colors: Array, scale: float) -> Surface:
    """Make a surface from the corners of F faces, with each distinct vertex stored once.

    ``points``, ``normals`` and ``colors`` (3F, 3) have a row per face corner. Vertices are distinct
    if position, normal or colour differ. Positions are rounded to 2⁻¹⁷ of the mesh's size, and
    converted from the file's unit of length, ``scale`` in m.
    """
    # what float32, 8 bits a normal and 8 bits a colour will tell apart
    lattice = _extent(points) / 2**17 or 1.0
    steps = np.hstack([points / lattice, normals * 127, colors * 255])
    # each distinct row once, in the order in which the faces first name them: such indices compress
    # well
    firsts, group = distinct(np.round(steps).astype(np.int64))
    first = np.sort(firsts)
    return Surface(
        np.round(points.take(first, 0) / lattice) * lattice * scale,
        normals.take(first, 0),
        colors.take(first, 0),
        np.searchsorted(first, firsts)[group].reshape(-1, 3),
    )
