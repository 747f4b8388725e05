"""Files written whole or not at all."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from .errors import InputError


def check_folder(folder: Path) -> Path:
    """Make sure that files can be written into a folder, before any long work; one that is not there is not made.

    Raises
    ------
    InputError
        If it cannot be made or written.
    """
    try:
        there = next(part for part in (folder, *folder.parents) if part.exists())
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise _unwritable(folder, error) from None
    return folder


def prepare_folder(folder: Path) -> Path:
    """Make a folder where it is not there, and make sure that files can be written into it.

    Raises
    ------
    InputError
        If it cannot be made or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _unwritable(folder, error) from None
    return check_folder(folder)


@contextlib.contextmanager
def not_left_empty(folder: Path) -> Iterator[Path]:
    """Leave no empty folder behind: what is made on the way to it, and holds nothing in the end, goes again."""
    missing = [part for part in (folder, *folder.parents) if not part.exists()]
    try:
        yield folder
    finally:
        for part in missing:
            with contextlib.suppress(OSError):  # it is not there, or holds something
                part.rmdir()


def write_whole(path: str | Path, content: str | bytes | Callable[[Path], None]) -> Path:
    """Write a file through a temporary one beside it and a rename: a reader sees the old or the new, never half.

    Parameters
    ----------
    path
        The file.
    content
        What to write, or a function that writes it to the path it is given.

    Raises
    ------
    InputError
        If it cannot be written (permission, full disk); an old file stays as it was.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        if callable(content):
            content(temporary)
        elif isinstance(content, bytes):
            temporary.write_bytes(content)
        else:
            temporary.write_text(content, encoding="utf-8", newline="\n")
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
        _settle(path.parent)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
    return path


def _unwritable(folder: Path, error: OSError) -> InputError:
    return InputError(f"cannot write into {folder}: {error.strerror}; choose another folder")


def _settle(folder: Path) -> None:
    """Make the rename itself outlast a power cut, where the system can."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
