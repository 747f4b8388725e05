"""Recorded frames of an arm, by session and time: joints, poses of the frame, or both.

A frame is one row of a recording, but *the* frame of a task is the link whose poses are recorded. A
session is one run of the recorder, such as a demonstration. Actions of a data set are the recorded
commands. Large arrays are processed in blocks of rows. Letters: K frames, n joints.

``Table`` is the columns of a file by name, all of one length, with one row per frame of a
recording.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import (
    Array,
    as_configurations,
    as_numbers,
    file_name,
    freeze,
    read_only,
    shown,
)
from ...base.data_tables import Column, Table, read_table
from ...base.errors import InputError
from ...model.native_kinematics import placed
from ...model.rotations import quaternion_matrices
from ...model.several_frames import one_frame
from ...model.task import Task, require_task
from ..cells.targets import homogeneous
from .data_sets.data_set import DataSet, is_data_set
from .data_sets.further_columns import ACTIONS, Joints, further_joints, require_positions
from .data_sets.joints import joints_of, open_data_set, places_of, require_known
from .data_sets.lerobot_folder import labels_of, read_info
from .frame_checks import (
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

    All rows are checked: numbers are finite, units are m and rad, times increase, and the forward
    kinematics of the joints agrees with the poses.

    Parameters
    ----------
    task
        The task; the poses are those of its frame.
    joints : (K, n) array, optional
        Joint positions, rad or m.
    poses : (K, 4, 4), (K, 7) or (K, 3) array, optional
        Homogeneous matrices; positions with quaternions, ``x, y, z, qx, qy, qz, qw``; or, for a
        task that leaves the rotation free, positions, m. By default, the poses are computed from
        the joints.
    times : (K,) array, optional
        Time of each frame, s.
    sessions : sequence, optional
        Number or name of each frame's session, (K,); by default, all frames belong to one session.

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
    places: tuple[int, ...] | None
    further: dict[str, Joints]
    unchanged: tuple[str, ...]

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
        # joints, in rad and within limits
        if joints is None and poses is None:
            raise InputError("a recording needs joints= or poses=")
        if any(given is not None and not np.size(given) for given in (joints, poses)):
            raise InputError("a recording needs at least one frame")
        Q = None if joints is None else as_configurations(joints, task.n, "a recording")
        if Q is not None:
            require_radians(task, Q)
        # poses: of the joints, or as recorded
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
        # joints and poses must belong together
        if Q is not None and poses is not None:
            seven = as_numbers(poses)
            quaternions = seven is not None and seven.ndim == 2
            require_agreement(task, Q, p, R, quaternions=quaternions)
            require_limits(task, Q)
        # sessions and their times
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
            places=None,
            further={},
            unchanged=(),
        )

    @classmethod
    def read(
        cls,
        file: str | Path,
        task: Task,
        *,
        joints: Sequence[str] | None = None,
        action: str | None = None,
    ) -> Recording:
        """Read a recording from a .csv, .npz or .parquet file, or from a data set.

        Columns are found by name:

        - joints: one column per joint of the task, or an array ``joints``, ``q``, ``qpos`` or
          ``observation.state``. A row of the array has the task's joints in their order; or, for
          LeRobot, the numbers that ``meta/info.json`` names, which must include the task's joints
        - poses: ``x, y, z, qx, qy, qz, qw``, or an array ``poses``
        - time: ``time``, ``t`` or ``timestamp``
        - session: ``session`` or ``episode``

        A data set is the folder of a LeRobot data set, of version 2.1 or 3.0, or an HDF5 file of
        robomimic. Its actions are read, too; :func:`relabel` replaces them if they are joint
        positions. Parquet requires pyarrow, HDF5 h5py.

        Parameters
        ----------
        file
            The file, or the folder of a LeRobot data set.
        task
            Task; the poses are those of its frame.
        joints : sequence of str, optional
            Names of the numbers in a row of an array of joints, in order. They are needed if the
            array has numbers of other joints or of a gripper, too, which are not used. For HDF5, a
            single name is that of the array.
        action : str, optional
            For a data set, ``joints`` if its actions are joint positions in the joints' order, or
            ``hand`` if they command the hand; :func:`relabel` then leaves them unchanged. By
            default, the data set says which.

        Raises
        ------
        InputError
            If the file cannot be read, has no such columns, or its numbers are refused; the message
            names the line.
        """
        task = one_frame(require_task(task), "a recording")
        path = file_name(file)
        table: Table
        if data_set := is_data_set(path):
            table, joints = open_data_set(path, task, joints)
        else:
            table = read_table(path, task.joint_names)
        if action is not None and not (data_set and action in ACTIONS):
            raise InputError(
                f"must be {' or '.join(ACTIONS)}, and is only for data sets of LeRobot or "
                f"robomimic; got {shown(action)}",
                argument="action",
            )
        try:
            columns, places = _find(table, task, joints)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        arguments = _arguments(table, columns, places)
        try:
            made = cls(task, **arguments)
        except InputError as error:
            where = table.where(error.at) if isinstance(error.at, int) else str(path)
            raise InputError(f"{where}: {error}", at=error.at) from None
        freeze(made, source=table, places=places)
        if isinstance(table, DataSet):
            assert places is not None and made.joints is not None
            require_positions(table, joints or table.labels(str(table.joints)), places, task)
            further, unchanged = further_joints(table, task, made.joints, places, action)
            freeze(made, further=further, unchanged=unchanged)
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

    This saves time in steps whose result hardly depends on the number of frames.
    """
    some = np.linspace(0, len(recording) - 1, min(most, len(recording))).astype(int)
    other = object.__new__(Recording)
    values = vars(recording)
    arrays = {n: value[some] for n, value in values.items() if isinstance(value, np.ndarray)}
    freeze(other, **values | arrays)
    return other


def forward(task: Task, Q: Array) -> tuple[Array, Array]:
    """Compute the poses of the task's frame, in the base frame, at configurations Q (K, n).

    Returns the positions (K, 3), m, and the rotations (K, 3, 3).
    """
    p, R = in_blocks(lambda part: placed(task, part)[:2], Q)
    return p, R


def in_blocks(function: Callable[..., Any], *arrays: Array) -> Any:
    """Call a function on arrays (K, …), block by block of rows, to save memory; join the results.

    The function takes a block of rows of each array, and returns an array or a tuple of arrays with
    as many rows.
    """
    parts = [function(*(values[at] for values in arrays)) for at in blocks(len(arrays[0]))]
    if isinstance(parts[0], tuple):
        return tuple(map(np.concatenate, zip(*parts, strict=True)))
    return np.concatenate(parts)


def blocks(count: int) -> list[slice]:
    """Return slices that divide ``count`` rows into consecutive blocks of at most 16384."""
    return [slice(i, min(i + _CHUNK, count)) for i in range(0, count, _CHUNK)]


def _poses(task: Task, poses: ArrayLike) -> tuple[Array, Array]:
    """Read poses as positions (K, 3), m, and rotation matrices (K, 3, 3).

    Positions alone get the orientation of the reference pose.
    """
    X = _pose_numbers(task, poses)
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
            f"frame {at} (counted from 0): the quaternion has length {length[at]:.3g}, not 1",
            remedy="give x, y, z in m, then qx, qy, qz, qw, of length 1",
            at=at,
        )
    return X[:, :3].copy(), quaternion_matrices(X[:, 3:])


def _pose_numbers(task: Task, poses: ArrayLike) -> Array:
    """Convert poses to an array of finite numbers (K, 4, 4) or (K, 7), or of positions (K, 3)."""
    X = as_numbers(poses)
    shapes = [(4, 4), (7,)] if task.kind.turns else [(4, 4), (7,), (3,)]
    if X is None or X.shape[1:] not in shapes:
        forms = " or ".join(f"(K, {', '.join(map(str, shape))})" for shape in shapes)
        got = shown(poses) if X is None else f"shape {X.shape}"
        raise InputError(f"must be numbers {forms}; got {got}", argument="poses")
    wrong = ~np.isfinite(X.reshape(len(X), -1)).all(axis=1)
    if wrong.any():
        raise InputError(
            f"pose {np.argmax(wrong)} is not finite",
            remedy="correct or remove it",
            at=int(np.argmax(wrong)),
        )
    return X


def _rotations(R: Array) -> Array:
    """Project matrices (K, 3, 3) onto the nearest rotations, to remove rounding errors of a file.

    Raises InputError if a singular value differs from 1 by more than 0.01, or a matrix is a
    reflection.
    """
    U, s, Vt = np.linalg.svd(R)
    made = U @ Vt
    wrong = (np.abs(s - 1).max(axis=1) > _ROTATION) | (np.linalg.det(made) < 0)
    if wrong.any():
        at = int(np.argmax(wrong))
        off = float(np.abs(R[at] @ R[at].T - np.eye(3)).max())
        reflected = np.abs(s[at] - 1).max() <= _ROTATION
        why = (
            "it is reflected, with det R = −1" if reflected else f"R Rᵀ differs from I by {off:.2g}"
        )
        raise InputError(
            f"frame {at} (counted from 0): the matrix is not a rotation: {why}",
            remedy="give orthonormal, right-handed rotations, in homogeneous matrices",
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
        at = int(np.argmin(np.isfinite(t)))
        raise InputError(
            f"the time of frame {at} is not finite (frames are counted from 0)",
            remedy="correct it, or remove that row",
            at=at,
        )
    return t


def _find(
    table: Table, task: Task, given: Sequence[str] | None
) -> tuple[dict[str, list[str]], tuple[int, ...] | None]:
    """Find by name the columns of a table that become arguments of :class:`Recording`.

    The first result is a dict from argument (joints, poses, times, sessions) to the names of its
    columns; arguments that the table lacks are left out. The second result is the index of each
    joint in a column that holds an array of all joints; None if each joint has a column. ``given``
    are the names of the numbers in the array; by default, LeRobot's names are used. InputError is
    raised if there are neither joints nor poses, or only some of the joints.
    """
    widths = table.widths
    if isinstance(table, DataSet):
        name, at = joints_of(table, task, given)
        named = {"joints": [name], "sessions": [table.sessions]}
        return named | ({} if table.times is None else {"times": [table.times]}), at
    found = {
        argument: [next(name for name in names if name in widths)]
        for argument, names in _NAMES.items()
        if any(name in widths for name in names)
    }
    joints, places = _joint_columns(table, task, found.get("joints"), given)
    if joints is not None:
        found["joints"] = joints
    pose: tuple[str, ...] = POSITION + QUATERNION
    if not task.kind.turns and not set(QUATERNION) <= set(widths):
        pose = POSITION
    if set(pose) <= set(widths):
        found["poses"] = list(pose)
    elif "poses" in found and not widths[found["poses"][0]]:
        del found["poses"]
    if not {"joints", "poses"} & set(found):
        raise InputError(
            f"there are columns {', '.join(widths)}, but none of joints or poses",
            remedy=f"name joints {', '.join(task.joint_names)}, or poses x, y, z, qx, qy, qz, qw",
        )
    return found, places


def _joint_columns(
    table: Table, task: Task, array: list[str] | None, given: Sequence[str] | None
) -> tuple[list[str] | None, tuple[int, ...] | None]:
    """Find the columns of the joints, and the index of each joint in a row of an array of them.

    ``array`` is a list of one name, that of a column with an array of all joints; None if the table
    has no such column. This column is used if no joint has a column of its own. ``given`` are the
    names of the numbers in the array. The indices are None if each joint has its own column; both
    results are None if there are no joints. InputError is raised for only some of the joints, and
    for names without an array.
    """
    missing = [name for name in task.joint_names if name not in table.widths]
    if not missing:
        if given is not None:
            raise InputError(
                ": in this table, each joint already has a column of its own",
                argument="joints",
                remedy="omit joints=",
            )
        return list(task.joint_names), None
    if len(missing) < task.n:
        raise InputError(f"there is no column {missing[0]!r}", remedy="add that column")
    if array is not None:
        (name,), width = array, table.widths[array[0]]
        lerobot = _lerobot_names(table.file) if given is None else None
        if lerobot is not None and len(lerobot) == width:
            require_known(name, lerobot, task)
            given = lerobot
        return array, places_of(name, width, task, given)
    if given is not None:
        raise InputError(
            f"requires a column that holds an array of joints, one of {', '.join(JOINTS)}",
            argument="joints",
            remedy="add that column, or omit joints=",
        )
    return None, None


def _lerobot_names(file: Path) -> list[str] | None:
    """Read the names of the numbers in the joints' array from LeRobot's ``meta/info.json``.

    That file is searched for in the folder of the Parquet file, and in the two folders above.
    Return None if there is no such file, or it has no names.
    """
    if file.suffix.lower() != ".parquet":
        return None
    for folder in file.resolve().parents[:3]:
        if (folder / "meta" / "info.json").is_file():
            info = read_info(folder)
            return next(
                (labels_of(info, name) for name in JOINTS if name in info["features"]), None
            )
    return None


def _arguments(
    table: Table, columns: dict[str, list[str]], places: tuple[int, ...] | None
) -> dict[str, Any]:
    """Read the arguments of :class:`Recording` from columns of a table, by their names.

    ``columns`` has the names of the columns per argument, and ``places`` the index of each joint in
    a column that holds an array of all joints; None if each joint has a column.
    """
    made: dict[str, Any] = {}
    if places is not None:  # further numbers, such as a gripper's, may be missing
        name = columns["joints"][0]
        made["joints"] = Q = table.numbers([name], finite=False)[:, places]
        if not np.isfinite(Q).all():
            row = int(np.argmin(np.isfinite(Q).all(axis=1)))
            raise InputError(
                f"{table.where(row)}: {name} is not a finite number; correct or remove that row",
                at=row,
            )
    keys = [key for key in ("joints", "poses", "times") if key in columns and key not in made]
    names = [name for key in keys for name in columns[key]]
    values = table.numbers(names) if names else np.empty((0, 0))
    for key in keys:
        size = sum(table.widths[name] or 1 for name in columns[key])
        made[key], values = values[:, :size], values[:, size:]
    if made.get("poses") is not None and made["poses"].shape[1] == 16:
        made["poses"] = made["poses"].reshape(-1, 4, 4)
    if "times" in made:
        made["times"] = made["times"][:, 0]
    if "sessions" in columns:
        made["sessions"] = table.column(columns["sessions"][0])
    return made
