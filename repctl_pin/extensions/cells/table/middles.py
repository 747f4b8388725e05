"""Middles for a box of poses: found in floods, sorted, and without collisions at the rim.

A middle is a position, with a configuration of the arm, around which a box of poses is grown in
steps of a tenth of its size. J⁺, the pseudoinverse of the task Jacobian, moves the arm from the
middle to the points of the box's rim: corners, edge middles and face centres. The box grows as long
as the arm reaches these points inside its joint limits; bodies may nevertheless collide there.

A table is a grid of radius and height around the arm, at the angle 0. A flood is the set of its
nodes that the arm reaches from one configuration without a change of branch (of the inverse
kinematics). Symmetries are the joints that alone turn the whole arm, or the tool. S is the number
of floods, n that of joints, K that of configurations; I and J are those of radii and heights.

``Grown`` has many middles, with a configuration at each and the size to which a box grew there.
``Table`` is a grid of poses (nodes) over radius and height around an axis, at the angle 0 and one
orientation. ``Symmetry`` is a joint that changes only one coordinate of the frame: the indices of
both, and the sign, 1 or −1, of the change.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ....base.arguments import Array
from ....base.errors import InputError
from ....model.bodies import bodies_of
from ....model.native_kinematics import placed
from ....motion.solve_ik import random_configurations
from ..evaluate.reach import EXACT, STEPS, Grown, grown, reached, unlike_rows
from ..fit.trimming import turned
from ..geometry.cell import Cell
from ..geometry.kinematics import bases, joined, rows_of
from ..geometry.symmetry import Symmetry
from .flood import SPACING, Table
from .flood_sets import NEAREST, drawn_nodes, free_floods, locked_floods, unlike_floods
from .sectors import axis_and_symmetries
from .windows import shut

ENOUGH, APART = 0.3, 0.02
"""Limit margin, rad or m, and body distance, m, above which larger ones are no longer an
advantage."""

_CHILDREN = 6
"""Number of middles that are tried beside each one."""

_PLACES, _APART_AT, _KEPT = 16, 0.25, 256
"""Number of places at which further configurations are drawn, and their smallest difference, in
largest half-widths; and number of boxes with which the search for bodies apart begins."""

_WIDTHS = (0.25, 0.12, 0.12, 0.06, 0.06, 0.06, 0.03, 0.03, 0.03)
"""How far from the best middles that search looks, in half-widths, one round after the other."""

_EXACTLY = 8
"""Newton steps with which the points of a rim are reached exactly."""

_SWAY, _UNLIKE = 2.0, 0.3
"""Self-motion, rad or m, relative to such a width; and difference of the joints, rad or m, below
which others are not searched for beside a middle, because they are for a better one."""

_WINDOWS = 4
"""Number of middles for a box per flood and side of the arm."""


def ordered(box: Cell, found: Grown, at: Array | None) -> Grown:
    """Sort the middles of a box, the best first, by the criteria of :func:`best_cell`.

    The criteria are, in this order: size of the box that fits around the middle; no collision at
    the rim, or the smallest overlap, if this was tested; small distance from ``at`` (3,), m, if
    ``at`` is given; whole box above z = 0 of the base; body distance, if tested; limit margin; the
    maximum joint motion to a point of the rim, the smallest first. A body distance above 2 cm
    counts as 2 cm, a limit margin above 0.3 rad or m as 0.3.
    """
    z = box.placements(box.corners())[0][:, 2] - box.placement.translation[2]
    below = found.p[:, 2] + z.min() * found.steps / STEPS < 0
    far = np.zeros(len(found.p)) if at is None else np.linalg.norm(found.p - at, axis=1)
    margin = np.minimum(found.margin, ENOUGH)
    deep, clear = np.minimum(found.distance, 0.0), np.minimum(found.distance, APART)
    swing = np.abs(found.ends - found.Q[:, None]).max(axis=(1, 2), initial=0.0)
    keys = (swing, -margin, -clear, below, far, -deep, -found.steps)
    return rows_of(found, np.lexsort(keys))


def beside(
    box: Cell, parents: Grown, width: float, rng: np.random.Generator, *, sway: float = 0.0
) -> Grown:
    """Grow a box around six random positions beside each of the middles ``parents``.

    The positions differ from the middle by at most ``width`` along each coordinate, in half-widths
    of the box. With ``sway``, the configurations at which the inverse kinematics starts also
    differ, by self-motions of up to ``sway``, rad or m, per direction of the null space of J.
    """
    best = rows_of(parents, np.arange(len(parents.p)).repeat(_CHILDREN))
    U, Q = width * rng.uniform(-1, 1, (len(best.p), box.k)), best.Q
    if sway:
        N = bases(placed(box.task, Q)[2])[1]
        Q = Q + np.einsum("Knr,Kr->Kn", N, sway * rng.uniform(-1, 1, (len(Q), N.shape[2])))
    return grown(box, best.p + box.placements(U)[0] - box.placement.translation, Q)


def collision_free(
    box: Cell, found: Grown, at: Array | None, rng: np.random.Generator, *, drawn: int, parents: int
) -> Grown:
    """Search for middles whose box grows largest and has no collision at its rim, the best first.

    The middles ``found`` were ordered by reach and limits alone, so bodies may collide at the rims
    of the best boxes. First, ``drawn`` random configurations are tried at the positions of these
    middles, which adds branches of inverse kinematics. Then, in several rounds, boxes are grown
    beside at most ``parents`` of the best middles, also after self-motions. In each round, the
    middles are sorted by :func:`ordered`, to which ``at`` is passed. Return the middles without
    collision among those with the largest box of all. If bodies collide at the rim of each such
    box, the result is empty, even if smaller boxes are free of collisions.
    """
    places = unlike_rows(found.p, _APART_AT * box.half_width.max(), _PLACES)
    p = found.p[np.resize(places, drawn)]
    found = joined([found, grown(box, p, random_configurations(box.task, drawn, rng))])
    found = _tested(box, rows_of(found, np.argsort(-found.steps, kind="stable")[:_KEPT]), 0)
    found = ordered(box, found, at)
    for width in _WIDTHS if len(found.p) else ():
        best = rows_of(found, unlike_rows(found.Q, _UNLIKE, parents))
        further = beside(box, best, width, rng, sway=_SWAY * width)
        found = ordered(box, joined([found, _tested(box, further, found.steps[0])]), at)
    largest = (found.steps == found.steps.max(initial=0)) & (found.distance >= 0)
    return rows_of(found, np.flatnonzero(largest))


def _tested(box: Cell, found: Grown, steps: int) -> Grown:
    """Select boxes that grew by ``steps`` or more, and compute the body distances at their rims.

    The distances, m, are ``distance`` of the result. A box is left out if a point of its rim is not
    reached exactly and inside the limits. This is tested here because a box grows even if the arm
    misses the points by a fraction of a step.
    """
    found = rows_of(found, np.flatnonzero(found.steps >= steps))
    rim, R = box.placements(box.rim())
    size = found.steps[:, None, None] / STEPS
    p = found.p[:, None] + size * (rim - box.placement.translation)
    R = np.tile(R, (len(p), 1, 1))
    ends = found.ends.reshape(-1, box.task.n)
    Q, left = reached(box, p.reshape(-1, 3), R, ends, iterations=_EXACTLY)
    good = (left < EXACT) & (box.task.limit_margin(Q).min(axis=1) > 0)
    whole = good.reshape(-1, len(rim)).all(axis=1)
    found = rows_of(found._replace(ends=Q.reshape(found.ends.shape)), np.flatnonzero(whole))
    distances = bodies_of(box.task).distances(found.ends.reshape(-1, box.task.n))
    return found._replace(distance=distances.reshape(-1, len(rim)).min(axis=1))


def middles_in_floods(box: Cell, rng: np.random.Generator) -> tuple[Array, Array]:
    """Find middles for a box in floods around the arm: positions (K, 3), m, and Q (K, n).

    On each of four sides of the arm, the middles are the nodes around which a flood reaches the
    largest share of the box. So the arm reaches most poses of the box without a change of branch.
    The result is empty if no joint turns the whole arm about a vertical axis.
    """
    task, heights = box.task, (-np.inf, np.inf)
    try:
        line, symmetries = axis_and_symmetries(task)
        table, nodes, Q = drawn_nodes(task, box.placement.rotation, line, symmetries, heights, rng)
    except InputError:
        return np.zeros((0, 3)), np.zeros((0, task.n))
    floods = free_floods(table, nodes, Q, locked_floods(table, nodes, Q, rng))
    tested = unlike_floods(table, floods)
    closed = [shut(table, flood, 0.0) for flood in tested.Q]
    sides = []
    for quarter in range(4):
        x, y, z = box.half_width if quarter % 2 == 0 else box.half_width[[1, 0, 2]]
        masks = tested.reached & ~np.array([one.at(quarter * np.pi / 2) for one in closed])
        share = _window_shares(table, masks, float(x), float(y), float(z))
        flat = (share * masks).reshape(len(share), -1)
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


def _window_shares(table: Table, masks: NDArray[np.bool_], x: float, y: float, z: float) -> Array:
    """Evaluate the share of a box around each node that each of S floods reaches: (S, I, J).

    The box has half-widths x (along the radius), y and z, m. The share is the fraction of the nodes
    with the radii and heights of the box that are True in ``masks`` (S, I, J).
    """
    S, rows, columns = masks.shape
    total = np.zeros((S, rows + 1, columns + 1))
    total[:, 1:, 1:] = masks.cumsum(axis=1).cumsum(axis=2)
    first = np.rint((table.radii - x - NEAREST) / SPACING).astype(int)
    last = np.rint((np.hypot(table.radii + x, y) - NEAREST) / SPACING).astype(int) + 1
    up = round(z / SPACING)
    low, high = np.arange(columns) - up, np.arange(columns) + up + 1
    area = (last - first)[:, None] * (high - low)
    i, i_end = np.clip(first, 0, rows)[:, None], np.clip(last, 0, rows)[:, None]
    j, j_end = np.clip(low, 0, columns), np.clip(high, 0, columns)
    inside = total[:, i_end, j_end] - total[:, i, j_end] - total[:, i_end, j] + total[:, i, j]
    return np.asarray(inside / area)
