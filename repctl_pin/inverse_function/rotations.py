"""Batched rotations: exp, log, left Jacobian of SO(3), and the rotation between two tool axes."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..arguments import Array


def exp3(omega: Array) -> Array:
    """Evaluate exp(ω̂): (K, 3) → (K, 3, 3)."""
    return (
        Rotation.from_rotvec(omega).as_matrix() if len(omega) else np.empty((0, 3, 3))
    )  # SciPy 1.15 refuses K = 0


def log3(R: Array) -> Array:
    """Evaluate ω with exp(ω̂) = R, ‖ω‖ ≤ π: (K, 3, 3) → (K, 3); NaN where R is not finite."""
    usable = np.isfinite(R).all(axis=(1, 2))
    omega = np.full((len(R), 3), np.nan)
    if usable.any():
        omega[usable] = Rotation.from_matrix(R[usable]).as_rotvec()
    return omega


def left_jacobian(omega: Array) -> Array:
    r"""Evaluate the left Jacobian of SO(3), which takes ω̇ to the angular velocity of exp(ω̂) in
    fixed axes.

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


def skew(omega: Array) -> Array:
    """Write ω × as a matrix: (K, 3) → (K, 3, 3)."""
    x, y, z = np.moveaxis(omega, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(
        *omega.shape[:-1], 3, 3
    )


def tilts(R: Array, goal: Array) -> Array:
    """Measure the rotations (K, 2), rad, about a tool's x and y that turn its z axis to the goal's.

    The batch form of :func:`repctl_pin.robot.chain_formulas.axis_turn`.
    """
    aim = np.einsum("Kab,Ka->Kb", R, goal[..., :, 2])  # the goal's axis as the tool sees it
    sine = np.hypot(aim[:, 0], aim[:, 1])
    angle = np.arctan2(sine, aim[:, 2])
    ratio = np.where(
        sine > 1e-12, angle / np.maximum(sine, 1e-300), np.where(aim[:, 2] > 0, 1.0, 0.0)
    )
    turn = np.stack([-aim[:, 1], aim[:, 0]], axis=-1) * ratio[:, None]
    opposite = (sine <= 1e-12) & (aim[:, 2] < 0)
    turn[opposite] = [np.pi, 0.0]
    return turn
