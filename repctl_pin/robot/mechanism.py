"""The moving parts of a robot: what a task and a drawing need to know of it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..urdf.catalogue import Entry
from ..urdf.gate import Description

Array = NDArray[np.float64]


class Mechanism:
    """Movable joints, one number each, their limits, and a reference pose.

    Attributes
    ----------
    name : str
        The catalogue name, or the name in the file.
    description : Description
        What the URDF says.
    entry : Entry or None
        Its entry in the catalogue.
    model : pinocchio.Model
        All movable joints; the others are fixed at the reference pose.
    joint_names : tuple of str
        Movable joints, in Pinocchio's order.
    lower, upper : (nq,) arrays
        Position limits, rad or m; −inf and inf where there is none.
    velocity : (nq,) array
        Speed limits, rad/s or m/s; inf where there is none.
    revolute : (nq,) array of bool
        False where the joint is prismatic.
    reference : (nq,) array
        The reference pose: the SRDF's, where the catalogue names one, else mid-range.
    poses : dict of (nq,) arrays
        ``reference``; ``ready``, a pose to work from, where the catalogue has one; ``middle`` of the joints' range.
    locked : tuple of str
        Joints held at the reference pose.
    package_dirs : tuple of str
        Folders that resolve ``package://`` meshes.
    base : str or None
        The link in whose frame placements are measured; the root where None.
    """

    name: str
    description: Description
    entry: Entry | None
    model: pin.Model
    joint_names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    revolute: NDArray[np.bool_]
    reference: Array
    poses: dict[str, Array]
    locked: tuple[str, ...]
    package_dirs: tuple[str, ...]
    base: str | None
