"""Numbers on the page against the motion: callouts, readings and bars, at any time."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from browser import errors, open_page
from numpy.typing import NDArray
from page_file import Drawn, read
from said import reads

import repctl_pin as rp

ROBOTS = ("panda", "tiago", "baxter", "kinova", "talos", "planar3r", "xarm7", "ppr")

TOLD = """
const [times] = arguments, chart = document.getElementById("chart");
const text = (query) => [...document.querySelectorAll(query)].map((n) => n.textContent.trim());
return times.map((t) => { repctl.seek(t);
  const exact = [...document.querySelectorAll(".reading b")].map((n) => n.title);
  return [".callout:not(.hand, .mark) b", ".callout.hand b", ".reading b"].map(text)
    .concat([exact, document.getElementById("done").textContent])
    .concat([chart.getAttribute("aria-valuetext"), chart.getAttribute("aria-valuenow")]); });
"""


def written(value: float) -> set[str]:
    """The words for a length; both, where it is as near to one as to the other (2 µm: the page's
    corners stand for all points)."""
    rounding = 1e-4 * value + 2e-6
    near = (value - rounding, value, value + rounding)
    return {"0" if v < 1e-4 else rounded(v) for v in near}


def rounded(length: float) -> str:
    """Two digits, in the unit that suits."""
    scale, unit = (
        (1, "m") if length >= 0.995 else (100, "cm") if length >= 0.00995 else (1000, "mm")
    )
    return f"{float(f'{scale * length:.2g}'):g} {unit}"


def links_of_arm(study: rp.Study) -> set[str]:
    """The links that joints between root and frame carry, and those beyond the frame, as the file
    has them."""
    root = ElementTree.parse(study.robot.description.path).getroot()
    above = {}
    for joint in root.iter("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None:
            moves = joint.get("type") != "fixed"
            above[child.get("link")] = (parent.get("link"), joint.get("name"), moves)

    def carried(link: str | None) -> list[str | None]:
        """The moving joints above a link, the nearest first; None stands for the root."""
        if link not in above:
            return [None]
        parent, name, moves = above[link]
        return [name, *carried(parent)] if moves else carried(parent)

    chain = carried(study.task.frame)
    links = {str(link.get("name")) for link in root.iter("link")}
    return {link for link in links if carried(link)[0] in chain or chain[0] in carried(link)}


def compare(driver: Any, study: rp.Study, page: Path, times: list[float]) -> None:
    html = rp.animation(study).page
    page.write_text(html, encoding="utf-8")
    scene = read(html)[0]
    drawn, whole = Drawn(study.robot), study.task.to_robot
    arm = scene["arms"][0]
    flagged = {s["name"] for s, its in zip(arm["shapes"], arm["part"], strict=True) if its}
    part_of = np.isin(drawn.names, list(flagged))
    of_arm = np.isin(drawn.links, list(links_of_arm(study)))

    def off(now: NDArray[np.float64], then: NDArray[np.float64]) -> NDArray[np.float64]:
        return drawn.moved(*whole(np.array([now, then])))

    # the headline's and the callouts' part is the one that is farthest off
    ways = off(*study.row("pseudoinverse").motion.q[[-1, 0]]) * of_arm
    assert part_of[ways.argmax()]
    assert len(set(np.array(drawn.links)[part_of])) == 1
    words = rounded(ways.max()).replace(" ", " ")
    exact = f"{drawn.links[ways.argmax()]}: {ways.max():.3g} m"
    assert f'title="{exact}">{words}' in html
    open_page(driver, page)
    free = "" if study.task.kind.turns else ", free to turn:"
    told = driver.execute_script(TOLD, times)
    for k, key in enumerate(("pseudoinverse", "repeatable")):
        motion = study.row(key).motion
        grid, joints = np.arange(len(motion.q)) / motion.steps, [0.0, *motion.drift]
        ends = [off(q, motion.q[0])[of_arm].max() for q in motion.q[:: motion.steps]]
        np.testing.assert_allclose(  # the bars
            scene["arms"][k]["off"], np.c_[ends[:-1], ends[1:]], rtol=1e-5, atol=1e-7
        )
        for time, (part, hand, reading, exact, when, bar, now) in zip(times, told, strict=True):
            done = int(time)
            at = [[np.interp(t, grid, q) for q in motion.q.T] for t in (time, time - done)]
            name = scene["part"] + (":" if scene["part"][-1].isdigit() else "")
            if time == done:  # off from its start
                value = off(motion.q[done * motion.steps], motion.q[0])[part_of].max()
                said = {f"{name} {words}" for words in written(value)}
                assert part[k] in said, (time, value)
            else:  # off from the repeatable arm, now
                other = study.row("repeatable").motion.q
                grey = [np.interp(time, grid, q) for q in other.T] if k == 0 else at[0]
                value = off(np.array(at[0]), np.array(grey))[part_of].max()
                number, unit = f"{part[k].removeprefix(name)} m".split()[:2]  # a 0 has no unit
                there = float(number) * {"m": 1, "cm": 1e-2, "mm": 1e-3}[unit]
                assert there == pytest.approx(value, rel=0.06, abs=5e-4), (time, value)
            # a narrow pane leaves out what is free
            assert re.fullmatch(f"hand({free})? 0 from its start", hand[k]), hand[k]
            assert np.ptp(study.task.positions(np.array(at)), axis=0).max() < 1e-3
            assert reading[k] in written(ends[done]) and reading[k] in bar
            assert int(now) == done
            ends_of = "1 cycle" if done == 1 else f"{done} cycles"
            assert when == (f"After {ends_of}, from its start" if done else "At the start")
            said = re.search(r"joints (\S+) (.*), root of", exact[k])
            assert said is not None and said[2] == study.task.unit
            size = 0.0 if joints[done] < 1e-6 else joints[done]
            assert said[1] == "0" if size == 0 else reads(said[1], size, 3)
    assert errors(driver) == []


@pytest.mark.slow
def test_numbers_are_the_motions(driver: Any, tmp_path: Path) -> None:
    study = rp.study("planar3r", degree=1)
    compare(driver, study, tmp_path / "page.html", [0.0, 0.37, 4.5, 7.01, 9.993])
    assert "joints 0.279 rad" in driver.execute_script(
        "repctl.seek(4.5); return document.querySelector('.reading b').title"
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_numbers_are_right_at_200_times(driver: Any, tmp_path: Path, name: str) -> None:
    times = np.random.default_rng(0).uniform(0, 10, 200).tolist()
    compare(driver, rp.study(name), tmp_path / "page.html", times)
