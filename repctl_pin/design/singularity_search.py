"""Search for singularities in Ω: of the arm, and of a choice of potentials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, read_only
from ..errors import SingularityError
from ..potentials.basis import Potentials
from ..regions import Region
from ..robot.task import Task
from ..solvers import StepLengths, descend_in_box
from .criterion import named

Measure = Callable[[Array], Array]
"""Q (K, n) → (K,): 0 at a singularity."""

_STARTS = 16
_CORNERS = 256
_LENGTHS = StepLengths(first=0.1, longest=0.5, shortest=1e-5, longer=2.0, shorter=4.0, steps=60)
_DIFFERENCE = 1e-6
_FEELER = 1e-4
"""Step down the slope, in units of the region, that shows where the region ends."""

_EDGE = 1e-9
"""Rounding of the scaled distance from the center."""

_NEWTON = 12
_RANK = 1e-5
_BISECTIONS = 12

SHRUNK_MARGIN = 0.1
"""Leaf margin to which a region is shrunk; next to a singularity a design is not usable."""


class SingularRegionError(SingularityError):
    """The design region Ω contains a singularity.

    Attributes
    ----------
    finding : str
        The fact; the message adds a remedy.
    at : (n,) array
        Configuration of the singularity, rad (m for prismatic joints).
    free : Region or None
        Largest region found with the same center and shape that is free of it; of an algorithmic
        singularity, with a leaf margin of at least 0.1.

    Examples
    --------
    >>> wide = rp.Box(q0, 3.0)  # contains singular configurations
    >>> try:
    ...     options = rp.FitOptions(samples=512, held_out=512)
    ...     rp.nearest_repeatable(control, rp.Polynomial(q0, 2, 3.0), wide, options=options)
    ... except rp.SingularRegionError as error:
    ...     print(type(error).__name__)
    SingularRegionError
    """

    def __init__(self, finding: str, at: Array, free: Region | None, remedy: str = "") -> None:
        super().__init__(finding, remedy=remedy, at=at)
        self.free = free


@dataclass(frozen=True, eq=False)
@read_only
class Lowest:
    """Smallest value of a measure found in a region.

    Attributes
    ----------
    value : float
    at : (n,) array
    ends, values : (S, n), (S,) arrays
        Ends of the local searches, and the values there.
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
        """Evaluate it at every row of Q (K, n): (K,)."""
        values = np.linalg.svd(self.task.jacobians(Q), compute_uv=False)
        return np.where(values[:, -1] > _RANK * values[:, 0], values[:, -1] / values[:, 0], 0.0)

    def newton(self, Q: Array, scale: Array) -> Array:
        """Take the shortest step to rank loss to first order, (K, n), in units of scale (n,).

        J = U Σ Vᵀ loses rank where ``V₂ᵀ Jᵀ u = 0``, u the last column of U and V₂ those of V from
        m on: n − m + 1 equations. A stretched arm is at the tip of a cone of σ_min, which no
        descent of σ_min reaches."""
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
    zeros but for crossings of singular values.

    With ``V = V̂ R`` and ``J_V X = [0; I]``, ``X Rᵀ = N (V̂ᵀ N)⁻¹``, so that ``σ_min(Nᵀ V̂)`` is
    ``1 / σ_max(X Rᵀ)``. N itself is needed only where J_V is exactly singular."""

    def __init__(self, task: Task, potentials: Potentials, center: Array) -> None:
        self.task, self.potentials, self.side = task, potentials, 1.0
        self.side = float(np.sign(self(center[None]))[0])

    def __call__(self, Q: Array) -> Array:
        """Evaluate it at every row of Q (K, n): (K,)."""
        J, V = self.task.jacobians(Q), self.potentials.gradients(Q)
        J_V = np.concatenate([J, np.swapaxes(V, -1, -2)], axis=1)
        side = self.side * np.sign(np.linalg.det(J_V))
        n, m = self.task.n, self.task.m
        try:
            X = np.linalg.solve(J_V, np.eye(n)[:, m:])
        except np.linalg.LinAlgError:
            return side * self._margin(J, V)
        if n - m == 1:
            return side / (np.linalg.norm(X, axis=(1, 2)) * np.linalg.norm(V, axis=(1, 2)))
        R = np.linalg.qr(V, mode="r")
        sigma = np.linalg.svd(X @ np.swapaxes(R, -1, -2), compute_uv=False)
        return np.asarray(side / sigma[:, 0])

    def _margin(self, J: Array, V: Array) -> Array:
        """Evaluate ``σ_min(Nᵀ V̂)``: (K,)."""
        N = np.linalg.qr(np.swapaxes(J, -1, -2), mode="complete")[0][..., self.task.m :]
        V_hat = np.linalg.qr(V)[0]
        sigma = np.linalg.svd(np.swapaxes(N, -1, -2) @ V_hat, compute_uv=False)
        return np.asarray(sigma[:, -1])


def lowest(measure: Measure, region: Region, starts: Array) -> Lowest:
    """Minimise a measure over Ω from several starts at once, until it is 0 or below, or no step
    helps.

    A step goes down the slope, at most to where the slope would reach 0. Its bound is doubled after
    a step that helped and quartered after one that did not.

    Parameters
    ----------
    measure
        The measure; below 0 only beyond a singularity.
    region
        Ω.
    starts : (S, n) array
        Configurations in Ω.
    """
    scale = region.bounds.half_width
    Q, value = starts.copy(), measure(starts)
    n = Q.shape[1]
    nudge = _DIFFERENCE * np.eye(n) * scale

    def trial(rows: NDArray[np.intp], bound: Array) -> Array:
        here, at = Q[rows], value[rows]
        beside = measure((here[:, None] + nudge).reshape(-1, n)).reshape(-1, n)
        slope = (beside - at[:, None]) / _DIFFERENCE  # (S, n)
        ahead = region.clip(here - _FEELER * slope * scale / _length(slope)[:, None])
        down = (ahead - here) / (_FEELER * scale)  # the part of the way down that stays in Ω
        steepness = np.maximum(-np.sum(down * slope, axis=1) / _length(down), 1e-12)
        length = np.minimum(bound, 1.01 * at / steepness)
        return region.clip(here + (length / _length(down))[:, None] * down * scale)

    def evaluate(rows: NDArray[np.intp], points: Array) -> tuple[Array, NDArray[np.bool_]]:
        return measure(points), region.ratio(points) <= 1 + _EDGE

    descend_in_box(Q, value, trial, evaluate, _LENGTHS, enough=0.0)
    if isinstance(measure, Dexterity) and value.min() > 0:
        ends = Q.copy()
        for _ in range(_NEWTON):
            step = measure.newton(ends, scale)
            ends = region.clip(ends + scale * step * np.minimum(1.0, 0.5 / _length(step))[:, None])
            found = measure(ends)
            better = (found < value) & (region.ratio(ends) <= 1 + _EDGE)
            Q[better], value[better] = ends[better], found[better]
            if value.min() <= 0:
                break
    worst = int(np.argmin(value))
    return Lowest(float(value[worst]), Q[worst], Q, value)


def search(measure: Measure, region: Region, Q: Array, values: Array | None = None) -> Lowest:
    """Search Ω for the smallest value of a measure, from the worst of the points Q, of corners, and
    others.

    A polynomial fitted to few nodes bends most at the corners, where no random point of many joints
    comes near."""
    values = measure(Q) if values is None else values
    corners = _corners(region, Q)
    Q, values = np.concatenate([Q, corners]), np.concatenate([values, measure(corners)])
    order = np.argsort(values)
    others = order[np.linspace(0, len(order) - 1, _STARTS // 4).astype(int)]
    starts = Q[np.unique(np.concatenate([order[: _STARTS - len(others)], others]))]
    return lowest(measure, region, starts)


def _corners(region: Region, Q: Array) -> Array:
    """Push some of the points Q (K, n) along random diagonals to the edge of Ω."""
    rng, start = np.random.default_rng(0), np.resize(Q, (_CORNERS, Q.shape[1]))
    way = 2 * rng.integers(2, size=start.shape) - 1
    far = np.where(np.arange(_CORNERS) % 2, 0.1, 2.0)[:, None]  # a tube's edge may be near
    pushed = region.clip(start + far * way * region.bounds.half_width)
    return pushed[region.ratio(pushed) <= 1 + _EDGE]


def largest_free(measure: Measure, region: Region, bad: Array) -> Region | None:
    """Find the largest region with the center and shape of Ω in which a measure is above its floor.

    The floor is 0 for singularities of the arm, and 0.1 for a leaf margin. The first crossings on
    the lines from known singularities to the center bound the size from above. Then the size is
    bisected, with a new search of each region.

    Parameters
    ----------
    measure, region
        The measure, and Ω.
    bad : (B, n) array
        Points of Ω where the measure is below its floor.

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
    """Make the error that names the first of the points (B, n) and the largest region without them.

    ``what`` begins the message: "the Jacobian loses rank in Ω".
    """
    at, largest = bad[0], largest_free(measure, region, bad)
    where = f"{what} near {named(task, at)}"
    if largest is None:
        return SingularRegionError(
            f"{where}; the centre of the region is singular, or nearly so",
            at,
            None,
            "choose another, or a smaller region",
        )
    free = "singularity-free region with the same centre"
    if isinstance(measure, LeafMargin):
        free = f"region with the same centre and a leaf margin of at least {SHRUNK_MARGIN:g}"
    found = f"{where}; the largest {free} is a {largest}"
    return SingularRegionError(found, at, largest, "use shrink=True to design there")


def _length(vectors: Array) -> Array:
    return np.maximum(np.linalg.norm(vectors, axis=1), 1e-12)
