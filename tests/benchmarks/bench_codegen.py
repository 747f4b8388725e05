"""How fast generated C is, as ratios in one run on one core:

    python -m pytest tests/benchmarks/bench_codegen.py -o python_files="bench_*.py" -n 0

The measure is Pinocchio's frame Jacobian called from Python. All take turns in short bursts, and
each one's best burst counts, so that ratios hold on a busy machine too."""

from __future__ import annotations

import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from controls import in_numpy

import repctl_pin as rp

Q0 = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
DT = 0.01

BENCH = """
#define _POSIX_C_SOURCE 199309L
#include "arm.h"
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}
static int ascending(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}
static float times[1000000];
int main(int argc, char **argv) {
    const double start[ARM_N] = @q, xdot[ARM_M] = {0.1, 0.05, -0.02, 0.1, 0.2, -0.1};
    double q[ARM_N], out[ARM_N], c[ARM_R], best[2] = {1e9, 1e9}, sum = 0.0;
    arm_pose target;
    int round, k, i;
    (void)argv;
    arm_leaf(start, c);
    arm_placement(start, &target);
    target.p[0] += 0.01;
    for (round = 0; round < 200; round++) {
        double begin = now();
        for (k = 0; k < 200; k++) {
            for (i = 0; i < ARM_N; i++) q[i] = start[i] + 1e-3 * (double)(k % 17);
            arm_velocity(q, xdot, out);
            sum += out[0];
        }
        begin = (now() - begin) / 200.0;
        if (begin < best[0]) best[0] = begin;
        begin = now();
        for (k = 0; k < 200; k++) {
            for (i = 0; i < ARM_N; i++) q[i] = start[i] + 1e-3 * (double)(k % 17);
            arm_step(q, &target, 0.01, xdot, c, NULL, NULL, out);
            sum += out[0];
        }
        begin = (now() - begin) / 200.0;
        if (begin < best[1]) best[1] = begin;
    }
    printf("%.4f %.4f", best[0], best[1]);
    if (argc > 1) {
        for (round = 0; round < 3; round++)
            for (k = 0; k < 1000000; k++) {
                const double begin = now();
                float took;
                for (i = 0; i < ARM_N; i++) q[i] = start[i] + 1e-7 * (double)k;
                arm_step(q, &target, 0.01, xdot, c, NULL, NULL, out);
                sum += out[0];
                took = (float)(now() - begin);
                if (round == 0 || took < times[k]) times[k] = took;
            }
        qsort(times, 1000000, sizeof times[0], ascending);
        printf(" %.4f %.4f %.4f", (double)times[500000], (double)times[999900],
               (double)times[999999]);
    }
    return sum == 12345.0;
}
"""


def control(task: rp.Task, degree: int) -> rp.RepeatableInverse:
    """A design near constant rows; what it is worth does not matter here."""
    potentials = rp.Polynomial(Q0, degree, 0.5)
    N = rp.redundancy.nullspace(task.jacobian(Q0))
    return rp.RepeatableInverse(
        task,
        potentials.weighted(np.linalg.lstsq(potentials.gradients(Q0[None])[0], N, rcond=None)[0]),
    )


def best_of(loops: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Best time of each, µs a turn; every function makes 200 turns."""
    best = dict.fromkeys(loops, np.inf)
    for _ in range(rounds):
        for name, loop in loops.items():
            begin = time.perf_counter()
            loop()
            best[name] = min(best[name], (time.perf_counter() - begin) / 200 * 1e6)
    return best


def jacobian(task: rp.Task) -> Callable[[], None]:
    """200 frame Jacobians, called from Python."""
    model, data, frame = (
        task.model,
        task.model.createData(),
        task.model.getFrameId(task.frame, pin.FrameType.BODY),
    )

    def loop(evaluate=pin.computeFrameJacobian) -> None:
        for _ in range(200):
            evaluate(model, data, Q0, frame, WORLD)

    return loop


def test_c_beside_pinocchios_jacobian(panda_pose: rp.Task, say, tmp_path: Path) -> None:
    """At -O2: velocity of degree 2 at most 0.6 of the Jacobian, step 1.0; degree 4 at most thrice
    degree 2."""
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc on this machine")
    (tmp_path / "bench.c").write_text(
        BENCH.replace("@q", "{" + ", ".join(map(repr, Q0.tolist())) + "}")
    )
    found: dict[int, np.ndarray] = {}
    base = np.inf
    for degree in (2, 4):
        rp.export_c(control(panda_pose, degree), tmp_path / str(degree), "arm")
        line = ["gcc", "-std=c99", "-O2", "-I.", "arm.c", "../bench.c", "-o", "bench", "-lm"]
        subprocess.run(line, cwd=tmp_path / str(degree), check=True)
    for _ in range(5):
        base = min(base, best_of({"jacobian": jacobian(panda_pose)}, 100)["jacobian"])
        for degree in (2, 4):
            done = subprocess.run(
                ["./bench"], cwd=tmp_path / str(degree), capture_output=True, text=True, check=True
            )
            times = np.array(done.stdout.split(), float)
            found[degree] = np.minimum(found.get(degree, times), times)
    say(
        f"µs: Jacobian {base:.3f}; velocity {found[2][0]:.3f}, degree 4 {found[4][0]:.3f}; step "
        f"{found[2][1]:.3f}; "
        f"of the Jacobian {found[2][0] / base:.2f}, {found[4][0] / base:.2f}, "
        f"{found[2][1] / base:.2f}"
    )
    assert found[2][0] < 0.6 * base and found[2][1] < base and found[4][0] < 3 * found[2][0]


def test_the_longest_of_a_million_steps(panda_pose: rp.Task, say, tmp_path: Path) -> None:
    """At most 50 times the median. Each is the least of three, for what the system does in between
    is not ours."""
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc on this machine")
    rp.export_c(control(panda_pose, 2), tmp_path, "arm")
    (tmp_path / "bench.c").write_text(
        BENCH.replace("@q", "{" + ", ".join(map(repr, Q0.tolist())) + "}")
    )
    subprocess.run(
        ["gcc", "-std=c99", "-O2", "arm.c", "bench.c", "-o", "bench", "-lm"],
        cwd=tmp_path,
        check=True,
    )
    done = subprocess.run(
        ["./bench", "all"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    _, _, median, rare, longest = map(float, done.stdout.split())
    say(
        f"the longest of a million steps, of the median: {longest / median:.1f}; one in 10,000: "
        f"{rare / median:.1f}"
    )
    assert longest < 50 * median


def test_a_step_beside_the_pinv_loop(panda_pose: rp.Task, say) -> None:
    """From Python, feedback and leaf included: at most 0.12 of q += dt pinv(J) (ẋ + K e)."""
    task, inverse = panda_pose, control(panda_pose, 2)
    plain, leaf, target, twist = (
        in_numpy(inverse),
        inverse.leaf(Q0),
        panda_pose.placement(Q0 + 0.01),
        np.full(6, 0.1),
    )
    model, data, frame = (
        task.model,
        task.model.createData(),
        task.model.getFrameId(task.frame, pin.FrameType.BODY),
    )

    def pinv() -> None:
        for _ in range(200):
            J = pin.computeFrameJacobian(model, data, Q0, frame, WORLD)
            here = data.oMf[frame]
            e = np.concatenate(
                [target.translation - here.translation, pin.log3(target.rotation @ here.rotation.T)]
            )
            Q0 + DT * np.linalg.pinv(J) @ (twist + e / DT)

    def ours(one: rp.RepeatableInverse) -> Callable[[], None]:
        def loop() -> None:
            for _ in range(200):
                one.step(Q0, target, DT, twist, leaf=leaf, gain=1 / DT)

        return loop

    best = best_of(
        {"pinv": pinv, "python": ours(plain), "c": ours(inverse), "jacobian": jacobian(task)}, 100
    )
    say(", ".join(f"{name} {t:.2f} µs, {t / best['pinv']:.3f} of pinv" for name, t in best.items()))
    assert best["c"] < 0.12 * best["pinv"]


def test_batches(panda_pose: rp.Task, say) -> None:
    """Vectorised NumPy and Pinocchio beside one call of C."""
    inverse = control(panda_pose, 2)
    plain, rng = in_numpy(inverse), np.random.default_rng(0)
    Q, Xdot = Q0 + rng.uniform(-0.3, 0.3, (200, 7)), rng.normal(size=(200, 6))
    best = best_of(
        {"python": lambda: plain.velocities(Q, Xdot), "c": lambda: inverse.velocities(Q, Xdot)}, 200
    )
    say(
        f"velocities, µs a row: Python {best['python']:.2f}, C {best['c']:.2f}: "
        f"{best['python'] / best['c']:.1f} times"
    )
    assert best["c"] < 0.5 * best["python"]
