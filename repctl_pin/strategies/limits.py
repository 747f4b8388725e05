"""A weight for the weighted pseudoinverse that spares joints near their limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import positive, vector
from ..errors import InputError
from ..robot.task import Task, wanted_task

Array = NDArray[np.float64]


class LimitWeight:
    r"""Weights that grow as a joint nears a limit, for ``WeightedInverse(task, LimitWeight(task))``:

    .. math:: w_i = 1 + \text{gain} \left( \frac{(u_i - l_i)^2}{4 (u_i - q_i)(q_i - l_i)} - 1 \right),

    1 in the middle, without bound at the limits l and u, smooth between; 1 for joints without limits.

    Parameters
    ----------
    task
        The task whose limits count.
    gain : float
        How strongly; 0 is the plain pseudoinverse.

    Raises
    ------
    InputError
        If the gain is negative, or the task's coordinates mix joints: a weight per coordinate cannot spare a single
        joint then.

    Examples
    --------
    >>> weight = rp.LimitWeight(panda)
    >>> weight(panda.reference).shape
    (7,)
    >>> G = rp.WeightedInverse(panda, weight)
    """

    def __init__(self, task: Task, gain: float = 1.0) -> None:
        if (np.count_nonzero(wanted_task(task).T, axis=1) > 1).any():
            raise InputError(
                "a limit weight needs one joint for every coordinate, but q = T ψ of this task mixes joints; "
                "take the task without in_coordinates"
            )
        self.lower, self.upper = np.array(task.lower), np.array(task.upper)
        self.names, self.gain = task.joint_names, positive(gain, "the gain of a limit weight", zero=True)

    def __call__(self, q: ArrayLike) -> Array:
        """Evaluate the weights (n,).

        Raises
        ------
        InputError
            If a joint is on or outside its limits.
        """
        q = vector(q, len(self.names), "q")
        limited = np.isfinite(self.lower) & np.isfinite(self.upper)
        below, above = np.where(limited, q - self.lower, 1.0), np.where(limited, self.upper - q, 1.0)
        if not ((below > 0) & (above > 0)).all():
            i = int(np.argmin(np.minimum(below, above)))
            raise InputError(
                f"{self.names[i]} = {q[i]:g} is not inside its limits [{self.lower[i]:g}, {self.upper[i]:g}], "
                "where a limit weight is defined; make the region smaller"
            )
        span = np.where(limited, self.upper - self.lower, 2.0)
        return 1 + self.gain * (span**2 / (4 * below * above) - 1)
