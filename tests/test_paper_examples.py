"""The examples of Sections IV and V run as a person runs them, at reduced resolution, and find what they should."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from loading import example

import repctl_pin as rp


def size_of(file: Path) -> tuple[int, int]:
    """Width and height of a PNG, from its header."""
    head = file.read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", head[16:24])


def test_nearest_ppr(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    module = example("nearest_ppr")
    result = module.main(tmp_path, pairs=((0.2, 1), (0.5, 5), (0, np.pi)), degrees=(5, 7), samples=1000, count=13)
    told = capsys.readouterr().out

    # Table I, cell by cell, and the other two answers beside it.
    rows = [line.split("  ") for line in told.split("Table I")[1].split("\n\n")[1].splitlines()[2:6]]
    cells = [[cell.strip() for cell in row if cell.strip()] for row in rows]
    assert [row[:6] for row in cells] == [
        ["1", "−", "0.00000", "sin θ₃/√2", "0", "0.00000"],
        ["π/2", "0", "any value", "(49)", "(48)", "any value"],
        ["2", "+", "∞", "0", "−cos θ₃/√2", "∞"],
        ["π", "0", "any value", "(49)", "(48)", "any value"],
    ]
    assert cells[0][6] == "0.00000" and all(row[6] in ("–", "singular") for row in cells[1:])
    assert "J⁺: not repeatable" in told and told.count(": repeatable") == 3

    for answer in result.intervals:
        assert answer.search.unique == (answer.k is not None)
        assert answer.search.cost == pytest.approx(answer.cost, rel=1e-9)
        if answer.b - answer.a < 2.5:
            assert isinstance(answer.engine[5], rp.Design)
            assert answer.engine_k == pytest.approx(answer.k, rel=1e-4, abs=1e-4)
        if answer.b - answer.a > np.pi - 1e-9:
            assert not answer.settled  # the engine does not claim what it cannot reach
    assert result.all_joints[4].cost <= 0.0187
    assert size_of(tmp_path / "nearest_ppr_foliations.png")[0] > 1000


def test_leaves_of_nearest_ppr_are_level_sets(tmp_path: Path) -> None:
    module = example("nearest_ppr")
    (points,) = module.leaves(module.paper_potential, (0.2,), 9)
    seen = np.isfinite(points[..., 2])
    assert seen.sum() > 20
    level = module.paper_potential(np.array([0, 0, 0.2]))
    assert np.abs(module.paper_potential(points[seen]) - level).max() < 1e-3  # linear in cells of 1/60 rad
    with pytest.raises(rp.SingularityError, match="graph"):
        module.leaves(lambda Q: np.cos(3 * Q[..., 2]), (0.2,), 3)


def test_ten_squares(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    module = example("ten_squares")
    result = module.main(tmp_path, steps=400, dpi=40)
    told = capsys.readouterr().out
    assert [file.name for file in result.figures] == [f"figure_{n:02d}.png" for n in range(4, 13)]
    assert all(min(size_of(file)) > 100 for file in result.figures)
    assert "1.37361851, −0.92758245, −4.32948" in told
    assert np.abs(result.squares["J⁺"][-1].q[-1] - [1.37361851, -0.92758245, -4.32948200]).max() < 1e-7

    points = result.points
    assert points["F"] == points["C"] == 8.0 and 12 < points["G"] < 16
    runs = result.runs
    assert runs["J⁺"].at(points["G"])[2] == pytest.approx(-5 * np.pi / 4, abs=1e-12)
    assert result.closed < 1e-10
    # H: one configuration, two speeds.
    H, second, one = points["H"], result.second, runs["k = 1"]
    assert np.abs(second.at(H) - one.at(H)).max() < 1e-9
    speeds = [float(np.interp(H, run.s, run.speed)) for run in (second, one)]
    assert speeds[1] > 1.05 * speeds[0]
    # In the first turn J⁺ and k = 1 meet nowhere but at G, as the docstring says.
    gap = np.interp(runs["J⁺"].s, one.s, one.q[:, 2]) - runs["J⁺"].q[:, 2]
    assert (gap[np.abs(runs["J⁺"].s - points["G"]) > 0.2] < -1e-4).all()
    # Near E the run of k = 0 is slower than that of J⁺, as the paper remarks.
    assert runs["k = 0"].speed[-10] < runs["J⁺"].speed[-10]
    # Every point of the k = 1 run, put in order, still puts the tool where it should be.
    for s in (0.5, 5.0, 9.5, 13.0, 15.5):
        i = int(np.argmin(np.abs(one.s - s)))
        assert np.abs(result.task.placement(one.q[i]).translation - module.place(one.s[i])).max() < 1e-8
    difference, bound = module.penalty(result)
    assert (difference <= bound + 1e-12).all()
