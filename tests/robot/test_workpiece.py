"""Tasks on a workpiece that its own joints move: x = X_w(q)⁻¹ X_t(q)."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import page_file
import pinocchio as pin
import pytest
from arms import planar_urdf
from cell_functions import f_in_numpy, on_a_workpiece
from commands import main, refused, told
from controls import NEEDS_C, some

import repctl_pin as rp
from repctl_pin.extensions.integrations.servo import Servo

WELD = Path(__file__).parents[2] / "examples" / "weld_cell.urdf"
TURNTABLE = (
    '<joint name="turn" type="revolute"><parent link="{root}"/><child link="table"/>'
    '<origin xyz="{xyz}"/><axis xyz="0 0 1"/>'
    '<limit lower="-3" upper="3" velocity="1" effort="1"/></joint><link name="table"/>'
)


def with_turntable(urdf: str, folder: Path, root: str, xyz: str = "1 0 0") -> rp.Robot:
    """Load an arm beside which a turntable stands, on the arm's root."""
    text = urdf.replace("</robot>", TURNTABLE.format(root=root, xyz=xyz) + "</robot>")
    file = folder / "cell.urdf"
    file.write_text(text, encoding="utf-8")
    return rp.Robot.load(file)


def railed(folder: Path) -> rp.Robot:
    """Load the welding robot with its feet on a rail."""
    text = WELD.read_text(encoding="utf-8").replace(
        '<joint name="bolts" type="fixed"><parent link="floor"/><child link="pedestal"/></joint>',
        '<joint name="rail" type="prismatic"><parent link="floor"/><child link="pedestal"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>',
    )
    file = folder / "railed.urdf"
    file.write_text(text, encoding="utf-8")
    return rp.Robot.load(file)


FEW = rp.FitOptions(samples=256, held_out=256)
EXAMPLES = {"rail_cell": ("rail", "prismatic", 8), "turntable_cell": ("a1", "revolute", 7)}


@pytest.mark.parametrize("name", some(EXAMPLES, next(iter(EXAMPLES))))
def test_the_example_cells_drift_under_the_usual_control_alone(name: str) -> None:
    """57.7: a rail and a turntable; a circle on the piece, three cycles."""
    joint, kind, n = EXAMPLES[name]
    task = rp.Robot.load(WELD.with_name(f"{name}.urdf")).task("nozzle", "pose", on="table")
    assert task.n == n
    assert task.revolute[task.joint_names.index(joint)] == (kind == "revolute")
    q0 = task.reference
    path, plain = rp.circle(task, q0, radius=0.06), rp.Pseudoinverse(task)
    design = rp.nearest_repeatable(plain, rp.Polynomial(q0, 1, 0.3), rp.Box(q0, 0.3), options=FEW)
    drifting = rp.follow(plain, path, q0, cycles=3, steps=100)
    closed = rp.follow(design.inverse, path, q0, cycles=3, steps=100)
    assert drifting.drift[-1] > 1e-3 and closed.drift.max() < 1e-8
    assert np.ptp(closed.q[:, [task.joint_names.index(j) for j in (joint, "turn")]], 0).min() > 0.01
    least = rp.least_closed_motion(task, path, q0, steps=60)
    own = rp.follow(design.inverse, path, q0, cycles=1, steps=60)
    assert 1 - 1e-9 <= own.rms_speed / least.rms_speed < 1.01


def panda_at_table(folder: Path) -> rp.Robot:
    panda = rp.Robot.load("panda").description
    return with_turntable(Path(panda.path).read_text("utf-8"), folder, "panda_link0", "0.6 0 0.1")


CELLS = {
    "arm and turntable": (panda_at_table, "panda_hand_tcp", "table", "pose"),
    "arm and positioner": (lambda _: rp.Robot.load(WELD), "torch", "workpiece", "axis"),
    "arm on a rail and positioner": (railed, "torch", "workpiece", "pose"),
    "arm on a rail and turntable": (
        lambda _: rp.Robot.load(WELD.with_name("rail_cell.urdf")),
        "nozzle",
        "table",
        "pose",
    ),
    "one arm carries the piece": (
        lambda _: rp.Robot.load("baxter"),
        "left_gripper",
        "right_gripper",
        "pose",
    ),
    "a humanoid turns a jar": (
        lambda _: rp.Robot.load("talos"),
        "gripper_left_base_link",
        "gripper_right_base_link",
        "position",
    ),
}


@pytest.mark.parametrize("name", CELLS)
def test_the_jacobian_is_the_slope_of_the_pose_on_the_workpiece(name: str, tmp_path: Path) -> None:
    """Independent oracle: X_w⁻¹ X_t from Pinocchio's tree of all joints, by finite differences."""
    load, frame, piece, kind = CELLS[name]
    robot = load(tmp_path)
    task = robot.task(frame, kind, on=piece)
    model, data = robot.model, robot.model.createData()
    ids = [model.getFrameId(link) for link in (piece, frame)]

    def pose(q: np.ndarray) -> pin.SE3:
        pin.framesForwardKinematics(model, data, robot.coupling.joints(task.to_robot(q)))
        work, tool = (data.oMf[i] for i in ids)
        return work.actInv(tool)

    rng = np.random.default_rng(7)
    low, high = np.maximum(task.lower, -1.0), np.minimum(task.upper, 1.0)
    step = 1e-6
    for q in rng.uniform(low, high, (4, task.n)):
        x = pose(q)
        assert np.allclose(task.placement(q).homogeneous, x.homogeneous, atol=1e-12)
        J = np.empty((6, task.n))
        for k, e in enumerate(np.eye(task.n)):
            a, b = pose(q - step * e), pose(q + step * e)
            J[:3, k] = (b.translation - a.translation) / (2 * step)
            J[3:, k] = pin.log3(b.rotation @ a.rotation.T) / (2 * step)
        twist = rng.normal(size=task.n)
        expected = task.task_velocity(q, J @ twist)
        apart = np.abs(task.jacobian(q) @ twist - expected).max()
        assert apart < 1e-8 * np.linalg.norm(twist)


def test_one_frame_with_a_base_is_the_task_on_it(tmp_path: Path) -> None:
    """The list of one frame, the option of the robot and the argument are one task."""
    robot = rp.Robot.load(WELD)
    on = robot.task("torch", "axis", on="workpiece")
    listed = robot.task([("torch", "axis", "workpiece")])
    loaded = rp.Robot.load(WELD, base="workpiece").task("torch", "axis")
    q = np.linspace(-0.4, 0.5, 8)
    assert on.joint_names[:2] == ("turn", "tilt") and (on.n, on.m, on.r) == (8, 5, 3)
    for other in (listed, loaded):
        assert other.joint_names == on.joint_names
        assert np.array_equal(other.jacobian(q), on.jacobian(q))
    assert str(on).startswith("torch relative to workpiece, axis")
    assert robot.base is None and str(robot.task("torch", "position")).startswith("torch, position")


def test_the_end_of_the_arm_is_found_beside_a_workpiece() -> None:
    """A link that the joints of the workpiece's branch alone move is no end effector on it."""
    assert rp.Robot.load(WELD, base="workpiece").default_frame == "torch"


def test_what_cannot_be_is_refused_by_name() -> None:
    robot = rp.Robot.load(WELD)
    with pytest.raises(rp.InputError, match="workpice.*did you mean 'workpiece'"):
        robot.task("torch", on="workpice")
    with pytest.raises(rp.InputError, match="no movable joint moves the link 'workpiece'"):
        robot.task("workpiece", on="workpiece")


def planar_cell(folder: Path) -> rp.Task:
    """Three links and a turntable in one plane: n = 4, m = 2."""
    robot = with_turntable(planar_urdf([0.5, 0.4, 0.3]), folder, "base", "0.6 0 0")
    return robot.task("tool", "xy", on="table")


Q0 = np.array([0.1, 0.4, 0.9, -0.5])


def test_a_path_on_a_turntable_closes_with_the_same_joints(tmp_path: Path) -> None:
    """J⁺ drifts, the nearest repeatable does not; the hand is on the path, which has moved."""
    task = planar_cell(tmp_path)
    plain = rp.Pseudoinverse(task)
    path = rp.circle(task, Q0, radius=0.08)
    design = rp.nearest_repeatable(plain, rp.Polynomial(Q0, 2, 0.5), rp.Box(Q0, 0.5), options=FEW)
    drifting = rp.follow(plain, path, Q0, cycles=3, steps=150)
    closed = rp.follow(design.inverse, path, Q0, cycles=3, steps=150)
    assert drifting.drift[-1] > 1e-3 and closed.drift.max() < 1e-9
    turned = closed.q[:, task.joint_names.index("turn")]
    assert np.ptp(turned) > 0.01  # the table takes part
    arm = [name for name in task.joint_names if name != "turn"]
    still = rp.Robot.load(tmp_path / "cell.urdf").task("tool", "xy", on="table", joints=arm)
    at_rest = rp.follow(
        rp.Pseudoinverse(still), rp.circle(still, Q0[1:], radius=0.08), Q0[1:], steps=150
    )
    assert closed.rms_speed < at_rest.rms_speed  # a trivial way: the table locked
    model, data = task.robot.model, task.robot.model.createData()
    for k in (40, 290):
        pin.framesForwardKinematics(model, data, task.to_robot(closed.q[k]))
        tool, table = (data.oMf[model.getFrameId(link)] for link in ("tool", "table"))
        wanted = path.placement((k % 150) / 150).translation[:2]
        assert np.allclose(table.actInv(tool).translation[:2], wanted, atol=1e-9)


@pytest.mark.slow
def test_a_saved_design_and_its_c_know_the_workpiece(tmp_path: Path) -> None:
    """The file names the workpiece; the exported C agrees with Python to rounding."""
    task = planar_cell(tmp_path)
    plain = rp.Pseudoinverse(task)
    design = rp.nearest_repeatable(plain, rp.Polynomial(Q0, 2, 0.5), rp.Box(Q0, 0.5), options=FEW)
    file = rp.save(design, tmp_path / "control.json")
    assert json.loads(file.read_text(encoding="utf-8"))["task"]["base"] == "table"
    again = rp.load_design(file, task)
    assert np.array_equal(again.inverse(Q0), design.inverse(Q0))
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc on this machine")
    rp.export_c(design.inverse, tmp_path / "c", "arm", region=design.region)
    build = ["gcc", "-O1", "-std=c99", "arm.c", "check.c", "-o", "check", "-lm"]
    subprocess.run(build, cwd=tmp_path / "c", check=True)
    said = subprocess.check_output(["./check"], cwd=tmp_path / "c", text=True)
    assert re.match(r"48 vectors, 0 differences", said)


def test_the_page_draws_the_path_on_the_workpiece(tmp_path: Path) -> None:
    """Law: at every shown moment the hand's trace lies on the path, moved as the workpiece is."""
    task = planar_cell(tmp_path)
    path = rp.circle(task, Q0, radius=0.08)
    motion = rp.follow(rp.Pseudoinverse(task), path, Q0, cycles=2, steps=60)
    page = rp.animation({"J⁺": motion}).save(tmp_path / "page.html")
    scene, _, numbers = page_file.read(page.read_text(encoding="utf-8"))
    (arm,) = scene["arms"]
    rows = scene["perCycle"] * len(scene["cycles"])
    assert arm["carried"] is True
    moving = sum(shape["pose"] is None for shape in arm["shapes"]) + 1
    poses = numbers[: rows * 7 * moving].reshape(rows, moving, 7)[:, -1]
    tips = numbers[rows * 7 * moving :][: 3 * rows].reshape(rows, 3)
    drawn = numbers[-3 * scene["paths"][0] - sum_of_joints(scene, task.n) :]
    drawn = drawn[: 3 * scene["paths"][0]].reshape(-1, 3)
    first = pin.SE3(task.robot.model.jointPlacements[task.robot.model.getJointId("turn")])
    turn = pin.SE3(pin.utils.rotate("z", Q0[task.joint_names.index("turn")]), np.zeros(3))
    expected = [(first * turn).act(p) for p in path.points()]
    assert np.allclose(drawn, expected, atol=1e-6)
    for pose, tip in zip(poses, tips, strict=True):
        moved = pin.XYZQUATToSE3(pose)
        there = np.array([moved.act(p) for p in drawn])
        assert np.linalg.norm(there - tip, axis=1).min() < 2e-3  # chords of the drawn circle
    assert np.ptp(poses, axis=0).max() > 0.01


def sum_of_joints(scene: dict, n: int) -> int:
    """Count the numbers of the joints' plot, which stand last."""
    held = scene["joints"]
    return 0 if held is None else n * held["perCycle"] * len(scene["cycles"])


@pytest.mark.slow
def test_a_function_on_the_workpiece_reaches_its_targets(tmp_path: Path) -> None:
    """F(x) places the tool at x on the table, and a governor at 20 Hz ends there."""
    task = planar_cell(tmp_path)
    cell = rp.Cell(task, task.placement(Q0), 0.05)
    design = rp.nearest_inverse_function(rp.Pseudoinverse(task), cell, posture=Q0)
    target = task.placement(Q0)
    target.translation += [0.03, -0.02, 0.0]
    q = design.function(target)
    assert np.abs(task.error(q, target)).max() < 1e-9
    governor = rp.Governor(design.inverse, 0.05, rp.Limits(acceleration=3.0, jerk=40.0))  # 20 Hz
    governor.start(design.function(task.placement(Q0)))
    for _ in range(200):
        now, _ = governor.step(target)
        assert task.limit_margin(now).min() > 0
    assert np.allclose(now, q, atol=1e-6)


@pytest.mark.slow
def test_the_command_takes_the_workpiece(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    planar_cell(tmp_path)
    monkeypatch.chdir(tmp_path)
    said = told(capsys, "check", "cell.urdf", "--on", "table", "--frame", "tool", "--task", "xy")
    assert "tool" in json.dumps(said)
    assert "did you mean" in refused(capsys, "check", "cell.urdf", "--on", "tabel")
    with pytest.raises(SystemExit):
        main(["check", "cell.urdf", "--on", "table", "--base", "base"])
    assert "--base and --on are mutually exclusive" in capsys.readouterr().err


@pytest.mark.slow
def test_a_joint_that_only_rounding_couples_to_the_task_is_held() -> None:
    """57.7: a6 turns the torch about its wire, up to the 4e-6 by which 1.5708 is not π/2."""
    task = rp.Robot.load(WELD).task("torch", "axis", on="workpiece")
    q0 = task.reference
    assert 0 < np.abs(task.jacobian(q0)[:, -1]).max() < 1e-5
    design = rp.nearest_inverse_function(
        rp.Pseudoinverse(task), rp.Cell(task, task.placement(q0), 0.02), posture=q0, degree=2
    )
    target = task.placement(q0)
    target.translation += [0.015, -0.02, 0.02]
    q = design.function(target)
    assert design.coverage == 1 and design.extra_speed < 1e-3
    assert np.abs(task.error(q, target)).max() < 1e-9 and abs(q[-1]) < 1


def test_the_largest_sector_on_a_workpiece_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """57.6: the floods of the arm and the table did not end in 280 s."""
    monkeypatch.chdir(tmp_path)
    command = ("cell", str(WELD), "--frame", "torch", "--task", "axis", "--down")
    said = refused(capsys, *command, "--on", "workpiece")
    assert "joints of the task move the link 'workpiece'" in said and "size" in said
    task = rp.Robot.load(WELD).task("torch", "axis", on="workpiece")
    with pytest.raises(rp.InputError, match="give the size of a box"):
        rp.best_cell(task, orientation="down")


@NEEDS_C
def test_a_cell_on_a_workpiece_in_c_on_the_move_and_in_the_node() -> None:
    """57.6: F of C and of NumPy, motions through poses, and the ROS 2 node's states."""
    F = on_a_workpiece()
    slow, rng, limits = f_in_numpy(F), np.random.default_rng(5), rp.Limits(acceleration=4.0)
    U = 0.8 * F.cell.sample(8, 3)
    poses = [F.cell.at(u) for u in U]
    for x, leaf in zip(poses, 0.03 * rng.normal(size=(8, 2)), strict=False):
        assert np.abs(F(x, leaf=leaf) - slow(x, leaf=leaf)).max() < 1e-10
        assert np.abs(F.task.error(F(x), x)).max() < 1e-12
    moved = rp.motion_between(F, poses[:4], limits, blend=0.02)
    X = np.array([F.task.placement(q).homogeneous for q in moved.q[::29]])
    assert np.abs(F.batch(X) - moved.q[::29]).max() < 1e-11
    assert np.ptp(moved.q[:, :2], axis=0).min() > 0.01  # turn and tilt take part
    design = rp.CellDesign.__new__(rp.CellDesign)
    object.__setattr__(design, "function", F)
    servo, q, now = Servo(design, 100.0, limits), F(poses[0]), 0.0
    assert servo.base == "workpiece"
    for k in range(300):
        now += 0.01
        servo.joints(dict(zip(F.task.joint_names, q, strict=True)), now)
        if k == 20:
            turn = pin.Quaternion(poses[1].rotation).coeffs()
            servo.pose(poses[1].translation, turn, frame="workpiece")
        sent = servo.tick(now)
        q = q if sent is None else sent
    assert servo.said == "running" and np.abs(q - F(poses[1])).max() < 1e-9
    servo.pose(poses[1].translation, (0, 0, 0, 1), frame="floor")
    assert "it is in frame 'floor', not in 'workpiece'" in servo.said
