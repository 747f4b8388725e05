"""``repctl cell``: the table and the files, a path followed with what it saved, and what it
refuses."""

from __future__ import annotations

import json
import re
from decimal import ROUND_FLOOR, Decimal
from html import unescape
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
import sectors
from arms import planar_urdf, upright_urdf
from browser import asleep, errors, schemes, wait_until_drawn
from commands import main
from controls import NEEDS_C, some
from page_file import read
from scipy.spatial.transform import Rotation

import repctl_pin as rp


def cell_of(made: Path) -> list[str]:
    """The command for a cell of the arm that was made."""
    task = ["--frame", "tool", "--task", "xy", "--start", "0.6,-1.2,1.4"]
    return ["cell", str(made / "arm.urdf"), *task]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cell")
    (folder / "arm.urdf").write_text(planar_urdf([1.0, 0.9, 0.8]), encoding="utf-8")
    words = [
        "cell",
        str(folder / "arm.urdf"),
        "--frame",
        "tool",
        "--task",
        "xy",
        "--start",
        "0.6,-1.2,1.4",
    ]
    words += [
        "--half-width",
        "0.2",
        "--degree",
        "2",
        "--held-out",
        "256",
        "--out",
        str(folder / "out"),
    ]
    assert main(words) == 0
    return folder


@pytest.mark.slow
def test_the_files_and_a_path_inside(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert sorted(file.name for file in (made / "out").iterdir()) == [
        "cell.html",
        "cell.json",
        "cell.png",
    ]
    assert (made / "out" / "cell.png").read_bytes()[:4] == b"\x89PNG"
    words = [
        "follow",
        str(made / "out" / "cell.json"),
        "--robot",
        str(made / "arm.urdf"),
        "--path",
        "circle:0.05",
    ]
    assert main([*words, "--steps", "100", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["drift"][0] < 1e-9 and said["outside"] == 0
    assert main([*words[:-1], "circle:0.4", "--steps", "100", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["outside"] > 0.1


def test_the_page_shows_the_box_and_a_tour_that_closes(made: Path) -> None:
    page = (made / "out" / "cell.html").read_text("utf-8")
    assert (
        "one function for a cell" in page
        and "limit margin" in page
        and "http" not in page.partition("<iframe")[0]
    )
    assert "<dt>Tested, not proved</dt>" in page and "<dt>Proved</dt>" not in page
    inner = unescape(page.partition('srcdoc="')[2].partition('"></iframe>')[0])
    scene = json.loads(inner.partition('id="scene">')[2].partition("</script>")[0])
    assert [arm["label"] for arm in scene["arms"]] == ["J⁺", "One function, q = F(x)"]
    assert scene["arms"][1]["drift"][-1] < 1e-9 < scene["arms"][0]["drift"][-1]
    assert scene["paths"][0] == 16  # the edges of the cell
    the_page_begins_with_a_sentence_and_the_arm(re.sub('srcdoc="[^"]*"', "", page))
    the_dialog_explains_what_stands_on_the_page(page, inner)


def the_page_begins_with_a_sentence_and_the_arm(page: str) -> None:
    """55: what is covered, and its price, stand above the arm; all else stands below it."""
    sentence, notes = (page.partition(f'id="{name}">')[2].partition("</p>")[0]
                       for name in ("verdict", "notes"))  # fmt: skip
    sentence = sentence.replace("\u00a0", " ")
    assert "0.4 × 0.4 m around (2.13, 0.63, 0.00) m" in sentence
    above = "Joint speed of all poses above that of the usual control: +0.017"
    assert notes.startswith(f"<span>{above}") and "not proved" in notes
    above, _, below = page.partition("<iframe")
    assert "<dl" not in above and "<h2>" not in above and "<pre" not in above
    for word in ("Your own arm", "ROS 2", "CSV", "Units", "To cite"):
        assert f"<dt>{word}</dt>" in below, word
    shown = re.sub("(?s)<script>.*?</script>|<[^>]*>", " ", page.partition("<body>")[2])
    assert "sector" not in shown and len(re.findall("box", shown)) == 1  # what a cell is


def the_dialog_explains_what_stands_on_the_page(page: str, inner: str) -> None:
    """Every name of the rows in numbers, and no word of a study, whose files are not there."""
    numbers = page.partition("<h2>In numbers</h2>")[2].partition("</section>")[0]
    rows = {name.casefold() for name in re.findall("<dt>(.*?)</dt>", numbers)}
    dialog = inner.partition("<dialog")[2].partition("</dialog>")[0]
    names = {name.casefold() for name in re.findall("<dt>(.*?)</dt>", dialog)}
    assert rows - {"cell", "middle", "stopped"} <= names and "the cell" in names
    assert {"extra joint speed", "leaf margin", "limit margin", "coverage"} <= rows
    for word in ("study", "control.json", "motion.csv", "First line", "Joint speed</dt>"):
        assert word not in dialog, word


def test_a_proof_that_is_not_reached_is_not_called_one(
    made: Path, capsys, no_tours: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither in the first lines nor among the words of the page."""
    prove = rp.prove
    monkeypatch.setattr(rp, "prove", lambda design, **_: prove(design, limit_margin=9.0, seconds=1))
    few = ["--half-width", "0.2", "--degree", "2", "--held-out", "256"]
    out = made / "not proved"
    assert main([*cell_of(made), *few, "--prove", "--out", str(out)]) != 0
    assert "Tested at 256 poses, not proved." in " ".join(capsys.readouterr().out.split())
    page = (out / "cell.html").read_text("utf-8")
    assert "<dt>Tested, not proved</dt>" in page and "<dt>Proved</dt>" not in page
    assert "<dt>Sample path</dt>" not in page


@pytest.mark.slow
def test_the_page_plays_and_fits_a_phone(made: Path, driver: Any) -> None:
    """One load, at two sizes; what the tour's frame draws is looked at elsewhere."""
    schemes(driver, width=390, height=480)
    with asleep(driver):
        driver.get((made / "out" / "cell.html").as_uri() + "#paused")
    for width in (390, 1400):
        schemes(driver, width=width, height=480)
        assert driver.execute_script(
            "return document.documentElement.scrollWidth <= window.innerWidth"
        ), width
        assert driver.execute_script(
            "return [...document.images].every((i) => i.complete && i.naturalWidth > 100)"
        )
        driver.switch_to.frame(driver.find_element("tag name", "iframe"))
        wait_until_drawn(driver, "the tour")
        assert driver.execute_script(
            "return [repctl.meshes(0), repctl.meshes(1)].every((m) => m > 0)"
        )
        assert errors(driver) == []
        driver.switch_to.default_content()


@pytest.mark.slow
def test_a_cell_round_a_path_and_round_poses(
    made: Path, capsys: pytest.CaptureFixture[str], no_tours: None
) -> None:
    arm = cell_of(made)
    words = [
        "--half-width",
        "0.05",
        "--degree",
        "1",
        "--held-out",
        "64",
        "--out",
        str(made / "path"),
        "--json",
    ]
    assert main([*arm, *words, "--path", "circle:0.1"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["half_width"] == pytest.approx([0.15, 0.15], abs=1e-3)
    assert (
        said["everywhere"] is True
        and 0 < said["extra_speed_worst"] <= said["extra_speed_direction"]
    )
    x, y = said["middle"][0][3], said["middle"][1][3]
    poses = made / "poses.csv"
    poses.write_text(
        "x,y,z\n"
        + "".join(f"{x + a},{y + b},0\n" for a, b in ((0, 0), (0.1, 0), (0, 0.06), (0, 0)))
    )
    assert main([*arm, *words, "--path", str(poses)]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["half_width"] == pytest.approx([0.1, 0.08], abs=1e-4)
    assert said["middle"][0][3] == pytest.approx(x + 0.05, abs=1e-4)


def test_a_cell_is_exported_with_its_function(
    made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [
        "export",
        str(made / "out" / "cell.json"),
        "--robot",
        str(made / "arm.urdf"),
        "--out",
        str(made / "c"),
    ]
    assert main([*words, "--name", "arm"]) == 0
    capsys.readouterr()
    assert "arm_F(" in (made / "c" / "arm.h").read_text("utf-8")


@pytest.mark.slow
def test_remedies_are_options(
    made: Path, capsys: pytest.CaptureFixture[str], no_tours: None
) -> None:
    """What is refused names the options of the command, not Python's arguments."""
    arm = cell_of(made)
    small = ["--degree", "1", "--held-out", "64", "--out", str(made / "large")]
    assert main([*arm, "--half-width", "2", *small]) == 2
    refusal = capsys.readouterr().err
    assert "use --shrink to move its sides inward" in refusal and "incomplete=" not in refusal
    assert main([*arm, "--half-width", "-1", *small]) == 2
    assert "--half-width" in capsys.readouterr().err
    assert main([*arm, "--half-width", "2", "--shrink", *small]) == 0
    assert "note: --shrink: no single function covers ±(2, 2) m" in capsys.readouterr().out
    assert main([*arm, "--half-width", "0.1", *small, "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")


def test_other_commands_say_that_it_is_a_cell(
    made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(made / "out" / "cell.json"), "--robot", str(made / "arm.urdf")]) == 2
    assert "holds the function of a cell, which this command cannot use" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--half-width", "wide"], "--half-width 'wide' must be one or more numbers"),
        (["--half-width", "0.1", "--at", "1,2"], "--at '1,2' must be 3 numbers"),
        (["--half-width", "0.1", "--held-out", "20000000"], "--held-out can be at most 1,048,576"),
        (["--half-width", "0.1", "--degree", "0"], "neither auto nor a whole number from 1 up"),
        (["--half-width", "1e-300"], "--half-width must be 0, which holds the coordinate"),
        (["--half-width", "0.1", "--shrink", "--keep"], "mutually exclusive"),
        (["--half-width", "0.1", "--at", "1,2,0", "--path", "circle:0.1"], "mutually exclusive"),
        (["--half-width", "0.1", "--half-angle", "0.2"], "leaves the rotation free"),
        (["--half-width", "0.1", "--at", "-9,0,0", "--start", "0.6,-1.2,1.4"], "cannot reach"),
    ],
)
def test_what_cannot_be(
    words: list[str], says: str, made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arm = [
        "cell",
        str(made / "arm.urdf"),
        "--frame",
        "tool",
        "--task",
        "xy",
        "--out",
        str(made / "no"),
    ]
    assert main([*arm, *words]) == 2
    assert says in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--sector"], "--sector requires --radius"),
        (["--sector", "--radius", "0.1", "--half-width", "0.1"], "mutually exclusive"),
        (["--sector", "--radius", "0.1", "--path", "circle:0.1"], "mutually exclusive"),
        (["--half-width", "0.1", "--radius", "0.1"], "--radius requires --sector"),
        (["--half-width", "0.1", "--angle", "1"], "--angle requires --sector"),
        (["--radius", "0.1"], "--radius requires --sector"),
        ([], "the shape of the cell is missing; give --half-width, --size"),
        pytest.param(
            ["--sector", "--radius", "0.1", "--angle", "4"],
            "more than a full turn",
            marks=pytest.mark.slow,
        ),
        pytest.param(["--sector", "--radius", "0.9"], "reaches the axis", marks=pytest.mark.slow),
        pytest.param(
            ["--sector", "--radius", "0.1", "--height", "a"], "--height", marks=pytest.mark.slow
        ),
        (["--half-width", "0.1", "--axis", "0,0,0,0,0,1"], "--axis requires --sector"),
        pytest.param(
            ["--sector", "--radius", "0.1", "--axis", "0,0,1"],
            "must be 6 numbers",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ["--sector", "--radius", "0.1", "--axis", "0,0.1,0,0,0,1"],
            "a joint that turns the",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_options_of_a_sector_that_make_no_sense(words: list[str], says: str, capsys) -> None:
    assert main(["cell", "panda", *words]) != 0
    said = capsys.readouterr().err
    assert says in said and len(said.strip().splitlines()) == 1


def test_a_sector_on_the_command_line(tmp_path: Path, capsys, monkeypatch, no_tours: None) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "planar.urdf").write_text(planar_urdf([0.5, 0.4, 0.3]), encoding="utf-8")
    options = ["--start", "0.2,0.8,0.8", "--degree", "1", "--held-out", "64", "--out", "out"]
    sector = ["--sector", "--radius", "0.1", "--json"]
    axis = ["--axis", "0,0,0.3,0,0,2"]  # the base's own axis: another point, another length
    assert main(["cell", "planar.urdf", "--task", "xy", *sector, *axis, *options]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["turns"][0]["reach"] == pytest.approx(2 * np.pi)
    assert said["sector"] == pytest.approx({"radius": 0.1, "angle": np.pi})
    few = ["--cycles", "1", "--steps", "100"]
    assert main(["follow", "out/cell.json", "--robot", "planar.urdf", *few]) == 0
    assert "tour 0 of the cell" in capsys.readouterr().out


# ---- the start, the verdict and the tour
# ------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_start_is_that_of_a_study(tmp_path: Path, capsys) -> None:
    """Issue 20, item 18: around the reference pose, in which this arm is stretched, no cell
    exists; a study and a design choose another start."""
    file = tmp_path / "arm.urdf"
    file.write_text(upright_urdf(), encoding="utf-8")
    options = ["--half-width", "0.05", "--degree", "1", "--held-out", "64", "--json"]
    out = ["--out", str(tmp_path / "out")]
    assert main(["cell", str(file), *options, *out]) == 0
    said = json.loads(capsys.readouterr().out)
    problem = rp.Problem(str(file), path=False)
    assert np.allclose(
        said["middle"], problem.task.placement(problem.start).homogeneous, atol=1e-12
    )
    assert said["start_is"] == problem.start_is == "a dexterous pose near mid-range"
    assert said["coverage"] == 1.0 and said["everywhere"]
    options[1] = "0.02"
    for more in (["--path", "circle:0.05"], ["--at", "0.3,0.2,1"]):
        assert main(["cell", str(file), *more, *options, *out]) == 0
        assert json.loads(capsys.readouterr().out)["everywhere"]


@pytest.mark.slow
def test_a_start_from_which_the_cell_fits_is_preferred(tmp_path: Path, capsys) -> None:
    """Issue 20, item 18: from the first start, J⁺ does not reach every corner straight; from the
    one that is chosen it does."""
    file = tmp_path / "arm.urdf"
    file.write_text(upright_urdf(), encoding="utf-8")
    options = ["--half-width", "0.1", "--degree", "1", "--held-out", "64", "--json"]
    assert main(["cell", str(file), *options, "--out", str(tmp_path / "out")]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["everywhere"] and said["start_is"] == "another dexterous pose"

    first, *others = rp.Problem(str(file), path=False).alternatives()
    task, middle = first.task, np.array(said["middle"])
    (chosen,) = (
        one for one in others if np.allclose(task.placement(one.start).homogeneous, middle)
    )

    def straight(q0: np.ndarray) -> int:
        """Count the corners that are reached, there and back."""
        reached = 0
        for corner in product((-0.1, 0.1), repeat=3):
            line = rp.polygon(task, q0, [corner])
            try:
                motion = rp.follow(rp.Pseudoinverse(task), line, q0, cycles=1)
            except rp.SingularityError:
                continue
            reached += bool(motion.limit_margin.min() > 0)
        return reached

    assert straight(chosen.start) == 8 > straight(first.start)


def test_the_verdict_comes_first(made: Path, capsys, no_tours: None) -> None:
    """Issue 20, item 18: what is covered, what it costs, the limits; averages over all directions
    stand beside each other, each quantity once, and an unmet request on the line of its figure."""
    command = [*cell_of(made), "--half-width", "0.2", "--degree", "2"]
    command += ["--held-out", "256", "--out", str(made / "out"), "--limit-margin", "9"]
    assert main(command) == 0
    out = capsys.readouterr().out
    first = " ".join(out.partition("\n\n")[0].split())
    assert first.startswith("Same hand position, same joints, however the hand gets there: ")
    assert main([*command, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    mean, worst = (said["extra_speed"], said["extra_speed_worst"])
    cost = f"Joint speed of all poses above that of the usual control: +{100 * mean:.2g} % "
    assert cost + f"on average, at worst +{100 * worst:.2g} %" in first
    assert "Tested at 256 poses, not proved." in first
    least = min(said["limit_margin"], said["limit_margin_worst"])
    assert 1 < least < 10  # so that two digits are tenths, rounded down because of "or more"
    tenths = Decimal(least).quantize(Decimal("0.1"), ROUND_FLOOR)
    assert f"Joint limits kept by {float(tenths):g} rad or more (requested 9)." in first
    for name in ("extra joint speed", "limit margin"):
        assert len([x for x in out.splitlines() if x.startswith(f"  {name} ")]) == 1
    rows = out.partition("  limit margin")[2].partition("  body distance")[0]
    found, held_out = " ".join(rows.split()).split(" at the worst held-out pose ")
    assert "the requested 9 is not met" in found
    assert "the requested 9 is not met" in held_out


@pytest.mark.slow
def test_the_tour_keeps_the_speed_limits(tmp_path: Path, capsys) -> None:
    """Issue 20, item 18: the tour of a page under the headline "limits kept" was too fast."""
    urdf = planar_urdf([1.0, 0.9, 0.8]).replace('velocity="', 'velocity="0.')
    (tmp_path / "arm.urdf").write_text(urdf, encoding="utf-8")
    words = ["cell", str(tmp_path / "arm.urdf"), "--frame", "tool", "--task", "xy"]
    words += ["--start", "0.6,-1.2,1.4", "--half-width", "0.2", "--degree", "2"]
    words += ["--held-out", "64", "--out", str(tmp_path / "out"), "--json"]
    assert main(words) == 0
    (note,) = json.loads(capsys.readouterr().out)["notes"]
    assert note.startswith("sample path: period increased to ")
    page = (tmp_path / "out" / "cell.html").read_text("utf-8")
    before, _, rest = page.partition("<iframe")
    assert "period increased to" in before + rest.partition("</iframe>")[2]
    inner = unescape(page.partition('srcdoc="')[2].partition('"></iframe>')[0])
    scene, _, numbers = read(inner)
    assert f"to {scene['seconds']:g} s" in note
    # as the page draws it: the rates at which the three links turn, and from them the joints'
    at, step = 0, scene["seconds"] / (scene["perCycle"] - 1)
    of_poses = 7 * len(scene["arms"][0]["shapes"])
    assert of_poses in [columns for _, columns in scene["series"]]
    for rows, columns in scene["series"]:
        drawn = numbers[at : at + rows * columns].reshape(rows, columns)
        at += rows * columns
        if columns != of_poses:
            continue
        poses = drawn.reshape(rows, -1, 7)
        links = [
            poses[:, i, 3:]
            for i, shape in enumerate(scene["arms"][0]["shapes"])
            if shape["name"].endswith("_tube")
        ]
        turned = [Rotation.from_quat(link) for link in links]
        rates = [(R[1:] * R[:-1].inv()).as_rotvec()[:, 2] / step for R in turned]
        fastest = np.abs(np.diff(rates, axis=0, prepend=0)).max()
        assert 0.05 < fastest < 0.1  # the limit


class Table(NamedTuple):
    """What the command reads of a whole table."""

    design: rp.CellDesign
    straight: rp.CellDesign
    locked: None = None
    larger: None = None
    area: float = 0.37
    by_height: bool = True
    outlines: tuple[Any, ...] = ()


@NEEDS_C
@pytest.mark.parametrize("provable", some([True, False], False))
def test_a_sector_whose_radius_depends_on_the_height_is_taken_if_it_is_proved(
    provable: bool,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    blank_pictures: None,
    no_tours: None,
) -> None:
    """Else the one with one range of radius is, with the cause and the remedy in one line."""
    shaped, straight = map(sectors.found, ("one orientation by height", "one orientation"))
    place = SimpleNamespace(table=Table(shaped, straight), approach=None)
    prove, asked = rp.prove, []

    def proved(design: rp.CellDesign, **how: Any) -> rp.Proof:
        asked.append(design)
        limit = -1.0 if provable or design is straight else 9.0
        return prove(design, margin=0.0, limit_margin=limit)

    monkeypatch.setattr(rp, "best_cell", lambda *_, **__: place)
    monkeypatch.setattr(rp, "prove", proved)
    words = ["cell", "panda", "--down", "--prove", "--json", "--out", str(tmp_path)]
    assert main(words) == 0
    said = json.loads(capsys.readouterr().out)
    assert asked == ([shaped] if provable else [shaped, straight])
    assert said["proof"]["proved"]
    design = rp.load(tmp_path / "cell.json")
    assert design.proof and design.subject == (shaped if provable else straight).subject
    notes = [note for note in said["notes"] if note.startswith("--prove")]
    assert len(notes) == (0 if provable else 1)
    for note in notes:
        assert "\n" not in note and note.count(":") == note.count(";") == 1
        assert "(the limit margin there is" in note and note.endswith("; omit --prove to have it")
