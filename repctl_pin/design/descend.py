"""From a linear start to the optimum: Gauss–Newton on subspaces, over whatever holds the
batches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ..arguments import Array, read_only
from . import criterion
from .batches import Batches
from .criterion import SignCount

Report = Callable[[int, float], None]

_MAX_STEPS = 100
_STILL = 3
_HALVINGS = 20
_DAMPING, _LEAST_DAMPING = 1e-4, 1e-7
_EMPHASIS = (1.0, 0.1, 0.01)


@dataclass(frozen=True, eq=False)
@read_only
class Descent:
    """Where an optimisation ended.

    Attributes
    ----------
    A : (N, r) array
        The coefficients.
    cost, gradient_norm : float
        On the nodes of the fit; the norm in coordinates orthonormal over Ω, of the part that moves
        span A.
    converged : bool
        Gauss–Newton predicts no further relative decrease above the tolerance, or three steps
        brought none.
    steps : int
    sides : SignCount
        Of the nodes; ``sides.uniform`` unless there is an algorithmic singularity.
    """

    A: Array
    cost: float
    gradient_norm: float
    converged: bool
    steps: int
    sides: SignCount


@dataclass(frozen=True, eq=False)
@read_only
class Start:
    """Where a descent begins, and the penalty that keeps it near the null space's own potentials.

    Attributes
    ----------
    A : (N, r) array
    sides : SignCount
        Not ``uniform`` if there is an algorithmic singularity.
    cost : float
    EE, null_alignment : (N, N), (N, r) arrays
        ``mean EᵀE`` and ``mean Eᵀ NᵀN(center)``: the penalty's Hessian and right side.
    """

    A: Array
    sides: SignCount
    cost: float
    EE: Array
    null_alignment: Array


def start(batches: Batches, basis: Array, moments: tuple[Array, Array, Array]) -> Start:
    """Solve the linear problem that brings V closest to the null space's own potentials.

    ``min_A mean ε ‖F A‖² + ‖E A − Nᵀ N(center)‖²``: V should be N R with R = Nᵀ N(center), a smooth
    gauge, and have no part along G_d. ε = 1, or less where that runs into an algorithmic
    singularity.

    Parameters
    ----------
    batches
        The nodes.
    basis : (N', N') array
        Coordinates of the first N' potentials, which are all that is used.
    moments
        The sums of :func:`criterion.linear` over all potentials.
    """
    size = len(basis)
    EE, FF, null_alignment = moments[0][:size, :size], moments[1][:size, :size], moments[2][:size]
    found = None
    for emphasis in _EMPHASIS:
        A = basis @ _solve(basis.T @ (EE + emphasis * FF) @ basis, basis.T @ null_alignment)
        cost, sides = batches.total(criterion.cost, A)
        found = found or Start(A, sides, cost, EE, null_alignment)
        if sides.uniform:
            return Start(A, sides, cost, EE, null_alignment)
    assert found is not None
    return found


def descend(
    batches: Batches,
    basis: Array,
    begin: Start,
    A: Array,
    *,
    penalty: float,
    tolerance: float,
    report: Report,
) -> Descent:
    """Gauss–Newton with Levenberg's damping, and a line search that keeps det(Nᵀ V) of one sign.

    What is minimised is ``C(A) + τ mean ‖E A − Nᵀ N(center)‖²`` with τ = ``penalty`` · C(start) /
    r. C alone is blind to ``A → A T``, and all but blind to functions of a joint that the task
    ignores and to leaves relabelled, h → φ(h): a fit to finitely many nodes wanders along those
    into a singularity between the nodes. Of all V of next to the same cost the penalty takes the
    one closest to the null space's own potentials.

    In the coordinates C = B⁻¹ A, in which the potentials' gradients are orthonormal over Ω, the
    step solves ``(H + τ mean EᵀE + μ I) dC = −g``; μ falls where Gauss–Newton predicts the decrease
    and rises where not. Nearly dependent potentials have a large B, and the rounding of ``Bᵀ H B``
    then sets the smallest μ."""
    r = A.shape[1]
    EE, null_alignment = basis.T @ begin.EE @ basis, basis.T @ begin.null_alignment
    tau = penalty * begin.cost / r

    def closeness(C: Array) -> float:
        return tau * float(np.sum(C * (EE @ C)) - 2 * np.sum(C * null_alignment))

    def evaluate(C: Array) -> tuple[float, float, Array, Array, SignCount]:
        cost, gradient, matrix, sides = batches.total(criterion.gauss_newton, basis @ C)
        return (
            cost + closeness(C),
            cost,
            basis.T @ gradient + tau * (EE @ C - null_alignment),
            matrix,
            sides,
        )

    def shorter(C: Array, dC: Array, total: float, predicted: float) -> float:
        """Halve a step until it lowers the cost and det(Nᵀ V) keeps its sign; 0 if no length
        does."""
        for length in 0.5 ** np.arange(1, _HALVINGS):
            trial = C + length * dC
            value, around = batches.total(criterion.cost, basis @ trial)
            if around.uniform and value + closeness(trial) < total - 1e-4 * length * predicted:
                return float(length)
        return 0.0

    C = scipy.linalg.solve_triangular(basis, A)
    size = len(C)
    total, cost, gradient, matrix, sides = evaluate(C)
    converged, steps, still, norm = False, 0, 0, 0.0
    damping, least = _DAMPING, _LEAST_DAMPING
    for steps in range(_MAX_STEPS):
        report(steps, cost)
        g = gradient.T.ravel()  # (r N,)
        norm = 2 * float(np.linalg.norm(g))
        if cost <= 1e-14 * begin.cost or cost < 1e-26:
            converged = True
            break
        H = np.block(
            [
                [
                    basis.T @ matrix[i, :, j, :] @ basis + (tau * EE if i == j else 0.0)
                    for j in range(r)
                ]
                for i in range(r)
            ]
        )
        H, step, used = _damped_step(H, g, damping)
        if used > damping:
            damping = least = used
        predicted = -2 * float(g @ step) - float(step @ (H @ step))
        if predicted <= tolerance * cost:
            if damping <= least:
                converged = True
                break
            damping = max(
                damping / 100, least
            )  # stop only where an undamped step predicts nothing either
            continue
        dC = step.reshape(r, size).T
        found = evaluate(C + dC)  # the full step is usually taken: its matrix at once
        length = (
            1.0
            if found[4].uniform and found[0] < total - 1e-4 * predicted
            else shorter(C, dC, total, predicted)
        )
        if not length:
            break
        if length < 1.0:
            found = evaluate(C + length * dC)
        gain = (total - found[0]) / predicted
        still = still + 1 if abs(cost - found[1]) <= tolerance * cost else 0
        damping = float(
            np.clip(damping * (0.2 if gain > 0.5 else 1 if gain > 0.2 else 5), least, 1.0)
        )
        C = C + length * dC
        total, cost, gradient, matrix, sides = found
        if still == _STILL:  # only the penalty still falls, among V of equal cost
            converged = True
            break
    return Descent(basis @ C, cost, norm, converged, steps, sides)


def _damped_step(H: Array, g: Array, damping: float) -> tuple[Array, Array, float]:
    """Solve ``(H + μ I) x = −g``, with μ raised until the matrix is positive definite.

    Returns
    -------
    matrix : (N, N) array
        H + μ I.
    step : (N,) array
    damping : float
        μ / mean(diag H): at least what was asked for.
    """
    level = max(float(np.trace(H)) / len(g), 1e-300)
    while True:
        matrix = (H + H.T) / 2
        matrix[np.diag_indices_from(matrix)] += damping * level
        try:
            factor = scipy.linalg.cho_factor(matrix)
        except np.linalg.LinAlgError:
            damping *= 10
        else:
            return matrix, -scipy.linalg.cho_solve(factor, g), damping


def _solve(matrix: Array, rhs: Array) -> Array:
    """Solve a symmetric positive semidefinite system in the least-norm sense."""
    values, vectors = np.linalg.eigh(matrix)
    keep = values > 1e-13 * values[-1]
    return vectors[:, keep] @ ((vectors[:, keep].T @ rhs) / values[keep, None])
