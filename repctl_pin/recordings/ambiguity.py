"""Ambiguity of labels: misfit of a smooth fit of joints over poses, on frames held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arguments import Array, read_only
from ..inverse_function.monomials import Monomials
from .recording import blocks
from .table import Column

_DEGREE = 3
_RIDGES = 10.0 ** np.arange(-8, 1)
"""λ that are tried, in coordinates scaled to [−1, 1]."""

_FOLDS = 6
_FRAMES_PER_TERM = 3


@dataclass(frozen=True, eq=False)
@read_only
class Ambiguity:
    """Misfit of several labellings of the same poses.

    Attributes
    ----------
    misfits : tuple of (K,) arrays
        ``‖q − q̂(x)‖`` at each frame, with q̂ fitted to frames of other folds, for each labelling.
    degree : int
        Degree of the polynomial q̂.
    method : str
        The method in words.
    """

    misfits: tuple[Array, ...]
    degree: int
    method: str

    @property
    def residuals(self) -> tuple[float, ...]:
        """Root mean square of the misfit of each labelling, rad or m."""
        return tuple(
            float(np.sqrt(np.mean(one**2))) if len(one) else np.nan for one in self.misfits
        )


def ambiguity(U: Array, session: Column, labels: Sequence[Array]) -> Ambiguity:
    r"""Fit joints over poses, and measure the misfit on frames held out.

    .. math:: \hat q(u) = \sum_{|α| ≤ 3} a_α u^α, \qquad
              \min_a \sum_k \|\hat q(u_k) - q_k\|^2 + λ K \|a\|^2

    The folds that are held out one after the other are sessions, or six blocks of time of a single
    session. λ is the one of 1e-8, 1e-7, …, 1 with the smallest misfit, for each labelling by
    itself. With few frames the degree is lower: the fit has three frames per term.

    Parameters
    ----------
    U : (K, k) array
        Coordinates of the poses in a cell.
    session : (K,) array of int
        Session of each frame, whose frames are in the order of time.
    labels : list of (K, n) arrays
        Labellings, rad or m.
    """
    fold, what = _folds(session)
    Q = np.concatenate(list(labels), axis=1)
    Q = Q - Q.mean(axis=0) if len(Q) else Q
    U = _scaled(U)
    counts = np.bincount(fold, minlength=1)
    least = int(len(U) - counts.max(initial=0))
    degree = _DEGREE
    while degree > 1 and Monomials(U.shape[1], degree).size * _FRAMES_PER_TERM > least:
        degree -= 1
    misfit, n = np.zeros_like(Q), labels[0].shape[1]
    parts = [slice(i, i + n) for i in range(0, Q.shape[1], n)]
    if least:
        misfit = _misfit(Monomials(U.shape[1], degree), U, fold, Q, parts)
    name = {1: "linear", 2: "quadratic", 3: "cubic"}[degree]
    method = f"ridge-regularised {name} fit q(pose), on held-out {what}"
    return Ambiguity(tuple(np.linalg.norm(misfit[:, one], axis=1) for one in parts), degree, method)


def _folds(session: Column) -> tuple[Column, str]:
    """Assign frames to folds: by session, or by block of time."""
    sessions = np.unique(session)
    if len(sessions) > 1:
        return np.searchsorted(sessions, session) % min(len(sessions), _FOLDS), "sessions"
    count = len(session)
    return np.arange(count) * _FOLDS // max(count, 1), "blocks of time"


def _scaled(U: Array) -> Array:
    """Scale coordinates to [−1, 1], and leave out those that do not vary."""
    if not len(U):
        return U
    low, high = U.min(axis=0), U.max(axis=0)
    on = high - low > 1e-9
    return np.asarray((2 * U - (low + high))[:, on] / (high - low)[on], float)


def _misfit(terms: Monomials, U: Array, fold: Column, Q: Array, parts: list[slice]) -> Array:
    """Evaluate ``q − q̂`` (K, ·): one pass for the normal equations, one for the misfit."""
    folds, N = int(fold.max()) + 1, terms.size
    gram, right = np.zeros((folds, N, N)), np.zeros((folds, N, Q.shape[1]))
    for part in blocks(len(U)):
        T = terms.values(U[part])
        for f in np.unique(fold[part]):
            mine = fold[part] == f
            gram[f] += T[mine].T @ T[mine]
            right[f] += T[mine].T @ Q[part][mine]
    fits = _fits(gram, right, np.bincount(fold, minlength=folds), parts)
    misfit = np.empty_like(Q)
    for part in blocks(len(U)):
        T = terms.values(U[part])
        for f in np.unique(fold[part]):
            mine = np.flatnonzero(fold[part] == f)
            misfit[part.start + mine] = Q[part][mine] - T[mine] @ fits[f]
    return misfit


def _fits(gram: Array, right: Array, counts: Column, parts: list[slice]) -> Array:
    """Fit to all folds but one, for each (folds, N, ·), with the best λ for each labelling.

    In the sum of squares on a fold, only ``tr(Wᵀ G W − 2 Wᵀ B)`` depends on W.
    """
    K, total, all_right = counts.sum(), gram.sum(axis=0), right.sum(axis=0)
    made = np.empty((len(_RIDGES), *right.shape))
    cost = np.zeros((len(_RIDGES), len(parts)))
    for f in range(len(gram)):
        s, V = np.linalg.eigh(total - gram[f])
        B = V.T @ (all_right - right[f])
        for i, ridge in enumerate(_RIDGES):
            W = V @ (B / (np.maximum(s, 0.0) + ridge * (K - counts[f]))[:, None])
            made[i, f] = W
            each = np.sum(W * (gram[f] @ W - 2 * right[f]), axis=0)
            cost[i] += [each[one].sum() for one in parts]
    best = [made[i][:, :, one] for i, one in zip(np.argmin(cost, axis=0), parts, strict=True)]
    return np.concatenate(best, axis=2)
