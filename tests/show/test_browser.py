"""The page in a real browser: headless Chromium, offline."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import (
    asleep,
    changed,
    errors,
    open_page,
    pane,
    picture,
    picture_now,
    schemes,
    wait_until_drawn,
)
from controls import some
from numpy.typing import ArrayLike, NDArray
from page_file import Drawn, circling, read

import repctl_pin as rp

ROOT = Path(__file__).parents[2]
FOUR = [1.6, -1.6, -0.1, 1.4]
"""A start of four links."""

SHOWN = ("panda", "baxter", "tiago", "talos", "kinova", "planar7r", "my_arm", "xarm7 bare")
"""Robots whose pages are looked at, beside the planar one with two sliding joints."""


def on_a_circle(robot: rp.Robot, q0: ArrayLike, other: str = "repeatable") -> dict[str, rp.Motion]:
    """J⁺ for two cycles of 60 steps, and beside it a control that closes."""
    task = robot.task(kind="xy")
    motions = circling(task, q0, radius=0.1, steps=60, other=other)
    assert motions[other].drift[-1] < 1e-6 < 1e-4 < motions["J⁺"].drift[-1]
    return motions


def write(folder: Path, motions: dict[str, rp.Motion]) -> Path:
    return rp.animation(motions).save(folder / "animation.html")


def shapes_of(page: Path) -> list[str]:
    """The names of the bodies that the file of a page holds, of each arm."""
    scene, _, _ = read(page.read_text(encoding="utf-8"))
    return [shape["name"] for shape in scene["arms"][0]["shapes"]]


def motions_of(study: rp.Study) -> list[rp.Motion]:
    return [study.row(key).motion for key in ("pseudoinverse", "repeatable")]


def with_meshes(folder: Path) -> rp.Robot:
    """A planar arm, its links given by small meshes."""
    import trimesh

    text = (ROOT / "urdf" / "planar3r.urdf").read_text(encoding="utf-8")
    for size in re.findall(r'<box size="([^"]*)"/>', text):
        file = f"link{size.replace(' ', '_')}.stl"
        trimesh.creation.box([float(v) for v in size.split()]).export(folder / file)
        text = text.replace(f'<box size="{size}"/>', f'<mesh filename="{file}"/>')
    (folder / "arm.urdf").write_text(text, encoding="utf-8")
    return rp.Robot.load(folder / "arm.urdf")


@pytest.mark.parametrize("name", ["small", pytest.param("panda", marks=pytest.mark.slow)])
def test_the_page_of_a_study_shows_who_comes_back(driver: Any, tmp_path: Path, name: str) -> None:
    """The main job's own page: both arms, moving; after a cycle the repeatable one is back, J⁺'s is
    not. Of a small arm by default: a panda's meshes take ten times as long to draw."""
    wanted = rp.Problem(with_meshes(tmp_path), path="circle:0.8", start=[0.3, 0.8, 0.8])
    study, page = (
        rp.study("panda" if name == "panda" else wanted, cycles=3, steps=60, degree=1),
        tmp_path / "animation.html",
    )
    page.write_text(rp.animation(study).page, encoding="utf-8")
    motions = motions_of(study)
    assert motions[0].drift[-1] > 0.1 and motions[1].drift[-1] < 1e-6
    open_page(driver, page)
    drawn = Drawn(study.robot)
    assert (
        driver.execute_script("return [repctl.meshes(0), repctl.meshes(1)]")
        == [len(drawn.names)] * 2
    )
    ghosts_show_drift_and_nothing_else(driver, motions, (2.5,))
    start, quarter, three = (picture(driver, c, ghost=False) for c in (0, 0.25, 3))
    for arm in (0, 1):
        a, b = pane(driver, start, arm), pane(driver, quarter, arm)
        assert np.ptp(a) > 150, "nothing is drawn"
        assert changed(a, b) > 0.01
    assert changed(pane(driver, start, 1), pane(driver, three, 1)) < 0.001
    assert changed(pane(driver, start, 0), pane(driver, three, 0)) > 0.01
    # with its traces shown, what the arm left behind is seen
    left = picture(driver, 3, traces=True, ghost=False)
    assert changed(pane(driver, three, 1), pane(driver, left, 1)) > 0.002
    # the browser's own matrices are where the motion put the shapes, half a cycle into the second
    driver.execute_script("repctl.seek(1.5)")
    for k, motion in enumerate(motions):
        expected = drawn.placements(study.task.to_robot(motion.q[[90]]))[0]
        for s in (0, len(drawn.names) // 2, len(drawn.names) - 1):
            told = driver.execute_script(
                "return repctl.placement(arguments[0], arguments[1])", k, drawn.names[s]
            )
            np.testing.assert_allclose(np.reshape(told, (4, 4)).T, expected[s], atol=1e-5)
    the_colour_is_how_far_a_body_is_off_its_start(driver, study, drawn)
    bodies_of_one_mesh_look_as_bodies_one_by_one(driver)
    assert errors(driver) == []


def bodies_of_one_mesh_look_as_bodies_one_by_one(driver: Any) -> None:
    """And take one call of WebGL in a pane, but for those that are outlined."""
    joined = picture(driver, 2.5, traces=True)
    calls, single, outlined = driver.execute_script(
        "const { own, viewer, placed } = repctl, { render } = viewer.renderer.info;"
        "placed(); const joined = render.calls, { rims } = own.arms.at(-1);"
        "for (const arm of own.arms) for (const mesh of arm.meshes) mesh.visible = true;"
        "placed(); return [joined, render.calls, rims.length]"
    )
    bodies = driver.execute_script("return repctl.meshes(1)")
    assert single - calls == bodies - outlined - 1 > 1
    assert changed(joined, picture_now(driver)) < 2e-4


def the_colour_is_how_far_a_body_is_off_its_start(
    driver: Any, study: rp.Study, drawn: Drawn
) -> None:
    """Told by all points of the meshes and Pinocchio's placements; the hand itself is always
    back."""
    whole = study.task.to_robot
    motions = motions_of(study)
    off = np.array([drawn.moved(*whole(motion.q[[0, -1]])) for motion in motions])
    moving = drawn.moved(*whole(motions[0].q[[0, 15]])) > 0
    assert moving.sum() >= 3 and off[0].max() > 0.08

    def told(time: float) -> tuple[NDArray[np.float64], list[list[NDArray[np.int64]]]]:
        answers = driver.execute_script(
            "const [time, names] = arguments; repctl.seek(time);"
            "return [0, 1].map((arm) => names.map((name) => repctl.drift(arm, name)))",
            time,
            np.array(drawn.names)[moving].tolist(),
        )
        colours = [
            [np.array([int(c[k : k + 2], 16) for k in (1, 3, 5)]) for _, c in row]
            for row in answers
        ]
        return np.array([[d for d, _ in row] for row in answers]), colours

    at_start, plain = told(0)
    at_end, painted = told(3)
    np.testing.assert_allclose(at_start, 0, atol=1e-12)
    np.testing.assert_allclose(at_end, off[:, moving], atol=2e-6)
    assert at_end[1].max() < 1e-5 < 0.05 < at_end[0].max()
    if "panda" in study.robot.name:
        assert at_end[0, -1] < 1e-5  # the last shape is a finger
    full, grey = np.array([0xD5, 0x5E, 0x00]), np.array([0xC6, 0xCC, 0xD3])
    for s in range(moving.sum()):
        share = at_end[0, s] / step_above(off[0].max())  # the scale of the bars
        np.testing.assert_allclose(painted[0][s], (1 - share) * grey + share * full, atol=1)
        np.testing.assert_allclose(painted[1][s], grey, atol=1)  # who comes back
    np.testing.assert_array_equal(plain, np.broadcast_to(grey, np.shape(plain)))
    # within a cycle, against the repeatable arm at the same instant
    between, _ = told(2.5)
    apart = np.array([motions[1].q[150], motions[0].q[150]])
    expected = drawn.moved(*whole(apart))
    np.testing.assert_allclose(between[0], expected[moving], atol=2e-6)
    in_the_menu(driver, "show-drift").click()
    _, own = told(3)
    # the robot's own colours
    assert len({tuple(c) for c in own[0]}) > 1 or not np.array_equal(own[0][0], grey)
    note = driver.find_element("id", "drift-note")
    assert note.get_attribute("hidden")
    in_the_menu(driver, "show-drift").click()
    assert not note.get_attribute("hidden")
    grey_is_named(driver, note)


def step_above(length: float) -> float:
    """The end of the page's scale for this drift, m: 5 cm, or the next step of 1, 2 or 5."""
    steps = [k * 10.0**e for e in range(-2, 2) for k in (1, 2, 5)]
    return min(step for step in steps if step >= max(length, 0.05))


def grey_is_named(driver: Any, note: Any) -> None:
    """From the start, at the ends of cycles; from the grey arm, now, while the arm moves: its
    number stood there under a headline about the last cycle."""
    driver.execute_script("repctl.set('ghost', true)")
    for cycles, whence in (
        (3, "after 3 cycles, from its start"),
        (2.5, "now, from the grey arm"),
        (0, "at the start"),
    ):
        driver.execute_script("repctl.seek(arguments[0])", cycles)
        box = driver.find_element("css selector", ".callout")
        value, callout = [e.get_attribute("textContent") for e in box.find_elements("xpath", "*")]
        # a narrow pane has fewer words at the end of a cycle
        assert callout in (whence, cycles % 1 == 0 and "from its start"), cycles
        reading = driver.find_element("css selector", ".reading b").get_attribute("textContent")
        if cycles % 1 == 0:
            assert value.endswith(f" {reading}"), "one number in the callout and in the readings"
        hand = driver.find_element("css selector", ".callout.hand")
        assert hand.get_attribute("textContent").endswith("0 from its start")
        assert (hand.value_of_css_property("visibility") == "hidden") == (cycles % 1 > 0)
        colours = note.get_attribute("textContent")
        assert re.fullmatch(r"drift 0[1-9][\d.]* c?m", colours), colours


def in_the_menu(driver: Any, name: str) -> Any:
    """A control of the menu, which is opened."""
    driver.execute_script("document.getElementById('looks').open = true")
    return driver.find_element("id", name)


def ghosts_show_drift_and_nothing_else(
    driver: Any, motions: list[rp.Motion], moments: tuple[float, ...]
) -> None:
    """At every moment the ghost of who repeats is hidden by the arm, that of who has crept by 0.1
    rad is seen."""
    for moment in moments:
        with_ghost, without = (picture(driver, moment, ghost=ghost) for ghost in (True, False))
        for arm, motion in enumerate(motions):
            at = round(moment * motion.steps)
            off = np.linalg.norm(motion.q[at] - motions[1].q[at])
            seen = changed(pane(driver, with_ghost, arm), pane(driver, without, arm))
            assert seen <= 0.0001 if off < 1e-6 else off < 0.1 or seen > 0.0002, (
                moment,
                arm,
                off,
                seen,
            )


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) for name in ("ppr", *SHOWN)]
)
def test_every_kind_of_robot_moves_and_only_who_repeats_comes_back(
    driver: Any, tmp_path: Path, name: str
) -> None:
    """Two arms, a lift, a humanoid, joints without limits, a planar arm, one without meshes: their
    studies' pages."""
    name, _, bare = name.partition(" ")
    robot: rp.Robot = rp.Robot.load(
        Path(__file__).parents[2] / "examples" / "my_arm.urdf" if name == "my_arm" else name
    )
    if bare:
        text = robot.description.xml.replace("package://", "package://not_here/")
        (tmp_path / "bare.urdf").write_text(text, encoding="utf-8")
        robot = rp.Robot.load(tmp_path / "bare.urdf")
    study = rp.study(robot, cycles=10, steps=120, degree=1)
    schemes(driver, width=560, height=600)  # higher than other tests' window, where arms are tiny
    page = tmp_path / "animation.html"
    page.write_text(rp.animation(study).page, encoding="utf-8")
    open_page(driver, page)
    shapes = shapes_of(page)
    assert len(shapes) > 5
    assert driver.execute_script("return [repctl.meshes(0), repctl.meshes(1)]") == [len(shapes)] * 2
    moments = (5.5,) if name == "ppr" else (0, 0.5, 5.5, 10)
    ghosts_show_drift_and_nothing_else(driver, motions_of(study), moments)
    start, quarter, middle, one, end = (
        picture(driver, c, ghost=False) for c in (0, 0.25, 0.5, 1, 10)
    )
    for arm, key in enumerate(("pseudoinverse", "repeatable")):
        a, b, c, *whole = (pane(driver, image, arm) for image in (start, quarter, middle, one, end))
        assert np.ptp(a) > 150, "nothing is drawn"
        assert min(changed(a, b), changed(b, c), changed(a, c)) > 0.004
        for drift, after in zip(study.row(key).motion.drift[[0, -1]], whole, strict=True):
            assert (
                changed(a, after) <= 0.0005
                if key == "repeatable"
                else drift < 0.1 or changed(a, after) > 0.0005
            )
    assert study.row("repeatable").motion.drift[-1] < 1e-7
    # these creep too little
    assert name in ("kinova", "tiago") or study.row("pseudoinverse").motion.drift[-1] > 0.1
    assert errors(driver) == []


@pytest.mark.slow
def test_mirrored_meshes_are_not_inside_out(driver: Any, tmp_path: Path) -> None:
    """Six mirrored meshes of a humanoid, and no other body."""
    talos, mirrored = rp.Robot.load("talos"), 0

    def kept(visual: re.Match[str]) -> str:
        nonlocal mirrored
        scale = re.search(r'scale="([^"]*)"', visual[0])
        if scale is None or np.prod([float(s) for s in scale[1].split()]) > 0:
            return ""
        mirrored += 1
        return visual[0] if mirrored <= 6 else ""

    text = re.sub(r"(?s)<visual>.*?</visual>", kept, talos.description.path.read_text())
    assert mirrored > 5
    (tmp_path / "talos.urdf").write_text(text, encoding="utf-8")
    robot = rp.Robot.load(tmp_path / "talos.urdf", package_dirs=talos.package_dirs)
    task = robot.task()
    path = rp.circle(task, task.reference, 0.02)
    control = rp.Pseudoinverse(task)
    still = rp.follow(control, path, task.reference, cycles=1, steps=8)
    open_page(driver, write(tmp_path, {"mirrored": still}))
    both = picture(driver, 0)
    show_only = "repctl.materials((m) => { m.side = arguments[0]; })"
    # three's FrontSide: a wrong winding would show the far walls instead
    driver.execute_script(show_only, 0)
    front = picture(driver, 0)
    driver.execute_script(show_only, 1)  # BackSide
    back = picture(driver, 0)
    assert changed(both, front) < 0.002
    assert changed(both, back) > 0.01


@pytest.mark.slow
def test_controls_work_when_clicked(driver: Any, tmp_path: Path) -> None:
    four = rp.Robot.load("planar4r").description.xml
    named = four.replace('<robot name="planar4r"', '<robot name="&lt;i&gt;four&lt;/i&gt;"')
    (tmp_path / "four.urdf").write_text(named, encoding="utf-8")
    motions = on_a_circle(rp.Robot.load(tmp_path / "four.urdf"), FOUR)
    page = write(tmp_path, motions)
    open_page(driver, page)

    def element(name: str) -> Any:
        return driver.find_element("id", name)

    def text(node: Any) -> str:  # also of what a small window hides
        return " ".join(node.get_attribute("textContent").split())

    assert text(element("title")).startswith("<i>four</i>: ")
    assert [text(e) for e in driver.find_elements("css selector", ".arm-label .name")] == [
        "Usual control (pseudoinverse)",
        "repeatable",
    ]
    assert not driver.execute_script("return repctl.playing")
    element("play").click()
    assert driver.execute_script("return repctl.playing")
    deadline = time.monotonic() + 20
    while driver.execute_script("return repctl.time") < 0.05:
        assert time.monotonic() < deadline, "the animation does not run"
        time.sleep(0.05)
    element("play").click()
    assert not driver.execute_script("return repctl.playing")
    # an event of the slider shows the arms once, and no picture looks a program up again
    shows, versions = driver.execute_script(
        "let shows = 0; const { viewer } = repctl, dirty = viewer.set_dirty;"
        "viewer.set_dirty = () => { shows += 1; dirty.call(viewer); };"
        "const scrub = document.getElementById('scrub'); scrub.value = 1.3;"
        "scrub.dispatchEvent(new Event('input')); viewer.set_dirty = dirty;"
        "const sum = () => { let all = 0; viewer.scene.traverse(({ material }) => {"
        "  for (const one of [material].flat()) if (one) all += one.version; }); return all; };"
        "const before = sum(); repctl.placed(); return [shows, sum() - before]"
    )
    assert shows == 1 and versions == 0
    held = driver.execute_script("return repctl.time")
    time.sleep(0.2)
    assert driver.execute_script("return repctl.time") == held
    driver.execute_script("repctl.seek(2)")
    assert text(element("clock")) == "after 2 of 2"
    first, second = (text(row) for row in driver.find_elements("class name", "reading"))
    assert first.startswith("Usual control: ") and second == "repeatable: 0"
    assert text(element("done")) == "After 2 cycles, from its start"
    joints = driver.find_element("css selector", ".reading b")
    size = f"joints {motions['J⁺'].drift[-1]:.3g} rad, root of the sum of squares"
    assert joints.get_attribute("title").endswith(size)
    # at any time, what stands beside the bars is the end of the last finished cycle
    driver.execute_script("repctl.seek(1.5)")
    assert text(element("done")) == "After 1 cycle, from its start"
    size = f"joints {motions['J⁺'].drift[0]:.3g} rad"
    assert size in joints.get_attribute("title")
    # the slider
    from selenium.webdriver.common.keys import Keys

    element("scrub").send_keys(Keys.HOME)
    assert driver.execute_script("return repctl.time") == 0
    assert element("scrub").get_attribute("aria-valuetext") == "start"
    # keys, wherever the focus is; what a pointer pressed does not keep them
    in_the_menu(driver, "show-traces").click()
    in_the_menu(driver, "show-traces").click()
    driver.execute_script("document.getElementById('looks').open = false")
    time.sleep(0.1)
    body = driver.switch_to.active_element
    for keys, expected in (
        (Keys.END, 2),
        (Keys.PAGE_UP, 1),
        (Keys.ARROW_RIGHT, 1 + 1 / 60),
        (Keys.HOME, 0),
    ):
        body.send_keys(keys)
        assert driver.execute_script("return repctl.time") == pytest.approx(expected)
    body.send_keys(" ")
    assert driver.execute_script("return repctl.playing")
    body.send_keys(" ")
    assert not driver.execute_script("return repctl.playing")
    # the ends of cycles alone
    in_the_menu(driver, "stepping").click()
    assert driver.execute_script("return [repctl.playing, repctl.time % 1]") == [1, 0]
    driver.execute_script("repctl.pause()")
    driver.execute_script("repctl.seek(0)")
    driver.switch_to.active_element.send_keys(Keys.ARROW_RIGHT)
    assert driver.execute_script("return repctl.time") == 1
    in_the_menu(driver, "stepping").click()
    driver.execute_script("document.getElementById('looks').open = false; repctl.pause()")
    # a click on a bar goes to that cycle's end; so do arrows, where the chart has the focus
    chart = element("chart")
    driver.execute_script(
        "const [c] = arguments, {left, top, width} = c.getBoundingClientRect(), x = width / 3;"
        "c.dispatchEvent(new MouseEvent('click', {bubbles: true, clientX: left + x, clientY: "
        "top + 5}))",
        chart,
    )
    assert driver.execute_script("return repctl.time") == 1
    chart.send_keys(Keys.ARROW_RIGHT)
    assert driver.execute_script("return repctl.time") == 2
    assert chart.get_attribute("aria-valuenow") == "2"
    assert "after 2 cycles, from its start" in chart.get_attribute("aria-valuetext")
    # the keys are told, and the chart stands over the slider
    driver.find_element("tag name", "body").send_keys("?")
    assert "play or pause" in element("keys").text
    element("keys").find_element("css selector", "form button").click()
    ends = driver.execute_script(
        "return ['chart', 'scrub'].map((id) => { const r = "
        "document.getElementById(id).getBoundingClientRect(); return [r.left, r.right]; })"
    )
    np.testing.assert_allclose(ends[0], ends[1], atol=1)
    # the boxes and the view
    before = picture(driver, 1.5, traces=True)
    in_the_menu(driver, "show-traces").click()
    without = driver.execute_script("return repctl.picture()")
    in_the_menu(driver, "show-traces").click()
    assert driver.execute_script("return repctl.picture()") != without
    in_the_menu(driver, "show-ghost").click()
    # the ghost is no more than what one cycle's drift leaves bare
    assert changed(before, picture_now(driver)) > 0.0002
    in_the_menu(driver, "show-ghost").click()
    driver.execute_script("repctl.turn(0.5, 0.2, 0.8)")
    labels_are_in_their_panes(driver)
    assert changed(before, picture(driver, 1.5, traces=True)) > 0.01
    in_the_menu(driver, "view").click()
    assert changed(before, picture(driver, 1.5, traces=True)) < 0.001
    driver.find_element("css selector", "#speed option[value='4']").click()
    assert errors(driver) == []
    the_address_keeps_time_and_view(driver, page)


def the_address_keeps_time_and_view(driver: Any, page: Path) -> None:
    """What is looked at is in the address, and another who opens it looks at the same."""
    driver.execute_script("repctl.seek(0.25); repctl.turn(0.5, 0.2, 0.8); repctl.seek(0.75)")
    deadline = time.monotonic() + 20
    while "#t=0.75&view=" not in driver.current_url:
        assert time.monotonic() < deadline, driver.current_url
        time.sleep(0.05)
    address = driver.current_url
    where = "const {camera} = repctl.viewer; return [...camera.position.toArray(), camera.zoom]"
    stood = driver.execute_script(where)
    driver.get("about:blank")
    with asleep(driver):
        driver.get(address)
        wait_until_drawn(driver, address)
    assert driver.execute_script("return [repctl.time, repctl.playing]") == [0.75, False]
    np.testing.assert_allclose(driver.execute_script(where), stood, atol=1e-3)
    assert errors(driver) == []


@pytest.mark.slow
def test_more_arms_and_none_to_read(driver: Any, tmp_path: Path) -> None:
    """Three arms of a robot without any shapes; a body that cannot be read is said on the page."""
    urdf = tmp_path / "bones.urdf"
    text = (Path(__file__).parents[2] / "urdf" / "planar3r.urdf").read_text(encoding="utf-8")
    urdf.write_text(re.sub(r"<visual>.*?</visual>", "", text, flags=re.DOTALL), encoding="utf-8")
    robot = rp.Robot.load(urdf)
    motions = on_a_circle(robot, [0.3, 0.8, 0.8])
    page = write(tmp_path, motions | {"again": motions["J⁺"]})
    open_page(driver, page)
    assert errors(driver) == []
    assert (
        driver.execute_script("return [0, 1, 2].map(repctl.meshes)") == [len(shapes_of(page))] * 3
    )
    image = picture(driver, 0.5)
    for k in range(3):
        assert np.ptp(pane(driver, image, k)) > 150


@pytest.mark.slow
def test_it_opens_on_the_end_walks_the_cycles_and_stays(driver: Any, tmp_path: Path) -> None:
    """The first ten seconds: the drift is seen at once, and stays; who wants no motion gets none.

    It ran on, so that most screens had an arm at its start, without drift.
    """
    page = write(tmp_path, on_a_circle(rp.Robot.load("planar4r"), FOUR))
    watch = (
        "window.shown = []; (function look() { requestAnimationFrame(look);"
        "if (window.repctl && repctl.ready && shown.at(-1) !== repctl.time) "
        "shown.push(repctl.time); })()"
    )
    watching = driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": watch})
    driver.get("about:blank")
    driver.get(page.as_uri())
    wait_until_drawn(driver, "the page")
    deadline = time.monotonic() + 60
    while driver.execute_script("return repctl.playing"):
        assert time.monotonic() < deadline
        time.sleep(0.1)
    time.sleep(2)
    driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", watching)
    seen, playing = driver.execute_script("return [shown, repctl.playing]")
    assert seen[:2] == [2, 0] and seen[-1] == 2 and not playing
    assert set(seen) <= {0, 1, 2}  # from one cycle's end to the next
    schemes(driver, width=680, height=460, still=True)
    driver.get("about:blank")
    driver.get(page.as_uri())
    wait_until_drawn(driver, "the page")
    assert driver.execute_script("return [repctl.time, repctl.playing]") == [2, False]
    left, right = (pane(driver, picture_now(driver), k) for k in (0, 1))
    # what one sees first
    assert changed(left[:, : right.shape[1]], right[:, : left.shape[1]]) > 0.01
    assert errors(driver) == []


def every_word_is_read(driver: Any, axe: Any) -> None:
    """No finding of axe-core's, no word cut, nothing beside the window."""
    axe.inject()
    groups = "{rules: {dlitem: {enabled: false}}}"  # since HTML 5.2 a <div> may group <dt> and <dd>
    found = axe.run(options=groups)["violations"]
    assert found == [], [(v["id"], [n["html"] for n in v["nodes"]]) for v in found]
    assert driver.execute_script("return document.documentElement.scrollWidth <= window.innerWidth")
    cut = driver.execute_script(
        "return [...document.querySelectorAll('.name, .past, #verdict, #notes, .reading, "
        ".callout')]"
        ".filter((n) => n.offsetParent)"
        ".filter("
        "(n) => n.scrollWidth > n.clientWidth || n.getBoundingClientRect().right > "
        "window.innerWidth)"
        ".map((n) => n.textContent)"
    )
    assert cut == []


def labels_are_in_their_panes(driver: Any) -> None:
    labels = driver.execute_script(
        "return [...document.querySelectorAll('.pane')].map((p) => [p, "
        "p.firstElementChild].map((n) => {"
        "const r = n.getBoundingClientRect(); return [r.left, r.top, r.right, r.bottom]; }))"
    )
    for frame, label in np.array(labels):
        assert (label[:2] >= frame[:2]).all() and (label[2:] <= frame[2:]).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ppr", *(name for name in SHOWN if " " not in name)])
def test_a_studys_page_is_whole_at_every_size(driver: Any, tmp_path: Path, name: str) -> None:
    """A desk, a phone, a wall; light and dark: words, labels after any orbit, ghosts, and what is
    seen first."""
    axe = pytest.importorskip("axe_selenium_python").Axe(driver)
    robot = Path(__file__).parents[2] / "examples" / "my_arm.urdf" if name == "my_arm" else name
    study, page = (rp.study(robot, cycles=10, steps=120, degree=1), tmp_path / "animation.html")
    page.write_text(rp.animation(study).page, encoding="utf-8")
    drift = study.row("pseudoinverse").motion.drift[-1]
    for width, height in ((1400, 900), (390, 844), (844, 390), (1024, 500), (3840, 2160)):
        schemes(driver, width=width, height=height)
        open_page(driver, page)
        for dark in (False, True):
            schemes(driver, width=width, height=height, dark=dark)
            driver.execute_async_script(
                "requestAnimationFrame(() => requestAnimationFrame(arguments[0]))"
            )
            driver.execute_script("repctl.seek(10)")
            every_word_is_read(driver, axe)
        for way in ((0.5, 0.2, 0.8), (1.5, 0, 1), (-3, 0.4, 2)):
            driver.execute_script("repctl.turn(...arguments)", *way)
            labels_are_in_their_panes(driver)
        driver.execute_script("document.getElementById('view').click()")
        ghosts_show_drift_and_nothing_else(driver, motions_of(study), (5.5,))
        first = picture(driver, 10, traces=True)  # what it opens on
        left, right = (pane(driver, first, k) for k in (0, 1))
        tall, wide = np.minimum(left.shape, right.shape)[:2]
        assert drift < 0.1 or changed(left[:tall, :wide], right[:tall, :wide]) > 0.005
    assert errors(driver) == []


def the_sheet_for_print(driver: Any) -> tuple[int, int]:
    """Size of the canvas that is printed; what the window shows is as before."""
    width, height, *shown = driver.execute_script(
        "const seen = () => [...document.querySelectorAll('#stage, .pane, canvas')]"
        ".map((n) => JSON.stringify(n.getBoundingClientRect())).join();"
        "const before = [seen(), repctl.time], {width, height} = repctl.still();"
        "return [width, height, before.join(), [seen(), repctl.time].join()]"
    )
    assert width > height > 700 and shown[0] == shown[1]
    return width, height


@pytest.mark.slow
@pytest.mark.parametrize(
    "sizes", some([((1400, 900), (390, 844)), ((844, 390), (1024, 500))], ((1400, 900), (390, 844)))
)
def test_everybody_can_read_and_use_it(
    driver: Any, tmp_path: Path, sizes: tuple[tuple[int, int], ...]
) -> None:
    """No finding of axe-core's, nothing beside the window, panes of one size; in every
    size, and dark on a desk and a phone."""
    axe = pytest.importorskip("axe_selenium_python").Axe(driver)
    ppr = (ROOT / "urdf" / "ppr.urdf").read_text(encoding="utf-8")
    slow = re.sub(r'velocity="[^"]*"', 'velocity="0.01"', ppr)  # one more note each
    long = slow.replace("theta3", "a_joint_with_a_long_name_that_has_to_break")
    (tmp_path / "long.urdf").write_text(long, encoding="utf-8")
    motions = on_a_circle(
        rp.Robot.load(tmp_path / "long.urdf"), [0.0, 0.0, 0.8], "nearest repeatable"
    )
    open_page(driver, write(tmp_path, motions))
    driver.execute_script("repctl.seek(1.5)")
    seen = [(size, dark) for dark in (False, True) for size in sizes]
    sheets: set[tuple[int, int]] = set()
    for (width, height), dark in seen:
        schemes(driver, width=width, height=height, dark=dark)
        driver.execute_async_script(
            "requestAnimationFrame(() => requestAnimationFrame(arguments[0]))"
        )
        every_word_is_read(driver, axe)
        ask = "return repctl.pane(arguments[0])"
        (a, b, wide, tall), (c, d, *same) = (driver.execute_script(ask, k) for k in (0, 1))
        np.testing.assert_allclose(same, [wide, tall], atol=0.01)
        assert tall * driver.find_element("id", "stage").size["height"] > 150
        # stacked, or side by side
        assert (a == c and d > b) if width < height else (b == d and c > a)
        size = driver.find_element("id", "chart").size
        assert size["width"] > 200 and size["height"] > 35
        if not dark:
            sheets.add(the_sheet_for_print(driver))
    assert len(sheets) == 1, sheets  # whatever the window
    assert errors(driver) == []


@pytest.mark.slow
@pytest.mark.parametrize("schemes_of_colour", some([(True,), (False, True)], (True,)))
def test_a_moved_elbow_joints_and_a_dialog_can_be_read(
    driver: Any, tmp_path: Path, schemes_of_colour: tuple[bool, ...]
) -> None:
    """No finding of axe-core's while the slider is held, after it is let go, with the joints over
    the cycles, and with the dialog open; light and dark."""
    axe = pytest.importorskip("axe_selenium_python").Axe(driver)
    study = rp.study(rp.Problem("planar4r", region=0.3), cycles=2, steps=60, degree=1)
    page = tmp_path / "animation.html"
    page.write_text(rp.animation(study).page, encoding="utf-8")
    schemes(driver, width=1280, height=760)
    open_page(driver, page)
    slide = (
        "const s = document.getElementById('elbow'); s.value = Number(s.max) / 2;"
        "s.dispatchEvent(new Event(arguments[0], { bubbles: true }))"
    )
    for script, *arguments in (
        (slide, "input"),
        (slide, "change"),
        ("document.getElementById('show-joints').click()",),
        ("document.getElementById('help').click()",),
    ):
        driver.execute_script(script, *arguments)
        for dark in schemes_of_colour:
            schemes(driver, width=1280, height=760, dark=dark)
            driver.execute_async_script(
                "requestAnimationFrame(() => requestAnimationFrame(arguments[0]))"
            )
            every_word_is_read(driver, axe)
    assert driver.find_element("id", "keys").is_displayed()
    assert errors(driver) == []


_NO_WEBGL = """
const context = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
  return kind.includes("webgl") ? null : context.call(this, kind, ...more);
};
"""


_NO_TEXTURES = """
for (const { prototype } of [WebGLRenderingContext, WebGL2RenderingContext]) {
  const { getParameter } = prototype;
  prototype.getParameter = function (name) {
    return name === 0x8b4c ? 0 : getParameter.call(this, name); // textures of a vertex shader
  };
}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("before", "said"),
    [
        (_NO_WEBGL, "No 3D view: WebGL is off here. "),
        (_NO_TEXTURES, "No 3D view: its WebGL has no floating-point textures for vertices. "),
    ],
)
def test_without_webgl_the_arms_are_lines(
    driver: Any, tmp_path: Path, before: str, said: str
) -> None:
    """Each arm at the start and at the end, its number, and the chart; no dead buttons."""
    page = write(tmp_path, on_a_circle(rp.Robot.load("planar4r"), FOUR))
    coloured = (
        "return [...document.querySelectorAll('.pane canvas, #chart')].map((c) => new Set(new "
        "Uint32Array(c.getContext('2d').getImageData(0, 0, c.width, c.height).data.buffer)).size)"
    )
    for width, height in ((900, 700), (390, 844)):
        schemes(driver, width=width, height=height)
        driver.get("about:blank")
        with asleep(driver, before):
            driver.get(page.as_uri())
            wait_until_drawn(driver, "the page")
        shown = "return document.querySelectorAll('.pane canvas').length"
        deadline = time.monotonic() + 20
        while driver.execute_script(shown) < 2:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        assert min(driver.execute_script(coloured)) > 3
        names = [e.text for e in driver.find_elements("css selector", ".arm-label")]
        assert names[0].endswith("m from its start") and names[1] == "repeatable: 0 from its start"
        assert driver.find_element("id", "drift-note").text.startswith(said)
        assert not driver.find_element("id", "notice").is_displayed()
        assert not driver.find_element("id", "play").is_displayed()
        assert driver.execute_script(
            "return document.documentElement.scrollWidth <= window.innerWidth"
        )
    assert [e for e in errors(driver) if "WebGL" not in e] == []


@pytest.mark.slow
def test_on_the_narrowest_phone_no_label_is_cut(driver: Any, tmp_path: Path) -> None:
    """Panes that would be narrower than their labels stand one above the other."""
    page = write(tmp_path, on_a_circle(rp.Robot.load("planar4r"), FOUR))
    schemes(driver, width=320, height=560)
    open_page(driver, page)
    left, top = driver.execute_script("return [0, 1].map((k) => repctl.pane(k))")
    assert left[0] == top[0] and left[1] < top[1]
    cut = "return [...document.querySelectorAll('.name')].map((n) => n.scrollWidth - n.clientWidth)"
    assert max(driver.execute_script(cut)) <= 0


@pytest.mark.slow
def test_on_a_phone_the_notes_fold(driver: Any, tmp_path: Path) -> None:
    """A button shows them; the buttons stand beside play, and each number once."""
    schemes(driver, width=390, height=844)
    open_page(driver, write(tmp_path, on_a_circle(rp.Robot.load("planar4r"), FOUR)))
    notes, button = (driver.find_element("id", name) for name in ("notes", "noted"))
    assert not notes.is_displayed()
    assert not driver.find_element("id", "readings").is_displayed()
    rows = [driver.find_element("id", name).rect for name in ("play", "noted", "help")]
    middles = [row["y"] + row["height"] / 2 for row in rows]
    assert np.ptp(middles) < 4 and rows[-1]["x"] + rows[-1]["width"] <= 390
    button.click()
    assert notes.is_displayed() and button.get_attribute("aria-expanded") == "true"
    button.click()
    assert not notes.is_displayed() and errors(driver) == []
    schemes(driver, width=1000, height=700)
    assert notes.is_displayed() and not button.is_displayed()


_RECTANGLES = """
const [name] = arguments, menu = document.getElementById(name);
menu.open = true;
return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => {
  const rectangle = (node) => { const r = node.getBoundingClientRect();
    return [r.left, r.top, r.right, r.bottom]; };
  const box = menu.lastElementChild, inside = [];
  for (const node of box.querySelectorAll("label, button, select")) if (node.offsetParent) {
    node.scrollIntoView({ block: "nearest" }); inside.push(rectangle(node)); }
  const found = [rectangle(box), ...inside];
  menu.open = false;
  done(found);
})));
"""


@pytest.mark.slow
@pytest.mark.parametrize("touch", some([True, False], True))
def test_menus_lie_inside_the_window(driver: Any, tmp_path: Path, touch: bool) -> None:
    """28.1: every entry of every menu can be reached on phones, tablets and desks, by touch and
    mouse; names of menus stand on one line with their neighbours'."""
    study = rp.study(rp.Problem("planar3r", region=0.3), cycles=2, steps=60, degree=1)
    open_page(driver, rp.animation(study).save(tmp_path / "page.html"))
    sizes = [(320, 568), (360, 740), (390, 844), (430, 932), (768, 1024), (1280, 800)]
    driver.execute_cdp_cmd(
        "Emulation.setTouchEmulationEnabled", {"enabled": touch, "maxTouchPoints": 1}
    )
    for width, height in (*sizes, *((tall, wide) for wide, tall in sizes)):
        schemes(driver, width=width, height=height)
        for name in ("looks", "loops", "save"):
            found = np.array(driver.execute_script(_RECTANGLES, name))
            assert len(found) > 2, name
            assert (found[:, :2] >= 0).all(), (name, width, height, found.min(axis=0))
            assert (found[:, 2] <= width).all(), (name, width, height, found.max(axis=0))
            assert (found[:, 3] <= height).all(), (name, width, height, found.max(axis=0))
        middles = driver.execute_script(
            "return [...document.querySelectorAll('#tools .plain')]"
            ".filter((n) => n.offsetParent && !n.closest('.menu > div')).map((n) => {"
            "const range = document.createRange(); range.selectNodeContents(n);"
            "const a = range.getBoundingClientRect(), b = n.getBoundingClientRect();"
            "return [(a.top + a.bottom) / 2 - (b.top + b.bottom) / 2, b.left, b.right]; })"
        )
        assert len(middles) >= 4
        assert np.abs(np.array(middles)[:, 0]).max() < 1.5, (width, height, middles)
        assert np.min(middles, axis=0)[1] >= 0 and np.max(middles, axis=0)[2] <= width
    assert errors(driver) == []
