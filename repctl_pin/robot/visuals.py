"""What a robot looks like: the shapes its URDF names, and where they stand at a configuration.

Mesh files are found but not read here: whoever draws them reads them. A robot without shapes, and a
link whose mesh is missing, are drawn from the kinematics: links as tubes, joints as cylinders.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, UrdfError
from ..urdf.meshes import find_mesh
from .mechanism import Mechanism
from .skeleton import skeleton

Array = NDArray[np.float64]
Color = tuple[float, float, float, float]

PLAIN: Color = (0.80, 0.82, 0.85, 1.0)
"""The colour of a shape whose URDF names none."""


@dataclass(frozen=True)
class Shape:
    """One visible body, in its own frame.

    Attributes
    ----------
    kind
        ``mesh``, ``box``, ``cylinder``, ``sphere`` or ``capsule``.
    path
        The mesh file; None for the others.
    scale
        Of a mesh, along its own axes; negative where it is mirrored. Never part of a placement.
    size
        box: three edges; cylinder and capsule: radius, length along z; sphere: radius, m.
    color
        Red, green, blue, opacity, 0 to 1.
    textured
        True where the mesh keeps the materials of its own file (the URDF names none).
    """

    name: str
    kind: str
    link: str = ""
    path: Path | None = None
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    size: tuple[float, ...] = ()
    color: Color = PLAIN
    textured: bool = False


@dataclass(frozen=True)
class Visuals:
    """The shapes of a robot and the joints they ride on. Make it with :meth:`Visuals.of`.

    Attributes
    ----------
    shapes
        What to draw.
    missing
        Mesh names, as the URDF writes them, that were not found; those links are drawn as tubes.
    """

    shapes: tuple[Shape, ...]
    missing: tuple[str, ...]
    _model: pin.Model = field(repr=False)
    _joint: NDArray[np.intp] = field(repr=False)  # (S,)
    _on_joint: Array = field(repr=False)  # (S, 4, 4)
    _to_base: Array = field(repr=False)  # (4, 4)

    @classmethod
    def of(cls, robot: Mechanism) -> Visuals:
        """Collect the shapes of a robot, meshes looked up in its ``package_dirs``."""
        links = _link_frames(robot.model)
        riding: list[tuple[Shape, pin.SE3]] = []
        missing: dict[str, str] = {}  # link: mesh name
        for shape, origin, filename in _read_visuals(robot):
            if shape.kind == "mesh" and shape.path is None:
                missing.setdefault(shape.link, filename)
            elif shape.color[3] > 0:
                riding.append((shape, origin))
        moving = any(links[shape.link].parentJoint > 0 for shape, _ in riding)
        bones = skeleton(robot, links, missing if moving else links)
        riding += [(Shape(name, kind, link, None, (1.0, 1.0, 1.0), size, color), M)
                   for name, kind, link, size, color, M in bones]  # fmt: skip
        return cls(
            shapes=tuple(shape for shape, _ in riding),
            missing=tuple(dict.fromkeys(missing.values())),
            _model=robot.model,
            _joint=np.array([links[shape.link].parentJoint for shape, _ in riding], np.intp),
            _on_joint=np.array([(links[s.link].placement * M).homogeneous for s, M in riding]).reshape(-1, 4, 4),
            _to_base=_base_placement(robot).inverse().homogeneous,
        )

    def placements(self, Q: ArrayLike) -> Array:
        """Place every shape at every configuration of the whole robot.

        Parameters
        ----------
        Q
            Configurations (T, nq) of the whole robot (``task.full(q)``).

        Returns
        -------
        (T, S, 4, 4) rigid transforms, m; in the frame of the robot's ``base``, where it has one, as the
        task's placements are. A mesh's scale is not in them.
        """
        Q = np.ascontiguousarray(Q, dtype=float)
        if Q.ndim != 2 or Q.shape[1] != self._model.nq:
            raise InputError(
                f"Q has shape {Q.shape}, but this robot has {self._model.nq} joints: (T, {self._model.nq}) is wanted"
            )
        model, data = self._model, self._model.createData()
        joints, which = np.unique(self._joint, return_inverse=True)
        oMi = np.empty((len(Q), len(joints), 4, 4))
        for q, rows in zip(Q, oMi, strict=True):
            pin.forwardKinematics(model, data, q)
            for row, j in zip(rows, joints.tolist(), strict=True):
                row[:] = data.oMi[j].homogeneous
        return self._to_base @ oMi[:, which] @ self._on_joint


def _read_visuals(robot: Mechanism) -> Iterator[tuple[Shape, pin.SE3, str]]:
    """Read the URDF's visual elements: each shape, its placement in the link, its mesh's name."""
    description = robot.description
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True)
    root = etree.fromstring(description.xml.encode(), parser)
    colors: dict[str, Color] = {}
    for material in root.iterchildren("material"):
        _color(material, colors)
    for link in root.iterchildren("link"):
        name = link.get("name")
        for k, visual in enumerate(link.iterchildren("visual")):
            try:
                color = _color(visual.find("material"), colors)
                kind, scale, size, filename = _geometry(visual.find("geometry"))
                origin = _origin(visual.find("origin"))
            except (ValueError, AttributeError, TypeError) as error:
                raise UrdfError(
                    f"{description.path}: visual {k + 1} of link {name!r}, line {visual.sourceline}, cannot be read "
                    f"({error}); write it as the URDF specification says, or leave it out"
                ) from error
            path = find_mesh(filename, description.path, robot.package_dirs) if filename else None
            own = kind == "mesh" and color is None and path is not None and path.suffix.lower() != ".stl"
            yield Shape(f"{name}_{k}", kind, name, path, scale, size, color or PLAIN, own), origin, filename


def _geometry(element: etree._Element) -> tuple[str, tuple[float, float, float], tuple[float, ...], str]:
    """Read a geometry element: kind, scale, size, mesh name."""
    shape = next(child for child in element if isinstance(child.tag, str))
    unit = (1.0, 1.0, 1.0)
    if shape.tag == "mesh":
        x, y, z = _numbers(shape.get("scale", "1 1 1"), 3)
        return "mesh", (x, y, z), (), shape.get("filename")
    if shape.tag == "box":
        return "box", unit, _numbers(shape.get("size"), 3), ""
    if shape.tag == "sphere":
        return "sphere", unit, _numbers(shape.get("radius"), 1), ""
    if shape.tag in ("cylinder", "capsule"):
        return shape.tag, unit, _numbers(f"{shape.get('radius')} {shape.get('length')}", 2), ""
    raise ValueError(f"unknown geometry <{shape.tag}>")


def _color(material: etree._Element | None, known: dict[str, Color]) -> Color | None:
    """Read a material's colour; of several by one name the first counts, as it does for Pinocchio."""
    if material is None:
        return None
    name, color = material.get("name", ""), material.find("color")
    if color is not None and name not in known:
        r, g, b, a = _numbers(color.get("rgba"), 4)
        if not name:
            return (r, g, b, a)
        known[name] = (r, g, b, a)
    return known.get(name)


def _origin(element: etree._Element | None) -> pin.SE3:
    if element is None:
        return pin.SE3.Identity()
    xyz, rpy = (_numbers(element.get(key, "0 0 0"), 3) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(np.array(rpy)), np.array(xyz))


def _numbers(text: str, count: int) -> tuple[float, ...]:
    values = tuple(float(word) for word in text.split())
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"{count} finite numbers are wanted, not {text!r}")
    return values


def _link_frames(model: pin.Model) -> dict[str, pin.Frame]:
    return {f.name: f for f in model.frames if f.type == pin.FrameType.BODY}


def _base_placement(robot: Mechanism) -> pin.SE3:
    """Place the link that ``Robot.load(base=)`` names, at the reference pose."""
    if robot.base is None:
        return pin.SE3.Identity()
    data = robot.model.createData()
    frame = _link_frames(robot.model)[robot.base]
    pin.forwardKinematics(robot.model, data, np.array(robot.reference))
    return data.oMi[frame.parentJoint] * frame.placement
