"""Joint speed at nodes of a table: of a function, of J⁺, and of an arm with locked joints.

A cell is a set of poses with coordinates u, a function F over it gives one configuration for each
pose, and a node is a pose on a grid. The squared joint speed at a node is ``‖∂F/∂u C‖_F²`` for a
function, and ``‖J⁺ E C‖_F²`` for J⁺, with E = ∂x/∂u. The matrix C = (EᵀE)^(−1/2) scales u to unit
task speed. Arrays called ``own`` belong to a function, those called ``usual`` to J⁺. Extra joint
speed is the joint speed, not squared, relative to that of J⁺, minus 1. n is the number of joints, K
that of configurations.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array
from ....model.native_kinematics import placed
from ....strategies import Pseudoinverse
from ..geometry.cell import Cell


def locked_price(cell: Cell, Q: Array, held: NDArray[np.bool_]) -> tuple[float, float]:
    """Evaluate the extra joint speed of an arm with locked joints, over configurations Q (K, n).

    Return two numbers: the extra joint speed on average, from the rms joint speeds over the K
    configurations, and the largest at one configuration. 0.05 is 5 % more than J⁺. ``held`` (n,) is
    True for locked joints. The motions are those along the coordinates of ``cell``.
    """
    mine, least = locked_squares(cell, Q, held)
    return float(np.sqrt(mine.mean() / least.mean()) - 1), float(np.sqrt((mine / least).max()) - 1)


def locked_squares(cell: Cell, Q: Array, held: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Evaluate the squared joint speeds (K,) of an arm with locked joints and of J⁺ at Q (K, n).

    ``held`` (n,) is True for the locked joints. The motions are those along the coordinates of
    ``cell``.
    """
    J, E, C = _unit_twists(cell, Q)
    return _squares(np.linalg.pinv(J * ~held) @ E @ C, np.linalg.pinv(J) @ E @ C)


def least_speeds(cell: Cell, Q: Array, slopes: Array | None = None) -> tuple[Array, Array]:
    """Evaluate two squared joint speeds at Q (K, n): the minimum for a function, and that of J⁺.

    No function through Q has a lower joint speed than the first result. It is the speed of a
    function that moves as J⁺ does, except along a coordinate that a symmetry removes from u: there,
    the joint of the symmetry moves alone. Both results are (K,).

    If ``slopes`` are given, the first result is the speed of a function with these derivatives (K,
    n, k) along the k coordinates u, per m or rad. Only their part in the null space of J counts,
    so they may be differences.
    """
    J, E, C = _unit_twists(cell, Q)
    G = Pseudoinverse(cell.task).batch(Q, J)
    usual, k = G @ E, len(cell.moved)
    own = usual.copy()
    own[:, :, k:] = cell.along
    if slopes is not None:
        own[:, :, :k] += slopes - G @ (J @ slopes)
    return _squares(own @ C, usual @ C)


def _unit_twists(cell: Cell, Q: Array) -> tuple[Array, Array, Array]:
    """Evaluate at Q (K, n): J (K, m, n), E = ∂x/∂y (K, m, k) and C = (EᵀE)^(−1/2) (K, k, k).

    y are the coordinates of a cell in m and rad, not scaled as u is. k also counts the coordinates
    that symmetries remove from u, which are the last. A column of E is a task velocity per m or
    rad.
    """
    p, R, J = placed(cell.task, Q)
    E = cell._all_twists(cell._measured(p, R), R)[:, :, [*cell.moved, *cell._removed]]
    squares, V = np.linalg.eigh(np.swapaxes(E, 1, 2) @ E)
    return J, E, (V / np.sqrt(squares)[:, None]) @ np.swapaxes(V, 1, 2)


def _squares(own: Array, usual: Array) -> tuple[Array, Array]:
    """Sum the squares of two arrays (K, n, k) of joint motions over joints and coordinates.

    ``own`` are the motions of a function, ``usual`` those of J⁺. Return the sums (K,) of ``own``,
    then of ``usual``.
    """
    return (own**2).sum(axis=(1, 2)), (usual**2).sum(axis=(1, 2))
