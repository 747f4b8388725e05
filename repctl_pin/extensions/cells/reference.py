"""Reference function over a cell, obtained by following straight rays from the middle of the cell
with the desired inverse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arguments import Array, read_only
from ...redundancy import nullspace
from ...strategies.strategy import Inverse
from .cell import Cell
from .chart import Chart
from .kinematics import null_bases, placed
from .monomials import Monomials

_STEP = 0.5
"""Joint step, rad or m, between two points of a ray at which following the ray is stopped."""

SINGULAR = 0.01
"""σ_min / σ_max of J at which following a ray is stopped."""


@dataclass(frozen=True, eq=False)
@read_only
class Rays:
    """Results of following K straight rays from the middle of a cell.

    Attributes
    ----------
    U : (K, k) array
        End poses of the rays, in coordinates of the cell.
    Q, N : (K, n) and (K, n, r) arrays
        Last configuration on each ray, and null-space basis there, aligned along the ray.
    reached : (K,) array
        Fraction of each ray that was followed; 1 means that the end pose was reached.
    least : (K,) array
        Minimum joint-limit margin on each ray, rad or m.
    """

    U: Array
    Q: Array
    N: Array
    reached: Array
    least: Array


def rays(
    desired: Inverse, cell: Cell, q_middle: Array, U: Array, *, steps: int = 16
) -> Rays:
    """Follow straight rays from the middle of a cell to poses U (K, k), all rays at once.

    The steps along a ray are ``Δq = G_d (x_next − f(q))``.

    Parameters
    ----------
    desired
        G_d.
    cell, q_middle
        The cell, and the configuration (n,) in its middle; or one configuration per ray, (K, n).
    U : (K, k) array
        End poses of the rays, in coordinates of the cell.
    steps
        Number of points on each ray.
    """
    task, K = cell.task, len(U)
    starts, ray = np.unique(
        np.broadcast_to(q_middle, (K, task.n)), axis=0, return_inverse=True
    )
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
    """Fit a chart: polynomials q_ref to configurations Q (K, n), and n_ref to null-space bases N
    (K, n, r), at the poses U (K, k)."""
    monomials = Monomials(cell.k, degree)
    return Chart(
        cell, monomials, monomials.fit(U, np.concatenate([Q[:, :, None], N], axis=2))
    )
