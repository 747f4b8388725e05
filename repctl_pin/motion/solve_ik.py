"""Inverse kinematics of one placement: from several starts, or near one configuration."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..base.arguments import MOST_STEPS, Array, as_int, flag, positive, vector
from ..base.errors import InputError, SingularityError
from ..model.chain_formulas import Placement, Placements
from ..model.length import arm_length
from ..model.task import Task, require_task
from ..paths.task_path import TaskPath
from ..redundancy.inverses import pseudoinverse
from ..solvers import newton

_THERE = 1e-9
"""Task error, m and rad, below which the frame counts as at a point."""

_STEP = 0.3
"""Longest Newton step of any joint, rad or m."""

_ITERATIONS = 200
"""Maximum number of Newton steps from one start."""

_STARTS = 41
"""Number of starts of Newton's method before a target counts as not found."""

_POINTS = 48
"""Number of points of a path that are tested beside its corners."""

_FAR = 10
"""Distance of points, in arm lengths, above which they are presumed to be in mm instead of m."""


class _Attempt(NamedTuple):
    """Result of Newton's method from one start: the last configuration, and its task error (m,).

    The attempt that ends nearest to the target is named in the message if all starts fail.
    """

    q: Array
    error: Array

    @property
    def size(self) -> float:
        """Norm of the task error, m and rad."""
        return float(np.linalg.norm(self.error))


def solve_ik(
    task: Task,
    q0: ArrayLike,
    target: Placement,
    *,
    tolerance: float = 1e-12,
    iterations: int = _ITERATIONS,
    limits: bool = True,
) -> Array:
    """Find q with f(q) at the target, by Newton's method with J⁺ and bounded steps.

    The first start is q0. If it does not lead to the target, 40 more starts follow. Start k lies on
    the line from q0 to the k-th of 40 random configurations inside the joint limits, and farther
    along this line for larger k. The first solution is returned; the random numbers are the same in
    each call.

    Parameters
    ----------
    task
        Task that places the frame.
    q0 : (n,) array
        Initial configuration, rad (m for prismatic joints).
    target : pinocchio.SE3 or (4, 4) array
        Desired placement of the frame.
    tolerance, iterations
        Maximum task error (m and rad), and maximum number of Newton steps per start.
    limits
        True to refuse configurations outside the joint limits.

    Returns
    -------
    (n,) array

    Raises
    ------
    InputError
        If the target is farther away than the arm is long, or no start leads to a solution, or all
        solutions found are outside the joint limits; the message says which.

    Examples
    --------
    >>> target = task.placement(q0 + 0.1)
    >>> q = rp.solve_ik(task, q0, target)
    >>> bool(np.abs(task.error(q, target)).max() < 1e-9)  # m
    True
    """
    target = require_task(task).as_target(target)
    if not np.isfinite(target.homogeneous).all():
        raise InputError(
            "the target has a number that is not finite; give a finite position, m, and rotation"
        )
    q0 = vector(q0, task.n, "q0")
    tolerance = positive(tolerance, "the tolerance")
    iterations = as_int(iterations, "iterations", 1, MOST_STEPS)
    limits = flag(limits, "limits")
    _require_reach(task, target, limits=limits)
    # Newton from several starts; the first solution within limits counts
    outside: InputError | None = None
    nearest: _Attempt | None = None
    for start in _starts(task, q0):
        attempt = _newton(task, start, target, tolerance, iterations)
        if not attempt.size < max(tolerance, _THERE):
            if nearest is None or attempt.size < nearest.size:
                nearest = attempt
            continue
        try:
            return task.check(attempt.q, "a solution") if limits else attempt.q
        except InputError as error:
            outside = outside or error
    # why there is none
    if outside is not None:
        raise InputError(
            f"{task.frame!r} at {_where(target)} m: from {_STARTS} starts no solution inside the "
            f"joint limits was found; {outside}"
        )
    assert nearest is not None
    raise InputError(
        f"{task.frame!r} at {_where(target)} m: no solution found from {_STARTS} starts, "
        f"the nearest ends {_amount(task, nearest.error)} away; "
        "move the path nearer or choose another start"
    )


def solve_near(
    task: Task, q0: Array, target: Placement, *, tolerance: float, limits: bool = False
) -> Array:
    """Find q near q0 with f(q) at the target: like :func:`solve_ik`, but from q0 only.

    Walks along a path or a self-motion need the solution nearest to the previous one. ``tolerance``
    is the maximum task error, m and rad.

    Raises
    ------
    InputError
        If no solution is found from q0, or only one outside the joint limits.
    """
    target = task.as_target(target)
    attempt = _newton(task, q0, target, tolerance, _ITERATIONS)
    if not attempt.size < max(tolerance, _THERE):
        _require_reach(task, target, limits=limits)
        raise InputError(
            f"{task.frame!r} does not reach {_where(target)} m from the previous configuration: "
            f"it stops {_amount(task, attempt.error)} away; "
            "move the path nearer or choose another start"
        )
    return task.check(attempt.q, "a solution") if limits else attempt.q


def _starts(task: Task, q0: Array) -> Iterator[Array]:
    """Yield q0, then configurations between q0 and random ones, the nearest first.

    There are 41 in all. Starts near q0 come first, because they lead to solutions similar to q0.
    """
    yield q0
    count = _STARTS - 1
    ends = random_configurations(task, count, np.random.default_rng(0))
    for k, end in enumerate(ends, 1):
        yield q0 + k / count * (end - q0)


def _newton(task: Task, q0: Array, target: pin.SE3, tolerance: float, iterations: int) -> _Attempt:
    """Solve for the target from one start, and return where Newton's method ends, solved or not.

    Steps are ``J⁺ e`` with the task error e, at most 0.3 rad or m per joint. The method ends at an
    error below ``tolerance``, after ``iterations`` steps, or at a singularity; in the last case the
    start is returned.
    """
    error = task.error(q0, target)

    def residual(q: Array) -> float:
        nonlocal error
        error = task.error(q, target)
        return float(np.linalg.norm(error))

    def correction(q: Array) -> Array:
        return pseudoinverse(task.jacobian(q)) @ error

    try:
        q = newton(
            correction,
            q0,
            longest=_STEP,
            tolerance=tolerance,
            iterations=iterations,
            residual=residual,
        )
    except SingularityError:
        return _Attempt(q0, error)  # the error where J lost its rank
    assert q is not None  # with a residual there is always a last q
    return _Attempt(q, task.error(q, target))


def _require_reach(task: Task, target: pin.SE3, *, limits: bool) -> None:
    """Raise InputError if the target is farther from the first joint than the arm is long.

    The message is clearer than that of a failed search, because it names the distance and the arm's
    length.

    Parameters
    ----------
    task
        Task that places the frame.
    target
        Placement of the frame.
    limits
        True if prismatic joints stay within their limits.
    """
    if isinstance(target, Placements):
        for single, own in zip(task.single_tasks, target, strict=True):
            _require_reach(single, own, limits=limits)
        return
    center, length = _longest_reach(task, limits=limits)
    rows = task.kind.rows[task.kind.linear]
    away = float(np.linalg.norm((target.translation - center)[rows]))
    if away > length * (1 + 1e-12):
        raise InputError(
            f"{task.frame!r} cannot reach {_where(target)} m: it is {away:.3g} m from joint "
            f"{task.joint_names[0]!r}, and the arm is at most {length:.3g} m long; "
            "move the path nearer"
        )


def _where(target: pin.SE3) -> str:
    return np.array2string(np.asarray(target.translation), precision=3, separator=", ")


def _amount(task: Task, error: Array) -> str:
    """Format a task error (m,): the distance and, if it is the larger part, the angle."""
    way = float(np.linalg.norm(error[task.kind.linear]))
    angle = float(np.linalg.norm(error[~task.kind.linear]))
    return f"{way:.3g} m" if way >= angle else f"{way:.3g} m and {angle:.3g} rad"


def reach_start(task: Task, q0: ArrayLike, path: TaskPath) -> Array:
    """Solve for a configuration at the first point of a path; q0 itself if it is there already.

    A motion must begin on its path. At a path with named corners, the message names the corner.

    Raises
    ------
    InputError
        If no solution is found from q0, or only one outside the joint limits.
    """
    q = np.asarray(q0, float)
    if np.linalg.norm(task.error(q, path.placement(0.0))) <= _THERE:
        return q
    try:
        return solve_ik(task, q, path.placement(0.0))
    except InputError as error:
        raise _with_corner(error, task, q, q, path, 0.0) from None


def check_reach(task: Task, q0: ArrayLike, path: TaskPath) -> None:
    """Raise InputError for a path that the frame cannot reach, without regard to joint limits.

    The corners and 48 more points are tested.

    Raises
    ------
    InputError
        If a point is out of reach; the message names the first one, or the corner of the path after
        it.
    """
    q = start = np.asarray(q0, float)
    for s in np.union1d(np.linspace(0, 1, _POINTS), path.breaks):
        try:
            q = solve_near(task, q, path.placement(float(s)), tolerance=_THERE)
        except InputError as error:
            raise _with_corner(error, task, start, q, path, float(s)) from None


def _with_corner(
    error: InputError, task: Task, start: Array, q: Array, path: TaskPath, s: float
) -> InputError:
    """Return an error extended by the path's name, its corner near s, and a hint at the cause.

    ``start`` and ``q`` are the start and the last configuration that was on the path. s is the path
    parameter, 0 to 1. For a path without named corners the error is returned unchanged.
    """
    if not path.corners:
        return error
    knots = (0.0, *path.breaks, 1.0)
    corner = int(np.searchsorted(knots, s))
    where = path.corners[corner]
    what = str(error)
    if corner > 0:
        shortfalls = [_shortfall(task, near, path.placement(knots[corner])) for near in (q, start)]
        if "" in shortfalls:
            where = f"between {path.corners[corner - 1]} and {where}"
        else:
            what = shortfalls[0]
    return InputError(f"{path.name}, {where}: {what}{_hint(task, start, path, knots)}")


def _hint(task: Task, start: Array, path: TaskPath, knots: tuple[float, ...]) -> str:
    """Suggest a different unit or origin with which the whole path can be reached; else empty.

    Waypoints in mm, or counted from the start, are common errors. ``knots`` are the values of the
    path parameter s at the corners and both ends.
    """
    if len(task.frames) > 1:
        return ""
    points = np.array([path.point(s) for s in knots])
    if np.abs(points).max() > _FAR * arm_length(task, start) and _all_reached(
        task, start, path, points / 1000
    ):
        return "; are the numbers mm? They must be m"
    if not points[0].any() and _all_reached(
        task, start, path, points + task.placement(start).translation
    ):
        return "; are the points counted from the start? They must be counted from the base"
    return ""


def _all_reached(task: Task, q: Array, path: TaskPath, points: Array) -> bool:
    """Test whether the frame can reach all points (K, 3), m, from q, in one fixed orientation."""
    rotation = path.placement(0.0).rotation
    return not any(_shortfall(task, q, pin.SE3(rotation, point)) for point in points)


def _shortfall(task: Task, q: Array, target: pin.SE3) -> str:
    """Explain in text why a target cannot be reached from q; the text is empty if it can.

    The text is the message of the failed inverse kinematics, for a message about a path.
    """
    try:
        solve_near(task, q, target, tolerance=_THERE)
    except InputError as error:
        return str(error)
    return ""


def random_configurations(task: Task, count: int, rng: np.random.Generator) -> Array:
    """Draw configurations (count, n), uniform between the joint limits.

    Where a joint has no limit, the bound is π rad (m) from the task's reference configuration.
    """
    low = np.where(np.isfinite(task.lower), task.lower, task.reference - np.pi)
    high = np.where(np.isfinite(task.upper), task.upper, task.reference + np.pi)
    return low + (high - low) * rng.random((count, task.n))


def _longest_reach(task: Task, *, limits: bool = True) -> tuple[Array, float]:
    """Bound the distance of the frame from the origin of the chain's first joint.

    The bound is the sum of the distances between successive joints and from the last one to the
    frame, which the joints do not change, and of the largest strokes of prismatic joints.

    Parameters
    ----------
    task
        Task of the chain.
    limits
        True if prismatic joints stay within their limits; else their stroke is infinite.

    Returns
    -------
    center : (3,) array
        Origin of the first joint at stroke 0, m, base axes.
    length : float
        Bound on the distance from ``center``, m; infinite with a prismatic joint without limits.
    """
    model = task.model
    frame = model.frames[task._frame_id]
    chain = [j for j in model.supports[frame.parentJoint] if j > 0]
    offsets = [model.jointPlacements[j].translation for j in chain]
    length = float(np.linalg.norm([*offsets[1:], frame.placement.translation], axis=1).sum())
    for name in (model.names[j] for j in chain):
        joint = task.robot.joints[name]
        if joint.kind == "prismatic":
            length += max(-joint.lower, joint.upper, 0.0) if limits else np.inf
    return np.array(offsets[0]), length
