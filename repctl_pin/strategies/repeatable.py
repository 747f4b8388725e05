"""A repeatable inverse G_r: its motions keep h(q) constant.

So a closed path ends in the configuration it began in, if it can be shrunk to a point through
closed paths whose motions all stay in Ω, the region of joint space of the design. h are r
potentials, functions of q, with the gradients V = ∂hᵀ/∂q; the set h(q) = c is a leaf, and c its
level. The augmented Jacobian is J_V = [J; Vᵀ]. ẋ (m,) is the task velocity, f(q) is the pose of the
frame, and x − f(q) the task error (m,) of a target x. Numbers in parentheses, such as (31), are
equations of the paper. A self-motion moves the joints while the frame rests. The reference pose is
the default configuration of a robot, from its SRDF or else mid-range. A cell is a box of poses; a
function over it, which gives one configuration per pose, has potentials of its own.

``Potentials`` are r functions h(q) that a repeatable controller holds constant. ``Bounded`` is a
region of joint space that computes how far inside or outside configurations lie. ``NativeLaw`` is
the control law in C. ``NumPyLaw`` is the control law in NumPy. ``Step`` is one step of a control
loop: the next configuration, and how the step was damped and scaled. ``Elbow`` is the elbow of an
arm, the origin of a link, with its Jacobian. ``ElbowLevel`` is the level c at which the elbow is
nearest to a point, and the configuration there.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache, partial
from typing import TYPE_CHECKING, Any, Literal, Protocol, get_args, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import (
    Array,
    as_configurations,
    as_matrices,
    positive,
    require_choice,
    require_type,
    row,
    vector,
)
from ..base.certificate import SAME_LEAF
from ..base.errors import InputError
from ..base.threads import PerThread
from ..model.chain_formulas import Placement
from ..model.task import Task
from ..potentials.basis import Potentials, check_joints
from ..redundancy.augmented import augmented_inverse
from .native_arm import library_arm
from .native_law import NativeLaw
from .pseudoinverse import at_rows, redundant
from .step_arguments import as_joints, as_step_arguments, as_velocity_arguments, step_limits
from .strategy import Step, described

if TYPE_CHECKING:
    from .elbow import Elbow, ElbowLevel
    from .leaf_lock_law import NumPyLaw

_Outside = Literal["ignore", "warn", "raise"]
"""Action outside the design region Ω, or beyond joint limits."""

_ACTIONS = get_args(_Outside)

_EDGE = 1e-9
"""Tolerance of ``region.ratio(q) <= 1`` for the rounding of f(q)."""


@runtime_checkable
class Bounded(Protocol):
    """A region of joint space that computes how far inside or outside configurations lie.

    It is the interface of a region Ω by which a controller warns if q is outside: one method,
    :meth:`ratio`, gives the scale of the region at which its boundary passes through q.
    """

    def ratio(self, Q: Array) -> Array:
        """Compute the scale at which the region's boundary passes through each row of Q: (K,).

        The scale multiplies all widths of the region: it is below 1 for a row inside, above 1
        outside.
        """


class RepeatableInverse:
    """``q̇ = G_r ẋ`` with G_r the first m columns of ``[J; Vᵀ]⁻¹`` (31), (37), ``V = ∂hᵀ/∂q``.

    The r potentials h stay constant in every motion. Several threads may use one object at the same
    time.

    Parameters
    ----------
    task
        The task to control.
    potentials
        r potentials h; their common level sets are the leaves on which the motion stays.
    region
        Design region Ω, which the argument ``outside`` of :meth:`step` checks; by default the
        region of the potentials, if they have one, as the potentials of a cell's function do.

    Raises
    ------
    InputError
        If the potentials are for another number of joints, or their number is not r.
    SingularityError
        If J_V is singular where it is evaluated.

    Examples
    --------
    >>> control = rp.RepeatableInverse(task, design.inverse.potentials)  # equal to design.inverse
    >>> leaf = control.leaf(q0)  # c = h(q), (r,)
    >>> q = control.step(q0, task.placement(q0 + 0.01), dt=0.01, leaf=leaf)
    >>> np.allclose(control.leaf(q), leaf, atol=1e-4)
    True
    """

    def __init__(
        self, task: Task, potentials: Potentials, *, region: Bounded | None = None
    ) -> None:
        potentials = require_type(
            potentials, Potentials, "potentials", "potentials, such as potentials.weighted(A)"
        )
        if region is None:
            region = getattr(potentials, "region", None)
        else:
            require_type(
                region, Bounded, "region", "a region of joint space, such as rp.Box(q0, 0.3)"
            )
        self.task = redundant(task)
        self.potentials = potentials
        self.region = region
        check_joints(potentials, self.task.n)
        self._law = PerThread(_laws(self.task, potentials))
        self._elbows: PerThread[dict[str | None, Elbow]] = PerThread(dict)

    def __repr__(self) -> str:
        r = self.task.r
        return described(self, self.task, f"{r} potential{'s' if r != 1 else ''}")

    # ---- the inverse -----------------------------------------------------------------------------

    def __call__(self, q: ArrayLike) -> Array:
        """Evaluate G_r (n, m), the matrix of ``q̇ = G_r ẋ``, at q (n,)."""
        return self._law.own.inverse(as_joints(q, self.task.n))

    def batch(self, Q: ArrayLike, J: ArrayLike | None = None) -> Array:
        """Evaluate G_r at every row of Q (K, n): (K, n, m).

        J (K, m, n) are the Jacobians at these rows, if they are known already.
        """
        if J is None:
            return self._law.own.inverses(as_configurations(Q, self.task.n, "batch()"))
        Q, J = at_rows(self.task, Q, J)
        return augmented_inverse(J, self.potentials.gradients(Q))[:, :, : self.task.m]

    # ---- the control loop ------------------------------------------------------------------------

    def velocity(self, q: ArrayLike, xdot: ArrayLike, *, outside: _Outside = "ignore") -> Array:
        """Compute q̇ (n,) with ``J q̇ = ẋ`` and ``Vᵀ q̇ = 0``.

        The frame moves with ẋ, and the potentials h, whose gradients are V, stay constant.

        Parameters
        ----------
        q, xdot : (n,), (m,) arrays
        outside
            Action if q lies outside Ω or violates a joint limit: ``"ignore"``, ``"warn"`` or
            ``"raise"`` (an InputError). Only ``"ignore"`` is possible without a region Ω.

        Raises
        ------
        InputError
            If a size is wrong or a number is not finite.
        SingularityError
            If J_V is singular.
        """
        if outside != "ignore":
            self._check_region(q, outside)
            self._check_limits(q, "q", outside)
        task = self.task
        return self._law.own.velocity(*as_velocity_arguments(q, xdot, task.n, task.m))

    def velocities(self, Q: ArrayLike, Xdot: ArrayLike) -> Array:
        """Compute q̇ for every row of Q (K, n) and of Ẋ (K, m): (K, n).

        This is faster than a loop over :meth:`velocity`.
        """
        Q = as_configurations(Q, self.task.n, "velocities()")
        (Xdot,) = as_matrices(("Ẋ", Xdot, f"{len(Q)} {self.task.m}"), exact=True)
        return self._law.own.velocities(Q, Xdot)

    def step(
        self,
        q: ArrayLike,
        target: Placement,
        dt: float,
        twist: ArrayLike | None = None,
        *,
        leaf: ArrayLike | None = None,
        gain: float | None = None,
        velocity_limit: ArrayLike | None = None,
        damping: float = 0.0,
        outside: _Outside = "ignore",
    ) -> Array:
        """Compute the next q (n,) of a control loop, with feedback of the task and leaf errors.

        The next q is ``q + J_V⁻¹ (dt [ẋ; 0] + K dt [x − f(q); c − h(q)])``. This leaf lock, which
        the paper does not have, returns the arm to the level c of the potentials h. Only the result
        is allocated. The controller holds no state: a step that raises changes nothing.

        Parameters
        ----------
        q : (n,) array
            Configuration, measured or commanded.
        target : pinocchio.SE3 or (4, 4) array
            Desired placement of the frame, in the base frame: now, if ``twist`` is given; else at
            the end of the step. For a task of several frames, a list with one placement per frame.
        dt
            Duration of the step, s.
        twist : (6,) or (6 F,) array, optional
            Velocity (v, ω) of the target, or of each of the targets of F frames, base axes, m/s and
            rad/s.
        leaf : (r,) array, optional
            Level c, from :meth:`leaf` at the start; without it, h is held at its present value.
        gain
            Feedback gain K, 1/s; by default 1 / dt, a full Newton step.
        velocity_limit : float or (n,) array, optional
            Joint speed limits, rad/s or m/s. The return to the leaf is slowed down first, then the
            whole step. :meth:`damped_step` reports the factor.
        damping
            Maximum damping λ_max near singularities, in the units of J; with 0, SingularityError is
            raised instead. A damped step is at most ``‖b‖ / (√3 λ_max)`` long, where b is the
            vector by which J_V⁻¹ is multiplied above. :meth:`damped_step` reports λ.
        outside
            Action if q lies outside the design region Ω, or the next q beyond the joint limits:
            ``"ignore"``, ``"warn"``, or ``"raise"`` (an InputError). Only ``"ignore"`` is possible
            without a region Ω, and takes no time. The check takes about as long as three steps for
            a box, seven for a cell.

        Raises
        ------
        InputError
            If an argument cannot be used; the message names the argument.
        SingularityError
            If J_V is singular and there is no damping.
        """
        if outside != "ignore":
            self._check_region(q, outside)
        free = velocity_limit is None and type(damping) is float and not damping
        bounds = None if free else step_limits(velocity_limit, damping, self.task.n)
        task = self.task
        given = as_step_arguments(q, target, dt, twist, leaf, gain, task)
        following = self._law.own.step(*given, bounds)
        if outside != "ignore":
            self._check_limits(following, "the next q", outside)
        return following

    def damped_step(
        self,
        q: ArrayLike,
        target: Placement,
        dt: float,
        twist: ArrayLike | None = None,
        *,
        leaf: ArrayLike | None = None,
        gain: float | None = None,
        velocity_limit: ArrayLike | None = None,
        damping: float = 0.0,
        outside: _Outside = "ignore",
    ) -> Step:
        """Compute the next q as :meth:`step` does, and report the step's damping and scale.

        The arguments are those of :meth:`step`: ``target`` is the placement, in the base frame, at
        the end of the step or, with a ``twist``, now; dt is in s; ``leaf`` is the level c, by
        default the present one; ``gain``, 1/s, is 1 / dt by default; ``damping`` is λ_max;
        ``outside`` is ``"ignore"``, ``"warn"`` or ``"raise"``. The damping and the scale show
        whether the step differs from the requested one, as near a singularity or at a speed limit.

        Returns
        -------
        Step
            ``q``, the ``damping`` λ that was used, and ``slowed``, the factor by which the step was
            scaled down to the speed limits.

        Examples
        --------
        >>> control = design.inverse
        >>> target = task.placement(q0 + 0.01)
        >>> step = control.damped_step(q0, target, dt=0.01, velocity_limit=0.1)  # rad/s
        >>> bool(step.slowed < 1 and np.abs(step.q - q0).max() <= 0.001001), step.damping
        (True, 0.0)
        """
        if outside != "ignore":
            self._check_region(q, outside)
        bounds = step_limits(velocity_limit, damping, self.task.n)
        task, law = self.task, self._law.own
        given = as_step_arguments(q, target, dt, twist, leaf, gain, task)
        following = law.step(*given, bounds)
        if outside != "ignore":
            self._check_limits(following, "the next q", outside)
        return Step(following, *law.report())

    def _check_region(self, q: ArrayLike, outside: str) -> None:
        """Warn or raise, as ``outside`` says, if q lies outside Ω.

        Repeatability is not guaranteed there. ``outside`` is "warn" or "raise". InputError is
        raised if the inverse has no region.
        """
        require_choice(outside, _ACTIONS, "action outside Ω")
        if self.region is None:
            raise InputError(
                "outside= requires a region: use design.inverse, "
                "or pass region= to RepeatableInverse"
            )
        q = vector(q, self.task.n, "q")
        ratio = float(self.region.ratio(q[None])[0])
        if ratio > 1 + _EDGE:
            scaled = f"scaled distance {ratio:.3g}; the boundary is at 1"
            _report(f"q = {row(q)} is outside Ω ({scaled}): the design does not cover it", outside)

    def _check_limits(self, q: ArrayLike, what: str, outside: str) -> None:
        """Warn or raise, as ``outside`` says, if q (called ``what``) violates a joint limit.

        ``outside`` is "warn" or "raise".
        """
        try:
            self.task.check(q, what)
        except InputError as error:
            _report(str(error), outside)

    # ---- the leaves ------------------------------------------------------------------------------

    def leaf(self, q: ArrayLike) -> Array:
        """Evaluate c = h(q) (r,), the level of the leaf on which q lies and the motion stays."""
        return self._law.own.leaf(vector(q, self.task.n, "q"))

    def same_leaf(self, q: ArrayLike, other: ArrayLike) -> bool:
        """Test whether two configurations lie on one leaf: ``max |h(q) − h(q′)| ≤ 1e-6``.

        The maximum is over the r potentials. A leaf is the set of configurations with one value of
        h(q). A proof for paths on one leaf does not cover another leaf.

        Parameters
        ----------
        q, other : (n,) array
            Configurations, rad (m for prismatic joints).
        """
        return bool(np.abs(self.leaf(q) - self.leaf(other)).max() <= SAME_LEAF)

    def elbow(self, q: ArrayLike, *, link: str | None = None) -> Array:
        """Compute the elbow of the arm at q: a point (3,), in the base frame, m.

        Parameters
        ----------
        q : (n,) array
        link
            Link whose origin is the elbow. By default, the elbow is the origin of the elbow joint:
            the joint in the middle of the arm whose origin moves most in self-motions at the
            reference pose.
        """
        return self._elbow(link).point(vector(q, self.task.n, "q"))

    def _elbow(self, link: str | None) -> Elbow:
        """Return this thread's :class:`Elbow` of a link; None stands for the elbow joint."""
        from .elbow import Elbow

        if link is not None:
            require_type(link, str, "link", "the name of a link")
        own = self._elbows.own
        if link not in own:
            own[link] = Elbow(self.task, link)
        return own[link]

    def leaf_toward(
        self, q: ArrayLike, *, elbow: ArrayLike, link: str | None = None, margin: float = 0.0
    ) -> ElbowLevel:
        """Find the level c at which the elbow is nearest to a point, with the frame at rest.

        The search moves along the self-motion from q, within the joint limits and away from
        algorithmic singularities, to the next minimum of the distance. Where a self-motion hardly
        changes this distance, ``unique`` is False, and the level depends on q. If q depends only on
        the pose, as the result of :meth:`solve` from a fixed start does, then the level depends
        only on the pose and the point.

        Parameters
        ----------
        q : (n,) array
            Configuration where the search begins; the frame rests there.
        elbow : (3,) array
            Point p_e for the elbow, in the base frame, m.
        link
            Link whose origin is the elbow; by default that of the elbow joint, see :meth:`elbow`.
        margin
            Distance to keep from the joint limits, rad (m). For a governor, give at least its own
            ``margin``.

        Returns
        -------
        ElbowLevel
            ``leaf``, the level; ``q``, ``distance`` and ``unique``.

        Raises
        ------
        InputError
            If an argument cannot be used, or q violates a joint limit.
        SingularityError
            If J_V is singular at q.
        """
        from .elbow import leaf_toward

        q = self.task.check(q, "q")
        point = vector(elbow, 3, "elbow")
        kept = positive(margin, "margin", "rad (m)", zero=True)
        self(q)
        return leaf_toward(self, self._elbow(link), q, point, kept)

    def solve(self, target: Placement, q0: ArrayLike, *, leaf: ArrayLike | None = None) -> Array:
        """Solve f(q) = x on a leaf: the inverse kinematic function q = F(x; c).

        A leaf is the set h(q) = c of the potentials h, on which pose x and level c determine q. On
        the solution branch of q0, the result depends on x and c alone, not on the motion before.

        Parameters
        ----------
        target : pinocchio.SE3 or (4, 4) array
            Desired placement x of the frame, in the base frame.
        q0 : (n,) array
            Initial configuration of the search.
        leaf : (r,) array, optional
            Level c; by default h(q0).

        Returns
        -------
        (n,) array
            Configuration q with f(q) = x and h(q) = c.

        Raises
        ------
        InputError
            If no configuration of the leaf reaches the target, or an argument cannot be used.
        """
        from .leaf_ik import solve

        return solve(self.task, self.potentials, self.step, target, q0, leaf)

    def __getstate__(self) -> dict[str, Any]:
        return {"task": self.task, "potentials": self.potentials, "region": self.region}

    def __setstate__(self, state: dict[str, Any]) -> None:
        RepeatableInverse.__init__(self, **state)


def _laws(task: Task, potentials: Potentials) -> Callable[[], NativeLaw | NumPyLaw]:
    """Return a function that makes the control law for one thread, in C or else in NumPy.

    A law holds scratch memory, so that each thread needs its own; the C struct of the arm is
    shared.
    """
    shared_arm = cache(partial(library_arm, task, potentials))

    def law() -> NativeLaw | NumPyLaw:
        arm = shared_arm()
        if arm is not None:
            return NativeLaw(task, potentials, arm)
        from .leaf_lock_law import NumPyLaw

        return NumPyLaw(task, potentials)

    return law


def _report(what: str, outside: str) -> None:
    """Raise an InputError with the message ``what`` if ``outside`` is "raise", else warn.

    The warning points to the line of the user's program.
    """
    if outside == "raise":
        raise InputError(what)
    warnings.warn(what, UserWarning, stacklevel=4)
