"""Design of the inverse kinematic function over a cell that is nearest to a desired control."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import comb
from typing import Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from .. import progress as reporting
from ..arguments import Array, as_int, flag_or_function, positive, require_choice, require_type
from ..blas import one_blas_thread
from ..errors import InputError
from ..fit_options import FitOptions, fit_options
from ..strategies.strategy import AN_INVERSE, Batched, Inverse
from .cell import LEAST_WIDTH, Cell
from .cell_design import CellDesign
from .cell_evaluation import evaluate_cell
from .chart import Chart
from .cost import Cost, Descent, descend, predicted_gain
from .failures import FailureReason, broken_limit, round_the_base, unreached
from .kinematics import null_bases
from .margins import CandidateFunction, Margin, distances_of, limits_of, singular_values_of
from .monomials import Monomials
from .penalty import ActiveConstraint, PenaltyMethod, padded
from .posture_search import Candidate, given, searched
from .reference import Rays, fitted, rays
from .sector import Sector
from .turning import Turn, centred, reduced

_HELD_OUT = 8192
_MOST_UNKNOWNS = 260
_MOST_TERMS = 220
_MOST_DEGREE = 12
_MOST_SAMPLES, _MOST_HELD_OUT = 2**16, 2**20
_LARGE = 1e6
"""Largest margin that can be requested, rad, m, or m and rad."""

_WORTHWHILE = 0.05
_NOTHING = 2e-4
"""Share of ‖G_d‖² below which the cost is not lowered further: 0.01 % of joint speed."""

_HOPELESS = 0.98
"""Share of the rays that reach their ends below which the cell cannot be covered."""

_DEAR = 0.02
"""Extra joint speed above which other configurations of the middle are tried."""

_FAR_ROUND = 0.9
"""Share of the joints' ranges, of a sector as far as the joints go, below which they are, too."""

_NEARLY = 0.9
"""Coverage below which no other configuration of the middle is tried."""

_LEAST_FACTOR = 0.03
"""Smallest factor by which a cell is scaled in the search for one that is covered."""

_CLOSE = 3e-5
"""Distance, rad, of the last chart from the function; Newton's method then takes two steps."""


Found = CellDesign | tuple[FailureReason, ...]
"""A design, or the reasons for failure."""


class NoFunctionError(InputError):
    """No single function covers the cell.

    The message names a pose, the obstruction there, and the largest similar cell that works.

    Attributes
    ----------
    failures : tuple of FailureReason
        Reasons for failure.
    fits : float
        Factor by which the cell, scaled about its middle, is covered; 0 if there is none.
    partly : bool
        Whether a function covers a part of the cell.

    Examples
    --------
    >>> far = rp.Cell(task, task.placement(q0), 3.0)  # farther than the arm reaches
    >>> try:
    ...     options = rp.FitOptions(samples=64, held_out=64)
    ...     rp.nearest_inverse_function(control, far, degree=1, options=options)
    ... except rp.NoFunctionError as error:
    ...     print(type(error).__name__)
    NoFunctionError
    """

    def __init__(
        self,
        fact: str,
        failures: tuple[FailureReason, ...],
        fits: float,
        partly: bool = False,
        remedy: str = "",
    ) -> None:
        super().__init__(fact, remedy=remedy)
        self.failures, self.fits, self.partly = failures, fits, partly


@one_blas_thread()
def nearest_inverse_function(
    desired: Inverse,
    cell: Cell,
    *,
    posture: ArrayLike | None = None,
    degree: int | Literal["auto"] = "auto",
    limit_margin: float = 0.05,
    body_distance: float = 0.0,
    sigma_min: float = 0.0,
    incomplete: Literal["refuse", "shrink", "keep"] = "refuse",
    options: FitOptions | None = None,
    progress: bool | Callable[[str, float], None] = False,
) -> CellDesign:
    """Find the function ``q = F(x)`` over a cell nearest to a desired control in the mean.

    ``min mean ‖∂F/∂x − G_d(F)‖_F²``. Following G_d along straight rays from the middle gives a
    reference. Among the functions beside it, ``n_refᵀ (F − q_ref) = s(u)`` with s a polynomial,
    Gauss–Newton steps find the best one. Small distances from joint limits, between bodies and from
    singularities are penalised.

    Parameters
    ----------
    desired
        Desired inverse G_d, any strategy with ``J G = I``.
    cell
        The poses.
    posture : (n,) array, optional
        Configuration in the cell's middle, rad (m for prismatic joints). By default, the one with
        the largest margins of those searched on the self-motion there.
    degree
        Degree of s; ``"auto"`` raises it from 1 until no higher one, as far as the number of
        unknowns allows, is predicted to lower the cost by 5 %, or the cost is below 0.01 % of joint
        speed.
    limit_margin
        Joint-limit margin to keep where possible, rad or m.
    body_distance
        Body distance to keep where possible, m; with 0, bodies are not in the cost. In narrow
        places it can cost much joint speed. The summary tells where this, ``limit_margin`` or
        ``sigma_min`` is not met.
    sigma_min
        σ_min of J to keep where possible, in m and rad; with 0 it is not in the cost.
    incomplete
        Action if no single function covers the cell, by held-out poses, corners, and a search for
        the worst poses: ``"refuse"`` it and name a cell that works, ``"shrink"`` the cell about its
        middle, or ``"keep"`` the function on the part that it covers.
    options
        Nodes and seed: ``samples``, ``held_out`` and ``seed`` of :class:`FitOptions`.
    progress
        True for a progress bar on stderr, or a callback (step: str, fraction: float).

    Returns
    -------
    CellDesign
        ``function``, ``inverse``, and their evaluation; see ``summary()``.

    Raises
    ------
    InputError
        If the task is not redundant, the cell is another task's, or its middle cannot be reached.
    NoFunctionError
        If no single function covers the cell.

    Examples
    --------
    >>> cell = rp.Cell(task, task.placement(q0), 0.1)
    >>> options = rp.FitOptions(samples=64, held_out=64)
    >>> found = rp.nearest_inverse_function(control, cell, degree=2, options=options)
    >>> q = found.function(task.placement(q0))  # rad, from the pose alone
    >>> bool(np.abs(task.error(q, task.placement(q0))).max() < 1e-9)
    True
    """
    require_type(desired, Batched, "desired", AN_INVERSE)
    require_type(cell, Cell, "cell", "a cell, such as rp.Cell(task, placement, 0.1)")
    options = fit_options(options)
    options.require_only(("samples", "held_out", "seed"), "nearest_inverse_function")
    samples = options.samples
    if samples is not None:
        samples = as_int(samples, "samples", 16, _MOST_SAMPLES)
    held_out = _HELD_OUT if options.held_out is None else options.held_out
    require_choice(incomplete, ("refuse", "shrink", "keep"), "way to treat an incomplete cell")
    progress = flag_or_function(
        progress, "progress", "a function of what is being done and the share that is done", 2
    )
    if desired.task.as_dict() != cell.task.as_dict():
        raise InputError(
            f"the control is for {desired.task!r}, the cell for {cell.task!r}; "
            "make both for one task"
        )
    if cell.task.r < 1:
        raise InputError(
            f"{cell.task!r} is not redundant: with r = {cell.task.r} the pose determines the joints"
        )
    if not (isinstance(degree, str) and degree == "auto"):
        degree = as_int(degree, "degree", 1, _MOST_DEGREE)
        if comb(cell.k + degree, degree) * cell.task.r > 4 * _MOST_UNKNOWNS:
            raise InputError(
                f"degree {degree} in {cell.k} coordinates makes more than "
                f"{4 * _MOST_UNKNOWNS} unknowns; lower the degree"
            )
    cell = _reduced(cell, desired, body_distance)
    work = _Work(
        desired,
        degree,
        limit_margin=_margin(limit_margin, "limit_margin", "rad"),
        body_distance=_margin(body_distance, "body_distance", "m"),
        sigma_min=_margin(sigma_min, "sigma_min"),
        samples=samples,
        held_out=as_int(held_out, "held_out", 64, _MOST_HELD_OUT),
        seed=options.seed,
        keep=incomplete == "keep",
    )
    with reporting.reporter(progress) as report:
        work = replace(work, report=report)
        report("the middle posture", 0.0)
        postures = (
            searched(desired, cell, work.seed)
            if posture is None
            else [Candidate(given(cell, posture), 1.0, np.inf, np.inf, np.inf)]
        )
        q, found = work.best(cell, postures)
        partly = isinstance(found, CellDesign) and found.coverage > 0
        if isinstance(found, CellDesign) and (
            found.evaluation.everywhere or (partly and incomplete == "keep")
        ):
            return found
        failures = found.failures if isinstance(found, CellDesign) else found
        fits, smaller = _largest(work, cell, q, quick=incomplete != "shrink")
        if incomplete == "shrink" and smaller is not None:
            return smaller
        raise _refusal(cell, failures, fits, keep=partly)


def _reduced(cell: Cell, desired: Inverse, body_distance: float) -> Cell:
    """Leave the symmetric coordinates of a sector out, unless bodies break the symmetry."""
    if not isinstance(cell, Sector):
        return cell
    found = cell if body_distance else reduced(cell, desired)
    for i in cell.free:
        if i not in [one.coordinate for one in found.removed]:
            why = "body_distance=" if body_distance else "the desired inverse"
            raise InputError(
                f"'all' requires the symmetry of the arm, which {why} breaks",
                argument=cell.coordinate_names[i],
                remedy="give it in rad",
            )
    return found


def _no_turn(cell: Cell, turn: Turn) -> FailureReason:
    """Report that no angle is inside the limits at every pose."""
    what = f"{turn.joint} turns {turn.joint_range:.3g} rad, and differs by {turn.spread:.3g} rad"
    return FailureReason("limit", 1.0, np.zeros(cell.whole.k), f"{what} over the cell")


def _margin(value: float, name: str, unit: str = "") -> float:
    """Convert a requested margin."""
    number = positive(value, name, unit, zero=True)
    if number > _LARGE:
        raise InputError(f"can be at most {_LARGE:g}, not {number:g}", argument=name)
    return number


@dataclass(frozen=True)
class _Work:
    """A design over a cell: its arguments, and the search for the best one."""

    desired: Inverse
    degree: int | Literal["auto"]
    limit_margin: float
    body_distance: float
    sigma_min: float
    samples: int | None
    held_out: int
    seed: int
    keep: bool
    report: reporting.Report = reporting.silent

    def best(self, cell: Cell, postures: list[Candidate]) -> tuple[Array, Found]:
        """Design from the first posture; if its margins are too small or its cost is high, from the
        best of all too, by quick designs.

        Where bodies collide, and by their rays do so from every posture, no other is tried."""
        first = postures[0]
        found = self.design(cell, first.q)
        separate = [c for c in postures[1:] if c.body_distance >= 0 and c.share >= first.share]
        if _rank(found, self.limit_margin)[0] < _NEARLY or self.good(found):
            return first.q, found
        if self.good(found, bodies=False):
            postures = [first, *separate]  # collisions alone are to be mended
        if len(postures) == 1:
            return first.q, found
        ranks, quiet = [], replace(self, report=reporting.silent)
        for i, c in enumerate(postures):
            self.report(f"posture {i + 1} of {len(postures)}", 0.1)
            ranks.append(_rank(quiet.design(cell, c.q, quick=True), self.limit_margin))
        best = max(range(len(postures)), key=lambda i: ranks[i])
        designs = [(first.q, found)]
        if best:
            designs.append((postures[best].q, self.design(cell, postures[best].q)))
        return max(designs, key=lambda pair: _rank(pair[1], self.limit_margin))

    def good(self, found: Found, *, bodies: bool = True) -> bool:
        """Whether a design covers the cell without collisions, near limits, or high joint speed."""
        coverage, everywhere, separate, margin, *_ = _rank(found, self.limit_margin)
        kept = (coverage, everywhere, separate or not bodies, margin)
        least = (1.0, True, True, 0.4 * self.limit_margin)
        if not kept >= least:
            return False
        design = cast(CellDesign, found)
        return design.extra_speed < _DEAR and _share(design) >= _FAR_ROUND

    def design(self, cell: Cell, q: Array, *, quick: bool = False) -> Found:
        """Design over one cell; the reasons for failure if it cannot be reached."""
        self.report("the reference", 0.1)
        edge = cell.corners()
        count = self.samples or (
            128 if quick else max(256, _power_of_two(3 * _terms(cell, self._highest(cell))))
        )
        U = cell.sample(count, self.seed + 1)
        ends = rays(self.desired, cell, q, np.concatenate([U, edge]))
        good = ends.reached == 1
        if good[:count].mean() < 0.5:
            return _why(cell, ends, len(U))
        hopeless = not self.keep and bool(good[:count].mean() < _HOPELESS)
        chart = fitted(cell, ends.U[good], ends.Q[good], ends.N[good], 2 if cell.k > 4 else 4)
        U, edge = U[good[:count]], edge[good[count:]]
        at_rest = chart.solve(
            np.concatenate([U, edge]), np.zeros((len(U) + len(edge), cell.task.r))
        ).found
        U, edge = U[at_rest[: len(U)]], edge[at_rest[len(U) :]]
        if len(U) < count / 4:
            return _why(cell, ends, count)
        rounds = 0 if hopeless else 4 if quick else 7
        descent, terms, degrees = self._descended(cell, chart, U, edge, quick or hopeless, rounds)
        if not np.isfinite(descent.value.cost):
            return _why(cell, ends, count)
        self.report("the last chart", 0.7)
        chart, turns = centred(_recharted(cell, chart, descent, terms))
        if any(turn.reach <= 0 for turn in turns):
            return tuple(_no_turn(cell, turn) for turn in turns if turn.reach <= 0)
        self.report("the evaluation", 0.8)
        quick = quick or hopeless
        held_out = min(512, self.held_out) if quick else self.held_out
        evaluation = evaluate_cell(self.desired, chart, held_out, self.seed + 2, quick=quick)
        evaluation = replace(evaluation, turns=turns)
        return CellDesign.of(
            self.desired,
            chart,
            evaluation,
            degrees=degrees,
            samples=len(U),
            held_out=held_out,
            seed=self.seed,
            requested_limit_margin=self.limit_margin,
            requested_body_distance=self.body_distance,
            requested_sigma_min=self.sigma_min,
            steps=descent.steps,
        )

    def _highest(self, cell: Cell) -> int:
        """Highest degree that is tried."""
        if self.degree != "auto":
            return int(self.degree)
        d = 1
        while d < 6 and _terms(cell, d + 1) * cell.task.r <= _MOST_UNKNOWNS:
            d += 1
        return d

    def _descended(
        self, cell: Cell, chart: Chart, U: Array, edge: Array, quick: bool, rounds: int
    ) -> tuple[Descent, Monomials, tuple[tuple[int, float], ...]]:
        """Minimise the cost degree by degree, then with the margin penalties."""
        highest = min(2, self._highest(cell)) if quick else self._highest(cell)
        best: list[Descent] = []
        tried: list[tuple[int, float]] = []
        for d in [highest] if self.degree != "auto" or quick else range(1, highest + 1):
            self.report(f"degree {d}", 0.2 + 0.3 * d / highest)
            terms = Monomials(cell.k, d)
            nodes = _nodes(U, terms)
            below = best[-1].a if best else np.zeros((0, cell.task.r))
            best.append(_fit(Cost(self.desired, chart, terms, nodes), padded(below, terms)))
            tried.append((d, best[-1].value.nearness))
            if best[-1].value.nearness < _NOTHING * best[-1].value.desired_square:
                break
            if d < highest and self.degree == "auto" and not quick:
                most = Monomials(cell.k, highest)
                richest = Cost(self.desired, chart, most, _nodes(U, most))
                if predicted_gain(richest, padded(best[-1].a, most)) < _WORTHWHILE:
                    break
        watched = cell.sample(512 if quick else min(4096, 256 << cell.k), self.seed + 3)
        constraints = [
            ActiveConstraint(m, np.concatenate([watched[: m.watched], edge]))
            for m in self.margins(cell)
        ]
        penalties = PenaltyMethod(self.desired, chart, nodes, constraints, rounds)
        return penalties.kept(best[-1], terms, self.report), terms, tuple(tried)

    def margins(self, cell: Cell) -> list[Margin]:
        """Make the requested margins."""
        found = [limits_of(cell, self.limit_margin)]
        found += [distances_of(cell.task, self.body_distance)] if self.body_distance else []
        return found + ([singular_values_of(cell.task, self.sigma_min)] if self.sigma_min else [])


def _nodes(U: Array, terms: Monomials) -> Array:
    """Select the first poses of U: at least 256, and about three per monomial."""
    return U[: max(256, _power_of_two(3 * terms.size))]


def _fit(cost: Cost, a: Array) -> Descent:
    """Minimise the cost from coefficients a (N, r), or from the reference if a node has no solution
    there."""
    found = descend(cost, a)
    return found if np.isfinite(found.value.cost) else descend(cost, np.zeros_like(a))


def _recharted(cell: Cell, chart: Chart, descent: Descent, terms: Monomials) -> Chart:
    """Fit a chart whose s = 0 is the function: q_ref its configurations, n_ref its null space."""
    degree = max(terms.degree, chart.monomials.degree, 3)
    while degree < 8 and _terms(cell, degree + 1) <= _MOST_TERMS:
        degree += 1
    for d in range(max(terms.degree, 3), degree + 1):
        U = np.concatenate([cell.sample(_power_of_two(3 * _terms(cell, d)), 7), cell.corners()])
        U = np.concatenate([U, np.sign(U) * np.abs(U) ** 0.5])  # denser near the edges
        points = CandidateFunction(chart, terms, descent.a).at(U)
        good = points.found
        N = null_bases(points.J[good], points.n_ref[good])[0]
        found = fitted(cell, U[good], points.Q[good], N, d)
        away = np.abs(found.reference(U[good])[0] - points.Q[good]).max()
        if away < _CLOSE:
            break
    return found


def _why(cell: Cell, ends: Rays, count: int) -> tuple[FailureReason, ...]:
    """List the reasons for failure of rays that did not reach their ends."""
    bad = ends.reached < 1
    near = ends.Q[np.argsort(-ends.reached)[:8]]
    failures = unreached(cell, ends.U[bad], near, float(bad.sum() / count))
    beyond = cell.limit_margin(ends.Q[~bad]).min(axis=1, initial=np.inf) < 0
    limit = broken_limit(cell, ends.U[~bad], ends.Q[~bad], float(beyond.sum() / count))
    return tuple(failures) if limit is None else (*failures, limit)


def _largest(work: _Work, cell: Cell, q: Array, *, quick: bool) -> tuple[float, CellDesign | None]:
    """Find the factor, within 20 %, by which the cell has to be scaled about its middle to be
    covered.

    Rays to the corners and other poses give a first guess, which a design confirms or lowers.
    """
    U = np.concatenate([cell.corners(), cell.sample(32, work.seed)])
    if cell.widths[cell.widths > 0].min() < LEAST_WIDTH / _LEAST_FACTOR:
        return 0.0, None
    low, high = 0.0, 1.0
    for _ in range(5):
        factor = (low + high) / 2
        work.report(f"what would fit: {factor:.0%}", 0.9)
        ends = rays(work.desired, cell.scaled(factor), q, U)
        low, high = (
            (factor, high) if (ends.reached == 1).all() and ends.least.min() > 0 else (low, factor)
        )
    while low > _LEAST_FACTOR:
        found = work.design(cell.scaled(low), q, quick=quick)
        if isinstance(found, CellDesign) and found.evaluation.everywhere:
            return low, found
        low *= 0.8
    return 0.0, None


def _refusal(
    cell: Cell, failures: tuple[FailureReason, ...], fits: float, *, keep: bool
) -> NoFunctionError:
    """Make the error that names the causes, the most frequent first, and a cell that works.

    A collision is no cause: it does not refuse a cell.
    """
    causes = (stop for stop in failures if stop.cause != "collision")
    failures = tuple(sorted(causes, key=lambda stop: -stop.share))
    why = ", and ".join(stop.what for stop in failures) or "its configurations do not fit together"
    ring = round_the_base(cell)
    remedy = (
        f"use incomplete='shrink' to get a cell of {cell.scaled(fits).size()}"
        if fits > 0
        else "no smaller cell with this middle works either; move it, or give another posture="
    )
    if keep:
        remedy += ", or incomplete='keep' to keep the covered part of this one"
    because = f"; {ring}" if ring else ""
    fact = f"no single function covers the cell: {why}{because}"
    return NoFunctionError(fact, failures, fits, partly=keep, remedy=remedy)


def _rank(found: Found, limit_margin: float) -> tuple[float, bool, bool, float, float, float]:
    """Sort key: coverage of held-out poses, of all poses, no collision, limit margin, how far
    round, speed."""
    if not isinstance(found, CellDesign) or found.coverage == 0:
        return 0.0, False, False, -np.inf, -np.inf, -np.inf
    margin, everywhere = min(found.limit_margin, 0.4 * limit_margin), found.evaluation.everywhere
    return found.coverage, everywhere, found.body_distance >= 0, margin, _share(found), -found.cost


def _share(found: CellDesign) -> float:
    """How far a function goes along the coordinates that go as far as the joints do, as a share of
    the joints' ranges, to 5 %; 1 in a box."""
    cell = found.cell
    free = cell.free if isinstance(cell, Sector) else ()
    names = [cell.coordinate_names[i] for i in free]
    turns = [turn for turn in found.evaluation.turns if turn.coordinate in names]
    shares = [turn.reach / min(turn.joint_range, 2 * np.pi) for turn in turns]
    return float(np.round(20 * min(shares, default=1.0)) / 20)


def _terms(cell: Cell, degree: int) -> int:
    return comb(cell.k + degree, degree)


def _power_of_two(count: int) -> int:
    return 1 << max(0, int(np.ceil(np.log2(max(count, 1)))))
