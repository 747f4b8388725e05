"""Orientation along a closed path: R(s), and ω(s) with ``dR/ds = [ω]× R``, base axes.

s runs from 0 to 1 along a cycle, so ω is in rad per cycle. Both functions take a single number s,
not an array.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import Array
from ..base.errors import InputError

_Turning = Callable[[float], Array]
"""Function of s in [0, 1] that returns R(s) (3, 3), or a vector (3,) such as ω(s)."""

_NODES = np.arange(7)
_WEIGHTS = np.array([np.linalg.inv(np.vander(_NODES - k, increasing=True))[1] for k in _NODES])
"""Row k: finite-difference weights of the first derivative at node k of seven nodes, sixth order;
one-sided unless k is 3."""

_WRAP = 24
"""Number of spline knots added before and after the cycle, to make the spline periodic; the ends of
the spline change it within the cycle by 0.27²⁴ ≈ 2e-14."""


def rotation_matrix(value: Any, what: str = "rotation") -> Array:
    """Convert a (3, 3) matrix or a scipy Rotation to a rotation matrix.

    ``what`` names the value in the error message.

    Raises
    ------
    InputError
        If the value is not a rotation: ``RᵀR = I``, ``det R = 1``.
    """
    try:
        R = np.array(value.as_matrix() if hasattr(value, "as_matrix") else value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        R = np.empty(0)
    off = np.abs(R.T @ R - np.eye(3)).max() if R.shape == (3, 3) else np.inf
    if not off < 1e-6 or np.linalg.det(R) < 0:
        if R.shape != (3, 3):
            fault = f"its shape is {R.shape}, not (3, 3)" if R.size else "it is no matrix"
        else:
            fault = "det R = −1" if off < 1e-6 else f"RᵀR differs from I by {off:.2g}"
        raise InputError(
            f"{what} must be a rotation matrix, but {fault}; "
            "give scipy's Rotation, for example Rotation.from_quat([qx, qy, qz, qw])"
        )
    return R if off < 1e-13 else pin.Quaternion(R).normalized().matrix()


def angular_velocity(rotation: _Turning, breaks: Sequence[float]) -> _Turning:
    """Create the function ω(s), (3,), rad per cycle, of an orientation R(s) by finite differences.

    A path uses the result if its user gives R(s) without ω(s). The differences, of sixth order, are
    those of log(R(s + e) R(s)ᵀ). They do not extend over ``breaks``, the values of s at which ω is
    discontinuous.
    """
    knots = np.array([0.0, *breaks, 1.0])
    piece = piece_finder(knots, np.diff(knots))

    def spin(s: float) -> Array:
        i, _ = piece(s)
        start, end = knots[i], knots[i + 1]
        e = min(2e-3, (end - start) / 8)
        k = max(min(3, int((s - start) / e)), int(np.ceil(6 - (end - s) / e)))
        here = rotation(s)
        turned = [
            pin.log3(rotation(float(x)) @ here.T) for x in np.clip(s + e * (_NODES - k), start, end)
        ]
        return _WEIGHTS[k] @ turned / e

    return spin


def piece_finder(knots: Array, widths: Array) -> Callable[[float], tuple[int, float]]:
    """Create the function s → (index i of the interval with s, ``(s − knots[i]) / widths[i]``).

    ``knots`` (P,) are the ends of the intervals, increasing, and ``widths`` (P − 1,) their lengths.
    A value s outside all intervals is assigned to the first or the last interval.
    """

    def piece(s: float) -> tuple[int, float]:
        i = int(np.clip(np.searchsorted(knots, s, side="right") - 1, 0, len(widths) - 1))
        return i, (s - knots[i]) / widths[i]

    return piece


def smooth_turning(
    knots: ArrayLike, rotations: Sequence[Array]
) -> tuple[_Turning, _Turning, Array]:
    """Interpolate orientations (P, 3, 3) at knots (P,) by a periodic cubic spline on SO(3).

    The knots increase from 0 to 1; the last orientation equals the first. If the orientations at
    both ends of an interval are equal, the spline is constant on this interval. At the ends of such
    an interval only ω is continuous; everywhere else the derivative of ω is, too.

    Returns
    -------
    rotation, spin
        The functions R(s) (3, 3) and ω(s) (3,).
    turns : (P,) array
        Upper bounds of the total rotation, rad, from the first knot to each knot.

    Raises
    ------
    InputError
        If two consecutive orientations differ by half a turn, whose direction is ambiguous.
    """
    s = np.asarray(knots, float)
    R = np.array(rotations)
    R[-1] = R[0]
    theta = np.array([pin.log3(a.T @ b) for a, b in pairwise(R)])  # (P − 1, 3)
    angles = np.linalg.norm(theta, axis=1)
    if (angles > np.pi - 1e-4).any():
        at = int(np.argmax(angles))
        raise InputError(
            f"the orientations of points {at + 1} and {at + 2} differ by half a turn, so the "
            "direction of rotation is ambiguous; add a point between them"
        )
    steps = np.diff(s)[:, None]
    cubic = _cubics(theta, _rates(s, R, angles < 1e-9), steps)
    piece = piece_finder(s, steps[:, 0])

    def rotation(x: float) -> Array:
        i, u = piece(x)
        return R[i] @ pin.exp3(np.array([u, u * u, u**3]) @ cubic[i])

    def spin(x: float) -> Array:
        i, u = piece(x)
        turn = pin.Jexp3(v := np.array([u, u * u, u**3]) @ cubic[i]) @ (
            np.array([1, 2 * u, 3 * u * u]) @ cubic[i]
        )
        return R[i] @ pin.exp3(v) @ turn / steps[i, 0]

    # |ω| ds ≤ |v′(u)| du, because no singular value of Jexp3 is above 1
    most = np.linalg.norm(cubic, axis=2) @ [1.0, 2.0, 3.0]
    return rotation, spin, np.concatenate([[0.0], np.cumsum(most)])


def _rates(s: Array, R: Array, held: NDArray[np.bool_]) -> Array:
    """Compute the angular velocities (P, 3) of a periodic spline through R (P, 3, 3) at s (P,).

    They are in rad per unit of s, in axes of the rotating frame. ``held`` (P − 1,) is True for
    intervals over which R does not change; at both ends of these, the velocities are set to 0.
    """
    from scipy.spatial.transform import Rotation, RotationSpline  # slow to import

    count = len(s) - 1
    k = np.arange(-_WRAP, count + _WRAP + 1)
    spline = RotationSpline(s[k % count] + k // count, Rotation.from_matrix(R[k % count]))
    rates = spline(s[:-1], 1)
    rates[held | np.roll(held, 1)] = 0.0
    return np.vstack([rates, rates[:1]])


def _cubics(theta: Array, rates: Array, steps: Array) -> Array:
    """Create the cubic v(u) of each interval, on which R(u) = R exp(v): (P - 1, 3, 3).

    The second axis has the coefficients of u, u² and u³; R is the orientation at the beginning of
    the interval, over which u runs from 0 to 1. ``theta`` (P − 1, 3) are the rotation vectors over
    the intervals, ``steps`` (P − 1, 1) their lengths in s, and ``rates`` (P, 3) the angular
    velocities at the knots, all in axes of the rotating frame.
    """
    begin = rates[:-1] * steps
    end = np.array(
        [pin.Jlog3(pin.exp3(t)) @ w for t, w in zip(theta, rates[1:] * steps, strict=True)]
    )
    return np.stack([begin, 3 * theta - 2 * begin - end, begin + end - 2 * theta], axis=1)


def facing(
    target: Array, point: _Turning, slope: _Turning, start: Array
) -> tuple[_Turning, _Turning, Callable[[float, float], float]]:
    """Create R(s), ω(s) and a bound on the rotation of a frame that always faces a point.

    ``point`` and ``slope`` are p(s), m, and dp/ds of the path, ``target`` is the point (3,), m, all
    in the base frame, and ``start`` is R(0). In the frame's axes, the direction of the point is
    constant: ``R(s) = T(d₀ → d(s)) R(0)``. Here d(s) is the unit vector from p(s) to the point,
    d₀ = d(0), and T is the shortest rotation from d₀ to d(s). With ḋ = dd/ds,
    ``ω = d × ḋ − (d₀ × d)·ḋ / (1 + d₀·d) d``.

    The third result is the function (s, length) → upper bound of the rotation, rad, over an arc of
    the path that begins at s and has at most this length, m.

    Raises
    ------
    InputError
        If the path passes through the point, or d(s) = −d₀ somewhere.
    """

    def direction(s: float) -> tuple[Array, float]:
        away = target - point(s)
        distance = float(np.linalg.norm(away))
        return away / max(distance, 1e-300), distance

    D = np.array([direction(float(s))[0] for s in np.linspace(0, 1, 257)])
    d0 = D[0]
    if (D @ d0 < -1 + 1e-3).any() or (np.einsum("ij,ij->i", D[1:], D[:-1]) < 0.5).any():
        raise InputError(
            f"the frame cannot face the point {target.tolist()}, m: the path passes through this "
            "point, or comes to the side of it that is opposite to the path's start, where the "
            "frame would have turned by 180°; choose a point farther from the path or, for a "
            "circle around the point, rotation='tangent'"
        )

    def rotation(s: float) -> Array:
        d = direction(s)[0]
        k = pin.skew(np.cross(d0, d))
        return (np.eye(3) + k + k @ k / (1 + d0 @ d)) @ start

    def spin(s: float) -> Array:
        d, distance = direction(s)
        ddot = -(np.eye(3) - np.outer(d, d)) @ slope(s) / distance
        return np.cross(d, ddot) - np.cross(d0, d) @ ddot / (1 + d0 @ d) * d

    def turn(s: float, length: float) -> float:
        return _most_turn(d0, *direction(s), length)

    return rotation, spin, turn


def _most_turn(d0: Array, d: Array, distance: float, length: float) -> float:
    """Bound the rotation, rad, of a frame that faces a point, along an arc of a length, m.

    At the beginning of the arc, the point is at ``distance``, m, in the direction d (3,); d₀ is its
    direction at s = 0. Along the arc, d turns by at most ``length / (distance − length)``, and
    ``|ω| ≤ |ḋ| / cos(θ/2)``, where θ is the angle from d₀ to d. The bound is infinite if the arc
    may reach the point, or θ may reach π.
    """
    if length >= distance:
        return np.inf
    swing = length / (distance - length)
    theta = np.arctan2(float(np.linalg.norm(np.cross(d0, d))), float(d0 @ d)) + swing
    return float(swing / np.cos(theta / 2)) if theta < np.pi else np.inf
