r"""Closing radius: within it, closed paths of any length end in the configuration they began in.

A lift is the joint path that the repeatable inverse G_r gives to a line of the end effector. Lifts
of straight lines are followed in boxes of joints ``S_1 ⊂ S_2 ⊂ … ⊂ S_M ⊂ Ω`` around their start,
where Ω is the region of joint space of the design. The boxes have half-widths ``w_1 < w_2 < …``.
While such a lift is in S_k, joint i moves by at most

.. math::

   T_{ki} = \max_{S_k} \sum_f \left(‖g_{i,v_f}‖ + \frac{α}{ρ} ‖g_{i,ω_f}‖\right) \text{ per metre},
   \qquad g_i \text{ row i of } G_r.

v_f and ω_f are the linear and angular columns of frame f, and α/ρ is the rotation per metre of the
line, rad/m. All frames move along lines of their own, in the same time. Branch and bound proves the
rates T_k. From the rates follows the length ρ of lines whose lifts cannot leave S_M. The theory,
"The closing radius", has the theorem.

A place is the box of configurations in which a lift begins. Its clearance is how far each joint can
then move within Ω. There are K places, n joints, and M boxes S_k around each place. The rate of a
joint is its motion per metre of a line, rad or m per m. J_V is the task Jacobian stacked on the
potentials' gradients; G_r exists where J_V is regular. An argument ``field`` has the potentials,
``problem`` has bounds on J_V over boxes of joints, and ``ratio`` is α/ρ, 0 for lines without
rotation.

``Potentials`` are r functions h(q) that a repeatable controller holds constant.
``LeafMarginProblem`` is a task with potentials, prepared for bounds of the leaf margin over boxes
of joint space. ``Reach`` is the length of lines whose lifts are proved to stay near every place,
and what limits it. ``Places`` are K boxes of joint space in which lifts begin: centres, half-widths
and clearances.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import thread_time

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import Array, read_only
from ...base.errors import SingularityError
from ...model.task import Task
from ...potentials.basis import Potentials
from .boxes import halved
from .chain import frames_of
from .leaf_margin_bounds import LeafMarginProblem

_BATCH = 4096

_STEPS = 12
"""Number of boxes S, if the rates in all of them were those at the start."""

_MOST_STEPS = 4 * _STEPS

_SLACK = 0.03, 0.15
"""Proved rates relative to their largest samples, less 1: in the first box, and in the last one."""

_FREE = 0.97
"""Rates of joints that do not limit the radius, as a share of what would make them limit it."""

_SAMPLES = 256
"""Number of samples of the rates in a box S, and at least 8 for each of many places."""

_SINGULAR = 1e8
"""Rates, rad or m per m, beyond which J_V counts as singular."""

_WIDEST = 3.1
"""Maximum angle, rad, of a closing radius: a rotation by less than π has one axis."""


@dataclass(frozen=True, eq=False)
@read_only
class Places:
    """K places: boxes in which lifts begin. They enclose a start, or the joint path of a cycle.

    Attributes
    ----------
    center, extent : (K, n) arrays
        Centres and half-widths of the boxes, rad or m.
    clearance : (K, n) array
        How far each joint can move within Ω from any configuration in the box, rad or m.
    """

    center: Array
    extent: Array
    clearance: Array


@dataclass(frozen=True, eq=False)
@read_only
class Reach:
    """Length of lines whose lifts are proved to stay in the clearance of every place.

    The smallest length over all places is the closing radius.

    Attributes
    ----------
    radius : float
        The closing radius, m.
    boxes : int
        Number of boxes evaluated.
    place, joint : int
        Index of the place with the smallest length, and of the joint that may leave the clearance
        of that place on a longer line.
    complete : bool
        False if the search ended before all boxes were decided.
    regular : bool
        False if J_V is not proved to be regular in all boxes S_k around the place with the index
        ``place``.
    """

    radius: float
    boxes: int
    place: int
    joint: int
    complete: bool
    regular: bool


def bound_reach(
    problem: LeafMarginProblem,
    task: Task,
    field: Potentials,
    places: Places,
    ratio: float,
    goal: float | None,
    seconds: float,
    most: float,
) -> Reach:
    """Find a length up to which the lift of every straight line stays in its place's clearance.

    Parameters
    ----------
    problem, task, field
        Bounds on J_V, the task, and the potentials of the design.
    places
        Places with their clearance.
    ratio
        Rotation, rad, per metre of the lines.
    goal
        Length, m, at which the search may stop; None for the largest length.
    seconds, most
        Processor time, s, and number of boxes after which the search stops; undecided boxes then
        count with their last bounds.
    """
    search = _Search(problem, task, field, places, ratio, goal)
    end = thread_time() + seconds
    while len(search.low) and thread_time() < end and search.boxes < most:
        search.advance()
        if goal is not None and search.reach().radius >= goal:
            break
    return search.reach()


class _Search:
    """Branch and bound on the rates of the joints, in the boxes S_1 ⊂ … ⊂ S_M around each place.

    ``widths`` (K, M, n) are the half-widths of the boxes S_k around K places, without the place's
    own half-widths; ``rates`` (K, M, n) are the rates to prove in them.

    An undecided box is a whole S_k, or a part of it. S_k includes S_(k−1): small S_k are mostly
    decided as a whole, so to leave out S_(k−1) would save no boxes. Other arrays have one row per
    undecided box: ``low`` and ``high`` are its corners relative to the place's centre, ``place`` is
    the index of its place, and ``within`` is the number k − 1 of its S_k. ``bound`` has the bounds
    of its rates, and ``split`` the joint along which to halve it.
    """

    def __init__(
        self,
        problem: LeafMarginProblem,
        task: Task,
        field: Potentials,
        places: Places,
        ratio: float,
        goal: float | None,
    ) -> None:
        self.problem, self.places, self.ratio = problem, places, ratio
        turns = [part.kind.turns for part in frames_of(task)]
        self.ratios = ratio * np.array(turns, float)
        slack = _SLACK
        if goal is not None:
            slack = _largest_slack(task, field, places, ratio, goal)
            goal = None if slack is _SLACK else goal  # the largest radius may be larger
        self.widths, self.rates, _ = _sampled(task, field, places, ratio, goal, slack)
        K, M, n = self.widths.shape
        half = self.widths + self.places.extent[:, None] * (1 + 1e-12)
        self.low, self.high = -half.reshape(K * M, n), half.reshape(K * M, n)
        self.place, self.within = np.divmod(np.arange(K * M), M)
        self.split = np.full(len(self.low), -1, np.int32)  # −1: not evaluated yet
        self.bound = np.full(self.low.shape, np.inf)
        self.boxes = 0

    def advance(self) -> None:
        """Halve one batch of undecided boxes, and bound the rates of the joints on the halves.

        Boxes with the smallest k come first.
        """
        take = np.arange(len(self.low))
        if len(take) > _BATCH:
            take = np.argpartition(self.within, _BATCH)[:_BATCH]
        low, high, place, within = self._halved(take)
        Q = self.places.center[place] + (low + high) / 2
        half = (high - low) / 2 * (1 + 1e-12) + 1e-15 * (1 + np.abs(Q))
        bound, value, split = rate_bounds(
            self.problem, Q, half, self.rates[place, within], self.ratios
        )
        self.boxes += len(Q)
        self._raise(place, within, value)
        stays = np.ones(len(self.low), bool)
        stays[take] = False
        parts = (
            (self.low, low),
            (self.high, high),
            (self.place, place),
            (self.within, within),
            (self.bound, bound),
            (self.split, split),
        )
        joined = [np.concatenate([old[stays], new]) for old, new in parts]
        undecided = ~(joined[4] <= self.rates[joined[2], joined[3]]).all(axis=1)
        self.low, self.high, self.place, self.within, self.bound, self.split = (
            values[undecided] for values in joined
        )

    def _halved(
        self, take: NDArray[np.intp]
    ) -> tuple[Array, Array, NDArray[np.intp], NDArray[np.intp]]:
        """Halve the undecided boxes with the indices ``take``, each along one joint.

        Return the lower and upper corners of the L halves, (L, n) each, the index (L,) of the place
        of each half, and the number k − 1 (L,) of its S_k.
        """
        low, high, parents = halved(self.low[take], self.high[take], self.split[take])
        order = take[parents]
        return low, high, self.place[order], self.within[order]

    def _raise(self, place: NDArray[np.intp], within: NDArray[np.intp], value: Array) -> None:
        """Raise the rates to prove, ``rates``, to above the rates at the centres of boxes.

        A lower rate could not be proved. The new one is slightly larger than the rate at the
        centre, because a bound over the box is larger, too. The rates to prove of larger S_k around
        the same place are raised as well. ``value`` (L, n) are the rates at the centres of L boxes.
        ``place`` (L,) are the indices of their places, ``within`` (L,) the numbers k − 1 of their
        S_k.
        """
        over = np.flatnonzero((value > self.rates[place, within]).any(axis=1))
        for b in over:
            rates = self.rates[place[b], within[b] :]
            high = value[b] * (1 + _SLACK[0])
            np.copyto(rates, np.maximum(rates, np.where(value[b] > rates, high, 0)))

    def reach(self) -> Reach:
        """Compute the :class:`Reach` that follows from the rates proved so far.

        Its length holds for lines from every place: a line is extended through S_1 ⊂ S_2 ⊂ … until
        a joint may leave the last box, or the frame rotates by nearly π. Undecided boxes count with
        their last bounds, so the length is valid at any time of the search.
        """
        rates = self.rates.copy()
        bound = np.where(np.isnan(self.bound), np.inf, self.bound)
        np.maximum.at(rates, (self.place, self.within), bound)
        rates = np.maximum.accumulate(rates, axis=1)
        moved = np.zeros_like(self.places.center)
        length, last = np.zeros(len(moved)), np.zeros(len(moved), int)
        for k in range(rates.shape[1]):
            left = np.maximum(0.0, self.widths[:, k] - moved) / rates[:, k]
            step = left.min(axis=1)
            last = np.where(step > 0, left.argmin(axis=1), last)
            finite = np.where(np.isfinite(rates[:, k]), rates[:, k], 0.0)
            moved = np.minimum(moved + step[:, None] * finite, self.widths[:, k])
            length += step
        worst = int(np.argmin(length))
        radius = float(length[worst])
        if self.ratio:
            radius = min(radius, _WIDEST / self.ratio)
        return Reach(
            radius * (1 - 1e-9),
            self.boxes,
            worst,
            int(last[worst]),
            not len(self.low),
            bool(np.isfinite(rates[worst]).all()),
        )


def _largest_slack(
    task: Task, field: Potentials, places: Places, ratio: float, goal: float
) -> tuple[float, float]:
    """Choose the shares by which the rates to prove may exceed sampled rates, for a goal.

    ``goal`` is the length of the lines, m. A share of 0.1 means rates 10 % above the sampled ones.
    With larger shares the proof needs fewer boxes, but the boxes S_k are wider, and the rates in
    them are larger. Return the shares for the first and the last S_k around a place: the defaults,
    or larger ones if the goal allows them.
    """
    best = _sampled(task, field, places, ratio, None, (0.0, 0.0))[2]
    slack = 0.95 * best / goal - 1
    while slack > _SLACK[0]:
        if _sampled(task, field, places, ratio, goal, (slack, slack))[2] >= goal:
            return slack, slack
        slack = 0.8 * (1 + slack) - 1
    return _SLACK


def _sampled(
    task: Task,
    field: Potentials,
    places: Places,
    ratio: float,
    goal: float | None,
    slacks: tuple[float, float],
) -> tuple[Array, Array, float]:
    """Choose half-widths of boxes S_k around K places, and rates to prove in them: (K, M, n) each.

    S_k exceeds S_(k−1) by the motion of the joints on a step of the line. The rates of this motion
    are the largest rates sampled in S_k, times 1 plus a share; from S_1 to S_M the share goes from
    ``slacks[0]`` to ``slacks[1]``. Each rate is at least 97 % of the rate that would use up the
    joint's clearance on the longest line. ``goal`` is a length, m, or None for the largest
    length.

    Return the half-widths, the rates, and the length of the lines, m, which is the same for all
    places. A SingularityError is raised if J_V is singular at the start, or if a place has no
    clearance.
    """
    K, n = places.center.shape
    signs = np.sign(np.random.default_rng(0).uniform(-1, 1, (max(8, _SAMPLES // K), n)))

    def largest(Q: Array) -> Array:
        """Evaluate the largest rates (K, n) of the joints over Q (K, s, n), s rows per place."""
        return _rates(task, field, Q, ratio).max(axis=1)

    # rates at the start give the length of a step
    rates = _rates_at_start(largest(places.center[:, None]))
    whole = float((places.clearance / rates).min())
    free = _FREE * places.clearance / whole  # whatever the goal, or Ω would be filled
    step = (whole if goal is None else min(whole, goal)) / _STEPS
    # box around box, each a step larger, until the clearance is used
    width, length = np.zeros((K, n)), 0.0
    boxes: list[tuple[Array, Array]] = []
    while len(boxes) < _MOST_STEPS:
        slack = 1 + np.interp(length, [0, 0.7 * _STEPS * step], slacks)
        for _ in range(2):
            wide = width + step * np.maximum(slack * rates, free) + places.extent
            rates = np.maximum(rates, largest(places.center[:, None] + signs * wide[:, None]))
        T = np.maximum(slack * rates, free)
        part = float(((places.clearance - width) / (step * T)).min())
        if goal is not None:
            part = min(part, (goal * (1 + 1e-6) - length) / step)
        if not (part > 1e-9 and np.isfinite(T).all()):
            break
        width = width + min(1.0, part) * step * T
        length += min(1.0, part) * step
        boxes.append((width, T))
        if part <= 1:
            break
    if not boxes:
        raise SingularityError(
            "the start is too near the boundary of Ω; choose one farther inside, or a larger Ω"
        )
    widths, allowed = zip(*boxes, strict=True)
    return np.stack(widths, axis=1), np.stack(allowed, axis=1), length


def _rates_at_start(rates: Array) -> Array:
    """Raise rates (K, n) to at least 1e-9 of the largest rate of their place.

    So the caller can divide by the rates; a joint that does not move has the rate 0. A
    SingularityError is raised if a rate is above 1e8 or NaN, because J_V is singular there.
    """
    if not rates.max() < _SINGULAR:
        raise SingularityError("J_V is singular at the start")
    return np.maximum(rates, 1e-9 * rates.max(axis=1)[:, None])


def rate_bounds(
    problem: LeafMarginProblem, Q: Array, half: Array, most: Array, ratio: float | Array
) -> tuple[Array, Array, NDArray[np.int32]]:
    """Bound the rates of the joints, rad or m per metre of a line, on boxes Q ± half, (K, n) each.

    The rate of a joint is ``‖g_v‖ + ratio ‖g_ω‖``, summed over the frames. g_v and g_ω are the
    joint's row of the repeatable inverse G_r in the linear and in the angular columns. ``ratio`` is
    the rotation per metre of the line, rad per m, one number or one per frame.

    Return the bounds (K, n), the rates at the centres (K, n), and the index (K,) of the joint along
    which to halve each box. This joint is chosen so that few halvings bring the bounds below
    ``most`` (K, n).
    """
    bound, value = np.zeros((2, *Q.shape))
    split = np.zeros(len(Q), np.int32)
    most = np.ascontiguousarray(most, float)
    ratios = np.full(len(problem.chains), ratio, float)
    problem.run("inverse_bounds", Q, half, most, ratios, bound, value, split)
    return bound, value, split


@np.errstate(all="ignore")
def _rates(task: Task, field: Potentials, Q: Array, ratio: float) -> Array:
    """Evaluate the rate of each joint, rad or m per metre of a line, at Q (K, s, n): (K, s, n).

    There are s configurations per place. The rates are inf where the repeatable inverse does not
    exist.
    """
    points = Q.reshape(-1, Q.shape[2])
    J, V = task.jacobians(points), field.gradients(points)
    G = inverses(np.concatenate([J, np.swapaxes(V, 1, 2)], axis=1))
    rates, row = np.zeros(points.shape), 0
    for part in frames_of(task):
        g = G[:, :, row : row + part.m]
        row += part.m
        rates += np.linalg.norm(g[:, :, part.kind.linear], axis=2)
        if ratio and part.kind.turns:
            rates += ratio * np.linalg.norm(g[:, :, ~part.kind.linear], axis=2)
    return np.nan_to_num(rates, nan=np.inf).reshape(Q.shape)


def inverses(matrices: Array) -> Array:
    """Invert K matrices (K, N, N), such as J_V; the inverse of a singular matrix is NaN."""
    try:
        return np.asarray(np.linalg.inv(matrices), float)
    except np.linalg.LinAlgError:
        regular = np.isfinite(matrices).all(axis=(1, 2)) & (
            np.linalg.svd(matrices, compute_uv=False)[:, -1] > 1e-14
        )
        inverses = np.full_like(matrices, np.nan)
        inverses[regular] = np.linalg.inv(matrices[regular])
        return inverses
