"""A relabelled file has every other cell, type and metadata as it was, and names what it wrote."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import main
from made_data_sets import lerobot

import repctl_pin as rp

Q0 = np.array([0.3, 0.8, 0.8])
NAMES = ("theta1", "theta2", "theta3")
K = 12
FILES = 40
CELLS = (
    "1764288000148456789",
    "000001",
    "2e2",
    " 7 ",
    "",
    "-0.0",
    "nan",
    "wörd",
    '"a,b"',
    '"q""q"',
)
CELLS += ('"two\nlines"', "'x'", "1_000", "0x10", "+5", "9007199254740993")


@pytest.fixture(scope="module")
def design() -> rp.CellDesign:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    few = rp.FitOptions(samples=64, held_out=64)
    cell = rp.Cell(task, task.placement(Q0), 0.05)
    control = rp.Pseudoinverse(task)
    return rp.nearest_inverse_function(control, cell, posture=Q0, degree=1, options=few)


def joints(rng: np.random.Generator) -> np.ndarray:
    return Q0 + 0.008 * rng.uniform(-1, 1, (K, 3))


def relabeled(file: Path, design: rp.CellDesign, **how) -> rp.Relabeled:
    return rp.relabel(rp.Recording.read(file, design.task, **how), design=design, leaf=[0.0])


def test_each_other_cell_of_a_csv_file_is_the_same_text(
    design: rp.CellDesign, tmp_path: Path
) -> None:
    """Issue 52, 26.21: 40 random files; put back the old joints, and the file is the old one."""
    for seed in range(FILES):
        rng = np.random.default_rng(seed)
        Q = [[repr(v) for v in row] for row in joints(rng).tolist()]
        header = [*NAMES, *(f"c{i}" for i in range(rng.integers(1, 5)))]
        order = rng.permutation(len(header))
        end = str(rng.choice(["\n", "\r\n"]))
        rows = [[*q, *map(str, rng.choice(CELLS, len(header) - 3))] for q in Q]
        lines = [",".join(row[i] for i in order) for row in [header, *rows]]
        if seed % 3 == 0:
            lines.insert(4, "")
        text = "\ufeff" * (seed % 4 == 0) + end.join(lines) + end * (seed % 5 > 0)
        (tmp_path / "a.csv").write_bytes(text.encode())
        done = relabeled(tmp_path / "a.csv", design)
        made = done.save(tmp_path / "b.csv").read_bytes().decode()
        assert sorted(done.written) == sorted(NAMES) and not done.removed
        for q, new in zip(Q, done.joints.tolist(), strict=True):
            for old, value in zip(q, new, strict=True):
                assert made.count(repr(value)) == 1
                made = made.replace(repr(value), old)
        assert made == text, seed


def test_each_other_column_of_a_parquet_file_has_its_type_and_metadata(
    design: rp.CellDesign, tmp_path: Path
) -> None:
    """Issue 52, 26.21: 40 random files of twelve types, joints in columns or in one list."""
    f32, stamp = pa.float32(), pa.timestamp("ns", "UTC")
    kinds = [pa.int64(), pa.uint8(), f32, pa.string(), pa.bool_(), stamp, pa.binary()]
    kinds += [pa.list_(f32), pa.list_(f32, 2), pa.large_list(pa.int16()), pa.decimal128(20, 3)]
    kinds += [pa.struct([("bytes", pa.binary()), ("path", pa.string())])]
    some = {7: [1.5, 2.5], 8: [0.1, 0.2], 9: [1, 2], 11: {"bytes": b"\0", "path": None}}
    plain = [2**63 - 1, 255, 0.1, "000001", True, 1764288000148456789, b"\xff"]
    for seed in range(FILES):
        rng = np.random.default_rng(seed)
        Q, taken = joints(rng), rng.permutation(len(kinds))[: rng.integers(1, 8)]
        values = [some.get(k, plain[k] if k < 7 else None) for k in range(len(kinds))]
        columns = {}
        for k in taken:
            # earlier versions of pyarrow do not write null lists of a fixed size
            nulls = 0.3 if k != 8 or int(pa.__version__.split(".")[0]) >= 26 else 0.0
            cells = [values[k] if rng.random() >= nulls else None for _ in range(K)]
            columns[f"c{k}"] = pa.array(cells, kinds[k])
        kind = [pa.list_(f32), pa.list_(f32, 5), pa.list_(pa.float64()), None][seed % 4]
        if kind is None:
            columns |= {name: pa.array(q) for name, q in zip(NAMES, Q.T, strict=True)}
        else:
            wide = [[7.25, *q, None] for q in Q.tolist()]
            columns["observation.state"] = pa.array(wide, kind)
        schema = pa.schema(
            [pa.field(n, c.type, metadata={"unit": n}) for n, c in columns.items()],
            metadata={"huggingface": json.dumps({"info": {"features": {}}}), "own": "x"},
        )
        table = pa.table(columns, schema=schema)
        pq.write_table(table, tmp_path / "a.parquet")
        how = {} if kind is None else {"joints": ["other", *NAMES, "gripper"]}
        done = relabeled(tmp_path / "a.parquet", design, **how)
        old = pq.read_table(tmp_path / "a.parquet")
        new = pq.read_table(done.save(tmp_path / "b.parquet"))
        assert new.schema.equals(old.schema, check_metadata=True), seed
        for name in columns:
            if name.startswith("c"):
                assert new[name].equals(old[name])
        if kind is not None:
            state = new["observation.state"].to_pylist()
            assert all(row[0] == 7.25 and row[4] is None for row in state)
            assert np.abs(np.array([row[1:4] for row in state]) - done.joints).max() < 1e-6
            assert done.written == ("observation.state [1–3]",)


def test_each_other_array_of_an_npz_file_has_its_type(
    design: rp.CellDesign, tmp_path: Path
) -> None:
    """Issue 52, 26.21: 40 random files, single numbers and odd names among the arrays."""
    for seed in range(FILES):
        rng = np.random.default_rng(seed)
        kind = rng.choice(["f4", "f8"])
        state = np.c_[joints(rng), rng.random((K, 2))].astype(kind)
        other = rng.integers(0, 255, (K, *rng.integers(1, 4, rng.integers(0, 3)))).astype("u1")
        arrays = {"joints": state, "own": other, "fps": np.float32(30), "t0": np.full(K, "000001")}
        np.savez(tmp_path / "a.npz", **arrays)
        done = relabeled(tmp_path / "a.npz", design, joints=[*NAMES, "a", "b"])
        with np.load(done.save(tmp_path / "b.npz")) as made:
            assert set(made) == set(arrays)
            for name in ("own", "fps", "t0"):
                assert made[name].dtype == arrays[name].dtype
                assert made[name].tobytes() == arrays[name].tobytes()
            assert made["joints"].dtype == state.dtype
            assert made["joints"][:, 3:].tobytes() == state[:, 3:].tobytes()
            assert np.array_equal(made["joints"][:, :3], done.joints.astype(kind))


def test_the_joints_of_two_arms_are_taken_by_name(
    design: rp.CellDesign, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Issue 52, 26.22: refused without names; with them the other arm's numbers stay."""
    Q = joints(np.random.default_rng(0))
    both = np.c_[Q[::-1], Q]
    file, cell = tmp_path / "a.npz", tmp_path / "cell.json"
    np.savez(file, q=both)
    rp.save(design, cell)
    out = ["--out", str(tmp_path / "o")]
    assert main(["relabel", str(file), str(cell), *out]) == 2
    assert "'q' has 6 numbers per row, but the task has 3 joints" in capsys.readouterr().err
    names = ",".join(["l1", "l2", "l3", *NAMES])
    assert main(["relabel", str(file), str(cell), *out, "--joints", names]) == 0
    assert re.search(r"written +q \[3–5\]", capsys.readouterr().out)
    with np.load(tmp_path / "o" / "a.npz") as made:
        assert made["q"][:, :3].tobytes() == both[:, :3].tobytes()
        task = design.task
        apart = task.positions(made["q"][:, 3:]) - task.positions(Q)
        assert np.abs(apart[:, :2]).max() < 1e-9
    for wrong, said in (
        (names[3:], "must be 6 names"),
        (names.replace("l1", "theta1"), "is twice"),
    ):
        assert main(["relabel", str(file), str(cell), *out, "--joints", wrong]) == 2
        assert said in capsys.readouterr().err


def test_what_pyarrow_cannot_write_is_one_line(
    design: rp.CellDesign, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Issue 52, item 26.21: a table that this version of pyarrow reads, but does not write."""
    Q = joints(np.random.default_rng(0))
    pq.write_table(pa.table(dict(zip(NAMES, Q.T, strict=True))), tmp_path / "a.parquet")
    done = relabeled(tmp_path / "a.parquet", design)

    def refuse(*_: object) -> None:
        raise pa.ArrowNotImplementedError("null lists")

    monkeypatch.setattr(pq, "write_table", refuse)
    with pytest.raises(rp.InputError, match=r"cannot write this table: null lists; use another"):
        done.save(tmp_path / "b.parquet")
    assert not (tmp_path / "b.parquet").exists()


@pytest.mark.parametrize("form", ["list", "motors", "none", "others", "broken"])
def test_lerobot_names_the_numbers_of_a_parquet_file(
    form: str, design: rp.CellDesign, tmp_path: Path
) -> None:
    """Issue 52, item 26.22: two arms and a gripper, by meta/info.json beside the data."""
    Q = joints(np.random.default_rng(0)).astype("f4")
    both = np.c_[Q[::-1], np.ones(len(Q), "f4"), Q]
    names = ["l1.pos", "l2.pos", "l3.pos", "gripper.pos", *(f"{name}.pos" for name in NAMES)]
    data, meta = tmp_path / "data" / "chunk-000", tmp_path / "meta"
    data.mkdir(parents=True)
    meta.mkdir()
    pq.write_table(pa.table({"observation.state": both.tolist()}), data / "file-000.parquet")
    given = {"list": names, "motors": {"motors": names}, "others": [f"a{k}" for k in range(7)]}
    info = {"features": {"observation.state": {"shape": [7], "names": given.get(form)}}}
    if form != "none":
        text = "{" if form == "broken" else json.dumps(info)
        (meta / "info.json").write_text(text, encoding="utf-8")
    if form in ("list", "motors"):
        found = rp.Recording.read(data / "file-000.parquet", design.task)
        assert np.array_equal(found.joints, Q)
        return
    what = (
        "none of the 7 names of 'observation.state' in meta/info.json is a joint .*: got a0, a1, "
    )
    unnamed = "'observation.state' has 7 numbers per row"
    said = {"others": what, "broken": r"info\.json is not JSON: "}
    with pytest.raises(rp.InputError, match=said.get(form, unnamed)):
        rp.Recording.read(data / "file-000.parquet", design.task)


def test_lerobot_names_of_another_arm_are_not_read_by_position(
    design: rp.CellDesign, tmp_path: Path
) -> None:
    """Issue 52, item 26.22: the width fits by chance; named by ``joints=`` the file is read."""
    Q = joints(np.random.default_rng(1))
    file = tmp_path / "demo.parquet"
    pq.write_table(pa.table({"observation.state": Q.tolist()}), file)
    (tmp_path / "meta").mkdir()
    names = {"features": {"observation.state": {"names": ["pan.pos", "lift.pos", "wrist.pos"]}}}
    (tmp_path / "meta" / "info.json").write_text(json.dumps(names), encoding="utf-8")
    with pytest.raises(
        rp.InputError, match=r"none of the 3 names.*pan.pos, lift.pos, wrist.pos.*--joints"
    ):
        rp.Recording.read(file, design.task)
    found = rp.Recording.read(file, design.task, joints=NAMES)
    assert np.array_equal(found.joints, Q)
    names["features"]["observation.state"]["names"] = None
    (tmp_path / "meta" / "info.json").write_text(json.dumps(names), encoding="utf-8")
    assert np.array_equal(rp.Recording.read(file, design.task).joints, Q)


@pytest.fixture(scope="module")
def whole() -> rp.CellDesign:
    """A function around joints of whole numbers."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    few = rp.FitOptions(samples=64, held_out=64)
    cell = rp.Cell(task, task.placement([0.0, 1.0, 1.0]), 0.05)
    control = rp.Pseudoinverse(task)
    return rp.nearest_inverse_function(
        control, cell, posture=[0.1, 0.9, 1.0], degree=1, options=few
    )


ONE = {"dtype": "int64", "_type": "Value"}
LISTS = {
    "list": (pa.list_, [ONE]),
    "sequence": (pa.list_, {"feature": ONE, "_type": "Sequence"}),
    "large list": (pa.large_list, {"feature": ONE, "_type": "LargeList"}),
    "fixed size": (lambda t: pa.list_(t, 3), {"feature": ONE, "length": 3, "_type": "List"}),
}


@pytest.mark.parametrize("form", ["numbers", *LISTS])
def test_integers_that_become_doubles_have_features_of_doubles(
    form: str, whole: rp.CellDesign, tmp_path: Path
) -> None:
    """The library ``datasets`` compares each feature with the type of its column."""
    joints, size = [[0, 1, 1]] * K, {"frame": pa.array(range(K))}
    if form == "numbers":
        columns = {name: pa.array(q) for name, q in zip(NAMES, np.transpose(joints), strict=True)}
        features = dict.fromkeys(NAMES, ONE)
    else:
        kind, feature = LISTS[form]
        columns = {"observation.state": pa.array(joints, kind(pa.int64()))}
        features = {"observation.state": feature}
    info = {"info": {"features": features | {"frame": ONE}}}
    table = pa.table(columns | size).replace_schema_metadata({"huggingface": json.dumps(info)})
    pq.write_table(table, tmp_path / "a.parquet")
    done = relabeled(tmp_path / "a.parquet", whole)
    new = pq.read_table(done.save(tmp_path / "b.parquet"))
    assert np.abs(done.joints - joints).max() > 1e-3 and new["frame"].equals(table["frame"])
    due = pa.float64() if form == "numbers" else LISTS[form][0](pa.float64())
    assert all(new[name].type == due for name in columns)
    made = np.array([new[name].to_pylist() for name in columns])
    assert np.array_equal(made.T if form == "numbers" else made[0], done.joints)
    said = json.loads(new.schema.metadata[b"huggingface"])["info"]["features"]
    assert said.pop("frame") == ONE and "int64" not in json.dumps(said)
    assert json.dumps(said) == json.dumps(features).replace("int64", "float64")


def test_integers_of_a_lerobot_data_set_that_become_doubles_are_described_as_doubles(
    whole: rp.CellDesign, tmp_path: Path
) -> None:
    """LeRobot casts each column to the type in meta/info.json, and refuses 1.5 as an integer."""
    Q = [np.array([0.0, 1.0, 1.0, 7.0]) + 0.001 * np.arange(5)[:, None]] * 2
    names = [*NAMES, "gripper"]
    old = lerobot(tmp_path / "old", "v3.0", Q, Q, names, velocity=False)
    for file in old.glob("data/*/*.parquet"):
        one = pq.read_table(file)
        cells = pa.array([[0, 1, 1, 7]] * len(one))
        pq.write_table(one.set_column(one.schema.get_field_index("action"), "action", cells), file)
    info = json.loads((old / "meta" / "info.json").read_text("utf-8"))
    info["features"]["action"]["dtype"] = "int64"
    (old / "meta" / "info.json").write_text(json.dumps(info), encoding="utf-8")
    new = relabeled(old, whole).save(tmp_path / "new")
    made = [pq.read_table(file)["action"].type for file in new.glob("data/*/*.parquet")]
    assert made == [pa.list_(pa.float64())] * 2
    info["features"]["action"]["dtype"] = "float64"
    assert json.loads((new / "meta" / "info.json").read_text("utf-8")) == info
