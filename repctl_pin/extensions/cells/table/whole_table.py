"""Whole table: the largest sector around an arm that one function covers at one orientation.

A table is a grid of radius and height around the arm, at the angle 0. A flood is the set of its
nodes that the arm reaches from one configuration without a change of branch (of the inverse
kinematics). Functions are designed for sectors: the largest rectangles in the best floods, and the
largest parts of the floods whose range of radius depends on the height. A sector "with one range of
radius" has the same range at all heights. A window is a range of the angle around the arm in which
bodies keep a distance; an opening is a window of one flood, with the nodes at which bodies keep the
distance at all its angles. Symmetries are the joints that alone turn the whole arm, or the tool;
``line`` (2, 3) is the axis of the joint that turns the arm: a point, m, and a direction. Squared
joint speeds at nodes, of a function and of J⁺, are defined in :mod:`.joint_speeds`. A locked flood
is that of an arm with r of its joints locked, which is therefore not redundant. Masks (I, J) have
one entry per node, for I radii and J heights. The argument ``report`` is the progress callback.

``CellFit`` holds the arguments of a design over a cell, and the methods that compute the design.
``Required`` holds the limits of a function: mean and maximum extra joint speed relative to J⁺ (0.05
is 5 %), and body distance, m. ``LockedJoints`` is an arm with r joints locked: the joints, their
values, and the part of a sector that it covers. ``Straight`` are the sectors with one range of
radius, and the function over the largest that one covers. ``Floods`` are S floods: each is a set of
neighbouring nodes with one configuration per node, so that q changes continuously. ``Table`` is a
grid of poses (nodes) over radius and height around an axis, at the angle 0 and one orientation.
"""

from __future__ import annotations

from collections import Counter
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array
from ....base.errors import InputError
from ....base.progress import Report
from ....model.bodies import bodies_of
from ....model.task import Task
from ....strategies import Pseudoinverse
from ..cell_design_result import CellDesign
from ..fit.cell_fit import CellFit
from ..fit.trimming import Required
from ..geometry.sector import Sector
from .affordable import affordable, affordable_worth, flood_speeds
from .best_shape import best_design, through_flood
from .designs import at_bodies
from .flood import SPACING, Table, rectangles
from .flood_sets import Floods, drawn_nodes, free_floods, locked_floods, unlike_floods
from .largest_profile import area_of
from .locked_arms import LockedJoints, best_locked
from .locked_search import LockedSearch
from .openings import CLEAR, MUCH, TIGHT, best_clear, turn_factors, whole_turns
from .outline import outlines
from .places import shaped_places, straight_places
from .sectors import axis_and_symmetries, widest_sector
from .straight import Straight

_LOOKED = 96
"""Number of configurations at which colliding links are looked for, to name them."""

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
        if share < MUCH:
            text += f"; it is not larger because {self._obstruction()}"
        if design.requested_body_distance == TIGHT:
            text += (
                f"; bodies keep {1e3 * TIGHT:g} mm, because {1e3 * CLEAR:g} mm would leave less "
                f"than {100 * MUCH:.0f} % of the reach"
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
        if self.area > MUCH * self.affordable:
            return f"joint speed meets its limits in at most {self.affordable:.2g} m²"
        if at_bodies(design):
            links = " and ".join(design.evaluation.nearest_bodies)
            return f"{links} come to {1e3 * design.body_distance:.1f} mm at some angle"
        return "outside it, joints exceed a limit of position or speed, or bodies come too near"


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
    line, symmetries = axis_and_symmetries(task)
    report("random configurations", 0.0)
    rng = np.random.default_rng(seed)
    table, nodes, Q = drawn_nodes(task, rotation, line, symmetries, heights, rng)
    report("floods", 0.1)
    locked = locked_floods(table, nodes, Q, rng)
    widest = widest_sector(table, line, symmetries)
    # with r > 1, functions stay far below this bound, and rectangles alone choose as well
    rate = partial(affordable_worth, table, widest, symmetries, most_extra[1])
    worth = rate if task.r == 1 else None
    floods = free_floods(table, nodes, Q, locked, worth)
    reach = float(floods.reached.any(axis=0).sum() * SPACING**2)
    report("bodies", 0.25)
    tested = unlike_floods(table, floods, worth)
    whole = whole_turns(tested)
    speeds = flood_speeds(tested, widest)
    free = affordable(whole, speeds, Required(*most_extra))
    bound = free.area * turn_factors(table, tested, whole, free, symmetries)
    distance, openings = best_clear(table, tested, bound, symmetries)
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
    within = affordable(openings, speeds, limits)
    sectors = straight_places(table, tested, openings, within, line, symmetries)
    straight = Straight(fit, sectors, limits, float(rectangle * SPACING**2))
    report("a range of radius for each height", 0.4)
    shapes = partial(shaped_places, table, tested, openings, speeds, line, symmetries)
    shaped, smooth = shapes(limits), shapes(limits, smooth=True)
    report("the function", 0.5)
    through = partial(through_flood, fit, table, tested, openings, line, symmetries)
    design, limits = best_design(fit, shaped, smooth, limits, straight, through)
    report("locked joints", 0.95)
    search = LockedSearch(fit, table, locked, line, symmetries)
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


def _colliding(table: Table, floods: Floods) -> str:
    """Name the two links that collide at most poses, and the percentage of poses at which they do.

    The poses are a sample of those that the floods reach; links nearer than 1 mm count as
    colliding. The text completes an error message; it is empty if there is no collision.
    """
    bodies, Q = bodies_of(table.task), unlike_floods(table, floods).Q.reshape(-1, table.task.n)
    Q = Q[np.isfinite(Q[:, 0])]
    Q = Q[:: max(1, len(Q) // _LOOKED)]
    near = [bodies.nearest(q) for q in Q[bodies._nearer(Q, TIGHT)]]
    if not near:
        return ""
    (links, count), *_ = Counter(one.links for one in near).most_common()
    share = 100 * count / len(Q)
    return f": {' and '.join(links)} collide at {share:.0f} % of the poses that the arm reaches"
