"""Lower bounds of the leaf margin over boxes of joint space, computed by leaf_margin_bounds.c.

The leaf margin, from 0 to 1, is the distance from an algorithmic singularity. At such a singularity
the matrix J_V is singular: the task Jacobian J stacked on the gradients V of the potentials.
docs/theory.md, "Proved, not sampled", derives the bounds.

``LeafMarginBounds`` are bounds on the leaf margin and on σ_min(J) over K boxes of joint space.
``Potentials`` are r functions h(q) that a repeatable controller holds constant.
``LeafMarginProblem`` is a task with potentials, prepared for bounds of the leaf margin over boxes
of joint space. ``Chain`` is a serial chain of joints, with the screws (twists per joint speed) in
the frame of a middle link. ``Features`` are r potentials as sums of features (products, sines,
cosines), with bounds on a box Ω.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import Array, read_only
from ...model.task import Task
from ...native import PROBLEM, filled_struct, point, required_library
from ...potentials.basis import Potentials
from ...regions.box import Box
from .chain import (
    Chain,
    chains_of,
    frame_change,
    frames_of,
    relative_rounding,
    screw_sizes,
    tool_reach,
)
from .potentials import Features, features_of


@dataclass(frozen=True, eq=False)
@read_only
class LeafMarginBounds:
    """Bounds on the leaf margin and σ_min(J) over K boxes of joint space.

    Attributes
    ----------
    leaf_margin : (K,) array
        Lower bound of the leaf margin on the whole box; 0 where J_V was not proved to be regular.
    center : (K,) array
        Upper bound of the leaf margin at the box's centre. No lower bound on the box can exceed it.
    sigma_min : (K,) array
        Lower bound of σ_min(J) on the whole box; 0 where none was found.
    split : (K,) array of int
        Index of the joint along which to halve the box.
    """

    leaf_margin: Array
    center: Array
    sigma_min: Array
    split: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
@read_only
class LeafMarginProblem:
    """Leaf margin of potentials of a task, prepared for bounds over boxes inside one region.

    J_V (N, N) is the task Jacobian stacked on the potentials' gradients. N counts the n joints of
    the task and virtual joints, which represent motions that the task leaves free, see
    :class:`.Chain`. A box Q ± half contains the joint positions q with ``|q − Q| ≤ half``, rad or
    m; K is the number of boxes.

    Attributes
    ----------
    chains : tuple of Chain
        Chain of each frame of the task, virtual joints included.
    features : Features
        The potentials as sums of features: monomials, sines, cosines and arm angles.
    round : (N,) array
        Bounds on the rounding errors of the entries in each row of J_V.
    eps : float
        Relative rounding error of sums.
    beta : float
        Factor β in the bound ``σ_min(J) ≥ 1 / (β ‖Y‖_F)``, see :func:`.frame_change`. Y is a right
        inverse of the joint screws at the middle link.
    """

    chains: tuple[Chain, ...]
    features: Features
    round: Array
    eps: float
    beta: float

    @property
    def n(self) -> int:
        """Number of the task's joints, without virtual joints."""
        return self.chains[0].n

    @property
    def N(self) -> int:
        """Number of rows and columns of J_V, including those of virtual joints."""
        return self.chains[0].N

    @property
    def r(self) -> int:
        """Number of potentials."""
        return len(self.features.G)

    def bounds(self, Q: Array, half: Array) -> LeafMarginBounds:
        """Bound the leaf margin and σ_min(J) on boxes of joints Q ± half, (K, n) each, rad or m."""
        bound, center, sigma = np.zeros((3, len(Q)))
        split = np.zeros(len(Q), np.int32)
        self.run("leaf_margins", Q, half, bound, center, sigma, split)
        return LeafMarginBounds(bound, center, sigma, split)

    def deviations(self, Q: Array, half: Array) -> Array:
        """Bound ``|A J_V − I|`` on boxes of joints Q ± half, (K, n) each: (K, N, N).

        A is an approximate inverse of J_V at the centre. If the spectral radius of the bound is
        below 1, J_V is regular on the whole box. The bound is inf where no approximate inverse was
        found.
        """
        D = np.full((len(Q), self.N, self.N), np.inf)
        self.run("deviations", Q, half, D)
        return D

    def run(self, kernel: str, Q: Array, half: Array, *more: Any) -> None:
        """Run a function of the native library on boxes of joints Q ± half, (K, n) each.

        ``kernel`` is the name of the C function. ``more`` are its further arguments: numbers and
        contiguous arrays of inputs, then arrays into which the function writes its results.
        """
        call = getattr(required_library("a proof"), kernel)
        problem = self.struct()
        arms = self.arm_angles(Q, half)
        boxes = (np.ascontiguousarray(values, float) for values in (Q, half))
        given = [*boxes, arms, *more]
        call(ctypes.byref(problem), ctypes.c_long(len(Q)), *map(_as_argument, given))

    def struct(self) -> Any:
        """Create the C struct PROBLEM: the chains, the features and the rounding bounds."""
        parts, upper = self.features, np.triu_indices(self.n)
        ints = {name: getattr(parts, name) for name in ("kind", "parent", "variable")}
        reals = {name: getattr(parts, name) for name in ("z0", "G", "T", "T4", "E")}
        reals |= {
            "Zq": parts.Z,
            "C": parts.C[:, upper[0], upper[1]],
            "C3": parts.C3[:, :, upper[0], upper[1]],
            "round": self.round,
        }
        sizes = {"frames": len(self.chains), "n": self.n, "N": self.N, "r": self.r}
        sizes |= {"Z": len(parts.Z), "F": len(parts.kind), "F3": len(parts.third)}
        scalars = sizes | {"eps": self.eps, "beta": self.beta}
        made, _ = filled_struct(PROBLEM, ints | {"third": parts.third}, reals, scalars)
        point(made, "frame", [chain.struct() for chain in self.chains])
        return made

    def arm_angles(self, Q: Array, half: Array) -> Array | None:
        """Expand the gradients of arm angles to first order on boxes Q ± half, (K, n) each.

        The result (K, r, n² + 2 n + 1) is an argument of C functions; it is None if no potential
        contains an arm angle. For each box and each of the r potentials, the last axis holds: n
        entries of the gradient of the arm angles at the centre, n² derivatives of this gradient,
        row by row, n bounds on the remainder, and one bound on the rounding error.
        """
        if not self.features.arms:
            return None
        K, n = Q.shape
        out = np.zeros((K, self.r, n * n + 2 * n + 1))
        for arm in self.features.arms:
            found = arm.gradient_bounds(Q, half)
            values = np.concatenate([found.V, found.dV.reshape(K, -1)], axis=1)
            bounds = np.concatenate([found.rest, self.eps * found.size[:, None]], axis=1)
            out[..., : n + n * n] += arm.weights[:, None] * values[:, None]
            out[..., n + n * n :] += np.abs(arm.weights)[:, None] * bounds[:, None]
        return out

    def undefined(self, Q: Array, half: Array) -> NDArray[np.bool_]:
        """Test in which boxes of joints Q ± half, (K, n) each, an arm angle may be undefined: (K,).

        An angle is undefined, for example, where the elbow is on the line from shoulder to wrist.
        """
        rests = [arm.gradient_bounds(Q, half).rest for arm in self.features.arms]
        found = [~np.isfinite(rest).all(axis=1) for rest in rests]
        return np.any([np.zeros(len(Q), bool), *found], axis=0)


def _as_argument(value: Any) -> Any:
    """Convert an argument for C: arrays to their address, numbers to doubles; None stays None."""
    if value is None:
        return None
    if isinstance(value, np.ndarray):
        return ctypes.c_void_p(value.ctypes.data)
    return ctypes.c_double(value)


def leaf_margin_of(task: Task, field: Potentials, box: Box) -> LeafMarginProblem:
    """Prepare bounds on the leaf margin of the potentials ``field`` inside a box of joint space.

    The joint screws of each frame are expressed in the frame of its middle link. This link is
    chosen such that the proof is expected to require the fewest boxes.
    """
    features, chains = features_of(field, task.n, box), list(chains_of(task))

    def needed(f: int, links: Chain) -> float:
        """Estimate how tight the bounds are with the chain ``links`` for frame number f.

        A is the inverse of J_V at the centre of ``box``, the box of :func:`leaf_margin_of`. The
        result is the spectral radius of the bound on ``|A J_V − I|`` on a smaller box, with the
        same centre as ``box`` and an eighth of its half-widths. Lower is better; inf means that
        there is no bound.
        """
        one = _prepared(task, (*chains[:f], links, *chains[f + 1 :]), features, box)
        D = one.deviations(box.center[None], box.half_width[None] / 8)[0]
        finite = np.isfinite(D).all()
        return float(np.abs(np.linalg.eigvals(D)).max()) if finite else np.inf

    for f, chain in enumerate(chains):
        links = [chain.seen_from(k, 0.5) for k in range(len(chain.p) + 1)]
        best = min(links, key=lambda one: needed(f, one))
        ends = [best.seen_from(best.middle, way) for way in (0.0, 1.0)]
        chains[f] = min([best, *ends], key=lambda one: needed(f, one))
    return _prepared(task, tuple(chains), features, box)


def _prepared(
    task: Task, chains: tuple[Chain, ...], features: Features, box: Box
) -> LeafMarginProblem:
    """Create a leaf-margin problem, with bounds on the rounding errors.

    ``chains`` has one chain per frame of the task. The bounds hold for boxes inside ``box``.
    """
    eps = max(map(relative_rounding, chains))
    rounds, betas = [], []
    for part, chain in zip(frames_of(task), chains, strict=True):
        S = chain.S[:, : chain.n]
        theta, eta = S @ box.center + chain.o, np.abs(S) @ box.half_width
        rounds.append(eps * screw_sizes(chain, theta, eta))
        t = tool_reach(chain) + float((np.abs(theta) + eta)[~chain.revolute].sum())
        betas.append(float(frame_change(part.kind, np.array(t))) * (1 + 1e-9))
    rounds.append(eps * features.size + features.E.max(axis=1))
    return LeafMarginProblem(chains, features, np.concatenate(rounds), eps, max(betas))
