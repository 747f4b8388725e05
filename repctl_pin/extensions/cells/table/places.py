"""Places: the best sectors in openings, with a configuration in the middle of each.

Functions are designed for sectors: the largest rectangles in the best floods, and the largest parts
of the floods whose range of radius depends on the height. A table is a grid of radius and height
around the arm, at the angle 0. A flood is the set of its nodes that the arm reaches from one
configuration without a change of branch (of the inverse kinematics). A window is a range of the
angle around the arm in which bodies keep a distance; an opening is a window of one flood, with the
nodes at which bodies keep the distance at all its angles. The spin of a sector is the rotation of
the tool about its own z axis. Symmetries are the joints that alone turn the whole arm, or the tool;
``line`` (2, 3) is the axis of the joint that turns the arm: a point, m, and a direction. Squared
joint speeds at nodes, of a function and of J⁺, are defined in :mod:`.joint_speeds`. The limits of
joint speed, in ``limits``, are the maximum extra joint speed on average and at the worst node. The
*worth* of a sector, m², is its area times (1 + s) / 2. The angle and the spin each have a range, a
fraction of a full turn; s is the smaller of the two fractions. The *rating* is the worth, reduced
for high joint speed and near bodies. A quick design has low accuracy, and serves to rank sectors.
Masks (I, J) have one entry per node, for I radii and J heights. S is the number of floods, n that
of joints, K that of openings, nodes or configurations. A node is a pair of indices (radius,
height).

``Openings`` are K openings: each is a window of one flood, with the nodes at which bodies keep a
distance at all its angles. ``Floods`` are S floods: each is a set of neighbouring nodes with one
configuration per node, so that q changes continuously. ``Table`` is a grid of poses (nodes) over
radius and height around an axis, at the angle 0 and one orientation. ``Rectangles`` are the largest
rectangles of nodes in S masks: areas, first and last indices of radius and height. ``Between`` is a
set of nodes between two polynomials of the height: its area, first and last height, and both
polynomials. ``Symmetry`` is a joint that changes only one coordinate of the frame: the indices of
both, and the sign, 1 or −1, of the change. ``Required`` holds the limits of a function: mean and
maximum extra joint speed relative to J⁺ (0.05 is 5 %), and body distance, m.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ....base.arguments import Array
from ....model.task import Task
from ..cell_design_result import CellDesign
from ..evaluate.reach import unlike_rows
from ..fit.trimming import Required, Window
from ..geometry.cell import Cell
from ..geometry.sector_profile import MOST_DEGREE
from ..geometry.symmetry import Symmetry
from .flood import SPACING, Rectangles, Table, flooded
from .flood_sets import ALIKE, Floods, compared
from .joint_speeds import least_speeds
from .largest_profile import (
    SMOOTH,
    SPARE,
    Between,
    Multipliers,
    affordable_between,
    more_between,
    most_between,
)
from .openings import AS_GOOD, DESIGNED, Openings, turn_factors, turn_share, units
from .relaxed import relaxed, slopes
from .sectors import central, sector_between, shaped_sector, widest_sector
from .windows import STEP, free_nodes


class Place(NamedTuple):
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


def straight_places(
    table: Table,
    floods: Floods,
    openings: Openings,
    found: Rectangles,
    line: Array,
    symmetries: tuple[Symmetry, ...],
) -> list[Place]:
    """Choose the rectangles with the highest bounds of their worth as sectors, the best first.

    ``found`` has one rectangle per opening. Among sectors with nearly equal configurations in their
    middles, only the best is kept.
    """
    middles = (found.first + found.last) // 2
    postures = floods.Q[openings.flood, middles[:, 0], middles[:, 1]]
    rating = found.area * SPACING**2 * turn_factors(table, floods, openings, found, symmetries)

    def sector(k: int, turns: tuple[float, float]) -> Cell:
        return sector_between(table, line, symmetries, found.first[k], found.last[k], turns)

    return _places(table, openings, symmetries, postures, rating, sector)


def _places(
    table: Table,
    openings: Openings,
    symmetries: tuple[Symmetry, ...],
    postures: Array,
    rating: Array,
    sector: Callable[[int, tuple[float, float]], Cell],
) -> list[Place]:
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
    return order[unlike_rows(postures[order][:, compared(table)], ALIKE, DESIGNED)]


def _place(
    table: Table,
    openings: Openings,
    k: int,
    symmetries: tuple[Symmetry, ...],
    q: Array,
    most: float,
    sector: Callable[[tuple[float, float]], Cell],
) -> Place:
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
    q, turns = central(table.task, symmetries, q, window and at)
    return Place(sector(turns), q, most, window)


def shaped_places(
    table: Table,
    floods: Floods,
    openings: Openings,
    speeds: Array,
    line: Array,
    symmetries: tuple[Symmetry, ...],
    limits: Required,
    *,
    smooth: bool = False,
) -> list[Place]:
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
    unit = units(openings)
    most = unit * [most_between(mask) for mask in openings.mask]
    for k in map(int, np.argsort(-most, kind="stable")):
        least = AS_GOOD * rating.max() / unit[k]
        there = openings.mask[k], own[k], usual[k]
        found = affordable_between(*there, limits, least, degree, known=known)
        if found.area:
            Q, inside = floods.Q[openings.flood[k]], found.inside(table.shape)
            rating[k] = _worth(table.task, symmetries, found, Q[inside], openings.half[k])
            every[k], postures[k] = (table, found), Q[found.middle]
    cell = widest_sector(table, line, symmetries)
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
        return shaped_sector(every[k][0], line, symmetries, every[k][1], turns)

    return _places(table, openings, symmetries, postures, rating, sector)


def _worth(
    task: Task, symmetries: tuple[Symmetry, ...], found: Between, Q: Array, half: float
) -> float:
    """Return the worth, m², of the nodes between two polynomials, at 3 cm, with Q (K, n) at them.

    ``half`` is the half-width, rad, of the window of the angle.
    """
    share = turn_share(task, symmetries, Q, half / np.pi)
    return found.area * SPACING**2 * (0.5 + 0.5 * share)


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


def relaxed_place(
    table: Table,
    floods: Floods,
    openings: Openings,
    line: Array,
    symmetries: tuple[Symmetry, ...],
    limits: Required,
    k: int,
) -> tuple[Place, Array] | None:
    """Relax the flood of the opening k, and find the largest sector in which it keeps ``limits``.

    Return the sector, and the configurations (K, n) of the relaxed flood at the K nodes in it; None
    if there is no sector. The joint speeds are those of differences between nodes.
    """
    mask, middle, half = openings.mask[k], float(openings.middle[k]), float(openings.half[k])
    angles = middle - half + STEP / 2, middle + half - STEP / 2
    Q = relaxed(table, floods.Q[openings.flood[k]], mask, limits.distance, angles)
    widest = widest_sector(table, line, symmetries)
    own, usual = np.full((2, *table.shape), np.nan)
    own[mask], usual[mask] = least_speeds(widest, Q[mask], slopes(table, Q)[mask])
    # the mean over nodes is not exactly that over a sector
    found = affordable_between(mask, own, usual, limits._replace(mean=SPARE * limits.mean))
    if not found.area:
        return None
    inside = Q[found.inside(table.shape) & mask]
    worth = _worth(table.task, symmetries, found, inside, half)
    sector = partial(shaped_sector, table, line, symmetries, found)
    return _place(table, openings, k, symmetries, Q[found.middle], worth, sector), inside
