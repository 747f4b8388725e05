"""Repeatability test of an inverse in a region, with the worst defect and its tolerance.

A defect is the joint drift per area of a small loop of the frame, see :mod:`lie_bracket`. The
relative defect at a configuration combines the defects of all directions into one number, per rad,
which does not depend on units and task axes. An argument ``strategy`` is the inverse that is
tested. Letters: n joints, m task coordinates, K configurations.

``Inverse`` is a matrix function G(q) (n, m) with J G = I, evaluated at q (n,) or Q (K, n).
``Region`` is a part Ω of joint space, such as a box.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..base.arguments import MOST_NODES, Array, as_int, read_only, require_type, row
from ..base.errors import InputError, SingularityError
from ..redundancy.inverses import inverse_condition_number
from ..regions import Region
from ..regions.region import A_REGION
from ..strategies.strategy import Inverse
from .derivative import require_inverse
from .lie_bracket import measure

_SAFETY = 2.0
_BATCH = 32
_BLIND = 1e-3
_NEAR_SINGULAR = 1e-3


@dataclass(frozen=True, eq=False)
@read_only
class Repeatability:
    """Result of the repeatability test of an inverse in a region.

    ``bool(result)`` is :attr:`repeatable`.

    Attributes
    ----------
    repeatable : bool
        True if no defect exceeds its tolerance at the configurations checked.
    defect : float
        Maximum relative defect, per rad, at the configurations checked; if the inverse is not
        repeatable, the maximum of those that exceed their tolerance.
    at : (n,) array
        Configuration of this maximum.
    tolerance : float
        Twice the relative defect that the estimated error of ∂G/∂q could produce there.
    samples : int
        Number of configurations checked.
    exact : bool
        True if ∂G/∂q is computed by a formula, False if by differences.
    redundancy : int
        Degree of redundancy r; with r = 0 the only inverse is J⁻¹, which is repeatable.
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
        """Summarise the result in one line."""
        if self.redundancy == 0:
            return "repeatable: r = 0, so the only inverse is J⁻¹"
        word = "repeatable" if self.repeatable else "not repeatable"
        how = "exact derivative" if self.exact else "differences"
        return (
            f"{word}: worst relative defect {self.defect:.3g} per rad "
            f"in {self.samples} configurations ({how}, tolerance {self.tolerance:.1g})"
        )


def is_repeatable(
    strategy: Inverse, region: Region, *, samples: int = 128, seed: int = 0
) -> Repeatability:
    """Test whether an inverse is repeatable in a region, by the Lie bracket condition (24).

    Repeatable means that closed paths end in the configuration they began in. The condition is that
    all defects vanish: the Lie brackets of the columns of G have no part in the null space of J.
    The tolerance is computed, not chosen: it is twice the defect that the estimated error of ∂G/∂q
    could produce.

    Parameters
    ----------
    strategy
        Any exact inverse, ``q̇ = G(q) ẋ`` with ``J G = I``.
    region
        Region Ω, such as a :class:`Box`.
    samples
        Minimum number of configurations to check.
    seed
        Random seed of the configurations.

    Returns
    -------
    Repeatability
        Result whose ``bool()`` is True if the inverse is repeatable, with the worst ``defect``, its
        configuration and the tolerance.

    Raises
    ------
    InputError
        If G is too noisy for a decision: no defect exceeds its tolerance, but a tolerance exceeds
        1e-3 per rad.
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
                f"G cannot be tested near q = {row(Q[blind])}: "
                f"σ_min / σ_max of J is {ratio:.1g} there, too close to a singularity; "
                "use a smaller region"
            )
        raise InputError(
            f"G(q) is too noisy: only relative defects above {tolerance.max():.2g} per rad can be "
            "detected; compute G with smaller rounding errors"
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
    """Sample at least ``samples`` configurations of a region, at which to test an inverse: (K, n).

    The same seed gives the same configurations.

    Raises
    ------
    InputError
        If the region or the inverse has the wrong type, or their numbers of joints differ.
    """
    n = require_inverse(strategy).task.n
    require_type(region, Region, "region", A_REGION)
    Q = region.random(as_int(samples, "samples", 1, MOST_NODES), as_int(seed, "seed"))
    if Q.shape[1] != n:
        raise InputError(
            f"the region has {Q.shape[1]} joints, but the task has {n}",
            remedy=f"give a region of {n} joints, those of the task",
        )
    return Q
