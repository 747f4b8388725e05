r"""A task's joints as the screws of a longer chain whose task is a pose.

The null space of J is that of the pose of the same chain with further joints that stand still: a
position task leaves the tool's rotation free, as three revolute joints at the tool would, an axis
task one of them. They are columns of a (6, N) matrix whose null space, on the first n entries, is
that of J."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arguments import Array, read_only
from ..robot.task import Task

FREE: dict[str, tuple[str, str]] = {
    "pose": ("", ""),
    "axis": ("", "z"),
    "position": ("", "xyz"),
    "xy": ("z", "xyz"),
    "xz": ("y", "xyz"),
    "yz": ("x", "xyz"),
}
"""The base's axes along which each kind of task lets the frame move, and the tool's about which it
lets it turn."""


@dataclass(frozen=True, eq=False)
@read_only
class Chain:
    """P joints in a row, with the link in whose frame their screws are written.

    Attributes
    ----------
    R, p, a : (P, 3, 3), (P, 3) and (P, 3) arrays
        Each joint's placement in the frame of the one before, and its axis.
    revolute : (P,) array of bool
    level : (P,) array of bool
        Joints at the tool, about any axis, that keep their axes parallel to the middle link's.
    S, o : (P, N) and (P,) arrays
        ``θ = S q + o``: the positions of these joints, those that stand still being the last N − n
        of q.
    n : int
        The number of the task's own joints.
    middle : int
        How many joints lie before the middle link.
    shift : (3,) array
        The point of the middle link that is the origin, m, from its joint.
    """

    R: Array
    p: Array
    a: Array
    revolute: NDArray[np.bool_]
    level: NDArray[np.bool_]
    S: Array
    o: Array
    n: int
    middle: int
    shift: Array

    def __repr__(self) -> str:
        return f"<Chain of {len(self.p)} joints, seen from the link after joint {self.middle}>"

    @property
    def N(self) -> int:
        """The columns of S, n and those that stand still."""
        return self.S.shape[1]

    @property
    def reach(self) -> Array:
        """Sums of the link offsets between each joint and the origin (P,), m, prismatic joints at
        0."""
        lengths = np.linalg.norm(self.p, axis=1)
        reach, k = np.zeros(len(lengths)), self.middle
        for joint in range(len(lengths)):
            if joint < k:
                reach[joint] = np.linalg.norm(self.shift) + lengths[joint + 1 : k].sum()
            else:
                reach[joint] = (
                    np.linalg.norm(self.p[k] - self.shift) + lengths[k + 1 : joint + 1].sum()
                )
        return reach

    def seen_from(self, middle: int, half: float) -> Chain:
        """Make the same chain with another middle link, its origin a share of the way to the next
        joint."""
        ahead = self.p[middle] if middle < len(self.p) else np.zeros(3)
        shift = np.asarray(half * ahead, float)
        return Chain(
            self.R, self.p, self.a, self.revolute, self.level, self.S, self.o, self.n, middle, shift
        )


def chain_of(task: Task) -> Chain:
    """Take the chain of a task, seen from its base."""
    model, data = task.model, task.model.createData()
    frame = model.frames[task._frame_id]
    path = [int(j) for j in model.supports[frame.parentJoint] if j > 0]
    neutral = pin.neutral(model)
    local = [pin.computeJointJacobian(model, data, neutral, j)[:, model.idx_vs[j]] for j in path]
    turns = [bool(np.linalg.norm(xi[3:]) > 0.5) for xi in local]
    axes = [xi[3:] if turn else xi[:3] for xi, turn in zip(local, turns, strict=True)]
    placements = [model.jointPlacements[j] for j in path]
    S, o = (
        (np.eye(task.n), np.zeros(task.n))
        if task.drive is None
        else (task.drive.S, task.drive.offset)
    )
    rows = [j - 1 for j in path]
    slides, spins = FREE[task.kind]
    unit = dict(zip("xyz", np.eye(3), strict=True))
    before, after = [unit[name] for name in slides], [unit[name] for name in spins]
    stay = pin.SE3.Identity()
    still = len(before) + len(after)
    after = after or [
        unit["z"]
    ]  # a pose has no further joint: one that is in no column marks the frame
    at = (
        [stay] * len(before)
        + placements
        + [frame.placement if i == 0 else stay for i in range(len(after))]
    )
    whole = np.zeros((len(at), task.n + still))
    whole[len(before) : len(before) + len(path), : task.n] = S[rows]
    whole[: len(before), task.n : task.n + len(before)] = np.eye(len(before))
    if spins:
        whole[len(at) - len(after) :, task.n + len(before) :] = np.eye(len(after))
    offsets = np.concatenate([np.zeros(len(before)), o[rows], np.zeros(len(after))])
    return Chain(
        np.array([x.rotation for x in at]),
        np.array([x.translation for x in at]),
        np.array([*before, *axes, *after]),
        np.array([False] * len(before) + turns + [True] * len(after)),
        np.arange(len(at)) >= len(at) - (len(after) if len(spins) != 1 else 0),
        whole,
        offsets,
        task.n,
        0,
        np.zeros(3),
    )


def tool_reach(chain: Chain) -> float:
    """Sum the link offsets from the origin to the frame, m, prismatic joints at 0: a bound of its
    distance."""
    return float(np.linalg.norm(chain.shift) if chain.middle == len(chain.p) else chain.reach[-1])
