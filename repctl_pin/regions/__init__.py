"""Ω, where closeness is measured: boxes and tubes in joint space, boxes of the workspace."""

from .box import Box, Region
from .tube import Tube
from .workspace_box import WorkspaceBox

__all__ = ["Box", "Region", "Tube", "WorkspaceBox"]
