"""Opening of a data set, and the joints of a task in one of its columns, found by their names.

``DataSet`` is the demonstrations of a data set as one table, with the names of its special columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ....base.errors import InputError
from ....model.task import Task
from .data_set import DataSet
from .lerobot_folder import LeRobotData
from .robomimic import RobomimicData


def open_data_set(
    path: Path, task: Task, joints: Sequence[str] | None = None
) -> tuple[DataSet, Sequence[str] | None]:
    """Open a data set, and interpret the names ``joints`` that the user gave.

    ``joints`` usually names the numbers in a row of the column of joints. But in an HDF5 file, and
    for an arm of several joints, a single name is that of the array of joints. Return the opened
    data set, and the names of the numbers; None if they are not given.
    """
    if path.is_dir():
        return LeRobotData(path), joints
    if joints is not None and len(joints) == 1 < task.n:
        return RobomimicData(path, task.n, joints[0]), None
    return RobomimicData(path, task.n), joints


def joints_of(
    table: DataSet, task: Task, given: Sequence[str] | None = None
) -> tuple[str, tuple[int, ...]]:
    """Find the column of joints of a data set, and the index of each of the task's joints in a row.

    ``given`` are names of all numbers in a row of that column, in order. By default, the names in
    the data set are used. If the data set has no names, the column must have exactly one number per
    joint. A LeRobot data set must have names.

    Raises
    ------
    InputError
        If there is no such column, or the names are missing or belong to another arm.
    """
    name = table.joints
    if name is None:
        raise InputError(
            f"the data set has {', '.join(table.widths)}, but no array of the {task.n} joints",
            remedy="name the array by joints= (--joints)",
        )
    if given is None and isinstance(table, LeRobotData):
        labels = table.labels(name)
        if labels is None or len(labels) != table.widths[name]:
            raise InputError(
                f"meta/info.json does not name the {table.widths[name]} numbers of {name!r}",
                remedy="name them in order by joints= (--joints), among them "
                + ", ".join(task.joint_names),
            )
        require_known(name, labels, task)
        given = labels
    return name, places_of(name, table.widths[name], task, given)


def require_known(name: str, lerobot: Sequence[str], task: Task) -> None:
    """Raise InputError if no number of a LeRobot column is named after a joint of the task.

    Such a column probably belongs to another arm, even if it has one number per joint of the task.
    ``lerobot`` are the names of the numbers in a row of the column, from ``meta/info.json``.
    ``name`` is the name of the column, for the message.
    """
    own = task.joint_names
    if not set(own) & {stem(text, own) for text in lerobot}:
        raise InputError(
            f"none of the {len(lerobot)} names of {name!r} in meta/info.json is a joint of the "
            f"task: got {', '.join(lerobot)}, but the task has {', '.join(own)}",
            remedy=f"give {len(lerobot)} names in joints= (--joints), one per number, in order; "
            "use the task's names for its joints",
        )


def places_of(name: str, width: int, task: Task, given: Sequence[str] | None) -> tuple[int, ...]:
    """Find the indices of the task's joints in the rows of the column ``name``, of given width.

    ``width`` is the count of numbers per row, and ``given`` are their names. Without names, the
    column must have exactly one number per joint.
    """
    own = task.joint_names
    if given is None and width == task.n:
        return tuple(range(width))
    if given is None:
        raise InputError(
            f"{name!r} has {width} numbers per row, but the task has {task.n} joints",
            remedy=f"give {width} names in joints=, one per number, in order; "
            f"among them must be {', '.join(own)}",
        )
    names = [text.strip() for text in given]
    if len(names) != width:
        what = f"must be {width} names, one per number of {name!r}; got {len(names)}"
        raise InputError(what, argument="joints")
    stems = [stem(text, own) for text in names]
    for joint in own:
        if stems.count(joint) != 1:
            times = "twice" if joint in stems else "not"
            raise InputError(
                f": {joint} is {times} among {', '.join(names)}; name each joint once",
                argument="joints",
            )
    return tuple(map(stems.index, own))


def stem(name: str, own: Sequence[str]) -> str:
    """Return a joint's name without LeRobot's suffix ``.pos``.

    The suffix stays if the whole name is in ``own``, the names of the robot's joints.
    """
    return name if name in own else name.removesuffix(".pos")
