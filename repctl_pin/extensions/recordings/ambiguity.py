"""Ambiguity of recorded configurations: the misfit of a smooth function of the pose to them.

If demonstrations reach one pose with different elbow positions, no function of the pose fits their
joints. A labelling assigns one configuration to every frame (row of the recording): the recorded
joints, or the new joints by which relabelling replaces them. A fold is a group of frames that one
fit leaves out and then predicts. A session is one run of the recorder, such as a demonstration. A
cell is a box of poses. Letters: K frames, n joints, k coordinates u of a pose, N monomials (terms)
of u; q̂ is the fitted function.

``Monomials`` are all monomials ``u^α`` up to a degree in the coordinates u, the constant 1 first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...base.arguments import Array, read_only
from ...base.data_tables import Column
from ..cells.chart.monomials import Monomials
from .recording import blocks

_DEGREE = 3
_RIDGES = 10.0 ** np.arange(-8, 1)
"""Ridge parameters λ that are tried, for coordinates scaled to [−1, 1]."""

_FOLDS = 6
_FRAMES_PER_TERM = 3


@dataclass(frozen=True, eq=False)
@read_only
class Ambiguity:
    """Misfit of smooth functions q̂(u) of the pose, one fitted to each of several labellings.

    A labelling assigns one configuration to every frame: the recorded joints, or the new joints.
    The misfit is large if equal poses have different configurations.

    Attributes
    ----------
    misfits : tuple of (K,) arrays
        One array per labelling: ``‖q − q̂(u)‖`` at each frame, rad or m. For the frames of a fold,
        q̂ is fitted to the frames of all other folds.
    degree : int
        Degree of the polynomial q̂.
    method : str
        Text that describes the fit and the held-out frames.
    """

    misfits: tuple[Array, ...]
    degree: int
    method: str

    @property
    def residuals(self) -> tuple[float, ...]:
        """Rms of each labelling's misfits over all frames, rad or m; NaN without frames."""
        return tuple(
            float(np.sqrt(np.mean(one**2))) if len(one) else np.nan for one in self.misfits
        )


def ambiguity(U: Array, session: Column, labels: Sequence[Array]) -> Ambiguity:
    r"""Fit configurations as a polynomial of the pose, and measure the misfit on held-out frames.

    A labelling assigns one configuration to every frame. The misfits of the recorded and the new
    joints show whether equal poses had different configurations.

    .. math:: \hat q(u) = \sum_{|α| ≤ 3} a_α u^α, \qquad
              \min_a \sum_k \|\hat q(u_k) - q_k\|^2 + λ K \|a\|^2

    Each fold of frames is held out in turn. Two to six sessions are one fold each, more sessions
    are divided into six folds, and a single session into six blocks of time. For each labelling,
    the ridge parameter λ is chosen from 1e-8, 1e-7, …, 1 such that its misfit is smallest. The
    degree is 3 as above; it is reduced, but not below 1, while a fit would have fewer than three
    frames per term.

    Parameters
    ----------
    U : (K, k) array
        Coordinates of the poses in a cell.
    session : (K,) array of int
        Session of each frame; the frames of a session are in the order of time.
    labels : list of (K, n) arrays
        Configurations of the frames in each labelling, rad or m.
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
    misfit = np.zeros_like(Q)
    n = labels[0].shape[1]
    parts = [slice(i, i + n) for i in range(0, Q.shape[1], n)]
    if least:
        misfit = _misfit(Monomials(U.shape[1], degree), U, fold, Q, parts)
    name = {1: "linear", 2: "quadratic", 3: "cubic"}[degree]
    method = f"ridge-regularised {name} fit q(pose), on held-out {what}"
    return Ambiguity(tuple(np.linalg.norm(misfit[:, one], axis=1) for one in parts), degree, method)


def _folds(session: Column) -> tuple[Column, str]:
    """Assign frames to folds: return the number of each frame's fold (K,), and a description.

    ``session`` (K,) has the number of each frame's session. The folds are up to six groups of whole
    sessions. A single session is divided into six blocks of time. So neighbouring frames, which are
    alike, are in one fold.
    """
    sessions = np.unique(session)
    if len(sessions) > 1:
        return np.searchsorted(sessions, session) % min(len(sessions), _FOLDS), "sessions"
    count = len(session)
    return np.arange(count) * _FOLDS // max(count, 1), "blocks of time"


def _scaled(U: Array) -> Array:
    """Scale each column of U (K, k), coordinates of the poses, to [−1, 1].

    Constant columns are left out. The polynomials and the ridge parameter of the fit presume this
    range.
    """
    if not len(U):
        return U
    low = U.min(axis=0)
    high = U.max(axis=0)
    on = high - low > 1e-9
    return np.asarray((2 * U - (low + high))[:, on] / (high - low)[on], float)


def _misfit(terms: Monomials, U: Array, fold: Column, Q: Array, parts: list[slice]) -> Array:
    """Compute ``q − q̂`` for all labellings, an array like Q, with q̂ fitted to the other folds.

    The rows of Q are the frames. The columns of Q are the joints in the first labelling, then the
    joints in the second, and so on; ``parts`` has the columns of each labelling. ``fold`` (K,) is
    the index of each frame's fold, and ``terms`` are the monomials of q̂ in the coordinates U (K,
    k). The frames are processed in blocks, to save memory.
    """
    folds, N = int(fold.max()) + 1, terms.size
    gram, right = np.zeros((folds, N, N)), np.zeros((folds, N, Q.shape[1]))
    for f, rows in _blocks_of_folds(fold):
        T = terms.values(U[rows])
        gram[f] += T.T @ T
        right[f] += T.T @ Q[rows]
    fits = _fits(gram, right, np.bincount(fold, minlength=folds), parts)
    misfit = np.empty_like(Q)
    for f, rows in _blocks_of_folds(fold):
        misfit[rows] = Q[rows] - terms.polynomials(U[rows], fits[f])
    return misfit


def _blocks_of_folds(fold: Column) -> Iterator[tuple[int, Column]]:
    """Yield pairs: the index of a fold, and the indices of a block of its frames.

    ``fold`` (K,) is the index of each frame's fold. A fold with many frames has several blocks.
    """
    for f in np.unique(fold):
        rows = np.flatnonzero(fold == f)
        for part in blocks(len(rows)):
            yield int(f), rows[part]


def _fits(gram: Array, right: Array, counts: Column, parts: list[slice]) -> Array:
    """For each fold, fit the coefficients of q̂ to the other folds by ridge regression.

    ``gram`` (folds, N, N) is TᵀT and ``right`` (folds, N, columns of Q) is TᵀQ of each fold, where
    the rows of T are the N terms at the frames of the fold. The result is an array like ``right``:
    the coefficients fitted without each fold. ``counts`` are the numbers of frames per fold, and
    ``parts`` the columns of each labelling. Each labelling has the ridge parameter λ with the
    smallest misfit on the left-out folds.
    """
    K = counts.sum()
    total = gram.sum(axis=0)
    all_right = right.sum(axis=0)
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
