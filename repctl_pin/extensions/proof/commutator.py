r"""Uniqueness of F: bound on the integral of J between two solutions with one task value x.

Let δ be the difference of two configurations with the same pose x. On the straight line between
them, T₁ and T₂ are the transforms of the chain before and beyond the middle link, and
``W = T₁⁻¹ x T₂⁻¹ = (Q, w)`` is the identity at both ends. Then

.. math:: ‖\textstyle∫ J_ω δ‖ ≤ φ τ, \qquad ‖\textstyle∫ J_v δ‖ ≤ φ V₂ + ψ τ,

with φ and ψ the largest rotation and displacement of W. φ, ψ, τ and V₂ have bounds that are linear
in |δ|; the last two bound how fast W changes.

Where the task leaves a coordinate free, its virtual joint closes the chain: it moves by at most
what all others move the frame. The rotations that a position task leaves free are not closed. They
follow the frame at each instant, and w is the displacement alone. docs/theory.md derives this.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from .chain import Chain
from .screws import between


def commutator(chain: Chain, steps: Array, farthest: Array) -> Array:
    """Compute Λ such that ``|∫ J ζ dt| ≤ Λ |ζ|``, with ζ = (δ, rates of the virtual joints).

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
    (K, 2, 2, N) array
        Λ, its linear and its angular row, and the same for the largest ``|J ζ|`` on the way in
        place of the integral; 1e30 where the joints move too far for a bound.
    """
    S, n = np.abs(chain.S), chain.n
    slide = slides_of(chain, farthest)
    step = closed(chain, steps @ S[:, :n].T)  # (K, P)
    found = (_of_points if chain.loose.any() else _of_frames)(chain, step, slide)
    found = np.nan_to_num(found @ S, nan=1e30)
    return np.asarray(found * (1 + 1e-9), float)


def slides_of(chain: Chain, farthest: Array) -> Array:
    """Bound the positions of the prismatic joints (P,), m, from those of the joints (n,)."""
    most = np.abs(chain.S[:, : chain.n]) @ farthest + np.abs(chain.o)
    return np.where(chain.revolute, 0.0, most)


def tips(chain: Chain, slide: Array) -> Array:
    """Bound the distance of every revolute joint from the frame (P,), m.

    ``slide`` are the bounds of :func:`slides_of`.
    """
    lengths = np.linalg.norm(chain.p, axis=1) + slide
    return np.asarray(lengths[::-1].cumsum()[::-1] - lengths)


def closed(chain: Chain, step: Array) -> Array:
    """Bound the motion of all joints, (K, P): add the spin that closes an axis task to the others.

    The spin is at most the sum of the motions of all revolute joints. The axis of the base that
    two coordinates leave free needs no bound: no screw depends on the motion along it.
    """
    turning = chain.revolute
    spins = turning & (chain.S[:, chain.n :] != 0).any(axis=1) & ~chain.level
    return np.where(spins, step[:, turning].sum(axis=1)[:, None], step)


def _of_frames(chain: Chain, step: Array, slide: Array) -> Array:
    """Compute Λ (K, 2, 2, P) for each joint, where both solutions close to one pose."""
    k, turning = chain.middle, chain.revolute
    H, W, L = np.zeros(
        (3, *step.shape)
    )  # how much ω_l and v_l change on the way, and |v_l|
    for joint in range(len(chain.p)):
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
    return np.stack([np.stack([linear, angular], axis=1)] * 2, axis=1)


def _of_points(chain: Chain, step: Array, slide: Array) -> Array:
    """Compute Λ (K, 2, 2, P) for each joint, where both solutions close to one position.

    The virtual rotations cancel the frame's, so the angular rows are 0.
    """
    K = velocity_changes(chain, step, slide)
    Omega = step[:, : chain.middle][:, chain.revolute[: chain.middle]].sum(axis=1)
    Omega = np.where(Omega < 0.9, Omega, np.nan)
    mean = (0.5 * Omega / (1 - Omega))[:, None] * K
    none = np.zeros_like(K)
    return np.stack(
        [np.stack([mean, none], axis=1), np.stack([K + mean, none], axis=1)], axis=1
    )


def velocity_changes(chain: Chain, step: Array, slide: Array) -> Array:
    """Bound the change of the frame's velocity per unit of each joint's on a way, (K, P).

    The velocity is that of the frame's origin, as seen from the middle link; ``step`` (K, P) are
    bounds of the motion of the joints on the way.
    """
    k, turning, away = chain.middle, chain.revolute, tips(chain, slide)
    joints, K = np.arange(len(chain.p)), np.zeros_like(step)
    turns, slides = np.where(turning, step, 0.0), np.where(turning, 0.0, step)
    for joint in joints[~chain.level]:
        among = between(chain, joint)
        if not turning[joint]:
            K[:, joint] = turns[:, among].sum(axis=1)
            continue
        beyond = joints >= max(joint, k)
        K[:, joint] = turns[:, beyond] @ away[beyond]
        K[:, joint] += slides[:, joints > joint].sum(axis=1)
        K[:, joint] += away[joint] * turns[:, among].sum(axis=1)
    return K
