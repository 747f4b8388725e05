"""Arm angle: rotation of the elbow about the line from shoulder to wrist.

A potential is a function of the configuration q (n,) that a repeatable controller keeps constant. Q
(K, n) are K configurations.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..base.arguments import Array, as_configurations, as_numbers, require_type, shown, vector
from ..base.errors import InputError, SingularityError
from ..model.model import SHARED, frame_id
from ..model.several_frames import one_frame
from ..model.task import Task, require_task
from .basis import PotentialBasis

_SINGULAR = 1e-6


class ArmAngle(PotentialBasis):
    r"""The angle ψ of the elbow about the line from shoulder to wrist, as a potential.

    With ``e`` the elbow and ``w`` the wrist, seen from the shoulder, ``ŵ = w/‖w‖``, and a reference
    direction r:

    .. math:: \psi = \operatorname{atan2}\left(\hat w \cdot (y \times e),\; y \cdot e\right), \qquad
              y = r - \hat w (\hat w \cdot r) \quad\text{(conventional)},

    where y is the direction of ψ = 0. This conventional angle is singular at ŵ = ±r: the wrist is
    on the line through the shoulder along r. The stereographic angle (Elias and Wen, 2024) has
    ``y = ((ŵ − t) × r) × ŵ`` with t ⊥ r. It is singular only at ŵ = t: the wrist is on a half-line
    from the shoulder, which a choice of t keeps away from the arm's workspace.

    Parameters
    ----------
    task
        The task; its joints move the three frames.
    shoulder, elbow, wrist : str
        Frames of the task's chain.
    reference : (3,) array
        Reference direction r, in the base's axes.
    singular : (3,) array, optional
        Singular direction t of the stereographic angle, in the base's axes; its component
        perpendicular to r is used. Without t, the angle is the conventional one.

    Raises
    ------
    InputError
        If a frame is not on the task's chain, or a direction is zero.
    SingularityError
        If the angle is evaluated where it is singular, or where the arm is straight.

    Examples
    --------
    >>> frames = ("panda_link2", "panda_link4", "panda_link6")
    >>> psi = rp.ArmAngle(panda, *frames, reference=(0.0, 1.0, 0.0))
    >>> psi.values(np.array([panda.reference])).round(3)  # rad
    array([[1.571]])
    """

    n: int

    def __init__(
        self,
        task: Task,
        shoulder: str,
        elbow: str,
        wrist: str,
        reference: ArrayLike = (0.0, 0.0, 1.0),
        *,
        singular: ArrayLike | None = None,
    ) -> None:
        self.task, self.n = one_frame(require_task(task), "an arm angle"), task.n
        self.frames = tuple(
            require_type(name, str, "a frame of an arm angle", "a link's name")
            for name in (shoulder, elbow, wrist)
        )
        self._ids = [frame_id(task.model, name) for name in self.frames]
        self.reference = _unit(reference, "the reference direction")
        self.singular = None if singular is None else _unit(singular, "the singular direction")
        if self.singular is not None:
            across = self.singular - self.reference * (self.reference @ self.singular)
            if np.linalg.norm(across) < 0.1:
                raise InputError(
                    "singular= is parallel to reference=, within 6°; give a direction "
                    "perpendicular to reference="
                )
            self.singular = across / np.linalg.norm(across)

    @property
    def size(self) -> int:
        """Number of potentials, 1."""
        return 1

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the potential, in a tuple of length 1."""
        kind = "arm angle" if self.singular is None else "stereographic arm angle"
        return (f"{kind} {' '.join(self.frames)}",)

    def values(self, Q: ArrayLike) -> Array:
        """Evaluate ψ at every row of Q (K, n): (K, 1), rad, from −π to π.

        ψ is the angle of the elbow about the line from shoulder to wrist.
        """
        return np.array(
            [[self._angle(q)[0]] for q in as_configurations(Q, self.task.n, "an arm angle")]
        ).reshape(-1, 1)

    def gradients(self, Q: ArrayLike) -> Array:
        """Evaluate ∂ψ/∂q, the gradient of the arm angle, at every row of Q (K, n): (K, n, 1)."""
        Q = as_configurations(Q, self.task.n, "an arm angle")
        return np.array([self._angle(q)[1] for q in Q]).reshape(len(Q), self.task.n, 1)

    def distance(self, q: ArrayLike) -> float:
        """Compute the angle, rad, at q (n,) from ŵ to the nearest direction in which ψ is singular.

        ŵ points from the shoulder to the wrist. In all of a design's region, this angle should be
        well above 0.
        """
        w = self._points(vector(q, self.task.n, "q"))[1][0]
        w = w / np.linalg.norm(w)
        along = abs(w @ self.reference) if self.singular is None else w @ self.singular
        return float(np.arccos(np.clip(along, -1, 1)))

    def __str__(self) -> str:
        return self.names[0]

    def _points(self, q: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Evaluate the vectors e and w (3,), m, from the shoulder to the elbow and to the wrist.

        Return them with their Jacobians (3, n), all in base axes: ``((e, J_e), (w, J_w))``.
        """
        model, data = self.task.model, self.task._data
        q = self.task._vector(q)
        J = [
            self.task.drive.derivatives(pin.computeFrameJacobian(model, data, q, i, SHARED)[:3])
            for i in self._ids
        ]
        pin.framesForwardKinematics(model, data, q)
        p = [data.oMf[i].translation.copy() for i in self._ids]
        return (p[1] - p[0], J[1] - J[0]), (p[2] - p[0], J[2] - J[0])

    def _angle(self, q: Array) -> tuple[float, Array]:
        """Evaluate the arm angle ψ, rad, and its gradient (n,) at q (n,).

        A SingularityError is raised where the angle is not defined: the wrist on the shoulder, a
        straight arm, or the wrist in a singular direction.
        """
        (e, J_e), (w, J_w) = self._points(np.asarray(q, float))
        length = float(np.linalg.norm(w))
        if length < _SINGULAR:
            raise SingularityError(
                "the arm angle is not defined: the wrist coincides with the shoulder; "
                "choose another configuration"
            )
        w_hat = w / length
        dw_hat = (J_w - np.outer(w_hat, w_hat @ J_w)) / length
        y, dy = self._zero(w_hat)
        dy_q = dy @ dw_hat  # (3, n)
        s = float(w_hat @ np.cross(y, e))
        c = float(y @ e)
        if s**2 + c**2 < _SINGULAR**2:
            raise SingularityError(
                "the arm angle is singular: the arm is straight, or the wrist points "
                "in a singular direction; choose another configuration, or another singular="
            )
        ds = np.cross(y, e) @ dw_hat + np.cross(e, w_hat) @ dy_q + np.cross(w_hat, y) @ J_e
        dc = e @ dy_q + y @ J_e
        return float(np.arctan2(s, c)), (c * ds - s * dc) / (s**2 + c**2)

    def _zero(self, w_hat: Array) -> tuple[Array, Array]:
        """Evaluate the vector y (3,), in whose direction ψ = 0, and ∂y/∂ŵ (3, 3).

        ``w_hat`` is ŵ, the unit vector (3,) from the shoulder to the wrist. The angle ψ is counted
        from y, about ŵ. y is not normalised.
        """
        r, t = self.reference, self.singular
        if t is None:
            return r - w_hat * (w_hat @ r), -(w_hat @ r) * np.eye(3) - np.outer(w_hat, r)
        # k = (ŵ − t) × r, and y = k × ŵ: perpendicular to ŵ, 0 only at ŵ = t
        k, dk = np.cross(w_hat - t, r), -pin.skew(r)
        return np.cross(k, w_hat), -pin.skew(w_hat) @ dk + pin.skew(k)


def _unit(value: ArrayLike, what: str) -> Array:
    v = as_numbers(value)
    if v is None or v.shape != (3,) or not np.isfinite(v).all() or not np.linalg.norm(v) > 0:
        raise InputError(f"{what} must be three finite numbers, not all 0; got {shown(value)}")
    return v / np.linalg.norm(v)
