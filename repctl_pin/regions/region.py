"""Regions Ω of joint space: their base class, Sobol points, densities."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import MOST_NODES, Array, as_configurations, as_int, function
from ..errors import InputError
from .sobol import scrambled_points

Density = Callable[[Array], ArrayLike]
"""Weights of the rows of Q (K, n) in the mean over the region: (K,) numbers from 0 up."""


_INSIDE = 1e-12
"""Rounding of :meth:`Region.ratio` on the boundary."""

A_REGION = (
    "a region of joint space, such as rp.Box(q0, 0.3); a user-defined class inherits from "
    "repctl_pin.regions.Region"
)
"""Remedy where a region is required."""


class Region(ABC):
    """A region Ω of joint space with quadrature nodes: the base class of all regions.

    A subclass has a ``center`` and defines ``bounds``, ``random``, ``ratio``, ``clip`` and
    ``shrunk``. Files, generated C and proofs know regions by type: ``saving/schema.py``,
    ``codegen/source.py`` and ``proof/regions.py``.

    Attributes
    ----------
    center : (n,) array
        A configuration in the middle of the region.
    density : function or None
        Q (K, n) → (K,) weights from 0 up; None counts every configuration the same.
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
        """Draw quasi-random points (K, n), K ≥ count, another set for each seed."""

    @abstractmethod
    def ratio(self, Q: ArrayLike) -> Array:
        """Factor by which the region would have to be scaled for each row of Q to lie on its
        boundary: (K,); above 1 is outside."""

    @abstractmethod
    def clip(self, Q: ArrayLike) -> Array:
        """Move points (K, n) that lie outside to the boundary."""

    @abstractmethod
    def shrunk(self, factor: float) -> Region:
        """Make the region with the same center and a fraction of the width."""

    def nodes(self, count: int, seed: int) -> tuple[Array, Array]:
        """Quadrature nodes Q (K, n), K ≥ count, and weights (K,), summing to 1."""
        Q = self.random(count, seed)
        return Q, self.weights(Q)

    def weights(self, Q: ArrayLike) -> Array:
        """Quadrature weights of the points from :meth:`random`: (K,), summing to 1."""
        Q = as_configurations(Q, self.n, f"this {type(self).__name__}")
        return normalised(evaluate_density(self.density, Q))

    def contains(self, Q: ArrayLike) -> NDArray[np.bool_]:
        """Whether each row of Q (K, n) lies inside: (K,)."""
        return self.ratio(Q) <= 1 + _INSIDE


def span(widths: Array, sign: str = "") -> str:
    """Write the smallest and the largest of several widths, or one number if they are equal."""
    return " to ".join(dict.fromkeys(f"{sign}{w:.3g}" for w in (widths.min(), widths.max())))


def sobol(n: int, count: int, seed: int) -> Array:
    """Draw scrambled Sobol points of the unit cube: (K, n), K the power of two from count up."""
    count, seed = as_int(count, "the number of nodes", 1, MOST_NODES), as_int(seed, "seed")
    return scrambled_points(n, int(np.ceil(np.log2(max(count, 2)))), seed)


def check_density(density: Density | None) -> None:
    """Refuse a density that is not a function."""
    if density is not None:
        function(density, "the density", "a function of Q (K, n) that gives (K,) numbers")


def evaluate_density(density: Density | None, Q: Array) -> Array:
    """Evaluate a user-defined density: (K,) finite numbers from 0 up."""
    if density is None:
        return np.ones(len(Q))
    try:
        values: Any = np.asarray(density(Q), float)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"the density must be a function of Q (K, n) that gives (K,) numbers: {error}"
        ) from error
    if values.shape != (len(Q),):
        raise InputError(
            f"the density must give one number per row of Q, ({len(Q)},), not {values.shape}"
        )
    if not (np.isfinite(values).all() and (values >= 0).all()):
        raise InputError("the density must be finite and 0 or more everywhere in the region")
    return values


def normalised(weights: Array) -> Array:
    """Scale weights to sum 1."""
    total = float(weights.sum())
    if not total > 0:
        raise InputError("the density is 0 everywhere in the region")
    return weights / total
