"""Figure of the drift: how far an arm is from its start after each cycle.

A figure shows several motions from one start; ``motions`` lists a label, the motion and a colour
for each. The joint drift is the distance of the joints from the start after a cycle, and the
displacement that of the part of the arm that is farthest from where it started.

``_Curve`` is the line of one motion in a figure: its values per cycle, its name and its colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

from ...motion import Motion
from ...motion.body_displacement import cycle_displacements
from ...motion.joint_motion import violations_of
from ..palette import readable
from ..text.numbers import displacement, number
from .figure_layout import arrange, plain, quiet
from .motions import BEYOND, motions_on_one_scale


class _Curve(NamedTuple):
    """Line of one motion in a figure, with its name and colour.

    ``values`` (cycles,) holds a value after each cycle, in the unit of the axis, and ``words`` the
    last value with its unit, for the label at the line's end.
    """

    label: str
    motion: Motion
    colour: str
    values: NDArray[np.float64]
    words: str


def _drifts(motions: Sequence[tuple[str, Motion, str]]) -> list[_Curve]:
    """Make the curves of the joint drift, rad or m, one for each motion.

    A drift of 0 is replaced by 1e-17, because a log scale has no 0.
    """
    curves = []
    for label, motion, colour in motions:
        last = number(float(motion.drift[-1]))
        words = f"{last} {motion.task.unit}"
        if motion.closes:
            words = f"0\n({last}, the integrator's error)"
        drift = np.maximum(motion.drift, _LEAST)
        curves.append(_Curve(label, motion, colour, drift, words))
    return curves


def _displacements(motions: Sequence[tuple[str, Motion, str]]) -> list[_Curve]:
    """Make the curves of the displacement, cm, of the part that is farthest from its start.

    A displacement in space is easier to imagine than a norm over the joints.
    """
    curves = []
    for label, motion, colour in motions:
        off = cycle_displacements(motion)
        words = displacement(float(off[-1]))
        curves.append(_Curve(label, motion, colour, 100 * off, words))
    return curves


def drift_over_cycles(ax: Axes, motions: Sequence[tuple[str, Motion, str]]) -> Axes:
    """Draw the joint drift after each cycle, with name and last value at the end of each line.

    A cross marks the cycle in which a joint first exceeds its limits, or two bodies first collide.

    Parameters
    ----------
    ax
        Axes to draw on.
    motions
        Label, motion and colour of each.
    """
    _linear(ax, _drifts(motions))
    ax.set_ylabel(f"joint drift ‖q − q₀‖ ({motions[0][1].task.unit})")
    return ax


def _linear(ax: Axes, curves: Sequence[_Curve]) -> None:
    """Draw curves on a linear scale from 0, with name and last value at the end of each line.

    The axis is cut off if one large drift would flatten the other curves.
    """
    _drift_lines(ax, curves)
    ax.set_ylim(0, _top(curves) or ax.get_ylim()[1])
    ax.set_xlim(0.6, curves[0].motion.cycles + 0.3)
    _end_labels(ax, curves)
    ax.set_xlabel("cycle")
    quiet(ax, whole=True)


def _drift_lines(ax: Axes, curves: Sequence[_Curve], size: float = 4.0) -> None:
    """Draw the values of curves after each cycle, and crosses at the first violations.

    A violation is an exceeded joint limit or a collision. ``size`` is the size of the markers,
    points.
    """
    for curve, marker in zip(curves, "osD^vPX" * len(curves), strict=False):
        motion, values = curve.motion, curve.values
        ax.plot(
            np.arange(1, motion.cycles + 1),
            values,
            marker=marker,
            ms=size,
            lw=0.4 * size,
            color=curve.colour,
            label=curve.label,
            clip_on=False,  # a zero lies on the axis
        )
        for beyond in violations_of(motion):
            cross = BEYOND | {"ms": 2.25 * size}
            ax.plot(beyond.cycle, values[beyond.cycle - 1], **cross)


_LEAST = 1e-17
"""Drift that is drawn in place of 0 on a log scale."""


def _top(curves: Sequence[_Curve]) -> float | None:
    """Choose the upper end of a linear axis, in its unit, so that small drifts remain visible.

    Curves that :func:`.motions_on_one_scale` leaves out may end above the axis: they jump in cycle
    1, far above all others, and then stay. The result is None if there are no such curves.
    """
    kept = {label for label, _, _ in motions_on_one_scale([curve[:3] for curve in curves])}
    if len(kept) == len(curves):
        return None
    return 1.2 * max(float(c.values.max()) for c in curves if c.label in kept)


def _end_labels(ax: Axes, curves: Sequence[_Curve]) -> None:
    """Write each motion's name, last value and first violations at the end of its line.

    Labels that would overlap are shifted, and joined to their lines.
    """
    high = ax.get_ylim()[1]
    to_axes = ax.transData + ax.transAxes.inverted()
    order = sorted(curves, key=lambda one: float(one.values[-1]))
    words = [_end_words(curve, high) for curve in order]
    ends = [float(curve.values[-1]) for curve in order]
    at_ends = [min(float(to_axes.transform((1.0, end))[1]), 1.0) for end in ends]
    places = _apart(at_ends, [_LINE * (text.count("\n") + 1) for text in words])
    for curve, text, end, y, place in zip(order, words, ends, at_ends, places, strict=True):
        line = {"arrowstyle": "-", "color": curve.colour, "lw": 0.8, "relpos": (0, 0.5)}
        ax.annotate(
            text,
            xy=(curve.motion.cycles, min(end, high)),
            xytext=(1.03, place),
            textcoords="axes fraction",
            color=readable(curve.colour),
            fontsize=9,
            va="center",
            annotation_clip=False,
            arrowprops=line if abs(place - y) > 0.3 * _LINE else None,
        )


_LINE = 0.058
"""Height of one line of a label's text, as a fraction of the axes."""


def _end_words(curve: _Curve, high: float) -> str:
    """Make the label at the end of a line: name, last value and first violations.

    ``high`` is the upper end of the axis; an arrow says that the line ends above it.
    """
    above = " ↑" if curve.values[-1] > high else ""
    beyond = "".join(
        f"\n× {'limit' if len(it.names) == 1 else 'collision'} in cycle {it.cycle}"
        for it in violations_of(curve.motion)
    )
    return f"{curve.label}: {curve.words}{above}{beyond}"


def _apart(rising: Sequence[float], heights: Sequence[float]) -> list[float]:
    """Shift labels vertically so that none covers another; return the positions of their centres.

    ``rising`` has the positions at which the lines end, in increasing order, and ``heights`` the
    heights of the texts, all as fractions of the axes' height.
    """
    places = []
    floor = -np.inf
    for own, height in zip(rising, heights, strict=True):
        places.append(max(own, floor + height / 2))
        floor = places[-1] + height / 2
    ceiling = 1.0 + heights[-1] / 2
    for k in reversed(range(len(places))):
        places[k] = min(places[k], ceiling - heights[k] / 2)
        ceiling = places[k] - heights[k] / 2
    return places


def drift_figure(motions: Sequence[tuple[str, Motion, str]], title: str) -> Figure:
    """Draw the figure ``drift.png``: displacement of the arm after each cycle, cm.

    The displacement is that of the most displaced part of the arm. The joint drift, a norm over the
    joints, is an inset on a log scale. ``motions`` lists the label, motion and colour of each
    controller.
    """
    figure = Figure(figsize=(8.6, 4.4))
    ax, curves = figure.add_subplot(), _displacements(motions)
    _linear(ax, curves)
    ax.set_ylabel("farthest part from its start (cm)")
    ax.set_title(plain(title), fontsize=10, loc="left", y=1.0)
    arrange(figure, np.array([[ax]]), top=0.24 if title else 0.1, bottom=0.47)
    corner = _free_corner(ax, curves)
    if corner is not None:
        inset = ax.inset_axes((*corner, *_INSET))
        _drift_lines(inset, _drifts(motions), 2.5)
        inset.set_yscale("log")
        unit = motions[0][1].task.unit
        inset.set_title(f"joint drift ({unit}), log scale", fontsize=8, loc="left", y=1.0)
        inset.tick_params(labelsize=7)
        inset.yaxis.set_major_locator(LogLocator(numticks=5))
        inset.yaxis.set_major_formatter(FuncFormatter(_power_of_ten))
        inset.yaxis.set_minor_locator(NullLocator())
        inset.locator_params("x", nbins=5, integer=True)
        quiet(inset).grid(visible=False)
    return figure


_INSET = (0.38, 0.3)
"""Width and height of the inset, as fractions of the axes."""


def _free_corner(ax: Axes, curves: Sequence[_Curve]) -> tuple[float, float] | None:
    """Find a place for the inset in the figure of the drift where it covers no line.

    The highest free place on the left is chosen or, if there is none, the highest on the right.
    Returns the inset's lower left corner, as fractions of the axes; None, for no inset, if there is
    no such place.
    """
    to_axes = ax.transData + ax.transAxes.inverted()
    shares = np.linspace(0, 1, 101)
    lines = [
        to_axes.transform(np.c_[1 : len(curve.values) + 1, curve.values]).T for curve in curves
    ]
    for left in (0.1, 0.6):
        near = (shares > left - 0.08) & (shares < left + _INSET[0])
        y = np.concatenate([np.interp(shares[near], *line) for line in lines])
        for low in np.arange(0.6, 0.14, -0.04):
            if not ((y > low - 0.08) & (y < low + _INSET[1] + 0.12)).any():
                return left, float(low)
    return None


_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def _power_of_ten(value: float, _: object = None) -> str:
    """Format a power of ten as ``10⁻³``, the label of a tick of a log scale.

    The label is plain text, because matplotlib's parser of formulas is slow.
    """
    return "10" + str(round(np.log10(value))).translate(_SUPERSCRIPTS)
