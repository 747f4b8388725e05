"""Lower bounds on pairwise body distances, batched over configurations (broad phase)."""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arguments import Array

Index = NDArray[np.intp]


class JointPlacements:
    r"""Batched forward kinematics of joints, by array arithmetic.

    With P_j the placement of joint j on its parent and u its axis, a revolute joint has

    .. math:: R_j = P_j (1 + \sin q \, [u] + (1 - \cos q) \, [u]^2),

    and a prismatic joint translates by q u. Pinocchio evaluates one configuration in a microsecond,
    but reading each placement from Python takes two.

    Parameters
    ----------
    model
        Model whose joints have one coordinate each.
    """

    def __init__(self, model: pin.Model) -> None:
        data, self._parents = model.createData(), [int(parent) for parent in model.parents]
        here = model.jointPlacements
        pin.forwardKinematics(model, data, np.ones(model.nq))
        moved = [
            pin.log6(place.actInv(now)).vector for place, now in zip(here, data.liMi, strict=True)
        ]
        self._slides = np.array(
            [twist[:3] for twist in moved]
        )  # q u, at q = 1; 0 for revolute joints
        crosses = [pin.skew(twist[3:]) for twist in moved]
        self._fixed = np.array([place.homogeneous for place in here])
        P = self._fixed[:, :3, :3]
        self._sin = P @ np.array(crosses)
        self._cos = self._sin @ np.array(crosses)

    def __call__(self, Q: Array) -> tuple[Array, Array]:
        """Compute the placements of joints at every row of Q (K, N).

        Returns rotations (K, N + 1, 3, 3) and origins (K, N + 1, 3), m."""
        K, N = Q.shape
        R, p = np.empty((K, N + 1, 3, 3)), np.zeros((K, N + 1, 3))
        R[:, 0] = np.eye(3)
        sin, versine = np.sin(Q)[:, :, None, None], (1 - np.cos(Q))[:, :, None, None]
        for j in range(1, N + 1):
            parent, P, o = self._parents[j], self._fixed[j, :3, :3], self._fixed[j, :3, 3]
            turn = P + sin[:, j - 1] * self._sin[j] + versine[:, j - 1] * self._cos[j]
            step = o + Q[:, j - 1, None] * (P @ self._slides[j])
            np.matmul(R[:, parent], turn, out=R[:, j])
            p[:, j] = p[:, parent] + (R[:, parent] @ step[:, :, None])[:, :, 0]
        return R, p


_TELLING = 1e-6
"""Minimum distance between two centres at which their direction is well defined, m."""


class BodyBounds:
    """Lower bounds on the distances of pairs of convex bodies, from bounding spheres and boxes.

    With c the centres of two bodies and u = (c_a − c_b) / |c_a − c_b|, the body distance is at
    least

        |c_a − c_b| − h_a(u) − h_b(u),

    where h(u) is the extent along u of the bounding sphere, or of the bounding box with half-widths
    w: Σ w_i |(Rᵀ u)_i|.

    Parameters
    ----------
    model
        Model whose joints move the bodies; they have one coordinate each.
    joint
        Parent joint of each body (B,); 0 if it is fixed to the root.
    place
        Placement of each body on its parent joint.
    bodies
        Bodies with computed bounding boxes.
    pairs
        Pairs (P, 2) of bodies.
    """

    def __init__(
        self,
        model: pin.Model,
        joint: Sequence[int],
        place: Sequence[pin.SE3],
        bodies: Sequence[coal.CollisionGeometry],
        pairs: Index,
    ) -> None:
        self._joints, self._joint = JointPlacements(model), np.array(joint, np.intp)
        centers = [at.act(body.aabb_center) for at, body in zip(place, bodies, strict=True)]
        boxes = [body.aabb_local for body in bodies]
        self._centers = np.array(centers).reshape(-1, 3)
        self._radii = np.array([body.aabb_radius for body in bodies])
        self._turns = np.array([at.rotation for at in place]).reshape(-1, 3, 3)
        self._half = np.array([(box.max_ - box.min_) / 2 for box in boxes]).reshape(-1, 3)
        self._first, self._second = pairs.T
        self._rows, row = np.unique(self._first, return_inverse=True)
        self._columns, column = np.unique(self._second, return_inverse=True)
        self._flat = row * len(self._columns) + column
        self._reach = self._radii[self._first] + self._radii[self._second]

    @property
    def size(self) -> int:
        """Number of doubles in memory per configuration."""
        return len(self._rows) * len(self._columns)

    def __call__(self, Q: Array) -> Array:
        """Bound the distance of every pair at Q (K, N): (K, P), m.

        Boxes are used only where spheres do not exclude a collision."""
        R, p = self._joints(Q)
        centers = np.einsum("kbij,bj->kbi", R[:, self._joint], self._centers) + p[:, self._joint]
        squares = np.einsum("kbi,kbi->kb", centers, centers)
        products = centers[:, self._rows] @ centers[:, self._columns].swapaxes(1, 2)
        products = products.reshape(len(Q), -1)[:, self._flat]  # (K, P)
        gaps = squares[:, self._first] + squares[:, self._second] - 2 * products
        gaps = np.sqrt(np.maximum(gaps, 0.0, out=gaps), out=gaps)
        bounds = gaps - self._reach
        k, pair = np.nonzero((bounds < gaps.min(axis=1, keepdims=True) / 2) & (gaps > _TELLING))
        a, b = self._first[pair], self._second[pair]
        u = centers[k, a] - centers[k, b]
        gap = np.sqrt(np.einsum("mi,mi->m", u, u))
        u /= gap[:, None]
        bounds[k, pair] = gap - self._extent(R, k, a, u) - self._extent(R, k, b, u)
        return bounds

    def _extent(self, R: Array, k: Index, body: Index, u: Array) -> Array:
        """Bound the extent of bodies (M,) from their centres along u (M, 3), m.

        ``k`` (M,) are the numbers of their configurations."""
        local = np.einsum("mij,mi->mj", R[k, self._joint[body]], u)
        box = np.abs(np.einsum("mij,mi->mj", self._turns[body], local))
        return np.minimum(self._radii[body], np.einsum("mi,mi->m", box, self._half[body]))
