"""Repeatability tests: the Lie bracket condition, predicted drift, and stable surfaces.

The tests tell whether an inverse G drifts, without following a path. The Lie bracket of two columns
of G is the joint motion that remains after a small loop of the frame along both. Numbers in
parentheses, such as (24), are equations of the paper that docs/notation.md names.
"""

from .derivative import differentiate as differentiate
from .lie_bracket import bracket_defect as bracket_defect
from .lie_bracket import brackets as brackets
from .lie_bracket import defects as defects
from .lie_bracket import drift_per_area as drift_per_area
from .lie_bracket import measure as measure
