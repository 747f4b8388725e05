"""A notebook: executed by a real kernel, exported, and looked at in a real browser."""

from __future__ import annotations

import base64
import html
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import changed, errors, picture, schemes, wait_until_drawn
from commands import printed, without_pictures
from matplotlib.figure import Figure
from page_file import Drawn
from store import study_of

import repctl_pin as rp
from repctl_pin.show.notebook import inline

SETTING = {"cycles": 2, "degree": 1, "steps": 60}

CELLS = (
    "import repctl_pin as rp\nfrom repctl_pin.show.notebook import inline",
    f"study = rp.study('ppr', **{SETTING})",
    "inline(study, height=500)",
    "from matplotlib.figure import Figure\nmine = Figure()\n"
    "lines = mine.add_subplot().plot(study.row('pseudoinverse').motion.drift)",
    "inline(mine)",
    "import matplotlib.pyplot as plt\nax = plt.figure().add_subplot()",
)


def mine(study: rp.Study) -> Figure:
    """The figure of the fourth cell."""
    figure = Figure()
    figure.add_subplot().plot(study.row("pseudoinverse").motion.drift)
    return figure


def test_results_print_in_words() -> None:
    """As a cell shows them, in one line: what it is, and the numbers that are asked for first."""
    panda, arm = (rp.Robot.load("panda").task(), rp.Robot.load("planar3r").task("tool", "xy"))
    bodies, q0 = rp.Bodies(panda), np.array([0.3, 0.8, 0.8])
    counts = f"{len(bodies.pairs)} pairs measured, {len(bodies.only_contact)} for collisions only"
    left_out = f"{len(bodies.adjacent)} adjacent, 0 disabled by the SRDF, 0 overlapping"
    assert (
        repr(bodies) == f"<Bodies of panda: {counts}; not checked: {left_out}>"
        and len(bodies.pairs) > 10
    )
    control = rp.Pseudoinverse(arm)
    verdict = rp.is_repeatable(control, rp.Box(q0, 0.2))
    assert repr(verdict) == f"<Repeatability: {verdict.summary()}>"
    timed = rp.timed(
        rp.follow(control, rp.circle(arm, q0, 0.2), q0, cycles=1, steps=60),
        rp.Limits(acceleration=5.0),
        rate=100,
    )
    lasts = f"{timed.duration:.4g} s from rest to rest, {len(timed.t)} samples"
    said = f"<TimedMotion of 3 joints: {lasts}>"
    assert repr(timed) == said and abs(len(timed.t) / 100 - timed.duration) < 0.05


@pytest.fixture(autouse=True, scope="module")
def quick() -> None:
    """The kernel makes the choices that users get, so these tests make them, too."""


@pytest.fixture(scope="module")
def study() -> rp.Study:
    return rp.study("ppr", **SETTING)


@pytest.fixture(scope="module")
def cell(study: rp.Study) -> tuple[Any, list[Figure]]:
    """What a cell shows, and the figures that were drawn for it."""
    save, figures = Figure.savefig, []

    def saved(figure: Figure, *given: Any, **options: Any) -> None:
        figures.append(figure)
        save(figure, *given, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", saved)
        return inline(study, height=500), figures


@pytest.fixture(scope="module")
def full(study: rp.Study, tmp_path_factory: pytest.TempPathFactory) -> str:
    """What ``repctl study --full`` prints of the study."""
    text, _ = printed(study, tmp_path_factory.mktemp("full"), "--full")
    return text.partition("\n\nwrote ")[0]


@pytest.fixture(scope="module")
def notebook(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The notebook after a kernel of this Python has run it, outputs and all."""
    from nbclient import NotebookClient
    from nbformat import v4

    folder = tmp_path_factory.mktemp("notebook")
    with pytest.MonkeyPatch.context() as patch:
        for name in ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR"):
            patch.setenv(name, str(folder / name.lower()))  # nobody's own settings
        cells = [v4.new_code_cell(source) for source in CELLS]
        book = v4.new_notebook(cells=cells)
        return NotebookClient(book, kernel_name="python3", timeout=120).execute(cwd=str(folder))


def shown(cell: Any) -> Any:
    """What a cell shows: its one output's data, by MIME type."""
    # Python's own warnings
    (output,) = [output for output in cell.outputs if output.output_type != "stream"]
    return output.data


def pictures(text: str) -> list[np.ndarray]:
    from PIL import Image

    held = re.findall(r'src="data:image/png;base64,([^"]*)"', text)
    return [
        np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"), np.int16)
        for data in held
    ]


def drawing(figure: Any) -> np.ndarray:
    """A figure's picture, 192 pixels an inch, as matplotlib's own canvas holds it."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_dpi(192)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].astype(np.int16)


@pytest.mark.slow
def test_a_cell_holds_the_page_the_table_and_the_figures(
    study: rp.Study, cell: tuple[Any, list[Figure]], full: str
) -> None:
    shown, figures = cell
    text = shown._repr_html_()
    held = re.search(r'srcdoc="([^"]*)"', text)
    assert held is not None and html.unescape(held[1]) == rp.animation(study).page
    assert "height: 500px" in text
    told = re.search(r"<pre[^>]*>(.*?)</pre>", text, re.DOTALL)
    assert told is not None and html.unescape(told[1]) == repr(shown) == full
    for image, figure in zip(pictures(text), figures, strict=True):
        np.testing.assert_array_equal(image, drawing(figure))
    drift, joints = figures
    motion = study.row("pseudoinverse").motion
    (inset,) = drift.axes[0].child_axes
    assert inset.lines[0].get_ydata().tolist() == motion.drift.tolist()
    for ax, q in zip(joints.axes, motion.q.T, strict=True):
        assert ax.lines[0].get_ydata().tolist() == q.tolist()


@pytest.mark.slow
def test_a_study_shows_itself(study: rp.Study) -> None:
    assert study._repr_html_() == inline(study).html == rp.animation(study)._repr_html_()


def test_pictures_have_words(quick_choices: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """For who cannot see them: how far each is off, and the drift of every joint under J⁺."""
    study = study_of("ppr")
    without_pictures(monkeypatch)
    found = re.findall('alt="([^"]*)"', inline(study, height=500)._repr_html_())
    drift, joints = (html.unescape(words) for words in found)
    said, _, inset = drift.partition(". Inset: ")
    assert inset == "the joint drift, rad and m, on a log scale."
    parts = said.partition("after each cycle: ")[2].split("; ")
    strategies = study.as_dict()["strategies"].values()
    for part, found in zip(parts, strategies, strict=True):
        off = found["farthest"]["displacement"]
        last = re.search(r"first cycle, (\S+)(?: (.?m))? after the last$", part)
        assert last is not None
        scale = {None: 0.0, "m": 1.0, "cm": 100.0, "mm": 1000.0}[last[2]]
        assert float(last[1]) == pytest.approx(scale * off, rel=0.05)
    motion = study.row("pseudoinverse").motion
    said = re.search(r"Under usual control the joints have drifted by: (.*)\.$", joints)
    for part, name, value in zip(
        said[1].split(", "), study.task.joint_names, motion.q[-1] - motion.q[0], strict=True
    ):
        assert part == f"{name} {value:+.3g}"


def test_a_figure_and_a_page_are_shown_too(quick_choices: None) -> None:
    study = study_of("ppr")
    (image,) = pictures(inline(mine(study))._repr_html_())
    np.testing.assert_array_equal(image, drawing(mine(study)))
    page = inline('<p title="x">&amp;</p>')
    held = re.search(r'srcdoc="([^"]*)"', page._repr_html_())
    assert held is not None and html.unescape(held[1]) == '<p title="x">&amp;</p>'
    assert repr(page) == "<page of 0.0 MB>"


def test_what_cannot_be_shown_is_said(quick_choices: None) -> None:
    study = study_of("ppr")
    with pytest.raises(
        rp.InputError, match="a study, a matplotlib figure or the HTML of a page; got Design"
    ):
        inline(study.design)  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_kernel_shows_the_scene_and_the_figures(
    notebook: Any, study: rp.Study, cell: tuple[Any, list[Figure]], full: str
) -> None:
    scene, figure, of_pyplot = (notebook.cells[k] for k in (2, 4, 5))
    assert shown(scene) == {"text/html": cell[0].html, "text/plain": full}
    (image,) = pictures(shown(figure)["text/html"])
    np.testing.assert_array_equal(image, drawing(mine(study)))
    assert shown(of_pyplot)["image/png"]  # as any of pyplot's figures
    assert not any(notebook.cells[k].outputs for k in (0, 1, 3))  # nothing is printed


@pytest.mark.slow
def test_the_exported_notebook_plays_in_a_browser(
    notebook: Any, tmp_path: Path, driver: Any
) -> None:
    from nbconvert import HTMLExporter
    from selenium.webdriver import ActionChains

    # nothing of its own from a network
    exporter = HTMLExporter(mathjax_url="", require_js_url="", jquery_url="")
    file = tmp_path / "notebook.html"
    file.write_text(exporter.from_notebook_node(notebook)[0], encoding="utf-8")
    schemes(driver, width=1100, height=600)
    driver.get(file.as_uri())
    (frame,) = driver.find_elements("tag name", "iframe")
    assert frame.size["height"] == 500 and frame.size["width"] > 800
    for image in driver.find_elements("css selector", "img[src^='data:image/png']"):
        assert 0 < image.size["width"] <= frame.size["width"]
    driver.execute_script("arguments[0].scrollIntoView({ block: 'center' })", frame)
    driver.switch_to.frame(frame)
    wait_until_drawn(driver, "the cell")
    driver.execute_script("repctl.play()")
    assert driver.execute_script("return repctl.playing")
    driver.execute_script("repctl.pause()")
    # the wheel scrolls the notebook, unless the picture has the focus
    wheel = (
        "const w = new WheelEvent('wheel', { deltaY: 100, cancelable: true, bubbles: true });"
        "repctl.viewer.renderer.domElement.dispatchEvent(w); return w.defaultPrevented"
    )
    assert not driver.execute_script(wheel)
    ActionChains(driver).click(driver.find_element("id", "picture")).perform()
    assert (
        driver.execute_script("return document.hasFocus() && document.activeElement.id") == "panes"
    )
    assert driver.execute_script(wheel)
    driver.execute_script("document.activeElement.blur()")
    assert not driver.execute_script(wheel)
    count = len(Drawn(rp.Robot.load("ppr")).names)
    assert driver.execute_script("return [repctl.meshes(0), repctl.meshes(1)]") == [count, count]
    assert changed(picture(driver, 0), picture(driver, 0.25)) > 0.004
    assert driver.execute_script(
        "try { return String(parent.document.title) } catch (e) { return e.name }"
    ) == (
        "SecurityError"  # the page cannot reach the notebook
    )
    assert errors(driver) == []
