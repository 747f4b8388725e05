"""Formulas of kinematic redundancy: arrays in, arrays out, batched over leading axes; knows no robot."""

from .augmented import augmented_inverse, clearance, repeatable_inverse
from .inverses import (
    from_null_component,
    null_component,
    pseudoinverse,
    pseudoinverse_derivative,
    weighted_pseudoinverse,
)
from .nullspace import align, null_vector, nullspace

__all__ = [
    "align",
    "augmented_inverse",
    "clearance",
    "from_null_component",
    "null_component",
    "null_vector",
    "nullspace",
    "pseudoinverse",
    "pseudoinverse_derivative",
    "repeatable_inverse",
    "weighted_pseudoinverse",
]
