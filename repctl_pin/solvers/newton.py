"""Newton's method with bounded steps, for equations such as f(q) = x on a leaf h(q) = c.

For control loops, :func:`newton` solves one system with few calls and little memory.
:func:`newton_rows` solves many systems at once by batched linear algebra."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from sys import float_info

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import Array

_ROUNDING = 1e-13
"""Largest entry of a step, rad or m, below which the step is rounding error."""

_SMALLEST_SCALE = 1e-6
"""Scale of a step below which the line search gives up."""


def newton(
    correction: Callable[[Array], Array],
    start: Array,
    *,
    longest: float,
    tolerance: float,
    iterations: int,
    contraction: float | None = None,
    residual: Callable[[Array], float] | None = None,
) -> Array | None:
    """Solve one system F(q) = 0 by Newton's method, with few calls, for control loops.

    Parameters
    ----------
    correction : function q → dq (n,)
        Newton's step ``−F'(q)⁻¹ F(q)``. The function may reuse one output array in all calls.
    start : (n,) array
        The first q.
    longest
        Longest step of any joint, rad or m; a longer step is shortened to it.
    tolerance
        The method has converged when no joint moves by more than ``tolerance`` in a step, rad or m.
        If ``residual`` is given, it has converged when the residual is below ``tolerance``.
    iterations
        Maximum number of steps.
    contraction
        If given, steps are not shortened: the first step must be at most ``longest``, and each
        later step at most ``contraction`` times the step before. Otherwise None is returned,
        because longer steps can lead to a different solution branch.
    residual : function q → float, optional
        ‖F(q)‖. If given, each step is halved until the residual decreases; the iteration ends if it
        does not. ``residual`` is called at q before ``correction`` is called at the same q.

    Returns
    -------
    (n,) array or None
        The solution; None if the method did not converge. With ``residual``, the last q is returned
        even then, and the caller must check its residual; the result is None only if a step was not
        finite, or too long for ``contraction``.
    """
    from scipy.linalg.blas import daxpy, idamax  # slow to import

    q = start.copy()
    n = len(start)
    last = float_info.max if contraction is None else longest
    left = inf if residual is None else residual(q)
    for _ in range(iterations):
        if left < tolerance:
            return q
        dq = correction(q)
        size = abs(dq[idamax(dq, n)])
        if not size <= last:  # or not a number
            return daxpy(dq, q) if size < _ROUNDING else None
        scale = 1.0 if size <= longest else longest / size
        if residual is not None:
            q, lower = _line_search(residual, q, dq, scale, left)
            if not lower < left:
                return q
            left = lower
            continue
        q = daxpy(dq, q, n, scale)
        if size < tolerance:
            return q
        if contraction is not None:
            last = max(contraction * size, _ROUNDING / 10)
    return None if residual is None else q


def _line_search(
    residual: Callable[[Array], float], q: Array, dq: Array, scale: float, left: float
) -> tuple[Array, float]:
    """Halve the step ``scale · dq`` from q (n,) until it lowers the residual.

    ``scale`` is the first factor of the step dq (n,), and ``left`` is the residual at q. Return the
    new q (n,) and its residual, or q and ``left`` if no factor above 1e-6 lowers the residual.
    """
    while True:
        trial = q + scale * dq
        lower = residual(trial)
        if lower < left:
            return trial, lower
        if scale < _SMALLEST_SCALE:
            return q, left
        scale /= 2


def newton_rows(
    correction: Callable[[Array, NDArray[np.intp]], Array],
    start: Array,
    *,
    longest: float,
    tolerance: float,
    iterations: int,
) -> tuple[Array, Array]:
    """Solve many systems F_k(q_k) = 0 at once by Newton's method, as arrays with a row for each.

    Parameters
    ----------
    correction : function (Q (L, n), rows (L,)) → dQ (L, n)
        Newton's steps of the systems with the indices ``rows``, at their present configurations Q.
        Entries that are not finite count as 0.
    start : (K, n) array
        The first q of each system.
    longest
        Longest step of any joint, rad or m; a longer step is shortened to it.
    tolerance
        A system is finished after a step that moves no joint by more than this, rad or m.
    iterations
        Maximum number of steps.

    Returns
    -------
    Q : (K, n) array
        Last q of each system.
    size : (K,) array
        Largest entry of each system's last step before it was shortened, rad or m; infinite if the
        step was not finite.
    """
    Q = start.copy()
    size = np.full(len(Q), inf)
    rows = np.arange(len(Q))
    for _ in range(iterations):
        dQ = correction(Q[rows], rows)
        regular = np.isfinite(dQ).all(axis=1)
        size[rows] = np.where(regular, np.abs(dQ).max(axis=1), inf)
        Q[rows] += _shortened(dQ, longest)
        rows = rows[size[rows] > tolerance]
        if not len(rows):
            break
    return Q, size


def _shortened(dQ: Array, longest: float) -> Array:
    """Scale Newton steps dQ (K, n) so that no joint moves by more than ``longest``, rad or m.

    Long steps leave the range in which Newton's method converges. Return the scaled steps (K, n),
    in which NaN and infinite entries are replaced by 0.
    """
    dQ = np.where(np.isfinite(dQ), dQ, 0.0)
    size = np.maximum(np.abs(dQ).max(axis=1), 1e-300)
    return dQ * np.minimum(1.0, longest / size)[:, None]
