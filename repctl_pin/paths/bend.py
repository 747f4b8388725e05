"""Curve of continuous curvature that rounds a corner between two straight lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from ..base.arguments import Array, read_only

_DEGREE = 30
"""Degree of the Chebyshev polynomials of a bend."""


@dataclass(frozen=True, eq=False)
@read_only
class Bend:
    """Plane curve that rounds a corner: length 1, total turn φ, curvature zero at both ends.

    At the arc length u in [0, 1], the curvature is ``6 φ u (1 − u)`` and the direction
    ``θ(u) = φ (3u² − 2u³)``; the point is the integral of (cos θ, sin θ).

    Attributes
    ----------
    phi : float
        Total turn φ, rad.
    point : (32, 2) array
        Chebyshev coefficients over u of the point's two coordinates: along and across the direction
        at u = 0.
    """

    phi: float
    point: Array

    @classmethod
    def of(cls, phi: float) -> Bend:
        """Create the curve with the total turn φ, rad, by fitting polynomials to its direction."""
        nodes = chebyshev.chebpts1(_DEGREE + 1)
        theta = cls.direction_of(phi, (nodes + 1) / 2)
        slope = np.linalg.solve(
            chebyshev.chebvander(nodes, _DEGREE), np.stack([np.cos(theta), np.sin(theta)], axis=1)
        )
        return cls(phi, np.asarray(chebyshev.chebint(slope, scl=0.5, lbnd=-1), float))

    @staticmethod
    def direction_of(phi: float, u: ArrayLike) -> Array:
        """Evaluate the direction θ(u), rad, relative to the direction at u = 0."""
        u = np.asarray(u, float)
        return phi * u**2 * (3 - 2 * u)

    def at(self, u: ArrayLike) -> Array:
        """Evaluate the point at u: (2,), or (2, K) for u (K,).

        The two coordinates are along and across the direction at u = 0.
        """
        return np.asarray(chebyshev.chebval(2 * np.asarray(u) - 1, self.point))

    def length(self, cut: float) -> float:
        """Compute the length, m, of the scaled curve whose ends lie ``cut``, m, from its corner.

        The corner is the point where the tangents at both ends meet. Before scaling, the curve has
        length 1, so the result is also the factor by which to scale it. The ends of the scaled
        curve are ``2 cut cos(φ/2)`` apart.
        """
        return float(2 * cut * np.cos(self.phi / 2) / np.linalg.norm(self.at(1.0)))

    def shares(self, u: Array) -> tuple[Array, Array]:
        """Compute the coordinates α and β of the points at u (K,) along the two edges: (K,) each.

        ``p(u) = c − α(u) cut d₀ + β(u) cut d₁``, with the corner c, the unit vectors d₀ and d₁
        along the first and the second edge, and the length ``cut`` taken off each edge. Thus
        ``α(u) = β(1 − u)``, ``β(0) = β′(0) = β″(0) = β″(1) = 0`` and ``β(1) = 1``. A corner
        between two curves is rounded with α and β as fractions of the parts cut off the curves.
        """
        scale = self.length(1.0) / np.sin(self.phi)
        return scale * self.at(1 - u)[1], scale * self.at(u)[1]
