"""Floods: the nodes of a table that an arm reaches from one configuration without changing branch.

A branch is one of the separate solutions of inverse kinematics. A table is a grid of radius and
height around the axis of the joint that turns the whole arm. A node is a row of two indices, of
radius and height; in a flood, a third index before them is the number of the flood. A flood begins
at one node with one configuration and spreads from neighbour to neighbour. It stops at joint
limits, at singularities, and where a joint would jump. All floods are computed at once.

Letters: n joints, m task coordinates, I radii, J heights, S floods or masks; K and L are numbers of
nodes. ``held`` is True for joints that are locked.

``Table`` is a grid of poses (nodes) over radius and height around an axis, at the angle 0 and one
orientation. ``Rectangles`` are the largest rectangles of nodes in S masks: areas, first and last
indices of radius and height.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array
from ....model.native_kinematics import placed
from ....model.task import Task
from ..geometry.kinematics import solved
from ..geometry.symmetry import Symmetry

SPACING = 0.03
"""Spacing of the nodes, m."""

_MARGIN = 0.05
"""Limit margin, rad, m, or that share of the joint's range if it is less, where a flood stops."""

_SINGULAR = 0.02
"""σ_min / σ_max of J, of the joints that are not locked, at which a flood stops."""

_STEP = 0.45
"""Largest step of a joint between neighbours, rad or m."""

_PUSH, _ROOM = 0.3, 0.15
"""Gain of the motion away from the joint limits, and the margin at which it begins, rad or m."""

_EXACT = 1e-6
_PUSHED, _ITERATIONS = 3, 9
"""Newton steps with motion away from the limits, and in all."""

_WAYS = ((1, 0), (-1, 0), (0, 1), (0, -1))


class Table(NamedTuple):
    """Grid of poses over radius and height around an axis, at the angle 0 and one orientation.

    Attributes
    ----------
    task : Task
        The task.
    origin, outward, up : (3,) arrays
        Point on the axis, m; unit vectors along the radius (at the angle 0) and along the axis. All
        are in base axes.
    rotation : (3, 3) array
        Orientation of the frame, in base axes.
    radii, heights : (I,) and (J,) arrays
        Radii and heights of the nodes from ``origin``, m, rising by :attr:`spacing`.
    counted : (n,) array of bool
        True for joints whose limits are checked: all joints except those that alone turn the whole
        arm or the tool.
    around : Symmetry
        The joint that turns the arm about the axis.
    """

    task: Task
    origin: NDArray[Any]
    outward: NDArray[Any]
    up: NDArray[Any]
    rotation: NDArray[Any]
    radii: NDArray[Any]
    heights: NDArray[Any]
    counted: NDArray[np.bool_]
    around: Symmetry

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers (I, J) of radii and heights."""
        return len(self.radii), len(self.heights)

    @property
    def spacing(self) -> float:
        """Distance of neighbouring nodes, m."""
        return float(self.heights[1] - self.heights[0])

    def finer(self) -> Table:
        """Return the table with half the spacing; its nodes (2 i, 2 j) are the nodes (i, j)."""
        radii, heights = (
            np.linspace(each[0], each[-1], 2 * len(each) - 1) for each in (self.radii, self.heights)
        )
        return self._replace(radii=radii, heights=heights)

    def goals(self, nodes: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return the positions (K, 3), m, and rotations (K, 3, 3) of the frame at nodes (K, 2)."""
        rho, z = self.radii[nodes[:, 0]], self.heights[nodes[:, 1]]
        p = self.origin + rho[:, None] * self.outward + z[:, None] * self.up
        return p, np.broadcast_to(self.rotation, (len(nodes), 3, 3))

    def margins(self, Q: Array) -> Array:
        """Evaluate the minimum over joints of limit margin / required margin, at Q (K, n): (K,).

        Only :attr:`counted` joints are included. A configuration counts as inside the limits where
        the result exceeds 1. The required margin is 5 % of the range of the joint, and at most 0.05
        rad or m (``_MARGIN``).
        """
        least = _MARGIN * np.minimum(1.0, self.task.upper - self.task.lower)
        return np.asarray(
            (self.task.limit_margin(Q) / least)[:, self.counted].min(axis=1, initial=np.inf)
        )

    def solved(
        self, nodes: NDArray[np.intp], Q: Array, held: NDArray[np.bool_], iterations: int
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Solve for the poses of nodes (K, 2) by Newton's method from Q (K, n).

        ``held`` (K, n) is True for the joints that are locked, and ``iterations`` is the number of
        steps. Return the configurations (K, n), and a mask (K,) that is True where a configuration
        has the exact pose, is inside the limits, and is not singular.
        """
        task, Q = self.task, Q.copy()
        p_goal, R_goal = self.goals(nodes)
        pushed = min(_PUSHED, iterations - 3)
        on, left = np.arange(len(Q)), np.full(len(Q), np.inf)
        for i in range(iterations + 1):
            p, R, J = placed(task, Q[on])
            J = J * ~held[on, None, :]
            e = task.kind.errors(p, R, p_goal[on], R_goal[on])
            left[on] = np.abs(e).max(axis=1)
            if i == iterations:
                break
            push = self._push(Q[on], held[on]) if i < pushed else np.zeros_like(Q[on])
            Q[on] += _newton_step(J, e, push)
            on = on[(left[on] > 1e-8) | (i < pushed)]
            if not len(on):
                break
        good = np.zeros(len(Q), bool)
        exact = np.flatnonzero(left < _EXACT)
        good[exact] = self._sound(Q[exact], held[exact])
        return Q, good

    def _push(self, Q: Array, held: NDArray[np.bool_]) -> Array:
        """Compute motions (K, n), rad or m, that move joints away from near limits, at Q (K, n).

        A motion is 0 for a joint that is locked, far from its limits, or not :attr:`counted`.
        """
        task = self.task
        inner = _ROOM * np.minimum(1.0, task.upper - task.lower)
        low = np.maximum(0.0, task.lower + inner - Q)
        high = np.maximum(0.0, Q - task.upper + inner)
        return np.asarray(_PUSH * (low - high) * (self.counted & ~held))

    def _sound(self, Q: Array, held: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Test which configurations Q (K, n) are inside the limits and not singular: (K,).

        Only joints that are not locked count for singularities.
        """
        sound = self.margins(Q) > 1
        J = placed(self.task, Q[sound])[2] * ~held[sound, None, :]
        squares = np.linalg.eigvalsh(J @ np.swapaxes(J, 1, 2))
        sound[sound] = squares[:, 0] > _SINGULAR**2 * squares[:, -1]
        return sound


def _newton_step(J: Array, e: Array, push: Array) -> Array:
    """Compute Newton steps Δq = J⁺ (e − J b) + b, (K, n), shortened to 0.45 rad or m per joint.

    J (K, m, n) are Jacobians, e (K, m) task errors. The motion b = ``push`` (K, n) acts in the null
    space of J only.
    """
    JJ = J @ np.swapaxes(J, 1, 2) + 1e-10 * np.eye(J.shape[1])
    rest = (e - np.einsum("Kmn,Kn->Km", J, push))[..., None]
    dQ = np.einsum("Kmn,Km->Kn", J, solved(JJ, rest)[..., 0]) + push
    longest = np.abs(dQ).max(axis=1, keepdims=True)
    return np.asarray(dQ * np.minimum(1.0, _STEP / np.maximum(longest, 1e-12)))


def flooded(table: Table, nodes: NDArray[np.intp], Q: Array, held: NDArray[np.bool_]) -> Array:
    """Compute S floods of a table: configurations (S, I, J, n), NaN at nodes that are not reached.

    Flood i begins at the node ``nodes[i]`` with the configuration ``Q[i]``: ``nodes`` is (S, 2), Q
    and ``held`` are (S, n). An arm with locked joints cannot avoid a jump by self-motion. So the
    flood of such an arm leaves out a node if a joint differs there by 0.45 rad or m or more from
    its value at a neighbouring node.
    """
    found = np.full((len(Q), *table.shape, table.task.n), np.nan)
    seed = np.arange(len(Q))
    found[seed, nodes[:, 0], nodes[:, 1]] = Q
    front = np.column_stack([seed, nodes])
    while len(front):
        beside, parent = _neighbours(found, front)
        if not len(beside):
            break
        start = front[parent]
        before = found[start[:, 0], start[:, 1], start[:, 2]]
        Q, good = table.solved(beside[:, 1:], before, held[beside[:, 0]], _ITERATIONS)
        good &= np.abs(Q - before).max(axis=1) < _STEP
        front, Q = beside[good], Q[good]
        found[front[:, 0], front[:, 1], front[:, 2]] = Q
        jumps = held[front[:, 0]].any(axis=1) & ~_near_neighbours(found, front, Q)
        found[front[jumps, 0], front[jumps, 1], front[jumps, 2]] = np.nan
        front = front[~jumps]
    return found


def _near_neighbours(found: Array, nodes: NDArray[np.intp], Q: Array) -> NDArray[np.bool_]:
    """Test which Q (K, n) at nodes (K, 3) are near the configurations of all neighbours: (K,).

    Only neighbours that the flood has reached count. Near means that each joint differs by less
    than 0.45 rad or m. ``found`` (S, I, J, n) has the configurations that the floods have reached
    so far.
    """
    near = np.ones(len(nodes), bool)
    for way in _WAYS:
        beside = nodes + (0, *way)
        inside = ((beside[:, 1:] >= 0) & (beside[:, 1:] < found.shape[1:3])).all(axis=1)
        there = found[tuple(beside[inside].T)]
        # where a neighbour is not reached, NaN compares as near
        near[inside] &= ~(np.abs(Q[inside] - there).max(axis=1) >= _STEP)
    return near


def _neighbours(found: Array, front: NDArray[np.intp]) -> tuple[NDArray[np.intp], ...]:
    """List the nodes (L, 3) that are not reached yet and are neighbours of a front (K, 3).

    The front has the nodes that were reached last. Each node is listed once. Return also, for each
    listed node, the index of a node of the front beside it: (L,). ``found`` (S, I, J, n) is NaN at
    nodes that are not reached.
    """
    beside = np.concatenate([front + (0, *way) for way in _WAYS])
    parent = np.tile(np.arange(len(front)), len(_WAYS))
    inside = ((beside[:, 1:] >= 0) & (beside[:, 1:] < found.shape[1:3])).all(axis=1)
    beside, parent = beside[inside], parent[inside]
    new = np.isnan(found[beside[:, 0], beside[:, 1], beside[:, 2], 0])
    beside, first = np.unique(beside[new], axis=0, return_index=True)
    return beside, parent[new][first]


class Rectangles(NamedTuple):
    """Largest rectangle of nodes in each of S masks; all attributes have one row per mask.

    Attributes
    ----------
    area : (S,) array
        Area between the outer nodes, in units of the nodes' spacing squared; 0 without a rectangle.
    first, last : (S, 2) arrays of int
        ``first`` has the smallest indices (radius, height) of each rectangle, ``last`` the largest
        indices.
    """

    area: NDArray[Any]
    first: NDArray[np.intp]
    last: NDArray[np.intp]


def rectangles(mask: NDArray[np.bool_]) -> Rectangles:
    """Find the largest rectangle of True entries in each of the masks (S, I, J).

    The area of a rectangle is measured between its outer nodes, in units of the spacing squared.
    The area is 0 if a mask contains no rectangle.
    """
    S, rows = mask.shape[:2]
    area = np.zeros(S)
    first, last = np.zeros((S, 2), int), np.zeros((S, 2), int)
    longest = _longest_runs(mask)[0] - 1
    for low in range(rows):
        # area that a rectangle from this row down to each later row can have at most
        most = np.minimum.accumulate(longest[:, low:], axis=1) * np.arange(rows - low)
        on = np.flatnonzero(most.max(axis=1) > area)
        if not len(on):
            continue
        depth = int(np.flatnonzero((most[on] > area[on, None]).any(axis=0))[-1]) + 1
        # all ranges of rows that begin here, with the columns that are open in each
        length, end = _longest_runs(np.logical_and.accumulate(mask[on, low : low + depth], axis=1))
        found = np.maximum(length - 1, 0) * np.arange(depth)
        every, best = np.arange(len(on)), found.argmax(axis=1)
        larger = found[every, best] > area[on]
        on, every, best = on[larger], every[larger], best[larger]
        right = end[every, best]
        area[on] = found[every, best]
        first[on] = np.column_stack([np.full(len(on), low), right - length[every, best] + 1])
        last[on] = np.column_stack([low + best, right])
    return Rectangles(area, first, last)


def _longest_runs(mask: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Find the first of the longest runs of True entries in each row of the masks (S, I, J).

    Return the lengths of the runs, 0 in a row without a True entry, and the indices of their last
    entries: two (S, I).
    """
    at = np.arange(mask.shape[2])
    # length of the run that ends at each column
    run = at - np.maximum.accumulate(np.where(mask, -1, at), axis=2)
    end = run.argmax(axis=2)
    return np.take_along_axis(run, end[..., None], axis=2)[..., 0], end
