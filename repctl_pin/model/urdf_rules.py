"""Rules for URDF files, checked on a plain XML tree.

Each violated rule raises a UrdfError with the line, the element, the fact and the remedy. Size
limits prevent a bad file from using up memory or time.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence

from lxml import etree

from .urdf_xml import bad, label, line, short

_MAX_JOINTS = 1000
_MAX_DEPTH = 300  # links in a chain; Pinocchio crashes on thousands
_MAX_MOVING = 100  # movable joints in a chain
_MAX_MOVING_IN_ALL = 200  # Pinocchio's memory grows with the cube
_LARGEST = 1e9  # maximum length, mass, … in SI units; a larger limit counts as none

NO_LIMIT = 1e3
"""Magnitude above which a limit counts as none, rad or m, rad/s or m/s.

``Description.xml`` contains it as the limit of a joint without one.
"""

NO_EFFORT = 1e9
"""Effort limit in ``Description.xml`` for a joint without one, N m or N."""

KINDS = ("revolute", "continuous", "prismatic", "fixed", "planar", "floating")

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_UNHANDY = re.compile(r'[,;"]')

SEVERAL = {"planar": 3, "ball": 3, "spherical": 3, "floating": 6}
"""Types of joints with several coordinates, and their number of coordinates. ``ball`` and
``spherical`` mean the same; they are not in the URDF standard."""

_FREEDOM = {"fixed": 0, **SEVERAL}  # coordinates of a joint; else 1

LIMITS = ("lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk")
"""Attributes of a ``<limit>``; the last three are of URDF 1.2."""

# element → attribute → number of values
_NUMBERS: dict[str, dict[str, int]] = {
    "origin": {"xyz": 3, "rpy": 3, "quat_xyzw": 4},
    "axis": {"xyz": 3},
    "limit": dict.fromkeys(LIMITS, 1),
    "dynamics": {"damping": 1, "friction": 1},
    "calibration": {"rising": 1, "falling": 1, "reference_position": 1},
    "safety_controller": {
        "soft_lower_limit": 1,
        "soft_upper_limit": 1,
        "k_position": 1,
        "k_velocity": 1,
    },
    "mimic": {"multiplier": 1, "offset": 1},
    "mass": {"value": 1},
    "inertia": {"ixx": 1, "ixy": 1, "ixz": 1, "iyy": 1, "iyz": 1, "izz": 1},
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
    "mesh": {"scale": 3},
    "color": {"rgba": 4},
}
_SHAPES = ("box", "cylinder", "capsule", "sphere", "mesh")
_NEEDED = {
    ("mass", "value"),
    ("box", "size"),
    ("sphere", "radius"),
    ("cylinder", "radius"),
    ("cylinder", "length"),
}
_NOT_NEGATIVE = _NEEDED | {
    ("capsule", "radius"),
    ("capsule", "length"),
    *(("limit", name) for name in LIMITS[2:]),
}
_NEEDED |= {("inertia", entry) for entry in _NUMBERS["inertia"]}
_ANY_SIZE = ("limit", "safety_controller", "dynamics", "calibration")


def check(robot: etree._Element) -> str:
    """Check all rules on a URDF, given as a plain XML tree; return the name of its root link.

    Raises
    ------
    UrdfError
        If a rule is violated; the message is on the first violation found.
    """
    links = robot.findall("link")
    joints = robot.findall("joint")
    if not links:
        raise bad(
            robot, "the file contains no <link>, so it describes no robot; give the full URDF"
        )
    if not robot.get("name"):
        raise bad(robot, 'the robot has no name; write <robot name="…">')
    if not robot.get("name").isprintable():
        raise bad(robot, "the robot's name contains a control character or a line break; rename it")
    if robot.get("version", "1.0") not in ("1.0", "1.1", "1.2"):
        raise bad(robot, f"version {short(robot.get('version'))} is unknown; write 1.0")
    if max(len(joints), len(links) - 1) > _MAX_JOINTS:
        raise bad(
            robot,
            f"{len(joints)} joints and {len(links)} links exceed the maximum of {_MAX_JOINTS}; "
            "remove some",
        )
    for elements in (links, joints, robot.findall("material")):
        _check_names(elements)
    moving = sum(_freedom(joint) for joint in joints)
    if moving > _MAX_MOVING_IN_ALL:
        raise bad(
            robot,
            f"{moving} movable joints exceed the maximum of {_MAX_MOVING_IN_ALL}; "
            "make some of them fixed",
        )
    names = {link.get("name") for link in links}
    leaders = {joint.get("name"): joint for joint in joints}
    for joint in joints:
        _check_joint(joint, names)
    for joint in joints:
        _check_mimic(joint, leaders)
    root = _check_tree(links, joints)
    for owner in (*links, *robot.findall("material")):
        for element in owner.iter():
            _check_numbers(element)
    for link in links:
        _check_body(link)
    return root


def numbers(element: etree._Element, attribute: str) -> list[float] | None:
    """Read the finite numbers of an attribute, and check their count; None if it is missing.

    The count is that of URDF, such as 3 for ``xyz``. UrdfError is raised for a wrong count, for
    text, and for numbers that are too large.
    """
    text = element.get(attribute)
    if text is None:
        return None
    words = text.split()
    expected = _NUMBERS[element.tag][attribute]
    if len(words) != expected:
        meant = "one number" if expected == 1 else f"{expected} numbers"
        raise bad(element, f"{attribute} = {short(text)} is not {meant}; correct it")
    values = []
    for word in words:
        value = finite(word)
        if value is None or not text.isascii():
            raise bad(
                element,
                f"{attribute} = {short(text)}: {short(word)} is not a finite number; correct it",
            )
        if abs(value) > _LARGEST and element.tag not in _ANY_SIZE:
            raise bad(
                element,
                f"{attribute} = {short(text)} exceeds {_LARGEST:g}, more than any robot has; "
                "correct it",
            )
        values.append(value)
    return values


def number(element: etree._Element, attribute: str, default: float = 0.0) -> float:
    """Read the single number of an attribute; the result is ``default`` if it is missing."""
    return (numbers(element, attribute) or [default])[0]


def finite(word: str) -> float | None:
    """Parse a finite decimal number in URDF notation; None if it is not one.

    Python's float() accepts more, such as ``1_000`` and ``inf``.
    """
    return float(word) if _NUMBER.fullmatch(word) and math.isfinite(float(word)) else None


def axis_of(joint: etree._Element) -> tuple[float, float, float]:
    """Return a joint's unit axis: x if none is given, as URDF defines; (0, 0, 0) for length 0."""
    axis = joint.find("axis")
    x, y, z = (numbers(axis, "xyz") if axis is not None else None) or (1.0, 0.0, 0.0)
    norm = math.hypot(x, y, z)
    return (x / norm, y / norm, z / norm) if norm > 0 else (0.0, 0.0, 0.0)


def _check_names(elements: Sequence[etree._Element]) -> None:
    """Check that elements have unique names that CSV files and Pinocchio can hold.

    UrdfError is raised for the first element without such a name.
    """
    seen: dict[str, etree._Element] = {}
    for element in elements:
        name = element.get("name")
        if not name:
            raise bad(element, "has no name; give it one")
        if name in seen:
            raise bad(
                element,
                f"the {element.tag} in {line(seen[name])} has the same name; rename one of them",
            )
        if not name.isprintable() or (element.tag == "joint" and _UNHANDY.search(name)):
            raise bad(
                element,
                "the name contains a comma, a semicolon, a quote or a line break, "
                "which breaks CSV files; rename it",
            )
        if element.tag == "joint" and name == "universe":
            raise bad(element, "the name is reserved by Pinocchio; rename the joint")
        seen[name] = element


def _check_numbers(element: etree._Element) -> None:
    """Check the numbers of an element, and raise UrdfError for the first violated rule.

    Required numbers must be present, and all must be finite. Sizes, masses, and limits of effort,
    speed, acceleration, deceleration and jerk must not be negative. A mesh must have a filename.
    """
    for attribute in _NUMBERS.get(element.tag, {}):
        values = numbers(element, attribute)
        if values is None:
            if (element.tag, attribute) in _NEEDED:
                raise bad(element, f"has no {attribute}; add it")
        elif (element.tag, attribute) in _NOT_NEGATIVE and min(values) < 0:
            raise bad(
                element, f"{attribute} = {short(element.get(attribute))} is negative; correct it"
            )
    if element.tag == "mesh" and not element.get("filename"):
        raise bad(element, "has no filename; add it, or delete the mesh")


def _check_body(link: etree._Element) -> None:
    """Raise UrdfError if the inertia or a shape of a link lacks a part.

    An ``<inertial>`` must have ``<mass>`` and ``<inertia>``. A visual or collision must have a
    ``<geometry>`` with a known shape, and a capsule a radius and a length. Pinocchio silently
    ignores incomplete inertias and shapes.
    """
    for inertial in link.findall("inertial"):
        for tag in ("mass", "inertia"):
            if inertial.find(tag) is None:
                raise bad(inertial, f"has no <{tag}>; add it, or delete the <inertial>")
    for visible in (*link.findall("visual"), *link.findall("collision")):
        geometry = visible.find("geometry")
        shapes = [] if geometry is None else [child.tag for child in geometry]
        if not shapes or shapes[0] not in _SHAPES:
            what = (
                f"<{shapes[0][:40]}> is not a shape"
                if shapes
                else "has no <geometry> with a shape in it"
            )
            raise bad(visible, f"{what}; choose from {', '.join(_SHAPES)}")
        if shapes[0] == "capsule" and None in (
            geometry[0].get("radius"),
            geometry[0].get("length"),
        ):
            raise bad(geometry[0], "radius or length is missing; give both")


def _check_joint(joint: etree._Element, links: set[str]) -> None:
    """Check a joint's type, links, numbers, axis and limits; raise UrdfError if one is wrong."""
    kind = joint.get("type")
    if kind not in (*KINDS, *SEVERAL):
        what = "has no type" if kind is None else f"type {short(kind)} is unknown"
        raise bad(joint, f"{what}; choose from {', '.join(KINDS)}")
    for end in ("parent", "child"):
        element = joint.find(end)
        if element is None or not element.get("link"):
            raise bad(joint, f'has no {end} link; write <{end} link="…"/>')
        if element.get("link") not in links:
            raise bad(
                element,
                f"there is no link {short(element.get('link'))}; add it, or correct the name",
            )
    for element in joint.iterdescendants():
        _check_numbers(element)
    axis = joint.find("axis")
    limit = joint.find("limit")
    if axis is None and kind == "planar":
        raise bad(joint, "a planar joint requires an <axis>, the normal of its plane; add one")
    if axis is not None and kind not in ("fixed", "floating", "ball", "spherical"):
        norm = math.hypot(*(numbers(axis, "xyz") or (1.0, 0.0, 0.0)))
        if not 1e-9 < norm < 1e9:
            raise bad(axis, f"xyz = {short(axis.get('xyz'))} has no direction; give a unit vector")
    if kind in ("revolute", "prismatic"):
        if limit is None:
            remedy = ", or make the joint continuous" if kind == "revolute" else ""
            raise bad(joint, f"a {kind} joint requires a <limit>; add one{remedy}")
        _check_range(limit)


def _freedom(joint: etree._Element) -> int:
    return _FREEDOM.get(joint.get("type"), 1)


def _check_mimic(joint: etree._Element, joints: Mapping[str, etree._Element]) -> None:
    chain = mimic_chain(joint, joints)
    ends = (joint, joints[chain[-1][1]]) if chain else ()
    several = next((j for j in ends if _freedom(j) > 1), None)
    if several is not None:
        raise bad(
            joint.find("mimic"),
            f"{label(several)} is {several.get('type')} and has several coordinates; "
            "delete the <mimic>",
        )


def mimic_chain(
    joint: etree._Element, joints: Mapping[str, etree._Element]
) -> list[tuple[etree._Element, str]]:
    """List the joints that a joint follows, one after another: (``<mimic>`` element, joint name).

    The first pair has the ``<mimic>`` of ``joint`` and the name of the joint to which it refers;
    the second pair has the ``<mimic>`` of that joint, and so on. The joint named in the last pair
    is independent. The list is empty for an independent joint. ``joints`` are the elements of all
    joints by name. UrdfError is raised for a name that does not exist, and for a loop.
    """
    chain: list[tuple[etree._Element, str]] = []
    seen = {joint.get("name")}
    while (mimic := joint.find("mimic")) is not None:
        written, name = mimic.get("joint"), joint.get("name")
        if written in (None, "", name):
            raise bad(mimic, "does not name another joint; correct it, or delete it")
        following = _leader(name, written, joints)
        if following is None:
            raise bad(
                mimic,
                f"there is no joint {short(written)}; correct the name, or delete the <mimic>",
            )
        chain.append((mimic, following))
        if following in seen:
            raise bad(
                chain[0][0],
                f"joints mimic each other in a loop: {', '.join(map(short, seen))}; "
                "delete one <mimic>",
            )
        seen.add(following)
        joint = joints[following]
    return chain


def _leader(name: str, mimicked: str, joints: Collection[str]) -> str | None:
    """Return the name of the joint that a mimic joint follows; None if no such joint exists.

    ``name`` is the mimic joint, ``mimicked`` the name written in its ``<mimic>``, and ``joints``
    are the names of all joints. Macros often omit the robot's prefix: ``left_index_2``, which
    mimics ``index_1``, follows ``left_index_1`` if there is no joint ``index_1``.
    """
    if mimicked in joints:
        return mimicked
    prefixed = [
        j
        for j in joints
        if j != name and j.endswith(mimicked) and name.startswith(j.removesuffix(mimicked))
    ]
    return prefixed[0] if len(prefixed) == 1 else None


def _check_range(limit: etree._Element) -> None:
    """Check the range of a revolute or prismatic joint; UrdfError if it allows no motion.

    ``lower = upper = 0`` is allowed, because exporters write it for a joint without limits.
    """
    lower = number(limit, "lower")
    upper = number(limit, "upper")
    if lower >= NO_LIMIT or upper <= -NO_LIMIT:
        raise bad(
            limit, f"lower = {lower:g}, upper = {upper:g}: the range is too far from 0; correct it"
        )
    if lower > upper:
        raise bad(limit, f"lower = {lower:g} is above upper = {upper:g}; swap them")
    if lower == upper != 0.0:  # exporters write 0 for both if no range was given
        raise bad(
            limit, f"lower = upper = {lower:g} allows no motion; widen it, or make the joint fixed"
        )


def _check_tree(links: Sequence[etree._Element], joints: Sequence[etree._Element]) -> str:
    """Check that links form a tree with one root and a limited depth; return the root's name.

    UrdfError is raised for a link with two parents, a loop, two roots, or a chain that is too long.
    """
    above: dict[str, etree._Element] = {}
    below: dict[str, list[etree._Element]] = {}
    for joint in joints:
        parent = joint.find("parent").get("link")
        child = joint.find("child").get("link")
        if child in above:
            other = f"{label(above[child])} ({line(above[child])})"
            raise bad(
                joint,
                f"link {short(child)} already has a parent joint, {other}; delete one of them",
            )
        above[child] = joint
        below.setdefault(parent, []).append(joint)
    roots = [link for link in links if link.get("name") not in above]
    if not roots:
        raise bad(
            joints[0], "all links form a loop, so there is no root link; remove a joint of the loop"
        )
    if len(roots) > 1:
        other = f"{label(roots[0])} ({line(roots[0])})"
        raise bad(
            roots[1],
            f"has no parent joint, and neither has {other}; a URDF must have a single root link: "
            "connect the two by a joint",
        )
    connected = _connected(roots[0], below)
    for link in links:
        if link.get("name") not in connected:
            raise bad(above[link.get("name")], "is part of a loop; remove a joint of the loop")
    return str(roots[0].get("name"))


def _connected(root: etree._Element, below: Mapping[str, list[etree._Element]]) -> set[str]:
    """Collect the names of the links connected to the root, which is included.

    ``below`` maps a link's name to the joints whose parent it is. UrdfError is raised for a chain
    with too many links or too many moving joints.
    """
    # links, each with the number of links and of movable joints from the root to it
    reached = [(root.get("name"), 1, 0)]
    for name, depth, moving in reached:  # extended in the loop, so that there is no recursion
        if depth > _MAX_DEPTH:
            raise bad(root, f"a chain has over {_MAX_DEPTH} links; shorten it")
        for joint in below.get(name, ()):
            count = moving + _freedom(joint)
            if count > _MAX_MOVING:
                raise bad(
                    joint, f"a chain has over {_MAX_MOVING} movable joints; make some of them fixed"
                )
            reached.append((joint.find("child").get("link"), depth + 1, count))
    return {name for name, _, _ in reached}
