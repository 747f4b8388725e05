"""Relaxed floods: the configuration at each node is moved near to the mean of its neighbours.

A table is a grid of radius and height around the arm, at the angle 0. A flood is the set of its
nodes that the arm reaches from one configuration without a change of branch; as an array (I, J, n),
it has the configurations of n joints at I radii and J heights, NaN at nodes that it does not reach.
If the arm is redundant, the configuration at a node depends on the way along which the flood came
there. Configurations of neighbours then differ more than they must. A relaxed flood has the same
nodes, and less joint speed: the part of the joint motion that lies in the null space of J is small.
Joint limits are kept, and bodies keep a distance. So a function near its configurations does, too,
where a function of minimum joint speed may have a collision.

``Table`` is a grid of poses (nodes) over radius and height around an axis, at the angle 0 and one
orientation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array
from .flood import Table
from .windows import free_nodes

_SWEEPS, _STEPS = 32, 6
"""Number of sweeps, each of which moves every second node, and of Newton steps per node."""


def relaxed(
    table: Table,
    flood: Array,
    mask: NDArray[np.bool_],
    distance: float,
    angles: tuple[float, float],
) -> Array:
    """Relax a flood (I, J, n) at the nodes of a mask (I, J); return (I, J, n), NaN at other nodes.

    A node keeps its configuration where the new one would be singular, beyond a limit, or a jump,
    or where bodies would be nearer than ``distance``, m, at one of the angles of a range. The range
    is from the first to the last of the two ``angles`` around the arm, rad.
    """
    Q = np.where(mask[..., None], flood, np.nan)
    nodes = np.argwhere(mask)
    for sweep in range(_SWEEPS):
        on = nodes[(nodes.sum(axis=1) + sweep) % 2 == 0]
        i, j = on.T
        beside = _beside(Q)[:, i, j]
        there = np.isfinite(beside)
        alone = ~there.any(axis=(0, 2))
        mean = np.where(there, beside, 0.0).sum(axis=0) / np.maximum(there.sum(axis=0), 1)
        mean[alone] = Q[i, j][alone]
        found, good = table.solved(on, mean, np.zeros(mean.shape, bool), _STEPS)
        new = np.full(Q.shape, np.nan)
        new[i[good], j[good]] = found[good]
        free = free_nodes(table, new, distance, angles, np.any)
        Q[free] = new[free]
    return Q


def slopes(table: Table, Q: Array) -> Array:
    """Compute differences of a flood Q (I, J, n) along radius and height: (I, J, n, 2), per m.

    They are central where both neighbours are reached, one-sided where only one is, else 0.
    """
    both = [
        np.where(np.isfinite(ahead - behind), (ahead - behind) / 2, one_sided)
        for ahead, behind in _beside(Q).reshape(2, 2, *Q.shape)
        for one_sided in [np.where(np.isfinite(ahead), ahead - Q, Q - behind)]
    ]
    return np.asarray(np.nan_to_num(np.stack(both, axis=-1)) / table.spacing)


def _beside(Q: Array) -> Array:
    """Return the configurations of the four neighbours of each node: (4, I, J, n).

    The order is: larger and smaller radius, larger and smaller height. NaN stands where there is no
    neighbour.
    """
    P = np.pad(Q, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    return np.stack([P[2:, 1:-1], P[:-2, 1:-1], P[1:-1, 2:], P[1:-1, :-2]])
