"""Random smooth closed path through a cell, for tests of its inverse function."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...paths import TaskPath
from .cell import Cell

_WAVES = 3
_POINTS = 721
_REACH = 0.9


def tour(cell: Cell) -> TaskPath:
    r"""Make a random smooth closed path through a cell.

    Its coordinates in the cell are ``u_i(s) = Σ_k a_ik cos 2πks + b_ik sin 2πks`` for s from 0 to
    1, with random a and b, scaled so that the maximum of every |u_i| is 0.9.
    """
    rng = np.random.default_rng(0)
    k = 2 * np.pi * np.arange(1, _WAVES + 1)
    a, b = rng.normal(size=(2, cell.k, _WAVES)) / np.arange(1, _WAVES + 1)
    s = np.linspace(0, 1, _POINTS)[:, None]
    most = np.abs(np.cos(k * s) @ a.T + np.sin(k * s) @ b.T).max(axis=0)
    a, b = _REACH * a / most[:, None], _REACH * b / most[:, None]
    R_0, active = cell.placement.rotation, cell.moved
    turning = cell._frame_twists(np.zeros((1, cell.task.m)))[0, 3:][:, active]
    turns = cell.task.m > 3 and bool(turning.any())

    def at(s: float) -> Array:
        """Evaluate the coordinates u (k,) at the path parameter s."""
        return np.asarray(a @ np.cos(k * s) + b @ np.sin(k * s), float)

    def placed(s: float) -> tuple[Array, Array]:
        """Evaluate the position (3,), m, and the rotation (3, 3) at the path parameter s."""
        p, R = cell.placements(at(s)[None])
        return p[0], R[0]

    def twist(s: float) -> Array:
        """Evaluate the twist (v, ω), base axes, per unit of the path parameter s: (6,)."""
        du = b @ (k * np.cos(k * s)) - a @ (k * np.sin(k * s))
        rates = cell.spread(du[None])[0] - cell._offset
        return np.asarray(
            cell._frame_twists(cell.spread(at(s)[None]))[0] @ rates, float
        )

    return TaskPath(
        "tour 0 of the cell",
        lambda s: placed(s)[0],
        lambda s: twist(s)[:3],
        (lambda s: placed(s)[1]) if turns else R_0,
        spin=(lambda s: twist(s)[3:]) if turns else None,
    )
