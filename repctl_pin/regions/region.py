"""Ω: the region of joint space over which two inverses are compared; its nodes and weights."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from ..arguments import Array
from .box import Box


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
        """By what factor Ω would have to shrink for each row of Q to lie on its edge: (K,); above 1 is outside."""

    def clip(self, Q: Array) -> Array:
        """Move points that have left Ω back to its edge: (K, n)."""

    def shrunk(self, factor: float) -> Region:
        """Make the region of the same center and a fraction of the width."""
