"""The files of a study: animation, figures, and the motions as a CSV file.

J⁺ is the pseudoinverse, the usual controller.
"""

from __future__ import annotations

import hashlib
import shlex
from pathlib import Path
from weakref import WeakKeyDictionary

from markupsafe import escape

from ..base.errors import InputError
from ..base.files import prepare_folder, write_whole
from ..motion.csv_file import csv_text
from ..motion.csv_file import with_run as with_run_column
from ..paths.several_paths import paths_of
from ..studies.study_result import Study
from .page.own_loop import study_loop
from .page.playback import playback_of, playback_page, traced_chains
from .palette import colours
from .plots.drift import drift_figure
from .plots.figure_layout import png
from .plots.joints import joints_figure
from .plots.motions import drawn
from .text.headline import stopped_words

_CSV_ROWS_PER_CYCLE = 100
"""Maximum number of rows per cycle in ``motion.csv``."""

_texts: WeakKeyDictionary[Study, str] = WeakKeyDictionary()
"""Cache of the text of each study's ``motion.csv``, without the column ``run``."""


def write_study(study: Study, folder: Path, *, run: str = "", command: str = "") -> list[Path]:
    """Write the page, the figures and the motions of a study to a folder.

    The files are ``animation.html``, ``drift.png``, ``joints.png`` and ``motion.csv``. Each is
    written whole or not at all.

    Parameters
    ----------
    study
        The study.
    folder
        Output folder.
    run
        Name of the run, to write into each file.
    command
        Command line that made the study, which the page's dialog repeats.

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
    metadata = {"Run": run} if run else None
    contents: dict[str, str | bytes] = {
        "animation.html": with_run(with_command(study_page(study), command), run),
        "drift.png": png(drift_figure(moved, title), metadata=metadata),
        "joints.png": png(joints_figure(moved, title), metadata=metadata),
        "motion.csv": with_run_column(_motions(study), run) if run else _motions(study),
    }
    prepare_folder(folder)
    return [write_whole(folder / name, content) for name, content in contents.items()]


def run_name(study: Study, checksum: str) -> str:
    """Name a run of a study by the checksum of its design file and a digest of its motions.

    The name is written into each file, so that the user sees which files belong together. Runs with
    the same name have the same design and motions. ``checksum`` is that of the design file,
    ``control.json``; the name begins with its first 12 digits.
    """
    digest = hashlib.sha256(_motions(study).encode()).hexdigest()
    return f"{checksum.removeprefix('sha256:')[:12]}-{digest[:8]}"


def with_run(page: str, run: str) -> str:
    """Insert the name of a run into the head of an HTML page; an empty name changes nothing."""
    return (
        page.replace("<head>", f'<head>\n<meta name="repctl-run" content="{run}">', 1)
        if run
        else page
    )


def with_command(page: str, command: str) -> str:
    """Insert the command that made a page into its dialog; an empty command changes nothing."""
    install = "<dt>To install</dt>"
    words = escape(_portable(command))
    made = f"<dt>This page</dt><dd>was made by <code>{words}</code></dd>\n    "
    return page.replace(install, made + install, 1) if command else page


def _portable(command: str) -> str:
    """Remove the option ``--out`` from a command, and the folders from its absolute paths.

    Both only show in which folder the command ran. Relative paths are unchanged.
    """
    kept: list[str] = []
    words = iter(shlex.split(command))
    for word in words:
        if word == "--out":
            next(words, "")
            continue
        if not word.startswith("--out="):
            option, sign, value = word.rpartition("=")
            kept.append(f"{option}{sign}{Path(value).name if Path(value).is_absolute() else value}")
    return shlex.join(kept)


def _motions(study: Study) -> str:
    """Format the motions of a study as the text of a CSV file, at most 100 rows per cycle.

    The text is cached, because the name of the run is a digest of it.
    """
    if study not in _texts:
        kept = [(row.key, row.motion) for row in study.rows if row.motion is not None]
        _texts[study] = csv_text(kept, most=_CSV_ROWS_PER_CYCLE)
    return _texts[study]


def study_page(study: Study, *, seconds: float | None = None) -> str:
    """Make the HTML of a study's page: J⁺, custom controllers and the repeatable inverse.

    Controllers with a posture task are not shown. ``seconds`` is the duration of a cycle at normal
    speed, s, by default the period of the motions.

    Raises
    ------
    InputError
        If all of these controllers stopped, so that there is no motion to show.
    """
    rows = [row for row in study.rows if row.key not in ("posture", "posture_off")]
    colour = colours(study)
    tracks = [
        playback_of(row.label, row.motion, colour[row.key])
        for row in rows
        if row.motion is not None
    ]
    stopped = [stopped_words(row.label, row.failure) for row in rows if row.motion is None]
    if not tracks:
        raise InputError(
            f"there is no motion to show: {' '.join(stopped)}".removesuffix("."),
            remedy="choose a smaller path, another start, or fewer cycles",
        )
    return playback_page(
        traced_chains(study.task, study.q0),
        tracks,
        paths=[path.points() for path in paths_of(study.path)],
        name=study.path.name,
        stopped=stopped,
        seconds=seconds,
        own=study_loop(study),
    )
