"""C compiled once and kept: a private folder of the user's cache, a file for every source."""

from __future__ import annotations

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
from pathlib import Path

from .errors import RepctlError

FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared")
_COMPILES, _LOADS = 50.0, 10.0
"""Time, s, that a compiler may take, and the load of what it made."""

_SAID = 4096
"""Bytes of a program's stderr that are kept."""

_KEY = "repctl_source_key"
_PROBE = f"""
import ctypes, sys
text = ctypes.c_char * 65
made = text.in_dll(ctypes.CDLL(sys.argv[1]), {_KEY!r}).value
sys.exit(made.decode() != sys.argv[2] and "error: it is another library")
"""
"""Python that loads a library in a process of its own: a file cut short ends the process that loads
it."""


class NoCompilerError(RepctlError):
    """There is no C compiler on this machine, or it cannot build a shared library."""


def compiler() -> list[str]:
    """Find the C compiler: what ``CC`` says, else ``cc``, ``gcc`` or ``clang``.

    Raises
    ------
    NoCompilerError
        If there is none.
    """
    try:
        asked = shlex.split(os.environ.get("CC", ""))
    except ValueError as error:
        raise NoCompilerError(f"CC names no C compiler: {error}") from None
    for command in [asked] if asked else [["cc"], ["gcc"], ["clang"]]:
        found = shutil.which(command[0])
        if found is not None:
            return [found, *command[1:]]
    raise NoCompilerError(
        f"there is no C compiler {f'{_clean(asked[0])!r} (CC)' if asked else '(cc, gcc, clang)'} here"
    )


def shared_library(code: str) -> Path:
    """Compile C to a shared library that loads, or take the one that was compiled from the same
    source before.

    Files are written under another name and renamed, so two processes at once do no harm. The
    folder is the user's alone; a file in it counts only with the checksum that was written beside
    it. Where the cache cannot be used, a temporary folder serves.

    Raises
    ------
    NoCompilerError
        If there is no compiler, it fails, or what it makes does not load here.
    """
    command = [*compiler(), *FLAGS]
    key = hashlib.sha256(
        "\0".join([code, *command, platform.machine(), platform.system()]).encode()
    ).hexdigest()
    keyed = f'{code}\nextern const char {_KEY}[];\nconst char {_KEY}[] = "{key}";\n'
    refused = ""
    for folder in (_cache_folder, _own_folder):
        try:
            return _kept(keyed, command, folder(), key)
        except OSError as error:  # full, read-only, not executable, or a folder in a file's place
            refused = _clean(error)
    raise NoCompilerError(f"a compiled control can be kept and loaded nowhere: {refused}")


def loaded_library(code: str) -> str:
    """Compile C to a shared library, as :func:`shared_library` does, and load it: its path.

    Raises
    ------
    NoCompilerError
        If there is none, or it does not load in this process.
    """
    library = shared_library(code)
    try:
        made = (ctypes.c_char * 65).in_dll(ctypes.CDLL(str(library)), _KEY).value
    except (OSError, ValueError) as error:
        raise NoCompilerError(
            f"a compiled control does not load: {_clean(error)}; delete {library}"
        ) from None
    if made != library.stem.encode():
        raise NoCompilerError(
            f"another library stands in the place of a compiled control; delete {library}"
        )
    return str(library)


def _kept(code: str, command: list[str], folder: Path, key: str) -> Path:
    """Take the library from a folder, or compile it there; OSError where that folder cannot
    serve."""
    library, checksum = folder / f"{key}.so", folder / f"{key}.sha256"
    if not _intact(library, checksum):
        _compile(code, command, library, checksum, key)
    return library


def _intact(library: Path, checksum: Path) -> bool:
    """Whether a library is whole, ours, and writable by nobody else."""
    try:
        if not (_ours(library) and _ours(checksum) and checksum.stat().st_size == 64):
            return False
        return (
            checksum.read_text(encoding="ascii") == hashlib.sha256(library.read_bytes()).hexdigest()
        )
    except (OSError, UnicodeDecodeError):
        return False


def _ours(file: Path) -> bool:
    """Whether it is a plain file that the user owns and nobody else can write."""
    status = file.lstat()
    return (
        stat.S_ISREG(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o022
    )


def _compile(code: str, command: list[str], library: Path, checksum: Path, key: str) -> None:
    """Compile, load in another process, and put in place."""
    with tempfile.TemporaryDirectory(
        dir=library.parent, prefix=".building-", ignore_cleanup_errors=True
    ) as building:
        source, built, digest = (
            Path(building) / name for name in ("control.c", "control.so", "digest")
        )
        source.write_text(code, encoding="ascii", newline="\n")
        failed, said = _run(
            [*command, "-o", str(built), str(source), "-lm"], shlex.join(command), _COMPILES
        )
        if failed or not built.is_file() or built.is_symlink():
            raise NoCompilerError(
                f"{_clean(command[0])} could not compile the control: {said or 'it made no file'}"
            )
        built.chmod(0o700)
        if sys.executable:
            line = [sys.executable, "-I", "-S", "-c", _PROBE, str(built), key]
            failed, said = _run(line, f"loading what {shlex.join(command)} made", _LOADS)
            if failed and "failed to map segment" in said:
                raise OSError(said)  # a folder from which nothing can be run
            if failed:
                raise NoCompilerError(
                    f"what {_clean(command[0])} made does not load here: {said or 'it ended Python'}"
                )
        digest.write_text(hashlib.sha256(built.read_bytes()).hexdigest(), encoding="ascii")
        os.replace(built, library)
        os.replace(digest, checksum)


_hung: set[str] = set()
"""Commands that took longer than they may: they are not asked again."""


def _run(line: list[str], name: str, most: float) -> tuple[bool, str]:
    """Run a program and all that it starts for a limited time, s: whether it failed, and its first
    words on stderr."""
    too_long = f"{_clean(name)} took longer than {most:g} s"
    if name in _hung:
        raise NoCompilerError(f"{too_long}, and is not asked again")
    try:
        process = subprocess.Popen(
            line,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            env=os.environ | {"LC_ALL": "C"},
            start_new_session=True,  # a group of its own, which is ended as a whole
        )
    except (OSError, ValueError) as error:
        raise NoCompilerError(f"{_clean(name)} cannot be run: {_clean(error)}") from None
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
    """Wait for a program, read all that it says, and keep the beginning: the first line that tells
    of an error."""
    assert process.stderr is not None
    kept = b""
    with process.stderr as pipe:
        while time.monotonic() < until:
            ended = process.poll() is not None
            if select.select([pipe], [], [], 0.02)[0]:
                said = os.read(pipe.fileno(), 1 << 16)
                kept = (kept + said)[:_SAID]
                if not said:  # it says no more
                    process.wait(max(0.0, until - time.monotonic()))
                    break
            elif ended:  # what it started holds the pipe still
                break
        else:
            raise subprocess.TimeoutExpired(process.args, until)
    lines = [line for line in map(_clean, kept.decode("utf-8", "replace").splitlines()) if line]
    return next((line for line in lines if "rror" in line), lines[0] if lines else "")


def _clean(text: object) -> str:
    """One line of a foreign text, without control characters."""
    words = " ".join(str(text).split())
    return "".join(c if c.isprintable() else "?" for c in words)[:200]


def _cache_folder() -> Path:
    """Find or make the folder of the user's cache, for the user alone; OSError where there is
    none."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    try:
        cache = Path(base) if os.path.isabs(base) else Path.home() / ".cache"
    except RuntimeError as error:  # no HOME, and a user whom the system does not know
        raise OSError(str(error)) from None
    folder = cache / "repctl_pin" / "compiled"
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & 0o022:
        raise OSError(f"{folder} can be written by others")
    return folder


def _own_folder() -> Path:
    """Find or make a temporary folder of this process."""
    return Path(_temporary().name)


@functools.cache
def _temporary() -> tempfile.TemporaryDirectory[str]:
    """A folder that goes when the process ends."""
    return tempfile.TemporaryDirectory(prefix="repctl_pin-", ignore_cleanup_errors=True)
