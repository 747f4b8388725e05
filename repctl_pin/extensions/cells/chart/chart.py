r"""Chart of the configurations over a cell: their coordinates (u, s).

The cell is a box of poses, u (k,) are the coordinates of a pose in it, from −1 to 1, and the label
s (r,) is the position along the self-motion at that pose. The polynomials q_ref(u) and n_ref(u) of
a chart approximate a configuration at the pose, where s = 0, and the null space of J there. A
function q = F(u) over the cell is described by s(u); the function of the chart itself is s = 0.
x(u) is the pose; ∂x/∂u is the task velocity per unit of each coordinate u, and C = (EᵀE)^(−1/2),
with E = ∂x/∂u, scales the coordinates to unit task speed.

Letters: n joints, m task coordinates, r = n − m components of s, k coordinates in u, K poses, N
monomials. Each of l further coordinates of the cell is symmetric: a single joint moves the frame
along it, so u leaves it out. The columns of :attr:`Cell.along` (n, l) are the unit vectors of these
joints, with a sign. G_d is the desired inverse.

``_Goals`` are the terms q_ref, n_ref, p and R of the chart's equations at K poses. ``Points`` are
the configurations Q (K, n) of a function q = F(u) at K poses, with the kinematics there.
"""

from __future__ import annotations

from ctypes import c_double, c_int
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.arguments import Array, read_only
from ....model.native_kinematics import chain_for_c, placed, run
from ....native import CHART, PART, filled_struct, point
from ....solvers import newton_rows
from ....strategies.strategy import Inverse
from ..geometry.cell import Cell, unit_speeds
from ..geometry.kinematics import solved
from .monomials import Monomials

_STEP = 0.3
"""Longest Newton step of any joint, rad or m."""

_CELL = 2
"""Kind of the potentials of a chart in arm.h."""

_FOURS = 4
"""Number of monomials that chart.c adds at a time."""

_ITERATIONS = 12
_EXACT = 1e-8

_ROUNDING = 1e-12
"""Size of coefficients that rounding alone can have."""


class _Goals(NamedTuple):
    """Terms of a chart's equations at K poses that do not depend on q, from :meth:`Chart.goals`.

    They are computed once if the equations are solved repeatedly at the same poses.

    Attributes
    ----------
    q_ref, n_ref : (K, n) and (K, n, r) arrays
        Reference configurations, and reference null-space bases.
    p, R : (K, 3) and (K, 3, 3) arrays
        Positions, m, and rotation matrices of the poses, in the base frame.
    """

    q_ref: Array
    n_ref: Array
    p: Array
    R: Array


class Rates(NamedTuple):
    """Derivatives at K poses that do not depend on the configurations there.

    Attributes
    ----------
    E : (K, m, k + l) array or None
        ∂x/∂u in the first k columns, and in the last l the derivatives with respect to the
        symmetric coordinates. None in an axis task, in which E depends on the rotation of the
        frame.
    C : (K, k + l, k + l) array
        (EᵀE)^(−1/2).
    E_C : (K, m, k + l) array or None
        E C.
    slopes : (K, n, k) and (K, n, r, k) arrays
        ∂q_ref/∂u and ∂n_ref/∂u.
    """

    E: Array | None
    C: Array
    E_C: Array | None
    slopes: tuple[Array, Array]


@dataclass(frozen=True, eq=False)
@read_only
class Chart:
    r"""Coordinates (u, s) of configurations: ``f(q) = x(u)``, ``n_ref(u)ᵀ (q − q_ref(u)) = s``.

    The label s (r,) selects one configuration on the self-motion manifold of the pose x(u). The
    errors of q_ref and n_ref do not affect the pose of q, because Newton's method solves both
    equations exactly.

    Attributes
    ----------
    cell : Cell
        The cell.
    monomials : Monomials
        The N monomials of u in which q_ref and n_ref are written.
    coefficients : (N, n, 1 + r) array
        Coefficients of q_ref, ``[..., 0]``, and of the columns of n_ref, ``[..., 1:]``.
    """

    cell: Cell
    monomials: Monomials
    coefficients: Array

    @classmethod
    def fitted(cls, cell: Cell, U: Array, Q: Array, N: Array, degree: int) -> Chart:
        """Fit a chart to configurations Q (K, n) and null-space bases N (K, n, r) at U (K, k).

        U are the poses in coordinates of the cell. The polynomial q_ref approximates Q, the
        polynomial n_ref approximates N, both of the given degree in u.
        """
        monomials = Monomials(cell.k, degree)
        both = np.concatenate([Q[:, :, None], N], axis=2)
        return cls(cell, monomials, monomials.fit(U, both))

    def between(self, low: Array, high: Array) -> Chart:
        """Return the chart of the same function over the part of the cell with low ≤ u ≤ high.

        ``low`` and ``high`` (k,) are in the coordinates u of this cell. Ranges of coordinates whose
        middle is fixed, such as rotations, are first narrowed until they are symmetric. The
        polynomials q_ref and n_ref are rewritten in the coordinates of the part, which also go from
        −1 to 1.
        """
        low, high = self.cell._kept_middles(low, high)
        if (low == -1).all() and (high == 1).all():
            return self
        U = np.concatenate([self.cell.sample(4 * self.monomials.size, 7), self.cell.corners()])
        q_ref, n_ref = self.reference((low + high) / 2 + (high - low) / 2 * U)
        return Chart.fitted(self.cell._part(low, high), U, q_ref, n_ref, self.monomials.degree)

    @property
    def locked(self) -> tuple[int, ...]:
        """Indices of the r joints that the function keeps constant; empty for other functions.

        The columns of n_ref are then constant unit vectors, one per joint. Differences as small as
        rounding errors are ignored.
        """
        large = np.abs(self.coefficients) > _ROUNDING
        q_ref, n_ref = large[:, :, 0], large[:, :, 1:]
        joints = np.flatnonzero(n_ref[0].any(axis=1))
        moves = n_ref[1:].any() or q_ref[1:, joints].any()
        return () if moves or len(joints) != n_ref.shape[2] else tuple(joints.tolist())

    def reference(self, U: Array) -> tuple[Array, Array]:
        """Evaluate the polynomials q_ref (K, n) and n_ref (K, n, r) at the coordinates U (K, k)."""
        both = self.monomials.polynomials(U, self.coefficients)
        return both[:, :, 0], both[:, :, 1:]

    def slopes(self, U: Array) -> tuple[Array, Array]:
        """Evaluate ∂q_ref/∂u (K, n, k) and ∂n_ref/∂u (K, n, r, k) at the coordinates U (K, k)."""
        monomials, coefficients = self._differentiated
        both = monomials.polynomials(U, coefficients)
        return both[:, :, 0], both[:, :, 1:]

    def gradients(self, U: Array, dU: Array, J: Array, n_ref: Array, away: Array) -> Array:
        r"""Evaluate the gradients V (K, n, r) of the potentials ``h = n_refᵀ (q − q_ref)``.

        A controller that holds h constant follows the function of the chart.

        .. math:: V^T = n_{ref}^T - \left[ n_{ref}^T \partial q_{ref}
                  - (\partial n_{ref}^T)(q - q_{ref}) \right] \frac{\partial u}{\partial x} J

        ∂ is the derivative with respect to u and the l coordinates that symmetries remove from u;
        for these l coordinates, the columns of ∂q_ref are those of :attr:`Cell.along`, and the
        columns of ∂n_ref are 0.

        Parameters
        ----------
        U, dU : (K, k) and (K, k + l, m) arrays
            Coordinates u of the poses, and derivatives of all coordinates with respect to x.
        J, n_ref, away : (K, m, n), (K, n, r) and (K, n) arrays
            Jacobian, null-space basis of the chart, and q − q_ref.
        """
        dq, dn = self.slopes(U)
        n_T = np.swapaxes(n_ref, 1, 2)
        w = n_T @ dq - np.einsum("Knrk,Kn->Krk", dn, away)
        w = np.concatenate([w, n_T @ self.cell.along], axis=2)
        return n_ref - np.swapaxes(w @ dU @ J, 1, 2)

    @cached_property
    def _differentiated(self) -> tuple[Monomials, Array]:
        """Derivatives of q_ref and n_ref with respect to u, as monomials and coefficients.

        The N' monomials have a degree lower by one. The coefficients (N', n, 1 + r, k) have the
        derivatives of q_ref in ``[:, :, 0]`` and those of the columns of n_ref in ``[:, :, 1:]``.
        """
        return self.monomials.differentiated(self.coefficients)

    def goals(self, U: Array) -> _Goals:
        """Evaluate q_ref, n_ref and the poses (p, R) of the chart at coordinates U (K, k)."""
        return _Goals(*self.reference(U), *self.cell.placements(U))

    def goals_of(self, at: Points) -> _Goals:
        """Return the terms of :meth:`goals` at the poses of ``at``.

        q_ref and n_ref are those of ``at``; the polynomials are not evaluated again.
        """
        return _Goals(at.q_ref, at.n_ref, *self.cell.placements(at.U))

    def solve(
        self,
        U: Array,
        s: Array | None = None,
        Q: Array | None = None,
        *,
        goals: _Goals | None = None,
        iterations: int = _ITERATIONS,
    ) -> Points:
        """Find configurations with ``f(q) = x(u)`` and given labels s, by Newton's method.

        The label s is the position along the self-motion at the pose x(u), measured from q_ref(u).

        Parameters
        ----------
        U : (K, k) array
            Poses, in coordinates of the cell.
        s : (K, r) array, optional
            Labels; by default 0.
        Q : (K, n) array, optional
            Initial configurations; by default q_ref + n_ref s.
        goals
            q_ref, n_ref and the poses at U, if they are known.
        iterations
            Maximum number of Newton steps.

        Returns
        -------
        Points
            The configurations and their kinematics; ``found`` is False where the method did not
            converge.
        """
        cell = self.cell
        q_ref, n_ref, p_goal, R_goal = self.goals(U) if goals is None else goals
        if s is None:
            s = np.zeros((len(U), cell.task.r))
        if Q is None:
            Q = q_ref + np.einsum("Knr,Kr->Kn", n_ref, s)
        equations = (p_goal, R_goal), (q_ref, n_ref, s)
        arm = chain_for_c(cell.task)
        if arm is None:
            Q, R, J, residual, size = self._newton(*equations, Q, iterations)
        else:
            Q, R, J, residual, size = self._newton_in_c(arm, *equations, Q, iterations)
        found = (size < 1e-6) & (residual < 1e-9)
        return Points(U, Q, R, J, q_ref, n_ref, residual, found)

    def _newton(
        self,
        goal: tuple[Array, Array],
        chart: tuple[Array, Array, Array],
        Q: Array,
        iterations: int,
    ) -> tuple[Array, Array, Array, Array, Array]:
        """Solve ``f(q) = goal``, ``n_refᵀ (q − q_ref) = s`` from Q (K, n) by Newton's method.

        These are the equations of the chart: q has the given pose, and is at the position s along
        its self-motion. q_ref and n_ref approximate a configuration and the null space.

        Parameters
        ----------
        goal : (K, 3) and (K, 3, 3) arrays
            Positions, m, and rotations of the target poses.
        chart : (K, n), (K, n, r) and (K, r) arrays
            q_ref, n_ref and s.
        Q : (K, n) array
            Initial configurations.
        iterations
            Maximum number of steps.

        Returns
        -------
        Q, R, J : (K, n), (K, 3, 3) and (K, m, n) arrays
            Configurations, and rotations and Jacobians there.
        residual, size : (K,) arrays
            Largest absolute entry of the final task error, and of the last Newton step; rad or m.
        """
        cell, (p_goal, R_goal), (q_ref, n_ref, s) = self.cell, goal, chart

        def correction(Q: Array, on: NDArray[np.intp]) -> Array:
            p, R, J = placed(cell.task, Q)
            e = cell.errors(p_goal[on], R_goal[on], p, R)
            g = s[on] - np.einsum("Knr,Kn->Kr", n_ref[on], Q - q_ref[on])
            J_V = np.concatenate([J, np.swapaxes(n_ref[on], 1, 2)], axis=1)
            return solved(J_V, np.concatenate([e, g], axis=1))

        Q, size = newton_rows(correction, Q, longest=_STEP, tolerance=_EXACT, iterations=iterations)
        p, R, J = placed(cell.task, Q)
        e = cell.errors(p_goal, R_goal, p, R)
        return Q, R, J, np.abs(e).max(axis=1), size

    def _newton_in_c(
        self,
        arm: Any,
        goal: tuple[Array, Array],
        chart: tuple[Array, Array, Array],
        Q: Array,
        iterations: int,
    ) -> tuple[Array, Array, Array, Array, Array]:
        """Solve ``f(q) = goal``, ``n_refᵀ (q − q_ref) = s`` from Q (K, n) by Newton's method, in C.

        ``arm`` is the C struct of the task's joint chain. ``goal`` are positions (K, 3), m, and
        rotations (K, 3, 3); ``chart`` are q_ref (K, n), n_ref (K, n, r) and s (K, r). Return the
        solutions Q (K, n), the rotations R (K, 3, 3) and the Jacobians J (K, m, n) at Q, and the
        largest entry (K,) of the task error and that of the last step (K,).
        """
        K, task = len(Q), self.cell.task
        Q = np.array(Q, float, order="C")
        R, J = np.empty((K, 3, 3)), np.empty((K, task.m, task.n))
        residual, size = np.empty(K), np.empty(K)
        rules = c_int(iterations), c_double(_STEP), c_double(_EXACT)
        found = Q, R, J, residual, size
        run("call_points", arm, K, *goal, *chart, *rules, *found)
        return found

    def rates(self, U: Array) -> Rates:
        """Evaluate E, C, E C and the slopes of q_ref and n_ref at the poses U (K, k)."""
        cell = self.cell
        E = None if cell.task.kind == "axis" else cell.twists(U, cell.placements(U)[1])
        C = cell.speeds(U) if E is None else unit_speeds(E)
        return Rates(E, C, None if E is None else E @ C, self.slopes(U))

    def derivative(
        self,
        at: Points,
        ds: Array | None = None,
        E: Array | None = None,
        slopes: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:
        r"""Evaluate the derivatives of a function q = F(u, s(u)) at K of its configurations.

        For the function of the chart, s = 0. ∂ is the derivative with respect to u and the l
        symmetric coordinates; E = ∂x/∂u. The two equations of the chart, f(q) = x(u) and
        n_refᵀ (q − q_ref) = s, give:

        .. math:: \begin{bmatrix} J \\ n_{ref}^T \end{bmatrix} \partial F = \begin{bmatrix} E \\
                  \partial s + n_{ref}^T \partial q_{ref}
                  - (\partial n_{ref}^T)(F - q_{ref}) \end{bmatrix}

        Parameters
        ----------
        at
            Configurations that solve the chart's equations.
        ds : (K, r, k) array, optional
            ∂s/∂u; by default 0.
        E : (K, m, k + l) array, optional
            ∂x/∂u at the configurations, if it is known.
        slopes : tuple of two arrays, (K, n, k) and (K, n, r, k), optional
            ∂q_ref/∂u and ∂n_ref/∂u, if they are known, as :meth:`slopes` returns them.

        Returns
        -------
        dF : (K, n, k + l) array
            Total derivative ∂F, which includes the change of s(u). The last l columns are those of
            the symmetric coordinates.
        B : (K, n, r) array
            ∂F/∂s at constant u.
        """
        m = self.cell.task.m
        dq, dn = self.slopes(at.U) if slopes is None else slopes
        below = np.einsum("Knr,Knk->Krk", at.n_ref, dq)
        below -= np.einsum("Knrk,Kn->Krk", dn, at.Q - at.q_ref)
        if ds is not None:
            below += ds
        n_T, r = np.swapaxes(at.n_ref, 1, 2), below.shape[1]
        below = np.concatenate([below, n_T @ self.cell.along], axis=2)
        J_V = np.concatenate([at.J, n_T], axis=1)
        E = self.cell.twists(at.U, at.R) if E is None else E
        onto = np.zeros((len(J_V), m + r, r))
        onto[:, m:] = np.eye(r)
        both = solved(J_V, np.concatenate([np.concatenate([E, below], axis=1), onto], axis=2))
        return both[:, :, : E.shape[2]], both[:, :, E.shape[2] :]

    def joint_speeds(
        self, desired: Inverse, at: Points, ds: Array | None = None, rates: Rates | None = None
    ) -> tuple[Array, Array, Array]:
        """Evaluate the joint velocities of a function F and of G_d, per unit of task speed.

        The cost of a design is the mean squared difference of the two. E is ∂x/∂u, and
        C = (EᵀE)^(−1/2) scales the coordinates u to unit task speed.

        Parameters
        ----------
        desired
            G_d.
        at, ds
            Configurations of F; and ∂s/∂u (K, r, k), by default 0.
        rates
            :meth:`rates` at the poses, if they are known.

        Returns
        -------
        own, wanted : (K, n, k + l) arrays
            ∂F C, and G_d E C. The columns are joint velocities in k + l directions of motion.
        B : (K, n, r) array
            ∂F/∂s.
        """
        E, C, E_C, slopes = (None, None, None, None) if rates is None else rates
        E = self.cell.twists(at.U, at.R) if E is None else E
        if C is None:
            C = self.cell.speeds(at.U) if self.cell.task.kind == "axis" else unit_speeds(E)
        E_C = E @ C if E_C is None else E_C
        dF, B = self.derivative(at, ds, E, slopes)
        return dF @ C, desired.batch(at.Q, at.J) @ E_C, B


class Points(NamedTuple):
    """Configurations that solve the equations of a chart at K poses, and the kinematics there.

    They are values of a function q = F(u): each is at the position s(u) along the self-motion of
    its pose.

    Attributes
    ----------
    U, Q : (K, k) and (K, n) arrays
        Poses, in coordinates of the cell, and configurations.
    R, J : (K, 3, 3) and (K, m, n) arrays
        Rotation of the frame, in base axes, and Jacobian, at Q.
    q_ref, n_ref : (K, n) and (K, n, r) arrays
        Reference configuration and reference null-space basis of the chart at U.
    residual : (K,) array
        Largest absolute entry of the task error, m or rad.
    found : (K,) array of bool
        True where Newton's method converged to a solution.
    """

    U: Array
    Q: Array
    R: Array
    J: Array
    q_ref: Array
    n_ref: Array
    residual: Array
    found: NDArray[np.bool_]

    def replaced(self, at: NDArray[np.intp], other: Points) -> Points:
        """Return a copy with the L points of ``other`` at the indices ``at`` (L,).

        A search over many poses thus adopts the points at which it succeeded.
        """
        arrays = [values.copy() for values in self]
        for values, new in zip(arrays, other, strict=True):
            values[at] = new
        return Points._make(arrays)


class CellPotentials:
    r"""The r potentials of a chart, ``h = n_refᵀ (q − q_ref)``; their leaf {h(q) = c} is s = c.

    A controller that holds h constant at c follows the function with s = c. q_ref and n_ref are
    evaluated at the pose of q, so h is a function of q, and :class:`RepeatableInverse` accepts it
    like polynomials of q. Outside the cell, q_ref and n_ref extrapolate and are not meaningful.

    Parameters
    ----------
    chart
        Chart with q_ref and n_ref.
    """

    def __init__(self, chart: Chart) -> None:
        self.chart, self.n = chart, chart.cell.task.n

    @property
    def region(self) -> Cell:
        """The cell, which is the region Ω of an inverse with these potentials."""
        return self.chart.cell.whole

    def value(self, q: Array) -> Array:
        """Evaluate the potentials h (r,) at the configuration q (n,)."""
        return self.values(np.asarray(q, float)[None])[0]

    def values(self, Q: Array) -> Array:
        """Evaluate the potentials h (K, r) at every row of Q (K, n)."""
        p, R, _ = placed(self.chart.cell.task, Q)
        return self._values_at(Q, p, R)

    def _values_at(self, Q: Array, p: Array, R: Array) -> Array:
        """Evaluate the potentials h (K, r) at Q (K, n), whose poses are p (K, 3), R (K, 3, 3)."""
        cell = self.chart.cell
        q_ref, n_ref = self.chart.reference(cell.coordinates(p, R)[0])
        away = cell._away(Q, q_ref, p, R)
        return np.einsum("Knr,Kn->Kr", n_ref, away)

    def gradient(self, q: Array) -> Array:
        """Evaluate the gradients V = ∂hᵀ/∂q of the potentials h at q (n,): (n, r)."""
        return self.gradients(np.asarray(q, float)[None])[0]

    def gradients(self, Q: Array) -> Array:
        """Evaluate the gradients V = ∂hᵀ/∂q of the potentials at Q (K, n): (K, n, r)."""
        Q = np.asarray(Q, float)
        p, R, J = placed(self.chart.cell.task, Q)
        cell = self.chart.cell
        U, dU = cell.slopes(p, R)
        q_ref, n_ref = self.chart.reference(U)
        away = cell._away(Q, q_ref, p, R)
        return self.chart.gradients(U, dU, J, n_ref, away)

    def _native_part(self) -> Any:
        """Create the struct ``Part`` of arm.h, with which C evaluates the potentials."""
        chart = native_chart(self.chart)
        part, _ = filled_struct(PART, {}, {}, {"kind": _CELL, "count": chart.terms})
        point(part, "chart", [chart])
        return part


def native_chart(chart: Chart) -> Any:
    """Create the struct ``Chart`` of chart.h, with which C evaluates a chart and its cell."""
    ints, reals, scalars = chart.cell._tables()
    terms, both, weights = _weights(chart)
    row, column = _elimination_order(chart)
    more = (0, terms - chart.monomials.size)
    ints |= {
        "parent": np.pad(chart.monomials.parent, more),
        "factor": np.pad(chart.monomials.variable, more),
        "row": np.argsort(row),
        "column": np.argsort(column),
    }
    scalars |= {"terms": terms, "both": both}
    return filled_struct(CHART, ints, reals | {"weights": weights}, scalars)[0]


def _weights(chart: Chart) -> tuple[int, int, Array]:
    """Arrange the coefficients of q_ref and n_ref in the order in which chart.c reads them.

    Return two numbers of monomials and the coefficients in one row. The first number, ``terms``,
    counts all monomials. n_ref uses only the first ``both`` monomials; ``both`` is the second
    number. Both numbers are rounded up to multiples of 4, because C adds four monomials at a time.
    For each of the first ``both`` monomials, the row has n coefficients of q_ref, then r n
    coefficients of n_refᵀ. For each further monomial, the row has n coefficients of q_ref. Each
    group of n or r n coefficients is padded with a zero to an even length.
    """
    C = np.moveaxis(chart.coefficients, 2, 1)  # (N, 1 + r, n)
    C = np.pad(C, ((0, -len(C) % _FOURS), (0, 0), (0, 0)))
    used = np.flatnonzero(C[:, 1:].any(axis=(1, 2)))
    both = -(-(used.max(initial=0) + 1) // _FOURS) * _FOURS
    q_ref = np.pad(C[:, 0], ((0, 0), (0, C.shape[2] % 2)))
    n_ref = C[:both, 1:].reshape(both, -1)
    n_ref = np.pad(n_ref, ((0, 0), (0, n_ref.shape[1] % 2)))
    first = np.concatenate([q_ref[:both], n_ref], axis=1)
    return len(C), int(both), np.concatenate([first.ravel(), q_ref[both:].ravel()])


def _elimination_order(chart: Chart) -> tuple[list[int], list[int]]:
    """Order rows and columns of J_V by complete pivoting in the middle of the cell.

    J_V (n, n) is the task Jacobian stacked on n_refᵀ; each Newton step solves a linear system with
    J_V. Return n indices of rows, then n indices of columns, in the order of the pivots. The C code
    eliminates in this order, without exchanges.
    """
    q, V = chart.coefficients[0, :, 0], chart.coefficients[0, :, 1:]
    A = np.concatenate([chart.cell.task.jacobian(q), V.T])
    left, rows, columns = np.ones(A.shape, bool), [], []
    for _ in A:
        i, j = np.unravel_index(np.argmax(np.where(left, np.abs(A), -1.0)), A.shape)
        left[i] = left[:, j] = False
        rows.append(int(i))
        columns.append(int(j))
        if A[i, j]:
            A = A - np.outer(A[:, j] / A[i, j], A[i])
    return rows, columns
