"""Polynomial potentials of some or all joints, orthonormal over a box.

A potential is a function of the configuration q. A repeatable controller keeps r potentials h(q)
constant, weighted sums of the N potentials of a basis.

``PolynomialMap`` is r potentials h(q) as polynomials.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations_with_replacement, pairwise
from math import comb
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import Array, as_configurations, as_int, flag, per_joint, shown, vector
from ..base.errors import InputError
from ..native import PART, filled_struct
from .basis import PotentialBasis, Potentials, as_joint_indices, coefficients

_MAX_SIZE = 5_000

_POLYNOMIALS = 0
"""Value of ``kind`` in arm.h that stands for these potentials."""

_Powers = tuple[int, ...]


class Polynomial(PotentialBasis):
    r"""All polynomials of total degree 1 to d in scaled joint coordinates.

    The basis is made of products of Legendre polynomials P,

    .. math:: h_\alpha(q) = \prod_i \sqrt{2\alpha_i + 1}\; P_{\alpha_i}(u_i), \qquad
              u = (q - \text{center}) / \text{scale}, \qquad 1 \le |\alpha| \le d,

    orthonormal in the mean over the box ``center ± scale``, so that a fit of degree 4 is as well
    conditioned as one of degree 1.

    Parameters
    ----------
    center : (n,) array
        Centre of the box on which the basis is orthonormal, rad or m; u = 0 there.
    degree : int
        Highest total degree, 1 or more.
    scale : float or (n,) array
        Half-widths of that box, rad (m for prismatic joints).
    variables : sequence of int, optional
        Joints on which the potentials depend (counted from 0); by default all.
    cross
        True if one potential may depend on several joints.

    Raises
    ------
    InputError
        If the degree is below 1, a width is not positive, or a joint does not exist.

    Examples
    --------
    >>> potentials = rp.Polynomial(q0, degree=2, scale=0.4)
    >>> potentials.size
    9
    >>> potentials.gradients(q0[None]).shape  # (K, n, N)
    (1, 3, 9)
    """

    n: int

    def __init__(
        self,
        center: ArrayLike,
        degree: int,
        scale: ArrayLike = 1.0,
        variables: Sequence[int] | None = None,
        *,
        cross: bool = True,
    ) -> None:
        self.center = vector(center, None, "the center of a polynomial basis")
        self.n = n = len(self.center)
        self.scale = per_joint(scale, n, "the scale of a polynomial basis", finite=True)
        self.degree = as_int(degree, "the degree of a polynomial basis", 1)
        self.cross = flag(cross, "cross")
        self.variables = as_joint_indices(variables, n)
        size = comb(len(self.variables) + self.degree, self.degree) - 1
        if size > _MAX_SIZE:
            raise InputError(
                f"polynomials of degree {shown(self.degree)} in {len(self.variables)} joints have "
                f"{shown(size)} potentials, but the maximum is {_MAX_SIZE}",
                remedy="use a lower degree, or fewer joints by variables=",
            )
        # One row per potential: the variable of each factor, repeated as often as its power.
        factors = (
            c
            for d in range(1, self.degree + 1)
            for c in combinations_with_replacement(self.variables, d)
        )
        if not cross:
            factors = (c for c in factors if len(set(c)) == 1)
        self.exponents = np.array([[c.count(v) for v in range(n)] for c in factors])  # (N, n)
        self.norms = np.sqrt(np.prod(2 * self.exponents + 1, axis=1))
        # Each potential is a product of at most d factors P_{order}(u_{variable}); shorter products
        # are padded with factors of order 0, which are 1.
        slots = min(self.degree, n)
        self._variable = np.zeros((slots, len(self.exponents)), int)
        self._order = np.zeros((slots, len(self.exponents)), int)
        for j, alpha in enumerate(self.exponents):
            used = np.flatnonzero(alpha)
            self._variable[: len(used), j] = used
            self._order[: len(used), j] = alpha[used]

    @property
    def size(self) -> int:
        """N, the number of potentials."""
        return len(self.exponents)

    @property
    def names(self) -> tuple[str, ...]:
        """Formula of each potential, a product of Legendre polynomials: ``P2(u_0) P1(u_3)``."""
        return tuple(
            " ".join(f"P{power}(u_{i})" for i, power in enumerate(alpha) if power)
            for alpha in self.exponents
        )

    def values(self, Q: ArrayLike) -> Array:
        """Evaluate the N potentials of the basis at every row of Q (K, n): (K, N)."""
        P, _ = self._tables(Q)
        return np.prod(P[:, self._variable, self._order], axis=1) * self.norms

    def gradients(self, Q: ArrayLike) -> Array:
        """Evaluate the gradients ∇h_j of the N potentials at Q (K, n): (K, n, N), per rad or m.

        Entry ``[k, i, j]`` is ∂h_j/∂q_i at row k.
        """
        # (n, d + 1, K)
        P, dP = (np.ascontiguousarray(np.moveaxis(table, 0, -1)) for table in self._tables(Q))
        K, n = P.shape[-1], len(P)
        gradients = np.zeros((K, n * self.size))
        for s, (variable, order) in enumerate(zip(self._variable, self._order, strict=True)):
            column = np.flatnonzero(order)  # the potentials that have a factor in this slot
            slope = dP[variable[column], order[column]]  # (·, K)
            for t in range(len(self._order)):
                if t != s:
                    slope *= P[self._variable[t, column], self._order[t, column]]
            slope *= (self.norms[column] / self.scale[variable[column]])[:, None]
            gradients[:, variable[column] * self.size + column] = slope.T
        return gradients.reshape(K, n, self.size)

    def weighted(self, A: ArrayLike) -> PolynomialMap:
        """Create the r potentials ``h = Aᵀ (h_1 … h_N)`` with coefficients A (N, r)."""
        A = coefficients(A, self.size)
        d, joints = self.degree, np.array(self.variables)
        # Legendre to monomial coefficients, variable by variable, in an array of exponents.
        to_power = [
            np.pad(legendre.leg2poly(np.eye(d + 1)[k][: k + 1]), (0, d - k)) for k in range(d + 1)
        ]
        terms: dict[tuple[int, ...], Array] = {}
        exponents = self.exponents[:, joints]
        for alpha, norm, a in zip(exponents, self.norms, A, strict=True):
            expanded = {(0,) * len(joints): norm * a}
            for i in np.flatnonzero(alpha):
                expanded = {
                    (*beta[:i], p, *beta[i + 1 :]): c * to_power[alpha[i]][p]
                    for beta, c in expanded.items()
                    for p in range(alpha[i], -1, -2)
                }
            for beta, c in expanded.items():
                terms[beta] = terms.get(beta, 0.0) + c
        center, scale = self.center[joints], self.scale[joints]
        return PolynomialMap(center, scale, d, terms, joints, self.n)

    def _tables(self, Q: ArrayLike) -> tuple[Array, Array]:
        """Evaluate the Legendre polynomials P_a(u_i) and dP_a/du_i: two arrays (K, n, d + 1).

        Entry ``[k, i, a]`` belongs to row k of Q (K, n), to the scaled joint coordinate u_i, and to
        the degree a from 0 to d. All potentials are products of values P_a(u_i).
        """
        u = (as_configurations(Q, self.n, "this polynomial basis") - self.center) / self.scale
        P, dP = np.ones((2, *u.shape, self.degree + 1))
        P[..., 1], dP[..., 0] = u, 0.0
        for k in range(1, self.degree):
            P[..., k + 1] = ((2 * k + 1) * u * P[..., k] - k * P[..., k - 1]) / (k + 1)
            dP[..., k + 1] = (2 * k + 1) * P[..., k] + dP[..., k - 1]
        return P, dP

    def __str__(self) -> str:
        return f"{self.size} polynomials of degree ≤ {self.degree} in {len(self.variables)} joints"


class PolynomialMap(Potentials):
    r"""r polynomials h(q) of k joints, evaluated from one table of weights of monomials.

    The polynomials are sums of monomials u^β with ``u = (q − center) / scale``, where the tuple β
    has one exponent per joint. Let ``z = (1, q − center)`` (k + 1,). If each monomial is multiplied
    by the power of ``z_0 = 1`` that raises its degree to d, h is homogeneous of degree d in z. Then
    ``h = Σ_i w_i z_i / d`` by Euler's theorem, with the derivatives ``w_i = ∂h/∂z_i``. Each w_i is
    a weighted sum of monomials of degree below d. One table of these weights gives values,
    gradients and second derivatives, here and in the native library (arm.c).

    Attributes
    ----------
    center, scale : (k,) arrays
        Centre and scale of the coordinates u of the k joints.
    degree : int
        d, the highest total degree.
    terms : dict of tuple to (r,) array
        The coefficients (r,) of each monomial u^β in the r polynomials; the key is β.
    joints : (k,) array of int
        Indices, from 0, of the k joints among those of the arm.
    n : int
        Number of joints of the arm.
    """

    def __init__(
        self,
        center: Array,
        scale: Array,
        degree: int,
        terms: dict[_Powers, Array],
        joints: NDArray[np.intp],
        n: int,
    ) -> None:
        self.center = center
        self.scale = scale
        self.degree = degree
        self.terms = terms
        self.joints = joints
        self.n = n
        shares = _weights(terms, degree, scale)
        monomials, self._parent, self._factor = _monomials(shares, len(center))
        none = np.zeros_like(next(iter(shares.values())))
        weight = [shares.get(beta, none) for beta in monomials]
        self._weight = np.array(weight)  # (count, r, k + 1)
        slopes = self._weight[:, :, 1:].swapaxes(1, 2)
        self._slopes = slopes.reshape(len(slopes), -1)  # (count, k r)
        sizes = [sum(beta) for beta in monomials]
        ends = np.searchsorted(sizes, np.arange(1, degree + 1)).tolist()
        self._rising = [slice(*pair) for pair in pairwise(ends)]  # degrees 1, 2, …

    def value(self, q: Array) -> Array:
        """Evaluate the r potentials h(q) at one q (n,): (r,)."""
        away = np.asarray(q, float)[self.joints] - self.center
        w = self._powers(away[None] / self.scale)[:, 0] @ self._weight.swapaxes(0, 1)
        return w @ np.append(1.0, away) / self.degree

    def gradients(self, Q: Array) -> Array:
        """Evaluate V = ∂hᵀ/∂q, the gradients of the r potentials h, at Q (K, n): (K, n, r)."""
        U = (np.asarray(Q, float)[:, self.joints] - self.center) / self.scale
        gradients = np.zeros((len(U), self.n, self._weight.shape[1]))
        own = self._powers(U).T @ self._slopes
        gradients[:, self.joints] = own.reshape(*U.shape, -1)
        return gradients

    def hessian(self, q: Array) -> Array:
        """Evaluate the second derivatives of the r potentials h at q (n,): (n, n, r).

        Entry ``[i, k, j]`` is ∂²h_j/∂q_i∂q_k.
        """
        u = (np.asarray(q, float)[self.joints] - self.center) / self.scale
        M = self._powers(u[None])
        dM = np.zeros((len(M), len(u)))  # ∂M/∂u, by the product rule
        for rows in self._rising:
            parent, factor = self._parent[rows], self._factor[rows]
            dM[rows] = dM[parent] * u[factor, None]
            dM[np.arange(rows.start, rows.stop), factor] += M[parent, 0]
        own = np.einsum("ai,ajk->ikj", dM / self.scale, self._weight[:, :, 1:])
        hessian = np.zeros((self.n, self.n, own.shape[-1]))
        hessian[np.ix_(self.joints, self.joints)] = own
        return hessian

    def _powers(self, U: Array) -> Array:
        """Evaluate all M monomials u^β of the table at the rows u of U (K, k): (M, K).

        The first is 1, and their degrees rise. Each further one is the product of an earlier
        monomial, its parent, and one of the k coordinates.
        """
        M = np.ones((len(self._parent), len(U)))
        factors = U.T
        for rows in self._rising:
            M[rows] = M[self._parent[rows]] * factors[self._factor[rows]]
        return M

    def _native_part(self) -> Any:
        """Create the C struct of these potentials, from which C evaluates h and ∂h/∂q."""
        indices = {"joint": self.joints, "parent": self._parent, "factor": self._factor}
        reals = {"center": self.center, "scale": 1 / self.scale, "weight": self._weight}
        sizes = {
            "kind": _POLYNOMIALS,
            "k": len(self.center),
            "count": len(self._weight),
            "degree": self.degree,
        }
        return filled_struct(PART, indices, reals, sizes)[0]


def _weights(terms: dict[_Powers, Array], degree: int, scale: Array) -> dict[_Powers, Array]:
    """Compute the weights (r, k + 1) of each monomial u^β in the derivatives ``w = ∂h/∂z``.

    h, u and z (k + 1,) are those of :class:`PolynomialMap`: ``u = (q − center) / scale``, and ``z =
    (1, q − center)``. The keys of the result are the exponents β. ``terms`` has the coefficients
    (r,) in h by exponents, and ``degree`` is the total degree of h.
    """
    shares: dict[_Powers, Array] = {}

    def add(beta: _Powers, i: int, share: Array) -> None:
        weight = shares.setdefault(beta, np.zeros((len(share), len(scale) + 1)))
        weight[:, i] += share

    for beta, coefficient in terms.items():
        if sum(beta) < degree:
            add(beta, 0, coefficient * (degree - sum(beta)))
        for i in map(int, np.flatnonzero(beta)):
            lower = (*beta[:i], beta[i] - 1, *beta[i + 1 :])
            add(lower, i + 1, coefficient * beta[i] / scale[i])
    return shares


def _monomials(
    expected: Iterable[_Powers], k: int
) -> tuple[list[_Powers], NDArray[np.intp], NDArray[np.intp]]:
    """Order monomials so that each is an earlier one, its parent, times one of k variables.

    One multiplication then evaluates each monomial. ``expected`` are the monomials that must be in
    the result, as tuples of k powers; their parents are added. Return three sequences with an entry
    per monomial, by rising degree: its powers, the index of its parent, and the index of the
    variable. The first monomial is 1; it has no parent, and its two indices are 0.
    """
    needed = {(0,) * k}
    for beta in expected:
        while any(beta):
            needed.add(beta)
            beta, _ = _lower(beta)
    order = sorted(needed, key=lambda beta: (sum(beta), tuple(-power for power in beta)))
    place = {beta: a for a, beta in enumerate(order)}
    made_of = [_lower(beta) for beta in order[1:]]
    parents = [0, *(place[beta] for beta, _ in made_of)]
    factors = [0, *(i for _, i in made_of)]
    return order, np.array(parents), np.array(factors)


def _lower(beta: _Powers) -> tuple[_Powers, int]:
    """Divide a monomial by its last variable; return the remaining powers and the variable's index.

    ``beta`` has the power of each variable, not all 0. The last variable is the last one whose
    power is above 0.
    """
    last = max(i for i, power in enumerate(beta) if power)
    return (*beta[:last], beta[last] - 1, *beta[last + 1 :]), last
