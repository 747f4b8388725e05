"""Where the arms of a robot end: before the fingers, at the link that a tool is meant to be held
by."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from .validate import Description, Joint

_TURN, _SLIDE = math.pi, 0.1
"""A finger turns by half a turn at most, or slides by a tenth of a metre."""

_FINGER = re.compile(r"finger|thumb|jaw|knuckle|claw", re.IGNORECASE)
_TOOLS = ({"tcp", "grasp", "grasping"}, {"tool"}, {"ee", "eef", "effector"}, {"flange"})
_HANDS = ({"gripper"}, {"palm"}, {"hand"})
"""Words in the names of links that are meant to carry a task, the best first; hands only as the
last word."""
_SENSOR = {
    "accelerometer",
    "camera",
    "optical",
    "depth",
    "rgb",
    "imu",
    "sensor",
    "laser",
    "lidar",
    "range",
    "led",
}


@dataclass(eq=False)
class Body:
    """Links that no joint moves against each other.

    Attributes
    ----------
    links : dict of int
        Its links, from the one that a joint moves outward, each with the fixed joints between the
        two.
    before : int
        Moving joints from the root to it.
    branches : list of (Joint, Body)
        What moves against it, or is said to mimic what does.
    after : int
        Moving joints from it to the farthest tip.
    narrow : bool
        Whether all that moves beyond it moves as little as a finger.
    """

    links: dict[str, int]
    before: int
    branches: list[tuple[Joint, Body]]
    after: int = 0
    narrow: bool = True

    @property
    def is_hand(self) -> bool:
        """Whether most of its longest branches are fingers: the arm ends here, whatever else moves
        on."""
        fingers = [
            self._is_finger(joint, tip)
            for joint, tip in self.branches
            if 1 + tip.after == self.after
        ]
        return 2 * sum(fingers) > len(fingers)

    def _is_finger(self, joint: Joint, tip: Body) -> bool:
        """Whether a branch moves little, has no more joints than the arm before it, and some sign
        says finger."""
        if not (_moves_little(joint) and tip.narrow and 1 + tip.after <= self.before):
            return False
        last = tip.after == 0
        return (
            len(self.branches) > 1  # there are others beside it
            or joint.mimic is not None
            or (last and joint.kind == "prismatic")
            or (last and "gripper" in words(joint.name))
            or _says_finger(joint)
            or any(
                set.union(*_TOOLS) & set(words(link)) for link in self.links
            )  # the tool is before it
        )


def arm_ends(description: Description) -> list[Body]:
    """Find the bodies at which arms, legs and heads end, fingers cut off; in the order of the file.

    An arm ends at a **hand**: a body most of whose longest branches are fingers. A finger moves
    little (half a turn, 0.1 m, or as another joint moves), has no more joints than the arm before
    it, and stands beside others, mimics, slides, is called a finger, or comes after a link that is
    called a tool. Where all is called a finger, the robot is one, and ends at its tip."""
    below: dict[str, list[Joint]] = {}
    for joint in description.joints:
        below.setdefault(joint.parent, []).append(joint)
    root = Body({description.root: 0}, 0, [])
    bodies, links = [root], [(description.root, root)]
    for link, body in links:  # grows as it goes: parents come before children
        for joint in below.get(link, ()):
            if joint.kind == "fixed" and joint.mimic is None:
                body.links[joint.child] = body.links[link] + 1
                links.append((joint.child, body))
            else:
                tip = Body({joint.child: 0}, body.before + 1, [])
                body.branches.append((joint, tip))
                bodies.append(tip)
                links.append((joint.child, tip))
    for body in reversed(bodies):
        body.after = max((1 + tip.after for _, tip in body.branches), default=0)
        body.narrow = all(_moves_little(joint) and tip.narrow for joint, tip in body.branches)
    whole = all(_says_finger(joint) for joint in description.joints if joint.kind != "fixed")
    ends, todo = [], [root]
    while todo:
        body = todo.pop()
        if not body.branches or (body.is_hand and not whole):
            ends.append(body)
        else:
            todo.extend(tip for _, tip in reversed(body.branches))
    return ends


def task_links(body: Body) -> list[str]:
    """List a body's links, the one that is best to move first: by what its name says, then by how
    far out it is."""
    return sorted(body.links, key=lambda link: (_rank(link), -body.links[link]))


def is_sensor(link: str) -> bool:
    """Say whether a link is called a camera, or the like: it could carry a task, but is not meant
    to."""
    return not _SENSOR.isdisjoint(words(link))


def words(name: str) -> list[str]:
    """Take a name apart: ``panda_hand_tcp``, ``tool0`` and ``LeftPalm`` end with tcp, tool and
    palm."""
    return [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)]


def _rank(link: str) -> int:
    spoken = [word for word in words(link) if word not in ("link", "frame")]
    known = [not tool.isdisjoint(spoken) for tool in _TOOLS] + [
        not hand.isdisjoint(spoken[-1:]) for hand in _HANDS
    ]
    if is_sensor(link) or _FINGER.search(link):
        return len(known) + 1
    return known.index(True) if any(known) else len(known)


def _moves_little(joint: Joint) -> bool:
    range_ = joint.upper - joint.lower
    return (
        joint.mimic is not None
        or range_ <= (_SLIDE if joint.kind == "prismatic" else _TURN)
        or _says_finger(joint)
    )


def _says_finger(joint: Joint) -> bool:
    return any(_FINGER.search(name) for name in (joint.name, joint.child))
