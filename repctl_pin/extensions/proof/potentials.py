r"""Potentials as sums of features φ, with bounds on the second-order Taylor remainder of V.

A potential h is a function of the n joint positions q that the controller holds constant. There are
r potentials, and V are their gradients: V_ai = ∂h_a/∂q_i. A proof expands V on boxes of joints
inside a box Ω, which contains the region of the design. ∂ is the derivative with respect to q: ∂V
are the second, ∂²V the third derivatives of h.

An argument of a feature is a linear function z of q. A feature φ is 1, a product of an earlier
feature and an argument z, or the sine or cosine of an argument z. V and its derivatives are sums of
features: G, C and C_3 are their coefficients, T and T_4 are bounds. The features are numbered in
the order in which they are added. The parameter ``field`` of a function is the object with the r
potentials.

.. math:: z = Z q - z_0, \quad φ_f = 1,\; φ_{parent} z,\; \sin z,\; \cos z, \qquad
          V = G φ, \quad ∂V = C φ,
          \quad |∂²V - C_3 φ| ≤ T, \quad |∂(C_3 φ)| ≤ T_4 \text{ on the whole of } Ω

``Features`` are r potentials as sums of features (products, sines, cosines), with bounds on a box
Ω. ``_Feature`` is one feature of a potential: 1, a product, a sine or a cosine. ``PolynomialMap``
is r potentials h(q) as polynomials. ``FourierMap`` is r potentials h(q) as Fourier series.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from itertools import permutations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import Array, read_only
from ...base.errors import InputError
from ...potentials.basis import CustomMap, Potentials, SumMap
from ...potentials.polynomial import PolynomialMap
from ...regions.box import Box

if TYPE_CHECKING:
    from ...potentials.fourier import FourierMap
    from .arm_angle import ArmAngleChain

_CONSTANT, _PRODUCT, _SINE, _COSINE = range(4)
U = 2.0**-53
"""Unit roundoff of double precision."""

_Exponents = tuple[int, ...]


@dataclass(frozen=True, eq=False)
@read_only
class Features:
    """r potentials of n joints as sums of F features, with bounds that hold in the box Ω of joints.

    Attributes
    ----------
    Z, z0 : (s, n) and (s,) arrays
        The s linear arguments of the features, ``z = Z q − z0``.
    kind, parent, variable : (F,) arrays of int
        ``kind`` is 0 for the feature 1, 1 for a product, 2 for a sine, 3 for a cosine. ``parent``
        is the index of the earlier feature in a product, 0 for other kinds. ``variable`` is the
        index of the argument z, 0 for the feature 1.
    G : (r, n, F) array
        Coefficients of V, the gradients.
    C : (r, n, n, F) array
        Coefficients of ∂V, the second derivatives of the potentials.
    third : (F_3,) array of int
        Indices of the features to which the last axis of C3 belongs.
    C3 : (r, n, n, n, F_3) array
        Coefficients of those terms of the third derivatives of h that are not constant, and not
        sines or cosines.
    T, T4 : (r, n, n, n) and (r, n, n, n, n) arrays
        Bounds over Ω: T on the terms of the third derivatives of h that are not in C3, T4 on the
        derivatives of ``C_3 φ``. If F_3 is 0, T4 is (r, 0, 0, 0, 0).
    E : (r, n) array
        Bounds on the rounding errors of V and of its first-order expansion over Ω.
    size : (r,) array
        Bound, per potential, on the largest entry of ``|V| + |∂V| w`` with w the half-widths of Ω.
        Rounding errors are stated relative to this bound.
    arms : tuple of ArmAngleChain
        Arm angles among the potentials. They are not features, but have Taylor models of their own.
    """

    Z: Array
    z0: Array
    kind: NDArray[np.int32]
    parent: NDArray[np.int32]
    variable: NDArray[np.int32]
    G: Array
    C: Array
    third: NDArray[np.int32]
    C3: Array
    T: Array
    T4: Array
    E: Array
    size: Array
    arms: tuple[ArmAngleChain, ...]


def features_of(field: Potentials, n: int, box: Box) -> Features:
    """Convert potentials of n joints to sums of features, with bounds that hold in the box Ω.

    Raises
    ------
    InputError
        If the potentials are not polynomials, Fourier series, arm angles or sums of these. No
        bounds are known for user-defined functions.
    """
    made = _Builder(n, box)
    made.add(field)
    return made.features()


class _Argument(NamedTuple):
    """Linear function ``z = row · q − z0`` of the joints.

    ``most`` is a bound on |z| in Ω, and ``error`` is a bound on the rounding error of z.
    """

    row: Array
    z0: float
    most: float
    error: float


class _Feature(NamedTuple):
    """One feature: 1, a product, a sine or a cosine.

    ``kind`` is 0 for the feature 1, 1 for a product, 2 for a sine and 3 for a cosine. ``parent`` is
    the index of the earlier feature in a product, and ``variable`` the index of the argument z.
    ``bound`` is a bound on the absolute value of the feature in Ω, and ``error`` is a bound on its
    rounding error.
    """

    kind: int
    parent: int
    variable: int
    bound: float
    error: float


class _Builder:
    """Collector of features, coefficients and bounds: :meth:`add` potentials, get :meth:`features`.

    The potentials have n joints; the bounds hold in ``box``, which is Ω. An index of a feature or
    an argument is its number in the order in which they are added, from 0.
    """

    def __init__(self, n: int, box: Box) -> None:
        self.n, self.box = n, box
        self.most = np.abs(box.center) + box.half_width
        self.arguments: list[_Argument] = []
        self.found: list[_Feature] = []
        self.G: list[tuple[int, int, Array]] = []
        self.C: list[tuple[int, int, int, Array]] = []
        self.T: Array | None = None
        self.C3: dict[tuple[int, ...], dict[int, Array]] = defaultdict(dict)
        self.T4: dict[tuple[int, ...], Array] = {}
        self.arms: list[ArmAngleChain] = []

    def add(self, field: Potentials) -> None:
        """Add the features of potentials; if they are a sum, add those of each summand."""
        if isinstance(field, SumMap):
            for part in field.maps:
                self.add(part)
        elif isinstance(field, PolynomialMap):
            self._polynomial(field)
        else:
            self._add_other(field)

    def _add_other(self, field: Potentials) -> None:
        """Add a Fourier series or an arm angle; raise an InputError for any other potentials.

        Few designs have these potentials, so their modules are imported here, only when needed.
        """
        from ...potentials.arm_angle import ArmAngle
        from ...potentials.fourier import FourierMap
        from .arm_angle import ArmAngleChain

        if isinstance(field, FourierMap):
            self._fourier(field)
        elif isinstance(field, CustomMap) and isinstance(field.basis, ArmAngle):
            self._room(field.A.shape[1])
            self.arms.append(ArmAngleChain.of(field.basis, field.A[0]))
        else:
            family = getattr(field, "family", field)
            raise InputError(
                f"nothing can be proved about {family!r}: bounds of its derivatives are not known; "
                "use polynomials, Fourier series, arm angles, or sums of them"
            )

    # ---- arguments and features ---------------------------------------------------------------

    def _argument(self, row: Array, z0: float) -> int:
        """Add the linear function ``row · q − z0`` of the joints, and return its index."""
        middle, reach = row @ self.box.center - z0, np.abs(row) @ self.box.half_width
        error = (self.n + 6) * U * (np.abs(row) @ self.most + abs(z0))
        most = abs(middle) + reach + error
        self.arguments.append(_Argument(row, z0, float(most), float(error)))
        return len(self.arguments) - 1

    def _feature(self, feature: _Feature) -> int:
        """Add a feature, and return its index."""
        self.found.append(feature)
        return len(self.found) - 1

    def _room(self, r: int) -> Array:
        """Return the array T (r, n, n, n) of :class:`Features`, to which terms are added.

        The first call creates it with zeros.
        """
        if self.T is None:
            self.T = np.zeros((r, self.n, self.n, self.n))
        return self.T

    # ---- families -----------------------------------------------------------------------------

    def _polynomial(self, field: PolynomialMap) -> None:
        """Add the terms of polynomials ``h = Σ c_β u^β`` with ``u = (q − center) / scale``.

        The tuples β have one exponent per variable u_i. Every monomial u^β that occurs in a
        derivative of h becomes a feature.
        """
        scale, joints = field.scale, field.joints
        z = self._variables(field)
        most = [self.arguments[v].most for v in z]
        known: dict[_Exponents, int] = {}

        def monomial(beta: _Exponents) -> int:
            if beta not in known:
                known[beta] = self._monomial(beta, z, monomial)
            return known[beta]

        for beta, c in field.terms.items():
            T = self._room(len(c))
            for i, one, by_i in _lowered(beta):
                self.G.append((int(joints[i]), monomial(one), by_i * c / scale[i]))
                for j, two, by_j in _lowered(one):
                    both = by_i * by_j * c / (scale[i] * scale[j])
                    if joints[i] <= joints[j]:
                        self.C.append((int(joints[i]), int(joints[j]), monomial(two), both))
                    for l, three, by_l in _lowered(two):
                        cubic = both * (by_l / scale[l])
                        if sum(beta) == 3:
                            T[:, joints[i], joints[j], joints[l]] += np.abs(cubic)
                        elif i <= j <= l:
                            ijl = tuple(joints[[i, j, l]].tolist())
                            self._third(three, cubic, ijl, joints, most, scale, monomial)

    def _variables(self, field: PolynomialMap) -> list[int]:
        """Add the variables u of polynomials as arguments, which are linear functions of q.

        Return the index of each variable among the arguments.
        """
        rows = np.zeros((len(field.joints), self.n))
        rows[np.arange(len(field.joints)), field.joints] = 1 / field.scale
        offsets = field.center / field.scale
        return [self._argument(row, c) for row, c in zip(rows, offsets, strict=True)]

    def _third(
        self,
        three: _Exponents,
        c: Array,
        ijl: tuple[int, ...],
        joints: NDArray[np.intp],
        most: list[float],
        scale: Array,
        monomial: Callable[[_Exponents], int],
    ) -> None:
        """Add the term ``c u^three`` to the third derivative of h along the joints ``ijl``.

        ``ijl`` are three indices of the arm's joints, in ascending order. ``c`` (r,) are the
        coefficients in the r potentials, and ``three`` are the exponents of the polynomial's
        variables ``u = (q − center) / scale``. ``joints`` and ``scale`` have the joint and the
        scale of each variable, and ``most`` bounds each |u_i| in Ω. ``monomial(exponents)`` returns
        the index of the feature with the given exponents.

        Bounds on the derivatives of the term are added to T4. Because T4 is symmetric, only
        derivatives with respect to the last of the three joints and to later joints are added.
        """
        feature = monomial(three)
        self.C3[ijl][feature] = self.C3[ijl].get(feature, 0.0) + c
        for m, four, by_m in _lowered(three):
            if joints[m] >= ijl[-1]:
                size = np.prod([x**e for x, e in zip(most, four, strict=True)])
                key = (*ijl, int(joints[m]))
                self.T4[key] = self.T4.get(key, 0.0) + np.abs(c) * (by_m * size / scale[m])

    def _monomial(
        self, beta: _Exponents, z: list[int], monomial: Callable[[_Exponents], int]
    ) -> int:
        """Add the monomial with exponents ``beta`` as a feature, and return its index.

        The feature is the product of a monomial of lower degree and one of the variables.
        ``monomial(exponents)`` returns the index of the feature with the given exponents, and ``z``
        are the indices of the variables among the arguments.
        """
        used = [i for i, power in enumerate(beta) if power]
        if not used:
            return self._feature(_Feature(_CONSTANT, 0, 0, 1.0, 0.0))
        i = used[-1]
        parent = monomial((*beta[:i], beta[i] - 1, *beta[i + 1 :]))
        before, argument = self.found[parent], self.arguments[z[i]]
        bound = before.bound * argument.most
        error = before.error * argument.most
        error += (before.bound + before.error) * argument.error + U * bound
        return self._feature(_Feature(_PRODUCT, parent, z[i], bound, error))

    def _fourier(self, field: FourierMap) -> None:
        """Add the terms of Fourier series ``h = Σ (a sin(w · q) + b cos(w · q))``.

        The features are sines and cosines of the linear functions w · q of the joints. The sum is
        over the waves w (n,); a and b have one value per potential.
        """
        T = self._room(field.sines.shape[1])
        for row, a, b in zip(field.waves, field.sines, field.cosines, strict=True):
            z = self._argument(row, 0.0)
            error = self.arguments[z].error + 8 * U
            sine, cosine = (
                self._feature(_Feature(kind, 0, z, 1.0, error)) for kind in (_SINE, _COSINE)
            )
            (used,) = np.nonzero(row)
            for i in used:
                self.G += [(int(i), cosine, row[i] * a), (int(i), sine, -row[i] * b)]
                for j in used[used >= i]:
                    both = row[i] * row[j]
                    self.C += [
                        (int(i), int(j), sine, -both * a),
                        (int(i), int(j), cosine, -both * b),
                    ]
            T += np.einsum("i,j,l,a->aijl", *[np.abs(row)] * 3, np.hypot(a, b))

    # ---- all together -------------------------------------------------------------------------

    def features(self) -> Features:
        """Create the arrays of all features, with bounds on the rounding errors in their sums."""
        assert self.T is not None, "a field has at least one term"
        F = len(self.found)
        G, C = self._first_and_second()
        kinds = np.array([one[:3] for one in self.found], np.int32).reshape(-1, 3)
        bounds = np.array([one[3:] for one in self.found]).reshape(-1, 2)
        kind, parent, variable = kinds.T
        bound, error = bounds.T
        # of a term: its own rounding, its coefficient's, and the sum's
        wrong = error + (F + 16) * U * bound
        half = self.box.half_width
        V, slopes = np.abs(G) @ bound, (np.abs(C) @ bound) @ half
        E = np.abs(G) @ wrong + (np.abs(C) @ wrong) @ half
        size = (V + slopes).max(axis=1)
        T = np.asarray(self.T * (1 + 1e-12), float)
        third, C3, T4 = self._third_and_fourth()
        E += 0.5 * ((np.abs(C3) @ wrong[third]) @ half) @ half
        return Features(
            np.array([one.row for one in self.arguments]).reshape(-1, self.n),
            np.array([one.z0 for one in self.arguments]),
            kind,
            parent,
            variable,
            G,
            C,
            third,
            C3,
            T,
            T4,
            E,
            size,
            tuple(self.arms),
        )

    def _first_and_second(self) -> tuple[Array, Array]:
        """Create the coefficients of gradients, G (r, n, F), and of Hessians, C (r, n, n, F)."""
        assert self.T is not None
        r, n, F = len(self.T), self.n, len(self.found)
        G, C = np.zeros((r, n, F)), np.zeros((r, n, n, F))
        for i, f, c in self.G:
            G[:, i, f] += c
        for i, j, f, c in self.C:
            C[:, i, j, f] += c
            if i != j:
                C[:, j, i, f] += c
        return G, C

    def _third_and_fourth(self) -> tuple[NDArray[np.int32], Array, Array]:
        """Create the arrays ``third``, ``C3`` and ``T4`` for the attributes of :class:`Features`.

        ``third`` (F_3,) are the indices of the features of C_3, ``C3`` (r, n, n, n, F_3) are their
        coefficients, and ``T4`` (r, n, n, n, n) are the bounds. If F_3 is 0, ``T4`` is (r, 0, 0, 0,
        0).
        """
        assert self.T is not None, "a field has at least one term"
        r, n = len(self.T), self.n
        third = np.array(sorted({f for terms in self.C3.values() for f in terms}), np.int32)
        at = {int(f): i for i, f in enumerate(third)}
        C3 = np.zeros((r, n, n, n, len(third)))
        T4 = np.zeros((r, n, n, n, n) if len(third) else (r, 0, 0, 0, 0))
        for ijl, terms in self.C3.items():
            for f, c in terms.items():
                for i, j, l in permutations(ijl):
                    C3[:, i, j, l, at[f]] = c
        for key, bound4 in self.T4.items():
            for i, j, l, m in permutations(key):
                T4[:, i, j, l, m] = bound4 * (1 + 1e-12)
        return third, C3, T4


def _lowered(beta: _Exponents) -> list[tuple[int, _Exponents, int]]:
    """Differentiate a monomial with exponents ``beta`` with respect to each of its variables.

    ``beta`` has one exponent per variable. Return one triple per derivative that is not 0: the
    index of the variable, and the exponents and the factor of the derivative.
    """
    return [
        (i, (*beta[:i], power - 1, *beta[i + 1 :]), power) for i, power in enumerate(beta) if power
    ]
