"""Search for the hand pose to which a recorded joint motion returns most often.

A visit is a time at which the hand is within a tolerance of the pose. The configuration of a visit
is estimated from nearby rows of the log. Two errors are given: the deviation is the scatter due to
noise, the bias a bound on systematic errors. Distances between poses are in m; a rotation by 1 rad
counts as a length, ``radian``, m: a quarter of the arm's length. A gap is a time step of the log
that is too long; ``whole`` (T − 1,) is False there. Levels are positions along the self-motion,
such as the position of the elbow, that were commanded together with the pose. The search tries the
poses of up to 65 rows, and takes the one that is visited most often. A pass is a run of consecutive
rows near a pose. Near means within three times the sum of the tolerance and the 95 % quantile of
the distances between the poses of successive rows.

Letters: T rows of the log, K rows of one visit, n joints, k levels, N visits, d coordinates of a
pose as a point, m task coordinates; e is the task error. ``noise`` (n,) is the standard deviation
of a reading of each joint, rad or m.

``_Pass`` is consecutive rows of a log near one pose. ``Visits`` are the visits of the hand at one
pose: their times and configurations. ``Kind`` is the kind of a task, such as ``pose``, with the
coordinates that it commands. ``_Estimate`` is the configuration of a visit, corrected by J⁺ to
reach the pose, with data on its errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ...base.arguments import Array, read_only
from ...model.kind import Kind
from ...model.length import arm_length
from ...model.task import Task

_FLOOR = 1e-4
"""Smallest tolerance of a hand pose, in arm lengths: the repeatability of a good arm."""

_CANDIDATES = 32
"""Number of poses tried at equally spaced times, and again at equal distances along the path."""

_RADIAN = 0.25
"""Distance, in arm lengths, that counts as much as a rotation of the hand by 1 rad."""

_AT = 0.25
"""Distance at which the hand is at a pose for sure, relative to the tolerance."""

_LEFT = 3.0
"""Distance at which the hand has left a pose, in multiples of the search radius."""

_REST = 0.2
"""Minimum duration of a rest at a pose, s."""

_GAP = 5.0
"""Time step, in multiples of the median one, above which the log has a gap."""


_EXACT, _COARSE = 1e-9, 1e-2
"""Steps between values, rad or m: smaller ones are rounding errors, larger ones no resolution."""

_AVERAGED = 4
"""Number of rows of a visit from which they are averaged, and of rows per fitted direction."""

_MOST_ROWS = 64
"""Maximum number of rows of a visit that are averaged."""

_SLOPE = 10.0
"""Assumed bound on the self-motion between two nearby poses, relative to the motion by J⁺."""

_MOVED = 5.0
"""Self-motion during a visit, in standard deviations, that is distinguished from noise."""

_MOVES = 0.3
"""Extent of the hand's motion during a visit that is fitted, relative to the largest one."""


@dataclass(frozen=True, eq=False)
@read_only
class Visits:
    """Visits of the hand at one pose: their times and configurations.

    Attributes
    ----------
    t : (N,) array
        Time of each visit, s; a pause at the pose is one visit.
    q : (N, n) array
        Configuration at each visit, corrected by J⁺ to reach the pose exactly.
    tolerance : float
        Distance within which the hand counts as being at the pose, m; 1 rad counts as a quarter of
        the arm's length.
    noise : (n,) array
        Noise of each joint, standard deviation, rad or m.
    nearest : float
        Smallest distance, m, at which the hand came again to a pose that it had left, over all
        poses that the search tried. It can be larger than the tolerance. Rotations, and differences
        of levels, count as in ``tolerance``. It is inf if the hand left none of these poses.
    deviation : (N, n) array
        Standard deviation of the joints at each visit due to the noise of the log, rad or m.
    bias : (N, n) array
        Bound on the other errors at each visit, rad or m: those of interpolation between rows of
        the log, of the correction by J⁺, and of levels that differ from visit to visit.
    """

    t: Array
    q: Array
    tolerance: float
    noise: Array
    nearest: float
    deviation: Array
    bias: Array


def _most_visited(
    t: Array, X: Array, steps: Array, whole: NDArray[np.bool_], tolerance: float
) -> tuple[int, list[_Pass], float]:
    """Find the row of X whose pose the hand visits most often.

    The rows of X (T, d) are points in m, ``steps`` (T - 1,) the distances between them; ``whole``
    is False at gaps of the log. Return three values: the index of the row; the passes at which the
    hand is within the tolerance of the row's pose; and the smallest distance, m, at which the hand
    comes again to one of the up to 65 poses that the search tries.
    """
    radius = tolerance + float(np.quantile(steps, 0.95))
    tree = cKDTree(X)
    best: list[_Pass] = []
    chosen = 0
    rank = (0.0, 0.0)
    nearest = np.inf
    each = float(np.median(np.diff(t)))
    for row in _candidates(t, steps):
        runs = _runs(np.sort(tree.query_ball_point(X[row], _LEFT * radius)))
        found = [_closest(X, X[row], run, whole, tolerance) for run in runs]
        nearest = min(nearest, _second(X, row, found))
        there = [one for one in found if one.distance <= tolerance]
        if (score := _score(there, each, tolerance)) > rank:
            best, chosen, rank = there, int(row), score
    return chosen, best, nearest


def find_visits(
    task: Task, t: Array, Q: Array, tolerance: float | None, levels: Array | None = None
) -> Visits:
    """Find the pose to which the hand returns most often, and all visits there.

    Up to 65 poses of the log are tried: the first, and others spread over time and along the path.
    The pose with the most visits within a quarter of the tolerance is chosen; among equals, the
    pose at which the hand stayed longest. A hand that moves to a pose, rests and moves back passes
    the poses on its way twice per visit of the pose of rest. So each visit counts as two at a pose
    at which the hand nearly always rests for 0.2 s or more. Nearby poses, with position p and
    rotation matrix R, are found in a k-d tree of points ``(p, ℓ R / √2)``, m, with up to 12
    coordinates per hand. A rotation by 1 rad counts like the length ℓ, ``radian`` in the code.

    Parameters
    ----------
    task
        Task of the hand.
    t : (T,) array
        Time, s.
    Q : (T, n) array
        Joint positions, rad or m.
    tolerance : float or None
        Distance within which the hand counts as being at the pose, m. If None, it is four times the
        noise of the distance between two poses, plus the sagitta of the path between two rows, plus
        1e-4 arm lengths.
    levels : (T, k) array, optional
        Commanded level of each row, rad or m. The levels are then part of the pose: at a visit,
        they too are near those of the chosen row. A difference of 1 rad or m counts like a rotation
        by 1 rad.
    """
    levels = np.empty((len(t), 0)) if levels is None else levels
    noise = _noise_of(Q)
    length = arm_length(task, Q[0]) or 1.0
    radian = _RADIAN * length
    X = np.hstack([_features(task, Q, radian), radian * levels])
    whole = np.diff(t) <= _GAP * np.median(np.diff(t))
    steps = np.linalg.norm(np.diff(X, axis=0), axis=1) * whole
    if tolerance is None:
        tolerance = _tolerance(task, Q, X, noise, radian, whole) + _FLOOR * length
    chosen, best, nearest = _most_visited(t, X, steps, whole, tolerance)
    target = task.as_target(task.placements(Q[chosen]))
    # joints that follow a commanded level lag behind it at first
    late = levels.shape[1] > 0
    made = [_configuration(task, t, Q, one, target, noise, late) for one in best]
    times = np.array([float(_at(t, one.at)) for one in best])
    deviation, bias = _errors(task, made, noise, _quantum(Q))
    at_visits = np.array([_at(levels, one.at) for one in best])
    off = np.linalg.norm(at_visits - np.median(at_visits, axis=0), axis=1)
    bias = bias + _SLOPE * off[:, None]  # the self-motion to a level that is a little off
    q = np.array([one.q for one in made])
    return Visits(times, q, tolerance, noise, nearest, deviation, bias)


def _score(there: list[_Pass], each: float, tolerance: float) -> tuple[float, float]:
    """Score a pose: the number of its visits, and the time that the hand stays there, s.

    ``there`` are the visits. Only those that come within a quarter of the tolerance, m, of the pose
    count. Their number is doubled if there are at least three visits, and over 80 % of them last
    0.2 s or more. ``each`` is the time between two rows of the log, s.
    """
    stays = each * np.array([len(one.rows) for one in there])
    rests = len(there) > 2 and np.mean(stays >= _REST) > 0.8
    sure = sum(one.distance <= _AT * tolerance for one in there)
    return sure * (1.0 + rests), float(stays.sum())


class _Pass(NamedTuple):
    """Consecutive rows of a log near one pose: a stay of the hand, or a passage.

    ``run`` are the indices of all its rows, ``rows`` those within the tolerance of the pose. ``at``
    is the fractional row index at which the hand is nearest to the pose, and ``distance`` the
    distance there, m.
    """

    run: NDArray[np.intp]
    rows: NDArray[np.intp]
    at: float
    distance: float


def _noise_of(Q: Array) -> Array:
    """Estimate the noise of every column of Q (T, n): standard deviations (n,), rad or m.

    Differences of order k of white noise σ have the variance ``(2k choose k) σ²``; the differences
    of a smooth motion vanish as k grows. The result is the smallest estimate of orders 3 to 6. Each
    estimate comes from the median size of the differences, which pauses and gaps hardly change.
    """
    if len(Q) < 16:
        return np.zeros(Q.shape[1])
    sizes = [
        np.median(np.abs(np.diff(Q, k, axis=0)), axis=0) / 0.6745 / np.sqrt(comb(2 * k, k))
        for k in range(3, 7)
    ]
    return np.min(sizes, axis=0)


def _quantum(Q: Array) -> Array:
    """Find the resolution of every column of Q (T, n): the smallest step between its values, (n,).

    Encoders, and files with few digits, round to this resolution. Steps below 1e-9 rad or m are
    ignored, as rounding errors. A larger resolution than 0.01 rad or m is returned as 0.01.
    """
    steps = np.diff(np.sort(Q, axis=0), axis=0)
    return np.min(np.where(steps > _EXACT, steps, np.inf), axis=0, initial=_COARSE)


def _features(task: Task, Q: Array, radian: float) -> Array:
    """Convert configurations Q (T, n) to points (T, d), m, whose distances are those of the poses.

    A k-d tree then finds nearby poses. With several hands, two points are near each other only if
    every hand has nearby poses.
    """
    placements = zip(*(task.placements(q) for q in Q), strict=True)
    kinds = [one.kind for one in task.single_tasks]
    return np.hstack(
        [
            _coordinates(kind, of_frame, radian)
            for kind, of_frame in zip(kinds, placements, strict=True)
        ]
    )


def _coordinates(kind: Kind, placements: Sequence[pin.SE3], radian: float) -> Array:
    """Convert T placements of one frame to points (T, d), m.

    The distance of two points is the distance of their poses. A point has the coordinates of the
    position that the task commands. If the task commands the rotation, the nine entries of the
    rotation matrix follow, times ``radian`` / √2, m per rad. For an axis task, the direction of the
    tool axis follows instead, times ``radian``.
    """
    p = np.array([M.translation for M in placements])[:, kind.rows[kind.rows < 3]]
    if not kind.turns:
        return p
    R = np.array([M.rotation for M in placements])
    turned = R[:, :, 2] if kind.tool_axes else R.reshape(len(R), 9) / np.sqrt(2)
    return np.hstack([p, radian * turned])


def _tolerance(
    task: Task, Q: Array, X: Array, noise: Array, radian: float, whole: NDArray[np.bool_]
) -> float:
    """Compute the default tolerance of a hand pose, m, to which the caller adds 1e-4 arm lengths.

    The result is four times the noise of the distance between two poses, plus the sagitta of the
    path between two rows, because a quick hand can pass a pose between two rows. ``X`` (T, d) are
    the poses as points, whose distances are those of the poses, m. ``noise`` (n,) is the noise of
    the joints, and ``radian`` the length, m, that counts like a rotation by 1 rad.
    """
    some = Q[np.linspace(0, len(Q) - 1, min(len(Q), 32)).astype(int)]
    J = task.jacobians(some)
    weight = np.where(task.kind.linear, 1.0, radian)
    hand = float(np.sqrt(np.mean(np.sum((weight[:, None] * J * noise) ** 2, axis=(1, 2)))))
    bends = np.linalg.norm(np.diff(X, 2, axis=0), axis=1)[whole[1:] & whole[:-1]]
    return 4 * np.sqrt(2) * hand + (float(np.quantile(bends, 0.95)) / 8 if len(bends) else 0.0)


def _candidates(t: Array, steps: Array) -> NDArray[np.intp]:
    """Choose at most 65 rows of the log whose poses are tried, spread over time and along the path.

    ``steps`` (T − 1,) are the distances between rows, m. The first row is among them.
    """
    way = np.append(0.0, np.cumsum(steps))
    shares = (np.arange(_CANDIDATES) + 0.5) / _CANDIDATES
    by_time = np.searchsorted(t, t[0] + shares * (t[-1] - t[0]))
    by_way = np.searchsorted(way, shares * way[-1])
    return np.unique(np.minimum(np.r_[0, by_time, by_way], len(t) - 1))


def _runs(near: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Split sorted row indices ``near`` into runs of consecutive rows.

    The rows are near a pose, so each run is a visit of the pose, or a passage nearby.
    """
    return np.split(near, np.flatnonzero(np.diff(near) > 1) + 1)


def _closest(
    X: Array, pose: Array, run: NDArray[np.intp], whole: NDArray[np.bool_], tolerance: float
) -> _Pass:
    """Find where in a run of consecutive rows the hand is nearest to a pose, also between two rows.

    ``X`` (T, d) are the poses of the log and ``pose`` (d,) the given one, as points, whose
    distances are those of the poses; ``run`` are row indices. Between two rows the motion is
    assumed straight; across a gap it is unknown. Rows within ``tolerance``, m, are the ``rows`` of
    the result.
    """
    offsets = X[run] - pose
    distances = np.linalg.norm(offsets, axis=1)
    k = int(np.argmin(distances))
    at, best = float(run[k]), float(distances[k])
    for i in (k - 1, k):
        if not (0 <= i < len(run) - 1 and whole[run[i]]):
            continue
        way = offsets[i + 1] - offsets[i]
        share = -float(offsets[i] @ way) / max(float(way @ way), _EXACT**2)
        share = min(max(share, 0.0), 1.0)
        distance = float(np.linalg.norm(offsets[i] + share * way))
        if distance < best:
            at, best = run[i] + share, distance
    return _Pass(run, run[distances <= tolerance], at, best)


def _second(X: Array, row: int, found: list[_Pass]) -> float:
    """Compute the smallest distance, m, at which the hand returns to the pose of a row of X (T, d).

    ``found`` are the passes of that pose. The result is the distance of the nearest other pass. If
    the only pass is that of the row itself, the result is the distance of the nearest row outside
    this pass, or inf if there is no such row.
    """
    others = [one.distance for one in found if row not in one.run]
    if others:
        return min(others)
    away = np.delete(np.arange(len(X)), np.concatenate([one.run for one in found]))
    return float(np.linalg.norm(X[away] - X[row], axis=1).min()) if len(away) else np.inf


def _at(values: Array, at: float) -> Array:
    """Interpolate values (T, …), one per row of the log, at a fractional row index."""
    low = min(int(at), len(values) - 2)
    return values[low] + (at - low) * (values[low + 1] - values[low])


class _Estimate(NamedTuple):
    """Configuration q (n,) of a visit, corrected by J⁺ to reach the pose, with data on its errors.

    ``off`` (m,) is the task error before the correction. ``A`` (n, n) maps the noise of one row of
    the log to the noise of q. ``bend`` (n,) bounds the error of regression or interpolation, rad or
    m.
    """

    q: Array
    off: Array
    A: Array
    bend: Array


def _configuration(
    task: Task, t: Array, Q: Array, one: _Pass, target: pin.SE3, noise: Array, late: bool
) -> _Estimate:
    """Estimate the configuration of a visit, and correct it by J⁺ to reach the pose ``target``.

    If at least four rows of the visit ``one`` are within the tolerance, the configuration is their
    average. Otherwise it is interpolated between rows of the log. If the self-motion of the arm
    continues during the visit, only the first part of the rows is averaged, or the last part if
    ``late``.
    """
    if len(one.rows) >= _AVERAGED:
        q, A, bend = _average(task, Q[one.rows], target, noise, late)
    else:
        q, A, bend = _interpolated(task, t, Q, one.at, target)
    return _Estimate(_onto(task, q, target), task.error(q, target), A, bend)


def _errors(task: Task, made: list[_Estimate], noise: Array, quantum: Array) -> tuple[Array, Array]:
    """Compute the standard deviations and biases, (N, n) each, rad or m, of N estimates ``made``.

    The correction by J⁺ removes the part of an error that moves the hand. It leaves the part in the
    null space, ``P = I − J⁺ J`` times the error. In this part, the standard deviation is due to
    ``noise`` (n,), and the bias bounds what is due to ``quantum`` (n,), the resolution of the log,
    and to interpolation. Where the hand is off the pose, the arm may also be off in self-motion.
    For this, the bias contains ten times ‖J⁺ (e − ē)‖, with the task error e of the visit and the
    median ē of all visits.
    """
    off = np.array([one.off for one in made])
    off = off - np.median(off, axis=0)
    deviation, bias = [], []
    for one, e in zip(made, off, strict=True):
        J = task.jacobian(one.q)
        G = np.linalg.pinv(J, rcond=1e-3)
        P = np.eye(task.n) - G @ J
        deviation.append(np.sqrt((P @ one.A) ** 2 @ noise**2))
        interpolation = np.abs(P) @ (one.bend + quantum / 2)
        bias.append(interpolation + _SLOPE * np.linalg.norm(G @ e))
    return np.array(deviation), np.array(bias)


def _regression(E: Array, Q: Array) -> tuple[Array, Array]:
    """Fit ``q = q₀ + (dq/de) e`` to the rows of E (K, m) and Q (K, n), by least squares.

    Only directions of e in which the hand moves clearly are used. Returns the weights (K,) of the
    rows, ``q₀ = Qᵀ w``, and dq/de (n, m).
    """
    U, sizes, Vt = np.linalg.svd(E - E.mean(axis=0), full_matrices=False)
    used = sizes > max(_MOVES * sizes[0], _EXACT)
    used[len(Q) // _AVERAGED :] = False
    S = U[:, used] / sizes[used]
    Vt = Vt[used]
    weights = 1 / len(Q) - S @ (Vt @ E.mean(axis=0))
    return weights, (S.T @ Q).T @ Vt


def _average(
    task: Task, Q: Array, target: pin.SE3, noise: Array, late: bool
) -> tuple[Array, Array, Array]:
    """Average the configurations (K, n) of a visit.

    The rows need not lie evenly around the pose ``target``. A linear regression of q on the task
    error e, along the directions in which the hand moves most, gives the configuration at ``e =
    0``. If the arm also moves in other ways during the visit, by more than the noise, only the
    first half of the rows is used, or the last half if ``late``; this is repeated while at least
    eight rows are left. The mean of all rows would be the same for a motion from one configuration
    to another and for the reverse motion, and so would hide a difference.

    Returns
    -------
    Configuration (n,); a matrix A (n, n); and the error (n,) of the regression, estimated as the
    difference of the result from the mean of the rows. If the errors of the rows are independent,
    the error of the configuration is distributed like A times the error of one row.
    """
    Q = Q[np.linspace(0, len(Q) - 1, min(len(Q), _MOST_ROWS)).astype(int)]
    E = np.array([task.error(q, target) for q in Q])
    weights, slopes = _regression(E, Q)
    q = weights @ Q
    rest, half = Q - (E - E.mean(axis=0)) @ slopes.T, len(Q) // 2
    moved = np.abs(rest[half:].mean(axis=0) - rest[:half].mean(axis=0))
    least = _MOVED * 2 / np.sqrt(len(Q)) * noise + _EXACT
    if half >= _AVERAGED and (moved > least).any():
        return _average(task, Q[half:] if late else Q[:half], target, noise, late)
    A = np.eye(task.n) + slopes @ task.jacobian(q)
    spread = max(1.0, float(np.linalg.norm(weights)))
    return q, spread * A, np.abs(q - Q.mean(axis=0))


def _interpolated(
    task: Task, t: Array, Q: Array, at: float, target: pin.SE3
) -> tuple[Array, Array, Array]:
    """Interpolate q by a cubic in time, at the moment at which the hand is nearest to the pose.

    ``at`` is the approximate fractional row number of this moment. The cubic passes through the
    four rows around ``at``, or through fewer rows at gaps and ends of the log.

    Returns
    -------
    Configuration (n,); its derivative A (n, n) with respect to an error that is added to all rows,
    and so also shifts the moment; and the error (n,) of interpolation, rad or m.
    """
    low = min(int(at), len(Q) - 2)
    step = t[low + 1] - t[low]
    near = _near(t, low)
    few = near[(near >= low - 1) & (near <= low + 2)]
    u = (t[few] - t[low]) / step
    powers = np.arange(len(few))
    c = np.linalg.solve(u[:, None] ** powers, Q[few])
    x = at - low
    J = task.jacobian(Q[low])
    slope = c[1]
    first = max(x - 0.5, u[0])
    last = min(x + 0.5, u[-1])
    for _ in range(3):
        q, slope = x**powers @ c, powers[1:] * x ** powers[:-1] @ c[1:]
        J = task.jacobian(q)
        d = J @ slope
        square = max(float(d @ d), _EXACT**2)
        x = float(np.clip(x + d @ task.error(q, target) / square, first, last))
    d = J @ slope
    A = np.eye(task.n) - np.outer(slope, d @ J) / max(float(d @ d), _EXACT**2)
    return np.asarray(x**powers @ c, float), A, _bend(Q[near])


def _near(t: Array, low: int) -> NDArray[np.intp]:
    """List the indices of up to six rows around the interval that begins at row ``low``.

    Rows that are farther than 2.5 times this interval from its middle lie beyond a gap of the log,
    and are left out.
    """
    step = t[low + 1] - t[low]
    near = np.arange(max(low - 2, 0), min(low + 4, len(t)))
    return near[np.abs(t[near] - t[low] - step / 2) < 0.5 * step * _GAP]


def _bend(Q: Array) -> Array:
    """Estimate the error (n,), rad or m, of interpolating between the middle rows of Q (K, n).

    Q has at most six consecutive rows of the log. With six, the error is that of a cubic, from
    fourth differences; with fewer, that of a straight line, from second differences.
    """
    if len(Q) == 6:
        return np.asarray(np.abs(np.diff(Q, 4, axis=0)).max(axis=0) * 3 / 128, float)
    return np.asarray(np.abs(np.diff(Q, 2, axis=0)).max(axis=0, initial=0.0) / 8, float)


def _onto(task: Task, q: Array, target: pin.SE3) -> Array:
    """Correct a configuration to reach a pose near it, by two Newton steps ``q + J⁺ e``.

    Only configurations at exactly the same pose can be compared joint by joint.
    """
    for _ in range(2):
        q = q + np.linalg.pinv(task.jacobian(q), rcond=1e-3) @ task.error(q, target)
    return q
