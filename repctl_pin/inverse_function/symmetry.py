r"""Detection of symmetries of an arm: one joint turns the whole arm about an axis, or the tool
about its z axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..arguments import Array
from ..robot.task import Task

_TOLERANCE = 1e-9
"""Maximum deviation from an exact symmetry, m or rad."""

_CONFIGURATIONS, _STEP = 6, 0.7
"""Number of random configurations at which a symmetry is tested, and the joint step of the test,
rad. An analytic identity that holds at random points holds everywhere."""


@dataclass(frozen=True)
class Symmetry:
    """A joint that changes only one coordinate of the frame in a sector, at every configuration.

    The pose ``f(q + s e_j)`` is ``f(q)`` with that coordinate increased by ``sign · s``. So if the
    coordinate of a pose x is increased by y, its configuration is ``F(x) + sign · y e_j``.

    Attributes
    ----------
    coordinate : int
        Index of the coordinate: 1 for the angle, 5 for the spin.
    joint : int
        Index j of the joint, counted from 0.
    sign : int
        1 or −1.
    """

    coordinate: int
    joint: int
    sign: int


def axis_symmetry(task: Task, axis: Array) -> Symmetry | None:
    """Find the joint that turns the whole arm about an axis; None if there is none.

    The axis (2, 3) is a point, m, and a unit direction.
    """

    def turned(x: pin.SE3, angle: float) -> pin.SE3:
        R = pin.exp3(angle * axis[1])
        return pin.SE3(R @ x.rotation, axis[0] + R @ (x.translation - axis[0]))

    return _found(task, 1, range(task.n), turned)


def tool_symmetry(task: Task) -> Symmetry | None:
    """Find the joint whose axis is the tool's z axis through the frame's origin, or None."""

    def turned(x: pin.SE3, angle: float) -> pin.SE3:
        return pin.SE3(
            x.rotation @ pin.exp3(np.array([0.0, 0.0, angle])), x.translation
        )

    return _found(task, 5, range(task.n)[::-1], turned)


def _found(
    task: Task,
    coordinate: int,
    joints: range,
    turned: Callable[[pin.SE3, float], pin.SE3],
) -> Symmetry | None:
    rng = np.random.default_rng(0)
    Q = task.reference + rng.uniform(-1.0, 1.0, (_CONFIGURATIONS, task.n))
    before = [task.placement(q) for q in Q]
    for joint in joints:
        after = [task.placement(q + _STEP * np.eye(task.n)[joint]) for q in Q]
        for sign in (1, -1):
            pairs = zip(before, after, strict=True)
            if all(
                _away(task, turned(x, sign * _STEP), y) < _TOLERANCE for x, y in pairs
            ):
                return Symmetry(coordinate, joint, sign)
    return None


def _away(task: Task, x: pin.SE3, y: pin.SE3) -> float:
    """Compute the largest difference of two placements in the task's components, m or entries of
    the rotation matrix."""
    e = [(x.translation - y.translation)[task.rows[: min(3, task.m)]]]
    if task.kind == "pose":
        e.append((x.rotation - y.rotation).ravel())
    elif task.kind == "axis":
        e.append(x.rotation[:, 2] - y.rotation[:, 2])
    return float(np.abs(np.concatenate(e)).max())
