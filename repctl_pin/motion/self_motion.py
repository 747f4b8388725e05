"""Walks along the self-motions of a configuration, during which the frame stays at rest.

The self-motions of a redundant arm have r = n − m dimensions. A walk is a sequence of
configurations of one self-motion, a step apart. Searches for a better start use walks.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from ..base.arguments import Array
from ..base.errors import InputError, SingularityError
from ..model.chain_formulas import Placement
from ..model.length import joint_scale
from ..model.task import Task
from ..redundancy import nullspace
from .solve_ik import solve_near


def self_motions(
    task: Task,
    start: Array,
    target: Placement,
    directions: Iterable[Array],
    stride: float,
    *,
    limits: bool = True,
) -> Iterator[Iterator[Array]]:
    """Walk along the self-motions of a start, up to a joint limit or a full turn.

    Yields one iterator of configurations (n,) per walk.

    Parameters
    ----------
    task
        Task that holds the frame.
    start : (n,) array
        Configuration with the frame at the target; the walks do not contain it.
    target
        Placement of the frame.
    directions
        Null vectors (n,) at the start; there is a walk along each, and one against it.
    stride
        Length of a step, rad; for prismatic joints in arm lengths.
    limits
        True if a walk ends at a joint limit; otherwise it continues beyond the limit.
    """
    for direction in directions:
        for sign in (1.0, -1.0):
            yield _walk(task, start, target, sign * direction, stride, limits)


def _walk(
    task: Task, q: Array, target: Placement, along: Array, stride: float, limits: bool
) -> Iterator[Array]:
    """Generate the configurations (n,) of a walk along one self-motion, in one direction.

    ``along`` (n,) is the first direction; each step goes along its projection onto the null space.
    ``stride`` is the length of a step, rad; for prismatic joints in arm lengths. The walk ends
    after a full turn (2π), at a joint limit if ``limits`` is True, or where the direction leaves
    the null space. ``target`` is the placement of the frame.
    """
    L = joint_scale(task, q)
    for _ in range(int(2 * np.pi / stride)):
        N = nullspace(task.jacobian(q))
        along = N @ (N.T @ along)
        size = np.linalg.norm(along / L)
        if size < 1e-6:
            return
        following = self_moved(task, q, stride * along / size, target, limits=limits)
        if following is None:
            return
        q, along = following, following - q
        yield q


def self_moved(
    task: Task, q: Array, step: Array, target: Placement, *, limits: bool = True
) -> Array | None:
    """Return the configuration (n,) one step along a self-motion, with the frame at the target.

    Return None if there is no such configuration near q + step, or if it is outside the joint
    limits and ``limits`` is True. A step along the null space changes the pose in second order,
    which Newton's method corrects.
    """
    try:
        return solve_near(task, q + step, target, tolerance=1e-11, limits=limits)
    except (InputError, SingularityError):
        return None
