"""Conversion of target poses to arrays, from placements, matrices, or positions and quaternions.

Targets are the poses of the frame, relative to the base, at which a function q = F(x) is evaluated.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...base.arguments import Array
from ...base.errors import InputError
from ...model.chain_formulas import Placement, as_placements, require_rotation
from ...model.rotations import quaternion_matrices
from ...model.task import Task
from .geometry.cell_arguments import stacked

_UNIT = 1e-4
"""Maximum deviation of the norm of a quaternion from 1; quaternions are normalised."""

ROTATION = 1e-6
"""Tolerance of a rotation matrix, and of the last row of a homogeneous matrix."""

FORMS = (
    "a list of placements, an array of matrices (K, 4, 4), of positions with quaternions (K, 7), "
    "or of coordinates (K, k)"
)


def as_poses(task: Task, targets: Sequence[Placement] | Array) -> tuple[Array, Array]:
    """Convert K targets to positions (K, 3), m, and rotation matrices (K, 3, 3).

    Parameters
    ----------
    task
        The task. Rotation matrices are checked only if the task commands a rotation.
    targets : list of placements, (K, 4, 4) or (K, 7) array
        A placement is a pinocchio.SE3 or a homogeneous matrix (4, 4), as in an array (K, 4, 4). A
        row of seven is a position, m, and a quaternion: ``x, y, z, qx, qy, qz, qw``. Targets with
        numbers that are not finite are not checked; their results are not finite either.

    Raises
    ------
    InputError
        If ``targets`` has none of these forms, a matrix is not a rotation, or a quaternion does not
        have norm 1. The message names the target by its index, from 0.
    """
    array: Any = targets
    if isinstance(array, np.ndarray) and array.ndim == 2 and array.shape[1] == 7:
        return _of_quaternions(_floats(array))
    if isinstance(array, np.ndarray) and array.ndim == 3:
        return _of_matrices(task, _floats(array))
    return stacked(task, as_placements(array, "target", FORMS), "target")


def _floats(array: Array) -> Array:
    """Convert an array of targets to float; InputError unless it has real numbers."""
    if array.dtype.kind not in "fiu":
        raise InputError(f"targets must be real numbers; got an array of {array.dtype}")
    return array.astype(float)


def _of_quaternions(rows: Array) -> tuple[Array, Array]:
    """Convert rows (K, 7) to positions (K, 3), m, and rotation matrices (K, 3, 3).

    A row is a position, m, and a quaternion: x, y, z, qx, qy, qz, qw. An InputError is raised if a
    quaternion does not have norm 1. Rotations are NaN in rows with a number that is not finite.
    """
    finite = np.isfinite(rows).all(axis=1)
    length = np.linalg.norm(rows[:, 3:], axis=1)
    wrong = finite & (np.abs(length - 1) > _UNIT)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise InputError(
            f"the quaternion of target {at} has length {length[at]:.4g}, not 1",
            remedy="give x, y, z in m, then qx, qy, qz, qw, of length 1",
        )
    R = np.full((len(rows), 3, 3), np.nan)
    if finite.any():
        R[finite] = quaternion_matrices(rows[finite, 3:])
    return rows[:, :3], R


def _of_matrices(task: Task, X: Array) -> tuple[Array, Array]:
    """Convert homogeneous matrices X (K, 4, 4) to positions (K, 3), m, and rotations (K, 3, 3).

    An InputError is raised if the shape is wrong, a last row is not 0, 0, 0, 1, or a rotation
    matrix is not a rotation. Rotations are checked only if the task commands them.
    """
    if X.shape[1:] != (4, 4):
        raise InputError(f"targets must be {FORMS}; got an array of shape {X.shape}")
    p, R = X[:, :3, 3], X[:, :3, :3].copy()
    finite = np.isfinite(X).all(axis=(1, 2))
    R[~finite] = np.nan
    last = np.abs(X[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1, initial=0.0) > ROTATION
    if (last & finite).any():
        at = int(np.argmax(last & finite))
        raise InputError(f"the last row of target {at} must be 0, 0, 0, 1; got {X[at, 3].tolist()}")
    if task.kind in ("pose", "axis"):
        rows = np.flatnonzero(finite)
        squares = R[rows] @ np.swapaxes(R[rows], 1, 2)
        off = np.abs(squares - np.eye(3)).max(axis=(1, 2), initial=0.0)
        for k in rows[(off > ROTATION) | (np.linalg.det(R[rows]) < 0)]:
            require_rotation(R[k], f"target {k}")
    return p, R


def homogeneous(p: Array, R: Array) -> Array:
    """Join positions (K, 3), m, and rotations (K, 3, 3) to homogeneous matrices (K, 4, 4)."""
    X = np.empty((len(p), 4, 4))
    X[:, :3, 3], X[:, :3, :3], X[:, 3] = p, R, [0.0, 0.0, 0.0, 1.0]
    return X
