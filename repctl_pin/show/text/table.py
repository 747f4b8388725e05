"""Tables for a terminal: plain text, aligned, nothing computed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..plots.motions import unit

if TYPE_CHECKING:
    from ...studies import Row, Study


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Align a table: the first column to the left, the others to the right."""
    lines = [list(header), *[list(row) for row in rows]]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]
    out = [
        "  ".join(
            cell.ljust(w) if i == 0 else cell.rjust(w) for i, (cell, w) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    ]
    return "\n".join([out[0].rstrip(), "─" * len(out[0]), *[line.rstrip() for line in out[1:]]])


def study_table(study: Study) -> str:
    """Write a study as its setting, a table of strategies, and notes."""
    width = max(map(len, study.setting))
    head = [f"{label.ljust(width)}  {text}" for label, text in study.setting.items()]
    header, cells, legend = study_cells(study)
    notes = [f"note: {note}" for note in study_notes(study)]
    return "\n".join([*head, "", table(header, cells), "\n".join(legend), *([""] if notes else []), *notes])


def study_cells(study: Study) -> tuple[list[str], list[list[str]], tuple[str, ...]]:
    """Write the table of a study as its header, its rows, and lines that say what they are."""
    some = next((row.motion for row in study.rows if row.motion is not None), None)
    units = unit(some) if some is not None else "rad"
    cycles = some.cycles if some is not None else 0
    header = [
        "strategy",
        "drift, cycle 1",
        f"cycle {cycles}",
        "tracking",
        "speed rms",
        "peak",
        "limit margin",
        "leaf margin",
        "from J⁺",
    ]
    legend = (
        f"drift in {units}; tracking in m at worst; speed ‖q̇‖ per s; limit margin: the least distance to a joint "
        "limit;",
        "leaf margin: σ_min(Nᵀ V̂) at worst on the way, 1 is best, 0 singular; "
        "from J⁺: ‖G − J⁺‖ / ‖J⁺‖ in the mean over Ω;",
        "posture: J⁺ that holds the start's joints in its null space; off it: other joints, to which it first moves",
    )
    return header, [_cells(row) for row in study.rows], legend


def study_notes(study: Study) -> list[str]:
    """What is to be known beside a study's table."""
    return [*study.notes, *(f"{row.label}: {row.stopped}" for row in study.rows if row.motion is None)]


def _cells(row: Row) -> list[str]:
    motion = row.motion
    if motion is None:
        return [row.label, *["stuck"] * 2, *["–"] * 6]
    broken = motion.broken_cycle
    margin = float(motion.limit_margin.min())
    limits = f"broken in cycle {broken}" if broken else "none" if margin > 1e6 else f"{margin:.3f}"
    return [
        row.label,
        short(motion.drift[0]),
        short(motion.drift[-1]),
        short(float(motion.tracking_error.max())),
        f"{motion.rms_speed:.3f}",
        f"{motion.peak_speed:.3f}",
        limits,
        "–" if row.leaf_margin is None else f"{row.leaf_margin:.2f}",
        "–" if row.distance is None else f"{row.distance:.1%}",
    ]


def short(value: float) -> str:
    """Write a number that may be tiny: 0.123, or 1e-12."""
    return f"{value:.4f}" if value >= 1e-3 else f"{value:.0e}" if value > 0 else "0"
