"""Openings: the parts of floods in which bodies keep a distance, in a window of the angle.

A table is a grid of radius and height around the arm, at the angle 0. A flood is the set of its
nodes that the arm reaches from one configuration without a change of branch (of the inverse
kinematics). A window is a range of the angle around the arm in which bodies keep a distance; an
opening is a window of one flood, with the nodes at which bodies keep the distance at all its
angles. The spin of a sector is the rotation of the tool about its own z axis. Symmetries are the
joints that alone turn the whole arm, or the tool. The *worth* of a sector, m², is its area times (1
+ s) / 2. The angle and the spin each have a range, a fraction of a full turn; s is the smaller of
the two fractions. Masks (I, J) have one entry per node, for I radii and J heights. S is the number
of floods, n that of joints, K that of openings or configurations.

``Floods`` are S floods: each is a set of neighbouring nodes with one configuration per node, so
that q changes continuously. ``Table`` is a grid of poses (nodes) over radius and height around an
axis, at the angle 0 and one orientation. ``Rectangles`` are the largest rectangles of nodes in S
masks: areas, first and last indices of radius and height. ``Symmetry`` is a joint that changes only
one coordinate of the frame: the indices of both, and the sign, 1 or −1, of the change. ``Shut`` is
masks of the nodes that cannot be used at M angles: ``near``, a body is too near, and ``out``, a
limit is exceeded.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array
from ....model.task import Task
from ..geometry.symmetry import Symmetry
from .flood import SPACING, Rectangles, Table, rectangles
from .flood_sets import Floods
from .windows import Shut, shut, windows

DESIGNED = 3
"""Number of postures for which functions are designed."""

CLEAR, TIGHT, MUCH = 0.005, 0.001, 0.85
"""Body distance that a whole table keeps, m; the smaller one, m, which it keeps if the first leaves
less than this share of the worth, as where two links are always near each other."""

_KEPT, AS_GOOD = 3, 0.95
"""Number of windows of the angle per flood for which rectangles are searched for; and share of what
a flood would be worth without bodies, or of the best rating, from which on others are as good."""


def units(openings: Openings) -> Array:
    """Return the worth of one node of each opening, m², if joint limits end no angle: (K,)."""
    return np.asarray(SPACING**2 * (0.5 + 0.5 * openings.half / np.pi))


def turn_factors(
    table: Table,
    floods: Floods,
    openings: Openings,
    found: Rectangles,
    symmetries: tuple[Symmetry, ...],
) -> Array:
    """Rate the range around the arm of one rectangle per opening: (1 + s) / 2, (K,).

    s is the smallest of three fractions of a full turn: the width of the window, and the ranges
    that the limits of the joints leave to the angle and to the spin. ``found`` has the rectangles.
    """
    task, share = table.task, openings.half / np.pi
    for k, flood in enumerate(openings.flood):
        (i, j), (i_end, j_end) = found.first[k], found.last[k] + 1
        Q = floods.Q[flood, i:i_end, j:j_end].reshape(-1, task.n)
        share[k] = turn_share(task, symmetries, Q, share[k])
    return 0.5 + 0.5 * share


def turn_share(task: Task, symmetries: tuple[Symmetry, ...], Q: Array, share: float) -> float:
    """Return the fraction of a full turn that is left to the angle and the spin, at most ``share``.

    For the angle, what is left is the range of the joint that turns the arm, minus the variation of
    this joint over the configurations Q (K, n); for the spin, the same holds for the joint that
    turns the tool. The smaller fraction is returned.
    """
    for one in symmetries:
        left = task.upper[one.joint] - task.lower[one.joint] - np.ptp(Q[:, one.joint])
        share = min(share, max(0.0, float(np.nan_to_num(left)) / (2 * np.pi)))
    return share


class Openings(NamedTuple):
    """K windows of floods, with the nodes that are free of collisions at all their angles.

    Attributes
    ----------
    flood : (K,) array of int
        Index of the flood.
    middle, half : (K,) arrays
        Middle and half-width of the angle, rad; the half-width of a whole turn is π.
    mask : (K, I, J) array of bool
        Nodes of the flood at which bodies keep the distance at all these angles.
    clear : (L, I, J) array of bool
        For each of the L floods that were tested, the nodes at which bodies keep the distance at
        one or more angles.
    """

    flood: NDArray[np.intp]
    middle: Array
    half: Array
    mask: NDArray[np.bool_]
    clear: NDArray[np.bool_]


def whole_turns(floods: Floods) -> Openings:
    """Make one opening per flood: the window of a whole turn, as if there were no bodies."""
    S = len(floods.Q)
    return Openings(np.arange(S), np.zeros(S), np.full(S, np.pi), floods.reached, floods.reached)


def best_clear(
    table: Table, floods: Floods, bound: Array, symmetries: tuple[Symmetry, ...]
) -> tuple[float, Openings]:
    """Choose the body distance to keep, 5 mm or 1 mm; return it, m, with the openings that keep it.

    1 mm is chosen if the best worth with 5 mm is below 85 % of that with 1 mm. The worth of an
    opening is that of its largest rectangle, in units of the spacing squared. ``bound`` (S,) is the
    worth of each flood without regard to bodies, in the same unit; no opening of the flood exceeds
    it.
    """
    known: dict[int, Shut] = {}
    wide = _opened(table, floods, bound, CLEAR, symmetries, known)
    rating = _values(table, floods, wide, symmetries).max()
    if rating < MUCH * bound.max():
        tight = _opened(table, floods, bound, TIGHT, symmetries, known)
        if rating < MUCH * _values(table, floods, tight, symmetries).max():
            return TIGHT, tight
    return CLEAR, wide


def _opened(
    table: Table,
    floods: Floods,
    bound: Array,
    distance: float,
    symmetries: tuple[Symmetry, ...],
    known: dict[int, Shut],
) -> Openings:
    """Find the best openings of floods, up to three per flood, in which bodies keep a distance, m.

    The test of bodies is slow, so a flood is left out if its openings can have neither a better
    worth nor a larger rectangle than those found before. ``bound`` (S,) is the worth of each flood
    without bodies, in units of the nodes' spacing squared. ``known`` has results for a larger
    distance, by number of the flood; nodes that are free in these results are not tested again. The
    results of this call replace them in ``known``.
    """
    parts: list[list[Any]] = []
    clear: list[NDArray[np.bool_]] = []
    values: list[float] = []
    most = rectangles(floods.reached).area
    largest = -1.0
    for k, flood in enumerate(floods.Q):
        better = sum(value > AS_GOOD * bound[k] for value in values)
        if better >= DESIGNED and most[k] <= largest:
            continue
        there = known[k] = shut(table, np.asarray(flood), distance, known.get(k))
        clear.append(np.isfinite(flood[..., 0]) & ~np.all(there.near | there.out, axis=0))
        largest = max(largest, rectangles(clear[-1][None]).area[0])
        middle, half, mask = windows(there)
        some = Openings(np.full(len(half), k), middle, half, mask, clear[-1][None])
        rating = _values(table, floods, some, symmetries)
        values.append(min(rating.max(), bound[k]))
        best = np.argsort(-rating, kind="stable")[:_KEPT]
        parts.append([some.flood[best], middle[best], half[best], mask[best]])
    flood, middle, half, mask = (np.concatenate(each) for each in zip(*parts, strict=True))
    return Openings(flood, middle, half, mask, np.array(clear))


def _values(
    table: Table, floods: Floods, openings: Openings, symmetries: tuple[Symmetry, ...]
) -> Array:
    """Rate K openings by the area of their largest rectangles, times (1 + s) / 2: (K,).

    The area is in units of the nodes' spacing squared. s is the smallest of three fractions of a
    full turn: the width of the window, and the ranges that joint limits leave to the angle and to
    the spin.
    """
    found = rectangles(openings.mask)
    return found.area * turn_factors(table, floods, openings, found, symmetries)
