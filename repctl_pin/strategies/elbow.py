"""Elbow of the arm as an input: the level c at which the elbow is nearest to a point.

A repeatable inverse keeps its potentials h at the level c. Pose x and level c determine q, so a
position of the elbow is chosen by a level. While the elbow moves towards the point, the frame
rests: q̇ = N ż with J N = 0, where z (r,) are coordinates of the self-motion. The elbow is the
origin of a link. The reference pose is the default configuration of a robot, from its SRDF or else
mid-range. J is the Jacobian of the task, N an orthonormal basis of its null space, and Ω the design
region of the inverse. The ratio of a configuration is the scale of Ω at which the boundary passes
through it: 1 at the edge, below 1 inside. An argument ``inverse`` is the repeatable inverse, and
``lower`` and ``upper`` (n,) are joint limits, rad or m.

``_Bounded`` is a region Ω of joint space that gives ratios of configurations. ``_OnLeaves`` is a
repeatable inverse, as far as the search for an elbow needs it. ``ElbowLevel`` is the level c at
which the elbow is nearest to a point, and the configuration there. ``_Regular`` is bounds on
singular values, leaf margin and Ω that a search must keep.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin

from ..base.arguments import Array, read_only
from ..base.errors import InputError, SingularityError
from ..model.length import elbow as elbow_joint
from ..model.model import frame_id
from ..model.several_frames import one_frame
from ..model.task import Task
from ..potentials.basis import Potentials
from ..redundancy.augmented import leaf_margin
from ..redundancy.inverses import inverse_condition_number
from ..redundancy.nullspace import nullspace

_INSIDE = 1e-4
"""Distance, rad or m, that results keep from joint limits: paths between iterations are curved."""

_LEAST = 0.05
"""Minimum leaf margin of the result, or that of the start if it is lower."""

_REGULAR = 0.01
"""Minimum inverse condition number of J at the result, or that of the start if it is lower."""

_FLAT = 0.01
"""Norm of curvature and slope, relative to ‖∂p_elbow/∂z‖², below which a direction is flat."""

_LONGEST, _SHORTEST = 0.3, 1e-11
"""Longest motion of a joint per iteration, and that of the last one, rad or m."""

_APART = 1e-3
"""Step in z, rad or m, of the differences from which second derivatives are evaluated."""

_ITERATIONS, _HALVES = 60, 20

_NEWTON, _EXACT = 8, 1e-8
"""Maximum number of Newton steps back to the pose, and length of the last, rad or m; the error is
of the order of its square."""


class _Bounded(Protocol):
    """Interface of a region Ω, as far as the search needs it: ratios of configurations."""

    def ratio(self, Q: Array) -> Array:
        """Compute the ratios (K,) of the rows of Q (K, n)."""


class _OnLeaves(Protocol):
    """Interface of a repeatable inverse, as far as the search for an elbow needs it.

    ``task`` is the controlled task, and ``potentials`` are the functions h that the inverse holds
    constant.
    """

    task: Task
    potentials: Potentials

    @property
    def region(self) -> _Bounded | None:
        """Region Ω, at whose edge the search stops; None without one."""

    def step(self, q: Array, target: pin.SE3, dt: float) -> Array:
        """Compute the next q (n,): the frame moves towards a target, and h keeps its value.

        ``target`` is a placement of the frame in the base frame. dt = 1 makes a Newton step.
        """

    def leaf(self, q: Array) -> Array:
        """Evaluate the level c = h(q) (r,)."""


@dataclass(frozen=True, eq=False)
@read_only
class ElbowLevel:
    """The level c at which the elbow is nearest to a point, while the frame rests.

    Attributes
    ----------
    leaf : (r,) array
        Level c, the argument ``leaf`` of :meth:`Governor.step`.
    q : (n,) array
        Configuration at this level.
    distance : float
        Distance of the elbow from the point, m.
    unique : bool
        False if a self-motion hardly changes this distance: the point is on the line from shoulder
        to wrist, or a self-motion does not move the elbow. The search then leaves the configuration
        unchanged along this self-motion.
    """

    leaf: Array
    q: Array
    distance: float
    unique: bool


@dataclass(frozen=True)
class _Regular:
    """Bounds that keep a search away from singularities and inside Ω.

    ``condition`` is the minimum of σ_min / σ_max of J, ``margin`` the minimum leaf margin, and
    ``ratio`` the maximum ratio. The usual bounds are 0.01, 0.05 and 1. If the start violates one of
    them, the start's own value becomes the bound.
    """

    condition: float
    margin: float
    ratio: float

    @classmethod
    def at(cls, inverse: _OnLeaves, q: Array) -> _Regular:
        """Choose the bounds of a search that starts at q (n,)."""
        condition = inverse_condition_number(inverse.task.jacobian(q))
        return cls(
            min(_REGULAR, float(condition)),
            min(_LEAST, _margin(inverse, q)),
            max(1.0, _ratio(inverse, q)),
        )

    def holds(self, inverse: _OnLeaves, q: Array) -> bool:
        """Test whether the configuration q (n,) is within all three bounds."""
        condition = inverse_condition_number(inverse.task.jacobian(q))
        return bool(
            condition >= self.condition
            and _ratio(inverse, q) <= self.ratio
            and _margin(inverse, q) >= self.margin
        )


class Elbow:
    """The point of an arm that is its elbow: the origin of a link, and its Jacobian.

    Parameters
    ----------
    task
        Task of the arm.
    link
        Link whose origin is the elbow; None for the origin of the elbow joint, the joint in the
        middle of the arm whose origin moves most in self-motions at the reference pose.
    """

    def __init__(self, task: Task, link: str | None) -> None:
        self._model, self._drive = task.bodies_model()
        if link is None:
            one_frame(task, "an elbow without link=")
            joint = task.joint_names[elbow_joint(task, task.reference)]
            self._frame = self._model.getFrameId(joint, pin.FrameType.JOINT)
        else:
            self._frame = frame_id(self._model, link)
            if self._model.frames[self._frame].parentJoint == 0:
                raise InputError(
                    f"link {link!r} is moved by no joint of the task; choose another link"
                )
        base = task.robot.base
        self._base = None if base is None else frame_id(self._model, base)
        self._data = self._model.createData()

    def point(self, q: Array) -> Array:
        """Compute the position (3,) of the elbow, in the base frame, m."""
        pin.framesForwardKinematics(self._model, self._data, self._drive.joints(q))
        return self._relative()[1]

    def jacobian(self, q: Array) -> Array:
        """Compute the derivative of :meth:`point` by q, (3, n)."""
        model, data = self._model, self._data
        pin.computeJointJacobians(model, data, self._drive.joints(q))
        pin.updateFramePlacements(model, data)
        J = self._velocity(self._frame)[:3]
        R, p = self._relative()
        if self._base is not None:  # the base moves, too: v - v_b - ω_b × (p - p_b)
            J_b = self._velocity(self._base)
            J = R.T @ (J - J_b[:3] + pin.skew(R @ p) @ J_b[3:])
        return np.asarray(self._drive.derivatives(J))

    def _velocity(self, frame: int) -> Array:
        """Return the Jacobian of the model's frame with index ``frame``: rows of v, then ω.

        Compute the joint Jacobians and frame placements of the model at q (n,) first: the result is
        the Jacobian at q. It is (6, nv), with one column for each of the nv joint velocities of the
        model, also of joints outside q. v is the velocity of the frame's origin; v and ω are in
        world axes.
        """
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return np.asarray(pin.getFrameJacobian(self._model, self._data, frame, axes))

    def _relative(self) -> tuple[Array, Array]:
        """Return the base's rotation (3, 3), and the elbow's position (3,) in the base frame, m.

        Compute the placements of the model's frames at q (n,) first: both results are those at q.
        The rotation is relative to the root of the robot; it is I if the base is the root.
        """
        p = self._data.oMf[self._frame].translation
        if self._base is None:
            return np.eye(3), p.copy()
        base = self._data.oMf[self._base]
        return base.rotation, base.actInv(p)


def leaf_toward(
    inverse: _OnLeaves, elbow: Elbow, q: Array, point: Array, margin: float
) -> ElbowLevel:
    """Move along the self-motion to the minimum of ½ ‖p_elbow − p_e‖², by Newton's method.

    The search begins at q (n,). p_elbow is the position of ``elbow``, and p_e is ``point`` (3,),
    both in the base frame, m. The method uses first and second derivatives by z (r,), the step
    along the columns of N. After a step to q + N z, the frame is brought back to its pose. Steps
    keep the distance ``margin``, rad or m, from the joint limits, and the bounds of
    :class:`_Regular`. A joint at its limit stays there while the step to the minimum would take it
    beyond. The search ends at a minimum, or where no step that keeps this distance and these bounds
    brings the elbow nearer.

    Return the level and the configuration at the end of the search, with the distance that is left.
    SingularityError is raised if the search cannot begin because q is near a singularity.
    """
    task = inverse.task
    lower, upper = task.lower + margin + _INSIDE, task.upper - margin - _INSIDE
    regular = _Regular.at(inverse, q)
    unique, before = True, q
    for k in range(_ITERATIONS):
        away = elbow.point(q) - point
        try:
            N = nullspace(task.jacobian(q))
            A, second = _derivatives(inverse, elbow, q, N)
        except SingularityError:
            if k == 0:
                raise
            q = before  # J is nearly singular at q
            break
        H = A.T @ A + np.tensordot(second, away, 1)
        z, unique = _newton_step(A, H, A.T @ away, N, q, lower, upper)
        if np.abs(N @ z).max() <= _SHORTEST:
            break
        found = _accepted(inverse, elbow, q, N @ z, point, (lower, upper), regular)
        if found is None:
            break
        before, q = q, found
    away = elbow.point(q) - point
    return ElbowLevel(inverse.leaf(q), q, float(np.linalg.norm(away)), unique)


def _derivatives(inverse: _OnLeaves, elbow: Elbow, q: Array, N: Array) -> tuple[Array, Array]:
    """Compute the first (3, r) and second (r, r, 3) derivatives of the elbow's position by z.

    z (r,) are the coordinates of the self-motion from q (n,): the steps along the columns of N
    (n, r), a basis of the null space of J.
    """
    r, h, here = N.shape[1], _APART, elbow.point(q)
    place = inverse.task.placement(q)

    def at(z: Array) -> Array:
        return elbow.point(_retracted(inverse, q + N @ z, place))

    E = h * np.eye(r)
    ahead, behind = np.array([at(e) for e in E]), np.array([at(-e) for e in E])
    second = np.empty((r, r, 3))
    for i in range(r):
        second[i, i] = (ahead[i] + behind[i] - 2 * here) / h**2
        for j in range(i):
            both = at(E[i] + E[j]) + at(-E[i] - E[j])
            own = ahead[i] + behind[i] + ahead[j] + behind[j]
            second[i, j] = second[j, i] = (both - own + 2 * here) / (2 * h**2)
    return elbow.jacobian(q) @ N, second


def _newton_step(
    A: Array, H: Array, g: Array, N: Array, q: Array, lower: Array, upper: Array
) -> tuple[Array, bool]:
    """Compute the step z (r,) to the minimum of ``gᵀz + ½ zᵀHz`` within the joint limits.

    The step leads from q (n,) to q + N z, with the null-space basis N (n, r). g (r,) and H (r, r)
    are the gradient and the second derivatives of half the squared distance by z, and A (3, r) is
    the derivative of the elbow's position by z. ``lower`` and ``upper`` (n,) are the limits of q. A
    joint at or beyond its limit that would end beyond it is moved to the limit. The step is
    shortened so that no other joint passes its limit, and no joint moves by more than 0.3 rad or m.
    The second result is False if the minimum is not unique, because slope and curvature vanish
    along a direction.
    """
    held = np.zeros(len(q), bool)
    goal = np.clip(q, lower, upper)
    at_limit = (q < lower + 1e-9) | (q > upper - 1e-9)
    while True:
        z, unique = _model_step(A, H, g, N[held], (goal - q)[held])
        ahead = q + N @ z
        beyond = np.where(at_limit & ~held, np.maximum(lower - ahead, ahead - upper), -np.inf)
        if beyond.max() <= 1e-12 or held.sum() >= len(z):
            break
        held[int(np.argmax(beyond))] = True
    # no other joint beyond its limit, and none too far
    way = N @ z
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(way > 0, (upper - q) / way, np.where(way < 0, (lower - q) / way, np.inf))
    share = min(
        1.0, _LONGEST / max(np.abs(way).max(), 1e-300), reach[~held & ~at_limit].min(initial=1)
    )
    return share * z, unique


def _model_step(A: Array, H: Array, g: Array, rows: Array, back: Array) -> tuple[Array, bool]:
    """Minimise ``gᵀz + ½ zᵀHz`` subject to ``rows z = back``, for the step z (r,).

    g (r,) and H (r, r) are the gradient and the second derivatives of half the squared distance of
    the elbow from the point by z. ``rows`` (K, r) are the rows of N of K joints at limits, and
    ``back`` (K,) their motions to the limits, rad or m. A direction is flat if slope and curvature
    along it are small compared with ``‖A‖²``, where A is the derivative of the elbow's position by
    z. z is 0 along flat directions. The second result is True if no direction is flat.
    """
    begin: Array = np.zeros(len(g))
    if len(rows):
        begin = np.asarray(np.linalg.lstsq(rows, back, rcond=None)[0], float)
    Z = nullspace(rows) if len(rows) else np.eye(len(g))
    if Z.shape[1] == 0:
        return begin, True
    curvature, U = np.linalg.eigh(Z.T @ H @ Z)
    slope = U.T @ (Z.T @ (g + H @ begin))
    size = np.hypot(curvature, slope)
    moves = size > _FLAT * np.linalg.norm(A, 2) ** 2
    y = np.where(moves, -slope / np.where(size > 0, size, 1.0), 0.0)
    top = moves & (curvature < 0) & (np.abs(y) < _FLAT)  # a maximum is left
    y[top] = _LONGEST
    return begin + Z @ (U @ y), bool(moves.all())


def _accepted(
    inverse: _OnLeaves,
    elbow: Elbow,
    q: Array,
    way: Array,
    point: Array,
    limits: tuple[Array, Array],
    regular: _Regular,
) -> Array | None:
    """Halve the step ``way`` (n,) from q until its end is acceptable; return this end, or None.

    An end has the frame at its pose, and is within the bounds ``regular``. From a q within the
    ``limits`` (lower, upper), the end is within them, too, with the tolerance :data:`_INSIDE`, and
    its elbow is nearer to ``point`` (3,), in the base frame, m. From a q beyond the limits, the end
    is not farther beyond them, and either the joints are nearer to the limits or the elbow is
    nearer to the point. A step of less than 1e-3 rad or m need not bring the elbow nearer.
    """
    task = inverse.task
    place, before = task.placement(q), np.linalg.norm(elbow.point(q) - point)
    small, distance = np.abs(way).max() < 10 * _INSIDE, _limit_distance(q, *limits)
    for _ in range(_HALVES):
        try:
            ahead = _retracted(inverse, q + way, place)
            if distance >= -_INSIDE:
                ahead = _inside(inverse, ahead, place, *limits)
            there = _limit_distance(ahead, *limits)
            nearer = small or np.linalg.norm(elbow.point(ahead) - point) < before
            back = distance < -_INSIDE and there > distance
            keeps = there >= min(-_INSIDE, distance) and regular.holds(inverse, ahead)
            if keeps and (nearer or back):
                return ahead
        except SingularityError:
            pass
        way = way / 2
    return None


def _inside(inverse: _OnLeaves, q: Array, place: pin.SE3, lower: Array, upper: Array) -> Array:
    """Move joints of q (n,) that are beyond their limits back to them, with the frame at ``place``.

    Return the configuration (n,). The joints are moved in a few steps along the self-motion. If a
    step would move a joint by more than 0.3 rad or m, it is not taken, and the result has joints
    that are still beyond their limits.
    """
    for _ in range(_NEWTON):
        back = np.clip(q, lower, upper) - q
        beyond = np.abs(back) > _INSIDE / 2
        if not beyond.any():
            break
        N = nullspace(inverse.task.jacobian(q))
        way = N @ np.linalg.lstsq(N[beyond], back[beyond], rcond=None)[0]
        if np.abs(way).max() > _LONGEST:
            break
        q = _retracted(inverse, q + way, place)
    return q


def _limit_distance(q: Array, lower: Array, upper: Array) -> float:
    """Evaluate the smallest distance of q from the limits, rad or m; negative beyond a limit."""
    return float(np.minimum(q - lower, upper - q).min())


def _retracted(inverse: _OnLeaves, q: Array, place: pin.SE3) -> Array:
    """Bring the frame to ``place`` by Newton's method from q (n,), while the level c of q is kept.

    Return the configuration (n,). SingularityError is raised if the method does not converge.
    """
    for _ in range(_NEWTON):
        before, q = q, inverse.step(q, place, 1.0)
        if np.abs(q - before).max() < _EXACT:
            return q
    raise SingularityError(
        "the search for an elbow position cannot keep the frame at its pose; "
        "begin at another configuration"
    )


def _margin(inverse: _OnLeaves, q: Array) -> float:
    """Evaluate the leaf margin at q, the distance from an algorithmic singularity."""
    N = nullspace(inverse.task.jacobian(q))
    return float(leaf_margin(N, inverse.potentials.gradient(q)))


def _ratio(inverse: _OnLeaves, q: Array) -> float:
    """Evaluate the ratio of q; 0 if the inverse has no region Ω."""
    return 0.0 if inverse.region is None else float(inverse.region.ratio(q[None])[0])
