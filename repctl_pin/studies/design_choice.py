"""Choice of the desired inverse of a design, and of its degree by the expected computing time.

The desired inverse G_d is J⁺ or a weighted inverse; the design is the repeatable inverse nearest to
G_d. The degree is that of the polynomials that the design uses as potentials, the functions of the
joints that the controller holds constant.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ..base.defaults import DEGREE, NODES
from ..base.errors import InputError
from ..model.task import Task
from ..potentials import Polynomial
from ..strategies import Inverse, Pseudoinverse, WeightedInverse

_LONG = 60.0
"""Estimated processor time of a design, s, above which a lower degree is chosen, or a note made."""

_TOO_LONG = 600.0
"""Estimated processor time, s, above which a study is refused unless its degree was given."""

_RATE = 3000.0
"""Speed of a design: entries of the Gauss–Newton matrix summed over ``NODES`` nodes, per second."""


def choose_desired(task: Task, weight: ArrayLike | str | None) -> tuple[Inverse, str]:
    """Create the desired inverse G_d, which a design approximates, and its description.

    G_d is J⁺ for None, or J⁺ weighted by ``inertia``, by ``limits`` (joints near their limits move
    less), by ``absolute`` (minimum speeds of a planar arm's links), or by numbers: (n,) or (n, n).
    The description is a text such as ``J⁺ weighted by the inertia``.
    """
    if weight is None:
        return Pseudoinverse(task), "J⁺"
    if isinstance(weight, str) and weight == "limits":
        from ..strategies.limit_weight import LimitWeight

        limits = WeightedInverse(task, LimitWeight(task))
        return limits, "J⁺ weighted by the nearness of joint limits"
    if isinstance(weight, str) and weight == "absolute":
        from ..model.absolute_angles import absolute_angles

        links = WeightedInverse(task, absolute_angles(task))
        return links, "J⁺ weighted by absolute angles (minimum speeds of the links)"
    desired = WeightedInverse(task, weight)
    if isinstance(weight, str):
        return desired, "J⁺ weighted by the inertia (minimum kinetic energy)"
    numbers = ", ".join(f"{x:g}" for x in np.ravel(weight))
    return desired, f"J⁺ weighted by {numbers}"


def _design_seconds(task: Task, degree: int) -> float:
    """Estimate the processor time, s, of a design with polynomials, within a factor of 3."""
    N = math.comb(task.n + degree, degree) - 1
    nodes = max(1.0, 32 * (N - task.r) * task.r / task.m / NODES)
    return nodes * N**2 * task.r * (task.r + 1) / 2 / _RATE


def choose_degree(task: Task, degree: int | None) -> tuple[int, list[str]]:
    """Choose the degree of a study's polynomials: as given, else 2, or 1 if 2 would take long.

    Returns the degree, and a list of notes. There is one note, on the computing time, if a design
    of the given degree takes more than a minute, or if degree 1 replaces degree 2 for this reason.
    A study that would take over ten minutes even at degree 1 is refused unless the degree was
    given.

    Raises
    ------
    InputError
        If the degree gives too many polynomials, or would take very long and was not given.
    """
    if degree is not None:
        check_degree(task, degree)
        seconds = _design_seconds(task, degree)
        if seconds <= _LONG:
            return degree, []
        time = f"a design of degree {degree} for {task.n} joints takes {_about(seconds)}"
        return degree, [f"{time}; a lower degree takes less"]
    seconds = _design_seconds(task, DEGREE)
    if seconds <= _LONG:
        check_degree(task, DEGREE)
        return DEGREE, []
    least = _design_seconds(task, 1)
    if least > _TOO_LONG:
        raise InputError(
            f": a study of {task.n} joints takes {_about(least)} even at degree 1",
            argument="degree",
            remedy="choose a frame that fewer joints move, lock joints, or pass degree=1",
        )
    times = f"{_about(least)}; degree 2 would take {_about(seconds)} for {task.n} joints"
    return 1, [f"degree 1 is used, which takes {times} and is used only if it is given"]


def check_degree(task: Task, degree: int) -> None:
    """Check, before a design begins, that its degree does not give too many potentials.

    The potentials are polynomials in all joints of the task, so their number grows fast with the
    degree and the number of joints.

    Raises
    ------
    InputError
        If there are too many potentials; the remedy is a lower degree.
    """
    try:
        Polynomial(task.reference, degree)
    except InputError as error:
        error.remedy = "lower the degree"  # a design takes all joints as variables
        raise


def _about(seconds: float) -> str:
    """Format an estimated time in seconds, minutes or hours, such as ``about 5 min``."""
    if seconds < 100:
        return f"about {max(seconds, 1):.0f} s"
    if seconds < 6000:
        return f"about {seconds / 60:.0f} min"
    return f"about {seconds / 3600:.0f} h"
