"""Actual remainders beside their bounds: how much of each bound of a proof is used, at worst."""

from __future__ import annotations

from itertools import combinations_with_replacement
from types import ModuleType

import numpy as np

import repctl_pin as rp
from repctl_pin import redundancy

EPS = 1e-13

Ratios = dict[str, float]


def monomials(T: np.ndarray, degree: int = 3) -> np.ndarray:
    """Evaluate the monomials of t in the order in which polynomials are stored, at every row of T
    (K, k)."""
    choices = [
        list(c)
        for d in range(degree + 1)
        for c in combinations_with_replacement(range(T.shape[1]), d)
    ]
    return np.stack([T[:, c].prod(axis=1) for c in choices], axis=1)


def used(actual: np.ndarray, bound: np.ndarray) -> float:
    """The largest ratio of an actual value to its bound."""
    return float((np.abs(actual) / (bound + 1e-11)).max())


def compared(
    kernels: ModuleType,
    found: object,
    i: int,
    delta: np.ndarray,
    N: np.ndarray,
    V: np.ndarray,
) -> Ratios:
    """Compare what N and V are at a point of box i, (n, r) each in V_c's gauge, with their bounds.

    All of it is written out anew, from the definitions."""
    X, T_c = found.X[i], found.T[i]
    V_c = X - T_c
    T = N - V_c @ (V_c.T @ N)
    P = (V - V_c @ (V_c.T @ V)) @ np.linalg.inv(V_c.T @ V)
    S = (T - P) @ np.linalg.inv(np.eye(len(V_c.T)) + P.T @ T)

    def beyond(whole: np.ndarray, start: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        return np.asarray(whole - start - np.einsum("j,jab->ab", delta, slopes))

    along = np.einsum("j,jia,ib->ab", delta, found.dP[i], T_c)
    cosine = kernels._cosine(np.linalg.norm(S, 2) ** 2, np.linalg.norm(P, 2), EPS)
    margin = redundancy.leaf_margin(np.linalg.qr(N)[0][None], V[None])[0]
    return {
        "ν": used(beyond(N, X, found.dN[i]), found.nu[i]),
        "π": used(beyond(P, 0 * P, found.dP[i]), found.pi[i]),
        "P": used(P, found.P[i]),
        "β": used(P.T @ T - along, found.beta[i]),
        "ρ": used(beyond(S, T_c, found.dS[i]), found.rho[i]),
        "SᵀS": used(S.T @ S, found.square[i]),
        "margin": float(cosine / margin),
    }


def worst(parts: list[Ratios]) -> Ratios:
    """The largest of each ratio."""
    return {name: max(part[name] for part in parts) for name in parts[0]}


def made_up(kernels: ModuleType, seed: int, r: int = 1, width: float = 0.1) -> Ratios:
    """Compare one box of a made-up J and V, whose terms all have the worst signs at its corner.

    With ``A J_c(q) = I − D`` and T ≥ 0 ≥ P nothing cancels: for r = 1 each bound is attained. Some
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
    B = A @ np.concatenate([dJ, np.swapaxes(dV, 1, 2)], axis=1)
    R = np.concatenate([R_J, np.zeros((r, n))])
    at = kernels.Expansion(
        *(x[None] for x in (A, R, R, B, V_c.T, np.transpose(dV, (2, 1, 0)), rest.T))
    )
    found = kernels.graphs(at, half[None], n, EPS)
    if not (found.regular[0] and found.sure[0]):
        return {}
    J = np.linalg.inv(A)[:6] + np.einsum("j,jac->ac", half, dJ) - R_J
    N = np.linalg.solve(np.concatenate([J, V_c.T]), V_c)
    V = V_c + np.einsum("j,jia->ia", half, dV) - rest
    return compared(kernels, found, 0, half, N, V)


def crossed(kernels: ModuleType, seed: int, r: int, width: float) -> Ratios:
    """Compare random points of one box of a made-up J and V, of general position and signs."""
    rng = np.random.default_rng(seed)
    n, k = 6 + r, 4
    half = width * rng.uniform(0.3, 1, k)
    J_c, V_c = rng.standard_normal((6, n)), np.linalg.qr(rng.standard_normal((n, r)))[0]
    A = np.linalg.inv(np.concatenate([J_c, V_c.T]))
    dJ, dV = 0.3 * rng.standard_normal((k, 6, n)), 0.3 * rng.standard_normal((k, n, r))
    J_2 = 0.1 * rng.uniform(size=(6, n)) * (half @ half)
    rest = 0.1 * rng.uniform(size=(n, r)) * (half @ half) * rng.choice([0, 1, 10])
    B = A @ np.concatenate([dJ, np.swapaxes(dV, 1, 2)], axis=1)
    R = np.abs(A[:, :6]) @ J_2 + 1e-14
    at = kernels.Expansion(
        *(x[None] for x in (A, R, R, B, V_c.T, np.transpose(dV, (2, 1, 0)), rest.T))
    )
    found = kernels.graphs(at, half[None], n, EPS)
    if not (found.regular[0] and found.sure[0]):
        return {}
    parts = []
    for _ in range(12):
        delta = half * np.sign(rng.standard_normal(k))
        J = (
            J_c
            + np.einsum("j,jac->ac", delta, dJ)
            + J_2 * np.sign(rng.standard_normal((6, n)))
        )
        V = (
            V_c
            + np.einsum("j,jia->ia", delta, dV)
            + rest * np.sign(rng.standard_normal((n, r)))
        )
        N = np.linalg.solve(np.concatenate([J, V_c.T]), np.eye(n)[:, 6:])
        parts.append(compared(kernels, found, 0, delta, N, V))
    return worst(parts)


def in_chain(
    kernels: ModuleType, design: rp.Design, width: float, seed: int, *, boxes: int = 40
) -> tuple[Ratios, float]:
    """Compare points of random boxes of a design with all bounds there, to the margin's; and the
    share of boxes with a bound."""
    task, region, rng = design.task, design.region, np.random.default_rng(seed)
    problem = kernels.leaf_margin_of(task, design.inverse.potentials, region)
    n = task.n
    Q = region.clip(
        region.center + region.half_width * rng.uniform(-1, 1, (boxes, n)) * 0.8
    )
    half = width * region.half_width * rng.uniform(0.2, 1, Q.shape)
    half *= rng.uniform(size=Q.shape) < rng.choice(
        [0.2, 0.5, 1], (boxes, 1)
    )  # some stand still
    at = kernels._along_axes(kernels._expansion(problem, Q, half))
    found, bounds = kernels.graphs(at, half, n, problem.eps), problem.bounds(Q, half)
    potentials, parts = design.inverse.potentials, []
    good = np.flatnonzero(found.regular & found.sure)
    for i in good:
        V_c = at.V[i].T
        gauge = np.linalg.lstsq(potentials.gradients(Q[i][None])[0], V_c, rcond=None)[0]
        for trial in range(16):
            way = (
                np.sign(rng.standard_normal(n)) if trial % 4 else rng.uniform(-1, 1, n)
            )
            delta = half[i] * way
            N = redundancy.nullspace(task.jacobian(Q[i] + delta))
            N = N @ np.linalg.inv(V_c.T @ N)
            V = potentials.gradients((Q[i] + delta)[None])[0] @ gauge
            ratios = compared(kernels, found, i, delta, N, V)
            ratios["V"] = used(V - V_c - (at.dV[i] @ delta).T, at.rest[i].T)
            true = redundancy.leaf_margin(np.linalg.qr(N)[0][None], V[None])[0]
            ratios["bound"] = float(bounds.leaf_margin[i] / true)
            parts.append(ratios)
    return worst(parts) if parts else {}, len(good) / boxes
