"""What a page shows at every size of its window: nothing covers what it is about, and what is
pressed and printed there says what it means."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import errors, open_page, picture_now, schemes, wait_until_drawn

import repctl_pin as rp

pytestmark = pytest.mark.slow

_DRAWN = """
const [done, away] = [arguments[2], arguments[1]], { own } = repctl;
const home = own.chain.homes[0];
own.gesture.grab(0, 7, null, 0);
for (const step of arguments[0]) own.lead.queue.push(home.map((v, c) => v + step[c]));
own.gesture.processQueue();
own.release().then(() => { repctl.viewer.controls.update(); done(away); });
"""

_BOXES = """
repctl.placed();
return Object.fromEntries(Object.entries(arguments[0]).map(([name, css]) => {
  const nodes = [...document.querySelectorAll(css)].filter((node) => node.offsetWidth
    && getComputedStyle(node).visibility !== "hidden");
  return [name, nodes.map((node) => { const { left, top, right, bottom } =
    node.getBoundingClientRect(); return [left, top, right, bottom]; })];
}));
"""

_BALLS = """
repctl.placed();
const { own } = repctl, stage = document.getElementById("panes").getBoundingClientRect();
return own.arms.map((arm, k) => {
  const { left, top } = own.gesture.panes.place(k);
  const { x, y } = own.gesture.panes.seen(k, arm.stop.node.position);
  return [stage.left + left + x, stage.top + top + y];
});
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = rp.animation(rp.study("panda", cycles=10, steps=60, degree=1))
    return made.save(tmp_path_factory.mktemp("room") / "page.html")


def boxes(driver: Any, **css: str) -> dict[str, list[list[float]]]:
    return driver.execute_script(_BOXES, css)


def overlap(one: list[float], other: list[float]) -> float:
    """Area that two boxes (left, top, right, bottom) share, px²."""
    across = min(one[2], other[2]) - max(one[0], other[0])
    return max(across, 0) * max(min(one[3], other[3]) - max(one[1], other[1]), 0)


def draw(driver: Any, *steps: list[float]) -> None:
    """Lead the hand over these places, m from its start, and let go."""
    driver.execute_async_script(_DRAWN, steps, None)


_PAN = """
const [x, y] = arguments, { own, viewer: { camera, controls } } = repctl, { panes } = own.gesture;
const spot = own.arms[0].stop.node.position.clone();
own.leave();
const at = () => { controls.update(); camera.updateMatrixWorld(); return panes.seen(0, spot); };
for (let k = 0; k < 6; k++)
  for (const [i, name, goal] of [[0, "x", x], [4, "y", y]]) {
    const before = at()[name];
    const { elements } = camera.matrixWorld;
    const way = new MeshCat.THREE.Vector3().fromArray(elements, i).multiplyScalar(0.01);
    camera.position.add(way); controls.target.add(way);
    way.multiplyScalar((goal - before) / (at()[name] - before) - 1);
    camera.position.add(way); controls.target.add(way);
  }
const seen = at();
return [seen.x, seen.y];
"""
"""Move the view such that the ball stands at this place of its pane, px, and leave the loop."""


@pytest.mark.parametrize("size", [(1280, 800), (390, 844), (900, 600)])
@pytest.mark.parametrize("turned", [False, True])
def test_the_ball_where_a_loop_cannot_be_followed_is_seen(
    driver: Any, page: Path, size: tuple[int, int], turned: bool
) -> None:
    """The callout that explains it covered it, at the upper edge of the picture."""
    schemes(driver, width=size[0], height=size[1])
    open_page(driver, page)
    if turned:  # to a view that was turned, nothing is fitted
        driver.execute_script("repctl.turn(0, 0, 1)")
    loop = [0, 0.05, 0.2], [0, 0.1, 0.9], [0, 0, 0.2]
    draw(driver, *loop)
    place = [boxes(driver, pane=".pane")["pane"][0][2] - 120, 30]
    assert driver.execute_script(_PAN, *place) == pytest.approx(place, abs=3)
    draw(driver, *loop)
    assert driver.execute_script("return Boolean(repctl.own.scene.failure)")
    notes = boxes(driver, mark=".callout.mark", label=".arm-label")
    assert notes["mark"]
    stage = boxes(driver, stage="#panes")["stage"][0]
    for x, y in driver.execute_script(_BALLS):
        assert stage[0] < x < stage[2] and stage[1] < y < stage[3]
        ball = [x - 10, y - 10, x + 10, y + 10]
        assert [box for box in notes["mark"] if overlap(box, ball)] == []
    assert errors(driver) == []


def test_a_loop_says_once_what_is_checked(driver: Any, page: Path) -> None:
    """It said that collisions are not, as loud as the result, and nothing of limits."""
    schemes(driver, width=1280, height=800)
    open_page(driver, page)
    draw(driver, [0, 0.03, 0.03], [0, 0.06, 0])
    words = driver.execute_script("return document.querySelector('header').textContent")
    assert words.count("Limits are checked, collisions are not.") == 1
    tone, weight, soft = driver.execute_script(
        "const aside = document.querySelector('#verdict .aside'), style = getComputedStyle(aside);"
        "return [style.color, style.fontWeight,"
        " getComputedStyle(document.getElementById('done')).color]"
    )
    assert tone == soft and weight == "400"


def test_notes_of_a_tablet_leave_the_views_side_by_side(driver: Any, page: Path) -> None:
    """They stood beside the views, which then were stacked under one another and the slider."""
    schemes(driver, width=768, height=1024)
    open_page(driver, page)
    draw(driver, [0, 0.03, 0.03], [0, 0.06, 0])
    first = boxes(driver, pane=".pane")["pane"]
    draw(driver, [0, 0.05, 0.2], [0, 0.1, 0.9], [0, 0, 0.2])
    driver.find_element("id", "more").click()
    notes = "return [document.getElementById('more').textContent, document.body.className]"
    told, classes = driver.execute_script(notes)
    assert told == "Fewer notes" and "unfolded" in classes
    driver.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
    one, other = boxes(driver, pane=".pane")["pane"]
    assert one[1] == other[1] and one[3] == other[3] and one[2] <= other[0]
    assert one[2] - one[0] == first[0][2] - first[0][0]
    assert one[3] - one[1] > 0.45 * 1024
    [shown] = boxes(driver, notes="#notes")["notes"]
    assert shown[3] <= one[1]
    assert errors(driver) == []


_DOTTED = """
repctl.seek(arguments[0]);
const chart = document.getElementById("chart"), { width, height } = chart;
const { data } = chart.getContext("2d").getImageData(0, 0, width, height), rows = {};
const color = arguments[1];
for (let y = 0; y < height; y++)
  for (let x = 0; x < width; x++)
    if (color.every((v, c) => data[4 * (y * width + x) + c] === v)) (rows[y] ||= []).push(x);
return Object.values(rows);
"""


def test_bars_that_are_too_thin_to_be_hollow_are_dotted(driver: Any, page: Path) -> None:
    """The legend said "hollow" where bars of one or two pixels looked as those that are full."""
    schemes(driver, width=1280, height=800)
    open_page(driver, page)
    driver.execute_script(
        "window.told = []; const draw = CanvasRenderingContext2D.prototype, { fillText } = draw;"
        "draw.fillText = function (text, ...where) { told.push(text);"
        " fillText.call(this, text, ...where); };"
    )
    color = driver.execute_script("return repctl.own.arms[1].data.color")
    rgb = [int(color[k : k + 2], 16) for k in (1, 3, 5)]

    def runs(time: float) -> np.ndarray:
        """Lengths of the runs of pixels of the repeatable arm's bars, which are hairlines."""
        pixels = [row for row in driver.execute_script(_DOTTED, time, rgb) if len(row) > 20]
        assert pixels
        breaks = np.flatnonzero(np.diff(pixels[0]) > 1)
        return np.diff(np.concatenate([[-1], breaks, [len(pixels[0]) - 1]]))

    assert runs(0).max() <= 2, "all are to come"
    whole = "hollow or dotted bars: cycles to come, computed ahead"  # they were not asked for yet
    assert whole in driver.execute_script("return told.join()")
    assert runs(10).min() > 4, "all are finished"
    driver.execute_script("told.length = 0; repctl.seek(10)")
    assert "to come" not in driver.execute_script("return told.join()")


def test_at_the_end_play_is_replay(driver: Any, page: Path) -> None:
    """While the end is shown first, too: "pause" stood there, and nothing moved."""
    schemes(driver, width=1280, height=800)

    def button() -> tuple[str, list[str]]:
        name, icons = driver.execute_script(
            "const play = document.getElementById('play');"
            "return [play.getAttribute('aria-label'), [...play.querySelectorAll('path')]"
            ".filter((path) => getComputedStyle(path).display !== 'none')"
            ".map((path) => path.getAttribute('class'))]"
        )
        return name, icons

    open_page(driver, page)
    assert button() == ("Replay", ["when-ended"])
    driver.execute_script("repctl.seek(3)")
    assert button() == ("Play", ["when-paused"])
    driver.execute_script("repctl.play()")
    assert button() == ("Pause", ["when-playing"])
    driver.execute_script("repctl.pause(); repctl.seek(10)")
    driver.find_element("id", "play").click()
    assert button() == ("Pause", ["when-playing"])
    assert driver.execute_script("return repctl.time") < 5
    # the opening shows the end; what is pressed then plays from the start
    driver.get("about:blank")
    driver.get(page.as_uri())
    wait_until_drawn(driver, page.name)
    shown = driver.execute_script(
        "repctl.own.clock.open(); const { own: { clock } } = repctl;"
        "const name = document.getElementById('play').getAttribute('aria-label');"
        "document.getElementById('play').click(); return [name, clock.time, clock.playing]"
    )
    assert shown == ["Replay", 0, True]


def test_the_console_is_silent(driver: Any, page: Path) -> None:
    """At each new size, a browser reported a loop of its observer of sizes."""
    schemes(driver, width=1280, height=800)
    open_page(driver, page)
    driver.execute_script(
        "window.found = []; addEventListener('error', ({ message }) => found.push(message))"
    )
    draw(driver, [0, 0.03, 0.03], [0, 0.06, 0])
    frames = "requestAnimationFrame(() => requestAnimationFrame(arguments[0]))"
    for size in ((900, 600), (768, 1024), (390, 844), (320, 640), (1024, 768), (844, 390)):
        schemes(driver, width=size[0], height=size[1])
        driver.execute_async_script(frames)
        for name in ("noted", "more"):
            for _ in range(2):
                driver.execute_script("document.getElementById(arguments[0]).click()", name)
                driver.execute_async_script(frames)
    for name in ("looks", "loops", "save"):
        driver.execute_script("document.getElementById(arguments[0]).open = true", name)
        driver.execute_async_script(frames)
    assert driver.execute_script("return found") == [] and errors(driver) == []


@pytest.mark.parametrize("size", [(900, 600), (1280, 800), (768, 1024), (700, 560)])
@pytest.mark.parametrize("part", ["drag", "hand"])
def test_nothing_stands_on_the_slider(
    driver: Any, page: Path, size: tuple[int, int], part: str
) -> None:
    """ "Drag me" and what is said of the hand, of an arm that is seen from near, too."""
    schemes(driver, width=size[0], height=size[1])
    open_page(driver, page)
    css = {"drag": ".drag-me", "hand": ".callout.hand"}[part]
    assert boxes(driver, words=css)["words"]
    # the hand just above the slider
    for away in (5, 15):
        driver.execute_script(
            "const { own: { gesture: { panes } } } = repctl;"
            "const box = document.getElementById('elbow-box').getBoundingClientRect();"
            "const stage = document.getElementById('panes').getBoundingClientRect();"
            "const { seen } = panes;"
            "panes.seen = (k, p) => { const at = seen.call(panes, k, p);"
            " const home = repctl.own.chain.homes[0];"
            " const hand = seen.call(panes, k, { x: home[0], y: home[1], z: home[2] });"
            " return { x: at.x - hand.x + box.left - stage.left + 180,"
            "  y: at.y - hand.y + box.top - stage.top - arguments[0] }; };"
            "repctl.placed(); panes.seen = seen;",
            away,
        )
        found = driver.execute_script(
            "const box = (node) => { const { left, top, right, bottom } ="
            " node.getBoundingClientRect(); return [left, top, right, bottom]; };"
            "return [box(document.getElementById('elbow-box')),"
            " [...document.querySelectorAll(arguments[0])]"
            " .filter((node) => node.offsetWidth).map(box)]",
            css,
        )
        slider, others = found
        assert others or part == "drag", "these words are left out where there is no room"
        assert [one for one in others if overlap(slider, one)] == [], away
    assert picture_now(driver).size
