"""The catalogue: every robot passes the gatekeeper, builds, and has the frames and the pose it
promises."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from arms import KINDS, catalogue
from controls import some
from lxml import etree
from numpy.typing import NDArray

import repctl_pin as rp
from repctl_pin.model.catalogue import reference_posture

NAMES = list(catalogue())
PLANAR = {
    "planar3r": (1, 1, 1),
    "planar4r": (1, 0.8, 0.7, 0.5),
    "planar7r": (0.7, 0.6, 0.5, 0.45, 0.4, 0.3, 0.25),
}
# joints of the chain to the default frame
JOINTS = {
    "ppr": 3,
    "prr": 3,
    "planar3r": 3,
    "planar4r": 4,
    "planar7r": 7,
    "panda": 7,
    "xarm7": 7,
    "baxter": 7,
    "tiago": 8,
    "tiago_dual": 8,
    "tiago_pro": 8,
    "pr2": 8,
    "talos": 9,
    "kinova": 6,
    "ur3": 6,
    "ur5": 6,
    "ur10": 6,
    "z1": 6,
    "so100": 5,
    "so101": 5,
    "romeo": 8,
    "icub": 10,
    "g1": 10,
    "centauro": 7,
    "anymal_kinova": 6,
    "b1_z1": 6,
}


@pytest.mark.parametrize("name", some(catalogue(), *KINDS))
def test_every_robot_is_what_it_promises(name: str) -> None:
    machine = rp.Robot.load(name)
    entry, row = machine.entry, catalogue()[name]
    assert entry is not None and entry.name == machine.name == name
    assert list(entry.frames) == row["frames"] and str(entry.urdf).endswith(row["urdf"])
    d = machine.description
    model = pin.buildModelFromXML(d.xml)
    assert model.nq == model.nv > 0
    first, *others = machine.joint_names
    assert rp.Robot.load(name, lock=others).joint_names == (first,)
    assert entry.frames and set(entry.frames) <= set(d.links)
    for frame in entry.frames:
        task = machine.task(frame, "xy" if "planar" in entry.note else "position")
        assert task.n == JOINTS.get(name, task.n) or frame != entry.frames[0]
        # one of its poses is away from singularities of the frame's position and leaves the arm
        # room to move
        poses = [task.from_robot(pose) for pose in machine.poses.values()]
        dexterous = [np.linalg.svd(task.jacobian(q), compute_uv=False)[-1] > 0.07 for q in poses]
        roomy = [np.minimum(q - task.lower, task.upper - q).min() > 0.08 for q in poses]
        assert any(a and b for a, b in zip(dexterous, roomy, strict=True)), frame


@pytest.mark.parametrize(
    "name", some([name for name, row in catalogue().items() if "posture" in row], *KINDS)
)
def test_reference_poses_are_the_srdfs_inside_the_limits(name: str) -> None:
    machine = rp.Robot.load(name)
    values = dict(zip(machine.joint_names, machine.reference, strict=True))
    pose = written_pose(machine)
    known = [j for j in pose if j in values]
    assert known
    moved = [j for j in known if not np.isclose(values[j], pose[j], atol=1e-3)]
    told = " ".join(machine.warnings)
    # what was outside its limits was moved inside, and is said
    assert all(f"{j} = " in told for j in moved)
    assert len(moved) < len(known)
    for pose_of_all in machine.poses.values():
        assert (pose_of_all >= machine.lower).all() and (pose_of_all <= machine.upper).all()


def written_pose(machine: rp.Robot) -> dict[str, float]:
    """The pose of the catalogue as the SRDF has it, by joint; without that of a floating base."""
    entry = machine.entry
    assert entry is not None and entry.srdf is not None
    states = etree.parse(str(entry.srdf)).getroot().iter("group_state")
    for state in states:
        joints = [j for j in state.iter("joint") if len(j.get("value").split()) == 1]
        if joints and entry.posture in (None, state.get("name")):
            return {j.get("name").split("/")[-1]: float(j.get("value")) for j in joints}
    raise AssertionError(f"no pose {entry.posture} in {entry.srdf}")


def test_a_full_turn_is_taken_before_a_limit() -> None:
    kinova = rp.Robot.load("kinova")
    assert kinova.entry is not None and kinova.entry.posture == "arm_up"
    pose = written_pose(kinova)
    turned = kinova.reference[2] - pose["j2s6s200_joint_3"]
    assert np.isclose(turned, 2 * np.pi) and "joint_3" in " ".join(kinova.warnings)


def test_names_and_aliases() -> None:
    words = [word for name, row in catalogue().items() for word in (name, *row.get("aliases", ()))]
    assert len(set(words)) == len(words)
    assert all(word == word.lower() for word in words)
    for word in ("talos_full_v2", " Talos "):
        assert rp.Robot.load(word).entry == rp.Robot.load("talos").entry
    tiago = rp.Robot.load("tiago_no_hand").description.path
    assert tiago.name == "tiago_no_hand.urdf"
    assert rp.Robot.load("baxter").offered_frames == ("left_gripper", "right_gripper")
    with pytest.raises(
        rp.InputError, match=r"no robot 'pandda'; did you mean 'panda'.*repctl robots"
    ):
        rp.Robot.load("pandda")


@pytest.mark.parametrize("name", some(["panda", "talos", "so100", "planar3r"], "so100", "planar3r"))
def test_meshes_are_found(name: str) -> None:
    machine = rp.Robot.load(name)
    assert machine.warnings == ()
    description = machine.description
    model = pin.buildModelFromXML(description.xml)
    file, paths = str(description.path), [*machine.package_dirs]
    geometry = pin.buildGeomFromUrdf(model, file, pin.VISUAL, package_dirs=paths)
    assert geometry.ngeoms >= 5
    assert all(
        Path(g.meshPath).is_file() or g.meshPath in ("BOX", "CYLINDER", "SPHERE")
        for g in geometry.geometryObjects
    )


def position(name: str) -> tuple[pin.Model, Callable[[NDArray[np.float64]], NDArray[np.float64]]]:
    model = pin.buildModelFromXML(rp.Robot.load(name).description.xml)
    data, tool = model.createData(), model.getFrameId("tool", pin.FrameType.BODY)

    def tip(q: NDArray[np.float64]) -> NDArray[np.float64]:
        pin.framesForwardKinematics(model, data, q)
        return data.oMf[tool].translation.copy()

    return model, tip


def samples(model: pin.Model) -> NDArray[np.float64]:
    return np.random.default_rng(5).uniform(
        model.lowerPositionLimit, model.upperPositionLimit, (50, model.nq)
    )


@pytest.mark.parametrize("name", PLANAR)
def test_planar_chains_closed_form(name: str) -> None:
    model, tip = position(name)
    lengths = np.array(PLANAR[name])
    for q in samples(model):
        absolute = np.cumsum(q)
        expected = [lengths @ np.cos(absolute), lengths @ np.sin(absolute), 0.0]
        np.testing.assert_allclose(tip(q), expected, rtol=0, atol=1e-12)


def test_ppr_closed_form() -> None:
    """x = (d₁ + cos θ₃, d₂ + sin θ₃): the paper's Fig. 3, (39)."""
    model, tip = position("ppr")
    assert tuple(model.names)[1:] == ("d1", "d2", "theta3")
    np.testing.assert_array_equal(tip(np.zeros(3)), [1, 0, 0])
    for q in samples(model):
        expected = [q[0] + np.cos(q[2]), q[1] + np.sin(q[2]), 0.0]
        np.testing.assert_allclose(tip(q), expected, rtol=0, atol=1e-12)


def test_prr_closed_form() -> None:
    """x = (d₁ + cos ψ₂ + cos ψ₃, sin ψ₂ + sin ψ₃) with ψ₂ = θ₂, ψ₃ = θ₂ + θ₃: the paper's Fig. 1,
    (10)."""
    model, tip = position("prr")
    for q in samples(model):
        psi = q[1], q[1] + q[2]
        expected = [q[0] + np.cos(psi[0]) + np.cos(psi[1]), np.sin(psi[0]) + np.sin(psi[1]), 0.0]
        np.testing.assert_allclose(tip(q), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["ppr", "prr", *PLANAR])
def test_planar_arms_have_room_and_mass(name: str) -> None:
    d = rp.Robot.load(name).description
    moving = [j for j in d.joints if j.kind != "fixed"]
    assert all(-j.lower == j.upper >= (5 if j.kind == "prismatic" else 2 * np.pi) for j in moving)
    assert all(np.isfinite(j.velocity) for j in moving)
    assert d.notes == () and d.meshes == ()
    model = pin.buildModelFromXML(d.xml)
    M = pin.crba(model, model.createData(), np.full(model.nq, 0.3))
    M = np.triu(M) + np.triu(M, 1).T
    assert np.linalg.eigvalsh(M)[0] > 1e-3  # fit for an inertia-weighted inverse


def test_poses_are_read_as_they_stand(tmp_path: Path) -> None:
    path = tmp_path / "r.srdf"
    states = """<robot name="r">
    <group_state name="none" group="g"/>
    <group_state name="up" group="g">
      <joint name="root_joint" value="0. 0. 1. 0. 0. 0. 1."/> <joint name="r/j1" value=" 0.5 "/>
      <!-- turned --> <joint name="j2" value="-1e-1"/>
    </group_state>
    <group_state name="bad" group="g"><joint name="j1" value="nan"/></group_state></robot>"""
    path.write_text(states)
    assert reference_posture(path) == reference_posture(path, "up") == {"j1": 0.5, "j2": -0.1}
    with pytest.raises(
        rp.InputError, match=r"no group_state in .*r\.srdf 'upp'; did you mean 'up'"
    ):
        reference_posture(path, "upp")
    with pytest.raises(rp.InputError, match="j1 = 'nan' is not a finite number"):
        reference_posture(path, "bad")
    for content in (
        "<robot",
        '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/hostname">]><robot>&a;</robot>',
        "<robot/>",
    ):
        path.write_text(content)
        with pytest.raises(rp.InputError):
            reference_posture(path)
    with pytest.raises(rp.InputError, match="cannot be read"):
        reference_posture(tmp_path / "nowhere.srdf")


def test_package_dirs_of_a_persons_own_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    urdf = tmp_path / "ws" / "my_arm" / "urdf" / "arm.urdf"
    urdf.parent.mkdir(parents=True)
    for folder in ("ros/pkg", "ament/share"):
        (tmp_path / folder).mkdir(parents=True)
    monkeypatch.setenv(
        "ROS_PACKAGE_PATH", os.pathsep.join([str(tmp_path / "ros" / "pkg"), "/not/there"])
    )
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ament"))
    urdf.write_text('<robot name="arm"><link name="base"/></robot>')
    dirs = list(rp.Robot.load(urdf).package_dirs)
    ws = [str(p) for p in (urdf.parent, urdf.parents[1], urdf.parents[2])]
    assert dirs[:3] == ws  # the third resolves package://my_arm/
    assert [str(tmp_path / p) for p in ("ros/pkg", "ros", "ament/share")] == dirs[-3:]


def test_a_package_dir_that_is_not_there_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for folder in ("nowhere", "file"):
        for name in ("planar3r", rp.Robot.load("planar3r").description.path):
            with pytest.raises(
                rp.InputError, match=f"^package_dirs: there is no folder '.*{folder}'"
            ):
                rp.Robot.load(name, package_dirs=[tmp_path, tmp_path / folder])
    assert rp.Robot.load("planar3r", package_dirs=str(tmp_path)).package_dirs == (str(tmp_path),)


@pytest.mark.parametrize(
    ("typed", "near"),
    [
        ("x", "did you mean 'xarm7'?"),
        # an alias is understood; the name is what is shown
        ("franka emika", "did you mean 'panda'?"),
        ("talos_full", "did you mean 'talos' or 'talos_left_arm'?"),
        ("grip", "did you mean 'ur3_gripper' or 'ur5_gripper'?"),
        ("abb", f"there are {len(catalogue())}, such as ppr, prr, planar3r"),
    ],
)
def test_robots_near_to_what_was_typed_are_named(typed: str, near: str) -> None:
    with pytest.raises(rp.InputError) as error:
        rp.Robot.load(typed)
    assert str(error.value).startswith(f"no robot {typed!r}; {near}")
    shown = re.findall(r"'(\w+)'", near)
    assert all(word in NAMES for word in shown)


@pytest.mark.parametrize(
    ("typed", "near"),
    [
        ("tcp", "did you mean 'panda_hand_tcp'?"),
        ("panda_hnad", "did you mean 'panda_hand'"),
        ("nope", "there are 13, such as panda_hand_tcp, panda_hand, panda_link8, panda_link7, "),
    ],
)
def test_frames_at_the_ends_of_arms_are_named_where_none_is_near(typed: str, near: str) -> None:
    with pytest.raises(rp.InputError) as error:
        rp.Robot.load("panda").task(typed)
    assert str(error.value).startswith(f"no frame {typed!r}; {near}")
    with pytest.raises(
        rp.InputError,
        match="no frame 'nope'; choose from tool, link4, base, .*link1, link2, link3$",
    ):
        rp.Robot.load("planar4r").task("nope")


WITHOUT_DATA = """
import sys
import repctl_pin as rp
rp.Robot.load("planar3r")
sys.path[:], sys.prefix = [], "/nowhere"  # all that is needed is imported
print(rp.Robot.load("planar4r").name)
try:
    rp.Robot.load("panda")
except rp.InputError as error:
    print(error)
"""


def test_without_the_data_only_our_own_arms() -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_DATA], capture_output=True, text=True, check=True
    )
    name, refusal = done.stdout.splitlines()
    assert name == "planar4r"
    assert "run `pip install 'example-robot-data" in refusal
