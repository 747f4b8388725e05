"""The page of a function over a sector, as its reader sees it: real rectangles in a browser."""

from __future__ import annotations

import base64
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from browser import asleep, errors, only_pictures_asked_for, schemes, wait_until_drawn
from commands import main
from PIL import Image
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys
from test_own_loop import wait_until_computed

import repctl_pin as rp

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


_TALL = """
const { own } = repctl, { chain } = own;
chain.place(chain.start, chain.all);
return own.arms.map((_, k) => {
  const points = [[0, 0, 0], ...chain.places.map(({ p }) => [...p]), chain.homes[0]];
  const rows = points.map((p) => own.piece.seen(k, p).y);
  return Math.max(...rows) - Math.min(...rows); });
"""
"""How tall an arm is, from the base over its joints to the hand, px."""


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
    brief = driver.find_element("id", "brief")  # they stood a screen below
    assert brief.is_displayed() and box(driver, "#brief")["bottom"] <= frame["top"]
    assert "at worst +" in brief.text and brief.text.endswith("Tested, not proved.")
    driver.switch_to.frame(driver.find_element("tag name", "iframe"))
    stage = box(driver, "#stage")
    assert box(driver, "#legend")["top"] >= box(driver, "#panes")["bottom"]  # it covers no arm
    top = frame["top"] + stage["top"]
    assert top < 260 and min(top + stage["height"], 844) - top > 0.6 * 844
    assert frame["height"] == pytest.approx(844 - 12)  # all of it in one window
    assert min(driver.execute_script(_TALL)) > 130  # px; it was 110, and 65 in a whole table
    bars, chart = box(driver, "#bars"), box(driver, "#chart")
    assert bars["bottom"] <= chart["top"] + 1 and 0 <= bars["left"] < bars["right"] <= 374
    words = driver.find_element("id", "bars").text.split("\n")
    assert " ".join(words) == "Farthest part from its start Usual control One function"
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


@pytest.mark.slow
def test_an_open_menu_closes_where_something_else_is_pressed(page: Path, driver: Any) -> None:
    """Also in the page around it: it hid the bars until its own button was pressed again."""
    opened(driver, page, **PHONE)
    driver.execute_script("document.querySelector('iframe').scrollIntoView()")
    open_ = "return document.getElementById('looks').open"
    for beside in ("#chart", "#picture canvas", "#bars", None):
        driver.switch_to.frame(driver.find_element("tag name", "iframe"))
        driver.find_element("css selector", "#looks summary").click()
        assert driver.execute_script(open_)
        # where the menu does not cover it
        if beside:
            target = driver.find_element("css selector", beside)
            x, y = (target.rect[side] / 2 - 4 for side in ("width", "height"))
            ActionChains(driver).move_to_element_with_offset(target, x, -y).click().perform()
        driver.switch_to.default_content()
        if not beside:
            driver.execute_script("scrollTo(0, 0)")
            driver.find_element("id", "verdict").click()
        driver.switch_to.frame(driver.find_element("tag name", "iframe"))
        assert not driver.execute_script(open_), beside
        driver.switch_to.default_content()


@pytest.mark.slow
def test_poses_that_f_does_not_cover_are_veiled(tmp_path: Path, driver: Any) -> None:
    """A pale grey on light paper, a dark one on dark paper, where it glared."""
    ranges = ["--radius", "0.3", "--height", "0.3", "--angle", "0.3"]
    options = ["--degree", "1", "--held-out", "64", "--keep", "--out", str(tmp_path)]
    assert main(["cell", "panda", "--sector", *ranges, *options]) == 0
    file = tmp_path / "cell.html"
    text = file.read_text("utf-8")
    (share,) = re.findall(r"One function covers ([\d.]+)", text)
    assert float(share) < 99
    F, masks = rp.load_cell(tmp_path / "cell.json").function, []
    for around, data in re.findall(
        r'--around: polygon\(evenodd,(.*?)\)"><img src="data:image/png;base64,(.*?)"', text
    ):
        pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGBA"))
        veiled = (pixels[..., 3] > 0) & (pixels[..., 3] < 255)
        # F has no value at these radii and heights, which begin below on the left
        corners = [one.replace("%", "").split() for one in around.split(",")]
        low, high = np.array([corners[5], corners[7]], float) / 100 * veiled.shape[::-1]
        assert 0.03 < veiled.sum() / np.prod(high - low) < 0.2
        y, x = np.nonzero(veiled)
        u, v = ((2 * np.stack([x, y], axis=1) + 1 - low - high) / (high - low)).T
        step = 2 / 32  # of the grid of poses: a square of it is veiled where one corner is
        sides = [step * np.array(sign) for sign in ((1, 0, 1), (1, 0, -1), (-1, 0, 1), (-1, 0, -1))]
        U = np.stack([u, 0 * u, -v], axis=1)
        near = [F.batch((U + side).clip(-1, 1), missing="nan")[:, 0] for side in sides]
        assert np.isnan(near).any(axis=0).mean() > 0.99
        assert veiled[int(low[1]) + 5, int(high[0]) - 5]  # far and high
        masks.append(veiled)
    assert len(masks) == 2
    file.write_text(re.sub(' srcdoc="[^"]*"', "", text), "utf-8")
    for dark in (False, True):
        schemes(driver, width=1600, height=900, dark=dark)
        driver.get(file.as_uri())
        for k, mask in enumerate(masks):
            node = driver.find_elements("css selector", ".maps .drawn")[k]
            shot = Image.open(io.BytesIO(node.screenshot_as_png)).convert("RGB")
            found = Image.fromarray(mask).resize(shot.size)
            veil = np.median(np.asarray(shot)[np.asarray(found)], axis=0)
            paper = driver.execute_script(
                "return getComputedStyle(document.body).backgroundColor.match(/\\d+/g).map(Number)"
            )
            assert 1.2 < contrast(veil, paper) < 1.6, (veil, paper)


def contrast(one: Any, other: Any) -> float:
    """The contrast of two colours, 0 to 255, as WCAG 2 measures it."""

    def light(colour: Any) -> float:
        v = np.asarray(colour) / 255
        return float(
            np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
            @ (0.2126, 0.7152, 0.0722)
        )

    low, high = sorted([light(one), light(other)])
    return (high + 0.05) / (low + 0.05)


@pytest.mark.slow
def test_where_f_ends_is_seen_while_a_hand_is_led(page: Path, driver: Any) -> None:
    """A line at the hand's height, on the edges of the sector; it was not drawn."""
    opened(driver, page, **DESK)
    driver.switch_to.frame(driver.find_element("tag name", "iframe"))
    ring = driver.find_element("css selector", ".ring")
    for key in (2 * [Keys.ARROW_UP], [Keys.ARROW_RIGHT]):
        ring.send_keys(*key)
    found = driver.execute_script(
        "const { gesture, lead, scene } = repctl.own; gesture.processQueue(); gesture.draw();"
        "const { positions } = lead.marks.panes[1].edge;"
        "return [repctl.own.piece.drawn(lead.hand).toArray(), [...positions.array], scene.cover]"
    )
    hand, line, cover = np.array(found[0]), np.reshape(found[1], (-1, 3)), found[2]
    assert np.abs(line[:, 2] - hand[2]).max() < 1e-4
    inner, outer = (np.array(cover[side])[:, :2] for side in ("inner", "outer"))
    radii = np.linalg.norm(line[:, :2], axis=1)
    assert radii.min() == pytest.approx(np.linalg.norm(inner[0]), abs=2e-3)
    assert radii.max() == pytest.approx(np.linalg.norm(outer[0]), abs=2e-3)
    gaps = np.linalg.norm(np.roll(line, -1, axis=0) - line, axis=1)
    assert gaps.max() < 2.5 * np.median(gaps)  # one closed line
    words = driver.find_element("css selector", "#legend .edge")
    assert words.is_displayed() and "edge of F" in words.text
    ring.send_keys(Keys.ESCAPE)
    assert not words.is_displayed()


@pytest.mark.slow
def test_angle_and_spin_are_drawn_as_arcs(page: Path, driver: Any) -> None:
    """With the degrees of the sentence, and a needle where the hand is; the dials stood still."""
    opened(driver, page, **PHONE)
    sentence = driver.find_element("id", "verdict").text
    turns = re.findall(r"(\d+)°", sentence)
    driver.switch_to.frame(driver.find_element("tag name", "iframe"))
    arcs = driver.execute_script(
        "return [...document.querySelectorAll('.dial')].map((dial) =>"
        "[dial.querySelector('[pathLength]').getAttribute('stroke-dasharray'),"
        " dial.parentElement.textContent, dial.getBoundingClientRect().width])"
    )
    assert [arc[0] for arc in arcs] == [f"{turn} 360" for turn in turns]
    assert [re.sub(r"−?\d+", "0", arc[1]) for arc in arcs] == ["angle 0°", "spin 0°"]
    assert all(arc[2] > 15 for arc in arcs)


def shown_place(driver: Any) -> dict[str, float]:
    """What the legend says of the hand, in m and degrees, by name."""
    words: list[list[str]] = driver.execute_script(
        "return [...document.querySelectorAll('#legend b')].map(({ id, textContent }) =>"
        "[id.slice(4), textContent])"
    )
    return {name: float(text.replace("−", "-").rstrip(" m°")) for name, text in words}


@pytest.mark.slow
def test_the_end_of_a_range_of_angle_or_spin_has_a_colour(page: Path, driver: Any) -> None:
    """A hand stood well inside the edge of F, with the spin at its end, and nothing said so."""
    opened(driver, page, **DESK)
    driver.switch_to.frame(driver.find_element("tag name", "iframe"))
    driver.execute_script("repctl.seek(0)")
    ring = driver.find_element("css selector", ".ring")
    seen = set()
    for _ in range(12):
        ring.send_keys(*8 * [Keys.ARROW_LEFT])
        for range_, text, near in driver.execute_script(
            "repctl.own.gesture.processQueue(); repctl.own.gesture.draw();"
            "return [...document.querySelectorAll('.dial')].map((dial) =>"
            "[parseFloat(dial.querySelector('[pathLength]').getAttribute('stroke-dasharray')),"
            " dial.parentElement.querySelector('b').textContent,"
            " Boolean(dial.parentElement.querySelector('.near'))])"
        ):
            left = range_ / 2 - abs(float(text.replace("−", "-").rstrip("°")))
            assert near == (range_ < 360 and left < 3) or abs(left - 3) < 1
            seen.add(near)
    assert seen == {False, True}
    ring.send_keys(Keys.ESCAPE)


@pytest.mark.slow
def test_the_legend_says_where_the_hand_is(page: Path, driver: Any) -> None:
    """Also while it is led, and as the sector has it: the tool is held, so spin follows angle."""
    opened(driver, page, **DESK)
    driver.switch_to.frame(driver.find_element("tag name", "iframe"))
    driver.execute_script("repctl.seek(0)")
    before = shown_place(driver)
    ring = driver.find_element("css selector", ".ring")
    ring.send_keys(*8 * [Keys.ARROW_RIGHT])
    hand, q = driver.execute_script(
        "const { gesture, lead } = repctl.own; gesture.processQueue(); gesture.draw();"
        "return [lead.hand, [...lead.qs.at(-1)]]"
    )
    found = shown_place(driver)
    cell = rp.load_cell(page.with_name("cell.json")).cell
    assert isinstance(cell, rp.Sector)
    middle, (outward, across, up) = cell.placement.rotation, cell.directions
    x, y, z = (e @ (np.array(hand) - cell.axis[0]) for e in (outward, across, up))
    angle = np.arctan2(y, x)
    # R = R_a(φ) R_0 R_z(ψ)
    turned = middle.T @ pin.exp3(-angle * up) @ cell.task.placement(np.array(q)).rotation
    assert found["radius"] == pytest.approx(np.hypot(x, y), abs=0.006)
    assert found["height"] == pytest.approx(z + cell.axis[0] @ up, abs=0.006)
    assert found["angle"] == pytest.approx(np.degrees(angle), abs=0.6)
    assert found["spin"] == pytest.approx(np.degrees(np.arctan2(*turned[[1, 0], 0])), abs=0.6)
    assert abs(found["angle"] - before["angle"]) > 2


@pytest.mark.slow
def test_of_many_cycles_two_leave_traces(page: Path, driver: Any) -> None:
    """The first and the last whole one: those of ten were a tangle."""
    opened(driver, page, **DESK)
    driver.switch_to.frame(driver.find_element("tag name", "iframe"))
    drawn = driver.execute_script(
        "const { children } = repctl.own.arms[0].traces;"
        "const trace = children.find((mesh) => mesh.geometry?.groups.length);"
        "return [0.5, 1.25, 6.5].map((time) => { repctl.seek(time);"
        "return trace.geometry.groups.map(({ start, count }) => [start, count]); })"
    )
    whole = drawn[1][0][1]
    assert [len(groups) for groups in drawn] == [1, 2, 2]
    assert drawn[0] == [[0, pytest.approx(whole / 2, rel=0.02)]]
    assert drawn[1][1] == [whole, pytest.approx(whole / 4, rel=0.05)]
    assert drawn[2] == [[0, whole], [pytest.approx(5.5 * whole, rel=0.01), whole]]


@pytest.mark.slow
@pytest.mark.parametrize("rise", [0.0, 0.06])
def test_a_loop_beyond_f_is_told_the_range_that_ends_it(
    page: Path, driver: Any, rise: float
) -> None:
    """The ball looked well inside the pale shape: no radius, height or angle was named. Of a loop
    that goes farthest out at another height, at which F has another range, no radius is told."""
    opened(driver, page, **DESK)
    driver.switch_to.frame(driver.find_element("tag name", "iframe"))
    cell = rp.load_cell(page.with_name("cell.json")).cell
    assert isinstance(cell, rp.Sector)
    (low, high), floor = cell.radii([cell.middle[1]])[0], cell.axis[0] @ cell.directions[2]
    lean = 0.3  # of both sides, outward
    driver.set_script_timeout(90)
    told = driver.execute_async_script(
        "const [radius, height, rise, lean, done] = arguments, { own } = repctl;"
        "const { sector } = own.laws.at(-1).parts[0], { origin, axes } = sector;"
        "sector.bend = [0, lean];"
        "const at = (r, z) => origin.map((v, i) => v + r * axes[0][i] + z * axes[2][i]);"
        "own.gesture.grab(0, 7, null, 0);"
        "own.lead.queue.push(at(radius, height), at(radius + 0.4, height + rise));"
        "own.gesture.processQueue(); own.release().then(() =>"
        " done(document.getElementById('verdict').textContent))",
        *(float((low + high) / 2), float(cell.middle[1]), rise, lean),
    )
    found = re.match(
        r"F ends after the first .* of your loop, at the red ball: it covers radius (.*) to (.*) m "
        r"at height (\S*) m(?:, your loop goes to (\S*) m)?\. Both arms follow the solid line, ",
        told.replace("\u00a0", " "),
    )
    assert found, told
    *ends, height = (float(v.replace("−", "-")) for v in found.groups()[:3])
    above = height - floor - cell.middle[1]
    assert -0.006 <= above < max(rise / 2, 0.006)
    low, high = low + lean * above, high + lean * above
    assert ends == pytest.approx([low, high], abs=0.011)
    assert low <= ends[0] + 3e-3 and ends[1] <= high + 3e-3
    if rise:
        assert found[4] is None
    else:
        assert float(found[4]) == pytest.approx((low + high) / 2 + 0.4, abs=0.006)
    assert told.endswith(" Limits are checked, collisions are not.")
    # the ball is F's alone, which ends at the line around what it covers there
    stops, line, ball = driver.execute_script(
        "const { arms } = repctl.own, [, { paths, stop }] = arms;"
        "const { geometry } = paths.children.find(({ isLineLoop }) => isLineLoop);"
        "return [arms.map((arm) => Boolean(arm.stop)), [...geometry.attributes.position.array],"
        " stop.node.position.toArray()]"
    )
    assert stops == [False, True]
    assert np.reshape(line, (-1, 3))[:, 2] == pytest.approx(ball[2], abs=1e-4)
    words = driver.find_element("css selector", "#lines span:last-child")
    assert words.is_displayed() and words.text == "edge of F"


_LABELS = """
const { own: { arms, gesture: { panes } } } = repctl, { camera } = panes.viewer, found = [];
arms.forEach(({ group }, k) => group.traverse((node) => {
  if (!node.isSprite) return;
  node.updateWorldMatrix(true, false);
  for (const side of [-0.36, 0.36]) { // of the canvas, as wide as the text is
    const p = new MeshCat.THREE.Vector3().setFromMatrixPosition(node.matrixWorld);
    const right = new MeshCat.THREE.Vector3().fromArray(camera.matrixWorld.elements);
    p.addScaledVector(right, side * node.scale.x).project(camera);
    found.push([(p.x + 1) / 2, (1 - p.y) / 2]);
  }
}));
return found;
"""


@pytest.mark.slow
def test_the_degrees_on_the_ground_are_whole(page: Path, driver: Any) -> None:
    """On a tablet, "360°" was cut by the edge of each pane."""
    opened(driver, page, width=768, height=1024)
    schemes(driver, width=660, height=1000)
    driver.switch_to.frame(driver.find_element("tag name", "iframe"))
    # seen from a side, so that one end of the angle is at the rim of the picture
    for side in (-1, 1):
        driver.execute_script(
            "const { eye } = repctl.own.gesture.panes;"
            "const up = new MeshCat.THREE.Vector3(0, 0, 1);"
            "eye.out.set(0, 0.95 * arguments[0], 0.7).normalize();"
            "eye.right.crossVectors(up, eye.out).normalize();"
            "eye.up.crossVectors(eye.out, eye.right);"
            "document.getElementById('view').click(); repctl.placed()",
            side,
        )
        found = np.array(driver.execute_script(_LABELS))
        assert len(found) >= 4 and (found > 0).all() and (found < 1).all()


_WORDS_AND_BARS = """
const { prototype } = CanvasRenderingContext2D, { fillText, fillRect } = prototype;
const words = [], tops = [];
prototype.fillText = function (text, x, y) { words.push([text, y]); };
prototype.fillRect = function (x, y) { tops.push(y); };
repctl.seek(arguments[0]);
Object.assign(prototype, { fillText, fillRect });
return [words.filter(([text]) => /^\\d+ [cm]*m/.test(text)), Math.min(...tops)];
"""


@pytest.mark.slow
@pytest.mark.parametrize("size", [(390, 844), (768, 1024), (1280, 760)])
def test_no_words_lie_over_the_bars(page: Path, driver: Any, size: tuple[int, int]) -> None:
    """Those of the axis lay over the first three."""
    opened(driver, page, width=size[0], height=size[1])
    driver.switch_to.frame(driver.find_element("tag name", "iframe"))
    for time in (10, 0):
        [[text, y]], top = driver.execute_script(_WORDS_AND_BARS, time)
        assert y < top and ("to come" in text) == (not time)


@pytest.mark.slow
def test_the_arms_of_a_cell_have_one_name(page: Path, driver: Any) -> None:
    """ "from the repeatable arm" stood beside a pane called "One function"; and the path of the
    hand was grey in the legend, in the colours of both arms in the panes."""
    opened(driver, page, **DESK)
    driver.switch_to.frame(driver.find_element("tag name", "iframe"))
    colours = driver.execute_script("return repctl.own.arms.map(({ data }) => data.color)")
    image = driver.execute_script(
        "return getComputedStyle(document.querySelector('#legend .way')).borderImageSource"
    )
    assert [tuple(map(int, rgb)) for rgb in re.findall(r"rgb\((\d+), (\d+), (\d+)\)", image)] == [
        tuple(int(colour[k : k + 2], 16) for k in (1, 3, 5)) for colour in colours
    ]
    ring = driver.find_element("css selector", ".ring")
    ring.send_keys(*4 * [Keys.ARROW_LEFT])
    driver.execute_script("repctl.own.gesture.processQueue(); repctl.own.gesture.draw()")
    notes = [node.text for node in driver.find_elements("css selector", ".callout small")]
    assert "from the arm of One function" in notes and "from the repeatable arm" not in notes
    ring.send_keys(Keys.ESCAPE)


@pytest.mark.slow
@pytest.mark.parametrize("size", [(768, 1024), (1024, 768), (844, 1100)])
def test_on_a_touch_tablet_values_and_words_cover_no_button(
    page: Path, driver: Any, size: tuple[int, int]
) -> None:
    """The values lay over "Once more", whose buttons are taller where a finger presses them; what
    the bars are ran into the readings."""
    touch = "Emulation.setTouchEmulationEnabled"
    driver.execute_cdp_cmd(touch, {"enabled": True, "maxTouchPoints": 1})
    try:
        opened(driver, page, width=size[0], height=size[1])
        driver.switch_to.frame(driver.find_element("tag name", "iframe"))
        driver.execute_script("repctl.own.preset('circle')")
        wait_until_computed(driver)
        driver.execute_async_script("requestAnimationFrame(() => setTimeout(arguments[0]))")
        values = box(driver, "#legend")
        again, back = box(driver, "#again"), box(driver, "#back")
        assert again["height"] >= 44 and back["width"] and values["height"]
        assert values["bottom"] <= min(again["top"], back["top"])
        assert box(driver, "#bars")["height"] and driver.execute_script(
            "const { right } = [...document.querySelectorAll('#bars > span:not(.sign)')].at(-1)"
            ".getBoundingClientRect(), { left, top } = document.getElementById('readings')"
            ".getBoundingClientRect(), { bottom } = document.getElementById('bars')"
            ".getBoundingClientRect(); return right < left || bottom <= top"
        )
        assert errors(driver) == []
    finally:
        driver.execute_cdp_cmd(touch, {"enabled": False})
