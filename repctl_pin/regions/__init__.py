"""Design regions Ω: boxes and tubes in joint space, boxes of the workspace.

A design minimises the mean of its cost over Ω, and guarantees repeatability only there.
"""

from .box import Box
from .region import Region
from .tube import Tube
from .workspace_box import WorkspaceBox

__all__ = ["Box", "Region", "Tube", "WorkspaceBox"]
