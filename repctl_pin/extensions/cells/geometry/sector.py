"""Sector of the workspace: a cell of poses in cylindrical coordinates around an axis.

The axis is by default the base's z axis. A sector suits an arm whose first joint turns the whole
arm: then a function need not be designed along the angle. The task coordinates of a pose are
radius, angle, height, two tilts and spin, or the first m of them, numbered from 0 (``RADIUS``) to 5
(``SPIN``). Offsets are their differences from those of the placement, m and rad. The placement is
the middle of the sector, except that a design may move the middle of the spin. A coordinate is
symmetric if a single joint moves the frame along it; it can be removed from the coordinates u (k,)
of a pose, which go from −1 to 1 between the sides of the sector. The range of angle or spin can be
``"all"``: it then ends only at the limits of that joint. The profile of a sector is its range of
radius as a function of the height η above the middle: its bend shifts the range, its stretch scales
it. A part of a sector is given by two corners, ``low`` and ``high`` (k,): its smallest and its
largest u_i. Letters: m task coordinates, K poses; p (K, 3), in metres, and R (K, 3, 3) are
positions and rotation matrices of the frame in base axes.

``Symmetry`` is a joint that changes only one coordinate of the frame: the indices of both, and the
sign, 1 or −1, of the change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ....base.arguments import Array, freeze, positive, read_only, unwritable, vector
from ....base.errors import InputError
from ....model.chain_formulas import Placement, axis_turns
from ....model.rotations import exp3
from ....model.task import Task
from .cell import EDGE, Cell
from .cell_arguments import (
    VERTICAL,
    Angle,
    as_axis,
    as_half_width,
    as_height,
    as_tilts,
    as_turn,
    no_joint,
    no_spin,
)
from .kinematics import left_jacobian
from .sector_profile import MOST_DEGREE, NARROWEST, STRAIGHT, Profile, as_profile
from .symmetry import NEAR, Symmetry, axis_symmetry, difference, difference_words, tool_symmetry

RADIUS, ANGLE, HEIGHT, SPIN = 0, 1, 2, 5
"""Indices of radius, angle, height and spin among the m task coordinates; 3 and 4 are the tilts."""

_ANGLES = [ANGLE, 3, 4, SPIN]
"""Coordinates that turn the frame."""

_Z = np.array([0.0, 0.0, 1.0])

_NEAR = 1e-6
"""Distance from the axis, m, at which the angle is no longer defined."""


@dataclass(frozen=True, eq=False, init=False)
@read_only
class Sector(Cell):
    r"""Cell of poses in cylindrical coordinates around an axis.

    It consists of all placements ``p = o + R_a(φ) (ρ e + z a)`` with
    ``R = R_a(φ) R_0 exp(\hat t) R_z(ψ)``.

    ρ, φ and z are the radius, angle and height of p around an axis with the unit direction a
    through the point o. R_a(φ) is the rotation by φ about a, e the unit vector from the axis to the
    middle, and R_0 the orientation of the middle. The vector t tilts about the tool's own x and y
    axes, and ψ turns about the tool's z axis. The orientation turns with φ. A coordinate of
    half-width 0 is held constant.

    An arm can have two symmetries, which are detected. If a joint j turns the whole arm about the
    axis, a function has ``F(R_a(φ) x) = F(x) ± φ e_j`` exactly, with e_j the unit vector of the
    joint. If the axis of a joint j is the tool's z axis through the frame's origin, ``F(x R_z(ψ)) =
    F(x) ± ψ e_j``. A function is then designed for φ = 0 or ψ = 0 only. A sector can also be used
    for an arm without symmetries.

    The smallest and the largest radius may depend on the height: see the argument ``radius``. The
    coordinate u of the radius is −1 on the inner and 1 on the outer side at every height, so the
    coordinates u still form a box.

    Parameters
    ----------
    task
        The task. A task in two coordinates requires an axis normal to its plane.
    placement
        Middle of the sector in the base frame, away from the axis: a rigid transform, a homogeneous
        matrix (4, 4), or a position (3,), m, with the orientation of the task's reference.
    radius : float or (list, list)
        Half-width, m; or two lists: coefficients, the constant first, of the smallest and of the
        largest radius, m, as polynomials of η / ``height``, with η the height above the placement.
        The placement is then moved along its radius to the middle between the two.
    height : float
        Half-width, m.
    angle : float or "all"
        Half-width of φ, rad. With ``"all"``, the design finds the largest range of φ that the joint
        limits allow, and its middle.
    half_angle : float or (2,) or (3,) array
        Half-widths of the tilts, rad: one number, or one per axis. A third number is a half-width
        of ψ, like ``spin``, but the symmetry of ψ is then not used; over a small range, this can
        give a lower cost.
    spin : float or "all"
        Half-width of ψ, rad, for a pose task. With ``"all"``, the design finds the largest range of
        ψ that the joint limits allow, and its middle.
    axis : (2, 3) array, optional
        A point on the axis, m, and the direction of the axis, in base coordinates. The default is
        the base's z axis. If a joint turns the whole arm about an axis that differs from the base's
        z axis by at most 2e-3 rad and m, as in a URDF in which π is rounded, the axis of this joint
        is the default. The summary then states the difference.

    Raises
    ------
    InputError
        If the placement is on the axis, the half-width of the radius reaches the axis, an angle
        covers more than a full turn, a half-width is given for a coordinate that the task does not
        command, or ``"all"`` is given for a coordinate without symmetry.

    Examples
    --------
    >>> sector = rp.Sector(task, task.placement(q0), radius=0.1, angle="all")
    >>> sector.k  # coordinates: radius and angle
    2
    >>> [symmetry.joint for symmetry in sector.symmetries]  # joints that turn the whole arm
    [0]
    """

    axis: Array
    """(2, 3): point on the axis, m, and its unit direction."""
    spin_middle: float
    """Middle of ψ, rad. A design moves it, and not the placement, where the tool tilts: the axes of
    the tilts would turn with the placement."""
    profile: Profile
    """Bend and stretch of the range of radius over the height; without effect in most sectors."""

    def __init__(
        self,
        task: Task,
        placement: Placement,
        *,
        radius: float | Sequence[ArrayLike],
        height: float = 0.0,
        angle: Angle = "all",
        half_angle: ArrayLike = 0.0,
        spin: Angle = 0.0,
        axis: ArrayLike | None = None,
    ) -> None:
        unit = Cell(task, placement, 1.0)  # checks the task and the placement
        line = as_axis(task, axis)
        height = as_height(task, height)
        shape = as_profile(radius, height)
        if shape is None:
            radius, profile = as_half_width(radius, "radius", "m"), STRAIGHT
        else:
            profile, rho, radius = shape
            freeze(unit, placement=_at_radius(unit.placement, line, rho))
        turns = as_tilts(task, half_angle)
        named = {ANGLE: ("angle", angle), SPIN: ("spin", spin)}
        round_about, about_tool = (as_turn(width, name) for name, width in named.values())
        symmetries = [axis_symmetry(task, line)]
        if task.kind == "pose" and not turns[2:].any():
            symmetries.append(tool_symmetry(task))
        elif about_tool:
            raise no_spin(task)
        found = [one for one in symmetries if one is not None]
        free = tuple(i for i, (_, width) in named.items() if isinstance(width, str))
        for i in free:
            if i not in [one.coordinate for one in found]:
                raise no_joint(task, named[i][0], line)
        spin_width = max([about_tool, *turns[2:]])
        every = [radius, round_about, height, *turns[:2], spin_width][: task.m]
        freeze(
            self,
            task=unit.task,
            placement=unit.placement,
            widths=np.array(every),
            axis=line,
            free=free,
            symmetries=tuple(one for one in found if every[one.coordinate]),
            removed=(),
            spin_middle=0.0,
            profile=profile,
        )
        self._require_apart()

    def _require_apart(self) -> None:
        """Raise an InputError if the sector reaches its axis, where the angle is not defined.

        The error is also raised if only symmetric coordinates have a half-width above 0, because a
        function over such a sector needs no design.
        """
        away, (radius, *_) = self.middle[0], self.widths
        if away < _NEAR:
            raise InputError(
                "a sector's placement lies on the axis, where the angle is not defined; "
                "move it away from the axis, or choose another axis"
            )
        if radius > away - _NEAR:
            raise InputError(
                f"of ±{radius:g} m reaches the axis, which is {away:.3g} m from the placement",
                argument="radius",
                remedy=f"keep it below {away:.3g}",
            )
        if self.profile.degree:
            least, _ = self.profile.lowest(away, radius, self.widths[HEIGHT])
            if least < _NEAR:
                raise InputError(
                    f"of {least:.3g} m at some height reaches the axis",
                    argument="radius",
                    remedy="keep the smallest radius above 0 at every height",
                )
        if not np.delete(self.widths, [one.coordinate for one in self.symmetries]).any():
            raise InputError("a sector needs a radius, height or half_angle above 0")

    # ---- in C
    # -------------------------------------------------------------------------------------------

    def _tables(self) -> tuple[dict[str, ArrayLike], dict[str, ArrayLike], dict[str, Any]]:
        """Return the members of the C struct :data:`CHART` that describe the sector, by name.

        The three dictionaries have, in this order, arrays of integers, arrays of floats, and single
        numbers.
        """
        ints, reals, scalars = super()._tables()
        (radius, height), basis = self.middle, self.directions
        ints["coordinate"] = self._removed
        ints["joint"] = [one.joint for one in self.removed]
        reals |= {
            "sign": [one.sign for one in self.removed],
            "origin": self.axis[0],
            "basis": basis,
            "turn": basis @ self.placement.rotation,
            "profile": np.concatenate(self.profile),
        }
        scalars |= {"sector": 1, "removed": len(self.removed), "bent": self.profile.degree}
        scalars |= {"radius": radius, "height": height, "spin": self.spin_middle}
        return ints, reals, scalars

    # ---- between placements and coordinates
    # -------------------------------------------------------

    @cached_property
    def middle(self) -> tuple[float, float]:
        """Radius and height of the middle, m; heights are measured along the axis from o."""
        away = self.placement.translation - self.axis[0]
        z = float(away @ self.axis[1])
        return float(np.linalg.norm(away - z * self.axis[1])), z

    @property
    def centre(self) -> Array:
        """Values (m,) of the task coordinates in the middle, m and rad; all angles are 0."""
        rho, z = self.middle
        return np.array([rho, 0.0, z, 0.0, 0.0, 0.0])[: self.task.m]

    @property
    def tilted(self) -> bool:
        """True if the tool tilts in the sector, about its own x or y axis."""
        return bool(self.widths[3:5].any())

    @cached_property
    def directions(self) -> Array:
        """Unit vectors at the middle, as rows (3, 3): outward, tangential, and along the axis."""
        a = self.axis[1]
        away = self.placement.translation - self.axis[0]
        outward = away - (away @ a) * a
        outward /= np.linalg.norm(outward)
        return unwritable(np.stack([outward, np.cross(a, outward), a]))

    def _placed(self, Y: Array) -> tuple[Array, Array]:
        """Convert offsets Y (K, m) to positions (K, 3), m, and rotation matrices (K, 3, 3)."""
        rho, z = self.middle
        y = _all_six(Y)
        outward, _, a = self.directions
        bend, stretch = self._profiled(y[:, HEIGHT])
        radius = (rho + bend + stretch * y[:, RADIUS])[:, None]
        height = z + y[:, HEIGHT, None]
        p = radius * outward + height * a
        if not y[:, _ANGLES].any():
            return self.axis[0] + p, np.tile(self.placement.rotation, (len(y), 1, 1))
        round_about = exp3(y[:, ANGLE, None] * a)
        p = np.einsum("Kab,Kb->Ka", round_about, p)
        R = round_about @ self.placement.rotation
        if self.task.kind.turns:
            R = R @ exp3(_tilt_vectors(y)) @ exp3(y[:, SPIN, None] * _Z)
        return self.axis[0] + p, R

    def _measured(self, p: Array, R: Array) -> Array:
        """Convert placements, p (K, 3), m, and R (K, 3, 3), to offsets (K, m), m and rad.

        The spin is at most half a turn from its middle.
        """
        rho, z = self.middle
        x, y, height = ((p - self.axis[0]) @ self.directions.T).T
        Y = np.zeros((len(p), 6))
        Y[:, HEIGHT], Y[:, ANGLE] = height - z, np.arctan2(y, x)
        bend, stretch = self._profiled(Y[:, HEIGHT])
        Y[:, RADIUS] = (np.hypot(x, y) - rho - bend) / stretch
        if self.task.kind.turns:
            back = exp3(-Y[:, ANGLE, None] * self.axis[1])
            turned = self.placement.rotation.T @ back @ R
            Y[:, 3:5] = axis_turns(np.broadcast_to(np.eye(3), turned.shape), turned)
            rest = exp3(-_tilt_vectors(Y)) @ turned
            spin = np.arctan2(rest[:, 1, 0], rest[:, 0, 0])
            turns = np.rint((spin - self.spin_middle) / (2 * np.pi))
            Y[:, SPIN] = spin - 2 * np.pi * turns
        return Y[:, : self.task.m]

    def _frame_twists(self, Y: Array) -> Array:
        """Evaluate the frame's velocity (v, ω) per m or rad of each task coordinate: (K, 6, m).

        Column i is the velocity at the poses with the offsets Y (K, m), in base axes, while only
        task coordinate i changes: rows 0 to 2 are v, rows 3 to 5 are ω.
        """
        y = _all_six(Y)
        T = np.zeros((len(y), 6, 6))
        radial, around, a = self.directions
        R, turning = self.placement.rotation, y[:, _ANGLES].any()
        if turning:
            round_about = exp3(y[:, ANGLE, None] * a)
            R, radial, around = (round_about @ each for each in (R, radial, around))
        eta, y_rho = y[:, HEIGHT], y[:, RADIUS, None]
        bend, stretch = (each[:, None] for each in self._profiled(eta))
        slopes = [each[:, None] for each in self.profile.slopes(eta, self._half_height)]
        T[:, :3, RADIUS] = stretch * radial
        T[:, :3, ANGLE] = (self.middle[0] + bend + stretch * y_rho) * around
        T[:, :3, HEIGHT] = a + (slopes[0] + slopes[1] * y_rho) * radial
        T[:, 3:, ANGLE] = a
        if self.task.kind.turns and not turning:
            T[:, 3:, 3:] = R
        elif self.task.kind.turns:
            t = _tilt_vectors(y)
            T[:, 3:, 3:5] = R @ left_jacobian(t)[:, :, :2]
            T[:, 3:, SPIN] = (R @ exp3(t))[:, :, 2]
        return T[:, :, : self.task.m]

    @property
    def _offset(self) -> Array:
        """Offset (m,) of the sector's middle from its placement, rad in the entry of the spin.

        The offset is 0, except that the spin has the offset :attr:`spin_middle` if a design moved
        the middle of the spin.
        """
        offset = np.zeros(self.task.m)
        if self.spin_middle and self._active[SPIN]:
            offset[SPIN] = self.spin_middle
        return offset

    def _profiled(self, eta: Array) -> tuple[Array, Array]:
        """Evaluate bend b, m, and stretch s at heights η (K,), m: two arrays (K,).

        η is the height above the middle of the sector. At each height, the bend shifts the range of
        radius, and the stretch scales it.
        """
        return self.profile.at(eta, self._half_height)

    @property
    def _half_height(self) -> float:
        """Half-width of the height, m, plus a tolerance for rounding; 0 without a height."""
        return float(self.widths[HEIGHT]) * (1 + EDGE) if self.task.m > 2 else 0.0

    def radii(self, z: ArrayLike) -> Array:
        """Return the smallest and the largest radius (…, 2), m, at heights z (…), m.

        Heights are measured along the sector's axis from its point ``axis[0]``.
        """
        rho, middle = self.middle
        bend, stretch = self._profiled(np.asarray(z, float) - middle)
        ends = self.widths[RADIUS] * np.array([-1.0, 1.0])
        return np.asarray(rho + bend[..., None] + stretch[..., None] * ends)

    def _values(self, Y: Array) -> Array:
        """Return the values (K, m) of the task coordinates at offsets Y (K, m), m and rad.

        A value is the offset plus the value in the middle, :attr:`centre`. With a profile, the
        radius is ρ_0 + b(η) + s(η) y: ρ_0 is the radius of the middle, b is the bend and s the
        stretch at the height η, and y is the offset of the radius.
        """
        values = super()._values(Y)
        bend, stretch = self._profiled(_all_six(Y)[:, HEIGHT])
        values[:, RADIUS] = self.middle[0] + bend + stretch * Y[:, RADIUS]
        return values

    def _widths_at(self, u: Array) -> Array:
        """Return the half-widths (k,), m and rad, at u (k,).

        The half-width of the radius depends on the height in u.
        """
        widths = super()._widths_at(u).copy()
        if RADIUS in self.moved:
            _, stretch = self._profiled(_all_six(self.spread(u[None]))[:, HEIGHT])
            widths[0] *= stretch[0]
        return widths

    def _middle_of(self, i: int) -> str:
        """Write `` at its height`` if u_i is the radius, and its middle depends on the height.

        Else the text is empty. Error messages append this text to "from the middle".
        """
        return " at its height" if self.profile.degree and self.moved[i] == RADIUS else ""

    # ---- other sectors
    # --------------------------------------------------------------------------------

    def without(self, symmetries: Sequence[Symmetry], free: Sequence[int] | None = None) -> Sector:
        """Return the sector with the coordinates of the given symmetries removed from u.

        No other coordinates are removed: a coordinate that this sector has removed is restored
        unless it is given again. ``free`` has the numbers of the coordinates whose range the new
        sector calls ``"all"``; by default, those of this sector.
        """
        free = self.free if free is None else tuple(free)
        return self._changed(removed=tuple(symmetries), free=free)

    @classmethod
    def around(cls, *_: object, **__: object) -> Sector:
        """Raise an InputError: a sector, unlike a :class:`Cell`, cannot be made around poses."""
        raise InputError(
            "a sector is not made around poses; give its placement, radius=, height= and angle=, "
            "or use rp.Cell.around"
        )

    def scaled(self, factor: float) -> Sector:
        """Return a sector with the same middle and the half-widths multiplied by a factor.

        Symmetric coordinates keep their half-widths. An InputError is raised if the inner and the
        outer radius of the new sector meet.
        """
        factors = np.full(len(self.widths), positive(factor, "the factor"))
        factors[[one.coordinate for one in self.symmetries]] = 1.0
        sector = self._changed(widths=self.widths * factors)
        sector._require_open()
        return sector

    def _profiled_by(self, coefficients: Array) -> Sector:
        """Return the sector with another profile.

        ``coefficients`` (2, D + 1), from a file, are those of the bend and of the stretch,
        polynomials of degree D in the height, see :class:`.Profile`. InputError is raised if they
        are invalid.
        """
        good = coefficients.ndim == 2 and len(coefficients) == 2 and self.widths[HEIGHT:3].any()
        good = good and coefficients.shape[1] <= MOST_DEGREE + 1
        if not (
            good
            and np.isfinite(coefficients).all()
            and coefficients[0, 0] == 0
            and coefficients[1, 0] == 1
        ):
            raise InputError(
                "the profile of the sector must be two rows of coefficients, the first beginning "
                "with 0 and the second with 1, and its height must be above 0; "
                "design the cell again"
            )
        sector = self._changed(profile=Profile(*coefficients))
        sector._require_open()
        return sector

    def _require_open(self) -> None:
        """Raise an InputError if inner and outer radius meet, or the inner reaches the axis."""
        if not self.profile.degree:
            return
        w = self.widths
        least, gap = self.profile.lowest(self.middle[0], w[RADIUS], w[HEIGHT])
        if not (least >= _NEAR and gap > NARROWEST):
            raise InputError(
                "the smallest and the largest radius of the sector meet, or reach the axis, within "
                f"its heights of ±{w[HEIGHT]:.3g} m; choose a smaller scale or height"
            )

    def _part(self, low: Array, high: Array) -> Sector:
        """Return the part of the sector with low ≤ u ≤ high, for two corners (k,).

        Tilts keep their middle, and so does the spin if the tool tilts. For these coordinates, the
        range from low_i to high_i is first narrowed to the largest interval −a ≤ u_i ≤ a in it.
        """
        middles, widths = self._middles_and_widths(low, high)
        p, R = self._placed(middles[None])
        eta = float(middles[HEIGHT]) if self.task.m > 2 else 0.0
        profile, factor = self.profile.moved(float(middles[RADIUS]), eta)
        widths[RADIUS] *= factor
        placement = pin.SE3(R[0].copy(), p[0])
        return self._changed(placement=placement, widths=widths, profile=profile)

    @property
    def _movable(self) -> Sequence[int]:
        """Indices, 0 to m − 1, of the task coordinates whose middle can change in a part.

        A part is what trimming leaves of the sector. Tilts are always cut on both sides alike, so
        their middle stays. If the tool tilts, the same holds for the spin.
        """
        return [RADIUS, ANGLE, HEIGHT] if self.tilted else [RADIUS, ANGLE, HEIGHT, SPIN]

    def turned(self, middles: Mapping[int, float], halves: Mapping[int, float]) -> Sector:
        """Return a sector whose middle is moved along symmetric coordinates.

        A design uses this method to centre the range of the angle or spin between the limits of the
        joint. ``middles`` has the offsets of the new middle, ``halves`` the new half-widths, rad,
        by number of the coordinate. An offset of the spin turns the placement. If the tool tilts,
        an offset of the spin changes :attr:`spin_middle`, the middle of the spin, instead, because
        the axes of the tilts would turn with the placement.
        """
        y, widths = np.zeros(self.task.m), self.widths.copy()
        for i, middle in middles.items():
            y[i], widths[i] = middle, halves[i]
        spin_middle = self.spin_middle
        if self.task.m > 5 and self.tilted:
            spin_middle, y[SPIN] = spin_middle + float(y[SPIN]), 0.0
        R = pin.exp3(y[ANGLE] * self.axis[1])
        spin = pin.exp3(np.array([0.0, 0.0, y[SPIN] if self.task.m > 5 else 0.0]))
        x = self.placement
        p = self.axis[0] + R @ (x.translation - self.axis[0])
        placement = pin.SE3(R @ x.rotation @ spin, p)
        return self._changed(placement=placement, widths=widths, spin_middle=spin_middle)

    # ---- words
    # -------------------------------------------------------------------------------------

    @property
    def coordinate_names(self) -> list[str]:
        """Name of each of the m task coordinates, also of those of width 0."""
        return ["radius", "angle", "height", "tilt about x", "tilt about y", "spin"][: self.task.m]

    @property
    def coordinate_units(self) -> list[str]:
        """Unit of each of the m task coordinates, m or rad."""
        return ["m", "rad", "m", "rad", "rad", "rad"][: self.task.m]

    def size(self) -> str:
        """Format the half-widths: ``radius ±0.17 m, height ±0.2 m, angle ±2.9 rad``."""
        w, parts = self.widths, [self._radius_words()]
        if self.task.m > 2:
            parts.append(f"height ±{w[HEIGHT]:.3g} m")
        parts.append(f"angle {self._range(ANGLE)}")
        if self.task.m > 3 and w[3:5].any():
            same = abs(w[3] - w[4]) < 1e-12
            tilt = f"±{w[3]:.3g}" if same else f"±({w[3]:.3g}, {w[4]:.3g})"
            parts.append(f"tilted by {tilt} rad")
        if self.task.m > 5 and w[SPIN]:
            parts.append(f"spin {self._range(SPIN)}")
        if not w[3:].any() and self.task.m > 3:
            parts.append("one orientation, which turns with the angle")
        return ", ".join(parts)

    def _radius_words(self) -> str:
        """Format the half-width of the radius: ``radius ±0.17 m``.

        If the range of radius depends on the height, the ranges at three heights are given.
        """
        if not self.profile.degree:
            return f"radius ±{self.widths[RADIUS]:.3g} m"
        z, half = self.middle[1], self.widths[HEIGHT]
        ranges = self.radii(z + half * np.array([-1.0, 0.0, 1.0]))
        words = [f"{low:.3g} to {high:.3g}" for low, high in ranges]
        return f"radius {', '.join(words)} m at the lowest, middle and highest height"

    def _range(self, i: int) -> str:
        """Format the range of coordinate i, an angle, by its half-width: ``±0.3 rad``.

        A range ``"all"`` with a half-width of π is written as ``as far as the joints go``.
        """
        if i in self.free and self.widths[i] == np.pi:
            return "as far as the joints go"
        return f"±{self.widths[i]:.3g} rad"

    def where(self, u: ArrayLike) -> str:
        """Format the pose at u (k,): ``(0.1, 0.2, 0.5) m, tilted by (0.3, 0) rad``."""
        x, u = self.at(u), vector(u, self.k, "u", "one per coordinate of the cell")
        text = f"({', '.join(f'{v:.3g}' for v in np.round(x.translation, 9) + 0.0)}) m"
        y = self.spread(u[None])[0]
        if y[3:5].any():
            text += f", tilted by ({', '.join(f'{v:.2g}' for v in y[3:5])}) rad"
        if y[SPIN:].any():
            text += f", spun by {y[SPIN]:.2g} rad"
        return text

    def symmetry(self) -> str:
        """Write which joint turns the arm or the tool, and how many coordinates remain.

        The text is ``not used`` if the symmetries are not used, and ``none`` if there are none.
        """
        names = self.task.joint_names
        words = {
            ANGLE: "{} turns the whole arm about the axis",
            SPIN: "{} turns the tool about its z axis",
        }
        off = difference_words(self.axis, VERTICAL)
        if off and max(difference(self.axis, VERTICAL)) <= NEAR:
            words[ANGLE] += f", which is {off} from the base's z axis"
        used = [words[one.coordinate].format(names[one.joint]) for one in self.removed]
        if not used:
            return "not used" if self.symmetries else "none"
        return f"{' and '.join(used)}: {self.k} of {self.whole.k} coordinates remain"

    def __repr__(self) -> str:
        middle = self.where(np.zeros(self.k))
        return f"<Sector {self.size()} around {middle}, {self.task.frame} {self.task.kind}>"


def _all_six(Y: Array) -> Array:
    """Append 0 to Y (K, m) for the coordinates that the task does not command: (K, 6)."""
    missing = 6 - Y.shape[1]
    return np.concatenate([Y, np.zeros((len(Y), missing))], axis=1) if missing else Y


def _tilt_vectors(y: Array) -> Array:
    """Return the rotation vectors (K, 3), rad, of the two tilts in the offsets y (K, 6)."""
    return y[:, 3:5] @ np.eye(2, 3)


def _at_radius(placement: pin.SE3, line: Array, rho: float) -> pin.SE3:
    """Move a placement to the radius ``rho``, m, from an axis; angle and height stay.

    The axis ``line`` (2, 3) is a point, m, and a unit direction. A placement on it is not moved.
    """
    origin, a = line
    away = placement.translation - origin
    outward = away - (away @ a) * a
    length = float(np.linalg.norm(outward))
    if length < _NEAR:
        return placement
    p = placement.translation + (rho / length - 1.0) * outward
    return pin.SE3(placement.rotation, p)
