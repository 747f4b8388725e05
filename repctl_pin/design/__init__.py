"""Design of the nearest repeatable inverse over a region of joint space, off-line.

A desired inverse G_d, such as J⁺, is in general not repeatable: a closed path does not end in the
configuration it began in. A design finds potentials h(q) whose repeatable inverse G_r, which keeps
h constant, is nearest to G_d in the mean over the region Ω.
"""

from .design_result import Design as Design
from .nearest import nearest_repeatable as nearest_repeatable
from .singularity_search import SingularRegionError as SingularRegionError
