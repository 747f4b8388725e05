"""The files of a study: animation, figures, and the motions as numbers."""

from __future__ import annotations

from pathlib import Path

from ..files import prepare_folder, write_whole
from ..motion.csv_file import csv_text
from ..studies import Study
from .page.playback import Limb, track_of, tracks_page
from .palette import colours
from .plots.motions import drawn, drift_figure, joints_figure, png
from .text.verdict import study_verdict

CSV_ROWS_PER_CYCLE = 100
"""At most so many rows of a cycle go into ``motion.csv``."""


def write_study(study: Study, folder: Path) -> list[Path]:
    """Write ``animation.html``, ``drift.png``, ``joints.png`` and ``motion.csv``, each whole or not at all.

    Returns
    -------
    The files, in this order.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    title = f"{study.robot.name}, {study.task.kind} task, {study.path.name}"
    moved = drawn(study)
    kept = [(row.key, row.motion) for row in study.rows if row.motion is not None]
    contents: dict[str, str | bytes] = {
        "animation.html": study_page(study),
        "drift.png": png(drift_figure(moved, title)),
        "joints.png": png(joints_figure(moved, title)),
        "motion.csv": csv_text(kept, most=CSV_ROWS_PER_CYCLE),
    }
    prepare_folder(folder)
    return [write_whole(folder / name, content) for name, content in contents.items()]


def study_page(study: Study) -> str:
    """Make the animation of a study: J⁺, user-defined controls and the repeatable inverse, side by side."""
    rows = [row for row in study.rows if row.key not in ("posture", "posture_off")]
    colour = colours(study)
    tracks = [track_of(row.label, row.motion, colour[row.key]) for row in rows if row.motion is not None]
    limb = Limb(study.task, study.elbow)
    return tracks_page([limb], tracks, paths=[study.path.points()], name=study.path.name, summary=study_verdict(study))
