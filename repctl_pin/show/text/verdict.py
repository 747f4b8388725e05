"""One verdict on motions, and its three tiles: the same words on the page, in the report and in the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...motion.joint_motion import JointMotion, cycle_of
from ...studies import Study
from .numbers import metres, percent, radians


@dataclass(frozen=True)
class Deed:
    """What of one motion the verdict speaks of.

    Attributes
    ----------
    label : str
        What the control is called.
    creep : float
        How far the elbow is off its start at the end, m.
    speed : float
        Joint speed ‖q̇‖ over the first cycle, rms.
    broken : (int, str) or None
        The cycle in which a joint first leaves its limits, and which joint.
    apart : float or None
        The least distance between bodies, m; None where there are none.
    touch : int
        The cycle in which two bodies first touch; 0 where none do.
    haste : float
        The largest share of a joint's speed limit; above 1 it is broken.
    turn : (float, str)
        How far the turning joint that is farthest off its start at the end has turned, rad, and which it is.
    """

    label: str
    creep: float
    speed: float
    broken: tuple[int, str] | None = None
    apart: float | None = None
    touch: int = 0
    haste: float = 0.0
    turn: tuple[float, str] = (0.0, "")

    @property
    def twists(self) -> bool:
        """Whether a joint turns that the elbow does not tell of: by 0.1 rad, and over 1 rad for each 10 cm of creep."""
        return self.turn[0] >= 0.1 and self.turn[0] > 10 * self.creep


@dataclass(frozen=True)
class Tile:
    """One number of the verdict: its name, its value, and whether it is bad news."""

    name: str
    value: str
    bad: bool = False


@dataclass(frozen=True)
class Verdict:
    """A sentence, and the same in tiles: creep, joint speed, limits, bodies."""

    sentence: str
    tiles: tuple[Tile, ...]


NO_VERDICT = Verdict("", ())


def deed_of(label: str, motion: JointMotion, elbow: int, *, bodies: bool = True) -> Deed:
    """Take from a motion what the verdict speaks of.

    Parameters
    ----------
    label
        What the control is called.
    motion
        What it did.
    elbow
        The joint whose origin is the elbow, of the task's.
    bodies
        Whether the robot's other joints stand still, so that its bodies are where the task has them.
    """
    start, end = (motion.task.joint_origins(q)[elbow] for q in (motion.q[0], motion.q[-1]))
    violation, coarse = motion.first_violation, motion.coarse
    turned = np.abs(motion.q[-1] - motion.q[0]) * motion.task.revolute  # (n,)
    apart, touch = (float(coarse.body_distance.min()), coarse.first_touch) if bodies else (np.inf, None)
    return Deed(
        label,
        float(np.linalg.norm(end - start)),
        motion.first_rms_speed,
        None if violation is None else (motion.broken_cycle, violation[1]),
        apart if np.isfinite(apart) else None,
        0 if touch is None else cycle_of(touch[0], motion.cycles),
        motion.speed_ratio,
        (float(turned.max()), motion.task.joint_names[int(turned.argmax())]),
    )


def verdict(deeds: Sequence[Deed], cycles: int) -> Verdict:
    """Sum up motions: the first is what others are compared with, the last is the remedy.

    Parameters
    ----------
    deeds
        One for each motion.
    cycles
        Their number.
    """
    first, last = deeds[0], deeds[-1]
    times = "1 cycle" if cycles == 1 else f"{cycles} cycles"
    twists = any(deed.twists for deed in deeds)
    creeps = [_creep(deed, " and {} turns {}" if twists else "") for deed in deeds]
    limits = [f"broken in cycle {d.broken[0]} ({d.broken[1]})" if d.broken else "kept" for d in deeds]
    words = [
        f"The elbow creeps {' → '.join(dict.fromkeys(creeps))} in {times}."
        if creeps[0] == creeps[-1] or len(deeds) == 1
        else f"The elbow creeps {creeps[0]} in {times} → {creeps[-1]}."
    ]
    if creeps[0] == creeps[-1] == "0":
        words = [f"The elbow is back after {times}."]
    told = [_creep(deed, ", {} {}" if twists else "") for deed in deeds]
    tiles = [Tile(f"{'Elbow and joint' if twists else 'Elbow'} creep in {times}", " → ".join(told), told[-1] != "0")]
    if len(deeds) > 1:
        price = percent(last.speed / first.speed - 1) if first.speed > 0 else "–"
        words.append(f"Joint speed {price}.")
        tiles.append(Tile("Joint speed", price))
    hasty = any(deed.haste > 1 + 1e-9 for deed in deeds)
    if hasty:
        hastes = [f"broken, {d.haste:.2g} × the limit" if d.haste > 1 + 1e-9 else "kept" for d in deeds]
        said = " → ".join(dict.fromkeys(hastes))
        words.append(f"Speed limits {said}.")
        tiles.append(Tile("Speed limits", said, bad=True))
    words.append(f"{'Joint limits' if hasty else 'Limits'} {' → '.join(dict.fromkeys(limits))}.")
    tiles.append(Tile("Joint limits", " → ".join(dict.fromkeys(limits)), any(d.broken for d in deeds)))
    if all(deed.apart is not None for deed in deeds):
        apart = [f"touch in cycle {deed.touch}" if deed.touch else metres(deed.apart or 0.0) for deed in deeds]
        said = " → ".join(dict.fromkeys(apart))
        words.append(f"Bodies {said}{'' if deeds[-1].touch else ' apart'}.")
        tiles.append(Tile("Bodies apart, at least", said, any(deed.touch for deed in deeds)))
    return Verdict(" ".join(words), tuple(tiles))


def _creep(deed: Deed, joint: str) -> str:
    """How far the elbow is off at the end, and, where they are asked for, the words on the joint that turned most."""
    name, turn = deed.turn[1], radians(deed.turn[0])
    return metres(deed.creep) + (joint.format(name, turn) if turn != "0" else "")


def study_verdict(study: Study) -> Verdict:
    """Sum up a study: J⁺, and what the nearest repeatable inverse makes of it."""
    rows = [study.row("pseudoinverse"), study.row("repeatable")]
    stuck = [f"{row.label} is stuck: {row.stopped}." for row in rows if row.motion is None]
    moved = [(row.label, row.motion) for row in rows if row.motion is not None]
    if not moved:
        return Verdict(" ".join(stuck), NO_VERDICT.tiles)
    told = verdict([deed_of(label, motion, study.elbow) for label, motion in moved], moved[0][1].cycles)
    return Verdict(" ".join([*stuck, told.sentence]), told.tiles)
