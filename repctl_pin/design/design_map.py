"""Maps of distance and leaf margin of a design over two joints, and cost against the degree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arguments import Array, read_only
from ..errors import InputError, SingularityError
from ..fit_options import FitOptions
from ..potentials.polynomial import Polynomial
from ..progress import Report, silent
from .design_result import Design
from .singularity_search import LeafMargin


@dataclass(frozen=True, eq=False)
@read_only
class DesignMap:
    """Distance and leaf margin of a design over two joints; all other joints at the centre of Ω.

    Attributes
    ----------
    joints : (int, int)
        Indices of the joints on the x and the y axis, counted from 0.
    x, y : (k,) arrays
        Values of these joints over the box around Ω, rad or m.
    distance, reference : (k, k) arrays
        ‖G_r − G_d‖_F and ‖G_d‖_F; nan at singularities. Row i belongs to ``y[i]``, column j to
        ``x[j]``.
    leaf_margin : (k, k) array
        σ_min(Nᵀ V̂), in the same order.
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
            f"a map needs two different joints from 0 to {n - 1}, not {joints}"
        )
    x, y = (np.linspace(box.lower[j], box.upper[j], points) for j in (first, second))
    Q = np.tile(center, (points * points, 1))
    Q[:, first], Q[:, second] = (grid.ravel() for grid in np.meshgrid(x, y))
    distance, reference = _distance(design, Q)
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


def degree_curve(
    design: Design, report: Report = silent
) -> tuple[tuple[int, float, float], ...]:
    """Return the cost for each degree of the polynomials, up to the degree of the design.

    If the design was made with ``degree="auto"``, the degrees tried there are returned. Otherwise,
    an inverse is designed for each lower degree.

    Returns
    -------
    tuple of (degree, cost, standard error)
        Without degrees whose design has a singularity in Ω; empty if the potentials are no
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


def _liveliest(design: Design) -> tuple[int, int]:
    """Choose the two joints along which ‖G_r − G_d‖ changes most, as (int, int) in rising order.

    Each joint is moved alone through its range in Ω, from the centre of Ω.
    """
    box = design.region.bounds
    center = design.region.center
    n = design.task.n
    steps = np.linspace(-1, 1, 17)
    Q = (
        center + steps[None, :, None] * np.eye(n)[:, None, :] * box.half_width
    )  # (n, 17, n)
    distance = _distance(design, Q.reshape(-1, n))[0].reshape(n, -1)
    change = np.nan_to_num(
        np.nanmax(distance, axis=1) - np.nanmin(distance, axis=1), nan=np.inf
    )
    first, second = sorted(np.argsort(change)[-2:])
    return int(first), int(second)


def _distance(design: Design, Q: Array) -> tuple[Array, Array]:
    """Evaluate ‖G_r − G_d‖_F and ‖G_d‖_F at the rows of Q (K, n): (K,) each, nan if singular."""
    try:
        G_d = design.desired.batch(Q)
        gap = np.linalg.norm(design.inverse.batch(Q) - G_d, axis=(1, 2))
        return gap, np.linalg.norm(G_d, axis=(1, 2))
    except SingularityError:
        if len(Q) == 1:
            return np.full(1, np.nan), np.full(1, np.nan)
        parts = [_distance(design, half) for half in np.array_split(Q, 2)]
        return np.concatenate([p[0] for p in parts]), np.concatenate(
            [p[1] for p in parts]
        )
