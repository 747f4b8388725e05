"""New sides of a sector, between which the joint speed of a function meets its limits.

A sector is a cell, a set of poses, in cylindrical coordinates around the arm. Its sides are its
smallest and its largest radius, which are polynomials of the height. A function over a large sector
can be too fast in a part of it. The sector then gets new sides, between which the joint speed of
the function meets the limits, and another function is designed for this smaller sector. There, the
new function has less joint speed than the first one. So the first new sides are chosen with limits
that are 1.6 times as high. Moving the ends of the sector's ranges inward instead would lose more of
the sector.

``CellFit`` holds the arguments of a design over a cell, and the methods that compute the design.
``Required`` holds the limits of a function: mean and maximum extra joint speed relative to J⁺ (0.05
is 5 %), and body distance, m.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress

import numpy as np
import pinocchio as pin

from ....base.arguments import Array
from ....base.errors import InputError
from ....model.task import Task
from ....strategies import Pseudoinverse
from ..cell_design_result import CellDesign
from ..evaluate.cell_evaluation import sampled
from ..evaluate.margins import CandidateFunction
from ..evaluate.symmetric_coordinates import reduced
from ..fit.cell_fit import CellFit
from ..fit.trimming import Required, kept_where_good
from ..geometry.cell import Cell
from ..geometry.cell_arguments import Angle
from ..geometry.sector import HEIGHT, SPIN, Sector
from ..geometry.symmetry import Symmetry
from ..place.posture_search import given
from .joint_speeds import least_speeds
from .largest_profile import SMOOTH, SPARE, affordable_between

_RADII, _HEIGHTS = 33, 31
"""Numbers of nodes in a sector, along the radius and the height."""

_SLACKS = (1.6, 1.0, 1.0)
"""Limits of joint speed for the sides, relative to those of the function, one round after the
other."""

_HOPELESS = 2.0
"""Mean extra joint speed of a function over such a part, relative to its limit, above which no
further sides are tried."""


def by_price(
    fit: CellFit, quick: CellDesign, limits: Required, useful: Callable[[Cell], bool]
) -> CellDesign | None:
    """Design a function for a part of a sector, such that its joint speed meets the limits.

    ``quick`` is a quick design over the sector. The sides of the part are polynomials of the height
    of degree 4 at most. They are first chosen by the joint speeds of ``quick``, with limits 1.6
    times as high, and a function of full accuracy is designed for the part. If this function
    exceeds ``limits``, sides are chosen by its joint speeds, and a function is designed again, at
    most twice. Where the last function fails or exceeds ``limits``, its sector is cut. Return None
    if a part is not ``useful``, if a design fails, or if its mean extra joint speed exceeds twice
    the limit.
    """
    found = quick
    for slack in _SLACKS:
        part = _affordable_part(fit, found, limits, slack)
        if part is None or not useful(part[0]):
            return None
        with suppress(InputError):
            design = fit.design(part[0], given(*part), rough=True)
            if not isinstance(design, CellDesign) or design.extra_speed > _HOPELESS * limits.mean:
                return None
            found = design
            if found.extra_speed < limits.mean and found.extra_speed_worst < limits.worst:
                break
    return None if found is quick else kept_where_good(fit, found, limits, useful)


def _affordable_part(
    fit: CellFit, found: CellDesign, limits: Required, slack: float
) -> tuple[Sector, Array] | None:
    """Find the largest part of a design's sector in which its function meets speed limits.

    The limits are multiplied by ``slack``. Return the part, whose sides are polynomials of the
    height of degree 4 at most, and a configuration (n,) in its middle; None if there is no part.
    """
    chart = found.function.chart
    cell = chart.cell
    assert isinstance(cell, Sector), "a table is a sector"
    # a grid in coordinates of the sector, so that nodes lie on its sides
    shape = _RADII, _HEIGHTS
    u, v = np.linspace(-1, 1, _RADII), np.linspace(-1, 1, _HEIGHTS)
    U = np.column_stack([u.repeat(_HEIGHTS), np.tile(v, _RADII)])
    at = sampled(fit.desired, CandidateFunction.zero(chart), U, directions=False)
    usual = np.full(len(U), np.nan)
    usual[at.covered] = least_speeds(cell, at.Q[at.covered])[1]
    own, usual = (usual * at.ratio).reshape(shape), usual.reshape(shape)
    # radii in units of the spacing of the heights
    half, rho_and_z = cell.widths[HEIGHT], cell.middle
    heights = rho_and_z[1] + half * v
    spacing = 2 * half / (_HEIGHTS - 1)
    low, high = cell.radii(heights).T / spacing
    radii = low + (high - low) * (1 + u[:, None]) / 2
    looser = limits._replace(mean=slack * limits.mean, worst=slack / SPARE * limits.worst)
    between = affordable_between(
        at.covered.reshape(shape), own, usual, looser, degree=SMOOTH, radii=radii
    )
    if not between.area:
        return None
    # the sector between the polynomials, and the configuration nearest to its middle
    low, high = between.sides(0.0, spacing)
    j = (between.first + between.last) // 2
    i = int(np.abs(radii[:, j] - (between.low[0] + between.high[0]) / 2).argmin())
    z = (heights[between.first] + heights[between.last]) / 2
    p = cell.axis[0] + (low[0] + high[0]) / 2 * cell.directions[0] + z * cell.axis[1]
    part = whole_sector(
        cell.task,
        pin.SE3(cell.placement.rotation, p),
        (low, high),
        float(heights[between.last] - z),
        cell.axis,
        cell.symmetries,
    )
    return part, at.Q.reshape(*shape, -1)[i, j]


def whole_sector(
    task: Task,
    middle: pin.SE3,
    radius: float | tuple[Array, Array],
    height: float,
    axis: Array,
    symmetries: Sequence[Symmetry],
) -> Sector:
    """Make a sector with the range "all" of the angle and, if a joint turns the tool, of the spin.

    ``radius`` and ``height`` are half-widths, m, around the pose ``middle``; ``radius`` can be two
    polynomials of the height, see :class:`.Sector`. ``axis`` (2, 3) is the axis of the arm.
    Coordinates along which a symmetry moves the frame are removed from u.
    """
    spin: Angle = "all" if any(one.coordinate == SPIN for one in symmetries) else 0.0
    sector = Sector(task, middle, radius=radius, height=height, angle="all", spin=spin, axis=axis)
    part = reduced(sector, Pseudoinverse(task))
    assert isinstance(part, Sector), "reduced keeps the kind"
    return part
