"""Torques in C: the numbers and the refusals of Python, and the same bits on other processors."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from controls import CONTROLS, NEEDS_C, own_cache  # noqa: F401
from test_codegen_builds import exported, needed, run

import repctl_pin as rp
from repctl_pin.codegen.compiled_loop import NAME, library
from repctl_pin.strategies.torque_law import Gains, Observer, torque_law

AGREE = 1e-10
QUICK = ("panda, axis, degree 2", "tiago, position, degree 2")


def in_c(inverse: rp.RepeatableInverse) -> Callable[..., tuple[int, np.ndarray]]:
    """The exported function, with the arguments of the law in Python."""
    task, path = inverse.task, library(inverse)
    n, m = task.n, task.m
    function = ctypes.CDLL(path)[f"{NAME}_torque"]

    def pointer(values: np.ndarray | None) -> ctypes.c_void_p | None:
        return None if values is None else ctypes.c_void_p(values.ctypes.data)

    def torque(
        q, qdot, M, b, target, twist, leaf, gains: Gains, observer: Observer | None
    ):
        pose = np.r_[target.translation, np.ravel(target.rotation)]
        packed = np.r_[gains.stiffness, gains[1:5], gains.observer_limit]
        assert len(packed) == m + 4 + n
        tau, state = np.full(n, np.nan), None if observer is None else observer.state
        status = function(
            *map(
                pointer,
                (q, qdot, np.ascontiguousarray(M), b, pose, twist, leaf, packed),
            ),
            ctypes.c_double(0.0 if observer is None else observer.dt),
            *map(pointer, (state, tau)),
        )
        return status, tau

    return torque


def disagreement(name: str, folder: Path, count: int) -> tuple[float, int]:
    """The greatest difference of torques and states, relative to torques above 1, and how many were
    refused."""
    inverse, q0 = CONTROLS[name](folder)
    task, rng = inverse.task, np.random.default_rng(2)
    ours, worst, refused = in_c(inverse), 0.0, 0
    for k in range(count):
        gains = Gains(
            rng.uniform(50, 3000, task.m),
            *rng.uniform(0.5, 20, 4),
            rng.uniform(0.5, 5, task.n),
        )
        law = torque_law(task, inverse.potentials, gains)
        q = q0 + 0.4 * rng.uniform(-1, 1, task.n)
        if k % 16 == 15:
            q = np.zeros(task.n)  # stretched, for many an arm
        A = rng.normal(size=(task.n, task.n))
        M, b, qdot = (
            A @ A.T / task.n + 0.1 * np.eye(task.n),
            *rng.normal(size=(2, task.n)),
        )
        target = task.placement(q + 0.05 * rng.normal(size=task.n))
        twist = rng.normal(size=6) if k % 3 else None
        leaf = inverse.leaf(q0) + 0.05 * rng.normal(size=task.r)
        state = rng.normal(size=task.r)
        observers = [Observer(state.copy(), 1e-3) if k % 4 else None for _ in range(2)]
        status, tau = ours(
            q, qdot * (k % 9 > 0), M, b, target, twist, leaf, gains, observers[0]
        )
        try:
            python = law(q, qdot * (k % 9 > 0), M, b, target, twist, leaf, observers[1])
        except rp.SingularityError:
            assert status == 1 and np.isnan(tau).all()
            refused += 1
            continue
        assert status == 0
        J_V = np.vstack([task.jacobian(q), inverse.potentials.gradient(q).T])
        hard = max(1.0, 1e-3 * float(np.linalg.cond(J_V)))
        size = max(1.0, float(np.abs(python).max())) * hard
        worst = max(worst, float(np.abs(tau - python).max()) / size)
        if observers[0] is not None and observers[1] is not None:
            worst = max(
                worst,
                float(np.abs(observers[0].state - observers[1].state).max()) / hard,
            )
    return worst, refused


@NEEDS_C
@pytest.mark.parametrize("name", QUICK)
def test_c_computes_the_torques_of_python(name: str, tmp_path: Path) -> None:
    worst, refused = disagreement(name, tmp_path, 100)
    print(f"{name}: {worst:.1e}, {refused} refused")
    assert worst < AGREE and refused < 50


@NEEDS_C
@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLS)
def test_c_computes_10000_torques_of_python(name: str, tmp_path: Path) -> None:
    worst, refused = disagreement(name, tmp_path, 10_000)
    print(f"{name}: {worst:.1e}, {refused} refused")
    assert worst < AGREE


@NEEDS_C
def test_the_robots_own_inertia_gives_the_torque_of_python(
    panda_design: rp.Design, q_panda: np.ndarray
) -> None:
    """M and b of the URDF, with default gains: arm_torque_defaults() has those of Python."""
    inverse, task = panda_design.inverse, panda_design.task
    q, qdot, dynamics = q_panda + 0.1, np.linspace(-1, 1, 7), task.dynamics()
    M, b = task.inertias(q[None])[0], dynamics(q, qdot, np.zeros(7))
    target, leaf, twist = (
        task.placement(q_panda),
        inverse.leaf(q_panda),
        0.1 * np.ones(6),
    )
    control = rp.LeafImpedance(inverse)
    python = control.torque(q, qdot, target, twist, leaf=leaf)
    status, tau = in_c(inverse)(q, qdot, M, b, target, twist, leaf, control.gains, None)
    assert status == 0 and np.abs(tau - python).max() < AGREE * np.abs(python).max()
    function, tau = ctypes.CDLL(library(inverse))[f"{NAME}_torque"], np.zeros(7)
    pose = np.r_[target.translation, np.ravel(target.rotation)]
    given = (q, qdot, M, b, pose, twist, leaf)
    function(
        *(ctypes.c_void_p(x.ctypes.data) for x in given), None, ctypes.c_double(0), None,
        ctypes.c_void_p(tau.ctypes.data),
    )  # fmt: skip
    assert np.abs(tau - python).max() < AGREE * np.abs(python).max()


@NEEDS_C
def test_what_c_refuses_changes_nothing(
    panda_design: rp.Design, q_panda: np.ndarray
) -> None:
    inverse, task = panda_design.inverse, panda_design.task
    torque, gains = in_c(inverse), rp.LeafImpedance(inverse).gains
    upper = np.eye(7) + np.triu(0.1 * np.ones((7, 7)), 1)
    good = {
        "q": q_panda, "qdot": np.zeros(7), "M": np.eye(7), "b": np.zeros(7),
        "target": task.placement(q_panda), "twist": None, "leaf": inverse.leaf(q_panda),
        "gains": gains, "observer": Observer(np.zeros(1), 1e-3),
    }  # fmt: skip
    bad = [
        {"q": np.full(7, np.nan)}, {"qdot": np.full(7, np.inf)}, {"qdot": np.full(7, 1e200)},
        {"M": upper}, {"M": -np.eye(7)}, {"M": np.full((7, 7), np.nan)}, {"b": np.full(7, np.nan)},
        {"twist": np.full(6, np.nan)}, {"leaf": np.array([1e308])},
        {"gains": gains._replace(stiffness=np.zeros(6))},
        {"gains": gains._replace(damping=np.nan)}, {"gains": gains._replace(observer_rate=0.0)},
        {"gains": gains._replace(observer_limit=np.zeros(7))},
        {"observer": Observer(np.zeros(1), 0.0)}, {"observer": Observer(np.zeros(1), 0.02)},
        {"observer": Observer(np.full(1, np.nan), 1e-3)},
    ]  # fmt: skip
    assert torque(**good)[0] == 0
    for change in bad:
        given = good | {"observer": Observer(np.full(1, 0.5), 1e-3)} | change
        before = given["observer"].state.copy()
        status, tau = torque(**given)
        assert status == 2 and np.isnan(tau).all(), change
        assert np.array_equal(given["observer"].state, before, equal_nan=True)


BITS = """
#include "arm.h"
#include "test_vectors.h"
#include <math.h>
#include <stdio.h>
#include <string.h>
int main(void) {
    int k, i, ok = 0;
    for (k = 0; k < ARM_VECTORS; k++) {
        const arm_vector *v = &arm_vectors[k];
        double q[ARM_N], observer[ARM_R], tau[ARM_N];
        memcpy(observer, v->observer, sizeof observer);
        memcpy(q, v->q, sizeof q);
        for (i = 0; i < 20; i++) {
            int j;
            if (arm_torque(q, v->joint_speed, v->M, v->bias, &v->target, v->twist, v->leaf,
                           &v->gains, 1e-3, observer, tau) != ARM_OK) break;
            for (j = 0; j < ARM_N; j++) q[j] += 1e-3 * v->joint_speed[j];
            for (j = 0; j < ARM_N; j++) printf("%a ", tau[j]);
            for (j = 0; j < ARM_R; j++) printf("%a ", observer[j]);
            printf("\\n");
            ok++;
        }
    }
    return ok > 200 ? 0 : 1;
}
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda, pose, degree 2", "random axes and slides"])
@pytest.mark.parametrize("target", ["arm-linux-gnueabihf", "riscv64-linux-gnu"])
def test_torques_are_the_same_bits_on_other_processors(
    target: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The code's own arithmetic; glibc's sin, cos and atan2 have other last bits where they have no
    fused multiply–add, so they are told to do without it here where the other processor does."""
    emulator = f"qemu-{target.partition('-')[0]}"
    needed("gcc", f"{target}-gcc", emulator)
    folder = exported(name, tmp_path)
    (folder / "bits.c").write_text(BITS)
    options = ["-std=c99", "-O2", "-static", "arm.c", "bits.c", "-lm", "-o"]
    run(["gcc", *options, "here"], folder)
    run([f"{target}-gcc", *options, "there"], folder)
    if target.startswith("arm"):
        monkeypatch.setenv(
            "GLIBC_TUNABLES", "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4,-AVX2_Usable"
        )
    here, there = run(["./here"], folder), run([emulator, "./there"], folder)
    same = sum(a == b for a, b in zip(here.split(), there.split(), strict=True))
    print(f"{target}, {name}: {same} of {len(here.split())} numbers are the same bits")
    assert len(re.findall("0x", here)) > 1000 and same == len(here.split())
