"""Sectors with one range of radius: the function over the largest that one function covers.

A sector "with one range of radius" has the same range at all heights. The *worth* of a sector, m²,
is its area times (1 + s) / 2. The angle and the spin each have a range, a fraction of a full turn;
s is the smaller of the two fractions. A design keeps a body distance of 5 mm. If 5 mm would leave
less than 85 % of what 1 mm leaves, it keeps 1 mm, "the smaller body distance". A quick design has
low accuracy, and serves to rank sectors. The argument ``fit`` has the arguments of a design.

``Place`` is a candidate sector: its cell, the configuration in its middle, an upper bound of its
rating (m²), and a quick design. ``CellFit`` holds the arguments of a design over a cell, and the
methods that compute the design. ``Required`` holds the limits of a function: mean and maximum extra
joint speed relative to J⁺ (0.05 is 5 %), and body distance, m.
"""

from __future__ import annotations

from functools import cached_property, partial
from itertools import takewhile

from ..cell_design_result import CellDesign
from ..fit.cell_fit import CellFit
from ..fit.trimming import Required
from ..geometry.cell import Cell
from .designs import (
    at_bodies,
    by_rating,
    designed,
    farther_from_bodies,
    first_design,
    larger_of,
    most_of,
    worth,
)
from .largest_profile import area_of
from .openings import CLEAR, MUCH, TIGHT
from .places import Place


class Straight:
    """Sectors with one range of radius, and the function over the largest that one covers.

    :attr:`design` is that function. It is designed when the attribute is first read.

    Parameters
    ----------
    fit
        Arguments of the design.
    places
        The sectors, in descending order of the upper bounds of their worth.
    limits
        Limits of the function.
    rectangle
        Area of the largest rectangle in a flood without collision, m². If the function covers much
        less because bodies are near, a second function is designed, which keeps away from bodies.
    """

    def __init__(
        self, fit: CellFit, places: list[Place], limits: Required, rectangle: float
    ) -> None:
        self._fit, self._places, self._given = fit, places, limits
        self.rectangle = rectangle

    @property
    def most(self) -> float:
        """Upper bound of the worth of a function over one of the sectors, m²; 0 without sectors."""
        return max((place.most for place in self._places), default=0.0)

    @property
    def largest(self) -> float:
        """Largest area of one of the sectors, m², which no design exceeds; 0 without sectors."""
        return max((area_of(place.cell) for place in self._places), default=0.0)

    @property
    def known(self) -> CellDesign | None:
        """The function, if it was designed already; else None."""
        return vars(self).get("design")

    @property
    def limits(self) -> Required:
        """Limits of the function: the given limits, or these with the smaller body distance.

        The smaller body distance is used if the given distance leaves too little of the best
        sector.
        """
        return self._ranking[1]

    @cached_property
    def _ranking(self) -> tuple[list[Place], Required]:
        """Sectors, the best first, with quick designs; and :attr:`limits`."""
        limits, ranked = self._given, by_rating(self._fit, self._places, self._given)
        if limits.distance == CLEAR and ranked and ranked[0].rating < MUCH * ranked[0].most:
            # where bodies end the sector, a smaller distance may leave more of it
            closer = limits._replace(distance=TIGHT)
            others = by_rating(self._fit, ranked, closer)
            if ranked[0].rating < MUCH * others[0].rating:
                return others, closer
        return ranked, limits

    @cached_property
    def design(self) -> CellDesign:
        """The function, designed when it is first read.

        InputError is raised if no function covers any of the sectors.
        """
        ranked, limits = self._ranking
        found = designed(self._fit, ranked, limits)
        if area_of(found.cell) < MUCH * self.rectangle and at_bodies(found):
            return farther_from_bodies(self._fit, ranked[0], limits, found) or found
        return found

    def or_larger(self, other: CellDesign) -> CellDesign:
        """Return ``other`` if it exceeds the function in area and in worth, else the function.

        A quick design shows which part of a sector a function can cover. The function of full
        accuracy is designed only if this part may have the area or the worth of ``other``.
        """
        ranked, limits = self._ranking
        if not ranked:
            return other
        first = ranked[0]
        useful = partial(_can_equal, other=other)
        quick = [one for one in ranked if one.design]
        # those after a place that is not useful rank lower
        tried = takewhile(lambda one: useful(one, one.cell), quick)
        found = first_design(self._fit, tried, limits, useful)
        at = found or first.design
        near = at is not None and at.body_distance < 2 * limits.distance
        if near and (found is None or area_of(found.cell) < MUCH * self.rectangle):
            found = farther_from_bodies(self._fit, first, limits, found, useful)
        if found is None:
            return other
        self.design = found
        return larger_of(other, found)


def _can_equal(place: Place, part: Cell, other: CellDesign) -> bool:
    """Test whether a design over a part of a place can equal ``other`` in area or in worth."""
    return area_of(part) >= area_of(other.cell) or most_of(place, part) >= worth(other)
