"""The live viewer: poses arrive, keys come back, strangers are refused, nothing is left behind."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from browser import browser, errors, pane, picture_now, require_browser
from test_live import fetch, is_open, listening
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect

import repctl_pin as rp
from repctl_pin.robot.visuals import Visuals
from repctl_pin.show.page.scene import poses_of


@pytest.fixture(scope="module")
def task() -> rp.Task:
    return rp.Robot.load("planar3r").task(kind="xy")


async def connect(view: rp.Viewer, origin: str | None = None, host: str | None = None):
    headers = {"Origin": origin or view.url.rstrip("/"), **({"Host": host} if host else {})}
    return await websocket_connect(HTTPRequest(view.url.replace("http", "ws") + "poses", headers=headers))


def test_poses_arrive_and_keys_come_back(task: rp.Task) -> None:
    q1, q2 = np.array([0.3, 0.8, 0.8]), np.array([0.4, 0.5, 0.6])

    async def talk(view: rp.Viewer) -> np.ndarray:
        socket = await connect(view)
        for message in ([0, 0.01, 0], [0.02, 0, 0], [9, 0, 0], "nonsense"):
            await socket.write_message(json.dumps(message))
        await socket.write_message("no json")
        await asyncio.sleep(0.2)
        view.show(q1, q2)
        return np.frombuffer(await socket.read_message(), "<f4")

    with rp.Viewer(task, ["a", "b"]) as view:
        told = asyncio.run(talk(view)).reshape(2, -1, 7)
        np.testing.assert_allclose(view.offset, [0.02, 0.01, 0])
        visuals = Visuals.of(task.robot)
        expected = poses_of(visuals.placements(task.full(np.array([q1, q2]))))
        np.testing.assert_allclose(told, expected[:, view._moving], atol=1e-6)
        port = int(view.url.rstrip("/").rpartition(":")[2])
        with pytest.raises(rp.InputError, match="2 controls, but 1"):
            view.show(q1)
        with pytest.raises(rp.InputError, match=f"port {port}"):
            rp.Viewer(task, ["a"], port=port)
    assert not is_open(port)
    with pytest.raises(rp.InputError, match="names"):
        rp.Viewer(task, "ours")


def test_strangers_are_refused(task: rp.Task) -> None:
    with rp.Viewer(task, ["a"]) as view:
        port = view.url.rstrip("/").rpartition(":")[2]
        assert fetch(view.url)[0] == 200 and fetch(view.url, host="evil.example:80")[0] == 403
        for stranger in ({"origin": "http://evil.example"}, {"host": f"evil.example:{port}"}, {"origin": "null"}):
            with pytest.raises(HTTPClientError, match="403"):
                asyncio.run(connect(view, **stranger))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL], ids=lambda n: n.name)
def test_nothing_is_left_behind(number: signal.Signals) -> None:
    code = (
        "import time, repctl_pin as rp\nt = rp.Robot.load('planar3r').task(kind='xy')\n"
        "view = rp.Viewer(t, ['a'])\nprint(view.url, flush=True)\n"
        "while True: view.show(t.reference); time.sleep(0.01)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=os.environ) as process:
        assert process.stdout is not None
        port = int(process.stdout.readline().strip().rstrip("/").rpartition(":")[2])
        assert listening(process.pid) == {"0100007F"}
        process.send_signal(number)
        process.wait(20)
    assert not is_open(port)


def test_a_real_browser_follows_the_loop(task: rp.Task) -> None:
    require_browser()
    with rp.Viewer(task, ["J⁺", "ours"]) as view, browser(680, 560) as driver:
        view.show([0.3, 0.8, 0.8], [0.3, 0.8, 0.8])
        driver.get(view.url)
        deadline = time.monotonic() + 60
        while not driver.execute_script("return Boolean(window.repctl && repctl.ready && repctl.received)"):
            assert time.monotonic() < deadline, errors(driver)
            time.sleep(0.05)
        before = picture_now(driver)
        view.show([0.3, 0.8, 0.8], [0.9, 0.2, 0.3])
        while driver.execute_script("return repctl.received") < 2:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        after = picture_now(driver)
        same, moved = (np.mean(np.abs(pane(driver, before, k) - pane(driver, after, k)).max(-1) > 8) for k in (0, 1))
        assert same < 0.0005 and moved > 0.01
        from selenium.webdriver.common.keys import Keys

        driver.find_element("tag name", "body").send_keys(Keys.ARROW_UP)
        while not view.offset.any():
            assert time.monotonic() < deadline
            time.sleep(0.05)
        np.testing.assert_allclose(view.offset, [0, 0, 0.01])
        assert errors(driver) == []
    assert threading.active_count() >= 1
