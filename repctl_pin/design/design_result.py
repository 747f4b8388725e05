"""A design: a repeatable inverse, what it was made from, and what it is worth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from ..arguments import Array
from ..certificate import Proof, proved_words
from ..paths.task_path import Cycle
from ..potentials.basis import PotentialBasis
from ..regions import Region
from ..robot.task import Task
from ..strategies.repeatable import RepeatableInverse
from ..strategies.strategy import Inverse
from .evaluation import Baseline, baselines


@dataclass(frozen=True)
class Design:
    """A repeatable inverse, and how good it is.

    All figures but ``fit_cost`` are taken on nodes that the fit did not see.

    Attributes
    ----------
    inverse : RepeatableInverse
        The result: ``q̇ = G_r ẋ``.
    desired : Inverse
        The desired inverse, G_d.
    potentials, region, coefficients
        The potentials (35), Ω, and A (N, r).
    cost, cost_error : float
        Mean over Ω of ‖G_r − G_d‖_F² (26), and its standard error.
    relative_distance : float
        ``sqrt(cost / mean ‖G_d‖_F²)``.
    leaf_margin : float
        The smallest σ_min(Nᵀ V̂) that a search of Ω found: 1 is best, 0 is an algorithmic
        singularity.
    leaf_margin_at : (n,) array
        Where, rad (m for sliding joints).
    inside_limits : float
        Share of Ω inside the joint limits.
    fit_cost : float
        The cost on the nodes of the fit: lower, by the amount of overfitting.
    gradient_norm : float
        Of the cost on the nodes of the fit, in coordinates in which the potentials' gradients are
        orthonormal over Ω.
    converged : bool
        The optimiser predicts no relative decrease of the cost above ``tolerance``, or its last
        three steps gave none. Richer potentials may still lower the cost: see
        :func:`cost_has_converged`.
    steps : int
        Gauss–Newton steps taken.
    samples, held_out : int
        Nodes of the fit, and of the evaluation.
    seed : int
        Fixes both.
    dropped : tuple of str
        Potentials of the family that were left out, each with the reason.
    shrunk : float
        Share of the requested Ω's width that is left; 1 if it was not shrunk.
    degrees : tuple of (degree, cost, cost_error)
        With ``degree="auto"``: what was tried, in order.
    cycle : Cycle, optional
        The motion the control is for: start, path and time. It is saved with the design.
    proof : Proof, optional
        The certificate, where one was put here: ``dataclasses.replace(design,
        proof=rp.prove(design))``. It is saved with the design.

    Examples
    --------
    >>> design.leaf_margin > 0.9  # 1 is best, 0 singular
    True
    >>> 0 < design.relative_distance < 0.2  # of ‖J⁺‖
    True
    >>> "leaf margin" in design.summary()
    True
    """

    inverse: RepeatableInverse
    desired: Inverse
    potentials: PotentialBasis
    region: Region
    coefficients: Array
    cost: float
    cost_error: float
    relative_distance: float
    leaf_margin: float
    leaf_margin_at: Array
    inside_limits: float
    fit_cost: float
    gradient_norm: float
    converged: bool
    steps: int
    samples: int
    held_out: int
    seed: int
    dropped: tuple[str, ...] = ()
    shrunk: float = 1.0
    degrees: tuple[tuple[int, float, float], ...] = ()
    cycle: Cycle | None = None
    proof: Proof | None = None

    def __repr__(self) -> str:
        task = self.task
        return (
            f"<Design for {task.robot.name} {task.frame}: cost {self.cost:.4g} ± {self.cost_error:.1g}, "
            f"{self.relative_distance:.1%} from the desired, leaf margin {self.leaf_margin:.3g}>"
        )

    @property
    def task(self) -> Task:
        """The task the inverse controls."""
        return self.inverse.task

    @cached_property
    def baselines(self) -> tuple[Baseline, ...]:
        """The same figures for constant rows and for the extended Jacobian, on the same held-out
        nodes."""
        return baselines(self.desired, self.region, samples=self.held_out, seed=self.seed + 1)

    def summary(self) -> str:
        """Say in a few lines how good the design is."""
        state = "converged" if self.converged else "NOT converged"
        unused = f", {len(self.dropped)} dropped" if self.dropped else ""
        width = max(len(b.name) for b in self.baselines)
        lines = [
            f"nearest repeatable inverse for {self.task.robot.name} {self.task}",
            f"  region Ω           {self.region}",
            f"  potentials         {self.potentials}{unused}",
            f"  mean ‖G_r − G_d‖²  {self.cost:.6g} ± {self.cost_error:.1g} (on {self.held_out} held-out nodes)",
            *(f"    {b.name.ljust(width)}  {b.text}" for b in self.baselines),
            f"  relative distance  {self.relative_distance:.1%}",
            f"  leaf margin        {self.leaf_margin:.3f} at worst, {proved_words(self.proof)}",
            f"  inside the limits  {self.inside_limits:.1%} of Ω",
            f"  optimiser          {state} in {self.steps} steps, gradient {self.gradient_norm:.1g}",
        ]
        return "\n".join(lines + [f"  dropped            {text}" for text in self.dropped])
