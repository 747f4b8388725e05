"""Fit of the potentials' coefficients: the linear start, and Levenberg–Marquardt steps on
subspaces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ..arguments import Array, read_only
from ..solvers import Damping, Point, Step, levenberg_marquardt
from . import criterion
from .batches import Batches
from .criterion import SignCount

Report = Callable[[int, float], None]

_MAX_STEPS = 100
_STILL = 3
_RULES = Damping(
    first=1e-4,
    smallest=1e-7,
    largest=1.0,
    negligible=0.0,
    good=0.5,
    fair=0.2,
    sufficient=1e-4,
    halvings=20,
)
_EMPHASIS = (1.0, 0.1, 0.01)


@dataclass(frozen=True, eq=False)
@read_only
class Descent:
    """End of an optimisation.

    Attributes
    ----------
    A : (N, r) array
        The coefficients.
    cost, gradient_norm : float
        Cost on the fit nodes, and norm of its gradient in coordinates that are orthonormal over Ω.
    converged : bool
        Whether Gauss–Newton predicts no further relative decrease above the tolerance, or three
        steps brought none.
    steps : int
        Gauss–Newton steps taken.
    sides : SignCount
        Signs of det(Nᵀ V) at the nodes; ``sides.uniform`` without an algorithmic singularity.
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
    """Start of a descent, and the penalty that keeps it near the null space's own potentials.

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
    """Solve the linear problem whose V is closest to the null space's own potentials.

    ``min_A mean ε ‖F A‖² + ‖E A − Nᵀ N(center)‖²``: V should be N R with R = Nᵀ N(center), a smooth
    gauge, and have no part along G_d. ε = 1, or less where that runs into an algorithmic
    singularity.

    Parameters
    ----------
    batches
        The nodes.
    basis : (N', N') array
        Coordinates of the first N' potentials, which alone are used.
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
    """Minimise the penalised cost by Levenberg–Marquardt steps that keep det(Nᵀ V) of one sign.

    What is minimised is ``C(A) + τ mean ‖E A − Nᵀ N(center)‖²`` with τ = ``penalty`` · C(start) /
    r. C alone is blind to ``A → A T``, and all but blind to functions of a joint that the task
    ignores and to leaves relabelled, h → φ(h): a fit to finitely many nodes drifts along those
    into a singularity between the nodes. Among all V of nearly equal cost, the penalty takes the
    one closest to the null space's own potentials.
    """
    problem = _PenalisedCost(batches, basis, begin, penalty)
    found = levenberg_marquardt(
        problem,
        scipy.linalg.solve_triangular(basis, A),
        _RULES,
        steps=_MAX_STEPS,
        tolerance=tolerance,
        patience=_STILL,
        predicted=tolerance,
        enough=max(1e-14 * begin.cost, 1e-26),
        report=report,
    )
    gradient = 0.0 if found.model is None else 2 * float(np.linalg.norm(found.model[0]))
    A, at = basis @ found.at.x, found.at
    return Descent(A, at.cost, gradient, found.converged, found.steps, at.data.sides)


@dataclass(frozen=True, eq=False)
@read_only
class _Evaluated:
    """Sums over the nodes: half the gradient (N, r), the blocks (r, N, r, N) of the Gauss–Newton
    matrix, and the signs of det(Nᵀ V)."""

    gradient: Array
    blocks: Array
    sides: SignCount


class _PenalisedCost:
    """The penalised cost in the coordinates ``C = B⁻¹ A``, in which the potentials' gradients are
    orthonormal over Ω.

    A step solves ``(H + τ mean EᵀE + μ I) dC = −g``. Nearly dependent potentials have a large B,
    and the rounding of ``Bᵀ H B`` then sets the smallest μ.
    """

    def __init__(self, batches: Batches, basis: Array, begin: Start, penalty: float) -> None:
        self.batches, self.basis = batches, basis
        self.r = begin.A.shape[1]
        self.tau = penalty * begin.cost / self.r
        self.EE = basis.T @ begin.EE @ basis
        self.null_alignment = basis.T @ begin.null_alignment

    def evaluate(self, x: Array) -> Point[_Evaluated]:
        """Evaluate the cost, half its gradient and its Gauss–Newton matrix, in one pass."""
        total = self.batches.total(criterion.gauss_newton, self.basis @ x)
        cost, gradient, blocks, sides = total
        merit = cost + self._closeness(x)
        return Point(merit, cost, sides.uniform, _Evaluated(gradient, blocks, sides), x)

    def merit(self, x: Array) -> float:
        """Evaluate the penalised cost alone; infinite where det(Nᵀ V) has both signs."""
        cost, sides = self.batches.total(criterion.cost, self.basis @ x)
        return cost + self._closeness(x) if sides.uniform else np.inf

    def model(self, at: Point[_Evaluated]) -> tuple[Array, Array]:
        """Evaluate half the gradient (r N,) and the matrix (r N, r N)."""
        basis, blocks, r = self.basis, at.data.blocks, range(self.r)
        pull = self.tau * (self.EE @ at.x - self.null_alignment)
        gradient = basis.T @ at.data.gradient + pull

        def block(i: int, j: int) -> Array:
            return basis.T @ blocks[i, :, j, :] @ basis + (self.tau * self.EE if i == j else 0.0)

        H = np.block([[block(i, j) for j in r] for i in r])
        return gradient.T.ravel(), H

    def step(self, model: tuple[Array, Array], damping: float) -> Step:
        """Solve ``(H + μ D) dx = −g`` with D = mean(diag H) I."""
        g, H = model
        H, x, used = _damped_step(H, g, damping)
        predicted = -2 * float(g @ x) - float(x @ (H @ x))
        return Step(x.reshape(self.r, -1).T, predicted, used)

    def _closeness(self, x: Array) -> float:
        """Evaluate ``τ mean ‖E A − Nᵀ N(center)‖²``, up to a constant."""
        quadratic = np.sum(x * (self.EE @ x))
        return self.tau * float(quadratic - 2 * np.sum(x * self.null_alignment))


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
    """Solve a symmetric positive semidefinite system for its minimum-norm solution."""
    values, vectors = np.linalg.eigh(matrix)
    keep = values > 1e-13 * values[-1]
    return vectors[:, keep] @ ((vectors[:, keep].T @ rhs) / values[keep, None])
