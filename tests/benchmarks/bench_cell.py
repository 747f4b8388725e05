"""What the function of a cell and its control cost, as ratios in one run on one core:

    python -m pytest tests/benchmarks/bench_cell.py -o python_files="bench_*.py" -n 0

Expansion-GRR takes 317 to 494 µs a query on its authors' machine; a frame's Jacobian takes about
0.4 µs on a quiet one, so 40 of them are 16 µs, a twentieth."""

from __future__ import annotations

import shutil
import subprocess
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from timing import seconds

import repctl_pin as rp

Q0 = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def test_a_pose_and_a_step_beside_frame_jacobians(panda_pose: rp.Task, say) -> None:
    """F at 200 random poses of a cell with rotations; steps along them beside a quadratic
    field's."""
    task, desired = panda_pose, rp.Pseudoinverse(panda_pose)
    cell = rp.Cell(task, task.placement(Q0), 0.05, 0.2)
    found = rp.nearest_inverse_function(
        desired, cell, posture=Q0, degree=3, options=rp.FitOptions(held_out=64)
    )
    quadratic = rp.nearest_repeatable(desired, rp.Polynomial(Q0, 2, 0.4), rp.Box(Q0, 0.2)).inverse
    F, U = found.function, cell.sample(200)
    targets, Q = [cell.at(u) for u in U], F.batch(U)
    near, none = [cell.at(0.99 * u) for u in U], np.zeros(task.r)
    model, data = task.model, task.model.createData()
    frame = model.getFrameId(task.frame, pin.FrameType.BODY)
    loops = {
        "a Jacobian": lambda: [pin.computeFrameJacobian(model, data, Q0, frame, WORLD) for _ in U],
        "F": lambda: [F(x) for x in targets],
        "step": lambda: [
            found.inverse.step(q, x, 0.01, leaf=none) for q, x in zip(Q, near, strict=True)
        ],
        "quadratic step": lambda: [
            quadratic.step(q, x, 0.01, leaf=none) for q, x in zip(Q, near, strict=True)
        ],
    }
    best = dict.fromkeys(loops, np.inf)
    for _ in range(100):  # they take turns, and the processor's time counts: a loop is
        for name, loop in loops.items():  # longer than the turn that a busy machine gives it
            time_of_one = 1e6 * seconds(loop, 1, time.thread_time) / len(U)
            best[name] = min(best[name], time_of_one)
    in_jacobians, beside = (best["F"] / best["a Jacobian"], best["step"] / best["quadratic step"])
    times = ", ".join(f"{name} {t:.2f}" for name, t in best.items())
    say(f"µs: {times}; F {in_jacobians:.0f} Jacobians, a step {beside:.1f} times the quadratic's")
    assert in_jacobians < 40 and beside < 6


BENCH = """
#define _POSIX_C_SOURCE 199309L
#include "arm.h"
#include <stdio.h>
#include <time.h>
static arm_pose poses[1024];
static double Q[1024 * ARM_N];
static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}
int main(void) {
    double best[3] = {1e9, 1e9, 1e9}, J[ARM_M * ARM_N], sum = 0.0;
    FILE *file = fopen("poses", "rb");
    int round, k, what;
    if (!file || fread(poses, sizeof poses, 1, file) != 1) return 1;
    for (round = 0; round < 50; round++)
        for (what = 0; what < 3; what++) {
            double begin = now();
            if (what == 1 && arm_F_batch(1024, poses, NULL, Q) != 1024) return 1;
            for (k = 0; k < 1024 && what != 1; k++) {
                if (what == 0 && arm_F(poses + k, NULL, Q + k * ARM_N) != ARM_OK) return 1;
                if (what == 2) arm_jacobian(Q + k * ARM_N, J);
                sum += J[0];
            }
            begin = (now() - begin) / 1024.0;
            if (begin < best[what]) best[what] = begin;
        }
    printf("%.4f %.4f %.4f", best[0], best[1], best[2]);
    return sum == 12345.0;
}
"""
BUILDS = {"-O2": ("-O2",), "-O3 native": ("-O3", "-march=native", "-ffp-contract=fast")}


def frame_jacobian(task: rp.Task) -> float:
    """Least time of Pinocchio's frame Jacobian, called from Python, µs."""
    model, data = task.model, task.model.createData()
    frame = model.getFrameId(task.frame, pin.FrameType.BODY)
    evaluate = pin.computeFrameJacobian
    return 5e3 * seconds(lambda: [evaluate(model, data, Q0, frame, WORLD) for _ in range(200)], 200)


def cells_of(task: rp.Task) -> dict[str, rp.Cell]:
    """Make a cell in six dimensions, a sector that two symmetries reduce to four, and one in
    three."""
    middle = task.placement(Q0)
    widths = {"radius": 0.1, "height": 0.1, "angle": 1.0, "half_angle": 0.25, "spin": 0.5}
    return {
        "6-D": rp.Cell(task, middle, 0.08, 0.25),
        "sector, 6-D in 4": rp.Sector(task, middle, **widths),
        "one orientation, 3-D": rp.Cell(task, middle, 0.08),
    }


def test_f_in_c_beside_frame_jacobians(panda_pose: rp.Task, say, tmp_path: Path) -> None:
    """At -O2 at most 1.2 frame Jacobians in six dimensions, 1.0 where symmetries leave four; a
    batch for the machine's own vector units at most 0.6."""
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc on this machine")
    task, folders, terms = panda_pose, {}, {}
    for k, (what, cell) in enumerate(cells_of(task).items()):
        folder = folders[what] = tmp_path / str(k)
        design = rp.nearest_inverse_function(
            rp.Pseudoinverse(task), cell, posture=Q0, options=rp.FitOptions(held_out=64)
        )
        terms[what] = design.function.chart.monomials.size
        rp.export_c(design.function, folder, "arm")
        p, R = design.cell.placements(design.cell.sample(1024))
        np.concatenate([p, R.reshape(-1, 9)], axis=1).tofile(folder / "poses")
        (folder / "bench.c").write_text(BENCH)
        for name, flags in BUILDS.items():
            line = ["gcc", "-std=c99", *flags, "arm.c", "bench.c", "-o", name, "-lm"]
            subprocess.run(line, cwd=folder, check=True)
    base, times = (np.inf, {(w, name): np.full(3, np.inf) for w in folders for name in BUILDS})
    for _ in range(10):  # they take turns, so that a ratio holds on a busy machine too
        base = min(base, frame_jacobian(task))
        for (what, name), least in times.items():
            run = subprocess.run([f"./{name}"], cwd=folders[what], capture_output=True, check=True)
            times[what, name] = np.minimum(least, np.array(run.stdout.split(), float))
    for (what, name), least in times.items():
        one, many, J = least / base
        say(
            f"{what}, {terms[what]} monomials, {name}: in frame Jacobians of {base:.2f} "
            f"µs, F {one:.2f}, a batch {many:.2f} a pose, the generated Jacobian {J:.2f}"
        )
    assert times["6-D", "-O2"][0] < 1.2 * base
    assert times["sector, 6-D in 4", "-O2"][0] < 1.0 * base
    assert all(times[what, "-O3 native"][1] < 0.6 * base for what in folders)


def test_batches_called_from_python(panda_pose: rp.Task, say) -> None:
    """``F.batch`` of a cell of degree 4 in one thread, at most 0.8 frame Jacobians a pose.

    All take turns, and the processor's time counts; ratios of the minima and of the medians."""
    task = panda_pose
    cell = rp.Cell(task, task.placement(Q0), 0.05, 0.2)
    found = rp.nearest_inverse_function(
        rp.Pseudoinverse(task), cell, posture=Q0, degree=4, options=rp.FitOptions(held_out=64)
    )
    fast, model, data = found.function, task.model, task.model.createData()
    frame = model.getFrameId(task.frame, pin.FrameType.BODY)
    for count in (10_000, 50_000):
        U = cell.sample(count)
        p, R = cell.placements(U)
        X = np.tile(np.eye(4), (count, 1, 1))
        X[:, :3, 3], X[:, :3, :3] = p, R
        rows = np.c_[p, Rotation.from_matrix(R).as_quat()]
        runs: dict[str, tuple[Callable[[], object], int]] = {
            "a Jacobian": (
                lambda: [
                    pin.computeFrameJacobian(model, data, Q0, frame, WORLD) for _ in range(2000)
                ],
                2000,
            ),
            "matrices": (partial(fast.batch, X), count),
            "quaternions": (partial(fast.batch, rows), count),
            "coordinates": (partial(fast.batch, U), count),
            "matrices, another leaf": (partial(fast.batch, X, leaf=[0.05]), count),
        }
        times: dict[str, list[float]] = {name: [] for name in runs}
        for _ in range(20):
            for name, (work, size) in runs.items():
                times[name].append(1e6 * seconds(work, 1, time.thread_time) / size)
        least, middle = (
            {name: float(by(each)) for name, each in times.items()} for by in (np.min, np.median)
        )
        said = ", ".join(
            f"{name} {least[name] / least['a Jacobian']:.2f} "
            f"({middle[name] / middle['a Jacobian']:.2f})"
            for name in list(runs)[1:]
        )
        say(
            f"F.batch at {count} poses, in frame Jacobians of {least['a Jacobian']:.2f} µs, "
            f"minima (medians): {said}"
        )
        assert least["matrices"] < 0.8 * least["a Jacobian"]


Solve = Callable[[np.ndarray, np.ndarray], Iterable[np.ndarray]]


def closed_forms(task: rp.Task) -> dict[str, Solve]:
    """Make those that are installed: (pose (4, 4) of the task's frame, q) → solutions; they take
    from q the seed, or q₇."""
    found: dict[str, Solve] = {}
    with suppress(ImportError):
        import ssik

        arm = ssik.Manipulator.from_prebuilt("franka_panda")
        off = np.linalg.inv(tool_of(task, arm.fk))

        def nearest(x: np.ndarray, q: np.ndarray, most: int | None = 1) -> list[np.ndarray]:
            return [one.q for one in arm.solve(x @ off, q_seed=q, max_solutions=most)]

        found["ssik, nearest to a seed"] = nearest
        found["ssik, all it samples"] = lambda x, q: nearest(x, q, None)
    with suppress(ImportError):
        import frankik

        # frankik.fk places the tool, but ik_full takes the pose of the flange
        flange = task.robot.task("panda_link8", "pose")
        back = np.linalg.inv(tool_of(task, lambda q: flange.placement(q).homogeneous))

        def given(x: np.ndarray, q: np.ndarray) -> np.ndarray:
            solutions = frankik.ik_full(x @ back, q, float(q[6]))
            return solutions[np.isfinite(solutions).all(axis=1)]

        found["frankik, q7 given"] = given
    with suppress(ImportError):
        from eaik.IK_HP import HPRobot

        zero = np.zeros(task.n)
        o = np.vstack([task.joint_origins(zero), task.placement(zero).translation])
        P = np.diff(np.vstack([np.zeros(3), o]), axis=0)
        robot = HPRobot(task.axes(zero), P, fixed_axes=[(6, float(Q0[6]))])
        turn = np.linalg.inv(tool_of(task, robot.fwdKin))
        found["EAIK, one q7 for all"] = lambda x, q: robot.IK(x @ turn).Q
    return found


def tool_of(task: rp.Task, forward: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Find the constant placement of the task's frame in a solver's own frame."""
    tools = [
        np.linalg.solve(np.asarray(forward(q)), task.placement(q).homogeneous)
        for q in (Q0, Q0 + 0.1)
    ]
    assert np.allclose(*tools, atol=1e-6)
    return tools[0]


def test_f_beside_closed_forms(panda_pose: rp.Task, say) -> None:
    """Time from Python, in turns, and the error of every configuration that comes back.

    They answer other questions: F gives one configuration, and needs no q₇, seed or history, but a
    cell and a design; the closed forms give several anywhere, for a q₇, or next to a seed."""
    task = panda_pose
    cell = rp.Cell(task, task.placement(Q0), 0.05, 0.2)
    found = rp.nearest_inverse_function(
        rp.Pseudoinverse(task), cell, posture=Q0, degree=3, options=rp.FitOptions(held_out=64)
    )
    fast, U = found.function, cell.sample(64)
    targets, Q = [cell.at(u) for u in U], fast.batch(U)
    poses = [x.homogeneous for x in targets]
    solvers: dict[str, Solve] = {"F": lambda x, q: [fast(x)], **closed_forms(task)}
    best = dict.fromkeys(solvers, np.inf)
    own = {name: targets if name[0] == "F" else poses for name in solvers}  # what each one takes
    for _ in range(20):  # they take turns, so that a ratio holds on a busy machine too
        for name, solve in solvers.items():
            loop = partial(
                lambda f, X: [f(x, q) for x, q in zip(X, Q, strict=True)], solve, own[name]
            )
            time_of_one = 1e6 * seconds(loop, 1, time.thread_time) / len(U)
            best[name] = min(best[name], time_of_one)
    for name, solve in solvers.items():
        every = [list(solve(x, q)) for x, q in zip(own[name], Q, strict=True)]
        errors = [
            np.abs(task.error(np.asarray(one), x)).max()
            for x, answers in zip(targets, every, strict=True)
            for one in answers
        ]
        none, worst = sum(not answers for answers in every), max(errors, default=np.nan)
        say(
            f"{name}: {best[name]:.1f} µs a pose, {len(errors) / len(U):.1f} configurations, "
            f"{np.mean(np.array(errors) < 1e-6):.0%} of them right, {none} of {len(U)} poses "
            f"without any, worst task error {worst:.1g}"
        )
        assert none == 0 and worst < 1e-6
    many = np.tile(U, (64, 1))
    batch = min(
        1e6 * seconds(lambda: fast.batch(many), 1, time.thread_time) / len(many) for _ in range(10)
    )
    say(f"F.batch, compiled: {batch:.2f} µs a pose")
