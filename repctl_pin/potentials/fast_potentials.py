"""Allocation-free potentials for control loops, see :mod:`repctl_pin.strategies.fast_loop`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from scipy.linalg.blas import ddot, dgemv

from ..arguments import Array
from .basis import Potentials

MOST_ENTRIES = 50_000
"""Maximum number of entries of a dense tensor; for more, Horner's rule is faster and smaller."""


InPlace: TypeAlias = tuple[Callable[[Array], None], Callable[[Array], None]]
"""Two functions, for one thread: ``slope(q)`` writes Vᵀ = ∂h/∂q, and ``gap(c)`` writes c − h, with
h at the q of the last call of ``slope``."""


def in_place(potentials: Potentials, V_T: Array, e: Array) -> InPlace:
    """Create functions that write Vᵀ into V_T (r, n), and c − h into e (r,).

    Potentials with a method ``in_place`` (V_T, e) create them; for all others, :func:`plain` does.
    """
    own = getattr(potentials, "in_place", None)
    return plain(potentials, V_T, e) if own is None else own(V_T, e)


def plain(potentials: Potentials, V_T: Array, e: Array) -> InPlace:
    """Create functions that write the ``gradient`` and ``value`` of any potentials into arrays."""
    here = np.zeros(V_T.shape[1])

    def slope(q: Array) -> None:
        here[:] = q
        with np.errstate(
            over="ignore", invalid="ignore"
        ):  # the solve tests for what is not finite
            V_T[:] = potentials.gradient(here).T

    def gap(leaf: Array) -> None:
        with np.errstate(over="ignore", invalid="ignore"):
            np.subtract(leaf, potentials.value(here), e)

    return slope, gap


def spread_evenly(S: Array, places: Sequence[int], coefficient: Array) -> None:
    """Add a monomial's coefficients (r,) to r symmetric tensors S (r, …).

    The monomial's index tuple is ``places``. Each distinct order of it gets an equal part.
    """
    arrangements = _orders(tuple(places))
    for place in arrangements:
        at: tuple[Any, ...] = (slice(None), *place)
        S[at] += coefficient / len(arrangements)


def _orders(places: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Return all distinct orders of the entries of a tuple, which may repeat."""
    if len(places) <= 1:
        return [places]
    return [
        (first, *rest)
        for i, first in enumerate(places)
        if first not in places[:i]
        for rest in _orders(places[:i] + places[i + 1 :])
    ]


class Homogeneous:
    """r polynomials of degree d as symmetric tensors of the n + 1 numbers ``z = (1, q − center)``.

    ``h(q) = S[z, …, z]``, and by Euler's theorem the contraction ``w = d S[·, z, …, z]`` holds both
    the gradient, ``V_i = w_i``, and the value, ``h = w · z / d``: d − 1 matrix–vector products for
    the two.

    Parameters
    ----------
    center, scale : (n,) arrays
        Centre and scale of the coordinates ``u = (q − center) / scale`` of ``terms``.
    degree : int
        Degree d, which must be small: a tensor has (n + 1)ᵈ entries.
    terms
        Coefficients (r,) of the monomials of u, by the exponents of the monomials.
    """

    def __init__(
        self,
        center: Array,
        scale: Array,
        degree: int,
        terms: dict[tuple[int, ...], Array],
    ) -> None:
        n, r = len(center), len(next(iter(terms.values())))
        S = np.zeros((r, *(n + 1,) * degree))
        for beta, coefficient in terms.items():
            places = [i + 1 for i, power in enumerate(beta) for _ in range(power)]
            spread_evenly(
                S,
                [0] * (degree - len(places)) + places,
                coefficient / np.prod(scale ** np.array(beta)),
            )
        self.center, self.degree, self.n, self.r = center, degree, n, r
        self.tensor = np.ascontiguousarray(
            (degree * S).reshape(r * (n + 1) ** (degree - 1), n + 1)
        )

    def value(self, q: Array) -> Array:
        """Evaluate h(q): (r,)."""
        w, z = self._contraction(q)
        return w.dot(z) / self.degree

    def gradient(self, q: Array) -> Array:
        """Evaluate V = ∂hᵀ/∂q: (n, r)."""
        return self._contraction(q)[0][:, 1:].T.copy()

    def _contraction(self, q: Array) -> tuple[Array, Array]:
        """Evaluate w (r, n + 1) and z (n + 1,) at q."""
        z = np.ones(self.n + 1)
        np.subtract(q, self.center, z[1:])
        w = self.tensor
        for _ in range(self.degree - 1):
            w = w.dot(z).reshape(-1, self.n + 1)
        return w, z

    def in_place(self, V_T: Array, e: Array) -> InPlace:
        """Create functions that write Vᵀ into V_T (r, n), and c − h into e (r,)."""
        z = np.ones(self.n + 1)
        u, center, subtract, degree = (
            z[1:],
            self.center,
            np.subtract,
            float(self.degree),
        )
        stages = []
        w = self.tensor
        while len(w) > self.r:
            out = np.empty(len(w))
            stages.append((w.T, out))
            w = out.reshape(-1, self.n + 1)
        slopes, rows = w[:, 1:], list(enumerate(w))

        def slope(q: Array) -> None:
            subtract(q, center, u)
            for S_T, out in stages:
                dgemv(1.0, S_T, z, 0.0, out, 0, 1, 0, 1, 1, 1)  # out = S z, in place
            V_T[:] = slopes

        def gap(leaf: Array) -> None:
            for i, row in rows:
                e[i] = leaf.item(i) - ddot(row, z) / degree

        return slope, gap
