"""Largest sectors in a flood whose range of radius depends on the height.

The smallest and the largest radius are polynomials of the height. All nodes between the two
polynomials belong to the flood. A run is a range of radii at one height whose nodes all belong to
the flood; the polynomials lie inside runs. A linear program finds the two polynomials with the
largest area between them. A sector is a cell, a set of poses, in cylindrical coordinates around the
arm. A table is a grid of radius and height around the arm, whose nodes have the indices (i, j) of I
radii and J heights. A flood is the set of nodes that the arm reaches from one configuration without
a change of branch, one of the separate solutions of inverse kinematics. An opening is the set of
nodes of a flood at which bodies keep a distance over a range of the angle around the arm.

``Between`` is a set of nodes between two polynomials of the height: its area, first and last
height, and both polynomials. ``Required`` holds the limits of a function: mean and maximum extra
joint speed relative to J⁺ (0.05 is 5 %), and body distance, m.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.optimize import linprog

from ....base.arguments import Array
from ..fit.trimming import Required
from ..geometry.cell import Cell
from ..geometry.sector import HEIGHT, RADIUS, Sector
from ..geometry.sector_profile import MOST_DEGREE
from .flood import rectangles

SMOOTH = 4
"""Degree of polynomials with smaller second derivatives. A function over a sector between such
polynomials needs fewer cuts, which sometimes leave more of it than of a larger sector."""

_NARROW = 2.0
"""Smallest difference of the two radii, in units of the spacing of the nodes."""

_SHORT = 8
"""Smallest number of spacings from the lowest to the highest height."""

_ROUNDING = 1e-6
"""Relative error of the multipliers of a linear program."""

_STRIDE = 2
"""Step of the lowest and the highest height that are tried, in nodes."""

DEAREST, SHARES = 6.0, 5
"""Largest extra joint speed at a node, relative to the maximum mean, from which on nodes are left
out; and number of such maxima that are tried down to the mean itself."""

SPARE = 0.92
"""Share of the largest extra joint speed up to which nodes belong to a sector whose range of radius
depends on the height: its function costs more than the minimum at some nodes."""


Multipliers = dict[tuple[int, int], list[Array]]
"""Lagrange multipliers of linear programs that were solved, by number of heights and degree."""


class Between(NamedTuple):
    """Nodes between two polynomials of the height; radii are in units of the spacing.

    Attributes
    ----------
    area : float
        Area between the polynomials, in units of the spacing squared; 0 if no polynomials fit.
    first, last : int
        Indices of the lowest and the highest height.
    low, high : (D + 1,) arrays
        Coefficients of two polynomials of degree D, the constant first: the smallest and the
        largest radius, minus the radius of the table's first node. The variable is the height,
        scaled to −1 at ``first`` and 1 at ``last``.
    """

    area: float
    first: int
    last: int
    low: Array
    high: Array

    def inside(self, shape: tuple[int, int], radii: Array | None = None) -> NDArray[np.bool_]:
        """Return a mask, of the given shape (I, J), that is True between the polynomials.

        ``radii`` (I, J) are the radii of the nodes, by default :func:`steps`.
        """
        mask, radii = np.zeros(shape, bool), steps(shape) if radii is None else radii
        if self.area:
            j = np.arange(self.first, self.last + 1)
            z = np.linspace(-1, 1, len(j))
            low, high = (np.polynomial.polynomial.polyval(z, c) for c in (self.low, self.high))
            mask[:, j] = (radii[:, j] >= low - 1e-6) & (radii[:, j] <= high + 1e-6)
        return mask

    @property
    def middle(self) -> tuple[int, int]:
        """Node (i, j) nearest to the mean of both radii at the middle height."""
        return round((self.low[0] + self.high[0]) / 2), (self.first + self.last) // 2

    def sides(self, start: float, spacing: float) -> tuple[Array, Array]:
        """Return the coefficients of the smallest and of the largest radius in m: two (D + 1,).

        ``start`` is the radius of the table's first node, m, and ``spacing`` the distance of
        neighbouring nodes, m.
        """
        least = np.eye(1, len(self.low))[0] * start
        return least + spacing * self.low, least + spacing * self.high

    @classmethod
    def none(cls) -> Between:
        """Make the result for runs in which no two polynomials fit: it has the area 0."""
        return cls(0.0, 0, 0, np.zeros(1), np.zeros(1))


def steps(shape: tuple[int, int]) -> Array:
    """Return the radii (I, J) of a table's nodes from its first node, in units of the spacing."""
    return np.repeat(np.arange(shape[0], dtype=float)[:, None], shape[1], axis=1)


def runs(mask: NDArray[np.bool_], first: NDArray[np.intp], last: NDArray[np.intp]) -> Array:
    """Choose one run at each of J heights, up and down from the middle of a rectangle: (J, 2).

    A run is a range of radii at one height at which the mask (I, J) is True throughout. ``first``
    and ``last`` are the indices (i, j) of opposite corners of the rectangle. At each height of the
    rectangle, the run is taken that overlaps most with the rectangle. Above and below the
    rectangle, the run is taken that overlaps most with the chosen run at the neighbouring height. A
    row of the result has the first and the last index i of the run, or −1 twice without a run.
    """
    middle = int(first[1] + last[1]) // 2
    rectangle = int(first[0]), int(last[0])
    edges = np.diff(np.pad(mask, ((1, 1), (0, 0))).astype(int), axis=0).T
    found = np.full((mask.shape[1], 2), -1)
    for way in (1, -1):
        run, j = rectangle, middle
        while 0 <= j < mask.shape[1]:
            within = first[1] <= j <= last[1]
            there = _overlapping(np.flatnonzero(edges[j]), *(rectangle if within else run))
            if there is None:
                break
            run = found[j] = there
            j += way
    return found


def _overlapping(edges: NDArray[np.intp], low: int, high: int) -> tuple[int, int] | None:
    """Find the run at one height that overlaps most with the indices ``low`` to ``high``.

    ``edges`` (2 R,) has two indices of the radius for each of R runs: its first one, and the one
    after its last. Return the first and the last index of the run found; None without overlap.
    """
    starts, ends = edges[::2], edges[1::2] - 1
    overlap = np.minimum(ends, high) - np.maximum(starts, low)
    if not len(overlap) or overlap.max() < 0:
        return None
    best = int(np.argmax(overlap))
    return int(starts[best]), int(ends[best])


def largest_between(
    ends: Array, least: float = 0.0, degree: int = MOST_DEGREE, known: Multipliers | None = None
) -> Between:
    """Find the two polynomials with the largest area between them, inside the runs ``ends`` (J, 2).

    A row of ``ends`` has the first and the last index of the radius at one height, or −1 twice. The
    polynomials may extend over any range of heights. The area of the runs over a range is an upper
    bound of the area between polynomials. Ranges are tried in descending order of this bound. The
    search ends when the bound does not exceed the best area found so far, or does not exceed
    ``least``. So a result with an area of at most ``least``, in units of the spacing squared, may
    be missed. ``degree`` is the maximum degree of the polynomials. ``known`` are multipliers of
    other searches, see :func:`_between`; those of this search are added.
    """
    known = {} if known is None else known
    there = np.flatnonzero(ends[:, 0] >= 0)
    if len(there) <= _SHORT:
        return Between.none()
    length = (ends[:, 1] - ends[:, 0]).astype(float)
    total = np.concatenate([[0.0], np.cumsum((length[1:] + length[:-1]) / 2)])
    low, high = int(there[0]), int(there[-1])
    pairs = [
        (float(total[j] - total[i]), i, j)
        for i in range(low, high - _SHORT + 1, _STRIDE)
        for j in range(high, i + _SHORT - 1, -_STRIDE)
    ]
    best = Between.none()
    for bound, i, j in sorted(pairs, reverse=True):
        if bound <= max(best.area, least):
            break
        if length[i : j + 1].min() < _NARROW:
            continue
        best = _between(ends[i : j + 1].astype(float), i, j, degree, best, known)
    return best


def _between(
    ends: Array, first: int, last: int, degree: int, best: Between, known: Multipliers
) -> Between:
    """Find the two polynomials inside runs, with the largest area between them.

    Return ``best`` instead if its area is as large, or if no polynomials fit. ``ends`` (L, 2) has
    the runs at the L heights with the indices ``first`` to ``last``. The degree is at most
    ``degree``, and at most (L − 1) / 2. The polynomials are constrained only at the L heights; a
    higher degree could leave the runs between them.

    Linear programs with the same L and degree differ only in the bounds of their constraints. So
    the multipliers of one, times the bounds of another, are an upper bound of the other's area. If
    it is no larger than that of ``best``, the program is not solved; else its multipliers are added
    to ``known``.
    """
    degree = min(degree, (len(ends) - 1) // 2)
    most = np.concatenate([-ends[:, 0], ends[:, 1], np.full(len(ends), -_NARROW)])
    multipliers = known.setdefault((len(ends), degree), [])
    if any(each @ most <= best.area / (1 + _ROUNDING) for each in multipliers):
        return best
    V = chebyshev.chebvander(np.linspace(-1, 1, len(ends)), degree)
    weights = np.ones(len(ends))
    weights[[0, -1]] = 0.5
    none, sums = np.zeros_like(V), weights @ V
    found = linprog(
        np.concatenate([sums, -sums]),
        np.block([[-V, none], [none, V], [V, -V]]),
        most,
        bounds=(None, None),
        method="highs",
    )
    if found.status:
        return best
    multipliers.append(-found.ineqlin.marginals)
    if -found.fun <= best.area:
        return best
    low, high = (chebyshev.cheb2poly(c) for c in np.split(found.x, 2))
    low, high = (np.pad(c, (0, degree + 1 - len(c))) for c in (low, high))
    return Between(-float(found.fun), first, last, low, high)


def area_of(cell: Cell) -> float:
    """Compute the area of a sector's range of radius and height, m².

    If the range of radius is the same at all heights, the area is the product of both ranges.
    """
    w = cell.widths
    stretch = cell.profile.mean_stretch(w[HEIGHT]) if isinstance(cell, Sector) else 1.0
    return float(4 * w[RADIUS] * w[HEIGHT] * stretch)


def affordable_between(
    mask: NDArray[np.bool_],
    own: Array,
    usual: Array,
    limits: Required,
    least: float = 0.0,
    degree: int = MOST_DEGREE,
    radii: Array | None = None,
    known: Multipliers | None = None,
) -> Between:
    """Find the largest part of one opening, between two polynomials, that keeps speed limits.

    The two polynomials of the height are the smallest and the largest radius. ``mask`` (I, J) has
    the nodes of the opening; ``own`` and ``usual`` (I, J) are the squared joint speeds of a
    function and of J⁺ at the nodes. At each node of the part, the extra joint speed is below 92 %
    of ``limits.worst``. Nodes with the largest extra joint speed are left out until the mean over
    the part is below ``limits.mean``. A part of at most the area ``least``, in units of the spacing
    squared, may be missed. ``degree`` is the maximum degree of the polynomials. The nodes have the
    ``radii`` (I, J), by default those of :func:`steps`. ``known`` are multipliers of other
    searches, see :func:`largest_between`. The area of the result is 0 if nothing is found.
    """
    best = Between.none()
    radii, known = steps(mask.shape) if radii is None else radii, {} if known is None else known
    with np.errstate(invalid="ignore"):
        extra = np.where(mask, np.sqrt(own / usual) - 1, np.nan)
        most = np.minimum(limits.mean * np.geomspace(DEAREST, 1, SHARES), SPARE * limits.worst)
        for highest in sorted({SPARE * limits.worst, *most}, reverse=True):
            good = extra < highest
            if most_between(good) <= least:
                break
            (first,), (last,) = rectangles(good[None])[1:]
            ends = runs(good, first, last)
            at = np.take_along_axis(radii, np.maximum(ends, 0).T, axis=0).T
            found = largest_between(np.where(ends < 0, -1.0, at), least, degree, known)
            inside = found.inside(mask.shape, radii) & mask
            if found.area and np.sqrt(own[inside].sum() / usual[inside].sum()) < 1 + limits.mean:
                best = max(best, found, key=lambda one: one.area)
                break
    return best


def most_between(mask: NDArray[np.bool_]) -> float:
    """Compute an upper bound of the area of any sector of True nodes of a mask (I, J).

    The sector's range of radius may depend on the height. The area is in spacings², the squared
    distance of neighbouring nodes.
    """
    return float(np.maximum(mask.sum(axis=0) - 1, 0).sum())


def more_between(mask: NDArray[np.bool_], least: float) -> bool:
    """Test whether a sector of True nodes of a mask (I, J) can have more area than ``least``.

    The sector's range of radius may depend on the height. Areas are in spacings², the squared
    distance of neighbouring nodes.
    """
    return most_between(mask) > least
