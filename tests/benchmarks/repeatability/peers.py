"""Programs that others wrote, each with its own defaults; what is set is said in the table's
notes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
from ours import Step
from robots import OF_SSIK, chain_urdf, ssik_arm
from scenes import Scene


class AbsentError(Exception):
    """A program cannot run here; the message says why."""


def pink_loop(scene: Scene, posture_cost: float = 0.0) -> Step:
    """pink: a FrameTask (costs 1 and 1), daqp; its examples add a PostureTask of cost 1e-3."""
    import pink
    from pink.tasks import FrameTask, PostureTask

    configuration = pink.Configuration(scene.task.model, scene.task.model.createData(), scene.q0)
    tasks = [FrameTask(scene.task.frame, position_cost=1.0, orientation_cost=1.0)]
    if posture_cost:
        tasks.append(PostureTask(cost=posture_cost))
        tasks[1].set_target(scene.posture)

    def step(q: np.ndarray, target: pin.SE3) -> np.ndarray:
        if q is not configuration.q:
            configuration.update(q)
        tasks[0].set_target(target)
        configuration.integrate_inplace(
            pink.solve_ik(configuration, tasks, scene.dt, solver="daqp"), scene.dt
        )
        return configuration.q

    return step


def mink_loop(scene: Scene, folder: Path, posture_cost: float = 0.0) -> Step:
    """mink on MuJoCo: a FrameTask (costs 1 and 1), daqp; its examples add a PostureTask of cost
    1e-2."""
    import mink
    import mujoco

    text = chain_urdf(scene.task, folder).read_text(encoding="utf-8")
    kept = text.replace(
        '<link name="base"/>', '<mujoco><compiler fusestatic="false"/></mujoco><link name="base"/>'
    )
    configuration = mink.Configuration(mujoco.MjModel.from_xml_string(kept), q=scene.q0)
    tasks = [mink.FrameTask("tool", "body", position_cost=1.0, orientation_cost=1.0)]
    if posture_cost:
        tasks.append(mink.PostureTask(configuration.model, cost=posture_cost))
        tasks[1].set_target(scene.posture)

    def step(q: np.ndarray, target: pin.SE3) -> np.ndarray:
        configuration.update(q)
        tasks[0].set_target(mink.SE3.from_matrix(target.homogeneous))
        velocity = mink.solve_ik(configuration, tasks, scene.dt, solver="daqp")
        return configuration.integrate(velocity, scene.dt)

    return step


def roboplan_loop(scene: Scene, folder: Path, posture: bool = False) -> Step:
    """roboplan: a FrameTask (costs 1 and 1), limits of joints and speeds, and a regularisation
    that determines the null space; its examples add a ConfigurationTask of weights 0.05 and
    priority 2."""
    from roboplan import optimal_ik
    from roboplan.core import CartesianConfiguration, loadUrdfSceneDescription
    from roboplan.core import Scene as Robot

    task, path = scene.task, chain_urdf(scene.task, folder)
    robot = Robot(scene.arm, loadUrdfSceneDescription(path))
    oink = optimal_ik.Oink(robot)
    zero = pin.neutral(pin.buildModelFromUrdf(str(path)))
    here = CartesianConfiguration(
        "base", "tool", np.asfortranarray(task.placement(scene.q0).homogeneous)
    )
    frame = optimal_ik.FrameTask(oink, robot, here)
    tasks: list[optimal_ik.Task] = [frame]
    if posture:
        options = optimal_ik.ConfigurationTaskOptions(priority=2)
        weights = np.full(task.n, 0.05)
        wanted = robot.integrate(zero, scene.posture)
        tasks.append(optimal_ik.ConfigurationTask(oink, wanted, weights, options))
    limits = [
        optimal_ik.PositionLimit(oink),
        optimal_ik.VelocityLimit(oink, scene.dt, task.velocity_limit),
    ]
    delta = np.zeros(task.n)

    def step(q: np.ndarray, target: pin.SE3) -> np.ndarray:
        frame.setTargetFrameTransform(np.asfortranarray(target.homogeneous))
        there = robot.integrate(zero, q)  # a continuous joint is (cos, sin) in roboplan
        oink.solveIk(there, tasks, limits, [], delta, 1e-6)
        return q + delta

    return step


def ssik_loop(scene: Scene) -> Step:
    """ssik's Tracker on the arm as it ships it; a fixed tool is taken off the target."""
    if scene.arm not in OF_SSIK:
        raise AbsentError("ssik ships no such arm")
    arm = ssik_arm(scene.arm)
    tools = []
    for q in (scene.q0, scene.q0 + 0.1):
        tools.append(np.linalg.solve(arm.fk(q), scene.task.placement(q).homogeneous))
    if not np.allclose(tools[0], tools[1], atol=1e-6):
        raise AbsentError("ssik's arm of that name has other kinematics")
    off, tracker = np.linalg.inv(tools[0]), arm.tracker(scene.q0)

    def step(q: np.ndarray, target: pin.SE3) -> np.ndarray:
        found = tracker.update(target.homogeneous @ off)
        if found.status.value == "held":
            raise RuntimeError(f"the tracker holds: {found.reason}")
        return found.q

    return step
