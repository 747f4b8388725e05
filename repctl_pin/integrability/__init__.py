"""Repeatability tests: the Lie bracket condition, predicted drift, and stable surfaces."""

from .derivative import differentiate as differentiate
from .lie_bracket import bracket_defect as bracket_defect
from .lie_bracket import brackets as brackets
from .lie_bracket import defects as defects
from .lie_bracket import drift_per_area as drift_per_area
from .lie_bracket import measure as measure
from .repeatability import Repeatability as Repeatability
from .repeatability import is_repeatable as is_repeatable
from .stable_surface import Surfaces as Surfaces
from .stable_surface import stable_surface as stable_surface
