"""``repctl design``: its table, its JSON, its picture and its refusals, in a process of its own."""

from __future__ import annotations

import json
import os
import signal
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from arms import heed_interrupts
from commands import main

SMALL = ("--samples", "512", "--held-out", "512")
PANDA_START = "0,-0.785,0,-2.356,0,1.571,0.785"


def refused(capsys: pytest.CaptureFixture, *words: str) -> None:
    captured = capsys.readouterr()
    lines = captured.err.strip().splitlines()
    assert captured.out == "" and len(lines) == 1 and lines[0].startswith("repctl: "), captured.err
    for word in words:
        assert word in lines[0]


def size_of(png: Path) -> tuple[int, int]:
    data = png.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", data[16:24])
    return width, height


@pytest.mark.pictures
def test_table_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    arguments = ["design", "planar4r", "--degree", "2", *SMALL, "--out", str(tmp_path / "here")]
    assert main(arguments) == 0
    captured = capsys.readouterr()
    assert captured.err == ""  # progress is for terminals
    for word in (
        "J⁺",
        "mean ‖G_r − G_d‖²",
        "constant rows",
        "extended Jacobian",
        "leaf margin",
        "converged",
        "degree",
    ):
        assert word in captured.out
    width, height = size_of(tmp_path / "here" / "design.png")
    assert width > 1200 and height > 400
    assert {p.name for p in (tmp_path / "here").iterdir()} == {"design.png", "design.json"}


@pytest.mark.slow
def test_json_says_what_the_design_is_worth(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    arguments = ["design", "ppr", "--start", "0,0,0", "--region", "1", "--degree", "auto"]
    assert main([*arguments, *SMALL, "--json", "--out", str(tmp_path)]) == 0
    data = json.loads(capsys.readouterr().out)
    costs = [step["cost"] for step in data["degrees"]]
    assert data["cost"] == min(costs) < 0.0187 and costs[0] > 0.15
    assert data["converged"] and data["leaf_margin"] > 0.5 and data["r"] == 1
    assert set(data["baselines"]) == {"constant rows", "extended Jacobian"}
    assert data["files"] == [str(tmp_path / "design.png"), str(tmp_path / "design.json")]
    assert data["region"] == {
        "center": [0, 0, 0],
        "half_width": [1, 1, 1],
        "is": "box ±1 around (0, 0, 0)",
    }


@pytest.mark.parametrize(
    "extra, where",
    [
        pytest.param(
            ("planar4r", "--workspace", "0.2", "--region", "0.3"),
            "m around",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ("planar4r", "--weight", "limits", "--region", "0.2"), "box", marks=pytest.mark.slow
        ),
        (("planar4r", "--fourier", "1", "--region", "0.2"), "box"),
        pytest.param(
            (
                *("panda", "--start", PANDA_START, "--task", "axis", "--region", "0.2"),
                *("--restarts", "1"),
            ),
            "box",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_regions_and_desires(
    tmp_path: Path, capsys: pytest.CaptureFixture, extra, where: str
) -> None:
    arguments = ["design", *extra, "--degree", "1", *SMALL, "--json"]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    data = json.loads(capsys.readouterr().out)
    assert (
        where in data["region"]["is"] and data["converged"] and 0 < data["relative_distance"] < 0.3
    )


@pytest.mark.slow
def test_a_region_with_a_singularity_is_refused_unless_it_may_shrink(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    arguments = [
        "design",
        "planar3r",
        "--start",
        "0.3,0.6,0.5",
        "--region",
        "0.7",
        "--degree",
        "1",
        *SMALL,
    ]
    assert main([*arguments, "--out", str(tmp_path)]) == 2
    refused(capsys, "loses rank", "shrink")
    assert not (tmp_path / "design.png").exists()
    assert main([*arguments, "--shrink", "--out", str(tmp_path)]) == 0
    assert "note: Ω was shrunk to " in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["nosuch"], ["nosuch"]),
        (["panda", "--degree", "cubic"], ["cubic", "auto"]),
        (["panda", "--degree", "0"], ["--degree"]),
        (["panda", "--weight", "heavy"], ["--weight", "heavy"]),
        (["panda", "--samples", "2", "--degree", "2"], ["too few"]),
        (["panda", "--held-out", "3"], ["--held-out must be"]),
        (["panda", "--fourier", "1"], ["--degree"]),
        (
            ["panda", "--path", "circle:0.1", "--workspace", "0.1"],
            ["--workspace", "--path", "mutually exclusive"],
        ),
        (["panda", "--path", "spiral:3"], ["spiral"]),
        (["ur5", "--task", "pose"], ["r = 0"]),
        pytest.param(
            ["planar4r", "--workspace", "1e-6", "--degree", "1"],
            ["workspace box"],
            marks=pytest.mark.slow,
        ),
    ],
)
def test_bad_input_gets_one_clear_line(
    tmp_path: Path, capsys: pytest.CaptureFixture, arguments, words
) -> None:
    assert main(["design", *arguments, "--out", str(tmp_path)]) == 2
    refused(capsys, *words)
    assert list(tmp_path.iterdir()) == []


INTERRUPTED = """
import sys
import repctl_pin as rp
from repctl_pin.cli import main
design = rp.nearest_repeatable
def begun(step, share):
    print(step, file=sys.stderr, flush=True)
rp.nearest_repeatable = lambda *given, **options: design(*given, **options | {"progress": begun})
sys.exit(main())
"""
"""The command, which says on stderr what it does."""


@pytest.mark.slow
def test_interruption(tmp_path: Path) -> None:
    """Ctrl-C ends a long run with one clear line and code 130."""
    long = ["planar4r", "--degree", "4", "--samples", "1000000"]
    running = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED, "design", *long, "--out", str(tmp_path), "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        text=True,
        start_new_session=True,
        preexec_fn=heed_interrupts,
    )
    assert running.stderr is not None
    assert any("nodes" in line for line in iter(running.stderr.readline, ""))
    os.killpg(running.pid, signal.SIGINT)  # what a terminal does: everybody in the group gets it
    out, err = running.communicate(timeout=60)
    assert running.returncode == 130 and out == ""
    assert err.splitlines()[-1] == "repctl: interrupted; no incomplete file was left"
    assert "Traceback" not in err and list(tmp_path.iterdir()) == []
