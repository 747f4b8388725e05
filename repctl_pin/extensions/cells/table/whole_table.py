"""Whole table: the largest sector around an arm that one function covers at one orientation.

A table is a grid of radius and height around the arm, at the angle 0. A flood is the set of its
nodes that the arm reaches from one configuration without a change of branch (of the inverse
kinematics). Functions are designed for sectors: the largest rectangles in the best floods, and the
largest parts of the floods whose range of radius depends on the height. A sector "with one range of
radius" has the same range at all heights. A window is a range of the angle around the arm in which
bodies keep a distance; an opening is a window of one flood, with the nodes at which bodies keep the
distance at all its angles. The spin of a sector is the rotation of the tool about its own z axis.

Symmetries are the joints that alone turn the whole arm, or the tool; ``line`` (2, 3) is the axis of
the joint that turns the arm: a point, m, and a direction. Squared joint speeds at nodes, of a
function and of J⁺, are defined in :mod:`.joint_speeds`. The limits of joint speed, in ``limits``,
are the maximum extra joint speed on average and at the worst node. The *worth* of a sector, m², is
its area times (1 + s) / 2. The angle and the spin each have a range, a fraction of a full turn; s
is the smaller of the two fractions. The *rating* is the worth, reduced for high joint speed and
near bodies. A design keeps a body distance of 5 mm. If 5 mm would leave less than 85 % of what 1 mm
leaves, it keeps 1 mm, "the smaller body distance". A quick design has low accuracy, and serves to
rank sectors. A locked flood is that of an arm with r of its joints locked, which is therefore not
redundant. Masks (I, J) have one entry per node, for I radii and J heights. S is the number of
floods, n that of joints, K that of openings, nodes or configurations. A node is a pair of indices
(radius, height). The argument ``fit`` has the arguments of a design, ``report`` is the progress
callback. ``useful`` is a function (place, part of its sector) → True if a design over that part is
still of use.

``CellFit`` holds the arguments of a design over a cell, and the methods that compute the design.
``Required`` holds the limits of a function: mean and maximum extra joint speed relative to J⁺ (0.05
is 5 %), and body distance, m. ``_Place`` is a candidate sector: its cell, the configuration in its
middle, an upper bound of its rating (m²), and a quick design. ``Rectangles`` are the largest
rectangles of nodes in S masks: areas, first and last indices of radius and height. ``WholeTable``
is the result of the search for the largest sector: its design, area and comparison with locked
joints. ``Floods`` are S floods: each is a set of neighbouring nodes with one configuration per
node, so that q changes continuously. ``LockedJoints`` is an arm with r joints locked: the joints,
their values, and the part of a sector that it covers. ``Symmetry`` is a joint that changes only one
coordinate of the frame: the indices of both, and the sign, 1 or −1, of the change. ``Table`` is a
grid of poses (nodes) over radius and height around an axis, at the angle 0 and one orientation.
``_Openings`` are K openings: each is a window of one flood, with the nodes at which bodies keep a
distance at all its angles. ``Between`` is a set of nodes between two polynomials of the height: its
area, first and last height, and both polynomials. ``Straight`` are the sectors with one range of
radius, and the function over the largest that one covers. ``Shut`` is masks of the nodes that
cannot be used at M angles: ``near``, a body is too near, and ``out``, a limit is exceeded.
``LargerArm`` is an arm with locked joints that covers a larger sector than a design.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, partial
from itertools import takewhile
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ....base.arguments import Array
from ....base.errors import InputError, RepctlError
from ....base.progress import Report
from ....model.bodies import bodies_of
from ....model.task import Task
from ....strategies import Pseudoinverse
from ..cell_design_result import CellDesign
from ..evaluate.reach import unlike_rows
from ..fit.cell_fit import CellFit
from ..fit.locked_function import function_through, locked_function
from ..fit.trimming import Required, Window, covered_share, kept_where_good, trimmed, turned
from ..geometry.cell import Cell
from ..geometry.cell_arguments import VERTICAL
from ..geometry.sector import Sector
from ..geometry.sector_profile import MOST_DEGREE
from ..geometry.symmetry import NEAR, Symmetry, axis_symmetry, difference, own_axis, tool_symmetry
from ..place.posture_search import given
from .flood import SPACING, Rectangles, Table, flooded, rectangles
from .flood_sets import (
    ALIKE,
    NEAREST,
    Floods,
    compared,
    drawn_nodes,
    free_floods,
    locked_floods,
    unlike_floods,
)
from .joint_speeds import least_speeds
from .largest_profile import (
    DEAREST,
    SHARES,
    SMOOTH,
    SPARE,
    Between,
    Multipliers,
    affordable_between,
    area_of,
    more_between,
    most_between,
)
from .locked_arms import LargerArm, LockedJoints, best_locked, larger_arm, with_middles
from .outline import outlines
from .priced_sides import by_price, whole_sector
from .relaxed import relaxed, slopes
from .windows import STEP, Shut, free_nodes, shut, windows

_DESIGNED = 3
"""Number of postures for which functions are designed."""

_CLEAR, _TIGHT, _MUCH = 0.005, 0.001, 0.85
"""Body distance that a whole table keeps, m; the smaller one, m, which it keeps if the first leaves
less than this share of the worth, as where two links are always near each other."""

_AWAY = 2.0
"""Body distance that is requested of a fit, relative to that which its sector keeps."""

_BETTER = 0.2
"""Advantage in rating, relative, below which a place is not compared with the best one."""

_KEPT, _AS_GOOD = 3, 0.95
"""Number of windows of the angle per flood for which rectangles are searched for; and share of what
a flood would be worth without bodies, or of the best rating, from which on others are as good."""

_ATTEMPTS, _SLIGHTLY, _NEARLY = 3, 0.05, 0.8
"""Number of places for which functions are designed if the first ones lose much, the advantage in
expected worth below which a place is left out, and share of a sector that a cut must leave, else it
gets new sides."""

_RELAXED = 6
"""Number of openings whose floods are relaxed."""

_LOOKED = 96
"""Number of configurations at which colliding links are looked for, to name them."""

_WINDOWS = 4
"""Number of middles for a box per flood and side of the arm."""

_DEGREE = 3
"""Degree of functions of arms with r > 1."""

_HELD_OUT = 8192


class WholeTable(NamedTuple):
    """The largest sector that one function covers, see :func:`whole_table`.

    Attributes
    ----------
    design : CellDesign
        The function over the sector, whose range of radius may depend on the height.
    rectangles : Straight
        The sectors with one range of radius, and the function over the largest of them.
    locked : LockedJoints or None
        Arm with locked joints that covers the largest share of the sector. Arms within the limits
        of joint speed are preferred to others; among arms with equal shares, the arm with the
        lowest joint speed is chosen.
    larger : LockedJoints or None
        An arm with locked joints that covers a larger sector, whose range of radius may depend on
        the height, within the limits of joint speed at the nodes of the table; None if none was
        found.
    reach, rectangle : float
        Two areas of radius and height, m²: of all nodes that any flood reaches, and of the largest
        rectangle in a flood without collision.
    affordable : float
        Area of the largest rectangle, m², in which some function can keep the limits of joint
        speed: an upper bound of the area of a sector with one range of radius.
    floods : list of (I, J) arrays of bool
        For each flood that was tested, a mask of the nodes that it reaches without collision.
    table : Table
        Grid of the nodes.
    """

    design: CellDesign
    rectangles: Straight
    locked: LockedJoints | None
    larger: LockedJoints | None
    reach: float
    rectangle: float
    affordable: float
    floods: list[NDArray[np.bool_]]
    table: Table

    @property
    def area(self) -> float:
        """Area of the sector's range of radius and height, m²."""
        return area_of(self.design.cell)

    @property
    def straight(self) -> CellDesign:
        """Function over the largest sector with one range of radius.

        If the largest sector has one range of radius, this is ``design`` itself. Otherwise the
        function may be designed only when this attribute is first read, which takes seconds.
        """
        return self.rectangles.design

    @property
    def by_height(self) -> bool:
        """True if the sector's range of radius depends on the height."""
        cell = self.design.cell
        return isinstance(cell, Sector) and cell.profile.degree > 0

    @property
    def outlines(self) -> list[NDArray[Any]]:
        """Closed lines (P, 2) around what the arm reaches: radius and height, m.

        The lines surround the nodes that one of :attr:`floods` reaches, inside the joint limits
        and, for at least one angle around the arm, without a collision.
        """
        return outlines(self.table, np.any(self.floods, axis=0))

    def __str__(self) -> str:
        design, share = self.design, self.area / self.rectangle
        kind = "" if self.by_height else " (one range of radius)"
        text = (
            f"the largest sector that was found{kind}: {self.area:.2g} m² of radius and height, "
            f"{100 * share:.0f} % of the largest rectangle found in its reach; "
            f"+{100 * max(design.extra_speed, 0.0):.1f} % joint speed on average, "
            f"+{100 * max(design.extra_speed_worst, 0.0):.0f} % at the worst pose"
        )
        if design.locked:
            text += f"; it is the function of the arm with {design.locked} locked"
        if self.by_height:
            text += f"; its range of radius depends on the height, and {self._one_range()}"
        if share < _MUCH:
            text += f"; it is not larger because {self._obstruction()}"
        if design.requested_body_distance == _TIGHT:
            text += (
                f"; bodies keep {1e3 * _TIGHT:g} mm, because {1e3 * _CLEAR:g} mm would leave less "
                f"than {100 * _MUCH:.0f} % of the reach"
            )
        return text

    def _one_range(self) -> str:
        """Write how much a sector with one range of radius covers, to compare with the design.

        The range of the design's sector depends on the height. If a function over a sector with one
        range was designed, its area is known. Otherwise such a sector has a smaller area, or a
        smaller range of angle or spin.
        """
        known = self.rectangles.known
        if known is not None:
            return f"one range for all heights covers {area_of(known.cell):.2g} m²"
        most = min(self.rectangle, self.affordable)
        if most < self.area:
            return f"one range for all heights would cover at most {most:.2g} m²"
        return "one range for all heights would cover a smaller area or a smaller angle"

    def _obstruction(self) -> str:
        """Write why the sector is not larger, as the end of "it is not larger because"."""
        design = self.design
        if self.area > _MUCH * self.affordable:
            return f"joint speed meets its limits in at most {self.affordable:.2g} m²"
        if _at_bodies(design):
            links = " and ".join(design.evaluation.nearest_bodies)
            return f"{links} come to {1e3 * design.body_distance:.1f} mm at some angle"
        return "outside it, joints exceed a limit of position or speed, or bodies come too near"


def _at_bodies(design: CellDesign) -> bool:
    """Test whether bodies come so near in a design's sector that they may limit the sector."""
    return bool(design.body_distance < 2 * design.requested_body_distance)


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
        self, fit: CellFit, places: list[_Place], limits: Required, rectangle: float
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
    def _ranking(self) -> tuple[list[_Place], Required]:
        """Sectors, the best first, with quick designs; and :attr:`limits`."""
        limits, ranked = self._given, _ranked(self._fit, self._places, self._given)
        if limits.distance == _CLEAR and ranked and ranked[0].rating < _MUCH * ranked[0].most:
            # where bodies end the sector, a smaller distance may leave more of it
            closer = limits._replace(distance=_TIGHT)
            others = _ranked(self._fit, ranked, closer)
            if ranked[0].rating < _MUCH * others[0].rating:
                return others, closer
        return ranked, limits

    @cached_property
    def design(self) -> CellDesign:
        """The function, designed when it is first read.

        InputError is raised if no function covers any of the sectors.
        """
        ranked, limits = self._ranking
        found = _designed(self._fit, ranked, limits)
        if area_of(found.cell) < _MUCH * self.rectangle and _at_bodies(found):
            return _farther_from_bodies(self._fit, ranked[0], limits, found) or found
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
        found = _first_design(self._fit, tried, limits, useful)
        at = found or first.design
        near = at is not None and at.body_distance < 2 * limits.distance
        if near and (found is None or area_of(found.cell) < _MUCH * self.rectangle):
            found = _farther_from_bodies(self._fit, first, limits, found, useful)
        if found is None:
            return other
        self.design = found
        return _larger_of(other, found)


def whole_table(
    task: Task,
    rotation: Array,
    *,
    heights: tuple[float, float],
    most_extra: tuple[float, float],
    seed: int,
    report: Report,
) -> WholeTable:
    """Find the largest sector at one orientation that one function covers, and design it.

    Parameters
    ----------
    task
        The task.
    rotation : (3, 3) array
        Orientation of the frame at the angle 0, where the radius is along x of the base.
    heights
        Lowest and highest position of the frame, m, above the point of the arm's axis that is
        nearest to the base's origin.
    most_extra
        Maximum extra joint speed relative to J⁺, on average and at the worst pose.
    seed
        Random seed.
    report
        Progress callback.
    """
    line, symmetries = _symmetries(task)
    report("random configurations", 0.0)
    rng = np.random.default_rng(seed)
    table, nodes, Q = drawn_nodes(task, rotation, line, symmetries, heights, rng)
    report("floods", 0.1)
    locked = locked_floods(table, nodes, Q, rng)
    widest = _sector(table, line, symmetries, np.zeros(2, int), np.array(table.shape) - 1)
    # with r > 1, functions stay far below this bound, and rectangles alone choose as well
    rate = partial(_affordable_worth, table, widest, symmetries, most_extra[1])
    worth = rate if task.r == 1 else None
    floods = free_floods(table, nodes, Q, locked, worth)
    reach = float(floods.reached.any(axis=0).sum() * SPACING**2)
    report("bodies", 0.25)
    tested = unlike_floods(table, floods, worth)
    whole = _whole_turns(tested)
    speeds = _speeds(tested, widest)
    free = _affordable(whole, speeds, Required(*most_extra))
    bound = free.area * _turns(table, tested, whole, free, symmetries)
    distance, openings = _best_clear(table, tested, bound, symmetries)
    rectangle = rectangles(openings.clear).area.max()
    if not rectangle:
        raise _no_sector(table, floods)
    fit = CellFit(
        Pseudoinverse(task),
        # with more unknowns than that, joint speed is lower on average but higher at the corners
        "auto" if task.r == 1 else _DEGREE,
        limit_margin=0.05,
        held_out=_HELD_OUT,
        seed=seed,
        keep=True,
        # with r > 1, it takes seconds, and gains little
        most_extra=most_extra[1] if task.r == 1 else np.inf,
    )
    limits = Required(*most_extra, distance)
    within = _affordable(openings, speeds, limits)
    sectors = _sectors(table, tested, openings, within, line, symmetries)
    straight = Straight(fit, sectors, limits, float(rectangle * SPACING**2))
    report("a range of radius for each height", 0.4)
    shapes = partial(_shaped_places, table, tested, openings, speeds, line, symmetries)
    shaped, smooth = shapes(limits), shapes(limits, smooth=True)
    report("the function", 0.5)
    through = partial(_through_flood, fit, table, tested, openings, line, symmetries)
    design, limits = _best_design(fit, shaped, smooth, limits, straight, through)
    report("locked joints", 0.95)
    search = _LockedSearch(fit, table, locked, line, symmetries)
    design, larger = search.at_least_locked(design, limits)
    return WholeTable(
        design,
        straight,
        best_locked(table, search.locked, design, limits),
        None if larger is None else larger.arm,
        reach,
        float(rectangle * SPACING**2),
        float(within.area.max() * SPACING**2),
        list(openings.clear),
        table,
    )


def _no_sector(table: Table, floods: Floods) -> InputError:
    """Make the error of a table without a free sector; it names the links that collide, if any."""
    return InputError(
        f"no sector of {table.task.robot.name} is free of collisions, singularities and joint "
        f"limits at this orientation{_colliding(table, floods)}",
        remedy="give another orientation or another kind of task; or give a size, for a function "
        "over a box of poses",
    )


class _LockedSearch:
    """Functions of arms with locked joints, where they cover more than other functions.

    Such an arm can keep away from bodies where a function with minimum joint speed comes too near.

    Parameters
    ----------
    fit
        Arguments of the designs.
    table
        The table.
    locked
        Floods with locked joints. Floods that begin in the middle of a design are added later.
    line, symmetries
        Axis of the arm, and the joints that alone turn the arm and the tool.
    """

    def __init__(
        self,
        fit: CellFit,
        table: Table,
        locked: Floods,
        line: Array,
        symmetries: tuple[Symmetry, ...],
    ) -> None:
        self.locked = locked
        self._fit, self._table, self._line, self._symmetries = fit, table, line, symmetries

    def larger(self, design: CellDesign, limits: Required) -> LargerArm | None:
        """Find an arm with locked joints that covers a larger sector than a design, or None."""
        cell = design.function.chart.cell
        assert isinstance(cell, Sector), "a table is a sector"
        return larger_arm(self._table, self.locked, cell, area_of(design.cell), limits)

    def at_least_locked(
        self, design: CellDesign, limits: Required
    ) -> tuple[CellDesign, LargerArm | None]:
        """Return a design that covers as much as arms with locked joints, if one is found.

        If an arm with locked joints covers a larger sector than the given design, its function is
        evaluated, and cut where it fails. Return the larger of the two designs. Return also an arm
        with locked joints that covers a still larger sector, or None.
        """
        self.locked = with_middles(self._table, self.locked, design)
        larger = self.larger(design, limits)
        if larger is None:
            return design, None
        found = self._function(larger, limits)
        if found is None or _larger_of(found, design) is design:
            return design, larger
        return found, self.larger(found, limits)

    def _function(self, larger: LargerArm, limits: Required) -> CellDesign | None:
        """Make the function of a locked arm over its sector, and cut the sector where it fails.

        Return None if too little is left.
        """
        task = self._table.task
        q, turns = _central(task, self._symmetries, larger.posture)
        cell = _shaped_sector(self._table, self._line, self._symmetries, larger.found, turns)
        joints = [task.joint_names.index(name) for name in larger.arm.joints]
        with suppress(RepctlError):
            found = locked_function(self._fit, cell, q, joints)
            return found and kept_where_good(self._fit, found, limits)
        return None


def middles_in_floods(box: Cell, rng: np.random.Generator) -> tuple[Array, Array]:
    """Find middles for a box in floods around the arm: positions (K, 3), m, and Q (K, n).

    On each of four sides of the arm, the middles are the nodes around which a flood reaches the
    largest share of the box. So the arm reaches most poses of the box without a change of branch.
    The result is empty if no joint turns the whole arm about a vertical axis.
    """
    task, heights = box.task, (-np.inf, np.inf)
    try:
        line, symmetries = _symmetries(task)
        table, nodes, Q = drawn_nodes(task, box.placement.rotation, line, symmetries, heights, rng)
    except InputError:
        return np.zeros((0, 3)), np.zeros((0, task.n))
    floods = free_floods(table, nodes, Q, locked_floods(table, nodes, Q, rng))
    tested = unlike_floods(table, floods)
    closed = [shut(table, flood, 0.0) for flood in tested.Q]
    sides = []
    for quarter in range(4):
        x, y, z = box.half_width if quarter % 2 == 0 else box.half_width[[1, 0, 2]]
        reached = tested.reached & ~np.array([one.at(quarter * np.pi / 2) for one in closed])
        share = _window_shares(table, reached, float(x), float(y), float(z))
        flat = (share * reached).reshape(len(share), -1)
        best = np.argsort(-flat, axis=1)[:, :_WINDOWS]
        nodes = np.column_stack(np.unravel_index(best.ravel(), table.shape))
        Q = tested.Q[np.arange(len(flat)).repeat(best.shape[1]), nodes[:, 0], nodes[:, 1]]
        there = np.isfinite(Q[:, 0])
        sides.append(_at_side(table, symmetries, nodes[there], Q[there], quarter * np.pi / 2))
    p, Q = (np.concatenate(each) for each in zip(*sides, strict=True))
    return p, Q


def _at_side(
    table: Table, symmetries: tuple[Symmetry, ...], nodes: NDArray[np.intp], Q: Array, angle: float
) -> tuple[Array, Array]:
    """Turn nodes (K, 2) with configurations Q (K, n) about the arm's axis by an angle, rad.

    If a joint turns the tool, the tool is turned back, so that its orientation is constant. Return
    the positions (K, 3), m, of the frame and the configurations (K, n) after the turn, whose joints
    can exceed their limits.
    """
    back = -angle * float(np.sign(table.rotation[2, 2]))
    for one, turn in zip(symmetries, (angle, back), strict=False):
        Q = turned(table.task, Q, one, turn)
    p, _ = table.goals(nodes)
    return table.origin + (p - table.origin) @ pin.exp3(angle * table.up).T, Q


def _window_shares(table: Table, reached: NDArray[np.bool_], x: float, y: float, z: float) -> Array:
    """Evaluate the share of a box around each node that each of S floods reaches: (S, I, J).

    The box has half-widths x (along the radius), y and z, m. The share is the fraction of the nodes
    with the radii and heights of the box that are True in the masks ``reached`` (S, I, J).
    """
    S, rows, columns = reached.shape
    total = np.zeros((S, rows + 1, columns + 1))
    total[:, 1:, 1:] = reached.cumsum(axis=1).cumsum(axis=2)
    first = np.rint((table.radii - x - NEAREST) / SPACING).astype(int)
    last = np.rint((np.hypot(table.radii + x, y) - NEAREST) / SPACING).astype(int) + 1
    up = round(z / SPACING)
    low, high = np.arange(columns) - up, np.arange(columns) + up + 1
    area = (last - first)[:, None] * (high - low)
    i, i_end = np.clip(first, 0, rows)[:, None], np.clip(last, 0, rows)[:, None]
    j, j_end = np.clip(low, 0, columns), np.clip(high, 0, columns)
    inside = total[:, i_end, j_end] - total[:, i, j_end] - total[:, i_end, j] + total[:, i, j]
    return np.asarray(inside / area)


class _Place(NamedTuple):
    """Sector, and configuration (n,) in its middle, for which a function can be designed.

    ``most`` is an upper bound of the worth of the sector, and so of its rating, m². ``window`` is
    the range of the sector's angle in which bodies keep their distance: the horizontal direction of
    its middle, and its half-width, rad. It is None for a whole turn. ``design`` is a quick design,
    and ``rating`` is the rating of this design, m². Without a quick design, ``design`` is None and
    ``rating`` is 0.
    """

    cell: Cell
    posture: Array
    most: float
    window: Window | None = None
    rating: float = 0.0
    design: CellDesign | None = None


_Useful = Callable[[_Place, Cell], bool]
"""Tells whether a design over a part of a place's sector can be taken."""


def _always(place: _Place, part: Cell) -> bool:
    """Return True: a design over any part of a place is useful."""
    return True


def _sectors(
    table: Table,
    floods: Floods,
    openings: _Openings,
    found: Rectangles,
    line: Array,
    symmetries: tuple[Symmetry, ...],
) -> list[_Place]:
    """Choose the rectangles with the highest bounds of their worth as sectors, the best first.

    ``found`` has one rectangle per opening. Among sectors with nearly equal configurations in their
    middles, only the best is kept.
    """
    middles = (found.first + found.last) // 2
    postures = floods.Q[openings.flood, middles[:, 0], middles[:, 1]]
    rating = found.area * SPACING**2 * _turns(table, floods, openings, found, symmetries)

    def sector(k: int, turns: tuple[float, float]) -> Cell:
        return _sector(table, line, symmetries, found.first[k], found.last[k], turns)

    return _places(table, openings, symmetries, postures, rating, sector)


def _places(
    table: Table,
    openings: _Openings,
    symmetries: tuple[Symmetry, ...],
    postures: Array,
    rating: Array,
    sector: Callable[[int, tuple[float, float]], Cell],
) -> list[_Place]:
    """Make places (a sector, and a configuration in its middle) for the largest ratings, in order.

    ``rating`` (K,) has one number per opening; only the best openings give a place. A place is left
    out if its configuration, of ``postures`` (K, n), is near that of a better place. ``sector(k,
    turns)`` makes the sector of the opening k, turned by two angles, rad: about the arm's axis, and
    about the tool's.
    """
    return [
        _place(table, openings, k, symmetries, postures[k], float(rating[k]), partial(sector, k))
        for k in map(int, _unlike(table, rating, postures))
    ]


def _unlike(table: Table, rating: Array, postures: Array) -> NDArray[np.intp]:
    """Select up to three rows of ``rating`` (K,) with unlike ``postures`` (K, n), the best first.

    Rows with the rating 0 are left out. The joints of :func:`compared` are compared.
    """
    order = np.argsort(-rating, kind="stable")[: int((rating > 0).sum())]
    return order[unlike_rows(postures[order][:, compared(table)], ALIKE, _DESIGNED)]


def _place(
    table: Table,
    openings: _Openings,
    k: int,
    symmetries: tuple[Symmetry, ...],
    q: Array,
    most: float,
    sector: Callable[[tuple[float, float]], Cell],
) -> _Place:
    """Make the place for a sector in the opening k.

    ``q`` (n,) is a configuration in the middle of the sector, and ``most`` an upper bound of the
    sector's rating. ``sector(turns)`` makes the sector, turned about the arm's axis and the tool's
    by the two angles ``turns``, rad. The angles are chosen so that the sector is in the middle of
    the opening. If the opening is a full turn, the joints that turn arm and tool are put in the
    middle of their ranges instead.
    """
    window, at = None, 0.0
    if openings.half[k] < np.pi:
        at = float(openings.middle[k])
        outward = pin.exp3(at * table.up) @ table.outward
        window = Window(outward, float(openings.half[k]))
    q, turns = _central(table.task, symmetries, q, window and at)
    return _Place(sector(turns), q, most, window)


def _shaped_places(
    table: Table,
    floods: Floods,
    openings: _Openings,
    speeds: Array,
    line: Array,
    symmetries: tuple[Symmetry, ...],
    limits: Required,
    *,
    smooth: bool = False,
) -> list[_Place]:
    """Choose the best sectors whose range of radius depends on the height, the best first.

    The sectors contain only nodes at which joint speed can meet its limits. ``speeds`` (2, S, I, J)
    are the minimum squared joint speeds: ``speeds[0]`` of a function, ``speeds[1]`` of J⁺. Sectors
    whose worth is below that of the best one by more than 5 % may be missed. The sides of those
    that are found are then moved outward, to nodes with half the spacing. If ``smooth``, the sides
    are polynomials of degree 4 instead, and are not moved.
    """
    own, usual = speeds[:, openings.flood]
    every = [(table, Between.none())] * len(openings.mask)
    known: Multipliers = {}
    rating = np.zeros(len(every))
    postures = np.zeros((len(every), table.task.n))
    degree = SMOOTH if smooth else MOST_DEGREE
    # worth of one unit of area, and of all nodes
    unit = _units(openings)
    most = unit * [most_between(mask) for mask in openings.mask]
    for k in map(int, np.argsort(-most, kind="stable")):
        least = _AS_GOOD * rating.max() / unit[k]
        there = openings.mask[k], own[k], usual[k]
        found = affordable_between(*there, limits, least, degree, known=known)
        if found.area:
            Q, inside = floods.Q[openings.flood[k]], found.inside(table.shape)
            share = _turn_share(table.task, symmetries, Q[inside], openings.half[k] / np.pi)
            rating[k] = found.area * SPACING**2 * (0.5 + 0.5 * share)
            every[k], postures[k] = (table, found), Q[found.middle]
    cell = _sector(table, line, symmetries, np.zeros(2, int), np.array(table.shape) - 1)
    some = [] if smooth else _unlike(table, rating, postures).tolist()
    fine, begin = table.finer(), np.array([every[k][1].middle for k in some], int).reshape(-1, 2)
    floods_there = flooded(fine, 2 * begin, postures[some], np.zeros(postures[some].shape, bool))
    for k, flood in zip(some, floods_there, strict=True):
        angles = float(openings.middle[k]), float(openings.half[k])
        found = every[k][1]
        inner = _refined(fine, cell, found, flood, angles, limits, known)
        gain = inner.area / found.area * (fine.spacing / SPACING) ** 2
        if gain > 1:
            every[k], postures[k] = (fine, inner), flood[inner.middle]
            rating[k] *= gain

    def sector(k: int, turns: tuple[float, float]) -> Cell:
        return _shaped_sector(every[k][0], line, symmetries, every[k][1], turns)

    return _places(table, openings, symmetries, postures, rating, sector)


def _units(openings: _Openings) -> Array:
    """Return the worth of one node of each opening, m², if joint limits end no angle: (K,)."""
    return np.asarray(SPACING**2 * (0.5 + 0.5 * openings.half / np.pi))


def _refined(
    fine: Table,
    cell: Cell,
    found: Between,
    flood: Array,
    window: tuple[float, float],
    limits: Required,
    known: Multipliers,
) -> Between:
    """Find a sector larger than ``found``, in a flood over nodes at half the spacing.

    ``found`` is a sector in a flood over the nodes of a table, ``fine`` the table with half the
    spacing, and ``flood`` (I, J, n) a new flood over its nodes, which begins in the middle of
    ``found``. ``window`` has the middle and the half-width, rad, of the angles at which bodies keep
    the distance of ``limits``. Joint speeds are those along the coordinates of ``cell``. ``known``
    are multipliers of other searches, see :func:`.largest_between`. If no larger sector is found,
    the result has a smaller area, or 0.
    """
    middle, half = window[0], window[1] - STEP / 2
    least = found.area * (SPACING / fine.spacing) ** 2
    enough = partial(more_between, least=least)
    mask = free_nodes(fine, flood, limits.distance, (middle - half, middle + half), enough)
    own, usual = np.full((2, *fine.shape), np.nan)
    own[mask], usual[mask] = least_speeds(cell, flood[mask])
    return affordable_between(mask, own, usual, limits, least, known=known)


def _best_design(
    fit: CellFit,
    shaped: list[_Place],
    smooth: list[_Place],
    limits: Required,
    straight: Straight,
    through: Callable[[Required], CellDesign | None],
) -> tuple[CellDesign, Required]:
    """Design the best sector; return the design and its limits, whose distance may be reduced.

    With the smaller body distance, the function ``through(limits)`` through a relaxed flood is made
    first. It is taken if it covers 85 % of the largest rectangle, and as much as a function over
    one range of radius can. The other arguments are those of :func:`_best_shape`.
    """
    found = through(limits) if limits.distance == _TIGHT else None
    if found is not None:
        least = max(_MUCH * straight.rectangle, straight.largest)
        if area_of(found.cell) >= least and _worth(found) > _AS_GOOD * straight.most:
            return found, limits
    return _best_shape(fit, shaped, smooth, limits, straight)


def _through_flood(
    fit: CellFit,
    table: Table,
    floods: Floods,
    openings: _Openings,
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
    most = _units(openings) * [most_between(mask) for mask in openings.mask]
    tried = map(int, np.argsort(-most, kind="stable")[:_RELAXED])
    relax = partial(_relaxed_place, table, floods, openings, line, symmetries, limits)
    places = [found for found in map(relax, tried) if found is not None]
    if places:
        place, Q = max(places, key=lambda one: one[0].most)
        with suppress(RepctlError):
            design = function_through(fit, place.cell, Q)
            return design and kept_where_good(fit, design, limits._replace(window=place.window))
    return None


def _relaxed_place(
    table: Table,
    floods: Floods,
    openings: _Openings,
    line: Array,
    symmetries: tuple[Symmetry, ...],
    limits: Required,
    k: int,
) -> tuple[_Place, Array] | None:
    """Relax the flood of the opening k, and find the largest sector in which it keeps ``limits``.

    Return the sector, and the configurations (K, n) of the relaxed flood at the K nodes in it; None
    if there is no sector. The joint speeds are those of differences between nodes.
    """
    mask, middle, half = openings.mask[k], float(openings.middle[k]), float(openings.half[k])
    angles = middle - half + STEP / 2, middle + half - STEP / 2
    Q = relaxed(table, floods.Q[openings.flood[k]], mask, limits.distance, angles)
    widest = _sector(table, line, symmetries, np.zeros(2, int), np.array(table.shape) - 1)
    own, usual = np.full((2, *table.shape), np.nan)
    own[mask], usual[mask] = least_speeds(widest, Q[mask], slopes(table, Q)[mask])
    # the mean over nodes is not exactly that over a sector
    found = affordable_between(mask, own, usual, limits._replace(mean=SPARE * limits.mean))
    if not found.area:
        return None
    inside = Q[found.inside(table.shape) & mask]
    share = _turn_share(table.task, symmetries, inside, half / np.pi)
    worth = found.area * SPACING**2 * (0.5 + 0.5 * share)
    sector = partial(_shaped_sector, table, line, symmetries, found)
    return _place(table, openings, k, symmetries, Q[found.middle], worth, sector), inside


def _best_shape(
    fit: CellFit, shaped: list[_Place], smooth: list[_Place], limits: Required, straight: Straight
) -> tuple[CellDesign, Required]:
    """Design the sector of the best shape, whose range of radius may depend on the height.

    ``shaped`` are the sectors, the best first, and ``smooth`` those with sides of lower degree. A
    function over a sector with one range, from ``straight``, is designed only if it may be as good.
    Return the design and its limits, whose body distance may be reduced.
    """
    if shaped and shaped[0].most > (1 + _BETTER) * straight.most:
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
    larger = _worth(found) > straight.most and area_of(found.cell) > straight.largest
    free = limits.distance < _CLEAR or not _at_bodies(found) or _worth(found) > _MUCH * most
    return larger and free


def _larger_design(
    fit: CellFit, places: list[_Place], limits: Required, design: CellDesign
) -> CellDesign:
    """Design the places in turn until a design succeeds; return this or the given ``design``.

    The new design is returned if both its area and its worth are larger than those of ``design``.
    Places that cannot exceed ``design`` in both are left out.
    """
    found = _first_design(fit, places, limits, partial(_can_exceed, other=design))
    return design if found is None else _larger_of(found, design)


def _larger_of(found: CellDesign, design: CellDesign) -> CellDesign:
    """Return ``found`` if both its area and its worth are larger, else ``design``."""
    larger = _worth(found) > _worth(design) and area_of(found.cell) > area_of(design.cell)
    return found if larger else design


def _best_of(
    fit: CellFit, shaped: list[_Place], smooth: list[_Place], limits: Required
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
        least = 0.0 if best is None else _worth(best)
        if least > _AS_GOOD * most:
            break
        if place.rating > (1 + _SLIGHTLY) * least:
            found = _design_of(fit, place, limits, share, least)
            best = max((one for one in (best, found) if one), key=_worth, default=None)
    return best


def _likely(fit: CellFit, places: list[_Place], limits: Required) -> list[tuple[_Place, float]]:
    """Add quick designs to places, and sort the places by the worth that is expected of them.

    A quick design shows which ``share`` of the sector a cut would leave. New sides leave more, so
    the place is expected to have √share times its bound. ``places`` have the largest bound first;
    the rest is left out after a place of which as much is expected as the best of the rest can
    have. Return each place with its share.
    """
    found: list[tuple[_Place, float]] = []
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
    fit: CellFit, place: _Place, limits: Required, share: float, least: float
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
        return _most_of(place, part) > least

    with suppress(InputError):
        if place.design is not None and share < _NEARLY:
            found = by_price(fit, place.design, there, useful)
            least = least if found is None else max(least, _worth(found))
    if share * place.most > least:
        other = _first_design(
            fit, [place], limits, lambda place, part: _most_of(place, part) > least
        )
        found = max((one for one in (found, other) if one), key=_worth, default=None)
    return found


def _or_better(
    fit: CellFit, places: list[_Place], limits: Required, design: CellDesign
) -> CellDesign:
    """Design the places in turn until a design succeeds; return this design if its worth is larger.

    Otherwise return the given design. Places that cannot have a larger worth are left out.
    """

    def useful(place: _Place, part: Cell) -> bool:
        return _most_of(place, part) > _worth(design)

    found = _first_design(fit, places, limits, useful)
    return design if found is None else max(design, found, key=_worth)


def _first_design(
    fit: CellFit, places: Iterable[_Place], limits: Required, useful: _Useful = _always
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


def _can_exceed(place: _Place, part: Cell, other: CellDesign) -> bool:
    """Test whether a design over a part of a place can exceed ``other`` in area and in worth."""
    return area_of(part) > area_of(other.cell) and _most_of(place, part) > _worth(other)


def _can_equal(place: _Place, part: Cell, other: CellDesign) -> bool:
    """Test whether a design over a part of a place can equal ``other`` in area or in worth."""
    return area_of(part) >= area_of(other.cell) or _most_of(place, part) >= _worth(other)


def _most_of(place: _Place, part: Cell) -> float:
    """Return an upper bound of the worth of a design over a part of a place, m².

    The bound of the place, ``place.most``, is reduced in proportion to the area of the part.
    """
    return place.most / area_of(place.cell) * area_of(part)


def _central(
    task: Task, symmetries: tuple[Symmetry, ...], q: Array, angle: float | None = None
) -> tuple[Array, tuple[float, float]]:
    """Turn the arm, then the tool, such that the joints that turn them are in mid-range.

    If an ``angle``, rad, is given, the arm is turned by this angle instead, and only the tool to
    mid-range. Return the configuration (n,) after both turns, and two angles, rad: by which the
    frame was turned about the arm's axis, and the tool about its own axis.
    """
    q, turns = q.copy(), [0.0, 0.0]
    if angle is not None:
        q, turns[0] = turned(task, q[None], symmetries[0], angle)[0], angle
    for k, one in list(enumerate(symmetries))[angle is not None :]:
        low, high = task.lower[one.joint], task.upper[one.joint]
        if np.isfinite(low) and np.isfinite(high):
            turns[k] = float(one.sign * ((low + high) / 2 - q[one.joint]))
            q[one.joint] = (low + high) / 2
    return q, (turns[0], turns[1])


def _affordable(openings: _Openings, speeds: Array, limits: Required) -> Rectangles:
    """Find the largest rectangle of each opening in which joint speed can keep its limits.

    No function through the configurations of a flood has a lower joint speed than ``G E``, with E =
    ∂x/∂u. G is J⁺, except in the columns of symmetric coordinates, along which one joint moves
    alone. Nodes with the highest joint speed are left out until the mean over the rectangle meets
    its limit. ``speeds`` (2, S, I, J) are the minimum squared joint speeds at the nodes:
    ``speeds[0]`` of a function, ``speeds[1]`` of J⁺; NaN outside a flood.
    """
    own, usual = speeds[:, openings.flood]
    with np.errstate(invalid="ignore"):
        extra = np.where(openings.mask, np.sqrt(own / usual) - 1, np.nan)
        best = rectangles(extra < limits.worst)
        best.area[_mean_extra(best, own, usual) > limits.mean] = 0.0
        shares = limits.mean * np.geomspace(DEAREST, 1, SHARES)
        for most in shares[shares < limits.worst]:
            tried = rectangles(extra < most)
            better = tried.area > best.area
            better &= _mean_extra(tried, own, usual) <= limits.mean
            for kept, new in zip(best, tried, strict=True):
                kept[better] = new[better]
    return best


def _speeds(floods: Floods, cell: Cell) -> Array:
    """Evaluate minimum squared joint speeds in S floods, of a function, then of J⁺: (2, S, I, J).

    No function with the configuration of a flood at a node has a lower joint speed there. Speeds
    are per unit of task speed along the coordinates of ``cell``; NaN outside a flood.
    """
    speeds = np.full((2, *floods.reached.shape), np.nan)
    speeds[:, floods.reached] = least_speeds(cell, floods.Q[floods.reached])
    return speeds


def _affordable_worth(
    table: Table, cell: Cell, symmetries: tuple[Symmetry, ...], worst: float, floods: Floods
) -> Array:
    """Rate S floods by the worth, without bodies, of their nodes that are within a limit: (S,).

    The limit ``worst`` is that of the extra joint speed at a node, of which sectors whose range of
    radius depends on the height use 92 %. The area is in units of the nodes' spacing squared.
    """
    own, usual = _speeds(floods, cell)
    with np.errstate(invalid="ignore"):
        good = np.sqrt(own / usual) - 1 < SPARE * worst
    share = [
        _turn_share(table.task, symmetries, Q[mask], 1.0) if mask.any() else 0.0
        for Q, mask in zip(floods.Q, good, strict=True)
    ]
    return np.array([most_between(mask) for mask in good]) * (0.5 + 0.5 * np.array(share))


def _mean_extra(found: Rectangles, own: Array, usual: Array) -> Array:
    """Evaluate the extra joint speed over one rectangle per opening: (K,).

    This is the rms joint speed of a function relative to that of J⁺, minus 1. ``found`` has the
    rectangles. ``own`` and ``usual`` (K, I, J) are the squared joint speeds of the function and of
    J⁺.
    """
    extra = np.zeros(len(own))
    for k, ((i, j), (i_end, j_end)) in enumerate(zip(found.first, found.last + 1, strict=True)):
        inside = k, slice(i, i_end), slice(j, j_end)
        extra[k] = np.sqrt(own[inside].sum() / usual[inside].sum()) - 1
    return extra


def _ranked(fit: CellFit, places: list[_Place], limits: Required) -> list[_Place]:
    """Rate places by a quick design of each, within ``limits``; return them, the best first.

    The rating is that of the part of the sector in which the design meets the limits. A place that
    cannot be more than 20 % better than the best so far keeps the rating 0, without a design. A
    place is left out if inverse kinematics does not lead from its configuration to the middle of
    its sector.
    """
    ranked: list[_Place] = []
    for place in places:
        best = max((one.rating for one in ranked), default=0.0)
        if place.design is None and place.most < (1 + _BETTER) * best:
            ranked.append(place)
            continue
        with suppress(InputError):
            q = given(place.cell, place.posture)
            there = limits._replace(window=place.window)
            share, design = covered_share(fit, place.cell, q, there, place.design)
            rating = share * _rating(place.cell, design, there)
            ranked.append(place._replace(posture=q, rating=rating, design=design))
    return sorted(ranked, key=lambda place: -place.rating)


def _designed(fit: CellFit, ranked: list[_Place], limits: Required) -> CellDesign:
    """Design a function for the first place that one function covers without a collision.

    InputError is raised if there is none.
    """
    design = _first_design(fit, ranked, limits)
    if design is not None:
        return design
    name = fit.desired.task.robot.name
    raise InputError(
        f"no range of radius and height around the base of {name} was found that one function "
        f"covers at this orientation{_failed(ranked, limits)}",
        remedy="give another orientation, larger limits of extra joint speed (most_extra=), or the "
        "size of a box of poses",
    )


def _farther_from_bodies(
    fit: CellFit,
    place: _Place,
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
    other = _first_design(_away(fit, limits), [place], limits, useful)
    if other is None or design is None:
        return other or design
    return max(design, other, key=_worth)


def _away(fit: CellFit, limits: Required) -> CellFit:
    """Return ``fit`` with a body distance to keep that is twice that of ``limits``."""
    return replace(fit, body_distance=_AWAY * limits.distance)


def _worth(design: CellDesign) -> float:
    """Rate a final design: the area of its sector, m², times (1 + s) / 2.

    s is the smaller of two fractions of a full turn: those that the angle and the spin cover.
    """
    cell = design.cell
    turns = [cell.widths[one.coordinate] / np.pi for one in design.function.chart.cell.removed]
    return area_of(cell) * (0.5 + 0.5 * float(min(turns, default=1.0)))


def _failed(ranked: list[_Place], limits: Required) -> str:
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


def _turns(
    table: Table,
    floods: Floods,
    openings: _Openings,
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
        share[k] = _turn_share(task, symmetries, Q, share[k])
    return 0.5 + 0.5 * share


def _turn_share(task: Task, symmetries: tuple[Symmetry, ...], Q: Array, share: float) -> float:
    """Return the fraction of a full turn that is left to the angle and the spin, at most ``share``.

    For the angle, what is left is the range of the joint that turns the arm, minus the variation of
    this joint over the configurations Q (K, n); for the spin, the same holds for the joint that
    turns the tool. The smaller fraction is returned.
    """
    for one in symmetries:
        left = task.upper[one.joint] - task.lower[one.joint] - np.ptp(Q[:, one.joint])
        share = min(share, max(0.0, float(np.nan_to_num(left)) / (2 * np.pi)))
    return share


def _symmetries(task: Task) -> tuple[Array, tuple[Symmetry, ...]]:
    """Find the vertical axis (2, 3) about which a joint turns the whole arm, and the symmetries.

    The symmetries are that of the arm and, in a pose task whose tool a joint turns, that of the
    tool.

    Raises
    ------
    InputError
        If there is no such axis, or if it is tilted.
    """
    line = own_axis(task)
    name = task.robot.name
    if line is None:
        first = task.joint_names[0]
        raise InputError(
            f"no joint of {name} turns the whole arm about a fixed axis, so there is no sector "
            "around the arm",
            remedy=f"lock the joint {first!r}, or give the size of a box of poses instead",
        )
    if difference(line, VERTICAL)[0] > NEAR:
        tilt = np.degrees(difference(line, VERTICAL)[0])
        raise InputError(
            f"the axis about which {name} turns is tilted by {tilt:.0f}° from the vertical, so the "
            "tool cannot keep its orientation around the arm",
            remedy="give the size of a box",
        )
    around = axis_symmetry(task, line)
    assert around is not None, "own_axis tested it"
    about = tool_symmetry(task) if task.kind == "pose" else None
    return line, (around,) if about is None else (around, about)


class _Openings(NamedTuple):
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


def _whole_turns(floods: Floods) -> _Openings:
    """Make one opening per flood: the window of a whole turn, as if there were no bodies."""
    S = len(floods.Q)
    return _Openings(np.arange(S), np.zeros(S), np.full(S, np.pi), floods.reached, floods.reached)


def _best_clear(
    table: Table, floods: Floods, bound: Array, symmetries: tuple[Symmetry, ...]
) -> tuple[float, _Openings]:
    """Choose the body distance to keep, 5 mm or 1 mm; return it, m, with the openings that keep it.

    1 mm is chosen if the best worth with 5 mm is below 85 % of that with 1 mm. The worth of an
    opening is that of its largest rectangle, in units of the spacing squared. ``bound`` (S,) is the
    worth of each flood without regard to bodies, in the same unit; no opening of the flood exceeds
    it.
    """
    known: dict[int, Shut] = {}
    wide = _opened(table, floods, bound, _CLEAR, symmetries, known)
    rating = _values(table, floods, wide, symmetries).max()
    if rating < _MUCH * bound.max():
        tight = _opened(table, floods, bound, _TIGHT, symmetries, known)
        if rating < _MUCH * _values(table, floods, tight, symmetries).max():
            return _TIGHT, tight
    return _CLEAR, wide


def _opened(
    table: Table,
    floods: Floods,
    bound: Array,
    distance: float,
    symmetries: tuple[Symmetry, ...],
    known: dict[int, Shut],
) -> _Openings:
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
        better = sum(value > _AS_GOOD * bound[k] for value in values)
        if better >= _DESIGNED and most[k] <= largest:
            continue
        there = known[k] = shut(table, np.asarray(flood), distance, known.get(k))
        clear.append(np.isfinite(flood[..., 0]) & ~np.all(there.near | there.out, axis=0))
        largest = max(largest, rectangles(clear[-1][None]).area[0])
        middle, half, mask = windows(there)
        some = _Openings(np.full(len(half), k), middle, half, mask, clear[-1][None])
        rating = _values(table, floods, some, symmetries)
        values.append(min(rating.max(), bound[k]))
        best = np.argsort(-rating, kind="stable")[:_KEPT]
        parts.append([some.flood[best], middle[best], half[best], mask[best]])
    flood, middle, half, mask = (np.concatenate(each) for each in zip(*parts, strict=True))
    return _Openings(flood, middle, half, mask, np.array(clear))


def _values(
    table: Table, floods: Floods, openings: _Openings, symmetries: tuple[Symmetry, ...]
) -> Array:
    """Rate K openings by the area of their largest rectangles, times (1 + s) / 2: (K,).

    The area is in units of the nodes' spacing squared. s is the smallest of three fractions of a
    full turn: the width of the window, and the ranges that joint limits leave to the angle and to
    the spin.
    """
    found = rectangles(openings.mask)
    return found.area * _turns(table, floods, openings, found, symmetries)


def _colliding(table: Table, floods: Floods) -> str:
    """Name the two links that collide at most poses, and the percentage of poses at which they do.

    The poses are a sample of those that the floods reach; links nearer than 1 mm count as
    colliding. The text completes an error message; it is empty if there is no collision.
    """
    bodies, Q = bodies_of(table.task), unlike_floods(table, floods).Q.reshape(-1, table.task.n)
    Q = Q[np.isfinite(Q[:, 0])]
    Q = Q[:: max(1, len(Q) // _LOOKED)]
    near = [bodies.nearest(q) for q in Q[bodies._nearer(Q, _TIGHT)]]
    if not near:
        return ""
    (links, count), *_ = Counter(one.links for one in near).most_common()
    share = 100 * count / len(Q)
    return f": {' and '.join(links)} collide at {share:.0f} % of the poses that the arm reaches"


def _sector(
    table: Table,
    line: Array,
    symmetries: tuple[Symmetry, ...],
    first: NDArray[np.intp],
    last: NDArray[np.intp],
    turns: tuple[float, float] = (0.0, 0.0),
    found: Between | None = None,
) -> Cell:
    """Make the sector between the nodes ``first`` and ``last``; its angle has the range "all".

    If a joint turns the tool, the range of the spin is "all", too. The middle of the sector is
    turned by two angles, ``turns``, rad: about the arm's axis, and about the tool's approach axis.
    With ``found``, the range of radius is that between its polynomials, not that of the nodes.
    """
    low = np.array([table.radii[first[0]], table.heights[first[1]]])
    high = np.array([table.radii[last[0]], table.heights[last[1]]])
    (rho, z), half = (low + high) / 2, (high - low) / 2
    around = pin.exp3(turns[0] * table.up)
    p = table.origin + around @ (rho * table.outward) + z * table.up
    R = around @ table.rotation @ pin.exp3(np.array([0.0, 0.0, turns[1]]))
    radius = float(half[0]) if found is None else found.sides(table.radii[0], table.spacing)
    return whole_sector(table.task, pin.SE3(R, p), radius, float(half[1]), line, symmetries)


def _shaped_sector(
    table: Table,
    line: Array,
    symmetries: tuple[Symmetry, ...],
    found: Between,
    turns: tuple[float, float],
) -> Cell:
    """Make the sector between two polynomials of the height.

    Its middle is turned by two angles, ``turns``, rad: about the arm's axis, and about the tool's z
    axis. If both angles are 0, the orientation is that of the table.
    """
    first, last = (np.array([0, j]) for j in (found.first, found.last))
    return _sector(table, line, symmetries, first, last, turns, found)
