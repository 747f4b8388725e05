r"""Two solutions at one pose: what the straight way between them adds to D.

With ``W = T₁⁻¹ x T₂⁻¹ = (Q, w)`` on the way, the identity at both ends, and ``δ`` the step:

.. math:: ‖\\textstyle∫ J_ω δ‖ ≤ φ τ, \\qquad ‖\\textstyle∫ J_v δ‖ ≤ φ V₂ + ψ τ,

φ and ψ the largest rotation and shift of W. Both are linear in |δ|: docs/theory.md."""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from .chain import Chain
from .screws import between


def commutator(chain: Chain, near: Array, farthest: Array) -> Array:
    """Bound ``∫ J δ dt`` by Λ |δ|, for steps of at most 2 ``near``: the linear and the angular row,
    (2, N).

    Parameters
    ----------
    chain
    near : (n,) array
        Both solutions are within this of q_ref.
    farthest : (n,) array
        Largest value of every joint on the cell, for the prismatic ones.
    """
    S, k, turning = np.abs(chain.S), chain.middle, chain.revolute
    step = S[:, : chain.n] @ (2 * near)
    slide = np.where(turning, 0.0, S[:, : chain.n] @ farthest + np.abs(chain.o))
    H, K, L = np.zeros((3, len(step)))  # how much ω_l and v_l change on the way, and |v_l|
    for joint in range(len(step)):
        among = between(chain, joint)
        H_R, H_P = step[among[turning[among]]].sum(), step[among[~turning[among]]].sum()
        L[joint] = chain.reach[joint] + slide[among].sum() if turning[joint] else 1.0
        H[joint] = H_R if turning[joint] else 0.0
        K[joint] = L[joint] * H_R + H_P if turning[joint] else H_R
    turns = np.where(turning, step, 0.0)
    before, beyond = turns[:k].sum(), turns[k:].sum()
    Omega, V_2 = before + beyond, (L * step)[k:].sum()
    if Omega >= 0.9:
        return np.full((2, chain.N), 1e30)
    kappa = 0.5 / (1 - Omega)  # φ ≤ κ Σ H_l |δ_l|
    alpha = (1 + kappa * Omega) * (H @ step)
    tau = alpha + min(before, beyond)
    angular = kappa * tau * H
    linear = kappa * H * V_2 + tau * (0.5 * K + kappa * H * V_2) / (1 - Omega)
    return np.asarray(np.stack([linear @ S, angular @ S]), float)
