"""Sentences of the report: its glossary, and a description of each figure.

The descriptions are alternative texts, for readers who cannot see the figures. J⁺ is the
pseudoinverse, the usual controller.

``ReportMaps`` are the maps and curves of a design for a report: its grid over two joints, costs by
degree, baselines.
"""

from __future__ import annotations

import numpy as np

from ...design.design_map import ReportMaps
from ...motion import Motion
from ...motion.body_displacement import cycle_displacements
from ...studies.study_result import Study
from .headline import names_of
from .numbers import displacement, number

GLOSSARY = {
    "redundant": "The arm has more joints than its task has coordinates: many joint motions move "
    "the frame in the same way.",
    "usual control, J⁺": "The pseudoinverse of the Jacobian J: of all joint velocities that give "
    "the frame its velocity, the one with the smallest norm. The design approximates J⁺.",
    "repeatable": "A closed path of the frame ends in the configuration it began in, if it can be "
    "shrunk to a point through closed paths whose motions all stay in Ω.",
    "drift": "Distance of the joints from the start after a cycle: a norm over all joints, so it "
    "may exceed the displacement of each of them.",
    "Usual + posture": "J⁺ with null-space attraction to a given configuration: the start, or "
    "a different one (other posture), to which the arm moves first.",
    "potentials": "Functions of the joints that the repeatable controller holds constant. A higher "
    "degree allows a smaller distance from J⁺.",
    "Ω": "The region of joint space for which the repeatable controller was designed; outside, "
    "repeatability is not guaranteed.",
    "cost": "The mean over Ω of ‖G − J⁺‖², where G is the repeatable inverse.",
    "leaf margin": "Distance from an algorithmic singularity, at which the potentials no longer "
    "determine the joints: 1 is best, 0 is singular.",
    "defect": "Violation of the condition for repeatability at a configuration, per rad: 0 where "
    "it holds.",
    "constant rows, extended Jacobian": "Two simpler repeatable controllers, for comparison: one "
    "holds fixed combinations of the joints constant, the other holds the distance from the centre "
    "of Ω stationary along self-motions.",
}
"""Definitions of the terms of a report."""


def _amount(motion: Motion, cycle: int) -> str:
    """Format the joint drift after a cycle with its unit, such as ``0.21 rad``; 0 if it is closed.

    ``cycle`` counts from 0, and −1 is the last.
    """
    if motion.closes:
        return "0"
    return f"{number(float(motion.drift[cycle]))} {motion.task.unit}"


def drift_words(study: Study) -> str:
    """Write the alternative text of the figure of the drift, for readers who cannot see it.

    The figure shows, for each controller, how far the most displaced part of the arm is from its
    start.
    """
    parts = []
    for label, motion in _moved(study):
        first, last = (displacement(off) for off in cycle_displacements(motion)[[0, -1]])
        parts.append(f"{label} {first} after the first cycle, {last} after the last")
    return (
        "How far the most displaced part of the arm is from its start after each cycle: "
        f"{'; '.join(parts)}. "
        f"Inset: the joint drift, {study.task.unit}, on a log scale."
    )


def joints_words(study: Study) -> str:
    """Describe the figure of the joints: how far each has drifted under the first controller.

    Returns the alternative text of the figure, for readers who cannot see it.
    """
    label, motion = _moved(study)[0]
    off = motion.q[-1] - motion.q[0]
    parts = [
        f"{name} {value:+.3g}" if abs(value) > 1e-12 else f"{name} 0"
        for name, value in zip(study.task.joint_names, off, strict=True)
    ]
    drift = ", ".join(parts)
    shown = "The joints that drift most, over all cycles."
    return f"{shown} Under {label[:1].lower()}{label[1:]} the joints have drifted by: {drift}."


def orbits_words(study: Study) -> str:
    """Describe the figure of orbits, the motions in joint space: which are closed, and which drift.

    Returns the alternative text of the figure, for readers who cannot see it.
    """
    said = [
        f"{label}: one closed loop"
        if motion.closes
        else f"{label}: ends {_amount(motion, -1)} from its start"
        for label, motion in _moved(study, without="posture_off")
    ]
    views = "The three joints that drift most, plotted against each other in three views."
    return f"{views} {'; '.join(said)}."


def cycles_words(study: Study) -> str:
    """Describe the figure of speeds and margins: peak speed, limit margin, and body distance.

    Returns the alternative text of the figure, for readers who cannot see it.
    """
    parts = []
    for label, motion in _moved(study):
        margin = float(motion.limit_margin.min())
        limits = f"minimum limit margin {margin:.3g}" if margin < 1e6 else "no limits"
        distance = motion.clearance.distance
        bodies = f", minimum body distance {distance:.3g} m" if np.isfinite(distance) else ""
        parts.append(f"{label}: peak speed {motion.peak_speed:.3g} per s, {limits}{bodies}")
    return (
        "Joint speed over the cycle; minimum joint-limit margin in each cycle; minimum body "
        f"distance in each cycle, if the model has collision geometry. {'; '.join(parts)}."
    )


def maps_words(study: Study, maps: ReportMaps) -> str:
    """Describe the maps of a design over two joints by their ranges of values.

    Returns the alternative text of the maps, for readers who cannot see them. The maps show the
    defect of J⁺ (0 where it is repeatable), the distance of the design from J⁺, and the leaf margin
    of the design (0 if singular).
    """
    i, j = maps.grid.joints
    with np.errstate(invalid="ignore"):
        distance = maps.grid.distance / maps.grid.reference
    ranges = [
        f"{name} from {np.nanmin(values):.3g} to {np.nanmax(values):.3g}"
        for name, values in (
            ("the defect of J⁺ (0 where it is repeatable)", maps.defect),
            ("the distance ‖G − J⁺‖ / ‖J⁺‖", distance),
            ("the leaf margin", maps.grid.leaf_margin),
        )
    ]
    costs = [f"{cost:.4g} at degree {degree}" for degree, cost, _ in maps.degrees]
    last = (
        f" Cost on held-out nodes by degree of the potentials: {', '.join(costs)}."
        if len(costs) > 1
        else ""
    )
    names = study.task.joint_names
    return (
        "Maps that vary by 5 % or more; bright is good and dark is bad. "
        f"Over {names[i]} and {names[j]}, the other joints at the centre of Ω (the cross): "
        f"{'; '.join(ranges)}.{last}"
    )


def still_words(study: Study) -> str:
    """Describe the animation's still picture: displacement by J⁺ and by the repeatable inverse.

    Returns the alternative text of the picture, for readers who cannot see it.
    """
    rows = (study.row("pseudoinverse"), study.row("repeatable"))
    ends = [
        row.failure
        if row.motion is None
        else f"{displacement(cycle_displacements(row.motion)[-1])} from its start"
        for row in rows
    ]
    names = [names_of(row.label)["title"] for row in rows]
    parts = [f"{name} {end}" for name, end in zip(names, ends, strict=True)]
    return f"The arm at the start, in grey, and at the end. Its farthest part: {'; '.join(parts)}."


def _moved(study: Study, without: str = "") -> list[tuple[str, Motion]]:
    """List the title and the motion of every controller that has one, except ``without``.

    ``without`` is the key of a controller that a figure leaves out, or empty.
    """
    return [
        (names_of(row.label)["title"], row.motion)
        for row in study.rows
        if row.motion is not None and row.key != without
    ]
