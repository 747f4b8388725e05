"""Cost of coefficients A of the potentials, its gradient and its Gauss–Newton matrix, per batch.

The cost is the mean of ‖G_r − G_d‖² over the region Ω: the squared distance of the repeatable
inverse G_r from the desired inverse G_d. A basis has the potentials h_1 … h_N with the gradients D
= [∇h_1 … ∇h_N]. G_r keeps the r potentials h = Aᵀ (h_1 … h_N) constant; A (N, r) are their
coefficients, and V = D A their gradients. The columns of N span the null space of J; in shapes, N
is the number of potentials of the basis, n that of joints, m that of task coordinates, and r = n −
m. The mean is over K nodes, which are configurations in Ω. Equation numbers such as (38) are those
of the paper (docs/notation.md).

Everything that depends on the arm is in the arrays ``E = Nᵀ D`` and ``F = G_dᵀ D`` of
:class:`Batch`, which are built once (34), (36), (38). Each evaluation is then dense linear algebra.
:func:`linear`, :func:`cost`, :func:`linearised` and :func:`gauss_newton` take one batch b. They
return its part of a weighted sum over the nodes; the sum over all batches is the mean. If A has
fewer rows than there are potentials, only the first potentials are used. B (N, N) is a basis of
coefficients: the gradients D B are orthonormal in the mean over Ω. An argument ``desired`` is G_d,
and ``task`` gives the names of the joints in error messages.

``PotentialBasis`` is a basis of N functions of q, whose combinations are the potentials h of a
design. ``SignCount`` is the numbers of nodes with det(Nᵀ V) above 0 and at most 0. ``Differential``
is a first-order change of the difference of null-space components of G_d and G_r.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import Array, read_only
from ..base.errors import InputError, SingularityError
from ..model.native_kinematics import jacobians
from ..model.task import Task
from ..potentials.basis import PotentialBasis
from ..redundancy.inverses import inverse_condition_number, row_factor
from ..strategies import Pseudoinverse
from ..strategies.strategy import Inverse


@dataclass(frozen=True, eq=False)
@read_only
class Batch:
    """Matrices E and F of K nodes, from which the cost is evaluated for any coefficients A.

    At each node, ``E = Nᵀ D`` (r, N) and ``F = G_dᵀ D`` (m, N). The null-space components ``W_r =
    G_rᵀ N`` and ``W_d = G_dᵀ N`` (m, r) then differ by ``W_r − W_d = −F A (E A)⁻¹`` (38).

    Attributes
    ----------
    EF : (K, n, N) array
        E above F. The null-space basis N is oriented such that ``det [J; Nᵀ] > 0``. So det(E A)
        has one sign over all of Ω unless V has an algorithmic singularity there.
    null_alignment : (K, r, r) array
        ``Nᵀ N(center)``, where N(center) is the null-space basis at the centre of Ω. Its columns
        are the projections of N(center) onto the null space at the node, in the basis N.
    weights : (K,) array
        Quadrature weights, summing to 1 over all batches.
    r : int
        Degree of redundancy.
    """

    EF: Array
    null_alignment: Array
    weights: Array
    r: int

    @property
    def E(self) -> Array:
        """``E = Nᵀ D`` (K, r, N): null-space components of the gradients of the potentials.

        det(E A) = 0 is an algorithmic singularity.
        """
        return self.EF[:, : self.r]

    @property
    def F(self) -> Array:
        """``F = G_dᵀ D`` (K, m, N): derivatives of the potentials along the columns of G_d.

        If F A = 0, G_d itself keeps h = Aᵀ (h_1 … h_N) constant.
        """
        return self.EF[:, self.r :]

    def first(self, size: int) -> Batch:
        """Return the batch restricted to the first ``size`` potentials, for a lower degree."""
        return self if size == self.EF.shape[-1] else replace(self, EF=self.EF[..., :size])


@dataclass(frozen=True, eq=False)
@read_only
class Builder:
    """Function (Q, weights) → :class:`Batch`, with all that is common to the nodes of a fit.

    Attributes
    ----------
    desired, potentials
        G_d and the basis of potentials.
    kept : (N',) array of int
        Indices of the potentials that are used; batches contain only these.
    N_center : (n, r) array
        Null-space basis at the centre of Ω.
    """

    desired: Inverse
    potentials: PotentialBasis
    kept: NDArray[np.intp]
    N_center: Array

    def __call__(self, Q: Array, weights: Array) -> Batch:
        """Build the batch of the nodes Q (K, n), with quadrature weights (K,)."""
        task = self.desired.task
        N, G, D = evaluate(self.desired, self.potentials, Q)
        if len(self.kept) < D.shape[-1]:
            D = D[..., self.kept]
        N_T = np.swapaxes(N, -1, -2)
        B_T = np.concatenate([N_T, np.swapaxes(G, -1, -2)], axis=1)  # (K, n, n)
        return Batch(B_T @ D, N_T @ self.N_center, weights, task.r)


def evaluate(desired: Inverse, potentials: PotentialBasis, Q: Array) -> tuple[Array, Array, Array]:
    """Evaluate N (K, n, r), G_d (K, n, m) and D (K, n, N) at the nodes Q (K, n).

    N are orthonormal null-space bases of J, oriented such that ``det [J; Nᵀ] > 0``. The gradients D
    and J G_d = I are checked.

    Raises
    ------
    SingularityError
        Where J loses rank; the message names a node.
    InputError
        If a gradient is not finite or has the wrong shape, or ``J G_d = I`` does not hold.
    """
    task = desired.task
    J = jacobians(task, Q)
    N, J_plus = null_space_and_inverse(J, task, Q)
    G = J_plus if type(desired) is Pseudoinverse else desired.batch(Q, J)
    residual = np.abs(J @ G - np.eye(task.m)).max(axis=(1, 2))
    if not residual.max() < 1e-6:
        k = int(np.argmax(np.where(np.isfinite(residual), residual, np.inf)))
        raise InputError(
            "the desired strategy is not an inverse: J G differs from the identity by "
            f"{residual[k]:.2g} at {named(task, Q[k])}; correct G"
        )
    D = np.asarray(potentials.gradients(Q), float)
    if D.shape != (len(Q), task.n, potentials.size):
        raise InputError(
            f"the potentials' gradients must be ({len(Q)}, {task.n}, {potentials.size}) numbers, "
            f"not {D.shape}; correct the method gradients"
        )
    if not np.isfinite(D).all():
        k, _, j = np.argwhere(~np.isfinite(D))[0]
        raise InputError(
            f"the gradient of potential {potentials.names[int(j)]} is not finite "
            f"at {named(task, Q[k])}",
            remedy="omit this potential, or choose a region where its gradient is finite",
        )
    return N, G, D


def null_space_and_inverse(J: Array, task: Task, Q: Array) -> tuple[Array, Array]:
    """Evaluate orthonormal null-space bases N (K, n, r) of J, and J⁺ (K, n, m).

    One factorisation of J (K, m, n) gives both; N is oriented such that ``det [J; Nᵀ] > 0``. Error
    messages name the configurations Q (K, n).
    """
    N, basis, R = _oriented(J, task, Q)
    return N, basis[..., : J.shape[-2]] @ np.swapaxes(np.linalg.inv(R), -1, -2)


def oriented_nullspace(J: Array, task: Task, Q: Array) -> Array:
    """Evaluate orthonormal null-space bases N (K, n, r) of J (K, m, n) with ``det [J; Nᵀ] > 0``.

    With this orientation, ``det(Nᵀ V)`` has the sign of ``det [J; Vᵀ]``, which is smooth in q; so
    its sign changes only across an algorithmic singularity. Q (K, n) are the configurations, for
    the message of the SingularityError where J loses rank.
    """
    return _oriented(J, task, Q)[0]


def _oriented(J: Array, task: Task, Q: Array) -> tuple[Array, Array, Array]:
    """Factor ``Jᵀ = O R`` for J (K, m, n) by QR, and orient the null spaces.

    Return the null-space bases N (K, n, r) with ``det [J; Nᵀ] > 0``, the orthogonal factors O (K,
    n, n), and R (K, m, m). A SingularityError names the configuration of Q (K, n) where J loses
    rank.
    """
    m = J.shape[-2]
    try:
        basis, R = row_factor(J, mode="complete")
    except SingularityError:
        k = int(np.argmin(inverse_condition_number(J)))
        raise SingularityError(
            f"the Jacobian loses rank near {named(task, Q[k])}", remedy="choose a smaller region"
        ) from None
    side = np.prod(np.sign(np.diagonal(R, axis1=-2, axis2=-1)), axis=-1) * np.sign(
        np.linalg.det(basis)
    )
    N = basis[..., m:]
    N[..., 0] *= side[..., None]
    return N, basis, R


@dataclass(frozen=True)
class SignCount:
    """Numbers of nodes: ``positive`` with det(Nᵀ V) above 0, ``negative`` with at most 0.

    If both numbers are above 0, an algorithmic singularity lies between the nodes.
    """

    positive: int
    negative: int

    @property
    def uniform(self) -> bool:
        """True if det(Nᵀ V) has the same sign at all nodes: no singularity is seen between them."""
        return not (self.positive and self.negative)

    def __add__(self, other: SignCount) -> SignCount:
        return SignCount(self.positive + other.positive, self.negative + other.negative)


def linear(b: Batch) -> tuple[Array, Array, Array]:
    """Evaluate this batch's parts of three means, which determine the initial coefficients A.

    Return the parts of the means of ``EᵀE`` and ``FᵀF``, (N, N) each, and ``Eᵀ NᵀN(center)``
    (N, r), with N(center) the null-space basis at the centre of Ω.
    """
    root = np.sqrt(b.weights)[:, None, None]
    E = (b.E * root).reshape(-1, b.EF.shape[-1])
    F = (b.F * root).reshape(-1, b.EF.shape[-1])
    return E.T @ E, F.T @ F, E.T @ (b.null_alignment * root).reshape(-1, b.r)


def cost(b: Batch, A: Array) -> tuple[float, SignCount]:
    """Evaluate this batch's part of the cost ``C(A) = mean ‖F A (E A)⁻¹‖_F²`` (34), (36), (38).

    A (N, r) are the coefficients of the potentials. Return the part, and the numbers of nodes with
    either sign of det(E A) = det(Nᵀ V), whose zeros are algorithmic singularities.
    """
    X, _, sides = _difference(b.first(len(A)), A)
    return float(b.weights @ np.sum(X**2, axis=(1, 2))), sides


@dataclass(frozen=True, eq=False)
@read_only
class Differential:
    """First-order change ``dX = L dA P⁻¹`` of ``X = F A P⁻¹`` (38), ``P = E A``, at K nodes.

    X is the difference of the null-space components G_dᵀ N and G_rᵀ N; dA (N, r) is a change of the
    coefficients. The mean square of dX is the Gauss–Newton model of the cost: ``Σ_jj' dA[:, j]ᵀ
    (mean S[j, j'] LᵀL) dA[:, j']``, with ``S = P⁻¹ P⁻ᵀ`` (r, r).

    Attributes
    ----------
    L : (m, K, N) array
        ``F − X E``.
    S : (r, r, K) array
        P⁻¹ P⁻ᵀ, times the quadrature weights.
    """

    L: Array
    S: Array

    def product(self, dA: Array) -> Array:
        """Multiply the Gauss–Newton matrix by dA (N, r): ``Σ Lᵀ L dA S`` (N, r).

        The matrix itself is not built: a product costs about 4 K m N r operations.
        """
        m, K, size = self.L.shape
        rows = self.L.reshape(-1, size)
        changed = (dA.T.astype(rows.dtype) @ rows.T).reshape(-1, m, K)
        return (np.einsum("imk,ijk->jmk", changed, self.S).reshape(-1, m * K) @ rows).T

    def rounded(self) -> Differential:
        """Return a copy in single precision, whose products take half the time."""
        return Differential(self.L.astype(np.float32), self.S.astype(np.float32))

    def traces(self, basis: Array) -> Array:
        """Evaluate the trace of each node's part of the Gauss–Newton matrix: (K,).

        The matrix is that for the coordinates ``B⁻¹ A`` of the coefficients; ``basis`` is B (N, N).
        Only the sum over its diagonal is computed, not the matrix.
        """
        rows = self.L.reshape(-1, self.L.shape[-1]) @ basis
        return np.trace(self.S) * np.sum(np.sum(rows**2, axis=1).reshape(len(self.L), -1), axis=0)

    def matrix(self) -> Array:
        """Build the Gauss–Newton matrix (r, N, r, N), with the blocks ``Σ S[j, j'] LᵀL``.

        Building the matrix costs about K m N² r (r + 1) operations.
        """
        size, r = self.L.shape[-1], len(self.S)
        rows = self.L.reshape(-1, size)
        matrix = np.empty((r, size, r, size))
        for j in range(r):
            scaled = (self.L * np.sqrt(self.S[j, j])[:, None]).reshape(-1, size)
            matrix[j, :, j, :] = scaled.T @ scaled
            for i in range(j):
                part = rows.T @ (self.L * self.S[i, j][:, None]).reshape(-1, size)
                matrix[i, :, j, :] = part
                matrix[j, :, i, :] = part.T
        return matrix


def sampled(model: list[Differential], basis: Array, count: int) -> tuple[Differential, float]:
    """Draw nodes at random, to estimate the Gauss–Newton matrix from them without bias.

    ``model`` are the first-order changes of X = W_d − W_r at the nodes of all batches, and
    ``basis`` is B (N, N). Each node adds one part to the matrix. The probability of drawing a node
    is half constant, half in proportion to the trace of its part, so that nodes near a singularity
    are seldom missed. ``count`` nodes are drawn, possibly some more than once.

    Return two results. The first is the first-order change of X at the drawn nodes; its
    :meth:`~Differential.matrix` is the estimate, because the drawn parts are divided by their
    expected numbers of draws. The second is the trace of the matrix of all nodes. Traces are those
    of the matrix for the coordinates ``B⁻¹ A``.
    """
    traces = [one.traces(basis) for one in model]
    every = np.concatenate(traces)
    total = float(np.sum(every))
    chance = np.full(len(every), 1 / len(every))
    if total > 0:
        chance = (chance + every / total) / 2
    drawn = np.random.default_rng(0).multinomial(count, chance / np.sum(chance))
    scale = np.split(drawn / (count * chance), np.cumsum([len(one) for one in traces])[:-1])
    L = [one.L[:, each > 0] for one, each in zip(model, scale, strict=True)]
    S = [one.S[..., each > 0] * each[each > 0] for one, each in zip(model, scale, strict=True)]
    return Differential(np.concatenate(L, axis=1), np.concatenate(S, axis=-1)), total


def linearised(b: Batch, A: Array) -> tuple[float, Array, list[Differential], SignCount]:
    """Evaluate this batch's parts of the cost C(A) and of half its gradient, and linearise X in A.

    With P = E A, X = F A P⁻¹ and L = F − X E, ``½ ∂C/∂A = mean Lᵀ X P⁻ᵀ``, and the first-order
    change of X is ``dX = L dA P⁻¹``.

    Returns
    -------
    cost : float
        Part of C(A).
    half_gradient : (N, r) array
        Part of ½ ∂C/∂A.
    differentials : list of Differential
        First-order change of X at the batch's nodes, as a list of one item, so that the sum over
        several batches joins the lists.
    sides : SignCount
        Numbers of nodes with either sign of det P.
    """
    size, r = A.shape
    b = b.first(size)
    X, P_inv, sides = _difference(b, A)
    total = float(b.weights @ np.sum(X**2, axis=(1, 2)))
    L = b.F - X @ b.E  # (K, m, N)
    right = X @ np.swapaxes(P_inv, -1, -2) * b.weights[:, None, None]  # (K, m, r)
    gradient = L.reshape(-1, size).T @ right.reshape(-1, r)
    S = P_inv @ np.swapaxes(P_inv, -1, -2) * b.weights[:, None, None]
    model = Differential(
        np.ascontiguousarray(np.swapaxes(L, 0, 1)), np.ascontiguousarray(np.moveaxis(S, 0, -1))
    )
    return total, gradient, [model], sides


def gauss_newton(b: Batch, A: Array) -> tuple[float, Array, Array, SignCount]:
    """Evaluate this batch's parts of the cost C(A), half its gradient and its Gauss–Newton matrix.

    Return the parts of C(A), of ½ ∂C/∂A (N, r) and of the Gauss–Newton matrix (r, N, r, N), and the
    numbers of nodes with either sign of det(E A).
    """
    total, gradient, (differential,), sides = linearised(b, A)
    return total, gradient, differential.matrix(), sides


def named(task: Task, q: Array) -> str:
    """Format a configuration q (n,) with joint names, such as ``j1 = 0.300, j2 = -1.200``."""
    return ", ".join(
        f"{name} = {value:.3f}" for name, value in zip(task.joint_names, q, strict=True)
    )


def _difference(b: Batch, A: Array) -> tuple[Array, Array, SignCount]:
    """Evaluate ``X = F A P⁻¹ = W_d − W_r`` (38), with P = E A, for coefficients A (N, r).

    W_d = G_dᵀ N and W_r = G_rᵀ N are the null-space components. Return X (K, m, r), P⁻¹ (K, r, r),
    and the numbers of nodes with either sign of det P.
    """
    K, n, size = b.EF.shape
    EFA = (b.EF.reshape(-1, size) @ A).reshape(K, n, -1)
    P = EFA[:, : b.r]
    if b.r == 1:
        det = P[:, 0, 0]
        P_inv = 1 / np.where(det == 0, np.finfo(float).tiny, det)[:, None, None]
    else:
        det = np.linalg.det(P)
        flat = (det == 0)[:, None, None]
        P_inv = np.linalg.inv(np.where(flat, np.finfo(float).tiny ** (1 / b.r) * np.eye(b.r), P))
    positive = int(np.count_nonzero(det > 0))
    return EFA[:, b.r :] @ P_inv, P_inv, SignCount(positive, K - positive)
