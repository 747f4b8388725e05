"""Task kinematics: x = f(q), its Jacobian J, its Hessian H, and the task error.

Numbers in parentheses are equations of the paper (docs/notation.md). The base frame is that of the
robot's ``base`` link, or of its root. A twist is the velocity (v, ω) of a frame, m/s and rad/s, in
base axes. q (n,) is a configuration, rad (m for prismatic joints). The reference pose is the usual
configuration of the robot; joints that a task does not move are held there. The tool axes are the
frame's own axes: the two rotations of an axis task are about the frame's x and y axes.

``Kind`` is the kind of a task, such as ``pose``, with the coordinates that it commands.
``Mechanism`` is the movable joints of a robot and their limits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..base.arguments import (
    FLOAT,
    Array,
    as_configurations,
    as_matrices,
    as_numbers,
    require_type,
    vector,
)
from ..base.errors import InputError
from ..base.threads import PerThread
from .chain_formulas import Placement, as_placement, as_placements, chain_hessians, require_rotation
from .kind import Kind
from .mechanism import Coupling, Mechanism
from .model import chain_between, frame_id, frame_jacobian, lock_joints, path_between


def _from_degrees(joints: Array, lower: Array, upper: Array) -> str:
    """Write the remedy for a user who may have given joint positions in degrees.

    ``joints`` (n,) are the user's values, converted from degrees to rad for revolute joints. If all
    converted values are within the limits ``lower`` and ``upper`` (n,), rad or m, the text tells
    the user to give them. Otherwise, the text is empty.
    """
    if not ((joints >= lower) & (joints <= upper)).all():
        return ""
    return f"if these are degrees, give {','.join(f'{q:.4g}' for q in joints)}"


def unit_of(revolute: Iterable[bool]) -> str:
    """Return the unit of a norm over joints: ``rad``, ``m`` or ``rad and m``.

    ``revolute`` is True or False for each joint.
    """
    turns = set(map(bool, revolute))
    return "rad and m" if len(turns) > 1 else "rad" if True in turns else "m"


RECOVERABLE = 0.1
"""Distance beyond a joint limit from which a motion may begin that leads back inside, rad or m."""


class Task:
    """Task of controlling one frame of a robot, with the joints that move it.

    ``ẋ = J q̇`` (2), with ``x`` the pose, the position, the position and tool axis, or two
    coordinates of the position. The task is redundant if r = n − m ≥ 1.

    A task is created by :meth:`Robot.task`. Several threads can use one task, and it can be
    pickled.

    Attributes
    ----------
    target_type : type
        Class of a target: pinocchio.SE3, or :class:`Placements` of several frames.
    twist_size : int
        Length of the twists (v, ω) of all frames: 6 per frame.
    n, m, r : int
        Joints, task coordinates, degree of redundancy.
    joint_names : tuple of str
        Joint names from the base outward; q, limits and Jacobian columns are in this order. Mimic
        joints are not listed; they move with the joints that they follow.
    lower, upper, velocity_limit : (n,) arrays
        Position limits, rad or m, and speed limits, rad/s or m/s.
    revolute : (n,) array of bool
        False for prismatic joints.
    reference : (n,) array
        Positions of these joints at the robot's reference pose.
    model : pinocchio.Model
        Model of the chain to the frame; all other joints are fixed at the reference pose. If the
        robot has a ``base``, the chain starts there and has no masses.
    drive : Coupling
        Map from q to the positions of the model's joints.

    Examples
    --------
    >>> task.n, task.m, task.r
    (3, 2, 1)
    >>> task.jacobian(q0).shape
    (2, 3)
    >>> task.placement(q0).translation.round(3)  # m
    array([1.086, 2.133, 0.   ])
    """

    target_type: type = pin.SE3
    twist_size = 6
    shared_bodies: Any = None  # of bodies_of, which creates them; the task alone keeps them alive

    def __init__(
        self, robot: Mechanism, frame: str, kind: Kind, joint_names: Sequence[str]
    ) -> None:
        self._take_joints(robot, frame, kind, joint_names)
        driven = self._driven()
        up, down = path_between(robot.model, robot.base_id, frame_id(robot.model, frame))
        self._bodies = _held(robot, driven)
        self.model = self._bodies if driven <= {*up, *down} else _held(robot, driven & {*up, *down})
        self._frame_id = frame_id(self.model, frame)
        if robot.base is not None:
            base = frame_id(self.model, robot.base)
            self.model, self._frame_id = chain_between(
                self.model, base, self._frame_id, robot.joints
            )
        self._first = self._first_driven()
        self._couple()
        self._allocate()

    def _take_joints(
        self, robot: Mechanism, frame: str, kind: Kind, joint_names: Sequence[str]
    ) -> None:
        """Set the attributes that depend on the joints and the kind only, such as the limits."""
        self.robot = robot
        self.frame = frame
        self.kind = kind
        self.joint_names = tuple(joint_names)
        self._columns = np.array([robot.joint_names.index(j) for j in joint_names])
        self.lower, self.upper = robot.lower[self._columns], robot.upper[self._columns]
        self.velocity_limit = robot.velocity_limit[self._columns]
        self.revolute = robot.revolute[self._columns]
        self.reference = robot.reference[self._columns]
        for array in (self.lower, self.upper, self.velocity_limit, self.revolute, self.reference):
            array.setflags(write=False)
        self.n = len(self.joint_names)
        self.m = kind.m
        self.rows = kind.rows
        self.r = self.n - self.m

    def _driven(self) -> set[int]:
        """Collect the ids, in the robot's model, of the joints that q moves, also mimic joints."""
        moved = (self.robot.coupling.S[:, self._columns] != 0).any(axis=1)
        return set((np.flatnonzero(moved) + 1).tolist())

    def _allocate(self) -> None:
        self._scratch = PerThread(partial(_Scratch, self.model, self._bodies, self._frame_id))

    @property
    def _data(self) -> pin.Data:
        return self._scratch.own.data

    def _couple(self) -> None:
        self.drive = self._drive(self.model)
        self._body_drive = self._drive(self._bodies)

    def _drive(self, model: pin.Model) -> Coupling:
        """Create the map from q to the positions of all joints of a model, also mimic joints."""
        rows = [self.robot.model.getJointId(name) - 1 for name in tuple(model.names)[1:]]
        whole = self.robot.coupling
        return Coupling(whole.S[np.ix_(rows, self._columns)], whole.offset[rows])

    @property
    def unit(self) -> str:
        """Unit of a norm over the joints: ``rad``, ``m`` or ``rad and m``."""
        return unit_of(self.revolute)

    @property
    def _joint_unit(self) -> str:
        """Unit of a minimum over the joints, such as a margin: ``rad``, ``m`` or ``rad or m``."""
        return self.unit.replace(" and ", " or ")

    # ---- frames ----

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the controlled frames: one or several, as given to :meth:`Robot.task`."""
        return (self.frame,)

    @property
    def single_tasks(self) -> tuple[Task, ...]:
        """One task per frame, with only the joints that move it; here, the task itself."""
        return (self,)

    def as_target(self, value: Placement, name: str = "target") -> pin.SE3:
        """Convert a target of the user, a placement or a tuple of one placement.

        Raises
        ------
        InputError
            If the target is no placement; the message calls it ``name``.
        """
        if isinstance(value, tuple) and len(value) == 1:
            (value,) = value
        return as_placement(value, name)

    # ---- kinematics at one q -------------------------------------------------------------------

    def placement(self, q: ArrayLike) -> pin.SE3:
        """Evaluate the forward kinematics f(q) (1): the frame's placement in the base frame, m."""
        data = self._data
        pin.framesForwardKinematics(self.model, data, self._vector(q))
        return pin.SE3(data.oMf[self._frame_id])

    def placements(self, q: ArrayLike) -> tuple[pin.SE3, ...]:
        """Evaluate the placement at q (n,), as a tuple of one.

        Both the tuple and the placement in it can be targets of this task.
        """
        return (self.placement(q),)

    def jacobian(self, q: ArrayLike) -> Array:
        """Evaluate J (m, n) of ẋ = J q̇ (2) at q (n,).

        ẋ are those rows of the frame's twist that the task's kind selects: first rows of v, the
        velocity of the frame's origin, then rows of ω, the angular velocity.
        """
        J = self._task_rows(self._scratch.own.jacobian(self._vector(q)))
        return self.drive.derivatives(J)

    def hessian(self, q: ArrayLike) -> Array:
        """Evaluate H (m, n, n), the derivative of the Jacobian: ``H[a, i, k] = ∂J[a, i]/∂q[k]``."""
        return self.hessians(vector(q, self.n, "q")[None])[0]

    def error(self, q: ArrayLike, target: Placement) -> Array:
        """Evaluate the task error (m,) from the frame's placement at q to the target, m and rad.

        ``e = (p* − p, log(R* Rᵀ))`` from the placement (R, p) to the target (R*, p*), restricted to
        the rows of the task's kind. For an axis task, the rotation is the shortest one from the
        frame's z axis to the target's z axis, in tool axes.
        """
        target = self.as_target(target)
        return self.kind.error(self.placement(q), target)

    def task_velocity(self, q: ArrayLike, twist: ArrayLike) -> Array:
        """Extract ẋ (m,) from a frame's twist (v, ω), base axes, m/s and rad/s.

        v is the velocity of the frame's origin, and ω the angular velocity. The kind selects the
        rows.
        """
        twist = vector(twist, 6, "the twist (v, ω)", "m/s and rad/s")
        if not self.kind.tool_axes:
            return twist[self.rows]
        return self.kind.in_tool_axes(twist, self.placement(q).rotation)

    # ---- batches -------------------------------------------------------------------------------

    def jacobians(self, Q: ArrayLike) -> Array:
        """Evaluate J of ẋ = J q̇ at every row of Q (K, n): (K, m, n)."""
        J, R = self._twists(Q)
        Js = J.take(self.rows, axis=1)
        if R is not None:
            Js[:, 3:] = np.swapaxes(R, 1, 2)[:, :2] @ J[:, 3:]
        return self.drive.derivatives(Js)

    def twists(self, Q: ArrayLike, Qdot: ArrayLike) -> Array:
        """Evaluate the frame's twist (v, ω) at each row of Q and Qdot (K, n): (K, 6), base axes.

        The units are m/s and rad/s.
        """
        J, _ = self._twists(Q)
        Qdot = as_configurations(Qdot, self.n, repr(self))
        return np.einsum("Kij,Kj->Ki", J, self.drive.rates(Qdot))

    def hessians(self, Q: ArrayLike) -> Array:
        """Evaluate H at every row of Q (K, n): (K, m, n, n), ``[:, a, i, k] = ∂J[a, i]/∂q[k]``."""
        J, R = self._twists(Q)
        H = chain_hessians(np.swapaxes(J, 1, 2), R)[:, self.rows]
        along = np.swapaxes(self.drive.derivatives(H), -1, -2)
        return np.swapaxes(self.drive.derivatives(along), -1, -2)

    def errors(self, Q: ArrayLike, targets: Sequence[Placement]) -> Array:
        """Evaluate the task error from each row of Q (K, n) to its target: (K, m), m and rad.

        The error is target minus pose. The rotation is in base axes or, for an axis task, in tool
        axes. ``targets`` has one placement per row of Q.
        """
        targets = as_placements(targets, "target", "a list of placements")
        goals = {id(target): target for target in targets}  # many are the same object
        if self.kind.turns:
            for goal in goals.values():
                require_rotation(goal.rotation, "the target")
        Q = self._matrix(Q)
        if len(Q) != len(targets):
            raise InputError(
                f"{len(targets)} targets do not match {len(Q)} configurations; "
                "give one target per configuration"
            )
        order = {name: k for k, name in enumerate(goals)}
        which = [order[id(target)] for target in targets]
        to = np.array([goal.homogeneous for goal in goals.values()]).reshape(-1, 4, 4)
        p, R = self._placements(Q)
        return self.kind.errors(p, R, to[which, :3, 3], to[which, :3, :3])

    def positions(self, Q: ArrayLike) -> Array:
        """Compute the frame's origin at every row of Q (K, n): (K, 3), m in the base frame."""
        return self._placements(self._matrix(Q))[0]

    def joint_origins(self, q: ArrayLike) -> Array:
        """Compute the origins of the joints, from the base outward: (n, 3), m in the base frame.

        A joint that others mimic drives several joints of the chain; its row is the origin of the
        one nearest to the base.
        """
        pin.forwardKinematics(self.model, self._data, self._vector(q))
        return np.array([self._data.oMi[j].translation for j in self._first])

    def axes(self, q: ArrayLike) -> Array:
        """Compute the joints' rotation axes: unit vectors (n, 3), base axes; 0 if prismatic.

        A joint that others mimic drives several joints of the chain; its row is the axis of the
        one nearest to the base.
        """
        return self._scratch.own.jacobian(self._vector(q))[3:].T[[j - 1 for j in self._first]]

    def bodies_model(self) -> tuple[pin.Model, Coupling]:
        """Return a model of all links, and the map from q to the positions of its joints.

        The model has a fixed root and only the joints that q moves, also those beside the chain to
        the frame, because they move links that can collide.
        """
        return self._bodies, self._body_drive

    def inertias(self, Q: ArrayLike) -> Array:
        """Evaluate the joint-space inertia M at every row of Q (K, n): (K, n, n), kg m² and kg.

        It includes all links that q moves. The root of the robot is fixed.
        """
        model = self._bodies
        data = self._scratch.own.body_data
        drive = self._body_drive
        Q = as_configurations(Q, self.n, repr(self))
        Ms = np.empty((len(Q), model.nv, model.nv))
        for q, M in zip(drive.joints(Q), Ms, strict=True):
            upper = np.triu(pin.crba(model, data, q))
            M[:] = upper + np.triu(upper, 1).T
        return drive.S.T @ Ms @ drive.S

    def dynamics(self) -> Callable[[Array, Array, Array], Array]:
        """Create the inverse dynamics (q, q̇, q̈) → ``τ = M q̈ + C q̇ + g`` (n,), N m and N.

        M is the joint-space inertia, C q̇ are velocity terms, and g is gravity. The function has
        its own scratch memory, so each thread needs a function of its own.
        """
        model, drive = self.bodies_model()
        data = model.createData()

        def torques(q: Array, qdot: Array, qddot: Array) -> Array:
            motion = drive.joints(q), drive.rates(qdot), drive.rates(qddot)
            return drive.derivatives(pin.rnea(model, data, *motion)).copy()

        return torques

    # ---- between the chain and the robot --------------------------------------------------------

    def to_robot(self, q: ArrayLike) -> Array:
        """Extend q (n,) or Q (T, n) to the configuration of all movable joints of the robot.

        The other joints are at the reference pose.
        """
        (q,) = as_matrices(("q", q, f"{self.n}"))
        whole = np.broadcast_to(
            self.robot.reference, (*q.shape[:-1], len(self.robot.reference))
        ).copy()
        whole[..., self._columns] = q
        return whole

    @property
    def narrowed(self) -> list[str]:
        """Sentences on the joints whose limits in the URDF are narrowed by joints that mimic them.

        A sentence begins with ``! `` if the range or the speed limit is reduced by more than 5 %.
        """
        narrowed = self.robot.narrowed
        return [narrowed[joint] for joint in self.joint_names if joint in narrowed]

    def from_robot(self, whole: ArrayLike) -> Array:
        """Extract q (..., n) from configurations of all movable joints of the robot.

        ``whole`` (..., R) has the R joints in the order of ``robot.joint_names``. This inverts
        :meth:`to_robot`, which adds the reference positions of the other joints.
        """
        (whole,) = as_matrices(("the whole robot's q", whole, f"{len(self.robot.reference)}"))
        return whole[..., self._columns]

    def limit_margin(self, q: ArrayLike) -> Array:
        """Compute the distance of each joint to its nearer limit: (..., n), rad or m.

        It is negative outside the limits, and inf for a joint without limits.
        """
        if not (isinstance(q, np.ndarray) and q.dtype.kind == "f" and q.shape[-1:] == (self.n,)):
            (q,) = as_matrices(("q", q, f"{self.n}"))
        q = np.asarray(q, float)
        return np.minimum(q - self.lower, self.upper - q)

    def as_dict(self) -> dict[str, Any]:
        """Return a dict for JSON: robot, frame, task (the kind), n, m, r, joints (names)."""
        names = {"robot": self.robot.name, "frame": self.frame, "task": str(self.kind)}
        return {**names, "n": self.n, "m": self.m, "r": self.r, "joints": list(self.joint_names)}

    def check(self, q: ArrayLike, what: str = "q", beyond: float = 1e-9) -> Array:
        """Check a configuration of the user, and return it: (n,) finite numbers within the limits.

        ``what`` is its name in messages. ``beyond`` is the distance, rad or m, by which a joint
        may be outside its limits.

        Raises
        ------
        InputError
            If the configuration has the wrong size, is not finite, or violates a limit; the message
            names the joint.
        """
        given = as_numbers(q)
        if given is not None and given.ndim == 1 and len(given) != self.n:
            moved = f"{self.frame!r} is moved by {self.n} joints: {', '.join(self.joint_names)}"
            raise InputError(
                f"has {len(given)} numbers, but {moved}",
                argument=what,
                remedy="give one number per joint",
            )
        if given is not None and given.shape == (self.n,) and not np.isfinite(given).all():
            bad = self.joint_names[int(np.argmin(np.isfinite(given)))]
            raise InputError(
                f": the value of joint {bad!r} is not a finite number",
                argument=what,
                remedy="correct it",
            )
        q = vector(q, self.n, what)
        lower, upper, turns = self.lower, self.upper, self.revolute
        outside = ~((q >= lower - beyond) & (q <= upper + beyond))
        if outside.any():
            k = int(np.argmax(outside))
            unit = "rad" if turns[k] else "m"
            more = f" by more than {beyond:g} {unit}" if beyond > 1e-9 else ""
            raise InputError(
                f": {self.joint_names[k]} = {q[k]:g} {unit} is outside its limits "
                f"[{lower[k]:g}, {upper[k]:g}] {unit}{more}",
                argument=what,
                remedy=_from_degrees(np.where(turns, np.deg2rad(q), q), lower, upper),
            )
        return q

    # ---- inside --------------------------------------------------------------------------------

    def _first_driven(self) -> list[int]:
        """Find, on the path to the frame, the id of the first joint that each entry of q moves.

        This is the joint itself, or one that mimics it.
        """
        leaders = self.robot.coupling.S[:, self._columns] != 0  # (N, n)
        ids = path_between(self.model, 0, self._frame_id)[1]
        # (path, n)
        driven = leaders[[self.robot.model.getJointId(self.model.names[j]) - 1 for j in ids]]
        return [ids[k] for k in np.argmax(driven, axis=0)]

    def _task_rows(self, J: Array) -> Array:
        """Select the task's m rows from the frame's Jacobian J (6, N), in base axes: (m, N).

        N is the number of joints of the model, mimic joints included. The two rotations of an axis
        task are returned in tool axes. J must be the last one evaluated, because Pinocchio's data
        must still hold the frame's rotation, which an axis task needs.
        """
        if self.m == 6:
            return J
        if not self.kind.tool_axes:
            return J[self.rows]
        return self.kind.in_tool_axes(J, self._data.oMf[self._frame_id].rotation)

    def _twists(self, Q: ArrayLike) -> tuple[Array, Array | None]:
        """Evaluate the frame's Jacobians (K, 6, N), and its rotations (K, 3, 3) for an axis task.

        For other tasks, None is returned instead of the rotations. Q is (K, n). Rows are v, then ω,
        in base axes; N is the number of joints of the model, mimic joints included.
        """
        Q = self._matrix(Q)
        Js = np.empty((len(Q), 6, self.model.nv))
        evaluate = self._scratch.own.jacobian
        Rs = np.empty((len(Q), 3, 3)) if self.kind.tool_axes else None
        for k, q in enumerate(Q):
            Js[k] = evaluate(q)
            if Rs is not None:
                Rs[k] = self._data.oMf[self._frame_id].rotation
        return Js, Rs

    def _placements(self, Q: Array) -> tuple[Array, Array]:
        """Evaluate the frame's positions (K, 3), m, and rotations (K, 3, 3) in the base frame.

        Q (K, N) has a value per joint of the model, mimic joints included.
        """
        here = self._data.oMf[self._frame_id]
        p, R = here.translation, here.rotation  # views, which each evaluation fills
        points, turns = np.empty((len(Q), 3)), np.empty((len(Q), 3, 3))
        for k, q in enumerate(Q):
            pin.framesForwardKinematics(self.model, self._data, q)
            points[k], turns[k] = p, R
        return points, turns

    def _vector(self, q: ArrayLike) -> Array:
        values: Any = q
        if not (
            type(q) is np.ndarray
            and q.dtype is FLOAT
            and q.shape == (self.n,)
            and abs(sum(q.tolist())) < np.inf
        ):
            values = vector(q, self.n, f"q of {self!r}")  # faster than np.isfinite
        return self.drive.joints(values)

    def _matrix(self, Q: ArrayLike) -> Array:
        Q = np.ascontiguousarray(as_configurations(Q, self.n, repr(self)))
        return self.drive.joints(Q)

    def __getstate__(self) -> dict[str, Any]:
        own = ("_scratch", "shared_bodies")
        return {k: v for k, v in self.__dict__.items() if k not in own}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._allocate()

    @property
    def frame_words(self) -> str:
        """Name of the frame, followed by "relative to" and the base link if the robot has one."""
        base = self.robot.base
        return self.frame if base is None else f"{self.frame} relative to {base}"

    def __str__(self) -> str:
        return f"{self.frame_words}, {self.kind}: n = {self.n} joints, m = {self.m}, r = {self.r}"

    def __repr__(self) -> str:
        size = f"n = {self.n}, m = {self.m}, r = {self.r}"
        return f"<Task {self.robot.name} {self.frame} {self.kind}: {size}>"


class _Scratch:
    """Scratch memory of a task for one thread: Pinocchio's data of its two models.

    They are ``data`` of the chain to the frame, and ``body_data`` of all links that q moves.
    """

    def __init__(self, model: pin.Model, bodies: pin.Model, frame: int) -> None:
        self.data = model.createData()
        self.body_data = self.data if bodies is model else bodies.createData()
        self.jacobian = frame_jacobian(model, self.data, frame)


def _held(robot: Mechanism, moving: set[int]) -> pin.Model:
    """Build the model of a robot in which only the joints with ids in ``moving`` are left.

    All other joints are locked at the reference pose.
    """
    still = [j for j in range(1, robot.model.njoints) if j not in moving]
    return lock_joints(robot.model, still, robot.coupling.joints(robot.reference))


def require_task(value: Any) -> Task:
    """Return a value that is a task; raise InputError for any other value."""
    return require_type(value, Task, "task", "a task, such as rp.Robot.load('panda').task()")


def own_task(value: Any) -> Task:
    """Copy a task with separate scratch memory; model and limits are shared.

    A strategy keeps such a copy, so that two strategies can run in two threads.
    """
    return copy(require_task(value))
