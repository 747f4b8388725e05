"""Search for the best place of a box of poses of given size and orientation.

A cell is a box of poses. J⁺, the pseudoinverse of the task Jacobian, moves the arm from the middle
of a box to its corners. If the arm reaches all corners, the box is a candidate, and the design of a
function shows whether it fits. A flood finds the poses on a grid that the arm reaches from one
configuration without a change of branch, one of the separate solutions of inverse kinematics. A box
grows around a middle in ten steps, by tenths of the requested size. A quick design is a design of
low accuracy, with which boxes are compared. A :class:`Grown` has many middles, with a configuration
at each and the size to which a box grew there. A :class:`Candidate` is one configuration in the
middle of a box, with figures of the motions from there to the corners. A sector is a cell in
cylindrical coordinates around the arm: radius, angle and height, two tilts of the tool, and its
spin. n is the number of joints.

``Approach`` is the axis of the tool that points at the work, and why it was chosen. ``_Fitting`` is
the largest box that one function covers: its cell, the configuration in its middle, and what limits
it. ``CellFit`` holds the arguments of a design over a cell, and the methods that compute the
design. ``FailureReason`` is one reason why a function fails at some poses of its cell: cause, share
of the poses, worst pose. ``Inverse`` is a matrix function G(q) (n, m) with J G = I, evaluated at q
(n,) or Q (K, n).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ....base.arguments import Array, as_matrices, finite, read_only, vector
from ....base.errors import InputError
from ....base.fit_options import FitOptions, fit_options
from ....base.progress import Report, reporter
from ....base.threads import one_blas_thread
from ....model.base_motion import base_placements
from ....model.bodies import bodies_of
from ....model.chain_formulas import require_rotation
from ....model.native_kinematics import placed
from ....model.several_frames import one_frame
from ....model.task import Task, require_task
from ....redundancy.inverses import inverse_condition_number
from ....strategies import Pseudoinverse
from ....strategies.strategy import Inverse
from ..cell_design_result import CellDesign
from ..evaluate.cell_failures import FailureReason, most_singular
from ..evaluate.reach import SINGULAR, STEPS, Grown, drawn, grown, rays, unlike_rows
from ..fit.cell_fit import CellFit
from ..geometry.approach_axis import Approach, approach_axis, with_approach
from ..geometry.cell import Cell
from ..geometry.cell_arguments import of_positions
from ..geometry.kinematics import joined, rows_of
from ..place.posture_search import Candidate, judged, searched
from .middles import APART, ENOUGH, beside, collision_free, middles_in_floods, ordered
from .whole_table import WholeTable, whole_table

_DRAWN = 2048
"""Number of random configurations that are turned to the orientation."""

_PARENTS, _WIDTHS = 16, (0.5, 0.25, 0.12)
"""Number of best middles beside which others are tried, and how far away, in half-widths, one round
after the other."""

_LOOKED, _DEPTH = 128, 8
"""Number of best middles without collisions that are kept, and how many times as many are looked at
for them."""

_TRIED, _ALIKE = 12, 0.3
"""Number of middles with different joints, and at different places, around which boxes are judged;
and difference of the joints, rad or m, below which two middles are alike."""

_MARGIN = 0.05
"""Limit margin, rad or m, that designs keep where possible."""

_JUDGED, _BATCHES, _CONFIRMED, _HELD_OUT = 3, 3, 2, 2048
"""Numbers of places at which designs of one size are compared, of such comparisons per size, and of
designs of full accuracy per comparison; and of their held-out poses."""

_REGULAR, _BESIDE = 48, 0.1
"""Number of places in whose boxes a singularity is searched for; and their smallest difference, in
largest half-widths."""

_SINGULAR_CAUSES = ("singularity", "fold")
"""Causes of failure for which other places are searched for."""

_SURFACE, _LEAST, _UNLIKE = 5, 3, 0.5
"""Numbers of poses per edge of a box at which such a search looks, and of those from which it
begins; and the smallest difference of these, in u."""

_TOOL = {
    "down": np.diag([1.0, -1.0, -1.0]),
    "forward": np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),
    "up": np.eye(3),
}
"""Rotations of the tool whose approach axis, z of its frame, points down, forward (along x of the
base), or up."""


@dataclass(frozen=True, eq=False)
@read_only
class BestCell:
    """Place for a box of poses that the arm reaches as a whole, see :func:`best_cell`.

    Attributes
    ----------
    cell : Cell
        The box; without a size, the largest sector.
    posture : (n,) array
        Configuration in the middle of the cell, rad or m. If the cell is a box, J⁺ reaches all its
        corners from this configuration.
    factor : float
        Length of the edges divided by their requested length; 1 if the box fits, and for a sector.
    margin : float
        For a box, the smallest limit margin on the straight motions to its corners, rad or m; for a
        sector, that of the function over the sector.
    reason : str
        Obstruction to a box of the requested size; empty if a box of that size fits.
    table : WholeTable or None
        Result without a size: the function over the sector (``table.design``), what the same arm
        covers with its redundant joints locked, for comparison (``table.locked``), and what it
        reaches. None with a size.
    approach : Approach or None
        Approach axis of the tool, whose direction the argument ``orientation`` of
        :func:`best_cell` gives; None without that argument. If this axis is not z, the task of
        ``cell`` has a turned frame, whose z axis is the approach axis.

    Examples
    --------
    >>> place = rp.best_cell(task, 0.2)  # m, a square
    >>> place.factor
    1.0
    >>> place.reason
    ''
    """

    cell: Cell
    posture: Array
    factor: float
    margin: float
    reason: str
    table: WholeTable | None = None
    approach: Approach | None = None

    def __repr__(self) -> str:
        fits = "fits" if self.factor == 1 else f"{100 * self.factor:.0f} % of it fits"
        cell = self.cell
        return f"<BestCell: {cell.size()} around {cell.where(np.zeros(cell.k))}, {fits}>"


@one_blas_thread()
def best_cell(
    task: Task,
    size: ArrayLike | None = None,
    *,
    orientation: str | ArrayLike | None = None,
    approach: str | None = None,
    yaw: float = 0.0,
    at: ArrayLike | None = None,
    heights: tuple[float, float] = (-np.inf, np.inf),
    most_extra: tuple[float, float] = (0.05, 0.3),
    options: FitOptions | None = None,
    progress: bool | Report = False,
) -> BestCell:
    """Find the best place for a box of poses; without a size, the largest sector around the arm.

    Without a size, the result is the largest range of radius and height, around the arm and at
    every spin of the tool, that one function covers. Floods over a grid of radius and height show
    what the arm reaches without a change of branch. They begin at random configurations, and at
    configurations that the arm reaches with r joints locked. A function is designed for the best
    sector in these floods, whose range of radius may depend on the height. If the largest rectangle
    in the floods may be as good, a function is designed for this rectangle, too. A sector is
    reduced where its function fails, exceeds the joint speed, or brings bodies nearer than 5 mm.
    The best function is returned.

    A box fits if one function covers it, inside the joint limits and without collisions. First, J⁺,
    the pseudoinverse of the task Jacobian, must lead from a configuration in the middle along
    straight lines to all corners and edges. Then the design of a function confirms the box. The
    middles that are tried are first the positions of the frame in random configurations: from each
    configuration, inverse kinematics turns the frame to the orientation. Then positions beside the
    best of these are tried. If no box of the requested size fits, a second search follows, over
    positions, branches and self-motions, for boxes at whose rims the bodies are apart. If none fits
    either, smaller boxes are tried, in steps of a tenth of the size, and the largest box that fits
    is used. Among boxes of equal size, the order is: nearest to ``at``, if given; above z = 0 of
    the base; limit margin, up to 0.3 rad or m; smallest joint motion. Among the first boxes in this
    order, the result is the box whose function has the best margins, body distance and joint speed.
    Design the function over the result by :func:`nearest_inverse_function`.

    Parameters
    ----------
    task
        The task.
    size : float or (P,) array, optional
        Lengths of the edges of the box, m: one number, or one for each of the P positions that the
        task commands. By default, the largest sector is found instead.
    orientation : str or (3, 3) array, optional
        Direction of the tool's approach axis, ``"down"``, ``"forward"`` (along x of the base) or
        ``"up"``; or the rotation matrix of the frame. By default, the orientation at the task's
        reference.
    approach : str, optional
        Approach axis of the frame: ``"x"``, ``"y"``, ``"z"``, ``"-x"``, ``"-y"`` or ``"-z"``. By
        default, it is found from the last joint and the fingers if ``orientation`` is a word;
        otherwise it is z. An axis task then commands this axis.
    yaw
        Angle, rad, by which the tool is further turned about the base's z axis.
    at : (3,) array, optional
        Position in the base frame, m, that the middle of the box should be near; by default any.
    heights, most_extra : (float, float)
        Limits without a size. ``heights``: lowest and highest position of the frame, m, above the
        point of the arm's axis nearest to the base's origin. ``most_extra``: maximum extra joint
        speed relative to J⁺, on average and at the worst pose.
    options
        Options of the fits. Their seed also determines the middles that are tried.
    progress : bool or callback
        Show a bar, or call ``progress(step, fraction)``.

    Returns
    -------
    BestCell

    Raises
    ------
    InputError
        If the task is not redundant, an argument is invalid, or no box of this orientation fits
        anywhere; the message then states the obstruction.

    Examples
    --------
    >>> place = rp.best_cell(panda, (0.3, 0.3, 0.2), orientation="down")
    >>> place.factor
    1.0
    >>> place.cell.placement.rotation[:, 2].round()  # the tool's z axis
    array([ 0.,  0., -1.])
    """
    one_frame(require_task(task), "a cell")
    if task.r < 1:
        raise InputError(
            f"{task!r} is not redundant: with r = {task.r} the pose determines the configuration",
            remedy="use another kind of task",
        )
    seed = fit_options(options).seed
    approached, task, R = _oriented(task, orientation, approach, yaw)
    if size is None:
        place = _whole(task, R, at, heights, most_extra, seed, progress)
    else:
        place = _of_size(task, R, size, at, seed, progress)
    return replace(place, approach=approached)


def _of_size(
    task: Task, R: Array, size: ArrayLike, at: ArrayLike | None, seed: int, progress: bool | Report
) -> BestCell:
    """Find the best place for a box of the given size, m, with the orientation R (3, 3).

    ``size`` has the lengths of the edges. Among boxes of equal size, the box nearest to ``at``
    (3,), m, is preferred, unless ``at`` is None. ``seed`` is the random seed; ``progress`` shows a
    bar, or is called with (step, fraction).
    """
    edges = of_positions(task, size, "size")
    if not edges.any():
        raise InputError("must be above 0", argument="size")
    near_to = None if at is None else vector(at, 3, "at", "m")
    place = pin.SE3(R, task.placement(task.reference).translation)
    box = Cell(task, place, edges / 2)
    rng = np.random.default_rng(seed)
    with reporter(progress) as report:
        report("looking for places", 0.0)
        found = _candidates(box, near_to, rng, report)
        report("searching for postures", 0.8)
        best = _fitted(box, found, near_to, rng, seed)
    if best is None:
        why = _obstruction(_box_at(box, found.p[0]), found.Q[0])
        raise InputError(
            f"no box of this shape fits in this orientation: {why or 'no function covers it'}",
            remedy="turn the tool, or use another kind of task",
        )
    cell, own, reason = best
    factor = float(cell.widths.max() / box.widths.max())
    if factor < 1:
        reason = _obstruction(cell.scaled(1 / factor), own.q) or reason
    return BestCell(cell, own.q, factor, own.margin, reason * (factor < 1))


def _whole(
    task: Task,
    rotation: Array,
    at: ArrayLike | None,
    heights: Any,
    most_extra: Any,
    seed: int,
    progress: bool | Report,
) -> BestCell:
    """Find the largest sector for the frame's ``rotation`` (3, 3) at the angle 0.

    ``heights`` are the lowest and highest positions of the frame, m, ``most_extra`` the maximum
    extra joint speeds relative to J⁺, on average and at the worst pose. These arguments are checked
    here; ``at`` must be None. ``seed`` is the random seed; ``progress`` shows a bar, or is called
    with (step, fraction).
    """
    if at is not None:
        raise InputError("requires size=", argument="at")
    if task.m < 5:
        raise InputError(
            f": a {task.kind} task leaves the rotation free",
            argument="orientation",
            remedy="use a pose or axis task, or give size=",
        )
    if _on_workpiece(task):
        raise InputError(
            f"the largest sector cannot be searched for: joints of the task move the link "
            f"{task.robot.base!r}, to which the poses are relative",
            remedy="give the size of a box",
        )
    low, high = _pair(heights, "heights", "in m")
    mean, worst = _pair(most_extra, "most_extra")
    if mean <= 0:
        raise InputError("must be above 0", argument="most_extra")
    with reporter(progress) as report:
        found = whole_table(
            task, rotation, heights=(low, high), most_extra=(mean, worst), seed=seed, report=report
        )
    design = found.design
    return BestCell(design.cell, design.posture, 1.0, design.limit_margin_worst, "", found)


def _on_workpiece(task: Task) -> bool:
    """Test whether joints of the task move the link to which the poses are relative.

    For such a task, the floods that find the largest sector would take too long.
    """
    Q = np.stack([task.reference, task.reference + 0.05])
    first, second = base_placements(task.robot, np.stack([task.to_robot(q) for q in Q]))
    return not np.allclose(first, second, rtol=0, atol=1e-9)


def _pair(value: Any, name: str, unit: str = "") -> tuple[float, float]:
    """Check that a value is two increasing numbers (low, high), and return them.

    The numbers may be infinite. ``name`` and ``unit`` are for the error message.
    """
    try:
        low, high = (float(each) for each in value)
    except (TypeError, ValueError):
        raise InputError(f"must be two increasing numbers {unit}".rstrip(), argument=name) from None
    if not low < high:
        raise InputError(f"must be two increasing numbers; got {low:g}, {high:g}", argument=name)
    return low, high


def _oriented(
    task: Task, orientation: Any, approach: Any, yaw: float
) -> tuple[Approach | None, Task, Array]:
    """Return the approach axis, the task with that axis as z, and the tool's rotation (3, 3).

    The rotation is in base axes. ``orientation`` is "down", "forward", "up", a rotation matrix, or
    None for the orientation at the task's reference. ``approach`` names an axis of the frame, "x"
    to "-z"; None stands for the axis along which the tool points. ``yaw``, rad, is a further
    rotation about the base's z axis. If ``approach`` is None and ``orientation`` is not a word, the
    first result is None, and the task is unchanged. An InputError is raised for other values, or if
    the task leaves the rotation free.
    """
    turn = pin.rpy.rpyToMatrix(0.0, 0.0, finite(yaw, "yaw"))
    for name, value in (("orientation", orientation), ("approach", approach)):
        if value is not None and not task.kind.turns:
            raise InputError(
                f": a {task.kind} task leaves the rotation free", argument=name, remedy="omit it"
            )
    found = None
    if approach is not None or isinstance(orientation, str):
        found = approach_axis(task, approach)
        task = with_approach(task, found)
    if orientation is None:
        return found, task, turn @ task.placement(task.reference).rotation
    if isinstance(orientation, str):
        if orientation not in _TOOL:
            raise InputError(
                f"must be 'down', 'forward', 'up' or a rotation matrix; got {orientation!r}",
                argument="orientation",
            )
        return found, task, turn @ _TOOL[orientation]
    (R,) = as_matrices(("the orientation", orientation, "3 3"), exact=True)
    require_rotation(R, "the orientation")
    return found, task, turn @ (R if found is None else R @ found.rotation)


def _candidates(box: Cell, at: Array | None, rng: np.random.Generator, report: Report) -> Grown:
    """Find middles for a box that the arm reaches inside its limits, the best first.

    ``box`` has the requested size and orientation; ``report`` is the progress callback. Random
    configurations are drawn; the positions of the frame in them are the first middles. From each
    configuration, inverse kinematics turns the frame to the orientation of the box. If ``at`` (3,),
    m, is given, each position is first moved toward ``at``: the first one lies at ``at``, the last
    one stays, and those between are moved by ever smaller fractions of their distance. Without
    ``at``, middles from floods around the arm are also tried, for tasks of more than four
    coordinates. Further middles are then tried beside the best middles. An InputError is raised if
    no middle is reached.
    """
    p, Q = drawn(box, _DRAWN, rng)
    if at is not None:
        p = at + np.linspace(0, 1, _DRAWN)[:, None] * (p - at)
    elif box.task.m > 4:
        more = middles_in_floods(box, rng)
        p, Q = (np.concatenate(both) for both in zip((p, Q), more, strict=True))
    found = ordered(box, grown(box, p, Q), at)
    if not len(found.p):
        raise InputError(
            f"the orientation is reached from none of {_DRAWN} random configurations within the "
            "joint limits; give another orientation, or a task that leaves a rotation free"
        )
    wide = rows_of(found, unlike_rows(found.p, box.half_width.max(), _TRIED))
    found = joined([_free(box, found, _LOOKED), _free(box, wide, _TRIED)])
    found = ordered(box, found, at)
    for k, width in enumerate(_WIDTHS):
        report("trying places beside the best", 0.4 + 0.4 * k / len(_WIDTHS))
        parents = _free(box, found, _PARENTS)
        found = ordered(box, joined([found, beside(box, parents, width, rng)]), at)
    return found


def _free(box: Cell, found: Grown, count: int) -> Grown:
    """Select the first ``count`` middles of ``found`` whose configuration has no collision.

    At most ``8 count`` middles are tested, because the test is slow. If all tested middles have a
    collision, only the first middle is returned.
    """
    bodies = bodies_of(box.task)
    free: list[int] = []
    for first in range(0, min(len(found.p), _DEPTH * count), count):
        here = bodies.distances(found.Q[first : first + count]) >= 0
        free += [*first + np.flatnonzero(here)]
        if len(free) >= count:
            break
    return rows_of(found, free[:count] or [0])


class _Fitting(NamedTuple):
    """Largest box that one function covers, as a design showed.

    Attributes
    ----------
    cell : Cell
        The box.
    own : Candidate
        Configuration in the middle of the box, from which the function was designed.
    reason : str
        Reason why no function covers a larger box; empty if no larger box was tried.
    """

    cell: Cell
    own: Candidate
    reason: str


def _fitted(
    box: Cell, found: Grown, at: Array | None, rng: np.random.Generator, seed: int
) -> _Fitting | None:
    """Find the largest box around one of the middles ``found`` that one function covers.

    ``box`` has the requested size. If a box of the requested size fits around none of the middles,
    further middles are searched for at which the bodies are apart at the box's rim. Then smaller
    boxes are tried, in steps of a tenth of the size. Return None if no function covers a box of any
    size. Among boxes of equal size, the one nearest to ``at`` (3,), m, is preferred, unless ``at``
    is None; ``seed`` is for the fits.
    """
    fit = CellFit(
        Pseudoinverse(box.task), limit_margin=_MARGIN, held_out=_HELD_OUT, seed=seed, keep=False
    )
    free = _free(box, found, len(found.p))
    tried = _tried(fit, box, free)
    stop: FailureReason | None = None
    searched_regular = False
    for size in range(STEPS, 0, -1):
        best, why = _best_place(fit, box, tried, size)
        singular = best is None and why is not None and why.cause in _SINGULAR_CAUSES
        others = _others(free, tried, size)
        # once, because the search is slow
        if singular and len(others.p) and not searched_regular:
            searched_regular = True
            best, _ = _best_place(fit, box, _regular(box, others, size), size)
        if best is None and size == STEPS:
            further = collision_free(box, free, at, rng, drawn=_DRAWN, parents=_PARENTS)
            further = _strict(fit, box, further)
            best, later = _best_place(fit, box, further, size)
            tried, why = joined([tried, further]), why or later
        if best is not None:
            return _Fitting(*best, stop.what if stop is not None else "")
        stop = stop or why
    return None


def _tried(fit: CellFit, box: Cell, found: Grown) -> Grown:
    """Select middles with unlike configurations or at different places, and test their boxes.

    The boxes around the middles are tested with J⁺. ``steps`` of the result are the largest sizes,
    in tenths of the requested size, at which J⁺ reaches all corners inside the limits and without
    collisions.
    """
    rows = [*unlike_rows(found.Q, _ALIKE, _TRIED)]
    rows += unlike_rows(found.p, box.half_width.max(), _TRIED)
    rows = list(dict.fromkeys(rows))
    steps = [_largest_steps(fit.desired, box, found, k) for k in rows]
    return rows_of(found, rows)._replace(steps=np.array(steps, int))


def _strict(fit: CellFit, box: Cell, found: Grown) -> Grown:
    """Select up to 12 middles with unlike configurations, from which J⁺ reaches the whole box.

    The box around a middle has the size to which it grew there, ``steps`` of ``found``. J⁺ must
    reach all corners of this box inside the limits and without collisions. Among middles with
    similar configurations, only the first that passes this test is taken.
    """
    kept: list[int] = []
    for k in range(min(len(found.p), _LOOKED)):
        cell, q = _box_at(box, found.p[k], found.steps[k] / STEPS), found.Q[k]
        if len(kept) == _TRIED:
            break
        unlike = (np.abs(found.Q[kept] - q).max(axis=1) > _ALIKE).all()
        if unlike and _fits(judged(fit.desired, cell, q[None])[0]):
            kept.append(k)
    return rows_of(found, kept)


def _others(free: Grown, tried: Grown, size: int) -> Grown:
    """Select middles of ``free`` around which a box grew to at least ``size`` tenths.

    Configurations of ``tried`` whose box has at least this size, too, are left out.
    """
    places = tried.Q[tried.steps >= size]
    known = (free.Q[:, None] == places).all(axis=2).any(axis=1)
    return rows_of(free, np.flatnonzero((free.steps >= size) & ~known))


def _best_place(
    fit: CellFit, box: Cell, found: Grown, size: int
) -> tuple[tuple[Cell, Candidate] | None, FailureReason | None]:
    """Choose the best middle for a box of ``size`` tenths of the requested size.

    At most nine middles are tried: the first of ``found`` around which a box of that size fits.
    Three at a time are compared by quick designs, and a full design confirms the best of the three.
    The search ends when a full design covers its box. Return a pair: the box and the configuration
    in its middle, or None; and the first reason for failure, or None.
    """
    stop: FailureReason | None = None
    places = np.flatnonzero(found.steps >= size)[: _BATCHES * _JUDGED]
    for first in range(0, len(places), _JUDGED):
        some = rows_of(found, places[first : first + _JUDGED])
        best, why = _best_of(fit, box, some, size, search=first == 0)
        stop = stop or why
        if best is not None:
            return best, stop
    return None, stop


def _regular(box: Cell, found: Grown, size: int) -> Grown:
    """Select middles whose boxes contain no singularity, as far as a search finds.

    The edges of a box are ``size`` tenths of the requested edges. The middles are sorted by the
    smallest σ_min / σ_max of J that was found in the box, the largest first. Earlier tests of a box
    cover only the points of its rim, but a singularity can lie between these points. If several
    middles are near each other, only one is tested, because their boxes meet the same singularity.
    """
    found = rows_of(found, unlike_rows(found.p, _BESIDE * box.half_width.max(), _REGULAR))
    ratios = np.array(
        [
            _least_ratio(_box_at(box, p, size / STEPS), q)
            for p, q in zip(found.p, found.Q, strict=True)
        ]
    )
    order = np.argsort(-ratios)
    return rows_of(found, order[ratios[order] > SINGULAR])


def _least_ratio(cell: Cell, q: Array) -> float:
    """Search a box for the smallest ratio σ_min / σ_max of J.

    Motions with J⁺ lead from the configuration q (n,) in the middle to poses of a grid on the box's
    surface. The search begins at the poses with the smallest ratios. The result is 0 if a pose of
    the grid is not reached.
    """
    ways = np.meshgrid(*[np.linspace(-1, 1, _SURFACE)] * cell.k, indexing="ij")
    U = np.stack(ways, axis=-1).reshape(-1, cell.k)
    U = U[np.abs(U).max(axis=1) == 1]
    ends = rays(Pseudoinverse(cell.task), cell, q, U, steps=8)
    if ends.reached.min() < 1:
        return 0.0
    order = np.argsort(inverse_condition_number(placed(cell.task, ends.Q)[2]))
    starts = order[unlike_rows(U[order], _UNLIKE, _LEAST)]
    return min(most_singular(cell, U[[k]], ends.Q[[k]])[1] for k in starts)


def _best_of(
    fit: CellFit, box: Cell, places: Grown, size: int, *, search: bool
) -> tuple[tuple[Cell, Candidate] | None, FailureReason | None]:
    """Choose the best of some places for a box of ``size`` tenths of the requested size.

    ``places`` are middles of the box with configurations there, and ``box`` has the requested size
    and orientation. The places are compared by quick designs: by limit margin, body distance and
    joint speed. With ``search``, other configurations in the middle of the first place are searched
    for, and compared as well. A design of full accuracy confirms the choice. Return a pair: the box
    at the best place with the configuration in its middle, or None if no design covers a box; and
    the reason why the first design of full accuracy failed, or None if no such design failed.
    """
    desired, reason = fit.desired, None
    cells = [_box_at(box, p, size / STEPS) for p in places.p]
    tried = [
        (cell, judged(desired, cell, q[None])[0]) for cell, q in zip(cells, places.Q, strict=True)
    ]
    if search:
        with suppress(InputError):  # it draws other configurations, which may all fail
            others = searched(desired, cells[0])[:_JUDGED]
            kept = [tried[0][1]]
            for one in others:
                if _fits(one) and not _repeats(box.task, one, kept):
                    kept.append(one)
            tried += [(cells[0], one) for one in kept[1:]]
    quick = [(fit.design(cell, own.q, quick=True), cell, own) for cell, own in tried]
    quick.sort(key=lambda part: -_worth(part[0]))
    good = sum(_worth(guess) > 0 for guess, *_ in quick)
    for guess, cell, own in quick[: max(1, min(good, _CONFIRMED))]:
        design = fit.design(cell, own.q, guess=guess)
        if isinstance(design, CellDesign) and _worth(design) > 0:
            return (cell, own), reason
        reason = reason or _main_failure(design)
    return None, reason


def _repeats(task: Task, one: Candidate, others: list[Candidate]) -> bool:
    """Test whether one of ``others`` nearly equals ``one`` and has no smaller limit margin.

    All are configurations in the middle of the same box. Revolute joints are compared up to full
    turns, which make no difference to the function, only to the limit margin.
    """
    away = one.q - np.array([other.q for other in others])
    away -= 2 * np.pi * np.round(away / (2 * np.pi)) * task.revolute
    alike = np.abs(away).max(axis=1) < _ALIKE
    inside = np.array([min(other.margin, ENOUGH) for other in others])
    return bool((alike & (inside >= min(one.margin, ENOUGH) - APART)).any())


def _largest_steps(desired: Inverse, box: Cell, found: Grown, k: int) -> int:
    """Find the largest number of steps to which a box grows around middle k and still fits.

    A step is a tenth of the requested size. The box fits if J⁺ reaches all corners, inside the
    limits and without collisions.
    """
    low, high = 0, int(found.steps[k])
    middle = high
    while low < high:
        cell = _box_at(box, found.p[k], middle / STEPS)
        if _fits(judged(desired, cell, found.Q[k][None])[0]):
            low = middle
        else:
            high = middle - 1
        middle = (low + high + 1) // 2
    return low


def _worth(design: object) -> float:
    """Rate a design by joint speed, body distance and limit margin; a higher number is better.

    Body distances above 2 cm and limit margins above 0.3 rad or m do not raise the rating. The
    rating is 0 if the function does not cover the box, or bodies collide, or ``design`` is no
    design.
    """
    if not isinstance(design, CellDesign) or not design.evaluation.everywhere:
        return 0.0
    clear = min(design.body_distance / APART, 1.0)
    inside = min(design.limit_margin_worst / ENOUGH, 1.0)
    return max(clear, 0.0) * (0.1 + inside) / (1 + 10 * design.extra_speed)


def _main_failure(design: CellDesign | tuple[FailureReason, ...]) -> FailureReason | None:
    """Return the reason for failure with the largest share of poses; None without a reason."""
    failures = design.failures if isinstance(design, CellDesign) else design
    return max(failures, key=lambda stop: stop.share, default=None)


def _box_at(box: Cell, p: Array, factor: float = 1.0) -> Cell:
    """Return the box with its middle moved to p (3,), m, and its edges multiplied by a factor."""
    place = pin.SE3(box.placement.rotation, p)
    return Cell(box.task, place, factor * box.half_width)


def _fits(candidate: Candidate) -> bool:
    """Test whether J⁺ reaches all corners of a box, inside the limits and without collisions."""
    return candidate.share == 1 and candidate.margin > 0 and candidate.body_distance >= 0


def _obstruction(cell: Cell, q: Array) -> str:
    """Write why J⁺ does not lead from the configuration q (n,) in a cell's middle to all corners.

    The text completes an error message. The obstruction is a corner out of reach or behind a
    singularity, a joint that leaves its limits, or two bodies that collide. The text is empty if
    there is no obstruction.
    """
    task, corners = cell.task, cell.corners()
    ends = rays(Pseudoinverse(task), cell, q, corners, steps=16)
    worst = int(np.argmin(np.where(ends.reached < 1, ends.reached - 2, ends.least)))
    where = cell.where(corners[worst])
    if ends.reached[worst] < 1:
        share = 100 * ends.reached[worst]
        return (
            f"on the straight line to the corner {where}, the arm is at the end of its reach or at "
            f"a singularity after {share:.0f} %"
        )
    if ends.least[worst] <= 0:
        margins = task.limit_margin(ends.Q[worst])
        joint = task.joint_names[int(np.argmin(margins))]
        return f"on the straight line to the corner {where}, {joint!r} leaves its limits"
    bodies = bodies_of(task)
    Q = np.array([q, *ends.Q])
    k = int(np.argmin(bodies.distances(Q)))
    near = bodies.nearest(Q[k])
    place = "in the middle" if k == 0 else f"at the corner {cell.where(corners[k - 1])}"
    if near.distance < 0:
        return f"{place}, {' and '.join(near.links)} collide"
    return ""
