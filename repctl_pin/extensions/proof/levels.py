r"""The levels as coordinates: joints that are proved to be a function of the levels at the start.

Let Φ(q) = (x, c) be the pose and the levels of a configuration, and (x₀, c₀) those of the start.
The levels c are the values of the r potentials. In this module, h are half-widths of boxes of
joints, not the potentials. The cube of levels ``|c_i − c_0i| ≤ γ`` is divided into
cells. In the middle c_k of a cell of half-width a, let Q_k solve ``Φ(Q_k) = (x₀, c_k)``, and A be
the inverse of the Jacobian J_V there. While the pose rests and the levels go from c_k to any c of
the cell, the joints stay in a box,

.. math:: |q − Q_k| ≤ |A_h|\, a + |A|\, Δ(h)\, h < h,

with A_h the last r columns of A and Δ a bound of the change of J_V on the box of half-widths h. The
motion ends at F_k(c). A wider box around Q_k, in which Φ is injective, also contains the values of
F_j for each neighbouring cell j. So F_k and F_j agree where the cells meet, and all F_k together
are one continuous function F(x₀, c). The theory, "Hand and elbow", has the theorem. Ω is the region
of joint space of the design. An argument ``inverse`` is the repeatable inverse with these
potentials, ``problem`` has bounds on its J_V over boxes of joints, and ``start`` (n,) is the start.
Letters: K cells, n joints.

``LeafMarginProblem`` is a task with potentials, prepared for bounds of the leaf margin over boxes
of joint space. ``Enclosure`` is boxes of joints that contain a motion, their half-widths, and
whether this is proved.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from ...base.arguments import Array
from ...base.errors import InputError, SingularityError
from ...strategies import RepeatableInverse
from .closed_path_proof import ROUND, Enclosure, LiftBoxes, errors_of
from .leaf_margin_bounds import LeafMarginProblem

_CELLS = (5, 17, 65, 257, 1025)
"""Numbers of cells per level that are tried, until each is small enough for a proof."""

_MOST_CELLS = 5000

_OVERLAP = 4.0
"""Half-width, in those of a cell, of the levels in whose box Φ is injective."""


@np.errstate(all="ignore")
def level_boxes(
    inverse: RepeatableInverse,
    problem: LeafMarginProblem,
    start: Array,
    most: float,
    clearance: Callable[[Array], Array],
) -> Enclosure:
    """Enclose the joints F(x₀, c) at the start's pose x₀, for all levels c near those of the start.

    ``start`` (n,) is the start, and ``most`` is γ, the largest change of each level. The cells
    become smaller until each is proved, and its box is inside Ω: ``clearance(Q)`` bounds how far
    each joint may move within Ω from Q (K, n), rad or m. In the result, each row of Q is the
    configuration in the middle of one cell. The same row of ``half`` bounds the distance of F(x₀,
    c) from this configuration for all levels c of the cell. Successive rows are neighbouring cells.
    If some cell cannot be proved, the result is not ``proved`` and has a reason, and its Q has the
    start as its only row.
    """
    r = inverse.task.r
    why = f"levels within {most:g} of the start's"
    Q, leaves = start[None], False
    for count in _CELLS:
        if count**r > _MOST_CELLS:
            break
        try:
            cells, Q = _solved(inverse, start, most, count)
        except (InputError, SingularityError) as error:
            return _refused(start, f"{why} are not reached: {error}")
        found = _proved(inverse, problem, start, cells, Q, most / count)
        if found is None:
            continue
        half, box = found
        if (box < clearance(Q)).all():
            return Enclosure(Q, half, True, "")
        leaves = True
        if not (clearance(Q) > 0).all():
            break
    if leaves:
        return _refused(start, f"{why} may leave Ω")
    return _refused(start, f"{why} are not proved to be regular in {len(Q)} cells")


def _refused(start: Array, why: str) -> Enclosure:
    return Enclosure(start[None], np.zeros((1, len(start))), False, why)


def _solved(
    inverse: RepeatableInverse, start: Array, most: float, count: int
) -> tuple[Array, Array]:
    """Solve for the configuration in the middle of each cell, from cell to neighbouring cell.

    ``count`` cells along each level divide the range ± ``most`` around the start's level, in units
    of the potential. An error is raised if a middle has no solution. Return the indices (K, r) of
    the cells, counted from the start's cell (0, …, 0), and the configurations (K, n) in their
    middles. Successive rows are neighbouring cells.
    """
    task, c, x = inverse.task, inverse.leaf(start), inverse.task.placements(start)
    width, side = 2 * most / count, count // 2
    solved = {(0,) * task.r: start}
    for cell in sorted(product(range(-side, side + 1), repeat=task.r), key=_far):
        if cell not in solved:
            level = c + width * np.array(cell)
            solved[cell] = inverse.solve(x, solved[_inward(cell)], leaf=level)
    cells = _in_turn(side, task.r)
    return np.array(cells), np.array([solved[cell] for cell in cells])


def _far(cell: tuple[int, ...]) -> int:
    return sum(map(abs, cell))


def _inward(cell: tuple[int, ...]) -> tuple[int, ...]:
    """Return the neighbour of a cell that is one step nearer to the start's cell (0, …, 0).

    The step is along the level whose index is the largest in absolute value. For the start's cell,
    which has no such neighbour, the result is the start's cell.
    """
    k = int(np.argmax(np.abs(cell)))
    return (*cell[:k], cell[k] - int(np.sign(cell[k])), *cell[k + 1 :])


def _in_turn(side: int, r: int) -> list[tuple[int, ...]]:
    """List all cells of r levels, with indices from −side to side, as tuples of r indices.

    Successive cells are neighbours: one of their indices differs, by 1.
    """
    if r == 0:
        return [()]
    found: list[tuple[int, ...]] = []
    inner = _in_turn(side, r - 1)
    for i in range(-side, side + 1):
        found += [(i, *cell) for cell in inner]
        inner = inner[::-1]
    return found


def _proved(
    inverse: RepeatableInverse,
    problem: LeafMarginProblem,
    start: Array,
    cells: Array,
    Q: Array,
    half_width: float,
) -> tuple[Array, Array] | None:
    """Bound, for all levels c of each cell, how far F(x₀, c) is from the cell's row of Q: (K, n).

    Return also the half-widths (K, n) of boxes around Q in which Φ is injective. Return None if a
    cell is not proved. ``half_width`` is the half-width of every cell. ``cells`` (K, r) are the
    indices of the cells, counted from the start's cell, and Q (K, n) the configurations in the
    middles of the cells.
    """
    task, bounds = inverse.task, LiftBoxes(inverse, problem, Q)
    c = inverse.leaf(start) + 2 * half_width * cells
    places = [task.as_target(task.placements(start))] * len(Q)
    off, level_off = errors_of(inverse, problem, Q, places, c)
    poses = np.repeat(off[:, None, None], 2, axis=2)

    # the box of the lifts in a cell, and the wider box in which Φ is injective
    near = bounds.around(bounds.moved(poses, half_width * (1 + ROUND) + level_off))
    wide = bounds.around(bounds.moved(poses, _OVERLAP * half_width + level_off))
    if near is None or wide is None:
        return None
    half, box = near[0], wide[1]
    if not (half < box).all():
        return None
    at = {tuple(cell): k for k, cell in enumerate(cells.tolist())}
    for k, cell in enumerate(cells.tolist()):
        for a in range(task.r):
            j = at.get((*cell[:a], cell[a] + 1, *cell[a + 1 :]))
            if j is None:
                continue
            if not (np.abs(Q[k] - Q[j]) + half[k] < box[j]).all():
                return None
    return half, np.maximum(box, near[1])
