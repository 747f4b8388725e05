"""Formulas of the text room, from inside: how numbers, lines, headlines, verdicts and parts are
written. What commands and pages print of motions is tested from outside."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from terminals import terminal_of
from test_own_loop import NODE, SCRIPTS

import repctl_pin as rp
from repctl_pin.show.text import numbers
from repctl_pin.show.text.coloured_text import Span, coloured, fitted, wrapped
from repctl_pin.show.text.headline import headline_of
from repctl_pin.show.text.motion_summary import MotionSummary
from repctl_pin.show.text.part_names import part_name

# ---- numbers and lines --------------------------------------------------------------------------


def test_numbers_are_written_one_way() -> None:
    assert [numbers.number(v) for v in (1.7495, 0.0238, 2.1e-11, 0.0, 1234.5, np.inf)] == [
        "1.75", "0.0238", "2e-11", "0", "1234", "–",
    ]  # fmt: skip
    assert [numbers.metres(v) for v in (9e-10, 9e-6, 9e-5, 2.6e-3, 0.45, 0.999, 1.234)] == [
        "0", "9 µm", "0.09 mm", "2.6 mm", "45 cm", "1 m", "1.2 m",
    ]  # fmt: skip
    assert [numbers.radians(v) for v in (9e-4, 0.0213, 3.719)] == [
        "9e-4 rad",
        "0.021 rad",
        "3.7 rad",
    ]
    assert [numbers.percent(v) for v in (4e-4, 0.003, -0.01, 0.25)] == [
        "0 %",
        "+0.3 %",
        "−1.0 %",
        "+25 %",
    ]


def test_what_stands_behind_a_label_goes_on_below_itself() -> None:
    words = "word " * 30
    first, *later = fitted(f"joint drift     {words}").splitlines()
    assert (
        first.startswith("joint drift     word")
        and later
        and all(line.startswith(" " * 16 + "w") for line in later)
    )
    assert fitted(f"note: {words}").splitlines()[1].startswith("      word")
    assert fitted("from /" + "a" * 100) == "from /" + "a" * 100


def test_a_pipe_gets_80_columns() -> None:
    assert max(map(len, fitted("word " * 40).splitlines())) in range(75, 81)
    assert fitted("word " * 40).split() == ["word"] * 40


def test_a_wrapped_sentence_keeps_its_pieces() -> None:
    off = Span("3\u00a0cm\u00a0off", "bad")
    out = wrapped([Span("word " * 15), off, Span(" under it. "), Span("x" * 90)])
    assert [span.tone for span in out] == ["", "bad", "", ""] and out[1].text == "3 cm off"
    assert "".join(span.text for span in out).splitlines() == [
        "word " * 14 + "word",
        "3 cm off under it.",
        "x" * 90,
    ]


def test_a_coloured_piece_controls_no_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    with terminal_of(80, 24):
        assert coloured([Span("\x1b[2J", "bad")]) == "\x1b[31m\\x1b[2J\x1b[0m"


# ---- headlines: what is wrong, what is right, and its price -------------------------------------

USUAL = MotionSummary("J⁺", 0.321, 1.0, 1.1, body_distance=0.13, part="elbow", link="link4")
CLOSED = MotionSummary(
    "nearest repeatable", 1e-12, 1.003, 1.003, body_distance=0.2, part="elbow", link="link4"
)


BACK = "After 10 cycles the hand is back under either control. "


def words(told: Any) -> tuple[str, str]:
    """The sentence and the notes of a headline."""
    sentence = "".join(span.text for span in told.sentence)
    return sentence.replace("\u00a0", " "), " ".join(n.text for n in told.notes).replace(
        "\u00a0", " "
    )


def test_it_says_what_is_wrong_what_is_right_and_the_price() -> None:
    sentence, notes = words(headline_of([USUAL, CLOSED], 10))
    assert sentence == (
        BACK + "The elbow is not: 32 cm from its start under the usual control, "
        "0 under the repeatable one."
    )
    assert (
        notes
        == "Average joint speed on this path: 0.3 % higher under the repeatable one than under the "
        "usual control in cycle 1, 8.8 % lower over all 10 cycles. This is possible because the "
        "two arms pass through different joint positions. Joint limits are kept. Links stay at "
        "least 13 cm apart under both controls."
    )
    exact = [span.exact for span in headline_of([USUAL, CLOSED], 10).sentence if span.exact]
    assert exact == ["link4: 0.321 m", "link4: 1e-12 m"]


@pytest.mark.parametrize(
    ("summaries", "expected"),
    [
        (
            [replace(USUAL, off=0.0017), CLOSED],
            BACK + "The elbow has hardly drifted in 10 cycles: 1.7 mm under the usual control, "
            "0 under the repeatable one.",
        ),
        (
            [replace(USUAL, off=1.1e-4), replace(CLOSED, off=4.3e-5)],  # as the callouts say it
            BACK + "The elbow has hardly drifted in 10 cycles: 0.11 mm under the usual control, "
            "0 under the repeatable one.",
        ),
        ([USUAL], "After 10 cycles the hand is back. The elbow is not: 32 cm from its start."),
        (
            [replace(USUAL, part="head"), CLOSED],
            BACK + "The head is not: 32 cm from its start under the usual control, "
            "0 under the repeatable one.",
        ),
        (
            [replace(USUAL, part="link arm_3"), CLOSED],
            BACK + "Link arm_3 is not: 32 cm from its start under the usual control, "
            "0 under the repeatable one.",
        ),
        (
            [replace(USUAL, part="link 3"), CLOSED],
            BACK + "Link 3 of the arm is not: 32 cm from its start under the usual control, "
            "0 under the repeatable one.",
        ),
        ([CLOSED, CLOSED], BACK + "So is every part of the arm: 0 from its start."),
        (
            [replace(USUAL, off=0.0, joint_displacement=(6.28, "joint_1")), CLOSED],
            BACK + "The joint joint_1 is not: 6.3 rad under the usual control, "
            "0 under the repeatable one.",
        ),
    ],
)
def test_every_summary_has_its_sentence(summaries: list[MotionSummary], expected: str) -> None:
    assert words(headline_of(summaries, 10))[0] == expected


def test_no_sentence_of_one_arm_speaks_of_two_hands() -> None:
    """Issue 37, item 15: one hand under either control; hands of two arms are two hands."""
    outcomes = [USUAL, CLOSED, replace(USUAL, off=0.0017)]
    for first in outcomes:
        for motions in ([first], [first, CLOSED], [first, USUAL, CLOSED]):
            for stopped in ([], ["Usual control stopped: why."]):
                told = words(headline_of(motions, 10, stopped))[0]
                assert "hands" not in told and "one arm" not in told
    three = words(headline_of([USUAL, replace(USUAL, label="mine"), CLOSED], 10))[0]
    assert three.startswith("After 10 cycles the hand is back under every control. ")
    two = words(headline_of([USUAL, CLOSED], 10, kinds=[rp.Robot.load("panda").task().kind] * 2))[0]
    assert two.startswith("After 10 cycles both hands are back under either control. ")


@pytest.mark.parametrize(
    ("kinds", "back"),
    [
        (["pose"], "the hand is back"),
        (["position"], "the hand is back in position"),
        (["axis"], "the hand is back in position and tool axis"),
        (["xy"], "the hand is back in x and y"),
        (["pose", "pose"], "both hands are back"),
        (["position", "position"], "both hands are back in position"),
        (["pose", "xz"], "both hands are back in what is commanded of each"),
    ],
)
def test_a_hand_is_back_in_what_its_task_commands(kinds: list[str], back: str) -> None:
    """A hand that was free to turn ended turned, and was said to be back."""
    robot = rp.Robot.load("panda")
    each = [robot.task(kind=kind).kind for kind in kinds]
    told = words(headline_of([USUAL, CLOSED], 10, kinds=each))[0]
    assert told.startswith(f"After 10 cycles {back} under either control. ")
    assert type(each[0]).stacked(each).each == tuple(each)


def test_another_hand_that_moves_with_the_arm_is_named() -> None:
    """Issue 37, item 15: with its distance, and with its link where the name is not enough; a
    hand comes before a head, and what is back is not said."""
    ends = {"head_2_link": 0.4, "right_gripper": 0.298, "left_foot": 0.0}
    told = words(
        headline_of([replace(USUAL, ends=ends), replace(CLOSED, ends=dict.fromkeys(ends, 0.0))], 10)
    )
    assert told[0] == (
        BACK + "The elbow is not: 32 cm from its start under the usual control, "
        "0 under the repeatable one. "
        "Under the usual control the other hand is 30 cm from its start, the head 40 cm."
    )
    feet = {"left_foot": 0.2, "right_foot": 0.1}
    both = [replace(USUAL, ends=feet), replace(CLOSED, ends=feet)]
    assert words(headline_of(both, 10))[0].endswith(
        " The foot left_foot is up to 20 cm from its start, the foot right_foot up to 10 cm."
    )
    alone = words(headline_of([replace(USUAL, ends={"right_gripper": 0.3})], 10))[0]
    assert alone.endswith(" The other hand is 30 cm from its start.")


def test_a_hand_that_is_not_back_is_said() -> None:
    """Issue 37, item 15: in a motion without a path, such as one from a file."""
    told = words(headline_of([replace(USUAL, hand_off=0.12), CLOSED], 10))[0]
    assert told == (
        "Under the usual control the hand is not back after 10 cycles: 12 cm from its start. "
        "After 10 cycles the elbow is not back: 32 cm from its start under the usual control, "
        "0 under the repeatable one."
    )


def test_a_motion_along_an_open_path_is_not_judged_as_a_cycle() -> None:
    told = words(headline_of([replace(USUAL, hand_off=0.12)], 1))
    assert told == (
        "The path is not closed: the hand ends 12 cm from where it began.",
        "Joint limits are kept. Links stay at least 13 cm apart.",
    )


def test_a_winding_path_is_said_first() -> None:
    """Issue 37, awkward studies: why neither motion closes; nothing, where every part is back."""
    wound = [replace(one, winding=(-1, "theta1")) for one in (USUAL, CLOSED)]
    told = words(headline_of(wound, 10, ["Repeatable stopped: why."]))[0]
    assert told.startswith(
        "The path winds once around the axis of theta1, so it need not close under any control. "
    )
    assert "winds" not in words(headline_of(wound[1:], 10))[0]
    both = words(headline_of([wound[0], wound[0]], 10))[0]
    assert "need not close under any control: neither arm is back. " in both


def test_what_is_not_checked_for_collisions_is_said() -> None:
    """Issue 37, item 16."""
    blind = replace(USUAL, unchecked="8 bodies without a collision shape")
    assert words(headline_of([blind, CLOSED], 10))[1].endswith(
        "Collisions not checked: 8 bodies without a collision shape."
    )
    told = str(
        headline_of([replace(USUAL, unchecked="1 body without a collision shape"), CLOSED], 10)
    )
    assert told.endswith("Collisions not checked: 1 body without a collision shape.")


HIT = (3, ("link 5", "link 7"))
BEYOND = "In a simulation that goes on, after 10 cycles "
OFF = (
    "the elbow is not back: 32 cm from its start under the usual control, "
    "0 under the repeatable one."
)


@pytest.mark.parametrize(
    ("usual", "closed", "expected"),
    [
        (
            {"limit_violation": (7, "joint 2")},
            {},
            "Under the usual control, joint 2 leaves its range in cycle 7. ",
        ),
        (
            {"limit_violation": (7, "joint 2"), "collision": HIT, "overspeed": (9, "joint 4", 2.1)},
            {},
            "Under the usual control, link 5 and link 7 collide in cycle 3, and joint 2 leaves its "
            "range in cycle 7, and joint 4 reaches 2.1 times its speed limit in cycle 9. ",
        ),
        (
            {"limit_violation": (1, "joint 2")},
            {"limit_violation": (1, "joint 2")},
            "Under either control, joint 2 leaves its range in cycle 1. ",
        ),
        (
            {"limit_violation": (1, "joint 2")},
            {"limit_violation": (4, "joint 2")},
            "Under the usual control, joint 2 leaves its range in cycle 1. "
            "Under the repeatable one, joint 2 leaves its range in cycle 4. ",
        ),
        (
            {},
            {"collision": HIT},
            "Under the repeatable one, link 5 and link 7 collide in cycle 3; give another start or "
            "path. ",
        ),
        (
            {"collision": HIT},
            {"collision": HIT},
            "No motion without a collision was found: under either control, link 5 and link 7 "
            "collide in cycle 3; give another start or path. ",
        ),
    ],
)
def test_what_breaks_a_limit_or_collides_is_said_first(
    usual: dict[str, Any], closed: dict[str, Any], expected: str
) -> None:
    """It was said that the hand is back, of an arm past its limit from the first cycle on."""
    pair = [replace(USUAL, **usual), replace(CLOSED, **closed)]
    told = headline_of(pair, 10)
    assert words(told)[0] == expected + BEYOND + OFF and told.sentence[0].tone == "bad"
    assert "the hand is back" not in str(told)
    broken = [one for one in pair if one.limit_violation]
    assert ("Joint limits are kept." in words(told)[1]) == (not broken)


def test_limits_of_speed_that_are_not_known_are_not_said_to_be_kept() -> None:
    """Of a model without them, it was said that limits are kept, and no more."""
    blind = replace(USUAL, speeds_checked=False)
    told = words(headline_of([blind, CLOSED], 10))[1]
    assert "Joint limits are kept; joint speeds are not checked. " in told


def test_one_motion_and_arms_that_are_back_break_limits_too() -> None:
    alone = words(headline_of([replace(USUAL, limit_violation=(7, "joint 2"))], 10))[0]
    assert alone.startswith("In this motion, joint 2 leaves its range in cycle 7. " + BEYOND)
    back = [replace(CLOSED, label=label, collision=HIT) for label in ("J⁺", CLOSED.label)]
    assert words(headline_of(back, 10))[0].endswith(
        f"{BEYOND}every part of the arm is back: 0 from its start."
    )
    stuck = headline_of(back[1:], 10, ["Usual control stopped: why."])
    assert str(stuck).startswith("Under the repeatable control, link 5 and link 7 collide in cycle")


LOOP = """
import { readFileSync } from "node:fs";
import { answer } from "./own/sentence.js";
const chain = { frames: [{}], links: [["l4", "elbow"]], names: ["joint 2"], axis: {}, ends: [],
  fastest: [1], back: "the hand is back" };
const run = ({ under, broken, off, turned, cycles }) => ({
  data: { under, broken, lost: Infinity }, margin: 0.9, speeds: Array(cycles).fill(1),
  ends: Array(cycles).fill([off]), turned: Array(cycles).fill([turned]),
  others: Array(cycles).fill([]) });
const told = JSON.parse(readFileSync("cases.json")).map(({ each, cycles, encloses }) => {
  const arms = each.map((data) => ({ data, moving: [{ shape: 0 }] }));
  const shape = { encloses, turns: 0, whose: "your loop" };
  const { sentence, notes } = answer(chain, arms, { runs: each.map(run) }, cycles, shape);
  return [sentence, notes].map((all) => all.map(([text]) => text).join("")); });
console.log(JSON.stringify(told));
"""
PAST = {"cycle": 3, "name": "joint 2", "words": "joint 2 past its limit"}


@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_a_loop_past_a_limit_is_told_as_a_study_is(tmp_path: Path) -> None:
    """By the page's own script: it said that the hand is back, too."""
    pair = [
        {"under": "the usual control", "off": 0.321, "turned": 0.4, "cycles": 10, "broken": PAST},
        {"under": "the repeatable one", "off": 0.0, "turned": 0.0, "cycles": 10},
    ]
    little, turned = ([{**pair[0], "off": off}, pair[1]] for off in (0.0017, 0.0))
    little[0]["turned"] = 0.0
    both = [{**one, "off": 0.0, "turned": 0.0, "broken": PAST} for one in pair]
    fast = {"cycle": 3, "words": "joint 2 past its speed limit"}
    cases = [pair, little, turned, both, [{**pair[0], "broken": fast}, pair[1]], pair]
    shutil.copytree(SCRIPTS.parent, tmp_path, dirs_exist_ok=True)
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "loop.js").write_text(LOOP)
    made = [
        {"each": each, "cycles": 2 if k == len(cases) - 1 else 10, "encloses": True}
        for k, each in enumerate(cases)
    ]
    (tmp_path / "cases.json").write_text(json.dumps(made))
    found = subprocess.run([str(NODE), "loop.js"], cwd=tmp_path, capture_output=True, check=True)
    *told, early = json.loads(found.stdout.decode().replace("\u00a0", " "))
    for (sentence, notes), each in zip(told[:4], cases, strict=False):
        studied = [
            replace(
                summary,
                off=one["off"],
                joint_displacement=(one["turned"], "joint 2"),
                limit_violation=(3, "joint 2") if one.get("broken") else None,
            )
            for one, summary in zip(each, (USUAL, CLOSED), strict=True)
        ]
        study = words(headline_of(studied, 10))[0]
        assert sentence == study.replace("in cycle 3.", "in cycle 3 of your loop.", 1)
        assert "limits" not in notes and "leaves its range" not in notes
    assert told[4][0].startswith(
        "Under the usual control, joint 2 exceeds its speed limit in cycle 3 of your loop. In a "
    )
    # of fewer cycles, all is well, and what comes later is a note
    assert early[0].startswith("After 2 cycles of your loop the hand is back. The elbow is not: ")
    assert "In cycle 3, joint 2 leaves its range under the usual control." in early[1]


def test_a_lost_path_is_not_called_back() -> None:
    lost = replace(USUAL, path_loss=(3, 0.02, 0.0))
    sentence, notes = words(headline_of([lost, CLOSED], 10))
    assert sentence.startswith(
        "Under the usual control the hand leaves its path in cycle 3, by up to 2 cm"
    )
    assert sentence.endswith(
        "After 10 cycles the elbow is not back: 32 cm from its start under the usual control, "
        "0 under the repeatable one."
    )
    assert "hands" not in sentence and "joint speed" not in notes
    closed = replace(CLOSED, path_loss=(3, 0.02, 0.0))
    told = words(headline_of([closed], 10))[0]
    assert told.endswith("After 10 cycles every part of the arm is back: 0 from its start.")
    little = words(headline_of([replace(lost, off=0.0017)], 10))[0]
    assert little.endswith("After 10 cycles the elbow has hardly drifted: 1.7 mm.")
    turned = replace(USUAL, path_loss=(3, 1e-12, 0.31))
    assert "in cycle 3, by up to 0.31 rad. " in words(headline_of([turned, CLOSED], 10))[0]


def test_a_stopped_motion_is_said_first() -> None:
    why = "Usual control stopped: the Jacobian loses rank."
    told = words(headline_of([CLOSED], 10, [why]))[0]
    assert told.startswith(
        "Usual control stopped: the Jacobian loses rank. After 10 cycles the hand is "
        "back under the repeatable control. So is every part of the arm: 0 from its start."
    )
    assert words(headline_of([], 0, [why]))[0] == f"{why} "


def test_limits_bodies_and_where_it_leads() -> None:
    leading = replace(USUAL, leaves=(17, "joint 2"))
    assert (
        "If every further cycle drifts like cycle 10, joint 2 leaves its range in cycle 17 "
        "under the usual control." in (words(headline_of([leading, CLOSED], 10))[1])
    )
    assert "limits are kept in these 10 cycles." in words(headline_of([leading, CLOSED], 10))[1]
    # the same joint in the same cycle is said once
    also = replace(leading, label="pink")
    told = words(headline_of([also, leading, CLOSED], 10))[1]
    assert (
        "drifts like cycle 10, joint 2 leaves its range in cycle 17 under pink and under the usual "
        "control." in told
    )
    assert told.count("every further cycle") == 1
    later = replace(also, leaves=(18, "joint 3"))
    assert (
        "cycle 18 under pink, and joint 2 leaves its range in cycle 17 under the usual control."
        in words(headline_of([later, leading, CLOSED], 10))[1]
    )
    faster = replace(CLOSED, mean_speed=1.003 * USUAL.mean_speed)
    told = words(headline_of([USUAL, faster], 10))[1]
    assert told.startswith(
        "Average joint speed on this path: 0.3 % higher under the repeatable one than under the "
        "usual control in cycle 1 and over all 10 cycles. Joint limits"
    )
    slower = words(headline_of([USUAL, replace(CLOSED, speed=0.998 * USUAL.speed)], 1))[1]
    assert slower.startswith(
        "Average joint speed on this path: 0.2 % lower under the repeatable one than under the "
        "usual control in cycle 1. This is possible because the two arms pass through different "
        "joint positions."
    )
    close = replace(USUAL, body_distance=0.013, near=("link3", "link5"))
    told = headline_of([close, CLOSED], 10)
    nearest = "Closest links: 1.3 cm between link3 and link5 under the usual control."
    assert nearest in words(told)[1]
    assert [n.tone for n in told.notes if "Closest" in n.text] == ["near"]
    also = replace(CLOSED, body_distance=0.013, near=("link3", "link5"))
    (near,) = (n.text for n in headline_of([close, also], 10).notes if "Closest" in n.text)
    assert near == "Closest links: 1.3\u00a0cm between link3 and link5, under both controls."


def test_two_distances_that_round_alike_are_told_apart() -> None:
    """Two pairs of links, 4.76 mm and 4.83 mm apart, were both "as near as 4.8 mm" on tiago."""
    usual = replace(USUAL, body_distance=0.0047629, near=("torso", "arm 1"))
    closed = replace(CLOSED, body_distance=0.0048327, near=("arm 5", "tool"))
    told = words(headline_of([usual, closed], 10))[1]
    assert told.endswith(
        "Closest links: 4.76 mm between torso and arm 1 under the usual control, "
        "4.83 mm between arm 5 and tool under the repeatable one."
    )


def test_a_link_without_words_keeps_the_name_of_the_file(tmp_path: Path) -> None:
    """26.14: no "Arm 2 is not", "L 1 of the arm", "Link 6 r of the arm"."""
    chain = ["base", "one", "two", "three"]
    names = ["arm_2_link", "l1", "link_6_r", "base_plate", "link_7"]
    kinds = [(a, b, "continuous") for a, b in pairwise(chain)]
    kinds += [("base", b, "fixed") for b in names]
    joints = [
        f'<link name="{b}"/><joint name="to_{b}" type="{kind}"><parent link="{a}"/>'
        f'<child link="{b}"/><origin xyz="0 0.5 1"/></joint>'
        for a, b, kind in kinds
    ]
    file = tmp_path / "r.urdf"
    file.write_text(f'<robot name="made"><link name="base"/>{"".join(joints)}</robot>')
    task = rp.Robot.load(file).task("three", "yz")
    told = [part_name(task, np.array([0.2, 0.5, 0.7]), link) for link in names]
    assert told == ["link arm_2", "link l1", "link link_6_r", "base plate", "link 7"]


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
