"""Detection of a robot that was changed after a file was saved, beyond the placements of its frame.

Everything that a number of the file depends on is compared: joint limits, the speed limits that the
period of a cycle keeps, the frames of arm angles, masses, and collision bodies.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from ..arguments import Array
from ..errors import InputError
from ..model.task import Task
from ..model.task_parts import points_at
from .schema import (
    ArmAngleFile,
    BasisFile,
    Desired,
    JoinedFile,
    JointRange,
    TaskFile,
    WeightedFile,
)

_TOLERANCE = 1e-9
"""Largest difference of an unchanged number, m, rad, or relative for masses."""


def ranges_of(task: Task) -> list[JointRange]:
    """Convert the limits of a task's joints to their part of a file."""
    rows = np.transpose(task.joint_limits).tolist()
    return [JointRange(*(v if np.isfinite(v) else None for v in row)) for row in rows]


def require_ranges(made_for: TaskFile, task: Task, *, speeds: bool) -> list[str]:
    """Check that the joint limits are those of the file, with ``speeds`` the speed limits too.

    Returns what is not checked, because an older file does not hold it: a list of names, which is
    empty otherwise. Raises an InputError that names the joint if a limit differs.
    """
    ranges = made_for.limits
    if isinstance(ranges, msgspec.UnsetType):
        return ["the joint limits"]
    if len(ranges) != task.n:
        raise InputError(f"the file has limits of {len(ranges)} joints, not {task.n}")
    now = ranges_of(task)
    for name, before, after in zip(task.robot_joints, ranges, now, strict=True):
        bounds = [(one.lower, one.upper) for one in (before, after)]
        if _differ(*bounds):
            was, is_ = (f"[{_text(low)}, {_text(high)}]" for low, high in bounds)
            raise _changed(made_for, f"the limits of {name!r} were {was} and are {is_}")
        if speeds and _differ([before.velocity], [after.velocity]):
            was, is_ = _text(before.velocity), _text(after.velocity)
            raise _changed(
                made_for, f"the speed limit of {name!r} was {was} and is {is_}"
            )
    return []


def require_arm_angles(basis: BasisFile, made_for: TaskFile, task: Task) -> list[str]:
    """Check that the frames of arm angles are where they were; as :func:`require_ranges`."""
    if isinstance(basis, JoinedFile):
        parts = [require_arm_angles(part, made_for, task) for part in basis.parts]
        return [name for names in parts for name in names]
    if not isinstance(basis, ArmAngleFile):
        return []
    if isinstance(basis.points, msgspec.UnsetType):
        return ["the frames of the arm angle"]
    now = points_at(task, basis.frames, configurations(made_for))
    shifts = np.abs(now - _like(basis.points, now, "an arm angle")).max(axis=(0, 2))
    for name, shift in zip(basis.frames, shifts, strict=True):
        if not shift < _TOLERANCE:
            raise _changed(
                made_for,
                f"at its check configurations the frame {name!r} lies {shift:.3g} m elsewhere",
            )
    return []


def require_masses(desired: Desired, made_for: TaskFile, task: Task) -> list[str]:
    """Check that the inertia, if it is a weight, is what it was; as :func:`require_ranges`."""
    if not isinstance(desired, WeightedFile) or desired.weight != "inertia":
        return []
    if isinstance(desired.inertia, msgspec.UnsetType):
        return ["the masses"]
    now = task.inertias(configurations(made_for))
    away = np.abs(now - _like(desired.inertia, now, "the inertia")).max()
    if not away < _TOLERANCE * np.abs(now).max():
        raise _changed(
            made_for,
            f"at its check configurations the inertia differs by {away:.3g} kg m² or kg",
        )
    return []


def configurations(made_for: TaskFile) -> Array:
    """Return the check configurations of a file: (K, n)."""
    return np.array([check.q for check in made_for.fingerprint])


def _differ(one: Sequence[float | None], other: Sequence[float | None]) -> bool:
    """Test whether limits differ; null stands for none."""
    pairs = zip(one, other, strict=True)
    return any(
        (a is None) != (b is None)
        or (a is not None and b is not None and not abs(a - b) < _TOLERANCE)
        for a, b in pairs
    )


def _like(rows: list[list[list[float]]], now: Array, what: str) -> Array:
    """Convert numbers of a file to an array of the same shape as ``now``."""
    try:
        before = np.array(rows, float)
    except ValueError:
        before = np.empty(0)
    if before.shape != now.shape:
        raise InputError(f"the file has a damaged fingerprint of {what}; design again")
    return before


def _text(limit: float | None) -> str:
    return "none" if limit is None else f"{limit:.9g}"


def _changed(made_for: TaskFile, what: str) -> InputError:
    return InputError(
        f"the file is for another {made_for.robot}: {what}; "
        "the URDF has changed, so design again"
    )
