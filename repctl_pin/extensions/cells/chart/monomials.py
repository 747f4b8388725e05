"""Monomials of k variables u: values, derivatives, least-squares fit of polynomials.

The polynomials are functions on a cell, a box of poses with coordinates u from −1 to 1. Letters: K
points, which are the rows of U (K, k); N monomials. C (N, …) are the coefficients of one or more
polynomials. C has one row per monomial; the further axes number the polynomials.
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np

from ....base.arguments import Array


class Monomials:
    """All monomials ``u^α`` up to degree d in k variables u, ordered by degree.

    The first monomial is the constant 1.

    Attributes
    ----------
    exponents : (N, k) array of int
        Exponents α of each monomial.
    parent, variable : (N,) arrays of int
        Recurrence for the values: monomial i is monomial ``parent[i]`` times ``u[variable[i]]``.
        For the constant, both are 0 and not used.
    """

    def __init__(self, k: int, degree: int) -> None:
        self.k, self.degree = k, degree
        choices = [c for d in range(degree + 1) for c in combinations_with_replacement(range(k), d)]
        at = {c: i for i, c in enumerate(choices)}
        self.exponents = np.array([[c.count(i) for i in range(k)] for c in choices]).reshape(
            len(choices), k
        )
        self.parent = np.array([at[c[:-1]] if c else 0 for c in choices])
        self.variable = np.array([c[-1] if c else 0 for c in choices])
        degrees = self.exponents.sum(axis=1)
        self.starts = np.searchsorted(degrees, np.arange(degree + 2))
        # ∂u^α/∂u_j = α_j u^(α − e_j), which is a monomial again
        self.lower = np.zeros((k, len(choices)), int)
        for i, c in enumerate(choices):
            for j in set(c):
                rest = list(c)
                rest.remove(j)
                self.lower[j, i] = at[tuple(rest)]

    @property
    def size(self) -> int:
        """Number N of monomials."""
        return len(self.exponents)

    def values(self, U: Array) -> Array:
        """Evaluate the monomials at every row of U (K, k): (K, N)."""
        return np.ascontiguousarray(self._rows(U).T)

    def polynomials(self, U: Array, C: Array) -> Array:
        """Evaluate the polynomials with coefficients C (N, …) at every row of U (K, k): (K, …)."""
        values = self._rows(U).T @ C.reshape(self.size, -1)
        return np.asarray(values.reshape(len(U), *C.shape[1:]))

    def _rows(self, U: Array) -> Array:
        """Evaluate the monomials at K points U (K, k), one row per monomial: (N, K)."""
        T, u = np.ones((self.size, len(U))), np.ascontiguousarray(U.T)
        for d in range(1, self.degree + 1):
            part = slice(self.starts[d], self.starts[d + 1])
            np.multiply(T[self.parent[part]], u[self.variable[part]], out=T[part])
        return T

    def slopes(self, T: Array) -> Array:
        """Evaluate the derivatives (K, N, k) of the monomials with respect to u at K points.

        T (K, N) are the values of the monomials at the same points.
        """
        return np.swapaxes(T[:, self.lower] * self.exponents.T, 1, 2)

    def derivative(self, C: Array, j: int) -> Array:
        """Differentiate the polynomials with coefficients C with respect to u_j.

        ``j`` is from 0 to k − 1. Return the coefficients (N, …) of the derivatives, in the same
        monomials.
        """
        some = np.flatnonzero(self.exponents[:, j])  # each leads to another monomial
        weight = self.exponents[some, j].reshape(-1, *[1] * (C.ndim - 1))
        D = np.zeros_like(C)
        D[self.lower[j, some]] = weight * C[some]
        return D

    def differentiated(self, C: Array) -> tuple[Monomials, Array]:
        """Compute the coefficients of the derivatives of polynomials with coefficients C (N, …).

        Return the N' monomials up to degree d − 1, and the coefficients (N', …, k) of the
        derivatives. The last axis numbers the variables u_j.
        """
        lower = Monomials(self.k, max(self.degree - 1, 0))
        D = np.stack([self.derivative(C, j) for j in range(self.k)], axis=-1)
        return lower, D[: lower.size]

    def fit(self, U: Array, values: Array) -> Array:
        """Fit polynomials to values (K, …) at U (K, k) by least squares: coefficients (N, …)."""
        C, *_ = np.linalg.lstsq(self.values(U), values.reshape(len(U), -1), rcond=1e-12)
        return np.asarray(C.reshape(self.size, *values.shape[1:]), float)
