"""Control strategies of your own: a plain function q → G with J G = I, or (q, ẋ) → q̇."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array, positive, row, vector
from ..arguments import function as wanted_function
from ..errors import InputError
from ..robot.task import Task, own_task
from .pseudoinverse import at_rows, redundant


class CustomInverse:
    """``q̇ = G(q) ẋ`` (3) with a user-defined G.

    ``J G = I`` is checked at every evaluation: a G that breaks it would not follow the path it is
    given.

    Parameters
    ----------
    task
        The task to control.
    function
        q (n,) → G (n, m).
    tolerance : float
        Largest entry of ``J G − I`` that is accepted.

    Raises
    ------
    InputError
        If, at an evaluation, ``J G`` is not the identity or G has the wrong size.

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

    def __call__(self, q: ArrayLike) -> Array:
        """Evaluate G (n, m).

        Raises
        ------
        InputError
            If the function returns anything but an (n, m) matrix with ``J G = I``; the residual is
            named.
        """
        q = vector(q, self.task.n, "q")
        return self._checked(q, self.task.jacobian(q))

    def batch(self, Q: ArrayLike, J: Array | None = None) -> Array:
        """Evaluate G at every row of Q (K, n): (K, n, m)."""
        Q, J = at_rows(self.task, Q, J)
        return np.array([self._checked(q, J_q) for q, J_q in zip(Q, J, strict=True)]).reshape(
            len(Q), self.task.n, self.task.m
        )

    def velocity(self, q: ArrayLike, xdot: ArrayLike) -> Array:
        """Choose ``q̇ = G ẋ`` (n,)."""
        return self(q) @ vector(xdot, self.task.m, "ẋ", "m/s and rad/s")

    def _checked(self, q: Array, J: Array) -> Array:
        n, m = self.task.n, self.task.m
        try:
            G = np.array(self.function(q), dtype=float)
        except (TypeError, ValueError) as error:
            raise InputError(
                f"the function gives no {n} × {m} matrix G at q = {row(q)}: {error}"
            ) from error
        if G.shape != (n, m) or not np.isfinite(G).all():
            raise InputError(
                f"the function must give G as {n} × {m} finite numbers; at q = {row(q)} it does not"
            )
        residual = np.abs(J @ G - np.eye(m))
        if residual.max() > self.tolerance:
            a, b = np.unravel_index(int(residual.argmax()), residual.shape)
            raise InputError(
                f"J G = I is missed by {residual.max():.2g} (row {a}, column {b}) at q = {row(q)}; "
                "correct the function, for example G + J⁺ (I − J G)"
            )
        return G


class FunctionStrategy:
    """``q̇ = function(q, ẋ)``: what pink, Drake or a loop of your own would command.

    Parameters
    ----------
    task
        The task it controls; q is in the order of its joints.
    function
        q (n,), ẋ (m,) → q̇ (n,).
    """

    def __init__(self, task: Task, function: Callable[[Array, Array], ArrayLike]) -> None:
        self.task = own_task(task)
        self.function = wanted_function(
            function, "a strategy", "a function (q, ẋ) → q̇, or have a velocity(q, ẋ)", 2
        )

    def velocity(self, q: ArrayLike, xdot: ArrayLike) -> Array:
        """Ask the function for q̇ (n,).

        Raises
        ------
        InputError
            If it gives anything but n finite numbers.
        """
        q, xdot = vector(q, self.task.n, "q"), vector(xdot, self.task.m, "ẋ", "m/s and rad/s")
        try:
            qdot = np.asarray(self.function(q, xdot), float)
        except (TypeError, ValueError) as error:
            raise InputError(f"the strategy's function gives no q̇: {error}") from error
        if qdot.shape != (self.task.n,) or not np.isfinite(qdot).all():
            raise InputError(
                f"the strategy's function must give {self.task.n} finite numbers; it gave {qdot}"
            )
        return qdot
