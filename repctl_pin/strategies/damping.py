"""Damping λ of a control step near singularities of J_V: the damped solution of ``J_V x = b``.

J_V = [J; Vᵀ] (n, n) is the Jacobian J above the gradients V of the potentials that a repeatable
inverse keeps constant.
"""

from __future__ import annotations

import numpy as np
import scipy  # which imports its parts when they are needed

from ..base.arguments import Array


@np.errstate(over="ignore", invalid="ignore")
def damped(J_V: Array, rhs: Array, most: float) -> tuple[Array, float]:
    """Solve ``J_V x = rhs``, damped where J_V is near a singularity.

    Near a singularity the exact solution, and so the joint speeds, grow without bound. With the
    singular values σ_i and vectors u_i and v_i of J_V, ``x = Σ_i v_i σ_i / (σ_i² + λ²) u_iᵀ rhs``
    and ``λ² = λ_max² (1 − (σ_min / 2λ_max)²)`` where ``σ_min < 2 λ_max`` and λ = 0 elsewhere. So x
    is continuous in J_V, and ``‖x‖ ≤ ‖rhs‖ / (√3 λ_max)`` where λ > 0.

    Parameters
    ----------
    J_V : (n, n) array
    rhs : (n,) array
    most : float
        λ_max.

    Returns
    -------
    x : (n,) array
    damping : float
        The λ that was used; 0 where the solution is exact.
    """
    dgetrf, dgetri = scipy.linalg.lapack.dgetrf, scipy.linalg.lapack.dgetri

    factors, pivots, info = dgetrf(J_V)
    if not info:
        inverse, _ = dgetri(factors, pivots)
        # σ_min ≥ 1 / ‖J_V⁻¹‖_F: surely far from singular
        if np.linalg.norm(inverse) < 1 / (2 * most):
            return inverse @ rhs, 0.0
    if not np.isfinite(J_V).all():
        return np.full(len(rhs), np.nan), 0.0
    U, s, V_T = np.linalg.svd(J_V)
    ratio = s[-1] / (2 * most)
    square = most * most * (1 - ratio**2) if ratio < 1 else 0.0
    return V_T.T @ ((U.T @ rhs) * s / (s**2 + square)), float(np.sqrt(square))
