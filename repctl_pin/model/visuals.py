"""Visible shapes of a robot and their placements at a configuration.

Mesh files are located here and read where they are drawn. A robot without shapes, and a link whose
mesh is missing, are drawn from the kinematics: links as tubes, joints as cylinders. Surroundings
are drawn by their collision shapes."""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..arguments import Array, read_only
from ..errors import InputError
from .coupling import Coupling
from .mechanism import Mechanism
from .model import (
    fixed_placements,
    frame_placements,
    link_frames,
    link_ids,
    origin,
)
from .shapes import Color, find_mesh
from .validate import MAX_SHAPES, Joint

_PLAIN: Color = (0.80, 0.82, 0.85, 1.0)
"""Default colour of a shape."""

_TUBE: Color = (0.72, 0.75, 0.79, 1.0)
JOINT: Color = (0.25, 0.28, 0.33, 1.0)
"""Colours of links and joints that are drawn from the kinematics."""

_AROUND: Color = (0.62, 0.66, 0.71, 0.45)
"""Colour of the surroundings, transparent so that the arm stays visible."""


@dataclass(frozen=True)
class Shape:
    """Visible shape in its own frame.

    Attributes
    ----------
    kind
        ``mesh``, ``box``, ``cylinder``, ``sphere`` or ``capsule``.
    path
        Mesh file; None for primitives.
    scale
        Scale of a mesh along its own axes, negative if mirrored; never part of a placement.
    size
        box: three edges; cylinder and capsule: radius, length along z; sphere: radius, m.
    color
        Red, green, blue and opacity, 0 to 1.
    textured
        True if the mesh keeps the materials of its own file, because the URDF gives none.
    standing
        True for a shape of the surroundings.
    """

    name: str
    kind: str
    link: str = ""
    path: Path | None = None
    scale: tuple[float, ...] = (1.0, 1.0, 1.0)
    size: tuple[float, ...] = ()
    color: Color = _PLAIN
    textured: bool = False
    standing: bool = False


_Placed = tuple[Shape, pin.SE3]
"""A shape and its placement on its link."""


@dataclass(frozen=True, eq=False)
@read_only
class Visuals:
    """Shapes of a robot and the joints that move them. Create it with :meth:`Visuals.of`.

    Attributes
    ----------
    shapes
        Shapes to draw.
    """

    shapes: tuple[Shape, ...]
    _model: pin.Model = field(repr=False)
    _frame: NDArray[np.intp] = field(repr=False)  # (S,), frame ids
    _on_frame: Array = field(repr=False)  # (S, 4, 4)
    _coupling: Coupling = field(repr=False)
    _base: int = field(repr=False)  # frame id

    @classmethod
    def of(cls, robot: Mechanism) -> Visuals:
        """Collect the shapes of a robot; meshes are looked up in its ``package_dirs``."""
        ids = link_ids(robot.model)
        links = link_frames(robot.model)
        riding: list[_Placed] = []
        missing = set()  # links whose mesh is missing
        for shape, place in _find_shapes(robot):
            if shape.kind == "mesh" and shape.path is None:
                missing.add(shape.link)
            elif shape.color[3] > 0:
                riding.append((shape, place))
        moving = any(links[shape.link].parentJoint > 0 for shape, _ in riding)
        riding += _skeleton(robot, links, missing if moving else links)
        placed = [*riding, *_surroundings(robot)]
        frames = [0 if shape.standing else ids[shape.link] for shape, _ in placed]
        return cls(
            shapes=tuple(shape for shape, _ in placed),
            _model=robot.model,
            _frame=np.array(frames, np.intp),
            _on_frame=np.array([M.homogeneous for _, M in placed]).reshape(-1, 4, 4),
            _coupling=robot.coupling,
            _base=robot.base_id,
        )

    def placements(self, Q: ArrayLike) -> Array:
        """Compute the placement of every shape at every configuration.

        Parameters
        ----------
        Q
            Configurations (T, n) of the whole robot (``task.to_robot(q)``).

        Returns
        -------
        (T, S, 4, 4) rigid transforms, m, in the frame of the robot's ``base``, as the task's
        placements are. The scale of a mesh is not included."""
        Q = np.ascontiguousarray(Q, dtype=float)
        n = self._coupling.S.shape[1]
        if Q.ndim != 2 or Q.shape[1] != n:
            raise InputError(
                f"Q has shape {Q.shape}, but this robot has {n} joints; give Q as (T, {n})"
            )
        Q = self._coupling.joints(Q)
        frames = frame_placements(self._model, self._frame.tolist(), Q, self._base)
        return frames @ self._on_frame


def _find_shapes(robot: Mechanism) -> Iterator[_Placed]:
    """Iterate over a robot's visible shapes; the path of a missing mesh is None."""
    for seen in robot.description.shapes:
        path = (
            find_mesh(seen.filename, robot.description.path, robot.package_dirs)
            if seen.filename
            else None
        )
        own = (
            seen.kind == "mesh"
            and seen.color is None
            and path is not None
            and path.suffix.lower() != ".stl"
        )
        shape = Shape(
            seen.name,
            seen.kind,
            seen.link,
            path,
            seen.scale,
            seen.size,
            seen.color or _PLAIN,
            own,
        )
        yield shape, origin(seen)


def _surroundings(robot: Mechanism) -> Iterator[_Placed]:
    """Iterate over the first ``MAX_SHAPES`` shapes of the surroundings, placed from the robot's
    root.

    A missing mesh is skipped here; :class:`Bodies` raises on it, and notes shapes not drawn.
    """
    around = robot.surroundings
    if around is None:
        return
    places = fixed_placements(around)
    for solid in around.collisions[:MAX_SHAPES]:
        path = (
            find_mesh(solid.filename, around.path, robot.package_dirs)
            if solid.filename
            else None
        )
        if path is not None or solid.kind != "mesh":
            name = f"surroundings/{solid.name}"
            M = places[solid.link] * origin(solid)
            yield (
                Shape(
                    name,
                    solid.kind,
                    solid.link,
                    path,
                    solid.scale,
                    solid.size,
                    _AROUND,
                    standing=True,
                ),
                M,
            )


def _skeleton(
    robot: Mechanism, links: dict[str, pin.Frame], draw: Container[str]
) -> Iterator[_Placed]:
    """Iterate over the shapes that stand in for links without meshes: tubes, and joints.

    Parameters
    ----------
    robot
        The robot.
    links
        Link frames of the robot's model, by name.
    draw
        Names of the links to draw.
    """
    thick = 0.02 * (_extent(robot, links) or 1.0)
    for joint in robot.description.joints:
        place = _joint_origin(robot.model, links, joint)
        length = float(np.linalg.norm(place.translation))
        if joint.parent in draw and length > thick:
            tube = Shape(
                f"{joint.name}_tube",
                "capsule",
                joint.parent,
                size=(thick, length),
                color=_TUBE,
            )
            yield tube, pin.SE3(_turn_z_to(place.translation), place.translation / 2)
        if joint.child in draw and joint.kind != "fixed":
            yield from _joint_bones(joint, place, thick, joint.parent in draw)


def _joint_bones(
    joint: Joint, place: pin.SE3, thick: float, rail: bool
) -> Iterator[_Placed]:
    """Iterate over the shapes of a joint: a cylinder if revolute, else a slider on a rail.

    ``thick`` is the radius of tubes, m; the rail is drawn only if ``rail`` is True.
    """
    name = joint.name
    along = pin.SE3(_turn_z_to(joint.axis), np.zeros(3))
    if joint.kind != "prismatic":
        yield (
            Shape(
                f"{name}_joint",
                "cylinder",
                joint.child,
                size=(1.7 * thick, 4.4 * thick),
                color=JOINT,
            ),
            along,
        )
        return
    size = (3.4 * thick, 3.4 * thick, 5 * thick)
    reach = 50 * thick
    yield Shape(f"{name}_slider", "box", joint.child, size=size, color=JOINT), along
    low = max(joint.lower, -reach)
    high = min(joint.upper, reach)
    if rail and high > low:
        middle = (
            place * pin.SE3(np.eye(3), (low + high) / 2 * np.array(joint.axis)) * along
        )
        yield (
            Shape(
                f"{name}_rail",
                "cylinder",
                joint.parent,
                size=(0.8 * thick, high - low),
                color=_TUBE,
            ),
            middle,
        )


def _joint_origin(
    model: pin.Model, links: dict[str, pin.Frame], joint: Joint
) -> pin.SE3:
    """Compute a joint's origin in its parent link's frame."""
    parent = links[joint.parent]
    child = links[joint.child]
    if (
        child.parentJoint == parent.parentJoint
    ):  # fixed joint, or locked at the reference pose
        return parent.placement.inverse() * child.placement
    return parent.placement.inverse() * model.jointPlacements[child.parentJoint]


def _extent(robot: Mechanism, links: dict[str, pin.Frame]) -> float:
    """Compute the diagonal of the box around all link origins at the reference pose, m."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.coupling.joints(robot.reference))
    points = [
        (data.oMi[f.parentJoint] * f.placement).translation for f in links.values()
    ]
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def _turn_z_to(direction: ArrayLike) -> Array:
    """Compute a rotation matrix that maps the z axis to a direction."""
    z = np.asarray(direction, float) / np.linalg.norm(direction)
    if z[2] < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    return pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), z).matrix()
