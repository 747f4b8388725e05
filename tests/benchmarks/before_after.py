"""What was slow, before and after: the same measurements on another commit and on this checkout.

The commit gets a worktree and a library of its own. Both sides take turns, part by part, and times
are those of the processor, so that ratios hold on a busy machine:

    python tests/benchmarks/before_after.py 732ec39c                 # all parts
    python tests/benchmarks/before_after.py 732ec39c least bodies    # some of them
"""

from __future__ import annotations

import json
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

ROOT = Path(__file__).parents[2]
TURNS = 2
HANDS = {
    "baxter": ("left_gripper", "right_gripper"),
    "talos": ("wrist_left_ft_tool_link", "wrist_right_ft_tool_link"),
}
TICKS = 6_000
Measured = dict[str, float]


def seconds(work: Callable[[], object], repeats: int = 7) -> float:
    """Find the minimum processor time of some runs."""
    times = []
    for _ in range(repeats):
        begin = time.thread_time()
        work()
        times.append(time.thread_time() - begin)
    return min(times)


def random_joints(task, count: int):
    """Draw configurations within the limits."""
    import numpy as np

    low, high = np.maximum(task.lower, -np.pi), np.minimum(task.upper, np.pi)
    return np.random.default_rng(1).uniform(low, high, (count, task.n))


def least() -> Measured:
    """Time J⁺ and the whole G, µs, and a cycle of J⁺, ms; one hand and two."""
    found = least_of("panda", "panda_hand_tcp")
    for name, frames in HANDS.items():
        found |= least_of(name, *frames)
    return found


def least_of(name: str, *frames: str) -> Measured:
    """Time them for some hands of a robot."""
    import numpy as np

    import repctl_pin as rp

    frame = list(frames) if len(frames) > 1 else frames[0]
    task = rp.Robot.load(name).task(frame)
    Q, rng = random_joints(task, 100), np.random.default_rng(2)
    J_plus, rows = rp.Pseudoinverse(task), list(zip(Q, rng.normal(size=(100, task.m)), strict=True))
    basis = rp.Polynomial(task.reference, 1, 1.0)
    G = rp.RepeatableInverse(task, basis.weighted(rng.normal(size=(basis.size, task.r))))
    paths = ["circle:0.05"] * len(frames)
    problem = rp.Problem(name, frame=frame, path=paths if len(frames) > 1 else paths[0])
    works = {
        "J⁺ velocity, µs": lambda: [J_plus.velocity(q, x) for q, x in rows],
        "J⁺ matrix, µs": lambda: [J_plus(q) for q in Q],
        "G matrix, µs": lambda: [G(q) for q in Q],
    }
    hands = f"{name}, {len(frames)} hand{'s' * (len(frames) > 1)}: "
    found = {hands + what: 1e4 * seconds(work) for what, work in works.items()}

    def cycle() -> None:
        rp.follow(J_plus, problem.path, problem.start, cycles=1, steps=500)

    return found | {hands + "a cycle of J⁺, ms": 1e3 * seconds(cycle, 3)}


def declined() -> Measured:
    """Count the calls that C left to NumPy, in %, for J⁺ of the catalogue and F of a cell.

    Tasks whose Jacobian has full rank nowhere are left out.
    """
    import numpy as np
    import tomllib

    import repctl_pin as rp
    from repctl_pin.strategies.native_law import holding_library

    library, counts = holding_library(), [0, 0]
    run = library.call_least_speed

    def counted(call) -> int:
        done = run(call)
        counts[0] += 1
        counts[1] += not done
        return done

    library.call_least_speed = counted
    found: Measured = {}
    every = []
    entries = tomllib.loads((ROOT / "repctl_pin/model/arms.toml").read_text(encoding="utf-8"))
    for name, entry in entries.items():
        loaded, frames = rp.Robot.load(name), entry["frames"]
        wanted = [(frames[0], "pose"), (frames[0], "position")]
        wanted += [(list(frames[:2]), "pose")] if len(frames) > 1 else []
        for frame, kind in wanted:
            try:
                task = loaded.task(frame, kind)
                G, Q = rp.Pseudoinverse(task), random_joints(task, 400)
                full = [np.linalg.matrix_rank(J, 1e-5) == task.m for J in task.jacobians(Q)]
            except rp.InputError:
                continue
            if not any(full):
                continue
            counts[:] = 0, 0
            for q in Q[full]:
                G.velocity(q, np.ones(task.m))
            every.append((100 * counts[1] / counts[0], repr(task)))
    worst, _ = max(every)
    found[f"J⁺, {len(every)} tasks of the catalogue: worst share left to NumPy, %"] = worst
    found["J⁺: tasks with more than 1 %"] = sum(share > 1 for share, _ in every)
    task = rp.Robot.load("panda").task()
    cell = rp.Cell(task, task.placement(task.reference), 0.05, 0.2)
    F = rp.nearest_inverse_function(
        rp.Pseudoinverse(task), cell, posture=task.reference, options=rp.FitOptions(held_out=64)
    ).function
    X = [cell.at(u) for u in cell.sample(1000)]
    left = sum(F._one.own(x, None) is None for x in X)
    found["F of panda: share left to NumPy, %"] = 100 * left / len(X)
    return found


def bodies() -> Measured:
    """Time body distances: per configuration, µs, and of ten cycles between the samples, too, s."""
    import numpy as np

    import repctl_pin as rp

    found = {}
    for name in ("panda", "talos", "baxter"):
        task = rp.Robot.load(name).task()
        measure, Q = rp.Bodies(task).distances, random_joints(task, 400)
        Q = Q[measure(Q) > 0][:64]
        way = np.random.default_rng(3).uniform(-1, 1, task.n)
        along = task.reference + np.linspace(0, 0.5, 64)[:, None] * way
        for what, P in (("at random", Q), ("along a motion", along)):
            spent = seconds(partial(measure, P)) / 64
            found[f"body distance of {name}, {what}, µs"] = 1e6 * spent
    for name in ("panda", "pr2"):
        problem = rp.Problem(name)
        J_plus = rp.Pseudoinverse(problem.task)
        motion = rp.follow(J_plus, problem.path, problem.start, cycles=10, steps=500)
        if not hasattr(motion, "clearance"):  # an older commit, which knew no distance in between
            continue
        begin = time.thread_time()
        found[f"body distance of {name}, ten cycles: minimum, m"] = motion.clearance.distance
        found[f"body distance of {name}, ten cycles, s"] = time.thread_time() - begin
    return found


def ticks() -> Measured:
    """Drive governors with bodies: shares of ticks by processor time, %, and the longest, ms."""
    import numpy as np
    import pinocchio as pin

    import repctl_pin as rp

    found: Measured = {}
    sides = {"panda": "panda_hand_tcp", "talos": HANDS["talos"][0]}
    for name, frame in [*sides.items(), *HANDS.items()]:
        task = rp.Robot.load(name).task(frame if isinstance(frame, str) else list(frame))
        measure, rng = rp.Bodies(task), np.random.default_rng(4)
        Q = np.vstack([task.reference, random_joints(task, 128)])
        apart = measure.distances(Q)
        Q = Q[(apart >= np.quantile(apart, 0.7)) & (task.limit_margin(Q).min(axis=1) > 0.05)]
        q0 = Q[int(np.argmax(np.linalg.svd(task.jacobians(Q), compute_uv=False)[:, -1]))]
        basis, N = rp.Polynomial(q0, 1, 1.0), np.linalg.svd(task.jacobian(q0))[2][task.m :]
        A = np.linalg.lstsq(basis.gradients(q0[None])[0], N.T, rcond=None)[0]
        limits = rp.Limits(acceleration=8.0, jerk=2000.0)
        governor = rp.Governor(
            rp.RepeatableInverse(task, basis.weighted(A)), 1e-3, limits,
            margin=0.02, bodies=measure, body_distance=min(0.02, measure.nearest(q0).distance / 2),
        )  # fmt: skip
        governor.start(q0)
        home = [task.placement(q0)] if isinstance(frame, str) else list(task.placements(q0))
        times, target = [], None
        for k in range(TICKS):
            if k % 400 == 0:
                moved = [
                    pin.SE3(
                        pin.exp3(0.4 * rng.normal(size=3)) @ place.rotation,
                        place.translation + 0.15 * rng.normal(size=3),
                    )
                    for place in home
                ]
                target = moved[0] if len(moved) == 1 else moved
            begin = time.thread_time()
            governor.step(target)
            times.append(1e3 * (time.thread_time() - begin))
        hands = f"{name}, {1 if isinstance(frame, str) else len(frame)} hand(s): ticks "
        found[hands + "over 1 ms, %"] = 100 * float(np.mean(np.array(times) > 1))
        found[hands + "longest, ms"] = max(times)
        found[hands + "mean, ms"] = float(np.mean(times))
        moved = np.linalg.norm(governor.q - q0)
        found[hands + "joints moved, rad"] = float(moved)
    return found


def studies() -> Measured:
    """Time whole studies in processes of their own, as multiples of the import of libraries."""

    def spent(code: str) -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        line = [sys.executable, *code.split()] if code[0] == "-" else [sys.executable, "-c", code]
        # an installed package is compiled to bytecode once
        compiled = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run(line, cwd=folder, env=compiled, check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    names = ("pinocchio", "numpy", "scipy.optimize", "matplotlib.pyplot", "trimesh")
    base = min(spent("import " + ", ".join(names)) for _ in range(2))
    found = {"import of the libraries, s": base}
    both = f"baxter --frame {','.join(HANDS['baxter'])} --path circle:0.05,circle:0.05"
    for name in ("panda", "talos", "pr2", both):
        study = min(spent(f"-m repctl_pin study {name}") for _ in range(2))
        found[f"study of {name.split(' --path')[0]}, imports"] = study / base
    return found


def relabels() -> Measured:
    """Time the relabelling of ten sessions of a panda, s; 1,000 frames take its fixed part."""
    import numpy as np

    import repctl_pin as rp

    robot = rp.Robot.load("panda")
    fingers = [joint for joint in robot.joint_names if joint not in robot.task().joint_names]
    task = rp.Robot.load("panda", lock=fingers).task()
    found = {}
    for frames in (1_000, 10_000, 100_000):
        rng, t = np.random.default_rng(6), np.arange(frames)
        waves = rng.uniform(0, 6, task.n) + t[:, None] * rng.uniform(0.01, 0.03, task.n)
        recording = rp.Recording(
            task, joints=task.reference + 0.12 * np.sin(waves), sessions=10 * t // frames
        )
        begin = time.process_time()
        done = rp.relabel(recording)
        found[f"relabelling of {frames} frames, s"] = time.process_time() - begin
        found[f"relabelling of {frames} frames: level c, rad"] = float(done.leaf[0])
    return found


def designs() -> Measured:
    """Time designs of planar arms with many spare joints, degree 2, s; their costs must agree."""
    import numpy as np

    import repctl_pin as rp

    sys.path.insert(0, str(ROOT / "tests"))
    from arms import planar_task

    found = {}
    for n in (7, 9, 11, 14):
        with tempfile.TemporaryDirectory() as folder:
            task = planar_task([1 / n] * n, Path(folder))
        box = rp.Box(np.array([0.2] + [3 / n] * (n - 1)), 0.2)
        begin = time.thread_time()
        design = rp.nearest_repeatable(rp.Pseudoinverse(task), None, box, degree=2)
        arm = f"planar arm of {n} joints, degree 2: "
        found[arm + "its design, s"] = time.thread_time() - begin
        found[arm + "cost on the nodes"] = design.fit_cost
    return found


PARTS = {f.__name__: f for f in (least, declined, bodies, designs, relabels, ticks, studies)}


def measured(checkout: Path, part: str) -> Measured:
    """Measure a part in a process that imports the package of a checkout."""
    line = [sys.executable, __file__, "--here", part]
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    said = subprocess.run(line, env=environment, check=True, capture_output=True, text=True)
    return json.loads(said.stdout.splitlines()[-1])


def built(checkout: Path) -> float:
    """Build the library of a checkout; the processor time, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    line = [sys.executable, str(checkout / "repctl_pin" / "native" / "build.py")]
    subprocess.run(line, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main(commit: str, parts: list[str]) -> None:
    """Measure both sides in turns, and print a table of medians of their turns."""
    import statistics

    with tempfile.TemporaryDirectory() as folder:
        other = Path(folder) / "before"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--detach", "-q", str(other), commit], check=True)
        try:
            (other / "repctl_pin" / "model" / "files").symlink_to(ROOT / "urdf")
            first = built(other)
            sides, rows = (other, ROOT), {}
            print("| | before | after | after / before |\n| --- | --- | --- | --- |")
            if not parts:
                (ROOT / "repctl_pin" / "native" / "librepctl.so.1").unlink(missing_ok=True)
                rows["building the library, s"] = ([first], [built(ROOT)])
                rows["building it again, s"] = ([built(other)], [built(ROOT)])
            for part in parts or PARTS:
                for _ in range(1 if part in ("declined", "ticks") else TURNS):
                    for k, side in enumerate(sides):
                        for what, value in measured(side, part).items():
                            rows.setdefault(what, ([], []))[k].append(value)
            for what, sides_of in rows.items():
                # one side may not know the quantity
                a, b = (statistics.median(turns) if turns else math.nan for turns in sides_of)
                ratio = f"{b / a:.3g}" if a and math.isfinite(b / a) else "–"
                print(f"| {what} | {a:.3g} | {b:.3g} | {ratio} |", flush=True)
        finally:
            subprocess.run([*git, "remove", "--force", str(other)], check=True)


if __name__ == "__main__":
    if sys.argv[1] == "--here":
        print(json.dumps(PARTS[sys.argv[2]]()))
    else:
        main(sys.argv[1], sys.argv[2:])
