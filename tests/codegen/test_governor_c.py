"""The exported governor: the joints of the library's, all limits kept, no allocation, clean."""

from __future__ import annotations

import ctypes
import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA
from cell_functions import function_of, on_a_workpiece
from controls import NEEDS_C, control, own_cache, some  # noqa: F401
from test_codegen_builds import needed, run
from two_armed import Q0 as Q_TWO
from two_armed import two_armed

import repctl_pin as rp

HARNESS = Path(__file__).parents[1] / "attack" / "governor_ticks.c"
DT, MARGIN = 0.001, 0.02
DOUBLE = ctypes.c_double
Q_PLANAR = np.array([0.3, 0.8, 0.8])


class Pose(ctypes.Structure):
    """``arm_pose``."""

    _fields_ = (("p", DOUBLE * 3), ("R", DOUBLE * 9))


def in_c(folder: Path) -> ctypes.CDLL:
    """Compile an exported folder as a library."""
    run(["cc", "-std=c99", "-O0", "-fPIC", "-c", "arm.c"], folder)
    run(["cc", "-shared", "arm.o", "-o", "arm.so", "-lm"], folder)
    return ctypes.CDLL(str(folder / "arm.so"))


def planar() -> tuple[rp.RepeatableInverse, np.ndarray, float, float]:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    return (control(task, Q_PLANAR, rp.Polynomial(Q_PLANAR, 2, 0.5)), Q_PLANAR, 6.0, 400.0)


def panda(kind: str) -> tuple[rp.RepeatableInverse, np.ndarray, float, float]:
    task = rp.Robot.load("panda").task("panda_hand_tcp", kind)
    return control(task, Q_PANDA, rp.Polynomial(Q_PANDA, 2, 0.5)), Q_PANDA, 7.5, np.inf


def cell() -> tuple[rp.RepeatableInverse, np.ndarray, float, float]:
    function = function_of("poses")
    return function.inverse, function(function.cell.placement), 10.0, 4000.0


def workpiece() -> tuple[rp.RepeatableInverse, np.ndarray, float, float]:
    """57.6: a cell on a workpiece that its own joints move."""
    function = on_a_workpiece()
    return function.inverse, function(function.cell.placement), 4.0, 400.0


def both_hands() -> tuple[rp.RepeatableInverse, np.ndarray, float, float]:
    """The left hand, and the right one relative to it."""
    with tempfile.TemporaryDirectory() as folder:
        frames = ("left", "xy"), ("right", "xy", "left")
        return two_armed(Path(folder), *frames), Q_TWO, 6.0, 400.0


def talos() -> tuple[rp.RepeatableInverse, np.ndarray, float, float]:
    hands = ["gripper_left_base_link", ("gripper_right_base_link", "axis")]
    task = rp.Robot.load("talos").task(hands)
    q0 = np.clip(task.reference, task.lower + 0.3, task.upper - 0.3)
    return control(task, q0, rp.Polynomial(q0, 2, 0.5)), q0, 5.0, 500.0


SLOW = pytest.mark.slow
CASES = [
    pytest.param(both_hands, 600, id="both hands", marks=SLOW),
    pytest.param(planar, 300, id="planar"),
    pytest.param(workpiece, 300, id="workpiece", marks=SLOW),
    pytest.param(lambda: panda("axis"), 600, id="axis", marks=SLOW),
    pytest.param(lambda: panda("pose"), 1500, id="pose", marks=SLOW),
    pytest.param(lambda: panda("position"), 1500, id="position", marks=SLOW),
    pytest.param(cell, 400, id="cell", marks=SLOW),
    pytest.param(talos, 1500, id="talos", marks=SLOW),
]


@NEEDS_C
@pytest.mark.parametrize(("make", "ticks"), CASES)
def test_it_commands_the_joints_that_the_library_does(
    make: Callable[[], tuple[rp.RepeatableInverse, np.ndarray, float, float]],
    ticks: int,
    tmp_path: Path,
) -> None:
    inverse, q0, acceleration, jerk = make()
    task, n = inverse.task, inverse.task.n
    more = {} if np.isinf(jerk) else {"jerk": jerk}
    limits = rp.Limits(acceleration=acceleration, **more)
    governor = rp.Governor(inverse, DT, limits, margin=MARGIN)
    governor.start(q0)
    rp.export_c(inverse, tmp_path, "arm")
    library = in_c(tmp_path)
    bounds, state, q = (
        (DOUBLE * (3 * n + 1))(),
        ctypes.create_string_buffer(1 << 20),
        (DOUBLE * n)(),
    )
    library.arm_governor_limits(bounds)
    np.testing.assert_array_equal(bounds[:n], task.velocity_limit)
    bounds[n : 2 * n], bounds[2 * n : 3 * n], bounds[3 * n] = (
        [acceleration] * n,
        [jerk] * n,
        MARGIN,
    )
    start = (DOUBLE * n)(*q0)
    assert library.arm_governor_start(state, start, DOUBLE(DT), bounds) == 0
    rng, home, worst, said = np.random.default_rng(1), task.placements(q0), 0.0, set()
    for k in range(ticks):
        if k % 50 == 0:
            target, twist, poses, rates = None, None, None, None
            if k == 100:  # not a number: the arm stops
                target = [pin.SE3(x.rotation, x.translation * np.nan) for x in home]
            elif k % 150 == 50:
                twist = 0.3 * rng.normal(size=task.twist_size)
                rates = (DOUBLE * len(twist))(*twist)
            elif k % 150 == 0:
                away = [0.1 * rng.normal(size=(2, 3)) for _ in home]
                target = [
                    pin.SE3(pin.exp3(w) @ x.rotation, x.translation + v)
                    for x, (v, w) in zip(home, away, strict=True)
                ]
            if target is not None:
                rows = [(DOUBLE * 3)(*x.translation) for x in target]
                turns = [(DOUBLE * 9)(*x.rotation.ravel()) for x in target]
                poses = (Pose * len(home))(*map(Pose, rows, turns))
                target = tuple(target)
        wanted, status = governor.step(target, twist)
        assert library.arm_governor_step(state, poses, rates, None, q) == status
        worst, said = max(worst, np.abs(np.array(q) - wanted).max()), said | {status}
    print(f"{worst:.1e} apart, {said}")
    assert worst < 1e-8 and np.abs(np.array(q) - q0).max() > 1e-3
    assert rp.Status.BAD_NUMBER in said


LEVELS = [
    pytest.param(planar, id="planar", marks=SLOW),
    pytest.param(workpiece, id="workpiece", marks=SLOW),
    pytest.param(both_hands, id="both hands"),
    pytest.param(lambda: panda("axis"), id="axis", marks=SLOW),
    pytest.param(lambda: panda("position"), id="position", marks=SLOW),
    pytest.param(cell, id="cell", marks=SLOW),
]


@NEEDS_C
@pytest.mark.parametrize("make", LEVELS)
def test_it_commands_the_joints_that_the_library_does_for_levels(
    make: Callable[[], tuple[rp.RepeatableInverse, np.ndarray, float, float]], tmp_path: Path
) -> None:
    """Item 30.1: pose and level, level alone, twist and level, a level that is not a number."""
    inverse, q0, acceleration, jerk = make()
    task, n, r = inverse.task, inverse.task.n, inverse.task.r
    more = {} if np.isinf(jerk) else {"jerk": jerk}
    governor = rp.Governor(inverse, DT, rp.Limits(acceleration=acceleration, **more))
    governor.start(q0)
    rp.export_c(inverse, tmp_path, "arm")
    library, state, q = in_c(tmp_path), ctypes.create_string_buffer(1 << 20), (DOUBLE * n)()
    bounds = (DOUBLE * (3 * n + 1))(*task.velocity_limit, *[acceleration] * n, *[jerk] * n, 0.0)
    assert library.arm_governor_start(state, (DOUBLE * n)(*q0), DOUBLE(DT), bounds) == 0
    rng, worst, said, levels = np.random.default_rng(2), 0.0, set(), []
    for k in range(600):
        if k % 75 == 0:
            near = q0 + 0.1 * rng.normal(size=n)
            target, twist, leaf = task.placements(near), None, inverse.leaf(near)
            poses, rates = None, None
            if k % 300 == 75:
                target = None
            elif k % 300 == 150:
                target, twist = None, 0.05 * rng.normal(size=task.twist_size)
                rates = (DOUBLE * len(twist))(*twist)
            elif k % 300 == 225:
                leaf = leaf * np.nan
            if target is not None:
                rows = [(DOUBLE * 3)(*x.translation) for x in target]
                turns = [(DOUBLE * 9)(*x.rotation.ravel()) for x in target]
                poses = (Pose * len(target))(*map(Pose, rows, turns))
                target = tuple(target)
        wanted, status = governor.step(target, twist, leaf=leaf)
        assert library.arm_governor_step(state, poses, rates, (DOUBLE * r)(*leaf), q) == status
        worst, said = max(worst, np.abs(np.array(q) - wanted).max()), said | {status}
        levels.append(inverse.leaf(np.array(q)))
    print(f"{worst:.1e} apart, {said}")
    assert worst < 1e-8 and np.ptp(levels, axis=0).min() > 1e-3
    assert rp.Status.BAD_NUMBER in said and rp.Status.SLOWED in said


CPP = """#include "arm.hpp"
#include <cstdio>
int main()
{
    arm::Governor governor;
    arm::Limits limits = arm::governor_limits();
    for (double& a : limits.acceleration) a = 6.0;
    for (double& j : limits.jerk) j = 400.0;
    arm::Joints q = @q, next = q;
    arm::Pose inside = {@p, @R};
    arm::Leaf leaf = @c;
    if (arm::governor_start(governor, q, @dt, limits) != arm::Status::ok) return 1;
    for (int k = 0; k < 1600; k++) {
        const arm::Leaf* level = k < 600 ? nullptr : &leaf;
        arm::Status status = arm::governor_step(governor, &inside, nullptr, level, next);
        std::printf("%d", static_cast<int>(status));
        if (status == arm::Status::recovering) std::printf(" back");
        for (double x : next) std::printf(" %.17g", x);
        std::printf("\\n");
    }
}
"""


@pytest.mark.slow
@NEEDS_C
@pytest.mark.parametrize("dt", some([0.001, 0.02], 0.02))
def test_exported_code_moves_back_from_beyond_a_limit(dt: float, tmp_path: Path) -> None:
    """Item 26.4: C and C++ command the library's way back, and refuse what is farther out.

    Inside, they move to another level (30.1).
    """
    needed("g++", "cc")
    inverse, q, acceleration, jerk = planar()
    task = inverse.task
    q = np.array([q[0], q[1], task.upper[2] + 0.05])
    goal = task.placement(np.array([q[0], q[1], task.upper[2] - 0.2]))
    governor = rp.Governor(inverse, dt, rp.Limits(acceleration=acceleration, jerk=jerk))
    governor.start(q)
    rp.export_c(inverse, tmp_path, "arm")
    level = inverse.leaf(q) + 0.01
    listed = {
        "@q": q, "@p": goal.translation, "@R": goal.rotation.ravel(), "@c": level, "@dt": dt,
    }  # fmt: skip
    text = CPP
    for name, value in listed.items():
        numbers = np.atleast_1d(value).tolist()
        joined = ", ".join(map(repr, numbers))
        text = text.replace(name, joined if name == "@dt" else f"{{{joined}}}")
    (tmp_path / "use.cpp").write_text(text)
    run(["cc", "-std=c99", "-c", "arm.c"], tmp_path)
    run(["g++", "-std=c++17", "use.cpp", "arm.o", "-o", "use", "-lm"], tmp_path)
    said = run(["./use"], tmp_path).splitlines()
    for k, line in enumerate(said):
        status, *joints = line.replace(" back", "").split()
        wanted, known = governor.step(goal, leaf=None if k < 600 else level)
        assert int(status) == known and (" back" in line) == (known is rp.Status.RECOVERING)
        assert np.abs(np.array(joints, float) - wanted).max() < 1e-8
    assert " back" in said[0] and said[-1].startswith("0 ")
    assert np.abs(inverse.leaf(wanted) - level).max() < 1e-9
    library, n = in_c(tmp_path), 3
    limits = (DOUBLE * 10)(*[2.0] * n, *[5.0] * n, *[np.inf] * n, 0.0)
    far, state = (DOUBLE * n)(*q[:2], task.upper[2] + 0.11), ctypes.create_string_buffer(1 << 20)
    assert library.arm_governor_start(state, far, DOUBLE(dt), limits) == rp.Status.LIMIT


URDF_LIMITS = {
    "none": ("", (0.0, np.inf)),
    "some": ('acceleration="6" deceleration="5"', (5.0, np.inf)),
    "both": ('acceleration="6" deceleration="5" jerk="300"', (5.0, 300.0)),
}


class Exported(NamedTuple):
    """An exported control of planar3r in a region, and its library."""

    folder: Path
    inverse: rp.RepeatableInverse
    library: ctypes.CDLL


def exported(name: str, folder: Path) -> Exported:
    """Export and compile it, with some of the limits of URDF 1.2."""
    text = rp.Robot.load("planar3r").description.path.read_text()
    (folder / "arm.urdf").write_text(text.replace("<limit ", f"<limit {URDF_LIMITS[name][0]} "))
    task = rp.Robot.load(folder / "arm.urdf").task("tool", "xy")
    inverse = control(task, Q_PLANAR, rp.Polynomial(Q_PLANAR, 2, 0.5))
    rp.export_c(inverse, folder, "arm", region=rp.Box(Q_PLANAR, 0.3))
    return Exported(folder, inverse, in_c(folder))


@pytest.fixture(scope="module")
def limited(tmp_path_factory: pytest.TempPathFactory) -> Exported:
    return exported("both", tmp_path_factory.mktemp("limited"))


@NEEDS_C
@pytest.mark.parametrize("name", some(URDF_LIMITS, "both"))
def test_the_limits_of_the_urdf_are_those_of_exported_code(
    name: str, limited: Exported, tmp_path: Path
) -> None:
    """Item 26.13: accelerations and jerks of URDF 1.2 were left out of ``arm_governor_limits``."""
    _, expected = URDF_LIMITS[name]
    _, inverse, library = limited if name == "both" else exported(name, tmp_path)
    limits = (DOUBLE * 10)()
    library.arm_governor_limits(limits)
    assert (limits[3], limits[6]) == expected
    state, start = ctypes.create_string_buffer(1 << 20), (DOUBLE * 3)(*Q_PLANAR)
    began = library.arm_governor_start(state, start, DOUBLE(DT), limits)
    assert began == (rp.Status.BAD_NUMBER if name == "none" else rp.Status.OK)
    if name != "none":
        rp.Governor(inverse, DT, rp.Limits())  # the same defaults


@NEEDS_C
def test_wrong_limits_are_refused(limited: Exported) -> None:
    library, q0, n = limited.library, Q_PLANAR, 3
    state = ctypes.create_string_buffer(1 << 20)

    def started(q: np.ndarray = q0, dt: float = DT, **changed: float) -> int:
        limits = (DOUBLE * 10)(*[2.0] * 3, *[5.0] * 3, *[np.inf] * 3, 0.0)
        for key, value in changed.items():
            limits["vaj".index(key) * n if key != "m" else 9] = value
        return int(library.arm_governor_start(state, (DOUBLE * 3)(*q), DOUBLE(dt), limits))

    OK, _, BAD_NUMBER, OUTSIDE, _, LIMIT = range(6)
    assert started() == OK
    assert started(dt=0.0) == started(dt=np.nan) == BAD_NUMBER
    assert started(v=0.0) == started(v=np.inf) == started(a=0.0) == started(a=np.nan) == BAD_NUMBER
    assert started(j=0.0) == started(m=-1.0) == started(q0 * np.nan) == BAD_NUMBER
    assert started(m=10.0) == LIMIT and started(q0 + 0.4) == OUTSIDE


@NEEDS_C
def test_after_a_refused_start_it_holds(limited: Exported) -> None:
    """Issue 37, item 9: it wrote q_next = 0, whatever the limits. Neither does it begin in memory
    that is 0, without a start."""
    (_, inverse, library), q0 = limited, Q_PLANAR
    OK, BAD_NUMBER, OUTSIDE = 0, 2, 3
    limits = (DOUBLE * 10)(*[2.0] * 3, *[5.0] * 3, *[np.inf] * 3, 0.0)
    place = inverse.task.placement(q0)
    target = (DOUBLE * 12)(*place.translation, *place.rotation.ravel())

    def ticked(state: object) -> tuple[int, list[float]]:
        q = (DOUBLE * 3)(7.0, 8.0, 9.0)
        return library.arm_governor_step(state, target, None, None, q), list(q)

    for first in (False, True):
        state = ctypes.create_string_buffer(1 << 20)
        assert ticked(state) == (BAD_NUMBER, [7.0, 8.0, 9.0])
        for q, said in ((q0, OK),) * first + ((q0 * np.nan, BAD_NUMBER), (q0 + 0.4, OUTSIDE)):
            start = (DOUBLE * 3)(*q)
            found = library.arm_governor_start(state, start, DOUBLE(DT), limits)
            assert found == said
            if said != OK:
                assert ticked(state) == (said, [7.0, 8.0, 9.0])
        start = (DOUBLE * 3)(*q0)
        assert library.arm_governor_start(state, start, DOUBLE(DT), limits) == OK
        status, q = ticked(state)
        assert status == OK and np.abs(q - q0).max() < 1e-9


def harness(folder: Path, compiler: str, *flags: str) -> None:
    """Compile the ticks of tests/attack with an exported folder."""
    base = ["-std=c99", "-D_POSIX_C_SOURCE=199309L", "-Wall", "-Wextra", "-Werror"]
    run([compiler, *base, *flags, "arm.c", str(HARNESS), "-I.", "-o", "ticks", "-lm"], folder)


def ticked(folder: Path, count: int, *by: str) -> list[str]:
    """Run them on planar3r, or on the panda."""
    inverse, q0, acceleration, jerk = planar()
    task = inverse.task
    rows = [q0, task.velocity_limit, [acceleration] * 3, [jerk] * 3, task.lower, task.upper]
    numbers = " ".join(f"{value!r}" for part in rows for value in np.asarray(part, float).tolist())
    (folder / "numbers").write_text(f"{numbers} {MARGIN}")
    command = f"{' '.join(by)} ./ticks {count} 1 {DT} 1 < numbers"
    return run(["sh", "-c", command], folder).split()


@pytest.mark.slow
@NEEDS_C
def test_random_ticks_keep_all_limits_and_the_sanitizers_are_silent(tmp_path: Path) -> None:
    needed("gcc")
    rp.export_c(planar()[0], tmp_path, "arm")
    watch = ["-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    harness(tmp_path, "gcc", *watch)
    said = [float(word) for word in ticked(tmp_path, 2500)[:-1]]
    assert max(said[:3]) <= 1 + 1e-9 and max(said[:2]) > 0.9  # v, a, jerk
    assert said[3] >= MARGIN - 1e-9 and said[4] < 1e-9 and said[5] < 1e-6  # margin, leaf, apart
    # arrived; OK, garbage, on the way
    assert said[6] >= 1 and min(said[12], said[14], said[16]) > 0


@NEEDS_C
def test_it_allocates_nothing(limited: Exported) -> None:
    needed("nm")
    undefined = set(re.findall(r"U (\w+)", run(["nm", "-u", "arm.o"], limited.folder)))
    known = {"sin", "cos", "sqrt", "cbrt", "atan2", "ceil", "ldexp", "fabs", "memcpy", "memset"}
    assert undefined <= known | {"_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail", "sincos"}
    code = (limited.folder / "arm.c").read_text()
    assert not re.search(r"^static (?!const|.*\()", code, re.MULTILINE)  # no state of its own


@pytest.mark.slow
@pytest.mark.parametrize("target", ["arm-linux-gnueabihf", "riscv64-linux-gnu"])
def test_other_processors_command_the_same_joints(target: str, tmp_path: Path) -> None:
    """Bit for bit: the sin, cos and atan2 of glibc have other last bits with fused multiply–add, so
    they do without it here where the other processor does."""
    emulator = f"qemu-{target.partition('-')[0]}"
    needed(f"{target}-gcc", emulator, "gcc")
    rp.export_c(planar()[0], tmp_path, "arm")
    harness(tmp_path, "gcc", "-O2")
    names = ("FMA", "FMA4", "AVX2", "FMA_Usable", "FMA4_Usable", "AVX2_Usable")
    plain = f"GLIBC_TUNABLES=glibc.cpu.hwcaps={','.join(f'-{name}' for name in names)}"
    host = ticked(tmp_path, 20_000, *(["env", plain] if target.startswith("arm") else []))
    harness(tmp_path, f"{target}-gcc", "-O2", "-static", "-ffp-contract=off")
    said = ticked(tmp_path, 20_000, emulator)
    assert said[-1] == host[-1]  # checksum of all joints
    assert max(map(float, said[:3])) <= 1 + 1e-9 and float(said[5]) < 1e-6
