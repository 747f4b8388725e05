"""Fit of potentials in one region, with the checks before it and the evaluation after it.

The steps are: a search for singularities of the arm, the selection of independent potentials, the
minimisation of the cost on a few nodes and then on all, and the evaluation on held-out nodes. Nodes
are configurations of the region Ω at which the cost is evaluated. A barrier point is a
configuration at which an earlier fit had an algorithmic singularity, where the repeatable inverse
fails though J has full rank; it is added to the nodes, so that the next fit has none there. An
argument ``problem`` has the desired inverse, the basis of potentials, Ω and the options of the fit.

``FitProblem`` holds the arguments of a fit: desired inverse, potentials, region Ω and options.
``Batches`` are the nodes (configurations with weights) of a fit, over which functions are summed.
``Independent`` are the independent potentials of a basis: their indices, and the names of the
dropped ones. ``Continuation`` is the sequence of descents of one fit, from low degrees to high
ones. ``BarrierCost`` is the cost over the nodes of a fit and over barrier points, configurations
that repel singularities. ``Descent`` is the result of a descent: coefficients A, cost, gradient
norm, steps, and whether it converged. ``PotentialBasis`` is a basis of N functions of q, whose
combinations are the potentials h of a design.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..base.arguments import Array
from ..base.defaults import NODES
from ..base.errors import InputError
from ..model.task import Task
from ..potentials.basis import PotentialBasis
from ..strategies.repeatable import RepeatableInverse
from . import criterion
from .batches import BarrierCost, Batches
from .continuation import Continuation, FitProblem
from .criterion import Builder, evaluate, oriented_nullspace
from .design_result import Design
from .evaluation import evaluate_design
from .gauss_newton import Descent
from .independence import Independent, independent
from .singularity_search import SEARCHED, Dexterity, SingularRegionError, refuse_singular, search

_LEAST_NODES = 4096
_NODES_PER_UNKNOWN = 32
_PENALTY = 1e-3
_ROUNDS = 4


def fit(problem: FitProblem) -> Design:
    """Design a repeatable inverse in one region, and evaluate it on held-out nodes.

    Raises
    ------
    SingularRegionError
        If the region contains a singularity of the arm, or if every fit has an algorithmic
        singularity in the region.
    InputError
        If the nodes are too few for the potentials.
    """
    desired = problem.desired
    task = desired.task
    potentials = problem.potentials
    region = problem.region
    seed = problem.options.seed
    _refuse_arm_singularities(problem)

    # choose the nodes: few for most descents, all of them for the last ones
    count, few = _numbers_of_nodes(problem)
    Q, weights = region.nodes(count, seed)
    Q_few, few_weights = region.nodes(few, seed) if len(Q) >= 2 * few else (Q, weights)

    # choose potentials whose gradients are independent, and fix what all batches share
    chosen = independent(desired, potentials, *region.nodes(max(512, 2 * potentials.size), seed))
    N_center = oriented_nullspace(task.jacobian(region.center)[None], task, region.center[None])[0]
    builder = Builder(desired, potentials, chosen.kept, N_center)

    def batches_of(Q: Array, weights: Array) -> Batches:
        return Batches(
            builder, Q, weights, tick=lambda share: problem.report(f"{len(Q)} nodes", share)
        )

    few_nodes = batches_of(Q_few, few_weights)
    coarse = BarrierCost(few_nodes, builder, 1 / len(Q_few))
    continuation = Continuation(problem, chosen, coarse)
    fine = coarse
    refusal: SingularRegionError | None = None
    for near in continuation.regular():
        if fine is coarse and len(Q_few) < len(Q):
            fine = BarrierCost(batches_of(Q, weights), builder, 1 / len(Q), coarse.guards)
        found = _refined(problem, chosen, continuation, near, fine, len(Q))
        if isinstance(found, Design):
            return found
        refusal = found
    raise continuation.refusal(Q_few, refusal)


def _refuse_arm_singularities(problem: FitProblem) -> None:
    """Raise SingularRegionError if the search finds a singularity of the arm in Ω."""
    problem.report("searching Ω for singularities of the arm", 0.0)
    task, region = problem.desired.task, problem.region
    measure = Dexterity(task)
    lowest = search(measure, region, region.random(SEARCHED, problem.options.seed))
    if lowest.value <= 0:
        raise refuse_singular(
            "the Jacobian loses rank in Ω", task, measure, region, lowest.at[None]
        )


def _numbers_of_nodes(problem: FitProblem) -> tuple[int, int]:
    """Compute two numbers of nodes: all, for the last descents, and few, for those before them.

    InputError is raised if even all nodes are too few for the potentials.
    """
    task, size, samples = problem.desired.task, problem.potentials.size, problem.options.samples
    unknowns = (size - task.r) * task.r
    few = max(_LEAST_NODES, _NODES_PER_UNKNOWN * unknowns // task.m)
    count = max(few, NODES) if samples is None else samples
    if undetermined(problem.potentials, task, count):
        raise InputError(
            f"{count} samples are too few for {size} potentials",
            remedy=f"give at least {-(-size // task.m)} samples",
        )
    return count, few


def _refined(
    problem: FitProblem,
    chosen: Independent,
    continuation: Continuation,
    near: Descent,
    fine: BarrierCost,
    samples: int,
) -> Design | SingularRegionError:
    """Descend on all nodes from ``near``, a result on few nodes, and evaluate on held-out nodes.

    ``chosen`` are the independent potentials, and ``continuation`` has made ``near``. ``fine`` is
    the cost over all nodes and over barrier points; ``samples`` is the number of all nodes. A
    singularity that the evaluation finds becomes a barrier point, and the descent is repeated.
    Return the error of the singularity, instead of a design, if ``near`` is singular at that
    configuration, too, or if the fourth evaluation still finds a singularity.
    """
    refusal: SingularRegionError | None = None
    for _ in range(_ROUNDS):
        found = continuation.descend(fine, near.A, _PENALTY, problem.options.tolerance)
        result = found or replace(near, converged=False, steps=0)
        cost, _ = fine.batches.total(criterion.cost, result.A)
        result = replace(result, cost=cost, steps=result.steps + near.steps)
        problem.report("evaluating on held-out nodes", 0.0)
        try:
            return _evaluated_design(problem, chosen, result, samples)
        except SingularRegionError as error:
            refusal = error
        if continuation.margin(near.A)(refusal.at[None])[0] <= 0:
            break
        fine.guard(refusal.at[None])
    assert refusal is not None
    return refusal


def undetermined(potentials: PotentialBasis, task: Task, nodes: int) -> bool:
    """Test whether a number of ``nodes`` is too small to determine the potentials of a basis.

    Each node gives m equations, and there must be at least as many equations as potentials. A fit
    to fewer nodes is refused, and a search for the best degree ends before such a degree.
    """
    return nodes * task.m < potentials.size


def _evaluated_design(
    problem: FitProblem, chosen: Independent, result: Descent, samples: int
) -> Design:
    """Make the design from the result of a descent, and evaluate it on held-out nodes.

    ``chosen`` are the independent potentials whose coefficients the descent found, and ``samples``
    is the number of nodes of the fit. The coefficients are scaled to ``Nᵀ V = I`` at the centre of
    Ω, where N is an orthonormal basis of the null space of J and V are the gradients of the
    potentials. A SingularRegionError is raised if the evaluation finds an algorithmic singularity.
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
