"""Drive a real headless Chromium through Selenium: open a page offline, take pictures at exact
times."""

from __future__ import annotations

import base64
import io
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

CHROMIUM = shutil.which("chromium")
DRIVER = shutil.which("chromedriver")

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--use-angle=swiftshader",  # WebGL in software
    "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",  # the page itself without WebGL, in a third of the time
    "--ignore-gpu-blocklist",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",  # offline: no name resolves
)


_ASLEEP = """
for (const context of [WebGLRenderingContext.prototype, WebGL2RenderingContext.prototype])
  for (const name of ["drawElements", "drawArrays"]) {
    const draw = context[name];
    context[name] = function (...what) { if (window.awake) draw.apply(this, what); };
  }
"""
"""What is drawn while a page opens is looked at by nobody, and takes ten seconds in software."""

_THRIFT = """
window.awake = true;
const { viewer, picture } = repctl, draw = viewer.render;
viewer.scene.traverse((node) => { if (node.isLight) node.castShadow = false; });
viewer.render = () => {};
repctl.picture = () => { viewer.render = draw;
  try { return picture(); } finally { viewer.render = () => {}; } };
repctl.placed = () => { window.awake = false;
  try { draw.call(viewer); } finally { window.awake = true; } };
"""
"""A picture costs a second in software: none is drawn but those that are asked for, and without
shadows. ``repctl.placed()`` does what a picture does, rings and labels included, but draws no
shape."""


def require_browser() -> None:
    """Skip the test where there is no Chromium; fail it on CI, where there must be one."""
    if CHROMIUM and DRIVER:
        return
    reason = (
        "chromium and chromedriver are not installed (apt-get install chromium chromium-driver)"
    )
    if os.environ.get("CI") == "true":
        pytest.fail(reason)
    pytest.skip(reason)


@contextmanager
def browser(width: int = 1280, height: int = 760) -> Iterator[Any]:
    """Open a browser with nothing in it, and close it again."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM or ""
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    with tempfile.TemporaryDirectory(prefix="repctl-browser-") as profile:
        for flag in (*FLAGS, f"--user-data-dir={profile}", f"--window-size={width},{height}"):
            options.add_argument(flag)
        driver = webdriver.Chrome(options=options, service=Service(DRIVER))
        driver.set_script_timeout(60)
        try:
            yield driver
        finally:
            driver.quit()


@contextmanager
def asleep(driver: Any, more: str = "") -> Iterator[None]:
    """Pages that are opened within draw nothing until they are awake; ``more`` runs before their
    own scripts."""
    script = driver.execute_cdp_cmd(
        "Page.addScriptToEvaluateOnNewDocument", {"source": _ASLEEP + more}
    )
    try:
        yield
    finally:
        driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)


def open_page(driver: Any, page: Path | str, *, seconds: float = 60.0) -> None:
    """Open an animation from its file or address and wait until all of it is drawn; it stands
    still."""
    address = page.resolve().as_uri() if isinstance(page, Path) else page
    # an address that differs by nothing, or by its #, would not load anew
    driver.get("about:blank")
    driver.get_log("browser")  # what came before is not this page's
    with asleep(driver):
        driver.get(address + "#paused")
    wait_until_drawn(driver, address, seconds=seconds)
    only_pictures_asked_for(driver)


def only_pictures_asked_for(driver: Any) -> None:
    """Have a page that was opened ``asleep`` draw only the pictures that a test takes."""
    driver.execute_script(_THRIFT)


def wait_until_drawn(driver: Any, name: str, *, seconds: float = 60.0) -> None:
    """Wait until all of the animation that the driver looks at, a page or a frame in one, is
    drawn."""
    deadline = time.monotonic() + seconds
    while not driver.execute_script(
        "return Boolean(window.repctl && (repctl.ready || repctl.errors.length))"
    ):
        assert time.monotonic() < deadline, (
            f"{name} did not become ready in {seconds:g} s: {errors(driver)}"
        )
        time.sleep(0.05)


def errors(driver: Any) -> list[str]:
    """Everything that went wrong on the page: the console's errors and the page's own list."""
    console = [
        entry["message"] for entry in driver.get_log("browser") if entry["level"] == "SEVERE"
    ]
    return console + driver.execute_script("return (window.repctl && repctl.errors) || []")


def picture(
    driver: Any, cycles: float, *, traces: bool = False, ghost: bool = True
) -> NDArray[np.int16]:
    """Take the scene's picture at a time, in cycles: (height, width, 3), 0 to 255; with what drift
    leaves, or not."""
    driver.execute_script(
        "const [time, left, ghost] = arguments; repctl.set('traces', left); repctl.set('drift', "
        "left);"
        "repctl.set('ghost', ghost); repctl.seek(time)",
        cycles,
        traces,
        ghost,
    )
    return picture_now(driver)


def picture_now(driver: Any) -> NDArray[np.int16]:
    """Take the scene's picture as it is."""
    from PIL import Image

    url = driver.execute_script("return repctl.picture()")
    image = Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2])))
    return np.asarray(image.convert("RGB"), np.int16)


def pane(driver: Any, image: NDArray[np.int16], arm: int) -> NDArray[np.int16]:
    """Cut an arm's pane out of the picture."""
    left, top, width, height = driver.execute_script("return repctl.pane(arguments[0])", arm)
    tall, wide = image.shape[:2]
    return image[
        round(top * tall) : round((top + height) * tall),
        round(left * wide) : round((left + width) * wide),
    ]


def schemes(
    driver: Any, *, width: int, height: int, dark: bool = False, still: bool = False
) -> None:
    """Set the size of the window's inside, and what the person has asked of colours and motion."""
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    wishes = {
        "prefers-color-scheme": "dark" if dark else "light",
        "prefers-reduced-motion": "reduce" if still else "",
    }
    driver.execute_cdp_cmd(
        "Emulation.setEmulatedMedia",
        {"features": [{"name": k, "value": v} for k, v in wishes.items()]},
    )


def changed(a: NDArray[np.int16], b: NDArray[np.int16]) -> float:
    """The fraction of pixels that differ visibly."""
    return float(np.mean(np.abs(a - b).max(axis=-1) > 8))
