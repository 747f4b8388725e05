"""What a design is compared with: constant rows, and the extended Jacobian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arguments import Array
from ..errors import RepctlError
from ..fields.polynomial import Polynomial
from ..regions import Region
from ..robot.task import Task
from ..strategies.extended import ExtendedJacobian
from ..strategies.repeatable import RepeatableInverse
from ..strategies.strategy import Inverse
from .criterion import oriented_nullspace
from .judgement import Judgement, judge


@dataclass(frozen=True)
class Baseline:
    """Another repeatable inverse over the same Ω.

    Attributes
    ----------
    name : str
    judgement : Judgement or None
        Its figures; None where it runs into a singularity in Ω.
    refused : str
        Then: where.
    """

    name: str
    judgement: Judgement | None
    refused: str = ""

    @property
    def text(self) -> str:
        """The figures in a few words."""
        if self.judgement is None:
            return self.refused
        j = self.judgement
        return f"{j.cost:.6g} ± {j.cost_error:.1g}, leaf margin {j.leaf_margin:.3f}"


def constant_rows(task: Task, center: Array) -> RepeatableInverse:
    """Make the inverse of constant rows, ``V = N(center)``."""
    N = oriented_nullspace(task.jacobian(center)[None], task, center[None])[0]
    linear = Polynomial(center, 1)
    return RepeatableInverse(task, linear.weighted(np.linalg.solve(linear.gradients(center[None])[0], N)))


def baselines(desired: Inverse, region: Region, *, samples: int, seed: int) -> tuple[Baseline, ...]:
    """Judge constant rows, and the extended Jacobian of ``U = ½ ‖q − center‖²``, on the same held-out nodes."""
    task, center = desired.task, region.center
    found = []
    for name, inverse in (
        ("constant rows", constant_rows(task, center)),
        ("extended Jacobian", ExtendedJacobian(task, center)),
    ):
        try:
            found.append(Baseline(name, judge(inverse, desired, region, samples=samples, seed=seed)))
        except RepctlError as error:
            found.append(Baseline(name, None, str(error)))
    return tuple(found)
