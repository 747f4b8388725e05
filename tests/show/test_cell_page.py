"""The page of a function over a sector, as its reader sees it: real rectangles in a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from browser import asleep, errors, only_pictures_asked_for, schemes, wait_until_drawn
from commands import main

PHONE = {"width": 390, "height": 844}
DESK = {"width": 1280, "height": 760}


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a sector of a panda's workspace, whose radius depends on the height."""
    folder = tmp_path_factory.mktemp("sector")
    sizes = ["--radius", "0.08", "--height", "0.08", "--degree", "1", "--held-out", "64"]
    ranges = ["--angle", "all", "--spin", "all"]
    assert main(["cell", "panda", "--sector", *sizes, *ranges, "--out", str(folder)]) == 0
    return folder / "cell.html"


def opened(driver: Any, page: Path, **size: Any) -> None:
    """Open the page and its animation, which stands at its end."""
    schemes(driver, **size)
    with asleep(driver):
        driver.get(page.as_uri() + "#paused")
        driver.switch_to.frame(driver.find_element("tag name", "iframe"))
        wait_until_drawn(driver, page.name)
    only_pictures_asked_for(driver)
    driver.switch_to.default_content()


def box(driver: Any, selector: str) -> dict[str, float]:
    found: dict[str, float] = driver.execute_script(
        "return document.querySelector(arguments[0]).getBoundingClientRect().toJSON()", selector
    )
    return found


@pytest.mark.slow
def test_the_first_screen_of_a_phone_shows_the_arm(page: Path, driver: Any) -> None:
    """The view began at 470 px, and the page was 6,500 px long; slices were cut."""
    opened(driver, page, **PHONE)
    whole = driver.execute_script("return document.documentElement.scrollHeight")
    assert whole <= 4000
    slices = driver.execute_script(
        "return [...document.querySelectorAll('.maps img')].map((map) => {"
        "const { left, right } = map.getBoundingClientRect(); return [left, right]; })"
    )
    assert len(slices) == 2 and all(0 <= left < right <= 390 for left, right in slices)
    words = driver.execute_script("return document.body.textContent")
    for kept in ("σ_min(J)", "Held-out poses", "@software", "not proved", "Joint speed"):
        assert kept in words, kept
    notes, frame = box(driver, "#notes span"), box(driver, "iframe")
    assert notes["top"] >= frame["bottom"]
    driver.switch_to.frame(driver.find_element("tag name", "iframe"))
    stage = box(driver, "#stage")
    top = frame["top"] + stage["top"]
    assert top < 260 and min(top + stage["height"], 844) - top > 0.45 * 844
    assert errors(driver) == []


@pytest.mark.slow
def test_on_a_wide_screen_the_slices_leave_no_part_empty(page: Path, driver: Any) -> None:
    """Maps stand side by side, and their words beside them where these have room."""
    opened(driver, page, **DESK)
    edges = driver.execute_script(
        "const row = [...document.querySelector('.maps').children].map((e) =>"
        " e.getBoundingClientRect()); const [{ bottom }] = row;"
        "return row.filter(({ top }) => top < bottom).map(({ right }) => right)"
    )
    assert len(edges) > 1 and max(edges) > 1280 * 2 / 3
    frame = box(driver, "iframe")
    assert frame["bottom"] <= 760 < box(driver, "#slices")["bottom"]
    assert driver.execute_script(
        "return [...document.querySelectorAll('section > .fold')].every((fold) => fold.open)"
    )
