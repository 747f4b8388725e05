"""Ranges of a cell in words: rows of a table, and a phrase for a sentence.

A cell is a box of poses. A sector is a cell in cylindrical coordinates around an axis: radius,
angle and height, two tilts of the tool, and its spin about its own z axis. The range of angle or
spin can be ``"all"``: as far as the limits of the joint that alone changes it. Heights are measured
along the axis from the base. In the phrase, ends are rounded inward, so that the whole range that
it states belongs to the cell.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ....base.arguments import Array
from ....base.certificate import degrees_below
from ....model.task import Task
from ....model.tool import ToolTask
from .approach_axis import named_axis, tool_axis
from .cell import Cell
from .cell_arguments import VERTICAL
from .sector import HEIGHT, RADIUS, Sector
from .symmetry import NEAR, difference

_HEIGHTS = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Heights at which a range of radius is given, as coordinates u."""

_LARGEST_STEP = 0.01
"""Maximum step to which the phrase rounds a length, m; about a tenth of a range if that is less."""

_AHEAD = 0.9
"""Cosine between the middle of a sector and the base's x axis above which the rest of the turn is
called behind the base."""

_POINTS = (("down", (0, 0, -1)), ("up", (0, 0, 1)), ("along x of the base", (1, 0, 0)))
"""Directions of the tool that have a name, in axes of the base."""


def range_rows(cell: Cell) -> dict[str, str]:
    """Return the ranges of a cell as text, by name.

    A box has one row, ``cell``. A sector has the rows ``radius`` and ``height``, a row for each
    angle that is not constant, and, if the task commands a rotation, the direction of the frame's
    z axis as ``orientation``. A range of radius that depends on the height is given at five
    heights, one per line. The angle and the spin are left out if their range is ``"all"``, because
    the design reports them.
    """
    if not isinstance(cell, Sector):
        return {"cell": cell.size()}
    w = cell.widths
    rows = {"radius": _radius_row(cell)}
    if cell.task.m > 2:
        low, high = _heights(cell, np.array([-1.0, 1.0]))
        ends = _inward(low, high, 1e-3)
        rows["height"] = f"{ends} m above the base" if high > low else f"{ends} m"
    for i, name in enumerate(cell.coordinate_names):
        if i not in (RADIUS, HEIGHT, *cell.free) and w[i]:
            rows[name] = f"±{np.floor(1e3 * w[i] + 1e-6) / 1e3:g} rad"
    rows = {name: text.replace("-", "−") for name, text in rows.items()}
    if cell.task.kind.turns:
        where = _pointing(cell.placement.rotation[:, 2])
        rows["orientation"] = f"{_pointing_axis(cell.task)} {where}, turns with the angle"
    return rows


def range_phrase(
    cell: Cell, reaches: Mapping[str, float] | None = None, *, tool: str | None = None
) -> str:
    """Write what a cell covers, such as ``height 0.05 to 0.45 m, radius 0.35 to 0.70 m``.

    Parameters
    ----------
    cell
        The cell or sector.
    reaches
        Full widths, rad, of the ranges of ``angle`` and ``spin`` (the keys) in which their joints
        stay within the limits, as a design found them. A range of the cell that is wider is written
        with this width. With None, the ranges are those of the cell.
    tool
        Direction of the tool in the middle of a sector, such as ``down``. By default none is given.
    """
    if not isinstance(cell, Sector):
        return _box_phrase(cell)
    parts = [_radius_phrase(cell)]
    if cell.task.m > 2 and cell.widths[HEIGHT]:
        parts.insert(0, f"height {_inward(*_heights(cell, np.array([-1.0, 1.0])))} m")
    around = "around the base" if _is_upright(cell) else "around the axis"
    words = {"angle": f"{{}}° {around}", "spin": "the tool turned through {}°"}
    if tool:
        words["spin"] = f"tool {tool}, turned through {{}}°"
    turned = degrees_turned(cell, reaches)
    for name, turn in turned.items():
        parts.append(words.get(name, f"{{}}° of {name}").format(turn))
    if tool and "spin" not in turned:
        parts.append(f"tool {tool}")
    return ", ".join(parts)


def gap_phrase(sector: Sector, reaches: Mapping[str, float] | None = None) -> str:
    """Write what a sector leaves out, ``0.30 m around the base at height 0.25 m, 44° behind it``.

    The sector leaves out the poses nearer to the axis than its smallest radius, and the rest of a
    full turn beyond its angle. The text is empty if neither exists. ``reaches`` has the full width
    of the range of ``angle`` that a design found, rad; a wider range is replaced by this width.
    """
    parts, upright = [], _is_upright(sector)
    (low, high), at = _radii(sector)
    if high > low > 0:
        inner, _ = _rounded_inward(low, high)
        parts.append(f"{inner} m around {'the base' if upright else 'the axis'}{at}")
    turn = degrees_turned(sector, reaches).get("angle", 360)
    if turn < 360:
        ahead = upright and sector.directions[0][0] > _AHEAD
        behind = f"behind {'it' if parts else 'the base'}"
        parts.append(f"{360 - turn}° {behind if ahead else 'opposite the middle'}")
    return ", ".join(parts)


def tool_direction(sector: Sector) -> str | None:
    """Return ``down`` or ``up`` if the tool has this direction in the whole sector, else None.

    The direction is that of the frame's axis along which the tool points, found from the last joint
    and the fingers. The result is None if there is no such axis, if the tool tilts in the sector,
    or if the sector's axis is not vertical. In a ``ToolTask``, whose frame the user placed in a
    link, the z axis may be meant as the direction of the tool. So the result is then also None
    unless the axis found is z.
    """
    task, (tilt, _) = sector.task, difference(sector.axis, VERTICAL)
    if not task.kind.turns or sector.widths[3:5].any() or tilt > NEAR:
        return None
    found = tool_axis(task)
    if found is None or (isinstance(task, ToolTask) and found.axis != "z"):
        return None
    where = _pointing(sector.placement.rotation @ found.rotation[:, 2])
    return where if where in ("down", "up") else None


def _is_upright(sector: Sector) -> bool:
    """Test whether the axis of a sector is nearly the z axis of the base: within 2e-3 rad and m."""
    return max(difference(sector.axis, VERTICAL)) <= NEAR


def degrees_turned(sector: Sector, reaches: Mapping[str, float] | None = None) -> dict[str, int]:
    """Compute the full widths of the ranges of a sector's angle, tilts and spin, degrees, by name.

    The widths are rounded down to whole degrees, and at most 360. ``reaches`` are full widths, rad,
    that a design found, by the names ``angle`` and ``spin``; if the range of the sector is wider,
    the width in ``reaches`` is used instead. A coordinate that is constant is left out.
    """
    found = dict(reaches or {})
    widths = {
        name: 2 * sector.widths[i]
        for i, name in enumerate(sector.coordinate_names)
        if i not in (RADIUS, HEIGHT) and sector.widths[i]
    }
    turns = {name: min(width, found.get(name, width), 2 * np.pi) for name, width in widths.items()}
    return {name: int(degrees_below(turn)) for name, turn in turns.items()}


def _box_phrase(cell: Cell) -> str:
    """Write a box as ``0.2 × 0.2 × 0.2 m around (0.50, 0.00, 0.40) m, turned by up to 17°``."""
    edges = " × ".join(f"{2 * w:.3g}" for w in cell.half_width)
    middle = np.round(cell.placement.translation, 2) + 0.0
    text = f"{edges} m around ({', '.join(f'{v:.2f}' for v in middle)}) m".replace("-", "−")
    if not cell.rotation.any():
        return text + (", one orientation" if len(cell.rotation) else "")
    turns = [f"{degrees_below(w)}°" for w in cell.rotation]
    return f"{text}, turned by up to {turns[0] if len({*turns}) == 1 else ', '.join(turns)}"


def _radius_row(sector: Sector) -> str:
    """Write the range of radius, ``0.3 to 0.7 m``; if it depends on the height, at five heights."""
    rho, half = sector.middle[0], sector.widths[RADIUS]
    if not sector.profile.degree:
        return f"{_inward(rho - half, rho + half, 1e-3)} m"
    u = np.array(_HEIGHTS)
    ranges = sector.radii(sector.middle[1] + sector.widths[HEIGHT] * u)
    return "\n".join(
        f"{_inward(low, high, 1e-3)} m at the height {h:.3g} m"
        for (low, high), h in zip(ranges, _heights(sector, u), strict=True)
    )


def _radius_phrase(sector: Sector) -> str:
    """Write ``radius 0.30 to 0.70 m``: the range, or that at mid-height if the range varies."""
    radii, at = _radii(sector)
    return f"radius {_inward(*radii)} m{at}"


def _radii(sector: Sector) -> tuple[Array, str]:
    """Return the range of radius, m, and, if it varies, its height in words: ``at height 0.25 m``.

    The height is the middle one, rounded to 1 cm, if the sector is high enough.
    """
    if not sector.profile.degree:
        return sector.radii(sector.middle[1]), ""
    low, middle, high = _heights(sector, np.array([-1.0, 0.0, 1.0]))
    at = float(np.clip(np.round(middle, 2), low, high)) + 0.0
    radii = sector.radii(sector.middle[1] + at - middle)
    return radii, f" at height {at:.2f} m".replace("-", "−")


def _heights(sector: Sector, u: Array) -> Array:
    """Return heights (K,) above the base along the sector's axis, m.

    ``u`` (K,) is the coordinate of the height, from −1 at the lowest end to 1 at the highest.
    """
    origin, a = sector.axis
    return float(origin @ a) + sector.middle[1] + sector.widths[HEIGHT] * u


def _inward(low: float, high: float, most: float = _LARGEST_STEP) -> str:
    """Write a range, m, its ends rounded inward by steps of at most ``most``: ``0.35 to 0.70``."""
    return " to ".join(_rounded_inward(low, high, most)) if high > low else f"{low:.3g}"


def _rounded_inward(low: float, high: float, most: float = _LARGEST_STEP) -> tuple[str, str]:
    """Format both ends of a range, m, rounded inward: ``0.35`` and ``0.70``; ``low`` < ``high``.

    The step of the rounding is ``most``, by default 1 cm, and smaller for ranges below ten steps.
    """
    digits = int(-np.floor(np.log10(min(most, (high - low) / 10)) + 1e-9))
    step = 10.0**-digits
    ends = np.ceil(low / step - 1e-6) * step, np.floor(high / step + 1e-6) * step
    first, last = (f"{end + 0.0:.{digits}f}".replace("-", "−") for end in ends)
    return first, last


def _pointing_axis(task: Task) -> str:
    """Name the z axis of a task's frame: ``z axis of the frame``.

    The frame of a ``ToolTask`` is no link frame of the URDF. If its z axis is parallel to an axis
    of the link that carries the tool, that axis is named, such as ``-z axis of tool0``. Otherwise,
    the text is ``z axis of the tool``.
    """
    if not isinstance(task, ToolTask):
        return "z axis of the frame"
    direction = task.tool.rotation[:, 2]
    along = np.abs(direction).max() > 1 - 1e-6
    return f"{named_axis(direction)} axis of {task.link}" if along else "z axis of the tool"


def _pointing(direction: Array) -> str:
    """Write a direction (3,), base axes: ``down``, ``up``, or ``along x of the base``.

    Any other direction is written as numbers: ``along (0.6, 0, -0.8)``.
    """
    named = (name for name, axis in _POINTS if direction @ np.array(axis) > 1 - 1e-6)
    numbers = ", ".join(f"{v:.2g}" for v in np.round(direction, 3) + 0.0)
    return next(named, f"along ({numbers})")
