"""C99 header and source file of a repeatable inverse or a cell function."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...._version import __version__
from ....arguments import require_type
from ....errors import InputError
from ....model.task import Task
from ....regions import Box, Region, Tube, WorkspaceBox
from ....strategies.repeatable import Bounded, RepeatableInverse
from ...cells.cell import Cell
from ...cells.cell_potentials import CellPotentials
from ...cells.function import InverseFunction
from .cell_function import function_code
from .expressions import Graph, assignments
from .governor import governor_source
from .kinematics import ChainExpressions
from .potentials import potential_functions
from .text import comment, filled, integer, row, table

_MEANING = {
    "pose": "position and orientation: xdot = (v, omega), base axes, m/s and rad/s",
    "axis": "position and tool axis: v in base axes, m/s, "
    "and omega about the frame's own x and y, rad/s",
    "position": "position: xdot = v, base axes, m/s",
    "xy": "x and y of the position: xdot in m/s",
    "xz": "x and z of the position: xdot in m/s",
    "yz": "y and z of the position: xdot in m/s",
}


class _Source(NamedTuple):
    """Texts of the C header and the C source file, and of the governor in the C++ header."""

    header: str
    code: str
    governor: str = ""


def write_source(
    control: RepeatableInverse | InverseFunction,
    name: str,
    region: Region | None = None,
    *,
    governor: bool = False,
) -> _Source:
    """Write a repeatable inverse or a cell function as C with the prefix ``name_``.

    Parameters
    ----------
    control
        Inverse with potentials that are polynomials, Fourier series, or their sums; or a cell
        function, whose inverse is written, too.
    name
        Prefix, which must be valid (see :func:`.text.checked_name`).
    region
        Design region Ω, which ``name_inside`` checks; by default that of the inverse, or the cell
        of a cell function. Without a region, every q is inside.
    governor
        True to write the governor, too.

    Raises
    ------
    InputError
        If the potentials or the region contain Python functions, which cannot be written as C.
    """
    inverse, declared, defined = control, "", ""
    if isinstance(control, InverseFunction):
        inverse, declared, defined = (
            control.inverse,
            filled("function.h", name, {}),
            function_code(control, name),
        )
    inverse = require_type(
        inverse,
        RepeatableInverse,
        "inverse",
        "a repeatable inverse, such as design.inverse",
    )
    task = inverse.task
    if task.r < 1:
        raise InputError(
            f"{task!r} has no redundancy, so there are no potentials to write"
        )
    if isinstance(region, Region) and len(region.center) != task.n:
        raise InputError(
            f"the region has {len(region.center)} joints, but the task has {task.n}",
            remedy="use a region in the joints of the task",
        )
    kept = region_of(inverse, region)
    cell = kept if isinstance(kept, Cell) else None
    if cell is not None and not _own(cell, inverse):
        raise InputError(
            "a cell as Ω can be written as C for the inverse of its own function only; "
            "use a box, a tube or a workspace box, or an inverse without a region"
        )
    potentials = potential_functions(inverse.potentials, task.n, name)
    kind = task.kind if task.kind in ("pose", "axis") else "position"
    rotation = "rotation_free.c" if kind == "position" else "rotation.c"
    parts = ChainExpressions(task).code() | {
        "about": about(control, kept),
        "n": task.n,
        "m": task.m,
        "r": task.r,
        "potentials": "\n".join(potentials).rstrip("\n"),
        "parts": "\n".join(
            f"    {name}_potential_{i}(q, h, V);" for i in range(len(potentials))
        ),
        "error": filled(rotation, name, {})
        + filled(f"error_{kind}.c", name, {"rows": integer(task.rows)}).rstrip("\n"),
        "inside": _inside(kept, task, name).rstrip("\n"),
        "limits": filled("limits.c", name, _limits(task)).rstrip("\n"),
        "staying": int(cell is not None),
        "stays": "stay_inside = 1" if cell else "stay_inside = 0",
    }
    governed = governor_source(task, name, cell) if governor else ("", "", "")
    torque = [filled(f"torque.{end}", name, {}) for end in ("h", "c")]
    header = parts | {
        "torque": torque[0],
        "function": declared,
        "governor": governed[0],
    }
    code = parts | {"torque": torque[1], "function": defined, "governor": governed[1]}
    return _Source(
        filled("arm.h", name, header), filled("arm.c", name, code), governed[2]
    )


def region_of(inverse: RepeatableInverse, region: Bounded | None) -> Bounded | None:
    """Return the region that ``name_inside`` checks: the given one, by default the inverse's own Ω.

    Without either, it is the cell if the inverse is that of a cell function, else None.
    """
    if region is None:
        region = inverse.region
    if region is None and isinstance(inverse.potentials, CellPotentials):
        return inverse.potentials.chart.cell.whole
    return region


def _own(cell: Cell, inverse: RepeatableInverse) -> bool:
    """Test whether an inverse is that of a function over this cell."""
    if not isinstance(inverse.potentials, CellPotentials):
        return False
    own = inverse.potentials.chart.cell.whole
    return repr(own) == repr(cell) and np.array_equal(own.widths, cell.widths)


def _limits(task: Task) -> dict[str, str]:
    """Write the limits of the robot's joints, and C assignments of these joints from q.

    The joints are not q itself if the task has other joint coordinates.
    """
    lower, upper, _ = task.joint_limits
    graph = Graph()
    q = [graph.input(f"q[{i}]") for i in range(task.n)]
    joints = {
        f"joint[{i}]": graph.total(
            graph.number(t) * x for t, x in zip(weights, q, strict=True)
        )
        for i, weights in enumerate(task.coordinate_matrix)
    }
    return {"lower": row(lower), "upper": row(upper), "joints": assignments(joints)}


def about(control: RepeatableInverse | InverseFunction, region: Bounded | None) -> str:
    """Write the header comment: robot, frame, task, joints, region, units, version."""
    task = control.task
    robot = task.robot
    base = "the base" if robot.base is None else comment(robot.base)
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
        f"frame   {comment(task.frame)}, placed in {base}",
        f"task    {_MEANING[task.kind]}",
        f"joints  {joints[0]}",
        *(f"        {line}" for line in joints[1:]),
        f"region  {_of(region)}",
        "units   m, rad, s; a q outside the joint limits is accepted",
    ]
    if task.coordinates is not None:
        lines.append(
            "        q are joint coordinates psi; the joint positions are T psi, T row by row:"
        )
        lines += [
            f"        {', '.join(f'{t:g}' for t in values)}"
            for values in task.coordinates.T
        ]
    return "\n".join([lines[0], *(f" * {line}".rstrip() for line in lines[1:])])


def _of(region: Bounded | None) -> str:
    """Describe a region, for a C comment."""
    if isinstance(region, Cell):
        return f"the cell {comment(repr(region))}"
    return "none given" if region is None else comment(str(region).replace("±", "+-"))


def _inside(region: Bounded | None, task: Task, name: str) -> str:
    """Write the C function that tests whether q is in a region; without one, every q is."""
    if region is None:
        return filled("inside_any.c", name, {})
    if isinstance(region, Cell):
        return filled("inside_cell.c", name, {})
    if isinstance(region, Tube):
        parts = {
            "radius": row(region.radius),
            "count": len(region.samples),
            "samples": table(region.samples),
        }
        return filled("inside_tube.c", name, parts)
    if isinstance(region, Box):
        return filled(
            "inside_box.c",
            name,
            {"center": row(region.center), "half": row(region.half_width)},
        )
    if isinstance(region, WorkspaceBox):
        axes = [axis for axis in task.rows if axis < 3]
        parts = {
            "center": row(region.within.center),
            "half": row(region.within.half_width),
            "count": len(axes),
            "axes": integer(axes),
            "position": row(region.position),
            "width": row(region.half_width),
        }
        return filled("inside_workspace.c", name, parts)
    raise InputError(
        f"a region of type {type(region).__name__} cannot be written as C; "
        "use a box, a tube or a workspace box, or an inverse without a region"
    )
