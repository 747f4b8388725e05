"""Columns of a relabelled recording: those of its file, with new joints and poses.

Columns that depend on the old joints, such as velocities or actions, would contradict the new ones
and are removed; those of the gripper, of cameras and of times stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ...base.arguments import Array
from ...base.tables import Column
from ..cells.targets import homogeneous
from .joint_log import words_of
from .recording import JOINTS, POSES, POSITION, QUATERNION, Recording, forward

_OF_JOINTS = frozenset(
    """
    joint joints qpos qvel qacc q dq ddq qd qdd qdot vel velocity velocities acc acceleration
    accelerations effort efforts torque torques tau action actions command commands cmd state
    """.split()  # noqa: SIM905
)
"""Words in the name of a column that depends on the joints."""

_OF_HAND = frozenset(
    """
    gripper finger fingers hand ee eef tcp tool cartesian twist image
    """.split()  # noqa: SIM905
)
"""Words in the name of a column that does not depend on the joints of the arm."""


class Columns(NamedTuple):
    """Columns of a relabelled recording, as they are written to a file.

    Attributes
    ----------
    made : dict of str to (K, …) array
        The columns, by name.
    removed : tuple of str
        Names of columns of the file that are left out, because they belong to the old joints.
    recomputed : tuple of str
        Names of columns of the pose that are computed from the new joints.
    """

    made: dict[str, Column]
    removed: tuple[str, ...] = ()
    recomputed: tuple[str, ...] = ()


def relabeled_columns(recording: Recording, Q: Array) -> Columns:
    """Make the columns of a recording with new configurations Q (K, n).

    Other columns of its file are kept, unless they depend on the recorded joints. Rows of Q that
    are NaN, where the cell's function has no value, keep their recorded pose.
    """
    task, old = recording.task, recording.joints
    joints = dict(zip(task.joint_names, Q.T, strict=True))
    p, R = _poses(recording, Q)
    X = np.concatenate([p, Rotation.from_matrix(R).as_quat()], axis=1)
    poses = dict(zip(POSITION + QUATERNION, X.T, strict=True))
    if recording.source is None:
        return Columns(_beside(recording) | poses | joints)
    source, lost = recording.source.columns, np.isnan(Q[:, 0])
    arrays = {3: p, 7: X, 16: homogeneous(p, R)}
    for name in POSES:
        size = np.size(source[name][0]) if name in source else 0
        if size in arrays:
            poses[name] = arrays[size]
    made = dict[str, Column]()
    removed, recomputed = list[str](), list[str]()
    for name, values in source.items():
        if name in joints:
            made[name] = joints[name]
        elif old is not None and _begins_with(values, old):
            made[name] = np.concatenate([Q, values[:, task.n :]], axis=1)
        elif name in poses and task.m < 6:
            made[name] = poses[name].reshape(values.shape).copy()
            made[name][lost] = values[lost]
            recomputed.append(name)
        elif old is not None and _of_old_joints(name, task.joint_names):
            removed.append(name)
        else:
            made[name] = values
    if not (set(joints) <= set(made) or any(name in made for name in JOINTS)):
        made |= joints
    return Columns(made, tuple(removed), tuple(recomputed))


def _begins_with(values: Column, old: Array) -> bool:
    """Test whether the first columns of an array of a file are the recorded configurations (K, n).

    Further columns, such as a gripper's, are then kept beside the new ones.
    """
    return values.ndim == 2 and np.array_equal(values[:, : old.shape[1]], old)


def _of_old_joints(name: str, joints: Sequence[str]) -> bool:
    """Test by its name whether a column depends on the recorded joints, and is to be removed.

    It does if it contains the name of a joint, or a word such as ``action``, ``qvel`` or
    ``velocity``, and no word of the hand or the gripper.
    """
    rest = words_of(name, joints)
    held = rest != words_of(name, ())
    return held or bool(rest & _OF_JOINTS and not rest & _OF_HAND)


def _poses(recording: Recording, Q: Array) -> tuple[Array, Array]:
    """Compute positions (K, 3) and rotations (K, 3, 3) at new configurations Q (K, n).

    A pose task keeps the recorded poses; other tasks leave a part of the pose free, which changes
    with the configuration.
    """
    p, R = recording.positions.copy(), recording.rotations.copy()
    found = np.isfinite(Q[:, 0])
    if recording.task.m < 6:
        p[found], R[found] = forward(recording.task, Q[found])
    return p, R


def _beside(recording: Recording) -> dict[str, Column]:
    """Make the columns of time and session of a recording that was not read from a file.

    They stand beside the new joints in the file that is written; those that it lacks are left out.
    """
    columns = dict[str, Column]()
    if recording.times is not None:
        columns["time"] = recording.times
    if len(recording.names) > 1:
        columns["session"] = np.array(recording.names, dtype=object)[recording.session]
    return columns
