"""Repeatable inverse as tables for C, for the governor and the torque law."""

from __future__ import annotations

from typing import Any

from ...errors import InputError
from ...native import MOST_JOINTS
from ...strategies.native_arm import native_arm
from ...strategies.repeatable import RepeatableInverse


def native_inverse(inverse: RepeatableInverse, by: str) -> Any:
    """Create the struct ARM of an inverse, with its region, which ``by`` requires.

    Raises
    ------
    InputError
        If C cannot hold the inverse; the message names the part.
    """
    task = inverse.task
    try:
        arm = native_arm(task, inverse.potentials, inverse.region)
    except TypeError as error:
        raise InputError(
            f"{by} requires a region that C can hold, which one of type {error} is not",
            remedy="use a box, a tube, a workspace box or a cell, or an inverse without a region",
        ) from None
    if arm is not None:
        return arm
    if task.n > MOST_JOINTS:
        raise InputError(
            f"{by} moves at most {MOST_JOINTS} joints; the task has {task.n}"
        )
    raise InputError(
        f"{by} requires potentials that C can hold, which those of type "
        f"{type(inverse.potentials).__name__} are not, because they are user-defined functions",
        remedy="use polynomials, Fourier series, or sums of them",
    )
