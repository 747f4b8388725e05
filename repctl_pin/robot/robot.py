"""The whole machine: joints, limits, frames and a reference pose, from a URDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..errors import InputError, UrdfError, unknown
from .arms import READY
from .catalogue import Entry, default_package_dirs, find, reference_posture, urdf_folder
from .task import KINDS, Task
from .urdf import Description, Joint, read_urdf

_MEANWHILE = "\N{NULL} link"
_ONE_NUMBER = ("revolute", "continuous", "prismatic")


class Robot:
    """A robot as its URDF describes it, every movable joint one number.

    Continuous joints are revolute joints without limits. Mimic joints, and joints with more than one
    degree of freedom (planar, floating), are locked at the reference pose.

    Make one with :meth:`Robot.load`.

    Attributes
    ----------
    name : str
        The catalogue name, or the name in the file.
    joint_names : tuple of str
        Movable joints, in Pinocchio's order.
    lower, upper : (nq,) arrays
        Position limits, rad or m; −inf and inf where there is none.
    velocity : (nq,) array
        Speed limits, rad/s or m/s; inf where there is none.
    reference : (nq,) array
        The reference pose: the SRDF's, where the catalogue names one, else mid-range.
    poses : dict of (nq,) arrays
        ``reference``; ``ready``, a pose to work from, where the catalogue has one; ``middle`` of the joints'
        range.
    frames : tuple of str
        Every link, by name; any of them can carry a task.
    warnings : tuple of str
        What a person should know about this file: missing poses, poses moved inside the limits.
    """

    def __init__(
        self,
        description: Description,
        *,
        name: str | None = None,
        entry: Entry | None = None,
        package_dirs: Sequence[str] = (),
        lock: Sequence[str] = (),
        base: str | None = None,
    ) -> None:
        self.description = description
        self.name = name or description.name
        self.entry = entry
        self.package_dirs = tuple(str(p) for p in package_dirs)
        self.base = base
        joints = {joint.name: joint for joint in description.joints if joint.kind != "fixed"}
        for joint_name in lock:
            if joint_name not in joints:
                raise unknown("joint", joint_name, joints)
        locked = [
            j.name for j in joints.values() if j.mimic is not None or j.kind not in _ONE_NUMBER or j.name in set(lock)
        ]
        try:
            model = pin.buildModelFromXML(description.xml)
        except (ValueError, RuntimeError, MemoryError) as error:
            raise UrdfError(f"{description.path}: Pinocchio cannot build a model of it ({error})") from error
        model.name = self.name

        named, ready = {}, {}
        if entry is not None and entry.srdf is not None:
            named = reference_posture(entry.srdf, entry.posture)
        if entry is not None and entry.ready is not None:
            ready = reference_posture(urdf_folder() / READY, entry.ready)
        notes: list[str] = []
        posture = _pose(model, joints, named, notes)
        poses = {"reference": named, "middle": {}} | ({"ready": ready} if ready else {})
        for name, values in poses.items():
            model.referenceConfigurations[name] = _pose(model, joints, values, [])
        model = lock_joints(model, [model.getJointId(j) for j in locked], posture)

        self.model = model
        self.locked = tuple(locked)
        self.joint_names = tuple(model.names)[1:]
        movable = [joints[j] for j in self.joint_names]
        self.lower = _frozen([j.lower for j in movable])
        self.upper = _frozen([j.upper for j in movable])
        self.velocity = _frozen([j.velocity for j in movable])
        self.revolute = np.array([j.kind != "prismatic" for j in movable], bool)
        self.poses = {name: _frozen(model.referenceConfigurations[name]) for name in poses}
        self.reference = self.poses["reference"]
        self.frames = tuple(f.name for f in model.frames if f.type == pin.FrameType.BODY)
        self.warnings = (*notes, *self._missing_meshes())

    @classmethod
    def load(
        cls,
        name_or_path: str | Path,
        *,
        package_dirs: Sequence[str | Path] = (),
        lock: Sequence[str] = (),
        base: str | None = None,
    ) -> Robot:
        """Load a robot from the catalogue, or from a URDF of your own.

        Parameters
        ----------
        name_or_path
            A catalogue name (``repctl robots`` lists them) or a path to a ``.urdf``.
        package_dirs
            Folders in which ``package://`` names are looked up, beside the file's own ancestors.
        lock
            Joints to hold at the reference pose.
        base
            A link to hold still: joints below it are locked, and x is measured in its frame.

        Raises
        ------
        InputError
            If there is no such robot, joint or link.
        UrdfError
            If the gatekeeper refuses the file.
        """
        text = str(name_or_path)
        if _looks_like_a_path(text):
            path = Path(text).expanduser()
            folders = [*map(str, package_dirs), *map(str, default_package_dirs(path))]
            return cls(read_urdf(path), package_dirs=folders, lock=lock, base=base)
        entry = find(text)
        folders = [*map(str, package_dirs), *entry.package_dirs]
        return cls(read_urdf(entry.urdf), name=entry.name, entry=entry, package_dirs=folders, lock=lock, base=base)

    def task(self, frame: str | None = None, kind: str = "pose", *, joints: Sequence[str] | None = None) -> Task:
        """Make the task of moving a frame, with only the joints that move it.

        Parameters
        ----------
        frame
            A link's name; by default the catalogue's, or the tip of the longest chain.
        kind
            ``pose`` (m = 6), ``axis`` (position and tool axis, 5), ``position`` (3), ``xy``, ``xz``,
            ``yz`` (2).
        joints
            Choose among the joints of the chain; the others are locked at the reference pose.

        Raises
        ------
        InputError
            If there is no such frame, kind or joint, or no joint moves the frame.
        """
        frame = self.default_frame if frame is None else frame
        if kind not in KINDS:
            raise InputError(f"no task kind {kind!r}; there is {', '.join(KINDS)}")
        chain = self.chain(frame)
        if joints is not None:
            for joint in joints:
                if joint not in self.joint_names:
                    raise unknown("joint", joint, self.joint_names)
                if joint not in chain:
                    raise InputError(f"joint {joint!r} does not move {frame!r}; these do: {', '.join(chain)}")
            chain = tuple(j for j in chain if j in set(joints))
        if not chain:
            raise InputError(f"no movable joint moves {frame!r}; choose a frame further along an arm")
        return Task(self, frame, kind, chain)

    def chain(self, frame: str) -> tuple[str, ...]:
        """Name the movable joints that move a frame (relative to ``base``), from the base outward."""
        supports = self._supports(frame)
        below = set(self._supports(self.base)) if self.base is not None else set()
        if not below <= set(supports):
            raise InputError(f"base {self.base!r} is not on the chain to {frame!r}; choose a link that is")
        return tuple(self.model.names[j] for j in supports if j not in below)

    def _missing_meshes(self) -> list[str]:
        """Say which meshes were not found; kinematics does without."""
        from .visuals import find_mesh

        names = self.description.meshes
        missing = [name for name in names if find_mesh(name, self.description.path, self.package_dirs) is None]
        if not missing:
            return []
        return [
            f"{len(missing)} of {len(names)} meshes were not found ({missing[0]}{', …' if len(missing) > 1 else ''}); "
            "those links are drawn as tubes; say where the packages are with --package-dir"
        ]

    def _supports(self, frame: str) -> list[int]:
        joint = self.model.frames[frame_id(self.model, frame)].parentJoint
        return [int(j) for j in self.model.supports[joint] if j > 0]

    @property
    def default_frame(self) -> str:
        """The catalogue's first end frame, else the last link of the longest chain."""
        if self.entry is not None and self.entry.frames:
            return self.entry.frames[0]
        depth = {name: len(self.chain(name)) for name in self.frames}
        deepest = max(depth.values(), default=0)
        return [name for name, joints in depth.items() if joints == deepest][-1]

    @property
    def offered_frames(self) -> tuple[str, ...]:
        """End frames worth offering: the catalogue's, else the default one."""
        return self.entry.frames if self.entry is not None else (self.default_frame,)

    def __repr__(self) -> str:
        return f"<Robot {self.name}: {len(self.joint_names)} joints, {len(self.frames)} links>"


def frame_id(model: pin.Model, name: str) -> int:
    """Find a frame by name, links before joints.

    Pinocchio itself answers an unknown name with a number that later crashes it, and raises on a name
    that a joint and a link share.
    """
    ids = {f.name: i for i, f in reversed(list(enumerate(model.frames)))}
    ids |= {f.name: i for i, f in enumerate(model.frames) if f.type == pin.FrameType.BODY}
    if name not in ids:
        raise unknown("frame", name, [f.name for f in model.frames if f.type == pin.FrameType.BODY])
    return ids[name]


def lock_joints(model: pin.Model, ids: Sequence[int], posture: NDArray[np.float64]) -> pin.Model:
    """Build the reduced model, some joints held at a posture.

    Pinocchio looks locked joints up by name among all frames and raises where a link has a joint's name, so
    such links go by another name meanwhile.
    """
    joints = {f.name for f in model.frames if f.type != pin.FrameType.BODY}
    links = [f for f in model.frames if f.type == pin.FrameType.BODY and f.name in joints]
    for link in links:
        link.name += _MEANWHILE
    try:
        reduced = pin.buildReducedModel(model, list(ids), np.array(posture))
    finally:
        for link in links:
            link.name = link.name.removesuffix(_MEANWHILE)
    for frame in reduced.frames:
        frame.name = frame.name.removesuffix(_MEANWHILE)
    return reduced


def _looks_like_a_path(text: str) -> bool:
    """A catalogue name has no dot and no slash; whatever has is meant as a file."""
    return any(mark in text for mark in "./\\") or Path(text).is_file()


def _pose(
    model: pin.Model, joints: Mapping[str, Joint], named: Mapping[str, float], notes: list[str]
) -> NDArray[np.float64]:
    """A pose of every joint, inside its limits: the named values, else mid-range; mimics follow; moves are noted."""
    posture = pin.neutral(model)
    for name in tuple(model.names)[1:]:
        joint, q = joints[name], model.joints[model.getJointId(name)].idx_q
        if joint.kind not in _ONE_NUMBER:
            continue
        if name in named:
            value = _inside(named[name], joint)
            if abs(value - named[name]) > 1e-3:
                notes.append(f"reference pose: {name} = {named[name]:g} is outside its limits, {value:g} used")
        elif np.isfinite(joint.lower) and np.isfinite(joint.upper):
            value = (joint.lower + joint.upper) / 2
        else:
            value = float(np.clip(0.0, joint.lower, joint.upper))
        posture[q] = value
    for name in tuple(model.names)[1:]:
        joint = joints[name]
        if joint.mimic is not None and model.existJointName(joint.mimic):
            q, leader = (model.joints[model.getJointId(j)].idx_q for j in (name, joint.mimic))
            posture[q] = np.clip(joint.multiplier * posture[leader] + joint.offset, joint.lower, joint.upper)
    return posture


def _inside(value: float, joint: Joint) -> float:
    """Move a joint value inside its limits: by a full turn if that does it, else to the nearer limit."""
    turns = (0.0, 2 * np.pi, -2 * np.pi) if joint.kind != "prismatic" else (0.0,)
    inside = [value + turn for turn in turns if joint.lower <= value + turn <= joint.upper]
    return float(inside[0] if inside else np.clip(value, joint.lower, joint.upper))


def _frozen(values: Sequence[float] | NDArray) -> NDArray[np.float64]:
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array
