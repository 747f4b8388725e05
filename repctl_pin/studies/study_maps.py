"""Arrays for the maps of a study: figures of its design and the defect of J⁺ over two joints."""

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


@dataclass(frozen=True, eq=False)
@read_only
class StudyMaps:
    """Maps that a report draws beside the motions.

    Attributes
    ----------
    design : DesignMap
        Distance and leaf margin over two joints, the others at the centre of Ω.
    defect : (k, k) array
        Relative defect of the desired inverse on the same grid: 0 where it is repeatable; NaN at
        singularities.
    degrees : tuple of (degree, cost, standard error)
        Cost of the design by its degree.
    baselines : tuple of Baseline
        Simpler inverses on the same held-out nodes; none where one degree alone was tried.
    """

    design: DesignMap
    defect: Array
    degrees: tuple[tuple[int, float, float], ...]
    baselines: tuple[Baseline, ...] = ()


def study_maps(study: Study, *, points: int = 41) -> StudyMaps:
    """Evaluate the maps of a study's design on a grid of ``points`` × ``points``."""
    design = study.design
    grid = design_map(design, points=points)
    Q = np.tile(design.region.center, (points * points, 1))
    Q[:, grid.joints[0]], Q[:, grid.joints[1]] = (a.ravel() for a in np.meshgrid(grid.x, grid.y))
    defect = _defects(design.desired, Q).reshape(points, points)
    degrees = degree_curve(design)
    baselines = design.evaluate_baselines() if len(degrees) > 1 else ()
    return StudyMaps(grid, defect, degrees, baselines)


def _defects(strategy: Inverse, Q: Array) -> Array:
    """Evaluate the relative defect at every row of Q; NaN at singularities."""
    try:
        return measure(strategy, Q).norm
    except SingularityError:
        if len(Q) == 1:
            return np.full(1, np.nan)
        return np.concatenate([_defects(strategy, part) for part in np.array_split(Q, 2)])
