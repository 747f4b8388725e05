"""The verdict: its numbers against the motions', its words for every outcome."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import repctl_pin as rp
from repctl_pin.show.text.numbers import metres, number, percent, radians
from repctl_pin.show.text.verdict import Deed, Tile, deed_of, study_verdict, verdict

J = Deed("J⁺", 0.4512, 0.464)


@pytest.mark.parametrize(
    ("deeds", "words"),
    [
        (
            [J, Deed("ours", 3e-11, 0.4654)],
            "The elbow creeps 45 cm in 10 cycles → 0. Joint speed +0.3 %. Limits kept.",
        ),
        (
            [replace(J, broken=(7, "left_s0")), Deed("ours", 0, 0.45936)],
            "The elbow creeps 45 cm in 10 cycles → 0. Joint speed −1.0 %. Limits broken in cycle 7 (left_s0) → kept.",
        ),
        ([J], "The elbow creeps 45 cm in 10 cycles. Limits kept."),
        ([Deed("a", 0, 1.0), Deed("b", 9e-5, 1.0)], "The elbow is back after 10 cycles. Joint speed 0 %. Limits kept."),
        (  # a wrist that has turned while the elbow hardly moved
            [replace(J, creep=0.043, turn=(3.72, "left_w0")), Deed("ours", 0, 0.464, turn=(2e-9, "left_w1"))],
            "The elbow creeps 4.3 cm and left_w0 turns 3.7 rad in 10 cycles → 0. Joint speed 0 %. Limits kept.",
        ),
        (
            [replace(J, creep=0.043, turn=(3.72, "left_w0")), Deed("ours", 0.002, 0.464, turn=(0.02, "left_w1"))],
            "The elbow creeps 4.3 cm and left_w0 turns 3.7 rad in 10 cycles → 2 mm and left_w1 turns 0.02 rad. "
            "Joint speed 0 %. Limits kept.",
        ),
        (  # what the elbow tells of already, and what nobody sees
            [replace(J, turn=(4.4, "joint1"))],
            "The elbow creeps 45 cm in 10 cycles. Limits kept.",
        ),
        ([replace(J, creep=0.002, turn=(0.09, "joint1"))], "The elbow creeps 2 mm in 10 cycles. Limits kept."),
        ([J, J], "The elbow creeps 45 cm in 10 cycles. Joint speed 0 %. Limits kept."),
        (
            [replace(J, haste=1.31), J],
            "The elbow creeps 45 cm in 10 cycles. Joint speed 0 %. Speed limits broken, 1.3 × the limit → kept. "
            "Joint limits kept.",
        ),
    ],
)
def test_the_words_of_every_outcome(deeds: list[Deed], words: str) -> None:
    assert verdict(deeds, 10).sentence == words


def test_tiles_say_what_the_sentence_says() -> None:
    near = verdict([replace(J, apart=0.0261, touch=0), Deed("ours", 0.0, 0.5, apart=0.1189)], 10)
    assert near.sentence.endswith("Limits kept. Bodies 2.6 cm → 12 cm apart.")
    assert near.tiles[-1] == Tile("Bodies apart, at least", "2.6 cm → 12 cm")
    touching = verdict([replace(J, apart=-0.01, touch=3), Deed("ours", 0.0, 0.5, apart=0.1189)], 10)
    assert touching.sentence.endswith("Bodies touch in cycle 3 → 12 cm apart.") and touching.tiles[-1].bad
    told = verdict([replace(J, broken=(7, "left_s0")), Deed("ours", 0.0, 0.5)], 1)
    assert [(t.name, t.value, t.bad) for t in told.tiles] == [
        ("Elbow creep in 1 cycle", "45 cm → 0", False),
        ("Joint speed", "+7.8 %", False),
        ("Joint limits", "broken in cycle 7 (left_s0) → kept", True),
    ]
    assert verdict([Deed("ours", 0.0, 0.5), J], 1).tiles[0].bad
    twisted = verdict([replace(J, creep=0.043, turn=(3.72, "left_w0")), Deed("ours", 0, 0.5)], 10).tiles[0]
    assert twisted == Tile("Elbow and joint creep in 10 cycles", "4.3 cm, left_w0 3.7 rad → 0")


def test_a_studys_verdict_holds_its_motions_numbers() -> None:
    study = rp.study("planar4r", cycles=2, steps=80, degree=1)
    plain, closed = (study.row(key).motion for key in ("pseudoinverse", "repeatable"))
    ends = [study.task.joint_origins(q)[study.elbow] for q in plain.q[[0, -1]]]
    price = np.sqrt(np.mean(closed.qdot[:80] ** 2) / np.mean(plain.qdot[:80] ** 2)) - 1
    assert study_verdict(study).sentence == (
        f"The elbow creeps {metres(np.linalg.norm(ends[1] - ends[0]))} in 2 cycles → 0. "
        f"Joint speed {percent(price)}. Limits kept."
    )
    rows = tuple(replace(r, motion=None, stopped="why") if r.key == "pseudoinverse" else r for r in study.rows)
    assert study_verdict(replace(study, rows=rows)).sentence.startswith("J⁺ is stuck: why. The elbow is back")
    none = tuple(replace(r, motion=None, stopped="why") for r in study.rows)
    assert study_verdict(replace(study, rows=none)).tiles == ()


def test_the_joint_that_turns_most_is_named_from_the_motion() -> None:
    motion = rp.study("ur5", cycles=3, steps=60, degree=1).row("pseudoinverse").motion
    off, told = np.abs(motion.q[-1] - motion.q[0]), deed_of("J⁺", motion, 3)
    assert told.turn == (off.max(), motion.task.joint_names[off.argmax()])
    slides = rp.study("ppr", cycles=2, steps=60, degree=1).row("pseudoinverse").motion
    assert deed_of("J⁺", slides, 1).turn == (abs(slides.q[-1, 2] - slides.q[0, 2]), "theta3")  # d1 and d2 slide


def test_numbers_are_written_one_way() -> None:
    assert [number(v) for v in (1.7495, 0.0238, 2.1e-11, 0.0, 1234.5, np.inf)] == [
        "1.75", "0.0238", "2e-11", "0", "1234", "–",
    ]  # fmt: skip
    assert [metres(v) for v in (9e-5, 2.6e-3, 0.45, 0.999, 1.234)] == ["0", "2.6 mm", "45 cm", "1 m", "1.2 m"]
    assert [radians(v) for v in (9e-4, 0.0213, 3.719)] == ["0", "0.021 rad", "3.7 rad"]
    assert [percent(v) for v in (4e-4, 0.003, -0.01, 0.25)] == ["0 %", "+0.3 %", "−1.0 %", "+25 %"]
