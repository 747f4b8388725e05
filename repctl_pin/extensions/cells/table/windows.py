"""Windows: ranges of the angle around an arm in which its bodies keep a distance.

Where a part of the base is not round, or the arm stands beside a wall, bodies collide at some
angles alone. A window is a range of the angle. Each window has those nodes of a flood that are free
of collisions at all its angles: a wide window has fewer such nodes, a narrow window more. A table
is a grid of radius and height around the arm, whose nodes have the indices (i, j) of I radii and J
heights. A flood is the set of nodes that the arm reaches from one configuration without a change of
branch, one of the separate solutions of inverse kinematics.
"""

from __future__ import annotations

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
    """Angles around the arm, M in number, at which nodes of a flood cannot be used.

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
        """Return a mask (I, J) of the nodes that cannot be used at ``angle``, rad.

        It is the mask of the nearest angle that was tested.
        """
        k = round(angle / STEP) % _ANGLES
        return np.asarray(self.near[k] | self.out[k])

    def free(self, angles: tuple[float, float]) -> NDArray[np.bool_]:
        """Return the nodes (I, J) at which bodies keep the distance at all angles of a range.

        The range is from the first to the last angle, rad. Angles beyond the limits of the joint
        that turns the arm are left out.
        """
        half = (angles[1] - angles[0]) / 2
        away = STEP * np.arange(_ANGLES) - sum(angles) / 2
        inside = np.abs((away + np.pi) % (2 * np.pi) - np.pi) <= half + STEP / 2
        used = inside[:, None, None] & ~self.out
        return used.any(axis=0) & ~(self.near & used).any(axis=0)


class Windows(NamedTuple):
    """W windows of a flood, the widest first, with the nodes that are free at all their angles.

    Attributes
    ----------
    middle, half : (W,) arrays
        Middle and half-width of the angle, rad; the half-width of a whole turn is π.
    mask : (W, I, J) array of bool
        Nodes of the flood that are free of collisions at every angle.
    """

    middle: NDArray[Any]
    half: NDArray[Any]
    mask: NDArray[np.bool_]


def shut(table: Table, flood: Array, distance: float, farther: Shut | None = None) -> Shut:
    """Find where bodies are nearer than a distance, m, at the nodes of a flood (I, J, n).

    Pairs of bodies that do not move relative to each other when the arm turns are tested once per
    node. The other pairs are tested at each angle, at one node per block of nodes. ``farther`` is
    the result for a larger distance, if there is one: nodes at which bodies keep that distance are
    not tested again.
    """
    task, bodies, joint = table.task, bodies_of(table.task), table.around.joint
    on = np.argwhere(np.isfinite(flood[..., 0]))
    found = Shut(*np.ones((2, _ANGLES, *table.shape), bool))
    Q = flood[on[:, 0], on[:, 1]]
    moved = bodies._moved_by(joint)
    known = np.ones((_ANGLES, len(on)), bool)
    if farther is not None:
        known = farther.near[:, on[:, 0], on[:, 1]]
    always = known.all(axis=0)
    always[always] = bodies._nearer(Q[always], distance, ~moved)
    size = int(np.ceil(np.sqrt(len(on) / _BLOCKS)))
    _, first, block = np.unique(on[~always] // size, axis=0, return_index=True, return_inverse=True)
    some = np.flatnonzero(~always)[first]
    for k, angle in enumerate(STEP * np.arange(_ANGLES)):
        out = turned(task, Q, table.around, angle)[:, joint] > task.upper[joint]
        near = always.copy()
        closed = np.zeros(len(some), bool)
        closed[block.ravel()[known[k, ~always]]] = True  # blocks that are not known to be free
        Q_there = turned(task, Q[some[closed]], table.around, angle)
        closed[closed] = bodies._nearer(Q_there, distance, moved)
        near[~always] = closed[block.ravel()]
        found.near[k, on[:, 0], on[:, 1]], found.out[k, on[:, 0], on[:, 1]] = near, out
    return found


def windows(there: Shut) -> Windows:
    """List the windows with different sets of nodes; of windows with equal sets, only the widest.

    A window of a whole turn leaves out angles beyond the limits of the joint that turns the arm.
    All angles of a narrower window are inside these limits.
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
