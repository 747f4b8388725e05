"""Fit potentials in one region: the arm searched, the useless potentials dropped, few nodes, all nodes, judgement."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..fields.field import Field
from ..progress import Report
from ..regions import Region
from ..strategies.repeatable import RepeatableInverse
from ..strategies.strategy import Inverse
from . import criterion
from .batches import Batches, Local
from .criterion import Builder, evaluate, oriented_nullspace
from .descend import Descent, descend, start
from .independence import Independent, independent
from .judgement import judge
from .result import Design
from .search import SingularRegionError, dexterity, refuse_singular, search, signed_leaf_margin
from .workers import hand_out

if TYPE_CHECKING:
    from distributed import Client

Array = NDArray[np.float64]

_LEAST_NODES = 4096
_DEFAULT_NODES = 16384
_NODES_PER_UNKNOWN = 32
_COARSE_TOLERANCE = 1e-4
_PENALTIES: tuple[float, ...] = (1e-3, 1e-2, 1e-1)
"""Tried in turn until no singularity is left between the nodes, after few nodes with the second; see
:func:`descend`."""


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
) -> Design:
    """Fit and judge in one region; see :func:`nearest_repeatable` for the options.

    Raises
    ------
    SingularRegionError
        If a singularity lies in the region.
    """
    task = desired.task
    report("searching Ω for singularities of the arm", 0.0)
    measure = dexterity(task)
    found = search(measure, region, region.random(2048, seed))
    if found.value <= 0:
        raise refuse_singular("the Jacobian loses rank", task, measure, region, found.at)

    unknowns = (fields.size - task.r) * task.r
    few = max(_LEAST_NODES, _NODES_PER_UNKNOWN * unknowns // task.m)
    count = max(few, _DEFAULT_NODES) if samples is None else int(samples)
    if count * task.m < fields.size:
        least = -(-fields.size // task.m)
        raise InputError(f"{count} nodes are too few for {fields.size} potentials; give at least {least}")
    Q, weights = region.nodes(count, seed)
    Q_few, w_few = region.nodes(few, seed) if len(Q) >= 4 * few else (Q, weights)
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

    coarse = batches_of(Q_few, w_few, executor if len(Q_few) == len(Q) else None)
    fine = coarse
    try:
        begin = start(coarse, chosen.basis)
        if not begin.sides.clear:
            raise _crossing(desired, fields, chosen, begin.A, region, Q_few, begin.sides)

        def rough(penalty: float) -> Descent:
            """Descend on few nodes from the start, and from random changes of it; the best."""
            found = [descend(coarse, chosen.basis, begin, begin.A, penalty=penalty, tolerance=enough, report=step)]
            for attempt in range(restarts):
                noise = np.random.default_rng([seed, attempt]).normal(size=begin.A.shape)
                away = begin.A + 0.3 * chosen.basis @ noise / np.sqrt(len(noise))
                if coarse.total(criterion.cost, away)[-1].clear:
                    found.append(
                        descend(coarse, chosen.basis, begin, away, penalty=penalty, tolerance=enough, report=step)
                    )
            return min(found, key=lambda one: one.cost)

        enough = max(tolerance, _COARSE_TOLERANCE)
        near = rough(_PENALTIES[1])
        penalties = _PENALTIES
        if _singular_between(desired, fields, chosen, near.A, region, seed):
            penalties = _PENALTIES[-1:]
            near = rough(penalties[0])
        if len(Q_few) < len(Q):
            fine = batches_of(Q, weights, executor)
        for penalty in penalties:
            result = descend(fine, chosen.basis, begin, near.A, penalty=penalty, tolerance=tolerance, report=step)
            result = replace(result, steps=result.steps + near.steps)
            last = penalty == penalties[-1]
            if not result.sides.clear:
                if last:
                    raise _crossing(desired, fields, chosen, result.A, region, Q, result.sides)
                continue
            report("judging on held-out nodes", 0.0)
            try:
                return _judged(desired, fields, region, chosen, result, len(Q), held_out, seed, last)
            except SingularRegionError:
                if last:
                    raise
    finally:
        coarse.close()
        fine.close()
    raise AssertionError("the last penalty returns or raises")


def _judged(
    desired: Inverse,
    fields: Field,
    region: Region,
    chosen: Independent,
    result: Descent,
    samples: int,
    held_out: int,
    seed: int,
    free: bool,
) -> Design:
    """Make the design, with figures from held-out nodes."""
    A = _spread(fields, chosen, result.A)
    N, _, D = evaluate(desired, fields, region.center[None])
    A = A @ np.linalg.inv(N[0].T @ D[0] @ A)  # gauge: Nᵀ V = I at the center, J_V as well conditioned as J there
    inverse = RepeatableInverse(desired.task, fields.weighted(A))
    verdict = judge(inverse, desired, region, samples=held_out, seed=seed + 1, free=free)
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


def _spread(fields: Field, chosen: Independent, A: Array) -> Array:
    """Put zeros where potentials were dropped: (N, r)."""
    whole = np.zeros((fields.size, A.shape[1]))
    whole[chosen.kept] = A
    return whole


def _one_sided(
    desired: Inverse, fields: Field, chosen: Independent, A: Array, region: Region
) -> Callable[[Array], Array]:
    """Measure the leaf margin of V, positive on the side of the center."""
    leaf_margin = signed_leaf_margin(desired.task, fields.weighted(_spread(fields, chosen, A)))
    side = np.sign(leaf_margin(region.center[None]))[0]
    return lambda Q: side * leaf_margin(Q)


def _singular_between(
    desired: Inverse, fields: Field, chosen: Independent, A: Array, region: Region, seed: int
) -> bool:
    """Whether a quick search finds an algorithmic singularity between the nodes."""
    measure = _one_sided(desired, fields, chosen, A, region)
    return search(measure, region, region.random(1024, seed + 7919)).value <= 0


def _crossing(
    desired: Inverse,
    fields: Field,
    chosen: Independent,
    A: Array,
    region: Region,
    Q: Array,
    sides: criterion.Sides,
) -> SingularRegionError:
    """Refuse Ω because det(Nᵀ V) has both signs on its nodes."""
    measure = _one_sided(desired, fields, chosen, A, region)
    nodes = Q[[sides.a_positive, sides.a_negative]]
    bad = nodes[measure(nodes) <= 0]
    return refuse_singular("an algorithmic singularity lies", desired.task, measure, region, bad[0], bad)
