"""Helpers for Pinocchio models: frames by name, placements, locked joints, chains, Jacobians.

Frames and joints are given by their ids, Pinocchio's indices into ``model.frames`` and
``model.joints``. A link is a frame of type BODY.

``Shape`` is a shape of a URDF as plain data: its kind, size, link and place, or its mesh file.
``Description`` is the content of a validated URDF as plain data. ``Joint`` is a joint of a URDF as
plain data: its kind, links, axis, limits and mimic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
import pinocchio as pin

from ..base.arguments import Array
from ..base.errors import unknown
from .shapes import Shape
from .urdf import Description, Joint

SHARED = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

_TEMPORARY = "\N{NULL} link"


def frame_id(model: pin.Model, name: str) -> int:
    """Return the id of a frame by name; a link takes precedence over a joint of the same name.

    InputError is raised for an unknown name. Pinocchio's own lookup is not used: for an unknown
    name it returns an id that causes a crash later, and it fails if a joint and a link share a
    name.
    """
    ids = link_ids(model)
    if name not in ids:
        ids = {f.name: i for i, f in reversed(list(enumerate(model.frames)))}
    if name not in ids:
        raise unknown("frame", name, link_frames(model))
    return ids[name]


def link_ids(model: pin.Model) -> dict[str, int]:
    """Return the frame ids of all links, by link name.

    A frame of another type, such as a joint, can have the same name.
    """
    body = pin.FrameType.BODY
    return {f.name: i for i, f in enumerate(model.frames) if f.type == body}


def link_frames(model: pin.Model) -> dict[str, pin.Frame]:
    """Return the frames of all links, by link name."""
    return {name: model.frames[i] for name, i in link_ids(model).items()}


def frame_placements(model: pin.Model, ids: Iterable[int], Q: Array, base: int = 0) -> Array:
    """Compute the placements of F frames at every row of Q (T, N): (T, F, 4, 4), m.

    ``ids`` are the ids of the F frames, and ``base`` is that of the frame relative to which they
    are placed, by default the root. Q has a value per joint of the model.
    """
    frames = [model.frames[i] for i in ids]
    if not len(Q):
        return np.empty((0, len(frames), 4, 4))
    data = model.createData()
    root = model.frames[base]
    carriers = _carriers(model, Q)
    joints, which = np.unique(
        np.array([carriers[frame.parentJoint] for frame in frames], int), return_inverse=True
    )
    pin.forwardKinematics(model, data, Q[0])

    def on_joint(j: int, frame: pin.Frame) -> Array:
        parent = frame.parentJoint
        moved = pin.SE3.Identity() if parent == j else data.oMi[j].actInv(data.oMi[parent])
        return (moved * frame.placement).homogeneous

    on_carrier = list(map(on_joint, joints[which].tolist(), frames))
    placed = np.empty((len(Q), len(joints), 4, 4))
    for q, row in zip(Q, placed, strict=True):
        pin.forwardKinematics(model, data, q)
        to_base = (data.oMi[root.parentJoint] * root.placement).inverse()
        for place, j in zip(row, joints.tolist(), strict=True):
            place[:] = (to_base * data.oMi[j]).homogeneous
    return placed[:, which] @ np.array(on_carrier).reshape(-1, 4, 4)


def _carriers(model: pin.Model, Q: Array) -> list[int]:
    """Find, for each joint of the model, the joint that carries it while the rows of Q change.

    The carrier is the last joint, on the way from the root to the joint itself, whose value differs
    between rows of Q (T, N), or 0, the root. The joint is at rest relative to it.
    """
    changing = {0, *(np.flatnonzero(np.ptp(Q, axis=0)) + 1).tolist()}
    carriers: list[int] = []
    for joint, parent in enumerate(model.parents):
        carriers.append(joint if joint in changing else carriers[parent])
    return carriers


def origin(solid: Shape) -> pin.SE3:
    """Compute the placement of a shape relative to its link, from its xyz, m, and rpy, rad."""
    return pin.SE3(pin.rpy.rpyToMatrix(np.array(solid.rpy)), np.array(solid.xyz))


def fixed_placements(description: Description) -> dict[str, pin.SE3]:
    """Compute the placements of all links relative to the root, by link name.

    ``description`` is a URDF without moving joints, such as that of the surroundings.
    """
    return {
        name: frame.placement
        for name, frame in link_frames(pin.buildModelFromXML(description.xml)).items()
    }


def lock_joints(model: pin.Model, ids: Sequence[int], q: Array) -> pin.Model:
    """Build a model without the joints ``ids``, which stay as in the configuration q (N,).

    Pinocchio looks up locked joints by name among all frames and raises if a link has the name of a
    joint, so such links are renamed temporarily."""
    joints = {f.name for f in model.frames if f.type != pin.FrameType.BODY}
    links = [f for f in model.frames if f.type == pin.FrameType.BODY and f.name in joints]
    for link in links:
        link.name += _TEMPORARY
    try:
        reduced = pin.buildReducedModel(model, list(ids), np.array(q))
    finally:
        for link in links:
            link.name = link.name.removesuffix(_TEMPORARY)
    for frame in reduced.frames:
        frame.name = frame.name.removesuffix(_TEMPORARY)
    return reduced


def frame_jacobian(model: pin.Model, data: pin.Data, frame: int) -> Callable[[Array], Array]:
    """Create the function q → Jacobian (6, N) of a frame: rows of v, then of ω, in root axes.

    v is the velocity of the frame's origin. N is the number of the model's joints. The function
    computes in ``data``, so that each thread needs ``data`` and a function of its own.
    """
    evaluate = pin.computeFrameJacobian

    def jacobian(q: Array) -> Array:
        return evaluate(model, data, q, frame, SHARED)

    def single(q: Array) -> Array:  # Pinocchio returns (6,)
        return jacobian(q).reshape(6, 1)

    return jacobian if model.nv != 1 else single


def path_between(model: pin.Model, base: int, frame: int) -> tuple[list[int], list[int]]:
    """List the ids of the joints on the path from one frame to another, as (up, down).

    ``up`` leads from the frame ``base`` up to the common ancestor, and ``down`` from there down to
    the frame ``frame``.
    """
    up, down = (
        [int(j) for j in model.supports[model.frames[f].parentJoint] if j > 0]
        for f in (base, frame)
    )
    shared = set(up) & set(down)
    return [j for j in reversed(up) if j not in shared], [j for j in down if j not in shared]


def chain_between(
    model: pin.Model, base: int, frame: int, joints: Mapping[str, Joint]
) -> tuple[pin.Model, int]:
    """Build the serial chain from one frame of a tree to another, with the first one fixed.

    A joint that is traversed from child to parent moves in reverse: ``(P E(q))⁻¹ = E(−q) P⁻¹``,
    with P its placement in its parent and E(q) its motion. Its axis is reversed in the chain, so
    every joint keeps its name and the sign of its q.

    Parameters
    ----------
    model
        Model in which only the joints on the path change the relative placement of the frames.
    base, frame
        Ids of the frames.
    joints
        Joints of the model, by name.

    Returns
    -------
    A model without masses, whose root is the frame ``base``, and the id of ``frame`` in it.
    """
    up, down = path_between(model, base, frame)
    chain = pin.Model()
    at = 0
    here = model.frames[base].placement.inverse()
    chain.name = model.name
    for j in up:
        at = _append(chain, at, here, joints[model.names[j]], -1.0)
        here = model.jointPlacements[j].inverse()
    for j in down:
        at = _append(chain, at, here * model.jointPlacements[j], joints[model.names[j]], 1.0)
        here = pin.SE3.Identity()
    end = model.frames[frame]
    return chain, chain.addFrame(
        pin.Frame(end.name, at, 0, here * end.placement, pin.FrameType.BODY)
    )


def _append(chain: pin.Model, parent: int, placement: pin.SE3, joint: Joint, sign: float) -> int:
    kind = (
        pin.JointModelPrismaticUnaligned
        if joint.kind == "prismatic"
        else pin.JointModelRevoluteUnaligned
    )
    return int(chain.addJoint(parent, kind(sign * np.array(joint.axis)), placement, joint.name))
