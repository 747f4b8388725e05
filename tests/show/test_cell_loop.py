"""The function of a cell on its page, which moves its visitor's hand: its numbers against Python's,
by node."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sectors import found
from test_own_loop import NODE, evaluated, nullspace

import repctl_pin as rp

LOOP = import_module("repctl_pin.extensions.cells.show.cell_loop")


def box() -> rp.CellDesign:
    task = rp.Robot.load("panda").task()
    cell = rp.Cell(task, task.placement(task.reference), [0.05, 0.04, 0.03])
    options = rp.FitOptions(held_out=64)
    return rp.nearest_inverse_function(rp.Pseudoinverse(task), cell, degree=2, options=options)


DESIGNS = {"sector": partial(found, "one orientation"), "box": box}


@pytest.mark.slow
@pytest.mark.skipif(NODE is None, reason="node is not installed")
@pytest.mark.parametrize("name", DESIGNS)
def test_the_page_computes_the_function_as_python_does(name: str, tmp_path: Path) -> None:
    """Its potentials, velocities and margin in the cell, where the chart has the page's numbers;
    and after each cycle of a loop it is where it began, which J⁺ is not."""
    design = DESIGNS[name]()
    task, cell = design.task, design.cell
    q0 = design.function(cell.placement)
    circle = rp.circle(task, q0, 0.02, normal="xy")
    motion = rp.follow(design.inverse, circle, q0, cycles=1, steps=200, period=3.0)
    own: Any = LOOP.cell_loop(design, {"J⁺": motion, "F": motion})
    weights = own.pop("weights")
    own["laws"][-1][0]["chart"]["weights"] = weights.ravel().tolist()
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
def test_the_page_of_a_tilting_tool_has_no_ring() -> None:
    task = rp.Robot.load("panda").task()
    cell = rp.Cell(task, task.placement(task.reference), 0.03, 0.1)
    options = rp.FitOptions(held_out=64)
    design = rp.nearest_inverse_function(rp.Pseudoinverse(task), cell, degree=1, options=options)
    q0 = design.function(cell.placement)
    circle = rp.circle(task, q0, 0.01, normal="xy")
    motion = rp.follow(design.inverse, circle, q0, cycles=1, steps=50, period=9.0)
    assert LOOP.cell_loop(design, {"F": motion}) is None
