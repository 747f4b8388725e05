"""The live view: this machine only, keys come back, strangers are refused, nothing is left behind
however it ends."""

from __future__ import annotations

import asyncio
import json
import socket
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from browser import asleep, errors, only_pictures_asked_for, pane, picture_now, wait_until_drawn
from page_file import Drawn, matrices, read
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import WebSocketHandler, websocket_connect

import repctl_pin as rp

Q0 = np.array([0.3, 0.8, 0.8])


@pytest.fixture(scope="module")
def task() -> rp.Task:
    return rp.Robot.load("planar3r").task(kind="xy")


def port_of(url: str) -> int:
    return int(url.rstrip("/").rpartition(":")[2])


def is_open(port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(2)
        return probe.connect_ex(("127.0.0.1", port)) == 0


def fetch(url: str, host: str | None = None) -> int:
    request = urllib.request.Request(url, headers={"Host": host} if host else {})
    try:
        with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(
            request, timeout=10
        ) as answer:
            assert answer.read().startswith(b"<!DOCTYPE html>")
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


async def connect(view: rp.Viewer, origin: str | None = None, host: str | None = None) -> Any:
    headers = {"Origin": origin or view.url.rstrip("/"), **({"Host": host} if host else {})}
    return await websocket_connect(
        HTTPRequest(view.url.replace("http", "ws") + "poses", headers=headers)
    )


def until(true: Callable[[], Any], seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_poses_arrive_and_keys_come_back(task: rp.Task) -> None:
    first, now = [Q0, Q0], [Q0 + 0.1, np.array([0.4, 0.5, 7.0])]  # past a limit
    loop = asyncio.new_event_loop()

    async def talk(view: rp.Viewer) -> list[np.ndarray]:
        socket = await connect(view)
        for message in ([0, 0.01, 0], [0.02, 0, 0], [9, 0, 0], [True, 0], "nonsense"):
            await socket.write_message(json.dumps(message))
        await socket.write_message("no json")
        got = []
        for shown, before in ((first, None), (now, None), (now, now)):
            view.show(*shown, before=before, target=task.positions(shown[0][None])[0], cycles=3)
            got.append(np.frombuffer(await socket.read_message(), "<f4"))
        return got

    with rp.Viewer(task, ["a", "b"]) as view:
        told = loop.run_until_complete(talk(view))
        until(lambda: view.offset[0])
        np.testing.assert_allclose(view.offset, [0.02, 0.01, 0])
        with urllib.request.urlopen(view.url) as answer:
            scene = read(answer.read().decode("utf-8"))[0]
        shapes = scene["arms"][0]["shapes"]
        moving = [shape["name"] for shape in shapes if shape["pose"] is None]
        drawn = Drawn(task.robot)
        order = [drawn.names.index(name) for name in moving]
        assert len(moving) > 5
        for numbers, shown, before in zip(
            told, (first, now, now), (first, first, now), strict=True
        ):
            both = task.positions(np.array([*shown, *before]))
            expected = drawn.placements(task.to_robot(np.array([*shown, *before])))
            size = 4 * len(moving) * 7
            poses = numbers[:size].reshape(4, len(moving), 7)
            np.testing.assert_allclose(matrices(poses), expected[:, order], atol=1e-6)
            drift = np.linalg.norm(np.array(shown) - before, axis=1)
            np.testing.assert_allclose(
                numbers[size : size + 5], [*drift, 0, shown is now, 0], atol=1e-6
            )
            np.testing.assert_allclose(numbers[size + 5 : size + 9], [*both[0], 3], atol=1e-6)
            np.testing.assert_allclose(numbers[size + 9 : size + 21], both.ravel(), atol=1e-6)
        with pytest.raises(rp.InputError, match="2 controllers, but 1"):
            view.show(Q0)
        with pytest.raises(rp.InputError, match=f"port {port_of(view.url)}"):
            rp.Viewer(task, ["a"], port=port_of(view.url))
    assert not is_open(port_of(view.url))
    view.show(*now)  # too late, and no fault
    loop.close()
    with pytest.raises(rp.InputError, match="names"):
        rp.Viewer(task, "ours")
    with pytest.raises(rp.InputError, match="70000"):
        rp.Viewer(task, ["a"], port=70000)


def test_the_last_poses_always_arrive(task: rp.Task, monkeypatch: pytest.MonkeyPatch) -> None:
    """To a browser that is slow some are left out, but never the last."""
    quick = WebSocketHandler.write_message

    async def slow(self: WebSocketHandler, message: Any, binary: bool = False) -> None:
        await asyncio.sleep(0.1)
        await quick(self, message, binary)

    monkeypatch.setattr(WebSocketHandler, "write_message", slow)

    async def flood(view: rp.Viewer) -> list[float]:
        socket, drifts = await connect(view), [0.0]
        for k in range(100):
            view.show(Q0 + [0, 0, 0.001 * k])
        while drifts[-1] < 0.0989:
            drifts.append(
                float(np.frombuffer(await asyncio.wait_for(socket.read_message(), 20), "<f4")[-16])
            )
        return drifts

    with rp.Viewer(task, ["a"]) as view:
        view.show(Q0)
        drifts = asyncio.run(flood(view))
    assert drifts == sorted(drifts) and len(drifts) < 50


def test_no_message_does_more_than_a_key_can(
    task: rp.Task, capfd: pytest.CaptureFixture[str]
) -> None:
    """Keys move the target as far as the arm reaches; nothing prints, and the page is served as
    before."""

    async def send(view: rp.Viewer, messages: list[str | bytes]) -> None:
        socket = await connect(view)
        for message in messages:
            await socket.write_message(message, binary=isinstance(message, bytes))
        socket.close()

    with rp.Viewer(task, ["a"], start=Q0) as view:
        asyncio.run(send(view, ["[0.1, 0, -0.1]"] * 2000))
        until(lambda: view.offset[0] == 3.0)  # three links of 1 m
        assert view.offset.tolist() == [3.0, 0.0, -3.0]
        for hostile in (
            "[" * 100_000,
            "[" * 199,
            "9" * 199,
            "[NaN, 0, 0]",
            "\0",
            b"\xff" * 1000,
            '{"home": 1}',
        ):
            asyncio.run(send(view, [hostile]))
        asyncio.run(send(view, ['"home"']))
        until(lambda: not view.offset.any())
        assert fetch(view.url) == 200
    assert capfd.readouterr().err == ""


def test_strangers_are_refused(task: rp.Task) -> None:
    with rp.Viewer(task, ["a"]) as view:
        port = port_of(view.url)
        assert fetch(view.url) == 200 and fetch(view.url, host=f"localhost:{port}") == 200
        assert (
            fetch(view.url, host="evil.example:80") == 403 and fetch(view.url + "etc/passwd") == 404
        )
        for stranger in (
            {"origin": "http://evil.example"},
            {"host": f"evil.example:{port}"},
            {"origin": "null"},
        ):
            with pytest.raises(HTTPClientError, match="403"):
                asyncio.run(connect(view, **stranger))


@pytest.mark.slow
def test_a_real_browser_shows_the_poses(task: rp.Task, driver: Any) -> None:
    from selenium.webdriver.common.keys import Keys

    path = rp.circle(task, Q0, 0.15)
    with rp.Viewer(task, ["J⁺", "ours"], path=path, start=Q0) as view:
        view.show(Q0, Q0)
        with asleep(driver):
            driver.get(view.url)
            wait_until_drawn(driver, "the live page")
        only_pictures_asked_for(driver)
        until(lambda: driver.execute_script("return repctl.received"))
        # as a slow machine has it, or the size of a picture changes between two
        driver.execute_script("repctl.viewer.renderer.setPixelRatio(0.75)")
        before = picture_now(driver)
        view.show(Q0, Q0 + [0.6, -0.6, -0.5])
        until(lambda: driver.execute_script("return repctl.received") > 1)
        after = picture_now(driver)
        same, moved = (
            np.mean(np.abs(pane(driver, before, k) - pane(driver, after, k)).max(-1) > 8)
            for k in (0, 1)
        )
        assert same < 0.0005 and moved > 0.01
        said = [note.text for note in driver.find_elements("class name", "past")]
        assert said == ["joints 0 rad from cycle 1", "joints 0.985 rad from cycle 1"]
        view.show(Q0, Q0, out_of_reach=True)
        until(lambda: driver.execute_script("return repctl.received") > 2)
        said = [note.text for note in driver.find_elements("class name", "past")]
        assert said == ["joints 0 rad from cycle 1, target out of reach"] * 2
        body = driver.find_element("tag name", "body")
        for key, offset in (  # as it is seen from above
            (Keys.ARROW_UP, [0, 0.01, 0]),
            (Keys.ARROW_RIGHT, [0.01, 0.01, 0]),
            (Keys.ARROW_LEFT, [0, 0.01, 0]),
            (Keys.ARROW_DOWN, [0, 0, 0]),
            (Keys.PAGE_DOWN, [0, 0, 0.01]),
            (Keys.HOME, [0, 0, 0]),
        ):
            body.send_keys(key)
            until(lambda want=offset: np.allclose(view.offset, want))
        the_target_is_dragged(driver, view)
        assert errors(driver) == []
        # a page from elsewhere, in the same browser, does not get in
        driver.get("data:text/html,<p>elsewhere")
        assert driver.execute_async_script(
            "const done = arguments[1], s = new WebSocket(arguments[0]);"
            "s.onopen = () => done('open'); s.onerror = () => done('refused')",
            view.url.replace("http", "ws") + "poses",
        ) == "refused"  # fmt: skip


def the_target_is_dragged(driver: Any, view: rp.Viewer) -> None:
    """By a pointer that takes it where it is seen; a pointer elsewhere turns the view."""
    target = view.task.positions(Q0[None])[0]
    received = driver.execute_script("return repctl.received")
    view.show(Q0, Q0, target=target, cycles=2)
    until(lambda: driver.execute_script("return repctl.received") > received)
    assert driver.find_element("id", "clock").get_attribute("textContent") == "cycle 3"
    said = driver.find_element("id", "verdict").text
    assert said.startswith("After 2 cycles the hand is where it was in cycle 1;")
    seen = driver.execute_script(
        "const v = new MeshCat.THREE.Vector3(...arguments[0]).applyAxisAngle("
        "new MeshCat.THREE.Vector3(1, 0, 0), -Math.PI / 2).project(repctl.viewer.camera),"
        "{left, top} = document.getElementById('picture').getBoundingClientRect(),"
        "p = document.querySelector('.pane').getBoundingClientRect();"
        "return [p.left + (v.x + 1) / 2 * p.width, p.top + (1 - v.y) / 2 * p.height]",
        target.tolist(),
    )
    drag = (
        "const [x, y, dx] = arguments, at = (kind, x) => document.querySelector('#picture canvas')"
        ".dispatchEvent(new PointerEvent(kind, {bubbles: true, cancelable: true, pointerId: 7,"
        "pointerType: 'touch', clientX: x, clientY: y}));"
        "at('pointerdown', x); for (let k = 1; k <= 5; k++) at('pointermove', x + k * dx / 5);"
        "at('pointerup', x + dx)"
    )
    driver.execute_script(drag, *seen, 10)
    until(lambda: view.offset[0] > 0)
    time.sleep(0.1)
    moved = view.offset.copy()
    assert moved[0] > 0 and np.abs(moved[1:]).max() < 1e-3 * moved[0]
    captures = (  # no real pointer has this number
        "Element.prototype.setPointerCapture = Element.prototype.releasePointerCapture = () => {};"
    )
    driver.execute_script(captures + drag, seen[0] + 100, seen[1], 10)
    time.sleep(0.1)
    assert np.array_equal(view.offset, moved)


@pytest.mark.slow
def test_two_pandas_leave_time_for_sixty_pictures_a_second(
    panda_pose: rp.Task, q_panda: Any, driver: Any
) -> None:
    """All that a picture takes but the graphics card's part: Python's, and the page's own."""
    timed = (
        "window.frames_ = new Map(); const ask = window.requestAnimationFrame;"
        "window.requestAnimationFrame = (f) => ask((t) => { const start = performance.now(); f(t);"
        "frames_.set(t, (frames_.get(t) || 0) + performance.now() - start); });"
    )
    ways = (q_panda, q_panda + 0.3 * np.sin(np.arange(7)))
    with rp.Viewer(panda_pose, ["J⁺", "ours"], start=q_panda) as view:
        view.show(*ways)
        with asleep(driver, timed):
            driver.get(view.url)
            wait_until_drawn(driver, "the live page")
        until(lambda: driver.execute_script("return repctl.received"))
        driver.execute_script("frames_.clear(); window.before = repctl.received")
        spent = []
        for k in range(90):
            start = time.perf_counter()
            view.show(*(q + 0.1 * np.sin(0.1 * k) for q in ways))
            spent.append(time.perf_counter() - start)
            time.sleep(max(0.0, 1 / 60 - spent[-1]))
        pictures = driver.execute_script("return [...frames_.values()]")
        assert driver.execute_script("return repctl.received - before") > 10
        assert np.median(spent) < 1 / 60
        assert np.median(pictures) < 1000 / 60, "ms"  # of JavaScript
        assert errors(driver) == []
