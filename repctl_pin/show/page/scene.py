"""Scene of the animation page: arms side by side, each with traces of its cycles.

A pane is the part of the page that shows one arm. A shape is a body of the arm as it is drawn. A
sample is a moment at which a configuration of the motion is known. The page shows some of the
samples, and interpolates between them. The tip is the frame of the task. A chain consists of the
joints that move one frame; its elbow joint is the joint in the middle that moves most in
self-motions. A potential is a function of the joints that a repeatable controller holds constant.
Letters: T shown samples, S shapes, K chains, P points of a path or a shape, nq joints of the whole
robot.

``Frames`` are the samples of a motion that the page shows. ``Arm`` is the arm in one pane of the
page, and its motion under one controller. ``Dialog`` is the texts of a page's dialog, by name.
``JointRows`` is the joint positions of every arm over the shown cycles. ``Surfaces`` are the
triangle meshes of mesh files by path, with the error instead if a file is unreadable. ``Headline``
is a sentence on the drift, and notes on joint speed, limits and bodies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import Array, read_only
from ...base.errors import InputError
from ...model.rotations import matrix_quaternions
from ...model.shapes import Shape
from ...model.surfaces import Surfaces
from ...model.task import Task
from ...studies.quantities import KEYS
from ...studies.study_result import picked
from ..palette import VERMILLION
from ..text.headline import NO_HEADLINE, Headline, names_of
from .html import Dialog, page
from .meshes import Key, key, lifted, record

_PER_CYCLE = (61, 126, 251, 501)
"""Maximum numbers of samples per cycle that are tried one after the other."""

_CORNER = 128e-7
"""Resolution of a corner, m: 128 times that of a pose, so that its lowest byte is 0."""

_JOINT = 1e-3
"""Scale by which joint values are stored, so that the page's resolution is 1e-4 rad or m."""

_JOINT_ROWS = 61
"""Maximum number of samples of the joints per cycle."""

_SHOWN = 24
"""Maximum number of cycles that are shown."""

_CLOSE = 2e-4
"""Error of a joint drawn between two samples, rad or m, that the page allows."""


@dataclass(frozen=True, eq=False)
@read_only
class Frames:
    """The samples of a motion that the page shows.

    Attributes
    ----------
    index : (T,) array of int
        Indices of the shown samples among all samples of the motion, cycle by cycle. Each cycle
        includes its first and its last sample: T = len(cycles) * per_cycle.
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
class FirstViolation:
    """First violation of a limit, or first collision, of one motion, which the page marks.

    Attributes
    ----------
    words : str
        Description, such as ``joint4 past its limit``.
    at : float
        Time in cycles: 1.25 is a quarter into the second cycle.
    cycle : int
        Number of the cycle, from 1.
    origin : (T, 3) array
        Origin of the joint's child link, or of one of the colliding links, at the T shown samples,
        m, relative to the robot's root link.
    """

    words: str
    at: float
    cycle: int
    origin: Array


@dataclass(frozen=True, eq=False)
@read_only
class Arm:
    """Arm in one pane of the page, and its motion under one controller.

    The arrays hold the T samples of the motion that the page shows.

    Attributes
    ----------
    label : str
        Name of the controller, such as ``J⁺``.
    shapes : tuple of S Shape
        All shapes to draw: those of the robot and of its surroundings.
    placements : (T, S, 4, 4) array
        Rigid, unscaled transforms of the shapes, m, relative to the robot's root link; in the live
        viewer, these and all positions are relative to the base of the task.
    tip, elbow : (T, K, 3) arrays
        Positions, m, relative to the root link, of the frame and the elbow joint of each of K
        chains, one per frame of the task.
    cycle_drift : (cycles,) array
        ‖q − q₀‖ after each cycle of the whole motion, in ``unit``.
    points : tuple of S (P, 3) arrays
        Some corners of each shape in its own frame, m, by which its displacement is measured.
    off : (T, S) array
        Displacement of each shape from its placement at the same moment of cycle 1, m; 0 for shapes
        that the chains do not move.
    color : str
        Colour of the label and the traces, ``#RRGGBB``.
    unit : str
        Unit of the drift.
    broken : FirstViolation or None
        First violated joint limit, or first collision.
    carried : (T, 4, 4) array or None
        Rigid transforms from the base's placement at the start to that at each sample, in the
        frame of the root link, m, if the base is a workpiece that other joints move. The drawn
        paths move with it. None if the base does not move.
    """

    label: str
    shapes: tuple[Shape, ...]
    placements: Array
    tip: Array
    elbow: Array
    cycle_drift: Array
    points: tuple[Array, ...]
    off: Array
    color: str = VERMILLION
    unit: str = "rad"
    broken: FirstViolation | None = None
    carried: Array | None = None


def choose_frames(samples: int, cycles: int, *, per_cycle: int = 61) -> Frames:
    """Choose the samples to show of a motion that has ``samples`` = cycles · steps + 1 samples.

    A page with all samples would be too large. If there are more than 24 cycles, only the first,
    the last, and every k-th cycle before the last are shown. Within a cycle, the number of samples
    is at least half of ``per_cycle``, if there are enough steps. The samples are spaced as evenly
    as whole steps allow.

    Parameters
    ----------
    samples, cycles
        Number of samples and cycles of the motion; each cycle has the same number of steps.
    per_cycle
        Maximum number of samples per cycle.
    """
    steps, rest = divmod(samples - 1, cycles)
    if rest or steps < 1:
        raise InputError(
            f"{samples} samples cannot be divided into {cycles} cycles of equal steps; "
            f"give 1 + {cycles} k samples, with a whole number k of steps per cycle"
        )
    stride = -(-(cycles - 1) // (_SHOWN - 1)) or 1
    numbers = np.unique(np.r_[1, np.arange(cycles, 0, -stride)])
    most = min(per_cycle - 1, steps)
    even = max(k for k in range(1, most + 1) if steps % k == 0)
    count = even if 2 * even >= most else most  # times between the samples are the same
    inside = np.round(np.linspace(0, steps, count + 1)).astype(int)  # (F,)
    index = ((numbers - 1)[:, None] * steps + inside).ravel()
    return Frames(index, tuple(numbers.tolist()), len(inside))


@dataclass(frozen=True, eq=False)
@read_only
class JointRows:
    """Joint positions of every arm over the shown cycles, for the page's plot over time.

    Attributes
    ----------
    task : Task
        Task to which the joints belong.
    rows : tuple of (C · F, n) arrays
        Joint positions of each arm, rad or m, at F samples of each of the C shown cycles.
    at : (F,) array
        Times of the F samples of a cycle, both ends included, as fractions of the cycle.
    """

    task: Task
    rows: tuple[Array, ...]
    at: Array

    @staticmethod
    def of(task: Task, shown: Sequence[Array], frames: Frames) -> JointRows:
        """Select the rows to plot, evenly spaced in each shown cycle, from the samples of each arm.

        ``shown`` has an array (T, nq) per arm, the robot's configurations at the samples of
        ``frames``.
        """
        count = min(_JOINT_ROWS, frames.per_cycle)
        within = np.rint(np.linspace(0, frames.per_cycle - 1, count)).astype(int)
        index = (np.arange(len(frames.cycles))[:, None] * frames.per_cycle + within).ravel()
        rows = tuple(np.ascontiguousarray(task.from_robot(Q[index])) for Q in shown)
        at = frames.index[within] / frames.index[frames.per_cycle - 1]
        return JointRows(task, rows, at)

    def described(self) -> dict[str, Any]:
        """Describe the joints, without the rows, in plain types for JSON.

        ``names``, ``lower``, ``upper`` (None for no limit) and ``turns`` (True if revolute) have
        one entry per joint. ``perCycle`` is the number of samples per cycle, and ``at`` are their
        times, as fractions of the cycle. ``scale`` is 0.001: the page holds the rows multiplied by
        ``scale``, and its script divides them by ``scale``.
        """
        lower, upper = self.task.lower, self.task.upper
        return {
            "names": list(self.task.joint_names),
            "lower": [float(v) if np.isfinite(v) else None for v in lower],
            "upper": [float(v) if np.isfinite(v) else None for v in upper],
            "turns": self.task.revolute.tolist(),
            "perCycle": len(self.at),
            "at": np.round(self.at, 6).tolist(),
            "scale": _JOINT,
        }


def frames_for(motions: Sequence[Array], cycles: int) -> Frames:
    """Choose the samples that the page shows of several motions of one robot.

    The page draws a cubic through neighbouring samples. The number of samples per cycle is
    increased, to 501 at most, until the cubic is within 0.0002 rad or m of every motion, or all
    samples of a cycle are shown.

    Parameters
    ----------
    motions : sequence of (samples, nq) arrays
        Configurations of the whole robot, all nq joints, rad or m.
    cycles
        Number of cycles of each motion.

    Returns
    -------
    Frames
        Indices of the shown samples, the same for all motions.
    """
    samples = len(motions[0])
    steps = (samples - 1) // cycles
    for most in _PER_CYCLE:
        frames = choose_frames(samples, cycles, per_cycle=most)
        if most > steps or all(_missed(Q, frames) <= _CLOSE for Q in motions):
            break
    return frames


def _missed(Q: Array, frames: Frames) -> float:
    """Evaluate the largest error, rad or m, of the cubics that the page draws between samples.

    The error is evaluated half-way between neighbouring samples of ``frames``. ``Q`` (samples, nq)
    has all configurations of the robot in the motion.
    """
    index = frames.index.reshape(-1, frames.per_cycle)
    if index.shape[1] < 4:
        return 0.0
    left, right = index[:, 1:-2], index[:, 2:-1]
    middle = (left + right) // 2
    f = ((middle - left) / np.maximum(right - left, 1))[..., None]
    a, b = (-f + 2 * f**2 - f**3) / 2, (2 - 5 * f**2 + 3 * f**3) / 2
    c, d = (f + 4 * f**2 - 3 * f**3) / 2, (f**3 - f**2) / 2
    drawn = a * Q[index[:, :-3]] + b * Q[left] + c * Q[right] + d * Q[index[:, 3:]]
    return float(np.abs(drawn - Q[middle]).max())


def animation_page(
    arms: Sequence[Arm],
    paths: Sequence[Array],
    *,
    frames: Frames,
    surfaces: Surfaces,
    seconds: float,
    title: str,
    caption: str,
    part: tuple[str, str],
    planar: bool = False,
    headline: Headline = NO_HEADLINE,
    live: bool = False,
    names: Mapping[str, str] | None = None,
    own: dict[str, Any] | None = None,
    hands: Sequence[str] = ("hand",),
    joints: JointRows | None = None,
    dialog: Dialog | None = None,
    cover: dict[str, Any] | None = None,
) -> str:
    """Make a self-contained HTML page with one pane per arm: an animation, or the live viewer.

    An animation repeats the shown cycles.

    Parameters
    ----------
    arms
        The arms, one per pane.
    paths : sequence of (P, 3) arrays
        The paths that the tips follow, closed or not, m, relative to the root link or, in the live
        viewer, to the base of the task.
    frames
        Samples of the motions to which the arrays of the arms belong.
    surfaces
        Contents of the arms' mesh files.
    seconds
        Duration of one cycle at normal speed, s.
    title, caption
        Texts that name the robot and the task. Line breaks of the caption are kept.
    part : (str, str)
        Link and display name of the part that the page marks, usually the most displaced one.
    planar
        True to show the arms from above, as in a drawing.
    headline
        Headline above the panes.
    live
        True if a :class:`~repctl_pin.show.page.viewer.Viewer` sends the configurations; those of
        the arms then only serve to find the shapes that move.
    names
        Display name of the part of the arm to which a shape belongs, in a dictionary by the name of
        the shape; used if ``live``.
    own
        Numbers with which the page follows a closed path that its visitor draws: start, joints and
        potentials; None if the visitor cannot draw a path. Its array ``weights``, one row with all
        coefficients of a cell's function, is packed with the motion.
    hands
        Display names of the traced frames.
    joints
        Joint positions for a plot over time; None for no plot.
    dialog
        Texts of the page's dialog; by default those of a study.
    cover
        Numbers of a surface around the positions of a cell, a box of poses, by the keys that
        ``cover.js`` reads. The page draws this surface in a pale colour; the first of ``paths``
        must then be a line along all edges of the cell. None for no surface.

    Returns
    -------
    The page's HTML.
    """
    shapes = [shape for arm in arms for shape in arm.shapes]
    commands, library, problems = record(shapes, surfaces)
    parts: list[Array] = []
    link, name = part
    # the page compares arms body by body: what moves in one motion moves in all
    rides = np.array([bool(own and on and on[0] >= 0) for on in _links(own, arms[0])])
    rides = rides | np.any([moving_of(arm.placements) for arm in arms], axis=0)
    described = [_describe(arm, frames, library, link, rides, parts) for arm in arms]
    # a page's own law may have numbers that are packed with the motion
    weights = np.zeros((1, 0))
    if own and "weights" in own:
        own = dict(own)
        weights = own.pop("weights")
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
        "part": name,
        "names": dict(names or {}),
        "arms": described,
        "own": own,
        "weights": weights.size,
        "hands": list(hands),
        "cover": cover,
        "joints": None if joints is None else joints.described(),
    }
    packed = [weights] if weights.size else []
    motion = [
        np.reshape(p, (len(p), np.size(p) // max(1, len(p)))) for p in [*parts, *packed, *paths]
    ]
    motion += [] if joints is None else [rows * _JOINT for rows in joints.rows]
    return page(scene, commands, motion, headline, dialog)


def _links(own: dict[str, Any] | None, arm: Arm) -> list[Any]:
    """List, for each shape, [index of the joint that carries its link, display name of its part].

    The index is among the joints of ``own``, and is −1 for a link fixed to the root. A shape of the
    surroundings has None instead of a list. ``own`` are the numbers by which the page follows a
    visitor's own path; if it is None, all entries are None.
    """
    return [None] * len(arm.shapes) if own is None else own["links"]


def _describe(
    arm: Arm,
    frames: Frames,
    library: dict[Key, int],
    link: str,
    rides: NDArray[np.bool_],
    parts: list[Array],
) -> dict[str, Any]:
    """Describe an arm in plain types for the page's script, and append its arrays to ``parts``.

    ``frames`` are the samples of its motion, ``library`` has the number of each body in the
    viewer's library by its :data:`~.meshes.Key`, and ``link`` is the link of the part that the page
    marks, usually the most displaced one. ``rides`` (S,) is True for those of the S shapes that can
    move, even if they do not move in this motion. The keys of the result are the names by which the
    script reads them, such as ``label``, ``drift`` (joint drift, one number per cycle) and
    ``shapes`` (a list of dictionaries).

    The first appended array has the poses of the M moving shapes (T, M, 7), then the pose of the
    workpiece if it moves. A pose is x, y, z, qx, qy, qz, qw. Tips and elbows (T, K, 3) of K chains
    follow, then, if a limit is violated or bodies collide, the origin (T, 3) of the link that is
    marked for it. Last comes an array for each moving shape: its points (P, 3), as one row.
    """
    # to 0.1 µm, so that a pose that returns is the same number again
    poses = np.round(poses_of(arm.placements), 7)  # (T, S, 7)
    moving = moving_of(arm.placements) | rides
    moved = poses[:, moving]
    if arm.carried is not None:
        moved = np.concatenate([moved, np.round(poses_of(arm.carried[:, None]), 7)], axis=1)
    parts += [moved, arm.tip, arm.elbow]
    parts += [] if arm.broken is None else [arm.broken.origin]
    parts += [
        # one row: points have no order whose differences were small
        np.rint(points / _CORNER).reshape(1, -1) * _CORNER
        for points, moves in zip(arm.points, moving, strict=True)
        if moves
    ]
    rows = np.arange(len(frames.cycles))[:, None] * frames.per_cycle + [0, frames.per_cycle - 1]
    off = arm.off.max(axis=1, initial=0.0)[rows]  # (cycles shown, 2): at start and end
    shapes = [
        {
            "name": shape.name,
            "body": library.get(key(shape)),
            "scale": [float(s) for s in shape.scale],
            "color": None
            if shape.color is None
            else [*lifted(shape.color[:3]).tolist(), float(shape.color[3])],
            "pose": None if moving[k] else poses[0, k].tolist(),
            "standing": shape.standing,
            "points": len(arm.points[k]),
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
        "strategy": KEYS.get(arm.label, arm.label),
        **names_of(arm.label),
        "drift": arm.cycle_drift.tolist(),
        "off": off.tolist(),
        "part": [shape.link == link for shape in arm.shapes],
        "chains": arm.tip.shape[1],
        "carried": arm.carried is not None,
        "broken": broken,
        "shapes": shapes,
    }


def is_planar(points: Array) -> bool:
    """Test whether points (K, 3), m, of a robot and its path lie in one horizontal plane."""
    return bool(np.ptp(points[:, 2]) < 1e-9)


def moving_of(placements: Array) -> NDArray[np.bool_]:
    """Find which of S shapes move, from placements (T, S, 4, 4) at T samples: (S,), True if so."""
    return (
        np.ptp(placements, axis=0).reshape(placements.shape[1], -1).max(axis=1, initial=0.0) > 1e-12
    )


def poses_of(placements: Array) -> Array:
    """Convert rigid transforms (T, S, 4, 4) to positions and unit quaternions (T, S, 7).

    The order is x, y, z, qx, qy, qz, qw. The quaternions ±q describe the same rotation; the one
    nearer to that of the previous sample is used, so that the page can interpolate.
    """
    R, p = placements[..., :3, :3], placements[..., :3, 3]
    q = matrix_quaternions(R.reshape(-1, 3, 3)).reshape(*R.shape[:-2], 4)
    flips = np.einsum("tsi,tsi->ts", q[1:], q[:-1]) < 0
    q[1:][np.logical_xor.accumulate(flips, axis=0)] *= -1
    return np.concatenate([p, q], -1)
