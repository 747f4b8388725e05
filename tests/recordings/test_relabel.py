"""Relabelling: equal poses get equal joints, on the leaf of the demonstrators."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from commands import main
from scipy.spatial.transform import Rotation
from terminals import fit_terminals

import repctl_pin as rp

Q0 = np.array([0.3, 0.8, 0.8])
TIMES = 0.02 * np.arange(300)
FEW = rp.FitOptions(held_out=64)


@pytest.fixture(scope="module")
def task() -> rp.Task:
    return rp.Robot.load("planar3r").task("tool", "xy")


def session(task: rp.Task, seed: int, elbow: float) -> np.ndarray:
    """Joints of J⁺ on a smooth random motion of ±0.1 m, from one elbow."""
    rng = np.random.default_rng(seed)
    waves = np.sin(rng.uniform(1, 4, (2, 3, 1)) * TIMES + 6 * rng.random((2, 3, 1)))
    away = (rng.normal(size=(2, 3, 1)) * waves).sum(axis=1).T
    away *= 0.1 / np.abs(away).max(axis=0)
    q = Q0 + elbow * rp.redundancy.nullspace(task.jacobian(Q0))[:, 0]
    Q, middle = [], task.placement(Q0)
    for step in [*np.linspace(0, 1, 40)[:, None] * away[0], *away]:
        target = middle.copy()
        target.translation[:2] += step
        for _ in range(2):
            q = q + np.linalg.pinv(task.jacobian(q)) @ task.error(q, target)
        Q.append(q)
    return np.array(Q[40:])


@pytest.fixture(scope="module")
def recording(task: rp.Task) -> rp.Recording:
    """Four sessions from four elbows."""
    Q = [session(task, seed, elbow) for seed, elbow in enumerate((-0.4, -0.2, 0.2, 0.6))]
    sessions = np.repeat(["a", "b", "c", "d"], len(TIMES))
    return rp.Recording(task, joints=np.concatenate(Q), times=np.tile(TIMES, 4), sessions=sessions)


@pytest.fixture(scope="module")
def relabeled(recording: rp.Recording) -> rp.Relabeled:
    return rp.relabel(recording, options=FEW)


def test_equal_poses_get_equal_joints(relabeled: rp.Relabeled) -> None:
    task, recording = relabeled.recording.task, relabeled.recording
    assert relabeled.found.all() and not relabeled.gaps
    assert np.abs(task.positions(relabeled.joints) - recording.positions)[:, :2].max() < 1e-9
    F, c = relabeled.design.function, relabeled.leaf
    again = F.batch(recording.homogeneous, leaf=c)
    assert np.abs(again - relabeled.joints).max() < 1e-9
    assert np.ptp(F.pose_and_leaf(relabeled.joints)[1]) < 1e-9
    assert relabeled.residual_before > 0.2 and relabeled.residual_after < 0.01


def test_the_leaf_is_the_median_of_the_demonstrators(relabeled: rp.Relabeled) -> None:
    assert relabeled.recorded_leaves is not None
    assert np.allclose(relabeled.leaf, np.median(relabeled.recorded_leaves, axis=0))
    zero = rp.relabel(relabeled.recording, design=relabeled.design, leaf=[0.0])
    moved, more = np.linalg.norm(relabeled.moved), np.linalg.norm(zero.moved)
    assert moved <= more and zero.leaf == 0.0


def test_a_leaf_that_would_break_a_limit_is_moved_towards_0(task: rp.Task) -> None:
    cell = rp.Cell(task, task.placement(Q0), 0.05)
    few = rp.FitOptions(samples=64, held_out=64)
    design = rp.nearest_inverse_function(
        rp.Pseudoinverse(task), cell, posture=Q0, degree=1, options=few
    )
    low, high = (float(end) for end in design.function.leaves(task.placement(Q0))[0])
    beyond = low if -low > high else high
    q = design.function(task.placement(Q0), leaf=[0.98 * beyond])
    Q = q + 1e-4 * np.sin(TIMES)[:, None] * [1.0, 2.0, 1.0]
    done = rp.relabel(rp.Recording(task, joints=Q), design=design)
    assert done.recorded_leaves is not None and done.found.all()
    assert np.abs(done.leaf) <= np.abs(np.median(done.recorded_leaves)) + 1e-12
    assert done.margins_after.min() >= 0


def test_frames_outside_the_cell_are_listed_by_time(relabeled: rp.Relabeled) -> None:
    task, small = relabeled.recording.task, relabeled.design.cell.scaled(0.8)
    design = rp.nearest_inverse_function(
        rp.Pseudoinverse(task), small, degree=1, options=rp.FitOptions(samples=64, held_out=64)
    )
    done = rp.relabel(relabeled.recording, design=design)
    lost = np.flatnonzero(~done.found)
    assert (
        0 < len(lost) == sum(gap.frames for gap in done.gaps) == np.isnan(done.joints[:, 0]).sum()
    )
    assert {gap.why for gap in done.gaps} == {"outside the cell"}
    first, times = done.gaps[0], done.recording.times
    assert times is not None and first.start == times[lost[0]]
    assert first.session == done.recording.names[done.recording.session[lost[0]]]
    assert f"session {first.session}: {first.start:g}" in done.summary() or len(done.gaps) > 3


def test_poses_without_joints_are_labelled(relabeled: rp.Relabeled) -> None:
    task, p = relabeled.recording.task, relabeled.recording.positions
    for poses in (p, relabeled.recording.homogeneous):
        done = rp.relabel(rp.Recording(task, poses=poses), design=relabeled.design)
        assert done.leaf == 0.0 and np.isnan(done.residual_before) and done.found.all()
        assert "recorded" not in done.summary()


def test_a_recording_around_the_base_gets_a_sector(task: rp.Task) -> None:
    angle = np.linspace(-2.0, 2.0, 400)
    Q = Q0 + np.stack([angle, 0.1 * np.sin(7 * angle), 0.1 * np.cos(5 * angle)], axis=1)
    done = rp.relabel(rp.Recording(task, joints=Q), options=FEW)
    assert isinstance(done.design.cell, rp.Sector) and done.found.all()


# ---- the measure


@pytest.fixture(scope="module")
def slides(tmp_path_factory: pytest.TempPathFactory) -> rp.CellDesign:
    """Slides along x, y and y, for x and y: the third joint may be any function of the pose."""
    links = "".join(f'<link name="{k}"/>' for k in range(4))
    joints = "".join(
        f'<joint name="j{k}" type="prismatic"><parent link="{k}"/><child link="{k + 1}"/>'
        f'<axis xyz="{axis}"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
        for k, axis in enumerate(("1 0 0", "0 1 0", "0 1 0"))
    )
    file = tmp_path_factory.mktemp("slides") / "slides.urdf"
    file.write_text(f'<robot name="slides">{links}{joints}</robot>')
    task = rp.Robot.load(file).task("3", "xy")
    cell = rp.Cell(task, task.placement(np.zeros(3)), 1.1)
    few = rp.FitOptions(samples=64, held_out=64)
    return rp.nearest_inverse_function(
        rp.Pseudoinverse(task), cell, posture=np.zeros(3), degree=1, options=few
    )


def labelled(
    design: rp.CellDesign, x: np.ndarray, third: np.ndarray, sessions: np.ndarray
) -> rp.Relabeled:
    """Relabel recordings of poses x (K, 2) with given third joints (K,)."""
    joints = np.column_stack([x[:, 0], x[:, 1] - third, third])
    recording = rp.Recording(design.task, joints=joints, sessions=sessions)
    return rp.relabel(recording, design=design)


def test_the_fit_of_cubic_labels_is_exact_and_a_shift_of_sessions_is_seen(
    slides: rp.CellDesign,
) -> None:
    rng, sessions = np.random.default_rng(0), np.repeat(["a", "b", "c", "d"], 300)
    x = rng.uniform(-1, 1, (1200, 2))
    smooth = (x @ [0.5, -0.8]) ** 3 + x[:, 0] * x[:, 1]
    exact = labelled(slides, x, smooth, sessions)
    assert exact.residual_before < 1e-5 and exact.residual_after < 1e-5
    assert exact.ambiguity.degree == 3
    shift = np.repeat([0.3, -0.3, 0.3, -0.3], 300)
    shifted = labelled(slides, x, smooth + shift, sessions)
    # the other three sessions have the mean ∓0.1: the misfit of two joints is 0.4 each
    assert abs(shifted.residual_before - 0.4 * np.sqrt(2)) < 0.03
    assert shifted.residual_after < 1e-5
    assert "cubic" in shifted.summary() and "held-out sessions" in shifted.summary()


def test_a_single_session_is_held_out_in_blocks_and_few_frames_lower_the_degree(
    slides: rp.CellDesign,
) -> None:
    """Of 20 frames 16 are left to fit: three for each of 3 terms, not of 6."""
    x = np.random.default_rng(0).uniform(-1, 1, (24, 2))
    for count, degree in ((20, 1), (24, 2)):
        found = labelled(slides, x[:count], x[:count] @ [0.5, 1], np.zeros(count, int))
        assert found.ambiguity.degree == degree
        assert "blocks of time" in found.ambiguity.method
        assert found.residual_before < 1e-6


# ---- files


@pytest.mark.parametrize("suffix", ["csv", "npz", "parquet"])
def test_files_keep_their_other_columns(
    suffix: str, relabeled: rp.Relabeled, tmp_path: Path
) -> None:
    file = relabeled.save(tmp_path / f"new.{suffix}")
    again = rp.Recording.read(file, relabeled.recording.task)
    assert again.joints is not None and np.array_equal(again.joints, relabeled.joints)
    assert again.names == ("a", "b", "c", "d") and np.array_equal(again.times, np.tile(TIMES, 4))
    done = rp.relabel(again, design=relabeled.design)
    second = done.save(tmp_path / f"second.{suffix}")
    if suffix == "csv":
        head, old = second.read_text().splitlines()[0], file.read_text().splitlines()[0]
        assert head == old


def test_arrays_with_a_gripper_and_other_columns_are_kept(
    relabeled: rp.Relabeled, tmp_path: Path
) -> None:
    Q = relabeled.recording.joints
    assert Q is not None
    state = np.concatenate([Q, np.arange(len(Q))[:, None]], axis=1)
    names, poses = np.full(len(Q), "home"), relabeled.recording.homogeneous
    columns = {"observation.state": state, "extra": np.arange(len(Q))}
    np.savez(tmp_path / "a.npz", **columns, poses=poses, pose=names)
    task = relabeled.recording.task
    with pytest.raises(rp.InputError, match="has 4 numbers per row, but the task has 3 joints"):
        rp.Recording.read(tmp_path / "a.npz", task)
    recording = rp.Recording.read(tmp_path / "a.npz", task, joints=[*task.joint_names, "gripper"])
    done = rp.relabel(recording, design=relabeled.design)
    with np.load(done.save(tmp_path / "b.npz")) as made:
        assert np.array_equal(made["extra"], np.arange(len(Q)))
        assert np.array_equal(made["pose"], names)
        assert np.array_equal(made["observation.state"][:, 3], state[:, 3])
        assert np.array_equal(made["observation.state"][:, :3], done.joints)


def test_velocities_of_the_old_joints_are_dropped(task: rp.Task, tmp_path: Path) -> None:
    motion = rp.follow(rp.Pseudoinverse(task), rp.circle(task, Q0, 0.1), Q0, cycles=1, steps=60)
    file = rp.write_motion(motion, tmp_path / "motion.csv")
    done = rp.relabel(rp.Recording.read(file, task), options=FEW)
    assert "_velocity" not in done.save(tmp_path / "new.csv").read_text()


@pytest.mark.slow
def test_the_command_answers_in_a_small_terminal(
    relabeled: rp.Relabeled, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    relabeled.save("demos.csv")
    rp.save(relabeled.design, "cell.json")
    small = fit_terminals(monkeypatch)
    assert main(["relabel", "demos.csv", "cell.json", "--leaf", "0.1"]) == 0
    first = " ".join(small[0].split())
    assert first.startswith(
        "Your demonstrations used one configuration for each pose already. "
        "Ambiguity of the joints: "
    )
    assert small[0].count("\n") <= 22
    folder = Path("repctl-out/demos")
    assert {f.name for f in folder.iterdir()} == {"demos.csv", "cell.json", "relabel.png"}
    assert (folder / "relabel.png").read_bytes().startswith(b"\x89PNG")
    capsys.readouterr()
    assert main(["relabel", "demos.csv", "cell.json", "--json", "--out", "other"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["relabelled"] == found["frames"] == 1200 and found["sessions"] == 4
    assert main(["relabel", "demos.csv", "cell.json", "--out", "."]) == 2
    assert "would replace demos.csv" in capsys.readouterr().err


def test_the_command_searches_for_no_start(
    relabeled: rp.Relabeled, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    """32.7: relabelling needs none."""

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a start was searched for")

    relabeled.save(tmp_path / "demos.csv")
    monkeypatch.setattr("repctl_pin.studies.problem.starts", refuse)
    given = ["planar3r", "--frame", "tool", "--task", "xy", "--held-out", "64"]
    out = ["--out", str(tmp_path / "out"), "--json"]
    assert main(["relabel", str(tmp_path / "demos.csv"), *given, *out]) == 0
    assert json.loads(capsys.readouterr().out)["frame"] == "tool"


def test_the_words_say_what_became_one(relabeled: rp.Relabeled, tmp_path: Path, capsys) -> None:
    """Four sessions, each with its own elbow: the words say so."""
    recording = relabeled.recording
    rows = np.c_[recording.session, recording.joints]
    names = ",".join(["session", *recording.task.joint_names])
    np.savetxt(tmp_path / "demos.csv", rows, "%.12g", ",", header=names, comments="")
    rp.save(relabeled.design, tmp_path / "cell.json")
    files = [str(tmp_path / name) for name in ("demos.csv", "cell.json", "out")]
    assert main(["relabel", *files[:2], "--out", files[2]]) == 0
    said = "Your demonstrations used several configurations for one pose; now"
    assert capsys.readouterr().out.startswith(said)


def test_data_of_the_old_joints_is_not_kept(relabeled: rp.Relabeled, tmp_path: Path) -> None:
    """Issue 20, item 14: copies are relabelled, velocities and actions removed, and listed."""
    task, Q = relabeled.recording.task, relabeled.recording.joints
    assert Q is not None
    columns = {f"{name}.velocity": Q[:, 0] for name in task.joint_names}
    columns |= {"dq1": Q[:, 0], "joint.vel": 0.1 * Q, "qvel": 0.1 * Q, "action": Q[::-1]}
    kept = {"reward": np.arange(len(Q)), "gripper_pos": Q[:, 0], "ee_velocity": 0.1 * Q}
    np.savez(tmp_path / "a.npz", joints=Q, qpos=Q, **columns, **kept)
    recording = rp.Recording.read(tmp_path / "a.npz", task)
    done = rp.relabel(recording, design=relabeled.design)
    assert set(done.removed) == set(columns)
    assert "action" in done.summary() and "qvel" in done.summary()
    with np.load(done.save(tmp_path / "b.npz")) as made:
        assert set(made) == {"joints", "qpos", *kept}
        assert np.array_equal(made["qpos"], done.joints)
        assert np.array_equal(made["joints"], done.joints)
        assert all(np.array_equal(made[name], kept[name]) for name in kept)


def test_the_free_rotation_of_a_position_task_is_recomputed(
    relabeled: rp.Relabeled, tmp_path: Path
) -> None:
    """Issue 20, item 14: qx … qw are those of the new joints, not of the recorded ones."""
    recording, task = relabeled.recording, relabeled.recording.task
    R = [task.placement(q).rotation for q in recording.joints]  # type: ignore[union-attr]
    quaternions = Rotation.from_matrix(R).as_quat()
    named = dict(zip(("qx", "qy", "qz", "qw"), quaternions.T, strict=True))
    named |= dict(zip("xyz", recording.positions.T, strict=True))
    joints = dict(zip(task.joint_names, recording.joints.T, strict=True))  # type: ignore[union-attr]
    np.savez(tmp_path / "a.npz", **joints, **named)
    again = rp.Recording.read(tmp_path / "a.npz", task)
    done = rp.relabel(again, design=relabeled.design)
    assert set(done.recomputed) == set(named)
    with np.load(done.save(tmp_path / "b.npz")) as made:
        columns = [made[name] for name in ("qx", "qy", "qz", "qw")]
        written = Rotation.from_quat(np.stack(columns, axis=1))
        new = Rotation.from_matrix([task.placement(q).rotation for q in done.joints])
        assert (written * new.inv()).magnitude().max() < 1e-9
        assert (Rotation.from_quat(quaternions) * new.inv()).magnitude().max() > 0.1
        assert np.abs(made["x"] - recording.positions[:, 0]).max() < 1e-9
