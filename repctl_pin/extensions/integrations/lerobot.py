"""Adapter with the interface of LeRobot's ``RobotKinematics``; LeRobot itself is not required.

Letters: n joints of the task, r numbers of the level c.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import Array, require_type, vector
from ...base.errors import InputError
from ..cells.function import InverseFunction


class FunctionKinematics:
    """Forward and inverse kinematics for LeRobot's processors, by a cell's function.

    A cell is a box of poses over which a function F gives one configuration per pose, independent
    of the current configuration. So one pose of a policy always leads to one configuration. A leaf
    is the set of configurations that F gives for one level c, the position along the self-motion.
    Revolute joints are in degrees, prismatic joints in m, poses are homogeneous matrices (4, 4).

    Parameters
    ----------
    F
        Function of a cell: ``found.function``, with ``found`` the design of a cell.
    leaf : (r,) array, optional
        Level c, rad (m for prismatic joints), by default 0; another level moves the elbow along the
        self-motion.

    Attributes
    ----------
    joint_names : list of str
        Names of the joints, in the order of all arrays.

    Raises
    ------
    InputError
        If a pose is outside the cell, or an array has too few joints.

    Examples
    --------
    >>> from repctl_pin.extensions.integrations.lerobot import FunctionKinematics
    >>> kinematics = FunctionKinematics(found.function)
    >>> degrees = kinematics.inverse_kinematics(degrees, pose)
    """

    def __init__(self, F: InverseFunction, leaf: ArrayLike | None = None) -> None:
        require_type(F, InverseFunction, "F", "a cell's function, such as found.function")
        self.function, self.leaf = F, leaf
        self.joint_names = list(F.task.joint_names)
        self._units = np.where(F.task.revolute, np.pi / 180, 1.0)

    def forward_kinematics(self, joint_pos_deg: ArrayLike) -> Array:
        """Compute the pose (4, 4) of the frame at joint positions, in degrees and m.

        Positions after the first n, such as a gripper's, are ignored.
        """
        return self.function.task.placement(self._arm(joint_pos_deg) * self._units).homogeneous

    def inverse_kinematics(
        self,
        current_joint_pos: ArrayLike,
        desired_ee_pose: ArrayLike,
        position_weight: float = 1.0,
        orientation_weight: float = 0.01,
    ) -> Array:
        """Compute the joint positions of a pose by F, which needs no initial guess.

        The result replaces the first n of the current positions, in degrees and m; those after
        them, such as a gripper's, are returned unchanged. The weights are part of LeRobot's
        interface, but have no effect, because F is exact.
        """
        joints = np.array(current_joint_pos, float)
        joints[: len(self._arm(joints))] = (
            self.function(np.asarray(desired_ee_pose, float), leaf=self.leaf) / self._units
        )
        return joints

    def _arm(self, joints: ArrayLike) -> Array:
        """Return the first n joint positions, in degrees and m; InputError if there are fewer."""
        n = len(self.joint_names)
        given = np.atleast_1d(np.asarray(joints, float))
        if len(given) < n:
            raise InputError(
                f"needs {n} joint positions ({', '.join(self.joint_names)}); got {len(given)}",
                argument="current_joint_pos",
            )
        return vector(given[:n], n, "the joint positions", "one per joint")
