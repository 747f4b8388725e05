"""Validation and conversion of the arguments of a cell: middle, half-widths, placements."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...arguments import Array, as_numbers, shown
from ...errors import InputError
from ...model.chain_formulas import require_rotation
from ...model.task import Task

LEAST_WIDTH, _MOST_WIDTH = 1e-6, 1e3
"""Smallest and largest half-width, m or rad, of a coordinate whose half-width is not 0."""


def stacked(
    task: Task, placements: Sequence[pin.SE3], name: str
) -> tuple[Array, Array]:
    """Convert placements to arrays of positions (K, 3) and rotation matrices (K, 3, 3).

    The rotations are checked if the task commands a rotation. Error messages call a placement by
    ``name`` and its number, such as "target 3".
    """
    p = np.array([x.translation for x in placements]).reshape(-1, 3)
    R = np.array([x.rotation for x in placements]).reshape(-1, 3, 3)
    if task.kind in ("pose", "axis"):
        for i, one in enumerate(R):
            require_rotation(one, f"{name} {i}" if len(R) > 1 else f"the {name}")
    return p, R


def as_middle(task: Task, value: pin.SE3 | ArrayLike) -> pin.SE3:
    """Convert the argument ``placement`` of a cell, its middle, to a rigid transform."""
    array = value.homogeneous if isinstance(value, pin.SE3) else as_numbers(value)
    if array is not None and array.shape == (3,):
        middle = pin.SE3(task.placement(task.reference).rotation, array)
    elif array is not None and array.shape == (4, 4):
        middle = pin.SE3(array)
    else:
        raise InputError(
            "a cell's placement is a pinocchio.SE3, a 4 × 4 matrix or a position; "
            f"not {shown(value)}"
        )
    if not np.isfinite(middle.homogeneous).all():
        raise InputError("a cell's placement must be finite numbers")
    require_rotation(middle.rotation, "a cell's placement")
    return middle


def sizes(value: ArrayLike, size: int, name: str, unit: str, each: str) -> Array:
    """Convert half-widths, given as one number or one per coordinate, to an array (size,).

    ``name``, ``unit`` and ``each`` (such as "one per axis") serve the error messages.
    """
    try:
        array = np.broadcast_to(np.asarray(value, float), (size,)).copy()
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            f"must be one number in {unit} or {size}, {each}; got {shown(value)}",
            argument=name,
        ) from None
    if not (np.isfinite(array).all() and (array >= 0).all()):
        raise InputError(f"must be 0 {unit} or more; got {value!r}", argument=name)
    wrong = (array > 0) & ((array < LEAST_WIDTH) | (array > _MOST_WIDTH))
    if wrong.any():
        between = f"from {LEAST_WIDTH:g} to {_MOST_WIDTH:g} {unit}"
        raise InputError(
            f"must be 0, which holds the coordinate, or {between}; got {array[wrong][0]:g}",
            argument=name,
        )
    return array
