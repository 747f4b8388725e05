"""Verdict on the configurations at the visits of one pose, from their largest difference.

A visit is a time at which the hand is at the pose. Differences are compared with the noise, which
has two parts: the scatter of a configuration due to that of the readings, and a bias, which bounds
its systematic errors. Drift is a steady change. Letters: N visits, n joints, k columns. A group is
the visits in one configuration, within the noise; groups are numbered from 0 in the order of their
first visits.

``Trend`` is robust lines through columns of values over time: their slopes, and the half-widths of
the slopes' confidence intervals.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from ...base.arguments import Array, read_only
from ...motion.motion import CLOSED

REPEATS, DRIFTS, LATER = "repeats", "drifts", "drifts later"
JUMPS, SCATTERS, INCONCLUSIVE = "jumps", "scatters", "inconclusive"
NO_RETURN = "no return"

ENOUGH = 6
"""Minimum number of visits for a verdict, and of visits within the noise that are named."""

_CONFIDENCE = 0.95

_SURE = 0.9999
"""Confidence with which differences, or a slope within the noise, are distinguished from noise."""

_STEADY = 0.999
"""Confidence with which a slope is distinguished from scatter."""

_QUIET = 3.0
"""Minimum ratio of the later drift, had it lasted from the start, to the noise before it."""

_LATER = 4
"""Minimum number of visits of a later drift."""

_EXPLAINED = 0.5
"""Maximum range about a steady line, relative to the range of the values."""

_SHARP = 0.25
"""Share of the bound on the bias within which visits must agree for an arm to repeat."""

_BLIND = 0.05
"""Half-width of the noise, rad or arm lengths, above which a log cannot show repeatability."""

_MOST_VISITS = 400


@dataclass(frozen=True, eq=False)
@read_only
class Trend:
    """Robust lines through k columns of values over time, such as the joints at N visits of a pose.

    The slope of a column is the median of the slopes between all pairs of values, so an outlier
    hardly changes it.

    Attributes
    ----------
    rate : (k,) array
        Slope of each column, per s.
    error : (k,) array
        Half-width of the confidence interval of each slope, per s.
    """

    rate: Array
    error: Array


@dataclass(frozen=True, eq=False)
@read_only
class Verdict:
    """Verdict on how the configurations at the visits of one pose differ.

    Attributes
    ----------
    kind : str
        ``repeats``: all differences are within the noise. ``drifts``: joints change steadily.
        ``drifts later``: joints change steadily, but only after several equal visits. ``jumps``:
        each visit is in one of a few configurations. ``scatters``: the configurations differ in
        another way. ``inconclusive``: there are too few visits, or the noise could hide a
        difference.
    trend : Trend
        Drift of every joint, rad/s or m/s, over the visits from ``begins`` on.
    begins : int
        Index of the first visit that differs from those before it, for ``drifts later``; 0 for all
        other kinds.
    groups : (N,) array of int
        Index of each visit's configuration. Visits with equal indices differ by no more than the
        noise.
    within : bool
        True if the differences of all visits are within the noise. It is True for ``repeats``, and
        can be True for ``inconclusive`` and ``drifts``: the slope of a slow drift can be
        significant although all differences are within the noise. It is False for other kinds.
    """

    kind: str
    trend: Trend
    begins: int
    groups: NDArray[np.intp]
    within: bool


def verdict(t: Array, q: Array, deviation: Array, bias: Array, scale: Array) -> Verdict:
    """Find the verdict on the configurations q (N, n) of visits at times t (N,), s.

    An arm that repeats has the same configuration at all visits. Each value of q has an interval,
    whose half-width is its deviation times a quantile of the normal distribution, plus its bias.
    The quantile is corrected for the number of pairs (Bonferroni), so that intervals of equal
    configurations with equal deviations fail to overlap in only one of 10,000 logs. The bias is a
    generous bound, so intervals can overlap although the configurations differ. An arm therefore
    counts as repeating only if shorter intervals, with a quarter of the bias, overlap too.

    Parameters
    ----------
    t, q
        Times and configurations.
    deviation, bias : (N, n) arrays
        Standard deviation and largest bias of each value, rad or m.
    scale : (n,) array
        Scale of each joint, 1 rad or the arm length, m. Differences below 1e-5 times this scale do
        not count.
    """
    (N, n), floor = q.shape, CLOSED * scale
    z = -ndtri((1 - _SURE) / (N * (N - 1) * n))
    noise = z / np.sqrt(2) * deviation + floor
    r = noise + bias
    sharp = noise + _SHARP * bias
    groups = _groups(q, r)
    within = groups.max() == 0
    least = np.maximum(np.median(np.maximum(deviation, bias), axis=0), floor)
    visits = _Visits(t, q, r, least)
    kind, begins = SCATTERS, 0
    if N < ENOUGH:
        kind = INCONCLUSIVE
    elif within and _significant(visits.drift(0, _SURE)).any():
        kind = DRIFTS
    elif within:
        blind = (np.median(r, axis=0) > _BLIND * scale).any()
        alike = _groups(q, sharp).max() == 0
        kind = REPEATS if alike and not blind else INCONCLUSIVE
    elif begins := visits.later(groups):
        kind = LATER
    elif _few(q, sharp, _groups(q, sharp)):
        kind, groups = JUMPS, _groups(q, sharp)
    elif visits.steady(0, _STEADY).any():
        kind = DRIFTS
    elif visits.steady(0, _CONFIDENCE).any():
        kind = INCONCLUSIVE
    return Verdict(kind, visits.drift(begins), begins, groups, bool(within))


class _Visits(NamedTuple):
    """N visits of one pose: times t (N,), s, and configurations q (N, n), rad or m, with noise.

    Each value has the interval q ± r, with r (N, n). ``least`` (n,) is a lower bound on the
    standard deviation of each joint, rad or m; it bounds the error of a trend from below.
    """

    t: Array
    q: Array
    r: Array
    least: Array

    def drift(self, first: int, confidence: float = _CONFIDENCE) -> Trend:
        """Fit the trend of the joints over the visits from index ``first`` on.

        ``confidence`` is the probability, 0 to 1, with which the slopes' intervals of all joints
        hold at once.
        """
        share = 1 - (1 - confidence) / self.q.shape[1]
        return trend(self.t[first:], self.q[first:], self.least, share)

    def steady(self, first: int, confidence: float) -> NDArray[np.bool_]:
        """Test which joints drift steadily over the visits from index ``first`` on: (n,).

        ``confidence`` is the probability, 0 to 1, with which the slopes' intervals of all joints
        hold at once.
        """
        line = self.drift(first, confidence)
        return _steady(self.t[first:], self.q[first:], self.r[first:], line)

    def later(self, groups: NDArray[np.intp]) -> int:
        """Find the index of the visit at which a drift begins after equal visits; 0 if none does.

        ``groups`` (N,) has the number of each visit's group. The result is the index of the first
        visit that is not in group 0, if at least 6 visits precede this visit, the drift has at
        least 4 visits, and some joint meets two conditions. The joint drifts steadily from this
        visit on. And it did not drift earlier: at the same rate, it would have moved by more than
        6 times the median of r from the first visit to the last one before the drift.
        """
        head = int(np.argmax(groups != 0))
        if not ENOUGH <= head <= len(self.t) - _LATER:
            return 0
        lasted = np.abs(self.drift(head).rate) * (self.t[head - 1] - self.t[0])
        quiet = lasted > 2 * _QUIET * np.median(self.r, axis=0)
        return head if (self.steady(head, _CONFIDENCE) & quiet).any() else 0


def _groups(q: Array, r: Array) -> NDArray[np.intp]:
    """Return the index of each visit's configuration: (N,), from 0.

    The intervals of a visit are its row of q ± r, with q and the noise r (N, n). A visit joins the
    first group in which its intervals overlap those of every visit, else it begins a new group. So
    the visits of a group have the same configuration within the noise.
    """
    low, high = np.empty_like(q), np.empty_like(q)  # of each group
    groups, count = np.zeros(len(q), np.intp), 0
    for k, (a, b) in enumerate(zip(q - r, q + r, strict=True)):
        fits = ((a <= high[:count]) & (low[:count] <= b)).all(axis=1)
        g = int(np.argmax(fits)) if fits.any() else count
        if g == count:
            low[g], high[g], count = a, b, count + 1
        low[g], high[g] = np.maximum(low[g], a), np.minimum(high[g], b)
        groups[k] = g
    return groups


def _few(q: Array, r: Array, groups: NDArray[np.intp]) -> bool:
    """Test whether the arm jumps between a few separate configurations.

    Few means at most two configurations, or that the arm enters each configuration at least twice,
    on average over the configurations. ``groups`` (N,) has the index of each visit's configuration,
    and q ± r (N, n) are the intervals of its values. Two configurations are separate if, for some
    joint, no interval of a visit to one overlaps an interval of a visit to the other.
    """
    count = groups.max() + 1
    entered = 1 + np.count_nonzero(np.diff(groups))
    if count > 2 and 2 * count > entered:
        return False
    low = np.array([np.min((q - r)[groups == g], axis=0) for g in range(count)])
    high = np.array([np.max((q + r)[groups == g], axis=0) for g in range(count)])
    return all(
        ((low[g] > high[:g]) | (high[g] < low[:g])).any(axis=1).all() for g in range(1, count)
    )


def _significant(found: Trend) -> NDArray[np.bool_]:
    """Test which slopes of a trend exceed the half-width of their confidence interval: (k,)."""
    return np.abs(found.rate) > found.error


def _steady(t: Array, q: Array, r: Array, found: Trend) -> NDArray[np.bool_]:
    """Test which joints drift: their slope is significant, and a line explains their values: (n,).

    ``found`` has the slopes. A line explains the values q (N, n) if the range of their distances
    from it is at most half of their own range, or within the noise r (N, n). Values that jump also
    have a slope, but no such line.
    """
    rest = np.ptp(q - t[:, None] * found.rate, axis=0)
    most = np.maximum(_EXPLAINED * np.ptp(q, axis=0), 2 * np.median(r, axis=0))
    return _significant(found) & (rest <= most)


def trend(
    t: Array, values: Array, floor: Array | float = 0.0, confidence: float = _CONFIDENCE
) -> Trend:
    """Fit a line to each column of values (N, k) by the median of the slopes of all pairs.

    Parameters
    ----------
    t : (N,) array
        Times, s.
    values : (N, k) array
        Values at these times.
    floor : (k,) array or float
        Lower bound on the standard deviation of each column, for the confidence intervals.
    confidence
        Probability, 0 to 1, with which the interval of one column holds.
    """
    rows = np.unique(np.linspace(0, len(t) - 1, min(len(t), _MOST_VISITS)).astype(int))
    i, k = np.triu_indices(len(rows), 1)
    some, times = values[rows], t[rows]
    rate = np.median((some[k] - some[i]) / (times[k] - times[i])[:, None], axis=0)
    line = values - t[:, None] * rate
    off = line - np.median(line, axis=0)
    if len(t) < 8:
        scatter = np.sqrt(np.sum(off**2, axis=0) / (len(t) - 2))
    else:
        scatter = np.median(np.abs(off), axis=0) / 0.6745
    quantile = stdtrit(len(t) - 2, (1 + confidence) / 2)
    spread = np.sqrt(np.sum((t - t.mean()) ** 2))
    return Trend(rate, quantile * np.maximum(scatter, floor) / spread)
