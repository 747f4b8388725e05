"""Designs of places: functions over candidate sectors, with their rating and worth.

The *worth* of a sector, m², is its area times (1 + s) / 2. The angle and the spin each have a
range, a fraction of a full turn; s is the smaller of the two fractions. The *rating* is the worth,
reduced for high joint speed and near bodies. A quick design has low accuracy, and serves to rank
sectors. The argument ``fit`` has the arguments of a design. ``useful`` is a function (place, part
of its sector) → True if a design over that part is still of use.

``Place`` is a candidate sector: its cell, the configuration in its middle, an upper bound of its
rating (m²), and a quick design. ``CellFit`` holds the arguments of a design over a cell, and the
methods that compute the design. ``Required`` holds the limits of a function: mean and maximum extra
joint speed relative to J⁺ (0.05 is 5 %), and body distance, m.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from ....base.errors import InputError
from ..cell_design_result import CellDesign
from ..fit.cell_fit import CellFit
from ..fit.trimming import Required, covered_share, trimmed
from ..geometry.cell import Cell
from ..place.posture_search import given
from .largest_profile import area_of
from .places import Place

_AWAY = 2.0
"""Body distance that is requested of a fit, relative to that which its sector keeps."""

BETTER = 0.2
"""Advantage in rating, relative, below which a place is not compared with the best one."""


def at_bodies(design: CellDesign) -> bool:
    """Test whether bodies come so near in a design's sector that they may limit the sector."""
    return bool(design.body_distance < 2 * design.requested_body_distance)


_Useful = Callable[[Place, Cell], bool]
"""Tells whether a design over a part of a place's sector can be taken."""


def _always(place: Place, part: Cell) -> bool:
    """Return True: a design over any part of a place is useful."""
    return True


def larger_of(found: CellDesign, design: CellDesign) -> CellDesign:
    """Return ``found`` if both its area and its worth are larger, else ``design``."""
    larger = worth(found) > worth(design) and area_of(found.cell) > area_of(design.cell)
    return found if larger else design


def first_design(
    fit: CellFit, places: Iterable[Place], limits: Required, useful: _Useful = _always
) -> CellDesign | None:
    """Design the places in turn until a design succeeds; return it, or None if none does.

    A design succeeds if one function meets ``limits`` on a ``useful`` part of the place's sector.
    Places whose whole sector is not ``useful`` are left out.
    """
    for place in places:
        if not useful(place, place.cell):
            continue
        with suppress(InputError):
            q = given(place.cell, place.posture)
            there = limits._replace(window=place.window)
            part_is_useful = partial(useful, place)
            found = trimmed(fit, place.cell, q, there, place.design, useful=part_is_useful)
            if found is not None:
                return found
    return None


def most_of(place: Place, part: Cell) -> float:
    """Return an upper bound of the worth of a design over a part of a place, m².

    The bound of the place, ``place.most``, is reduced in proportion to the area of the part.
    """
    return place.most / area_of(place.cell) * area_of(part)


def by_rating(fit: CellFit, places: list[Place], limits: Required) -> list[Place]:
    """Rate places by a quick design of each, within ``limits``; return them, the best first.

    The rating is that of the part of the sector in which the design meets the limits. A place that
    cannot be more than 20 % better than the best so far keeps the rating 0, without a design. A
    place is left out if inverse kinematics does not lead from its configuration to the middle of
    its sector.
    """
    ranked: list[Place] = []
    for place in places:
        best = max((one.rating for one in ranked), default=0.0)
        if place.design is None and place.most < (1 + BETTER) * best:
            ranked.append(place)
            continue
        with suppress(InputError):
            q = given(place.cell, place.posture)
            there = limits._replace(window=place.window)
            share, design = covered_share(fit, place.cell, q, there, place.design)
            rating = share * _rating(place.cell, design, there)
            ranked.append(place._replace(posture=q, rating=rating, design=design))
    return sorted(ranked, key=lambda place: -place.rating)


def designed(fit: CellFit, ranked: list[Place], limits: Required) -> CellDesign:
    """Design a function for the first place that one function covers without a collision.

    InputError is raised if there is none.
    """
    design = first_design(fit, ranked, limits)
    if design is not None:
        return design
    name = fit.desired.task.robot.name
    raise InputError(
        f"no range of radius and height around the base of {name} was found that one function "
        f"covers at this orientation{_failed(ranked, limits)}",
        remedy="give another orientation, larger limits of extra joint speed (most_extra=), or the "
        "size of a box of poses",
    )


def farther_from_bodies(
    fit: CellFit,
    place: Place,
    limits: Required,
    design: CellDesign | None,
    useful: _Useful = _always,
) -> CellDesign | None:
    """Design a function that keeps away from bodies; return it if it is better, else ``design``.

    The given ``design``, or None, was made for minimum joint speed only, and its sector ends at
    bodies. The better design is that with the larger worth. The function is not designed over parts
    of the place that are not ``useful``.
    """
    place = place._replace(design=None)
    other = first_design(_away(fit, limits), [place], limits, useful)
    if other is None or design is None:
        return other or design
    return max(design, other, key=worth)


def _away(fit: CellFit, limits: Required) -> CellFit:
    """Return ``fit`` with a body distance to keep that is twice that of ``limits``."""
    return replace(fit, body_distance=_AWAY * limits.distance)


def worth(design: CellDesign) -> float:
    """Rate a final design: the area of its sector, m², times (1 + s) / 2.

    s is the smaller of two fractions of a full turn: those that the angle and the spin cover.
    """
    cell = design.cell
    turns = [cell.widths[one.coordinate] / np.pi for one in design.function.chart.cell.removed]
    return area_of(cell) * (0.5 + 0.5 * float(min(turns, default=1.0)))


def _failed(ranked: list[Place], limits: Required) -> str:
    """Write why the first place with a quick design fails; the text completes an error message.

    The text is empty if no place has a quick design.
    """
    design = next((place.design for place in ranked if place.design is not None), None)
    if design is None:
        return ""
    if design.body_distance < limits.distance:
        links = " and ".join(design.evaluation.nearest_bodies)
        return f": {links} come to {1e3 * design.body_distance:.0f} mm"
    if design.failures:
        return f": {max(design.failures, key=lambda stop: stop.share).what}"
    most = f"{100 * limits.mean:g} % on average and {100 * limits.worst:g} % at the worst pose"
    return f": extra joint speed exceeds {most}"


def _rating(cell: Cell, design: CellDesign | None, limits: Required) -> float:
    """Rate a quick design by area, range around the arm, body distance and joint speed, m².

    The rating is the area, times a factor from 0.5 to 1 for the range of angle and spin, divided by
    1 plus the extra joint speed. Where bodies are too near, the sector is reduced later, so the
    rating is 10 % lower, or 15 % with a collision. Without a design, the rating is half of the
    area.
    """
    if design is None:
        return 0.5 * area_of(cell)
    near, turns = 1.0, [turn.reach / (2 * np.pi) for turn in design.evaluation.turns]
    if limits.window is not None:
        turns.append(limits.window.half / np.pi)
    elif design.body_distance < limits.distance:
        near = 0.85 if design.body_distance < 0 else 0.9
    share = max(min(turns, default=1.0), 0.0)
    extra = float(np.nan_to_num(design.extra_speed, nan=1.0))
    return area_of(cell) * near * (0.5 + 0.5 * min(share, 1.0)) / (1 + extra)
