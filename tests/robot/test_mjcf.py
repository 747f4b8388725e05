"""MJCF files, and models that MuJoCo or yourdfpy have loaded: the same arm, to 1e-12."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import repctl_pin as rp

PANDA = """
<mujoco model="arm">
  <compiler angle="radian" autolimits="true"/>
  <default>
    <default class="arm">
      <joint axis="0 0 1" range="-2.8973 2.8973"/>
      <default class="finger"><joint axis="0 1 0" type="slide" range="0 0.04"/></default>
    </default>
  </default>
  <worldbody>
    <geom type="plane" size="1 1 0.1"/>
    <body name="link0" childclass="arm">
      <inertial mass="0.6" pos="-0.041 0 0.05" diaginertia="0.003 0.004 0.005"/>
      <geom type="capsule" size="0.06 0.1" pos="0 0 0.1"/>
      <body name="link1" pos="0 0 0.333">
        <inertial mass="5" pos="0.004 0.002 -0.05" diaginertia="0.7 0.7 0.01"/>
        <joint name="joint1"/>
        <body name="link2" quat="1 -1 0 0">
          <inertial mass="0.6" pos="0 -0.03 0" diaginertia="0.008 0.03 0.03"/>
          <joint name="joint2" range="-1.7628 1.7628"/>
          <body name="link3" pos="0 -0.316 0" quat="1 1 0 0">
            <inertial mass="3.2" pos="0.03 0.04 -0.07" diaginertia="0.04 0.04 0.01"/>
            <joint name="joint3"/>
            <body name="link4" pos="0.0825 0 0" quat="1 1 0 0">
              <inertial mass="3.6" pos="-0.05 0.1 0.03" diaginertia="0.03 0.02 0.03"/>
              <joint name="joint4" range="-3.0718 -0.0698"/>
              <geom type="box" size="0.03 0.04 0.05"/>
              <body name="link5" pos="-0.0825 0.384 0" quat="1 -1 0 0">
                <inertial mass="1.2" pos="-0.01 0.04 -0.04" diaginertia="0.04 0.03 0.01"/>
                <joint name="joint5"/>
                <body name="link6" quat="1 1 0 0">
                  <inertial mass="1.7" pos="0.06 -0.01 -0.01" diaginertia="0.002 0.004 0.005"/>
                  <joint name="joint6" range="-0.0175 3.7525"/>
                  <body name="link7" pos="0.088 0 0" quat="1 1 0 0">
                    <inertial mass="0.7" pos="0.01 0 0.06" diaginertia="0.01 0.01 0.005"/>
                    <joint name="joint7"/>
                    <body name="hand" pos="0 0 0.107" quat="0.9238795 0 0 -0.3826834">
                      <inertial mass="0.73" pos="-0.01 0 0.03" diaginertia="0.001 0.0025 0.0017"/>
                      <site name="tcp" pos="0 0 0.1034"/>
                      FINGERS
                    </body>
                  </body>
                </body>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  REST
</mujoco>
"""
FINGERS = """
<body name="left" pos="0 0 0.0584"><inertial mass="0.01" pos="0 0 0" diaginertia="1e-5 1e-5 1e-5"/>
  <joint name="finger1" class="finger"/></body>
<body name="right" pos="0 0 0.0584" quat="0 0 0 1">
  <inertial mass="0.01" pos="0 0 0" diaginertia="1e-5 1e-5 1e-5"/>
  <joint name="finger2" class="finger"/></body>"""
COUPLED = """
<tendon><fixed name="split"><joint joint="finger1" coef="0.5"/></fixed></tendon>
<equality><joint joint1="finger1" joint2="finger2"/></equality>"""
ODD = """
<mujoco model="odd"><worldbody>
  <body name="base" pos="0.1 0.2 0.3" euler="10 20 30">
    <joint name="x" type="slide" axis="1 1 0" range="-1 1" ref="0.2"/>
    <joint name="turn" axis="0 0 1" pos="0.1 0 0.05"/>
    <geom size="0.1"/>
    <body name="upper" pos="0 0 0.3" axisangle="0 1 0 35">
      <joint name="a" axis="0 1 0.2" range="-90 120" ref="15" pos="0 0.1 -0.05"/>
      <geom type="cylinder" size="0.05 0.1" contype="0" conaffinity="0"/>
      <frame pos="0 0 0.1" euler="0 0 40">
        <body name="fore" pos="0 0 0.3"><joint name="b" axis="1 0 0"/>
          <geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.04"/>
          <body name="palm" pos="0 0 0.2" xyaxes="0 1 0 -1 0 0">
            <joint name="c" axis="0 0 1"/><joint name="d" axis="0 1 0" pos="0 0 0.1"/>
            <joint name="e" axis="1 0 0"/><geom size="0.03"/><site name="grasp" pos="0.01 0 0.1"/>
          </body>
        </body>
      </frame>
    </body>
  </body>
</worldbody></mujoco>"""


@pytest.fixture
def mujoco() -> Any:
    return pytest.importorskip("mujoco")


def written(folder: Path, text: str, fingers: str = "", rest: str = "") -> Path:
    path = folder / "arm.xml"
    path.write_text(text.replace("FINGERS", fingers).replace("REST", rest), "utf-8")
    return path


def agree(robot: rp.Robot, model: Any, mujoco: Any, at: str, site: str = "") -> None:
    """J, pose and limits of a frame are those of MuJoCo, at random configurations."""
    task = robot.task(site or at, "pose")
    data = mujoco.MjData(model)
    ids = [model.joint(name).id for name in task.joint_names]
    limited = model.jnt_limited[ids].astype(bool)
    assert np.array_equal(task.lower, np.where(limited, model.jnt_range[ids, 0], -np.inf))
    assert np.array_equal(task.upper, np.where(limited, model.jnt_range[ids, 1], np.inf))
    for q in np.random.default_rng(0).uniform(-1.5, 1.5, (20, task.n)):
        data.qpos[model.jnt_qposadr[ids]] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        J = np.zeros((6, model.nv))
        if site:
            k = model.site(site).id
            mujoco.mj_jacSite(model, data, J[:3], J[3:], k)
            p, R = data.site_xpos[k], data.site_xmat[k]
        else:
            k = model.body(at).id
            mujoco.mj_jacBody(model, data, J[:3], J[3:], k)
            p, R = data.xpos[k], data.xmat[k]
        x = task.placement(q)
        assert np.abs(x.translation - p).max() < 1e-12
        assert np.abs(x.rotation - R.reshape(3, 3)).max() < 1e-12
        assert np.abs(task.jacobian(q) - J[:, model.jnt_dofadr[ids]]).max() < 1e-12


@pytest.mark.parametrize(("text", "body", "site"), [(PANDA, "hand", "tcp"), (ODD, "palm", "grasp")])
def test_it_has_the_jacobian_of_mujoco(
    text: str, body: str, site: str, tmp_path: Path, mujoco: Any
) -> None:
    """Default classes, degrees, references, anchors, frames, several joints of one body."""
    path = written(tmp_path, text)
    model = mujoco.MjModel.from_xml_path(str(path))
    for robot in (rp.Robot.load(path), rp.Robot.load(model)):
        agree(robot, model, mujoco, body)
        agree(robot, model, mujoco, body, site)


def test_it_is_the_panda_of_the_catalogue(tmp_path: Path, panda: rp.Robot, mujoco: Any) -> None:
    """The file has its rounded hand: the flange is that of the URDF."""
    one = rp.Robot.load(written(tmp_path, PANDA)).task("link7")
    other = panda.task("panda_link7")
    for q in np.random.default_rng(1).uniform(-1, 1, (10, 7)):
        assert np.abs(one.jacobian(q) - other.jacobian(q)).max() < 1e-12


def test_masses_and_shapes_are_those_of_mujoco(tmp_path: Path, mujoco: Any) -> None:
    path = written(tmp_path, PANDA)
    model = mujoco.MjModel.from_xml_path(str(path))
    task = rp.Robot.load(path).task("tcp")
    data, M = mujoco.MjData(model), np.zeros((7, 7))
    q = np.array([0.1, -0.5, 0.2, -2.0, 0.3, 1.5, 0.7])
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    if hasattr(data, "M"):
        mujoco.mj_fullM(model, data, M)
    else:
        mujoco.mj_fullM(model, M, data.qM)
    assert np.allclose(task.inertias(q[None])[0], M, atol=1e-10)
    kinds = [shape.kind for shape in task.robot.description.collisions]
    assert sorted(kinds) == ["box", "capsule"]


def test_the_fingers_of_a_gripper_are_coupled(tmp_path: Path, mujoco: Any) -> None:
    robot = rp.Robot.load(written(tmp_path, PANDA, FINGERS, COUPLED))
    assert robot.joints["finger1"].mimic == "finger2"
    assert "finger1" not in robot.joint_names and "finger2" in robot.joint_names
    assert any("tendon" in note for note in robot.description.notes)


def test_a_weld_to_a_target_of_the_user_is_left_out(tmp_path: Path, mujoco: Any) -> None:
    """Learning environments pull the hand to a mocap body, which closes no loop."""
    target = '<body name="goal" mocap="true"><site name="aim"/></body>'
    text = PANDA.replace("<worldbody>", f"<worldbody>{target}")
    for weld in ('body1="goal" body2="hand"', 'site1="aim" site2="tcp"'):
        rest = f"<equality><weld {weld}/></equality>"
        robot = rp.Robot.load(written(tmp_path, text, rest=rest))
        assert robot.task("tcp").n == 7
        assert any("mocap body" in note for note in robot.description.notes)


def test_mjcf_has_no_speed_limits_and_no_words_about_them(tmp_path: Path, mujoco: Any) -> None:
    robot = rp.Robot.load(written(tmp_path, PANDA))
    assert np.isinf(robot.task("tcp").velocity_limit).all()
    assert not any("speed" in note for note in robot.description.notes)


def test_an_included_file_is_read(tmp_path: Path, mujoco: Any) -> None:
    written(tmp_path, PANDA)
    scene = tmp_path / "scene.xml"
    scene.write_text('<mujoco><include file="arm.xml"/></mujoco>', "utf-8")
    assert rp.Robot.load(scene).task("tcp").n == 7


def test_a_study_runs_on_it(tmp_path: Path, mujoco: Any) -> None:
    task = rp.Robot.load(written(tmp_path, PANDA)).task("tcp", "pose")
    q0 = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
    few = rp.FitOptions(samples=256, held_out=128)
    box = rp.Box(q0, 0.3)
    design = rp.nearest_repeatable(rp.Pseudoinverse(task), None, box, degree=1, options=few)
    motion = rp.follow(design.inverse, rp.circle(task, q0, 0.05), q0, cycles=2)
    assert motion.drift[-1] < 1e-9


WELD = '<equality><weld name="loop" body1="hand" body2="link0"/></equality>'
CURVED = (
    '<equality><joint name="odd" joint1="joint1" joint2="joint2" polycoef="0 1 1 0 0"/></equality>'
)


@pytest.mark.parametrize(
    ("fingers", "rest", "said"),
    [
        ("", WELD, r"'loop' \(weld\) closes a loop"),
        ("", CURVED, "'odd' is not linear, q₁ = a₀"),
        ("<body><joint/></body>", "", "MuJoCo cannot compile the file"),
    ],
)
def test_what_is_not_supported_is_said_in_one_line(
    fingers: str, rest: str, said: str, tmp_path: Path, mujoco: Any
) -> None:
    path = written(tmp_path, PANDA, fingers, rest)
    with pytest.raises(rp.UrdfError, match=said) as found:
        rp.Robot.load(path)
    assert "\n" not in str(found.value) and "arm.xml" in str(found.value)


def test_a_ball_joint_beyond_the_tool_is_three(tmp_path: Path, mujoco: Any) -> None:
    """26.13: the same pose as MuJoCo's, and the arm keeps its seven joints."""
    ball = (
        '<body name="bob" pos="0.1 0 0">'
        '<joint type="ball" name="wrist" pos="0 0.02 0" range="0 1"/>'
        '<geom size="0.1"/></body>'
    )
    path = written(tmp_path, PANDA, ball)
    robot = rp.Robot.load(path)
    assert robot.task("tcp").n == 7
    assert any("range of ball joint 'wrist'" in note for note in robot.description.notes)
    model = mujoco.MjModel.from_xml_path(str(path))
    data, task = mujoco.MjData(model), robot.task("bob")
    q = np.r_[0.1, -0.5, 0.2, -2.0, 0.3, 1.5, 0.7, 0.4, -0.3, 0.2]
    x, y, z, w = pin.Quaternion(pin.rpy.rpyToMatrix(0.2, -0.3, 0.4)).coeffs()
    data.qpos[:7] = q[:7]
    data.joint("wrist").qpos[:] = [w, x, y, z]
    mujoco.mj_forward(model, data)
    assert task.joint_names[7:] == ("wrist_yaw", "wrist_pitch", "wrist_roll")
    place = task.placement(q)
    assert np.allclose(place.translation, data.body("bob").xpos, atol=1e-12)
    assert np.allclose(place.rotation, data.body("bob").xmat.reshape(3, 3), atol=1e-12)


def test_without_mujoco_the_remedy_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name, *rest: None if name == "mujoco" else find(name, *rest),
    )
    with pytest.raises(rp.UrdfError, match="pip install mujoco"):
        rp.Robot.load(written(tmp_path, PANDA))


def test_a_urdf_of_yourdfpy_is_taken(tmp_path: Path, panda: rp.Robot) -> None:
    """Loaded by yourdfpy and edited in Python: the same kinematics, with the edit."""
    yourdfpy = pytest.importorskip("yourdfpy")
    given = yourdfpy.URDF.load(
        str(panda.description.path), load_meshes=False, build_scene_graph=False
    )
    q = panda.task().reference
    robot = rp.Robot.load(given)
    assert np.allclose(
        robot.task("panda_hand_tcp").jacobian(q), panda.task().jacobian(q), atol=1e-12
    )
    joint = next(j for j in given.robot.joints if j.name == "panda_hand_tcp_joint")
    joint.origin = pin.SE3(np.eye(3), np.array([0, 0, 0.2])).homogeneous
    longer = rp.Robot.load(given).task("panda_hand_tcp").placement(q)
    moved = panda.task().placement(q).actInv(longer)
    assert np.allclose(moved.translation, [0, 0, 0.2 - 0.1034], atol=1e-12)


def test_mesh_files_are_where_mujoco_has_them(tmp_path: Path, mujoco: Any) -> None:
    """A mesh that is not at its own centre: its corners, by our placement, are MuJoCo's."""
    trimesh = pytest.importorskip("trimesh")
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3.0]])
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    (tmp_path / "assets").mkdir()
    trimesh.Trimesh(corners, faces).export(tmp_path / "assets" / "wedge.stl")
    text = """<mujoco model="m"><compiler meshdir="assets"/>
      <asset><mesh name="w" file="wedge.stl" scale="0.1 0.1 0.1"/></asset>
      <worldbody><body name="b" pos="0 0 1"><joint name="j" axis="0 0 1"/>
      <geom type="mesh" mesh="w" pos="0.1 0.2 0.3" euler="20 30 40"/></body></worldbody></mujoco>"""
    path = written(tmp_path, text)
    (shape,) = rp.Robot.load(path).description.collisions
    assert Path(shape.filename) == tmp_path / "assets" / "wedge.stl"
    place = pin.SE3(pin.rpy.rpyToMatrix(*shape.rpy), np.array(shape.xyz))
    own = [place * corner for corner in np.array(shape.scale) * corners]
    model = mujoco.MjModel.from_xml_path(str(path))
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[0])
    theirs = model.mesh_vert @ turn.reshape(3, 3).T + model.geom_pos[0]
    away = np.linalg.norm(np.array(own)[:, None] - theirs[None], axis=2)
    assert away.min(axis=1).max() < 1e-6
