"""Rotations, linear systems and null-space bases of many configurations at once.

Arrays have one row per configuration, K in all, and records are named tuples of such arrays. A
singular matrix does not affect the results of the other rows. Letters: n joints, m task
coordinates, r = n − m; N are bases of the null space of J, J⁺ is the pseudoinverse of J.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array
from ....model.chain_formulas import skew
from ....native import library
from ....redundancy import align

_REGULAR = 1e-6
"""Value of (σ_min / σ_max)² of J above which J Jᵀ gives the singular values to a relative accuracy
of 1e-10."""

_LONG = 0.5
"""Minimum length of the projection of reference vectors onto the null space from which a basis is
computed from linear equations."""

Record = TypeVar("Record", bound=tuple[Any, ...])
"""A named tuple of arrays with K rows each."""


def rows_of(record: Record, which: NDArray[Any] | list[int] | slice) -> Record:
    """Select the rows ``which`` of all arrays of a record; return a record of the same kind."""
    make: Any = type(record)
    selected: Record = make(*(each[which] for each in record))
    return selected


def joined(records: Sequence[Record]) -> Record:
    """Join records of the same kind: all rows of the first one, then those of the next."""
    make: Any = type(records[0])
    together: Record = make(*map(np.concatenate, zip(*records, strict=True)))
    return together


def solved(A: Array, b: Array) -> Array:
    """Solve ``A x = b`` for A (K, n, n) and b (K, n) or (K, n, p); x is NaN where A is singular.

    Unlike NumPy, the function does not fail for all rows if one matrix is singular. C solves the
    equations if there is a native library.
    """
    rhs = b[..., None] if b.ndim == 2 else b
    native = library()
    if native is not None:
        K, n, p = rhs.shape
        left, x = np.array(A, float, order="C"), np.array(rhs, float, order="C")
        sizes = ctypes.c_long(K), ctypes.c_int(n), ctypes.c_int(p)
        native.call_solutions(
            *sizes, ctypes.c_void_p(left.ctypes.data), ctypes.c_void_p(x.ctypes.data)
        )
        return x[..., 0] if b.ndim == 2 else x
    try:
        x = np.linalg.solve(A, rhs)
    except np.linalg.LinAlgError:
        x = np.full(rhs.shape, np.nan)
        for k in range(len(A)):
            with suppress(np.linalg.LinAlgError):
                x[k] = np.linalg.solve(A[k], rhs[k])
    return np.asarray(x[..., 0] if b.ndim == 2 else x, float)


def bases(J: Array, near: Array | None = None) -> tuple[Array, Array, Array]:
    """Evaluate J⁺, null-space bases N, and singular values of K Jacobians.

    Unlike :func:`redundancy.pseudoinverse`, the function raises no error where J loses rank; J⁺ is
    then large.

    Parameters
    ----------
    J : (K, m, n) array
        Task Jacobians.
    near : (K, n, r) array, optional
        Reference bases: of all orthonormal bases of the null space, N is the nearest to ``near``.
        Without it, any basis.

    Returns
    -------
    G : (K, n, m) array
        J⁺.
    N : (K, n, r) array
        Orthonormal null-space bases.
    s : (K, m) array
        Singular values of J, the largest first.
    """
    m = J.shape[1]
    U, s, Vt = np.linalg.svd(J, full_matrices=True)
    V = np.swapaxes(Vt, 1, 2)
    G = V[:, :, :m] @ (np.swapaxes(U, 1, 2) / np.maximum(s, 1e-9)[:, :, None])
    N = V[:, :, m:]
    return G, N if near is None else align(N, near), s


def inverses(J: Array) -> tuple[Array, Array]:
    """Evaluate J⁺ (K, n, m) and the singular values (K, m) of J (K, m, n), the largest first.

    Both are computed from the eigenvectors of J Jᵀ, which is fast, but less exact near a
    singularity.
    """
    squares, U = np.linalg.eigh(J @ np.swapaxes(J, 1, 2))
    s = np.sqrt(np.maximum(squares, 0.0))
    G = np.swapaxes(J, 1, 2) @ (U / np.maximum(s, 1e-8)[:, None] ** 2) @ np.swapaxes(U, 1, 2)
    return G, s[:, ::-1]


def null_bases(J: Array, near: Array) -> Array:
    """Evaluate null-space bases N (K, n, r) of J (K, m, n), orthonormal and nearest to ``near``.

    The solution X of ``J X = 0``, ``nearᵀ X = I`` spans the null space, and ``N = X (XᵀX)^(−1/2)``.
    Where the projection of ``near`` (K, n, r) onto the null space is short, a singular value
    decomposition is used.
    """
    K, m, n = J.shape
    J_V = np.concatenate([J, np.swapaxes(near, 1, 2)], axis=1)
    onto = np.zeros((K, n, n - m))
    onto[:, m:] = np.eye(n - m)
    X = solved(J_V, onto)
    poor = ~((X**2).sum(axis=1) < 1 / _LONG**2).all(axis=1)  # also where X is NaN
    X[poor] = np.eye(n, n - m)
    N = _orthonormal(X)
    if poor.any():
        N[poor] = bases(J[poor], near[poor])[1]
    return N


def _orthonormal(X: Array) -> Array:
    """Evaluate ``X (XᵀX)^(−1/2)`` of matrices X (K, n, r) with independent columns."""
    if X.shape[2] == 1:
        return X / np.linalg.norm(X, axis=1, keepdims=True)
    squares, V = np.linalg.eigh(np.swapaxes(X, 1, 2) @ X)
    return X @ (V / np.sqrt(squares)[:, None]) @ np.swapaxes(V, 1, 2)


def singular_values(J: Array) -> Array:
    """Evaluate the singular values (K, m) of J (K, m, n), the largest first.

    They are the square roots of the eigenvalues of J Jᵀ. Near a singularity, they come from a
    singular value decomposition, which takes twice as long.
    """
    squares = np.linalg.eigvalsh(J @ np.swapaxes(J, 1, 2))[:, ::-1]
    s = np.sqrt(np.maximum(squares, 0.0))
    poor = squares[:, -1] < _REGULAR * squares[:, 0]
    if poor.any():
        s[poor] = np.linalg.svd(J[poor], compute_uv=False)
    return s


def regular(J: Array, ratio: float) -> NDArray[np.bool_]:
    """Test which of K Jacobians J (K, m, n) have σ_min / σ_max above ``ratio``: (K,).

    Most Jacobians pass a faster test first, because ``(σ_max / σ_min)² ≤ tr(J Jᵀ) tr((J Jᵀ)⁻¹)``.
    """
    JJ = J @ np.swapaxes(J, 1, 2)
    inverse = solved(JJ, np.broadcast_to(np.eye(JJ.shape[1]), JJ.shape))
    squares = np.trace(JJ, axis1=1, axis2=2) * np.trace(inverse, axis1=1, axis2=2)
    passed = (squares > 0) & (squares * max(ratio**2, _REGULAR) < 1)
    rest = np.flatnonzero(~passed)
    if len(rest):
        s = np.linalg.svd(J[rest], compute_uv=False)
        passed[rest] = s[:, -1] > ratio * s[:, 0]
    return passed


def left_jacobian(omega: Array) -> Array:
    r"""Evaluate the left Jacobian of SO(3), from rates of a rotation vector to angular velocities.

    J_l maps the time derivative of a rotation vector ω to the angular velocity of exp(ω̂) in fixed
    axes.

    .. math:: J_l(\omega) = I + \frac{1 - \cos\theta}{\theta^2} \hat\omega
              + \frac{\theta - \sin\theta}{\theta^3} \hat\omega^2, \qquad \theta = \|\omega\|.

    Parameters
    ----------
    omega : (K, 3) array
        Rotation vectors ω, rad.

    Returns
    -------
    (K, 3, 3) array
        J_l(ω).
    """
    square = np.sum(omega**2, axis=-1)
    theta = np.sqrt(square)
    small = theta < 1e-4
    safe = np.where(small, 1.0, theta)
    a = np.where(small, 0.5 - square / 24, (1 - np.cos(safe)) / safe**2)
    b = np.where(small, 1 / 6 - square / 120, (safe - np.sin(safe)) / safe**3)
    hat = skew(omega)
    return np.eye(3) + a[:, None, None] * hat + b[:, None, None] * (hat @ hat)
