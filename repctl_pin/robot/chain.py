"""The joints between two links of a tree, and the serial chain they make."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from ..urdf.gate import Joint


def path_between(model: pin.Model, base: int, frame: int) -> tuple[list[int], list[int]]:
    """List the joints from the base's frame up to where the two branches meet, and from there down to the other."""
    up, down = ([int(j) for j in model.supports[model.frames[f].parentJoint] if j > 0] for f in (base, frame))
    shared = set(up) & set(down)
    return [j for j in reversed(up) if j not in shared], [j for j in down if j not in shared]


def seen_from(model: pin.Model, base: int, frame: int, joints: Mapping[str, Joint]) -> tuple[pin.Model, int]:
    """Make the serial chain from one frame of a tree to another, with the first one held still.

    A joint that is passed from its child to its parent turns about its axis the other way:
    ``(P E(q))⁻¹ = E(−q) P⁻¹``, with P its placement. Joint i of the chain keeps its name and the sign of its q.

    Parameters
    ----------
    model
        Whose joints on the path are the only ones that move the two frames against each other.
    base, frame
        Ids of the frames.
    joints
        The joints of the model, by name.

    Returns
    -------
    A model that has kinematics only, and the id of the frame in it.
    """
    up, down = path_between(model, base, frame)
    chain, at, here = pin.Model(), 0, model.frames[base].placement.inverse()
    chain.name = model.name
    for j in up:
        at = _append(chain, at, here, joints[model.names[j]], -1.0)
        here = model.jointPlacements[j].inverse()
    for j in down:
        at = _append(chain, at, here * model.jointPlacements[j], joints[model.names[j]], 1.0)
        here = pin.SE3.Identity()
    end = model.frames[frame]
    return chain, chain.addFrame(pin.Frame(end.name, at, 0, here * end.placement, pin.FrameType.BODY))


def _append(chain: pin.Model, parent: int, placement: pin.SE3, joint: Joint, sign: float) -> int:
    kind = pin.JointModelPrismaticUnaligned if joint.kind == "prismatic" else pin.JointModelRevoluteUnaligned
    return int(chain.addJoint(parent, kind(sign * np.array(joint.axis)), placement, joint.name))
