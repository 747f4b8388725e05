"""Serial chain of a task, extended by virtual joints so that its task is a pose.

A task with fewer than six coordinates leaves motions of the frame free. Each free motion is
represented by a virtual joint, which does not move. For a position task, which leaves the rotation
free, there are three revolute virtual joints at the tool. For an axis task, there is one. For each
position coordinate that is not controlled, there is a prismatic virtual joint at the base. The task
has n joints; with the virtual joints, q has N entries. A twist is a velocity (v, ω), linear part
first. The screws, which are twists per unit of speed of an entry of q, are the columns of a (6, N)
matrix. The null space of this matrix, restricted to the first n entries, is the null space of J.

``Chain`` is a serial chain of joints, with the screws (twists per joint speed) in the frame of a
middle link.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import Array, read_only
from ...model.joint_chain import joint_chain
from ...model.several_frames import SeveralFrames
from ...model.task import Task
from ...native import CHAIN, filled_struct
from .potentials import U

FREE: dict[str, tuple[str, str]] = {
    "pose": ("", ""),
    "axis": ("", "z"),
    "position": ("", "xyz"),
    "xy": ("z", "xyz"),
    "xz": ("y", "xyz"),
    "yz": ("x", "xyz"),
}
"""Free motions of the frame, for each kind of task.

They are the base axes along which it can translate, and the tool axes about which it can rotate.
"""


@dataclass(frozen=True, eq=False)
@read_only
class Chain:
    """Serial chain of P joints, virtual ones included, with a middle link.

    The N entries of q are the positions of the task's n joints, then one for each motion that the
    task leaves free, so that the task of the chain is a pose. S maps q to the positions of the
    P joints. P and N may differ, because a joint can follow another one, and because q has the
    joints of all chains of a task. The joints of free motions
    are virtual: they do not move, and only their screws are used. The screws of the joints, twists
    per unit of joint speed, are expressed in the frame of the middle link. The choice of that link
    decides how tight the bounds of a proof are.

    Attributes
    ----------
    R, p, a : (P, 3, 3), (P, 3) and (P, 3) arrays
        Rotation and origin, m, of each joint in the frame of the previous one, and its axis.
    revolute : (P,) array of bool
        False for prismatic joints.
    level : (P,) array of bool
        True for virtual joints at the tool whose axes are those of the middle link, not of the
        tool. If the task leaves all rotations free, these are three joints, because any three axes
        span the rotations. An axis task has none. A pose task has one, without an entry of q: its
        row of S is 0, and it only gives the origin of the task's frame.
    S, o : (P, N) and (P,) arrays
        Map ``θ = S q + o`` from q to the positions of the P joints. The last N − n entries of q
        belong to the virtual joints.
    n : int
        Number of the task's own joints.
    middle : int
        Number of joints before the middle link.
    shift : (3,) array
        Point at which the screws are expressed (their origin), m, in the middle link's frame.
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

    @property
    def N(self) -> int:
        """Number N of columns of S: the task's n joints and the virtual joints."""
        return self.S.shape[1]

    @property
    def reach(self) -> Array:
        """Bounds (P,), m, on the distance of each joint's origin from the origin of the screws.

        A bound is the sum of the lengths of the links between both points; strokes of prismatic
        joints are not included.
        """
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
        """Return the chain with another middle link, in whose frame the joint screws are expressed.

        ``middle`` is the number of joints before that link. ``half``, from 0 to 1, places the
        origin of the screws between that link's joint (0) and the next joint (1).
        """
        ahead = self.p[middle] if middle < len(self.p) else np.zeros(3)
        shift = np.asarray(half * ahead, float)
        return replace(self, middle=middle, shift=shift)

    def struct(self) -> Any:
        """Create the C struct :data:`CHAIN`, from which the native library computes the screws."""
        row, column = np.nonzero(self.S)
        ints = {
            "revolute": self.revolute,
            "level": self.level,
            "first": np.searchsorted(row, np.arange(len(self.S) + 1)),
            "column": column,
        }
        reals = {name: getattr(self, name) for name in ("R", "p", "a", "shift", "reach")}
        reals |= {"o": self.o, "S": self.S[row, column]}
        sizes = {"P": len(self.S), "k": self.middle, "n": self.n, "N": self.N}
        return filled_struct(CHAIN, ints, reals, sizes)[0]


def chain_of(task: Task) -> Chain:
    """Create the chain of a task, virtual joints included, with the base as its middle link.

    A virtual joint represents a motion of the frame that the task leaves free.
    """
    joints, unit = joint_chain(task), dict(zip("xyz", np.eye(3), strict=True))
    slides, spins = ([unit[name] for name in names] for names in FREE[task.kind])
    tool = spins or [unit["z"]]  # of a pose: in no column, it marks the frame
    before, own, after = len(slides), len(joints.axes), len(tool)
    P = before + own + after

    R, p = np.tile(np.eye(3), (P, 1, 1)), np.zeros((P, 3))
    R[before : before + own + 1] = joints.R
    p[before : before + own + 1] = joints.p
    S = np.zeros((P, task.n + before + len(spins)))
    S[before : before + own, : task.n] = joints.S
    S[:before, task.n : task.n + before] = np.eye(before)
    if spins:
        S[P - after :, task.n + before :] = np.eye(after)
    o = np.zeros(P)
    o[before : before + own] = joints.offset
    level = np.arange(P) >= P - (after if len(spins) != 1 else 0)
    return Chain(
        R,
        p,
        np.array([*slides, *joints.axes, *tool]),
        np.array([False] * before + list(joints.revolute) + [True] * after),
        level,
        S,
        o,
        task.n,
        0,
        np.zeros(3),
    )


def frames_of(task: Task) -> tuple[Task, ...]:
    """Return one task per frame of a task; each has all joints of the given task.

    A task can control several frames, such as those of two arms. With one frame, the result has one
    item, the task itself.
    """
    return task.parts if isinstance(task, SeveralFrames) else (task,)


def chains_of(task: Task) -> tuple[Chain, ...]:
    """Create one chain per frame of a task, virtual joints included, with a common vector q.

    q holds the task's joints, then the virtual joints of every frame. The matrix S of each chain
    has one column per entry of q. So J_V can be assembled row by row.
    """
    chains = [chain_of(part) for part in frames_of(task)]
    before = np.cumsum([0, *(chain.N - chain.n for chain in chains)])
    wide = []
    for chain, first in zip(chains, task.n + before, strict=False):
        S = np.zeros((len(chain.p), task.n + before[-1]))
        S[:, : task.n] = chain.S[:, : task.n]
        S[:, first : first + chain.N - task.n] = chain.S[:, task.n :]
        wide.append(replace(chain, S=S))
    return tuple(wide)


def tool_reach(chain: Chain) -> float:
    """Bound the distance of the end-effector frame from the origin of the screws, m.

    The bound is the sum of the lengths of the links between both points; strokes of prismatic
    joints are not included.
    """
    return float(np.linalg.norm(chain.shift) if chain.middle == len(chain.p) else chain.reach[-1])


def frame_change(kind: str, distance: Array) -> Array:
    """Bound the factor β of ``σ_min(J) ≥ 1 / (β ‖Y‖_F)``, for a right inverse Y at another point.

    The twists of J refer to the task's frame, but Y is a right inverse of the Jacobian whose twists
    refer to the origin of the screws. β is the norm of the matrix that transforms one kind of
    twists to the other. ``distance``, m, an array of any shape, bounds the distance between both
    points; the result has the same shape. ``kind`` is the kind of the task, such as "pose". For a
    task of positions β = 1, because its twists have no rotation.
    """
    t = np.asarray(distance, float)
    turns = kind in ("pose", "axis")
    return np.asarray((t + np.sqrt(t * t + 4)) / 2 if turns else np.ones_like(t))


def relative_rounding(chain: Chain) -> float:
    """Bound the relative rounding error of sums and screws: ``512 (P + N + 2) u``, u = 2⁻⁵³.

    P is the number of joints along the chain, N the number of joints in q, with virtual joints. The
    error of a rotation after k joints is at most 64 k u, and the error of a screw is at most 128 (k
    + 2) u times its length. The error of a sum of N products is at most (N + 2) u times the sum of
    their absolute values; see docs/theory.md.
    """
    return 512 * (len(chain.p) + chain.N + 2) * U


def screw_sizes(chain: Chain, theta: Array, eta: Array) -> Array:
    """Bound the magnitude of the entries in each row of the screws on a box of joints: (6,).

    The first three rows are linear, the others angular. The box is θ ± η, ``theta`` and ``eta``
    (P,) each, for all P joints of the chain, mimic joints and virtual joints included. The bounds
    also hold for a screw at θ plus its derivatives with respect to the joints times η, the terms
    of its Taylor model. Rounding errors of the entries are stated relative to these bounds.
    """
    L = chain.reach.max() + (np.abs(theta) + eta)[~chain.revolute].sum()
    columns = np.abs(chain.S).sum(axis=0).max()
    swing = 1 + 2 * eta.sum()
    return np.repeat([columns * (1 + L) * swing, columns * swing], 3)
