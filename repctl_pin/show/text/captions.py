"""Sentences of the report: its summary, its glossary, and a description of each figure for readers
who cannot see it."""

from __future__ import annotations

import numpy as np

from ...motion import Motion
from ...studies import Row, Study
from ...studies.study_maps import StudyMaps
from ..palette import COLOURS
from .numbers import number

GLOSSARY = {
    "redundant": "The arm has more joints than its task has coordinates: many joint motions move the frame in the "
    "same way.",
    "J⁺": "The pseudoinverse of the Jacobian J: of all joint velocities that move the frame as asked, the one with the "
    "least norm. The usual control, and the desired one here.",
    "repeatable": "Every closed path of the frame ends in the configuration it began in.",
    "drift": "How far the joints are off the start after a cycle: the norm over all joints, so it may exceed what any "
    "one of them has moved.",
    "J⁺ + posture": "J⁺, plus a pull in its null space towards given joints: those of the start, or others (other "
    "posture), to which it moves first.",
    "potentials": "Functions of the joints that the repeatable control holds constant. A higher degree leaves more to "
    "choose from, and comes nearer to J⁺.",
    "Ω": "The region of joint space for which the repeatable control was designed; outside, repeatability is not "
    "guaranteed.",
    "cost": "The mean over Ω of ‖G − J⁺‖², by which the repeatable control G differs from J⁺.",
    "leaf margin": "How far the potentials are from failing to fix the joints: 1 is best, 0 is singular.",
    "defect": "By how much a control fails the test of repeatability at a configuration, per rad: 0 where it passes.",
    "constant rows, extended Jacobian": "Two simpler repeatable controls, for comparison: fixed combinations of the "
    "joints held constant, and a pull towards the centre of Ω held at zero along the free directions.",
}
"""What the words of a report mean."""


def summary(study: Study) -> list[str]:
    """Summarise a study in a few sentences, one per paragraph."""
    task, path = study.task, study.path
    plain, closed = study.row("pseudoinverse"), study.row("repeatable")
    some = next(row.motion for row in study.rows if row.motion is not None)
    out = [
        f"The frame {task.frame} of {study.robot.name} followed a closed path, {path.name}, {some.cycles} "
        f"{_times(some.cycles)}. The task ({task.kind}) has {task.m} dimensions and the arm {task.n} joints, which "
        f"leaves {task.r} free: many joint motions move the frame in the same way."
    ]
    if plain.motion is not None:
        out.append(
            f"Under the pseudoinverse J⁺ the frame comes back after every cycle, but the joints do not: they are off "
            f"by {amount(plain.motion, 0)} after one cycle and by {amount(plain.motion, -1)} after "
            f"{plain.motion.cycles} (the norm over all joints)."
        )
    else:
        out.append(f"The pseudoinverse J⁺ could not follow: {plain.stopped}.")
    for row in study.rows:
        if row.key not in COLOURS:
            own = (
                f"they are off by {amount(row.motion, -1)}"
                if row.motion
                else f"it could not follow: {row.stopped}"
            )
            out.append(f"Under your control {row.label}, {own}.")
    if closed.motion is not None:
        assert closed.distance is not None and closed.leaf_margin is not None
        out.append(
            f"Under the nearest repeatable inverse they are off by {amount(closed.motion, -1)} after "
            f"{closed.motion.cycles} {_times(closed.motion.cycles, 'cycle')}. It differs from J⁺ by "
            f"{closed.distance:.1%} in the mean over Ω, {_price(plain, closed)}, and its leaf margin from "
            f"singularities of its own is at worst {closed.leaf_margin:.2f} (1 is best, 0 is singular)."
        )
    else:
        out.append(f"The nearest repeatable inverse could not follow: {closed.stopped}.")
    broken = [f"{row.label}: {violation}" for row in study.rows for violation in row.violations]
    known = any(row.body_distance is not None for row in study.rows)
    kept = "No joint leaves its limits" + (", and no two bodies touch." if known else ".")
    out.append(f"{'; '.join(broken)}." if broken else kept)
    near = [
        f"{row.label} {row.body_distance:.3f} m ({' and '.join(row.motion.coarse.nearest_bodies[1].links)})"
        for row in study.rows
        if row.motion is not None and row.body_distance is not None
    ]
    if near:
        out.append(
            f"The least distance between bodies, at 100 points per cycle: {'; '.join(near)}."
        )
    times = [
        f"{row.label} {row.cycle_time:.3f} s{'' if row.motion.closes else ' (does not close)'}"
        for row in study.rows
        if row.motion is not None and row.cycle_time is not None
    ]
    if times:
        out.append(
            f"The first cycle from rest to rest, as fast as the speed limits and these accelerations allow "
            f"({study.setting['accelerations']}): {'; '.join(times)}."
        )
    return out


def amount(motion: Motion, cycle: int) -> str:
    """Write the drift after a cycle with its unit."""
    return f"{number(float(motion.drift[cycle]))} {motion.task.unit}"


def drift_words(study: Study) -> str:
    """Describe the figure of the drift."""
    parts = [
        f"{label} from {number(motion.drift[0])} after the first cycle to {number(motion.drift[-1])} after the last"
        for label, motion in _moved(study)
    ]
    return f"Joint drift after each cycle: {'; '.join(parts)}; in {study.task.unit}."


def joints_words(study: Study) -> str:
    """Describe the figure of the joints."""
    label, motion = _moved(study)[0]
    off = motion.q[-1] - motion.q[0]
    parts = [
        f"{name} {value:+.3g}" if abs(value) > 1e-12 else f"{name} 0"
        for name, value in zip(study.task.joint_names, off, strict=True)
    ]
    return f"Each joint over all cycles. At the end of {label} the joints are off by: {', '.join(parts)}."


def orbits_words(study: Study) -> str:
    """Describe the figure of the orbits."""
    said = [
        f"{label}: one closed loop"
        if motion.closes
        else f"{label}: ends {amount(motion, -1)} off its start"
        for label, motion in _moved(study, without="posture_off")
    ]
    return f"The three joints that drift most, plotted against each other in three views. {'; '.join(said)}."


def cycles_words(study: Study) -> str:
    """Describe the figure of speeds and margins."""
    parts = []
    for label, motion in _moved(study):
        margin = float(motion.limit_margin.min())
        room = f"limit margin at least {margin:.3g}" if margin < 1e6 else "no limits"
        apart = float(motion.coarse.body_distance.min())
        bodies = f", bodies at least {apart:.3g} m apart" if np.isfinite(apart) else ""
        parts.append(
            f"{label}: speed up to {motion.peak_speed:.3g} per s in all cycles, {room}{bodies}"
        )
    return (
        "Joint speed over the cycle, and the least distance to a joint limit, and between bodies where there are any, "
        f"in each. {'; '.join(parts)}."
    )


def maps_words(study: Study, maps: StudyMaps) -> str:
    """Describe the maps over two joints."""
    i, j = maps.design.joints
    with np.errstate(invalid="ignore"):
        distance = maps.design.distance / maps.design.reference
    ranges = [
        f"{name} from {np.nanmin(values):.3g} to {np.nanmax(values):.3g}"
        for name, values in (
            ("the defect of J⁺ (0 where it is repeatable)", maps.defect),
            ("the distance ‖G − J⁺‖ / ‖J⁺‖", distance),
            ("the leaf margin", maps.design.leaf_margin),
        )
    ]
    costs = [f"{cost:.4g} at degree {degree}" for degree, cost, _ in maps.degrees]
    last = (
        f" Mean cost over Ω by degree of the potentials: {', '.join(costs)}."
        if len(costs) > 1
        else ""
    )
    names = study.task.joint_names
    return f"Over {names[i]} and {names[j]}, the other joints at the centre of Ω (the cross): {'; '.join(ranges)}.{last}"


def still_words(study: Study) -> str:
    """Describe the still picture of the animation."""
    rows = (study.row("pseudoinverse"), study.row("repeatable"))
    ends = [
        "did not finish" if r.motion is None else f"is off the start by {amount(r.motion, -1)}"
        for r in rows
    ]
    parts = [f"{row.label} {end}" for row, end in zip(rows, ends, strict=True)]
    return f"The arm at the start, in grey, and at the end: {'; '.join(parts)}."


def _price(plain: Row, closed: Row) -> str:
    if plain.motion is None or closed.motion is None:
        return "the cost in joint speed is not known"
    price = closed.motion.first_rms_speed / plain.motion.first_rms_speed - 1
    overall = closed.motion.rms_speed / plain.motion.rms_speed - 1
    worth = f"costs {price:+.1%} of" if abs(price) >= 5e-4 else "costs no"
    more = f" and {overall:+.1%} over all cycles" if plain.motion.cycles > 1 else ""
    return f"{worth} joint speed (rms) over the first cycle{more}"


def _moved(study: Study, without: str = "") -> list[tuple[str, Motion]]:
    return [
        (row.label, row.motion)
        for row in study.rows
        if row.motion is not None and row.key != without
    ]


def _times(count: int, word: str = "time") -> str:
    return word if count == 1 else f"{word}s"
