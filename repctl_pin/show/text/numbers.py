"""Number formats of every page, figure and table."""

from __future__ import annotations

import math
from collections.abc import Iterable

NOTHING = 1e-4
"""Displacement, m, below which headlines, short tables and pages write 0."""


def number(value: float) -> str:
    """Format a number with three digits, or with one digit below 1e-3: 1.75, 0.0238, 2e-11.

    From 1000 up, it is rounded to an integer: 12346. A dash stands for infinity or NaN.
    """
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    if abs(value) < 1e-3:
        digits, power = f"{value:.0e}".split("e")
        return f"{digits}e{int(power)}"
    return f"{value:.3g}" if abs(value) < 1e3 else f"{value:.0f}"


def metres(value: float, digits: int = 2) -> str:
    """Format a length, m, in a suitable unit: 1.2 m, 45 cm, 2.6 mm, 0.02 mm, 7 µm.

    The text has two significant digits, or as many as given, and is 0 below a nanometre.
    """
    if value < 1e-9:
        return "0"
    units = ((0.995, 1, "m"), (0.00995, 100, "cm"), (1e-5, 1000, "mm"), (0.0, 1e6, "µm"))
    scale, unit = next((scale, unit) for least, scale, unit in units if value >= least)
    return f"{float(f'{scale * value:.{digits}g}'):g} {unit}"


def displacement(value: float) -> str:
    """Format the displacement of a part, m, in a suitable unit: 45 cm, 2.6 mm; 0 below 0.1 mm.

    So integration errors are not read as drift.
    """
    return "0" if value < NOTHING else metres(value)


def radians(value: float) -> str:
    """Format an angle in rad with two digits: 3.7 rad, 2e-5 rad."""
    return f"{number(float(f'{value:.2g}'))} rad"


def percent(share: float) -> str:
    """Format a fraction as a change in per cent: +0.3 %, −1 %; 0 % below 0.05 %."""
    if abs(share) < 5e-4:
        return "0 %"
    text = f"{100 * share:+.1f}" if abs(share) < 0.1 else f"{100 * share:+.0f}"
    return f"{text.replace('-', '−')} %"


def counted(count: int, noun: str) -> str:
    """Format a number with its noun, such as 1 cycle or 10 cycles."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def row(values: Iterable[float], digits: int = 4) -> str:
    """Format numbers with the given number of significant digits, separated by commas."""
    return ", ".join(f"{value:.{digits}g}" for value in values)
