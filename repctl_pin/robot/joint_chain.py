"""Joints between base and frame of a task as arrays, for computations in C."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arguments import Array, read_only
from .task import Task


@dataclass(frozen=True, eq=False)
@read_only
class JointChain:
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


def joint_chain(task: Task) -> JointChain:
    """Extract the serial chain of a task from its Pinocchio model."""
    model, data = task.model, task.model.createData()
    frame = model.frames[task._frame_id]
    path = [int(j) for j in model.supports[frame.parentJoint] if j > 0]
    neutral = pin.neutral(model)
    local = [
        pin.computeJointJacobian(model, data, neutral, j)[:, model.idx_vs[j]]
        for j in path
    ]
    turns = [bool(np.linalg.norm(xi[3:]) > 0.5) for xi in local]
    places = [*(model.jointPlacements[j] for j in path), frame.placement]
    rows = [j - 1 for j in path]
    S, offset = (np.eye(task.n), np.zeros(task.n))
    if task.drive is not None:
        S, offset = task.drive.S[rows], task.drive.offset[rows]
    return JointChain(
        np.array([place.rotation for place in places], order="C"),
        np.array([place.translation for place in places]),
        np.array(
            [xi[3:] if turn else xi[:3] for xi, turn in zip(local, turns, strict=True)]
        ),
        np.array(turns),
        S,
        offset,
    )
