"""Is G repeatable in a region? A verdict with the worst defect, where it is, and the tolerance it
was held to."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..arguments import MOST_NODES, Array, as_int, read_only, require_type
from ..errors import InputError, SingularityError
from ..redundancy.inverses import inverse_condition_number
from ..regions import Region
from ..regions.region import A_REGION
from ..strategies.strategy import Inverse
from .derivative import wanted_inverse
from .lie_bracket import measure

_SAFETY = 2.0
_BATCH = 32
_BLIND = 1e-3
_NEAR_SINGULAR = 1e-3


@dataclass(frozen=True, eq=False)
@read_only
class Repeatability:
    """The verdict on an inverse in a region; true in an ``if`` when repeatable.

    Attributes
    ----------
    repeatable : bool
        No defect exceeds its tolerance at any configuration checked.
    defect : float
        The worst relative defect, per rad, free of units and of the task's axes.
    at : (n,) array
        Where it occurs.
    tolerance : float
        The defect that the derivative's error alone could produce there.
    samples : int
        Configurations checked.
    exact : bool
        True if ∂G/∂q is a formula, False if it is taken by differences.
    redundancy : int
        r. An arm without redundancy repeats by itself.
    """

    repeatable: bool
    defect: float
    at: Array = field(repr=False)
    tolerance: float
    samples: int
    exact: bool
    redundancy: int

    def __bool__(self) -> bool:
        return self.repeatable

    def __repr__(self) -> str:
        return f"<Repeatability: {self.summary()}>"

    def summary(self) -> str:
        """Say the verdict in one line."""
        if self.redundancy == 0:
            return "repeatable: r = 0, the task leaves no joint motion free, and a closed path brings every joint back"
        word = "repeatable" if self.repeatable else "not repeatable"
        how = "exact derivative" if self.exact else "differences"
        return (
            f"{word}: worst relative defect {self.defect:.3g} per rad in {self.samples} configurations "
            f"({how}, tolerance {self.tolerance:.1g})"
        )


def is_repeatable(
    strategy: Inverse, region: Region, *, samples: int = 128, seed: int = 0
) -> Repeatability:
    """Test the Lie bracket condition (24) throughout a region.

    The tolerance is not a choice: it is twice the defect that the estimated error of ∂G/∂q could
    produce.

    Parameters
    ----------
    strategy
        Any exact inverse, ``q̇ = G(q) ẋ`` with ``J G = I``.
    region
        Ω, such as a :class:`Box`.
    samples
        Least number of configurations to check.
    seed
        Seed of these configurations.

    Returns
    -------
    Repeatability
        True in an ``if`` when repeatable; with the worst ``defect``, where it occurs, and the
        tolerance.

    Raises
    ------
    InputError
        If the function is too noisy to tell: no defect exceeds the tolerance, but the tolerance
        exceeds 1e-3.
    SingularityError
        If J, or G, is singular at one of the configurations, or nearly so.

    Examples
    --------
    >>> verdict = rp.is_repeatable(control, rp.Box(q0, 0.3))
    >>> bool(verdict)
    False
    >>> bool(rp.is_repeatable(design.inverse, rp.Box(q0, 0.3)))
    True
    """
    Q = points_of(region, strategy, samples, seed)
    found = [measure(strategy, Q[i : i + _BATCH]) for i in range(0, len(Q), _BATCH)]
    norm = np.concatenate([part.norm for part in found])
    tolerance = _SAFETY * np.concatenate([part.error for part in found])
    repeatable = bool((norm <= tolerance).all())
    worst = int(np.argmax(norm if repeatable else np.where(norm > tolerance, norm, -1.0)))
    if repeatable and tolerance.max() > _BLIND:
        blind = int(np.argmax(tolerance))
        ratio = inverse_condition_number(strategy.task.jacobian(Q[blind]))
        if found[0].exact or ratio < _NEAR_SINGULAR:
            raise SingularityError(
                f"near q = ({', '.join(f'{v:.3g}' for v in Q[blind])}) G is too close to a singularity to be judged: "
                f"σ_min / σ_max of J is {ratio:.1g} there; make the region smaller"
            )
        raise InputError(
            f"G is too noisy to judge: its derivative is only known to make defects of {tolerance.max():.2g} visible; "
            "evaluate it more accurately"
        )
    exact = all(part.exact for part in found)
    return Repeatability(
        repeatable,
        float(norm[worst]),
        Q[worst],
        float(tolerance[worst]),
        samples=len(Q),
        exact=exact,
        redundancy=strategy.task.r,
    )


def points_of(region: Region, strategy: Inverse, samples: int, seed: int) -> Array:
    """Take the points of a region at which an inverse is looked at: (K, n), K ≥ samples.

    Raises
    ------
    InputError
        If one is no region or the other no inverse, or they do not fit.
    """
    n = wanted_inverse(strategy).task.n
    require_type(region, Region, "region", A_REGION)
    Q = region.random(as_int(samples, "samples", 1, MOST_NODES), as_int(seed, "seed"))
    if Q.shape[1] != n:
        raise InputError(f"the region has {Q.shape[1]} joints, but the task has {n}")
    return Q
