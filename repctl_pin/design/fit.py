"""Fit of potentials in one region, from singularities of the arm to held-out nodes.

The steps are: a search for singularities of the arm, the selection of independent potentials, the
minimisation of the cost, and the evaluation on held-out nodes. Nodes are configurations of the
region at which the cost is evaluated.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..base.arguments import Array
from ..base.defaults import NODES
from ..base.errors import InputError
from ..model.task import Task
from ..potentials.basis import PotentialBasis
from ..strategies.repeatable import RepeatableInverse
from . import criterion
from .batches import BarrierCost, Batches, Local, hand_out
from .continuation import Continuation, FitProblem
from .criterion import Builder, evaluate, oriented_nullspace
from .descend import Descent
from .design_result import Design
from .evaluation import evaluate_design
from .independence import Independent, independent
from .singularity_search import Dexterity, SingularRegionError, refuse_singular, search

if TYPE_CHECKING:
    from distributed import Client

_LEAST_NODES = 4096
_NODES_PER_UNKNOWN = 32
_PENALTY = 1e-3
_ROUNDS = 4


def fit(problem: FitProblem) -> Design:
    """Design a repeatable inverse in one region, and evaluate it on held-out nodes.

    Raises
    ------
    SingularRegionError
        If the region contains a singularity of the arm, or no V without an algorithmic singularity
        in it was found.
    InputError
        If the nodes are too few for the potentials.
    """
    desired, potentials, region, seed, report = (
        problem.desired,
        problem.potentials,
        problem.region,
        problem.options.seed,
        problem.report,
    )
    options = problem.options
    task = desired.task
    report("searching Ω for singularities of the arm", 0.0)
    measure = Dexterity(task)
    lowest = search(measure, region, region.random(2048, seed))
    if lowest.value <= 0:
        raise refuse_singular(
            "the Jacobian loses rank in Ω", task, measure, region, lowest.at[None]
        )
    unknowns = (potentials.size - task.r) * task.r
    few = max(_LEAST_NODES, _NODES_PER_UNKNOWN * unknowns // task.m)
    count = max(few, NODES) if options.samples is None else options.samples
    if undetermined(potentials, task, count):
        least = -(-potentials.size // task.m)
        raise InputError(
            f"{count} nodes are too few for {potentials.size} potentials; give at least {least}"
        )
    Q, weights = region.nodes(count, seed)
    Q_few, w_few = region.nodes(few, seed) if len(Q) >= 2 * few else (Q, weights)
    chosen = independent(desired, potentials, *region.nodes(max(512, 2 * potentials.size), seed))
    N_center = oriented_nullspace(task.jacobian(region.center)[None], task, region.center[None])[0]
    builder = Builder(desired, potentials, chosen.kept, N_center)

    def batches_of(Q: Array, weights: Array, where: Executor | Client | None) -> Batches:
        def tick(share: float) -> None:
            report(f"{len(Q)} nodes", share)

        if where is None:
            return Local(builder, Q, weights, options.batch, stream=options.stream, tick=tick)
        return hand_out(builder, Q, weights, options.batch, where, stream=options.stream, tick=tick)

    few_nodes = batches_of(Q_few, w_few, options.executor if len(Q_few) == len(Q) else None)
    all_nodes = few_nodes
    try:
        coarse = BarrierCost(few_nodes, builder, 1 / len(Q_few))
        way = Continuation(problem, chosen, coarse)
        refusal: SingularRegionError | None = None
        fine = coarse
        for near in way.regular():
            if all_nodes is few_nodes and len(Q_few) < len(Q):
                all_nodes = batches_of(Q, weights, options.executor)
                fine = BarrierCost(all_nodes, builder, 1 / len(Q), coarse.guards)
            for _ in range(_ROUNDS):
                found = way.descend(fine, near.A, _PENALTY, options.tolerance)
                result = found or replace(near, converged=False, steps=0)
                cost, _ = all_nodes.total(criterion.cost, result.A)
                result = replace(result, cost=cost, steps=result.steps + near.steps)
                report("evaluating on held-out nodes", 0.0)
                try:
                    return _judged(problem, chosen, result, len(Q))
                except SingularRegionError as error:
                    refusal = error
                if way.margin(near.A)(refusal.at[None])[0] <= 0:
                    break
                fine.guard(refusal.at[None])
        raise way.refusal(Q_few, refusal)
    finally:
        all_nodes.close()


def undetermined(potentials: PotentialBasis, task: Task, nodes: int) -> bool:
    """Test whether there are more potentials than equations, of which each node gives m.

    A fit to so few nodes would be meaningless: it is refused, and a search of the degree ends.
    """
    return nodes * task.m < potentials.size


def _judged(problem: FitProblem, chosen: Independent, result: Descent, samples: int) -> Design:
    """Make the design from the result of a descent, and evaluate it on held-out nodes.

    ``chosen`` are the independent potentials whose coefficients the descent found, and ``samples``
    is the number of nodes of the fit. The coefficients are scaled to ``Nᵀ V = I`` at the centre of
    Ω. A SingularRegionError is raised if the evaluation finds an algorithmic singularity.
    """
    options = problem.options
    desired = problem.desired
    potentials = problem.potentials
    region = problem.region
    A = chosen.spread(result.A)
    N, _, D = evaluate(desired, potentials, region.center[None])
    # gauge: Nᵀ V = I at the center, where J_V then is as well conditioned as J
    A = A @ np.linalg.inv(N[0].T @ D[0] @ A)
    inverse = RepeatableInverse(desired.task, potentials.weighted(A), region=region)
    held_out = NODES if options.held_out is None else options.held_out
    evaluation = evaluate_design(inverse, desired, region, samples=held_out, seed=options.seed + 1)
    return Design(
        inverse,
        desired,
        potentials,
        region,
        A,
        **vars(evaluation),
        fit_cost=result.cost,
        gradient_norm=result.gradient_norm,
        converged=result.converged,
        steps=result.steps,
        samples=samples,
        held_out=held_out,
        seed=options.seed,
        dropped=chosen.dropped,
    )
