"""Display names of an arm's parts, from the links of its URDF.

The chain of a task consists of the joints that move its frame. The elbow joint is the joint in the
middle of the chain that moves most in self-motions, in which the frame rests.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from ...base.arguments import Array
from ...model.length import elbow, in_the_middle
from ...model.task import Task

_WORDS = ("forearm", "elbow", "upper arm", "shoulder", "wrist", "finger", "gripper", "hand", "head",
          "torso")  # fmt: skip

_WORD = 3
"""Minimum number of letters of a word; shorter parts of a name are abbreviations."""


def redundant_part(task: Task) -> str:
    """State what can drift under a task: "elbow position" for a pose task with r = 1.

    For any other task, the text is "configuration", because more than the elbow can move.
    """
    return "elbow position" if (task.m, task.r) == (6, 1) else "configuration"


def part_name(task: Task, q: Array, link: str) -> str:
    """Find a readable name for a link, for sentences about the part of the arm that drifts.

    If the link's name contains a word for a part of an arm, such as ``wrist``, that word is
    returned. A link next to the elbow joint is the ``elbow``. Otherwise the words of the link's
    name are returned, without the robot's name and a prefix that most links share: ``link 4``. If
    the name does not consist of words, it is returned as in the file: ``link arm_2``. With several
    frames, the result includes the side: ``left wrist``.

    Parameters
    ----------
    task
        Task whose chain is the arm.
    q : (n,) array
        Configuration.
    link
        Link of the URDF.
    """
    plain = _words(link).lower().replace("upperarm", "upper arm")
    found = next((word for word in _WORDS if word in plain), None)
    if found is None and link in _elbow_links(task, q):
        found = "elbow"
    if found is not None:
        return f"{_side(link)}{found}" if len(task.frames) > 1 else found
    robot = set(re.findall(r"[a-z]+|\d+", task.robot.name.lower()))
    own = _words(_without_prefix(link, list(task.robot.description.links))).lower()
    kept = [word for word in own.split() if word not in robot or word.isdigit()]
    if kept and kept[-1] == "link" and len(kept) > 1:
        kept = kept[:-1]
    whole = all(len(word) >= _WORD and word.isalpha() for word in kept)
    numbered = len(kept) == 2 and kept[0] == "link" and kept[1].isdigit()
    return " ".join(kept) if kept and (whole or numbered) else f"link {link.removesuffix('_link')}"


def hand_names(task: Task) -> list[str]:
    """Name the frames of a task as hands, by their sides: ``left hand``, ``right hand``.

    The frame of a task of one frame is called ``hand``. If two names would be equal, all frames
    keep their own names.
    """
    if len(task.frames) == 1:
        return ["hand"]
    names = [f"{_side(frame)}hand" for frame in task.frames]
    return names if len(set(names)) == len(names) else list(task.frames)


def _side(link: str) -> str:
    """State on which side a link is, from its name: ``left ``, ``right ``, or an empty text.

    ``l_hand`` counts as left, too. With two arms, the side distinguishes equal parts.
    """
    words = set(re.split("[^a-z]+", _words(link).lower()))
    sides = (side for side in ("left", "right") if words & {side, side[0]})
    return next((f"{side} " for side in sides), "")


def _words(name: str) -> str:
    """Split a link's name into words and numbers: ``panda_link4`` is ``panda link 4``."""
    parted = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return " ".join(re.findall(r"[A-Za-z]+|\d+", parted))


def _without_prefix(link: str, links: Sequence[str]) -> str:
    """Drop the part of a link's name before the first underscore if most links share it.

    That prefix is usually the robot's name: ``panda_link4`` becomes ``link4``. A letter must follow
    the underscore. ``links`` are the names of all links.
    """
    first, _, rest = link.partition("_")
    shared = sum(name.startswith(f"{first}_") for name in links)
    return rest if rest[:1].isalpha() and 2 * shared > len(links) else link


def _elbow_links(task: Task, q: Array) -> tuple[str, ...]:
    """Find the links before and after the elbow joint at q (n,), which are displayed as "elbow".

    The links are the parent and the child of that joint. The result is empty if no joint is in the
    middle of the arm.
    """
    joint = elbow(task, q)
    if not in_the_middle(task, q)[joint]:
        return ()
    name = task.joint_names[joint]
    return next(((j.parent, j.child) for j in task.robot.description.joints if j.name == name), ())
