"""A tube round joint samples: the neighbourhood of a motion, such as one cycle on a path."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from ..arguments import (
    Array,
    as_configurations,
    as_matrices,
    freeze,
    per_joint,
    positive,
    read_only,
)
from .box import Box, Density, check_density, evaluate_density, normalised, sobol, span

_MOST_SAMPLES = 256


@dataclass(frozen=True, eq=False, repr=False)
@read_only
class Tube:
    """All q within ``|q_i − s_i| ≤ radius_i`` of a joint sample s: a box drawn along a motion.

    The mean over a tube is the average, over its samples, of the mean over each one's box, so
    places where the motion lingers count more. Nodes are scrambled Sobol points for any n.

    Parameters
    ----------
    samples : (S, n) array
        Configurations along a motion, rad or m; thinned to 256. Space them more closely than the
        radius.
    radius : float or (n,) array
        rad (m for sliding joints): the same for every joint, or one per joint.
    density : function, optional
        Q (K, n) → (K,) weights from 0 up.

    Raises
    ------
    InputError
        If there is no sample, a number is not finite or the radius not positive.

    Examples
    --------
    >>> tube = rp.Tube(motion.q[:101], radius=0.05)  # round the first cycle
    >>> bool(tube.contains(motion.q).all())
    True
    """

    samples: Array
    radius: Array
    density: Density | None = None

    def __init__(
        self, samples: ArrayLike, radius: ArrayLike, *, density: Density | None = None
    ) -> None:
        (Q,) = as_matrices(("the samples of a tube", samples, "S n"), exact=True)
        wide = per_joint(radius, Q.shape[1], "the radius of a tube", finite=True)
        check_density(density)
        Q = Q[np.linspace(0, len(Q) - 1, min(len(Q), _MOST_SAMPLES)).round().astype(int)]
        freeze(self, samples=Q, radius=wide, density=density)

    @property
    def center(self) -> Array:
        """The sample nearest to the middle of all."""
        box = self.bounds
        return self.samples[
            int(np.argmin(np.linalg.norm((self.samples - box.center) / box.half_width, axis=1)))
        ]

    @property
    def bounds(self) -> Box:
        """The box around the tube."""
        return Box.between(self.samples.min(0) - self.radius, self.samples.max(0) + self.radius)

    def nodes(self, count: int, seed: int) -> tuple[Array, Array]:
        """Quadrature nodes Q (K, n), K ≥ count, and weights (K,) that sum to 1."""
        Q = self.random(count, seed)
        return Q, self.weights(Q)

    def random(self, count: int, seed: int) -> Array:
        """Scrambled Sobol points (K, n), K the power of two from count up."""
        u = sobol(self.samples.shape[1] + 1, count, seed)
        which = np.minimum((u[:, 0] * len(self.samples)).astype(int), len(self.samples) - 1)
        return self.samples[which] + self.radius * (2 * u[:, 1:] - 1)

    def weights(self, Q: Array) -> Array:
        """What each of the points of :meth:`random` counts for: (K,), sum 1."""
        return normalised(
            evaluate_density(self.density, as_configurations(Q, self.samples.shape[1], "this tube"))
        )

    def ratio(self, Q: ArrayLike) -> Array:
        """Factor by which the region would have to be scaled for each row of Q to lie on its
        boundary: (K,).

        Above 1 is outside.
        """
        return self._nearest(Q)[1]

    def contains(self, Q: ArrayLike) -> NDArray[np.bool_]:
        """Say which rows of Q (K, n) lie inside."""
        return self.ratio(Q) <= 1 + 1e-12

    def clip(self, Q: Array) -> Array:
        """Move points that have left the tube to the box of the nearest sample: (K, n)."""
        nearest = self.samples[self._nearest(Q)[0]]
        return np.clip(Q, nearest - self.radius, nearest + self.radius)

    def shrunk(self, factor: float) -> Tube:
        """Make the tube round the same samples with a fraction of the radius."""
        return Tube(
            self.samples, self.radius * positive(factor, "the factor"), density=self.density
        )

    def _nearest(self, Q: ArrayLike) -> tuple[NDArray[np.intp], Array]:
        """Find each point's nearest sample, and how far it is in units of the radius."""
        distance, which = self._tree.query(
            as_configurations(Q, self.samples.shape[1], "this tube") / self.radius, p=np.inf
        )
        return which, distance

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.samples / self.radius)

    def __str__(self) -> str:
        return f"tube of radius {span(self.radius)} around {len(self.samples)} configurations"

    def __repr__(self) -> str:
        return f"<Tube of radius {span(self.radius)} around {len(self.samples)} configurations>"
