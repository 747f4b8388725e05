"""The native library: it is built when the package is installed, and its absence is said once."""

from __future__ import annotations

import os
import platform
import runpy
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from controls import NEEDS_C, c_compiler

import repctl_pin as rp

ROOT = Path(__file__).parents[2]
NATIVE = ROOT / "repctl_pin" / "native"
BUILD = "python repctl_pin/native/build.py"


def run(folder: Path, *words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Design and follow with the planar arm in another process, then prove twice, with the package
    in a folder."""
    code = """
import warnings
import repctl_pin as rp
task = rp.Robot.load("planar3r").task("tool", "xy")
q0 = [0.3, 0.8, 0.8]
few = rp.FitOptions(samples=64, held_out=64)
bases = rp.Polynomial(q0, 2, 0.5), rp.Box(q0, 0.1)
design = rp.nearest_repeatable(rp.Pseudoinverse(task), *bases, options=few)
motion = rp.follow(design.inverse, rp.circle(task, q0, 0.03), q0, cycles=2)
print(f"{design.cost:.9f} {motion.rms_speed:.9f} {motion.drift[-1] < 1e-9}")
for margin in (0.3, 0.4):
    try:
        print("proved", bool(rp.prove(design, margin=margin)))
    except rp.InputError as error:
        print("refused", error)
"""
    return subprocess.run(
        [sys.executable, *words, "-c", code],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder)} | environment,
        capture_output=True,
        text=True,
    )


def refused(cause: str, usual: subprocess.CompletedProcess[str]) -> str:
    """Write the output without a library: the same numbers, and two proofs that are refused."""
    numbers, *proofs = usual.stdout.splitlines(keepends=True)
    assert proofs == ["proved True\n"] * 2
    return numbers + f"refused a proof requires the native library, which {cause}\n" * 2


def copied(folder: Path) -> None:
    """Copy the package without its library."""
    shutil.copytree(
        ROOT / "repctl_pin", folder / "repctl_pin", ignore=shutil.ignore_patterns("*.so.1")
    )
    (folder / "repctl_pin" / "model" / "files").symlink_to(ROOT / "urdf")


@pytest.fixture(scope="module")
def usual() -> subprocess.CompletedProcess[str]:
    """The output with the library, without a warning."""
    return run(ROOT, "-W", "error::UserWarning")


@NEEDS_C
def test_where_there_is_a_compiler_the_library_is_there_and_not_older_than_its_sources() -> None:
    """Issue 38, item 2."""
    library = NATIVE / "librepctl.so.1"
    assert library.exists(), f"the native library is not built; run `{BUILD}`"
    newest = max(NATIVE.glob("*.[ch]"), key=lambda file: file.stat().st_mtime)
    assert library.stat().st_mtime >= newest.stat().st_mtime, (
        f"{newest.name} is newer than the library; run `{BUILD}`"
    )


REMEDY = "install a C compiler (cc, gcc or clang), then install repctl_pin again"


@pytest.mark.slow
def test_without_the_library_numpy_runs_and_one_warning_says_why(
    tmp_path: Path, usual: subprocess.CompletedProcess[str]
) -> None:
    """Issue 38, item 2: installed where neither a compiler nor ziglang could be had."""
    copied(tmp_path)
    without = run(tmp_path)
    assert without.stdout == refused(f"is missing; {REMEDY}", usual)
    said = without.stderr
    assert said.count("no native library: repctl_pin was installed without a C") == 1
    assert REMEDY in said and without.returncode == 0


@pytest.mark.slow
def test_a_library_that_does_not_load_is_one_warning(
    tmp_path: Path, usual: subprocess.CompletedProcess[str]
) -> None:
    """It is there, so what is refused does not say that it is missing."""
    copied(tmp_path)
    (tmp_path / "repctl_pin" / "native" / "librepctl.so.1").write_bytes(b"\x7fELF")
    said = run(tmp_path)
    assert said.returncode == 0 and said.stderr.count("it does not load (") == 1
    remedy = f"run `{BUILD}`, or install repctl_pin again"
    assert said.stdout == refused(f"does not load; {remedy}", usual) and remedy in said.stderr


@pytest.mark.slow
def test_a_library_of_other_sources_is_one_line_not_a_crash(
    tmp_path: Path, usual: subprocess.CompletedProcess[str]
) -> None:
    """Issue 56: a checkout's structs had changed, and the library of before crashed Python."""
    copied(tmp_path)
    native = tmp_path / "repctl_pin" / "native"
    shutil.copy(NATIVE / "librepctl.so.1", native)
    header = native / "arm.h"
    header.write_text(header.read_text().replace("int n, ", "int first, n, "))
    found = run(tmp_path)
    remedy = f"run `{BUILD}`, or install repctl_pin again"
    assert found.stdout == refused(f"was built from other sources; {remedy}", usual)
    assert found.stderr.count("it was built from other sources than those beside it") == 1
    assert remedy in found.stderr and found.returncode == 0


@pytest.mark.slow
def test_the_library_is_switched_off_without_a_word(
    usual: subprocess.CompletedProcess[str],
) -> None:
    off = run(ROOT, "-W", "error::UserWarning", REPCTL_NATIVE="no")
    assert off.returncode == 0 and not off.stderr
    assert off.stdout == refused("is switched off; unset REPCTL_NATIVE", usual)


def test_a_motion_is_the_same_without_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q0 = np.array([0.3, 0.8, 0.8])
    path = rp.circle(task, q0, radius=0.1)
    native = rp.follow(rp.Pseudoinverse(task), path, q0, cycles=2)
    monkeypatch.setenv("REPCTL_NATIVE", "no")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plain = rp.follow(rp.Pseudoinverse(task), path, q0, cycles=2)
    np.testing.assert_allclose(native.q, plain.q, atol=1e-12)


@pytest.mark.slow
@NEEDS_C
def test_the_library_needs_no_compiler_at_run_time() -> None:
    found = run(ROOT, "-W", "error::UserWarning", CC="no-such-compiler", PATH="")
    assert found.returncode == 0, found.stderr


@pytest.mark.parametrize(
    ("compiler", "index", "asked"),
    [
        ("cc", "", []),
        ("no-such-compiler", "--find-links={wheels}", ["ziglang"]),
        ("no-such-compiler", "", []),
    ],
)
def test_the_build_asks_for_ziglang_only_without_a_compiler_and_where_it_can_be_had(
    compiler: str, index: str, asked: list[str], tmp_path: Path
) -> None:
    """Issue 38, item 2: an installation never fails for want of a compiler."""
    pytest.importorskip("hatchling")
    if not asked:  # an environment of uv has no pip to ask
        pytest.importorskip("pip")
    if compiler == "cc" and c_compiler() is None:
        pytest.skip("there is no C compiler")
    name = "ziglang-0.16.0-py3-none-any.whl"
    subprocess.run(  # an empty wheel
        [sys.executable, "-m", "zipfile", "-c", str(tmp_path / name), __file__], check=True
    )
    code = "import hatch_build; print(hatch_build.needed())"
    options = ["--no-index", *([index.format(wheels=tmp_path)] if index else [])]
    asking = [sys.executable, "-c", code]
    frontend = "import subprocess, sys; subprocess.run(sys.argv[1:4], check=True)"
    # no index of the machine's own settings
    plain = {name: value for name, value in os.environ.items() if not name.startswith("PIP_")}
    answer = subprocess.run(
        [sys.executable, "-c", frontend, *asking, *options],
        cwd=ROOT,
        env=plain | {"CC": compiler},
        capture_output=True,
        text=True,
        check=True,
    )
    assert answer.stdout.strip() == str(asked)


@pytest.mark.slow
@NEEDS_C
def test_an_unchanged_library_is_not_built_again(tmp_path: Path) -> None:
    """Issue 56, item 32.4: neither in its folder, nor for a wheel; a changed source builds it."""
    native = tmp_path / "native"
    shutil.copytree(NATIVE, native, ignore=shutil.ignore_patterns("*.so.1", "*.py", "__pycache__"))
    shutil.copy(NATIVE / "build.py", native)
    for source in native.glob("*.c"):
        source.write_text(f"static int {source.stem};\n")
    build = runpy.run_path(str(native / "build.py"))["build"]
    library, wheel = native / "librepctl.so.1", tmp_path / "librepctl.so.1"
    assert build(library)
    first = library.stat().st_ino  # a build makes a new file
    assert not build(library) and library.stat().st_ino == first
    assert not build(wheel) and wheel.read_bytes() == library.read_bytes()
    (native / "arm.c").write_text("int g;\n")
    assert build(wheel) and wheel.read_bytes() != library.read_bytes()
    library.write_bytes(library.read_bytes()[:100])
    assert build(library)


@pytest.mark.parametrize(
    ("macros", "target", "levels"),
    [
        ("", "", ["plain"]),
        ("__AVX2__", "", ["plain", "avx2"]),
        ("__AVX2__ __AVX512F__", "", ["plain", "avx2"]),
        ("__AVX2__ __AVX512F__ __AVX512DQ__", "", ["plain", "avx2", "avx512"]),
        ("__AVX2__", "x86_64-linux-gnu.2.17", ["plain", "avx2", "avx512"]),
        ("__AVX2__", "aarch64-linux-gnu.2.17", ["plain"]),
        (None, "", ["plain", "avx2", "avx512"]),
    ],
)
def test_a_library_has_the_vector_levels_of_its_machine_and_a_wheel_for_others_all(
    macros: str | None, target: str, levels: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A compiler that knows no ``-march=native`` (None) does not tell: then all are built."""
    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    monkeypatch.delenv("REPCTL_TARGET", raising=False)
    if target:
        monkeypatch.setenv("REPCTL_TARGET", target)
    compiler = f"import sys; print({macros!r}); sys.exit({int(macros is None)})"
    build = runpy.run_path(str(NATIVE / "build.py"))
    assert build["_levels"]([sys.executable, "-c", compiler]) == levels


@pytest.mark.slow
@NEEDS_C
@pytest.mark.parametrize("highest", ["plain", "avx2", "avx512"])
def test_a_library_with_fewer_vector_levels_computes_the_same_bits(
    highest: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A processor that has more runs the highest level, one that has less a lower level."""
    if platform.machine() != "x86_64":
        pytest.skip("vector levels are those of x86-64")
    build = runpy.run_path(str(NATIVE / "build.py"))
    names = list(build["_LEVELS"])
    levels = names[: names.index(highest) + 1]
    monkeypatch.setitem(build["build"].__globals__, "_levels", lambda command: levels)
    copied(tmp_path)
    build["build"](tmp_path / "repctl_pin" / "native" / "librepctl.so.1")
    code = """
import numpy as np, repctl_pin as rp
task, q0 = rp.Robot.load("planar3r").task("tool", "xy"), np.array([0.3, 0.8, 0.8])
cell, few = rp.Cell(task, task.placement(q0), 0.05), rp.FitOptions(held_out=64)
found = rp.nearest_inverse_function(rp.Pseudoinverse(task), cell, posture=q0, options=few)
print(found.function.batch(cell.sample(100)).tobytes().hex(), rp.prove(found))
"""
    line = [sys.executable, "-W", "error::UserWarning", "-c", code]
    usual, other = (
        subprocess.run(
            line,
            env=os.environ | {"PYTHONPATH": str(folder)},
            cwd=folder,
            check=True,
            capture_output=True,
        )
        for folder in (ROOT, tmp_path)
    )
    assert b"proved" in usual.stdout and other.stdout == usual.stdout
