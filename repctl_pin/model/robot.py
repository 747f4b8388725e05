"""Robot from a URDF: joints, limits, frames and a reference pose.

A mimic joint follows another joint; a locked joint is held at the reference pose, the usual
configuration of the robot.

``Description`` is the content of a validated URDF as plain data. ``Entry`` is a robot of the
catalogue: its files, its frames and its reference pose. ``Range`` is the limits of a joint: lower,
upper, velocity, acceleration and jerk. ``Kind`` is the kind of a task, such as ``pose``, with the
coordinates that it commands. ``FrameSpec`` is one of several frames: its link, its kind of task,
its base, and the joints that move it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..base.arguments import Array, file_name, list_of, list_of_names, require_type, shown
from ..base.errors import InputError, UrdfError, unknown
from .catalogue import READY, Entry, default_package_dirs, find, reference_posture, urdf_folder
from .end_effectors import arm_ends, is_sensor, rank, task_links
from .kind import Kind, KindName, task_kind
from .mechanism import Mechanism, Range, based, couple, limits, pose
from .model import frame_id, frame_placements, link_ids, lock_joints, path_between
from .packages import find_mesh, named_mesh, package_folder
from .task import Task
from .urdf import Description, check_surroundings, read_urdf
from .urdf_xml import short

if TYPE_CHECKING:
    from .several_frames import FrameSpec


class Robot(Mechanism):
    """Robot described by a URDF, with one coordinate per movable joint.

    Continuous joints are revolute joints without limits; planar and floating joints become three
    and six joints with one coordinate each. A mimic joint moves with its leader, within the limits
    of both.

    Create one with :meth:`Robot.load`.

    In addition to the attributes of :class:`Mechanism`:

    Attributes
    ----------
    frames : tuple of str
        Names of all links; any of them can be the frame of a task.
    default_frame : str
        Default frame of a task: the one in the catalogue; for other robots, the end of the longest
        arm, before the fingers of a gripper. ``repctl inspect`` shows this frame.
    end_frames : tuple of str
        Frames at the ends of arms, the default first.
    warnings : tuple of str
        Notes on the file: content read differently than written, missing meshes, ignored limits of
        mimic joints, and values of the reference pose that were moved into the limits.

    Examples
    --------
    >>> robot = rp.Robot.load("panda")  # or a path: rp.Robot.load("my_arm.urdf")
    >>> robot.name, robot.default_frame
    ('panda', 'panda_hand_tcp')
    >>> robot.task("panda_hand_tcp", "position").r
    4
    """

    def __init__(
        self,
        description: Description,
        *,
        entry: Entry | None = None,
        package_dirs: Sequence[str] = (),
        lock: Sequence[str] = (),
        base: str | None = None,
        surroundings: Description | None = None,
    ) -> None:
        self.description = description
        self.surroundings = surroundings
        self.name = description.name if entry is None else entry.name
        self.entry = entry
        self.package_dirs = tuple(str(p) for p in package_dirs)
        self.base = base
        self.joints = {joint.name: joint for joint in description.joints if joint.kind != "fixed"}
        still = self._still(lock)
        model = _built(description)
        model.name = self.name

        # limits and named poses of the joints that mimic no other one
        notes: list[str] = []
        names = tuple(model.names)[1:]
        free = [name for name in names if self.joints[name].mimic is None]
        moving = [joint for joint in self.joints.values() if joint.name not in still]
        ranges = [limits(self.joints[j], [f for f in moving if f.mimic == j], notes) for j in free]
        poses = self._poses_within(free, ranges, notes)

        # the model in which only the moving joints are left
        whole = couple(names, free, self.joints)
        for name, q in poses.items():
            model.referenceConfigurations[name] = whole.joints(q)
        self.model = lock_joints(
            model, [model.getJointId(j) for j in still], whole.joints(poses["reference"])
        )
        self.locked = tuple(name for name in self.joints if name in still)
        self.joint_names = tuple(name for name in free if name not in still)
        self.coupling = couple(tuple(self.model.names)[1:], self.joint_names, self.joints)
        self.frames = tuple(link_ids(self.model))

        # what the moving joints keep of it
        self._set_limits(free, ranges, poses)
        self.warnings = (*description.notes, *notes, *self._mesh_notes())
        if base is not None:
            self._frame_id(base)  # raises if there is no such link

    def _still(self, lock: Sequence[str]) -> set[str]:
        """List the names of joints that do not move: those in ``lock``, and their mimic joints.

        A mimic joint with the multiplier 0 does not move either. InputError is raised if a name in
        ``lock`` is no joint.
        """
        held = set(lock)
        for name in held:
            if name not in self.joints:
                raise unknown("joint", name, self.joints)
        return {
            joint.name
            for joint in self.joints.values()
            if joint.name in held or joint.mimic in held or joint.multiplier == 0
        }

    def _poses_within(
        self, free: Sequence[str], ranges: Sequence[Range], notes: list[str]
    ) -> dict[str, Array]:
        """Compute the robot's named poses, ``reference`` among them: {pose name: values}.

        ``free`` are the names of the joints that mimic no other joint. A pose has one value per
        joint of ``free``, rad or m. A value outside its range in ``ranges`` is replaced by one
        inside; for the reference pose, a text on it is added to ``notes``.
        """
        lower, upper = np.array([(one.lower, one.upper) for one in ranges]).reshape(-1, 2).T
        turns = self._revolute(free)
        return {
            name: pose(free, lower, upper, turns, values, notes if name == "reference" else [])
            for name, values in _named_poses(self.entry).items()
        }

    def _set_limits(
        self, free: Sequence[str], ranges: Sequence[Range], poses: Mapping[str, Array]
    ) -> None:
        """Set the attributes of the movable joints: limits, ``revolute``, poses and reference.

        ``free`` are the names of the joints that mimic no other joint. It includes locked joints,
        which are skipped here. ``ranges`` has a range per joint of ``free``, and each pose a value
        per joint of ``free``.
        """
        mine = [free.index(name) for name in self.joint_names]
        kept = [ranges[i] for i in mine]
        self.lower = _frozen([one.lower for one in kept])
        self.upper = _frozen([one.upper for one in kept])
        self.velocity_limit = _frozen([one.velocity for one in kept])
        self.acceleration_limit = _frozen([one.acceleration for one in kept])
        self.jerk_limit = _frozen([one.jerk for one in kept])
        named = zip(self.joint_names, kept, strict=True)
        self.narrowed = {name: one.narrowed for name, one in named if one.narrowed}
        self.revolute = self._revolute(self.joint_names)
        self.poses = {name: _frozen(q[mine]) for name, q in poses.items()}
        self.reference = self.poses["reference"]

    def _revolute(self, names: Sequence[str]) -> NDArray[np.bool_]:
        """Return a mask (K,) of the joints with K ``names``: False for prismatic joints."""
        return np.array([self.joints[name].kind != "prismatic" for name in names], bool)

    @classmethod
    def load(
        cls,
        name_or_path: str | Path | Any,
        *,
        package_dirs: Sequence[str | Path] = (),
        lock: Sequence[str] = (),
        base: str | None = None,
        surroundings: str | Path | None = None,
    ) -> Robot:
        """Load a robot from the catalogue, from a URDF or MJCF file, or from a loaded model.

        Parameters
        ----------
        name_or_path
            A catalogue name (``repctl robots`` lists them); a path to a ``.urdf``, or to the
            ``.xml`` of an MJCF model; a ``yourdfpy.URDF``, or a ``mujoco.MjModel``, whose meshes
            are left out. An MJCF file is compiled by ``mujoco``, which must be installed.
        package_dirs
            Folders in which ``package://`` names, and ``$(find …)`` in xacro, are looked up. They
            take precedence over the parent folders of the file. An entry ``"NAME=DIR"`` is the
            folder of one package. A mesh that is not found is looked up by the end of its name, and
            a warning says so.
        lock
            Joints to hold at the reference pose.
        base
            Link relative to which tasks control their frames, as if this link were fixed. It can
            lie between the root and the frame of a task, or on another branch, such as the other
            end effector. The joints of a task are those between this link and the frame. By
            default, the root link.
        surroundings
            URDF of the surroundings, with fixed joints only and its root at the robot's root;
            :class:`Bodies` measures the distances to it.

        Raises
        ------
        InputError
            If there is no such robot, joint, link or folder.
        UrdfError
            If the file is not a valid URDF.
        """
        data, name_or_path, found = _loaded(name_or_path)
        text = str(file_name(name_or_path, "robot"))
        one = isinstance(package_dirs, (str, Path))
        given = (
            [package_dirs] if one else list_of(package_dirs, "package_dirs", "a list of folders")
        )
        own = [
            os.path.expanduser(str(file_name(folder, "each of package_dirs"))) for folder in given
        ]
        lock = list_of_names(lock, "lock", "a list of joint names")
        if base is not None:
            require_type(base, str, "base", "a link name")
        for folder in own:
            # Unlike Path.is_dir, isdir takes names that are too long, too.
            if not os.path.isdir(package_folder(folder)[1]):
                raise InputError(
                    f": there is no folder {folder!r}",
                    argument="package_dirs",
                    remedy="give the path of an existing folder",
                )
        # no catalogue name contains these
        is_file = any(mark in text for mark in "./\\") or os.path.isfile(text)
        entry = None if is_file or data is not None else find(text)
        path = Path(os.path.expanduser(text)) if entry is None else entry.urdf
        folders = [*own, *(default_package_dirs(path) if entry is None else entry.package_dirs)]
        around = None
        if surroundings is not None:
            around, near = read_surroundings(surroundings, own)
            folders += near
        description = read_urdf(path, folders, data)
        if found:
            notes = (*found, *description.notes)
            description = replace(description, notes=notes)
        return cls(
            description,
            entry=entry,
            package_dirs=folders,
            lock=lock,
            base=base,
            surroundings=around,
        )

    def task(
        self,
        frame: str | Sequence[str | tuple[str, ...]] | None = None,
        kind: KindName | Kind = "pose",
        *,
        joints: Sequence[str] | None = None,
        on: str | None = None,
    ) -> Task:
        """Create the task of controlling a frame, or several, with the joints that move them.

        With ``on=``, a frame is controlled relative to a workpiece that a turntable, a positioner
        or another arm carries: the task's pose is ``x = X_w(q)⁻¹ X_t(q)``, with the placements X_w
        of the workpiece and X_t of the frame. The joints that move the workpiece are joints of the
        task.

        Parameters
        ----------
        frame
            Name of a link; by default :attr:`default_frame`, the end of the arm. A list for several
            frames at once: names, or tuples (name, kind), or (name, kind, base) for a frame that is
            placed relative to another link, as when two hands carry a tray.
        kind
            ``pose`` (m = 6), ``axis`` (position, and the direction of the frame's z axis, 5),
            ``position`` (3), ``xy``, ``xz``, ``yz`` (2).
        joints
            Names of joints that move the frame, to use only these; the others are locked at the
            reference pose. By default, all joints that move the frame are used.
        on
            Link of the workpiece, relative to which the frame is controlled; by default the robot's
            :attr:`base`.

        Raises
        ------
        InputError
            If there is no such frame, kind or joint; if no joint moves the frame relative to its
            base; or if the task of several frames is not redundant, or names a frame twice.
        """
        if on is not None:
            self._frame_id(on)
            return based(self, on).task(frame, kind, joints=joints)
        if isinstance(frame, (list, tuple)):
            return self._task_of_several(frame, kind, joints)
        name: Any = self.default_frame if frame is None else frame
        return Task(self, name, task_kind(kind), self._moving(name, joints))

    def _task_of_several(
        self,
        frames: Sequence[str | tuple[str, ...]],
        kind: KindName | Kind,
        joints: Sequence[str] | None,
    ) -> Task:
        """Create the task of several frames: names, or tuples (name, kind) or (name, kind, base).

        ``joints`` are the names of those to use, by default all that move a frame. ``kind`` is used
        for frames without a kind of their own. InputError is raised for a frame given twice, and
        for a task that is not redundant.
        """
        from .several_frames import SeveralFrames  # few robots have two hands

        specs = [self._frame_spec(given, kind) for given in frames]
        if joints is not None:
            union = tuple(dict.fromkeys(j for spec in specs for j in spec.joints))
            kept = self._subset(joints, union, "the frames")
            specs = [
                spec._replace(joints=tuple(j for j in spec.joints if j in kept)) for spec in specs
            ]
        names = [spec.frame for spec in specs]
        twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
        if twice:
            raise InputError(
                f": {twice[0]!r} is given twice", argument="frame", remedy="give each frame once"
            )
        if not specs:
            raise InputError(": the list of frames is empty; give at least one", argument="frame")
        if len(specs) == 1:
            (one,) = specs
            return Task(based(self, one.base), one.frame, one.kind, one.joints)
        task = SeveralFrames(self, specs)
        if task.r < 1:
            raise InputError(
                f"{task.n} joints move {', '.join(names)}, and their task has {task.m} "
                "coordinates: it is not redundant",
                remedy="give a frame another kind, such as 'position', or leave one out",
            )
        return task

    def _frame_spec(self, given: Any, kind: KindName | Kind) -> FrameSpec:
        """Check one entry of a list of frames, and complete it: its kind, base and joints.

        ``given`` is a name, (name, kind) or (name, kind, base); without a kind, ``kind`` is used.
        Without a base, the frame is placed relative to the robot's own base. Its joints are all
        that move it.
        """
        from .several_frames import FrameSpec

        parts = (given,) if isinstance(given, str) else given
        if not (isinstance(parts, tuple) and 1 <= len(parts) <= 3):
            raise InputError(
                f": {shown(given)} is not a frame; give a name, (name, kind) or (name, kind, base)",
                argument="frame",
            )
        name, own = parts[0], (*parts, kind)[1]
        base = parts[2] if len(parts) == 3 else None
        if base is not None:
            self._frame_id(base)
        moving = based(self, base)._moving(name, None)
        return FrameSpec(name, task_kind(own), base, moving)

    def _moving(self, frame: str, joints: Sequence[str] | None) -> tuple[str, ...]:
        """List the names of the joints that move a frame; only those in ``joints``, if given.

        InputError is raised if no joint moves the frame, or if one of ``joints`` does not move it.
        """
        chain = self.chain(frame)
        if joints is not None:
            kept = self._subset(joints, chain, repr(frame))
            chain = tuple(j for j in chain if j in kept)
        if not chain:
            raise InputError(
                f"no movable joint moves the link {frame!r}; choose a link farther along an arm "
                "(`repctl inspect` lists the end effectors)"
            )
        return chain

    def _subset(self, joints: Sequence[str], chain: tuple[str, ...], moved: str) -> frozenset[str]:
        """Check that ``joints`` are joints of ``chain``, and return them.

        InputError is raised for a joint that is unknown, or does not move the frame; the message
        calls the frame ``moved``.
        """
        joints = list_of_names(joints, "joints", "a list of joint names")
        for joint in joints:
            if joint not in self.joint_names:
                raise unknown("joint", joint, self.joint_names)
            if joint not in chain:
                raise InputError(
                    f"joint {joint!r} does not move {moved}; these do: {', '.join(chain)}"
                )
        return frozenset(joints)

    def chain(self, frame: str) -> tuple[str, ...]:
        """List the names of the movable joints between ``base`` and a frame, from the base outward.

        Instead of a mimic joint, the joint that it follows is listed. A joint with several places
        on the chain is listed once, in the first of them.
        """
        up, down = path_between(self.model, self.base_id, self._frame_id(frame))
        return tuple(
            dict.fromkeys(self.joint_names[self.coupling.leader(j - 1)] for j in (*up, *down))
        )

    def reference_positions(self) -> dict[str, Array]:
        """Compute the origins (3,), m, of all links at the reference pose, as a dict by link name.

        They are in the frame of ``base``.
        """
        ids = link_ids(self.model)
        q = self.coupling.joints(self.reference)
        placed = frame_placements(self.model, ids.values(), q[None], self.base_id)
        return dict(zip(ids, placed[0, :, :3, 3], strict=True))

    def _mesh_notes(self) -> list[str]:
        """List notes: a text on meshes found only by the end of their names, one on missing ones.

        The list is empty without such meshes. The kinematics needs no meshes, so they are not
        errors.
        """
        description = self.description
        collisions = (shape.filename for shape in description.collisions if shape.filename)
        drawn = description.meshes
        where = description.path, self.package_dirs
        named = {name: named_mesh(name, *where) for name in [*drawn, *collisions]}
        found = {name: file or find_mesh(name, *where) for name, file in named.items()}
        by_end = [name for name, file in found.items() if file and not named[name]]
        missing = [name for name in drawn if found[name] is None]
        notes = []
        if by_end:
            first = by_end[0]
            notes.append(
                f"{len(by_end)} of {len(found)} meshes found by the end of their names: "
                f"{short(first)[1:-1]} is read from {found[first]}"
            )
        if missing:
            which = short(missing[0])[1:-1] + (", …" if len(missing) > 1 else "")
            notes.append(
                f"{len(missing)} of {len(drawn)} meshes are missing ({which}); "
                "those links are drawn as tubes; give the folders of their packages "
                "(--package-dir, package_dirs=)"
            )
        return notes

    def _frame_id(self, frame: str) -> int:
        require_type(frame, str, "frame", "a link name")
        try:
            return frame_id(self.model, frame)
        except InputError:
            likely = [link for links in self._ends() for link in links if not is_sensor(link)]
            raise unknown("frame", frame, self.frames, likely=likely) from None

    def _ends(self) -> list[list[str]]:
        """List the links at the ends of arms, legs and heads: one list per end.

        The end with the most joints between it and the root is first. In each list, the link whose
        name is most typical of an end effector is first.
        """
        return [
            task_links(body)
            for body in sorted(arm_ends(self.description), key=lambda body: -body.before)
        ]

    def _beyond_base(self, frame: str) -> bool:
        """Test whether a frame is offered for tasks.

        Normally, the base must be the root, or lie between the root and the frame. If the base is
        itself the end of a branch, such as a workpiece, all frames that move relative to the base
        are offered.
        """
        base = int(self.model.frames[self.base_id].parentJoint)
        at_end = self.base is not None and len(self.model.subtrees[base]) == 1
        up, _ = path_between(self.model, self.base_id, self._frame_id(frame))
        return bool(self.chain(frame)) if at_end else not up

    @property
    def default_frame(self) -> str:
        """Default frame of a task: the catalogue's, else a link at the end of the longest arm.

        An arm ends before its fingers, see :func:`repctl_pin.model.end_effectors.arm_ends`. If
        several links are rigidly connected at the end, one named as a tool (``tcp``, ``tool0``,
        ``ee_link``, ``flange``) is preferred, then a gripper, a palm or a hand, then the link
        farthest from the root."""
        return self.offered_frames[0]

    @property
    def offered_frames(self) -> tuple[str, ...]:
        """Frames to offer for a task, the default first: the catalogue's, else a single frame.

        The single frame is the end of the arm with the most joints. If several arms have as many
        joints, it is the end whose name is most typical of an end effector. A sensor is offered
        only if there is no other end.
        """
        known = tuple(
            frame for frame in (self.entry.frames if self.entry else ()) if self._beyond_base(frame)
        )
        ends = [links[0] for links in self._ends() if self._beyond_base(links[0])]
        return known or (
            max(
                ends,
                key=lambda frame: (not is_sensor(frame), len(self.chain(frame)), -rank(frame)),
                default=self.base or self.frames[0],
            ),
        )

    @property
    def end_frames(self) -> tuple[str, ...]:
        """Candidate task frames, the default first.

        They are all links at the ends of the arms with the most joints, and one link at each other
        end. An end that fewer than two joints move is omitted. A sensor is omitted unless its end
        has no other links.
        """
        frames = list(self.offered_frames)
        most = len(self.chain(frames[0]))
        for links in self._ends():
            if self._beyond_base(links[0]) and len(self.chain(links[0])) >= 2:
                meant = [link for link in links if not is_sensor(link)] or links
                frames += meant if len(self.chain(links[0])) >= most else meant[:1]
        return tuple(dict.fromkeys(frames))

    @property
    def movable_frames(self) -> tuple[str, ...]:
        """All links that joints move and a task can control, those of :attr:`end_frames` first.

        If the robot has a ``base``, they are the links beyond the base. If the base is the end of a
        branch, they are all links that move relative to the base.
        """
        moved = (frame for frame in self.frames if self._beyond_base(frame) and self.chain(frame))
        return tuple(dict.fromkeys([*self.end_frames, *moved]))

    def __repr__(self) -> str:
        return f"<Robot {self.name}: {len(self.joint_names)} joints, {len(self.frames)} links>"


def _loaded(given: Any) -> tuple[bytes | None, Any, list[str]]:
    """Convert a loaded model, of yourdfpy or MuJoCo, to (URDF text, file name, notes).

    The file name, such as ``panda.urdf``, is made up for error messages, because a loaded model has
    no file. Any other object, such as a path, gives (None, the object, []).

    Raises
    ------
    UrdfError
        If the model has content that a URDF cannot describe.
    """
    notes: list[str] = []
    if _is(given, "yourdfpy", "URDF"):
        text = given.write_xml_string()
        return bytes(text), f"{given.robot.name}.urdf", notes
    if _is(given, "mujoco", "MjModel"):
        from .mjcf import urdf_of_model

        try:
            return urdf_of_model(given, notes), "mujoco_model.xml", notes
        except UrdfError as error:
            raise UrdfError(f"mujoco.MjModel: {error}") from error
    return None, given, notes


def _is(given: Any, module: str, name: str) -> bool:
    """Test whether ``given`` is an instance of the class ``module.name``, which is not imported.

    If the module was never imported, no such object can exist.
    """
    kind = getattr(sys.modules.get(module), name, None)
    return isinstance(kind, type) and isinstance(given, kind)


def _named_poses(entry: Entry | None) -> dict[str, dict[str, float]]:
    """Read the named poses of a catalogue robot: {pose name: {joint name: rad or m}}.

    The poses are ``reference``, ``middle`` and, if the catalogue has one, ``ready``. Joints without
    a value are at mid-range; ``middle`` has no values.
    """
    poses: dict[str, dict[str, float]] = {"reference": {}, "middle": {}}
    if entry is not None and entry.srdf is not None and entry.posture is not None:
        poses["reference"] = reference_posture(entry.srdf, entry.posture)
    if entry is not None and entry.ready is not None:
        poses["ready"] = reference_posture(urdf_folder() / READY, entry.ready)
    return poses


def _built(description: Description) -> pin.Model:
    """Build Pinocchio's model of all joints; UrdfError if Pinocchio refuses the file."""
    try:
        return pin.buildModelFromXML(description.xml)
    except (ValueError, RuntimeError, MemoryError) as error:
        raise UrdfError(
            f"{description.path}: Pinocchio cannot build a model ({error}); correct the file"
        ) from error


def _frozen(values: Sequence[float] | NDArray[Any]) -> Array:
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array


def read_surroundings(
    path: str | Path, package_dirs: Sequence[str]
) -> tuple[Description, Sequence[str]]:
    """Read the URDF of the surroundings; return it, and the folders in which its meshes may be.

    These folders are the file's parents and the folders of ROS packages. If the file is a xacro,
    its ``$(find package)`` is looked up first in ``package_dirs``, then in these folders.
    """
    beside = Path(os.path.expanduser(str(file_name(path, "surroundings"))))
    near = default_package_dirs(beside)
    return check_surroundings(read_urdf(beside, [*package_dirs, *near])), near
