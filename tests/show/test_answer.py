"""What a study prints: its sentences and its tables say what the motions did."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms import planar_urdf
from commands import printed
from controls import some
from page_file import Drawn
from said import reads, value_of
from shown import answered
from store import study_of
from terminals import terminal_of

import repctl_pin as rp


@pytest.fixture(scope="module")
def study() -> rp.Study:
    """Four joints that drift by some centimetres."""
    return study_of("planar4r")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("answer")


@pytest.fixture(scope="module")
def answer(study: rp.Study, folder: Path) -> str:
    return printed(study, folder)[0]


def test_what_breaks_a_limit_stands_in_the_first_lines(tmp_path: Path) -> None:
    """A speed limit, too: of the answer, of the full table and of the page."""
    fast = rp.study("planar3r", cycles=2, steps=100, degree=1, period=0.5)
    words = "Under either control, theta2 reaches 1.5 times its speed limit in cycle 1."
    short, _ = printed(fast, tmp_path)
    assert short.startswith(words) and first_of(fast, tmp_path).startswith(words)
    page = (tmp_path / "animation.html").read_text("utf-8")
    assert f'<p id="verdict"><b class="bad">{words} </b>' in page
    assert "limits are kept" not in page.partition("<script")[0]
    urdf = re.sub(r'velocity="[^"]*"', 'velocity="0"', planar_urdf([0.4, 0.3, 0.2]))
    (tmp_path / "arm.urdf").write_text(urdf)  # read as no limit
    blind = rp.study(str(tmp_path / "arm.urdf"), cycles=2, steps=100, degree=1)
    told = "Joint limits are kept; joint speeds are not checked."
    assert told in rp.animation(blind).page and told in first_of(blind, tmp_path)
    answer = " ".join(printed(blind, tmp_path, "--full")[0].split())
    assert "note: no speed limit in the model, so speeds are not checked: theta1," in answer


def first_of(study: rp.Study, folder: Path) -> str:
    """The first sentences of the full table."""
    text, _ = printed(study, folder, "--full")
    return " ".join(text.partition("\n\n")[0].split())


def changed(study: rp.Study, **rows: dict) -> rp.Study:
    """The same study with other rows."""
    return replace(study, rows=tuple(replace(row, **rows.get(row.key, {})) for row in study.rows))


def test_it_says_what_the_motions_did(study: rp.Study, answer: str) -> None:
    plain, posture, closed = (
        study.row(key).motion for key in ("pseudoinverse", "posture", "repeatable")
    )
    drawn, off = Drawn(study.robot), answered(answer, "link 4 off")
    for motion, said in zip((plain, posture), off, strict=False):
        moved = drawn.moved(*study.task.to_robot(motion.q[[-1, 0]]))
        assert drawn.links[moved.argmax()] == "link4" and reads(said, moved.max())
    assert off[2:] == ["0"]
    sentence = (
        "After 3 cycles the hand is back in x and y under either control. "
        "Link 4 of the arm is not: "
        f"{off[0]} from its start under the usual control, 0 under the repeatable one."
    )
    assert " ".join(answer.split()).startswith(sentence)
    page = re.sub(r"<[^>]*>", "", rp.animation(study).page)
    assert sentence in page.replace("\u00a0", " ")
    drifts = answered(answer, "joints off")
    for motion, said in zip((plain, posture), drifts, strict=False):
        assert reads(said, motion.drift[-1], 3)
    assert drifts[2:] == ["0"]
    assert answered(answer, "first cycle closes") == ["no", "no", "yes"]
    none, *speeds = answered(answer, "extra joint speed, cycle 1")
    for motion, said in zip((posture, closed), speeds, strict=True):
        share = motion.first_rms_speed / plain.first_rms_speed - 1
        assert value_of(said) == pytest.approx(share, abs=5.01e-4)
    assert none == "–"
    assert answered(answer, "limits") == ["kept"] * 3 and "!" not in answer
    assert "\nnot checked: 5 bodies without a collision shape\n" in answer  # issue 37, item 16
    closes = study.design.proof.closes
    assert closes and f"\n{closes.words}: proved\n" in answer
    assert re.match(
        r"closed paths within [\d.]+ [cm]m .*of the path at each moment close", closes.words
    )


@pytest.fixture(scope="module")
def beyond() -> rp.Study:
    """A motion that leaves its limits: theta1 ends at 2π, where this circle takes it."""
    problem = rp.Problem("planar3r", start=[6.2, 1.0, -1.4], path="circle:0.4:0", plane="xy")
    return rp.study(problem, cycles=2, steps=60, degree=1)


@pytest.mark.slow
def test_violations_are_marked_and_named(study: rp.Study, beyond: rp.Study, folder: Path) -> None:
    text, _ = printed(beyond, folder)
    motion, task = beyond.row("pseudoinverse").motion, beyond.task
    outside = (motion.q < task.lower) | (motion.q > task.upper)
    first = int(np.argmax(outside.any(axis=1)))
    (joint,) = np.flatnonzero(outside[first])
    cycle, share = divmod(first / 60, 1)
    assert answered(text, "limits")[0] == f"cycle {cycle + 1:.0f}!"
    into = f"{100 * share:.0f} % into cycle {cycle + 1:.0f}"
    name = task.joint_names[joint]
    assert f"! usual control: {name} exceeds its limits {into}" in text
    # nor is the speed of a motion compared that violates a limit
    assert beyond.row("repeatable").motion.first_violation is not None
    assert not [note for note in beyond.notes if note.startswith("joint speed: ")]
    assert [note for note in study.notes if note.startswith("joint speed: ")]


@pytest.mark.slow
def test_what_lies_outside_the_region_is_the_loudest_line(study: rp.Study, folder: Path) -> None:
    motion = study.row("repeatable").motion
    small = replace(motion, region=rp.Box(study.q0, 0.2))
    share = np.mean((np.abs(motion.q - study.q0) > 0.2).any(axis=1))
    assert 0 < share < 1 and small.outside == pytest.approx(share)
    warning = f"warning: {100 * share:.1f} % of the motion lies outside Ω"
    outside = changed(study, repeatable={"motion": small})
    for options in ([], ["--full"]):
        assert printed(outside, folder, *options)[0].startswith(warning)


def test_it_fits_24_rows_and_80_columns(
    study: rp.Study, beyond: rp.Study, answer: str, folder: Path
) -> None:
    """With the command above and the next prompt below, however many notes there are."""
    many = replace(study, notes=tuple(f"{k} " + "word " * 20 for k in range(9)))
    (one,) = beyond.row("pseudoinverse").violations
    long = replace(one, moment=3.5, cycle=4, names=("link_" * 9, "joint_" * 9))
    bad = {"violations": (long,) * 3}
    far = changed(many, pseudoinverse=bad, posture=bad, repeatable=bad)
    noted, violated = (printed(one, folder)[0] for one in (many, far))
    for text in (answer, noted, violated):
        lines = text.splitlines()
        assert len(lines) <= 22
        assert all(len(line) <= 80 or str(folder) in line for line in lines)
    assert re.search(r"^note: 0 word.*^\d more notes: --full$", noted, re.M | re.S)
    page, beside = noted.splitlines()[-3:-1]
    assert page == f"open   {folder}/animation.html"
    files = "drift.png, joints.png, motion.csv, control.json"
    assert beside == f"wrote  {files} beside it"
    assert re.search(r"^! usual control: .*^1\d more notes: --full$", violated, re.M | re.S)


@pytest.mark.slow
def test_a_stopped_motion_is_named_in_the_sentence(study: rp.Study, folder: Path) -> None:
    stopped = {"motion": None, "stopped": "the Jacobian <loses> rank"}
    plain = changed(study, pseudoinverse=stopped, posture=stopped)
    text, _ = printed(replace(plain, notes=()), folder / "stuck", "--report")
    assert " ".join(text.split()).startswith(
        "Usual control stopped: the Jacobian <loses> rank. After 3 cycles the hand is back "
        "in x and y under the repeatable control."
    )
    report = (folder / "stuck" / "report.html").read_text(encoding="utf-8")
    assert "Usual control stopped: the Jacobian &lt;loses&gt; rank." in report
    assert answered(text, "link 4 off its start|farthest part off its start")[:2] == ["stopped"] * 2
    assert answered(text, "extra joint speed")[2] == "–"
    assert "note: + posture: the Jacobian <loses> rank" in text
    why = "stopped: the Jacobian <loses> rank."
    assert first_of(plain, folder).startswith(f"Usual control {why} After 3 cycles")
    ours = changed(study, repeatable=stopped)
    assert first_of(ours, folder).startswith(f"Repeatable {why} After 3 cycles")


def test_nothing_to_show_says_what_stopped(study: rp.Study) -> None:
    stopped = {"motion": None, "stopped": "a singularity"}
    none = changed(study, pseudoinverse=stopped, repeatable=stopped)
    words = r"no motion to show: Usual control stopped: .* Repeatable stopped: a singularity; "
    with pytest.raises(rp.InputError, match=words + "choose a smaller path, another"):
        rp.animation(none)


@pytest.mark.slow
def test_only_a_terminal_shows_tones_and_as_colours(
    study: rp.Study, answer: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    with terminal_of(80, 24):
        shown, _ = printed(study, folder)
        monkeypatch.setenv("NO_COLOR", "1")
        assert printed(study, folder)[0] == answer
        monkeypatch.delenv("NO_COLOR")
        monkeypatch.setenv("TERM", "dumb")
        assert printed(study, folder)[0] == answer
    assert "\x1b" not in answer and re.sub(r"\x1b\[\d+m", "", shown) == answer
    off = answered(answer, "link 4 off")[0]
    assert f"\x1b[31m{off} from its start\x1b[0m" in shown and "\x1b[32myes\x1b[0m" in shown


def test_what_is_off_most_is_one_number_everywhere(
    study: rp.Study, folder: Path, answer: str
) -> None:
    """Issue 37, item 17: in the answer, --full, JSON, the audit and its page, and measured here."""
    motion, task = study.row("pseudoinverse").motion, study.task
    moved = Drawn(study.robot).moved(*task.to_robot(motion.q[[-1, 0]])).max()
    (off,) = {answered(answer, "link 4 off")[0]}
    assert reads(off, moved)
    assert f" {off} from its start under the usual control, 0 under" in first_of(study, folder)
    told = study.as_dict()["strategies"]["pseudoinverse"]["farthest"]
    assert told == {"link": "link4", "displacement": pytest.approx(moved, rel=1e-9)}
    found = rp.audit((motion.t, motion.q), task)
    at_visits = task.to_robot(found.visits.q[[-1, 0]])
    known = Drawn(study.robot).moved(*at_visits).max()
    assert found.links[found.part] == "link4"
    ends = found.points[[0, -1], found.part]
    assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(known, rel=1e-6)


TWO_HANDS = """<robot name="two"><link name="base"/><link name="torso"><visual><geometry>
<box size=".2 .3 .4"/></geometry></visual></link>
<joint name="waist" type="revolute"><parent link="base"/><child link="torso"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="2" effort="9"/></joint>{arms}</robot>"""

ONE_ARM = """<joint name="{s}{k}" type="revolute"><parent link="{up}"/><child link="{s}_{name}"/>
<origin xyz="{x} {y} 0"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="2" effort="9"/>
</joint><link name="{s}_{name}"><collision><geometry>
<mesh filename="package://nowhere/{s}{k}.stl"/></geometry></collision></link>"""


def two_hands(file: Path) -> None:
    """A waist with two planar arms of two links and a hand each; its meshes are missing."""
    arms, names = "", ("upper", "lower", "hand")
    for side, y in (("left", 0.2), ("right", -0.2)):
        for k, name in enumerate(names):
            up = f"{side}_{names[k - 1]}" if k else "torso"
            x = 0.4 if k else 0.0
            arms += ONE_ARM.format(s=side, k=k, up=up, name=name, x=x, y=0 if k else y)
    file.write_text(TWO_HANDS.format(arms=arms))


@pytest.mark.slow
def test_two_hands_on_one_waist(tmp_path: Path) -> None:
    """Issue 37, items 15 and 16: what the waist moves besides is measured and named, and the arm's
    own part is not sought on the other arm; bodies without a collision shape are counted."""
    two_hands(tmp_path / "two.urdf")
    robot = rp.Robot.load(tmp_path / "two.urdf")
    start = [0.1, 0.3, 0.5, 0.4]
    problem = rp.Problem(robot, frame="left_hand", kind="xy", start=start, path="circle:0.1")
    two = rp.study(problem, cycles=6, steps=60, degree=1)
    motion, task = two.row("pseudoinverse").motion, two.task
    placed = [
        robot.task("right_hand", "xy").placement(
            robot.task("right_hand", "xy").from_robot(task.to_robot(q))
        )
        for q in motion.q[[0, -1]]
    ]
    away = np.linalg.norm(placed[1].translation - placed[0].translation)
    assert away > 0.01
    text, _ = printed(two, tmp_path / "out")
    said = " ".join(text.split())
    (off,) = re.findall(r"Under the usual control the other hand is (.*?) from its start", said)
    assert reads(off, away)
    assert answered(text, "other hand off")[0] == off
    rows = two.as_dict()["strategies"]["pseudoinverse"]
    assert rows["other_ends"] == {"right_hand": pytest.approx(away, rel=1e-9)}
    assert not rows["farthest"]["link"].startswith("right_")
    lacking = "7 bodies without a collision shape; meshes missing: --package-dir DIR"
    assert f"not checked: {lacking}" in text
    assert len(two.as_dict()["not_checked"]) == 7


@pytest.mark.slow
@pytest.mark.parametrize("sign", some([1, -1], -1))
def test_a_path_around_the_base_winds(sign: int, study: rp.Study, tmp_path: Path) -> None:
    """Issue 37, awkward studies: above the table stands why such a path need not close, one turn
    either way; a path beside the base does not wind."""
    turn = sign * np.pi / 18 * np.append(np.arange(36), 0)
    ring = np.c_[2.6 * np.cos(turn), 2.6 * np.sin(turn), 0 * turn]
    np.savetxt(tmp_path / "ring.csv", ring, delimiter=",")
    problem = rp.Problem("planar3r", path=str(tmp_path / "ring.csv"))
    wound = rp.study(problem, cycles=1, steps=500)
    assert wound.as_dict()["winding"] == sign
    assert study.as_dict()["winding"] == 0
    text = " ".join(printed(wound, tmp_path / "out")[0].split())
    before = text.partition("planar3r tool")[0]
    assert "The path winds once around the axis of theta1, so it need not close " in before
