"""Joint coordinates ψ of a task, q = T ψ: absolute angles, gear ratios, coupled drives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import Array, as_matrices, read_only
from ..base.errors import InputError


@dataclass(frozen=True, eq=False)
@read_only
class Coordinates:
    """Linear change of joint coordinates ``q = T ψ``, and the limits on ψ.

    ``J_ψ = J T``, ``H_ψ[a, i, k] = Σ H[a, p, s] T[p, i] T[s, k]``, ``M_ψ = Tᵀ M T``.

    J, H and M on the right are those in q: task Jacobian, its Hessian, and inertia. The limits on q
    are in general not limits on single ψ_j. Only a joint with ``q_i = T_ij ψ_j``, a single nonzero
    entry in its row of T, limits ψ_j alone. ``lower``, ``upper`` and ``velocity_limit`` contain
    these limits, and −inf and inf elsewhere; :meth:`Task.check` tests the limits of all q = T ψ.

    Attributes
    ----------
    T, inverse : (n, n) arrays
        T and T⁻¹.
    names : tuple of str
        Name of the joint if ψ_i = q_i, else ``ψ1``, ``ψ2``, …
    lower, upper, velocity_limit : (n,) arrays
        Limits on ψ_j and its rate, for each j that is limited alone.
    revolute : (n,) array of bool
        True if ψ_i moves a revolute joint; its unit is then rad.
    """

    T: Array
    inverse: Array
    names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity_limit: Array
    revolute: NDArray[np.bool_]

    def joints(self, psi: Array) -> Array:
        """Convert the task's coordinates ψ (..., n) to joint positions q = T ψ."""
        return psi @ self.T.T

    def coordinates(self, q: Array) -> Array:
        """Convert joint positions q (..., n) to the task's coordinates ψ = T⁻¹ q."""
        return q @ self.inverse.T


def linear_coordinates(
    names: tuple[str, ...],
    lower: Array,
    upper: Array,
    velocity_limit: Array,
    revolute: NDArray[np.bool_],
    T: ArrayLike,
) -> Coordinates:
    """Create the coordinates ``q = T ψ`` of n joints from their names, limits (n,) and types (n,).

    Only the limits that bound a single ψ become its limits. ψ is named ψ1, ψ2, …, or as its joint
    if both are equal.

    Raises
    ------
    InputError
        If T is not an invertible (n, n) matrix of finite numbers.
    """
    n = len(names)
    matrix: Array = np.array(as_matrices(("T of q = T ψ", T, f"{n} {n}"), exact=True)[0])
    values = np.linalg.svd(matrix, compute_uv=False)
    if values[-1] <= 1e-12 * values[0]:
        raise InputError("T of q = T ψ must be invertible, but its rows are linearly dependent")

    low = np.full(n, -np.inf)
    high = np.full(n, np.inf)
    fastest = np.full(n, np.inf)
    psi = [f"ψ{i + 1}" for i in range(n)]
    for i, row in enumerate(matrix):
        (used,) = np.nonzero(row)
        if len(used) != 1:
            continue
        j, factor = used[0], row[used[0]]
        low[j], high[j] = sorted((lower[i] / factor, upper[i] / factor))
        fastest[j] = velocity_limit[i] / abs(factor)
        if factor == 1.0 and np.count_nonzero(matrix[:, j]) == 1:
            psi[j] = names[i]
    turns = np.array([revolute[np.nonzero(column)[0]].any() for column in matrix.T])
    return Coordinates(
        matrix, np.linalg.inv(matrix).astype(float), tuple(psi), low, high, fastest, turns
    )
