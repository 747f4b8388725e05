"""Numbers with which a cell's page evaluates the cell's function when the user drags the hand.

In the page, ``potentials.js`` evaluates the potentials of the function's chart and ``law.js`` the
desired inverse. A function q = F(x) over a cell, a box of poses, gives one configuration for each
pose. The coordinates u of a pose go from −1 to 1 in the cell; a chart consists of polynomials in u,
whose coefficients describe F. A sector is a cell in cylindrical coordinates, numbered from 0:
radius, angle and height about an axis, two tilts of the tool, and its spin about its own z axis.
Its profile is the range of radius as a function of the height. n is the number of joints, r that of
directions of self-motion. The tool keeps its orientation; in a sector without spin, it turns with
the angle.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeGuard

import numpy as np

from ....motion import Motion
from ....show.page.own_loop import own_loop
from ..cell_design_result import CellDesign
from ..geometry.cell import Cell
from ..geometry.sector import HEIGHT, SPIN, Sector

_STEP = 128e-7
"""Resolution of the coefficients, rad or m, which the page's numbers represent without loss."""

_DIGITS = 9
_MOST_NUMBERS = 4000


def cell_loop(design: CellDesign, motions: Mapping[str, Motion]) -> dict[str, Any] | None:
    """Collect the numbers for the page, with the coefficients as the array ``weights``.

    The numbers describe the arm, the motions, and the chart of the function, by the keys that the
    page's scripts read. ``motions`` are motions along a sample path, by controller; the last is the
    function's. The result is None if the page cannot compute the motions: the tool tilts in the
    cell, the desired inverse is not J⁺, or the chart has more than 4000 coefficients.
    """
    chart = design.function.chart
    cell = chart.cell
    last = list(motions.values())[-1:]
    tilts = cell.widths[3:5].any() or (not isinstance(cell, Sector) and cell.widths[3:].any())
    if not last or tilts or chart.coefficients.size > _MOST_NUMBERS:
        return None
    numbers = own_loop(last[0], [design.desired] * (len(motions) - 1))
    if numbers is None or len(design.task.frames) > 1:
        return None
    part = _described(design)
    numbers["laws"].append([{"chart": part}])
    if _turns_along(cell):
        if numbers["frames"][0]["base"] is not None:
            return None
        numbers["turning"] = {"origin": cell.axis[0].tolist(), "direction": cell.axis[1].tolist()}
    weights = np.rint(chart.coefficients.reshape(1, -1) / _STEP) * _STEP
    return _rounded(numbers) | {"weights": weights}


def _turns_along(cell: Cell) -> TypeGuard[Sector]:
    """Test whether the tool turns with the angle: a sector for a pose task, without spin."""
    pose = cell.task.kind == "pose" and isinstance(cell, Sector)
    return pose and not cell.whole.widths[SPIN]


def _described(design: CellDesign) -> dict[str, Any]:
    """Return the chart of a cell's function as plain types, as ``potentials.js`` reads it.

    The keys ``n`` and ``r`` have the numbers of joints and of directions of self-motion. ``parent``
    and ``variable`` give the values of the monomials: monomial i is monomial ``parent[i]`` times
    ``u[variable[i]]``. ``moved`` has the indices of the coordinates that belong to u: indices in
    the sector or, in a box, among x, y and z. ``widths``, ``offset`` and ``bounds`` have, for each
    of these coordinates, the half-width, the offset, and the largest ``|u_i|`` that is accepted.
    ``removed`` describes the coordinates removed from u. ``middle`` is the position of the middle
    of a box, m. ``sector`` describes a sector; None for a box. The coefficients are not included.
    """
    chart, task = design.function.chart, design.task
    cell = chart.cell
    on = cell._active
    middle = np.zeros(3)
    if not isinstance(cell, Sector):
        middle = cell.placement.translation
    moved = np.flatnonzero(on)
    rows = moved if isinstance(cell, Sector) else np.asarray(task.rows)[moved]
    return {
        "n": task.n,
        "r": task.r,
        "parent": chart.monomials.parent.tolist(),
        "variable": chart.monomials.variable.tolist(),
        "moved": rows.tolist(),
        "widths": cell.widths[on].tolist(),
        "offset": cell._offset[on].tolist(),
        "bounds": cell._bounds.tolist(),
        "removed": _removed(cell),
        "middle": middle.tolist(),
        "sector": _sector(cell) if isinstance(cell, Sector) else None,
    }


def _removed(cell: Cell) -> list[dict[str, Any]]:
    """Describe the coordinates that symmetries of the arm remove from u, one dictionary for each.

    The keys are ``i``, the index of the coordinate in the sector; ``joint``, the index of the joint
    that alone moves the frame along it; ``sign``, 1 or −1, the change of the coordinate per rad of
    the joint; and ``most``, the half-width of the range, rad, or None if joint limits alone end the
    range. Indices count from 0. The list is empty for a box.
    """
    return [
        {
            "i": one.coordinate,
            "joint": one.joint,
            "sign": one.sign,
            "most": None if one.coordinate in cell.free else float(cell.widths[one.coordinate]),
        }
        for one in cell.removed
    ]


def _sector(cell: Sector) -> dict[str, Any]:
    """Describe the cylindrical coordinates of a sector by the keys that the page's scripts read.

    ``origin`` is a point of the axis, m; ``axes`` are the outward, tangential and axial unit
    vectors at the middle, as rows; ``radius`` and ``height`` are the radius and the height of the
    middle, m. ``half`` is the half-width of the height, m; 0 in a planar task. ``bend`` and
    ``stretch`` are the coefficients of the profile. ``tool`` has the x and y axes of the tool in
    the middle, as rows. ``spinMiddle`` is the middle of the spin, rad, or None without a spin.
    Vectors are in base axes.
    """
    radius, height = cell.middle
    whole = cell.whole
    spins = cell.task.kind == "pose" and bool(whole.widths[SPIN])
    return {
        "origin": cell.axis[0].tolist(),
        "axes": cell.directions.tolist(),
        "radius": radius,
        "height": height,
        "half": float(whole.widths[HEIGHT]) if cell.task.m > 2 else 0.0,
        "bend": cell.profile.bend.tolist(),
        "stretch": cell.profile.stretch.tolist(),
        "tool": cell.placement.rotation.T[:2].tolist(),
        "spinMiddle": cell.spin_middle if spins else None,
    }


def _rounded(value: Any) -> Any:
    """Round all numbers to 9 decimals, 1e-9 m or rad."""
    if isinstance(value, float):
        return round(value, _DIGITS)
    if isinstance(value, dict):
        return {name: _rounded(one) for name, one in value.items()}
    return [_rounded(one) for one in value] if isinstance(value, list) else value
