"""Colour-blind-safe palette of all figures (Okabe and Ito)."""

from __future__ import annotations

from ..studies.study_result import Study

ORANGE, SKY, GREEN, YELLOW = "#E69F00", "#56B4E9", "#009E73", "#F0E442"
BLUE, VERMILLION, PURPLE, INK = "#0072B2", "#D55E00", "#CC79A7", "#222222"

GREY = "#595959"
"""Colour of text beside a figure that does not belong to one line."""

COLOURS = {"pseudoinverse": VERMILLION, "posture": GREEN, "posture_off": ORANGE, "repeatable": BLUE}
"""Colour of each strategy of a study, the same in every figure."""

_OWN = (PURPLE, SKY, YELLOW, INK)
"""Colours of user-defined controllers, used in this order."""


def luminance(colour: str) -> float:
    """Compute the relative luminance of a colour ``#rrggbb``, as WCAG 2 defines it: 0 to 1."""
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def readable(colour: str) -> str:
    """Darken a colour ``#rrggbb`` until its contrast to white is at least 4.5, as text requires."""
    parts = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    for share in range(100, 0, -2):
        darker = "#" + "".join(f"{c * share // 100:02x}" for c in parts)
        if 1.05 / (luminance(darker) + 0.05) >= 4.5:
            return darker
    return INK


def colours(study: Study) -> dict[str, str]:
    """Return the colours ``#rrggbb`` of a study's controllers by key, such as ``pseudoinverse``.

    User-defined controllers share four colours, which repeat after the fourth.
    """
    own = [row.key for row in study.rows if row.key not in COLOURS]
    return COLOURS | {key: _OWN[k % len(_OWN)] for k, key in enumerate(own)}
