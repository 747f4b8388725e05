"""Sectors between nodes of a table, around the axis of the joint that turns the whole arm.

A table is a grid of radius and height around the arm, at the angle 0. A sector is a cell around the
arm, with a range of radius, angle and height. The spin of a sector is the rotation of the tool
about its own z axis. Symmetries are the joints that alone turn the whole arm, or the tool; ``line``
(2, 3) is the axis of the joint that turns the arm: a point, m, and a direction. A node is a pair of
indices (radius, height). n is the number of joints, K that of configurations.

``Table`` is a grid of poses (nodes) over radius and height around an axis, at the angle 0 and one
orientation. ``Symmetry`` is a joint that changes only one coordinate of the frame: the indices of
both, and the sign, 1 or −1, of the change. ``Between`` is a set of nodes between two polynomials of
the height: its area, first and last height, and both polynomials.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ....base.arguments import Array
from ....base.errors import InputError
from ....model.task import Task
from ..fit.trimming import turned
from ..geometry.cell import Cell
from ..geometry.cell_arguments import VERTICAL
from ..geometry.symmetry import NEAR, Symmetry, axis_symmetry, difference, own_axis, tool_symmetry
from .flood import Table
from .largest_profile import Between
from .priced_sides import whole_sector


def central(
    task: Task, symmetries: tuple[Symmetry, ...], q: Array, angle: float | None = None
) -> tuple[Array, tuple[float, float]]:
    """Turn the arm, then the tool, such that the joints that turn them are in mid-range.

    If an ``angle``, rad, is given, the arm is turned by this angle instead, and only the tool to
    mid-range. Return the configuration (n,) after both turns, and two angles, rad: by which the
    frame was turned about the arm's axis, and the tool about its own axis.
    """
    q, turns = q.copy(), [0.0, 0.0]
    if angle is not None:
        q, turns[0] = turned(task, q[None], symmetries[0], angle)[0], angle
    for k, one in list(enumerate(symmetries))[angle is not None :]:
        low, high = task.lower[one.joint], task.upper[one.joint]
        if np.isfinite(low) and np.isfinite(high):
            turns[k] = float(one.sign * ((low + high) / 2 - q[one.joint]))
            q[one.joint] = (low + high) / 2
    return q, (turns[0], turns[1])


def axis_and_symmetries(task: Task) -> tuple[Array, tuple[Symmetry, ...]]:
    """Find the vertical axis (2, 3) about which a joint turns the whole arm, and the symmetries.

    The symmetries are that of the arm and, in a pose task whose tool a joint turns, that of the
    tool.

    Raises
    ------
    InputError
        If there is no such axis, or if it is tilted.
    """
    line = own_axis(task)
    name = task.robot.name
    if line is None:
        first = task.joint_names[0]
        raise InputError(
            f"no joint of {name} turns the whole arm about a fixed axis, so there is no sector "
            "around the arm",
            remedy=f"lock the joint {first!r}, or give the size of a box of poses instead",
        )
    if difference(line, VERTICAL)[0] > NEAR:
        tilt = np.degrees(difference(line, VERTICAL)[0])
        raise InputError(
            f"the axis about which {name} turns is tilted by {tilt:.0f}° from the vertical, so the "
            "tool cannot keep its orientation around the arm",
            remedy="give the size of a box",
        )
    around = axis_symmetry(task, line)
    assert around is not None, "own_axis tested it"
    about = tool_symmetry(task) if task.kind == "pose" else None
    return line, (around,) if about is None else (around, about)


def sector_between(
    table: Table,
    line: Array,
    symmetries: tuple[Symmetry, ...],
    first: NDArray[np.intp],
    last: NDArray[np.intp],
    turns: tuple[float, float] = (0.0, 0.0),
    found: Between | None = None,
) -> Cell:
    """Make the sector between the nodes ``first`` and ``last``; its angle has the range "all".

    If a joint turns the tool, the range of the spin is "all", too. The middle of the sector is
    turned by two angles, ``turns``, rad: about the arm's axis, and about the tool's approach axis.
    With ``found``, the range of radius is that between its polynomials, not that of the nodes.
    """
    low = np.array([table.radii[first[0]], table.heights[first[1]]])
    high = np.array([table.radii[last[0]], table.heights[last[1]]])
    (rho, z), half = (low + high) / 2, (high - low) / 2
    around = pin.exp3(turns[0] * table.up)
    p = table.origin + around @ (rho * table.outward) + z * table.up
    R = around @ table.rotation @ pin.exp3(np.array([0.0, 0.0, turns[1]]))
    radius = float(half[0]) if found is None else found.sides(table.radii[0], table.spacing)
    return whole_sector(table.task, pin.SE3(R, p), radius, float(half[1]), line, symmetries)


def widest_sector(table: Table, line: Array, symmetries: tuple[Symmetry, ...]) -> Cell:
    """Make the sector between the outermost nodes of a table."""
    return sector_between(table, line, symmetries, np.zeros(2, int), np.array(table.shape) - 1)


def shaped_sector(
    table: Table,
    line: Array,
    symmetries: tuple[Symmetry, ...],
    found: Between,
    turns: tuple[float, float],
) -> Cell:
    """Make the sector between two polynomials of the height.

    Its middle is turned by two angles, ``turns``, rad: about the arm's axis, and about the tool's z
    axis. If both angles are 0, the orientation is that of the table.
    """
    first, last = (np.array([0, j]) for j in (found.first, found.last))
    return sector_between(table, line, symmetries, first, last, turns, found)
