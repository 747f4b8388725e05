"""Recordings that cannot be right are refused in one line, which names the cause."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import repctl_pin as rp

K = 60


@pytest.fixture(scope="module")
def joints() -> np.ndarray:
    s = np.linspace(0, 6, K)[:, None]
    middle = [0.1, -0.8, 0.2, -2.3, 0.3, 1.6, 0.8]
    return middle + 0.1 * np.sin(s * np.arange(1, 8))


@pytest.fixture(scope="module")
def poses(panda_pose: rp.Task, joints: np.ndarray) -> np.ndarray:
    """Positions and quaternions, (K, 7)."""
    return np.array([pin.SE3ToXYZQUAT(panda_pose.placement(q)) for q in joints])


def refused(task: rp.Task, **arguments: Any) -> str:
    with pytest.raises(rp.InputError) as caught:
        rp.Recording(task, **arguments)
    text = str(caught.value)
    assert "\n" not in text and len(text) < 260, text
    return text


def test_right_recordings_are_taken(
    panda_pose: rp.Task, joints: np.ndarray, poses: np.ndarray
) -> None:
    noisy = poses * [1, 1, 1, 1.004, 1.004, 1.004, 1.004] + [1e-3, 0, 0, 0, 0, 0, 0]
    made = rp.Recording(panda_pose, joints=joints, poses=noisy)
    assert np.abs(made.rotations @ made.rotations.swapaxes(1, 2) - np.eye(3)).max() < 1e-12
    matrices = rp.Recording(panda_pose, poses=made.homogeneous.astype(np.float32))
    assert np.abs(matrices.rotations - made.rotations).max() < 1e-6


def test_units_are_suspected(panda_pose: rp.Task, joints: np.ndarray, poses: np.ndarray) -> None:
    thousand = np.where(np.arange(7) < 3, 1000.0, 1.0)
    text = refused(panda_pose, poses=poses * thousand)
    assert "they look like millimetres; divide them by 1000" in text
    assert "the arm reaches" in refused(panda_pose, poses=poses * thousand**4)
    text = refused(panda_pose, joints=np.degrees(joints))
    assert "fit their limits only as degrees; convert them to rad" in text


def test_quaternions_that_are_none_are_refused(
    panda_pose: rp.Task, joints: np.ndarray, poses: np.ndarray
) -> None:
    wrong = poses.copy()
    wrong[17, 3:] *= 1.3
    with pytest.raises(rp.InputError, match=r"the quaternion has length 1\.3, not 1") as caught:
        rp.Recording(panda_pose, poses=wrong)
    assert caught.value.at == 17
    rolled = poses[:, [0, 1, 2, 6, 3, 4, 5]]
    text = refused(panda_pose, joints=joints, poses=rolled)
    assert "the quaternions begin with qw; give qx, qy, qz, qw" in text
    mirrored = np.tile(np.diag([1.0, 1, -1, 1]), (K, 1, 1))
    assert "the matrix is not a rotation" in refused(panda_pose, poses=mirrored)


@pytest.mark.parametrize(
    "order", [[6, 5, 4, 3, 2, 1, 0], [1, 2, 3, 4, 5, 6, 0], [0, 2, 1, 3, 4, 5, 6]]
)
def test_another_order_of_the_joints_is_found(
    order: list[int], panda_pose: rp.Task, joints: np.ndarray, poses: np.ndarray
) -> None:
    text = refused(panda_pose, joints=joints[:, order], poses=poses)
    assert "the joints are in another order; give them in the order panda_joint1, " in text


def test_without_poses_limits_show_another_order(panda_pose: rp.Task, joints: np.ndarray) -> None:
    text = refused(panda_pose, joints=joints[:, ::-1])
    fits = "the values fit in another order of the joints; give the joints in the order "
    assert f"is outside its limits in 100 % of the frames; {fits}panda_joint1, " in text
    wild = joints.copy()
    wild[:, [1, 3]] = 2.5  # no joint but four has such angles, and no order
    text = refused(panda_pose, joints=wild)
    assert "order" not in text and "; check that these are the joints panda_joint1, " in text


def test_poses_of_another_arm_are_no_other_base(
    panda_pose: rp.Task, joints: np.ndarray, poses: np.ndarray
) -> None:
    """Issue 52, item 26.22: the best base or tool explains little; ten random recordings."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        text = refused(panda_pose, joints=joints[rng.permutation(K)], poses=poses)
        assert "do not belong to these joints" in text and "base frame" not in text


def test_poses_of_another_frame_or_base_are_recognised(
    panda_pose: rp.Task, joints: np.ndarray, poses: np.ndarray
) -> None:
    moved = pin.SE3(pin.exp3(np.array([0, 0, 0.4])), np.array([0.1, 0.0, 0.2]))
    there = [pin.XYZQUATToSE3(row) for row in poses]
    flange = np.array([pin.SE3ToXYZQUAT(x * moved) for x in there])
    text = refused(panda_pose, joints=joints, poses=flange)
    assert "the poses are of a frame at (0.1, 0, 0.2) m in panda_hand_tcp" in text
    table = np.array([pin.SE3ToXYZQUAT(moved * x) for x in there])
    assert "the poses are in another base frame" in refused(panda_pose, joints=joints, poses=table)
    random = np.array([pin.SE3ToXYZQUAT(x) for x in reversed(there)])
    text = refused(panda_pose, joints=joints, poses=random)
    assert "forward kinematics of the joints misses the poses by" in text


def test_times_increase_within_a_session(panda_pose: rp.Task, joints: np.ndarray) -> None:
    times = 0.1 * np.arange(K)
    times[30:] -= 3.0
    text = refused(panda_pose, joints=joints, times=times)
    assert text == (
        "the time 0 s follows 2.9 s, but must increase within a session; sort the frames by time, "
        "or number the sessions"
    )
    made = rp.Recording(panda_pose, joints=joints, times=times, sessions=np.arange(K) // 30)
    assert made.names == ("0", "1")
    times[5] = np.nan
    assert "of frame 5 is not finite" in refused(panda_pose, joints=joints, times=times)


@pytest.mark.parametrize(
    "arguments, says",
    [
        ({}, "a recording needs joints= or poses="),
        ({"joints": np.zeros((4, 6))}, r"takes Q as an array \(K, 7\)"),
        ({"poses": np.zeros((4, 3))}, r"poses must be numbers \(K, 4, 4\) or \(K, 7\)"),
        ({"poses": np.full((4, 7), np.nan)}, "pose 0 is not finite; correct or remove it"),
        ({"poses": np.zeros((0, 7))}, "at least one frame"),
    ],
)
def test_shapes(arguments: dict[str, Any], says: str, panda_pose: rp.Task) -> None:
    with pytest.raises(rp.InputError, match=says):
        rp.Recording(panda_pose, **arguments)


PLANAR = "theta1,theta2,theta3\n"
ROWS = "".join(f"{0.3 + 0.01 * i},0.8,0.8\n" for i in range(5))


@pytest.mark.parametrize(
    "text, says",
    [
        ("", "must name the columns"),
        (ROWS, "the first line must name the columns"),
        (PLANAR, "contains no frames"),
        ("theta1;theta2;theta3\n0;0;0\n", "separate the columns by commas"),
        ("theta1,theta2\n0,0\n", "there is no column 'theta3'; add that column"),
        ("a,b\n0,0\n", "there are columns a, b, but none of joints or poses; name joints theta1, "),
        ("theta1,theta1\n0,0\n", "two columns are named 'theta1'"),
        (PLANAR + ROWS + "0.1,0.2\n", "line 7: 2 fields, but the header has 3"),
        (PLANAR + ROWS + "0.1,x,0.2\n", "line 7: theta2 = 'x' is not a finite number"),
        (PLANAR + ROWS + "0.1,nan,0.2\n", "line 7: theta2 = 'nan' is not a finite number"),
        ("time," + PLANAR + "0,1,1,1\n\n2,1,1,1\n1,1,1,1\n", "line 5: the time 1 s follows 2 s"),
        ("theta1,theta2,theta3\n" + '0,"a\nb\n' * 2, "line"),
    ],
)
def test_csv_files_are_refused_with_the_line(text: str, says: str, tmp_path: Path) -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    file = tmp_path / "demos.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(rp.InputError) as caught:
        rp.Recording.read(file, task)
    assert says in str(caught.value) and str(caught.value).startswith(str(file)), caught.value


def test_other_files_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    (tmp_path / "a.npz").write_bytes(b"PK\x03\x04 no archive")
    np.savez(tmp_path / "b.npz", joints=np.zeros((3, 3)), time=np.zeros(2))
    np.savez(tmp_path / "c.npz", joints=np.array([{}], dtype=object))
    for name, says in (
        ("a.npz", "cannot read"),
        ("b.npz", "the arrays have different lengths"),
        ("c.npz", "cannot read"),
        ("d.txt", r"must end in \.csv, \.npz or \.parquet"),
        ("e.csv", "No such file"),
    ):
        with pytest.raises(rp.InputError, match=says):
            rp.Recording.read(tmp_path / name, task)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setattr("repctl_pin.base.errors.find_spec", lambda name: None)
    with pytest.raises(rp.InputError, match=r"requires pyarrow, which is not installed"):
        rp.Recording.read(tmp_path / "f.parquet", task)


def test_a_frame_far_from_the_cell_is_refused_by_name(panda_pose: rp.Task) -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q0 = np.array([0.3, 0.8, 0.8])
    few = rp.FitOptions(samples=64, held_out=64)
    cell = rp.Cell(task, task.placement(q0), 0.05)
    design = rp.nearest_inverse_function(rp.Pseudoinverse(task), cell, degree=1, options=few)
    far = rp.Recording(task, joints=q0 + 0.5 + 0.01 * np.arange(9)[:, None])
    with pytest.raises(rp.InputError, match="no configuration at any recorded pose"):
        rp.relabel(far, design=design)
    with pytest.raises(rp.InputError, match="the recording is for"):
        rp.relabel(rp.Recording(panda_pose, joints=[panda_pose.reference]), design=design)


@pytest.mark.parametrize("noise", [0.0, 1e-3, 2e-3])
def test_an_offset_of_tool_or_base_is_told_from_noise(
    noise: float, panda_pose: rp.Task, joints: np.ndarray
) -> None:
    """Issue 20, item 14: 4.5 cm or 0.19 rad are refused and named, noise alone is taken."""
    rng = np.random.default_rng(0)
    shift = pin.SE3(np.eye(3), np.array([0.045, 0.0, 0.0]))
    turn = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.19])), np.zeros(3))

    def noisy(before: pin.SE3, after: pin.SE3) -> np.ndarray:
        rows = []
        for q in joints:
            error = pin.SE3(
                pin.exp3(2 * noise * rng.standard_normal(3)), noise * rng.standard_normal(3)
            )
            rows.append(pin.SE3ToXYZQUAT(before * panda_pose.placement(q) * after * error))
        return np.array(rows)

    none = pin.SE3.Identity()
    assert len(rp.Recording(panda_pose, joints=joints, poses=noisy(none, none))) == K
    for before, after, said in (
        (none, shift, "a frame at (0.04"),
        (none, turn, "turned by 0.19 rad"),
        (shift, none, "another base frame, shifted by (0.04"),
        (turn, none, "another base frame, shifted by"),
    ):
        text = refused(panda_pose, joints=joints, poses=noisy(before, after))
        assert said in text, text
