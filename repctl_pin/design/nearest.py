"""Find the repeatable inverse nearest to a desired one, and judge it on fresh nodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ..errors import InputError, SingularityError
from ..fields.field import Field
from ..redundancy.augmented import clearance
from ..redundancy.nullspace import nullspace
from ..robot.task import Task
from ..strategies.repeatable import RepeatableInverse
from ..strategies.strategy import Inverse
from . import criterion
from .region import Region

Array = NDArray[np.float64]

_REPLICATES = 16
_MAX_STEPS = 100


@dataclass(frozen=True)
class Design:
    """A repeatable inverse and what it is worth.

    All figures but ``fit_cost`` are taken on nodes that the fit did not see.

    Attributes
    ----------
    inverse : RepeatableInverse
        The result: ``q̇ = G_r ẋ``.
    desired : Inverse
        What it should be near to, G_d.
    fields, region, coefficients
        The potentials (35), Ω, and A (N, r).
    cost, cost_error : float
        Mean over Ω of ‖G_r − G_d‖_F² (26), and its standard error.
    relative_distance : float
        ``sqrt(cost / mean ‖G_d‖_F²)``.
    clearance : float
        The smallest σ_min(Nᵀ V̂) found in Ω: 1 is best, 0 is an algorithmic singularity.
    clearance_at : (n,) array
        Where.
    inside_limits : float
        Share of Ω inside the joint limits.
    fit_cost : float
        The cost on the nodes of the fit: lower, by what was fitted to the nodes alone.
    converged : bool
        The optimiser can predict no decrease above ``tolerance`` of the cost.
    steps : int
        Gauss–Newton steps taken.
    """

    inverse: RepeatableInverse
    desired: Inverse
    fields: Field
    region: Region
    coefficients: Array = field(repr=False)
    cost: float
    cost_error: float
    relative_distance: float
    clearance: float
    clearance_at: Array = field(repr=False)
    inside_limits: float
    fit_cost: float
    gradient_norm: float
    converged: bool
    steps: int

    @property
    def task(self) -> Task:
        """The task the inverse controls."""
        return self.inverse.task

    def summary(self) -> str:
        """Say in a few lines what the design is worth."""
        state = "converged" if self.converged else "NOT converged"
        return "\n".join(
            [
                f"nearest repeatable inverse of {self.task!r}",
                f"  potentials         {self.fields!r}",
                f"  mean ‖G_r − G_d‖²  {self.cost:.6g} ± {self.cost_error:.1g} (on fresh nodes)",
                f"  relative distance  {self.relative_distance:.1%}",
                f"  clearance          {self.clearance:.3f} at worst",
                f"  optimiser          {state} in {self.steps} steps",
            ]
        )


def nearest_repeatable(
    desired: Inverse,
    fields: Field,
    region: Region,
    *,
    samples: int | None = None,
    seed: int = 0,
    block: int = 1024,
    tolerance: float = 1e-7,
    progress: Callable[[int, float], None] | None = None,
) -> Design:
    """Find the repeatable inverse nearest to a desired one in the mean over Ω (26), (36), (38).

    A linear least-squares start, then Gauss–Newton on the Grassmann manifold of span A: only the column
    space of V matters. The line search never lets det(Nᵀ V) change sign at a node.

    Parameters
    ----------
    desired
        G_d, any strategy with ``J G = I``.
    fields
        The family of potentials.
    region
        Ω.
    samples
        Nodes of the fit; by default 4096, or 12 times the unknowns where that is more.
    seed
        Fixes nodes and judgement.
    block
        Nodes evaluated at a time.
    tolerance
        Relative decrease of the cost below which the optimiser is content.
    progress
        Called after each step with its number and the cost.

    Raises
    ------
    InputError
        If the task is not redundant, or fields and region do not fit it.
    SingularityError
        If J loses rank in Ω, or no V of this family is free of algorithmic singularities there; the
        message names a configuration.
    """
    task = desired.task
    if task.r < 1:
        raise InputError(
            f"a {task.kind} task leaves the {task.n} joints that move {task.frame!r} no redundancy (r = {task.r})"
        )
    if len(region.center) != task.n:
        raise InputError(f"the region has {len(region.center)} joints, but the task has {task.n}")
    if fields.size < task.r:
        raise InputError(f"{fields.size} potentials cannot give r = {task.r} independent ones; raise the degree")
    unknowns = (fields.size - task.r) * task.r
    samples = max(4096, 12 * unknowns // task.m) if samples is None else int(samples)
    if samples * task.m < fields.size:
        raise InputError(f"{samples} nodes are too few for {fields.size} potentials; give at least {fields.size}")

    Q, weights = region.nodes(samples, seed)
    N_center = nullspace(task.jacobian(region.center))
    blocks = [
        criterion.build_block(desired, fields, Q[i : i + block], weights[i : i + block], N_center)
        for i in range(0, len(Q), block)
    ]
    A = np.linalg.qr(criterion.start(blocks))[0]
    sign = criterion.signs(blocks, A)
    if not (sign == sign[0]).all():
        minority = Q[int(np.argmax(sign != np.sign(sign.sum())))]
        raise SingularityError(
            f"an algorithmic singularity lies in Ω, near {_named(task, minority)}; make the region smaller"
        )
    A, fit_cost, gradient_norm, converged, steps = _descend(blocks, A, sign[0], tolerance, progress)
    del blocks

    # Gauge: Nᵀ V = I at the center, so that J_V is as well conditioned as J there.
    V_center = np.einsum("inN,Nr->inr", fields.gradients(region.center[None]), A)[0]
    A = A @ np.linalg.inv(N_center.T @ V_center)
    inverse = RepeatableInverse(task, fields.weighted(A))
    verdict = _judge(inverse, desired, region, N_center, seed=seed + 1, block=block)
    return Design(
        inverse=inverse,
        desired=desired,
        fields=fields,
        region=region,
        coefficients=A,
        fit_cost=fit_cost,
        gradient_norm=gradient_norm,
        converged=converged,
        steps=steps,
        **verdict,
    )


def _descend(
    blocks: list[criterion.Block],
    A: Array,
    sign: float,
    tolerance: float,
    progress: Callable[[int, float], None] | None,
) -> tuple[Array, float, float, bool, int]:
    """Gauss–Newton on subspaces, with a line search that keeps det(Nᵀ V) of one sign."""
    size, r = A.shape
    value, converged, steps = criterion.cost(blocks, A), size == r, 0
    gradient_norm = 0.0
    for steps in range(_MAX_STEPS if size > r else 0):
        value, gradient, matrix = criterion.gauss_newton(blocks, A)
        basis = np.linalg.qr(A, mode="complete")[0][:, r:]  # directions that move span A
        g = (basis.T @ gradient).T.ravel()  # (r (N − r),)
        H = np.einsum("ap,iajb,bq->ipjq", basis, matrix, basis, optimize=True).reshape(len(g), len(g))
        gradient_norm = 2 * float(np.linalg.norm(g))
        # A touch of Levenberg: functions of a joint that the task ignores leave directions of no cost.
        H[np.diag_indices_from(H)] += 1e-4 * np.trace(H) / len(g)
        step = -scipy.linalg.solve(H, g, assume_a="pos")
        predicted = -2 * float(g @ step)
        if progress is not None:
            progress(steps, value)
        if predicted <= tolerance * value or value < 1e-26:
            converged = True
            break
        dA = basis @ step.reshape(r, -1).T
        length = 1.0
        while length > 1e-6:
            trial = A + length * dA
            same_side = (criterion.signs(blocks, trial) == sign).all()
            if same_side and criterion.cost(blocks, trial) < value - 1e-4 * length * predicted:
                break
            length /= 2
        else:
            break
        A = np.linalg.qr(trial)[0]
        sign = criterion.signs(blocks, A)[0]
    return A, value, gradient_norm, converged, steps


def _judge(
    inverse: RepeatableInverse, desired: Inverse, region: Region, N_center: Array, *, seed: int, block: int
) -> dict:
    """Measure a design on fresh nodes: independent scramblings give the cost's standard error."""
    task = inverse.task
    costs, norms, inside = [], [], []
    worst, worst_at = np.inf, region.center
    for replicate in range(_REPLICATES):
        Q = region.random(block, seed * _REPLICATES + replicate)
        J = task.jacobians(Q)
        N, V = nullspace(J), inverse.field.gradients(Q)
        N_T = np.swapaxes(N, -1, -2)
        side = np.sign(np.linalg.det(N_T @ V) * np.linalg.det(N_T @ N_center))
        if not (side > 0).all():
            at = _named(task, Q[int(np.argmin(side))])
            raise SingularityError(f"an algorithmic singularity lies in Ω, near {at}; make the region smaller")
        G_d = desired.batch(Q, J)
        costs.append(float(np.mean(np.sum((inverse.batch(Q, J) - G_d) ** 2, axis=(1, 2)))))
        norms.append(float(np.mean(np.sum(G_d**2, axis=(1, 2)))))
        inside.append(float(np.mean(((Q >= task.lower) & (Q <= task.upper)).all(axis=1))))
        sigma = clearance(N, V)
        if sigma.min() < worst:
            worst, worst_at = float(sigma.min()), Q[int(np.argmin(sigma))]
    mean = float(np.mean(costs))
    return {
        "cost": mean,
        "cost_error": float(np.std(costs, ddof=1) / np.sqrt(_REPLICATES)),
        "relative_distance": float(np.sqrt(mean / np.mean(norms))),
        "clearance": worst,
        "clearance_at": worst_at,
        "inside_limits": float(np.mean(inside)),
    }


def _named(task: Task, q: Array) -> str:
    """Write a configuration so that a person can find it."""
    return ", ".join(f"{name} = {value:.3f}" for name, value in zip(task.joint_names, q, strict=True))
