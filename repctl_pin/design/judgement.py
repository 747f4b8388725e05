"""What a repeatable inverse is worth over Ω, judged on nodes that no fit has seen."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..arguments import Array
from ..redundancy.augmented import leaf_margin
from ..regions import Region
from ..strategies.repeatable import RepeatableInverse
from ..strategies.strategy import Inverse
from .criterion import oriented_nullspace
from .singularities import refuse_singular, search, signed_leaf_margin

REPLICATES = 32
_CANDIDATES = 64


@dataclass(frozen=True)
class Judgement:
    """Figures of one inverse over one region.

    Attributes
    ----------
    cost, cost_error : float
        Mean over Ω of ‖G_r − G_d‖_F² (26), and its standard error over independent scramblings.
    relative_distance : float
        ``sqrt(cost / mean ‖G_d‖_F²)``.
    leaf_margin : float
        The smallest σ_min(Nᵀ V̂) that a search of Ω found.
    leaf_margin_at : (n,) array
        Where.
    inside_limits : float
        Share of Ω inside the joint limits.
    replicates : (32,) array
        The cost on each scrambling.
    """

    cost: float
    cost_error: float
    relative_distance: float
    leaf_margin: float
    leaf_margin_at: Array = field(repr=False)
    inside_limits: float
    replicates: Array = field(repr=False)


def judge(
    inverse: RepeatableInverse,
    desired: Inverse,
    region: Region,
    *,
    samples: int = 16384,
    seed: int = 1,
    free: bool = True,
) -> Judgement:
    """Judge a repeatable inverse against a desired one.

    Parameters
    ----------
    inverse, desired
        G_r and G_d.
    region
        Ω.
    samples
        Held-out nodes, in 32 independent scramblings; their scatter gives the standard error. It is that of a
        mean whose scatter is itself estimated: wider by √(31/29), the spread of Student's t.
    seed
        Of the nodes; another one than the fit's.
    free
        Look for the largest region free of a singularity that was found.

    Raises
    ------
    SingularRegionError
        If an algorithmic singularity lies in Ω.
    """
    task = inverse.task
    costs, norms, inside = [], [], []
    candidates: list[tuple[Array, Array]] = []
    measure = signed_leaf_margin(task, inverse.field)
    side = np.sign(measure(region.center[None]))[0]

    def one_sided(Q: Array) -> Array:
        return side * measure(Q)

    for replicate in range(REPLICATES):
        Q = region.random(-(-samples // REPLICATES), seed * REPLICATES + replicate)
        weights = region.weights(Q)
        J = task.jacobians(Q)
        N = oriented_nullspace(J, task, Q)
        V = inverse.field.gradients(Q)
        sigma = leaf_margin(N, V) * np.sign(np.linalg.det(np.swapaxes(N, -1, -2) @ V)) * side
        if not (sigma > 0).all():
            at = Q[int(np.argmin(sigma))]
            raise refuse_singular(
                "an algorithmic singularity lies", task, one_sided, region, at, Q[sigma <= 0], free=free
            )
        G_d = desired.batch(Q, J)
        costs.append(float(weights @ np.sum((inverse.batch(Q, J) - G_d) ** 2, axis=(1, 2))))
        norms.append(float(weights @ np.sum(G_d**2, axis=(1, 2))))
        inside.append(float(weights @ (task.limit_margin(Q) >= 0).all(axis=1)))
        few = np.argsort(sigma)[:_CANDIDATES]
        candidates.append((Q[few], sigma[few]))
    found = search(
        one_sided, region, np.concatenate([q for q, _ in candidates]), np.concatenate([s for _, s in candidates])
    )
    if found.value <= 0:
        raise refuse_singular("an algorithmic singularity lies", task, one_sided, region, found.at, free=free)
    mean = float(np.mean(costs))
    widened = np.sqrt((REPLICATES - 1) / (REPLICATES - 3))
    return Judgement(
        cost=mean,
        cost_error=float(np.std(costs, ddof=1) / np.sqrt(REPLICATES) * widened),
        relative_distance=float(np.sqrt(mean / np.mean(norms))),
        leaf_margin=found.value,
        leaf_margin_at=found.at,
        inside_limits=float(np.mean(inside)),
        replicates=np.array(costs),
    )
