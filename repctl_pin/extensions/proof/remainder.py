r"""Bounds of the second-order Taylor remainder of joint screws on a box of joint positions.

With ``H_R`` and ``H_P`` the sums of the half-widths of the revolute and the prismatic joints
between joint l and the middle link, and ``L`` the sum of the link offsets between them, the screw
``(v_l, ω_l)`` differs from its first-order expansion by at most

.. math::

   |Δv_l| ≤ \tfrac12 H_R² L + H_R H_P, \quad |Δω_l| ≤ \tfrac12 H_R² \quad\text{(revolute)}, \qquad
   |Δv_l| ≤ \tfrac12 H_R², \quad Δω_l = 0 \quad\text{(prismatic)}.

docs/theory.md derives these bounds.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from .chain import Chain
from .potentials import U
from .screws import between


def remainders(chain: Chain, theta: Array, eta: Array) -> tuple[Array, Array]:
    """Bound the remainder of every screw in boxes θ ± η of joint positions, (K, P) each.

    Returns the bounds of the linear and of the angular part, (K, P) each.
    """
    linear, angular = np.zeros_like(theta), np.zeros_like(theta)
    reach = chain.reach
    for joint in range(theta.shape[1]):
        among = between(chain, joint)
        turning, sliding = among[chain.revolute[among]], among[~chain.revolute[among]]
        H_R, H_P = eta[:, turning].sum(axis=1), eta[:, sliding].sum(axis=1)
        L = reach[joint] + (np.abs(theta[:, sliding]) + eta[:, sliding]).sum(axis=1)
        if chain.revolute[joint]:
            linear[:, joint], angular[:, joint] = revolute(H_R, H_P, L)
            angular[:, joint] *= not chain.level[joint]
        else:
            linear[:, joint] = 0.5 * H_R**2
    return linear, angular


def revolute(H_R: Array, H_P: Array, L: Array) -> tuple[Array, Array]:
    """Bound the linear and the angular remainder of a revolute joint's screw from H_R, H_P, L."""
    return 0.5 * H_R**2 * L + H_R * H_P, 0.5 * H_R**2


def relative_rounding(chain: Chain) -> float:
    """Bound the relative rounding of any sum or screw of a proof: ``512 (P + N + 2) u``, u = 2⁻⁵³.

    A rotation after k joints has an error of at most 64 k u, a screw one of 128 (k + 2) u times its
    length, and a sum of N products one of (N + 2) u times the sum of their absolute values; see
    docs/theory.md.
    """
    return 512 * (len(chain.p) + chain.N + 2) * U


def screw_sizes(chain: Chain, theta: Array, eta: Array) -> Array:
    """Bound the rows of J, with its slopes times the half-widths added: (6,), linear, then angular.

    Rounding errors are relative to these sizes.
    """
    L = chain.reach.max() + (np.abs(theta) + eta)[~chain.revolute].sum()
    columns = np.abs(chain.S).sum(axis=0).max()
    swing = 1 + 2 * eta.sum()
    return np.repeat([columns * (1 + L) * swing, columns * swing], 3)
