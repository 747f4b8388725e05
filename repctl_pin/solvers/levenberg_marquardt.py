"""Levenberg–Marquardt: damped Gauss–Newton steps for nonlinear least squares."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Generic, Protocol, TypeVar

from ..arguments import Array, read_only

D = TypeVar("D")
M = TypeVar("M")

_LESS, _MORE = 5.0, 5.0
"""Factors of the damping after a step with a good gain, and after one with a poor gain."""

_RETRY, _FIRST_RETRY = 4.0, 1e-3
"""Factor of the damping after a step that failed, and the smallest damping then."""

_RELAXED = 100.0
"""Divisor of the damping where the damped step predicts no decrease, but a longer one may."""


@dataclass(frozen=True, eq=False)
@read_only
class Point(Generic[D]):
    """The objective at one x.

    Attributes
    ----------
    merit : float
        The number that is minimised.
    cost : float
        The part of it by which convergence is judged.
    allowed : bool
        Whether a step may end here.
    data
        Values that the problem keeps for its model.
    x : array
    """

    merit: float
    cost: float
    allowed: bool
    data: D
    x: Array


@dataclass(frozen=True, eq=False)
@read_only
class Step:
    """A damped step.

    Attributes
    ----------
    dx : array
        Solution of ``(H + μ D) dx = −g``, in the shape of x.
    predicted : float
        Decrease of the merit that the damped model predicts.
    damping : float
        μ that was used: at least the one that was asked for.
    """

    dx: Array
    predicted: float
    damping: float


class LeastSquares(Protocol[D, M]):
    """A nonlinear least-squares problem."""

    def evaluate(self, x: Array) -> Point[D]:
        """Evaluate the objective at x, with all that a model needs."""

    def merit(self, x: Array) -> float:
        """Evaluate the merit alone; infinite where a step may not end."""

    def model(self, at: Point[D]) -> M:
        """Evaluate gradient g and Gauss–Newton matrix H."""

    def step(self, model: M, damping: float) -> Step:
        """Solve ``(H + μ D) dx = −g``; D is the problem's own scaling."""


@dataclass(frozen=True)
class Damping:
    """Rules of the damping μ and of the steps.

    Attributes
    ----------
    first, smallest, largest : float
        Bounds of μ.
    negligible : float
        μ below which it is set to ``smallest``.
    good, fair : float
        Gains, true decrease over predicted one, above which μ is lowered, or left as it is.
    sufficient : float
        Share of the predicted decrease that a step must bring.
    halvings : int
        Lengths tried of a step that brings less; with 0 it is computed anew with a larger μ.
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
        """Choose μ after a step that was taken."""
        if gain > self.good:
            damping = damping / _LESS if damping > self.negligible else self.smallest
        elif gain <= self.fair:
            damping *= _MORE
        return min(max(damping, self.smallest), self.largest)


@dataclass(frozen=True)
class Solution(Generic[D, M]):
    """End of the iteration.

    Attributes
    ----------
    at : Point
        x, and the objective there.
    model
        The last model that was evaluated; None if the start was not finite.
    start : float
        The cost at the start.
    steps : int
        Steps, and models whose damping was lowered instead.
    converged : bool
    """

    at: Point[D]
    model: M | None
    start: float
    steps: int
    converged: bool


def levenberg_marquardt(
    problem: LeastSquares[D, M],
    x: Array,
    rules: Damping,
    *,
    steps: int,
    tolerance: float,
    patience: int = 1,
    predicted: float = -inf,
    enough: float = -inf,
    report: Callable[[int, float], None] | None = None,
) -> Solution[D, M]:
    """Minimise a sum of squares from x by damped Gauss–Newton steps.

    Parameters
    ----------
    problem
        The objective, its model and the damped step.
    x
        The start.
    rules
        How the damping is chosen, and what follows a step that fails.
    steps
        Maximum number of steps.
    tolerance, patience
        The iteration has converged after ``patience`` steps in a row with a relative change of the
        cost of at most ``tolerance``.
    predicted
        It has also converged where an undamped step predicts a relative decrease of at most this.
    enough
        It has also converged where the cost is at most this.
    report : function (steps, cost), optional
        Called before each step.
    """
    here = problem.evaluate(x)
    if not isfinite(here.merit):
        return Solution(here, None, here.cost, 0, False)
    start, model = here.cost, problem.model(here)
    damping = rules.first
    count = still = 0
    while count < steps:
        if report is not None:
            report(count, here.cost)
        if here.cost <= enough:
            return Solution(here, model, start, count, True)
        step = problem.step(model, damping)
        if step.damping > damping:  # with less damping, H + μ D is not positive definite
            damping = step.damping
            rules = replace(rules, smallest=damping)
        if step.predicted <= predicted * here.cost:
            if damping <= rules.smallest:
                return Solution(here, model, start, count, True)
            damping = max(damping / _RELAXED, rules.smallest)
            count += 1
            continue
        trial = _taken(problem, here, step, rules)
        if trial is None:
            damping = max(_RETRY * damping, _FIRST_RETRY)
            if rules.halvings or damping > rules.largest:
                return Solution(here, model, start, count, False)
            continue
        damping = rules.after(damping, (here.merit - trial.merit) / step.predicted)
        small = abs(here.cost - trial.cost) <= tolerance * here.cost
        still = still + 1 if small else 0
        here = trial
        count += 1
        if still == patience:
            return Solution(here, model, start, count, True)
        model = problem.model(here)
    return Solution(here, model, start, count, False)


def _taken(
    problem: LeastSquares[D, M], here: Point[D], step: Step, rules: Damping
) -> Point[D] | None:
    """Take a step, halved until it brings enough of the predicted decrease; None if it never does.

    The full step is evaluated with all that a model needs, because it is usually taken.
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
