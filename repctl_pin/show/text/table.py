"""Tables for a terminal: plain text, aligned, nothing computed."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...strategies import Pseudoinverse
from ..plots.motions import unit

if TYPE_CHECKING:
    from ...studies import Row, Study


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Align a table: the first column to the left, the others to the right; a header may have several lines.

    On a terminal that is too narrow for it, it goes on below with further columns.
    """
    high = max(cell.count("\n") for cell in header)
    names = [("\n" * (high - cell.count("\n")) + cell).split("\n") for cell in header]
    lines = [*zip(*names, strict=True), *rows]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]
    blocks, room = [[0]], terminal_width() or sum(widths) + 2 * len(widths)
    for i in range(1, len(header)):
        if sum(widths[k] + 2 for k in (*blocks[-1], i)) - 2 > room and len(blocks[-1]) > 1:
            blocks.append([0])
        blocks[-1].append(i)
    return "\n\n".join(_block(lines, widths, block, high + 1) for block in blocks)


def _block(lines: Sequence[Sequence[str]], widths: Sequence[int], columns: Sequence[int], heads: int) -> str:
    """Write some columns of a table."""
    out = [
        "  ".join(line[i].rjust(widths[i]) if i else line[i].ljust(widths[i]) for i in columns).rstrip()
        for line in lines
    ]
    rule = "─" * (sum(widths[i] for i in columns) + 2 * len(columns) - 2)
    return "\n".join([*out[:heads], rule, *out[heads:]])


def terminal_width() -> int | None:
    """Columns of the terminal that stdout is; None where it is none."""
    try:
        return shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    except (AttributeError, ValueError):  # it is closed
        return None


def study_table(study: Study) -> str:
    """Write a study as its setting, a table of strategies, and notes; what lies outside Ω first of all."""
    width = max(map(len, study.setting))
    loud = outside_words(max(row.outside for row in study.rows))
    head = [f"{label.ljust(width)}  {text}" for label, text in study.setting.items()]
    header, cells, legend = study_cells(study)
    legend = tuple(textwrap.wrap(" ".join(legend), min(terminal_width() or 108, 108)))
    notes = [f"note: {note}" for note in study_notes(study)]
    return "\n".join([*loud, *head, "", table(header, cells), *legend, *([""] if notes else []), *notes])


def outside_words(share: float) -> list[str]:
    """Say, so that nobody misses it, that a motion leaves Ω; nothing where it does not."""
    if share <= 0:
        return []
    return [f"!!! OUTSIDE Ω: {share:.1%} of the repeatable motion lies where nothing was designed !!!", ""]


def study_cells(study: Study) -> tuple[list[str], list[list[str]], tuple[str, ...]]:
    """Write the table of a study as its header, its rows, and lines that say what they are."""
    some = next((row.motion for row in study.rows if row.motion is not None), None)
    units = unit(some) if some is not None else "rad"
    cycles = some.cycles if some is not None else 0
    plain = type(study.design.desired) is Pseudoinverse
    header = [
        "strategy",
        "drift,\ncycle 1",
        f"\ncycle {cycles}",
        f"in\ncycle {cycles}",
        "\ntracking",
        "speed\nrms",
        "\npeak",
        "limit\nmargin",
        "leaf\nmargin",
        "from\nJ⁺" if plain else "from\ndesired",
        "outside\nΩ",
    ]
    desired = "J⁺" if plain else "G_d"
    legend = (
        f"drift in {units} from the start, and from cycle to cycle; tracking in m at worst; speed ‖q̇‖ per s; limit "
        "margin: the least distance to a joint limit; ! beyond a limit;",
        f"leaf margin: σ_min(Nᵀ V̂) at worst on the way, 1 is best, 0 singular; from {desired}: "
        f"‖G − {desired}‖ / ‖{desired}‖ in the mean over Ω;",
        "posture: J⁺ that holds the start's joints in its null space, off it: other joints, to which it first moves: "
        "it too settles on a closed motion, after some cycles and by a second pull; nearest repeatable closes the "
        "first cycle, from any start.",
    )
    return header, [_cells(row) for row in study.rows], legend


def study_notes(study: Study) -> list[str]:
    """What is to be known beside a study's table."""
    return [*study.notes, *(f"{row.label}: {row.stopped}" for row in study.rows if row.motion is None)]


def _cells(row: Row) -> list[str]:
    motion = row.motion
    if motion is None:
        return [row.label, *["stuck"] * 2, *["–"] * 8]
    margin = float(motion.limit_margin.min())
    return [
        row.label,
        short(motion.drift[0]),
        short(motion.drift[-1]),
        short(motion.cycle_drift[-1]),
        short(float(motion.tracking_error.max())),
        f"{motion.rms_speed:.3f}",
        f"{motion.peak_speed:.3f}{'!' if motion.speed_ratio > 1 + 1e-9 else ''}",
        "none" if margin > 1e6 else f"{margin:.3f}{'!' if motion.broken_cycle else ''}",
        "–" if row.leaf_margin is None else f"{row.leaf_margin:.2f}",
        "–" if row.distance is None else f"{row.distance:.1%}",
        "–" if motion.outside is None else f"{motion.outside:.1%}" if motion.outside else "0",
    ]


def short(value: float) -> str:
    """Write a number that may be tiny: 0.123, or 1e-12."""
    return f"{value:.4f}" if value >= 1e-3 else f"{value:.0e}" if value > 0 else "0"
