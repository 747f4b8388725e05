"""Straight lines of a frame: in space, or in the coordinates of a cell."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin, sqrt
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
import pinocchio as pin

from ...arguments import Array, read_only
from ...model.chain_formulas import axis_turn
from ...model.task import Task

_SERIES = 0.05
"""θ², rad², below which the coefficients of ω and ω̇ are evaluated by their series."""


class Course(Protocol):
    """Placement of a frame, and the coordinates φ (6,) in which it moves on straight lines.

    Attributes
    ----------
    place : pinocchio.SE3
        Placement, where φ = 0.
    bounded : bool
        True if the coordinates have bounds.
    """

    @property
    def place(self) -> pin.SE3: ...

    @property
    def bounded(self) -> bool: ...

    def at(self, q: Array) -> Course:
        """Return the course at a configuration q (n,) next to this one."""
        ...

    def moved(self, phi: Array) -> Course:
        """Return the course at coordinates φ (6,)."""
        ...

    def rates(self, phi: Array, first: Array, second: Array) -> tuple[Array, Array]:
        """Convert φ and its derivatives φ′ and φ″ to the velocity ξ (6,) of the course at φ, and ξ̇.

        ξ is the velocity in that course's own coordinates.
        """
        ...

    def way(self, target: pin.SE3) -> Array:
        """Compute the coordinates φ (6,) of a target, or of the nearest placement inside."""
        ...

    def holds(self, target: pin.SE3) -> bool:
        """Test whether a target lies inside the range of the coordinates."""
        ...

    def task_rates(self) -> Array:
        """Evaluate the task velocity ẋ per unit of each coordinate: (m, 6)."""
        ...

    def velocity(self, rate: Array) -> Array:
        """Convert a task velocity ẋ (m,) to a velocity ξ (6,) in the coordinates."""
        ...


@dataclass(frozen=True)
class FreeCourse:
    """Course in space: ``p = p₀ + φ_v``, ``R = exp(φ_ω) R₀``; ξ is the twist (v, ω) of the frame.

    Attributes
    ----------
    task : Task
        The task.
    place : pinocchio.SE3
        Placement (R₀, p₀).
    """

    task: Task
    place: pin.SE3
    bounded: ClassVar[bool] = False

    def at(self, q: Array) -> FreeCourse:
        """Return the course at a configuration q (n,)."""
        return FreeCourse(self.task, self.task.placement(q))

    def moved(self, phi: Array) -> FreeCourse:
        """Return the course at coordinates φ (6,)."""
        R = pin.exp3(phi[3:]) @ self.place.rotation
        return FreeCourse(self.task, pin.SE3(R, self.place.translation + phi[:3]))

    def rates(self, phi: Array, first: Array, second: Array) -> tuple[Array, Array]:
        """Convert φ and its derivatives to the twist ξ (6,) and ξ̇, base axes."""
        omega, alpha = _angular(phi[3:], first[3:], second[3:])
        return np.concatenate([first[:3], omega]), np.concatenate([second[:3], alpha])

    def way(self, target: pin.SE3) -> Array:
        """Compute the displacement (6,) to a target, 0 in what the task does not control."""
        error, here = np.zeros(6), self.place
        error[:3] = target.translation - here.translation
        if self.task.kind == "pose":
            error[3:] = pin.log3(target.rotation @ here.rotation.T)
            return error
        if self.task.kind == "axis":
            turn = axis_turn(here.rotation, target.rotation)
            error[3:] = here.rotation[:, :2] @ turn
            return error
        return self.velocity(error[self.task.rows])

    def holds(self, _target: pin.SE3) -> bool:
        """Return True: the coordinates have no bounds."""
        return True

    def task_rates(self) -> Array:
        """Evaluate the task velocity ẋ per unit of the twist: (m, 6)."""
        if self.task.kind != "axis":
            return np.eye(6)[self.task.rows]
        rates = np.zeros((5, 6))
        rates[:3, :3], rates[3:, 3:] = np.eye(3), self.place.rotation[:, :2].T
        return rates

    def velocity(self, rate: Array) -> Array:
        """Convert ẋ (m,) to a twist (6,), 0 in what the task does not control."""
        return np.asarray(self.task_rates().T @ rate, float)


@runtime_checkable
class _PoseBox(Protocol):
    """Region of placements that is a box in coordinates y (m,) of its own, such as a cell.

    Attributes
    ----------
    task : Task
        The task, with m coordinates.
    """

    @property
    def task(self) -> Task: ...

    def _course_y(self, place: pin.SE3) -> Array:
        """Compute the coordinates y (m,) of a placement."""
        ...

    def _course_place(self, y: Array) -> pin.SE3:
        """Compute the placement at coordinates y (m,)."""
        ...

    def _course_rates(self, y: Array, R: Array) -> Array:
        """Evaluate ∂x/∂y (m, m), the task velocity per unit of y; R is the frame's rotation."""
        ...

    def _course_bounds(self) -> tuple[Array, Array]:
        """Return the smallest and the largest y (m,) of the box."""
        ...

    def _course_holds(self, place: pin.SE3) -> bool:
        """Test whether a placement lies in the box."""
        ...


@dataclass(frozen=True, eq=False)
@read_only
class _BoxCourse:
    """Course in a cell: ``y = y₀ + φ`` are the cell's coordinates, followed by zeros; ``ξ = ẏ``.

    A box is convex in y, so the straight line between two of its placements does not leave it.

    Attributes
    ----------
    box : PoseBox
        The cell.
    y : (6,) array
        Coordinates y₀ of the placement.
    place : pinocchio.SE3
        Placement.
    """

    box: _PoseBox
    y: Array
    place: pin.SE3
    bounded: ClassVar[bool] = True

    def at(self, q: Array) -> _BoxCourse:
        """Return the course at a configuration q (n,), whose y are next to those of this one."""
        place = self.box.task.placement(q)
        y = self._padded(self.box._course_y(place))
        turns = np.rint((y - self.y) / (2 * np.pi))
        return _BoxCourse(self.box, y - 2 * np.pi * turns, place)

    def moved(self, phi: Array) -> _BoxCourse:
        """Return the course at coordinates φ (6,)."""
        y = self.y + phi
        return _BoxCourse(self.box, y, self.box._course_place(y[: self.box.task.m]))

    def rates(self, _phi: Array, first: Array, second: Array) -> tuple[Array, Array]:
        """Return φ′ and φ″ (6,)."""
        return first, second

    def way(self, target: pin.SE3) -> Array:
        """Compute the coordinates φ (6,) of a target, or of the nearest placement in the box."""
        lower, upper = self.box._course_bounds()
        nearest = np.clip(self.box._course_y(target), lower, upper)
        return self._padded(nearest) - self.y

    def holds(self, target: pin.SE3) -> bool:
        """Test whether a target lies in the box."""
        return self.box._course_holds(target)

    def task_rates(self) -> Array:
        """Evaluate the task velocity ẋ per unit of each coordinate: (m, 6)."""
        m = self.box.task.m
        E = self.box._course_rates(self.y[:m], self.place.rotation)
        return np.pad(E, ((0, 0), (0, 6 - m)))

    def velocity(self, rate: Array) -> Array:
        """Convert ẋ (m,) to ẏ (6,), 0 in coordinates of width 0."""
        E = self.task_rates()[:, : len(rate)]
        lower, upper = self.box._course_bounds()
        return self._padded(np.where(lower < upper, np.linalg.solve(E, rate), 0.0))

    def _padded(self, y: Array) -> Array:
        return np.pad(y, (0, 6 - len(y)))


def course_of(task: Task, region: object, q: Array) -> Course:
    """Return the course at a configuration q (n,): in the region's coordinates, if it has some."""
    free = FreeCourse(task, task.placement(q))
    if not isinstance(region, _PoseBox):
        return free
    y = region._course_y(free.place)
    return _BoxCourse(region, np.pad(y, (0, 6 - len(y))), free.place)


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
