"""The inverse kinematic function on a leaf: same x, same c, same q, whatever the way there."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import repctl_pin as rp


@pytest.mark.parametrize("count", [200, pytest.param(10_000, marks=pytest.mark.slow)])
def test_targets_by_two_routes(panda_design, panda_pose, q_panda, count: int) -> None:
    """Straight from the start, and over another target of the region: the same q to 1e-9."""
    inverse, rng = panda_design.inverse, np.random.default_rng(0)
    leaf = inverse.leaf(q_panda)
    targets = [panda_pose.placement(q) for q in q_panda + rng.uniform(-0.4, 0.4, (count, 7))]
    straight = np.array([inverse.solve(target, q_panda) for target in targets])
    worst = 0.0
    for k, target in enumerate(targets):
        detour = inverse.solve(target, straight[k - 1], leaf=leaf)
        worst = max(worst, float(np.abs(detour - straight[k]).max()))
    assert worst < 1e-9
    for q, target in zip(straight[::50], targets[::50], strict=True):
        assert np.linalg.norm(panda_pose.error(q, target)) < 1e-11
        assert np.abs(inverse.leaf(q) - leaf).max() < 1e-11


def test_it_is_where_following_leads(panda_design, panda_pose, q_panda) -> None:
    """An independent oracle: RK4 along a path, which stays on the leaf by G_r alone."""
    path = rp.circle(panda_pose, q_panda, 0.1, normal="yz")
    motion = rp.follow(panda_design.inverse, path, q_panda, cycles=1, steps=400)
    for i in (57, 200, 333):
        q = panda_design.inverse.solve(path.placement(i / 400), q_panda)
        assert np.abs(q - motion.q[i]).max() < 1e-9


@pytest.mark.parametrize("kind", ["pose", "axis", "position", "xy"])
def test_every_kind_of_task_and_leaf(panda, q_panda, kind: str) -> None:
    task = panda.task("panda_hand_tcp", kind)
    inverse = rp.ExtendedJacobian(task, q_panda)
    rng = np.random.default_rng(1)
    for q in q_panda + rng.uniform(-0.15, 0.15, (10, 7)):
        leaf = 0.02 * rng.normal(size=task.r)
        found = inverse.solve(task.placement(q), q_panda, leaf=leaf)
        assert np.linalg.norm(task.error(found, task.placement(q))) < 1e-11
        assert np.abs(inverse.leaf(found) - leaf).max() < 1e-10


def test_out_of_reach_says_how_far_it_got(panda_design, panda_pose, q_panda) -> None:
    q0 = q_panda.copy()
    far = panda_pose.placement(q0)
    far.translation = far.translation + [1.5, 0, 0]
    with pytest.raises(
        rp.InputError, match=r"cannot reach .* on this leaf: the path ends at [\d.]+ %.*nearer"
    ):
        panda_design.inverse.solve(far, q0)
    assert np.array_equal(q0, q_panda)


def test_a_leaf_that_does_not_reach_where_the_arm_does() -> None:
    """x is within the arm's reach, but θ₁ − 1 = c keeps it away: the elbow cannot help alone."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    potentials = rp.Polynomial(np.array([1.0, 0, 0]), 1, np.sqrt(3), variables=[0])
    inverse = rp.RepeatableInverse(task, potentials.weighted(np.ones((1, 1))))
    q0 = np.array([0.0, 1.0, 1.0])
    reachable = task.placement([2.5, 0.5, 0.5])
    with pytest.raises(rp.InputError, match="on this leaf"):
        inverse.solve(reachable, q0)
    assert np.allclose(task.error([2.5, 0.5, 0.5], reachable), 0)
    q = inverse.solve(task.placement([0.0, 0.5, 1.5]), q0)
    # closed form: two links, the same elbow, θ₁ held
    assert np.allclose(q, [0.0, 0.5, 1.5], atol=1e-10)


def test_it_does_not_change_the_elbow() -> None:
    """Beyond the straight arm lies the other solution; a sheet is never left silently."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    potentials = rp.Polynomial(np.zeros(3), 1, np.sqrt(3), variables=[0])
    inverse = rp.RepeatableInverse(task, potentials.weighted(np.ones((1, 1))))
    rng = np.random.default_rng(2)
    for t1, t2, t3 in zip(*rng.uniform(0.3, 2.0, (3, 30)), strict=True):
        q = inverse.solve(task.placement([0.0, t2, t3]), np.array([0.0, t1, 1.0]))
        assert np.allclose(q, [0.0, t2, t3], atol=1e-9)


def test_bad_input(panda_design, panda_pose, q_panda) -> None:
    inverse, target = panda_design.inverse, panda_pose.placement(q_panda)
    bad_target = pin.SE3(np.eye(3), np.array([np.nan, 0, 0]))
    for arguments, words in (
        ((target, np.zeros(6)), "q0"),
        ((target, np.full(7, np.nan)), "q0"),
        ((target, "home"), "q0"),
        ((np.eye(3), q_panda), "placement"),
        ((bad_target, q_panda), "finite"),
    ):
        with pytest.raises(rp.InputError, match=words):
            inverse.solve(*arguments)
    with pytest.raises(rp.InputError, match="leaf"):
        inverse.solve(target, q_panda, leaf=np.zeros(2))
    with pytest.raises(rp.InputError, match="q must be 7"):
        inverse.leaf(np.zeros(3))
    planar = rp.Robot.load("planar3r").task("tool", "xy")
    potentials = rp.Polynomial(np.zeros(3), 1, variables=[0])
    singular = rp.RepeatableInverse(planar, potentials.weighted(np.ones((1, 1))))
    with pytest.raises(rp.SingularityError, match="start is singular"):
        singular.solve(planar.placement([0, 1, 1]), np.zeros(3))
