"""The arms known by name, as a table of plain data; :mod:`.catalogue` looks things up in it."""

from __future__ import annotations

from typing import NamedTuple


class Row(NamedTuple):
    """One arm.

    Files are below example-robot-data's ``robots/``; a name without a slash is one of our own ``urdf/``.
    Frames and aliases are words; the first frame is the default. ``srdf`` and ``posture`` name the reference
    pose, ``ready`` a pose of our own ``ready.srdf`` to work from where the reference is singular or on a limit.
    """

    name: str
    urdf: str
    frames: str
    srdf: str = ""
    posture: str = ""
    note: str = ""
    aliases: str = ""
    ready: str = ""


READY = "ready.srdf"  # our own poses, in urdf/
_ROMEO = "romeo_description/srdf/romeo.srdf"
_WRISTS = "wrist_left_ft_tool_link wrist_right_ft_tool_link"

# The arms of example-robot-data 6, and the planar arms of the paper. Left out: robots without an arm, hands,
# files that do not build (ur3.urdf), and variants that differ in nothing an arm feels (*_box, *_reduced).
ROWS = (
    Row("ppr", "ppr.urdf", "tool", note="planar, paper's Fig. 3"),
    Row("prr", "prr.urdf", "tool", READY, "prr", "planar, paper's Fig. 1"),
    Row("planar3r", "planar3r.urdf", "tool", READY, "planar3r", "planar, paper's Fig. 2", "3r"),
    Row("planar4r", "planar4r.urdf", "tool", READY, "planar4r", "planar", "4r"),
    Row("planar7r", "planar7r.urdf", "tool", READY, "planar7r", "planar", "7r"),
    Row(
        "panda",
        "panda_description/urdf/panda.urdf",
        "panda_hand_tcp panda_link8",
        "panda_description/srdf/panda.srdf",
        "default",
        "Franka Emika",
        "franka",
    ),
    Row(
        "xarm7",
        "xarm_description/urdf/xarm7.urdf",
        "link_eef",
        "xarm_description/srdf/xarm7.srdf",
        "home",
        "UFACTORY",
        "xarm",
        "xarm7",
    ),
    Row(
        "baxter",
        "baxter_description/urdf/baxter.urdf",
        "left_gripper right_gripper",
        "baxter_description/srdf/baxter_manipulation.srdf",
        "neutral",
        "two arms",
    ),
    Row(
        "tiago",
        "tiago_description/robots/tiago_no_hand.urdf",
        "wrist_ft_tool_link",
        note="torso lift and arm",
        aliases="tiago_no_hand",
    ),
    Row(
        "tiago_hand",
        "tiago_description/robots/tiago.urdf",
        "hand_grasping_frame wrist_ft_tool_link",
        note="torso lift, arm and hand",
    ),
    Row("tiago_dual", "tiago_description/robots/tiago_dual.urdf", _WRISTS, note="torso lift, two arms and hands"),
    Row(
        "tiago_pro",
        "tiago_pro_description/robots/tiago_pro.urdf",
        "arm_left_tool_link arm_right_tool_link",
        note="torso lift and two arms",
    ),
    Row(
        "pr2",
        "pr2_description/urdf/pr2.urdf",
        "r_gripper_tool_frame l_gripper_tool_frame",
        note="torso lift and two arms",
    ),
    Row(
        "talos",
        "talos_data/robots/talos_full_v2.urdf",
        f"{_WRISTS} gripper_left_base_link gripper_right_base_link",
        "talos_data/srdf/talos.srdf",
        "half_sitting",
        "humanoid; torso and arms",
        "talos_full_v2",
        "talos",
    ),
    Row(
        "talos_left_arm",
        "talos_data/robots/talos_left_arm.urdf",
        "wrist_left_ft_tool_link gripper_left_base_link",
        "talos_data/srdf/talos.srdf",
        "half_sitting",
        "joints 2 to 7 of the arm",
        ready="talos_left_arm",
    ),
    Row(
        "kinova",
        "kinova_description/robots/kinova.urdf",
        "j2s6s200_end_effector",
        "kinova_description/srdf/kinova.srdf",
        "arm_up",
        "JACO, three continuous joints",
        "jaco j2s6s200",
    ),
    Row("ur3", "ur_description/urdf/ur3_robot.urdf", "tool0 ee_link", READY, "ur", "Universal Robots"),
    Row("ur5", "ur_description/urdf/ur5_robot.urdf", "tool0 ee_link", READY, "ur", "Universal Robots"),
    Row("ur10", "ur_description/urdf/ur10_robot.urdf", "tool0 ee_link", READY, "ur", "Universal Robots"),
    Row("ur3_gripper", "ur_description/urdf/ur3_gripper.urdf", "tool0 ee_link", READY, "ur", "with a gripper"),
    Row("ur5_gripper", "ur_description/urdf/ur5_gripper.urdf", "tool0 ee_link", READY, "ur", "with a gripper"),
    Row("ur3_limited", "ur_description/urdf/ur3_joint_limited_robot.urdf", "tool0", READY, "ur", "joints ±π"),
    Row("ur5_limited", "ur_description/urdf/ur5_joint_limited_robot.urdf", "tool0", READY, "ur", "joints ±π"),
    Row("ur10_limited", "ur_description/urdf/ur10_joint_limited_robot.urdf", "tool0", READY, "ur", "joints ±π"),
    Row("z1", "z1_description/urdf/z1.urdf", "gripperStator link06", "z1_description/srdf/z1.srdf", "home", "Unitree"),
    Row("so100", "so_arm_description/urdf/so100.urdf", "gripper", READY, "so100", "the open five-joint arm"),
    Row(
        "so101",
        "so_arm_description/urdf/so101.urdf",
        "gripper_frame_link gripper_link",
        note="the open five-joint arm",
    ),
    Row(
        "romeo",
        "romeo_description/urdf/romeo.urdf",
        "l_gripper r_gripper",
        _ROMEO,
        "half_sitting",
        "humanoid",
        "",
        "romeo",
    ),
    Row(
        "romeo_small",
        "romeo_description/urdf/romeo_small.urdf",
        "l_gripper r_gripper",
        _ROMEO,
        "half_sitting",
        "humanoid, without fingers",
        ready="romeo",
    ),
    Row(
        "icub",
        "icub_description/robots/icub.urdf",
        "l_hand r_hand",
        "icub_description/srdf/icub.srdf",
        "half_sitting",
        "humanoid; torso and arms",
    ),
    Row(
        "g1",
        "g1_description/urdf/g1_29dof_rev_1_0.urdf",
        "left_rubber_hand right_rubber_hand",
        note="humanoid; waist and arms",
    ),
    Row(
        "g1_hands",
        "g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf",
        "left_hand_palm_link right_hand_palm_link",
        note="humanoid; waist, arms and hands",
    ),
    Row(
        "centauro",
        "centauro_description/urdf/centauro.urdf",
        "arm1_8 arm2_8",
        "centauro_description/srdf/centauro.srdf",
        "homing_nominal",
        "centaur",
        ready="centauro",
    ),
    Row(
        "anymal_kinova",
        "anymal_b_simple_description/robots/anymal-kinova.urdf",
        "j2s6s200_end_effector",
        "anymal_b_simple_description/srdf/anymal-kinova.srdf",
        "standing_with_arm_up",
        "a JACO on a quadruped; the body stands still",
        "anymal-kinova",
    ),
    Row(
        "b1_z1",
        "b1_description/urdf/b1-z1.urdf",
        "gripperStator",
        "b1_description/srdf/b1-z1.srdf",
        "standing_with_arm_up",
        "a Z1 on a quadruped; the body stands still",
        "b1-z1",
        "b1_z1",
    ),
    Row(
        "alex",
        "alex_description/urdf/alex_nub_hands.urdf",
        "leftNub rightNub",
        "alex_description/srdf/alex_nub_hands.srdf",
        "default",
        "upper body; spine and arms",
    ),
    Row(
        "alex_sake",
        "alex_description/urdf/alex_sake_hands.urdf",
        "LeftSakePalmLink RightSakePalmLink",
        "alex_description/srdf/alex_sake_hands.srdf",
        "default",
        "upper body with grippers",
    ),
    Row(
        "alex_psyonic",
        "alex_description/urdf/alex_psyonic_hands.urdf",
        "LeftGripperYawLink RightGripperYawLink",
        "alex_description/srdf/alex_psyonic_hands.srdf",
        "default",
        "upper body with hands",
    ),
    Row(
        "simple_humanoid",
        "simple_humanoid_description/urdf/simple_humanoid.urdf",
        "l_wrist r_wrist",
        "simple_humanoid_description/srdf/simple_humanoid.srdf",
        "half_sitting",
        "humanoid; waist and arms",
    ),
    Row("human", "human_description/robots/human.urdf", "left_hand right_hand", note="a person's skeleton"),
    Row(
        "hextilt",
        "hextilt_description/urdf/hextilt_flying_arm_5.urdf",
        "flying_arm_5__gripper",
        "hextilt_description/srdf/hextilt_flying_arm_5.srdf",
        "home",
        "the arm of a drone; the body stands still",
        ready="hextilt",
    ),
)
