"""Torques in a physics engine: 10 % more mass than the model has, and Coulomb friction."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from controls import control

import repctl_pin as rp
from repctl_pin import redundancy

DT = 1e-3
RAIL = "a rail with six joints"


@pytest.fixture(scope="module", params=["panda", pytest.param(RAIL, marks=pytest.mark.slow)])
def inverse(request: pytest.FixtureRequest, panda_design: rp.Design) -> rp.RepeatableInverse:
    if request.param == "panda":
        return panda_design.inverse
    folder = request.getfixturevalue("tmp_path_factory").mktemp("rail")
    task, q0 = on_a_rail(folder), np.array([0.0, 0.0, -1.2, 1.6, -2.0, -1.57, 0.3])
    made = control(task, q0, rp.Polynomial(q0, 2, 0.5))
    return rp.RepeatableInverse(task, made.potentials, region=rp.Box(q0, 0.4))


def on_a_rail(folder: Path) -> rp.Task:
    """A ur5 whose base slides."""
    robot = ElementTree.fromstring(rp.Robot.load("ur5").description.xml)
    base = next(j for j in robot.findall("joint") if j.find("parent").get("link") == "world")  # type: ignore[union-attr]
    base.set("type", "prismatic")
    for axis in base.findall("axis"):
        base.remove(axis)
    ElementTree.SubElement(base, "axis", xyz="0 1 0")
    ElementTree.SubElement(base, "limit", lower="-1", upper="1", effort="500", velocity="1")
    path = folder / "rail.urdf"
    path.write_text(ElementTree.tostring(robot, encoding="unicode"), encoding="utf-8")
    return rp.Robot.load(path).task("tool0", "pose")


class Arm:
    """A simulated arm whose joints have motors and friction."""

    def __init__(self, task: rp.Task, q: np.ndarray, *, mass: float, friction: float) -> None:
        mujoco = pytest.importorskip("mujoco")
        robot = ElementTree.fromstring(task.robot.description.xml)
        for link in robot.findall("link"):
            for shape in [*link.findall("visual"), *link.findall("collision")]:
                link.remove(shape)
        for joint in robot.findall("joint"):
            if joint.get("name") not in task.joint_names:
                joint.set("type", "fixed")
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot, encoding="unicode"))
        spec.option.timestep = DT
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        for name in task.joint_names:
            spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        self.model, self._step = spec.compile(), mujoco.mj_step
        self.model.body_mass[:] *= mass
        self.model.body_inertia[:] *= mass
        self.model.dof_frictionloss[:], self.model.dof_damping[:] = friction, 0.0
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = q
        mujoco.mj_forward(self.model, self.data)
        N = redundancy.nullspace(task.jacobian(q))[:, 0]
        moved = task.joint_origins(q + 1e-4 * N) - task.joint_origins(q)
        elbow = task.joint_names[int(np.argmax(np.linalg.norm(moved, axis=1)))]
        joint = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, elbow)
        self.body, J = int(self.model.jnt_bodyid[joint]), np.zeros((3, task.n))
        mujoco.mj_jac(self.model, self.data, J, None, self.data.xpos[self.body], self.body)
        along = J @ N
        self.along = along / np.linalg.norm(along)

    def step(self, torque: np.ndarray, push: float = 0.0) -> None:
        self.data.ctrl[:] = torque
        self.data.xfrc_applied[self.body, :3] = push * self.along
        self._step(self.model, self.data)

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        return self.data.qpos.copy(), self.data.qvel.copy()


@dataclass
class Loop:
    """A torque loop at 1 kHz, with its observer."""

    control: rp.LeafImpedance
    arm: Arm
    leaf: np.ndarray
    observer: Any

    def tick(self, target: pin.SE3, twist: np.ndarray | None = None, push: float = 0.0) -> None:
        torque = self.control.torque(
            *self.arm.state(), target, twist, leaf=self.leaf, observer=self.observer
        )
        self.arm.step(torque, push)


def loop(
    inverse: rp.RepeatableInverse, *, friction: float, mass: float = 1.1,
    frequency: float | None = None, observed: bool = True,
    limits: tuple[float, float] = (5.0, 100.0),
) -> Loop:  # fmt: skip
    """The arm at the middle of its region; limits of the observer for revolute and prismatic
    joints, Nm and N."""
    task, q0 = inverse.task, inverse.region.center  # type: ignore[union-attr]
    limit = np.where(task.revolute, *limits)
    chosen = {} if frequency is None else {"leaf_frequency": frequency}  # or the default
    control = rp.LeafImpedance(inverse, stiffness=(3000.0, 300.0), observer_limit=limit, **chosen)
    arm = Arm(task, q0, mass=mass, friction=friction)
    return Loop(control, arm, inverse.leaf(q0), control.observer(DT) if observed else None)


def after_a_push(
    inverse: rp.RepeatableInverse, force: float, seconds: float = 3.0, **options: float
) -> tuple[float, float, float]:
    """Largest displacement, that which remains, and c − h at the end."""
    one, q0 = loop(inverse, **options), inverse.region.center  # type: ignore[arg-type, union-attr]
    home = inverse.task.placement(q0)
    for _ in range(500):  # sag under the mass that the model does not have
        one.tick(home)
    before, largest = one.arm.state()[0], 0.0
    for k in range(500 + round(seconds / DT)):
        one.tick(home, push=force if k < 500 else 0.0)
        largest = max(largest, float(np.linalg.norm(one.arm.state()[0] - before)))
    q = one.arm.state()[0]
    away = float(np.abs(inverse.leaf(q) - one.leaf).max())
    return largest, float(np.linalg.norm(q - before)), away


def on_the_circle(
    inverse: rp.RepeatableInverse, period: float, cycles: int = 1, **options: float
) -> float:
    """Largest c − h."""
    task, worst = inverse.task, 0.0
    limits = (5.0, 100.0) if task.robot.name == "panda" else (15.0, 200.0)
    one = loop(inverse, limits=limits, **options)  # type: ignore[arg-type]
    path = rp.circle(task, inverse.region.center, radius=0.1, normal="x")  # type: ignore[union-attr]
    one.arm.data.qvel[:] = inverse.velocity(one.arm.state()[0], path.twist(0.0) / period)
    for k in range(round(cycles * period / DT)):
        s = k * DT / period % 1
        one.tick(path.placement(s), path.twist(s) / period)
        worst = max(worst, float(np.abs(inverse.leaf(one.arm.state()[0]) - one.leaf).max()))
    return worst


PUSH = {"panda": 100.0, "ur5": 400.0}
"""N, for half a second."""


def test_a_pushed_arm_returns_against_friction(inverse: rp.RepeatableInverse) -> None:
    force = PUSH[inverse.task.robot.name]
    largest, left, away = after_a_push(inverse, force, frequency=5.0, friction=0.4)
    assert largest > 0.1 and left < 0.01 and away < 1e-3


def test_the_circle_stays_on_its_leaf_against_friction(inverse: rp.RepeatableInverse) -> None:
    assert on_the_circle(inverse, 2.0, friction=0.4) < 0.005


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.3, 0.5])
@pytest.mark.parametrize(("frequency", "observed"), [(5.0, False), (5.0, True), (20.0, True)])
def test_every_friction(
    friction: float, frequency: float, observed: bool, inverse: rp.RepeatableInverse
) -> None:
    name, options = (inverse.task.robot.name, {"frequency": frequency, "friction": friction})
    largest, left, away = after_a_push(inverse, PUSH[name], observed=observed, **options)
    circle = on_the_circle(inverse, 2.0, 2, observed=observed, **options)
    print(
        f"{name}, friction {friction}, ω {frequency}, observer {observed}: push {largest:.3f} → "
        f"{left:.4f} rad, c − h {away:.1e}; circle of 2 s {circle:.4f}"
    )
    if observed:
        assert left < 0.01 and (circle < 0.005 or frequency == 5.0)


@pytest.mark.slow
def test_the_exact_model_stays_on_its_leaf(inverse: rp.RepeatableInverse) -> None:
    worst = on_the_circle(inverse, 1.2, friction=0.0, mass=1.0, frequency=5.0, observed=False)
    print(f"{inverse.task.robot.name}: circle of 1.2 s, exact model: {worst:.1e}")
    assert worst < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [5.0, 20.0])
def test_long_after_a_push_nothing_moves(frequency: float, inverse: rp.RepeatableInverse) -> None:
    """No hunting: an integral against friction may oscillate for ever."""
    one, q0 = loop(inverse, friction=0.5, frequency=frequency), inverse.region.center  # type: ignore[union-attr]
    home, name, energies = inverse.task.placement(q0), inverse.task.robot.name, []
    for k in range(21_000):
        one.tick(home, push=PUSH[name] if 500 <= k < 1000 else 0.0)
        q, qdot = one.arm.state()
        energies.append(qdot @ inverse.task.inertias(q[None])[0] @ qdot / 2)
    parts = [float(max(energies[k : k + 5000])) for k in range(1000, 21_000, 5000)]
    print(f"{name}, ω {frequency}: largest kinetic energy in 5 s each, J: {parts}")
    assert parts[-1] < 1e-6 and parts[-1] < 1e-3 * parts[0]
