"""What the commands say: in the words of the command line, and true."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from commands import OUT, main, refused
from page_file import read

import repctl_pin as rp

SINGULAR = ["planar3r", "--start", "0.3,0.6,0.5"]


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[str, str]:
    assert main([*arguments]) == 0
    return tuple(capsys.readouterr())


# ---- remedies in the words of those who read them ------------------------------------------------


@pytest.mark.slow
def test_a_singular_region_names_the_option_that_helps(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    for name, many in (("_STARTS", 16), ("_CORNERS", 256)):  # as shipped
        monkeypatch.setattr(f"repctl_pin.design.singularity_search.{name}", many)
    error = refused(capsys, "design", *SINGULAR, "--region", "0.7", "--degree", "1")
    assert "use --shrink to design in this smaller region" in error and "=True" not in error
    study = ["study", *SINGULAR, "--cycles", "1", "--steps", "40", "--degree", "1", "--quiet"]
    width, tries = "10", 0
    while main([*study, "--region", width]) == 2:  # the advice is taken, until it is good
        error = capsys.readouterr().err
        assert "with the same centre" in error and "shrink" not in error
        (smaller,) = re.findall(r"; use --region ([\d.]+)$", error.strip())
        assert 0 < float(smaller) < float(width)
        width, tries = smaller, tries + 1
    assert 1 <= tries <= 3
    with pytest.raises(rp.SingularRegionError, match=r"; pass region=0\.\d+$"):
        rp.study(rp.Problem("planar3r", start=[0.3, 0.6, 0.5], region=10.0), degree=1)
    with pytest.raises(
        rp.SingularRegionError,
        match=r"; pass that region, which is the attribute free of this error$",
    ):
        rp.study(
            rp.Problem("planar3r", start=[0.3, 0.6, 0.5], region=rp.Box([0.3, 0.6, 0.5], 3.0)),
            degree=1,
        )


@pytest.mark.parametrize("command", [["study", "panda"], ["design", "panda"]])
def test_too_high_a_degree_is_lowered(command: list[str], tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    error = refused(capsys, *command, "--degree", "9")
    told = "have 11439 potentials, but the maximum is 5000; lower the degree"
    assert error.strip().endswith(f"degree 9 in 7 joints {told}")
    assert "variables" not in refused(capsys, "design", "panda", "--fourier", "30", "--degree", "1")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_python_is_told_in_its_own_words() -> None:
    for options in (
        {"start": [0, 1]},
        {"start": [0.3, 9, 0]},
        {"path": "circle:20"},
        {"frame": "link2"},
        {"start": [0.3, 0, 0]},
        {"region": 3.0},
    ):
        with pytest.raises(rp.RepctlError) as error:
            rp.study(rp.Problem("planar3r", **options), degree=1)
        assert "--" not in str(error.value), options
        assert ("start" in str(error.value)) >= (list(options) == ["start"])
    with pytest.raises(rp.InputError) as error:
        rp.study("panda", degree=9)
    assert "--" not in str(error.value)


# ---- help ----------------------------------------------------------------------------------------


def helped(command: str, capsys) -> str:
    with pytest.raises(SystemExit):
        main([command, "--help"])
    return " ".join(capsys.readouterr().out.split())


def test_help_is_short_and_in_groups(capsys) -> None:
    """One line of usage each; only study writes the grammar of --path; options are in groups."""
    with pytest.raises(SystemExit):
        main(["--help"])
    whole = capsys.readouterr().out
    assert whole.count("\n") <= 40
    for name in ("study", "design", "follow", "check", "animate", "cell", "relabel"):
        assert f"\n    {name} " in whole
        with pytest.raises(SystemExit):
            main([name, "--help"])
        usage, *lines = capsys.readouterr().out.splitlines()
        assert usage.startswith(f"usage: repctl {name} ") and len(usage) <= 80
        assert usage.endswith("[options]") and lines[0] == ""
        assert sum("polygon:CORNERS" in line for line in lines) == (name == "study")
        titles = [line for line in lines if line in GROUPS]
        assert titles == sorted(titles, key=GROUPS.index)
        assert len(titles) == 4 or name != "study"


GROUPS = ["robot:", "path:", "design:", "output:"]


def test_help_says_what_is_done(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    for command in ("study", "design"):
        assert "--quiet print only errors, and the JSON of --json" in helped(command, capsys)
    assert "1 to 4" not in helped("study", capsys)
    few = ["--cycles", "1", "--steps", "40", "--degree", "3", "--quiet", "--json"]
    # (3 + 3)! / 3! / 3! - 1
    assert json.loads(printed(capsys, "study", "ppr", *few)[0])["design"]["potentials"] == 19
    text = helped("follow", capsys)
    assert "starts and ends at path speed. With it, the motion goes from rest to rest" in text


def test_the_motion_that_follow_writes_is_at_full_speed_at_both_ends(
    tmp_path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    out, _ = printed(capsys, "follow", "ppr", "--strategy", "pseudoinverse", "--csv", "m.csv")
    assert (
        "note: this motion starts and ends at path speed; "
        "use --acceleration for a rest-to-rest trajectory wrote" in " ".join(out.split())
    )
    rows = np.genfromtxt("m.csv", delimiter=",", names=True)
    speed = np.linalg.norm(
        [rows[name] for name in rows.dtype.names if name.endswith("_velocity")], axis=0
    )
    assert speed[0] > 0.05 and speed[-1] > 0.05
    assert "full speed" not in printed(capsys, "follow", "ppr", "--strategy", "pseudoinverse")[0]


# ---- follow --------------------------------------------------------------------------------------


def test_drift_is_said_once_and_with_its_unit(capsys) -> None:
    follow = ["follow", "planar3r", "--strategy", "pseudoinverse", "--steps", "100"]
    out, _ = printed(capsys, *follow)
    assert re.search(r"^joint drift +0\.0638 rad after 1 cycle$", out, flags=re.MULTILINE)
    out, _ = printed(capsys, *follow, "--cycles", "10")
    assert re.search(
        r"^joint drift +0\.0638 rad after 1 cycle, 0\.705 after 10$", out, flags=re.MULTILINE
    )
    small = ("--path", "circle:0.1:180", "--plane", "xy")
    out, _ = printed(capsys, "follow", "ppr", "--strategy", "pseudoinverse", *small)
    assert re.search(r"^joint drift +0\.0117 rad and m after 1 cycle$", out, flags=re.MULTILINE)


def test_leaving_the_limits_is_a_warning(capsys) -> None:
    out, error = printed(capsys, *OUT)
    where = r"theta1 exceeds its limits \d+ % into cycle 1"
    assert re.fullmatch(
        rf"repctl: warning: {where}; try another --start or a smaller --path\n", error
    )
    assert "limit margin    minimum -" in out and "LIMITS" not in out
    out, error = printed(capsys, *OUT, "--json")
    assert error == "" and 0 < json.loads(out)["first_violation"]["cycle"] < 1
    assert printed(capsys, *OUT[:4], "--start", "1,-1.5,1.2")[1] == ""


def test_cycles_are_counted_in_whole_numbers() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q0 = np.array([0.0, 0.4, 0.4])
    path = rp.polygon(task, q0, [[0.5, 0, 0], [0.5, 0.5, 0]])
    with pytest.raises(rp.SingularityError, match=r"in cycle 1 of polygon"):
        rp.follow(rp.Pseudoinverse(task), path, q0, cycles=1, steps=200)


# ---- animate -------------------------------------------------------------------------------------


@pytest.mark.slow
def test_strategies_are_chosen_by_key_or_by_label(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    printed(capsys, "study", "ppr", "--cycles", "1", "--steps", "40", "--degree", "1", "--out", ".")
    for names, keys in (
        ("repeatable,posture", ["repeatable", "posture"]),
        ("J⁺, nearest repeatable", ["pseudoinverse", "repeatable"]),
        ("J⁺ + other posture", ["posture_off"]),
        ("posture_off,J⁺", ["posture_off", "pseudoinverse"]),
    ):
        asked = ["--motion", "motion.csv", "--only", names, "--json"]
        out, _ = printed(capsys, "animate", "ppr", *asked)
        assert list(json.loads(out)["drift"]) == keys
    error = refused(capsys, "animate", "ppr", "--motion", "motion.csv", "--only", "nope").strip()
    choice = "choose from pseudoinverse, posture, posture_off, repeatable"
    assert error.endswith(f"has no motion of the strategy 'nope'; {choice}")
    Path("mine.csv").write_text("d1\n0\n0.1\n0\n", encoding="utf-8")
    out, _ = printed(capsys, "animate", "ppr", "--motion", "mine.csv", "--only", "mine", "--json")
    assert json.loads(out)["drift"] == {"mine": [0.0]}


@pytest.mark.slow
def test_drift_has_the_keys_of_the_study(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    few = ["--cycles", "2", "--steps", "40", "--degree", "1", "--json"]
    studied = json.loads(printed(capsys, "study", "ppr", *few)[0])["strategies"]
    animated = json.loads(
        printed(capsys, "animate", "ppr", "--motion", "repctl-out/ppr/motion.csv", "--json")[0]
    )
    assert list(animated["drift"]) == list(studied)
    for key, drift in animated["drift"].items():
        assert drift == pytest.approx(studied[key]["drift"], abs=1e-8)
    scene, _, _ = read(Path("repctl-out/ppr/animation.html").read_text(encoding="utf-8"))
    # what is drawn has its own names
    assert {arm["label"] for arm in scene["arms"]} >= {"J⁺", "nearest repeatable"}
