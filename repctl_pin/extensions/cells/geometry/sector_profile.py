r"""Profile of a sector: its smallest and largest radius as polynomials of the height.

At a height η above the sector's middle, m, the radius is ``ρ = ρ_0 + b(η) + s(η) y``. ρ_0 is the
radius of the middle and y the radial coordinate of the sector, from −w to w, m; w is the half-width
of the radius in the middle. The bend b and the stretch s are polynomials with b(0) = 0 and s(0) =
1. With b = 0 and s = 1, the sector has the same range of radius at all heights. With any profile,
the coordinates of the sector form a box, so a straight line in them stays in the sector.
Coefficients (D + 1,) of a polynomial of degree D begin with the constant one. K is the number of
heights.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from ....base.arguments import Array
from ....base.errors import InputError

MOST_DEGREE = 8
"""Maximum degree of the two polynomials."""

NARROWEST = 1e-6
"""Smallest difference of the two radii at any height, m."""


class Profile(NamedTuple):
    """Bend and stretch of a sector.

    Attributes
    ----------
    bend, stretch : (D + 1,) arrays
        Coefficients of b, m, and of s, in powers of the height η above the middle, m, from η⁰ on.
    """

    bend: Array
    stretch: Array

    @property
    def degree(self) -> int:
        """Degree D of the polynomials; 0 if the range of radius is the same at all heights."""
        return len(self.bend) - 1

    def at(self, eta: Array, half: float) -> tuple[Array, Array]:
        """Evaluate b and s at heights η (K,): two arrays (K,).

        Above and below the sector, whose half-width of the height is ``half``, m, b and s are
        constant. So b and s are continuous, and s is positive everywhere.
        """
        inside = np.clip(eta, -half, half)
        b, s = (_value(each, inside) for each in self)
        return b, s

    def slopes(self, eta: Array, half: float) -> tuple[Array, Array]:
        """Evaluate ∂b/∂η and ∂s/∂η at heights η (K,): two arrays (K,), 0 beyond ±``half``, m."""
        inside, within = np.clip(eta, -half, half), np.abs(eta) <= half
        db, ds = (_value(_derivative(each), inside) * within for each in self)
        return db, ds

    def moved(self, y: float, eta: float) -> tuple[Profile, float]:
        """Return the profile relative to another middle, and a factor.

        The new middle is at the radial coordinate ``y``, m, and the height ``eta``, m, relative to
        the old one. The factor is the ratio of the half-width of the radius in the new middle to
        that in the old middle.
        """
        if not self.degree:
            return self, 1.0
        bend, stretch = (_moved(each, eta) for each in self)
        factor = float(stretch[0])
        bend = bend + y * stretch
        bend[0] = 0.0
        stretch = stretch / factor
        stretch[0] = 1.0
        return Profile(bend, stretch), factor

    def sides(self, rho: float, radius: float) -> list[Polynomial]:
        """Return the smallest and the largest radius, m, as polynomials of η.

        ``rho`` is the radius of the middle, ``radius`` the half-width there, m.
        """
        b, s = (Polynomial(each) for each in self)
        return [rho + b - radius * s, rho + b + radius * s]

    def lowest(self, rho: float, radius: float, half: float) -> tuple[float, float]:
        """Return the minimum of the inner radius, and of outer minus inner radius, m.

        The minima are over all heights η from −half to half, m. ``rho`` is the radius of the
        middle, ``radius`` the half-width there, m.
        """
        low, high = self.sides(rho, radius)
        return _minimum(low, half), _minimum(high - low, half)

    def mean_stretch(self, half: float) -> float:
        """Evaluate the mean of s over the heights from −half to half, m."""
        if not half:
            return 1.0
        whole = Polynomial(self.stretch).integ()
        return float((whole(half) - whole(-half)) / (2 * half))


STRAIGHT = Profile(np.zeros(1), np.ones(1))
"""Profile of a sector with one range of radius."""


def as_profile(radius: Any, height: float) -> tuple[Profile, float, float] | None:
    """Convert the two sides of a sector to a profile; None if ``radius`` is one number.

    ``radius`` are two lists of coefficients: the smallest and the largest radius, m, as polynomials
    in η / ``height``. η is the height above the middle, and ``height`` the half-width of the
    height, m. Return the profile, the radius of the middle and the half-width there, m. An
    InputError is raised if the sides meet, or if the smallest radius is not above 0.
    """
    if not (np.iterable(radius) and any(np.iterable(side) for side in radius)):
        return None
    low, high = _side_pair(radius)
    if max(len(low), len(high)) > 1 and not height > 0:
        raise InputError(
            "that depends on the height requires a height above 0",
            argument="radius",
            remedy="give height=, or one number",
        )
    size = max(len(low), len(high))
    low, high = (np.pad(side, (0, size - len(side))) for side in (low, high))
    with np.errstate(over="ignore", invalid="ignore"):
        scale = height ** -np.arange(size, dtype=float) if size > 1 else np.ones(1)
        middle, half = (high + low) / 2 * scale, (high - low) / 2 * scale
    rho, width = float(middle[0]), float(half[0])
    if not (np.isfinite(middle).all() and np.isfinite(half).all()):
        raise InputError(
            f": its coefficients divided by powers of height={height:g} are not finite",
            argument="radius",
            remedy="give the coefficients and height= in m",
        )
    if not (least := _minimum(Polynomial(low), 1.0)) > 0:
        raise InputError(
            f"of {least:.3g} m at some height reaches the axis",
            argument="radius",
            remedy="keep the smallest radius above 0 at every height",
        )
    if not _minimum(Polynomial(high - low), 1.0) > NARROWEST:
        raise InputError(
            ": the largest radius is not above the smallest at every height",
            argument="radius",
            remedy="give (smallest, largest) with a positive difference at every height",
        )
    middle[0] = 0.0
    profile = Profile(middle, half / width)
    return (profile if size > 1 else STRAIGHT), rho, width


def _side_pair(radius: Any) -> tuple[Array, Array]:
    """Check the sides of a sector, and return two arrays of coefficients: inner, outer radius, m.

    ``radius`` are two lists of at most 9 coefficients each, the constant first. They are the
    coefficients of polynomials in the height above the middle, scaled to ±1 at both ends. An
    InputError is raised for other values.
    """
    try:
        low, high = (np.asarray(side, float) for side in radius)
    except (TypeError, ValueError, OverflowError):
        low = high = np.zeros(0)
    good = all(
        side.ndim == 1 and 0 < len(side) <= MOST_DEGREE + 1 and np.isfinite(side).all()
        for side in (low, high)
    )
    if not good:
        raise InputError(
            "must be one number, the half-width of the radius, m, or two lists of at most "
            f"{MOST_DEGREE + 1} coefficients, m, lowest power first: the smallest and the largest "
            "radius as polynomials of z, which is −1 at the bottom and 1 at the top of the sector",
            argument="radius",
        )
    return low, high


def _value(coefficients: Array, x: Array) -> Array:
    """Evaluate a polynomial with ``coefficients`` at x (K,): (K,).

    Horner's rule is used, with the operations in the same order as in the C code for functions over
    a cell, so that both results are equal.
    """
    value = np.zeros_like(x)
    for c in coefficients[::-1]:
        value = value * x + c
    return value


def _derivative(coefficients: Array) -> Array:
    """Return the coefficients of the derivative of a polynomial: (D,), empty for a constant."""
    return coefficients[1:] * np.arange(1, len(coefficients))


def _moved(coefficients: ArrayLike, x: float) -> Array:
    """Return the coefficients of the polynomial t ↦ p(x + t), as many as ``coefficients`` of p."""
    c = np.asarray(coefficients, float)
    moved = Polynomial(c)(Polynomial([x, 1.0])).coef
    return np.pad(moved, (0, len(c) - len(moved)))


def _minimum(p: Polynomial, half: float) -> float:
    """Find the minimum value of a polynomial between −half and half."""
    roots = p.deriv().roots() if p.degree() > 1 else np.zeros(0)
    real = np.real(roots[np.abs(np.imag(roots)) < 1e-9])
    return float(p(np.concatenate([np.clip(real, -half, half), [-half, half]])).min())
