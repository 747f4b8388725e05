"""Motions of a study that its figures show, each with its label and colour.

The drift is the distance of the joints from the start after a cycle.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...motion import Motion
from ...motion.motion import CLOSED
from ...studies.study_result import Study
from ..palette import INK, colours
from ..text.headline import names_of
from .figure_layout import plain

BEYOND: dict[str, Any] = {"marker": "x", "color": INK, "ms": 9, "mew": 2, "ls": "none", "zorder": 5}
"""Style of the cross at the first violation of a motion."""


def drawn(study: Study) -> list[tuple[str, Motion, str]]:
    """List the label, motion and colour of every controller of a study that has a motion.

    All figures of a study are drawn from this list.
    """
    colour = colours(study)
    return [
        (plain(names_of(row.label)["title"]), row.motion, colour[row.key])
        for row in study.rows
        if row.motion is not None
    ]


def motions_on_one_scale(
    motions: Sequence[tuple[str, Motion, str]],
) -> list[tuple[str, Motion, str]]:
    """Select the motions that can be drawn on one linear scale.

    A motion is left out if its drift hardly grows after cycle 1, as under a controller with a
    posture task, and its drift in cycle 1 is more than four times the largest drift of the motions
    whose drift does grow. ``motions`` lists the label, motion and colour of each.
    """
    rest = max((float(m.drift.max()) for _, m, _ in motions if not stays(m.drift)), default=0.0)
    return [
        one
        for one in motions
        if not rest > CLOSED or not stays(one[1].drift) or one[1].drift[0] <= 4 * rest
    ]


def stays(drift: NDArray[np.float64]) -> bool:
    """Test whether nearly all of a drift (cycles,) occurs in the first of several cycles.

    Such a motion moves to another configuration and is closed from then on.
    """
    return len(drift) > 1 and bool(drift[-1] < 1.1 * drift[0])
