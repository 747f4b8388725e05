"""Summaries of motions, for the headline of a page or of a terminal answer.

They name the part of the arm that is displaced most at the end, and how far.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...motion.displacement import farthest_link, leaves_range
from ...motion.joint_motion import JointMotion
from ...studies.study_result import Row, Study
from ..text.headline import Headline, headline_of, stopped_words
from ..text.verdict import MotionSummary, motion_summary, verdict


def for_headline(
    summary: MotionSummary, played: Sequence[JointMotion]
) -> MotionSummary:
    """Add to the summary of a motion what only the headline reports.

    Parameters
    ----------
    summary
        Summary of the motion.
    played
        The motion of each chain of the robot.
    """
    found = [leaves for leaves in map(leaves_range, played) if leaves is not None]
    near = (
        ()
        if summary.body_distance is None
        else played[0].coarse.nearest_bodies[1].links
    )
    return replace(summary, leaves=min(found, default=None), near=near)


def row_summary(study: Study, row: Row) -> MotionSummary | None:
    """Summarise one row of a study; None if its motion stopped."""
    motion = row.motion
    if motion is None:
        return None
    moved = farthest_link(motion.task, motion.q[[0, -1]])
    summary = motion_summary(row.label, motion, moved)
    return for_headline(summary, [motion])


def study_headline(study: Study) -> Headline:
    """Write the headline of a study, which compares J⁺ with the nearest repeatable inverse."""
    rows = [study.row("pseudoinverse"), study.row("repeatable")]
    stopped = [
        stopped_words(row.label, row.failure) for row in rows if row.motion is None
    ]
    found = [one for row in rows if (one := row_summary(study, row)) is not None]
    cycles = next((row.motion.cycles for row in rows if row.motion is not None), 0)
    return headline_of(found, cycles, stopped, hands=len(study.task.frames))


def study_verdict(study: Study) -> str:
    """Write the verdict that compares J⁺ and the nearest repeatable inverse of a study."""
    rows = [study.row("pseudoinverse"), study.row("repeatable")]
    stopped = [f"{row.label} {row.failure}." for row in rows if row.motion is None]
    found = [one for row in rows if (one := row_summary(study, row)) is not None]
    cycles = next((row.motion.cycles for row in rows if row.motion is not None), 0)
    return " ".join([*stopped, *([verdict(found, cycles)] if found else [])])
