"""Limits of a motion in time, as given by the user and as numbers per joint of a task.

A timed motion goes from rest to rest over time; the governor generates a motion online, towards a
target that may change while the arm moves.

``JointLimits`` are maximum joint speeds and accelerations (n,) and, if given, torques and jerks, as
numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import (
    Array,
    as_numbers,
    flag,
    freeze,
    per_joint,
    read_only,
    require_type,
    shown,
)
from ..base.errors import InputError
from ..model.several_frames import one_frame
from ..model.task import Task
from ..model.urdf_rules import NO_EFFORT

_PRESETS: dict[str, tuple[tuple[float, ...], str]] = {
    "panda": (
        (15, 7.5, 10, 12.5, 15, 20, 20),
        "frankaemika.github.io/docs/control_parameters.html, limits for Panda",
    ),
    "fr3": (
        (10,) * 7,
        "frankarobotics.github.io/docs/robot_specifications.html, limits for Franka Research 3",
    ),
    "ur": ((5,) * 6, "Universal_Robots_ROS2_Driver, ur_moveit_config/config/joint_limits.yaml"),
}
"""Published acceleration limits of arms, rad/s² from the base outward, and their sources.

Franka's controller stops beyond its limits; libfranka's ``rate_limiting.h`` has the same numbers
(branch 0.8 for Panda, main for FR3). UR publishes only torque limits; the numbers here are those
of its MoveIt configuration, "conservatively" chosen. FR3's speed limits that depend on position
are not included."""

_JERKS: dict[str, tuple[tuple[float, ...], str]] = {
    "panda": ((7500, 3750, 5000, 6250, 7500, 10000, 10000), _PRESETS["panda"][1]),
    "fr3": ((5000,) * 7, "libfranka, include/franka/rate_limiting.h, kMaxJointJerk, from 0.10 on"),
}
"""Published jerk limits of arms, rad/s³ from the base outward, and sources; UR publishes none."""

_FULL_SPEED = 0.2
"""Assumed time, s, in which a joint reaches its speed limit, if its acceleration limit is
unknown."""

_UNLIMITED = 10.0
"""Assumed acceleration limit, rad/s² or m/s², of a joint that has no speed limit either."""


def presumed_acceleration(task: Task) -> tuple[Array, str]:
    """Choose acceleration limits (n,), rad/s² or m/s², of a task's joints; name their source.

    The second result is the source, as a text. The URDF's limits are used if it has one for every
    joint, else published limits of the arm. If there are none, each limit is the joint's speed
    limit divided by 0.2 s, or 10 rad/s² (m/s²) without a speed limit.
    """
    entry = task.robot.entry
    names = task.joint_names
    own = limits_of_file(task, "acceleration")
    if np.isfinite(own).all():
        return own, "acceleration limits of the model"
    if entry is not None and entry.acceleration is not None:
        published = _PRESETS[entry.acceleration][0]
        if len(published) == len(names):
            return np.array(published, float), f"published limits for {entry.acceleration}"
    speed = task.velocity_limit
    return np.where(
        np.isfinite(speed), speed / _FULL_SPEED, _UNLIMITED
    ), f"assumed: each joint reaches its speed limit in {_FULL_SPEED:g} s"


@dataclass(frozen=True, eq=False, kw_only=True)
@read_only
class Limits:
    """Limits of speed, acceleration, jerk and torque for timed motions and the governor.

    They are arguments of :func:`timed`, :func:`approach` and :class:`Governor`. Acceleration limits
    must be given unless the URDF has them (``acceleration`` and ``deceleration`` of ``<limit>``,
    URDF 1.2). Without them, the fastest motion would leave rest with a jump in speed.

    Attributes
    ----------
    acceleration : float, (n,) array or str
        Acceleration limits of the robot's joints, rad/s² or m/s², or a name of published limits:
        ``panda``, ``fr3``, ``ur``. By default the URDF's.
    velocity : float or (n,) array, optional
        Speed limits, rad/s (m/s); by default the URDF's.
    jerk : float, (n,) array or str, optional
        Jerk limits of the robot's joints, rad/s³ or m/s³, or a name of published limits: ``panda``,
        ``fr3``. By default the URDF's if it has one for every joint, else not limited.
    torque : bool
        True to respect the URDF's effort limits too. A governor refuses this limit.
    tool_speed : float or (2,) array, optional
        Largest speed of the frame along the path, m/s; or of its linear and its angular speed, m/s
        and rad/s. A governor refuses this limit.

    Raises
    ------
    InputError
        If a number is not above 0, or no limits are published under a name. If acceleration limits
        are missing, the function that uses the limits raises the error.

    Examples
    --------
    >>> limits = rp.Limits(acceleration=5.0, jerk=500.0)  # rad/s², rad/s³
    >>> timed = rp.timed(motion, limits)
    >>> bool(np.abs(timed.qddot).max() < 5.01)
    True
    """

    acceleration: ArrayLike | str | None = None
    velocity: ArrayLike | None = None
    jerk: ArrayLike | str | None = None
    torque: bool = False
    tool_speed: ArrayLike | None = None

    def __post_init__(self) -> None:
        freeze(
            self,
            acceleration=_known(self.acceleration, "acceleration", _PRESETS),
            velocity=_known(self.velocity, "velocity"),
            jerk=_known(self.jerk, "jerk", _JERKS),
            torque=flag(self.torque, "torque"),
            tool_speed=_known(self.tool_speed, "tool_speed"),
        )


def _known(
    given: ArrayLike | str | None,
    name: str,
    published: dict[str, tuple[tuple[float, ...], str]] | None = None,
) -> Array | str | None:
    """Check limits of the user as far as that is possible without a robot, and return them.

    ``given`` is a number above 0, one per joint, a name in ``published``, or None. Numbers are
    returned as an array. Other values raise an InputError whose message contains ``name``, the name
    of the argument. ``published`` maps names to (numbers, their source).
    """
    if given is None:
        return None
    if isinstance(given, str) and published is not None:
        if given not in published:
            raise InputError(
                f"no {name} limits are published for {given!r}, only for {', '.join(published)}; "
                f"give numbers, one {name} limit per joint"
            )
        return given
    array = as_numbers(given)
    if array is None or array.ndim > 1 or not array.size or not (array > 0).all():
        raise InputError(
            f"must be one number above 0, or one per joint; got {shown(given)}"
            if name != "tool_speed"
            else f"must be one number above 0 or 2 of them, m/s and rad/s; got {shown(given)}",
            argument=name,
        )
    if published is not None and not np.isfinite(array).all():
        raise InputError(f"{name} must be finite numbers")
    return array


_InverseDynamics = Callable[[Array, Array, Array], Array]
"""Function (q, q̇, q̈) → joint torques τ, (n,) each."""


@dataclass(frozen=True, eq=False)
@read_only
class JointLimits:
    """Limits of the joints (n,) and of the tool, as numbers for one task.

    The user gives :class:`Limits`; timing is computed with these numbers.

    Attributes
    ----------
    velocity, acceleration, jerk : (n,) arrays
        Limits in rad or m, per s, s² and s³; ``jerk`` is None if it is not limited.
    torque, dynamics
        Effort limits (n,), N m or N, and the function (q, q̇, q̈) → efforts (n,); None if efforts
        are not limited.
    tool
        Function from q and q̇ at K samples, (K, n) each, to the speed of the frame as a fraction of
        its limit, (K,); None without a limit.
    """

    velocity: Array
    acceleration: Array
    torque: Array | None = None
    dynamics: _InverseDynamics | None = None
    jerk: Array | None = None
    tool: Callable[[Array, Array], Array] | None = None

    def most_rate(self, Q: Array, slope: Array) -> Array:
        """Compute the largest ṡ within the speed limits at K points of a path q(s): (K,).

        Q (K, n) are the configurations, and ``slope`` (K, n) their derivatives dq/ds.
        """
        used = (np.abs(slope) / self.velocity).max(axis=1)
        if self.tool is not None:
            used = np.maximum(used, self.tool(Q, slope))
        return 1 / np.maximum(used, 1e-9)


def joint_limits(task: Task, limits: Limits) -> JointLimits:
    """Convert the user's limits to numbers per joint of a task, completed by those of the URDF.

    Raises
    ------
    InputError
        If a size does not fit, acceleration limits are missing, or the URDF lacks efforts or masses
        for torque limits.
    """
    what = "rp.Limits, such as rp.Limits(acceleration=5.0)"
    limits = require_type(limits, Limits, "limits", what)
    names = task.joint_names
    own = task.velocity_limit
    given, tool = limits.velocity, limits.tool_speed
    acceleration = limits.acceleration
    if acceleration is None:
        acceleration = _own_acceleration(task, also_jerk=limits.jerk is not None)
    jerk = limits_of_file(task, "jerk") if limits.jerk is None else limits.jerk
    unlimited = not isinstance(jerk, str) and np.isinf(jerk).any()
    found = JointLimits(
        own if given is None else per_joint(given, len(names), "velocity"),
        _per_joint(acceleration, _PRESETS, task, "acceleration"),
        jerk=None if unlimited else _per_joint(jerk, _JERKS, task, "jerk"),
        tool=None if tool is None else _tool_share(task, tool),
    )
    if not limits.torque:
        return found
    model = task.robot.model
    efforts = np.array([model.effortLimit[model.getJointId(name) - 1] for name in names])
    if (efforts >= NO_EFFORT).any() or not sum(inertia.mass for inertia in model.inertias) > 0:
        raise InputError(
            "torque limits require the effort of every joint and masses of the links; the model "
            f"lacks {'an effort' if (efforts >= NO_EFFORT).any() else 'all masses'}; omit torque="
        )
    return replace(found, torque=efforts, dynamics=task.dynamics())


def limits_of_file(task: Task, what: str) -> Array:
    """Return the URDF's limits (n,) of a task's joints; inf for a joint without one.

    ``what`` is ``acceleration`` or ``jerk``.
    """
    robot = task.robot
    columns = [robot.joint_names.index(name) for name in task.joint_names]
    found: Array = getattr(robot, f"{what}_limit")[columns]
    return found


def _own_acceleration(task: Task, *, also_jerk: bool) -> Array:
    """Return the URDF's acceleration limits (n,) of a task's joints.

    InputError is raised if a joint has none; with ``also_jerk``, the message adds that jerk limits
    require them too.
    """
    own = limits_of_file(task, "acceleration")
    if not np.isfinite(own).all():
        joint = task.joint_names[int(np.argmax(~np.isfinite(own)))]
        also = "; jerk= requires it too" if also_jerk else ""
        raise InputError(
            f"acceleration= is missing, and the model has no acceleration limit of joint {joint!r}"
            f"; give rad/s² (prismatic: m/s²) per joint, or one of {', '.join(_PRESETS)}{also}"
        )
    return own


def _per_joint(
    given: ArrayLike | str, known: dict[str, tuple[tuple[float, ...], str]], task: Task, what: str
) -> Array:
    """Convert limits of acceleration or jerk, numbers or a published name, to an array (n,).

    ``known`` maps published names to (numbers, their source), and ``what`` is ``acceleration`` or
    ``jerk``. InputError is raised unless there is one number, or one per joint.
    """
    n = len(task.joint_names)
    if isinstance(given, str):
        name, given = given, np.array(known[given][0], dtype=float)
        if len(given) != n:
            raise InputError(
                f"{name!r} has {what} limits of {len(given)} joints, "
                f"but {task.frame!r} is moved by {n}",
                remedy=f"give {n} numbers, one {what} per joint, in place of the name",
            )
    return per_joint(given, n, what)


def _tool_share(task: Task, most: ArrayLike) -> Callable[[Array, Array], Array]:
    """Create the function (q, q̇) → ``max(|v| / v_max, |ω| / ω_max)`` (K,) of the frame.

    q and q̇ (K, n) are those of K samples. ``most`` is v_max, m/s, or (v_max, ω_max), m/s and
    rad/s; a single number does not limit ω.
    """
    v_max, omega_max = per_joint(most, 2, "tool_speed", "m/s and rad/s")
    if np.size(np.asarray(most)) == 1:  # m/s alone
        omega_max = np.inf

    one_frame(task, "tool_speed")

    def share(Q: Array, Qdot: Array) -> Array:
        twists = task.twists(Q, Qdot)
        v = np.linalg.norm(twists[:, :3], axis=1)
        omega = np.linalg.norm(twists[:, 3:], axis=1)
        return np.maximum(v / v_max, omega / omega_max)

    return share
