"""Display names of an arm's parts, from the links of its URDF."""

from __future__ import annotations

import re

import numpy as np

from ...arguments import Array
from ...robot.task import Task

_WORDS = ("forearm", "elbow", "upper arm", "shoulder", "wrist", "finger", "gripper", "hand", "head",
          "torso")  # fmt: skip
_MIDDLE = (0.35, 0.65)
"""Range along the arm, as fractions of its length, in which a joint counts as the elbow."""


def part_name(task: Task, q: Array, link: str) -> str:
    """Find a readable name for a link.

    If the link's name contains a word for a part of an arm, such as ``wrist``, that word is
    returned. A link next to the joint nearest to the middle of the arm is the ``elbow``, if that
    joint is near the middle. Else the link's name without the robot's name is returned: ``link 4``.

    Parameters
    ----------
    task
        Task whose chain is the arm.
    q : (n,) array
        Configuration.
    link
        Link of the URDF.
    """
    words = " ".join(re.findall(r"[A-Za-z]+|\d+", re.sub(r"([a-z])([A-Z])", r"\1 \2", link)))
    plain = words.lower().replace("upperarm", "upper arm")
    found = next((word for word in _WORDS if word in plain), None)
    if found is not None:
        return found
    if link in _elbow_links(task, q):
        return "elbow"
    robot = set(re.findall(r"[a-z]+|\d+", task.robot.name.lower()))
    kept = [word for word in plain.split() if word not in robot or word.isdigit()]
    if kept and kept[-1] == "link" and len(kept) > 1:
        kept = kept[:-1]
    return " ".join(kept) or link


def _elbow_links(task: Task, q: Array) -> tuple[str, ...]:
    """Find the links before and after the joint at the middle of the arm; empty without one."""
    stations = np.vstack([task.joint_origins(q), task.placement(q).translation])
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(stations, axis=0), axis=1)))
    if not along[-1] > 0:
        return ()
    share = along[:-1] / along[-1]
    joint = int(np.argmin(np.abs(share - 0.5)))
    if not _MIDDLE[0] <= share[joint] <= _MIDDLE[1] or joint >= len(task.joint_names):
        return ()
    name = task.joint_names[joint]
    return next(((j.parent, j.child) for j in task.robot.description.joints if j.name == name), ())
