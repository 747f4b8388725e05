"""Trimming of a cell: sides are moved inward until one function covers what is left.

A box or sector that one corner spoils thus loses one side, and not a share of all sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array
from ....base.errors import InputError
from ....model.bodies import bodies_of
from ..cell_design import CellDesign
from ..chart.chart import Chart
from ..evaluate.cell_evaluation import evaluate_cell, sampled
from ..evaluate.margins import CandidateFunction
from ..evaluate.reach import rays
from ..evaluate.turning import expanded, narrowed
from ..geometry.cell import Cell
from ..geometry.cut import cut_sides
from ..geometry.kinematics import placed
from ..geometry.sector import ANGLE
from ..place.posture_search import given
from .cell_fit import CellFit

_ROUNDS = 6
_POSES, _TURNED = 4096, 2048
"""Numbers of poses at which a function is tested, and of those where bodies are."""

_BODIES = 768
"""Number of poses at which bodies are tested to move the sides of radius and height."""

_LEAST = 0.05
"""Share of the cell below which nothing of use is left."""


class Required(NamedTuple):
    """What a function must keep on the part of a cell that it covers.

    Attributes
    ----------
    mean, worst : float
        Maximum extra joint speed, on average and at any pose.
    distance : float
        Minimum body distance, m; −inf without a test.
    """

    mean: float = np.inf
    worst: float = np.inf
    distance: float = -np.inf


def trimmed(
    fit: CellFit, cell: Cell, q: Array, limits: Required
) -> tuple[Cell, Array, CellDesign] | None:
    """Design a function on a part of a cell, whose sides are moved inward until it is covered.

    Quick designs find the part. ``q`` (n,) is the configuration in the middle. Return the part, the
    configuration in its middle, and the design; None if no part of 5 % is covered.
    """
    volume, quick = 1.0, True
    for _ in range(_ROUNDS):
        found = fit.design(cell, q, quick=quick)
        U, bad = _failing(fit, cell, q, found, limits)
        if not bad.any():
            if not isinstance(found, CellDesign):
                return None
            if not quick and found.evaluation.everywhere:
                return cell, q, found
            if not quick:
                return None
            quick = False
            continue
        low, high = cut_sides(U, bad)
        volume *= float(np.prod((high - low) / 2))
        if volume < _LEAST:
            return None
        part = cell._part(low, high)
        try:
            q = given(part, _configuration(fit, cell, q, found, (low + high) / 2))
        except InputError:
            return None
        cell = part
    return None


def covered_share(
    fit: CellFit, cell: Cell, q: Array, limits: Required
) -> tuple[float, CellDesign | None]:
    """Estimate by one quick design which share of a cell is left after a cut, and return it."""
    found = fit.design(cell, q, quick=True)
    low, high = cut_sides(*_failing(fit, cell, q, found, limits))
    share = float(np.prod((high - low) / 2))
    return share, found if isinstance(found, CellDesign) else None


def _failing(
    fit: CellFit, cell: Cell, q: Array, found: object, limits: Required
) -> tuple[Array, NDArray[np.bool_]]:
    """Evaluate where a function fails: coordinates U (K, k), and True where it does (K,).

    Without a design, these are the poses that rays from the middle, q (n,), do not reach.
    """
    U = np.concatenate([cell.sample(_POSES, 17), cell.corners()])
    if not isinstance(found, CellDesign):
        ends = rays(fit.desired, cell, q, U[::4])
        return ends.U, (ends.reached < 1) | (ends.least < 0)
    chart = found.function.chart
    at = sampled(fit.desired, CandidateFunction.zero(chart), U)
    with np.errstate(invalid="ignore"):
        bad = ~at.covered | ~(at.ratio < (1 + limits.worst) ** 2)
    others = [stop.u for stop in found.failures if stop.cause != "collision"]
    if others:
        more = cell._split(np.clip(np.array(others), -1, 1))[0]
        U, bad = np.concatenate([U, more]), np.concatenate([bad, np.ones(len(more), bool)])
    if np.isfinite(limits.distance):
        some = np.flatnonzero(~bad[: len(at.Q)])[:_BODIES]
        bad[some] = too_near(chart.cell, at.Q[some], limits.distance)
    if found.extra_speed > limits.mean and not bad.any():  # the dearest poses go
        ratio = np.nan_to_num(np.pad(at.ratio, (0, len(U) - len(at.ratio))), posinf=0.0)
        bad |= ratio > np.quantile(ratio, 0.97)
    return U, bad


def too_near(cell: Cell, Q: Array, distance: float) -> NDArray[np.bool_]:
    """Test at which configurations Q (K, n) bodies are nearer than a distance, m.

    The surroundings may be in the way at one angle alone, so they are tested at five angles; a
    sector is then cut along its angle.
    """
    task, bodies = cell.task, bodies_of(cell.task)
    near = bodies.hull_distances(Q) < distance
    near[near] = bodies.distances(Q[near]) < distance
    joints = [one.joint for one in cell.removed if one.coordinate == ANGLE]
    if task.robot.surroundings is not None and joints:
        around = np.eye(task.n)[joints[0]]
        for turn in (0.9, -0.9, 1.8, -1.8):
            near[near] = bodies.distances(Q[near] + turn * around) < distance
    return near


def _configuration(fit: CellFit, cell: Cell, q: Array, found: object, u: Array) -> Array:
    """Return the configuration (n,) of a design at u (k,), or that of a ray from the middle.

    The design may have moved the sector along its symmetric coordinates, which is undone.
    """
    if not isinstance(found, CellDesign):
        return rays(fit.desired, cell, q, u[None]).Q[0]
    Q = found.function.chart.solve(u[None]).Q
    p, R, _ = placed(cell.task, Q)
    return np.asarray(Q[0] - cell.along @ cell._measured(p, R)[0, cell._removed])


def turned_poses(chart: Chart, count: int) -> tuple[Cell, Array, Array]:
    """Sample a function over all coordinates of its cell, those of symmetries included.

    Return the whole cell, coordinates (K, k) and configurations (K, n) where they are inside the
    limits.
    """
    whole = expanded(chart)
    U = np.concatenate([whole.cell.sample(count, 19), whole.cell.corners()])
    points = whole.solve(U)
    margin = whole.cell.task.limit_margin(points.Q).min(axis=1)
    good = points.found & (margin > -1e-6)
    return whole.cell, U[good], points.Q[good]


def ended_at_bodies(
    fit: CellFit, found: CellDesign, coordinates: Sequence[int], distance: float = 0.0
) -> CellDesign:
    """Cut a sector's symmetric coordinates, such as the angle, where bodies come too close.

    The function is the same, over a smaller range. The design is returned unchanged if no bodies
    are closer than ``distance``, m, or no range of these ``coordinates`` is free of such poses.
    """
    chart = found.function.chart
    if not coordinates or not found.body_distance < distance:
        return found
    sector, U, Q = turned_poses(chart, _TURNED)
    bad = bodies_of(found.task).distances(Q) < distance
    if not bad.any():
        return found
    columns = [int(np.flatnonzero(sector.moved == i)[0]) for i in coordinates]
    low, high = cut_sides(U[:, columns], bad)
    if float(np.prod((high - low) / 2)) < _LEAST:
        return found
    ranges = {}
    for i, below, above in zip(coordinates, low, high, strict=True):
        if below > -1 or above < 1:
            w = sector.widths[i]
            least = -w if w >= np.pi - 1e-9 else -w + fit.limit_margin
            ranges[i] = max(w * below, least), min(w * above, -least)
    cut = narrowed(chart, ranges)
    evaluation = evaluate_cell(fit.desired, cut, found.held_out, fit.seed + 2, quick=False)
    links = " and ".join(found.evaluation.nearest_bodies)
    names = {sector.coordinate_names[i]: high - low for i, (low, high) in ranges.items()}
    turns = tuple(
        replace(turn, reach=names[turn.coordinate], bodies=links)
        if turn.coordinate in names
        else turn
        for turn in found.evaluation.turns
    )
    function = CellDesign.of(fit.desired, cut, evaluation, **_how(found))
    return replace(function, evaluation=replace(evaluation, turns=turns))


def _how(found: CellDesign) -> dict[str, object]:
    """Return how a design was made: its attributes that do not depend on the cell."""
    names = ["degrees", "samples", "held_out", "seed", "steps"]
    names += [f"requested_{name}" for name in ("limit_margin", "body_distance", "sigma_min")]
    return {name: getattr(found, name) for name in names}
