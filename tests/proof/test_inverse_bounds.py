"""The kernel of the rates of G_r against the same formulas in NumPy, and against wrong versions."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms import planar_task, sliding_task, spatial_task
from mutants import INVERSE_C, compiled
from proofs import design_of, near_null_space, regular_start

import repctl_pin as rp
from repctl_pin.extensions.proof import leaf_margin_bounds, lifts, screws


def cases(
    folder: Path,
) -> list[tuple[leaf_margin_bounds.LeafMarginProblem, rp.Task, rp.Box]]:
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


def rounded(
    problem: leaf_margin_bounds.LeafMarginProblem,
) -> leaf_margin_bounds.LeafMarginProblem:
    """The same with so coarse an arithmetic that its rounding is seen in the bounds."""
    return replace(problem, eps=1e-6, round=1e6 * problem.round)


def norm(x: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(x, axis=-1))


def in_numpy(
    problem: leaf_margin_bounds.LeafMarginProblem,
    Q: np.ndarray,
    h: np.ndarray,
    ratio: float,
) -> np.ndarray:
    """Bounds (K, n); NaN where J_V is not shown to be regular."""
    chain, n, eps = problem.chain, problem.chain.n, problem.eps
    at, S = leaf_margin_bounds._expansion(problem, Q, h), chain.S[:, :n]
    R, D = at.R.copy(), at.D.copy()
    rest = leaf_margin_bounds._potentials(problem, Q, h)[2]
    of_V = np.abs(at.A[:, :, 6:]) @ rest  # what slopes of V leave out
    R[:, :, :n] += of_V
    D[:, :, :n] += of_V
    theta, eta = Q @ S.T + chain.o, h @ np.abs(S).T
    xi, tip = screws.screws(chain, theta)
    dd = np.zeros((len(Q), n, 3))
    turn, slide, length = np.zeros((3, len(Q)))
    if chain.middle < len(chain.p):
        length = length + chain.reach[-1]
    for p in range(chain.middle, len(chain.p) - 1):
        if chain.revolute[p]:
            turn = turn + eta[:, p]
        else:
            slide, length = slide + eta[:, p], length + np.abs(theta[:, p]) + eta[:, p]
        way = np.cross(xi[:, p, 3:], tip) + xi[:, p, :3]
        dd += S[p][None, :, None] * way[:, None]
    bent = turn**2 * length / 2 + turn * slide + eps * problem.beta

    Z = at.A[:, :, :6].copy()
    Z[:, :, 3:] += np.cross(Z[:, :, :3], tip[:, None])
    dZ = -at.B @ Z[:, None]
    first, rough = np.einsum("Kjik,Kj->Kik", np.abs(dZ), h), R @ np.abs(Z)
    pairs = np.einsum("Kjic,Klck->Kjlik", at.B, dZ, optimize=True)
    pairs = np.abs(pairs + np.swapaxes(pairs, 1, 2)) / 2
    F = np.einsum("Kjlik,Kj,Kl->Kik", pairs, h, h) + R @ first + D @ rough + eps
    sizes = norm(at.A[:, :, :3]) * problem.beta + norm(at.A[:, :, 3:6])
    F[:, :, 3:] += eps * sizes[:, :, None]
    Y, _, held = leaf_margin_bounds.enclosed(D, F, eps)

    z = (Y + rough)[:, :n]
    slope = dZ[:, :, :n].copy()
    slope[..., 3:] += np.cross(Z[:, None, :n, :3], dd[:, :, None])
    wide = np.einsum("Kjik,Kj->Kik", np.abs(slope), h)
    moved = (bent + (h * norm(dd)).sum(axis=1))[:, None]
    Z = Z[:, :n]
    v, w = norm(Z[..., :3]), norm(Z[..., 3:]) + 1e-150
    s = np.einsum("Kix,Kjix->Kji", Z[..., :3], slope[..., :3])
    t = np.einsum("Kix,Kjix->Kji", Z[..., 3:], slope[..., 3:])
    x, y = norm(wide[..., :3]), norm(wide[..., 3:])
    along = np.abs(s / v[:, None] + ratio * t / w[:, None])
    together = v + ratio * w + np.einsum("Kji,Kj->Ki", along, h)
    together += x**2 / (2 * v) + ratio * y**2 / (2 * w)
    apart = np.sqrt(v**2 + 2 * np.einsum("Kji,Kj->Ki", np.abs(s), h) + x**2)
    apart += ratio * np.sqrt(w**2 + 2 * np.einsum("Kji,Kj->Ki", np.abs(t), h) + y**2)
    loose = ratio * (
        norm(z[..., 3:]) + (x + norm(z[..., :3])) * moved + v * bent[:, None]
    )
    bound = np.minimum(together, apart) + norm(z[..., :3]) + loose
    return np.where(held[:, None], (bound + eps) * (1 + 64 * eps), np.nan)


def differs(
    given: list[tuple[leaf_margin_bounds.LeafMarginProblem, rp.Task, rp.Box]],
    library: ctypes.CDLL | None,
    monkeypatch: pytest.MonkeyPatch,
) -> float:
    """The largest relative difference of C's bounds from NumPy's, in boxes of all sizes."""
    most = 0.0
    if library is not None:
        monkeypatch.setattr(lifts, "required_library", lambda _: library)
    for problem, task, box in given:
        rng = np.random.default_rng(0)
        Q = box.center + rng.uniform(-0.1, 0.1, (60, task.n))
        h = 10 ** rng.uniform(-3, -0.8, (60, 1)) * rng.uniform(0.2, 1, Q.shape)
        ratio = 2.0 if task.kind in ("pose", "axis") else 0.0
        ours = lifts.rate_bounds(problem, Q, h, np.ones_like(Q), ratio)[0]
        theirs = in_numpy(problem, Q, h, ratio)
        both = np.isfinite(theirs)
        assert both.any(axis=1).mean() > 0.3
        change = np.abs(ours[both] / theirs[both] - 1)
        most = max(most, float(np.nan_to_num(change, nan=1.0).max()))
    return most


def test_c_and_numpy_bound_the_same_rates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if leaf_margin_bounds.library() is None:
        pytest.skip("there is no native library")
    assert differs(cases(tmp_path), None, monkeypatch) < 1e-12


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_wrong_term_of_the_rates_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if leaf_margin_bounds.library() is None:
        pytest.skip("there is no native library")
    given = cases(tmp_path)
    for name, (piece, instead) in INVERSE_C.items():
        library = compiled(tmp_path, "inverse_bounds.c", piece, instead)
        assert differs(given, library, monkeypatch) > 1e-8, name
