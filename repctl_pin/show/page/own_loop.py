"""Numbers with which the animation page computes motions along a visitor's own loop.

A visitor of the page can draw a closed path, a loop, and see how the arm follows it. From these
numbers, the page's ``law.js`` evaluates forward kinematics, J, and two controllers: ``q̇ = J⁺ ẋ``
and ``[J; Vᵀ] q̇ = [ẋ; 0]``. V holds the gradients of the potentials, which the second controller
keeps constant.

``CarriedFrame`` is a frame of a robot: the joints that move it, and its placement after the last of
them. ``Potentials`` are r functions h(q) that a repeatable controller holds constant.
``FourierMap`` is r potentials h(q) as Fourier series. ``PolynomialMap`` is r potentials h(q) as
polynomials.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...base.arguments import Array
from ...base.certificate import ClosingRadius
from ...model.arm_links import arm_links, link_origins
from ...model.coupled_ends import other_ends
from ...model.joint_chain import CarriedFrame, joint_tree
from ...model.length import arm_length
from ...model.several_frames import of_singles
from ...model.task import Task
from ...model.visuals import Visuals
from ...motion import Motion, elbow
from ...paths.several_paths import paths_of
from ...potentials.basis import Potentials, SumMap
from ...potentials.fourier import FourierMap
from ...potentials.polynomial import PolynomialMap
from ...strategies import Pseudoinverse, RepeatableInverse, Strategy
from ...studies.study_result import Study
from ..text.headline import end_name, hands_back
from ..text.part_names import hand_names, part_name

_MOST_TERMS = 2000
"""Maximum number of terms of potentials that a page evaluates: some 10 µs each time."""

_Numbers = dict[str, Any]


def own_loop(
    motion: Motion, strategies: Sequence[Strategy], closes: ClosingRadius | None = None
) -> _Numbers | None:
    """Collect the numbers with which the page follows a visitor's loop, in plain types for JSON.

    Parameters
    ----------
    motion
        A motion that the page shows. The visitor's loop is followed from the start of this motion,
        at the speed of this motion along its path, and with the same number of steps per cycle.
    strategies
        Controllers, one per pane of the page, in order.
    closes
        Proved closing radius of the repeatable controller, around the start pose or around a path:
        closed paths within this distance of it close in joint space. None if no radius is proved.

    Returns
    -------
    dict or None
        Numbers by the names that ``law.js`` reads. None if a controller or a potential is
        user-defined, if one of several frames has a ``base`` of its own, or if the potentials have
        more than 2000 terms; the visitor then cannot draw a loop.
    """
    task, q0 = motion.task, motion.q[0]
    # the laws of the controllers, which the page evaluates in JavaScript
    laws = [_law(strategy) for strategy in strategies]
    singles = of_singles(task, q0)
    bases = {single.robot.base for single, _ in singles}
    if (len(singles) > 1 and bases != {None}) or any(law is None for law in laws):
        return None
    # the kinematic tree, and the links that the task moves
    tree, own = joint_tree(task), arm_links(task)
    base = tree.base and _carried(tree.base)
    shapes = Visuals.of(task.robot).shapes
    names = {link: part_name(task, q0, link) for link in own}
    joints = [
        {
            "parent": int(tree.parents[j]),
            "R": tree.R[j].ravel().tolist(),
            "p": tree.p[j].tolist(),
            "axis": tree.axes[j].tolist(),
            "turns": bool(tree.revolute[j]),
            "S": tree.S[j].tolist(),
            "offset": float(tree.offset[j]),
        }
        for j in range(len(tree.parents))
    ]
    # frames, joints, limits and other ends, in plain types
    return {
        "frames": [
            {
                "frame": single.frame,
                "kind": str(single.kind) if single.kind.turns else "position",
                "rows": single.kind.rows.tolist(),
                **_carried(frame),
                "base": base,
                "elbow": int(
                    tree.first[task.joint_names.index(single.joint_names[elbow(single, q)])]
                ),
                "hand": hand,
            }
            for (single, q), frame, hand in zip(singles, tree.frames, hand_names(task), strict=True)
        ],
        "back": hands_back(task.kind.each),
        "path": _path(motion),
        "joints": joints,
        "first": tree.first.tolist(),
        "laws": laws,
        "start": q0.tolist(),
        "steps": motion.steps,
        "speed": motion.path.length * motion.cycles / float(motion.t[-1]),
        "names": list(task.joint_names),
        "turns": task.revolute.tolist(),
        "lower": _finite(task.lower),
        "upper": _finite(task.upper),
        "fastest": _finite(task.velocity_limit),
        "size": arm_length(task, q0) or 1.0,
        "axis": _first_axis(task),
        "rails": _rails(task, q0),
        "proved": _proved(closes, q0),
        "ends": [
            {
                "link": link,
                "name": end_name(link),
                "joint": tree.riding[link],
                "at": link_origins(task, [link], q0[None])[0, 0].tolist(),
            }
            for link in other_ends(task)
        ],
        "links": [
            None if shape.standing else [tree.riding[shape.link], names.get(shape.link)]
            for shape in shapes
        ],
    }


def _carried(frame: CarriedFrame) -> _Numbers:
    return {"chain": frame.chain.tolist(), "R": frame.R.ravel().tolist(), "p": frame.p.tolist()}


def study_loop(study: Study) -> _Numbers | None:
    """Collect the numbers for a visitor's own loop on the page of a study.

    The controllers are J⁺ and the nearest repeatable inverse; a controller without a motion is left
    out. Returns None if the page cannot compute a controller, no motion is shown, or the page also
    shows a user-defined controller.
    """
    laws: dict[str, Strategy] = {
        "pseudoinverse": Pseudoinverse(study.task),
        "repeatable": study.design.inverse,
    }
    hidden = ("posture", "posture_off")
    moved = {
        row.key: row.motion
        for row in study.rows
        if row.motion is not None and row.key not in hidden
    }
    if not moved or not moved.keys() <= laws.keys():
        return None
    proof = study.design.proof if "repeatable" in moved else None
    return own_loop(
        next(iter(moved.values())), [laws[key] for key in moved], proof.closes if proof else None
    )


def _proved(closes: ClosingRadius | None, q0: Array) -> float | None:
    """Return the proved closing radius around the pose of the start q0 (n,), m, rounded down.

    Every closed path within this distance of the start pose closes in joint space. A radius that is
    proved around a path is also valid around the pose where that path begins. The result has two
    digits; it is None if no radius is proved, or if it is proved for another start than q0.
    """
    if not closes or not np.allclose(closes.start, q0, rtol=0, atol=1e-9):
        return None
    digit = 10.0 ** (np.floor(np.log10(closes.metres)) - 1)
    return float(np.floor(closes.metres / digit) * digit)


def _path(motion: Motion) -> list[int | None] | None:
    """List, for each frame, the index of its path among the paths of the page.

    The entry of a frame at rest is None. If a visitor changes the start, the page follows these
    paths from the new start. The whole result is None if a frame rotates along its path, which the
    page cannot compute.
    """
    paths = paths_of(motion.path)
    if any(np.abs(path.twist(s)[3:]).max() > 1e-12 for path in paths for s in (0.1, 0.4, 0.7)):
        return None
    return [k if path.length > 0 else None for k, path in enumerate(paths)]


def _finite(values: Array) -> list[float | None]:
    """Convert joint limits (n,) to a list of plain numbers, in which None stands for no limit.

    JSON has no infinity.
    """
    return [float(v) if np.isfinite(v) else None for v in values]


def _first_axis(task: Task) -> _Numbers | None:
    """Describe the axis of the first joint by ``axis`` (direction), ``origin``, m, and ``name``.

    Both vectors (3,) are in the base frame, at the reference pose. A motion along a loop that winds
    around this axis need not close. If the task is on a workpiece, the first joint is the one next
    to the workpiece. None if the joint is prismatic.
    """
    first = 0 if len(task.frames) > 1 else int(np.argmin(task._first))
    if not task.revolute[first]:
        return None
    axis, origin = (places(task.reference)[first] for places in (task.axes, task.joint_origins))
    return {"axis": axis.tolist(), "origin": origin.tolist(), "name": task.joint_names[first]}


def _rails(task: Task, q0: Array) -> list[list[float] | None]:
    """Measure the rails that are drawn: for each joint, the positions at their two ends, m.

    A rail is the parent link of a prismatic joint, if at q0 (n,) the child link is between the ends
    of its shapes along the joint's axis. The entry is None for a joint without a rail, for one
    whose rail is as long as its range, and for all joints of a task on a workpiece.
    """
    rails: list[list[float] | None] = [None] * task.n
    if task.robot.base:
        return rails
    visuals = Visuals.of(task.robot)
    links = {joint.name: joint for joint in task.robot.description.joints}
    for i in np.flatnonzero(~task.revolute):
        joint = links[task.joint_names[i]]
        rows = np.array([q0, q0 + np.eye(task.n)[i]])
        here, there = link_origins(task, [joint.child], rows)[:, 0]
        places = visuals.placements(task.to_robot(q0)[None])[0]
        along = [
            float(s)
            for shape, M, corners in zip(visuals.shapes, places, visuals.corners(), strict=True)
            if shape.link == joint.parent
            for s in q0[i] + (corners @ M[:3, :3].T + M[:3, 3] - here) @ (there - here)
        ]
        low, high = min(along, default=np.inf), max(along, default=-np.inf)
        if low < q0[i] < high and (task.lower[i] < low or high < task.upper[i]):
            rails[i] = [low, high]
    return rails


def _law(strategy: Strategy) -> list[_Numbers] | None:
    """Describe a controller by its potentials, in a list of dictionaries; empty for J⁺.

    The potentials are a sum of polynomials and Fourier series, with one dictionary each. The keys
    are ``joints``, ``center``, ``scale`` and ``terms`` of a polynomial, or ``waves``, ``sines`` and
    ``cosines`` of a Fourier series. The result is None if the page cannot compute the controller:
    it is neither J⁺ nor a :class:`RepeatableInverse`, its potentials are user-defined, or they have
    more than 2000 terms.
    """
    if type(strategy) is Pseudoinverse:
        return []
    if type(strategy) is not RepeatableInverse:
        return None
    parts = _potentials(strategy.potentials)
    if parts is None:
        return None
    count = sum(len(part.get("terms") or part["waves"]) for part in parts)
    return parts if count <= _MOST_TERMS else None


def _potentials(h: Potentials) -> list[_Numbers] | None:
    """Describe potentials h as a list of polynomials and Fourier series, of which h is the sum.

    Each is a dictionary, whose keys are attributes of :class:`PolynomialMap` (``joints``,
    ``center``, ``scale``, ``terms``) or :class:`FourierMap` (``waves``, ``sines``, ``cosines``).
    The result is None for any other potentials.
    """
    if isinstance(h, SumMap):
        found: list[_Numbers] = []
        for part in h.maps:
            described = _potentials(part)
            if described is None:
                return None
            found += described
        return found
    if isinstance(h, FourierMap):
        return [{name: getattr(h, name).tolist() for name in ("waves", "sines", "cosines")}]
    if not isinstance(h, PolynomialMap):
        return None
    terms = [
        [[i for i, power in enumerate(beta) for _ in range(power)], factors.tolist()]
        for beta, factors in h.terms.items()
        if any(beta)
    ]
    return [
        {
            "joints": h.joints.tolist(),
            "center": h.center.tolist(),
            "scale": h.scale.tolist(),
            "terms": terms,
        }
    ]
