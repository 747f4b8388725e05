"""Cell of the workspace: a box of positions, and a box of rotations around one orientation.

The task coordinates of a pose are its position, in metres, and its rotation, in rad; their number
is m. The offsets of a pose are the differences of its task coordinates from those of the cell's
placement, which is the middle of the cell. (In some sectors, the middle of the spin differs from
the placement.) The coordinates u (k,) of a pose are its differences from the middle, divided by the
half-widths: from −1 to 1 in the cell. A task coordinate does not belong to u if its half-width is
0, or if a symmetry of the arm removes it: then a single joint moves the frame along it, and a
function q = F(x) over the cell, which gives one configuration for each pose, is designed without
it. The number of removed coordinates is l. A chart consists of polynomials of u, of which q_ref
approximates F. A sector is a cell in cylindrical coordinates, among them the angle about its axis
and the spin about the axis of the tool.

Letters: n joints, p (K, 3), m, and R (K, 3, 3) are positions and rotation matrices of the frame at
K poses, in base axes. Q (K, n) are configurations, U (K, k) coordinates u, Y (K, m) offsets. A part
of a cell is given by two corners, ``low`` and ``high`` (k,): its smallest and its largest u_i.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ....base.arguments import (
    MOST_NODES,
    Array,
    as_configurations,
    as_int,
    as_matrices,
    freeze,
    positive,
    read_only,
    unwritable,
    vector,
)
from ....base.errors import InputError
from ....model.chain_formulas import (
    Placement,
    as_placement,
    as_placements,
    axis_turns,
    rotation_vectors,
)
from ....model.native_kinematics import placed
from ....model.rotations import exp3
from ....model.several_frames import one_frame
from ....model.task import Task, require_task
from ....native import CHART, REGION, filled_struct, point
from ....regions.sobol import scrambled_points
from .cell_arguments import LEAST_WIDTH, as_middle, of_positions, sizes, stacked
from .kinematics import left_jacobian
from .symmetry import Symmetry

EDGE = 1e-9
"""Tolerance of ``|u_i| ≤ 1``."""

TURNED = 1e-6
"""Tolerance, m or rad, along a coordinate of width 0."""

C = TypeVar("C", bound="Cell")


@dataclass(frozen=True, eq=False, init=False)
@read_only
class Cell:
    r"""Box of poses: positions and rotations on either side of a middle.

    It consists of all placements ``p = p_0 + w ∘ u``, ``R = exp(\hat ω) R_0`` with ``ω = θ ∘ u``
    and every ``|u_i| ≤ 1``.

    p has only the components that the task commands. ω is a rotation vector: in base axes for a
    pose task, about the tool's own x and y axes for an axis task. Other tasks leave the rotation
    free. A coordinate of half-width 0 is held constant and is not part of u.

    Parameters
    ----------
    task
        The task.
    placement
        Middle of the cell, in the base frame: a rigid transform, a homogeneous matrix (4, 4), or a
        position (3,), m, with the orientation of the task's reference.
    half_width : float or (P,) array
        w, m: one number, or one for each of the P positions that the task commands, in base axes.
    half_angle : float or (3,) or (2,) array
        θ, rad: one number, or one per axis (two axes in an axis task); with 0 the cell has one
        orientation. With one number, every rotation by an angle up to θ is inside, and some by
        larger angles, because each component of ω is bounded separately.

    Attributes
    ----------
    k : int
        Number of coordinates u.
    widths : (m,) array
        Half-widths (w, θ) of all m task coordinates, m and rad; 0 for those held constant.

    Raises
    ------
    InputError
        If a half-width is not valid, all half-widths are 0, or the rotations reach half a turn.

    Examples
    --------
    >>> cell = rp.Cell(task, task.placement(q0), 0.1)  # m to either side
    >>> cell.k  # coordinates
    2
    >>> cell.at([1.0, -1.0]).translation - task.placement(q0).translation  # a corner, m
    array([ 0.1, -0.1,  0. ])
    """

    task: Task
    placement: pin.SE3
    widths: Array
    free: tuple[int, ...]
    """Indices of the coordinates with the range ``"all"``, which the joint limits determine."""
    symmetries: tuple[Symmetry, ...]
    """Symmetries of the arm along coordinates whose half-width is not 0; none in a box."""
    removed: tuple[Symmetry, ...]
    """Symmetries that a design uses: their coordinates do not belong to u, and are 0."""

    def __init__(
        self, task: Task, placement: Placement, half_width: ArrayLike, half_angle: ArrayLike = 0.0
    ) -> None:
        one_frame(require_task(task), "a cell")
        positions = min(3, task.m)
        turns = task.m - positions
        w = of_positions(task, half_width, "half_width")
        theta = sizes(half_angle, turns or 1, "half_angle", "rad", "one per axis")
        if not turns and theta.any():
            raise InputError(
                f": a {task.kind} task leaves the rotation free",
                argument="half_angle",
                remedy="omit it",
            )
        if np.linalg.norm(theta) >= 0.95 * np.pi:
            raise InputError(
                f"half_angle has the norm {np.linalg.norm(theta):.3g} rad over its axes, so the "
                "cell's corners reach half a turn, where two rotation vectors describe one pose; "
                "keep the norm below 2.98 rad"
            )
        widths = np.concatenate([w, theta[:turns]])
        if not widths.any():
            raise InputError("a cell needs at least one half_width or half_angle above 0")
        middle = as_middle(task, placement)
        freeze(self, task=task, placement=middle, widths=widths)
        freeze(self, free=(), symmetries=(), removed=())

    @classmethod
    def around(
        cls,
        task: Task,
        poses: Sequence[Placement] | object,
        margin: ArrayLike = 0.02,
        half_angle: ArrayLike = 0.0,
    ) -> Cell:
        """Make the smallest cell around poses or a closed path, and enlarge it by a margin.

        The sides of the cell are along the base axes. The orientation of the cell is in the middle
        of the orientations of the poses.

        Parameters
        ----------
        task
            The task.
        poses
            Placements, or a closed path such as ``rp.circle(task, q0)``.
        margin
            Addition to the half-widths, m: one number, or one per position that the task commands.
        half_angle
            Addition to the half-widths of the rotations, rad: one number, or one per axis.
        """
        one_frame(require_task(task), "a cell")
        if hasattr(poses, "placement"):
            poses = [poses.placement(s) for s in np.linspace(0, 1, 2001)]
        what = "a list of placements, or a closed path"
        listed = as_placements(poses, "placement", what)
        if not listed:
            raise InputError(f"placements must be {what}, not an empty list")
        p, R = stacked(task, listed, "placement")
        middle = pin.SE3(R[0], (p.max(axis=0) + p.min(axis=0)) / 2)
        positions, turns = min(3, task.m), task.m - min(3, task.m)
        unit = cls(task, middle, 1.0)
        if turns:  # again, with the orientation in the middle of all of them
            y = unit._measured(p, R)[:, positions:]
            mean = unit.vectors((y.max(axis=0) + y.min(axis=0))[None] / 2)
            turned = exp3(mean)[0] @ middle.rotation
            unit = cls(task, pin.SE3(turned, middle.translation), 1.0)
        reach = np.abs(unit._measured(p, R)).max(axis=0)
        reach[reach < LEAST_WIDTH] = 0.0
        if turns:
            more = sizes(half_angle, turns, "half_angle", "rad", "one per axis")
            half_angle = reach[positions:] + more
        half_width = reach[:positions] + of_positions(task, margin, "margin")
        return cls(task, unit.placement, half_width, half_angle)

    @property
    def k(self) -> int:
        """Number of coordinates u."""
        return int(np.count_nonzero(self._active))

    @property
    def half_width(self) -> Array:
        """Half-widths w, m: one per position that the task commands."""
        return self.widths[: min(3, self.task.m)]

    @property
    def rotation(self) -> Array:
        """Half-angles θ, rad, one per axis; an empty array if the task leaves the rotation free."""
        return self.widths[min(3, self.task.m) :]

    def scaled(self, factor: float) -> Cell:
        """Return a cell with the same middle and all half-widths multiplied by a factor."""
        factor = positive(factor, "the factor")
        turn = self.rotation * factor if len(self.rotation) else 0.0
        return Cell(self.task, self.placement, self.half_width * factor, turn)

    def _part(self, low: Array, high: Array) -> Cell:
        """Return the part of the cell with low ≤ u ≤ high, for two corners (k,).

        Rotations keep their middle: their range is first narrowed to the largest interval
        −a ≤ u_i ≤ a inside it.
        """
        middles, widths = self._middles_and_widths(low, high)
        p, _ = self._placed(middles[None])
        return self._changed(placement=pin.SE3(self.placement.rotation, p[0]), widths=widths)

    @property
    def _movable(self) -> Sequence[int]:
        """Indices, 0 to m − 1, of the task coordinates whose middle can change in a part.

        A part is what trimming leaves of the cell. These coordinates are the positions, which may
        be cut on one side only. Rotations are cut on both sides alike, because their middle is the
        cell's orientation.
        """
        return range(len(self.half_width))

    def _kept_middles(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Narrow a part of the cell until only :attr:`_movable` coordinates have another middle.

        ``low`` and ``high`` (k,) are the corners of the part; return the new corners. The ranges of
        the :attr:`_movable` coordinates are unchanged. The range of any other coordinate becomes
        the largest interval [−a, a] inside it, so that its middle is the middle of the whole cell.
        """
        half = np.minimum(-low, high)
        fixed = ~np.isin(self.moved, self._movable)
        return np.where(fixed, -half, low), np.where(fixed, half, high)

    def _middles_and_widths(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Compute the offset (m,) of the middle, and the half-widths (m,), of a part, m and rad.

        The part is between the corners low and high (k,), and the offset is relative to the middle
        of the cell. For coordinates that are not :attr:`_movable`, such as tilts, the range of the
        part is first narrowed until it is symmetric, so the offset is 0.
        """
        low, high = self._kept_middles(low, high)
        middles, widths = np.zeros(len(self.widths)), self.widths.copy()
        middles[self.moved] = self.widths[self.moved] * (high + low) / 2
        widths[self.moved] *= (high - low) / 2
        return middles, widths

    @property
    def centre(self) -> Array:
        """Values (m,) of all task coordinates at the cell's middle, m and rad; rotations are 0."""
        centre = np.zeros(len(self.widths))
        positions = len(self.half_width)
        centre[:positions] = self.placement.translation[self.task.rows[:positions]]
        return centre

    # ---- between placements and coordinates
    # -------------------------------------------------------

    def placements(self, U: ArrayLike) -> tuple[Array, Array]:
        """Convert coordinates U (K, k) to positions (K, 3), m, and rotation matrices (K, 3, 3)."""
        return self._placed(self.spread(U))

    def _placed(self, Y: Array) -> tuple[Array, Array]:
        """Convert offsets Y (K, m) to positions (K, 3), m, and rotation matrices (K, 3, 3)."""
        positions = len(self.half_width)
        moved = np.eye(3)[self.task.rows[:positions]]
        p = self.placement.translation + Y[:, :positions] @ moved
        R_0 = self.placement.rotation
        if not self.rotation.any():
            return p, np.broadcast_to(R_0, (len(Y), 3, 3))
        R = exp3(self.vectors(Y[:, positions:]))
        return p, (R.reshape(-1, 3) @ R_0).reshape(-1, 3, 3)

    def at(self, u: ArrayLike) -> pin.SE3:
        """Convert coordinates u (k,) to a placement: u = 0 is the middle, u_i = ±1 a side."""
        p, R = self.placements(vector(u, self.k, "u", "one per coordinate of the cell")[None])
        return pin.SE3(R[0].copy(), p[0])

    def coordinates(self, p: ArrayLike, R: ArrayLike) -> tuple[Array, Array]:
        """Convert placements to coordinates u, and to deviations from the cell.

        Parameters
        ----------
        p, R : (K, 3) and (K, 3, 3) arrays
            Positions, m, and rotation matrices.

        Returns
        -------
        U : (K, k) array
            Coordinates u: 0 in the middle, from −1 to 1 in the cell, |u_i| > 1 outside.
        off : (K,) array
            Largest absolute deviation along a coordinate of width 0, which the cell holds constant,
            m or rad; 0 in the cell.
        """
        p, R = as_matrices(("p", p, "K 3"), ("R", R, "K 3 3"), exact=True, finite=False)
        Y = self._measured(p, R)
        off = np.abs(Y[:, self.widths == 0]).max(axis=1, initial=0.0)
        return (Y - self._offset)[:, self._active] / self._active_widths, off

    def coordinates_of(self, target: Placement) -> Array:
        """Convert one placement, which must lie in the cell, to coordinates u (k,), from −1 to 1.

        Raises
        ------
        InputError
            If the placement lies outside; the message names the coordinate and its value.
        """
        target = as_placement(target)
        return self.inside(*self.coordinates(*stacked(self.task, [target], "target")))[0]

    def _contains(self, U: Array, off: Array) -> NDArray[np.bool_]:
        """Test which of K placements lie in the cell: (K,).

        U (K, k) are the coordinates of the placements: |u_i| ≤ 1 in the cell. off (K,) are their
        deviations along coordinates of width 0, m or rad.
        """
        within: NDArray[np.bool_] = np.all(np.abs(U) <= self._bounds + EDGE, axis=1)
        return within & (off <= TURNED)

    def inside(self, U: ArrayLike, off: ArrayLike) -> Array:
        """Return the coordinates U if all placements lie in the cell; else raise an InputError.

        U (K, k) are the coordinates of the placements: |u_i| ≤ 1 in the cell. off (K,) are their
        deviations along coordinates of width 0, m or rad.

        Raises
        ------
        InputError
            If a placement lies outside; the message has the number of the placement.
        """
        U, off = as_matrices(("U", U, f"K {self.k}"), ("off", off, "K"), exact=True, finite=False)
        bad = ~self._contains(U, off)
        if not bad.any():
            return U
        at = int(np.argmax(bad))
        which = f"target {at}" if len(U) > 1 else "the target"
        if not np.isfinite(U[at]).all():
            raise InputError(
                f"{which} has a number that is not finite; give a finite position, m, and rotation"
            )
        if off[at] > TURNED and (np.abs(U[at]) <= self._bounds + EDGE).all():
            raise InputError(
                f"{which} lies outside the cell: only {', '.join(self.names)} vary in it, and the "
                f"target deviates by {off[at]:.3g} m or rad in another coordinate; "
                "move the target, or make a cell with a half-width for that coordinate"
            )
        i = int(np.argmax(np.abs(U[at]) - self._bounds))
        name, unit, width = self.names[i], self.units[i], self._widths_at(U[at])[i]
        raise InputError(
            f"{which} lies outside the cell: {name} is {U[at, i] * width:+.3g} {unit} "
            f"from the middle{self._middle_of(i)}, and the cell goes to ±{width:.3g}; "
            "move the target into the cell, or make a larger cell"
        )

    def ratio(self, Q: ArrayLike) -> Array:
        """Compute the factors by which to scale the cell so that poses lie on its boundary: (K,).

        The K poses are those of the configurations Q (K, n). A factor is above 1 for a pose outside
        the cell, and infinite for a pose that deviates along a coordinate of width 0. Every region
        Ω, in which a design is valid, has this method.
        """
        U, off = self.coordinates(
            *placed(self.task, as_configurations(Q, self.task.n, "this cell"))[:2]
        )
        return np.where(off <= TURNED, np.abs(U / self._bounds).max(axis=1), np.inf)

    # ---- in C
    # -------------------------------------------------------------------------------------------

    def _native_region(self) -> Any:
        """Create the C struct :data:`REGION` of Ω, the configurations whose poses lie in the cell.

        With this struct, C tests whether a configuration is in the region of a design.
        """
        ints, reals, scalars = self._tables()
        region, _ = filled_struct(REGION, {}, {}, {})
        point(region, "chart", [filled_struct(CHART, ints, reals, scalars)[0]])
        return region

    def _tables(self) -> tuple[dict[str, ArrayLike], dict[str, ArrayLike], dict[str, Any]]:
        """Return the members of the C struct :data:`CHART` that describe the cell, by their names.

        The three dictionaries have, in this order, arrays of integers, arrays of floats, and single
        numbers.
        """
        lower, upper = self._range_of_offsets()
        bounds = np.where(self.widths == 0, TURNED, self.widths * (1 + EDGE))
        bounds[list(self.free)] = np.inf
        reals: dict[str, ArrayLike] = {
            "p": self.placement.translation,
            "R": self.placement.rotation,
            "center": self._offset,
            "bounds": bounds,
            "scale": 1 / self._active_widths,
            "lower": lower,
            "upper": upper,
        }
        return {"moved": self.moved}, reals, {"k": self.k}

    def _range_of_offsets(self) -> tuple[Array, Array]:
        """Return the smallest and the largest offset of each task coordinate: (m,), (m,)."""
        whole = self.whole
        reach = np.zeros(len(self.widths))
        reach[whole.moved] = whole._active_widths * whole._bounds
        return whole._offset - reach, whole._offset + reach

    # ---- symmetries
    # --------------------------------------------------------------------------------

    @property
    def whole(self: C) -> C:
        """The same cell, with u including the coordinates that symmetries remove.

        An example of a removed coordinate is the angle about the axis of a joint that turns the
        whole arm.
        """
        return self._changed(removed=()) if self.removed else self

    @property
    def _removed(self) -> list[int]:
        """Indices, among the m task coordinates, of the l that symmetries remove from u."""
        return [one.coordinate for one in self.removed]

    @property
    def along(self) -> Array:
        """Derivative ∂F/∂y (n, l) of a function F, with y the l removed coordinates, rad.

        A single joint j moves the frame along a removed coordinate. So the column of this
        coordinate is 1 or −1 in row j, and 0 in all other rows.
        """
        along = np.zeros((self.task.n, len(self.removed)))
        for column, one in enumerate(self.removed):
            along[one.joint, column] = one.sign
        return along

    def _split(self, U: Array) -> tuple[Array, Array]:
        """Convert coordinates U of :attr:`whole` to those of this cell, and to joint motions.

        U is (K, k + l). Return the coordinates of this cell (K, k), and the joint motions (K, n),
        rad, along the removed coordinates. A function F adds these motions to its configurations to
        reach the values of the removed coordinates.
        """
        kept = np.isin(self.whole.moved, self.moved)
        return U[:, kept], self.whole.spread(U)[:, self._removed] @ self.along.T

    def _lifted(self, U: Array) -> Array:
        """Convert coordinates U (K, k) to those of :attr:`whole`, (K, k + l).

        The coordinates that symmetries remove from u are added, with the value 0. All are in the
        order of the task coordinates.
        """
        Y, whole = self.spread(U), self.whole
        return (Y - whole._offset)[:, whole.moved] / whole._active_widths

    def _away(self, Q: Array, q_ref: Array, p: Array, R: Array) -> Array:
        """Evaluate the difference Q − q_ref (K, n) from a chart's reference configurations (K, n).

        p and R are the placements at Q. For each joint that alone moves the frame along a removed
        coordinate, the motion along that coordinate and full turns are subtracted from the
        difference.
        """
        away = Q - q_ref
        if self.removed:
            away -= self._measured(p, R)[:, self._removed] @ self.along.T
        for one in self.removed:
            turns = np.rint(away[:, one.joint] / (2 * np.pi))
            away[:, one.joint] -= 2 * np.pi * turns
        return away

    def limit_margin(self, q: ArrayLike) -> Array:
        """Compute the distance (…, n) of each joint from its nearer limit; negative beyond it.

        Distances are in rad or m. ``q`` (…, n) are configurations in the middle of the ranges of
        the removed coordinates. A joint that moves the frame along a removed coordinate turns
        through the whole range of this coordinate; the result is its smallest distance over this
        range. If the range is ``"all"``, which ends at the limits of this joint, the result is
        infinite.
        """
        margin = self.task.limit_margin(q)
        for one in self.removed:
            all_of_it = one.coordinate in self.free
            beyond = np.inf if all_of_it else -self.widths[one.coordinate]
            margin[..., one.joint] += beyond
        return margin

    @property
    def excepted(self) -> tuple[str, ...]:
        """Joints left out of limit margins, because a range ``"all"`` ends at their limits.

        Such a range, of a sector's angle or spin, is the whole range of the joint, at most a full
        turn. The margin of the joint would be 0 at the ends of the range.
        """
        lower, upper = self.task.lower, self.task.upper
        joints = [one.joint for one in self.removed if one.coordinate in self.free]
        limited = np.isfinite(lower) | np.isfinite(upper)
        return tuple(self.task.joint_names[j] for j in joints if limited[j])

    def _changed(self: C, **changes: Any) -> C:
        """Return a copy of the cell with other values of the given attributes, not checked."""
        other, own = object.__new__(type(self)), type(self)
        kept = {
            name: value
            for name, value in vars(self).items()
            if not isinstance(getattr(own, name, None), cached_property)
        }
        freeze(other, **kept | changes)
        return other

    # ---- velocities
    # --------------------------------------------------------------------------------

    def twists(self, U: ArrayLike, R: ArrayLike) -> Array:
        """Evaluate E = ∂x/∂u (K, m, k + l), the task velocity per unit of each coordinate u.

        The last l columns are task velocities per rad of the removed coordinates.

        Parameters
        ----------
        U : (K, k) array
            Coordinates u.
        R : (K, 3, 3) array
            Actual rotations of the frame. For an axis task they may differ from those of the cell's
            poses by a rotation about the tool's axis.
        """
        U, R = as_matrices(("U", U, f"K {self.k}"), ("R", R, "K 3 3"), exact=True, finite=False)
        E = self._all_twists(self.spread(U), R)
        return np.concatenate(
            [E[:, :, self._active] * self._active_widths, E[:, :, self._removed]], 2
        )

    def slopes(self, p: ArrayLike, R: ArrayLike) -> tuple[Array, Array]:
        """Evaluate u (K, k) and ∂u/∂x (K, k + l, m) at placements p (K, 3), m, and R (K, 3, 3).

        The last l rows of ∂u/∂x belong to the removed coordinates, rad.
        """
        p, R = as_matrices(("p", p, "K 3"), ("R", R, "K 3 3"), exact=True, finite=False)
        Y, on = self._measured(p, R), self._active
        inverse = np.linalg.inv(self._all_twists(Y, R))
        slopes = [inverse[:, on] / self._active_widths[:, None], inverse[:, self._removed]]
        U = (Y - self._offset)[:, on] / self._active_widths
        return U, np.concatenate(slopes, axis=1)

    def speeds(self, U: ArrayLike) -> Array:
        """Evaluate the matrices ``C = (EᵀE)^(−1/2)`` (K, k + l, k + l) at the coordinates U (K, k).

        E = ∂x/∂u is the task velocity per unit of each coordinate u, from −1 to 1 in the cell. For
        a function q = F(u), ∂F/∂u C is the joint speed per unit of task speed, 1 m/s or 1 rad/s. So
        cells of different sizes can be compared.
        """
        _, R = self.placements(U)
        return unit_speeds(self.twists(U, R))

    def errors(self, p_goal: ArrayLike, R_goal: ArrayLike, p: ArrayLike, R: ArrayLike) -> Array:
        """Evaluate the task errors (K, m), m and rad, from placements to goals.

        The goals are p_goal (K, 3), m, and R_goal (K, 3, 3); the placements are p and R, of the
        same shapes. Both are in the base frame. The error is goal minus placement, in base axes;
        for an axis task, the rotation is about the frame's own x and y axes.
        """
        p_goal, R_goal, p, R = as_matrices(
            ("p_goal", p_goal, "K 3"),
            ("R_goal", R_goal, "K 3 3"),
            ("p", p, "K 3"),
            ("R", R, "K 3 3"),
            exact=True,
            finite=False,
        )
        return self.task.kind.errors(p, R, p_goal, R_goal)

    # ---- nodes
    # -------------------------------------------------------------------------------------

    def sample(self, count: int, seed: int = 0) -> Array:
        """Draw coordinates U (count, k), uniform in the cell: scrambled Sobol points.

        The points are the nodes of a fit, or the held-out poses of an evaluation. The same ``seed``
        gives the same points.
        """
        count, seed = as_int(count, "count", 1, MOST_NODES), as_int(seed, "seed")
        power = int(np.ceil(np.log2(max(count, 2))))
        random = np.random.default_rng(seed)
        return 2 * scrambled_points(self.k, power, random)[:count] - 1

    def _dense_at_edges(self, count: int, seed: int) -> Array:
        """Sample 2 ``count`` poses of the cell, densely at its edges, and its corners: U (K, k).

        If k = 2, each coordinate has the density of Chebyshev nodes, 1 / √(1 − u²). A polynomial
        that is fitted to such poses is about as accurate at the edges as inside. For other k, this
        density would leave too few poses inside. So half of the poses then have a constant density,
        and the others the density 2 |u|.
        """
        if self.k == 2:
            U = np.concatenate([self.sample(2 * count, seed), self.corners()])
            return np.asarray(np.sin(np.pi / 2 * U))
        U = np.concatenate([self.sample(count, seed), self.corners()])
        return np.concatenate([U, np.sign(U) * np.abs(U) ** 0.5])

    def corners(self) -> Array:
        """Return the coordinates (K, k) of the corners of the cell, then of its face centres.

        The evaluation adds these poses to sampled poses, which all lie inside the cell.
        """
        faces = np.concatenate([np.eye(self.k), -np.eye(self.k)])
        return np.concatenate([np.array(list(product((-1.0, 1.0), repeat=self.k))), faces])

    def rim(self) -> Array:
        """Return the coordinates (K, k) of corners, face centres and, if k = 3, edge middles.

        If k = 3, the rows are sorted by u_1, then by u_2, then by u_3. For other k, the corners
        come first, then the face centres.
        """
        if self.k != 3:
            return self.corners()
        U = np.array(list(product((-1.0, 0.0, 1.0), repeat=3)))
        return U[np.abs(U).any(axis=1)]

    # ---- words
    # -------------------------------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each of the k coordinates u, such as ``x``, ``y``, ``about z``."""
        return tuple(
            name for name, on in zip(self.coordinate_names, self._active, strict=True) if on
        )

    @property
    def coordinate_names(self) -> list[str]:
        """Name of each of the m task coordinates, also of those of width 0."""
        positions = ["xyz"[i] for i in self.task.rows[: len(self.half_width)]]
        turns = (
            ["about x", "about y", "about z"]
            if self.task.kind == "pose"
            else ["about tool x", "about tool y"]
        )
        return [*positions, *turns[: len(self.rotation)]]

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each of the k coordinates u, m or rad."""
        return tuple(
            unit for unit, on in zip(self.coordinate_units, self._active, strict=True) if on
        )

    @property
    def coordinate_units(self) -> list[str]:
        """Unit of each of the m task coordinates, m or rad."""
        return ["m"] * len(self.half_width) + ["rad"] * len(self.rotation)

    def size(self) -> str:
        """Format the half-widths: ``±(0.1, 0.15, 0.1) m, turned by ±0.3 rad``."""
        text = f"±({', '.join(f'{w:.3g}' for w in self.half_width)}) m"
        if not self.rotation.any():
            return text + (", one orientation" if len(self.rotation) else "")
        same = np.ptp(self.rotation) < 1e-12
        turn = (
            f"±{self.rotation[0]:.3g}"
            if same
            else f"±({', '.join(f'{w:.3g}' for w in self.rotation)})"
        )
        return f"{text}, turned by {turn} rad"

    def where(self, u: ArrayLike) -> str:
        """Format the pose at u (k,): ``(0.1, 0.2, 0.5) m, turned by (0.3, 0, 0) rad from …``.

        The text ends in "the middle's orientation"; without a rotation, it has the position only.
        """
        x = self.at(u)
        text = f"({', '.join(f'{v:.3g}' for v in np.round(x.translation, 9) + 0.0)}) m"
        if self.rotation.any():
            u = vector(u, self.k, "u", "one per coordinate of the cell")
            turn = self.spread(u[None])[0, len(self.half_width) :]
            by = ", ".join(f"{v:.2g}" for v in turn)
            turned = f", turned by ({by}) rad from the middle's orientation"
            text += turned if turn.any() else ""
        return text

    def __repr__(self) -> str:
        middle = self.where(np.zeros(self.k))
        return f"<Cell {self.size()} around {middle}, {self.task.frame} {self.task.kind}>"

    # ---- inside
    # ------------------------------------------------------------------------------------

    @cached_property
    def moved(self) -> NDArray[np.intp]:
        """Indices (k,), among the m task coordinates, of those that belong to u, in order."""
        return unwritable(np.flatnonzero(self._active))

    @cached_property
    def _active(self) -> NDArray[np.bool_]:
        """True for the task coordinates that belong to u: (m,)."""
        active = np.array(self.widths > 0, bool)
        active[self._removed] = False
        return unwritable(active)

    @property
    def _bounds(self) -> Array:
        """Maximum |u_i| (k,) of accepted poses: 1, or π / half-width for a range ``"all"``.

        The range ``"all"`` of a rotation ends only at the joint limits, so any angle is accepted.
        """
        most = np.ones(len(self.widths))
        for i in self.free:
            most[i] = np.pi / self.widths[i]
        return most[self._active]

    @cached_property
    def _active_widths(self) -> Array:
        """Half-widths (k,), m or rad, of the task coordinates that belong to u."""
        return unwritable(self.widths[self._active])

    def _widths_at(self, u: Array) -> Array:
        """Return the half-widths (k,), m and rad, at the pose u (k,); the same everywhere in a box.

        In some sectors, the half-width of the radius depends on the height.
        """
        return self._active_widths

    def _middle_of(self, i: int) -> str:
        """Return the words that follow "from the middle" in messages about the coordinate u_i.

        A box has one middle, so the text is empty; a sector may add `` at its height``.
        """
        return ""

    def _values(self, Y: Array) -> Array:
        """Return the values (K, m) of the m task coordinates at offsets Y (K, m), m and rad.

        A value is the offset plus the value in the middle of the cell, :attr:`centre`.
        """
        return np.asarray(self.centre + Y)

    @property
    def _offset(self) -> Array:
        """Offset (m,) of the middle from :attr:`placement`, m and rad.

        The offset is 0, except in some sectors, in which the middle of the spin is moved.
        """
        return np.zeros(len(self.widths))

    def spread(self, U: ArrayLike) -> Array:
        """Convert coordinates U (K, k) to offsets (K, m), m and rad.

        A task coordinate that does not belong to u gets its offset in the middle of the cell.
        """
        (U,) = as_matrices(("U", U, f"K {self.k}"), exact=True, finite=False)
        Y = np.empty((len(U), len(self.widths)))
        Y[:] = self._offset
        Y[:, self._active] += U * self._active_widths
        return Y

    def _measured(self, p: Array, R: Array) -> Array:
        """Convert placements, p (K, 3), m, and R (K, 3, 3), to offsets (K, m), m and rad."""
        Y = np.empty((len(p), len(self.widths)))
        positions = len(self.half_width)
        Y[:, :positions] = (p - self.placement.translation)[:, self.task.rows[:positions]]
        R_0 = self.placement.rotation
        if self.task.kind == "pose":
            Y[:, 3:] = rotation_vectors(R @ R_0.T)
        elif self.task.kind == "axis":
            Y[:, 3:] = axis_turns(np.broadcast_to(R_0, R.shape), R)
        return Y

    def vectors(self, turns: ArrayLike) -> Array:
        """Convert offsets of the rotation, rad, to rotation vectors (K, 3) in base axes.

        The offsets ``turns`` are about the base axes, (K, 3), for a pose task, and about the x and
        y axes of the frame in the middle of the cell, (K, 2), for an axis task.
        """
        (turns,) = as_matrices(
            ("turns", turns, f"K {3 if self.task.kind == 'pose' else 2}"), exact=True, finite=False
        )
        return turns if turns.shape[1] == 3 else turns @ self.placement.rotation[:, :2].T

    def _all_twists(self, Y: Array, R: Array) -> Array:
        """Evaluate the task velocity per m or rad of each task coordinate: (K, m, m).

        Column i is the task velocity at the poses with the offsets Y (K, m), in base axes, while
        only task coordinate i changes. R (K, 3, 3) are the rotations of the frame. In an axis task,
        the angular velocity is about the frame's own x and y axes.
        """
        T = self._frame_twists(Y)
        if self.task.kind != "axis":
            return T[:, self.task.rows]
        return np.concatenate([T[:, :3], np.swapaxes(R[:, :, :2], 1, 2) @ T[:, 3:]], axis=1)

    def _frame_twists(self, Y: Array) -> Array:
        """Evaluate the frame's velocity (v, ω) per m or rad of each task coordinate: (K, 6, m).

        Column i is the velocity at the poses with the offsets Y (K, m), in base axes, while only
        task coordinate i changes: rows 0 to 2 are v, rows 3 to 5 are ω.
        """
        positions = len(self.half_width)
        T = np.zeros((len(Y), 6, self.task.m))
        T[:, self.task.rows[:positions], np.arange(positions)] = 1.0
        if len(self.rotation):
            turn = np.eye(3) if self.task.kind == "pose" else self.placement.rotation[:, :2]
            T[:, 3:, 3:] = left_jacobian(Y[:, 3:] @ turn.T) @ turn
        return T


def unit_speeds(E: Array) -> Array:
    """Evaluate C = (EᵀE)^(−1/2) (K, k, k) for E = ∂x/∂u (K, m, k); E C has orthonormal columns."""
    s, V = np.linalg.eigh(np.swapaxes(E, 1, 2) @ E)
    return (V / np.sqrt(s)[:, None, :]) @ np.swapaxes(V, 1, 2)
