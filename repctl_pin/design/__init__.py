"""Design of the nearest repeatable inverse over a region of joint space, off-line."""

from .compare import compare as compare
from .compare import cost_has_converged as cost_has_converged
from .design_result import Design as Design
from .nearest import nearest_repeatable as nearest_repeatable
from .singularity_search import SingularRegionError as SingularRegionError
