"""The phase-plane profile of a timed motion: how fast it runs along its joint path."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..palette import BLUE
from .motions import quiet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...motion import TimedMotion


def phase_plane(ax: Axes, timed: TimedMotion, *, colour: str = BLUE) -> Axes:
    """Draw ‖q̇‖ over the length of the joint path: from rest, round and round, to rest.

    Parameters
    ----------
    ax
        Where to draw.
    timed
        What :func:`repctl_pin.timed` made; its first three cycles, if there are more.
    colour
        Of the line.
    """
    ax.plot(timed.length, timed.speed, color=colour)
    ax.set_xlabel("length of the joint path")
    ax.set_ylabel("joint speed ‖q̇‖ (per s)")
    ax.set_xlim(0, timed.length[-1])
    ax.set_ylim(0, None)
    return quiet(ax)
