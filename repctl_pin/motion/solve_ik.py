"""Inverse kinematics of one placement: from several starts, or near one configuration.

The task error is the difference of two placements in the coordinates of the task, m and rad; J⁺ is
the pseudoinverse of the Jacobian.

``_Attempt`` is the result of Newton's method from one start: the last configuration, and its error.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import MOST_STEPS, Array, as_int, flag, positive, vector
from ..base.errors import InputError, SingularityError
from ..model.chain_formulas import Placement, Placements
from ..model.length import arm_length
from ..model.task import Task, require_task
from ..paths.task_path import TaskPath
from ..redundancy.inverses import pseudoinverse
from ..solvers import newton, newton_rows
from ..strategies import Pseudoinverse

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

_REFINED = 20
"""Maximum number of Newton steps from a configuration near a point of a path."""

_FAR = 10
"""Distance of points, in arm lengths, above which they are presumed to be in mm instead of m."""


class _Attempt(NamedTuple):
    """Result of Newton's method from one start: the last configuration q (n,), and its error.

    ``error`` (m,) is the task error, m and rad, from q to the target.
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
    """Solve the inverse kinematics by Newton's method: find q with the frame at the target.

    The first start is q0. If it leads to no solution, 40 more follow. Start k lies on the line from
    q0 to the k-th of 40 random configurations inside the joint limits, at the fraction k / 40 of
    this line. The first accepted solution is returned; the random numbers are the same in each
    call.

    Parameters
    ----------
    task
        Task that places the frame.
    q0 : (n,) array
        Initial configuration, rad (m for prismatic joints).
    target : pinocchio.SE3 or (4, 4) array
        Desired placement of the frame.
    tolerance, iterations
        Norm of the task error (m and rad) at which Newton's method stops, and maximum number of
        its steps per start. A solution is accepted if its error is below 1e-9, or below a larger
        ``tolerance``.
    limits
        True to accept only solutions within the joint limits.

    Returns
    -------
    (n,) array
        Configuration, rad or m.

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
    """Solve the inverse kinematics as :func:`solve_ik` does, but only from the start q0 (n,).

    So the solution is near q0, as needed from point to point of a path. ``tolerance`` is the norm
    of the task error, m and rad, at which Newton's method stops; ``limits`` is True to accept only
    a solution within the joint limits.

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
    """Yield the 41 starts (n,) of :func:`solve_ik`: q0, then 40 towards random configurations.

    Start k is at the fraction k / 40 of the line from q0 to a random configuration of its own.
    Starts near q0 come first, because they lead to solutions near q0.
    """
    yield q0
    count = _STARTS - 1
    ends = random_configurations(task, count, np.random.default_rng(0))
    for k, end in enumerate(ends, 1):
        yield q0 + k / count * (end - q0)


def _newton(task: Task, q0: Array, target: pin.SE3, tolerance: float, iterations: int) -> _Attempt:
    """Run Newton's method from one start q0 (n,), and return where it ends, solved or not.

    Steps are ``J⁺ e`` with the task error e, of bounded length. The method ends at an error below
    ``tolerance``, after ``iterations`` steps, or at a singularity; in the last case, q0 is returned
    with the error at the singularity.
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

    With ``limits``, prismatic joints stay within their limits; otherwise their stroke is unlimited.
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
    """Format a task error (m,) for a message: the distance, m, and the angle, rad.

    The angle is left out if its value in rad is at most that of the distance in m.
    """
    way = float(np.linalg.norm(error[task.kind.linear]))
    angle = float(np.linalg.norm(error[~task.kind.linear]))
    return f"{way:.3g} m" if way >= angle else f"{way:.3g} m and {angle:.3g} rad"


def reach_start(task: Task, q0: ArrayLike, path: TaskPath) -> Array:
    """Solve for a configuration at the first point of a path; q0 (n,) if it is there already.

    Raises
    ------
    InputError
        If no solution is found, or only solutions outside the joint limits; for a path with named
        corners, the message names the corner.
    """
    q = np.asarray(q0, float)
    if np.linalg.norm(task.error(q, path.placement(0.0))) <= _THERE:
        return q
    try:
        return solve_ik(task, q, path.placement(0.0))
    except InputError as error:
        raise _with_corner(error, task, q, q, path, 0.0) from None


def check_reach(task: Task, q0: ArrayLike, path: TaskPath) -> None:
    """Raise InputError if the frame cannot follow a path, without regard to joint limits.

    The corners and 48 more points are solved one after another, beginning at q0 (n,). The message
    is on the first point without a solution; for a path with named corners, it names the corner.
    """
    q = start = np.asarray(q0, float)
    for s in _tested(path):
        try:
            q = solve_near(task, q, path.placement(float(s)), tolerance=_THERE)
        except InputError as error:
            raise _with_corner(error, task, start, q, path, float(s)) from None


def is_reached(task: Task, path: TaskPath, Q: Array) -> bool:
    """Test whether the points of :func:`check_reach` have solutions near a motion along the path.

    The rows of Q (T + 1, n) are configurations near the path, at equal steps of its parameter from
    0 to 1. All points are solved at once, each from the row that is nearest in the parameter. True
    means that Newton's method solves every point and moves no joint by more than 0.3 rad or m.
    """
    s = _tested(path)
    near = Q[np.rint(s * (len(Q) - 1)).astype(int)]
    targets = [path.placement(float(one)) for one in s]
    usual = Pseudoinverse(task)

    def correction(Q: Array, rows: NDArray[np.intp]) -> Array:
        errors = task.errors(Q, [targets[k] for k in rows])
        return np.asarray(np.einsum("Kij,Kj->Ki", usual.batch(Q), errors))

    try:
        Q, _ = newton_rows(
            correction, near, longest=_STEP, tolerance=_THERE / 10, iterations=_REFINED
        )
    except SingularityError:
        return False
    left = np.linalg.norm(task.errors(Q, targets), axis=1)
    return bool((left < _THERE).all() and np.abs(Q - near).max() <= _STEP)


def _tested(path: TaskPath) -> Array:
    """Return the parameters, 0 to 1, of the points that are tested: the corners and 48 more."""
    return np.union1d(np.linspace(0, 1, _POINTS), path.breaks)


def _with_corner(
    error: InputError, task: Task, start: Array, q: Array, path: TaskPath, s: float
) -> InputError:
    """Return an error, extended by the path's name, the corner at or after s, and a remedy.

    ``error`` is raised at the path parameter s, 0 to 1. ``start`` (n,) is the start of the path and
    ``q`` (n,) the last configuration on it. For a path without named corners, the error is returned
    unchanged.
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
    """Return the end of an error message: a question on a likely mistake in the waypoints.

    If the waypoints are far from the base, but in reach when read as mm, the text asks whether they
    are in mm. If the first waypoint is 0, and all are in reach when counted from the start, the
    text asks whether they are counted from the start. Otherwise, the text is empty. ``start`` (n,)
    is the start configuration, and ``knots`` are the values of the path parameter s at the corners
    and both ends.
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
    """Test whether Newton's method reaches all points (K, 3), m, each of them from q (n,).

    The ``points`` are positions of the frame, such as the waypoints of the path in other units. The
    orientation of the frame is that at the start of the path.
    """
    rotation = path.placement(0.0).rotation
    return not any(_shortfall(task, q, pin.SE3(rotation, point)) for point in points)


def _shortfall(task: Task, q: Array, target: pin.SE3) -> str:
    """Solve for a target from q (n,); return the solver's error message, empty if solved."""
    try:
        solve_near(task, q, target, tolerance=_THERE)
    except InputError as error:
        return str(error)
    return ""


def random_configurations(task: Task, count: int, rng: np.random.Generator) -> Array:
    """Sample configurations (count, n), uniform between the joint limits.

    Instead of a missing limit, the bound is π rad (m) from the task's reference configuration.
    """
    low = np.where(np.isfinite(task.lower), task.lower, task.reference - np.pi)
    high = np.where(np.isfinite(task.upper), task.upper, task.reference + np.pi)
    return low + (high - low) * rng.random((count, task.n))


def _longest_reach(task: Task, *, limits: bool = True) -> tuple[Array, float]:
    """Compute an upper bound on the distance of the frame from the chain's first joint.

    The bound adds the distances from joint to joint, that from the last joint to the frame, and the
    largest strokes of prismatic joints, which are infinite if ``limits`` is False.

    Returns
    -------
    center : (3,) array
        Origin of the first joint at position 0, m, in the base frame.
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
