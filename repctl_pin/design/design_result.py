"""Result of a design: a repeatable inverse, its potentials and its figures on held-out nodes.

The repeatable inverse G_r is near the desired inverse G_d. N and V̂ are orthonormal bases of the
null space of J and of the gradients of the potentials; σ_min(Nᵀ V̂) is the leaf margin, the
distance from an algorithmic singularity, at which G_r fails though J has full rank. A certificate
is a proof of bounds, such as of the leaf margin, over all of Ω. Numbers such as (26) are equations
of the paper (docs/notation.md).

``Baseline`` is a simpler repeatable inverse over the same Ω: its name, its figures, or why it was
refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..base.arguments import Array, percentage, read_only
from ..base.certificate import Proof, own_proof, proved_words
from ..base.errors import InputError
from ..base.progress import Report, reporter
from ..model.chain_formulas import Placement
from ..model.task import Task
from ..paths.task_path import Cycle
from ..potentials.basis import PotentialBasis
from ..regions import Region
from ..strategies.repeatable import RepeatableInverse
from ..strategies.strategy import Inverse
from .evaluation import Baseline, baselines, spectral_cost
from .proof_fingerprint import belong_together, subject_of


@dataclass(frozen=True, eq=False)
@read_only
class Design:
    """A repeatable inverse and its figures of merit.

    G_r keeps the potentials h constant, so that closed paths in Ω, the region of joint space, end
    in the configuration they began in. All figures except ``fit_cost`` are evaluated on held-out
    nodes, which the fit did not use.

    Attributes
    ----------
    inverse : RepeatableInverse
        Repeatable inverse G_r: ``q̇ = G_r ẋ``.
    desired : Inverse
        Desired inverse G_d.
    potentials, region, coefficients
        Basis of N potentials h_i, region Ω, and coefficients A (N, r) of the r potentials
        ``Σ_i h_i A[i, :]`` (35) that G_r holds constant.
    cost, cost_error : float
        Mean over Ω of ‖G_r − G_d‖_F² (26), and its standard error.
    relative_distance : float
        ``sqrt(cost / mean ‖G_d‖_F²)``.
    leaf_margin : float
        Smallest σ_min(Nᵀ V̂) that a search of Ω found: 1 is best, 0 is an algorithmic singularity.
    leaf_margin_at : (n,) array
        Configuration of the smallest leaf margin, rad (m for prismatic joints).
    inside_limits : float
        Fraction of Ω inside the joint limits.
    fit_cost : float
        Cost on the nodes of the fit; lower than ``cost`` by the amount of overfitting.
    gradient_norm : float
        Norm of the gradient of the minimised function, which is the cost plus a small penalty, with
        respect to coefficients for potentials whose gradients are orthonormal over Ω.
    converged : bool
        True if the optimiser predicts no relative decrease of the cost above the ``tolerance`` of
        :class:`FitOptions`, or its last three steps gave none. More potentials may still lower the
        cost.
    steps : int
        Number of steps of the optimiser.
    samples, held_out : int
        Number of nodes of the fit, and of the evaluation.
    seed : int
        Random seed of both node sets.
    dropped : tuple of str
        Potentials that were left out, each with the reason.
    shrunk : float
        Width of Ω divided by the requested width; 1 if Ω was not shrunk.
    degrees : tuple of (degree, cost, cost_error)
        Degrees that were tried with ``degree="auto"``, in order, with the cost and its standard
        error; else empty.
    cycle : Cycle, optional
        Start, path and period of the motion that the design is for. It is saved with the design.
    proof : Proof, optional
        Certificate of the design, if one was added by ``dataclasses.replace(design,
        proof=rp.prove(design))``. It is saved with the design. The certificate of another design is
        dropped with a warning.

    Raises
    ------
    InputError
        If inverse, potentials, coefficients and region do not belong together, such as after
        ``dataclasses.replace`` of one of them.

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

    def __post_init__(self) -> None:
        parts = self.inverse, self.potentials, self.coefficients, self.region
        if not belong_together(*parts):
            raise InputError(
                "a design cannot be changed in part: its inverse, potentials, coefficients and "
                "region belong together; design again"
            )
        proof = own_proof(self.proof, lambda: self.subject)
        object.__setattr__(self, "proof", proof)

    def __repr__(self) -> str:
        task = self.task
        return (
            f"<Design for {task.robot.name} {task.frame}: "
            f"cost {self.cost:.4g} ± {self.cost_error:.1g}, "
            f"{percentage(self.relative_distance)} from the desired, "
            f"leaf margin {self.leaf_margin:.3g}>"
        )

    @property
    def task(self) -> Task:
        """Task that the inverse controls."""
        return self.inverse.task

    @property
    def subject(self) -> str:
        """Fingerprint of all that a certificate of the design depends on; empty if none can exist.

        It covers the joint chain, its limits, potentials, coefficients and region. A saved proof
        with another fingerprint is dropped. The fingerprint is empty for a design with user-defined
        potentials or a user-defined region, because nothing can be proved about them.
        """
        return subject_of(self.task, self.potentials, self.coefficients, self.region)

    def with_tool(self, placement: Placement) -> Design:
        """Convert a design for a pose task to another tool on the same body, without a new fit.

        The null space of a pose task does not depend on the point of the body, ``J' = A J`` with an
        invertible A. So the same potentials give a repeatable inverse of the new tool, with the
        same leaf margin and the same joint paths: ``G_r' = G_r A⁻¹``. Cost and margins are
        evaluated again; ``fit_cost``, ``gradient_norm``, ``converged``, ``steps`` and ``degrees``
        still describe the original fit, and ``cycle`` is None. The leaf and limit margins of a
        certificate stay valid. The bound on σ_min(J) in the certificate becomes smaller. The
        closing radius is converted, because distances are then measured at another point.

        Parameters
        ----------
        placement : pinocchio.SE3 or (4, 4) array
            Placement of the tool in the frame of the task.

        Returns
        -------
        Design
            Its task has the tool as frame.

        Raises
        ------
        InputError
            If the task is not a pose task of one frame, because the self-motion of other tasks
            depends on the controlled point. Also if Ω is a :class:`WorkspaceBox`, which bounds
            positions of the original frame.
        """
        from ..model.tool import with_tool  # few designs change their tool
        from .with_tool import for_task

        design: Design = for_task(self, with_tool(self.task, placement))
        return design

    def spectral_cost(self) -> float:
        """Evaluate the mean over Ω of ‖G_r − G_d‖₂², in the paper's norm, on the held-out nodes.

        The result equals :attr:`cost` for r = 1. For r > 1 it is smaller, because the Frobenius
        norm, which a design minimises, includes all singular values.
        """
        return spectral_cost(
            self.inverse, self.desired, self.region, samples=self.held_out, seed=self.seed + 1
        )

    def evaluate_baselines(self, *, progress: bool | Report = False) -> tuple[Baseline, ...]:
        """Evaluate two simpler repeatable inverses for comparison, on the design's held-out nodes.

        They are the augmented Jacobian with constant rows, which are linear potentials, and the
        extended Jacobian of ``U = ½ ‖q − center‖²``; ``center`` is the centre of Ω.

        Parameters
        ----------
        progress
            True for a progress bar on stderr, or a callback (step: str, fraction: float).

        Returns
        -------
        tuple of Baseline
            Name and figures of each, or why it was refused; :meth:`summary` lists them.
        """
        with reporter(progress) as report:
            return baselines(
                self.desired, self.region, samples=self.held_out, seed=self.seed + 1, report=report
            )

    def summary(self, baselines: Sequence[Baseline] = ()) -> str:
        """Return the figures of the design as text of several lines; nothing is computed.

        ``repctl design`` prints it.

        Parameters
        ----------
        baselines
            Simpler inverses to list for comparison, from :meth:`evaluate_baselines`.
        """
        state = "converged" if self.converged else "NOT converged"
        unused = f", {len(self.dropped)} dropped" if self.dropped else ""
        width = max((len(baseline.name) for baseline in baselines), default=0)
        cost = f"{self.cost:.6g} ± {self.cost_error:.1g}"
        lines = [
            f"nearest repeatable inverse for {self.task.robot.name} {self.task}",
            f"  region Ω           {self.region}",
            f"  potentials         {self.potentials}{unused}",
            f"  mean ‖G_r − G_d‖²  {cost} (on {self.held_out} held-out nodes)",
            *(f"    {baseline.name.ljust(width)}  {baseline.text}" for baseline in baselines),
            f"  relative distance  {percentage(self.relative_distance)}",
            f"  leaf margin        {self.leaf_margin:.3f} at worst, {proved_words(self.proof)}",
            f"  inside the limits  {percentage(self.inside_limits)} of Ω",
            f"  optimiser          {state} in {self.steps} steps, "
            f"gradient {self.gradient_norm:.1g}",
        ]
        reasons: dict[str, list[str]] = {}
        for text in self.dropped:
            name, _, why = text.rpartition(": ")
            reasons.setdefault(why, []).append(name)
        lines += [f"  dropped            {', '.join(n)}: {why}" for why, n in reasons.items()]
        return "\n".join(lines)
