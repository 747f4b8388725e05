"""Joints, limits, frames and poses of a robot, as tasks and drawings need them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arguments import Array
from .catalogue import Entry
from .coupling import Coupling
from .model import frame_id
from .validate import Description, Joint


class Mechanism:
    """Movable joints with one coordinate each, their limits, and a reference pose.

    A mimic joint follows another joint and is not counted as a movable joint.

    Attributes
    ----------
    name : str
        Catalogue name, or the name in the file.
    description : Description
        Content of the URDF.
    entry : Entry or None
        Catalogue entry.
    joints : dict of Joint
        All non-fixed joints of the file, by name.
    model : pinocchio.Model
        Model of all N moving joints, mimic joints included; the other joints are fixed at the
        reference pose.
    coupling : Coupling
        Map from the robot's joints to the model's: ``q_model = S q + o``.
    joint_names : tuple of str
        Names of the n movable joints, in Pinocchio's order.
    lower, upper : (n,) arrays
        Position limits, rad or m, which also keep mimic joints within theirs; −inf and inf without
        a limit.
    velocity_limit : (n,) array
        Speed limits, rad/s or m/s; inf without a limit.
    revolute : (n,) array of bool
        False for prismatic joints.
    reference : (n,) array
        Reference pose: the SRDF's if the catalogue names one, else mid-range.
    poses : dict of (n,) arrays
        ``reference``; ``ready``, a working pose, if the catalogue has one; ``middle`` of the joint
        ranges.
    locked : tuple of str
        Joints held at the reference pose.
    package_dirs : tuple of str
        Folders in which ``package://`` meshes are looked up.
    base : str or None
        Link in whose frame placements are expressed, anywhere in the tree; None for the root.
    surroundings : Description or None
        Surroundings of the robot, relative to its root.
    """

    name: str
    description: Description
    entry: Entry | None
    joints: dict[str, Joint]
    model: pin.Model
    coupling: Coupling
    joint_names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity_limit: Array
    revolute: NDArray[np.bool_]
    reference: Array
    poses: dict[str, Array]
    locked: tuple[str, ...]
    package_dirs: tuple[str, ...]
    base: str | None
    surroundings: Description | None

    @property
    def base_id(self) -> int:
        """Frame id of ``base`` in the model."""
        return 0 if self.base is None else frame_id(self.model, self.base)
