"""The strategies of a study, and the quantities by which it compares their motions.

A strategy is one of the compared controllers, such as J⁺; a quantity is one number per strategy,
such as the drift. Each quantity is declared here once, for the table of a study, its legend and its
JSON. G_d is the desired inverse, which the design of the study approximates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..motion import Motion
from ..motion.joint_motion import TOO_FAST

LABELS = {
    "pseudoinverse": "J⁺",
    "posture": "J⁺ + posture",
    "posture_off": "J⁺ + other posture",
    "repeatable": "nearest repeatable",
}
"""Label of each strategy of a study, by its name in files."""

KEYS = {label: key for key, label in LABELS.items()}
"""Name in files of each strategy, by its label."""

JOINTS = "joints"
"""Unit of a norm over the joints: rad, m, or both."""

SHARE = "share"
"""Unit of a share, which is written in per cent."""


def _never(motion: Motion) -> bool:
    """Return False, for a quantity that is never bad, so that tables never mark it."""
    return False


@dataclass(frozen=True)
class Quantity:
    """One number per controller in a study, such as the drift: how to compute, name and mark it.

    The table of a study, its legend and its JSON are made from the tuple ``QUANTITIES``.

    Attributes
    ----------
    key : str
        Name in JSON.
    name : str
        Name in tables, with ``{cycles}`` for the number of cycles and ``{desired}`` for G_d.
    unit : str
        ``m``, ``s``, ``joints`` (that of a norm over the joints: rad, m, or both), ``joints/s``,
        ``share`` (a fraction, written in per cent), or empty.
    of : function of a motion, optional
        Computes the value; its result None means that the motion has no such value. Without a
        function, the value is the attribute of the controller's :class:`.Row` with the name
        ``key``.
    bad : function of a motion
        Returns True if the value is bad; tables then mark it.
    lacking, stopped : str
        Texts in tables in place of a value of None, and if the controller stopped.
    cycles : int
        Smallest number of cycles for which tables list the quantity.
    meaning : str
        Sentence of the legend that explains the quantity.
    """

    key: str
    name: str
    unit: str = ""
    of: Callable[[Motion], float | None] | None = None
    bad: Callable[[Motion], object] = _never
    lacking: str = "–"
    stopped: str = "stopped"
    cycles: int = 1
    meaning: str = ""


def finite(value: float) -> float | None:
    """Return a number; None if it is infinite or NaN, which JSON does not have."""
    return float(value) if np.isfinite(value) else None


def _distance(motion: Motion, cycles: int) -> float:
    """Evaluate the minimum body distance, m, in the first ``cycles`` cycles.

    The distance is below 0 in a collision, and infinite without bodies.
    """
    found, end = motion.clearance, cycles * motion.steps
    looks = (len(found.distances) - 1) // motion.cycles
    least = float(found.distances[: cycles * looks + 1].min())
    if found.touch is not None and found.touch[0] <= end:
        least = min(least, found.overlap)
    return min(least, found.distance) if found.at <= end else least


QUANTITIES = (
    Quantity("drift_first", "drift after 1 cycle", JOINTS, lambda m: m.drift[0]),
    Quantity("drift_last", "drift after {cycles} cycles", JOINTS, lambda m: m.drift[-1], cycles=2),
    Quantity(
        "drift_in_last", "drift in cycle {cycles}", JOINTS, lambda m: m.cycle_drift[-1], cycles=2
    ),
    Quantity(
        "tracking_error",
        "tracking error",
        "m",
        lambda m: m.tracking_error.max(),
        bad=lambda m: m.path_loss,
    ),
    Quantity(
        "first_rms_speed",
        "joint speed, cycle 1",
        "joints/s",
        lambda m: m.first_rms_speed,
        meaning="Joint speed: ‖q̇‖, root mean square.",
    ),
    Quantity("rms_speed", "joint speed, all cycles", "joints/s", lambda m: m.rms_speed, cycles=2),
    Quantity(
        "peak_speed",
        "peak joint speed",
        "joints/s",
        lambda m: m.peak_speed,
        bad=lambda m: m.speed_ratio > TOO_FAST,
    ),
    Quantity(
        "limit_margin",
        "joint-limit margin",
        JOINTS,
        lambda m: finite(m.limit_margin.min()),
        bad=lambda m: m.broken_cycle,
        lacking="no limits",
    ),
    Quantity(
        "first_body_distance",
        "body distance, cycle 1",
        "m",
        lambda m: finite(_distance(m, 1)),
        bad=lambda m: _distance(m, 1) < 0,
        lacking="not checked",
    ),
    Quantity(
        "body_distance",
        "body distance, all cycles",
        "m",
        lambda m: finite(_distance(m, m.cycles)),
        bad=lambda m: _distance(m, m.cycles) < 0,
        lacking="not checked",
        cycles=2,
    ),
    Quantity(
        "cycle_time",
        "fastest first cycle",
        "s",
        meaning="Fastest first cycle: minimum time from rest to rest within the speed limits and "
        "the accelerations above.",
    ),
    Quantity(
        "leaf_margin",
        "leaf margin",
        meaning="Leaf margin: the smallest σ_min(Nᵀ V̂) along the path; 1 is best, 0 is singular.",
    ),
    Quantity(
        "distance",
        "distance from {desired}",
        SHARE,
        meaning="Distance: ‖G − {desired}‖ / ‖{desired}‖, averaged over Ω.",
    ),
    Quantity("outside", "outside Ω", SHARE, lambda m: m.outside, stopped="–"),
    Quantity(
        "beyond_closing_radius",
        "beyond the proved radius",
        SHARE,
        lambda m: m.beyond_closing_radius,
        stopped="–",
    ),
)
"""The quantities, in the order of a study's table."""

_BY_KEY = {quantity.key: quantity for quantity in QUANTITIES}
"""The quantities by their names in JSON."""


def values_of(motion: Motion, *keys: str) -> dict[str, float | None]:
    """Collect quantities of a motion by their keys in ``QUANTITIES``, for JSON.

    A quantity without a value, such as a body distance without bodies, is None.
    """
    values = {key: _BY_KEY[key].of for key in keys}
    return {key: value and value(motion) for key, value in values.items()}
