"""Batched functions of rotations: exp, log and left Jacobian of SO(3), and the tilt between two
tool axes."""

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


def log3(R: Array) -> Array:
    """Convert rotation matrices R (K, 3, 3) to rotation vectors (K, 3), rad, of length at most π.

    Rows are NaN where R is not finite.
    """
    usable = np.isfinite(R).all(axis=(1, 2))
    omega = np.full((len(R), 3), np.nan)
    if usable.any():
        omega[usable] = Rotation.from_matrix(R[usable]).as_rotvec()
    return omega


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


def tilts(R: Array, goal: Array) -> Array:
    """Compute the smallest rotations that align the z axes of frames with those of goal frames.

    The rotation axis of each lies in the xy plane of the frame. Return the components (K, 2), rad,
    of the rotation vector along the x and y axes of R (K, 3, 3). This is the batch form of
    :func:`repctl_pin.model.chain_formulas.axis_turn`.
    """
    aim = np.einsum(
        "Kab,Ka->Kb", R, goal[..., :, 2]
    )  # the goal's axis as the tool sees it
    sine = np.hypot(aim[:, 0], aim[:, 1])
    angle = np.arctan2(sine, aim[:, 2])
    axis = np.stack([-aim[:, 1], aim[:, 0]], axis=-1)
    parallel = sine < 1e-12  # angle 0, or half a turn about any axis
    axis[parallel], sine[parallel] = [1.0, 0.0], 1.0
    return axis * (angle / sine)[:, None]
