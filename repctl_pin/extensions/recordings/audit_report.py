"""Report of an audit: an answer that fits a terminal of 24 rows, a page and a figure.

A Span is a piece of text with a style, such as "bad" for red. Drift is a steady change of the
joints at one hand pose. A visit is a time at which the hand is at the pose. Letters: N visits, n
joints.

``Headline`` is a sentence on the drift, and notes on joint speed, limits and bodies.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ...base.arguments import Array
from ...base.files import prepare_folder, write_whole
from ...model.task import unit_of
from ...motion.joint_motion import JointMotion
from ...show.page.playback import Playback, playback_page, traced_chains
from ...show.palette import GREY, INK, PURPLE, SKY, VERMILLION
from ...show.plots.figure_layout import plain, png, quiet, titled
from ...show.text.coloured_text import Span, capital, fitted, wrapped
from ...show.text.headline import Headline, hands_are
from ...show.text.numbers import metres, number
from ...show.text.part_names import part_name
from ...show.text.table import table
from .audit import Audit
from .audit_words import audit_dialog
from .verdict import ENOUGH, JUMPS, REPEATS, SCATTERS

_JOINTS = 8
"""Maximum number of joints in the table, the joint with the largest difference first."""

_SHOWN, _LETTERS = 24, 26
"""Maximum numbers of visits, and of different configurations, that are written as letters."""

_STILL = 1e-3
"""Displacement of an origin, in m per rad or m of the joints, below which it does not move."""

_SURE = "95 % confidence"
"""Confidence of the intervals of rates."""

_SPANS = ((3600.0, "h"), (60.0, "min"), (0.0, "s"))


_ABOUT = (
    "whether the joints differ each time the hand is back at one pose. A rate, such as cm per "
    "minute, is the mean over the log, and in 95 of 100 logs the true rate lies between the two "
    "numbers in brackets. The bars show the distance since the first visit, not a rate."
)
"""What the sentence of an audit says, for the dialog of its page."""

_STEPS = 48
"""Samples per cycle on the page; half as many if there are more cycles than this number."""

_CYCLES = 240
"""Maximum number of cycles on the page."""

_STYLES = ((INK, "o"), (PURPLE, "s"), (GREY, "^"), (SKY, "D"))
"""Colours and markers of the joints in the figure, which are those that drift most."""

_LEAST = 2e-3
"""Minimum height of an axis, m or rad, so that rounding errors are not magnified."""


def audit_answer(audit: Audit, files: Sequence[str] = ()) -> list[Span]:
    """Write the answer of an audit: a sentence, a short table, notes, and a list of files.

    Parameters
    ----------
    audit
        The audit.
    files
        Lines that name the written files, to be printed last.
    """
    out = [*wrapped(_audit_sentence(audit)), Span(f"\n\n{fitted(_about(audit))}\n")]
    after = [f"note: {note}" for note in audit.notes]
    if audit.found is not None:
        out.append(Span(f"\n{_table(audit)}\n\n"))
        after = [*_leads(audit), *after]
    return [*out, Span(fitted("\n".join([*after, *files])))]


def _audit_sentence(audit: Audit) -> list[Span]:
    """Write the verdict, its statistic, such as the drift rate, and the number of returns.

    The result is a text of a few sentences, in styled pieces. If no pose of the log is visited
    often enough for a verdict, the text says so.
    """
    if audit.found is None:
        return [Span(f"The log does not repeat{_distance(audit)}. Drift cannot be determined.")]
    back = hands_are(len(audit.task.frames))
    span = _time_span(float(audit.log.t[-1] - audit.log.t[0]))
    returns = (
        f" In this log of {_unbroken(span)} {back} back at the same pose {audit.returns} times"
    )
    if audit.drifts:  # the rate alone would not say how far
        name, off = _farthest(audit)
        returns += f", where {name} differs by up to {off} in all"
    return [*_verdict(audit), Span(f"{returns}.")]


def _verdict(audit: Audit) -> list[Span]:
    """Write the verdict and its statistic in pieces of text; the key number has a style.

    The statistic is the rate with its interval if the arm drifts, and the largest difference if it
    jumps or scatters. If the log is inconclusive, the text gives the reason.
    """
    assert audit.found is not None
    seconds, unit = audit.clock
    name, off = _farthest(audit)
    if audit.drifts:
        fastest, rate, interval = _fastest(audit)
        when = "" if audit.begins is None else _time_span(audit.begins)
        start = f"repeats for {when}, then drifts" if when else "drifts"
        return [
            Span(f"Your arm {start}: {fastest} moves "),
            Span(rate.replace(" ", "\u00a0"), "bad"),
            Span(f" {_unbroken(interval)}."),
        ]
    if audit.verdict == REPEATS:
        error = f"{metres(audit.error * seconds)} per {unit}"
        return [
            Span("Your arm repeats: "),
            Span("no\u00a0drift", "good"),
            Span(f" above the noise, {error}; {name} differs by at most {off}."),
        ]
    if audit.verdict == JUMPS:
        count = int(audit.found.groups.max()) + 1
        return [
            Span(f"Your arm does not repeat: it jumps between {count} configurations, {name} "),
            Span(off, "bad"),
            Span(" apart."),
        ]
    if audit.verdict == SCATTERS:
        return [
            Span(f"Your arm does not repeat: {name} differs by up to "),
            Span(off, "bad"),
            Span(", without a steady drift."),
        ]
    if audit.returns >= ENOUGH - 1:
        hides = "whether" if audit.found.within else "how"
        return [
            Span(f"Inconclusive: {name} differs by up to {off}, but the noise of the log "),
            Span(f"hides {hides} the arm drifts."),
        ]
    noise = "within" if audit.found.within else "more than"
    few = f"Inconclusive: {ENOUGH - 1} returns are needed. So far, {name} differs by up to {off}"
    return [Span(f"{few}, {noise} the noise.")]


def _farthest(audit: Audit) -> tuple[str, str]:
    """Name what differs most between two visits: a point of a link or, if no point moves, a joint.

    Returns the name, such as "the elbow", and the largest difference with its unit, as texts.
    """
    joint = int(np.argmax(audit.differences))
    value = float(audit.differences[joint])
    name = f"the {_part_of(audit)}"
    off = metres(audit.difference)
    if audit.difference < _STILL * value:
        unit = unit_of([audit.task.revolute[joint]])
        name = audit.task.joint_names[joint]
        off = f"{_number(value)} {unit}"
    return name, off.replace(" ", "\u00a0")


def _headline(audit: Audit) -> Headline:
    """Make the headline of the page: the sentence of the audit, and the remarks below it."""
    notes = [note.removeprefix("! ") for note in _leads(audit)]
    said = tuple(Span(f"{capital(note)}.") for note in notes)
    return Headline(tuple(_audit_sentence(audit)), said, _ABOUT)


def _distance(audit: Audit) -> str:
    """Write how near the hand came to a return, as the end of a sentence.

    The sentence begins with "The log does not repeat". It is written if there is no verdict,
    because no pose was visited often enough.
    """
    level = " and level" if audit.log.levels.shape[1] else ""
    if audit.returns > 0:
        back = hands_are(len(audit.task.frames))
        return f" often enough: {back} back at a pose{level} once"
    if not np.isfinite(audit.visits.nearest):
        return f": no pose{level} is left and visited again"
    nearest, allowed = metres(audit.visits.nearest), metres(audit.visits.tolerance)
    said = f": no pose{level} is visited again nearer than {nearest} ({allowed} would count)"
    if level:
        said += ", where the level counts as a rotation of the hand"
    return _unbroken(said)


def _unbroken(text: str) -> str:
    """Keep numbers and their units on one line, by no-break spaces."""
    return re.sub(r"(\d) (\w+)", "\\1\u00a0\\2", text)


def _fastest(audit: Audit) -> tuple[str, str, str]:
    """Write the drift of the most displaced link; if it is not significant, the drift of a joint.

    The joint is the one with the most significant drift. Returns three texts: the name of the link
    or joint, the rate per hour, minute or second, and the 95 % interval.
    """
    assert audit.joints is not None
    seconds, unit = audit.clock
    if audit.rate > audit.error:
        low, high = (metres(max(audit.rate + s * audit.error, 0) * seconds) for s in (-1, 1))
        rate = f"{metres(audit.rate * seconds)} per {unit}"
        return f"the {_part_of(audit)}", rate, f"({_SURE}: {low} to {high})"
    joint = int(np.argmax(np.abs(audit.joints.rate) / audit.joints.error))
    rate, error = (
        number(float(value))
        for value in (abs(audit.joints.rate[joint]) * seconds, audit.joints.error[joint] * seconds)
    )
    name = audit.task.joint_names[joint]
    return (
        name,
        f"{rate} {unit_of([audit.task.revolute[joint]])} per {unit}",
        f"({_SURE}: ± {error})",
    )


def _part_of(audit: Audit) -> str:
    """Name the link that is displaced most from the first visit of the pose, such as "elbow"."""
    return part_name(audit.task, audit.visits.q[0], audit.links[audit.part])


def _about(audit: Audit) -> str:
    """Write one line that names the arm, its task and the log."""
    task, t = audit.task, audit.log.t
    rows = f"{len(t):,} rows in {_time_span(float(t[-1] - t[0]))}"
    return f"{task.robot.name} {task.frame}, {task.kind}, r = {task.r}: {audit.log.name}, {rows}"


def _time_span(seconds: float) -> str:
    """Format a time in a suitable unit, such as 2.5 h, 12 min or 48 s."""
    scale, unit = next(one for one in _SPANS if seconds >= one[0])
    return f"{seconds / (scale or 1):.2g} {unit}"


def _number(value: float) -> str:
    """Format a change of a joint, rad or m, as a number; a change below 1e-9 is written as 0."""
    return "0" if abs(value) < 1e-9 else number(value)


def _table(audit: Audit) -> str:
    """Format the table of drift: the most displaced link, then up to eight joints that differ most.

    The columns are the largest difference, the drift per return and per unit of time, and the
    half-width of the 95 % interval.
    """
    joints, visits = audit.joints, audit.visits
    assert joints is not None
    seconds, unit = audit.clock
    each = float(visits.t[-1] - visits.t[0]) / audit.returns
    rates = (audit.rate * each, audit.rate * seconds, audit.error * seconds)
    rows = [[_part_of(audit), *map(metres, (audit.difference, *rates))]]
    order = np.argsort(-audit.differences)[:_JOINTS]
    for i in order:
        rate, error = float(joints.rate[i]), float(joints.error[i])
        values = (audit.differences[i], rate * each, rate * seconds, error * seconds)
        name = f"{audit.task.joint_names[i]}, {unit_of([audit.task.revolute[i]])}"
        rows.append([name, *map(_number, map(float, values))])
    header = ["", "largest difference", "per return", f"per {unit}", "± 95 %"]
    return table(header, rows)


def _leads(audit: Audit) -> list[str]:
    """Write the remarks below the table of an audit, one text per line.

    The remarks are, in this order: the configuration of each visit, if the arm jumps or scatters;
    the time in which a joint leaves its range at the measured rate, if the arm drifts; the next
    step; the tolerance of the visits and the noise.
    """
    said = []
    if audit.verdict in (JUMPS, SCATTERS) and audit.found is not None:
        said.append(_order(audit.found.groups))
    if audit.leaves_range is not None:
        when, joint = audit.leaves_range
        more = _time_span(when)
        said.append(
            f"! at the mean rate of this log, {joint} leaves its range in another {more}; if the "
            "drift grows, a joint leaves it sooner"
        )
    said += _next_step(audit)
    worst = int(np.argmax(audit.visits.noise))
    noise, unit = _number(float(audit.visits.noise[worst])), unit_of([audit.task.revolute[worst]])
    most = f"at most {noise} {unit} there" if noise != "0" else "none found"
    same = metres(audit.visits.tolerance)
    said.append(f"poses count as the same within {same}; noise of the joints: {most}")
    return said


def _next_step(audit: Audit) -> list[str]:
    """Return a list of one text, the recommended next step; empty if the arm repeats."""
    task = audit.task
    robot = task.robot.name if task.robot.entry else task.robot.description.path.name
    kind = ["--task", str(task.kind)] if len(task.frames) == 1 else []
    if audit.verdict == REPEATS:
        return []
    if audit.drifts or audit.verdict in (JUMPS, SCATTERS):
        study = shlex.join(["repctl", "study", robot, "--frame", ",".join(task.frames), *kind])
        return [f"next: `{study}` compares with a repeatable controller"]
    if audit.returns < ENOUGH - 1:
        return [f"next: record at least {ENOUGH - 1} returns to this pose"]
    return ["next: record more returns to this pose, or log the joints with less noise"]


def _order(groups: NDArray[np.intp]) -> str:
    """Write a letter for the configuration of each visit, such as ABAB, and how many are equal.

    ``groups`` (N,) has the index of each visit's configuration. The text ends with the number of
    visits in the most frequent configuration.
    """
    names = "".join(chr(ord("A") + g) if g < _LETTERS else "…" for g in groups)
    more = "…" if len(names) > _SHOWN else ""
    sizes = np.bincount(groups)
    most = f"{sizes.max()} of {len(groups)} visits are within the noise of one another"
    return f"configurations in turn: {names[:_SHOWN]}{more}; {most}"


def write_audit(audit: Audit, folder: Path) -> list[Path]:
    """Write ``audit.html`` and ``audit.png`` atomically.

    Parameters
    ----------
    audit
        The audit; the hand must have returned to the pose.
    folder
        Output folder.

    Returns
    -------
    Paths of the two files, in this order.
    """
    contents: dict[str, str | bytes] = {
        "audit.html": _audit_page(audit),
        "audit.png": png(_audit_figure(audit)),
    }
    prepare_folder(folder)
    return [write_whole(folder / name, content) for name, content in contents.items()]


def _audit_page(audit: Audit) -> str:
    """Write the HTML page of the recorded motion, with the arm of the first visit as an outline.

    Each cycle is the part of the log between two consecutive visits of the pose. At most 240 cycles
    are shown, evenly spaced among all.
    """
    task, visits = audit.task, audit.visits
    ends = np.unique(np.linspace(1, audit.returns, min(audit.returns, _CYCLES)).astype(int))
    steps = _STEPS if len(ends) <= _STEPS else _STEPS // 2
    rows = [_between(audit, end, steps) for end in ends]
    q = np.vstack([rows[0][:1], *(cycle[1:] for cycle in rows)])
    mean = float(np.median(np.diff(visits.t)))
    t = np.linspace(0, mean * len(ends), len(q))
    drift = np.linalg.norm(visits.q[ends] - visits.q[0], axis=1)
    motion = JointMotion(task, t, q, np.gradient(q, t, axis=0), len(ends), steps)
    label = "Recorded motion"
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
    count = f", {len(ends)} of its {audit.returns} returns" if len(ends) < audit.returns else ""
    return playback_page(
        traced_chains(task, visits.q[0]),
        [track],
        name=f"{Path(audit.log.name).name}{count}",
        headline=_headline(audit),
        dialog=audit_dialog(audit, _ABOUT),
    )


def _between(audit: Audit, end: int, steps: int) -> Array:
    """Interpolate the log between visits ``end`` − 1 and ``end``: (steps + 1, n), at equal times.

    The page shows the motion between two visits as one cycle of ``steps`` steps. The first and last
    row of the result are the estimated configurations at the visits, which are more exact than rows
    of the log.
    """
    visits, log = audit.visits, audit.log
    t = np.linspace(visits.t[end - 1], visits.t[end], steps + 1)
    q = np.stack([np.interp(t, log.t, column) for column in log.q.T], axis=1)
    q[0], q[-1] = visits.q[end - 1], visits.q[end]
    return q


def _audit_figure(audit: Audit) -> Figure:
    """Draw ``audit.png``: drift of the most displaced link, and of up to four joints, over time.

    These joints have the fastest drift. Dots are the visits of the hand pose; the slopes of the
    lines are the estimated drift rates.
    """
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
    first.set_ylabel(f"{plain(_part_of(audit))} (cm)")
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
    """Draw the values at the visits as dots, and their trend as a line of the given slope.

    ``slope`` is per unit of ``time``. The line passes through the medians of time and values.
    """
    level = float(np.median(values - slope * time))
    ends = time[[0, -1]]
    ax.plot(time, values, marker, ms=3.5, color=colour, label=label)
    ax.plot(ends, level + slope * ends, color=colour, lw=1)
