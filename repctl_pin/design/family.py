"""Nearest member of a one-parameter family of inverses to a desired inverse.

The criterion is ``C = mean over Ω of ‖G − G_d‖_F²`` (26), minimised over one number k, as in the
paper's family (60)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..arguments import (
    MOST_NODES,
    Array,
    as_int,
    function,
    limits,
    percentage,
    read_only,
    require_type,
    shown,
)
from ..blas import one_blas_thread
from ..errors import InputError, SingularityError
from ..regions import Region
from ..regions.region import A_REGION
from ..strategies.strategy import AN_INVERSE, Inverse

_SCAN = 48
_FLAT = 1e-9
"""Relative variation of the cost over all k below which the cost counts as independent of k."""

_SAME = 1e-14
"""Relative difference below which two costs count as equal, because of rounding errors."""


@dataclass(frozen=True, eq=False)
@read_only
class FamilyDesign:
    """Member of a one-parameter family of inverses nearest to G_d, and whether it is unique.

    Attributes
    ----------
    inverse : Inverse
        ``family(parameter)``.
    desired : Inverse
        Desired inverse G_d.
    region : Region
        Ω.
    parameter : float
        Best k; may be inf if the bounds are the whole line. If the cost does not depend on k, the
        middle of the bounds.
    unique : bool
        False if the cost does not depend on k.
    cost, cost_error : float
        Mean over Ω of ‖G − G_d‖_F² (26), on eight times as many nodes as in the search, and the
        absolute difference from the mean on the nodes of the search.
    relative_distance : float
        ``sqrt(cost / mean ‖G_d‖_F²)``.
    scanned : (S,) array
        Values of k in the first scan; they include inf if the bounds are the whole line.
    scanned_costs : (S,) array
        Cost of each of them; inf if the inverse is singular in Ω.

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
        """Return the figures as text, one per line."""
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
            f"  relative distance  {percentage(self.relative_distance)}"
        )


class _Comparison:
    """Nodes of Ω with J and G_d, on which the cost of any inverse of the task can be evaluated."""

    def __init__(
        self, desired: Inverse, region: Region, samples: int, seed: int
    ) -> None:
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

    The search is a scan of k, then Brent's method around the best value. If the bounds are the
    whole line, the search variable is ``φ = atan k`` (57), so that k = ±∞ is included.

    Parameters
    ----------
    desired
        Desired inverse G_d, any inverse with ``J G = I``.
    family
        ``k → G``: a function that makes an inverse of the same task for every k within the bounds,
        and for k = ∞ on the whole line, such as ``lambda k: rp.RepeatableInverse(task,
        potentials.weighted(A(k)))``.
    region
        Region Ω.
    bounds
        Range of k: two finite numbers, or the whole line (−∞, ∞).
    samples, seed
        Number of nodes for the search, and random seed.

    Returns
    -------
    FamilyDesign
        The best k, its inverse and its cost.

    Raises
    ------
    InputError
        If the bounds are neither two finite numbers in rising order nor the whole line.
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
    require_type(desired, Inverse, "desired", AN_INVERSE)
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
        require_type(made, Inverse, f"the family at k = {k:g}", AN_INVERSE)
        return made

    def cost(angle: float) -> float:
        try:
            return nodes.cost(member(parameter(angle)))
        except SingularityError:
            return np.inf

    angles = np.linspace(low, high, _SCAN + 1)
    costs = np.array([cost(a) for a in angles])
    regular = costs[np.isfinite(costs)]
    if not len(regular):
        raise SingularityError(
            "no member of this family is free of singularities in Ω; make the region smaller"
        )
    comparison = _Comparison(desired, region, 8 * len(nodes.Q), seed + 1)
    spread = np.ptp(costs) if len(regular) == len(costs) else np.inf
    unique = bool(spread > _FLAT * max(float(regular.mean()), 1e-15 * nodes.scale))
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
    away, error = (
        float(np.sqrt(value / comparison.scale)),
        abs(value - nodes.cost(inverse)),
    )
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
    """Convert an angle φ, rad, to k = tan φ (57); at the pole φ = ±π/2, k = ∞."""
    return np.inf if abs(np.cos(angle)) < 1e-12 else float(np.tan(angle))


def _polish(
    cost: Callable[[float], float], angles: Array, costs: Array, projective: bool
) -> float:
    """Refine the best angle of a scan by Brent's method, and return it.

    ``projective`` means that the angles cover a full period. The scanned angle is returned if the
    refined one does not lower the cost.
    """
    i = int(np.argmin(costs))
    spacing = angles[1] - angles[0]
    low, high = angles[i] - spacing, angles[i] + spacing
    if not projective:
        low, high = max(low, angles[0]), min(high, angles[-1])
    from scipy.optimize import minimize_scalar  # slow to import

    found = minimize_scalar(
        cost, bounds=(low, high), method="bounded", options={"xatol": 1e-10}
    )
    return float(angles[i]) if costs[i] <= (1 + _SAME) * found.fun else float(found.x)
