"""Bounds on how far each joint moves two bodies against each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arguments import Array
from .validate import Joint


def body_reach(
    model: pin.Model,
    joints: Mapping[str, Joint],
    joint: Sequence[int],
    place: Sequence[pin.SE3],
    bodies: Sequence[coal.CollisionGeometry],
    pairs: NDArray[np.intp],
) -> Array:
    """Bound how far the bodies of each pair move against each other: (P, N), m per rad or m.

    A pair's distance changes by at most ``reach @ |q − q'|`` from q to q', because it is
    1-Lipschitz in the points of its bodies. A revolute joint moves a point by at most its distance
    from the joint's origin; this is bounded along the chain from the joint to the body, so that it
    holds at every configuration within the limits of the prismatic joints.

    Parameters
    ----------
    model
        Model whose joints move the bodies; they have one coordinate each.
    joints
        Joints of the robot, by name.
    joint, place, bodies
        Parent joint of each body, 0 if it is fixed to the root; its placement there, and its shape.
    pairs
        Indices (P, 2) of the two bodies of each pair.
    """
    movers = [set(model.supports[j]) - {0} for j in joint]
    slides = {k: joints[name] for k, name in enumerate(tuple(model.names)[1:], 1)}
    reach = np.zeros((len(pairs), model.nq))
    for row, (a, b) in zip(reach, pairs.tolist(), strict=True):
        for body, other in ((a, b), (b, a)):
            far = float(np.linalg.norm(place[body].act(bodies[body].aabb_center)))
            far += float(bodies[body].aabb_radius)
            for j in sorted(movers[body] - movers[other], reverse=True):
                if slides[j].kind == "prismatic":
                    row[j - 1] = 1.0
                    far += _stroke(slides[j])
                else:
                    row[j - 1] = far
                far += float(np.linalg.norm(model.jointPlacements[j].translation))
    return reach


def _stroke(joint: Joint) -> float:
    """Bound the position of a prismatic joint, m; infinite for a mimic joint."""
    if joint.mimic is not None:
        return float(np.inf)
    return max(abs(joint.lower), abs(joint.upper))
