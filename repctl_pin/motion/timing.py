"""Time for a motion, and for the approach to it: rest to rest, as quick as the limits allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import (
    MOST_STEPS,
    Array,
    as_int,
    flag,
    per_joint,
    positive,
    read_only,
    require_type,
)
from ..errors import InputError
from ..robot.bodies import bodies_of
from ..robot.task import Task
from ..urdf.checks import NO_EFFORT
from .motion import CLOSED, Motion
from .profile import STAGES, Limits, Profile, corners_of, fastest

PRESETS: dict[str, tuple[tuple[float, ...], str]] = {
    "panda": (
        (15, 7.5, 10, 12.5, 15, 20, 20),
        "frankaemika.github.io/docs/control_parameters.html, limits for Panda",
    ),
    "fr3": (
        (10,) * 7,
        "frankarobotics.github.io/docs/robot_specifications.html, limits for Franka Research 3",
    ),
    "ur": ((5,) * 6, "Universal_Robots_ROS2_Driver, ur_moveit_config/config/joint_limits.yaml"),
}
"""Published accelerations of arms, rad/s² from the base outward, and where they stand.

Franka's are limits: its controller stops beyond them, and libfranka's ``rate_limiting.h`` has the
same numbers (branch 0.8 for Panda, main for FR3). UR's arms have none but torques: these are what
their own MoveIt configuration chooses, "conservatively". Jerk and, of FR3, the joint speeds that
depend on position are not among them. """

FULL_SPEED = 0.2
"""Time, s, in which a joint is taken to reach its speed limit where nobody says how fast it speeds
up."""

_UNLIMITED = 10.0
"""Acceleration, per s², of a joint that has no speed limit either."""


def presumed_acceleration(task: Task) -> tuple[Array, str]:
    """Presume accelerations (n,) of a task's joints: published ones of a known arm, else by their
    speeds; and words."""
    entry, names = task.robot.entry, task.robot_joints
    if entry is not None and entry.acceleration is not None:
        published = PRESETS[entry.acceleration][0]
        if len(published) == len(names):
            return np.array(published, float), f"{entry.acceleration}'s, as published"
    speed = task.joint_limits[2]
    return np.where(
        np.isfinite(speed), speed / FULL_SPEED, _UNLIMITED
    ), f"full speed in {FULL_SPEED:g} s, assumed"


_MOMENT = 1e-3
"""Velocities and accelerations are means over this time to either side, s: the exact ones jump."""

_MOST_SAMPLES = MOST_STEPS // 5
"""Samples of a timed motion: each takes the memory of several steps."""


@dataclass(frozen=True, eq=False)
@read_only
class TimedMotion:
    """Positions of the robot's own joints over time, from rest to rest, at even time steps.

    Attributes
    ----------
    joints : tuple of str
        Their names.
    t : (T,) array
        Time, s, from 0; the samples begin and end a little outside the motion, at rest.
    q, qdot, qddot : (T, n) arrays
        Positions, velocities and accelerations, rad or m. Velocities and accelerations are central
        differences over a millisecond (or a sample, if shorter) to either side, because
        time-optimal q̈ jumps.
    starts : (cycles + 1,) array
        When each cycle begins, and the last ends, s.
    length, speed : (K,) arrays
        The phase-plane profile: ‖q‖ travelled from the start, and its rate, per s; the first three
        cycles if there are more.
    velocity, acceleration : (n,) arrays
        The limits kept, rad/s and rad/s² (m for sliding joints).
    stops : int
        How often it stands still within a cycle, not counting its start: at corners of the joint
        path, and stays.
    motion : Motion, optional
        What was timed; None for the way in of :func:`approach`.

    Examples
    --------
    >>> timed = rp.timed(motion, acceleration=5.0)
    >>> timed.q.shape == timed.qdot.shape == (len(timed.t), 3)
    True
    >>> bool(np.abs(timed.qdot[[0, -1]]).max() < 0.02)  # rad/s: from rest to rest
    True
    """

    joints: tuple[str, ...]
    t: Array
    q: Array
    qdot: Array
    qddot: Array
    starts: Array
    length: Array
    speed: Array
    velocity: Array
    acceleration: Array
    stops: int
    motion: Motion | None = None

    def __repr__(self) -> str:
        many = f"{len(self.joints)} joint{'s' if len(self.joints) > 1 else ''}"
        return f"<TimedMotion of {many}: {self.duration:.4g} s from rest to rest, {len(self.t):,} samples>"

    @property
    def duration(self) -> float:
        """Time from leaving rest to rest, s."""
        return float(self.starts[-1] - self.starts[0])

    @property
    def cycle_time(self) -> float:
        """Time of a steady cycle, s; of the mean one if there are fewer than three."""
        times = np.diff(self.starts)
        return float(times[1] if len(times) > 2 else times.mean())

    def cycle(self, k: int) -> tuple[Array, Array, Array, Array]:
        """Samples of cycle k, counted from 0: time from its start, q, q̇, q̈."""
        if as_int(k, "k") >= len(self.starts) - 1:
            raise InputError(
                f"there are {len(self.starts) - 1} cycles, counted from 0; no cycle {k}"
            )
        rows = (self.t >= self.starts[k] - 1e-9) & (self.t < self.starts[k + 1] - 1e-9)
        return self.t[rows] - self.starts[k], self.q[rows], self.qdot[rows], self.qddot[rows]


def timed(
    motion: Motion,
    *,
    acceleration: ArrayLike | str | None = None,
    velocity: ArrayLike | None = None,
    torque: bool = False,
    rate: float = 1000.0,
) -> TimedMotion:
    """Run a motion's joint path as quickly as the limits allow, from rest to rest.

    ``min T`` with ``|q̇| ≤ velocity``, ``|q̈| ≤ acceleration`` and, if asked, ``|τ(q, q̇, q̈)| ≤
    τ_max``, by TOPP-RA. The first cycle speeds up, the last slows down, and those between are the
    same in joints and time, if the motion closes. The arm stops at sharp corners; round them with
    ``blend=``.

    Parameters
    ----------
    motion
        What :func:`follow` made; its times are ignored, except for stays.
    acceleration : float, (n,) array or str
        Of the robot's joints, rad/s² or m/s²; a URDF has none. Or a name in ``PRESETS``, published
        limits: ``panda``, ``fr3``, ``ur``.
    velocity : float or (n,) array, optional
        Speed limits, rad/s (m/s); by default the URDF's.
    torque
        Keep the URDF's effort limits too, by Pinocchio's inverse dynamics.
    rate
        Samples per second, Hz. A steady cycle takes a whole number of samples.

    Returns
    -------
    TimedMotion

    Raises
    ------
    InputError
        If a limit is missing or not above 0, or no speed keeps them all.

    Examples
    --------
    >>> timed = rp.timed(motion, acceleration=5.0)  # rad/s²
    >>> bool(np.abs(timed.qddot).max() < 5.01)
    True
    """
    require_type(motion, Motion, "motion", "a motion, such as rp.follow makes")
    limits = limits_of(motion.task, velocity, acceleration, torque=flag(torque, "torque"))
    rate = positive(rate, "rate", "samples per second")
    Q, steps = motion.joints(motion.q), motion.steps
    once = Q[: steps + 1]

    def repeated(cycles: int) -> Array:
        return np.vstack([np.tile(once[:-1], (cycles, 1)), once[:1]])

    cycles = motion.cycles
    if np.abs(Q - repeated(cycles)).max() < CLOSED:
        cycles = min(cycles, 3)
        Q = repeated(cycles)
    profile, stops = _profile(Q, motion, cycles, limits)
    if motion.cycles > cycles and not profile.settled:  # speeding up takes longer than a cycle
        cycles = motion.cycles
        profile, stops = _profile(repeated(cycles), motion, cycles, limits)
    timed = _sampled(profile, motion.task.robot_joints, motion.cycles - cycles, rate, limits, stops)
    return replace(timed, motion=motion)


def limits_of(
    task: Task,
    velocity: ArrayLike | None,
    acceleration: ArrayLike | str | None,
    *,
    torque: bool = False,
) -> Limits:
    """Take the limits of a task's joints that a person gave, or the URDF's.

    Raises
    ------
    InputError
        If accelerations are missing, a number is not above 0, or the URDF lacks efforts or masses
        that are wanted.
    """
    names = task.robot_joints
    known = ", ".join(PRESETS)
    if acceleration is None:
        raise InputError(
            f"acceleration= is missing, and a URDF has none: give rad/s² a joint (m/s² if it slides), or one of {known}"
        )
    if isinstance(acceleration, str):
        if acceleration not in PRESETS:
            raise InputError(
                f"no accelerations of {acceleration!r} are known, only of {known}; give numbers"
            )
        acceleration, count = np.array(PRESETS[acceleration][0], dtype=float), len(names)
        if len(acceleration) != count:
            moved = f"{task.frame!r} is moved by {count}: give {count} numbers"
            raise InputError(f"these accelerations are of {len(acceleration)} joints, but {moved}")
    own = np.array(
        [task.robot.velocity_limit[task.robot.joint_names.index(name)] for name in names]
    )
    speeds = own if velocity is None else per_joint(velocity, len(names), "velocity")
    most = per_joint(acceleration, len(names), "acceleration")
    if not np.isfinite(most).all():
        raise InputError("acceleration must be finite numbers")
    if not torque:
        return Limits(speeds, most)
    if task.coordinates is not None:
        raise InputError(
            "torque limits are of the robot's own joints; follow the path with the original task"
        )
    model = task.robot.model
    efforts = np.array([model.effortLimit[model.getJointId(name) - 1] for name in names])
    if (efforts >= NO_EFFORT).any() or not sum(inertia.mass for inertia in model.inertias) > 0:
        raise InputError(
            "torque limits need efforts and masses, and this URDF lacks some; leave torque out"
        )
    return Limits(speeds, most, efforts, task.dynamics())


def rest_to_rest(Q: Array, joints: Sequence[str], rate: float, limits: Limits) -> TimedMotion:
    """Time one smooth joint path (T, n), once."""
    profile = Profile([fastest(Q, limits)], [0.0], [0, len(Q) - 1], [0, len(Q) - 1], limits)
    return _sampled(profile, tuple(joints), 0, rate, limits, 0)


def _profile(Q: Array, motion: Motion, cycles: int, limits: Limits) -> tuple[Profile, int]:
    """Solve run after run between corners and stays; and count the corners of a cycle."""
    steps, t = motion.steps, motion.t[: motion.steps + 1] - motion.t[0]
    moving = np.linalg.norm(np.diff(Q, axis=0), axis=1) > 1e-9
    if not moving.any():
        raise InputError("the joints do not move; there is nothing to time")
    kept = np.concatenate([[True], moving])  # points that are not those before them
    place = np.cumsum(kept) - 1  # of every point among the kept
    stays = np.zeros(int(place[-1]) + 1)
    np.add.at(stays, place[1:][~moving], np.tile(np.diff(t), cycles)[~moving])
    breaks = np.rint(np.interp(motion.path.breaks, t / t[-1], np.arange(steps + 1))).astype(int)
    marks = [int(place[k + cycle * steps]) for k in (0, *breaks) for cycle in range(cycles)]
    corners = corners_of(Q[kept], marks)
    stops = sorted({0, int(place[-1]), *corners, *np.flatnonzero(stays).tolist()})
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(Q[kept], axis=0), axis=1))])
    density = STAGES * cycles / way[-1]
    runs = [
        fastest(Q[kept][a : b + 1], limits, density * (way[b] - way[a])) for a, b in pairwise(stops)
    ]
    ends = [int(place[cycle * steps]) for cycle in range(cycles + 1)]
    count = sum(0 < k < ends[1] for k in {*corners, *np.flatnonzero(stays).tolist()})
    return Profile(runs, [float(stays[k]) for k in stops[:-1]], stops, ends, limits), count


def _sampled(
    profile: Profile, joints: tuple[str, ...], more: int, rate: float, limits: Limits, stops: int
) -> TimedMotion:
    """Sample a profile at even steps, its second cycle so many times more."""
    dt = 1.0 / rate
    marks, factor = profile.marks * profile.stretch, profile.stretch
    period = 0
    if len(marks) > 3:  # a steady cycle takes a whole number of samples
        steady = float(marks[2] - marks[1])
        if not steady / dt < _MOST_SAMPLES:
            raise InputError(
                f"a cycle of {steady:.3g} s at {rate:g} samples per second is too much; lower the rate"
            )
        period = int(np.ceil(steady / dt - 1e-6))
        factor *= period * dt / steady
        marks = profile.marks * factor
    moment = min(dt, _MOMENT)
    lead = int(np.ceil(2 * moment / dt - 1e-9))
    if not marks[-1] / dt + (more * period) + 2 * lead < _MOST_SAMPLES:
        raise InputError(
            f"{marks[-1]:.3g} s at {rate:g} samples per second are over {_MOST_SAMPLES:,}; lower the rate"
        )
    samples = int(np.ceil(marks[-1] / dt - 1e-9)) + 2 * lead + 1
    clock = np.linspace(-lead, samples - 1 - lead, samples) * dt
    back, before, q, after, beyond = (
        profile.positions((clock + k * moment) / factor) for k in (-2, -1, 0, 1, 2)
    )
    qdot, qddot = (after - before) / (2 * moment), (beyond - 2 * q + back) / (4 * moment**2)
    begin = int(np.ceil((marks[1] / dt if more else 0) - 1e-6)) + lead
    steady_rows = np.tile(np.arange(begin, begin + period), more)
    rows = np.concatenate(
        [np.arange(begin + period), steady_rows, np.arange(begin + period, len(clock))]
    )
    starts = marks
    if more:
        turns = marks[1] + period * dt * np.arange(more + 2)
        starts = np.concatenate([marks[:1], turns, marks[3:] + more * period * dt])
    length, speed = profile.phase
    return TimedMotion(
        joints=joints,
        t=np.linspace(0.0, (len(rows) - 1) * dt, len(rows)),
        q=q[rows],
        qdot=qdot[rows],
        qddot=qddot[rows],
        starts=starts + lead * dt,
        length=length,
        speed=speed / factor,
        velocity=limits.velocity,
        acceleration=limits.acceleration,
        stops=stops,
    )


_LOOKED_AT = 101
"""Points of an approach at which it is looked whether bodies touch."""


def approach(
    q_now: ArrayLike,
    motion: Motion,
    *,
    acceleration: ArrayLike | str | None = None,
    velocity: ArrayLike | None = None,
    torque: bool = False,
    rate: float = 1000.0,
    bodies: bool = True,
) -> TimedMotion:
    """Move the joints straight, from rest to rest, from where the arm is to the start of a motion.

    ``q(s) = q_now + s (q_start − q_now)``, as quickly as the limits allow. Both ends are inside the
    joint limits, hence so is all between.

    Parameters
    ----------
    q_now : (n,) array
        Where the arm is, rad (m for sliding joints).
    motion
        Its first configuration is the goal.
    acceleration : float or (n,) array, or str
        rad/s² (m/s²), as :func:`timed` takes it.
    velocity : float or (n,) array, optional
        rad/s (m/s); by default the URDF's.
    torque, rate
        As :func:`timed` takes them.
    bodies
        Check that the robot does not touch itself, or its surroundings, on the way.

    Returns
    -------
    TimedMotion
        Of one cycle: there, not back.

    Raises
    ------
    InputError
        If q_now or the start is outside the joint limits, the arm is there already or would touch
        itself, or a limit cannot be used.

    Examples
    --------
    >>> way = rp.approach(q0 + 0.2, motion, acceleration=5.0)
    >>> np.allclose(way.q[-1], motion.q[0])
    True
    """
    task = require_type(motion, Motion, "motion", "a motion, such as rp.follow makes").task
    bodies = flag(bodies, "bodies")
    limits = limits_of(task, velocity, acceleration, torque=flag(torque, "torque"))
    ends = [task.check(q_now, "q_now"), task.check(motion.q[0], "the motion's start")]
    begin, end = motion.joints(np.array(ends))
    if np.linalg.norm(end - begin) < 1e-9:
        raise InputError(
            "the arm is at the start of the motion already; there is nothing to approach"
        )
    share = np.linspace(0, 1, _LOOKED_AT)[:, None]
    if bodies:
        straight = ends[0] + share * (ends[1] - ends[0])
        known = bodies_of(task)
        distances = known.distances(straight)
        if distances[at := int(np.argmin(distances))] < 0:
            one, other = known.nearest(straight[at]).links
            raise InputError(
                f"on the straight way {one!r} and {other!r} touch, {share[at, 0]:.0%} of it done: go round by another "
                "configuration, or give bodies=False if they do not"
            )
    line = begin + share * (end - begin)
    return rest_to_rest(
        line, task.robot_joints, positive(rate, "rate", "samples per second"), limits
    )
