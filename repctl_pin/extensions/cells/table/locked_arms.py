"""Arms with locked joints, compared with a design: how much each covers, at which joint speed.

A table is a grid of radius and height around the arm, at the angle 0. A flood is the set of its
nodes that the arm reaches from one configuration without a change of branch (of the inverse
kinematics). A locked flood is that of an arm with r of its joints locked, which is therefore not
redundant: it has one configuration per pose. A cell is a set of poses. A sector is a cell around
the arm, with a range of radius, angle and height. The middle of a flood is the node in the middle
of its largest rectangle. G_d is the desired inverse of a design, here J⁺. Masks (I, J) have one
entry per node, for I radii and J heights. S is the number of floods, n that of joints, K that of
nodes or configurations. Squared joint speeds are defined in :mod:`.joint_speeds`.

``Floods`` are S floods, see :mod:`.flood_sets`. ``Table`` is a grid of poses (nodes) over radius
and height around an axis, at the angle 0 and one orientation. ``Required`` holds the limits of a
function: mean and maximum extra joint speed relative to J⁺ (0.05 is 5 %), and body distance, m.
``LargerArm`` is an arm with locked joints that covers a larger sector than a design. ``Between`` is
a set of nodes between two polynomials of the height. ``Shut`` is masks of the nodes that cannot be
used at M angles: ``near``, a body is too near, and ``out``, a limit is exceeded.
"""

from __future__ import annotations

from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array
from ....model.bodies import bodies_of
from ....model.native_kinematics import placed
from ..cell_design_result import CellDesign, joint_values
from ..evaluate.reach import unlike_rows
from ..fit.trimming import Required, near_all_round
from ..geometry.kinematics import joined
from ..geometry.sector import ANGLE, HEIGHT, Sector
from .flood import SPACING, Table, flooded, rectangles
from .flood_sets import ALIKE, SETTLED, Floods
from .joint_speeds import locked_price, locked_squares
from .largest_profile import SPARE, Between, affordable_between, more_between, most_between
from .windows import free_nodes

_SETS, _COMPARED, _ALMOST = 16, 6, 0.02
"""Numbers of sets of joints that are locked as in the middle of a design, and of arms with locked
joints that are compared; and the difference of shares below which these are equal."""


class LockedJoints(NamedTuple):
    """An arm with r of its joints locked, and which part of a sector it covers.

    With r joints locked, an arm is not redundant, so it is a trivial repeatable controller.

    Attributes
    ----------
    joints : tuple of str
        Names of the r joints that are locked.
    values : tuple of float
        Values at which these joints are locked, rad or m.
    share : float
        Share of the sector's radii and heights that the arm covers, on a grid of 3 cm; 1 for the
        arm of a :class:`LargerArm`.
    extra, worst : float
        Joint speed divided by that of J⁺, minus 1: for the rms speeds over the nodes that the arm
        covers, and at the node where it is largest.
    area : float
        Area of radius and height, m², that the arm covers without collision: its largest rectangle
        in the design's sector. For the arm of a :class:`LargerArm`, it is the area of the larger
        sector.
    """

    joints: tuple[str, ...]
    values: tuple[float, ...]
    share: float
    extra: float
    worst: float
    area: float

    @property
    def where(self) -> str:
        """The locked joints and their values as text."""
        return joint_values(self.joints, self.values)

    def __str__(self) -> str:
        if not self.share:
            return f"{self.where} locked: covers none of it"
        return (
            f"{self.where} locked: covers {100 * self.share:.0f} % of it, "
            f"+{100 * max(self.extra, 0.0):.1f} % on average, "
            f"+{100 * self.worst:.0f} % at the worst pose"
        )


class LargerArm(NamedTuple):
    """Arm with locked joints that covers a larger sector than a design.

    ``found`` has the sector's range of radius, between two polynomials of the height, and
    ``posture`` (n,) is the arm's configuration in the middle.
    """

    arm: LockedJoints
    found: Between
    posture: Array


def best_locked(
    table: Table, locked: Floods, design: CellDesign, limits: Required
) -> LockedJoints | None:
    """Find the arm with locked joints that covers the largest share of a design's sector.

    ``locked`` are floods with locked joints. At most six arms are tried, those that keep the limits
    of joint speed first. Among arms that cover the same share, the arm with the lowest joint speed
    is tried first. Return None if none of them covers a part of the sector without collision.
    """
    cell = design.function.chart.cell
    assert isinstance(cell, Sector), "a table is a sector"
    low, high = cell.radii(table.heights).T
    inside = (table.radii[:, None] >= low - 1e-9) & (table.radii[:, None] <= high + 1e-9)
    inside &= np.abs(table.heights - cell.middle[1]) <= cell.widths[HEIGHT] + 1e-9
    share = (locked.reached & inside).sum(axis=(1, 2)) / max(inside.sum(), 1)
    if not share.any():
        return None
    prices = np.full((len(share), 2), np.inf)
    for k in np.flatnonzero(share > share.max() / 2):
        Q = locked.Q[k][locked.reached[k] & inside]
        prices[k] = locked_price(cell, Q, locked.held[k])
    dear = (prices > [limits.mean, limits.worst]).any(axis=1)
    best: LockedJoints | None = None
    # those within the limits of joint speed first, then by area and price, then from the middle
    order = np.lexsort((np.round(prices[:, 0], 3), -np.round(share / _ALMOST), dear))
    for k in order[:_COMPARED]:
        # bodies leave at most this share
        if best is not None and best.share > share[k] - _ALMOST:
            break
        one = _locked_joints(table, locked, int(k), cell, inside, limits.distance)
        if one is not None and (best is None or one.share > best.share + _ALMOST):
            best = one
    return best


def larger_arm(
    table: Table, locked: Floods, cell: Sector, area: float, limits: Required
) -> LargerArm | None:
    """Search for an arm with locked joints that covers a sector larger than ``area``, m².

    The search is among the floods ``locked``; of floods with similar configurations in their
    middles, only the largest is searched. Return None if no sector is larger by more than 2 %. The
    range of radius of the sector may depend on the height. At its nodes, joint speed is within the
    limits, and bodies keep the distance of ``limits`` at all angles of ``cell``. Joint speeds are
    those along the coordinates of ``cell``.
    """
    least = area * (1 + _ALMOST) / SPACING**2
    # the joint speed of a locked arm is known, so that no share of its limit is spared
    exact = limits._replace(worst=limits.worst / SPARE)
    found = rectangles(locked.reached)
    order = np.argsort(-found.area, kind="stable")
    # joints that do not move the task count, too, because they move bodies; so do locked joints
    middles = np.column_stack([locked.middles(found)[1], locked.held])
    order = order[unlike_rows(middles[order], ALIKE, _SETS)]
    best = None
    for k in map(int, order):
        if most_between(locked.reached[k]) <= least:
            continue
        own, usual = _locked_speeds(table, locked, k, cell)
        # without bodies first, because they are slow to test
        if affordable_between(locked.reached[k], own, usual, exact, least).area > least:
            enough = partial(more_between, least=least)
            angles = _angles(table, cell)
            clear = free_nodes(table, locked.Q[k], limits.distance, angles, enough)
            between = affordable_between(clear, own, usual, exact, least)
            if between.area > least:
                one = _locked_arm(table, locked, k, cell, between.inside(table.shape))
                one = one._replace(area=between.area * SPACING**2)
                best = LargerArm(one, between, locked.Q[k][between.middle])
                least = between.area
    return best


def _locked_speeds(table: Table, locked: Floods, k: int, cell: Sector) -> Array:
    """Evaluate squared joint speeds of an arm with locked joints, and of J⁺: (2, I, J).

    The arm is that of flood number ``k`` of ``locked``, floods with r joints locked. Speeds are per
    unit of task speed along the coordinates of ``cell``, and NaN at nodes outside the flood.
    """
    speeds = np.full((2, *table.shape), np.nan)
    there = locked.reached[k]
    speeds[:, there] = locked_squares(cell, locked.Q[k][there], locked.held[k])
    return speeds


def _locked_joints(
    table: Table, locked: Floods, k: int, cell: Sector, inside: NDArray[np.bool_], distance: float
) -> LockedJoints | None:
    """Find which nodes of the mask ``inside`` (I, J) an arm covers, and its joint speeds there.

    The arm has locked joints; it is that of flood number ``k`` of ``locked``. A node is left out
    only if bodies are nearer than ``distance``, m, at all angles of ``cell``. Joint speeds are
    those of motions along the coordinates of ``cell``. Return None if no node is left.
    """
    clear = locked.reached[k] & inside
    on = np.argwhere(clear)
    closed = on[_near(table, on, locked.Q[k][clear], distance, _angles(table, cell))]
    clear[closed[:, 0], closed[:, 1]] = False
    if not clear.any():
        return None
    one = _locked_arm(table, locked, k, cell, clear)
    return one._replace(share=float(clear.sum() / inside.sum()))


def _locked_arm(
    table: Table, locked: Floods, k: int, cell: Sector, clear: NDArray[np.bool_]
) -> LockedJoints:
    """Evaluate an arm with locked joints on all nodes of a mask ``clear`` (I, J).

    The arm is that of flood number ``k`` of ``locked``, which reaches these nodes. Joint speeds are
    those along the coordinates of ``cell``. The ``share`` of the result is 1; the caller may
    replace this value.
    """
    task, Q = table.task, locked.Q[k][clear]
    joints = np.flatnonzero(locked.held[k])
    return LockedJoints(
        tuple(task.joint_names[j] for j in joints),
        tuple(Q[0, joints].tolist()),
        1.0,
        *locked_price(cell, Q, locked.held[k]),
        float(rectangles(clear[None]).area[0] * SPACING**2),
    )


def with_middles(table: Table, locked: Floods, design: CellDesign) -> Floods:
    """Add floods with locked joints that begin in the middle of a design's sector.

    Up to 16 sets of r joints are locked, each twice: once at the design's configuration in the
    middle, and once at 0. A joint whose limits exclude 0 keeps its value of that configuration.
    Floods whose first node is not reached are left out. Return the new floods, followed by
    ``locked``.
    """
    cell, task = design.cell, table.task
    assert isinstance(cell, Sector), "a table is a sector"
    sets = list(combinations(np.flatnonzero(table.counted), task.r))[:_SETS]
    held = np.zeros((2 * len(sets), task.n), bool)
    for row, joints in zip(held, [*sets, *sets], strict=True):
        row[list(joints)] = True
    rho, z = cell.middle
    at = [np.argmin(np.abs(table.radii - rho)), np.argmin(np.abs(table.heights - z))]
    nodes = np.tile(np.array(at), (len(held), 1))
    Q = np.tile(_at_zero(table, design), (len(held), 1))
    zero = held & (task.lower < 0) & (task.upper > 0)
    zero[: len(sets)] = False
    Q, good = table.solved(nodes, np.where(zero, 0.0, Q), held, SETTLED)
    more = Floods(flooded(table, nodes[good], Q[good], held[good]), nodes[good], held[good])
    return more if not len(locked.Q) else joined([more, locked])


def _angles(table: Table, cell: Sector) -> tuple[float, float]:
    """Return the first and the last angle of a sector, rad; the angle 0 is that of the table."""
    p = cell.placement.translation - table.origin
    middle = np.arctan2(np.cross(table.up, table.outward) @ p, table.outward @ p)
    return float(middle - cell.widths[ANGLE]), float(middle + cell.widths[ANGLE])


def _at_zero(table: Table, design: CellDesign) -> Array:
    """Turn the configuration (n,) in a design's middle to the angle and the orientation of a table.

    At most two joints are changed: that which turns the arm about the sector's axis, and that which
    turns the tool about its own axis.
    """
    q = design.posture.copy()
    for one in design.function.chart.cell.removed:
        p, R, _ = placed(table.task, q[None])
        outward, side = table.outward, np.cross(table.up, table.outward)
        away = p[0] - table.origin
        spun = table.rotation.T @ R[0]
        y, x = (side @ away, outward @ away) if one.coordinate == ANGLE else spun[1::-1, 0]
        q[one.joint] -= one.sign * np.arctan2(y, x)
    return q


def _near(
    table: Table, on: NDArray[np.intp], Q: Array, distance: float, angles: tuple[float, float]
) -> NDArray[np.bool_]:
    """Test at which nodes ``on`` (K, 2), with Q (K, n), bodies are near at every angle: (K,).

    Near means nearer than ``distance``, m. The angles, around the arm, go from the first to the
    last of ``angles``, rad. In each block of 3 × 3 nodes, one node is tested, and its result is
    used for the block.
    """
    near = np.flatnonzero(bodies_of(table.task)._nearer(Q, distance))
    _, first, block = np.unique(on[near] // 3, axis=0, return_index=True, return_inverse=True)
    found = np.zeros(len(Q), bool)
    closed = near_all_round(table.task, Q[near[first]], distance, table.around, angles)
    found[near] = closed[block.ravel()]
    return found
