"""Check of one closed path: can it be shrunk to its start through paths that close?

A leaf is the set {q : h(q) = c} of the potentials h, and c its level. J_V is the task Jacobian
stacked on the potentials' gradients; where it is regular, pose and level determine the
configuration locally. The straight lines from the start pose to the poses of the path form a
surface, a cone. If J_V is regular along all these lines, each pose of the cone has one
configuration on the leaf. Shrinking the path within the cone to the start then shows that the path
closes. n is the number of joints.

``ClosedPath`` is a closed path as a function of s, which goes from 0 to 1 in a cycle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import Array, require_type, vector
from ...base.errors import InputError, SingularityError
from ...model.task import Task
from ...motion import LeafLock, follow
from ...motion.follow import path_grid
from ...paths import ClosedPath
from ...paths.task_path import TaskPath, closed_path
from ...strategies.repeatable import RepeatableInverse

_RAYS, _STEPS = 120, 4
"""Number of rays of the cone, and of steps of the motion from one to the next."""

_LOCK = LeafLock(corrections=4)
"""Corrections of each step, so that it ends in the solution also where an edge is long."""

_SAME = 1e-6
"""Difference, rad or m, up to which two configurations are one."""


@dataclass(frozen=True)
class PathCertificate:
    """Result of :func:`path_certificate`; ``bool(result)`` is :attr:`shrinks`.

    A ray is the motion along the straight line from the start pose to a pose of the path.

    Attributes
    ----------
    shrinks : bool
        True if every ray that was checked ends in the configuration that the motion along the path
        has at the same pose; that motion then closes.
    gap : float
        Largest joint difference between end and start of the motion, rad or m; NaN if the motion
        stops early.
    mismatch : float
        Largest joint difference between the end of a ray and the motion at the same pose, rad or m;
        NaN if a ray or the motion stops early.
    reason : str
        Why the path cannot be shrunk; empty if it can.
    poses : int
        Number of poses of the path at which rays were checked.

    Examples
    --------
    >>> found = rp.path_certificate(design.inverse, path, q0)
    >>> bool(found), found.gap < 1e-6
    (True, True)
    """

    shrinks: bool
    gap: float
    mismatch: float
    reason: str
    poses: int

    def __bool__(self) -> bool:
        return self.shrinks

    def __repr__(self) -> str:
        return f"<PathCertificate: {self.words}>"

    @property
    def words(self) -> str:
        """Sentence that says whether the path closes, and why or why not."""
        if self.shrinks:
            checked = f"checked at {self.poses} poses, not proved"
            return f"the path can be shrunk to its start, so it closes: {checked}"
        return f"the path need not close: {self.reason}"


def path_certificate(
    inverse: RepeatableInverse, path: ClosedPath, q0: ArrayLike
) -> PathCertificate:
    """Check whether a closed path can be shrunk to its start, and so closes.

    A ray is the straight line ``x₀ + λ (x(s) − x₀)``, 0 ≤ λ ≤ 1, from the start pose x₀ to a pose
    x(s) of the path. Along a ray, the frame rotates from one orientation to the other about one
    axis. The arm follows each ray on the leaf of q0, on which the potentials are constant. Let J_V
    be the task Jacobian stacked on the gradients of the potentials. If J_V is regular on all rays,
    and each ray ends in the configuration of the motion along the path at x(s), that motion closes:
    with λ → 0, the paths ``x₀ + λ (x(s) − x₀)`` shrink to a point. Only rays to some 120 poses, all
    corners included, are checked, so this is no proof. Paths around the base, or around a
    singularity, cannot be shrunk.

    Parameters
    ----------
    inverse
        Repeatable inverse, such as ``design.inverse``.
    path
        Closed path.
    q0 : (n,) array
        Configuration at the beginning of the path, rad (m for prismatic joints).

    Returns
    -------
    PathCertificate

    Raises
    ------
    InputError
        If q0 is not at the beginning of the path.

    Examples
    --------
    >>> rp.path_certificate(design.inverse, path, q0).words
    'the path can be shrunk to its start, so it closes: checked at 121 poses, not proved'
    """
    require_type(inverse, RepeatableInverse, "inverse", "a repeatable inverse: design.inverse")
    require_type(path, ClosedPath, "path", "a closed path, such as rp.circle(task, q0)")
    path = closed_path(path)
    q0 = vector(q0, inverse.task.n, "q0")
    _require_start(inverse.task, path, q0)
    # Rays end at the very values of s at which the motion is known, the corners among them.
    grid = path_grid(path, _RAYS * _STEPS)
    ends = np.union1d(np.arange(0, len(grid), _STEPS), np.searchsorted(grid, [*path.breaks, 1.0]))
    count = len(ends)
    try:
        motion = follow(inverse, path, q0, cycles=1, steps=_RAYS * _STEPS, integrator=_LOCK)
    except SingularityError as error:
        why = f"the motion stops at a singularity ({error})"
        return PathCertificate(False, np.nan, np.nan, why, count)
    along = motion.q[ends]
    gap = float(np.abs(along[-1] - along[0]).max())
    try:
        reached = _ray_ends(inverse, path, grid[ends], along[0])
    except InputError as error:
        return PathCertificate(False, gap, np.nan, str(error), count)
    away = np.abs(reached - along).max(axis=1)
    worst = int(away.argmax())
    mismatch, at = float(away[worst]), float(grid[ends[worst]])
    if mismatch <= _SAME:
        return PathCertificate(True, gap, mismatch, "", count)
    where = (
        f"the straight line to {at:.0%} of the path ends {mismatch:.2g} {inverse.task.unit} away"
    )
    why = f"{where} from the motion, so the path encloses a singularity, or the base"
    return PathCertificate(False, gap, mismatch, why, count)


def _require_start(task: Task, path: TaskPath, q0: Array) -> None:
    """Raise InputError unless q0 (n,) is at the beginning of the path."""
    off = np.abs(task.error(q0, path.placement(0.0))).max()
    if off > _SAME:
        raise InputError(
            f"q0 is {off:.2g} m or rad away from the start of the path",
            remedy="solve for q0 with rp.solve_ik, or let the path begin at q0",
        )


def _ray_ends(inverse: RepeatableInverse, path: TaskPath, shares: Array, q0: Array) -> Array:
    """Follow the straight lines from the pose of q0 (n,) to P poses x(s) of a path, on a leaf.

    The leaf is that of q0, where every line begins. ``shares`` (P,) are the values of s, from 0 to
    1. Return the configurations (P, n) at the ends of the lines. If the arm cannot follow a line to
    its end, the InputError states s in percent.
    """
    reached = []
    for s in shares:
        try:
            reached.append(inverse.solve(path.placement(s % 1.0), q0))
        except InputError as error:
            raise InputError(
                f"the arm cannot follow the straight line from q0 to the pose at {s:.0%} of the "
                f"path ({error})",
                remedy="use a smaller path, or another start",
            ) from None
    return np.array(reached)
