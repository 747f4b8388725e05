"""Batched kinematics and linear solves, in which a singular row does not fail the others."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from ..arguments import Array
from ..redundancy import align
from ..robot.task import Task
from .chart_solve import compiled_chain


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
