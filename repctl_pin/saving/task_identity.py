"""Identity of a task in a file, and detection of a robot that has changed since.

Everything that the numbers of the file depend on is compared: robot, frame, joints, placements of
the frame, joint limits, the frames of arm angles, masses, and collision bodies. Speed limits are
compared if the design has the period of a cycle. Geometry and masses are compared at the check
configurations, a few configurations that the file contains. An argument ``made_for`` is the part of
the file that describes the task.

``TaskFile`` is the stored robot and task of a design, by which a file is refused for another robot.
``FrameFile`` is the stored frame of a task: link, kind of task, and base link. ``JointRange`` is
the stored limits of one joint: position and speed.
"""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np

from ..base.arguments import Array
from ..base.errors import InputError
from ..design.proof_fingerprint import check_configurations, points_at
from ..model.kind import task_kind
from ..model.robot import Robot
from ..model.several_frames import SeveralFrames
from ..model.task import Task
from ..model.tool import ToolTask, carried, rigid
from .schema import (
    ArmAngleFile,
    BasisFile,
    Check,
    Desired,
    FrameFile,
    JoinedFile,
    JointRange,
    TaskFile,
    WeightedFile,
)

_TOLERANCE = 1e-9
"""Largest difference of numbers that count as unchanged: m, rad, or relative for masses."""


def identity(task: Task) -> TaskFile:
    """Convert a task to its part of a file, which identifies robot, frame, joints and kinematics.

    The kinematics are identified by placements of the frame at the check configurations, which
    depend on each link and joint axis of the chain and on the locked joints.
    """
    robot = task.robot
    checks = [
        Check(q.tolist(), np.round(_placements(task, q), 12).tolist())
        for q in check_configurations(task)
    ]
    file = robot.description.path.name.encode("utf-8", "replace").decode()
    return TaskFile(
        robot=robot.name,
        catalogue=robot.entry is not None,
        file=file,
        base=robot.base,
        lock=list(robot.locked),
        frame=task.link if isinstance(task, ToolTask) else task.frame,
        task=str(task.kind),
        joints=list(task.joint_names),
        fingerprint=checks,
        limits=_ranges_of(task),
        frames=_frames(task),
        tool=task.tool.homogeneous.tolist() if isinstance(task, ToolTask) else msgspec.UNSET,
    )


def _placements(task: Task, q: Array) -> Array:
    """Evaluate the placements [R p] of the task's F frames at q (n,), stacked: (3 F, 4), m."""
    places = task.placements(q) if isinstance(task, SeveralFrames) else [task.placement(q)]
    return np.concatenate([place.homogeneous[:3] for place in places])


def _frames(task: Task) -> list[FrameFile] | msgspec.UnsetType:
    """List the frames of a task as a file contains them; UNSET if there is only one frame."""
    if not isinstance(task, SeveralFrames):
        return msgspec.UNSET
    return [FrameFile(spec.frame, str(spec.kind), spec.base) for spec in task.specs]


def task_of(made_for: TaskFile, robot: Robot) -> Task:
    """Create the task (frame, kind, joints, tool) that a design was made for, on a robot.

    The robot is loaded again if its base or its locked joints differ from those of the file.
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
        frames = [_frame_argument(one) for one in made_for.frames]
        task = robot.task(frames, joints=made_for.joints)
    return carrying_tool(made_for, task)


def written_task(made_for: TaskFile) -> str:
    """Format the arguments of :meth:`Robot.task` that create a saved task, as Python text."""
    if isinstance(made_for.frames, msgspec.UnsetType):
        return f"{made_for.frame!r}, {made_for.task!r}"
    return repr([_frame_argument(one) for one in made_for.frames])


def written_robot(made_for: TaskFile, where: str | Path) -> str:
    """Format the arguments of :meth:`Robot.load` for a saved robot that has no catalogue name.

    ``where`` is the path of the design's file, beside which the robot's file may be.
    """
    given = [repr(made_for.found_beside(where))]
    given += [f"lock={made_for.lock!r}"] if made_for.lock else []
    given += [f"base={made_for.base!r}"] if made_for.base is not None else []
    return ", ".join(given)


def _frame_argument(one: FrameFile) -> tuple[str, ...]:
    """Convert a frame of a file to an argument of ``Robot.task``: (link, kind[, base])."""
    given = (one.frame, one.task)
    return given if one.base is None else (*given, one.base)


def carrying_tool(made_for: TaskFile, task: Task) -> Task:
    """Return the task of the file's tool, made from a task of the link that carries the tool.

    A tool is a fixed placement in a link, which the URDF does not contain. The task is returned
    unchanged if the file has no tool, or the task's frame is another link.
    """
    if isinstance(made_for.tool, msgspec.UnsetType) or isinstance(task, ToolTask):
        return task
    return task if task.frame != made_for.frame else carried(task, rigid(made_for.tool))


def compare(made_for: TaskFile, task: Task, where: str) -> None:
    """Check that a task is the one that a design in the file ``where`` was made for.

    Raises
    ------
    InputError
        If the tasks differ; the message names the first difference.
    """
    if isinstance(made_for.coordinates, list):
        raise InputError(
            f"{where} is in joint coordinates ψ with q = T ψ, which are no longer supported; "
            "design again: with --weight absolute if ψ are absolute angles, else with the desired "
            "inverse rp.WeightedInverse(task, np.linalg.inv(T @ T.T))"
        )
    # names first
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
                f"{where} is for the {name} {one!r}, not {other!r}; give a task with this {name}"
            )
    if made_for.frames != mine.frames:
        raise InputError(
            f"{where} is for frames and bases that the task does not have",
            remedy=f"use the task robot.task({written_task(made_for)})",
        )
    if made_for.joints != mine.joints:
        raise InputError(
            f"{where} is for the joints {', '.join(made_for.joints)}, in this order, "
            f"not {', '.join(mine.joints)}; give a task with these joints"
        )
    # then the kinematics, at the check configurations
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
                f"{made_for.frame!r} is displaced by {shift:.3g} m and {turn:.3g} rad; "
                "the model or the locked joints have changed, so design again"
            )


def _ranges_of(task: Task) -> list[JointRange]:
    """List the limits of a task's joints as a file contains them; None where there is no limit."""
    rows = np.transpose([task.lower, task.upper, task.velocity_limit]).tolist()
    return [JointRange(*(v if np.isfinite(v) else None for v in row)) for row in rows]


def require_ranges(made_for: TaskFile, task: Task, *, speeds: bool) -> list[str]:
    """Check that the joint limits are those of the file; with ``speeds``, also the speed limits.

    Returns ["the joint limits"] if the file is from an older version that lacks them, which cannot
    be checked then; otherwise an empty list. InputError names the joint whose limit differs.
    """
    ranges = made_for.limits
    if isinstance(ranges, msgspec.UnsetType):
        return ["the joint limits"]
    if len(ranges) != task.n:
        raise InputError(f"the file has limits of {len(ranges)} joints, not {task.n}; design again")
    now = _ranges_of(task)
    # nan where there is no limit
    before, after = (
        np.array([[one.lower, one.upper, one.velocity] for one in every], float)
        for every in (ranges, now)
    )
    same = np.isclose(before, after, rtol=0, atol=_TOLERANCE, equal_nan=True)
    for name, was, is_, kept in zip(task.joint_names, ranges, now, same, strict=True):
        if not kept[:2].all():
            pairs = (f"[{_text(one.lower)}, {_text(one.upper)}]" for one in (was, is_))
            what = "the limits of {!r} were {} and are {}".format(name, *pairs)
            raise _changed(made_for, what)
        if speeds and not kept[2]:
            rates = _text(was.velocity), _text(is_.velocity)
            what = "the speed limit of {!r} was {} and is {}".format(name, *rates)
            raise _changed(made_for, what)
    return []


def require_arm_angles(basis: BasisFile, made_for: TaskFile, task: Task) -> list[str]:
    """Check that the frames of arm angles are where they were when the design was saved.

    An arm angle is a potential made of shoulder, elbow and wrist frames; other potentials of
    ``basis`` are not checked. Returns the names of what could not be compared: ["the frames of the
    arm angle"] if the file is from an older version that lacks their positions, otherwise []. If a
    frame has moved, an InputError names that frame.
    """
    if isinstance(basis, JoinedFile):
        parts = [require_arm_angles(part, made_for, task) for part in basis.parts]
        return [name for names in parts for name in names]
    if not isinstance(basis, ArmAngleFile):
        return []
    if isinstance(basis.points, msgspec.UnsetType):
        return ["the frames of the arm angle"]
    now = points_at(task, basis.frames, configurations(made_for))
    shifts = np.abs(now - _like(basis.points, now, "an arm angle")).max(axis=(0, 2))
    for name, shift in zip(basis.frames, shifts, strict=True):
        if not shift < _TOLERANCE:
            raise _changed(
                made_for,
                f"at its check configurations the frame {name!r} is displaced by {shift:.3g} m",
            )
    return []


def require_masses(desired: Desired, made_for: TaskFile, task: Task) -> list[str]:
    """Check that the robot's inertia has not changed, if it weights the desired inverse.

    Returns ["the masses"] if the file is from an older version that lacks the inertia, otherwise an
    empty list. InputError is raised if the relative difference of the inertia exceeds 1e-9.
    """
    if not isinstance(desired, WeightedFile) or desired.weight != "inertia":
        return []
    if isinstance(desired.inertia, msgspec.UnsetType):
        return ["the masses"]
    now = task.inertias(configurations(made_for))
    away = np.abs(now - _like(desired.inertia, now, "the inertia")).max()
    if not away < _TOLERANCE * np.abs(now).max():
        raise _changed(
            made_for, f"at its check configurations the inertia differs by {away:.3g} kg m² or kg"
        )
    return []


def configurations(made_for: TaskFile) -> Array:
    """Return the check configurations of a file (K, n), at which geometry is compared."""
    return np.array([check.q for check in made_for.fingerprint])


def _like(rows: list[list[list[float]]], now: Array, what: str) -> Array:
    """Convert numbers of a file to an array, and check that it has the shape of ``now``.

    ``now`` are the present values of the same quantity, which ``what`` names in the InputError.
    """
    try:
        before = np.array(rows, float)
    except ValueError:
        before = np.empty(0)
    if before.shape != now.shape:
        raise InputError(f"the file has a damaged fingerprint of {what}; design again")
    return before


def _text(limit: float | None) -> str:
    return "none" if limit is None else f"{limit:.9g}"


def _changed(made_for: TaskFile, what: str) -> InputError:
    return InputError(
        f"the file is for another {made_for.robot}: {what}; the model has changed, so design again"
    )
