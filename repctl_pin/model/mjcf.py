"""MJCF files and MuJoCo models as URDF text, which is then read and checked like any URDF.

MuJoCo itself compiles a file, with its defaults, includes, frames and meshes, and with several
joints per body. (Pinocchio's reader silently drops unnamed bodies and those in ``<frame>``, and
shifts ranges by ``ref``.) The tree of bodies is then written as links and joints. A hinge of MuJoCo
turns about the axis a through an anchor p, from its reference q₀. So it places its body in the
parent at ``X(q) = P T(p) R(a, q − q₀) T(−p)``, with P the placement at q₀, translations T and
rotations R. Bodies, joints and constraints have numbers in MuJoCo's model.

``_Part`` is a link, and the joint from its parent to it, as they are written in the URDF.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from ..base.arguments import Array
from ..base.errors import UrdfError
from .urdf_rules import NO_LIMIT

_FREE, _BALL, _SLIDE, _HINGE = range(4)
_CONNECT, _WELD, _JOINT = range(3)
_OF_SITES = 6
_SPHERE, _CAPSULE, _CYLINDER, _BOX, _MESH = 2, 3, 5, 6, 7
_DRAWN_GROUPS = 3
"""MuJoCo's viewer shows the shapes of groups 0, 1 and 2."""


@dataclass
class _Part:
    """A link ``name``, and the ``joint`` from its parent to it, as they are written in the URDF.

    ``place`` is the placement in the parent link at joint position 0. ``kind`` is ``fixed``,
    ``revolute``, ``continuous``, ``prismatic`` or ``ball``; ``axis``, ``lower`` and ``upper``, rad
    or m, are the joint's. ``mimic`` is (leading joint, multiplier, offset), or None. ``inertia`` is
    (mass in kg, placement of its principal axes, principal moments in kg m²), or None. A shape is
    (``visual`` or ``collision``, placement, attributes of its geometry).
    """

    name: str
    parent: str
    place: pin.SE3
    joint: str = ""
    kind: str = "fixed"
    axis: tuple[float, ...] = (0.0, 0.0, 1.0)
    lower: float = -2 * NO_LIMIT
    upper: float = 2 * NO_LIMIT
    inertia: tuple[float, pin.SE3, tuple[float, ...]] | None = None
    shapes: list[tuple[str, pin.SE3, dict[str, str]]] = field(default_factory=list)
    mimic: tuple[str, float, float] | None = None


def urdf_of_file(path: Path, data: bytes, notes: list[str]) -> bytes:
    """Convert an MJCF file to the text of a URDF, as bytes.

    ``data`` is the content of the file ``path``. Notes on all that is left out, one text each, are
    appended to the list ``notes``.

    Raises
    ------
    UrdfError
        If the file is not valid, or has content that a tree of revolute and prismatic joints cannot
        describe.
    """
    if importlib.util.find_spec("mujoco") is None:
        raise UrdfError(
            "an MJCF file requires mujoco, which is not installed; run `pip install mujoco`"
        )
    import mujoco

    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        said = " ".join(str(error).split())
        raise UrdfError(f"MuJoCo cannot compile the file: {said}; correct it") from error
    folder = path.absolute().parent / _mesh_folder(data)
    return urdf_of_model(model, notes, folder)


def urdf_of_model(model: Any, notes: list[str], folder: Path | None = None) -> bytes:
    """Convert a ``mujoco.MjModel`` to the text of a URDF, as bytes.

    Notes on all that is left out, one text each, are appended to the list ``notes``. ``folder``
    contains the mesh files; None leaves meshes out. UrdfError is raised for content that a tree of
    revolute and prismatic joints cannot describe.
    """
    names = [model.body(b).name or f"body{b}" for b in range(model.nbody)]
    parts = [_Part(names[0], "", pin.SE3.Identity())]
    mimics = _couplings(model, notes)
    for b in range(1, model.nbody):
        parts += _body_parts(model, b, names, mimics)
        notes += _joint_notes(model, b, names[b])
    links = dict(zip(names, (_last(parts, name) for name in names), strict=True))
    left_out = _add_shapes(model, [links[name] for name in names], folder)
    if left_out:
        notes.append(
            f"left out and not checked for collisions: shapes that URDF does not have ({left_out})"
        )
    parts += _site_parts(model, names, {part.name for part in parts})
    if model.ntendon:
        notes.append("left out: tendons, which do not change the kinematics")
    name = bytes(model.names).split(b"\0")[0].decode("utf-8", "replace")
    return _text(name or "mujoco", parts)


def _body_parts(
    model: Any, b: int, names: Sequence[str], mimics: Mapping[str, tuple[str, float, float]]
) -> list[_Part]:
    """Convert body number b to links: one per joint, at least one; the last has the inertia.

    ``names`` are the names of all bodies, and ``mimics`` maps a mimic joint's name to (leading
    joint, multiplier, offset).
    """
    place = _placed(model.body_pos[b], model.body_quat[b])
    above = names[int(model.body_parentid[b])]
    chain = _joints(model, names[b], above, place, _joint_numbers(model, b))
    for part in chain:
        part.mimic = mimics.get(part.joint)
    mass = float(model.body_mass[b])
    if mass > 0:
        at = _placed(model.body_ipos[b], model.body_iquat[b])
        chain[-1].inertia = mass, at, tuple(model.body_inertia[b])
    return chain


def _joint_numbers(model: Any, b: int) -> range:
    """Return the numbers of the joints of body number b."""
    first, count = int(model.body_jntadr[b]), int(model.body_jntnum[b])
    return range(first, first + count)


def _joint_notes(model: Any, b: int, name: str) -> list[str]:
    """List notes, one text on each free joint and on each range of a ball joint of body number b.

    ``name`` is the name of the body. These joints and ranges are left out of the URDF.
    """
    joints = _joint_numbers(model, b)
    free = [j for j in joints if model.jnt_type[j] == _FREE]
    balls = [j for j in joints if model.jnt_type[j] == _BALL and model.jnt_limited[j]]
    return [
        *(f"free joint of body {name!r} read as fixed" for _ in free),
        *(f"left out: the range of ball joint {model.joint(j).name!r}" for j in balls),
    ]


def _site_parts(model: Any, names: Sequence[str], taken: set[str]) -> list[_Part]:
    """Convert sites, which often mark the tool centre, to links fixed to the links of their bodies.

    ``names`` are the names of all bodies. A site whose name is in ``taken``, the names of all
    links, is left out.
    """
    parts = []
    for s in range(model.nsite):
        name, at = model.site(s).name, _placed(model.site_pos[s], model.site_quat[s])
        if name and name not in taken:
            parts.append(_Part(name, names[int(model.site_bodyid[s])], at))
            taken.add(name)
    return parts


def _last(parts: Sequence[_Part], name: str) -> _Part:
    return next(part for part in parts if part.name == name)


def _joints(model: Any, name: str, above: str, place: pin.SE3, joints: range) -> list[_Part]:
    """Convert a body with its joints to a chain of links, the last of which is the body itself.

    A URDF link has one joint, but a MuJoCo body can have several. ``name`` is the body, ``above``
    its parent link, ``place`` its placement in that link, and ``joints`` are the numbers of its
    joints. A free joint is left out. A ball joint is kept, and is split into three joints when the
    URDF is read.
    """
    parts: list[_Part] = []
    for j in joints:
        kind = int(model.jnt_type[j])
        joint = model.joint(j).name or f"joint{j}"
        if kind == _FREE:
            continue
        link = f"{name}/{joint}"
        anchor, axis = np.array(model.jnt_pos[j]), np.array(model.jnt_axis[j])
        at = place * pin.SE3(np.eye(3), anchor)
        if kind == _BALL:
            parts.append(_Part(link, above, at, joint, "ball"))
            above, place = link, pin.SE3(np.eye(3), -anchor)
            continue
        start = float(model.qpos0[model.jnt_qposadr[j]])
        slides = kind == _SLIDE
        back = (
            pin.SE3(np.eye(3), -start * axis)
            if slides
            else pin.SE3(pin.exp3(-start * axis), np.zeros(3))
        )
        limited = bool(model.jnt_limited[j])
        low, high = model.jnt_range[j] if limited else (-2 * NO_LIMIT, 2 * NO_LIMIT)
        kind_name = "prismatic" if slides else "revolute" if limited else "continuous"
        parts.append(_Part(link, above, at * back, joint, kind_name, tuple(axis), low, high))
        above, place = link, pin.SE3(np.eye(3), -anchor)
    if parts and not np.any(place.translation):
        parts[-1].name = name
    else:
        parts.append(_Part(name, above, place))
    return parts


def _couplings(model: Any, notes: list[str]) -> dict[str, tuple[str, float, float]]:
    """Convert equality constraints between two joints to mimic joints.

    Return a dict from the name of a mimic joint to (leading joint, multiplier, offset). Constraints
    that pull a body to a mocap body, a target set by the user, are left out; a text on them is
    added to the list ``notes``.

    Raises
    ------
    UrdfError
        If there is any other equality constraint, or a constraint between joints is not linear.
    """
    found = {}
    for e in range(model.neq):
        if not model.eq_active0[e]:
            continue
        kind, name = int(model.eq_type[e]), model.equality(e).name or f"number {e}"
        if kind in (_CONNECT, _WELD) and _to_a_target(model, e):
            notes.append(f"left out: equality constraint {name!r} with a mocap body")
            continue
        if kind != _JOINT:
            what = {_CONNECT: "connect", _WELD: "weld"}.get(kind, "tendon or flex")
            raise UrdfError(
                f"equality constraint {name!r} ({what}) closes a loop or couples other parts than "
                "joints, but a robot must be a tree; remove it from the MJCF file"
            )
        j, other = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        a = np.array(model.eq_data[e, :5])
        if other < 0 or a[2:].any():
            raise UrdfError(
                f"equality constraint {name!r} is not linear, q₁ = a₀ + a₁ q₂, between two joints; "
                "remove it from the MJCF file"
            )
        start = model.qpos0[model.jnt_qposadr]
        offset = float(start[j] + a[0] - a[1] * start[other])
        mine = model.joint(j).name or f"joint{j}"
        found[mine] = model.joint(other).name or f"joint{other}", float(a[1]), offset
    return found


def _to_a_target(model: Any, e: int) -> bool:
    """Test whether equality constraint number e, of bodies or sites, has a mocap body at one end.

    A mocap body is a target that the user moves, so the constraint is no part of the robot.
    """
    ends = [int(model.eq_obj1id[e]), int(model.eq_obj2id[e])]
    if model.eq_objtype[e] == _OF_SITES:
        ends = [int(model.site_bodyid[site]) for site in ends]
    return any(model.body_mocapid[body] >= 0 for body in ends)


def _add_shapes(model: Any, links: Sequence[_Part], folder: Path | None) -> str:
    """Add the shapes of all bodies to their links; return the types that were left out, as text.

    ``links`` has the link of each body, in the order of the bodies. A shape becomes ``visual`` if
    MuJoCo's viewer shows it, and ``collision`` if it can collide; it can be both. ``folder``
    contains the mesh files; None leaves meshes out.
    """
    left_out = set()
    for g in range(model.ngeom):
        kind, size = int(model.geom_type[g]), model.geom_size[g]
        at = _placed(model.geom_pos[g], model.geom_quat[g])
        shapes = _shapes(kind, size, at)
        if kind == _MESH and folder is not None:
            shapes = _mesh(model, int(model.geom_dataid[g]), at, folder)
        if not shapes:
            left_out.add(
                {0: "plane", 1: "height field", 4: "ellipsoid", 7: "mesh"}.get(kind, "other")
            )
        collides = model.geom_contype[g] or model.geom_conaffinity[g]
        drawn = model.geom_group[g] < _DRAWN_GROUPS
        tags = ["visual"] * bool(drawn) + ["collision"] * bool(collides)
        links[int(model.geom_bodyid[g])].shapes += [
            (tag, *shape) for tag in tags for shape in shapes
        ]
    return ", ".join(sorted(left_out))


def _shapes(kind: int, size: Array, at: pin.SE3) -> list[tuple[pin.SE3, dict[str, str]]]:
    """Convert a MuJoCo shape to a URDF shape: a list of one (placement, attributes), or empty.

    ``kind`` is MuJoCo's type number, ``size`` has its sizes, m: the half edges of a box, else the
    radius and, if any, half the length. ``at`` is the placement on the body. The attributes are
    those of the URDF element, by name; the key ``tag`` has the name of the element, such as
    ``box``. Only spheres, boxes, cylinders and capsules are converted.
    """
    if kind == _SPHERE:
        return [(at, {"tag": "sphere", "radius": repr(float(size[0]))})]
    if kind == _BOX:
        return [(at, {"tag": "box", "size": _row(2 * np.array(size))})]
    if kind not in (_CAPSULE, _CYLINDER):
        return []
    tag = "cylinder" if kind == _CYLINDER else "capsule"
    return [(at, {"tag": tag, "radius": repr(float(size[0])), "length": repr(2 * float(size[1]))})]


def _mesh(model: Any, mesh: int, at: pin.SE3, folder: Path) -> list[tuple[pin.SE3, dict[str, str]]]:
    """Convert a MuJoCo mesh to a URDF shape, undoing MuJoCo's shift to the mesh's centre.

    ``mesh`` is the number of the mesh, ``at`` its placement on the body, and ``folder`` the folder
    of the mesh files. Return a list of one (placement, dict with the URDF's ``tag``, ``filename``
    and ``scale``), empty for a mesh without a file.
    """
    begin = int(model.mesh_pathadr[mesh])
    if begin < 0:
        return []
    file = bytes(model.paths)[begin:].split(b"\0")[0].decode("utf-8", "replace")
    own = _placed(model.mesh_pos[mesh], model.mesh_quat[mesh])
    scale = _row(model.mesh_scale[mesh])
    where = str(folder / file)
    return [(at * own.inverse(), {"tag": "mesh", "filename": where, "scale": scale})]


def _mesh_folder(data: bytes) -> str:
    """Read the name of the mesh folder from the content of an MJCF file; empty if there is none."""
    compiler = _root(data).find("compiler")
    if compiler is None:
        return ""
    return str(compiler.get("meshdir") or compiler.get("assetdir") or "")


def _root(data: bytes) -> etree._Element:
    try:
        return etree.fromstring(data, etree.XMLParser(resolve_entities=False))
    except etree.XMLSyntaxError as error:
        raise UrdfError(f"the file is not valid XML ({error}); correct it") from error


# ---- the text --------------------------------------------------------------------------------


def _placed(position: Array, quaternion: Array) -> pin.SE3:
    """Create a placement from a position, m, and a quaternion in MuJoCo's order (w, x, y, z)."""
    w, x, y, z = np.asarray(quaternion, float) / np.linalg.norm(quaternion)
    return pin.SE3(pin.Quaternion(w, x, y, z).matrix(), np.array(position, float))


def _row(values: Iterable[float]) -> str:
    return " ".join(repr(float(v)) for v in values)


def _origin(above: etree._Element, place: pin.SE3) -> None:
    rpy = pin.rpy.matrixToRpy(place.rotation)
    etree.SubElement(above, "origin", xyz=_row(place.translation), rpy=_row(rpy))


def _text(name: str, parts: Sequence[_Part]) -> bytes:
    """Format links and joints as the bytes of a URDF; ``name`` is the robot's name."""
    robot = etree.Element("robot", name=name)
    for part in parts:
        link = etree.SubElement(robot, "link", name=part.name)
        if part.inertia is not None:
            mass, at, moments = part.inertia
            inertial = etree.SubElement(link, "inertial")
            _origin(inertial, at)
            etree.SubElement(inertial, "mass", value=repr(float(mass)))
            principal = zip(("ixx", "iyy", "izz"), moments, strict=True)
            entries = {name: repr(float(value)) for name, value in principal}
            etree.SubElement(inertial, "inertia", ixy="0", ixz="0", iyz="0", **entries)
        for tag, at, geometry in part.shapes:
            shape = etree.SubElement(link, tag)
            _origin(shape, at)
            rest = {key: value for key, value in geometry.items() if key != "tag"}
            etree.SubElement(etree.SubElement(shape, "geometry"), geometry["tag"], rest)
    for part in parts:
        if part.parent:
            robot.append(_joint_element(part))
    return bytes(etree.tostring(robot))


def _joint_element(part: _Part) -> etree._Element:
    name = part.joint or f"{part.name}_fixed"
    joint = etree.Element("joint", name=name, type=part.kind)
    _origin(joint, part.place)
    etree.SubElement(joint, "parent", link=part.parent)
    etree.SubElement(joint, "child", link=part.name)
    if part.kind in ("fixed", "ball"):
        return joint
    etree.SubElement(joint, "axis", xyz=_row(part.axis))
    none = repr(2.0 * NO_LIMIT)  # MJCF has no limits of speed
    limit = etree.SubElement(joint, "limit", effort="0", velocity=none)
    if part.kind != "continuous":
        limit.set("lower", repr(float(part.lower)))
        limit.set("upper", repr(float(part.upper)))
    if part.mimic is not None:
        leader, multiplier, offset = part.mimic
        numbers = {"multiplier": repr(multiplier), "offset": repr(offset)}
        etree.SubElement(joint, "mimic", joint=leader, **numbers)
    return joint
