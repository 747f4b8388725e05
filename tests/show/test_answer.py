"""The first answer of a study: its sentence and its short table say what the motions did."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from shown import answered
from terminals import terminal_of

import repctl_pin as rp
from repctl_pin.motion.joint_motion import violations_of
from repctl_pin.show.text import coloured, number, percent, study_answer
from repctl_pin.show.text.lines import COLUMNS, Span, wrapped
from repctl_pin.show.text.numbers import metres
from repctl_pin.show.text.verdict import MotionSummary, headline

FILES = ["open   out/animation.html", "wrote  drift.png beside it"]
USUAL, REPEATABLE = "the usual control (pseudoinverse)", "the repeatable one"


@pytest.fixture(scope="module")
def study() -> rp.Study:
    """Four joints that drift by some centimetres."""
    return rp.study("planar4r", cycles=3, steps=60, degree=1)


def text_of(study: rp.Study) -> str:
    return coloured(study_answer(study, FILES))


def changed(study: rp.Study, **rows: dict) -> rp.Study:
    """The same study with other rows."""
    return replace(study, rows=tuple(replace(row, **rows.get(row.key, {})) for row in study.rows))


def said(*summaries: MotionSummary) -> str:
    text = "".join(span.text for span in headline(summaries, 10))
    return text.replace("\u00a0", " ")


def usual(elbow: float = 0.0, **values) -> MotionSummary:
    return MotionSummary("J⁺", elbow, 1.0, **values)


def repeatable(elbow: float = 0.0) -> MotionSummary:
    return MotionSummary("nearest repeatable", elbow, 1.0)


def test_it_says_what_the_motions_did(study: rp.Study) -> None:
    text = text_of(study)
    plain, posture, closed = (
        study.row(key).motion for key in ("pseudoinverse", "posture", "repeatable")
    )
    off = []
    for motion in (plain, posture):
        start, end = (study.task.joint_origins(q)[study.elbow] for q in (study.q0, motion.q[-1]))
        off.append(metres(float(np.linalg.norm(end - start))))
    assert text.startswith("Both hands are back. One elbow joint is not:")
    assert f"{off[0]} off under {USUAL}, 0 under {REPEATABLE}." in " ".join(text.split())
    assert answered(text, "hand off") == ["0", "0", "0"]
    assert answered(text, "elbow joint off") == [*off, "0"]
    drifts = [number(motion.drift[-1]) for motion in (plain, posture)]
    assert answered(text, "joints off") == [*drifts, "0"]
    assert answered(text, "first cycle closes") == ["no", "no", "yes"]
    speeds = [percent(m.first_rms_speed / plain.first_rms_speed - 1) for m in (posture, closed)]
    assert answered(text, "extra joint speed, cycle 1") == ["–", *speeds]
    assert answered(text, "limits") == ["kept"] * 3 and "!" not in text
    (bound,) = re.findall(r"^leaf margin in Ω: proved > ([\d.]+)$", text, flags=re.MULTILINE)
    assert 0 <= study.design.proof.leaf_margin - float(bound) < 1e-2


def test_it_fits_24_rows_and_80_columns(study: rp.Study) -> None:
    """With the command above and the next prompt below, however many notes there are."""
    many = replace(study, notes=tuple(f"{k} " + "word " * 30 for k in range(9)))
    for one in (study, many):
        lines = text_of(one).splitlines()
        assert len(lines) <= 22 and max(map(len, lines)) <= COLUMNS
    assert re.search(r"^note: 0 word.*^\d more notes: --full$", text_of(many), re.M | re.S)
    assert text_of(many).splitlines()[-3:-1] == FILES


def test_violations_are_marked_and_named(study: rp.Study) -> None:
    plain = study.row("pseudoinverse").motion
    far = np.where(plain.t > plain.t[-1] / 2, 10.0, 0.0)[:, None]
    motion = replace(plain, q=plain.q + far)
    text = text_of(
        changed(study, pseudoinverse={"motion": motion, "violations": violations_of(motion)})
    )
    name = study.task.joint_names[0]
    assert answered(text, "limits") == ["cycle 2!", "kept", "kept"]
    assert f"! usual control: {name} exceeds its limits in cycle 2, at 52 % of the cycle" in text


def test_a_stopped_motion_is_named_in_the_sentence(study: rp.Study) -> None:
    stopped = {"motion": None, "stopped": "the Jacobian loses rank"}
    text = text_of(changed(study, pseudoinverse=stopped))
    assert text.startswith("Usual control stopped: the Jacobian loses rank. The hand is back.")
    assert answered(text, "elbow joint off")[0] == "stopped"
    assert answered(text, "extra joint speed")[1:] == ["–", "–"]
    both = text_of(changed(study, pseudoinverse=stopped, repeatable=stopped))
    assert " ".join(both.split()).count("stopped: the Jacobian loses rank.") == 2
    few = replace(changed(study, posture={"motion": None, "stopped": "why"}), notes=())
    assert "note: + posture: why" in text_of(few)


@pytest.mark.parametrize(
    "summaries, sentence",
    [
        (
            (usual(0.32), repeatable()),
            f"Both hands are back. One elbow joint is not: 32 cm off under {USUAL}, "
            f"0 under {REPEATABLE}.",
        ),
        (
            (usual(0.0017), repeatable()),
            f"Both hands are back. The elbow joint hardly drifts: 1.7 mm under {USUAL}, "
            f"0 under {REPEATABLE}, in 10 cycles.",
        ),
        (
            (usual(), repeatable()),
            "Both hands are back. So are both elbow joints: 0 off after 10 cycles.",
        ),
        ((repeatable(),), "The hand is back. So is the elbow joint: 0 off after 10 cycles."),
        (
            (usual(0.3), repeatable(0.2)),
            f"Both hands are back. The elbow joint is not: 30 cm off under {USUAL}, "
            f"20 cm off under {REPEATABLE}.",
        ),
        (
            (usual(0.002, joint_displacement=(3.7, "w0")), repeatable()),
            f"Both hands are back. w0 is not: 3.7 rad under {USUAL}, 0 under {REPEATABLE}.",
        ),
        (
            (usual(0.3, path_loss=(7, 0.57, 0.0)), repeatable()),
            f"Under {USUAL} the hand leaves its path in cycle 7: 57 cm off. "
            f"One elbow joint is not: 30 cm off under {USUAL}, 0 under {REPEATABLE}.",
        ),
    ],
)
def test_the_sentence(summaries: tuple[MotionSummary, ...], sentence: str) -> None:
    assert said(*summaries) == sentence


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
    off = answered(plain, "elbow joint off")[0]
    assert f"\x1b[31m{off} off\x1b[0m" in shown and "\x1b[32myes\x1b[0m" in shown


def test_a_wrapped_sentence_keeps_its_pieces() -> None:
    off = Span("3\u00a0cm\u00a0off", "bad")
    out = wrapped([Span("word " * 15), off, Span(" under it. "), Span("x" * 90)])
    assert [tone for _, tone in out] == ["", "bad", "", ""] and out[1].text == "3 cm off"
    assert "".join(text for text, _ in out).splitlines() == [
        "word " * 14 + "word",
        "3 cm off under it.",
        "x" * 90,
    ]
