"""Tables as aligned plain text for a terminal, for any cells and for a whole study.

A span is a piece of text with a tone, which a terminal shows as colour. A strategy is a controller
that a study compares; each strategy has a column. J⁺ is the pseudoinverse, the usual strategy, and
Ω the region of joint space of the design.

``Span`` is a piece of text with its tone, which is shown as colour. ``JointMotion`` is a joint
motion over several cycles: q, q̇ (T, n) at times t, without the path of the frame. ``Quantity`` is
one number per controller in a study, such as the drift: how to compute, name and mark it. ``Row``
is the result of one strategy in a study: its motion and figures, or why it stopped.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...base.arguments import percentage, ratio_in_percent
from ...model.bodies import bodies_of
from ...strategies import Pseudoinverse
from ...studies.quantities import JOINTS, LABELS, QUANTITIES, SHARE, Quantity
from .coloured_text import Span, fitted, noted, terminal_width
from .headline import stopped_cell, study_headline
from .numbers import number

if TYPE_CHECKING:
    from ...motion.joint_motion import JointMotion
    from ...studies.study_result import Row, Study

NARROW = 10
"""Maximum width of a strategy's name, in characters per line."""


def table(header: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1) -> str:
    """Align a table as text: the first ``left`` columns to the left, the others to the right.

    A header may have several lines. If the terminal is too narrow, the columns that do not fit are
    printed in blocks below.
    """
    spans = table_spans(header, [[Span(cell) for cell in row] for row in rows], left)
    text = "".join(span.text for span in spans)
    return "\n".join(line.rstrip() for line in text.split("\n"))


def table_spans(header: Sequence[str], rows: Sequence[Sequence[Span]], left: int = 1) -> list[Span]:
    """Align the columns of a table whose cells are spans, which keep their tones.

    ``left`` is the number of columns that are aligned to the left. Returns spans to print one after
    the other; they include the line breaks.
    """
    high = max(cell.count("\n") for cell in header)
    names = [("\n" * (high - cell.count("\n")) + cell).split("\n") for cell in header]
    heads = [[Span(name) for name in line] for line in zip(*names, strict=True)]
    widths = [max(len(line[i].text) for line in [*heads, *rows]) for i in range(len(header))]
    out: list[Span] = []
    for columns in _blocks(widths):
        out += [Span("\n\n")] if out else []
        for k, line in enumerate([*heads, *rows]):
            out += [Span("\n")] if k else []
            for i in columns:
                pad = Span(" " * (widths[i] - len(line[i].text)))
                gap = Span("  " if i != columns[0] else "")
                out += [gap, line[i], pad] if i < left else [gap, pad, line[i]]
            if k == high:
                rule = "─" * (sum(widths[i] for i in columns) + 2 * len(columns) - 2)
                out.append(Span(f"\n{rule}"))
    return out


def _blocks(widths: Sequence[int]) -> list[list[int]]:
    """Divide the columns of a table into blocks that fit into the terminal, as lists of indices.

    Each block begins with the first column, which names the rows. ``widths`` are the widths of the
    columns, in characters.
    """
    blocks = [[0]]
    for i in range(1, len(widths)):
        wide = sum(widths[k] + 2 for k in (*blocks[-1], i)) - 2
        if wide > terminal_width() and len(blocks[-1]) > 1:
            blocks.append([0])
        blocks[-1].append(i)
    return blocks


def study_table(study: Study) -> str:
    """Format a whole study as text: warnings, headline, settings, a table, legend and notes.

    ``repctl study --full`` prints it. The table has one column per strategy, such as J⁺.
    """
    setting = study.setting | _two_norms(study)
    width = max(map(len, setting))
    loud = outside_words(max(row.outside for row in study.rows))
    head = [f"{label.ljust(width)}  {text}" for label, text in setting.items()]
    header = ["", *("\n".join(textwrap.wrap(row.label, NARROW)) for row in study.rows)]
    cells = table(header, [[name, *values] for name, values in study_cells(study)])
    legend = textwrap.wrap(study_legend(study), min(terminal_width(), 100))
    notes = [noted(note) for note in study_notes(study)]
    before = fitted("\n".join([*loud, str(study_headline(study)), "", *head]))
    return "\n".join(
        [before, "", cells, *legend, *(["", fitted("\n".join(notes))] if notes else [])]
    )


def _two_norms(study: Study) -> dict[str, str]:
    """Format the design's cost in the Frobenius and the spectral norm: a dict from label to text.

    The cost is the mean squared distance of the design from the desired inverse over its region Ω.
    With one degree of redundancy the two norms agree, and the dict is empty.
    """
    if study.task.r == 1:
        return {}
    cost = study.design.cost
    spectral = study.design.spectral_cost()
    label = f"mean ‖G − {_desired(study)}‖²"
    return {label: f"{cost:.3g} (Frobenius), {spectral:.3g} (spectral norm)"}


def outside_words(share: float) -> list[str]:
    """Make a warning that a share, 0 to 1, of the motion lies outside Ω, as lines of text.

    Ω is the region of joint space of the design; outside, repeatability is not guaranteed. The list
    is empty if the share is 0.
    """
    if share <= 0:
        return []
    return [
        f"warning: {percentage(share)} of the motion lies outside Ω, "
        "where repeatability is not guaranteed;",
        "use `repctl design ROBOT --path PATH` to design for this path",
        "",
    ]


def margin_words(motion: JointMotion) -> str:
    """Format the minimum joint-limit margin of a motion, its unit and joint, or ``no limits``."""
    joint = int(np.argmin(motion.limit_margin.min(axis=0)))
    margin = float(motion.limit_margin[:, joint].min())
    if not np.isfinite(margin):
        return "no limits"
    unit = "rad" if motion.task.revolute[joint] else "m"
    return f"minimum {number(margin)} {unit}, of {motion.task.joint_names[joint]}"


def study_cells(study: Study) -> list[tuple[str, list[str]]]:
    """Format the table of a study: each quantity with its unit, and its value for every controller.

    Return, for each row, a name and a text per controller. Quantities that the study lacks, such as
    body distances without bodies, have no row.
    """
    some = next((row.motion for row in study.rows if row.motion is not None), None)
    unit, cycles = ("rad", 0) if some is None else (some.task.unit, some.cycles)
    units = {JOINTS: unit, "joints/s": f"{unit}/s" if unit in ("rad", "m") else "per s"}
    bodies = any(row.body_distance is not None for row in study.rows)
    proved = study.design.proof and study.design.proof.closes
    cells = []
    for quantity in QUANTITIES:
        if quantity.key == "cycle_time":  # below what was not checked
            cells += _unchecked(study)
        if cycles < quantity.cycles > 1 or ("body" in quantity.key and not bodies):
            continue
        if quantity.key == "beyond_closing_radius" and not proved:
            continue
        name = quantity.name.format(cycles=cycles, desired=_desired(study))
        if quantity.unit not in ("", SHARE):
            name += f", {units.get(quantity.unit, quantity.unit)}"
        cells.append((name, [_cell(quantity, row) for row in study.rows]))
    return cells


def _cell(quantity: Quantity, row: Row) -> str:
    """Format the value of a quantity for one controller, with a mark if it is bad.

    ``!`` marks a bad value. Without a value, the text is the quantity's ``lacking``, such as ``not
    checked``; without a motion, the text is the quantity's ``stopped``, or a dash if the motion was
    rejected.
    """
    motion = row.motion
    if quantity.of is None:
        value = getattr(row, quantity.key)
    elif motion is None:
        return quantity.stopped if stopped_cell(row) == "stopped" else "–"
    else:
        value = quantity.of(motion)
    if value is None:
        return quantity.lacking
    if quantity.unit == SHARE:
        return ratio_in_percent(value)
    if quantity.unit == "s":
        return f"{value:.3f}"
    return f"{number(value)}{'!' if motion and quantity.bad(motion) else ''}"


def study_legend(study: Study, named: Callable[[str], str] = str) -> str:
    """Explain in one paragraph the terms of a study's table.

    The mark ``!`` of a bad value is explained if it occurs. ``named`` converts the label of a
    controller to the heading of its column.
    """
    desired = _desired(study)
    cells = " ".join(value for _, values in study_cells(study) for value in values)
    bad = (
        "! the frame leaves its path, a position or speed limit is violated, or two bodies collide "
        "(collisions are checked at 100 points per cycle). "
    )
    meanings = [quantity.meaning.format(desired=desired) for quantity in QUANTITIES]
    posture, other, repeatable = (
        named(LABELS[key]) for key in ("posture", "posture_off", "repeatable")
    )
    return (
        f"{bad if '!' in cells else ''}{' '.join(filter(None, meanings))} "
        f"{posture}: J⁺ with null-space attraction to the start configuration. "
        f"{other}: attraction to a different configuration, which the arm reaches first. "
        "Both settle on a closed motion after some cycles; "
        f"{repeatable[:1].lower()}{repeatable[1:]} closes the first cycle, from any start."
    )


def study_notes(study: Study) -> list[str]:
    """List the notes below a study's table, and why each controller without a motion stopped."""
    return [
        *study.notes,
        *(f"{row.label}: {row.stopped}" for row in study.rows if row.motion is None),
    ]


def _desired(study: Study) -> str:
    """Return the symbol of the inverse that the design approximates: J⁺, or G_d for any other."""
    return "J⁺" if type(study.design.desired) is Pseudoinverse else "G_d"


def _unchecked(study: Study) -> list[tuple[str, list[str]]]:
    """Make the table's row on bodies without a shape, which are not checked for collisions.

    The list has one row, a name and its values; it is empty if all bodies are checked.
    """
    count = len(bodies_of(study.task).unchecked)
    return [("bodies without a collision shape", [f"{count}"] * len(study.rows))] * (count > 0)
