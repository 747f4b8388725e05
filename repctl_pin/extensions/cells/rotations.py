"""Exponential and left Jacobian of SO(3), batched."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ...arguments import Array
from ...model.chain_formulas import skew


def exp3(omega: Array) -> Array:
    """Convert rotation vectors ω (K, 3), rad, to rotation matrices exp(ω̂) (K, 3, 3)."""
    return (
        Rotation.from_rotvec(omega).as_matrix() if len(omega) else np.empty((0, 3, 3))
    )  # SciPy 1.15 refuses K = 0


def left_jacobian(omega: Array) -> Array:
    r"""Evaluate the left Jacobian of SO(3), which maps the time derivative of a rotation vector ω
    to the angular velocity of exp(ω̂) in fixed axes.

    .. math:: J_l(\omega) = I + \frac{1 - \cos\theta}{\theta^2} \hat\omega
              + \frac{\theta - \sin\theta}{\theta^3} \hat\omega^2, \qquad \theta = \|\omega\|.

    Parameters
    ----------
    omega : (K, 3) array

    Returns
    -------
    (K, 3, 3) array
    """
    square = np.sum(omega**2, axis=-1)
    theta = np.sqrt(square)
    small = theta < 1e-4
    safe = np.where(small, 1.0, theta)
    a = np.where(small, 0.5 - square / 24, (1 - np.cos(safe)) / safe**2)
    b = np.where(small, 1 / 6 - square / 120, (safe - np.sin(safe)) / safe**3)
    hat = skew(omega)
    return np.eye(3) + a[:, None, None] * hat + b[:, None, None] * (hat @ hat)
