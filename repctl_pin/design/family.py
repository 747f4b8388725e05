"""Nearest member of a one-parameter family of inverses to a desired inverse.

The criterion is ``C = mean over Ω of ‖G − G_d‖_F²`` (26), minimised over one number k, as in the
paper's family (60)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..arguments import MOST_NODES, Array, as_int, function, limits, read_only, require_type, shown
from ..blas import one_blas_thread
from ..errors import InputError, SingularityError
from ..regions import Region
from ..regions.region import A_REGION
from ..strategies.strategy import AN_INVERSE, Batched, Inverse

_SCAN = 48
_FLAT = 1e-9
"""Relative variation of the cost below which it is the same for every parameter."""

_SAME = 1e-14
"""Relative difference of costs that is rounding."""


@dataclass(frozen=True, eq=False)
@read_only
class FamilyDesign:
    """Best member of a family, and whether it is unique.

    Attributes
    ----------
    inverse : Inverse
        ``family(parameter)``.
    desired : Inverse
        Desired inverse G_d.
    region : Region
        Ω.
    parameter : float
        Best k; may be inf on the whole line. The middle of the bounds if every k costs the same.
    unique : bool
        False if every parameter costs the same.
    cost, cost_error : float
        Mean over Ω of ‖G − G_d‖_F² (26), on finer nodes than those of the search, and the
        difference between both.
    relative_distance : float
        ``sqrt(cost / mean ‖G_d‖_F²)``.
    scanned : (S,) array
        Parameters of the first scan; inf among them on the whole line.
    scanned_costs : (S,) array
        Their costs; inf if a member is singular in Ω.

    Examples
    --------
    >>> from repctl_pin.design import nearest_in_family
    >>> def tilted(k):
    ...     return rp.RepeatableInverse(task, rp.Polynomial(q0, 1).weighted([[1.0], [k], [1.0]]))
    ...
    >>> bounds = (-3.0, 0.0)
    >>> found = nearest_in_family(control, tilted, rp.Box(q0, 0.2), bounds=bounds, samples=256)
    >>> -3 < found.parameter < 0, found.cost > 0
    (True, True)
    """

    inverse: Inverse
    desired: Inverse
    region: Region
    parameter: float
    unique: bool
    cost: float
    cost_error: float
    relative_distance: float
    scanned: Array = field(repr=False)
    scanned_costs: Array = field(repr=False)

    def summary(self) -> str:
        """Write the figures, one per line."""
        best = (
            f"{self.parameter:.6g}"
            if self.unique
            else "every value: the cost does not depend on it"
        )
        task = self.desired.task
        return (
            f"nearest member of a family of inverses for {task.robot.name} {task}\n"
            f"  parameter          {best}\n"
            f"  mean ‖G − G_d‖²    {self.cost:.6g} ± {self.cost_error:.1g}\n"
            f"  relative distance  {self.relative_distance:.1%}"
        )


class _Comparison:
    """Nodes of Ω with J and G_d, for the cost of many inverses."""

    def __init__(self, desired: Inverse, region: Region, samples: int, seed: int) -> None:
        self.Q, self.weights = region.nodes(samples, seed)
        self.J = desired.task.jacobians(self.Q)
        self.G_d = desired.batch(self.Q, self.J)
        self.scale = float(self.weights @ np.sum(self.G_d**2, axis=(1, 2)))

    def cost(self, inverse: Inverse) -> float:
        """Evaluate ``mean ‖G − G_d‖_F²`` (26)."""
        difference = inverse.batch(self.Q, self.J) - self.G_d
        return float(self.weights @ np.sum(difference**2, axis=(1, 2)))


@one_blas_thread()
def nearest_in_family(
    desired: Inverse,
    family: Callable[[float], Inverse],
    region: Region,
    *,
    bounds: tuple[float, float] = (-np.inf, np.inf),
    samples: int = 4096,
    seed: int = 0,
) -> FamilyDesign:
    """Find the member of a one-parameter family nearest to a desired inverse (26).

    On the whole line the search runs over ``φ = atan k`` (57), so that k = ∞, where −∞ and ∞ meet,
    is a member like any other: a scan of φ, then Brent's method in the best bracket.

    Parameters
    ----------
    desired
        Desired inverse G_d, any inverse with ``J G = I``.
    family
        ``k → G``: a function that makes an inverse of the same task for every k within the bounds,
        and for k = ∞ on the whole line, such as ``lambda k: rp.RepeatableInverse(task,
        potentials.weighted(A(k)))``.
    region
        Ω.
    bounds
        Range of k: two finite numbers, or the whole line.
    samples, seed
        Number of nodes of the search, and random seed.

    Returns
    -------
    FamilyDesign
        The best k, its inverse and its cost.

    Raises
    ------
    InputError
        If the bounds are neither finite and in order nor the whole line.
    SingularityError
        If no member of the family is free of singularities in Ω.

    Examples
    --------
    >>> from repctl_pin.design import nearest_in_family
    >>> def tilted(k):
    ...     return rp.RepeatableInverse(task, rp.Polynomial(q0, 1).weighted([[1.0], [k], [1.0]]))
    ...
    >>> bounds = (-3.0, 0.0)
    >>> found = nearest_in_family(control, tilted, rp.Box(q0, 0.2), bounds=bounds, samples=256)
    >>> found.unique
    True
    """
    require_type(desired, Batched, "desired", AN_INVERSE)
    require_type(region, Region, "region", A_REGION)
    function(family, "family", "a function k → inverse")
    samples, seed = as_int(samples, "samples", 1, MOST_NODES), as_int(seed, "seed")
    low, high = limits(bounds, 2, "bounds", "the smallest and the largest k")
    projective = low == -np.inf and high == np.inf
    if not projective and not (np.isfinite([low, high]).all() and low < high):
        raise InputError(
            f"bounds must be two finite numbers in order, or the whole line, not {shown(bounds)}"
        )
    if projective:
        low, high = -np.pi / 2, np.pi / 2

    parameter = _on_the_line if projective else float
    nodes = _Comparison(desired, region, samples, seed)

    def member(k: float) -> Inverse:
        made = family(k)
        require_type(made, Batched, f"the family at k = {k:g}", AN_INVERSE)
        return made

    def cost(angle: float) -> float:
        try:
            return nodes.cost(member(parameter(angle)))
        except SingularityError:
            return np.inf

    angles = np.linspace(low, high, _SCAN + 1)
    costs = np.array([cost(a) for a in angles])
    if not np.isfinite(costs).any():
        raise SingularityError(
            "no member of this family is free of singularities in Ω; make the region smaller"
        )
    comparison = _Comparison(desired, region, 8 * len(nodes.Q), seed + 1)
    spread = np.ptp(costs) if np.isfinite(costs).all() else np.inf
    unique = bool(spread > _FLAT * max(float(costs.mean()), 1e-15 * nodes.scale))
    if unique and np.isfinite(spread):
        # A variation that the finer nodes do not confirm is quadrature error of the search.
        worst, least = (
            comparison.cost(member(parameter(angles[i])))
            for i in (np.argmax(costs), np.argmin(costs))
        )
        unique = bool(worst - least > spread / 2)
    best = _polish(cost, angles, costs, projective) if unique else (low + high) / 2

    inverse = member(parameter(best))
    value = comparison.cost(inverse)
    scanned = np.array([parameter(a) for a in angles])
    away, error = float(np.sqrt(value / comparison.scale)), abs(value - nodes.cost(inverse))
    return FamilyDesign(
        inverse,
        desired,
        region,
        parameter(best),
        unique,
        cost=value,
        cost_error=error,
        relative_distance=away,
        scanned=scanned,
        scanned_costs=costs,
    )


def _on_the_line(angle: float) -> float:
    """Turn φ into k = tan φ (57): one period of tan; its pole is k = ∞."""
    folded = (angle + np.pi / 2) % np.pi - np.pi / 2
    return np.inf if abs(abs(folded) - np.pi / 2) < 1e-12 else float(np.tan(folded))


def _polish(cost: Callable[[float], float], angles: Array, costs: Array, projective: bool) -> float:
    """Refine the best of a scan; keep the scanned value if the refined one costs no less."""
    i = int(np.argmin(costs))
    spacing = angles[1] - angles[0]
    low, high = angles[i] - spacing, angles[i] + spacing
    if not projective:
        low, high = max(low, angles[0]), min(high, angles[-1])
    from scipy.optimize import minimize_scalar  # slow to import

    found = minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 1e-10})
    return float(angles[i]) if costs[i] <= found.fun + _SAME * abs(found.fun) else float(found.x)
