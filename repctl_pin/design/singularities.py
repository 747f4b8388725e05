"""Search Ω for singularities: of the arm, and of a choice of potentials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arguments import Array
from ..errors import SingularityError
from ..potentials.basis import Potentials
from ..regions import Region
from ..robot.task import Task
from .criterion import named

Measure = Callable[[Array], Array]
"""Q (K, n) → (K,): 0 at a singularity."""

_STARTS = 16
_STEPS = 60
_NEWTON = 12
_RANK = 1e-5
_BISECTIONS = 12

SHRUNK_MARGIN = 0.1
"""The leaf margin to which a region is shrunk: at the very edge of a singularity a design is of no
use."""


class SingularRegionError(SingularityError):
    """A singularity lies in Ω.

    Attributes
    ----------
    finding : str
        What was found; the message adds a remedy.
    at : (n,) array
        Where, rad (m for sliding joints).
    free : Region or None
        The largest region round the center, of the same shape, that was found free of it; of an
        algorithmic singularity: with a leaf margin of 0.1 or more.

    Examples
    --------
    >>> wide = rp.Box(q0, 3.0)  # reaches singular configurations
    >>> try:
    ...     rp.nearest_repeatable(control, rp.Polynomial(q0, 2, 3.0), wide, samples=512, held_out=512)
    ... except rp.SingularRegionError as error:
    ...     print(type(error).__name__)
    SingularRegionError
    """

    def __init__(self, finding: str, at: Array, free: Region | None, remedy: str = "") -> None:
        super().__init__(finding, remedy=remedy, at=at)
        self.free = free


@dataclass(frozen=True)
class Lowest:
    """The lowest value of a measure found in a region, and where.

    Attributes
    ----------
    value : float
    at : (n,) array
    ends, values : (S, n), (S,) arrays
        Where the local searches ended, and the values there.
    """

    value: float
    at: Array
    ends: Array
    values: Array


class Dexterity:
    """Measure J's distance from rank loss: ``σ_min(J) / σ_max(J)``, 0 from 1e-5 down."""

    def __init__(self, task: Task) -> None:
        self.task = task

    def __call__(self, Q: Array) -> Array:
        """Measure it at every row of Q (K, n): (K,)."""
        values = np.linalg.svd(self.task.jacobians(Q), compute_uv=False)
        return np.where(values[:, -1] > _RANK * values[:, 0], values[:, -1] / values[:, 0], 0.0)

    def newton(self, Q: Array, scale: Array) -> Array:
        """Take the shortest step to rank loss to first order, (K, n), in units of scale (n,).

        J = U Σ Vᵀ loses rank where ``V₂ᵀ Jᵀ u = 0``, u the last column of U and V₂ those of V from
        m on: n − m + 1 equations. An arm stretched out is such a cone's tip, which no descent of
        σ_min reaches."""
        m = self.task.m
        U, sigma, Vt = np.linalg.svd(self.task.jacobians(Q))
        slope = np.einsum(
            "Kvi,Kaik,Ka->Kvk", Vt[:, m - 1 :], self.task.hessians(Q), U[:, :, -1], optimize=True
        )
        step: Array = -np.linalg.pinv(slope * scale, rcond=1e-6)[:, :, 0] * sigma[:, -1:]
        return step


class LeafMargin:
    """Measure ``σ_min(Nᵀ V̂)``, below 0 where ``det [J; Vᵀ]`` has another sign than at a center
    (n,).

    The sign changes at an algorithmic singularity. Where J has full rank this is smooth through its
    zeros but for crossings of singular values."""

    def __init__(self, task: Task, potentials: Potentials, center: Array) -> None:
        self.task, self.potentials, self.side = task, potentials, 1.0
        self.side = float(np.sign(self(center[None]))[0])

    def __call__(self, Q: Array) -> Array:
        """Measure it at every row of Q (K, n): (K,)."""
        J, V = self.task.jacobians(Q), self.potentials.gradients(Q)
        N = np.linalg.qr(np.swapaxes(J, -1, -2), mode="complete")[0][..., self.task.m :]
        V_hat = np.linalg.qr(V)[0]
        sigma = np.linalg.svd(np.swapaxes(N, -1, -2) @ V_hat, compute_uv=False)[:, -1]
        return (
            self.side
            * sigma
            * np.sign(np.linalg.det(np.concatenate([J, np.swapaxes(V, -1, -2)], axis=1)))
        )


def lowest(measure: Measure, region: Region, starts: Array) -> Lowest:
    """Minimise a measure over Ω from several starts at once, until it is 0 or below, or no step
    helps.

    Each start goes down the slope, no further than to where the slope would reach 0, with a bound
    on the step that doubles where it helped and is quartered where not.

    Parameters
    ----------
    measure
        What to minimise, from 0 up but for a crossing.
    region
        Ω.
    starts : (S, n) array
        In Ω.
    """
    scale = region.bounds.half_width
    Q, value = starts.copy(), measure(starts)
    n = Q.shape[1]
    bound = np.full(len(Q), 0.1)
    nudge = 1e-6 * np.eye(n) * scale
    for _ in range(_STEPS):
        moving = np.flatnonzero(bound >= 1e-5)
        if value.min() <= 0 or not len(moving):
            break
        here, at = Q[moving], value[moving]
        slope = (
            measure((here[:, None] + nudge).reshape(-1, n)).reshape(-1, n) - at[:, None]
        ) / 1e-6  # (S, n)
        # what of the way down stays in Ω
        down = (region.clip(here - 1e-4 * slope * scale / _length(slope)[:, None]) - here) / (
            1e-4 * scale
        )
        steepness = np.maximum(-np.sum(down * slope, axis=1) / _length(down), 1e-12)
        length = np.minimum(bound[moving], 1.01 * at / steepness)
        trial = region.clip(here + (length / _length(down))[:, None] * down * scale)
        found = measure(trial)
        better = (found < at) & (region.ratio(trial) <= 1 + 1e-9)
        Q[moving[better]], value[moving[better]] = trial[better], found[better]
        bound[moving] = np.where(better, np.minimum(2 * bound[moving], 0.5), bound[moving] / 4)
    if isinstance(measure, Dexterity) and value.min() > 0:
        ends = Q.copy()
        for _ in range(_NEWTON):
            step = measure.newton(ends, scale)
            ends = region.clip(ends + scale * step * np.minimum(1.0, 0.5 / _length(step))[:, None])
            found = measure(ends)
            better = (found < value) & (region.ratio(ends) <= 1 + 1e-9)
            Q[better], value[better] = ends[better], found[better]
            if value.min() <= 0:
                break
    worst = int(np.argmin(value))
    return Lowest(float(value[worst]), Q[worst], Q, value)


def search(measure: Measure, region: Region, Q: Array, values: Array | None = None) -> Lowest:
    """Find the lowest value of a measure in Ω: local searches from the worst of the points Q and
    from some others."""
    values = measure(Q) if values is None else values
    order = np.argsort(values)
    others = order[np.linspace(0, len(order) - 1, _STARTS // 4).astype(int)]
    starts = Q[np.unique(np.concatenate([order[: _STARTS - len(others)], others]))]
    return lowest(measure, region, starts)


def largest_free(measure: Measure, region: Region, bad: Array) -> Region | None:
    """Find the largest region round the center, of Ω's shape, in which a measure stays above its
    floor.

    The floor is 0 for the arm's own singularities, and a leaf margin of 0.1. The first crossings on
    the way from known ones to the center bound the region from above; then it is bisected, each
    smaller one being searched anew.

    Parameters
    ----------
    measure, region
        What must stay above its floor, and Ω.
    bad : (B, n) array
        Points of Ω where it does not.

    Returns
    -------
    Region or None
        None if the center itself is singular, or nearly so.
    """
    if isinstance(measure, LeafMargin):
        margin = measure

        def measure(Q: Array) -> Array:
            return margin(Q) - SHRUNK_MARGIN

    share = np.linspace(0, 1, 65)[1:, None, None]
    ray = (region.center + share * (bad[:256] - region.center)).reshape(-1, bad.shape[1])
    ratios = region.ratio(ray)[measure(ray) <= 0]
    high = min(1.0, float(ratios.min()) if len(ratios) else 1.0)
    low: float = 0.0
    best: Region | None = None
    for step in range(_BISECTIONS):
        # first just below the bound, which is often the answer
        factor = 0.99 * high if step == 0 else (low + high) / 2
        if factor < 0.01:
            return None
        smaller = region.shrunk(factor)
        if search(measure, smaller, smaller.random(2048, step)).value > 0:
            low, best = factor, smaller
        else:
            high = factor
        if high - low < 0.011 * high:
            break
    return best


def refuse_singular(
    what: str, task: Task, measure: Measure, region: Region, bad: Array
) -> SingularRegionError:
    """Make the refusal that names the first of some points (B, n), and the largest region that is
    free of them."""
    at, largest = bad[0], largest_free(measure, region, bad)
    where = f"{what} in Ω near {named(task, at)}"
    if largest is None:
        return SingularRegionError(
            f"{where}; the center of the region is singular, or nearly so", at, None,
            "choose another, or a smaller region",
        )  # fmt: skip
    free = (
        "free of it"
        if not isinstance(measure, LeafMargin)
        else f"{SHRUNK_MARGIN:g} or more in leaf margin from it"
    )
    found = f"{where}; the largest region round its center that is {free} is a {largest}"
    return SingularRegionError(found, at, largest, "take that (shrink=True)")


def _length(vectors: Array) -> Array:
    return np.maximum(np.linalg.norm(vectors, axis=1), 1e-12)
