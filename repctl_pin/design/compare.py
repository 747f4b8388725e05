"""Comparison of several designs on held-out nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arguments import percentage, require_type
from ..errors import InputError, SingularityError
from .design_result import Design
from .evaluation import REPLICATES, Evaluation, evaluate_design


@dataclass(frozen=True)
class _Comparison:
    """Evaluation of several designs over the region Ω, and against the desired inverse G_d, of the
    first one.

    Attributes
    ----------
    designs : tuple of Design
    evaluations : tuple of Evaluation or None
        Figures of each design; None where it has a singularity in Ω.
    differences : tuple of (float, float)
        For each design, its cost minus the cost of the first design, and the standard error of that
        difference: (inf, nan) if this or the first design is singular in Ω. Because all designs are
        evaluated on the same nodes, the error is far smaller than the standard errors of the costs.
    """

    designs: tuple[Design, ...]
    evaluations: tuple[Evaluation | None, ...]
    differences: tuple[tuple[float, float], ...]

    @property
    def best(self) -> int:
        """Index of the design with the smallest cost, counted from 0."""
        costs = [np.inf if j is None else j.cost for j in self.evaluations]
        return int(np.argmin(costs))

    def __str__(self) -> str:
        lines = [
            "  potentials   cost       beside the first      distance  leaf margin"
        ]
        for i, (design, j, (more, error)) in enumerate(
            zip(self.designs, self.evaluations, self.differences, strict=True)
        ):
            mark = "*" if i == self.best else " "
            if j is None:
                lines.append(f"{mark} {design.potentials.size:10d}   singular in Ω")
                continue
            beside = "" if i == 0 else f"{more:+.4g} ± {error:.1g}"
            lines.append(
                f"{mark} {design.potentials.size:10d}   {j.cost:<9.5g}  {beside:20s}  "
                f"{percentage(j.relative_distance):>8}  {j.leaf_margin:9.3f}"
            )
        return "\n".join(lines)


def compare(first: Design, *others: Design) -> _Comparison:
    """Evaluate designs on the same held-out nodes over the Ω of the first one.

    Returns
    -------
    Comparison
        Evaluation of each design, and the difference of its cost from that of the first one, with
        standard error.

    Raises
    ------
    InputError
        If the designs are not all for the same arm and task.

    Examples
    --------
    >>> options = rp.FitOptions(samples=512, held_out=512)
    >>> plain = rp.nearest_repeatable(control, None, rp.Box(q0, 0.4), degree=1, options=options)
    >>> comparison = rp.compare(design, plain)
    >>> comparison.designs[1].cost > comparison.designs[0].cost
    True
    """
    designs = (first, *others)
    for design in designs:
        require_type(
            design,
            Design,
            "what is compared",
            "a design, as rp.nearest_repeatable makes them",
        )
    task = first.task
    for other in others:
        one, two = (
            (t.robot.name, t.frame, t.kind, t.joint_names) for t in (task, other.task)
        )
        if one != two:
            raise InputError(
                f"designs of different tasks cannot be compared: {task!r} and {other.task!r}",
                remedy="compare designs of one task",
            )
    evaluations: list[Evaluation | None] = []
    for design in designs:
        try:
            verdict = evaluate_design(
                design.inverse,
                first.desired,
                first.region,
                samples=first.held_out,
                seed=first.seed + 1,
            )
            evaluations.append(verdict)
        except SingularityError:
            evaluations.append(None)
    base = evaluations[0]
    differences = []
    for j in evaluations:
        if j is None or base is None:
            differences.append((np.inf, np.nan))
            continue
        gap = j.replicates - base.replicates
        differences.append(
            (float(gap.mean()), float(gap.std(ddof=1) / np.sqrt(REPLICATES)))
        )
    return _Comparison(designs, tuple(evaluations), tuple(differences))
