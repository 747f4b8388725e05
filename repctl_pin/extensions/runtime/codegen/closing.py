"""C code of the closing radius: a file of the native library, and the poses as its constants."""

from __future__ import annotations

from ....certificate import ClosingRadius
from ....errors import InputError
from ....model.task import Task
from ....native import CLOSING, filled_struct
from .constants import constants
from .text import comment, filled, pasted


def closing_source(
    closes: ClosingRadius | None, task: Task, name: str
) -> tuple[str, str, str]:
    """Write the closing radius' parts of the C header, the C source and the C++ header.

    All three are empty without a closing radius.
    """
    if closes is None:
        return "", "", ""
    if not closes:
        raise InputError(
            f"closes: {closes.words}",
            remedy="omit closes=",
        )
    if closes.kind != task.kind:
        raise InputError(
            f"closes is of {closes.kind} tasks, but the inverse of {task.kind}",
            remedy="give the closing radius of the design that the inverse belongs to",
        )
    squares = {"square": closes.metres**2, "chord": closes.squared_chord}
    poses = {"p": closes.positions.ravel(), "R": closes.rotations.ravel()}
    made = filled_struct(
        CLOSING, {}, poses, squares | {"count": len(closes.positions)}
    )[0]
    parts = {
        "words": comment(closes.words.replace("°", " deg")),
        "library": pasted("closing.h", "closing.c"),
        "tables": constants(made, "Closing", f"{name}_closing"),
    }
    header, code, more = (
        filled(f"closing.{end}", name, parts) for end in ("h", "c", "hpp")
    )
    return header, code, more
