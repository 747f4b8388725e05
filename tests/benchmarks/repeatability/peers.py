"""Programs that others wrote, each with its own defaults; what is set is said in the table's
notes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
from ours import Step
from robots import chain_urdf, ssik_arm
from scenes import Scene


class AbsentError(Exception):
    """A program cannot run here; the message says why."""


def pink_loop(scene: Scene, posture_cost: float = 0.0) -> Step:
    """pink: a FrameTask (costs 1 and 1), daqp; its examples add a PostureTask of cost 1e-3."""
    import pink
    from pink.tasks import FrameTask, PostureTask

    configuration = pink.Configuration(
        scene.task.model, scene.task.model.createData(), scene.q0
    )
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
        '<link name="base"/>',
        '<mujoco><compiler fusestatic="false"/></mujoco><link name="base"/>',
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


_OF_SSIK = {
    "panda": "franka_panda",
    "xarm7": "xarm7",
    "gen3": "gen3",
    "iiwa14": "iiwa14",
}


def ssik_loop(scene: Scene) -> Step:
    """ssik's Tracker on the arm as it ships it; a fixed tool is taken off the target."""
    if scene.arm not in _OF_SSIK:
        raise AbsentError("ssik ships no such arm")
    arm = ssik_arm(_OF_SSIK[scene.arm])
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
