"""Placements of all joints of a model at many configurations at once."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ..arguments import Array


class JointPlacements:
    r"""Forward kinematics over a batch, by array arithmetic.

    With P_j the place of joint j on its parent and u its axis, a joint that turns has

    .. math:: R_j = P_j (1 + \sin q \, [u] + (1 - \cos q) \, [u]^2),

    one that slides moves by q u. Pinocchio places one configuration in a microsecond, but each placement that is read
    from Python costs two.

    Parameters
    ----------
    model
        Whose joints are all of one number.
    """

    def __init__(self, model: pin.Model) -> None:
        data, self._parents = model.createData(), [int(parent) for parent in model.parents]
        here = model.jointPlacements
        pin.forwardKinematics(model, data, np.ones(model.nq))
        moved = [pin.log6(place.actInv(now)).vector for place, now in zip(here, data.liMi, strict=True)]
        self._slides = np.array([twist[:3] for twist in moved])  # q u, at q = 1; 0 where a joint turns
        crosses = [pin.skew(twist[3:]) for twist in moved]
        self._fixed = np.array([place.homogeneous for place in here])
        P = self._fixed[:, :3, :3]
        self._sin = P @ np.array(crosses)
        self._cos = self._sin @ np.array(crosses)

    def __call__(self, Q: Array) -> tuple[Array, Array]:
        """Place the joints at every row of Q (K, N): rotations (K, N + 1, 3, 3) and origins (K, N + 1, 3), m."""
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
