"""Boxes of a made-up J and V, whose true leaf margins are known, for the kernel of its bound."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from itertools import product

import numpy as np
from kernels import margin_on

from repctl_pin import redundancy

EPS = 1e-13


def monomials(t: np.ndarray, degree: int = 3) -> np.ndarray:
    """Evaluate the monomials of one variable t (K,): (K, degree + 1)."""
    return np.asarray(t[:, None] ** np.arange(degree + 1))


def margin_at(J: np.ndarray, V: np.ndarray) -> float:
    """Evaluate the leaf margin of J (6, n) and V (n, r)."""
    N = redundancy.nullspace(J)
    return float(redundancy.leaf_margin(N[None], V[None])[0])


def made_up(library: ctypes.CDLL, seed: int, r: int = 1, width: float = 0.1) -> float | None:
    """Ratio of the bound to the margin at the corner of a box where all terms have the worst signs.

    With ``A J_c(q) = I − D`` and T ≥ 0 ≥ P nothing cancels: for r = 1 the bound is attained. Some
    terms are 0 at random, so that each of the others dominates somewhere."""
    rng = np.random.default_rng(seed)
    n, k = 6 + r, 3
    half = rng.uniform(0.3, 1, k)

    def part(*shape: int) -> np.ndarray:
        return np.asarray(width * rng.integers(2) * rng.uniform(0.2, 1, shape))

    t = part(6, r) * 10
    V_c = np.concatenate([np.zeros((6, r)), np.eye(r)])
    A = np.block([[np.eye(6), t], [np.zeros((r, 6)), np.eye(r)]])
    dJ, R_J = -part(k, 6, n) / 2, part(6, n)
    dV, rest = -part(k, n, r) / 2, part(n, r)
    B = A @ np.concatenate([dJ, np.zeros((k, r, n))], axis=1)
    R = np.concatenate([R_J, np.zeros((r, n))])
    of_V = V_c.T, np.transpose(dV, (2, 1, 0)), rest.T
    bound = margin_on(library, EPS, half, A, R, B, *of_V)
    if bound is None:
        return None
    J = np.linalg.inv(A)[:6] + np.einsum("j,jac->ac", half, dJ) - R_J
    V = V_c + np.einsum("j,jia->ia", half, dV) - rest
    return bound / margin_at(J, V)


def crossed(library: ctypes.CDLL, seed: int, r: int, width: float) -> float | None:
    """The largest ratio at random points of a box of general position and signs."""
    rng = np.random.default_rng(seed)
    n, k = 6 + r, 4
    half = width * rng.uniform(0.3, 1, k)
    J_c, V_c = rng.standard_normal((6, n)), np.linalg.qr(rng.standard_normal((n, r)))[0]
    A = np.linalg.inv(np.concatenate([J_c, V_c.T]))
    dJ, dV = 0.3 * rng.standard_normal((k, 6, n)), 0.3 * rng.standard_normal((k, n, r))
    J_2 = 0.1 * rng.uniform(size=(6, n)) * (half @ half)
    rest = 0.1 * rng.uniform(size=(n, r)) * (half @ half) * rng.choice([0, 1, 10])
    B = A @ np.concatenate([dJ, np.zeros((k, r, n))], axis=1)
    R = np.abs(A[:, :6]) @ J_2 + 1e-14
    of_V = V_c.T, np.transpose(dV, (2, 1, 0)), rest.T
    bound = margin_on(library, EPS, half, A, R, B, *of_V)
    if bound is None:
        return None
    worst = np.inf
    for _ in range(12):
        delta = half * np.sign(rng.standard_normal(k))
        J = J_c + np.einsum("j,jac->ac", delta, dJ)
        J = J + J_2 * np.sign(rng.standard_normal((6, n)))
        V = V_c + np.einsum("j,jia->ia", delta, dV)
        V = V + rest * np.sign(rng.standard_normal((n, r)))
        worst = min(worst, margin_at(J, V))
    return bound / worst


def ratios(library: ctypes.CDLL, count: int) -> Iterator[float]:
    """Ratios of made-up boxes of one and two degrees of redundancy."""
    for r, seed in product((1, 2), range(count)):
        found = [made_up(library, seed, r, width) for width in (0.05, 0.1, 0.2)]
        found.append(crossed(library, seed, r, 0.003 if seed % 2 else 0.03))
        yield from (ratio for ratio in found if ratio is not None)
