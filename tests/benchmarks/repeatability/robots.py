"""The arms of the benchmark, and each one as a bare chain: a URDF that every program can read."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pinocchio as pin

import repctl_pin as rp

ARMS = {
    "panda": "panda_hand_tcp",
    "xarm7": "link_eef",
    "gen3": None,
    "iiwa14": None,
    "tiago": "wrist_ft_tool_link",
    "baxter": "left_gripper",
}
"""Arm: the frame that moves; None where the kinematics are those that ssik ships."""

MORE = ("rizon4", "kr810", "openarm", "rm75", "yumi")
"""Arms of a table of their own; their kinematics, too, are those that ssik ships."""

OF_SSIK = {
    "panda": "franka_panda",
    "xarm7": "xarm7",
    "gen3": "gen3",
    "iiwa14": "iiwa14",
    "rizon4": "rizon4",
    "kr810": "kassow_kr810",
    "openarm": "openarm_right",
    "rm75": "rm75",
    "yumi": "yumi_right",
}
"""Arm: its name in ssik."""

STARTS = {
    "gen3": (0.0, 0.5, np.pi, -1.9, 0.0, 0.9, np.pi / 2),
    "iiwa14": (0.0, 0.6, 0.0, -1.4, 0.0, 1.1, 0.0),
    "tiago": (0.16, 0.64, -1.0, -1.15, 0.04, -0.09, -0.98, 0.6),
    "rizon4": (0.5, -0.9, -0.4, 1.2, 1.6, 0.9, 0.5),
    "kr810": (-1.3, 1.4, 1.3, 1.3, -1.3, -1.7, 0.0),
    "openarm": (-0.5, 0.8, -0.6, 1.8, 0.0, 0.2, 0.1),
    "rm75": (0.0, 0.3, 0.0, 1.5, 0.0, 0.9, 0.0),
    "yumi": (-0.5, -0.9, -1.7, 0.2, -0.2, 0.7, -1.9),
}
"""Where to begin where the reference pose will not do: from here J⁺ goes round every path inside
the limits once."""

Joint = tuple[str, pin.SE3, np.ndarray, bool, float, float, float]
"""Name, placement in the link before it, axis, does it turn, lower and upper limit, speed limit."""


def task_of(arm: str, folder: Path) -> rp.Task:
    """Load the pose task of an arm."""
    frame = ARMS.get(arm)
    if frame is not None:
        return rp.Robot.load(arm).task(frame, "pose")
    return chain_task(arm, *_ssik_joints(arm), folder)


def chain_task(name: str, joints: Iterable[Joint], tool: pin.SE3, folder: Path) -> rp.Task:
    """Load the pose task of a chain of joints."""
    path = folder / f"{name}_arm.urdf"
    path.write_text(_urdf(joints, tool), encoding="utf-8")
    return rp.Robot.load(path).task("tool", "pose")


def chain_urdf(task: rp.Task, folder: Path) -> Path:
    """Write the joints that a task moves, and nothing else, as a URDF from ``base`` to ``tool``."""
    model, limits = (task.model, zip(task.lower, task.upper, task.velocity_limit, strict=True))
    of = dict(zip(task.joint_names, limits, strict=True))
    joints = []
    for i in range(1, model.njoints):
        said = task.robot.joints[model.names[i]]
        turns = said.kind != "prismatic"
        joints.append(
            (
                model.names[i],
                model.jointPlacements[i],
                np.array(said.axis),
                turns,
                *of[model.names[i]],
            )
        )
    tool = model.frames[model.getFrameId(task.frame, pin.FrameType.BODY)].placement
    path = folder / f"{task.robot.name}_chain.urdf"
    path.write_text(_urdf(joints, tool), encoding="utf-8")
    return path


def ssik_arm(arm: str):
    """Ask ssik for one of the arms that it ships."""
    import ssik

    return ssik.Manipulator.from_prebuilt(OF_SSIK[arm])


def _ssik_joints(arm: str) -> tuple[list[Joint], pin.SE3]:
    """Read the joints and the tool out of ssik's description of an arm: ``T_left R(axis, q)
    T_right`` each."""
    joints, carried = [], np.eye(4)
    for joint in ssik_arm(arm).kinbody.joints:
        low, high = joint.limits or (-np.inf, np.inf)
        joints.append(
            (joint.name, pin.SE3(carried @ joint.T_left), joint.axis, True, low, high, 2.0)
        )
        carried = joint.T_right
    return joints, pin.SE3(carried)


_INERTIA = (
    '<inertial><mass value="1"/>'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
)


def _urdf(joints: Iterable[Joint], tool: pin.SE3) -> str:
    parts, parent = ['<link name="base"/>'], "base"
    for joint in joints:
        parts.append(joint_urdf(parent, joint))
        parent = f"link_{joint[0]}"
    parts.append(link_urdf(parent, "tool", tool))
    return '<?xml version="1.0"?>\n<robot name="chain">\n' + "\n".join(parts) + "\n</robot>\n"


def joint_urdf(parent: str, joint: Joint) -> str:
    """Write a joint and its link, ``link_`` and the joint's name."""
    name, placement, axis, turns, low, high, speed = joint
    bounded = np.isfinite([low, high]).all()
    kind = ("revolute" if bounded else "continuous") if turns else "prismatic"
    ends = f'lower="{low:.17g}" upper="{high:.17g}" ' if bounded else ""
    return (
        f'<link name="link_{name}">{_INERTIA}</link><joint name="{name}" type="{kind}"><parent '
        f'link="{parent}"/>'
        f'<child link="link_{name}"/>{_origin(placement)}<axis xyz="{_numbers(axis)}"/>'
        f'<limit {ends}effort="1" velocity="{speed:.17g}"/></joint>'
    )


def link_urdf(parent: str, name: str, placement: pin.SE3) -> str:
    """Write a link that is fixed to another one."""
    return (
        f'<link name="{name}">{_INERTIA}</link><joint name="to_{name}" type="fixed"><parent '
        f'link="{parent}"/>'
        f'<child link="{name}"/>{_origin(placement)}</joint>'
    )


def _origin(placement: pin.SE3) -> str:
    angles = pin.rpy.matrixToRpy(placement.rotation)
    return f'<origin xyz="{_numbers(placement.translation)}" rpy="{_numbers(angles)}"/>'


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.17g}" for value in values)
