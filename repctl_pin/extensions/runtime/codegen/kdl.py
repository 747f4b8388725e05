"""C++ header with a repeatable inverse as solvers of Orocos KDL, for programs built on KDL.

n is the number of joints. The function F of a cell, a box of poses, gives one configuration per
pose.
"""

from __future__ import annotations

from ....base.arguments import Array
from ....model.task import Task
from ....strategies.repeatable import RepeatableInverse
from ...cells.function import InverseFunction
from .c_text import filled, initialiser


def kdl_header(
    control: RepeatableInverse | InverseFunction, name: str, about: str, start: Array
) -> str:
    """Write the C++ header with a velocity solver and a position solver for Orocos KDL.

    The position solver evaluates F if ``control`` is a cell function; otherwise it iterates. For a
    task of several frames, the header only states that it has no solvers, because a chain of KDL
    has one tip.

    Parameters
    ----------
    control
        The inverse or the cell's function.
    name
        Prefix of the exported names.
    about
        Comment with robot, frame and joints.
    start : (n,) array
        Configuration near which the solvers compare the user's KDL chain with the arm.
    """
    task = control.task
    if len(task.frames) > 1:
        return filled("frames_kdl.hpp", name, {"about": about})
    solver = "kdl_function.hpp" if isinstance(control, InverseFunction) else "kdl_newton.hpp"
    parts = {
        "about": about,
        "start": initialiser(start),
        "rates": _rates(task),
        "solver": filled(solver, name, {}).rstrip("\n"),
    }
    return filled("arm_kdl.hpp", name, parts)


def _rates(task: Task) -> str:
    """Write the C++ lines that convert the tip's twist (v, ω), in base axes, to ẋ of the task.

    A task commands some of the six numbers, or ω about the tool's own x and y axes.
    """
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


def quoted(text: str) -> str:
    """Write a text, such as the name of a joint, as a C string literal.

    Bytes other than ASCII letters, digits and ``_`` become octal escapes.
    """
    return '"' + "".join(map(_escaped, text.encode("utf-8", "surrogatepass"))) + '"'


def _escaped(byte: int) -> str:
    plain = chr(byte).isascii() and (chr(byte).isalnum() or chr(byte) == "_")
    return chr(byte) if plain else f"\\{byte:03o}"
