"""Choice of the start of a problem for which a closed motion needs minimum joint speed."""

from __future__ import annotations

from ..motion import least_start
from .problem import Problem


def at_minimum_speed(problem: Problem) -> Problem:
    """Copy a problem, with the start moved along its self-motion to minimum joint speed.

    The path does not change. The new start has at least half of the largest joint-limit margin
    found, and no bodies collide; see :func:`repctl_pin.motion.least_start.least_start`.

    Raises
    ------
    InputError, SingularityError
        If there is no closed motion from the problem's start.
    """
    task, path, q0 = problem.task, problem.cycle, problem.start
    found = least_start(task, path, q0)
    saved = 1 - found.best.rms_speed / found.given.rms_speed
    note = "no other start tried needs less joint speed"
    if saved > 0:
        note = f"the start was moved along the self-motion, to {100 * saved:.0f} % less joint speed"
    return problem._with(
        start=found.best.q[0],
        given=problem.given | {"start"},
        moved=(*problem.moved, note),
    )
