"""Floods of a table: where they begin, and which of them are unlike.

A table is a grid of radius and height around the arm, at the angle 0. A flood is the set of its
nodes that the arm reaches from one configuration without a change of branch (of the inverse
kinematics). A locked flood is that of an arm with r of its joints locked, which is therefore not
redundant. ``line`` (2, 3) is the axis of the joint that turns the arm: a point, m, and a direction.
``rotation`` (3, 3) is the orientation of the frame at the angle 0. A node is a pair of indices
(radius, height), I radii and J heights. S is the number of floods, n that of joints, K that of
nodes or configurations.

``Floods`` are S floods: each is a set of neighbouring nodes with one configuration per node, so
that q changes continuously. ``Table`` is a grid of poses (nodes) over radius and height around an
axis, at the angle 0 and one orientation. ``Symmetry`` is a joint that changes only one coordinate
of the frame: the indices of both, and the sign, 1 or −1, of the change.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array
from ....base.errors import InputError
from ....model.native_kinematics import placed
from ....model.task import Task
from ....motion.solve_ik import random_configurations
from ..evaluate.reach import unlike_rows
from ..geometry.symmetry import Symmetry
from .flood import SPACING, Rectangles, Table, flooded, rectangles

_DRAWN, _SEEDS, _LOCKED = 2048, 24, 128
"""Numbers of random configurations, of floods from them, and of floods with locked joints."""

_MIDDLES, _TESTED = 12, 8
"""Numbers of middles of locked floods from which others begin, and of floods whose bodies are
tested."""

ALIKE, _STILL = 0.3, 1e-9
"""Difference of the joints, rad or m, below which two postures are alike; and largest entry of J,
per joint, of joints that do not move the task."""

NEAREST, _BEYOND = 0.06, 0.1
"""Smallest radius of a node, m; and share of the range of the drawn heights by which a table
extends beyond it if r = 1, because few random configurations are near its ends."""

SETTLED = 40
"""Newton steps with which a random configuration is brought to a node."""


class Floods(NamedTuple):
    """S floods of a table.

    Attributes
    ----------
    Q : (S, I, J, n) array
        Configurations; NaN where a flood does not reach.
    nodes : (S, 2) array of int
        Node at which each flood begins.
    held : (S, n) array of bool
        True for the joints that are locked in each flood.
    """

    Q: Array
    nodes: NDArray[np.intp]
    held: NDArray[np.bool_]

    @property
    def reached(self) -> NDArray[np.bool_]:
        """Masks (S, I, J) of the nodes that each flood reaches."""
        return np.isfinite(self.Q[..., 0])

    def middles(self, found: Rectangles) -> tuple[NDArray[np.intp], Array]:
        """Return nodes (S, 2) and configurations (S, n) in the middles of S rectangles.

        ``found`` has the largest rectangle of nodes in each flood. If its area is 0, the node is
        where the flood begins.
        """
        nodes = (found.first + found.last) // 2
        empty = found.area == 0
        nodes[empty] = self.nodes[empty]
        return nodes, self.Q[np.arange(len(self.Q)), nodes[:, 0], nodes[:, 1]]


def drawn_nodes(
    task: Task,
    rotation: Array,
    line: Array,
    symmetries: tuple[Symmetry, ...],
    heights: tuple[float, float],
    rng: np.random.Generator,
) -> tuple[Table, NDArray[np.intp], Array]:
    """Draw 2048 random configurations, and move each to the nearest node of a new table.

    ``heights`` are the lowest and the highest height of the table, m above the point of ``line``.
    The first of ``symmetries`` is that of the joint that turns the whole arm. A second one is that
    of the joint that turns the tool about its own axis, if there is such a joint. Return the table,
    and the nodes (K, 2) and configurations (K, n) of the K draws that reach their node.
    """
    Q = random_configurations(task, _DRAWN, rng)
    p = placed(task, Q)[0] - line[0]
    z = p @ line[1]
    flat = p - z[:, None] * line[1]
    rho = np.linalg.norm(flat, axis=1)
    more = _BEYOND * (task.r == 1) * np.ptp(z) * np.array([-1.0, 1.0])
    ends = np.array([z.min(), z.max()]) + more
    table = grid_around(task, rotation, line, symmetries, heights, rho, ends)
    # turned so that the frame lies at the angle 0
    around = symmetries[0]
    Q[:, around.joint] -= around.sign * np.arctan2(flat[:, 1], flat[:, 0])
    at = np.column_stack([(rho - NEAREST) / SPACING, (z - table.heights[0]) / SPACING])
    nodes = np.clip(np.rint(at).astype(int), 0, np.array(table.shape) - 1)
    Q, good = table.solved(nodes, Q, np.zeros(Q.shape, bool), SETTLED)
    if not good.any():
        raise InputError(
            f"the orientation is reached from none of {_DRAWN} random configurations within the "
            "joint limits",
            remedy="give another orientation, or a task that leaves a rotation free",
        )
    return table, nodes[good], Q[good]


def _mid_range(task: Task, Q: Array) -> Array:
    """Turn revolute joints of Q (K, n) by full turns, as near as possible to mid-range.

    The arm has the same branch before and after, but a flood from there is less likely to end at a
    joint limit. Joints without limits, or with a range of less than a full turn, stay as they are.
    """
    reach = task.upper - task.lower
    some = task.revolute & np.isfinite(reach) & (reach >= 2 * np.pi)
    middle = (task.lower[some] + task.upper[some]) / 2
    Q = Q.copy()
    Q[:, some] -= 2 * np.pi * np.rint((Q[:, some] - middle) / (2 * np.pi))
    return Q


def grid_around(
    task: Task,
    rotation: Array,
    line: Array,
    symmetries: tuple[Symmetry, ...],
    heights: tuple[float, float],
    rho: Array,
    z: Array,
) -> Table:
    """Create a table that spans the radii ``rho`` and the heights ``z``, m, one array of each.

    Radii begin at 0.06 m. Heights are above the point of ``line``,
    and limited to the range ``heights`` (lowest, highest). The first of the ``symmetries`` is that
    of the joint that turns the arm about ``line``. The joints of symmetries are not
    :attr:`~.Table.counted`: floods do not check their limits.
    """
    low, high = max(heights[0], z.min()), min(heights[1], z.max())
    counted = np.ones(task.n, bool)
    counted[[one.joint for one in symmetries]] = False
    table = Table(
        task,
        line[0],
        np.array([1.0, 0.0, 0.0]),
        line[1],
        rotation,
        np.arange(NEAREST, rho.max() + SPACING, SPACING),
        np.arange(np.ceil(low / SPACING - 1e-9), np.floor(high / SPACING + 1e-9) + 1) * SPACING,
        counted,
        symmetries[0],
    )
    if len(table.heights) < 2:
        raise InputError(
            f": the arm reaches no height between {heights[0]:g} and {heights[1]:g} m",
            argument="heights",
            remedy="give a larger range",
        )
    return table


def locked_floods(
    table: Table, nodes: NDArray[np.intp], Q: Array, rng: np.random.Generator
) -> Floods:
    """Make up to 128 floods of a table, each with r joints locked, chosen at random.

    Each flood begins at a random row of ``nodes`` (K, 2) and Q (K, n). In every second flood,
    joints are locked at 0 if their limits allow it. All other locked joints keep their values in Q.
    Floods whose first node is not reached are left out.
    """
    task = table.task
    rows = rng.integers(len(Q), size=_LOCKED)
    joints = np.flatnonzero(table.counted)
    held = np.zeros((_LOCKED, task.n), bool)
    for row in held:
        row[rng.permutation(joints)[: task.r]] = True
    begin = Q[rows]
    zero = held & ((np.arange(_LOCKED) % 2) == 0)[:, None] & (task.lower < 0) & (task.upper > 0)
    begin = np.where(zero, 0.0, begin)
    solved, good = table.solved(nodes[rows], begin, held, SETTLED)
    rows, solved, held = rows[good], solved[good], held[good]
    return Floods(flooded(table, nodes[rows], solved, held), nodes[rows], held)


def free_floods(
    table: Table,
    nodes: NDArray[np.intp],
    Q: Array,
    locked: Floods,
    worth: Callable[[Floods], Array] | None = None,
) -> Floods:
    """Flood a table without locked joints, from up to 24 nodes with unlike configurations.

    These nodes are chosen from ``nodes`` (K, 2), with the configurations Q (K, n). Further floods
    begin in the middles of the largest rectangles of floods ``locked``, which are selected as by
    :func:`unlike_floods`.
    """
    counted = table.counted
    kept, distance = [0], np.linalg.norm((Q - Q[0])[:, counted], axis=1)
    while len(kept) < min(_SEEDS, len(Q)):
        kept.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm((Q - Q[kept[-1]])[:, counted], axis=1))
    begin, at = Q[kept], nodes[kept]
    if len(locked.Q):
        rows = _unlike(table, locked, _MIDDLES, worth)
        middles, postures = locked.middles(rectangles(locked.reached))
        begin = np.concatenate([begin, postures[rows]])
        at = np.concatenate([at, middles[rows]])
    begin, held = _mid_range(table.task, begin), np.zeros(begin.shape, bool)
    return Floods(flooded(table, at, begin, held), at, held)


def unlike_floods(
    table: Table, floods: Floods, worth: Callable[[Floods], Array] | None = None
) -> Floods:
    """Select up to eight floods, those with the largest rectangles of nodes first.

    The configurations in the middles of these rectangles differ from flood to flood. If ``worth``
    is given, which rates floods (S,), up to four with the highest ratings come before these.
    """
    rows = _unlike(table, floods, _TESTED, worth)
    return Floods(floods.Q[rows], floods.nodes[rows], floods.held[rows])


def compared(table: Table) -> NDArray[np.bool_]:
    """Return a mask (n,) of the joints in which configurations of unlike floods differ.

    If r = 1, joints that alone turn the arm or the tool do not count: after full turns of them, a
    flood has the same nodes.
    """
    return table.counted | (table.task.r > 1)


def _unlike(
    table: Table, floods: Floods, count: int, worth: Callable[[Floods], Array] | None
) -> list[int]:
    """Select unlike floods: return their indices.

    They are up to ``count`` floods with the largest rectangles. With ``worth``, up to half as many
    others, which it rates highest, come before them. The middles of the rectangles are compared.
    The joints of :func:`compared` count, except those that do not move the task.
    """
    found = rectangles(floods.reached)
    postures = floods.middles(found)[1]
    moving = np.abs(placed(table.task, postures)[2]).max(axis=(0, 1)) > _STILL
    postures = postures[:, moving & compared(table)]
    ratings = [(found.area, count)]
    if worth is not None:
        ratings = [(worth(floods), count // 2), *ratings]
    rows: list[int] = []
    for rating, most in ratings:
        order = np.argsort(-rating, kind="stable")
        order = order[np.isin(order, rows, invert=True)]
        rows += order[unlike_rows(postures[order], ALIKE, most)].tolist()
    return rows
