"""Search for a circle that an arm can follow, of a given radius or the largest that fits.

A study takes such a circle if the user names no path. J⁺ is the pseudoinverse of the Jacobian J:
the usual controller, of minimum joint speed.

``Bounded`` is a region of joint space that computes how far inside or outside configurations lie.
"""

from __future__ import annotations

from typing import cast

import numpy as np

from ..base.arguments import Array
from ..base.errors import InputError, SingularityError
from ..model.length import arm_length, arm_reach
from ..model.task import Task
from ..paths.shapes import Normal, circle
from ..paths.task_path import TaskPath, renamed
from ..redundancy.inverses import inverse_condition_number
from ..strategies import Bounded, Pseudoinverse, Strategy
from .follow import followed

_RADII = (0.5, 0.3, 0.2, 0.1, 0.05, 0.03, 0.02, 0.01)
_SMALL = (0.005, 0.003, 0.002, 0.001)
_SHORT = 0.05
_DEGREES = (180.0, 0.0, 90.0, -90.0)
_LEAST_MARGIN = 0.02
"""Minimum joint-limit margin along a circle, rad or m."""
_INSIDE = 0.999
"""Maximum of ``region.ratio(q)``, which is 1 on the boundary, at the sampled points of a circle. It
is below 1 because the ratio can be larger between these points."""
_LOOKS = 12
"""Number of points per cycle at which body distances are measured first."""


def fitting_circle(
    task: Task,
    q0: Array,
    *,
    plane: str | None = None,
    radius: float | None = None,
    control: Strategy | None = None,
    region: Bounded | None = None,
) -> TaskPath:
    """Find a circle that a controller can follow for a cycle, within joint limits and a region.

    The circle starts at the frame's position at q0 (n,). The motion stays away from singularities,
    0.02 rad or m away from joint limits, and inside ``region``, if one is given. The result is the
    first circle tried on which no bodies collide; if bodies collide on all of them, it is the first
    one with a collision.

    ``control`` is the controller, by default J⁺. ``radius`` is in m. By default, the radii 0.5,
    0.3, 0.2, 0.1 m and so on are tried, the largest first; radii over a seventh of the arm's length
    (strokes of prismatic joints included) are left out. ``plane`` is ``"xy"``, ``"yz"`` or
    ``"xz"``, in base axes; by default all planes of the task are tried. For each radius and plane,
    four positions of the start on the circle are tried.

    Raises
    ------
    InputError
        If no such circle is found. Without ``radius``, circles down to 1 cm are tried, and down to
        1 mm inside a region and for very short arms.
    """
    # what to try: radii, planes, and places of the start on the circle
    planes = (plane,) if plane is not None else task.kind.planes
    limit = 0.14 * arm_reach(task, q0)
    sizes = _RADII if region is None and limit > _SHORT else (*_RADII, *_SMALL)
    radii = (radius,) if radius is not None else [x for x in sizes if x <= max(limit, _RADII[-1])]
    strategy = control or Pseudoinverse(task)
    needed = 0.5 * dexterity_at(task, q0)
    touching: TaskPath | None = None
    # the first circle without a collision; one with a collision if there is no other
    for size in radii:
        for flat in planes:
            for degrees in _DEGREES:
                path = circle_at(task, q0, size, flat, degrees)
                try:
                    motion = followed(strategy, path, q0, cycles=1, steps=96)
                except SingularityError:
                    continue
                inside = motion.limit_margin.min() > _LEAST_MARGIN and (
                    region is None or not (region.ratio(motion.q) > _INSIDE).any()
                )
                if not (inside and min(dexterity_at(task, q) for q in motion.q[::2]) > needed):
                    continue
                if motion._clearance_from(_LOOKS).distance > 0:
                    return path
                touching = touching or path
    if touching is not None:
        return touching
    # no circle was found
    size_text = (
        f"of radius {radius:g} m" if radius is not None else f"of {100 * radii[-1]:g} cm or more"
    )
    where = "its joint limits" if region is None else "Ω and its joint limits"
    flat = " or ".join(planes)
    raise InputError(
        f"from this start the arm follows no circle {size_text} in {flat} inside {where}",
        remedy="choose another start, a smaller circle or another plane",
    )


def circle_at(task: Task, q0: Array, radius: float, plane: str, degrees: float) -> TaskPath:
    """Create a circle that starts at the frame's position at q0 (n,).

    ``radius`` is in m. ``degrees`` is the angle of the start on the circle, counted from the first
    axis of ``plane``, such as ``"xy"``. The path's ``spec`` is the text from which
    :func:`parse_path` recreates it. If there are several frames, the first one moves, and the
    others are at rest.
    """
    if len(task.frames) > 1:
        from ..paths.several_paths import several_paths

        first = lambda single, q: circle_at(single, q, radius, plane, degrees)  # noqa: E731
        return several_paths(task, q0, [first, *[None] * (len(task.frames) - 1)])
    path = circle(
        task, q0, radius, normal=cast(Normal, plane), start_angle=float(np.deg2rad(degrees))
    )
    # as few digits as reproduce the same floats
    numbers = (np.format_float_positional(x, trim="-") for x in (radius, degrees))
    return renamed(path, spec=":".join(["circle", *numbers]), plane=plane)


def dexterity_at(task: Task, q: Array) -> float:
    """Evaluate ``σ_min / σ_max`` of J at q (n,); 0 at a singularity.

    Rows of translations are divided by the arm length, which makes the ratio independent of the
    arm's size. A circle is refused if the ratio falls to half of its value at the start.
    """
    J = task.jacobian(q).copy()
    J[task.kind.linear] /= max(arm_length(task, q), 1e-9)
    return float(inverse_condition_number(J))
