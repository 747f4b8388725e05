"""Summaries of motions, for the headline of a page or of a terminal answer.

They name the part of the arm that is displaced most at the end, and how far.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...arguments import Array
from ...motion.displacement import displacements, leaves_range
from ...motion.joint_motion import JointMotion
from ...robot.mechanism import Mechanism
from ...robot.task import Task
from ...robot.visuals import Visuals
from ...studies import Row, Study
from ..text.headline import Headline, headline_of, stopped_words
from ..text.parts import part_name
from ..text.verdict import MotionSummary, motion_summary
from .body_points import corners, farthest


def for_headline(
    summary: MotionSummary,
    task: Task,
    q0: Array,
    moved: tuple[str, float],
    played: Sequence[JointMotion],
) -> MotionSummary:
    """Add to the summary of a motion what only the headline reports.

    Parameters
    ----------
    summary
        Summary of the motion.
    task
        Task of the arm whose parts are named.
    q0 : (n,) array
        Start configuration.
    moved : (str, float)
        The link that is displaced most at the end, and how far, m.
    played
        The motion of each chain of the robot.
    """
    found = [leaves for leaves in map(leaves_range, played) if leaves is not None]
    near = (
        ()
        if summary.body_distance is None
        else played[0].coarse.nearest_bodies[1].links
    )
    link, off = moved
    return replace(
        summary,
        part=part_name(task, q0, link),
        link=link,
        off=off,
        leaves=min(found, default=None),
        near=near,
    )


def farthest_body(robot: Mechanism, ends: Array) -> tuple[str, float]:
    """Find the link whose body is displaced most after a motion, and how far, m.

    Parameters
    ----------
    robot
        The robot.
    ends : (2, nq) array
        Configurations at the start and at the end of the motion.
    """
    visuals = Visuals.of(robot)
    placements = visuals.placements(ends)
    off, _ = displacements(placements[:1], placements[1:], corners(visuals.shapes))
    return farthest(visuals.shapes, off[0])


def row_summary(study: Study, row: Row) -> MotionSummary | None:
    """Summarise one row of a study for the headline; None if its motion stopped."""
    motion = row.motion
    if motion is None:
        return None
    task, ends = motion.task, motion.q[[0, -1]]
    summary = motion_summary(row.label, motion, study.elbow)
    moved = farthest_body(task.robot, task.to_robot(ends))
    return for_headline(summary, task, ends[0], moved, [motion])


def study_headline(study: Study) -> Headline:
    """Write the headline of a study, which compares J⁺ with the nearest repeatable inverse."""
    rows = [study.row("pseudoinverse"), study.row("repeatable")]
    stopped = [
        stopped_words(row.label, row.stopped) for row in rows if row.motion is None
    ]
    found = [one for row in rows if (one := row_summary(study, row)) is not None]
    cycles = next((row.motion.cycles for row in rows if row.motion is not None), 0)
    return headline_of(found, cycles, stopped)
