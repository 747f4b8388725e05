"""The closing radius of a design: around its start, or along a closed path.

Within the closing radius of the start or of the path, each closed path of the frame ends in the
configuration it began in. The radius is a distance, m, and for tasks with a rotation also an angle,
rad. A leaf is the set h(q) = c of the potentials h, and c its level. Ω is the region of joint space
to prove over. A tube is a region near a sampled motion. A lift is the joint motion on a leaf over a
path of the frame, such as a straight line. A place is a box of configurations in which lifts begin,
see :mod:`.lifts`. A :class:`Reach` is the length of lines whose lifts stay in Ω. An argument
``problem`` has bounds on J_V, the task Jacobian stacked on the potentials' gradients, over boxes of
joints. n is the number of joints.

``ClosedPath`` is a closed path as a function of s, which goes from 0 to 1 in a cycle.
``LeafMarginProblem`` is a task with potentials, prepared for bounds of the leaf margin over boxes
of joint space. ``Enclosure`` is boxes of joints that contain a motion, their half-widths, and
whether this is proved. ``Places`` are K boxes of joint space in which lifts begin: centres,
half-widths and clearances.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from ...base.arguments import Array
from ...base.certificate import ClosingRadius
from ...base.errors import SingularityError
from ...design import Design
from ...model.task import Task
from ...paths.task_path import ClosedPath, closed_path
from ...regions import Box, Region, Tube, WorkspaceBox
from .boxes import sections
from .chain import frames_of
from .closed_path_proof import Enclosure, enclosed
from .leaf_margin_bounds import LeafMarginProblem
from .levels import level_boxes
from .lifts import Places, Reach, bound_reach

_POSES = 100
"""Number of poses of a path to which a distance is compared; more where the radius is small."""

_MOST = {"start": 250_000, "path": 5_000}
"""Number of boxes after which the largest radius found so far is taken."""


def closing_radius(
    design: Design,
    region: Region,
    problem: LeafMarginProblem,
    path: ClosedPath | None,
    ratio: float,
    goal: float | None,
    seconds: float,
    leaf: float = 0.0,
) -> ClosingRadius:
    """Prove a closing radius of a design, within which each motion on a closed path closes.

    Parameters
    ----------
    design, region
        The design, and the region Ω of joint space in which its lifts must stay.
    problem
        Bounds on J_V, the task Jacobian stacked on the potentials' gradients, over boxes in Ω.
    path
        Closed path along which to prove the radius; None for the surroundings of the start.
    ratio
        Radians per metre of the radius; 0 for paths of constant orientation.
    goal
        Radius, m, at which the search may stop; None for the largest radius.
    seconds
        Processor time, s, after which the bounds found so far are returned.
    leaf
        Largest change of each level from its value at the start, in the unit of h; 0 for paths on
        one leaf. If ``path`` is given, it must be 0.
    """
    task = design.task
    turns = any(part.kind.turns for part in frames_of(task))
    ratio = ratio if turns else 0.0
    start = _start(design, region, path)
    if path is None:
        motion = _at_start(design, problem, start, leaf, region)
    else:
        motion = enclosed(design.inverse, problem, closed_path(path), start)
    Q = motion.Q
    around = "start" if path is None else "path"
    radius, boxes, complete, why = 0.0, 0, True, motion.reason
    if not why:
        places = _places(Q, _clearance(region, Q), motion.half)
        most = np.inf if goal is not None else _MOST[around]
        why = "" if (places.clearance > 0).all() else f"the {around} is not inside Ω"
    if not why:
        potentials = design.inverse.potentials
        try:
            found = bound_reach(problem, task, potentials, places, ratio, goal, seconds, most)
        except SingularityError as error:
            why = str(error)
        else:
            radius, boxes = found.radius, found.boxes
            complete, why = _end(task, places, found, goal)
    angle = ratio * radius if turns else None
    return ClosingRadius(
        radius,
        angle,
        around,
        str(task.kind),
        start if path is None else Q[0],
        *_shown(task, start[None] if path is None else Q, radius, angle),
        boxes,
        complete,
        why,
        0 if motion.proved else len(Q) - 1,
        leaf,
    )


def _at_start(
    design: Design, problem: LeafMarginProblem, start: Array, leaf: float, region: Region
) -> Enclosure:
    """Enclose in boxes the configurations with the start's pose and nearly the start's levels.

    ``start`` (n,) is the start. ``leaf`` is the maximum difference of each level from its value at
    the start. If ``leaf`` is 0, the only box is the start itself.
    """
    if leaf == 0:
        return Enclosure(start[None], np.zeros((1, design.task.n)), True, "")
    return level_boxes(design.inverse, problem, start, leaf, partial(_clearance, region))


def _shown(task: Task, Q: Array, radius: float, angle: float | None) -> tuple[Array, Array]:
    """Choose poses of a path through Q (K, n), from which to measure distances to the path.

    Neighbouring poses are about half of ``radius``, m, or of ``angle``, rad, apart, if Q has enough
    rows. ``angle`` is None or 0 if rotations do not count. Return the positions (P, 3 F), m, and
    the rotations (P, 3 F, 3) of P poses. The second axis has three entries for each of the F frames
    of the task, one frame after the other: x, y, z, or the rows of the rotation matrix.
    """
    poses = [task.placements(q) for q in Q]
    p = np.array([[x.translation for x in pose] for pose in poses])
    R = np.array([[x.rotation for x in pose] for pose in poses])
    shown = np.linspace(0, len(Q) - 1, _POSES + 1).astype(int)
    if radius > 0:
        moved = np.linalg.norm(np.diff(p, axis=0), axis=2).max(axis=1) / radius
        if angle:
            turned = np.linalg.norm(np.diff(R, axis=0), axis=(2, 3)).max(axis=1) / np.sqrt(2)
            moved = np.maximum(moved, turned / angle)
        way = np.insert(np.cumsum(np.minimum(moved, 1.0)), 0, 0.0)
        shown = np.append(shown, np.searchsorted(way, np.arange(0.0, way[-1], 0.5)))
    shown = np.unique(shown)
    return p[shown].reshape(len(shown), -1), R[shown].reshape(len(shown), -1, 3)


def _end(task: Task, places: Places, found: Reach, goal: float | None) -> tuple[bool, str]:
    """Return whether the radius found is the largest provable one, and why none larger was proved.

    ``goal`` is the requested radius, m, or None for the largest one. The first result is False only
    if the search ended before all of Ω was decided; the second, the reason, is never empty.
    """
    if goal is not None and found.radius >= goal:
        return True, "no larger radius was requested"
    where = _edge(task, places, found)
    if found.complete:
        return True, where
    return False, f"not all of Ω was decided in {found.boxes} boxes; {where}"


def _edge(task: Task, places: Places, found: Reach) -> str:
    """Write what limits a closing radius: a joint that may leave Ω, or a possible singularity.

    ``found`` has the index of the limiting joint, and the index of the place at which the limiting
    line begins.
    """
    if not found.regular:
        return "farther away, J_V is not proved to be regular"
    away = places.clearance[found.place, found.joint]
    unit = "rad" if task.revolute[found.joint] else "m"
    return f"{task.joint_names[found.joint]} may leave Ω, {away:.2g} {unit} away"


def _start(design: Design, region: Region, path: ClosedPath | None) -> Array:
    """Choose the configuration (n,) around which a closing radius is proved, or a path begins.

    The result is the start of the design's own cycle if it is inside Ω, the region of joint space
    to prove over. Otherwise it is the centre of Ω or, for a path in a tube, the sample of the tube
    whose pose is nearest to the beginning of the path.
    """
    if design.cycle is not None and region.ratio(design.cycle.start[None])[0] < 1:
        return design.cycle.start
    if path is None or not isinstance(region, Tube):
        return region.center
    target = path.placement(0.0)
    away = design.task.errors(region.samples, [target] * len(region.samples))
    return np.asarray(region.samples[np.linalg.norm(away, axis=1).argmin()], float)


def _clearance(region: Region, Q: Array) -> Array:
    """Bound how far each joint may move from configurations Q (K, n) within Ω: (K, n), rad or m.

    In a box, the bound is the distance from the nearer face. In a tube around sampled
    configurations, it is the distance from the boundary of the box around the nearest sample.
    """
    if isinstance(region, WorkspaceBox):
        return _clearance(region.within, Q)
    if isinstance(region, Box):
        return np.minimum(Q - region.lower, region.upper - Q)
    assert isinstance(region, Tube), "regions of other shapes were refused"
    nearest, _ = region.nearest(Q)
    return np.asarray(region.radius - np.abs(Q - region.samples[nearest]), float)


def _places(Q: Array, clearance: Array, half: Array) -> Places:
    """Divide a motion through Q (K, n) into places: boxes of configurations in which lifts begin.

    ``half`` (K, n) bounds how far the motion departs from each row of Q until the next row; so the
    boxes also contain the motion between the rows. ``clearance`` (K, n) is how far each joint can
    move from each row of Q within Ω, rad or m. The clearance of a place is the smallest clearance
    of its rows, minus the largest ``half`` of its rows.
    """
    parts = sections(Q, clearance)
    low = np.array([Q[part].min(axis=0) for part in parts])
    high = np.array([Q[part].max(axis=0) for part in parts])
    bends = np.array([half[part].max(axis=0) for part in parts])
    return Places(
        (low + high) / 2,
        (high - low) / 2 * (1 + 1e-12) + bends,
        np.array([clearance[part].min(axis=0) for part in parts]) - bends,
    )
