r"""The motion along a closed path, enclosed in boxes between its samples, and proved to close.

A lift q(s) is the joint motion over a path x(s) on one leaf, the set of configurations at which the
r potentials have given values, the levels c. Let Φ(q) be the pose and the levels, J_V its Jacobian,
A an inverse of J_V at a sample Q, and J̄ a mean of J_V. In this module, h are half-widths, not the
potentials. Any q and q' in a box of half-widths h around Q satisfy
``q − q' = A (Φ(q) − Φ(q')) − A (J̄ − J_V(Q)) (q − q')``. On an arc of length ℓ therefore

.. math:: |q − Q| ≤ |A| ℓ + |A|\, Δ(h)\, h < h,

with Δ(h) a bound of the change of J_V on the box. The lift then stays in the box, in which Φ is
injective, so its end is the only solution near the next sample. The theory, "The path itself
closes", has the theorem.

A closed path, whose traversal is a cycle, is sampled at K + 1 path parameters s_i, which divide it
into K arcs; ``Q`` are the joints at the samples. Half-widths of boxes are in rad or m. The task has
n joints, r potentials and F frames, such as two hands. An argument ``inverse`` is the repeatable
inverse with these potentials, and ``problem`` has bounds on its J_V over boxes of joints.

``LeafMarginProblem`` is a task with potentials, prepared for bounds of the leaf margin over boxes
of joint space. ``Enclosure`` is boxes of joints that contain a motion, their half-widths, and
whether this is proved. ``_Samples`` are K configurations of a lift, with bounds on their errors and
on the arcs between them. ``_ProvedArcs`` are the proved half-widths of the boxes that contain a
lift between its samples. ``JointChain`` is the serial chain of joints from the base to the frame of
a task, as arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import Array, read_only
from ...base.errors import InputError, SingularityError
from ...model.joint_chain import JointChain, joint_chain
from ...motion import LeafLock, follow
from ...motion.follow import path_grid, placements_along
from ...paths.several_paths import paths_of
from ...paths.task_path import TaskPath
from ...strategies import RepeatableInverse
from .chain import frames_of
from .leaf_margin_bounds import LeafMarginProblem
from .lifts import inverses

_STEPS = (500, 2000, 8000)
"""Numbers of arcs that are tried, until each is short enough for a proof."""

_LOCK = LeafLock(corrections=4)

_CLOSED = 1e-7
"""Gap, rad or m, below which a followed path is taken for closed."""

_SAME = 1e-9
"""Task error, rad or m, up to which a configuration is at the beginning of the path."""

ROUND = 1e-12
"""Rounding of a pose, relative to 1 and the length of the arm."""

_WIDER = 1.25
"""Factor by which a box is wider than the motion that was bounded in a narrower one."""

_LEAST = 1e-6
"""Smallest half-width of a box, relative to its largest: joints that rest have rounding errors."""

_TURN, _BATCH = 0.5, 512


@dataclass(frozen=True, eq=False)
@read_only
class Enclosure:
    """Boxes of joints that contain a motion along a closed path.

    Around a start, the boxes contain instead the configurations at the start's pose for all levels
    in a range around the start's levels.

    Attributes
    ----------
    Q : (K + 1, n) array
        Configurations along the path; the last row repeats the first. Around a start, one
        configuration per box, in any number.
    half : (K + 1, n) array
        Half-widths of the boxes around the rows of Q, rad or m. The box of a row contains the
        motion until the next row. If ``proved`` is False, the half-widths are estimates.
    proved : bool
        True if the motion is proved to close, and the boxes to contain it.
    reason : str
        Reason why there are no boxes: the path has no start, the motion ends in a singularity or
        does not close, or a configuration at some level around the start is not proved. Q is then
        the start. Empty if there are boxes.
    """

    Q: Array
    half: Array
    proved: bool
    reason: str


def enclosed(
    inverse: RepeatableInverse, problem: LeafMarginProblem, path: TaskPath, start: Array
) -> Enclosure:
    """Follow a closed path once on the leaf of the start (n,), and enclose its motion in boxes.

    The boxes are proved if the path has bounds on its arc lengths, and the arcs can be made short
    enough; otherwise they are estimated.
    """
    task, q = inverse.task, start
    try:
        if np.abs(task.error(q, path.placement(0.0))).max() > _SAME:
            q = inverse.solve(path.placement(0.0), q)
    except (InputError, SingularityError) as error:
        return Enclosure(start[None], np.zeros((1, task.n)), False, f"no start: {error}")
    found = None
    bounded = all(one.arc is not None for one in paths_of(path))
    for steps in _STEPS if bounded else _STEPS[:1]:
        try:
            motion = follow(inverse, path, q, cycles=1, steps=steps, integrator=_LOCK)
        except SingularityError as error:
            # smaller steps may pass it, or find that the path does not close
            why = f"the path ends in a singularity ({error})"
            found = Enclosure(q[None], np.zeros((1, task.n)), False, why)
            continue
        gap = float(np.abs(motion.q[-1] - motion.q[0]).max())
        if gap > _CLOSED:
            why = f"the path itself does not close, by {gap:.2g} rad or m"
            return Enclosure(q[None], np.zeros((1, task.n)), False, why)
        Q = np.concatenate([motion.q[:-1], motion.q[:1]])
        if bounded:
            half = _boxes(inverse, problem, path, steps, Q)
            if half is not None:
                return Enclosure(Q, half, True, "")
        found = found or Enclosure(Q, _bent(Q), False, "")
    assert found is not None, "at least one number of steps is tried"
    return found


def _bent(Q: Array) -> Array:
    """Estimate how far a closed path through Q (K, n) is from the lines between its rows: (K, n).

    The last row of Q repeats the first. The estimate for the two lines that meet in row i is
    ``|q_(i−1) − 2 q_i + q_(i+1)| / 2``. This is enough even if the path has a corner between two
    rows; for a parabola, it is four times the actual distance.
    """
    steps = np.diff(Q, axis=0, append=Q[1:2])
    return np.asarray(np.abs(steps - np.roll(steps, 1, axis=0)) / 2)


@np.errstate(all="ignore")
def _boxes(
    inverse: RepeatableInverse, problem: LeafMarginProblem, path: TaskPath, steps: int, Q: Array
) -> Array | None:
    """Bound how far the lift moves from sample Q_i between s_i and s_(i+1): (K + 1, n).

    ``Q`` (K + 1, n) are the configurations at the K + 1 values s_i that :func:`.path_grid` gives
    for ``steps``; K is about ``steps``. The last row of the result repeats the first. Return None
    if the bounds are not proved.
    """
    K = len(Q) - 1
    samples = _Samples.of(inverse, problem, path, steps, Q[:-1])
    if not np.isfinite(samples.arcs).all():
        return None
    found = []
    for first in range(0, K, _BATCH):
        at = np.arange(first, min(first + _BATCH, K))
        arcs = _proved_arcs(inverse, problem, samples.part(at), samples.part((at + 1) % K))
        if arcs is None:
            return None
        found.append(arcs)
    half, box, start, end = map(np.concatenate, zip(*found, strict=True))
    # What the end of an arc may be off its sample must fit into the next box; so must the start,
    # in the last box, where start and end have one pose and one level.
    if not (np.roll(end, 1, axis=0) < box).all():
        return None
    if not (np.abs(Q[0] - Q[K - 1]) + start[0] < box[K - 1]).all():
        return None
    return np.concatenate([half, half[:1]])


class _Samples(NamedTuple):
    """K samples Q (K, n) of a lift, with bounds on their errors, and the path's arcs between them.

    ``arcs`` (K, F, 2) bounds the length, m, and the rotation, rad, of each of F frames until the
    next sample. ``off`` (K,) bounds the norm of the task error, m and rad; ``level_off`` (K, r)
    bounds the error of each level, in the unit of the potential.
    """

    Q: Array
    arcs: Array
    off: Array
    level_off: Array

    @classmethod
    def of(
        cls,
        inverse: RepeatableInverse,
        problem: LeafMarginProblem,
        path: TaskPath,
        steps: int,
        Q: Array,
    ) -> _Samples:
        """Bound the arcs of the frames from s_i to s_(i+1), and the errors of the samples Q_i.

        s_0 to s_K are the values of s that :func:`.path_grid` gives for ``steps``. The samples Q
        (K, n) are the configurations at s_0 to s_(K−1). Their errors are the differences of their
        poses from those of the path, and of their levels from those of the first sample.
        """
        s = path_grid(path, steps)
        arcs = np.array(
            [[one.arc(a, b) for one in paths_of(path) if one.arc] for a, b in pairwise(s.tolist())]
        )
        places = placements_along(path, steps)[:-1]
        off = errors_of(inverse, problem, Q, places, inverse.leaf(Q[0]))
        return cls(Q, arcs * (1 + ROUND), *off)

    def part(self, at: NDArray[np.intp]) -> _Samples:
        """Return the samples with the indices ``at``."""
        return _Samples._make(values[at] for values in self)


def errors_of(
    inverse: RepeatableInverse,
    problem: LeafMarginProblem,
    Q: Array,
    places: Sequence[Any],
    c: Array,
) -> tuple[Array, Array]:
    """Bound the errors of pose (K,) and levels (K, r) at samples Q (K, n), rounding included.

    ``places`` are the K exact poses. ``c`` are the exact levels: (K, r), or (r,) if all samples
    have the same levels. The error of the pose is the norm of the task error, m and rad.
    """
    task = inverse.task
    reach = max(
        float(np.linalg.norm(joint_chain(part).p, axis=1).sum()) for part in frames_of(task)
    )
    off = np.linalg.norm(task.errors(Q, places), axis=1)
    off += ROUND * (1 + reach + np.abs(Q).max(axis=1))
    size = problem.features.size + problem.round[-task.r :]
    rounding = ROUND * size * (1 + np.abs(Q).sum(axis=1))[:, None]
    levels = np.array([inverse.leaf(q) for q in Q])
    return off, np.abs(levels - c) + rounding


class _ProvedArcs(NamedTuple):
    """Proved boxes of a lift on K arcs, each after one sample: half-widths (K, n), rad or m.

    On its arc, the lift stays within ``half`` of the sample. Φ, pose and levels, is injective
    within ``box`` of the sample. The lift begins within ``start`` of the sample, and ends within
    ``end`` of the next sample.
    """

    half: Array
    box: Array
    start: Array
    end: Array


def _proved_arcs(
    inverse: RepeatableInverse, problem: LeafMarginProblem, here: _Samples, after: _Samples
) -> _ProvedArcs | None:
    """Bound the lift on the arcs from samples ``here`` to samples ``after``; None if not proved.

    Row i of ``after`` is the sample that follows row i of ``here``.
    """
    bounds = LiftBoxes(inverse, problem, here.Q)
    found = bounds.around(bounds.moved(here.arcs + here.off[:, None, None], here.level_off))
    if found is None:
        return None
    half, h, bent = found

    def shift(off: Array, level_off: Array) -> Array:
        """Bound the distance of the lift from K samples that are not exactly on it: (K, n).

        The configurations of the lift have exact poses and levels; the samples have errors. ``off``
        (K,) bounds the norm of each sample's task error, m and rad; ``level_off`` (K, r) bounds the
        error of each level.
        """
        moved = bounds.moved(np.repeat(off[:, None, None], 2, 2), level_off)
        share = np.max(moved / h, axis=1) / (1 - np.max(bent / h, axis=1))
        return np.asarray(share[:, None] * h)

    # Where the lift can be: the sample's own error counts twice, for it and its target.
    end = shift(here.off + after.off, here.level_off + after.level_off)
    if not (np.abs(after.Q - here.Q) + end < h).all():
        return None
    return _ProvedArcs(half, h, shift(here.off, here.level_off), end)


class LiftBoxes:
    """Boxes around K samples Q (K, n) in which lifts stay.

    J_V is the task Jacobian stacked on the potentials' gradients, and A its inverse at each sample;
    where J_V is singular, the bounds are inf. :meth:`moved` gives ``|A| ℓ``, :meth:`bent` gives
    ``|A| Δ(h) h``, and :meth:`around` the boxes, all as arrays (K, n), rad or m.
    """

    def __init__(self, inverse: RepeatableInverse, problem: LeafMarginProblem, Q: Array) -> None:
        task = inverse.task
        V = inverse.potentials.gradients(Q)
        J_V = np.concatenate([task.jacobians(Q), np.swapaxes(V, 1, 2)], axis=1)
        A = np.nan_to_num(inverses(J_V), nan=np.inf, posinf=np.inf, neginf=np.inf)
        self.Q, self.problem = Q, problem
        self.linear, self.angular, row = [], [], 0
        self.chains = [joint_chain(part) for part in frames_of(task)]
        for part in frames_of(task):
            own = A[:, :, row : row + part.m]
            row += part.m
            self.linear.append(np.linalg.norm(own[:, :, part.kind.linear], axis=2))
            self.angular.append(np.linalg.norm(own[:, :, ~part.kind.linear], axis=2))
        self.level = np.abs(A[:, :, row:])
        # A is an inverse up to rounding
        wrong, sizes = np.abs(A @ J_V - np.eye(task.n)), np.abs(A) @ np.abs(J_V)
        self.rounding = wrong + 4 * task.n * 2.0**-53 * sizes

    def moved(self, arcs: Array, levels: Array) -> Array:
        """Bound ``|A| ℓ`` (K, n), the motion of the joints over K arcs, to first order.

        ℓ consists of ``arcs`` (K, F, 2), the length, m, and rotation, rad, of each frame, and of
        ``levels`` (K, r), the largest change of each level.
        """
        found = np.einsum("kir,kr->ki", self.level, levels)
        for f, (linear, angular) in enumerate(zip(self.linear, self.angular, strict=True)):
            g = min(f, arcs.shape[1] - 1)
            found = found + linear * arcs[:, g, :1] + angular * arcs[:, g, 1:]
        return np.asarray(found, float)

    def around(self, arc: Array) -> tuple[Array, Array, Array] | None:
        """Find boxes in which lifts stay, given their motion ``arc`` (K, n) to first order.

        ``arc``, rad or m, bounds the motion of each joint over an arc of the path. Return three
        arrays (K, n): bounds on the motion of the lifts; half-widths h of boxes in which Φ, pose
        and levels, is injective; and ``|A| Δ(h) h``, the part of the bounds beyond ``arc``. Return
        None if a lift may leave its box.
        """
        h = 1.5 * arc
        for _ in range(3):
            h = _WIDER * (arc + self.bent(h))
            h = np.maximum(h, _LEAST * h.max(axis=1)[:, None])
        bent = self.bent(h)
        half = (arc + bent) * (1 + 1e-9)
        return (half, h, bent) if (half < h).all() else None

    def bent(self, h: Array) -> Array:
        """Bound the nonlinear part of a motion, ``|A| Δ(h) h`` (K, n), rad or m.

        Δ(h) bounds the change of J_V in the box of half-widths h (K, n) around each sample.
        """
        rounds = self.problem.round
        across = h.sum(axis=1)
        found = np.einsum("kij,kj->ki", self.rounding, h)
        found = found + np.einsum(
            "kir,kr->ki",
            self.level,
            self._level_change(h) + across[:, None] * rounds[-self.level.shape[2] :],
        )
        for chain, linear, angular in zip(self.chains, self.linear, self.angular, strict=True):
            v, w = _pose_changes(chain, self.Q, h)
            rounded = across * rounds[: -self.level.shape[2]].max()
            found = found + linear * (v + rounded)[:, None] + angular * (w + rounded)[:, None]
        return np.asarray(np.nan_to_num(found, nan=np.inf), float)

    def _level_change(self, h: Array) -> Array:
        """Bound ``|ΔV|ᵀ h`` (K, r): ΔV is the change of the gradients on boxes Q ± h, h (K, n)."""
        parts, Q = self.problem.features, self.Q
        most = np.abs(Q @ parts.Z.T - parts.z0) + h @ np.abs(parts.Z).T  # of the arguments
        phi = np.ones((len(Q), len(parts.kind)))
        for f, (kind, parent, v) in enumerate(
            zip(parts.kind, parts.parent, parts.variable, strict=True)
        ):
            if kind == 1:
                phi[:, f] = phi[:, parent] * most[:, v]
        r, n = parts.G.shape[:2]
        slopes = (np.abs(parts.C).reshape(r * n * n, -1) @ phi.T).T.reshape(len(Q), r, n, n)
        found = np.einsum("kaij,ki,kj->ka", slopes, h, h) * (1 + 1e-9)
        arms = self.problem.arm_angles(Q, h)
        if arms is not None:
            dV = np.abs(arms[..., n : n + n * n]).reshape(len(Q), r, n, n)
            rest = arms[..., n + n * n : 2 * n + n * n] + 2 * arms[..., -1:]
            found = found + np.einsum("kaij,ki,kj->ka", dV, h, h) + np.einsum("kai,ki->ka", rest, h)
        return np.asarray(found, float)


def _pose_changes(chain: JointChain, Q: Array, h: Array) -> tuple[Array, Array]:
    """Bound ``|ΔJ| h``, with ΔJ the change of a frame's Jacobian on boxes Q ± h, (K, n) each.

    Return bounds (K,) on the norm of the linear part, m, and of the angular part, rad.

    Let L_l bound the distance from joint l to the frame, and η be the half-widths of the joints.
    Column l of the Jacobian belongs to joint l. If this joint is revolute, the linear part of its
    column changes by ``η_j min(L_j, L_l)`` for each revolute joint j, and by η_j for each prismatic
    joint j. If it is prismatic, the linear part changes by η_j for each revolute joint j. The
    angular part of a column changes by at most α, the sum of η_j over the revolute joints. The
    bound of the angular part is doubled, because rotations are measured by the rotation vector from
    the sample; it is inf if α is 0.5 rad or more.
    """
    S = np.abs(chain.S)
    turns: NDArray[np.bool_] = chain.revolute
    eta = h @ S.T
    theta = np.abs(Q @ chain.S.T + chain.offset) + eta
    lengths = np.linalg.norm(chain.p, axis=1)
    slides = np.where(turns, 0.0, theta)
    # from joint l to the frame: the offsets after it, and the prismatic joints after it
    after = np.cumsum(lengths[::-1])[::-1][1:]
    L = after + np.cumsum(slides[:, ::-1], axis=1)[:, ::-1] - slides
    revolute, prismatic = eta * turns, eta * ~turns
    alpha = revolute.sum(axis=1)
    least = np.minimum(L[:, :, None], L[:, None, :])
    column = np.einsum("kj,klj->kl", revolute, least) + prismatic.sum(axis=1)[:, None]
    v = (revolute * column).sum(axis=1) + prismatic.sum(axis=1) * alpha
    w = np.where(alpha < _TURN, 2 * alpha**2, np.inf)
    return v, w
