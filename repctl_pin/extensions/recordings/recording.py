"""Recorded frames of an arm, by session and time: joints, poses of the frame, or both.

A frame is one row of a recording; *the* frame of a task is the link whose poses they are. A session
is one run of the recorder, such as a demonstration. Large arrays are worked on in blocks of rows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from ...base.arguments import (
    Array,
    as_configurations,
    as_numbers,
    file_name,
    freeze,
    read_only,
    shown,
)
from ...base.errors import InputError
from ...base.tables import Column, Table, read_table
from ...model.several_frames import one_frame
from ...model.task import Task, require_task
from ..cells.geometry.kinematics import placed
from ..cells.targets import homogeneous
from .checks import (
    require_agreement,
    require_increasing,
    require_limits,
    require_metres,
    require_radians,
)

_CHUNK = 2**14
"""Number of rows of a block."""

_LENGTH, _ROTATION = 1e-2, 1e-2
"""Tolerances for the length of a quaternion, and for the singular values of a rotation matrix.

They may deviate from 1 by this much; both are normalised.
"""

POSITION, QUATERNION = ("x", "y", "z"), ("qx", "qy", "qz", "qw")
JOINTS = ("joints", "q", "qpos", "observation.state")
POSES = ("poses", "pose")
_NAMES = {
    "joints": JOINTS,
    "poses": POSES,
    "times": ("time", "t", "timestamp", "times"),
    "sessions": ("session", "episode", "episode_index", "strategy", "sessions"),
}
"""Names of the columns of a file, by the argument of :class:`Recording` that they become."""


@dataclass(frozen=True, eq=False, init=False)
@read_only
class Recording:
    """Frames of one or several recorded sessions: joints, poses of the frame, or both.

    Rows are checked: finite, in m and rad, times that increase, and joints whose forward kinematics
    agrees with the poses.

    Parameters
    ----------
    task
        The task, whose frame the poses are of.
    joints : (K, n) array, optional
        Joint positions, rad or m.
    poses : (K, 4, 4), (K, 7) or (K, 3) array, optional
        Homogeneous matrices; positions with quaternions, ``x, y, z, qx, qy, qz, qw``; or, for a
        task that leaves the rotation free, positions, m. By default, they are computed from the
        joints.
    times : (K,) array, optional
        Time of each frame, s.
    sessions : sequence, optional
        Number or name of each frame's session, (K,); by default, all frames are of one.

    Attributes
    ----------
    positions, rotations : (K, 3) and (K, 3, 3) arrays
        Poses of the frame relative to the base, m.
    session : (K,) array of int
        Number of each frame's session, from 0.
    names : tuple of str
        Names of the sessions.

    Raises
    ------
    InputError
        If neither joints nor poses are given, a shape is wrong, or the numbers look like another
        unit, order, frame or base; the message says which.

    Examples
    --------
    >>> Q = q0 + 0.05 * np.sin(np.arange(300.0))[:, None] * [1, 1, -1]  # rad
    >>> recording = rp.Recording(task, joints=Q, times=0.01 * np.arange(300))  # s
    >>> recording.positions.shape
    (300, 3)
    """

    task: Task
    joints: Array | None
    positions: Array
    rotations: Array
    times: Array | None
    session: Column
    names: tuple[str, ...]
    source: Table | None

    def __init__(
        self,
        task: Task,
        *,
        joints: ArrayLike | None = None,
        poses: ArrayLike | None = None,
        times: ArrayLike | None = None,
        sessions: Sequence[object] | ArrayLike | None = None,
    ) -> None:
        task = one_frame(require_task(task), "a recording")
        if joints is None and poses is None:
            raise InputError("a recording needs joints= or poses=")
        if any(given is not None and not np.size(given) for given in (joints, poses)):
            raise InputError("a recording needs at least one frame")
        Q = None if joints is None else as_configurations(joints, task.n, "a recording")
        if Q is not None:
            require_radians(task, Q)
        if poses is None:
            assert Q is not None
            require_limits(task, Q)
            p, R = forward(task, Q)
        else:
            p, R = _poses(task, poses)
            require_metres(task, p)
        size = len(p)
        if Q is not None and len(Q) != size:
            raise InputError(
                f"there are {len(Q)} rows of joints, but {size} poses",
                remedy="give one pose per row of joints",
            )
        if Q is not None and poses is not None:
            seven = as_numbers(poses)
            quaternions = seven is not None and seven.ndim == 2
            require_agreement(task, Q, p, R, quaternions=quaternions)
            require_limits(task, Q)
        names, session = _sessions(sessions, size)
        t = None if times is None else _times(times, size)
        if t is not None:
            require_increasing(t, session, split=len(names) > 1)
        freeze(
            self,
            task=task,
            joints=Q,
            positions=p,
            rotations=R,
            times=t,
            session=session,
            names=names,
            source=None,
        )

    @classmethod
    def read(cls, file: str | Path, task: Task) -> Recording:
        """Read a recording from a .csv, .npz or .parquet file.

        Columns are found by name:

        - joints: one column per joint of the task, or an array ``joints``, ``q``, ``qpos`` or
          ``observation.state``, whose first n numbers are taken
        - poses: ``x, y, z, qx, qy, qz, qw``, or an array ``poses``
        - time: ``time``, ``t`` or ``timestamp``
        - session: ``session`` or ``episode``

        Parquet requires pyarrow.

        Parameters
        ----------
        file
            The file.
        task
            Task; the poses are those of its frame.

        Raises
        ------
        InputError
            If the file cannot be read, has no such columns, or its numbers are refused; the message
            names the line.
        """
        task = one_frame(require_task(task), "a recording")
        path = file_name(file)
        table = read_table(path)
        try:
            made = cls(task, **_arguments(table, task))
        except InputError as error:
            where = table.line(error.at) if isinstance(error.at, int) else str(path)
            raise InputError(f"{where}: {error}", at=error.at) from None
        freeze(made, source=table)
        return made

    def __len__(self) -> int:
        """Count the frames."""
        return len(self.positions)

    @property
    def homogeneous(self) -> Array:
        """Poses as matrices: (K, 4, 4)."""
        return homogeneous(self.positions, self.rotations)

    def __repr__(self) -> str:
        what = "joints" if self.joints is not None else "poses"
        count = len(self.names)
        return f"<Recording of {self.task!s}: {what} of {len(self)} frames, sessions: {count}>"


def thinned(recording: Recording, most: int) -> Recording:
    """Select at most ``most`` frames of a recording, evenly spaced in their order.

    For steps of which the time, but not the result, grows with the number of frames.
    """
    some = np.linspace(0, len(recording) - 1, min(most, len(recording))).astype(int)
    other = object.__new__(Recording)
    values = vars(recording)
    arrays = {n: value[some] for n, value in values.items() if isinstance(value, np.ndarray)}
    freeze(other, **values | arrays)
    return other


def forward(task: Task, Q: Array) -> tuple[Array, Array]:
    """Compute positions (K, 3), m, and rotations (K, 3, 3) at configurations Q (K, n)."""
    p, R = in_blocks(lambda part: placed(task, part)[:2], Q)
    return p, R


def in_blocks(function: Callable[..., Any], *arrays: Array) -> Any:
    """Evaluate a function of the rows of arrays block by block, to keep its memory small.

    The function takes a block of rows of each array, and returns an array or a tuple of arrays with
    as many rows. The blocks are joined, so the result is that of one call on all rows.
    """
    parts = [function(*(values[at] for values in arrays)) for at in blocks(len(arrays[0]))]
    if isinstance(parts[0], tuple):
        return tuple(map(np.concatenate, zip(*parts, strict=True)))
    return np.concatenate(parts)


def blocks(count: int) -> list[slice]:
    """Split ``count`` rows into blocks of at most 16384; return their slices, in order."""
    return [slice(i, min(i + _CHUNK, count)) for i in range(0, count, _CHUNK)]


def _poses(task: Task, poses: ArrayLike) -> tuple[Array, Array]:
    X = as_numbers(poses)
    shapes = [(4, 4), (7,)] if task.kind.turns else [(4, 4), (7,), (3,)]
    if X is None or X.shape[1:] not in shapes:
        forms = " or ".join(f"(K, {', '.join(map(str, shape))})" for shape in shapes)
        got = shown(poses) if X is None else f"shape {X.shape}"
        raise InputError(f"must be numbers {forms}; got {got}", argument="poses")
    wrong = ~np.isfinite(X.reshape(len(X), -1)).all(axis=1)
    if wrong.any():
        raise InputError("a pose is not finite", at=int(np.argmax(wrong)))
    if X.ndim == 3:
        return X[:, :3, 3], _rotations(X[:, :3, :3])
    if X.shape[1] == 3:
        R = task.placement(np.array(task.reference)).rotation
        return X, np.tile(R, (len(X), 1, 1))
    length = np.linalg.norm(X[:, 3:], axis=1)
    wrong = np.abs(length - 1) > _LENGTH
    if wrong.any():
        at = int(np.argmax(wrong))
        raise InputError(
            f"a quaternion has length {length[at]:.3g}, not 1",
            remedy="give x, y, z in m, then qx, qy, qz, qw, of length 1",
            at=at,
        )
    return X[:, :3].copy(), Rotation.from_quat(X[:, 3:]).as_matrix()


def _rotations(R: Array) -> Array:
    """Project matrices (K, 3, 3) onto the nearest rotations, to remove rounding of a file.

    Raises InputError if a singular value is off 1 by more than 0.01, or a matrix is a reflection.
    """
    U, s, Vt = np.linalg.svd(R)
    made = U @ Vt
    wrong = (np.abs(s - 1).max(axis=1) > _ROTATION) | (np.linalg.det(made) < 0)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise InputError(
            f"a rotation is none: R Rᵀ differs from I, or det R = {np.linalg.det(R[at]):.2g}",
            remedy="give homogeneous matrices",
            at=at,
        )
    return np.asarray(made, float)


def _sessions(given: Any, size: int) -> tuple[tuple[str, ...], Column]:
    if given is None:
        return ("1",), np.zeros(size, np.int64)
    try:
        labels = np.asarray(given)
        labels = labels.astype(str) if labels.dtype.kind in "OU" else labels
    except (TypeError, ValueError):
        labels = np.empty(0)
    if labels.shape != (size,) or labels.dtype.kind not in "biufU":
        raise InputError(
            f"must be {size} numbers or names, one per frame; got {shown(given)}",
            argument="sessions",
        )
    values, inverse = np.unique(labels, return_inverse=True)
    number = "{:.15g}" if labels.dtype.kind == "f" else "{}"  # 0 of a CSV file, not 0.0
    return tuple(map(number.format, values.tolist())), inverse.astype(np.int64)


def _times(given: ArrayLike, size: int) -> Array:
    t = as_numbers(given)
    if t is None or t.shape != (size,):
        raise InputError(
            f"must be {size} numbers, s, one per frame; got {shown(given)}", argument="times"
        )
    if not np.isfinite(t).all():
        raise InputError("a time is not finite", at=int(np.argmin(np.isfinite(t))))
    return t


def _arguments(table: Table, task: Task) -> dict[str, Any]:
    """Find the arguments of :class:`Recording` among the columns of a table, by their names.

    Returns joints, poses, times and sessions by these names, each None if the file has none.
    InputError is raised if there are neither joints nor poses, or only some of the joints.
    """
    columns = table.columns
    found: dict[str, Any] = {
        argument: next((columns[name] for name in names if name in columns), None)
        for argument, names in _NAMES.items()
    }
    joints, poses = found["joints"], found["poses"]
    missing = [name for name in task.joint_names if name not in columns]
    if not missing:
        found["joints"] = _stacked(columns, task.joint_names)
    elif len(missing) < task.n:
        raise InputError(f"there is no column {missing[0]!r}", remedy="add it")
    elif joints is not None:  # further columns may be those of a gripper
        if joints.ndim != 2 or joints.shape[1] < task.n:
            what = f"must be rows of {task.n} joints or more"
            raise InputError(what, argument="joints")
        found["joints"] = joints[:, : task.n]
    pose: tuple[str, ...] = POSITION + QUATERNION
    if not task.kind.turns and not set(QUATERNION) <= set(columns):
        pose = POSITION
    if set(pose) <= set(columns):
        found["poses"] = _stacked(columns, pose)
    elif poses is not None and poses.shape[1:] == (16,):
        found["poses"] = poses.reshape(-1, 4, 4)
    if found["joints"] is None and found["poses"] is None:
        raise InputError(
            f"there are columns {', '.join(columns)}",
            remedy=f"name joints {', '.join(task.joint_names)}, or poses x, y, z, qx, qy, qz, qw",
        )
    return found


def _stacked(columns: Any, names: Sequence[str]) -> Array:
    for name in names:
        values = columns[name]
        if values.ndim != 1 or values.dtype.kind not in "biuf":
            raise InputError(f"column {name!r} must be numbers")
        if not np.isfinite(values).all():
            at = int(np.argmin(np.isfinite(values)))
            raise InputError(f"{name} is not a finite number", at=at)
    return np.stack([columns[name] for name in names], axis=1).astype(float)
