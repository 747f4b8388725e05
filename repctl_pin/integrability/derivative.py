"""∂G/∂q of any inverse: exact where the arm's Hessian gives it, by differences with an error where not."""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch

import numpy as np

from ..arguments import Array, wanted
from ..fields.field import CurvedMap
from ..redundancy.augmented import augmented_inverse
from ..redundancy.inverses import pseudoinverse_derivative
from ..robot.length import joint_scale
from ..robot.task import Task
from ..strategies.pseudoinverse import Pseudoinverse
from ..strategies.repeatable import RepeatableInverse
from ..strategies.strategy import AN_INVERSE, Batched, Inverse
from .differences import differentiate

_EPS = np.finfo(float).eps


@dataclass(frozen=True)
class Derivative:
    """An inverse and its derivative at K configurations.

    Attributes
    ----------
    J : (K, m, n) array
    G : (K, n, m) array
    dG : (K, n, m, n) array
        ``[:, i, a, k] = ∂G[i, a]/∂q[k]``.
    error : (K, n) array
        Estimated largest error of any entry of ∂G/∂q_k, a prismatic joint's row in units of the arm's length.
    exact : bool
        True where a formula was evaluated and only rounding is left.
    """

    J: Array
    G: Array
    dG: Array
    error: Array
    exact: bool


@singledispatch
def derivative(strategy: Inverse, Q: Array) -> Derivative:
    """Differentiate an inverse at every row of Q (K, n), by differences unless its kind has a formula.

    Raises
    ------
    InputError
        If the strategy is no inverse: it has no G(q).
    SingularityError
        If a row of Q is singular.
    """
    wanted_inverse(strategy)
    J, L = strategy.task.jacobians(Q), joint_scale(strategy.task, Q[0])[:, None]
    dG, error = differentiate(lambda P: strategy.batch(P) / L, Q, inside_limits(strategy.task, Q))
    dG *= L[..., None]
    return Derivative(J, strategy.batch(Q, J), dG, error, exact=False)


@derivative.register
def _(strategy: Pseudoinverse, Q: Array) -> Derivative:
    J = strategy.task.jacobians(Q)
    dG = pseudoinverse_derivative(J, strategy.task.hessians(Q))
    G = strategy.batch(Q, J)
    return Derivative(J, G, dG, _rounding(J, dG, joint_scale(strategy.task, Q[0])), exact=True)


@derivative.register
def _(strategy: RepeatableInverse, Q: Array) -> Derivative:
    """``∂G_r/∂q_k = −J_V⁻¹ [H_k; (∂V/∂q_k)ᵀ] G_r``, from ``∂J_V⁻¹ = −J_V⁻¹ ∂J_V J_V⁻¹``."""
    field, m = strategy.field, strategy.task.m
    if not isinstance(field, CurvedMap):  # potentials without second derivatives
        return derivative.dispatch(object)(strategy, Q)
    J = strategy.task.jacobians(Q)
    inverse = augmented_inverse(J, field.gradients(Q))  # (K, n, n)
    G = inverse[:, :, :m]
    dV = np.array([field.hessian(q) for q in Q])  # (K, n, n, r)
    dJ_V = np.concatenate([strategy.task.hessians(Q), np.moveaxis(dV, -1, 1)], axis=1)  # (K, n, n, n)
    dG = -np.einsum("Kis,Kspk,Kpa->Kiak", inverse, dJ_V, G, optimize=True)
    J_V = np.concatenate([J, np.swapaxes(field.gradients(Q), 1, 2)], axis=1)
    return Derivative(J, G, dG, _rounding(J_V, dG, joint_scale(strategy.task, Q[0])), exact=True)


def inside_limits(task: Task, Q: Array) -> Array:
    """Choose the scale of a derivative's steps at every row of Q: a joint's unit, and less near a limit: (K, n).

    The first step, 1/16 of it, takes no joint further than half the way to its limit; outside limits, where G may be
    asked for all the same, nothing is changed.
    """
    room = task.limit_margin(Q)  # (K, n)
    with np.errstate(divide="ignore"):
        most = np.min(np.where(room > 0, 8 * room, np.inf)[:, :, None] / np.abs(task.T), axis=1)
    return np.minimum(joint_scale(task, Q[0]), most)


def wanted_inverse(strategy: Inverse) -> Inverse:
    """Take an argument that has to be an inverse, with a G(q)."""
    wanted(strategy, Batched, "strategy", AN_INVERSE)
    return strategy


def _rounding(matrix: Array, dG: Array, L: Array) -> Array:
    """Rounding error of a formula that inverts a matrix (K, a, b), along every joint, in their units L: (K, n)."""
    values = np.linalg.svd(matrix * L, compute_uv=False)
    condition = values[:, 0] / values[:, -1]
    largest = np.abs(dG / L[:, None, None]).max(axis=(1, 2))
    return 4 * _EPS * matrix.shape[-1] * condition[:, None] * largest
