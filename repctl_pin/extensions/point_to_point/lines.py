"""Lines between two poses of a cell: straight in space, or straight in the cell's coordinates.

A cell is a box of poses; its k coordinates u are from −1 to 1. A line is a curve of poses x(a),
with a from 0 to 1. A blend is a curve of continuous curvature between two lines that meet at a
pose, so that the arm need not stop there. A Curve is a function from K values of a, (K,), to poses
(K, 4, 4): homogeneous matrices, with positions in m, of the tool. The tool's place in the frame of
the cell is fixed.

``Blend`` is a transition from one line of a motion to the next, without a stop.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...base.arguments import Array, read_only
from ...model.chain_formulas import rotation_vectors
from ...model.rotations import exp3
from ...paths.bend import Bend
from ..cells.function import InverseFunction
from ..cells.geometry.cell import Cell
from ..cells.targets import homogeneous
from ..cells.tool_function import ToolFunction

Function = InverseFunction | ToolFunction
"""Function of a cell, or that of another tool."""

Curve = Callable[[Array], Array]
"""Function of a (K,) that returns poses: homogeneous matrices (K, 4, 4)."""

_PER_RADIAN = 0.1
"""Length, m, that 1 rad counts on a line along which the position is constant."""

_TURNS = 1e-3
"""A line on which the position moves less than this fraction of its rotation, at 0.1 m per rad, is
a rotation."""

_SAMPLES = np.linspace(0.0, 1.0, 65)
"""Points between which the length of a line is measured."""

_NEAR = 1e-4
"""Step of a over which the velocity at the end of a line is measured."""

_GENTLEST, _SHARPEST = 1e-3, np.pi - 1e-3
"""Range of the angle of a corner, rad, that can be blended."""

_LEAST_CUT = 1e-6
"""Minimum length that a blend replaces of a line, m."""

_STRAIGHT = 1e-9
"""Difference between the velocities of two lines, per metre, up to which they are one line."""


@dataclass(frozen=True, eq=False)
@read_only
class Line:
    """Line between two poses, along which the tool moves.

    Attributes
    ----------
    kind : str
        ``tool`` for a straight line of the tool, ``cell`` for a straight line in the cell's
        coordinates.
    at : Curve
        The poses x(a).
    length : float
        Length of the path of the position, m; for a rotation in place, 0.1 m per rad.
    turns : bool
        True if the line is a rotation, with a constant position.
    ends : (2, k) array or None
        Coordinates u of both ends if ``kind`` is ``cell``, else None.
    """

    kind: Literal["tool", "cell"]
    at: Curve
    length: float
    turns: bool
    ends: Array | None = None

    @classmethod
    def of(cls, kind: Literal["tool", "cell"], at: Curve, ends: Array | None = None) -> Line:
        """Create the line with the poses x(a) of the curve ``at``, and compute its length.

        ``kind`` and ``ends`` become the attributes of the line.
        """
        X = at(_SAMPLES)
        moved = float(np.linalg.norm(np.diff(X[:, :3, 3], axis=0), axis=1).sum())
        steps = np.linalg.norm(np.diff(X[:, :3, :3], axis=0), axis=(1, 2)) / np.sqrt(2)
        turned = _PER_RADIAN * float(steps.sum())
        turns = moved < _TURNS * turned
        return cls(kind, at, turned if turns else moved, turns, ends)

    def velocity(self, a: float) -> tuple[Array, Array]:
        """Evaluate the linear and the angular velocity, v and ω, (3,) each, at the end a = 0 or 1.

        Both are per metre of the line, in base axes: v in m per m, ω in rad per m. They are finite
        differences with the step 1e-4 in a. For a straight line of the tool, these are exact.
        """
        X = self.at(np.array([a - _NEAR, a] if a else [a, a + _NEAR]))
        v = X[1, :3, 3] - X[0, :3, 3]
        omega = rotation_vectors(X[1:, :3, :3] @ X[0, :3, :3].T)[0]
        return v / _NEAR / self.length, omega / _NEAR / self.length


def tool_line(cell: Cell, start: Array, end: Array) -> Line:
    """Create the straight line of the tool from a pose (p₀, R₀) to a pose (p₁, R₁), (4, 4) each.

    With a from 0 to 1, the position is ``p₀ + a (p₁ − p₀)``, and the rotation, which is about one
    axis, is ``exp(a ω̂) R₀``; ω is the rotation vector from R₀ to R₁, in base axes. Components that
    the task leaves free keep their values at the start. The line may leave the cell.
    """
    p, R = start[:3, 3], start[:3, :3]
    e = cell.errors(end[None, :3, 3], end[None, :3, :3], p[None], R[None])[0]
    rows = min(3, len(e))
    way, turn = np.zeros(3), np.zeros(3)
    way[cell.task.rows[:rows]] = e[:rows]
    if len(e) == 6:
        turn = e[3:]
    elif len(e) == 5:  # the tilt of the tool's axis, in axes of the tool
        turn = R[:, :2] @ e[3:]

    def at(a: Array) -> Array:
        return homogeneous(p + a[:, None] * way, exp3(a[:, None] * turn) @ R)

    return Line.of("tool", at)


def cell_line(F: Function, start: Array, end: Array) -> Line:
    """Create the line between two poses (4, 4) that is straight in the cell's coordinates u.

    A cell is a box in u, hence convex, so the whole line lies in the cell, where the function F
    exists. Such a line is used if the straight line of the tool leaves the cell.
    """
    X = np.stack([start, end]) @ np.linalg.inv(tool_of(F))
    U, _ = F.cell.coordinates(X[:, :3, 3], X[:, :3, :3])
    return Line.of("cell", lambda a: _placed(F, _between(U, a)), U)


def _between(U: Array, a: Array) -> Array:
    """Interpolate linearly between two points U (2, k) of cell coordinates, at a (K,): (K, k)."""
    return np.asarray((1 - a)[:, None] * U[0] + a[:, None] * U[1])


def _placed(F: Function, U: Array) -> Array:
    """Convert cell coordinates U (K, k) to poses (K, 4, 4) of the tool.

    F is the function of the cell, for its frame or for a tool on this frame.
    """
    return homogeneous(*F.cell.placements(U)) @ tool_of(F)


def tool_of(F: Function) -> Array:
    """Return the placement (4, 4) of the tool in the cell's frame; the identity without a tool."""
    return F.tool.homogeneous if isinstance(F, ToolFunction) else np.eye(4)


@dataclass(frozen=True, eq=False)
@read_only
class Blend:
    """Curve that leaves one line before a pose and joins the next line after it.

    The lines (p_in, R_in) and (p_out, R_out) meet at the pose (p₁, R₁). The blend is ``p = p_in(1 −
    α c_in) − p₁ + p_out(β c_out)``, ``R = R_in(1 − α c_in) R₁ᵀ R_out(β c_out)``. From a = 0 to 1,
    α(a) falls from 1 to 0 and β(a) rises from 0 to 1, see :meth:`.Bend.shares`. Between two lines
    in the cell's coordinates, the blend is ``u = u_in(1 − α c_in) − u₁ + u_out(β c_out)``.

    Attributes
    ----------
    at : Curve
        The poses x(a) of the blend.
    length : float
        Length of the path of the position, m.
    cut_in, cut_out : float
        Fractions c_in and c_out of the two lines that the blend replaces.
    """

    at: Curve
    length: float
    cut_in: float
    cut_out: float


def _angle(into: Line, out: Line) -> float | None:
    """Compute the angle, rad, between the directions v of two lines at their common pose.

    Return None if there is no bend: the lines have equal v and ω there. v and ω are the linear and
    the angular velocity, per metre of a line.
    """
    v_in, v_out = into.velocity(1.0), out.velocity(0.0)
    if np.abs(np.subtract(v_in, v_out)).max() < _STRAIGHT:
        return None
    d_in, d_out = (v / np.linalg.norm(v) for v, _ in (v_in, v_out))
    return float(2 * np.arctan2(np.linalg.norm(d_out - d_in), np.linalg.norm(d_out + d_in)))


def blend_of(F: Function, into: Line, out: Line, radius: float) -> Blend | None:
    """Blend two lines that meet at a pose; return None if the arm must rest there.

    F is the function of the cell. If both lines are straight in the cell's coordinates u, the blend
    is made in u. It begins and ends where an arc of the given radius, m, would begin and end. If
    the second line continues the first without a bend, the blend has length 0. The arm must rest if
    a line is a rotation in place; if the direction changes by less than 0.001 rad, or is reversed;
    if the blend would replace more than half of a line, or less than 1e-6 m; or if the radius is 0.
    """
    if into.turns or out.turns or not radius:
        return None
    phi = _angle(into, out)
    if phi is None:
        return Blend(into.at, 0.0, 0.0, 0.0)
    if not _GENTLEST < phi < _SHARPEST:
        return None
    bend, cut = Bend.of(phi), radius * np.tan(phi / 2)
    cut_in, cut_out = cut / into.length, cut / out.length
    if cut < _LEAST_CUT or max(cut_in, cut_out) > 0.5:
        return None
    u_in, u_out, x_1 = into.ends, out.ends, into.at(np.ones(1))[0]

    def at(a: Array) -> Array:
        alpha, beta = bend.shares(a)
        before, after = 1 - alpha * cut_in, beta * cut_out
        if u_in is not None and u_out is not None:
            u = _between(u_in, before) - u_in[1] + _between(u_out, after)
            return _placed(F, u)
        X, Y = into.at(before), out.at(after)
        R = X[:, :3, :3] @ x_1[:3, :3].T @ Y[:, :3, :3]
        return homogeneous(X[:, :3, 3] - x_1[:3, 3] + Y[:, :3, 3], R)

    return Blend(at, bend.length(cut), cut_in, cut_out)
