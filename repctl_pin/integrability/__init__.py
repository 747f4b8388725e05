"""Is a control strategy repeatable? The Lie bracket condition, the drift it predicts, and stable surfaces."""

from .differences import differentiate
from .lie_bracket import bracket_defect, brackets, curl_form, defects, drift_per_area, measure
from .repeatability import Repeatability, is_repeatable
from .stable_surface import Surfaces, candidate_surface, stable_surface

__all__ = [
    "Repeatability",
    "Surfaces",
    "bracket_defect",
    "brackets",
    "candidate_surface",
    "curl_form",
    "defects",
    "differentiate",
    "drift_per_area",
    "is_repeatable",
    "measure",
    "stable_surface",
]
