"""LeRobot's data sets: a folder with ``meta/info.json``, Parquet files, and videos.

Version 2.1 has one Parquet file per demonstration (episode), version 3.0 many demonstrations in one
file. Both contain statistics of each column, per demonstration or over all demonstrations. The
statistics of a changed column are computed again. Letters: K frames (rows), w numbers per row of a
column.

``NewCells`` are new numbers for one column of a table, with the rows, and the indices in a row, at
which they replace the old ones.
"""

from __future__ import annotations

import json
import os
import shutil
import stat
from collections.abc import Callable, Collection, Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ....base.arguments import Array
from ....base.data_tables import (
    FORMATS,
    Column,
    NewCells,
    arrow_numbers,
    arrow_replaced,
    arrow_width,
)
from ....base.data_tables import replaced as new_column
from ....base.errors import InputError, needed
from ....base.files import read_whole, write_whole
from .data_set import DataSet

_LARGEST = 1_000_000_000
"""Maximum size of a file of descriptions or statistics, bytes."""

_VERSIONS = ("v2.1", "v3.0")
_STATE = "observation.state"
_NUMBERS = ("float32", "float64", "int8", "int16", "int32", "int64", "uint8", "uint16", "bool")
_STATISTICS: dict[str, Callable[[Array], Array]] = {
    "min": lambda X: X.min(axis=0),
    "max": lambda X: X.max(axis=0),
    "mean": lambda X: X.mean(axis=0),
    "std": lambda X: X.std(axis=0),
    "count": lambda X: np.array([len(X)]),
}
"""Statistics of a column's numbers (K, w); LeRobot also has quantiles, such as ``q01``."""

_OF_STATISTICS = ("meta/stats.json", "meta/episodes_stats.jsonl")


def read_info(folder: Path) -> dict[str, Any]:
    """Read ``meta/info.json``, the description of a LeRobot data set.

    Raises
    ------
    InputError
        If it is missing or not a description of features.
    """
    file = folder / "meta" / "info.json"
    if not file.is_file():
        raise InputError(
            f"{folder} is a folder without meta/info.json",
            remedy="give a file, or the folder of a LeRobot data set",
        )
    try:
        info = json.loads(read_whole(file, _LARGEST))
    except ValueError as error:
        raise InputError(f"{file} is not JSON: {error}; download it again") from None
    features = info.get("features") if isinstance(info, dict) else None
    if not isinstance(features, dict) or not all(isinstance(f, dict) for f in features.values()):
        raise InputError(f"{file} has no 'features'", remedy="export the data set with LeRobot")
    return info


def labels_of(info: Mapping[str, Any], name: str) -> list[str] | None:
    """Return the names of the numbers in a column, from ``meta/info.json``; None if it has none."""
    names = info["features"].get(name, {}).get("names")
    if isinstance(names, dict) and len(names) == 1:  # {"motors": […]}
        names = next(iter(names.values()))
    if not isinstance(names, list) or not all(isinstance(one, str) for one in names):
        return None
    return names


class LeRobotData(DataSet):
    """A LeRobot data set of version 2.1 or 3.0, opened from its folder.

    As a :class:`DataSet`, it gives columns by name, one row per frame. The column of joints is
    ``observation.state``, if there is one. An InputError is raised if the folder is incomplete.
    """

    sessions = "episode_index"
    times = "timestamp"

    def __init__(self, folder: Path) -> None:
        needed("pyarrow", by="a LeRobot data set")
        self.file = folder
        self._info = info = read_info(folder)
        version = info.get("codebase_version")
        if version not in _VERSIONS:
            raise InputError(
                f"{folder}: codebase_version {version!r} of LeRobot is not known",
                remedy=f"convert the data set with LeRobot to {' or '.join(_VERSIONS)}",
            )
        features = info["features"]
        self.widths = {name: _width_of(f) for name, f in features.items() if _in_tables(f)}
        self.joints = _STATE if _STATE in self.widths else None
        for name in (self.sessions, self.times):
            if name not in self.widths:
                raise InputError(
                    f"{folder}: meta/info.json has no feature {name!r}; "
                    "export the data set with LeRobot again"
                )
        self._files = sorted(folder.glob("data/*/*.parquet"))
        self._ends = np.cumsum([0, *(_opened(file).metadata.num_rows for file in self._files)])
        found = {"total_frames": int(self._ends[-1])}
        if found["total_frames"]:
            found["total_episodes"] = len(np.unique(self.column(self.sessions)))
        for key, count in found.items():
            if not count or info.get(key) != count:
                raise InputError(
                    f"{folder}: the files in data have {count} {key.removeprefix('total_')}, but "
                    f"{key} in meta/info.json is {info.get(key)}",
                    remedy="download the whole data set",
                )

    def same_format(self, path: Path) -> bool:
        """Test by its suffix whether a path can be that of a folder in this format.

        The result is False for the suffix of a table's file, such as .csv.
        """
        return path.suffix.lower() not in FORMATS

    def labels(self, name: str) -> list[str] | None:
        """Return the names of the numbers in a column; None if ``meta/info.json`` has none."""
        return labels_of(self._info, name)

    @property
    def clock(self) -> Array:
        """Time of each frame, s, its row number divided by the frame rate: (K,).

        The time goes on from one demonstration to the next, without beginning at 0 again. An
        InputError is raised if the data set gives no rate.
        """
        fps = self._info.get("fps")
        if isinstance(fps, bool) or not isinstance(fps, (int, float)) or not fps > 0:
            raise InputError(
                f"{self.file}: 'fps' in meta/info.json is {fps!r}; write the rate there, in Hz"
            )
        return np.arange(int(self._ends[-1])) / fps

    def column(self, name: str) -> Column:
        """Return a column by its name, as an array (K,) or (K, width), joined from all files."""
        parts = []
        for file in self._files:
            table = _opened(file)
            if name not in table.schema_arrow.names:
                raise InputError(
                    f"{file} has no column {name!r}, which meta/info.json lists",
                    remedy="export the data set with LeRobot again",
                )
            column = table.read(columns=[name])[name]
            width = self.widths[name]
            if width and arrow_width(column) != width:
                raise InputError(
                    f"{file}: {name!r} does not have {width} numbers in each row, as in "
                    "meta/info.json; export the data set with LeRobot again"
                )
            parts.append(arrow_numbers(column, width))
        return np.concatenate(parts)

    def where(self, row: int) -> str:
        """Describe where a row, counted from 0, is stored: its file, and its row there."""
        at = int(np.searchsorted(self._ends, row, side="right")) - 1
        return f"{self._files[at]}, row {row - int(self._ends[at])}"

    def write(self, path: Path, new: Mapping[str, NewCells], removed: Collection[str]) -> None:
        """Write the data set: copy all files but those of the data, then write data and statistics.

        ``new`` has the changed numbers by name of their column. ``removed`` are the names of the
        columns that are left out of data, statistics and description, ``meta/info.json``.
        """
        rewritten = {file.relative_to(self.file).as_posix() for file in self._files}
        self._require_known_statistics()
        _copy(self.file, path, rewritten)

        # the data, file by file, with the same groups of rows
        for file, (start, end) in zip(self._files, pairwise(self._ends), strict=True):
            rows = slice(int(start), int(end))
            _rewrite(file, path / file.relative_to(self.file), _part(new, rows), removed)

        # the statistics of the changed columns, from the numbers as they are stored
        columns = {name: new_column(self.column(name), cells) for name, cells in new.items()}
        _update_statistics(path, columns, np.asarray(self.column(self.sessions)).ravel(), removed)

        # the description of what is left, where integers may have become doubles
        features = {k: v for k, v in self._info["features"].items() if k not in removed}
        for name, values in columns.items():
            if not features[name]["dtype"].startswith("float"):
                features[name] = features[name] | {"dtype": str(values.dtype)}
        if features != self._info["features"]:
            text = json.dumps(self._info | {"features": features}, indent=4, ensure_ascii=False)
            write_whole(path / "meta" / "info.json", text)

    def _require_known_statistics(self) -> None:
        """Raise InputError if there is a file of statistics that cannot be computed again."""
        for file in sorted([*self.file.glob("*stats*"), *self.file.glob("meta/*stats*")]):
            name = file.relative_to(self.file).as_posix()
            if name not in _OF_STATISTICS:
                raise InputError(
                    f"{file} may have statistics of the old joint values",
                    remedy="move it out of the folder; compute the statistics of the new data set",
                )


def _update_statistics(
    folder: Path, columns: Mapping[str, Column], episodes: Array, removed: Collection[str]
) -> None:
    """Compute the statistics of changed columns again, in all files of a folder that have them.

    ``columns`` are the changed columns by name, ``episodes`` (K,) has the number of the
    demonstration of each frame, and ``removed`` the names of the columns that are left out.
    """
    wide = {name: np.asarray(x, float).reshape(len(x), -1) for name, x in columns.items()}
    of_all, of_each = (folder / name for name in _OF_STATISTICS)
    if of_all.is_file():
        stats = _json(of_all)
        write_whole(of_all, json.dumps(_updated(stats, wide, removed, of_all), indent=4))
    if of_each.is_file():
        write_whole(of_each, _lines(of_each, wide, episodes, removed))
    for file in sorted(folder.glob("meta/episodes/*/*.parquet")):
        _update_episodes(file, wide, episodes, removed)


def _in_tables(feature: Mapping[str, Any]) -> bool:
    return feature.get("dtype") != "video"


def _width_of(feature: Mapping[str, Any]) -> int:
    """Count the numbers per row of a feature (a column); 0 unless it is a vector of numbers."""
    shape = feature.get("shape")
    if feature.get("dtype") not in _NUMBERS or not isinstance(shape, (list, tuple)):
        return 0
    return int(shape[0]) if len(shape) == 1 and isinstance(shape[0], int) else 0


def _opened(file: Path) -> Any:
    import pyarrow
    import pyarrow.parquet

    try:
        return pyarrow.parquet.ParquetFile(file)
    except (pyarrow.ArrowException, OSError) as error:
        raise InputError(f"cannot read {file}: {error}") from None


def _part(new: Mapping[str, NewCells], rows: slice) -> dict[str, NewCells]:
    """Select consecutive rows, such as those of one file, from the new numbers of each column.

    Return the selected numbers by name of the column. ``rows`` are counted as in ``new``; in the
    result, the first of them is row 0.
    """
    return {name: NewCells(c.values[rows], c.at, c.rows[rows]) for name, c in new.items()}


def _rewrite(
    file: Path, target: Path, new: Mapping[str, NewCells], removed: Collection[str]
) -> None:
    """Write a copy of a Parquet file with changed columns, and without the columns ``removed``.

    ``new`` has the changed numbers by name of their column, with a row per row of this file. Row
    groups and compression stay as they are.
    """
    import pyarrow.parquet

    source, tables, start = _opened(file), [], 0
    for i in range(source.num_row_groups):
        group = source.read_row_group(i)
        rows = slice(start, start + len(group))
        tables.append(arrow_replaced(group, _part(new, rows), removed))
        start = rows.stop
    packed = source.metadata.row_group(0).column(0).compression.lower()
    packed = "none" if packed == "uncompressed" else packed
    target.parent.mkdir(parents=True, exist_ok=True)
    with pyarrow.parquet.ParquetWriter(target, tables[0].schema, compression=packed) as writer:
        for table in tables:
            writer.write_table(table, row_group_size=max(len(table), 1))


def _copy(source: Path, target: Path, without: Collection[str]) -> None:
    """Copy a folder, but not the files ``without``; a link is copied as the file behind it.

    ``without`` are paths relative to the folder.
    """
    for folder, names, files in os.walk(source):
        at = Path(folder).relative_to(source)
        (target / at).mkdir(parents=True, exist_ok=True)
        for name in names:
            if (Path(folder) / name).is_symlink():
                raise InputError(
                    f"{Path(folder) / name} is a link to a folder, which is not copied; "
                    "replace the link by a copy of the folder"
                )
        for name in files:
            if (at / name).as_posix() in without:
                continue
            file = Path(folder) / name
            if not stat.S_ISREG(os.stat(file).st_mode):
                raise InputError(f"{file} is not a regular file; remove it from the data set")
            shutil.copy2(file, target / at / name)


def _json(file: Path) -> dict[str, Any]:
    try:
        made = json.loads(read_whole(file, _LARGEST))
    except ValueError as error:
        raise InputError(f"{file} is not JSON: {error}; download it again") from None
    if not isinstance(made, dict):
        raise InputError(f"{file} is not a JSON object; download it again")
    return made


def _updated(
    stats: dict[str, Any], columns: Mapping[str, Array], removed: Collection[str], file: Path
) -> dict[str, Any]:
    """Recompute the statistics of changed columns; return the statistics of all columns by name.

    ``columns`` are the changed columns by name, (K, w) each. ``stats`` are the old statistics of
    all columns. The statistics of the columns ``removed`` are left out. ``file`` is named in error
    messages.
    """
    made = {name: value for name, value in stats.items() if name not in removed}
    for name, X in columns.items():
        if isinstance(made.get(name), dict):
            made[name] = {key: _statistic(key, X, file).tolist() for key in made[name]}
    return made


def _statistic(key: str, X: Array, file: Path) -> Array:
    """Compute a statistic of each column of X (K, w): (w,).

    ``key`` is LeRobot's name of the statistic, such as ``q01``. An InputError is raised for an
    unknown name; the message also names ``file``, in which the name was found.
    """
    if key in _STATISTICS:
        return np.asarray(_STATISTICS[key](X))
    if key[0] == "q" and key[1:].isdecimal() and len(key) == 3:
        return np.quantile(X, int(key[1:]) / 100, axis=0)
    raise InputError(
        f"{file}: the statistic {key!r} is not known, so it cannot be computed for the new joints",
        remedy="remove it from the data set",
    )


def _lines(
    file: Path, columns: Mapping[str, Array], episodes: Column, removed: Collection[str]
) -> str:
    """Recompute the statistics of each demonstration; return the new file's text, JSON lines.

    ``file`` is the old file. ``columns`` are the new values of the changed columns, by name, and
    ``episodes`` has the number of the demonstration of each of their rows. ``removed`` are the
    names of columns whose statistics are removed.
    """

    def line(text: str) -> str:
        try:
            one = json.loads(text)
            rows = episodes == one["episode_index"]
            stats = dict(one["stats"])
        except (ValueError, TypeError, KeyError) as error:
            raise InputError(
                f"{file}: a line has no statistics of an episode: {error}; download it again"
            ) from None
        part = {name: X[rows] for name, X in columns.items()}
        _require_rows(rows, one["episode_index"], file)
        return json.dumps(one | {"stats": _updated(stats, part, removed, file)}, ensure_ascii=False)

    return "".join(f"{line(text)}\n" for text in _filled(read_whole(file, _LARGEST)))


def _filled(text: str) -> Iterator[str]:
    return (line for line in text.split("\n") if line.strip())


def _require_rows(rows: Column, episode: object, file: Path) -> None:
    if not rows.any():
        raise InputError(
            f"{file}: episode {episode} has no frames in data; download the whole data set"
        )


def _update_episodes(
    file: Path, columns: Mapping[str, Array], episodes: Column, removed: Collection[str]
) -> None:
    """Recompute the statistics in the table of demonstrations, and rewrite the file of the table.

    ``columns`` are the changed columns of the data by name, with a row per frame of the recording;
    ``episodes`` has the number of the demonstration of each of these rows. ``removed`` are the
    columns whose statistics are removed.
    """
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(file)
    numbers = table["episode_index"].to_pylist()
    for at, name in enumerate(table.column_names):
        parts = name.split("/")
        if len(parts) != 3 or parts[0] != "stats" or parts[1] not in columns:
            continue
        rows = []
        for number in numbers:
            of_one = episodes == number
            _require_rows(of_one, number, file)
            rows.append(_statistic(parts[2], columns[parts[1]][of_one], file).tolist())
        field = table.schema.field(at)
        table = table.set_column(at, field, pyarrow.array(rows, field.type))
    gone = [
        name
        for name in table.column_names
        if name.split("/")[:2] in [["stats", r] for r in removed]
    ]
    table = arrow_replaced(table, {}, gone)
    pyarrow.parquet.write_table(table, file)
