"""A function over a cell, what it was made from, what it is worth, and its figures over slices of
the cell."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from ..arguments import Array
from ..certificate import Proof, proved_words
from ..robot.task import Task
from ..strategies import RepeatableInverse
from ..strategies.strategy import Inverse
from .cell import Cell
from .cell_evaluation import Evaluation, speeds
from .chart import Chart
from .failures import FailureReason
from .function import InverseFunction


@dataclass(frozen=True)
class CellDesign:
    """An inverse kinematic function over a cell, and how good it is.

    Attributes
    ----------
    function : InverseFunction
        The result: ``q = F(x)``.
    desired : Inverse
        G_d.
    posture : (n,) array
        The joints in the middle of the cell, rad (m for sliding joints).
    evaluation : Evaluation
        All figures, on held-out poses; the main ones are attributes of the design as well.
    degrees : tuple of (degree, cost)
        What was tried, in order; the last was chosen.
    samples, held_out : int
        Nodes of the fit, and of the evaluation.
    seed, steps : int
        The seed of both, and the Gauss–Newton steps taken.
    requested_limit_margin, requested_body_distance, requested_sigma_min : float
        The limit margin, rad or m, the distance between bodies, m, and σ_min of J that were asked
        for.
    proof : Proof, optional
        The certificate, where one was put here: ``dataclasses.replace(found,
        proof=rp.prove(found))``. It is saved with the design.

    Examples
    --------
    >>> found.coverage  # share of the cell
    1.0
    >>> found.extra_speed < 0.05  # joint speed above the pseudoinverse's
    True
    """

    function: InverseFunction
    desired: Inverse
    posture: Array
    evaluation: Evaluation
    degrees: tuple[tuple[int, float], ...]
    samples: int
    held_out: int
    seed: int
    steps: int
    requested_limit_margin: float
    requested_body_distance: float
    requested_sigma_min: float
    proof: Proof | None = None

    @classmethod
    def of(cls, desired: Inverse, chart: Chart, evaluation: Evaluation, **how: Any) -> CellDesign:
        """Put a design together."""
        middle = chart.solve(np.zeros((1, chart.cell.k)), np.zeros((1, chart.cell.task.r)))
        function = InverseFunction(chart, keep_limits=not evaluation.everywhere)
        return cls(function, desired, middle.Q[0], evaluation, **how)

    @property
    def task(self) -> Task:
        """The task."""
        return self.function.task

    @property
    def cell(self) -> Cell:
        """The poses."""
        return self.function.cell

    @property
    def inverse(self) -> RepeatableInverse:
        """The control whose leaf c = 0 is the function: ``q̇ = ∂F/∂x ẋ``."""
        return self.function.inverse

    @property
    def cost(self) -> float:
        """``mean ‖∂F/∂x − G_d(F)‖_F²``."""
        return self.evaluation.cost

    @property
    def extra_speed(self) -> float:
        """By what share the joints move faster than under G_d at the same joints, root mean square
        over the cell."""
        return self.evaluation.extra_speed

    @property
    def extra_speed_worst(self) -> float:
        """The same at the worst pose that a search over the cell has found."""
        return self.evaluation.extra_speed_worst

    @property
    def extra_speed_direction(self) -> float:
        """The same in the worst task direction alone, at the worst pose for it that a search has
        found."""
        return self.evaluation.extra_speed_direction

    @property
    def limit_margin(self) -> float:
        """The smallest distance of a joint from its limit on the held-out poses, rad or m."""
        return self.evaluation.limit_margin

    @property
    def limit_margin_worst(self) -> float:
        """The same at the worst pose that a search over the cell has found."""
        return self.evaluation.limit_margin_worst

    @property
    def leaf_margin(self) -> float:
        """The least ``σ_min(Nᵀ n̂_ref)``: 1 is best."""
        return self.evaluation.leaf_margin

    @property
    def coverage(self) -> float:
        """The share of the held-out poses that have joints, inside the limits."""
        return self.evaluation.coverage

    @property
    def failures(self) -> tuple[FailureReason, ...]:
        """What failures the function elsewhere, and at the corners of the cell."""
        return self.evaluation.failures

    @property
    def body_distance(self) -> float:
        """The least distance between bodies that a search has found, of robot and surroundings, m;
        infinite without."""
        return self.evaluation.body_distance

    def figures(self) -> dict[str, str]:
        """Say what the function is worth: the name of each figure, and the figure in words."""
        j, unit = self.evaluation, self.task.unit
        most = (
            "the self-motion has at most"
            if self.task.r == 1
            else "the leaves looked at have at most"
        )
        margin = (
            f"{j.limit_margin:.3g} {unit}, where {most} {j.attainable_margin:.3g}\n"
            f"{j.limit_margin_worst:.3g} {unit} at the worst pose that a search has found, "
            f"where {most} {j.attainable_margin_worst:.3g}{_unmet(j.limit_margin_worst, self.requested_limit_margin)}"
        )
        bodies = f"{j.body_distance:.3g} m, {' and '.join(j.nearest_bodies)}{_unmet(j.body_distance, self.requested_body_distance)}"
        speed = f"{100 * j.extra_speed:.3g} % ± {100 * j.extra_speed_error:.1g}, "
        speed += f"{j.extra_speed_worst:.1%} at the worst pose"
        if np.isfinite(j.extra_speed_direction):
            speed += f"\n{j.extra_speed_direction:.1%} at the worst pose in the worst single task direction"
        return {
            "cell": self.cell.size(),
            "middle": self.cell.where(np.zeros(self.cell.k)),
            "posture": ", ".join(f"{v:.4g}" for v in np.round(self.posture, 4) + 0.0),
            "degree": f"{self.degrees[-1][0]}, evaluated from {self.function.chart.monomials.size} terms",
            "extra joint speed": speed,
            "mean ‖∂F − G_d‖²": f"{j.cost:.4g} ± {j.cost_error:.1g} (on {self.held_out} held-out poses)",
            "limit margin": margin if np.isfinite(j.limit_margin) else "no limits",
            "body distance": bodies if np.isfinite(j.body_distance) else "no collision bodies",
            "σ_min(J)": f"{j.smallest_singular_value:.3g}{_unmet(j.smallest_singular_value, self.requested_sigma_min)}",
            "leaf margin": f"{j.leaf_margin:.3g}, {proved_words(self.proof)}",
            "residual": f"{j.residual:.1g} m or rad",
            "coverage": j.covered,
        } | ({"stopped": "\n".join(map(str, j.failures))} if j.failures else {})

    def summary(self) -> str:
        """Say in a few lines what the function is worth."""
        task = self.task
        lines = [
            f"  {name:17}  {line}"
            for name, text in self.figures().items()
            for line in text.split("\n")
        ]
        return "\n".join([f"one function for a cell of {task.robot.name} {task}", *lines])

    def __repr__(self) -> str:
        return (
            f"<CellDesign for {self.task.robot.name} {self.task.frame}, {self.cell.size()}: "
            f"+{self.extra_speed:.2%} joint speed, limit margin {self.limit_margin_worst:.3g}, "
            f"covered: {self.evaluation.covered}>"
        )


def _unmet(found: float, asked: float) -> str:
    """Say so where less was found than was asked for; 0 asks for nothing."""
    return f"; {asked:g} was asked for and is not met" if found < asked and asked else ""


@dataclass(frozen=True)
class Slice:
    """Two coordinates of a cell varied, the others in the middle.

    Attributes
    ----------
    axes : (int, int)
        Which coordinates, counted from 0.
    u : (C,) array
        The values of each.
    limit_margin, extra_speed : (C, C) arrays
        Rows: the second coordinate. NaN where there are no joints.
    """

    axes: tuple[int, int]
    u: Array
    limit_margin: Array
    extra_speed: Array


def slices(design: CellDesign, count: int = 33) -> list[Slice]:
    """Evaluate the slices of every two positions of the cell; or of its first two coordinates."""
    cell, chart = design.cell, design.function.chart
    places = [i for i, unit in enumerate(cell.units) if unit == "m"]
    pairs = list(combinations(places if len(places) > 1 else range(cell.k), 2))[:3]
    u = np.linspace(-1, 1, count)
    made = []
    for first, second in pairs:
        U = np.zeros((count * count, cell.k))
        U[:, second], U[:, first] = (grid.ravel() for grid in np.meshgrid(u, u, indexing="ij"))
        points = chart.solve(U, np.zeros((len(U), cell.task.r)))
        found = speeds(design.desired, chart, points)
        margin = np.where(points.found, cell.task.limit_margin(points.Q).min(axis=1), np.nan)
        extra = np.sqrt(found.own / found.wanted) - 1
        made.append(
            Slice((first, second), u, margin.reshape(count, count), extra.reshape(count, count))
        )
    return made
