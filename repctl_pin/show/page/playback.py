"""Motions of a whole robot for animation, from results or CSV files.

A playback, or track, is one motion of all joints of the robot, as the page shows it. A traced chain
consists of the joints that move one frame; the page draws traces of that frame and of the chain's
elbow, the joint in the middle of the arm that moves most during self-motion. The reference pose is
the default configuration of a robot, from its SRDF or else mid-range. A potential is a function of
the joints that a repeatable controller holds constant. Letters: P points of a path, n joints of a
task, nq joints of the whole robot.

``TracedChain`` is a kinematic chain whose frame and elbow leave traces. ``Playback`` is one motion
of a whole robot, as the page plays it: label, configurations, times. ``Dialog`` is the texts of a
page's dialog, by name. ``Kind`` is the kind of a task, such as ``pose``, with the coordinates that
it commands. ``Visuals`` are the shapes to draw of a robot and its surroundings. ``Frames`` are the
samples of a motion that the page shows. ``JointMotion`` is a joint motion over several cycles: q,
q̇ (T, n) at times t, without the path of the frame. ``Arm`` is the arm in one pane of the page, and
its motion under one controller. ``FirstViolation`` is the first violation of a limit or the first
collision, which the page marks. ``MotionSummary`` is the quantities of one motion that headlines
and short tables report. ``Headline`` is a sentence on the drift, and notes on joint speed, limits
and bodies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from ...base.arguments import Array, read_only
from ...base.errors import InputError
from ...model.arm_links import arm_links, link_origins
from ...model.base_motion import base_moves, base_placements, on_base
from ...model.kind import Kind
from ...model.robot import Robot
from ...model.several_frames import SeveralFrames
from ...model.surfaces import read_surfaces
from ...model.task import Task, unit_of
from ...model.visuals import Visuals
from ...motion import Motion, elbow
from ...motion.body_displacement import farthest
from ...motion.csv_file import read_motions
from ...motion.joint_motion import JointMotion, cycle_of
from ...paths.winding import winding
from ...studies.quantities import LABELS
from ..palette import BLUE, COLOURS, GREEN, ORANGE, PURPLE, SKY, VERMILLION
from ..text.headline import Headline, headline_of
from ..text.motion_summary import MotionSummary, in_cycle, motion_summary, with_outlook
from ..text.part_names import hand_names, part_name
from .body_points import body_drift
from .html import Dialog
from .scene import (
    Arm,
    FirstViolation,
    Frames,
    JointRows,
    animation_page,
    frames_for,
    is_planar,
    moving_of,
)

_OTHERS = (VERMILLION, BLUE, GREEN, PURPLE, ORANGE, SKY)


@dataclass(frozen=True, eq=False)
@read_only
class Playback:
    """One motion of a whole robot, as the animation page plays it in one pane.

    Attributes
    ----------
    label, color : str
        Title of the pane, and colour as ``#RRGGBB``.
    Q : (T + 1, nq) array
        Configurations of the whole robot, all nq joints, rad or m; T is the number of steps.
    cycles : int
        Number of cycles.
    drift : (cycles,) array
        ‖q − q₀‖ after each cycle, in ``unit``.
    unit : str
        Unit of the drift, such as ``rad``.
    t : (T + 1,) array or None
        Times of the configurations, s; None if unknown.
    motion : JointMotion or None
        The motion of the task's joints; None for a motion read from a file.
    """

    label: str
    color: str
    Q: Array
    cycles: int
    drift: Array
    unit: str = "rad"
    t: Array | None = None
    motion: JointMotion | None = None


@dataclass(frozen=True)
class TracedChain:
    """Kinematic chain (the joints that move a frame) whose frame and elbow leave traces.

    Attributes
    ----------
    task : Task
        Task whose frame is traced.
    elbow : int
        Index, among the task's joints, of the elbow joint, whose origin is traced.
    """

    task: Task
    elbow: int


def traced_chains(task: Task, q0: Array) -> list[TracedChain]:
    """List the traced chains of a task, one per frame.

    The elbow of a chain is the joint in the middle of the arm that moves most in self-motions from
    q0 (n,).
    """
    if not isinstance(task, SeveralFrames):
        return [TracedChain(task, elbow(task, q0))]
    whole = task.to_robot(q0)
    robot = cast(Robot, task.robot)
    singles = [robot.task(spec.frame, spec.kind) for spec in task.specs]
    return [TracedChain(one, elbow(one, one.from_robot(whole))) for one in singles]


def playback_of(label: str, motion: Motion, color: str) -> Playback:
    """Convert a motion of a task's joints to the playback of the whole robot.

    Other joints stay at the reference pose. ``label`` is the title of the pane, ``color`` is
    ``#RRGGBB``.
    """
    task, Q = motion.task, motion.task.to_robot(motion.q)
    return Playback(label, color, Q, motion.cycles, motion.drift, task.unit, motion.t, motion)


def read_playbacks(file: str | Path, robot: Robot, *, cycles: int | None = None) -> list[Playback]:
    """Read the motions of a robot from a CSV file, one per distinct entry in column ``strategy``.

    A strategy is a controller, such as the pseudoinverse J⁺. A file without this column has one
    motion. Joints without a column stay at the reference pose.

    Parameters
    ----------
    file
        CSV file with a column per joint, rad or m.
    robot
        The robot that moves.
    cycles
        Number of cycles in the file; by default the last value of its column ``cycle``, else 1.

    Raises
    ------
    InputError
        If the file cannot be read as motions of this robot.
    """
    turns = {joint.name: joint.kind != "prismatic" for joint in robot.description.joints}
    tracks = []
    for k, found in enumerate(read_motions(file, robot.joint_names, cycles=cycles)):
        Q = np.tile(robot.reference, (len(found.q), 1))
        Q[:, [robot.joint_names.index(name) for name in found.joints]] = found.q
        steps = (len(found.q) - 1) // found.cycles
        drift = np.linalg.norm(found.q[steps::steps] - found.q[0], axis=1)
        color = COLOURS.get(found.strategy, _OTHERS[k % len(_OTHERS)])
        label = LABELS.get(found.strategy, found.strategy)
        unit = unit_of(turns[name] for name in found.joints)
        tracks.append(Playback(label, color, Q, found.cycles, drift, unit, found.t))
    return tracks


def playback_page(
    chains: Sequence[TracedChain],
    tracks: Sequence[Playback],
    *,
    paths: Sequence[Array] | None = None,
    name: str = "motion",
    stopped: Sequence[str] = (),
    seconds: float | None = None,
    headline: Headline | None = None,
    own: dict[str, Any] | None = None,
    dialog: Dialog | None = None,
    cover: dict[str, Any] | None = None,
) -> str:
    """Make the HTML page of several motions, side by side, each in a pane.

    Parameters
    ----------
    chains
        Traced chains of the robot, whose frame and elbow leave traces.
    tracks
        Motions to show, all with the same number of cycles and steps.
    paths : sequence of (P, 3) arrays, optional
        Paths to draw, m, in the base frame; by default those of the frames in cycle 1 of the first
        motion. If the base moves, the paths move with it.
    name
        Display name of the path.
    stopped
        Sentences on controllers that stopped, for the headline.
    seconds
        Time of a cycle at normal speed, s; by default the period of the first motion, or 4 s if the
        period is unknown.
    headline
        Headline of the page; by default, which part has drifted, and how far.
    own
        Numbers with which the page follows a closed path that its visitor draws: start, joints and
        potentials; None if the visitor cannot draw a path.
    dialog
        Texts of the page's dialog; by default those of a study.
    cover
        Numbers of a surface around the positions of a cell, a box of poses, by the keys that
        ``cover.js`` reads. The page draws this surface in a pale colour; the first of ``paths``
        must then be a line along all edges of the cell. None for no surface.
    """
    cycles = _common_cycles(tracks)
    visuals = Visuals.of(chains[0].task.robot)
    frames = frames_for([track.Q for track in tracks], cycles)
    base = base_placements(chains[0].task.robot, tracks[0].Q[:1])  # (1, 4, 4)
    played = [[_played(chain, track) for chain in chains] for track in tracks]

    # bodies, and how far each is off after the last cycle
    surfaces = read_surfaces(visuals.shapes)
    bodies = visuals.corners(surfaces)
    links = frozenset().union(*(arm_links(chain.task) for chain in chains))
    arms = [
        _arm(
            chains, track, done, (visuals, bodies, links), frames, base[0], bool(own) and not cover
        )
        for track, done in zip(tracks, played, strict=True)
    ]
    link, _ = farthest(visuals.shapes, np.max([arm.off[-1] for arm in arms], axis=0), links)

    # words: of the task of all chains together, if there is one
    moved = tracks[0].motion
    several = moved is not None and len(moved.task.frames) > 1
    task = moved.task if several and moved else chains[0].task
    if headline is None:
        whole = [[track.motion] for track in tracks if track.motion is not None]
        summaries = _summaries(whole if several else played, tracks, arms, links)
        headline = headline_of(
            summaries, cycles, stopped, kinds=[chain.task.kind for chain in chains]
        )

    if paths is None:
        lines = list(arms[0].tip[: frames.per_cycle].swapaxes(0, 1))
    else:
        lines = [on_base(base, path[None])[0] for path in paths]
    own_frames = len(task.frames) == len(chains)
    hands = hand_names(task) if own_frames else [chain.task.frame for chain in chains]
    return animation_page(
        arms,
        lines,
        seconds=_cycle_time(tracks[0]) if seconds is None else seconds,
        title=f"{task.robot.name}: {name}",
        caption=_caption(chains, task if several else None),
        planar=is_planar(np.vstack([*_joint_origins(chains, tracks, base), *lines])),
        frames=frames,
        headline=headline,
        part=(link, part_name(task, task.from_robot(tracks[0].Q[0]), link)),
        hands=[_hand(name, chain.task.kind) for name, chain in zip(hands, chains, strict=True)],
        joints=JointRows.of(task, [track.Q[frames.index] for track in tracks], frames),
        surfaces=surfaces,
        own=own,
        dialog=dialog,
        cover=cover,
    )


def _common_cycles(tracks: Sequence[Playback]) -> int:
    """Return the number of cycles of all motions.

    InputError is raised if the motions differ in the number of cycles or steps.
    """
    if len({(track.cycles, len(track.Q)) for track in tracks}) != 1:
        raise InputError(
            "the motions differ in the number of cycles or steps, so they cannot be shown together",
            remedy="follow the path with equal cycles and steps in every motion",
        )
    return tracks[0].cycles


def _joint_origins(
    chains: Sequence[TracedChain], tracks: Sequence[Playback], base: Array
) -> list[Array]:
    """Compute the joint origins of every chain at the start of each motion: (n, 3) arrays, m.

    The list has all motions of the first chain, then those of the next. The origins are relative to
    the robot's root link. ``base`` (1, 4, 4) is the placement of the tasks' base on that link.
    """
    return [
        on_base(base, chain.task.joint_origins(chain.task.from_robot(track.Q[0]))[None])[0]
        for chain in chains
        for track in tracks
    ]


def _caption(chains: Sequence[TracedChain], together: Task | None) -> str:
    """Describe the tasks of the chains by kind, joints and redundancy, in lines of text.

    ``together`` is the task of several frames to which all chains belong, if there is one. Its
    frames are then grouped by kind, and its redundancy is the last line. If ``together`` is None,
    each chain has a line of its own.
    """
    if together is None:
        tasks = [chain.task for chain in chains]
        return ";\n".join(f"{one.frame_words}: {one.kind.words}{_redundancy(one)}" for one in tasks)
    frames: dict[str, list[str]] = {}
    for chain in chains:
        frames.setdefault(chain.task.kind.words, []).append(chain.task.frame_words)
    lines = [f"{', '.join(named)}: {words}" for words, named in frames.items()]
    return ";\n".join([*lines, f"together{_redundancy(together).lstrip(',')}"])


def _hand(name: str, kind: Kind) -> str:
    """Make the label of a hand on the page: its name, and which rotation its task leaves free.

    For a task that controls the position only, the label is ``hand, free to turn:``.
    """
    if kind.turns and not kind.tool_axes:
        return name
    return f"{name}, free to {'spin' if kind.turns else 'turn'}:"


def _redundancy(task: Task) -> str:
    """Format the numbers of joints and of redundant joints: ``, 7 joints, 1 redundant``."""
    return f", {task.n} joints, {task.r} redundant"


def _cycle_time(track: Playback) -> float:
    """Return the duration of one cycle of a motion, s; 4 s if its times are unknown."""
    span = 0.0 if track.t is None else float(track.t[-1] - track.t[0])
    return span / track.cycles if span > 0 else 4.0


def _arm(
    chains: Sequence[TracedChain],
    track: Playback,
    played: Sequence[JointMotion],
    drawn: tuple[Visuals, Sequence[Array], frozenset[str]],
    frames: Frames,
    start: Array,
    any_way: bool,
) -> Arm:
    """Make the arm of one pane of the page, which shows one motion.

    ``played`` has the motion of each chain, and ``frames`` the samples to show. ``drawn`` has three
    parts: the robot's visuals; the corners (P, 3) of each shape's convex hull in the shape's own
    frame, m; and the links of the arm, the only ones whose displacement is shown. ``start`` (4, 4)
    is the placement of the base at the start, relative to the root link. ``any_way`` is True if the
    visitor can draw a path; more corners are then kept.
    """
    (visuals, bodies, own), rows = drawn, track.Q[frames.index]
    placements = visuals.placements(rows)
    base = base_placements(chains[0].task.robot, rows)
    carried = base @ np.linalg.inv(start)
    # a visitor's own motion can move a workpiece that stood still
    moves = any_way and base_moves(chains[0].task)
    tip, elbow = (
        on_base(base, np.stack(points, axis=1))
        for points in zip(*(_ways(chain, rows) for chain in chains), strict=True)
    )
    counts = [shape.link in own for shape in visuals.shapes]
    points, off = body_drift(
        bodies,
        placements,
        frames.per_cycle,
        directions=[128 if any_way and counted else 8 for counted in counts],
    )
    return Arm(
        track.label,
        visuals.shapes,
        placements,
        tip,
        elbow,
        track.drift,
        points,
        np.where(counts, off, 0.0),
        color=track.color,
        unit=track.unit,
        broken=_broken(played, track, rows),
        carried=carried if moves or moving_of(carried[:, None]).any() else None,
    )


def _played(chain: TracedChain, track: Playback) -> JointMotion:
    """Return the motion of a chain's joints in a playback of the whole robot.

    The result is ``track.motion`` if that motion is of the same task; otherwise, it is extracted
    from ``track.Q``. If times are unknown, configurations are assumed to be 1 s apart.
    """
    if track.motion is not None and _is_of(chain.task, track.motion.task):
        return track.motion
    q = chain.task.from_robot(track.Q)
    t = np.arange(float(len(track.Q))) if track.t is None else track.t
    return JointMotion(
        chain.task, t, q, np.gradient(q, t, axis=0), track.cycles, (len(q) - 1) // track.cycles
    )


def _is_of(chain: Task, task: Task) -> bool:
    """Test whether two tasks have the same robot, frame, kind and joints."""
    same = ("robot", "frame", "kind", "joint_names")
    return all(getattr(chain, name) == getattr(task, name) for name in same)


def _broken(played: Sequence[JointMotion], track: Playback, rows: Array) -> FirstViolation | None:
    """Find the first limit violation or collision of a motion, which the page marks; else None.

    ``played`` has the motion of each chain, ``rows`` (T, nq) the configurations of the robot at T
    shown samples. Speed limits are checked if ``track`` has times. Collisions are checked if
    ``track.motion``, the motion of all joints, is not None, or if there is only one chain; the
    motion of one of several chains lacks the joints of the others. The mark is at the origin of the
    violating joint's child link, or of one of the colliding links.
    """
    description = played[0].task.robot.description
    child = {joint.name: joint.child for joint in description.joints}
    found: list[tuple[float, str, str, Task]] = []
    for one in played:
        if first := one.first_violation:
            at, joint = first
            found.append((at, f"{joint} past its limit", child[joint], one.task))
        if track.t is not None and (first := one.first_overspeed):
            at, joint = first
            found.append((at, f"{joint} past its speed limit", child[joint], one.task))
    whole = track.motion or (played[0] if len(played) == 1 else None)
    if whole is not None and (touch := whole.first_touch):
        at, links = touch
        link = next(name for name in links if name in description.links)
        found.append((at, f"{' and '.join(links)} have touched", link, whole.task))
    if not found:
        return None
    at, words, link, task = min(found, key=lambda one: one[0])
    Q = np.array([task.from_robot(q) for q in rows])
    origin = link_origins(task, [link], Q)[:, 0]
    return FirstViolation(words, at, cycle_of(at, track.cycles), origin)


def _summaries(
    played: Sequence[Sequence[JointMotion]],
    tracks: Sequence[Playback],
    arms: Sequence[Arm],
    links: frozenset[str],
) -> list[MotionSummary]:
    """Summarise every track, for the headline of the page.

    ``played`` has a list of motions for each track: one motion of the whole task, or one motion per
    chain. ``links`` are the links of the arms, of which the most displaced one is named.
    """
    return [
        _summary(done, track, farthest(arm.shapes, arm.off[-1], links))
        for done, track, arm in zip(played, tracks, arms, strict=True)
    ]


def _summary(
    played: Sequence[JointMotion], track: Playback, moved: tuple[str, float]
) -> MotionSummary:
    """Summarise a motion for the headline of the page.

    ``played`` has one motion of the whole task, or one motion per chain; ``moved`` is the most
    displaced link, and its displacement, m. With several chains, a joint speed is the norm over the
    joints of all chains. The displacements of the frame and of a joint are the largest of all
    chains. The joint-limit violation is the earliest, and the speed-limit violation the largest.
    Body distances, and the displacements of end effectors outside the task, are left out, because
    they depend on the joints of all chains.

    ``track.motion`` gives the cycle in which the frame leaves its path, and how often the path
    winds around an axis. If that motion has no path, the results are None and 0.
    """
    alone = len(played) == 1
    summaries = [motion_summary(track.label, one, moved, bodies=alone) for one in played]
    violations = [summary.limit_violation for summary in summaries if summary.limit_violation]
    timed = summaries if track.t is not None else []
    overspeeds = [summary.overspeed for summary in timed if summary.overspeed]
    whole = track.motion if isinstance(track.motion, Motion) else None
    loss = None if whole is None else whole.path_loss
    worst = replace(
        summaries[0],
        hand_off=max(summary.hand_off for summary in summaries),
        ends=summaries[0].ends if alone else {},
        speed=float(np.linalg.norm([summary.speed for summary in summaries])),
        mean_speed=float(np.linalg.norm([summary.mean_speed for summary in summaries])),
        path_loss=in_cycle(loss, track.cycles),
        limit_violation=min(violations, default=None),
        overspeed=max(overspeeds, key=lambda one: one[2], default=None),
        speeds_checked=bool(timed) and all(summary.speeds_checked for summary in timed),
        joint_displacement=max(summary.joint_displacement for summary in summaries),
        winding=(0, "") if whole is None else winding(whole.task, whole.path),
    )
    return with_outlook(worst, played)


def _ways(chain: TracedChain, rows: Array) -> tuple[Array, Array]:
    """Compute the positions of a chain's frame and of its elbow: (T, 3) each, m, in its base frame.

    ``rows`` (T, nq) are T configurations of the whole robot.
    """
    part = np.ascontiguousarray(chain.task.from_robot(rows))
    return chain.task.positions(part), np.array(
        [chain.task.joint_origins(q)[chain.elbow] for q in part]
    )
