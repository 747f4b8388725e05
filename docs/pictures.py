"""Make the pictures of the README and of the how-to pages: arms after cycles of a closed path.

    python docs/pictures.py                  all pictures, into examples/pictures/
    python docs/pictures.py ppr talos        some of them
    python docs/pictures.py --out elsewhere

Each picture is an animation page, opened in a headless Chromium and stopped at the end of the last
cycle. Translucent arms show cycle 1, lines show the traces of end effector and elbow, and the
colour of a body shows its displacement. ``panda.webp`` shows the end of every cycle: the end
effector stays, the elbow drifts. ``live_viewer.png`` and ``notebook.png`` show these as a user sees
them.

This requires a browser and its driver (Debian: ``chromium`` and ``chromium-driver``),
``pip install selenium``, for ``audit`` the packages of `examples/audit_pink.py`, and for
``notebook`` ``pip install nbconvert ipykernel``."""

from __future__ import annotations

import argparse
import io
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

import repctl_pin as rp
from repctl_pin.show.study_files import study_page

EXAMPLES = Path(__file__).parents[1] / "examples"
PICTURES = EXAMPLES / "pictures"
sys.path.append(str(EXAMPLES))
SIZE = (720, 620)
"""Size of the browser window in CSS pixels, each drawn as 2 × 2: small, so that text is legible at
the width of the gallery."""
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--hide-scrollbars",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--no-first-run",
    "--disable-background-networking",
)
"""Options of the browser: no screen, software rendering."""
SECONDS = 120.0
"""Maximum time that a page may take to become ready, s."""
LIMIT = 150_000
"""Maximum size of a picture, bytes."""


def one_arm(name: str, path: str | None = None) -> str:
    """Make the page of a study."""
    return study_page(rp.study(rp.Problem(name, path=path)))


def two_hands() -> str:
    """Make the page of both hands of talos, each on a separate circle."""
    from two_arms import HANDS, study_both

    return study_page(study_both(rp.Robot.load("talos"), HANDS))


def weld() -> str:
    """Make the page of a seam on the workpiece of a positioner."""
    from weld import study_seam

    return study_page(study_seam(1.0, 10))


def audit() -> str:
    """Make the page of a pink program, J⁺, and the pink program with a RepeatableTask."""
    from audit_pink import audit as motions

    return rp.animation(motions(cycles=10, steps=500)).page


GALLERY: dict[str, Callable[[], str]] = {
    "panda": lambda: one_arm("panda"),
    "my_arm": lambda: one_arm(str(EXAMPLES / "my_arm.urdf")),
    "talos": lambda: one_arm("talos"),
    "two_hands": two_hands,
    "weld": weld,
    "ppr": lambda: one_arm("ppr", "circle:0.4"),
    "planar7r": lambda: one_arm("planar7r"),
    "audit": audit,
}


@contextmanager
def opened(page: str, size: tuple[int, int] = SIZE) -> Iterator[webdriver.Chrome]:
    """Open a page, given as its text or address, in a headless Chromium."""
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    with tempfile.TemporaryDirectory() as folder:
        address = page
        if not page.startswith("http"):
            source = Path(folder) / "page.html"
            source.write_text(page, encoding="utf-8")
            address = source.as_uri() + "#paused"
        for flag in FLAGS:
            options.add_argument(flag)
        options.add_argument(f"--user-data-dir={folder}/profile")
        driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
        driver.set_script_timeout(SECONDS)
        try:
            width, height = size
            window = {"width": width, "height": height, "deviceScaleFactor": 2, "mobile": False}
            driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", window)
            driver.get(address)
            yield driver
        finally:
            driver.quit()


def _wait(driver: webdriver.Chrome, condition: str) -> None:
    """Wait until a condition of the page holds."""
    deadline = time.monotonic() + SECONDS
    while not driver.execute_script(f"return Boolean(window.repctl && repctl.{condition})"):
        if time.monotonic() > deadline:
            raise SystemExit(f"the page did not become {condition}")
        time.sleep(0.1)


def photograph(page: str, *, moving: bool = False) -> list[Image.Image]:
    """Photograph the heading and the scene of a page at the end of its last cycle; with ``moving``,
    at the end of every cycle, too."""
    with opened(page) as driver:
        _wait(driver, "ready")
        driver.execute_script(
            "document.head.append(Object.assign(document.createElement('style'),"
            "{ textContent: 'footer, #cards, .tiles { display: none !important }' }))"
        )
        last = driver.execute_script("return repctl.cycles")
        return [_shot(driver, cycle) for cycle in (range(last + 1) if moving else [last])]


def live_viewer() -> list[Image.Image]:
    """Photograph the live viewer at the end of ten cycles of two control loops."""
    study = rp.study("planar3r", steps=60)
    motions = [study.row(key).motion for key in ("pseudoinverse", "repeatable")]
    names, path, q0 = ["J⁺", "repeatable"], motions[0].path, study.q0
    with rp.Viewer(study.task, names, path=path, start=q0) as view, opened(view.url) as driver:
        _wait(driver, "ready")
        view.show(q0, q0)
        _wait(driver, "received")
        for k, (q, p) in enumerate(zip(*(motion.q for motion in motions), strict=True)):
            view.show(q, p, cycles=k // 60)
            # a picture takes long in software
            time.sleep(0.15)
        time.sleep(1.0)
        return [Image.open(io.BytesIO(driver.get_screenshot_as_png())).convert("RGB")]


def notebook() -> list[Image.Image]:
    """Photograph the first code cell of `examples/first_study.ipynb` after it was run."""
    import nbformat
    from nbconvert import HTMLExporter
    from nbconvert.preprocessors import ExecutePreprocessor

    book = nbformat.read(EXAMPLES / "first_study.ipynb", as_version=4)
    book.cells = book.cells[1:2]
    ExecutePreprocessor(timeout=600).preprocess(book, {"metadata": {"path": str(EXAMPLES)}})
    exporter = HTMLExporter(mathjax_url="", require_js_url="", jquery_url="")
    with opened(exporter.from_notebook_node(book)[0], (860, 790)) as driver:
        (frame,) = driver.find_elements("tag name", "iframe")
        driver.switch_to.frame(frame)
        _wait(driver, "ready")
        return [_shot(driver, driver.execute_script("repctl.pause(); return repctl.cycles"))]


SCREENS = {"live_viewer": live_viewer, "notebook": notebook}
"""The screens, by name."""


def keep(shots: list[Image.Image], file: Path) -> list[Path]:
    """Write the last picture and, of several, an animated one of all; returns the files."""
    file.parent.mkdir(parents=True, exist_ok=True)
    for width in (shots[-1].width, 1100, 980, 840, 760, 680, 640):
        few_colours(_narrow(shots[-1], width)).save(file, optimize=True)
        if file.stat().st_size <= LIMIT:
            break
    if len(shots) == 1:
        return [file]
    frames, strobe = [_narrow(shot, 1100) for shot in shots], file.with_suffix(".webp")
    times = [450] * (len(frames) - 1) + [2000]
    frames[0].save(
        strobe,
        save_all=True,
        append_images=frames[1:],
        duration=times,
        loop=0,
        quality=80,
        method=6,
    )
    return [file, strobe]


def _shot(driver: webdriver.Chrome, cycle: int) -> Image.Image:
    """Photograph the window at the end of a cycle."""
    driver.execute_script("repctl.seek(arguments[0])", cycle)
    # wait until the frame is drawn
    driver.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
    return Image.open(io.BytesIO(driver.get_screenshot_as_png())).convert("RGB")


def _narrow(picture: Image.Image, width: int) -> Image.Image:
    return picture.resize(
        (width, round(width * picture.height / picture.width)), Image.Resampling.LANCZOS
    )


def few_colours(picture: Image.Image) -> Image.Image:
    """Reduce a picture to 256 colours with dithering: the most frequent ones and those of the arms.

    The file is then a quarter of its size."""
    arms_and_white = [0xD5, 0x5E, 0x00, 0x00, 0x72, 0xB2, 255, 255, 255]
    palette = Image.new("P", (1, 1))
    palette.putpalette([*picture.quantize(253).getpalette()[: 253 * 3], *arms_and_white])
    return picture.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)


def main() -> None:
    """Make the requested pictures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = [*GALLERY, *SCREENS]
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"{', '.join(known)} (default: all)"
    )
    parser.add_argument("--out", type=Path, default=PICTURES, metavar="FOLDER")
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in known]
    if unknown:
        parser.error(f"no picture {unknown[0]!r}; choose from {', '.join(known)}")
    for name in options.names or known:
        if name in SCREENS:
            shots = SCREENS[name]()
        else:
            shots = photograph(GALLERY[name](), moving=name == "panda")
        for file in keep(shots, options.out / f"{name}.png"):
            print(f"wrote {file} ({file.stat().st_size / 1000:.0f} kB)", flush=True)


if __name__ == "__main__":
    main()
