"""Branch and bound on the leaf margin: boxes are halved until their bounds suffice.

The leaf margin, from 0 to 1, is the distance from an algorithmic singularity. At such a singularity
the matrix J_V is singular: the task Jacobian J stacked on the gradients V of the potentials. A box
of joint space is decided once the lower bound of the leaf margin on it suffices. Letters: K boxes,
n joints.

``LeafMarginProblem`` is a task with potentials, prepared for bounds of the leaf margin over boxes
of joint space. ``LeafMarginBounds`` are bounds on the leaf margin and on σ_min(J) over K boxes of
joint space.
"""

from __future__ import annotations

from collections.abc import Callable
from time import thread_time

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import Array
from ...base.certificate import Proof
from .boxes import centered, halved
from .leaf_margin_bounds import LeafMarginBounds, LeafMarginProblem

_BATCH = 4096

_NEWEST = 1024
"""Size of a batch with a goal: few, because the search can stop only between two batches."""

_MOST = 4_000_000
"""Maximum number of undecided boxes; the search stops beyond it."""

_TIGHT = 0.95
"""Accuracy of the search without a goal.

A box is halved until its bound is this share of the smallest leaf margin found at a centre.
"""

_SMALLEST = 1e-7
"""Half-width, rad or m, below which an undecided box stops the search."""


def bound_leaf_margin(
    problem: LeafMarginProblem,
    low: Array,
    high: Array,
    goal: float | None,
    seconds: float,
    report: Callable[[str, float], None],
    patience: float = 1.0,
) -> Proof:
    """Prove a lower bound of the leaf margin on a union of boxes of joint space.

    Parameters
    ----------
    problem
        The task and the potentials whose leaf margin is bounded.
    low, high : (K, n) arrays
        Lower and upper corners of the boxes.
    goal
        Leaf margin to prove. The search stops as soon as this margin is proved, or when it finds a
        configuration with a smaller margin. With None, the search is for the largest bound.
    seconds
        Processor time, s, after which the search stops and returns the bound found so far.
    report
        Progress callback (step, fraction); the fraction is the proved share of the volume.
    patience
        Share of ``seconds`` after which the search also stops if it has decided no box yet.

    Returns
    -------
    Proof
        The proof of the leaf margin; its description is empty, and its limit margin is NaN.
    """
    search = _Search(problem, low, high, goal)
    begin, whole = thread_time(), search.volume()
    while len(search.low) and not search.reason:
        spent = thread_time() - begin
        if spent > seconds:
            search.give_up(f"after {seconds:g} s")
        elif spent > patience * seconds and search.decided == np.inf:
            search.give_up(f"after {patience * seconds:g} s, with no box decided")
        elif len(search.low) > _MOST:
            search.give_up(f"at {_MOST} undecided boxes")
        else:
            search.advance()
            report("proving", 1 - min(1.0, search.volume() / whole))
    return search.proof()


class _Search:
    """State of branch and bound: undecided boxes, and the smallest bounds over all decided boxes.

    ``goal`` is the leaf margin to prove; None if the largest bound is sought.

    ``low``, ``high``, ``bound``, ``sigma`` and ``split`` have one row per undecided box: the lower
    corner, the upper corner, the bounds of the leaf margin and of σ_min(J) on the box, and the
    joint along which to halve the box. ``split`` is −1 for boxes that were not evaluated yet.
    ``decided`` and ``settled_sigma`` are the smallest bounds of the two over all decided boxes, and
    ``upper`` is the smallest leaf margin at the centre of any box so far. ``reason`` says why the
    search stopped; it is empty while the search runs. As arguments of methods, Q and half (K, n)
    are the centres and half-widths of K boxes.
    """

    def __init__(
        self, problem: LeafMarginProblem, low: Array, high: Array, goal: float | None
    ) -> None:
        self.problem, self.goal = problem, goal
        self.low, self.high = low.copy(), high.copy()
        self.bound, self.sigma = np.zeros(len(low)), np.zeros(len(low))
        self.split = np.full(len(low), -1, np.int32)  # −1: not evaluated yet
        self.decided = self.settled_sigma = self.upper = np.inf
        self.worst = ((low[0] + high[0]) / 2, (high[0] - low[0]) / 2)
        self.at_least_bound = self.worst
        self.boxes, self.reason = 0, ""
        self.gave_up = False

    def volume(self) -> float:
        """Compute the total volume of the undecided boxes.

        The volume of a box is the product of its n widths, in rad or m.
        """
        return float(np.prod(self.high - self.low, axis=1).sum())

    def advance(self) -> None:
        """Halve one batch of undecided boxes, and bound the leaf margin on the halves.

        With a goal, the newest boxes are halved; without a goal, the boxes with the smallest
        bounds.
        """
        take = self._next()
        low, high, _ = halved(self.low[take], self.high[take], self.split[take])
        Q, half = centered(low, high)
        found = self.problem.bounds(Q, half)
        self.boxes += len(Q)
        enough = self._enough(found, Q, half)
        done = (found.leaf_margin >= enough) & (found.leaf_margin > 0)
        if done.any():
            self._settle(found, done, Q, half)
        stays = np.ones(len(self.low), bool)
        stays[take] = False
        if self.goal is None:
            stays &= self._still_short(enough, stays)
        left = ~done
        self.low = np.concatenate([self.low[stays], low[left]])
        self.high = np.concatenate([self.high[stays], high[left]])
        self.bound = np.concatenate([self.bound[stays], found.leaf_margin[left]])
        self.sigma = np.concatenate([self.sigma[stays], found.sigma_min[left]])
        self.split = np.concatenate([self.split[stays], found.split[left]])
        small = left & (half.max(axis=1) < _SMALLEST)
        if small.any() and not self.reason:
            self._stop(Q, half, int(np.argmax(small)), "a box too small to halve is undecided")

    def _next(self) -> NDArray[np.intp]:
        """Choose the undecided boxes to halve next, at most one batch; return their indices.

        With a goal, the newest boxes are chosen; without one, the boxes whose lower bounds of the
        leaf margin are smallest.
        """
        count = len(self.low)
        if self.goal is not None:
            return np.arange(max(0, count - _NEWEST), count)
        if count <= _BATCH:
            return np.arange(count)
        return np.argpartition(self.bound, _BATCH)[:_BATCH]

    def _enough(self, found: LeafMarginBounds, Q: Array, half: Array) -> float:
        """Return the lower bound of the leaf margin from which a box counts as decided.

        ``found`` are the bounds on the boxes Q ± half, (K, n) each. With a goal, the result is the
        goal. Without a goal, it is 95 % of ``upper``, which no proved bound can exceed. Update
        ``upper``. Stop the search if ``upper`` is below the goal or, without a goal, if ``upper``
        is 0.
        """
        least = int(np.argmin(found.center))
        if found.center[least] < self.upper:
            self.upper = float(found.center[least])
            self.worst = Q[least], half[least]
        if self.goal is None:
            if self.upper <= 0:
                self._stop(Q, half, least, "J_V is singular there")
            return _TIGHT * self.upper
        if self.upper < self.goal:
            self._stop(Q, half, least, f"the leaf margin there is {self.upper:.4g}")
        return self.goal

    def _still_short(self, enough: float, stays: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Find older boxes that have become decided, because ``enough`` has fallen.

        Call this only without a goal: ``enough`` then falls when a smaller leaf margin is found, so
        that the bound of an older box can suffice. Return a mask with one entry per undecided box,
        False where the box is now decided, else True. Record the smallest bounds of the boxes that
        are now decided. ``stays`` is a mask of the same boxes, False where a box was just halved;
        such a box is not tested, and its entry in the result is True.
        """
        ready = stays & (self.split >= 0) & (self.bound >= enough)
        if ready.any():
            least = int(np.argmin(np.where(ready, self.bound, np.inf)))
            if self.bound[least] < self.decided:
                self.decided = float(self.bound[least])
                self.at_least_bound = centered(self.low[least], self.high[least])
            self.settled_sigma = min(self.settled_sigma, float(self.sigma[ready].min()))
        return np.asarray(~ready)

    def _settle(
        self, found: LeafMarginBounds, done: NDArray[np.bool_], Q: Array, half: Array
    ) -> None:
        """Update the smallest bounds over all decided boxes with those of newly decided boxes.

        Also record the box with the smallest bound of the leaf margin. ``found`` are the bounds on
        the boxes Q ± half, (K, n) each; ``done`` (K,) is True for decided boxes, at least one.
        """
        (rows,) = np.nonzero(done)
        least = rows[np.argmin(found.leaf_margin[rows])]
        if found.leaf_margin[least] < self.decided:
            self.decided = float(found.leaf_margin[least])
            self.at_least_bound = Q[least], half[least]
        self.settled_sigma = min(self.settled_sigma, float(found.sigma_min[rows].min()))

    def _stop(self, Q: Array, half: Array, at: int, why: str) -> None:
        """Stop the search for the reason ``why`` at the box in row ``at`` of Q ± half, (K, n) each.

        If an arm angle is not defined at the centre of the box, this is stored as the reason
        instead of ``why``.
        """
        if self.problem.undefined(Q[at, None], 0 * half[at, None])[0]:
            why = "the arm angle is not defined there"
        self.reason, self.worst = why, (Q[at], half[at])

    def give_up(self, when: str) -> None:
        """Stop a search that takes too long, or too much memory, with boxes still undecided.

        ``when`` completes the reason "stopped …", such as "after 60 s".
        """
        self.reason, self.gave_up = f"stopped {when}", True

    def proof(self) -> Proof:
        """Return the proof with the smallest bounds over all boxes, decided or not.

        If the search stopped early, the proof has the reason. The box ``worst`` ± ``half`` of the
        proof is the box that misses the goal or cannot be halved; if there is no such box, the box
        with the smallest bound.
        """
        bound, sigma = self.decided, self.settled_sigma
        worst = self.at_least_bound
        if len(self.low):
            least = int(np.argmin(self.bound))
            Q, half = centered(self.low[least, None], self.high[least, None])
            refuted = self.reason and not self.gave_up
            worst = self.worst if refuted else (Q[0], half[0])
            bound = min(bound, float(self.bound[least]))
            sigma = min(sigma, float(self.sigma.min()))
            if self.gave_up:
                worst = self._with_arm_angle(worst)
        proved = bound > 0 and (self.goal is None or (bound >= self.goal and not self.reason))
        return Proof("", proved, bound, np.nan, sigma, self.boxes, *worst, self.reason, self.goal)

    def _with_arm_angle(self, worst: tuple[Array, Array]) -> tuple[Array, Array]:
        """Choose the box that the proof names, ``worst`` or one with an undefined arm angle.

        Only the undecided box of smallest volume is tested. If an arm angle may be undefined in it,
        add this to ``reason`` and return this box; else return ``worst``. A box is its centre and
        half-widths, (n,) each.
        """
        small = int(np.argmin(np.prod(self.high - self.low, axis=1)))
        Q, half = centered(self.low[small, None], self.high[small, None])
        if not self.problem.undefined(Q, half)[0]:
            return worst
        self.reason += "; the arm angle may be singular near the worst box"
        return Q[0], half[0]
