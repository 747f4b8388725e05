"""Random smooth closed path through a cell."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ..arguments import Array, as_int, require_type
from ..motion import TaskPath
from .cell import Cell

_WAVES = 3
_POINTS = 721


def tour(cell: Cell, seed: int = 0, *, reach: float = 0.9) -> TaskPath:
    r"""Draw a random smooth closed path: ``u_i(s) = Σ_k a_ik cos 2πks + b_ik sin 2πks``, every
    ``|u_i| ≤ reach``.

    Parameters
    ----------
    cell
        The cell.
    seed
        Random seed.
    reach
        Largest ``|u_i|``; with 1 the path touches all faces of the cell.
    """
    require_type(cell, Cell, "cell", "a cell, such as rp.Cell(task, placement, 0.1)")
    rng = np.random.default_rng(as_int(seed, "seed"))
    k = 2 * np.pi * np.arange(1, _WAVES + 1)
    a, b = rng.normal(size=(2, cell.k, _WAVES)) / np.arange(1, _WAVES + 1)
    s = np.linspace(0, 1, _POINTS)[:, None]
    most = np.abs(np.cos(k * s) @ a.T + np.sin(k * s) @ b.T).max(axis=0)
    a, b = reach * a / most[:, None], reach * b / most[:, None]
    positions, R_0 = len(cell.half_width), cell.placement.rotation

    def parts(u: Array) -> tuple[Array, Array]:
        """Convert coordinates or their rates to a position, m, and a rotation vector, base axes."""
        y, p = cell.spread(u[None])[0], np.zeros(3)
        p[cell.task.rows[:positions]] = y[:positions]
        return p, cell.vectors(y[None, positions:])[0] if turns else np.zeros(3)

    def at(s: float) -> tuple[Array, Array]:
        return parts(a @ np.cos(k * s) + b @ np.sin(k * s))

    def rates(s: float) -> tuple[Array, Array]:
        return parts(b @ (k * np.cos(k * s)) - a @ (k * np.sin(k * s)))

    turns = bool(cell.rotation.any())
    return TaskPath(
        f"tour {seed} of the cell",
        lambda s: cell.placement.translation + at(s)[0],
        lambda s: rates(s)[0],
        (lambda s: pin.exp3(at(s)[1]) @ R_0) if turns else R_0,
        spin=(lambda s: pin.Jexp3(at(s)[1]).T @ rates(s)[1])
        if turns
        else None,  # J_l is the transpose of J_r
    )
