"""The report: valid, complete, self-contained, and whole on paper."""

from __future__ import annotations

import base64
import html
import io
import platform
import re
import shlex
from html.parser import HTMLParser
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import asleep, errors, schemes, wait_until_drawn
from commands import main, without_pictures
from PIL import Image
from said import reads
from store import study_of

import repctl_pin as rp

COMMAND = "repctl study planar3r --cycles 2 --out 'my <folder>' --report"


class Tags(HTMLParser):
    """Collects every start tag with its attributes."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def all(self, name: str) -> list[dict[str, str | None]]:
        return [attributes for tag, attributes in self.tags if tag == name]


@pytest.fixture(scope="module")
def study() -> rp.Study:
    return study_of("planar3r", 2, 100)


@pytest.mark.slow
def test_its_legend_names_the_columns(page: str) -> None:
    """28: one word for one controller, in the table and below it; no mark without its meaning."""
    heads = re.findall(r'<th scope="col">.*?</span>(.*?)</th>', page)
    (legend,) = re.findall(r'</div>\s*<p class="legend">(.*?)</p>', page)
    assert "Usual + posture" in heads and "≠" not in page
    for head in heads[1:]:
        assert head.lower() in legend.lower(), head
    assert "J⁺ + posture" not in legend


@pytest.fixture(scope="module")
def tags(page: str) -> Tags:
    return Tags(page)


@pytest.fixture(scope="module")
def page(study: rp.Study, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The report that the command writes of a study that is there already; pictures are blank."""
    with pytest.MonkeyPatch.context() as patch:
        without_pictures(patch)
        return written(study, tmp_path_factory.mktemp("report"))


@pytest.fixture(scope="module")
def drawn(study: rp.Study, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The report with its pictures."""
    return written(study, tmp_path_factory.mktemp("drawn"))


def written(study: rp.Study, folder: Path) -> str:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(rp, "Problem", lambda *_, **__: None)
        patch.setattr(rp, "study", lambda *_, **__: study)
        assert main(shlex.split(COMMAND)[1:]) == 0
    return (folder / "my <folder>" / "report.html").read_text(encoding="utf-8")


def shortened(page: str) -> str:
    """The page with its base64 and its scripts cut short, which no parser need read by letters.

    A script ends with its first end tag, and must hold no comment of HTML."""
    text = re.sub(r"[A-Za-z0-9+/=]{2000,}", "AAAA", page)
    scripts = re.findall(r"(?s)(<script[^>]*>)(.*?)</script>", text)
    assert scripts and not any("<!--" in body for _, body in scripts)
    return re.sub(r"(?s)(<script[^>]*>)(.*?)</script>", r"\1text</script>", text)


def test_it_is_valid_html_and_so_is_the_animation_inside(page: str, tags: Tags) -> None:
    html5lib = pytest.importorskip("html5lib")
    (frame,) = tags.all("iframe")
    outside = re.sub('srcdoc="[^"]*"', 'srcdoc="text"', page)
    for text in (outside, frame["srcdoc"]):
        html5lib.HTMLParser(strict=True).parse(shortened(text))  # raises where there is an error
        ids = re.findall(
            r'\sid="([^"]+)"', re.sub(r"(?s)<script>.*?</script>|srcdoc=\"[^\"]*\"", "", text)
        )
        assert len(ids) == len(set(ids))


def test_every_picture_has_words(tags: Tags) -> None:
    images = tags.all("img")
    assert len(images) == 6  # still, drift, joints, orbits, cycle, maps
    for image in images:
        assert len(image["alt"]) > 60 and "nan" not in image["alt"]
    assert len({image["alt"] for image in images}) == 6
    (frame,) = tags.all("iframe")
    assert frame["title"].startswith("Animation")


@pytest.mark.slow
def test_every_picture_is_one(drawn: str) -> None:
    images = Tags(drawn).all("img")
    assert len(images) == 6
    for image in images:
        kind, _, data = image["src"].partition(",")
        assert kind == "data:image/png;base64"
        picture = Image.open(io.BytesIO(base64.b64decode(data)))
        assert picture.size == (int(image["width"]), int(image["height"]))
        assert np.ptp(np.asarray(picture.convert("L"))) > 200


def test_it_asks_nothing_of_a_network(page: str, tags: Tags, study: rp.Study) -> None:
    (frame,) = tags.all("iframe")
    inside = re.sub(r'<meta name="repctl-run" content="[\w-]+">\n', "", frame["srcdoc"])
    made = r"\s*<dt>This page</dt>.*</dd>\n"  # only a page of the command line has its command
    assert re.findall(made, inside) and not re.findall(made, rp.animation(study).page)
    assert re.sub(made, "\n", inside) == rp.animation(study).page.replace(
        "<body>", '<body class="inside">'
    )
    for tag, attributes in tags.tags:
        for name in ("src", "href"):
            assert attributes.get(name, "data:").startswith("data:"), (tag, attributes)
    assert "url(" not in page.replace(html.escape(frame["srcdoc"], quote=True), "")


def test_it_says_what_was_found_and_how_to_repeat_it(page: str, study: rp.Study) -> None:
    text = html.unescape(page)
    rows = study.row("pseudoinverse"), study.row("repeatable")
    plain, closed = (row.motion for row in rows)
    table = {
        name: re.findall("<td>(.*?)</td>", cells)
        for name, cells in re.findall(r'<th scope="row">(.*?)</th>(.*)</tr>', text)
    }
    for cycle, name in enumerate(("drift after 1 cycle, rad", "drift after 2 cycles, rad")):
        assert reads(table[name][0], plain.drift[cycle], 3)
    assert closed.closes and float(table["drift after 2 cycles, rad"][-1]) < 1e-5
    assert reads(table["distance from J⁺"][-1], rows[1].distance, 3)
    speeds = (("joint speed, cycle 1, rad/s", 100), ("joint speed, all cycles, rad/s", 200))
    for name, steps in speeds:
        for motion, said in zip((plain, closed), table[name][:: len(table[name]) - 1], strict=True):
            speed = np.sqrt(np.sum(motion.qdot[:steps] ** 2) / steps)
            assert reads(said, speed, 3)
    assert float(table["leaf margin"][-1]) == pytest.approx(rows[1].leaf_margin, abs=5.01e-3)
    assert f"<code>{COMMAND}</code>" in text
    frame = re.compile('srcdoc="[^"]*"')
    for part in ("verdict", "notes"):  # as on the animation's own page
        (found,) = re.findall(rf'<p id="{part}">.*?</p>', frame.sub("", page))
        assert found in rp.animation(study).page and len(found) > 60
    folded = text[text.index("<details>") :]  # what the command does not name
    assert (
        "<dt>seed</dt>" in folded and "<dt>cycles</dt><dd>2</dd>" in text[: text.index("<details>")]
    )
    assert f"<dd>{', '.join(f'{v:.10g}' for v in study.q0)}</dd>" in text
    for name, edition in (
        ("repctl_pin", rp.__version__),
        ("numpy", np.__version__),
        ("Python", platform.python_version()),
        ("pin", version("pin")),
        ("meshcat", version("meshcat")),
    ):
        assert f"<dt>{name}</dt><dd>{edition}</dd>" in text
    assert (
        "<dt>seed</dt><dd>0</dd>" in text and "<dt>frame</dt><dd>chosen by the study</dd>" in text
    )
    lines = re.findall(r"<tr>(.*?)</tr>", page)
    said = re.search(r"cycles, rad</th><td>(\S+?)</td>", lines[4])
    assert len(lines) == 17 and reads(said[1], plain.drift[-1], 3)


@pytest.mark.slow
@pytest.mark.usefixtures("blank_pictures")
def test_the_command_writes_it_for_ones_own_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import hashlib
    import json

    monkeypatch.chdir(tmp_path)
    urdf = (Path(__file__).parents[2] / "urdf" / "planar3r.urdf").read_text(encoding="utf-8")
    (tmp_path / "my_arm.urdf").write_text(urdf, encoding="utf-8")
    arguments = [
        "study",
        "my_arm.urdf",
        "--cycles",
        "2",
        "--steps",
        "60",
        "--degree",
        "1",
        "--report",
    ]
    assert main([*arguments, "--json"]) == 0
    written = json.loads(capsys.readouterr().out)["files"]
    assert written[-1] == "repctl-out/my_arm/report.html" and len(written) == 6
    text = html.unescape(Path(written[-1]).read_text(encoding="utf-8"))
    assert f"<code>repctl {' '.join(arguments)} --json</code>" in text
    for option, value in (("cycles", "2"), ("steps", "60"), ("degree", "1"), ("seed", "0")):
        assert f"<dt>{option}</dt><dd>{value}</dd>" in text
    assert hashlib.sha256(urdf.encode()).hexdigest() in text
    assert len(Tags(text).all("img")) >= 6


@pytest.mark.slow
def test_it_plays_offline_and_no_figure_is_cut_on_paper(
    drawn: str, tmp_path: Path, driver: Any
) -> None:
    """Each picture is on one page of the PDF, inside its margins, as wide against its height as it
    was drawn."""
    pdfium = pytest.importorskip("pypdfium2")
    source = tmp_path / "report.html"
    source.write_text(drawn, encoding="utf-8")
    schemes(driver, width=700, height=500)
    with asleep(driver):
        driver.get(source.as_uri())
        driver.switch_to.frame(driver.find_element("tag name", "iframe"))
        wait_until_drawn(driver, "the report's animation")
    assert driver.execute_script("return repctl.playing") and errors(driver) == []
    driver.execute_script("repctl.pause(); window.awake = true")
    driver.switch_to.default_content()
    assert driver.execute_script(
        "return [...document.images].every((i) => i.complete && i.naturalWidth > 100)"
    )
    assert driver.execute_script("return document.documentElement.scrollWidth <= window.innerWidth")
    printed = driver.execute_cdp_cmd(
        "Page.printToPDF", {"preferCSSPageSize": True, "printBackground": True}
    )
    found = []
    for sheet in pdfium.PdfDocument(base64.b64decode(printed["data"])):
        width, height = sheet.get_size()
        for thing in sheet.get_objects():
            if thing.type == 3:  # an image
                left, bottom, right, top = thing.get_bounds()
                assert 40 < left < right < width - 40 and 40 < bottom < top < height - 40
                found.append((right - left) / (top - bottom))
    shapes = [int(image["width"]) / int(image["height"]) for image in Tags(drawn).all("img")]
    url = driver.execute_script("return document.querySelector('.still canvas').toDataURL()")
    rendered = Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2]))).convert("RGB")
    pixels = np.asarray(rendered, float)  # what the animation draws, on white
    assert (pixels[-1, 0] == 255).all() and np.ptp(pixels) > 150 and (pixels < 250).mean() > 0.01
    panes, figures = found[:-5], found[-5:]  # each arm is printed under its own name
    assert len(panes) == 2 and panes[0] == pytest.approx(panes[1], rel=0.01)
    np.testing.assert_allclose(figures, shapes[-5:], rtol=0.01)


def test_what_the_report_speaks_of_is_explained(page: str) -> None:
    outside = re.sub('srcdoc="[^"]*"', "", page)
    terms = "repeatable", "drift", "Ω", "leaf margin", "redundant", "cost"
    for word in ("usual control, J⁺", *terms):
        words, *_ = re.findall(rf"<dt>{re.escape(word)}</dt>\s*<dd>(.*?)</dd>", outside)
        assert len(words) > 40
