"""Issue 58, item 3: data sets of LeRobot and robomimic are relabelled whole, or not at all."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import main, refused
from controls import some
from made_data_sets import FPS, VERSIONS, lerobot, robomimic, statistics

import repctl_pin as rp

Q0 = np.array([0.3, 0.8, 0.8])
NAMES = ["theta1", "theta2", "theta3"]
NUMBERS = [f"{name}.pos" for name in NAMES] + ["gripper.pos"]
SIZES = (9, 12, 7)


@pytest.fixture(scope="module")
def design() -> rp.CellDesign:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    few = rp.FitOptions(samples=64, held_out=64)
    cell = rp.Cell(task, task.placement(Q0), 0.05)
    control = rp.Pseudoinverse(task)
    return rp.nearest_inverse_function(control, cell, posture=Q0, degree=1, options=few)


@pytest.fixture(scope="module")
def demos() -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Joints and a gripper of three demonstrations, and their actions, which run ahead."""
    rng = np.random.default_rng(0)
    Q = [Q0 + 0.008 * rng.uniform(-1, 1, (size, 3)) for size in SIZES]
    A = [q + 0.002 * rng.uniform(-1, 1, q.shape) for q in Q]
    with_gripper = [[np.c_[x, rng.random(len(x))] for x in X] for X in (Q, A)]
    return with_gripper[0], with_gripper[1]


def table(root: Path) -> pa.Table:
    return pa.concat_tables(pq.read_table(f) for f in sorted(root.glob("data/*/*.parquet")))


def wide(root: Path, name: str) -> np.ndarray:
    return np.array(table(root)[name].to_pylist())


def same_file(one: Path, other: Path) -> bool:
    return one.read_bytes() == other.read_bytes()


@pytest.mark.parametrize("version", some(VERSIONS, "v3.0"))
def test_a_lerobot_data_set_is_kept_but_for_its_joints(
    version: str, design: rp.CellDesign, demos, tmp_path: Path
) -> None:
    """State and action are F of their own poses at one level; the rest is as it was."""
    old = lerobot(tmp_path / "old", version, *demos, NUMBERS)
    recording = rp.Recording.read(old, design.task)
    assert recording.names == ("0", "1", "2") and len(recording) == sum(SIZES)
    done = rp.relabel(recording, design=design, leaf=[0.02])
    assert done.written == ("observation.state [0–2]", "action [0–2]")
    assert done.removed == ("observation.velocity",)
    new = done.save(tmp_path / "new")

    # the joints: functions of the pose, on the level, as float32
    F = design.function
    for name in ("observation.state", "action"):
        before, after = wide(old, name), wide(new, name)
        assert np.array_equal(before[:, 3], after[:, 3]), "the gripper"
        X = [design.task.placement(q).homogeneous for q in before[:, :3]]
        assert np.abs(F.batch(np.array(X), leaf=[0.02]) - after[:, :3]).max() < 1e-6
        assert np.abs(after[:, :3] - before[:, :3]).max() > 1e-3

    # every other column, with its type and metadata; the same files and groups of rows
    a, b = table(old), table(new)
    assert set(a.column_names) - set(b.column_names) == {"observation.velocity"}
    for name in set(b.column_names) - {"observation.state", "action"}:
        assert a[name].equals(b[name]) and a.schema.field(name).equals(b.schema.field(name))
    features = json.loads(b.schema.metadata[b"huggingface"])["info"]["features"]
    assert set(features) == set(b.column_names)
    for file in old.glob("data/*/*.parquet"):
        one, other = (pq.ParquetFile(f).metadata for f in (file, new / file.relative_to(old)))
        rows = [[m.row_group(i).num_rows for i in range(m.num_row_groups)] for m in (one, other)]
        assert rows[0] == rows[1]

    # every other file, the description without the removed feature, true statistics
    changed = {"info.json", "stats.json", "episodes_stats.jsonl"}
    files = {f.relative_to(old) for f in old.rglob("*") if f.is_file()}
    assert files == {f.relative_to(new) for f in new.rglob("*") if f.is_file()}
    for file in files:
        if file.name not in changed and "data" not in file.parts and "episodes" not in file.parts:
            assert same_file(old / file, new / file), file
    infos = [json.loads((r / "meta" / "info.json").read_text("utf-8")) for r in (old, new)]
    del infos[0]["features"]["observation.velocity"]
    assert infos[0] == infos[1]
    true_statistics(old, new, version)


def test_other_columns_of_actions_are_removed_by_name(design, demos, tmp_path: Path) -> None:
    """It is not known what they are; those of the hand stay."""
    old = lerobot(tmp_path / "old", "v3.0", *demos, NUMBERS)
    names = ["action.delta", "action.hand"]
    for file in old.glob("data/*/*.parquet"):
        one = pq.read_table(file)
        for name in names:
            one = one.append_column(name, pa.array([[0.1] * 3] * len(one)))
        pq.write_table(one, file)
    features = json.loads((old / "meta" / "info.json").read_text("utf-8"))["features"]
    of_each = {"dtype": "float64", "shape": [3], "names": None}
    change(old, features=features | dict.fromkeys(names, of_each))
    done = rp.relabel(rp.Recording.read(old, design.task), design=design, leaf=[0.02])
    assert set(done.removed) == {"observation.velocity", "action.delta"}
    assert "action.delta" in done.summary()


def true_statistics(old: Path, new: Path, version: str) -> None:
    """Those of changed columns are computed from the new numbers, the others are kept."""
    episode = wide(new, "episode_index")

    def check(before: dict, after: dict, rows: np.ndarray) -> None:
        assert set(before) - set(after) == {"observation.velocity"}
        for name in after:
            if name not in ("observation.state", "action"):
                assert before[name] == after[name], name
                continue
            fresh = statistics(wide(new, name)[rows], "q01" in before[name])
            assert set(fresh) == set(after[name])
            assert after[name]["count"] == before[name]["count"]
            for key in fresh:
                assert np.allclose(fresh[key], after[name][key], atol=1e-12), (name, key)

    if version == "v2.1":
        lines = [
            (root / "meta" / "episodes_stats.jsonl").read_text("utf-8").splitlines()
            for root in (old, new)
        ]
        for one, other in zip(*lines, strict=True):
            a, b = json.loads(one), json.loads(other)
            check(a["stats"], b["stats"], episode == b["episode_index"])
        return
    a, b = (json.loads((root / "meta" / "stats.json").read_text("utf-8")) for root in (old, new))
    check(a, b, episode >= 0)
    name = "meta/episodes/chunk-000/file-000.parquet"
    for one, other in zip(*(pq.read_table(r / name).to_pylist() for r in (old, new)), strict=True):
        both: list[dict] = [{}, {}]
        for row, made in zip((one, other), both, strict=True):
            for key, value in row.items():
                if key.startswith("stats/"):
                    _, column, statistic = key.split("/")
                    made.setdefault(column, {})[statistic] = value
                elif row is other:
                    assert one[key] == value
        check(*both, episode == other["episode_index"])


def test_the_actions_are_those_of_the_same_function(
    design: rp.CellDesign, demos, tmp_path: Path
) -> None:
    """A state that an action commands exactly gets exactly the joints of that action."""
    Q, _ = demos
    A = [np.r_[q[1:], q[-1:]] for q in Q]
    old = lerobot(tmp_path / "old", "v3.0", Q, A, {"motors": NUMBERS})
    new = rp.relabel(rp.Recording.read(old, design.task), design=design, leaf=[0.02])
    made = new.save(tmp_path / "new")
    state, action, e = (wide(made, n) for n in ("observation.state", "action", "episode_index"))
    follows = e[1:] == e[:-1]
    assert np.array_equal(action[:-1][follows], state[1:][follows])


@pytest.mark.parametrize("version", some(VERSIONS, "v2.1"))
def test_the_command_relabels_and_audits_a_data_set(
    version: str, demos, tmp_path: Path, capsys: pytest.CaptureFixture[str], design
) -> None:
    old = lerobot(tmp_path / "demos.v1", version, *demos, NUMBERS)
    cell, out = tmp_path / "cell.json", tmp_path / "o"
    rp.save(design, cell)
    assert main(["relabel", str(old), str(cell), "--out", str(out)]) == 0
    assert {f.name for f in out.iterdir()} == {"demos.v1", "cell.json", "relabel.png"}
    assert "observation.velocity" in capsys.readouterr().out
    # a second time, nothing is replaced
    before = {f: f.stat().st_mtime_ns for f in out.rglob("*")}
    said = refused(capsys, "relabel", str(old), str(cell), "--out", str(out))
    assert "exists already, and is not replaced" in said and said.count("\n") == 1
    assert before == {f: f.stat().st_mtime_ns for f in out.rglob("*")}
    inside = refused(capsys, "relabel", str(old), str(cell), "--out", str(old / "o"))
    assert "lies in the data set" in inside and not (old / "o").exists()
    # the audit reads both
    for folder in (old, out / "demos.v1"):
        found = rp.audit(folder, design.task)
        assert len(found.log.t) == sum(SIZES) and np.allclose(np.diff(found.log.t), 1 / FPS)
        assert np.allclose(found.log.q, wide(folder, "observation.state")[:, :3])
    assert main(["audit", str(old), "--robot", "planar3r", "--out", str(tmp_path / "a")]) in (0, 1)


def test_the_audit_converts_a_data_set_in_degrees_and_relabel_refuses_it(
    design: rp.CellDesign, demos, tmp_path: Path
) -> None:
    """58: LeRobot does not write the unit, so the user says it; nothing is guessed."""
    Q, A = demos
    units = np.ones(Q[0].shape[1])
    units[:3] = 180 / np.pi
    old = lerobot(tmp_path / "degrees", "v3.0", [q * units for q in Q], A, NUMBERS)
    found = rp.audit(old, design.task, degrees=True)
    due = np.concatenate(Q)[:, :3].astype(np.float32)
    assert np.abs(found.log.q - due).max() < 1e-6
    with pytest.raises(rp.InputError, match="degrees"):
        rp.audit(old, design.task)
    with pytest.raises(rp.InputError, match="fit their limits only as degrees; convert them"):
        rp.relabel(rp.Recording.read(old, design.task), design=design)


def change(root: Path, **values: object) -> None:
    file = root / "meta" / "info.json"
    file.write_text(json.dumps(json.loads(file.read_text("utf-8")) | values), encoding="utf-8")


def test_what_is_not_understood_is_refused_by_name(
    design: rp.CellDesign, demos, tmp_path: Path
) -> None:
    """Each in one line, and nothing is written."""
    Q, A = demos
    task = design.task
    kept = lerobot(tmp_path / "kept", "v2.1", Q, A, NUMBERS)
    info = json.loads((kept / "meta" / "info.json").read_text("utf-8"))
    count = 0

    def fresh() -> Path:
        nonlocal count
        count += 1
        return Path(shutil.copytree(kept, tmp_path / f"c{count}"))

    def said(root: Path, **how: object) -> str:
        with pytest.raises(rp.InputError) as caught:
            done = rp.relabel(rp.Recording.read(root, task, **how), design=design, leaf=[0.0])
            done.save(tmp_path / "never")
        text = str(caught.value)
        assert "\n" not in text and not (tmp_path / "never").exists()
        assert not list(tmp_path.glob(".repctl-*"))
        return text

    def with_info(**values: object) -> Path:
        change(root := fresh(), **values)
        return root

    unknown = with_info(codebase_version="v2.0")
    assert "codebase_version 'v2.0' of LeRobot is not known" in said(unknown)
    assert "total_frames in meta/info.json is 5" in said(with_info(total_frames=5))
    assert "download the whole data set" in said(with_info(total_episodes=4))
    assert "has no 'features'" in said(with_info(features=None))
    (root := fresh() / "meta" / "info.json").write_text("{", encoding="utf-8")
    assert "info.json is not JSON" in said(root.parents[1])
    assert "without meta/info.json" in said(tmp_path)

    def named(state: object, action: object) -> Path:
        features = json.loads(json.dumps(info["features"]))
        features["observation.state"]["names"] = state
        features["action"]["names"] = action
        return with_info(features=features)

    other = ["a", "b", "c", "d"]
    assert "does not name the 4 numbers" in said(named(None, None))
    assert "none of the 4 names" in said(named(other, other))
    hand = ["x", "y", "phi", "gripper"]
    text = said(named(NUMBERS, hand))
    assert "'action' are joint positions: its numbers are x, y, phi, gripper; use action=" in text
    mixed = [*NUMBERS[:3], "theta1.vel"]
    assert "has 'theta1.vel', which belongs to the replaced joints" in said(named(mixed, NUMBERS))
    done = rp.relabel(
        rp.Recording.read(named(NUMBERS, hand), task, action="hand"), design=design, leaf=[0.02]
    )
    new = done.save(tmp_path / "hand")
    assert np.array_equal(wide(new, "action"), wide(kept, "action"))
    far = [a + [1.0, 0, 0, 0] for a in A]
    assert "is not the position of that joint" in said(
        lerobot(tmp_path / "far", "v3.0", Q, far, NUMBERS)
    ).replace("and not the", "is not the")
    # a pose out of the cell, other statistics, a damaged file, a link to a folder
    lost = [q.copy() for q in Q]
    lost[1][4, 0] += 0.5
    text = said(lerobot(tmp_path / "lost", "v2.1", lost, A, NUMBERS))
    assert "1 of 28 rows of 'observation.state' have no configuration in the cell" in text
    assert "nothing was written; the first is " in text
    assert "episode_000001.parquet, row 4; " in text
    (root := fresh() / "meta" / "relative_stats.json").write_text("{}", encoding="utf-8")
    assert "may have statistics of the old joint values" in said(root.parents[1])
    lines = (root := fresh()) / "meta" / "episodes_stats.jsonl"
    lines.write_text(lines.read_text("utf-8").replace('"std"', '"spread"'), encoding="utf-8")
    assert "the statistic 'spread' is not known" in said(root)
    next((root := fresh()).glob("data/*/*.parquet")).write_bytes(b"PAR1")
    assert "cannot read" in said(root)
    ((root := fresh()) / "more").symlink_to(kept / "data", target_is_directory=True)
    assert "is a link to a folder" in said(root)
    assert "must be joints or hand" in said(kept, action="pose")


def test_a_disk_that_is_full_leaves_nothing(
    design: rp.CellDesign, demos, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = lerobot(tmp_path / "old", "v3.0", *demos, NUMBERS)
    done = rp.relabel(rp.Recording.read(old, design.task), design=design, leaf=[0.0])

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(shutil, "copy2", full)
    with pytest.raises(rp.InputError, match="new: No space left on device"):
        done.save(tmp_path / "deep" / "new")
    assert {f.name for f in tmp_path.iterdir()} == {"old"}


# ---- robomimic


def arrays(file: Path) -> dict[str, object]:
    """Every array and attribute of a file, by its path."""
    made: dict[str, object] = {}

    def visit(name: str, item: h5py.Group | h5py.Dataset) -> None:
        made.update({f"{name}@{key}": value for key, value in item.attrs.items()})
        if isinstance(item, h5py.Dataset):
            made[name] = item[()]
            made[f"{name}#"] = (str(item.dtype), item.chunks, item.compression)

    with h5py.File(file) as h5:
        h5.visititems(visit)
    return made


def test_a_robomimic_file_is_kept_but_for_its_joints(
    design: rp.CellDesign, demos, tmp_path: Path
) -> None:
    """Joints, next joints, cosines and sines are new; actions of the hand, masks and all else
    stay."""
    Q, A = [q[:, :3] for q in demos[0]], demos[1]
    old = robomimic(tmp_path / "old.hdf5", Q, A)
    done = rp.relabel(rp.Recording.read(old, design.task), design=design, leaf=[0.02])
    new = done.save(tmp_path / "new.hdf5")
    a, b = arrays(old), arrays(new)
    removed = {"states", "obs/robot0_joint_vel", "next_obs/robot0_joint_vel"}
    assert set(done.removed) == removed
    gone = {f"data/demo_{e}/{n}{s}" for e in range(3) for n in removed for s in ("", "#")}
    assert set(a) - set(b) == gone and not set(b) - set(a)
    for name in set(b):
        if name.endswith("#"):
            assert a[name] == b[name], name
        elif "robot0_joint_pos" not in name or name.endswith("@unit"):
            assert np.array_equal(a[name], b[name]), name
    F, task = design.function, design.task
    for e in range(3):
        for group in ("obs", "next_obs"):
            name = f"data/demo_{e}/{group}/robot0_joint_pos"
            X = np.array([task.placement(q).homogeneous for q in a[name]])
            assert np.abs(F.batch(X, leaf=[0.02]) - b[name]).max() < 1e-9
            assert np.abs(np.cos(b[name]) - b[f"{name}_cos"]).max() < 1e-15
            assert np.abs(np.sin(b[name]) - b[f"{name}_sin"]).max() < 1e-15


def test_the_actions_of_robomimic_are_joints_only_if_said(
    design: rp.CellDesign, demos, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Q, A = [q[:, :3] for q in demos[0]], demos[1]
    for controller in (None, "JOINT_POSITION"):
        old = robomimic(tmp_path / f"{controller}.hdf5", Q, A, controller=controller)
        with pytest.raises(rp.InputError, match="whether 'actions' are joint positions"):
            rp.Recording.read(old, design.task)
    cell, out = tmp_path / "cell.json", tmp_path / "o"
    rp.save(design, cell)
    command = ["relabel", str(old), str(cell), "--out", str(out), "--action"]
    assert main([*command, "joints"]) == 0
    a, b = arrays(old), arrays(out / old.name)
    name, task = "data/demo_1/actions", design.task
    assert np.array_equal(a[name][:, 3], b[name][:, 3])
    assert np.abs(a[name][:, :3] - b[name][:, :3]).max() > 1e-4
    apart = task.positions(a[name][:, :3]) - task.positions(b[name][:, :3])
    assert np.abs(apart[:, :2]).max() < 1e-9
    capsys.readouterr()
    assert "exists already, and is not replaced" in refused(capsys, *command, "joints")
    deltas = robomimic(tmp_path / "deltas.hdf5", Q, [a - 1.0 for a in A], controller=None)
    with pytest.raises(rp.InputError, match=r"'actions' is 1 rad or m from theta\d in the median"):
        rp.Recording.read(deltas, task, action="joints")


def test_what_is_no_robomimic_file_is_refused(design: rp.CellDesign, demos, tmp_path: Path) -> None:
    Q, A = [q[:, :3] for q in demos[0]], demos[1]
    old = robomimic(tmp_path / "old.hdf5", Q, A)
    task = design.task

    def said(edit, **how: object) -> str:
        file = Path(shutil.copyfile(old, tmp_path / "other.hdf5"))
        with h5py.File(file, "r+") as h5:
            edit(h5)
        with pytest.raises(rp.InputError) as caught:
            done = rp.relabel(rp.Recording.read(file, task, **how), design=design, leaf=[0.0])
            done.save(tmp_path / "never.hdf5")
        assert not (tmp_path / "never.hdf5").exists()
        text = str(caught.value)
        assert "\n" not in text
        return text

    def external(h5: h5py.File) -> None:
        h5["data/demo_0/more"] = h5py.ExternalLink("old.hdf5", "/data")

    def shared(h5: h5py.File) -> None:
        for demo in h5["data"].values():
            del demo["next_obs/robot0_joint_pos"]
            demo["next_obs/robot0_joint_pos"] = demo["obs/robot0_joint_pos"]

    def two_arms(h5: h5py.File) -> None:
        for demo in h5["data"].values():
            demo["obs/robot1_joint_pos"] = demo["obs/robot0_joint_pos"][()]

    def without(name: str):
        def edit(h5: h5py.File) -> None:
            for demo in h5["data"].values():
                del demo[name]

        return edit

    def attribute(at: str, name: str, value: object):
        return lambda h5: h5[at].attrs.__setitem__(name, value)

    assert "is not a robomimic data set" in said(lambda h5: h5.move("data", "episodes"))
    assert "but total is 5" in said(attribute("data", "total", 5))
    assert "demo_1 has 12 actions, but num_samples is 5" in said(
        attribute("data/demo_1", "num_samples", 5)
    )
    assert "env_args of data is not JSON" in said(attribute("data", "env_args", "{"))
    assert "but no array of the 3 joints" in said(without("obs/robot0_joint_pos"))
    assert "is a link to another file" in said(external)
    assert "is stored in another array or file" in said(shared)
    assert "several arrays may be the joints: obs/robot0_joint_pos, obs/robot1" in said(two_arms)
    assert "no array 'obs/arm' of numbers" in said(lambda h5: None, joints=["obs/arm"])
    (tmp_path / "text.hdf5").write_text("no", encoding="utf-8")
    with pytest.raises(rp.InputError, match="cannot read"):
        rp.Recording.read(tmp_path / "text.hdf5", task)
    two = Path(shutil.copyfile(old, tmp_path / "two.hdf5"))
    with h5py.File(two, "r+") as h5:
        two_arms(h5)
    found = rp.Recording.read(two, task, joints=["robot1_joint_pos"])
    assert found.source.joints == "obs/robot1_joint_pos"


def test_the_audit_of_a_robomimic_file_has_the_rate_of_its_controller(
    design: rp.CellDesign, demos, tmp_path: Path
) -> None:
    Q, A = [q[:, :3] for q in demos[0]], demos[1]
    old = robomimic(tmp_path / "old.hdf5", Q, A)
    found = rp.audit(old, design.task)
    assert np.allclose(np.diff(found.log.t), 1 / FPS) and np.array_equal(found.log.q, np.vstack(Q))
    with h5py.File(old, "r+") as h5:
        del h5["data"].attrs["env_args"]
    with pytest.raises(rp.InputError, match="has no times: 'control_freq' is None"):
        rp.audit(old, design.task)
