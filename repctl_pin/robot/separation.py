"""Proof by branch and bound that two bodies never touch, where one joint or two move them against
each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arguments import Array
from ..urdf.checks import NO_LIMIT
from ..urdf.validate import Joint

_JOINTS = 2
"""Joints between two bodies, at most."""

_BOXES = 1000
"""Boxes of joint positions that are looked at, at most, for a pair."""

_BEYOND = 0.05
"""How far beyond the limits a proof holds, rad or m."""


class Separation:
    r"""Asks of pairs of bodies whether any position of the joints between them makes them touch.

    At the middle of a box of joint positions with half-widths w, the distance is d. If a joint
    moves the points of a body by at most ρ per rad, or m, there is no touch in the box where d > Σ
    ρ_j w_j; else the box is split.

    Parameters
    ----------
    model
        Whose joints carry the bodies.
    joints
        Its joints, by name.
    shapes
        The bodies, and the pairs of them.
    distance
        Measures a pair at the model's joints (N,); at most what it is, and 0 or less where it may
        touch.
    """

    def __init__(
        self,
        model: pin.Model,
        joints: dict[str, Joint],
        shapes: pin.GeometryModel,
        distance: Callable[[int, Array], float],
    ) -> None:
        self._model, self._shapes, self._distance = model, shapes, distance
        self._bodies = list(shapes.geometryObjects)
        kinds = [joints[name] for name in tuple(model.names)[1:]]
        self._slides = [False, *(joint.kind == "prismatic" for joint in kinds)]
        self._low, self._high = np.array([_range(joint) for joint in kinds]).reshape(-1, 2).T

    def proved(self, pair: int) -> bool:
        """Say whether it is proved that the two bodies of a pair never touch."""
        ends = self._shapes.collisionPairs[pair]
        one, other = (self._carriers(body) for body in (ends.first, ends.second))
        ways = [(one - other, ends.first), (other - one, ends.second)]
        reach = {j: r for way, body in ways for j, r in self._reach(sorted(way), body).items()}
        moving = np.array(sorted(reach), np.intp) - 1
        low, high = self._low[moving], self._high[moving]
        if len(moving) > _JOINTS or not np.isfinite(high - low).all():
            return False
        return self._free(pair, moving, low, high, np.array([reach[j] for j in sorted(reach)]))

    def _free(
        self, pair: int, moving: NDArray[np.intp], low: Array, high: Array, reach: Array
    ) -> bool:
        q, boxes, looked = pin.neutral(self._model), [((low + high) / 2, (high - low) / 2)], 0
        while boxes:
            middle, half = boxes.pop()
            looked += 1
            q[moving] = middle
            distance = self._distance(pair, q)
            if distance <= 0 or looked > _BOXES:
                return False
            if distance <= reach @ half:
                boxes += _split(middle, half, reach)
        return True

    def _carriers(self, body: int) -> set[int]:
        """The joints that carry a body."""
        return {int(j) for j in self._model.supports[self._bodies[body].parentJoint] if j > 0}

    def _reach(self, way: Sequence[int], body: int) -> dict[int, float]:
        """How far each joint on the way to a body moves its points, at most, per rad or m."""
        shape, found = self._bodies[body], {}
        far = float(
            np.linalg.norm(shape.placement.act(shape.geometry.aabb_center))
            + shape.geometry.aabb_radius
        )
        for j in reversed(way):
            if self._slides[j]:
                far += max(abs(self._low[j - 1]), abs(self._high[j - 1]))
            found[j] = 1.0 if self._slides[j] else far
            far += float(np.linalg.norm(self._model.jointPlacements[j].translation))
        return found


def _range(joint: Joint) -> tuple[float, float]:
    """Positions of a joint; any where it follows another, whose limits may not keep it inside its
    own."""
    turns = joint.kind != "prismatic"
    if turns and (joint.mimic is not None or joint.upper - joint.lower > 2 * np.pi):
        return -np.pi, np.pi
    if joint.mimic is not None or max(abs(joint.lower), abs(joint.upper)) > NO_LIMIT:
        return -np.inf, np.inf
    return joint.lower - _BEYOND, joint.upper + _BEYOND


def _split(middle: Array, half: Array, reach: Array) -> list[tuple[Array, Array]]:
    """Halve a box where it matters most."""
    at = np.zeros(len(half))
    widest = int(np.argmax(reach * half))
    at[widest] = half[widest] / 2
    smaller = half.copy()
    smaller[widest] /= 2
    return [(middle - at, smaller), (middle + at, smaller)]
