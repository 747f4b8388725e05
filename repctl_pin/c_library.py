"""Compilation of generated C to shared libraries, cached by source in a private folder."""

from __future__ import annotations

import atexit
import ctypes
import functools
import hashlib
import os
import platform
import select
import shlex
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from .errors import RepctlError

_FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared")
VECTOR_FLAGS = (
    "-std=c99",
    "-O3",
    "-march=native",
    "-ffp-contract=fast",
    "-fPIC",
    "-shared",
)
"""Flags of the compiler for code that uses the vector units of this machine."""

_COMPILES, _LOADS = 50.0, 10.0
"""Maximum time of the compiler, and of loading its library, s."""

_SAID = 4096
"""Maximum number of bytes kept of a program's stderr."""

_KEY = "repctl_source_key"
_PROBE = f"""
import ctypes, sys
text = ctypes.c_char * 65
made = text.in_dll(ctypes.CDLL(sys.argv[1]), {_KEY!r}).value
sys.exit(made.decode() != sys.argv[2] and "error: the library has another key")
"""
"""Program that loads a library in a separate process, because loading a truncated file crashes."""


class NoCompilerError(RepctlError):
    """No C compiler is installed, or it cannot build a shared library."""


def compiler() -> list[str]:
    """Find the C compiler: ``CC`` if set, else ``cc``, ``gcc`` or ``clang``.

    Raises
    ------
    NoCompilerError
        If there is none.
    """
    try:
        asked = shlex.split(os.environ.get("CC", ""))
    except ValueError as error:
        raise NoCompilerError(f"CC is not a C compiler command: {error}") from None
    for command in [asked] if asked else [["cc"], ["gcc"], ["clang"]]:
        found = shutil.which(command[0])
        if found is not None:
            return [found, *command[1:]]
    tried = f"{_clean(asked[0])!r} (CC)" if asked else "(cc, gcc, clang)"
    raise NoCompilerError(f"no C compiler {tried} is installed")


def _shared_library(code: str, flags: Sequence[str] = _FLAGS) -> Path:
    """Compile C to a shared library, or return the cached one of the same source.

    Files are written under another name and renamed, so that processes can compile at the same
    time. The folder is private to the user, and a file in it is valid only with the checksum beside
    it. If this cache cannot be used, a temporary folder is used instead.

    Raises
    ------
    NoCompilerError
        If there is no compiler, it fails, or its library does not load.
    """
    command = [*compiler(), *flags]
    machine = [platform.machine(), platform.system()]
    machine += [_vector_units()] if "-march=native" in flags else []
    key = hashlib.sha256("\0".join([code, *command, *machine]).encode()).hexdigest()
    keyed = f'{code}\nextern const char {_KEY}[];\nconst char {_KEY}[] = "{key}";\n'
    refused = ""
    for folder in (_cache_folder, _own_folder):
        try:
            library = folder() / f"{key}.so"
            checksum = library.with_suffix(".sha256")
            if not _intact(library, checksum):
                _compile(keyed, command, library, checksum, key)
            return library
        except OSError as error:  # disk full, read-only, not executable, or not a file
            refused = _clean(error)
    raise NoCompilerError(f"no folder can store and load a compiled library: {refused}")


def loaded_library(code: str, flags: Sequence[str] = _FLAGS) -> str:
    """Compile C to a shared library as in :func:`_shared_library`, load it, and return its path.

    Raises
    ------
    NoCompilerError
        If no library can be compiled, or it does not load in this process.
    """
    library = _shared_library(code, flags)
    try:
        made = (ctypes.c_char * 65).in_dll(ctypes.CDLL(str(library)), _KEY).value
    except (OSError, ValueError) as error:
        raise NoCompilerError(
            f"a compiled library does not load: {_clean(error)}; delete {library}"
        ) from None
    if made != library.stem.encode():
        raise NoCompilerError(
            f"a compiled library was replaced by another one; delete {library}"
        )
    return str(library)


def _vector_units() -> str:
    """Describe the processor and its instruction set.

    The description is part of the cache's key, because such a library may not run on another one.
    """
    said = platform.processor()
    with suppress(OSError, UnicodeDecodeError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        words = ("model name", "flags", "Features", "CPU part")
        said += "".join(sorted({line for line in lines if line.startswith(words)}))
    return said


def _intact(library: Path, checksum: Path) -> bool:
    """Test whether a library matches its checksum, and both belong to the user alone."""
    try:
        if not (_ours(library) and _ours(checksum) and checksum.stat().st_size == 64):
            return False
        return (
            checksum.read_text(encoding="ascii")
            == hashlib.sha256(library.read_bytes()).hexdigest()
        )
    except (OSError, UnicodeDecodeError):
        return False


def _ours(file: Path) -> bool:
    """Test whether a path is a regular file of the user that is writable by the user only."""
    status = file.lstat()
    return (
        stat.S_ISREG(status.st_mode)
        and status.st_uid == os.getuid()
        and not status.st_mode & 0o022
    )


def _compile(
    code: str, command: list[str], library: Path, checksum: Path, key: str
) -> None:
    """Compile C to a library, test loading it in another process, and move it to its path."""
    with tempfile.TemporaryDirectory(
        dir=library.parent, prefix=".building-", ignore_cleanup_errors=True
    ) as building:
        source = Path(building) / "control.c"
        built = Path(building) / "control.so"
        digest = Path(building) / "digest"
        source.write_text(code, encoding="ascii", newline="\n")
        failed, said = _run(
            [*command, "-o", str(built), str(source), "-lm"],
            shlex.join(command),
            _COMPILES,
        )
        if failed or not built.is_file() or built.is_symlink():
            raise NoCompilerError(
                f"{_clean(command[0])} could not compile the code: {said or 'no output file'}"
            )
        built.chmod(0o700)
        if sys.executable:
            line = [sys.executable, "-I", "-S", "-c", _PROBE, str(built), key]
            failed, said = _run(
                line, f"loading the library of {shlex.join(command)}", _LOADS
            )
            if failed and "failed to map segment" in said:
                raise OSError(said)  # a folder mounted without execution
            if failed:
                raise NoCompilerError(
                    f"the library of {_clean(command[0])} does not load: {said or 'Python crashed'}"
                )
        digest.write_text(
            hashlib.sha256(built.read_bytes()).hexdigest(), encoding="ascii"
        )
        os.replace(built, library)
        os.replace(digest, checksum)


_hung: set[str] = set()
"""Commands that exceeded their maximum time; they are not run again."""


def _run(line: list[str], name: str, most: float) -> tuple[bool, str]:
    """Run a program and its children for at most ``most`` s.

    Returns whether it failed, and the first error line of its stderr."""
    too_long = f"{_clean(name)} took longer than {most:g} s"
    if name in _hung:
        raise NoCompilerError(f"{too_long} and is not run again")
    try:
        process = subprocess.Popen(
            line,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            env=os.environ | {"LC_ALL": "C"},
            start_new_session=True,  # a separate process group, which can be killed as a whole
        )
    except (OSError, ValueError) as error:
        raise NoCompilerError(
            f"{_clean(name)} cannot be run: {_clean(error)}"
        ) from None
    try:
        said = _first_words(process, time.monotonic() + most)
    except subprocess.TimeoutExpired:
        _hung.add(name)
        raise NoCompilerError(too_long) from None
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    return process.returncode != 0, said


def _first_words(process: subprocess.Popen[bytes], until: float) -> str:
    """Wait for a program and return the first line of its stderr that mentions an error."""
    assert process.stderr is not None
    kept = b""
    with process.stderr as pipe:
        while time.monotonic() < until:
            ended = process.poll() is not None
            if select.select([pipe], [], [], 0.02)[0]:
                said = os.read(pipe.fileno(), 1 << 16)
                kept = (kept + said)[:_SAID]
                if not said:  # end of output
                    process.wait(max(0.0, until - time.monotonic()))
                    break
            elif ended:  # a child process keeps the pipe open
                break
        else:
            raise subprocess.TimeoutExpired(process.args, until)
    lines = [
        line
        for line in map(_clean, kept.decode("utf-8", "replace").splitlines())
        if line
    ]
    return next((line for line in lines if "rror" in line), lines[0] if lines else "")


def _clean(text: object) -> str:
    """Convert a text to one line without control characters."""
    words = " ".join(str(text).split())
    return "".join(c if c.isprintable() else "?" for c in words)[:200]


def _cache_folder() -> Path:
    """Find or create the user's private cache folder; raise OSError if that is not possible."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    try:
        cache = Path(base) if os.path.isabs(base) else Path.home() / ".cache"
    except RuntimeError as error:  # no HOME, and a user unknown to the system
        raise OSError(str(error)) from None
    folder = cache / "repctl_pin" / "compiled"
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    status = folder.lstat()
    if (
        not stat.S_ISDIR(status.st_mode)
        or status.st_uid != os.getuid()
        or status.st_mode & 0o022
    ):
        raise OSError(f"{folder} can be written by others")
    return folder


@functools.cache
def _own_folder() -> Path:
    """Create a temporary folder that is deleted when the process ends."""
    made = tempfile.TemporaryDirectory(prefix="repctl_pin-", ignore_cleanup_errors=True)
    atexit.register(made.cleanup)
    return Path(made.name)
