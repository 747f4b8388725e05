"""Inverse kinematic function over a cell: the same pose always gives the same configuration.

A cell is a box of poses; u (k,) are the coordinates of a pose in it, from −1 to 1. The function q =
F(x; c) of a pose x has a level c (r,), the position along the self-motion; a leaf is the set of
configurations F(x; c) with one level c. Quaternions are qx, qy, qz, qw. The chart of the function
consists of two polynomials in u: q_ref approximates a configuration, and n_ref the null space of J.
Letters: n joints, m task coordinates, r = n − m components of c, K targets.

``Chart`` is coordinates (u, s) of configurations: u gives the pose, the label s (r,) the position
along its self-motion. ``ToolFunction`` is the inverse kinematic function of a tool, made from that
of the frame that carries it. ``_NativeFunction`` is an inverse function in C. ``ElbowLevel`` is the
level c at which the elbow is nearest to a point, and the configuration there.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...base.arguments import (
    Array,
    as_configurations,
    as_int,
    as_matrices,
    as_numbers,
    require_choice,
    vector,
)
from ...base.errors import InputError
from ...base.threads import PerThread
from ...model.chain_formulas import Placement, as_placement, as_placements
from ...model.native_kinematics import placed
from ...model.task import Task
from ...native import CHART_CALL, filled_struct, library
from ...redundancy import leaf_margin
from ...strategies import RepeatableInverse
from ...strategies.native_arm import library_arm
from .chart.chart import CellPotentials, Chart, native_chart
from .geometry.cell import Cell
from .geometry.kinematics import null_bases
from .targets import FORMS, as_poses, homogeneous

if TYPE_CHECKING:
    from ...strategies.elbow import ElbowLevel
    from .tool_function import ToolFunction

_MOST_THREADS = 256
_PART = 2048
"""Number of poses at a time, per thread; their arrays stay in the processor's cache."""

_MARCH = 0.05
_LEAST = 0.1
"""Value of ``σ_min(Nᵀ n̂_ref)`` at which the ranges of :meth:`InverseFunction.leaves` end."""


class InverseFunction:
    """Inverse kinematic function ``q = F(x; c)`` over a cell, a box of poses.

    Baker and Wampler introduced such functions. F needs no initial configuration and no history:
    the same pose gives the same configuration, which changes smoothly with the pose. F solves
    ``f(F(x)) = x`` and ``n_ref(x)ᵀ (F(x) − q_ref(x)) = c``, where q_ref and n_ref are polynomials
    that approximate a configuration and the null space. The level c, by default 0, is the position
    along the self-motion.

    Several threads may use one object at the same time.

    Parameters
    ----------
    chart
        The chart, with q_ref and n_ref.
    keep_limits : bool
        Check the joint limits also for c = 0; not needed if F with c = 0 violates no limit in the
        cell. For other levels, limits are always checked.

    Raises
    ------
    InputError
        If the function is evaluated outside the cell, or a configuration violates a limit that is
        checked.

    Examples
    --------
    >>> F = found.function
    >>> q = F(task.placement(q0))  # rad
    >>> np.allclose(task.placement(q).translation, task.placement(q0).translation)
    True
    """

    def __init__(self, chart: Chart, *, keep_limits: bool = True) -> None:
        self.chart, self.keep_limits = chart, keep_limits
        self._native = _native_function(chart, keep_limits)
        if self._native is not None:
            self._one = PerThread(self._native.of_one)

    @property
    def cell(self) -> Cell:
        """The cell over which the function is defined."""
        return self.chart.cell.whole

    @property
    def task(self) -> Task:
        """The task whose forward kinematics the function inverts."""
        return self.chart.cell.task

    def __call__(self, target: Placement, *, leaf: ArrayLike | None = None) -> Array:
        """Evaluate F: the configuration (n,), rad (m for prismatic joints), for a pose of the cell.

        Parameters
        ----------
        target : pinocchio.SE3 or (4, 4) array
            Pose x of the frame, in the base frame.
        leaf : (r,) array, optional
            Level c, rad (m for prismatic joints), by default 0. Other values move the arm along its
            self-motion, see :meth:`leaves`.

        Raises
        ------
        InputError
            If the target lies outside the cell or is no rigid transform, or F has no configuration
            inside the limits there.
        """
        if not isinstance(target, pin.SE3):
            target = as_placement(target)
        c = None if leaf is None else self._leaf(leaf)
        if self._native is not None:
            q = self._one.own(target, c)
            if q is not None:
                return q
        u = self.cell.coordinates_of(target)  # says what is wrong with the target
        Q, error = self._law(u[None], np.zeros((1, self.task.r)) if c is None else c[None])
        if error is not None:
            raise error[1]
        return Q[0]

    def batch(
        self,
        targets: Sequence[Placement] | Array,
        *,
        leaf: ArrayLike | None = None,
        missing: Literal["raise", "nan"] = "raise",
        threads: int = 1,
    ) -> Array:
        """Evaluate F at K targets: configurations (K, n), rad (m for prismatic joints).

        Parameters
        ----------
        targets : list of placements, or (K, 4, 4), (K, 7) or (K, k) array
            Poses of the frame, in the base frame: placements; homogeneous matrices; or positions,
            m, with quaternions, ``x, y, z, qx, qy, qz, qw``. Or coordinates U of the cell.
        leaf : (r,) or (K, r) array, optional
            Level c, by default 0: one for all targets, or one for each target.
        missing : "raise" or "nan"
            Result for a target outside the cell or without a configuration: an error, or a row of
            NaN.
        threads
            Number of threads.

        Raises
        ------
        InputError
            If a target is outside the cell, has no configuration, or its rotation matrix is not a
            rotation. The message names the target by its number, counted from 0.
        """
        threads = as_int(threads, "threads", 1, _MOST_THREADS)
        require_choice(missing, ("raise", "nan"), "missing")
        if self._native is None:
            return self._law_at(targets, leaf, missing)
        if not isinstance(targets, np.ndarray):
            placements = as_placements(targets, "target", FORMS)
            targets = homogeneous(*as_poses(self.task, placements))
        if targets.ndim < 2:
            return self._law_at(targets, leaf, missing)  # which refuses them
        try:
            c = np.ascontiguousarray(self._leaves(leaf, len(targets)))
            Q = self._native.of_many(targets, c, self._matrices, threads)
            failed = np.flatnonzero(np.isnan(Q[:, 0]))
            if len(failed):  # it says why
                Q[failed] = self._law_at(targets[failed], c[failed], missing)
        except InputError:  # again, for the number of the target
            return self._law_at(targets, leaf, missing)
        return Q

    def _law_at(
        self,
        targets: Sequence[Placement] | Array,
        leaf: ArrayLike | None,
        missing: Literal["raise", "nan"],
    ) -> Array:
        """Evaluate F (K, n) in NumPy at K targets, placements or coordinates of the cell.

        This method is used without the native library, and to find out why a target has no
        configuration. With ``missing`` "nan", the row of such a target is NaN; with "raise", an
        InputError is raised. ``leaf`` is the level, (r,) or (K, r); None is 0.
        """
        cell = self.cell
        U, off = self._coordinates(targets)
        c = self._leaves(leaf, len(U))
        if missing == "raise":
            Q, error = self._law(cell.inside(U, off), c)
            if error is not None:
                raise InputError(f"target {error[0]}: {error[1]}")
            return Q
        Q, good = np.full((len(U), self.task.n), np.nan), cell._contains(U, off)
        Q[good], _ = self._law(U[good], c[good])
        return Q

    def pose_and_leaf(self, Q: ArrayLike) -> tuple[Array, Array]:
        """Compute the pose x of each configuration, and its level c, so that ``F(x; c) = q``.

        The level is ``c = n_ref(x)ᵀ (q − q_ref(x))``; it is 0 if q = F(x). Far from F(x), several
        configurations can have the same pose and level; F returns only one of them.

        Parameters
        ----------
        Q : (K, n) array
            Configurations, rad or m.

        Returns
        -------
        X : (K, 4, 4) array
            Homogeneous matrices of the frame, in the base frame.
        C : (K, r) array
            Levels c; NaN where the pose lies outside the cell.

        Raises
        ------
        InputError
            If Q is not an array (K, n) of numbers.
        """
        Q = as_configurations(Q, self.task.n, "this function")
        p, R, _ = placed(self.task, Q)
        good = self.cell._contains(*self.cell.coordinates(p, R))
        C = np.where(good[:, None], CellPotentials(self.chart)._values_at(Q, p, R), np.nan)
        return homogeneous(p, R), C

    def _law(self, U: Array, C: Array) -> tuple[Array, tuple[int, InputError] | None]:
        """Evaluate F (K, n) in NumPy at coordinates U (K, k) in the cell, with the levels C (K, r).

        Rows without a configuration are NaN. Return also (number, InputError) of one such row, with
        the reason: the first without a solution, else the first beyond a joint limit. None if there
        is no such row.
        """
        reduced, shift = self.chart.cell._split(U)
        points = self.chart.solve(reduced, C)
        Q = points.Q + shift
        broken = self.task.limit_margin(Q).min(axis=1, initial=np.inf) < 0
        broken &= self.keep_limits | C.any(axis=1)
        error = None
        for rows in (~points.found, broken):
            if rows.any() and error is None:
                at = int(np.argmax(rows))
                error = at, self._refused(Q[at], U[at], found=bool(points.found[at]))
        Q[broken | ~points.found] = np.nan
        return Q, error

    def _matrices(self, targets: Array) -> Array:
        """Convert targets to homogeneous matrices (K, 4, 4); NaN for coordinates outside the cell.

        Targets are homogeneous matrices (K, 4, 4), positions with quaternions (K, 7), or
        coordinates of the cell (K, k).
        """
        if targets.shape[1:] == (4, 4) and targets.dtype == float:
            return np.ascontiguousarray(targets)
        if targets.ndim != 2 or targets.shape[1] == 7:
            return homogeneous(*as_poses(self.task, targets))
        U, off = self._coordinates(targets)
        p, R = self.cell.placements(U)
        p[~self.cell._contains(U, off)] = np.nan
        return homogeneous(p, R)

    def jacobian(self, target: Placement, *, leaf: ArrayLike | None = None) -> Array:
        """Evaluate ∂F/∂x (n, m), the joint velocity per task velocity, at a pose of the cell.

        The level is ``leaf`` (r,), by default 0.
        """
        return self.inverse(self(target, leaf=leaf))

    @cached_property
    def inverse(self) -> RepeatableInverse:
        """Controller ``q̇ = ∂F/∂x ẋ`` with the region Ω of the cell; its leaf c = 0 is F."""
        return RepeatableInverse(self.task, CellPotentials(self.chart))

    def with_tool(self, placement: Placement) -> ToolFunction:
        """Create the function of another tool on the same body: ``F'(x) = F(x T⁻¹)``, exactly.

        The new function has values at the poses x T with x in the cell. The new function cannot be
        saved or exported; save and export this function, and let the robot's program multiply poses
        of the tool by T⁻¹.

        Parameters
        ----------
        placement : pinocchio.SE3 or (4, 4) array
            Placement T of the tool in the frame of the task.

        Raises
        ------
        InputError
            If the task is not a pose task: in other tasks, the self-motion depends on the point
            that is controlled.
        """
        from .tool_function import ToolFunction  # few functions change their tool

        return ToolFunction(self, placement)

    def leaves(self, target: Placement) -> Array:
        """Find the range (r, 2) of each component c_j of the level at a pose, with the others at 0.

        A row is (low, high), rad (m for prismatic joints). A range ends at a joint limit, at ±π, or
        where ``σ_min(Nᵀ n̂_ref)`` falls to 0.1, with n̂_ref an orthonormal basis of the columns of
        n_ref. This singular value is 1 where n_ref spans the null space N, and 0 where the matrix
        [J; n_refᵀ] is singular.
        """
        task, r = self.task, self.task.r
        u, shift = self.chart.cell._split(self.cell.coordinates_of(target)[None])
        U = np.tile(u, (2 * r, 1))
        ways = np.concatenate([-np.eye(r), np.eye(r)])
        done, step = np.zeros(2 * r), np.full(2 * r, _MARCH)
        Q = np.tile(self(target) - shift[0], (2 * r, 1))
        while ((step > 1e-9) & (done < np.pi)).any():
            ahead = np.minimum(done + step, np.pi)
            points = self.chart.solve(U, ahead[:, None] * ways, Q)
            leaf = leaf_margin(null_bases(points.J, points.n_ref), points.n_ref)
            margin = task.limit_margin(points.Q + shift).min(axis=1)
            good = points.found & (margin >= 0) & (leaf > _LEAST)
            good &= np.abs(points.Q - Q).max(axis=1) < 1.0
            Q[good], done[good] = points.Q[good], ahead[good]
            step[~good] /= 2
        return np.stack([-done[:r], done[r:]], axis=1)

    def leaf_toward(
        self, target: Placement, *, elbow: ArrayLike, link: str | None = None, margin: float = 0.0
    ) -> ElbowLevel:
        """Find a level c of F(x; c) at which the elbow's distance from a point is a local minimum.

        The search begins at the configuration F(x) of level 0, and moves along the self-motion, the
        frame at rest, to the next minimum of the distance. So the result is a function c*(x, p_e)
        of pose and point: the same pose and point give the same configuration. The result has the
        level, the configuration there, and the distance of the elbow from the point, m.

        Parameters
        ----------
        target : pinocchio.SE3 or (4, 4) array
            Pose x of the frame, in the base frame.
        elbow : (3,) array
            Point p_e for the elbow, in the base frame, m.
        link
            Link whose origin is the elbow. By default, the elbow is the joint origin that moves
            most in self-motions, among the joints in the middle of the arm.
        margin
            Distance to keep from the joint limits, rad or m.
        """
        return self.inverse.leaf_toward(self(target), elbow=elbow, link=link, margin=margin)

    def _coordinates(self, targets: Sequence[Placement] | Array) -> tuple[Array, Array]:
        """Convert K targets to coordinates U (K, k), and to deviations (K,) from the cell.

        Targets are a list of placements, matrices (K, 4, 4), positions with quaternions (K, 7), or
        coordinates (K, k). The deviation of a target, m or rad, is its largest deviation along a
        coordinate of width 0, which the cell holds constant. Targets that are coordinates of the
        cell are returned, with deviations 0.
        """
        if isinstance(targets, np.ndarray) and targets.ndim != 3 and targets.shape[-1:] != (7,):
            (U,) = as_matrices(
                ("coordinates of this cell", targets, f"K {self.cell.k}"), exact=True, finite=False
            )
            return U, np.zeros(len(U))
        return self.cell.coordinates(*as_poses(self.task, targets))

    def _leaves(self, leaf: ArrayLike | None, count: int) -> Array:
        """Convert the argument ``leaf``, (r,), (K, r) or None, to one level per target (K, r).

        None is 0. Other shapes raise an InputError.
        """
        array = None if leaf is None else as_numbers(leaf)
        if array is not None and array.ndim == 2:
            form = f"{count} {self.task.r}"
            (C,) = as_matrices(("the leaves", array, form), exact=True)
            return C
        c = np.zeros(self.task.r) if leaf is None else self._leaf(leaf)
        return np.tile(c, (count, 1))

    def _leaf(self, leaf: ArrayLike) -> Array:
        """Check one level c, and return it as an array (r,); else raise an InputError."""
        array = as_numbers(leaf)
        return vector(leaf if array is None else np.atleast_1d(array), self.task.r, "the leaf c")

    def _refused(self, q: Array, u: Array, *, found: bool) -> InputError:
        """Create the error for a pose u (k,) at which F returns no configuration.

        With ``found``, q (n,) is the configuration there, and the error names the joint that
        violates its limit most. Without ``found``, no configuration exists there, and q is not
        used.
        """
        where = self.cell.where(u)
        if not found:
            return InputError(f"no configuration exists on this leaf at {where}")
        joint = int(np.argmin(self.task.limit_margin(q)))
        name = self.task.joint_names[joint]
        return InputError(
            f"no configuration at {where}: {name} = {q[joint]:.4g} would be outside its limits"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(type(self), keep_limits=self.keep_limits), (self.chart,)

    def __repr__(self) -> str:
        task = self.task
        return f"<InverseFunction of {task.robot.name} {task.frame} over {self.cell.size()}>"


class _NativeFunction:
    """Inverse function of a chart in C, for speed.

    Parameters
    ----------
    native
        The native library.
    arm
        Struct Arm of the task, from :func:`native_arm`.
    chart
        The chart.
    keep_limits
        True to check the joint limits also at the level 0.
    """

    def __init__(self, native: ctypes.CDLL, arm: Any, chart: Chart, keep_limits: bool) -> None:
        self._native, self._held = native, ctypes.PyDLL(native._name)
        self._arm, self._chart = arm, native_chart(chart)
        self._keep = int(keep_limits)
        self._n, self._r = chart.cell.task.n, chart.cell.task.r

    def of_one(self) -> Callable[[pin.SE3, Array | None], Array | None]:
        """Create a function (target, level or None) → q (n,), for one thread at a time.

        The target is a pinocchio.SE3, the level an array (r,); None is 0. The function returns None
        where C finds no configuration.
        """
        target, leaf, result = np.zeros((4, 4)), np.zeros(self._r), np.zeros(self._n)
        parts = {"target": target, "leaf": leaf, "result": result}
        to = {
            "arm": ctypes.addressof(self._arm),
            "chart": ctypes.addressof(self._chart),
            "keep": self._keep,
        }
        call, _ = filled_struct(CHART_CALL, {}, parts, to)
        address = ctypes.c_void_p(ctypes.addressof(call))
        run = self._held.call_configuration  # keeps the interpreter's lock: faster

        # [...] is 0.1 µs faster than [:]
        def one(at: pin.SE3, c: Array | None, _memory: Any = call) -> Array | None:
            target[...] = at.homogeneous
            if c is not None:
                leaf[...] = c
            return None if run(address, c is not None) else result.copy()

        return one

    def of_many(
        self, targets: Array, C: Array, matrices: Callable[[Array], Array], threads: int
    ) -> Array:
        """Evaluate F (K, n) at targets (K, …) with the levels C (K, r), chunk by chunk.

        The arrays of a chunk fit in the processor's cache; the chunks are distributed over
        ``threads`` threads. ``matrices`` converts targets to homogeneous matrices (K, 4, 4). Rows
        without a configuration are NaN.
        """
        Q = np.empty((len(targets), self._n))
        to = ctypes.byref(self._arm), ctypes.byref(self._chart)

        def evaluate(begin: int) -> None:
            part = slice(begin, begin + _PART)
            X = matrices(targets[part])
            rows = (ctypes.c_void_p(x.ctypes.data) for x in (X, C[part], Q[part]))
            count = ctypes.c_long(len(X))
            self._native.call_configurations(*to, self._keep, count, *rows)

        parts = range(0, len(targets), _PART)
        if threads == 1 or len(parts) < 2:
            for begin in parts:
                evaluate(begin)
        else:
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(evaluate, parts))
        return Q


def _native_function(chart: Chart, keep_limits: bool) -> _NativeFunction | None:
    """Create the C version of a cell function, which is much faster than NumPy.

    With ``keep_limits``, the function tests the joint limits also for the level 0; for other
    levels, it always tests them. Return None without the native library, or with more than 64
    joints.
    """
    native, arm = library(), library_arm(chart.cell.task)
    if native is None or arm is None:
        return None
    return _NativeFunction(native, arm, chart, keep_limits)
