"""The nearest repeatable inverse, found off-line over a region of joint space."""

from .compare import settled
from .family import FamilyDesign, nearest_in_family
from .nearest import nearest_repeatable
from .region import Box, Region
from .result import Design
from .search import SingularRegionError
from .storage import load, save
from .tube import Tube
from .workspace import WorkspaceBox

__all__ = [
    "Box",
    "Design",
    "FamilyDesign",
    "Region",
    "SingularRegionError",
    "Tube",
    "WorkspaceBox",
    "load",
    "nearest_in_family",
    "nearest_repeatable",
    "save",
    "settled",
]
