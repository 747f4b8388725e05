"""A visitor's own loop on the page: its numbers against Python's, by node and in a real browser."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from browser import asleep, errors, open_page, picture_now, schemes, wait_until_drawn
from commands import main
from controls import some
from page_file import read
from store import study_of

import repctl_pin as rp
from repctl_pin.show.page.own_loop import own_loop

SCRIPTS = Path(rp.__file__).parent / "show" / "page" / "assets" / "scripts" / "arm"
NODE = shutil.which("node")

EVALUATE = """
import { Chain } from "./kinematics.js";
import { Law, followed, pieces } from "./law.js";
import { readFileSync } from "fs";
const { own, Q, X, paths } = JSON.parse(readFileSync(0)), chain = new Chain(own), laws = own.laws.map((parts) => new Law(chain, parts));
const at = Q.map((q, k) => {
  const A = new Float64Array(chain.m * chain.n);
  chain.place(q);
  chain.jacobian(A);
  const p = chain.frames.flatMap((frame) => [...frame.p]), e = [...chain.error(chain.homes, new Float64Array(chain.m))];
  const v = laws.map((law) => { law.solve(q, X[k]); return [...law.x]; });
  return { p, J: [...A], e, v, margin: laws.map((law) => law.margin()), h: laws.map((law) => [...law.levels(q)]) };
});
const way = pieces(paths, own.speed, own.steps), n = chain.n;
const whole = (work) => { for (;;) { const { done, value } = work.next(); if (done) return value; } };
const ends = laws.map((law) => { const { Q, perCycle } = whole(followed(law, own.start, way, 10)); return Array.from({ length: 11 }, (_, c) => [...Q.slice(c * perCycle * n, (c * perCycle + 1) * n)]); });
console.log(JSON.stringify({ at, ends }));
"""  # noqa: E501


def numbers(task: rp.Task, q0: Any, strategies: Sequence[Any]) -> dict[str, Any] | None:
    """What the page of an animation with these controllers holds for own loops."""
    path = rp.circle(task, q0, 0.05, normal=PLANES.get(task.kind, "xy"))
    motion = rp.follow(strategies[0], path, q0, cycles=1, steps=400, period=3.0)
    return own_loop(motion, strategies)


PLANES = {"xz": "xz", "yz": "yz"}


def drawn(task: rp.Task, q0: Any) -> np.ndarray:
    """A closed loop of uneven corners, in the task's plane."""
    rows = [row for row in task.rows if row < 3][:2]
    turn = np.linspace(0, 2 * np.pi, 14)
    points = np.tile(task.placement(q0).translation, (len(turn), 1))
    points[:, rows[0]] += 0.06 * np.sin(turn) + 0.01 * np.sin(3 * turn)
    points[:, rows[1]] += 0.05 * (1 - np.cos(turn))
    points[-1] = points[0]
    return points


def nullspace(J: np.ndarray) -> np.ndarray:
    """An orthonormal basis (n, r) of what J does not see."""
    return np.linalg.svd(J)[2][len(J) :].T


def arm(name: str) -> tuple[rp.Task, np.ndarray]:
    robot, _, kind = name.partition(" ")
    task = rp.Robot.load(robot).task(**({"kind": kind} if kind else {}))
    q0 = task.reference.copy()
    if robot.startswith("planar"):
        q0 = np.linspace(0.3, 0.8, task.n)
    return task, q0


@pytest.mark.parametrize(
    "name",
    some(
        ["planar3r xy", "ppr xy", "panda", "panda axis", "panda position", "kinova position"],
        "panda",
    ),
)
def test_the_page_computes_as_python_does(name: str, tmp_path: Path) -> None:
    """At random configurations, and after each of ten cycles of a loop."""
    if NODE is None:
        assert os.environ.get("CI") != "true", "node is not installed"
        pytest.skip("node is not installed")
    task, q0 = arm(name)
    rng = np.random.default_rng(1)
    basis = rp.Polynomial(q0, 2, 0.7)
    if name in ("panda axis", "ppr xy"):  # waves of a few joints
        basis = rp.Polynomial(q0, 1, 0.7) + rp.Fourier(task.n, 1, variables=[0, 1])
        basis = basis + rp.Polynomial(q0, 3, 0.7, variables=[task.n - 1])
    N = nullspace(task.jacobian(q0))  # gradients near the null space, and bent
    A = 0.05 * rng.normal(size=(basis.size, task.r))
    A += np.linalg.lstsq(basis.gradients(q0[None])[0], N, rcond=None)[0]
    control = rp.RepeatableInverse(task, basis.weighted(A))
    laws = (rp.Pseudoinverse(task), control)
    own = numbers(task, q0, laws)
    assert own is not None and len(json.dumps(own)) < 20_000
    Q = q0 + rng.uniform(-0.1, 0.1, (30, task.n))
    X = rng.normal(size=(30, task.m))
    points = drawn(task, q0)
    found = evaluated(tmp_path, own, Q, X, [points.tolist()])
    start = task.placement(q0)
    for q, x, at in zip(Q, X, found["at"], strict=True):
        assert np.allclose(at["p"], task.placement(q).translation, atol=1e-12, rtol=0)
        assert np.allclose(at["J"], task.jacobian(q).ravel(), atol=1e-12, rtol=0)
        assert np.allclose(at["e"], task.error(q, start), atol=1e-12, rtol=0)
        for law, v in zip(laws, at["v"], strict=True):
            expected = law.velocity(q, x)
            assert np.abs(v - expected).max() < 1e-11 * np.linalg.norm(expected)
        V = control.potentials.gradient(q)
        cosines = nullspace(task.jacobian(q)).T @ np.linalg.qr(V)[0]
        margin = np.linalg.svd(cosines)[1].min()
        assert at["margin"][0] == 1 and at["margin"][1] == pytest.approx(margin, abs=1e-6)
        # a constant is left out
        assert np.allclose(
            np.subtract(at["h"][1], found["at"][0]["h"][1]),
            control.leaf(q) - control.leaf(Q[0]),
            atol=1e-12,
        )
    path = rp.waypoints(points, start.rotation)
    period = path.length / own["speed"]
    for law, ends, most in zip(laws, found["ends"], (1e-6, 1e-8), strict=True):
        motion = rp.follow(law, path, q0, cycles=10, steps=400, period=period)
        assert np.abs(motion.q[:: motion.steps] - ends).max() < most


def evaluated(folder: Path, own: Any, Q: Any, X: Any, paths: list[Any]) -> Any:
    """What the page's scripts compute by node: at Q with ẋ = X, and along the paths."""
    for name in ("kinematics.js", "potentials.js", "law.js"):
        (folder / name).write_text((SCRIPTS / name).read_text("utf-8"), "utf-8")
    (folder / "package.json").write_text('{"type": "module"}', "utf-8")
    (folder / "evaluate.js").write_text(EVALUATE, "utf-8")
    given = {"own": own, "Q": Q.tolist(), "X": X.tolist(), "paths": paths}
    command = [str(NODE), str(folder / "evaluate.js")]
    done = subprocess.run(command, input=json.dumps(given), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
@pytest.mark.parametrize("mirrored", some([False, True], True))
def test_the_page_computes_two_hands_as_python_does(mirrored: bool, tmp_path: Path) -> None:
    """Of Talos: one hand on a loop, the other still or mirroring it; J, ẋ and ten cycles' ends."""
    if NODE is None:
        assert os.environ.get("CI") != "true", "node is not installed"
        pytest.skip("node is not installed")
    robot = rp.Robot.load("talos")
    task = robot.task(["gripper_left_base_link", "gripper_right_base_link"])
    q0 = task.reference
    start = task.placements(q0)
    rng = np.random.default_rng(2)
    basis = rp.Polynomial(q0, 1, 0.7)
    N = nullspace(task.jacobian(q0))
    A = np.linalg.lstsq(basis.gradients(q0[None])[0], N, rcond=None)[0]
    control = rp.RepeatableInverse(task, basis.weighted(A))
    laws = (rp.Pseudoinverse(task), control)
    turn = np.linspace(0, 2 * np.pi, 12)
    way = np.array([0.04 * np.sin(turn), 0.03 * (1 - np.cos(turn)), 0.02 * np.sin(turn)]).T
    way[-1] = 0
    loop = start[0].translation + way
    other = start[1].translation + way * [1, -1, 1] if mirrored else None
    listed = [points if points is None else rp.waypoints(points, x.rotation)
              for points, x in zip((loop, other), start, strict=True)]  # fmt: skip
    path = rp.several_paths(task, q0, listed)
    motion = rp.follow(laws[0], path, q0, cycles=1, steps=100, period=3.0)
    own = own_loop(motion, laws)
    assert own is not None and [f["hand"] for f in own["frames"]] == ["left hand", "right hand"]
    assert own["path"] == ([0, 1] if mirrored else [0, None])
    Q = q0 + rng.uniform(-0.1, 0.1, (10, task.n))
    X = rng.normal(size=(10, task.m))
    paths = [loop.tolist(), None if other is None else other.tolist()]
    found = evaluated(tmp_path, own, Q, X, paths)
    for q, x, at in zip(Q, X, found["at"], strict=True):
        assert np.allclose(at["p"], task.positions(q[None])[0], atol=1e-12, rtol=0)
        assert np.allclose(at["J"], task.jacobian(q).ravel(), atol=1e-12, rtol=0)
        assert np.allclose(at["e"], task.error(q, start), atol=1e-12, rtol=0)
        for law, v in zip(laws, at["v"], strict=True):
            expected = law.velocity(q, x)
            assert np.abs(v - expected).max() < 1e-11 * np.linalg.norm(expected)
    for law, ends in zip(laws, found["ends"], strict=True):
        motion = rp.follow(law, path, q0, cycles=10, steps=100, period=3.0)
        assert np.abs(motion.q[:: motion.steps] - ends).max() < 1e-8


WELD = Path(__file__).parents[2] / "examples" / "weld_cell.urdf"
ON_PIECE = {
    "torch axis on a positioner": (WELD, "torch", "axis", "workpiece"),
    "torch pose on a positioner": (WELD, "torch", "pose", "workpiece"),
    "nozzle xy on a turntable": (WELD.with_name("rail_cell.urdf"), "nozzle", "xy", "table"),
    "a fixed torch": (WELD, "workpiece", "pose", "torch"),
    "one arm carries the piece": ("baxter", "left_gripper", "pose", "right_gripper"),
    "beside the elbow of the same arm": ("panda", "panda_hand_tcp", "position", "panda_link2"),
}


@pytest.mark.parametrize("name", some(list(ON_PIECE), "torch axis on a positioner"))
def test_the_page_computes_on_a_workpiece_as_python_does(name: str, tmp_path: Path) -> None:
    """57: relative poses, J, errors, ẋ and ten cycles' ends, at random configurations."""
    if NODE is None:
        assert os.environ.get("CI") != "true", "node is not installed"
        pytest.skip("node is not installed")
    robot, frame, kind, piece = ON_PIECE[name]
    task = rp.Robot.load(robot).task(frame, kind, on=piece)
    rng = np.random.default_rng(3)
    q0 = task.reference + rng.uniform(-0.1, 0.1, task.n)
    q0 = np.clip(q0, task.lower + 0.2, task.upper - 0.2)
    basis = rp.Polynomial(q0, 1, 0.7)
    N = nullspace(task.jacobian(q0))
    A = np.linalg.lstsq(basis.gradients(q0[None])[0], N, rcond=None)[0]
    control = rp.RepeatableInverse(task, basis.weighted(A))
    laws = (rp.Pseudoinverse(task), control)
    start = task.placement(q0)
    points = drawn(task, q0)
    path = rp.waypoints(points, start.rotation)
    motion = rp.follow(laws[0], path, q0, cycles=1, steps=100, period=3.0)
    own = own_loop(motion, laws)
    assert own is not None
    Q = q0 + rng.uniform(-0.1, 0.1, (10, task.n))
    X = rng.normal(size=(10, task.m))
    found = evaluated(tmp_path, own, Q, X, [points.tolist()])
    for q, x, at in zip(Q, X, found["at"], strict=True):
        assert np.allclose(at["p"], task.placement(q).translation, atol=1e-12, rtol=0)
        assert np.allclose(at["J"], task.jacobian(q).ravel(), atol=1e-12, rtol=0)
        assert np.allclose(at["e"], task.error(q, start), atol=1e-12, rtol=0)
        for law, v in zip(laws, at["v"], strict=True):
            expected = law.velocity(q, x)
            assert np.abs(v - expected).max() < 1e-11 * np.linalg.norm(expected)
    for law, ends in zip(laws, found["ends"], strict=True):
        motion = rp.follow(law, path, q0, cycles=10, steps=100, period=3.0)
        assert np.abs(motion.q[:: motion.steps] - ends).max() < 1e-8


BROKEN = """
import { brokenLimits } from "./own/sentence.js";
const run = ([under, cycle, lost]) =>
  ({ data: { under, broken: cycle && { cycle, words: "j off" }, lost: lost || Infinity } });
const cases = [[["A", 2], ["B", 2]], [["A", 2], ["B", 3]], [["A", 2], ["B"]], [["A"], ["B", 2]],
               [["A", 2]], [["A", 2, 1], ["B", 2, 1]]];
const words = cases.map((runs) => brokenLimits(runs.map(run)).map(({ under }) => under));
console.log(JSON.stringify(words));
"""


@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_a_limit_that_both_controls_break_is_said_of_both(tmp_path: Path) -> None:
    """A note for each came one below the other, and a small window cut off the second."""
    shutil.copytree(SCRIPTS.parent, tmp_path, dirs_exist_ok=True)
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "broken.js").write_text(BROKEN)
    found = subprocess.run([str(NODE), "broken.js"], cwd=tmp_path, capture_output=True, check=True)
    each = ["A", "B"]
    assert json.loads(found.stdout) == [["either control"], each, each, each, ["A"], each]


def test_what_the_page_cannot_compute_has_no_ring(tmp_path: Path) -> None:
    task, q0 = arm("planar3r xy")
    plain = rp.Pseudoinverse(task)

    class Mine:
        def value(self, q: Any) -> Any:
            return np.array([q[0]])

        def gradient(self, q: Any) -> Any:
            return np.eye(3)[:, :1]

        def gradients(self, Q: Any) -> Any:
            return np.tile(np.eye(3)[:, :1], (len(Q), 1, 1))

    own = rp.RepeatableInverse(task, Mine())
    custom = rp.CustomInverse(task, lambda q: np.linalg.pinv(task.jacobian(q)))
    assert numbers(task, q0, [plain]) is not None
    assert numbers(task, q0, [plain, own]) is None
    assert numbers(task, q0, [custom, plain]) is None
    for motions in ({"mine": rp.follow(custom, rp.circle(task, q0, 0.1), q0, cycles=1)},):
        scene, _, _ = read(rp.animation(motions).page)
        assert scene["own"] is None


# ---- in a browser --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def study() -> rp.Study:
    return study_of("planar3r", 2, 100)


@pytest.fixture(scope="module")
def page(study: rp.Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return rp.animation(study).save(tmp_path_factory.mktemp("own") / "page.html")


def hand(driver: Any) -> tuple[int, int]:
    """Where the first ring is, after it was put there."""
    driver.execute_script("repctl.placed()")
    ring = driver.find_element("class name", "ring").rect
    assert ring["width"] == pytest.approx(ring["height"]) and ring["width"] >= 44
    return round(ring["x"] + ring["width"] / 2), round(ring["y"] + ring["height"] / 2)


def drag(driver: Any, way: Sequence[tuple[float, float]], kind: str) -> None:
    """Take the ring by a real pointer, lead it along a way from there, px, and let go."""
    from selenium.webdriver.common.actions.action_builder import ActionBuilder
    from selenium.webdriver.common.actions.pointer_input import PointerInput

    x, y = hand(driver)
    actions = ActionBuilder(driver, mouse=PointerInput(kind, f"a {kind}"), duration=5)
    actions.pointer_action.move_to_location(x, y).pointer_down()
    for dx, dy in way:
        actions.pointer_action.move_to_location(round(x + dx), round(y + dy))
    actions.pointer_action.pointer_up()
    actions.perform()


def wait_until_computed(driver: Any) -> None:
    """What follows a gesture is computed in slices between pictures."""
    deadline = time.monotonic() + 60
    while driver.execute_script("return Boolean(repctl.own.work)"):
        assert time.monotonic() < deadline, "the page still computes after 60 s"
        time.sleep(0.02)


def said(driver: Any) -> str:
    """The sentence, without its clause on what is proved, see test_page_phone.py."""
    wait_until_computed(driver)
    return driver.execute_script(
        "return [...document.getElementById('verdict').childNodes].filter((node) =>"
        " node.className !== 'aside proof').map((node) => node.textContent).join('')"
    )


ENDS = """
const { report: { result: { motions } }, chain: { n } } = repctl.own, end = (Q, row) => Array.from(Q.slice(row * n, (row + 1) * n));
return motions.map(({ Q, perCycle }) => Array.from({ length: 11 }, (_, c) => end(Q, c * perCycle)));
"""  # noqa: E501

ARC = [(30 * (np.cos(a) - 1), 30 * np.sin(a)) for a in np.linspace(0, 5, 14)[1:]]


@pytest.mark.parametrize("kind", some(["mouse", "touch"], "mouse"))
def test_a_loop_is_drawn_by_a_pointer(
    driver: Any, page: Path, study: rp.Study, kind: str, tmp_path: Path
) -> None:
    """The page says after ten cycles what a study of its points says, and its address keeps it."""
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    boxes = (
        "return JSON.stringify(['footer', '#readings', '#tools'].map((name) =>"
        " document.querySelector(name).getBoundingClientRect()))"
    )
    before = driver.execute_script(boxes)
    drag(driver, ARC, kind)
    wait_until_computed(driver)
    assert driver.execute_script("return repctl.own.state") == "own"
    assert said(driver).startswith("After one cycle of your loop the hand is back in x and y. ")
    assert driver.execute_script("return repctl.time") == 1
    assert driver.execute_script(boxes) == before, "nothing moves"
    points = np.array(driver.execute_script("return repctl.own.loops.points"))
    assert len(points) <= 42 and np.array_equal(points[0], points[-1])
    ends = driver.execute_script(ENDS)
    task, q0 = study.task, study.q0
    path = rp.waypoints(points, task.placement(q0).rotation)
    laws = (rp.Pseudoinverse(task), study.design.inverse)
    for law, found, most in zip(laws, ends, (1e-6, 1e-8), strict=True):
        motion = rp.follow(law, path, q0, cycles=10, steps=100)
        assert np.abs(motion.q[:: motion.steps] - found).max() < most
    if kind == "touch":
        return
    text = driver.execute_script("return loopCsv(repctl.own.loops)")
    (tmp_path / "loop.csv").write_text(text, "utf-8")
    problem = rp.Problem("planar3r", path=str(tmp_path / "loop.csv"), start=q0)
    again = rp.animation(rp.study(problem, cycles=10, steps=100, degree=1)).page
    (verdict,) = re.findall(r'<p id="verdict">(.*?)</p>', again)
    (speed,) = re.findall(r'<p id="notes"><span>(.*?cycles\.)', again)
    told = re.sub("<[^>]*>", "", verdict).partition(". ")[2]
    assert told
    again = "repctl.placed(); repctl.own.repeat(); return repctl.time"
    assert driver.execute_script(again) == 1, "on from the end of cycle 1"
    driver.execute_script("repctl.seek(10); repctl.own.report.say(10)")
    told += " Limits are checked, collisions are not."
    assert said(driver).partition(". ")[2] == told
    notes = driver.execute_script("return document.getElementById('notes').textContent")
    # the same words; samples differ, and with them the last digit
    digits = r"\d[\d.]*(?=\N{NO-BREAK SPACE}%)"
    alike = re.escape(re.sub(digits, "#", speed)).replace(r"\#", digits)
    assert re.match(alike, notes) and "over all 10 cycles" in speed, notes
    numbers = [[float(v) for v in re.findall(digits, text)] for text in (speed, notes)]
    assert np.allclose(numbers[0], numbers[1][: len(numbers[0])], atol=0.11)
    address = driver.execute_async_script(
        "const done = arguments[0]; repctl.pause(); setTimeout(() => done(location.href), 600)"
    )
    driver.get("about:blank")
    with asleep(driver):
        driver.get(address.replace("&t=10", ""))
    wait_until_drawn(driver, "a shared loop")
    assert driver.execute_script("return repctl.time") == 10
    assert said(driver).partition(". ")[2] == told
    assert errors(driver) == []


_ROOM = """
const top = document.getElementById("panes").getBoundingClientRect().top;
const notes = document.getElementById("notes"), range = document.createRange();
range.selectNodeContents(notes);
const shown = notes.offsetWidth ? [...notes.children] : [];
const words = shown.map((one) => one.getBoundingClientRect());
const lowest = Math.max(...words.map(({ bottom }) => bottom), 0);
return [top, words.length ? notes.getBoundingClientRect().bottom - lowest : 0];
"""

_FITS = """
const { bottom } = document.querySelector("header").getBoundingClientRect();
const verdict = document.getElementById("verdict").getBoundingClientRect();
const more = document.getElementById("more");
return [bottom, verdict.bottom, more.offsetWidth > 0, repctl.own.head.height];
"""


@pytest.mark.slow
@pytest.mark.parametrize("width", [320, 768, 1920])
def test_nothing_moves_when_a_loop_is_drawn(driver: Any, page: Path, width: int) -> None:
    """No band is empty under a study's notes, and the picture stays where it is while a hand is
    led, once it is let go, and with the words of a loop that fails. Notes without room are shown
    by a button, beside the picture, or in portrait above it."""
    from selenium.webdriver import ActionChains

    schemes(driver, width=width, height=1000)
    open_page(driver, page)
    study, empty = driver.execute_script(_ROOM)
    assert empty < 24
    for _ in range(2):
        before, _ = driver.execute_script(_ROOM)
        assert before == study
        x, y = hand(driver)
        led = ActionChains(driver, duration=5)
        led.w3c_actions.pointer_action.move_to_location(x, y).pointer_down()
        for dx, dy in ARC:
            led.w3c_actions.pointer_action.move_to_location(round(x + dx), round(y + dy))
        led.perform()
        driver.execute_script("repctl.placed()")
        assert driver.execute_script("return repctl.own.state") == "leading"
        assert driver.execute_script(_ROOM)[0] == study
        ActionChains(driver).release().perform()
        assert said(driver).startswith("After one cycle of your loop")
        assert driver.execute_script(_ROOM)[0] == study
        driver.execute_script("repctl.seek(10); repctl.own.report.say(10)")
        assert driver.execute_script(_ROOM)[0] == study
    home = np.array(driver.execute_script("return repctl.own.chain.homes[0]"))
    fails = np.array([home, [0.968, 0.047, 0], [2.7, -0.052, 0], [2, 1.612, 0], home])
    driver.execute_script("repctl.own.open({ points: arguments[0] })", fails.tolist())
    assert said(driver).startswith("The usual control fails")
    assert driver.execute_script(_ROOM)[0] == study
    bottom, verdict, folded, head = driver.execute_script(_FITS)
    assert bottom == pytest.approx(head, abs=0.1) == pytest.approx(study, abs=0.5)
    assert verdict <= bottom
    if folded:
        # all of them beside the views, which keep their height, or above them
        driver.find_element("id", "more").click()
        driver.execute_async_script("requestAnimationFrame(arguments[0])")
        box = "return document.getElementById(arguments[0]).getBoundingClientRect().toJSON()"
        views, notes = (driver.execute_script(box, name) for name in ("stage", "notes"))
        if width < 1000:
            assert notes["bottom"] <= views["top"] and views["width"] == width
            assert views["height"] >= 450
        else:
            assert views["top"] == study and views["right"] <= notes["left"] + 1
            assert notes["top"] == pytest.approx(study, abs=1)
            assert notes["bottom"] == pytest.approx(views["bottom"], abs=1)
        driver.find_element("id", "more").click()
        assert driver.execute_script(_FITS)[0] == bottom
    driver.execute_script("repctl.own.leave()")
    assert driver.execute_script(_ROOM)[0] == study and errors(driver) == []


@pytest.mark.slow
def test_a_line_that_closes_the_loop_is_said_where_it_is_seen(driver: Any, page: Path) -> None:
    """It was named while it was under the ring. And what was there before is gone while a hand is
    led, and while its loop is computed: bars and numbers of the study stood beside those of it."""
    schemes(driver, width=768, height=1024)
    open_page(driver, page)
    driver.execute_script("repctl.own.gesture.grab(0, 7, null, 0)")
    lead = (
        "const { chain, gesture, lead } = repctl.own, [x, y, z] = chain.homes[0];"
        "lead.queue.push([x - arguments[0], y, z]); gesture.processQueue(); gesture.draw();"
        "const [a, b] = [chain.homes[0], lead.hand].map((p) => gesture.piece.seen(0, p));"
        "return [Math.hypot(a.x - b.x, a.y - b.y), document.getElementById('notes').textContent]"
    )
    seen = [driver.execute_script(lead, away) for away in (0.02, 0.4, 0.01)]
    long = [px > 30 for px, _ in seen]
    assert long == [False, True, False]
    assert ["The dotted line closes the loop." in words for _, words in seen] == long
    shown = (
        "return ['chart', 'readings', 'clock'].map((id) =>"
        " getComputedStyle(document.getElementById(id)).visibility)"
    )
    assert driver.execute_script(f"repctl.own.release(); {shown}") == 3 * ["hidden"]
    wait_until_computed(driver)
    assert driver.execute_script(shown) == 3 * ["visible"]
    driver.execute_script("repctl.own.leave()")
    assert errors(driver) == []


_OPENING = """
const { own } = repctl, { clock, rings: { rows: [[ring]] } } = own, seen = [];
const look = () => { own.rings.place(); seen.push([clock.time, getComputedStyle(ring.firstChild).display !== "none", ring.classList.contains("pulse")]); };
clock.open(); look();
clock.pass(3.1); for (let k = 0; k < clock.cycles; k++) clock.pass(0.51); look();
clock.pass(9); look(); seen.at(-1).push(clock.playing);
clock.play(true); clock.pass(3.1); clock.pass(0.3 * clock.seconds); look();
clock.play(false); clock.seek(clock.cycles);
return seen;
"""  # noqa: E501


@pytest.mark.slow
def test_it_asks_to_be_dragged_and_points_at_the_elbow(driver: Any, page: Path) -> None:
    """While it opens, which ends where the drift is seen, not while the hand goes round; and the
    callouts point at one place of both arms, where the drift is."""
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    beginning, walked, rests, running = driver.execute_script(_OPENING)
    assert beginning == [2, True, False] and walked == [2, True, True]
    assert rests == [*walked, False]
    assert 0.2 < running[0] < 1 and not running[1]
    spots, elbows = np.array(
        driver.execute_script(
            "return ['spot', 'elbow'].map((what) => repctl.own.arms.map((arm) => (what === 'spot' "
            "? arm.partSpot() : arm.point('elbow', 0, arm.now.frame)).toArray()))"
        )
    )
    assert np.linalg.norm(spots[0, :2] - spots[1, :2]) > 0.03  # links of 1 m
    assert np.linalg.norm((spots - elbows)[:, :2], axis=1).max() < 0.15
    held = driver.execute_script(  # who takes the words takes the ring
        "repctl.seek(0); repctl.placed(); const words = document.querySelector('.ring .drag-me');"
        "const { left, right, top, bottom } = words.getBoundingClientRect();"
        "return right > left && Boolean(document.elementFromPoint("
        "(left + right) / 2, (top + bottom) / 2).closest('.ring'));"
    )
    assert held
    assert errors(driver) == []


_SHIFTS = """
window.shifts = [];
new PerformanceObserver((list) => shifts.push(...list.getEntries().map(({ value }) => value)))
  .observe({ type: "layout-shift" });
"""


def drift_of(answer: str) -> str:
    """What is said of the drift, as where no motion breaks a limit or collides: of a drawn loop,
    the page checks no collisions."""
    _, goes_on, drift = answer.partition("In a simulation that goes on, after 10 cycles ")
    if not goes_on:
        return answer.partition(". ")[2]
    return f"{drift[0].upper()}{drift[1:]}".replace(" is not back: ", " is not: ", 1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ppr", "panda", "xarm7", "baxter", "tiago", "talos", "g1"])
def test_every_kind_of_robot_follows_a_drawn_loop(driver: Any, tmp_path: Path, name: str) -> None:
    """As Python does, with the sentence of a study of the loop; nothing moves meanwhile."""
    problem = rp.study(name, cycles=2, steps=200, degree=1)
    page = rp.animation(problem).save(tmp_path / "page.html")
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    hand(driver)
    driver.execute_script(_SHIFTS)
    drag(driver, [(dx, -dy) for dx, dy in ARC], "mouse")
    wait_until_computed(driver)
    assert driver.execute_script("return repctl.own.state") == "own", said(driver)
    assert sum(driver.execute_script("return shifts")) < 1e-3
    points = np.array(driver.execute_script("return repctl.own.loops.points"))
    task, q0 = problem.task, problem.q0
    path = rp.waypoints(points, task.placement(q0).rotation)
    laws = (rp.Pseudoinverse(task), problem.design.inverse)
    found = driver.execute_script(ENDS)
    for law, ends, most in zip(laws, found, (1e-6, 1e-8), strict=True):
        motion = rp.follow(law, path, q0, cycles=10, steps=200)
        assert np.abs(motion.q[:: motion.steps] - ends).max() < most
    (tmp_path / "loop.csv").write_text(
        driver.execute_script("return loopCsv(repctl.own.loops)"), "utf-8"
    )
    again = rp.study(
        rp.Problem(name, path=str(tmp_path / "loop.csv"), start=q0), cycles=10, steps=200, degree=1
    )
    (verdict,) = re.findall(r'<p id="verdict">(.*?)</p>', rp.animation(again).page)
    driver.execute_script("repctl.own.report.say(10)")
    told = re.sub("<[^>]*>", "", verdict)
    # where the arm could not follow all that was drawn, that is said first
    failed = driver.execute_script("return Boolean(repctl.own.scene.failure)")
    note = (
        "const all = [...document.getElementById('notes').children];"
        "const plain = all.findIndex((note) => !note.classList.contains('bad'));"
        "return all.slice(0, plain + 1).map((note) => note.textContent).join('')"
    )
    answer = driver.execute_script(note) if failed else said(driver)
    caution = "" if failed else " Limits are checked, collisions are not."
    assert drift_of(answer) == drift_of(told) + caution and drift_of(told)
    broken = [re.findall(r"(\w+) leaves its range in cycle (\d+)", one) for one in (answer, told)]
    assert broken[0] == broken[1]
    assert errors(driver) == []


@pytest.mark.slow
def test_a_loop_is_drawn_by_keys_and_left_again(driver: Any, page: Path) -> None:
    """A line there and back encloses nothing, which is said; Escape goes back to the study."""
    from selenium.webdriver.common.keys import Keys

    schemes(driver, width=900, height=700)
    open_page(driver, page)
    study = said(driver)
    hand(driver)
    ring = driver.find_element("class name", "ring")
    ring.send_keys(Keys.ARROW_LEFT * 6 + Keys.ENTER)
    assert "encloses nothing: 0 from the start" in said(driver)
    ring.send_keys(Keys.ARROW_LEFT * 6 + Keys.ARROW_UP * 6 + Keys.ENTER)
    assert "The elbow is not: " in said(driver) or "drifted in one cycle" in said(driver)
    driver.find_element("id", "back").click()
    assert said(driver) == study and driver.execute_script("return repctl.time") == 2
    ring.send_keys(Keys.ARROW_UP * 40 + Keys.ARROW_UP * 60)
    driver.execute_script("repctl.own.gesture.processQueue(); repctl.own.gesture.draw()")
    assert "Go another way, or let go." in said(driver)
    ring.send_keys(Keys.ESCAPE)
    assert said(driver) == study and errors(driver) == []
    # while the slider leads, a key at the ring takes the hand
    driver.execute_script("repctl.own.elbow.slide(2)")
    ring.send_keys(Keys.ENTER)
    assert said(driver).startswith("Draw a loop by the arrow keys") and errors(driver) == []
    ring.send_keys(Keys.ESCAPE)
    assert said(driver) == study
    # a finger leads the hand, too; the slow test compares what follows with Python
    drag(driver, ARC, "touch")
    assert said(driver).startswith("After one cycle of your loop the hand is back in x and y. ")
    assert driver.execute_script("return repctl.own.state") == "own" and errors(driver) == []


@pytest.mark.slow
def test_the_proved_radius_is_drawn_and_said(driver: Any, page: Path, study: rp.Study) -> None:
    """A loop within it is proved to close; one beyond it is said to be beyond."""
    closes = study.design.proof.closes
    assert closes.metres > 0.02 and np.array_equal(closes.start, study.q0)
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    proved = driver.execute_script("return repctl.own.chain.proved")
    assert 0.9 * closes.metres < proved <= closes.metres
    notes = "return document.getElementById('notes').textContent"
    small, large = (
        [[share * x * proved, share * y * proved] for x, y in ((1, 0), (1, 1), (0, 1))]
        for share in (0.5, 2)
    )
    home = driver.execute_script("return repctl.own.chain.homes[0]")
    for way, words in (
        (small, "Proved: after this loop, the repeatable arm is back exactly."),
        (large, "This loop goes farther, so it was computed"),
    ):
        points = [home, *([home[0] + x, home[1] + y, home[2]] for x, y in way), home]
        driver.execute_script("repctl.own.open({ points: arguments[0] })", points)
        wait_until_computed(driver)
        assert words in driver.execute_script(notes)
        for q in np.reshape(driver.execute_script(ENDS), (2, 11, -1))[1]:
            assert np.abs(q - study.q0).max() < 1e-9
    driver.execute_script("repctl.own.leave(); repctl.own.gesture.grab(0, null)")
    assert "Within the pale disc" in driver.execute_script(notes)
    driver.execute_script("repctl.own.leave()")
    assert errors(driver) == []


@pytest.mark.slow
def test_a_loop_close_to_a_singularity_is_kept(driver: Any, page: Path, study: rp.Study) -> None:
    """28.2: where twice the steps lead J⁺ elsewhere: the critical place is marked, the usual arm
    goes as far, the repeatable one all cycles as Python says; nothing of the study is left."""
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    home = np.array(driver.execute_script("return repctl.own.chain.homes[0]"))
    plain = rp.Pseudoinverse(study.task)
    corners = [[0.968, 0.047, 0], [2.7, -0.052, 0], [2, 1.612, 0]]
    points = np.array([home, *corners, home])
    path = rp.waypoints(points, study.task.placement(study.q0).rotation)
    once, twice = (rp.follow(plain, path, study.q0, cycles=10, steps=n) for n in (100, 200))
    gaps = np.linalg.norm(once.q[:: once.steps] - twice.q[:: twice.steps], axis=1)
    first = 1 + int(np.argmax(gaps[1:] > 0.01 * once.drift))  # cycle from which on they differ
    assert gaps[first] > 0.01 * once.drift[first - 1]
    driver.execute_script("repctl.own.open({ points: arguments[0] })", points.tolist())
    told = said(driver)
    assert told.startswith(
        f"The usual control fails in cycle {first}, close to a singularity, at the red ball. "
    )
    assert "repeatable control brings every part back: 0 from its start after 10 cycles." in told
    assert "circle" not in driver.find_element("id", "title").text
    label, other = (
        [
            pane.find_element("css selector", ".mark b"),
            pane.find_element("css selector", ".mark small"),
        ]
        for pane in driver.find_elements("class name", "pane")
    )
    assert [node.text for node in label] == [
        "Usual control fails here",
        f"close to a singularity, in cycle {first}",
    ]
    assert not any(node.is_displayed() for node in other)
    cut, mark, drawn = driver.execute_script(
        "const { own } = repctl, [arm] = own.arms; own.clock.seek(10);"
        "return [arm.data.lost, arm.past.node.position.toArray(), arm.past.node.visible]"
    )
    # the mark is on the loop, where the arm of three equal links is nearly folded flat
    assert drawn and first - 1 < cut < first and abs(np.linalg.norm(mark[:2]) - 1) < 0.15
    ends = np.array(driver.execute_script(ENDS))
    assert np.abs(once.q[:: once.steps][:first] - ends[0][:first]).max() < 1e-6
    J = study.task.jacobian(ends[0][first])
    assert np.linalg.svd(J)[1].min() < 0.15
    assert np.ptp(ends[0][first:], axis=0).max() == 0  # it stands still from there on
    closed = rp.follow(study.design.inverse, path, study.q0, cycles=10, steps=100)
    assert np.abs(closed.q[:: closed.steps] - ends[1]).max() < 1e-8
    shown = driver.execute_script(
        "return [...document.querySelectorAll('.pane:first-child .callout:not(.mark)')]"
        ".map((n) => getComputedStyle(n).visibility)"
    )
    assert set(shown) == {"hidden"}
    rows = driver.find_elements("class name", "reading")
    readings = [row.get_attribute("textContent") for row in rows]
    assert "not known" in readings[0] and readings[1].endswith(": 0")
    # to 1 cm from the end of the arm's reach both can go, to 1 mm none
    angle = np.arctan2(home[1], home[0])
    for far, lost in ((2.99, False), (2.999, True)):
        corners = [
            [far * np.cos(angle), far * np.sin(angle), home[2]],
            [0.999 * far * np.cos(angle + 0.3), 0.999 * far * np.sin(angle + 0.3), home[2]],
        ]
        points = np.round([home, *corners, home], 4)
        driver.execute_script("repctl.own.open({ points: arguments[0] })", points.tolist())
        wait_until_computed(driver)
        assert driver.execute_script("return repctl.own.state") == "own"
        assert said(driver).startswith("No arm can follow your loop to its end: ") == lost
    assert errors(driver) == []


@pytest.mark.slow
def test_the_elbow_slider_keeps_the_hand_and_chooses_the_leaf(
    driver: Any, page: Path, study: rp.Study
) -> None:
    """28.11: within limits, the hand at rest to 1e-6; let go, and both arms follow the study's path
    from there, as rp.follow from that start does; the address gives it again."""
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    task, q0 = study.task, study.q0
    qs = np.array(
        driver.execute_script("return repctl.own.elbow.selves.qs.map((q) => Array.from(q))")
    )
    zero = driver.execute_script("return repctl.own.elbow.selves.zero")
    assert len(qs) > 20 and np.array_equal(qs[zero], q0)
    assert np.abs(task.positions(qs) - task.positions(q0[None])).max() < 1e-6
    assert (task.limit_margin(qs) > 0).all()
    levels = np.array([study.design.inverse.leaf(q)[0] for q in qs])
    assert (np.diff(levels) > 0).all() or (np.diff(levels) < 0).all()  # one leaf per place
    slider = (
        "const input = document.getElementById('elbow'), [value, kind] = arguments;"
        "input.value = value; input.dispatchEvent(new Event(kind, { bubbles: true }))"
    )
    # under the pointer, the part that it moves is named; then again that of the study
    names = [
        driver.execute_script(
            "const slider = document.getElementById('elbow'), [kind] = arguments;"
            "slider.dispatchEvent(new Event(kind)); const { own } = repctl;"
            "return [document.querySelector('.callout b').textContent, own.scene.part,"
            "own.elbow.part,"
            "own.arms.map((arm) => arm.part)]",
            kind,
        )
        for kind in ("none", "pointerenter", "focus", "pointerleave", "blur")
    ]
    assert [told for _, told, *_ in names[1:3]] == 2 * [names[1][2]]
    assert all(told.startswith(f"{names[1][2]} ") for told, *_ in names[1:3])
    assert names[0] == names[3] == names[4]
    driver.execute_script(slider, 12, "input")
    assert "at rest while the arm moves" in said(driver)
    # named after the part that moves most, which is outlined and whose displacement is told
    told = driver.execute_script(
        "const [name, off] = ['elbow-name', 'elbow-off'].map((id) => document.getElementById(id)),"
        "{ arms: [arm], elbow: { part } } = repctl.own,"
        "callout = document.querySelector('.callout b');"
        "return [name.textContent, off.textContent, part, callout.textContent, arm.partOff(),"
        "Math.max(...arm.off), arm.rims.filter(({ visible }) => visible).length]"
    )
    assert told[0] == "Move the elbow" and told[3] == f"{told[2]} {told[1]}", told
    assert told[4] == told[5] > 0.02 and told[6] >= 1, told
    spots = driver.execute_script(
        "return repctl.own.arms.map((arm) => [arm.point('tip', 0, 1), arm.point('elbow', 0, 1),"
        "arm.point('elbow', 0, 0)].map((p) => p.toArray()))"
    )
    for tip, elbow, ghost in np.array(spots):  # both panes; the ghost stays at the start
        assert np.allclose(tip, task.positions(q0[None])[0], atol=1e-6)
        assert np.linalg.norm(elbow - ghost) > 0.02
    driver.execute_script(slider, 12, "change")
    assert said(driver).startswith("After one cycle of the path the hand is back in x and y. ")
    ends = np.array(driver.execute_script(ENDS))
    path = rp.waypoints(study.path.points(), task.placement(q0).rotation)
    laws = (rp.Pseudoinverse(task), study.design.inverse)
    for law, found, most in zip(laws, ends, (1e-6, 1e-8), strict=True):
        motion = rp.follow(law, path, qs[zero + 12], cycles=10, steps=100)
        assert np.abs(motion.q[:: motion.steps] - found).max() < most
    assert np.abs(ends[1] - qs[zero + 12]).max() < 1e-6
    address = driver.execute_async_script(
        "const done = arguments[0]; setTimeout(() => done(location.href), 600)"
    )
    assert "elbow=12" in address and "loop=" not in address
    driver.get("about:blank")
    with asleep(driver):
        driver.get(address)
        wait_until_drawn(driver, "a shared elbow")
    assert np.abs(np.array(driver.execute_script(ENDS)) - ends).max() < 1e-12
    driver.execute_script("repctl.own.leave()")
    assert driver.execute_script("return document.getElementById('elbow').value") == "0"
    assert errors(driver) == []


@pytest.fixture(scope="module")
def two_hands(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a study of both hands of Baxter without its meshes."""
    text = rp.Robot.load("baxter").description.xml
    folder = tmp_path_factory.mktemp("two")
    bones = folder / "bones.urdf"
    bones.write_text(re.sub(r"(?s)<(visual|collision)\b.*?</\1>", "", text), "utf-8")
    robot = rp.Robot.load(bones)
    wanted = rp.Problem(robot, frame=["left_gripper", "right_gripper"], region=0.1)
    return rp.animation(rp.study(wanted, cycles=2, steps=60, degree=1)).save(folder / "page.html")


_WHAT_OVERLAPS = """
const found = [], seen = (n) => n.offsetWidth && getComputedStyle(n).visibility !== "hidden";
for (const pane of document.querySelectorAll(".pane")) {
  const frame = pane.getBoundingClientRect(), all = (what) => [...pane.querySelectorAll(what)];
  const boxes = all(".arm-label, .callout, .drag-me, .ring").filter(seen).map((n) => {
    const { left, top, right, bottom } = n.getBoundingClientRect();
    const inset = n.matches(".ring") ? (right - left) / 5 : 0;
    return { name: n.className + " " + n.textContent, node: n,
      at: [left + inset, top + inset, right - inset, bottom - inset] };
  });
  boxes.forEach(({ name, at: a }, k) => {
    if (a[0] < frame.left || a[2] > frame.right) found.push(name + " is cut");
    for (const { name: other, at: b } of boxes.slice(k + 1))
      if (a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]) found.push([name, other]);
  });
  for (const leader of all(".leader").filter((n) => seen(n) && !n.hidden)) {
    const [x, y, toX, toY] = leader.line;
    for (let s = 0.04; s < 0.97; s += 0.02)
      for (const { name, at: [l, t, r, b] } of boxes) {
        const u = frame.left + x + s * (toX - x), v = frame.top + y + s * (toY - y);
        if (leader.matches(".gap") && name.startsWith("ring")) continue;
        if (u > l && u < r && v > t && v < b)
          found.push([leader.className, name]);
      }
  }
}
return [...new Set(found.map(String))];
"""


def nothing_overlaps(driver: Any) -> None:
    for cycle in (0, 1, 2):
        driver.execute_script("repctl.seek(arguments[0]); repctl.placed()", cycle)
        assert driver.execute_script(_WHAT_OVERLAPS) == [], cycle
    assert errors(driver) == []


@pytest.mark.slow
def test_rings_lines_and_labels_do_not_overlap(driver: Any, two_hands: Path) -> None:
    """28.1: of two hands, at the end of every cycle, in every pane; nothing is cut, of a window
    that was made small, either."""
    schemes(driver, width=900, height=700)
    open_page(driver, two_hands)
    nothing_overlaps(driver)
    schemes(driver, width=320, height=640)
    nothing_overlaps(driver)


@pytest.mark.slow
@pytest.mark.parametrize("size", [(720, 620), (1280, 800), (390, 844), (320, 640)])
def test_nothing_overlaps_at_any_size(driver: Any, two_hands: Path, size: tuple[int, int]) -> None:
    schemes(driver, width=size[0], height=size[1])
    open_page(driver, two_hands)
    nothing_overlaps(driver)


_IN_THEIR_PANES = """
repctl.placed();
return [...document.querySelectorAll(".pane")].flatMap((pane) => {
  const { left, right, top, bottom } = pane.getBoundingClientRect();
  return [...pane.querySelectorAll(".ring")].map((ring) => {
    const box = ring.getBoundingClientRect();
    const x = (box.left + box.right) / 2, y = (box.top + box.bottom) / 2;
    return x > left && x < right && y > top && y < bottom;
  });
});
"""

_STROKE_BEYOND = """
const { own } = repctl, [x, y, z] = own.chain.homes[0];
own.gesture.grab(0, 7, null, 0);
own.lead.queue.push([x, y, z + 0.02], [x + 9, y, z]);
own.gesture.processQueue();
"""


@pytest.mark.slow
@pytest.mark.parametrize("when", ["turned", "failed", "leading"])
def test_rings_stay_in_their_panes_when_notes_open(driver: Any, two_hands: Path, when: str) -> None:
    """On a phone: of a view that was turned, after a loop that failed, and while a hand is led.

    Hands were beside a narrower pane, and their rings in the pane of the other arm.
    """
    schemes(driver, width=390, height=844)
    open_page(driver, two_hands)
    panes = "return document.querySelector('.pane').getBoundingClientRect().width"
    wide = driver.execute_script(panes)
    if when == "turned":
        driver.execute_script("repctl.turn(0.02, 0)")
    else:
        driver.execute_script(_STROKE_BEYOND)
    if when == "failed":
        driver.execute_script("repctl.own.release()")
        wait_until_computed(driver)
    assert all(driver.execute_script(_IN_THEIR_PANES))
    driver.execute_script("document.getElementById('noted').click()")
    driver.execute_async_script("setTimeout(() => arguments[0](true), 500)")
    if when == "leading":
        driver.execute_script("repctl.own.release()")
        wait_until_computed(driver)
        assert driver.execute_script("return repctl.own.scene.failure")
    assert driver.execute_script(panes) < 0.6 * wide
    assert all(driver.execute_script(_IN_THEIR_PANES))
    assert errors(driver) == []


_ZOOM = """
const { eye, viewer } = repctl.own.gesture.panes;
return [eye.where()[6], viewer.camera.zoom, document.querySelector(".pane").clientWidth];
"""


@pytest.mark.slow
def test_a_link_leaves_out_what_a_narrow_pane_did(driver: Any, two_hands: Path) -> None:
    """The zoom of a pane beside notes went into the address, also after another turn of the view,
    and stayed when the notes were closed."""
    schemes(driver, width=390, height=844)
    open_page(driver, two_hands)
    driver.execute_script("repctl.turn(0.02, 0)")
    link, zoom, wide = driver.execute_script(_ZOOM)
    assert link == zoom

    def notes() -> None:
        driver.execute_script("document.getElementById('noted').click()")
        driver.execute_async_script("setTimeout(() => arguments[0](true), 500)")

    notes()
    narrowed = driver.execute_script(_ZOOM)
    assert narrowed[0] == pytest.approx(link) and narrowed[1] < 0.8 * zoom
    assert narrowed[2] < 0.6 * wide
    driver.execute_script("repctl.turn(0.02, 0)")
    notes()
    assert driver.execute_script(_ZOOM) == pytest.approx([link, zoom, wide])
    assert errors(driver) == []


_LEAD = """
const { own } = repctl;
own.loops.mirrored = arguments[0];
own.gesture.grab(0, null, null, 1);
const [right, up] = own.gesture.axes(), home = own.chain.homes[1];
for (const [x, y] of [[1, 0], [1, 1], [0, 1]])
  own.lead.queue.push(
    home.map((v, i) => v + 0.05 * (x * right.getComponent(i) + y * up.getComponent(i))));
own.release();
"""


@pytest.mark.slow
@pytest.mark.parametrize("mirrored", some([False, True], True))
def test_a_loop_is_drawn_with_either_hand(
    driver: Any, two_hands: Path, mirrored: bool, tmp_path: Path
) -> None:
    """28.10: a ring at each hand; the other rests or mirrors it; link and CSV give it again."""
    schemes(driver, width=900, height=700)
    open_page(driver, two_hands)
    caption = driver.find_element("id", "caption").get_attribute("textContent")
    assert "together 14 joints, 2 redundant" in caption
    slider = driver.find_element("id", "elbow-name").get_attribute("textContent")
    assert re.match("Move the (left|right) ", slider), slider
    # at first it moves the arm that drifts most, whose name the menu says: it moved the other one
    part, first, reached, offered = driver.execute_script(
        "const { elbow, scene: { part } } = repctl.own;"
        "const reached = [0, 1].map((k) => { elbow.stand(0, k); return elbow.reached(part); });"
        "elbow.stand(0, elbow.first);"
        "return [part, elbow.first, reached, [...document.getElementById('level').options].map("
        "({ text }) => text)]"
    )
    side = part.split()[0]
    assert side in ("left", "right") and slider.startswith(f"Move the {side} ")
    assert first == int(np.argmax(reached)) and min(reached) < max(reached)
    assert offered[first].startswith(f"{side} ") and offered[first].endswith("of 2")
    # an address names the level where it is not the one that is meant without a name: the first
    # with a moved slider, as in addresses from before the slider chose
    written = driver.execute_script(
        "const { own } = repctl, found = [], { state } = own;"
        "for (const elbow of [0, 2]) for (const level of [0, 1]) {"
        "  own.state = 'own'; own.elbow.stand(elbow, level);"
        "  const part = own.addressParts().find((word) => word.startsWith('level='));"
        "  const read = part ? Number(part.slice(6)) - 1 : own.elbow.unnamed(elbow);"
        "  found.push([elbow, level, read, !part]);"
        "} own.state = state; own.elbow.stand(0, own.elbow.first); return found"
    )
    assert all(level == read for _, level, read, _ in written)
    assert [unnamed for elbow, level, _, unnamed in written if elbow and not level] == [True]
    # at the end of a cycle each hand has its distance, and within one none
    for cycles, seen in ((2, True), (1.5, False)):
        driver.execute_script("repctl.seek(arguments[0]); repctl.placed()", cycles)
        callouts = driver.find_elements("css selector", ".callout.hand")
        assert [e.is_displayed() for e in callouts] == 4 * [seen]
        lines = driver.find_elements("css selector", ".leader.hand")
        assert seen or not any(e.is_displayed() for e in lines)
        assert [e.get_attribute("textContent") for e in callouts] == 2 * [
            f"{hand} hand 0 from its start" for hand in ("left", "right")
        ]
    assert driver.execute_script("return repctl.own.rings.rows.map((row) => row.length)") == [2, 2]
    driver.execute_script(_LEAD, mirrored)
    assert said(driver).startswith("After one cycle of your loop both hands are back. "), said(
        driver
    )
    homes = np.array(driver.execute_script("return repctl.own.chain.homes"))
    paths = driver.execute_script("return repctl.own.loops.paths()")
    assert (paths[0] is not None) == mirrored and np.allclose(paths[1][0], homes[1])
    if mirrored:  # in the plane between the hands: equal ways, and the middle stays in it
        a, b = (np.array(path) - home for path, home in zip(paths, homes, strict=True))
        assert np.allclose(np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1))
        across = (homes[0] - homes[1]) / np.linalg.norm(homes[0] - homes[1])
        assert np.allclose((a + b) @ across, 0, atol=1e-12)
        assert np.allclose(np.cross(a - b, across), 0, atol=1e-12)
    file = tmp_path / "loop.csv"
    file.write_text(driver.execute_script("return loopCsv(repctl.own.loops)"), "utf-8")
    task = rp.Robot.load("baxter").task(["left_gripper", "right_gripper"])
    start = np.array(driver.execute_script("return Array.from(repctl.own.chain.start)"))
    told = rp.Problem(task, start=start, path=str(file)).path.paths
    for path, drawn, home in zip(told, paths, homes, strict=True):
        corners = [home] if drawn is None else drawn
        near = path.points() if path.length else home[None]
        for corner in np.array(corners):
            assert np.linalg.norm(near - corner, axis=1).min() < 2e-3
    axe = pytest.importorskip("axe_selenium_python").Axe(driver)
    axe.inject()
    found = axe.run(options="{rules: {dlitem: {enabled: false}}}")["violations"]
    assert found == [], [(v["id"], [n["html"] for n in v["nodes"]]) for v in found]
    ends = np.array(driver.execute_script(ENDS))
    assert np.abs(ends[1] - ends[1][0]).max() < 1e-6
    tips = "const { own } = repctl; return own.arms.map((arm) => [0, 1].map((f) => arm.handOff(f)))"
    assert np.max(driver.execute_script(tips)) < 1e-5
    address = driver.execute_async_script(
        "const done = arguments[0]; setTimeout(() => done(location.href), 600)"
    )
    assert "hand=2" in address and ("mirror=1" in address) == mirrored
    driver.get("about:blank")
    with asleep(driver):
        driver.get(address)
        wait_until_drawn(driver, "a shared loop of two hands")
    again = np.array(driver.execute_script(ENDS))
    assert np.abs(again - ends).max() < 1e-3  # points are kept to 0.1 mm
    assert driver.execute_script("return repctl.own.loops.mirrored") == mirrored
    # one hand alone: the other rests, which the slow test compares with Python
    driver.execute_script(_LEAD, False)
    assert said(driver).startswith("After one cycle of your loop both hands are back. ")
    assert driver.execute_script("return repctl.own.loops.paths()[0]") is None
    assert errors(driver) == []


@pytest.mark.slow
def test_each_hand_keeps_its_loop(driver: Any, two_hands: Path, tmp_path: Path) -> None:
    """The loop of one hand silently replaced that of the other. Both are followed at once, by the
    page as by rp.follow; title, link and CSV have both."""
    schemes(driver, width=1280, height=760)
    open_page(driver, two_hands)
    driver.execute_script(_LEAD.replace("1);\nconst", "0);\nconst").replace("homes[1]", "homes[0]"))
    wait_until_computed(driver)
    first = driver.execute_script("return repctl.own.loops.points")
    hint, lines = driver.execute_script(
        _LEAD.replace("own.release();", "own.gesture.processQueue();")
        + "return [document.getElementById('notes').textContent,"
        "own.arms.map((arm) => arm.paths.children.length)]"
    )
    assert "The left hand keeps its loop." in hint and min(lines) > 0  # which is still drawn
    driver.execute_script("repctl.own.release()")
    assert said(driver).startswith("After one cycle of your loops both hands are back. ")
    title = driver.find_element("id", "title").text
    assert re.search(r": your loops, left hand [\d.]+ c?m long, right hand [\d.]+ c?m long$", title)
    for width in (1280, 900, 390):  # it ended in an ellipsis
        schemes(driver, width=width, height=760)
        assert driver.execute_script(
            "const title = document.getElementById('title'), range = document.createRange();"
            "range.selectNodeContents(title); const { right } = range.getBoundingClientRect();"
            "const { textOverflow } = getComputedStyle(title);"
            "return textOverflow === 'clip' && right <= innerWidth &&"
            " title.scrollWidth <= title.clientWidth"
        )
    schemes(driver, width=1280, height=760)
    paths = [np.array(path) for path in driver.execute_script("return repctl.own.loops.paths()")]
    assert len(paths[0]) == len(paths[1])  # in step, each with the corners of its own
    # a press on a ring draws nothing, and takes nothing away
    driver.execute_script("repctl.own.gesture.grab(0, 7, null, 0); repctl.own.release()")
    wait_until_computed(driver)
    assert driver.find_element("id", "title").text == title
    again = driver.execute_script("return repctl.own.loops.paths()")
    assert all(np.array_equal(x, y) for x, y in zip(paths, again, strict=True))
    for points, path in zip((first, driver.execute_script("return repctl.own.loops.points")), paths,
                            strict=True):  # fmt: skip
        assert all(np.linalg.norm(path - p, axis=1).min() < 1e-9 for p in np.array(points))
        sizes = [np.linalg.norm(np.diff(x, axis=0), axis=1).sum() for x in (points, path)]
        assert sizes[0] == pytest.approx(sizes[1])
    task = rp.Robot.load("baxter").task(["left_gripper", "right_gripper"])
    start = np.array(driver.execute_script("return Array.from(repctl.own.chain.start)"))
    ends = np.array(driver.execute_script(ENDS))
    assert np.abs(ends[1] - ends[1][0]).max() < 1e-6  # the repeatable control comes back
    listed = [rp.waypoints(points, x.rotation)
              for points, x in zip(paths, task.placements(start), strict=True)]  # fmt: skip
    both = rp.several_paths(task, start, listed)
    motion = rp.follow(rp.Pseudoinverse(task), both, start, cycles=10, steps=200)
    assert np.abs(motion.q[:: motion.steps] - ends[0]).max() < 1e-4  # with 60 steps on the page
    file = tmp_path / "loop.csv"
    file.write_text(driver.execute_script("return loopCsv(repctl.own.loops)"), "utf-8")
    told = rp.Problem(task, start=start, path=str(file)).path.paths
    for path, drawn in zip(told, paths, strict=True):
        assert path.length == pytest.approx(np.linalg.norm(np.diff(drawn, axis=0), axis=1).sum())
    address = driver.execute_async_script(
        "const done = arguments[0]; setTimeout(() => done(location.href), 600)"
    )
    driver.get("about:blank")
    with asleep(driver):
        driver.get(address)
        wait_until_drawn(driver, "a shared loop of each hand")
    assert np.abs(np.array(driver.execute_script(ENDS)) - ends).max() < 1e-3
    assert driver.find_element("id", "title").text == title
    # at the time of the address, with its words
    assert said(driver).startswith("After one cycle of your loops both hands are back. ")
    assert driver.execute_script("return repctl.own.clock.time") == 1
    # a mirrored loop takes both hands
    driver.execute_script("document.getElementById('mirror').click()")
    assert said(driver).startswith("After one cycle of your loop both hands are back. ")
    assert errors(driver) == []


@pytest.mark.slow
def test_the_best_loop_is_kept(driver: Any, page: Path) -> None:
    """Small loops and ways there and back do not count; the smallest drift does."""
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    size = driver.execute_script("return repctl.own.chain.size")
    home = driver.execute_script("return repctl.own.chain.homes[0]")
    best = (
        "const [points, done] = arguments, { own } = repctl, { report } = own;"
        "own.open({ points }).then(() => {"
        " report.keepBest(); done(report.best && report.best.off); })"
    )

    def drawn(*way: tuple[float, float]) -> list[list[float]]:
        turned = [[home[0] + size * x, home[1] + size * y, home[2]] for x, y in (*way, (0, 0))]
        return [list(home), *turned]

    to, fro = (-0.15, 0.0), (0.1, 0.0)
    for trivial in (
        drawn(to),
        drawn(to, (0, 0), fro),
        drawn((-0.1, 0), (-0.1, 0.1), (-0.1, 0)),
        drawn((-0.02, 0), (-0.02, 0.02)),
    ):
        assert driver.execute_async_script(best, trivial) is None
    large = driver.execute_async_script(best, drawn(to, (-0.15, 0.15), (0, 0.15)))
    small = driver.execute_async_script(best, drawn((-0.1, 0), (-0.1, 0.1), (0, 0.1)))
    assert 1e-3 < small < large
    assert driver.execute_async_script(best, drawn(to, (-0.2, 0.2), (0, 0.2))) == small
    menu = driver.find_element("id", "best").get_attribute("textContent")
    best = menu.removesuffix(" under the usual control after 10 cycles")
    assert best != menu and best.startswith("Your best loop: ")
    notes = driver.find_element("id", "notes").get_attribute("textContent")
    assert "after 10 cycles of which the usual arm is nearest to its start? This loop: " in notes
    assert f"; your best so far: {best.removeprefix('Your best loop: ')}." in notes
    driver.execute_script("repctl.own.leave(); document.getElementById('best').click()")
    wait_until_computed(driver)
    assert driver.execute_script("return repctl.own.state") == "own"
    assert errors(driver) == []


_PAUSES = """
const [points, done] = arguments, { own } = repctl;
let solved = 0;
for (const law of own.laws) {
  const { solve } = law;
  law.solve = function (...what) { solved += 1; return solve.apply(this, what); };
}
const between = [];
for (const work = own.following(points, 1); ;) {
  const before = solved, { done: ended } = work.next();
  between.push(solved - before);
  if (ended) break;
}
const { state } = own, endless = own.run((function* () { for (;;) yield; })());
own.leave();
endless.then(() => done([between, state, own.state, own.work]));
"""


@pytest.mark.slow
def test_a_loop_is_computed_in_slices(driver: Any, page: Path) -> None:
    """Between two pauses at most a piece of a cycle of one arm is computed, and what begins
    meanwhile ends it."""
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    home = driver.execute_script("return repctl.own.chain.homes[0]")
    turn = np.linspace(0, 2 * np.pi, 41)
    points = np.add(home, 0.1 * np.array([np.cos(turn) - 1, np.sin(turn), 0 * turn]).T)
    between, own, after, work = driver.execute_async_script(_PAUSES, points.tolist())
    assert sum(between) > 8000 and max(between) <= 4 * 2 * 100 / 20  # four stages a step
    assert (own, after, work) == ("own", "study", None)
    assert errors(driver) == []


_CURVES = """
const { prototype } = CanvasRenderingContext2D, kept = {}, paths = [], lanes = [0];
for (const name of ["beginPath", "moveTo", "lineTo", "stroke"]) kept[name] = prototype[name];
let ys = [];
prototype.beginPath = function () { ys = []; kept.beginPath.call(this); };
prototype.moveTo = function (x, y) { ys.push(y); kept.moveTo.call(this, x, y); };
prototype.lineTo = function (x, y) { ys.push(y); kept.lineTo.call(this, x, y); };
prototype.stroke = function () {
  if (ys.length > 9) paths.push([lanes.length - 2, ys.length, Math.min(...ys), Math.max(...ys)]);
  else if (ys[0] === ys[1] && ys[0] > lanes.at(-1) && !this.getLineDash().length) lanes.push(ys[0]);
  kept.stroke.call(this);
};
try { document.getElementById("show-joints").click(); repctl.seek(9.5); }
finally { Object.assign(prototype, kept); }
return [paths, lanes];
"""


@pytest.mark.slow
def test_a_joint_that_winds_is_named_and_its_curve_stays_in_its_row(
    driver: Any, page: Path
) -> None:
    """Ten turns of a joint were said nowhere, its curve crossed those of other joints, and those
    of an arm that had failed went on."""
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    x, y, z = driver.execute_script("return repctl.own.chain.homes[0]")
    around = complex(x, y) * np.exp(1j * np.linspace(0, 2 * np.pi, 17))
    points = np.column_stack([around.real, around.imag, np.full(17, z)])
    driver.execute_script("repctl.own.open({ points: arguments[0] })", points.tolist())
    wait_until_computed(driver)
    ends = np.array(driver.execute_script(ENDS))
    turns = np.abs(ends[:, -1] - ends[:, 0]).max(axis=0) / (2 * np.pi)
    name = driver.execute_script("return repctl.own.chain.names")[turns.argmax()]
    assert turns.max() > 5
    assert f"The joint {name} is {turns.max():.1f}\u00a0turns from its start. " in said(driver)
    curves, lanes = driver.execute_script(_CURVES)
    assert len(lanes) == 4 and len(curves) == 6
    for row, _, high, low in curves:  # y points down
        assert lanes[row] <= high < low <= lanes[row + 1]
    # the repeatable arm fails in cycle 1
    assert "repeatable control fails in cycle 1" in said(driver)
    (_, usual, *_), (_, repeatable, *_) = curves[:2]
    assert repeatable < usual / 10
    assert errors(driver) == []


@pytest.mark.slow
def test_the_curves_of_the_joints_are_drawn_once(driver: Any, page: Path) -> None:
    """Not at every instant, but again for another motion, size or scheme."""
    from selenium.webdriver.support.ui import WebDriverWait

    schemes(driver, width=900, height=700)
    open_page(driver, page)
    counted = (
        "const { prototype } = CanvasRenderingContext2D, { lineTo } = prototype; let count = 0;"
        "prototype.lineTo = function (...p) { count += 1; lineTo.apply(this, p); };"
        "try { repctl.seek(arguments[0]); } finally { prototype.lineTo = lineTo; } return count"
    )
    driver.execute_script("document.getElementById('show-joints').click()")
    driver.execute_script(counted, 0.2)
    assert driver.execute_script(counted, 0.3) < 10
    pixels = "return document.getElementById('chart').toDataURL()"
    driver.execute_script("repctl.seek(1)")
    light = driver.execute_script(pixels)
    again = "repctl.seek(1); " + pixels
    schemes(driver, width=900, height=700, dark=True)
    WebDriverWait(driver, 20).until(lambda page: page.execute_script(again) != light)
    schemes(driver, width=900, height=700)
    WebDriverWait(driver, 20).until(lambda page: page.execute_script(again) == light)
    assert errors(driver) == []


_DRAWN = """
const [points, done] = arguments, { own, viewer } = repctl;
own.open({ points }).then(() => {
  const play = () => own.player.play(
    { ...own.report.result, paths: own.loops.paths().filter(Boolean), strokes: [] });
  const { set_dirty } = viewer;
  let pauses = 0, shown = 0;
  const work = play();
  work.next();
  viewer.set_dirty = () => { shown += 1; };
  while (!work.next().done) { pauses += 1; repctl.seek(pauses % 7); }
  viewer.set_dirty = set_dirty;
  const half = own.run(play());
  own.leave();
  half.then(() => {
    repctl.seek(2);
    const read = (id) => document.getElementById(id).textContent;
    done([pauses, shown, own.state, read("done")]);
  });
});
"""


@pytest.mark.slow
def test_what_was_computed_is_drawn_in_slices(driver: Any, page: Path) -> None:
    """A pause after each trace; nothing of the motion is shown before all is drawn. A drawing that
    something else ends leaves the page whole."""
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    home = np.array(driver.execute_script("return repctl.own.chain.homes[0]"))
    points = [home, home + [0.05, 0, 0], home + [0.05, 0.05, 0], home]
    pauses, shown, state, read = driver.execute_async_script(
        _DRAWN, [point.tolist() for point in points]
    )
    assert pauses >= 2 * 2 and shown == 0
    assert state == "study" and read == "After 2 cycles, from its start"
    assert errors(driver) == []


# ---- on a workpiece that moves


@pytest.fixture(scope="module")
def welded() -> rp.Study:
    """A study of a circle on a plate that a positioner turns and tilts."""
    task = rp.Robot.load(WELD).task("torch", "axis", on="workpiece")
    ready = [0.0, 0.0, 0.0, 0.5, -0.9, 0.0, 1.2, 0.0]
    turned = np.diag([-1.0, 1.0, -1.0])
    q0 = rp.solve_ik(task, ready, pin.SE3(turned, np.array([0.035, 0.0, 0.002])))
    path = rp.circle(task, q0, radius=0.065, start_angle=np.pi)
    return rp.study(rp.Problem(task, start=q0, path=path), cycles=2, steps=60, degree=1)


@pytest.fixture(scope="module")
def weld_page(welded: rp.Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return rp.animation(welded).save(tmp_path_factory.mktemp("weld") / "page.html")


_ON_PIECE = """
const { own } = repctl, { arms } = own, found = [];
const last = own.report.result.perCycle - 1;
for (let i = 0; i < 2 * last; i++) {
  repctl.seek(i / last);
  arms.forEach((arm, k) => {
    const back = own.piece.placement(k).invert();
    const tip = arm.point("tip", 0, arm.now.frame, arm.now.f).applyMatrix4(back);
    const turned = 2 * Math.acos(Math.min(1, Math.abs(arm.carrier.quaternion.w)));
    found.push([k, turned, ...tip.toArray()]);
  });
}
return found;
"""


def off_loop(points: np.ndarray, p: np.ndarray) -> float:
    """The distance of a point from a polygon, m."""
    a, d = points[:-1], np.diff(points, axis=0)
    share = np.clip(((p - a) * d).sum(1) / np.maximum((d**2).sum(1), 1e-30), 0, 1)
    return float(np.linalg.norm(a + share[:, None] * d - p, axis=1).min())


@pytest.mark.slow
def test_a_loop_is_drawn_on_a_workpiece_that_moves(
    driver: Any, welded: rp.Study, weld_page: Path, tmp_path: Path
) -> None:
    """57: the loop is one of the workpiece; cycles' ends are Python's; the tips stay on the loop
    while the plate turns; ring, CSV and address know the workpiece."""
    schemes(driver, width=1100, height=760)
    open_page(driver, weld_page)
    task, q0 = welded.task, welded.q0
    home = driver.execute_script("return repctl.own.chain.homes[0]")
    assert np.allclose(home, task.positions(q0[None])[0], atol=1e-9)
    drag(driver, ARC, "mouse")
    wait_until_computed(driver)
    assert said(driver).startswith(
        "After one cycle of your loop the hand is back in position and tool axis. "
    )
    points = np.array(driver.execute_script("return repctl.own.loops.points"))
    assert np.ptp(points, axis=0).max() > 0.02
    ends = driver.execute_script(ENDS)
    path = rp.waypoints(points, task.placement(q0).rotation)
    laws = (rp.Pseudoinverse(task), welded.design.inverse)
    for law, found, most in zip(laws, ends, (1e-6, 1e-8), strict=True):
        motion = rp.follow(law, path, q0, cycles=10, steps=60)
        assert np.abs(motion.q[:: motion.steps] - found).max() < most
    seen = np.array(driver.execute_script(_ON_PIECE))
    assert seen[:, 1].max() > 0.05, "the plate turns"
    assert max(off_loop(points, p) for p in seen[:, 2:]) < 1e-5
    (tmp_path / "loop.csv").write_text(
        driver.execute_script("return loopCsv(repctl.own.loops)"), "utf-8"
    )
    problem = rp.Problem(task, path=str(tmp_path / "loop.csv"), start=q0)
    assert np.allclose(problem.cycle.points()[0], home, atol=1e-4)
    address = driver.execute_async_script(
        "const done = arguments[0]; repctl.pause(); setTimeout(() => done(location.href), 600)"
    )
    driver.get("about:blank")
    with asleep(driver):
        driver.get(address)
    wait_until_drawn(driver, "a shared loop on a workpiece")
    assert np.abs(np.array(driver.execute_script(ENDS)) - ends).max() < 1e-3
    assert errors(driver) == []


_RINGS = """
const { own } = repctl, { arms } = own, out = [];
for (const goal of arguments[0]) {
  own.lead.queue.push(goal); own.gesture.processQueue(); own.gesture.draw();
  const spots = own.rings.spots();
  arms.forEach((arm, k) => {
    const tip = own.gesture.panes.seen(k, arm.point("tip", 0, 1)), spot = spots[k][0];
    const turned = 2 * Math.acos(Math.min(1, Math.abs(arm.carrier.quaternion.w)));
    out.push([Math.hypot(tip.x - spot.x, tip.y - spot.y), turned, own.lead.refusal ? 1 : 0]);
  });
}
return out;
"""


@pytest.mark.slow
def test_the_ring_stays_at_the_torch_while_the_plate_turns(driver: Any, weld_page: Path) -> None:
    schemes(driver, width=1100, height=760)
    open_page(driver, weld_page)
    # the torch moves with the plate, and rests on it
    driver.execute_script("repctl.own.elbow.slide(3)")
    assert "at its place on the workpiece while the arm moves" in said(driver)
    assert driver.execute_script("return repctl.own.elbow.part") != "hand"
    driver.execute_script("repctl.own.ledArms.end(); repctl.own.elbow.stand(0)")
    driver.execute_script("repctl.own.gesture.grab(0, 7, null)")
    home = np.array(driver.execute_script("return repctl.own.chain.homes[0]"))
    goals = [home + [x, y, 0] for x, y in ((0.03, 0.02), (0.08, 0.06), (0.1, 0.0), (0.05, -0.05))]
    found = np.array(driver.execute_script(_RINGS, [g.tolist() for g in goals]))
    assert not found[:, 2].any() and found[:, 1].max() > 0.05
    assert found[:, 0].max() < 0.6  # px
    assert errors(driver) == []


# ---- what can be saved, cited and told apart -----------------------------------------------------


def motions_of(text: str, joints: tuple[str, ...]) -> dict[str, tuple[Any, Any, Any]]:
    """Times, cycles and joints of each strategy of a CSV file."""
    rows: dict[str, list[list[float]]] = {}
    for row in csv.DictReader(text.splitlines()):
        numbers = [float(row[name]) for name in ("time", "cycle", *joints)]
        rows.setdefault(row["strategy"], []).append(numbers)
    tables = {key: np.array(numbers) for key, numbers in rows.items()}
    return {key: (table[:, 0], table[:, 1], table[:, 2:]) for key, table in tables.items()}


@pytest.mark.slow
def test_the_motion_of_a_study_and_of_a_loop_can_be_saved(
    driver: Any, page: Path, study: rp.Study
) -> None:
    """As CSV with the columns of motion.csv: joints to 1e-4 at the same times."""
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    for cycles, motions in (
        (2, {key: study.row(key).motion for key in ("pseudoinverse", "repeatable")}),
        (10, None),
    ):
        if motions is None:
            drag(driver, ARC, "mouse")
            wait_until_computed(driver)
        found = motions_of(driver.execute_script("return repctl.csv()"), study.task.joint_names)
        assert list(found) == ["pseudoinverse", "repeatable"]
        assert [cycle[-1] for _, cycle, _ in found.values()] == [cycles, cycles]
        for key, motion in (motions or {}).items():
            t, _, Q = found[key]
            assert t[-1] == pytest.approx(motion.t[-1], abs=1e-5)
            q = [np.interp(t, motion.t, joint) for joint in motion.q.T]
            assert np.abs(np.transpose(q) - Q).max() < 1.1e-4
    ends = np.array(driver.execute_script(ENDS))
    for (_, _, Q), expected in zip(found.values(), ends, strict=True):
        assert np.abs(Q[:: (len(Q) - 1) // 10] - expected).max() < 1e-6
    assert driver.find_element("id", "save-motion").get_attribute("textContent").endswith("(CSV)")
    assert errors(driver) == []


def test_help_says_where_to_install_from_and_how_to_cite(page: Path) -> None:
    """The BibTeX is that of the site; the repository has no address yet, which is said."""
    text = page.read_text("utf-8")
    assert "It has no public address yet, and no package index has it: ask whoever" in text
    assert "was made by" not in text
    assert "<code>--frame LINK</code> chooses the link" in text and "--task KIND</code>" in text
    assert "<code>pip install .</code> in the folder of the source code of repctl_pin" in text
    for name in ("target_pose", "joint_states", "joint_trajectory", "commands", "/diagnostics"):
        assert f"<code>{name}</code>" in text
    site = (Path(rp.__file__).parents[1] / "docs" / "index.md").read_text("utf-8")
    assert f"<pre>{site.split('```bibtex')[1].split('```')[0].strip()}</pre>" in text


@pytest.mark.slow
def test_the_page_of_a_command_repeats_it_as_text(tmp_path: Path, monkeypatch) -> None:
    """Without its output folder and the folders of its files, which others do not have."""
    monkeypatch.chdir(tmp_path)
    few = "study planar3r --degree 1 --cycles 1 --steps 40 --region 0.2"
    urdf = tmp_path / "a<b>.urdf"
    urdf.write_text(rp.Robot.load("planar3r").description.xml, "utf-8")
    for robot, out, told in (
        ("planar3r", "--out there", "planar3r"),
        (urdf, f"--out={tmp_path / 'there'}", "&#39;a&lt;b&gt;.urdf&#39;"),
    ):
        words = few.replace("planar3r", str(robot))
        assert main([*words.split(), *out.split()]) == 0
        text = (tmp_path / "there" / "animation.html").read_text("utf-8")
        assert f"was made by <code>repctl {few.replace('planar3r', told)}</code></dd>" in text
        assert str(tmp_path) not in text


_BARS = """
repctl.seek(0);
const chart = document.getElementById("chart"), { width, height } = chart;
const { data } = chart.getContext("2d").getImageData(0, 0, width, height), counts = {};
for (let k = 0; k < data.length; k += 4)
  if (data[k + 3] === 255) {
    const name = data.slice(k, k + 3).join();
    counts[name] = (counts[name] || 0) + 1;
  }
const paper = getComputedStyle(document.documentElement).getPropertyValue("--paper");
return [counts, repctl.own.arms.map(({ data: { color } }) => color), paper];
"""


def _light(rgb: Sequence[int]) -> float:
    linear = [
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in np.divide(rgb, 255)
    ]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
def test_bars_to_come_can_be_seen(driver: Any, page: Path, dark: bool) -> None:
    """At the start, when all are to come: contrast of 3 to the paper at least; they were pale."""
    schemes(driver, width=900, height=700, dark=dark)
    open_page(driver, page)
    counts, colours, paper = driver.execute_script(_BARS)
    ground = _light([int(paper.strip()[k : k + 2], 16) for k in (1, 3, 5)])
    for colour in colours:
        rgb = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
        assert counts.get(",".join(map(str, rgb)), 0) > 5, "bars have the arm's own colour"
        low, high = sorted((_light(rgb), ground))
        assert (high + 0.05) / (low + 0.05) >= 3
    assert errors(driver) == []


@pytest.mark.slow
def test_a_loop_that_was_altered_is_said_to_be_another(driver: Any, page: Path) -> None:
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    driver.execute_script(
        "const { own } = repctl, [x, y, z] = own.chain.homes[0];"
        "own.gesture.grab(0, null, null, 0);"
        "own.lead.queue.push([x - 0.1, y, z], [x - 0.1, y + 0.1, z]); own.gesture.processQueue();"
        "own.steps.walk = function* (from) {"
        " from.refusals = ['blocked', 'blocked']; return { refusal: 'blocked', trail: [] }; };"
        "own.release().then(() => { delete own.steps.walk; })"
    )
    told = said(driver)
    assert told.startswith("The arm cannot follow all of your loop. After its first "), told
    assert " long, goes as far as it can and comes back the same way. Limits are checked" in told
    assert ": the solid line, " in driver.find_element("id", "title").text
    assert driver.find_element("id", "lines").is_displayed()
    notes = [e.text for e in driver.find_elements("css selector", "#notes > span")]
    assert not any("is back" in note or "encloses nothing" in note for note in notes), notes
    assert errors(driver) == []


@pytest.mark.slow
def test_a_stroke_that_the_arm_cannot_follow_is_not_called_followed(
    driver: Any, page: Path
) -> None:
    """Readers drew circles out of reach, and read that their loop encloses nothing: 0.

    The headline says how much the arm can follow and why not all; the red ball has the reason, the
    callouts of the drift are hidden. The address gives the same again, "Back to the study" ends it.
    """
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    driver.execute_script(
        "const { own } = repctl, [x, y, z] = own.chain.homes[0];"
        "own.gesture.grab(0, 7, null, 0);"
        "own.lead.queue.push([x - 0.1, y, z], [x + 9, y, z], [x - 0.1, y + 0.1, z]);"
        "own.gesture.processQueue(); own.release();"
    )
    lines = driver.find_element("id", "lines")
    told = said(driver)
    assert lines.is_displayed() and lines.text.split("\n") == ["way taken", "not followed"]
    found = re.fullmatch(
        r"The arm cannot follow all of your loop\. "
        r"After its first \d[\d.]*.c?m, at the red ball, (.*)\. "
        r"The solid line, \d[\d.]*.c?m long, leaves that part out\. "
        r"Limits are checked, collisions are not\.",
        told,
    )
    assert found, told
    marks = [e for e in driver.find_elements("css selector", ".callout") if e.is_displayed()]
    reasons = driver.execute_script("return repctl.own.scene.failure")
    assert [e.text for e in marks] == [f"cannot follow\n{reason}" for reason in reasons]
    assert all(reason and reason in found[1] for reason in reasons)
    # the way that was taken is a loop, which both arms do as often as another
    assert driver.find_element("id", "again").text == "Do it 10 times"
    assert driver.find_element("id", "clock").text == "after 1 of 10"
    # one ball in each pane; what its lines mean is said on a phone, too
    balls = driver.execute_script(
        "return repctl.own.arms.map(({ past, stop }) => [past, stop].filter((ball) =>"
        " ball && ball.node.visible).length)"
    )
    assert balls == [1, 1]
    schemes(driver, width=390, height=844)
    driver.find_element("id", "noted").click()
    notes = driver.find_element("id", "notes")
    assert notes.is_displayed() and notes.text.startswith("After one cycle of the solid line")
    assert lines.is_displayed()
    assert "red ball" not in notes.text
    driver.find_element("id", "noted").click()
    schemes(driver, width=900, height=700)
    # where the hand stopped, on the line that it was led along
    stop, stroke = driver.execute_script(
        "return [repctl.own.arms[0].stop.node.position.toArray(), repctl.own.loops.missed]"
    )
    home = driver.execute_script("return repctl.own.chain.homes[0]")
    assert np.allclose(stroke[0][0], stop) and len(stroke[0]) == 3
    assert np.allclose(stop[1:], home[1:], atol=1e-4) and home[0] - 0.1 < stop[0] < home[0] + 9
    # it is in the picture, wherever it is
    inside = driver.execute_script(
        "const { gesture: { panes }, arms } = repctl.own, { width, height } = panes.place(0);"
        "const { x, y } = panes.seen(0, arms[0].stop.node.position);"
        "return [x / width, y / height]"
    )
    assert all(0 < share < 1 for share in inside), inside
    parts = driver.execute_script("return repctl.own.addressParts()")
    assert parts[1].startswith("missed=")
    open_page(driver, f"{page.resolve().as_uri()}#{'&'.join(parts)}&")
    wait_until_computed(driver)
    assert said(driver) == told
    driver.find_element("id", "back").click()
    assert said(driver).startswith("After 2 cycles the hand is back")
    assert driver.execute_script("return repctl.own.arms[0].stop") is None
    assert errors(driver) == []


@pytest.mark.slow
def test_an_arm_that_fails_on_the_way_it_took_instead_is_marked_there(
    driver: Any, page: Path
) -> None:
    """It stood beyond the ball that its pane spoke of, and no word said why. In a note, a control
    that fails came "near to where it fails", too."""
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    driver.execute_script(
        "const { own } = repctl, [x, y, z] = own.chain.homes[0];"
        "own.gesture.grab(0, 7, null, 0);"
        "const way = [[2.9, 0.3], [-1.6, -0.6], [-3.8, -3], [1.4, 1.2]];"
        "own.lead.queue.push(...way.map(([a, b]) => [x + a, y + b, z]));"
        "own.gesture.processQueue(); own.release();"
    )
    wait_until_computed(driver)
    reason = "cannot follow\nthe arm comes near a singularity"
    fails = "Repeatable fails here\nclose to a singularity, in cycle 1"
    lost = float(driver.execute_script("return repctl.own.arms[1].data.lost"))
    assert 0 < lost < 1
    for time_, told in ((0.5 * lost, [reason, reason]), (1, [reason, fails])):
        driver.execute_script("repctl.seek(arguments[0]); repctl.placed()", time_)
        marks = driver.find_elements("css selector", ".callout.mark")
        assert [mark.text for mark in marks if mark.is_displayed()] == told
    tip, ball = driver.execute_script(
        "const [, arm] = repctl.own.arms;"
        "const tip = arm.point('tip', 0, arm.now.frame);"
        "return [tip.toArray(), arm.past.node.position.toArray()]"
    )
    assert np.allclose(tip, ball, atol=1e-6)
    told = r" On the solid line, \d[\d.]*.c?m long, the repeatable control fails\. Limits"
    assert re.search(told, said(driver))
    notes = driver.find_element("id", "notes").get_attribute("textContent")
    assert "The repeatable control fails in cycle 1" in notes and "alone fails" not in notes
    assert errors(driver) == []


@pytest.mark.slow
def test_a_ball_that_is_called_red_is_red(driver: Any, page: Path) -> None:
    """It was pink."""
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    driver.execute_script(
        "const { own } = repctl, [x, y, z] = own.chain.homes[0];"
        "own.gesture.grab(0, 7, null, 0);"
        "own.lead.queue.push([x - 0.1, y, z], [x - 0.1, y + 9, z], [x, y - 0.2, z]);"
        "own.gesture.processQueue(); own.release();"
    )
    wait_until_computed(driver)
    assert driver.execute_script("return repctl.own.scene.failure")
    x, y = driver.execute_script(
        "repctl.placed(); const { gesture: { panes }, arms } = repctl.own;"
        "const { x, y } = panes.seen(0, arms[0].stop.node.position); return [x, y]"
    )
    image = picture_now(driver)[round(y) - 8 : round(y) + 9, round(x) - 8 : round(x) + 9]
    red, green, blue = np.median(image.reshape(-1, 3), axis=0)
    assert red > 180 and max(green, blue) < 0.4 * red


@pytest.mark.slow
def test_a_loop_that_one_control_cannot_follow_is_done_by_the_other(
    driver: Any, page: Path
) -> None:
    """Both panes said "cannot follow", and the loop ended where one control alone would fail.

    The hand goes on, under either control; the arm that fails is marked where it leaves the path,
    as far as which it is drawn, and the other closes the whole loop.
    """
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    ways = driver.execute_script(
        "const { own } = repctl, [x, y, z] = own.chain.homes[0];"
        "own.gesture.grab(0, 7, null, 0);"
        "const way = [[-1, 0.5], [-1.5, 1], [-2.5, 0], [-1.5, -1.5]];"
        "own.lead.queue.push(...way.map(([a, b]) => [x + a, y + b, z]));"
        "own.gesture.processQueue(); own.gesture.draw();"
        "return [own.lead.refusals, document.getElementById('verdict').textContent]"
    )
    refusals, told = ways
    assert sum(map(bool, refusals)) == 1
    (k,) = [k for k, refusal in enumerate(refusals) if refusal]
    under = ("the usual control", "the repeatable one")[k]
    assert told == f"{refusals[k]} under {under}. Draw on, or let go."
    driver.execute_script("repctl.own.release()")
    control = ("The usual control", "The repeatable control")[k]
    assert said(driver).startswith(f"{control} fails in cycle 1, close to a singularity, ")
    assert driver.execute_script("return repctl.own.loops.missed") == []
    marks = driver.find_elements("css selector", ".callout.mark")
    assert [mark.is_displayed() for mark in marks] == [k == 0, k == 1]
    # the arm is on the path until it stops, the other all around it
    off = driver.execute_script(
        "const { own } = repctl, [path] = own.loops.paths(), { chain, report } = own;"
        "const { motions } = report.result;"
        "const { n } = chain, gaps = (p) => Math.min(...path.slice(1).map((b, i) =>"
        " fromPiece([...p], path[i], b)));"
        "return motions.map(({ Q, last, perCycle }) => { let most = 0;"
        " for (let row = 0; row <= (last ?? perCycle); row++) {"
        "  chain.place(Q.subarray(row * n, (row + 1) * n));"
        "  most = Math.max(most, gaps(chain.frames[0].p)); } return most; })"
    )
    assert max(off) < 0.01, off
    assert errors(driver) == []


@pytest.mark.slow
def test_the_end_is_seen_first_however_late_pictures_are(driver: Any, page: Path) -> None:
    """The page opened at cycle 0 where a picture took 3 s, under a headline on the end."""
    open_page(driver, page)
    time_ = driver.execute_async_script(
        "const [done] = arguments, { clock } = repctl.own, since = performance.now();"
        "clock.seek(clock.cycles); clock.open();"
        "while (performance.now() - since < 3500);"
        "requestAnimationFrame(() => requestAnimationFrame(() => done(repctl.time)))"
    )
    assert time_ == 2
    driver.execute_script("repctl.pause()")


@pytest.mark.slow
def test_numbers_have_the_colour_of_their_arm(driver: Any, page: Path) -> None:
    """A zero was blue, the colour of the repeatable control, in the pane of the usual one, too."""
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    shades = driver.execute_script(
        "const colours = () => ['.callout:not(.hand, .mark) b', '.reading b'].map((what) =>"
        " [...document.querySelectorAll(what)].map((node) => getComputedStyle(node).color));"
        "return [0, 2].map((time) => { repctl.seek(time); return colours(); })"
    )
    assert shades[0] == shades[1], "whether it has drifted or not"
    assert shades[0][0] == shades[0][1], "at the arm and beside the bars"
    usual, repeatable = ([int(v) for v in re.findall(r"\d+", one)] for one in shades[0][0])
    assert usual[0] > usual[2] and repeatable[0] < repeatable[2]


@pytest.mark.slow
def test_a_loop_that_was_not_followed_at_all_has_no_bars(driver: Any, page: Path) -> None:
    """A way there and back: its bars and numbers were 0, as if a loop had been followed."""
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    driver.execute_script(
        "const { own } = repctl, [x, y, z] = own.chain.homes[0];"
        "own.gesture.grab(0, 7, null, 0); own.lead.queue.push([x + 9, y, z]);"
        "own.gesture.processQueue(); own.release();"
    )
    assert said(driver).startswith("The arm cannot follow all of your loop. After its first ")
    assert " long, goes as far as it can and comes back the same way." in said(driver)
    read = "return [...document.querySelectorAll('.reading b')].map((one) => one.textContent)"
    assert driver.execute_script(read) == 2 * ["–"]
    # it is seen once, at its far end, and no number of cycles is named
    assert driver.find_element("id", "clock").text == "on the way"
    assert driver.find_element("id", "done").text == "The loop was not followed"
    assert not driver.find_element("id", "again").is_displayed()
    off = driver.execute_script(
        "return repctl.own.arms.map((arm) => arm.point('tip', 0, arm.now.frame, arm.now.f)"
        ".distanceTo(arm.stop.node.position))"
    )
    assert max(off) < 0.05
    driver.find_element("id", "back").click()
    assert driver.find_element("id", "clock").text == "after 2 of 2"
    assert "–" not in driver.execute_script(read)
    assert errors(driver) == []


@pytest.mark.slow
def test_a_stroke_of_the_address_that_the_arm_can_follow_is_no_failure(
    driver: Any, page: Path
) -> None:
    """Nor is it drawn. Its page said that the arm cannot follow the loop, without a reason.

    A stroke that it cannot follow is as long as a drawn one may be: 4 arm lengths from the start.
    """
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    x, y, z = driver.execute_script("return repctl.own.chain.homes[0]")
    size = driver.execute_script("return repctl.own.chain.size")

    def written(*points: tuple[float, float]) -> str:
        return ";".join(f"{x + dx},{y + dy},{z}" for dx, dy in points)

    loop = written((0, 0), (-0.1, 0), (-0.1, 0.1), (0, 0))
    can = written((-0.1, 0), (-0.12, 0.05))
    cannot = written((-0.1, 0.1), (1e4, 0.1))
    found = {}
    for name, missed in {"none": can, "one": f"{can}|{cannot}"}.items():
        open_page(driver, f"{page.resolve().as_uri()}#loop={loop}&missed={missed}&")
        wait_until_computed(driver)
        found[name] = said(driver), driver.execute_script("return repctl.own.scene.failure")
    assert found["none"][0].startswith(
        "After 10 cycles of your loop the hand is back in x and y."
    ), found
    assert found["none"][1] is None
    after = r"After its first \d[\d.]*.c?m, at the red ball, "
    start = rf"The arm cannot follow all of your loop\. {after}"
    assert re.match(start, found["one"][0]) and found["one"][1], found
    # whom it stops: both, for one reason or for two, or the function of a cell alone
    named = driver.execute_script(
        "const { own } = repctl, words = [];"
        "own.steps.walk = function* (from) { from.refusals = own.refuse; "
        "  return { refusal: 'blocked', trail: [] }; };"
        "for (own.refuse of [['', 'blocked'], ['blocked', 'blocked'], ['blocked', 'other']]) {"
        "  const stop = stopOf(own.steps, own.loops.points, own.loops.missed[0]).next().value;"
        "  words.push(failureWords(own.chain, own.arms, stop)[0][0].split('red ball, ')[1]);"
        "} delete own.steps.walk; return words;"
    )
    assert named == [
        "blocked.",
        "blocked under either control.",
        "blocked under the usual control, other under the repeatable one.",
    ]
    ends = driver.execute_script(
        "return repctl.own.loops.missed.map((stroke) => stroke[stroke.length - 1])"
    )
    far = np.linalg.norm(np.subtract(ends, [x, y, z]), axis=1)
    assert far == pytest.approx([np.hypot(0.12, 0.05), 4 * size])
    assert errors(driver) == []


@pytest.mark.slow
def test_a_loop_that_breaks_a_limit_is_not_the_best(driver: Any, page: Path) -> None:
    schemes(driver, width=900, height=700)
    open_page(driver, page)
    found = driver.execute_async_script(
        "const { own } = repctl, [x, y, z] = own.chain.homes[0], done = arguments[0];"
        "const points = Array.from({ length: 60 }, (_, k) => {"
        "  const a = (k * Math.PI) / 30;"
        "  return [x - 0.15 * (1 - Math.cos(a)), y + 0.15 * Math.sin(a), z]; });"
        "own.open({ points }).then(() => {"
        "  const { data } = own.report.result.runs[0];"
        "  data.broken = { joint: 0, cycle: 3, words: 'past its limit' };"
        "  own.report.keepBest(); const past = Boolean(own.report.best);"
        "  data.broken = null; own.report.keepBest(); done([past, Boolean(own.report.best)]); });"
    )
    assert found == [False, True]
    assert errors(driver) == []


@pytest.mark.slow
@pytest.mark.parametrize("width", [700, 1920])
def test_lines_have_some_ninety_characters(driver: Any, page: Path, width: int) -> None:
    schemes(driver, width=width, height=900)
    open_page(driver, page)
    most = driver.execute_script(
        "return ['verdict', 'notes'].map((id) => { const node = document.getElementById(id);"
        "const range = document.createRange(), rows = {};"
        "const walk = document.createTreeWalker(node, NodeFilter.SHOW_TEXT);"
        "for (let text; (text = walk.nextNode()); )"
        "  for (let k = 0; k < text.data.length; k++) {"
        "    range.setStart(text, k); range.setEnd(text, k + 1);"
        "    const { left, bottom } = range.getBoundingClientRect();"
        "    const box = node.getBoundingClientRect(), middle = box.left + box.width / 2;"
        "    const row = `${id === 'notes' && left > middle} ${Math.round(bottom)}`;"
        "    rows[row] = (rows[row] || 0) + 1; }"
        "return Math.max(...Object.values(rows)); })"
    )
    assert max(most) <= 98, most


_OVER_THE_VIEWS = """
const panes = document.getElementById("panes").getBoundingClientRect();
const box = (node) => [node.id, node.getBoundingClientRect()];
const over = [...document.querySelectorAll("#verdict, #notes, #noted, #own, #elbow-box")].map(box)
  .filter(([, { left, right, top, bottom, width }]) => width > 0 && left < panes.right - 1
    && right > panes.left + 1 && top < panes.bottom - 1 && bottom > panes.top + 1);
return [over.map(([id]) => id), panes.height, document.getElementById("verdict").offsetHeight > 0,
  document.getElementById("notes").offsetHeight > 0];
"""


@pytest.mark.slow
@pytest.mark.parametrize("size", [(1231, 610), (366, 717)])
def test_inside_a_page_no_words_cover_the_views(
    driver: Any, page: Path, tmp_path: Path, size: tuple[int, int]
) -> None:
    """In the frame of a report or a cell's page, whose loop had its sentence over the arms."""
    framed = tmp_path / "framed.html"
    framed.write_text(page.read_text("utf-8").replace("<body>", '<body class="inside">', 1))
    schemes(driver, width=size[0], height=size[1])
    open_page(driver, framed)
    below = {"own", "elbow-box"} if size[0] > 640 else set()  # in the corner of wide views
    over, _, sentence, notes = driver.execute_script(_OVER_THE_VIEWS)
    assert set(over) <= below and sentence and not notes
    drag(driver, [(30, 0), (30, 20), (0, 20)], "mouse")
    wait_until_computed(driver)
    over, height, sentence, notes = driver.execute_script(_OVER_THE_VIEWS)
    assert set(over) <= below and sentence and not notes
    driver.find_element("id", "noted").click()
    over, left, sentence, notes = driver.execute_script(_OVER_THE_VIEWS)
    assert set(over) <= below and sentence and notes and left > 0.6 * height
    assert errors(driver) == []


@pytest.mark.slow
@pytest.mark.parametrize(("width", "height"), [(320, 568), (390, 844)])
def test_notes_leave_half_of_a_phone_to_the_views(
    driver: Any, page: Path, width: int, height: int
) -> None:
    """They left 40 px of 568. Those of a study and of a loop scroll; nothing moves with a loop."""
    schemes(driver, width=width, height=height)
    open_page(driver, page)
    driver.find_element("id", "noted").click()
    box = "return document.getElementById(arguments[0]).getBoundingClientRect().toJSON()"
    scrolls = (
        "const { scrollWidth, clientWidth, clientHeight, tabIndex } ="
        " document.getElementById('notes');"
        "return [scrollWidth <= clientWidth, clientHeight, tabIndex];"
    )
    home = np.array(driver.execute_script("return repctl.own.chain.homes[0]"))
    seen = []
    for points in (None, home + 0.1 * np.array([[0, 0, 0], [-1, 0, 0], [-1, 1, 0], [0, 0, 0]])):
        if points is not None:
            driver.execute_script("repctl.own.open({ points: arguments[0] })", points.tolist())
            wait_until_computed(driver)
        stage, foot = (driver.execute_script(box, name) for name in ("stage", "tools"))
        fits, tall, tab = driver.execute_script(scrolls)
        assert stage["height"] >= 0.5 * height and foot["bottom"] <= height
        assert fits and tall > 40 and tab == 0
        seen.append(stage)
    assert seen[0] == seen[1]
    assert errors(driver) == []
