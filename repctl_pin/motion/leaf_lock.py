"""Leaf lock: Newton steps from point to point of a path, on a leaf h(q) = c.

A leaf is the set of configurations on which the potentials h keep the level c. A repeatable inverse
stays on its leaf up to integration errors; the leaf lock removes these errors in each step. The
path parameter s runs from 0 to 1 in each cycle. The damping λ limits joint speeds near
singularities, and is 0 elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array, as_int, freeze, per_joint, positive, read_only, vector
from ..model.chain_formulas import Placement
from ..strategies import RepeatableInverse

_MOST_CORRECTIONS = 1000
"""Maximum number of corrections per step; Newton's method has converged after a handful."""

Advance = Callable[[int, Array], tuple[Array, Array, float]]
"""Function (step of the cycle, q) → (next q, q̇ at the start of the step, damping used); on a leaf,
q̇ is the mean over the step."""


@dataclass(frozen=True, eq=False)
@read_only
class LeafLock:
    """Leaf lock for :func:`follow`: Newton corrections of the task error and of c − h(q).

    Each correction is ``q += J_V⁻¹ [x − f(q); c − h(q)]``, so errors do not accumulate from point
    to point of the path. f(q) is the pose of the frame, and x the next point. h(q) are the
    potentials of the repeatable inverse, and c is their level. J_V = [J; Vᵀ], with V = ∂hᵀ/∂q.

    Attributes
    ----------
    corrections : int
        Number k of Newton corrections per step. For short steps, the remaining error is
        proportional to the step length to the power ``2ᵏ``. This error does not accumulate.
    leaf : (r,) array, optional
        Level c; by default h(q0).
    velocity_limit : float or (n,) array, optional
        Joint speed limits, rad/s or m/s. A step that would exceed them is shortened, and so does
        not reach its point of the path. By default, there are no limits.
    damping : float
        Maximum damping λ_max near singularities, in the units of J. Damped steps are shorter, and
        so not exact. With 0, the default, a SingularityError is raised at a singularity.

    Raises
    ------
    InputError
        If a number is out of its range.

    Examples
    --------
    >>> lock = rp.LeafLock(corrections=2)
    >>> motion = rp.follow(design.inverse, path, q0, cycles=3, steps=100, integrator=lock)
    >>> bool(motion.drift[-1] < 1e-6)  # rad
    True
    """

    corrections: int = 1
    leaf: ArrayLike | None = None
    velocity_limit: ArrayLike | None = None
    damping: float = 0.0

    def __post_init__(self) -> None:
        corrections = as_int(self.corrections, "corrections", 1, _MOST_CORRECTIONS)
        damping = positive(self.damping, "damping", zero=True)
        freeze(self, corrections=corrections, damping=damping)


def locked_steps(
    strategy: RepeatableInverse,
    targets: Sequence[Placement],
    grid: Array,
    q: Array,
    period: float,
    lock: LeafLock,
) -> Advance:
    """Create the function that steps from point to point of a path on the leaf h(q) = c.

    That function maps (step of the cycle, q) to (next q, q̇, damping λ), where q̇ is the mean
    velocity of the step. A step makes ``lock.corrections`` corrections, see :class:`LeafLock`.

    Parameters
    ----------
    strategy
        Repeatable inverse with the potentials h.
    targets
        Placements on the path at the ends of the steps of a cycle, one more than steps.
    grid : (steps + 1,) array
        Values of s at which the steps of a cycle begin and end.
    q : (n,) array
        Start of the motion; c = h(q), unless ``lock.leaf`` gives another level.
    period : float
        Period of a cycle, s.
    lock
        Options of the leaf lock.
    """
    task = strategy.task
    damping = lock.damping
    ends = targets[1:]
    times = (np.diff(grid) * period).tolist()
    if lock.leaf is None:
        c = strategy.leaf(q)
    else:
        c = vector(lock.leaf, task.r, "the level c = h(q)", "one per potential")
    most = None
    if lock.velocity_limit is not None:
        limit = per_joint(lock.velocity_limit, task.n, "a speed limit")
        most = limit / lock.corrections  # the corrections share it

    def advance(k: int, q: Array) -> tuple[Array, Array, float]:
        start, target, h = q, ends[k], times[k]
        used = 0.0
        for _ in range(lock.corrections):
            if damping:
                step = strategy.damped_step(
                    q, target, h, leaf=c, velocity_limit=most, damping=damping
                )
                q, used = step.q, max(used, step.damping)
            else:
                q = strategy.step(q, target, h, leaf=c, velocity_limit=most)
        return q, (q - start) / h, used

    return advance
