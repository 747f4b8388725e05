"""Identity of a task in a file: robot, frame, joints, their limits, and placements of the frame."""

from __future__ import annotations

import msgspec
import numpy as np

from ..arguments import Array
from ..errors import InputError
from ..model.kind import task_kind
from ..model.robot import Robot
from ..model.several_frames import SeveralFrames
from ..model.task import Task
from ..model.task_parts import check_configurations
from ..model.tool import ToolTask, with_tool
from .changes import ranges_of
from .schema import Check, FrameFile, TaskFile

_TOLERANCE = 1e-9


def identity(task: Task) -> TaskFile:
    """Convert a task to its part of a file: names, and placements at several configurations.

    The placements are the fingerprint: they depend on each link and joint axis of the chain and on
    the locked joints. They are compared with a tolerance of 1e-9, so rounding has no effect.
    """
    robot = task.robot
    checks = [
        Check(q.tolist(), np.round(_placements(task, q), 12).tolist())
        for q in check_configurations(task)
    ]
    file = robot.description.path.name.encode("utf-8", "replace").decode()
    T = None if task.coordinates is None else task.coordinates.T.tolist()
    return TaskFile(
        robot=robot.name,
        catalogue=robot.entry is not None,
        file=file,
        base=robot.base,
        lock=list(robot.locked),
        frame=task.link if isinstance(task, ToolTask) else task.frame,
        task=str(task.kind),
        joints=list(task.robot_joints),
        coordinates=T,
        fingerprint=checks,
        limits=ranges_of(task),
        frames=_frames(task),
        tool=task.tool.homogeneous.tolist()
        if isinstance(task, ToolTask)
        else msgspec.UNSET,
    )


def _placements(task: Task, q: Array) -> Array:
    """Evaluate the placements [R p] of the task's frames, one below the other: (3 F, 4)."""
    places = (
        task.placements(q) if isinstance(task, SeveralFrames) else [task.placement(q)]
    )
    return np.concatenate([place.homogeneous[:3] for place in places])


def _frames(task: Task) -> list[FrameFile] | msgspec.UnsetType:
    """List the frames of a task of several; UNSET for one frame."""
    if not isinstance(task, SeveralFrames):
        return msgspec.UNSET
    return [FrameFile(spec.frame, str(spec.kind), spec.base) for spec in task.specs]


def task_of(made_for: TaskFile, robot: Robot) -> Task:
    """Create the task that a design was made for, on a robot.

    The robot is loaded again if its base or its locked joints are other ones.
    """
    if set(robot.locked) != set(made_for.lock) or robot.base != made_for.base:
        name = robot.entry.name if robot.entry is not None else robot.description.path
        around = None if robot.surroundings is None else robot.surroundings.path
        robot = Robot.load(
            name,
            package_dirs=robot.package_dirs,
            lock=made_for.lock,
            base=made_for.base,
            surroundings=around,
        )
    if isinstance(made_for.frames, msgspec.UnsetType):
        kind = task_kind(made_for.task)
        task = robot.task(made_for.frame, kind, joints=made_for.joints)
    else:
        frames = [(one.frame, one.task, one.base) for one in made_for.frames]
        task = robot.task(frames, joints=made_for.joints)
    if made_for.coordinates is not None:
        task = task.in_coordinates(made_for.coordinates)
    return carrying_tool(made_for, task)


def carrying_tool(made_for: TaskFile, task: Task) -> Task:
    """Return the task of the tool of a file, if the task is that of the link that carries it."""
    if isinstance(made_for.tool, msgspec.UnsetType) or isinstance(task, ToolTask):
        return task
    return task if task.frame != made_for.frame else with_tool(task, made_for.tool)


def compare(made_for: TaskFile, task: Task, where: str) -> None:
    """Check that a task is the one that a design in the file ``where`` was made for.

    Raises
    ------
    InputError
        If the tasks differ; the message names the first difference.
    """
    mine = identity(task)
    for key, name in {
        "robot": "robot",
        "base": "base",
        "frame": "frame",
        "task": "task kind",
    }.items():
        one, other = getattr(made_for, key), getattr(mine, key)
        if one != other:
            raise InputError(
                f"{where} is for the {name} {one!r}, not {other!r}; give that {name}"
            )
    if made_for.frames != mine.frames:
        raise InputError(f"{where} has frames that are relative to other links")
    if made_for.joints != mine.joints:
        raise InputError(
            f"{where} is for the joints {', '.join(made_for.joints)}, in this order, "
            f"not {', '.join(mine.joints)}"
        )
    if made_for.coordinates != mine.coordinates:
        raise InputError(
            f"{where} is for other joint coordinates; its T of q = T ψ is {made_for.coordinates}"
        )
    if not made_for.fingerprint:
        raise InputError(f"{where} has no fingerprint of the kinematics; design again")
    for check in made_for.fingerprint:
        q, expected = np.array(check.q), np.array(check.placement)
        if q.shape != (task.n,) or expected.shape != (3 * len(task.frames), 4):
            raise InputError(f"{where} has a damaged fingerprint; design again")
        away = _placements(task, q) - expected
        if not np.abs(away).max() < _TOLERANCE:
            shift = np.abs(away[:, 3]).max()
            turn = np.abs(away[:, :3]).max()
            raise InputError(
                f"{where} is for another {made_for.robot}: at its check configurations the frame "
                f"{made_for.frame!r} lies {shift:.3g} m and {turn:.3g} rad elsewhere; "
                "the URDF or the locked joints have changed, so design again"
            )
