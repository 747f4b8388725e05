"""A repeatable inverse: the motions of G_r keep h(q) constant, so every closed path closes."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any, Protocol, runtime_checkable

import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import (
    Array,
    as_configurations,
    as_matrices,
    require_choice,
    require_type,
    row,
    vector,
)
from ..errors import InputError
from ..potentials.basis import Potentials, check_joints
from ..redundancy.augmented import augmented_inverse
from ..robot.task import Task
from ..threads import PerThread
from .control_step import Loop, python_loops
from .on_leaf import solve, solve_all
from .pseudoinverse import at_rows, redundant

_GUARDS = ("ignore", "warn", "raise")

_EDGE = 1e-9
"""How far beyond 1 the scaled distance from the middle of Ω still counts as inside: rounding of
f(q)."""


@runtime_checkable
class Bounded(Protocol):
    """What tells whether configurations lie in it: all that is asked of Ω here."""

    def ratio(self, Q: Array) -> Array:
        """Factor by which the region would have to be scaled for each row of Q to lie on its
        boundary: (K,).

        Above 1 is outside.
        """


class RepeatableInverse:
    """``q̇ = G_r ẋ`` with G_r the first m columns of ``[J; Vᵀ]⁻¹`` (31), (37), ``V = ∂hᵀ/∂q``.

    Any number of threads may call it, each for an arm of its own.

    Parameters
    ----------
    task
        The task to control.
    potentials
        r potentials h; their common level sets are the leaves on which the motion stays.
    region
        Ω, for which it was designed: what ``outside`` checks.
    loops
        Makes what makes the fast functions of the control loop, once in each thread;
        :func:`repctl_pin.codegen.compiled` has them in C.

    Raises
    ------
    InputError
        If the potentials are for another number of joints, or, when evaluated, are not r.
    SingularityError
        If J_V is singular where it is evaluated.

    Examples
    --------
    >>> control = rp.RepeatableInverse(task, design.inverse.potentials)  # what design.inverse is
    >>> leaf = control.leaf(q0)  # c = h(q), (r,)
    >>> q = control.step(q0, task.placement(q0 + 0.01), dt=0.01, leaf=leaf)
    >>> np.allclose(control.leaf(q), leaf, atol=1e-4)
    True
    """

    def __init__(
        self,
        task: Task,
        potentials: Potentials,
        *,
        region: Bounded | None = None,
        loops: Callable[[Task, Potentials], Callable[[], Loop]] = python_loops,
    ) -> None:
        potentials = require_type(
            potentials, Potentials, "potentials", "potentials, such as potentials.weighted(A)"
        )
        if region is not None:
            require_type(
                region, Bounded, "region", "a region of joint space, such as rp.Box(q0, 0.3)"
            )
        self.task, self.potentials, self.region = redundant(task), potentials, region
        check_joints(potentials, self.task.n)
        self._loops, self._loop = loops, PerThread(loops(self.task, potentials))

    @property
    def damping(self) -> float:
        """λ that the last :meth:`step` with damping used in this thread; 0 if it solved exactly."""
        return self._loop.own.damping

    @property
    def slowed(self) -> float:
        """The factor by which the last :meth:`step` with a limit was scaled down in this thread; 1
        if it was not."""
        return self._loop.own.slowed

    # ---- the inverse -----------------------------------------------------------------------------

    def __call__(self, q: ArrayLike) -> Array:
        """Evaluate G_r (n, m)."""
        q = vector(q, self.task.n, "q")
        return augmented_inverse(self.task.jacobian(q), self.potentials.gradient(q))[
            :, : self.task.m
        ]

    def batch(self, Q: ArrayLike, J: Array | None = None) -> Array:
        """Evaluate G_r at every row of Q (K, n): (K, n, m)."""
        if self._loop.own.inverses is not None:
            return self._loop.own.inverses(as_configurations(Q, self.task.n, "batch()"))
        Q, J = at_rows(self.task, Q, J)
        return augmented_inverse(J, self.potentials.gradients(Q))[:, :, : self.task.m]

    # ---- the control loop ------------------------------------------------------------------------

    def velocity(self, q: Array, xdot: Array, *, outside: str = "ignore") -> Array:
        """Choose q̇ (n,) with ``J q̇ = ẋ`` and ``Vᵀ q̇ = 0``.

        Parameters
        ----------
        q, xdot : (n,), (m,) arrays
        outside
            What to do if q lies outside Ω, or a joint is beyond its limits: see :meth:`step`.

        Raises
        ------
        InputError
            If a size is wrong or a number not finite.
        SingularityError
            If J_V is singular.
        """
        if outside != "ignore":
            self._guard(q, outside)
            self._check_limits(q, "q", outside)
        return self._loop.own.velocity(q, xdot)

    def velocities(self, Q: ArrayLike, Xdot: ArrayLike) -> Array:
        """Choose q̇ for every row of Q (K, n) and of Ẋ (K, m): (K, n)."""
        Q = as_configurations(Q, self.task.n, "velocities()")
        (Xdot,) = as_matrices(("Ẋ", Xdot, f"{len(Q)} {self.task.m}"), exact=True)
        if self._loop.own.velocities is not None:
            return self._loop.own.velocities(Q, Xdot)
        return (self.batch(Q) @ Xdot[..., None])[..., 0]

    def step(
        self,
        q: Array,
        target: pin.SE3,
        dt: float,
        twist: Array | None = None,
        *,
        leaf: Array | None = None,
        gain: float | None = None,
        velocity_limit: ArrayLike | None = None,
        damping: float = 0.0,
        outside: str = "ignore",
    ) -> Array:
        """Take the next q (n,) of a control loop: feed-forward, and feedback of both errors.

        ``q + J_V⁻¹ (dt [ẋ; 0] + K dt [x − f(q); c − h(q)])``, beyond the paper: the leaf lock. Only
        the result is allocated; nothing has changed if it raises.

        Parameters
        ----------
        q : (n,) array
            The joints, measured or commanded.
        target
            Where the frame should be; without ``twist``: at the end of the step; with ``twist``:
            now.
        dt
            Time of the step, s.
        twist : (6,) array, optional
            Velocity (v, ω) of the target, base axes, m/s and rad/s.
        leaf : (r,) array, optional
            c, from :meth:`leaf` at the start; without it, h is held at its present value.
        gain
            K, 1/s; by default 1 / dt, a whole Newton step.
        velocity_limit : float or (n,) array, optional
            Joint speeds that are not exceeded, rad/s or m/s: first the return to the leaf is slowed
            down, then, if that is not enough, the whole step. See :attr:`slowed`.
        damping
            λ_max of the damping near singularities, in the units of J; 0 raises there instead. A
            damped step is at most ``‖error‖ / (√3 λ_max)`` long. See :attr:`damping`.
        outside
            What to do if q lies outside Ω, for which nothing was designed, or the next q would lie
            beyond the joint limits: ``ignore``, ``warn``, or ``raise`` (InputError). Checking takes
            as long as one or two steps for a box, five for a cell; ignoring costs nothing.

        Raises
        ------
        InputError
            If an argument cannot be used; it is named.
        SingularityError
            If J_V is singular and there is no damping.
        """
        if outside != "ignore":
            self._guard(q, outside)
            following = self.step(
                q,
                target,
                dt,
                twist,
                leaf=leaf,
                gain=gain,
                velocity_limit=velocity_limit,
                damping=damping,
            )
            self._check_limits(following, "the next q", outside)
            return following
        loop = self._loop.own
        if velocity_limit is None and type(damping) is float and not damping:
            return loop.step(q, target, dt, twist, leaf, gain)
        following, loop.damping, loop.slowed = loop.bounded(
            q, target, dt, twist, leaf, gain, velocity_limit, damping
        )
        return following

    def _guard(self, q: ArrayLike, outside: str) -> None:
        """Warn or raise where q lies outside Ω."""
        require_choice(outside, _GUARDS, "way to treat what is outside Ω")
        if self.region is None:
            raise InputError(
                "outside= requires a region: use design.inverse, or pass region= to RepeatableInverse"
            )
        q = vector(q, self.task.n, "q")
        ratio = float(self.region.ratio(q[None])[0])
        if ratio > 1 + _EDGE:
            scaled = f"scaled distance {ratio:.3g}; the boundary is at 1"
            _tell(f"q = {row(q)} is outside Ω ({scaled}): the design does not cover it", outside)

    def _check_limits(self, q: ArrayLike, what: str, outside: str) -> None:
        """Warn or raise where joints lie beyond their limits."""
        try:
            self.task.check(q, what)
        except InputError as error:
            _tell(str(error), outside)

    # ---- the leaves ------------------------------------------------------------------------------

    def leaf(self, q: ArrayLike) -> Array:
        """Evaluate c = h(q) (r,): the leaf that q lies on, and that every motion from there stays
        on."""
        return self.potentials.value(vector(q, self.task.n, "q"))

    def solve(self, target: pin.SE3, q0: ArrayLike, *, leaf: ArrayLike | None = None) -> Array:
        """Evaluate the inverse kinematic function q = F(x; c): the q on a leaf with the frame at
        the target.

        The same x on the same leaf gives the same q, by whatever way the arm came. See
        :func:`on_leaf.solve`.

        Parameters
        ----------
        target
            x: where the frame should be.
        q0 : (n,) array
            Where to start looking.
        leaf : (r,) array, optional
            c; by default q0's own.

        Raises
        ------
        InputError
            If the leaf reaches no such target, or an argument cannot be used.
        """
        return solve(self, target, q0, leaf)

    def solve_all(
        self, targets: Sequence[pin.SE3], q0: ArrayLike, *, leaf: ArrayLike | None = None
    ) -> Array:
        """Evaluate q = F(x; c) for many targets, each from q0: (K, n)."""
        return solve_all(self, targets, q0, leaf)

    def __getstate__(self) -> dict[str, Any]:
        return {
            "task": self.task,
            "potentials": self.potentials,
            "region": self.region,
            "loops": self._loops,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        RepeatableInverse.__init__(self, **state)


def _tell(what: str, outside: str) -> None:
    """Raise it, or warn of it."""
    if outside == "raise":
        raise InputError(what)
    warnings.warn(what, UserWarning, stacklevel=4)
