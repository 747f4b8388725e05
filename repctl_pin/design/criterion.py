"""The cost of a choice of potentials, its gradient and its Gauss–Newton step, on blocks of nodes.

Everything that depends on the arm is in E and F, built once (34), (36), (38). After that an evaluation is
dense linear algebra.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..fields.field import Field
from ..redundancy.nullspace import nullspace
from ..strategies.strategy import Inverse

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Block:
    """What the criterion needs of K nodes.

    With D = [∇h_1 … ∇h_N] at a node: ``E = Nᵀ D`` (r, N) and ``F = G_dᵀ D`` (m, N). Then for ``V = D A``
    ``W_r − W_d = −F A (E A)⁻¹`` (38).

    Attributes
    ----------
    E : (K, r, N) array
    F : (K, m, N) array
    N_ref : (K, r, r) array
        ``Nᵀ N(center)``: the null space's own field, seen in the basis N.
    weights : (K,) array
        Quadrature weights, summing to 1 over all blocks.
    """

    E: Array
    F: Array
    N_ref: Array
    weights: Array


def build_block(desired: Inverse, fields: Field, Q: Array, weights: Array, N_center: Array) -> Block:
    """Evaluate the arm at K nodes Q (K, n) and keep what the criterion needs of it."""
    J = desired.task.jacobians(Q)
    N_T = np.swapaxes(nullspace(J), -1, -2)  # (K, r, n)
    G_T = np.swapaxes(desired.batch(Q, J), -1, -2)  # (K, m, n)
    D = fields.gradients(Q)  # (K, n, N)
    return Block(N_T @ D, G_T @ D, N_T @ N_center, weights)


def start(blocks: Sequence[Block]) -> Array:
    """Solve the linear problem that brings V closest to the null space's own field.

    ``min_A mean ‖F A‖² + ‖E A − Nᵀ N_ref‖²``: V should be N R with R = Nᵀ N_ref, a smooth gauge, and have
    no part along G_d.

    Returns
    -------
    (N, r) array
    """
    gram, rhs = 0.0, 0.0
    for b in blocks:
        E, F = _rows(b.E, b.weights), _rows(b.F, b.weights)
        gram = gram + E.T @ E + F.T @ F
        rhs = rhs + E.T @ _rows(b.N_ref, b.weights)
    return _solve(np.asarray(gram), np.asarray(rhs))


def signs(blocks: Sequence[Block], A: Array) -> Array:
    """Find on which side of an algorithmic singularity every node lies.

    The sign of ``det(E A) det(Nᵀ N_ref)``, so that the arbitrary sign of each basis N drops out. Its
    changes between nodes show a singularity of V or of the reference field.
    """
    return np.concatenate([np.sign(np.linalg.det(b.E @ A)) * np.sign(np.linalg.det(b.N_ref)) for b in blocks])


def cost(blocks: Sequence[Block], A: Array) -> float:
    """Evaluate ``C(A) = mean ‖F A (E A)⁻¹‖_F²`` (34), (36), (38): the mean of ‖G_r − G_d‖_F² over Ω."""
    return sum(float(b.weights @ np.sum(_difference(b, A)[0] ** 2, axis=(1, 2))) for b in blocks)


def cost_and_gradient(blocks: Sequence[Block], A: Array) -> tuple[float, Array]:
    """Evaluate C(A) and its gradient ``∂C/∂A = 2 mean (F − X E)ᵀ X P⁻ᵀ``, P = E A, X = F A P⁻¹."""
    total, gradient = 0.0, np.zeros_like(A)
    for b in blocks:
        X, P_inv = _difference(b, A)
        total += float(b.weights @ np.sum(X**2, axis=(1, 2)))
        L = b.F - X @ b.E  # (K, m, N)
        right = X @ np.swapaxes(P_inv, -1, -2) * b.weights[:, None, None]  # (K, m, r)
        gradient += 2 * L.reshape(-1, L.shape[-1]).T @ right.reshape(-1, A.shape[1])
    return total, gradient


def gauss_newton(blocks: Sequence[Block], A: Array) -> tuple[float, Array, Array]:
    """Evaluate C(A), half its gradient (N, r), and the Gauss–Newton matrix (r, N, r, N).

    ``dX = L dA P⁻¹`` with ``L = F − X E``, so that
    ``mean ‖dX‖² = Σ_jj' dA[:, j]ᵀ (mean S[j, j'] LᵀL) dA[:, j']`` with ``S = P⁻¹ P⁻ᵀ``.
    """
    size, r = A.shape
    total, gradient = 0.0, np.zeros_like(A)
    matrix = np.zeros((r, size, r, size))
    for b in blocks:
        X, P_inv = _difference(b, A)
        total += float(b.weights @ np.sum(X**2, axis=(1, 2)))
        L = b.F - X @ b.E
        rows = L.reshape(-1, size)
        right = X @ np.swapaxes(P_inv, -1, -2) * b.weights[:, None, None]
        gradient += rows.T @ right.reshape(-1, r)
        S = P_inv @ np.swapaxes(P_inv, -1, -2) * b.weights[:, None, None]
        for j in range(r):
            for i in range(j + 1):
                part = rows.T @ (L * S[:, i, j, None, None]).reshape(-1, size)
                matrix[i, :, j, :] += part
                if i != j:
                    matrix[j, :, i, :] += part.T
    return total, gradient, matrix


def _difference(b: Block, A: Array) -> tuple[Array, Array]:
    """``X = F A P⁻¹ = −(W_r − W_d)`` (38) and P⁻¹, P = E A."""
    P_inv = np.linalg.inv(b.E @ A)  # (K, r, r)
    return b.F @ A @ P_inv, P_inv


def _rows(blocks: Array, weights: Array) -> Array:
    """Stack (K, a, N) into weighted rows (K a, N) of a least-squares problem."""
    return (blocks * np.sqrt(weights)[:, None, None]).reshape(-1, blocks.shape[-1])


def _solve(matrix: Array, rhs: Array) -> Array:
    """Solve a symmetric positive semidefinite system in the least-norm sense."""
    values, vectors = np.linalg.eigh(matrix)
    keep = values > 1e-13 * values[-1]
    return vectors[:, keep] @ ((vectors[:, keep].T @ rhs) / values[keep, None])
