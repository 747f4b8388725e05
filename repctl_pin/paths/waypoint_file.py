"""Reading of waypoints from a CSV file, and the closed path through them.

``CsvTable`` is a CSV file that was read: its header and its lines of cells.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..base.arguments import file_name
from ..base.data_tables import CsvTable, read_csv
from ..base.errors import InputError
from ..model.task import Task
from .polyline import MOST_POINTS, Waypoints, waypoints
from .several_paths import several_paths
from .task_path import TaskPath, renamed

_POINT, _TURN, _TIME = ("x", "y", "z"), ("qx", "qy", "qz", "qw"), ("time",)
_TIMES = {"t": "time"}
_LAYOUTS = (_POINT, _POINT + _TURN, _POINT + _TIME, _POINT + _TURN + _TIME)
_LARGEST = 4_000_000


def read_waypoints(file: str | Path) -> Waypoints:
    """Read waypoints from a CSV file: x, y, z in m, and optionally a quaternion qx, qy, qz, qw.

    Positions and quaternions are in the base frame. A header line can name these columns, and
    ``time``, s, in any order. A file without a header has three or seven columns in the order
    above.

    Returns
    -------
    Waypoints
        ``points`` (P, 3), ``rotations`` and ``times`` if the file has them; an argument of
        :func:`waypoints`.

    Raises
    ------
    InputError
        If the file cannot be read, a line has the wrong number of finite numbers, a quaternion does
        not have length 1, or the time does not increase. The message names the line.

    Examples
    --------
    >>> np.savetxt("loop.csv", [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0]], delimiter=",")  # m
    >>> rp.read_waypoints("loop.csv").points.shape
    (4, 3)
    """
    table = _table(file_name(file))
    return _waypoints(table, {name: name for name in table.names})


def _table(file: str | Path) -> CsvTable:
    """Open a file of waypoints; a file without a header has three or seven columns."""
    return read_csv(file, largest=_LARGEST, unnamed=_LAYOUTS[:2], rows="waypoints")


def _waypoints(table: CsvTable, columns: Mapping[str, str]) -> Waypoints:
    """Read the waypoints of one frame, and check them.

    ``columns`` maps the names of quantities, such as ``x``, to the frame's columns in the table,
    such as ``left.x``. InputError names the line if an entry is no number, a quaternion does not
    have length 1, or the time does not increase.
    """
    file = table.file
    named = _known(columns, file)
    values = dict(zip(named, table.numbers([*named.values()]).T, strict=True))
    points = np.stack([values[name] for name in _POINT], axis=1)
    if len(points) - 1 > MOST_POINTS:
        raise InputError(
            f"{file} contains {len(points)} waypoints; reduce them to at most {MOST_POINTS}"
        )
    rotations = None
    if "qw" in values:
        quaternions = np.stack([values[name] for name in _TURN], axis=1)
        sizes = np.linalg.norm(quaternions, axis=1)
        if (off := np.abs(sizes - 1) > 1e-2).any():
            at = int(np.argmax(off))
            raise InputError(
                f"{table.where(at)}: the quaternion has length {sizes[at]:.3g}; "
                "normalise it, in the order qx, qy, qz, qw"
            )
        rotations = np.array([pin.Quaternion(q).normalized().matrix() for q in quaternions])
    times = values.get("time")
    if times is not None and (late := np.diff(times) <= 0).any():
        where = table.where(int(np.argmax(late)) + 1)
        raise InputError(f"{where}: the time must increase from line to line; correct it")
    return Waypoints(points, rotations, times, tuple(line for line, _ in table.rows()))


def waypoint_path(file: str, blend: float) -> Callable[[Task, ArrayLike], TaskPath]:
    """Read a file of waypoints, and return a function ``(task, q0) → path`` through them.

    Positions are in m, in the base frame. ``blend`` is the radius of rounded corners, m; 0 keeps
    the corners. Without quaternions in the file, a frame keeps its orientation at q0. In a file for
    several frames, each has its own columns, ``left.x, left.y, left.z``. The text before the dot is
    the frame's name or a part of the name, see :func:`_frame_of`. A frame without columns stands
    still; columns without a dot belong to the first frame.

    Raises
    ------
    InputError
        If the file cannot be read, or its points are not a closed path.
    """
    where = file_name(file)
    spec = file + (f":blend={blend:.15g}" if blend else "")
    # report errors before a robot is loaded
    table = _table(where)
    made = {
        frame: _through(_waypoints(table, columns), where.name, spec, blend)
        for frame, columns in _by_frame(table).items()
    }

    def path_of(task: Task, q0: ArrayLike) -> TaskPath:
        own = {_frame_of(text, task, where): path for text, path in made.items()}
        if len(own) < len(made):
            raise InputError(
                f"{where}: {' and '.join(made)} name the same frame",
                remedy="use one name for all columns of a frame",
            )
        path = several_paths(task, q0, [own.get(frame) for frame in task.frames])
        return path if path.spec else renamed(path, spec=spec)

    return path_of


def _through(
    table: Waypoints, name: str, spec: str, blend: float
) -> Callable[[Task, ArrayLike], TaskPath]:
    """Return the function ``(task, q0) → path`` through the waypoints of one frame.

    The path depends on task and q0 only if the file has no orientations: the frame then keeps its
    orientation at q0. ``name`` is the path's display name, ``spec`` its value of ``--path`` on the
    command line, and ``blend`` the radius of rounded corners, m.
    """
    corners = () if blend else tuple(f"line {line}" for line in table.lines)

    def through(rotation: ArrayLike) -> TaskPath:
        path = waypoints(table.points, rotation, times=table.times, blend=blend, name=name)
        return renamed(path, spec=spec, corners=corners)

    known = through(np.eye(3) if table.rotations is None else table.rotations)
    if table.rotations is not None:
        return lambda task, q0: known
    return lambda task, q0: through(task.placement(q0).rotation)


def _by_frame(table: CsvTable) -> dict[str, dict[str, str]]:
    """Group the columns of a file by frame: frame → {quantity → column}, such as x → ``left.x``.

    The text before the dot names the frame. A column of times belongs to all frames. Columns
    without a dot belong to the empty text, which stands for the first frame. InputError is raised
    if only some columns name a frame.
    """
    cells = {name: name.rpartition(".")[::2] for name in table.names}
    frames = dict.fromkeys(frame for frame, _ in cells.values() if frame)
    common = [own for frame, own in cells.values() if not frame]
    if frames and not {_TIMES.get(name.lower(), name.lower()) for name in common} <= {*_TIME}:
        raise InputError(
            f"{table.file}: column {common[0]!r} names no frame, but others do",
            remedy=f"write it as {next(iter(frames))}.{common[0]}",
        )
    return {
        frame: {own: name for name, (of, own) in cells.items() if of in ("", frame)}
        for frame in frames or ("",)
    }


def _frame_of(text: str, task: Task, file: Path) -> str:
    """Find the frame of a task to which columns ``text.x`` belong; the first for an empty text.

    A frame called ``text`` is preferred, then the frame whose name begins with ``text``, then the
    frame whose name contains ``text``. InputError is raised if there is no such frame, or if the
    choice is ambiguous.
    """
    frames = task.frames
    if text in frames or not text:
        return text or frames[0]
    meant = [frame for frame in frames if frame.startswith(text)]
    meant = meant or [frame for frame in frames if text in frame]
    if len(meant) != 1:
        raise InputError(
            f"{file}: {text!r}, in the names of columns {text}.x …, is part of "
            f"{'no' if not meant else 'more than one'} frame's name ({', '.join(frames)})",
            remedy="write a frame's name before the dot, or a part that no other frame's name has",
        )
    return meant[0]


def _known(columns: Mapping[str, str], file: Path) -> dict[str, str]:
    """Check the quantities of a frame's columns, and return ``columns`` with keys in lower case.

    ``columns`` maps each quantity to a column of the file, such as X → ``left.X``. The quantities
    are x, y, z, with or without qx, qy, qz, qw and time, in any order; the key t becomes time.
    InputError is raised for other quantities.
    """
    named = {_TIMES.get(name.lower(), name.lower()): column for name, column in columns.items()}
    if len(named) < len(columns) or not any(set(named) == set(layout) for layout in _LAYOUTS):
        raise InputError(
            f"{file}: the columns are named {', '.join(columns)}; "
            "name them x, y, z (m), and optionally qx, qy, qz, qw and time (s)"
        )
    return named
