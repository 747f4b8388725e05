"""The closing radius of a design: around its start, or along a closed path that closes itself.

It is the distance within which every closed path of the end effector is closed in the joints, too.
"""

from __future__ import annotations

import numpy as np

from ...base.arguments import Array
from ...base.certificate import ClosingRadius
from ...base.errors import SingularityError
from ...design import Design
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
    """Prove a closing radius of a design: every closed path within it closes in the joints.

    Parameters
    ----------
    design, region, problem
        The design, the region Ω of joint space to prove over, and J_V there, the task Jacobian
        stacked on the potentials' gradients.
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
    """Write what ends a closing radius: a joint that may leave Ω, or a possible singularity.

    Ω is the region of joint space of the design. ``found`` names the place of the path and the
    joint.
    """
    if not found.regular:
        return "farther away, J_V is not proved to be regular"
    away = places.clearance[found.place, found.joint]
    unit = "rad" if task.revolute[found.joint] else "m"
    return f"{task.joint_names[found.joint]} may leave Ω, {away:.2g} {unit} away"


def _start(design: Design, region: Region, path: ClosedPath | None) -> Array:
    """Choose the configuration (n,) around which, or from which on, a closing radius is proved.

    It is the start of the design's own cycle if that is inside Ω, the region of joint space to
    prove over. Otherwise it is the centre of Ω; for a path in a tube, the sample of the tube whose
    pose is nearest to the beginning of the path.
    """
    if design.cycle is not None and region.ratio(design.cycle.start[None])[0] < 1:
        return design.cycle.start
    if path is None or not isinstance(region, Tube):
        return region.center
    target = path.placement(0.0)
    away = design.task.errors(region.samples, [target] * len(region.samples))
    return np.asarray(region.samples[np.linalg.norm(away, axis=1).argmin()], float)


def _followed(design: Design, path: ClosedPath, start: Array) -> tuple[Array, str]:
    """Follow a closed path once with the design's controller; return the configurations (K, n).

    Return also an empty text, or why the motion is of no use: it ends in a singularity, or does not
    close. The only configuration is then the start.
    """
    try:
        motion = follow(design.inverse, path, start, cycles=1, steps=_CYCLE_STEPS)
    except SingularityError as error:
        return start[None], f"the path ends in a singularity ({error})"
    gap = float(np.abs(motion.q[-1] - motion.q[0]).max())
    if gap > _CLOSED:
        return start[None], f"the path itself does not close, by {gap:.2g}"
    return np.concatenate([motion.q[:-1], motion.q[:1]]), ""


def _clearance(region: Region, Q: Array) -> Array:
    """Bound how far each joint may move from configurations Q (K, n) within Ω: (K, n), rad or m.

    Ω is the region of joint space of the design. In a box it is the distance from the nearer face.
    In a tube around sampled configurations, half of the larger step to a neighbouring row of Q is
    subtracted, so that the bound holds between the rows, too.
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
    """Divide a path through Q (K, n) into places: boxes of configurations in which lines begin.

    A closing radius is proved for lines that begin anywhere on the path. Neighbouring boxes share a
    configuration, and contain the path between. ``clearance`` (K, n) is the distance that each
    joint may move within Ω, rad or m; in a place, the smallest one counts.
    """
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
    """Bound how far a closed path through Q (K, n) is from straight lines between its rows: (K, n).

    Boxes around these lines, widened by this bound, contain the path. It is
    ``|q_(i−1) − 2 q_i + q_(i+1)| / 2``: enough for a corner anywhere between two of them, and four
    times the sag of a parabola.
    """
    if len(Q) < 3:
        return np.zeros_like(Q)
    steps = np.diff(Q, axis=0)
    return np.asarray(np.abs(steps - np.roll(steps, 1, axis=0)) / 2)
