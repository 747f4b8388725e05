"""The kernel of the rates of G_r against the same formulas in NumPy, and against wrong versions."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms import planar_task, sliding_task, spatial_task
from inside import leaf_margin_bounds, lifts
from kernels import expansion, kernels, screws, use
from mutants import INVERSE_C
from proofs import design_of, near_null_space, regular_start

import repctl_pin as rp


def cases(folder: Path) -> list[tuple[leaf_margin_bounds.LeafMarginProblem, rp.Task, rp.Box]]:
    out = []
    for seed, task in enumerate(
        [
            spatial_task(7, folder, kind="pose", seed=1),
            spatial_task(8, folder, kind="pose", seed=2),
            spatial_task(6, folder, kind="axis", seed=3),
            planar_task([0.5, 0.4, 0.3, 0.2], folder),
            sliding_task(folder),
        ]
    ):
        q = regular_start(task, seed)
        box = rp.Box(q, 0.3)
        for degree in (2, 4) if seed > 2 else (2,):
            rough = 0.3 if degree == 2 else 0.03
            field = near_null_space(task, q, 0.3, seed, rough=rough, degree=degree)
            field = design_of(task, field, box).inverse.potentials
            problem = leaf_margin_bounds.leaf_margin_of(task, field, box)
            out += [(problem, task, box), (rounded(problem), task, box)]
    return out


def rounded(problem: leaf_margin_bounds.LeafMarginProblem) -> leaf_margin_bounds.LeafMarginProblem:
    """The same with so coarse an arithmetic that its rounding is seen in the bounds."""
    return replace(problem, eps=1e-6, round=1e6 * problem.round)


def norm(x: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(x, axis=-1))


def in_numpy(
    problem: leaf_margin_bounds.LeafMarginProblem, q: np.ndarray, h: np.ndarray, ratio: float
) -> np.ndarray | None:
    """Bounds (n,) in one box; None if J_V is not shown to be regular."""
    (chain,), n, N, eps = problem.chains, problem.n, problem.N, problem.eps
    at, S = expansion(kernels(), problem, q, h), chain.S[:, : problem.n]
    A, B, R, D = (at[name] for name in "ABRD")
    theta, eta = S @ q + chain.o, np.abs(S) @ h
    xi, tip = screws(kernels(), chain, theta)
    dd, turn, slide = np.zeros((n, 3)), 0.0, 0.0
    length = chain.reach[-1] if chain.middle < len(chain.p) else 0.0
    for p in range(chain.middle, len(chain.p) - 1):
        if chain.revolute[p]:
            turn += eta[p]
        else:
            slide, length = slide + eta[p], length + abs(theta[p]) + eta[p]
        dd += S[p][:, None] * (np.cross(xi[p, 3:], tip) + xi[p, :3])
    bent = turn**2 * length / 2 + turn * slide + eps * problem.beta

    Z = A[:, :6].copy()
    Z[:, 3:] += np.cross(Z[:, :3], tip)
    dZ = -B @ Z
    first, rough = np.einsum("jik,j->ik", np.abs(dZ), h), R @ np.abs(Z)
    pairs = np.einsum("jic,lck->jlik", B, dZ)
    pairs = np.abs(pairs + np.swapaxes(pairs, 0, 1)) / 2
    F = np.einsum("jlik,j,l->ik", pairs, h, h) + R @ first + D @ rough + eps
    sizes = norm(A[:, :3]) * problem.beta + norm(A[:, 3:6])
    F[:, 3:] += eps * sizes[:, None]
    Y = np.linalg.solve((1 - 2 * eps) * np.eye(N) - (1 + eps) * D, F)
    if not (np.abs(np.linalg.eigvals(D)).max() < 0.999 and (Y > 0).all()):
        return None

    z, slope = (Y + rough)[:n], dZ[:, :n].copy()
    slope[..., 3:] += np.cross(Z[None, :n, :3], dd[:, None])
    wide = np.einsum("jik,j->ik", np.abs(slope), h)
    moved, Z = bent + h @ norm(dd), Z[:n]
    v, w = norm(Z[:, :3]), norm(Z[:, 3:]) + 1e-150
    s = np.einsum("ix,jix->ji", Z[:, :3], slope[..., :3])
    t = np.einsum("ix,jix->ji", Z[:, 3:], slope[..., 3:])
    x, y = norm(wide[:, :3]), norm(wide[:, 3:])
    together = v + ratio * w + h @ np.abs(s / v + ratio * t / w)
    together += x**2 / (2 * v) + ratio * y**2 / (2 * w)
    apart = np.sqrt(v**2 + 2 * h @ np.abs(s) + x**2)
    apart += ratio * np.sqrt(w**2 + 2 * h @ np.abs(t) + y**2)
    loose = ratio * (norm(z[:, 3:]) + (x + norm(z[:, :3])) * moved + v * bent)
    bound = np.minimum(together, apart) + norm(z[:, :3]) + loose
    return np.asarray((bound + eps) * (1 + 64 * eps))


def differs(
    given: list[tuple[leaf_margin_bounds.LeafMarginProblem, rp.Task, rp.Box]],
    library: ctypes.CDLL,
    monkeypatch: pytest.MonkeyPatch,
) -> float:
    """The largest relative difference of C's bounds from NumPy's, in boxes of all sizes."""
    most = 0.0
    use(monkeypatch, leaf_margin_bounds, library)
    for problem, task, box in given:
        rng, K = np.random.default_rng(0), 12
        Q = box.center + rng.uniform(-0.1, 0.1, (K, task.n))
        h = 10 ** rng.uniform(-3, -0.8, (K, 1)) * rng.uniform(0.2, 1, Q.shape)
        ratio = 2.0 if task.kind in ("pose", "axis") else 0.0
        ours = lifts.rate_bounds(problem, Q, h, np.ones_like(Q), ratio)[0]
        theirs = [in_numpy(problem, q, half, ratio) for q, half in zip(Q, h, strict=True)]
        both = [i for i, bound in enumerate(theirs) if bound is not None]
        assert len(both) > 0.2 * K
        for i in both:
            change = np.nan_to_num(np.abs(ours[i] / theirs[i] - 1), nan=1.0)
            most = max(most, float(change.max()))
    return most


def test_c_and_numpy_bound_the_same_rates(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert differs(cases(tmp_path), kernels(), monkeypatch) < 1e-10


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_wrong_term_of_the_rates_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = cases(tmp_path)
    for name, change in INVERSE_C.items():
        library = kernels("inverse_bounds.c", *change)
        assert differs(given, library, monkeypatch) > 1e-8, name
