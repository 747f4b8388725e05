"""Arrays for the maps of a study, over two joints: quality of its design, and defect of G_d."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arguments import Array, read_only
from ..design.design_map import DesignMap, degree_curve, design_map
from ..design.evaluation import Baseline
from ..errors import SingularityError
from ..integrability.lie_bracket import measure
from ..strategies import Inverse
from .study_result import Study

_POINTS = 41
"""Number of configurations of a map along each joint."""


@dataclass(frozen=True, eq=False)
@read_only
class StudyMaps:
    """Maps and curves of a study's design for a report.

    Attributes
    ----------
    design : DesignMap
        Distance to G_d and leaf margin over two joints, with the other joints at the centre of Ω.
    defect : (k, k) array
        Relative defect of the desired inverse G_d on the same grid: 0 where G_d satisfies the
        condition of repeatability; NaN at singularities.
    degrees : tuple of (degree, cost, standard error)
        Cost of the design for each polynomial degree that was tried.
    baselines : tuple of Baseline
        Costs of simpler inverses on the design's held-out nodes; empty if only one degree was
        tried.
    """

    design: DesignMap
    defect: Array
    degrees: tuple[tuple[int, float, float], ...]
    baselines: tuple[Baseline, ...] = ()


def study_maps(study: Study) -> StudyMaps:
    """Evaluate what the report plots over two joints: the design, and the bracket defect of G_d.

    The grid has 41 × 41 configurations. The costs by degree and of the baselines are added."""
    design = study.design
    grid = design_map(design, points=_POINTS)
    Q = np.tile(design.region.center, (_POINTS**2, 1))
    Q[:, grid.joints[0]], Q[:, grid.joints[1]] = (
        a.ravel() for a in np.meshgrid(grid.x, grid.y)
    )
    defect = _defects(design.desired, Q).reshape(_POINTS, _POINTS)
    degrees = degree_curve(design)
    baselines = design.evaluate_baselines() if len(degrees) > 1 else ()
    return StudyMaps(grid, defect, degrees, baselines)


def _defects(strategy: Inverse, Q: Array) -> Array:
    """Evaluate an inverse's relative defect at the rows of Q (K, n): (K,), NaN at singularities."""
    try:
        return measure(strategy, Q).norm
    except SingularityError:
        if len(Q) == 1:
            return np.full(1, np.nan)
        return np.concatenate(
            [_defects(strategy, part) for part in np.array_split(Q, 2)]
        )
