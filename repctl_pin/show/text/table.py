"""Tables as aligned plain text for a terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...arguments import percentage, ratio_in_percent
from ...model.bodies import bodies_of
from ...motion import Motion
from ...motion.joint_motion import TOO_FAST
from ...strategies import Pseudoinverse
from ..page.summaries import study_verdict
from .headline import stopped_cell
from .lines import fitted, terminal_width, with_options
from .numbers import number

if TYPE_CHECKING:
    from ...studies.study_result import Row, Study

NARROW = 10
"""Maximum width of a strategy's name, in characters per line."""


def table(
    header: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1
) -> str:
    """Align a table: the first columns to the left, the others to the right; a header may have
    several lines.

    If the terminal is too narrow, the columns that do not fit follow in further blocks below.
    """
    high = max(cell.count("\n") for cell in header)
    names = [("\n" * (high - cell.count("\n")) + cell).split("\n") for cell in header]
    lines = [*zip(*names, strict=True), *rows]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]
    blocks, width = [[0]], terminal_width()
    for i in range(1, len(header)):
        if (
            sum(widths[k] + 2 for k in (*blocks[-1], i)) - 2 > width
            and len(blocks[-1]) > 1
        ):
            blocks.append([0])
        blocks[-1].append(i)
    aligned = [
        [
            cell.ljust(w) if i < left else cell.rjust(w)
            for i, (cell, w) in enumerate(zip(line, widths, strict=True))
        ]
        for line in lines
    ]
    return "\n\n".join(_block(aligned, widths, block, high + 1) for block in blocks)


def _block(
    lines: Sequence[Sequence[str]],
    widths: Sequence[int],
    columns: Sequence[int],
    heads: int,
) -> str:
    """Format some columns of a table, with a rule below ``heads`` header lines."""
    out = ["  ".join(line[i] for i in columns).rstrip() for line in lines]
    rule = "─" * (sum(widths[i] for i in columns) + 2 * len(columns) - 2)
    return "\n".join([*out[:heads], rule, *out[heads:]])


def study_table(study: Study) -> str:
    """Format a study: warnings, verdict, settings, a table of strategies, legend and notes."""
    setting = study.setting | _two_norms(study)
    width = max(map(len, setting))
    loud = outside_words(max(row.outside for row in study.rows))
    head = [f"{label.ljust(width)}  {text}" for label, text in setting.items()]
    header = ["", *("\n".join(textwrap.wrap(row.label, NARROW)) for row in study.rows)]
    cells = table(header, [[name, *values] for name, values in study_cells(study)])
    legend = textwrap.wrap(study_legend(study), min(terminal_width(), 100))
    notes = [f"note: {with_options(note)}" for note in study_notes(study)]
    before = fitted("\n".join([*loud, study_verdict(study), "", *head]))
    return "\n".join(
        [before, "", cells, *legend, *(["", fitted("\n".join(notes))] if notes else [])]
    )


def _two_norms(study: Study) -> dict[str, str]:
    """Write the design's cost in the Frobenius and the spectral norm, which differ for r > 1."""
    if study.task.r == 1:
        return {}
    cost, spectral = study.design.cost, study.design.spectral_cost()
    label = f"mean ‖G − {_desired(study)}‖²"
    return {label: f"{cost:.3g} (Frobenius), {spectral:.3g} (spectral norm)"}


def outside_words(share: float) -> list[str]:
    """Write a warning that a share of the motion lies outside Ω; empty if the share is 0."""
    if share <= 0:
        return []
    return [
        f"warning: {percentage(share)} of the motion lies outside Ω, "
        "where repeatability is not guaranteed;",
        "use `repctl design ROBOT --path PATH` to design for this path",
        "",
    ]


def study_cells(study: Study) -> list[tuple[str, list[str]]]:
    """Format the table of a study: each quantity with its unit, and its value for every
    strategy."""
    some = next((row.motion for row in study.rows if row.motion is not None), None)
    rad, cycles = ("rad", 0) if some is None else (some.task.unit, some.cycles)
    speed = f"{rad}/s" if rad in ("rad", "m") else "per s"

    def of_motions(say: Callable[[Motion], str]) -> list[str]:
        return [
            stopped_cell(row) if row.motion is None else say(row.motion)
            for row in study.rows
        ]

    def of_rows(say: Callable[[Row], float | None]) -> list[str]:
        return [
            "–" if value is None else ratio_in_percent(value)
            for value in map(say, study.rows)
        ]

    later = [
        (
            f"drift after {cycles} cycles, {rad}",
            of_motions(lambda motion: number(motion.drift[-1])),
        ),
        (
            f"drift in cycle {cycles}, {rad}",
            of_motions(lambda motion: number(motion.cycle_drift[-1])),
        ),
    ]
    distances = [
        ("body distance, cycle 1, m", of_motions(lambda motion: _apart(motion, 1)))
    ]
    distances += [
        (
            "body distance, all cycles, m",
            of_motions(lambda motion: _apart(motion, cycles)),
        )
    ] * (cycles > 1)
    speeds = [
        (
            f"joint speed, cycle 1, {speed}",
            of_motions(lambda motion: number(motion.first_rms_speed)),
        )
    ]
    speeds += [
        (
            f"joint speed, all cycles, {speed}",
            of_motions(lambda motion: number(motion.rms_speed)),
        )
    ] * (cycles > 1)
    return [
        (
            f"drift after 1 cycle, {rad}",
            of_motions(lambda motion: number(motion.drift[0])),
        ),
        *(later if cycles > 1 else []),
        (
            "tracking error, m",
            of_motions(
                lambda motion: _marked(motion.tracking_error.max(), motion.path_loss)
            ),
        ),
        *speeds,
        (
            f"peak joint speed, {speed}",
            of_motions(
                lambda motion: _marked(motion.peak_speed, motion.speed_ratio > TOO_FAST)
            ),
        ),
        (f"joint-limit margin, {rad}", of_motions(_limit_margin)),
        *(
            distances
            if any(row.body_distance is not None for row in study.rows)
            else []
        ),
        *_unchecked(study),
        ("fastest first cycle, s", [_time(row) for row in study.rows]),
        (
            "leaf margin",
            [
                "–" if row.leaf_margin is None else number(row.leaf_margin)
                for row in study.rows
            ],
        ),
        (f"distance from {_desired(study)}", of_rows(lambda row: row.distance)),
        (
            "outside Ω",
            of_rows(lambda row: None if row.motion is None else row.motion.outside),
        ),
    ]


def study_legend(study: Study) -> str:
    """Explain the terms and marks of :func:`study_cells`."""
    desired = _desired(study)
    cells = " ".join(value for _, values in study_cells(study) for value in values)
    bad = (
        "! the frame leaves its path, a position or speed limit is violated, or two bodies collide "
        "(collisions are checked at 100 points per cycle). "
    )
    opened = "; ≠ means that the joint path does not close"
    return (
        f"{bad if '!' in cells else ''}Joint speed: ‖q̇‖, root mean square. "
        "Fastest first cycle: minimum time from rest to rest within the speed limits and the "
        f"accelerations above{opened if '≠' in cells else ''}. "
        "Leaf margin: the smallest σ_min(Nᵀ V̂) along the path; 1 is best, 0 is singular. "
        f"Distance: ‖G − {desired}‖ / ‖{desired}‖, averaged over Ω. "
        "J⁺ + posture: J⁺ with null-space attraction to the start configuration. "
        "J⁺ + other posture: attraction to a different configuration, which the arm reaches first. "
        "Both settle on a closed motion after some cycles; "
        "nearest repeatable closes the first cycle, from any start."
    )


def study_notes(study: Study) -> list[str]:
    """List the notes that belong below a study's table."""
    return [
        *study.notes,
        *(f"{row.label}: {row.stopped}" for row in study.rows if row.motion is None),
    ]


def _desired(study: Study) -> str:
    return "J⁺" if type(study.design.desired) is Pseudoinverse else "G_d"


def _marked(value: float, bad: object) -> str:
    """Format a number, with an exclamation mark if it is bad."""
    return f"{number(value)}{'!' if bad else ''}"


def _unchecked(study: Study) -> list[tuple[str, list[str]]]:
    """Make a row on the bodies that are not checked for collisions; an empty list without any."""
    count = len(bodies_of(study.task).unchecked)
    return [("bodies without a shape", [f"{count}"] * len(study.rows))] * (count > 0)


def _apart(motion: Motion, cycles: int) -> str:
    least = float(motion.coarse.body_distance[: cycles * motion.coarse.steps + 1].min())
    if not np.isfinite(least):
        return "not checked"
    return _marked(least, least < 0)


def _time(row: Row) -> str:
    if row.motion is None or row.cycle_time is None:
        return "–"
    return f"{row.cycle_time:.3f}{'' if row.motion.closes else ' ≠'}"


def _limit_margin(motion: Motion) -> str:
    margin = float(motion.limit_margin.min())
    return _marked(margin, motion.broken_cycle) if np.isfinite(margin) else "no limits"
