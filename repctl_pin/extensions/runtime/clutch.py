r"""Clutch of teleoperation: from an operator's hand and elbow to targets of the arm.

While the clutch is engaged, the arm's target moves with the operator's hand. While the clutch is
released, there is no target, and the hand can move freely. A governor moves the arm to the target;
a level is the position of the arm's elbow along the self-motion. A tracker measures the poses of
the operator's hand and elbow, in a frame of its own. Poses of the arm are in its base frame.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...base.arguments import Array, as_numbers, positive, shown
from ...base.errors import InputError
from ...model.chain_formulas import Placement, as_placement, is_rotation, require_rotation

_TURN = 2 * np.pi


_MOST = 5.0
"""Rotation of the target per scaled rotation of the hand, beyond which the clutch is released."""


class Clutch:
    r"""Clutch that moves the target of an arm with a hand while engaged, never with a jump.

    Let (p_h, R_h) be the pose of the hand in the frame of its tracker. When the clutch was engaged,
    the hand was at (p_h0, R_h0), and the arm's frame at (p_0, R_0) in the base frame. The target,
    in the base frame, is

    .. math:: p = p_0 + s\,B\,(p_h - p_{h0}), \qquad
              R = \exp(\rho\,B \log(R_h R_{h0}^T))\,R_0

    with the rotation B from the tracker's axes to those of the base. So the first target is the
    arm's own pose. The point for the arm's elbow moves with the operator's elbow as p moves with
    the hand.

    The logarithm is continued beyond half a turn. Near full turns, it is continuous only if the
    hand turns about one axis. So, if ρ is not an integer, the clutch is released where the target
    would turn by more than 5 ρ times the rotation of the hand since the last pose.

    Parameters
    ----------
    scale
        Factor s of translations, m per m.
    rotation_scale
        Factor ρ of rotations, rad per rad; 0 holds the rotation.
    axes
        Rotation B (3, 3) from the tracker's axes to those of the arm's base; None for I.

    Raises
    ------
    InputError
        If a scale is negative, or ``axes`` is not a rotation.

    Examples
    --------
    >>> clutch = rp.Clutch(scale=0.5)
    >>> clutch.engage(task.placement(q0), task.placement(q0 + 0.1))
    >>> target = clutch.target(task.placement(q0))
    >>> bool((target.translation == task.placement(q0 + 0.1).translation).all())
    True
    """

    def __init__(
        self, *, scale: float = 1.0, rotation_scale: float = 1.0, axes: ArrayLike | None = None
    ) -> None:
        self._scale = positive(scale, "scale", "", zero=True)
        self._turned = positive(rotation_scale, "rotation_scale", "", zero=True)
        self._axes = np.eye(3) if axes is None else _axes(axes)
        self._start: tuple[pin.SE3, pin.SE3] | None = None
        self._elbows: tuple[Array, Array] | None = None

    def __repr__(self) -> str:
        state = "engaged" if self.engaged else "released"
        return f"<Clutch of scale {self._scale:g}, {state}>"

    @property
    def engaged(self) -> bool:
        """True while the target moves with the hand.

        That is from :meth:`engage` until :meth:`release`, or until :meth:`target` returns None.
        """
        return self._start is not None

    def engage(
        self,
        hand: Placement,
        at: Placement,
        *,
        elbow: ArrayLike | None = None,
        elbow_at: ArrayLike | None = None,
    ) -> None:
        """Begin to follow the operator's hand and, if given, the operator's elbow.

        Parameters
        ----------
        hand : pinocchio.SE3 or (4, 4) array
            Pose of the operator's hand, in the tracker's frame.
        at : pinocchio.SE3 or (4, 4) array
            Commanded pose of the arm's frame, in the base frame: ``task.placement(governor.q)``.
            The clutch is released if this pose or ``hand`` is not finite, or has no rotation
            matrix.
        elbow : (3,) array, optional
            Position of the operator's elbow, in the tracker's frame, m. Without it,
            :meth:`elbow` returns None.
        elbow_at : (3,) array, optional
            Commanded position of the arm's elbow, in the base frame, m:
            ``inverse.elbow(governor.q)``. Give both elbows or none; if one is not finite, both are
            ignored.
        """
        hand, at = as_placement(hand, "hand"), as_placement(at, "at")
        if (elbow is None) != (elbow_at is None):
            raise InputError("elbow and elbow_at require each other; give both or none")
        self._start = (hand, at) if _usable(hand) and _usable(at) else None
        self._elbows = None
        if elbow is not None and elbow_at is not None:
            elbows = _point(elbow, "elbow"), _point(elbow_at, "elbow_at")
            self._elbows = elbows if np.isfinite(elbows).all() else None
        self._angle = np.zeros(3)
        self._last = hand, np.eye(3)

    def release(self) -> None:
        """Release hand and elbow: there is no target until the clutch is engaged again."""
        self._start = self._elbows = None

    def target(self, hand: Placement) -> pin.SE3 | None:
        """Compute the target of the arm, in its base frame, for a pose of the operator's hand.

        ``hand`` is in the tracker's frame. The result is None while the clutch is released. A pose
        that is not finite, or has no rotation matrix, releases the clutch, so that the arm does not
        jump when the tracker finds the hand again. While there is no target, call
        ``governor.step(None)``, which stops the arm.
        """
        hand = as_placement(hand, "hand")
        if self._start is None or not _usable(hand):
            self.release()
            return None
        hand_0, at = self._start
        way = self._axes @ (hand.translation - hand_0.translation)
        turn = pin.exp3(self._turned * (self._axes @ self._rotation(hand, hand_0)))
        if self._jumps(hand, turn):
            self.release()
            return None
        return pin.SE3(turn @ at.rotation, at.translation + self._scale * way)

    def elbow(self, elbow: ArrayLike) -> Array | None:
        """Compute the point (3,) for the arm's elbow, m, in the base frame.

        The result is None while the elbow is released. ``elbow`` (3,) is the operator's elbow, in
        the tracker's frame, m. Pass the result to :meth:`RepeatableInverse.leaf_toward` as its
        argument ``elbow``. A point that is not finite releases the elbow alone, until
        :meth:`engage`; the level then stays constant.
        """
        point = _point(elbow, "elbow")
        if self._start is None or self._elbows is None or not np.isfinite(point).all():
            self._elbows = None
            return None
        begin, at = self._elbows
        return np.asarray(at + self._scale * (self._axes @ (point - begin)))

    def _jumps(self, hand: pin.SE3, turn: Array) -> bool:
        """Test whether the target turned over 5 ρ times as far as the hand since the last pose.

        The result is always False if ρ is an integer. ``hand`` is the pose of the hand, ``turn``
        (3, 3) the rotation of the target since the clutch was engaged; both are stored for the next
        call.
        """
        last_hand, last_turn = self._last
        self._last = hand, turn
        if self._turned == round(self._turned):
            return False  # full turns change nothing
        step = float(np.linalg.norm(pin.log3(hand.rotation @ last_hand.rotation.T)))
        change = float(np.linalg.norm(pin.log3(turn @ last_turn.T)))
        return change > _MOST * self._turned * step + 1e-6

    def _rotation(self, hand: pin.SE3, hand_0: pin.SE3) -> Array:
        """Compute the rotation of the hand from the pose ``hand_0`` as a rotation vector (3,), rad.

        The result is log(R_h R_h0ᵀ) plus full turns, chosen such that it continues the last vector.
        So the target does not jump when the hand has turned by half a turn.
        """
        if (hand.rotation == hand_0.rotation).all():
            angle: Array = np.zeros(3)
        else:
            angle = pin.log3(hand.rotation @ hand_0.rotation.T)
        size = float(np.linalg.norm(angle))
        last = float(np.linalg.norm(self._angle))
        axis = angle / size if size > 1e-6 else self._angle / max(last, 1e-300)
        turns = np.round((self._angle @ axis - size) / _TURN) if last > np.pi / 2 else 0.0
        self._angle = angle + _TURN * turns * axis
        return self._angle


def _usable(place: pin.SE3) -> bool:
    """Test whether all numbers of a placement are finite, and its rotation is a rotation matrix."""
    finite = bool(np.isfinite(place.translation).all())
    return finite and is_rotation(place.rotation.ravel().tolist())


def _point(value: ArrayLike, name: str) -> Array:
    """Convert a point to an array (3,); its numbers need not be finite.

    An InputError that calls the argument ``name`` is raised unless there are three numbers.
    """
    point = as_numbers(value)
    if point is None or point.shape != (3,):
        raise InputError(f"must be 3 numbers, m; got {shown(value)}", argument=name)
    return point


def _axes(value: ArrayLike) -> Array:
    """Convert the argument ``axes`` to a rotation (3, 3); InputError for any other matrix."""
    axes = as_numbers(value)
    if axes is None or axes.shape != (3, 3):
        raise InputError(f"must be a 3 × 3 rotation matrix; got {shown(value)}", argument="axes")
    require_rotation(axes, "axes")
    return axes
