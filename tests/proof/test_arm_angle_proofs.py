"""Proofs of arm angles: the bounds of their gradient hold, wrong ones are noticed, and singular
angles are never proved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from arms import spatial_task
from commands import told
from controls import some
from inside import arm_angle, leaf_margin_bounds
from kernels import kernels, use
from mimic_arm import MIMICS, arm
from mutants import ARM, ARM_C, wrong
from proofs import design_of, margins

import repctl_pin as rp

PANDA = ("panda_link2", "panda_link4", "panda_link6")
UNDEFINED = "the arm angle is not defined there"
Q0 = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])


def panda() -> rp.Task:
    return rp.Robot.load("panda").task("panda_hand_tcp", "pose")


def mimics(folder: Path) -> rp.Task:
    return rp.Robot.load(arm(folder, MIMICS, n=9)).task("l9", "axis")


ANGLES: dict[str, Callable[[Path], rp.ArmAngle]] = {
    "conventional": lambda _: rp.ArmAngle(panda(), *PANDA, reference=(0, 1, 0.2)),
    "stereographic": lambda _: rp.ArmAngle(
        panda(), *PANDA, reference=(0, 0, 1), singular=(-1, 0.2, -1)
    ),
    "prismatic joints": lambda folder: rp.ArmAngle(
        spatial_task(7, folder, kind="pose", seed=3), "link2", "link5", "tool"
    ),
    "mimic joints": lambda folder: rp.ArmAngle(mimics(folder), "l2", "l5", "l9"),
    "any order, from the base": lambda folder: rp.ArmAngle(
        spatial_task(7, folder, kind="pose", seed=4), "link4", "base", "link6"
    ),
}


def boxes_of(angle: rp.ArmAngle, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng, n = np.random.default_rng(0), angle.task.n
    half = 10.0 ** rng.uniform(-3, -1, (count, 1)) * rng.uniform(0.1, 1, (count, n))
    one = half[1::3]  # one joint moves: bounds are reached, but for the remainder
    one *= np.eye(n)[np.arange(len(one)) % n]
    return angle.task.reference + 0.2 + rng.uniform(-0.3, 0.3, (count, n)), half


def gradients_off(angle: rp.ArmAngle, law: ModuleType = arm_angle) -> float:
    """The largest share of its bound that a gradient differs from its expansion by, in boxes."""
    chain = law.ArmAngleChain.of(angle, np.ones(1))
    Q, half = boxes_of(angle, 24)
    found = chain.gradient_bounds(Q, half)
    rng, used = np.random.default_rng(1), 0.0
    good = np.isfinite(found.rest).all(axis=1)
    assert good.mean() > 0.4
    for trial in range(12):
        way = rng.uniform(-1, 1, Q.shape)
        d = half * (np.sign(way) if trial % 2 else way)
        V = angle.gradients(Q + d)[..., 0]
        off = V - found.V - np.einsum("Kij,Kj->Ki", found.dV, d)
        used = max(used, float((np.abs(off) / (found.rest + 1e-13))[good].max()))
        assert law is not arm_angle or (np.abs(V).max(axis=1) <= found.size)[good].all()
    return used


@pytest.mark.parametrize("name", ANGLES)
def test_a_gradient_stays_in_its_bounds(name: str, tmp_path: Path) -> None:
    assert 0.3 < gradients_off(ANGLES[name](tmp_path)) <= 1


def test_the_leaf_margin_of_joined_potentials_is_bounded(tmp_path: Path) -> None:
    """An arm angle and polynomials, r = 2."""
    task = panda().robot.task("panda_hand_tcp", "axis")
    angle = rp.ArmAngle(task, *PANDA, reference=(0, 1, 0))
    both = angle + rp.Polynomial(Q0, 2, 0.3)
    A = 0.1 * np.random.default_rng(0).standard_normal((both.size, 2))
    A[0] = 1.0, 0.3
    A[-7:] += np.linalg.svd(task.jacobian(Q0))[2][5:].T
    box = rp.Box(Q0, 0.1)
    design = design_of(task, both.weighted(A), box)
    problem = leaf_margin_bounds.leaf_margin_of(task, design.inverse.potentials, box)
    rng = np.random.default_rng(2)
    Q = Q0 + rng.uniform(-0.1, 0.1, (24, 7))
    half = 10 ** rng.uniform(-5, -1.8, (24, 1)) * rng.uniform(0.3, 1, (24, 7))
    found = problem.bounds(Q, half)
    assert (found.leaf_margin > 0).mean() > 0.6
    for _ in range(10):
        points = Q + half * np.sign(rng.standard_normal(Q.shape))
        assert (found.leaf_margin <= margins(design, points) + 1e-9).all()
    np.testing.assert_allclose(found.center, margins(design, Q), rtol=0.02)


def design_over(angle: rp.PotentialBasis, region: rp.Box) -> rp.Design:
    A = np.zeros((angle.size, 1))
    A[0] = 1.0
    return replace(design_of(panda(), angle.weighted(A), region), potentials=angle, coefficients=A)


@pytest.mark.slow
def test_a_panda_s_arm_angle_is_proved_and_its_certificate_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    angle = rp.ArmAngle(panda(), *PANDA, reference=(0, 1, 0))
    design = design_over(angle, rp.Box(Q0, 0.2))
    proof = rp.prove(design)
    sampled = margins(design, design.region.random(2048, 0)).min()
    assert proof and 0.9 * sampled < proof.leaf_margin < sampled
    kept = replace(design, proof=proof, leaf_margin_at=proof.worst)
    file = rp.save(kept, tmp_path / "arm.json")
    again = rp.load(file)
    assert repr(again.proof) == repr(proof)
    same = rp.prove(again, margin=0.35)
    assert same and same.theorem == proof.theorem
    assert told(capsys, "check", str(file), "--prove")["proved"]


@pytest.mark.parametrize("case", some(["along r", "half-line", "straight"], "straight"))
def test_a_singular_arm_angle_is_never_proved(case: str, tmp_path: Path) -> None:
    """The wrist points along r or t, or the elbow is on the line, somewhere in the box."""
    rng, task = np.random.default_rng(len(case)), panda()
    frames, region = PANDA, rp.Box(Q0, 0.1)
    at = Q0 + rng.uniform(-0.09, 0.09, 7)
    p = rp.ArmAngle(task, *frames)._points(at)
    w = p[1][0] / np.linalg.norm(p[1][0])
    across = np.cross(w, [0.3, 0.9, 0.1])
    if case == "along r":
        angle = rp.ArmAngle(task, *frames, reference=-w)
    elif case == "half-line":
        angle = rp.ArmAngle(task, *frames, reference=across, singular=w)
    else:
        task = spatial_task(4, tmp_path)
        q = np.zeros(4)
        angle = rp.ArmAngle(task, "link1", "link2", "link1")
        region = rp.Box(q, 0.1)  # the wrist is the shoulder
    potentials = angle.weighted(np.ones((1, 1)))
    design = design_of(task, potentials, region)
    proof = rp.prove(design, margin=0.0, seconds=0.2, closes=False)
    assert not proof and proof.leaf_margin == 0
    assert "singular" in proof.reason or proof.reason.startswith("stopped after")
    problem = leaf_margin_bounds.leaf_margin_of(task, potentials, region)
    at = at if task.n == 7 else region.center
    assert problem.undefined(at[None], np.full((1, task.n), 1e-9))[0]
    assert case != "straight" or rp.prove(design, closes=False).reason == UNDEFINED
    if case == "half-line":  # on the other side of the sphere there is none
        other = rp.ArmAngle(task, *frames, reference=across, singular=-w)
        design = design_of(task, other.weighted(np.ones((1, 1))), region)
        assert rp.prove(design, margin=0.0, seconds=5, closes=False)


# ---- what is wrong is noticed ------------------------------------------------------------------


SLOW = [pytest.mark.slow]


@pytest.mark.parametrize(
    "mutant", [pytest.param(m, marks=SLOW if i else []) for i, m in enumerate(ARM)]
)
def test_a_wrong_term_is_noticed(
    mutant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert noticed(tmp_path, wrong(monkeypatch, "arm_angle.py", *ARM[mutant]))


def noticed(folder: Path, law: ModuleType = arm_angle) -> bool:
    """Find out whether a gradient leaves its bounds, or has none, on one of the arms."""
    for angle in ANGLES.values():
        try:
            if gradients_off(angle(folder), law) > 1:
                return True
        except AssertionError:
            return True
    return False


@pytest.mark.slow
@pytest.mark.parametrize(
    "mutant", [pytest.param(m, marks=SLOW if i else []) for i, m in enumerate(ARM_C)]
)
def test_a_wrong_term_in_c_is_noticed(
    mutant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, arm_angle, kernels("arm_angle.c", *ARM_C[mutant]))
    assert noticed(tmp_path)


def test_an_arm_angle_of_too_many_joints_is_refused_by_name(tmp_path: Path) -> None:
    task = spatial_task(12, tmp_path, kind="pose", seed=3)
    angle = rp.ArmAngle(task, "link3", "link7", "tool")
    with pytest.raises(rp.InputError, match="on 1[12] joints, and a proof needs 1 to 10; define"):
        arm_angle.ArmAngleChain.of(angle, np.ones(1))


# ---- against rigorous arithmetic, and at many points -------------------------------------------


@pytest.mark.parametrize("name", some(["conventional", "stereographic"], "stereographic"))
def test_boxes_against_ball_arithmetic(name: str, tmp_path: Path) -> None:
    """Tiny boxes too, where all that is left is rounding."""
    pytest.importorskip("flint")
    from arb_arm_angle import arb, at, gradient_in_balls

    angle = ANGLES[name](tmp_path)
    chain, rng = arm_angle.ArmAngleChain.of(angle, np.ones(1)), np.random.default_rng(0)
    Q = Q0 + rng.uniform(-0.3, 0.3, (110, 7))
    half = 10 ** rng.uniform(-15, -1.3, (110, 1)) * np.ones((1, 7))
    found = chain.gradient_bounds(Q, half)
    assert np.isfinite(found.rest).all()
    for i, t in enumerate(rng.uniform(-1, 1, Q.shape)):
        V = gradient_in_balls(angle, at(Q[i], half[i], t))
        d = at(0 * Q[i], half[i], t)
        for j in range(7):
            off = V[j] - arb(float(found.V[i, j]))
            for l in range(7):
                off -= arb(float(found.dV[i, j, l])) * d[l]
            if not found.rest[i, j]:
                assert off.contains(0)  # a joint that does not move the points
                continue
            assert abs(off) <= arb(float(found.rest[i, j]))  # of balls: certain


@pytest.mark.slow
@pytest.mark.parametrize("name", ["conventional", "stereographic"])
def test_a_hundred_thousand_configurations_violate_nothing(name: str, tmp_path: Path) -> None:
    angle = ANGLES[name](tmp_path)
    design = design_over(angle, rp.Box(Q0, 0.3))
    proof = rp.prove(design, seconds=60)
    assert proof, proof.reason
    Q = design.region.random(50_000, 5)
    Q[::2] = Q0 + 0.3 * np.sign(Q[::2] - Q0) * np.abs((Q[::2] - Q0) / 0.3) ** 0.1
    found = margins(design, Q)
    assert found.min() >= proof.leaf_margin
    J = design.task.jacobians(Q)
    assert np.linalg.svd(J, compute_uv=False)[:, -1].min() >= proof.sigma_min
