"""Formulas for serial chains: kinematic Hessian, rotations between placements, and checks.

The functions take arrays and placements, and do not depend on a robot model. K is the number of
configurations, rotations or placements in a batch, and n that of joints. A twist is the velocity
(v, ω) of a frame per unit of joint speed; v is the velocity of the frame's origin.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, hypot, pi
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..base.arguments import Array, as_numbers, list_of, row, shown
from ..base.errors import InputError


def chain_hessians(twists: Array, R: Array | None) -> Array:
    r"""Compute the kinematic Hessian of a serial chain: the derivative of J along every joint.

    With columns :math:`J_i = (v_i, \omega_i)` (a prismatic joint has :math:`\omega_i = 0`):

    .. math:: \partial v_i/\partial q_k = \omega_{\min(i,k)} \times v_{\max(i,k)}, \qquad
              \partial \omega_i/\partial q_k = \omega_k \times \omega_i \;\text{ if } k < i
              \text{ else } 0.

    In the frame's own axes,
    :math:`\partial(R^T\omega_i)/\partial q_k = R^T(\omega_i \times \omega_k)` if :math:`k > i`,
    else 0.

    Parameters
    ----------
    twists : (K, n, 6) array
        Columns J_i of K Jacobians, world axes.
    R : (K, 3, 3) array or None
        Rotations of the frame. With them, the angular rows are in the frame's own axes.

    Returns
    -------
    (K, 6, n, n) array
        ``[:, a, i, k] = ∂J[a, i]/∂q[k]``.
    """
    K, n = twists.shape[:2]
    v, w = twists[..., :3], twists[..., 3:]
    i, k = np.indices((n, n))
    H = np.zeros((K, 6, n, n))
    H[:, :3] = np.moveaxis(np.cross(w[:, np.minimum(i, k)], v[:, np.maximum(i, k)]), -1, 1)
    turn = np.moveaxis(np.cross(w[:, k], w[:, i]), -1, 1)  # ω_k × ω_i, (K, 3, n, n)
    H[:, 3:] = turn * (k < i) if R is None else -np.einsum("Kba,Kbik->Kaik", R, turn) * (k > i)
    return H


def axis_turn(R: Array, goal: Array) -> Array:
    """Compute the rotation vector (2,), rad, that aligns the tool's z axis with the goal's z axis.

    The rotation is the shortest; the two numbers are its components along the tool's x and y axes.

    Parameters
    ----------
    R, goal : (3, 3) arrays
        Orientations of the tool and of the goal, both in the same frame, such as the base.
    """
    x, y, z = R.T.dot(goal[:, 2]).tolist()  # the goal's axis in tool axes
    sine = hypot(x, y)
    if sine < 1e-12 and z <= 0:  # opposite: half a turn in any direction
        return np.array([pi, 0.0])
    ratio = atan2(sine, z) / sine if sine else 1.0
    return np.array([-y * ratio, x * ratio])


def axis_turns(R: Array, goals: Array) -> Array:
    """Compute the rotation vectors (K, 2), rad, that align the z axes of tools with those of goals.

    R and ``goals`` (K, 3, 3) are the orientations of tools and goals in the same frame, such as the
    base. The two numbers are the components along the x and y axes of the tool. This is the
    orientation error of an axis task, which commands only the direction of the tool's z axis.
    """
    aim = np.einsum("Kab,Ka->Kb", R, goals[..., :, 2])  # the goal's axis in tool axes
    sine = np.hypot(aim[:, 0], aim[:, 1])
    angle = np.arctan2(sine, aim[:, 2])
    axis = np.stack([-aim[:, 1], aim[:, 0]], axis=-1)
    opposite = (sine < 1e-12) & (aim[:, 2] <= 0)  # half a turn in any direction
    axis[opposite], sine[opposite] = [1.0, 0.0], 1.0
    ratio = np.divide(angle, sine, out=np.ones_like(sine), where=sine != 0)
    return axis * ratio[:, None]


def rotation_vectors(R: Array) -> Array:
    """Compute the rotation vectors of rotations (K, 3, 3): (K, 3), rad, angles from 0 to π.

    The result is that of Pinocchio's ``log3`` for each rotation; near a half turn ``log3`` itself
    is called.
    """
    axis = 0.5 * (R[:, [2, 0, 1], [1, 2, 0]] - R[:, [1, 2, 0], [2, 0, 1]])  # sin(angle) times it
    sine = np.sqrt((axis**2).sum(axis=1))
    cosine = 0.5 * (R[:, 0, 0] + R[:, 1, 1] + R[:, 2, 2] - 1.0)
    angle = np.arctan2(sine, cosine)
    vectors = axis * np.divide(angle, sine, out=np.ones_like(sine), where=~(sine <= 1e-9))[:, None]
    for k in np.flatnonzero(cosine < -0.9):  # near half a turn the axis is lost in rounding
        vectors[k] = pin.log3(R[k])
    return vectors


def skew(omega: Array) -> Array:
    """Return the skew-symmetric matrices (K, 3, 3) of the cross products with ω (K, 3)."""
    x, y, z = omega[..., 0], omega[..., 1], omega[..., 2]
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(
        *omega.shape[:-1], 3, 3
    )


def is_rotation(R: Sequence[float]) -> bool:
    """Test whether ``R Rᵀ = I`` and ``det R = 1``, to 1e-6.

    Two rows must be orthonormal, and the third one their cross product. The test uses plain floats,
    which are fast, because every step of a control loop calls it.

    Parameters
    ----------
    R : 9 floats
        Entries of the matrix, by rows or by columns.
    """
    a, b, c, d, e, f, g, h, i = R
    return (
        -1e-6 < a * a + b * b + c * c - 1.0 < 1e-6
        and -1e-6 < d * d + e * e + f * f - 1.0 < 1e-6
        and -1e-6 < a * d + b * e + c * f < 1e-6
        and -1e-6 < b * f - c * e - g < 1e-6
        and -1e-6 < c * d - a * f - h < 1e-6
        and -1e-6 < a * e - b * d - i < 1e-6
    )


_LAST_ROW = (0.0, 0.0, 0.0, 1.0)

Placement: TypeAlias = pin.SE3 | ArrayLike
"""A rigid transform: pinocchio.SE3, or a homogeneous 4 × 4 array, m. For a task of several frames,
a sequence of one per frame."""


def as_placement(value: Placement, name: str = "target") -> pin.SE3:
    """Convert a rigid transform to a pinocchio.SE3.

    :func:`require_rotation` checks its rotation, which is not done here.

    Raises
    ------
    InputError
        If ``value`` is neither a pinocchio.SE3 nor a homogeneous 4 × 4 array; the message calls it
        ``name``.
    """
    if isinstance(value, pin.SE3):
        return value
    array = as_numbers(value)
    if array is None or array.shape != (4, 4):
        raise InputError(
            f"{name} must be a placement: a pinocchio.SE3, or a 4 × 4 array [R p; 0 1], p in m; "
            f"got {shown(value)}"
        )
    if not np.array_equal(array[3], _LAST_ROW):
        raise InputError(
            f"{name} is not a rigid transform: its last row is {row(array[3])}; "
            "give a 4 × 4 array with the last row (0, 0, 0, 1)"
        )
    return pin.SE3(array)


class Placements(tuple[pin.SE3, ...]):
    """Placements of F frames, as the target of a task of several frames: a tuple of pinocchio.SE3.

    Its attributes ``translation`` (3 F,) and ``homogeneous`` (4 F, 4) are named as those of a
    single pinocchio.SE3; it has no others.
    """

    @property
    def translation(self) -> Array:
        """Origins of all frames, one after the other: (3 F,), m."""
        return np.concatenate([each.translation for each in self])

    @property
    def homogeneous(self) -> Array:
        """Homogeneous matrices of all frames, one below the other: (4 F, 4).

        C code takes them in this form.
        """
        return np.concatenate([each.homogeneous for each in self])


def as_placements(values: Any, name: str, what: str) -> list[pin.SE3]:
    """Convert rigid transforms, a list or a (K, 4, 4) array, to a list of pinocchio.SE3.

    Error messages call a transform ``name`` with its index, and the whole list ``what``.
    """
    stack = isinstance(values, np.ndarray) and values.ndim == 3
    listed = list(values) if stack else list_of(values, f"{name}s", what)
    return [as_placement(value, f"{name} {k}") for k, value in enumerate(listed)]


def require_rotation(R: Array, name: str) -> None:
    """Raise InputError unless a matrix (3, 3) is a rotation to 1e-6.

    Raises
    ------
    InputError
        If the matrix is reflected, is not orthogonal, or has a number that is not finite; the
        message says which, and calls it the rotation of ``name``.
    """
    if is_rotation(R.ravel().tolist()):
        return
    if not np.isfinite(R).all():
        raise InputError(f"the rotation of {name} has a number that is not finite; correct it")
    off = float(np.abs(R @ R.T - np.eye(3)).max())
    reflected = off < 1e-5 and np.linalg.det(R) < 0
    why, remedy = f"R Rᵀ differs from I by {off:.2g}", "normalise R, so that R Rᵀ = I to 1e-6"
    if reflected:
        why, remedy = "it is reflected, with det R = −1", "reverse one of its axes"
    raise InputError(f"the rotation of {name} is not a rotation matrix: {why}", remedy=remedy)
