"""Torques in C: those of the law, refused as in Python, and the same bits on other processors."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from controls import CONTROLS, NEEDS_C, own_cache, some, target_at  # noqa: F401
from test_codegen_builds import exported, needed, run
from test_governor_c import in_c as library

import repctl_pin as rp

AGREE = 1e-10
QUICK = ("panda, axis, degree 2", "tiago, position, degree 2", "elbow and hand of panda")


class Gains(NamedTuple):
    """The fields of ``arm_gains``, in order."""

    stiffness: np.ndarray
    damping: float
    leaf_frequency: float
    leaf_damping: float
    observer_rate: float
    observer_limit: np.ndarray


class Observer(NamedTuple):
    """State of an observer and its time step, s."""

    state: np.ndarray
    dt: float


def in_c(inverse: rp.RepeatableInverse, folder: Path) -> Callable[..., Any]:
    """The exported function, with the arguments of the law."""
    rp.export_c(inverse, folder / "torque", "arm")
    function = library(folder / "torque").arm_torque

    def pointer(values: np.ndarray | None) -> ctypes.c_void_p | None:
        return None if values is None else ctypes.c_void_p(values.ctypes.data)

    def torque(
        q, qdot, M, b, target, twist, leaf, gains: Gains | None, observer: Observer | None
    ) -> tuple[int, np.ndarray]:
        placed = [target] if isinstance(target, pin.SE3) else target
        poses = [np.r_[x.translation, np.ravel(x.rotation)] for x in placed]
        pose = np.concatenate(poses)
        packed = None
        if gains is not None:
            packed = np.r_[gains.stiffness, gains[1:5], gains.observer_limit]
            assert len(packed) == inverse.task.m + 4 + inverse.task.n
        tau = np.full(inverse.task.n, np.nan)
        state = None if observer is None else observer.state
        status = function(
            *map(pointer, (q, qdot, np.ascontiguousarray(M), b, pose, twist, leaf, packed)),
            ctypes.c_double(0.0 if observer is None else observer.dt),
            *map(pointer, (state, tau)),
        )
        return status, tau

    return torque


@pytest.fixture(scope="module")
def torque(panda_design: rp.Design, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Any]:
    """The exported function of the quadratic design of the theory."""
    return in_c(panda_design.inverse, tmp_path_factory.mktemp("panda"))


def law(
    inverse: rp.RepeatableInverse, gains: Gains, q, qdot, M, b, target, twist, leaf, observer
) -> tuple[np.ndarray, np.ndarray | None]:
    """τ of :class:`rp.LeafImpedance` for any inertia M and bias b, and the observer's next state.

    τ = M J_V⁻¹ ([ẍ; ḧ − s d] − J̇_V q̇) + b; with A = √K J M⁻¹ Jᵀ √K the hand's acceleration is
    √K ẍ = A √K e + 2 ζ A^½ √K (ẋ* − ẋ), which is Λ⁻¹ F with the same damping in all directions."""
    task, m = inverse.task, inverse.task.m

    def rows(q: np.ndarray) -> np.ndarray:
        return np.vstack([task.jacobian(q), inverse.potentials.gradient(q).T])

    J_V, speed = rows(q), np.linalg.norm(qdot)
    J, ahead = J_V[:m], 1e-3 * qdot / speed if speed else qdot
    bent = (rows(q + ahead) - rows(q - ahead)) @ qdot * speed / 2e-3
    rates, root = J_V @ qdot, np.sqrt(gains.stiffness)
    A = root[:, None] * (J @ np.linalg.solve(M, J.T)) * root
    values, U = np.linalg.eigh(A)
    half = (U * np.sqrt(np.maximum(values, 0.0))) @ U.T
    lag = -rates[:m] + (0.0 if twist is None else task.task_velocity(q, twist))
    e = task.error(q, target)
    xddot = (A @ (root * e) + 2 * gains.damping * half @ (root * lag)) / root
    omega, hdot = gains.leaf_frequency, rates[m:]
    pull = omega**2 * (leaf - inverse.leaf(q)) - 2 * gains.leaf_damping * omega * hdot
    tau = M @ np.linalg.solve(J_V, np.r_[xddot, pull] - bent) + b
    if observer is None:
        return tau, None
    d = gains.observer_rate * (hdot - observer.state)
    opposed = M @ np.linalg.solve(J_V, np.r_[np.zeros(m), d])
    share = 1.0 / max(1.0, np.abs(opposed / gains.observer_limit).max())
    state = hdot - share * d / gains.observer_rate + observer.dt * pull
    return tau - share * opposed, state


def disagreement(name: str, folder: Path, count: int) -> tuple[float, int]:
    """The greatest difference of torques and states, relative to torques above 1, and how many were
    refused."""
    inverse, q0 = CONTROLS[name](folder)
    task, rng = inverse.task, np.random.default_rng(2)
    ours, worst, refused = in_c(inverse, folder), 0.0, 0
    for k in range(count):
        gains = Gains(
            rng.uniform(50, 3000, task.m), *rng.uniform(0.5, 20, 4), rng.uniform(0.5, 5, task.n)
        )
        q = q0 + 0.4 * rng.uniform(-1, 1, task.n)
        if k % 16 == 15:
            q = np.zeros(task.n)  # stretched, for many an arm
        A = rng.normal(size=(task.n, task.n))
        M, b, qdot = (A @ A.T / task.n + 0.1 * np.eye(task.n), *rng.normal(size=(2, task.n)))
        target = target_at(task, q + 0.05 * rng.normal(size=task.n))
        twist = rng.normal(size=task.twist_size) if k % 3 else None
        leaf = inverse.leaf(q0) + 0.05 * rng.normal(size=task.r)
        observer = Observer(rng.normal(size=task.r), 1e-3) if k % 4 else None
        given = (q, qdot * (k % 9 > 0), M, b, target, twist, leaf)
        try:
            inverse.velocity(q, np.zeros(task.m))
        except rp.SingularityError:
            status, tau = ours(*given, gains, observer)
            assert status == 1 and np.isnan(tau).all()
            refused += 1
            continue
        expected, state = law(inverse, gains, *given, observer)
        status, tau = ours(*given, gains, observer)
        assert status == 0
        J_V = np.vstack([task.jacobian(q), inverse.potentials.gradient(q).T])
        hard = max(1.0, 1e-3 * float(np.linalg.cond(J_V)))
        size = max(1.0, float(np.abs(expected).max())) * hard
        worst = max(worst, float(np.abs(tau - expected).max()) / size)
        if observer is not None:
            worst = max(worst, float(np.abs(observer.state - state).max()) / hard)
    return worst, refused


@NEEDS_C
@pytest.mark.parametrize("name", some(QUICK, QUICK[2]))
def test_c_computes_the_torques_of_the_law(name: str, tmp_path: Path) -> None:
    worst, refused = disagreement(name, tmp_path, 100)
    print(f"{name}: {worst:.1e}, {refused} refused")
    assert worst < AGREE and refused < 50


@NEEDS_C
@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLS)
def test_c_computes_10000_torques_of_the_law(name: str, tmp_path: Path) -> None:
    worst, refused = disagreement(name, tmp_path, 10_000)
    print(f"{name}: {worst:.1e}, {refused} refused")
    assert worst < AGREE


@NEEDS_C
def test_the_robots_own_inertia_gives_the_torque_of_python(
    panda_design: rp.Design, q_panda: np.ndarray, torque: Callable[..., Any]
) -> None:
    """M and b of the URDF, with default gains: arm_torque_defaults() has those of Python."""
    inverse, task = panda_design.inverse, panda_design.task
    q, qdot, dynamics = q_panda + 0.1, np.linspace(-1, 1, 7), task.dynamics()
    M, b = task.inertias(q[None])[0], dynamics(q, qdot, np.zeros(7))
    target, leaf, twist = (task.placement(q_panda), inverse.leaf(q_panda), 0.1 * np.ones(6))
    control = rp.LeafImpedance(inverse)
    python = control.torque(q, qdot, target, twist, leaf=leaf)
    for gains in (control.gains, None):
        status, tau = torque(q, qdot, M, b, target, twist, leaf, gains, None)
        assert status == 0 and np.abs(tau - python).max() < AGREE * np.abs(python).max()


@pytest.mark.parametrize("native", ["yes", "no"])
def test_python_computes_the_torques_of_the_law(
    native: str, panda_design: rp.Design, q_panda: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the robot's own M and b: any gains, with and without an observer at its limits."""
    monkeypatch.setenv("REPCTL_NATIVE", native)
    inverse, task, rng = (panda_design.inverse, panda_design.task, np.random.default_rng(5))
    dynamics = task.dynamics()
    for k in range(24):
        gains = Gains(rng.uniform(50, 3000, 6), *rng.uniform(0.5, 20, 4), rng.uniform(0.5, 5, 7))
        control = rp.LeafImpedance(inverse, **gains._asdict())
        q = q_panda + 0.3 * rng.uniform(-1, 1, 7)
        qdot, state = (k % 9 > 0) * rng.normal(size=7), rng.normal(size=1)
        target = task.placement(q + 0.05 * rng.normal(size=7))
        twist = rng.normal(size=6) if k % 3 else None
        leaf = inverse.leaf(q_panda) + 0.05 * rng.normal(size=1)
        M, b = task.inertias(q[None])[0], dynamics(q, qdot, np.zeros(7))
        observer = control.observer(dt=1e-3) if k % 4 else None
        if observer is not None:
            observer.state[:] = state
        given = Observer(state, 1e-3) if k % 4 else None
        expected, after = law(inverse, gains, q, qdot, M, b, target, twist, leaf, given)
        tau = control.torque(q, qdot, target, twist, leaf=leaf, observer=observer)
        assert np.abs(tau - expected).max() < AGREE * max(1.0, np.abs(expected).max())
        if observer is not None:
            assert np.abs(observer.state - after).max() < AGREE * max(1.0, np.abs(after).max())


@NEEDS_C
def test_what_c_refuses_changes_nothing(
    panda_design: rp.Design, q_panda: np.ndarray, torque: Callable[..., Any]
) -> None:
    inverse, task = panda_design.inverse, panda_design.task
    gains = rp.LeafImpedance(inverse).gains
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
        monkeypatch.setenv("GLIBC_TUNABLES", "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4,-AVX2_Usable")
    here, there = run(["./here"], folder), run([emulator, "./there"], folder)
    same = sum(a == b for a, b in zip(here.split(), there.split(), strict=True))
    print(f"{target}, {name}: {same} of {len(here.split())} numbers are the same bits")
    assert len(re.findall("0x", here)) > 1000 and same == len(here.split())
