"""Prove lower bounds of the leaf margin and the limit margin over a design's region or cell.

The region Ω is the part of joint space over which a design was made. A level is the value h_i(q) of
a potential, which the controller holds constant; a leaf is the set of configurations with the same
levels. The leaf margin, from 0 to 1, is the distance from an algorithmic singularity, at which the
controller fails. Within the closing radius of a start or a path, each closed path of the frame ends
in the configuration it began in. J_V is the task Jacobian stacked on the potentials' gradients;
where it is singular, the controller fails. A cell is a box of poses over which a function gives one
configuration per pose. n is the number of joints. An argument ``field`` has the r potentials of a
design, and ``report`` is the progress callback (step, fraction).

``ClosedPath`` is a closed path as a function of s, which goes from 0 to 1 in a cycle. ``_Closing``
is a request for a closing radius: its path, and the level range within which it must hold.
``Potentials`` are r functions h(q) that a repeatable controller holds constant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...base import progress as reporting
from ...base.arguments import finite, flag, positive, require_type, vector
from ...base.certificate import CELL_THEOREM, Proof
from ...base.errors import InputError, SingularityError
from ...design import Design
from ...design.proof_fingerprint import subject_of
from ...model.task import Task
from ...native import required_library
from ...paths.task_path import ClosedPath
from ...regions import Region, Tube, WorkspaceBox
from ...regions.region import A_REGION
from .boxes import cover, enclosing, limit_margin
from .branch_and_bound import bound_leaf_margin
from .closing_radius import closing_radius
from .find_singularity import opposite_signs
from .leaf_margin_bounds import LeafMarginProblem, leaf_margin_of

if TYPE_CHECKING:
    from ..cells.cell_design_result import CellDesign

_RATIO = 3.0
"""Radians per metre of a closing radius, by default."""

_SHRINKING_SECONDS = 0.2
"""Processor time for each smaller Ω that is tried where there is a singularity, s."""


def prove(
    what: Design | CellDesign,
    margin: float | None = None,
    *,
    limit_margin: float | None = None,
    region: Region | None = None,
    closes: float | tuple[float, float] | ClosedPath | bool = True,
    ratio: float = _RATIO,
    leaf: float = 0.0,
    seconds: float = 60.0,
    progress: bool | Callable[[str, float], None] = False,
) -> Proof:
    """Prove by branch and bound, rounding included, that a design has no singularity in its region.

    J_V is the task Jacobian stacked on the gradients of the potentials. On each box of joints, J_V
    is expanded about its value at the centre, with bounds on the remainder that hold on the whole
    box. The bounds follow from the second derivatives of the joint screws and the third derivatives
    of the potentials. Boxes are halved until their bounds suffice. For the theorem and its
    assumptions, see the theory, "Proved, not sampled".

    Parameters
    ----------
    what
        A design over a region, or the design of a function over a cell of poses. A region is a box
        or a tube in joint space, or a workspace box; for a workspace box, the proof covers the
        whole box of joints from which it selects. For a function, it is also proved that the
        function exists, is smooth, and is the only solution near its interpolation on a grid.
    margin
        Leaf margin to prove, from 0 to 1. By default: for a region, the largest bound that can be
        proved in the time; for a cell, 90 % of the smallest leaf margin of its evaluation.
    limit_margin
        Distance to the joint limits to prove, rad or m. By default: for a region, none; for a cell,
        the smallest distance of its evaluation, reduced by a tenth and by 0.01 rad or m.
    region
        Region of joint space over which to prove a design; by default, the design's own region. A
        proof over another region is no certificate of the design.
    closes
        Closing radius to prove: metres, or (metres, radians); False for none. By default, the
        largest radius that some 250,000 boxes prove. With a closed path, the largest radius along
        that path is proved, instead of the largest radius around the start; for a tube, the path of
        the design's cycle is the default. The function of a cell needs no closing radius, because
        it closes all paths in its cell.
    ratio
        Radians per metre of the closing radius; 0 for paths of constant orientation.
    leaf
        Largest change of each level h_i(q) from its value at the start, in the unit of h_i, for
        which the closing radius is to hold; 0 for motions on one leaf. Above 0, the levels may
        change during a motion. A motion that ends with the pose and the levels it began with is
        then proved to end in the same configuration, too. A closed path as ``closes`` requires 0.
    seconds
        Processor time, s, after which the bounds found so far are returned: once for the margins,
        once for the closing radius.
    progress
        True for a progress bar on stderr, or a callback (step: str, fraction: float).

    Returns
    -------
    Proof
        Whether the goals are ``proved``, the bounds ``leaf_margin`` and ``limit_margin``, the box
        ``worst`` ± ``half`` in which the leaf margin is smallest or the proof failed, and the
        closing radius ``closes``. ``bool(proof)`` is ``proved``.

    Raises
    ------
    InputError
        If the potentials or the region are user-defined, so that no bounds are known; if a region
        is given for a cell; or if there is no native library, the compiled C code of this package.

    Examples
    --------
    >>> proof = rp.prove(design)
    >>> proof.proved, 0.9 * design.leaf_margin < proof.leaf_margin <= design.leaf_margin + 1e-6
    (True, True)
    >>> bool(rp.prove(design, closes=(0.03, 0.1)))  # every closed path within 3 cm and 5.7°?
    True
    """
    if not isinstance(what, Design):
        from ..cells.cell_design_result import CellDesign  # a study has no need of it

        if not isinstance(what, CellDesign):
            raise InputError(
                "the first argument must be a design, such as the result of "
                f"rp.nearest_repeatable; got a {type(what).__name__}"
            )
    goal = None if margin is None else _checked_margin(margin)
    least = None if limit_margin is None else finite(limit_margin, "limit_margin", "rad or m")
    seconds = positive(seconds, "seconds", "s")
    if region is not None:
        require_type(region, Region, "region", A_REGION)
        if not isinstance(what, Design):
            raise InputError(
                ": the function of a cell is proved over its own cell",
                argument="region",
                remedy="omit region=",
            )
    closing = _asked_closing(closes, ratio, positive(leaf, "leaf", zero=True))
    if closing and closing.leaf and not isinstance(what, Design):
        raise InputError(
            ": the function of a cell has one level per pose", argument="leaf", remedy="omit leaf="
        )
    if not callable(progress):
        progress = flag(progress, "progress")
    required_library("a proof")
    with reporting.reporter(progress) as report:
        if isinstance(what, Design):
            over = what.region if region is None else region
            proof = _of_region(what, over, goal, least, seconds, closing, report)
            return _sealed(proof, what, over)
        return _of_cell(what, goal, least, seconds, report)


def _checked_margin(margin: float) -> float:
    """Check a leaf margin to prove, from 0 to 1, and return it; else raise an InputError."""
    value = positive(margin, "margin", zero=True)
    if value > 1:
        raise InputError(
            f"margin must be from 0 to 1, the largest possible leaf margin; got {value:g}"
        )
    return value


class _Closing(NamedTuple):
    """Request for a closing radius: within it, closed paths end in the configuration they began in.

    Attributes
    ----------
    ratio : float
        Radians per metre of the radius.
    metres : float or None
        Radius to prove, m; None for the largest radius.
    path : ClosedPath or None
        Closed path along which to prove the radius; None for the surroundings of the start.
    leaf : float
        Largest change of each level from its value at the start, in the unit of its potential.
    """

    ratio: float
    metres: float | None = None
    path: ClosedPath | None = None
    leaf: float = 0.0


def _asked_closing(closes: Any, ratio: float, leaf: float) -> _Closing | None:
    """Convert ``closes``, ``ratio`` and ``leaf`` of :func:`prove` to a request; None for no radius.

    ``leaf`` is the largest change of each level from its value at the start, in the unit of its
    potential; 0 stands for the start's own leaf. ``closes`` is True, False (no radius), a closed
    path, metres, or (metres, radians); other values raise an InputError. ``ratio`` is in rad per m;
    if ``closes`` is a pair (metres, radians), the ratio of this pair replaces ``ratio``.
    """
    ratio = positive(ratio, "ratio", "rad per m", zero=True)
    if isinstance(closes, ClosedPath):
        if leaf:
            raise InputError("closes= with a closed path and leaf= are mutually exclusive")
        return _Closing(ratio, path=closes)
    if isinstance(closes, (bool, np.bool_)):
        if leaf and not closes:
            raise InputError("leaf= requires a closing radius; omit closes=False")
        return _Closing(ratio, leaf=leaf) if closes else None
    if isinstance(closes, (tuple, list, np.ndarray)):
        metres, radians = vector(closes, 2, "closes, metres and radians,")
        metres = positive(metres, "the metres of closes", "m")
        radians = positive(radians, "the radians of closes", zero=True)
        return _Closing(radians / metres, metres, leaf=leaf)
    return _Closing(ratio, positive(closes, "closes", "m"), leaf=leaf)


def study_proof(
    design: Design, margin: float, seconds: float, radius_seconds: float, patience: float
) -> Proof | None:
    """Prove a leaf margin of a design over its region and, in a tube, the closing radius.

    ``seconds`` is the processor time for the leaf margin, which is given up after the share
    ``patience`` of this time if nothing is proved by then. Return None if it is not proved, without
    a search for the cause. ``radius_seconds`` is the processor time for the radius.
    """
    region = design.region
    low, high = cover(region)
    problem = leaf_margin_of(design.task, design.inverse.potentials, enclosing(low, high))
    silent = reporting.silent
    found = bound_leaf_margin(problem, low, high, margin, seconds, silent, patience)
    if not found:
        return None
    proof = _with_limits(found, design.task, region, None)
    if isinstance(region, Tube):
        closing = _Closing(_RATIO)
        proof = _with_radius(proof, design, region, problem, radius_seconds, closing, silent)
    return _sealed(proof, design, region)


def _sealed(proof: Proof, design: Design, region: Region) -> Proof:
    """Bind a proof to the design and the region that it is about, if they have a fingerprint."""
    subject = subject_of(design.task, design.potentials, design.coefficients, region)
    return proof.sealed(subject) if subject else proof


def _of_region(
    design: Design,
    region: Region,
    goal: float | None,
    least: float | None,
    seconds: float,
    closing: _Closing | None,
    report: reporting.Report,
) -> Proof:
    """Prove the margins and the closing radius of a design over a region of joint space.

    ``goal`` is the leaf margin to prove; None for the largest bound. ``least`` is the limit margin
    to prove, rad or m; None for none. ``seconds`` is the processor time for the margins; the radius
    may take the same time again. If a goal is missed, the returned proof has the box at which the
    goal was missed, and the reason.
    """
    low, high = cover(region)
    problem = leaf_margin_of(design.task, design.inverse.potentials, enclosing(low, high))
    found = bound_leaf_margin(problem, low, high, goal, seconds, report)
    if not found and found.leaf_margin == 0:
        found = _with_singularity(found, design, region, report)
    proof = _with_limits(found, design.task, region, least)
    if not closing:
        return proof
    return _with_radius(proof, design, region, problem, seconds, closing, report)


def _with_limits(found: Proof, task: Task, region: Region, least: float | None) -> Proof:
    """Add the subject and the limit margin over ``region`` to a proof of the leaf margin.

    ``least`` is the limit margin to prove, rad or m; None for none. If it is missed, the returned
    proof has the box at which it was missed, and the reason.
    """
    low, high = cover(region)
    bound, nearest = limit_margin(task, low, high)
    proof = replace(
        found,
        what=f"{task.robot.name} {task}, {region}",
        limit_margin=bound,
        asked_limit_margin=least,
    )
    if least is None or bound >= least:
        return proof
    return replace(
        proof,
        proved=False,
        worst=(low[nearest] + high[nearest]) / 2,
        half=(high[nearest] - low[nearest]) / 2,
        reason=f"the limit margin there is {bound:.4g}",
    )


def _with_radius(
    proof: Proof,
    design: Design,
    region: Region,
    problem: LeafMarginProblem,
    seconds: float,
    closing: _Closing,
    report: reporting.Report,
) -> Proof:
    """Prove a closing radius of a design in ``region``, and add it to a proof of its margins.

    ``problem`` is that of the leaf margin, ``closing`` the request, and ``seconds`` the processor
    time. If the requested radius is missed, the returned proof says so.
    """
    ratio, radius, path, leaf = closing
    if isinstance(region, Tube) and path is None and not leaf:
        if design.cycle is None:
            return proof
        path = design.cycle.path
    report("proving the closing radius", 0.0)
    closes = closing_radius(design, region, problem, path, ratio, radius, seconds, leaf)
    named = proof.reason.startswith("J_V is singular between")
    if named and closes.boxes and not closes:
        closes = replace(closes, reason="J_V is singular in Ω")
    if radius is not None and not closes.metres >= radius:
        said = f"closing radius {closes.size}" if closes else "no closing radius"
        why = f"{said}: {closes.reason}"
        return replace(proof, closes=closes, proved=False, reason=proof.reason or why)
    return replace(proof, closes=closes)


def _with_singularity(
    found: Proof, design: Design, region: Region, report: reporting.Report
) -> Proof:
    """Return a failed proof, with a singularity as its reason if a search finds one.

    J_V is the task Jacobian stacked on the gradients of the potentials. If the search finds two
    configurations at which det J_V has opposite signs, a singularity is between them, and becomes
    the reason. Otherwise, the proof is returned unchanged.
    """
    task, field = design.task, design.inverse.potentials
    if isinstance(region, WorkspaceBox):
        region = region.within
    try:
        pair = opposite_signs(task, field, region, found.worst)
    except SingularityError:  # an arm angle that is not defined somewhere
        return found
    if pair is None:
        return found
    a, b = (", ".join(f"{v:.6g}" for v in np.round(q, 6) + 0.0) for q in pair)
    reason = f"J_V is singular between q = ({a}) and q = ({b}): its determinant changes its sign"
    return replace(
        found,
        worst=(pair[0] + pair[1]) / 2,
        half=np.abs(pair[0] - pair[1]) / 2,
        reason=reason + _without(design, region, float(region.ratio(pair[1][None])[0]), report),
    )


def _without(design: Design, region: Region, share: float, report: reporting.Report) -> str:
    """Search for a smaller Ω that is proved to have no singularity, and state its width as text.

    The text is the last part of the reason of a failed proof. ``share`` is the factor by which Ω is
    scaled such that a known singularity is on its boundary. Ω is scaled by 0.95, 0.8, 0.6 and 0.4
    times this factor, one after the other, until a proof succeeds. If none succeeds, or the factor
    is 0 because the singularity is at the centre, the text is empty.
    """
    if share <= 0:
        return ""
    task, field = design.task, design.inverse.potentials
    for part in (0.95, 0.8, 0.6, 0.4):
        width = part * min(1.0, share)
        low, high = cover(region.shrunk(width))
        problem = leaf_margin_of(task, field, enclosing(low, high))
        if bound_leaf_margin(problem, low, high, 1e-3, _SHRINKING_SECONDS, report):
            return f"; Ω shrunk to {width:.2g} of its width is proved to have none"
    return ""


def _of_cell(
    design: CellDesign,
    goal: float | None,
    least: float | None,
    seconds: float,
    report: reporting.Report,
) -> Proof:
    """Prove that the function of a design exists over its cell of poses, and prove its margins.

    ``goal`` is the leaf margin to prove; None for 90 % of the smallest margin found. ``least`` is
    the limit margin to prove, rad or m; None for slightly less than the smallest margin found.
    ``seconds`` is the processor time.
    """
    from .cell_bounds import CellProof
    from .cell_branch_and_bound import bound_cell

    found = design.evaluation
    leaf = 0.9 * _least_leaf_margin(design) if goal is None else goal
    if least is not None:
        limit = least
    elif np.isfinite(found.limit_margin_worst):
        limit = found.limit_margin_worst - 0.1 * abs(found.limit_margin_worst) - 0.01
    else:
        limit = -np.inf
    name = f"{design.task.robot.name} {design.task}, {design.cell!r}"
    proof = bound_cell(CellProof(design.function.chart), name, leaf, limit, seconds, report)
    proof = replace(
        proof,
        asked_leaf_margin=goal,
        asked_limit_margin=least,
        theorem=CELL_THEOREM,
        excepted=design.function.chart.cell.excepted,
    )
    return proof.sealed(design.subject)


def _least_leaf_margin(design: CellDesign) -> float:
    """Return the smallest leaf margin found in a cell.

    The margin is part of the design's evaluation. Designs from older files lack this figure; for
    these, the result is the smallest margin at 4096 sampled poses and the corners of the cell.
    """
    from ..cells.evaluate.margins import leaf_margins

    found = design.evaluation.leaf_margin
    if np.isfinite(found):
        return found
    chart = design.function.chart
    U = np.concatenate([chart.cell.sample(4096), chart.cell.corners()])
    return float(leaf_margins(chart, chart.solve(U)).min())
