"""Columns of a relabelled recording: the columns of its file, with new joints and poses.

Columns that depend on the recorded joints, such as velocities or actions, would contradict the new
joints and are removed. Columns of the gripper, of cameras and of times stay. The new joints are
NaN where the function that relabels has no value. A session is one run of the recorder, such as a
demonstration. Letters: K frames (rows), n joints.

``Table`` is the columns of a file by name, all of one length, with one row per frame of a
recording. ``NewCells`` are new numbers for one column of a table, with the rows, and the indices in
a row, at which they replace the old ones.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple, TypeAlias

import numpy as np

from ...base.arguments import Array
from ...base.data_tables import Column, NewCells, Table, replaced
from ...model.rotations import matrix_quaternions
from ..cells.targets import homogeneous
from .data_sets.data_set import DataSet
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
    gripper finger fingers hand ee eef tcp tool cartesian twist image environment object
    """.split()  # noqa: SIM905
)
"""Words in the name of a column that does not depend on the joints of the arm."""


_ROUNDED = 1e-6
"""Rounding of the cosines and sines of a data set."""


class Columns(NamedTuple):
    """Columns of a relabelled recording, as they are written to a file.

    Attributes
    ----------
    new : dict of str to NewCells
        New numbers, by name of the column; other columns of the file are kept.
    removed : tuple of str
        Names of columns of the file that are left out, because they belong to the recorded joints.
    recomputed : tuple of str
        Names of columns of the pose that are computed from the new joints.
    """

    new: dict[str, NewCells]
    removed: tuple[str, ...] = ()
    recomputed: tuple[str, ...] = ()

    @property
    def written(self) -> tuple[str, ...]:
        """Names of the columns of new joints.

        The indices of the joints, from 0, follow the name of an array, such as ``action [0–6]``.
        """
        return tuple(
            name if len(cells.at) == 1 else f"{name} [{_ranges(cells.at)}]"
            for name, cells in self.new.items()
            if name not in self.recomputed
        )


def relabeled_columns(
    recording: Recording, Q: Array, further: Mapping[str, Array] = MappingProxyType({})
) -> Columns:
    """Find the columns of a recording's file that change with new configurations Q (K, n).

    ``further`` are the new configurations of further columns of joints, by name. Other columns are
    kept, unless they depend on the recorded joints. In frames where Q is NaN, the recorded pose is
    kept.
    """
    task, old, source = recording.task, recording.joints, recording.source
    assert source is not None
    # joints by column
    found = np.isfinite(Q[:, 0])
    every = np.ones_like(found)
    joints = {
        name: NewCells(q[:, None], (0,), every)
        for name, q in zip(task.joint_names, Q.T, strict=True)
    }
    known = _known_joints(recording, Q, further)
    # each column of the file: new, removed, or as it was
    poses = _pose_columns(recording, Q, source.widths)
    new = dict[str, NewCells]()
    removed, recomputed = list[str](), list[str]()
    for name in source.widths:
        if name in joints:
            new[name] = joints[name]
        elif name in further:
            new[name] = NewCells(further[name], recording.further[name][0], every)
        elif name in recording.unchanged:
            continue
        elif isinstance(source, DataSet) and name in source.simulator:
            removed.append(name)
        elif (copied := _copy(source, name, known)) is not None:
            new[name] = NewCells(*copied, every)
        elif name in poses and task.m < 6:
            values = poses[name]
            new[name] = NewCells(values, range(values.shape[1]), found)
            recomputed.append(name)
        elif old is not None and _of_old_joints(name, task.joint_names):
            removed.append(name)
    if not _has_joints(new, source, task.joint_names):
        new |= joints
    return Columns(new, tuple(removed), tuple(recomputed))


def plain_columns(
    recording: Recording, Q: Array, further: Mapping[str, Array] = MappingProxyType({})
) -> dict[str, Column]:
    """Make the columns of a recording with new configurations Q (K, n), for any output format.

    Returns a dict from name to column. If the recording was read from a file, these columns are the
    columns of the file except the removed ones, with new joints and recomputed poses. Otherwise,
    they are the new joints, times, sessions and poses. ``further`` are the new configurations of
    further columns of joints, by name.
    """
    source = recording.source
    if source is None:
        p, R = _poses(recording, Q)
        X = np.concatenate([p, matrix_quaternions(R)], axis=1)
        poses = dict(zip(POSITION + QUATERNION, X.T, strict=True))
        return _beside(recording) | poses | dict(zip(recording.task.joint_names, Q.T, strict=True))
    new, removed, _ = relabeled_columns(recording, Q, further)
    made = {name: source.column(name) for name in source.widths if name not in removed}
    return made | {name: replaced(made.get(name), cells) for name, cells in new.items()}


def _ranges(at: Sequence[int]) -> str:
    """Write indices as text, with ranges, such as ``7–13`` or ``0, 2–4``."""
    cuts = np.flatnonzero(np.diff(at) != 1) + 1
    parts = np.split(np.asarray(at), cuts)
    return ", ".join(f"{one[0]}–{one[-1]}" if len(one) > 1 else str(one[0]) for one in parts)


_Known: TypeAlias = tuple[Sequence[int] | None, Array, Array]
"""A column of joints: their indices in a row of it, or None; the recorded joints (K, n); the new
joints (K, n)."""


def _known_joints(recording: Recording, Q: Array, further: Mapping[str, Array]) -> list[_Known]:
    """List the columns of joints of a recording, with recorded and new configurations.

    Each item is a triple: the indices of the joints in a row of the column, or None if each joint
    has a column; the recorded configurations (K, n); and the new ones (K, n). The first item is
    that of the recorded joints, if any, with the new configurations Q (K, n). Then follow the
    columns of ``further``: the new configurations of further columns of joints, by name.
    """
    old = recording.joints
    known: list[_Known] = [] if old is None else [(recording.places, old, Q)]
    return known + [(*recording.further[name], made) for name, made in further.items()]


def _has_joints(columns: Collection[str], source: Table, joints: Sequence[str]) -> bool:
    """Test by name whether ``columns`` include the ``joints`` of the arm.

    The result is True if each of the n joints has a column of its name, or if there is a column
    with an array of all joints: one with a usual name, or the column of joints of a data set.
    ``source`` is the file.
    """
    whole = (*JOINTS, *([str(source.joints)] if isinstance(source, DataSet) else []))
    return set(joints) <= set(columns) or any(name in columns for name in whole)


def _copy(source: Table, name: str, known: Sequence[_Known]) -> tuple[Array, Sequence[int]] | None:
    """Make new numbers for an array that repeats the recorded joints; None if it does not.

    ``known`` has, for each column of joints, the indices of the joints in its rows (or None), the
    recorded joints (K, n), and the new joints (K, n). The array ``name`` repeats a column if it has
    equal numbers at the same indices, or at any n consecutive indices. Return the new joints (K, n)
    and these indices. If an array of a data set has the cosines or sines of the recorded joints
    instead, return those of the new joints.
    """
    width = source.widths[name]
    known = [one for one in known if 1 < one[1].shape[1] <= width]
    values = source.numbers([name], finite=False) if known else np.empty((0, 0))
    for places, old, new in known:
        n = old.shape[1]
        starts: list[Sequence[int]] = [range(k, k + n) for k in range(width - n + 1)]
        if places is not None:
            starts.insert(0, places)
        for at in starts:
            if max(at) < width and np.array_equal(values[:, at], old):
                return new, at
        if isinstance(source, DataSet) and width == n:
            for function in (np.cos, np.sin):
                if np.allclose(values, function(old), rtol=0.0, atol=_ROUNDED):
                    return function(new), range(n)
    return None


def _of_old_joints(name: str, joints: Sequence[str]) -> bool:
    """Test by its name whether a column depends on the recorded joints, and so must be removed.

    The result is True if the name contains the name of a joint. It is also True if the name
    contains a word such as ``action``, ``qvel`` or ``velocity``, and none such as ``gripper``,
    ``tcp`` or ``object``.
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
    """Make the columns of time and session, for a recording that was not read from a file.

    A column without data is left out.
    """
    columns = dict[str, Column]()
    if recording.times is not None:
        columns["time"] = recording.times
    if len(recording.names) > 1:
        columns["session"] = np.array(recording.names, dtype=object)[recording.session]
    return columns


def _pose_columns(recording: Recording, Q: Array, widths: Mapping[str, int]) -> dict[str, Array]:
    """Compute the columns of poses at the joints Q (K, n), by name.

    They are the columns x, y, z, qx, qy, qz and qw, (K, 1) each, even if the file has none of them;
    and the arrays of poses among ``widths``, the file's columns with their numbers per row. Such an
    array has 3 numbers per row, a position, m; 7, a position and a quaternion; or 16, a matrix.
    """
    p, R = _poses(recording, Q)
    X = np.concatenate([p, matrix_quaternions(R)], axis=1)
    poses = dict(zip(POSITION + QUATERNION, np.split(X, 7, axis=1), strict=True))
    arrays = {3: p, 7: X, 16: homogeneous(p, R).reshape(-1, 16)}
    return poses | {name: arrays[w] for name in POSES if (w := widths.get(name, 0)) in arrays}
