"""What the distance between bodies costs a configuration, as a ratio to a frame's Jacobian in the
same run.

    python -m pytest tests/benchmarks/bench_bodies.py -o python_files="bench_*.py" -n 0

Processor time, in short runs, so that a busy machine counts little. A frame's Jacobian takes 0.6 to
1.4 µs."""

from __future__ import annotations

from time import thread_time

import numpy as np
import pinocchio as pin
import pytest
from timing import seconds

import repctl_pin as rp


@pytest.mark.parametrize(("name", "most"), [("panda", 50), ("talos", 100), ("baxter", 200)])
def test_distances_beside_frame_jacobians(name: str, most: float, say) -> None:
    """64 random configurations, and as many on the way from one to another, where bodies do not
    touch; ``most`` is the bound on the ratio. Baxter measures 2.4 exact distances on average."""
    task = rp.Robot.load(name).task()
    bodies, rng = rp.Bodies(task), np.random.default_rng(3)
    low, high = np.maximum(task.lower, -np.pi), np.minimum(task.upper, np.pi)
    Q = rng.uniform(low, high, (1024, task.n))
    Q = Q[bodies.distances(Q) > 0][:64]
    way = task.reference + np.linspace(0, 0.5, 64)[:, None] * rng.uniform(-1, 1, task.n)
    model, data = task.model, task.model.createData()
    frame = model.getFrameId(task.frame, pin.FrameType.BODY)

    def bare() -> None:
        for q in Q:
            pin.computeFrameJacobian(model, data, q, frame)

    base = seconds(bare, 60, thread_time) / len(Q)
    random, along = (
        seconds(lambda P=P: bodies.distances(P), 60, thread_time) / len(P) for P in (Q, way)
    )
    say(
        f"{name}, {len(bodies.pairs)} pairs of links: {random / base:.0f} × a frame's Jacobian at "
        f"random, "
        f"{along / base:.0f} × along a way ({1e6 * random:.0f} and {1e6 * along:.0f} µs, "
        f"{1e6 * base:.2f} µs)"
    )
    assert max(random, along) < most * base
