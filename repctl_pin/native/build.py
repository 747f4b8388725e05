"""Build the native library of this folder: ``python repctl_pin/native/build.py``.

Installing the package does the same. After a change of the C code, run this file or install again.
The compiler is ``CC`` if set, else ``cc``, ``gcc`` or ``clang``, else the one in the package
ziglang. ``REPCTL_TARGET`` names a machine for which ziglang builds, such as
``aarch64-linux-gnu.2.17``.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
LIBRARY = FOLDER / "librepctl.so.1"
"""File of the library. Python would take a file whose name ends with ``.so`` for a module."""

_FLAGS = ("-std=c99", "-ffp-contract=off", "-fPIC", "-fvisibility=hidden")
"""Without fused multiply-add, every compiler and processor computes the same numbers."""

_SPEEDS = {
    "-O3": ("arm.c", "body_guard.c", "governor.c", "law.c", "least_speed.c"),
    "-O1": ("arm_angle.c", "cell_bounds.c"),
}
"""Files of the control loops, and files whose loops are written out as vectors; the others are
compiled with -O2. They would run no faster with -O3, and the vectors no faster with -O2, but each
step doubles the compiler's time. The bounds of leaf margins take 2.5 times as long with -O1."""

_DIGEST = b"repctl-sources-"
"""Text in the library file before two digests: of its sources, and of its build commands."""

_LEVELS = {"plain": "", "avx2": "-mavx2", "avx512": "-mavx512f -mavx512dq"}
"""Levels of vector instructions of x86-64, lowest first. Processors made since 2013 have AVX2."""

_LEVELLED = ("cell_bounds.c", "arm_angle.c", "function.c")
"""Files that are compiled once per level, without the inlining of large functions, which takes half
of the compiler's time and makes them no faster."""

_SECONDS = 300
"""Maximum time of one run of the compiler."""


class NoCompilerError(Exception):
    """No C compiler works; the message has the compiler's output, or the compilers tried."""


def target() -> str:
    """Name the machine that the library is built for, as zig does: ``x86_64-linux-gnu.2.17``.

    It is ``REPCTL_TARGET``, if that is set, else this machine.
    """
    machine = {"arm64": "aarch64", "AMD64": "x86_64"}
    here = machine.get(platform.machine(), platform.machine())
    system = "macos.11.0" if sys.platform == "darwin" else "linux-gnu.2.17"
    return os.environ.get("REPCTL_TARGET") or f"{here}-{system}"


def compiler(zig: bool = True) -> list[str]:
    """Find a C compiler that makes shared libraries; return the start of its command line.

    Parameters
    ----------
    zig
        False to leave out the compiler of the package ziglang.

    Raises
    ------
    NoCompilerError
        If no compiler works.
    """
    found = [["cc"], ["gcc"], ["clang"]]
    if "REPCTL_TARGET" in os.environ:
        found = []
    elif os.environ.get("CC"):
        found = [shlex.split(os.environ["CC"])]
    for command in found:
        if shutil.which(command[0]) and _works(command):
            return command
    if zig and importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc", "-s", "-target", target()]
    tried = ", ".join(shlex.join(command) for command in found)
    if not found:
        raise NoCompilerError(
            "REPCTL_TARGET requires ziglang, which is not installed; run `pip install ziglang`"
        )
    raise NoCompilerError(
        f"no C compiler works (tried {tried}); run `pip install ziglang`, or set CC to a compiler"
    )


def _works(command: list[str]) -> bool:
    """Test a compiler on a small file that needs the C library's headers: True if it compiles.

    A command ``cc`` may exist without these headers, and would fail only in the middle of a build.
    """
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "test.c"
        source.write_text("#include <math.h>\ndouble f(double x) { return sin(x); }\n")
        try:
            _run([*command, *_FLAGS, "-shared", "test.c", "-o", "test.so"], folder)
        except NoCompilerError:
            return False
    return True


def _run(line: list[str], folder: str) -> None:
    """Run a compiler's command line in a folder, which also holds the caches of zig.

    NoCompilerError, with the compiler's output, is raised if the command fails or takes more than
    300 s.
    """
    zig = {f"ZIG_{which}_CACHE_DIR": f"{folder}/zig" for which in ("LOCAL", "GLOBAL")}
    try:
        subprocess.run(
            line,
            cwd=folder,
            env=zig | {"MACOSX_DEPLOYMENT_TARGET": "11.0"} | os.environ,
            check=True,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_SECONDS,
        )
    except subprocess.CalledProcessError as error:
        raise NoCompilerError(f"{shlex.join(line)}:\n{error.stderr}") from None
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NoCompilerError(str(error)) from None


def _speed(name: str) -> str:
    """Return the optimisation option for a C file: that of ``_SPEEDS``, else ``-O2``."""
    return next((speed for speed, names in _SPEEDS.items() if name in names), "-O2")


def _levels(command: list[str]) -> list[str]:
    """List the levels of vector instructions to build: names in ``_LEVELS``, lowest first.

    On x86-64, they are the levels of this machine. All levels are built if ``REPCTL_TARGET`` is
    set, or if the compiler does not tell which ones this machine has. Other processors have the
    level ``plain`` only.
    """
    if not target().startswith("x86_64"):
        return ["plain"]
    if "REPCTL_TARGET" in os.environ:
        return list(_LEVELS)
    line = [*command, "-march=native", "-dM", "-E", "-x", "c", os.devnull]
    macros = subprocess.run(line, capture_output=True, text=True, errors="replace", check=False)
    if macros.returncode != 0:
        return list(_LEVELS)
    has = {"plain": True, "avx2": "__AVX2__" in macros.stdout}
    has["avx512"] = "__AVX512F__" in macros.stdout and "__AVX512DQ__" in macros.stdout
    return [level for level in _LEVELS if has[level]]


def _compiler_lines(command: list[str]) -> list[list[str]]:
    """List the command lines that compile the C files, each of which ends with its object file."""
    levels = _levels(command)
    lines = []
    for source in sorted(FOLDER.glob("*.c")):
        for level in levels if source.name in _LEVELLED else ["plain"]:
            flags = [_speed(source.name), *_FLAGS, "-w", f"-DLEVEL={level}"]
            flags += [f"-DHIGHEST={levels[-1].upper()}", *_LEVELS[level].split()]
            if source.name in _LEVELLED:
                flags.append("-fno-inline-functions-called-once")
            lines.append([*command, *flags, "-c", str(source), "-o", f"{source.stem}-{level}.o"])
    return lines


def build(library: Path = LIBRARY) -> bool:
    """Compile the C files of this folder, in parallel, and link the library.

    On x86-64, files with long loops are compiled several times: for processors without AVX2, with
    it, and with AVX-512, as far as this machine has them. ``REPCTL_TARGET`` builds all levels.
    Nothing is compiled if the same sources have already been built by the same command lines, at
    ``library`` or in this folder: that file is then kept or copied.

    Parameters
    ----------
    library
        File to write; a finished library replaces it in one step.

    Returns
    -------
    bool
        False if nothing was compiled.

    Raises
    ------
    NoCompilerError
        If no compiler works.
    """
    command = compiler()
    lines = _compiler_lines(command)
    objects = [line[-1] for line in lines]
    digest = _digest(command, lines)
    for found in (library, LIBRARY):
        if found.exists() and digest in found.read_bytes():
            if found != library:
                shutil.copyfile(found, library)
            library.touch()  # it is as new as its sources
            return False
    with tempfile.TemporaryDirectory() as folder:
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(_run, lines, [folder] * len(lines)))
        kept = '__attribute__((visibility("default")))'
        sources = f'{kept} const char repctl_sources[] = "{digest.decode()}";\n'
        (Path(folder) / "sources.c").write_text(sources)
        link = [*command, *_FLAGS, "-shared", *objects, "sources.c", "-o", "librepctl.so.1", "-lm"]
        _run(link, folder)
        draft = library.with_name(f"{library.name}.{os.getpid()}")
        shutil.copyfile(Path(folder) / "librepctl.so.1", draft)
        draft.replace(library)  # a running process keeps the old file
    return True


def mark() -> bytes:
    """Return the bytes that a library contains if it was built from the sources in this folder.

    They are a fixed text and a hash of the C files. The structs of any other library can differ
    from those that Python fills.
    """
    files = sorted(FOLDER.glob("*.[ch]"))
    return _DIGEST + _hash([file.read_bytes() for file in files]) + b"-"


def _digest(command: list[str], lines: list[list[str]]) -> bytes:
    """Return the bytes that a library contains if it was built here by these command lines.

    They are a fixed text, a hash of the C files, and a hash of the version of the compiler
    ``command`` and of ``lines``, one command line per object file. A copy of this folder gives the
    same bytes.
    """
    version = subprocess.run([*command, "--version"], capture_output=True, check=False).stdout
    texts = [" ".join(line).replace(f"{FOLDER}{os.sep}", "").encode() for line in lines]
    return mark() + _hash([version, *texts])


def _hash(texts: list[bytes]) -> bytes:
    """Hash a list of texts; ``["ab", "c"]`` and ``["a", "bc"]`` have different hashes."""
    known = hashlib.sha256()
    for text in texts:
        known.update(hashlib.sha256(text).digest())
    return known.hexdigest().encode()


if __name__ == "__main__":
    print(LIBRARY if build() else f"{LIBRARY} is unchanged")
