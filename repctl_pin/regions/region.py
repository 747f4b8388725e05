"""Design regions Ω of joint space: base class, Sobol points and densities.

Nodes are the configurations at which a design evaluates its cost; a weighted sum over the nodes
approximates the mean over Ω. A density gives some configurations more weight than others. Letters:
n joints; Q (K, n), K configurations, rad (m for prismatic joints).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import MOST_NODES, Array, as_configurations, as_int, function
from ..base.errors import InputError
from .sobol import scrambled_points

Density = Callable[[Array], ArrayLike]
"""Function Q (K, n) → (K,): weights ≥ 0 of configurations in the mean over the region."""


_INSIDE = 1e-12
"""Tolerance for rounding errors of :meth:`Region.ratio` on the boundary."""

A_REGION = (
    "a region of joint space, such as rp.Box(q0, 0.3); a user-defined class inherits from "
    "repctl_pin.regions.Region"
)
"""Description of a region, for messages on a wrong argument."""


class Region(ABC):
    """A region Ω of joint space with quadrature nodes: the base class of all regions.

    A subclass has a ``center`` and defines ``bounds``, ``random``, ``ratio``, ``clip`` and
    ``shrunk``. Saved files, generated C code and proofs support only the types of regions of this
    package.

    Attributes
    ----------
    center : (n,) array
        A configuration in the middle of the region.
    density : function or None
        Function Q (K, n) → (K,): weights ≥ 0 of the rows of Q; None if all weights are equal.
    """

    if TYPE_CHECKING:

        @property
        def center(self) -> Array: ...

    density: Density | None = None

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.center)

    @property
    @abstractmethod
    def bounds(self) -> Any:
        """Smallest :class:`Box` around the region."""

    @abstractmethod
    def random(self, count: int, seed: int) -> Array:
        """Draw quasi-random points of the region: (K, n), with K ≥ ``count``.

        The same seed gives the same points. A design evaluates its cost at such points.
        """

    @abstractmethod
    def ratio(self, Q: ArrayLike) -> Array:
        """Compute the scale at which the region's boundary passes through each row of Q: (K,).

        The scale is a factor of all widths of the region: below 1 for a row of Q (K, n) inside,
        above 1 for a row outside Ω, where repeatability is not guaranteed.
        """

    @abstractmethod
    def clip(self, Q: ArrayLike) -> Array:
        """Move the rows of Q (K, n) that lie outside to the boundary, or close to it: (K, n).

        Rows inside are returned unchanged. A search for singularities in the region calls this
        method after each step.
        """

    @abstractmethod
    def shrunk(self, factor: float) -> Region:
        """Create the region with the same centre and all widths multiplied by ``factor``.

        A design calls this method to find a region free of singularities.
        """

    def nodes(self, count: int, seed: int) -> tuple[Array, Array]:
        """Compute quadrature nodes Q (K, n), K ≥ ``count``, and weights (K,), which sum to 1.

        The weighted sum of a function over the nodes approximates its mean over the region. The
        same ``seed`` gives the same nodes.
        """
        Q = self.random(count, seed)
        return Q, self.weights(Q)

    def weights(self, Q: ArrayLike) -> Array:
        """Compute quadrature weights of points Q (K, n) from :meth:`random`: (K,), with sum 1.

        They are proportional to the density.
        """
        Q = as_configurations(Q, self.n, f"this {type(self).__name__}")
        return normalised(evaluate_density(self.density, Q))

    def contains(self, Q: ArrayLike) -> NDArray[np.bool_]:
        """Test whether each row of Q (K, n) lies inside: (K,)."""
        return self.ratio(Q) <= 1 + _INSIDE

    def __str__(self) -> str:
        return f"region of {self.n} joints"

    def __repr__(self) -> str:
        name = type(self).__name__
        return f"<{name} {str(self).removeprefix(f'{name.lower()} ')}>"


def span(widths: Array, sign: str = "") -> str:
    """Format widths (n,) as text: the smallest and the largest, or one number if they are equal.

    ``sign`` is written before each number, as in ``±0.2 to ±0.5``.
    """
    return " to ".join(dict.fromkeys(f"{sign}{w:.3g}" for w in (widths.min(), widths.max())))


def sobol(n: int, count: int, seed: int) -> Array:
    """Draw scrambled Sobol points of the n-dimensional unit cube: (K, n).

    K ≥ ``count`` is a power of two. Sobol points fill the cube more evenly than random points, so
    that a mean needs fewer points. The same ``seed`` gives the same points.
    """
    count = as_int(count, "the number of nodes", 1, MOST_NODES)
    seed = as_int(seed, "seed")
    return scrambled_points(n, int(np.ceil(np.log2(max(count, 2)))), seed)


def check_density(density: Density | None) -> None:
    """Raise InputError unless a density is a function or None."""
    if density is not None:
        function(density, "the density", "a function of Q (K, n) that gives (K,) numbers")


def evaluate_density(density: Density | None, Q: Array) -> Array:
    """Evaluate a user-defined density at the rows of Q (K, n): (K,) finite weights ≥ 0.

    Without a density all weights are 1. InputError is raised if the function fails, or returns
    another shape, a negative number, or one that is not finite.
    """
    if density is None:
        return np.ones(len(Q))
    try:
        values: Any = np.asarray(density(Q), float)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"the density fails at an array Q of shape {Q.shape}: {error}; "
            "give a function of Q (K, n) that returns K numbers"
        ) from error
    if values.shape != (len(Q),):
        raise InputError(
            f"the density returns an array of shape {values.shape} for {len(Q)} configurations; "
            f"return one number per configuration, ({len(Q)},)"
        )
    if not (np.isfinite(values).all() and (values >= 0).all()):
        raise InputError(
            "the density is negative or not finite somewhere in the region; "
            "return finite numbers of at least 0"
        )
    return values


def normalised(weights: Array) -> Array:
    """Scale weights (K,) so that their sum is 1; InputError if all weights are 0."""
    total = float(weights.sum())
    if not total > 0:
        raise InputError(
            "the density is 0 everywhere in the region",
            remedy="use a density above 0 somewhere in the region",
        )
    return weights / total
