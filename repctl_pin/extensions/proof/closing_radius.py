"""The closing radius of a design: around its start, or along a closed path that closes itself."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...certificate import ClosingRadius
from ...design import Design
from ...errors import SingularityError
from ...model.task import Task
from ...motion import follow
from ...paths.task_path import ClosedPath
from ...regions import Box, Region, Tube, WorkspaceBox
from .boxes import sections
from .chain import frames_of
from .leaf_margin_bounds import LeafMarginProblem
from .lifts import Places, Reach, bound_reach

_CYCLE_STEPS = 100
"""Number of configurations along a path, between which straight lines are taken."""

_MOST = {"start": 250_000, "path": 20_000}
"""Number of boxes after which the largest radius found so far is taken."""

_CLOSED = 1e-7
"""Gap, rad or m, below which a followed path is taken for closed."""


def closing_radius(
    design: Design,
    region: Region,
    problem: LeafMarginProblem,
    path: ClosedPath | None,
    ratio: float,
    goal: float | None,
    seconds: float,
) -> ClosingRadius:
    """Prove a closing radius of a design.

    Parameters
    ----------
    design, region, problem
        The design, Ω, and J_V over Ω.
    path
        Closed path along which to prove it; None for the surroundings of the start.
    ratio
        Angle per distance, rad per m.
    goal
        Radius, m, that suffices; None for the largest one.
    seconds
        Processor time after which the bounds found so far are taken.
    """
    task = design.task
    turns = any(part.kind.turns for part in frames_of(task))
    ratio = ratio if turns else 0.0
    start = _start(design, region, path)
    if path is None:
        Q, around, why = start[None], "start", ""
    else:
        Q, why = _followed(design, path, start)
        around = "path"
    poses = [task.placements(q) for q in Q]
    radius, boxes, complete = 0.0, 0, True
    if not why:
        clearance = _clearance(region, Q)
        places = _places(Q, clearance)
        if not (places.clearance > 0).all():
            why = f"the {around} is not inside Ω"
        else:
            try:
                found = bound_reach(
                    problem,
                    task,
                    design.inverse.potentials,
                    places,
                    ratio,
                    goal,
                    seconds,
                    np.inf if goal is not None else _MOST[around],
                )
            except SingularityError as error:
                why = str(error)
            else:
                radius, boxes, complete = found.radius, found.boxes, found.complete
                if goal is not None and radius >= goal:
                    why, complete = "no larger one was asked for", True
                else:
                    undecided = f"not all of Ω was decided in {boxes} boxes; "
                    where = _edge(task, places, found)
                    why = where if complete else undecided + where
    return ClosingRadius(
        radius,
        ratio * radius if turns else None,
        around,
        str(task.kind),
        start,
        np.array([[x.translation for x in pose] for pose in poses]).reshape(len(Q), -1),
        np.array([[x.rotation for x in pose] for pose in poses]).reshape(len(Q), -1, 3),
        boxes,
        complete,
        why,
    )


def _edge(task: Task, places: Places, found: Reach) -> str:
    """Write what ends a radius."""
    if not found.regular:
        return "farther away, J_V is not proved to be regular"
    away = places.clearance[found.place, found.joint]
    unit = "rad" if task.revolute[found.joint] else "m"
    return f"{task.joint_names[found.joint]} may leave Ω, {away:.2g} {unit} away"


def _start(design: Design, region: Region, path: ClosedPath | None) -> Array:
    """Return the start of the design's own cycle, if it is inside Ω, or a centre of Ω.

    In a tube, that is the sample whose pose is nearest to the beginning of the path.
    """
    if design.cycle is not None and region.ratio(design.cycle.start[None])[0] < 1:
        return design.cycle.start
    if path is None or not isinstance(region, Tube):
        return region.center
    target = path.placement(0.0)
    away = design.task.errors(region.samples, [target] * len(region.samples))
    return np.asarray(region.samples[np.linalg.norm(away, axis=1).argmin()], float)


def _followed(design: Design, path: ClosedPath, start: Array) -> tuple[Array, str]:
    """Follow a path once: configurations along it, and why there are none, if so."""
    try:
        motion = follow(design.inverse, path, start, cycles=1, steps=_CYCLE_STEPS)
    except SingularityError as error:
        return start[None], f"the path ends in a singularity ({error})"
    gap = float(np.abs(motion.q[-1] - motion.q[0]).max())
    if gap > _CLOSED:
        return start[None], f"the path itself does not close, by {gap:.2g}"
    return np.concatenate([motion.q[:-1], motion.q[:1]]), ""


def _clearance(region: Region, Q: Array) -> Array:
    """Bound the distances (K, n) that the joints may move from configurations Q (K, n) within Ω.

    Between neighbours the smaller one of their rooms is left: for a tube, less half of the step.
    """
    if isinstance(region, WorkspaceBox):
        return _clearance(region.within, Q)
    if isinstance(region, Box):
        return np.minimum(Q - region.lower, region.upper - Q)
    assert isinstance(region, Tube), "regions of other shapes were refused"
    away = np.abs(Q[:, None] - region.samples)  # (K, samples, n)
    nearest = (away / region.radius).max(axis=2).argmin(axis=1)
    clearance = region.radius - away[np.arange(len(Q)), nearest]
    steps = np.abs(np.diff(Q, axis=0))
    if len(steps):
        gaps = np.zeros_like(clearance)
        gaps[:-1], gaps[1:] = steps, np.maximum(gaps[1:], steps)
        clearance = clearance - gaps / 2
    return np.asarray(clearance, float)


def _places(Q: Array, clearance: Array) -> Places:
    """Divide a path through Q (K, n) into places; neighbours share a configuration."""
    parts = sections(Q, clearance)
    low = np.array([Q[part].min(axis=0) for part in parts])
    high = np.array([Q[part].max(axis=0) for part in parts])
    bent = _bent(Q)
    bends = np.array([bent[part].max(axis=0) for part in parts])
    return Places(
        (low + high) / 2,
        (high - low) / 2 * (1 + 1e-12) + bends,
        np.array([clearance[part].min(axis=0) for part in parts]) - bends,
    )


def _bent(Q: Array) -> Array:
    """Bound how far a closed path through Q (K, n) is from straight lines between neighbours.

    ``|q_(i−1) − 2 q_i + q_(i+1)| / 2``: enough for a corner anywhere between two of them, and four
    times the sag of a parabola.
    """
    if len(Q) < 3:
        return np.zeros_like(Q)
    steps = np.diff(Q, axis=0)
    return np.asarray(np.abs(steps - np.roll(steps, 1, axis=0)) / 2)
