"""Reading and strict validation of URDF files, before any other library reads them.

Pinocchio reports most bad files as "not a valid URDF model", silently accepts others (a zero axis,
a link with two parents) and crashes on a few. Here every error is one line with the element, its
line, the fact and the remedy. A note is a text for the user on content that is accepted; an
argument ``notes`` is the list to which a function adds notes.

``Description`` is the content of a validated URDF as plain data. ``Joint`` is a joint of a URDF as
plain data: its kind, links, axis, limits and mimic.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from lxml import etree

from ..base.errors import UrdfError
from .shapes import Shape, shapes_of
from .urdf_rules import (
    LIMITS,
    NO_EFFORT,
    NO_LIMIT,
    SEVERAL,
    axis_of,
    check,
    finite,
    mimic_chain,
    number,
    numbers,
)
from .urdf_xml import bad, expand, line, parse, short

_MAX_BYTES = 5_000_000
"""Maximum size of a file, bytes: over twenty times the largest robot of example-robot-data."""

MAX_SHAPES = 1000
"""Maximum number of drawn shapes: over five times those of the largest robot of
example-robot-data."""

_MANY_TURNS = 4 * math.pi
"""Limit of a revolute joint, rad, above which it may be in degrees, as a note says."""


_LONG = 20.0
"""Distance of two joints, m, above which it may be in millimetres, as a note says."""


@dataclass(frozen=True)
class Joint:
    """Joint of a URDF as plain data.

    ``parent`` and ``child`` are names of links, and ``axis`` is a unit vector in the joint's frame.
    ``lower``, ``upper`` (rad or m), ``velocity``, ``acceleration`` and ``jerk`` (per s, s² and s³)
    are infinite without a limit; ``acceleration`` is the smaller one of the file's ``acceleration``
    and ``deceleration``. ``mimic`` names the independent joint whose position q this joint follows
    at ``multiplier · q + offset``; None for an independent joint. ``line`` is the line in the file.
    """

    name: str
    kind: str
    parent: str
    child: str
    axis: tuple[float, float, float]
    lower: float
    upper: float
    velocity: float
    mimic: str | None
    line: int
    multiplier: float = 1.0
    offset: float = 0.0
    acceleration: float = math.inf
    jerk: float = math.inf


@dataclass(frozen=True)
class Description:
    """Content of a validated URDF, as plain data from which all models are made.

    Attributes
    ----------
    name : str
        Name of the robot.
    path : Path
        The file.
    joints : tuple of Joint
        All joints, fixed ones included; each has at most one coordinate.
    links : tuple of str
        Names of all links.
    root : str
        Root link, which has no parent joint.
    shapes : tuple of Shape
        Visual shapes, at most ``MAX_SHAPES``.
    collisions : tuple of Shape
        All collision shapes of the file.
    meshes : tuple of str
        Visual mesh files, as written in the file, without duplicates.
    notes : tuple of str
        Notes on ignored content and likely errors, such as a joint without a range, a ``<mimic>``
        that names a joint without the robot's prefix, or limits that may be in degrees.
    xml : str
        URDF for Pinocchio, with only joints, links and their inertias. Continuous joints are
        revolute ones with limits of ±``NO_LIMIT``. Planar, ball and floating joints are split, so
        that every joint has one coordinate.
    balls : frozenset of str
        Names of the joints that replace the ball joints of the file, three for each.
    """

    name: str
    path: Path
    joints: tuple[Joint, ...]
    links: tuple[str, ...]
    root: str
    shapes: tuple[Shape, ...]
    collisions: tuple[Shape, ...]
    meshes: tuple[str, ...]
    notes: tuple[str, ...]
    xml: str
    balls: frozenset[str] = frozenset()


def read_urdf(
    path: str | Path, package_dirs: Sequence[str] = (), data: bytes | None = None
) -> Description:
    """Read and check a URDF; return its content as plain data.

    Parameters
    ----------
    path
        The file; a ``.xacro`` file is expanded, and an MJCF file is converted.
    package_dirs
        Folders in which the ``$(find package)`` of a xacro file is looked up.
    data
        URDF text to use instead of the file, which is then not read; ``path`` names it in
        messages.

    Raises
    ------
    UrdfError
        If the file cannot be read or is not a valid URDF; the message names the file, the line, the
        element, the fact and the remedy.
    """
    path = Path(path)
    notes: list[str] = []
    try:
        if data is None:
            data = _read(path, package_dirs)
        if _is_mjcf(data):
            from .mjcf import urdf_of_file

            data = urdf_of_file(path, data, notes)
        robot = parse(data, notes)
        _drop_colors(robot, notes)
        _drop_unknown_limits(robot, notes)
        _read_quaternions(robot, notes)
        root = check(robot)
        _fix_still_followers(robot, notes)
        balls = _split_joints(robot, notes)
        elements = {joint.get("name"): joint for joint in robot.findall("joint")}
        joints = tuple(_joint(element, elements, notes) for element in elements.values())
        notes += _still_notes(elements)
    except UrdfError as error:
        raise UrdfError(_one_line(f"{path}: {error}")) from error
    shapes = shapes_of(robot, "visual")
    if len(shapes) > MAX_SHAPES:
        notes.append(f"only the first {MAX_SHAPES} of {len(shapes)} shapes are drawn")
    return Description(
        name=robot.get("name"),
        path=path,
        joints=joints,
        links=tuple(link.get("name") for link in robot.findall("link")),
        root=root,
        shapes=tuple(shapes[:MAX_SHAPES]),
        collisions=tuple(shapes_of(robot, "collision")),
        meshes=tuple(dict.fromkeys(shape.filename for shape in shapes if shape.filename)),
        notes=tuple(_one_line(n) for n in [*notes, *_degrees(joints), *_millimetres(robot, root)]),
        xml=_for_pinocchio(robot, joints),
        balls=balls,
    )


def check_surroundings(description: Description) -> Description:
    """Check that the URDF of surroundings has only fixed joints, and a collision shape; return it.

    Raises
    ------
    UrdfError
        If a joint moves (the message names it), or there is no collision shape.
    """
    for joint in description.joints:
        if joint.kind != "fixed":
            raise UrdfError(
                f"{description.path}, line {joint.line}: joint {joint.name!r} moves, "
                'but surroundings must be rigid; set its type="fixed"'
            )
    if not description.collisions:
        raise UrdfError(
            f"{description.path}: the surroundings have no <collision>, "
            "so no collision is possible; add collision shapes to the links"
        )
    return description


def _still_notes(elements: Mapping[str, etree._Element]) -> list[str]:
    """Return a note on the joints whose speed limit is 0, which is read as no limit.

    The result is a list of one text; it is empty without such joints. ``elements`` are the XML
    elements of the joints, by name.
    """
    still = [repr(name) for name, element in elements.items() if _no_speed(element)]
    return [f"speed limit 0 of joint {', '.join(still)} read as no limit"] if still else []


def _read(path: Path, package_dirs: Sequence[str]) -> bytes:
    """Read the content of a URDF or MJCF file; a .xacro file is expanded to a URDF.

    ``package_dirs`` are folders in which the ``$(find package)`` of xacro is looked up. UrdfError
    is raised if the path is not that of a readable regular file, or the content is too large for a
    URDF.
    """
    try:
        if path.is_dir():
            raise UrdfError("is a folder; give the .urdf file inside it")
        if not path.exists():
            raise UrdfError(
                "no such file; check the path (`repctl robots` lists the robots known by name)"
            )
        if not path.is_file():
            raise UrdfError("is not a regular file; give a .urdf file")
        if path.suffix == ".xacro":
            data = expand(path, _MAX_BYTES, package_dirs)
        else:
            with path.open("rb") as file:
                data = file.read(_MAX_BYTES + 1)
    except OSError as error:
        raise UrdfError(
            f"cannot be read ({error.strerror}); check the path and its permissions"
        ) from error
    if len(data) > _MAX_BYTES:
        raise UrdfError(
            f"is larger than {_MAX_BYTES / 1e6:g} MB, but a URDF has some kB; "
            "store meshes in files of their own"
        )
    return data


def _is_mjcf(data: bytes) -> bool:
    """Test whether the root element of a file's content is ``<mujoco>``."""
    start = data.find(b"<mujoco")
    return 0 <= start and b"<robot" not in data[:start]


def _joint(
    element: etree._Element, joints: Mapping[str, etree._Element], notes: list[str]
) -> Joint:
    """Read a joint from its XML element.

    ``lower = upper = 0`` counts as no range, with a note in ``notes``. A limit of 0 of speed,
    acceleration or jerk counts as no limit. So do position limits beyond ±1000 rad or m, and speed
    limits beyond 1000 rad/s or m/s. ``joints`` are the elements of all joints by name, among which
    the leader of a mimic joint is found.
    """
    name = element.get("name")
    kind = element.get("type")
    # limits; without an element, there are none
    limit = element.find("limit")
    lower = -math.inf
    upper = math.inf
    velocity = math.inf
    acceleration = math.inf
    jerk = math.inf
    if kind in ("revolute", "prismatic"):
        lower = number(limit, "lower")
        upper = number(limit, "upper")
        if lower == upper == 0.0:  # exporters write this if no range was given
            notes.append(f"joint {name!r} has no range (lower = upper = 0): read as unlimited")
            lower, upper = -math.inf, math.inf
    # speeds: 0 counts as no limit
    if kind != "fixed" and limit is not None:
        velocity = number(limit, "velocity") or math.inf
        slowing = [number(limit, name) for name in ("acceleration", "deceleration")]
        acceleration = min(filter(None, slowing), default=math.inf)
        jerk = number(limit, "jerk") or math.inf
    # the joint that it mimics
    mimic, multiplier, offset = _mimicked(element, joints, notes)
    return Joint(
        name=name,
        kind=kind,
        parent=element.find("parent").get("link"),
        child=element.find("child").get("link"),
        axis=axis_of(element),
        lower=lower if lower >= -NO_LIMIT else -math.inf,
        upper=upper if upper <= NO_LIMIT else math.inf,
        velocity=velocity if velocity <= NO_LIMIT else math.inf,
        mimic=mimic,
        line=element.sourceline or 0,
        multiplier=multiplier,
        offset=offset,
        acceleration=acceleration,
        jerk=jerk,
    )


def _no_speed(element: etree._Element) -> bool:
    """Test whether a joint's speed limit is 0, which exporters write for no limit.

    The result is False for a fixed joint, and for a joint without a speed limit in the file.
    """
    limit = element.find("limit")
    moves = element.get("type") not in ("fixed", None) and limit is not None
    return moves and limit.get("velocity") is not None and number(limit, "velocity") == 0


def _mimicked(
    element: etree._Element, joints: Mapping[str, etree._Element], notes: list[str]
) -> tuple[str | None, float, float]:
    """Find the independent joint that a joint follows, directly or through other mimic joints.

    Return (name, multiplier, offset); (None, 1, 0) if ``element`` is no mimic joint. ``joints`` are
    the elements of all joints by name. If the written name lacks the robot's prefix, which macros
    often omit, the joint with the prefix is meant, with a note in ``notes``.
    """
    chain = mimic_chain(element, joints)
    if not chain:
        return None, 1.0, 0.0
    name = element.get("name")
    (first, leading), following = chain[0], chain[-1][1]
    if leading != first.get("joint"):
        notes.append(
            f"joint {name!r} mimics {first.get('joint')!r}, which is not in this file; "
            f"read as {leading!r}"
        )
    return following, *_line(mimic for mimic, _ in chain)


def _line(mimics: Iterable[etree._Element]) -> tuple[float, float]:
    """Combine a chain of ``<mimic>`` elements into (multiplier, offset).

    The first element is that of the follower, the last one names the independent joint. With q the
    position of this joint, the follower is at multiplier · q + offset.
    """
    multiplier = 1.0
    offset = 0.0
    for mimic in mimics:
        offset += multiplier * number(mimic, "offset")
        multiplier *= number(mimic, "multiplier", 1.0)
    return multiplier, offset


def _fix_still_followers(robot: etree._Element, notes: list[str]) -> None:
    """Convert joints that mimic a fixed joint to fixed joints; add a note on them to ``notes``.

    A fixed joint is at 0, so these joints rest at their mimic offsets. They keep their ``<mimic>``
    elements, by which fingers are recognised. ``robot`` is changed.
    """
    joints = {joint.get("name"): joint for joint in robot.findall("joint")}
    chains = {name: mimic_chain(joint, joints) for name, joint in joints.items()}
    still = {
        name: chain
        for name, chain in chains.items()
        if chain
        and joints[chain[-1][1]].get("type") == "fixed"
        and joints[name].get("type") != "fixed"
    }
    for name, chain in still.items():
        joint = joints[name]
        _, offset = _line(mimic for mimic, _ in chain)
        turns = joint.get("type") != "prismatic"
        moved = offset * np.array(axis_of(joint))
        _move(joint, pin.SE3(pin.exp3(moved), np.zeros(3)) if turns else pin.SE3(np.eye(3), moved))
        joint.set("type", "fixed")
    if still:
        leaders = dict.fromkeys(repr(chain[-1][1]) for chain in still.values())
        notes.append(
            f"read as fixed: {_few(still)}, because {', '.join(leaders)}, the leader, cannot move"
        )


def _degrees(joints: tuple[Joint, ...]) -> list[str]:
    """Return a note on revolute joints with a limit beyond two turns, possibly in degrees.

    The result is a list of one text, which names the largest such limit. It is empty if no limit
    is beyond two turns.
    """
    far = {}
    for joint in joints:
        ends = [abs(x) for x in (joint.lower, joint.upper) if math.isfinite(x)]
        if joint.kind == "revolute" and max(ends, default=0.0) > _MANY_TURNS:
            far[joint.name] = max(ends)
    if not far:
        return []
    name, limit = max(far.items(), key=lambda item: item[1])
    others = f" (and {len(far) - 1} more such limits)" if len(far) > 1 else ""
    return [
        f"joint {name!r} has a limit of {limit:g} rad{others}, possibly in degrees; "
        "URDF angles are in rad"
    ]


def _millimetres(robot: etree._Element, root: str) -> list[str]:
    """Return a note on joints over 20 m from the joint before them, possibly in millimetres.

    The result is a list of one text, which names the largest such distance. It is empty if there
    are fewer than two such joints. Joints on the link ``root`` are not counted, because the robot
    can stand far from the root of its file.
    """
    long = {}
    for joint in robot.findall("joint"):
        origin = joint.find("origin")
        xyz = (numbers(origin, "xyz") if origin is not None else None) or [0.0]
        if math.hypot(*xyz) > _LONG and joint.find("parent").get("link") != root:
            long[joint.get("name")] = math.hypot(*xyz)
    if len(long) < 2:
        return []
    name, length = max(long.items(), key=lambda item: item[1])
    return [
        f"joint {name!r} is {length:g} m from the joint before it (and {len(long) - 1} more such "
        "lengths), possibly in millimetres: URDF lengths are in m; scale all lengths by 0.001"
    ]


def _for_pinocchio(robot: etree._Element, joints: tuple[Joint, ...]) -> str:
    """Return the URDF text for Pinocchio: only joints, links and their inertias.

    ``joints`` are those that were read from the element ``robot``, in the same order; their axes
    and limits replace those of the file, and continuous joints become revolute ones. Visual and
    collision shapes, materials and dynamics are removed. These changes are made in ``robot``
    itself.
    """
    for joint, element in zip(joints, robot.findall("joint"), strict=True):
        effort = [float(limit.get("effort") or 0) for limit in element.findall("limit")]
        for tag in ("axis", "limit", "dynamics", "safety_controller", "calibration"):
            for child in element.findall(tag):
                element.remove(child)
        if joint.kind == "fixed":
            continue
        if joint.kind == "continuous":
            element.set("type", "revolute")
        etree.SubElement(element, "axis", xyz=" ".join(map(repr, joint.axis)))
        limit = etree.SubElement(element, "limit", effort=repr(max(effort, default=0) or NO_EFFORT))
        limit.set("lower", repr(max(joint.lower, -NO_LIMIT)))
        limit.set("upper", repr(min(joint.upper, NO_LIMIT)))
        limit.set("velocity", repr(min(joint.velocity, NO_LIMIT)))
    for look in robot.xpath("link/visual | link/collision | material"):
        look.getparent().remove(look)
    return etree.tostring(robot, encoding="unicode")


def _drop_unknown_limits(robot: etree._Element, notes: list[str]) -> None:
    """Remove limits of −1, which exporters write for unknown limits; add a note on them.

    These are limits of effort, velocity, acceleration, deceleration and jerk; ``robot`` is changed.
    """
    joints: dict[str, None] = {}
    unknown: dict[str, None] = {}
    for limit in robot.findall("joint/limit"):
        for attribute in ("effort", "velocity", "acceleration", "deceleration", "jerk"):
            if finite(limit.get(attribute, "").strip()) == -1:
                del limit.attrib[attribute]
                joints[limit.getparent().get("name") or "without a name"] = None
                unknown[attribute] = None
    if joints:
        notes.append(
            f"limits of −1 were read as not given: {' and '.join(unknown)} of {_few(joints)}"
        )


def _read_quaternions(robot: etree._Element, notes: list[str]) -> None:
    """Replace the attribute ``quat_xyzw`` of every origin, which URDF 1.1 allows, by ``rpy``.

    In a file of an older version, or without a version, the attribute is removed, with a note in
    ``notes``. UrdfError is raised for a quaternion of length 0, and for an origin with both
    attributes. ``robot`` is changed.
    """
    origins = [origin for origin in robot.iter("origin") if origin.get("quat_xyzw") is not None]
    if origins and robot.get("version", "1.0") == "1.0":
        more = f" (and {len(origins) - 1} more)" if len(origins) > 1 else ""
        notes.append(
            f"ignored: quat_xyzw in {line(origins[0])}{more}, because the file does not say that "
            'it is URDF 1.1; write version="1.1" in <robot>'
        )
    for origin in origins:
        if robot.get("version", "1.0") != "1.0":
            if origin.get("rpy") is not None:
                raise bad(origin, "has both rpy and quat_xyzw; delete one of them")
            x, y, z, w = numbers(origin, "quat_xyzw") or [0.0] * 4
            if not math.hypot(x, y, z, w) > 0:
                raise bad(origin, "quat_xyzw is 0; give a unit quaternion")
            turn = pin.Quaternion(w, x, y, z).normalized().matrix()
            origin.set("rpy", _row(pin.rpy.matrixToRpy(turn)))
        del origin.attrib["quat_xyzw"]


def _move(joint: etree._Element, motion: pin.SE3) -> None:
    """Move the ``<origin>`` of a joint's XML element by a transform in the joint's own frame."""
    origin = joint.find("origin")
    if origin is None:
        origin = etree.SubElement(joint, "origin")
    xyz, rpy = (np.array(numbers(origin, name) or (0.0,) * 3) for name in ("xyz", "rpy"))
    place = pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz) * motion
    origin.set("xyz", _row(place.translation))
    origin.set("rpy", _row(pin.rpy.matrixToRpy(place.rotation)))


def _row(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _few(joints: Collection[str]) -> str:
    """Name the first three joints, and count the others: ``joints 'a', 'b', 'c' and 2 more``."""
    named = ", ".join(map(short, list(joints)[:3]))
    more = f" and {len(joints) - 3} more" if len(joints) > 3 else ""
    return f"joint{'s' if len(joints) > 1 else ''} {named}{more}"


def _drop_colors(robot: etree._Element, notes: list[str]) -> None:
    """Remove the colours in ``robot`` that are not four numbers; add a note on each.

    Pinocchio ignores such colours.
    """
    for color in list(robot.iter("color")):
        words = color.get("rgba", "0 0 0 0").split()
        if len(words) != 4 or any(finite(word) is None for word in words):
            notes.append(
                f"ignored: the colour in {line(color)}, "
                f"rgba = {short(color.get('rgba'))} is not 4 numbers"
            )
            color.getparent().remove(color)


def _one_line(text: str) -> str:
    """Convert a text to one line of printable characters; others become U+FFFD."""
    return "".join(c if c.isprintable() else "�" for c in " ".join(text.split()))


# ---- planar and floating joints ----

_Step: TypeAlias = tuple[str, str, tuple[float, ...]]  # suffix, kind, axis

_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_BALL: tuple[_Step, ...] = (
    ("yaw", "continuous", _Z),
    ("pitch", "continuous", _Y),
    ("roll", "continuous", _X),
)
_FLOATING: tuple[_Step, ...] = (
    ("x", "prismatic", _X),
    ("y", "prismatic", _Y),
    ("z", "prismatic", _Z),
    *_BALL,
)


def _split_joints(robot: etree._Element, notes: list[str]) -> frozenset[str]:
    """Replace planar and ball joints by 3 joints, floating joints by 6, with one coordinate each.

    The joints that replace a planar joint translate in the plane normal to its axis, and rotate
    about the axis. The rotations of a floating joint and of a ball joint are yaw, pitch and roll,
    singular where the pitch is ±π/2. A note on each joint that is replaced, and on its limits,
    which are dropped, is added to ``notes``. ``robot`` is changed. Return the names of the joints
    that replace ball joints. UrdfError is raised if a new name is taken.
    """
    balls: list[str] = []
    names = {element.get("name") for element in robot}
    for joint in robot.findall("joint"):
        kind = joint.get("type")
        if kind not in SEVERAL:
            continue
        steps = (
            _planar(axis_of(joint))
            if kind == "planar"
            else _FLOATING
            if kind == "floating"
            else _BALL
        )
        named = [f"{joint.get('name')}_{suffix}" for suffix, _, _ in steps]
        taken = names & {*named, *(f"{name}_link" for name in named)}
        if taken:
            raise bad(
                joint, f"is split into {', '.join(named)}, but {taken.pop()!r} is taken; rename it"
            )
        limit = joint.find("limit")
        dropped = [] if limit is None else [name for name in LIMITS if limit.get(name) is not None]
        without = f"; its {' and '.join(dropped)} limits are dropped" if dropped else ""
        notes.append(
            f"joint {joint.get('name')!r} is {kind}: read as {', '.join(named)}{without}; "
            "to hold them still, lock them, or choose a frame before or a base link beyond them"
        )
        balls += named if steps is _BALL else []
        _replace(robot, joint, steps, named)
    return frozenset(balls)


def _planar(axis: tuple[float, float, float]) -> tuple[_Step, ...]:
    """Return the three joints that replace a planar joint, each as (name suffix, type, axis).

    ``axis`` is the unit normal of the plane. The suffixes are ``x``, ``y`` and ``yaw``, in this
    order. The first two joints are prismatic, along directions in the plane (x and y if the normal
    is z); the third is continuous, about the normal.
    """
    a = np.array(axis)
    u = np.eye(3)[(int(np.argmax(np.abs(a))) + 1) % 3]
    u = u - (u @ a) * a
    u /= np.linalg.norm(u)
    return (
        ("x", "prismatic", (*u,)),
        ("y", "prismatic", (*np.cross(a, u),)),
        ("yaw", "continuous", axis),
    )


def _replace(
    robot: etree._Element, joint: etree._Element, steps: tuple[_Step, ...], names: list[str]
) -> None:
    """Replace a joint by a chain of single-axis joints, with massless links between them.

    ``steps`` has (suffix, type, axis (3,)) of each new joint, and ``names`` its name. The suffix is
    not used here, because the name already ends in it. The chain takes the joint's place in
    ``robot``, and has the joint's line number for messages.
    """
    at = robot.index(joint)
    parent = joint.find("parent").get("link")
    robot.remove(joint)
    for name, (_, kind, axis) in zip(names, steps, strict=True):
        new = etree.Element("joint", name=name, type=kind)
        last = name == names[-1]
        child = joint.find("child").get("link") if last else f"{name}_link"
        etree.SubElement(new, "parent", link=parent)
        etree.SubElement(new, "child", link=child)
        etree.SubElement(new, "axis", xyz=" ".join(repr(float(x)) for x in axis))
        if kind == "prismatic":
            etree.SubElement(new, "limit", lower="-1e16", upper="1e16")
        if name == names[0] and joint.find("origin") is not None:
            new.append(joint.find("origin"))
        added = [new] if last else [new, etree.Element("link", name=child)]
        for element in added:
            element.sourceline = joint.sourceline
            robot.insert(at, element)
            at += 1
        parent = child
