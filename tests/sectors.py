"""Sectors of the panda, and small functions over them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
from arms import Q_PANDA
from cell_functions import chart_of, panda

import repctl_pin as rp
from repctl_pin.inverse_function import cell_evaluation, turning

WIDTHS: dict[str, dict[str, Any]] = {
    "pose": {"height": 0.08, "half_angle": (0.2, 0.3), "spin": 0.3},
    "a turn without its symmetry": {
        "height": 0.08,
        "half_angle": (0.2, 0.2, 0.3),
        "angle": 1.0,
    },
    "one orientation": {"height": 0.08},
    "axis": {"height": 0.08, "half_angle": 0.2, "angle": 1.0},
    "position": {"height": 0.08, "angle": 1.0},
    "xy": {},
    "another axis": {
        "height": 0.05,
        "angle": 0.5,
        "axis": [[0, 0.05, 0], [0.1, 0.2, 2.0]],
    },
}


def kind_of(name: str) -> str:
    return name if name in ("axis", "position", "xy") else "pose"


def sector_of(name: str = "one orientation", **change: Any) -> rp.Sector:
    task = panda(kind_of(name))
    middle = pin.SE3(panda().placement(Q_PANDA).rotation, np.array([0.45, 0.1, 0.35]))
    return rp.Sector(task, middle, **({"radius": 0.08} | WIDTHS[name] | change))


@cache
def found(name: str = "one orientation") -> rp.CellDesign:
    """The reference over a sector, as a function: what it costs does not matter here."""
    sector = sector_of(name)
    desired = rp.Pseudoinverse(sector.task)
    sector = turning.reduced(sector, desired)
    q = rp.solve_ik(sector.task, Q_PANDA, sector.placement)
    chart, turns = turning.centred(chart_of(sector, q, 2, 64))
    evaluation = replace(
        cell_evaluation.evaluate_cell(desired, chart, 64, 5, quick=True), turns=turns
    )
    how = {"samples": 64, "held_out": 64, "seed": 0, "steps": 0, "degrees": ((1, 1.0),)}
    asked = ("requested_limit_margin", "requested_body_distance", "requested_sigma_min")
    return rp.CellDesign.of(
        desired, chart, evaluation, **how, **dict.fromkeys(asked, 0.0)
    )
