"""Colour-blind-safe palette of all figures (Okabe and Ito)."""

from __future__ import annotations

from ..studies import Study

ORANGE, SKY, GREEN, YELLOW = "#E69F00", "#56B4E9", "#009E73", "#F0E442"
BLUE, VERMILLION, PURPLE, INK = "#0072B2", "#D55E00", "#CC79A7", "#222222"

COLOURS = {"pseudoinverse": VERMILLION, "posture": GREEN, "posture_off": ORANGE, "repeatable": BLUE}
"""The colour of each strategy of a study, the same in every picture."""

_OWN = (PURPLE, SKY, YELLOW, INK)
"""For user-defined controls, one after the other."""


def colours(study: Study) -> dict[str, str]:
    """Assign a colour to every row of a study, by its key."""
    own = [row.key for row in study.rows if row.key not in COLOURS]
    return COLOURS | {key: _OWN[k % len(_OWN)] for k, key in enumerate(own)}
