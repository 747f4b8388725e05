"""The main job on models of real robots: what the table says is what the motions did."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from arms import planar_urdf
from commands import main, printed
from controls import some
from matplotlib.colors import to_hex
from page_file import read
from said import reads
from store import study_of

import repctl_pin as rp

REDUNDANT = [
    ("panda", None, "pose"),
    ("panda", None, "position"),
    ("xarm7", None, "pose"),
    ("xarm7", None, "position"),
    ("baxter", "left_gripper", "pose"),
    ("baxter", "right_gripper", "pose"),
    ("baxter", "left_gripper", "position"),
    ("tiago", None, "pose"),
    ("tiago", None, "position"),
    ("pr2", None, "pose"),
    ("pr2", None, "position"),
    ("talos", None, "pose"),
    ("talos", None, "position"),
    ("kinova", None, "position"),
    ("ur5", None, "position"),
    ("z1", None, "position"),
    ("ppr", None, "xy"),
    ("prr", None, "xy"),
    ("planar3r", None, "xy"),
    ("planar4r", None, "xy"),
    ("planar7r", None, "xy"),
]


MY_ARM = Path(__file__).parents[2] / "examples" / "my_arm.urdf"

QUICK = {("planar4r", "xy"): {"degree": 1}}
"""Beside the panda, whose table the README shows; what is not at its default."""


@pytest.mark.parametrize(
    "name, frame, kind",
    [
        pytest.param(*arm, marks=() if (arm[0], arm[2]) in QUICK else pytest.mark.slow)
        for arm in REDUNDANT
    ],
    ids=lambda v: str(v),
)
def test_defaults_work_for_every_redundant_arm(name: str, frame: str | None, kind: str) -> None:
    more = QUICK.get((name, kind), {})
    study = rp.study(rp.Problem(name, frame=frame, kind=kind), cycles=3, steps=200, **more)
    creeping, closed = study.row("pseudoinverse").motion, study.row("repeatable").motion
    assert creeping is not None and closed is not None
    assert closed.drift.max() < 1e-8
    assert creeping.drift[-1] > 100 * closed.drift[-1]
    assert closed.tracking_error.max() < 1e-8 and closed.turning_error.max() < 1e-8
    assert closed.limit_margin.min() > 0  # the default path stays inside the limits
    assert creeping.limit_margin[: creeping.steps].min() > 0
    assert study.design.leaf_margin > 0.2 and study.row("repeatable").leaf_margin > 0.2
    assert study.task.r == study.task.n - study.task.m >= 1
    assert not [note for note in study.notes if note.startswith("using task")]


@pytest.mark.parametrize(
    "name, kind, redundant",
    [
        ("kinova", "pose", "axis (r = 1), position (r = 3)"),
        ("ur5", "pose", "axis (r = 1), position (r = 3)"),
        ("z1", "pose", "position (r = 3)"),
        ("planar7r", "pose", "xy (r = 5)"),
        ("planar7r", "position", "xy (r = 5)"),
        ("ppr", "position", "xy (r = 1)"),
    ],
)
def test_no_redundancy_is_said_with_the_kinds_that_have_it(
    name: str, kind: str, redundant: str
) -> None:
    with pytest.raises(rp.InputError) as error:
        rp.study(rp.Problem(name, kind=kind))
    assert redundant in str(error.value) and "\n" not in str(error.value)


def test_default_kind_is_the_first_redundant_one() -> None:
    for name, kind in (("panda", "pose"), ("ur5", "position"), ("planar3r", "xy")):
        assert rp.Problem(name, start="reference", path=False).task.kind == kind


def test_where_no_task_is_redundant_another_frame_is_named_if_there_is_one(tmp_path) -> None:
    arm = rp.Robot.load("planar3r")
    with pytest.raises(
        rp.InputError,
        match=r"moved by 2 joints: .* is redundant there; choose another frame, such as 'tool'",
    ):
        rp.Problem(arm, frame="link2")
    (tmp_path / "two.urdf").write_text(planar_urdf([1.0, 1.0]))
    with pytest.raises(
        rp.InputError, match="moved by 2 joints: no kind of task is redundant there, nor at another"
    ):
        rp.Problem(tmp_path / "two.urdf")


def test_the_default_circle_of_a_finger_is_small(tmp_path) -> None:
    (tmp_path / "finger.urdf").write_text(planar_urdf([0.04, 0.03, 0.02], range_=0.8))
    task = rp.Robot.load(tmp_path / "finger.urdf").task("tool", "xy")
    q0 = np.array([0.2, 0.6, 0.7])
    points = np.array([rp.Problem(task, start=q0).cycle.point(s) for s in (0.0, 0.5)])
    assert 0.001 <= np.linalg.norm(points[0] - points[1]) / 2 < 0.01


@pytest.mark.parametrize("robot", some(["ppr", "kinova", "tiago"], "ppr"))
def test_the_default_start_and_circle_show_the_drift(robot: str) -> None:
    """From the reference pose J⁺ displaces no part of Tiago or Kinova by 3 mm in ten cycles."""
    problem = rp.Problem(robot)
    if robot == "ppr":  # its slides travel 12 m
        np.testing.assert_allclose(np.ptp(problem.cycle.points(400), axis=0)[:2], 1.0, atol=1e-4)
        return
    asked = rp.Problem(robot, path="circle:0.05")
    assert problem.start_is != asked.start_is == "the reference pose"
    chosen, given = (
        rp.follow(rp.Pseudoinverse(it.task), it.cycle, it.start, cycles=1, steps=100)
        for it in (problem, asked)
    )
    assert chosen.drift[0] > 5 * given.drift[0] and chosen.first_violation is None


@pytest.mark.slow
@pytest.mark.parametrize("name", some(["panda", "planar4r"], "planar4r"))
def test_the_default_region_holds_the_motion(name: str) -> None:
    """The tube is laid round a linear design's motion, which a panda's on this square leaves for a
    tenth of its time."""
    study = rp.study(rp.Problem(name, path="square:0.3", plane="xy"), cycles=1, steps=100)
    if name == "panda":
        # joints 3 and 4 meet at the elbow; the shoulder and the wrist stand still in a self-motion
        assert study.task.joint_names[study.elbow] in ("panda_joint3", "panda_joint4")
    tube, motion = study.region, study.row("repeatable").motion
    off = np.abs(motion.q[:, None] - tube.samples) / tube.radius  # (T + 1, S, n)
    assert off.max(axis=2).min(axis=1).max() <= 1
    assert study.row("repeatable").outside == 0 and study.design.region is tube
    small = rp.study(
        rp.Problem(study.task.robot, path="square:0.3", plane="xy", region=0.2),
        cycles=1,
        steps=100,
        degree=1,
    )
    share = np.mean((np.abs(small.row("repeatable").motion.q - small.q0) > 0.2).any(axis=1))
    assert small.row("repeatable").outside == pytest.approx(share)


@pytest.fixture(scope="module")
def small() -> rp.Study:
    problem = rp.Problem("panda", plane="yz", path="circle:0.05")
    return rp.study(problem, cycles=2, steps=100, degree=2)


@pytest.fixture(scope="module")
def full(small: rp.Study, tmp_path_factory: pytest.TempPathFactory) -> str:
    """What ``repctl study --full`` prints of it."""
    return printed(small, tmp_path_factory.mktemp("small"), "--full")[0]


def test_fastest_cycles_are_computed_only_for_a_table_that_has_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def timed(*_: object, **__: object) -> None:
        raise AssertionError("a fastest cycle was computed")

    with monkeypatch.context() as patch:
        patch.setattr("scipy.optimize.milp", timed)
        study = rp.study("ppr", cycles=2, steps=50)
        printed(study, tmp_path / "short")
    assert None not in [row.cycle_time for row in study.rows]
    monkeypatch.setattr("scipy.optimize.milp", timed)
    assert "fastest first cycle" in printed(study, tmp_path / "long", "--full")[0]


@pytest.mark.slow
def test_the_full_table_has_the_fastest_cycles(small: rp.Study, full: str) -> None:
    fastest = [row.cycle_time for row in small.rows]
    assert None not in fastest
    row = re.findall(r"^fastest first cycle, s +(.*)", full, flags=re.MULTILINE)
    assert [cell.split()[0] for cell in re.split(r"  +", row[0])] == [
        f"{time:.3f}" for time in fastest
    ]


@pytest.mark.slow
def test_options_are_what_was_asked(small: rp.Study) -> None:
    """A pose is controlled where nothing else was asked, and nothing said of it."""
    assert not [note for note in small.notes if note.startswith("using task")]
    assert small.path.name == "circle of radius 0.05 m in yz"
    points = small.path.points(64)
    assert np.ptp(points[:, 0]) < 1e-12 and np.isclose(np.ptp(points[:, 1]), 0.1, atol=1e-3)
    start = small.q0 + 0.05
    path = lambda t, q: rp.polygon(t, q, [[0, 0.05, 0], [0, 0.05, 0.05]])  # noqa: E731
    problem = rp.Problem("panda", start=start, path=path, region=0.3)
    other = rp.study(problem, cycles=1, steps=60, degree=1)
    assert np.array_equal(other.q0, start) and np.allclose(other.region.half_width, 0.3)
    assert other.design.potentials.size == 7 and other.path.name == "polygon"


@pytest.mark.slow
def test_a_csv_path_elsewhere_moves_the_start(tmp_path, small: rp.Study) -> None:
    corner = small.task.placement(small.q0).translation + [0.02, 0.03, 0.0]
    loop = corner + np.array([[0, 0, 0], [0.05, 0, 0], [0.05, 0.05, 0], [0, 0, 0]])
    file = tmp_path / "loop.csv"
    np.savetxt(file, loop, delimiter=",", header="x,y,z", comments="")
    study = rp.study(rp.Problem("panda", path=str(file)), cycles=1, steps=120, degree=1)
    assert np.allclose(study.task.placement(study.q0).translation, corner, atol=1e-9)
    assert study.row("repeatable").motion.drift[0] < 1e-8
    assert any("moved" in note for note in study.notes)


def test_table_and_dict_say_what_the_motions_did(tmp_path: Path) -> None:
    small = study_of("planar4r")
    data, text = json.loads(json.dumps(small.as_dict())), printed(small, tmp_path, "--full")[0]
    for row in small.rows:
        assert all(word in text for word in row.label.split())
        assert data["strategies"][row.key]["drift"] == row.motion.drift.tolist()
        assert data["strategies"][row.key]["rms_speed"] == row.motion.rms_speed
    (drifts,) = re.findall(r"^drift after 3 cycles, rad +(.*)", text, re.MULTILINE)
    for row, said in zip(small.rows, drifts.split(), strict=True):
        drift = row.motion.drift[-1]
        assert reads(said, drift, 3 if drift >= 1e-3 else 1)
    assert text.startswith("After 3 cycles the hand is back")
    assert data["start"] == small.q0.tolist() and small.path.name in text


@pytest.mark.slow
@pytest.mark.pictures
def test_files_hold_the_motions(
    small: rp.Study,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(rp, "Problem", lambda *_, **__: None)
    monkeypatch.setattr(rp, "study", lambda *_, **__: small)
    assert main(["study", "panda", "--out", str(tmp_path / "out"), "--json"]) == 0
    files = [Path(file) for file in json.loads(capsys.readouterr().out)["files"]]
    assert [f.name for f in files] == [
        "animation.html",
        "drift.png",
        "joints.png",
        "motion.csv",
        "control.json",
    ]
    assert sorted((tmp_path / "out").iterdir()) == sorted(files)
    for png in files[1:3]:
        assert png.read_bytes().startswith(b"\x89PNG") and png.stat().st_size > 10_000
    page = files[0].read_text(encoding="utf-8")
    assert page.lstrip().lower().startswith("<!doctype html") and page.rstrip().endswith("</html>")
    rows = list(csv.DictReader(files[3].open(encoding="utf-8")))
    ours = [row for row in rows if row["strategy"] == "repeatable"]
    motion = small.row("repeatable").motion
    assert len(ours) == 201 and [row["strategy"] for row in rows].count("pseudoinverse") == 201
    for i in (0, 77, 200):
        q = [float(ours[i][name]) for name in small.task.joint_names]
        assert np.allclose(q, motion.q[i], atol=1e-9) and np.isclose(
            float(ours[i]["time"]), motion.t[i]
        )


def test_a_plane_beside_a_path_of_its_own_is_refused() -> None:
    with pytest.raises(
        rp.InputError, match="only the default circle and a path given by name take a plane"
    ):
        rp.study(rp.Problem("panda", path=lambda task, q0: rp.circle(task, q0, 0.1), plane="xz"))


@pytest.mark.slow
def test_a_path_out_of_reach_is_refused() -> None:
    far = lambda t, q: rp.polygon(t, q, [[30.0, 0, 0], [30.0, 10.0, 0]])  # noqa: E731
    with pytest.raises(rp.InputError, match="cannot reach"):
        rp.study(rp.Problem("planar3r", path=far))
    with pytest.raises(rp.InputError, match="no circle of radius 20 m"):
        rp.study(rp.Problem("planar3r", path="circle:20"))


def test_a_singular_start_is_refused() -> None:
    with pytest.raises(rp.SingularityError, match="choose another start"):
        rp.study(rp.Problem("planar3r", start=[0.3, 0.0, 0.0]))


@pytest.mark.slow
def test_controls_of_ones_own_stand_beside(tmp_path) -> None:
    """J⁺ written by hand as a function does what J⁺ does; it is in the table, the files, the page
    and the report."""
    robot = rp.Robot.load(MY_ARM)  # without meshes, whose pages take long
    task = robot.task(robot.default_frame, "pose")
    own = {
        "by <hand>": lambda q, xdot: np.linalg.lstsq(task.jacobian(q), xdot)[0],
        "M": rp.WeightedInverse(task, "inertia"),
    }
    study = rp.study(rp.Problem(robot, region=0.2), controls=own, cycles=2, steps=60, degree=1)
    assert [row.key for row in study.rows] == [
        "pseudoinverse",
        "posture",
        "posture_off",
        "by <hand>",
        "M",
        "repeatable",
    ]
    by_hand, plain = study.row("by <hand>").motion, study.row("pseudoinverse").motion
    np.testing.assert_allclose(by_hand.q, plain.q, atol=1e-9)
    weighted = rp.follow(own["M"], study.path, study.q0, cycles=2, steps=60)
    np.testing.assert_array_equal(study.row("M").motion.q, weighted.q)
    text, figures = printed(study, tmp_path, "--full", "--report")
    assert "<hand>" in text
    lines = figures[0].axes[0].lines
    assert [line.get_label() for line in lines][3:5] == ["by <hand>", "M"]
    assert len({to_hex(line.get_color()) for line in lines}) == 6
    page = (tmp_path / "animation.html").read_text(encoding="utf-8")
    assert [arm["label"] for arm in read(page)[0]["arms"]] == [
        "J⁺", "by <hand>", "M", "nearest repeatable",
    ]  # fmt: skip
    with (tmp_path / "motion.csv").open(encoding="utf-8") as file:
        assert {row["strategy"] for row in csv.DictReader(file)} == {row.key for row in study.rows}
    report = (tmp_path / "report.html").read_text(encoding="utf-8")
    (cells,) = re.findall(r'"row">drift after 2 cycles, rad</th>(.*)</tr>', report)
    assert reads(re.findall("<td>(.*?)</td>", cells)[4], weighted.drift[-1], 3)
    assert "by <hand>" not in report


def test_controls_that_cannot_be_used_are_named() -> None:
    other = rp.Pseudoinverse(rp.Robot.load("panda").task("panda_hand_tcp", "position"))
    problem = rp.Problem("panda", region=0.2)
    for controls, words in (
        ({"repeatable": other}, "'repeatable' is the name of"),
        ({"J⁺": other}, "'J⁺' is the name of"),
        (other.velocity, r"controls must be a dictionary .*\{'mine': control\}"),
        (
            {"mine": other},
            "'mine' is for a position task of 'panda_hand_tcp' .*, but the study is for a "
            "pose task of 'panda_hand_tcp'",
        ),
        ({" ": other}, "a name must be a text that is not empty"),
        ({"mine": 3}, "a function"),
        ({"mine": lambda q, xdot: q[:3]}, "must be 7 finite numbers"),
    ):
        with pytest.raises(rp.InputError, match=words):
            rp.study(problem, controls=controls, cycles=1, steps=20, degree=1)


@pytest.mark.slow
def test_the_first_start_that_can_follow_the_path_is_taken() -> None:
    """A path out of the reference pose's reach: the next good start is tried, and said."""
    first = rp.Problem("panda", path=False).start
    asked = []

    def path(task: rp.Task, q0: np.ndarray) -> rp.TaskPath:
        asked.append(q0)
        if len(asked) == 1:
            raise rp.InputError("not from here")
        return rp.circle(task, q0, 0.03)

    study = rp.study(rp.Problem("panda", path=path), cycles=1, steps=60, degree=1)
    assert np.array_equal(asked, [first, study.q0])
    assert not np.array_equal(first, study.q0)
    assert sum(note.startswith("the start is ") for note in study.notes) == 1
    with pytest.raises(rp.InputError, match="not from here"):
        asked.clear()
        rp.study(rp.Problem("panda", path=path, start=first))


@pytest.mark.slow
def test_where_an_arm_creeps_is_said_when_it_does_not_here() -> None:
    """so100 turns about a vertical axis and folds in a plane: by symmetry a level loop encloses
    nothing there."""
    level = rp.study(rp.Problem("so100", region=0.2), cycles=1, steps=100, degree=1)
    plain = rp.Pseudoinverse(level.task)
    assert level.path.name.endswith("xy") and level.row("pseudoinverse").motion.drift[0] < 1e-6
    (note,) = [note for note in level.notes if "hardly drifts" in note]
    rate = rp.drift_per_area(plain, level.q0)
    assert (
        f"small loops in yz it drifts by {rate[1, 2]:.2g} rad per m²" in note and rate.argmax() == 5
    )
    upright = rp.study(rp.Problem("so100", plane="yz", region=0.2), cycles=1, steps=100, degree=1)
    assert upright.row("pseudoinverse").motion.drift[0] > 0.05
    assert not [note for note in upright.notes if "hardly" in note]


def test_a_study_is_short_at_the_prompt() -> None:
    small = study_of("planar4r")
    said = repr(small)
    assert len(said) < 250 and "\n" not in said
    for row in small.rows:
        assert f"{row.label} {row.motion.drift[-1]:.2g}" in said
