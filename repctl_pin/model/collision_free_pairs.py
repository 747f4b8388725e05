"""Branch-and-bound proof that two bodies with one or two joints between them never collide."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arguments import Array
from .rules import NO_LIMIT
from .validate import Joint

_JOINTS = 2
"""Maximum number of joints between two bodies."""

_BOXES = 1000
"""Maximum number of boxes of joint positions per pair."""

_BEYOND = 0.05
"""Distance beyond the joint limits up to which a proof holds, rad or m."""


class CollisionFreePairs:
    r"""Proofs that pairs of bodies collide at no position of the joints between them.

    Let d be the distance of two bodies at the centre of a box of joint positions with half-widths
    w, and let joint j move the points of the bodies by at most ρ_j per rad, or m. If d > Σ ρ_j w_j,
    there is no collision in the box; else the box is split.

    Parameters
    ----------
    model
        Model whose joints move the bodies.
    joints
        Joints of the model, by name.
    shapes
        Geometry model with the bodies and their pairs.
    distance
        Function that bounds the distance of a pair from below at the model's joints (N,); 0 or less
        if it may collide.
    """

    def __init__(
        self,
        model: pin.Model,
        joints: dict[str, Joint],
        shapes: pin.GeometryModel,
        distance: Callable[[int, Array], float],
    ) -> None:
        self._model = model
        self._shapes = shapes
        self._distance = distance
        self._bodies = list(shapes.geometryObjects)
        kinds = [joints[name] for name in tuple(model.names)[1:]]
        self._slides = [False, *(joint.kind == "prismatic" for joint in kinds)]
        self._low, self._high = (
            np.array([_range(joint) for joint in kinds]).reshape(-1, 2).T
        )

    def proved(self, pair: int) -> bool:
        """Try to prove that the two bodies of a pair, given by its index, never collide.

        False if it is not proved: they may collide, more than two joints or one without limits lie
        between them, or the search takes too many boxes.
        """
        ends = self._shapes.collisionPairs[pair]
        reach = self.reach(ends.first, ends.second)
        moving = np.array(sorted(reach), np.intp) - 1
        low = self._low[moving]
        high = self._high[moving]
        if len(moving) > _JOINTS or not np.isfinite(high - low).all():
            return False
        return self._free(
            pair, moving, low, high, np.array([reach[j] for j in sorted(reach)])
        )

    def reach(self, body: int, other: int | None) -> dict[int, float]:
        """Bound how far the points of a body move against another one, m, per rad or m of a joint.

        ``other`` is None for a body that stands still. Returns the bounds by joint id.
        """
        one = self._carriers(body)
        if other is None:
            return self._reach(sorted(one), body)
        beyond = self._carriers(other)
        found = self._reach(sorted(one - beyond), body)
        return found | self._reach(sorted(beyond - one), other)

    def _free(
        self, pair: int, moving: NDArray[np.intp], low: Array, high: Array, reach: Array
    ) -> bool:
        q = pin.neutral(self._model)
        boxes = [((low + high) / 2, (high - low) / 2)]
        looked = 0
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
        """Return the ids of the joints that move a body, given by its index."""
        return {
            int(j)
            for j in self._model.supports[self._bodies[body].parentJoint]
            if j > 0
        }

    def _reach(self, way: Sequence[int], body: int) -> dict[int, float]:
        """Bound how far a body's points move, m, per rad or m of each joint in ``way``.

        ``way`` lists the ids of the joints from the common ancestor of both bodies outwards to this
        one. Returns the bounds by joint id.
        """
        shape = self._bodies[body]
        found = {}
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
    """Return the range of joint positions (lower, upper) over which a proof is made, rad or m.

    It is the range between the limits, slightly enlarged. A mimic joint's own limits are not used,
    because its leader may move it beyond them: a full turn if it is revolute, infinite otherwise.
    """
    turns = joint.kind != "prismatic"
    if turns and (joint.mimic is not None or joint.upper - joint.lower > 2 * np.pi):
        return -np.pi, np.pi
    if joint.mimic is not None or max(abs(joint.lower), abs(joint.upper)) > NO_LIMIT:
        return -np.inf, np.inf
    return joint.lower - _BEYOND, joint.upper + _BEYOND


def _split(middle: Array, half: Array, reach: Array) -> list[tuple[Array, Array]]:
    """Halve a box of joint positions along the joint that moves the bodies most.

    Boxes are given by centre and half-widths; both halves are returned.
    """
    at = np.zeros(len(half))
    widest = int(np.argmax(reach * half))
    at[widest] = half[widest] / 2
    smaller = half.copy()
    smaller[widest] /= 2
    return [(middle - at, smaller), (middle + at, smaller)]
