"""What messages say to a :class:`Servo`: measured joints by name, and targets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin

from ..arguments import Array
from ..errors import InputError
from ..inverse_function.cell import Cell
from ..robot.task import Task

SAME = 1e-3
"""Distance of measured joints from others or from a command that counts as none, rad or m."""

_UNIT = 1e-3
"""Distance of a quaternion's norm from 1 that counts as rounding."""


class JointReadings:
    """Measured positions of an arm's joints, which may come in several messages.

    Parameters
    ----------
    names
        The joints, in the order of the task.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self._found: dict[str, tuple[float, float]] = {}
        self._still: tuple[Array, float] | None = None

    def take(self, positions: Mapping[str, float], now: float) -> None:
        """Take positions by name; other joints, and numbers that are not finite, are ignored."""
        for name in self.names:
            value = positions.get(name)
            if value is not None and np.isfinite(value):
                self._found[name] = (float(value), now)

    def measured(self, now: float) -> tuple[Array | None, float]:
        """Collect the joints (n,), None if some are missing, and the age of the oldest, s."""
        found = [self._found[name] for name in self.names if name in self._found]
        if len(found) < len(self.names):
            return None, 0.0
        return np.array([q for q, _ in found]), now - min(t for _, t in found)

    def absent(self, now: float) -> str:
        """Describe which joints are missing or late."""
        missing = [name for name in self.names if name not in self._found]
        if len(missing) == len(self.names):
            return "no joint states yet"
        if missing:
            return f"no joint state of {', '.join(missing)}"
        return f"joint states are {self.measured(now)[1]:.2g} s old"

    def rest(self, now: float, duration: float) -> bool:
        """Tell whether the joints have been the same in all calls for a duration, s."""
        q, _ = self.measured(now)
        if q is None:
            return False
        if self._still is None or np.abs(q - self._still[0]).max() > SAME:
            self._still = (q, now)
        return now - self._still[1] >= duration

    def disturb(self) -> None:
        """Begin the time of rest anew."""
        self._still = None


def target_of(
    position: Sequence[float], quaternion: Sequence[float], task: Task, cell: Cell | None
) -> pin.SE3:
    """Convert a target: (x, y, z), m, and (x, y, z, w).

    Raises
    ------
    InputError
        If it is not finite, no rotation where the task has one, or outside the cell.
    """
    p, x = np.array(position, float), np.array(quaternion, float)
    turns = task.kind in ("pose", "axis")
    if not np.isfinite(p).all() or (turns and not np.isfinite(x).all()):
        raise InputError("it must be finite numbers")
    norm = float(np.linalg.norm(x))
    if turns and not abs(norm - 1) <= _UNIT:
        raise InputError(f"its quaternion has norm {norm:.4g}, not 1")
    target = pin.SE3(pin.Quaternion(x / norm).matrix() if turns else np.eye(3), p)
    if cell is not None:
        cell.coordinates_of(target)
    return target
