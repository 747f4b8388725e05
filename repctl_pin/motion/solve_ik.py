"""Inverse kinematics of one placement, for the start of a path."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import MOST_STEPS, Array, as_int, flag, positive, vector
from ..errors import InputError, SingularityError
from ..paths.task_path import TaskPath
from ..redundancy.inverses import pseudoinverse
from ..robot.chain_formulas import Placement, as_placement
from ..robot.length import arm_length
from ..robot.task import Task, require_task
from ..solvers import newton

_THERE = 1e-9
"""Task error, m and rad, below which the frame counts as at a point."""

_STEP = 0.3
"""Longest Newton step of any joint, rad or m."""

_POINTS = 48
"""Number of points of a path that are tested beside its corners."""

_FAR = 10
"""Distance of points, in arm lengths, above which they are presumed to be in mm instead of m."""


def solve_ik(
    task: Task,
    q0: ArrayLike,
    target: Placement,
    *,
    tolerance: float = 1e-12,
    iterations: int = 200,
    limits: bool = True,
) -> Array:
    """Find q near q0 with f(q) at the target, by Newton's method with J⁺ and bounded steps.

    Parameters
    ----------
    task
        Task that places the frame.
    q0 : (n,) array
        Initial configuration, rad (m for prismatic joints).
    target : pinocchio.SE3 or (4, 4) array
        Desired placement of the frame.
    tolerance, iterations
        Maximum task error (m and rad), and maximum number of Newton steps.
    limits
        Refuse a configuration outside the joint limits.

    Returns
    -------
    (n,) array

    Raises
    ------
    InputError
        If the target cannot be reached from there, or only outside the joint limits.

    Examples
    --------
    >>> target = task.placement(q0 + 0.1)
    >>> q = rp.solve_ik(task, q0, target)
    >>> bool(np.abs(task.error(q, target)).max() < 1e-9)  # m
    True
    """
    target = as_placement(target)
    if not np.isfinite(target.homogeneous).all():
        raise InputError("the target must be finite numbers, m and a rotation")
    q = vector(q0, require_task(task).n, "q0")
    tolerance = positive(tolerance, "the tolerance")
    iterations = as_int(iterations, "iterations", 1, MOST_STEPS)
    limits = flag(limits, "limits")
    where = np.array2string(np.asarray(target.translation), precision=3, separator=", ")
    error = task.error(q, target)

    def residual(q: Array) -> float:
        nonlocal error
        error = task.error(q, target)
        return float(np.linalg.norm(error))

    def correction(q: Array) -> Array:
        return pseudoinverse(task.jacobian(q)) @ error

    try:
        found = newton(
            correction,
            q,
            longest=_STEP,
            tolerance=tolerance,
            iterations=iterations,
            residual=residual,
        )
    except SingularityError:
        raise InputError(
            f"{task.frame!r} cannot reach {where} m: the arm ends stretched or folded at a "
            "singularity; move the path nearer"
        ) from None
    assert found is not None  # with a residual there is always a last q
    q, error = found, task.error(found, target)
    if not np.linalg.norm(error) < max(tolerance, _THERE):
        short = np.linalg.norm(error[: min(3, task.m)])
        raise InputError(
            f"{task.frame!r} cannot reach {where} m: it stays {short:.3g} m short; "
            "move the path nearer or choose another start"
        )
    return task.check(q, f"the start that reaches {where} m") if limits else q


def reach_start(task: Task, q0: ArrayLike, path: TaskPath) -> Array:
    """Solve for a configuration at the first point of a path; q0 itself if it is there already.

    Raises
    ------
    InputError
        If the point cannot be reached from q0, or only outside the joint limits.
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
            q = solve_ik(
                task, q, path.placement(float(s)), tolerance=_THERE, limits=False
            )
        except InputError as error:
            raise _with_corner(error, task, start, q, path, float(s)) from None


def _with_corner(
    error: InputError, task: Task, start: Array, q: Array, path: TaskPath, s: float
) -> InputError:
    """Return an error extended by the path's name, its corner near s, and a hint at the cause."""
    if not path.corners:
        return error
    knots = (0.0, *path.breaks, 1.0)
    corner = int(np.searchsorted(knots, s))
    where, what = path.corners[corner], str(error)
    if corner > 0:
        shortfalls = [
            _shortfall(task, near, path.placement(knots[corner])) for near in (q, start)
        ]
        if "" in shortfalls:
            where = f"between {path.corners[corner - 1]} and {where}"
        else:
            what = shortfalls[0]
    return InputError(f"{path.name}, {where}: {what}{_hint(task, start, path, knots)}")


def _hint(task: Task, start: Array, path: TaskPath, knots: tuple[float, ...]) -> str:
    """Suggest a different unit or origin, if the whole path can be reached with it; else empty."""
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
    """Test whether all points (K, 3) can be reached from q, with the path's first orientation."""
    rotation = path.placement(0.0).rotation
    return not any(_shortfall(task, q, pin.SE3(rotation, point)) for point in points)


def _shortfall(task: Task, q: Array, target: pin.SE3) -> str:
    """Explain in text why a target cannot be reached from q; empty if it can."""
    try:
        solve_ik(task, q, target, tolerance=_THERE, limits=False)
    except InputError as error:
        return str(error)
    return ""
