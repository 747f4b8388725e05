"""Boxes of joint positions, on which a proof computes its bounds.

A box is the set of configurations of n joints between a lower and an upper corner, each (n,), rad
or m. ``low`` and ``high`` (K, n) are the corners of K boxes. The functions cover Ω, the region of
joint space of a design, by boxes, halve boxes, and bound their distance to the joint limits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import Array
from ...base.errors import InputError
from ...model.task import Task
from ...regions import Box, Region, Tube, WorkspaceBox
from .potentials import U

_STRETCH = 0.25
"""Maximum motion of a joint on a section of a path, relative to its clearance."""


def cover(region: Region) -> tuple[Array, Array]:
    """Cover a region Ω of joint space by boxes: return their lower and upper corners, (K, n) each.

    A tube is the set of configurations near a sampled motion. Its samples are divided into
    sections, on which the joints move little compared with the tube's radius, and one box covers
    each section. The boxes of successive sections overlap. To cut them into disjoint boxes would
    give many more boxes, about as wide and as hard to bound. A workspace box is the part of a box
    of joints whose poses lie in a box of poses. The whole box of joints covers it.

    Raises
    ------
    InputError
        If the region is user-defined, so that its shape is not known.
    """
    if isinstance(region, Box):
        return region.lower[None].copy(), region.upper[None].copy()
    if isinstance(region, WorkspaceBox):
        return cover(region.within)
    if not isinstance(region, Tube):
        raise InputError(
            f"nothing can be proved over a {type(region).__name__}: its shape is not known; prove "
            "the design over a box or a tube that contains it: rp.prove(design, region=...)"
        )
    Q = region.samples
    wide = region.radius + 4 * U * np.abs(Q).max(axis=0)  # rounding included
    parts = [Q[part] for part in sections(Q, np.tile(region.radius, (len(Q), 1)))]
    low = np.array([part.min(axis=0) for part in parts])
    high = np.array([part.max(axis=0) for part in parts])
    return low - wide, high + wide


def sections(Q: Array, clearance: Array) -> list[slice]:
    """Divide a path through K configurations Q (K, n) into sections, each short enough for one box.

    ``clearance`` (K, n) is how far each joint can move from each configuration within Ω, rad or m.
    On a section, no joint moves by more than a quarter of its smallest clearance on that section. A
    section of only two configurations may exceed this. The sections are slices of at least two rows
    of Q, or of the only row if K is 1; the last row of a section is the first row of the next.
    """
    first, parts = 0, []
    for i in range(2, len(Q)):
        moved = np.ptp(Q[first : i + 1], axis=0)
        least = clearance[first : i + 1].min(axis=0)
        if i > first + 1 and (moved > _STRETCH * least).any():
            parts.append(slice(first, i))
            first = i - 1
    return [*parts, slice(first, len(Q))]


def centered(low: Array, high: Array) -> tuple[Array, Array]:
    """Compute the centres and half-widths, (K, n) each, of boxes with the corners low and high.

    The half-widths are slightly enlarged, so that the boxes contain both corners in spite of
    rounding.
    """
    Q = (low + high) / 2
    size = np.maximum(np.abs(low), np.abs(high))
    return Q, (high - low) / 2 * (1 + 1e-12) + 4 * U * size


def halved(
    low: Array, high: Array, split: NDArray[np.int32]
) -> tuple[Array, Array, NDArray[np.intp]]:
    """Halve boxes, each along the joint with the index ``split`` (K,).

    Both halves have exactly the same coordinate where they meet, so that no gap is left between
    them. A box with a negative ``split`` was not evaluated yet, and is not halved. Such boxes come
    first in the result.

    Returns
    -------
    low, high : (L, n) arrays
        Corners of the L boxes that result.
    parents : (L,) array
        Index, among the K given boxes, of the box that contains each of the L boxes.
    """
    whole, rows = np.flatnonzero(split < 0), np.flatnonzero(split >= 0)
    parents = np.concatenate([whole, rows, rows])
    low, high = low[parents], high[parents]
    first = len(whole) + np.arange(len(rows))
    second, joint = first + len(rows), split[rows]
    middle = (low[first, joint] + high[first, joint]) / 2
    high[first, joint] = low[second, joint] = middle
    return low, high, parents


def enclosing(low: Array, high: Array) -> Box:
    """Create one box of joints that contains all boxes with corners low and high, (K, n) each."""
    least, most = low.min(axis=0), high.max(axis=0)
    slack = 1e-9 * (np.abs(least) + np.abs(most) + most - least)
    return Box.between(least - slack, most + slack)


def limit_margin(task: Task, low: Array, high: Array) -> tuple[float, int]:
    """Bound the joint-limit margin from below on boxes with corners low and high, (K, n) each.

    The margin is the smallest distance of a joint from its limits, negative outside them. Return
    the smallest bound of all boxes, rad or m, and the index of the box with this bound.
    """
    middle, reach = (low + high) / 2, (high - low) / 2
    size = np.abs(low).max() + np.abs(high).max()
    margins = np.minimum(middle - reach - task.lower, task.upper - middle - reach).min(axis=1)
    at = int(np.argmin(margins))
    return float(margins[at]) - 16 * task.n * U * float(size), at
