"""Joints between base and frame of a task as arrays, for computations in C."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arguments import Array, read_only
from ..native import CHAIN, filled_struct
from .task import Task

_MOST = 64
"""Maximum number of joints of a chain in C."""


@dataclass(frozen=True, eq=False)
@read_only
class _JointChain:
    """Serial chain of the P joints from the base to the frame of a task.

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
        ``θ = S q + offset``: positions θ of these joints, from the q of the task.
    """

    R: Array
    p: Array
    axes: Array
    revolute: NDArray[np.bool_]
    S: Array
    offset: Array


def joint_chain(task: Task) -> _JointChain:
    """Extract the serial chain of a task from its Pinocchio model."""
    model = task.model
    frame = model.frames[task._frame_id]
    joints = [int(j) for j in model.supports[frame.parentJoint] if j > 0]
    places = [*(model.jointPlacements[j] for j in joints), frame.placement]
    return _JointChain(
        np.array([place.rotation for place in places], order="C"),
        np.array([place.translation for place in places]),
        *joint_axes(model, joints),
        *joint_coupling(task, joints),
    )


def native_chain(task: Task) -> tuple[Any, list[NDArray[np.generic]]] | None:
    """Create the struct :data:`CHAIN` of a task, and the arrays that it points to.

    None if the chain has more than 64 joints, the most that chain.c has room for.
    """
    joints = joint_chain(task)
    if len(joints.axes) > _MOST:
        return None
    kind = {"pose": 0, "axis": 1}.get(task.kind, 2)
    return filled_struct(
        CHAIN,
        {"revolute": joints.revolute, "rows": task.rows},
        {name: getattr(joints, name) for name in ("R", "p", "S", "offset")}
        | {"axis": joints.axes},
        {"P": len(joints.axes), "n": task.n, "m": task.m, "kind": kind},
    )


def joint_axes(
    model: pin.Model, joints: Sequence[int]
) -> tuple[Array, NDArray[np.bool_]]:
    """Compute the axes (P, 3) of joints, each in its own frame, and which joints are revolute."""
    data = model.createData()
    neutral = pin.neutral(model)
    screws = np.array(
        [
            pin.computeJointJacobian(model, data, neutral, j)[:, model.idx_vs[j]]
            for j in joints
        ]
    ).reshape(-1, 6)
    revolute = np.linalg.norm(screws[:, 3:], axis=1) > 0.5
    return np.where(revolute[:, None], screws[:, 3:], screws[:, :3]), revolute


def joint_coupling(task: Task, joints: Sequence[int]) -> tuple[Array, Array]:
    """Find S (P, n) and the offset (P,) of ``θ = S q + offset``, the positions of joints."""
    rows = [j - 1 for j in joints]
    if task.drive is None:
        return np.eye(task.n)[rows], np.zeros(len(rows))
    return task.drive.S[rows], task.drive.offset[rows]
