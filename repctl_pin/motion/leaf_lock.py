"""Leaf lock: Newton steps from point to point of a path, on a leaf h(q) = c."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..arguments import as_int, freeze, positive, read_only

_MOST_CORRECTIONS = 1000
"""Maximum number of corrections per step; Newton's method has converged after a handful."""


@dataclass(frozen=True, eq=False)
@read_only
class LeafLock:
    """Leaf lock for :func:`follow`: Newton corrections of the task error and of c − h(q).

    ``q += J_V⁻¹ [x − f(q); c − h(q)]``, from point to point of the path: errors do not accumulate.

    Attributes
    ----------
    corrections : int
        Number of Newton corrections per step.
    leaf : (r,) array, optional
        Level c; by default h(q0).
    velocity_limit : float or (n,) array, optional
        Joint speed limits, rad/s or m/s.
    damping : float
        Maximum damping λ_max near singularities, see :meth:`RepeatableInverse.step`.

    Raises
    ------
    InputError
        If a number is out of its range.

    Examples
    --------
    >>> lock = rp.LeafLock(corrections=2)
    >>> motion = rp.follow(design.inverse, path, q0, cycles=3, steps=100, integrator=lock)
    >>> bool(motion.drift[-1] < 1e-6)  # rad
    True
    """

    corrections: int = 1
    leaf: ArrayLike | None = None
    velocity_limit: ArrayLike | None = None
    damping: float = 0.0

    def __post_init__(self) -> None:
        corrections = as_int(self.corrections, "corrections", 1, _MOST_CORRECTIONS)
        damping = positive(self.damping, "damping", zero=True)
        freeze(self, corrections=corrections, damping=damping)
