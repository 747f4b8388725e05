"""Where a motion goes beyond what a robot can do: out of its joint limits, or into itself."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import InputError
from .joint_motion import JointMotion, cycle_of


@dataclass(frozen=True)
class Violation:
    """The first time a joint leaves its limits, or two bodies touch.

    Attributes
    ----------
    moment : float
        When, in cycles and fractions of one: 2.5 is the middle of the third.
    cycle : int
        Which cycle that is, from 1.
    names : tuple of str
        The joint, or the two links.
    """

    moment: float
    cycle: int
    names: tuple[str, ...]

    def __str__(self) -> str:
        names, share = " and ".join(self.names), self.moment - self.cycle + 1
        where = f"in cycle {self.cycle}, {share:.0%} of the way round"
        if len(self.names) == 1:
            return f"{names} leaves its limits {where}"
        return f"{names} touch {where if self.moment else 'from the start'}"


def violations_of(motion: JointMotion, bodies: JointMotion | None = None) -> tuple[Violation, ...]:
    """List the first limit that a motion leaves and the first touch of two bodies, whichever comes first.

    Parameters
    ----------
    motion
        What is looked at.
    bodies
        The same motion at fewer points, where bodies are to be looked at less often.
    """
    beyond, touch = motion.first_violation, (bodies or motion).first_touch
    found: list[tuple[float, tuple[str, ...]]] = [(beyond[0], beyond[1:])] if beyond else []
    found += [touch] if touch else []
    return tuple(Violation(moment, cycle_of(moment, motion.cycles), names) for moment, names in sorted(found))


def refuse_violations(motion: JointMotion, remedy: str) -> None:
    """Refuse to give a robot a motion that leaves its limits or touches itself.

    Raises
    ------
    InputError
        The cycle, the moment and the joint or the links are named.
    """
    found = violations_of(motion)
    if found:
        raise InputError(f"{'; '.join(map(str, found))}: no file for a robot is written; {remedy}")
