"""A derivative of a function that is only known by its values, with an estimate of its own error."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arguments import Array
from ..errors import SingularityError

_LEVELS = 6
_FIRST_STEP = 2.0**-4
SHORTEST_STEP = _FIRST_STEP * 2.0 ** (1 - _LEVELS)
_NARROWER = (1.0, 2.0**-3, 2.0**-6, 2.0**-9)
_ENOUGH = 1e-6


def differentiate(function: Callable[[Array], Array], Q: Array, scale: Array) -> tuple[Array, Array]:
    """Differentiate a batched function along every joint, by extrapolated central differences.

    Central differences with steps h, h/2, …, h/32 are extrapolated to h → 0 (Romberg's table, orders 2 to
    12); of the table the entry is taken that differs least from its two parents. So the function itself
    chooses step and order: a smooth one gets short steps and high order, a noisy one long steps and low order.
    That difference is the error estimate (Ridders' method), unless the noise seen at the shortest steps
    promises more. Where the error stays above 1e-6 of the derivative, as near a pole, all is tried again with
    steps an eighth as long.

    Parameters
    ----------
    function
        Q (P, n) → values (P, …).
    Q : (K, n) array
        Where.
    scale : (n,) or (K, n) array
        The first step is 1/16 of it.

    Returns
    -------
    slope : (K, …, n) array
        ``[..., k]`` is the derivative along joint k.
    error : (K, n) array
        Estimated largest error of any entry of the derivative along joint k.

    Raises
    ------
    SingularityError
        If the function is singular at Q, or closer to it than the shortest step.
    """
    slope: Array | None = None
    scale = np.broadcast_to(scale, Q.shape)
    error, open_rows = np.full(Q.shape, np.inf), np.arange(len(Q))
    for narrower in _NARROWER:
        try:
            found, doubt = _extrapolate(function, Q[open_rows], _FIRST_STEP * narrower * scale[open_rows])
        except SingularityError:
            if slope is None and narrower == _NARROWER[-1]:
                raise
            continue
        if slope is None:
            slope = np.empty((len(Q), *found.shape[1:]))
        row, joint = np.nonzero(doubt < error[open_rows] / 4)  # noise can make an error estimate a little too small
        slope[open_rows[row], ..., joint] = found[row, ..., joint]
        error[open_rows[row], joint] = doubt[row, joint]
        size = np.abs(slope[open_rows]).reshape(len(open_rows), -1).max(axis=1, initial=0.0)
        open_rows = open_rows[error[open_rows].max(axis=1, initial=0.0) > _ENOUGH * size]
        if not len(open_rows):
            break
    assert slope is not None
    return slope, error


def _extrapolate(function: Callable[[Array], Array], Q: Array, first: Array) -> tuple[Array, Array]:
    K, n = Q.shape
    steps = first[:, None] * 2.0 ** -np.arange(_LEVELS)[:, None]  # (K, L, n)
    moves = steps[..., None] * np.eye(n)
    moves = np.stack([moves, -moves], axis=1)  # (K, 2, L, n, n)
    stencil = Q[:, None, None, None] + moves  # (K, 2, L, n, n)
    values = np.asarray(function(stencil.reshape(-1, n)))
    shape = values.shape[1:]
    values = values.reshape(K, 2, _LEVELS, n, -1)
    rows = [(values[:, 0, j] - values[:, 1, j]) / (2 * steps[:, j, :, None]) for j in range(_LEVELS)]  # (K, n, size)

    best, error, level = rows[-1], np.full((K, n), np.inf), np.zeros((K, n), int)
    table = [[rows[0]]]
    for j in range(1, _LEVELS):
        previous, current = table[-1], [rows[j]]
        for i in range(1, j + 1):
            entry = current[i - 1] + (current[i - 1] - previous[i - 1]) / (4.0**i - 1)
            parents = np.array([current[i - 1], previous[i - 1]])
            doubt = np.abs(entry - parents).max(axis=(0, -1), initial=0.0)
            better = doubt < error
            error, level = np.where(better, doubt, error), np.where(better, j, level)
            best = np.where(better[..., None], entry, best)
            current.append(entry)
        table.append(current)
    # What the two shortest rows say is off by little but noise; at the steps chosen it is that much less.
    last, before = (np.abs(row[3] - best).max(-1, initial=0.0) for row in table[-2:][::-1])
    noise = np.maximum(last, before / 2) * 2.0 ** (level - _LEVELS + 1)
    rounding = np.finfo(float).eps * np.abs(values).max(axis=(1, 2, 4), initial=0.0) / steps[:, -1]
    slope = np.moveaxis(best, 1, -1).reshape(K, *shape, n)
    return slope, np.maximum(error, 4 * noise) + rounding
