"""Search of functions of arms with locked joints, where they cover more than other functions.

A table is a grid of radius and height around the arm, at the angle 0. A flood is the set of its
nodes that the arm reaches from one configuration without a change of branch (of the inverse
kinematics). A locked flood is that of an arm with r of its joints locked, which is therefore not
redundant. Symmetries are the joints that alone turn the whole arm, or the tool; ``line`` (2, 3) is
the axis of the joint that turns the arm: a point, m, and a direction. The argument ``fit`` has the
arguments of a design.

``Floods`` are S floods: each is a set of neighbouring nodes with one configuration per node, so
that q changes continuously. ``Table`` is a grid of poses (nodes) over radius and height around an
axis, at the angle 0 and one orientation. ``Symmetry`` is a joint that changes only one coordinate
of the frame: the indices of both, and the sign, 1 or −1, of the change. ``LargerArm`` is an arm
with locked joints that covers a larger sector than a design. ``CellFit`` holds the arguments of a
design over a cell, and the methods that compute the design. ``Required`` holds the limits of a
function: mean and maximum extra joint speed relative to J⁺ (0.05 is 5 %), and body distance, m.
"""

from __future__ import annotations

from contextlib import suppress

from ....base.arguments import Array
from ....base.errors import RepctlError
from ..cell_design_result import CellDesign
from ..fit.cell_fit import CellFit
from ..fit.locked_function import locked_function
from ..fit.trimming import Required, kept_where_good
from ..geometry.sector import Sector
from ..geometry.symmetry import Symmetry
from .designs import larger_of
from .flood import Table
from .flood_sets import Floods
from .largest_profile import area_of
from .locked_arms import LargerArm, larger_arm, with_middles
from .sectors import central, shaped_sector


class LockedSearch:
    """Functions of arms with locked joints, where they cover more than other functions.

    Such an arm can keep away from bodies where a function with minimum joint speed comes too near.

    Parameters
    ----------
    fit
        Arguments of the designs.
    table
        The table.
    locked
        Floods with locked joints. Floods that begin in the middle of a design are added later.
    line, symmetries
        Axis of the arm, and the joints that alone turn the arm and the tool.
    """

    def __init__(
        self,
        fit: CellFit,
        table: Table,
        locked: Floods,
        line: Array,
        symmetries: tuple[Symmetry, ...],
    ) -> None:
        self.locked = locked
        self._fit, self._table, self._line, self._symmetries = fit, table, line, symmetries

    def larger(self, design: CellDesign, limits: Required) -> LargerArm | None:
        """Find an arm with locked joints that covers a larger sector than a design, or None."""
        cell = design.function.chart.cell
        assert isinstance(cell, Sector), "a table is a sector"
        return larger_arm(self._table, self.locked, cell, area_of(design.cell), limits)

    def at_least_locked(
        self, design: CellDesign, limits: Required
    ) -> tuple[CellDesign, LargerArm | None]:
        """Return a design that covers as much as arms with locked joints, if one is found.

        If an arm with locked joints covers a larger sector than the given design, its function is
        evaluated, and cut where it fails. Return the larger of the two designs. Return also an arm
        with locked joints that covers a still larger sector, or None.
        """
        self.locked = with_middles(self._table, self.locked, design)
        larger = self.larger(design, limits)
        if larger is None:
            return design, None
        found = self._function(larger, limits)
        if found is None or larger_of(found, design) is design:
            return design, larger
        return found, self.larger(found, limits)

    def _function(self, larger: LargerArm, limits: Required) -> CellDesign | None:
        """Make the function of a locked arm over its sector, and cut the sector where it fails.

        Return None if too little is left.
        """
        task = self._table.task
        q, turns = central(task, self._symmetries, larger.posture)
        cell = shaped_sector(self._table, self._line, self._symmetries, larger.found, turns)
        joints = [task.joint_names.index(name) for name in larger.arm.joints]
        with suppress(RepctlError):
            found = locked_function(self._fit, cell, q, joints)
            return found and kept_where_good(self._fit, found, limits)
        return None
