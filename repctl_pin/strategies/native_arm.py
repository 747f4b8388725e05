"""The struct Arm of arm.h: a task, potentials, limits and a design region as tables for C.

The native library, exported C code and their Python callers share this struct, so that all compute
the same.

``Potentials`` are r functions h(q) that a repeatable controller holds constant.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..model.joint_chain import native_chain
from ..model.task import Task
from ..native import REGION, filled_struct, library, point
from ..potentials.basis import Potentials, SumMap
from ..regions import Box, Tube, WorkspaceBox


def native_arm(task: Task, potentials: Potentials | None = None, region: Any = None) -> Any:
    """Create the struct :data:`ARM` of a task with potentials and a region Ω, for C.

    Potentials and region are left out if they are None. The struct points to arrays, and keeps them
    alive.

    Raises
    ------
    InputError
        If C cannot hold the task (more than 64 joints), the potentials (functions in Python) or the
        region.
    """
    made = native_chain(task)
    if made is None:
        raise InputError(
            f"{task!r} has more than 64 joints, the maximum of the code in C",
            remedy="lock the joints that it does not need, by lock= of Robot.load",
        )
    arm, _ = made
    if potentials is not None:
        parts = _native_parts(potentials)
        arm.parts = len(parts)
        point(arm, "part", parts)
    if region is not None:
        point(arm, "region", [_native_region(region, task)])
    return arm


def library_arm(task: Task, potentials: Potentials | None = None) -> Any | None:
    """Create the struct :data:`ARM`; None if there is no native library, or C cannot hold the task.

    With None the caller computes in NumPy. C supports up to 64 joints, and no Python functions.
    """
    if library() is None:
        return None
    try:
        return native_arm(task, potentials)
    except InputError:
        return None


def _native_parts(potentials: Any) -> list[Any]:
    """Create the structs :data:`PART` of the terms of a sum of potentials, one per term.

    A struct PART of arm.h has the coefficients of one polynomial or Fourier series. A term has a
    method ``_native_part`` that creates its own.

    Raises
    ------
    InputError
        If a term is a function in Python.
    """
    if isinstance(potentials, SumMap):
        return [made for part in potentials.maps for made in _native_parts(part)]
    if not hasattr(potentials, "_native_part"):
        raise InputError(
            f"potentials of type {type(potentials).__name__} cannot be written as C, because they "
            "contain Python functions; use polynomials, Fourier series or their sums"
        )
    return [potentials._native_part()]


def _native_region(region: Any, task: Task) -> Any:
    """Create the struct :data:`REGION`, by which C tests whether q lies in the region Ω.

    Boxes, tubes and workspace boxes are supported, and regions with a method ``_native_region``.
    InputError is raised for other types.
    """
    if isinstance(region, Tube):
        samples, half = region.samples, region.radius
    elif isinstance(region, Box):
        samples = region.center[None]
        half = region.half_width
    elif isinstance(region, WorkspaceBox):
        samples = region.within.center[None]
        half = region.within.half_width
    elif hasattr(region, "_native_region"):
        return region._native_region()
    else:
        raise InputError(
            f"a region of type {type(region).__name__} cannot be written as C; use a box, a tube "
            "or a workspace box, or an inverse without a region"
        )
    reals = {"center": samples, "half": half}
    axes: NDArray[np.intp] = np.zeros(0, int)
    if isinstance(region, WorkspaceBox):
        axes = task.kind.rows[task.kind.linear]
        reals |= {"position": region.position, "width": region.half_width}
    sizes = {"count": len(samples), "axes": len(axes)}
    return filled_struct(REGION, {"axis": axes}, reals, sizes)[0]
