"""The live view: this machine only, and nothing left behind however it ends."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from browser import browser, changed, errors, open_page, picture, require_browser

import repctl_pin as rp
from repctl_pin.robot.visuals import Visuals
from repctl_pin.show.page.live import LivePage

PAGE = "<!DOCTYPE html><title>é</title>"


def is_open(port: int, host: str = "127.0.0.1") -> bool:
    with socket.socket() as probe:
        probe.settimeout(2)
        return probe.connect_ex((host, port)) == 0


def fetch(url: str, host: str | None = None) -> tuple[int, str]:
    request = urllib.request.Request(url, headers={"Host": host} if host else {})
    try:
        with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(request, timeout=10) as answer:
            return answer.status, answer.read().decode("utf-8")
    except urllib.error.HTTPError as error:
        return error.code, ""


def listening(pid: int) -> set[str]:
    """Local addresses on which a process and its children listen, as Linux tells."""
    sockets = set()
    for process in [pid, *children(pid)]:
        for link in Path(f"/proc/{process}/fd").iterdir():
            try:
                target = os.readlink(link)
            except OSError:
                continue
            if target.startswith("socket:["):
                sockets.add(target[8:-1])
    found = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and fields[9] in sockets:
                found.add(fields[1].partition(":")[0])
    return found


def children(pid: int) -> list[int]:
    own = [int(p) for task in Path(f"/proc/{pid}/task").iterdir() for p in (task / "children").read_text().split()]
    return own + [grandchild for child in own for grandchild in children(child)]


def test_it_serves_the_page_and_stops() -> None:
    with LivePage(PAGE) as live:
        port = int(live.url.rstrip("/").rpartition(":")[2])
        assert live.url == f"http://127.0.0.1:{port}/"
        assert fetch(live.url) == (200, PAGE)
        assert fetch(live.url + "?x=1#paused") == (200, PAGE)
        assert fetch(live.url + "etc/passwd")[0] == 404
        assert fetch(live.url, host="evil.example:80")[0] == 403  # a name that was made to point here
        assert fetch(live.url, host=f"localhost:{port}")[0] == 200
    assert not is_open(port)
    assert threading.active_count() == 1 or not any("serve_forever" in t.name for t in threading.enumerate())


def test_an_exception_closes_it_too() -> None:
    with pytest.raises(ZeroDivisionError), LivePage(PAGE) as live:
        port = int(live.url.rstrip("/").rpartition(":")[2])
        assert is_open(port)
        raise ZeroDivisionError
    assert not is_open(port)


def test_a_browser_that_hangs_does_not_hold_it_up() -> None:
    with LivePage(PAGE * 100_000) as live:
        port = int(live.url.rstrip("/").rpartition(":")[2])
        slow = socket.create_connection(("127.0.0.1", port))
        slow.sendall(f"GET / HTTP/1.0\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
    slow.close()
    assert not is_open(port)


def test_a_port_that_is_taken_is_said() -> None:
    with LivePage(PAGE) as live:
        port = int(live.url.rstrip("/").rpartition(":")[2])
        with pytest.raises(rp.InputError, match=f"port {port}.*--port"):
            LivePage(PAGE, port=port)
    with pytest.raises(rp.InputError, match="70000"):
        LivePage(PAGE, port=70000)


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("live") / "motion.csv"
    file.write_text("d1,d2,theta3\n" + "\n".join(f"{k / 10},0,{k / 5}" for k in range(6)), encoding="utf-8")
    return file


@contextmanager
def animating(motion: Path, *more: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """``repctl animate --live`` in a process of its own, serving."""
    command = [sys.executable, "-m", "repctl_pin", "animate", "ppr", "--motion", str(motion), "--live", "--json", *more]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    environment.pop("DISPLAY", None)
    with subprocess.Popen(
        command, cwd=motion.parent, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None and process.stderr is not None
            line = process.stdout.readline()
            assert line, process.stderr.read()
            yield process, json.loads(line)["url"]
        finally:
            process.kill()


ENDS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL]
"""Ctrl-C, a service manager, a terminal that is closed, and the worst."""


@pytest.mark.parametrize("number", ENDS, ids=lambda n: n.name)
def test_the_command_leaves_nothing_behind(motion: Path, number: signal.Signals) -> None:
    with animating(motion) as (process, url):
        port = int(url.rstrip("/").rpartition(":")[2])
        status, page = fetch(url)
        assert status == 200 and page.startswith("<!DOCTYPE html>") and page.rstrip().endswith("</html>")
        offspring: list[int] = []
        if Path("/proc/self/net/tcp").exists():
            assert listening(process.pid) == {"0100007F"}  # 127.0.0.1, and nothing else
            offspring = children(process.pid)
        process.send_signal(number)
        output = process.communicate(timeout=20)
        assert process.returncode == (-number if number is signal.SIGKILL else 0)
        assert output == ("", "")
        assert not is_open(port)
        assert not any(Path(f"/proc/{pid}").exists() for pid in offspring)
    assert sorted(p.name for p in motion.parent.iterdir()) == ["motion.csv"]  # live writes no files


def test_two_signals_at_once_are_one(motion: Path) -> None:
    """As a terminal and a wrapper that passes signals on send them; as soon as the address is told."""
    with animating(motion) as (process, _):
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGINT):
            process.send_signal(number)
        assert process.communicate(timeout=20) == ("", "")
        assert process.returncode == 0


def test_it_outlives_its_terminal_where_that_is_wished(motion: Path) -> None:
    """``nohup`` has hang-ups ignored."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # a child inherits it
    try:
        with animating(motion) as (process, url):
            process.send_signal(signal.SIGHUP)
            assert fetch(url)[0] == 200
            process.send_signal(signal.SIGTERM)
            assert process.communicate(timeout=20) == ("", "")
            assert process.returncode == 0
    finally:
        signal.signal(signal.SIGHUP, before)


def test_it_ends_when_nobody_reads_what_it_prints(motion: Path) -> None:
    with animating(motion) as (process, url):
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        assert fetch(url)[0] == 200
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0
        assert process.stderr.read() == ""


def test_a_motion_from_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    """Nobody writes to this one: reading it would last for ever."""
    pipe = tmp_path / "motion.csv"
    os.mkfifo(pipe)
    command = [sys.executable, "-m", "repctl_pin", "animate", "ppr", "--motion", str(pipe), "--live", "--no-browser"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("repctl: ") and done.stderr.count("\n") == 1 and "a device or a pipe" in done.stderr
    assert list(tmp_path.iterdir()) == [pipe]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
def test_a_real_browser_sees_it_and_does_not_hold_it(motion: Path, number: signal.Signals) -> None:
    require_browser()
    with browser(680, 600) as driver, animating(motion, "--no-browser") as (process, url):
        port = int(url.rstrip("/").rpartition(":")[2])
        open_page(driver, url)
        assert errors(driver) == []
        assert driver.execute_script("return location.href") == url + "#paused"
        assert driver.execute_script("return repctl.meshes(0)") == len(Visuals.of(rp.Robot.load("ppr")).shapes)
        assert changed(picture(driver, 0), picture(driver, 0.9)) > 0.004
        with socket.create_connection(("127.0.0.1", port)):  # as a browser keeps one in store
            process.send_signal(number)
            output = process.communicate(timeout=20)
        assert process.returncode == 0 and output == ("", "")
        assert not is_open(port)
        assert changed(picture(driver, 0), picture(driver, 0.9)) > 0.004  # the page needs it no more
        assert errors(driver) == []


def test_a_taken_port_is_one_clear_line(motion: Path) -> None:
    with LivePage(PAGE) as live:
        port = live.url.rstrip("/").rpartition(":")[2]
        done = subprocess.run(
            [sys.executable, "-m", "repctl_pin", "animate", "ppr", "--motion", str(motion), "--live", "--port", port],
            capture_output=True,
            text=True,
            timeout=60,
        )
    assert done.returncode == 2 and done.stdout == "" and len(done.stderr.splitlines()) == 1
    assert f"port {port}" in done.stderr
