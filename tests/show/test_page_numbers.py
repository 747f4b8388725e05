"""Numbers on the page against the motion: callouts, readings and bars, at any time."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import errors, open_page
from numpy.typing import NDArray
from page_file import Visuals, read

import repctl_pin as rp
from repctl_pin.robot.visuals import Shape
from repctl_pin.show.page import read_surface
from repctl_pin.show.page.body_points import corners
from repctl_pin.show.text import metres, number

ROBOTS = ("panda", "tiago", "baxter", "kinova", "talos", "planar3r", "xarm7", "ppr")

TOLD = """
const [times] = arguments, chart = document.getElementById("chart");
const text = (query) => [...document.querySelectorAll(query)].map((n) => n.textContent.trim());
return times.map((t) => { repctl.seek(t);
  const exact = [...document.querySelectorAll(".reading b")].map((n) => n.title);
  return [".callout:not(.hand) b", ".callout.hand b", ".reading b"].map(text)
    .concat([exact, document.getElementById("done").textContent])
    .concat([chart.getAttribute("aria-valuetext"), chart.getAttribute("aria-valuenow")]); });
"""


@cache
def points_of(shape: Shape) -> NDArray[np.float64]:
    """All points of a mesh, not those of its hull alone; corners of another shape."""
    if shape.kind != "mesh":
        return corners([shape])[0]
    return read_surface(shape.path).points * shape.scale


def off(
    study: rp.Study, now: NDArray[np.float64], then: NDArray[np.float64], link: str
) -> float:
    """How far the farthest point of a link's shapes has moved, m; of all links for an empty
    name."""
    visuals = Visuals.of(study.robot)
    ends = visuals.placements(study.task.to_robot(np.array([now, then])))
    ways = [
        np.linalg.norm(
            np.c_[p, np.ones(len(p))] @ (ends[0, s] - ends[1, s])[:3].T, axis=1
        ).max()
        for s, shape in enumerate(visuals.shapes)
        if link in ("", shape.link)
        for p in [points_of(shape)]
    ]
    return float(max(ways))


def written(value: float) -> set[str]:
    """The words for a length; both, where it is as near to one as to the other."""
    near = (value * (1 - 1e-4), value, value * (1 + 1e-4))
    return {"0 off" if v < 1e-4 else f"{metres(v)} off" for v in near}


def compare(driver: Any, study: rp.Study, page: Path, times: list[float]) -> None:
    html = rp.animation(study).page
    page.write_text(html, encoding="utf-8")
    scene = read(html)[0]
    shapes = Visuals.of(study.robot).shapes
    link = shapes[scene["arms"][0]["part"].index(True)].link
    open_page(driver, page)
    told = driver.execute_script(TOLD, times)
    for k, key in enumerate(("pseudoinverse", "repeatable")):
        motion = study.row(key).motion
        grid, joints = np.arange(len(motion.q)) / motion.steps, [0.0, *motion.drift]
        ends = [off(study, q, motion.q[0], "") for q in motion.q[:: motion.steps]]
        np.testing.assert_allclose(  # the bars
            scene["arms"][k]["off"], np.c_[ends[:-1], ends[1:]], rtol=1e-5, atol=1e-7
        )
        for time, (part, hand, reading, exact, when, bar, now) in zip(
            times, told, strict=True
        ):
            done = int(time)
            at = [
                [np.interp(t, grid, q) for q in motion.q.T] for t in (time, time - done)
            ]
            value = off(study, np.array(at[0]), np.array(at[1]), link)
            name = scene["part"] + (":" if scene["part"][-1].isdigit() else "")
            said = {f"{name} {words} now" for words in written(value)}
            assert part[k] in said, (time, value)
            assert hand[k] == "hand 0 off"
            assert np.ptp(study.task.positions(np.array(at)), axis=0).max() < 1e-3
            assert reading[k] in written(ends[done]) and reading[k] in bar
            assert int(now) == done
            ends_of = "1 cycle" if done == 1 else f"{done} cycles"
            assert when == (f"After {ends_of}" if done else "At the start")
            size = 0 if joints[done] < 1e-6 else number(joints[done])
            assert f"joints {size} {study.task.unit}, root of" in exact[k]
    assert errors(driver) == []


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
