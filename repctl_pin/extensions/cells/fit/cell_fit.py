"""Fit of an inverse function over a cell: from the configuration in its middle to the function.

The function q = F(x) gives one configuration for each pose of the cell, a box of poses with
coordinates u (k,) from −1 to 1. Configurations in the middle are compared. Rays, which are motions
along straight lines from the middle to poses, are followed from there, and a chart is fitted to
their ends: the polynomial q_ref(u) approximates configurations, n_ref(u) null spaces. The label
s(u), a polynomial, is the position of F along the self-motion, measured from q_ref. Then the cost
is minimised with rising degree of s, and with penalties on small margins.

A quick design has a lower degree, fewer nodes and a quick evaluation, without searches for the
worst joint speeds, leaf margins and body distances. A coordinate of a sector, angle or spin, is
symmetric if a single joint moves the frame along it; its range can be given as ``"all"``. Extra
joint speed is the joint speed relative to that of the desired inverse, minus 1. Nodes are the poses
at which the cost is evaluated. Letters: n joints, r components of s, k coordinates u, N monomials
of u, K and L poses.

``Candidate`` is a configuration in the middle of a cell, with the share of corners that rays from
there reach, and its margins. ``Chart`` is coordinates (u, s) of configurations: u gives the pose,
the label s (r,) the position along its self-motion. ``Descent`` is the result of a minimisation:
coefficients a, the cost with its configurations, and the number of steps. ``Turn`` is the range,
rad, over which a function can be used along a symmetric coordinate. ``ActiveConstraint`` is one
kind of margin, with the poses at which it is checked and those at which it is penalised. ``Margin``
is a kind of margin, such as joint limits, with its required minimum. ``Monomials`` are all
monomials ``u^α`` up to a degree in the coordinates u, the constant 1 first. ``Cost`` is the cost of
a candidate function: mean distance from the desired inverse, plus penalties on margins.
``FailureReason`` is one reason why a function fails at some poses of its cell: cause, share of the
poses, worst pose.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from math import comb
from typing import Literal, cast

import numpy as np

from ....base import progress as reporting
from ....base.arguments import Array
from ....redundancy import leaf_margin
from ....strategies.strategy import Inverse
from ..cell_design_result import CellDesign
from ..chart.chart import Chart
from ..chart.monomials import Monomials
from ..evaluate.cell_evaluation import evaluate_cell
from ..evaluate.cell_failures import FailureReason, broken_limit, unreached
from ..evaluate.margins import (
    CandidateFunction,
    Margin,
    distances_of,
    limits_of,
    singular_values_of,
)
from ..evaluate.reach import Rays, rays
from ..evaluate.symmetric_coordinates import Turn, centred
from ..geometry.cell import Cell
from ..geometry.kinematics import null_bases, rows_of
from ..geometry.sector import ANGLE, Sector
from ..place.posture_search import Candidate
from .cost import Cost, Descent, descend, predicted_gain
from .penalty import ActiveConstraint, PenaltyMethod, padded

MOST_UNKNOWNS, _MOST_TERMS = 260, 220
"""Maximum numbers of unknowns of the fit, and of monomials of the final chart."""

_WORTHWHILE = 0.05
"""Relative decrease of the cost, predicted for the highest degree, for which the degree is
raised."""

_NOTHING = 2e-4
"""Cost relative to ‖G_d‖² at which the degree is not raised further: 0.01 % extra joint speed."""

_HOPELESS = 0.98
"""Fraction of the rays from the middle followed to their ends, below which the cell counts as not
coverable."""

_DEAR = 0.02
"""Extra joint speed above which other configurations in the middle are tried."""

_FAR_ROUND = 0.9
"""Fraction of the joint range that a coordinate with the range ``"all"`` must cover; below it,
other configurations in the middle are tried."""

_NEARLY = 0.9
"""Coverage below which no other configuration in the middle is tried."""

_SPARE = 0.5
"""Surplus of the attainable range over the requested angle of a sector, rad, with which the request
is assumed to cost no joint speed."""

_PRICED = 1024
"""Number of held-out poses for the comparison design with the angle ``"all"``."""

_CLOSE = 3e-5
"""Maximum deviation, rad or m, of q_ref of the final chart from the function, so that Newton's
method takes two steps."""
_UPRIGHT, _STEEPEST, _DENSE = 0.4, 14, 2048
"""Minimum leaf margin at the nodes of a chart below which the degree of n_ref is raised, the
highest degree, and the number of nodes in two coordinates, where the null space may turn within
few."""
_STRAIGHT = 0.999
"""Minimum leaf margin at the nodes of the final chart with which n_ref may have a lower degree."""

_Found = CellDesign | tuple[FailureReason, ...]
"""A design, or the reasons for failure."""


@dataclass(frozen=True)
class CellFit:
    """Arguments of a design of a function over a cell, and methods that compute the design.

    The attributes are arguments of :func:`nearest_inverse_function`; ``keep`` means
    ``incomplete="keep"``: the function may cover only a part of the cell. ``samples`` and
    ``held_out`` are the numbers of poses for the fit and for the evaluation, ``seed`` is their
    random seed. ``most_extra`` is the extra joint speed that the fit tries not to exceed at any
    pose; 0.3 is 30 %. ``report`` is the progress callback (step, fraction).
    """

    desired: Inverse
    degree: int | Literal["auto"] = "auto"
    _: KW_ONLY
    limit_margin: float
    body_distance: float = 0.0
    sigma_min: float = 0.0
    samples: int | None = None
    held_out: int
    seed: int
    keep: bool
    most_extra: float = np.inf
    report: reporting.Report = reporting.silent

    def best(self, cell: Cell, postures: list[Candidate]) -> tuple[Array, _Found]:
        """Compute the best design over a cell, given configurations in its middle, the best first.

        A first design is made from the first configuration: a quick design if rays from there
        violate limits, else a full design. If the first design is :meth:`good`, or its coverage is
        below 90 %, no other configuration is tried. Otherwise quick designs from all configurations
        are compared, and the best configuration is used. If collisions are the only fault of the
        first design, it is compared only with configurations whose rays are free of collisions and
        reach at least as many corners.

        Return the configuration (n,) of the best full design, and this design: a CellDesign or, if
        no design succeeded, a tuple of FailureReason.
        """
        first = postures[0]
        doubtful = len(postures) > 1 and first.margin < 0
        found = self.design(cell, first.q, quick=doubtful)
        if _rank(found, self.limit_margin)[0] < _NEARLY or self.good(found):
            postures = [first]
        elif self.good(found, bodies=False):  # collisions alone are to be mended
            others = (c for c in postures[1:] if c.share >= first.share)
            postures = [first, *(c for c in others if c.body_distance >= 0)]
        ranks, quicks, quiet = [], [], replace(self, report=reporting.silent)
        for i, c in enumerate(postures if len(postures) > 1 else []):
            self.report(f"posture {i + 1} of {len(postures)}", 0.1)
            quick = found if doubtful and not i else quiet.design(cell, c.q, quick=True)
            ranks.append(_rank(quick, self.limit_margin))
            quicks.append(quick)
        best = max(range(len(ranks)), key=lambda i: ranks[i], default=0)
        designs = [] if doubtful else [(first.q, found)]
        if best or doubtful:
            q, guess = postures[best].q, quicks[best] if quicks else found
            designs.append((q, self.design(cell, q, guess=guess)))
        return max(designs, key=lambda pair: _rank(pair[1], self.limit_margin))

    def good(self, found: _Found, *, bodies: bool = True) -> bool:
        """Test whether a design covers the whole cell, far enough from limits and at a low cost.

        The limit margin must be at least 40 % of the requested margin, the extra joint speed below
        2 %, and a coordinate with the range ``"all"`` must have 90 % of its joint's range.
        ``found`` can also be a tuple of reasons for failure; the result is then False. With
        ``bodies=False``, collisions are allowed.
        """
        coverage, everywhere, separate, margin, *_ = _rank(found, self.limit_margin)
        kept = (coverage, everywhere, separate or not bodies, margin)
        least = (1.0, True, True, 0.4 * self.limit_margin)
        if not kept >= least:
            return False
        design = cast(CellDesign, found)
        return design.extra_speed < _DEAR and _share(design) >= _FAR_ROUND

    def design(
        self, cell: Cell, q: Array, *, quick: bool = False, guess: _Found = (), rough: bool = False
    ) -> _Found:
        """Design a function over one cell from the configuration q (n,) in its middle.

        Return the design, or the reasons for failure if too few poses are reached from the middle.
        With ``quick``, nodes and evaluation are few and the degree is at most 2; with ``rough``,
        only the evaluation is quick. ``guess`` is a quick design from the same configuration, at
        which the fit with penalties begins; by default none.
        """
        self.report("the reference", 0.1)
        count = self.samples or (128 if quick else self._enough(cell))
        U, edge = cell.sample(count, self.seed + 1), cell.corners()
        ends = rays(self.desired, cell, q, np.concatenate([U, edge]))
        good = ends.reached == 1
        if good[:count].mean() < 0.5:
            return _why(cell, ends, len(U))
        hopeless = not self.keep and bool(good[:count].mean() < _HOPELESS)
        chart = self._first_chart(cell, q, rows_of(ends, good), quick)
        U, edge = _where_found(chart, U[good[:count]], edge[good[count:]])
        if len(U) < count / 4:
            return _why(cell, ends, count)
        rounds = 0 if hopeless else 3 if quick else 7
        descent, terms, degrees = self._descended(chart, U, edge, quick or hopeless, rounds, guess)
        if not np.isfinite(descent.value.cost):
            return _why(cell, ends, count)
        self.report("the last chart", 0.7)
        quick = quick or hopeless
        chart, turns = centred(_recharted(cell, chart, descent, terms, quick), quick=quick)
        if any(turn.reach <= 0 for turn in turns):
            return tuple(_no_turn(cell, turn) for turn in turns if turn.reach <= 0)
        return self.evaluated(
            chart, turns, degrees=degrees, samples=len(U), steps=descent.steps, quick=quick or rough
        )

    def evaluated(
        self,
        chart: Chart,
        turns: tuple[Turn, ...],
        *,
        degrees: tuple[tuple[int, float], ...],
        samples: int,
        steps: int,
        quick: bool,
    ) -> CellDesign:
        """Evaluate the function with the label s = 0 of the final ``chart``, and make its design.

        The final chart was fitted such that the optimised function has s = 0 in it. ``turns`` are
        the ranges of the function along symmetric coordinates, ``degrees`` are pairs (degree,
        cost), ``samples`` is the number of poses at which the fit evaluated the cost, and ``steps``
        the number of steps of the minimisation. With ``quick``, the evaluation is quick.
        """
        self.report("the evaluation", 0.8)
        held_out = min(512, self.held_out) if quick else self.held_out
        evaluation = evaluate_cell(self.desired, chart, held_out, self.seed + 2, quick=quick)
        return CellDesign.of(
            self.desired,
            chart,
            replace(evaluation, turns=turns),
            degrees=degrees,
            samples=samples,
            held_out=held_out,
            seed=self.seed,
            requested_limit_margin=self.limit_margin,
            requested_body_distance=self.body_distance,
            requested_sigma_min=self.sigma_min,
            steps=steps,
        )

    def _first_chart(self, cell: Cell, q: Array, ends: Rays, quick: bool) -> Chart:
        """Fit the first chart to the ends of rays, of a degree with which n_ref is near N.

        N is the null space of J at the ends. Where N turns by more than 90° over a short distance,
        a polynomial n_ref of low degree can be perpendicular to N. The equations of the chart are
        then singular although the function is not.

        This is tested for cells with two coordinates only: n_ref is compared with the null space at
        many poses (fewer with ``quick``). If n_ref is not near the null space there, rays from the
        configuration q (n,) in the middle are followed to these poses. The degree is then raised
        until n_ref is near N at the ends of all these rays. If no degree up to 14 is high enough,
        the degree is not raised.
        """
        chart = Chart.fitted(cell, ends.U, ends.Q, ends.N, 2 if cell.k > 4 else 4)
        if cell.k != 2:
            return chart
        count = _DENSE // 4 if quick else _DENSE
        U = np.concatenate([cell.sample(count, self.seed + 1), cell.corners()])
        points = chart.solve(U)
        on = rows_of(points, points.found)
        if len(on.U) == len(U) and _follows(chart, U, null_bases(on.J, on.n_ref)):
            return chart
        more = rays(self.desired, cell, q, U)
        more = rows_of(more, more.reached == 1)
        if _follows(chart, more.U, more.N):
            return chart
        for degree in range(chart.monomials.degree + 1, _STEEPEST + 1):
            steep = Chart.fitted(cell, more.U, more.Q, more.N, degree)
            if _follows(steep, more.U, more.N):
                return steep
        return chart

    def priced(self, found: CellDesign, q: Array) -> CellDesign:
        """Add to a design over a sector the extra joint speed that its range of the angle costs.

        The user thus sees what a smaller range would save. For comparison, a second function is
        designed with the range ``"all"``, from the configuration q (n,) in the middle. The
        difference of the two extra joint speeds is stored with the range of the angle. The design
        is returned unchanged if the range was not requested in rad, if the symmetry of the angle is
        not used, if the joint limits would allow a range that is wider by 0.5 rad or more, or if
        the second design fails.
        """
        sector = found.function.chart.cell
        names = found.cell.coordinate_names
        turns = {turn.coordinate: turn for turn in found.evaluation.turns}
        if not isinstance(sector, Sector) or ANGLE in sector.free:
            return found
        if names[ANGLE] not in turns:
            return found
        turn = turns[names[ANGLE]]
        if not turn.reach < 2 * sector.widths[ANGLE] + _SPARE:
            return found
        free = sector.without(sector.removed, (*sector.free, ANGLE))
        self.report("extra joint speed for the angle", 0.9)
        work = replace(self, held_out=min(_PRICED, self.held_out), report=reporting.silent)
        other = work.design(free, q)
        if not isinstance(other, CellDesign) or other.coverage == 0:
            return found
        unasked = next(t.reach for t in other.evaluation.turns if t.coordinate == names[ANGLE])
        price = found.extra_speed - other.extra_speed
        turns[names[ANGLE]] = replace(turn, price=price, unasked=unasked)
        return replace(found, evaluation=replace(found.evaluation, turns=tuple(turns.values())))

    def _highest(self, cell: Cell) -> int:
        """Return the highest degree to try for the polynomial s(u) of a function.

        If a degree was requested, it is this degree. For "auto", it is the highest degree up to 6
        with at most 260 coefficients, and at least 1.
        """
        if self.degree != "auto":
            return int(self.degree)
        d = 1
        while d < 6 and _terms(cell, d + 1) * cell.task.r <= MOST_UNKNOWNS:
            d += 1
        return d

    def _enough(self, cell: Cell) -> int:
        """Compute the default number of poses for a fit.

        It is the smallest power of 2 that is at least 256, and at least 3 times the number of
        monomials of the highest degree.
        """
        return max(256, _power_of_two(3 * _terms(cell, self._highest(cell))))

    def _descended(
        self, chart: Chart, U: Array, edge: Array, quick: bool, rounds: int, guess: _Found
    ) -> tuple[Descent, Monomials, tuple[tuple[int, float], ...]]:
        """Minimise the cost with rising degree, then with penalties on small margins.

        The unknowns are the coefficients of s(u), the position of the function along the
        self-motion at each pose u.

        Parameters
        ----------
        chart
            The chart, over the cell, in which the function is written.
        U, edge : (K, k) and (L, k) arrays
            Nodes of the cost, and corners at which margins are also checked.
        quick
            Try only one degree, at most 2.
        rounds
            Maximum number of minimisations with penalties per degree, see :class:`PenaltyMethod`;
            the weight of the penalties rises from one to the next.
        guess
            Result of an earlier quick design, or ``()`` without one. If the highest degree tried in
            this call is above 2, the minimisations with penalties begin at the function of the
            quick design. Otherwise they begin at the results of the minimisations without
            penalties, which are done in either case.

        Returns
        -------
        Descent, Monomials, tuple of (degree, cost)
            The final coefficients, their monomials, and the degrees that were tried, each with the
            cost without penalties.
        """
        descents, terms, degrees = self._of_rising_degree(chart, U, quick)
        nodes, most = _nodes(U, terms), self.most_extra
        if np.isfinite(most):
            nodes = np.concatenate([nodes, edge])
        constraints = self._constraints(chart.cell, edge, quick)
        penalties = PenaltyMethod(self.desired, chart, nodes, constraints, rounds, most)
        enough, start = 1e-2 if quick else 1e-3, _labels(guess, chart, U)
        kept = penalties.kept(descents, terms, self.report, enough=enough, guess=start)
        return kept, terms, degrees

    def _of_rising_degree(
        self, chart: Chart, U: Array, quick: bool
    ) -> tuple[list[Descent], Monomials, tuple[tuple[int, float], ...]]:
        """Minimise the cost at nodes U (K, k), with a degree that rises while this is worthwhile.

        With ``quick``, only one degree is tried, at most 2. Return the coefficients for each degree
        that was tried, the monomials of the last one, and pairs (degree, cost).
        """
        highest = self._highest(chart.cell)
        highest = min(2, highest) if quick else highest
        best: list[Descent] = []
        tried: list[tuple[int, float]] = []

        def cost_of(degree: int) -> Cost:
            terms = Monomials(chart.cell.k, degree)
            return Cost(self.desired, chart, terms, _nodes(U, terms))

        richest = None
        for d in [highest] if self.degree != "auto" or quick else range(1, highest + 1):
            self.report(f"degree {d}", 0.2 + 0.3 * d / highest)
            below = best[-1].a if best else np.zeros((0, chart.cell.task.r))
            cost = richest if richest and d == highest else cost_of(d)
            best.append(_fit(cost, padded(below, cost.terms)))
            tried.append((d, best[-1].value.nearness))
            if best[-1].value.nearness < _NOTHING * best[-1].value.desired_square:
                break
            if d < highest and self.degree == "auto" and not quick:
                richest = richest or cost_of(highest)
                if predicted_gain(richest, padded(best[-1].a, richest.terms)) < _WORTHWHILE:
                    break
        return best, cost.terms, tuple(tried)

    def _constraints(self, cell: Cell, edge: Array, quick: bool) -> list[ActiveConstraint]:
        """Make one constraint per kind of margin, at sampled poses and at corners ``edge`` (L, k).

        With ``quick``, fewer poses are sampled.
        """
        watched = cell.sample(512 if quick else min(4096, 256 << cell.k), self.seed + 3)
        return [
            ActiveConstraint(m, np.concatenate([watched[: m.watched], edge]))
            for m in self.margins(cell, quick=quick)
        ]

    def margins(self, cell: Cell, *, quick: bool = False) -> list[Margin]:
        """Make the kinds of margins that the fit must meet: joint limits, and others if requested.

        The other kinds are the body distance and σ_min(J). With ``quick``, searches for small limit
        margins start from fewer poses.
        """
        limits = limits_of(cell, self.limit_margin)
        found = [replace(limits, starts=24, violators=48) if quick else limits]
        found += [distances_of(cell.task, self.body_distance)] if self.body_distance else []
        return found + ([singular_values_of(cell.task, self.sigma_min)] if self.sigma_min else [])


def _nodes(U: Array, terms: Monomials) -> Array:
    """Return the first poses of U (K, k), enough to fit the monomials ``terms`` to them.

    Their number is at least 256, and at least three per monomial. If U has fewer rows, all rows are
    returned.
    """
    return U[: max(256, _power_of_two(3 * terms.size))]


def _labels(guess: _Found, chart: Chart, U: Array) -> Array | None:
    """Write the function of the design ``guess`` in another chart, with s(u) of degree 2.

    Return the coefficients (N, r) of s, fitted at the poses U (K, k). A fit in the other chart
    begins at these coefficients. Return None if ``guess`` is no design, or over another cell.
    """
    if not isinstance(guess, CellDesign) or guess.function.chart.cell is not chart.cell:
        return None
    points = CandidateFunction.zero(guess.function.chart).at(U)
    q_ref, n_ref = chart.reference(U)
    labels = np.einsum("Knr,Kn->Kr", n_ref, points.Q - q_ref)
    return Monomials(chart.cell.k, 2).fit(U[points.found], labels[points.found])


def _fit(cost: Cost, a: Array) -> Descent:
    """Minimise the cost from coefficients a (N, r) of the label s.

    If the function with these coefficients does not exist at some node, the minimisation starts
    from a = 0 instead.
    """
    found = descend(cost, a)
    return found if np.isfinite(found.value.cost) else descend(cost, np.zeros_like(a))


def _follows(chart: Chart, U: Array, N: Array) -> bool:
    """Test whether n_ref of a chart is near the null spaces N (K, n, r) at all poses U (K, k).

    The test is ``σ_min(Nᵀ n̂_ref) > 0.4``; n̂_ref is an orthonormal basis of the columns of n_ref.
    This singular value is 0 if a direction of n_ref is perpendicular to N, and 1 if n_ref spans N.
    """
    return bool(leaf_margin(N, chart.reference(U)[1]).min() > _UPRIGHT)


def _recharted(cell: Cell, chart: Chart, descent: Descent, terms: Monomials, quick: bool) -> Chart:
    """Fit the final chart, in which the optimised function is s = 0 and fast to evaluate.

    The optimised function is written in ``chart``; the coefficients of its label s are those of
    ``descent``, for the monomials ``terms``. q_ref of the final chart approximates the
    configurations of the function, and n_ref the null spaces at these configurations. The degree is
    raised until n_ref follows the null spaces and, except with ``quick``, q_ref is accurate enough
    for two Newton steps.
    """
    degree = max(terms.degree, chart.monomials.degree, 3)
    while not quick and degree < 8 and _terms(cell, degree + 1) <= _MOST_TERMS:
        degree += 1
    steep, steepest = chart.monomials.degree > 4, degree
    while steep and steepest < _STEEPEST and _terms(cell, steepest + 1) <= _MOST_TERMS:
        steepest += 1
    for d in range(max(terms.degree, 3), steepest + 1):
        count = _power_of_two(3 * _terms(cell, d))
        count = max(count, _DENSE) if steep and not quick else count
        U = cell._dense_at_edges(count, 7)
        points = CandidateFunction(chart, terms, descent.a).at(U)
        good = points.found
        N = null_bases(points.J[good], points.n_ref[good])
        found = Chart.fitted(cell, U[good], points.Q[good], N, d)
        close = np.abs(found.reference(U[good])[0] - points.Q[good]).max() < _CLOSE or d >= degree
        follows = _follows(found, U[good], N)
        if d <= degree or follows:
            best = found, U[good], N
        if close and (follows or not steep):
            break
    return _with_simple_fibres(*best)


def _with_simple_fibres(chart: Chart, U: Array, N: Array) -> Chart:
    """Reduce the degree of n_ref, the null-space directions of a chart, if n_ref stays accurate.

    ``N`` (K, n, r) are bases of the null spaces at the poses U (K, k), which n_ref approximates. A
    lower degree makes the C code faster, and changes the function s = 0 by little, because q_ref is
    unchanged. If no lower degree is accurate, the chart is returned unchanged.
    """
    for degree in range(1, chart.monomials.degree):
        low = Monomials(chart.cell.k, degree)
        fibres = low.fit(U, N)
        n_ref = low.polynomials(U, fibres)
        if leaf_margin(N, n_ref).min() > _STRAIGHT:
            coefficients = chart.coefficients.copy()
            coefficients[:, :, 1:] = padded(fibres, chart.monomials)
            return replace(chart, coefficients=coefficients)
    return chart


def _why(cell: Cell, ends: Rays, count: int) -> tuple[FailureReason, ...]:
    """Return the reasons why a cell fails, from rays that could not be followed to their ends.

    ``count`` is the number of rays; the ``share`` of each reason is a fraction of it. Joint limits
    that rays violate at their ends are a reason, too.
    """
    bad = ends.reached < 1
    near = ends.Q[np.argsort(-ends.reached)[:8]]
    failures = unreached(cell, ends.U[bad], near, float(bad.sum() / count))
    beyond = cell.limit_margin(ends.Q[~bad]).min(axis=1, initial=np.inf) < 0
    limit = broken_limit(cell, ends.U[~bad], ends.Q[~bad], float(beyond.sum() / count))
    return tuple(failures) if limit is None else (*failures, limit)


def _no_turn(cell: Cell, turn: Turn) -> FailureReason:
    """Make the reason for failure that the joint of a symmetric coordinate has too small a range.

    Over the cell, the values of this joint differ by more than the range between its limits. The
    reason has the share 1: it concerns all poses.
    """
    what = f"{turn.joint} turns {turn.joint_range:.3g} rad, and differs by {turn.spread:.3g} rad"
    return FailureReason("limit", 1.0, np.zeros(cell.whole.k), f"{what} over the cell")


def _rank(found: _Found, limit_margin: float) -> tuple[float, bool, bool, float, float, float]:
    """Return the sort key of a design; larger keys are better.

    The entries of the key are: coverage of the held-out poses (0 to 1); True if every evaluated
    pose is covered; True without collisions; the limit margin, or 0.4 ``limit_margin`` if that is
    smaller; the range of the symmetric coordinates, as a fraction of their joints' ranges; and the
    negative cost. ``limit_margin`` is the requested limit margin, rad or m. Reasons for failure, in
    place of a design, have the lowest key.
    """
    if not isinstance(found, CellDesign) or found.coverage == 0:
        return 0.0, False, False, -np.inf, -np.inf, -np.inf
    margin, everywhere = (min(found.limit_margin, 0.4 * limit_margin), found.evaluation.everywhere)
    return (
        found.coverage,
        everywhere,
        found.body_distance >= 0,
        margin,
        _share(found),
        -found.cost,
    )


def _share(found: CellDesign) -> float:
    """Compute which fraction of its possible range a coordinate with the range ``"all"`` gets.

    For such a coordinate, angle or spin, R is the range of the joint that moves it, at most a full
    turn. The coordinate gets R minus the joint's motion over the cell, so the fraction is that
    divided by R. The result is the smallest fraction, rounded to 5 %; 1 if no coordinate has the
    range ``"all"``.
    """
    cell = found.cell
    names = [cell.coordinate_names[i] for i in cell.free]
    turns = [turn for turn in found.evaluation.turns if turn.coordinate in names]
    shares = [turn.reach / min(turn.joint_range, 2 * np.pi) for turn in turns]
    return float(np.round(20 * min(shares, default=1.0)) / 20)


def _terms(cell: Cell, degree: int) -> int:
    """Compute the number of monomials up to a degree in the coordinates of a cell."""
    return comb(cell.k + degree, degree)


def _power_of_two(count: int) -> int:
    """Return the smallest power of two that is at least ``count``, for Sobol points."""
    return 1 << max(0, int(np.ceil(np.log2(max(count, 1)))))


def _where_found(chart: Chart, U: Array, edge: Array) -> tuple[Array, Array]:
    """Return the rows of U (K, k) and of ``edge`` (L, k) at which a function exists.

    The function is that with the label s = 0 in the chart. It exists at a pose if Newton's method
    finds its configuration there.
    """
    found = chart.solve(np.concatenate([U, edge])).found
    return U[found[: len(U)]], edge[found[len(U) :]]
