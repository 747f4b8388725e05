"""Recorded sessions before and after relabelling: the tables of docs/how-to/learning.md.

Six synthetic sessions of each arm follow random smooth poses in a cell of ±0.1 m and ±0.25 rad,
at 50 Hz, with five controllers, from one elbow and from six. The script prints Markdown, in about
three minutes of processor time:

    python tests/benchmarks/relabel.py [ARM …] [--large]

``--large`` measures memory and time of 10⁶ frames instead.
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations_with_replacement
from pathlib import Path
from time import process_time
from xml.etree import ElementTree

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

import numpy as np
import pinocchio as pin

import repctl_pin as rp

_TUCKED = (0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2)
ARMS = {
    "panda": ("panda", "panda_hand_tcp", (*_TUCKED, np.pi / 4)),
    "panda, tool turned": ("panda", "panda_hand_tcp", (*_TUCKED, 2.45)),
    "xarm7": ("xarm7", "link_eef", (-0.73, 0.37, 0.19, 1.27, -0.5, 1.13, -0.38)),
    "baxter": ("baxter", "left_gripper", (-0.43, -1.32, -0.36, 1.99, -0.03, 0.95, 1.94)),
}
"""Robot, frame, and configuration in the middle of the cell."""

SESSIONS, FRAMES, DT = 6, 1000, 0.02
ELBOWS = np.linspace(-0.8, 0.8, SESSIONS)
"""Displacements of the elbow along the self-motion of the middle, rad."""

GAIN = 10.0
"""Gain of the posture task, 1/s."""

Step = Callable[[np.ndarray, pin.SE3], np.ndarray]


@dataclass(frozen=True)
class Scene:
    """An arm, a cell, and the poses of its sessions."""

    task: rp.Task
    middle: np.ndarray
    cell: rp.Cell
    targets: list[list[pin.SE3]]


def scene(name: str) -> Scene:
    robot_name, frame, middle = ARMS[name]
    robot = rp.Robot.load(robot_name)
    plain = robot.task(frame, "pose")
    locked = [joint for joint in robot.joint_names if joint not in plain.joint_names]
    task = rp.Robot.load(robot_name, lock=locked).task(frame, "pose")
    q = np.array(middle)
    cell = rp.Cell(task, task.placement(q), 0.1, 0.25)
    targets = [smooth_poses(cell, seed) for seed in range(SESSIONS)]
    return Scene(task, q, cell, targets)


def smooth_poses(cell: rp.Cell, seed: int) -> list[pin.SE3]:
    """Draw a random smooth motion in a cell: sums of sinusoids of 0.03 to 0.3 Hz."""
    rng, t = np.random.default_rng(100 + seed), DT * np.arange(FRAMES)
    waves = 2 * np.pi * (rng.uniform(0.03, 0.3, (6, 4))[..., None] * t + rng.random((6, 4, 1)))
    U = (rng.normal(size=(6, 4, 1)) * np.sin(waves)).sum(axis=1).T
    return [cell.at(u) for u in 0.98 * U / np.abs(U).max(axis=0)]


def reach(task: rp.Task, q: np.ndarray, there: pin.SE3) -> np.ndarray:
    """Move to a pose by J⁺ in small steps."""
    here = task.placement(q)
    twist = pin.log6(here.actInv(there)).vector
    for s in np.linspace(0, 1, 41)[1:]:
        target = there if s == 1 else here * pin.exp6(s * twist)
        for _ in range(2):
            q = q + np.linalg.pinv(task.jacobian(q)) @ task.error(q, target)
    return q


def starts(scene: Scene, *, elbows: bool) -> list[np.ndarray]:
    """Find the configuration in which each session starts."""
    found, middle = [], scene.middle
    for targets, away in zip(scene.targets, ELBOWS, strict=True):
        q = middle.copy()
        way = rp.redundancy.nullspace(scene.task.jacobian(q))
        for _ in range(50 * elbows):
            N = rp.redundancy.align(rp.redundancy.nullspace(scene.task.jacobian(q)), way)
            q, way = q + away / 50 * N[:, 0], N
            pull = scene.task.error(q, scene.task.placement(middle))
            q = q + np.linalg.pinv(scene.task.jacobian(q)) @ pull
        found.append(reach(scene.task, q, targets[0]))
    return found


# ---- controllers


def pinv_step(scene: Scene) -> Step:
    task = scene.task

    def step(q: np.ndarray, target: pin.SE3) -> np.ndarray:
        return q + np.linalg.pinv(task.jacobian(q)) @ task.error(q, target)

    return step


def posture_step(scene: Scene) -> Step:
    task = scene.task

    def step(q: np.ndarray, target: pin.SE3) -> np.ndarray:
        J = task.jacobian(q)
        G = np.linalg.pinv(J)
        pull = GAIN * DT * (scene.middle - q)
        return q + pull + G @ (task.error(q, target) - J @ pull)

    return step


def pink_step(scene: Scene, posture_cost: float = 0.0) -> Step:
    import pink
    from pink.tasks import FrameTask, PostureTask

    model = scene.task.model
    configuration = pink.Configuration(model, model.createData(), scene.middle)
    tasks = [FrameTask(scene.task.frame, position_cost=1.0, orientation_cost=1.0)]
    if posture_cost:
        tasks.append(PostureTask(cost=posture_cost))
        tasks[1].set_target(scene.middle)

    def step(q: np.ndarray, target: pin.SE3) -> np.ndarray:
        if q is not configuration.q:
            configuration.update(q)
        tasks[0].set_target(target)
        speed = pink.solve_ik(configuration, tasks, DT, solver="daqp")
        configuration.integrate_inplace(speed, DT)
        return configuration.q.copy()

    return step


def function_step(F: rp.InverseFunction) -> Step:
    return lambda _, target: F(target)


def recorded(scene: Scene, step: Step, begin: list[np.ndarray]) -> tuple[np.ndarray, float, float]:
    """Run all sessions: joints (K, n), largest joint step, rad, and processor time per frame, s."""
    Q, largest, began = [], 0.0, process_time()
    for targets, start in zip(scene.targets, begin, strict=True):
        q = start
        for target in targets:
            new = step(q, target)
            largest = max(largest, float(np.abs(new - q).max()))
            q = new
            Q.append(q)
    return np.array(Q), largest, (process_time() - began) / len(Q)


def hand_errors(scene: Scene, Q: np.ndarray) -> np.ndarray:
    """Measure the position error of the hand, m, at each frame."""
    poses = [x for targets in scene.targets for x in targets]
    away = scene.task.positions(Q) - np.array([x.translation for x in poses])
    return np.linalg.norm(away, axis=1)


# ---- tables


def coordinates(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    poses = [x for targets in scene.targets for x in targets]
    p, R = (np.array([x.translation for x in poses]), np.array([x.rotation for x in poses]))
    return scene.cell.coordinates(p, R)[0], np.repeat(np.arange(SESSIONS), FRAMES)


def controllers_table(name: str, scene: Scene) -> tuple[np.ndarray, rp.CellDesign]:
    """Print the ambiguity of five controllers; return J⁺'s joints from six elbows."""
    found = rp.nearest_inverse_function(
        rp.Pseudoinverse(scene.task), scene.cell, posture=scene.middle, incomplete="keep"
    )
    steps = {
        "J⁺": pinv_step(scene),
        "J⁺ + posture": posture_step(scene),
        "pink": pink_step(scene),
        "pink + posture": pink_step(scene, 1e-3),
        "F": function_step(found.function),
    }
    U, session = coordinates(scene)
    unit, kept = None, None
    for label, step in steps.items():
        cells = []
        for elbows in (False, True):
            Q, largest, seconds = recorded(scene, step, starts(scene, elbows=elbows))
            cells += [f"{ambiguity(U, session, Q):.2g}"]
            if label == "J⁺" and elbows:
                kept = Q
        unit = seconds if unit is None else unit
        error = 1000 * hand_errors(scene, Q)
        margin = float(scene.task.limit_margin(Q).min())
        cells += [f"{largest:.2g}", f"{margin:.2g}", f"{error.max():.1g}", f"{seconds / unit:.2f}"]
        print(f"| {name} | {label} | {' | '.join(cells)} |".replace("-0", "−0"), flush=True)
    assert kept is not None
    return kept, found


def relabel_row(name: str, scene: Scene, Q: np.ndarray) -> rp.Relabeled:
    """Print the relabelling of J⁺'s sessions from six elbows."""
    began = process_time()
    times = np.tile(DT * np.arange(FRAMES), SESSIONS)
    session = np.repeat(np.arange(SESSIONS), FRAMES)
    recording = rp.Recording(scene.task, joints=Q, times=times, sessions=session)
    done = rp.relabel(recording)
    seconds, found = process_time() - began, done.found
    assert done.margins_before is not None
    before, after = done.margins_before[found].min(), done.margins_after[found].min()
    moved = np.sqrt((done.moved[found] ** 2).sum(axis=1).mean())
    cells = [
        f"{100 * found.mean():.3g} %",
        f"{done.residual_before:.2g} → {done.residual_after:.2g}",
        f"{before:.2g} → {after:.2g}",
        f"{moved:.2g}",
        f"{done.leaf[0]:.2g}",
        f"{seconds:.0f} s",
    ]
    print(f"| {name} | {' | '.join(cells)} |".replace("-", "−"), flush=True)
    return done


# ---- behaviour cloning


def cloned(
    U: np.ndarray, Q: np.ndarray, session: np.ndarray, kind: str
) -> Callable[[np.ndarray], np.ndarray]:
    """Fit a policy u → q: a cubic polynomial, or 200 Gaussians and a linear part.

    The ridge penalty is the best one on sessions that are held out in turn.
    """
    if kind == "cubic":
        terms = cubic
    else:
        centres = U[np.random.default_rng(0).choice(len(U), 200, replace=False)]

        def terms(U: np.ndarray) -> np.ndarray:
            away = ((U[:, None] - centres) ** 2).sum(axis=2)
            return np.concatenate([np.exp(-away / 8.0), U, np.ones((len(U), 1))], axis=1)

    T, mean = terms(U), Q.mean(axis=0)
    ridges = 10.0 ** np.arange(-8, 2) * len(U)
    cost = np.zeros(len(ridges))
    for one in np.unique(session):
        test = session == one
        fits = fitted(T[~test], (Q - mean)[~test], ridges)
        cost += [np.sum((T[test] @ W + mean - Q[test]) ** 2) for W in fits]
    (W,) = fitted(T, Q - mean, ridges[[int(np.argmin(cost))]])
    return lambda u: terms(u[None])[0] @ W + mean


def cubic(U: np.ndarray) -> np.ndarray:
    """All monomials of the columns of U up to degree 3."""
    columns = range(U.shape[1])
    return np.stack(
        [
            np.prod(U[:, list(some)], axis=1)
            for degree in range(4)
            for some in combinations_with_replacement(columns, degree)
        ],
        axis=1,
    )


def ambiguity(U: np.ndarray, session: np.ndarray, Q: np.ndarray) -> float:
    """Misfit of a cubic q(u) on frames that are held out, rms, as rp.relabel measures it."""
    low, high = U.min(axis=0), U.max(axis=0)
    T, Q = cubic((2 * U - low - high) / (high - low)), Q - Q.mean(axis=0)
    fold, ridges = session % 6, 10.0 ** np.arange(-8, 1)
    misfits = np.zeros((len(ridges), *Q.shape))
    for one in np.unique(fold):
        test = fold == one
        for k, W in enumerate(fitted(T[~test], Q[~test], ridges * (~test).sum())):
            misfits[k, test] = Q[test] - T[test] @ W
    return float(np.sqrt((misfits**2).sum(axis=(1, 2)).min() / len(Q)))


def fitted(T: np.ndarray, Q: np.ndarray, ridges: np.ndarray) -> list[np.ndarray]:
    """Fit coefficients with several ridge penalties."""
    s, V = np.linalg.eigh(T.T @ T)
    B = V.T @ (T.T @ Q)
    return [V @ (B / (np.maximum(s, 0) + ridge)[:, None]) for ridge in ridges]


def servos(task: rp.Task) -> object:
    """Make a MuJoCo model of the arm with position servos, without gravity and shapes."""
    import mujoco

    root = ElementTree.fromstring(task.robot.description.xml)
    for link in root.findall("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    for joint in root.findall("joint"):
        if joint.get("name") not in task.joint_names:
            joint.set("type", "fixed")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    spec.option.timestep, spec.option.gravity = 0.002, [0, 0, 0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for joint in task.joint_names:
        servo = spec.add_actuator(target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=2000.0, kv=100.0)
    return spec.compile()


def rollout(
    scene: Scene, policy: Callable[[np.ndarray], np.ndarray], held_out: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """Roll a policy out along the poses of one session: hand errors, m and rad, and the share of
    commands beyond a limit."""
    import mujoco

    task, targets = scene.task, scene.targets[held_out]
    model = servos(task)
    data = mujoco.MjData(model)
    at = [model.joint(joint).qposadr[0] for joint in task.joint_names]
    far, turned, beyond = [], [], 0
    for k, target in enumerate(targets):
        command = policy(scene.cell.coordinates_of(target))
        if k == 0:
            data.qpos[at] = command
        beyond += bool(task.limit_margin(command).min() < 0)
        data.ctrl[:] = command
        mujoco.mj_step(model, data, nstep=10)
        error = task.error(np.array(data.qpos[at]), target)
        far.append(np.linalg.norm(error[:3]))
        turned.append(np.linalg.norm(error[3:]))
    return np.array(far), np.array(turned), beyond / len(targets)


def cloning_rows(name: str, scene: Scene, done: rp.Relabeled) -> None:
    """Print the rollouts of policies cloned from recorded and from new joints."""
    U, session = coordinates(scene)
    assert done.recording.joints is not None
    labels = {"recorded": done.recording.joints, "relabelled": done.joints}
    F, leaf = done.design.function, done.leaf
    ends = [rollout(scene, lambda u: F(scene.cell.at(u), leaf=leaf), i) for i in range(SESSIONS)]
    print_rollouts(f"| {name} | F itself | –", ends)
    for kind in ("cubic", "Gaussians"):
        for label, Q in labels.items():
            good = np.isfinite(Q[:, 0])
            ends = []
            for held_out in range(SESSIONS):
                train = good & (session != held_out)
                policy = cloned(U[train], Q[train], session[train], kind)
                ends.append(rollout(scene, policy, held_out))
            print_rollouts(f"| {name} | {kind} | {label}", ends)


def brief(value: float) -> str:
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def print_rollouts(head: str, ends: list[tuple[np.ndarray, np.ndarray, float]]) -> None:
    far, turned, beyond = (np.concatenate([np.atleast_1d(e[i]) for e in ends]) for i in range(3))
    cells = [
        brief(1000 * np.median(far)),
        brief(1000 * far.max()),
        brief(np.median(turned)),
        brief(turned.max()),
        f"{brief(100 * beyond.mean())} %",
    ]
    print(f"{head} | {' | '.join(cells)} |", flush=True)


def large() -> None:
    """Measure memory and processor time of 10⁶ frames."""
    arm = scene("panda")
    Q, *_ = recorded(arm, pinv_step(arm), starts(arm, elbows=True))
    times = 1_000_000 // len(Q) + 1
    Q = np.tile(Q, (times, 1))[:1_000_000]
    session = np.arange(len(Q)) // FRAMES
    t = DT * (np.arange(len(Q)) % FRAMES)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = process_time()
    recording = rp.Recording(arm.task, joints=Q, times=t, sessions=session)
    read = process_time()
    done = rp.relabel(recording)
    ended = process_time()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"{len(Q):,} frames: checked in {read - began:.1f} s, relabelled in {ended - read:.1f} s")
    print(f"peak memory {peak / 1e6:.2f} GB, {(peak - before) / 1e6:.2f} GB above the input's")
    print(done.summary())
    with tempfile.TemporaryDirectory() as folder:
        files(done, Path(folder))


def files(done: rp.Relabeled, folder: Path) -> None:
    """Measure the files of a recording."""
    for suffix in ("csv", "npz"):
        began = process_time()
        file = done.save(folder / f"frames.{suffix}")
        wrote = process_time()
        rp.Recording.read(file, done.recording.task)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(
            f"{suffix}: {file.stat().st_size / 1e6:.0f} MB, written in {wrote - began:.1f} s, read "
            f"in {process_time() - wrote:.1f} s, peak {peak / 1e6:.2f} GB"
        )


def main() -> None:
    """Print the tables."""
    names = [word for word in sys.argv[1:] if not word.startswith("--")] or list(ARMS)
    if "--large" in sys.argv:
        large()
        return
    scenes = {name: scene(name) for name in names}
    print(
        "| arm | controller | ambiguity, one elbow, rad | six elbows, rad | largest step, rad "
        "| limit margin, rad | hand error, mm | time |\n| --- " + "| --- " * 7 + "|"
    )
    recordings = {name: controllers_table(name, one)[0] for name, one in scenes.items()}
    print(
        "\n| arm | relabelled | ambiguity, rad | limit margin, rad | moved, rad | leaf c | time |\n"
        "| --- " + "| --- " * 6 + "|"
    )
    results = {name: relabel_row(name, scenes[name], Q) for name, Q in recordings.items()}
    print(
        "\n| arm | policy | labels | hand error, median, mm | worst, mm | median, rad | worst, rad "
        "| commands beyond a limit |\n| --- " + "| --- " * 7 + "|"
    )
    for name, done in results.items():
        cloning_rows(name, scenes[name], done)


if __name__ == "__main__":
    main()
