"""A data set of robot learning: many demonstrations, with joints, actions, and much else.

Its demonstrations are read as one table with a row per frame; K is the number of frames. Actions
are the recorded commands: joint positions, or commands of the hand. A data set is written whole or
not at all, and a new data set never replaces one that exists.

``NewCells`` are new numbers for one column of a table, with the rows, and the indices in a row, at
which they replace the old ones.
"""

from __future__ import annotations

import os
import re
from abc import abstractmethod
from collections.abc import Collection, Mapping
from pathlib import Path

from ....base.arguments import Array
from ....base.data_tables import NewCells, Table
from ....base.errors import InputError
from ....base.files import written_together

_ACTION = re.compile(r"(?<![a-z])actions?(?![a-z])")


HDF5 = (".hdf5", ".h5")
"""Suffixes of HDF5 files."""


def is_data_set(path: Path) -> bool:
    """Test whether a path is that of a data set: an existing folder, or an HDF5 file."""
    return path.is_dir() or path.suffix.lower() in HDF5


class DataSet(Table):
    """Demonstrations of a data set, as one table.

    Attributes
    ----------
    joints : str or None
        Name of the column of joints; None if it is not known yet.
    sessions : str
        Name of the column with the number of each frame's demonstration.
    times : str or None
        Name of the column of times, s, from the start of each demonstration; None if there is none.
    commands : str or None
        ``hand`` if the data set says that its actions command the hand; None if it does not say.
    simulator : tuple of str
        Names of columns of a simulator's state, which depends on the recorded joints.
    """

    joints: str | None
    sessions: str
    times: str | None = None
    commands: str | None = None
    simulator: tuple[str, ...] = ()

    def labels(self, name: str) -> list[str] | None:
        """Return the names of the numbers in each row of a column; None if they have no names."""
        return None

    @property
    @abstractmethod
    def clock(self) -> Array:
        """Time of each frame, s, its row number divided by the frame rate: (K,).

        The time goes on from one demonstration to the next, without beginning at 0 again. An
        InputError is raised if the data set gives no rate.
        """

    @abstractmethod
    def write(self, path: Path, new: Mapping[str, NewCells], removed: Collection[str]) -> None:
        """Write the data set with changed columns to ``path``, where nothing exists yet.

        :meth:`save` calls this with a path in a temporary folder. ``new`` has the changed numbers
        by name of their column. ``removed`` are the names of the columns that are left out.
        """

    def actions(self) -> tuple[str, ...]:
        """Return the names of the columns of actions."""
        return tuple(name for name in self.widths if _ACTION.search(name))

    def save(self, path: Path, new: Mapping[str, NewCells], removed: Collection[str]) -> Path:
        """Write a copy of the data set with changed columns to ``path``, and return ``path``.

        The copy is made in a temporary folder beside ``path`` and then renamed, so that nothing is
        left if it fails. ``new`` has the changed numbers by name of their column; the columns
        ``removed`` are left out.

        Raises
        ------
        InputError
            If something is at the path, or it cannot be written.
        """
        require_new(self.file, path)
        try:
            with written_together(path.parent) as staged:
                self.write(staged / path.name, new, removed)
        except OSError as error:
            raise InputError(f"cannot write {path}: {error.strerror or error}") from None
        return path


def require_new(source: Path, path: Path) -> None:
    """Raise InputError if a data set cannot be written to ``path``.

    The path must not exist, nor lie in the folder ``source``, so that no data set is replaced or
    copied into itself.
    """
    if os.path.lexists(path):
        raise InputError(
            f"{path} exists already, and is not replaced",
            remedy="remove it, or choose another folder",
        )
    real = source.resolve()
    if real.is_dir() and real in (path.resolve(), *path.resolve().parents):
        raise InputError(f"{path} lies in the data set {source}", remedy="choose another folder")
