"""Scene of the animation page: arms side by side, each with traces of its cycles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ...arguments import Array, read_only
from ...errors import InputError
from ...robot.visuals import Shape
from ...studies.study_result import picked
from ..palette import VERMILLION
from ..text.verdict import NO_VERDICT, Verdict
from .html import page
from .meshes import Key, key, lifted, record


@dataclass(frozen=True, eq=False)
@read_only
class Frames:
    """The samples of a motion that are shown.

    Attributes
    ----------
    index : (T,) array of int
        Indices of the samples, cycle by cycle, each with both its ends: T = len(cycles) *
        per_cycle.
    cycles : tuple of int
        Numbers of the shown cycles, counted from 1.
    per_cycle : int
        Number of samples of one cycle, including both ends.
    """

    index: NDArray[np.intp]
    cycles: tuple[int, ...]
    per_cycle: int


@dataclass(frozen=True, eq=False)
@read_only
class Violation:
    """First violation of a limit, or first collision, of one motion."""

    words: str
    at: float
    cycle: int
    origin: Array


@dataclass(frozen=True, eq=False)
@read_only
class Arm:
    """One arm of the page, and its motion.

    Attributes
    ----------
    label : str
        Title of its pane: ``J⁺``.
    shapes : tuple of Shape
        Visual shapes.
    placements : (T, S, 4, 4) array
        Rigid, unscaled transform of each shape.
    tip, elbow : (T, K, 3) arrays
        Traced points of K chains, m.
    q : (T, n) array
        Configurations, whose distance from cycle 1 is the drift.
    cycle_drift : (cycles,) array
        ‖q − q₀‖ after each cycle of the whole motion, rad.
    color : str
        Colour of the label and the traces, ``#RRGGBB``.
    unit : str
        Unit of the drift.
    joint_names : tuple of str
        Names of the joints of q; () numbers them.
    limits : (2, n) array or None
        Lower and upper limits of q; infinite where there is none.
    broken : Violation or None
        First violated joint limit, or first collision.
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
    broken: Violation | None = None


def choose_frames(samples: int, cycles: int, *, per_cycle: int = 61, shown: int = 24) -> Frames:
    """Choose the samples to show of a motion of ``samples`` = cycles · steps + 1 configurations.

    Of many cycles, the first is shown, and every k-th one back from the last.

    Parameters
    ----------
    samples, cycles
        Number of samples and cycles of the motion; each cycle has the same number of steps.
    per_cycle
        Maximum number of samples per cycle.
    shown
        Maximum number of cycles.
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
    paths: Sequence[Array],
    *,
    frames: Frames,
    seconds: float,
    title: str,
    caption: str,
    planar: bool = False,
    verdict: Verdict = NO_VERDICT,
    live: bool = False,
) -> str:
    """Write one self-contained HTML page with one pane per arm, which loops through their cycles.

    Parameters
    ----------
    arms
        Two, or any number.
    paths : sequence of (P, 3) arrays
        The paths that the tips follow, closed or not, m.
    frames
        Which samples of their motions the arms hold.
    seconds
        Time of one cycle at normal speed.
    title, caption
        Robot and task, in words; any text. Lines of the caption are kept.
    planar
        Look from above, as at a drawing.
    verdict
        What stands above it all.
    live
        The poses come from a :class:`~repctl_pin.show.page.viewer.Viewer`; what the arms hold is
        where they may be.

    Returns
    -------
    The page's HTML.
    """
    commands, library, problems = record(shape for arm in arms for shape in arm.shapes)
    parts: list[Array] = []
    pair = _liveliest([arm.q for arm in arms], frames)
    described = [_describe(arm, frames, library, pair, parts) for arm in arms]
    scene = {
        "title": title,
        "caption": caption,
        "planar": bool(planar),
        "live": live,
        "seconds": float(seconds),
        "cycles": list(frames.cycles),
        "perCycle": frames.per_cycle,
        "paths": [len(path) for path in paths],
        "problems": problems,
        "pair": None if pair is None else _pair(arms[0], pair),
        "arms": described,
    }
    motion = np.concatenate([p.ravel() for p in [*parts, *paths]]).astype("<f4").tobytes()
    return page(scene, commands, motion, verdict)


def _from_first(q: Array, frames: Frames) -> Array:
    """Subtract the configuration at the same phase of cycle 1: (T, n)."""
    cycles = q.reshape(len(frames.cycles), frames.per_cycle, -1)
    return (cycles - cycles[0]).reshape(q.shape)


def _liveliest(every: Sequence[Array], frames: Frames) -> tuple[int, int] | None:
    """Choose the two joints that drift most, or that move most where none drifts; None with fewer
    than two joints."""
    if every[0].shape[1] < 2:
        return None
    most = np.max([np.abs(_from_first(q, frames)).max(axis=0) for q in every], axis=0)
    if most.max() < 1e-4:
        most = np.max([np.ptp(q, axis=0) for q in every], axis=0)
    i, j = sorted(np.argsort(-most, kind="stable")[:2].tolist())
    return i, j


def _pair(arm: Arm, pair: tuple[int, int]) -> dict[str, Any]:
    """Collect names and limits of two joints."""
    ends = np.full((2, max(pair) + 1), np.nan) if arm.limits is None else arm.limits
    return {
        "names": [arm.joint_names[k] if arm.joint_names else f"joint {k + 1}" for k in pair],
        "limits": [[float(v) if np.isfinite(v) else None for v in ends[:, k]] for k in pair],
    }


def _describe(
    arm: Arm,
    frames: Frames,
    library: dict[Key, int],
    pair: tuple[int, int] | None,
    parts: list[Array],
) -> dict[str, Any]:
    """Describe an arm in plain types; arrays that change with time are appended to ``parts``.

    Bodies (T, M, 7), tips and elbows (T, K, 3), distance from cycle 1 (T,), two joints (T, 2), the
    broken joint (T, 3)."""
    # to 0.1 µm, so that a pose that returns is the same number again
    poses = np.round(poses_of(arm.placements), 7)  # (T, S, 7)
    moving = moving_of(arm.placements)
    parts += [
        poses[:, moving],
        arm.tip,
        arm.elbow,
        np.linalg.norm(_from_first(arm.q, frames), axis=1),
    ]
    parts += [] if pair is None else [arm.q[:, pair]]
    parts += [] if arm.broken is None else [arm.broken.origin]
    shapes = [
        {
            "name": shape.name,
            "body": library.get(key(shape)),
            "scale": [float(s) for s in shape.scale],
            "color": None
            if shape.textured
            else [*lifted(shape.color[:3]).tolist(), float(shape.color[3])],
            "pose": None if moving[k] else poses[0, k].tolist(),
            "standing": shape.standing,
        }
        for k, shape in enumerate(arm.shapes)
    ]
    broken = arm.broken and {
        "words": arm.broken.words,
        "at": float(arm.broken.at),
        "cycle": arm.broken.cycle,
    }
    return {
        **picked(arm, "label", "color", "unit"),
        "drift": arm.cycle_drift.tolist(),
        "chains": arm.tip.shape[1],
        "pair": pair is not None,
        "broken": broken,
        "shapes": shapes,
    }


def moving_of(placements: Array) -> NDArray[np.bool_]:
    """Find the shapes that move: (S,)."""
    return (
        np.ptp(placements, axis=0).reshape(placements.shape[1], -1).max(axis=1, initial=0.0) > 1e-12
    )


def poses_of(placements: Array) -> Array:
    """Convert rigid transforms (T, S, 4, 4) to positions and unit quaternions (T, S, 7): x y z, qx
    qy qz qw.

    Of the two quaternions of each rotation, the one nearer to the frame before.
    """
    R, p = placements[..., :3, :3], placements[..., :3, 3]
    q = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat().reshape(*R.shape[:-2], 4)
    flips = np.einsum("tsi,tsi->ts", q[1:], q[:-1]) < 0
    q[1:][np.logical_xor.accumulate(flips, axis=0)] *= -1
    return np.concatenate([p, q], -1)
