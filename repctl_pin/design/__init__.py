"""The nearest repeatable inverse, found off-line over a region of joint space."""

from .compare import compare, settled
from .family import FamilyDesign, nearest_in_family
from .nearest import nearest_repeatable
from .result import Design
from .singularities import SingularRegionError

__all__ = [
    "Design",
    "FamilyDesign",
    "SingularRegionError",
    "compare",
    "nearest_in_family",
    "nearest_repeatable",
    "settled",
]
