"""Arms side by side on one page, each leaving its traces behind, cycle by cycle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from ...errors import InputError
from ..plots.motions import VERMILLION
from .html import page
from .meshes import Key, key, lifted, record

if TYPE_CHECKING:
    from ...robot.visuals import Shape

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Frames:
    """Which samples of a motion are shown.

    Attributes
    ----------
    index : (T,) array of int
        Samples, cycle after cycle; every cycle has both its ends, T = len(cycles) * per_cycle.
    cycles : tuple of int
        Numbers of the shown cycles, from 1.
    per_cycle : int
        Pictures of one cycle, both ends counted.
    """

    index: NDArray[np.intp]
    cycles: tuple[int, ...]
    per_cycle: int


@dataclass(frozen=True)
class Arm:
    """One arm of the page.

    Attributes
    ----------
    label : str
        What is written above it: ``J⁺``.
    shapes : tuple of Shape
        What it looks like.
    placements : (T, S, 4, 4) array
        Where each shape stands: rigid, unscaled.
    tip, elbow : (T, 3) or (T, K, 3) arrays
        Points that leave a trace, m: of one limb, or of K limbs.
    cycle_drift : (cycles,) array
        ‖q − q₀‖ after each cycle of the whole motion, rad.
    color : str
        Of its label and traces, ``#RRGGBB``.
    offset : (3,) or None
        Where this copy stands, m; None: beside its neighbour, as seen by the camera.
    unit : str
        Of the drift.
    elbows : tuple of str
        Names of the joints at the elbows; () leaves them without names.
    """

    label: str
    shapes: tuple[Shape, ...]
    placements: Array
    tip: Array
    elbow: Array
    cycle_drift: Array
    color: str = VERMILLION
    offset: tuple[float, float, float] | None = None
    unit: str = "rad"
    elbows: tuple[str, ...] = ()


def choose_frames(samples: int, cycles: int, *, per_cycle: int = 61, shown: int = 24) -> Frames:
    """Choose what to show of a motion of ``samples`` = cycles · steps + 1 configurations.

    Of many cycles, all the early ones and ever sparser later ones are shown, and the last.

    Parameters
    ----------
    samples, cycles
        Of the motion; each cycle has the same number of steps.
    per_cycle
        At most so many pictures a cycle.
    shown
        At most so many cycles.
    """
    steps, rest = divmod(samples - 1, cycles)
    if rest or steps < 1:
        raise InputError(f"{samples} samples are not {cycles} cycles of equal steps and a start")
    numbers = np.arange(1, cycles + 1)
    if cycles > shown:
        early = shown // 2
        numbers = np.unique(np.r_[1 : early + 1, np.round(np.geomspace(early + 1, cycles, shown - early))].astype(int))
    inside = np.round(np.linspace(0, steps, min(per_cycle, steps + 1))).astype(int)  # (F,)
    index = ((numbers - 1)[:, None] * steps + inside).ravel()
    return Frames(index, tuple(numbers.tolist()), len(inside))


def animation_page(
    arms: Sequence[Arm],
    paths: Sequence[ArrayLike],
    *,
    seconds: float,
    title: str,
    caption: str,
    planar: bool = False,
    frames: Frames | None = None,
) -> str:
    """Write one self-contained HTML page: arms side by side, moving through their cycles, looping.

    Parameters
    ----------
    arms
        Two, or any number.
    paths : sequence of (P, 3) arrays
        The paths that the tips follow, closed or not, m.
    seconds
        Time of one cycle at normal speed.
    title, caption
        Robot and task, in words; any text. Lines of the caption are kept.
    planar
        Look from above, as at a drawing.
    frames
        What :func:`choose_frames` gave, if the arms hold only those samples. None: they hold all samples
        of all cycles, and the page chooses.

    Returns
    -------
    The page's HTML.
    """
    if not arms:
        raise InputError("an animation needs at least one arm")
    chosen = frames or choose_frames(len(arms[0].placements), len(arms[0].cycle_drift))
    rows = slice(None) if frames else chosen.index
    commands, library, problems = record(shape for arm in arms for shape in arm.shapes)
    parts: list[Array] = []
    described = [_describe(arm, rows, chosen, library, parts) for arm in arms]
    lines = [np.asarray(path, float) for path in paths]
    odd = next((line.shape for line in lines if line.ndim != 2 or line.shape[1] != 3), None)
    if odd is not None:
        raise InputError(f"a path has shape {odd}, but (P, 3) is wanted")
    scene = {
        "title": title,
        "caption": caption,
        "planar": bool(planar),
        "seconds": float(seconds),
        "cycles": list(chosen.cycles),
        "perCycle": chosen.per_cycle,
        "paths": [len(line) for line in lines],
        "problems": problems,
        "arms": described,
    }
    motion = np.concatenate([p.ravel() for p in [*parts, *lines]]).astype("<f4").tobytes()
    return page(scene, commands, motion, title=title)


def _describe(
    arm: Arm, rows: slice | NDArray[np.intp], frames: Frames, library: dict[Key, int], parts: list[Array]
) -> dict[str, Any]:
    """Describe an arm in plain types; what moves goes to ``parts``: bodies (T, M, 7), tips, elbows (T, K, 3)."""
    placements, tip, elbow = (np.asarray(a, float)[rows] for a in (arm.placements, arm.tip, arm.elbow))
    tip, elbow = (a[:, None] if a.ndim == 2 else a for a in (tip, elbow))
    drift = np.asarray(arm.cycle_drift, float)
    T, S, K = len(frames.index), len(arm.shapes), tip.shape[1]
    wanted: dict[str, tuple[Array, tuple[int, ...]]] = {
        "placements": (placements, (T, S, 4, 4)),
        "tip": (tip, (T, K, 3)),
        "elbow": (elbow, (T, K, 3)),
        "cycle_drift": (drift, (max(frames.cycles[-1], len(drift)),)),
    }
    for name, (array, size) in wanted.items():
        if array.shape != size:
            raise InputError(f"arm {arm.label!r}: {name} has shape {array.shape}, but {size} is wanted")
        if not np.isfinite(array).all():
            raise InputError(f"arm {arm.label!r}: {name} holds numbers that are not finite")
    # to 0.1 µm, so that a pose that returns is the same number again
    poses = np.round(poses_of(placements), 7)  # (T, S, 7)
    moving = np.ptp(placements, axis=0).reshape(S, -1).max(axis=1, initial=0.0) > 1e-12
    parts += [poses[:, moving], tip, elbow]
    shapes = []
    for k, shape in enumerate(arm.shapes):
        shapes.append(
            {
                "name": shape.name,
                "body": library.get(key(shape)),
                "scale": [float(s) for s in shape.scale],
                "color": None if shape.textured else [*lifted(shape.color[:3]).tolist(), float(shape.color[3])],
                "pose": None if moving[k] else poses[0, k].tolist(),
            }
        )
    return {
        "label": arm.label,
        "color": arm.color,
        "unit": arm.unit,
        "offset": None if arm.offset is None else [float(v) for v in arm.offset],
        "drift": drift.tolist(),
        "limbs": K,
        "elbows": list(arm.elbows),
        "shapes": shapes,
    }


def poses_of(placements: Array) -> Array:
    """Turn rigid transforms (T, S, 4, 4) into positions and unit quaternions (T, S, 7): x y z, qx qy qz qw.

    Of the two quaternions of each rotation, the one nearer to the frame before.
    """
    R, p = placements[..., :3, :3], placements[..., :3, 3]
    q = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat().reshape(*R.shape[:-2], 4)
    flips = np.einsum("tsi,tsi->ts", q[1:], q[:-1]) < 0
    q[1:][np.logical_xor.accumulate(flips, axis=0)] *= -1
    return np.concatenate([p, q], -1)
