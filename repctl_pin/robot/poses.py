"""A pose of the free joints out of values for some of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array


def pose(
    joints: Sequence[str], lower: Array, upper: Array, turns: NDArray[np.bool_], named: Mapping[str, float],
    notes: list[str],
) -> Array:  # fmt: skip
    """Make a pose of joints inside their limits: the named values, else mid-range.

    Parameters
    ----------
    joints : n names
    lower, upper : (n,) arrays
        Limits, rad or m.
    turns : (n,) array of bool
        Whether a joint is revolute.
    named
        Values by joint name, rad or m.
    notes
        Gets a line for every value that had to be moved inside the limits.

    Returns
    -------
    (n,) array
    """
    bounded = np.isfinite(lower) & np.isfinite(upper)
    middle = (np.where(bounded, lower, 0.0) + np.where(bounded, upper, 0.0)) / 2
    q = np.where(bounded, middle, np.clip(0.0, lower, upper))
    for i, name in enumerate(joints):
        if name not in named:
            continue
        q[i] = _inside(named[name], lower[i], upper[i], bool(turns[i]))
        if abs(q[i] - named[name]) > 1e-3:
            notes.append(f"reference pose: {name} = {named[name]:g} is outside its limits, {q[i]:g} used")
    return q


def _inside(value: float, lower: float, upper: float, turns: bool) -> float:
    """Move a joint value inside its limits: by a full turn if that does it, else to the nearer limit."""
    ways = (0.0, 2 * np.pi, -2 * np.pi) if turns else (0.0,)
    inside = [value + way for way in ways if lower <= value + way <= upper]
    return float(inside[0] if inside else np.clip(value, lower, upper))
