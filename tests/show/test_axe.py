"""No finding of axe-core's, and no error at the console, on the pages that hold a page in a
frame: cells, reports, notebooks; and on those of recordings."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from arms import planar_urdf, upright_urdf
from browser import asleep, errors, only_pictures_asked_for, schemes, wait_until_drawn
from commands import main

import repctl_pin as rp

pytestmark = pytest.mark.slow

SMALL = ["--degree", "1", "--cycles", "2", "--steps", "60"]


def the_page_of(kind: str, folder: Path) -> Path:
    """Write a page of this kind, of a small arm."""
    arm, out = folder / "arm.urdf", folder / "out"
    sector = kind == "sector"
    arm.write_text(upright_urdf() if sector else planar_urdf([1.0, 0.9, 0.8]), encoding="utf-8")
    task = [] if sector else ["--frame", "tool", "--task", "xy", "--start", "0.6,-1.2,1.4"]
    of = [str(arm), *task, "--out", str(out)]
    if kind == "report":
        assert main(["study", *of, *SMALL, "--path", "circle:0.3", "--report"]) == 0
    elif kind == "cell":
        sizes = ["--half-width", "0.2", "--degree", "2", "--held-out", "256"]
        assert main(["cell", *of, *sizes]) == 0
    elif kind == "sector":
        sizes = ["--radius", "0.02", "--height", "0.03", "--down"]
        few = ["--degree", "1", "--held-out", "64"]
        assert main(["cell", *of, "--sector", *sizes, *few]) == 0
    elif kind == "audit":
        log = folder / "log.csv"
        path = ["--path", "circle:0.3", "--strategy", "pseudoinverse", "--cycles", "3"]
        assert main(["follow", *of[:-2], *path, "--csv", str(log)]) == 0
        assert main(["audit", str(log), "--robot", *of[:5], "--out", str(out)]) == 0
    else:
        return the_notebook(folder)
    return out / {"sector": "cell.html"}.get(kind, f"{kind}.html")


def the_notebook(folder: Path) -> Path:
    """Export a notebook whose one cell shows a study."""
    from nbconvert import HTMLExporter
    from nbformat import v4

    # nothing of its own from a network
    export = HTMLExporter(mathjax_url="", require_js_url="", jquery_url="")
    shown = rp.study("ppr", cycles=2, degree=1, steps=60)._repr_html_()
    output = v4.new_output("display_data", data={"text/html": shown})
    book = v4.new_notebook(cells=[v4.new_code_cell("study", outputs=[output])])
    page = folder / "notebook.html"
    page.write_text(export.from_notebook_node(book)[0], encoding="utf-8")
    return page


def frames_of(driver: Any) -> Iterator[Any]:
    """The page, or every page in a frame of it, once it is drawn; with the help open last."""
    frames = driver.find_elements("css selector", "iframe")
    for frame in frames or [None]:
        if frame is not None:
            driver.execute_script("arguments[0].scrollIntoView()", frame)
            driver.switch_to.frame(frame)
        wait_until_drawn(driver, "a page in a frame")
        only_pictures_asked_for(driver)
        driver.execute_script("repctl.pause(); repctl.seek(2); repctl.placed()")
        yield frame
        driver.execute_script("document.getElementById('help').click()")
        yield frame
        driver.execute_script("document.getElementById('keys').close()")
        driver.switch_to.default_content()


@pytest.mark.parametrize("kind", ["cell", "sector", "audit", "report", "notebook"])
def test_pages_with_frames_can_be_read(driver: Any, tmp_path: Path, kind: str) -> None:
    axe = pytest.importorskip("axe_selenium_python").Axe(driver)
    page = the_page_of(kind, tmp_path)
    driver.set_script_timeout(180)
    schemes(driver, width=1280, height=760)
    with asleep(driver):
        driver.get(page.as_uri() + "#paused")

    def clean() -> None:
        axe.inject()
        # since HTML 5.2 a <div> may group <dt> and <dd>
        found = axe.run(options="{rules: {dlitem: {enabled: false}}}")["violations"]
        assert found == [], json.dumps([(v["id"], [n["html"] for n in v["nodes"]]) for v in found])

    for dark in (False, True):
        schemes(driver, width=1280, height=760, dark=dark)
        for _ in frames_of(driver):
            clean()
            assert errors(driver) == []
        if kind not in ("notebook", "audit"):  # a notebook's own page is Jupyter's
            clean()
            assert errors(driver) == []
