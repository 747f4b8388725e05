"""C++ header with a repeatable inverse as solvers of Orocos KDL."""

from __future__ import annotations

from ..arguments import Array
from ..inverse_function import InverseFunction
from ..robot.task import Task
from ..strategies.repeatable import RepeatableInverse
from .text import filled, row


def kdl_header(
    control: RepeatableInverse | InverseFunction, name: str, about: str, start: Array
) -> str:
    """Write the header: a velocity solver, and a position solver that evaluates F or iterates.

    Parameters
    ----------
    control
        The inverse or the cell's function.
    name
        Prefix of the exported names.
    about
        Comment with robot, frame and joints.
    start : (n,) array
        Configuration around which the solvers compare a chain with the arm.
    """
    task = control.task
    solver = "kdl_function.hpp" if isinstance(control, InverseFunction) else "kdl_newton.hpp"
    parts = {
        "about": about,
        "names": "{" + ", ".join(map(_quoted, task.joint_names)) + "}",
        "start": row(start),
        "rates": _rates(task),
        "solver": filled(solver, name, {}).rstrip("\n"),
    }
    return filled("arm_kdl.hpp", name, parts)


def _rates(task: Task) -> str:
    """Write the task's velocity ẋ, from the twist of the tip in base axes."""
    lines = [f"        xdot[{i}] = v_in({row});" for i, row in enumerate(task.rows) if row < 3]
    if task.kind == "pose":
        lines += [f"        xdot[{i}] = v_in({i});" for i in range(3, 6)]
    if task.kind == "axis":  # ω along the frame's own x and y
        lines += ["        Pose x{};", "        if (placement(q, x) != Status::ok)"]
        lines += ["            return error = E_UNDEFINED;"]
        for k in range(2):
            total = " + ".join(f"x.R[{3 * i + k}] * v_in({3 + i})" for i in range(3))
            lines.append(f"        xdot[{3 + k}] = {total};")
    return "\n".join(lines)


def _quoted(text: str) -> str:
    """Write a C string: ASCII, other bytes of its UTF-8 form as octal escapes."""
    plain = (
        chr(b) if chr(b).isalnum() or chr(b) in "_-. /" else f"\\{b:03o}" for b in _bytes(text)
    )
    return '"' + "".join(plain) + '"'


def _bytes(text: str) -> bytes:
    return text.encode("utf-8", "surrogateescape")
