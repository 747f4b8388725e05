"""C code of the governor, which keeps the limits at run time.

See :class:`repctl_pin.motion.Governor`.
"""

from __future__ import annotations

import numpy as np

from ....model.task import Task
from ...cells.cell import Cell
from ...cells.sector import Sector
from .. import governor_law as law
from .. import leaf_direction
from .. import target_joints as joints
from ..governor_plans import MOST, MOST_SAMPLES, SAMPLES, STRIDE
from ..joint_polynomials import LONG, MOST_PIECES, NODES, SHORT
from .text import filled, integer, row, table, value

_LIFT = {
    "pose": """    (void)R;
    for (i = 0; i < 6; i++) twist[i] = rate[i];""",
    "axis": """    for (i = 0; i < 3; i++) {
        twist[i] = rate[i];
        twist[3 + i] = R[3 * i] * rate[3] + R[3 * i + 1] * rate[4];
    }""",
    "position": """    (void)R;
    for (i = 0; i < ARM_M; i++) twist[arm_rows[i]] = rate[i];""",
}


_VECTOR = {
    "pose": "    for (i = 0; i < 3; i++) w[i] = y[3 + i];\n",
    "axis": "    const double *R = arm_cell_middle.R;\n"
    "    for (i = 0; i < 3; i++) w[i] = R[3 * i] * y[3] + R[3 * i + 1] * y[4];\n",
    "position": "    (void)y;\n    for (i = 0; i < 3; i++) w[i] = 0.0;\n",
}
"""C lines that convert the angular coordinates of a box of poses to a rotation vector."""


def governor_source(
    task: Task, name: str, cell: Cell | None = None
) -> tuple[str, str, str]:
    """Write the governor's parts of the C header, the C source and the C++ header.

    In a cell, the frame moves on straight lines of the cell's coordinates. All three are empty for
    a task in other joint coordinates, which has no governor in C.
    """
    if task.coordinates is not None:
        return "", "", ""
    parts: dict[str, object] = {
        "degree": LONG,
        "pieces": MOST_PIECES,
        "most": MOST,
        "samples": value(SAMPLES),
        "mostsamples": MOST_SAMPLES,
        "course": _course(task, name, cell).rstrip("\n"),
        "stride": value(STRIDE),
        "speed": value(law.SPEED),
        "acceleration": value(law.ACCELERATION),
        "jerk": value(law.JERK),
        "braking": value(law.BRAKING),
        "regular": value(law.REGULAR),
        "longest": value(joints.LONGEST_STEP),
        "contraction": value(joints.CONTRACTION),
        "along": value(leaf_direction.ALONG),
        "push": value(leaf_direction.PUSH),
        "atonce": joints.MOST_AT_ONCE,
        "velocity": row(task.velocity_limit),
        "lower": row(task.lower),
        "upper": row(task.upper),
    }
    for key, degree in (("short", SHORT), ("long", LONG)):
        nodes = NODES[degree]
        more = (0, LONG - degree)  # zeros, to the size of the longer degree
        parts |= {
            key: degree,
            f"share{key}": row(np.pad(nodes.share, more)),
            f"ahead{key}": table(np.pad(nodes.ahead, more)),
            f"monomials{key}": table(np.pad(nodes.monomials, more)),
        }
    return (
        filled("governor.h", name, parts),
        filled("governor.c", name, parts),
        filled("governor.hpp", name, parts),
    )


def _course(task: Task, name: str, cell: Cell | None) -> str:
    """Write the C functions of the coordinates in which the frame moves on straight lines."""
    kind = task.kind if task.kind in _LIFT else "position"
    if cell is None:
        return filled("course_free.c", name, {"lift": _named(_LIFT[kind], name)})
    lower, upper = cell._course_bounds()
    places = task.rows[: min(3, task.m)]
    parts = {
        "places": len(places),
        "rows": integer(places),
        "vector": _named(_VECTOR[kind], name),
    }
    file = "placed_sector.c" if isinstance(cell, Sector) else "placed_box.c"
    placed = filled(file, name, parts).rstrip("\n")
    bounds = {"least": row(lower), "greatest": row(upper)}
    return filled("course_cell.c", name, bounds | {"placed": placed})


def _named(code: str, name: str) -> str:
    return code.replace("ARM_", f"{name.upper()}_").replace("arm_", f"{name}_")
