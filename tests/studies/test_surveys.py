"""Surveys: whole studies, audits and best cells, mapped over a local Dask cluster."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import repctl_pin as rp

RADII = np.linspace(0.05, 0.15, 100)
"""Radii of the paths, m, one per study."""


def survey(
    radius: float, *, dies_at: float, mark: Path
) -> tuple[rp.Study, rp.Audit, rp.BestCell | None]:
    """Make one small study, audit its motion by J⁺, and find every 25th cell; die once."""
    if radius == dies_at and not mark.exists():
        mark.touch()
        os._exit(1)
    problem = rp.Problem("planar3r", start=[0.3, 0.8, 0.8], path=f"circle:{radius}")
    few = rp.FitOptions(samples=512, held_out=128)
    study = rp.study(problem, cycles=4, steps=60, degree=1, options=few)
    motion = study.rows[0].motion
    audit = rp.audit((motion.t, motion.q), problem.task)
    cell = rp.best_cell(problem.task, radius) if radius in RADII[::25] else None
    return study, audit, cell


def resident() -> int:
    """Measure the memory of this process, bytes."""
    import psutil  # comes with Dask

    return psutil.Process().memory_info().rss


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_hundred_studies_on_a_cluster(tmp_path: Path) -> None:
    """Issue 56, item 8: results arrive whole, a dead worker's task is repeated, memory is flat."""
    distributed = pytest.importorskip("distributed")
    work = partial(survey, dies_at=float(RADII[40]), mark=tmp_path / "died")
    drifts, memory = {}, []
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        tasks = {client.submit(work, float(r), pure=False): float(r) for r in RADII}
        for task in distributed.as_completed(list(tasks)):
            study, audit, cell = task.result()
            radius = tasks.pop(task)
            task.release()
            assert study.row("repeatable").motion.drift[-1] < 1e-8
            assert len(audit.visits.t) >= 4 and (cell is None or cell.factor == 1.0)
            drifts[radius] = study.row("pseudoinverse").motion.drift[-1]
            del study, audit, cell, task
            alive = client.run(resident, on_error="ignore")  # a worker may be dying
            memory.append(max([resident(), *alive.values()]))
    assert (tmp_path / "died").exists() and sorted(drifts) == pytest.approx(RADII)
    # a larger circle drifts more, in each of a hundred studies
    assert (np.diff([drifts[r] for r in sorted(drifts)]) > 0).all()
    # from the 60th study on, after the new worker has imported everything
    assert memory[-1] - memory[60] < 30e6, [m // 10**6 for m in memory[::10]]
