"""C99 header and source file of a repeatable inverse or a cell function.

The files are templates filled with sizes, numbers and code of the native library, which is the C
code of this package. A repeatable inverse keeps r potentials, functions of q, constant. Ω is the
region of joint space, or the cell of poses, for which the inverse was designed. The function of a
cell is q = F(x; c), with the pose x and the level c, which is the position along the self-motion.
The chart of the function consists of polynomials; Newton's method computes F with them. The
governor moves the arm to any pose and level within all limits, and can stop it within the limits at
every tick. The closing radius is the distance from a start or a path within which closed paths are
proved to close: to end in the configuration that they began in.

``Source`` is the texts of the C header and of the C source file, and parts of the C++ header.
``Bounded`` is a region of joint space that computes how far inside or outside configurations lie.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...._version import __version__
from ....base.arguments import require_type
from ....base.certificate import ClosingRadius
from ....base.errors import InputError
from ....model.several_frames import one_frame
from ....model.task import Task
from ....native import CLOSING, filled_struct
from ....regions import Region
from ....strategies.native_arm import native_arm
from ....strategies.repeatable import Bounded, RepeatableInverse
from ...cells.chart.chart import CellPotentials
from ...cells.function import InverseFunction
from ...cells.geometry.cell import Cell
from ...cells.geometry.sector import Sector
from .c_text import comment, constants, filled, pasted
from .governor import governor_source, torque_code

_MEANING = {
    "pose": "position and orientation: xdot = (v, omega), base axes, m/s and rad/s",
    "axis": "position and tool axis: v in base axes, m/s, "
    "and omega about the frame's own x and y, rad/s",
    "position": "position: xdot = v, base axes, m/s",
    "xy": "x and y of the position: xdot in m/s",
    "xz": "x and z of the position: xdot in m/s",
    "yz": "y and z of the position: xdot in m/s",
}


class Source(NamedTuple):
    """Texts of the C header ``header`` and the C source file ``code``, and parts of the C++ header.

    The parts are classes of the governor, ``governor``, and of the closing radius, ``closing``; the
    latter is empty if the radius is not exported.
    """

    header: str
    code: str
    governor: str
    closing: str


def write_source(
    control: RepeatableInverse | InverseFunction,
    name: str,
    region: Region | None = None,
    *,
    closes: ClosingRadius | None = None,
) -> Source:
    """Write a repeatable inverse or a cell function as C with the prefix ``name_``.

    Returns the texts of the header and the source file, and parts of the C++ header. A cell
    function gives one configuration per pose of a cell, a box of poses.

    Parameters
    ----------
    control
        Inverse with potentials that are polynomials, Fourier series, or their sums; or a cell
        function, which is written together with its inverse.
    name
        Prefix, which must be valid (see :func:`.c_names.checked_name`).
    region
        Design region Ω, which ``name_inside`` checks; by default that of the inverse, or the cell
        of a cell function. Without a region, every q is inside.
    closes
        Closing radius, which ``name_within_closing_radius`` checks; None to leave it out.

    Raises
    ------
    InputError
        If the potentials or the region contain Python functions, which cannot be written as C.
    """
    # a cell function is written with its inverse
    inverse, declared, defined = control, "", ""
    if isinstance(control, InverseFunction):
        inverse = control.inverse
        declared = filled("function.h", name, {})
        defined = _function_code(control, name)
    inverse = require_type(
        inverse, RepeatableInverse, "inverse", "a repeatable inverse, such as design.inverse"
    )
    # tables and native sources of the arm
    task = inverse.task
    kept = _checked_region(inverse, region)
    cell = kept if isinstance(kept, Cell) else None
    arm = native_arm(task, inverse.potentials, kept)
    headers, sources = _native_files(inverse, kept)
    chart = "#define CHART\n\n" if headers else ""
    # values of the placeholders in the templates
    parts = {
        "about": about(control, kept),
        "n": task.n,
        "m": task.m,
        "r": task.r,
        "frames": arm.frames,
        **_frame_sizes(arm),
        "terms": max(part.count for part in arm.held["part"]),
        "declared": chart + pasted("arm.h", *headers, "law.h"),
        "tables": constants(arm, "Arm", f"{name}_tables"),
        "library": pasted("arm.c", *sources, "law.c"),
        "staying": int(cell is not None),
        "stays": "stay_inside = 1" if cell else "stay_inside = 0",
    }
    # sections that are optional
    governed = governor_source(task, name)
    closing = _closing_source(closes, task, name)
    sections = {
        "torque": torque_code(task, name),
        "function": (declared, defined),
        "governor": governed,
        "closing": closing,
    }
    header, code = (
        filled(f"arm.{end}", name, parts | {key: made[i] for key, made in sections.items()})
        for i, end in enumerate("hc")
    )
    return Source(header, code, governed[2], closing[2])


def _checked_region(inverse: RepeatableInverse, region: Region | None) -> Bounded | None:
    """Check that an inverse and its region can be written as C, and return the region.

    The region None stands for the region Ω of the inverse. The result is None if the inverse has no
    region either; every q is then inside. An InputError is raised if the inverse or the region
    cannot be written as C, or if they do not fit each other.
    """
    task = inverse.task
    if task.r < 1:
        raise InputError(
            f"{task!r} has no redundancy, so there are no potentials to write; use a redundant task"
        )
    if isinstance(region, Region) and len(region.center) != task.n:
        raise InputError(
            f"the region has {len(region.center)} joints, but the task has {task.n}",
            remedy="use a region in the joints of the task",
        )
    kept = region_of(inverse, region)
    if isinstance(kept, Cell) and not _own(kept, inverse):
        raise InputError(
            "a cell as the region can be written as C only for the controller that was made from "
            "the function of this cell; use a box, a tube or a workspace box as the region, or an "
            "inverse without a region"
        )
    return kept


def _frame_sizes(arm: Any) -> dict[str, str | int]:
    """Return the sizes of a frame of the task, as numbers or C expressions, by placeholder.

    The placeholders of the template are ``rows``, for the number of task coordinates of a frame;
    ``joints``, for its number of joints; and ``most``, for the largest number of joints of any
    frame of the task. With one frame, all three are constants, so that the compiler can unroll
    loops. With several frames, ``rows`` and ``joints`` are C expressions that read the struct of
    each frame. ``arm`` is the C struct of the task's joint chains.
    """
    if arm.frames == 1:
        return {"rows": "M", "joints": arm.joints, "most": arm.joints}
    most = max(frame.joints for frame in arm.held["frame"])
    return {"rows": "(arm->m)", "joints": "(arm->joints)", "most": most}


def _function_code(function: InverseFunction, name: str) -> str:
    """Write the C code of a cell's function q = F(x; c), to follow the code of its inverse.

    ``name`` is the prefix of all exported C names.
    """
    parts = {
        "library": pasted("function.h", "function_parts.c", "function.c"),
        "keep": int(function.keep_limits),
    }
    return filled("function.c", name, parts)


def _native_files(
    inverse: RepeatableInverse, region: Bounded | None
) -> tuple[list[str], list[str]]:
    """Name the headers and the sources of the native library that a chart requires.

    A chart consists of the polynomials of a cell's function. Both lists are empty unless the
    inverse belongs to a cell's function, or the region is a cell.
    """
    if isinstance(inverse.potentials, CellPotentials) or isinstance(region, Cell):
        return ["chart.h"], ["chart.c"]
    return [], []


def _closing_source(closes: ClosingRadius | None, task: Task, name: str) -> tuple[str, str, str]:
    """Write the parts on the closing radius: of C header, C source and C++ header, in this order.

    ``closes`` is the radius, and ``name`` the prefix of all exported C names. The texts are empty
    if ``closes`` is None. An InputError is raised if the radius is not proved or belongs to another
    kind of task, or if the task has several frames.
    """
    if closes is None:
        return "", "", ""
    one_frame(task, "a closing radius in C")
    if not closes:
        raise InputError(f"closes: {closes.words}", remedy="omit closes=")
    if closes.kind != task.kind:
        raise InputError(
            f"closes= is for {closes.kind} tasks, but the inverse is for {task.kind} tasks",
            remedy="give the closing radius of the design that the inverse belongs to",
        )
    squares = {"square": closes.metres**2, "chord": closes.squared_chord}
    poses = {"p": closes.positions.ravel(), "R": closes.rotations.ravel()}
    made = filled_struct(CLOSING, {}, poses, squares | {"count": len(closes.positions)})[0]
    parts = {
        "words": comment(closes.words.replace("°", " deg")),
        "library": pasted("closing.h", "closing.c"),
        "tables": constants(made, "Closing", f"{name}_closing"),
    }
    header, code, more = (filled(f"closing.{end}", name, parts) for end in ("h", "c", "hpp"))
    return header, code, more


def region_of(inverse: RepeatableInverse, region: Bounded | None) -> Bounded | None:
    """Return the region that ``name_inside`` checks in C.

    If ``region`` is None, the result is the inverse's own region. If that is None, too, every q is
    inside.
    """
    return inverse.region if region is None else region


def _own(cell: Cell, inverse: RepeatableInverse) -> bool:
    """Test whether an inverse is that of a cell function over this very ``cell``.

    Only then can the cell be the region of the inverse in C, because C tests poses with the chart
    of the function.
    """
    if not isinstance(inverse.potentials, CellPotentials):
        return False
    own = inverse.potentials.chart.cell.whole
    same = repr(own) == repr(cell) and np.array_equal(own.widths, cell.widths)
    if not (isinstance(own, Sector) and isinstance(cell, Sector)):
        return same
    return same and all(map(np.array_equal, own.profile, cell.profile))


def about(control: RepeatableInverse | InverseFunction, region: Bounded | None) -> str:
    """Write the comment that begins the C files: robot, frame, task, joints, region, units.

    The region is "none given" if it is None.
    """
    task = control.task
    robot = task.robot
    placed = [
        (comment(one.frame), comment(one.robot.base or "the base"), _MEANING[one.kind])
        for one in task.single_tasks
    ]
    joints = [
        f"q[{i}] {comment(name)}, {'rad' if turns else 'm'}, from {low:g} to {high:g}"
        for i, (name, turns, low, high) in enumerate(
            zip(task.joint_names, task.revolute, task.lower, task.upper, strict=True)
        )
    ]
    lines = [
        f"Repeatable inverse of a redundant arm, written by repctl_pin {__version__}; do not edit.",
        "",
        f"robot   {comment(robot.name)} ({comment(robot.description.path.name)})",
        *(
            line
            for frame, base, meaning in placed
            for line in (f"frame   {frame}, placed in {base}", f"task    {meaning}")
        ),
        f"joints  {joints[0]}",
        *(f"        {line}" for line in joints[1:]),
        f"region  {_region_line(region)}",
        "units   m, rad, s; a q outside the joint limits is accepted",
    ]
    return "\n".join([lines[0], *(f" * {line}".rstrip() for line in lines[1:])])


def _region_line(region: Bounded | None) -> str:
    """Describe Ω in one line, for a C comment: "none given" if it is None."""
    if isinstance(region, Cell):
        return f"the cell {comment(repr(region))}"
    return "none given" if region is None else comment(str(region).replace("±", "+-"))
