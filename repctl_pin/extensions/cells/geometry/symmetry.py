r"""Detection of symmetries of an arm: one joint turns the whole arm, or the tool.

A sector is a cell in cylindrical coordinates: a box in radius, angle and height about an axis, two
tilts of the tool, and its spin. A joint that turns the whole arm about this axis changes only the
angle of the frame's pose; a joint that turns the tool about its own z axis, only the spin. So a
function F, which gives one configuration per pose, need not be designed along that coordinate. An
axis (2, 3) is a point, m, and a unit direction.

``Symmetry`` is a joint that changes only one coordinate of the frame: the indices of both, and the
sign, 1 or −1, of the change.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ....base.arguments import Array
from ....model.task import Task

_TOLERANCE = 1e-9
"""Maximum deviation from an exact symmetry, m or rad."""

_CONFIGURATIONS, _STEP = 6, 0.7
"""Number of random configurations at which a symmetry is tested, and the joint step of the test,
rad. An analytic identity that holds at random points holds everywhere."""

NEAR = 2e-3
"""Distance from the base's z axis, m and rad, up to which a sector turns about a joint's own axis
in place of it. URDFs write π with as few as two decimals: 3.14 is 1.6e-3 off."""


@dataclass(frozen=True)
class Symmetry:
    """A joint that changes only one coordinate of the frame in a sector, at every configuration.

    If the joint moves by s, rad, the coordinate increases by ``sign · s``. So F need not be
    designed along the coordinate: if this coordinate of a pose x increases by y, the configuration
    changes from F(x) to ``F(x) + sign · y e_j``, with e_j the unit vector of the joint.

    Attributes
    ----------
    coordinate : int
        Index of the sector's coordinate: 1 for the angle, 5 for the spin.
    joint : int
        Index j of the joint, counted from 0.
    sign : int
        1 or −1.
    """

    coordinate: int
    joint: int
    sign: int


def axis_symmetry(task: Task, axis: Array) -> Symmetry | None:
    """Find the joint that turns the whole arm about an axis (2, 3); None if there is none."""

    def turned(x: pin.SE3, angle: float) -> pin.SE3:
        R = pin.exp3(angle * axis[1])
        return pin.SE3(R @ x.rotation, axis[0] + R @ (x.translation - axis[0]))

    return _found(task, 1, range(task.n), turned)


def own_axis(task: Task) -> Array | None:
    """Find the axis (2, 3) of the joint that turns the whole arm; None if no joint does.

    The first row of the result is the point of the axis nearest to the base's origin, m; the second
    row is the direction, upward.
    """
    q = np.array(task.reference)
    origins, axes = task.joint_origins(q), task.axes(q)
    for joint in np.flatnonzero(task.revolute):
        direction = axes[joint] / np.linalg.norm(axes[joint])
        direction = -direction if direction[2] < 0 else direction
        point = origins[joint] - (origins[joint] @ direction) * direction
        line = np.stack([point, direction]) + 0.0  # no −0
        found = axis_symmetry(task, line)
        if found is not None and found.joint == joint:
            return line
    return None


def last_axis(task: Task) -> tuple[str, Array]:
    """Return the name of the last joint, and its axis (2, 3) in the axes of the task's frame.

    The first row of the axis is one of its points relative to the frame's origin, m; the second row
    is its direction. The axis is that at the reference configuration; if the joint is revolute, it
    is the same at all configurations. An error message compares it with the tool's z axis.
    """
    q = np.array(task.reference)
    x = task.placement(q)
    line = np.stack([task.joint_origins(q)[-1] - x.translation, task.axes(q)[-1]])
    return task.joint_names[-1], line @ x.rotation


def difference(one: Array, other: Array) -> tuple[float, float]:
    """Compute the angle between two axes (2, 3), rad, at most π/2, and their distance, m.

    The distance is the distance of the point in the first row of ``other`` from the axis ``one``.
    """
    (p, a), (o, b) = one, other
    tilt = np.arctan2(np.linalg.norm(np.cross(a, b)), abs(a @ b))
    return float(tilt), float(np.linalg.norm(np.cross(o - p, a)))


def difference_words(one: Array, other: Array) -> str:
    """Write how two axes (2, 3) differ: ``tilted by 0.1 rad and 0.02 m away``; empty if equal."""
    tilt, away = difference(one, other)
    parts = [f"tilted by {tilt:.2g} rad"] if tilt > _TOLERANCE else []
    parts += [f"{away:.2g} m away"] if away > _TOLERANCE else []
    return " and ".join(parts)


def tool_symmetry(task: Task) -> Symmetry | None:
    """Find the joint whose axis is the tool's z axis through the frame's origin, or None."""

    def turned(x: pin.SE3, angle: float) -> pin.SE3:
        return pin.SE3(x.rotation @ pin.exp3(np.array([0.0, 0.0, angle])), x.translation)

    return _found(task, 5, range(task.n)[::-1], turned)


def _found(
    task: Task, coordinate: int, joints: range, turned: Callable[[pin.SE3, float], pin.SE3]
) -> Symmetry | None:
    """Find the first of the ``joints`` that moves the frame as ``turned`` does, else None.

    ``joints`` are the indices to try. ``turned(x, angle)`` is the placement x with the coordinate
    number ``coordinate`` increased by an angle, rad. The placement after a step of the joint is
    compared with ``turned`` at a few random configurations.
    """
    rng = np.random.default_rng(0)
    Q = task.reference + rng.uniform(-1.0, 1.0, (_CONFIGURATIONS, task.n))
    before = [task.placement(q) for q in Q]
    for joint in joints:
        after = [task.placement(q + _STEP * np.eye(task.n)[joint]) for q in Q]
        for sign in (1, -1):
            pairs = zip(before, after, strict=True)
            if all(_away(task, turned(x, sign * _STEP), y) < _TOLERANCE for x, y in pairs):
                return Symmetry(coordinate, joint, sign)
    return None


def _away(task: Task, x: pin.SE3, y: pin.SE3) -> float:
    """Compute the largest difference of two placements in the entries that the task commands.

    Differences of positions are in m; those of rotations are between matrix entries.
    """
    e = [(x.translation - y.translation)[task.rows[: min(3, task.m)]]]
    if task.kind == "pose":
        e.append((x.rotation - y.rotation).ravel())
    elif task.kind == "axis":
        e.append(x.rotation[:, 2] - y.rotation[:, 2])
    return float(np.abs(np.concatenate(e)).max())
