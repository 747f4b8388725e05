"""Closed paths of hand and elbow, (x, c): proved to close within a distance of pose and levels."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from arms import planar_task, sliders_task, spatial_task
from controls import some
from proofs import design_of, near_null_space, regular_start

import repctl_pin as rp

FEW = rp.FitOptions(samples=256, held_out=256)
LIMITS = rp.Limits(velocity=2.0, acceleration=6.0, jerk=400.0)


def newton(design: rp.Design, x: pin.SE3, c: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Solve f = x, h = c near q, without a solver of the package."""
    task, h = design.task, design.inverse
    for _ in range(12):
        e = np.concatenate([task.error(q, x), c - h.leaf(q)])
        V = h.potentials.gradients(q[None])[0]
        step = np.linalg.solve(np.concatenate([task.jacobian(q), V.T]), e)
        q = q + step
        if np.abs(step).max() < 1e-13:
            return q
    raise AssertionError("Newton's method did not converge")


def go(
    design: rp.Design, x0: pin.SE3, a: tuple, b: tuple, q: np.ndarray, visit: list[np.ndarray]
) -> np.ndarray:
    """Move pose and levels from a to b along a straight line in small steps, from q."""
    (p, w, c), (p1, w1, c1) = a, b
    far = max(np.linalg.norm(p1 - p), np.linalg.norm(w1 - w), np.abs(c1 - c).max())
    count = int(np.ceil(far / 0.01)) + 1
    for s in np.linspace(0, 1, count + 1)[1:]:
        R = pin.exp3(w + s * (w1 - w)) @ x0.rotation
        x = pin.SE3(R, x0.translation + p + s * (p1 - p))
        q = newton(design, x, c + s * (c1 - c), q)
        visit.append(q)
    return q


def wild(rng: np.random.Generator, closes: rp.ClosingRadius, r: int, planar: bool) -> tuple:
    """A pose and levels inside the radius, mostly at its edge: Δp, Δω, Δc."""
    p, w = rng.normal(size=(2, 3))
    p *= [1, 1, 0] if planar else 1
    p *= 0.999 * closes.metres * rng.choice([1, 0.5]) / np.linalg.norm(p)
    w *= 0.999 * (closes.radians or 0.0) * rng.choice([1, 0.5]) / np.linalg.norm(w)
    return p, w, 0.999 * closes.leaf * rng.choice([-1, 1, 0.3], r)


def attack(
    design: rp.Design, closes: rp.ClosingRadius, paths: int, seed: int
) -> tuple[float, float]:
    """The largest gap of random closed paths of (x, c), and the largest share of Ω they use."""
    task, x0 = design.task, design.task.placement(closes.start)
    rng, gap, ratio = np.random.default_rng(seed), 0.0, 0.0
    c0, planar = design.inverse.leaf(closes.start), len(task.rows) == 2
    for _ in range(paths):
        corners = [wild(rng, closes, task.r, planar) for _ in range(4)]
        corners = [(p, w, c0 + c) for p, w, c in corners]
        visit: list[np.ndarray] = []
        home = (np.zeros(3), np.zeros(3), c0)
        begin = q = go(design, x0, home, corners[0], closes.start, visit)
        for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
            q = go(design, x0, a, b, q, visit)
        gap = max(gap, float(np.abs(q - begin).max()))
        ratio = max(ratio, float(design.region.ratio(np.array(visit)).max()))
    return gap, ratio


def small(folder: Path, name: str) -> rp.Design:
    """Designs with r = 1, 2 and 3, near the null space and bent."""
    task = {
        "planar r = 1": lambda: planar_task([0.5, 0.4, 0.3], folder),
        "planar r = 2": lambda: planar_task([0.5, 0.4, 0.3, 0.2], folder),
        "spatial r = 3": lambda: spatial_task(6, folder, seed=4),
    }[name]()
    q = regular_start(task, 4)
    field = near_null_space(task, q, 0.3, 4, rough=0.2, degree=2)
    return design_of(task, field, rp.Box(q, 0.3))


@pytest.mark.parametrize(
    "name", some(["planar r = 1", "planar r = 2", "spatial r = 3"], "planar r = 1")
)
def test_random_closed_paths_of_hand_and_elbow_close(name: str, tmp_path: Path) -> None:
    design = small(tmp_path, name)
    leaf = 0.03 if design.task.r == 3 else 0.06
    closes = rp.prove(design, leaf=leaf, seconds=10).closes
    assert closes and closes.leaf == leaf
    assert (
        "of hand and elbow within" in closes.words and f"{leaf} of its levels close" in closes.words
    )
    gap, ratio = attack(design, closes, 4, 0)
    assert gap < 1e-9 and ratio < 1
    smaller = rp.prove(design, seconds=10).closes
    assert smaller.leaf == 0 and smaller.metres > closes.metres


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "kinova position", "baxter"])
def test_random_closed_paths_on_arms_close(name: str) -> None:
    """57.3: 100 paths each, of four corners at the edge of the proved region."""
    robot, _, kind = name.partition(" ")
    task = rp.Robot.load(robot).task(**({"kind": kind} if kind else {}))
    q0 = task.reference if robot == "panda" else rp.Problem(task).start
    wide = 0.4 if robot == "panda" else 0.25
    desired, basis = rp.Pseudoinverse(task), rp.Polynomial(q0, 2, wide)
    design = rp.nearest_repeatable(desired, basis, rp.Box(q0, wide), options=FEW)
    closes = rp.prove(design, leaf=0.05, seconds=20).closes
    assert closes.metres > 0.01
    gap, ratio = attack(design, closes, 100, 1)
    assert gap < 1e-9 and ratio < 1


def turning_back(design: rp.Design, q0: np.ndarray, side: int) -> float:
    """How far the level of q1 changes along the self-motion until it turns back."""
    task, q, before = design.task, q0, np.array([side, 0.0, 0.0])
    for _ in range(6000):
        normal = np.linalg.svd(task.jacobian(q))[2][-1]
        normal *= np.sign(normal @ before)
        if side * normal[0] < 0:
            return abs(float((design.inverse.leaf(q) - design.inverse.leaf(q0))[0]))
        q, before = q + 1e-3 * normal, normal
        q = q + np.linalg.pinv(task.jacobian(q)) @ task.error(q, task.placement(q0))
    raise AssertionError("h does not turn back")


@pytest.mark.slow
def test_what_passes_a_singularity_is_refused(tmp_path: Path) -> None:
    """A planar arm whose levels end where V'N is 0: no leaf beyond is proved, up to near it."""
    task = planar_task([0.5, 0.4, 0.3], tmp_path)
    q0 = np.array([0.3, 0.9, -0.4])
    potentials = rp.Polynomial(q0, 1, 1.0).weighted(np.array([[1.0], [0.0], [0.0]]))
    design = design_of(task, potentials, rp.Box(q0, 2.5))
    end = min(turning_back(design, q0, side) for side in (1, -1))
    reason = {
        share: rp.prove(design, leaf=share * end, seconds=0.1).closes.reason
        for share in (0.9, 1.01)
    }
    assert not reason[0.9].startswith("levels within") and reason[1.01].startswith("levels within")
    found = rp.prove(design, leaf=1.2 * end, seconds=0.1).closes
    assert not found and found.metres == 0
    narrow = design_of(task, potentials, rp.Box(q0, 0.05))
    found = rp.prove(narrow, leaf=0.9 * end, seconds=0.1).closes
    assert not found and "may leave Ω" in found.reason


def test_files_keep_the_levels_and_refuse_a_change(tmp_path: Path) -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q0 = np.array([0.3, 0.8, 0.8])
    desired, basis = rp.Pseudoinverse(task), rp.Polynomial(q0, 2, 0.3)
    design = rp.nearest_repeatable(desired, basis, rp.Box(q0, 0.3), options=FEW)
    design = replace(design, proof=rp.prove(design, leaf=0.1, seconds=5))
    file = tmp_path / "design.json"
    rp.save(design, file)
    assert rp.load(file).proof.closes.leaf == 0.1
    assert file.read_text("utf-8").count('"leaf": 0.1') == 1
    # a governor's level may move within the radius, and not beyond
    closes, inverse, x = design.proof.closes, design.inverse, task.placement(q0)
    for off, out in ((0.09, False), (0.11, True)):
        q = newton(design, x, inverse.leaf(q0) + off, q0)
        for radius, expected in ((closes, out), (replace(closes, leaf=0.0), True)):
            governor = rp.Governor(inverse, 1e-3, LIMITS, closes=radius)
            governor.start(q)
            assert governor.beyond_closing_radius == expected
    with pytest.raises(rp.InputError, match="cannot be changed in part"):
        replace(design.proof, closes=replace(design.proof.closes, leaf=0.2))


def test_bad_and_far_levels_are_refused_in_one_line() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q0 = np.array([0.3, 0.8, 0.8])
    desired, basis = rp.Pseudoinverse(task), rp.Polynomial(q0, 1, 0.3)
    design = rp.nearest_repeatable(desired, basis, rp.Box(q0, 0.3), options=FEW)
    for leaf in (-1, np.nan, "a", np.inf):
        with pytest.raises(rp.InputError, match="leaf"):
            rp.prove(design, leaf=leaf)
    far = rp.prove(design, leaf=3.0, seconds=0.2).closes
    assert not far and far.reason.startswith("levels within 3 of the start's")
    proof = sys.modules[rp.prove.__module__]
    level_boxes = sys.modules[proof.closing_radius.__module__].level_boxes
    joints = proof.enclosing(*proof.cover(design.region))
    bounds = proof.leaf_margin_of(task, design.inverse.potentials, joints)
    for most, clearance in ((3.0, np.inf), (1e-3, 0.0)):
        boxes = level_boxes(design.inverse, bounds, q0, most, lambda Q, c=clearance: 0 * Q + c)
        assert boxes.reason and not boxes.proved
    with pytest.raises(rp.InputError, match="mutually exclusive"):
        rp.prove(design, leaf=0.1, closes=rp.circle(task, q0, 0.05))
    with pytest.raises(rp.InputError, match="requires"):
        rp.prove(design, leaf=0.1, closes=False)


@pytest.mark.parametrize(
    ("angles", "part", "share"),
    [
        ([0.1, 1.5, 0.7], 0.2, 1.0),
        ([0.1, 1.5, 0.7], 0.2, 0.98),
        ([0.1, 1.5, 0.7], 0.7, 1.0),
        ([0.1, 1.5, 0.7, 2.5], 0.2, 1.0),
        ([0.1, 1.5, 0.7, 2.5], 0.2, 0.98),
    ],
)
@pytest.mark.parametrize("side", [1, -1])
def test_levels_of_a_linear_arm_cost_exactly_their_motion(
    angles: list[float],
    side: int,
    part: float,
    share: float,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With q = q0 + G Δx + N Δc, joint i is within |G_i| ρ + |N_i| γ of its start, and no less.

    The start is nearer to the faces of Ω that the joints reach at one end of the levels. A solver
    that goes only a share of the way to a level changes nothing. The levels go a part of the way to
    the face.
    """
    task, wide = sliders_task(angles, tmp_path), 0.3
    n, r, center = task.n, task.r, np.full(task.n, 0.4)
    V = np.linalg.svd(task.jacobian(center))[2][-r:].T + 0.2 * np.eye(n)[:, :r]
    field = rp.Polynomial(center, 1, 1.0).weighted(V)
    J_V = np.concatenate([task.jacobian(center), field.gradients(center[None])[0].T])
    both = np.linalg.inv(J_V)
    G, N = np.linalg.norm(both[:, :2], axis=1), both[:, 2:]
    start = center + 0.02 * side * np.sign(N[:, 0])
    cycle = rp.paths.task_path.Cycle(start, rp.circle(task, start, 0.01), 1.0)
    solve = rp.RepeatableInverse.solve

    def short(self: rp.RepeatableInverse, x: pin.SE3, q: np.ndarray, *, leaf: np.ndarray) -> object:
        c = self.leaf(start)
        return solve(self, x, q, leaf=c + share * (leaf - c))

    monkeypatch.setattr(rp.RepeatableInverse, "solve", short)
    left = wide - np.abs(start - center)
    leaf = part * float((left / np.abs(N).sum(axis=1)).min())
    left -= leaf * np.abs(N).sum(axis=1)

    def closes(half: np.ndarray | float, at: np.ndarray, leaf: float) -> rp.ClosingRadius:
        design = replace(design_of(task, field, rp.Box(at, half)), cycle=cycle)
        return rp.prove(design, leaf=leaf, seconds=10).closes

    found, exact = closes(wide, center, leaf), (left / G).min()
    assert 0.85 * exact < found.metres <= exact
    assert found.metres == pytest.approx(closes(left, start, 0.0).metres, rel=1e-6)
    beyond = closes(wide, center, 1.3 * leaf / part)
    assert beyond.metres == 0 and beyond.reason.endswith("may leave Ω")


@pytest.mark.parametrize(
    ("side", "wide"), [(1, 0.3), (-1, 0.3), pytest.param(1, 7.0, marks=pytest.mark.slow)]
)
def test_a_solver_that_jumps_to_another_configuration_is_noticed(
    side: int, wide: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A turn of the first joint keeps pose and levels, and J_V is regular; the joints differ."""
    task = planar_task([0.5, 0.4, 0.3], tmp_path)
    q0, turn = np.array([0.3, 0.9, -0.4]), np.array([2 * np.pi, 0, 0])
    waves = rp.Fourier(3, 1)
    null = np.linalg.svd(task.jacobian(q0))[2][-1]
    A = np.linalg.lstsq(waves.gradients(q0[None])[0], null, rcond=None)[0]
    design = design_of(task, waves.weighted(A[:, None]), rp.Box(q0, wide))
    before, solve = rp.prove(design, leaf=0.01, seconds=0.1).closes, rp.RepeatableInverse.solve
    assert not before.reason.startswith("levels")

    calls = iter(range(25))  # 5 cells, then 17

    def jumping(self: rp.RepeatableInverse, x: pin.SE3, q: np.ndarray, *, leaf: float) -> object:
        if next(calls, None) is None:
            raise rp.InputError("the solver gives up")
        found = solve(self, x, q, leaf=leaf)
        return found + turn * (side * (leaf - self.leaf(q0))[0] > 0.0075)

    monkeypatch.setattr(rp.RepeatableInverse, "solve", jumping)
    closes = rp.prove(design, leaf=0.01, seconds=0.1).closes
    assert closes.metres == 0 and closes.reason.endswith("not reached: the solver gives up")
