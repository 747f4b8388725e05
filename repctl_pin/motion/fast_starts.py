"""Random starts on a path, ranked by the joint speed that J⁺ needs from them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..model.chain_formulas import Placement
from ..model.task import Task
from ..paths.task_path import TaskPath
from ..solvers import newton_rows
from .solve_ik import random_configurations

_STARTS, _STEPS = 96, 16
"""Numbers of random configurations, and of points per cycle."""

_LONGEST, _EXACT = 0.4, 1e-9
"""Longest step of any joint, and the task error at which a pose is reached; m or rad."""

_ITERATIONS, _CORRECTIONS = 40, 2
"""Maximum numbers of Newton steps to the path, and from each point of it to the next one."""

_JUMP = 1.0
"""Change of a joint between two points, rad or m, at which a motion is given up."""

_APART = 0.3
"""Smallest norm of the difference of two starts, rad or m."""


def fast_starts(
    task: Task, path: TaskPath, count: int, *, margin: float, seed: int
) -> list[Array]:
    """Find starts (n,) from which J⁺ follows one cycle of a path with low joint speed.

    The inverse kinematics of the first point is solved from random configurations, so the starts
    belong to all self-motions of that pose, also to those that no walk from another start reaches.

    Parameters
    ----------
    task
        Redundant task.
    path
        Closed path.
    count
        Maximum number of starts; the first has the lowest joint speed.
    margin
        Joint-limit margin that the motion must have, rad or m.
    seed
        Random seed of the configurations.
    """
    random = random_configurations(task, _STARTS, np.random.default_rng(seed))
    first = path.placement(0.0)
    Q = _reached(task, random, first, _ITERATIONS)
    Q = Q[_inside(task, Q, first, margin)]
    starts, energy = Q, np.zeros(len(Q))
    for s in np.linspace(0, 1, _STEPS + 1)[1:]:
        target = path.placement(float(s))
        ahead = _reached(task, Q, target, _CORRECTIONS)
        on = np.abs(ahead - Q).max(axis=1, initial=0.0) < _JUMP
        on &= _inside(task, ahead, target, margin, near=1e-2)
        energy = (energy + ((ahead - Q) ** 2).sum(axis=1))[on]
        starts, Q = starts[on], ahead[on]
    kept: list[Array] = []
    for q in starts[np.argsort(energy)]:
        if len(kept) < count and all(np.linalg.norm(q - x) > _APART for x in kept):
            kept.append(q)
    return kept


def _reached(task: Task, Q: Array, target: Placement, iterations: int) -> Array:
    """Move configurations Q (K, n) towards a target by Newton steps with J⁺."""

    def correction(Q: Array, on: NDArray[np.intp]) -> Array:
        J = task.jacobians(Q)
        e = task.errors(Q, [target] * len(Q))
        with np.errstate(all="ignore"):
            return np.einsum("Knm,Km->Kn", np.linalg.pinv(J, rcond=1e-6), e)

    if not len(Q):
        return Q
    return newton_rows(
        correction, Q, longest=_LONGEST, tolerance=_EXACT, iterations=iterations
    )[0]


def _inside(
    task: Task, Q: Array, target: Placement, margin: float, *, near: float = 1e-6
) -> NDArray[np.bool_]:
    """Test which configurations Q (K, n) reach a target and have a joint-limit margin."""
    error = np.abs(task.errors(Q, [target] * len(Q))).max(axis=1, initial=0.0)
    return np.asarray(
        (error < near) & (task.limit_margin(Q).min(axis=1, initial=np.inf) >= margin)
    )
