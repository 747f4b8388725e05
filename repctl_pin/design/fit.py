"""Fit potentials in one region: the arm searched, the useless potentials dropped, few nodes, all nodes, judgement."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..arguments import Array
from ..errors import InputError
from ..fields.field import Field
from ..progress import Report
from ..regions import Region
from ..robot.task import Task
from ..strategies.repeatable import RepeatableInverse
from ..strategies.strategy import Inverse
from . import criterion
from .batches import Batches, Guarded, Local
from .criterion import Builder, evaluate, oriented_nullspace
from .descend import Descent
from .independence import Independent, independent
from .judgement import judge
from .result import Design
from .singularities import Dexterity, SingularRegionError, refuse_singular, search
from .way import Way
from .workers import hand_out

if TYPE_CHECKING:
    from distributed import Client


_LEAST_NODES = 4096
_DEFAULT_NODES = 16384
_NODES_PER_UNKNOWN = 32
_COARSE_TOLERANCE = 1e-4
_PENALTY = 1e-3
_ROUNDS = 4


def fit(
    desired: Inverse,
    fields: Field,
    region: Region,
    *,
    report: Report,
    samples: int | None,
    held_out: int,
    seed: int,
    batch: int,
    stream: bool,
    executor: Executor | Client | None,
    restarts: int,
    tolerance: float,
    warm: Array | None = None,
) -> Design:
    """Fit and judge in one region; see :func:`nearest_repeatable` for the options.

    ``warm`` holds the coefficients (N_first, r) of a design with the first of the potentials: of a lower degree.

    Raises
    ------
    SingularRegionError
        If a singularity lies in the region.
    """
    task = desired.task
    report("searching Ω for singularities of the arm", 0.0)
    _check_rank(task, region, seed)
    unknowns = (fields.size - task.r) * task.r
    few = max(_LEAST_NODES, _NODES_PER_UNKNOWN * unknowns // task.m)
    count = max(few, _DEFAULT_NODES) if samples is None else int(samples)
    if count * task.m < fields.size:
        least = -(-fields.size // task.m)
        raise InputError(f"{count} nodes are too few for {fields.size} potentials; give at least {least}")
    Q, weights = region.nodes(count, seed)
    Q_few, w_few = region.nodes(few, seed) if len(Q) >= 2 * few else (Q, weights)
    chosen = independent(desired, fields, *region.nodes(max(512, 2 * fields.size), seed))
    N_center = oriented_nullspace(task.jacobian(region.center)[None], task, region.center[None])[0]
    builder = Builder(desired, fields, chosen.kept, N_center)

    def batches_of(Q: Array, weights: Array, where: Executor | Client | None) -> Batches:
        def tick(share: float) -> None:
            report(f"{len(Q)} nodes", share)

        if where is None:
            return Local(builder, Q, weights, batch, stream=stream, tick=tick)
        return hand_out(builder, Q, weights, batch, where, stream=stream, tick=tick)

    def step(number: int, cost: float) -> None:
        report(f"step {number}, cost {cost:.6g}", 1.0)

    few_nodes = batches_of(Q_few, w_few, executor if len(Q_few) == len(Q) else None)
    all_nodes = few_nodes
    try:
        coarse = Guarded(few_nodes, builder, 1 / len(Q_few))
        way = Way(desired, fields, region, chosen, coarse, seed, restarts, max(tolerance, _COARSE_TOLERANCE), step)
        refusal: SingularRegionError | None = None
        fine = coarse
        for near in way.regular(warm):
            if all_nodes is few_nodes and len(Q_few) < len(Q):
                all_nodes = batches_of(Q, weights, executor)
                fine = Guarded(all_nodes, builder, 1 / len(Q), coarse.guards)
            for _ in range(_ROUNDS):
                found = way.descend(fine, near.A, _PENALTY, tolerance)
                result = found or replace(near, converged=False)
                cost, _ = all_nodes.total(criterion.cost, result.A)
                result = replace(result, cost=cost, steps=result.steps + near.steps)
                report("judging on held-out nodes", 0.0)
                try:
                    return _judged(desired, fields, region, chosen, result, len(Q), held_out, seed)
                except SingularRegionError as error:
                    refusal = error
                if found is None or way.margin(near.A)(refusal.at[None])[0] <= 0:
                    break
                fine.guard(refusal.at[None])
        raise way.refusal(Q_few, refusal)
    finally:
        few_nodes.close()
        all_nodes.close()


def _check_rank(task: Task, region: Region, seed: int) -> None:
    """Refuse a region in which J loses rank."""
    measure = Dexterity(task)
    lowest = search(measure, region, region.random(2048, seed))
    if lowest.value <= 0:
        raise refuse_singular("the Jacobian loses rank", task, measure, region, lowest.at)


def _judged(
    desired: Inverse,
    fields: Field,
    region: Region,
    chosen: Independent,
    result: Descent,
    samples: int,
    held_out: int,
    seed: int,
) -> Design:
    """Make the design, with figures from held-out nodes."""
    A = chosen.spread(result.A)
    N, _, D = evaluate(desired, fields, region.center[None])
    A = A @ np.linalg.inv(N[0].T @ D[0] @ A)  # gauge: Nᵀ V = I at the center, J_V as well conditioned as J there
    inverse = RepeatableInverse(desired.task, fields.weighted(A), region=region)
    verdict = judge(inverse, desired, region, samples=held_out, seed=seed + 1, free=False)
    return Design(
        inverse=inverse,
        desired=desired,
        fields=fields,
        region=region,
        coefficients=A,
        cost=verdict.cost,
        cost_error=verdict.cost_error,
        relative_distance=verdict.relative_distance,
        leaf_margin=verdict.leaf_margin,
        leaf_margin_at=verdict.leaf_margin_at,
        inside_limits=verdict.inside_limits,
        fit_cost=result.cost,
        gradient_norm=result.gradient_norm,
        converged=result.converged,
        steps=result.steps,
        samples=samples,
        held_out=held_out,
        seed=seed,
        dropped=chosen.dropped,
    )
