"""The modules of the package whose bounds these tests examine: they are reached from here only.

Users get a proof, and not its parts, so the bounds have no public names.
"""

from repctl_pin.extensions.cells.evaluate import margins
from repctl_pin.extensions.proof import (
    arm_angle,
    boxes,
    cell_bounds,
    cell_branch_and_bound,
    chain,
    closed_path_proof,
    leaf_margin_bounds,
    lifts,
    study_certificate,
    taylor,
)

__all__ = [
    "arm_angle",
    "boxes",
    "cell_bounds",
    "cell_branch_and_bound",
    "chain",
    "closed_path_proof",
    "leaf_margin_bounds",
    "lifts",
    "margins",
    "study_certificate",
    "taylor",
]
