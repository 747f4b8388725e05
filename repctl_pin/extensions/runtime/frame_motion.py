"""Motion of a frame as a polynomial in time: placement, twist and acceleration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ...arguments import Array
from .course import Course


class FrameMotion(NamedTuple):
    """Motion of a frame, polynomial in time of degree 5.

    ``φ(t) = Σ_k C[k] t^k`` are the coordinates of a :class:`Course`, relative to its beginning.

    Attributes
    ----------
    start : Course
        Course at t = 0, where φ = 0.
    C : (6, 6) array
        Coefficients of 1, t, …, t⁵, one row each.
    duration : float
        Duration, s.
    """

    start: Course
    C: Array
    duration: float

    def course(self, t: float) -> Course:
        """Evaluate the course at a time from 0 to the duration."""
        C = self.C
        phi = ((((C[5] * t + C[4]) * t + C[3]) * t + C[2]) * t + C[1]) * t
        return self.start.moved(phi)

    def placement(self, t: float) -> pin.SE3:
        """Evaluate the placement at a time from 0 to the duration."""
        return self.course(t).place

    def rates(self, t: float) -> tuple[Array, Array]:
        """Evaluate the velocity ξ (6,) in the coordinates of the course at t, and ξ̇."""
        C = self.C
        phi = ((((C[5] * t + C[4]) * t + C[3]) * t + C[2]) * t + C[1]) * t
        first = (((5 * C[5] * t + 4 * C[4]) * t + 3 * C[3]) * t + 2 * C[2]) * t + C[1]
        second = ((20 * C[5] * t + 12 * C[4]) * t + 6 * C[3]) * t + 2 * C[2]
        return self.start.rates(phi, first, second)


def change_of_acceleration(
    start: Course, twist: Array, rate: Array, later: Array, time: float
) -> FrameMotion:
    """Create a motion that begins with a twist and its derivative ``rate``, (6,) each.

    The derivative changes linearly and reaches ``later`` after ``time``, s.
    """
    C = np.zeros((6, 6))
    C[1], C[2], C[3] = twist, rate / 2, (later - rate) / (6 * time)
    return FrameMotion(start, C, time)


def brake(start: Course, twist: Array, rate: Array, time: float) -> FrameMotion:
    """Create a motion that brings a twist and its derivative ``rate`` to 0 in the time T.

    The twist is a cubic: ``ξ(u) = ξ₀ (1 − 3u² + 2u³) + T ξ̇₀ (u − 2u² + u³)``, u = t / T.
    """
    C = np.zeros((6, 6))
    C[1], C[2] = twist, rate / 2
    C[3] = -twist / time**2 - 2 * rate / (3 * time)
    C[4] = twist / (2 * time**3) + rate / (4 * time**2)
    return FrameMotion(start, C, time)


def landing(
    start: Course, twist: Array, rate: Array, way: Array, time: float
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


def straight(start: Course, way: Array) -> FrameMotion:
    """Create a motion over a displacement (6,) at a constant twist, which takes 1 s."""
    C = np.zeros((6, 6))
    C[1] = way
    return FrameMotion(start, C, 1.0)
