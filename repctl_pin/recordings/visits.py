"""Search for the hand pose to which a recorded joint motion returns most often."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..arguments import Array, read_only
from ..robot.length import arm_length
from ..robot.task import Task

FLOOR = 1e-4
"""Smallest tolerance of a hand pose, in arm lengths: the repeatability of a good arm."""

_CANDIDATES = 32
"""Number of poses tried at equally spaced times, and again at equal distances along the path."""

_RADIAN = 0.25
"""Distance, in arm lengths, that counts as much as a rotation of the hand by 1 rad."""

_LEFT = 3.0
"""Distance at which the hand has left a pose, in multiples of the search radius."""

_REST = 0.2
"""Minimum duration of a rest at a pose, s."""

_GAP = 5.0
"""Time step, in multiples of the median one, above which the log has a gap."""


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
        Distance within which the hand counts as back, m; 1 rad counts as a quarter of the arm's
        length.
    noise : (n,) array
        Noise of each joint, standard deviation, rad or m.
    nearest : float
        Smallest distance at which the hand came back to one of the poses tried, m.
    """

    t: Array
    q: Array
    tolerance: float
    noise: Array
    nearest: float


def find_visits(task: Task, t: Array, Q: Array, tolerance: float | None) -> Visits:
    """Find the pose to which the hand returns most often, and all visits there.

    Up to 65 poses of the log are tried: the first, and others spread over time and along the path.
    The pose with the most visits is taken, and of equal ones the one where the hand stayed longest.
    If nearly all visits of a pose are rests of 0.2 s, they count twice, because the hand passes the
    poses on its way there and back twice. Nearby poses are searched in a k-d tree. Its points are
    ``(p, ℓ R / √2)``, m, with up to 12 coordinates and a length ℓ that counts as much as 1 rad.

    Parameters
    ----------
    task
        Task of the hand.
    t : (T,) array
        Time, s.
    Q : (T, n) array
        Joint positions, rad or m.
    tolerance : float or None
        Distance within which the hand counts as back, m; if None, four times the noise of the
        distance between two poses, plus the sagitta of the path between two rows, plus 1e-4 arm
        lengths.
    """
    noise, length = noise_of(Q), arm_length(task, Q[0]) or 1.0
    radian = _RADIAN * length if task.kind in ("pose", "axis") else 0.0
    X = _features(task, Q, radian)
    whole = np.diff(t) <= _GAP * np.median(np.diff(t))
    steps = np.linalg.norm(np.diff(X, axis=0), axis=1) * whole
    if tolerance is None:
        tolerance = _tolerance(task, Q, X, noise, radian, whole) + FLOOR * length
    radius = tolerance + float(np.quantile(steps, 0.95))
    tree = cKDTree(X)
    best: list[_Pass] = []
    chosen, rank, nearest = 0, (0.0, 0.0), np.inf
    each = float(np.median(np.diff(t)))
    for row in _candidates(t, steps):
        runs = _runs(np.sort(tree.query_ball_point(X[row], _LEFT * radius)))
        found = [_closest(X, X[row], run, whole, tolerance) for run in runs]
        nearest = min(nearest, _second(X, row, found))
        there = [one for one in found if one.distance <= tolerance]
        stays = each * np.array([len(one.rows) for one in there])
        rests = len(there) > 2 and np.mean(stays >= _REST) > 0.8
        score = len(there) * (1.0 + rests), float(stays.sum())
        if score > rank:
            best, chosen, rank = there, int(row), score
    target = task.placement(Q[chosen])
    q = np.array([_onto(task, _at(Q, one), target) for one in best])
    times = np.array([float(_at(t, one)) for one in best])
    return Visits(times, q, tolerance, noise, nearest)


class _Pass(NamedTuple):
    """Rows of a log near one pose: a stay of the hand there, or its way past the pose.

    ``run`` are the rows near the pose, and ``rows`` those within the tolerance. ``at`` is the row
    number, with a fraction, at which the hand is nearest to the pose, and ``distance`` its distance
    there, m.
    """

    run: NDArray[np.intp]
    rows: NDArray[np.intp]
    at: float
    distance: float


def noise_of(Q: Array) -> Array:
    """Estimate the noise of every column of Q (T, n), as standard deviations (n,).

    Differences of order k of white noise σ have the variance ``(2k choose k) σ²``; those of a
    smooth motion vanish as k grows. The smallest estimate of orders 3 to 6 is taken, each from the
    median size of the differences, which pauses and gaps of the log hardly change.
    """
    if len(Q) < 16:
        return np.zeros(Q.shape[1])
    sizes = [
        np.median(np.abs(np.diff(Q, k, axis=0)), axis=0)
        / 0.6745
        / np.sqrt(comb(2 * k, k))
        for k in range(3, 7)
    ]
    return np.min(sizes, axis=0)


def _features(task: Task, Q: Array, radian: float) -> Array:
    """Convert configurations to points (T, d), m, whose distances are those of the hand poses."""
    placements = [task.placement(q) for q in Q]
    p = np.array([M.translation for M in placements])[
        :, [a for a in task.rows if a < 3]
    ]
    if not radian:
        return p
    R = np.array([M.rotation for M in placements])
    turned = R[:, :, 2] if task.kind == "axis" else R.reshape(len(R), 9) / np.sqrt(2)
    return np.hstack([p, radian * turned])


def _tolerance(
    task: Task,
    Q: Array,
    X: Array,
    noise: Array,
    radian: float,
    whole: NDArray[np.bool_],
) -> float:
    """Compute the default tolerance of a hand pose, m, to which ``FLOOR`` is added.

    It is four times the noise of the distance between two poses, plus the sagitta of the path
    between two rows. ``whole`` is False for the time steps that are gaps.
    """
    some = Q[np.linspace(0, len(Q) - 1, min(len(Q), 32)).astype(int)]
    J = task.jacobians(some)
    weight = np.where(
        np.arange(J.shape[1]) < sum(a < 3 for a in task.rows), 1.0, radian
    )
    hand = float(
        np.sqrt(np.mean(np.sum((weight[:, None] * J * noise) ** 2, axis=(1, 2))))
    )
    bends = np.linalg.norm(np.diff(X, 2, axis=0), axis=1)[whole[1:] & whole[:-1]]
    return 4 * np.sqrt(2) * hand + (
        float(np.quantile(bends, 0.95)) / 8 if len(bends) else 0.0
    )


def _candidates(t: Array, steps: Array) -> NDArray[np.intp]:
    """Choose the rows of the log whose poses are tried, spread over time and along the path."""
    way = np.append(0.0, np.cumsum(steps))
    shares = (np.arange(_CANDIDATES) + 0.5) / _CANDIDATES
    by_time = np.searchsorted(t, t[0] + shares * (t[-1] - t[0]))
    by_way = np.searchsorted(way, shares * way[-1])
    return np.unique(np.minimum(np.r_[0, by_time, by_way], len(t) - 1))


def _runs(near: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Split sorted row numbers into runs of consecutive ones; between runs, the hand was away."""
    return np.split(near, np.flatnonzero(np.diff(near) > 1) + 1)


def _closest(
    X: Array,
    pose: Array,
    run: NDArray[np.intp],
    whole: NDArray[np.bool_],
    tolerance: float,
) -> _Pass:
    """Find where in a run of consecutive rows the hand is nearest to a pose, also between two rows.

    Between two rows the motion is taken as straight; across a gap of the log it is unknown.
    """
    offsets = X[run] - pose
    distances = np.linalg.norm(offsets, axis=1)
    k = int(np.argmin(distances))
    at, best = float(run[k]), float(distances[k])
    ways = np.diff(offsets, axis=0)
    squares = np.einsum("ij,ij->i", ways, ways)
    for i in (k - 1, k):
        if 0 <= i < len(ways) and whole[run[i]] and squares[i] > 0:
            share = float(np.clip(-(offsets[i] @ ways[i]) / squares[i], 0.0, 1.0))
            distance = float(np.linalg.norm(offsets[i] + share * ways[i]))
            if distance < best:
                at, best = run[i] + share, distance
    return _Pass(run, run[distances <= tolerance], at, best)


def _second(X: Array, row: int, found: list[_Pass]) -> float:
    """Compute how near the hand comes to the pose of a row at other visits, or while away, m.

    It is infinite if the hand never leaves the pose.
    """
    others = [one.distance for one in found if row not in one.run]
    if others:
        return min(others)
    away = np.delete(np.arange(len(X)), np.concatenate([one.run for one in found]))
    return (
        float(np.linalg.norm(X[away] - X[row], axis=1).min()) if len(away) else np.inf
    )


def _at(values: Array, one: _Pass) -> Array:
    """Average values (T, …) over the rows of a visit.

    At a quick visit, interpolate where the hand is nearest.
    """
    if len(one.rows) > 1:
        return values[one.rows].mean(axis=0)
    low = min(int(one.at), len(values) - 2)
    return values[low] + (one.at - low) * (values[low + 1] - values[low])


def _onto(task: Task, q: Array, target: pin.SE3) -> Array:
    """Correct a configuration to reach a pose near it, by two Newton steps ``q + J⁺ e``."""
    for _ in range(2):
        q = q + np.linalg.pinv(task.jacobian(q), rcond=1e-3) @ task.error(q, target)
    return q
