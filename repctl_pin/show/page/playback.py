"""Motions of a whole robot as they are drawn; from the files that ``study`` and ``follow`` write, too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ...errors import InputError
from ...motion.csv_file import read_motions
from ...motion.motion import COARSE, cycle_of
from ...robot.bodies import bodies_of
from ...robot.model import frame_id
from ...robot.task import unit_of
from ...robot.visuals import Visuals
from ...strategies.names import LABELS
from ..palette import BLUE, COLOURS, GREEN, ORANGE, PURPLE, SKY, VERMILLION
from ..text.verdict import Deed, Verdict, verdict
from .scene import Arm, Broken, Frames, animation_page, choose_frames

if TYPE_CHECKING:
    from ...motion import Motion
    from ...robot.robot import Robot
    from ...robot.task import Task

Array = NDArray[np.float64]

_OTHERS = (VERMILLION, BLUE, GREEN, PURPLE, ORANGE, SKY)


@dataclass(frozen=True)
class Track:
    """One motion of a whole robot.

    Attributes
    ----------
    label, color : str
        What is written above it, and its ``#RRGGBB``.
    Q : (T + 1, nq) array
        Configurations of the whole robot, rad or m; T = cycles · steps.
    cycles : int
        How often round.
    drift : (cycles,) array
        ‖q − q₀‖ after each cycle.
    unit : str
        Of the drift.
    """

    label: str
    color: str
    Q: Array
    cycles: int
    drift: Array
    unit: str = "rad"


@dataclass(frozen=True)
class Limb:
    """What of a robot leaves its traces.

    Attributes
    ----------
    task : Task
        Whose frame is traced.
    elbow : int
        The joint whose origin is traced, of the task's.
    """

    task: Task
    elbow: int


def track_of(label: str, motion: Motion, color: str) -> Track:
    """Take a motion as it is."""
    return Track(label, color, motion.task.full(motion.q), motion.cycles, motion.drift, motion.task.unit)


def read_tracks(file: str | Path, robot: Robot, *, cycles: int | None = None) -> list[Track]:
    """Read motions from a CSV file, one for each strategy in it; joints without a column stay at the reference pose.

    Parameters
    ----------
    file
        The file, see :func:`repctl_pin.motion.csv_file.read_motions`.
    robot
        Whose joints they are.
    cycles
        Number of cycles, where the file does not say; 1 if None.

    Raises
    ------
    InputError
        If the file cannot be used.
    """
    turns = {joint.name: joint.kind != "prismatic" for joint in robot.description.joints}
    tracks = []
    for k, found in enumerate(read_motions(file, robot.joint_names, cycles=cycles)):
        Q = np.tile(robot.reference, (len(found.q), 1))
        Q[:, [robot.joint_names.index(name) for name in found.joints]] = found.q
        steps = (len(found.q) - 1) // found.cycles
        drift = np.linalg.norm(found.q[steps::steps] - found.q[0], axis=1)
        color = COLOURS.get(found.strategy, _OTHERS[k % len(_OTHERS)])
        label, unit = LABELS.get(found.strategy, found.strategy), unit_of(turns[name] for name in found.joints)
        tracks.append(Track(label, color, Q, found.cycles, drift, unit))
    return tracks


def tracks_page(
    limbs: Sequence[Limb],
    tracks: Sequence[Track],
    *,
    paths: Sequence[Array] | None = None,
    name: str = "motion",
    summary: Verdict | None = None,
    seconds: float = 4.0,
) -> str:
    """Make the page of some motions, side by side.

    Parameters
    ----------
    limbs
        What leaves traces: one limb of the robot, or several.
    tracks
        What to show: all of as many cycles.
    paths : sequence of (P, 3) arrays, optional
        The paths to draw, m; by default what the first motion's frames do in its first cycle.
    name
        Of the path.
    summary
        The verdict on them; by default that of these motions, the last beside the first.
    seconds
        Time of a cycle at normal speed.
    """
    sizes = {(track.cycles, len(track.Q)) for track in tracks}
    if len(sizes) != 1:
        raise InputError("motions can be shown side by side only if all have as many cycles and steps")
    ((cycles, samples),) = sizes
    visuals, frames = Visuals.of(limbs[0].task.robot), choose_frames(samples, cycles)
    arms = [_arm(limbs, track, visuals, frames) for track in tracks]
    lines = list(arms[0].tip[: frames.per_cycle].swapaxes(0, 1)) if paths is None else list(paths)
    return animation_page(
        arms,
        lines,
        seconds=seconds,
        title=f"{limbs[0].task.robot.name}: {name}",
        caption="\n".join(_limb_words(limb.task) for limb in limbs),
        planar=_is_planar(limbs, [track.Q[0] for track in tracks], lines),
        frames=frames,
        verdict=summary or verdict([_deed(limbs, track) for track in tracks], cycles),
    )


def _arm(limbs: Sequence[Limb], track: Track, visuals: Visuals, frames: Frames) -> Arm:
    """What of a motion goes onto the page."""
    robot, rows = limbs[0].task.robot, track.Q[frames.index]
    tip, elbow = (np.stack(points, axis=1) for points in zip(*(_ways(limb, rows) for limb in limbs), strict=True))
    return Arm(
        track.label,
        visuals.shapes,
        visuals.placements(rows),
        tip,
        elbow,
        rows,
        track.drift,
        track.color,
        unit=track.unit,
        joint_names=robot.joint_names,
        limits=np.stack([robot.lower, robot.upper]),
        broken=_broken(limbs, track, rows),
    )


def _broken(limbs: Sequence[Limb], track: Track, rows: Array) -> Broken | None:
    """Where a motion first goes beyond what the arm can do: out of a joint's limits, or into a body."""
    found, touch = _violation(limbs, track), _bodies(limbs, track)[1]
    if touch is not None and (found is None or touch[0] < found[0]):
        at, links = touch
        robot = limbs[0].task.robot
        link = next(name for name in links if name in robot.description.links)
        data, frame = robot.model.createData(), frame_id(robot.model, link)
        origin = np.array([_frame_origin(robot.model, data, q, frame) for q in robot.coupling.joints(rows)])
        words = f"{' and '.join(links)} have touched"
    elif found is not None:
        at, task, joint = found
        origin = np.array([task.joint_origins(task.part(q))[joint] for q in rows])
        words = f"{task.robot_joints[joint]} past its limit"
    else:
        return None
    return Broken(words, at, cycle_of(at, track.cycles), origin)


def _frame_origin(model: pin.Model, data: pin.Data, q: Array, frame: int) -> Array:
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[frame].translation.copy()


def _bodies(limbs: Sequence[Limb], track: Track) -> tuple[float, tuple[float, tuple[str, str]] | None]:
    """How near bodies come at 100 points a cycle, and when which first touch; of a robot of one limb."""
    if len(limbs) > 1:
        return np.inf, None
    task, last = limbs[0].task, len(track.Q) - 1
    rows = np.unique(np.rint(np.linspace(0, last, COARSE * track.cycles + 1)).astype(int))
    bodies, Q = bodies_of(task), task.part(track.Q[rows])
    distances = bodies.distances(Q)
    if not (distances < 0).any():
        return float(distances.min()), None
    first = int(np.argmax(distances < 0))
    return float(distances.min()), (rows[first] * track.cycles / last, bodies.nearest(Q[first]).links)


def _violation(limbs: Sequence[Limb], track: Track) -> tuple[float, Task, int] | None:
    """The first time that a joint of a limb leaves its limits: cycle in fractions, whose task, which joint."""
    robot, found = limbs[0].task.robot, []
    outside = np.minimum(track.Q - robot.lower, robot.upper - track.Q) < -1e-9  # (T + 1, nq)
    for limb in limbs:
        own = outside[:, [robot.joint_names.index(name) for name in limb.task.robot_joints]]
        if own.any():
            row = int(np.argmax(own.any(axis=1)))
            found.append((row * track.cycles / (len(track.Q) - 1), limb.task, int(np.argmax(own[row]))))
    return min(found, key=lambda one: one[0], default=None)


def _deed(limbs: Sequence[Limb], track: Track) -> Deed:
    """What the verdict speaks of; of several limbs, the elbow that drifts most."""
    ends = [_ways(limb, track.Q[[0, -1]])[1] for limb in limbs]
    steps, found = (len(track.Q) - 1) // track.cycles, _violation(limbs, track)
    apart, touch = _bodies(limbs, track)
    return Deed(
        track.label,
        max(float(np.linalg.norm(b - a)) for a, b in ends),
        float(np.sqrt(np.mean(np.sum(np.diff(track.Q[: steps + 1], axis=0) ** 2, axis=1)))),
        None if found is None else (cycle_of(found[0], track.cycles), found[1].robot_joints[found[2]]),
        apart if np.isfinite(apart) else None,
        0 if touch is None else cycle_of(touch[0], track.cycles),
    )


def _ways(limb: Limb, rows: Array) -> tuple[Array, Array]:
    """The ways of frame and elbow, (T, 3) each."""
    part = np.array([limb.task.part(q) for q in rows])
    return limb.task.positions(part), np.array([limb.task.joint_origins(q)[limb.elbow] for q in part])


def _limb_words(task: Task) -> str:
    return f"{task.frame}, {task.kind} task, n = {task.n}, r = {task.r}"


def _is_planar(limbs: Sequence[Limb], starts: Sequence[Array], paths: Sequence[Array]) -> bool:
    """Whether all joints and paths lie in one level plane: then the page looks from above."""
    joints = [limb.task.joint_origins(limb.task.part(q)) for limb in limbs for q in starts]
    return bool(np.ptp(np.vstack([*joints, *paths]), axis=0)[2] < 1e-9)
