"""Rotations of many poses at once: vectors, quaternions and matrices, and their mean.

Quaternions are rows qx, qy, qz, qw. SciPy's ``Rotation`` gives the same numbers, to rounding. It is
not used, because its import takes longer than the functions of this module take for 100,000 poses.
"""

from __future__ import annotations

import numpy as np

from ..base.arguments import Array

_SIGNS = np.array([[1.0, -1.0, -1.0, 1.0], [-1.0, 1.0, -1.0, 1.0], [-1.0, -1.0, 1.0, 1.0]])
"""Signs of the squares of qx, qy, qz and qw in the diagonal of a rotation matrix."""

_SMALL = 1e-3
"""Angle, rad, up to which ``sin(θ/2) / θ`` is computed from its series."""


def rotation_quaternions(omega: Array) -> Array:
    """Convert rotation vectors ω (K, 3), rad, to unit quaternions (K, 4).

    With ``θ = ‖ω‖``, a quaternion is ``(ω sin(θ/2) / θ, cos(θ/2))``.
    """
    square = (omega * omega).sum(axis=1)
    theta = np.sqrt(square)
    half = theta / 2
    small = theta <= _SMALL
    factor = np.divide(np.sin(half), theta, out=np.empty_like(theta), where=~small)
    if small.any():
        factor[small] = 0.5 - square[small] / 48 + square[small] ** 2 / 3840
    found = np.empty((len(omega), 4))
    np.multiply(factor[:, None], omega, out=found[:, :3])
    np.cos(half, out=found[:, 3])
    return found


def quaternion_matrices(quaternions: Array) -> Array:
    """Convert quaternions (K, 4) to rotation matrices (K, 3, 3).

    Their lengths, which may differ from 1 by rounding, are made 1.
    """
    return _matrices(_unit(quaternions))


def exp3(omega: Array) -> Array:
    """Convert rotation vectors ω (K, 3), rad, to rotation matrices exp(ω̂) (K, 3, 3)."""
    if not omega.any():  # as coordinates of a symmetry
        return np.tile(np.eye(3), (len(omega), 1, 1))
    return _matrices(rotation_quaternions(omega))


def matrix_quaternions(R: Array) -> Array:
    """Convert rotation matrices R (K, 3, 3) to unit quaternions (K, 4), either of the two signs.

    The largest entry of a quaternion is found first, from the diagonal of R; the others follow by
    division, so that rounding is not amplified.
    """
    diagonal = np.diagonal(R, axis1=1, axis2=2)
    trace = diagonal[:, 0] + diagonal[:, 1] + diagonal[:, 2]
    largest = np.argmax(np.column_stack([diagonal, trace]), axis=1)
    found = np.empty((len(R), 4))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        rows = largest == i
        X = R[rows]
        found[rows, i] = 1 - trace[rows] + 2 * X[:, i, i]
        found[rows, j] = X[:, j, i] + X[:, i, j]
        found[rows, k] = X[:, k, i] + X[:, i, k]
        found[rows, 3] = X[:, k, j] - X[:, j, k]
    rows = largest == 3
    X = R[rows]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        found[rows, i] = X[:, k, j] - X[:, j, k]
    found[rows, 3] = 1 + trace[rows]
    return _unit(found)


def mean_rotation(R: Array) -> Array:
    """Return the rotation (3, 3) nearest to the mean of rotations (K, 3, 3).

    With x_k the quaternions of the rotations, the quaternion of the result is the eigenvector of
    ``Σ_k x_k x_kᵀ`` with the largest eigenvalue.
    """
    x = matrix_quaternions(R)
    _, V = np.linalg.eigh(x.T.copy() @ x)
    return _matrices(V[:, -1:].T)[0]


def _unit(quaternions: Array) -> Array:
    """Divide quaternions (K, 4) by their lengths."""
    x, y, z, w = quaternions.T
    return quaternions / np.sqrt(x * x + y * y + z * z + w * w)[:, None]


def _matrices(quaternions: Array) -> Array:
    """Convert unit quaternions (K, 4) to rotation matrices (K, 3, 3)."""
    q = np.ascontiguousarray(quaternions.T)
    squares = _SIGNS[:, :, None] * (q * q)
    products, with_w = q[[0, 0, 1]] * q[[1, 2, 2]], q[[2, 1, 0]] * q[3]  # xy, xz, yz; zw, yw, xw
    R = np.empty((3, 3, len(quaternions)))
    R[[0, 1, 2], [0, 1, 2]] = squares[:, 0] + squares[:, 1] + squares[:, 2] + squares[:, 3]
    R[[0, 2, 1], [1, 0, 2]] = 2 * (products - with_w)
    R[[1, 0, 2], [0, 2, 1]] = 2 * (products + with_w)
    return np.ascontiguousarray(R.transpose(2, 0, 1))
