"""Read the numbers in sentences, tables and pages back."""

from __future__ import annotations

import numpy as np

UNITS = {"": 1.0, "rad": 1.0, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "µm": 1e-6, "%": 1e-2}


def value_of(text: str) -> float:
    """The value of ``32 cm``, ``0``, ``2e-11`` or ``−1.0 %``, in m, rad or as a share."""
    number, _, unit = text.replace("\u00a0", " ").replace("−", "-").partition(" ")
    return float(number) * UNITS[unit]


def reads(text: str, value: float, digits: int = 2) -> bool:
    """Whether a text is a value, rounded to so many digits; a length below 0.1 mm is 0."""
    said = value_of(text)
    if said == 0:
        return abs(value) < 1e-4
    step = 10.0 ** (np.floor(np.log10(abs(said))) + 1 - digits)
    return bool(abs(said - value) <= 0.5001 * step)
