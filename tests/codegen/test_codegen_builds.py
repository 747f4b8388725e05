"""Exported folders, built strictly and run: on this machine, with sanitizers, on other
processors."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from arms import Q_PANDA
from controls import CONTROLS, some

import repctl_pin as rp

STRICT = ["-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror"]
C99, CPP17 = ["-std=c99"], ["-x", "c++", "-std=c++17"]
BUILDS = {"gcc": C99, "clang": C99, "g++": CPP17, "clang++": CPP17}
FUZZ = Path(__file__).with_name("fuzz.c")


def run(command: Sequence[str | Path], folder: Path) -> str:
    """Run a command that must do what it should; what it says."""
    done = subprocess.run(
        [str(c) for c in command], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{command}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
    return done.stdout


def needed(*programs: str) -> None:
    """Skip where a program is missing."""
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(f"there is no {program} on this machine")


def built_and_checked(folder: Path, compiler: str, *flags: str, by: Sequence[str] = ()) -> None:
    """Compile strictly, and run check.c."""
    run(
        [
            compiler,
            *BUILDS.get(compiler, C99),
            *STRICT,
            *flags,
            "arm.c",
            "check.c",
            "-o",
            "check",
            "-lm",
        ],
        folder,
    )
    said = run([*by, "./check"], folder)
    assert re.match(r"48 vectors, 0 differences, maximum \d", said)


def region_of(
    kind: str, task: rp.Task, q0: np.ndarray
) -> rp.Box | rp.Tube | rp.WorkspaceBox | None:
    """A region of one kind round a configuration."""
    box = rp.Box(q0, 0.3)
    if kind == "tube":
        return rp.Tube(q0 + 0.2 * np.sin(np.arange(12))[:, None] * np.ones(task.n), 0.2)
    if kind == "workspace":
        axes = [a for a in task.rows if a < 3]
        return rp.WorkspaceBox(task, task.placement(q0).translation[axes], 0.15, within=box)
    return box if kind == "box" else None


CASES = {
    "panda, pose, degree 2": "box",
    "panda, pose, degree 1": "none",  # its velocity does not depend on the last joint
    "panda, axis, degree 2": "workspace",
    "ppr, degree 5 of some joints": "workspace",
    "panda, pose, joined": "tube",
    "random axes and slides": "box",
}


def exported(name: str, folder: Path, region: str | None = None) -> Path:
    """Export a control under the name ``arm``."""
    inverse, q0 = CONTROLS[name](folder)
    rp.export_c(
        inverse,
        folder / "c",
        "arm",
        region=region_of(region or CASES.get(name, "box"), inverse.task, q0),
    )
    return folder / "c"


@pytest.mark.parametrize(
    "name",
    some(
        [
            "panda, pose, degree 1",
            "panda, axis, degree 2",
            "panda, pose, joined",
            "random axes and slides",
            "elbow and hand of panda",
        ],
        "elbow and hand of panda",
    ),
)
def test_it_builds_without_a_warning_and_computes_what_python_does(
    name: str, tmp_path: Path
) -> None:
    needed("gcc")
    folder = exported(name, tmp_path)
    shipped = name == "panda, axis, degree 2"
    for compiler in BUILDS if shipped else ["gcc"]:
        if shutil.which(compiler):
            flags = ["-O2"] if shipped and compiler == "gcc" else []
            built_and_checked(folder, compiler, *flags)


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLS)
def test_every_control_builds(name: str, tmp_path: Path) -> None:
    needed(*BUILDS)
    folder = exported(name, tmp_path)
    for compiler in BUILDS:
        built_and_checked(folder, compiler)


@pytest.mark.slow
def test_a_wrong_build_is_told(tmp_path: Path) -> None:
    """check.c would not pass on another arm's numbers, nor on a status that is another."""
    needed("gcc")
    folder = exported("panda, xz, degree 1", tmp_path)
    code = (folder / "arm.c").read_text()
    for wrong in (
        code.replace("0.316", "0.317"),
        code.replace("return ARM_BAD_NUMBER", "return ARM_SINGULAR"),
    ):
        assert wrong != code
        (folder / "arm.c").write_text(wrong)
        run(["gcc", "-w", "arm.c", "check.c", "-o", "check", "-lm"], folder)
        assert (
            subprocess.run(["./check"], cwd=folder, capture_output=True, check=False).returncode
            == 1
        )


@pytest.mark.parametrize("flag", some(["-ffast-math", "-ffinite-math-only"], "-ffast-math"))
def test_flags_that_lose_nan_are_refused(flag: str, tmp_path: Path) -> None:
    """Issue 37, item 9: -ffinite-math-only compiled, and arm_step() took NaN."""
    needed("gcc")
    rp.export_c(CONTROLS["ppr, degree 5 of some joints"](tmp_path)[0], tmp_path, "arm")
    line = ["gcc", "-O0", flag, "-c", "arm.c"]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode != 0 and "compile without -ffast-math" in done.stderr
    run([*line, "-fno-fast-math", "-fno-finite-math-only"], tmp_path)


@pytest.mark.slow
def test_cmake_builds_and_tests_it(panda_design: rp.Design, tmp_path: Path) -> None:
    needed("cmake", "cc")
    rp.export_c(panda_design.inverse, tmp_path / "c", "panda_control", region=panda_design.region)
    run(["cmake", "-S", "c", "-B", "build", "-DCMAKE_BUILD_TYPE=Debug"], tmp_path)
    run(["cmake", "--build", "build"], tmp_path)
    assert "100% tests passed" in run(["ctest", "--test-dir", "build"], tmp_path)
    said = run(["build/panda_control_loop"], tmp_path)
    assert float(re.search(r"circles: (\S+) rad", said)[1]) < 1e-4  # type: ignore[index]


CPP = """
#include "panda_control.hpp"
#include <cmath>
#include <cstdio>
int main() {
    using namespace panda_control;
    const Joints q = @q;
    Pose pose; Leaf c; Joints qdot, next; std::array<double, coordinates * joints> J; Report report;
    if (placement(q, pose) != Status::ok || leaf(q, c) != Status::ok ||
        jacobian(q, J) != Status::ok) return 1;
    if (inside(q) != Status::ok || inside(Joints{}) != Status::outside) return 2;
    if (velocity(q, Rates{0.1, 0, 0, 0, 0, 0.2}, qdot) != Status::ok) return 3;
    if (velocity(Joints{std::nan("")}, Rates{}, qdot) != Status::bad_number) return 4;
    const Pose same = from_columns({pose.R[0], pose.R[3], pose.R[6], 0,
                                    pose.R[1], pose.R[4], pose.R[7], 0,
                                    pose.R[2], pose.R[5], pose.R[8], 0,
                                    pose.p[0], pose.p[1], pose.p[2], 1});
    const Options options = defaults();
    const Twist twist{0.1, 0, 0, 0, 0, 0.2};
    if (step(q, same, 0.001, &twist, &c, &options, &report, next) != Status::ok) return 5;
    for (double v : qdot) std::printf("%.17g ", v);
    for (std::size_t i = 0; i < joints; i++) std::printf("%.17g ", (next[i] - q[i]) / 0.001);
}
"""


@pytest.mark.parametrize("compiler", ["g++", "clang++"])
def test_the_cpp_face(compiler: str, panda_design: rp.Design, tmp_path: Path) -> None:
    needed(compiler, "cc")
    rp.export_c(panda_design.inverse, tmp_path, "panda_control", region=panda_design.region)
    (tmp_path / "use.cpp").write_text(
        CPP.replace("@q", "{" + ", ".join(map(repr, Q_PANDA.tolist())) + "}")
    )
    run(["cc", "-std=c99", *STRICT, "-c", "panda_control.c"], tmp_path)
    run([compiler, "-std=c++17", *STRICT, "use.cpp", "panda_control.o", "-o", "use"], tmp_path)
    said = np.array(run(["./use"], tmp_path).split(), float).reshape(2, 7)
    qdot = panda_design.inverse.velocity(Q_PANDA, np.array([0.1, 0, 0, 0, 0, 0.2]))
    assert np.abs(said[0] - qdot).max() < 1e-13 and np.abs(said[1] - qdot).max() < 1e-11


def fuzzed(folder: Path, count: int) -> None:
    """Hostile numbers, with the compiler's sanitizers."""
    watch = ["-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    run(["gcc", "-std=c99", *watch, "arm.c", str(FUZZ), "-I.", "-o", "fuzz", "-lm"], folder)
    print(run(["./fuzz", str(count)], folder))


@pytest.mark.slow
def test_hostile_numbers_do_no_harm(tmp_path: Path) -> None:
    needed("gcc")
    fuzzed(exported("panda, pose, degree 1", tmp_path), 300)


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLS)
def test_100000_hostile_numbers_do_no_harm(name: str, tmp_path: Path) -> None:
    needed("gcc")
    fuzzed(exported(name, tmp_path), 100_000)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("target", ["arm-linux-gnueabihf", "riscv64-linux-gnu"])
def test_other_processors_compute_the_same(target: str, name: str, tmp_path: Path) -> None:
    emulator = f"qemu-{target.partition('-')[0]}"
    needed(f"{target}-gcc", emulator)
    built_and_checked(exported(name, tmp_path), f"{target}-gcc", "-static", by=[emulator])


CYCLES = """
#include "arm.h"
#include <math.h>
#include <stdio.h>
int main(void) {
    const double start[ARM_N] = @q, turn = 6.283185307179586, dt = 0.01;
    double q[ARM_N], c[ARM_R], twist[6] = {0.0};
    arm_pose centre, target;
    long k; int i;
    for (i = 0; i < ARM_N; i++) q[i] = start[i];
    arm_leaf(q, c); arm_placement(q, &centre);
    for (k = 0; k < 500L * @cycles; k++) {
        const double angle = turn * (double)(k % 500) / 500.0;
        target = centre;
        target.p[0] += 0.1 * (cos(angle) - 1.0); target.p[1] += 0.1 * sin(angle);
        twist[0] = -0.1 * turn / 5.0 * sin(angle); twist[1] = 0.1 * turn / 5.0 * cos(angle);
        if (arm_step(q, &target, dt, twist, c, NULL, NULL, q) != ARM_OK) return 1;
        if (k % 500 == 499 && (k / 500 + 1) % (@cycles / 10) == 0) {
            for (i = 0; i < ARM_N; i++) printf("%.17g ", q[i]);
        }
    }
    return 0;
}
"""


@pytest.mark.slow
def test_10000_cycles_have_no_trend_and_end_where_python_does(
    panda_design: rp.Design, tmp_path: Path
) -> None:
    """With the leaf lock, one whole Newton step each time."""
    needed("gcc")
    inverse, task, cycles = panda_design.inverse, panda_design.task, 10_000
    rp.export_c(inverse, tmp_path, "arm", region=panda_design.region)
    start = "{" + ", ".join(map(repr, Q_PANDA.tolist())) + "}"
    (tmp_path / "cycles.c").write_text(CYCLES.replace("@q", start).replace("@cycles", str(cycles)))
    run(["gcc", "-std=c99", "-O2", "arm.c", "cycles.c", "-o", "cycles", "-lm"], tmp_path)
    ends = np.array(run(["./cycles"], tmp_path).split(), float).reshape(10, 7)
    assert np.abs(ends - ends[0]).max() < 1e-12  # the same after 1,000, 2,000, … cycles

    centre, leaf, q = task.placement(Q_PANDA), inverse.leaf(Q_PANDA), Q_PANDA
    ways = []
    for k in range(500):
        angle, target = 2 * np.pi * k / 500, centre.copy()
        target.translation = centre.translation + 0.1 * np.array(
            [np.cos(angle) - 1, np.sin(angle), 0]
        )
        twist = 0.1 * 2 * np.pi / 5 * np.array([-np.sin(angle), np.cos(angle), 0, 0, 0, 0])
        ways.append((target, twist))
    for _ in range(cycles):
        for target, twist in ways:
            q = inverse.step(q, target, 0.01, twist, leaf=leaf)
    print(
        f"C and Python {np.abs(q - ends[-1]).max():.1e} apart, drift "
        f"{np.abs(q - Q_PANDA).max():.1e}"
    )
    assert np.abs(q - ends[-1]).max() < 1e-9
