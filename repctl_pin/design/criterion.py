"""Cost of a choice of potentials, its gradient and its Gauss–Newton matrix, on batches of nodes.

Everything that depends on the arm is in E and F, built once (34), (36), (38). After that an
evaluation is dense linear algebra. Each function here takes one batch and returns its part of a sum
over batches. An A with fewer rows than potentials selects the first ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, read_only
from ..errors import InputError, SingularityError
from ..potentials.basis import PotentialBasis
from ..redundancy.inverses import inverse_condition_number, row_factor
from ..robot.task import Task
from ..strategies import Pseudoinverse
from ..strategies.strategy import Inverse


@dataclass(frozen=True, eq=False)
@read_only
class Batch:
    """Data of K nodes for the criterion.

    With D = [∇h_1 … ∇h_N] at a node: ``E = Nᵀ D`` (r, N) and ``F = G_dᵀ D`` (m, N). Then for ``V =
    D A`` ``W_r − W_d = −F A (E A)⁻¹`` (38).

    Attributes
    ----------
    EF : (K, n, N) array
        E above F. N is oriented: ``det [J; Nᵀ] > 0``, so that ``det(E A)`` has one sign over all of
        Ω unless V has an algorithmic singularity in it.
    null_alignment : (K, r, r) array
        ``Nᵀ N(center)``: the null space's own potentials, seen in the basis N.
    weights : (K,) array
        Quadrature weights, summing to 1 over all batches.
    r : int
    """

    EF: Array
    null_alignment: Array
    weights: Array
    r: int

    @property
    def E(self) -> Array:
        """``Nᵀ D`` (K, r, N)."""
        return self.EF[:, : self.r]

    @property
    def F(self) -> Array:
        """``G_dᵀ D`` (K, m, N)."""
        return self.EF[:, self.r :]

    def first(self, size: int) -> Batch:
        """Select the first potentials."""
        return self if size == self.EF.shape[-1] else replace(self, EF=self.EF[..., :size])


@dataclass(frozen=True, eq=False)
@read_only
class Builder:
    """Factory of batches, which can be pickled for another process.

    Attributes
    ----------
    desired, potentials
        G_d and the basis of potentials.
    kept : (N',) array of int
        The potentials that are used.
    N_center : (n, r) array
        N at the center of Ω.
    """

    desired: Inverse
    potentials: PotentialBasis
    kept: NDArray[np.intp]
    N_center: Array

    def __call__(self, Q: Array, weights: Array) -> Batch:
        """Build the batch of K nodes Q (K, n)."""
        task = self.desired.task
        N, G, D = evaluate(self.desired, self.potentials, Q)
        if len(self.kept) < D.shape[-1]:
            D = D[..., self.kept]
        N_T = np.swapaxes(N, -1, -2)
        B_T = np.concatenate([N_T, np.swapaxes(G, -1, -2)], axis=1)  # (K, n, n)
        return Batch(B_T @ D, N_T @ self.N_center, weights, task.r)

    def batches(self, Q: Array, weights: Array, size: int) -> Iterator[Batch]:
        """Build batches of ``size`` nodes, one after another."""
        for i in range(0, len(Q), size):
            yield self(Q[i : i + size], weights[i : i + size])


def evaluate(desired: Inverse, potentials: PotentialBasis, Q: Array) -> tuple[Array, Array, Array]:
    """Evaluate N (K, n, r), G_d (K, n, m) and D = [∇h_1 … ∇h_N] (K, n, N) at K nodes, and check
    them.

    Raises
    ------
    SingularityError
        Where J loses rank; the message names a node.
    InputError
        If a gradient is not finite, or ``J G_d = I`` does not hold.
    """
    task = desired.task
    J = task.jacobians(Q)
    N, J_plus = null_space_and_inverse(J, task, Q)
    G = J_plus if type(desired) is Pseudoinverse else desired.batch(Q, J)
    residual = np.abs(J @ G - np.eye(task.m)).max(axis=(1, 2))
    if not residual.max() < 1e-6:
        k = int(np.argmax(np.where(np.isfinite(residual), residual, np.inf)))
        raise InputError(
            f"the desired strategy is no inverse: J G = I is missed by {residual[k]:.2g} "
            f"at {named(task, Q[k])}"
        )
    D = np.asarray(potentials.gradients(Q), float)
    if D.shape != (len(Q), task.n, potentials.size):
        raise InputError(
            f"the potentials' gradients must be (K, {task.n}, {potentials.size}) numbers, "
            f"not {D.shape}"
        )
    if not np.isfinite(D).all():
        k, _, j = np.argwhere(~np.isfinite(D))[0]
        raise InputError(
            f"the gradient of potential {potentials.names[int(j)]} is not finite "
            f"at {named(task, Q[k])}"
        )
    return N, G, D


def null_space_and_inverse(J: Array, task: Task, Q: Array) -> tuple[Array, Array]:
    """Evaluate N of :func:`oriented_nullspace`, and J⁺ (K, n, m), by one factorisation of J."""
    N, basis, R = _oriented(J, task, Q)
    return N, basis[..., : J.shape[-2]] @ np.swapaxes(np.linalg.inv(R), -1, -2)


def oriented_nullspace(J: Array, task: Task, Q: Array) -> Array:
    """Span the null space of J by an orthonormal basis with ``det [J; Nᵀ] > 0``: (K, n, r).

    ``det [J; Vᵀ]`` is smooth in q whatever the bases, and with this orientation it has the sign of
    ``det(Nᵀ V)``: where that changes, V has an algorithmic singularity, and nowhere else.
    """
    return _oriented(J, task, Q)[0]


def _oriented(J: Array, task: Task, Q: Array) -> tuple[Array, Array, Array]:
    """Factor ``Jᵀ = Q R``: N, Q (K, n, n) and R (K, m, m)."""
    m = J.shape[-2]
    try:
        basis, R = row_factor(J, mode="complete")
    except SingularityError:
        k = int(np.argmin(inverse_condition_number(J)))
        raise SingularityError(f"the Jacobian loses rank near {named(task, Q[k])}") from None
    side = np.prod(np.sign(np.diagonal(R, axis1=-2, axis2=-1)), axis=-1) * np.sign(
        np.linalg.det(basis)
    )
    N = basis[..., m:]
    N[..., 0] *= side[..., None]
    return N, basis, R


@dataclass(frozen=True)
class SignCount:
    """Numbers of nodes on each side of an algorithmic singularity."""

    positive: int
    negative: int

    @property
    def uniform(self) -> bool:
        """Whether all nodes lie on the same side of the singularity."""
        return not (self.positive and self.negative)

    def __add__(self, other: SignCount) -> SignCount:
        return SignCount(self.positive + other.positive, self.negative + other.negative)


def linear(b: Batch) -> tuple[Array, Array, Array]:
    """Sum ``mean EᵀE``, ``mean FᵀF`` (N, N) and ``mean Eᵀ NᵀN(center)`` (N, r)."""
    root = np.sqrt(b.weights)[:, None, None]
    E, F = (b.E * root).reshape(-1, b.EF.shape[-1]), (b.F * root).reshape(-1, b.EF.shape[-1])
    return E.T @ E, F.T @ F, E.T @ (b.null_alignment * root).reshape(-1, b.r)


def cost(b: Batch, A: Array) -> tuple[float, SignCount]:
    """Evaluate this batch's part of ``C(A) = mean ‖F A (E A)⁻¹‖_F²`` (34), (36), (38), and its
    sides."""
    X, _, sides = _difference(b.first(len(A)), A)
    return float(b.weights @ np.sum(X**2, axis=(1, 2))), sides


def gauss_newton(b: Batch, A: Array) -> tuple[float, Array, Array, SignCount]:
    """Evaluate this batch's part of C(A), of half its gradient (N, r), and of the Gauss–Newton
    matrix (r, N, r, N).

    ``½ ∂C/∂A = mean Lᵀ X P⁻ᵀ`` with P = E A, X = F A P⁻¹, ``L = F − X E``. To first order
    ``dX = L dA P⁻¹``, so that ``mean ‖dX‖² = Σ_jj' dA[:, j]ᵀ (mean S[j, j'] LᵀL) dA[:, j']`` with
    ``S = P⁻¹ P⁻ᵀ``.
    """
    size, r = A.shape
    b = b.first(size)
    X, P_inv, sides = _difference(b, A)
    total = float(b.weights @ np.sum(X**2, axis=(1, 2)))
    L = b.F - X @ b.E  # (K, m, N)
    rows = L.reshape(-1, size)
    right = X @ np.swapaxes(P_inv, -1, -2) * b.weights[:, None, None]  # (K, m, r)
    gradient = rows.T @ right.reshape(-1, r)
    S = P_inv @ np.swapaxes(P_inv, -1, -2) * b.weights[:, None, None]
    matrix = np.empty((r, size, r, size))
    for j in range(r):
        scaled = (L * np.sqrt(S[:, j, j])[:, None, None]).reshape(-1, size)
        matrix[j, :, j, :] = scaled.T @ scaled
        for i in range(j):
            part = rows.T @ (L * S[:, i, j, None, None]).reshape(-1, size)
            matrix[i, :, j, :] = part
            matrix[j, :, i, :] = part.T
    return total, gradient, matrix, sides


def named(task: Task, q: Array) -> str:
    """Write a configuration with joint names, for a message."""
    return ", ".join(
        f"{name} = {value:.3f}" for name, value in zip(task.joint_names, q, strict=True)
    )


def _difference(b: Batch, A: Array) -> tuple[Array, Array, SignCount]:
    """Evaluate ``X = F A P⁻¹ = −(W_r − W_d)`` (38), P⁻¹, and the signs of det P, with P = E A."""
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
