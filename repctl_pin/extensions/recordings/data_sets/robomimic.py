"""robomimic's data sets: an HDF5 file with a group ``data/demo_0``, ``data/demo_1``, … of arrays.

An array's name is its path below the demonstration, such as ``obs/robot0_joint_pos``. The file is
copied, and only the arrays that change are written. Actions are the recorded commands, such as
those of the hand, the end effector. K is the number of frames (rows).

``NewCells`` are new numbers for one column of a table, with the rows, and the indices in a row, at
which they replace the old ones.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Collection, Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ....base.arguments import Array
from ....base.data_tables import Column, NewCells, replaced
from ....base.errors import InputError, needed
from .data_set import DataSet

_DEMO = re.compile(r"demo_?(\d+)")
_JOINTS = re.compile(r"obs/((robot\d+_)?joint_pos(itions?)?|qpos|q|joints)")
_HAND = ("OSC_", "IK_")
"""Beginnings of the names of robosuite's controllers whose actions command the hand."""


class RobomimicData(DataSet):
    """An HDF5 file of robomimic.

    ``array`` is the name of the array of joints. By default, it is found by a usual name and by its
    width, the number ``n`` of the arm's joints.
    """

    sessions = "demo"
    simulator = ("states",)

    def __init__(self, file: Path, n: int, array: str | None = None) -> None:
        needed("h5py", by="an HDF5 file")
        self.file = file
        with _opened(file) as h5:
            data = h5.get("data")
            self._demos = _demonstrations(data, file)
            sets = {demo: dict(_arrays(data[demo], file)) for demo in self._demos}
            self._ends, known = _sizes(data, self._demos, sets, file)
            self.widths = {"demo": 1} | _widths(sets, np.diff(self._ends))
            self._arguments = known
        found = [name for name in self.widths if _JOINTS.fullmatch(name) and self.widths[name] == n]
        if array is not None:
            found = [name for name in (array, f"obs/{array}") if self.widths.get(name, 0) > 0]
            if not found:
                raise InputError(
                    f"{file}: no array {array!r} of numbers is in every demonstration; "
                    "name another array by joints= (--joints)"
                )
        if len(found) > 1:
            raise InputError(
                f"{file}: several arrays may be the joints: {', '.join(found)}",
                remedy="name the array by joints= (--joints)",
            )
        self.joints = found[0] if found else None
        self.commands = self._controller()

    def column(self, name: str) -> Column:
        """Return the array ``name`` of all demonstrations, joined: (K,) or (K, width)."""
        if name == "demo":
            numbers = np.array([_number(demo) for demo in self._demos])
            return np.repeat(numbers, np.diff(self._ends).astype(int))
        with _opened(self.file) as h5:
            return np.concatenate([h5[f"data/{demo}/{name}"][()] for demo in self._demos])

    def where(self, row: int) -> str:
        """Describe where a row, counted from 0, is stored: its demonstration, and its row there."""
        at = int(np.searchsorted(self._ends, row, side="right")) - 1
        return f"{self.file}, {self._demos[at]}, row {row - int(self._ends[at])}"

    @property
    def clock(self) -> Array:
        """Time of each frame, s, its row number divided by the frame rate: (K,).

        The time goes on from one demonstration to the next, without beginning at 0 again. An
        InputError is raised if the data set gives no rate.
        """
        rate = self._arguments.get("control_freq")
        if isinstance(rate, bool) or not isinstance(rate, (int, float)) or not rate > 0:
            raise InputError(
                f"{self.file} has no times: 'control_freq' is {rate!r} in env_kwargs of the "
                "attribute env_args",
                remedy="set it to the rate, Hz",
            )
        return np.arange(int(self._ends[-1])) / rate

    def write(self, path: Path, new: Mapping[str, NewCells], removed: Collection[str]) -> None:
        """Copy the file, write the arrays that change, and delete others.

        ``new`` has the changed numbers by name of their array; the arrays named in ``removed`` are
        deleted in all demonstrations.
        """
        shutil.copyfile(self.file, path)
        columns = {name: replaced(self.column(name), cells) for name, cells in new.items()}
        with _opened(path, "r+") as h5:
            for demo, (start, end) in zip(self._demos, pairwise(self._ends), strict=True):
                group = h5[f"data/{demo}"]
                for name, values in columns.items():
                    _require_own(group[name], self.file)
                    group[name][...] = values[int(start) : int(end)]
                for name in removed:
                    del group[name]

    def _controller(self) -> str | None:
        """Return ``hand`` if, by robosuite's ``env_args``, actions command the hand, else None."""
        kinds = set(_types(self._arguments.get("controller_configs")))
        arms = {kind for kind in kinds if kind.startswith((*_HAND, "JOINT_"))}
        hand = arms and all(kind.startswith(_HAND) for kind in arms)
        return "hand" if hand else None


def _opened(file: Path, mode: str = "r") -> Any:
    import h5py

    try:
        return h5py.File(file, mode)
    except OSError as error:
        raise InputError(f"cannot read {file}: {error}") from None


def _demonstrations(data: Any, file: Path) -> list[str]:
    """List the names of the demonstrations, such as ``demo_0``, in order of their numbers.

    ``data`` is the group ``data`` of the open file. InputError is raised if it has none.
    """
    import h5py

    names = [] if not isinstance(data, h5py.Group) else [n for n in data if _DEMO.fullmatch(n)]
    if not names:
        raise InputError(
            f"{file} has no groups data/demo_0, data/demo_1, …: it is not a robomimic data set",
            remedy="write each demonstration into such a group",
        )
    return sorted(names, key=_number)


def _number(demo: str) -> int:
    """Return the number in the name of a demonstration's group."""
    return int(demo.removeprefix("demo").removeprefix("_"))


def _arrays(group: Any, file: Path, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (name, (shape, type)) for each array in a group, and in the groups below.

    ``prefix`` is the path of the group, which begins each name. InputError is raised for a link to
    another file, which a copy would not contain.
    """
    import h5py

    for name in group:
        link = group.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            raise InputError(f"{file}: {group.name}/{name} is a link to another file; copy it here")
        item = group[name] if isinstance(link, h5py.HardLink) else None
        if isinstance(item, h5py.Group):
            yield from _arrays(item, file, f"{prefix}{name}/")
        elif isinstance(item, h5py.Dataset):
            yield prefix + name, (item.shape, item.dtype)


def _sizes(
    data: Any, demos: list[str], sets: Mapping[str, Mapping[str, Any]], file: Path
) -> tuple[Array, dict[str, Any]]:
    """Count the frames of each demonstration; return running sums, and robosuite's ``env_kwargs``.

    The sums (D + 1,) begin with 0, for D demonstrations; ``env_kwargs`` is a dict, empty if the
    file has none. ``demos`` are the names of the demonstrations, ``sets`` their arrays by name.
    InputError is raised if the file's attributes ``num_samples`` or ``total`` contradict the
    arrays, or if ``env_args`` is not JSON.
    """
    sizes = []
    for demo in demos:
        shapes = [shape for shape, _ in sets[demo].values() if shape]
        said = data[demo].attrs.get("num_samples", shapes[0][0] if shapes else 0)
        actions = sets[demo]["actions"][0][0] if "actions" in sets[demo] else said
        if actions != said or said < 1:
            raise InputError(
                f"{file}: {demo} has {actions} actions, but num_samples is {said}",
                remedy="write the number of frames into that attribute",
            )
        sizes.append(int(said))
    total = data.attrs.get("total", sum(sizes))
    if total != sum(sizes):
        raise InputError(
            f"{file}: the demonstrations have {sum(sizes)} frames, but total is {total}",
            remedy="write their sum into the attribute total of data",
        )
    try:
        environment = json.loads(data.attrs.get("env_args", "{}"))
    except (ValueError, TypeError):
        raise InputError(
            f"{file}: the attribute env_args of data is not JSON; write JSON, or remove it"
        ) from None
    known = environment.get("env_kwargs") if isinstance(environment, dict) else None
    return np.cumsum([0, *sizes]), known if isinstance(known, dict) else {}


def _widths(sets: Mapping[str, Mapping[str, Any]], sizes: Array) -> dict[str, int]:
    """Count the numbers per row of each array, by its name.

    ``sets`` has (shape, type) by demonstration and by name of the array, ``sizes`` the number of
    frames of each demonstration. The count is 0 unless the array has a row of floats per frame in
    every demonstration.
    """
    widths: dict[str, int] = {}
    first = next(iter(sets.values()))
    for name, (shape, dtype) in first.items():
        rest = shape[1:]
        each = [arrays.get(name) for arrays in sets.values()]
        whole = each == [((int(size), *rest), dtype) for size in sizes]
        rows = whole and dtype.kind == "f" and len(shape) <= 2
        widths[name] = int(np.prod(shape[1:])) if rows else 0
    return widths


def _types(configuration: Any) -> Iterator[str]:
    """Yield the types of all controllers, such as ``OSC_POSE``, in a robosuite configuration.

    The configuration is nested dicts; a type is the text at any key ``type``.
    """
    if not isinstance(configuration, dict):
        return
    for key, value in configuration.items():
        if key == "type" and isinstance(value, str):
            yield value
        else:
            yield from _types(value)


def _require_own(dataset: Any, file: Path) -> None:
    """Raise InputError if an array of the file shares its storage with another name or file."""
    import h5py

    shared = h5py.h5o.get_info(dataset.id).rc > 1 or dataset.is_virtual or dataset.external
    if shared:
        raise InputError(
            f"{file}: {dataset.name} is stored in another array or file, so its numbers cannot be"
            " replaced alone",
            remedy="save it as an array of its own",
        )
