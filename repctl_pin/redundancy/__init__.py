"""Formulas of kinematic redundancy: arrays in, arrays out, batched over leading axes; knows no robot."""

from .augmented import augmented_inverse, leaf_margin, repeatable_inverse
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
    "from_null_component",
    "leaf_margin",
    "null_component",
    "null_vector",
    "nullspace",
    "pseudoinverse",
    "pseudoinverse_derivative",
    "repeatable_inverse",
    "weighted_pseudoinverse",
]
