"""First answer of a study: a sentence and a short table, for a terminal of 24 rows.

A span is a piece of text with a tone (``bad``, ``good``, ``near``), which a terminal shows as
colour. A row is the result of one strategy, such as J⁺, in the study; a summary holds the numbers
of its motion. The rows of the short table are called lines here. The displacement of a part is the
distance between its positions at the start and after all cycles.

``Row`` is the result of one strategy in a study: its motion and figures, or why it stopped.
``Span`` is a piece of text with its tone, which is shown as colour. ``MotionSummary`` is the
quantities of one motion that headlines and short tables report.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import replace

from ...model.bodies import bodies_of
from ...model.several_frames import SeveralFrames
from ...motion import Motion
from ...studies.study_notes import violation_texts
from ...studies.study_result import Row, Study
from .coloured_text import COLUMNS, Span, fitted, noted, wrapped
from .headline import end_name, ends_off, off_of, stopped_cell, study_headline
from .motion_summary import MotionSummary, row_summary
from .numbers import counted, displacement, metres, number, percent
from .table import NARROW, outside_words, table_spans

ROWS = 24
"""Number of rows of the terminal into which the answer fits."""

_NOT_SHOWN = "posture_off"
"""Strategy that only the full table shows."""

_TITLES = {"pseudoinverse": "usual control", "posture": "+ posture", "repeatable": "repeatable"}
_FIRST = (
    "report.html is ",
    "on a circle of the same size ",
    "collisions of ",
    "the model has no collision geometry",
    "no speed limit in the model",
)
"""Beginnings of the notes on an old report, on a circle on which J⁺ drifts more, and on bodies and
joint speeds that are not checked, which come first."""

_LAST = ("the start is ", "joint speed: ", "another elbow position ")
"""Beginnings of the notes that follow the explanations of terms, and are left out first."""


def study_answer(study: Study, files: Sequence[str] = ()) -> list[Span]:
    """Make a study's first answer: a sentence, a short table, notes, and the file to open.

    As many notes are listed as fit into the terminal.

    Parameters
    ----------
    study
        The study.
    files
        Lines of text on the files that were written, which follow the notes.

    Returns
    -------
    list of Span
        Pieces of text; a terminal shows their tone as colour.
    """
    rows = [row for row in study.rows if row.key != _NOT_SHOWN]
    warnings = outside_words(max(row.outside for row in rows))
    out = [Span(f"{line}\n", "bad") for line in fitted("\n".join(warnings)).splitlines()]
    out += [*wrapped(study_headline(study).sentence), Span(f"\n\n{fitted(_about(study))}\n\n")]
    out += _short_table(study, rows)
    notes = [f"! {_title(row)}: {said}" for row in rows for said in violation_texts(row)]
    others = [noted(note) for note in _notes(study, rows)]
    warned = [note for note in others if note.startswith("! ")]
    notes += [*warned, *_proved(study), *(note for note in others if note not in warned)]
    below = ["", *files, "--full prints all strategies, the settings and a legend"]
    above = "".join(span.text for span in out).count("\n")
    left = ROWS - 2 - above - _height_of(below)  # without command and next prompt
    if _height_of(notes) > left:
        below, left = below[1:], left + 1  # rather than the empty line
    if left < 1 and notes:
        below = [*files]  # the line on the notes that are left out names --full, too
    return [*out, Span(fitted("\n".join([*_as_many(notes, left), *below])))]


def _proved(study: Study) -> list[str]:
    """Make the line on the proved closing radius of the design: a list of one text.

    Every closed path within that radius of the start, or of the path that was followed, is proved
    to close in joint space. The list is empty if nothing was proved.
    """
    closes = study.design.proof and study.design.proof.closes
    return [f"{closes.words}: proved"] if closes else []


def _title(row: Row) -> str:
    """Return the heading of a strategy's column in the short table: ``usual control`` for J⁺."""
    return _TITLES.get(row.key, row.label)


def _about(study: Study) -> str:
    """Make one line that names the arm, its task, its path and the number of cycles."""
    moved = (row.motion for row in study.rows if row.motion is not None)
    cycles = next((motion.cycles for motion in moved), 0)
    times = counted(cycles, "cycle")
    kind = f"{study.task.kind}, r = {study.task.r}"
    if isinstance(study.task, SeveralFrames):
        return f"{study.robot.name}, {kind}, {times}: {study.path.name}"
    return f"{study.robot.name} {study.task.frame_words}, {kind}: {study.path.name}, {times}"


def _short_table(study: Study, rows: Sequence[Row]) -> list[Span]:
    """Format the short table, with one column per strategy, as spans to print one after the other.

    A line below the table gives the number of bodies that are not checked for collisions, if any.
    """
    header = ["", *("\n".join(textwrap.wrap(_title(row), NARROW + 4)) for row in rows)]
    cells = [[Span(name), *line] for name, line in _cells(study, rows)]
    out = [*table_spans(header, cells), Span("\n")]
    if unchecked := bodies_of(study.task).not_checked:
        out.append(Span(f"not checked: {unchecked}\n", "near"))
    return out


def displacement_cells(study: Study) -> list[tuple[str, list[str]]]:
    """Format the first two lines of the short table, each a name and a text per controller.

    The first line has the maximum distance of the hand, the task's frame, from its path. The second
    has the displacement of the part of the arm that is displaced most.
    """
    rows = _cells(study, study.rows)[:2]
    return [(name, [cell.text for cell in line]) for name, line in rows]


def _cells(study: Study, rows: Sequence[Row]) -> list[tuple[str, list[Span]]]:
    """List the lines of the short table: name of a quantity, and its value for every controller.

    ``rows`` has one result per controller. A controller without a motion has the word ``stopped``,
    or a dash, in each line. The line of the body distance is left out if there are bodies, but none
    of them has a collision shape.
    """
    summaries = [row_summary(row) for row in rows]
    some = next((row.motion for row in rows if row.motion is not None), None)
    unit = "" if some is None else f", {some.task.unit}"
    names = [
        "hand off its path, at most",
        f"{_part(summaries)} off its start",
        f"joints off their start{unit}",
        "first cycle closes",
        "extra joint speed, cycle 1",
        "limits",
    ]
    known = [one for one in summaries if one is not None]
    ends = ends_off(known)
    if ends:
        names.insert(2, f"{end_name(ends[0])} off its start")
    checked = any(one.body_distance is not None for one in known)
    if checked or not bodies_of(study.task).unchecked:
        names.append("closest links")
    columns = [
        [Span(stopped_cell(row), "bad")] * len(names)
        if row.motion is None or one is None
        else _column(row.motion, one, summaries[0], ends[:1])[: len(names)]
        for row, one in zip(rows, summaries, strict=True)
    ]
    return [
        (name, list(line)) for name, line in zip(names, zip(*columns, strict=True), strict=True)
    ]


def _column(
    motion: Motion, summary: MotionSummary, usual: MotionSummary | None, ends: Sequence[str]
) -> list[Span]:
    """Format the values of one controller, in the order of the lines of the short table.

    ``usual`` is the summary of J⁺, with which the joint speed is compared; None if J⁺ stopped.
    ``ends`` lists links of further end effectors whose displacement has a line: none or one.
    """
    off = float(motion.tracking_error.max())
    drift = number(float(motion.drift[-1]))
    return [
        Span(displacement(off), "bad" if summary.path_loss else ""),
        off_of(summary),
        *(off_of(replace(summary, off=summary.ends[end], link=end)) for end in ends),
        Span("0", "good") if motion.closes else Span(drift, "bad"),
        Span("yes", "good") if motion.first_closes else Span("no", "bad"),
        _speed(summary, usual),
        _limits(summary),
        _links(summary),
    ]


def _part(summaries: Sequence[MotionSummary | None]) -> str:
    """Name the most displaced part; "farthest part" if it differs between the controllers.

    Motions that end with all parts where they began are ignored, as are controllers that stopped,
    whose summary is None. The name is "farthest part", too, if nothing is left.
    """
    names = {one.part for one in summaries if one is not None and not one.back}
    return names.pop() if len(names) == 1 else "farthest part"


def _speed(summary: MotionSummary, usual: MotionSummary | None) -> Span:
    """Format the extra joint speed relative to J⁺, such as ``+3 %``; a dash if it is meaningless.

    It is meaningless for J⁺ itself, whose summary is ``usual``; if J⁺ stopped (``usual`` is None);
    and if either motion leaves its path.
    """
    if usual is None or summary is usual or not usual.speed > 0:
        return Span("–")
    if usual.path_loss or summary.path_loss:
        return Span("–")
    return Span(percent(summary.speed / usual.speed - 1))


def _limits(summary: MotionSummary) -> Span:
    """Format the cycle of the first joint-limit violation, else the worst speed-limit violation.

    The latter is the largest ratio of a joint speed to its limit, such as ``speed × 1.3!``. The
    text is ``kept`` if no limit is violated.
    """
    if summary.limit_violation:
        return Span(f"cycle {summary.limit_violation[0]}!", "bad")
    if summary.overspeed:
        return Span(f"speed × {summary.overspeed[2]:.2g}!", "bad")
    return Span("kept")


def _links(summary: MotionSummary) -> Span:
    """Format the minimum body distance; ``not checked`` without bodies, ``collide!`` below 0."""
    if summary.body_distance is None:
        return Span("not checked", "near")
    if summary.collision:
        return Span("collide!", "bad")
    return Span(metres(summary.body_distance))


def _notes(study: Study, rows: Sequence[Row]) -> list[str]:
    """List the notes of a study, except those on violations, which have lines of their own.

    First come the reasons why controllers stopped, except J⁺ and the repeatable one, which the
    headline names; then the other notes, in the order of their ranks, see :func:`_rank`.
    """
    said = {f"{row.label}: {violation}" for row in rows for violation in violation_texts(row)}
    notes = [note for note in study.notes if note not in said]
    stopped = [
        f"{_title(row)}: {row.stopped}"
        for row in rows
        if row.motion is None and row.key not in ("pseudoinverse", "repeatable")
    ]
    return [*stopped, *sorted([*notes, *_meanings(study)], key=_rank)]


def _rank(note: str) -> int:
    """Rank a note by its first words: 0 if it is listed first, 2 if last, 1 otherwise.

    The words of ranks 0 and 2 are those in ``_FIRST`` and ``_LAST``.
    """
    return 0 if note.startswith(_FIRST) else 2 if note.startswith(_LAST) else 1


def _meanings(study: Study) -> list[str]:
    """Explain the words of the short table, in texts that are listed with the study's notes.

    One text explains the usual control and r. Another explains joint displacements that combine rad
    and m, if the arm has both types of joint.
    """
    said = ["the usual control is the pseudoinverse J⁺, r the number of spare joints"]
    if study.task.unit == "rad and m":
        said.append("joints off: root of the sum of squares; rad if revolute, m if prismatic")
    return said


def _as_many(notes: Sequence[str], rows: int) -> list[str]:
    """Select as many notes as fit into ``rows`` terminal rows, and add how many are left out.

    More rows would let the sentence and the table scroll out of a small terminal.
    """
    taken = list(notes)
    if _height_of(taken) <= rows:
        return taken
    while taken and _height_of(taken) + 1 > rows:
        taken.pop()
    left = len(notes) - len(taken)
    return [*taken, f"{left} more note{'s' if left > 1 else ''}: --full"]


def _height_of(lines: Sequence[str]) -> int:
    """Count the rows of lines of text, with wrapping, in a terminal of 80 columns."""
    return sum(fitted(line, COLUMNS).count("\n") + 1 for line in lines)
