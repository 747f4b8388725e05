"""Task of several frames at once, with stacked Jacobians, Hessians and errors.

The F frames are in a fixed order, and the rows of the first are on top. A frame can be controlled
relative to a base of its own, another link. J is the Jacobian, and H its derivative by q. A twist
is the velocity (v, ω) of a frame, m/s and rad/s. q (n,) is a configuration, rad (m for prismatic
joints).

``Mechanism`` is the movable joints of a robot and their limits. ``FrameSpec`` is one of several
frames: its link, its kind of task, its base, and the joints that move it. ``Placements`` is the
target of several frames: a tuple of pinocchio.SE3.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..base.arguments import Array, list_of, shown, vector
from ..base.errors import InputError
from .chain_formulas import Placement, Placements, as_placement
from .kind import Kind
from .mechanism import Mechanism, based
from .task import Task, _held


class FrameSpec(NamedTuple):
    """One of several frames: its link, its kind of task, its base, and the joints that move it.

    ``frame`` and ``joints`` are names. ``base`` is the name of the link relative to which the frame
    is controlled; None for the robot's own base.
    """

    frame: str
    kind: Kind
    base: str | None
    joints: tuple[str, ...]


class SeveralFrames(Task):
    """Task of controlling several frames of a robot, with all joints that move any of them.

    With ``x = (x₁, …, x_F)`` of F frames, the J, H, errors and twists (v, ω) of the frames are
    stacked, the first frame on top. A target has one placement per frame.

    Attributes
    ----------
    parts : tuple of Task
        Task of each frame alone, but with all joints: its J has zero columns for joints that do not
        move the frame.
    """

    target_type = Placements
    parts: tuple[Task, ...]

    def __init__(self, robot: Mechanism, specs: Sequence[FrameSpec]) -> None:
        moved = {joint for spec in specs for joint in spec.joints}
        joints = [name for name in robot.joint_names if name in moved]
        kind = Kind.stacked([spec.kind for spec in specs])
        frame = " + ".join(spec.frame for spec in specs)
        self._take_joints(robot, frame, kind, joints)
        self.specs = tuple(specs)
        self.twist_size = 6 * len(specs)
        self.parts = tuple(
            Task(based(robot, spec.base), spec.frame, spec.kind, joints) for spec in specs
        )
        self._singles = tuple(
            Task(based(robot, spec.base), spec.frame, spec.kind, spec.joints) for spec in specs
        )
        self.model = self._bodies = _held(robot, self._driven())
        self._frame_id = 0
        self._couple()
        self._allocate()

    # ---- frames ----

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the frames that are controlled."""
        return tuple(spec.frame for spec in self.specs)

    @property
    def single_tasks(self) -> tuple[Task, ...]:
        """One task per frame, with only the joints that move this frame."""
        return self._singles

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Names of the frames, one tuple per group of frames whose chains share joints.

        Frames of different groups share no joint: they are independent tasks, which should be
        studied one by one.
        """
        groups: list[tuple[set[str], list[str]]] = []
        for spec in self.specs:
            joints, frames = set(spec.joints), [spec.frame]
            others = []
            for group in groups:
                if group[0] & joints:
                    joints |= group[0]
                    frames = group[1] + frames
                else:
                    others.append(group)
            groups = [*others, (joints, frames)]
        return tuple(tuple(frames) for _, frames in groups)

    def as_target(self, value: Placement, name: str = "target") -> Any:
        """Convert a target of the user, one placement per frame, to a tuple of pinocchio.SE3.

        Raises
        ------
        InputError
            If the target is not one placement per frame; the message calls the target ``name``.
        """
        if isinstance(value, Placements) and len(value) == len(self.parts):
            return value
        given: Any = value
        stack = isinstance(given, np.ndarray) and given.ndim == 3
        listed = list(given) if stack or isinstance(given, (list, tuple)) else []
        if len(listed) != len(self.parts):
            raise InputError(
                f"{name} must be {len(self.parts)} placements, one per frame "
                f"({', '.join(self.frames)}); got {shown(value)}"
            )
        return Placements(
            as_placement(each, f"{name} of {frame}")
            for each, frame in zip(listed, self.frames, strict=True)
        )

    # ---- kinematics at one q ----

    def placement(self, q: ArrayLike) -> pin.SE3:
        """Raise InputError, because there are several frames; use :meth:`placements`."""
        raise InputError(
            f"placement(q) requires one frame, but the task has {len(self.parts)} "
            f"({', '.join(self.frames)})",
            remedy="use placements(q)",
        )

    def placements(self, q: ArrayLike) -> Placements:
        """Evaluate the placements of all frames at q (n,); they can be a target of this task."""
        return Placements(part.placement(q) for part in self.parts)

    def jacobian(self, q: ArrayLike) -> Array:
        """Evaluate J (m, n) of ẋ = J q̇ (2), the rows of the first frame first."""
        return np.concatenate([part.jacobian(q) for part in self.parts])

    def error(self, q: ArrayLike, target: Placement) -> Array:
        """Evaluate the task error (m,) of all frames to their targets, m and rad.

        It is target minus pose, stacked. ``target`` has a placement per frame.
        """
        targets = self.as_target(target)
        return np.concatenate(
            [part.error(q, x) for part, x in zip(self.parts, targets, strict=True)]
        )

    def task_velocity(self, q: ArrayLike, twist: ArrayLike) -> Array:
        """Extract ẋ (m,) from the twists (v, ω) of all frames (6 F,), m/s and rad/s.

        Each twist is in the axes of its frame's base.
        """
        twists = vector(twist, self.twist_size, "the twists (v, ω)", "m/s and rad/s")
        own = zip(self.parts, twists.reshape(-1, 6), strict=True)
        return np.concatenate([part.task_velocity(q, each) for part, each in own])

    # ---- batches ----

    def jacobians(self, Q: ArrayLike) -> Array:
        """Evaluate the stacked J of all frames at every row of Q (K, n): (K, m, n)."""
        return np.concatenate([part.jacobians(Q) for part in self.parts], axis=1)

    def hessians(self, Q: ArrayLike) -> Array:
        """Evaluate H at every row of Q (K, n): (K, m, n, n), ``[:, a, i, k] = ∂J[a, i]/∂q[k]``."""
        return np.concatenate([part.hessians(Q) for part in self.parts], axis=1)

    def errors(self, Q: ArrayLike, targets: Sequence[Placement]) -> Array:
        """Evaluate the task error from every row of Q (K, n) to its target: (K, m), m and rad.

        It is target minus pose, stacked. ``targets`` has K targets, each with one placement per
        frame.
        """
        listed = list_of(targets, "targets", "a list of placements, one per frame")
        goals = {id(target): self.as_target(target) for target in listed}
        columns = zip(*(goals[id(target)] for target in listed), strict=True)
        each = list(columns) or [()] * len(self.parts)
        own = zip(self.parts, each, strict=True)
        return np.concatenate([part.errors(Q, goal) for part, goal in own], axis=1)

    def twists(self, Q: ArrayLike, Qdot: ArrayLike) -> Array:
        """Evaluate the twists (v, ω) of all frames at each row of Q and Qdot (K, n): (K, 6 F).

        v is the velocity of a frame's origin, m/s, and ω its angular velocity, rad/s. Both are in
        the axes of the frame's base.
        """
        return np.concatenate([part.twists(Q, Qdot) for part in self.parts], axis=1)

    def positions(self, Q: ArrayLike) -> Array:
        """Compute the frames' origins at every row of Q (K, n): (K, 3 F), m, each in its base."""
        return np.concatenate([part.positions(Q) for part in self.parts], axis=1)

    def joint_origins(self, q: ArrayLike) -> Array:
        """Compute the origins of the joints, from the base outward: (n, 3), m.

        If a joint moves a frame that is controlled relative to the robot's base, its origin is in
        the robot's base frame. Otherwise, its origin is in the base frame of the last of the frames
        that the joint moves.
        """
        return self._of_joints(q, "joint_origins")

    def axes(self, q: ArrayLike) -> Array:
        """Compute the joints' rotation axes: unit vectors (n, 3); 0 if prismatic.

        If a joint moves a frame that is controlled relative to the robot's base, its axis is in the
        robot's base frame. Otherwise, its axis is in the base frame of the last of the frames that
        the joint moves.
        """
        return self._of_joints(q, "axes")

    # ---- inside ----

    def _of_joints(self, q: ArrayLike, name: str) -> Array:
        """Collect one row per joint, (n, 3), from a method of the single tasks, such as ``axes``.

        ``name`` is the name of the method. For a joint that moves several frames, a row in the
        robot's own base frame is preferred, else the row of the last of these frames.
        """
        whole = self.to_robot(vector(q, self.n, f"q of {self!r}"))
        out = np.zeros((self.n, 3))
        for single in sorted(self._singles, key=lambda one: one.robot is self.robot):
            rows = getattr(single, name)(single.from_robot(whole))
            out[[self.joint_names.index(j) for j in single.joint_names]] = rows
        return out

    def _placements(self, Q: Array) -> tuple[Array, Array]:
        raise NotImplementedError("the parts place the frames")

    def __str__(self) -> str:
        note = "; this is several independent tasks, whose frames share no joint"
        return f"{super().__str__()}{note * (len(self.groups) > 1)}"


def of_singles(task: Task, q: ArrayLike) -> list[tuple[Task, Array]]:
    """Split a task into tasks of one frame each, and q into the joints that move each frame.

    q (n,) is the configuration of the whole task. Return a list of pairs (task of one frame, its
    q), in the order of the frames. For a task of one frame, the only pair is (task, q).
    """
    if not isinstance(task, SeveralFrames):
        return [(task, np.asarray(q, float))]
    whole = task.to_robot(q)
    return [(single, single.from_robot(whole)) for single in task.single_tasks]


def one_frame(task: Task, what: str) -> Task:
    """Return a task of one frame; raise InputError for a task of several.

    ``what`` is the subject of the message, such as "a joint chain".
    """
    if isinstance(task, SeveralFrames):
        raise InputError(
            f"{what} takes a task of one frame, not of {len(task.frames)} "
            f"({', '.join(task.frames)})",
            remedy="give a task of one of these frames",
        )
    return task
