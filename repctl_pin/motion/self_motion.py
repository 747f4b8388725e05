"""Walks along the self-motions of a configuration, during which the frame stays at rest.

The self-motions of a redundant arm have r = n − m dimensions. A walk is a sequence of
configurations with the frame at one placement, a step apart. Searches for a better start use walks.
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
    """Yield walks along the self-motions of a start, each at most 2π rad long.

    A walk is an iterator of configurations (n,). Its length is the sum of its steps.

    Parameters
    ----------
    task
        Task whose frame stays at the target.
    start : (n,) array
        Configuration with the frame at the target; the walks do not contain it.
    target
        Placement of the frame.
    directions
        Null vectors (n,) of J at the start; for each, there are two walks, in opposite directions.
    stride
        Length of a step, rad; for prismatic joints in arm lengths.
    limits
        True to end a walk at a joint limit; False to continue beyond it.
    """
    for direction in directions:
        for sign in (1.0, -1.0):
            yield _walk(task, start, target, sign * direction, stride, limits)


def _walk(
    task: Task, q: Array, target: Placement, along: Array, stride: float, limits: bool
) -> Iterator[Array]:
    """Yield the configurations (n,) of one walk from q (n,), with the frame at the target.

    ``stride`` is the length of a step, rad, and ``along`` (n,) the direction of the first; each
    further step continues in the direction of the last one, projected onto the null space. The walk
    ends after a length of 2π rad, at a joint limit if ``limits`` is True, or where there is no next
    step.
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
    """Solve for the configuration (n,) near q + step with the frame at the target.

    ``step`` (n,) is a null vector of J at q, so the pose at q + step differs from the target only
    in second order. Return None if there is no solution, or if it is outside the joint limits and
    ``limits`` is True.
    """
    try:
        return solve_near(task, q + step, target, tolerance=1e-11, limits=limits)
    except (InputError, SingularityError):
        return None
