"""Joints between base and frame of a task as arrays, for computations in C.

``θ = S q + offset`` maps the positions q of the n independent joints to those of all joints, mimic
joints included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..base.arguments import Array, read_only
from ..native import ARM, filled_struct, point
from .model import frame_id, link_frames
from .several_frames import SeveralFrames, one_frame
from .task import Task

_MOST = 64
"""Maximum number of joints of a chain in C."""


@dataclass(frozen=True, eq=False)
@read_only
class JointChain:
    """Serial chain of the P joints from the base to the frame of a task, as plain arrays.

    Attributes
    ----------
    R, p : (P + 1, 3, 3) and (P + 1, 3) arrays
        Rotation and origin, m, of each joint relative to the previous one at position 0; last,
        those of the frame relative to the last joint.
    axes : (P, 3) array
        Unit vectors of the joint axes, each in the frame of its joint.
    revolute : (P,) array of bool
        False for prismatic joints.
    S, offset : (P, n) and (P,) arrays
        Map ``θ = S q + offset`` from the q of the task to the positions θ of these joints.
    """

    R: Array
    p: Array
    axes: Array
    revolute: NDArray[np.bool_]
    S: Array
    offset: Array


def joint_chain(task: Task) -> JointChain:
    """Extract the serial chain of a task from its Pinocchio model, as plain arrays.

    InputError is raised for a task of several frames.
    """
    model = one_frame(task, "a joint chain").model
    frame = model.frames[task._frame_id]
    joints = [int(j) for j in model.supports[frame.parentJoint] if j > 0]
    places = [*(model.jointPlacements[j] for j in joints), frame.placement]
    return JointChain(
        np.array([place.rotation for place in places], order="C"),
        np.array([place.translation for place in places]),
        *joint_axes(model, joints),
        *joint_coupling(task, joints),
    )


@dataclass(frozen=True, eq=False)
@read_only
class CarriedFrame:
    """Frame of a robot: the joints that move it, and its placement on the last of them.

    Attributes
    ----------
    chain : (P,) array of int
        Indices of the joints between the root and the frame; none for a frame on the root.
    R, p : (3, 3) and (3,) arrays
        Placement of the frame on the last joint of its chain.
    """

    chain: NDArray[np.intp]
    R: Array
    p: Array


@dataclass(frozen=True, eq=False)
@read_only
class _JointTree:
    """Tree of all N joints that a task moves, also on side branches, from the base outward.

    The animation page moves the whole arm with this tree, including links that are not on the chain
    to the frame.

    Attributes
    ----------
    parents : (N,) array of int
        Index of the joint before each joint; −1 for a joint on the base.
    R, p, axes, revolute, S, offset
        As in :class:`JointChain`, with N joints; R and p are relative to the joint before.
    frames : tuple of CarriedFrame
        The task's frames.
    base : CarriedFrame or None
        The link relative to which the frames are controlled; None for the root.
    first : (n,) array of int
        Index of the first joint that each entry of q drives. With one frame, only joints on the
        path to the frame count.
    riding : dict of str to int
        Index of the joint that carries each link; −1 for a link fixed to the base.
    """

    parents: NDArray[np.intp]
    R: Array
    p: Array
    axes: Array
    revolute: NDArray[np.bool_]
    S: Array
    offset: Array
    frames: tuple[CarriedFrame, ...]
    base: CarriedFrame | None
    first: NDArray[np.intp]
    riding: dict[str, int]


def joint_tree(task: Task) -> _JointTree:
    """Extract the tree of the joints that a task moves; the robot's base is its root.

    Unlike a chain, the tree includes branches beside the frames, whose links also move and are
    drawn. Its root is the robot's, also if frames are controlled relative to another link.
    """
    model, drive = task.bodies_model()
    base = task.robot.base
    first = np.argmax(drive.S != 0, axis=0)
    if not isinstance(task, SeveralFrames):
        first = np.array([model.getJointId(task.model.names[j]) - 1 for j in task._first])
    joints = list(range(1, model.njoints))
    places = [model.jointPlacements[j] for j in joints]
    return _JointTree(
        np.array([model.parents[j] - 1 for j in joints]),
        np.array([place.rotation for place in places]),
        np.array([place.translation for place in places]),
        *joint_axes(model, joints),
        drive.S,
        drive.offset,
        tuple(_carried(model, name) for name in task.frames),
        None if base is None else _carried(model, base),
        first,
        {name: one.parentJoint - 1 for name, one in link_frames(model).items()},
    )


def _carried(model: pin.Model, name: str) -> CarriedFrame:
    frame = model.frames[frame_id(model, name)]
    chain = [j - 1 for j in model.supports[frame.parentJoint] if j > 0]
    placement = frame.placement
    return CarriedFrame(np.array(chain, int), placement.rotation, placement.translation)


def native_chain(task: Task) -> tuple[Any, list[NDArray[np.generic]]] | None:
    """Create the struct :data:`ARM` of a task without potentials, and the arrays it points to.

    The joint frames are turned so that each joint moves about or along its own z axis. None if the
    chain has more than 64 joints, the maximum of arm.c. Control loops, bounds and integration in C
    all use it.
    """
    if isinstance(task, SeveralFrames):
        return _native_frames(task)
    chain = joint_chain(task)
    joints = len(chain.axes)
    if max(joints, task.n) > _MOST:
        return None
    R, p = along_z(chain)
    sizes = {"n": task.n, "m": task.m, "joints": joints, "frames": 1}
    coupled = not np.array_equal(chain.S, np.eye(task.n)) or chain.offset.any()
    return filled_struct(
        ARM,
        {"revolute": chain.revolute, "bent": _bent(R[1:]), "rows": task.rows},
        {
            "R": R,
            "p": p,
            "S": chain.S,
            "offset": chain.offset,
            "lower": task.lower,
            "upper": task.upper,
        },
        sizes | {"kind": {"pose": 0, "axis": 1}.get(task.kind, 2), "coupled": int(coupled)},
    )


def _native_frames(task: SeveralFrames) -> tuple[Any, list[NDArray[np.generic]]] | None:
    """Create the struct :data:`ARM` of several frames, with a struct for the chain of each.

    Returns the same as :func:`native_chain`; None if one of the chains has too many joints for C.
    """
    made = [native_chain(part) for part in task.parts]
    frames = [each[0] for each in made if each is not None]
    if len(frames) < len(made):
        return None
    arm, held = filled_struct(
        ARM,
        {},
        {"lower": task.lower, "upper": task.upper},
        {"n": task.n, "m": task.m, "frames": len(frames)},
    )
    point(arm, "frame", frames)
    return arm, held


def along_z(chain: JointChain) -> tuple[Array, Array]:
    """Turn the frames of the joints, so that each joint moves about or along its own z axis.

    Each frame is also turned about its z axis, which commutes with the motion of its joint, so that
    the next frame is rotated relative to it about x only, unless the two z axes are parallel.
    Products with such rotations need fewer operations in C.

    Returns
    -------
    R, p : (P + 1, 3, 3) and (P + 1, 3) arrays
        Rotation and origin of each frame relative to the previous one: of the P joints, and of the
        task's frame.
    """
    B = [np.eye(3), *map(_z_along, chain.axes), np.eye(3)]
    for j in range(1, len(chain.axes)):
        turn = B[j].T @ chain.R[j] @ B[j + 1]
        if np.hypot(turn[2, 0], turn[2, 1]) > _ALONG:  # x across both z axes
            about = _about_z(turn[2, 1], -turn[2, 0])
            about = about if (turn @ about)[0, 0] > 0 else about @ np.diag([-1, -1, 1])
        else:
            about = _about_z(turn[0, 0], -np.sign(turn[2, 2]) * turn[1, 0])
        B[j + 1] = B[j + 1] @ about
    turned = np.array(B)
    back = turned[:-1].swapaxes(1, 2)
    R = back @ chain.R @ turned[1:]
    R[np.abs(R) < _ROUNDING] = 0.0
    return R, np.einsum("jik,jk->ji", back, chain.p)


_ALONG, _ROUNDING = 1e-6, 1e-15
"""Sine of the angle of two axes below which they count as parallel here, and maximum rounding error
of a rotation's entry that is 0."""


def _about_z(x: float, y: float) -> Array:
    """Compute the rotation (3, 3) about z by the angle of (x, y), which must not be (0, 0)."""
    c, s = np.array([x, y]) / np.hypot(x, y)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _bent(R: Array) -> NDArray[np.int_]:
    """Classify rotations (P, 3, 3): 2 for a quarter turn about x, 1 for others about x, else 0.

    C multiplies by rotations of kinds 1 and 2 with fewer operations. Most arms have only these.
    """
    about_x = (R[:, 0] == [1, 0, 0]).all(axis=1) & (R[:, :, 0] == [1, 0, 0]).all(axis=1)
    return np.where(about_x, np.where(R[:, 1, 1] == 0, 2, 1), 0)


def _z_along(axis: Array) -> Array:
    """Compute a rotation (3, 3) whose third column is a given unit vector.

    Along the axes x, y and z, its entries are exactly 0, 1 and −1.
    """
    axis = np.where(np.abs(axis) < 1e-15, 0.0, axis) + 0.0
    k = int(np.argmax(np.abs(axis)))
    other = np.eye(3)[(k + 1) % 3]
    x = other - (other @ axis) * axis
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


def joint_axes(model: pin.Model, joints: Sequence[int]) -> tuple[Array, NDArray[np.bool_]]:
    """Compute the axes (P, 3) of joints, each in its own frame, and which joints are revolute (P,).

    ``joints`` are ids of the model. Axes are unit vectors, of rotation or of translation.
    """
    data = model.createData()
    neutral = pin.neutral(model)
    screws = np.array(
        [pin.computeJointJacobian(model, data, neutral, j)[:, model.idx_vs[j]] for j in joints]
    ).reshape(-1, 6)
    revolute = np.linalg.norm(screws[:, 3:], axis=1) > 0.5
    return np.where(revolute[:, None], screws[:, 3:], screws[:, :3]), revolute


def joint_coupling(task: Task, joints: Sequence[int]) -> tuple[Array, Array]:
    """Find S (P, n) and the offset (P,) of ``θ = S q + offset``, the positions of joints.

    ``joints`` are ids of the task's model. S is the identity, and the offset 0, without mimic
    joints.
    """
    rows = [j - 1 for j in joints]
    return task.drive.S[rows], task.drive.offset[rows]
