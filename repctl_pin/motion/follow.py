"""Integration of a strategy along a closed path over several cycles.

A strategy gives joint velocities q̇ from the configuration q and the task velocity ẋ. The path
parameter s runs from 0 to 1 in each cycle. A cycle is divided into steps; at each corner of the
path, one step ends and the next begins. A repeatable strategy keeps its potentials h constant, and
so the arm on a leaf, the set h(q) = c of the level c. A leaf lock replaces the integration by
Newton steps, which correct pose and level at each point of the path; their damping λ limits joint
speeds near singularities. J⁺ is the pseudoinverse, the usual strategy. A twist is the velocity (v,
ω) of a frame, in base axes. T = cycles · steps is the number of all steps of a motion.

``ClosedPath`` is a closed path as a function of s, which goes from 0 to 1 in a cycle. ``_Method``
is an integration method: the functions that take its steps. ``Strategy`` is a controller: a map (q,
ẋ) → q̇.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..base.arguments import Array, as_int, function, positive, require_choice, vector
from ..base.defaults import CYCLES, PERIOD, STEPS
from ..base.errors import InputError, SingularityError
from ..model.chain_formulas import Placement
from ..model.length import joint_scale
from ..model.task import Task, require_task
from ..paths.task_path import ClosedPath, TaskPath, closed_path
from ..strategies import RepeatableInverse, Strategy
from .compiled_steps import Steps, compiled_steps
from .leaf_lock import Advance, LeafLock, locked_steps
from .motion import CLOSED, Motion, motion_along

# Butcher tableaux: nodes c and weights b. Each stage uses the slope of the one before, times c.
_INTEGRATORS: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "euler": ((0.0,), (1.0,)),
    "rk4": ((0.0, 0.5, 0.5, 1.0), (1 / 6, 1 / 3, 1 / 3, 1 / 6)),
}

_INSIDE = 1e-12
"""Distance from a grid point, in cycles, at which its twist is evaluated, so that at a corner it is
the twist on the step's side."""

_JUMP = 1.0
"""Joint motion per step from which the integration counts as failed, rad; for prismatic joints in
lengths of the arm or of the path, whichever is larger."""

_RESOLVED = 0.01
"""Distance between two runs, one with twice the steps, up to which a drift is resolved, as a share
of the drift."""

UNRESOLVED = "passes close to a singularity; its drift cannot be computed reliably"
"""Beginning of the text on a motion whose drift depends on the number of steps."""

_MOST = 100_000_000
"""Maximum number of joint positions of a motion: 0.8 GB, and as much for velocities."""


@dataclass(frozen=True)
class _Method:
    """Integration method of :func:`follow`: the functions that take its steps.

    Attributes
    ----------
    advance : function (step of the cycle, q) → (next q, q̇ at the start of the step, damping λ)
        Takes one step in Python. With a leaf lock, q̇ is not that at the start, but the mean over
        the step.
    at_end : function q → q̇, optional
        Velocity q̇ at the end of the motion; by default, the q̇ of the last step is used.
    compiled : function (most (n,)) → Steps or None
        Creates the function that takes steps in C; returns None if C does not support the strategy.
        The created function (step, end, Q, Qdot) → int takes the steps from ``step`` to ``end``
        − 1, writes q and q̇ to the rows of Q and Qdot, and returns the first step that was not
        taken. It stops before a step in which a joint moves by more than ``most``, rad or m.
    """

    advance: Advance
    at_end: Callable[[Array], Array] | None = None
    compiled: Callable[[Array], Steps | None] = lambda most: None


def follow(
    strategy: Strategy | Callable[[Array, Array], ArrayLike],
    path: TaskPath | ClosedPath,
    q0: ArrayLike,
    *,
    cycles: int = CYCLES,
    steps: int = STEPS,
    period: float | None = None,
    integrator: Literal["rk4", "euler"] | LeafLock = "rk4",
    feedback: float = 0.0,
    task: Task | None = None,
) -> Motion:
    """Integrate ``q̇ = strategy(q, ẋ)`` along a closed path, cycle after cycle.

    With feedback, ``ẋ = ẋ_path + K e`` with e the task error. With a :class:`LeafLock`, Newton
    steps from point to point of the path replace the integration. These steps remove the task
    error, and the difference of a repeatable strategy's potentials h(q) from the level c.

    Parameters
    ----------
    strategy
        Controller (q, ẋ) → q̇, with ẋ (m,) in m/s and rad/s and q̇ (n,) in rad/s; a plain function
        requires ``task=``.
    path
        Closed path that starts at the frame's placement at q0.
    q0 : (n,) array
        Start configuration, rad (m for prismatic joints), within the joint limits.
    cycles, steps
        Number of cycles, and of integration steps per cycle. If the path has corners, the
        number of steps taken can differ from ``steps`` by a few.
    period
        Period, s; by default the path's, else 5.
    integrator
        Runge–Kutta method, ``"rk4"`` or ``"euler"``; or a :class:`LeafLock`.
    feedback
        Gain K, 1/s; 0 is open loop. With Euler, K = steps / period corrects the whole error in one
        step.
    task
        Task that a plain function controls.

    Returns
    -------
    Motion
        Joint positions ``q`` and velocities ``qdot`` at the times ``t``, and their evaluation:
        ``drift`` after each cycle, ``tracking_error`` and ``turning_error`` of the frame, ``speed``
        (``rms_speed``, ``peak_speed``), ``limit_margin`` and ``first_violation``. ``retimed()``
        slows the motion down to the speed limits.

    Raises
    ------
    InputError
        If an option is out of its range, or the path does not start at the frame and there is
        neither feedback nor a leaf lock.
    SingularityError
        If the motion reaches a singularity; the message names the cycle.

    Examples
    --------
    >>> drifting = rp.follow(control, path, q0, cycles=3, steps=100)
    >>> drifting.drift.round(4)  # rad, after each cycle
    array([0.0027, 0.0053, 0.008 ])
    >>> bool(rp.follow(design.inverse, path, q0, cycles=3, steps=100).drift[-1] < 1e-7)
    True
    """
    if task is not None:
        require_task(task)
    path = closed_path(path)
    if not isinstance(strategy, Strategy):
        what = "a controller, such as design.inverse, or a function (q, xdot) -> qdot"
        function(strategy, "strategy", what, 2)
        if task is None:
            raise InputError(
                "a plain function (q, ẋ) → q̇ requires task=, the task that it controls"
            )
        from ..strategies.custom import FunctionStrategy

        strategy = FunctionStrategy(task, strategy)
    task = strategy.task
    q = task.check(q0, "the start")
    if not isinstance(integrator, LeafLock):
        require_choice(integrator, _INTEGRATORS, "integrator")
    period = positive((path.period or PERIOD) if period is None else period, "the period", "s")
    return followed(
        strategy,
        path,
        q,
        cycles=as_int(cycles, "cycles", 1),
        steps=as_int(steps, "steps", 1),
        period=period,
        integrator=integrator,
        feedback=positive(feedback, "the feedback gain", zero=True),
    )


def followed(
    strategy: Strategy,
    path: TaskPath,
    q0: Array,
    *,
    cycles: int,
    steps: int = STEPS,
    period: float | None = None,
    integrator: str | LeafLock = "rk4",
    feedback: float = 0.0,
) -> Motion:
    """Follow a path from q0 (n,): integrate the joint velocities, for a number of cycles.

    Each cycle has ``steps`` steps, and the duration ``period``, s, by default that of the path.
    ``integrator`` is ``"euler"``, ``"rk4"`` (Runge–Kutta), or a :class:`LeafLock`, which corrects
    the pose and the level at each step in place of integration. ``feedback`` is the gain of the
    task error, 1/s. The caller has checked the arguments. Only the pose at q0 is checked here:
    InputError is raised if it is not the start of the path and there is neither feedback nor a leaf
    lock.
    """
    task = strategy.task
    period = period or path.period or PERIOD
    check_length(task, cycles, steps)
    gap = float(np.linalg.norm(task.error(q0, path.placement(0.0))))
    if gap > 1e-3 and not feedback and not isinstance(integrator, LeafLock):
        raise InputError(
            f"the path starts {gap:.3g} (m and rad) away from the frame; start at "
            "rp.solve_ik(task, q0, path.placement(0.0)), or give a gain feedback= above 0"
        )
    grid = path_grid(path, steps)
    targets = placements_along(path, steps)
    if isinstance(integrator, LeafLock):
        method = _locked(strategy, targets, grid, q0, period, integrator, feedback)
    else:
        method = _integrated(strategy, path, steps, period, integrator, feedback)
    size = _size([target.translation for target in targets])
    Q, Qdot, used = _run(method, task, path, (cycles, len(grid) - 1), size, q0)

    t = np.concatenate([(np.arange(cycles)[:, None] + grid[:-1]).ravel(), [float(cycles)]]) * period
    return motion_along(path, task, t, Q, Qdot, targets, damping=used)


def _locked(
    strategy: Strategy,
    targets: Sequence[Placement],
    grid: Array,
    q0: Array,
    period: float,
    lock: LeafLock,
    feedback: float,
) -> _Method:
    """Create the method of :func:`follow` with a leaf lock, ``lock``, for a motion from q0 (n,).

    ``grid`` are the values of s at which the steps of a cycle begin and end, one more than steps.
    ``targets`` are the placements on the path at these values, and ``period`` is in s. InputError
    is raised if the strategy is not repeatable, or ``feedback`` is not 0.
    """
    if feedback:
        raise InputError(
            "feedback= and a leaf lock are mutually exclusive: "
            "the leaf lock corrects the task error itself; "
            "omit feedback="
        )
    if not isinstance(strategy, RepeatableInverse):
        raise InputError(
            "integrator=LeafLock() requires a repeatable inverse, such as design.inverse"
        )
    return _Method(locked_steps(strategy, targets, grid, q0, period, lock))


def unresolved(strategy: Strategy, motion: Motion) -> str:
    """Return a text that names the first cycle whose drift is not resolved; empty if all are.

    A study shows the text instead of a drift. The motion, which must be without feedback, is
    integrated again with twice the steps per cycle. The drift of a cycle is resolved if both runs
    reach its end and differ there by at most 1 % of the drift, or by at most 1e-5 rad or m. Near a
    singularity, where J⁺ grows without bound, neither number of steps is enough.
    """
    path = motion.path
    task = strategy.task
    steps = motion.steps
    period = float(motion.t[-1] - motion.t[0]) / motion.cycles
    q = motion.q[0]
    method = _integrated(strategy, path, 2 * steps, period, "rk4", 0.0)
    fine = len(path_grid(path, 2 * steps)) - 1
    size = _size(path.points())
    for k, coarse in enumerate(motion.q[steps::steps]):
        outcome = "one of the two motions stops in"
        try:
            q = _run(method, task, path, (1, fine), size, q)[0][-1]
            gap = float(np.linalg.norm(q - coarse))
            if gap <= max(_RESOLVED * motion.drift[k], CLOSED):
                continue
            outcome = f"the two motions are {gap:.2g} {task.unit} apart after"
        except SingularityError:
            pass
        runs = f"with {steps:,} and {fine:,} steps per cycle, {outcome} cycle {k + 1}"
        return f"{UNRESOLVED} ({runs})"
    return ""


def check_length(task: Task, cycles: int, steps: int) -> None:
    """Raise InputError if a motion does not fit into memory: too many cycles or steps per cycle."""
    if cycles * steps * task.n > _MOST:
        raise InputError(
            f"{cycles} cycles of {steps} steps do not fit into memory; use fewer cycles or steps"
        )


def _size(points: ArrayLike) -> float:
    """Compute the size of a path, m: the diagonal of the box around its points (P, 3)."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def _run(
    method: _Method, task: Task, path: TaskPath, counts: tuple[int, int], size: float, q: Array
) -> tuple[Array, Array, float]:
    """Take all T steps from q (n,); return q and q̇, (T + 1, n) each, and the maximum damping λ.

    ``counts`` are (number of cycles, steps per cycle), whose product is T, and ``size`` is the
    path's size, m. SingularityError is raised if a revolute joint moves by more than 1 rad in one
    step, or a prismatic joint by more than the larger of the arm's length and the path's size. The
    message names the cycle.
    """
    (cycles, n_steps), used = counts, 0.0
    # largest credible motion of a joint in one step
    most_step = _JUMP * np.where(task.revolute, 1.0, np.maximum(joint_scale(task, q), size))  # (n,)
    surely = float(most_step.min()) ** 2
    advance = method.advance
    in_c = method.compiled(most_step)
    Q = np.empty((cycles * n_steps + 1, task.n))
    Qdot = np.empty_like(Q)
    Q[0] = q
    step, end = 0, cycles * n_steps
    # compiled steps as far as they go, then one step at a time
    with np.errstate(over="ignore", invalid="ignore"):
        while True:
            if in_c is not None:
                step = in_c(step, end, Q, Qdot)
                q = Q[step]
            if step == end:
                break
            try:
                following, Qdot[step], damping = advance(step % n_steps, q)
            except SingularityError as error:
                raise SingularityError(
                    f"{error}, in cycle {1 + step // n_steps} of {path.name}"
                ) from None
            # a jump makes the result meaningless
            moved = following - q
            square = sum(x * x for x in moved.tolist())  # an overflow gives inf, without a warning
            if not (square < surely or (np.abs(moved) < most_step).all()):
                raise SingularityError(
                    f"a joint moves by more than {_JUMP:g} rad (prismatic: the larger of the arm's "
                    f"length and the path's size) in one step in cycle {1 + step // n_steps} of "
                    f"{path.name}: the arm is near a singularity, the path is out of reach, or "
                    "there are too few steps; use more steps, another start or a smaller path"
                )
            Q[step + 1] = q = following
            used = max(used, damping)
            step += 1
    Qdot[-1] = Qdot[-2] if method.at_end is None else method.at_end(q)
    return Q, Qdot, used


def _integrated(
    strategy: Strategy, path: TaskPath, steps: int, period: float, integrator: str, feedback: float
) -> _Method:
    """Create the method of :func:`follow` with a Runge–Kutta method of fixed steps.

    ``steps`` is the number of steps per cycle, ``period`` the duration of a cycle, s,
    ``integrator`` is ``"euler"`` or ``"rk4"``, and ``feedback`` the gain K of the task error, 1/s.
    The twists of the path are evaluated here, once for all cycles.
    """
    task = strategy.task
    nodes, weights = _INTEGRATORS[integrator]
    grid = path_grid(path, steps)
    ends = [(float(a), float(b)) for a, b in pairwise(grid)]

    # A path's twists are the same in every cycle, so they are evaluated once. So is ẋ, except for
    # an axis task, where it depends on the frame's orientation.
    places = sorted(set(nodes))
    sampled = _kept(_twists, path)(path, steps, tuple(places)) / period
    turning = task.kind.tool_axes
    sampled = sampled if turning else sampled[..., task.rows]
    twists = [list(row) for row in sampled]
    stages = [(i, places.index(c), c) for i, c in enumerate(nodes)]
    b_T = np.array(weights)
    slopes = np.empty((len(nodes), task.n))
    velocity = _velocity(strategy, path, feedback)

    def advance(k: int, q: Array) -> tuple[Array, Array, float]:
        (s, s_end), here = ends[k], twists[k]
        h = (s_end - s) * period
        stage = q
        for i, place, c in stages:
            if i:
                stage = q + (h * c) * slopes[i - 1]
            slopes[i] = velocity(stage, here[place], s + c * (s_end - s))
        return q + h * b_T.dot(slopes), slopes[0], 0.0

    def at_end(q: Array) -> Array:
        last = path.twist(1.0 - _INSIDE) / period
        return velocity(q, last if turning else task.task_velocity(q, last), 1.0)

    def compiled(most: Array) -> Steps | None:
        if turning or feedback:
            return None
        xdot = sampled[:, [place for _, place, _ in stages]]
        return compiled_steps(
            strategy, _INTEGRATORS[integrator], xdot, np.diff(grid) * period, most
        )

    return _Method(advance, at_end, compiled)


def _velocity(
    strategy: Strategy, path: TaskPath, feedback: float
) -> Callable[[Array, Array, float], Array]:
    """Create the function (q, velocity of the path, s) → q̇.

    The velocity of the path is ẋ (m,). For an axis task, whose ẋ depends on q, it is the twist (v,
    ω). ``feedback`` is the gain of the task error, 1/s; the error is that from the pose at q to the
    path at s.
    """
    task, own = strategy.task, strategy.velocity
    turning = task.kind.tool_axes
    if not (turning or feedback):
        return lambda q, xdot, s: own(q, xdot)

    def velocity(q: Array, twist: Array, s: float) -> Array:
        xdot = task.task_velocity(q, twist) if turning else twist
        if feedback:
            xdot = xdot + feedback * task.error(q, path.placement(s))
        return own(q, xdot)

    return velocity


def _kept(sample: Callable[..., Any], path: TaskPath) -> Callable[..., Any]:
    """Return ``sample`` with its cache, or without the cache if the path can change.

    ``sample`` is a function whose first argument is the path, with an ``lru_cache``. A path that
    has a ``spec``, the text of the option ``--path``, cannot change. A path that the user defines
    by functions can change between two calls.
    """
    return sample if path.spec else sample.__wrapped__  # type: ignore[attr-defined]


@lru_cache(maxsize=4)
def _twists(path: TaskPath, steps: int, places: tuple[float, ...]) -> Array:
    """Evaluate a path's twists at the P fractions ``places`` of each of K steps: (K, P, 6 F).

    K can differ from ``steps`` by a few, because no step extends over a corner. A twist is (v, ω)
    of each of the F frames, m and rad per cycle. At a corner of the path, where the twist jumps,
    the twist on the side of the corner on which the step lies is taken. The last results are
    cached, because several strategies follow the same path. InputError is raised if a twist that
    the user computes is not finite.
    """
    found = [
        [path.twist(min(max(a + c * (b - a), a + _INSIDE), b - _INSIDE)) for c in places]
        for a, b in pairwise(path_grid(path, steps).tolist())
    ]
    for twist in (twist for row in found if not path.spec for twist in row):
        vector(twist, None, "the twist (v, ω)", "m and rad per cycle")
    return np.array(found)


def placements_along(path: TaskPath, steps: int) -> tuple[pin.SE3, ...]:
    """Evaluate a path's placements at the start of a cycle and at the end of each of its steps.

    For a path of several frames, each entry of the result is the tuple of their placements.
    """
    placements: tuple[pin.SE3, ...] = _kept(_placements, path)(path, steps)
    return placements


@lru_cache(maxsize=4)
def _placements(path: TaskPath, steps: int) -> tuple[pin.SE3, ...]:
    """Evaluate the placements that :func:`placements_along` returns, and cache the last results.

    The cache serves several strategies that follow the same path.
    """
    return tuple(path.placement(s) for s in path_grid(path, steps).tolist())


def path_grid(path: TaskPath, steps: int) -> Array:
    """Compute the values of s (K + 1,), from 0 to 1, at which the K steps of a cycle begin and end.

    Each piece of the path between two corners has at least one step; its number of steps is
    proportional to its range of s. So no step crosses a corner, where the velocity jumps. K can
    differ from ``steps`` by a few, because the numbers are rounded.
    """
    knots = np.array([0.0, *path.breaks, 1.0])
    pieces = np.maximum(1, np.rint(np.diff(knots) * steps).astype(int))
    return np.concatenate(
        [
            *(
                np.linspace(a, b, k, endpoint=False)
                for a, b, k in zip(knots[:-1], knots[1:], pieces, strict=True)
            ),
            [1.0],
        ]
    )
