"""The moving parts of a robot: what a task and a drawing need to know of it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..arguments import Array
from ..urdf.catalogue import Entry
from ..urdf.validate import Description, Joint
from .coupling import Coupling
from .model import frame_id


class Mechanism:
    """Movable joints, one number each, their limits, and a reference pose.

    A joint that mimics another is driven by it, and is no joint of its own.

    Attributes
    ----------
    name : str
        The catalogue name, or the name in the file.
    description : Description
        What the URDF says.
    entry : Entry or None
        Its entry in the catalogue.
    joints : dict of Joint
        All joints of the file that are not fixed, by name.
    model : pinocchio.Model
        All joints that move, N of them, those that follow others included; the rest fixed at the
        reference pose.
    coupling : Coupling
        The model's joints out of the robot's: ``q_model = S q + o``.
    joint_names : tuple of str
        Movable joints, n of them, in Pinocchio's order.
    lower, upper : (n,) arrays
        Position limits, rad or m, that keep followers inside theirs too; −inf and inf where there
        is none.
    velocity_limit : (n,) array
        Speed limits, rad/s or m/s; inf where there is none.
    revolute : (n,) array of bool
        False if the joint is prismatic.
    reference : (n,) array
        The reference pose: the SRDF's, where the catalogue names one, else mid-range.
    poses : dict of (n,) arrays
        ``reference``; ``ready``, a pose to work from, where the catalogue has one; ``middle`` of
        the joints' range.
    locked : tuple of str
        Joints held at the reference pose.
    package_dirs : tuple of str
        Folders that resolve ``package://`` meshes.
    base : str or None
        The link in whose frame placements are measured, wherever in the tree; the root where None.
    surroundings : Description or None
        The robot's surroundings, measured from its root.
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
        """The frame of ``base`` in the model."""
        return 0 if self.base is None else frame_id(self.model, self.base)
