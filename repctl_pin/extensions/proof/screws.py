"""Joint screws in the frame of a middle link, and their derivatives, batched.

The derivative ``∂_p ξ_l`` is the Lie bracket ``±[ξ_p, ξ_l]`` for the joints p between joint l and
the middle link, and 0 for all others. The sign is plus beyond the link, minus before it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...model.chain_formulas import skew
from .chain import Chain


def screws(chain: Chain, theta: Array) -> tuple[Array, Array]:
    """Evaluate the screws (v, ω) of all joints at joint positions θ (K, P): (K, P, 6).

    The second result is the origin of the last joint (K, 3), m.
    """
    K, P = theta.shape
    xi, tip = np.zeros((K, P, 6)), np.tile(-chain.shift, (K, 1))
    for outward in (True, False):
        R, o = np.tile(np.eye(3), (K, 1, 1)), np.tile(-chain.shift, (K, 1))
        for joint in (
            range(chain.middle, P) if outward else range(chain.middle - 1, -1, -1)
        ):
            if outward:
                o = o + R @ chain.p[joint]
                R, tip = R @ chain.R[joint], o
            axis, angle = (
                R @ chain.a[joint],
                theta[:, joint] if outward else -theta[:, joint],
            )
            if chain.level[joint]:
                axis = np.tile(chain.a[joint], (K, 1))
            if chain.revolute[joint]:
                xi[:, joint] = np.concatenate([np.cross(o, axis), axis], axis=1)
                R = R @ turn(chain.a[joint], angle)
            else:
                xi[:, joint, :3] = axis
                o = o + angle[:, None] * axis
            if not outward:
                R = R @ chain.R[joint].T
                o = o - R @ chain.p[joint]
    return xi, tip


def turn(axis: Array, angle: Array) -> Array:
    """Compute the rotation matrices about a unit vector (3,) by angles (K,): (K, 3, 3)."""
    c, s = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    turned = c * np.eye(3) + s * skew(axis) + (1 - c) * np.outer(axis, axis)
    return np.asarray(turned, float)


def bracket(a: Array, b: Array) -> Array:
    """Evaluate the Lie bracket ``[a, b] = (ω_a × v_b + v_a × ω_b, ω_a × ω_b)`` of screws (…, 6)."""
    linear = np.cross(a[..., 3:], b[..., :3]) + np.cross(a[..., :3], b[..., 3:])
    return np.concatenate([linear, np.cross(a[..., 3:], b[..., 3:])], axis=-1)


def between(chain: Chain, joint: int) -> NDArray[np.intp]:
    """Return the indices of the joints between a joint and the middle link.

    The joint's screw depends on their positions only.
    """
    ends = (joint + 1, chain.middle) if joint < chain.middle else (chain.middle, joint)
    return np.arange(*ends)


def slopes(chain: Chain, xi: Array, tip: Array) -> Array:
    """Compute the derivatives of the columns of J with respect to q: ``[:, j, c] = ∂J_c/∂q_j``.

    The result is (K, n, N, 6); ``xi`` and ``tip`` are the results of :func:`screws`.
    """
    dJ = np.zeros((len(xi), chain.n, chain.N, 6))
    for joint in range(len(chain.p)):
        sign = -1.0 if joint < chain.middle else 1.0
        for other in between(chain, joint):
            change = sign * bracket(xi[:, other], xi[:, joint])
            if chain.level[joint]:
                moved = np.cross(xi[:, other, 3:], tip) + xi[:, other, :3]
                change = np.concatenate(
                    [np.cross(moved, xi[:, joint, 3:]), np.zeros_like(tip)], axis=1
                )
            for c in np.flatnonzero(chain.S[joint]):
                for j in np.flatnonzero(chain.S[other, : chain.n]):
                    dJ[:, j, c] += chain.S[joint, c] * chain.S[other, j] * change
    return dJ
