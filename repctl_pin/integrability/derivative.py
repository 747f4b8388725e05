"""Derivative ∂G/∂q of an inverse, by a formula or by differences with an error estimate.

An inverse G (n, m) of the Jacobian J (m, n) has J G = I; J⁺ is the pseudoinverse. A repeatable
inverse keeps r potentials, functions h(q), constant. An argument ``strategy`` is the inverse G.
Noise is the irregular error of computed values of a function, mostly rounding.
Letters: n joints, m task coordinates, K configurations.

``_Derivative`` is an inverse G and its derivative ∂G/∂q at K configurations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import singledispatch

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import Array, read_only, require_type
from ..base.errors import SingularityError
from ..model.length import joint_scale
from ..model.task import Task
from ..potentials.basis import CurvedPotentials
from ..redundancy.augmented import augmented_inverse
from ..redundancy.inverses import pseudoinverse_derivative
from ..strategies.pseudoinverse import Pseudoinverse, WeightedInverse
from ..strategies.repeatable import RepeatableInverse
from ..strategies.strategy import AN_INVERSE, Inverse

_EPS = np.finfo(float).eps
_LEVELS = 6
_FIRST_STEP = 2.0**-4
SHORTEST_STEP = _FIRST_STEP * 2.0 ** (1 - _LEVELS)
_NARROWER = (1.0, 2.0**-3, 2.0**-6, 2.0**-9)
_ENOUGH = 1e-6


@dataclass(frozen=True, eq=False)
@read_only
class _Derivative:
    """Inverse G and its derivative ∂G/∂q at K configurations, from which Lie brackets follow.

    Attributes
    ----------
    J : (K, m, n) array
        Jacobian.
    G : (K, n, m) array
        Inverse.
    dG : (K, n, m, n) array
        ``[:, i, a, k] = ∂G[i, a]/∂q[k]``.
    error : (K, n) array
        Estimated maximum error of the entries of ∂G/∂q_k, for each joint k. For this maximum, the
        rows of prismatic joints are divided by the arm length, in m.
    exact : bool
        True if a formula was evaluated, so that all errors are rounding errors.
    """

    J: Array
    G: Array
    dG: Array
    error: Array
    exact: bool


@singledispatch
def derivative(strategy: Inverse, Q: Array) -> _Derivative:
    """Evaluate G and ∂G/∂q of an inverse at every row of Q (K, n), by a formula or differences.

    There are formulas for J⁺, for J⁺ with a constant weight, and for repeatable inverses whose
    potentials have second derivatives. All other inverses are differentiated numerically, with an
    error estimate.

    Raises
    ------
    InputError
        If the strategy is not an inverse, because it has no G(q).
    SingularityError
        If J or G is singular at a row of Q.
    """
    require_inverse(strategy)
    J = strategy.task.jacobians(Q)
    L = joint_scale(strategy.task, Q[0])[:, None]
    dG, error = differentiate(lambda P: strategy.batch(P) / L, Q, inside_limits(strategy.task, Q))
    dG *= L[..., None]
    return _Derivative(J, strategy.batch(Q, J), dG, error, exact=False)


@derivative.register
def _(strategy: Pseudoinverse, Q: Array) -> _Derivative:
    J = strategy.task.jacobians(Q)
    dG = pseudoinverse_derivative(J, strategy.task.hessians(Q))
    G = strategy.batch(Q, J)
    return _Derivative(J, G, dG, _rounding(J, dG, joint_scale(strategy.task, Q[0])), exact=True)


@derivative.register
def _(strategy: WeightedInverse, Q: Array) -> _Derivative:
    """Evaluate G and ∂G/∂q of ``J⁺_M = B (J B)⁺`` at Q (K, n), where ``M⁻¹ = B Bᵀ``.

    M is the weight of the joint speeds. A constant weight permits the formula of J⁺; otherwise,
    differences are used.
    """
    if isinstance(strategy.weight, str) or callable(strategy.weight):
        return derivative.dispatch(object)(strategy, Q)
    B = np.linalg.inv(np.linalg.cholesky(strategy.weight)).T
    J = strategy.task.jacobians(Q)
    H_B = np.einsum("Kapk,pi->Kaik", strategy.task.hessians(Q), B)
    dG = np.einsum("ij,Kjak->Kiak", B, pseudoinverse_derivative(J @ B, H_B))
    L = joint_scale(strategy.task, Q[0])
    scaled = B / L[:, None]
    error = _rounding(J, dG, L) * np.linalg.cond(scaled / np.linalg.norm(scaled, axis=0))
    return _Derivative(J, strategy.batch(Q, J), dG, error, exact=True)


@derivative.register
def _(strategy: RepeatableInverse, Q: Array) -> _Derivative:
    """Evaluate ``∂G_r/∂q_k = −J_V⁻¹ [H_k; (∂V/∂q_k)ᵀ] G_r``, by ``∂J_V⁻¹ = −J_V⁻¹ ∂J_V J_V⁻¹``.

    H_k = ∂J/∂q_k, J_V = [J; Vᵀ], and V are the gradients of the potentials that the repeatable
    inverse G_r keeps constant. If the potentials have no second derivatives, from which ∂V/∂q_k
    follows, G_r is differentiated numerically.
    """
    potentials = strategy.potentials
    m = strategy.task.m
    if not isinstance(potentials, CurvedPotentials):  # no second derivatives
        return derivative.dispatch(object)(strategy, Q)
    J = strategy.task.jacobians(Q)
    inverse = augmented_inverse(J, potentials.gradients(Q))  # (K, n, n)
    G = inverse[:, :, :m]
    dV = np.array([potentials.hessian(q) for q in Q])  # (K, n, n, r)
    # (K, n, n, n)
    dJ_V = np.concatenate([strategy.task.hessians(Q), np.moveaxis(dV, -1, 1)], axis=1)
    dG = -np.einsum("Kis,Kspk,Kpa->Kiak", inverse, dJ_V, G, optimize=True)
    J_V = np.concatenate([J, np.swapaxes(potentials.gradients(Q), 1, 2)], axis=1)
    return _Derivative(J, G, dG, _rounding(J_V, dG, joint_scale(strategy.task, Q[0])), exact=True)


def inside_limits(task: Task, Q: Array) -> Array:
    """Compute step scales for :func:`differentiate` at Q (K, n): (K, n), rad or m.

    A scale is 1 rad, or the arm length for a prismatic joint. Near a joint limit it is at most 8
    times the distance to the limit, so the first step, 1/16 of the scale, is at most half this
    distance: the inverse may not be defined beyond the limit. Outside the limits, the scale is not
    reduced.
    """
    distance = task.limit_margin(Q)  # (K, n)
    most = np.where(distance > 0, 8 * distance, np.inf)
    return np.minimum(joint_scale(task, Q[0]), most)


def require_inverse(strategy: Inverse) -> Inverse:
    """Require an inverse, a strategy with a matrix G(q), and return it; else raise InputError.

    Repeatability tests differentiate G, which a controller with a posture task, for instance, does
    not have.
    """
    require_type(strategy, Inverse, "strategy", AN_INVERSE)
    return strategy


def _rounding(matrix: Array, dG: Array, L: Array) -> Array:
    """Estimate the maximum rounding error of the entries of ∂G/∂q_k, for each joint k: (K, n).

    ``matrix`` is the matrix that the formula inverts: J (K, m, n) for J⁺, or J_V (K, n, n), J above
    the gradients of the r potentials. The error is proportional to its condition number. ``dG`` (K,
    n, m, n) is ∂G/∂q, and ``L`` (n,) the unit of each joint, 1 rad or the arm length in m.
    """
    values = np.linalg.svd(matrix * L, compute_uv=False)
    condition = values[:, 0] / values[:, -1]
    largest = np.abs(dG / L[:, None, None]).max(axis=(1, 2))
    return 4 * _EPS * matrix.shape[-1] * condition[:, None] * largest


def differentiate(
    function: Callable[[Array], Array], Q: Array, scale: Array
) -> tuple[Array, Array]:
    """Differentiate a batched function along every joint by extrapolated central differences.

    Central differences with steps h, h/2, …, h/32 are extrapolated to h → 0 (Romberg's table,
    orders 2 to 12). An entry of the table is computed from two entries of the next lower order. Its
    difference from these two is its error estimate (Ridders' method), and the entry with the
    smallest estimate is the result. So step and order adapt to the function: short steps and high
    order if it is smooth, long steps and low order if it is noisy. The error returned is at least
    four times the noise, which is estimated from two entries at the shortest steps. If the error
    exceeds 1e-6 of the derivative, as near a pole, the procedure is repeated with steps an eighth
    as long, up to three times.

    Parameters
    ----------
    function
        Function Q (P, n) → values (P, …), for any number P of configurations.
    Q : (K, n) array
        Configurations at which to differentiate.
    scale : (n,) or (K, n) array
        Scale of the steps, rad or m: the first step along a joint is 1/16 of it.

    Returns
    -------
    slope : (K, …, n) array
        Derivatives; ``[..., k]`` is along joint k.
    error : (K, n) array
        Estimated maximum error of the derivative along joint k.

    Raises
    ------
    SingularityError
        If the function is singular at Q, or within the shortest step of it.
    """
    slope: Array | None = None
    scale = np.broadcast_to(scale, Q.shape)
    error = np.full(Q.shape, np.inf)
    open_rows = np.arange(len(Q))
    for narrower in _NARROWER:
        try:
            found, doubt = _extrapolate(
                function, Q[open_rows], _FIRST_STEP * narrower * scale[open_rows]
            )
        except SingularityError:
            if slope is None and narrower == _NARROWER[-1]:
                raise
            continue
        if slope is None:
            slope = np.empty((len(Q), *found.shape[1:]))
        # noise can make an error estimate slightly too small
        row, joint = np.nonzero(doubt < error[open_rows] / 4)
        slope[open_rows[row], ..., joint] = found[row, ..., joint]
        error[open_rows[row], joint] = doubt[row, joint]
        size = np.abs(slope[open_rows]).reshape(len(open_rows), -1).max(axis=1, initial=0.0)
        open_rows = open_rows[error[open_rows].max(axis=1, initial=0.0) > _ENOUGH * size]
        if not len(open_rows):
            break
    assert slope is not None
    return slope, error


def _extrapolate(function: Callable[[Array], Array], Q: Array, first: Array) -> tuple[Array, Array]:
    """Differentiate by extrapolated central differences, once, with given first steps.

    ``function`` maps P configurations Q (P, n) to values (P, …), and ``Q`` (K, n) are the
    configurations. ``first`` (K, n) is the first and longest step along each joint, rad or m.
    Return the slopes (K, …, n) and their estimated errors (K, n).
    """
    K, n = Q.shape
    steps = first[:, None] * 2.0 ** -np.arange(_LEVELS)[:, None]  # (K, L, n)
    moves = steps[..., None] * np.eye(n)
    moves = np.stack([moves, -moves], axis=1)  # (K, 2, L, n, n)
    stencil = Q[:, None, None, None] + moves  # (K, 2, L, n, n)
    values = np.asarray(function(stencil.reshape(-1, n)))
    shape = values.shape[1:]
    values = values.reshape(K, 2, _LEVELS, n, -1)
    # (K, n, size)
    rows = [
        (values[:, 0, j] - values[:, 1, j]) / (2 * steps[:, j, :, None]) for j in range(_LEVELS)
    ]
    best, error, level, few = _romberg(rows)
    # The two shortest steps differ almost only by noise; longer steps reduce it in proportion.
    last, before = (np.abs(entry - best).max(-1, initial=0.0) for entry in few)
    noise = np.maximum(last, before / 2) * 2.0 ** (level - _LEVELS + 1)
    rounding = np.finfo(float).eps * np.abs(values).max(axis=(1, 2, 4), initial=0.0) / steps[:, -1]
    slope = np.moveaxis(best, 1, -1).reshape(K, *shape, n)
    return slope, np.maximum(error, 4 * noise) + rounding


def _romberg(rows: Sequence[Array]) -> tuple[Array, Array, NDArray[np.intp], tuple[Array, Array]]:
    """Extrapolate differences for successively halved steps to step 0 by Romberg's table.

    ``rows`` has one array of differences (K, n, size) per step, the longest step first; size is the
    number of values of the function. At least five steps are required. Return four results, with
    one table entry per configuration and joint:

    1. the table entry with the smallest estimated error, (K, n, size);
    2. this error, (K, n);
    3. the number of halvings from the first step to the shortest that the entry uses, (K, n);
    4. two other entries, (K, n, size) each, from which the caller estimates the noise. They have
       order 8; one uses the shortest step, the other only steps of at least twice that.
    """
    best = rows[-1]
    error = np.full(best.shape[:2], np.inf)
    level = np.zeros(best.shape[:2], int)
    table = [[rows[0]]]
    for j in range(1, len(rows)):
        previous = table[-1]
        current = [rows[j]]
        for i in range(1, j + 1):
            entry = current[i - 1] + (current[i - 1] - previous[i - 1]) / (4.0**i - 1)
            parents = np.array([current[i - 1], previous[i - 1]])
            doubt = np.abs(entry - parents).max(axis=(0, -1), initial=0.0)
            better = doubt < error
            error = np.where(better, doubt, error)
            level = np.where(better, j, level)
            best = np.where(better[..., None], entry, best)
            current.append(entry)
        table.append(current)
    return best, error, level, (table[-1][3], table[-2][3])
