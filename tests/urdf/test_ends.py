"""Where an arm ends: before the fingers, at the link that a tool is held by; and what ``repctl
inspect`` says of it."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from arms import KINDS, catalogue
from commands import main
from controls import some

import repctl_pin as rp

Lines = list[str]


def joint(
    child: str,
    parent: str,
    kind: str = "fixed",
    travel: float = 0.0,
    *,
    name: str = "",
    more: str = "",
) -> str:
    """A link and the joint that carries it, 0.1 m along x; joints turn about x, y, z in turn."""
    axis = ("1 0 0", "0 1 0", "0 0 1")[sum(map(ord, child)) % 3]
    limit = (
        f'<limit lower="{-travel / 2}" upper="{travel / 2}" effort="1" velocity="1"/>'
        if travel
        else ""
    )
    return (
        f'<link name="{child}"/><joint name="{name or "to_" + child}" type="{kind}"><parent '
        f'link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="0.1 0 0"/><axis xyz="{axis}"/>{limit}{more}</joint>'
    )


def turns(count: int, parent: str = "base", prefix: str = "l", travel: float = 5.0) -> Lines:
    """A chain of revolute joints: links prefix1, prefix2, …"""
    names = [parent, *(f"{prefix}{i}" for i in range(1, count + 1))]
    return [joint(b, a, "revolute", travel) for a, b in pairwise(names)]


def mimics(leader: str) -> str:
    return f'<mimic joint="{leader}"/>'


def load(folder: Path, *lines: Lines, **options) -> rp.Robot:
    path = folder / "made.urdf"
    text = "".join(line for some in lines for line in some)
    path.write_text(f'<robot name="made"><link name="base"/>{text}</robot>')
    return rp.Robot.load(path, **options)


FINGERS = {
    "two, one mimics": [
        joint("a", "l7", "prismatic", 0.04),
        joint("b", "l7", "prismatic", 0.04, more=mimics("to_a")),
    ],
    "two of their own": [joint("a", "l7", "prismatic", 0.04), joint("b", "l7", "prismatic", 0.04)],
    "two that turn": [joint("a", "l7", "revolute", 0.8), joint("b", "l7", "revolute", 0.8)],
    "two that turn without end": [joint(f"finger_{x}", "l7", "continuous") for x in "ab"],
    "two, and the screw that drives them": [
        joint("screw", "l7", "continuous"),
        *(joint(x, "l7", "prismatic", 0.04) for x in "ab"),
    ],
    "two of two joints": [*turns(2, "l7", "a", 1.5), *turns(2, "l7", "b", 1.5)],
    "three of three joints": [line for x in "abc" for line in turns(3, "l7", x, 1.5)],
    "five of six joints": [line for x in "abcde" for line in turns(6, "l7", x, 0.8)],
    "one that slides": [joint("a", "l7", "prismatic", 0.09)],
    "one that mimics": [joint("a", "l7", "revolute", 6.0, more=mimics("to_l7"))],
    "one that is called jaw": [joint("moving_jaw", "l7", "revolute", 2.2)],
    "one whose joint is called gripper": [joint("a", "l7", "revolute", 1.6, name="jointGripper")],
    "one, the others fixed but said to mimic": [
        joint("a", "l7", "revolute", 1.0),
        joint("b", "l7", more=mimics("to_a")),
    ],
}


@pytest.mark.parametrize("fingers", FINGERS)
def test_an_arm_ends_before_its_fingers(tmp_path: Path, fingers: str) -> None:
    robot = load(tmp_path, turns(7), FINGERS[fingers])
    assert robot.default_frame == "l7" and robot.task().n == 7
    assert robot.end_frames == ("l7",) and set(robot.movable_frames) == set(robot.frames) - {"base"}


def test_a_palm_between_arm_and_fingers_is_the_end(tmp_path: Path) -> None:
    palm = [joint("mount", "l6"), joint("hand", "mount")]
    fingers = [joint("a", "hand", "prismatic", 0.04), joint("b", "hand", "prismatic", 0.04)]
    rail = [joint("sled", "base", "prismatic", 2.0), *turns(6, "sled")]
    robot = load(tmp_path, rail, palm, fingers)
    assert robot.default_frame == "hand" and robot.task().n == 7
    assert robot.end_frames == ("hand", "mount", "l6")


def test_a_tool_frame_beside_the_fingers_is_taken(tmp_path: Path) -> None:
    sides = [joint("tool0", "l7"), joint("mount", "l7"), joint("palm", "mount")]
    robot = load(tmp_path, turns(7), sides, [joint(x, "palm", "prismatic", 0.04) for x in "ab"])
    assert robot.default_frame == "tool0" and robot.chain("tool0") == robot.chain("palm")
    # nothing but the tool's name tells this last joint from one of the arm's
    robot = load(
        tmp_path, turns(7), [joint("arm_tool0", "l7"), joint("flap", "l7", "revolute", 1.5)]
    )
    assert robot.default_frame == "arm_tool0"


@pytest.mark.parametrize(
    ("links", "best"),
    [
        (["flange", "tool0", "my_tcp"], "my_tcp"),
        (["tool0", "flange"], "tool0"),
        (["ee_link", "left_gripper"], "ee_link"),
        (["hand", "LeftPalmLink", "robot_base_plate"], "LeftPalmLink"),
        (["end_effector", "camera_tool"], "end_effector"),
        (["grasp_center", "hand"], "grasp_center"),
        (["gripper", "gripper_led"], "gripper"),
        (["plate", "camera_link", "finger_guard"], "plate"),
    ],
)
def test_well_known_names_come_first(tmp_path: Path, links: list[str], best: str) -> None:
    for order in (links, links[::-1]):
        assert load(tmp_path, turns(7), [joint(name, "l7") for name in order]).default_frame == best


def test_without_a_known_name_it_is_the_link_farthest_out_but_no_camera(tmp_path: Path) -> None:
    camera = [
        joint("camera_mount", "l7"),
        joint("camera_link", "camera_mount"),
        joint("optical", "camera_link"),
    ]
    robot = load(tmp_path, turns(7), [joint("plate", "l7"), joint("adapter", "plate")], camera)
    assert robot.default_frame == "adapter"
    assert robot.end_frames == ("adapter", "plate", "l7") and "optical" in robot.movable_frames


NO_FINGERS = {
    "a wrist that turns little": ([*turns(6), joint("l7", "l6", "revolute", 1.4)], "l7"),
    "a last slide of some length": ([*turns(3), joint("quill", "l3", "prismatic", 0.18)], "quill"),
    "a wrist beside a camera's tilt": (
        [*turns(6), joint("l7", "l6", "revolute", 6.0), joint("eye", "l6", "revolute", 1.0)],
        "l7",
    ),
    "a wrist called after its gripper": (
        [*turns(6), joint("l7", "l6", "revolute", 5.2, name="gripper_yaw")],
        "l7",
    ),
    "a hand without an arm": ([line for x in "abc" for line in turns(3, "base", x, 1.5)], "a3"),
    "a waist with two stiff arms": (
        [
            *turns(2, prefix="waist", travel=2.0),
            *turns(4, "waist2", "a", 2.0),
            *turns(4, "waist2", "b", 2.0),
        ],
        "a4",
    ),
    "an arm that splits into two wrists": (
        [
            *turns(4),
            *(joint(f"{x}1", "l4", "revolute", 1.4) for x in "ab"),
            *(joint(f"{x}{i}", f"{x}{i - 1}", "revolute", 6.0) for x in "ab" for i in (2, 3)),
        ],
        "a3",
    ),
    "a chest with two ears and an arm": (
        [
            *turns(3),
            *turns(4, "l3", "arm"),
            joint("ear1", "l3", "revolute", 1.0),
            joint("ear2", "l3", "revolute", 1.0),
        ],
        "arm4",
    ),
    "a slide before the last joint": (
        [*turns(5), joint("slide", "l5", "prismatic", 0.05), joint("l7", "slide", "revolute", 1.4)],
        "l7",
    ),
}


@pytest.mark.parametrize("case", NO_FINGERS)
def test_what_only_looks_like_a_finger_stays_part_of_the_arm(tmp_path: Path, case: str) -> None:
    lines, end = NO_FINGERS[case]
    assert load(tmp_path, lines).default_frame == end


def two_arms() -> Lines:
    """A waist of 2, a left arm of 6 with long fingers, a right arm of 7, a head of 2."""
    left = [*turns(6, "waist2", "left"), *turns(3, "left6", "a", 1.5), *turns(3, "left6", "b", 1.5)]
    right = [*turns(7, "waist2", "right"), joint("right_hand", "right7")]
    return [*turns(2, prefix="waist"), *left, *right, *turns(2, "waist2", "head")]


def test_the_longest_arm_is_taken_fingers_not_counted(tmp_path: Path) -> None:
    robot = load(tmp_path, two_arms())
    assert robot.default_frame == "right_hand" and robot.task(kind="position").n == 9
    assert robot.end_frames == ("right_hand", "right7", "left6", "head2")


def test_a_robot_that_is_a_finger_ends_at_its_tip(tmp_path: Path) -> None:
    robot = load(tmp_path, [*turns(3, prefix="finger_"), joint("finger_tip", "finger_3")])
    assert robot.default_frame == "finger_tip" and len(robot.chain("finger_tip")) == 3


def test_locked_joints_and_a_base_are_heeded(tmp_path: Path) -> None:
    robot = load(tmp_path, two_arms(), lock=["to_right1", "to_right2"])
    assert robot.default_frame == "left6" and len(robot.chain("left6")) == 8
    robot = load(tmp_path, two_arms(), base="left2")
    assert robot.default_frame == "left6" and len(robot.chain("left6")) == 4
    assert robot.end_frames == ("left6",)
    assert "right7" not in robot.movable_frames and set(robot.movable_frames) >= {"a3", "b3"}
    baxter = rp.Robot.load("baxter", base="right_upper_shoulder")
    assert baxter.default_frame == "right_gripper" and baxter.offered_frames == ("right_gripper",)
    with pytest.raises(rp.InputError, match="no frame 'left_'; did you mean 'left"):
        load(tmp_path, two_arms(), base="left_")


@pytest.mark.parametrize("name", some(catalogue(), *KINDS))
def test_every_known_arm_is_found_without_what_the_catalogue_knows(name: str) -> None:
    """Oracle: the catalogue's frames, chosen by hand; the frame found is one of them, or fixed to
    one."""
    known = rp.Robot.load(name)
    assert known.default_frame == catalogue()[name]["frames"][0]
    bare = rp.Robot.load(known.description.path)
    found = bare.default_frame
    rigid = [frame for frame in known.offered_frames if _moves_with(known, found, frame)]
    assert rigid, (found, known.offered_frames)
    # where it is fixed to one but not the same, it is no worse a choice
    other = {
        "tiago_dual": "hand_left_grasping_frame",
        "icub": "l_gripper",
        "centauro": "ball1_tip",
        "alex_psyonic": "LeftPsyonicAbilityBaseLink",
    }
    assert found in known.offered_frames or found == other.get(name)


def _moves_with(robot: rp.Robot, one: str, other: str) -> bool:
    """Whether two frames keep their places against each other, whatever all joints do."""
    model, data, rng = robot.model, robot.model.createData(), np.random.default_rng(0)
    seen = []
    for _ in range(2):
        pin.framesForwardKinematics(model, data, rng.uniform(-1, 1, model.nq))
        a, b = (data.oMf[model.getFrameId(frame, pin.FrameType.BODY)] for frame in (one, other))
        seen.append((a.inverse() * b).homogeneous)
    return bool(np.allclose(seen[0], seen[1], atol=1e-12))


@pytest.mark.parametrize("count", some([12, 40], 12))
def test_ends_are_found_in_any_tree(count: int, tmp_path: Path) -> None:
    """Law, on two arms of two joints that branch at random: no end carries another, and every link
    that two joints move is on the way to an end, on one, or beyond one."""
    rng = np.random.default_rng(4)
    for _ in range(count):
        lines = [*turns(2, prefix="left"), *turns(2, prefix="right")]
        names = ["left2", "right2"]
        for i in range(int(rng.integers(1, 30))):
            kind = str(rng.choice(["fixed", "revolute", "prismatic"]))
            travel = 0.0 if kind == "fixed" else float(rng.choice([0.05, 1.0, 5.0]))
            lines.append(joint(f"n{i}", str(rng.choice(names)), kind, travel))
            names.append(f"n{i}")
        robot = load(tmp_path, lines)
        joints = {frame: set(robot.chain(frame)) for frame in robot.frames}
        ends = [joints[frame] for frame in robot.end_frames]
        assert robot.default_frame == robot.end_frames[0]
        assert max(map(len, ends)) == len(ends[0])
        assert not any(a < b for a in ends for b in ends)
        assert all(any(moved <= end or end <= moved for end in ends) for moved in joints.values())


# ---- what repctl inspect says
# ---------------------------------------------------------------------


def inspected(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["inspect", *arguments]) == 0
    return capsys.readouterr().out


def test_inspect_lists_the_ends_with_their_places(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    load(tmp_path, turns(7), [joint("tool0", "l7")], FINGERS["two of their own"])
    path = str(tmp_path / "made.urdf")
    found = json.loads(inspected(capsys, path, "--json"))
    assert found["default_frame"] == "tool0" and list(found["frames"]) == ["tool0", "l7"]
    robot = rp.Robot.load(path)
    for frame, said in found["frames"].items():
        task = robot.task(frame)
        assert said["chain"] == list(task.joint_names) and said["redundancy"]["pose"] == 1
        np.testing.assert_allclose(
            said["position"], task.placement(task.reference).translation, atol=1e-6
        )
    assert found["frames_left_out"] == 8  # six links on the way, two fingers

    lines = inspected(capsys, path).splitlines()
    x, y, z = (f"{v:.4f}" for v in found["frames"]["tool0"]["position"])
    assert ["tool0", "(default)", "7", x, y, z] in [line.split() for line in lines]
    assert (
        "x, y, z in m from the base, at the reference pose; choose one with --frame; --all lists "
        "8 more" in " ".join(" ".join(lines).split())
    )
    assert any(line.startswith("frame tool0, moved by 7: to_l1, ") for line in lines)


def test_inspect_all_lists_whatever_moves(capsys: pytest.CaptureFixture[str]) -> None:
    every = json.loads(inspected(capsys, "panda", "--all", "--json"))
    joints = ElementTree.parse(every["file"]).getroot().iter("joint")
    moving = {j.find("child").get("link") for j in joints if j.get("type") != "fixed"}
    assert set(every["frames"]) >= moving and every["frames_left_out"] == 0
    assert every["frames"]["panda_link3"]["redundancy"].keys() <= {"position", "xy", "xz", "yz"}
    text = inspected(capsys, "panda", "--all")
    assert "panda_leftfinger" in text and "--all" not in text
    assert "panda_leftfinger" not in inspected(capsys, "panda").partition("frame ")[2]


@pytest.mark.slow
def test_inspect_stays_short_on_a_humanoid_and_measures_from_the_base(
    capsys: pytest.CaptureFixture[str],
) -> None:
    found = json.loads(inspected(capsys, "talos", "--json"))
    assert found["default_frame"] == "wrist_left_ft_tool_link" and found["links"] > 50 >= 4 * len(
        found["frames"]
    )
    assert {"left_sole_link", "gripper_right_base_link"} < set(found["frames"])
    found = json.loads(inspected(capsys, "tiago", "--base", "torso_lift_link", "--json"))
    task = rp.Robot.load("tiago", base="torso_lift_link").task("wrist_ft_tool_link")
    said = found["frames"]["wrist_ft_tool_link"]
    np.testing.assert_allclose(
        said["position"], task.placement(task.reference).translation, atol=1e-6
    )
    assert len(said["chain"]) == 7
