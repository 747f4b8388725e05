"""The closing radius: bounds of G_r hold, paths within it close, and rings never fit into it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from time import thread_time

import numpy as np
import pinocchio as pin
import pytest
from arms import planar_task, sliding_task, spatial_task
from closed_paths import lifted_round
from inside import leaf_margin_bounds, lifts
from mimic_arm import arm
from proofs import design_of, near_null_space, regular_start

import repctl_pin as rp


def rates(design: rp.Design, Q: np.ndarray, ratio: float) -> np.ndarray:
    """``‖g_v‖ + ratio ‖g_ω‖`` of the rows of G_r, (K, n)."""
    task, V = design.task, design.inverse.potentials.gradients(Q)
    J_V = np.concatenate([task.jacobians(Q), np.swapaxes(V, 1, 2)], axis=1)
    G = np.linalg.inv(J_V)[:, :, : task.m]
    k = 3 if task.kind in ("pose", "axis", "position") else 2
    return np.asarray(
        np.linalg.norm(G[:, :, :k], axis=2) + ratio * np.linalg.norm(G[:, :, k:], axis=2)
    )


def cases(folder: Path) -> list[tuple[rp.Design, float]]:
    """Designs of all kinds of tasks, r = 1 and more, with prismatic and driven joints."""
    tasks = [
        spatial_task(7, folder, kind="pose", seed=1),
        spatial_task(8, folder, kind="pose", seed=2),
        spatial_task(6, folder, kind="axis", seed=3),
        spatial_task(5, folder, kind="position", seed=4),
        planar_task([0.5, 0.4, 0.3, 0.2], folder),
        sliding_task(folder),
        rp.Robot.load(arm(folder, {6: 'joint="j2" multiplier="0.5"'})).task("l7", "position"),
    ]
    out = []
    for i, task in enumerate(tasks):
        q = regular_start(task, i)
        box = rp.Box(q, 0.3)
        degree = 4 if i in (1, 4) else 2
        rough = 0.3 if degree == 2 else 0.03
        potentials = near_null_space(task, q, 0.3, i, rough=rough, degree=degree)
        ratio = 2.0 if task.kind in ("pose", "axis") else 0.0
        out.append((design_of(task, potentials, box), ratio))
    return out


def problem_of(design: rp.Design) -> leaf_margin_bounds.LeafMarginProblem:
    return leaf_margin_bounds.leaf_margin_of(design.task, design.inverse.potentials, design.region)


@pytest.mark.slow
def test_bounds_of_the_inverse_hold_and_are_close(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for design, ratio in cases(tmp_path):
        n, q = design.task.n, design.region.center
        problem = problem_of(design)
        for width in (0.1, 0.03, 0.01):
            Q = q + rng.uniform(-0.1, 0.1, (40, n))
            half = width * rng.uniform(0.2, 1, (40, n))
            most = np.ones((40, n))
            bound, value, split = lifts.rate_bounds(problem, Q, half, most, ratio)
            np.testing.assert_allclose(value, rates(design, Q, ratio), rtol=1e-9)
            found = value.copy()
            for s in np.sign(rng.uniform(-1, 1, (60, 1, n))):
                found = np.maximum(found, rates(design, Q + s * half, ratio))
            assert (found <= bound).all() and (split < n).all()
            if width < 0.02:
                assert np.median(bound / found) < 1.05, design.task


def sampled_radius(design: rp.Design, ratio: float) -> float:
    """``∫₀¹ ds / K(s)`` of the largest sampled rates K on shells of a box."""
    D, q, n = design.region.half_width, design.region.center, design.task.n
    U = np.sign(np.random.default_rng(0).uniform(-1, 1, (2000, n)))
    K = [(rates(design, q + s * D * U, ratio) / D).max() for s in np.arange(1, 25) / 24]
    return float(sum(1 / 24 / np.maximum.accumulate(K)))


@pytest.mark.slow
def test_the_panda_s_radius_is_close_to_the_sampled_one(panda_design: rp.Design) -> None:
    closes = rp.prove(panda_design, margin=0.3, seconds=60).closes
    assert closes and closes.around == "start" and closes.kind == "pose"
    sampled = sampled_radius(panda_design, 3.0)
    assert closes.metres < 1.2 * sampled
    if closes.complete:  # within the time, which other programs may have used
        assert closes.metres > 0.9 * sampled
    assert closes.radians == pytest.approx(3 * closes.metres)


TIGHT = {
    "xarm7": ("link_eef", "pose", [0, -0.5, 0, 1.0, 0, 1.4, 0]),
    "baxter": ("right_gripper", "pose", [0, -0.4, 0, 1.0, 0, 0.9, 0]),
    "prr": ("tool", "xy", None),  # a rail
    "tiago": ("wrist_ft_tool_link", "pose", [0.25, 0.9, -0.4, -0.8, 1.6, -0.5, 0.6, 0.5]),
    "planar4r": ("tool", "xy", [0.3, 0.7, 0.7, 0.7]),
}
"""Frame, kind of task and start of robots."""


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("name", TIGHT)
def test_radii_are_close_to_sampled_ones(name: str) -> None:
    frame, kind, start = TIGHT[name]
    task = rp.Robot.load(name).task(frame, kind)
    q = np.array(task.reference if start is None else start)
    options = rp.FitOptions(samples=256, held_out=128)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), None, rp.Box(q, 0.3), degree=2, options=options
    )
    closes = rp.prove(design, margin=0.1, seconds=60).closes
    sampled = sampled_radius(design, 3.0 if kind == "pose" else 0.0)
    assert 0.9 * sampled < closes.metres < 1.2 * sampled


@pytest.mark.slow
def test_wild_paths_within_the_radius_close(tmp_path: Path, panda_design: rp.Design) -> None:
    rng = np.random.default_rng(1)
    designs = [design for design, _ in cases(tmp_path)]
    for design in [designs[0], designs[2], panda_design]:  # the others take seconds
        proof = rp.prove(design, margin=0.01, seconds=2, closes=0.005)
        if not proof.closes:
            assert proof.closes.reason
            continue
        before, after, share = lifted_round(design, proof.closes, 5, rng, paths=4, step=0.4)
        assert np.abs(before - after).max() < 1e-9 and share < 1


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_long_wild_paths_within_the_largest_radius_close(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    for design, _ in cases(tmp_path):
        closes = rp.prove(design, margin=0.01, seconds=2).closes
        for corners in (12, 90) if closes else ():
            before, after, share = lifted_round(design, closes, corners, rng, paths=50, step=0.3)
            assert np.abs(before - after).max() < 1e-9 and share < 1


def against_balls(folder: Path, boxes: int) -> None:
    """The true rates, at corners and centres of boxes down to rounding, are below their bounds."""
    pytest.importorskip("flint")
    from arb_rates import rates_in_balls

    rng = np.random.default_rng(0)
    given = cases(folder)[:-1]  # the last one has driven joints
    for design, ratio in given:
        n, K = design.task.n, -(-boxes // len(given))
        problem = problem_of(design)
        Q = design.region.center + rng.uniform(-0.1, 0.1, (K, n))
        half = 10 ** rng.uniform(-15, -1.5, (K, 1)) * rng.uniform(0.2, 1, (K, n))
        bound, _, _ = lifts.rate_bounds(problem, Q, half, np.ones_like(Q), ratio)
        assert np.isfinite(bound).mean() > 0.9
        for q, h, most in zip(Q, half, bound, strict=True):
            for side in (0, *np.sign(rng.uniform(-1, 1, (2, n)))):
                true = rates_in_balls(design, q + side * h * (1 - 1e-12), ratio)
                assert all(x < y for x, y in zip(true, most, strict=True))
        exact = replace(problem, eps=0.0, round=0 * problem.round)
        bound, _, _ = lifts.rate_bounds(exact, Q, half, np.ones_like(Q), ratio)
        assert not np.isfinite(bound).any()  # a kernel without rounding refuses itself


@pytest.mark.slow
def test_bounds_against_ball_arithmetic(tmp_path: Path) -> None:
    against_balls(tmp_path, 24)


@pytest.mark.slow
def test_many_bounds_against_ball_arithmetic(tmp_path: Path) -> None:
    against_balls(tmp_path, 1000)


def test_what_is_asked_is_proved_or_refused(panda_design: rp.Design) -> None:
    tiny = rp.Box(panda_design.region.center, 0.05)
    small = rp.prove(panda_design, margin=0.3, closes=(0.02, 0.05))
    assert small and small.closes.metres >= 0.02 and small.closes.radians >= 0.05
    large = rp.prove(panda_design, margin=0.3, closes=0.5, region=tiny)
    assert not large and "closing radius" in large.reason
    still = rp.prove(panda_design, margin=0.3, ratio=0, closes=0.02)
    assert still.closes.radians == 0 and "constant orientation" in str(still.closes)
    assert rp.prove(panda_design, margin=0.3, closes=False).closes is None
    with pytest.raises(rp.InputError, match="closes"):
        rp.prove(panda_design, closes=(0.1, 0.2, 0.3))
    with pytest.raises(rp.InputError, match="ratio"):
        rp.prove(panda_design, ratio=-1)


@pytest.mark.slow
def test_a_smaller_radius_is_proved_in_fewer_boxes(tmp_path: Path) -> None:
    design, _ = cases(tmp_path)[3]
    largest = rp.prove(design, margin=0.01, seconds=5).closes
    for share in (0.5, 0.1):
        closes = rp.prove(design, margin=0.01, seconds=5, closes=share * largest.metres).closes
        assert closes.metres >= share * largest.metres and closes.complete
        assert closes.boxes < largest.boxes / 10 and "requested" in closes.reason


@pytest.mark.slow
def test_a_radius_takes_the_time_that_is_given(panda_design: rp.Design) -> None:
    taken, metres = [], []
    for seconds in (0.05, 1.0):
        begin = thread_time()
        closes = rp.prove(panda_design, margin=0.3, seconds=seconds).closes
        taken.append(thread_time() - begin)
        metres.append(closes.metres)
    assert metres[0] < metres[1] and taken[0] < taken[1]


def test_a_pose_is_inside_or_beyond_the_radius(panda_design: rp.Design) -> None:
    closes = rp.prove(panda_design, margin=0.3, closes=(0.02, 0.05)).closes
    at = panda_design.task.placement(closes.start)
    for d, angle, inside in ((0.019, 0.0, True), (0.021, 0.0, False), (0, 0.049, True)):
        turned = pin.exp3(angle * np.array([0, 0.6, 0.8]))
        pose = pin.SE3(turned @ at.rotation, at.translation + [0, d, 0])
        assert closes.contains(pose) is inside
    assert not closes.contains(
        pin.SE3(pin.exp3(np.array([0, 0.06, 0])) @ at.rotation, at.translation)
    )


def test_the_certificate_holds_the_radius(panda_design: rp.Design, tmp_path: Path) -> None:
    proof = rp.prove(panda_design, margin=0.3, closes=(0.02, 0.05))
    design = replace(panda_design, proof=proof)
    rp.save(design, tmp_path / "d.json")
    loaded = rp.load_design(tmp_path / "d.json").proof
    assert loaded.seal == proof.seal and loaded.closes.words == proof.closes.words
    with pytest.raises(rp.InputError, match="cannot be changed in part"):
        replace(proof, closes=replace(proof.closes, metres=1.0))
    assert "closing       closed paths within 2 cm" in proof.summary()


@pytest.mark.slow
def test_a_singular_start_has_no_radius_and_says_so(panda_pose: rp.Task) -> None:
    q = panda_pose.reference
    J = panda_pose.jacobian(q)
    flat = rp.Polynomial(q, 1).weighted(J[:1].T)  # V is a row of J
    proof = rp.prove(design_of(panda_pose, flat, rp.Box(q, 0.1)), seconds=1)
    assert not proof and not proof.closes and proof.closes.metres == 0
    assert "singular" in proof.closes.words


def test_no_radius_says_why(panda_pose: rp.Task) -> None:
    q = panda_pose.reference
    J = panda_pose.jacobian(q)
    N = np.linalg.svd(J)[2][-1:]
    for V, width, said in (
        (N, 1e-3, r"panda_joint\d may leave Ω, 0.001 rad away"),
        (J[:1] + 1e-3 * N, 0.1, "J_V is singular in Ω"),
    ):
        design = design_of(panda_pose, rp.Polynomial(q, 1).weighted(V.T), rp.Box(q, width))
        closes = rp.prove(design, seconds=0.2).closes
        assert not closes and re.search(said, closes.words)


@pytest.mark.slow
def test_around_a_path_that_closes_others_close(panda_design: rp.Design) -> None:
    start = panda_design.region.center
    path = rp.Problem(panda_design.task, start=start, path="circle:0.02").cycle
    proof = rp.prove(panda_design, margin=0.3, closes=path)
    assert proof and proof.closes.around == "path" and len(proof.closes.positions) > 50
    before, after, share = lifted_round(
        panda_design, proof.closes, 40, np.random.default_rng(0), step=0.5
    )
    assert np.abs(before - after).max() < 1e-9 and share < 1


@pytest.fixture(scope="module")
def planar() -> rp.Design:
    """A proved design of the planar arm."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    region = rp.Box(np.array([0.3, 0.8, 0.8]), 0.6)
    design = rp.nearest_repeatable(rp.Pseudoinverse(task), None, region, degree=2)
    return replace(design, proof=rp.prove(design, seconds=5))


def test_the_whole_path_is_within_its_own_radius(planar: rp.Design) -> None:
    """Poses are compared at most a radius apart: a design's own cycle was 40 % "beyond" it."""
    task, q = planar.task, planar.region.center
    path = rp.circle(task, q, 0.58)
    closes = rp.prove(planar, closes=path, seconds=20).closes
    # a hundred poses are more than two radii apart
    assert closes.around == "path" and np.pi * 0.58 / 100 > closes.metres > 1e-3
    motion = rp.follow(planar.inverse, path, q, cycles=1, steps=997)
    assert replace(motion, closing_radius=closes).beyond_closing_radius == 0
    # the circle begins at q, and its centre is 0.58 m away
    centre = (closes.positions.max(axis=0) + closes.positions.min(axis=0)) / 2
    for share, inside in ((0.8, True), (1.01, False)):
        pose = task.placement(q)
        out = pose.translation - centre
        out /= np.linalg.norm(out)
        pose.translation = pose.translation + share * closes.metres * out
        assert closes.contains(pose) == inside


def test_a_motion_knows_its_share_beyond_the_radius(planar: rp.Design) -> None:
    task, q, closes = planar.task, planar.region.center, planar.proof.closes
    assert closes.around == "start"
    shares = []
    for radius in (0.4, 0.8, 1.6):  # of circles through the start, in closing radii
        path = rp.circle(task, q, radius * closes.metres)
        motion = rp.follow(planar.inverse, path, q, cycles=1, steps=100)
        assert motion.beyond_closing_radius is None
        motion = replace(motion, closing_radius=closes)
        away = np.linalg.norm(task.positions(motion.q) - closes.positions[0], axis=1)
        assert motion.beyond_closing_radius == (away > closes.metres).mean()
        shares.append(motion.beyond_closing_radius)
    assert shares[0] == 0 < shares[1] < shares[2] < 1


def test_a_governor_knows_when_its_arm_is_beyond_the_radius(planar: rp.Design) -> None:
    """By pose, and wherever the arm is if it is on another leaf than the proved one."""
    task, q, closes = planar.task, planar.region.center, planar.proof.closes
    limits = rp.Limits(acceleration=50.0)

    def governor(radius: rp.ClosingRadius | None) -> rp.Governor:
        return rp.Governor(planar.inverse, 0.01, limits, closes=radius)

    moving, here = governor(closes), task.placement(q)
    moving.start(q)
    seen = set()
    for share in (0.3, 1.1, 0.3):
        target = here.copy()
        target.translation[0] -= share * closes.metres
        for _ in range(400):
            at, _ = moving.step(target)
            away = np.linalg.norm(task.placement(at).translation - here.translation)
            assert moving.beyond_closing_radius == (away > closes.metres)
            seen.add(moving.beyond_closing_radius)
        assert away == pytest.approx(share * closes.metres, abs=1e-6)
    assert seen == {True, False}
    beside = q + 0.01 * rp.redundancy.nullspace(task.jacobian(q))[:, 0]
    assert planar.inverse.same_leaf(q, moving.q)
    assert not planar.inverse.same_leaf(q, beside)
    moving.start(beside)
    assert closes.contains(task.placement(beside)) and moving.beyond_closing_radius
    none = governor(None)
    none.start(q)
    assert none.beyond_closing_radius is None
    with pytest.raises(rp.InputError, match="closes"):
        governor(0.1)  # type: ignore[arg-type]
