"""The closing radius of several frames: each within the radius of its own start pose."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from closed_paths import turned_by, turns, values, wild_poses
from controls import some
from kernels import kernels, use
from proofs import design_of, near_null_space
from test_closing_radius import leaf_margin_bounds, lifts, problem_of
from test_proof_several_frames import Q0, design_over, tasks, tree
from two_armed import Q0 as FLAT
from two_armed import two_armed

import repctl_pin as rp


def rates(design: rp.Design, Q: np.ndarray, ratio: float) -> np.ndarray:
    """``Σ_f ‖g_v‖ + ratio ‖g_ω‖`` of the rows of G_r, (K, n)."""
    task, out = design.task, np.zeros(Q.shape)
    for k, q in enumerate(Q):
        V = design.inverse.potentials.gradient(q)
        G = np.linalg.inv(np.vstack([task.jacobian(q), V.T]))[:, : task.m]
        for part in task.parts:
            g, G = G[:, : part.m], G[:, part.m :]
            split = 3 if part.kind in ("pose", "axis") else part.m
            out[k] += np.linalg.norm(g[:, :split], axis=1)
            out[k] += ratio * np.linalg.norm(g[:, split:], axis=1)
    return out


BAXTER = np.array([0.3, -0.6, 0.0, 1.2, 0.0, 0.9, 0.0])
"""Configuration of Baxter's left arm; that of the right one is its mirror image."""

HANDS = np.concatenate([BAXTER, BAXTER * [-1, 1, 1, 1, 1, 1, 1]])


def cases(folder: Path) -> list[rp.Design]:
    """Trees in a plane and in space, hands of two kinds, and hands that hold a tray."""
    baxter = rp.Robot.load("baxter")
    tray = ("right_gripper", "pose", "left_gripper")
    designs = [design_over(task, 0.1) for task in tasks(folder)]
    for seed, task in enumerate(
        [
            baxter.task([("left_gripper", "position"), "right_gripper"]),
            baxter.task([("left_gripper", "axis"), tray]),
        ]
    ):
        field = near_null_space(task, HANDS, 0.1, seed, rough=0.1)
        designs.append(design_of(task, field, rp.Box(HANDS, 0.1)))
    return designs


def baxters_tray() -> rp.Design:
    task = rp.Robot.load("baxter").task(["left_gripper", ("right_gripper", "pose", "left_gripper")])
    basis = rp.Polynomial(HANDS, 1, 0.3)
    options = rp.FitOptions(samples=128, held_out=64)
    return rp.nearest_repeatable(
        rp.Pseudoinverse(task), basis, rp.Box(HANDS, 0.05), options=options
    )


def holds(designs: list[rp.Design], boxes: int = 4) -> bool:
    """Test whether bounds of G_r hold at corners of boxes, and are close in small ones."""
    rng = np.random.default_rng(0)
    for design in designs:
        problem, task = problem_of(design), design.task
        ratios = np.array([2.0 * part.kind.turns for part in task.parts])
        for width in (1e-7, 0.01):
            Q = design.region.center + rng.uniform(-0.05, 0.05, (boxes, task.n))
            half = width * rng.uniform(0.2, 1, Q.shape)
            ones = np.ones_like(Q)
            bound, value, _ = lifts.rate_bounds(problem, Q, half, ones, ratios)
            found = rates(design, Q, 2.0)
            if not np.allclose(value, found, rtol=1e-8):
                return False
            for s in np.sign(rng.uniform(-1, 1, (8, *Q.shape))):
                found = np.maximum(found, rates(design, Q + s * half, 2.0))
            if not (found <= bound).all() or np.median(bound / found) > 1.3:
                return False
    return True


def test_bounds_of_the_inverse_hold_and_are_close(tmp_path: Path) -> None:
    assert holds(cases(tmp_path))


WRONG = {
    "one frame's inverse": ("*x = A[i] + 6 * f;", "*x = A[i];"),
    "one frame's tool": ("*chain = g->frame + f;", "*chain = g->frame;"),
    "one frame's slopes": ("dZ[j][i][6 * f + k]", "dZ[j][i][k]"),
    "one frame's ratio": ("ratio = rows->ratio[f];", "ratio = rows->ratio[0];"),
    "the last frame only": ("row->apart += sqrt", "row->apart = sqrt"),
}
"""What is wrong with several frames: a piece of inverse_bounds.c, and what is put instead."""


@pytest.mark.slow
@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_with_a_frame_is_noticed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    designs = cases(tmp_path)
    use(monkeypatch, leaf_margin_bounds, kernels("inverse_bounds.c", *WRONG[name]))
    assert not holds(designs)


def lift(
    design: rp.Design, q: np.ndarray, p: np.ndarray, R: np.ndarray, count: int
) -> tuple[np.ndarray, float]:
    """Follow straight lines of all frames, p (C, F, 3) and R (C, F, 3, 3), on the leaf of q.

    Returns the end, and the largest share of Ω that was used.
    """
    task, h = design.task, design.inverse.potentials
    c, most = values(h, q[None])[0], 0.0
    for a in range(len(p) - 1):
        turn = turned_by(np.swapaxes(R[a], 1, 2) @ R[a + 1])
        for s in (np.arange(count) + 1) / count:
            at = (1 - s) * p[a] + s * p[a + 1], R[a] @ turns(s * turn)
            target = [pin.SE3(r, x) for x, r in zip(*at, strict=True)]
            for _ in range(12):
                e = np.concatenate([task.error(q, target), c - h.value(q)])
                J_V = np.vstack([task.jacobian(q), h.gradient(q).T])
                q = q + np.linalg.solve(J_V, e)
                if np.abs(e).max() < 1e-13:
                    break
            most = max(most, float(design.region.ratio(q[None])[0]))
    return q, most


def wild(
    closes: rp.ClosingRadius, corners: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Closed polygons of all frames within a radius: (C + 1, F, 3) and (C + 1, F, 3, 3)."""
    found = []
    for f, kind in enumerate(closes.kind.split(" + ")):
        part = slice(3 * f, 3 * f + 3)
        own = SimpleNamespace(
            kind=kind,
            metres=closes.metres,
            radians=closes.radians if kind in ("pose", "axis") else 0.0,
            positions=closes.positions[:, part],
            rotations=closes.rotations[:, part],
        )
        found.append(wild_poses(own, 0.999, corners, 1, rng))
    p, R = (np.concatenate(parts, axis=1) for parts in zip(*found, strict=True))
    return p, R


@pytest.mark.parametrize("k", some(range(4), 1))
def test_wild_paths_of_both_hands_within_the_radius_close(k: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for design in [baxters_tray() if k == 3 else cases(tmp_path)[k]]:
        closes = rp.prove(design, margin=0.01, closes=0.001, seconds=3).closes
        assert closes, closes
        p, R = wild(closes, 8, rng)
        begin = (closes.positions.reshape(1, -1, 3), closes.rotations.reshape(1, -1, 3, 3))
        ahead = (np.concatenate([x, y[:1]]) for x, y in zip(begin, (p, R), strict=True))
        before, first = lift(design, closes.start, *ahead, 4)
        after, most = lift(design, before, p, R, 4)
        assert np.abs(before - after).max() < 1e-9 and max(first, most) < 1


@pytest.mark.slow
def test_around_the_paths_of_both_hands_others_close(tmp_path: Path) -> None:
    design = design_over(tasks(tmp_path)[1], 0.1)
    path = rp.several_paths(
        design.task, Q0, [lambda task, q: rp.circle(task, q, 0.01, normal="z"), None]
    )
    closes = rp.prove(design, margin=0.01, closes=path, seconds=2).closes
    assert closes and closes.around == "path" and closes.positions.shape[1] == 6
    p, R = wild(closes, 20, np.random.default_rng(2))
    begin = closes.positions[:1].reshape(1, -1, 3), closes.rotations[:1]
    ahead = (
        np.concatenate([begin[0], p[:1]]),
        np.concatenate([begin[1].reshape(1, -1, 3, 3), R[:1]]),
    )
    before, _ = lift(design, closes.start, *ahead, 4)
    after, most = lift(design, before, p, R, 4)
    assert np.abs(before - after).max() < 1e-9 and most < 1


@pytest.mark.slow
def test_hands_that_go_round_the_base_are_not_within_the_radius(tmp_path: Path) -> None:
    task = tree(tmp_path).task(["left", "right"], "xy")
    N = np.linalg.svd(task.jacobian(Q0))[2][task.m :].T
    N[0] *= 0.1  # a turn of the waist changes the other joints by less than Ω allows
    wide = np.array([8.0, *(6 * [0.9])])
    field = rp.Polynomial(Q0, 1).weighted(N)
    design = design_of(task, field, rp.Box(Q0, wide))
    a = np.linspace(0, 2 * np.pi, 49)
    turn = pin.utils.rotate("z", a[1])
    p = [np.array([x.translation for x in task.placements(Q0)])]
    for _ in a[1:]:
        p.append(p[-1] @ turn.T)
    R = np.tile(np.eye(3), (len(p), 2, 1, 1))
    end, share = lift(design, Q0, np.array(p), R, 2)
    assert share < 1 and np.abs(end[1:] - Q0[1:]).max() > 0.05  # it does not close
    closes = rp.prove(design, seconds=0.5).closes
    targets = [[pin.SE3(np.eye(3), x) for x in each] for each in p]
    assert not all(closes.contains(target) for target in targets)
    assert closes.contains(task.placements(Q0))


def test_each_frame_counts(tmp_path: Path) -> None:
    design = design_over(tasks(tmp_path)[1], 0.1)
    proof = rp.prove(design, margin=0.01, closes=0.001, seconds=2)
    there = design.task.placements(Q0)
    for f in range(2):
        away = [pin.SE3(x) for x in there]
        away[f].translation[0] += 2 * proof.closes.metres
        assert not proof.closes.contains(away)
    assert proof.closes.contains(there)
    with pytest.raises(rp.InputError, match="2 placements, one per frame"):
        proof.closes.contains(there[0])


@pytest.mark.slow
def test_a_file_holds_the_radius_of_both_hands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = tree(tmp_path).task(["left", "right"], "xy")
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), rp.Polynomial(Q0, 1, 0.1), rp.Box(Q0, 0.1)
    )
    proof = rp.prove(design, margin=0.01, closes=0.001)
    rp.save(replace(design, proof=proof), tmp_path / "d.json")
    again = rp.load_design(tmp_path / "d.json", task).proof
    np.testing.assert_array_equal(again.closes.positions, proof.closes.positions)
    assert again.seal == proof.seal and again.closes.positions.shape == (1, 6)
    with pytest.raises(rp.InputError, match="load it with the task: ") as refused:
        rp.load_design(tmp_path / "d.json")
    asked = str(refused.value).split("load it with the task: ")[1]
    monkeypatch.chdir(tmp_path)
    assert eval(asked).proof.seal == proof.seal


@pytest.mark.slow
def test_a_study_of_two_hands_says_whether_near_paths_close(
    tmp_path: Path, quick_choices: None
) -> None:
    """Issue 52, item 26.17: a proved radius, or the note that the time did not suffice."""
    task = two_armed(tmp_path).task
    few = rp.FitOptions(samples=64, held_out=64)
    study = rp.study(rp.Problem(task, start=FLAT), cycles=1, steps=60, degree=1, options=few)
    noted = [note for note in study.notes if note.startswith("closed paths near this one: not")]
    proof = study.design.proof
    assert (proof is not None and proof.closes is not None) != bool(noted)
