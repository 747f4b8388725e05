"""Follow a closed path, cycle after cycle, and measure what became of the joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, SingularityError
from ..robot.task import Task
from ..strategies.strategy import Strategy
from .paths import Path

Array = NDArray[np.float64]

# Butcher tableaux: nodes c, matrix A (lower triangle, row by row), weights b.
INTEGRATORS: dict[str, tuple[tuple[float, ...], tuple[tuple[float, ...], ...], tuple[float, ...]]] = {
    "euler": ((0.0,), ((),), (1.0,)),
    "rk4": ((0.0, 0.5, 0.5, 1.0), ((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)), (1 / 6, 1 / 3, 1 / 3, 1 / 6)),
}

_INSIDE = 1e-12
"""How far from a grid point, in cycles, a velocity is asked for: on the step's own side of a corner."""

_JUMP = 1.0
"""No arm moves a joint this far, rad or m, in one step: the integration has gone astray."""


@dataclass(frozen=True)
class Motion:
    """What a strategy did on a closed path.

    Norms over joints count a radian and a metre alike where an arm has both kinds of joints.

    Attributes
    ----------
    task, path
        What was moved, and along what.
    t : (T + 1,) array
        Time, s.
    q, qdot : (T + 1, n) arrays
        Joint positions and velocities, rad or m, and per second.
    cycles, steps : int
        T = cycles · steps.
    drift : (cycles,) array
        ``‖q(after cycle k) − q(0)‖``, k = 1, 2, …
    tracking_error : (T + 1,) array
        Distance of the frame from where it should be, m, in the task's coordinates.
    turning_error : (T + 1,) array
        The same for orientation, rad; 0 where the task has none.
    """

    task: Task
    path: Path
    t: Array
    q: Array
    qdot: Array
    cycles: int
    steps: int
    drift: Array
    tracking_error: Array
    turning_error: Array

    @property
    def speed(self) -> Array:
        """Joint speed ``‖q̇‖`` along the motion: (T + 1,)."""
        return np.linalg.norm(self.qdot, axis=1)

    @property
    def rms_speed(self) -> float:
        """Root mean square of the joint speed."""
        return float(np.sqrt(np.mean(self.speed**2)))

    @property
    def peak_speed(self) -> float:
        """Largest joint speed."""
        return float(self.speed.max())

    @property
    def speed_ratio(self) -> float:
        """Largest share of a joint's speed limit that was used; above 1 the path must be slowed down."""
        return float(np.max(np.abs(self.qdot) / self.task.velocity_limit))

    @property
    def limit_margin(self) -> Array:
        """Distance of every joint to its nearer limit: (T + 1, n); negative outside, inf where none."""
        return np.minimum(self.q - self.task.lower, self.task.upper - self.q)

    @property
    def first_violation(self) -> tuple[float, str] | None:
        """The first time a joint leaves its limits: (cycle, joint name), or None.

        The cycle is counted in fractions: 2.5 is the middle of the third.
        """
        outside = self.limit_margin < -1e-9
        if not outside.any():
            return None
        row = int(np.argmax(outside.any(axis=1)))
        joint = self.task.joint_names[int(np.argmin(self.limit_margin[row]))]
        return row / self.steps, joint

    def cycle(self, k: int) -> Array:
        """Joint positions of cycle k, counted from 0, both ends included: (steps + 1, n)."""
        return self.q[k * self.steps : (k + 1) * self.steps + 1]


def follow(
    strategy: Strategy,
    path: Path,
    q0: ArrayLike,
    *,
    cycles: int = 10,
    steps: int = 500,
    integrator: str = "rk4",
    feedback: float = 0.0,
    period: float = 5.0,
) -> Motion:
    """Integrate ``q̇ = strategy(q, ẋ)`` along a closed path, cycle after cycle.

    With feedback, ``ẋ = ẋ_path + K e`` with e the task error.

    Parameters
    ----------
    strategy
        What turns ẋ into q̇.
    path
        The closed path; it should start where the frame is at q0.
    q0 : (n,) array
        The start, inside the joint limits.
    cycles, steps
        How often round, and integration steps a cycle (a few more where corners ask for it).
    integrator
        ``rk4`` or ``euler``.
    feedback
        K, 1/s; 0 is open loop. With Euler, K = steps / period undoes the whole error in one step.
    period
        Time of one cycle, s.

    Raises
    ------
    InputError
        If an option is out of its range, or the path starts elsewhere than the frame.
    SingularityError
        If the motion runs into a singularity; the message says in which cycle.
    """
    task = strategy.task
    q = task.check(q0, "the start")
    if integrator not in INTEGRATORS:
        raise InputError(f"no integrator {integrator!r}; there is {', '.join(INTEGRATORS)}")
    for name, value, least in (("cycles", cycles, 1), ("steps", steps, 1)):
        if int(value) != value or value < least:
            raise InputError(f"{name} must be a whole number from {least} up, not {value!r}")
    if not (np.isfinite(period) and period > 0 and np.isfinite(feedback) and feedback >= 0):
        raise InputError("the period must be above 0 s and the feedback gain 0 or more")
    gap = float(np.linalg.norm(task.error(q, path.placement(0.0))))
    if gap > 1e-3 and not feedback:
        raise InputError(f"the path starts {gap:.3g} m (or rad) away from the frame; use reach() first, or feedback")

    grid = _grid(path, int(steps))
    nodes, matrix, weights = INTEGRATORS[integrator]

    def velocity(q: Array, s: float, inside: float) -> Array:
        xdot = task.rate(q, path.twist(inside)) / period
        if feedback:
            xdot = xdot + feedback * task.error(q, path.placement(s))
        return strategy.velocity(q, xdot)

    n_steps = len(grid) - 1
    Q = np.empty((cycles * n_steps + 1, task.n))
    Qdot = np.empty_like(Q)
    Q[0] = q
    with np.errstate(over="ignore", invalid="ignore"):
        for step in range(cycles * n_steps):
            s, s_end = grid[step % n_steps], grid[step % n_steps + 1]
            h = (s_end - s) * period
            slopes: list[Array] = []
            try:
                for c, row in zip(nodes, matrix, strict=True):
                    stage = q + h * sum((a * k for a, k in zip(row, slopes, strict=True) if a), start=0.0)
                    at = s + c * (s_end - s)
                    inside = min(max(at, s + _INSIDE), s_end - _INSIDE)
                    slopes.append(velocity(stage, at, inside))
            except SingularityError as error:
                raise SingularityError(f"{error}, in cycle {1 + step / n_steps:.2f} of {path.name}") from None
            Qdot[step] = slopes[0]
            change = h * sum(b * k for b, k in zip(weights, slopes, strict=True))
            if not np.abs(change).max() < _JUMP:
                raise SingularityError(
                    f"the joints jump by more than {_JUMP:g} rad in one step, in cycle {1 + step / n_steps:.2f} of "
                    f"{path.name}: the arm is at a singularity, the path out of reach, or the steps too few"
                )
            q = q + change
            Q[step + 1] = q
    Qdot[-1] = velocity(q, 1.0, 1.0 - _INSIDE)

    s_all = np.concatenate([np.tile(grid[:-1], cycles), [1.0]])
    t = np.concatenate([(np.arange(cycles)[:, None] + grid[:-1]).ravel(), [float(cycles)]]) * period
    errors = np.array([task.error(q, path.placement(s)) for q, s in zip(Q, s_all, strict=True)])
    linear = min(3, task.m)
    return Motion(
        task=task,
        path=path,
        t=t,
        q=Q,
        qdot=Qdot,
        cycles=int(cycles),
        steps=n_steps,
        drift=np.linalg.norm(Q[n_steps::n_steps] - Q[0], axis=1),
        tracking_error=np.linalg.norm(errors[:, :linear], axis=1),
        turning_error=np.linalg.norm(errors[:, linear:], axis=1),
    )


def _grid(path: Path, steps: int) -> Array:
    """Values of s to step through in one cycle, every corner among them."""
    knots = np.array([0.0, *path.breaks, 1.0])
    pieces = np.maximum(1, np.rint(np.diff(knots) * steps).astype(int))
    return np.concatenate(
        [*(np.linspace(a, b, k, endpoint=False) for a, b, k in zip(knots[:-1], knots[1:], pieces, strict=True)), [1.0]]
    )
