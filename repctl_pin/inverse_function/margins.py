"""Margins of a candidate function (joint limits, bodies, singularities) and a search for the
smallest ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, read_only
from ..robot.bodies import Bodies, bodies_of
from ..robot.task import Task
from ..solvers import StepLengths, descend_in_box
from .cell import Cell
from .chart import Chart, Points
from .monomials import Monomials

_DIFFERENCE = 3e-4
"""Step of q, per unit of the direction, in central differences of a margin."""

_ENDLESS = 1e6
"""Value that replaces an infinite margin, of a joint without limits, in a difference."""

_NEARBY, _FAR, _APART = 12, 40, 0.06
"""Number of leaves to either side that are searched for a larger margin, near and far, and their
spacing, rad."""

_HALVINGS = 6
"""Number of times that the spacing is halved around the best of them."""

_LENGTHS = StepLengths(first=0.2, longest=0.5, shortest=1e-4, longer=1.5, shorter=3.0, steps=25)
"""Step lengths in u."""

_JUMP = 1.0
"""Joint step, rad or m, that means a jump to another solution."""


_TESTED, _AT_ONCE = 32, 8
"""Poses with overlapping hulls at which the bodies themselves are tested: for the share that
collides, and at a time in the search for the deepest."""


@dataclass(frozen=True)
class Margin:
    """A quantity with a required minimum.

    Attributes
    ----------
    name : str
    measure : function (K, n) → (K, P)
        The P margins at configurations: one per joint for its limits, one for all bodies, or σ_min
        of J.
    required : float
        Required minimum.
    slack : float
        Share of it that may be missing.
    watched, starts, violators : int
        Maximum numbers of poses at which it is checked, from which smaller ones are searched for,
        and that a round may add to the cost. A body distance takes a hundred times as long as a
        joint limit.
    """

    name: str
    measure: Callable[[Array], Array]
    required: float
    slack: float
    watched: int
    starts: int
    violators: int

    def least(self, at: Points) -> Array:
        """Find the smallest margin at points (K,); infinite where the function does not exist."""
        return np.where(at.found, self.measure(at.Q).min(axis=1, initial=np.inf), np.inf)

    def slope(self, candidate: CandidateFunction, at: Points) -> Array:
        """Differentiate the smallest margin with respect to u, at points: (K, k)."""
        lowest = self.measure(at.Q).argmin(axis=1)
        return self.slopes(at.Q, candidate.derivative(at))[np.arange(len(lowest)), lowest]

    def slopes(self, Q: Array, D: Array) -> Array:
        """Differentiate the P margins along p joint directions, by differences: (K, P, p).

        The directions at each row of Q (K, n) are the columns of D (K, n, p).
        """
        K, n, p = D.shape
        step = _DIFFERENCE * np.swapaxes(D, 1, 2)
        ends = [
            np.minimum(self.measure((Q[:, None] + w * step).reshape(K * p, n)), _ENDLESS)
            for w in (1.0, -1.0)
        ]
        return np.swapaxes((ends[0] - ends[1]).reshape(K, p, -1), 1, 2) / (2 * _DIFFERENCE)

    def attainable(self, chart: Chart, at: Points, *, far: bool = False) -> Array:
        """Find the largest margin (K,) of any leaf near the points, along each direction of the
        label.

        The leaves lie within 0.7 rad, or with ``far`` within 2.4 rad, which for r = 1 is the extent
        of the self-motion inside the limits. They are tried one after another, then around the best
        of them with smaller steps.
        """
        r, most, best = at.n_ref.shape[2], self.least(at), at.Q
        here = np.einsum("Knr,Kn->Kr", at.n_ref, at.Q - at.q_ref)
        s = here.copy()

        def look(label: Array, Q: Array) -> Array:
            """Keep a label (K, r) where its leaf has a larger margin; return its configurations."""
            nonlocal most, best, s
            points = chart.solve(at.U, label, Q, iterations=4)
            least = np.where(points.found, self.least(points), -np.inf)
            better = least > most
            most = np.where(better, least, most)
            best = np.where(better[:, None], points.Q, best)
            s = np.where(better[:, None], label, s)
            return points.Q

        ways = np.concatenate([np.eye(r), -np.eye(r)])
        for way in ways:
            Q = at.Q
            for i in range(1, (_FAR if far else _NEARBY) + 1):
                Q = look(here + i * _APART * way, Q)
        for i in range(1, _HALVINGS + 1):
            for way in ways:
                look(s + 0.5**i * _APART * way, best)
        return most


def limits_of(limited: Task | Cell, required: float = 0.0) -> Margin:
    """Make the margin of joint limits: the distance of each joint to its nearer limit, rad or m."""
    return Margin(
        "joint limits", limited.limit_margin, required, 0.4, watched=4096, starts=48, violators=96
    )


def distances_of(task: Task, required: float = 0.0) -> Margin:
    """Make the margin of bodies: the minimum distance between their hulls, m."""
    distances = bodies_of(task).hull_distances
    return Margin(
        "bodies",
        lambda Q: distances(Q)[:, None],
        required,
        0.25,
        watched=256,
        starts=4,
        violators=16,
    )


def singular_values_of(task: Task, required: float = 0.0) -> Margin:
    """Make the margin of singularities: σ_min of J."""

    def measure(Q: Array) -> Array:
        return np.asarray(np.linalg.svd(task.jacobians(Q), compute_uv=False)[:, -1:], float)

    return Margin("singularities", measure, required, 0.25, watched=2048, starts=24, violators=96)


def lowest_distances(bodies: Bodies, Q: Array) -> tuple[Array, float]:
    """Compute body distances (K,) at Q (K, n), with an exact minimum, and the share of collisions.

    Where only the hulls overlap, a test of the bodies themselves takes forty times as long. The
    deepest are tested until no other can be deeper, and some more for the share; the others are 0.
    """
    hulls = bodies.hull_distances(Q)
    overlap = np.flatnonzero(hulls < 0)
    overlap = overlap[np.argsort(hulls[overlap])]
    distances, tested = np.maximum(hulls, 0.0), np.unique(np.linspace(0, len(overlap) - 1, _TESTED))
    some = overlap[tested.astype(int)] if len(overlap) else overlap
    distances[some] = bodies.distances(Q[some])
    for start in range(0, len(overlap), _AT_ONCE):
        rows = overlap[start : start + _AT_ONCE]
        if distances.min() <= hulls[rows[0]]:
            break
        distances[rows] = bodies.distances(Q[rows])
    collide = float((distances[some] < 0).mean()) if len(some) else 0.0
    return distances, collide * len(overlap) / max(1, len(Q))


@dataclass(frozen=True, eq=False)
@read_only
class CandidateFunction:
    """A candidate for F: the configurations with label ``s(u) = Σ_t a_t T_t(u)`` of a chart.

    Attributes
    ----------
    chart : Chart
    terms : Monomials
        T.
    a : (N, r) array
    """

    chart: Chart
    terms: Monomials
    a: Array

    @classmethod
    def zero(cls, chart: Chart) -> CandidateFunction:
        """Make the function s = 0."""
        return cls(chart, Monomials(chart.cell.k, 0), np.zeros((1, chart.cell.task.r)))

    def at(self, U: Array, Q: Array | None = None) -> Points:
        """Evaluate the function at U (K, k), from Q (K, n) if given."""
        return self.chart.solve(U, self.terms.values(U) @ self.a, Q)

    def derivative(self, at: Points) -> Array:
        """Differentiate the function with respect to u, at points of its graph: (K, n, k)."""
        slopes = self.terms.slopes(self.terms.values(at.U))
        ds = np.einsum("KNk,Nr->Krk", slopes, self.a)
        return self.chart.derivative(at, ds)[0][:, :, : self.chart.cell.k]


class Minimised(Protocol):
    """A quantity along a candidate function that a search minimises."""

    def least(self, at: Points) -> Array:
        """Evaluate the quantity at points (K,); infinite where the function does not exist."""

    def slope(self, candidate: CandidateFunction, at: Points) -> Array:
        """Differentiate the quantity with respect to u, at points: (K, k)."""


def searched(candidate: CandidateFunction, margin: Minimised, U: Array) -> Array:
    """Descend from poses U (K, k) to smaller margins inside the cell.

    Return all poses visited (L, k), the ends of the descents last. A step goes down the gradient,
    without its components that point out of the cell. Poses at which the function does not exist
    are among those visited.
    """
    here = candidate.at(U)
    here = here.chosen(here.found)
    tried, visited = here, [here.U]

    def trial(rows: NDArray[np.intp], length: Array) -> Array:
        part = here.chosen(rows)
        slope = margin.slope(candidate, part)  # (L, k)
        outward = (np.abs(part.U) >= 1) & (slope * part.U < 0)
        slope = np.where(outward, 0.0, slope)
        way = slope / np.maximum(np.abs(slope).max(axis=1, keepdims=True), 1e-12)
        return np.clip(part.U - length[:, None] * way, -1, 1)

    def evaluate(rows: NDArray[np.intp], U: Array) -> tuple[Array, NDArray[np.bool_]]:
        nonlocal tried
        tried = candidate.at(U, here.Q[rows])
        jump = np.abs(tried.Q - here.Q[rows]).max(axis=1)
        return margin.least(tried), jump < _JUMP

    def accepted(rows: NDArray[np.intp], better: NDArray[np.bool_]) -> None:
        nonlocal here
        here = here.replaced(rows[better], tried.chosen(better))
        visited.append(tried.U[better | ~tried.found])

    U = here.U.copy()
    descend_in_box(U, margin.least(here), trial, evaluate, _LENGTHS, accepted=accepted)
    return np.concatenate([*visited, U])
