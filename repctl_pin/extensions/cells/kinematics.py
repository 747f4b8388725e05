"""Batched kinematics, linear solves and null-space bases, in which a singular matrix does not
affect the results of the other rows."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from ...arguments import Array
from ...model.task import Task
from ...redundancy import align
from .native_points import native_points

_REGULAR = 1e-6
"""Value of (σ_min / σ_max)² of J above which J Jᵀ gives the null space to an accuracy of 1e-10."""

_LONG = 0.5
"""Minimum length of the projection of a unit vector onto the null space from which the unit null
vector is computed by normalising."""


def placed(task: Task, Q: Array) -> tuple[Array, Array, Array]:
    """Evaluate the forward kinematics and the task Jacobian at every row of Q (K, n).

    Return positions (K, 3), m, rotation matrices (K, 3, 3), and J (K, m, n).
    """
    fast = native_points(task)
    if fast is not None:
        return fast.placed(Q)
    drive, nv = task.drive, task.model.nv
    whole = np.ascontiguousarray(drive.joints(Q))
    p, R, full = (
        np.empty((len(Q), 3)),
        np.empty((len(Q), 3, 3)),
        np.empty((len(Q), 6, nv)),
    )
    here, evaluate = task._data.oMf[task._frame_id], task._scratch.own.jacobian
    position, rotation = (
        here.translation,
        here.rotation,
    )  # views that follow every evaluation
    for k, q in enumerate(whole):
        full[k] = evaluate(q)
        p[k], R[k] = position, rotation
    if task.kind == "axis":
        J = np.concatenate(
            [full[:, :3], np.swapaxes(R[:, :, :2], 1, 2) @ full[:, 3:]], axis=1
        )
    else:
        J = full if task.kind == "pose" else full[:, task.rows]
    return p, R, drive.derivatives(J)


def solved(A: Array, b: Array) -> Array:
    """Solve ``A x = b`` for A (K, n, n) and b (K, n) or (K, n, p); x is NaN where A is singular."""
    rhs = b[..., None] if b.ndim == 2 else b
    try:
        x = np.linalg.solve(A, rhs)
    except np.linalg.LinAlgError:
        x = np.full(rhs.shape, np.nan)
        for k in range(len(A)):
            with suppress(np.linalg.LinAlgError):
                x[k] = np.linalg.solve(A[k], rhs[k])
    return np.asarray(x[..., 0] if b.ndim == 2 else x, float)


def bases(J: Array, near: Array) -> tuple[Array, Array, Array]:
    """Evaluate J⁺, null-space bases aligned to given ones, and singular values, batched.

    Unlike :func:`redundancy.pseudoinverse`, it raises no error where J loses rank; J⁺ is then
    large.

    Parameters
    ----------
    J : (K, m, n) array
    near : (K, n, r) array
        Reference bases to which N is aligned; see :func:`redundancy.align`.

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
    G = np.swapaxes(Vt[:, :m], 1, 2) @ (
        np.swapaxes(U, 1, 2) / np.maximum(s, 1e-9)[:, :, None]
    )
    return G, align(np.swapaxes(Vt[:, m:], 1, 2), near), s


def null_bases(J: Array, near: Array) -> tuple[Array, Array]:
    """Evaluate N and the singular values, with the arguments and results of :func:`bases`; faster.

    For r = 1, N is the normalised projection of ``near`` onto the null space, computed from the
    eigenvectors of J Jᵀ in half the time of a singular value decomposition. That decomposition is
    used only for r > 1, near singularities, and where the projection is short.
    """
    if near.shape[2] > 1:
        return bases(J, near)[1:]
    squares, U = np.linalg.eigh(J @ np.swapaxes(J, 1, 2))
    s = np.sqrt(np.maximum(squares[:, ::-1], 0.0))
    part = np.swapaxes(U, 1, 2) @ (J @ near) / np.maximum(squares, 1e-18)[:, :, None]
    N = near - np.swapaxes(J, 1, 2) @ (U @ part)
    length = np.linalg.norm(N, axis=1, keepdims=True)
    poor = (squares[:, 0] < _REGULAR * squares[:, -1]) | (length[:, 0, 0] < _LONG)
    N /= np.maximum(length, _LONG)
    if poor.any():
        _, N[poor], s[poor] = bases(J[poor], near[poor])
    return N, s
