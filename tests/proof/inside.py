"""The modules of the package whose bounds these tests examine: they are reached from here only.

Users get a proof, and not its parts, so the bounds have no public names.
"""

from repctl_pin.extensions.cells.evaluate import margins
from repctl_pin.extensions.proof import (
    arm_angle,
    boxes,
    cell_search,
    cells,
    chain,
    enclosure,
    leaf_margin_bounds,
    lifts,
    study,
    taylor,
)

__all__ = [
    "arm_angle",
    "boxes",
    "cell_search",
    "cells",
    "chain",
    "enclosure",
    "leaf_margin_bounds",
    "lifts",
    "margins",
    "study",
    "taylor",
]
