"""Both hands of Talos with one waist: pink, mink, roboplan with their posture tasks, and ours.

Each program has one task per hand, as its examples have for one; both hands go round circles of
8 cm, from the posture and 0.5 rad off it. The table is that of docs/how-to/two-hands.md:

    pip install -e '.[bench]'
    python tests/benchmarks/repeatability/two_hands.py
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

import numpy as np
import pinocchio as pin
from robots import joint_urdf, link_urdf

import repctl_pin as rp

FRAMES = ("gripper_left_base_link", "gripper_right_base_link")
PATH = "circle:0.08"
PERIOD = 5.0  # s
STEPS = 250
CYCLES = 10
OFF = 0.5
"""Distance of the second start from the posture along a self-motion, rad."""

Step = Callable[[np.ndarray, tuple[pin.SE3, ...]], np.ndarray]


def tree_urdf(task: rp.Task, folder: Path) -> Path:
    """Write the joints that a task of several frames moves, and nothing else, as a URDF.

    The links at the frames are ``tool_0``, ``tool_1``, …
    """
    model = task.model
    links = ["base", *(f"link_{name}" for name in list(model.names)[1:])]
    limits = zip(task.lower, task.upper, task.velocity_limit, strict=True)
    of = dict(zip(task.joint_names, limits, strict=True))
    parts = ['<link name="base"/>']
    for i in range(1, model.njoints):
        name = model.names[i]
        said = task.robot.joints[name]
        parent, axis = links[model.parents[i]], np.array(said.axis)
        turns = said.kind != "prismatic"
        place = model.jointPlacements[i]
        parts.append(joint_urdf(parent, (name, place, axis, turns, *of[name])))
    for k, frame in enumerate(task.frames):
        at = model.frames[model.getFrameId(frame, pin.FrameType.BODY)]
        parts.append(link_urdf(links[at.parentJoint], f"tool_{k}", at.placement))
    path = folder / "tree.urdf"
    body = "\n".join(parts)
    path.write_text(f'<?xml version="1.0"?>\n<robot name="tree">\n{body}\n</robot>\n')
    return path


def pinv_loop(task: rp.Task) -> Step:
    """The loop people write, ``q += J⁺ e``."""
    return lambda q, x: q + np.linalg.pinv(task.jacobian(q)) @ task.error(q, x)


def pink_loop(task: rp.Task, posture: np.ndarray) -> Step:
    """pink: two FrameTasks (costs 1 and 1), and a PostureTask of cost 1e-3; daqp."""
    import pink
    from pink.tasks import FrameTask, PostureTask

    configuration = pink.Configuration(task.model, task.model.createData(), posture)
    hands = [FrameTask(frame, 1.0, 1.0) for frame in task.frames]
    rest = PostureTask(cost=1e-3)
    rest.set_target(posture)
    dt = PERIOD / STEPS

    def step(q: np.ndarray, targets: tuple[pin.SE3, ...]) -> np.ndarray:
        configuration.update(q)
        for hand, target in zip(hands, targets, strict=True):
            hand.set_target(target)
        v = pink.solve_ik(configuration, [*hands, rest], dt, solver="daqp")
        return configuration.integrate(v, dt)

    return step


def mink_loop(task: rp.Task, posture: np.ndarray, urdf: Path) -> Step:
    """mink: two FrameTasks (costs 1 and 1), and a PostureTask of cost 1e-2; daqp."""
    import mink
    import mujoco

    kept = urdf.read_text(encoding="utf-8").replace(
        '<link name="base"/>', '<mujoco><compiler fusestatic="false"/></mujoco><link name="base"/>'
    )
    model = mujoco.MjModel.from_xml_string(kept)
    configuration = mink.Configuration(model)
    names = [model.joint(i).name for i in range(model.njnt)]
    order = [names.index(name) for name in list(task.model.names)[1:]]
    hands = [
        mink.FrameTask(f"tool_{k}", "body", position_cost=1.0, orientation_cost=1.0)
        for k in range(len(task.frames))
    ]
    rest = mink.PostureTask(model, cost=1e-2)
    rest.set_target(_placed(posture, order))
    dt = PERIOD / STEPS

    def step(q: np.ndarray, targets: tuple[pin.SE3, ...]) -> np.ndarray:
        configuration.update(_placed(q, order))
        for hand, target in zip(hands, targets, strict=True):
            hand.set_target(mink.SE3.from_matrix(target.homogeneous))
        v = mink.solve_ik(configuration, [*hands, rest], dt, solver="daqp")
        return configuration.integrate(v, dt)[order]

    return step


def _placed(q: np.ndarray, order: list[int]) -> np.ndarray:
    """Put joints in another program's order."""
    other = np.empty(len(q))
    other[order] = q
    return other


def roboplan_loop(task: rp.Task, posture: np.ndarray, urdf: Path) -> Step:
    """roboplan: two FrameTasks, limits, and a ConfigurationTask of weights 0.05 and priority 2."""
    from roboplan import optimal_ik
    from roboplan.core import CartesianConfiguration, Scene, loadUrdfSceneDescription

    robot = Scene("tree", loadUrdfSceneDescription(urdf))
    oink = optimal_ik.Oink(robot)
    zero = pin.neutral(pin.buildModelFromUrdf(str(urdf)))
    names = list(pin.buildModelFromUrdf(str(urdf)).names)[1:]
    order = [names.index(name) for name in list(task.model.names)[1:]]
    hands = []
    for k, here in enumerate(task.placements(posture)):
        at = np.asfortranarray(here.homogeneous)
        place = CartesianConfiguration("base", f"tool_{k}", at)
        hands.append(optimal_ik.FrameTask(oink, robot, place))
    options = optimal_ik.ConfigurationTaskOptions(priority=2)
    wanted, weights = _placed(posture, order), np.full(task.n, 0.05)
    wanted = robot.integrate(zero, wanted)
    rest = optimal_ik.ConfigurationTask(oink, wanted, weights, options)
    most = _placed(task.velocity_limit, order)
    limits: list[Any] = [optimal_ik.PositionLimit(oink)]
    limits.append(optimal_ik.VelocityLimit(oink, PERIOD / STEPS, most))
    delta = np.zeros(task.n)

    def step(q: np.ndarray, targets: tuple[pin.SE3, ...]) -> np.ndarray:
        for hand, target in zip(hands, targets, strict=True):
            hand.setTargetFrameTransform(np.asfortranarray(target.homogeneous))
        there = robot.integrate(zero, _placed(q, order))
        oink.solveIk(there, [*hands, rest], limits, [], delta, 1e-6)
        return q + delta[order]

    return step


def repeatable(task: rp.Task, inverse: rp.RepeatableInverse, start: np.ndarray) -> Step:
    """Ours: J_V, both errors fed back."""
    leaf, dt = inverse.leaf(start), PERIOD / STEPS
    return lambda q, targets: inverse.step(q, targets, dt, leaf=leaf)


def off_the_posture(task: rp.Task, posture: np.ndarray) -> np.ndarray:
    """Move the joints by 0.5 rad along a self-motion, away from their limits."""
    ways, here = [], task.placements(posture)
    for sign in (1.0, -1.0):
        q = posture
        direction = sign * rp.redundancy.nullspace(task.jacobian(posture))[:, 0]
        while np.linalg.norm(q - posture) < OFF:
            J = task.jacobian(q)
            direction = direction - np.linalg.pinv(J) @ (J @ direction)
            direction /= np.linalg.norm(direction)
            q = rp.solve_ik(task, q + 0.02 * direction, here)
        ways.append(q)
    return max(ways, key=lambda q: task.limit_margin(q).min())


def line(task: rp.Task, name: str, step: Step, path: rp.TaskPath, q: np.ndarray) -> str:
    """Go round, and write drift, last cycle, largest step and tracking error as a table row."""
    targets = [path.placement((k + 1) / STEPS) for k in range(STEPS)]
    Q = [q]
    for k in range(CYCLES * STEPS):
        Q.append(step(Q[-1], targets[k % STEPS]))
    ends = np.array(Q[::STEPS])
    errors = [task.error(p, targets[k % STEPS]) for k, p in enumerate(Q[1:])]
    drift = np.linalg.norm(ends - ends[0], axis=1)
    last = np.linalg.norm(ends[-1] - ends[-2])
    jump = np.abs(np.diff(Q, axis=0)).max()
    error = np.abs(np.array(errors)[:, task.kind.linear]).max()
    cells = (f"{value:.1e}" for value in (drift[1], drift[-1], last, jump, error))
    return f"| {name} | {' | '.join(cells)} |"


def main() -> None:
    """Go round with every program, from both starts, and print the table."""
    problem = rp.Problem("talos", frame=list(FRAMES), path=[PATH, PATH])
    task, path, posture = problem.task, problem.path, problem.start
    starts = {"on": posture, "off": off_the_posture(task, posture)}
    ways = [
        rp.follow(rp.Pseudoinverse(task), path, q, cycles=1, steps=STEPS).q[::5]
        for q in starts.values()
    ]
    tube = rp.Tube(np.vstack(ways), 0.05)
    design = rp.nearest_repeatable(rp.Pseudoinverse(task), None, tube, degree=1)
    with tempfile.TemporaryDirectory() as folder:
        urdf = tree_urdf(task, Path(folder))
        makers: dict[str, Callable[[np.ndarray], Step]] = {
            "pinv loop": lambda q: pinv_loop(task),
            "pink + posture": lambda q: pink_loop(task, posture),
            "mink + posture": lambda q: mink_loop(task, posture, urdf),
            "roboplan + posture": lambda q: roboplan_loop(task, posture, urdf),
            "repctl_pin": partial(repeatable, task, design.inverse),
        }
        for start, q in starts.items():
            for name, make in makers.items():
                print(line(task, f"{name}, {start}", make(q), path, q), flush=True)


if __name__ == "__main__":
    main()
