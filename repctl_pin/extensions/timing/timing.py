"""Time-optimal timing of a motion, from rest to rest within limits.

The joint path is cut at the stops into segments. Each segment is timed, and the result is sampled.
A cycle is one traversal of the closed path; the steady cycle is the one between those that speed up
and slow down. ``JointLimits`` are the limits of all n joints, as arrays. s is the length of the
joint path, and T a number of samples. A stage is a value of s at which the speed ṡ is computed and
the limits are imposed. An argument ``laps`` is the joint path of a few cycles, see :class:`_Laps`.

``Profile`` is the timing of a few cycles: segments with pauses between them. ``Segment`` is a
smooth part of a joint path between two stops, with its speed at each stage. ``JointMotion`` is a
joint motion over several cycles: q, q̇ (T, n) at times t, without the path of the frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...base.arguments import Array, flag, positive, read_only, require_type
from ...base.errors import InputError
from ...motion.limits import JointLimits, Limits, joint_limits, presumed_acceleration
from ...motion.motion import CLOSED, Motion
from ...motion.timed_motion import TimedMotion
from .speed_profile import (
    BEND,
    MOST_SAMPLES,
    SHARP,
    STAGES,
    Course,
    Profile,
    Segment,
    Trajectory,
    corners_of,
    fastest,
    require_possible,
    require_samples,
)

_MOMENT = 1e-3
"""Half-width, s, of the central differences that give q̇ and q̈; the exact accelerations jump."""


def timed(
    motion: Motion, limits: Limits, *, keep_times: bool = False, rate: float = 1000.0
) -> TimedMotion:
    """Time a motion's joint path from rest to rest, as quickly as the limits allow.

    The duration is minimised with ``|q̇| ≤ velocity``, ``|q̈| ≤ acceleration`` and, if given,
    ``|q⃛| ≤ jerk`` and ``|τ(q, q̇, q̈)| ≤ τ_max``: by one linear program, or by several with a
    limit of jerk. The first cycle speeds up and the last slows down. If the motion closes, all
    cycles in between are identical. The arm stops at sharp corners; use ``blend=`` of the path to
    round them.

    Parameters
    ----------
    motion
        Result of :func:`follow`; its times are ignored, except for pauses and with ``keep_times``.
    limits
        Limits of acceleration and, if given, of speed, jerk, torque and the tool's speed.
    keep_times
        Keep the motion's own times, such as those of a CSV file, and only add ramps at the ends, as
        short as the limits allow. At a sharp corner, the arm must stop; it does so at the corner's
        own time.
    rate
        Samples per second, Hz. A steady cycle takes a whole number of samples.

    Returns
    -------
    TimedMotion
        Positions, velocities and accelerations of the joints at even time steps, from rest to rest.

    Raises
    ------
    InputError
        If the limits do not fit the robot, no speed is within all limits, or the motion's own times
        exceed the limits.

    Examples
    --------
    >>> timed = rp.timed(motion, rp.Limits(acceleration=5.0))  # rad/s²
    >>> bool(np.abs(timed.qddot).max() < 5.01)
    True
    """
    require_type(motion, Motion, "motion", "a motion, such as rp.follow makes")
    kept = joint_limits(motion.task, limits)
    rate = positive(rate, "rate", "samples per second")
    keep_times = flag(keep_times, "keep_times")
    Q = motion.q
    require_possible(Q, kept, rate)
    once = _first_cycle(motion, smooth=kept.jerk is not None or keep_times)

    def repeated(cycles: int) -> Array:
        return np.vstack([np.tile(once[:-1], (cycles, 1)), once[:1]])

    cycles = motion.cycles
    if np.abs(Q - repeated(cycles)).max() < CLOSED:
        cycles = min(cycles, 3)
        Q = repeated(cycles)
    laps = _Laps.of(motion, Q, cycles)
    if keep_times:
        profile, stops = _in_own_times(laps, kept, motion)
    else:
        profile, stops = _as_fast_as_possible(laps, kept)
        if motion.cycles > cycles and not profile.converged:
            cycles = motion.cycles  # speeding up takes longer than a cycle
            laps = _Laps.of(motion, repeated(cycles), cycles)
            profile, stops = _as_fast_as_possible(laps, kept)
        if kept.jerk is not None:
            steady = motion.cycles - 2 if cycles == 3 and profile.converged else 0
            profile, stops = _as_fast_as_possible(laps, kept, steady)
    joints = motion.task.joint_names
    timed = sampled_profile(profile, joints, motion.cycles - cycles, rate, kept, len(stops))
    return replace(timed, motion=motion)


def _first_cycle(motion: Motion, *, smooth: bool) -> Array:
    """Return the configurations (steps + 1, n) of a motion's first cycle, rad or m.

    ``steps`` is the number of steps per cycle. With ``smooth``, a cycle whose ends differ by less
    than 1e-5 rad or m is changed slightly, so that it closes exactly.
    """
    once = motion.q[: motion.steps + 1]
    if smooth and np.linalg.norm(once[-1] - once[0]) < CLOSED:
        # jerk feels 1e-9 rad
        once = once + np.linspace(0.0, 1.0, len(once))[:, None] * (once[0] - once[-1])
    return once


@dataclass(frozen=True, eq=False)
@read_only
class _Laps:
    """Joint path of a few cycles, without points that repeat the preceding point.

    A repeated point is a pause: it has a duration, but no length, so it is left out of the curve.

    Attributes
    ----------
    Q : (P, n) array
        The P points, rad or m.
    clock, stays : (P,) arrays
        The motion's own time at each point, and the duration of its pause there, 0 for none, s.
    ends : tuple of int
        Indices of the points at which the cycles begin; then the index at which the last one ends.
    marks : tuple of int
        Indices of the points at which the path may have a corner.
    """

    Q: Array
    clock: Array
    stays: Array
    ends: tuple[int, ...]
    marks: tuple[int, ...]

    @classmethod
    def of(cls, motion: Motion, Q: Array, cycles: int) -> _Laps:
        """Make the joint path from configurations Q (T, n), those of ``cycles`` cycles of a motion.

        InputError is raised if the joints do not move.
        """
        steps, t = motion.steps, motion.t[: motion.steps + 1] - motion.t[0]
        moving = np.linalg.norm(np.diff(Q, axis=0), axis=1) > 1e-9
        if not moving.any():
            raise InputError(
                "the joints do not move in this motion, so it cannot be timed",
                remedy="time a motion along a path that has a length",
            )
        first = np.flatnonzero(np.append(True, moving))
        last = np.append(first[1:], len(Q)) - 1
        laps = t[:-1] + t[-1] * np.arange(cycles)[:, None]
        clock = np.append(laps, cycles * t[-1])
        breaks = np.interp(motion.path.breaks, t / t[-1], np.arange(steps + 1))
        marks = np.append(0, np.rint(breaks).astype(int))
        begins = steps * np.arange(cycles + 1)
        place = np.searchsorted(first, np.arange(len(Q)), side="right") - 1
        return cls(
            Q[first],
            clock[first],
            clock[last] - clock[first],
            tuple(place[begins].tolist()),
            tuple(place[marks[:, None] + begins[:-1]].ravel().tolist()),
        )

    def corners(self, bend: float = BEND) -> list[int]:
        """List the indices of points at which the path's direction changes by more than ``bend``.

        ``bend`` is in rad. Without a stop there, the arm would need unlimited acceleration.
        """
        return corners_of(self.Q, self.marks, bend)

    def stops(self, corners: list[int]) -> list[int]:
        """List the indices at which the arm rests: both ends, the given corners, and pauses."""
        pauses = np.flatnonzero(self.stays).tolist()
        return sorted({0, len(self.Q) - 1, *corners, *pauses})

    def profile(
        self, runs: list[Segment], stops: list[int], limits: JointLimits
    ) -> tuple[Profile, list[int]]:
        """Join timed segments to the profile of all cycles.

        ``runs`` are the segments between successive ``stops``, which are indices of points. From
        ``limits``, the profile computes by which factor time must be stretched. Return the profile,
        and the list of those stops that lie inside the first cycle.
        """
        stays = [float(self.stays[k]) for k in stops[:-1]]
        profile = Profile(runs, stays, stops, list(self.ends), limits)
        return profile, [k for k in stops if 0 < k < self.ends[1]]


def _as_fast_as_possible(
    laps: _Laps, limits: JointLimits, steady: int = -1
) -> tuple[Profile, list[int]]:
    """Time a joint path as quickly as possible, in segments between corners and pauses.

    Return the profile, and the stops inside the first cycle, as indices of points. If ``steady`` is
    −1, the limit of jerk is ignored; if it is 0 or more, the limit is respected. A positive
    ``steady`` means that ``laps`` has three cycles, and that the second one will be traversed
    ``steady`` times. The total duration of all these cycles is then minimised, and the second cycle
    begins and ends with equal ṡ and s̈. If the path has a stop between its ends, ``steady`` has no
    such effect, and each segment is timed separately.
    """
    stops = laps.stops(laps.corners())
    steps = np.linalg.norm(np.diff(laps.Q, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    density = STAGES * (len(laps.ends) - 1) / way[-1]
    seams = laps.ends[1:3] if steady > 0 and len(stops) == 2 else ()
    known: dict[bytes, Segment] = {}  # cycles have the same parts
    runs = []
    for a, b in pairwise(stops):
        part, stages = laps.Q[a : b + 1], density * (way[b] - way[a])
        key = part.tobytes()
        if key not in known:
            known[key] = fastest(part, limits, stages)
            if steady >= 0:
                from .jerk import with_jerk  # most motions have no such limit

                known[key] = with_jerk(known[key], limits, seams, steady)
        runs.append(known[key])
    return laps.profile(runs, stops, limits)


def _in_own_times(laps: _Laps, limits: JointLimits, motion: Motion) -> tuple[Profile, list[int]]:
    """Time a joint path by its own times, such as those of a file's waypoints, from stop to stop.

    ``motion`` is the motion from which ``laps`` was made. Return the profile, and the stops inside
    the first cycle, as indices of points. The arm stops at pauses and at corners of over 0.3 rad.
    If the limits cannot be met between two such stops, it also stops at all corners of over
    0.05 rad there. InputError is raised if the limits cannot be met even then.
    """
    from .own_times import with_own_times  # only paths with a clock need it

    period = float(motion.t[motion.steps] - motion.t[0])

    def segment(a: int, b: int) -> Segment:
        own = laps.clock[a : b + 1].copy()
        own[0] += laps.stays[a]
        return with_own_times(
            laps.Q[a : b + 1],
            own,
            limits,
            added=int(a == 0) + int(b == len(laps.Q) - 1),
            most=2 * period,
            joints=motion.task.joint_names,
        )

    corners = laps.corners()
    runs: list[Segment] = []
    found = [0]
    for a, b in pairwise(laps.stops(laps.corners(SHARP))):
        gentle = [k for k in corners if a < k < b]
        try:
            runs.append(segment(a, b))
            found.append(b)
        except InputError:
            if not gentle:
                raise
            runs += [segment(*ends) for ends in pairwise([a, *gentle, b])]
            found += [*gentle, b]
    return laps.profile(runs, found, limits)


def sampled_profile(
    profile: Profile,
    joints: tuple[str, ...],
    more: int,
    rate: float,
    limits: JointLimits,
    stops: int,
) -> TimedMotion:
    """Sample a profile at even time steps, with its second cycle repeated ``more`` times.

    ``joints`` are names, ``rate`` is the number of samples per second, and ``stops`` the number of
    stops per cycle. Times are stretched slightly, so that the limits also hold between the stages
    of the profile, and a steady cycle takes a whole number of samples.
    """
    dt = 1.0 / rate
    period, factor = _whole_period(profile, dt, rate)
    marks = profile.marks * factor
    moment = min(dt, _MOMENT)
    lead = int(np.ceil(2 * moment / dt - 1e-9))
    require_samples(marks[-1] / dt + more * period + 2 * lead, marks[-1], rate)
    samples = int(np.ceil(marks[-1] / dt - 1e-9)) + 2 * lead + 1

    # the joints and their rates, by central differences
    clock = np.arange(-lead, samples - lead, dtype=float) * dt
    course = profile.course.stretched(factor)
    q, qdot, qddot = _differentiated(course, clock, moment)

    # the second cycle, again and again
    rows, starts = np.arange(samples + more * period), marks
    if more:
        begin = int(np.ceil(marks[1] / dt - 1e-6)) + lead
        rows -= period * np.clip((rows - begin) // period, 0, more)
        starts = _repeated_starts(marks, period * dt, more)
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
        jerk=limits.jerk,
        trajectory=Trajectory(course, lead * dt, float(marks[1]), period * dt, more),
    )


def _differentiated(course: Course, t: Array, h: float) -> tuple[Array, Array, Array]:
    """Evaluate a course at times t (T,), s: q, and q̇, q̈ by central differences; (T, n) each.

    ``h`` is a time step, s. q̇ is computed from q at t ± h, and q̈ from q at t and t ± 2 h.
    """
    back, before, q, after, beyond = (course.positions(t + k * h) for k in range(-2, 3))
    return q, (after - before) / (2 * h), (beyond - 2 * q + back) / (4 * h**2)


def _whole_period(profile: Profile, dt: float, rate: float) -> tuple[int, float]:
    """Find by which factor to stretch time so that a steady cycle is a whole number of samples.

    The factor also makes the limits hold between the stages of the profile. Return the number of
    samples of a steady cycle, and the factor. With fewer than three cycles there is no steady one,
    and the number is 0. ``dt`` is the time between samples, s, and ``rate`` = 1/dt. InputError is
    raised if a steady cycle has too many samples for memory.
    """
    if not len(profile.marks) > 3:
        return 0, profile.stretch
    marks = profile.marks * profile.stretch
    steady = float(marks[2] - marks[1])
    if not steady / dt < MOST_SAMPLES:
        raise InputError(
            f"a cycle of {steady:.3g} s at {rate:g} samples per second is more than "
            f"{MOST_SAMPLES:,} samples; lower the rate"
        )
    period = int(np.ceil(steady / dt - 1e-6))
    return period, profile.stretch * (period * dt / steady)


def _repeated_starts(marks: Array, period: float, more: int) -> Array:
    """List the times at which all cycles begin, then the time at which the last one ends, s.

    ``marks`` (4,) are these times for three cycles, s. The second cycle, which takes ``period``, s,
    is repeated ``more`` times.
    """
    turns = marks[1] + period * np.arange(more + 2)
    return np.concatenate([marks[:1], turns, marks[3:] + more * period])


def fastest_cycle(motion: Motion) -> float | None:
    """Compute the minimum duration, s, of a motion's first cycle from rest to rest.

    Return None if the joints do not move, or no speed is within the limits. The acceleration limits
    are the URDF's, else published ones, else the speed limits divided by 0.2 s.
    """
    end = motion.steps + 1
    once = replace(motion, cycles=1, t=motion.t[:end], q=motion.q[:end], qdot=motion.qdot[:end])
    acceleration = presumed_acceleration(motion.task)[0]
    try:
        return timed(once, Limits(acceleration=acceleration)).duration
    except InputError:  # it does not move, or no speed is slow enough
        return None
