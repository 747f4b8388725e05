"""Batched kinematics and linear solves, in which a singular row does not fail the others."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from ..arguments import Array
from ..redundancy import align
from ..robot.task import Task
from .chart_solve import compiled_chain

_REGULAR = 1e-6
"""Square of σ_min / σ_max of J above which J Jᵀ determines the null space to 1e-10."""

_LONG = 0.5
"""Length of a projection onto the null space that suffices to normalise it."""


def placed(task: Task, Q: Array) -> tuple[Array, Array, Array]:
    """Evaluate f and J at every row of Q (K, n): positions (K, 3), rotations (K, 3, 3) and J (K, m,
    n)."""
    fast = compiled_chain(task)
    if fast is not None:
        return fast.placed(Q)
    drive, nv = task.drive, task.model.nv
    whole = np.ascontiguousarray(Q if drive is None else drive.joints(Q))
    p, R, full = np.empty((len(Q), 3)), np.empty((len(Q), 3, 3)), np.empty((len(Q), 6, nv))
    here, evaluate = task._data.oMf[task._frame_id], task._scratch.own.jacobian
    position, rotation = here.translation, here.rotation  # views that follow every evaluation
    for k, q in enumerate(whole):
        full[k] = evaluate(q)
        p[k], R[k] = position, rotation
    if task.kind == "axis":
        J = np.concatenate([full[:, :3], np.swapaxes(R[:, :, :2], 1, 2) @ full[:, 3:]], axis=1)
    else:
        J = full if task.kind == "pose" else full[:, task.rows]
    return p, R, J if drive is None else J @ drive.S


def solved(A: Array, b: Array) -> Array:
    """Solve ``A x = b`` (K, n, n), (K, n, …); NaN where A is singular."""
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
    """Split joint space at every J (K, m, n): J⁺, the null-space basis nearest to another, and the
    singular values.

    Unlike :func:`redundancy.pseudoinverse` it does not raise: where J loses rank, J⁺ is large.

    Parameters
    ----------
    J : (K, m, n) array
    near : (K, n, r) array

    Returns
    -------
    G : (K, n, m) array
        J⁺.
    N : (K, n, r) array
    s : (K, m) array
    """
    m = J.shape[1]
    U, s, Vt = np.linalg.svd(J, full_matrices=True)
    G = np.swapaxes(Vt[:, :m], 1, 2) @ (np.swapaxes(U, 1, 2) / np.maximum(s, 1e-9)[:, :, None])
    return G, align(np.swapaxes(Vt[:, m:], 1, 2), near), s


def null_bases(J: Array, near: Array) -> tuple[Array, Array]:
    """Evaluate N and the singular values of :func:`bases`.

    With r = 1, N is ``near`` projected onto the null space, by the eigenvectors of J Jᵀ: half the
    time of a singular value decomposition, which serves near singularities and where the projection
    is short.
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
