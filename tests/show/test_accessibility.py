"""Every kind of page, on a desk and on a phone, light and dark: axe-core finds nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from accessibility import violations
from browser import asleep, errors, schemes, wait_until_drawn
from commands import main

import repctl_pin as rp

QUICK = {"cycles": 2, "steps": 60, "degree": 1}


def written(line: str, name: str) -> Callable[[Path], str]:
    """A page that a command writes into a folder."""

    def page(folder: Path) -> str:
        assert main([*line.split(), "--out", str(folder)]) == 0
        return (folder / name).read_text("utf-8")

    return page


def study_of(robot: str, **how: Any) -> str:
    return rp.animation(rp.study(rp.Problem(robot, **how), **QUICK)).page


def audit(folder: Path) -> str:
    problem = rp.Problem("planar3r")
    usual = rp.Pseudoinverse(problem.task)
    motion = rp.follow(usual, problem.path, problem.start, cycles=7, steps=60)
    head = ",".join(["t", *problem.task.joint_names])
    table = np.column_stack([motion.t, motion.q])
    np.savetxt(folder / "arm.csv", table, delimiter=",", header=head, comments="")
    return written(f"audit {folder}/arm.csv --robot planar3r", "audit.html")(folder)


def notebook(folder: Path) -> str:
    """The output of a cell, below the heading of a notebook."""
    shown = rp.study("planar3r", **QUICK)._repr_html_()
    head = '<!DOCTYPE html><html lang="en"><head><title>Notebook</title></head><body><main>'
    return f"{head}<h1>Notebook</h1>{shown}</main></body></html>"


PAGES = {
    "study panda": lambda _: study_of("panda"),
    "study talos": lambda _: study_of("talos"),
    "study baxter": lambda _: study_of("baxter", frame=["left_gripper", "right_gripper"]),
    "study ppr": lambda _: study_of("ppr"),
    "cell": written("cell panda --half-width 0.03 --degree 1 --held-out 64", "cell.html"),
    "sector": written("cell z1 --down", "cell.html"),
    "audit": audit,
    "report": written("study planar3r --cycles 2 --degree 1 --report", "report.html"),
    "notebook": notebook,
}


def open_with_frames(driver: Any, file: Path) -> None:
    """Open a page, and wait until the animation in it is drawn, in a frame or not."""
    with asleep(driver):
        driver.get(file.as_uri() + "#paused")
        for frame in driver.find_elements("tag name", "iframe"):
            driver.switch_to.frame(frame)
            wait_until_drawn(driver, file.name)
            driver.switch_to.parent_frame()
        if not driver.find_elements("tag name", "iframe"):
            wait_until_drawn(driver, file.name)


@pytest.mark.slow
@pytest.mark.parametrize("name", PAGES)
def test_everybody_can_read_and_use_each_kind_of_page(
    name: str, driver: Any, tmp_path: Path
) -> None:
    """In the frames inside, too; the page is as wide as the window, and nothing goes wrong."""
    file = tmp_path / "page.html"
    file.write_text(PAGES[name](tmp_path), encoding="utf-8")
    schemes(driver, width=1280, height=760, still=True)
    open_with_frames(driver, file)
    found = []
    for width, height, dark in ((1280, 760, False), (1280, 760, True), (390, 844, True)):
        schemes(driver, width=width, height=height, dark=dark, still=True)
        driver.execute_async_script(
            "requestAnimationFrame(() => requestAnimationFrame(arguments[0]))"
        )
        found += [(width, dark, *one) for one in violations(driver)]
        wide = "return document.documentElement.scrollWidth <= window.innerWidth"
        assert driver.execute_script(wide), width
    assert found == [], "\n".join(map(str, found))
    assert errors(driver) == []
