r"""Existence, uniqueness and margins of a cell's function F, bounded over boxes of poses, in C.

F is the inverse kinematic function of the cell: it gives one configuration q = F(u) of the arm's n
joints for each pose. A cell is a box of poses, and its k coordinates u range from −1 to 1; a sector
is a cell in cylindrical coordinates around an axis, with two tilts of the tool, and its spin about
its own axis. A search divides the cell into boxes ``Uc ± half`` of coordinates. The functions take
K such boxes at a time.

The chart of F is a pair of polynomials in u: q_ref (n,) approximates F, and n_ref (n, r)
approximates the null space of J. F solves ``f(q) = x(u)`` and ``n_refᵀ (q − q_ref) = 0``; f is the
forward kinematics, and x(u) is the pose.

On each box, Taylor models of q_ref, n_ref and x are computed: polynomials with bounds on their
errors. Coordinates of x that the task leaves free are those of f(q_ref). From these models follow
models of the joint screws J at q_ref, and of the displacement ξ from f(q_ref) to x. They are
expressed in the frame of one link of the arm, the middle link, which is chosen so that the bounds
are tight. J_V is J stacked on n_refᵀ. Let A be an approximation of J_V⁻¹ at the centre of the box,
D a matrix, and Y and g vectors; inequalities hold entry by entry. If the first bound holds for all
u of the box and all q with ``|q − q_ref(u)| ≤ g``, then

.. math:: |A J_V(q, u) − 1| ≤ D, \qquad |A ξ| + D Y ≤ Y ≤ g ⇒ |F − q_{ref}| ≤ Y

The values of F are the leaf of r potentials. The gradients V (n, r) of the potentials on the leaf
are ``Vᵀ = n_refᵀ − W J`` with ``W E = w``. Here ∂ is the derivative with respect to the task's
coordinates, a column of E is the twist of the pose per unit of one of them, and
``w = n_refᵀ ∂q_ref − (∂n_refᵀ) (F − q_ref)``. V and the null space of J are expanded to first order
along F. From both follows a bound on the leaf margin σ_min(Nᵀ V̂): the columns of N and V̂ are
orthonormal bases of the null space and of V. The reciprocal of the leaf margin, minus 1, is the
extra joint speed in the worst direction, relative to J⁺.

F is proved to be the only solution near c, a continuous function q = c(u) on the cell: q_ref with a
correction, see :class:`_Correction`. d* (n,), rad or m, is a distance from c within which F is the
only solution. Some distances d* are tried, see :attr:`CellProof.distances`.

docs/theory.md derives this.

``Points`` are the configurations Q (K, n) of a function q = F(u) at K poses, with the kinematics
there. ``Chain`` is a serial chain of joints, with the screws (twists per joint speed) in the frame
of a middle link. ``CellBounds`` are proved bounds on the margins of a function F on K boxes of
poses. ``Chart`` is the chart of a function F, with its cell.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import factorial

from ...base.arguments import Array, read_only
from ...native import CELL, MARGINS, filled_struct, required_library
from ..cells.chart.chart import Chart, Points
from ..cells.chart.monomials import Monomials
from ..cells.geometry.cell import Cell
from ..cells.geometry.sector import ANGLE, HEIGHT, RADIUS, SPIN, Sector
from ..cells.geometry.sector_profile import STRAIGHT
from .chain import FREE, Chain, chain_of, relative_rounding, tool_reach
from .taylor import ORDER, basis, space_of

_SLACKS = (1.25, 0.02), (1.1, 0.005), (1.02, 0.001)
"""Factors, and summands in rad or m, from which d* is made; the largest d* comes first.

d* is the distance from c within which F is proved to be unique: the factor times the largest
distance of F from c that a search found, plus the summand.
"""

_NEARER = 0.75 ** np.arange(1, 17)
"""Factors of the last of these d*, for boxes on which F is nearer to c than elsewhere."""

_INTERVALS = {1: 32, 2: 32, 3: 16}
"""Number of intervals of the grid of c along each of k coordinates; with more coordinates, c is
q_ref, because the grid would have too many nodes."""

_TURNED = {"pose": 0, "axis": 2}
"""First of the frame's axes whose direction a kind of task controls; the others control none."""

_TILT = 3
"""Index of a sector's first tilt among the coordinates of the task."""

_SIZES, _CORNERS = 0.16 * 0.75 ** np.arange(6.0), 4
"""Half-widths, in u, of boxes on which middle links are compared, and the number of corners of the
cell at which they lie."""


@dataclass(frozen=True, eq=False)
@read_only
class CellBounds:
    """Bounds on the margins of the function F of a cell, on each of K boxes of poses.

    Attributes
    ----------
    leaf_margin, sigma_min, limit_margin : (K,) arrays
        Lower bounds on the leaf margin ``σ_min(Nᵀ V̂)``, on σ_min(J), and on the distance of F to
        the joint limits, rad or m. Where F was not proved to exist, the bounds are 0, 0 and −inf.
    split : (K,) array of int
        Index of the coordinate u along which to halve each box if its bounds are too weak.
    level : (K,) array of int
        Index among :attr:`CellProof.distances` of the distance d* from c within which F was proved
        to be the only solution; −1 where no d* was proved.
    Q, reach : (K, n) arrays
        Centres and half-widths, rad or m, of boxes of joints. On each box of poses, F(u) lies in
        the corresponding box of joints. NaN where F was not proved to exist.
    """

    leaf_margin: Array
    sigma_min: Array
    limit_margin: Array
    split: NDArray[np.int32]
    level: NDArray[np.int32]
    Q: Array
    reach: Array


class CellProof:
    """Bounds for the function F of one cell on boxes of poses, computed in C.

    The search over the cell requests bounds on ever smaller boxes, until F is proved to exist, with
    its margins, on all boxes. F is proved to be the only solution within d* of c, a continuous
    function on the cell near F: q_ref, corrected by :class:`_Correction`.

    Parameters
    ----------
    chart
        Chart of the function, with its cell.

    Attributes
    ----------
    distances : (L, n) array
        The L distances d* from c, rad or m, the largest first; each is above the next one in every
        joint. On each box of poses, F is proved to be the only solution within one of these
        distances. At a pose that two boxes share, both boxes have the same F: F lies within the
        smaller d* of the two, so also within the larger d*.

    Raises
    ------
    InputError
        If there is no native library, the compiled C code of this package.
    """

    def __init__(self, chart: Chart) -> None:
        self.use(required_library("a proof"))
        cell = chart.cell
        self.chart, self.cell, self.task = chart, cell, cell.task
        self.polynomials, self.poses = _Polynomials.of(chart), _pose_tables(cell)
        self._space = space_of(cell.k)
        self.lower, self.upper = limits_of(cell)
        self._correction = _Correction.of(chart)
        self.distances = _nested(farthest(cell, self._found_away))
        whole = chain_of(self.task)
        self.eps = relative_rounding(whole)
        value = self.polynomials.sizes
        self.blur = self.eps * (1 + chart.monomials.size / 64) * value  # (n, 1 + r)
        self.farthest = value[:, 0] + self._correction.most + self.near
        made = [whole.seen_from(k, way) for k in range(1, len(whole.p)) for way in (0.0, 0.5, 1.0)]
        # the middle link with the largest bounds on boxes at corners of the cell
        at = np.random.default_rng(0).choice([-1.0, 1.0], (_CORNERS, cell.k))
        half = np.repeat(np.tile(_SIZES[:, None], (1, cell.k)), _CORNERS, axis=0)
        Uc = (1 - half) * np.tile(at, (len(_SIZES), 1))
        boxes = Uc, half, self.start(Uc, half)
        self.see_from(max(made, key=lambda chain: self._tightness(chain, *boxes)))

    @property
    def near(self) -> Array:
        """Largest of the distances d* from c that are tried: (n,)."""
        return np.asarray(self.distances[0])

    def center(self, points: Points) -> Array:
        """Return c at the poses of K configurations: (K, n)."""
        return points.q_ref + self._correction.at(points.U)

    def away(self, points: Points) -> Array:
        """Return the distance ``|q − c|`` of K configurations from c at their poses: (K, n)."""
        return np.asarray(np.abs(points.Q - self.center(points)))

    def _found_away(self, U: Array) -> Array:
        """Return ``|F − c|`` at coordinates U (K, k), and 0 where F is not found: (K, n)."""
        points = self.chart.solve(U)
        return np.where(points.found[:, None], self.away(points), 0.0)

    def within(self, level: int) -> str:
        """Describe, as text, the distance d* from c within which F is the only solution.

        ``level`` is the index, among :attr:`distances`, of the smallest d* that a box needed. The
        text has the largest d* and, if some boxes needed a smaller one, the smallest.
        """
        first, last = (", ".join(f"{v:.2g}" for v in self.distances[index]) for index in (0, level))
        more = f", on some boxes within ({last})" if level else ""
        return f"within ({first}) of {self._correction}{more}"

    def use(self, native: ctypes.CDLL) -> None:
        """Use the given native library: later calls run its function ``cell_bounds``."""
        self._run = native.cell_bounds
        self._run.restype = ctypes.c_int

    def see_from(self, chain: Chain) -> None:
        """Set the middle link, in whose frame the joint screws are expressed.

        ``chain`` is the arm with the middle link to use. The bounds are valid for every middle
        link, but tighter for some.
        """
        self.chain = chain
        self._chain = chain.struct()
        self._cell = self._cell_struct()

    def _tightness(self, chain: Chain, Uc: Array, half: Array, start: Array) -> float:
        """Set the middle link, and return the sum of K lower bounds of the leaf margin.

        The bounds are those on K boxes Uc ± half, (K, k) each. ``chain`` is the arm with the middle
        link, which later calls use, too. ``start`` (K, n, 1 + k) estimates F − q_ref on each box:
        the value at the centre, then k slopes times ``half``. The larger the sum, the fewer boxes
        the proof is expected to need.
        """
        self.see_from(chain)
        return float(self.bounds_from(Uc, half, start).leaf_margin.sum())

    def bounds(self, Uc: Array, half: Array) -> CellBounds:
        """Bound the margins of F on boxes Uc ± half, (K, k) each, in the cell's coordinates u."""
        return self.bounds_from(Uc, half, self.start(Uc, half))

    def bounds_from(
        self, Uc: Array, half: Array, start: Array, gradients: Array | None = None
    ) -> CellBounds:
        """Bound the margins of F on boxes of poses, given an estimate of F − q_ref on each.

        Parameters
        ----------
        Uc, half : (K, k) arrays
            Centres and half-widths of the boxes, in the cell's coordinates u.
        start : (K, n, 1 + k) array
            Estimate of F − q_ref on each box: the value at the centre, then k slopes times
            ``half``.
        gradients : (K, r, n, 2 + k) array, optional
            Array to fill with first-order expansions in u of the r gradients V along F. Its last
            axis holds V at the centre, the k slopes times ``half``, and a bound on the difference
            of V from the expansion. Boxes where F was not proved to exist are left unchanged.
        """
        K, n = len(Uc), self.chain.n
        leaf, sigma, limit = np.zeros((3, K))
        Q, reach = np.full((2, K, n), np.nan)
        split, level = np.zeros((2, K), np.int32)
        arrays = (leaf, sigma, limit, Q, reach, gradients, split, level)
        out = MARGINS(*(None if x is None else x.ctypes.data for x in arrays))
        beside = self._correction.beside(Uc, half, start)
        shift = np.concatenate([start, beside[:, :, None]], axis=2)
        given = [np.ascontiguousarray(x, float) for x in (Uc, half, shift)]
        done = self._run(
            ctypes.byref(self._cell),
            ctypes.c_long(K),
            *(ctypes.c_void_p(x.ctypes.data) for x in given),
            ctypes.byref(out),
        )
        if not done:
            raise MemoryError("no memory for the Taylor models of a cell")
        return CellBounds(leaf, sigma, limit, split, level, Q, reach)

    def start(self, Uc: Array, half: Array) -> Array:
        """Estimate F − q_ref to first order on boxes Uc ± half, (K, k) each: (K, n, 1 + k).

        The first column is the value at the centre, rad or m; the k others are the slopes with
        respect to u, times ``half``. The proof is valid with any estimate, but tight only with a
        good one. The estimate is 0 where F is not found, or differs from c by more than d*.
        """
        k = self.cell.k
        points = self.chart.solve(Uc)
        dF, _ = self.chart.derivative(points)
        away = points.Q - points.q_ref
        slopes = (dF[..., :k] - self.chart.slopes(Uc)[0]) * half[:, None]
        shift = np.concatenate([away[..., None], slopes], axis=2)
        near = points.found & (self.away(points) <= self.near).all(axis=1)
        near &= np.isfinite(slopes).all(axis=(1, 2))
        return np.where(near[:, None, None], shift, 0.0)

    def _tables(self) -> dict[str, ArrayLike]:
        """Return the integer arrays of the C struct CELL by name: the tables of the monomials."""
        k, parts = self.cell.k, self.polynomials
        made = Monomials(k, max(self.chart.monomials.degree, ORDER))
        models = Monomials(k, ORDER)
        return {
            "parent": made.parent,
            "variable": made.variable,
            "used": parts.used,
            "fourth": [np.repeat(np.arange(k), row) for row in parts.fourth],
            "beneath": models.lower,
            "powers": models.exponents.T,
        }

    def _cell_struct(self) -> ctypes.Structure:
        """Create the C struct CELL, which holds the chain, the chart, the poses and the bounds."""
        chain, poses, parts = self.chain, self.poses, self.polynomials
        kind = self.task.kind
        # bounds of the chart, the joints and the tool
        reals: dict[str, ArrayLike] = {
            "parts": np.moveaxis(parts.parts, 1, 0),
            "rest": parts.rest,
            "blur": self.blur,
            "near": self.distances,
            "lower": self.lower,
            "upper": self.upper,
            "farthest": self.farthest,
            "bases": [basis(axis) for axis in chain.a],
            "tips": _tips(chain, self.farthest),
        }
        reals |= poses
        # sizes and flags
        scalars = {
            "chain": ctypes.addressof(self._chain),
            "space": self._space,
            "eps": self.eps,
            "r": self.task.r,
            "w": self.blur.size,
            "terms": self.chart.monomials.size,
            "F": len(parts.fourth),
            "turning": int(poses["Omega"].any()),
            "angled": int(poses["angle"].any()),
            "spun": int(poses["spin"].any()),
            "m": self.task.m,
            "removed": poses["along"].shape[1],
            "levels": len(self.distances),
            **_bent_coordinates(self.cell),
            "turned": _TURNED.get(kind, 3),
            "slides": sum(1 << "xyz".index(axis) for axis in FREE[kind][0]),
            "tool": tool_reach(chain),
            "columns": float(np.abs(chain.S).sum(axis=0).max()),
        }
        return filled_struct(CELL, self._tables(), reals, scalars)[0]


def _tips(chain: Chain, farthest: Array) -> Array:
    """Bound the distances of the chain's P joint origins from the end-effector frame: (P,), m.

    A bound is the sum of the lengths of the links between joint and frame, plus the strokes of the
    prismatic joints between them. ``farthest`` (n,) bounds the absolute joint positions |q|, rad or
    m.
    """
    slides = np.abs(chain.S[:, : chain.n]) @ farthest + np.abs(chain.o)
    lengths = np.linalg.norm(chain.p, axis=1) + np.where(chain.revolute, 0.0, slides)
    return np.asarray(lengths[::-1].cumsum()[::-1] - lengths)


def farthest(cell: Cell, away: Callable[[Array], Array]) -> Array:
    """Find the largest distance ``|F − c|`` in a cell, per joint: (n,), rad or m.

    ``away`` evaluates ``|F − c|`` at K poses in the coordinates of the cell, (K, k) → (K, n).
    Random poses and corners are evaluated, then poses around those with the largest distances. The
    result is sampled, not proved; the distances d* to be tried are made from it.
    """
    rng = np.random.default_rng(1)
    Y = np.concatenate([cell.sample(2048, 1), cell.corners()])
    found = away(Y)
    most, width = found.max(axis=0), 0.4
    for _ in range(5):
        worst = np.unique(np.argsort(-found, axis=0)[:4].ravel())
        near = Y[worst, None] + rng.uniform(-width, width, (len(worst), 24, cell.k))
        Y = np.concatenate([Y[worst], np.clip(near, -1, 1).reshape(-1, cell.k)])
        found, width = away(Y), width / 2
        most = np.maximum(most, found.max(axis=0))
    return np.asarray(most)


@dataclass(frozen=True, eq=False)
@read_only
class _Correction:
    """Correction ``Δ(u) = c(u) − q_ref(u)`` of a chart: F − q_ref at the nodes of a grid.

    Between the nodes, Δ is linear along each coordinate, so c is continuous. Where J is nearly
    singular, F can differ from the polynomial q_ref by 0.2 rad, and a second solution can be near
    F. The distance of F from c is smaller, so that a neighbourhood of c contains F but no second
    solution.

    Attributes
    ----------
    lines : (G + 1,) array
        Coordinates of the nodes along each coordinate, from −1 to 1; G is the number of intervals.
    values : (G + 1, …, G + 1, n) array
        Δ at the nodes; 0 where F is not found.
    """

    lines: Array
    values: Array

    @classmethod
    def of(cls, chart: Chart) -> _Correction:
        """Evaluate the correction of a chart's q_ref at the nodes of a grid."""
        k, n = chart.cell.k, chart.cell.task.n
        lines = np.linspace(-1, 1, 1 + _INTERVALS.get(k, 1))
        shape = (len(lines),) * k
        if k not in _INTERVALS:
            return cls(lines, np.zeros((*shape, n)))
        points = chart.solve(np.stack(np.meshgrid(*[lines] * k, indexing="ij"), -1).reshape(-1, k))
        values = np.where(points.found[:, None], points.Q - points.q_ref, 0.0)
        return cls(lines, values.reshape(*shape, n))

    def __str__(self) -> str:
        if not self.values.any():
            return "q_ref"
        size = " × ".join(map(str, self.values.shape[:-1]))
        return f"its linear interpolation on a grid of {size} poses"

    @property
    def most(self) -> Array:
        """Largest ``|Δ|`` on the cell, per joint: (n,)."""
        return np.abs(self.values).reshape(-1, self.values.shape[-1]).max(axis=0)

    def at(self, U: Array) -> Array:
        """Evaluate Δ at coordinates U (K, k): (K, n)."""
        G = len(self.lines) - 1
        place = (np.clip(U, -1, 1) + 1) / 2 * G
        low = np.minimum(place.astype(int), G - 1)
        share = place - low
        value = np.zeros((len(U), self.values.shape[-1]))
        for corner in np.ndindex(*(2,) * U.shape[1]):
            weight = np.where(corner, share, 1 - share).prod(axis=1)
            value += weight[:, None] * self.values[tuple((low + corner).T)]
        return value

    def beside(self, Uc: Array, half: Array, start: Array) -> Array:
        """Bound ``|q_0 − c| = |η − Δ|`` on boxes Uc ± half, (K, k) each: (K, n).

        q_0 = q_ref + η is the estimate of F from which a proof starts. ``start`` (K, n, 1 + k) is
        η: the value of F − q_ref at the centre, and k slopes times ``half``. The lines of the grid
        cut each box into parts. On each part, η − Δ is linear along each coordinate, so its largest
        absolute value is at a corner of the part.
        """
        if not self.values.any():
            return np.asarray(np.abs(start).sum(axis=2) * (1 + 1e-12))
        k, low, high = Uc.shape[1], np.maximum(Uc - half, -1.0), np.minimum(Uc + half, 1.0)
        first = np.searchsorted(self.lines, low, side="right")
        most = int((np.searchsorted(self.lines, high, side="left") - first).max(initial=0))
        cuts = [self.lines[np.minimum(first + i, len(self.lines) - 1)] for i in range(most)]
        ends = np.stack([low, *(np.clip(cut, low, high) for cut in cuts), high])
        # all corners of all parts of each box: (number, K, k)
        which = np.stack(np.meshgrid(*[np.arange(len(ends))] * k, indexing="ij"), -1).reshape(-1, k)
        U = np.stack([ends[which[:, a], :, a] for a in range(k)], axis=2)
        eta = start[..., 0] + np.einsum("Kna,PKa->PKn", start[..., 1:], (U - Uc) / half)
        found = np.abs(eta - self.at(U.reshape(-1, k)).reshape(eta.shape)).max(axis=0)
        return np.asarray(found * (1 + 1e-12) + 1e-13)


def _nested(found: Array) -> Array:
    """Make the L distances d* (L, n), the largest first, that are tried in a proof, rad or m.

    They are multiples of ``found`` (n,), the largest sampled distance ``|F − c|`` of each joint,
    plus a small summand.
    """
    first = [factor * found + more for factor, more in _SLACKS]
    return np.array([*first, *np.outer(_NEARER, first[-1])])


def limits_of(cell: Cell) -> tuple[Array, Array]:
    """Return the joint limits (lower, upper) that F of a cell must keep, (n,) each, rad or m.

    The coordinates u leave out a coordinate of a sector if a single joint moves the frame along it.
    The proof then covers F in the middle of that coordinate's range. So the limits of this joint
    are narrowed by the half-width of the range: from the middle, the joint can move the frame over
    the whole range. A coordinate with the range ``"all"`` goes as far as its joint can move, so F
    need not keep the limits of this joint: the result is −inf and inf.
    """
    lower, upper = cell.task.lower, cell.task.upper
    lower, upper = lower.copy(), upper.copy()
    for one in cell.removed:
        free = one.coordinate in cell.free
        width = -np.inf if free else float(cell.widths[one.coordinate])
        lower[one.joint] += width
        upper[one.joint] -= width
    return lower, upper


@dataclass(frozen=True, eq=False)
@read_only
class _Polynomials:
    """The polynomials q_ref and n_ref of a chart, prepared for expansion to degree 3 on boxes.

    The last axis of the arrays holds q_ref, then the r columns of n_ref. p(u) is one of these
    polynomials: an entry of q_ref or n_ref. ∂^α p is a derivative of p. The tuple α has one
    exponent per coordinate of u, and α! is the product of their factorials.

    Attributes
    ----------
    chart : Chart
        The chart.
    parts : (T, M, n, 1 + r) array
        Coefficients of the polynomials ``∂^α p / α!`` in the chart's T monomials, for each of the M
        tuples α with a sum of at most 3.
    fourth : (B, k) array of int
        The B tuples α with the sum 4.
    rest : (B, n, 1 + r) array
        Bounds on ``|∂^α p / α!|`` over the whole cell, for the tuples ``fourth``.
    sizes : (n, 1 + r) array
        Sums over the M tuples of the bounds on ``|∂^α p / α!|``; rounding errors are relative to
        these sums.
    """

    chart: Chart
    parts: Array
    fourth: Array
    rest: Array
    sizes: Array

    @classmethod
    def of(cls, chart: Chart) -> _Polynomials:
        """Compute the derivatives of a chart's polynomials to order 3, and bounds on the fourth.

        The bounds limit the error of an expansion to degree 3. A bound is the sum of the absolute
        coefficients of a polynomial, because |u_i| ≤ 1.
        """
        monomials = chart.monomials
        derivatives = Monomials(monomials.k, ORDER + 1)
        every = [chart.coefficients]
        for i in range(1, derivatives.size):
            lower, j = every[derivatives.parent[i]], int(derivatives.variable[i])
            every.append(monomials.derivative(lower, j))
        factorials = factorial(derivatives.exponents).prod(axis=1)
        scaled = np.stack(every, axis=1) / factorials[:, None, None]
        low = int(derivatives.starts[ORDER + 1])
        sizes = np.abs(scaled[:, :low]).sum(axis=(0, 1))
        rest = np.abs(scaled[:, low:]).sum(axis=0) * (1 + 1e-12)
        return cls(chart, scaled[:, :low], derivatives.exponents[low:], rest, sizes)

    @property
    def used(self) -> Array:
        """Number of monomials that each of the M derivatives ``∂^α p`` can contain: (M,).

        If the number is t, the derivative contains only the first t of the chart's T monomials.
        """
        monomials = self.chart.monomials
        orders = Monomials(monomials.k, ORDER).exponents.sum(axis=1)
        return np.asarray(monomials.starts[np.maximum(monomials.degree - orders + 1, 0)])


def _pose_tables(cell: Cell) -> dict[str, Array]:
    r"""Return the arrays, by name, from which C computes the poses of a cell and their velocities.

    The position at the coordinates u is ``p = o + R_a(φ) (d + D u)``, the rotation ``R = R_a(φ)
    exp(\hat{Ω u}) R_0 R_z(ψ)``. The matrix Ω (3, k) is named ``Omega`` below. R_a rotates about a
    sector's axis, R_z about the tool's z axis; the angles φ and ψ are linear in u. If a sector's
    range of radius depends on the height, ``(b(η) + (s(η) − 1) y) e`` is added to ``D u``. Here η,
    m, is the height above the middle, y, m, the radial displacement that D u has, and e the radial
    direction at the cell's centre; b, m, and s are polynomials.

    Velocities are given along each of the m task coordinates: first the k coordinates u, then the l
    coordinates that symmetries remove from u, then those that are constant in the cell.

    Returns
    -------
    o, a : (3,) arrays
        Point, m, and direction of the axis of R_a.
    d, R0 : (3,) and (3, 3) arrays
        Position relative to o, m, and orientation of the cell's centre.
    D, Omega : (3, k) arrays
        Displacement, m, and rotation, rad, per coordinate.
    angle, spin : (k,) arrays
        φ and ψ per coordinate, rad; 0 in a cell that is not a sector.
    way, turn : (m, 3) arrays
        Displacement, m, and rotation, rad, per metre or radian of each task coordinate. The axes
        are those of the base; R_a(φ) is not applied yet.
    around, twirl : (m,) arrays
        ``around`` is 1 for the coordinate φ, else 0; ``twirl`` is 1 for the coordinate ψ, else 0.
    outward, profile : (3,) and (2, g + 1) arrays
        The direction e; and the coefficients of b and of s, one row each, from η⁰ to η^g.
    widths : (k,) array
        Metres or radians per unit of u.
    along : (n, l) array
        Joint velocities per unit of each coordinate that symmetries remove.
    """
    o, a, rates = _coordinate_rates(cell)
    moved, removed = cell.moved, np.array(cell._removed, int)
    others = np.setdiff1d(np.arange(cell.task.m), np.concatenate([moved, removed]))
    rates = rates[np.concatenate([moved, removed, others])]
    widths = cell.widths[moved]
    own = widths[:, None] * rates[: cell.k]
    R0 = cell.placement.rotation
    tables = {"o": o, "a": a, "d": cell.placement.translation - o, "R0": R0}
    tables |= {"D": own[:, :3].T, "Omega": own[:, 3:6].T}
    tables |= {"angle": own[:, 6], "spin": own[:, 7]}
    tables |= {"way": rates[:, :3], "turn": rates[:, 3:6]}
    tables |= {"around": rates[:, 6], "twirl": rates[:, 7]}
    tables |= {"outward": np.zeros(3), "profile": np.array(STRAIGHT)}
    if isinstance(cell, Sector):
        tables |= {"outward": cell.directions[0], "profile": np.array(cell.profile)}
    return tables | {"widths": widths, "along": cell.along}


def _bent_coordinates(cell: Cell) -> dict[str, int]:
    """Return the degree of a sector's profile, and the indices of the radius and the height in u.

    The keys of the three numbers are "bent", "radial" and "upright", which are members of the C
    struct CELL. The profile describes how the range of radius depends on the height. Without such a
    dependence, all three numbers are 0.
    """
    if not (isinstance(cell, Sector) and cell.profile.degree):
        return {"bent": 0, "radial": 0, "upright": 0}
    moved = list(cell.moved)
    return {
        "bent": cell.profile.degree,
        "radial": moved.index(RADIUS),
        "upright": moved.index(HEIGHT),
    }


def _coordinate_rates(cell: Cell) -> tuple[Array, Array, Array]:
    """Return a point (3,), m, and the direction (3,) of a cell's axis, and a table of rates (6, 8).

    Row i of the table belongs to coordinate i of the cell, in m or rad; rows from m on are not
    used. The first six columns are the displacement (3), m, and the rotation (3), rad, of the frame
    per unit of the coordinate, at the cell's middle, in base axes. For the angle and the spin of a
    sector, these are 0; instead, column 6 is 1 for the angle, and column 7 for the spin. A box of
    poses has no axis; the point and the direction are then those of the base's z axis.
    """
    m, R0, rows = cell.task.m, cell.placement.rotation, len(cell.half_width)
    rates = np.zeros((6, 8))
    if isinstance(cell, Sector):
        outward, _, up = cell.directions
        rates[RADIUS, :3], rates[HEIGHT, :3] = outward, up
        rates[_TILT : _TILT + 2, 3:6] = R0[:, :2].T
        rates[ANGLE, 6] = rates[SPIN, 7] = 1.0
        return *cell.axis, rates
    rates[:rows, :3] = np.eye(3)[cell.task.rows[:rows]]
    about = np.eye(3) if cell.task.kind == "pose" else R0.T
    rates[rows:m, 3:6] = about[: m - rows]
    return np.zeros(3), np.array([0.0, 0.0, 1.0]), rates
