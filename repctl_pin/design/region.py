"""Ω: the region of joint space over which two inverses are compared; its nodes and weights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import qmc

from ..errors import InputError

Array = NDArray[np.float64]


class Region(Protocol):
    """A region of joint space with quadrature nodes."""

    @property
    def center(self) -> Array:
        """A configuration in the middle of it: (n,)."""
        ...

    def nodes(self, count: int, seed: int) -> tuple[Array, Array]:
        """Quadrature nodes Q (K, n), K ≥ count, and weights (K,) that sum to 1."""
        ...

    def random(self, count: int, seed: int) -> Array:
        """Quasi-random points (count, n), another set for every seed: nodes to judge on."""
        ...


@dataclass(frozen=True)
class Box:
    """A box in joint space, ``|q_i − center_i| ≤ half_width_i``.

    Nodes are a Gauss–Legendre grid for n ≤ 3, scrambled Sobol points above.

    Parameters
    ----------
    center : (n,) array
        rad or m.
    half_width : float or (n,) array
        The same for every joint, or one a joint.

    Raises
    ------
    InputError
        If a number is not finite or a half-width not positive.
    """

    center: Array
    half_width: Array

    def __init__(self, center: ArrayLike, half_width: ArrayLike) -> None:
        try:
            middle = np.array(center, dtype=float)
            half = np.array(np.broadcast_to(np.asarray(half_width, float), middle.shape))
        except (TypeError, ValueError):
            raise InputError("a box needs a center (n numbers) and a half-width (one number, or n)") from None
        if middle.ndim != 1 or middle.size == 0 or not np.isfinite(middle).all():
            raise InputError("the center of a box must be a list of finite numbers")
        if not (np.isfinite(half).all() and (half > 0).all()):
            raise InputError("the half-widths of a box must be above 0 and finite")
        middle.setflags(write=False)
        half.setflags(write=False)
        object.__setattr__(self, "center", middle)
        object.__setattr__(self, "half_width", half)

    @classmethod
    def between(cls, lower: ArrayLike, upper: ArrayLike) -> Box:
        """Make the box between two opposite corners."""
        low, high = np.asarray(lower, float), np.asarray(upper, float)
        if low.shape != high.shape or not (low < high).all():
            raise InputError("a box needs lower < upper for every joint")
        return cls((low + high) / 2, (high - low) / 2)

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

    def nodes(self, count: int, seed: int) -> tuple[Array, Array]:
        """Quadrature nodes Q (K, n), K ≥ count, and weights (K,) that sum to 1."""
        if self.n > 3:
            Q = self.random(count, seed)
            return Q, np.full(len(Q), 1 / len(Q))
        x, w = np.polynomial.legendre.leggauss(max(2, int(np.ceil(count ** (1 / self.n)))))
        grid = np.stack(np.meshgrid(*[x] * self.n, indexing="ij"), -1).reshape(-1, self.n)
        weights = np.prod(np.stack(np.meshgrid(*[w / 2] * self.n, indexing="ij"), -1).reshape(-1, self.n), axis=1)
        return self.center + self.half_width * grid, weights

    def random(self, count: int, seed: int) -> Array:
        """Scrambled Sobol points (K, n), K the power of two from count up."""
        points = qmc.Sobol(self.n, scramble=True, rng=seed).random_base2(int(np.ceil(np.log2(max(count, 2)))))
        return self.center + self.half_width * (2 * points - 1)

    def contains(self, Q: ArrayLike) -> NDArray[np.bool_]:
        """Say which rows of Q (K, n) lie inside."""
        return (np.abs(np.asarray(Q, float) - self.center) <= self.half_width * (1 + 1e-12)).all(-1)

    def shrunk(self, factor: float) -> Box:
        """Make the box of the same center and a fraction of the width."""
        return Box(self.center, self.half_width * factor)
