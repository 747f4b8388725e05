r"""Minimum body distance along a motion, at its samples and between them.

A pair is two bodies. Between two samples, the joints move on a straight line. A position on the
motion is a sample number, counted from 0; a fraction lies between two samples. A pair's distance d
changes by at most ρ·\|q − x\| from the configuration x to q, where ρ_j bounds how far joint j moves
the points of the two bodies against each other, per rad or m, see :meth:`.BodyBounds.reach`. A
piece is a part of the motion whose configurations differ from its middle c by at most w_j in joint
j. On the piece,

.. math:: d(q) \ge d(x) - \rho \cdot (|c - x| + w)

for every configuration x at which d was measured. A pair is decided on a piece if this bound shows
that its bodies do not collide there, and that its distance is not clearly below the minimum found.
Otherwise, d is measured at c, or the piece is halved. A collision-only pair is tested for
collisions, but does not count for the minimum. Letters: K samples, N joints of the model, P pairs.

``_CollisionModel`` is the bodies of a robot and its surroundings, and the pairs that a task moves.
``Clearance`` is the minimum body distance of a motion, and its first collision. ``_Pieces`` are M
pieces of a motion on which a pair is undecided, with bounds on its distance.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import Array, read_only

if TYPE_CHECKING:
    from .collision_model import Pair, _CollisionModel

_SHARE = 0.1
"""Maximum share by which the minimum body distance of a motion can lie below the one found."""

_SMALL = 5e-3
"""Value of ``_SHARE`` in m for distances below 5 cm; the minimum stays above 0."""

_FLOOR = 2e-6
"""Relative motion of a pair's bodies on a piece, m, below which the piece is not halved again."""

_FLOOR_OF_TOUCH = 1e-3
"""Value of ``_FLOOR`` after a collision was found, when only an earlier collision is sought."""

_MOST = 4_000
"""Maximum number of distances measured in one search between the samples of a motion."""


@read_only
@dataclass(frozen=True, eq=False)
class Clearance:
    """Minimum body distance of a motion, and its first collision.

    Attributes
    ----------
    distance : float
        Minimum distance found, m: below 0 in a collision, 0 if only convex hulls overlap, inf
        without a pair to measure and without a collision.
    at : float
        Sample number at the minimum, counted from 0; a fraction lies between two samples.
    links : (str, str)
        Links of the two bodies at the minimum.
    touch : (float, (str, str)) or None
        First collision found: its sample number, as in ``at``, and the two links.
    overlap : float
        Body distance at the first collision, m, which is negative; 0 without a collision.
    distances : (R,) array
        Minimum body distance at each of the R samples ``rows`` that were given to
        :func:`clearance`, m; below 0 in a collision.
    points : int
        Number of configurations at which distances were measured.
    between : bool
        True if the result holds between the samples too: no bodies collide, and the true minimum is
        smaller than ``distance`` by at most 10 % or 5 mm, whichever is more. False after a
        collision, and if a pair is ``undecided``.
    undecided : (str, str) or None
        Links of the first pair for which too many measurements would be needed; None if none is.
    """

    distance: float
    at: float
    links: Pair
    touch: tuple[float, Pair] | None
    overlap: float
    distances: Array = field(repr=False)
    points: int
    between: bool
    undecided: Pair | None = None


def clearance(model: _CollisionModel, Q: Array, rows: NDArray[np.intp]) -> Clearance:
    """Find the minimum body distance and the first collision of a motion.

    Parameters
    ----------
    model
        Collision model, with the P pairs to check.
    Q
        Samples (K, N) of the motion, a value per joint of the model. Between two samples, the
        joints move on a straight line.
    rows
        Indices of R samples, 0 and K − 1 included, at which the measured pairs are measured first.
        The search then continues between these samples. Collision-only pairs are tested at the
        samples last, and only if this is still necessary, see :meth:`_Search.test_samples`.
    """
    search = _Search(model, Q)
    undecided = search.look_at(rows)
    search.settle(rows, undecided)
    search.test_samples(rows)
    if search.stopped_after_a_collision:
        search.settle(rows, undecided)
    return search.found()


class _Search:
    """Search for the minimum body distance of a motion, piece by piece.

    A position on the motion is a sample number; a fraction lies between two samples. A pair is
    given by its index.
    """

    def __init__(self, model: _CollisionModel, Q: Array) -> None:
        self._model, self._Q = model, Q
        self._way = np.vstack([np.zeros(Q.shape[1]), np.abs(np.diff(Q, axis=0)).cumsum(axis=0)])
        # a motion may exceed the limits of prismatic joints, so its own positions bound them;
        # a joint that stands still moves nothing
        self._reach = np.where(self._way[-1] > 0, model.reach(np.abs(Q).max(axis=0)), 0.0)
        self._measured = model.kept(1.0) > 0
        self._best = np.inf
        self._distances: list[Array] = []
        self._at = 0.0
        self._touch = np.inf
        self._points = 0
        self._left = 0
        self._undecided: list[int] = []

    def found(self) -> Clearance:
        """Return the result, with the names of the links."""
        distance, pair = self._measure_all(self._at) if len(self._reach) else (np.inf, -1)
        links = self._model.names(pair) if pair >= 0 else ("", "")
        touch, overlap = None, 0.0
        if self._touch < np.inf:
            overlap, pair = self._measure_all(self._touch)
            touch = self._touch, self._model.names(pair)
        distances = np.concatenate(self._distances)
        return Clearance(
            distance,
            self._at,
            links,
            touch,
            overlap,
            distances,
            self._points,
            touch is None and not self._undecided,
            self._model.names(self._undecided[0]) if self._undecided else None,
        )

    def look_at(self, rows: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Compute the distances at samples ``rows`` (R,), and list the pairs that stay undecided.

        The minimum distance found so far is updated. Piece k is the motion from sample ``rows[k]``
        to ``rows[k + 1]``. A pair is undecided on a piece if its lower bounds at both ends do not
        exclude a collision on the piece or, unless it is collision-only, a distance clearly below
        the minimum found. Return two index arrays of equal length, (pairs, pieces), with an entry
        per undecided pair and piece. For a collision-only pair, no distance is computed, only a
        lower bound.
        """
        pairs, pieces = [], []
        last = None
        for start, bounds, distances in self._model.blocks(self._Q[rows]):
            for k, distance in enumerate(distances.tolist()):
                self._note(float(rows[start + k]), distance)
            self._points += len(distances)
            self._distances.append(distances)
            if last is not None:
                bounds = np.vstack([last, bounds])
            begin = start - (last is not None)
            last = bounds[-1:]
            way = np.diff(self._way[rows[begin : begin + len(bounds)]], axis=0) @ self._reach.T
            lower = (bounds[:-1] + bounds[1:] - way) / 2
            piece, pair = np.nonzero(~self._settled(lower, self._measured))
            pairs.append(pair)
            pieces.append(piece + begin)
        none = np.zeros(0, np.intp)
        return np.concatenate([none, *pairs]), np.concatenate([none, *pieces])

    def settle(
        self, rows: NDArray[np.intp], undecided: tuple[NDArray[np.intp], NDArray[np.intp]]
    ) -> None:
        """Decide by measurement whether undecided pairs collide or are the closest.

        ``undecided`` is two index arrays, of the pairs and of the pieces on which bounds do not
        decide. Piece k is the motion from sample ``rows[k]`` to ``rows[k + 1]``. At most 4000
        distances are measured. After a collision, only an earlier one is sought. The minimum
        distance, the first collision and the pairs that stay undecided are stored for
        :meth:`found`.
        """
        self._left, self._undecided = _MOST, []
        pairs, pieces = undecided
        order = np.argsort(pairs, kind="stable")
        pairs, pieces = pairs[order], pieces[order]
        for pair in np.unique(pairs).tolist():
            here = pieces[slice(*np.searchsorted(pairs, [pair, pair + 1]))]
            begin, end = rows[[here, here + 1]].astype(np.float64)
            self._settle_pair(pair, begin, end)

    def _settle_pair(self, pair: int, begin: Array, end: Array) -> None:
        """Measure a pair on M pieces until bounds exclude a collision and a new minimum on all.

        The pieces extend from the positions ``begin`` (M,) to ``end`` (M,).
        """
        measured = bool(self._measured[pair])
        pieces = self._pieces(pair, begin, end)
        while True:
            pieces = pieces.of(
                ~self._settled(pieces.lower, measured) & (pieces.begin < self._touch)
            )
            # measuring the middle of such a piece could not settle it
            large = ~self._settled(pieces.upper - pieces.size, measured)
            floor = _FLOOR if self._touch == np.inf else _FLOOR_OF_TOUCH
            tiny = large & ~((pieces.size > floor) & np.isfinite(pieces.size))
            if tiny.any():
                self._leave(pair)
                pieces, large = pieces.of(~tiny), large[~tiny]
            if not len(large):
                return
            if self._left <= 0:
                self._leave(pair)
                return
            if large.any():
                pieces = pieces.of(~large).and_those(self._halves(pair, pieces.of(large)))
                continue
            k = int(np.argmin(pieces.lower))
            distance = self._measure(pair, float(pieces.middle[k]))
            pieces = pieces.after(distance, pieces.center[k])

    def _leave(self, pair: int) -> None:
        """Record that a pair is left undecided; only the first such pair is reported."""
        self._undecided.append(pair)

    def test_samples(self, rows: NDArray[np.intp]) -> None:
        """Test all pairs at samples ``rows`` (R,) too, if the search on pieces was not complete.

        It was not complete in three cases. A collision was found, so that the search skipped later
        ones. A collision-only pair stayed undecided. Or the motion has one sample, hence no pieces.
        In other cases nothing is done. The minimum distance, the first collision and the distances
        at the samples are updated.
        """
        undecided = not self._measured[self._undecided].all()
        if self._touch < np.inf or undecided or len(rows) == 1:
            distances, _ = self._model.least(self._Q[rows])
            for row, distance in zip(rows.tolist(), distances.tolist(), strict=True):
                self._note(float(row), distance)
            self._points += len(rows)
            self._distances = [np.minimum(np.concatenate(self._distances), distances)]

    @property
    def stopped_after_a_collision(self) -> bool:
        """Whether measurements ended at their maximum number, although a collision was found.

        Most measurements may have been made before this collision was known, so there may be an
        earlier one.
        """
        return self._touch < np.inf and self._left <= 0

    def _pieces(self, pair: int, begin: Array, end: Array) -> _Pieces:
        """Make M pieces of the motion, from the positions ``begin`` to ``end`` (M,).

        A position is a sample number; a fraction lies between two samples. Nothing is known of the
        distance of ``pair``, an index, on these pieces yet: its bounds are −inf and inf.
        """
        middle = (begin + end) / 2
        long = end - begin > 1
        middle[long] = np.rint(middle[long])
        way = _between(self._way, middle)
        half = np.maximum(way - _between(self._way, begin), _between(self._way, end) - way)
        none = np.full(len(begin), np.inf)
        moves = np.flatnonzero(self._reach[pair])
        center = _between(self._Q, middle)[:, moves] * self._reach[pair, moves]
        return _Pieces(begin, end, middle, half @ self._reach[pair], -none, none, center)

    def _halves(self, pair: int, pieces: _Pieces) -> _Pieces:
        """Halve each piece at its middle, and return the halves: first halves, then second ones.

        ``pair`` is the index of the pair of bodies whose distance the pieces bound.
        """
        begin, end = np.stack([pieces.begin, pieces.middle]), np.stack([pieces.middle, pieces.end])
        halves = self._pieces(pair, begin.ravel(), end.ravel())
        moved = np.abs(halves.center - np.tile(pieces.center, (2, 1))).sum(axis=1)
        return halves._replace(
            lower=np.tile(pieces.lower, 2), upper=np.tile(pieces.upper, 2) + moved
        )

    def _settled(self, lower: Array, measured: NDArray[np.bool_] | bool) -> NDArray[np.bool_]:
        """Test by lower bounds, m, which distances need no further measurement.

        The result is a mask with the shape of ``lower``. It is True where the bound excludes a
        collision. For a ``measured`` pair, the bound must also be above the minimum found so far,
        reduced by 10 % or 5 mm, whichever is more. This second condition is dropped after a
        collision, and while no distance is known.
        """
        if self._touch < np.inf or self._best <= _SMALL or self._best == np.inf:
            return lower > 0
        least = self._best - max(_SHARE * self._best, _SMALL)
        return lower > least * measured

    def _measure(self, pair: int, at: float) -> float:
        """Measure and record the distance of a pair at position ``at``, m; negative in a collision.

        The pair can be a collision-only pair. Its distance is returned, but only a collision is
        recorded.
        """
        self._left -= 1
        self._points += 1
        q = self._Q[int(at)] if at.is_integer() else _between(self._Q, np.array([at]))[0]
        distance = float(self._model.some_distances(q, np.array([pair]), exact=True)[0])
        if distance < 0:
            self._note(at, self._measure_all(at)[0])
        elif self._measured[pair]:
            self._note(at, distance)
        return distance

    def _measure_all(self, at: float) -> tuple[float, int]:
        """Measure the minimum distance at position ``at``: return it, m, and the pair's index.

        The minimum is over the measured pairs, and over the collision-only pairs that collide. It
        is inf, and the index −1, if there are none.
        """
        found, which = self._model.least(_between(self._Q, np.array([at])))
        return float(found[0]), int(which[0])

    def _note(self, at: float, distance: float) -> None:
        """Record a distance, m, that was measured at the position ``at``."""
        if distance < self._best:
            self._best, self._at = distance, at
        if distance < 0:
            self._touch = min(self._touch, at)


class _Pieces(NamedTuple):
    """M pieces of a motion on which a pair is undecided, with bounds on the pair's distance.

    Attributes
    ----------
    begin, end, middle : (M,) arrays
        Positions of the ends and middles of the pieces, as sample numbers.
    size : (M,) array
        ρ·w: how far the pair's bodies can move relative to each other between the middle and any
        point of the piece, m.
    lower : (M,) array
        Lower bound on the distance anywhere on the piece, m.
    upper : (M,) array
        Upper bound on the distance at the middle, m.
    center : (M, ·) array
        ρ_j c_j at the middle c, m, for each joint j that moves the pair.
    """

    begin: Array
    end: Array
    middle: Array
    size: Array
    lower: Array
    upper: Array
    center: Array

    def of(self, which: NDArray[np.bool_]) -> _Pieces:
        """Select the pieces that a mask (M,) marks."""
        return self if which.all() else _Pieces(*(values[which] for values in self))

    def and_those(self, more: _Pieces) -> _Pieces:
        """Return these pieces, followed by the pieces ``more``."""
        return _Pieces(*map(np.concatenate, zip(self, more, strict=True)))

    def after(self, distance: float, at: Array) -> _Pieces:
        """Return the pieces with bounds tightened by a ``distance``, m, that was measured.

        ``at`` is ρ_j x_j of the configuration x of the measurement, as a row of ``center``.
        """
        moved = np.abs(self.center - at).sum(axis=1)
        return self._replace(
            lower=np.maximum(self.lower, distance - moved - self.size),
            upper=np.minimum(self.upper, distance + moved),
        )


def _between(values: Array, at: Array) -> Array:
    """Interpolate the rows of ``values`` (K, N) at M fractional row numbers ``at``: (M, N)."""
    first = np.minimum(at.astype(np.intp), len(values) - 1)
    last = np.minimum(first + 1, len(values) - 1)
    share = (at - first)[:, None]
    return np.asarray((1 - share) * values[first] + share * values[last])
