"""Best shape: the design of a sector whose range of radius may depend on the height.

A sector "with one range of radius" has the same range at all heights. A table is a grid of radius
and height around the arm, at the angle 0. A flood is the set of its nodes that the arm reaches from
one configuration without a change of branch (of the inverse kinematics). A window is a range of the
angle around the arm in which bodies keep a distance; an opening is a window of one flood, with the
nodes at which bodies keep the distance at all its angles. The *worth* of a sector, m², is its area
times (1 + s) / 2. The angle and the spin each have a range, a fraction of a full turn; s is the
smaller of the two fractions. The *rating* is the worth, reduced for high joint speed and near
bodies. A design keeps a body distance of 5 mm. If 5 mm would leave less than 85 % of what 1 mm
leaves, it keeps 1 mm, "the smaller body distance". A quick design has low accuracy, and serves to
rank sectors. Symmetries are the joints that alone turn the whole arm, or the tool; ``line`` (2, 3)
is the axis of the joint that turns the arm: a point, m, and a direction. The argument ``fit`` has
the arguments of a design.

``Place`` is a candidate sector: its cell, the configuration in its middle, an upper bound of its
rating (m²), and a quick design. ``Straight`` are the sectors with one range of radius, and the
function over the largest that one covers. ``Openings`` are K openings: each is a window of one
flood, with the nodes at which bodies keep a distance at all its angles. ``Floods`` are S floods:
each is a set of neighbouring nodes with one configuration per node, so that q changes continuously.
``Table`` is a grid of poses (nodes) over radius and height around an axis, at the angle 0 and one
orientation. ``Symmetry`` is a joint that changes only one coordinate of the frame: the indices of
both, and the sign, 1 or −1, of the change. ``CellFit`` holds the arguments of a design over a cell,
and the methods that compute the design. ``Required`` holds the limits of a function: mean and
maximum extra joint speed relative to J⁺ (0.05 is 5 %), and body distance, m.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial

import numpy as np

from ....base.arguments import Array
from ....base.errors import InputError, RepctlError
from ..cell_design_result import CellDesign
from ..fit.cell_fit import CellFit
from ..fit.locked_function import function_through
from ..fit.trimming import Required, covered_share, kept_where_good
from ..geometry.cell import Cell
from ..geometry.symmetry import Symmetry
from ..place.posture_search import given
from .designs import BETTER, at_bodies, first_design, larger_of, most_of, worth
from .flood import Table
from .flood_sets import Floods
from .largest_profile import area_of, most_between
from .openings import AS_GOOD, CLEAR, MUCH, TIGHT, Openings, units
from .places import Place, relaxed_place
from .priced_sides import by_price
from .straight import Straight

_ATTEMPTS, _SLIGHTLY, _NEARLY = 3, 0.05, 0.8
"""Number of places for which functions are designed if the first ones lose much, the advantage in
expected worth below which a place is left out, and share of a sector that a cut must leave, else it
gets new sides."""

_RELAXED = 6
"""Number of openings whose floods are relaxed."""


def best_design(
    fit: CellFit,
    shaped: list[Place],
    smooth: list[Place],
    limits: Required,
    straight: Straight,
    through: Callable[[Required], CellDesign | None],
) -> tuple[CellDesign, Required]:
    """Design the best sector; return the design and its limits, whose distance may be reduced.

    With the smaller body distance, the function ``through(limits)`` through a relaxed flood is made
    first. It is taken if it covers 85 % of the largest rectangle, and as much as a function over
    one range of radius can. The other arguments are those of :func:`_best_shape`.
    """
    found = through(limits) if limits.distance == TIGHT else None
    if found is not None:
        least = max(MUCH * straight.rectangle, straight.largest)
        if area_of(found.cell) >= least and worth(found) > AS_GOOD * straight.most:
            return found, limits
    return _best_shape(fit, shaped, smooth, limits, straight)


def through_flood(
    fit: CellFit,
    table: Table,
    floods: Floods,
    openings: Openings,
    line: Array,
    symmetries: tuple[Symmetry, ...],
    limits: Required,
) -> CellDesign | None:
    """Make the function through the best flood, relaxed, and cut its sector where it fails.

    A function of minimum joint speed leaves the configurations of its flood, and may so have a
    collision. The floods of the openings with the largest bounds are relaxed. The sector is the one
    with the largest worth in which such a flood keeps ``limits``, at its own joint speeds. Return
    None if too little is left.
    """
    most = units(openings) * [most_between(mask) for mask in openings.mask]
    tried = map(int, np.argsort(-most, kind="stable")[:_RELAXED])
    relax = partial(relaxed_place, table, floods, openings, line, symmetries, limits)
    places = [found for found in map(relax, tried) if found is not None]
    if places:
        place, Q = max(places, key=lambda one: one[0].most)
        with suppress(RepctlError):
            design = function_through(fit, place.cell, Q)
            return design and kept_where_good(fit, design, limits._replace(window=place.window))
    return None


def _best_shape(
    fit: CellFit, shaped: list[Place], smooth: list[Place], limits: Required, straight: Straight
) -> tuple[CellDesign, Required]:
    """Design the sector of the best shape, whose range of radius may depend on the height.

    ``shaped`` are the sectors, the best first, and ``smooth`` those with sides of lower degree. A
    function over a sector with one range, from ``straight``, is designed only if it may be as good.
    Return the design and its limits, whose body distance may be reduced.
    """
    if shaped and shaped[0].most > (1 + BETTER) * straight.most:
        found = _best_of(fit, shaped, smooth, limits)
        if found is not None and _settled(found, shaped[0].most, limits, straight):
            return found, limits
        if found is not None and straight.limits == limits:
            return straight.or_larger(found), limits
    try:
        design = straight.design
    except InputError:
        found = _best_of(fit, shaped, smooth, straight.limits)
        if found is None:
            raise
        return found, straight.limits
    design = _larger_design(fit, shaped, straight.limits, design)
    return _or_better(fit, smooth, straight.limits, design), straight.limits


def _settled(found: CellDesign, most: float, limits: Required, straight: Straight) -> bool:
    """Test that no sector with one range is larger, and no smaller body distance is needed.

    ``straight`` are the sectors with one range. A smaller body distance is not needed if ``limits``
    have the smaller distance already, if bodies do not come near in ``found``, or if the worth of
    ``found`` is above 85 % of ``most``, m². ``most`` is an upper bound of the worth of any sector's
    design.
    """
    larger = worth(found) > straight.most and area_of(found.cell) > straight.largest
    free = limits.distance < CLEAR or not at_bodies(found) or worth(found) > MUCH * most
    return larger and free


def _larger_design(
    fit: CellFit, places: list[Place], limits: Required, design: CellDesign
) -> CellDesign:
    """Design the places in turn until a design succeeds; return this or the given ``design``.

    The new design is returned if both its area and its worth are larger than those of ``design``.
    Places that cannot exceed ``design`` in both are left out.
    """
    found = first_design(fit, places, limits, partial(_can_exceed, other=design))
    return design if found is None else larger_of(found, design)


def _best_of(
    fit: CellFit, shaped: list[Place], smooth: list[Place], limits: Required
) -> CellDesign | None:
    """Design places of both kinds, the likely ones first; return the largest design, or None.

    The largest design is that with the largest worth. At most three places are tried. A place is
    left out if the worth expected of it is at most 5 % above that of the best design so far. The
    search ends when that worth exceeds 95 % of the largest bound of all places.
    """
    best: CellDesign | None = None
    likely = _likely(fit, sorted([*shaped, *smooth], key=lambda place: -place.most), limits)
    most = max((place.most for place, _ in likely), default=0.0)
    for place, share in likely[:_ATTEMPTS]:
        least = 0.0 if best is None else worth(best)
        if least > AS_GOOD * most:
            break
        if place.rating > (1 + _SLIGHTLY) * least:
            found = _design_of(fit, place, limits, share, least)
            best = max((one for one in (best, found) if one), key=worth, default=None)
    return best


def _likely(fit: CellFit, places: list[Place], limits: Required) -> list[tuple[Place, float]]:
    """Add quick designs to places, and sort the places by the worth that is expected of them.

    A quick design shows which ``share`` of the sector a cut would leave. New sides leave more, so
    the place is expected to have √share times its bound. ``places`` have the largest bound first;
    the rest is left out after a place of which as much is expected as the best of the rest can
    have. Return each place with its share.
    """
    found: list[tuple[Place, float]] = []
    for place in places:
        if max((one.rating for one, _ in found), default=0.0) >= place.most:
            break
        with suppress(InputError):
            q, there = given(place.cell, place.posture), limits._replace(window=place.window)
            share, quick = covered_share(fit, place.cell, q, there, place.design)
            rating = place.most * float(np.sqrt(share))
            found.append((place._replace(design=quick, rating=rating), share))
    return sorted(found, key=lambda one: -one[0].rating)


def _design_of(
    fit: CellFit, place: Place, limits: Required, share: float, least: float
) -> CellDesign | None:
    """Design a function for a place, whose sector is cut, or gets new sides, where it fails.

    ``share`` is the part of the sector that a cut of the place's quick design would leave. If this
    is less than 80 %, a design with new sides is made first, see :func:`by_price`. A design with a
    cut is made, too, if its worth may exceed ``least``, m², and the worth of the design with new
    sides. Return the design with the larger worth, or None if neither succeeds. No design is made
    over a part whose worth cannot exceed ``least``.
    """
    found, there = None, limits._replace(window=place.window)

    def useful(part: Cell) -> bool:
        return most_of(place, part) > least

    with suppress(InputError):
        if place.design is not None and share < _NEARLY:
            found = by_price(fit, place.design, there, useful)
            least = least if found is None else max(least, worth(found))
    if share * place.most > least:
        other = first_design(fit, [place], limits, lambda place, part: most_of(place, part) > least)
        found = max((one for one in (found, other) if one), key=worth, default=None)
    return found


def _or_better(
    fit: CellFit, places: list[Place], limits: Required, design: CellDesign
) -> CellDesign:
    """Design the places in turn until a design succeeds; return this design if its worth is larger.

    Otherwise return the given design. Places that cannot have a larger worth are left out.
    """

    def useful(place: Place, part: Cell) -> bool:
        return most_of(place, part) > worth(design)

    found = first_design(fit, places, limits, useful)
    return design if found is None else max(design, found, key=worth)


def _can_exceed(place: Place, part: Cell, other: CellDesign) -> bool:
    """Test whether a design over a part of a place can exceed ``other`` in area and in worth."""
    return area_of(part) > area_of(other.cell) and most_of(place, part) > worth(other)
