"""Inverse kinematic function of another tool on the same body: ``F'(x) = F(x T⁻¹)``.

F gives one configuration for each pose x of the frame in a cell, a box of poses; T is the placement
of the tool in the frame. A change of the tool thus needs no new design. The level c (r,) of F is
the position along the self-motion, with r components; a leaf is the set of configurations with one
level. n is the number of joints, m that of task coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...base.arguments import Array, as_int
from ...base.errors import InputError
from ...model.chain_formulas import Placement, as_placement, as_placements
from ...model.task import Task
from ...model.tool import rigid, with_tool
from ...strategies import RepeatableInverse
from .chart.chart import CellPotentials
from .geometry.cell import Cell
from .targets import FORMS, as_poses, homogeneous


class ToolFunction:
    """Function over the poses of a tool, from the function of the frame that carries it.

    The function gives one configuration for each pose. :meth:`InverseFunction.with_tool` makes it.

    Attributes
    ----------
    of_frame : InverseFunction
        Function F of the frame.
    task : Task
        Pose task of the tool.
    tool : pinocchio.SE3
        Placement T of the tool in the frame.
    """

    def __init__(self, of_frame: Any, placement: Placement) -> None:
        self.of_frame = of_frame
        self.task: Task = with_tool(of_frame.task, placement)
        self.tool: pin.SE3 = rigid(placement)
        self._back = self.tool.inverse()

    @property
    def cell(self) -> Cell:
        """Cell of the poses x of the frame that carries the tool; the poses of the tool are x T."""
        cell: Cell = self.of_frame.cell
        return cell

    def __call__(self, target: Placement, *, leaf: ArrayLike | None = None) -> Array:
        """Evaluate F': the configuration (n,) for a pose of the tool.

        ``target`` is the pose of the tool: a pinocchio.SE3 or a homogeneous matrix (4, 4). ``leaf``
        is the level c (r,), by default 0. An InputError is raised if the pose of the frame lies
        outside the cell, or F has no configuration inside the limits there.
        """
        q: Array = self.of_frame(as_placement(target) * self._back, leaf=leaf)
        return q

    def batch(
        self,
        targets: Sequence[Placement] | Array,
        *,
        leaf: ArrayLike | None = None,
        missing: Literal["raise", "nan"] = "raise",
        threads: int = 1,
    ) -> Array:
        """Evaluate F' at K poses of the tool: configurations (K, n), rad (m for prismatic joints).

        Parameters
        ----------
        targets : list of placements, or (K, 4, 4) or (K, 7) array
            Poses of the tool. Coordinates of the cell are not accepted, because they describe poses
            of the frame; give them to ``of_frame``.
            A row of seven is a position, m, and a quaternion, ``x, y, z, qx, qy, qz, qw``.
        leaf : (r,) or (K, r) array, optional
            Level c, by default 0: one for all poses, or one for each pose.
        missing : "raise" or "nan"
            Result for a pose outside the cell or without a configuration: an InputError, or a row
            of NaN.
        threads
            Number of threads.
        """
        threads = as_int(threads, "threads", 1)
        if isinstance(targets, np.ndarray):
            if (targets.ndim == 2 and targets.shape[1] != 7) or targets.ndim < 2:
                raise InputError(
                    "poses of a tool must be placements, or a (K, 4, 4) or (K, 7) array",
                    remedy="if they are coordinates of the cell, give them to this function's "
                    "attribute of_frame",
                )
            X = homogeneous(*as_poses(self.task, targets))
        else:
            listed = as_placements(targets, "target", FORMS)
            X = np.array([one.homogeneous for one in listed]).reshape(-1, 4, 4)
        X = X @ self._back.homogeneous
        Q: Array = self.of_frame.batch(X, leaf=leaf, missing=missing, threads=threads)
        return Q

    def pose_and_leaf(self, Q: ArrayLike) -> tuple[Array, Array]:
        """Compute the tool's poses X (K, 4, 4) and the levels c (K, r) of K configurations.

        Q (K, n) are configurations; X are homogeneous matrices. The level is NaN where the pose of
        the frame lies outside the cell.
        """
        X, C = self.of_frame.pose_and_leaf(Q)
        return X @ self.tool.homogeneous, C

    def jacobian(self, target: Placement, *, leaf: ArrayLike | None = None) -> Array:
        """Evaluate ∂F'/∂x (n, m) at a pose of the tool: the joint velocity per task velocity.

        ``leaf`` is the level c (r,), by default 0, which stays constant while the tool moves.
        """
        return self.inverse(self(target, leaf=leaf))

    @cached_property
    def inverse(self) -> RepeatableInverse:
        """Controller ``q̇ = ∂F'/∂x ẋ`` of the tool, evaluated in NumPy.

        On its leaf c = 0, the configurations are those of F'.
        """
        potentials: Any = _FramePotentials(self.of_frame.chart)
        return RepeatableInverse(self.task, potentials)

    def leaves(self, target: Placement) -> Array:
        """Find the range (low, high) of each component of the level at a pose of the tool: (r, 2).

        While one component varies over its range, the others are 0. A range ends at a joint limit,
        at ±π, or near a singularity of the equations of F, see :meth:`InverseFunction.leaves`.
        """
        intervals: Array = self.of_frame.leaves(as_placement(target) * self._back)
        return intervals

    def with_tool(self, placement: Placement) -> ToolFunction:
        """Create the function of another tool, placed at ``placement`` in this tool's frame."""
        further = as_placement(placement, "placement")
        return ToolFunction(self.of_frame, self.tool * further)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.of_frame, self.tool)

    def __repr__(self) -> str:
        x, y, z = self.tool.translation
        return f"<ToolFunction at ({x:.4g}, {y:.4g}, {z:.4g}) m of {self.of_frame!r}>"


class _FramePotentials(CellPotentials):
    """Potentials of the frame's function F. As functions of q, they do not depend on the tool.

    A controller that holds these potentials constant follows F'. C evaluates potentials only at the
    pose of the task's own frame, which is here the tool. So these potentials cannot be evaluated in
    C.
    """

    def _native_part(self) -> Any:
        """Raise an InputError: these potentials cannot be evaluated in C."""
        raise InputError(
            "a function that was converted to another tool cannot be evaluated in C",
            remedy="use the frame's function, of_frame, with poses x T⁻¹ (T: the tool's placement)",
        )
