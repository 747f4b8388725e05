"""C compiled once and kept: a private folder of the user's cache, a file for every source."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import platform
import shlex
import shutil
import stat
import subprocess
import tempfile
from pathlib import Path

from ..errors import RepctlError

FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared")
_PATIENCE = 120.0
"""s that a compiler may take."""


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
    raise NoCompilerError(f"there is no C compiler {f'{asked[0]!r} (CC)' if asked else '(cc, gcc, clang)'} here")


def shared_library(code: str) -> Path:
    """Compile C to a shared library, or take the one that was compiled from the same source before.

    Files are written under another name and renamed, so two processes at once do no harm. The folder is the
    user's alone; a file in it counts only with the checksum that was written beside it.

    Raises
    ------
    NoCompilerError
        If there is no compiler, or it fails.
    """
    command = [*compiler(), *FLAGS]
    folder = _private_folder()
    key = hashlib.sha256("\0".join([code, *command, platform.machine(), platform.system()]).encode()).hexdigest()
    library, checksum = folder / f"{key}.so", folder / f"{key}.sha256"
    if not _intact(library, checksum):
        _compile(code, command, library, checksum)
    return library


def _intact(library: Path, checksum: Path) -> bool:
    """Whether a library is whole, ours, and writable by nobody else."""
    try:
        status = library.lstat()
        ours = stat.S_ISREG(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o022
        return ours and checksum.read_text(encoding="ascii") == hashlib.sha256(library.read_bytes()).hexdigest()
    except (OSError, UnicodeDecodeError):
        return False


def _compile(code: str, command: list[str], library: Path, checksum: Path) -> None:
    with tempfile.TemporaryDirectory(dir=library.parent, prefix=".building-") as building:
        source, built, digest = (Path(building) / name for name in ("control.c", "control.so", "digest"))
        source.write_text(code, encoding="ascii", newline="\n")
        line = [*command, "-o", str(built), str(source), "-lm"]
        try:
            done = subprocess.run(line, capture_output=True, text=True, errors="replace", timeout=_PATIENCE)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise NoCompilerError(f"{command[0]} cannot be run: {error}") from None
        if done.returncode or not built.is_file():
            said = next((text for text in done.stderr.splitlines() if "error" in text), done.stderr.strip()[:200])
            raise NoCompilerError(f"{command[0]} could not compile the control: {said}")
        built.chmod(0o700)
        digest.write_text(hashlib.sha256(built.read_bytes()).hexdigest(), encoding="ascii")
        os.replace(built, library)
        os.replace(digest, checksum)


def _private_folder() -> Path:
    """Find or make the folder, for the user alone; one of this process's own where the cache cannot be used."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    folder = (Path(base) if os.path.isabs(base) else Path.home() / ".cache") / "repctl_pin" / "compiled"
    with contextlib.suppress(OSError, RuntimeError):
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        status = folder.lstat()
        if stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o022:
            with tempfile.TemporaryFile(dir=folder):
                return folder
    return Path(_own_folder().name)


@functools.cache
def _own_folder() -> tempfile.TemporaryDirectory[str]:
    """A folder that goes when the process ends."""
    return tempfile.TemporaryDirectory(prefix="repctl_pin-")
