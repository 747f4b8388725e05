"""The first answer of a study: its sentence and its short table say what the motions did."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from shown import answered
from terminals import terminal_of

import repctl_pin as rp
from repctl_pin.motion.joint_motion import Violation, violations_of
from repctl_pin.robot.visuals import Visuals
from repctl_pin.show.page.outcomes import farthest_body, study_headline
from repctl_pin.show.text import coloured, number, percent, study_answer
from repctl_pin.show.text.lines import COLUMNS, Span, wrapped
from repctl_pin.show.text.numbers import metres

FILES = ["open   out/animation.html", "wrote  drift.png beside it"]


@pytest.fixture(scope="module")
def study() -> rp.Study:
    """Four joints that drift by some centimetres."""
    return rp.study("planar4r", cycles=3, steps=60, degree=1)


def text_of(study: rp.Study) -> str:
    return coloured(study_answer(study, FILES))


def changed(study: rp.Study, **rows: dict) -> rp.Study:
    """The same study with other rows."""
    return replace(
        study, rows=tuple(replace(row, **rows.get(row.key, {})) for row in study.rows)
    )


def test_it_says_what_the_motions_did(study: rp.Study) -> None:
    text = text_of(study)
    plain, posture, closed = (
        study.row(key).motion for key in ("pseudoinverse", "posture", "repeatable")
    )
    visuals, off = Visuals.of(study.robot), []
    for motion in (plain, posture):
        ends = visuals.placements(study.task.to_robot(motion.q[[0, -1]]))
        moved = np.linalg.norm(
            (ends[1] - ends[0])[:, :3, 3], axis=1
        )  # of the bodies' middles
        link, way = farthest_body(study.robot, study.task.to_robot(motion.q[[0, -1]]))
        assert link == "link4" and moved.max() < way < 2 * moved.max()
        off.append(metres(way))
    plain_words = " ".join(text.split())
    assert plain_words.startswith(
        "After 3 cycles both hands are back. Link 4 of one arm is not: "
    )
    assert (
        f"{off[0]} off under the usual control, 0 under the repeatable one."
        in plain_words
    )
    told = "".join(span.text for span in study_headline(study).sentence)
    assert plain_words.startswith(
        " ".join(told.split())
    )  # the page's and the report's own
    page = re.sub(r"<[^>]*>", "", rp.animation(study).page)
    assert told in page
    assert answered(text, "link 4 off") == [*off, "0"]
    drifts = [number(motion.drift[-1]) for motion in (plain, posture)]
    assert answered(text, "joints off") == [*drifts, "0"]
    assert answered(text, "first cycle closes") == ["no", "no", "yes"]
    speeds = [
        percent(m.first_rms_speed / plain.first_rms_speed - 1)
        for m in (posture, closed)
    ]
    assert answered(text, "extra joint speed, cycle 1") == ["–", *speeds]
    assert answered(text, "limits") == ["kept"] * 3 and "!" not in text
    (bound,) = re.findall(
        r"^leaf margin in Ω: proved > ([\d.]+)$", text, flags=re.MULTILINE
    )
    assert 0 <= study.design.proof.leaf_margin - float(bound) < 1e-2


def test_it_fits_24_rows_and_80_columns(study: rp.Study) -> None:
    """With the command above and the next prompt below, however many notes there are."""
    many = replace(study, notes=tuple(f"{k} " + "word " * 30 for k in range(9)))
    long = Violation(3.5, 4, ("link_" * 9, "joint_" * 9))
    bad = {"violations": (long,) * 3}
    far = changed(many, pseudoinverse=bad, posture=bad, repeatable=bad)
    for one in (study, many, far):
        lines = text_of(one).splitlines()
        assert len(lines) <= 22 and max(map(len, lines)) <= COLUMNS
    assert re.search(
        r"^note: 0 word.*^\d more notes: --full$", text_of(many), re.M | re.S
    )
    assert text_of(many).splitlines()[-3:-1] == FILES
    assert re.search(
        r"^! usual control: .*^1\d more notes: --full$", text_of(far), re.M | re.S
    )


def test_violations_are_marked_and_named(study: rp.Study) -> None:
    plain = study.row("pseudoinverse").motion
    far = np.where(plain.t > plain.t[-1] / 2, 10.0, 0.0)[:, None]
    motion = replace(plain, q=plain.q + far)
    text = text_of(
        changed(
            study, pseudoinverse={"motion": motion, "violations": violations_of(motion)}
        )
    )
    name = study.task.joint_names[0]
    assert answered(text, "limits") == ["cycle 2!", "kept", "kept"]
    assert f"! usual control: {name} exceeds its limits 52 % into cycle 2" in text


def test_a_stopped_motion_is_named_in_the_sentence(study: rp.Study) -> None:
    stopped = {"motion": None, "stopped": "the Jacobian loses rank"}
    text = text_of(changed(study, pseudoinverse=stopped))
    assert text.startswith(
        "Usual control stopped: the Jacobian loses rank. After 3 cycles the hand is back."
    )
    assert answered(text, "link 4 off")[0] == "stopped"
    assert answered(text, "extra joint speed")[1:] == ["–", "–"]
    both = text_of(changed(study, pseudoinverse=stopped, repeatable=stopped))
    assert " ".join(both.split()).count("stopped: the Jacobian loses rank.") == 2
    few = replace(changed(study, posture={"motion": None, "stopped": "why"}), notes=())
    assert "note: + posture: why" in text_of(few)


def test_only_a_terminal_shows_tones_and_as_colours(
    study: rp.Study, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    plain = text_of(study)
    with terminal_of(80, 24):
        shown = text_of(study)
        assert coloured([Span("\x1b[2J", "bad")]) == "\x1b[31m\\x1b[2J\x1b[0m"
        monkeypatch.setenv("NO_COLOR", "1")
        assert text_of(study) == plain
        monkeypatch.delenv("NO_COLOR")
        monkeypatch.setenv("TERM", "dumb")
        assert text_of(study) == plain
    assert "\x1b" not in plain and re.sub(r"\x1b\[\d+m", "", shown) == plain
    off = answered(plain, "link 4 off")[0]
    assert f"\x1b[31m{off} off\x1b[0m" in shown and "\x1b[32myes\x1b[0m" in shown


def test_a_wrapped_sentence_keeps_its_pieces() -> None:
    off = Span("3\u00a0cm\u00a0off", "bad")
    out = wrapped([Span("word " * 15), off, Span(" under it. "), Span("x" * 90)])
    assert [span.tone for span in out] == ["", "bad", "", ""] and out[
        1
    ].text == "3 cm off"
    assert "".join(span.text for span in out).splitlines() == [
        "word " * 14 + "word",
        "3 cm off under it.",
        "x" * 90,
    ]
