"""Arrays of other byte orders, types and strides mean the numbers that they hold, or are refused by
name."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import repctl_pin as rp


def _unaligned(x: np.ndarray) -> np.ndarray:
    """The same numbers at an odd address."""
    array = np.ndarray(x.shape, float, bytearray(x.nbytes + 1), 1)
    array[...] = x
    return array


class Subclass(np.ndarray):
    """An array of somebody else's kind."""


ODD: dict[str, Callable[[np.ndarray], object]] = {
    "big-endian": lambda x: x.astype(">f8"),
    "little-endian": lambda x: x.astype("<f8"),
    "every other": lambda x: np.repeat(x, 2)[::2],
    "backwards": lambda x: x[::-1].copy()[::-1],
    "unaligned": _unaligned,
    "long double": lambda x: x.astype("g"),
    "single": lambda x: x.astype("f4").astype("f4"),
    "a list": lambda x: x.tolist(),
    "a tuple of NumPy's": tuple,
    "a column": lambda x: np.stack([x, x])[0],
    "masked": np.ma.array,
    "a subclass": lambda x: x.view(Subclass),
    "read only": lambda x: np.frombuffer(x.tobytes()),
}


@pytest.fixture(scope="module")
def controls(panda_pose: rp.Task) -> dict[str, rp.Pseudoinverse]:
    task, q = panda_pose, np.array(panda_pose.reference)
    potentials = rp.Polynomial(q, 2, 0.5)
    A = np.vstack(
        [rp.redundancy.nullspace(task.jacobian(q)), 0.02 * np.ones((potentials.size - 7, 1))]
    )
    return {
        "J⁺": rp.Pseudoinverse(task),
        "J⁺, weighted": rp.WeightedInverse(task, np.arange(1.0, 8)),
        "posture": rp.PostureControl(task, q),
        "custom": rp.CustomInverse(task, rp.Pseudoinverse(task)),
        "extended": rp.ExtendedJacobian(task, q),
        "repeatable": rp.RepeatableInverse(task, potentials.weighted(A)),
        "Fourier": rp.RepeatableInverse(task, rp.Fourier(7, 1).weighted(np.arange(14.0)[:, None])),
    }


@pytest.mark.parametrize("odd", ODD)
def test_odd_arrays_mean_their_numbers(controls, panda_pose: rp.Task, odd: str) -> None:
    change, rng = ODD[odd], np.random.default_rng(0)
    near = {"rtol": 1e-4, "atol": 1e-4} if odd == "single" else {"rtol": 0, "atol": 1e-11}
    q = np.array(panda_pose.reference) + 0.1 * rng.normal(size=7)
    xdot, target = rng.normal(size=6), panda_pose.placement(panda_pose.reference)
    Q, Xdot = q + 0.1 * rng.normal(size=(3, 7)), rng.normal(size=(3, 6))
    for name, control in controls.items():
        assert np.allclose(
            control.velocity(change(q), change(xdot)), control.velocity(q, xdot), **near
        ), name
        if hasattr(control, "batch"):
            assert np.allclose(control(change(q)), control(q), **near), name
            assert np.allclose(
                control.batch(Q.astype(">f8")), control.batch(Q), rtol=0, atol=1e-12
            ), name
        if isinstance(control, rp.RepeatableInverse):
            leaf = control.leaf(q) + 0.01
            expected = control.step(q, target, 0.01, xdot, leaf=leaf, gain=20.0)
            assert np.allclose(control.leaf(change(q)), control.leaf(q), **near)
            assert np.allclose(
                control.step(change(q), target, 0.01, change(xdot), leaf=change(leaf), gain=20.0),
                expected,
                **near,
            ), name
            bounded = control.step(
                q, target, 0.01, leaf=leaf, velocity_limit=np.full(7, 1.5), damping=0.05
            )
            found = control.step(
                change(q),
                target,
                0.01,
                leaf=change(leaf),
                velocity_limit=change(np.full(7, 1.5)),
                damping=0.05,
            )
            assert np.allclose(found, bounded, **near), name
            assert np.allclose(
                control.velocities(Q.astype(">f8"), Xdot.astype(">f8")), control.velocities(Q, Xdot)
            )
    for function in (
        panda_pose.jacobian,
        panda_pose.hessian,
        lambda q: panda_pose.placement(q).homogeneous,
    ):
        assert np.allclose(function(change(q)), function(q), **near)
    for batch in (
        panda_pose.jacobians,
        panda_pose.hessians,
        panda_pose.positions,
        panda_pose.inertias,
    ):
        assert np.allclose(batch(Q.astype(">f8")), batch(Q), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "wrong",
    [
        np.full(6, np.nan),
        np.ones((6, 1)),
        np.ones((1, 6)),
        np.ones(5),
        "fast",
        None,
        1j * np.ones(6),
        ["1"] * 6,
        np.ones(6, object),
        np.ones(6, "datetime64[s]"),
    ],
    ids=repr,
)
def test_a_wrong_velocity_is_refused_by_name(controls, panda_pose: rp.Task, wrong: object) -> None:
    q = np.array(panda_pose.reference)
    for control in controls.values():
        with pytest.raises(rp.InputError, match="ẋ"):
            control.velocity(q, wrong)


def test_one_joint() -> None:
    """Pinocchio makes the Jacobian of a single joint flat; ours has its column."""
    robot = rp.Robot.load("planar3r")
    for kind in ("pose", "axis", "position", "xy"):
        task = robot.task("tool", kind, joints=[robot.joint_names[0]])
        rng = np.random.default_rng(0)
        for q in rng.normal(size=(3, 1)):
            J = task.jacobian(q)
            assert J.shape == (task.m, 1)
            assert np.array_equal(task.jacobians([q])[0], J)
            step = 1e-6
            for row in range(min(3, task.m)):
                ahead, behind = (
                    task.error(q, task.placement(q + step)),
                    task.error(q, task.placement(q - step)),
                )
                assert (ahead - behind)[row] / (2 * step) == pytest.approx(J[row, 0], abs=1e-8)
        H = task.hessian([0.3])
        slope = (task.jacobian([0.3 + 1e-6]) - task.jacobian([0.3 - 1e-6])) / 2e-6
        assert np.allclose(H[:, :, 0], slope, atol=1e-8)
        for make in (
            rp.Pseudoinverse,
            lambda t: rp.PostureControl(t, [0.0]),
            lambda t: rp.CustomInverse(t, sum),
        ):
            with pytest.raises(rp.InputError, match="moved by 1 joints, too few"):
                make(task)
        moved = rp.follow(
            lambda q, xdot: [0.0], rp.circle(task, [0.3], 1e-4), [0.3], cycles=1, steps=8, task=task
        )
        assert np.array_equal(moved.q, np.full((9, 1), 0.3))


def test_targets_that_are_no_placements(controls, panda_pose: rp.Task) -> None:
    q = np.array(panda_pose.reference)
    for wrong in (None, "there", np.eye(3), np.zeros(3), pin.SE3):
        with pytest.raises(rp.InputError, match="target"):
            controls["repeatable"].step(q, wrong, 0.01)
        with pytest.raises(rp.InputError, match="target"):
            controls["repeatable"].solve(wrong, q)
        with pytest.raises(rp.InputError, match="target"):
            panda_pose.error(q, wrong)


def test_huge_joints_are_numbers_without_a_warning() -> None:
    """Their squares overflow, and opposite infinities cancel to no number."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    assert np.isfinite(task.placement(np.full(3, 1e200)).translation).all()
    with pytest.raises(rp.InputError, match="finite"):
        task.placement(np.array([np.inf, -np.inf, 0.0]))
