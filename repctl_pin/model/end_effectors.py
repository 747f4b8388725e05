"""End effectors of a robot: the links at the ends of its arms, before the fingers.

They are offered as task frames if the user names none. A URDF does not mark them, so they are found
by the shape of the tree, the ranges of its joints and the names of its links.

``Description`` is the content of a validated URDF as plain data. ``_Body`` is a rigid body: links
connected by fixed joints, in the tree of a robot. ``Joint`` is a joint of a URDF as plain data: its
kind, links, axis, limits and mimic.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from .urdf import Description, Joint

_TURN, _SLIDE = math.pi, 0.1
"""Maximum range of a finger joint: half a turn, rad, or 0.1 m."""

_FINGER = re.compile(r"finger|thumb|jaw|knuckle|claw|phalan", re.IGNORECASE)
_DIGITS = {"index", "middle", "ring", "little", "pinky", "pinkie"}
"""Words that name fingers, but also other parts; they count only if two of them are in one file."""

_TOOLS = (
    {"tcp", "grasp", "grasping"},
    {"tool", "torch", "spindle"},
    {"ee", "eef", "effector"},
    {"flange"},
)
_HANDS = ({"gripper"}, {"palm"}, {"hand"})
"""Words in the names of end effectors, the best first.

The words of ``_HANDS`` count only as the last word of a name, not counting ``base``, ``link`` and
``frame``.
"""
_SENSORS = (
    "accelerometer asus astra barometer cam camera depth gps gyro gyroscope hokuyo imu kinect "
    "laser led lens lidar livox magnetometer mic microphone multisense optical ouster radar "
    "range rangefinder realsense rgb rgbd scanner sensor sick sonar stereo tof ultrasonic "
    "velodyne xtion zed"
)
"""Words in the names of sensors, and names of makers and products."""


@dataclass(eq=False)
class _Body:
    """Rigid body: links connected by fixed joints, in the tree of bodies of a robot.

    The body's first link is the child of the moving joint before the body, or the root.

    Attributes
    ----------
    links : dict of int
        Links of the body by name, each with the number of fixed joints from the first link to it.
    before : int
        Number of moving joints from the root to the body.
    branches : list of (Joint, Body)
        Moving joints on the body, mimic joints included, each with the body that it moves.
    after : int
        Number of moving joints from the body to the farthest tip.
    narrow : bool
        True if every joint beyond the body has a range of at most half a turn or 0.1 m, mimics
        another joint, or is named as a finger.
    loose : bool
        True if all joints beyond the body are parts of ball joints, which no motor drives.
    named : bool
        True if the joint before the body, or the body's first link, is named as a finger.
    shells : set of str
        Links of the robot that have collision shapes and are not drawn.
    """

    links: dict[str, int]
    before: int
    branches: list[tuple[Joint, _Body]]
    after: int = 0
    narrow: bool = True
    loose: bool = True
    named: bool = False
    shells: frozenset[str] = frozenset()

    @property
    def is_tool(self) -> bool:
        """True if a link of the body is named as a tool."""
        return any(set.union(*_TOOLS) & set(words(link)) for link in self.links)

    @property
    def is_hand(self) -> bool:
        """True if the arm ends at this body: more than half of its longest branches are fingers.

        The longest branches are those with the most joints in a row.
        """
        fingers = [
            self._is_finger(joint, tip)
            for joint, tip in self.branches
            if 1 + tip.after == self.after
        ]
        return 2 * sum(fingers) > len(fingers)

    def _is_finger(self, joint: Joint, tip: _Body) -> bool:
        """Test whether a branch of the body is a finger, as defined in :func:`arm_ends`.

        ``joint`` is the first joint of the branch, and ``tip`` the body that it moves.
        """
        if not (_moves_little(joint, tip) and tip.narrow and 1 + tip.after <= self.before):
            return False
        last = tip.after == 0
        return (
            len(self.branches) > 1  # other branches beside it
            or joint.mimic is not None
            or (last and joint.kind == "prismatic")
            or (last and "gripper" in words(joint.name))
            or tip.named
            # a tool link precedes it
            or self.is_tool
        )


def arm_ends(description: Description) -> list[_Body]:
    """Find the bodies at which arms, legs and heads end, without fingers, in the order of the file.

    An arm ends at a **hand**: a body at which more than half of the longest branches are fingers.
    The longest branches are those with the most joints in a row. A finger is a branch with at most
    as many joints in a row as lie between the root and the body. Each of its joints has a range of
    at most half a turn or 0.1 m, mimics another joint, or is named as a finger. In addition, at
    least one of these holds: the body has other branches; the first joint of the branch is a mimic
    joint or is named as a finger; the body is named as a tool; or the branch has one joint, which
    is prismatic or named as a gripper.

    If every joint is named as a finger, the robot is a finger, and ends at its tip. An arm also
    ends at a link named as a tool beyond which there are only ball joints: a load that hangs from
    it.
    """
    below: dict[str, list[Joint]] = {}
    for joint in description.joints:
        below.setdefault(joint.parent, []).append(joint)
    digits = _digits(description)
    shells = frozenset(shape.link for shape in description.collisions)
    shells -= {shape.link for shape in description.shapes}
    root = _Body({description.root: 0}, 0, [], shells=shells)
    bodies = [root]
    links = [(description.root, root)]
    for link, body in links:  # extended in the loop; parents come before children
        for joint in below.get(link, ()):
            if joint.kind == "fixed" and joint.mimic is None:
                body.links[joint.child] = body.links[link] + 1
                links.append((joint.child, body))
            else:
                named = _says_finger(joint, digits)
                tip = _Body({joint.child: 0}, body.before + 1, [], named=named, shells=shells)
                body.branches.append((joint, tip))
                bodies.append(tip)
                links.append((joint.child, tip))
    for body in reversed(bodies):
        body.after = max((1 + tip.after for _, tip in body.branches), default=0)
        body.narrow = all(_moves_little(joint, tip) and tip.narrow for joint, tip in body.branches)
        body.loose = all(
            joint.name in description.balls and tip.loose for joint, tip in body.branches
        )
    return _ends(root, whole=all(body.named for body in bodies[1:]))


def _ends(root: _Body, *, whole: bool) -> list[_Body]:
    """List the bodies at which a branch of the tree ends, from ``root`` on, in the file's order.

    These are bodies without branches, hands, and tools from which a load hangs, with only ball
    joints beyond them. A hand is a body at which more than half of the longest branches are
    fingers. ``whole`` is True if every joint is named as a finger, so that the whole robot is a
    finger. The search then does not end at hands, but goes on to the tip.
    """
    ends, todo = [], [root]
    while todo:
        body = todo.pop()
        hangs = body.loose and body.is_tool
        if not body.branches or hangs or (body.is_hand and not whole):
            ends.append(body)
        else:
            todo.extend(tip for _, tip in reversed(body.branches))
    return ends


def task_links(body: _Body) -> list[str]:
    """Sort a body's links by how well their names suit an end effector, the best one first.

    Among links with equally good names, the farthest out comes first. All links of a body move
    together; only their names show which of them is meant as the tool's frame. Links that only
    carry collision shapes are left out, unless the body has no others.
    """
    meant = [link for link in body.links if not _only_collides(link, body)] or list(body.links)
    return sorted(meant, key=lambda link: (rank(link), -body.links[link]))


def _only_collides(link: str, body: _Body) -> bool:
    """Test by its name whether a link only holds the collision shapes of another link.

    Such a link has collision shapes and is not drawn. In addition, its name contains ``collision``,
    or begins with the name of another link of ``body``, as ``link7_sc`` does. So a link ``tool0``
    with a collision shape is not such a link.
    """
    extends = any(link != other and link.startswith(other) for other in body.links)
    return link in body.shells and (extends or "collision" in words(link))


def is_sensor(link: str) -> bool:
    """Test whether a link is named as a sensor, such as a camera.

    Such a link is offered as a task frame only if there is no other.
    """
    return not set(_SENSORS.split()).isdisjoint(words(link))


def words(name: str) -> list[str]:
    """Split a name into lower-case words.

    ``panda_hand_tcp`` gives panda, hand and tcp, ``LeftPalm`` left and palm, and ``tool0`` tool.
    """
    return [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)]


def rank(link: str) -> int:
    """Rank a link by its name as an end effector: 0 is the best; fingers and sensors are last."""
    spoken = [word for word in words(link) if word not in ("link", "frame")]
    if len(spoken) > 1 and spoken[-1] == "base":  # gripper_left_base_link
        spoken = [word for word in spoken[:-1] if word not in ("left", "right")]
    known = [not tool.isdisjoint(spoken) for tool in _TOOLS] + [
        not hand.isdisjoint(spoken[-1:]) for hand in _HANDS
    ]
    if is_sensor(link) or _FINGER.search(link):
        return len(known) + 1
    return known.index(True) if any(known) else len(known)


def _moves_little(joint: Joint, tip: _Body) -> bool:
    range_ = joint.upper - joint.lower
    return (
        joint.mimic is not None
        or range_ <= (_SLIDE if joint.kind == "prismatic" else _TURN)
        or tip.named
    )


def _says_finger(joint: Joint, digits: set[str]) -> bool:
    names = (joint.name, joint.child)
    return any(_FINGER.search(name) or digits & set(words(name)) for name in names)


def _digits(description: Description) -> set[str]:
    """Collect the words for fingers, such as ``index``, in the names of a URDF's links.

    The set is empty if there is only one such word, because it can have another meaning. The root
    is not searched.
    """
    found = _DIGITS & {word for joint in description.joints for word in words(joint.child)}
    return found if len(found) > 1 else set()
