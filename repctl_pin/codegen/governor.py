"""C code of the governor, which keeps the limits at run time.

See :class:`repctl_pin.motion.Governor`.
"""

from __future__ import annotations

import numpy as np

from ..motion import governor_law as law
from ..motion import leaf_direction
from ..motion import target_joints as joints
from ..motion.governor_plans import MOST, MOST_SAMPLES, SAMPLES, STRIDE
from ..motion.joint_polynomials import LONG, MOST_PIECES, NODES, SHORT
from ..robot.task import Task
from .text import filled, row, table, value

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


def governor_source(task: Task, name: str) -> tuple[str, str, str]:
    """Write the governor's parts of the C header, the C source and the C++ header.

    All three are empty for a task in other joint coordinates, which has no governor in C.
    """
    if task.coordinates is not None:
        return "", "", ""
    kind = task.kind if task.kind in _LIFT else "position"
    lift = _LIFT[kind].replace("ARM_", f"{name.upper()}_").replace("arm_", f"{name}_")
    parts: dict[str, object] = {
        "degree": LONG,
        "pieces": MOST_PIECES,
        "most": MOST,
        "samples": value(SAMPLES),
        "mostsamples": MOST_SAMPLES,
        "lift": lift,
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
