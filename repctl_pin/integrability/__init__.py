"""Repeatability tests: the Lie bracket condition, predicted drift, and stable surfaces."""

from .derivative import differentiate as differentiate
from .lie_bracket import bracket_defect as bracket_defect
from .lie_bracket import brackets as brackets
from .lie_bracket import defects as defects
from .lie_bracket import drift_per_area as drift_per_area
from .lie_bracket import measure as measure
