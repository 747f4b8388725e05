"""Kinds of task: which coordinates of its frame a task commands, and the task error in them.

A frame moves with the twist (v, ω), in base axes; v is the velocity of its origin. A kind selects
rows of the twist. The task error of a pose task has the whole rotation to the target; that of an
axis task has only the rotation of the tool's z axis. The tool axes are the axes of the frame. All
placements are in the base frame.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..base.arguments import Array, shown
from ..base.errors import InputError
from .chain_formulas import axis_turn, axis_turns, require_rotation, rotation_vectors

_AND = " + "
"""Text between the names of the kinds of several frames."""

KindName = Literal["pose", "axis", "position", "xy", "xz", "yz"]
"""Names of the kinds."""


class Kind(str):
    """Kind of a task: its name, a str such as ``pose``, with the coordinates that it commands.

    Attributes
    ----------
    rows : (m,) array of int
        Rows of the twist (v, ω) of the frame that are commanded, counted from 0.
    m : int
        Number of task coordinates.
    words : str
        Text for the coordinates, used in messages.
    turns : bool
        True if rows of ω are commanded.
    tool_axes : bool
        True for an axis task: ω is commanded about the frame's own x and y axes, which tilts its z
        axis.
    linear : (m,) array of bool
        True for rows of v, False for rows of ω.
    """

    rows: NDArray[np.intp]
    linear: NDArray[np.bool_]
    m: int
    words: str
    turns: bool
    tool_axes: bool

    def __new__(cls, name: str, *rows: int, words: str) -> Kind:
        """Create a kind from its name, ``rows`` and ``words``, see the attributes."""
        kind = super().__new__(cls, name)
        kind.rows = np.array(rows)
        kind.linear = kind.rows % 6 < 3
        for array in (kind.rows, kind.linear):
            array.setflags(write=False)
        kind.m = len(rows)
        kind.words = words
        kind.turns = not kind.linear.all()
        kind.tool_axes = kind.turns and kind.m < 6
        return kind

    @classmethod
    def stacked(cls, kinds: Sequence[Kind]) -> Kind:
        """Create the kind of a task of several frames from the kind of each.

        Row i of frame k, both counted from 0, becomes row 6 k + i of the stacked twists (v, ω) of
        all frames. The name joins the names of the single kinds by " + ".
        """
        rows = (6 * k + int(row) for k, one in enumerate(kinds) for row in one.rows)
        words = "; ".join(one.words for one in kinds)
        kind = cls(_AND.join(kinds), *rows, words=words)
        kind.tool_axes = any(one.tool_axes for one in kinds)
        return kind

    @property
    def each(self) -> tuple[Kind, ...]:
        """Kinds of the single frames that are :meth:`stacked` in this one; else this kind alone."""
        return tuple(KINDS[name] for name in self.split(_AND))

    @property
    def directions(self) -> str:
        """Base axes along which the position is commanded: ``xyz``, or two of these letters."""
        return "".join("xyz"[row] for row in self.rows if row < 3)

    @property
    def planes(self) -> tuple[str, ...]:
        """Planes that a path can lie in, in the order in which to try them: ``xy``, ``yz``, ``xz``.

        A task of two coordinates has its own plane only.
        """
        return (str(self),) if self.m == 2 else ("xy", "yz", "xz")

    def error(self, here: pin.SE3, target: pin.SE3) -> Array:
        """Evaluate the task error (m,) from ``here`` (R, p) to ``target`` (R*, p*), m and rad.

        ``e = (p* − p, log(R* Rᵀ))``, restricted to the rows of this kind. An axis task has,
        instead of the logarithm, the shortest rotation from the tool's z axis to the target's z
        axis, about the tool's x and y axes. InputError is raised if R* is not a rotation.
        """
        p = target.translation - here.translation
        if not self.turns:
            return p[self.rows]
        require_rotation(target.rotation, "the target")
        if self.tool_axes:
            turn = axis_turn(here.rotation, target.rotation)
        else:
            turn = pin.log3(target.rotation @ here.rotation.T)
        return np.concatenate([p, turn])

    def errors(self, p: Array, R: Array, p_goal: Array, R_goal: Array) -> Array:
        """Evaluate the task errors (K, m), m and rad, from K poses (p, R) to K goals.

        p and p_goal are (K, 3), m, and R and R_goal (K, 3, 3).
        ``e = (p_goal − p, log(R_goal Rᵀ))``, restricted to the rows of this kind. An axis task has,
        instead of the logarithm, the rotation of the tool's z axis to that of the goal, about the
        tool's x and y axes. R_goal must be exact rotations.
        """
        away = p_goal - p
        if not self.turns:
            return away[:, self.rows]
        if self.tool_axes:
            turns = axis_turns(R, R_goal)
        else:
            turns = rotation_vectors(R_goal @ np.swapaxes(R, 1, 2))
        return np.hstack([away, turns])

    @staticmethod
    def in_tool_axes(twist: Array, R: Array) -> Array:
        """Convert a twist (6,), or a Jacobian (6, n), to ẋ (5,), or J (5, n), of an axis task.

        The angular rows are about the frame's own x and y axes; R (3, 3) is its rotation.
        """
        return np.concatenate([twist[:3], R.T[:2] @ twist[3:]])

    def __reduce__(self) -> tuple[Callable[[str], Kind], tuple[str]]:
        return _kind_again, (str(self),)


KINDS: Mapping[str, Kind] = {
    kind: kind
    for kind in (
        Kind("pose", 0, 1, 2, 3, 4, 5, words="position and orientation"),
        Kind("axis", 0, 1, 2, 3, 4, words="position and tool axis"),
        Kind("position", 0, 1, 2, words="position"),
        Kind("xy", 0, 1, words="x and y"),
        Kind("xz", 0, 2, words="x and z"),
        Kind("yz", 1, 2, words="y and z"),
    )
}
"""The kinds, by name."""


def _kind_again(name: str) -> Kind:
    """Return the kind with a name, which can join the names of several kinds by " + ".

    Kinds are unpickled by this function.
    """
    kinds = [KINDS[each] for each in name.split(_AND)]
    return kinds[0] if len(kinds) == 1 else Kind.stacked(kinds)


def task_kind(name: str) -> Kind:
    """Find a kind by its name.

    Raises
    ------
    InputError
        If there is no kind of that name.
    """
    if not isinstance(name, str) or name not in KINDS:
        raise InputError(f"there is no task kind {shown(name)}; choose from {', '.join(KINDS)}")
    return KINDS[name]
