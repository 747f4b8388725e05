"""Protocols of control strategies, velocities and inverses G(q); the result of a control step.

A strategy is a controller: it gives the joint velocities q̇ (n,) for a task velocity ẋ (m,).
J (m, n) is the Jacobian of the task.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from ..base.arguments import Array, read_only
from ..model.task import Task

AN_INVERSE = (
    "an inverse q̇ = G(q) ẋ, such as rp.Pseudoinverse(task) or design.inverse; "
    "rp.CustomInverse(task, function) makes one of a function q → G"
)
"""Text of error messages where an inverse is required: what to pass instead."""


@dataclass(frozen=True, eq=False)
@read_only
class Step:
    """One step of a control loop: the next configuration, and how the step was damped and scaled.

    Attributes
    ----------
    q : (n,) array
        Next configuration.
    damping : float
        Damping λ of the step, in the units of J; 0 if it was solved exactly.
    slowed : float
        Factor by which the step was scaled down to the speed limits; 1 if it was not.
    """

    q: Array
    damping: float = 0.0
    slowed: float = 1.0


@runtime_checkable
class Strategy(Protocol):
    """A control strategy: joint velocities for a task velocity.

    :func:`follow` integrates any object with the attribute ``task`` and the method ``velocity``, a
    user's too.
    """

    @property
    def task(self) -> Task:
        """Task that is controlled."""

    def velocity(self, q: Array, xdot: Array) -> Array:
        """Compute q̇ (n,) for a task velocity ẋ (m,), rad/s or m/s."""


def described(strategy: object, task: Task, details: str = "") -> str:
    """Format the repr of a strategy, such as ``<Pseudoinverse of panda panda_hand pose: details>``.

    The text names the robot, the frame and the kind of its task.
    """
    of = f"{type(strategy).__name__} of {task.robot.name} {task.frame} {task.kind}"
    return f"<{of}: {details}>" if details else f"<{of}>"


@runtime_checkable
class Inverse(Strategy, Protocol):
    """A strategy of the form ``q̇ = G(q) ẋ`` (3) with ``J G = I``.

    Repeatability tests and designs need the matrix G itself, not only velocities.
    """

    def __call__(self, q: Array) -> Array:
        """Evaluate the matrix G (n, m) of ``q̇ = G ẋ`` at q (n,)."""

    def batch(self, Q: Array, J: Array | None = None) -> Array:
        """Evaluate G at every row of Q (K, n): (K, n, m).

        J (K, m, n) are the Jacobians at these rows, if they are known already.
        """
