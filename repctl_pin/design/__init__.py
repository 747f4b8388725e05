"""Design of the nearest repeatable inverse over a region of joint space, off-line."""

from .design_result import Design as Design
from .nearest import nearest_repeatable as nearest_repeatable
from .singularity_search import SingularRegionError as SingularRegionError
