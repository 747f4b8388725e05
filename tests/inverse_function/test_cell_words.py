"""What the first sentence and the rows say that a function covers, beside the cell itself."""

from __future__ import annotations

import re
from dataclasses import replace
from importlib import import_module

import numpy as np
import pinocchio as pin
import pytest
from sectors import WIDTHS, found, sector_of

import repctl_pin as rp

PAGE = import_module("repctl_pin.extensions.cells.show.cell_page")
BEST_CELL = import_module(rp.best_cell.__module__)
DESIGN = import_module(rp.CellDesign.__module__)


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"-?\d+\.?\d*", text.replace("−", "-"))]


def test_the_sentence_promises_no_more_than_the_sector() -> None:
    """Every end is rounded inward, by at most 1 cm or 1°; heights are from the base."""
    sector = sector_of("one orientation by height", angle=1.0)
    z = sector.placement.translation[2] + sector.widths[2] * np.array([-1, 1])
    low, high, inner, outer, at, angle = numbers(PAGE.range_phrase(sector))
    # of which height the range of radius is
    assert abs(at - z.mean()) <= 0.005
    assert f" at height {at:.2f} m" in PAGE.range_phrase(sector)
    assert f" m around the base at height {at:.2f} m" in PAGE.gap_phrase(sector)
    rho = sector.radii([sector.middle[1] + at - z.mean()])[0]
    cut = [low - z[0], z[1] - high, inner - rho[0], rho[1] - outer]
    assert -1e-9 < min(cut) and max(cut) < 0.01
    assert 0 <= np.degrees(2.0) - angle < 1
    assert numbers(PAGE.range_phrase(sector, {"angle": np.radians(33)}))[-1] == 33
    assert "\n" not in PAGE.range_phrase(sector)


@pytest.mark.parametrize("name", WIDTHS)
def test_the_direction_of_the_tool_is_said_once_for_every_task(name: str) -> None:
    """`cell z1 --down` ended in an IndexError: an axis task has no spin."""
    assert PAGE.range_phrase(sector_of(name), tool="down").count("tool down") == 1


@pytest.mark.parametrize(
    ("name", "same"),
    [("one orientation", "pose"), ("axis", "position and tool axis"), ("position", "position")],
)
def test_a_function_promises_what_its_task_fixes(name: str, same: str) -> None:
    """The axis task of a kinova, whose spin is free, was said to have the same pose."""
    design = found(name)
    first = str(PAGE.cell_headline(design))
    assert first.startswith(f"Same hand {same}, same joints, however the hand gets there: ")
    assert f"Same hand {same}, same joints" in PAGE.cell_words(design, {})


def test_each_height_has_a_line_of_its_own() -> None:
    """55: three ranges of radius stood in one line."""
    design = found("one orientation by height")
    sector, lines = design.cell, design.figures()["radius"].split("\n")
    assert len(lines) == 5 and max(map(len, lines)) < 60
    for line in lines:
        low, high, height = numbers(line)
        assert sector.radii([height])[0] == pytest.approx([low, high], abs=2e-3)
    # a range is a promise: in the numbers, too, its ends are rounded inward
    u = np.linspace(-1, 1, 5)
    exact = sector.radii(sector.middle[1] + sector.widths[2] * u)
    ends = np.array([numbers(line)[:2] for line in lines])
    assert (ends[:, 0] >= exact[:, 0] - 1e-9).all() and (ends[:, 1] <= exact[:, 1] + 1e-9).all()
    assert np.abs(ends - exact).max() < 1.001e-3


def test_the_rows_of_a_sector_are_explained_by_their_own_names() -> None:
    """A sector without a height had the meaning of its height in place of that of its angle."""
    design = found("one orientation")
    rows = design.figures()
    assert {"radius", "height", "angle"} <= rows.keys() and "cell" not in rows
    assert {"Radius", "Height", "Angle"} <= PAGE.cell_words(design, {}).keys()


def test_no_price_is_one_number() -> None:
    """55: "0 % on average, under 0.001 % at worst"."""
    design = found("one orientation")
    free = replace(design.evaluation, extra_speed=0.0, extra_speed_worst=2e-6,
                   extra_speed_direction=3e-6)  # fmt: skip
    without = replace(design, evaluation=free)
    assert without.figures()["extra joint speed"] == "0"
    said = str(PAGE.cell_headline(without))
    assert "Joint speed as under the usual control." in said and "0.001 %" not in said
    dear = str(PAGE.cell_headline(replace(design, evaluation=replace(free, extra_speed_worst=0.2))))
    assert "at worst +20 %." in dear and "direction" not in dear
    turning = replace(free, extra_speed_worst=0.2, extra_speed_direction=1.2)
    said = str(PAGE.cell_headline(replace(design, evaluation=turning)))
    assert "Joint speed of all poses above that of the usual control: " in said
    # all of one form: "up to 120 %" was read as a ratio
    worst, single = "at worst +20 %, up to", "in a single direction of motion."
    assert f"{worst} +120 % {single}" in said
    turning = replace(free, extra_speed_worst=0.2, extra_speed_direction=0.5)
    said = str(PAGE.cell_headline(replace(design, evaluation=turning)))
    assert f"{worst} +50 % {single}" in said
    less = replace(design, evaluation=replace(turning, extra_speed=-0.03))
    assert "control: −3 % on average" in str(PAGE.cell_headline(less)).replace("\u00a0", " ")


def test_a_sector_is_not_called_a_cell() -> None:
    design = found("one orientation")
    text = f"{design.summary()} {PAGE.cell_headline(design)}"
    assert "sector" in text and not re.search(r"\bcells?\b|\bbox\b", text)


def test_the_sentence_calls_proved_only_what_is() -> None:
    """The limits of joints that end a range are not in the proof: their range is tested."""
    design = found("one orientation")
    proof = rp.prove(design)
    assert proof and proof.limit_margin > 0
    said = str(PAGE.cell_headline(replace(design, proof=proof)))
    assert proof.excepted
    without = f", without those of {' and '.join(proof.excepted)},"
    assert f"The function and its joint limits{without} proved at every pose" in said


def test_a_full_turn_within_wider_limits_is_not_the_whole_range() -> None:
    """A first joint that turns more than once was said to use its range, and did not count."""
    design = found("one orientation")
    (turn,) = design.evaluation.turns
    assert turn.reach < 2 * np.pi and not turn.left  # its limits end the range
    ends = f"{turn.joint} uses its whole range"
    assert ends in str(PAGE.cell_headline(design)).replace("\u00a0", " ")
    assert f"without {turn.joint}, whose limits" in design.summary()
    once = replace(turn, joint_range=2 * np.pi + turn.spread + 0.05, reach=2 * np.pi)
    wide = replace(design, evaluation=replace(design.evaluation, turns=(once,)))
    said = str(PAGE.cell_headline(wide)).replace("\u00a0", " ")
    assert re.search(r"Joint limits kept by 0\.02[45] rad or more", said) and ends not in said
    assert f"0.025 rad of {turn.joint}, a full turn" in wide.summary()


@pytest.mark.parametrize(
    ("name", "kind", "axis"),
    [
        ("panda", "pose", "z"),
        ("xarm7", "pose", "z"),  # the frame lies on the last joint
        ("tiago", "pose", "x"),  # said nothing: its tool points along x
        ("z1", "axis", "x"),
        ("ur5", "axis", "z"),  # without a spin, the page was not written
    ],
)
def test_the_sentence_says_where_the_tool_points(name: str, kind: str, axis: str) -> None:
    """By the rule with which ``best_cell`` points it, also in a frame turned by it."""
    robot = rp.Robot.load(name)
    task = robot.task(robot.default_frame, kind)
    row: dict[str, str] = {}
    # the table said "z axis of the frame" of a frame whose x axis was called the approach axis
    named = f"{axis} axis of {task.frame}"

    def told(up: float, approach: str = axis, **more: float) -> str:
        """Of a frame that is turned such that this axis is z, which points up or down."""
        tool = BEST_CELL.approach_axis(task, approach)
        R = np.diag([1.0, up, up])
        place = pin.SE3(R, np.array([0.5, 0.0, 0.3]))
        at_flange = pin.SE3(R @ tool.rotation.T, place.translation)
        turned = BEST_CELL.with_approach(task, tool)
        said = []
        row.update(DESIGN.range_rows(rp.Sector(turned, place, radius=0.05, angle=0.5)))
        for one, placement in ((turned, place), (task, at_flange)):
            sector = rp.Sector(one, placement, radius=0.05, angle=0.5, **more)
            said.append(PAGE.range_phrase(sector, tool=PAGE.tool_direction(sector)))
        assert said[0] == said[1] or approach != axis
        return said[0]

    assert told(-1).endswith(", tool down") and told(1).endswith(", tool up")
    assert row["orientation"].startswith(f"{'z axis of the frame' if axis == 'z' else named} up")
    assert "tool" not in told(-1, half_angle=0.1)
    # the user, who says otherwise, may know better
    assert "tool" not in told(-1, f"-{axis}")


def test_the_sentence_says_where_the_tool_points_and_what_is_left_out() -> None:
    """Neither was said; the panda's tool points down, and its first joint has no full turn."""
    design = found("one orientation")
    told, (gap, *_) = PAGE._covered(design), PAGE.cell_headline(design).notes
    assert "tool down" in told
    inner, angle = numbers(gap.text)
    assert gap.text.startswith("Not covered: ")
    rho = design.cell.radii([design.cell.middle[1]])[0]
    assert 0 <= inner - rho[0] < 0.01
    (turn,) = PAGE.degrees_turned(design.cell, PAGE._reaches(design)).values()
    assert angle == 360 - turn > 0
