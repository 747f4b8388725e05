"""What a page draws, colours and says is of one part, one control and one loop."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import errors, open_page, schemes
from store import study_of
from test_own_loop import said, wait_until_computed

import repctl_pin as rp


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of an arm whose farthest link is not beside its elbow joint."""
    study = study_of("planar7r", 2, 60)
    return rp.animation(study).save(tmp_path_factory.mktemp("story") / "page.html")


_SPOTS = """
const { own: { arms } } = repctl, [ends] = arguments;
const ball = (arm) => arm.traces.children.filter(({ isGroup }) => isGroup).at(-1).position;
return ends.map((time) => {
  repctl.seek(time);
  return arms.map((arm) => [arm.partSpot().toArray(), ball(arm).toArray(), arm.partOff()]);
});
"""


@pytest.mark.slow
def test_the_trace_is_of_the_part_that_is_measured(driver: Any, page: Path) -> None:
    """The elbow was traced while link 5 was measured. The trace ends as far from its start as the
    part in words is off, up to the few corners that are weighed; so it does of one's own loop."""
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    for own in (False, True):
        if own:
            driver.execute_script("repctl.own.preset('circle')")
            wait_until_computed(driver)
        spots = driver.execute_script(_SPOTS, [0, 0.4, 1, 2])
        for arms in spots:
            for spot, ball, _ in arms:
                assert np.allclose(spot, ball, atol=1e-9)
        (start, _, _), (end, _, off) = spots[0][0], spots[-1][0]
        assert off > 1e-3 and 0.8 * off <= np.linalg.norm(np.subtract(end, start)) <= off + 1e-6
        part, told = driver.execute_script(
            "return [repctl.own.scene.part, document.querySelector('.callout b').textContent]"
        )
        assert told.startswith(part) and part.lower() in said(driver).lower()
    assert errors(driver) == []


_COLOURS = """
const css = (what) => [...document.querySelectorAll(what)].map((n) => getComputedStyle(n).color);
return [css("#verdict b"), css(".callout:not(.hand, .mark) b"), css(".reading b")];
"""

_BODIES = """
const slider = document.getElementById("elbow");
slider.value = slider.max;
slider.dispatchEvent(new Event("input", { bubbles: true }));
return repctl.own.arms.map((arm) => {
  const k = arm.off.indexOf(Math.max(...arm.off));
  return arm.moving[k].children[0].material.color.toArray();
});
"""


@pytest.mark.slow
def test_a_control_has_one_colour(driver: Any, page: Path) -> None:
    """The slider painted the repeatable arm orange; the headline's numbers went by their values."""
    open_page(driver, page)
    for dark in (False, True):
        schemes(driver, width=1000, height=700, dark=dark)
        driver.execute_async_script("requestAnimationFrame(() => setTimeout(arguments[0], 50))")
        driver.execute_script("repctl.seek(1.5); repctl.seek(2)")
        headline, callouts, readings = driver.execute_script(_COLOURS)
        assert headline == callouts == readings and len(set(headline)) == 2
    usual, repeatable = driver.execute_script(_BODIES)
    assert usual[0] > usual[2] and repeatable[2] > repeatable[0]
    words = driver.execute_script(
        "document.getElementById('keys').remove(); const titles = [...document.querySelectorAll("
        "'[title]')].map((n) => n.title); return [document.body.innerText, ...titles].join(' ')"
    )
    assert not re.search(r"\bleaf\b|algorithmic|potential", words)
    driver.execute_script("repctl.own.leave()")
    assert errors(driver) == []


@pytest.mark.slow
def test_play_begins_at_once_and_a_loop_keeps_its_values(driver: Any, page: Path) -> None:
    """After the end it stood still for more than a second; while a loop was drawn, its length and
    its plane were not said."""
    schemes(driver, width=1000, height=700)
    open_page(driver, page)
    driver.execute_script("repctl.seek(2); document.getElementById('play').click()")
    assert driver.execute_script("return repctl.time") < 1
    driver.execute_script("repctl.pause()")
    title = driver.find_element("id", "title")
    driver.execute_script(
        "const { gesture } = repctl.own; gesture.grab(0, null, null); const { lead } = gesture;"
        "lead.queue.push(lead.hand.map((v, i) => v + [0.06, 0.03, 0][i]));"
        "gesture.processQueue(); gesture.draw();"
    )
    assert title.text == "planar7r: your loop, 6.7 cm long so far, in xy (horizontal)"
    driver.execute_script("repctl.own.leave(); repctl.own.preset('square')")
    wait_until_computed(driver)
    points = np.array(driver.execute_script("return repctl.own.loops.points"))
    long = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    (value,) = re.findall(r": your loop, ([\d.]+) m long, in xy \(horizontal\)$", title.text)
    assert float(value) == pytest.approx(long, rel=0.05)
    assert errors(driver) == []


@pytest.mark.slow
def test_a_plane_has_a_name(driver: Any, page: Path) -> None:
    """The normal of a loop is that of its points, whatever its shape; an eight has no area."""
    open_page(driver, page)
    rng = np.random.default_rng(3)
    turn = np.linspace(0, 2 * np.pi, 30)
    for normal, words in (
        ([0, 0, 1], "in xy (horizontal)"),
        ([0, -1, 0], "in xz (upright)"),
        ([1, 0, 0], "in yz (upright)"),
        ([3, 4, 0], "upright"),
        ([0, 1, 1], "45° from horizontal"),
        ([3, 0, -4], "37° from horizontal"),
    ):
        axes = np.linalg.svd(np.array([normal], float))[2][1:]
        eight = np.array([np.sin(turn), np.sin(2 * turn) / 2]).T @ axes + rng.normal(size=3)
        asked = "return planeWords(normalOf(arguments[0]))"
        assert driver.execute_script(asked, eight.tolist()) == words


@pytest.mark.slow
def test_paths_are_followed_in_step(driver: Any, page: Path) -> None:
    """One path stays as it is. Several get the corners of all; points that repeat make no NaN."""
    open_page(driver, page)
    square = [[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]]
    third = [[0, 0, 1], [3, 0, 1], [0, 0, 1]]
    asked = "return inStep(arguments[0])"
    assert driver.execute_script(asked, [square, None]) == [square, None]
    one, other, still = driver.execute_script(asked, [square, third, None])
    assert still is None and len(one) == len(other)
    assert np.allclose(one, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]])
    assert np.allclose(other, [[x, 0, 1] for x in (0, 1.5, 3, 1.5, 0)])


_ON_A_PHONE = """
const box = (node) => node.getBoundingClientRect(), chart = box(document.getElementById("chart"));
const menus = ["looks", "loops", "save"].map((name) => {
  const menu = document.getElementById(name);
  menu.open = true;
  const { bottom } = box(menu.lastElementChild);
  menu.open = false;
  return bottom;
});
const below = box(document.getElementById("below"));
const seen = [...document.querySelectorAll("#below > *")].filter((n) => n.offsetHeight &&
  getComputedStyle(n).visibility !== "hidden").map(box);
return [chart.top, menus, below.bottom - Math.max(...seen.map(({ bottom }) => bottom)),
  Math.min(...seen.map(({ top }) => top)) - below.top];
"""


@pytest.mark.slow
@pytest.mark.parametrize("size", [(360, 740), (390, 844)])
def test_on_a_phone_nothing_covers_the_bars_and_no_row_is_empty(
    driver: Any, page: Path, size: tuple[int, int]
) -> None:
    """Menus stood over the bars; the row of buttons was empty while another loop was drawn."""
    open_page(driver, page)
    schemes(driver, width=size[0], height=size[1])
    driver.execute_script("repctl.own.preset('circle')")
    wait_until_computed(driver)
    for grabbed in ("", "repctl.own.gesture.grab(0, null, null); "):
        top, menus, under, over = driver.execute_script(grabbed + _ON_A_PHONE)
        assert max(menus) <= top and max(under, over) < 12, (menus, under, over)
    driver.execute_script("repctl.own.leave()")
    assert errors(driver) == []
