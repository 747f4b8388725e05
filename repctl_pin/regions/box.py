"""Box in joint space, as a design region Ω.

Quadrature nodes are configurations at which a design evaluates its cost; a weighted sum over them
approximates the mean over Ω. Letters: n joints; Q (K, n), K configurations, rad (m for prismatic
joints).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import (
    MOST_NODES,
    Array,
    as_configurations,
    as_int,
    freeze,
    limits,
    per_joint,
    positive,
    read_only,
    vector,
)
from ..base.errors import InputError
from .region import Density, Region, check_density, evaluate_density, normalised, sobol, span


@dataclass(frozen=True, eq=False, repr=False)
@read_only
class Box(Region):
    """A box in joint space, ``|q_i − center_i| ≤ half_width_i``.

    Quadrature nodes are a Gauss–Legendre grid for n ≤ 3 joints, scrambled Sobol points for more.

    Parameters
    ----------
    center : (n,) array
        Centre, rad or m.
    half_width : float or (n,) array
        Half-widths, rad (m for prismatic joints): one number for all joints, or one per joint.
    density : function, optional
        Function Q (K, n) → (K,): weights ≥ 0 of the rows of Q in the mean over Ω; by default all
        weights are equal.

    Raises
    ------
    InputError
        If a number is not finite, or a half-width is not positive.

    Examples
    --------
    >>> box = rp.Box(q0, 0.4)  # rad to either side
    >>> box.contains([q0, q0 + 0.5])
    array([ True, False])
    >>> rp.Box.between(q0 - 0.1, q0 + 0.3).center
    array([0.4, 0.9, 0.9])
    """

    center: Array
    half_width: Array
    density: Density | None = None

    def __init__(
        self, center: ArrayLike, half_width: ArrayLike, *, density: Density | None = None
    ) -> None:
        middle = vector(center, None, "the center of a box")
        half = per_joint(half_width, len(middle), "the half-widths of a box", finite=True)
        check_density(density)
        freeze(self, center=middle, half_width=half, density=density)

    @classmethod
    def between(cls, lower: ArrayLike, upper: ArrayLike, *, density: Density | None = None) -> Box:
        """Create the box between two opposite corners (n,), such as two lists of joint limits.

        InputError is raised unless lower < upper for every joint. ``density`` is as for the class.
        """
        low = vector(lower, None, "the lower corner of a box")
        high = vector(upper, len(low), "the upper corner of a box")
        if not (low < high).all():
            bad = int(np.argmin(low < high))
            raise InputError(
                f"a box requires lower < upper for every joint, but joint {bad} (counted from 0) "
                f"has lower = {low[bad]:g} and upper = {high[bad]:g}; correct these bounds"
            )
        return cls((low + high) / 2, (high - low) / 2, density=density)

    @property
    def lower(self) -> Array:
        """Lower corner (n,), rad or m."""
        return self.center - self.half_width

    @property
    def upper(self) -> Array:
        """Upper corner (n,), rad or m."""
        return self.center + self.half_width

    @property
    def bounds(self) -> Box:
        """Smallest box around the region: the box itself."""
        return self

    def nodes(self, count: int, seed: int) -> tuple[Array, Array]:
        """Compute quadrature nodes Q (K, n), K ≥ ``count``, and weights (K,), which sum to 1.

        The weighted sum of a function over the nodes approximates its mean over the box. Up to
        three joints the nodes are a Gauss–Legendre grid, which is exact for polynomials of moderate
        degree and does not depend on ``seed``; for more joints they are scrambled Sobol points.
        """
        if self.n > 3:
            return super().nodes(count, seed)
        count = as_int(count, "the number of nodes", 1, MOST_NODES)
        per_joint = max(2, int(np.ceil(round(count ** (1 / self.n), 9))))
        x, w = np.polynomial.legendre.leggauss(per_joint)
        each = np.indices([per_joint] * self.n).reshape(self.n, -1).T  # (K, n)
        weights = np.prod(w[each] / 2, axis=1)
        Q = self.center + self.half_width * x[each]
        if self.density is None:
            return Q, weights
        return Q, normalised(weights * evaluate_density(self.density, Q))

    def random(self, count: int, seed: int) -> Array:
        """Draw scrambled Sobol points in the box: (K, n), with K ≥ ``count`` a power of two.

        Sobol points fill the box more evenly than random points. The same ``seed`` gives the same
        points.
        """
        return self.center + self.half_width * (2 * sobol(self.n, count, seed) - 1)

    def ratio(self, Q: ArrayLike) -> Array:
        """Compute the scale at which the box's boundary passes through each row of Q (K, n): (K,).

        The scale is a factor of the half-widths: below 1 for a row inside, above 1 outside.
        """
        Q = as_configurations(Q, self.n, "this box")
        return (np.abs(Q - self.center) / self.half_width).max(-1)

    def clip(self, Q: ArrayLike) -> Array:
        """Move the rows of Q (K, n) that lie outside to the nearest point of the box: (K, n)."""
        return np.clip(as_configurations(Q, self.n, "this box"), self.lower, self.upper)

    def shrunk(self, factor: float) -> Box:
        """Create the box with the same centre and the half-widths multiplied by ``factor``."""
        return Box(
            self.center, self.half_width * positive(factor, "the factor"), density=self.density
        )

    def inside(self, lower: ArrayLike, upper: ArrayLike) -> Box:
        """Intersect the box with joint limits (n,), such as ``task.lower`` and ``task.upper``.

        A design over the result ignores configurations that the arm cannot reach. InputError is
        raised if the intersection is empty.
        """
        low, high = (limits(values, self.n, "the limits of this box") for values in (lower, upper))
        return Box.between(
            np.maximum(self.lower, low), np.minimum(self.upper, high), density=self.density
        )

    def __str__(self) -> str:
        centre = ", ".join(f"{c:.3g}" for c in self.center)
        return f"box {span(self.half_width, '±')} around ({centre})"
