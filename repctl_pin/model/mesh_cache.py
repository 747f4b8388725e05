"""Cache of meshes and their convex hulls on disk, by the content of the mesh file.

Importing a mesh reader, reading the meshes and computing their convex hulls takes longer than all
distance computations of most commands. The folder is ``$XDG_CACHE_HOME/repctl_pin/meshes``, by
default under ``~/.cache``. It may be deleted at any time. Beyond 500 MB, the files that were used
longest ago are deleted.
"""

from __future__ import annotations

import hashlib
import io
import os
import zipfile
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.files import read_bytes, write_whole

_VERSION = 1
"""Version of the cached arrays; raise it whenever their content or meaning changes."""

_COMPLETE = (".stl", ".dae", ".obj", ".ply", ".off", ".glb")
"""Formats whose file holds all vertices and triangles; other formats are not cached."""

_LARGEST = 30_000_000
"""Maximum size of a mesh file whose arrays are cached, bytes."""

_LARGEST_CACHE = 500_000_000
"""Maximum size of all cached files, bytes."""

Arrays = dict[str, NDArray[Any]]


_Stamp = tuple[int, int, int]
"""Inode, modification time in ns, and size of a file; one of them changes if it is replaced."""


def cached(
    path: Path, variant: str, make: Callable[[], Arrays], *, textures: bool = False
) -> Arrays:
    """Return the arrays of a mesh file from the cache, or make them and add them to it.

    Parameters
    ----------
    path
        The mesh file, which the cache identifies by its format and content.
    variant
        Text of all else on which the arrays depend, such as the scale.
    make
        Function that reads the file and returns the arrays. If it raises an error, nothing is
        cached.
    textures
        True if the arrays depend on textures. COLLADA files that name textures are then not cached.

    Returns
    -------
    dict of (str, array)
        The arrays by name. If the cache cannot be read or written, ``make`` is called each time.
    """
    before = _stamp(path)
    kept = None if before is None else _kept(path, before, variant, textures)
    if kept is None:
        return make()
    with suppress(OSError, ValueError, EOFError, zipfile.BadZipFile, InputError):
        data = io.BytesIO(read_bytes(kept, 10 * _LARGEST))
        with np.load(data, allow_pickle=False) as arrays:
            found = dict(arrays)
        with suppress(OSError):
            os.utime(kept)
        return found
    made: dict[str, Any] = make()  # Any: a keyword could be allow_pickle, which is a bool
    if _stamp(path) != before:
        return made
    content = io.BytesIO()
    np.savez(content, **made)
    with suppress(OSError, InputError):
        kept.parent.mkdir(parents=True, exist_ok=True)
        write_whole(kept, content.getvalue())
        _shrink(kept.parent)
    return made


def _stamp(path: Path) -> _Stamp | None:
    """Return (inode, modification time in ns, size) of a file, which change if it is replaced.

    Return None if the file cannot be accessed.
    """
    with suppress(OSError):
        known = path.stat()
        return known.st_ino, known.st_mtime_ns, known.st_size
    return None


def _shrink(folder: Path) -> None:
    """Delete the cached files that were used longest ago, until the others take at most 500 MB."""
    files = []
    for file in folder.glob("*.npz"):
        with suppress(OSError):  # another process may have deleted it
            files.append((file.stat(), file))
    total = 0
    for known, file in sorted(files, key=lambda each: -each[0].st_mtime_ns):
        total += known.st_size
        if total > _LARGEST_CACHE:
            with suppress(OSError):
                file.unlink()


def _kept(path: Path, stamp: _Stamp, variant: str, textures: bool) -> Path | None:
    """Return the path, in the cache, for the arrays of a mesh file; it need not exist yet.

    Return None if the arrays must not be cached: the format can refer to other files, the arrays
    depend on textures and the file can name some, the file is over 30 MB or unreadable, or there is
    no home folder. ``stamp`` is (inode, modification time, size); ``variant`` is a text of all else
    on which the arrays depend, and ``textures`` is True if they depend on textures.
    """
    kind = path.suffix.lower()
    if kind not in _COMPLETE:
        return None
    try:
        content, textured = _content(path, stamp)
        base = Path(os.environ.get("XDG_CACHE_HOME", ""))
        base = base if base.is_absolute() else Path.home() / ".cache"
    except (InputError, RuntimeError):  # too large; there is no home folder
        return None
    if textures and textured:
        return None
    key = hashlib.sha256(f"{_VERSION} {kind} {variant} {content}".encode()).hexdigest()
    return base / "repctl_pin" / "meshes" / f"{key}.npz"


@lru_cache(maxsize=512)
def _content(path: Path, _: _Stamp) -> tuple[str, bool]:
    """Hash the content of a mesh file, and test whether it is COLLADA that can name textures.

    Results are remembered, so a file is read once for all of its variants. The second argument,
    the file's stamp, is only a key of this memory: a file that was replaced is read again.
    """
    content = read_bytes(path, _LARGEST)
    # a zero byte: UTF-16, in which the name is not found
    named = b"init_from" in content or b"\0" in content
    return hashlib.sha256(content).hexdigest(), path.suffix.lower() == ".dae" and named
