"""Choice of the default start from which a cell fits."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from ...errors import InputError, RepctlError
from ...motion import solve_ik
from ...strategies import Pseudoinverse
from ...studies.problem import Problem

if TYPE_CHECKING:
    from .cell import Cell


def fitting_start(
    problem: Problem, cell_of: Callable[[Problem], Cell]
) -> tuple[Problem, Cell, bool]:
    """Choose the first default start from which a cell fits.

    A cell fits if J⁺ reaches the middle of the cell, and from there every corner along a straight
    ray, inside the joint limits and without collision in the middle and at the corners. If it fits
    from no start, the one with the most reached corners is chosen, and among equals the one with
    fewer of these faults.

    Parameters
    ----------
    problem
        The problem; a start that was given is not changed.
    cell_of
        Function that makes the cell of a problem: around the pose at its start, or its path.

    Returns
    -------
    problem : Problem
        The problem with the chosen start.
    cell : Cell
        The cell of that problem.
    fits : bool
        True if it fits.

    Raises
    ------
    InputError
        If there is no such cell for any start; the message is that of the first.
    """
    failure: InputError | None = None
    best: tuple[tuple[float, int], Problem, Cell] | None = None
    for tried in problem.alternatives():
        try:
            cell = cell_of(tried)
        except InputError as error:
            failure = failure or error
            continue
        share, faults = _reached(tried, cell)
        if best is None or (share, -faults) > best[0]:
            best = (share, -faults), tried, cell
        if (share, faults) == (1.0, 0):
            break
    if best is None:
        assert failure is not None  # there is always a start to try
        raise failure
    merit, chosen, cell = best
    return chosen, cell, merit == (1.0, 0)


def _reached(problem: Problem, cell: Cell) -> tuple[float, int]:
    """Evaluate the fraction of the corners that are reached, and the number of faults: limits
    violated, bodies that collide. The fraction is −1 if the middle is not reached."""
    from .posture_search import judged
    from .sector import Sector  # slow to import, and not needed by a study
    from .turning import reduced

    desired = Pseudoinverse(problem.task)
    try:
        q = solve_ik(problem.task, problem.start, cell.placement)
    except RepctlError:
        return -1.0, 0
    whole = reduced(cell, desired) if isinstance(cell, Sector) else cell
    found = judged(desired, whole, q[None])[0]
    return found.share, (found.margin < 0) + (found.body_distance < 0)
