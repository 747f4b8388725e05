"""How near two bodies can be at least: a bound from below that costs little, for all pairs at many
configurations."""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arguments import Array

Index = NDArray[np.intp]


class JointPlacements:
    r"""Forward kinematics over a batch, by array arithmetic.

    With P_j the place of joint j on its parent and u its axis, a joint that turns has

    .. math:: R_j = P_j (1 + \sin q \, [u] + (1 - \cos q) \, [u]^2),

    one that slides moves by q u. Pinocchio places one configuration in a microsecond, but each
    placement that is read from Python costs two.

    Parameters
    ----------
    model
        Whose joints are all of one number.
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
        )  # q u, at q = 1; 0 where a joint turns
        crosses = [pin.skew(twist[3:]) for twist in moved]
        self._fixed = np.array([place.homogeneous for place in here])
        P = self._fixed[:, :3, :3]
        self._sin = P @ np.array(crosses)
        self._cos = self._sin @ np.array(crosses)

    def __call__(self, Q: Array) -> tuple[Array, Array]:
        """Place the joints at every row of Q (K, N): rotations (K, N + 1, 3, 3) and origins (K, N +
        1, 3), m."""
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
"""Distance, m, of two bodies' centres from which on the direction between them is known."""


class BodyBounds:
    """Bounds the distances of pairs of convex bodies from below, by balls and boxes round them.

    With c the centres of two bodies and u = (c_a − c_b) / |c_a − c_b|, no two points of theirs are
    nearer than

        |c_a − c_b| − h_a(u) − h_b(u),

    where h(u) is how far along u the ball round a body reaches, or the box with half-widths w: Σ
    w_i |(Rᵀ u)_i|.

    Parameters
    ----------
    model
        Whose joints carry the bodies, all of one number.
    joint
        The joint that carries each body (B,); 0 where none does.
    place
        The place of each body on it.
    bodies
        The bodies, their boxes known.
    pairs
        The pairs (P, 2) of them.
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
        """Numbers that a configuration takes in memory."""
        return len(self._rows) * len(self._columns)

    def __call__(self, Q: Array) -> Array:
        """Bound every pair at the model's joints Q (K, N): (K, P), m; by boxes only where balls
        leave it near."""
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
        """How far bodies (M,) at configurations k (M,) reach at most from their centres along u (M,
        3), m."""
        local = np.einsum("mij,mi->mj", R[k, self._joint[body]], u)
        box = np.abs(np.einsum("mij,mi->mj", self._turns[body], local))
        return np.minimum(self._radii[body], np.einsum("mi,mi->m", box, self._half[body]))
