"""User-defined control strategies: a function q → G with J G = I, or (q, ẋ) → q̇."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array, evaluated, positive, row, vector
from ..base.arguments import function as wanted_function
from ..base.errors import InputError
from ..model.task import Task, own_task
from .pseudoinverse import at_rows, redundant
from .strategy import described


class CustomInverse:
    """``q̇ = G(q) ẋ`` with a user-defined matrix G.

    ``J G = I`` is checked at every evaluation: otherwise the frame does not move with ẋ.

    Parameters
    ----------
    task
        The task to control.
    function
        Function q (n,) → G (n, m).
    tolerance : float
        Maximum absolute entry of ``J G − I``.

    Raises
    ------
    InputError
        If ``J G`` is not the identity, or G has the wrong size, where it is evaluated.

    Examples
    --------
    >>> G = rp.CustomInverse(task, lambda q: np.linalg.pinv(task.jacobian(q)))
    >>> np.allclose(G(q0), control(q0))
    True
    """

    def __init__(
        self, task: Task, function: Callable[[Array], ArrayLike], *, tolerance: float = 1e-8
    ) -> None:
        self.task = redundant(task)
        self.function = wanted_function(function, "function", "a function q → G")
        self.tolerance = positive(tolerance, "the tolerance of J G = I")

    def __repr__(self) -> str:
        return described(self, self.task)

    def __call__(self, q: ArrayLike) -> Array:
        """Evaluate the user's matrix G (n, m) at q (n,), and check J G = I.

        Raises
        ------
        InputError
            If the function does not return an (n, m) matrix with ``J G = I``; the message gives the
            residual.
        """
        q = vector(q, self.task.n, "q")
        return self._checked(q, self.task.jacobian(q))

    def batch(self, Q: ArrayLike, J: ArrayLike | None = None) -> Array:
        """Evaluate the user's G at every row of Q (K, n): (K, n, m).

        J (K, m, n) are the Jacobians at these rows, if they are known already.
        """
        Q, J = at_rows(self.task, Q, J)
        G = np.array([self._checked(q, J_q) for q, J_q in zip(Q, J, strict=True)])
        return G.reshape(len(Q), self.task.n, self.task.m)

    def velocity(self, q: ArrayLike, xdot: ArrayLike) -> Array:
        """Compute ``q̇ = G ẋ`` (n,) with the user's G, for a task velocity ẋ (m,)."""
        return self(q) @ vector(xdot, self.task.m, "ẋ", "m/s and rad/s")

    def _checked(self, q: Array, J: Array) -> Array:
        """Evaluate the user's G (n, m) at q (n,), and check it against the Jacobian J (m, n).

        InputError is raised if G has another shape, or if J G differs from I.
        """
        n, m = self.task.n, self.task.m
        G = evaluated(self.function, q, (n, m), "the function's matrix G")
        residual = np.abs(J @ G - np.eye(m))
        if residual.max() > self.tolerance:
            a, b = np.unravel_index(int(residual.argmax()), residual.shape)
            raise InputError(
                f"the function's G is no inverse: J G differs from I by {residual.max():.2g} in "
                f"row {a}, column {b}, at q = {row(q)}; correct the function, for example by "
                "returning G + J⁺ (I − J G)"
            )
        return G


class FunctionStrategy:
    """``q̇ = function(q, ẋ)``: a controller of another package, such as pink or Drake.

    As a strategy, the function can be passed to :func:`follow`, which computes its drift.

    Parameters
    ----------
    task
        Task to control; q is in the order of its joints.
    function
        Function of q (n,) and ẋ (m,) that returns q̇ (n,).
    """

    def __init__(self, task: Task, function: Callable[[Array, Array], ArrayLike]) -> None:
        self.task = own_task(task)
        self.function = wanted_function(
            function, "a strategy", "a function (q, ẋ) → q̇, or have a velocity(q, ẋ)", 2
        )

    def velocity(self, q: ArrayLike, xdot: ArrayLike) -> Array:
        """Evaluate the user's function at q (n,) and ẋ (m,): q̇ (n,).

        Raises
        ------
        InputError
            If the function does not return n finite numbers.
        """
        n = self.task.n
        q = vector(q, n, "q")
        xdot = vector(xdot, self.task.m, "ẋ", "m/s and rad/s")
        return evaluated(self.function, q, (n,), "the strategy's q̇", xdot)
