"""Evaluation of a repeatable inverse, and of two simpler ones, over Ω on held-out nodes.

Ω is the region of joint space of a design. Held-out nodes are configurations that the fit did not
use, so that a fit to too few nodes is seen. They are drawn in 32 replicates, independent random
sets, whose spread gives the standard error of the cost. G_r is the repeatable inverse, G_d the
desired one. N and V̂ are orthonormal bases of the null space of J and of the gradients of the
potentials; σ_min(Nᵀ V̂) is the leaf margin, the distance from an algorithmic singularity, at which
G_r fails though J has full rank. Numbers such as (26) are equations of the paper
(docs/notation.md).

``LeafMargin`` is the signed distance from an algorithmic singularity, as a function of q.
``_Replicate`` is the means over one set of nodes, and its nodes with the lowest leaf margins.
``Baseline`` is a simpler repeatable inverse over the same Ω: its name, its figures, or why it was
refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..base.arguments import Array, read_only
from ..base.errors import RepctlError
from ..base.progress import Report
from ..model.native_kinematics import jacobians
from ..model.task import Task
from ..potentials.polynomial import Polynomial
from ..redundancy.augmented import leaf_margin
from ..regions import Region
from ..strategies import Pseudoinverse
from ..strategies.repeatable import RepeatableInverse
from ..strategies.strategy import Inverse
from .criterion import named, null_space_and_inverse, oriented_nullspace
from .singularity_search import LeafMargin, SingularRegionError, search

REPLICATES = 32
_CANDIDATES = 64
"""Number of candidates per replicate for the search of the leaf margin; where an evaluation has
fewer nodes, the search has nodes of its own."""

_BATCH = 1024
"""Number of nodes up to which several replicates are evaluated at once, which takes less time."""


@dataclass(frozen=True, eq=False)
@read_only
class Evaluation:
    """Figures of one repeatable inverse G_r over one region Ω: its cost and its margins.

    Attributes
    ----------
    cost, cost_error : float
        Mean over Ω of ‖G_r − G_d‖_F² (26), and its standard error, estimated from 32 independently
        scrambled sets of nodes.
    relative_distance : float
        ``sqrt(cost / mean ‖G_d‖_F²)``.
    leaf_margin : float
        Smallest σ_min(Nᵀ V̂) that a search of Ω found.
    leaf_margin_at : (n,) array
        Configuration of the smallest leaf margin, rad (m for prismatic joints).
    inside_limits : float
        Fraction of Ω inside the joint limits.
    """

    cost: float
    cost_error: float
    relative_distance: float
    leaf_margin: float
    leaf_margin_at: Array = field(repr=False)
    inside_limits: float


def evaluate_design(
    inverse: RepeatableInverse, desired: Inverse, region: Region, *, samples: int, seed: int
) -> Evaluation:
    """Evaluate a repeatable inverse against a desired one, on held-out nodes of a region.

    A fit can be good at its own nodes and bad between them, so other nodes are used here.

    Parameters
    ----------
    inverse, desired
        G_r and G_d.
    region
        Ω.
    samples
        Number of held-out nodes. They form 32 independently scrambled sets; the scatter of the
        cost between the sets gives the standard error. The error includes the factor √(31/29), the
        standard deviation of Student's t with 31 degrees of freedom.
    seed
        Random seed of the nodes; it must differ from the seed of the fit.

    Returns
    -------
    Evaluation
        Cost with its standard error, relative distance from G_d, smallest leaf margin with its
        configuration, and the fraction of Ω inside the joint limits.

    Raises
    ------
    SingularRegionError
        If an algorithmic singularity lies in Ω.
    """
    measure = LeafMargin(inverse.task, inverse.potentials, region.center)
    count = -(-samples // REPLICATES)
    sets = [
        one
        for seeds in _batches(count, seed)
        for one in _evaluated(inverse, desired, region, measure, count, seeds)
    ]

    # the smallest leaf margin, from the nodes with the smallest ones
    points = [one.lowest for one in sets]
    values = [one.leaf_margins for one in sets]
    if (few := REPLICATES * _CANDIDATES - sum(map(len, values))) > 0:
        points.append(region.random(few, seed * REPLICATES))
        values.append(measure(points[-1]))
    found = search(measure, region, np.concatenate(points), np.concatenate(values))
    if found.value <= 0:
        raise _singular(inverse.task, found.at)

    # the cost, and its standard error
    costs = [one.cost for one in sets]
    mean = float(np.mean(costs))
    widened = np.sqrt((REPLICATES - 1) / (REPLICATES - 3))
    return Evaluation(
        cost=mean,
        cost_error=float(np.std(costs, ddof=1) / np.sqrt(REPLICATES) * widened),
        relative_distance=float(np.sqrt(mean / np.mean([one.norm for one in sets]))),
        leaf_margin=found.value,
        leaf_margin_at=found.at,
        inside_limits=float(np.mean([one.inside for one in sets])),
    )


def _batches(count: int, seed: int) -> list[range]:
    """List the seeds of the 32 replicates, as ranges; those of one range are evaluated at once.

    ``count`` is the number of nodes of a replicate, and ``seed`` the random seed of the evaluation,
    from which the 32 seeds follow.
    """
    seeds = range(seed * REPLICATES, (seed + 1) * REPLICATES)
    at_once = max(1, _BATCH // count)
    return [seeds[first : first + at_once] for first in range(0, REPLICATES, at_once)]


class _Replicate(NamedTuple):
    """Means over one set of nodes, and its nodes with the lowest leaf margins.

    ``cost`` is the mean of ‖G_r − G_d‖_F², ``norm`` the mean of ‖G_d‖_F², and ``inside`` the
    fraction of nodes inside the joint limits. ``lowest`` (C, n) are the nodes with the lowest leaf
    margins, and ``leaf_margins`` (C,) these margins.
    """

    cost: float
    norm: float
    inside: float
    lowest: Array
    leaf_margins: Array


def _evaluated(
    inverse: RepeatableInverse,
    desired: Inverse,
    region: Region,
    measure: LeafMargin,
    count: int,
    seeds: Sequence[int],
) -> list[_Replicate]:
    """Evaluate G_r at sets of ``count`` nodes of the region, each drawn with one of the ``seeds``.

    ``measure`` is the leaf margin of the inverse. A SingularRegionError is raised if it is 0 at
    some node, or negative, as beyond an algorithmic singularity.
    """
    task = inverse.task
    sets = [region.random(count, seed) for seed in seeds]
    Q = np.concatenate(sets)
    J = jacobians(task, Q)
    N, J_plus = null_space_and_inverse(J, task, Q)
    V = inverse.potentials.gradients(Q)
    side = np.sign(np.linalg.det(np.swapaxes(N, -1, -2) @ V)) * measure.side
    margins = _split(leaf_margin(N, V) * side, sets)
    for nodes, sigma in zip(sets, margins, strict=True):
        if not (sigma > 0).all():
            raise _singular(task, nodes[int(np.argmin(sigma))])
    G_d = J_plus if type(desired) is Pseudoinverse else desired.batch(Q, J)
    terms = (
        np.sum((inverse.batch(Q, J) - G_d) ** 2, axis=(1, 2)),
        np.sum(G_d**2, axis=(1, 2)),
        (task.limit_margin(Q) >= 0).all(axis=1).astype(float),
    )
    by_set = zip(sets, margins, *(_split(values, sets) for values in terms), strict=True)
    return [_replicate(region.weights(nodes), nodes, *values) for nodes, *values in by_set]


def _split(values: Array, sets: list[Array]) -> list[Array]:
    """Split ``values`` into one array per set of nodes.

    ``values`` has one row for each node: first the nodes of the first of the ``sets``, then those
    of the second, and so on.
    """
    return np.split(values, np.cumsum([len(nodes) for nodes in sets])[:-1])


def _replicate(
    weights: Array, nodes: Array, sigma: Array, gaps: Array, norms: Array, inside: Array
) -> _Replicate:
    """Average over one set of ``nodes`` (K, n) with ``weights`` (K,).

    The other arguments are arrays (K,), with one value per node. ``sigma`` is the leaf margin,
    ``gaps`` is ‖G_r − G_d‖_F², and ``norms`` is ‖G_d‖_F². ``inside`` is 1 if the node is inside the
    joint limits, else 0.
    """
    lowest = np.argsort(sigma)[:_CANDIDATES]
    cost, norm, share = (float(weights @ values) for values in (gaps, norms, inside))
    return _Replicate(cost, norm, share, nodes[lowest], sigma[lowest])


def _singular(task: Task, at: Array) -> SingularRegionError:
    """Make the error for an algorithmic singularity near the configuration ``at`` (n,)."""
    what = f"an algorithmic singularity lies in Ω near {named(task, at)}"
    return SingularRegionError(what, at, None)


def spectral_cost(
    inverse: RepeatableInverse, desired: Inverse, region: Region, *, samples: int, seed: int
) -> float:
    """Evaluate the mean over Ω of ‖G_r − G_d‖₂² on held-out nodes.

    The spectral norm is that of the paper. ``samples`` is the number of held-out nodes and ``seed``
    their random seed, another than that of the fit. Ω is ``region``.
    """
    costs = []
    for replicate in range(REPLICATES):
        Q = region.random(-(-samples // REPLICATES), seed * REPLICATES + replicate)
        J = jacobians(inverse.task, Q)
        gap = inverse.batch(Q, J) - desired.batch(Q, J)
        costs.append(region.weights(Q) @ np.linalg.norm(gap, 2, axis=(1, 2)) ** 2)
    return float(np.mean(costs))


@dataclass(frozen=True)
class Baseline:
    """Evaluation of a simpler repeatable inverse over the same Ω, with which a design is compared.

    Attributes
    ----------
    name : str
        Display name.
    evaluation : Evaluation or None
        Cost and margins; None if the inverse has a singularity in Ω.
    refused : str
        Error message about the singularity; empty if there is none.
    """

    name: str
    evaluation: Evaluation | None
    refused: str = ""

    @property
    def text(self) -> str:
        """Cost and leaf margin in one line, or the message about the singularity."""
        if self.evaluation is None:
            return self.refused
        j = self.evaluation
        return f"{j.cost:.6g} ± {j.cost_error:.1g}, leaf margin {j.leaf_margin:.3f}"


def _constant_rows(task: Task, center: Array) -> RepeatableInverse:
    """Make the repeatable inverse whose V is constant, ``V = N(center)``: linear potentials.

    N(center) is the null-space basis at the configuration ``center`` (n,). A design is compared
    with this inverse, the simplest repeatable one.
    """
    N = oriented_nullspace(task.jacobian(center)[None], task, center[None])[0]
    linear = Polynomial(center, 1)
    return RepeatableInverse(
        task, linear.weighted(np.linalg.solve(linear.gradients(center[None])[0], N))
    )


def baselines(
    desired: Inverse, region: Region, *, samples: int, seed: int, report: Report
) -> tuple[Baseline, ...]:
    """Evaluate two simpler repeatable inverses on held-out nodes, for comparison with a design.

    They are the augmented Jacobian with constant rows (linear potentials), and the extended
    Jacobian of ``U = ½ ‖q − center‖²``; ``center`` is the centre of Ω. ``report`` is the progress
    callback (step, fraction), ``samples`` is the number of held-out nodes and ``seed`` their random
    seed, another than that of the fit.
    """
    from ..strategies.extended_jacobian import ExtendedJacobian

    task, center = desired.task, region.center
    inverses: dict[str, RepeatableInverse] = {
        "constant rows": _constant_rows(task, center),
        "extended Jacobian": ExtendedJacobian(task, center),
    }
    found: list[Baseline] = []
    for name, inverse in inverses.items():
        report(f"evaluating {name} for comparison", len(found) / len(inverses))
        try:
            evaluation = evaluate_design(inverse, desired, region, samples=samples, seed=seed)
        except RepctlError as error:
            found.append(Baseline(name, None, str(error)))
        else:
            found.append(Baseline(name, evaluation))
    return tuple(found)
