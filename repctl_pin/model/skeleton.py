"""Shapes that are drawn in place of links without meshes.

Links are drawn as tubes, revolute joints as cylinders, and prismatic joints as sliders on rails.

``Mechanism`` is the movable joints of a robot and their limits. ``Joint`` is a joint of a URDF as
plain data: its kind, links, axis, limits and mimic.
"""

from __future__ import annotations

from collections.abc import Container, Iterator

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..base.arguments import Array
from .mechanism import Mechanism
from .model import frame_placements, link_ids
from .shapes import Color, Shape
from .urdf import Joint

_TUBE: Color = (0.72, 0.75, 0.79, 1.0)
_JOINT: Color = (0.25, 0.28, 0.33, 1.0)
"""Colours of the tubes, and of the shapes of joints."""


def skeleton(
    robot: Mechanism, links: dict[str, pin.Frame], draw: Container[str]
) -> Iterator[tuple[Shape, pin.SE3]]:
    """Yield the tubes and joint shapes that are drawn in place of the links ``draw``, by name.

    ``links`` are the link frames of the robot's model, by name.
    """
    thick = 0.02 * (_extent(robot) or 1.0)
    for joint in robot.description.joints:
        place = _joint_origin(robot.model, links, joint)
        length = float(np.linalg.norm(place.translation))
        if joint.parent in draw and length > thick:
            size = thick, length
            tube = Shape(f"{joint.name}_tube", joint.parent, "capsule", size, _TUBE)
            yield tube, pin.SE3(_turn_z_to(place.translation), place.translation / 2)
        if joint.child in draw and joint.kind != "fixed":
            yield from _joint_bones(joint, place, thick, joint.parent in draw)


def _joint_bones(
    joint: Joint, place: pin.SE3, thick: float, rail: bool
) -> Iterator[tuple[Shape, pin.SE3]]:
    """Yield the shapes of a joint: a cylinder if it is revolute, else a slider and its rail.

    ``place`` is the joint's origin in its parent link, and ``thick`` the radius of tubes, m. If
    ``rail`` is False, the rail, which belongs to the parent link, is left out.
    """
    name = joint.name
    along = pin.SE3(_turn_z_to(joint.axis), np.zeros(3))
    if joint.kind != "prismatic":
        size: tuple[float, ...] = (1.7 * thick, 4.4 * thick)
        yield Shape(f"{name}_joint", joint.child, "cylinder", size, _JOINT), along
        return
    size = (3.4 * thick, 3.4 * thick, 5 * thick)
    reach = 50 * thick
    yield Shape(f"{name}_slider", joint.child, "box", size, _JOINT), along
    low = max(joint.lower, -reach)
    high = min(joint.upper, reach)
    if rail and high > low:
        middle = place * pin.SE3(np.eye(3), (low + high) / 2 * np.array(joint.axis)) * along
        size = 0.8 * thick, high - low
        yield Shape(f"{name}_rail", joint.parent, "cylinder", size, _TUBE), middle


def _joint_origin(model: pin.Model, links: dict[str, pin.Frame], joint: Joint) -> pin.SE3:
    """Compute the placement of a joint's origin in the frame of its parent link.

    ``links`` are the link frames of the model, by name. The origin of a fixed or locked joint,
    which the model does not contain, is that of its child link.
    """
    parent = links[joint.parent]
    child = links[joint.child]
    if child.parentJoint == parent.parentJoint:  # fixed joint, or locked at the reference pose
        return parent.placement.inverse() * child.placement
    return parent.placement.inverse() * model.jointPlacements[child.parentJoint]


def _extent(robot: Mechanism) -> float:
    """Compute the size of a robot, m: the diagonal of the box around its link origins.

    The robot is at the reference pose.
    """
    q = robot.coupling.joints(robot.reference)
    placed = frame_placements(robot.model, link_ids(robot.model).values(), q[None])
    return float(np.linalg.norm(np.ptp(placed[0, :, :3, 3], axis=0)))


def _turn_z_to(direction: ArrayLike) -> Array:
    """Compute a rotation matrix (3, 3) that maps the z axis to the direction of a vector (3,)."""
    z = np.asarray(direction, float) / np.linalg.norm(direction)
    if z[2] < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    return pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), z).matrix()
