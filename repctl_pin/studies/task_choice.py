"""Choice of the task: the first kind that is redundant at a frame.

The kind of a task determines which coordinates of the frame are controlled: ``pose``, ``position``,
``axis``, or a plane such as ``xy``. With n joints and m coordinates, r = n − m is the degree of
redundancy; a task with r ≥ 1 is redundant.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..base.errors import InputError
from ..model.kind import KINDS, task_kind
from ..model.length import arm_length
from ..model.robot import Robot
from ..model.task import Task
from ..motion.solve_ik import random_configurations
from ..redundancy.inverses import inverse_condition_number

_PREFERRED = [KINDS[name] for name in ("pose", "position", "xy", "xz", "yz")]
"""Kinds tried in this order if none is given (``axis`` on request only)."""

_SAMPLES = 32
"""Number of configurations at which the rank of J is evaluated."""

_RANK = 1e-4


def choose_task(robot: Robot, frame: str | Sequence[Any] | None, kind: str | None) -> Task:
    """Create the task of a robot at a frame: of the given kind, or of the first redundant kind.

    ``frame`` is None for the robot's default frame, a name, or a list for several frames, for which
    the default kind is pose. For one frame, the default is the first of the kinds pose, position,
    xy, xz, yz that is redundant.

    Raises
    ------
    InputError
        If the task of one frame is not redundant, or its Jacobian J never has full rank; the
        message names the kinds of task that are redundant.
    """
    frame = robot.default_frame if frame is None else frame
    if not isinstance(frame, str):
        return robot.task(frame, "pose" if kind is None else task_kind(kind))
    if kind is not None:
        return _redundant(robot, robot.task(frame, task_kind(kind)))
    kinds = redundant_kinds(robot, frame)
    for preferred in _PREFERRED:
        if kinds.get(preferred, 0) >= 1:
            return robot.task(frame, preferred)
    count = len(robot.chain(frame))
    other = _redundant_frame(robot)
    joints = f"{count} joint{'s' * (count != 1)}"
    none = f"{robot.name} {frame!r} is moved by {joints}: no kind of task is redundant there"
    if other is None:
        raise InputError(f"{none}, nor at another frame", remedy="use another robot")
    raise InputError(none, remedy=f"choose another frame, such as {other!r}")


def redundant_kinds(robot: Robot, frame: str) -> dict[str, int]:
    """Find the kinds of task for which J of a frame has full row rank somewhere: name → r = n − m.

    Kinds with r = 0, which are not redundant, are included.
    """
    kinds: dict[str, int] = {}
    for kind in KINDS.values():
        if len(robot.chain(frame)) < kind.m:
            continue
        task = robot.task(frame, kind)
        if _reaches_full_rank(task):
            kinds[kind] = task.r
    return kinds


def kind_note(task: Task) -> list[str]:
    """Make a note on why the chosen task is not of kind pose, the first choice.

    The list has one text; it is empty for a pose task, or if the task has several frames.
    """
    first = _PREFERRED[0]
    if len(task.frames) > 1:
        return []
    if task.kind == first:
        return []
    using = f"using task {task.kind}, because {task.n} joints"
    if task.n <= first.m:
        return [f"{using} are not redundant for a {first} task"]
    return [f"{using} never move {task.frame} in all coordinates of a {first} task"]


def _redundant(robot: Robot, task: Task) -> Task:
    """Return a task if it is redundant and J has full row rank somewhere; else raise InputError.

    The error says which condition fails, and names the kinds of task that are redundant for the
    frame.
    """
    if task.r >= 1 and _reaches_full_rank(task):
        return task
    others = redundant_kinds(robot, task.frame)
    names = ", ".join(f"{kind} (r = {r})" for kind, r in others.items() if r >= 1)
    remedy = f"use a kind that is redundant here: {names}" if names else "use another frame"
    sizes = f"n = {task.n} joints move it and the task has m = {task.m} coordinates"
    why = f"{sizes}, so r = {task.r}"
    if task.r >= 1:
        why = f"its joints can never move it in all {task.m} coordinates of the task"
    raise InputError(f"{robot.name} {task.frame!r}, {task.kind}: {why}", remedy=remedy)


def _redundant_frame(robot: Robot) -> str | None:
    """Find a frame at which a kind of task is redundant, to suggest it in an error message.

    If there are several, it is one that the largest number of joints moves; None if there is none.
    """
    chains = {tuple(robot.chain(frame)): frame for frame in robot.frames}
    for chain in sorted(chains, key=len, reverse=True):
        kinds = redundant_kinds(robot, chains[chain])
        if max(kinds.values(), default=0) > 0:
            return chains[chain]
    return None


def _reaches_full_rank(task: Task) -> bool:
    """Test whether J has full row rank at one of 32 random configurations within the limits.

    The rank is numerical: σ_min / σ_max of J, with lengths divided by that of the arm, must exceed
    a tolerance. False also if r < 0.
    """
    J = task.jacobians(random_configurations(task, _SAMPLES, np.random.default_rng(0)))
    if task.m > 2:
        J[:, :3] /= max(arm_length(task, task.reference), 1e-9)
    return bool((inverse_condition_number(J) > _RANK).any()) and task.r >= 0
