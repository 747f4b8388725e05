"""Choice of the desired inverse G_d: J⁺, or J⁺ with a weight."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..model.task import Task
from ..strategies import Inverse, Pseudoinverse, WeightedInverse


def choose_desired(task: Task, weight: ArrayLike | str | None) -> tuple[Inverse, str]:
    """Create the desired inverse G_d, and its description.

    G_d is J⁺ for None, or J⁺ weighted by ``inertia``, by ``limits``, or by numbers.
    """
    if weight is None:
        return Pseudoinverse(task), "J⁺"
    if isinstance(weight, str) and weight == "limits":
        from ..strategies.limit_weight import LimitWeight

        limits = WeightedInverse(task, LimitWeight(task))
        return limits, "J⁺ weighted by the nearness of joint limits"
    desired = WeightedInverse(task, weight)
    if isinstance(weight, str):
        return desired, "J⁺ weighted by the inertia (least kinetic energy)"
    numbers = ", ".join(f"{x:g}" for x in np.ravel(weight))
    return desired, f"J⁺ weighted by {numbers}"
