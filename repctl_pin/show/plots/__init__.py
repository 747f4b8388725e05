"""Figures by matplotlib."""

# ruff: noqa: E402  (a package that is missing is named before it is imported)
from ...errors import needed

needed("matplotlib", by="a figure")

from .cycles import cycle_figure as cycle_figure
from .cycles import margin_over_cycles as margin_over_cycles
from .cycles import orbit as orbit
from .cycles import orbits_figure as orbits_figure
from .cycles import speed_over_cycle as speed_over_cycle
from .designs import design_figure as design_figure
from .designs import joint_map as joint_map
from .motions import drawn as drawn
from .motions import drift_figure as drift_figure
from .motions import drift_over_cycles as drift_over_cycles
from .motions import joint_over_cycles as joint_over_cycles
from .motions import joints_figure as joints_figure
from .motions import liveliest_joints as liveliest_joints
