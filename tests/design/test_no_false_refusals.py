"""No false refusals: what a lower degree solves a higher one does too, whatever the sample; and
auto goes on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from arms import Q_PANDA, spatial_task

import repctl_pin as rp


@pytest.mark.slow
def test_the_verdict_does_not_hang_on_the_sample() -> None:
    """tiago ±0.15, degree 2: a descent on few nodes runs into a singularity between them."""
    task = rp.Robot.load("tiago").task(None, "pose")
    desired, box = rp.Pseudoinverse(task), rp.Box(task.reference, 0.15)
    linear = rp.nearest_repeatable(
        desired, None, box, degree=1, options=rp.FitOptions(samples=2048, held_out=1024)
    )
    found = [
        rp.nearest_repeatable(
            desired, None, box, degree=2, options=rp.FitOptions(samples=k, held_out=1024)
        )
        for k in (2048, 4096)
    ]
    for design in found:
        assert design.converged and design.leaf_margin > 0.02
        assert design.cost < 0.05 * linear.cost
    assert found[1].cost == pytest.approx(found[0].cost, rel=0.1)


@pytest.mark.slow
def test_auto_goes_on_while_it_pays(tmp_path: Path) -> None:
    task, box = spatial_task(4, tmp_path, seed=2), rp.Box(np.full(4, 0.2), 0.5)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        None,
        box,
        degree="auto",
        options=rp.FitOptions(samples=2048, held_out=2048),
    )
    degrees, costs, _ = zip(*design.degrees, strict=True)
    assert degrees[-1] == 6 and costs[4] < 0.6 * costs[3]
    assert design.cost == min(costs)


@pytest.mark.slow
def test_panda_and_xarm_at_higher_degrees(panda_pose: rp.Task) -> None:
    """Costs on held-out nodes; the xarm's tube is that of its study, where degree 4 used to be
    refused."""
    box = rp.Box(Q_PANDA, 0.4)
    assert (
        rp.nearest_repeatable(rp.Pseudoinverse(panda_pose), None, box, degree="auto").cost < 0.1525
    )
    study = rp.study(rp.Problem("xarm7", kind="pose"))
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(study.task), None, study.design.region, degree=4
    )
    assert design.cost < 0.84 and design.leaf_margin > 0.3
