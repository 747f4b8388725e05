"""Sectors of the panda, and small functions over them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA
from cell_functions import panda
from controls import evaluate_cells_quickly
from store import shared

import repctl_pin as rp

WIDTHS: dict[str, dict[str, Any]] = {
    "pose": {"height": 0.08, "half_angle": (0.2, 0.3), "spin": 0.3},
    "a turn without its symmetry": {"height": 0.08, "half_angle": (0.2, 0.2, 0.3), "angle": 1.0},
    "spin as far as the joint goes": {
        "height": 0.08,
        "half_angle": (0.2, 0.3),
        "angle": 0.3,
        "spin": "all",
    },
    "one orientation": {"height": 0.08},
    "axis": {"height": 0.08, "half_angle": 0.2, "angle": 1.0},
    "position": {"height": 0.08, "angle": 1.0},
    "xy": {},
    "a radius by height": {
        "radius": ([0.4, 0.03, 0.04], [0.55, -0.02, -0.05, 0.01, -0.01]),
        "height": 0.1,
        "half_angle": (0.1, 0.2),
        "angle": 0.5,
        "spin": "all",
    },
    "an axis task by height": {
        "radius": ([0.4, 0.0, 0.04], [0.5, -0.02]),
        "height": 0.08,
        "half_angle": 0.2,
        "angle": 1.0,
    },
    "one orientation by height": {"radius": ([0.4, 0.0, 0.04], [0.5, -0.02]), "height": 0.08},
    "another axis": {"height": 0.05, "angle": 0.5, "axis": [[0, 0.05, 0], [0.1, 0.2, 2.0]]},
}


def kind_of(name: str) -> str:
    kind = name.removeprefix("an ").split()[0]
    return kind if kind in ("axis", "position", "xy") else "pose"


def sector_of(name: str = "one orientation", **change: Any) -> rp.Sector:
    task = panda(kind_of(name))
    middle = pin.SE3(panda().placement(Q_PANDA).rotation, np.array([0.45, 0.1, 0.35]))
    return rp.Sector(task, middle, **({"radius": 0.08} | WIDTHS[name] | change))


@shared
def found(name: str = "one orientation") -> rp.CellDesign:
    """A small design over a sector: what it costs does not matter here."""
    sector = sector_of(name)
    with pytest.MonkeyPatch.context() as patch:
        evaluate_cells_quickly(patch)
        return rp.nearest_inverse_function(
            rp.Pseudoinverse(sector.task),
            sector,
            posture=rp.solve_ik(sector.task, Q_PANDA, sector.placement),
            degree=1,
            incomplete="keep",
            options=rp.FitOptions(samples=32, held_out=64),
        )
