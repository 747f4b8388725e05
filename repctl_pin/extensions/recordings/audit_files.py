"""The files of an audit: a page of the recorded motion, and a figure of its creep."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...arguments import Array
from ...files import prepare_folder, write_whole
from ...motion.joint_motion import JointMotion
from ...show.page.playback import Playback, playback_page, traced_chains
from ...show.palette import GREY, INK, PURPLE, SKY, VERMILLION
from ...show.plots.motions import plain, png, quiet, titled
from .audit import Audit
from .audit_answer import audit_headline, part_of

_STEPS = 48
"""Samples per cycle on the page; half as many if there are more cycles than this number."""

_CYCLES = 240
"""Maximum number of cycles on the page."""

_STYLES = ((INK, "o"), (PURPLE, "s"), (GREY, "^"), (SKY, "D"))
"""Colours and markers of the joints in the figure, which are those that creep most."""

_LEAST = 2e-3
"""Minimum height of an axis, m or rad, so that rounding errors are not magnified."""


def write_audit(audit: Audit, folder: Path) -> list[Path]:
    """Write ``audit.html`` and ``audit.png`` atomically.

    Parameters
    ----------
    audit
        The audit of a log that repeats.
    folder
        Output folder.

    Returns
    -------
    The files, in this order.
    """
    contents: dict[str, str | bytes] = {
        "audit.html": _audit_page(audit),
        "audit.png": png(_audit_figure(audit)),
    }
    prepare_folder(folder)
    return [write_whole(folder / name, content) for name, content in contents.items()]


def _audit_page(audit: Audit) -> str:
    """Write the HTML page of the recorded motion, with the first visit as the ghost.

    Each cycle is the part of the log between two consecutive visits. If there are too many, evenly
    spaced ones are shown.
    """
    task, visits = audit.task, audit.visits
    ends = np.unique(
        np.linspace(1, audit.returns, min(audit.returns, _CYCLES)).astype(int)
    )
    steps = _STEPS if len(ends) <= _STEPS else _STEPS // 2
    rows = [_between(audit, end, steps) for end in ends]
    q = np.vstack([rows[0][:1], *(cycle[1:] for cycle in rows)])
    mean = float(np.median(np.diff(visits.t)))
    t = np.linspace(0, mean * len(ends), len(q))
    drift = np.linalg.norm(visits.q[ends] - visits.q[0], axis=1)
    motion = JointMotion(task, t, q, np.gradient(q, t, axis=0), len(ends), steps)
    label = "the recorded motion"
    track = Playback(
        label,
        VERMILLION,
        task.to_robot(q),
        motion.cycles,
        drift,
        task.unit,
        t,
        motion=motion if len(task.frames) > 1 else None,
    )
    count = (
        f", {len(ends)} of its {audit.returns} returns"
        if len(ends) < audit.returns
        else ""
    )
    return playback_page(
        traced_chains(task, visits.q[0]),
        [track],
        name=f"{Path(audit.log.name).name}{count}",
        headline=audit_headline(audit),
    )


def _between(audit: Audit, end: int, steps: int) -> Array:
    """Interpolate the log between visits ``end`` − 1 and ``end``: (steps + 1, n), at equal
    times."""
    visits, log = audit.visits, audit.log
    t = np.linspace(visits.t[end - 1], visits.t[end], steps + 1)
    q = np.stack([np.interp(t, log.t, column) for column in log.q.T], axis=1)
    q[0], q[-1] = visits.q[end - 1], visits.q[end]
    return q


def _audit_figure(audit: Audit) -> Figure:
    """Draw ``audit.png``: creep of the part that is off most, and of the joints, over time."""
    task = audit.task
    visits = audit.visits
    joints = audit.joints
    assert joints is not None
    seconds, unit = audit.clock
    order = np.argsort(-np.abs(joints.rate))[: len(_STYLES)]
    title = f"{task.robot.name}, {Path(audit.log.name).name}: {audit.returns} returns to one pose"
    figure = titled(7.6, 5.6, title)
    first, second = figure.subplots(2, 1, sharex=True)
    time = (visits.t - audit.log.t[0]) / seconds
    _line(first, time, 100 * audit.along, 100 * audit.rate * seconds, VERMILLION, "o")
    first.set_ylabel(f"{plain(part_of(audit))} (cm)")
    for i, (colour, marker) in zip(order, _STYLES, strict=False):
        values = visits.q[:, i] - visits.q[0, i]
        rate = float(joints.rate[i])
        name = plain(task.joint_names[i])
        _line(second, time, values, rate * seconds, colour, marker, name)
    second.set_ylabel(f"joints, since the first visit ({task.unit})")
    second.set_xlabel(f"time ({unit}s)")
    second.legend(frameon=False, fontsize=8, ncols=2)
    for ax, least in ((first, 100 * _LEAST), (second, _LEAST)):
        low, high = ax.get_ylim()
        more = max(0.0, least - (high - low)) / 2
        ax.set_ylim(low - more, high + more)
        quiet(ax)
    return figure


def _line(
    ax: Axes,
    time: Array,
    values: Array,
    slope: float,
    colour: str,
    marker: str,
    label: str | None = None,
) -> None:
    """Draw the values at the visits as dots, and their trend as a line."""
    level = float(np.median(values - slope * time))
    ends = time[[0, -1]]
    ax.plot(time, values, marker, ms=3.5, color=colour, label=label)
    ax.plot(ends, level + slope * ends, color=colour, lw=1)
