"""Reading and writing of tables: CSV files, NumPy's .npz, and Parquet if pyarrow is installed.

Every file of numbers is read here: waypoints and motions line by line (:func:`csv_rows`), because
their messages name the value that is wrong; recordings, which can be large, as whole columns
(:func:`read_table`).
"""

from __future__ import annotations

import csv
import io
import re
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arguments import read_only
from .errors import InputError, needed
from .files import read_bytes, write_whole

_FORMATS = (".csv", ".npz", ".parquet")
_LARGEST = 4_000_000_000
_BLOCK = 2**14
_WHOLE = re.compile(r"\s*[+-]?[0-9]{1,18}\s*")

Column = NDArray[Any]


@dataclass(frozen=True, eq=False)
@read_only
class Table:
    """Columns of a file, by name, of equal length: one row per frame of a recording.

    Attributes
    ----------
    file : Path
        The file.
    columns : dict of str to (K, …) array
        Numbers, or text as objects.
    """

    file: Path
    columns: Mapping[str, Column]

    def line(self, frame: int) -> str:
        """Write the line of a frame in a CSV file, or its number in another file, for a message.

        Frames are counted from 0.
        """
        if self.file.suffix.lower() == ".csv":
            lines = (line for line, _ in csv_rows(self.file))
            return f"{self.file}, line {next(islice(lines, frame + 1, None), 0)}"
        return f"{self.file}, frame {frame}"


def csv_rows(file: str | Path, largest: int = _LARGEST) -> Iterator[tuple[int, list[str]]]:
    """Yield the lines of a CSV file that are not empty, the header too, as (line number, fields).

    The number is that in the file, so that a message can name the line at fault.

    Raises
    ------
    InputError
        If the file cannot be read, is larger than ``largest`` bytes, or is not CSV.
    """
    data = io.BytesIO(read_bytes(file, largest))
    lines = csv.reader(io.TextIOWrapper(data, "utf-8-sig", newline=""))
    try:
        for row in lines:
            if row:
                yield lines.line_num, row
    except UnicodeDecodeError:
        raise InputError(f"cannot read {file}: the file is not UTF-8 text") from None
    except csv.Error as error:
        raise InputError(f"{file}, line {lines.line_num}: {error}") from None


def number(text: str) -> float:
    """Parse a number; nan if it is not one."""
    return float(text) if _is_number(text) else np.nan


def refuse_twice(names: Sequence[str], where: str | Path) -> None:
    """Raise InputError if two columns have one name: reading by name would take one of them.

    ``where`` is the file, for the message.
    """
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{where}: two columns are named {twice[0]!r}; rename one of them")


def read_table(file: Path) -> Table:
    """Read a table in the format of the file's suffix.

    Raises
    ------
    InputError
        If the file cannot be read, or its columns are not numbers of equal length; the message
        names the line.
    """
    suffix = _format(file)
    if suffix == ".parquet":
        needed("pyarrow", by="a Parquet file")
    data = read_bytes(file, _LARGEST)
    columns = {".csv": _of_csv, ".npz": _of_npz, ".parquet": _of_parquet}[suffix](file, data)
    lengths = {len(values) for values in columns.values()}
    if not columns or lengths == {0}:
        raise InputError(f"{file} contains no frames", remedy="write one row per frame")
    if len(lengths) > 1:
        each = ", ".join(f"{name}: {len(values)}" for name, values in columns.items())
        raise InputError(
            f"{file}: the arrays have different lengths ({each})",
            remedy="write one row per frame in each",
        )
    return Table(file, columns)


def write_table(file: Path, columns: Mapping[str, Column]) -> Path:
    """Write columns in the format of the file's suffix, atomically: .csv, .npz or .parquet.

    Columns are arrays with one row per frame. In a CSV file, column k of a wider array is
    ``name_k``. InputError is raised for another suffix, or if pyarrow is missing for Parquet.
    """
    suffix = _format(file)
    if suffix == ".csv":
        return write_whole(file, _csv_text(columns))
    out = io.BytesIO()
    if suffix == ".npz":
        plain = {
            name: values.astype(str) if values.dtype == object else values
            for name, values in columns.items()
        }
        np.savez_compressed(out, allow_pickle=False, **plain)
    else:
        needed("pyarrow", by="a Parquet file")
        import pyarrow
        import pyarrow.parquet

        made = {name: _arrow(values) for name, values in columns.items()}
        pyarrow.parquet.write_table(pyarrow.table(made), out)
    return write_whole(file, out.getvalue())


def _format(file: Path) -> str:
    suffix = file.suffix.lower()
    if suffix not in _FORMATS:
        raise InputError(f"{file} is not a .csv, .npz or .parquet file")
    return suffix


def _of_csv(file: Path, data: bytes) -> dict[str, Column]:
    """Read a CSV file, given as bytes, into columns by name; whole numbers become integers.

    The kinds of the columns are those of the first row: numbers, or text. InputError names the line
    that does not fit.
    """
    text = io.TextIOWrapper(io.BytesIO(data), "utf-8-sig", newline="")
    try:
        names = [name.strip("#\"' \t") for name in next(csv.reader([text.readline()]), [])]
        filled = (line for line in iter(text.readline, "") if line.strip())
        first = next(csv.reader([next(filled, "")]), [])
        _check_header(file, names, first)
        kinds = [float if _is_number(cell) else object for cell in first]
        text.seek(0)
        text.readline()
        one = len(set(kinds)) == 1 and kinds[0] is float
        rows = np.loadtxt(
            text,
            dtype=float if one else [(f"c{i}", kind) for i, kind in enumerate(kinds)],
            delimiter=",",
            comments=None,
            quotechar='"',
            ndmin=2 if one else 1,
        )
    except InputError:
        raise
    except UnicodeDecodeError:
        raise InputError(f"cannot read {file}: the file is not UTF-8 text") from None
    except (ValueError, csv.Error) as error:
        raise _wrong_line(file, len(names), first, error) from None
    found = {n: rows[:, i] if one else rows[f"c{i}"] for i, n in enumerate(names)}
    for name, cell in zip(names, first, strict=True):  # counters stay whole numbers
        values = found[name]
        counts = _WHOLE.fullmatch(cell) and values.dtype == float
        if counts and np.isfinite(values).all() and (values == np.rint(values)).all():
            found[name] = values.astype(np.int64)
    return found


def _check_header(file: Path, names: list[str], first: list[str]) -> None:
    """Check that the header names each column once, and that the first row has as many fields.

    ``names`` is the header and ``first`` the first row; InputError if not.
    """
    if any(";" in name for name in names):
        raise InputError(f"{file}: separate the columns by commas, and use decimal points")
    if not names or any(_is_number(name) or not name for name in names):
        raise InputError(
            f"{file}: the first line must name the columns, such as time and the joints"
        )
    refuse_twice(names, file)
    if not first:
        raise InputError(f"{file} contains no frames", remedy="write one row per frame")
    if len(first) != len(names):
        raise InputError(f"{file}, line 2: {len(first)} fields, but the header has {len(names)}")


def _wrong_line(file: Path, size: int, first: list[str], error: Exception) -> InputError:
    """Make the error for the first line of a CSV file that cannot be read.

    ``size`` is the number of columns, ``first`` the fields of the first row, whose numbers must be
    numbers in all rows, and ``error`` NumPy's own, which names no line of the file.
    """
    try:
        for line, row in islice(csv_rows(file), 1, None):
            if len(row) != size:
                return InputError(
                    f"{file}, line {line}: {len(row)} fields, but the header has {size}"
                )
            for cell, like in zip(row, first, strict=True):
                if _is_number(like) and not _is_number(cell):
                    return InputError(f"{file}, line {line}: {cell!r} is not a number")
    except InputError as other:
        return other
    return InputError(f"cannot read {file}: {error}")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _csv_text(columns: Mapping[str, Column]) -> bytes:
    """Write columns as the bytes of a CSV file, in blocks of rows that keep the memory small.

    A column of several numbers per row becomes ``name_0``, ``name_1``, and so on.
    """
    flat: dict[str, Column] = {}
    for name, values in columns.items():
        wide = values.reshape(len(values), -1)
        keys = [name] if values.ndim == 1 else [f"{name}_{i}" for i in range(wide.shape[1])]
        flat |= dict(zip(keys, wide.T, strict=True))
    size = len(next(iter(flat.values())))
    parts = [_lines_of([tuple(flat)])]
    for k in range(0, size, _BLOCK):  # text of all rows at once would take four times its size
        block = (values[k : k + _BLOCK].tolist() for values in flat.values())
        parts.append(_lines_of(zip(*block, strict=True)))
    return b"".join(parts)


def _lines_of(rows: Iterable[tuple[object, ...]]) -> bytes:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    return out.getvalue().encode("utf-8", "replace")


def _of_npz(file: Path, data: bytes) -> dict[str, Column]:
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            found = {name: arrays[name] for name in arrays.files}
    except (ValueError, OSError, EOFError, KeyError, AttributeError, zipfile.BadZipFile) as error:
        raise InputError(f"cannot read {file}: {error}") from None
    return {name: values for name, values in found.items() if values.ndim}


def _of_parquet(file: Path, data: bytes) -> dict[str, Column]:
    import pyarrow
    import pyarrow.parquet

    try:
        table = pyarrow.parquet.read_table(pyarrow.BufferReader(data))
    except (pyarrow.ArrowException, OSError) as error:
        raise InputError(f"cannot read {file}: {error}") from None
    return {name: _plain(table[name]) for name in table.column_names}


def _plain(column: Any) -> Column:
    """Convert a Parquet column to an array; lists of equal length become its rows.

    Lists of different lengths give an array of Python lists.
    """
    import pyarrow

    if not (pyarrow.types.is_list(column.type) or pyarrow.types.is_fixed_size_list(column.type)):
        return np.asarray(column.to_numpy())
    flat = np.concatenate([np.asarray(chunk.flatten()) for chunk in column.chunks])
    size = len(flat) // max(len(column), 1)
    if size * len(column) == len(flat) and size:
        return flat.reshape(len(column), size)
    return np.array(column.to_pylist(), dtype=object)


def _arrow(values: Column) -> Any:
    import pyarrow

    if values.ndim == 1:
        return pyarrow.array(values)
    wide = values.reshape(len(values), -1)
    return pyarrow.FixedSizeListArray.from_arrays(pyarrow.array(wide.ravel()), wide.shape[1])
