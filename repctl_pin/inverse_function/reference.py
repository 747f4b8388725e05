"""Reference function: configurations along straight rays from the middle of a cell, under the
desired control."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arguments import Array, read_only
from ..redundancy import nullspace
from ..strategies.strategy import Batched
from .cell import Cell
from .chart import Chart
from .kinematics import null_bases, placed
from .monomials import Monomials

_STEP = 0.5
"""Joint step, rad or m, between points of a ray that means that the arm no longer follows it."""

SINGULAR = 0.01
"""σ_min / σ_max of J at which a ray ends."""


@dataclass(frozen=True, eq=False)
@read_only
class Rays:
    """Ends of the rays from the middle of a cell.

    Attributes
    ----------
    U, Q, N : (K, k), (K, n) and (K, n, r) arrays
        Poses of the ends, configurations there, and null-space bases, aligned along each ray.
    reached : (K,) array
        Share of each ray that was followed; 1 is the whole.
    least : (K,) array
        Minimum joint-limit margin on each ray, rad or m.
    """

    U: Array
    Q: Array
    N: Array
    reached: Array
    least: Array


def rays(desired: Batched, cell: Cell, q_middle: Array, U: Array, *, steps: int = 16) -> Rays:
    """Follow straight rays from the middle of a cell to U (K, k), by ``Δq = G_d (x_next − f(q))``.

    All rays are followed at once.

    Parameters
    ----------
    desired
        G_d.
    cell, q_middle
        The cell, and the configuration (n,) in its middle; or one for each ray, (K, n).
    U : (K, k) array
    steps
        Number of points on each ray.
    """
    task, K = cell.task, len(U)
    starts, ray = np.unique(np.broadcast_to(q_middle, (K, task.n)), axis=0, return_inverse=True)
    Q = starts[ray]
    N = np.array([nullspace(task.jacobian(q)) for q in starts])[ray]
    reached, least = np.zeros(K), np.full(K, np.inf)
    on = np.arange(K)
    for ahead in [*np.linspace(0, 1, steps + 1)[1:], 1.0, 1.0, 1.0]:
        p, R, J = placed(task, Q[on])
        N[on], s = null_bases(J, N[on])
        least[on] = np.minimum(least[on], cell.limit_margin(Q[on]).min(axis=1))
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
    """Fit a chart to configurations Q (K, n) and null spaces N (K, n, r) at U (K, k)."""
    monomials = Monomials(cell.k, degree)
    return Chart(cell, monomials, monomials.fit(U, np.concatenate([Q[:, :, None], N], axis=2)))
