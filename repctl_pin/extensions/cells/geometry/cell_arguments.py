"""Validation and conversion of the arguments of cells and sectors.

A cell is a box of poses, a sector a cell in cylindrical coordinates: radius, angle and height about
an axis, two tilts of the tool, and its spin. Their arguments are the middle, half-widths, an axis,
and placements. Invalid values raise an InputError that names the argument. An axis, or line, (2, 3)
is a point, m, and a unit direction, in base axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ....base.arguments import Array, as_numbers, require_choice, shown
from ....base.errors import InputError
from ....model.chain_formulas import require_rotation
from ....model.task import Task
from .symmetry import NEAR, axis_symmetry, difference, difference_words, last_axis, own_axis

LEAST_WIDTH, _MOST_WIDTH = 1e-6, 1e3
"""Smallest and largest half-width, m or rad, of a coordinate whose half-width is not 0."""

VERTICAL = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""The base's z axis: a point, m, and its direction."""

Angle = float | Literal["all"]


def stacked(task: Task, placements: Sequence[pin.SE3], name: str) -> tuple[Array, Array]:
    """Convert placements to arrays of positions (K, 3) and rotation matrices (K, 3, 3).

    Rotations are checked if the task commands a rotation. Error messages refer to a placement by
    ``name`` and its index, from 0, such as "target 3".
    """
    p = np.array([x.translation for x in placements]).reshape(-1, 3)
    R = np.array([x.rotation for x in placements]).reshape(-1, 3, 3)
    if task.kind in ("pose", "axis"):
        for i, one in enumerate(R):
            require_rotation(one, f"{name} {i}" if len(R) > 1 else f"the {name}")
    return p, R


def as_middle(task: Task, value: pin.SE3 | ArrayLike) -> pin.SE3:
    """Convert the argument ``placement`` of a cell, which is its middle, to a rigid transform.

    A rigid transform, a matrix (4, 4), or a position (3,), m, are accepted; a position gets the
    orientation of the task's reference. Other values raise an InputError.
    """
    array = value.homogeneous if isinstance(value, pin.SE3) else as_numbers(value)
    if array is not None and array.shape == (3,):
        middle = pin.SE3(task.placement(task.reference).rotation, array)
    elif array is not None and array.shape == (4, 4):
        middle = pin.SE3(array)
    else:
        raise InputError(
            "a cell's placement must be a pinocchio.SE3, a 4 × 4 matrix or a position (3,), m; "
            f"got {shown(value)}"
        )
    if not np.isfinite(middle.homogeneous).all():
        raise InputError("a cell's placement must be finite numbers")
    require_rotation(middle.rotation, "a cell's placement")
    return middle


def sizes(value: ArrayLike, size: int, name: str, unit: str, each: str) -> Array:
    """Convert half-widths, given as one number or one per coordinate, to an array (size,).

    Each must be 0, which holds the coordinate constant, or from 1e-6 to 1000, in ``unit``; else an
    InputError is raised. The ``name`` of the argument, ``unit`` ("m" or "rad") and ``each`` (such
    as "one per axis") are for the message of the error.
    """
    try:
        array = np.broadcast_to(np.asarray(value, float), (size,)).copy()
    except (TypeError, ValueError, OverflowError):
        many = f" or {size}" if size > 1 else ""
        raise InputError(
            f"must be one number in {unit}{many}, {each}; got {shown(value)}", argument=name
        ) from None
    if not (np.isfinite(array).all() and (array >= 0).all()):
        raise InputError(f"must be 0 {unit} or more; got {value!r}", argument=name)
    wrong = (array > 0) & ((array < LEAST_WIDTH) | (array > _MOST_WIDTH))
    if wrong.any():
        between = f"from {LEAST_WIDTH:g} to {_MOST_WIDTH:g} {unit}"
        raise InputError(
            f"must be 0, which holds the coordinate constant, or {between}; "
            f"got {array[wrong][0]:g}",
            argument=name,
        )
    return array


def of_positions(task: Task, value: ArrayLike, name: str) -> Array:
    """Convert lengths, m, to an array with one per position that the task commands, at most three.

    A single number is used for all positions. ``name`` is the argument's name in error messages.
    """
    each = "one per position that the task commands"
    return sizes(value, min(3, task.m), name, "m", each)


def as_axis(task: Task, axis: ArrayLike | None) -> Array:
    """Convert the argument ``axis`` of a sector to a point, m, and a unit direction: (2, 3).

    None stands for the base's z axis, with one exception. If a joint turns the whole arm about an
    axis that differs from the base's z axis by at most 2e-3 rad and m, None stands for the axis of
    this joint, about which the arm is exactly symmetric. An InputError is raised if the axis is not
    normal to the plane of a planar task.
    """
    if axis is None and task.m > 2 and axis_symmetry(task, VERTICAL) is None:
        own = own_axis(task)
        if own is not None and max(difference(own, VERTICAL)) <= NEAR:
            return own
    line = as_numbers(VERTICAL if axis is None else axis)
    if line is None or line.shape != (2, 3) or not np.isfinite(line).all() or not line[1].any():
        raise InputError(
            f"must be a point, m, and a direction, (2, 3) numbers; got {shown(axis)}",
            argument="axis",
        )
    line = np.stack([line[0], line[1] / np.linalg.norm(line[1])])
    if task.m == 2:
        across = next(i for i in range(3) if i not in task.rows)
        if abs(line[1][across]) < 1 - 1e-12:
            raise InputError(
                f"of a sector for the {task.kind} task must be along {'xyz'[across]}, "
                "normal to its plane",
                argument="axis",
            )
    return line


def as_half_width(value: Any, name: str, unit: str) -> float:
    """Check one half-width, 0 or from 1e-6 to 1000, and return it as float.

    Error messages name the argument by ``name``, and its unit by ``unit``, "m" or "rad".
    """
    return float(sizes(value, 1, name, unit, "half of the whole width")[0])


def as_height(task: Task, height: float) -> float:
    """Check the half-width of a sector's height, m, and return it; 0 for a planar task.

    For a planar task, any other value raises an InputError, because the task does not command the
    height.
    """
    height = as_half_width(height, "height", "m")
    if task.m == 2 and height:
        raise InputError(
            f": the {task.kind} task does not command the height",
            argument="height",
            remedy="omit it",
        )
    return height


def as_turn(angle: Angle, name: str) -> float:
    """Check the half-width of a sector's angle or spin, and return it, rad; ``"all"`` gives π.

    Error messages name the argument by ``name``, ``angle`` or ``spin``.
    """
    if isinstance(angle, str):
        require_choice(angle, ("all",), name)
        return np.pi
    half = as_half_width(angle, name, "rad")
    if half > np.pi:
        raise InputError(
            f"of ±{half:g} rad is more than a full turn; use at most π, or 'all'", argument=name
        )
    return half


def as_tilts(task: Task, half_angle: ArrayLike) -> Array:
    """Check the argument ``half_angle`` of a sector: half-widths of the tilts of the tool, rad.

    Return an array (2,) for the tilts about the tool's x and y axes, or (3,) if the rotation about
    the tool's z axis is also given. A single number is used for both tilts.
    """
    array = as_numbers(half_angle)
    if task.m <= 3:
        if array is None or array.any():
            raise InputError(
                f": the {task.kind} task leaves the rotation free",
                argument="half_angle",
                remedy="omit it",
            )
        return np.zeros(2)
    third = array is not None and array.shape == (3,) and task.m > 5
    each = "one per axis of the tool: x, y"
    turns = sizes(half_angle, 3 if third else 2, "half_angle", "rad", each)
    if np.linalg.norm(turns[:2]) >= 0.95 * np.pi or (turns[2:] > np.pi).any():
        raise InputError(
            "reaches half a turn",
            argument="half_angle",
            remedy="keep √(x² + y²) of its tilts below 2.98 rad, and its third number at most π",
        )
    return turns


def no_spin(task: Task) -> InputError:
    """Make the error for a ``spin``, a rotation about the tool's z axis, that is not possible.

    Either the task leaves this rotation free, or half_angle already has a third number for it.
    """
    if task.kind == "pose":
        return InputError("spin and a third half_angle are mutually exclusive")
    return InputError(
        f": the {task.kind} task leaves the rotation about the tool free",
        argument="spin",
        remedy="omit it",
    )


def no_joint(task: Task, name: str, line: Array) -> InputError:
    """Make the error that no joint of the arm allows the range "all" of ``angle`` or ``spin``.

    ``name`` is ``angle`` or ``spin``. The range "all" requires a joint that alone moves the frame
    along the coordinate. For the angle, a joint may turn the whole arm about an axis other than
    ``line`` (2, 3), the axis of the sector. The message then states how far the two axes differ,
    and suggests the axis of the joint. For the spin, the message states how far the axis of the
    last joint, if revolute, differs from the tool's z axis.
    """
    what = {
        "angle": "turns the whole arm about the axis",
        "spin": "turns the tool about its z axis through the frame's origin",
    }
    fact = f"'all' requires a joint that {what[name]}, and {task.robot.name} has none"
    remedy, joint, off = "give it in rad", "", ""
    if name == "spin" and task.revolute[-1]:
        joint, axis = last_axis(task)
        off = difference_words(axis, VERTICAL)
    if name == "angle" and task.m > 2 and (own := own_axis(task)) is not None:
        turned = axis_symmetry(task, own)
        assert turned is not None  # own_axis tested it
        joint, off = task.joint_names[turned.joint], difference_words(own, line)
        point, direction = (", ".join(f"{x:.12g}" for x in row) for row in own)
        remedy += f", or choose the axis of {joint}, through ({point}) along ({direction})"
    fact += f": the axis of {joint} is {off}" if off else ""
    return InputError(fact, argument=name, remedy=remedy)
