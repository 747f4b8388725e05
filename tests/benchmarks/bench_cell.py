"""What the function of a cell and its control cost, as ratios in one run on one core:

    python -m pytest tests/benchmarks/bench_cell.py -o python_files="bench_*.py" -n 0

Expansion-GRR takes 317 to 494 µs a query on its authors' machine; a frame's Jacobian takes about
0.4 µs on a quiet one, so 40 of them are 16 µs, a twentieth."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
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
    for _ in range(100):  # they take turns, so that a ratio holds on a busy machine too
        for name, loop in loops.items():
            best[name] = min(best[name], 1e6 * seconds(loop, 1) / len(U))
    in_jacobians, beside = best["F"] / best["a Jacobian"], best["step"] / best["quadratic step"]
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


def test_f_in_c_beside_frame_jacobians(panda_pose: rp.Task, say, tmp_path: Path) -> None:
    """At -O2 at most 1.6 frame Jacobians in six dimensions, 1.0 in three; a batch for the
    machine's own vector units at most 0.6."""
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc on this machine")
    task, found = panda_pose, {}
    for half_angle in (0.25, 0.0):
        middle = task.placement(Q0)
        cell, folder = rp.Cell(task, middle, 0.08, half_angle), tmp_path / str(half_angle)
        design = rp.nearest_inverse_function(
            rp.Pseudoinverse(task), cell, posture=Q0, options=rp.FitOptions(held_out=64)
        )
        rp.export_c(design.function, folder, "arm")
        p, R = cell.placements(cell.sample(1024))
        np.concatenate([p, R.reshape(-1, 9)], axis=1).tofile(folder / "poses")
        (folder / "bench.c").write_text(BENCH)
        for name, flags in BUILDS.items():
            line = ["gcc", "-std=c99", *flags, "arm.c", "bench.c", "-o", name, "-lm"]
            subprocess.run(line, cwd=folder, check=True)
        terms = design.function.chart.monomials.size
        base, times = np.inf, {name: np.full(3, np.inf) for name in BUILDS}
        for _ in range(5):
            base = min(base, frame_jacobian(task))
            for name, least in times.items():
                run = [f"./{name}"]
                said = subprocess.run(run, cwd=folder, capture_output=True, text=True, check=True)
                times[name] = np.minimum(least, np.array(said.stdout.split(), float))
        for name, least in times.items():
            found[half_angle, name] = least / base
            one, many, J = least / base
            say(
                f"±{half_angle} rad, {terms} monomials, {name}: in frame Jacobians of {base:.2f} "
                f"µs, F {one:.2f}, a batch {many:.2f} a pose, the generated Jacobian {J:.2f}"
            )
    assert found[0.25, "-O2"][0] < 1.6 and found[0.0, "-O2"][0] < 1.0
    assert found[0.25, "-O3 native"][1] < 0.6


def test_f_beside_closed_forms(panda_pose: rp.Task, say) -> None:
    """F gives one configuration and needs no q₇; the closed forms give all of them, q₇ given."""
    task, names = panda_pose, {}
    cell = rp.Cell(task, task.placement(Q0), 0.05, 0.2)
    found = rp.nearest_inverse_function(
        rp.Pseudoinverse(task), cell, posture=Q0, degree=3, options=rp.FitOptions(held_out=64)
    )
    fast, U = rp.compiled(found.function), cell.sample(64)
    targets, Q = [cell.at(u) for u in U], fast.batch(U)
    names["F"] = lambda: [fast(x) for x in targets]
    many = np.tile(U, (64, 1))
    names["F.batch, 4096 poses"] = lambda: fast.batch(many)
    frankik = pytest.importorskip("frankik")
    flange = [np.asarray(frankik.fk(q)) for q in Q]
    given = list(zip(flange, Q, strict=True))
    names["frankik, 4 solutions"] = lambda: [frankik.ik_full(T, q, float(q[6])) for T, q in given]
    hp = pytest.importorskip("eaik.IK_HP")
    zero = np.zeros(task.n)
    o = np.vstack([task.joint_origins(zero), task.placement(zero).translation])
    P = np.diff(np.vstack([np.zeros(3), o]), axis=0)
    robot = hp.HPRobot(task.axes(zero), P, fixed_axes=[(6, float(Q0[6]))])
    poses = [T.homogeneous for T in targets]
    names["EAIK, all solutions, one q7"] = lambda: [robot.IK(T) for T in poses]
    best = dict.fromkeys(names, np.inf)
    for _ in range(30):
        for name, loop in names.items():
            count = 4096 if "batch" in name else len(U)
            best[name] = min(best[name], 1e6 * seconds(loop, 1) / count)
    say("from Python, µs a pose: " + ", ".join(f"{name} {t:.2f}" for name, t in best.items()))
