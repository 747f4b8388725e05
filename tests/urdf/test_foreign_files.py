"""Kinds of URDF files that others write: unknown limits, followers that narrow, quaternions,
lengths in millimetres, joints with many coordinates, misplaced meshes, limits of acceleration."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from commands import main

import repctl_pin as rp

LIMIT = '<limit lower="-2" upper="2" effort="10" velocity="1"/>'


def joint(name: str, parent: str, child: str, kind: str = "revolute", more: str = LIMIT) -> str:
    return (
        f'<link name="{child}"/><joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/>{more}</joint>'
    )


def arm(limits: str = LIMIT, length: float = 0.3) -> list[str]:
    """Seven joints about x, y, z in turn."""
    return [
        joint(
            f"j{i}",
            f"l{i - 1}",
            f"l{i}",
            more=f'<origin xyz="{length} 0 0"/><axis xyz="{axis}"/>{limits}',
        )
        for i, axis in enumerate(("0 0 1", "0 1 0", "1 0 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0"), 1)
    ]


def load(folder: Path, *lines: str, head: str = '<robot name="made">', **options) -> rp.Robot:
    path = folder / "made.urdf"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([head, '<link name="l0"/>', *lines, "</robot>"]))
    return rp.Robot.load(path, **options)


def test_a_limit_of_minus_1_is_not_given_and_one_note_says_so(tmp_path: Path) -> None:
    """26.11: an exporter's "unknown", once for the whole file."""
    robot = load(tmp_path, *arm('<limit lower="-1" upper="2" effort="-1.0" velocity="-1.0"/>'))
    assert np.isinf(robot.velocity_limit).all() and (robot.lower == -1).all()
    (note,) = robot.description.notes
    assert note.startswith(
        "limits of −1 were read as not given: effort and velocity of joints 'j1', 'j2', 'j3'"
    )
    assert note.endswith("and 4 more")
    with pytest.raises(rp.UrdfError, match="velocity = '-1.5' is negative"):
        load(tmp_path, *arm('<limit lower="-1" upper="2" velocity="-1.5"/>'))


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_follower_of_a_fixed_joint_stands_still_at_its_offset(tmp_path: Path, kind: str) -> None:
    """26.11: against the same arm with the follower moved to the offset."""
    place = '<origin xyz="0.1 0.2 0" rpy="0.3 0.2 0.1"/><axis xyz="0 0.6 0.8"/>'
    fixed = joint("f", "l7", "m", "fixed", "")
    finger = joint(
        "k", "l7", "tip", kind, f'{place}{LIMIT}<mimic joint="f" multiplier="2" offset="0.4"/>'
    )
    robot = load(tmp_path, *arm(), fixed, finger)
    assert robot.joint_names == tuple(f"j{i}" for i in range(1, 8)) and not robot.locked
    assert robot.description.notes == (
        "read as fixed: joint 'k', because 'f', the leader, cannot move",
    )
    task = robot.task("tip")
    found = robot.task("l7").placement(task.reference).actInv(task.placement(task.reference))
    own = pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.2, 0.1), np.array([0.1, 0.2, 0]))
    along = 0.4 * np.array([0, 0.6, 0.8])
    moved = (
        pin.SE3(pin.exp3(along), np.zeros(3)) if kind == "revolute" else pin.SE3(np.eye(3), along)
    )
    assert np.allclose(found.homogeneous, (own * moved).homogeneous, atol=1e-14)


FOLLOWER = '<axis xyz="0 1 0"/><mimic joint="j2" multiplier="-0.25"/>'


@pytest.mark.slow
def test_a_narrowed_axis_is_told_by_inspect_and_study(
    tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    """26.12: the follower's range, divided by its multiplier, cuts the leader's."""
    limit = '<limit lower="-0.3" upper="0.5" velocity="9"/>'
    robot = load(tmp_path, *arm(), joint("rod", "l1", "cylinder", more=FOLLOWER + limit))
    lower, upper = robot.lower[1], robot.upper[1]
    assert (lower, upper) == (-2.0, pytest.approx(0.3 / 0.25))
    said = robot.narrowed["j2"]
    assert said.startswith("! j2 narrowed from [-2, 2] to [-2, 1.2] rad, because it drives rod")
    assert [*robot.narrowed] == ["j2"]
    path = str(tmp_path / "made.urdf")
    assert main(["inspect", path]) == 0
    assert (
        "\n! j2 narrowed from [-2, 2] to [-2, 1.2] rad, because it drives rod"
        in capsys.readouterr().out
    )
    assert said in rp.Problem(robot).warnings
    few = ["--task", "position", "--cycles", "1", "--steps", "40", "--degree", "1"]
    monkeypatch.chdir(tmp_path)  # a long path would leave fewer rows for notes
    assert main(["study", path, *few, "--out", "."]) == 0
    assert (
        "\n! j2 narrowed from [-2, 2] to [-2, 1.2] rad, because it drives rod"
        in capsys.readouterr().out
    )
    # not of an arm that the joint does not move
    assert said not in rp.Problem(rp.Robot.load(path, base="l2")).warnings


@pytest.mark.slow
def test_a_narrowed_axis_is_told_by_design_cell_follow_and_move(tmp_path: Path, capsys) -> None:
    """26.12: where a user would trust the range of the file, on its own line; in JSON too."""
    limit = '<limit lower="-0.3" upper="0.5" velocity="9"/>'
    load(tmp_path, *arm(), joint("rod", "l1", "cylinder", more=FOLLOWER + limit))
    path, said = (
        str(tmp_path / "made.urdf"),
        "! j2 narrowed from [-2, 2] to [-2, 1.2] rad, because it drives rod",
    )
    few = ["--task", "position", "--samples", "64", "--held-out", "64", "--out", str(tmp_path)]
    assert main(["design", path, *few, "--degree", "1"]) == 0
    assert f"\n{said}" in capsys.readouterr().out
    assert main(["follow", path, "--task", "position", "--cycles", "1", "--steps", "60"]) == 0
    assert f"\n{said}" in capsys.readouterr().out
    small = ["--half-width", "0.02", "--degree", "1", "--held-out", "64", "--out", str(tmp_path)]
    assert main(["cell", path, "--task", "position", *small]) == 0
    assert f"\n{said}" in capsys.readouterr().out
    cell = next(tmp_path.rglob("cell.json"))
    task = rp.Robot.load(path).task("l7", "position")
    middle = rp.load(cell, task).cell.placement.translation
    poses = tmp_path / "poses.csv"
    rows = [middle, middle + [0.01, 0, 0]]
    poses.write_text("x,y,z\n" + "".join(",".join(map(repr, p.tolist())) + "\n" for p in rows))
    words = ["move", str(cell), "--through", str(poses), "--acceleration", "5", "--robot", path]
    assert main(words) == 0
    assert f"\n{said}" in capsys.readouterr().out


def test_notes_on_the_file_are_warnings_of_the_robot(tmp_path: Path, capsys) -> None:
    """26.11 and 26.13: a study was silent on limits of -1 and on quaternions that are dropped."""
    limit = '<limit lower="-2" upper="2" effort="-1" velocity="-1"/>'
    turned = arm(limit)
    turned[3] = turned[3].replace('xyz="0.3 0 0"', 'xyz="0.3 0 0" quat_xyzw="0 0 0 1"')
    robot = load(tmp_path, *turned)
    notes = robot.description.notes
    assert any("limits of −1 were read as not given" in note for note in notes)
    assert any("quat_xyzw" in note for note in notes)
    assert robot.warnings[: len(notes)] == notes
    path = str(tmp_path / "made.urdf")
    few = [
        "--task",
        "position",
        "--region",
        "0.2",
        "--cycles",
        "1",
        "--steps",
        "40",
        "--degree",
        "1",
        "--full",
    ]
    assert main(["study", path, *few, "--out", str(tmp_path)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert all(" ".join(note.split()) in out for note in notes)
    assert main(["inspect", path]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert all(out.count(" ".join(note.split())) == 1 for note in notes)


@pytest.mark.parametrize(
    ("limit", "said"),
    [
        (
            'lower="-9" upper="0.49" velocity="9"',
            "j2 narrowed from [-2, 2] to [-1.96, 2] rad, because it drives rod",
        ),
        (
            'lower="-9" upper="9" velocity="0.2"',
            "! speed limit of j2 lowered from 1 to 0.8 rad/s, because it drives rod",
        ),
        ('lower="-9" upper="9" velocity="9"', ""),
        ('lower="-0.5" upper="0.5" velocity="0.25"', ""),
    ],
)
def test_a_small_loss_is_a_note_and_a_large_one_a_warning(
    tmp_path: Path, limit: str, said: str
) -> None:
    """26.12: more than 5 % of a range or a speed is a warning."""
    rod = joint("rod", "l1", "cylinder", more=f"{FOLLOWER}<limit {limit}/>")
    found = load(tmp_path, *arm(), rod).narrowed.get("j2", "")
    assert found.startswith(said) and bool(found) == bool(said)


@pytest.mark.slow
def test_limits_of_urdf_1_2_are_the_default_of_timing_and_governor(tmp_path: Path) -> None:
    """26.13: the smaller one of acceleration and deceleration, and followers keep theirs."""
    limit = '<limit lower="-2" upper="2" velocity="1" acceleration="4" deceleration="3" jerk="50"/>'
    head = '<robot name="made" version="1.2">'
    robot = load(tmp_path, *arm(limit), head=head)
    assert (robot.acceleration_limit == 3).all() and (robot.jerk_limit == 50).all()
    task = robot.task("l7", "position")
    q0 = np.array([0.2, 0.5, -0.3, 0.8, 0.4, 0.6, -0.2])
    motion = rp.follow(rp.Pseudoinverse(task), rp.circle(task, q0, 0.05), q0, cycles=1)
    own, given = rp.timed(motion, rp.Limits()), rp.timed(motion, rp.Limits(acceleration=3, jerk=50))
    assert own.duration == pytest.approx(given.duration, rel=1e-12)
    assert np.abs(own.qddot).max() <= 3 * 1.001
    slow = limit.replace('acceleration="4"', 'acceleration="1"')
    rod = joint("rod", "l1", "cylinder", more=f"{FOLLOWER.replace('-0.25', '-2')}{slow}")
    assert load(tmp_path, *arm(limit), rod, head=head).acceleration_limit[1] == 0.5
    bare = load(tmp_path, *arm(limit)[:3], *arm()[3:], head=head).task("l7", "position")
    motion = rp.follow(rp.Pseudoinverse(bare), rp.circle(bare, q0, 0.05), q0, cycles=1)
    with pytest.raises(rp.InputError, match="the model has no acceleration limit of joint 'j4'"):
        rp.timed(motion, rp.Limits())


def quaternion(turn: np.ndarray) -> str:
    return " ".join(map(repr, pin.Quaternion(turn).coeffs().tolist()))


def test_quaternions_place_joints_and_shapes_and_need_a_version(tmp_path: Path) -> None:
    """26.13: against rotations of Pinocchio, also at a pitch of π/2; else one note."""
    rng = np.random.default_rng(1)
    turns = [pin.exp3(rng.uniform(-3, 3, 3)) for _ in range(50)]
    turns += [pin.rpy.rpyToMatrix(a, s * np.pi / 2, 0.3) for a in (0.0, 2.0) for s in (-1, 1)]
    for turn in turns:
        origin = f'<origin xyz="0 0 1" quat_xyzw="{quaternion(turn)}"/>'
        shape = f"<collision>{origin}<geometry><sphere radius='1'/></geometry></collision>"
        lines = [
            f'<link name="b">{shape}</link><joint name="j" type="continuous"><parent link="l0"/>'
            f'<child link="b"/>{origin}<axis xyz="0 0 1"/></joint>'
        ]
        robot = load(tmp_path, *lines, head='<robot name="made" version="1.1">')
        assert np.allclose(robot.model.jointPlacements[1].rotation, turn, atol=1e-13)
        (solid,) = robot.description.collisions
        assert np.allclose(pin.rpy.rpyToMatrix(np.array(solid.rpy)), turn, atol=1e-13)
    (note,) = load(tmp_path, *lines).description.notes
    assert note.startswith("ignored: quat_xyzw in line 3 (and 1 more)") and "version" in note
    both = lines[0].replace("xyz=", 'rpy="0 0 0" xyz=', 1)
    with pytest.raises(rp.UrdfError, match="has both rpy and quat_xyzw"):
        load(tmp_path, both, head='<robot name="made" version="1.1">')


def test_a_planar_joint_says_which_limits_it_loses(tmp_path: Path) -> None:
    """26.13"""
    limit = '<axis xyz="0 0 1"/><limit effort="3" velocity="0.5"/>'
    robot = load(tmp_path, joint("p", "l0", "cart", "planar", limit))
    assert "; its effort and velocity limits are dropped; " in robot.description.notes[0]


@pytest.mark.parametrize("kind", ["ball", "spherical"])
def test_a_ball_joint_beyond_the_tool_does_not_refuse_the_arm(tmp_path: Path, kind: str) -> None:
    """26.13: the arm is the same; the ball is yaw, pitch and roll about its centre."""
    ball = joint("b", "l7", "bob", kind, '<origin xyz="0.1 0 0"/>')
    robot = load(tmp_path, *arm(), ball)
    assert robot.task("l7").joint_names == tuple(f"j{i}" for i in range(1, 8))
    task = robot.task("bob")
    q = np.r_[task.reference[:7], 0.3, -0.2, 0.9]
    turn = robot.task("l7").placement(q[:7]).actInv(task.placement(q))
    assert np.allclose(turn.rotation, pin.rpy.rpyToMatrix(0.9, -0.2, 0.3), atol=1e-14)
    assert any(
        "'b' is" in note and "b_yaw, b_pitch, b_roll" in note for note in robot.description.notes
    )


def test_lengths_in_millimetres_get_a_hint(tmp_path: Path) -> None:
    """26.13: not for an arm in m, even if it stands far from the root."""
    (note,) = load(tmp_path, *arm(length=300)).description.notes
    assert "300 m" in note and "possibly in millimetres" in note and "5 more" in note
    far = joint("place", "l0", "world", "fixed", '<origin xyz="5e6 0 0"/>')
    assert not load(tmp_path, *arm(), far).description.notes


def test_a_capsules_distance_is_that_of_two_segments(tmp_path: Path) -> None:
    """26.13: against the closed form on parallel and crossing axes, in URDF and between samples."""
    capsule = '<collision><geometry><capsule radius="0.05" length="0.4"/></geometry></collision>'
    base = '<link name="base">' + capsule + "</link>"
    rail = '<limit lower="-5" upper="5" velocity="1"/>'
    slides = [
        joint("x", "base", "a", "prismatic", f'<axis xyz="1 0 0"/>{rail}'),
        joint("y", "a", "b", "prismatic", f'<axis xyz="0 1 0"/>{rail}'),
        joint("z", "b", "c", "prismatic", f'<axis xyz="0 0 1"/>{rail}'),
        joint("roll", "c", "tip", "continuous", '<axis xyz="1 0 0"/>').replace(
            '<link name="tip"/>', f'<link name="tip">{capsule}</link>'
        ),
    ]
    (tmp_path / "c.urdf").write_text(
        f'<robot name="c" version="1.1">{base}{"".join(slides)}</robot>'
    )
    bodies = rp.Bodies(rp.Robot.load(tmp_path / "c.urdf").task("tip", "position"))
    s = np.linspace(-0.2, 0.2, 801)
    for x, y, z, roll in np.random.default_rng(2).uniform(-1, 1, (20, 4)) + [0.8, 0, 0, 0]:
        centre = np.array([x, y, z])
        one = s[:, None] * [0, 0, 1]
        other = centre + s[:, None] * [0, -np.sin(roll), np.cos(roll)]
        least = np.sqrt(((one[:, None] - other[None]) ** 2).sum(-1)).min() - 0.1
        if least > 0.01:
            found = bodies.distances([[x, y, z, roll]])[0]
            assert least - 1e-3 < found < least + 1e-9


STL = (
    "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    "endloop\nendfacet\nendsolid\n"
)


def meshed(name: str) -> str:
    shape = f'<collision><geometry><mesh filename="{name}"/></geometry></collision>'
    return f'<link name="part">{shape}{shape.replace("collision", "visual")}</link>' + joint(
        "j", "l0", "part", "continuous", '<axis xyz="0 0 1"/>'
    ).replace('<link name="part"/>', "")


@pytest.mark.parametrize(
    ("name", "file", "given", "by_end"),
    [
        ("package://OTHER_V10/meshes/x.stl", "meshes/x.stl", None, True),
        ("package://drake/manipulation/models/arm/meshes/x.stl", "arm/meshes/x.stl", None, True),
        ("file:///usr/someone/robots/meshes/x.stl", "meshes/x.stl", None, True),
        ("package://other/x.stl", "urdf/x.stl", None, True),
        ("package://other/visual/x.stl", "elsewhere/parts/x.stl", "elsewhere/parts", True),
        ("package://other/m/x.stl", "elsewhere/m/x.stl", "other=elsewhere", False),
        ("package://other/m/x.stl", "elsewhere/m/x.stl", None, None),
        ("http://other/meshes/x.stl", "meshes/x.stl", None, None),
    ],
)
def test_meshes_are_found_by_the_end_of_their_names(
    tmp_path: Path, capsys, name: str, file: str, given: str | None, by_end: bool | None
) -> None:
    """26.8: which file was taken is said; a package given by name needs no folder of that name."""
    (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / file).write_text(STL)
    start, mark, folder = (given or "").rpartition("=")
    dirs = [f"{start}{mark}{tmp_path / folder}"] if given else []
    robot = load(tmp_path / "urdf", meshed(name), package_dirs=dirs)
    found = [text for text in robot.warnings if "found by the end of their names" in text]
    assert bool(found) == bool(by_end)
    assert not found or found[0].endswith(f"{name} is read from {tmp_path / file}")
    assert any("are missing" in text for text in robot.warnings) == (by_end is None)
    words = ["inspect", str(tmp_path / "urdf" / "made.urdf")]
    assert main([*words, *(f"--package-dir={one}" for one in dirs)]) == 0
    bodies = 0 if by_end is None else 1
    assert f"collision: {bodies} of 1 links have a body" in capsys.readouterr().out


def test_an_unknown_folder_of_a_package_is_refused(tmp_path: Path) -> None:
    with pytest.raises(rp.InputError, match="there is no folder 'arm=/nowhere'"):
        load(tmp_path, *arm(), package_dirs=["arm=/nowhere"])


def digit(name: str, count: int) -> list[str]:
    """A finger without limits, whose joints and links are named after it."""
    names = ["palm", *(f"{name}_{part}" for part in ("base", "mid", "distal", "tip")[:count])]
    pairs = pairwise(names)
    return [joint(f"{b}_joint", a, b, "continuous", '<axis xyz="0 1 0"/>') for a, b in pairs]


def test_named_fingers_collision_links_and_sensors_are_no_end_effectors(tmp_path: Path) -> None:
    """26.14"""
    palm = joint("mount", "l7", "palm", "fixed", "")
    hand = [palm, *digit("index", 4), *digit("middle", 4), *digit("thumb", 3)]
    assert load(tmp_path, *arm(), *hand).default_frame == "palm"
    sphere = "<collision><geometry><sphere radius='0.1'/></geometry></collision>"
    shell = joint("s", "l7", "l7_sc", "fixed", "").replace(
        '<link name="l7_sc"/>', f'<link name="l7_sc">{sphere}</link>'
    )
    robot = load(tmp_path, *arm(), shell, joint("f", "l7", "l8", "fixed", ""))
    assert robot.default_frame == "l8" and robot.end_frames == ("l8", "l7")
    # a spindle of a laser scanner on a neck that is longer than the arm
    spindle = joint("h", "l7", "head_hokuyo_frame", "continuous", '<axis xyz="0 0 1"/>')
    other = [joint(f"a{i}", f"b{i - 1}" if i > 1 else "l0", f"b{i}") for i in range(1, 6)]
    assert load(tmp_path, *arm(), spindle, *other).default_frame == "b5"
    grip = joint("g", "l7", "gripper_left_base_link", "fixed", "")
    assert load(tmp_path, *arm(), grip).default_frame == "gripper_left_base_link"


@pytest.mark.slow
def test_a_cell_says_which_bodies_are_not_checked_as_a_study_does(tmp_path: Path, capsys) -> None:
    """26.7: an arm whose meshes were not found had "no collision bodies" in a cell."""
    lost = [
        line.replace(
            f'<link name="l{i}"/>',
            f'<link name="l{i}"><collision><geometry><mesh filename="package://gone/l{i}.stl"/>'
            "</geometry></collision></link>",
        )
        for i, line in enumerate(arm(), 1)
    ]
    robot = load(tmp_path, *lost)
    bodies = rp.Bodies(robot.task(None, "position"))
    assert len(bodies.unchecked) == 7
    words = "not checked: 7 bodies without a collision shape; meshes missing: --package-dir DIR"
    path, out = str(tmp_path / "made.urdf"), ["--task", "position", "--out", str(tmp_path)]
    assert main(["study", path, *out, "--cycles", "1", "--steps", "40", "--degree", "1"]) == 0
    assert words in " ".join(capsys.readouterr().out.split())
    small = ["--half-width", "0.02", "--degree", "1", "--held-out", "64"]
    assert main(["cell", path, *out, *small]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert words in said and "no collision bodies" not in said.lower()
    page = next(tmp_path.rglob("cell.html")).read_text(encoding="utf-8")
    assert words.removeprefix("not checked: ") in page.replace("&nbsp;", " ")


def test_a_load_on_a_ball_joint_beyond_the_tool_is_no_end_effector(tmp_path: Path, capsys) -> None:
    """26.13: no motor drives the ball; without a link named as a tool, the ball ends the arm."""
    flange = joint("f", "l7", "flange", "fixed", '<origin xyz="0.1 0 0"/>')
    hook = joint("b", "flange", "hook", "ball", '<origin xyz="0.02 0 0"/>')
    robot = load(tmp_path, *arm(), flange, hook)
    assert robot.task().frame == "flange" and robot.task().n == 7
    assert "choose a frame before or a base link beyond them" in robot.warnings[0]
    wrist = joint("b", "l7", "palm", "ball", '<origin xyz="0.02 0 0"/>')
    assert load(tmp_path / "other", *arm(), wrist).task().frame == "palm"


def test_a_range_of_one_position_is_not_called_none(tmp_path: Path) -> None:
    """A follower of multiplier −1 with its leader's range: PR2's gripper."""
    closing = '<limit lower="0" upper="0.5" velocity="1"/>'
    finger = joint("k", "l7", "one", "revolute", closing)
    other = joint("m", "l7", "two", "revolute", f'{closing}<mimic joint="k" multiplier="-1"/>')
    (note,) = load(tmp_path, *arm(), finger, other).warnings
    assert "only the position 0 rad of 'k', which it mimics, satisfies them" in note


def test_the_report_of_a_motion_names_the_joint_of_the_smallest_margin(
    tmp_path: Path, capsys
) -> None:
    """Against the margins of the motion's file; with the unit of that joint."""
    load(tmp_path, *arm('<limit lower="-2.1" upper="2.2" effort="10" velocity="1"/>'))
    words = ["follow", str(tmp_path / "made.urdf"), "--strategy", "pseudoinverse"]
    assert main([*words, "--steps", "100", "--csv", str(tmp_path / "m.csv")]) == 0
    said = capsys.readouterr().out
    rows = np.genfromtxt(tmp_path / "m.csv", delimiter=",", names=True)
    margins = {
        f"j{i}": float(np.minimum(rows[f"j{i}"] + 2.1, 2.2 - rows[f"j{i}"]).min())
        for i in range(1, 8)
    }
    least = min(margins, key=margins.__getitem__)
    assert f"limit margin    minimum {margins[least]:.3g} rad, of {least}\n" in said
