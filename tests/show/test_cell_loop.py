"""The function of a cell on its page, which moves its visitor's hand: its numbers against Python's,
by node."""

from __future__ import annotations

import base64
import io
import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import main
from page_file import read
from PIL import Image
from test_own_loop import NODE, evaluated, nullspace

import repctl_pin as rp

CELLS = {
    "sector": ["--sector", "--radius", "0.08", "--height", "0.08", "--degree", "1"],
    "box": ["--half-width", "0.05,0.04,0.03", "--degree", "2"],
    "table": ["--down"],
    "tilts": ["--half-width", "0.03", "--half-angle", "0.1", "--degree", "1"],
}


def written(name: str, folder: Path) -> tuple[rp.CellDesign, Any, np.ndarray]:
    """The design that a command writes; from its page, what it has for loops and the weights."""
    few = [] if "--down" in CELLS[name] else ["--held-out", "64"]
    assert main(["cell", "panda", *CELLS[name], *few, "--out", str(folder)]) == 0
    (inside,) = re.findall('srcdoc="([^"]*)"', (folder / "cell.html").read_text("utf-8"))
    scene, _, numbers = read(unescape(inside))
    # meshes' points come before, some of the same shape
    shape, series = [1, scene["weights"]], scene["series"]
    before = series[: len(series) - 1 - series[::-1].index(shape)] if shape[1] else []
    at = sum(rows * columns for rows, columns in before)
    return rp.load_cell(folder / "cell.json"), scene["own"], numbers[at : at + shape[1]]


@pytest.mark.slow
@pytest.mark.skipif(NODE is None, reason="node is not installed")
@pytest.mark.parametrize("name", ["sector", "box"])
def test_the_page_computes_the_function_as_python_does(name: str, tmp_path: Path) -> None:
    """Its potentials, velocities and margin in the cell, where the chart has the page's numbers;
    and after each cycle of a loop it is where it began, which J⁺ is not."""
    design, own, weights = written(name, tmp_path)
    task, cell = design.task, design.cell
    q0 = np.array(own["start"])
    own["laws"][-1][0]["chart"]["weights"] = weights.tolist()
    chart = design.function.chart
    chart = replace(chart, coefficients=weights.reshape(chart.coefficients.shape))
    law = rp.RepeatableInverse(task, type(design.inverse.potentials)(chart))
    rng = np.random.default_rng(0)
    U = rng.uniform(-0.9, 0.9, (20, cell.k))
    Q = design.function.batch(U) + rng.normal(0, 1e-3, (20, task.n))
    X = rng.normal(size=(20, task.m))
    points = [task.placement(q0).translation + 0.03 * np.array([np.sin(s), np.cos(s) - 1, 0])
              for s in np.linspace(0, 2 * np.pi, 25)]  # fmt: skip
    done = evaluated(tmp_path, own, Q, X, [np.array([*points[:-1], points[0]]).tolist()])
    for q, x, at in zip(Q, X, done["at"], strict=True):
        wanted = law.velocity(q, x)
        assert np.abs(np.subtract(at["v"][-1], wanted)).max() < 1e-6 * np.linalg.norm(wanted)
        assert np.allclose(at["h"][-1], law.potentials.values(q[None])[0], atol=1e-7)
        V = np.linalg.qr(law.potentials.gradient(q))[0]
        margin = np.linalg.svd(nullspace(task.jacobian(q)).T @ V)[1].min()
        assert at["margin"][-1] == pytest.approx(margin, abs=1e-5)
    usual, one = (np.array(ends) for ends in done["ends"])
    assert np.abs(one[1:] - one[0]).max() < 1e-7 < 1e-5 < np.abs(usual[-1] - usual[0]).max()


@pytest.mark.slow
@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_along_the_edge_of_a_sector_its_function_comes_back(tmp_path: Path) -> None:
    """Beyond the highest point of a whole table the slope of the function jumps: a reader's loop
    along this edge was called a failure of the function."""
    design, own, weights = written("table", tmp_path)
    task, cell = design.task, design.cell
    own["laws"][-1][0]["chart"]["weights"] = weights.tolist()
    start = task.placement(np.array(own["start"]))
    # up to the edge, along it to other angles, and home there
    radius, angle, height = (cell.names.index(name) for name in ("radius", "angle", "height"))
    (u,), _ = cell.coordinates(start.translation[None], start.rotation[None])
    share = np.concatenate([np.linspace(0, 1, 20), np.ones(40), np.linspace(1, 0, 20)])
    U = np.tile(u, (80, 1))
    U[:, radius] *= 1 - share
    U[20:60, radius] = 0.99 * np.sin(np.linspace(0, 2 * np.pi, 40))
    U[:, height] += share * (1 - u[height])
    U[20:, angle] += 0.1 * np.concatenate([np.linspace(0, 1, 40), share[60:]])
    way = [cell.at(u).translation for u in U]
    loop = np.array([start.translation, *way, start.translation]).tolist()
    none = np.zeros((0, task.n))
    usual, one = map(np.array, evaluated(tmp_path, own, none, none, [loop])["ends"])
    assert np.abs(one[1:] - one[0]).max() < 1e-9 < 1e-3 < np.abs(usual[-1] - usual[0]).max()


@pytest.mark.slow
def test_the_page_of_a_tilting_tool_has_no_ring(tmp_path: Path) -> None:
    _, own, weights = written("tilts", tmp_path)
    assert own is None and not weights.size


@pytest.mark.slow
def test_dark_mode_inverts_no_colour_of_the_slices(tmp_path: Path) -> None:
    """What it inverts is grey: text, ticks and paper. It inverted the colour maps, too."""
    written("tilts", tmp_path)
    page = (tmp_path / "cell.html").read_text("utf-8")
    maps = re.findall(
        r'--around: polygon\(evenodd,(.*?)\)"><img src="data:image/png;base64,(.*?)"', page
    )
    assert len(maps) > 3
    for around, data in maps:
        corners = [[float(v.strip("%")) / 100 for v in one.split()] for one in around.split(",")]
        image = Image.open(io.BytesIO(base64.b64decode(data)))
        picture = np.asarray(image.convert("RGB")).astype(int)
        inverted = np.ones(picture.shape[:2], bool)
        assert len(corners) == 5 + 6 + 6  # the map and its colour bar
        for k in (5, 11):
            (left, top), (right, bottom) = corners[k], corners[k + 2]
            height, width = inverted.shape
            rows = slice(max(int(top * height) - 1, 0), int(np.ceil(bottom * height)) + 1)
            inverted[rows, max(int(left * width) - 1, 0) : int(np.ceil(right * width)) + 1] = False
        coloured = np.ptp(picture, axis=2) > 8
        assert coloured[~inverted].mean() > 0.5 and not coloured[inverted].any()
