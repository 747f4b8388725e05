"""Designs as files: exact, whole or not at all, and refused where they do not fit."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import multiprocessing
import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from controls import some
from design_file import checksum
from designs import Cycle, with_potentials
from numpy.polynomial.chebyshev import chebval
from scipy.spatial.transform import Rotation

import repctl_pin as rp


@pytest.fixture(scope="module")
def small(panda_pose: rp.Task) -> rp.Design:
    from arms import Q_PANDA

    plain = rp.Pseudoinverse(panda_pose)
    return rp.nearest_repeatable(
        plain,
        rp.Polynomial(Q_PANDA, 1, 0.3),
        rp.Box(Q_PANDA, 0.3),
        options=rp.FitOptions(samples=256, held_out=256),
    )


@pytest.fixture
def saved(tmp_path: Path, panda_design: rp.Design) -> Path:
    return rp.save(panda_design, tmp_path / "panda.json")


def same(a: rp.Design, b: rp.Design) -> None:
    """Every attribute the same, bit for bit."""
    for attribute in dataclasses.fields(rp.Design):
        one, other = getattr(a, attribute.name), getattr(b, attribute.name)
        if isinstance(one, (float, int, str, tuple, np.ndarray)):
            assert type(one) is type(other) or isinstance(one, float), attribute.name
            assert np.array_equal(one, other), attribute.name
    assert a.task.joint_names == b.task.joint_names and type(a.desired) is type(b.desired)
    assert repr(a.potentials) == repr(b.potentials) and str(a.region) == str(b.region)


def test_save_load_save_is_byte_identical_and_steps_bit_for_bit(
    tmp_path, saved, panda_design, panda_pose
) -> None:
    for task in (None, panda_pose):
        loaded = rp.load(saved, task)
        again = rp.save(loaded, tmp_path / "again.json")
        assert again.read_bytes() == saved.read_bytes()
        same(panda_design, loaded)
        rng = np.random.default_rng(0)
        target, leaf = (
            panda_pose.placement(panda_pose.reference),
            loaded.inverse.leaf(panda_pose.reference),
        )
        for q in panda_pose.reference + 0.2 * rng.normal(size=(20, 7)):
            xdot = rng.normal(size=6)
            assert np.array_equal(
                loaded.inverse.velocity(q, xdot), panda_design.inverse.velocity(q, xdot)
            )
            steps = [
                d.inverse.step(q, target, 0.01, xdot, leaf=leaf, gain=50.0)
                for d in (loaded, panda_design)
            ]
            assert np.array_equal(*steps)


def test_every_kind_of_field_region_desired_inverse_and_task(
    tmp_path, panda, panda_pose, q_panda, small
) -> None:
    waves = rp.Fourier(7, 1, variables=[0, 2], period=5.0)
    family = waves + rp.Polynomial(
        q_panda, 2, np.linspace(0.2, 0.8, 7), variables=[1, 3], cross=False
    )
    A = np.random.default_rng(1).normal(size=(family.size, 1))
    tube = rp.Tube(q_panda + 0.01 * np.arange(21).reshape(3, 7), np.linspace(0.1, 0.7, 7))
    workspace = rp.WorkspaceBox(
        panda_pose, panda_pose.placement(q_panda).translation, 0.1, within=rp.Box(q_panda, 0.4)
    )
    limits = rp.LimitWeight(panda_pose, 0.7, 0.2)
    weights = [
        rp.WeightedInverse(panda_pose, w)
        for w in (limits, "inertia", np.linspace(0.1, 0.7, 7), np.eye(7) + 0.3)
    ]
    for region in (tube, workspace):
        for desired in (*weights, rp.Pseudoinverse(panda_pose)):
            design = dataclasses.replace(
                small,
                inverse=rp.RepeatableInverse(panda_pose, family.weighted(A), region=region),
                potentials=family,
                coefficients=A,
                region=region,
                desired=desired,
            )
            loaded = rp.load(rp.save(design, tmp_path / "d.json"))
            same(design, loaded)
            assert np.array_equal(design.region.random(64, 3), loaded.region.random(64, 3))
            assert np.array_equal(design.desired(q_panda), loaded.desired(q_panda))
            assert np.array_equal(design.inverse(q_panda + 0.1), loaded.inverse(q_panda + 0.1))

    planar = rp.Robot.load("planar3r", base="link1", lock=["theta1"]).task(
        "tool", "xy", joints=None
    )
    # a chain that lock and base have shortened; its names are kept by the next one
    assert planar.r == 0


def test_a_file_in_other_joint_coordinates_is_refused_with_the_remedy(tmp_path, small) -> None:
    """Older files have the key ``coordinates``: null is today's q, a matrix T a ψ of q = T ψ."""
    content = json.loads(rp.save(small, tmp_path / "d.json").read_text(encoding="utf-8"))
    assert "coordinates" not in content["task"]
    for T in (None, np.tril(np.ones((7, 7))).tolist()):
        content["task"]["coordinates"] = T
        content["checksum"] = checksum(content)
        (tmp_path / "old.json").write_text(json.dumps(content), encoding="utf-8")
        if T is None:
            same(small, rp.load(tmp_path / "old.json"))
            continue
        for task in (None, small.task):
            with pytest.raises(rp.InputError, match="joint coordinates ψ.*--weight absolute") as no:
                rp.load(tmp_path / "old.json", task)
            assert "\n" not in str(no.value)


def test_what_no_file_can_hold_is_refused(tmp_path, panda_pose, q_panda, small) -> None:
    density = rp.Box(q_panda, 0.3, density=lambda Q: np.ones(len(Q)))
    own = rp.CustomPotentials([lambda q: q[0]])
    custom = rp.CustomInverse(panda_pose, lambda q: np.linalg.pinv(panda_pose.jacobian(q)))
    for change, words in (
        ({"region": density}, "density"),
        ({"desired": custom}, "CustomInverse"),
        ({"cost_error": float("nan")}, "cost_error"),
    ):
        with pytest.raises(rp.InputError, match=words):
            rp.save(dataclasses.replace(small, **change), tmp_path / "d.json")
    with pytest.raises(rp.InputError, match="user-defined functions"):
        rp.save(with_potentials(small, own, np.ones((1, 1))), tmp_path / "d.json")
    with pytest.raises(rp.InputError, match="nearest_repeatable"):
        rp.save(small.inverse, tmp_path / "d.json")
    assert list(tmp_path.iterdir()) == []


PATHS = {
    "circle": lambda task, q: rp.circle(task, q, 0.1, start_angle=0.3),
    "eight": lambda task, q: rp.figure_eight(task, q, 0.05),
    "polygon": lambda task, q: rp.polygon(
        task, q, [(0.1, 0, 0), (0.1, 0.1, 0.05), (0, 0.07, 0.01)]
    ),
}


@pytest.mark.parametrize("name", PATHS)
def test_the_cycle_of_a_control_comes_back(name: str, tmp_path, small, panda_pose, q_panda) -> None:
    """Start and time exactly; the path to rounding, corners included, and what is followed with
    it."""
    path = PATHS[name](panda_pose, q_panda)
    design = dataclasses.replace(small, cycle=Cycle(q_panda, path, 3.0))
    file = rp.save(design, tmp_path / "control.json")
    cycle = rp.load(file, panda_pose).cycle
    assert np.array_equal(cycle.start, q_panda) and cycle.period == 3.0
    assert (cycle.path.name, cycle.path.breaks) == (path.name, path.breaks)
    for s in np.linspace(0, 1, 57):
        assert (
            np.abs(cycle.path.placement(s).homogeneous - path.placement(s).homogeneous).max()
            < 1e-12
        )
        assert np.abs(cycle.path.twist(s) - path.twist(s)).max() < 1e-9
    again = [rp.follow(small.inverse, p, q_panda, cycles=1, steps=60).q for p in (path, cycle.path)]
    assert np.abs(again[0] - again[1]).max() < 1e-9
    again_file = rp.save(rp.load(file, panda_pose), tmp_path / "again.json")
    one, two = (json.loads(f.read_text())["cycle"]["pieces"] for f in (file, again_file))
    for a, b in zip(one, two, strict=True):
        assert np.allclose(a["coefficients"], b["coefficients"], atol=1e-12)


def test_a_turning_path_is_told_by_quaternions(small, panda_pose, q_panda, tmp_path) -> None:
    """A frame that goes round a loop and back and forth about a tilted axis: the polynomials of the
    file, evaluated by NumPy, give its position and orientation."""
    axis, turn = np.array([1.0, 2.0, 2.0]) / 3, 2 * np.pi

    def position(s: float) -> np.ndarray:
        return 0.1 * np.array([np.cos(turn * s), np.sin(turn * s), np.sin(2 * turn * s)])

    def slope(s: float) -> np.ndarray:
        rates = [-np.sin(turn * s), np.cos(turn * s), 2 * np.cos(2 * turn * s)]
        return 0.1 * turn * np.array(rates)

    def turned(s: float) -> np.ndarray:
        return Rotation.from_rotvec(2.0 * np.sin(turn * s) * axis).as_matrix()

    path = rp.TaskPath("turning", position, slope, turned, breaks=(0.5,))
    design = dataclasses.replace(small, cycle=Cycle(q_panda, path, 3.0))
    file = rp.save(design, tmp_path / "control.json")
    pieces = json.loads(file.read_text())["cycle"]["pieces"]
    assert [pieces[0]["begin"], pieces[-1]["end"]] == [0, 1]
    for s in np.linspace(0.01, 0.99, 23):
        piece = next(p for p in pieces if p["begin"] <= s <= p["end"])
        begin, end = piece["begin"], piece["end"]
        values = chebval((2 * s - begin - end) / (end - begin), piece["coefficients"])
        assert np.abs(values[:3] - path.placement(s).translation).max() < 1e-12
        assert np.abs(Rotation.from_quat(values[3:]).as_matrix() - turned(s)).max() < 1e-11


def test_the_file_holds_every_figure_of_a_design(saved) -> None:
    own = {"inverse", "desired", "potentials", "region", "coefficients", "cycle", "proof"}
    figures = json.loads(saved.read_text())["figures"]
    assert {a.name for a in dataclasses.fields(rp.Design)} - own == set(figures)


def test_equal_designs_are_written_alike(small, tmp_path) -> None:
    """A proof holds nothing of the clock, so that equal runs have equal files and names."""
    files = [
        rp.save(replaced, tmp_path / f"{k}.json").read_bytes()
        for k in range(2)
        for replaced in [dataclasses.replace(small, proof=rp.prove(small, margin=0.1))]
    ]
    assert files[0] == files[1] and b'"proof"' in files[0]


def test_the_seconds_that_older_files_give_for_a_proof_are_passed_over(small, tmp_path) -> None:
    proof = rp.prove(small, margin=0.1)
    file = rp.save(dataclasses.replace(small, proof=proof), tmp_path / "control.json")
    older = json.loads(file.read_text())["proof"] | {"seconds": 0.25}
    loaded = rp.load_design(edited(file, proof=older)).proof
    assert loaded is not None and repr(loaded) == repr(proof)


# ---- refusals
# --------------------------------------------------------------------------------------


def test_another_robot_frame_kind_or_joints_is_refused_by_name(saved, panda) -> None:
    cases = {
        "robot 'panda', not 'xarm7'": rp.Robot.load("xarm7").task("link_eef", "pose"),
        "frame 'panda_hand_tcp', not 'panda_link8'": panda.task("panda_link8", "pose"),
        "task kind 'pose', not 'position'": panda.task("panda_hand_tcp", "position"),
        "joints panda_joint1": panda.task(
            "panda_hand_tcp", "pose", joints=panda.chain("panda_hand_tcp")[1:]
        ),
        "base None, not 'panda_link0'": rp.Robot.load("panda", base="panda_link0").task(
            "panda_hand_tcp", "pose"
        ),
    }
    for words, task in cases.items():
        with pytest.raises(rp.InputError, match=words):
            rp.load(saved, task)


def test_a_urdf_that_was_changed_is_refused(tmp_path) -> None:
    from arms import planar_urdf

    file = tmp_path / "arm.urdf"
    file.write_text(planar_urdf([1, 0.8, 0.6]))
    task = rp.Robot.load(file).task("tool", "xy")
    center = np.array([0.3, 0.8, 0.8])
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        rp.Polynomial(center, 1),
        rp.Box(center, 0.2),
        options=rp.FitOptions(samples=256, held_out=256),
    )
    saved = rp.save(design, tmp_path / "arm.json")
    same(design, rp.load(saved, task))
    with pytest.raises(rp.InputError, match=r"not in the catalogue; load it with the task") as no:
        rp.load(saved)
    same(design, eval(str(no.value).partition("the task: ")[2]))  # the line works as it is
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    apart = saved.rename(folder / "arm.json")
    with pytest.raises(rp.InputError, match=r"rp\.Robot\.load\('PATH/arm\.urdf'\)"):
        rp.load(apart)
    saved = apart.rename(saved)
    file.write_text(planar_urdf([1, 0.8, 0.601]))
    with pytest.raises(rp.InputError, match=r"displaced by 0\.00\d* m"):
        rp.load(saved, rp.Robot.load(file).task("tool", "xy"))


def edited(saved: Path, **changes) -> Path:
    """Change entries and make the checksum fit again: a newer version, or somebody who knows
    how."""
    content = json.loads(saved.read_text()) | changes
    content["checksum"] = checksum(content)
    saved.write_text(json.dumps(content))
    return saved


def test_the_checksum_is_of_everything_else_however_it_is_laid_out() -> None:
    """What was written yesterday has to be readable tomorrow: keys in order, no spaces, names as
    they are."""
    content = {"ä": 1, "checksum": "another", "b": [2.5, "é"]}
    written = '{"b":[2.5,"é"],"ä":1}'.encode()
    assert checksum(content) == f"sha256:{hashlib.sha256(written).hexdigest()}"


def test_no_text_of_a_file_holds_control_characters(small, panda_pose, q_panda, tmp_path) -> None:
    """Written, they are escaped; in a file by somebody else they are refused, though its checksum
    fits."""
    path = rp.circle(panda_pose, q_panda, 0.1)
    named = dataclasses.replace(path, name="loop\x1b[2J\nof mine")
    file = rp.save(
        dataclasses.replace(small, cycle=Cycle(q_panda, named, 3.0)), tmp_path / "control.json"
    )
    assert rp.load(file, panda_pose).cycle.path.name == "loop\\x1b[2J\\nof mine"
    cycle = json.loads(file.read_text())["cycle"]
    for escape in ("\x1b[2J", "a\nforged: a line", "\x9b", "\u202e"):
        with pytest.raises(rp.InputError, match="a text contains a control character"):
            rp.load(edited(file, cycle=cycle | {"path": escape}), panda_pose)


def test_a_cell_is_placed_by_a_rigid_transform(tmp_path) -> None:
    task = rp.Robot.load("planar3r").task(kind="xy")
    cell = rp.Cell(task, task.placement(np.array([0.3, 0.8, 0.8])), 0.05)
    found = rp.nearest_inverse_function(
        rp.Pseudoinverse(task), cell, degree=1, options=rp.FitOptions(samples=16, held_out=64)
    )
    file = rp.save(found, tmp_path / "cell.json")
    rows = json.loads(file.read_text())["placement"]
    for last in ([0.0, 0.0, 0.0, 2.0], [0.5, 0.0, 0.0, 1.0]):
        with pytest.raises(
            rp.InputError, match="last row of the cell's placement must be 0, 0, 0, 1"
        ):
            rp.load(edited(file, placement=[*rows[:3], last]))


@pytest.mark.parametrize("end", [0.99, 1.01])
def test_a_path_that_is_not_whole_is_refused(
    end: float, small, panda_pose, q_panda, tmp_path
) -> None:
    cycle = Cycle(q_panda, rp.circle(panda_pose, q_panda, 0.1), 3.0)
    file = rp.save(dataclasses.replace(small, cycle=cycle), tmp_path / "control.json")
    pieces = json.loads(file.read_text())["cycle"]
    pieces["pieces"][-1]["end"] = end
    with pytest.raises(rp.InputError, match="do not lead from s = 0 to 1"):
        rp.load(edited(file, cycle=pieces), panda_pose)


def test_a_file_without_a_fingerprint_is_refused(saved) -> None:
    content = json.loads(saved.read_text())
    content["task"]["fingerprint"] = []
    content["checksum"] = checksum(content)
    saved.write_text(json.dumps(content))
    with pytest.raises(rp.InputError, match="no fingerprint"):
        rp.load(saved)


def test_a_newer_schema_is_refused_with_a_remedy(saved) -> None:
    with pytest.raises(rp.InputError, match=r"schema 3, but .* reads schema 2; upgrade repctl-pin"):
        rp.load(edited(saved, schema=3, written_by="9.0"))


def test_an_older_schema_is_refused_by_name(saved) -> None:
    with pytest.raises(
        rp.InputError, match=r"schema 1, but repctl-pin .* reads schema 2; design again"
    ):
        rp.load(edited(saved, schema=1))


def test_a_changed_number_is_noticed(saved) -> None:
    text = saved.read_text()
    at = text.index('"coefficients"') + 40
    digit = next(i for i in range(at, len(text)) if text[i].isdigit())
    saved.write_text(text[:digit] + str((int(text[digit]) + 1) % 10) + text[digit + 1 :])
    with pytest.raises(rp.InputError, match="changed after it was written"):
        rp.load(saved)


def test_five_hundred_mutated_files(tmp_path, small, panda_pose) -> None:
    """Each is refused with one line, or means the same; none crashes."""
    saved = rp.save(small, tmp_path / "good.json")
    good, mutant = saved.read_bytes(), tmp_path / "mutant.json"
    rng = np.random.default_rng(0)
    kept = 0
    for k in range(500):
        data = bytearray(good)
        for _ in range(int(rng.integers(1, 4))):
            i, kind = int(rng.integers(len(data))), k % 7
            if kind == 0:
                data[i] ^= 1 << int(rng.integers(8))
            elif kind == 1:
                del data[i : i + int(rng.integers(1, 30))]
            elif kind == 2:
                data[i:i] = rng.integers(0, 256, int(rng.integers(1, 8))).astype(np.uint8).tobytes()
            elif kind == 3:
                del data[i:]
                data = data or bytearray(b" ")
            elif kind == 4:
                data[i : i + 1] = bytes([int(rng.choice(list(b'0123456789{}[],":.eE-+ ')))])
            elif kind == 5:
                j = int(rng.integers(len(data)))
                data[i : i + 20], data[j : j + 20] = data[j : j + 20], data[i : i + 20]
            else:
                data[i:i] = b" \n\t" if rng.random() < 0.7 else b"1e999"
        mutant.write_bytes(bytes(data))
        try:
            loaded = rp.load(mutant, panda_pose)
        except rp.InputError as error:
            assert "\n" not in str(error) and "mutant.json" in str(error)
        else:
            same(small, loaded)
            kept += 1
    assert 1 <= kept < 250  # white space between entries changes no meaning; most else does


def _paths(value, path=()):
    yield path
    if isinstance(value, dict):
        for key in value:
            yield from _paths(value[key], (*path, key))
    if isinstance(value, list) and len(value) < 50:
        for i in range(len(value)):
            yield from _paths(value[i], (*path, i))


def test_wrong_content_with_a_right_checksum_is_refused_too(tmp_path, small, panda_pose) -> None:
    """Every entry in turn replaced by what it cannot be: an error of ours, or a design; never a
    crash."""
    good = json.loads(rp.save(small, tmp_path / "good.json").read_text())
    mutant = tmp_path / "mutant.json"
    others = (None, "two\nlines", -1, [], {}, True, [[0.5]], 1e30)
    refused = 0
    for k, path in enumerate(p for p in _paths(good) if p and p[0] not in ("checksum",)):
        content = json.loads(json.dumps(good))
        holder = content
        for key in path[:-1]:
            holder = holder[key]
        holder[path[-1]] = others[k % len(others)]
        content["checksum"] = checksum(content)
        mutant.write_text(json.dumps(content))
        try:
            rp.load(mutant, panda_pose)
        except rp.RepctlError as error:
            refused += 1
            assert "\n" not in str(error)
    assert refused > 100


@pytest.mark.parametrize(
    "text, words",
    [
        ("", "not a .*design file"),
        ("[]", "not a .*design file"),
        ("{}", "format"),
        ('{"format": "repctl design"}', "schema"),
        ('{"format": "repctl design", "schema": true}', "schema"),
        ('{"format": "repctl design", "schema": 2, "schema": 2}', "written_by"),
        ('{"format": "repctl design", "schema": 2, "x": NaN}', "not valid JSON"),
        ('{"format": "repctl design", "schema": 0}', "it has schema 0, but schemas begin with 1"),
        ("[" * 100_000, "not a .*design file"),
    ],
)
def test_what_is_no_design_at_all(tmp_path, text: str, words: str) -> None:
    file = tmp_path / "d.json"
    file.write_text(text)
    with pytest.raises(rp.InputError, match=words) as caught:
        rp.load(file)
    assert "\n" not in str(caught.value)


def test_no_file_a_folder_and_bytes(tmp_path) -> None:
    with pytest.raises(rp.InputError, match="No such file"):
        rp.load(tmp_path / "none.json")
    with pytest.raises(rp.InputError, match="it is a folder"):
        rp.load(tmp_path)
    (tmp_path / "b.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(rp.InputError, match="not UTF-8 text"):
        rp.load(tmp_path / "b.json")


# ---- whole or not at all
# ---------------------------------------------------------------------------


def _save_until(line: int, design: rp.Design, file: Path) -> None:
    """Save, killed by SIGKILL before the ``line``-th line that the package runs after its first
    look into the file's folder."""
    package, left = str(Path(rp.__file__).parent), -1

    def listen(event: str, args: tuple[object, ...]) -> None:
        nonlocal left
        names = [str(arg) for arg in args if isinstance(arg, str | Path)]
        if left < 0 and any(name.startswith(str(file.parent)) for name in names):
            left = line

    def trace(frame, event, _):
        nonlocal left
        if not frame.f_code.co_filename.startswith(package):
            return None
        if event == "line" and left >= 0:
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            left -= 1
        return trace

    sys.addaudithook(listen)
    sys.settrace(trace)
    rp.save(design, file)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="kills forked processes")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("every", some([1, 4], 4))
def test_killed_at_any_line_it_leaves_a_whole_file(every, tmp_path, panda_design, small) -> None:
    """A process killed anywhere in its writing leaves the old design or the new one, whole."""
    fork = multiprocessing.get_context("fork")
    folder = tmp_path / "kept"
    folder.mkdir()
    file = folder / "design.json"
    old = rp.save(small, tmp_path / "old.json").read_bytes()
    new = rp.save(panda_design, tmp_path / "new.json").read_bytes()
    found, interrupted = [], 0
    for line in range(0, 200, every):
        rp.save(small, file)
        process = fork.Process(target=_save_until, args=(line, panda_design, file))
        process.start()
        process.join()
        found.append(file.read_bytes())
        others = [p for p in folder.iterdir() if p != file]
        interrupted += bool(others)
        for other in others:
            other.unlink()
        if process.exitcode == 0:
            break
        assert process.exitcode == -signal.SIGKILL
    assert process.exitcode == 0 and len(found) > 5  # lines of the writer, one after the other
    renamed = found.index(new)
    assert found == [old] * renamed + [new] * (len(found) - renamed)
    assert 0 < renamed < len(found) - 1 and interrupted  # killed on both sides of it
    rp.load(file)


def test_a_folder_that_is_not_there(tmp_path, small) -> None:
    with pytest.raises(rp.InputError, match="cannot write .*No such file"):
        rp.save(small, tmp_path / "none" / "d.json")
