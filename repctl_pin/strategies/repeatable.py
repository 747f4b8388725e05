"""A repeatable inverse: the motions of G_r keep h(q) constant, so every closed path closes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgesv

from ..errors import SingularityError
from ..fields.field import FieldMap
from ..redundancy.augmented import augmented_inverse
from ..robot.task import Task

Array = NDArray[np.float64]


class RepeatableInverse:
    """``q̇ = G_r ẋ`` with G_r the first m columns of ``[J; Vᵀ]⁻¹`` (31), (37), ``V = ∂hᵀ/∂q``.

    Parameters
    ----------
    task
        The task to control.
    field
        r potentials h; their common level sets are the leaves on which the motion stays.
    """

    def __init__(self, task: Task, field: FieldMap) -> None:
        self.task, self.field = task, field
        self._J_V = np.empty((task.n, task.n), order="F")
        self._rhs = np.zeros(task.n)

    def __call__(self, q: Array) -> Array:
        """Evaluate G_r (n, m)."""
        return augmented_inverse(self.task.jacobian(q), self.field.gradient(np.asarray(q, float)))[:, : self.task.m]

    def batch(self, Q: Array, J: Array | None = None) -> Array:
        """Evaluate G_r at every row of Q (K, n): (K, n, m)."""
        J = self.task.jacobians(Q) if J is None else J
        return augmented_inverse(J, self.field.gradients(Q))[:, :, : self.task.m]

    def velocity(self, q: Array, xdot: Array) -> Array:
        """Choose q̇ (n,) with ``J q̇ = ẋ`` and ``Vᵀ q̇ = 0``.

        Raises
        ------
        SingularityError
            Where J_V is singular.
        """
        m, J_V, rhs = self.task.m, self._J_V, self._rhs
        J_V[:m] = self.task.jacobian(q)
        J_V[m:] = self.field.gradient(q).T
        rhs[:m] = xdot
        _, _, qdot, info = dgesv(J_V, rhs)
        if info:
            raise SingularityError("the augmented Jacobian J_V is singular")
        return qdot

    def __getstate__(self) -> dict:
        return {"task": self.task, "field": self.field}

    def __setstate__(self, state: dict) -> None:
        RepeatableInverse.__init__(self, state["task"], state["field"])
