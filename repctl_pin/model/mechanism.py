"""Joints of a robot, for tasks and drawings: limits, poses, and mimic joints.

A mimic joint follows another joint: its position is a multiple of that of the other joint, plus an
offset. A locked joint is held at the reference pose, the usual configuration of the robot. An
argument ``notes`` is a list of texts for the user, to which a function adds.

``Coupling`` is the map ``θ = S q + offset`` from the free joints q to all joints θ, mimic joints
included. ``Range`` is the limits of a joint: lower, upper, velocity, acceleration and jerk.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..base.arguments import Array, read_only
from .catalogue import Entry
from .model import frame_id
from .urdf import Description, Joint

_EQUAL = 1e-6
"""Difference, rad, m or relative, below which two limits, written with few digits, are the same."""

_LARGE_LOSS = 0.05
"""Share of a range or speed limit above which its loss by a mimic joint is a warning."""


@dataclass(frozen=True, eq=False)
@read_only
class Coupling:
    """Map ``θ = S q + offset`` from n free joints q to all N joints θ of a model.

    A free joint mimics no other; a mimic joint follows a free one. A task computes with q alone.

    Attributes
    ----------
    S : (N, n) array
        One nonzero entry per row: 1 for a free joint, the multiplier for a mimic joint.
    offset : (N,) array
        Offsets of the mimic joints, rad or m; 0 for free joints.
    """

    S: Array
    offset: Array

    @cached_property
    def identity(self) -> bool:
        """True if no joint mimics another: θ = q, and the methods return their argument."""
        same = np.array_equal(self.S, np.eye(self.S.shape[1]))
        return same and not self.offset.any()

    def joints(self, Q: Array) -> Array:
        """Compute the positions of all joints (..., N) from those of the free joints (..., n)."""
        return Q if self.identity else Q @ self.S.T + self.offset

    def rates(self, Qdot: Array) -> Array:
        """Compute the velocities of all joints (..., N) from those of the free joints (..., n)."""
        return Qdot if self.identity else Qdot @ self.S.T

    def derivatives(self, J: Array) -> Array:
        """Convert derivatives J by all joints (..., N) to those by free joints (..., n): J S."""
        return J if self.identity else J @ self.S

    def leader(self, joint: int) -> int:
        """Return the index, in q, of the free joint that drives joint number ``joint`` of θ.

        A free joint drives itself; a mimic joint is driven by the joint that it mimics.
        """
        return int(np.argmax(self.S[joint] != 0))


class Mechanism:
    """Joints of a robot that move independently, with one coordinate each, and their limits.

    These n joints are called movable. A mimic joint follows one of them, and is not counted.

    Attributes
    ----------
    name : str
        Catalogue name, or the name in the file.
    description : Description
        Content of the URDF.
    entry : Entry or None
        Catalogue entry; None for a robot from a file.
    joints : dict of Joint
        All non-fixed joints of the file, by name.
    model : pinocchio.Model
        Model of all N moving joints, mimic joints included; the other joints are fixed at the
        reference pose.
    coupling : Coupling
        Map from the n movable joints to the N joints of the model.
    joint_names : tuple of str
        Names of the n movable joints, in Pinocchio's order.
    lower, upper : (n,) arrays
        Position limits, rad or m, narrowed so that mimic joints stay within their own; −inf and inf
        without a limit.
    velocity_limit, acceleration_limit, jerk_limit : (n,) arrays
        Limits of the rates, rad or m, per s, s² and s³; inf without a limit. The acceleration limit
        is the smaller one of ``acceleration`` and ``deceleration`` in the URDF.
    revolute : (n,) array of bool
        False for prismatic joints.
    reference : (n,) array
        Reference pose: that of the SRDF if the catalogue names one. Joints without a value in the
        SRDF, and all joints of other robots, are at mid-range; a joint without limits is at 0.
    poses : dict of (n,) arrays
        Named poses: ``reference``, ``middle`` (of the joint ranges) and, if the catalogue has one,
        ``ready``, a working pose.
    narrowed : dict of str
        Sentences on the joints whose limits are narrowed by their mimic joints, by joint name.
    locked : tuple of str
        Joints held at the reference pose.
    package_dirs : tuple of str
        Folders in which ``package://`` meshes are looked up.
    base : str or None
        Link relative to which placements are expressed; None for the root link.
    surroundings : Description or None
        Surroundings of the robot, relative to its root.
    """

    name: str
    description: Description
    entry: Entry | None
    joints: dict[str, Joint]
    model: pin.Model
    coupling: Coupling
    joint_names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity_limit: Array
    acceleration_limit: Array
    jerk_limit: Array
    narrowed: dict[str, str]
    revolute: NDArray[np.bool_]
    reference: Array
    poses: dict[str, Array]
    locked: tuple[str, ...]
    package_dirs: tuple[str, ...]
    base: str | None
    surroundings: Description | None

    @property
    def base_id(self) -> int:
        """Id of the frame ``base`` in ``model``; 0, the root, without ``base``."""
        return 0 if self.base is None else frame_id(self.model, self.base)


_Robot = TypeVar("_Robot", bound=Mechanism)


def based(robot: _Robot, base: str | None) -> _Robot:
    """Return the robot, or a copy that places frames relative to the link ``base``.

    A hand can then be controlled relative to the other hand, or to a workpiece that moves. With
    None, the robot itself is returned.
    """
    if base is None:
        return robot
    own = copy(robot)
    own.base = base
    return own


def couple(names: Sequence[str], free: Sequence[str], joints: Mapping[str, Joint]) -> Coupling:
    """Create the coupling of a model's joints (N names) to its free joints (n names).

    ``joints`` are the joints by name. A joint that is not free must mimic a free one directly, not
    through another mimic joint.
    """
    S = np.zeros((len(names), len(free)))
    offset = np.zeros(len(names))
    for row, name in enumerate(names):
        joint = joints[name]
        if name in free:
            S[row, free.index(name)] = 1.0
        else:
            assert joint.mimic is not None, "a joint is free, a mimic joint, or locked"
            S[row, free.index(joint.mimic)], offset[row] = (joint.multiplier, joint.offset)
    return Coupling(S, offset)


@dataclass(frozen=True)
class Range:
    """Limits of a joint, narrowed so that its mimic joints also stay within their own.

    Attributes
    ----------
    lower, upper : float
        Position limits, rad or m.
    velocity, acceleration, jerk : float
        Limits of the rates, rad or m, per s, s² and s³.
    narrowed : str
        Sentence on the limits that mimic joints narrow, empty if they narrow none. It begins with
        ``! `` if the range or the speed limit loses more than 5 %.
    """

    lower: float
    upper: float
    velocity: float
    acceleration: float
    jerk: float
    narrowed: str


def limits(joint: Joint, followers: Sequence[Joint], notes: list[str]) -> Range:
    """Tighten the limits of a joint so that its mimic joints also stay within their own limits.

    ``followers`` are the mimic joints. The position limits of a mimic joint are ignored, with a
    note in ``notes``, if no position of the joint satisfies them, or only a single position.
    """
    lower, upper = joint.lower, joint.upper
    rates = np.array([joint.velocity, joint.acceleration, joint.jerk])
    by: list[str] = []
    slowed_by: list[str] = []
    for follower in followers:
        ends = [
            (end - follower.offset) / follower.multiplier
            for end in (follower.lower, follower.upper)
        ]
        low = max(lower, min(ends))
        high = min(upper, max(ends))
        if high - low <= _EQUAL:
            unit = "m" if joint.kind == "prismatic" else "rad"
            meets = "no position" if low > high + _EQUAL else f"only the position {low:g} {unit}"
            notes.append(
                f"limits [{follower.lower:g}, {follower.upper:g}] of joint {follower.name!r} "
                f"ignored: {meets} of {joint.name!r}, which it mimics, satisfies them"
            )
        elif low > lower + _EQUAL or high < upper - _EQUAL:
            by.append(follower.name)
            lower, upper = low, high
        own = np.array([follower.velocity, follower.acceleration, follower.jerk])
        slower = np.minimum(rates, own / abs(follower.multiplier))
        if slower[0] < rates[0] * (1 - _EQUAL):
            slowed_by.append(follower.name)
        rates = slower
    velocity, acceleration, jerk = rates.tolist()
    narrowed = _narrowed(joint, (lower, upper), velocity, by, slowed_by)
    return Range(lower, upper, velocity, acceleration, jerk, narrowed)


def _narrowed(
    joint: Joint,
    left: tuple[float, float],
    velocity: float,
    by: Sequence[str],
    slowed_by: Sequence[str],
) -> str:
    """Return a sentence on which mimic joints narrow which limits of a joint.

    ``left`` is the new range (lower, upper), rad or m, and ``by`` names the mimic joints that
    narrow the range. ``velocity`` is the new speed limit, per s, and ``slowed_by`` names the mimic
    joints that lower it. The result is empty if ``by`` and ``slowed_by`` are empty.
    """
    said = []
    most = 0.0
    if by:
        said.append(
            f"{joint.name} narrowed from {_interval(joint.lower, joint.upper)} "
            f"to {_interval(*left)} {'m' if joint.kind == 'prismatic' else 'rad'}, "
            f"because it drives {', '.join(by)}"
        )
        most = _loss(joint.upper - joint.lower, left[1] - left[0])
    if slowed_by:
        was = f"{joint.velocity:.4g}" if np.isfinite(joint.velocity) else "no limit"
        said.append(
            f"speed limit of {joint.name} lowered from {was} to {velocity:.4g} "
            f"{'m' if joint.kind == 'prismatic' else 'rad'}/s, "
            f"because it drives {', '.join(slowed_by)}"
        )
        most = max(most, _loss(joint.velocity, velocity))
    if not said:
        return ""
    return f"{'! ' if most > _LARGE_LOSS else ''}{'; '.join(said)}, whose limits hold, too"


def _interval(lower: float, upper: float) -> str:
    ends = (f"{end:.5g}" if np.isfinite(end) else "no limit" for end in (lower, upper))
    return f"[{', '.join(ends)}]"


def _loss(before: float, after: float) -> float:
    """Compute by which fraction a limit falls, from ``before`` to ``after``; 1 from infinity."""
    return 1.0 if np.isinf(before) else 1 - after / before


def pose(
    joints: Sequence[str],
    lower: Array,
    upper: Array,
    turns: NDArray[np.bool_],
    named: Mapping[str, float],
    notes: list[str],
) -> Array:
    """Create a pose (n,), rad or m, within the joint limits: the named values, else mid-range.

    A joint without a named value and without limits is at 0.

    Parameters
    ----------
    joints
        Names of the n joints.
    lower, upper : (n,) arrays
        Limits, rad or m.
    turns : (n,) array of bool
        True if a joint is revolute.
    named
        Values by joint name, rad or m.
    notes
        List to which a text is added for every named value outside the limits, which is moved to
        a value within them.
    """
    bounded = np.isfinite(lower) & np.isfinite(upper)
    middle = (np.where(bounded, lower, 0.0) + np.where(bounded, upper, 0.0)) / 2
    q = np.where(bounded, middle, np.clip(0.0, lower, upper))
    for i, name in enumerate(joints):
        if name not in named:
            continue
        q[i] = _inside(named[name], lower[i], upper[i], bool(turns[i]))
        if abs(q[i] - named[name]) > 1e-3:
            unit = "rad" if turns[i] else "m"
            notes.append(
                f"reference pose: {name} = {named[name]:g} {unit} is outside its limits; "
                f"using {q[i]:g} {unit}"
            )
    return q


def _inside(value: float, lower: float, upper: float, turns: bool) -> float:
    """Move a joint position, rad or m, into its limits: by a full turn if that is enough.

    Otherwise, the nearer limit is returned. A position within the limits is returned unchanged.
    ``turns`` is True for a revolute joint; only its position can be moved by a full turn.
    """
    ways = (0.0, 2 * np.pi, -2 * np.pi) if turns else (0.0,)
    inside = [value + way for way in ways if lower <= value + way <= upper]
    return float(inside[0] if inside else np.clip(value, lower, upper))
