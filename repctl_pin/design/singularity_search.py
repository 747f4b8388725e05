"""Search of a region Ω for singularities of the arm and algorithmic singularities of potentials.

At a singularity of the arm J loses rank. At an algorithmic one the repeatable inverse fails though
J has full rank, because J_V = [J; Vᵀ] loses rank, with V the gradients of the potentials. A design
is valid only in a region without either. A measure is a function of configurations (K, n) → (K,).
It is 0 at a singularity, positive around the centre of Ω, and negative only beyond an algorithmic
singularity. The search minimises a measure. The leaf margin, from 0 to 1, is the distance from an
algorithmic singularity.

``Potentials`` are r functions h(q) that a repeatable controller holds constant. ``Lowest`` is the
smallest value of a measure that a search found, and its configuration; 0 or less is a singularity.
``Dexterity`` is the measure ``σ_min(J) / σ_max(J)``, 0 at a singularity of the arm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import Array, read_only
from ..base.errors import SingularityError
from ..model.native_kinematics import jacobians
from ..model.task import Task
from ..potentials.basis import Potentials
from ..regions import Region
from ..solvers import StepLengths, descend_in_box
from .criterion import named

_Measure = Callable[[Array], Array]
"""Function Q (K, n) → (K,) that measures the distance from a singularity; 0 at a singularity."""

_STARTS = 16
_CORNERS = 256
_ALL = 7
"""Number of joints of which all combinations of ends are corners: 2⁷ is half of 256."""

_LENGTHS = StepLengths(first=0.1, longest=0.5, shortest=1e-5, longer=2.0, shorter=4.0, steps=60)
_DIFFERENCE = 1e-6
_FEELER = 1e-4
"""Length of a trial step down the slope, relative to the half-widths of Ω, that shows which
directions leave Ω."""

_EDGE = 1e-9
"""Tolerance of ``region.ratio(Q) ≤ 1``, the test whether Q lies in the region."""

_NEWTON = 12
_RANK = 1e-5
_BISECTIONS = 12

SEARCHED = 2048
"""Number of random configurations of a region at which a search of it begins."""

SHRUNK_MARGIN = 0.1
"""Minimum leaf margin in a region that is shrunk; close to a singularity, a design is not
usable."""


class SingularRegionError(SingularityError):
    """The design region Ω contains a singularity, so that no design is valid in all of it.

    Attributes
    ----------
    at : (n,) array
        Configuration of the singularity, rad (m for prismatic joints).
    free : Region or None
        Largest region found with the same centre and shape that contains no such singularity. If
        the singularity is an algorithmic one, the leaf margin there is at least 0.1. None if no
        such region was found or searched for.

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
    """Smallest value of a measure that a search of a region found, and its configuration.

    A value of 0 or less means that a singularity was found.

    Attributes
    ----------
    value : float
        Smallest value.
    at : (n,) array
        Configuration of the smallest value.
    ends, values : (S, n), (S,) arrays
        Final configurations of all S local searches, and the values there.
    """

    value: float
    at: Array
    ends: Array
    values: Array


class Dexterity:
    """Measure of the distance from a singularity of the arm: ``σ_min(J) / σ_max(J)``.

    Values of 1e-5 and less are set to 0, because a search rarely hits a singularity exactly.
    """

    def __init__(self, task: Task) -> None:
        self.task = task

    def __call__(self, Q: Array) -> Array:
        """Evaluate σ_min / σ_max of J (K,) at every row of Q (K, n); 0 at a singularity."""
        values = np.linalg.svd(jacobians(self.task, Q), compute_uv=False)
        return np.where(values[:, -1] > _RANK * values[:, 0], values[:, -1] / values[:, 0], 0.0)

    def newton(self, Q: Array, scale: Array) -> Array:
        """Compute the Newton steps from Q (K, n) towards configurations where J loses rank: (K, n).

        A step is in units of ``scale`` (n,), rad or m, and is the shortest one to first order. With
        the singular value decomposition J = X Σ Yᵀ, J loses rank where the n − m + 1 equations
        ``Y₂ᵀ Jᵀ x = 0`` hold; x is the last column of X, Y₂ the columns m, …, n of Y. Where the arm
        is stretched out, σ_min has the shape of a cone, to whose tip gradient descent does not
        converge.
        """
        m = self.task.m
        U, sigma, Vt = np.linalg.svd(jacobians(self.task, Q))
        turned = np.einsum("Kaik,Ka->Kik", self.task.hessians(Q), U[:, :, -1])
        slope = Vt[:, m - 1 :] @ turned
        step: Array = -np.linalg.pinv(slope * scale, rcond=1e-6)[:, :, 0] * sigma[:, -1:]
        return step


class LeafMargin:
    """Signed leaf margin: a measure of the distance from an algorithmic singularity.

    Its absolute value is ``σ_min(Nᵀ V̂)``, with N an orthonormal basis of the null space of J, and
    V̂ the gradients V of the potentials, orthonormalised. The margin is negative where
    ``det [J; Vᵀ]`` has another sign than at ``center`` (n,), so that it changes sign at an
    algorithmic singularity. Where J has full rank, the margin is smooth, also at its zeros, except
    where singular values cross.

    With the QR factorisation ``V = V̂ R`` and the solution X of ``J_V X = [0; I]``, it is computed
    as ``σ_min(Nᵀ V̂) = 1 / σ_max(X Rᵀ)``, because ``X Rᵀ = N (V̂ᵀ N)⁻¹``. It is 0 where J_V is
    exactly singular.
    """

    def __init__(self, task: Task, potentials: Potentials, center: Array) -> None:
        self.task, self.potentials = task, potentials
        J_V, _ = self._augmented(center[None])
        self.side = float(np.sign(np.linalg.det(J_V)).item())

    def __call__(self, Q: Array) -> Array:
        """Evaluate the signed leaf margin (K,) at every row of Q (K, n); 0 at a singularity."""
        J_V, V = self._augmented(Q)
        det = np.linalg.det(J_V)
        margin = np.zeros(len(Q))
        regular = det != 0
        size = self._size(J_V[regular], V[regular])
        margin[regular] = np.where(np.sign(det[regular]) == self.side, size, -size)
        return margin

    def _augmented(self, Q: Array) -> tuple[Array, Array]:
        """Evaluate J_V = [J; Vᵀ] (K, n, n) and the gradients V (K, n, r) at Q (K, n)."""
        J = jacobians(self.task, Q)
        V = self.potentials.gradients(Q)
        return np.concatenate([J, np.swapaxes(V, -1, -2)], axis=1), V

    def _size(self, J_V: Array, V: Array) -> Array:
        """Evaluate ``σ_min(Nᵀ V̂)`` (K,), the leaf margin, from regular J_V (K, n, n) and V."""
        n, m = self.task.n, self.task.m
        X = np.linalg.solve(J_V, np.eye(n)[:, m:])
        if n - m == 1:
            return np.asarray(1 / (np.linalg.norm(X, axis=(1, 2)) * np.linalg.norm(V, axis=(1, 2))))
        R = np.linalg.qr(V, mode="r")
        sigma = np.linalg.svd(X @ np.swapaxes(R, -1, -2), compute_uv=False)
        return np.asarray(1 / sigma[:, 0])


def _lowest(measure: _Measure, region: Region, starts: Array) -> Lowest:
    """Minimise a measure over Ω by S local searches from several starting points at once.

    The searches end when one of them reaches a value of 0 or below, or when no search can lower its
    value. A step goes down the gradient, at most to where the measure would be 0 to first order.
    The bound on the step length is doubled after a step that lowered the measure, and quartered
    after one that did not. If the measure is σ_min(J) / σ_max(J) and no search has reached 0, up to
    12 Newton steps follow, each at most half the half-widths of Ω long.

    Parameters
    ----------
    measure, region
        The measure, and Ω.
    starts : (S, n) array
        Starting configurations in Ω.
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
    if isinstance(measure, Dexterity):
        _newton(measure, region, Q, value)
    worst = int(np.argmin(value))
    return Lowest(float(value[worst]), Q[worst], Q, value)


def _newton(measure: Dexterity, region: Region, Q: Array, value: Array) -> None:
    """Move configurations Q (S, n) by Newton steps towards singularities of the arm, in place.

    ``value`` (S,), the measure at Q, is updated, too. Each step is clipped to ``region``. A row
    changes only if its value falls, and if it stays in ``region``. The steps end when one row has
    reached a singularity, where the value is 0.
    """
    scale = region.bounds.half_width
    ends = Q.copy()
    for _ in range(_NEWTON):
        if value.min() <= 0:
            break
        step = measure.newton(ends, scale)
        ends = region.clip(ends + scale * step * np.minimum(1.0, 0.5 / _length(step))[:, None])
        found = measure(ends)
        better = (found < value) & (region.ratio(ends) <= 1 + _EDGE)
        Q[better], value[better] = ends[better], found[better]


def search(measure: _Measure, region: Region, Q: Array, values: Array | None = None) -> Lowest:
    """Search Ω for the smallest value of a measure, by local searches from up to 16 points.

    Candidates for these points are the configurations Q (K, n), with ``values`` (K,) of the measure
    if known, and configurations near the corners of Ω. The points are the 12 candidates with the
    smallest values, and four more at equal steps of rank from the smallest value to the largest.
    Corners are included because a polynomial fitted to few nodes deviates most there, and random
    points in many dimensions rarely lie close to a corner.
    """
    values = measure(Q) if values is None else values
    corners = _corners(region, Q)
    Q = np.concatenate([Q, corners])
    values = np.concatenate([values, measure(corners)])
    order = np.argsort(values)
    others = order[np.linspace(0, len(order) - 1, _STARTS // 4).astype(int)]
    starts = Q[np.unique(np.concatenate([order[: _STARTS - len(others)], others]))]
    return _lowest(measure, region, starts)


def _corners(region: Region, Q: Array) -> Array:
    """Move configurations Q (K, n) along diagonals of joint space, clipped to Ω.

    A move changes each joint by the same multiple of its half-width in Ω, up or down. In half of
    the moves the multiple is 2, which leads to a corner if Ω is a box. These moves lead to all
    corners for n ≤ 7; for larger n, the directions of the first seven joints take all combinations,
    and the others are random. In the other half, the multiple is 0.1, because a tube is narrow, and
    all directions are random. Return the results that lie in Ω, at most 256 rows.
    """
    rng = np.random.default_rng(0)
    start = np.resize(Q, (_CORNERS, Q.shape[1]))
    far = np.resize([2.0, 0.1], (_CORNERS, 1)) * region.bounds.half_width
    up = rng.integers(2, size=start.shape)
    every = np.arange(_CORNERS // 2)[:, None] >> np.arange(_ALL) & 1
    up[::2, :_ALL] = every[:, : Q.shape[1]]
    pushed = region.clip(start + np.where(up, far, -far))
    return pushed[region.ratio(pushed) <= 1 + _EDGE]


def largest_free(measure: _Measure, region: Region, bad: Array) -> Region | None:
    """Find the largest region with centre and shape of Ω in which a measure exceeds a threshold.

    The threshold is 0 for singularities of the arm, and 0.1 for a leaf margin. On the lines from
    the centre to known singularities, the points below the threshold give an upper bound of the
    size. Then the size is bisected, with a new search of each region. Errors propose the result,
    and ``shrink=True`` designs over it.

    Parameters
    ----------
    measure, region
        The measure, and Ω.
    bad : (B, n) array
        Configurations in Ω where the measure is below the threshold.

    Returns
    -------
    Region or None
        None if the centre itself is singular, or nearly so.
    """
    if isinstance(measure, LeafMargin):
        margin = measure

        def measure(Q: Array) -> Array:
            return margin(Q) - SHRUNK_MARGIN

    share = np.linspace(0, 1, 65)[1:, None, None]
    ray = (region.center + share * (bad[:256] - region.center)).reshape(-1, bad.shape[1])
    high = float(region.ratio(ray)[measure(ray) <= 0].min(initial=1.0))
    low: float = 0.0
    best: Region | None = None
    for step in range(_BISECTIONS):
        # first just below the bound, which is often the answer
        factor = 0.99 * high if step == 0 else (low + high) / 2
        if factor < 0.01:
            return None
        smaller = region.shrunk(factor)
        if search(measure, smaller, smaller.random(SEARCHED, step)).value > 0:
            low, best = factor, smaller
        else:
            high = factor
        if high - low < 0.011 * high:
            break
    return best


def refuse_singular(
    what: str, task: Task, measure: _Measure, region: Region, bad: Array
) -> SingularRegionError:
    """Make the error for a region with singularities at the configurations ``bad`` (B, n).

    The message begins with ``what``, such as "the Jacobian loses rank in Ω". It names the first of
    these configurations, and the largest singularity-free region with the same centre. At ``bad``,
    ``measure`` is at most 0 or, if it is a leaf margin, below 0.1.
    """
    at = bad[0]
    largest = largest_free(measure, region, bad)
    where = f"{what} near {named(task, at)}"
    if largest is None:
        return SingularRegionError(
            f"{where}; the centre of the region is singular, or nearly so",
            at,
            None,
            "choose another region, or a smaller one",
        )
    free = "singularity-free region with the same centre"
    if isinstance(measure, LeafMargin):
        free = f"region with the same centre and a leaf margin of at least {SHRUNK_MARGIN:g}"
    found = f"{where}; the largest {free} is a {largest}"
    return SingularRegionError(
        found, at, largest, "use shrink=True to design in this smaller region"
    )


def _length(vectors: Array) -> Array:
    return np.maximum(np.linalg.norm(vectors, axis=1), 1e-12)
