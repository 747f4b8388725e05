"""Make the pictures of the README: arms after cycles of a closed path, as the animation shows them.

    python docs/pictures.py                  all pictures, into examples/pictures/
    python docs/pictures.py ppr talos        some of them
    python docs/pictures.py --out elsewhere

Each picture is an animation page, opened in a headless Chromium and stopped at the end of the last
cycle. Translucent arms show cycle 1, lines show the traces of end effector and elbow, and the
colour of a body shows its displacement. ``panda.webp`` shows the end of every cycle: the end
effector stays, the elbow drifts.

This requires a browser and its driver (Debian: ``chromium`` and ``chromium-driver``),
``pip install selenium``, and for ``audit`` the packages of `examples/audit_pink.py`."""

from __future__ import annotations

import argparse
import io
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
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


def photograph(
    page: str, file: Path, *, seconds: float = 120.0, moving: bool = False
) -> list[Path]:
    """Photograph the heading and the scene of a page at the end of its last cycle; with ``moving``,
    at the end of every cycle, too."""
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "page.html"
        source.write_text(page, encoding="utf-8")
        for flag in FLAGS:
            options.add_argument(flag)
        options.add_argument(f"--user-data-dir={folder}/profile")
        driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
        driver.set_script_timeout(seconds)
        try:
            size = {"width": SIZE[0], "height": SIZE[1], "deviceScaleFactor": 2, "mobile": False}
            driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
            driver.get(source.as_uri() + "#paused")
            deadline = time.monotonic() + seconds
            while not driver.execute_script("return Boolean(window.repctl && repctl.ready)"):
                if time.monotonic() > deadline:
                    raise SystemExit(f"{file.name}: the page did not become ready")
                time.sleep(0.1)
            driver.execute_script(
                "document.head.append(Object.assign(document.createElement('style'),"
                "{ textContent: 'footer, #cards, .tiles { display: none !important }' }))"
            )
            last = driver.execute_script("return repctl.cycles")
            shots = [_shot(driver, cycle) for cycle in (range(last + 1) if moving else [last])]
        finally:
            driver.quit()
    file.parent.mkdir(parents=True, exist_ok=True)
    for width in (shots[-1].width, 1100, 980, 840, 760, 680, 640):
        few_colours(_narrow(shots[-1], width)).save(file, optimize=True)
        if file.stat().st_size <= LIMIT:
            break
    if not moving:
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
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"{', '.join(GALLERY)} (default: all)"
    )
    parser.add_argument("--out", type=Path, default=PICTURES, metavar="FOLDER")
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in GALLERY]
    if unknown:
        parser.error(f"no picture {unknown[0]!r}; choose from {', '.join(GALLERY)}")
    for name in options.names or GALLERY:
        for file in photograph(
            GALLERY[name](), options.out / f"{name}.png", moving=name == "panda"
        ):
            print(f"wrote {file} ({file.stat().st_size / 1000:.0f} kB)", flush=True)


if __name__ == "__main__":
    main()
