"""Windows: ranges of the angle around an arm in which its bodies keep a distance.

Where a part of the base is not round, or the arm stands beside a wall, bodies collide at some
angles only. A window is a range of the angle. Each window has those nodes of a flood that are free
of collisions at all its angles: a wide window has fewer such nodes, a narrow window more. A table
is a grid of radius and height around the arm, whose nodes have the indices (i, j) of I radii and J
heights. A flood is the set of nodes that the arm reaches from one configuration without a change of
branch, one of the separate solutions of inverse kinematics; as an array (I, J, n), it has the
configurations of n joints, NaN at nodes that it does not reach.

``Shut`` is masks of the nodes that cannot be used at M angles: ``near``, a body is too near, and
``out``, a limit is exceeded. ``Table`` is a grid of poses (nodes) over radius and height around an
axis, at the angle 0 and one orientation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array
from ....model.bodies import bodies_of
from ..fit.trimming import turned
from .flood import Table

_ANGLES = 16
"""Number of angles around the arm at which bodies are tested."""

_LENGTHS = (16, 13, 11, 9, 7, 6, 5, 4, 3, 2)
"""Numbers of neighbouring angles in a window, the widest first."""

_BLOCKS = 500
"""Approximate number of nodes of a flood at which bodies are tested at all angles."""

STEP = 2 * np.pi / _ANGLES
"""Difference between neighbouring angles, rad."""


class Shut(NamedTuple):
    """Masks of the nodes of a flood that cannot be used at M equally spaced angles around the arm.

    The first angle is 0.

    Attributes
    ----------
    near : (M, I, J) array of bool
        True where bodies are nearer than the distance to keep, or the flood does not reach.
    out : (M, I, J) array of bool
        True where the joint that turns the arm is beyond its limits, or the flood does not reach.
    """

    near: NDArray[np.bool_]
    out: NDArray[np.bool_]

    def at(self, angle: float) -> NDArray[np.bool_]:
        """Return a mask (I, J), True at nodes that cannot be used at ``angle``, rad.

        It is the mask of the nearest angle that was tested.
        """
        k = round(angle / STEP) % _ANGLES
        return np.asarray(self.near[k] | self.out[k])

    def free(self, angles: tuple[float, float]) -> NDArray[np.bool_]:
        """Return a mask (I, J), True where bodies keep the distance at all angles of a range.

        The range is from the first to the last of the two ``angles``, rad. Angles beyond the limits
        of the joint that turns the arm are left out; a node with no other angle is False.
        """
        used = _within(angles)[:, None, None] & ~self.out
        return np.asarray(used.any(axis=0) & ~(self.near & used).any(axis=0))


class Windows(NamedTuple):
    """W windows of a flood, the widest first, with the nodes that are free at all their angles.

    Attributes
    ----------
    middle, half : (W,) arrays
        Middle and half-width of the angle, rad; the half-width of a whole turn is π.
    mask : (W, I, J) array of bool
        Nodes of the flood that are free of collisions at every angle of the window.
    """

    middle: NDArray[Any]
    half: NDArray[Any]
    mask: NDArray[np.bool_]


def shut(table: Table, flood: Array, distance: float, farther: Shut | None = None) -> Shut:
    """Find where bodies are nearer than a distance, m, at the nodes of a flood (I, J, n).

    The masks of the result are (M, I, J), for M equally spaced angles around the arm, beginning at
    0; ``out`` is True beyond the limits of the joint that turns the arm. Pairs of bodies that do
    not move relative to each other when the arm turns are tested once per node. The other pairs are
    tested at each angle, at one node per block of nodes. ``farther`` is a previous result for a
    larger distance, or None: nodes at which bodies keep the larger distance are not tested again.
    """
    found = Shut(*np.ones((2, _ANGLES, *table.shape), bool))
    on = np.argwhere(np.isfinite(flood[..., 0]))
    known = np.ones((_ANGLES, len(on)), bool)
    if farther is not None:
        known = farther.near[:, on[:, 0], on[:, 1]]
    nodes = _Nodes(table, flood[on[:, 0], on[:, 1]], on, distance, np.asarray(known.all(axis=0)))
    for k in range(_ANGLES):
        near = nodes.near(k, known[k])
        found.near[k, on[:, 0], on[:, 1]], found.out[k, on[:, 0], on[:, 1]] = near, nodes.out(k)
    return found


def free_nodes(
    table: Table,
    flood: Array,
    distance: float,
    angles: tuple[float, float],
    enough: Callable[[NDArray[np.bool_]], bool],
) -> NDArray[np.bool_]:
    """Find the nodes (I, J) of a flood at which bodies keep a distance at all angles of a range.

    The range is from the first to the last of the two ``angles``, rad. Angles beyond the limits of
    the joint that turns the arm are left out; a node with no other angle is False. One angle is
    tested after the other; a node at which bodies are near at one angle is not tested again.
    Before each angle, ``enough(mask)`` gets the mask (I, J) of the remaining nodes. If it returns
    False, the search ends with this mask, which can contain nodes at which bodies are near.
    """
    on = np.argwhere(np.isfinite(flood[..., 0]))
    nodes = _Nodes(table, flood[on[:, 0], on[:, 1]], on, distance, np.ones(len(on), bool))
    left, ever = ~nodes.always, np.zeros(len(on), bool)
    mask = np.zeros(table.shape, bool)
    for k in np.flatnonzero(_within(angles)):
        mask[on[:, 0], on[:, 1]] = left
        if not enough(mask):
            return mask
        inside = ~nodes.out(int(k))
        left[left & inside] &= ~nodes.near(int(k), left & inside)[left & inside]
        ever |= inside
    mask[on[:, 0], on[:, 1]] = left & ever
    return mask


def _within(angles: tuple[float, float]) -> NDArray[np.bool_]:
    """Test which of M equally spaced angles are in a range (first angle, last angle), rad: (M,).

    Angles are compared up to full turns, so a range may contain the angle π. An angle outside the
    range by at most half the spacing also counts. M is ``_ANGLES``.
    """
    half = (angles[1] - angles[0]) / 2
    away = STEP * np.arange(_ANGLES) - sum(angles) / 2
    return np.asarray(np.abs((away + np.pi) % (2 * np.pi) - np.pi) <= half + STEP / 2)


class _Nodes:
    """K nodes of a flood, at which bodies are tested at one angle around the arm after the other.

    Parameters
    ----------
    table
        The table.
    Q : (K, n) array
        Configurations of the flood.
    on : (K, 2) array of int
        Indices of the nodes.
    distance
        Distance that bodies must keep, m.
    doubtful : (K,) array of bool
        True for nodes at which bodies may be near at every angle; False where bodies are known to
        keep the distance at one or more angles.

    Attributes
    ----------
    always : (K,) array of bool
        Nodes at which two bodies are near that do not move relative to each other when the arm
        turns, so that they are near at every angle.
    """

    def __init__(
        self,
        table: Table,
        Q: Array,
        on: NDArray[np.intp],
        distance: float,
        doubtful: NDArray[np.bool_],
    ) -> None:
        self._table, self._Q, self._distance = table, Q, distance
        self._bodies = bodies_of(table.task)
        self._moved = self._bodies._moved_by(table.around.joint)
        self.always = doubtful.copy()
        self.always[doubtful] = self._bodies._nearer(Q[doubtful], distance, ~self._moved)
        size, some = int(np.ceil(np.sqrt(len(on) / _BLOCKS))), on[~self.always]
        _, first, block = np.unique(some // size, axis=0, return_index=True, return_inverse=True)
        self._first, self._block = np.flatnonzero(~self.always)[first], block.ravel()

    def out(self, k: int) -> NDArray[np.bool_]:
        """Test where the joint that turns the arm is beyond its limits at the angle k: (K,).

        k is the number of the angle, from 0 to M − 1, among M equally spaced angles around the arm.
        """
        task, joint = self._table.task, self._table.around.joint
        Q = turned(task, self._Q, self._table.around, STEP * k)
        return np.asarray(Q[:, joint] > task.upper[joint])

    def near(self, k: int, doubtful: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return the mask (K,) of the nodes at which bodies are near, at one angle around the arm.

        ``k`` is the index of the angle, from 0 to M − 1. Neighbouring nodes form a block, of which
        one node is tested for all of them. Blocks in which the mask ``doubtful`` (K,) is False
        everywhere are not tested, and count as not near.
        """
        closed = np.zeros(len(self._first), bool)
        closed[self._block[doubtful[~self.always]]] = True
        Q = turned(self._table.task, self._Q[self._first[closed]], self._table.around, STEP * k)
        closed[closed] = self._bodies._nearer(Q, self._distance, self._moved)
        near = self.always.copy()
        near[~self.always] = closed[self._block]
        return near


def windows(there: Shut) -> Windows:
    """List the windows of a flood, given the masks of its nodes that cannot be used.

    Among windows with equal nodes, only the widest is listed. Some angles may be beyond the limits
    of the joint that turns the arm. The window of a whole turn ignores these angles; a narrower
    window has only nodes at which all its angles are inside the limits.
    """
    rows = [np.arange(_ANGLES)]
    masks = [~(there.near & ~there.out).any(axis=0) & ~there.out.all(axis=0)]
    free = ~(there.near | there.out)
    for length in _LENGTHS[1:]:
        for first in range(_ANGLES):
            rows.append((first + np.arange(length)) % _ANGLES)
            masks.append(free[rows[-1]].all(axis=0))
    mask = np.array(masks)
    packed = np.packbits(mask.reshape(len(mask), -1), axis=1)
    kept = np.sort(np.unique(packed, axis=0, return_index=True)[1])
    lengths = np.array([len(rows[k]) for k in kept])
    firsts = np.array([rows[k][0] for k in kept])
    middle = np.where(lengths == _ANGLES, 0.0, STEP * (firsts + (lengths - 1) / 2))
    return Windows(middle, STEP / 2 * lengths, mask[kept])
