"""Trimming of a cell: sides are moved inward until one function covers what is left.

A box or sector in which the function fails at one corner thus becomes smaller on one side only. To
cut a cell along a coordinate is to move one or both ends of its range inward, so that a part of the
cell is left. Coordinates u of a pose go from −1 to 1 between the sides. A coordinate of a sector,
angle or spin, is symmetric if a single joint moves the frame along it. A symmetric coordinate is
removed from u; "in all coordinates" means u together with the removed coordinates. The range
``"all"`` of a symmetric coordinate ends only at the limits of its joint. A ray is a motion along a
straight line from the middle of the cell. A quick design is faster and less accurate. A chart is
the pair of polynomials of u in which a function is written. Extra joint speed is the joint speed
relative to that of the desired inverse, such as J⁺, minus 1.

The argument ``fit`` has the arguments of the design, ``limits`` are the limits that a function must
meet, and q (n,) is the configuration in the middle of the cell. ``found`` is a design or, if too
few poses are reached, a tuple of the reasons for failure. ``useful`` is a function that tells
whether a part of a cell is still of use. K poses are the rows of U (K, k), with k coordinates u
each; n is the number of joints. A part of a cell is given by two corners, ``low`` and ``high``
(k,): its smallest and its largest u_i, from −1 to 1.

``CellFit`` holds the arguments of a design over a cell, and the methods that compute the design.
``Required`` holds the limits of a function: mean and maximum extra joint speed relative to G_d
(0.05 is 5 %), and body distance, m. ``Sample`` is a function F evaluated at K poses of its cell:
configurations, joint speeds and margins. ``Symmetry`` is a joint that changes only one coordinate
of the frame: the indices of both, and the sign, 1 or −1, of the change. ``Window`` is a range of
the angle around the arm: the direction of its middle, and its half-width, rad. ``Chart`` is
coordinates (u, s) of configurations: u gives the pose, the label s (r,) the position along its
self-motion. ``CandidateFunction`` is a candidate for F: a chart, and the coefficients a of the
label ``s(u) = Σ_t a_t T_t(u)``, with monomials T_t.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array
from ....base.errors import InputError
from ....model.bodies import bodies_of
from ....model.native_kinematics import placed
from ....model.task import Task
from ..cell_design_result import CellDesign
from ..chart.chart import Chart
from ..evaluate.cell_evaluation import Sample, evaluate_cell, sampled
from ..evaluate.margins import CandidateFunction, nearest_by_pair, with_edges
from ..evaluate.reach import rays
from ..evaluate.symmetric_coordinates import expanded, narrowed
from ..geometry.cell import Cell
from ..geometry.cut import cut_sides
from ..geometry.sector import ANGLE, Sector
from ..geometry.symmetry import Symmetry
from ..place.posture_search import given
from .cell_fit import CellFit

_ROUNDS, _CUTS = 6, 12
"""Maximum numbers of designs over smaller and smaller parts, and of cuts where bodies are near."""

_POSES, _TURNED = 4096, 2048
"""Numbers of poses at which a function is tested, and of those at which its bodies are."""

_BODIES = 768
"""Number of poses at which bodies are tested to move the sides of radius and height."""

_TURNS = 6
"""Number of angles around the arm at which bodies are tested."""

_DEAREST = 0.97
"""Share of the poses that are kept where a function costs too much on average."""

_INSIDE = 0.01
"""Distance in u by which the first cut leaves out more than the worst pose; later ones more."""

_NEARLY = 0.7
"""Share of the cell that is left by a cut of a quick design from which on the function of full
accuracy is designed."""

_LEAST = 0.05
"""Share of the cell below which nothing of use is left."""


class Window(NamedTuple):
    """Range of the angle around the arm.

    ``outward`` (3,) is the horizontal unit vector, base axes, from the axis of the sector toward
    the middle of the range; ``half`` is the half-width of the range, rad.
    """

    outward: Array
    half: float


class Required(NamedTuple):
    """Limits that a function must meet on the part of a cell that is left, besides covering it.

    Attributes
    ----------
    mean, worst : float
        Maximum extra joint speed relative to the desired inverse, on average and at any pose;
        0.05 is 5 %. Infinite without a limit.
    distance : float
        Minimum body distance, m; −inf without a test.
    window : Window, optional
        Range of the angle of a sector in which body distances are tested. Parts of the sector
        outside this range are cut off. By default, the whole range of the sector is tested.
    """

    mean: float = np.inf
    worst: float = np.inf
    distance: float = -np.inf
    window: Window | None = None


def trimmed(
    fit: CellFit,
    cell: Cell,
    q: Array,
    limits: Required,
    guess: CellDesign | None = None,
    *,
    useful: Callable[[Cell], bool] = lambda _: True,
) -> CellDesign | None:
    """Move sides of a cell inward until one function meets the limits on the rest.

    ``fit`` has the arguments of the design. ``q`` (n,) is the configuration in the middle,
    ``guess`` a quick design from there, if there is one. A quick design shows at which poses a
    function fails, and sides are moved inward past these poses. This is repeated with the part that
    is left, until a part keeps more than 70 % of its volume, at most six times. Then one function
    of full accuracy is designed over it. Where this function fails, sides are moved further; the
    function stays the same. Return the design of this function over the part that is left. Return
    None if this part would be less than 5 % of the cell or not ``useful``, or if no function is
    found.
    """
    volume = 1.0
    for _ in range(_ROUNDS):
        quick = guess or fit.design(cell, q, quick=True)
        guess = None
        low, high = cut_sides(*_failing(fit, cell, q, quick, limits))
        left = float(np.prod((high - low) / 2))
        volume *= left
        if volume < _LEAST:
            return None
        if left < 1:
            inner = _between(fit, cell, q, quick, low, high)
            if inner is None:
                return None
            cell, q = inner
        if not useful(cell):
            return None
        if left > _NEARLY and isinstance(quick, CellDesign):
            found = fit.design(cell, q, guess=quick, rough=True)
            if not isinstance(found, CellDesign):
                return None
            return kept_where_good(fit, found, limits, useful)
    return None


def _between(
    fit: CellFit, cell: Cell, q: Array, found: object, low: Array, high: Array
) -> tuple[Cell, Array] | None:
    """Return the part of a cell between two corners (k,), and a configuration (n,) in its middle.

    The configuration is that of the design ``found`` or, if ``found`` is no design, the end of a
    ray from q (n,). Return None if inverse kinematics from this configuration does not reach the
    middle of the part, or ends at a singularity or outside a limit.
    """
    part = cell._part(low, high)
    with suppress(InputError):
        return part, given(part, _configuration(fit, cell, q, found, (low + high) / 2))
    return None


def covered_share(
    fit: CellFit, cell: Cell, q: Array, limits: Required, known: CellDesign | None = None
) -> tuple[float, CellDesign | None]:
    """Estimate by a quick design the fraction of a cell's volume that one function covers.

    This is the fraction that is left when sides are moved inward until the poses at which the
    design fails or exceeds ``limits`` lie outside. ``known`` is a quick design, if there is one
    already. Return the fraction and the design, which is None if it failed.
    """
    found = known or fit.design(cell, q, quick=True)
    low, high = cut_sides(*_failing(fit, cell, q, found, limits))
    share = float(np.prod((high - low) / 2))
    return share, found if isinstance(found, CellDesign) else None


def _failing(
    fit: CellFit, cell: Cell, q: Array, found: object, limits: Required
) -> tuple[Array, NDArray[np.bool_]]:
    """Test at sampled poses whether a function fails or exceeds limits: return U (K, k), bad (K,).

    ``bad`` is True where the function of the design ``found`` fails or exceeds limits. If ``found``
    is no design, a pose is bad if the ray from q to the pose stops before the pose, or violates a
    joint limit.
    """
    U = np.concatenate([cell.sample(_POSES, 17), cell.corners()])
    if not isinstance(found, CellDesign):
        ends = rays(fit.desired, cell, q, U[::4])
        return ends.U, (ends.reached < 1) | (ends.least < 0)
    candidate = CandidateFunction.zero(found.function.chart)
    at = sampled(fit.desired, candidate, U, directions=False)
    bad = _too_dear(at, limits, dear=False) | ~at.covered
    more = cell._split(_stops(found, Required(), bodies_only=False))[0]
    U, bad = np.concatenate([U, more]), np.pad(bad, (0, len(more)), constant_values=True)
    if np.isfinite(limits.distance):
        some = np.flatnonzero(~bad[: len(at.Q)])[:_BODIES]
        around = next((one for one in cell.removed if one.coordinate == ANGLE), None)
        bad[some] = near_all_round(
            cell.task, at.Q[some], limits.distance, around, _range(cell, limits.window)
        )
    if found.extra_speed > limits.mean and not bad.any():
        bad[: len(at.Q)] = _too_dear(at, limits, dear=True)
    return U, bad


def _too_dear(at: Sample, limits: Required, *, dear: bool) -> NDArray[np.bool_]:
    """Test at which sampled poses the extra joint speed exceeds the limit ``worst``: (K,).

    ``dear`` is True for a function that exceeds the limit ``mean``; the 3 % of the poses with the
    highest joint speed then count as well.
    """
    ratio = np.nan_to_num(at.ratio, nan=np.inf)
    most = np.quantile(ratio[np.isfinite(ratio)], _DEAREST) if dear else np.inf
    return np.asarray((ratio >= (1 + limits.worst) ** 2) | (ratio >= most))


def near_all_round(
    task: Task,
    Q: Array,
    distance: float,
    around: Symmetry | None,
    angles: tuple[float, float] = (-np.pi, np.pi),
) -> NDArray[np.bool_]:
    """Test at which configurations Q (K, n) bodies are too near, however the arm is turned: (K,).

    Bodies are too near below ``distance``, m. The joint ``around`` turns the whole arm. Each
    configuration is turned by six angles between the two ``angles``, rad, measured from the given
    configuration. Angles beyond the limits of this joint are left out. The result is True if bodies
    are too near at all other angles, or if no angle is inside the limits. If ``around`` is None,
    each configuration is tested as it is.
    """
    bodies = bodies_of(task)
    if around is None:
        return bodies._nearer(Q, distance)
    # pairs that the joint does not move relative to each other are as near at every angle
    moved = bodies._moved_by(around.joint)
    near = bodies._nearer(Q, distance, ~moved)
    left = np.flatnonzero(~near)
    for angle in np.linspace(*angles, 2 * _TURNS + 1)[1::2]:
        there = turned(task, Q[left], around, float(angle))
        shut = there[:, around.joint] > task.upper[around.joint]
        shut[~shut] = bodies._nearer(there[~shut], distance, moved)
        left = left[shut]
    near[left] = True
    return near


def turned(task: Task, Q: Array, around: Symmetry, angle: float) -> Array:
    """Turn the arm at configurations Q (K, n) by an angle, rad, with the joint ``around``.

    In the result (K, n), this joint is less than a full turn above its lower limit, and can be
    beyond its upper limit. Without limits, the joint is between 0 and a full turn.
    """
    Q, low = Q.copy(), task.lower[around.joint]
    low = low if np.isfinite(low) else 0.0
    Q[:, around.joint] = low + (Q[:, around.joint] + around.sign * angle - low) % (2 * np.pi)
    return Q


def _range(cell: Cell, window: Window | None) -> tuple[float, float]:
    """Return the first and the last angle of a window, rad, measured from the middle of a sector.

    Without a window, or for a box, they are −π and π.
    """
    if window is None or not isinstance(cell, Sector):
        return -np.pi, np.pi
    x, y, _ = cell.directions @ window.outward
    middle = float(np.arctan2(y, x))
    return middle - window.half, middle + window.half


def _configuration(fit: CellFit, cell: Cell, q: Array, found: object, u: Array) -> Array:
    """Return a configuration (n,) at the pose u (k,) of a cell.

    If ``found`` is a design, the configuration is that of its function; otherwise it is the end of
    a ray from q (n,). A design may have moved the middle of its sector along symmetric coordinates.
    The joints of these coordinates are therefore turned back, so that the frame is at 0 along the
    symmetric coordinates of ``cell``, the sector before the design.
    """
    if not isinstance(found, CellDesign):
        return rays(fit.desired, cell, q, u[None]).Q[0]
    Q = found.function.chart.solve(u[None]).Q
    p, R, _ = placed(cell.task, Q)
    return np.asarray(Q[0] - cell.along @ cell._measured(p, R)[0, cell._removed])


def ended_at_bodies(fit: CellFit, found: CellDesign) -> CellDesign:
    """Cut the coordinates with the range ``"all"`` of a design's sector where bodies collide.

    The function stays the same. The sector is cut until neither samples nor a search find a
    collision. The design is returned unchanged if less than 5 % of the sector would be left.
    """
    free = found.function.chart.cell.free
    if not found.body_distance < 0 or not free:
        return found
    return _cut_until_good(fit, found, Required(distance=0.0), free, bodies_only=True) or found


def kept_where_good(
    fit: CellFit,
    found: CellDesign,
    limits: Required,
    useful: Callable[[Cell], bool] = lambda _: True,
) -> CellDesign | None:
    """Cut a cell on all sides, also in angle and spin, until its function meets ``limits``.

    The function stays the same. Return None if the part that is left would be less than 5 % of the
    volume or not ``useful``.
    """
    cell = found.function.chart.cell
    some = [*cell.free, *cell.moved]
    return _cut_until_good(fit, found, limits, some, bodies_only=False, useful=useful)


def _cut_until_good(
    fit: CellFit,
    found: CellDesign,
    limits: Required,
    coordinates: Sequence[int],
    *,
    bodies_only: bool,
    useful: Callable[[Cell], bool] = lambda _: True,
) -> CellDesign | None:
    """Cut a cell along some of its coordinates until a function meets ``limits`` on the rest.

    ``coordinates`` are the numbers of these coordinates in the cell. The limits are tested at
    sampled poses, and at poses that searches and the evaluation find. With ``bodies_only``, only
    the body distance is tested. Return the design over the rest, or None if the rest would be less
    than 5 % of the cell or not ``useful``.
    """
    chart, left, design = found.function.chart, 1.0, found
    stops = _stops(found, limits, bodies_only)
    if limits.window is not None and ANGLE in coordinates:
        ends = np.clip(
            np.array(_range(chart.cell, limits.window)) / chart.cell.widths[ANGLE], -1, 1
        )
        if ends[1] - ends[0] < 2:
            chart, stops = _cut(chart, {ANGLE: (ends[0], ends[1])}, fit.limit_margin), stops[:0]
    for k in range(_CUTS):
        U, bad = _near(chart, limits.distance, seed=19 + k)
        # where bodies are near, joint speed is tested after the next cut
        if not bodies_only and (k == 0 or not bad.any()):
            dear = design.extra_speed > limits.mean and (k == 0 or design.function.chart is chart)
            bad |= _uncovered(fit, chart, U, limits, dear=dear)
        U, bad = np.concatenate([U, stops]), np.pad(bad, (0, len(stops)), constant_values=True)
        if bad.any():
            columns = [int(np.flatnonzero(chart.cell.whole.moved == i)[0]) for i in coordinates]
            weights = None if bodies_only else _weights(chart.cell, coordinates)
            low, high = cut_sides(U[:, columns], bad, _INSIDE * (k + 1), weights)
            left *= float(np.prod((high - low) / 2))
            if left < _LEAST:
                return None
            ends = dict(zip(coordinates, zip(low, high, strict=True), strict=True))
            chart, stops = _cut(chart, ends, fit.limit_margin), stops[:0]
            if not useful(chart.cell):
                return None
            continue
        # the given design has a quick evaluation, except where bodies alone are tested
        if (design is found and not bodies_only) or design.function.chart is not chart:
            design = _evaluated(fit, found, chart, limits)
        stops = _stops(design, limits, bodies_only)
        if not len(stops) and design.extra_speed <= limits.mean:
            return design
    return None


def _weights(cell: Cell, coordinates: Sequence[int]) -> Array:
    """Return one weight per coordinate: how much a loss of its range counts in the choice of a cut.

    Radius, height and tilts have the weight 1. A symmetric angle or spin whose range is the
    fraction s of a full turn has the weight s / (1 + s), because a sector with this range is rated
    with the factor (1 + s) / 2: if s falls by 1 %, the factor falls by s / (1 + s) %.
    """
    s = cell.widths[list(coordinates)] / np.pi
    turns = np.isin(coordinates, [one.coordinate for one in cell.removed])
    return np.where(turns, s / (1 + s), 1.0)


def _stops(design: CellDesign, limits: Required, bodies_only: bool) -> Array:
    """Return the poses at which the evaluation of a design found a failure, in all coordinates.

    The shape is (K, k). Poses with collisions are included only if ``limits`` require a body
    distance, other failures only without ``bodies_only``.
    """
    collide = bool(np.isfinite(limits.distance))
    return np.array(
        [
            np.clip(stop.u, -1, 1)
            for stop in design.failures
            if (collide if stop.cause == "collision" else not bodies_only)
        ]
    ).reshape(-1, design.function.chart.cell.whole.k)


def _uncovered(
    fit: CellFit, chart: Chart, U: Array, limits: Required, *, dear: bool
) -> NDArray[np.bool_]:
    """Test at which poses U (K, k), in all coordinates, a function fails or is too fast: (K,).

    The function is too fast at a pose if the extra joint speed exceeds ``limits.worst``. ``dear``
    is True for a function whose mean extra joint speed exceeds ``limits.mean``; the 3 % of the
    poses with the highest joint speed then also count as too fast.
    """
    candidate, U = CandidateFunction.zero(chart), chart.cell._split(U)[0]
    at = sampled(fit.desired, candidate, U, directions=False)
    return np.asarray(~at.covered | _too_dear(at, limits, dear=dear))


def _near(chart: Chart, distance: float, seed: int) -> tuple[Array, NDArray[np.bool_]]:
    """Sample poses of a chart's function, and test where bodies are nearer than ``distance``, m.

    Return the poses U (K, k), and a mask (K,) that is True where bodies are too near. U are in all
    coordinates of the cell, because body distances depend on all coordinates. If bodies are too
    near at no sampled pose, the poses at which each pair of bodies is nearest are searched for and
    added.
    """
    whole = expanded(chart)
    candidate = CandidateFunction.zero(whole)
    U = with_edges(whole.cell, _TURNED, seed, np.random.default_rng(seed))
    near = _nearer(candidate, U, distance)
    if np.isfinite(distance) and not near.any():
        more = nearest_by_pair(candidate, seed, distance)
        U = np.concatenate([U, more])
        near = np.concatenate([near, _nearer(candidate, more, distance)])
    return U, near


def _nearer(candidate: CandidateFunction, U: Array, distance: float) -> NDArray[np.bool_]:
    """Test at which poses U (K, k) two bodies are nearer than ``distance``, m: (K,).

    The arm is in the configuration that the candidate function has at the pose. The result is False
    at poses beyond the joint limits, where bodies are not tested.
    """
    points, task = candidate.at(U), candidate.chart.cell.task
    there = points.found & (task.limit_margin(points.Q).min(axis=1) > -1e-6)
    near = np.zeros(len(U), bool)
    if np.isfinite(distance):
        near[there] = bodies_of(task)._nearer(points.Q[there], distance)
    return near


def _cut(chart: Chart, ends: dict[int, tuple[float, float]], margin: float) -> Chart:
    """Return the chart of the same function over a part of its cell.

    ``ends`` has the new ends (low, high), from −1 to 1, by number of the coordinate in the cell. If
    a range ``"all"`` that ended at the limits of a joint is cut, its ends move inward by at least
    ``margin``, rad.
    """
    cell, ranges = chart.cell, {}
    for i, (low, high) in ends.items():
        if i not in cell.moved and (low > -1 or high < 1):
            w = cell.widths[i]
            least = -w + margin * (i in cell.free and w < np.pi - 1e-9)
            ranges[i] = max(w * low, least), min(w * high, -least)
    chart = narrowed(chart, ranges) if ranges else chart
    low, high = np.array([ends.get(int(i), (-1.0, 1.0)) for i in cell.moved]).T
    return chart.between(low, high)


def _evaluated(fit: CellFit, found: CellDesign, chart: Chart, limits: Required) -> CellDesign:
    """Evaluate the function of a design over the part of its cell that a cut has left.

    ``found`` is the design before the cut, ``chart`` the chart of the same function over the part;
    nothing is fitted again. Return the design over the part. If ``limits`` have a body distance, it
    becomes the requested body distance of this design.
    """
    evaluation = evaluate_cell(
        fit.desired,
        chart,
        fit.held_out,
        fit.seed + 2,
        quick=False,
        required=max(limits.distance, 0.0),
    )
    links = " and ".join(found.evaluation.nearest_bodies)
    before, after = found.function.chart.cell, chart.cell
    names = {after.whole.coordinate_names[i]: 2 * after.widths[i] for i in before.free}
    ended = {before.whole.coordinate_names[i] for i in set(before.free) - set(after.free)}
    turns = tuple(
        replace(turn, reach=names[turn.coordinate], bodies=links)
        if turn.coordinate in ended
        else turn
        for turn in found.evaluation.turns
    )
    how = _how(found) | {"held_out": fit.held_out}
    if limits.distance > 0:
        how["requested_body_distance"] = limits.distance
    design = CellDesign.of(fit.desired, chart, evaluation, **how)
    return replace(design, evaluation=replace(evaluation, turns=turns))


def _how(found: CellDesign) -> dict[str, object]:
    """Return the attributes that a design keeps when its cell is cut, by name.

    These are the attributes of the fit, such as ``degrees`` and ``samples``, and the requested
    margins.
    """
    names = ["degrees", "samples", "held_out", "seed", "steps"]
    names += [f"requested_{name}" for name in ("limit_margin", "body_distance", "sigma_min")]
    return {name: getattr(found, name) for name in names}
