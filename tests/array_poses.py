"""Functions of cells and their poses, for the tests of functions of arrays."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pinocchio as pin
from arms import Q_PANDA
from cell_functions import chart_of
from cell_functions import function_of as box_function
from sectors import sector_of

import repctl_pin as rp

COUNT = 16


@cache
def function_of(name: str) -> rp.InverseFunction:
    if name == "planar":  # three joints, which JAX compiles fast
        task, q = rp.Robot.load("planar3r").task("tool", "xy"), np.array([0.3, 0.8, 0.8])
        return rp.InverseFunction(chart_of(rp.Cell(task, task.placement(q), 0.2), q))
    if not name.startswith("sector, "):
        return box_function(name)
    sector = sector_of(name.removeprefix("sector, "))
    q = rp.solve_ik(sector.task, Q_PANDA, sector.placement)
    cell = sector.without(sector.symmetries)
    return rp.InverseFunction(chart_of(cell, q, degree=2, count=64))


def targets(F: rp.InverseFunction, count: int = COUNT, share: float = 0.9) -> np.ndarray:
    """Poses inside a cell, (count, 4, 4)."""
    return matrices(F, share * F.cell.sample(count, seed=5))


def matrices(F: rp.InverseFunction, U: np.ndarray) -> np.ndarray:
    p, R = F.cell.placements(U)
    X = np.tile(np.eye(4), (len(U), 1, 1))
    X[:, :3, :3], X[:, :3, 3] = R, p
    return X


def random_coordinates(F: rp.InverseFunction, count: int, rng: np.random.Generator) -> np.ndarray:
    """Coordinates of poses inside and a little outside a cell: (count, k)."""
    return rng.uniform(-1.1, 1.1, (count, F.cell.k))


def random_targets(
    F: rp.InverseFunction, count: int, seed: int = 0, most: float = 1.5
) -> tuple[np.ndarray, np.ndarray]:
    """Poses inside and a little outside a cell, and leaves, every third of which is 0."""
    rng = np.random.default_rng(seed)
    X = matrices(F, random_coordinates(F, count, rng))
    C = rng.uniform(-most, most, (count, F.task.r))
    C[::3] = 0.0
    return X, C


def ways(
    F: rp.InverseFunction, rng: np.random.Generator, count: int = COUNT
) -> Callable[[float], np.ndarray]:
    """Random ways through :func:`random_targets`: poses (count, 4, 4) as a function of a step.

    They are twists or, in a cell that holds coordinates constant, ways inside the cell.
    """
    U = random_coordinates(F, count, np.random.default_rng(0))
    if (F.cell.widths == 0).any():
        dU = rng.normal(size=U.shape)
        return lambda h: matrices(F, U + h * dU)
    X, twists = matrices(F, U), rng.normal(size=(count, 6))
    return lambda h: np.array([turned(x, h * w) for x, w in zip(X, twists, strict=True)])


def turned(x: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """Move a pose by a twist (v, ω) in base axes."""
    moved = x.copy()
    moved[:3, 3] += twist[:3]
    moved[:3, :3] = pin.exp3(twist[3:]) @ x[:3, :3]
    return moved
