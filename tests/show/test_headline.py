"""The headline of a page: what is wrong, what is right, and its price."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import repctl_pin as rp
from repctl_pin.robot.visuals import Visuals
from repctl_pin.show.page import read_surface
from repctl_pin.show.text import Headline, MotionSummary, Outcome, headline_of, metres
from repctl_pin.show.text.headline import stopped_words
from repctl_pin.show.text.parts import controlled, part_name

USUAL = Outcome(
    MotionSummary("J⁺", 0.3, 1.0, body_distance=0.13), "elbow", "link4", 0.321
)
CLOSED = Outcome(
    MotionSummary("nearest repeatable", 0.0, 1.003, body_distance=0.2),
    "elbow",
    "link4",
    1e-12,
)


BACK = "After 10 cycles both hands are back. "


def words(told: Headline) -> tuple[str, str]:
    sentence = "".join(span.text for span in told.sentence)
    return sentence.replace("\u00a0", " "), " ".join(
        n.text for n in told.notes
    ).replace("\u00a0", " ")


def test_it_says_what_is_wrong_what_is_right_and_the_price() -> None:
    sentence, notes = words(headline_of([USUAL, CLOSED], 10))
    assert sentence == (
        BACK + "One elbow is not: 32 cm off under the usual control, "
        "0 under the repeatable one."
    )
    assert (
        notes == "The repeatable one takes 0.3 % more joint speed. Joint limits kept. "
        "Links 13 cm apart or more, in both."
    )
    exact = [
        span.exact for span in headline_of([USUAL, CLOSED], 10).sentence if span.exact
    ]
    assert exact == ["link4: 0.321 m", "link4: 1e-12 m"]


@pytest.mark.parametrize(
    ("outcomes", "expected"),
    [
        (
            [replace(USUAL, off=0.0017), CLOSED],
            BACK + "The elbow has hardly drifted: 1.7 mm under the usual control, "
            "0 under the repeatable one.",
        ),
        (
            [
                replace(USUAL, off=1.1e-4),
                replace(CLOSED, off=4.3e-5),
            ],  # as the callouts say it
            BACK + "The elbow has hardly drifted: 0.11 mm under the usual control, "
            "0 under the repeatable one.",
        ),
        ([USUAL], "After 10 cycles the hand is back. The elbow is not: 32 cm off."),
        (
            [replace(USUAL, part="head"), CLOSED],
            BACK + "The head of one robot is not: 32 cm off under the usual control, "
            "0 under the repeatable one.",
        ),
        (
            [replace(USUAL, part="link 3"), CLOSED],
            BACK + "Link 3 of one arm is not: 32 cm off under the usual control, "
            "0 under the repeatable one.",
        ),
        (
            [CLOSED, CLOSED],
            BACK + "So is every part of the arms: 0 off.",
        ),
        (
            [
                replace(
                    USUAL,
                    off=0.0,
                    summary=replace(
                        USUAL.summary, joint_displacement=(6.28, "joint_1")
                    ),
                ),
                CLOSED,
            ],
            BACK + "The joint joint_1 is not: 6.3 rad under the usual control, "
            "0 under the repeatable one.",
        ),
    ],
)
def test_every_outcome_has_its_sentence(outcomes: list[Outcome], expected: str) -> None:
    assert words(headline_of(outcomes, 10))[0] == expected


def test_a_lost_path_is_not_called_back() -> None:
    lost = replace(USUAL, summary=replace(USUAL.summary, path_loss=(3, 0.02, 0.0)))
    sentence, notes = words(headline_of([lost, CLOSED], 10))
    assert sentence.startswith(
        "Under the usual control the hand leaves its path in cycle 3: 2 cm"
    )
    assert sentence.endswith(
        "After 10 cycles one elbow is not back: 32 cm off under the usual control, "
        "0 under the repeatable one."
    )
    assert "hands" not in sentence and "joint speed" not in notes
    closed = replace(CLOSED, summary=replace(CLOSED.summary, path_loss=(3, 0.02, 0.0)))
    told = words(headline_of([closed], 10))[0]
    assert told.endswith("After 10 cycles every part of the arm is back: 0 off.")
    little = words(headline_of([replace(lost, off=0.0017)], 10))[0]
    assert little.endswith("After 10 cycles the elbow has hardly drifted: 1.7 mm.")
    turned = replace(USUAL, summary=replace(USUAL.summary, path_loss=(3, 1e-12, 0.31)))
    assert "in cycle 3: 0.31 rad off" in words(headline_of([turned, CLOSED], 10))[0]


def test_a_stopped_motion_is_said_first() -> None:
    why = stopped_words("J⁺", "the Jacobian loses rank")
    told = words(headline_of([CLOSED], 10, [why]))[0]
    assert told.startswith(
        "Usual control stopped: the Jacobian loses rank. After 10 cycles the hand is "
        "back."
    )
    assert words(headline_of([], 0, [why]))[0] == f"{why} "


def test_limits_bodies_and_where_it_leads() -> None:
    broken = replace(
        USUAL, summary=replace(USUAL.summary, limit_violation=(7, "joint 2"))
    )
    assert (
        "joint 2 leaves its range in cycle 7 under the usual control."
        in (words(headline_of([broken, CLOSED], 10))[1])
    )
    leading = replace(USUAL, leaves=(17, "joint 2"))
    assert (
        "At this rate joint 2 leaves its range in cycle 17 under the usual control."
        in (words(headline_of([leading, CLOSED], 10))[1])
    )
    close = replace(
        USUAL,
        summary=replace(USUAL.summary, body_distance=0.013),
        near=("link3", "link5"),
    )
    told = headline_of([close, CLOSED], 10)
    assert (
        "link3 and link5 come as near as 1.3 cm under the usual control."
        in words(told)[1]
    )
    assert [n.tone for n in told.notes if "near" in n.text] == ["near"]
    also = replace(
        CLOSED,
        summary=replace(CLOSED.summary, body_distance=0.013),
        near=("link3", "link5"),
    )
    (near,) = (n.text for n in headline_of([close, also], 10).notes if "near" in n.text)
    assert near == "link3 and link5 come as near as 1.3\u00a0cm, in both."


@pytest.mark.slow
def test_the_page_names_the_farthest_part_of_a_robot() -> None:
    """Of all points of panda's meshes, after the cycles, one is farthest off."""
    task = rp.Robot.load("panda").task()
    q0 = task.reference
    motion = rp.follow(
        rp.Pseudoinverse(task), rp.circle(task, q0, 0.1), q0, cycles=1, steps=60
    )
    visuals = Visuals.of(task.robot)
    ends = visuals.placements(task.to_robot(motion.q[[0, -1]]))
    off = [
        np.linalg.norm(
            np.c_[p, np.ones(len(p))] @ (ends[1, s] - ends[0, s]).T, axis=1
        ).max()
        for s, shape in enumerate(visuals.shapes)
        for p in [read_surface(shape.path).points * shape.scale]
    ]
    link = visuals.shapes[int(np.argmax(off))].link
    page = rp.animation({"J⁺": motion}).page
    assert (
        f'title="{link}: {max(off):.3g} m">{metres(max(off))}'.replace(
            " cm", "\u00a0cm"
        )
        in page
    )
    assert f'"part":"{part_name(task, q0, link)}"' in page


def test_links_are_named_in_words() -> None:
    for name, link, expected in (
        ("panda", "panda_link4", "elbow"),
        ("panda", "panda_link1", "link 1"),
        ("baxter", "left_upper_forearm", "forearm"),
        ("talos", "head_2_link", "head"),
        ("kinova", "j2s6s200_link_5", "link 5"),
    ):
        task = rp.Robot.load(name).task()
        assert part_name(task, task.reference, link) == expected


def test_what_a_task_controls_is_spelt_out() -> None:
    robot = rp.Robot.load("panda")
    kinds = ("pose", "axis", "position", "xy", "xz", "yz")
    said = [controlled(robot.task(kind=kind).kind) for kind in kinds]
    assert said[0] == "position and orientation" and said[3:] == [
        "x and y",
        "x and z",
        "y and z",
    ]
    assert said[1:3] == ["position and tool axis", "position"]
