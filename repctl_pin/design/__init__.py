"""The nearest repeatable inverse, found off-line over a region of joint space."""

from .compare import compare as compare
from .compare import settled as settled
from .family import FamilyDesign as FamilyDesign
from .family import nearest_in_family as nearest_in_family
from .nearest import nearest_repeatable as nearest_repeatable
from .result import Design as Design
from .singularities import SingularRegionError as SingularRegionError
