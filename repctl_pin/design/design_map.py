"""Data of a report's plots: maps of a design over two joints, and the cost per degree.

G_r is the repeatable inverse of the design, G_d the desired one, and Ω the region of joint space.
The maps also show the defect of G_d, by which it violates the Lie bracket condition: where the
defect is large, G_d drifts. The leaf margin, from 0 to 1, is the distance from an algorithmic
singularity, at which G_r fails though J has full rank. Nodes are configurations in Ω at which a
cost is evaluated; held-out nodes are those that the fit did not use.

``DesignMap`` is the distance from the desired inverse and the leaf margin of a design on a grid
over two joints. ``ReportMaps`` are the maps and curves of a design for a report: its grid over two
joints, costs by degree, and costs of two simpler repeatable inverses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..base.arguments import Array, read_only
from ..base.errors import InputError, SingularityError
from ..base.fit_options import FitOptions
from ..base.progress import Report, silent
from ..integrability.lie_bracket import measure
from ..potentials.polynomial import Polynomial
from .design_result import Design
from .evaluation import Baseline
from .singularity_search import LeafMargin

_POINTS = 41
"""Number of configurations of a report's maps along each joint."""


@dataclass(frozen=True, eq=False)
@read_only
class DesignMap:
    """Distance and leaf margin of a design over two joints; all other joints at the centre of Ω.

    The distance ‖G_r − G_d‖ is that from the desired inverse. The leaf margin, from 0 to 1, is the
    distance from an algorithmic singularity.

    Attributes
    ----------
    joints : (int, int)
        Indices of the joints on the x and the y axis, counted from 0.
    x, y : (k,) arrays
        k grid values of the first and the second joint, over the smallest box around Ω, rad or m.
    distance, reference : (k, k) arrays
        ‖G_r − G_d‖_F and ‖G_d‖_F; NaN at singularities. Row i belongs to ``y[i]``, column j to
        ``x[j]``.
    leaf_margin : (k, k) array
        σ_min(Nᵀ V̂), from 0 to 1, in the same order.
    """

    joints: tuple[int, int]
    x: Array
    y: Array
    distance: Array
    reference: Array
    leaf_margin: Array


def design_map(
    design: Design, joints: tuple[int, int] | None = None, *, points: int = 61
) -> DesignMap:
    """Evaluate the distance and the leaf margin of a design on a grid over two joints.

    A map shows where in the region the repeatable inverse G_r is far from the desired G_d, or near
    an algorithmic singularity.

    Parameters
    ----------
    design
        The design.
    joints
        Indices of the two joints; by default those along which ‖G_r − G_d‖ changes most.
    points
        Number of grid points along each joint.
    """
    box = design.region.bounds
    center = design.region.center
    n = design.task.n
    first, second = _liveliest(design) if joints is None else joints
    if not (0 <= first < n and 0 <= second < n and first != second):
        raise InputError(
            f"must be two different indices from 0 to {n - 1}, not {joints}", argument="joints"
        )
    x, y = (np.linspace(box.lower[j], box.upper[j], points) for j in (first, second))
    Q = _grid(center, (first, second), x, y)
    distance, reference = _distance(design, Q).T
    sigma = np.abs(LeafMargin(design.task, design.inverse.potentials, center)(Q))
    shape = (points, points)
    return DesignMap(
        (first, second),
        x,
        y,
        distance.reshape(shape),
        reference.reshape(shape),
        sigma.reshape(shape),
    )


def _grid(center: Array, joints: tuple[int, int], x: Array, y: Array) -> Array:
    """List the configurations of a grid over two joints, row by row: (k², n).

    ``joints`` are the indices of the two joints, and ``x`` and ``y`` (k,) their values. A row has
    one value of y and all values of x. All other joints are as in ``center`` (n,).
    """
    Q = np.tile(center, (len(x) * len(y), 1))
    Q[:, joints] = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return Q


def degree_curve(design: Design, report: Report = silent) -> tuple[tuple[int, float, float], ...]:
    """Return the cost for each degree of the polynomials, up to the degree of the design.

    If the design was made with ``degree="auto"``, the result is its attribute ``degrees``.
    Otherwise, an inverse is designed for each lower degree, which takes long; ``report`` is the
    progress callback. The curve shows whether a higher degree is worthwhile.

    Returns
    -------
    tuple of (degree, cost, standard error of the cost)
        Degrees whose design has a singularity in Ω are left out. Empty if the potentials are not
        polynomials.
    """
    if design.degrees:
        return design.degrees
    potentials = design.potentials
    if not isinstance(potentials, Polynomial):
        return ()
    from .nearest import nearest_repeatable

    found = []
    for degree in range(1, potentials.degree):
        report(f"degree {degree}, for comparison", 0.0)
        lower = Polynomial(
            potentials.center,
            degree,
            potentials.scale,
            potentials.variables,
            cross=potentials.cross,
        )
        try:
            one = nearest_repeatable(
                design.desired,
                lower,
                design.region,
                options=FitOptions(held_out=design.held_out, seed=design.seed),
            )
        except SingularityError:
            continue
        found.append((degree, one.cost, one.cost_error))
    return (*found, (potentials.degree, design.cost, design.cost_error))


@dataclass(frozen=True, eq=False)
@read_only
class ReportMaps:
    """Maps and curves of a design for a report, all evaluated before anything is plotted.

    Attributes
    ----------
    grid : DesignMap
        Distance to G_d and leaf margin over two joints, with the other joints at the centre of Ω.
    defect : (k, k) array
        Defect of the desired inverse G_d on the same grid, per rad: the drift, rad, per area of a
        small loop whose sides are measured as joint motion, rad. It is a norm over all pairs of
        sides, 0 where G_d satisfies the condition of repeatability, and NaN at singularities.
    degrees : tuple of (degree, cost, standard error)
        Cost of the design for each polynomial degree that was tried.
    baselines : tuple of Baseline
        Costs of two simpler repeatable inverses on the design's held-out nodes; empty if
        ``degrees`` has fewer than two.
    """

    grid: DesignMap
    defect: Array
    degrees: tuple[tuple[int, float, float], ...]
    baselines: tuple[Baseline, ...] = ()


def report_maps(design: Design) -> ReportMaps:
    """Evaluate the data of a report's plots: maps over two joints, and costs.

    The maps show the design and the defect of G_d, the desired inverse, on 41 × 41 configurations.
    Costs of lower degrees and of simpler inverses show whether the degree is worthwhile.
    """
    grid = design_map(design, points=_POINTS)
    Q = _grid(design.region.center, grid.joints, grid.x, grid.y)
    defect = _defects(design, Q).reshape(_POINTS, _POINTS)
    degrees = degree_curve(design)
    baselines = design.evaluate_baselines() if len(degrees) > 1 else ()
    return ReportMaps(grid, defect, degrees, baselines)


def _liveliest(design: Design) -> tuple[int, int]:
    """Choose the two joints along which ‖G_r − G_d‖ changes most; return their indices, rising.

    Each joint is moved alone through its range in the smallest box around Ω; the others stay at the
    centre of Ω.
    """
    box = design.region.bounds
    center = design.region.center
    n = design.task.n
    steps = np.linspace(-1, 1, 17)
    Q = center + steps[None, :, None] * np.eye(n)[:, None, :] * box.half_width  # (n, 17, n)
    distance = _distance(design, Q.reshape(-1, n))[:, 0].reshape(n, -1)
    change = np.nan_to_num(np.nanmax(distance, axis=1) - np.nanmin(distance, axis=1), nan=np.inf)
    first, second = sorted(np.argsort(change)[-2:])
    return int(first), int(second)


def _distance(design: Design, Q: Array) -> Array:
    """Evaluate ‖G_r − G_d‖_F and ‖G_d‖_F at the rows of Q (K, n): (K, 2), NaN at singularities."""

    def evaluate(Q: Array) -> Array:
        G_d = design.desired.batch(Q)
        gap = design.inverse.batch(Q) - G_d
        return np.linalg.norm([gap, G_d], axis=(2, 3)).T

    return _with_gaps(evaluate, Q, 2)


def _defects(design: Design, Q: Array) -> Array:
    """Evaluate by how much G_d violates the Lie bracket condition at Q (K, n): (K,), per rad.

    The result is ``sqrt(Σ_{c<d} ‖Λ_cd‖²)``. Λ_cd is the drift of G_d, rad, per area of a small loop
    along two directions c and d, whose sides are measured as joint motion, rad. So the result
    depends neither on the units nor on the axes of the task. It is 0 where G_d satisfies the
    condition, which is that of repeatability, and NaN at singularities.
    """
    found = _with_gaps(lambda Q: measure(design.desired, Q).norm[:, None], Q, 1)
    return found[:, 0]


def _with_gaps(evaluate: Callable[[Array], Array], Q: Array, width: int) -> Array:
    """Evaluate a function of configurations Q (K, n): (K, width), with NaN rows at singularities.

    ``evaluate`` returns ``width`` numbers per row, and raises a SingularityError if any row is
    singular. So the rows are divided into halves until each singular row is alone.
    """
    try:
        return evaluate(Q)
    except SingularityError:
        if len(Q) == 1:
            return np.full((1, width), np.nan)
        halves = np.array_split(Q, 2)
        return np.concatenate([_with_gaps(evaluate, half, width) for half in halves])
