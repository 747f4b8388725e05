"""The verdict: its numbers against the motions', its words for every outcome."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import repctl_pin as rp
from repctl_pin.show.text import (
    MotionSummary,
    metres,
    motion_summary,
    number,
    percent,
    radians,
    study_verdict,
)
from repctl_pin.show.text.verdict import verdict

J = MotionSummary("J⁺", 0.4512, 0.464)
OURS = MotionSummary("nearest repeatable", 0.0, 0.464)
ELBOW = "Elbow displacement after 10 cycles: 45 cm (J⁺) → 0 (repeatable)."
SPEED = "Joint speed, relative to J⁺: 0 %."
LIMITS = "Joint limits respected."


@pytest.mark.parametrize(
    ("summaries", "words"),
    [
        (
            [J, replace(OURS, speed=0.4654)],
            f"{ELBOW} Joint speed, relative to J⁺: +0.3 %. {LIMITS}",
        ),
        (
            [replace(J, limit_violation=(7, "left_s0")), replace(OURS, speed=0.45936)],
            f"{ELBOW} Joint speed, relative to J⁺: −1.0 %. "
            "Joint limits: violated in cycle 7 by left_s0 (J⁺) → respected (repeatable).",
        ),
        ([J], f"Elbow displacement after 10 cycles: 45 cm. {LIMITS}"),
        (
            [MotionSummary("a", 0, 1.0), MotionSummary("b", 0, 1.0)],
            f"Elbow displacement after 10 cycles: 0. Joint speed, relative to a: 0 %. {LIMITS}",
        ),
        (  # what is small is said, if the motion is not closed
            [replace(J, elbow_displacement=9e-5), OURS],
            f"Elbow displacement after 10 cycles: 0.09 mm (J⁺) → 0 (repeatable). {SPEED} {LIMITS}",
        ),
        (  # a wrist that has turned while the elbow hardly moved
            [
                replace(
                    J, elbow_displacement=0.043, joint_displacement=(3.72, "left_w0")
                ),
                OURS,
            ],
            "Elbow and joint displacement after 10 cycles: 4.3 cm, left_w0 3.7 rad (J⁺) → 0 "
            "(repeatable). "
            f"{SPEED} {LIMITS}",
        ),
        (
            [
                replace(
                    J, elbow_displacement=0.043, joint_displacement=(3.72, "left_w0")
                ),
                replace(
                    OURS, elbow_displacement=0.002, joint_displacement=(0.02, "left_w1")
                ),
            ],
            "Elbow and joint displacement after 10 cycles: 4.3 cm, left_w0 3.7 rad (J⁺) → 2 mm, "
            "left_w1 0.02 rad "
            f"(repeatable). {SPEED} {LIMITS}",
        ),
        (  # what the elbow shows already
            [replace(J, joint_displacement=(4.4, "joint1"))],
            f"Elbow displacement after 10 cycles: 45 cm. {LIMITS}",
        ),
        (
            [replace(J, elbow_displacement=0.002, joint_displacement=(0.09, "joint1"))],
            f"Elbow displacement after 10 cycles: 2 mm. {LIMITS}",
        ),
        ([J, J], f"Elbow displacement after 10 cycles: 45 cm. {SPEED} {LIMITS}"),
        (
            [replace(J, speed_ratio=1.31), OURS],
            f"{ELBOW} {SPEED} Speed limits: up to 1.3 times the limit (J⁺) → respected "
            f"(repeatable). {LIMITS}",
        ),
    ],
)
def test_the_words_of_every_outcome(summaries: list[MotionSummary], words: str) -> None:
    assert verdict(summaries, 10) == words


def test_a_lost_path_is_said_first_and_speeds_are_not_compared_then() -> None:
    lost = replace(J, path_loss=(3, 0.572, 0.0))
    told = verdict([lost, OURS], 10)
    assert told.startswith(
        "End effector: leaves the path in cycle 3, by up to 57 cm (J⁺) → on the path "
        "(repeatable). Elbow displacement"
    )
    assert "Joint speed, relative to J⁺: not compared, since the path is left." in told
    turned = verdict([replace(J, path_loss=(1, 0.0, 0.31))], 10)
    assert turned.startswith(
        "End effector: leaves the path in cycle 1, by up to 0.31 rad. "
    )


def test_joint_speed_is_of_the_first_cycle_and_of_all() -> None:
    """Over all cycles J⁺ is elsewhere, and the sign may turn."""
    told = verdict(
        [
            replace(J, overall_speed=0.6),
            replace(OURS, speed=0.4654, overall_speed=0.4644),
        ],
        10,
    )
    assert (
        "Joint speed, relative to J⁺: +0.3 % in cycle 1, −23 % over 10 cycles." in told
    )


def test_the_scale_of_an_arm_decides_what_is_small() -> None:
    """An arm of 0.1 mm links whose joints are off by 0.1 rad is not back."""
    tiny = replace(
        J, elbow_displacement=9e-6, size=3e-4, joint_displacement=(0.097, "theta2")
    )
    assert verdict([tiny, OURS], 10).startswith(
        "Elbow displacement after 10 cycles: 9 µm (J⁺) → 0"
    )
    still = verdict(
        [
            replace(J, elbow_displacement=1e-12, joint_displacement=(3e-5, "wrist")),
            OURS,
        ],
        10,
    )
    assert still.startswith(
        "Elbow and joint displacement after 10 cycles: 0, wrist 3e-5 rad (J⁺) → 0 (repeatable)."
    )


def test_the_bodies_and_their_distance() -> None:
    near = verdict(
        [
            replace(J, body_distance=0.0261, collision_cycle=0),
            replace(OURS, body_distance=0.1189),
        ],
        10,
    )
    assert near.endswith(
        f"{LIMITS} Minimum body distance: 2.6 cm (J⁺) → 12 cm (repeatable)."
    )
    touching = verdict(
        [
            replace(J, body_distance=-0.01, collision_cycle=3),
            replace(OURS, body_distance=0.1189),
        ],
        10,
    )
    assert touching.endswith(
        "Body distance: collision in cycle 3 (J⁺) → minimum 12 cm (repeatable)."
    )


@pytest.fixture(scope="module")
def planar4r() -> rp.Study:
    return rp.study("planar4r", cycles=2, steps=80, degree=1)


def test_a_studys_verdict_holds_its_motions_numbers(planar4r: rp.Study) -> None:
    study = planar4r
    plain, closed = (study.row(key).motion for key in ("pseudoinverse", "repeatable"))
    ends = [study.task.joint_origins(q)[study.elbow] for q in plain.q[[0, -1]]]
    once = np.sqrt(np.mean(closed.qdot[:80] ** 2) / np.mean(plain.qdot[:80] ** 2)) - 1
    overall = (
        np.sqrt(
            np.sum(np.diff(closed.q, axis=0) ** 2)
            / np.sum(np.diff(plain.q, axis=0) ** 2)
        )
        - 1
    )
    assert study_verdict(study) == (
        f"Elbow displacement after 2 cycles: {metres(np.linalg.norm(ends[1] - ends[0]))} (J⁺) → 0 "
        f"(repeatable). "
        f"Joint speed, relative to J⁺: {percent(once)} in cycle 1, {percent(overall)} over 2 "
        f"cycles. {LIMITS}"
    )
    rows = tuple(
        replace(r, motion=None, stopped="why") if r.key == "pseudoinverse" else r
        for r in study.rows
    )
    assert study_verdict(replace(study, rows=rows)).startswith(
        "J⁺ stopped: why. Elbow displacement"
    )
    none = tuple(replace(r, motion=None, stopped="why") for r in study.rows)
    assert study_verdict(replace(study, rows=none)) == (
        "J⁺ stopped: why. nearest repeatable stopped: why."
    )


def test_a_motion_is_closed_exactly_where_the_first_line_says_0(
    planar4r: rp.Study,
) -> None:
    """One rule for both; with few steps the integration error is larger than what counts as
    closed."""
    few = rp.study("planar4r", cycles=2, steps=12, degree=1)
    for study in (few, planar4r):
        motion = study.row("repeatable").motion
        assert study_verdict(study).split(" → ")[1].startswith("0 (") == motion.closes
    task = few.task
    closed = few.row("repeatable").motion
    Q = np.tile(closed.q[0], (3, 1))
    for gap, closes in ((2e-6, True), (2e-5, False)):
        still = replace(
            closed,
            q=Q + [[0.0], [0.5 * gap], [gap]] * np.eye(task.n)[0],
            cycles=2,
            steps=1,
        )
        assert still.closes == closes


def test_the_joint_that_turns_most_is_named_from_the_motion() -> None:
    def circled(name: str, q0: list[float]) -> rp.Motion:
        task = rp.Robot.load(name).task(kind="xy")
        path = rp.circle(task, q0, 0.1)
        return rp.follow(rp.Pseudoinverse(task), path, q0, cycles=3, steps=60)

    motion = circled("planar3r", [0.3, 0.8, 0.8])
    off, told = np.abs(motion.q[-1] - motion.q[0]), motion_summary("J⁺", motion, 1)
    assert told.joint_displacement == (off.max(), motion.task.joint_names[off.argmax()])
    slides = circled("ppr", [0.0, 0.0, 0.5])
    assert motion_summary("J⁺", slides, 1).joint_displacement == (
        abs(slides.q[-1, 2] - slides.q[0, 2]),
        "theta3",
    )  # d1 and d2 slide


def test_numbers_are_written_one_way() -> None:
    assert [number(v) for v in (1.7495, 0.0238, 2.1e-11, 0.0, 1234.5, np.inf)] == [
        "1.75", "0.0238", "2e-11", "0", "1234", "–",
    ]  # fmt: skip
    assert [metres(v) for v in (9e-10, 9e-6, 9e-5, 2.6e-3, 0.45, 0.999, 1.234)] == [
        "0", "9 µm", "0.09 mm", "2.6 mm", "45 cm", "1 m", "1.2 m",
    ]  # fmt: skip
    assert [radians(v) for v in (9e-4, 0.0213, 3.719)] == [
        "9e-4 rad",
        "0.021 rad",
        "3.7 rad",
    ]
    assert [percent(v) for v in (4e-4, 0.003, -0.01, 0.25)] == [
        "0 %",
        "+0.3 %",
        "−1.0 %",
        "+25 %",
    ]
