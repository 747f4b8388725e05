"""Weight for the weighted pseudoinverse that slows joints near their limits.

G is an inverse of the Jacobian J, with J G = I, such as the pseudoinverse J⁺.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array, positive, vector
from ..model.task import Task, require_task


class LimitWeight:
    r"""Weights of the joint speeds that grow near joint limits.

    ``WeightedInverse(task, LimitWeight(task))`` uses the weights

    .. math:: w_i = 1 + \text{gain} \sum_\mu \left( 1 + (\max(\mu, 0) / \rho_i)^2 \right)^{-2}.

    The sum is over the two distances μ of q_i from its lower and its upper limit, and ρ_i is
    ``onset`` times half the joint's range. w_i is about 1 in the middle of the range and 1 + gain
    at a limit and beyond, with a continuous slope; it is 1 for a joint that lacks either limit. Let
    M be diag w, e_i the i-th unit vector, and J⁺_M the inverse with the weight M. The norm with
    this weight is ``‖X‖²_M = tr(Xᵀ M X)``. Then ``‖G − J⁺_M‖²_M`` is ``‖G − J⁺‖² + Σ_i (w_i − 1)
    ‖e_iᵀ G‖²``, up to a constant. So a design near J⁺_M is near J⁺, but slow near limits.

    Parameters
    ----------
    task
        Task whose joint limits are used.
    gain : float
        Additional weight at a limit; 0 gives the plain pseudoinverse.
    onset : float
        Distance from a limit at which the weight rises, as a share of half the joint's range.

    Raises
    ------
    InputError
        If the gain is negative, or the onset is not above 0.

    Examples
    --------
    >>> weight = rp.LimitWeight(panda)
    >>> weight(panda.reference).shape
    (7,)
    >>> G = rp.WeightedInverse(panda, weight)
    """

    def __init__(self, task: Task, gain: float = 1.0, onset: float = 0.1) -> None:
        self.lower, self.upper, self.n = require_task(task).lower, task.upper, task.n
        self.gain = positive(gain, "the gain of a limit weight", zero=True)
        self.onset = positive(onset, "the onset of a limit weight")

    def __repr__(self) -> str:
        return f"<LimitWeight of {self.n} joints: gain {self.gain:g}, onset {self.onset:g}>"

    def __call__(self, q: ArrayLike) -> Array:
        """Evaluate the weights w (n,) of the joint speeds at q (n,), larger near limits."""
        q = vector(q, self.n, "q")
        limited = np.isfinite(self.lower) & np.isfinite(self.upper)
        onset = np.where(limited, self.onset * (self.upper - self.lower) / 2, 1.0)
        margins = np.where(limited, [q - self.lower, self.upper - q], np.inf)
        return 1 + self.gain * np.sum((1 + (np.maximum(margins, 0) / onset) ** 2) ** -2, axis=0)
