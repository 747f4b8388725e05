"""Files written whole or not at all, and read only where they are files and of a size that is
meant."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from .errors import InputError


def check_folder(folder: Path, *, make: bool = False) -> Path:
    """Make sure that files can be written into a folder, before any long work; one that is not
    there may be made.

    Raises
    ------
    InputError
        If it cannot be made or written.
    """
    try:
        if make:
            folder.mkdir(parents=True, exist_ok=True)
        there = next((part for part in (folder, *folder.parents) if part.exists()), Path())
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise InputError(
            f"cannot write into {folder}: {error.strerror}; choose another folder"
        ) from None
    return folder


def prepare_folder(folder: Path) -> Path:
    """Make a folder where it is not there, and make sure that files can be written into it."""
    return check_folder(folder, make=True)


@contextlib.contextmanager
def not_left_empty(folder: Path) -> Iterator[Path]:
    """Leave no empty folder behind: what is made on the way to it, and holds nothing in the end,
    goes again."""
    missing = [part for part in (folder, *folder.parents) if not part.exists()]
    try:
        yield folder
    finally:
        for part in missing:
            with contextlib.suppress(OSError):  # it is not there, or holds something
                part.rmdir()


@contextlib.contextmanager
def written_together(folder: Path) -> Iterator[Path]:
    """Give an empty folder to write files into; at the end all of them replace those in ``folder``,
    or none do.

    They are moved at once, and one process at a time moves: a folder never holds files of two runs.
    After an exception the files in ``folder`` are as they were.

    Raises
    ------
    InputError
        If the folder cannot be written, or a file would replace a folder.
    """
    prepare_folder(folder)
    staged = Path(tempfile.mkdtemp(prefix=".repctl-", dir=folder))
    try:
        yield staged
        moves = [(file, _target_in(folder, file.name)) for file in sorted(staged.iterdir())]
        with _one_at_a_time(folder):
            for file, target in moves:
                _move(file, target)
    finally:
        shutil.rmtree(staged, ignore_errors=True)


def _target_in(folder: Path, name: str) -> Path:
    try:
        return _target(folder / name)
    except (OSError, ValueError) as error:
        raise InputError(f"cannot write {folder / name}: {error}") from None


def _move(file: Path, target: Path) -> None:
    """Rename a file that is whole already; where that cannot be done, write the other anew."""
    old = target.stat() if target.exists() else None
    try:
        if old is None or stat.S_ISREG(old.st_mode):
            if old is not None:
                os.chmod(file, stat.S_IMODE(old.st_mode))
            os.replace(file, target)
            return
    except OSError:  # on another disk
        pass
    write_whole(target, file.read_bytes())


@contextlib.contextmanager
def _one_at_a_time(folder: Path) -> Iterator[None]:
    """Wait for other processes that move files into a folder; not where folders cannot be
    locked."""
    try:
        import fcntl

        handle = os.open(folder, os.O_RDONLY)
    except (ImportError, OSError):
        yield
        return
    try:
        with contextlib.suppress(OSError):  # a disk without locks
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def write_whole(path: str | Path, content: str | bytes) -> Path:
    """Write a file through a temporary one beside it and a rename: a reader sees the old or the
    new, never half.

    A link is followed, and what it leads to is replaced. A device or a pipe is written through,
    never replaced.

    Parameters
    ----------
    path
        The file.
    content
        What to write; text as UTF-8.

    Returns
    -------
    Path
        The file that was written: where a link leads.

    Raises
    ------
    InputError
        If it is a folder, or cannot be written (permission, full disk); an old file stays as it
        was.
    """
    data = content.encode("utf-8", "replace") if isinstance(content, str) else content
    try:
        target = _target(path)
        old = target.stat() if target.exists() else None
        if old is None or stat.S_ISREG(old.st_mode):
            _replace(target, data, old)
        else:
            with open(os.open(target, os.O_WRONLY | os.O_NOCTTY), "wb") as through:
                through.write(data)
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL
        raise InputError(
            f"cannot write {path}: {getattr(error, 'strerror', None) or error}"
        ) from None
    return target


def read_whole(path: str | Path, largest: int) -> str:
    """Read a text file of at most so many bytes; nothing but a regular file is opened.

    Raises
    ------
    InputError
        If it is no such file, too large, cannot be read, or is no UTF-8.
    """
    try:
        mode, data = os.stat(path).st_mode, b""
        if stat.S_ISREG(mode):
            with open(
                os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb"
            ) as file:  # were it a pipe by now: no waiting
                mode, data = os.fstat(file.fileno()).st_mode, file.read(largest + 1)
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL
        raise InputError(
            f"cannot read {path}: {getattr(error, 'strerror', None) or error}"
        ) from None
    if not stat.S_ISREG(mode):
        what = "a folder" if stat.S_ISDIR(mode) else "a device or a pipe, where a file is wanted"
        raise InputError(f"cannot read {path}: it is {what}")
    if len(data) > largest:
        raise InputError(f"cannot read {path}: it is larger than {largest / 1e6:g} MB")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"cannot read {path}: it is not a text file (UTF-8)") from None


def _target(path: str | Path) -> Path:
    """Find what is to be written: where a link leads."""
    if not str(path):
        raise ValueError("it is no file name")
    target = Path(path)
    if target.is_symlink():
        target = Path(os.path.realpath(target))
    if target.is_dir():
        raise ValueError("it is a folder; give a file name")
    return target


def _replace(target: Path, data: bytes, old: os.stat_result | None) -> None:
    """Write a temporary file beside the target, under an unpredictable name, and rename it."""
    temporary = target.with_name(f".repctl-{secrets.token_hex(8)}")
    try:  # from here on: a signal may come before the file's handle is known
        handle = os.open(
            temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0), 0o666
        )
        with open(handle, "wb") as file:
            if old is not None:
                with contextlib.suppress(OSError):
                    os.chmod(temporary, stat.S_IMODE(old.st_mode))
            file.write(data)
            file.flush()
            os.fsync(handle)
        os.replace(temporary, target)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise
    with contextlib.suppress(
        OSError
    ):  # make the rename itself outlast a power cut, where the system can
        folder = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
