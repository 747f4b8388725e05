"""Inputs of a :class:`Servo` from messages: measured joint positions by name, and targets.

Messages can be late, incomplete or stamped by another clock. A stamp is the time of origin that a
message states. n is the number of joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...base.arguments import Array, as_numbers
from ...base.errors import InputError
from ...model.task import Task
from ..cells.geometry.cell import Cell

SAME = 1e-3
"""Tolerance within which measured joints count as unchanged, or as at a command, rad or m."""

_UNIT = 1e-3
"""Tolerance of a quaternion's norm, which should be 1."""

_NO_TURN = (0.0, 0.0, 0.0, 1.0)
"""Quaternion of no rotation."""


class JointReadings:
    """Measured positions of an arm's joints, which may arrive in several messages.

    Parameters
    ----------
    names
        Names of the joints, in the order of the task.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self._found: dict[str, tuple[float, float, float]] = {}
        self._still: tuple[Array, float] | None = None

    def take(self, positions: Mapping[str, float], now: float, stamped: float) -> None:
        """Store positions by joint name that arrived at the time ``now``, s.

        ``stamped`` is the age of the message's stamp, s, negative if the stamp is ahead of the
        clock. Other joints, and numbers that are not finite, are ignored.
        """
        for name in self.names:
            value = positions.get(name)
            if value is not None and np.isfinite(value):
                self._found[name] = (float(value), now, stamped)

    def measured(self, now: float) -> tuple[Array | None, float]:
        """Return the latest joint positions (n,), and the age of the oldest of them, s.

        A stamp that is 1 s ahead of the clock counts like a stamp that is 1 s old. If a joint has
        not been measured yet, the positions are None and the age is 0.
        """
        found = [self._found[name] for name in self.names if name in self._found]
        if len(found) < len(self.names):
            return None, 0.0
        ages = [now - t + abs(stamped) for _, t, stamped in found]
        return np.array([q for q, _, _ in found]), float(np.max(ages))

    def absent(self, now: float) -> str:
        """Describe why the joints are not known at the time ``now``, s: missing, or too old.

        Call it only if :meth:`measured` returns None, or an age above the timeout of the servo.
        """
        missing = [name for name in self.names if name not in self._found]
        if len(missing) == len(self.names):
            return "no joint states yet"
        if missing:
            return f"no joint state of {', '.join(missing)}"
        _, arrived, stamped = max(self._found.values(), key=lambda x: abs(x[2]) - x[1])
        if abs(stamped) <= now - arrived:
            return f"joint states are {self.measured(now)[1]:.2g} s old"
        return (
            f"joint states are refused: their stamp is {clock_difference(stamped)}; "
            "synchronise the clocks, or give a longer timeout"
        )

    def rest(self, now: float, duration: float) -> bool:
        """Test whether the measured joints have been constant for a duration, s, until ``now``.

        Commands may begin only at rest. Call this method at every tick: it compares the joints with
        those of earlier calls. The result is False until all joints have been measured.
        """
        q, _ = self.measured(now)
        if q is None:
            return False
        if self._still is None or np.abs(q - self._still[0]).max() > SAME:
            self._still = (q, now)
        return now - self._still[1] >= duration

    def disturb(self) -> None:
        """Restart the test of :meth:`rest`: joints must be constant for the whole duration again.

        The servo calls this method after late readings, before its first command.
        """
        self._still = None


def clock_difference(age: float) -> str:
    """Write the age of a message's stamp, s, as text, such as "3 s before this clock".

    A negative age is that of a stamp ahead of the clock.
    """
    size = f"{abs(age):.0f}" if abs(age) >= 1000 else f"{abs(age):.3g}"
    return f"{size} s {'ahead of' if age < 0 else 'before'} this clock"


def target_of(
    position: Sequence[float],
    quaternion: Sequence[float],
    task: Task,
    cell: Cell | None,
    tool: pin.SE3 | None = None,
) -> pin.SE3:
    """Convert a position (x, y, z), m, and a quaternion (x, y, z, w) to a placement of the frame.

    Without ``tool``, they are the pose of the frame. With ``tool``, the placement of a tool in the
    frame, they are the pose of this tool. ``cell`` is the cell in which the target must lie, or
    None.

    Raises
    ------
    InputError
        If a number is not finite, the target is outside the cell, or the quaternion does not have
        norm 1. Tasks without a rotation ignore the quaternion.
    """
    target = _placed(position, quaternion if task.kind.turns else _NO_TURN)
    if tool is not None:
        target = target * tool.inverse()
    if cell is not None:
        cell.coordinates_of(target)
    return target


def placement_of(numbers: Any, name: str) -> pin.SE3:
    """Convert the numbers x y z (m) and optionally qx qy qz qw of a parameter to a placement.

    Raises
    ------
    InputError
        If there are not 3 or 7 finite numbers, or the quaternion does not have norm 1.
    """
    found = as_numbers(numbers)
    if found is None or found.shape not in ((3,), (7,)):
        raise InputError(f"parameter {name} must be x y z (m), or x y z qx qy qz qw")
    try:
        return _placed(found[:3], found[3:] if len(found) == 7 else _NO_TURN)
    except InputError as error:
        raise InputError(f"parameter {name}: {error}") from None


def _placed(position: ArrayLike, quaternion: ArrayLike) -> pin.SE3:
    """Convert a position (x, y, z), m, and a quaternion (x, y, z, w) to a placement.

    Raises InputError if a number is not finite, or the quaternion's norm differs from 1 by more
    than 0.001.
    """
    p, x = np.array(position, float), np.array(quaternion, float)
    if not np.isfinite([*p, *x]).all():
        raise InputError(
            "a position or quaternion has numbers that are not finite; send finite numbers"
        )
    norm = float(np.linalg.norm(x))
    if not abs(norm - 1) <= _UNIT:
        raise InputError(f"a quaternion has norm {norm:.4g}, not 1; normalise it")
    return pin.SE3(pin.Quaternion(x / norm).matrix(), p)
