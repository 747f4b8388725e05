"""Around oddities of Pinocchio: finding a frame by name, holding joints still, the Jacobian of a single joint."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..errors import unknown

SHARED = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

_MEANWHILE = "\N{NULL} link"


def frame_id(model: pin.Model, name: str) -> int:
    """Find a frame by name, links before joints.

    Pinocchio itself answers an unknown name with a number that later crashes it, and raises on a name
    that a joint and a link share.
    """
    ids = {f.name: i for i, f in reversed(list(enumerate(model.frames)))}
    ids |= {f.name: i for i, f in enumerate(model.frames) if f.type == pin.FrameType.BODY}
    if name not in ids:
        raise unknown("frame", name, [f.name for f in model.frames if f.type == pin.FrameType.BODY])
    return ids[name]


def lock_joints(model: pin.Model, ids: Sequence[int], posture: NDArray[np.float64]) -> pin.Model:
    """Build the reduced model, some joints held at a posture.

    Pinocchio looks locked joints up by name among all frames and raises where a link has a joint's name, so
    such links go by another name meanwhile.
    """
    joints = {f.name for f in model.frames if f.type != pin.FrameType.BODY}
    links = [f for f in model.frames if f.type == pin.FrameType.BODY and f.name in joints]
    for link in links:
        link.name += _MEANWHILE
    try:
        reduced = pin.buildReducedModel(model, list(ids), np.array(posture))
    finally:
        for link in links:
            link.name = link.name.removesuffix(_MEANWHILE)
    for frame in reduced.frames:
        frame.name = frame.name.removesuffix(_MEANWHILE)
    return reduced


def frame_jacobian(
    model: pin.Model, data: pin.Data, frame: int
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Make the function q → a frame's Jacobian (6, nv), world axes, into Pinocchio's own memory."""
    evaluate = pin.computeFrameJacobian

    def jacobian(q: NDArray[np.float64]) -> NDArray[np.float64]:
        return evaluate(model, data, q, frame, SHARED)

    def single(q: NDArray[np.float64]) -> NDArray[np.float64]:  # Pinocchio gives (6,)
        return jacobian(q).reshape(6, 1)

    return jacobian if model.nv != 1 else single
