r"""Taylor models of the gradient of an arm angle on boxes of joint positions.

A Taylor model is a polynomial with a bound on its error. Proofs need these models for designs whose
potential is an arm angle, the angle of the elbow about the line from shoulder to wrist.

The task has n joints, and k of them move the arm angle. They drive P joints of the URDF, because
one joint of a task can drive coupled joints. A box Q ± half contains the joint positions q with
``|q − Q| ≤ half``, rad or m; K is the number of boxes.

Let ``e`` and ``w`` be the elbow and the wrist relative to the shoulder, ``ρ = |w|`` and
``a = w × e``. Let three forces act on the arm: α at the elbow, β at the wrist, and −α − β at the
shoulder. The gradient of the arm angle equals the joint torques and forces that these three forces
cause. Each entry is the moment about a revolute joint's axis, or the force along a prismatic
joint's axis.

.. math::

   α = \frac{ρ\, a}{|a|^2}, \qquad β = -\frac{w · e}{ρ}\, \frac{a}{|a|^2} + \begin{cases}
   (w · r)\, (w × r) \,/\, (ρ\, |w × r|^2) & \text{(conventional)} \\
   (w × t) \,/\, (ρ\, (ρ - w · t)) & \text{(stereographic)} \end{cases}

The reference direction r defines the angle 0 of a conventional arm angle; t is the singular
direction of a stereographic one. docs/theory.md derives this.

``_GradientBounds`` are first-order expansions of the gradient of an arm angle on K boxes, with
their errors. ``ArmAngleChain`` is the joints that move shoulder, elbow and wrist of an arm angle,
and the weights of the angle.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ...base.arguments import Array, read_only
from ...base.errors import InputError
from ...model.joint_chain import joint_axes, joint_coupling
from ...native import ARM_ANGLE, filled_struct, required_library
from ...potentials.arm_angle import ArmAngle
from .taylor import basis, space_of

_MOST = 10
"""Most joints on which an arm angle may depend; arm_angle.c has room for their monomials."""

_U = 2.0**-52
"""Twice the unit roundoff of double precision."""


@dataclass(frozen=True, eq=False)
@read_only
class ArmAngleChain:
    """Joints that move the shoulder, elbow and wrist of an arm angle, and weights of the angle.

    An arm angle, the angle of the elbow about the line from shoulder to wrist, can be a potential
    of a design. The proof of such a design needs bounds on the gradient of the angle. The P joints
    of the chain are numbered from the base, from 0.

    Attributes
    ----------
    R, p, a : (P, 3, 3), (P, 3) and (P, 3) arrays
        Rotation and origin, m, of each joint in the frame of the preceding joint, and the direction
        of the joint's axis.
    before : (P,) array of int
        Number of the preceding joint of each joint; −1 for the base.
    revolute : (P,) array of bool
        False for prismatic joints.
    S, o : (P, n) and (P,) arrays
        Map ``θ = S q + o`` from the task's joints q to the positions θ of the P joints.
    joint, place : (3,) array of int and (3, 3) array
        Number of the last joint that moves the shoulder, the elbow and the wrist, −1 for the base.
        ``place`` has a row per point: its position, m, in the frame of that joint.
    direction : (3,) array
        Vector r of the conventional angle, or t of the stereographic angle, in base axes.
    stereographic : bool
        True if the angle is stereographic.
    weights : (r,) array
        Factor of the angle in each of the r potentials.
    """

    R: Array
    p: Array
    a: Array
    before: NDArray[np.int32]
    revolute: NDArray[np.bool_]
    S: Array
    o: Array
    joint: NDArray[np.int32]
    place: Array
    direction: Array
    stereographic: bool
    weights: Array

    @classmethod
    def of(cls, angle: ArmAngle, weights: Array) -> ArmAngleChain:
        """Create the chain of an arm angle; ``weights`` (r,) are its factors in the r potentials.

        An InputError is raised if the angle depends on no joint, or on more than 10.
        """
        model = angle.task.model
        data, neutral = model.createData(), pin.neutral(model)

        # the joints that move the points of the angle
        def screw(j: int) -> Array:
            J = pin.computeJointJacobian(model, data, neutral, j)
            return np.asarray(J[:, model.idx_vs[j]])

        carried = [_carried(model, model.frames[i], screw) for i in angle._ids]
        ids = sorted({int(i) for j, _ in carried for i in model.supports[j] if i > 0})
        at = {j: i for i, j in enumerate(ids)}
        axes, revolute = joint_axes(model, ids)
        # their chain, parents first
        placements = [model.jointPlacements[j] for j in ids]
        sideways = angle.singular
        chain = cls(
            np.array([x.rotation for x in placements]).reshape(-1, 3, 3),
            np.array([x.translation for x in placements]).reshape(-1, 3),
            axes,
            np.array([at.get(int(model.parents[j]), -1) for j in ids], np.int32),
            revolute,
            *joint_coupling(angle.task, ids),
            np.array([at.get(j, -1) for j, _ in carried], np.int32),
            np.array([place for _, place in carried]),
            angle.reference if sideways is None else sideways,
            sideways is not None,
            np.asarray(weights, float),
        )
        if not 0 < len(chain.moving) <= _MOST:
            raise InputError(
                f"nothing can be proved about {angle!r}: it depends on {len(chain.moving)} joints, "
                f"and a proof needs 1 to {_MOST}",
                remedy="define the angle by other links",
            )
        return chain

    @property
    def moving(self) -> NDArray[np.intp]:
        """Indices (k,), in q, of the task's joints that move the shoulder, the elbow or the wrist.

        Only these joints are variables of the Taylor models, whose size grows fast with k.
        """
        return np.flatnonzero((self.S != 0).any(axis=0))

    @property
    def carries(self) -> NDArray[np.bool_]:
        """Mask (P, 3): True where the joint (row) moves shoulder, elbow or wrist (column)."""
        found = np.zeros((len(self.p), 3), bool)
        for frame, joint in enumerate(self.joint):
            while joint >= 0:
                found[joint, frame] = True
                joint = self.before[joint]
        return found

    def gradient_bounds(self, Q: Array, half: Array) -> _GradientBounds:
        """Expand the gradient of the arm angle to first order on boxes Q ± half, (K, n) each.

        Boxes that differ only in joints that do not move the arm angle are evaluated once.
        """
        on = self.moving
        both = np.concatenate([Q[:, on], half[:, on]], axis=1)
        _, first, which = np.unique(both, axis=0, return_index=True, return_inverse=True)
        Q, half, which = Q[first], half[first], which.reshape(-1)
        P, r = self.models(Q[:, on], half[:, on])
        return _bounds(self, P[which], r[which], half[which])

    def models(self, Q: Array, half: Array) -> tuple[Array, Array]:
        """Compute Taylor models of degree 3 of the gradient, on boxes Q ± half, (K, k) each.

        The k joints are :attr:`moving`, and the variables are ``(q − Q) / half``. Return
        coefficients (K, k, M) and error bounds (K, k). Each box and each of the k entries of the
        gradient has one polynomial, with M coefficients and one error bound.
        """
        native, on, (K, k) = required_library("a proof"), self.moving, Q.shape
        space = space_of(k)
        ints = {name: getattr(self, name) for name in ("before", "revolute", "carries")}
        reals = {name: getattr(self, name) for name in ("R", "p", "a", "o", "place")}
        reals |= {"direction": self.direction, "S": self.S[:, on]}
        arm, _ = filled_struct(
            ARM_ANGLE,
            ints | {"joint": self.joint},
            reals | {"bases": [basis(axis) for axis in self.a]},
            {"space": space, "P": len(self.p), "stereographic": int(self.stereographic)},
        )
        P, r = np.zeros((K, k, space.M)), np.zeros((K, k))
        Q, half = np.ascontiguousarray(Q, float), np.ascontiguousarray(half, float)
        address = [ctypes.c_void_p(array.ctypes.data) for array in (Q, half, P, r)]
        done = native.arm_gradients(ctypes.byref(arm), ctypes.c_long(K), *address)
        if not done:
            raise MemoryError("no memory for the Taylor models of an arm angle")
        return P, r


def _carried(
    model: pin.Model, frame: pin.Frame, screw: Callable[[int], Array]
) -> tuple[int, Array]:
    """Find the last joint, from the base, that moves a frame's origin.

    Return two values: the joint's index in the Pinocchio model, or 0 if no joint moves the origin;
    and the position (3,) of the origin in the joint's frame, m. A revolute joint whose axis passes
    through the frame's origin does not move this origin. ``screw(joint)`` gives the twist (6,) of
    the joint with that index at unit speed, in the joint's own axes, linear part first.
    """
    joint, place = int(frame.parentJoint), np.array(frame.placement.translation)
    while joint > 0 and not np.cross(screw(joint)[3:], place).any():
        if not np.any(screw(joint)[3:]):
            break  # a prismatic joint
        placement = model.jointPlacements[joint]
        if place.any():
            place = placement.rotation @ place
        place = placement.translation + place
        joint = int(model.parents[joint])
    return joint, place


@dataclass(frozen=True, eq=False)
@read_only
class _GradientBounds:
    """First-order expansions of the gradient V (n,) of an arm angle on K boxes of joints.

    Attributes
    ----------
    V, dV : (K, n) and (K, n, n) arrays
        V at the centres of the boxes, and the derivatives there: ``dV[:, i, j]`` is ∂V_i/∂q_j.
    rest : (K, n) array
        Bounds on the difference of V from its first-order expansion, rounding included; inf where
        no bound was found.
    size : (K,) array
        Bound, for each box, on the largest entry of ``|V| + |∂V/∂q| half``. Rounding errors are
        stated relative to this bound.
    """

    V: Array
    dV: Array
    rest: Array
    size: Array


def _bounds(chain: ArmAngleChain, P: Array, r: Array, half: Array) -> _GradientBounds:
    """Convert Taylor models of the gradient to first-order expansions on boxes.

    ``P`` (K, k, M) are the coefficients of polynomials of degree 3 in ``(q − Q) / half``, one for
    each of the k joints that move the angle, and ``r`` (K, k) their error bounds; ``half`` (K, n)
    are the half-widths of the boxes. The M monomials are the constant, the k linear monomials, then
    the monomials of degree 2 and 3. The expansion omits the terms of degree 2 and 3; bounds on
    these terms are added to its error ``rest``.
    """
    on, (K, n) = chain.moving, half.shape
    V, dV, rest = np.zeros((K, n)), np.zeros((K, n, n)), np.zeros((K, n))
    k, h = len(on), half[:, None, on]
    with np.errstate(all="ignore"):
        slopes = np.where(h > 0, P[..., 1 : 1 + k] / h, 0.0)
        more = np.abs(P[..., 1 + k :]).sum(axis=-1) + r
        more += 2 * _U * np.abs(P).sum(axis=-1)
        size = (np.abs(P).sum(axis=-1) + r).max(axis=1, initial=0.0)
    bad = ~(np.isfinite(more).all(axis=1) & np.isfinite(slopes).all(axis=(1, 2)))
    more[bad], size[bad], slopes[bad] = np.inf, np.inf, 0.0
    V[:, on], rest[:, on] = P[..., 0], more
    dV[:, on[:, None], on] = slopes
    return _GradientBounds(V, dV, rest, size)
