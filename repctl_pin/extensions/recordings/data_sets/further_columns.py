"""Further columns of joint positions in a data set: those of actions and of next observations.

Next observations are those of the following frame. Relabelling replaces recorded joints by the
configurations q = F(x; c) of one function F of the pose x, at one level c, the position along the
self-motion. It does so in the further columns, too, with the same F and c, so that all columns
agree. K is the number of frames, n that of joints. ``places`` are the indices of the n joints among
the numbers in a row of a column, from 0.

``DataSet`` is the demonstrations of a data set as one table, with the names of its special columns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....base.arguments import Array
from ....base.errors import InputError
from ....model.task import Task
from .data_set import DataSet
from .joints import stem

_AWAY = 0.5
"""Distance in the median, rad or m, beyond which actions are not positions of the joints."""

ACTIONS = ("joints", "hand")

Joints = tuple[tuple[int, ...], Array]
"""Indices of the task's joints in a row of a column, and these joints: (n,) and (K, n)."""


def further_joints(
    table: DataSet, task: Task, Q: Array, places: tuple[int, ...], action: str | None
) -> tuple[dict[str, Joints], tuple[str, ...]]:
    """Find the further columns of joints, and the columns of actions that stay unchanged.

    Parameters
    ----------
    table, task
        The data set, and the task.
    Q, places : (K, n) array, tuple
        The recorded joints, and the index of each joint in a row of the column of joints.
    action
        Meaning of the actions: ``joints`` for joint positions, ``hand`` for commands of the hand;
        None to read the meaning from the data set.

    Returns
    -------
    A dict from the name of each further column to a pair: the indices of the joints in a row, and
    the positions of the joints (K, n), rad or m. Then the names of the columns of actions that stay
    unchanged: all of them if actions command the hand, else none. A column of actions whose meaning
    is not known is in neither; :func:`.relabeled_columns` removes such a column, unless its name
    says that it belongs to the hand.

    Raises
    ------
    InputError
        If it is not known whether a column named ``action`` or ``actions`` has joint positions, if
        it has too few numbers per row, or if its positions are far from the recorded joints.
    """
    assert table.joints is not None
    commands, actions = action or table.commands, table.actions()
    tail = table.joints.rsplit("/", 1)[-1]
    found: dict[str, Joints] = {}
    for name, width in table.widths.items():
        if name == table.joints or not width:
            continue
        if name.rsplit("/", 1)[-1] == tail and width > max(places):
            found[name] = places, table.numbers([name])[:, places]
        elif name in actions and commands != "hand":
            at = _places(table, task, name, places, commands)
            if at is None:
                continue
            found[name] = at, table.numbers([name])[:, at]
            _require_near(table, task, name, found[name][1], Q)
    return found, actions if commands == "hand" else ()


def require_positions(
    table: DataSet, labels: Sequence[str] | None, places: tuple[int, ...], task: Task
) -> None:
    """Raise InputError if the column of joints also has other data of the joints, such as speeds.

    Relabelling would leave such numbers unchanged, although they depend on the joints. ``labels``
    are the names of the numbers in a row of the column ``table.joints``, and ``places`` the indices
    of the joint positions in the row. The error is raised for a number at any other index whose
    name contains the name of a joint. Without names, None, no error is raised.
    """
    for at, label in enumerate(labels or ()):
        if at not in places and any(joint in label for joint in task.joint_names):
            raise InputError(
                f"{table.joints!r} has {label!r}, which belongs to the replaced joints",
                remedy="leave these numbers out of the data set",
            )


def _places(
    table: DataSet, task: Task, name: str, places: tuple[int, ...], commands: str | None
) -> tuple[int, ...] | None:
    """Find the indices of the task's joints in a row of the column ``name``.

    The joints are found by the names of the numbers. Otherwise, the result is ``places``, the
    indices in the column ``table.joints``, in two cases: if both columns have the same names, or if
    ``commands``, the meaning of the actions, is "joints". An InputError is raised if the column has
    too few numbers for ``places``. If the joints cannot be found, the result is None, except for
    the columns ``action`` and ``actions``, for which an InputError is raised.
    """
    own, labels = task.joint_names, table.labels(name)
    stems = [stem(label, own) for label in labels or ()]
    if len(stems) == table.widths[name] and all(stems.count(joint) == 1 for joint in own):
        return tuple(map(stems.index, own))
    same = labels is not None and labels == table.labels(str(table.joints))
    if same or commands == "joints":
        if table.widths[name] > max(places):
            return places
        raise InputError(
            f"{table.file}: {name!r} has {table.widths[name]} numbers per row, but the joints are "
            f"at {places[0]} to {places[-1]} in {table.joints!r}",
            remedy=f"write {name!r} with the joints at the same indices as in {table.joints!r}",
        )
    if name not in ("action", "actions"):
        return None
    what = f"are {', '.join(labels)}" if labels else "have no names"
    raise InputError(
        f"{table.file}: it is not known whether {name!r} are joint positions: its numbers {what}",
        remedy="use action='joints' (--action joints) if they are joint positions in the order of "
        "the joints, or 'hand' if they command the hand",
    )


def _require_near(table: DataSet, task: Task, name: str, A: Array, Q: Array) -> None:
    """Raise InputError unless actions A (K, n) are joint positions near the recorded Q (K, n).

    ``name`` is the column of the actions, for the message.
    """
    away = np.median(np.abs(A - Q), axis=0)
    worst = int(np.argmax(away))
    if away[worst] > _AWAY:
        raise InputError(
            f"{table.file}: {name!r} is {away[worst]:.2g} rad or m from "
            f"{task.joint_names[worst]} in the median, and not the position of that joint",
            remedy="use action='hand' (--action hand) if the actions command the hand",
        )
