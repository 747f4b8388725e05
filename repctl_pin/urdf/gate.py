"""The gatekeeper: a robot file is checked strictly here, before any other library sees it.

Pinocchio answers most bad files with "not a valid URDF model", accepts others in silence (an axis of zero
length, a link with two parents) and crashes on a few. Here each is one line that names the element, its
line, what is wrong and what to do.
"""

from __future__ import annotations

import contextlib
import copy
import io
import logging
import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lxml import etree

from ..errors import UrdfError
from .checks import axis_of, check, leader
from .xml import one_line, parse

MAX_BYTES = 5_000_000
"""The largest file read: over twenty times the largest robot of example-robot-data."""

NO_LIMIT = 1e3
"""What ``Description.xml`` says where a joint has no limit; limits beyond it count as none."""


MANY_TURNS = 4 * math.pi
"""A limit of a revolute joint beyond this may be meant in degrees."""


@dataclass(frozen=True)
class Joint:
    """One joint, as plain data.

    ``lower``, ``upper`` (rad or m) and ``velocity`` (rad/s or m/s) are infinite where there is no limit;
    ``mimic`` names the joint that this one copies, as ``multiplier · q + offset``; ``line`` is where it stands
    in the file.
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


@dataclass(frozen=True)
class Description:
    """What a URDF says, after it has passed every check.

    Attributes
    ----------
    root : str
        The link nothing carries.
    meshes : tuple of str
        Visual mesh files, as written in the file, each once.
    notes : tuple of str
        What was read kindly, or looks wrong: joints without a range, a mimic joint whose leader's name lacks
        its prefix, limits that may be in degrees.
    xml : str
        The URDF as Pinocchio should read it: continuous joints are revolute ones with limits of
        ±``NO_LIMIT``, so that every joint but planar and floating ones is one number; relative mesh names are
        absolute; what is neither link, joint nor material is gone.
    """

    name: str
    path: Path
    joints: tuple[Joint, ...]
    links: tuple[str, ...]
    root: str
    meshes: tuple[str, ...]
    notes: tuple[str, ...]
    xml: str


def read_urdf(path: str | Path) -> Description:
    """Read and check a URDF.

    Raises
    ------
    UrdfError
        In one line: the file, the line and the element, what is wrong, and the remedy.
    """
    path = Path(path)
    try:
        robot = parse(_read(path))
        root = check(robot)
        notes: list[str] = []
        links, joints, meshes = _plain_data(robot)
        elements = {e.get("name"): e for e in robot.findall("joint")}
        found = tuple(_joint(elements[name], joint, elements, notes) for name, joint in joints.items())
        notes += _degrees(found)
    except UrdfError as error:
        raise UrdfError(one_line(f"{path}: {error}")) from error
    return Description(
        name=robot.get("name"),
        path=path,
        joints=found,
        links=links,
        root=root,
        meshes=meshes,
        notes=tuple(notes),
        xml=_for_pinocchio(robot, found, path.absolute().parent),
    )


def _read(path: Path) -> bytes:
    """Read a regular file of a sane size."""
    try:
        if path.is_file():
            with path.open("rb") as file:
                data = file.read(MAX_BYTES + 1)
        elif path.is_dir():
            raise UrdfError("is a folder; give the .urdf file inside it")
        elif path.exists():
            raise UrdfError("is not a regular file; give a .urdf file")
        else:
            raise UrdfError("no such file; check the path (`repctl robots` lists the robots known by name)")
    except OSError as error:
        raise UrdfError(f"cannot be read ({error.strerror}); check the path and its permissions") from error
    if len(data) > MAX_BYTES:
        raise UrdfError(f"is larger than {MAX_BYTES / 1e6:g} MB; a URDF is some kB of text: keep meshes apart")
    return data


def _plain_data(robot: etree._Element) -> tuple[tuple[str, ...], dict[str, Any], tuple[str, ...]]:
    """Links, joints by name, and visual mesh names, as yourdfpy reads them.

    It is given a copy with only what it is asked for: it edits what it reads, and stumbles over materials
    and shapes.
    """
    asked = copy.deepcopy(robot)
    for element in asked.findall("material") + asked.findall("link/*"):
        if element.tag != "visual" or element.find("geometry/mesh") is None:
            element.getparent().remove(element)
    for element in asked.findall("link/visual/material"):
        element.getparent().remove(element)
    with _quiet():
        import yourdfpy

        text = io.BytesIO(etree.tostring(asked))
        model = yourdfpy.URDF.load(text, load_meshes=False, build_scene_graph=False).robot
    meshes = [visual.geometry.mesh.filename for link in model.links for visual in link.visuals]
    return (
        tuple(link.name for link in model.links),
        {joint.name: joint for joint in model.joints},
        tuple(dict.fromkeys(meshes)),
    )


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silence yourdfpy and trimesh, which log what they cannot find."""
    loggers = [logging.getLogger(name) for name in ("yourdfpy", "yourdfpy.urdf", "trimesh")]
    before = [logger.disabled for logger in loggers]
    for logger in loggers:
        logger.disabled = True
    try:
        yield
    finally:
        for logger, disabled in zip(loggers, before, strict=True):
            logger.disabled = disabled


def _joint(element: etree._Element, joint: Any, joints: Collection[str], notes: list[str]) -> Joint:
    """One joint; a missing range or speed limit is none at all, and the notes say so."""
    mimic = None if joint.mimic is None else leader(joint.name, joint.mimic.joint, joints)
    if joint.mimic is not None and mimic != joint.mimic.joint:
        notes.append(f"joint {joint.name!r} mimics {joint.mimic.joint!r}, which is not in this file: read as {mimic!r}")
    lower = upper = float("inf")
    velocity = float("inf")
    if joint.type in ("revolute", "prismatic"):
        lower, upper = joint.limit.lower or 0.0, joint.limit.upper or 0.0
        if lower == upper == 0.0:  # what exporters write where nobody gave a range
            notes.append(f"joint {joint.name!r} has no range (lower = upper = 0): taken as unlimited")
            lower, upper = -float("inf"), float("inf")
    if joint.type != "fixed" and joint.limit is not None and joint.limit.velocity:
        velocity = joint.limit.velocity
    unlimited = joint.type not in ("revolute", "prismatic")
    return Joint(
        name=joint.name,
        kind=joint.type,
        parent=joint.parent,
        child=joint.child,
        axis=axis_of(element),
        lower=-float("inf") if unlimited or lower < -NO_LIMIT else lower,
        upper=float("inf") if unlimited or upper > NO_LIMIT else upper,
        velocity=velocity,
        mimic=mimic,
        line=element.sourceline or 0,
        multiplier=_number(joint.mimic, "multiplier", 1.0),
        offset=_number(joint.mimic, "offset", 0.0),
    )


def _degrees(joints: tuple[Joint, ...]) -> list[str]:
    """Ask about revolute joints that turn by more than two turns to a side."""
    far = {j.name: max(abs(x) for x in (j.lower, j.upper) if math.isfinite(x)) for j in joints if _turns_far(j)}
    if not far:
        return []
    name, limit = max(far.items(), key=lambda item: item[1])
    others = f", {len(far) - 1} more like it" if len(far) > 1 else ""
    return [f"joint {name!r} has a limit of {limit:g} rad{others}: are these degrees? a URDF counts in rad"]


def _turns_far(joint: Joint) -> bool:
    return joint.kind == "revolute" and any(MANY_TURNS < abs(x) < math.inf for x in (joint.lower, joint.upper))


def _number(mimic: Any, name: str, default: float) -> float:
    """A number of a mimic joint; the URDF's default where it is not there."""
    value = getattr(mimic, name, None)
    return default if value is None else float(value)


def _for_pinocchio(robot: etree._Element, joints: tuple[Joint, ...], folder: Path) -> str:
    """Write the URDF that Pinocchio reads."""
    robot = copy.deepcopy(robot)
    elements = {e.get("name"): e for e in robot.findall("joint")}
    for joint in joints:
        element = elements[joint.name]
        for tag in ("limit", "dynamics", "safety_controller", "calibration"):
            for child in element.findall(tag):
                element.remove(child)
        if joint.kind not in ("revolute", "continuous", "prismatic"):
            continue
        if joint.kind == "continuous":
            element.set("type", "revolute")
        limit = etree.SubElement(element, "limit", effort=repr(NO_LIMIT))
        limit.set("lower", repr(max(joint.lower, -NO_LIMIT)))
        limit.set("upper", repr(min(joint.upper, NO_LIMIT)))
        limit.set("velocity", repr(min(joint.velocity, NO_LIMIT)))
    for material in robot.iterfind("link/visual/material"):
        material.set("name", material.get("name", ""))  # a shape whose colour has no name would be lost
    for mesh in robot.iter("mesh"):
        name = mesh.get("filename")
        if "://" not in name and not Path(name).is_absolute():
            mesh.set("filename", str(folder / name))
    return etree.tostring(robot, encoding="unicode")
