"""Functions over a cell that are given, not optimised: of an arm with locked joints, or of a flood.

The chart has the equations ``f(q) = x(u)`` and ``n_ref(u)ᵀ (q − q_ref(u)) = 0``. If r joints are
locked, the columns of n_ref are unit vectors, one per locked joint, and q_ref has the values of
these joints. So F is exactly the configuration of the arm with r joints locked, at every pose. The
other components of q_ref only begin Newton's method. A flood has one configuration for each node of
a grid of poses. There, q_ref is fitted to these configurations, and n_ref to the null spaces of J.
Letters: n joints, r of them locked, k coordinates u of a pose, K poses.

``CellFit`` holds the arguments of a design over a cell, and the methods that compute the design.
``Chart`` is coordinates (u, s) of configurations: u gives the pose, the label s (r,) the position
along its self-motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ....base.arguments import Array
from ....model.native_kinematics import placed
from ....potentials.polynomial import Polynomial
from ....redundancy import nullspace
from ....strategies.repeatable import RepeatableInverse
from ..cell_design_result import CellDesign
from ..chart.chart import Chart
from ..evaluate.reach import rays
from ..evaluate.symmetric_coordinates import centred
from ..geometry.cell import Cell
from ..geometry.kinematics import null_bases
from .cell_fit import CellFit

_RAYS, _DENSE = 256, 512
"""Numbers of poses to which the arm moves from the middle, and to which q_ref is fitted."""

_FIRST, _DEGREE = 4, 8
"""Degrees of q_ref, fitted to the ends of these motions, and of q_ref in the end."""

_THROUGH = 5
"""Degree of the polynomials of a function through the nodes of a flood."""

_MOST = 0.5
"""Smallest share of the motions that must reach their pose."""


def locked_function(fit: CellFit, cell: Cell, q: Array, joints: Sequence[int]) -> CellDesign | None:
    """Make the function of an arm with locked joints, and evaluate it as other designs.

    The r ``joints``, given by their indices, have the values of q (n,), a configuration near the
    middle of the cell. Extra joint speed is relative to the desired inverse of ``fit``. The
    evaluation is quick. Return None if the arm reaches less than half of the cell from there, or if
    no range of an angle or spin is left.
    """
    task = cell.task
    # the inverse whose motions keep the locked joints constant
    held = RepeatableInverse(task, Polynomial(q, 1, variables=joints).weighted(np.eye(task.r)))
    U = np.concatenate([cell.sample(_RAYS, fit.seed + 1), cell.corners()])
    ends = rays(held, cell, q, U)
    good = ends.reached == 1
    if good.mean() < _MOST:
        return None
    chart = _chart(cell, U[good], ends.Q[good], q, joints, _FIRST)
    points = chart.solve(cell._dense_at_edges(_DENSE, 7))
    U, Q = points.U[points.found], points.Q[points.found]
    if len(U) < _MOST * len(points.U):
        return None
    return _evaluated(fit, _chart(cell, U, Q, q, joints, _DEGREE), 0, len(U))


def function_through(fit: CellFit, cell: Cell, Q: Array) -> CellDesign | None:
    """Make the function through given configurations Q (K, n) at poses of a cell, and evaluate it.

    The polynomials, of degree 5, are fitted to Q, so that the function is near Q but not exactly Q.
    Values of Q that differ by a symmetry, the angle around the arm and the spin of the tool, are
    equal here. The evaluation is quick. Return None if no range of an angle or spin is left.
    """
    p, R, J = placed(cell.task, Q)
    Q = Q - cell._measured(p, R)[:, cell._removed] @ cell.along.T
    p, R, J = placed(cell.task, Q)
    N = nullspace(J[len(J) // 2])
    N = null_bases(J, np.broadcast_to(N, (len(J), *N.shape)))
    chart = Chart.fitted(cell, cell.coordinates(p, R)[0], Q, N, _THROUGH)
    return _evaluated(fit, chart, _THROUGH, len(Q))


def _evaluated(fit: CellFit, chart: Chart, degree: int, samples: int) -> CellDesign | None:
    """Evaluate the function s = 0 of a chart, which ``samples`` configurations determined.

    ``degree`` is that of its polynomials, 0 for locked joints. Return None if no range of an angle
    or spin is left.
    """
    chart, turns = centred(chart)
    if any(turn.reach <= 0 for turn in turns):
        return None
    degrees = ((degree, np.nan),)
    found = fit.evaluated(chart, turns, degrees=degrees, samples=samples, steps=0, quick=True)
    return replace(found, degrees=((degree, found.cost),))


def _chart(cell: Cell, U: Array, Q: Array, q: Array, joints: Sequence[int], degree: int) -> Chart:
    """Fit the reference q_ref to configurations Q (K, n) at U (K, k), with joints locked.

    ``joints`` are the indices of the locked joints; each is locked at its value in q (n,).
    ``degree`` is the degree of the polynomials q_ref. The columns of n_ref are the unit vectors of
    the locked joints, so F holds these joints constant.
    """
    N = np.eye(cell.task.n)[:, joints]
    chart = Chart.fitted(cell, U, Q, np.broadcast_to(N, (len(Q), *N.shape)), degree)
    # without the rounding of the fit
    exact = chart.coefficients.copy()
    exact[:, joints, 0] = exact[:, :, 1:] = 0.0
    exact[0, joints, 0], exact[0, :, 1:] = q[joints], N
    return replace(chart, coefficients=exact)
