"""Affordable rectangles: the largest in openings in which joint speed can keep its limits.

A table is a grid of radius and height around the arm, at the angle 0. A flood is the set of its
nodes that the arm reaches from one configuration without a change of branch (of the inverse
kinematics). A window is a range of the angle around the arm in which bodies keep a distance; an
opening is a window of one flood, with the nodes at which bodies keep the distance at all its
angles. Symmetries are the joints that alone turn the whole arm, or the tool. Squared joint speeds
at nodes, of a function and of J⁺, are defined in :mod:`.joint_speeds`. The limits of joint speed,
in ``limits``, are the maximum extra joint speed on average and at the worst node. Arrays called
``own`` belong to a function, those called ``usual`` to J⁺. I and J are the numbers of radii and
heights, S is that of floods, and K that of openings.

``Openings`` are K openings: each is a window of one flood, with the nodes at which bodies keep a
distance at all its angles. ``Rectangles`` are the largest rectangles of nodes in S masks: areas,
first and last indices of radius and height. ``Floods`` are S floods: each is a set of neighbouring
nodes with one configuration per node, so that q changes continuously. ``Table`` is a grid of poses
(nodes) over radius and height around an axis, at the angle 0 and one orientation. ``Symmetry`` is a
joint that changes only one coordinate of the frame: the indices of both, and the sign, 1 or −1, of
the change. ``Required`` holds the limits of a function: mean and maximum extra joint speed relative
to J⁺ (0.05 is 5 %), and body distance, m.
"""

from __future__ import annotations

import numpy as np

from ....base.arguments import Array
from ..fit.trimming import Required
from ..geometry.cell import Cell
from ..geometry.symmetry import Symmetry
from .flood import Rectangles, Table, rectangles
from .flood_sets import Floods
from .joint_speeds import least_speeds
from .largest_profile import DEAREST, SHARES, SPARE, most_between
from .openings import Openings, turn_share


def affordable(openings: Openings, speeds: Array, limits: Required) -> Rectangles:
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


def flood_speeds(floods: Floods, cell: Cell) -> Array:
    """Evaluate minimum squared joint speeds in S floods, of a function, then of J⁺: (2, S, I, J).

    No function with the configuration of a flood at a node has a lower joint speed there. Speeds
    are per unit of task speed along the coordinates of ``cell``; NaN outside a flood.
    """
    speeds = np.full((2, *floods.reached.shape), np.nan)
    speeds[:, floods.reached] = least_speeds(cell, floods.Q[floods.reached])
    return speeds


def affordable_worth(
    table: Table, cell: Cell, symmetries: tuple[Symmetry, ...], worst: float, floods: Floods
) -> Array:
    """Rate S floods by the worth, without bodies, of their nodes that are within a limit: (S,).

    The limit ``worst`` is that of the extra joint speed at a node, of which sectors whose range of
    radius depends on the height use 92 %. The area is in units of the nodes' spacing squared.
    """
    own, usual = flood_speeds(floods, cell)
    with np.errstate(invalid="ignore"):
        good = np.sqrt(own / usual) - 1 < SPARE * worst
    share = [
        turn_share(table.task, symmetries, Q[mask], 1.0) if mask.any() else 0.0
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
