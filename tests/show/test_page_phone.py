"""What a small window shows of a visitor's own loop: why each arm stops, whole titles, bars that
fill their axis, what is proved, and a ring that leaves a small loop to be seen."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import errors, open_page, schemes
from store import study_of
from test_own_loop import _WHAT_OVERLAPS, wait_until_computed

import repctl_pin as rp

pytestmark = pytest.mark.slow

PHONES = [(390, 844), (360, 780)]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    study = study_of("planar7r", 2, 60)
    return rp.animation(study).save(tmp_path_factory.mktemp("phone") / "page.html")


def draw(driver: Any, *corners: tuple[float, float]) -> None:
    """Draw a loop with these corners, in parts of the arm, right of and above the hand."""
    driver.execute_script(
        "const { own } = repctl, { homes: [home], size } = own.chain; own.leave();"
        "own.gesture.grab(0, 7, null, 0); const axes = own.gesture.axes();"
        "for (const corner of arguments[0]) own.lead.queue.push(home.map((v, i) => v"
        " + size * axes.reduce((sum, axis, k) => sum + corner[k] * axis.getComponent(i), 0)));"
        "own.gesture.processQueue(); own.gesture.draw();",
        corners,
    )


def release(driver: Any, cycles: int = 10) -> None:
    driver.execute_script("repctl.own.release()")
    wait_until_computed(driver)
    driver.execute_script(
        "const { clock, report } = repctl.own; clock.seek(arguments[0]); report.say(arguments[0]);"
        "repctl.placed()",
        cycles,
    )


def circle(radius: float) -> list[tuple[float, float]]:
    turn = np.linspace(0, 2 * np.pi, 25)[1:]
    return [(radius * (1 - np.cos(a)), radius * np.sin(a)) for a in turn]


@pytest.mark.parametrize("size", PHONES)
def test_each_arm_that_stops_says_why(driver: Any, page: Path, size: tuple[int, int]) -> None:
    """On a phone, the usual one alone did."""
    schemes(driver, width=size[0], height=size[1])
    open_page(driver, page)
    draw(driver, (-0.1, 0.1), (3, 0.1), (-0.1, -0.1))
    release(driver, 1)
    reasons = driver.execute_script("return repctl.own.scene.failure")
    marks = driver.find_elements("css selector", ".callout.mark")
    assert all(reasons) and len(marks) == 2
    # one arm fails later on the way that it takes instead
    told = [f"cannot follow\n{reasons[0]}", "fails here\nclose to a singularity, in cycle 1"]
    assert [mark.text for mark in marks] == told
    assert driver.execute_script(_WHAT_OVERLAPS) == []
    assert errors(driver) == []


@pytest.mark.parametrize("size", PHONES)
def test_the_title_of_a_loop_is_whole(driver: Any, page: Path, size: tuple[int, int]) -> None:
    """It ended as "59° from horizon…", or "in xy (ho…". The views stay where they are."""
    schemes(driver, width=size[0], height=size[1])
    open_page(driver, page)
    top = "return document.getElementById('stage').getBoundingClientRect().top"
    cut = (
        "return [...document.querySelectorAll('#title, .name')].some((n) =>"
        " n.scrollWidth > n.clientWidth + 1 || getComputedStyle(n).whiteSpace === 'nowrap' &&"
        " n.getBoundingClientRect().right > innerWidth)"
    )
    study = driver.execute_script(top)
    assert not driver.execute_script(cut)
    draw(driver, *circle(0.03))
    title = driver.find_element("id", "title")
    assert title.text.endswith(" long so far, in xy (horizontal)") and not driver.execute_script(
        cut
    )
    assert driver.execute_script(top) == study
    release(driver)
    assert title.text.endswith(" long, in xy (horizontal)") and not driver.execute_script(cut)
    assert title.size["height"] > 30 and driver.execute_script(top) == study
    assert errors(driver) == []


@pytest.fixture
def touched(driver: Any) -> Iterator[None]:
    """A finger is no mouse: what is pressed is larger."""
    name = "Emulation.setTouchEmulationEnabled"
    driver.execute_cdp_cmd(name, {"enabled": True})
    yield
    driver.execute_cdp_cmd(name, {"enabled": False})


_PRESSED = """
const { panes, arms } = repctl.own.gesture;
const box = (id) => document.getElementById(id).getBoundingClientRect();
return arms.map((arm, k) => {
  const { top } = panes.frames[k].getBoundingClientRect();
  const foot = Math.max(...arm.reach().still.map((p) => top + panes.seen(k, p).y));
  return [foot, box(k ? "back" : "elbow-box").top];
});
"""


@pytest.mark.parametrize("far", [0.05, 3])
def test_what_is_pressed_covers_no_base(driver: Any, page: Path, touched: None, far: float) -> None:
    """On a phone that lies, buttons for fingers stood over the base, and over why a loop ends;
    lines and slider took two rows."""
    schemes(driver, width=844, height=390)
    open_page(driver, page)
    draw(driver, *circle(far))
    release(driver, 1)
    for foot, button in driver.execute_script(_PRESSED):
        assert foot + 4 < button
    failed = driver.execute_script("return Boolean(repctl.own.scene.failure)")
    assert failed == (far > 1)
    selector = "#own, #elbow-box, #lines, .callout, .arm-label"
    boxes = driver.execute_script(
        "return [...document.querySelectorAll(arguments[0])].filter((n) => n.offsetWidth &&"
        " getComputedStyle(n).visibility !== 'hidden').map((n) => n.getBoundingClientRect())"
        ".map(({ left, top, right, bottom }) => [left, top, right, bottom])",
        selector,
    )
    for a, b in combinations(boxes, 2):
        assert not (a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]), (a, b)
    assert errors(driver) == []


def test_buttons_of_a_loop_leave_the_base_to_be_seen(driver: Any, page: Path) -> None:
    """On a phone that lies, they stood in two rows over the base of the repeatable arm."""
    schemes(driver, width=844, height=390)
    open_page(driver, page)
    draw(driver, *circle(0.05))
    release(driver, 1)
    base, *tops = driver.execute_script(
        "const { panes } = repctl.own.gesture, { top } = panes.frames[1].getBoundingClientRect();"
        "return [top + panes.seen(1, new MeshCat.THREE.Vector3()).y, ...['again', 'back'].map("
        "(id) => document.getElementById(id).getBoundingClientRect().top)]"
    )
    assert base + 8 < min(tops)
    assert errors(driver) == []


_BARS = """
const { prototype } = CanvasRenderingContext2D, { fillText, fillRect } = prototype;
const words = [], bars = [];
prototype.fillText = function (text, ...at) { words.push(text); fillText.call(this, text, ...at); };
prototype.fillRect = function (...box) { bars.push(box[3]); fillRect.apply(this, box); };
repctl.seek(1); repctl.seek(repctl.own.clock.cycles);
Object.assign(prototype, { fillText, fillRect });
const offs = repctl.own.arms.flatMap(({ data }) => data.off.map(([, off]) => off));
return [words.find((text) => /^\\d+ [cm]*m/.test(text)), bars, offs];
"""


_LEGEND = """
const { prototype } = CanvasRenderingContext2D, { fillText, fillRect } = prototype;
const words = [], bars = [];
prototype.fillText = function (text, x, y) {
  words.push([text, x, y, this.measureText(text).width]);
  fillText.call(this, text, x, y);
};
prototype.fillRect = function (...box) { bars.push(box); fillRect.apply(this, box); };
repctl.own.clock.seek(0.5); repctl.own.clock.seek(1);
Object.assign(prototype, { fillText, fillRect });
return [words, bars, document.getElementById("chart").clientWidth];
"""


@pytest.mark.parametrize("size", [(1280, 760), (844, 390), (390, 844), (320, 640)])
def test_hollow_bars_say_what_they_are(driver: Any, page: Path, size: tuple[int, int]) -> None:
    """Also of a loop that is far too large. The words were cut at 320 px, and where a phone lies,
    they lay over the bars."""
    schemes(driver, width=size[0], height=size[1])
    open_page(driver, page)
    draw(driver, (-0.1, 0.1), (3, 0.1), (-0.1, -0.1))
    release(driver, 1)
    assert driver.execute_script("return Boolean(repctl.own.scene.failure)")
    words, bars, width = driver.execute_script(_LEGEND)
    legend, x, y, wide = next(one for one in words if " · " in str(one[0]))
    coming = re.search(r"(hollow|dotted)( bars: cycles)?(:)? to come", legend)
    assert coming and x + wide < width, (legend, wide, width)
    assert coming[2] or size[0] < 360  # in words, where there is room
    tops = [top for left, top, *_ in bars if left < x + wide]
    assert tops and min(tops) > y - 1
    assert errors(driver) == []


def test_the_bars_end_at_the_next_step(driver: Any, page: Path) -> None:
    """Bars of 4 mm stood on an axis of 5 cm. It ends at the next step of 1, 2 or 5 above the
    largest of them, of a study and of a loop; a zero is a hairline."""
    schemes(driver, width=390, height=844)
    open_page(driver, page)
    for radius in (0, 0.02, 0.005):
        if radius:
            draw(driver, *circle(radius))
            release(driver)
        label, bars, offs = driver.execute_script(_BARS)
        number, unit = label.split()[:2]
        top = float(number) * {"m": 1, "cm": 1e-2, "mm": 1e-3}[unit]
        steps = [k * 10.0**e for e in range(-3, 1) for k in (1, 2, 5)]
        assert top == pytest.approx(min(s for s in steps if s >= max(offs) * 0.9999))
        assert min(offs) < 1e-4 and min(bars) == 1
        # above a zero and below the largest: in parts of the axis
        assert max(bars) > 15 * max(offs) / top
    assert max(offs) < 0.01 and errors(driver) == []


def test_what_is_proved_is_in_sight(driver: Any, page: Path) -> None:
    """It stood behind "All notes" and "Notes". It is a clause of the sentence where the note is not
    seen; nothing moves for it, and of a loop that is proved, it is whole on every phone. Of a loop
    far beyond it, nothing is said: "proved within 1.6 mm" stood beside one of decimetres."""
    open_page(driver, page)
    clauses = []
    for share in (0.5, 1.5, 6):
        schemes(driver, width=1280, height=800)
        proved, size = driver.execute_script(
            "const { chain } = repctl.own; return [chain.proved, chain.size]"
        )
        draw(driver, *circle(share * proved / size / 2))
        release(driver)
        if share == 6:
            assert driver.find_elements("css selector", ".proof") == []
            assert "rove" not in driver.find_element("tag name", "header").text
            break
        note = driver.find_element("xpath", "//*[@id='notes']/*[contains(., 'Proved: ')]")
        clause = driver.find_element("css selector", ".proof")
        assert note.is_displayed() and not clause.is_displayed()
        schemes(driver, width=640, height=1000)
        driver.execute_async_script("requestAnimationFrame(() => setTimeout(arguments[0]))")
        clause = driver.find_element("css selector", ".proof")
        assert not note.is_displayed() and clause.is_displayed()
        clauses.append(clause.text)
        for width in (640, 430, 390, 360, 320):
            schemes(driver, width=width, height=844)
            driver.execute_async_script("requestAnimationFrame(() => setTimeout(arguments[0]))")
            verdict, head = driver.execute_script(
                "return ['verdict', 'stage'].map((id) => document.getElementById(id)"
                ".getBoundingClientRect()).map(({ top, bottom }, k) => k ? top : bottom)"
            )
            assert verdict <= head + 1
            assert share > 1 or driver.find_element("css selector", ".proof").is_displayed()
    far = f"{100 * proved:.2g} cm"
    proof = "The repeatable arm’s return is proved"
    assert clauses == [f"{proof}.", f"{proof} within {far} of the start; this loop goes farther."]
    dialog = driver.execute_script("return document.getElementById('keys').textContent")
    assert f"every loop that stays within {far} of where the hand starts, the closing" in dialog
    assert errors(driver) == []


_RINGS = """
repctl.placed();
return [...document.querySelectorAll(".ring")].map((ring) => {
  const { borderTopWidth, inset, transform } = getComputedStyle(ring, "::before");
  const scale = transform === "none" ? 1 : new DOMMatrix(transform).a;
  const across = ring.offsetWidth - 2 * parseFloat(inset);
  return [ring.offsetWidth, scale * across, scale * parseFloat(borderTopWidth)];
});
"""


def test_a_ring_leaves_a_small_loop_to_be_seen(driver: Any, page: Path) -> None:
    """It covered half of one. It is as large to be touched, and as before over a large loop."""
    schemes(driver, width=1280, height=800)
    open_page(driver, page)
    for radius, small in ((0.01, True), (0.1, False)):
        draw(driver, *circle(radius))
        release(driver)
        for touched, seen, line in driver.execute_script(_RINGS):
            assert touched >= 44
            assert (seen < 18 and line <= 2) if small else (seen > 26 and line >= 3)
    assert errors(driver) == []


def test_window_and_animation_are_named_after_the_loop(driver: Any, page: Path) -> None:
    """Both kept the name of the study."""
    schemes(driver, width=1280, height=800)
    open_page(driver, page)
    asked = (
        "return [document.title, document.getElementById('title').textContent,"
        " document.getElementById('panes').getAttribute('aria-label')]"
    )
    study = driver.execute_script(asked)
    draw(driver, *circle(0.05))
    release(driver)
    window, title, label = driver.execute_script(asked)
    assert window == title and ": your loop, " in title and title in label
    assert study[1] not in label
    driver.execute_script("repctl.own.leave()")
    assert driver.execute_script(asked) == study and study[0] == study[1]
    assert errors(driver) == []


def test_a_joint_beyond_its_drawn_rail_is_named(
    driver: Any, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The rails of the ppr arm are drawn from -3.04 m to 3.04 m and from -2.54 m to 2.54 m, its
    joints go from -6 m to 6 m: links were seen to move beside the rails, and nothing said why."""
    arm = rp.animation(study_of("ppr", 2, 60))
    page = arm.save(tmp_path_factory.mktemp("rails") / "page.html")
    schemes(driver, width=1280, height=800)
    open_page(driver, page)
    rails = driver.execute_script("return repctl.own.chain.rails")
    assert np.allclose(rails[:2], [[-3.04, 3.04], [-2.54, 2.54]]) and rails[2] is None
    for radius, said in ((0.3, False), (3.5, True)):
        draw(driver, *circle(radius))
        release(driver, 1)
        notes = driver.execute_script("return document.getElementById('notes').textContent")
        words = "d1 and d2 go beyond their rails, which are drawn shorter than their ranges."
        assert (words in notes) == said
    assert errors(driver) == []
