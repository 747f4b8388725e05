"""Arms side by side on one page, each leaving its traces behind, cycle by cycle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from ...errors import InputError
from ..palette import VERMILLION
from ..text.verdict import NO_VERDICT, Verdict
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
class Broken:
    """A motion beyond what the arm can do: what is said, when (in cycles), in which cycle, and where: (T, 3), m."""

    words: str
    at: float
    cycle: int
    origin: Array


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
    q : (T, n) array
        Configurations, whose distance from cycle 1 is the drift.
    cycle_drift : (cycles,) array
        ‖q − q₀‖ after each cycle of the whole motion, rad.
    color : str
        Of its label and traces, ``#RRGGBB``.
    unit : str
        Of the drift.
    joint_names : tuple of str
        Of q; () numbers them.
    limits : (2, n) array or None
        Least and largest q; infinite where there is none.
    broken : Broken or None
        The joint that leaves its limits first, or the two bodies that touch.
    """

    label: str
    shapes: tuple[Shape, ...]
    placements: Array
    tip: Array
    elbow: Array
    q: Array
    cycle_drift: Array
    color: str = VERMILLION
    unit: str = "rad"
    joint_names: tuple[str, ...] = ()
    limits: Array | None = None
    broken: Broken | None = None


def choose_frames(samples: int, cycles: int, *, per_cycle: int = 61, shown: int = 24) -> Frames:
    """Choose what to show of a motion of ``samples`` = cycles · steps + 1 configurations.

    Of many cycles, the first, and back from the last every so many.

    Parameters
    ----------
    samples, cycles
        Of the motion; each cycle has the same number of steps.
    per_cycle
        At most so many pictures per cycle.
    shown
        At most so many cycles.
    """
    steps, rest = divmod(samples - 1, cycles)
    if rest or steps < 1:
        raise InputError(f"{samples} samples are not {cycles} cycles of equal steps and a start")
    stride = -(-(cycles - 1) // (shown - 1)) or 1
    numbers = np.unique(np.r_[1, np.arange(cycles, 0, -stride)])
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
    verdict: Verdict = NO_VERDICT,
    live: bool = False,
) -> str:
    """Write one self-contained HTML page: a pane an arm, moving through their cycles, looping.

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
    verdict
        What stands above it all.
    live
        The poses come from a :class:`~repctl_pin.show.page.viewer.Viewer`; what the arms hold is where they may be.

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
    pair = _liveliest([np.asarray(arm.q, float)[rows] for arm in arms], chosen)
    described = [_describe(arm, rows, chosen, library, pair, parts) for arm in arms]
    lines = [np.asarray(path, float) for path in paths]
    odd = next((line.shape for line in lines if line.ndim != 2 or line.shape[1] != 3), None)
    if odd is not None:
        raise InputError(f"a path has shape {odd}, but (P, 3) is wanted")
    scene = {
        "title": title,
        "caption": caption,
        "planar": bool(planar),
        "live": live,
        "seconds": float(seconds),
        "cycles": list(chosen.cycles),
        "perCycle": chosen.per_cycle,
        "paths": [len(line) for line in lines],
        "problems": problems,
        "pair": None if pair is None else _pair(arms[0], pair),
        "arms": described,
    }
    motion = np.concatenate([p.ravel() for p in [*parts, *lines]]).astype("<f4").tobytes()
    return page(scene, commands, motion, verdict)


def _from_first(q: Array, frames: Frames) -> Array:
    """How far every joint is off where it was in cycle 1, at the same part of the cycle: (T, n)."""
    cycles = q.reshape(len(frames.cycles), frames.per_cycle, -1)
    return (cycles - cycles[0]).reshape(q.shape)


def _liveliest(every: Sequence[Array], frames: Frames) -> tuple[int, int] | None:
    """Choose the two joints that drift most, or move most where none drifts; None where there are not two."""
    if min(q.shape[-1] for q in every) < 2 or any(q.shape != (len(frames.index), every[0].shape[-1]) for q in every):
        return None
    most = np.max([np.abs(_from_first(q, frames)).max(axis=0) for q in every], axis=0)
    if most.max() < 1e-4:
        most = np.max([np.ptp(q, axis=0) for q in every], axis=0)
    i, j = sorted(np.argsort(-most, kind="stable")[:2].tolist())
    return i, j


def _pair(arm: Arm, pair: tuple[int, int]) -> dict[str, Any]:
    """The names and the limits of two joints."""
    ends = np.full((2, max(pair) + 1), np.nan) if arm.limits is None else np.asarray(arm.limits, float)
    return {
        "names": [arm.joint_names[k] if arm.joint_names else f"joint {k + 1}" for k in pair],
        "limits": [[float(v) if np.isfinite(v) else None for v in ends[:, k]] for k in pair],
    }


def _describe(
    arm: Arm,
    rows: slice | NDArray[np.intp],
    frames: Frames,
    library: dict[Key, int],
    pair: tuple[int, int] | None,
    parts: list[Array],
) -> dict[str, Any]:
    """Describe an arm in plain types; what moves goes to ``parts``.

    Bodies (T, M, 7), tips and elbows (T, K, 3), distance from cycle 1 (T,), two joints (T, 2), the broken joint (T, 3).
    """
    placements, tip, elbow, q = (np.asarray(a, float)[rows] for a in (arm.placements, arm.tip, arm.elbow, arm.q))
    tip, elbow = (a[:, None] if a.ndim == 2 else a for a in (tip, elbow))
    drift = np.asarray(arm.cycle_drift, float)
    T, S, K = len(frames.index), len(arm.shapes), tip.shape[1]
    wanted: dict[str, tuple[Array, tuple[int, ...]]] = {
        "placements": (placements, (T, S, 4, 4)),
        "tip": (tip, (T, K, 3)),
        "elbow": (elbow, (T, K, 3)),
        "q": (q, (T, q.shape[-1])),
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
    parts += [poses[:, moving], tip, elbow, np.linalg.norm(_from_first(q, frames), axis=1)]
    parts += [] if pair is None else [q[:, pair]]
    parts += [] if arm.broken is None else [np.asarray(arm.broken.origin, float)[rows]]
    shapes = []
    for k, shape in enumerate(arm.shapes):
        shapes.append(
            {
                "name": shape.name,
                "body": library.get(key(shape)),
                "scale": [float(s) for s in shape.scale],
                "color": None if shape.textured else [*lifted(shape.color[:3]).tolist(), float(shape.color[3])],
                "pose": None if moving[k] else poses[0, k].tolist(),
                "standing": shape.standing,
            }
        )
    return {
        "label": arm.label,
        "color": arm.color,
        "unit": arm.unit,
        "drift": drift.tolist(),
        "limbs": K,
        "pair": pair is not None,
        "broken": None
        if arm.broken is None
        else {"words": arm.broken.words, "at": float(arm.broken.at), "cycle": arm.broken.cycle},
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
