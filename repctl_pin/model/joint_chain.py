"""Joints between base and frame of a task as arrays, for computations in C.

``θ = S q + offset`` maps the positions q of the n independent joints to those of all joints, mimic
joints included.

``JointChain`` is the serial chain of joints from the base to the frame of a task, as arrays.
``_JointTree`` is the tree of all joints that a task moves, as arrays. ``CarriedFrame`` is a frame
of a robot: the joints that move it, and its placement after the last of them. ``SeveralFrames`` is
the task of controlling several frames of a robot, stacked. ``ARM`` is the C struct of a task: its
chain, limits and, if given, potentials and a region.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

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
        Rotation and origin, m, of each joint at position 0 relative to the previous joint; the last
        entry is that of the frame relative to the last joint.
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
    """Frame of a robot in a :class:`_JointTree`: the joints that move it, and its placement.

    Attributes
    ----------
    chain : array of int
        Indices, in the tree, of the joints from the root to the frame; empty for a frame that is
        fixed to the root.
    R, p : (3, 3) and (3,) arrays
        Rotation and origin, m, of the frame relative to the last joint of its chain, or the root.
    """

    chain: NDArray[np.intp]
    R: Array
    p: Array


@dataclass(frozen=True, eq=False)
@read_only
class _JointTree:
    """Tree of all N joints that a task moves, also on side branches, from the root outward.

    The animation page moves all links of the robot with this tree, not only those on the chain to
    the frame.

    Attributes
    ----------
    parents : (N,) array of int
        Index of the joint before each joint; −1 for a joint on the root.
    R, p : (N, 3, 3) and (N, 3) arrays
        Rotation and origin, m, of each joint at position 0 relative to the joint before.
    axes, revolute : (N, 3) array and (N,) array of bool
        Unit vectors of the joint axes, each in the frame of its joint; False for prismatic joints.
    S, offset : (N, n) and (N,) arrays
        Map ``θ = S q + offset`` from the q of the task to the positions θ of the N joints.
    frames : tuple of CarriedFrame
        The task's frames.
    base : CarriedFrame or None
        The link relative to which the frames are controlled; None for the root.
    first : (n,) array of int
        Index, in the tree, of one joint that each entry of q drives: the joint itself, or one that
        mimics it. For a task of one frame, it is the first one on the path from the base to the
        frame; for several frames, the one with the lowest index.
    riding : dict of str to int
        Index of the joint that carries each link, by link name; −1 for a link fixed to the root.
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
    """Extract the tree of all joints that a task moves, on any branch of the robot.

    Its root is the root link of the URDF, even if frames are controlled relative to another link.
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
    """Create the struct :data:`ARM` of a task, without potentials, for the native library.

    Return the struct, and the list of arrays that it points to, which must live as long as the
    struct. Return None if a chain has more than 64 joints, the maximum of arm.c. Each joint moves
    about or along the z axis of its frame.
    """
    if isinstance(task, SeveralFrames):
        return _native_frames(task)
    chain, R, p = _chain_along_z(task)
    joints = len(chain.axes)
    if max(joints, task.n) > _MOST:
        return None
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


_chains: WeakKeyDictionary[Task, tuple[JointChain, Array, Array]] = WeakKeyDictionary()


def _chain_along_z(task: Task) -> tuple[JointChain, Array, Array]:
    """Return the chain of a task, and the result of :func:`along_z` for this chain.

    That result is R (P + 1, 3, 3) and p (P + 1, 3), m, of the turned frames; the chain returned is
    not turned. All three are computed once per task, because a study makes several controllers of
    one task, each with a struct of its own.
    """
    if task not in _chains:
        chain = joint_chain(task)
        _chains[task] = (chain, *along_z(chain))
    return _chains[task]


def _native_frames(task: SeveralFrames) -> tuple[Any, list[NDArray[np.generic]]] | None:
    """Create one struct :data:`ARM` that contains the struct of each of several frames.

    Return the struct, and the list of arrays that it points to, which must live as long as the
    struct. Return None if a chain has more than 64 joints, the maximum of arm.c.
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
    """Turn the joint frames of a chain, so that each joint moves about or along its own z axis.

    Each frame is also turned about its z axis, so that the next frame is rotated relative to it
    about x only, unless the two z axes are parallel. Products with such rotations need fewer
    operations in C.

    Returns
    -------
    R, p : (P + 1, 3, 3) and (P + 1, 3) arrays
        Rotation and origin, m, of each frame relative to the previous one; the last entry is that
        of the task's frame.
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
    """Compute the rotation (3, 3) about z from the x axis to the vector (x, y), not (0, 0)."""
    c, s = np.array([x, y]) / np.hypot(x, y)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _bent(R: Array) -> NDArray[np.int_]:
    """Classify rotations (P, 3, 3), as integers (P,): 2, 1 or 0.

    2 is a quarter turn about x, in either direction. 1 is the identity or another rotation about x.
    0 is any other rotation. C multiplies by rotations of classes 2 and 1 with fewer operations.
    """
    about_x = (R[:, 0] == [1, 0, 0]).all(axis=1) & (R[:, :, 0] == [1, 0, 0]).all(axis=1)
    return np.where(about_x, np.where(R[:, 1, 1] == 0, 2, 1), 0)


def _z_along(axis: Array) -> Array:
    """Compute a rotation (3, 3) whose third column is a given unit vector.

    If the vector is along x, y or z, all entries are exactly 0, 1 or −1.
    """
    axis = np.where(np.abs(axis) < 1e-15, 0.0, axis) + 0.0
    k = int(np.argmax(np.abs(axis)))
    other = np.eye(3)[(k + 1) % 3]
    x = other - (other @ axis) * axis
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


def joint_axes(model: pin.Model, joints: Sequence[int]) -> tuple[Array, NDArray[np.bool_]]:
    """Compute the unit axes (P, 3) of joints, and a mask (P,) of the revolute ones.

    ``joints`` are P ids of the model. An axis, of rotation or of translation, is in the frame of
    its joint.
    """
    data = model.createData()
    neutral = pin.neutral(model)
    screws = np.array(
        [pin.computeJointJacobian(model, data, neutral, j)[:, model.idx_vs[j]] for j in joints]
    ).reshape(-1, 6)
    revolute = np.linalg.norm(screws[:, 3:], axis=1) > 0.5
    return np.where(revolute[:, None], screws[:, 3:], screws[:, :3]), revolute


def joint_coupling(task: Task, joints: Sequence[int]) -> tuple[Array, Array]:
    """Return S (P, n) and the offset (P,) of ``θ = S q + offset``, the positions of P joints.

    ``joints`` are their ids in the task's model.
    """
    rows = [j - 1 for j in joints]
    return task.drive.S[rows], task.drive.offset[rows]
