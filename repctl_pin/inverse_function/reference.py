"""The reference section: from the middle posture along the straight rays of a cell, under the
desired control."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arguments import Array, read_only
from ..redundancy import nullspace
from ..strategies.strategy import Batched
from .cell import Cell
from .chart import Chart
from .kinematics import bases, placed
from .monomials import Monomials

_STEP = 0.5
"""A joint step, rad or m, from one point of a ray to the next, that means that the arm has lost the
path."""

SINGULAR = 0.01
"""σ_min / σ_max of J at which a ray ends."""


@dataclass(frozen=True, eq=False)
@read_only
class Rays:
    """Ends of the rays from the middle of a cell.

    Attributes
    ----------
    U, Q, N : (K, k), (K, n) and (K, n, r) arrays
        Where they end, the joints there, and the null space carried along.
    reached : (K,) array
        The part of the way that each has come: 1 where it ended well.
    least : (K,) array
        The least joint-limit margin on the way, rad or m.
    """

    U: Array
    Q: Array
    N: Array
    reached: Array
    least: Array


def rays(desired: Batched, cell: Cell, q_middle: Array, U: Array, *, steps: int = 16) -> Rays:
    """Drive the arm from the middle posture along straight rays to U (K, k), by ``Δq = G_d (x_next
    − f(q))``.

    All rays at once. Each ray by itself is repeatable, as there is but one way along it.

    Parameters
    ----------
    desired
        G_d.
    cell, q_middle
        The cell, and the joints (n,) in its middle.
    U : (K, k) array
    steps
        Points on each ray.
    """
    task, K = cell.task, len(U)
    Q = np.tile(q_middle, (K, 1))
    N = np.tile(nullspace(task.jacobian(q_middle)), (K, 1, 1))
    reached, least = np.zeros(K), np.full(K, np.inf)
    on = np.arange(K)
    for ahead in [*np.linspace(0, 1, steps + 1)[1:], 1.0, 1.0, 1.0]:
        p, R, J = placed(task, Q[on])
        _, N[on], s = bases(J, N[on])
        least[on] = np.minimum(least[on], task.limit_margin(Q[on]).min(axis=1))
        good = s[:, -1] > SINGULAR * s[:, 0]
        on, p, R, J = on[good], p[good], R[good], J[good]
        if not len(on):
            break
        error = cell.errors(*cell.placements(U[on] * ahead), p, R)
        dQ = np.einsum("Knm,Km->Kn", desired.batch(Q[on], J), error)
        good = np.abs(dQ).max(axis=1) < _STEP
        on = on[good]
        Q[on] += dQ[good]
        reached[on] = ahead
    p, R, _ = placed(task, Q)
    missed = np.abs(cell.errors(*cell.placements(U), p, R)).max(axis=1) > 1e-6
    reached[missed] = np.minimum(reached[missed], 1 - 1 / steps)
    return Rays(U, Q, N, reached, least)


def fitted(cell: Cell, U: Array, Q: Array, N: Array, degree: int) -> Chart:
    """Fit a chart to joints Q (K, n) and null spaces N (K, n, r) at U (K, k)."""
    monomials = Monomials(cell.k, degree)
    return Chart(cell, monomials, monomials.fit(U, np.concatenate([Q[:, :, None], N], axis=2)))
