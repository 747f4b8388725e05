"""Reading and writing of tables: CSV files, NumPy's .npz, and Parquet if pyarrow is installed.

Every file of numbers is read here. :func:`read_table` and :func:`read_csv` open a file and check
its header; a reader then takes the columns that it needs by name, and an error names the line. A
cell is one entry of a table, in one row and one column. If a table is written again with new
columns, all other cells stay as they are.

``NewCells`` are numbers that replace cells of one column of a table, with the rows that they
replace. ``Table`` is the columns of a file by name, all of one length, with one row per frame of a
recording. ``CsvTable`` is a CSV file that was read: its header and its lines of cells.
"""

from __future__ import annotations

import csv
import io
import json
import re
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .arguments import Array
from .errors import InputError, needed
from .files import read_bytes, write_whole

FORMATS = (".csv", ".npz", ".parquet")
"""Suffixes of the files of tables."""

_LARGEST = 4_000_000_000
_BLOCK = 2**14
_BOM = "\ufeff".encode()
_COMMAS = (
    "the columns are separated by semicolons or blanks; separate the columns by commas, and use "
    "decimal points"
)

_CELL = re.compile(r'(?:^|,)("(?:[^"]|"")*(?:"[^,]*|$)|[^,]*)')
"""A cell of a CSV file as it is written, with its quotes."""

Column = NDArray[Any]


class NewCells(NamedTuple):
    """Numbers that replace cells of one column of a table of K rows.

    Attributes
    ----------
    values : (K, w) array
        New numbers; rows that are not replaced are ignored.
    at : sequence of int
        Indices of the w numbers to replace in each row, if the column has several numbers per row;
        (0,) if it has one.
    rows : (K,) array of bool
        True where the row is replaced; the others keep their cells.
    """

    values: Array
    at: Sequence[int]
    rows: NDArray[np.bool_]


class Table(ABC):
    """Columns of a file, by name, of equal length: one row per frame of a recording.

    Attributes
    ----------
    file : Path
        The file.
    widths : dict of str to int
        Count of numbers per row, by the column's name; 0 for a column of text.
    """

    file: Path
    widths: Mapping[str, int]

    @abstractmethod
    def column(self, name: str) -> Column:
        """Return a column of K rows as an array (K, …) of numbers, or of texts (type object)."""

    @abstractmethod
    def save(self, path: Path, new: Mapping[str, NewCells], removed: Collection[str]) -> Path:
        """Write the table to ``path``, with new cells, and without the columns ``removed``.

        ``new`` has the new cells by column; columns that the file lacks are appended. All other
        cells stay as they are. Return the path.
        """

    def same_format(self, path: Path) -> bool:
        """Test by its suffix whether a path has the format of this table."""
        return path.suffix.lower() == self.file.suffix.lower()

    def numbers(self, names: Sequence[str], *, finite: bool = True) -> Array:
        """Return the numbers of several columns side by side: (K, sum of their widths).

        Raises
        ------
        InputError
            If a cell is not a number or, with ``finite``, is infinite or NaN.
        """
        for name in names:
            if not self.widths[name]:
                raise InputError(f"{self.file}: column {name!r} must be numbers; correct it")
        wide = [np.asarray(self.column(name), float) for name in names]
        values = np.concatenate([part.reshape(len(part), -1) for part in wide], axis=1)
        wrong = ~np.isfinite(values).all(axis=1)
        if finite and wrong.any():
            row = int(np.argmax(wrong))
            sizes = np.repeat(names, [self.widths[name] for name in names])
            name = sizes[np.argmin(np.isfinite(values[row]))]
            raise InputError(
                f"{self.where(row)}: {name} is not a finite number; correct it", at=row
            )
        return values

    def where(self, row: int) -> str:
        """Name the file and a row, counted from 0: ``run.csv, line 3`` or ``run.npz, frame 1``."""
        return f"{self.file}, frame {row}"


def read_table(file: Path, known: Collection[str] = ()) -> Table:
    """Open a table in the format of the file's suffix: .csv, .npz or .parquet.

    Parameters
    ----------
    file
        The file.
    known
        Column names to take from the header of a CSV file as they are; all other names are stripped
        of ``#`` and quotes.

    Raises
    ------
    InputError
        If the file cannot be read, or its columns do not have equal lengths; the message names the
        line.
    """
    suffix = _format(file)
    if suffix == ".csv":
        return read_csv(file, known)
    if suffix == ".npz":
        return _Arrays(file)
    needed("pyarrow", by="a Parquet file")
    return _Parquet(file)


def read_csv(
    file: str | Path,
    known: Collection[str] = (),
    *,
    largest: int = _LARGEST,
    unnamed: Sequence[tuple[str, ...]] = (),
    rows: str = "frames",
) -> CsvTable:
    """Open a CSV file, whatever its suffix, and check its header.

    Parameters
    ----------
    file, known
        The file; column names to take from its header as they are, without the removal of ``#`` and
        quotes.
    largest
        Maximum size, bytes.
    unnamed
        Tuples of column names for a file without a header. The first tuple with as many names as
        the file has columns is used; if there is none, an InputError is raised.
    rows
        Noun for the rows of the file in messages, in the plural.

    Raises
    ------
    InputError
        If the file cannot be read, has no lines, or the header does not name each column once.
    """
    return CsvTable(Path(file), known, largest, unnamed, rows)


def number(text: str) -> float:
    """Parse a text as a number; NaN for any other text."""
    return float(text) if _is_number(text) else np.nan


def refuse_twice(names: Sequence[str], where: str | Path) -> None:
    """Raise InputError if two columns have the same name: a column is read by its name.

    ``where`` is the file, for the message.
    """
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{where}: two columns are named {twice[0]!r}; rename one of them")


def write_table(file: Path, columns: Mapping[str, Column]) -> Path:
    """Write columns in the format of the file's suffix, atomically: .csv, .npz or .parquet.

    Columns are arrays with one row per frame. In a CSV file, an array with several numbers per row
    becomes columns ``name_0``, ``name_1``, and so on. InputError is raised for another suffix, or
    if pyarrow is missing for Parquet.
    """
    suffix = _format(file)
    if suffix == ".csv":
        return write_whole(file, _csv_text(columns))
    if suffix == ".npz":
        return write_whole(file, _npz_bytes(columns))
    needed("pyarrow", by="a Parquet file")
    import pyarrow

    return write_whole(file, _parquet_bytes(pyarrow.table(_arrow_columns(columns))))


def _format(file: Path) -> str:
    suffix = file.suffix.lower()
    if suffix not in FORMATS:
        raise InputError(f"{file} must end in .csv, .npz or .parquet")
    return suffix


# ---- CSV


class CsvTable(Table):
    """A CSV file: a header, and lines of cells; lines whose cells are all empty are skipped.

    The file is read once and not changed. Columns are parsed on request.
    """

    def __init__(
        self,
        file: Path,
        known: Collection[str],
        largest: int,
        unnamed: Sequence[tuple[str, ...]],
        rows: str,
    ) -> None:
        self.file = file
        self._data = read_bytes(file, largest)
        self._known = known
        self._header: int | None = None
        filled = ((line, row) for line, row, _ in self._records() if any(map(str.strip, row)))
        line, first = next(filled, (0, []))
        names = [self._name(cell) for cell in first]
        if any(";" in name for name in names) or _is_blank_separated(first):
            raise InputError(f"{file}, line {line}: {_COMMAS}")
        if unnamed and (not first or any(_is_number(name) or not name for name in names)):
            names = self._unnamed(unnamed, line, first)
        elif any(_is_number(name) or not name for name in names) or not names:
            raise InputError(
                f"{file}: the first line must name the columns",
                remedy="write a header, such as time and the names of the joints",
            )
        else:
            self._header = line
            line, first = next(filled, (0, []))
        self.widths = dict.fromkeys(names, 0)
        self.names = tuple(names)
        if not first:
            one = rows.removesuffix("s")
            raise InputError(f"{file} contains no {rows}", remedy=f"write one line per {one}")
        refuse_twice(names, file)
        pairs = zip(names, first, strict=False)
        self.widths = dict.fromkeys(names, 0) | {n: int(_is_number(cell)) for n, cell in pairs}

    def _unnamed(
        self, unnamed: Sequence[tuple[str, ...]], line: int, first: Sequence[str]
    ) -> list[str]:
        """Return the column names of a file without a header: the tuple of ``unnamed`` that fits.

        A tuple fits if it has as many names as the first line has cells. ``line`` is the number of
        the first line, and ``first`` has its cells. InputError is raised if no tuple fits; an empty
        file gives an empty list.
        """
        names = list(next((own for own in unnamed if len(own) == len(first)), ()))
        if first and not names:
            forms = ", or ".join(", ".join(own) for own in unnamed)
            count = f"no header, and {len(first)} field{'s' * (len(first) > 1)} per line"
            raise InputError(f"{self.file}, line {line}: {count}", remedy=f"write {forms}")
        return names

    def column(self, name: str) -> Column:
        """Read a column as an array (K,) of integers, doubles or texts (type object).

        It has integers if all cells are whole numbers, doubles if all are numbers, else texts.
        """
        at = self.names.index(name)
        cells = [row[at] for _, row in self.rows()]
        for kind in (np.int64, float):
            try:
                return np.array([*map(int if kind is np.int64 else float, cells)], kind)
            except (ValueError, OverflowError):
                continue
        return np.array(cells, object)

    def numbers(self, names: Sequence[str], *, finite: bool = True) -> Array:
        """Read columns of numbers side by side (K, columns).

        An InputError, which names line and cell, is raised for a cell that is not a number and,
        with ``finite``, for one that is infinite or NaN.
        """
        places = [self.names.index(name) for name in names]
        values = self._loaded(places)
        if values is None:
            values = np.array([self._parsed(line, row, places) for line, row in self.rows()])
        wrong = ~np.isfinite(values).all(axis=1)
        if finite and wrong.any():
            at = int(np.argmax(wrong))
            line, row = next(islice(self.rows(), at, None))
            k = places[int(np.argmin(np.isfinite(values[at])))]
            raise InputError(self._no_number(line, k, row[k]), at=at)
        return values

    def where(self, row: int) -> str:
        """Name the file and the line of a row, counted from 0: ``run.csv, line 3``."""
        return f"{self.file}, line {next(islice(self.rows(), row, None))[0]}"

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Yield the line number and the cells of each row below the header.

        Lines whose cells are all empty are skipped. InputError is raised if a line does not have as
        many cells as the header.
        """
        size = len(self.names)
        for line, row, _ in self._records():
            if line == self._header or not any(map(str.strip, row)):
                continue
            if len(row) != size:
                like = "the first line" if self._header is None else "the header"
                raise InputError(
                    f"{self.file}, line {line}: {len(row)} fields, but {like} has {size}; "
                    "write one field per column"
                )
            yield line, row

    def save(self, path: Path, new: Mapping[str, NewCells], removed: Collection[str]) -> Path:
        """Write the file to ``path``, with new cells, without columns ``removed``; return the path.

        All other cells, empty lines, quotes and line ends stay as they are.
        """
        names = [*self.names, *(name for name in new if name not in self.names)]
        cells = [
            (names.index(name), cells.rows, _texts(cells.values)) for name, cells in new.items()
        ]
        kept = [i for i, name in enumerate(names) if name not in removed]
        more = names[len(self.names) :]
        out = io.StringIO()
        k = 0
        for line, row, raw in self._records():
            body = raw.rstrip("\r\n")
            if any(map(str.strip, row)):
                written = _raw_cells(body)
                if line == self._header:
                    written += more
                else:
                    written += [""] * len(more)
                    for place, rows, texts in cells:
                        text = next(texts)
                        if rows[k]:
                            written[place] = text
                    k += 1
                out.write(",".join([written[i] for i in kept]))
                raw = raw[len(body) :]
            out.write(raw)
        start = _BOM if self._data.startswith(_BOM) else b""
        return write_whole(path, start + out.getvalue().encode())

    def _records(self) -> Iterator[tuple[int, list[str], str]]:
        """Yield line number, cells and text of each record, header and empty lines included.

        A record has several lines if a cell contains line breaks; the number is that of the last.
        """
        text = io.TextIOWrapper(io.BytesIO(self._data), "utf-8-sig", newline="")
        raw: list[str] = []

        def lines() -> Iterator[str]:
            for line in text:
                raw.append(line)
                yield line

        reader = csv.reader(lines())
        try:
            for row in reader:
                yield reader.line_num, row, "".join(raw)
                raw.clear()
        except UnicodeDecodeError:
            raise InputError(
                f"cannot read {self.file}: the file is not UTF-8 text; save it as UTF-8"
            ) from None
        except csv.Error as error:
            raise InputError(f"{self.file}, line {reader.line_num}: {error}") from None

    def _name(self, cell: str) -> str:
        return cell if cell in self._known else cell.strip("#\"' \t")

    def _loaded(self, places: Sequence[int]) -> Array | None:
        """Read columns of numbers (K, C) by NumPy, which is fast; None if NumPy cannot parse them.

        ``places`` are the indices of the C columns. If the result is None, the caller parses the
        cells one by one.
        """
        text = io.TextIOWrapper(io.BytesIO(self._data), "utf-8-sig", newline="")
        kinds = [(f"c{i}", float if i in places else "U1") for i in range(len(self.names))]
        one = len(set(places)) == len(self.names)
        for _ in range(self._header or 0):
            text.readline()
        try:
            rows = np.loadtxt(
                text,
                dtype=float if one else kinds,
                delimiter=",",
                comments=None,
                quotechar='"',
                ndmin=2 if one else 1,
            )
        except ValueError:
            return None
        if one:
            return rows[:, places] if rows.shape[1] == len(self.names) else None
        return np.stack([rows[f"c{i}"] for i in places], axis=1)

    def _parsed(self, line: int, row: list[str], places: Sequence[int]) -> list[float]:
        for k in places:
            if not _is_number(row[k]):
                raise InputError(self._no_number(line, k, row[k]))
        return [float(row[k]) for k in places]

    def _no_number(self, line: int, place: int, cell: str) -> str:
        name = self.names[place]
        return f"{self.file}, line {line}: {name} = {cell!r} is not a finite number; correct it"


def _is_blank_separated(row: list[str]) -> bool:
    words = row[0].split() if len(row) == 1 else []
    return len(words) > 1 and all(map(_is_number, words))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _raw_cells(body: str) -> list[str]:
    """Split a line of a CSV file at its commas; each cell keeps its quotes and blanks."""
    return body.split(",") if '"' not in body else _CELL.findall(body)


def _texts(values: Array) -> Iterator[str]:
    """Yield each number of an array (K, 1) as text that reads back as the same number."""
    for k in range(0, len(values), _BLOCK):
        yield from map(repr, values[k : k + _BLOCK].ravel().tolist())


def _csv_text(columns: Mapping[str, Column]) -> bytes:
    """Format columns as the bytes of a CSV file.

    A column of several numbers per row becomes ``name_0``, ``name_1``, and so on. Rows are written
    in blocks, which keep the memory small.
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


# ---- arrays


class _Arrays(Table):
    """Table of a .npz file, one column per array; scalars stay in the file, but are no columns."""

    def __init__(self, file: Path) -> None:
        self.file = file
        try:
            with np.load(io.BytesIO(read_bytes(file, _LARGEST)), allow_pickle=False) as arrays:
                self._arrays = {name: arrays[name] for name in arrays.files}
        except _NO_NPZ as error:
            raise InputError(f"cannot read {file}: {error}") from None
        columns = {name: values for name, values in self._arrays.items() if values.ndim}
        self.widths = {
            name: int(np.prod(values.shape[1:])) if values.dtype.kind in "biuf" else 0
            for name, values in columns.items()
        }
        lengths = {len(values) for values in columns.values()}
        if lengths in (set(), {0}):
            raise InputError(f"{file} contains no frames", remedy="write one row per frame")
        if len(lengths) > 1:
            each = ", ".join(f"{name}: {len(values)}" for name, values in columns.items())
            raise InputError(
                f"{file}: the arrays have different lengths ({each})",
                remedy="write one row per frame in each",
            )

    def column(self, name: str) -> Column:
        """Return the array of that name, with one row per frame."""
        return np.asarray(self._arrays[name])

    def save(self, path: Path, new: Mapping[str, NewCells], removed: Collection[str]) -> Path:
        """Write the file to ``path``, with new cells, without arrays ``removed``; return the path.

        Other arrays keep their type.
        """
        made = {name: array for name, array in self._arrays.items() if name not in removed}
        for name, cells in new.items():
            made[name] = replaced(made.get(name), cells)
        return write_whole(path, _npz_bytes(made))


_NO_NPZ = (ValueError, OSError, EOFError, KeyError, AttributeError, zipfile.BadZipFile)


def replaced(old: Column | None, cells: NewCells) -> Column:
    """Return a copy of the column ``old`` (K, …) with new numbers; integers become doubles.

    ``cells`` has the new numbers and the rows to replace; the other rows keep their numbers. Give
    None for ``old`` if the file lacks the column. The values of ``cells`` must then be (K, 1); all
    of them, in every row, are returned as a new column (K,).
    """
    if old is None:
        return cells.values[:, 0]
    wide = old.reshape(len(old), -1).astype(old.dtype if old.dtype.kind == "f" else float)
    wide[np.ix_(cells.rows, np.asarray(cells.at, np.intp))] = cells.values[cells.rows]
    return wide.reshape(old.shape)


def _npz_bytes(arrays: Mapping[str, Column]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in arrays.items():
            plain = values.astype(str) if values.dtype == object else values
            with archive.open(f"{name}.npy", "w", force_zip64=True) as one:
                np.lib.format.write_array(one, plain, allow_pickle=False)
    return out.getvalue()


# ---- Parquet


class _Parquet(Table):
    """Parquet file as a table; a column of lists of equal length has several numbers per row."""

    def __init__(self, file: Path) -> None:
        import pyarrow
        import pyarrow.parquet

        self.file = file
        data = pyarrow.BufferReader(read_bytes(file, _LARGEST))
        try:
            self._table = pyarrow.parquet.read_table(data)
        except (pyarrow.ArrowException, OSError) as error:
            raise InputError(f"cannot read {file}: {error}") from None
        if not len(self._table):
            raise InputError(f"{file} contains no frames", remedy="write one row per frame")
        refuse_twice(self._table.column_names, file)
        self.widths = {name: arrow_width(self._table[name]) for name in self._table.column_names}

    def column(self, name: str) -> Column:
        """Return a column as an array; a missing number is NaN."""
        return arrow_numbers(self._table[name], self.widths[name])

    def save(self, path: Path, new: Mapping[str, NewCells], removed: Collection[str]) -> Path:
        """Write the file to ``path``, with new cells, without columns ``removed``; return the path.

        Columns without new cells keep their type; integers with new cells become doubles. The
        metadata stay, updated for the changed columns.
        """
        return write_whole(path, _parquet_bytes(arrow_replaced(self._table, new, removed)))


def arrow_numbers(column: Any, width: int) -> Column:
    """Convert a column of K rows of an Arrow table to an array; missing numbers become NaN.

    ``width`` is the count of numbers per row, from :func:`arrow_width`. The array is (K,) for a
    column of numbers, and (K, width) for a column of lists. With the width 0, it is (K,), with the
    texts or lists of the column.
    """
    if not width:
        return np.asarray(column.to_numpy())
    flat = np.asarray(_flat(column).to_numpy(zero_copy_only=False))
    return flat if _item(column.type) is None else flat.reshape(len(column), width)


def arrow_replaced(table: Any, new: Mapping[str, NewCells], removed: Collection[str]) -> Any:
    """Return a copy of an Arrow table with new cells and without the columns ``removed``.

    ``new`` has the new cells by column; columns that the table lacks are appended. The metadata of
    the table are kept; descriptions of columns in them are updated, see :func:`_metadata`.
    """
    old = table
    for name, cells in new.items():
        if name in old.column_names:
            at = table.schema.get_field_index(name)
            numbers = arrow_numbers(table[name], arrow_width(table[name]))
            values = _changed(table[name], replaced(numbers, cells), cells)
            field = table.schema.field(at).with_type(values.type)
            table = table.set_column(at, field, values)
        else:
            table = table.append_column(name, _arrow_columns({name: cells.values[:, 0]})[name])
    table = table.drop_columns([name for name in removed if name in table.column_names])
    return table.replace_schema_metadata(_metadata(table, old))


def _changed(column: Any, values: Column, cells: NewCells) -> Any:
    """Make the Arrow array of a changed column from its numbers after the change.

    ``values`` (K, …) are these numbers, from :func:`replaced`. ``column`` is the column before the
    change, and ``cells`` has the rows that are replaced; in the other rows, missing numbers stay
    missing. A column of integers becomes one of doubles.
    """
    import pyarrow

    missing = _flat(column).is_null().to_numpy(zero_copy_only=False).reshape(len(column), -1)
    missing[np.ix_(cells.rows, np.asarray(cells.at, np.intp))] = False
    flat = pyarrow.array(values.ravel(), mask=missing.ravel())
    if _item(column.type) is None:
        return flat
    wide = pyarrow.FixedSizeListArray.from_arrays(flat, values.shape[1])
    return wide.cast(_with_item(column.type, flat.type))


def _item(kind: Any) -> Any:
    """Return the type of the items if ``kind`` is the type of an Arrow list, else None."""
    from pyarrow import types

    lists = (types.is_list, types.is_large_list, types.is_fixed_size_list)
    return kind.value_type if any(test(kind) for test in lists) else None


def _with_item(kind: Any, item: Any) -> Any:
    """Return the type of the Arrow list ``kind`` with items of the type ``item``."""
    import pyarrow

    field = kind.value_field.with_type(item)
    if pyarrow.types.is_large_list(kind):
        return pyarrow.large_list(field)
    size = kind.list_size if pyarrow.types.is_fixed_size_list(kind) else -1
    return pyarrow.list_(field, size)


def arrow_width(column: Any) -> int:
    """Count the numbers per row of a Parquet column; 0 for text and for lists of unequal length."""
    import pyarrow
    import pyarrow.compute

    item = _item(column.type)
    kind = column.type if item is None else item
    types = pyarrow.types
    if not (types.is_floating(kind) or types.is_integer(kind) or types.is_boolean(kind)):
        return 0
    if item is None:
        return 1
    lengths = pyarrow.compute.min_max(pyarrow.compute.list_value_length(column)).as_py()
    even = lengths["min"] == lengths["max"] and not column.null_count
    return int(lengths["min"]) if even else 0


def _flat(column: Any) -> Any:
    """Join the chunks of a Parquet column to one flat Arrow array.

    If the cells of the column are lists, the array has the items of all lists in order.
    """
    whole = column.combine_chunks()
    if _item(column.type) is None:
        return whole
    return whole.flatten()


def _metadata(table: Any, old: Any) -> dict[bytes, bytes] | None:
    """Return the metadata to write with a changed Parquet ``table``.

    ``old`` is the table before the change. If ``old`` has no metadata, the result is None. In the
    metadata, the library ``datasets`` stores a description of each column, its feature. If the
    features do not match the columns, ``datasets`` ignores them or refuses the file. So the
    features of removed columns are removed, and features of new columns are added. If the numbers
    of a column became doubles, its feature is changed.
    """
    metadata = old.schema.metadata
    if not metadata or b"huggingface" not in metadata or table.schema.equals(old.schema):
        return metadata
    said = json.loads(metadata[b"huggingface"])
    features = said.get("info", {}).get("features", {})
    for name in set(features) - set(table.column_names):
        del features[name]
    for name in table.column_names:
        if name not in old.column_names:
            features[name] = {"dtype": "float64", "_type": "Value"}
        elif name in features and table.field(name).type != old.field(name).type:
            _value_of(features[name])["dtype"] = "float64"
    return metadata | {b"huggingface": json.dumps(said).encode()}


def _value_of(feature: Any) -> Any:
    """Return the innermost part of a feature, the dictionary that describes one number.

    A feature is the description of a column by the library ``datasets``. For a column of lists, it
    contains the feature of the items.
    """
    if isinstance(feature, list):
        return _value_of(feature[0])
    return _value_of(feature["feature"]) if "feature" in feature else feature


def _parquet_bytes(table: Any) -> bytes:
    import pyarrow
    import pyarrow.parquet

    out = io.BytesIO()
    try:
        pyarrow.parquet.write_table(table, out)
    except pyarrow.ArrowException as error:  # as null lists of a fixed size, before pyarrow 26
        raise InputError(
            f"pyarrow {pyarrow.__version__} cannot write this table: {error}",
            remedy="use another version of pyarrow, or save an .npz file",
        ) from None
    return out.getvalue()


def _arrow_columns(columns: Mapping[str, Column]) -> dict[str, Any]:
    """Convert columns, by name, to Arrow arrays; several numbers per row become lists."""
    import pyarrow

    made = {}
    for name, values in columns.items():
        wide = values.reshape(len(values), -1)
        made[name] = pyarrow.array(values if values.ndim == 1 else wide.ravel())
        if values.ndim > 1:
            made[name] = pyarrow.FixedSizeListArray.from_arrays(made[name], wide.shape[1])
    return made
