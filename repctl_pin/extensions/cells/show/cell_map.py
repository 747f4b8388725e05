"""Map of the workspace: sections of the places where a box of poses works, and its price.

The price is the extra joint speed of a function that gives one configuration for each pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from ....base.arguments import Array, read_only
from ....base.progress import Report
from ....model.bodies import bodies_of
from ..chart.monomials import Monomials
from ..evaluate.reach import STEPS, Grown, drawn, grown
from ..geometry.cell import Cell
from ..geometry.kinematics import bases, placed, rows_of

_DRAWN, _GRID, _NEAREST, _AGAIN = 2048, 27, 4, 2
"""Number of random configurations, of places along the longer side of a section, of nearest
configurations from which each place is solved, and of rounds from the configurations beside it."""


@dataclass(frozen=True, eq=False)
@read_only
class Section:
    """Plane of the workspace, parallel to two axes of the base, with how much of a box fits where.

    A box of poses fits around a place if J⁺ reaches all its corners from there.

    Attributes
    ----------
    axes : tuple of int
        The two axes: 0, 1, 2 for x, y, z.
    a, b : (A,) and (B,) arrays
        Positions of the middles along them, m.
    share : (B, A) array
        Share of the box, edge per edge, that J⁺ reaches inside the limits; 0 if the middle is out
        of reach, or bodies collide in the middle or at a corner.
    extra : (B, A) array
        Estimated extra joint speed; NaN where the whole box does not fit.
    """

    axes: tuple[int, int]
    a: Array
    b: Array
    share: Array
    extra: Array


def sections(box: Cell, report: Report, seed: int = 0) -> list[Section]:
    """Evaluate a box around places in planes through its middle: from above, and from the side.

    The result shows where a box of poses works, and its price, the extra joint speed relative to
    J⁺. That is estimated by polynomials of degree 2 through the configurations to which J⁺ leads at
    the corners, from the middle: the self-motion in their slopes at the corners, relative to J⁺.
    """
    report("drawing configurations", 0.0)
    known = grown(box, *drawn(box, _DRAWN, np.random.default_rng(seed)))
    axes = [int(row) for row in box.task.rows[: min(3, box.task.m)]]
    middle = box.placement.translation
    if len(axes) < 2:
        return []
    pairs = [(axes[0], axes[1])]
    if len(axes) == 3:
        pairs.append((int(abs(middle[1]) > abs(middle[0])), 2))
    made = []
    for i, pair in enumerate(pairs):
        report(f"section {i + 1} of {len(pairs)}", (i + 0.2) / len(pairs))
        made.append(_section(box, known, pair))
    return made


def _section(box: Cell, known: Grown, axes: tuple[int, int]) -> Section:
    """Evaluate a box around all places of one section, a plane parallel to two axes of the base.

    ``known`` are configurations anywhere that reach the orientation, from which places are solved.
    A place where the box does not fit is tried again from its neighbours' configurations.
    """
    n = box.task.n
    low, high = known.p[:, axes].min(axis=0), known.p[:, axes].max(axis=0)
    step = max(high - low) / (_GRID - 1)
    a, b = (np.arange(x, y + step / 2, step) for x, y in zip(low, high, strict=True))
    p = np.tile(box.placement.translation, (len(b), len(a), 1))
    p[..., axes[0]], p[..., axes[1]] = np.meshgrid(a, b)
    places = _Places.at(box, p.reshape(-1, 3))
    # from the nearest configurations that are known
    every = np.arange(len(places.p))
    far = np.linalg.norm(places.p[:, None] - known.p, axis=2)
    near = np.argsort(far, axis=1)[:, :_NEAREST]
    places.evaluate(every.repeat(near.shape[1]), known.Q[near].reshape(-1, n))
    # from those of the neighbours
    for _ in range(_AGAIN):
        shape = places.Q.reshape(len(b), len(a), n)
        wide = np.pad(shape, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
        beside = [wide[:-2, 1:-1], wide[2:, 1:-1], wide[1:-1, :-2], wide[1:-1, 2:]]
        starts = np.stack(beside, axis=2).reshape(-1, 4, n)
        some = (places.share < 1)[:, None] & np.isfinite(starts).all(axis=2)
        places.evaluate(every[:, None].repeat(4, axis=1)[some], starts[some])
    size = (len(b), len(a))
    return Section(axes, a, b, places.share.reshape(size), places.extra.reshape(size))


class _Places(NamedTuple):
    """K places of a section, with the largest box found around each so far.

    Attributes
    ----------
    box : Cell
        The box.
    p, Q : (K, 3) and (K, n) arrays
        Positions, m, and configurations there; NaN where no box was found.
    share, extra : (K,) arrays
        See :class:`Section`.
    """

    box: Cell
    p: Array
    Q: Array
    share: Array
    extra: Array

    @classmethod
    def at(cls, box: Cell, p: Array) -> _Places:
        """Make the record of places p (K, 3), m, at which no box was tried yet."""
        K = len(p)
        return cls(box, p, np.full((K, box.task.n), np.nan), np.zeros(K), np.full(K, np.nan))

    def evaluate(self, where: NDArray[np.intp], starts: Array) -> None:
        """Try boxes at the places with indices ``where`` (L,), from configurations (L, n).

        Where a larger box is found than before, it replaces the result of the place.
        """
        found = grown(self.box, self.p[where], starts)
        if not len(found.p):
            return
        index = cdist(found.p, self.p).argmin(axis=1)
        price = np.full(len(found.p), np.inf)
        fits = found.steps == STEPS
        price[fits] = _extra_speed(self.box, rows_of(found, fits))
        # the best of each place
        best = np.lexsort((price, -found.steps))
        at, first = np.unique(index[best], return_index=True)
        found, price = rows_of(found, best[first]), price[best[first]]
        gained = found.steps / STEPS * _separate(self.box, found)
        better = gained > self.share[at]
        at = at[better]
        self.share[at], self.Q[at] = gained[better], found.Q[better]
        self.extra[at] = np.where(gained == 1, price, np.nan)[better]


def _separate(box: Cell, found: Grown) -> NDArray[np.bool_]:
    """Test around which middles of a box no bodies collide, there and at its corners: (K,)."""
    K, C, n = found.ends.shape
    Q = np.concatenate([found.Q[:, None], found.ends], axis=1).reshape(-1, n)
    distances = bodies_of(box.task).distances(Q).reshape(K, C + 1)
    return np.asarray(distances.min(axis=1) >= 0)


def _extra_speed(box: Cell, found: Grown) -> Array:
    """Estimate the extra joint speed (K,) of a function over boxes by polynomials of degree 2.

    They go through the configurations in the middle and at the corners of each box. Their slopes
    there are compared with J⁺; to design a function for each place of the map would take too long.
    """
    K, C, n = found.ends.shape
    U = np.concatenate([np.zeros((1, box.k)), box.rim()])
    monomials = Monomials(box.k, 2)
    T = monomials.values(U)
    nodes = np.concatenate([found.Q[:, None], found.ends], axis=1)
    coefficients = np.linalg.pinv(T) @ nodes  # (K, N, n)
    slopes = monomials.slopes(T[1:])  # (C, N, k)
    moved = np.einsum("CNk,KNn->KCnk", slopes, coefficients)
    J = placed(box.task, found.ends.reshape(-1, n))[2]
    G, N, _ = bases(J)
    along = box.widths > 0
    usual = (G[:, :, along] * box.widths[along]).reshape(K, C, n, box.k)
    self_motion = np.swapaxes(N, 1, 2) @ moved.reshape(K * C, n, box.k)
    own = self_motion.reshape(K, C, box.task.r, box.k)
    ratio = (own**2).sum(axis=(1, 2, 3)) / (usual**2).sum(axis=(1, 2, 3))
    return np.asarray(np.sqrt(1 + ratio) - 1)
