"""pink with and without our task, solved by pink's own solver."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import repctl_pin as rp

pytestmark = pytest.mark.slow  # importing its solvers takes three seconds
STEPS = 500

pink: Any
RepeatableTask: Any


@pytest.fixture(scope="module", autouse=True)
def imported() -> None:
    """Import pink where its tests run: its solvers import JAX, which takes seconds per worker."""
    global pink, RepeatableTask
    pink = pytest.importorskip("pink")
    pytest.importorskip("daqp")
    from repctl_pin.extensions.integrations.pink import RepeatableTask


def drive(
    design: rp.Design, start: np.ndarray, cycles: int, *extra
) -> tuple[np.ndarray, np.ndarray]:
    """Drive pink's panda round the circle: ends of the cycles (cycles, n), and the joint speeds."""
    task, robot = design.task, design.task.robot
    path = rp.circle(task, start, 0.1, normal="yz", start_angle=np.pi)
    targets = [path.placement(s) for s in np.linspace(0, 1, STEPS + 1)[1:]]
    configuration = pink.Configuration(
        robot.model, robot.model.createData(), robot.coupling.joints(task.to_robot(start))
    )
    leaders = [robot.model.getJointId(name) - 1 for name in robot.joint_names]
    frame = pink.tasks.FrameTask(task.frame, position_cost=1.0, orientation_cost=1.0)
    for other in extra:
        other.set_target_from_configuration(configuration)
    ends, speeds = [], []
    for _ in range(cycles):
        for target in targets:
            frame.set_target(target)
            velocity = pink.solve_ik(configuration, [frame, *extra], 0.01, solver="daqp")
            configuration.integrate_inplace(velocity, 0.01)
            speeds.append(np.linalg.norm(velocity))
        ends.append(task.from_robot(configuration.q[leaders]))
    assert np.linalg.norm(task.error(ends[-1], targets[-1])) < 1e-4
    return np.array(ends), np.array(speeds)


@pytest.fixture(scope="module")
def away(panda_pose: rp.Task) -> np.ndarray:
    """A start with the same frame, 0.57 rad off any posture one would hold."""
    from arms import Q_PANDA

    N = rp.redundancy.nullspace(panda_pose.jacobian(Q_PANDA))[:, 0]
    start = rp.solve_ik(
        panda_pose, Q_PANDA + 0.57 * N * np.sign(N[0]), panda_pose.placement(Q_PANDA)
    )
    assert np.linalg.norm(start - Q_PANDA) > 0.55
    return start


@pytest.mark.slow
def test_with_our_task_pink_closes_its_cycles(panda_design, away) -> None:
    repeatable, speed = drive(panda_design, away, 3, RepeatableTask(panda_design.inverse))
    assert np.linalg.norm(repeatable - away, axis=1).max() < 1e-5
    plain, plain_speed = drive(panda_design, away, 3)
    assert np.linalg.norm(plain[-1] - away) > 0.1
    # No jump: neither at the start nor anywhere else does it move faster than pink alone, give or
    # take.
    assert (
        speed.max() < 1.3 * plain_speed.max() and np.abs(np.diff(speed)).max() < 0.05 * speed.max()
    )


@pytest.mark.slow
def test_a_posture_task_from_there_jumps(panda_design, away, q_panda) -> None:
    """The usual remedy, for comparison: a posture 0.57 rad away pulls at the start."""
    posture = pink.tasks.PostureTask(cost=1e-2)
    posture.set_target_from_configuration = lambda configuration: posture.set_target(
        panda_design.task.robot.coupling.joints(panda_design.task.to_robot(q_panda))
    )
    _, speed = drive(panda_design, away, 1, posture)
    _, ours = drive(panda_design, away, 1, RepeatableTask(panda_design.inverse))
    assert speed.max() > 5 * ours.max()


def test_error_and_jacobian_are_h_and_its_derivative(panda_design, panda, q_panda) -> None:
    """Central differences of the error in pink's whole model, its fingers included."""
    model, task = panda.model, RepeatableTask(panda_design.inverse)
    rng = np.random.default_rng(0)
    q = panda.coupling.joints(panda_design.task.to_robot(q_panda))
    task.set_target_from_configuration(pink.Configuration(model, model.createData(), q))

    def error(q: np.ndarray) -> np.ndarray:
        return task.compute_error(pink.Configuration(model, model.createData(), q))

    assert np.abs(error(q)).max() == 0
    q = q + 0.1 * rng.normal(size=model.nq)
    J = task.compute_jacobian(pink.Configuration(model, model.createData(), q))
    step = 1e-6 * np.eye(model.nv)
    slope = [
        (error(pin.integrate(model, q, d)) - error(pin.integrate(model, q, -d))) / 2e-6
        for d in step
    ]
    assert np.allclose(J.T, slope, atol=1e-8) and np.count_nonzero(J) == 7


def test_continuous_joints_are_one_number_each() -> None:
    """Pinocchio's own model of the kinova has (cos, sin) pairs."""
    robot = rp.Robot.load("kinova")
    task = robot.task(None, "position")
    rng = np.random.default_rng(1)
    center = task.from_robot(robot.poses["reference"])
    potentials = rp.Polynomial(center, 2)
    inverse = rp.RepeatableInverse(
        task, potentials.weighted(rng.normal(size=(potentials.size, task.r)))
    )
    model = pin.buildModelFromUrdf(str(robot.description.path))
    assert model.nq > model.nv
    ours = RepeatableTask(inverse)
    q = rng.uniform(-1, 1, task.n)
    pinned = pin.neutral(model)
    for name, value in zip(task.joint_names, q, strict=True):
        joint = model.joints[model.getJointId(name)]
        pinned[joint.idx_q : joint.idx_q + joint.nq] = (
            [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        )
    ours.set_target(np.zeros(task.r))
    configuration = pink.Configuration(model, model.createData(), pinned)
    assert np.allclose(ours.compute_error(configuration), inverse.potentials.value(q), atol=1e-12)
    columns = [model.joints[model.getJointId(name)].idx_v for name in task.joint_names]
    assert np.allclose(
        ours.compute_jacobian(configuration)[:, columns],
        inverse.potentials.gradient(q).T,
        atol=1e-12,
    )


def test_bad_input(panda_design, panda) -> None:
    model = panda.model
    configuration = pink.Configuration(model, model.createData(), pin.neutral(model))
    with pytest.raises(rp.InputError, match="no level c is set"):
        RepeatableTask(panda_design.inverse).compute_error(configuration)
    with pytest.raises(rp.InputError, match="level c"):
        RepeatableTask(panda_design.inverse).set_target(np.zeros(3))
    other = rp.Robot.load("xarm7").model
    with pytest.raises(rp.InputError, match="no joint 'panda_joint1'"):
        RepeatableTask(panda_design.inverse).set_target_from_configuration(
            pink.Configuration(other, other.createData(), pin.neutral(other))
        )
