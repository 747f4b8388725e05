r"""Taylor models: polynomials of degree 3 with a bound of their remainder (Makino and Berz).

A model of f on a box is ``(P, r)`` with ``|f(u_c + h t) − P(t)| ≤ r`` for all t in ``[−1, 1]^k``. r
includes rounding: the error of a sum of up to M products is less than ``(M + 2) u`` times the sum
of absolute values, with ``u = 2⁻⁵³``, and ``_ROUND`` is several times that.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array, read_only
from ...native import SPACE, filled_struct

ORDER = 3
_ROUND = 2e-14
"""Rounding of one operation, relative to the sum of the absolute values of the terms."""

_ENTIRE = 24
"""Number of terms of the power series in :func:`entire`; enough for z below π²."""


@dataclass(frozen=True, eq=False)
@read_only
class Products:
    """Table of the products of two monomials of k variables, up to degree 3.

    Monomials are given by index, of M in all.

    Attributes
    ----------
    left, right : (L,) arrays of int
        The two factors of each product, sorted by the monomial that they make.
    first : (M,) array of int
        Index of the first product that makes each monomial.
    starts : (5,) array of int
        Index of the first monomial of each degree, and M.
    """

    left: NDArray[np.int32]
    right: NDArray[np.int32]
    first: NDArray[np.int32]
    starts: NDArray[np.int32]


@cache
def products(k: int) -> Products:
    """Return the table of products of monomials of k variables, cached."""
    from ..cells.monomials import Monomials  # a study has no need of it

    monomials = Monomials(k, ORDER)
    at = {tuple(row): i for i, row in enumerate(monomials.exponents)}
    rows = [
        (at[tuple(a + b)], i, j)
        for i, a in enumerate(monomials.exponents)
        for j, b in enumerate(monomials.exponents)
        if a.sum() + b.sum() <= ORDER
    ]
    made, left, right = np.array(sorted(rows), np.int32).T
    first = np.searchsorted(made, np.arange(monomials.size)).astype(np.int32)
    return Products(left, right, first, monomials.starts.astype(np.int32))


def space_of(k: int) -> tuple[Any, list[NDArray[np.generic]]]:
    """Create the struct SPACE of models in k variables, and the arrays that it points to."""
    pairs = products(k)
    ints = {name: getattr(pairs, name) for name in ("left", "right", "starts")}
    ints["first"] = np.append(pairs.first, len(pairs.left))
    return filled_struct(SPACE, ints, {}, {"k": k, "M": int(pairs.starts[-1])})


@dataclass(frozen=True, eq=False)
@read_only
class TaylorModel:
    """Taylor models of functions on K boxes.

    They have coefficients P (K, …, M) in k variables, and bounds r (K, …) of the remainder.
    """

    k: int
    P: Array
    r: Array

    @classmethod
    def constant(cls, k: int, values: Array) -> TaylorModel:
        """Create the models of constants (K, …) in k variables."""
        P = np.zeros((*np.shape(values), products(k).starts[-1]))
        P[..., 0] = values
        return cls(k, P, np.zeros(np.shape(values)))

    @property
    def norms(self) -> Array:
        """Sums of the absolute values of the coefficients of each degree, (K, …, 4)."""
        return np.asarray(
            np.add.reduceat(np.abs(self.P), products(self.k).starts[:-1], axis=-1)
        )

    @property
    def most(self) -> Array:
        """Bound of the absolute value, (K, …)."""
        return np.asarray((np.abs(self.P).sum(axis=-1) + self.r) * (1 + _ROUND))

    @property
    def reach(self) -> Array:
        """Bound of the distance from the value at the centre, (K, …)."""
        return np.asarray(
            (np.abs(self.P[..., 1:]).sum(axis=-1) + self.r) * (1 + _ROUND)
        )

    def __getitem__(self, at: Any) -> TaylorModel:
        return TaylorModel(self.k, self.P[(*at, slice(None))], self.r[at])

    def __add__(self, other: TaylorModel) -> TaylorModel:
        P = self.P + other.P
        r = (self.r + other.r) * (1 + _ROUND) + _ROUND * np.abs(P).sum(axis=-1)
        return TaylorModel(self.k, P, r)

    def __neg__(self) -> TaylorModel:
        return TaylorModel(self.k, -self.P, self.r)

    def __sub__(self, other: TaylorModel) -> TaylorModel:
        return self + -other

    def scaled(self, factor: Array | float) -> TaylorModel:
        """Multiply by constants (K, …)."""
        P = self.P * np.asarray(factor)[..., None]
        r = self.r * np.abs(factor) * (1 + _ROUND) + _ROUND * np.abs(P).sum(axis=-1)
        return TaylorModel(self.k, P, r)

    def combined(self, A: Array) -> TaylorModel:
        """Combine the last axis of models linearly: ``y_i = Σ_j A_ij x_j``, A (…, i, j)."""
        P, r = A @ self.P, (np.abs(A) @ self.r[..., None])[..., 0] * (1 + _ROUND)
        sizes = np.abs(self.P).sum(axis=-1)
        return TaylorModel(
            self.k, P, r + _ROUND * (np.abs(A) @ sizes[..., None])[..., 0]
        )

    def __mul__(self, other: TaylorModel) -> TaylorModel:
        pairs = products(self.k)
        P = self.P[..., pairs.left] * other.P[..., pairs.right]
        P = np.add.reduceat(P, pairs.first, axis=-1)
        a, b = self.norms, other.norms
        beyond = a[..., 1] * b[..., 3] + a[..., 2] * (b[..., 2] + b[..., 3])
        beyond = beyond + a[..., 3] * (b[..., 1] + b[..., 2] + b[..., 3])
        one, two = a.sum(axis=-1), b.sum(axis=-1)
        r = (
            beyond
            + one * other.r
            + self.r * two
            + self.r * other.r
            + _ROUND * one * two
        )
        return TaylorModel(self.k, P, r * (1 + _ROUND))

    def sine_cosine(self) -> tuple[TaylorModel, TaylorModel]:
        """Compute the models of the sine and of the cosine.

        They are Taylor series in the difference d from the centre; the remainder is at most
        ``|d|⁴ / 24``.
        """
        s, c = np.sin(self.P[..., 0]), np.cos(self.P[..., 0])
        return self._series([s, c, -s / 2, -c / 6], 1 / 24), self._series(
            [c, -s, -c / 2, s / 6], 1 / 24
        )

    def power(self, s: float) -> TaylorModel:
        """Compute the model of ``x^s``, s < 4, for x > 0; its bound is inf where x may be 0.

        The fourth derivative falls with x, so it is at most that at the smallest x.
        """
        x = self.P[..., 0]
        least = (x - self.reach) * (1 - _ROUND)
        with np.errstate(all="ignore"):
            factors, f = [], np.where(x > 0, x, np.nan) ** s
            size = np.nan_to_num(f)
            for i in range(4):
                factors.append(np.nan_to_num(f))
                f = f * ((s - i) / ((i + 1) * x))
            fourth = np.abs(s * (s - 1) * (s - 2) * (s - 3)) / 24 * least ** (s - 4)
        fourth = np.where(least > 0, fourth, np.inf)
        return self._series(factors, fourth, np.where(least > 0, _ROUND * size, np.inf))

    def _series(
        self,
        factors: list[Array],
        fourth: Array | float,
        rounding: Array | float = _ROUND,
    ) -> TaylorModel:
        """Compute the model of ``Σ f_i d^i``, i = 0 … 3, with d the difference from the centre.

        ``fourth |d|⁴`` and ``rounding`` are added to the bound.
        """
        P = self.P.copy()
        P[..., 0] = 0.0
        d = TaylorModel(self.k, P, self.r)
        square = d * d
        cube = square * d
        found = (
            d.scaled(factors[1]) + square.scaled(factors[2]) + cube.scaled(factors[3])
        )
        P = found.P.copy()
        P[..., 0] += factors[0]
        r = found.r + (fourth * d.most**4 + rounding) * (1 + _ROUND)
        return TaylorModel(self.k, P, r)

    def exponential(self) -> list[TaylorModel]:
        """Compute the models of ``cos √z``, ``sin √z / √z`` and ``(1 − cos √z) / z``, z from 0 to
        π².

        They are entire functions ``Σ (−z)^i / (2 i + m)!``, m = 0, 1, 2, whose fourth derivatives
        are largest at 0.
        """
        z, found = np.maximum(self.P[..., 0], 0.0), []
        for m in range(3):
            factors = entire(z, m)
            fourth = 1 / np.prod(np.arange(1.0, 9 + m))
            found.append(self._series(factors, fourth, 1e-12))
        return found


def entire(z: Array, m: int) -> list[Array]:
    """Evaluate ``Σ (−z)^i / (2 i + m)!`` at z, with its first three derivatives.

    Returns four arrays: the value, and the derivatives divided by 1, 2 and 6.
    """
    found = []
    for j in range(4):
        total, term = (
            np.zeros_like(z),
            (-1.0) ** j / np.prod(np.arange(1.0, 2 * j + m + 1)),
        )
        power = np.ones_like(z)
        for i in range(j, _ENTIRE):  # binomial(i, j) (−1)^i z^(i − j) / (2 i + m)!
            total = total + term * power
            power = power * z
            term *= -(i + 1) / (i + 1 - j) / ((2 * i + m + 1) * (2 * i + m + 2))
        found.append(total)
    return found


def cross(a: TaylorModel, b: TaylorModel) -> TaylorModel:
    """Compute the models of a × b, for models of vectors (…, 3)."""
    one, two = [1, 2, 0], [2, 0, 1]
    return a[..., one] * b[..., two] - a[..., two] * b[..., one]


def dot(a: TaylorModel, b: TaylorModel) -> TaylorModel:
    """Compute the models (…, 1) of a · b, for models of vectors (…, 3)."""
    return (a * b).combined(np.ones((1, 3)))


Columns = list[TaylorModel]


def moved(
    axis: Array, revolute: bool, R: Columns, o: TaylorModel, theta: TaylorModel
) -> tuple[Columns, TaylorModel]:
    """Move a frame, columns R and position o, by the position theta (K, 1) of a joint."""
    if not revolute:
        return R, o + theta * combined(R, axis)
    s, c = theta.sine_cosine()
    B = basis(axis)
    x, y, z = (combined(R, column) for column in B.T)
    turned = [c * x + s * y, c * y - s * x, z]
    return [combined(turned, row) for row in B], o


def basis(axis: Array) -> Array:
    """Create a rotation matrix (3, 3) whose third column is the unit vector ``axis``."""
    if axis[2] ** 2 > 1 - 1e-30:
        return np.diag([1.0, np.sign(axis[2]), np.sign(axis[2])])
    other = np.eye(3)[np.argmin(np.abs(axis))]
    x = np.cross(other, axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def combined(R: Columns, x: Array) -> TaylorModel:
    """Compute the model of R x for a constant vector x (3,)."""
    return R[0].scaled(x[0]) + R[1].scaled(x[1]) + R[2].scaled(x[2])


def fixed(like: TaylorModel, x: Array) -> TaylorModel:
    """Create the model of a constant vector on the boxes of another model."""
    return TaylorModel.constant(like.k, np.tile(x, (len(like.r), 1)))


def identity(like: TaylorModel) -> Columns:
    """Create the columns of the identity on the boxes of a model."""
    return [fixed(like, e) for e in np.eye(3)]
