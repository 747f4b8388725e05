"""Section II: candidate and stable surfaces from the URDFs, n-link arms, and surfaces made to be
awkward."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from arms import planar_task
from controls import some

import repctl_pin as rp


def wrapped(angle: np.ndarray) -> np.ndarray:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def slide_task(length: float, folder: Path) -> rp.Task:
    """The paper's PRR arm with links of any length."""
    joint = (
        '<joint name="{0}" type="{1}"><parent link="{0}a"/><child link="{2}a"/>'
        '<origin xyz="{3} 0 0"/>'
    )
    turning = '<axis xyz="0 0 1"/>'
    limit = '<limit lower="{}" upper="{}" effort="1" velocity="1"/></joint>'
    text = "".join(f'<link name="{name}a"/>' for name in ("d", "t", "u", "tip", "tool"))
    text += joint.format("d", "prismatic", "t", 0) + limit.format(-5 * length, 5 * length)
    text += joint.format("t", "revolute", "u", 0) + turning + limit.format(-7, 7)
    text += joint.format("u", "revolute", "tip", length) + turning + limit.format(-7, 7)
    text += joint.format("tip", "fixed", "tool", length) + "</joint>"
    (folder / "prr.urdf").write_text(f'<robot name="prr">{text}</robot>')
    return rp.Robot.load(folder / "prr.urdf").task("toola", "xy")


def absolute(task: rp.Task) -> rp.WeightedInverse:
    """J⁺ that minimises the speeds of the absolute angles."""
    return rp.WeightedInverse(task, rp.absolute_angles(task))


def links(Q: np.ndarray, task: rp.Task) -> np.ndarray:
    """The absolute angles of the links, from the base outward."""
    return np.cumsum(Q[:, task.revolute], axis=1)


@pytest.mark.slow
def test_prr_has_one_stable_surface_and_one_that_is_candidate_only() -> None:
    task = rp.Robot.load("prr").task("tool", "xy")
    found = rp.stable_surface(absolute(task), rp.Box([0, 0, 0], [1, 3, 3]))
    assert len(found.stable) > 5 and len(found.candidate) > 5
    assert np.abs(wrapped(links(found.stable, task) @ [1, -1])).max() < 1e-8  # (14)
    assert np.abs(wrapped(links(found.candidate, task) @ [1, 1])).max() < 1e-8  # (15)
    # the two kinds are far apart: on (14) the rate is rounding, on (15) ∇s lies across the
    # surface's normal
    ratio = found.rate / found.tolerance
    assert (
        ratio[found.kind == "stable"].max() < 1e-2 and ratio[found.kind == "candidate"].min() > 1e2
    )


def test_3r_in_relative_angles_has_candidates_and_none_is_stable() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    plain, box = rp.Pseudoinverse(task), rp.Box([0, 0, 0], 3)
    found = rp.stable_surface(plain, box)
    assert len(found.stable) == 0 and len(found.candidate) > 50
    b, c = found.candidate[:, 1:].T
    # (17)
    assert np.abs(-np.sin(b) + np.sin(c) * np.cos(b) + np.sin(c) * np.cos(b + c)).max() < 1e-9
    assert "no stable surface" in found.summary()
    assert (box.ratio(found.candidate) <= 1 + 1e-8).all()


@pytest.mark.slow
def test_the_same_3r_in_absolute_angles_has_its_stable_surface_again() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    found = rp.stable_surface(absolute(task), rp.Box([0, 0, 0], 3))
    assert len(found.stable) > 50 and len(found.candidate) == 0
    a, b, c = links(found.stable, task).T
    gaps = np.abs(wrapped(np.stack([a - b, b - c, c - a])))
    assert gaps.min(axis=0).max() < 1e-8


@pytest.mark.parametrize(
    "lengths, stable",
    [
        pytest.param((1, 1, 1, 1), True, marks=pytest.mark.slow),
        pytest.param((1, 1, 1, 1, 1), True, marks=pytest.mark.slow),
        ((1, 1, 2), True),
        pytest.param((1, 1, 2, 2), True, marks=pytest.mark.slow),
        pytest.param((1, 1, 2, 2, 1), True, marks=pytest.mark.slow),
        ((1, 1.3, 1.7), False),
        pytest.param((1, 1, 1.4, 1.8), False, marks=pytest.mark.slow),
        pytest.param((1, 1, 1.5, 2, 2), False, marks=pytest.mark.slow),
    ],
)
def test_n_link_arms_need_at_most_two_link_lengths(
    lengths: tuple[float, ...], stable: bool, tmp_path: Path
) -> None:
    task = planar_task(lengths, tmp_path)
    assert task.r == len(lengths) - 2
    found = rp.stable_surface(absolute(task), rp.Box(np.zeros(len(lengths)), 3))
    assert len(found.candidate) + len(found.stable) > 20
    assert (len(found.stable) > 0) == stable
    # two distinct angles; links of different lengths have different ones
    for psi in links(found.stable, task):
        direction = np.exp(1j * psi)
        groups = np.abs(direction[:, None] - direction) < 1e-5
        assert len(np.unique(groups, axis=0)) == 2
        if len(set(lengths)) == 2:
            same = np.equal.outer(lengths, lengths)
            assert np.array_equal(groups, same)


def test_ppr_has_no_candidate_at_all() -> None:
    task = rp.Robot.load("ppr").task("tool", "xy")
    found = rp.stable_surface(rp.Pseudoinverse(task), rp.Box([0, 0, 0], 3), samples=32)
    assert len(found.points) == 0 and "no point" in found.summary()


def test_every_point_of_a_repeatable_inverse_is_on_a_stable_surface() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    potentials = rp.Polynomial([0.5, 0.8, 0.8], 2, 0.3)
    A = np.zeros((potentials.size, 1))
    A[[0, 1, 2, 4], 0] = 1, -1, 0.5, 0.2
    found = rp.stable_surface(
        rp.RepeatableInverse(task, potentials.weighted(A)), rp.Box([0.5, 0.8, 0.8], 0.3), samples=16
    )
    assert len(found.stable) == len(found.points) == 16


@pytest.mark.parametrize("stable", some([True, False], False))
def test_a_surface_on_which_the_gradient_of_s_vanishes(stable: bool) -> None:
    """n_G = (a, 0, 1) has n_G · ∇×n_G = −∂a/∂q₂. Both choices of a give a double root of s, so (9)
    holds on it by itself: on q₃ = 0, which n_G is normal to, and on q₂ = 0, which it is not."""
    task = rp.Robot.load("ppr").task("tool", "xy")

    class Normal(rp.CustomInverse):
        def batch(self, Q: np.ndarray, J: np.ndarray | None = None) -> np.ndarray:
            a = Q[:, 1] * Q[:, 2] ** 2 if stable else Q[:, 1] ** 3 / 3 + 0.3
            n_G = np.stack([a, 0 * a, 1 + 0 * a], axis=1)[:, :, None]
            return rp.redundancy.augmented_inverse(task.jacobians(Q), n_G)[:, :, :2]

    strategy = Normal(task, lambda q: Normal.batch(strategy, q[None])[0])
    found = rp.stable_surface(strategy, rp.Box([0, 0.1, 0.1], 0.3), samples=8)
    kind, other = (found.stable, found.candidate) if stable else (found.candidate, found.stable)
    assert len(kind) >= 4 and len(other) == 0
    assert np.abs(kind[:, 2 if stable else 1]).max() < 1e-4
    assert found.rate.max() < 1e-3  # (9) alone could not tell them apart


@pytest.mark.parametrize("length", some([1e-2, 1.0, 10.0], 1.0))
def test_the_walk_alone_tells_stable_from_candidate(
    length: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Were ∇s along G to look like 0 everywhere, a walk along G would still leave (15), and stay on
    (14)."""
    # the name at the door is the function's
    module = import_module(rp.stable_surface.__module__)
    monkeypatch.setattr(
        module, "_rates", lambda strategy, function, Q: (np.zeros(len(Q)), np.ones(len(Q)))
    )
    task = slide_task(length, tmp_path)
    found = rp.stable_surface(absolute(task), rp.Box([0, 0, 0], [length, 3, 3]), samples=32)
    assert len(found.stable) > 2 and len(found.candidate) > 2
    assert np.abs(wrapped(links(found.stable, task) @ [1, -1])).max() < 1e-7  # (14)
    assert np.abs(wrapped(links(found.candidate, task) @ [1, 1])).max() < 1e-7  # (15)


@pytest.mark.parametrize("length", some([1e-3, 10.0], 1e-3))
def test_the_surfaces_of_an_arm_in_millimetres_and_of_a_crane_are_found(
    length: float, tmp_path: Path
) -> None:
    """The s of (13) is length³ times a function of the angles alone: (14) and (15) hold at any
    size."""
    task = slide_task(length, tmp_path)
    found = rp.stable_surface(absolute(task), rp.Box([0, 0, 0], [length, 3, 3]), samples=64)
    assert len(found.stable) > 5 and len(found.candidate) > 10
    assert np.abs(wrapped(links(found.stable, task) @ [1, -1])).max() < 1e-7
    assert np.abs(wrapped(links(found.candidate, task) @ [1, 1])).max() < 1e-7


def test_a_search_that_ends_at_a_singularity_says_so(tmp_path: Path) -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    found = rp.stable_surface(rp.Pseudoinverse(task), rp.Box([0, 0, 0], 2e-4), samples=8)
    assert len(found.stable) == len(found.candidate) == 0
    assert len(found.singular) == 8 and np.isnan(found.rate).all()
    with pytest.raises(rp.InputError, match="2 joints, but the task has 3"):
        rp.stable_surface(rp.Pseudoinverse(task), rp.Box([0, 0], 1))


@pytest.mark.parametrize("length", [1e-3, 10.0])
def test_relative_defects_do_not_depend_on_the_size_of_an_arm(
    length: float, tmp_path: Path
) -> None:
    """An arm with a prismatic joint, also in another unit of length, with the same weight."""
    found = []
    for unit in (1.0, length):
        inverse = rp.WeightedInverse(slide_task(unit, tmp_path), np.diag([unit**-2, 1.0, 1.0]))
        q = np.array([0.3 * unit, 0.5, 0.8])
        found.append(rp.bracket_defect(inverse, q, relative=True))
    assert np.abs(found[0]).max() > 1e-2
    np.testing.assert_allclose(found[1], found[0], rtol=1e-6, atol=1e-9)
