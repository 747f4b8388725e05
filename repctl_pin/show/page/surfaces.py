"""Mesh files as compact triangles, smoothly shaded, in the colours of the file."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import read_only
from ...errors import InputError
from ...robot.visuals import Shape

KINDS = (".stl", ".dae", ".obj", ".ply", ".off", ".glb", ".gltf")
"""Mesh formats that are read. Archives are not: a few bytes can expand to gigabytes."""

MOST_BYTES = 50_000_000
"""Maximum size of a mesh file or texture, bytes."""

MOST_FACES = 500_000
"""Maximum number of triangles of a file."""

MOST_IN_ALL = 2_000_000
"""Maximum number of triangles of mesh files on a page."""

CREASE = np.cos(np.deg2rad(38))
"""Cosine of the crease angle: faces that meet at less than it are shaded smoothly."""

_HALF = np.cos(np.deg2rad(18.99))
"""Cosine of less than half of it: all faces within that of one direction are within the angle."""

_MANY = 48
"""Number of corners at one point above which its faces are shaded flat, as at a fan's tip."""


@dataclass(frozen=True, eq=False)
@read_only
class Surface:
    """Triangles in metres, in the mesh's own frame.

    Attributes
    ----------
    points, normals : (V, 3) arrays
    colors : (V, 3) array
        Red, green, blue, 0 to 1; of the mesh file itself.
    faces : (F, 3) array of int
        Sorted by texture.
    uv : (V, 2) array or None
        Texture coordinates, where there are textures.
    groups : tuple of (start, count, image)
        Runs of faces' corners with one texture; image is None where there is none.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    colors: NDArray[np.float64]
    faces: NDArray[np.int64]
    uv: NDArray[np.float64] | None
    groups: tuple[tuple[int, int, bytes | None], ...]


Surfaces = dict[Path, Surface | InputError]
"""Surfaces of mesh files; an error where a file cannot be drawn."""


def read_surface(path: Path, most: int = MOST_FACES) -> Surface:
    """Read a mesh file: .stl, .dae, .obj, .ply, .off, .glb or .gltf.

    Raises
    ------
    InputError
        If it cannot be read, is of another kind, or is too large to draw.
    """
    import trimesh  # type: ignore[import-untyped, unused-ignore]

    kind = path.suffix.lower()
    if kind not in KINDS:
        raise InputError(f"mesh {path} is not one of {', '.join(KINDS)}; convert it")
    try:
        data = read_bytes(path)
        with np.errstate(all="ignore"):  # values that are not finite are refused below
            scene = _scene(data, kind[1:], _Beside(path))
        pieces, faces = [], 0
        for node in scene.graph.nodes_geometry:
            transform, name = scene.graph[node]
            mesh = scene.geometry[name]
            if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
                faces += len(mesh.faces)
                if faces > most:
                    raise InputError(f"it has over {most} triangles: make it coarser")
                pieces.append(_piece(mesh, np.asarray(transform)))
        scale = unit(data) if kind == ".dae" else 1.0
    except InputError as error:
        raise InputError(f"mesh {path} cannot be drawn: {error}") from error
    except Exception as error:  # readers of many formats, each with its own errors
        raise InputError(f"mesh {path} cannot be read ({type(error).__name__}: {error})") from error
    if not any(len(piece["points"]) for piece in pieces):
        raise InputError(f"mesh {path} holds no triangles")
    return _join(pieces, scale)


def read_surfaces(shapes: Iterable[Shape]) -> Surfaces:
    """Read the mesh file of every shape, each once: its surface, or why there is none."""
    found: Surfaces = {}
    budget = MOST_IN_ALL
    for path in dict.fromkeys(shape.path for shape in shapes if shape.kind == "mesh"):
        assert path is not None
        try:
            if budget <= 0:
                raise InputError(
                    f"mesh {path} is left out: the page holds {MOST_IN_ALL} triangles already"
                )
            found[path] = surface = read_surface(path, min(budget, MOST_FACES))
        except InputError as error:
            found[path] = error
            continue
        budget -= len(surface.faces)
    return found


def _scene(data: bytes, file_type: str, resolver: _Beside) -> Any:
    """Parse a mesh file with trimesh, its vertices as they are."""
    import trimesh  # type: ignore[import-untyped, unused-ignore]

    file = io.BytesIO(data)
    if file_type != "dae":
        return trimesh.load_scene(file, file_type=file_type, resolver=resolver, process=False)
    # load_scene does not pass process= on to the meshes of a COLLADA file
    parts = trimesh.exchange.load.mesh_loaders["dae"](file, resolver=resolver)
    for mesh in parts["geometry"].values():
        mesh["process"] = not np.isfinite(mesh["vertices"]).all()
    return trimesh.load_scene(parts)


def read_bytes(path: Path) -> bytes:
    """Read a regular file of limited size.

    Raises
    ------
    InputError
        If it is a pipe or a device, or too large.
    """
    if not path.is_file():
        raise InputError(f"{path.name} is not a regular file")
    with path.open("rb") as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise InputError(f"{path.name} is larger than {MOST_BYTES / 1e6:g} MB: make it coarser")
    return data


class _Beside:
    """Resolver for trimesh: reads textures and buffers that a mesh names, from regular files near
    it."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def get(self, name: str) -> bytes:
        """Read a file that the mesh names; trimesh ignores missing ones."""
        folder = self.path.parent.resolve()
        file = (folder / name.strip()).resolve()
        if not file.is_relative_to(folder.parent):  # ../textures is common
            raise InputError(f"it asks for {name[:60]!r}, outside its folder")
        if not file.exists():
            raise FileNotFoundError(name)
        return read_bytes(file)


def unit(data: bytes) -> float:
    """Read the unit of a COLLADA file, in metres."""
    found = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']+)", data[:20_000])
    try:
        meters = float(found[1].replace(b",", b".")) if found else 1.0
    except ValueError:
        meters = math.nan
    if not 0 < meters < math.inf:
        raise InputError(
            f"its unit is {found[1].decode(errors='replace')[:40] if found else ''!r} m; correct it"
        )
    return meters


def _piece(mesh: Any, transform: NDArray[np.float64]) -> dict[str, Any]:
    """Extract one mesh from trimesh, corner by corner (3F rows), in the file's frame."""
    vertices = np.asarray(mesh.vertices, float)
    if not (np.abs(vertices) < 1e9).all() or not (np.abs(transform) < 1e9).all():
        raise InputError("a corner of it is not finite, or is over 1e9 away")
    points = vertices @ transform[:3, :3].T + transform[:3, 3]
    faces = np.asarray(mesh.faces)
    triangles = points[faces]
    flat = np.cross(
        triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    )  # (F, 3), twice the area
    real = (flat[:, 0] != 0) | (flat[:, 1] != 0) | (flat[:, 2] != 0)
    faces, flat = faces[real], flat[real]
    corners = faces.ravel()
    colors, uv, image = _look(mesh, corners)
    normals = smooth(points[corners], flat)
    return {
        "points": points[corners],
        "normals": normals,
        "colors": colors,
        "uv": uv,
        "image": image,
    }


def _look(mesh: Any, corners: NDArray[np.int64]) -> tuple[NDArray[np.float64], Any, bytes | None]:
    """Read a mesh's colours (3F, 3), and its texture if it has one."""
    visual = mesh.visual
    if visual.kind == "texture":
        material = visual.material
        color = np.asarray(material.main_color, float)[:3] / 255
        image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
        if image is not None and visual.uv is not None:
            return (
                np.ones((len(corners), 3)),
                np.asarray(visual.uv, float)[corners],
                _compressed(image),
            )
        return np.broadcast_to(color, (len(corners), 3)), None, None
    if visual.kind in ("vertex", "face"):
        return np.asarray(visual.vertex_colors, float)[corners, :3] / 255, None, None
    return np.full((len(corners), 3), 0.8), None, None


def _compressed(image: Any) -> bytes:
    """Compress an image: JPEG, at most 1024 pixels wide and high."""
    image = image.convert("RGB")
    image.thumbnail((1024, 1024))
    file = io.BytesIO()
    image.save(file, "JPEG", quality=85)
    return file.getvalue()


def smooth(corners: NDArray[np.float64], flat: NDArray[np.float64]) -> NDArray[np.float64]:
    """Average the normals of the faces around each corner that meet at less than the crease angle.

    Parameters
    ----------
    corners : (3F, 3) array
        Points of the faces' corners, three by three.
    flat : (F, 3) array
        The faces' normals, as long as the faces are large.
    """
    grid = 1e-6 * (_extent(corners) or 1.0)
    order, starts = grouped(np.round(corners / grid).astype(np.int64))
    counts = np.diff(starts, append=len(order))
    place = np.repeat(np.arange(len(starts)), counts)  # of each corner in ``order``
    face = order // 3
    unit_normal = _unit(flat, np.zeros_like(flat))
    total = _sums(place, flat[face], len(starts))  # of all faces at a point
    direction = _unit(total, total)
    steep = _dot(unit_normal[face], direction[place]) < _HALF
    mixed = np.bincount(place, steep, len(starts)) > 0  # some may meet at more than the angle
    few = counts <= _MANY
    normals = np.empty_like(corners)
    normals[order] = np.where(few[:, None], direction, 0.0)[place]
    many = ~few[place]
    normals[order[many]] = unit_normal[face[many]]
    _by_pairs(normals, unit_normal, flat, (order, starts, counts), mixed & few)
    return normals


def _by_pairs(
    normals: NDArray[np.float64],
    unit_normal: NDArray[np.float64],
    flat: NDArray[np.float64],
    points: tuple[NDArray[np.int64], NDArray[np.intp], NDArray[np.intp]],
    mixed: NDArray[np.bool_],
) -> None:
    """Average the normals at the ``mixed`` points, each corner with partners within the angle."""
    order, starts, counts = points
    start, count = starts[mixed], counts[mixed]
    each = np.repeat(count, count)  # partners of each corner
    ahead = np.arange(len(each)) - np.repeat(np.cumsum(count) - count, count)
    corner = order[np.repeat(start, count) + ahead]
    mine = np.repeat(np.arange(len(each)), each)
    first = np.repeat(np.repeat(start, count) - (np.cumsum(each) - each), each)
    partner = order[first + np.arange(len(mine))] // 3
    own = unit_normal[corner // 3]
    near = np.einsum("ij,ij->i", own[mine], unit_normal[partner]) > CREASE
    total = _sums(mine[near], flat[partner[near]], len(each))
    normals[corner] = _unit(total, own)


def _sums(place: NDArray[np.intp], vectors: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Sum the vectors (K, 3) that belong to each of ``count`` places: (count, 3)."""
    return np.stack([np.bincount(place, vectors[:, k], count) for k in range(3)], 1)


def _extent(points: NDArray[np.float64]) -> float:
    """Measure the longest edge of the box around points (K, 3)."""
    return max(float(np.ptp(column)) for column in points.T)


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Multiply vectors (K, 3), row by row: (K,). Faster than a sum over so short an axis."""
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]


def _unit(vectors: NDArray[np.float64], zero: NDArray[np.float64]) -> NDArray[np.float64]:
    """Divide vectors (K, 3) by their lengths; take ``zero`` where a length is 0."""
    length = np.sqrt(_dot(vectors, vectors))[:, None]
    return np.divide(vectors, length, out=zero.copy(), where=length > 0)


def grouped(rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
    """Sort the rows of an array (K, k) so that equal rows are consecutive, in their original order.

    The rows are sorted by a hash, which numpy does several times as fast as by their columns; where
    two different rows share a hash, they are sorted by their columns after all.

    Returns
    -------
    order : (K,) array of int
        Numbers of the rows.
    starts : (G,) array of int
        Places in ``order`` at which another row begins.
    """
    bits = len(rows).bit_length()
    factors = np.random.default_rng(0).integers(2**62, size=rows.shape[1], dtype=np.int64)
    hashed = (rows @ (2 * factors + 1)) >> bits  # modulo 2^64
    order = np.sort(hashed << bits | np.arange(len(rows))) & (2**bits - 1)
    differs = _differs(rows[order])
    if (differs != _differs(hashed[order, None])).any():
        order = np.lexsort(rows.T)
        differs = _differs(rows[order])
    return order, np.flatnonzero(differs)


def _differs(rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Compare each row with the one before it; the first counts as different."""
    differs = np.ones(len(rows), bool)
    differs[1:] = False
    for column in rows.T:  # faster than any() over so short an axis
        differs[1:] |= column[1:] != column[:-1]
    return differs


def _join(pieces: list[dict[str, Any]], scale: float) -> Surface:
    """Join mesh pieces into one surface, grouped by texture, each distinct vertex stored once."""
    images = list(dict.fromkeys(piece["image"] for piece in pieces))
    pieces = sorted(pieces, key=lambda piece: images.index(piece["image"]))
    groups, start = [], 0
    for image in images:
        count = sum(len(p["points"]) for p in pieces if p["image"] == image)
        groups.append((start, count, image))
        start += count
    points, normals, colors = (
        np.concatenate([p[k] for p in pieces]) for k in ("points", "normals", "colors")
    )
    textured = any(image is not None for image in images)
    uv = np.concatenate(
        [np.zeros((len(p["points"]), 2)) if p["uv"] is None else p["uv"] for p in pieces]
    )
    # what float32, 8 bits a normal and 8 bits a colour will tell apart
    lattice = _extent(points) / 2**17 or 1.0
    rows = [np.round(points / lattice), np.round(normals * 127), np.round(colors * 255)]
    rows += [np.round(uv * 2**14)] if textured else []
    # each distinct row once, in the order in which the faces first name them: such indices compress
    # well
    order, starts = grouped(np.concatenate(rows, 1).astype(np.int64))
    firsts = order[starts]
    first = np.sort(firsts)
    same = np.empty_like(order)
    same[order] = np.repeat(np.searchsorted(first, firsts), np.diff(starts, append=len(order)))
    at = np.round(points[first] / lattice) * lattice * scale
    faces, kept_uv = same.reshape(-1, 3), uv[first] if textured else None
    return Surface(at, normals[first], colors[first], faces, kept_uv, tuple(groups))
