"""Levenberg–Marquardt: damped Gauss–Newton steps for nonlinear least squares.

Designs and cells minimise their costs with this method. The merit is what steps must decrease, the
cost plus penalties; g is its gradient, and H the Gauss–Newton matrix. μ is the damping: a large μ
makes a step short and safe.

``Point[D]`` is the objective at one x: ``merit``, ``cost``, and ``data``, the intermediate values
of a type D, chosen by the problem, from which g and H are computed. M is the type of g and H
together. ``Step`` is a damped Gauss–Newton step dx, with its predicted decrease and its damping.
``_LeastSquares`` is a least-squares problem: functions for merit, gradient with Gauss–Newton
matrix, and step. ``_Solution`` is the point reached, and how the minimisation ended. ``Damping``
are the parameters of the damping μ and of the acceptance of steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Generic, Protocol, TypeVar

from ..base.arguments import Array, read_only

D = TypeVar("D")
M = TypeVar("M")

_LESS, _MORE = 5.0, 5.0
"""Divisor of the damping after a step with a good gain, and factor after one with a poor gain."""

_RETRY, _FIRST_RETRY = 4.0, 1e-3
"""Factor of the damping after a rejected step, and smallest damping after a rejected step."""

_RELAXED = 100.0
"""Divisor of the damping if the damped step predicts no decrease; a longer step may predict one."""


@dataclass(frozen=True, eq=False)
@read_only
class Point(Generic[D]):
    """The objective at one x, with intermediate values of its evaluation.

    Attributes
    ----------
    merit : float
        The objective that is minimised, penalties included.
    cost : float
        The objective whose changes decide on convergence, such as the merit without penalties.
    allowed : bool
        True if a step that ends at x may be accepted.
    data
        Intermediate values from which :meth:`_LeastSquares.model` computes g and H.
    x : array
        Unknowns, an array of any shape.
    """

    merit: float
    cost: float
    allowed: bool
    data: D
    x: Array


@dataclass(frozen=True, eq=False)
@read_only
class Step:
    """Damped Gauss–Newton step: the solution dx of ``(H + μ D) dx = −g``.

    g is the gradient, H the Gauss–Newton matrix, μ the damping and D a scaling.

    Attributes
    ----------
    dx : array
        Solution of ``(H + μ D) dx = −g``, in the shape of x.
    predicted : float
        Decrease of the merit that the damped model predicts.
    damping : float
        The μ that was used; larger than the requested μ if H + μ D was not positive definite.
    """

    dx: Array
    predicted: float
    damping: float


class _LeastSquares(Protocol[D, M]):
    """Interface of a nonlinear least-squares problem, which :func:`levenberg_marquardt` minimises.

    A problem evaluates a merit at x, its gradient g and its Gauss–Newton matrix H.
    """

    def evaluate(self, x: Array) -> Point[D]:
        """Evaluate the objective at x, and the intermediate values from which g and H follow."""

    def merit(self, x: Array) -> float:
        """Evaluate the merit alone; infinite where a step may not be accepted.

        The line search needs the merit only.
        """

    def model(self, at: Point[D]) -> M:
        """Evaluate the gradient g and the Gauss–Newton matrix H of the merit at a point.

        ``at`` is the evaluated objective at x. The problem chooses the form of the result, the
        argument ``model`` of :meth:`step`.
        """

    def step(self, model: M, damping: float) -> Step:
        """Solve ``(H + μ D) dx = −g`` with μ = ``damping``; the problem chooses the scaling D."""


@dataclass(frozen=True)
class Damping:
    """Parameters of the damping μ and of the acceptance of steps.

    The gain of a step is the actual decrease of the merit divided by the predicted one.

    Attributes
    ----------
    first : float
        Initial μ.
    smallest, largest : float
        Bounds of μ.
    negligible : float
        A μ at or below this value is lowered to ``smallest`` in one step.
    good, fair : float
        μ is lowered if the gain is above ``good``, and raised if it is not above ``fair``.
    sufficient : float
        Fraction of the predicted decrease that a step must achieve to be accepted.
    halvings : int
        Number of step lengths (1, ½, ¼, …) that are tried; if none is accepted, the iteration
        ends. 0 has a different effect: only the full step is tried, and if it is rejected, a new
        step is computed with a larger μ.
    """

    first: float = 0.0
    smallest: float = 0.0
    largest: float = 1e6
    negligible: float = 1e-4
    good: float = 0.0
    fair: float = 0.0
    sufficient: float = 0.0
    halvings: int = 0

    def after(self, damping: float, gain: float) -> float:
        """Return the next μ after an accepted step, from its μ and its gain.

        The gain is the actual decrease of the merit divided by the predicted one. A gain above
        ``good`` lowers μ, and one of ``fair`` or less raises it. Between these values, μ does not
        change.
        """
        if gain > self.good:
            damping = damping / _LESS if damping > self.negligible else self.smallest
        elif gain <= self.fair:
            damping *= _MORE
        return min(max(damping, self.smallest), self.largest)


@dataclass(frozen=True)
class _Solution(Generic[D]):
    """Result of :func:`levenberg_marquardt`: the point reached, and how the minimisation ended.

    Attributes
    ----------
    at : Point
        Final x, and the objective there.
    start : float
        The cost at the start.
    steps : int
        Number of accepted steps, and of iterations that lowered μ instead of taking a step.
        Rejected steps are not counted.
    converged : bool
        True if a condition of convergence was met; False if the number of iterations was used up,
        no step was accepted, or the merit at the start is infinite.
    """

    at: Point[D]
    start: float
    steps: int
    converged: bool


def levenberg_marquardt(
    problem: _LeastSquares[D, M],
    x: Array,
    rules: Damping,
    *,
    steps: int,
    tolerance: float,
    patience: int = 1,
    predicted: float = -inf,
    enough: float = -inf,
    report: Callable[[int, float], None] | None = None,
) -> _Solution[D]:
    """Minimise a sum of squares from x by damped Gauss–Newton steps.

    Parameters
    ----------
    problem
        The objective, its model and the damped step.
    x
        The start.
    rules
        Parameters of the damping, and of the acceptance of steps.
    steps
        Maximum number of steps, counted as in :class:`_Solution`.
    tolerance, patience
        The iteration has converged after ``patience`` successive steps that each change the cost by
        at most the fraction ``tolerance``.
    predicted
        The iteration has also converged if a step with the smallest damping predicts a decrease of
        at most this fraction of the cost.
    enough
        The iteration has also converged if the cost is at most ``enough``.
    report : function (steps, cost), optional
        Progress callback, called before each step with the number of steps so far, counted as in
        :class:`_Solution`, and the present cost.
    """
    here = problem.evaluate(x)
    if not isfinite(here.merit):
        return _Solution(here, here.cost, 0, False)
    start, model = here.cost, problem.model(here)
    damping = rules.first
    count = still = 0
    while count < steps:
        if report is not None:
            report(count, here.cost)
        if here.cost <= enough:
            return _Solution(here, start, count, True)
        step = problem.step(model, damping)
        if step.damping > damping:  # with less damping, H + μ D is not positive definite
            damping = step.damping
            rules = replace(rules, smallest=damping)
        if step.predicted <= predicted * here.cost:
            if damping <= rules.smallest:
                return _Solution(here, start, count, True)
            damping = max(damping / _RELAXED, rules.smallest)
            count += 1
            continue
        trial = _accepted_step(problem, here, step, rules)
        if trial is None:
            damping = max(_RETRY * damping, _FIRST_RETRY)
            if rules.halvings or damping > rules.largest:
                return _Solution(here, start, count, False)
            continue
        damping = rules.after(damping, (here.merit - trial.merit) / step.predicted)
        small = abs(here.cost - trial.cost) <= tolerance * here.cost
        still = still + 1 if small else 0
        here = trial
        count += 1
        if still == patience:
            return _Solution(here, start, count, True)
        model = problem.model(here)
    return _Solution(here, start, count, False)


def _accepted_step(
    problem: _LeastSquares[D, M], here: Point[D], step: Step, rules: Damping
) -> Point[D] | None:
    """Halve a step from ``here`` until the merit decreases sufficiently; return the accepted point.

    ``rules`` has the number of halvings and the sufficient decrease. The result is None if no
    length is accepted. The full step is usually accepted, so it is evaluated by ``evaluate``, whose
    data the next model needs; shorter steps are evaluated by ``merit`` first.
    """

    def most(length: float) -> float:
        return here.merit - rules.sufficient * length * step.predicted

    trial = problem.evaluate(here.x + step.dx)
    if trial.allowed and trial.merit < most(1.0):
        return trial
    for k in range(1, rules.halvings):
        length = 0.5**k
        shorter = here.x + length * step.dx
        if problem.merit(shorter) < most(length):
            return problem.evaluate(shorter)
    return None
