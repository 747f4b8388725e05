"""Tube around configurations: the neighbourhood of a motion, such as one cycle on a path.

Quadrature nodes are configurations at which a design evaluates its cost; a weighted sum over them
approximates the mean over the tube. Letters: n joints; Q (K, n), K configurations, rad (m for
prismatic joints); s, a sample, which is a configuration of the motion.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import (
    Array,
    as_configurations,
    as_matrices,
    freeze,
    per_joint,
    positive,
    read_only,
)
from ..native import library
from .box import Box
from .region import Density, Region, check_density, sobol, span

_MOST_SAMPLES = 256


@dataclass(frozen=True, eq=False, repr=False)
@read_only
class Tube(Region):
    """All q with ``|q_i − s_i| ≤ radius_i`` for some sample s: a box moved along a motion.

    The mean over a tube is the average of the means over the boxes around the samples. Parts of the
    motion with closely spaced samples, such as slow ones, therefore have more weight. Quadrature
    nodes are scrambled Sobol points.

    Parameters
    ----------
    samples : (S, n) array
        Configurations along a motion, rad or m. Successive ones must differ by less than the
        radius, or the tube has gaps. If there are more than 256, only 256 of them are used, evenly
        spaced in their order.
    radius : float or (n,) array
        Radius, rad (m for prismatic joints): one number for all joints, or one per joint.
    density : function, optional
        Function Q (K, n) → (K,): weights ≥ 0 of the rows of Q in the mean over the tube; by default
        all weights are equal.

    Raises
    ------
    InputError
        If there is no sample, a number is not finite, or the radius is not positive.

    Examples
    --------
    >>> tube = rp.Tube(motion.q[:101], radius=0.05)  # around the first cycle
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

    @cached_property
    def center(self) -> Array:
        """Sample nearest to the centre of the smallest box around the tube: (n,)."""
        box = self.bounds
        distance = np.linalg.norm((self.samples - box.center) / box.half_width, axis=1)
        return self.samples[int(np.argmin(distance))]

    @property
    def bounds(self) -> Box:
        """Smallest box around the tube."""
        return Box.between(self.samples.min(0) - self.radius, self.samples.max(0) + self.radius)

    def random(self, count: int, seed: int) -> Array:
        """Draw scrambled Sobol points in the tube: (K, n), with K ≥ ``count`` a power of two.

        The same ``seed`` gives the same points.
        """
        u = sobol(self.n + 1, count, seed)
        which = np.minimum((u[:, 0] * len(self.samples)).astype(int), len(self.samples) - 1)
        return self.samples[which] + self.radius * (2 * u[:, 1:] - 1)

    def ratio(self, Q: ArrayLike) -> Array:
        """Compute the scale at which the tube's boundary passes through each row of Q (K, n): (K,).

        The scale is a factor of the radius: below 1 for a row inside, above 1 outside.
        """
        return self.nearest(Q)[1]

    def clip(self, Q: ArrayLike) -> Array:
        """Move the rows of Q (K, n) that lie outside into the box of the nearest sample: (K, n)."""
        Q = as_configurations(Q, self.n, "this tube")
        nearest = self.samples[self.nearest(Q)[0]]
        return np.clip(Q, nearest - self.radius, nearest + self.radius)

    def shrunk(self, factor: float) -> Tube:
        """Create the tube around the same samples with the radius multiplied by ``factor``."""
        return Tube(
            self.samples, self.radius * positive(factor, "the factor"), density=self.density
        )

    def nearest(self, Q: ArrayLike) -> tuple[NDArray[np.intp], Array]:
        """Find the sample nearest to each row of Q (K, n): its index (K,) and its distance (K,).

        The distance is ``max_i |q_i − s_i| / radius_i``, at most 1 inside the tube.
        """
        Q = as_configurations(Q, self.n, "this tube") / self.radius
        native = library()
        if native is None:
            return self._nearest(Q)
        which = np.empty(len(Q), np.intp)
        distance = np.empty(len(Q))
        sizes = ctypes.c_int(self.n), ctypes.c_long(len(Q)), ctypes.c_long(len(self._scaled))
        arrays = np.ascontiguousarray(Q), self._scaled, which, distance
        native.nearest_samples(*sizes, *(ctypes.c_void_p(array.ctypes.data) for array in arrays))
        return which, distance

    def _nearest(self, Q: Array) -> tuple[NDArray[np.intp], Array]:
        """Find the sample nearest to each row of Q (K, n), in units of the radius, without C.

        Return its index (K,) and its distance (K,).
        """
        from scipy.spatial.distance import cdist  # slow to import

        from_all = cdist(Q, self._scaled, "chebyshev")
        return from_all.argmin(axis=1), from_all.min(axis=1)

    @cached_property
    def _scaled(self) -> Array:
        """Samples (S, n) in units of the radius."""
        return np.ascontiguousarray(self.samples / self.radius)

    def __str__(self) -> str:
        return f"tube of radius {span(self.radius)} around {len(self.samples)} configurations"
