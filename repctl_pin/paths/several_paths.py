"""Closed paths of several frames at once, such as of both hands, with one period.

s runs from 0 to 1 along a cycle. The twist (v, ω) of a frame is the derivative of its placement by
s, in base axes.

``SeveralPaths`` is a closed path of several frames: one path per frame.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array, list_of, read_only, vector
from ..base.errors import InputError
from ..model.chain_formulas import Placements
from ..model.several_frames import of_singles
from ..model.task import Task, require_task
from .task_path import ClosedPath, TaskPath, closed_path, with_arc

PathOfFrame: TypeAlias = ClosedPath | Callable[[Task, Array], ClosedPath] | None
"""Path of one of several frames, or a function (task, q0) → path; None holds the frame still."""

_STILL = "holds still"
"""Name of the path of a frame that does not move."""


@dataclass(frozen=True, eq=False, repr=False)
@read_only
class SeveralPaths(TaskPath):
    """Closed path of a task of F frames, made of one path per frame.

    The functions ``point`` and ``slope`` give the values of all frames in one array (3 F,), and
    ``points`` gives (P, 3 F); ``rotation`` is that of the first frame only.

    Attributes
    ----------
    paths : tuple of TaskPath
        Path of each frame, in the order of the task's frames; a constant path for a frame that
        stands still.
    """

    paths: tuple[TaskPath, ...] = ()

    def __post_init__(self) -> None:
        """Skip the checks of :class:`TaskPath`: each path was checked when it was created."""

    def placement(self, s: float) -> Any:
        """Evaluate the :class:`Placements` of all frames, in order, at s in [0, 1].

        It is a tuple of pinocchio.SE3, with positions in m.
        """
        return Placements(path.placement(s) for path in self.paths)

    def twist(self, s: float) -> Array:
        """Evaluate the twists (v, ω) of F frames at s in [0, 1]: (6 F,), m and rad per cycle."""
        return np.concatenate([path.twist(s) for path in self.paths])

    @property
    def length(self) -> float:
        """Length of one cycle of the longest path, m."""
        return max(path.length for path in self.paths)

    def __repr__(self) -> str:
        return f"<SeveralPaths {self.name}>"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the path of each frame, since functions of s cannot be pickled."""
        names = {name: getattr(self, name) for name in ("spec", "plane", "corners")}
        return partial(_together, **names), (self.name, self.paths)


def several_paths(task: Task, q0: ArrayLike, paths: Sequence[PathOfFrame]) -> TaskPath:
    """Create the closed path of a task of several frames from one path per frame.

    Parameters
    ----------
    task
        Task of several frames.
    q0 : (n,) array
        Start configuration, rad or m; a frame without a path stays where it is at q0.
    paths
        For each frame a closed path, a function (task, q0) → path, or None for a frame that stands
        still. The function is called with the task of its frame alone, and q0 of that task.

    Returns
    -------
    TaskPath
        Path of all frames, a :class:`SeveralPaths`; for a task of one frame, its path.

    Raises
    ------
    InputError
        If there is not one path per frame, the periods differ, or every frame stands still.

    Examples
    --------
    >>> robot = rp.Robot.load("talos")
    >>> hands = robot.task(["gripper_left_base_link", "gripper_right_base_link"])
    >>> q = hands.reference
    >>> left = lambda task, q0: rp.circle(task, q0, 0.08)  # m
    >>> path = rp.several_paths(hands, q, [left, None])
    >>> path.twist(0.3).shape  # of both frames
    (12,)
    """
    q0 = vector(q0, require_task(task).n, "q0")
    listed = list_of(paths, "path", "a list of one path per frame, None to hold still")
    if len(listed) != len(task.frames):
        raise InputError(
            f"has {len(listed)} paths for {len(task.frames)} frames ({', '.join(task.frames)})",
            argument="path",
            remedy="give one path per frame",
        )
    if all(path is None for path in listed):
        raise InputError(
            "holds every frame still", argument="path", remedy="give at least one frame a path"
        )
    made = [
        _path_of(single, q, path)
        for (single, q), path in zip(of_singles(task, q0), listed, strict=True)
    ]
    return made[0] if len(made) == 1 else joined(task, made)


def joined(task: Task, made: Sequence[TaskPath]) -> SeveralPaths:
    """Join the paths ``made``, one per frame in the order of the task's frames, into one path.

    The result has a corner wherever one of the paths has one.

    Raises
    ------
    InputError
        If their periods differ.
    """
    periods = {path.period for path in made if path.period is not None}
    if len(periods) > 1:
        times = " and ".join(f"{period:g} s" for period in sorted(periods))
        raise InputError(
            f"the paths of the frames have different periods, {times}",
            remedy="give all paths the same period",
        )
    names = [
        f"{frame} {_STILL}" if path.name == _STILL else f"{frame}: {path.name}"
        for frame, path in zip(task.frames, made, strict=True)
    ]
    return _together(", ".join(names), tuple(made))


def _together(name: str, paths: tuple[TaskPath, ...], **names: Any) -> SeveralPaths:
    """Join paths of equal period under a display name.

    ``names`` are the attributes ``spec``, ``plane`` and ``corners`` of :class:`TaskPath`.
    """
    return SeveralPaths(
        name,
        lambda s: np.concatenate([path.point(s) for path in paths]),
        lambda s: np.concatenate([path.slope(s) for path in paths]),
        paths[0].rotation,
        tuple(sorted({s for path in paths for s in path.breaks})),
        period=next((path.period for path in paths if path.period is not None), None),
        paths=paths,
        **names,
    )


def paths_of(path: Any) -> list[Any]:
    """List the paths of all frames, in order; for a path of one frame, that path alone."""
    return list(path.paths) if isinstance(path, SeveralPaths) else [path]


def _path_of(task: Task, q0: Array, path: PathOfFrame) -> TaskPath:
    """Return the path of one frame; for None, a path that stays at the frame's place at q0 (n,).

    ``task`` is the task of this frame alone. InputError is raised for anything but a closed path, a
    function that returns one, or None.
    """
    if path is None:
        here = task.placement(q0)
        point, rest = here.translation.copy(), np.zeros(3)
        still = TaskPath(_STILL, lambda s: point, lambda s: rest, here.rotation)
        return with_arc(still, lambda a, b: (0.0, 0.0))
    if isinstance(path, ClosedPath):
        return closed_path(path)
    if not callable(path):
        raise InputError(
            "must have for each frame a closed path, a function (task, q0) → path, "
            "or None to hold the frame still",
            argument="path",
        )
    return closed_path(path(task, q0))
