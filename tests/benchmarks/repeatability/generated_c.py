"""The same cycles in generated C alone: no Python between the steps."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
from scenes import Scene

import repctl_pin as rp

_LOOP = """
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
int main(int argc, char **argv) {
    const int cycles = atoi(argv[1]), steps = atoi(argv[2]);
    const double dt = atof(argv[3]), share = atof(argv[4]);
    double q[ARM_N], next[ARM_N], c[ARM_R], best = 1e9;
    arm_pose *targets = malloc((size_t)steps * sizeof *targets);
    double *all = malloc((size_t)cycles * (size_t)steps * sizeof q);
    int cycle, k, i;
    (void)argc;
    if (fread(q, sizeof q, 1, stdin) != 1) return 1;
    if (fread(targets, sizeof *targets, (size_t)steps, stdin) != (size_t)steps) return 1;
    if (arm_leaf(q, c) != ARM_OK) return 2;
    for (cycle = 0; cycle < cycles; cycle++) {
        const double begin = now();
        for (k = 0; k < steps; k++) {
            if (arm_step(q, &targets[k], dt, NULL, c, NULL, NULL, next) != ARM_OK) return 3;
            for (i = 0; i < ARM_N; i++)
                all[(cycle * steps + k) * ARM_N + i] = q[i] += share * (next[i] - q[i]);
        }
        if ((now() - begin) / steps < best) best = (now() - begin) / steps;
    }
    fwrite(&best, sizeof best, 1, stdout);
    fwrite(all, sizeof q, (size_t)cycles * (size_t)steps, stdout);
    return 0;
}
"""


def build(inverse: rp.RepeatableInverse, folder: Path) -> Path:
    """Write the control as C, compile it with a loop round it, and say where the program is."""
    folder.mkdir(parents=True, exist_ok=True)
    rp.export_c(inverse, folder, name="arm")
    (folder / "cycles.c").write_text(_LOOP, encoding="utf-8")
    line = ["cc", "-std=c99", "-O2", "arm.c", "cycles.c", "-o", "cycles", "-lm"]
    subprocess.run(line, cwd=folder, check=True, capture_output=True)
    return folder / "cycles"


def run(program: Path, scene: Scene, cycles: int, share: float = 1.0) -> tuple[np.ndarray, float]:
    """Go round: the joints (cycles · steps + 1, n), and the least time of a step over the cycles,
    µs."""
    poses = [np.concatenate([x.translation, x.rotation.ravel()]) for x in scene.targets]
    given = scene.q0.tobytes() + np.array(poses).tobytes()
    line = [str(program), str(cycles), str(len(poses)), repr(scene.dt), repr(share)]
    found = np.frombuffer(subprocess.run(line, input=given, capture_output=True, check=True).stdout)
    return np.vstack([scene.q0, found[1:].reshape(-1, len(scene.q0))]), float(found[0])
