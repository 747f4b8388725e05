"""A panda in MuJoCo with a force on its elbow, for `servos.py` and `torques.py`."""

from __future__ import annotations

from xml.etree import ElementTree

import mujoco
import numpy as np

import repctl_pin as rp
from repctl_pin.motion import elbow
from repctl_pin.redundancy import nullspace
from repctl_pin.show.page.playback import Playback, TracedChain, playback_page

DT = 2e-3
"""Time step of the controller and of the simulation, s."""

STIFFNESS, DAMPING = 800.0, 60.0
"""Gains of the servos, Nm/rad and Nm s/rad."""


def designed() -> rp.Design:
    """Find the nearest repeatable inverse for the pose of a panda's tool."""
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    q0 = np.array(task.reference)
    box = rp.Box(q0, 0.4)
    return rp.nearest_repeatable(rp.Pseudoinverse(task), rp.Polynomial(q0, 2, 0.4), box)


def physics(task: rp.Task, *, servos: bool) -> mujoco.MjModel:
    """Make the MuJoCo model of a robot: masses and joints without shapes; joints outside the task
    are fixed."""
    robot = ElementTree.fromstring(task.robot.description.xml)
    for joint in robot.findall("joint"):
        if joint.get("name") not in task.joint_names:
            joint.set("type", "fixed")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot, encoding="unicode"))
    spec.option.timestep = DT
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for name in task.joint_names:
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        if servos:
            motor.set_to_position(kp=STIFFNESS, kv=DAMPING)
    return spec.compile()


class PushedArm:
    """A simulated arm with a force on its elbow, along the self-motion of the elbow."""

    def __init__(self, task: rp.Task, q0: np.ndarray, *, servos: bool) -> None:
        self.model = physics(task, servos=servos)
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = q0
        mujoco.mj_forward(self.model, self.data)
        joint = mujoco.mj_name2id(
            self.model, mujoco.mjtObj.mjOBJ_JOINT, task.joint_names[elbow(task, q0)]
        )
        self.body = int(self.model.jnt_bodyid[joint])
        jacobian = np.zeros((3, task.n))
        mujoco.mj_jac(self.model, self.data, jacobian, None, self.data.xpos[self.body], self.body)
        along = jacobian @ nullspace(task.jacobian(q0))[:, 0]
        self.along = along / np.linalg.norm(along)

    def step(self, control: np.ndarray, push: float) -> np.ndarray:
        """Apply a control and a push, N, for one step; return q."""
        self.data.ctrl[:] = control
        self.data.xfrc_applied[self.body, :3] = push * self.along
        mujoco.mj_step(self.model, self.data)
        return self.data.qpos.copy()


def page(
    task: rp.Task, moved: dict[str, np.ndarray], colours: list[str], cycles: int, name: str
) -> str:
    """Make a page of simulated motions side by side, 100 samples per cycle."""
    tracks = []
    for (label, Q), colour in zip(moved.items(), colours, strict=True):
        rows = np.rint(np.linspace(0, len(Q) - 1, 100 * cycles + 1)).astype(int)
        drift = np.linalg.norm(Q[rows[100::100]] - Q[0], axis=1)
        tracks.append(Playback(label, colour, task.to_robot(Q[rows]), cycles, drift, t=rows * DT))
    return playback_page(
        [TracedChain(task, elbow(task, task.from_robot(tracks[0].Q[0])))], tracks, name=name
    )
