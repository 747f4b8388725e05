"""What a region Ω offers, a box in joint space, and the quadrature every region shares: Sobol
points, densities."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import (
    MOST_NODES,
    Array,
    as_configurations,
    as_int,
    freeze,
    function,
    limits,
    per_joint,
    positive,
    vector,
)
from ..errors import InputError
from .sobol import scrambled_points

Density = Callable[[Array], ArrayLike]
"""A weight for every row of Q (K, n): (K,) numbers from 0 up. Where it is larger, closeness matters
more."""


@runtime_checkable
class Region(Protocol):
    """A region of joint space with quadrature nodes."""

    @property
    def center(self) -> Array:
        """A configuration in the middle of it: (n,)."""

    @property
    def bounds(self) -> Box:
        """The box around it."""

    def nodes(self, count: int, seed: int) -> tuple[Array, Array]:
        """Quadrature nodes Q (K, n), K ≥ count, and weights (K,) that sum to 1."""

    def random(self, count: int, seed: int) -> Array:
        """Quasi-random points (K, n), K ≥ count, another set for every seed: nodes to judge on."""

    def weights(self, Q: Array) -> Array:
        """What each of the points of :meth:`random` counts for: (K,), sum 1."""

    def ratio(self, Q: Array) -> Array:
        """Factor by which the region would have to be scaled for each row of Q to lie on its
        boundary: (K,).

        Above 1 is outside.
        """

    def clip(self, Q: Array) -> Array:
        """Move points that have left Ω back to its edge: (K, n)."""

    def shrunk(self, factor: float) -> Region:
        """Make the region of the same center and a fraction of the width."""


@dataclass(frozen=True)
class Box:
    """A box in joint space, ``|q_i − center_i| ≤ half_width_i``.

    Nodes are a Gauss–Legendre grid for n ≤ 3, scrambled Sobol points above.

    Parameters
    ----------
    center : (n,) array
        rad or m.
    half_width : float or (n,) array
        rad (m for sliding joints): the same for every joint, or one per joint.
    density : function, optional
        Q (K, n) → (K,) weights from 0 up; by default every configuration counts the same.

    Raises
    ------
    InputError
        If a number is not finite or a half-width not positive.

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
        """Make the box between two opposite corners."""
        low = vector(lower, None, "the lower corner of a box")
        high = vector(upper, len(low), "the upper corner of a box")
        if not (low < high).all():
            bad = int(np.argmin(low < high))
            raise InputError(
                f"a box needs lower < upper for every joint; joint {bad} goes from {low[bad]:g} to {high[bad]:g}"
            )
        return cls((low + high) / 2, (high - low) / 2, density=density)

    @property
    def lower(self) -> Array:
        """The lower corner (n,)."""
        return self.center - self.half_width

    @property
    def upper(self) -> Array:
        """The upper corner (n,)."""
        return self.center + self.half_width

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.center)

    @property
    def bounds(self) -> Box:
        """The box itself."""
        return self

    def nodes(self, count: int, seed: int) -> tuple[Array, Array]:
        """Quadrature nodes Q (K, n), K ≥ count, and weights (K,) that sum to 1."""
        if self.n > 3:
            Q = self.random(count, seed)
            return Q, self.weights(Q)
        count = as_int(count, "the number of nodes", 1, MOST_NODES)
        x, w = np.polynomial.legendre.leggauss(
            max(2, int(np.ceil(round(count ** (1 / self.n), 9))))
        )
        grid = np.stack(np.meshgrid(*[x] * self.n, indexing="ij"), -1).reshape(-1, self.n)
        weights = np.prod(
            np.stack(np.meshgrid(*[w / 2] * self.n, indexing="ij"), -1).reshape(-1, self.n), axis=1
        )
        Q = self.center + self.half_width * grid
        return Q, weights if self.density is None else normalised(
            weights * evaluate_density(self.density, Q)
        )

    def random(self, count: int, seed: int) -> Array:
        """Scrambled Sobol points (K, n), K the power of two from count up."""
        return self.center + self.half_width * (2 * sobol(self.n, count, seed) - 1)

    def weights(self, Q: Array) -> Array:
        """What each of the points of :meth:`random` counts for: (K,), sum 1."""
        return normalised(evaluate_density(self.density, as_configurations(Q, self.n, "this box")))

    def ratio(self, Q: ArrayLike) -> Array:
        """Factor by which the region would have to be scaled for each row of Q to lie on its
        boundary: (K,).

        Above 1 is outside.
        """
        return (
            np.abs(as_configurations(Q, self.n, "this box") - self.center) / self.half_width
        ).max(-1)

    def contains(self, Q: ArrayLike) -> NDArray[np.bool_]:
        """Say which rows of Q (K, n) lie inside."""
        return self.ratio(Q) <= 1 + 1e-12

    def clip(self, Q: ArrayLike) -> Array:
        """Move points that have left the box back to its faces: (K, n)."""
        return np.clip(as_configurations(Q, self.n, "this box"), self.lower, self.upper)

    def shrunk(self, factor: float) -> Box:
        """Make the box of the same center and a fraction of the width."""
        return Box(
            self.center, self.half_width * positive(factor, "the factor"), density=self.density
        )

    def inside(self, lower: ArrayLike, upper: ArrayLike) -> Box:
        """Cut the box to what lies inside limits, such as ``task.lower`` and ``task.upper``."""
        low, high = (limits(values, self.n, "the limits of this box") for values in (lower, upper))
        return Box.between(
            np.maximum(self.lower, low), np.minimum(self.upper, high), density=self.density
        )

    def __str__(self) -> str:
        centre = ", ".join(f"{c:.3g}" for c in self.center)
        return f"box {span(self.half_width, '±')} round ({centre})"


def span(widths: Array, sign: str = "") -> str:
    """Write the smallest and the largest of some widths; once, where they are the same."""
    return " to ".join(dict.fromkeys(f"{sign}{w:.3g}" for w in (widths.min(), widths.max())))


def sobol(n: int, count: int, seed: int) -> Array:
    """Scrambled Sobol points in the unit cube: (K, n), K the power of two from count up."""
    count, seed = as_int(count, "the number of nodes", 1, MOST_NODES), as_int(seed, "seed")
    return scrambled_points(n, int(np.ceil(np.log2(max(count, 2)))), seed)


def check_density(density: Density | None) -> None:
    """Make sure that a density is a function."""
    if density is not None:
        function(density, "the density", "a function of Q (K, n) that gives (K,) numbers")


def evaluate_density(density: Density | None, Q: Array) -> Array:
    """Evaluate a person's density and check it: (K,) finite numbers from 0 up."""
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
            f"the density must give one number a row of Q, ({len(Q)},), not {values.shape}"
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
