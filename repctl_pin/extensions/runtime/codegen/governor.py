"""C code of the governor and of the torque law, for the exported files.

The code consists of files of the native library, which Python also uses, and of their structs under
the names of the exported header.
"""

from __future__ import annotations

import re

import numpy as np

from ....model.task import Task
from ....motion.limits import limits_of_file
from .c_text import filled, initialiser, pasted

_GOVERNOR = "straight_lines.c", "joint_plan.c", "target_joints.c", "governor.c"


def governor_source(task: Task, name: str) -> tuple[str, str, str]:
    """Write the governor's parts of the C header, the C source and the C++ header, in this order.

    ``name`` is the prefix of the exported names, and ``task`` the task of the inverse.
    """
    structs, types = _structs("governor.h", name)
    acceleration, jerk = limits_of_file(task, "acceleration"), limits_of_file(task, "jerk")
    parts = {
        "structs": structs,
        "types": types,
        "library": pasted("governor.h", *_GOVERNOR),
        "velocity": initialiser(task.velocity_limit),
        "acceleration": initialiser(np.where(np.isfinite(acceleration), acceleration, 0.0)),
        "jerk": initialiser(jerk if np.isfinite(jerk).all() else np.full(task.n, np.inf)),
    }
    header, code, more = (filled(f"governor.{end}", name, parts) for end in _ENDINGS)
    return header, code, more


def torque_code(task: Task, name: str) -> tuple[str, str]:
    """Write the torque law's parts of the C header and the C source, in this order.

    ``name`` is the prefix of the exported names.
    """
    structs, types = _structs("torque.h", name)
    parts = {
        "structs": structs,
        "types": types,
        "library": pasted("torque.h", "torque.c"),
        "stiffness": initialiser(np.where(task.kind.linear, 1000.0, 50.0)),
    }
    header, code = (filled(f"torque.{end}", name, parts) for end in _ENDINGS[:2])
    return header, code


_ENDINGS = "h", "c", "hpp"


def _structs(file: str, name: str) -> tuple[str, str]:
    """Write the structs of the library header ``file`` under the names of an exported header.

    A struct ``State`` becomes ``name_state``, so that two exports can be linked together. Return
    two texts: the renamed structs, and the C lines (typedefs and macros) that define the library's
    names by the new names.
    """
    text = pasted(file)
    inner = text[text.index("#ifndef EXPORTED\n") : text.index("#endif")]
    lines = inner.splitlines()[1:]
    big, own = name.upper(), re.findall(r"(?m)^} (\w+);", inner)
    found = [line for line in lines if not line.startswith("#define MOST")]
    macros = re.findall(r"(?m)^#define (?!MOST)(\w+)", inner)
    public = "\n".join(re.sub(r"^ +", lambda to: 2 * to[0], line) for line in found)
    for known in [*own, "Pose"]:
        public = re.sub(rf"\b{known}\b(?! of)", f"{name}_{known.lower()}", public)
    for macro in macros:
        public = re.sub(rf"\b{macro}\b", f"{big}_{macro}", public)
    public = re.sub(r"\bMOST_(?=(N|M|FRAMES)\b)", f"{big}_", public)
    lines = [f"#define {macro} {big}_{macro}" for macro in macros]
    lines += [f"typedef {name}_{known.lower()} {known};" for known in own]
    return public.strip("\n") + "\n", "\n".join(lines) + "\n"
