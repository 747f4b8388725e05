"""A robot drawn from its kinematics alone: links as tubes, joints as cylinders along their axes."""

from __future__ import annotations

from collections.abc import Container, Iterator

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import Array
from ..urdf.gate import Joint
from .mechanism import Mechanism

Color = tuple[float, float, float, float]
Bone = tuple[str, str, str, tuple[float, ...], Color, pin.SE3]
"""Name, kind, link it rides on, size, colour, placement in the link's frame."""

TUBE: Color = (0.72, 0.75, 0.79, 1.0)
JOINT: Color = (0.25, 0.28, 0.33, 1.0)


def skeleton(robot: Mechanism, links: dict[str, pin.Frame], draw: Container[str]) -> list[Bone]:
    """Make tubes and cylinders for some of a robot's links.

    Parameters
    ----------
    links
        The link frames of the robot's model.
    draw
        Names of the links to draw.
    """
    origins = {joint.child: _joint_origin(robot.model, links, joint) for joint in robot.description.joints}
    thick = 0.02 * (_extent(robot, links) or 1.0)
    bones: list[Bone] = []
    for joint in robot.description.joints:
        origin = origins[joint.child]
        if joint.parent in draw:
            length = float(np.linalg.norm(origin.translation))
            if length > thick:
                M = pin.SE3(_turn_z_to(origin.translation), origin.translation / 2)
                bones.append((f"{joint.name}_tube", "capsule", joint.parent, (thick, length), TUBE, M))
        if joint.child in draw and joint.kind != "fixed":
            bones += _joint_bones(joint, origin, thick, joint.parent in draw)
    return bones


def _joint_bones(joint: Joint, origin: pin.SE3, thick: float, rail: bool) -> Iterator[Bone]:
    """Draw a revolute joint as a cylinder along its axis, a prismatic one as a slider on a rail."""
    along = pin.SE3(_turn_z_to(joint.axis), np.zeros(3))
    if joint.kind != "prismatic":
        yield f"{joint.name}_joint", "cylinder", joint.child, (1.7 * thick, 4.4 * thick), JOINT, along
        return
    yield f"{joint.name}_slider", "box", joint.child, (3.4 * thick, 3.4 * thick, 5 * thick), JOINT, along
    reach = 50 * thick
    low, high = max(joint.lower, -reach), min(joint.upper, reach)
    if rail and high > low:
        middle = origin * pin.SE3(np.eye(3), (low + high) / 2 * np.array(joint.axis)) * along
        yield f"{joint.name}_rail", "cylinder", joint.parent, (0.8 * thick, high - low), TUBE, middle


def _joint_origin(model: pin.Model, links: dict[str, pin.Frame], joint: Joint) -> pin.SE3:
    """Place a joint's origin in its parent link's frame."""
    parent, child = links[joint.parent], links[joint.child]
    if child.parentJoint == parent.parentJoint:  # fixed, or locked at the reference pose
        return parent.placement.inverse() * child.placement
    return parent.placement.inverse() * model.jointPlacements[child.parentJoint]


def _extent(robot: Mechanism, links: dict[str, pin.Frame]) -> float:
    """The diagonal of the box round all link origins at the reference pose, m."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.coupling.joints(robot.reference))
    points = [(data.oMi[f.parentJoint] * f.placement).translation for f in links.values()]
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def _turn_z_to(direction: ArrayLike) -> Array:
    """Find a rotation that takes the z axis to a direction."""
    z = np.asarray(direction, float) / np.linalg.norm(direction)
    if z[2] < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    return pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), z).matrix()
