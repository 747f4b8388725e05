"""Ten cycles in a physics engine, with servos that lag, noisy encoders and a push: what is left of
the promise?

MuJoCo moves a panda by its masses. Each joint has a position servo, soft enough to lag and to sag
under gravity; the control reads encoders with noise and runs at 500 Hz. In the fourth cycle
somebody pushes the elbow with 30 N for 0.2 s.

1. *Velocity control by J⁺.* q̇ = J⁺ (ẋ + K e): the hand does its work, the elbow drifts, and keeps
what the push did. 2. *The nearest repeatable inverse with the leaf lock.* The same gains; the step
also feeds back c − h(q). 3. *Torques on the leaf.* No servos: `rp.LeafImpedance`, a spring for the
hand, and one for the leaf that the hand does
   not feel. A push of 20 N moves the elbow; it comes back, and the hand hardly moves.

What the engine did is written as pages: `servos.html`, both side by side, and `torques.html`.

Needs MuJoCo: pip install mujoco.

    python examples/physics.py
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

import repctl_pin as rp
from repctl_pin.files import prepare_folder, write_whole
from repctl_pin.motion import elbow
from repctl_pin.redundancy import nullspace
from repctl_pin.show.page.playback import Playback, TracedChain, playback_page
from repctl_pin.show.palette import COLOURS

DT = 2e-3
"""Of the control and of the simulation, s."""

PERIOD, CYCLES = 4.0, 10
STIFF, DAMPED = 800.0, 60.0
"""Of the servos: Nm/rad, Nm s/rad."""

NOISE = 2e-5
"""Of the encoders, rad."""

GAIN = 10.0
"""K, 1/s."""

PUSH_CYCLE, PUSH, SHOVE = 4, (30.0, 0.2), (20.0, 0.5)
"""In which cycle the elbow is pushed; N and s of the push under servos, and of the one under
torques."""

Control = Callable[[np.ndarray, float], np.ndarray]
"""Measured q and the time → q̇."""


def physics(task: rp.Task, *, servos: bool) -> mujoco.MjModel:
    """Make MuJoCo's model of a robot: its masses and joints without shapes; joints beside the
    task's are held."""
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
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        if servos:
            motor.set_to_position(kp=STIFF, kv=DAMPED)
    return spec.compile()


class Pushed:
    """An arm in the engine, its elbow, and a push along the elbow's self-motion."""

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
        """Hold a control for one step, with a push of so many N; return q."""
        self.data.ctrl[:] = control
        self.data.xfrc_applied[self.body, :3] = push * self.along
        mujoco.mj_step(self.model, self.data)
        return self.data.qpos.copy()


def ten_cycles(task: rp.Task, path: rp.TaskPath, q0: np.ndarray, control: Control) -> np.ndarray:
    """Move by a control through servos; joints after every step (T + 1, n)."""
    arm, noise = Pushed(task, q0, servos=True), np.random.default_rng(1)
    q, command, went = q0.copy(), q0.copy(), [q0]
    steps = round(PERIOD / DT)
    for k in range(CYCLES * steps):
        measured = q + NOISE * noise.normal(size=task.n)
        command = command + DT * control(measured, (k % steps) / steps)
        since = k * DT - (PUSH_CYCLE - 1) * PERIOD
        q = arm.step(command, PUSH[0] if 0 <= since < PUSH[1] else 0.0)
        went.append(q)
    return np.array(went)


def controls(design: rp.Design, path: rp.TaskPath, q0: np.ndarray) -> dict[str, Control]:
    """J⁺ and the nearest repeatable inverse, with the same feedback of the task error."""
    task, inverse, plain = design.task, design.inverse, design.desired
    leaf = inverse.leaf(q0)

    def creeping(q: np.ndarray, s: float) -> np.ndarray:
        xdot = path.twist(s)[task.rows] / PERIOD
        return plain.velocity(q, xdot + GAIN * task.error(q, path.placement(s)))

    def repeatable(q: np.ndarray, s: float) -> np.ndarray:
        twist = path.twist(s) / PERIOD
        return (inverse.step(q, path.placement(s), DT, twist, leaf=leaf, gain=GAIN) - q) / DT

    return {"J⁺": creeping, "nearest repeatable": repeatable}


def shoved(design: rp.Design, q0: np.ndarray) -> np.ndarray:
    """Hold the hand still by torques while the elbow is pushed; joints after every step (T + 1,
    n)."""
    task, inverse = design.task, design.inverse
    arm = Pushed(task, q0, servos=False)
    torques = rp.LeafImpedance(inverse, stiffness=(2000.0, 100.0))
    home, leaf, q, went = task.placement(q0), inverse.leaf(q0), q0, [q0]
    for k in range(round(3.0 / DT)):
        torque = torques.torque(q, arm.data.qvel, home, leaf=leaf)
        q = arm.step(torque, SHOVE[0] if k * DT < SHOVE[1] else 0.0)
        went.append(q)
    return np.array(went)


def page(
    task: rp.Task, moved: dict[str, np.ndarray], colours: list[str], cycles: int, name: str
) -> str:
    """Show side by side what the engine did, a hundred moments a cycle."""
    tracks = []
    for (label, Q), colour in zip(moved.items(), colours, strict=True):
        rows = np.rint(np.linspace(0, len(Q) - 1, 100 * cycles + 1)).astype(int)
        drift = np.linalg.norm(Q[rows[100::100]] - Q[0], axis=1)
        tracks.append(Playback(label, colour, task.to_robot(Q[rows]), cycles, drift, t=rows * DT))
    return playback_page(
        [TracedChain(task, elbow(task, task.from_robot(tracks[0].Q[0])))], tracks, name=name
    )


def main() -> dict[str, np.ndarray]:
    """Print what became of the joints; return their distance from the end of cycle 2, at the end of
    each cycle."""
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    q0 = np.array(task.reference)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), rp.Polynomial(q0, 2, 0.4), rp.Box(q0, 0.4)
    )
    path = rp.circle(task, q0, radius=0.1, normal="x")
    print(
        f"{CYCLES} cycles with servos; in cycle {PUSH_CYCLE} a push of {PUSH[0]:g} N for {PUSH[1]:g} s"
    )
    found, moved = {}, {}
    for name, control in controls(design, path, q0).items():
        moved[name] = ten_cycles(task, path, q0, control)
        ends = moved[name][:: round(PERIOD / DT)]
        off = found[name] = np.linalg.norm(ends - ends[2], axis=1)
        shown = ", ".join(f"{off[k]:.2f}" if off[k] > 1e-4 else "< 1e-4" for k in (3, 4, 5, 10))
        print(f"  {name:19s} joints off the end of cycle 2, after cycles 3, 4, 5, 10: {shown} rad")
    held = shoved(design, q0)
    joints, hand = (np.linalg.norm(x - x[0], axis=1) for x in (held, task.positions(held)))
    print(f"torques on the leaf; a push of {SHOVE[0]:g} N for {SHOVE[1]:g} s")
    print(f"  joints moved by {joints.max():.2f} rad, {joints[round(2.5 / DT)]:.0e} rad off 2 s later; "
          f"hand by {1000 * hand.max():.1f} mm")  # fmt: skip
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
    print(
        f"wrote {write_whole(folder / 'servos.html', servos)} and {write_whole(folder / 'torques.html', torques)}"
    )
    return found | {"joints": joints, "hand": hand}


if __name__ == "__main__":
    found = main()
