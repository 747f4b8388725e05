"""Formulas of kinematic redundancy on arrays, batched over leading axes.

J (m, n) is the Jacobian, N (n, r) an orthonormal basis of its null space, r = n − m, G an inverse
with J G = I, and V (n, r) the gradients of r potentials. Nothing here depends on a robot model.
Numbers in parentheses, such as (31), are equations of the paper, see ``docs/notation.md``.
"""

from .augmented import augmented_inverse as augmented_inverse
from .augmented import leaf_margin as leaf_margin
from .augmented import repeatable_inverse as repeatable_inverse
from .inverses import from_null_component as from_null_component
from .inverses import null_component as null_component
from .inverses import pseudoinverse as pseudoinverse
from .inverses import pseudoinverse_derivative as pseudoinverse_derivative
from .inverses import weighted_pseudoinverse as weighted_pseudoinverse
from .nullspace import align as align
from .nullspace import null_vector as null_vector
from .nullspace import nullspace as nullspace
