"""Trigonometric potentials of selected joints, for regions that span large angles.

A potential is a function of the configuration q. A repeatable controller keeps r potentials h(q)
constant, weighted sums of the N potentials of a basis.

``FourierMap`` is r potentials h(q) as Fourier series.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import Array, as_configurations, as_int, flag, per_joint
from ..base.errors import InputError
from ..native import PART, filled_struct
from .basis import PotentialBasis, Potentials, as_joint_indices, coefficients

_MAX_SIZE = 20_000

_FOURIER_SERIES = 1
"""Value of ``kind`` in arm.h that stands for these potentials."""


class Fourier(PotentialBasis):
    r"""Trigonometric basis: sines and cosines of integer combinations of selected joints.

    .. math:: \sin(k \cdot u), \quad \cos(k \cdot u), \qquad u_i = 2\pi q_i / \text{period}_i,
              \qquad 1 \le \sum_i |k_i| \le \text{order},

    Only one of k and −k is used. The potentials are periodic, as a continuous joint is, and bounded
    where polynomials are not. Over a small box they are close to polynomials, so a basis of both is
    nearly linearly dependent.

    Parameters
    ----------
    n : int
        Number of joints of the arm.
    order : int
        Maximum of Σ |k_i|, 1 or more.
    variables : sequence of int, optional
        Joints on which the potentials depend (counted from 0); by default all.
    period : float or (n,) array
        Period of each joint, rad or m: 2π for a revolute joint, any length for a prismatic one.
    cross
        True if one potential may depend on several joints.

    Raises
    ------
    InputError
        If the order is below 1, a period is not positive, or a joint does not exist.

    Examples
    --------
    >>> potentials = rp.Fourier(n=3, order=1)
    >>> potentials.names
    ('sin(u_0)', 'sin(u_1)', 'sin(u_2)', 'cos(u_0)', 'cos(u_1)', 'cos(u_2)')
    >>> potentials.values(q0[None]).shape  # (K, N)
    (1, 6)
    """

    n: int

    def __init__(
        self,
        n: int,
        order: int,
        *,
        variables: Sequence[int] | None = None,
        period: ArrayLike = 2 * np.pi,
        cross: bool = True,
    ) -> None:
        self.n = as_int(n, "the number of joints", 1, _MAX_SIZE)
        self.order = as_int(order, "the order of a Fourier basis", 1, _MAX_SIZE)
        self.cross = flag(cross, "cross")
        self.period = per_joint(period, self.n, "the period of a Fourier basis", finite=True)
        self.variables = as_joint_indices(variables, self.n)
        multiples = range(-self.order, self.order + 1)
        joints = len(self.variables)
        if len(multiples) ** (joints if cross else 1) > 50 * _MAX_SIZE:
            raise InputError(
                f"a Fourier basis of order {order} in {joints} joints has too many potentials",
                remedy="use a lower order, or fewer joints by variables=",
            )
        alone = (tuple(row) for k in multiples for row in (k * np.eye(joints, dtype=int)).tolist())
        every = product(multiples, repeat=joints) if self.cross else alone
        waves = [
            k for k in every if next((x for x in k if x), 0) > 0 and sum(map(abs, k)) <= self.order
        ]
        waves.sort(key=lambda k: (sum(map(abs, k)), tuple(-x for x in k)))
        self.waves = np.zeros((len(waves), self.n))  # (N / 2, n), rad per rad or m
        self.waves[:, list(self.variables)] = np.array(waves)
        self._multiples = self.waves.astype(int)
        self.waves *= 2 * np.pi / self.period

    @property
    def size(self) -> int:
        """N, the number of potentials: all sines, then all cosines."""
        return 2 * len(self.waves)

    @property
    def names(self) -> tuple[str, ...]:
        """Formula of each potential in u_0, u_1, …"""
        inner = [_sum(k) for k in self._multiples]
        return (*(f"sin({k})" for k in inner), *(f"cos({k})" for k in inner))

    def values(self, Q: ArrayLike) -> Array:
        """Evaluate the N potentials of the basis at every row of Q (K, n): (K, N)."""
        phase = as_configurations(Q, self.n, "this Fourier basis") @ self.waves.T
        return np.concatenate([np.sin(phase), np.cos(phase)], axis=-1)

    def gradients(self, Q: ArrayLike) -> Array:
        """Evaluate the gradients ∇h_j of the N potentials at Q (K, n): (K, n, N), per rad or m.

        Entry ``[k, i, j]`` is ∂h_j/∂q_i at row k.
        """
        phase = as_configurations(Q, self.n, "this Fourier basis") @ self.waves.T
        slopes = np.concatenate([np.cos(phase), -np.sin(phase)], axis=-1)
        return slopes[:, None, :] * np.concatenate([self.waves, self.waves]).T

    def weighted(self, A: ArrayLike) -> FourierMap:
        """Create the r potentials ``h = Aᵀ (h_1 … h_N)`` with coefficients A (N, r)."""
        return FourierMap(self.waves, coefficients(A, self.size))

    def __str__(self) -> str:
        return (
            f"{self.size} sines and cosines of order ≤ {self.order} in {len(self.variables)} joints"
        )


class FourierMap(Potentials):
    """r Fourier series ``h = Σ_w (a_w sin(w · q) + b_w cos(w · q))`` with a_w and b_w (r,).

    The sum is over the wave vectors w, per rad or m, which are the rows of ``waves`` (N/2, n). The
    coefficients A (N, r) are those of all sines, ``sines``, then those of all cosines, ``cosines``.
    """

    def __init__(self, waves: Array, A: Array) -> None:
        self.waves, self.n = waves, waves.shape[1]
        self.sines, self.cosines = np.split(A, 2)  # (N / 2, r)

    def value(self, q: Array) -> Array:
        """Evaluate the r potentials h(q) at one q (n,): (r,)."""
        phase = self.waves @ q
        return np.sin(phase) @ self.sines + np.cos(phase) @ self.cosines

    def gradients(self, Q: Array) -> Array:
        """Evaluate V = ∂hᵀ/∂q, the gradients of the r potentials h, at Q (K, n): (K, n, r)."""
        phase = (np.asarray(Q, float) @ self.waves.T)[..., None]  # (K, N / 2, 1)
        return self.waves.T @ (np.cos(phase) * self.sines - np.sin(phase) * self.cosines)

    def hessian(self, q: Array) -> Array:
        """Evaluate the second derivatives of the r potentials h at q (n,): (n, n, r).

        Entry ``[i, k, j]`` is ∂²h_j/∂q_i∂q_k.
        """
        phase = self.waves @ q
        # (N / 2, r)
        bend = -(np.sin(phase)[:, None] * self.sines + np.cos(phase)[:, None] * self.cosines)
        return np.einsum("wi,wk,wj->ikj", self.waves, self.waves, bend)

    def _native_part(self) -> Any:
        """Create the C struct of these potentials, from which C evaluates h and ∂h/∂q.

        Wave vectors whose coefficients are all 0 are left out, but at least one is kept.
        """
        used = ((self.sines != 0) | (self.cosines != 0)).any(axis=1)
        used[0] |= not used.any()
        weight = np.stack([self.sines[used], self.cosines[used]], axis=-1)
        sizes = {"kind": _FOURIER_SERIES, "k": self.n, "count": len(weight)}
        reals = {"wave": self.waves[used], "weight": weight}
        return filled_struct(PART, {"joint": range(self.n)}, reals, sizes)[0]


def _sum(k: NDArray[np.int_]) -> str:
    """Format the sum k · u as text, such as ``2 u_0 − u_3``, for the names of potentials.

    k (n,) are whole numbers, not all 0.
    """
    text = ""
    for i in np.flatnonzero(k):
        size = "" if abs(k[i]) == 1 else f"{abs(k[i])} "
        text += (" − " if text else "−") if k[i] < 0 else (" + " if text else "")
        text += f"{size}u_{i}"
    return text
