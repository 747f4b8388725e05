"""Fit of the coefficients A of the potentials, by Levenberg–Marquardt steps.

The cost C is the mean over the region Ω of ‖G_r − G_d‖², with G_r the repeatable inverse and G_d
the desired one. V = D A are the gradients of the potentials h, D those of their basis, and N spans
the null space of J; det(Nᵀ V) = 0 is an algorithmic singularity. The mean is over nodes, which are
configurations in Ω. At each node, E = Nᵀ D and F = G_dᵀ D. N(center) is the null-space basis at the
centre of Ω. In shapes, K is the number of nodes, N the number of potentials of the basis, and r the
number of potentials h. N' is the number of potentials that a fit uses, the first of the basis. B
(N, N) is a basis of coefficients: the gradients D B are orthonormal in the mean over Ω. A fit works
with the coordinates x = B⁻¹ A.

``Batches`` are the nodes (configurations with weights) of a fit, over which functions are summed.
``Start`` is a starting point of a descent: coefficients A, their cost, and two matrices of the
penalty. ``BarrierCost`` is the cost over the nodes of a fit and over barrier points, configurations
that repel singularities. ``Descent`` is the result of a descent: coefficients A, cost, gradient
norm, steps, and whether it converged. ``Point[D]`` is the objective at one x: ``merit``, ``cost``,
and ``data`` of a type D, here the sums over the nodes, from which the model is computed. ``Step``
is a damped Gauss–Newton step dx, with its predicted decrease and its damping.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy  # which imports its parts when they are needed

from ..base.arguments import Array, read_only
from ..solvers import Damping, Point, Step, levenberg_marquardt
from . import criterion
from .batches import BarrierCost, Batches, Sum
from .criterion import SignCount

_Report = Callable[[int, float], None]

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
_DENSE = 2000
"""Largest r² N for which the whole Gauss–Newton matrix is built."""

_RESIDUAL, _MOST_PRODUCTS, _SAMPLE = 1e-3, 200, 16
"""Conjugate gradients: relative residual, maximum number of products, and equations per potential
in the sample from which the preconditioner is built."""

_STALE = 0.1
"""A step with the Gauss–Newton matrix of the last step is the last one if its predicted decrease of
the cost is at most this share of the tolerance."""

_EMPHASIS = (1.0, 0.1, 0.01)


@dataclass(frozen=True, eq=False)
@read_only
class Descent:
    """Result of a descent: the coefficients of a design, its cost, and how the descent ended.

    Attributes
    ----------
    A : (N, r) array
        Final coefficients.
    cost, gradient_norm : float
        Cost on the fit nodes, and norm of the gradient of the penalised cost with respect to x.
    converged : bool
        True if an undamped step predicts no relative decrease of the cost above the tolerance, or
        the last three steps gave none.
    steps : int
        Number of steps.
    sides : SignCount
        Numbers of nodes with either sign of det(Nᵀ V); ``sides.uniform`` means that all have one
        sign.
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
    """Starting point of a descent, and matrices of the penalty that keeps V near the null space.

    Attributes
    ----------
    A : (N, r) array
        Initial coefficients.
    cost : float
        Cost at A.
    EE, null_alignment : (N, N), (N, r) arrays
        ``mean EᵀE`` and ``mean Eᵀ NᵀN(center)``: matrix and right-hand side of the quadratic
        penalty ``mean ‖E A − Nᵀ N(center)‖²``.
    """

    A: Array
    cost: float
    EE: Array
    null_alignment: Array


def start(batches: Batches, basis: Array, moments: tuple[Array, Array, Array]) -> Start:
    """Find initial coefficients A by linear least squares, such that V is near the null space of J.

    A minimises ``mean ε ‖F A‖² + ‖E A − Nᵀ N(center)‖²``. The second term brings V close to N Nᵀ
    N(center), the projection of N(center) onto the null space, which is smooth in q. The first term
    makes G_dᵀ V small. ε is 1, then 0.1 and 0.01, until det(Nᵀ V) has one sign at all nodes. If no
    ε helps, the solution for ε = 1 is returned.

    Parameters
    ----------
    batches
        The nodes of the fit with their weights, in batches.
    basis : (N', N') array
        B for the first N' potentials; only these are used.
    moments
        Means of EᵀE and FᵀF (N, N), and of ``Eᵀ NᵀN(center)`` (N, r), over all potentials.
    """
    size = len(basis)
    EE = moments[0][:size, :size]
    FF = moments[1][:size, :size]
    null_alignment = moments[2][:size]
    found = None
    for emphasis in _EMPHASIS:
        A = basis @ _solve(basis.T @ (EE + emphasis * FF) @ basis, basis.T @ null_alignment)
        cost, sides = batches.total(criterion.cost, A)
        tried = Start(A, cost, EE, null_alignment)
        if sides.uniform:
            return tried
        found = found or tried
    assert found is not None
    return found


def descend(
    batches: BarrierCost,
    basis: Array,
    begin: Start,
    A: Array,
    *,
    penalty: float,
    tolerance: float,
    report: _Report,
) -> Descent:
    """Minimise the penalised cost by Levenberg–Marquardt steps that keep the sign of det(Nᵀ V).

    The objective is ``C(A) + τ mean ‖E A − Nᵀ N(center)‖²`` with τ = ``penalty`` · C(start) / r. C
    alone is invariant under A → A T with any invertible T. C is nearly invariant if h is replaced
    by a function φ(h), which has the same leaves h(q) = c. It is also nearly invariant if a
    function of a joint that does not affect the task is added to h. Along these directions, a fit
    to finitely many nodes can end in a singularity between the nodes. Among all V of nearly equal
    cost, the penalty selects the one closest to N Nᵀ N(center), the projection of N(center) onto
    the null space.

    Parameters
    ----------
    batches
        The cost C over the nodes of the fit and over its barrier points.
    basis : (N', N') array
        B for the first N' potentials.
    begin
        Initial design by linear least squares, with the matrices of the penalty.
    A : (N', r) array
        Initial coefficients.
    penalty
        Relative weight of the penalty, from which τ follows.
    tolerance
        Relative decrease of the cost below which the iteration ends.
    report
        Progress callback (step, cost).
    """
    size, r = A.shape
    # products pass over all nodes often, so these must be in memory
    often = batches.stored and r**2 * size > _DENSE
    kind = _MatrixFree if often else _PenalisedCost
    problem = kind(batches, basis, begin, penalty, tolerance)
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
    at = found.at
    gradient = 2 * float(np.linalg.norm(problem.gradient(at)))
    *_, sides = at.data
    return Descent(basis @ at.x, at.cost, gradient, found.converged, found.steps, sides)


_Evaluated = tuple[Array, Any, SignCount]
"""Sums over the nodes: half the gradient (N, r), the Gauss–Newton matrix (r, N, r, N) or the
differentials, from which the matrix follows, and the number of nodes with either sign of
det(Nᵀ V)."""


class _PenalisedCost:
    """Penalised cost as a least-squares problem in x = B⁻¹ A, for :func:`levenberg_marquardt`.

    The penalty is the mean over Ω of ``‖Nᵀ V − Nᵀ N(center)‖²`` times a factor τ. A step dx, of the
    shape of x, solves ``(H + μ I) dx = −g``. g is half the gradient of the penalised cost in x, H
    is its Gauss–Newton matrix, and μ is the damping. If potentials are nearly dependent, B is
    large, and rounding errors of H determine the smallest useful μ.

    H takes most of the time. If memory allows, an evaluation keeps the differentials instead, from
    which H follows, and H is built only for a step: not at rejected points, nor at the last point,
    where the H of the step before tells that no step is worth while.
    """

    def __init__(
        self, batches: BarrierCost, basis: Array, begin: Start, penalty: float, tolerance: float
    ) -> None:
        self.batches, self.basis, self.tolerance = batches, basis, tolerance
        self.terms: Sum = criterion.linearised if batches.copies_fit else criterion.gauss_newton
        self.r = begin.A.shape[1]
        self.tau = penalty * begin.cost / self.r
        self.EE = basis.T @ begin.EE @ basis
        self.null_alignment = basis.T @ begin.null_alignment
        self._last: tuple[Point[_Evaluated], Array] | None = None  # H of the last step, and where

    def evaluate(self, x: Array) -> Point[_Evaluated]:
        """Evaluate the cost at x (N, r), half its gradient, and what H follows from, in one pass.

        Return them as a :class:`Point`. Its ``merit`` includes the penalty. Its ``allowed`` is True
        if det(Nᵀ V) has one sign at all nodes; otherwise the solver rejects a step to x. The pass
        over the nodes takes most of the time.
        """
        total = self.batches.total(self.terms, self.basis @ x)
        cost, gradient, second, sides = total
        merit = cost + self._closeness(x)
        return Point(merit, cost, sides.uniform, (gradient, second, sides), x)

    def merit(self, x: Array) -> float:
        """Evaluate the penalised cost alone at x (N, r); infinite where det(Nᵀ V) has both signs.

        The line search rejects such x: a singularity lies between the nodes.
        """
        cost, sides = self.batches.total(criterion.cost, self.basis @ x)
        return cost + self._closeness(x) if sides.uniform else np.inf

    def gradient(self, at: Point[_Evaluated]) -> Array:
        """Evaluate half the gradient (N, r) of the penalised cost in x, at an evaluated point."""
        pull = self.tau * (self.EE @ at.x - self.null_alignment)
        return self.basis.T @ at.data[0] + pull

    def model(self, at: Point[_Evaluated]) -> tuple[Array, Any]:
        """Evaluate half the gradient (N, r) in x; return it and ``at``, from which H follows."""
        return self.gradient(at), at

    def step(self, model: tuple[Array, Any], damping: float) -> Step:
        """Solve ``(H + μ I) dx = −g`` with μ = ``damping`` · mean(diag H).

        ``model`` is g, half the gradient, and the point at which H is to be built. The damping in
        the returned step is larger than ``damping`` if the matrix would not be positive definite.
        If the H of the last step predicts a decrease so small that the iteration ends, this H is
        used.
        """
        gradient, at = model
        if self._last is not None:
            where, H = self._last
            step = self._step(gradient, H, damping)
            if where is at or step.predicted <= _STALE * self.tolerance * at.cost:
                return step
        H = self._matrix(at)
        self._last = at, H
        return self._step(gradient, H, damping)

    def _step(self, gradient: Array, H: Array, damping: float) -> Step:
        """Solve ``(H + μ I) dx = −g`` with half the gradient g (N, r), see :meth:`step`."""
        g = gradient.T.ravel()
        H, x, used = _damped_step(H, g, damping)
        predicted = -2 * float(g @ x) - float(x @ (H @ x))
        return Step(x.reshape(self.r, -1).T, predicted, used)

    def _matrix(self, at: Point[_Evaluated]) -> Array:
        """Build the Gauss–Newton matrix (r N, r N) in x, at an evaluated point.

        The matrix has r × r blocks (N, N), one for each pair of columns of x (N, r).
        """
        basis, r = self.basis, range(self.r)
        second = at.data[1]
        blocks = sum(one.matrix() for one in second) if isinstance(second, list) else second

        def block(i: int, j: int) -> Array:
            return basis.T @ blocks[i, :, j, :] @ basis + (self.tau * self.EE if i == j else 0.0)

        return np.block([[block(i, j) for j in r] for i in r])

    def _closeness(self, x: Array) -> float:
        """Evaluate the penalty ``τ mean ‖E A − Nᵀ N(center)‖²``, up to a constant, at ``A = B x``.

        The penalty draws V towards the projection of N(center) onto the null space at each node.
        The constant is ``τ mean ‖Nᵀ N(center)‖²``, and τ is a fraction of the initial cost over r.
        """
        quadratic = np.sum(x * (self.EE @ x))
        return self.tau * float(quadratic - 2 * np.sum(x * self.null_alignment))


class _MatrixFree(_PenalisedCost):
    """Penalised cost whose steps are found by conjugate gradients, for many potentials and large r.

    The Gauss–Newton matrix of all nodes costs K m N² r (r + 1) operations, and a product with it 4
    K m N r. So the matrix is built only from a random sample of 16 N / m nodes, as a
    preconditioner; the iteration multiplies by the matrix of all nodes. A step needs about ten
    products.
    """

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.terms = criterion.linearised

    def model(self, at: Point[_Evaluated]) -> tuple[Array, Any]:
        """Evaluate half the gradient (N, r), and three data of the Gauss–Newton matrix H in x.

        They are the first-order changes of X = F A (E A)⁻¹ at all nodes, H estimated from a sample
        of the nodes, and mean(diag H).
        """
        gradient, differentials, sides = at.data
        count = _SAMPLE * len(self.basis) // len(differentials[0].L)
        few, trace = criterion.sampled(differentials, self.basis, count)
        g = self.gradient(at)
        H = self._matrix(replace(at, data=(gradient, few.matrix(), sides)))
        level = (trace + self.tau * self.r * float(np.trace(self.EE))) / at.x.size
        return g, ([one.rounded() for one in differentials], H, level)

    def step(self, model: tuple[Array, Any], damping: float) -> Step:
        """Solve ``(H + μ I) dx = −g``, μ = ``damping`` · mean(diag H), by conjugate gradients.

        ``model`` is g (N, r), and three data of H: the first-order changes of X = F A (E A)⁻¹ at
        all nodes, H estimated from a sample of the nodes, and mean(diag H). The residual is at most
        1e-3 of ``‖g‖``; it changes the steps, but not the optimum, because g is exact.
        """
        from scipy.sparse.linalg import LinearOperator, cg  # slow to import

        g, (differentials, approximate, level) = model
        r, flat = self.r, -g.T.ravel()
        factor, mu, damping = _factor(approximate, damping, level)

        def product(x: Array) -> Array:
            dx = x.reshape(r, -1).T
            dA = self.basis @ dx
            change = self.basis.T @ sum(one.product(dA) for one in differentials)
            return (change + self.tau * self.EE @ dx + mu * dx).T.ravel()

        def solved(x: Array) -> Array:
            return scipy.linalg.cho_solve(factor, x)

        H, preconditioner = (
            LinearOperator((flat.size, flat.size), matvec=function, dtype=float)
            for function in (product, solved)
        )
        x, _ = cg(H, flat, rtol=_RESIDUAL, maxiter=_MOST_PRODUCTS, M=preconditioner)
        predicted = 2 * float(flat @ x) - float(x @ product(x))
        return Step(x.reshape(r, -1).T, predicted, damping)


def _damped_step(H: Array, g: Array, damping: float) -> tuple[Array, Array, float]:
    """Solve ``(H + μ I) x = −g`` with μ = ``damping`` · mean(diag H), for H (p, p) and g (p,).

    Returns
    -------
    matrix : (p, p) array
        H + μ I.
    step : (p,) array
        x.
    damping : float
        The damping that was used; larger than the given one if H + μ I would not be positive
        definite.
    """
    factor, mu, damping = _factor(H, damping, float(np.trace(H)) / len(g))
    return H + mu * np.eye(len(g)), -scipy.linalg.cho_solve(factor, g), damping


def _factor(H: Array, damping: float, level: float) -> tuple[Any, float, float]:
    """Factor ``H + μ I`` with μ = ``damping`` · ``level``, where ``level`` is mean(diag H).

    The damping is multiplied by 10 until the matrix is positive definite. Return the Cholesky
    factor, as :func:`scipy.linalg.cho_factor` gives it, μ, and the damping that was used.
    """
    level = max(level, 1e-300)
    while True:
        mu = damping * level
        try:
            return scipy.linalg.cho_factor(H + mu * np.eye(len(H))), mu, damping
        except np.linalg.LinAlgError:
            damping *= 10


def _solve(matrix: Array, rhs: Array) -> Array:
    """Return the minimum-norm solution (N, r) of ``matrix · x = rhs``, with rhs (N, r).

    The matrix (N, N) is symmetric positive semidefinite; eigenvalues below 1e-13 of the largest one
    count as 0, so that potentials can be dependent.
    """
    values, vectors = np.linalg.eigh(matrix)
    keep = values > 1e-13 * values[-1]
    return vectors[:, keep] @ ((vectors[:, keep].T @ rhs) / values[keep, None])
