"""Motion of a frame as a polynomial in time: placement, twist and acceleration."""

from __future__ import annotations

from math import cos, sin, sqrt
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arguments import Array

_SERIES = 0.05
"""θ², rad², below which the coefficients of ω and ω̇ are evaluated by their series."""


class FrameMotion(NamedTuple):
    """Motion of a frame, polynomial in time of degree 5.

    ``p(t) = p₀ + φ_v(t)``, ``R(t) = exp(φ_ω(t)) R₀`` with ``φ(t) = Σ_k C[k] t^k``.

    Attributes
    ----------
    start : pinocchio.SE3
        Placement at t = 0, where φ = 0.
    C : (6, 6) array
        Coefficients of 1, t, …, t⁵, one row each: (v, ω), base axes.
    duration : float
        Duration, s.
    """

    start: pin.SE3
    C: Array
    duration: float

    def placement(self, t: float) -> pin.SE3:
        """Evaluate the placement at a time from 0 to the duration."""
        C = self.C
        phi = ((((C[5] * t + C[4]) * t + C[3]) * t + C[2]) * t + C[1]) * t
        return pin.SE3(
            pin.exp3(phi[3:]) @ self.start.rotation, self.start.translation + phi[:3]
        )

    def rates(self, t: float) -> tuple[Array, Array]:
        """Evaluate the twist ξ (6,) and its time derivative (6,), base axes."""
        C = self.C
        phi = ((((C[5] * t + C[4]) * t + C[3]) * t + C[2]) * t + C[1]) * t
        first = (((5 * C[5] * t + 4 * C[4]) * t + 3 * C[3]) * t + 2 * C[2]) * t + C[1]
        second = ((20 * C[5] * t + 12 * C[4]) * t + 6 * C[3]) * t + 2 * C[2]
        omega, alpha = _angular(phi[3:], first[3:], second[3:])
        return np.concatenate([first[:3], omega]), np.concatenate([second[:3], alpha])


def change_of_acceleration(
    start: pin.SE3, twist: Array, rate: Array, later: Array, time: float
) -> FrameMotion:
    """Create a motion that begins with a twist and its derivative ``rate``, (6,) each.

    The derivative changes linearly and reaches ``later`` after ``time``, s.
    """
    C = np.zeros((6, 6))
    C[1], C[2], C[3] = twist, rate / 2, (later - rate) / (6 * time)
    return FrameMotion(start, C, time)


def brake(start: pin.SE3, twist: Array, rate: Array, time: float) -> FrameMotion:
    """Create a motion that brings a twist and its derivative ``rate`` to 0 in the time T.

    The twist is a cubic: ``ξ(u) = ξ₀ (1 − 3u² + 2u³) + T ξ̇₀ (u − 2u² + u³)``, u = t / T.
    """
    C = np.zeros((6, 6))
    C[1], C[2] = twist, rate / 2
    C[3] = -twist / time**2 - 2 * rate / (3 * time)
    C[4] = twist / (2 * time**3) + rate / (4 * time**2)
    return FrameMotion(start, C, time)


def landing(
    start: pin.SE3, twist: Array, rate: Array, way: Array, time: float
) -> FrameMotion:
    """Create a motion that comes to rest after a displacement ``way`` (6,): quintic in time."""
    D = way - time * twist - time**2 / 2 * rate
    V, A = -twist - time * rate, -rate
    C = np.zeros((6, 6))
    C[1], C[2] = twist, rate / 2
    C[3] = (10 * D - 4 * time * V + time**2 / 2 * A) / time**3
    C[4] = (-15 * D + 7 * time * V - time**2 * A) / time**4
    C[5] = (6 * D - 3 * time * V + time**2 / 2 * A) / time**5
    return FrameMotion(start, C, time)


def straight(start: pin.SE3, way: Array) -> FrameMotion:
    """Create a motion over a displacement (6,) at a constant twist, which takes 1 s."""
    C = np.zeros((6, 6))
    C[1] = way
    return FrameMotion(start, C, 1.0)


def _angular(w: Array, w1: Array, w2: Array) -> tuple[Array, Array]:
    """Convert a rotation vector w and its derivatives w′ and w″ to ω and ω̇; θ = ‖w‖.

    ``ω = w′ + a w×w′ + b w×(w×w′)`` with ``a = (1 − cos θ)/θ²``, ``b = (θ − sin θ)/θ³``.
    """
    s = float(w @ w)
    if s < _SERIES:
        a = 1 / 2 - s / 24 + s**2 / 720 - s**3 / 40320
        b = 1 / 6 - s / 120 + s**2 / 5040 - s**3 / 362880
        a_s = -1 / 24 + s / 360 - s**2 / 13440
        b_s = -1 / 120 + s / 2520 - s**2 / 120960
    else:
        angle = sqrt(s)
        cosine, sinc = cos(angle), sin(angle) / angle
        a, b = (1 - cosine) / s, (1 - sinc) / s
        a_s = (sinc / 2 - a) / s
        b_s = (-(cosine - sinc) / (2 * s) - b) / s
    c1, c2 = _cross(w, w1), _cross(w, w2)
    cc1, cc2 = _cross(w, c1), _cross(w, c2)
    rate = 2 * float(w @ w1)
    omega = w1 + a * c1 + b * cc1
    alpha = w2 + a * c2 + b * (_cross(w1, c1) + cc2) + rate * (a_s * c1 + b_s * cc1)
    return omega, alpha


def _cross(x: Array, y: Array) -> Array:
    return np.array(
        [
            x[1] * y[2] - x[2] * y[1],
            x[2] * y[0] - x[0] * y[2],
            x[0] * y[1] - x[1] * y[0],
        ]
    )
