r"""Uniqueness of F: bound on the integral of J between two solutions at one pose.

Let δ be the difference of two configurations with the same pose x. On the straight line between
them, T₁ and T₂ are the transforms of the chain before and beyond the middle link, and
``W = T₁⁻¹ x T₂⁻¹ = (Q, w)`` is the identity at both ends. Then

.. math:: ‖\textstyle∫ J_ω δ‖ ≤ φ τ, \qquad ‖\textstyle∫ J_v δ‖ ≤ φ V₂ + ψ τ,

with φ and ψ the largest rotation and displacement of W. φ, ψ, τ and V₂ have bounds that are linear
in |δ|; the last two bound how fast W changes. docs/theory.md derives this.
"""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from .chain import Chain
from .screws import between


def commutator(chain: Chain, steps: Array, farthest: Array) -> Array:
    """Compute Λ (K, 2, N) such that ``|∫ J δ dt| ≤ Λ |δ|``: its linear and its angular row.

    Parameters
    ----------
    chain
        Chain of the task.
    steps : (K, n) array
        Bounds of |δ|, the difference of two solutions, rad or m.
    farthest : (n,) array
        Largest absolute value of every joint on the cell, for the prismatic ones.

    Returns
    -------
    (K, 2, N) array
        Λ; 1e30 where the joints move too far for a bound.
    """
    S, k, turning = np.abs(chain.S), chain.middle, chain.revolute
    step = steps @ S[:, : chain.n].T  # (K, P)
    slide = np.where(turning, 0.0, S[:, : chain.n] @ farthest + np.abs(chain.o))
    H, W, L = np.zeros((3, *step.shape))  # how much ω_l and v_l change on the way, and |v_l|
    for joint in range(len(S)):
        among = between(chain, joint)
        H_R = step[:, among[turning[among]]].sum(axis=1)
        H_P = step[:, among[~turning[among]]].sum(axis=1)
        L[:, joint] = chain.reach[joint] + slide[among].sum() if turning[joint] else 1.0
        H[:, joint] = H_R if turning[joint] else 0.0
        W[:, joint] = L[:, joint] * H_R + H_P if turning[joint] else H_R
    turns = np.where(turning, step, 0.0)
    before, beyond = turns[:, :k].sum(axis=1), turns[:, k:].sum(axis=1)
    Omega, V_2 = before + beyond, (L * step)[:, k:].sum(axis=1)
    away = 1 - np.where(Omega < 0.9, Omega, np.nan)
    kappa = 0.5 / away  # φ ≤ κ Σ H_l |δ_l|
    tau = (1 + kappa * Omega) * (H * step).sum(axis=1) + np.minimum(before, beyond)
    angular = (kappa * tau)[:, None] * H
    linear = (kappa * V_2)[:, None] * H
    linear += (tau / away)[:, None] * (0.5 * W + (kappa * V_2)[:, None] * H)
    found = np.nan_to_num(np.stack([linear @ S, angular @ S], axis=1), nan=1e30)
    return np.asarray(found * (1 + 1e-9), float)
