"""The best leaf: never worse, and out of limits that the given start breaks."""

from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from arms import planar_task

import repctl_pin as rp

BEST_LEAF = importlib.import_module(rp.best_leaf.__module__)


@pytest.fixture(scope="module")
def tiago() -> rp.Design:
    task = rp.Robot.load("tiago").task("wrist_ft_tool_link", "pose")
    q0 = task.reference
    return rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        rp.Polynomial(q0, 2, 0.2),
        rp.Box(q0, 0.08),
        options=rp.FitOptions(samples=2048, held_out=1024),
    )


def dense(inverse: rp.RepeatableInverse, path: rp.TaskPath, q0: np.ndarray) -> rp.Motion:
    """Two cycles, solved to rounding: with two corrections per step, 2e-8 rad are left."""
    return rp.follow(inverse, path, q0, cycles=2, steps=200, integrator=rp.LeafLock(3))


@pytest.mark.slow
@pytest.mark.parametrize("plane, radius, angle", [("xy", 0.1, np.pi), ("yz", 0.2, 0)])
def test_panda_is_never_worse(
    panda_design, q_panda, plane: str, radius: float, angle: float
) -> None:
    path = rp.circle(panda_design.task, q_panda, radius, normal=plane, start_angle=angle)
    found = rp.best_leaf(panda_design.inverse, path, q_panda)
    assert found.given is not None
    assert (
        found.best.margin >= found.given.margin
        and found.best.limit_margin >= found.given.limit_margin
    )
    assert np.linalg.norm(panda_design.task.error(found.q0, path.placement(0.0))) < 1e-9
    motion = dense(panda_design.inverse, path, found.q0)
    assert motion.drift.max() < 1e-12
    # what it claims is so between its points
    assert abs(motion.limit_margin.min() - found.best.limit_margin) < 5e-3


def walked(
    task: rp.Task, q: np.ndarray, path: rp.TaskPath, length: float, sign: float
) -> np.ndarray:
    """Go along the self-motion of a start, the frame held."""
    along = None
    for _ in range(round(length / 0.1)):
        N = rp.redundancy.nullspace(task.jacobian(q))[:, 0]
        along = N * (sign * np.sign(N[0]) if along is None else np.sign(N @ along))
        q = rp.solve_ik(task, q + 0.1 * along, path.placement(0.0))
    return q


@pytest.mark.slow
@pytest.mark.parametrize("sign", [1.0, pytest.param(-1.0, marks=pytest.mark.slow)])
def test_panda_out_of_a_limit(panda_design, q_panda, sign: float) -> None:
    """Begun with its elbow far out, a circle breaks a limit; from the found start it breaks
    none."""
    path = rp.circle(panda_design.task, q_panda, 0.15, normal="yz", start_angle=np.pi / 2)
    worse = walked(panda_design.task, q_panda, path, 2.5, sign)
    violation = dense(panda_design.inverse, path, worse).first_violation
    assert violation is not None and violation[1].startswith("panda_joint")
    found = rp.best_leaf(panda_design.inverse, path, worse)
    assert found.given is not None and found.given.limit_margin < 0 < found.best.limit_margin
    motion = dense(panda_design.inverse, path, found.q0)
    assert motion.first_violation is None and motion.drift.max() < 1e-12
    assert abs(motion.limit_margin.min() - found.best.limit_margin) < 5e-3
    first, second = found.summary().splitlines()[1:]
    assert "exceeds its limits" in first and "exceeds" not in second


@pytest.mark.slow
def test_tiago_given_start_breaks_a_limit(tiago) -> None:
    q0 = tiago.task.reference
    path = rp.circle(tiago.task, q0, 0.05, normal="xy", start_angle=np.pi)
    violation = dense(tiago.inverse, path, q0).first_violation
    assert violation is not None and violation[1] == "torso_lift_joint"
    found = rp.best_leaf(tiago.inverse, path, q0, steps=32)
    assert found.given is not None and found.best.order > found.given.order
    assert (
        found.best.limit_margin >= found.given.limit_margin
        and found.best.margin > found.given.margin - 0.01
    )
    assert dense(tiago.inverse, path, found.q0).first_violation is None


@pytest.mark.slow
def test_it_stays_in_the_region_and_says_how_near_it_is() -> None:
    task, q0 = rp.Robot.load("planar3r").task("tool", "xy"), np.array([2.0, 0.6, 0.9])
    path, desired = rp.circle(task, q0, 0.05), rp.Pseudoinverse(task)
    design = rp.nearest_repeatable(
        desired, None, rp.Box(q0, 0.2), degree=2, options=rp.FitOptions(samples=512, held_out=256)
    )
    options = {"desired": design.desired, "steps": 24}
    free, kept = (
        rp.best_leaf(design.inverse, path, q0, region=r, **options) for r in (None, design.region)
    )
    assert design.region.ratio(free.best.motion.q).max() > 3  # with no region it leaves
    assert free.best.motion.outside is None and "outside" not in free.summary()
    assert (
        design.region.ratio(kept.best.motion.q).max() <= 1 + 1e-9 and kept.best.motion.outside == 0
    )
    assert kept.best.margin >= kept.given.margin
    assert "from G_d, 0 % outside Ω" in kept.summary()
    for found in (free.best, kept.best):
        G, G_d = (
            np.array([it(q) for q in found.motion.q]) for it in (design.inverse, design.desired)
        )
        assert found.distance == pytest.approx(np.sqrt(np.sum((G - G_d) ** 2) / np.sum(G_d**2)))
    assert kept.best.distance < free.best.distance / 2


@pytest.mark.slow
def test_no_leaf_is_preferred_that_comes_near_an_algorithmic_singularity(
    panda_design, q_panda, monkeypatch
) -> None:
    """A leaf with more room to limits, but a leaf margin under 0.1 and under the given one's, is
    refused."""
    module = BEST_LEAF
    path = rp.circle(panda_design.task, q_panda, 0.02)
    judged, seen = module._Search.evaluated, []

    def rigged(*given):
        """Every other start has a larger margin, and a leaf margin of next to nothing."""
        candidate = judged(*given)
        if candidate is not None and seen:
            relative_margins = {"limits": 9.0, "bodies": 9.0, "leaf": 9.0}
            candidate = replace(
                candidate, relative_margins=relative_margins, limit_margin=9.0, leaf_margin=0.05
            )
        seen.append(candidate)
        return candidate

    monkeypatch.setattr(module._Search, "evaluated", rigged)
    found = rp.best_leaf(panda_design.inverse, path, q_panda, steps=8)
    assert len(seen) > 10 and found.given.leaf_margin > 0.1
    assert found.best is found.given


@pytest.mark.slow
def test_the_seed_fixes_it(monkeypatch) -> None:
    module = BEST_LEAF
    monkeypatch.setattr(module, "_DIRECTIONS", 1)
    monkeypatch.setattr(module, "_STRIDE", 0.5)
    task, q0 = (rp.Robot.load("planar4r").task("tool", "xy"), np.array([0.3, 0.8, 0.5, 0.7]))
    inverse = rp.RepeatableInverse(
        task, rp.Polynomial(q0, 1).weighted(rp.redundancy.nullspace(task.jacobian(q0)))
    )
    a, b, c = (
        rp.best_leaf(inverse, rp.circle(task, q0, 0.1), q0, steps=8, seed=seed)
        for seed in (3, 3, 4)
    )
    assert np.array_equal(a.q0, b.q0) and a.tried == b.tried
    assert not np.array_equal(a.q0, c.q0)


def test_bad_input(panda_design, q_panda) -> None:
    far = rp.circle(panda_design.task, q_panda, 0.8, normal="yz")
    with pytest.raises(rp.InputError, match="none of the .* leaves tried|no full cycle"):
        rp.best_leaf(panda_design.inverse, far, q_panda, steps=48)
    with pytest.raises(rp.InputError, match="the start"):
        rp.best_leaf(panda_design.inverse, far, np.zeros(3))


@pytest.mark.slow
def test_margins_are_compared_from_the_smallest_up(panda_design, q_panda) -> None:
    """Fewer violations first; a room that is the same for both, such as two links of a wrist, hides
    nothing."""
    path = rp.circle(panda_design.task, q_panda, 0.02)
    one = rp.best_leaf(panda_design.inverse, path, q_panda, steps=4).best
    assert one.margin == min(one.relative_margins.values()) == one.relative_margins[one.binds]
    coarse = one.motion.thinned(32).body_distance.min()
    assert (
        one.body_distance == pytest.approx(coarse)
        and one.relative_margins["leaf"] == one.leaf_margin
    )

    def order(
        limits: float,
        bodies: float,
        leaf: float,
        *,
        distance: float = 0.1,
        limit_margin: float = 0.1,
    ) -> tuple:
        relative_margins = {"limits": limits, "bodies": bodies, "leaf": leaf}
        return replace(
            one,
            relative_margins=relative_margins,
            body_distance=distance,
            limit_margin=limit_margin,
        ).order

    assert order(0.3, 0.2, 0.9) > order(0.3, 0.1, 0.9) and order(0.3, 0.061, 0.9) > order(
        0.1, 0.062, 0.9
    )
    assert order(0.1, 0.1, 0.1) > order(0.5, -0.1, 0.9, distance=-0.01)
    assert order(0.1, -0.3, 0.1, distance=-0.02) > order(
        -0.1, -0.1, 0.9, distance=-0.01, limit_margin=-0.1
    )
    assert order(0.3, np.inf, 0.9) > order(0.2, np.inf, 0.9)


@pytest.mark.slow
def test_the_leaf_of_least_speed_keeps_half_of_the_margin() -> None:
    """Less joint speed than on the clearest leaf, half of whose limit margin it keeps."""
    task, q0 = rp.Robot.load("planar3r").task("tool", "xy"), np.array([0.3, 1.2, 0.8])
    inverse = rp.RepeatableInverse(
        task, rp.Polynomial(q0, 1).weighted(rp.redundancy.nullspace(task.jacobian(q0)))
    )
    path = rp.circle(task, q0, 0.3)
    clear, fast = (rp.best_leaf(inverse, path, q0, by=by, steps=12) for by in ("limits", "speed"))
    speed = fast.best.motion.rms_speed
    assert speed < 0.99 * min(clear.best.motion.rms_speed, fast.given.motion.rms_speed)
    assert fast.best.limit_margin >= clear.best.limit_margin / 2
    assert fast.best.leaf_margin >= min(0.1, fast.given.leaf_margin)
    assert np.array_equal(fast.given.q0, clear.given.q0) and fast.tried > clear.tried
    with pytest.raises(rp.InputError, match="speeed"):
        rp.best_leaf(inverse, path, q0, by="speeed")


@pytest.mark.slow
def test_the_leaf_of_least_speed_may_lie_on_another_self_motion(tmp_path: Path) -> None:
    """θ₃ = constant leaves an arm of two links, whose joints have a closed form. Its elbow stays
    up or down on a self-motion: the wrist never comes to where θ₂ would be 0 or π."""
    lengths = 1.0, 0.9, 0.4
    task, q0 = planar_task(lengths, tmp_path), np.array([0.4, 1.9, 0.4])
    inverse = rp.RepeatableInverse(task, rp.Polynomial(q0, 1).weighted([[0.0], [0.0], [1.0]]))
    line = rp.polygon(task, q0, [[0.2 * np.cos(2.5), 0.2 * np.sin(2.5), 0.0]])
    path = replace(line, period=1.0)
    s = np.arange(1000) / 1000
    p = np.array([path.placement(t).translation[:2] for t in s]) @ [1, 1j]
    away = np.abs(p)
    assert away.min() - 0.4 > 0.1 and away.max() + 0.4 < 1.9

    def least(elbow: int) -> float:
        """Minimum over θ₃ of the joint speed (rms) with the elbow up, 1, or down, −1."""
        tip = np.abs(0.9 + 0.4 * np.exp(1j * np.linspace(-2.0, 2.0, 201)))[:, None]
        theta2 = elbow * np.arccos((away**2 - 1 - tip**2) / (2 * tip))
        theta1 = np.angle(p / (1 + tip * np.exp(1j * theta2)))
        dq = np.diff(np.unwrap([theta1, theta2]), axis=2, append=np.nan)
        mean_square = np.nanmean(dq**2, axis=2).sum(axis=0).min()
        return float(np.sqrt(mean_square) * len(s))

    up, down = least(1), least(-1)
    assert down < 0.6 * up and q0[1] > 0  # the given elbow is the slow one
    found = rp.best_leaf(inverse, path, q0, by="speed", steps=24)
    assert found.q0[1] < 0
    assert found.best.motion.rms_speed == pytest.approx(down, rel=0.01)


def test_the_leaf_of_least_speed_has_no_collision_if_another_start_has_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where all starts of a self-motion collide, a slower one of another self-motion is better."""

    def start(speed: float, distance: float, margin: float = 0.2) -> SimpleNamespace:
        motion = SimpleNamespace(rms_speed=speed)
        return SimpleNamespace(limit_margin=margin, body_distance=distance, motion=motion)

    best, slow, slower, near = start(1, -0.01), start(2, 0.01), start(3, 0.01), start(1.5, 0.01, 0)
    monkeypatch.setattr(BEST_LEAF, "_fast_starts", lambda *_, **__: [slow, slower, near])
    search = SimpleNamespace(
        inverse=SimpleNamespace(task=None),
        path=None,
        seen=[best, start(0.5, -0.01)],
        allowed=lambda starts: starts,
        refined=lambda one, _: one,
    )
    assert BEST_LEAF._fastest(search, best, 0) is slow
    monkeypatch.setattr(BEST_LEAF, "_fast_starts", lambda *_, **__: [near])
    assert BEST_LEAF._fastest(search, best, 0) is best
