"""Parts of a motion between two rests: lines and blends, the joints along them, and their times.

Joints along a line or blend of poses x(a), a from 0 to 1, are q = F(x(a)), with F the function of a
cell. They are fitted by piecewise polynomials, because timing requires three derivatives. The
parameter s of a part goes from 0 to approximately the length of its joint path, rad or m. Each line
or blend has a share of this range in proportion to the length of the tool's path along it. Letters:
P poses, K values of s, n joints.

``JointLimits`` are maximum joint speeds and accelerations (n,) and, if given, torques and jerks, as
numbers. ``Segment`` is a smooth part of a joint path between two stops, with its speed profile
ṡ(s). ``Line`` is a line between two poses, along which the tool moves. ``Blend`` is a transition
from one line of a motion to the next, without a stop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import factorial
from typing import TYPE_CHECKING

import numpy as np

from ...base.arguments import Array, read_only
from ...base.errors import InputError
from ...motion.limits import JointLimits
from ..timing.speed_profile import Segment, fastest_along, most_used
from .lines import Blend, Curve, Function, Line, blend_of, cell_line, tool_line, tool_of

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

_SAME = 1e-9
"""Distance between two poses, m or rad, below which they are equal."""

_STAGES = 48
"""Number of stages of the profile along a line, and along a blend."""

_CHECKED = np.linspace(0.0, 1.0, 33)
"""Points at which limits are checked between two stages, as fractions of the time."""

_ROUNDING = 2e-5
"""Part of the limits that is left free for what lies between the points that are checked."""

_NODES = (1 - np.cos(np.pi * np.arange(6) / 5)) / 2
"""Points of an interval, from 0 to 1, at which a polynomial of degree 5 is equal to F."""

_TO_POWERS = np.linalg.inv(np.vander(_NODES, increasing=True))
"""Matrix from the values at the nodes to the coefficients of the powers."""

_INTERVALS = (16, 32, 64, 128, 256)
"""Numbers of intervals that are tried in turn."""

_EXACT = 2e-13
"""Maximum difference between a polynomial and F, rad or m."""

_INSIDE = np.linspace(0.0, 1.0, 2001)
"""Points at which poses are tested to lie in the cell."""


@dataclass(frozen=True, eq=False)
@read_only
class Part:
    """Part of a motion between two rests: one line, or several lines with blends.

    Attributes
    ----------
    last : int
        Number of the pose at the end of the part, among all poses of the motion, from 0.
    curve : PPoly
        The joints q(s), a piecewise polynomial.
    grid : (K,) array
        Values of s at which the speed along the part is computed, and meets the limits.
    passed : (L,) array
        Values of s at the L poses of the part after its first; for a blended pose, at the middle of
        the blend.
    """

    last: int
    curve: PPoly
    grid: Array
    passed: Array

    def timed(self, limits: JointLimits) -> tuple[Segment, float]:
        """Compute the fastest motion along the part, from rest to rest, and its duration, s.

        The segment meets the limits at the values ``grid``. If it exceeds a limit in between, the
        returned duration is longer than the segment: the caller must slow the segment down to this
        duration.
        """
        found = fastest_along(self.curve, self.grid, limits)
        if limits.jerk is not None:
            from ..timing.jerk import with_jerk  # most motions have no such limit

            found = with_jerk(found, limits)
        steps = np.diff(found.t)[:, None] * _CHECKED * (1 - 1e-9)
        moved = found.derivatives((found.t[:-1, None] + steps).ravel())
        factor = most_used(limits, moved) * (1 + _ROUNDING)
        return found, float(found.t[-1] * factor)


def parts_of(
    F: Function, X: Array, names: Sequence[str], radius: float
) -> tuple[list[Line], list[Part]]:
    """Choose the lines between poses X (P, 4, 4), and join blended lines to parts.

    ``names`` are the names of the poses in error messages, ``radius`` is that of the blends, m. A
    part ends wherever the arm must rest. Return the P − 1 lines and the parts.
    """
    found = [
        _line_between(F, *ends, *called)
        for ends, called in zip(pairwise(X), pairwise(names), strict=True)
    ]
    lines = [line for line, _ in found]
    blends = [*(_blend(F, *both, radius) for both in pairwise(lines)), None]
    parts = []
    curves: list[PPoly] = []
    lengths: list[float] = []
    passed: list[float] = []
    begin = 0.0
    for k, ((line, curve), after) in enumerate(zip(found, blends, strict=True)):
        end = 1.0 if after is None else 1.0 - after[0].cut_in
        curves.append(_cut(curve, begin, end))
        lengths.append((end - begin) * line.length)
        if after is None:
            parts.append(_part(k + 1, curves, lengths, passed))
            curves, lengths, passed, begin = [], [], [], 0.0
            continue
        blend, curve = after
        passed.append(sum(lengths) + blend.length / 2)
        if curve is not None:
            curves.append(curve)
            lengths.append(blend.length)
        begin = blend.cut_out
    return lines, parts


def _part(last: int, curves: list[PPoly], lengths: list[float], passed: list[float]) -> Part:
    """Join consecutive curves q(a) into one part of the motion.

    ``last`` is the number of the pose at the end of the part. ``lengths`` are those of the tool's
    path along each curve, m. ``passed`` are the lengths from the start of the part, m, at which the
    arm passes a pose without a rest.
    """
    curve, s = _joined(curves, lengths)
    grid = [np.linspace(*ends, _STAGES + 1)[:-1] for ends in pairwise(s)]
    marks = np.append(passed, sum(lengths)) * (s[-1] / sum(lengths))
    return Part(last, curve, np.append(np.concatenate(grid), s[-1]), marks)


def _line_between(
    F: Function, start: Array, end: Array, first: str, second: str
) -> tuple[Line, PPoly]:
    """Choose the line between two poses (4, 4), and fit the joints q(a) along it; return both.

    The straight line of the tool is tried first, then the straight line in the cell's coordinates,
    which stays inside. If neither can be used, an InputError names the poses by ``first`` and
    ``second``.
    """
    ends = (end[None, :3, 3], end[None, :3, :3], start[None, :3, 3], start[None, :3, :3])
    if np.linalg.norm(F.cell.errors(*ends)) < _SAME:
        raise InputError(f"{second} is equal to {first}; remove one of them")
    for line in (tool_line(F.cell, start, end), cell_line(F, start, end)):
        curve = _joints_along(F, line.at)
        if curve is not None:
            return line, curve
    try:
        F.batch(line.at(np.linspace(0.0, 1.0, 101)))
        why = "F is not smooth between them"
    except InputError as error:
        why = str(error).partition(": ")[2]
    raise InputError(f"no motion from {first} to {second}: {why}; go through an intermediate pose")


def _blend(F: Function, into: Line, out: Line, radius: float) -> tuple[Blend, PPoly | None] | None:
    """Blend two lines at their corner, with arcs of ``radius``, m, and fit q(a) along the blend.

    Return the blend and the curve, or None if the arm must rest at the corner. If the second line
    continues the first without a bend, the blend has length 0, and the curve is None.
    """
    blend = blend_of(F, into, out, radius)
    if blend is None or not blend.length:
        return None if blend is None else (blend, None)
    curve = _joints_along(F, blend.at)
    return None if curve is None else (blend, curve)


def _joints_along(F: Function, at: Curve) -> PPoly | None:
    """Fit ``q(a) = F(x(a))``, a from 0 to 1, by piecewise polynomials to 2e-13 rad or m.

    ``at`` is the curve of poses x(a). Return None if the curve leaves the cell, or F does not exist
    or is not smooth along it; another line must then be tried.
    """
    from scipy.interpolate import PPoly  # slow to import

    X = at(_INSIDE) @ np.linalg.inv(tool_of(F))
    if not F.cell._contains(*F.cell.coordinates(X[:, :3, 3], X[:, :3, :3])).all():
        return None
    for count in _INTERVALS:
        a = (np.arange(count)[:, None] + _NODES[:-1]).ravel() / count
        a = np.append(a, 1.0)
        Q = F.batch(at(a), missing="nan")
        if np.isnan(Q).any():
            return None
        rows = 5 * np.arange(count)[:, None] + np.arange(6)
        begin = Q[rows[:, 0]]
        C = np.einsum("ij,Kjn->iKn", _TO_POWERS, Q[rows] - begin[:, None])
        C[0] = begin
        C *= float(count) ** np.arange(6)[:, None, None]
        curve = PPoly(C[::-1], np.arange(count + 1) / count)
        between = (a[1:] + a[:-1]) / 2
        off = np.abs(curve(between) - F.batch(at(between), missing="nan")).max()
        if off < _EXACT:
            return curve
    return None


def _cut(curve: PPoly, begin: float, end: float) -> PPoly:
    """Return the part of a curve from ``begin`` to ``end``; its parameter is not rescaled."""
    from scipy.interpolate import PPoly

    x = curve.x[(curve.x > begin) & (curve.x < end)]
    x = np.concatenate([[begin], x, [end]])
    C = [curve(x[:-1], k) / factorial(k) for k in range(len(curve.c))]
    return PPoly(np.array(C[::-1]), x)


def _joined(curves: Sequence[PPoly], lengths: Sequence[float]) -> tuple[PPoly, Array]:
    """Join C curves q(a) to one curve q(s); return it, and the values s (C + 1,) at their ends.

    ``lengths`` (C,) are those of the tool's path along the curves, m. s goes from 0 to the
    approximate length of the joint path, rad or m. Each curve has a share of this range in
    proportion to its length.
    """
    from scipy.interpolate import PPoly

    steps = np.concatenate([np.diff(curve.c[-1], axis=0) for curve in curves])
    scale = float(np.linalg.norm(steps, axis=1).sum()) / sum(lengths)
    s = np.concatenate([[0.0], np.cumsum(lengths)]) * scale
    C, x = [], []
    for curve, begin, end in zip(curves, s, s[1:], strict=False):
        stretch = (end - begin) / (curve.x[-1] - curve.x[0])
        C.append(curve.c / stretch ** np.arange(len(curve.c))[::-1, None, None])
        x.append(begin + stretch * (curve.x[:-1] - curve.x[0]))
    return PPoly(np.concatenate(C, axis=1), np.append(np.concatenate(x), s[-1])), s
