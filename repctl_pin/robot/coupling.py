"""Joints that mimic others: all joints of a model out of those that are free, ``q_all = S q + o``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..arguments import Array
from ..urdf.gate import Joint


@dataclass(frozen=True)
class Coupling:
    """The map from n free joints to all N joints of a model.

    Attributes
    ----------
    S : (N, n) array
        One entry a row: 1 for a joint that is free, the multiplier for one that follows.
    offset : (N,) array
    """

    S: Array
    offset: Array

    def joints(self, Q: Array) -> Array:
        """Turn free joints (..., n) into all (..., N)."""
        return Q @ self.S.T + self.offset

    def leader(self, joint: int) -> int:
        """The free joint that drives a joint of the model."""
        return int(np.argmax(self.S[joint] != 0))


def couple(names: Sequence[str], free: Sequence[str], joints: Mapping[str, Joint]) -> Coupling:
    """Make the coupling of a model's joints (N names) to the free ones among them (n names)."""
    S, offset = np.zeros((len(names), len(free))), np.zeros(len(names))
    for row, name in enumerate(names):
        joint = joints[name]
        if name in free:
            S[row, free.index(name)] = 1.0
        else:
            assert joint.mimic is not None, "what is neither free nor follows is locked"
            S[row, free.index(joint.mimic)], offset[row] = joint.multiplier, joint.offset
    for array in (S, offset):
        array.setflags(write=False)
    return Coupling(S, offset)


def limits(joint: Joint, followers: Sequence[Joint], notes: list[str]) -> tuple[float, float, float]:
    """Find lower, upper and speed limit of a joint that keep its followers, too, inside theirs.

    A follower that no position of its leader keeps inside its limits is left out, and a note says so.
    """
    lower, upper, velocity = joint.lower, joint.upper, joint.velocity
    for follower in followers:
        ends = [(end - follower.offset) / follower.multiplier for end in (follower.lower, follower.upper)]
        low, high = max(lower, min(ends)), min(upper, max(ends))
        if low < high:
            lower, upper = low, high
        else:
            notes.append(
                f"joint {follower.name!r} mimics {joint.name!r}, no position of which keeps it inside its limits "
                f"[{follower.lower:g}, {follower.upper:g}]: they are ignored"
            )
        velocity = min(velocity, follower.velocity / abs(follower.multiplier))
    return lower, upper, velocity
