"""Simulate ten cycles with lagging servos, noisy encoders and a push.

MuJoCo simulates the dynamics of a panda. Each joint has a position servo, soft enough to lag and to
sag under gravity; the controller reads encoders with noise and runs at 500 Hz. In the fourth cycle,
a force of 30 N pushes the elbow for 0.2 s.

1. *Velocity control by J⁺.* q̇ = J⁺ (ẋ + K e): the end effector follows its path, but the elbow
   drifts, and the displacement by the push remains.
2. *The nearest repeatable inverse with the leaf lock.* The gains are the same; the step also feeds
   back c − h(q).
3. *Torques on the leaf.* There are no servos: `rp.LeafImpedance` has a spring for the end effector,
   and one for the leaf that does not move the end effector. A push of 20 N displaces the elbow; the
   elbow returns, and the end effector hardly moves.

The script writes two pages: `servos.html`, with 1 and 2 side by side, and `torques.html`.

Requires MuJoCo: pip install mujoco.

    python examples/physics.py
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

import repctl_pin as rp
from repctl_pin.base.files import prepare_folder, write_whole
from repctl_pin.motion import elbow
from repctl_pin.redundancy import nullspace
from repctl_pin.show.page.playback import Playback, TracedChain, playback_page
from repctl_pin.show.palette import COLOURS

DT = 2e-3
"""Time step of the controller and of the simulation, s."""

PERIOD, CYCLES = 4.0, 10
"""Duration of a cycle, s, and number of cycles."""

STIFFNESS, DAMPING = 800.0, 60.0
"""Gains of the servos, Nm/rad and Nm s/rad."""

NOISE = 2e-5
"""Standard deviation of the encoder noise, rad."""

GAIN = 10.0
"""Feedback gain K of the task error, 1/s."""

PUSH_CYCLE = 4
"""Cycle in which the elbow is pushed."""

SERVO_PUSH, TORQUE_PUSH = (30.0, 0.2), (20.0, 0.5)
"""Force and duration of the push with servos, and with torques, N and s."""

Control = Callable[[np.ndarray, float], np.ndarray]
"""A function (measured q, fraction of the cycle) → q̇."""


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


def ten_cycles(task: rp.Task, path: rp.TaskPath, q0: np.ndarray, control: Control) -> np.ndarray:
    """Simulate a controller with servos; return q after every step (T + 1, n)."""
    arm, noise = PushedArm(task, q0, servos=True), np.random.default_rng(1)
    q, command, visited = q0.copy(), q0.copy(), [q0]
    steps = round(PERIOD / DT)
    for k in range(CYCLES * steps):
        measured = q + NOISE * noise.normal(size=task.n)
        command = command + DT * control(measured, (k % steps) / steps)
        since = k * DT - (PUSH_CYCLE - 1) * PERIOD
        q = arm.step(command, SERVO_PUSH[0] if 0 <= since < SERVO_PUSH[1] else 0.0)
        visited.append(q)
    return np.array(visited)


def controls(design: rp.Design, path: rp.TaskPath, q0: np.ndarray) -> dict[str, Control]:
    """Make the controllers J⁺ and nearest repeatable, with the same feedback of the task error."""
    task, inverse, plain = design.task, design.inverse, design.desired
    leaf = inverse.leaf(q0)

    def pseudoinverse(q: np.ndarray, s: float) -> np.ndarray:
        xdot = path.twist(s)[task.rows] / PERIOD
        return plain.velocity(q, xdot + GAIN * task.error(q, path.placement(s)))

    def repeatable(q: np.ndarray, s: float) -> np.ndarray:
        twist = path.twist(s) / PERIOD
        return (inverse.step(q, path.placement(s), DT, twist, leaf=leaf, gain=GAIN) - q) / DT

    return {"J⁺": pseudoinverse, "nearest repeatable": repeatable}


def held_by_torques(design: rp.Design, q0: np.ndarray) -> np.ndarray:
    """Hold the end effector by torques while the elbow is pushed; return q after every step
    (T + 1, n)."""
    task, inverse = design.task, design.inverse
    arm = PushedArm(task, q0, servos=False)
    torques = rp.LeafImpedance(inverse, stiffness=(2000.0, 100.0), leaf_frequency=5.0)
    target, leaf, q, visited = task.placement(q0), inverse.leaf(q0), q0, [q0]
    for k in range(round(3.0 / DT)):
        torque = torques.torque(q, arm.data.qvel, target, leaf=leaf)
        q = arm.step(torque, TORQUE_PUSH[0] if k * DT < TORQUE_PUSH[1] else 0.0)
        visited.append(q)
    return np.array(visited)


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


def main() -> dict[str, np.ndarray]:
    """Print the displacements; return those at the end of each cycle, relative to the end of
    cycle 2."""
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    q0 = np.array(task.reference)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), rp.Polynomial(q0, 2, 0.4), rp.Box(q0, 0.4)
    )
    path = rp.circle(task, q0, radius=0.1, normal="x")
    force, seconds = SERVO_PUSH
    print(
        f"{CYCLES} cycles with servos; "
        f"a push of {force:g} N for {seconds:g} s in cycle {PUSH_CYCLE}\n"
        "‖q − q(end of cycle 2)‖ at the end of cycles 3, 4, 5 and 10, rad:"
    )
    found, moved = {}, {}
    for name, control in controls(design, path, q0).items():
        moved[name] = ten_cycles(task, path, q0, control)
        ends = moved[name][:: round(PERIOD / DT)]
        off = found[name] = np.linalg.norm(ends - ends[2], axis=1)
        shown = ", ".join(f"{off[k]:.2f}" if off[k] > 1e-4 else "< 1e-4" for k in (3, 4, 5, 10))
        print(f"  {name:19s} {shown}")
    held = held_by_torques(design, q0)
    joints, hand = (np.linalg.norm(x - x[0], axis=1) for x in (held, task.positions(held)))
    force, seconds = TORQUE_PUSH
    later = joints[round(2.5 / DT)]
    print(
        f"torques on the leaf; a push of {force:g} N for {seconds:g} s\n"
        f"  largest displacement: joints {joints.max():.2f} rad, "
        f"end effector {1000 * hand.max():.1f} mm\n"
        f"  joints 2 s after the push: {later:.0e} rad"
    )
    folder = prepare_folder(Path("repctl-out"))
    servos = page(task, moved, [COLOURS["pseudoinverse"], COLOURS["repeatable"]], CYCLES, path.name)
    unpushed = np.repeat(held[:1], len(held) - 1, axis=0)  # for comparison, a cycle without a push
    torques = page(
        task,
        {"torques on the leaf": np.vstack([unpushed, held])},
        [COLOURS["repeatable"]],
        2,
        "a push at the elbow",
    )
    print(f"wrote {write_whole(folder / 'servos.html', servos)}")
    print(f"wrote {write_whole(folder / 'torques.html', torques)}")
    return found | {"joints": joints, "hand": hand}


if __name__ == "__main__":
    found = main()
