"""Closed paths as piecewise polynomials, the form in which files store any path.

Python functions of a path cannot be saved or sent to another process, but polynomial pieces can. s
runs from 0 to 1 along a cycle.

``Piece`` is a polynomial piece of a closed path between two values of s.
"""

from __future__ import annotations

import copyreg
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from ..base.arguments import Array, read_only
from ..base.errors import InputError
from ..model.rotations import matrix_quaternions, quaternion_matrices
from .task_path import ArcBound, TaskPath, with_arc

_DEGREES = (1, 2, 4, 8, 16, 32, 64)
_EXACT = 1e-12
_GOOD = 1e-9
_DEEPEST = 6


@dataclass(frozen=True, eq=False)
@read_only
class Piece:
    """Polynomial piece of a closed path between two values of s; a cycle is s from 0 to 1.

    Attributes
    ----------
    begin, end : float
        First and last s.
    coefficients : (d + 1, 3) or (d + 1, 7) array
        Coefficients of Chebyshev polynomials of ``u = (2 s − begin − end) / (end − begin)``: x, y,
        z in m, and for a rotating frame a quaternion qx, qy, qz, qw, not normalised.
    """

    begin: float
    end: float
    coefficients: Array


def pieces_of(path: TaskPath) -> list[Piece]:
    """Approximate a path by polynomial pieces, in the order of s.

    No piece extends over a corner. If the path is smooth between its corners, the error is 1e-12 of
    its size, the largest extent along an axis.

    Raises
    ------
    InputError
        If the error exceeds 1e-9 of the path's size.
    """
    knots = (0.0, *path.breaks, 1.0)
    points = np.array([path.placement(float(s)).translation for s in np.linspace(0, 1, 33)])
    size = max(float(np.ptp(points, axis=0).max()), 1e-3)
    placements = [path.placement(float(s)).rotation for s in np.linspace(0, 1, 33)]
    turns = any(not np.array_equal(placements[0], R) for R in placements)
    found: list[Piece] = []
    for begin, end in pairwise(knots):
        found += _fitted(path, begin, end, turns, size, 0)
    return found


def path_of(pieces: Sequence[Piece], rotation: Array, **attributes: Any) -> TaskPath:
    """Create a path from its polynomial pieces.

    Parameters
    ----------
    pieces
        Polynomial pieces in order, from s = 0 to 1.
    rotation : (3, 3) array
        Fixed orientation, used if the pieces have no quaternions.
    attributes
        ``name``, ``breaks`` and further attributes of :class:`TaskPath`.
    """
    ends = np.array([piece.end for piece in pieces])
    slopes = [
        np.asarray(chebyshev.chebder(piece.coefficients) * (2 / (piece.end - piece.begin)), float)
        for piece in pieces
    ]

    series = [_columns(piece.coefficients) for piece in pieces]
    slope_series = [_columns(slope) for slope in slopes]

    def at(s: float, *, slope: bool = False) -> Array:
        i = min(int(np.searchsorted(ends, s, side="right")), len(pieces) - 1)
        piece = pieces[i]
        u = (2 * float(s) - piece.begin - piece.end) / (piece.end - piece.begin)
        return _clenshaw(u, slope_series[i] if slope else series[i])

    def spin(s: float) -> Array:
        """Evaluate the frame's angular velocity ω(s) (3,), rad per cycle, base axes.

        ω is the vector part of ``2 p′ p* / |p|²``, where p(s) is the quaternion of the pieces, p′
        is dp/ds, and p* is the conjugate of p.
        """
        p, dp = at(s)[3:], at(s, slope=True)[3:]
        return 2 * (p[3] * dp[:3] - dp[3] * p[:3] - np.cross(dp[:3], p[:3])) / (p @ p)

    turning: dict[str, Any] = {"rotation": rotation}
    if pieces[0].coefficients.shape[1] == 7:
        turning = {"rotation": lambda s: quaternion_matrices(at(s)[None, 3:])[0], "spin": spin}
    path = TaskPath(
        point=lambda s: at(s)[:3], slope=lambda s: at(s, slope=True)[:3], **turning, **attributes
    )
    return with_arc(path, _arc(ends, slopes, at))


def _columns(coefficients: Array) -> list[list[float]]:
    """Convert coefficients (d, k) of k Chebyshev series, c₀ first, to k lists with c₀ last.

    A list has d numbers. If d is 1, a list is [0, c₀], because :func:`_clenshaw` needs two.
    """
    padding = np.zeros((max(2 - len(coefficients), 0), coefficients.shape[1]))
    return np.vstack([coefficients, padding])[::-1].T.tolist()


def _clenshaw(u: float, columns: list[list[float]]) -> Array:
    """Evaluate k Chebyshev series at u: (k,), to the bit as NumPy's ``chebval`` does.

    ``columns`` has one list per series: its coefficients, the one of highest degree first and c₀
    last. At a single u, Clenshaw's recurrence on lists takes less time than ``chebval``.
    """
    values = []
    twice = 2 * u
    for c1, c0, *lower in columns:
        for c in lower:
            c0, c1 = c - c1, c0 + c1 * twice
        values.append(c0 + c1 * u)
    return np.array(values)


def _arc(ends: Array, slopes: Sequence[Array], at: Callable[[float], Array]) -> ArcBound:
    """Make the function (a, b) → upper bounds (length, m; rotation, rad) between s = a and b.

    ``ends`` are the last s of each piece, and ``slopes`` the Chebyshev coefficients (d, 3) or (d,
    7) of the derivative of each piece by s. ``at`` is the function s → x, y, z, m, and, for seven
    columns, the quaternion qx, qy, qz, qw.
    """
    # |T_k| ≤ 1, so a sum of norms bounds each slope
    rates = np.array(
        [
            [np.linalg.norm(slope[:, part], axis=1).sum() for part in (slice(3), slice(3, None))]
            for slope in slopes
        ]
    )

    def arc(a: float, b: float) -> tuple[float, float]:
        """Return upper bounds of the length, m, and of the rotation, rad, from s = a to b.

        a < b, with no corner of the path between them. The rotation is bounded by ``|ω| ≤ 2 |p′| /
        |p|`` for the quaternion p(s), with ′ = d/ds. Its bound is infinite if p may be 0 there.
        """
        first, last = np.searchsorted(ends, [a, b]).tolist()
        length, turned = (rates[first : last + 1].max(axis=0) * (b - a)).tolist()
        if not turned:
            return length, 0.0
        least = float(np.linalg.norm(at(a)[3:])) - turned
        return length, 2 * turned / least if least > 0 else np.inf

    return arc


def _pickled(path: TaskPath) -> tuple[Callable[..., TaskPath], tuple[Any, ...]]:
    """Convert a path to polynomial pieces for pickle, which cannot store the path's functions.

    Returns what pickle's ``copyreg`` expects: a function that creates the path, and its arguments.
    """
    attributes = {
        name: getattr(path, name)
        for name in ("name", "breaks", "spec", "plane", "corners", "period")
    }
    return partial(path_of, **attributes), (pieces_of(path), path.placement(0.0).rotation)


copyreg.pickle(TaskPath, _pickled)


def _fitted(
    path: TaskPath, begin: float, end: float, turns: bool, size: float, depth: int
) -> list[Piece]:
    """Fit the path from s = ``begin`` to ``end`` by one polynomial, or by more after halving.

    ``turns`` is True if the frame rotates, ``size`` is the extent of the path, m, to which position
    errors are relative, and ``depth`` the number of halvings so far. InputError is raised if the
    error still exceeds 1e-9 after six halvings.
    """
    values = partial(_placed, path, begin, end, turns)
    worst = np.inf
    for degree in _DEGREES:
        u = chebyshev.chebpts2(degree + 1)
        C: Array = np.linalg.solve(chebyshev.chebvander(u, degree), values(u)).astype(float)
        between = np.cos(np.pi * (np.arange(degree + 3) + 0.31) / (degree + 3))
        fit = chebyshev.chebval(between, C).T
        true = values(between)
        # q and −q are the same rotation
        true[:, 3:] *= np.sign((fit[:, 3:] * true[:, 3:]).sum(axis=1, keepdims=True))
        off = np.abs(fit - true) / np.array([size] * 3 + [1.0] * 4)[: C.shape[1]]
        worst = min(worst, float(off.max()))
        if off.max() <= _EXACT or (
            degree == _DEGREES[-1] and depth == _DEEPEST and off.max() <= _GOOD
        ):
            return [Piece(begin, end, C)]
    if depth == _DEEPEST:
        raise InputError(
            f"{path.name} cannot be saved: between s = {begin:.3g} and {end:.3g}, polynomials "
            f"differ from the path by more than {_GOOD:g} of its size",
            remedy="use a smoother path, and list its corners in breaks=",
        )
    middle = (begin + end) / 2
    return [
        piece
        for a, b in ((begin, middle), (middle, end))
        for piece in _fitted(path, a, b, turns, size, depth + 1)
    ]


def _placed(path: TaskPath, begin: float, end: float, turns: bool, u: Array) -> Array:
    """Evaluate a path at u (K,), which runs from −1 at s = ``begin`` to 1 at s = ``end``.

    The result has positions (K, 3), m. If ``turns`` is True, it is (K, 7), with quaternions qx, qy,
    qz, qw behind the positions. Quaternions at successive u have a positive scalar product, so that
    they are continuous.
    """
    inner = 1e-13 * (end - begin)  # sample inside the piece: the path may have corners at its ends
    middles = (begin + end + u * (end - begin)) / 2
    placed = [path.placement(float(s)) for s in np.clip(middles, begin + inner, end - inner)]
    points = np.array([M.translation for M in placed])
    if not turns:
        return points
    order = np.argsort(u)
    quaternions = matrix_quaternions(np.array([placed[i].rotation for i in order]))
    for i in range(1, len(quaternions)):
        quaternions[i] *= -1 if quaternions[i] @ quaternions[i - 1] < 0 else 1
    return np.hstack([points, quaternions[np.argsort(order)]])
