"""Atomic writing of files, and reading of regular files up to a maximum size.

Atomic means that the new file replaces the old one in one operation: an interrupted run leaves no
incomplete file.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from .errors import InputError


def check_folder(folder: Path, *, make: bool = False) -> Path:
    """Check that files can be written into a folder; return it. With ``make``, create it first.

    Without ``make``, the folder may be missing: its nearest existing parent is then checked.

    Raises
    ------
    InputError
        If the folder cannot be created or written to.
    """
    try:
        if make:
            folder.mkdir(parents=True, exist_ok=True)
        there = next((part for part in (folder, *folder.parents) if os.path.lexists(part)), Path())
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise InputError(
            f"cannot write into {folder}: {error.strerror}; choose another folder"
        ) from None
    return folder


def prepare_folder(folder: Path) -> Path:
    """Create a folder if it is missing, check that files can be written into it, and return it.

    Call this before a long computation, so that the result can be saved. InputError is raised if
    the folder cannot be created or written to.
    """
    return check_folder(folder, make=True)


@contextlib.contextmanager
def not_left_empty(folder: Path) -> Iterator[Path]:
    """Context manager that at its end removes ``folder`` if the block created it and it is empty.

    The same holds for its parents. So a command that fails before it writes leaves no empty
    folders. The block receives ``folder``.
    """
    missing = [part for part in (folder, *folder.parents) if not part.exists()]
    try:
        yield folder
    finally:
        for part in missing:
            with contextlib.suppress(OSError):  # missing or not empty
                part.rmdir()


@contextlib.contextmanager
def written_together(folder: Path) -> Iterator[Path]:
    """Context manager: yield a temporary folder, and finally move its contents to ``folder``.

    After the block, all new names are checked: a file must not replace a folder, and a subfolder
    must not exist already. Then the files are moved, by only one process at a time. If the block
    raises an exception or a check fails, the files in ``folder`` are unchanged. A subfolder is
    moved as a whole. A symbolic link in ``folder`` is replaced, instead of the file that it leads
    to.

    Raises
    ------
    InputError
        If ``folder`` is not writable, a file would replace a folder, or a subfolder exists already.
    """
    with not_left_empty(folder):
        prepare_folder(folder)
        yield from _staged(folder)


def _staged(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder inside ``folder``; at the end, move its contents to ``folder``.

    Errors name ``folder`` instead of the temporary folder, which the user does not know.
    """
    try:
        staged = Path(tempfile.mkdtemp(prefix=".repctl-", dir=folder))
    except OSError as error:
        raise InputError(
            f"cannot write into {folder}: {error.strerror}; choose another folder"
        ) from None
    try:
        try:
            yield staged
        except InputError as error:
            error.args = (str(error.args[0]).replace(str(staged), str(folder)),)
            raise
        moves = [(file, folder / file.name) for file in sorted(staged.iterdir())]
        for file, target in moves:
            if file.is_dir() and os.path.lexists(target):
                raise InputError(
                    f"{target} exists already, and is not replaced; choose another name"
                )
            if target.is_dir() and not target.is_symlink():
                raise InputError(f"cannot write {target}: the path is a folder; give a file name")
        with _one_at_a_time(folder):
            for file, target in moves:
                _move(file, target)
    finally:
        shutil.rmtree(staged, ignore_errors=True)


def _move(file: Path, target: Path) -> None:
    """Move a file to a target path, and keep the permissions of the file that it replaces.

    A symbolic link is replaced. A device, such as /dev/null, is written to, because a file must not
    replace it. If ``file`` is a folder, the target must not exist. InputError is raised if a link
    cannot be replaced, or a folder cannot be moved.
    """
    old = target.lstat() if os.path.lexists(target) else None
    if old is not None and not stat.S_ISREG(old.st_mode) and not target.is_symlink():
        write_whole(target, file.read_bytes())
        return
    if old is not None and stat.S_ISREG(old.st_mode):
        os.chmod(file, stat.S_IMODE(old.st_mode))
    try:
        os.replace(file, target)
    except OSError as error:
        if target.is_symlink() or file.is_dir():
            raise InputError(
                f"cannot write {target}: {error.strerror}; choose another name"
            ) from None
        write_whole(target, file.read_bytes())  # a mounted file cannot be renamed


@contextlib.contextmanager
def _one_at_a_time(folder: Path) -> Iterator[None]:
    """Context manager that locks a folder against other processes, where that is possible.

    It waits until no other process holds the lock. Without locks, as on Windows or some network
    drives, it does nothing.
    """
    try:
        import fcntl

        handle = os.open(folder, os.O_RDONLY)
    except (ImportError, OSError):
        yield
        return
    try:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def write_whole(path: str | Path, content: str | bytes) -> Path:
    """Write a file atomically: to a temporary file beside it, which is then renamed.

    A symbolic link is followed, and its target is replaced. A device, a pipe, or the file that is
    standard output, is written to, never replaced.

    Parameters
    ----------
    path
        The file.
    content
        Content of the file; text is encoded as UTF-8.

    Returns
    -------
    Path
        The file written; for a symbolic link, its target.

    Raises
    ------
    InputError
        If the path is a folder, or cannot be written (permission, full disk); an existing file is
        then unchanged.
    BrokenPipeError
        If the path is a pipe whose reader has closed it.
    """
    data = content.encode("utf-8", "replace") if isinstance(content, str) else content
    target = _target(path)
    try:
        old = target.stat() if target.exists() else None
        if old is not None and (output := _own_output(old)) is not None:
            with open(output, "wb") as through:
                through.write(data)
        elif old is None or stat.S_ISREG(old.st_mode):
            _replace(target, data, old)
        else:
            with open(os.open(target, os.O_WRONLY | os.O_NOCTTY), "wb") as through:
                through.write(data)
    except BrokenPipeError:  # as | head leaves it
        raise
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL
        raise InputError(
            f"cannot write {path}: {getattr(error, 'strerror', None) or error}",
            remedy="choose another file",
        ) from None
    return target


def read_whole(path: str | Path, largest: int) -> str:
    """Read a regular UTF-8 file of at most ``largest`` bytes.

    Raises
    ------
    InputError
        If the path is not a regular file, is too large, cannot be read, or is not UTF-8.
    """
    try:
        return read_bytes(path, largest).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(
            f"cannot read {path}: the file is not UTF-8 text; save it as UTF-8"
        ) from None


def read_bytes(path: str | Path, largest: int) -> bytes:
    """Read a regular file of at most ``largest`` bytes.

    Other files are refused: a device could be read without end.

    Raises
    ------
    InputError
        If the path is not a regular file, is too large, or cannot be read.
    """
    try:
        mode = os.stat(path).st_mode
        data = b""
        if stat.S_ISREG(mode):
            # O_NONBLOCK: do not wait if the file was replaced by a pipe
            handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
            with open(handle, "rb") as file:
                mode = os.fstat(handle).st_mode
                data = file.read(largest + 1)
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL
        raise InputError(
            f"cannot read {path}: {getattr(error, 'strerror', None) or error}",
            remedy="give a file that exists and can be read",
        ) from None
    if not stat.S_ISREG(mode):
        what = "a folder" if stat.S_ISDIR(mode) else "a device or a pipe"
        raise InputError(f"cannot read {path}: it is {what}; give a file")
    if len(data) > largest:
        raise InputError(
            f"cannot read {path}: the file is larger than {largest / 1e6:g} MB; give a smaller file"
        )
    return data


def _own_output(file: os.stat_result) -> int | None:
    """Return a new descriptor of standard output if ``file`` is its status, else None.

    The caller writes to this descriptor. If it opened the file by its path instead, it would begin
    at the start of the file, and overwrite what was printed.
    """
    try:
        sys.stdout.flush()
        handle = sys.stdout.fileno()
        return os.dup(handle) if os.path.samestat(os.fstat(handle), file) else None
    except (OSError, ValueError, AttributeError):  # closed, or no file
        return None


def _target(path: str | Path) -> Path:
    """Resolve the file to write: the target of a symbolic link, else the path itself.

    So the writer replaces the target, and not the link. A link to an unnamed pipe, such as
    ``/dev/stdout`` before ``| head``, stays as it is, because the pipe itself has no path.

    Raises
    ------
    InputError
        If the path is empty, a folder, a link that leads back to itself, or below a folder that
        cannot be read.
    """
    target = Path(path)
    try:
        if target.is_symlink():
            try:
                os.stat(target)
                there = True
            except FileNotFoundError:  # it is made
                there = False
            real = Path(os.path.realpath(target))
            if real.exists() or not there:
                target = real
        folder = target.is_dir()
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from None
    if not str(path):
        raise InputError(f"cannot write {path}: the file name is empty; give a file name")
    if folder:
        raise InputError(f"cannot write {path}: the path is a folder; give a file name")
    return target


def _replace(target: Path, data: bytes, old: os.stat_result | None) -> None:
    """Write data to a temporary file with a random name beside the target, and rename it.

    ``old`` is the status of the replaced file, whose permissions are kept; None for a new file.
    Data and folder are flushed to the disk. After an error the temporary file is removed.
    """
    temporary = target.with_name(f".repctl-{secrets.token_hex(8)}")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0)
    try:  # includes os.open: a signal may arrive before it returns the handle
        handle = os.open(temporary, flags, 0o666)
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
    with contextlib.suppress(OSError):  # flush the rename to disk, where the system can
        folder = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
