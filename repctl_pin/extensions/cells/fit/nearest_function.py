"""Design of the inverse kinematic function over a cell that is nearest to a desired inverse.

A cell is a box of poses; the function q = F(x) gives one configuration for each of them. It covers
a pose if this configuration is inside the joint limits. A coordinate of a sector, which is a cell
in cylindrical coordinates around an axis, is symmetric if a single joint moves the frame along it.
n is the number of joints.

``CellFit`` holds the arguments of a design over a cell, and the methods that compute the design.
``FailureReason`` is one reason why a function fails at some poses of its cell: cause, share of the
poses, worst pose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import comb
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ....base import progress as reporting
from ....base.arguments import (
    Array,
    as_int,
    positive,
    progress_option,
    require_choice,
    require_type,
)
from ....base.errors import InputError
from ....base.fit_options import FitOptions, fit_options
from ....base.threads import one_blas_thread
from ....strategies.strategy import AN_INVERSE, Inverse
from ..cell_design_result import CellDesign
from ..evaluate.cell_failures import FailureReason, round_the_base
from ..evaluate.reach import rays
from ..evaluate.symmetric_coordinates import reduced
from ..geometry.cell import Cell
from ..geometry.cell_arguments import LEAST_WIDTH
from ..place.posture_search import Candidate, given, searched
from .cell_fit import MOST_UNKNOWNS, CellFit
from .trimming import Required, ended_at_bodies, trimmed

_HELD_OUT = 8192
_MOST_DEGREE = 12
_MOST_SAMPLES, _MOST_HELD_OUT = 2**16, 2**20
_LARGE = 1e6
"""Largest limit margin (rad or m), body distance (m) or σ_min(J) that can be requested."""

_LEAST_FACTOR = 0.03
"""Smallest factor by which a cell is scaled in the search for a cell that is covered."""


class NoFunctionError(InputError):
    """No single function covers the cell.

    A function q = F(x) would give one configuration for each pose of the cell. The message names a
    pose, the obstruction there, and the largest scaled cell that works.

    Attributes
    ----------
    failures : tuple of FailureReason
        Reasons for failure.
    fits : float
        Scale, a factor below 1 of all half-widths, at which one function covers the cell with the
        same middle; 0 if no such scale was found.
    partly : bool
        True if a function covers some of the poses; ``incomplete="keep"`` then works.

    Examples
    --------
    >>> far = rp.Cell(task, task.placement(q0), 3.0)  # farther than the arm reaches
    >>> try:
    ...     options = rp.FitOptions(samples=64, held_out=64)
    ...     rp.nearest_inverse_function(control, far, degree=1, options=options)
    ... except rp.NoFunctionError as error:
    ...     print(type(error).__name__)
    NoFunctionError
    """

    def __init__(
        self,
        fact: str,
        failures: tuple[FailureReason, ...],
        fits: float,
        partly: bool = False,
        remedy: str = "",
    ) -> None:
        super().__init__(fact, remedy=remedy)
        self.failures, self.fits, self.partly = failures, fits, partly


@one_blas_thread()
def nearest_inverse_function(
    desired: Inverse,
    cell: Cell,
    *,
    posture: ArrayLike | None = None,
    degree: int | Literal["auto"] = "auto",
    limit_margin: float = 0.05,
    body_distance: float = 0.0,
    sigma_min: float = 0.0,
    incomplete: Literal["refuse", "shrink", "keep"] = "refuse",
    options: FitOptions | None = None,
    progress: bool | Callable[[str, float], None] = False,
) -> CellDesign:
    """Find the function ``q = F(x)`` over a cell whose ∂F/∂x is nearest to a desired inverse.

    The criterion is ``min mean ‖∂F/∂x − G_d(F)‖_F²`` over the poses of the cell. Following G_d
    along straight rays from the middle of the cell gives reference configurations q_ref, with
    null-space bases n_ref. The functions ``n_refᵀ (F − q_ref) = s(u)`` differ from q_ref by s along
    the self-motion at each pose. s is a polynomial in the coordinates u of the cell, and
    Gauss–Newton steps find the best one. Small distances from joint limits, between bodies and from
    singularities are penalised.

    Parameters
    ----------
    desired
        Desired inverse G_d: any strategy with ``J G = I``.
    cell
        Set of poses: a :class:`Cell` or :class:`Sector`.
    posture : (n,) array, optional
        Configuration in the middle of the cell, rad (m for prismatic joints). By default, the best
        of the configurations that a search finds there.
    degree
        Degree of s. ``"auto"`` raises the degree from 1, as far as the number of unknowns allows.
        The degree stops rising when no higher degree is predicted to lower the cost by 5 %, or the
        extra joint speed is below 0.01 %.
    limit_margin
        Joint-limit margin to keep where possible, rad or m.
    body_distance
        Minimum distance, m, to keep where possible between two links, and between a link and the
        surroundings; with 0, bodies are not in the cost. Close to obstacles, a body distance can
        require much extra joint speed. The summary states which of ``body_distance``,
        ``limit_margin`` and ``sigma_min`` are not met.
    sigma_min
        σ_min of J to keep where possible, in m and rad; with 0, σ_min is not in the cost.
    incomplete
        Action if no single function covers the cell. Coverage is tested at held-out poses, corners,
        and the worst poses found by a search. ``"refuse"`` raises an error, which gives the size of
        a smaller cell that one function covers, if one is found. ``"shrink"`` moves sides of the
        cell inward until one function covers the part that is left. If this part would be less than
        5 % of the cell, the cell is scaled about its middle instead. ``"keep"`` returns a function
        that covers only some of the poses.
    options
        Numbers of nodes, and random seed: ``samples``, ``held_out`` and ``seed`` of
        :class:`FitOptions`.
    progress
        True for a progress bar on stderr, or a callback (step: str, fraction: float).

    Returns
    -------
    CellDesign
        ``function``, the controller ``inverse``, and their evaluation; see ``summary()``.

    Raises
    ------
    InputError
        If the task is not redundant, the cell is for a different task than ``desired``, or the
        middle of the cell cannot be reached.
    NoFunctionError
        If no single function covers the cell.

    Examples
    --------
    >>> cell = rp.Cell(task, task.placement(q0), 0.1)
    >>> options = rp.FitOptions(samples=64, held_out=64)
    >>> found = rp.nearest_inverse_function(control, cell, degree=2, options=options)
    >>> q = found.function(task.placement(q0))  # rad, from the pose alone
    >>> bool(np.abs(task.error(q, task.placement(q0))).max() < 1e-9)
    True
    """
    _require_one_task(desired, cell)
    options = fit_options(options)
    options.require_only(("samples", "held_out", "seed"), "nearest_inverse_function")
    samples = options.samples
    if samples is not None:
        samples = as_int(samples, "samples", 16, _MOST_SAMPLES)
    held_out = _HELD_OUT if options.held_out is None else options.held_out
    require_choice(incomplete, ("refuse", "shrink", "keep"), "way to treat an incomplete cell")
    progress = progress_option(progress)
    cell = _reduced(cell, desired, body_distance)
    fit = CellFit(
        desired,
        _degree(degree, cell),
        limit_margin=_margin(limit_margin, "limit_margin", "rad"),
        body_distance=_margin(body_distance, "body_distance", "m"),
        sigma_min=_margin(sigma_min, "sigma_min"),
        samples=samples,
        held_out=as_int(held_out, "held_out", 64, _MOST_HELD_OUT),
        seed=options.seed,
        keep=incomplete == "keep",
    )
    with reporting.reporter(progress) as report:
        return _found(replace(fit, report=report), cell, posture, incomplete)


def _found(fit: CellFit, cell: Cell, posture: Any, incomplete: str) -> CellDesign:
    """Find the function over the cell, or over the part that ``incomplete`` allows.

    ``fit`` has the arguments of the design, and ``posture`` (n,) is the configuration in the
    middle; None to search for it. If no function covers the whole cell, ``incomplete`` decides:
    ``refuse`` raises NoFunctionError, ``shrink`` returns a function over a smaller part, and
    ``keep`` a function that covers only some of the poses. If such a function is not found either,
    NoFunctionError is raised.
    """
    fit.report("the middle posture", 0.0)
    postures = (
        searched(fit.desired, cell, fit.seed)
        if posture is None
        else [Candidate(given(cell, posture), 1.0, np.inf, np.inf, np.inf)]
    )
    q, found = fit.best(cell, postures)
    partly = isinstance(found, CellDesign) and found.coverage > 0
    if isinstance(found, CellDesign) and (
        found.evaluation.everywhere or (partly and incomplete == "keep")
    ):
        return fit.priced(ended_at_bodies(fit, found), q)
    failures = found.failures if isinstance(found, CellDesign) else found
    if incomplete == "shrink":
        part = trimmed(fit, cell, q, Required())
        if part is not None:
            return ended_at_bodies(fit, part)
    fits, smaller = _largest(fit, cell, q, quick=incomplete != "shrink")
    if incomplete == "shrink" and smaller is not None:
        return smaller
    raise _refusal(cell, failures, fits, keep=partly)


def _require_one_task(desired: Inverse, cell: Cell) -> None:
    """Check that the desired inverse and the cell are for one redundant task; else InputError.

    Without redundancy, each pose has isolated configurations, and nothing is left to design.
    """
    require_type(desired, Inverse, "desired", AN_INVERSE)
    require_type(cell, Cell, "cell", "a cell, such as rp.Cell(task, placement, 0.1)")
    if desired.task.as_dict() != cell.task.as_dict():
        raise InputError(
            f"the controller is for {desired.task!r}, but the cell is for {cell.task!r}; "
            "make both for one task"
        )
    if cell.task.r < 1:
        raise InputError(
            f"{cell.task!r} is not redundant: with r = {cell.task.r} "
            "the pose determines the configuration",
            remedy="use a kind of task with fewer coordinates, or an arm with more joints",
        )


def _degree(degree: int | Literal["auto"], cell: Cell) -> int | Literal["auto"]:
    """Check the degree of the polynomial s(u), ``"auto"`` or from 1 to 12, and return it.

    InputError is raised for other values, and for a degree with too many unknowns. s is the
    position of the function along the self-motion.
    """
    if isinstance(degree, str) and degree == "auto":
        return degree
    degree, k = as_int(degree, "degree", 1, _MOST_DEGREE), cell.whole.k
    if comb(k + degree, degree) * cell.task.r > 4 * MOST_UNKNOWNS:
        raise InputError(
            f"degree {degree} in {k} coordinates of the cell makes more than "
            f"{4 * MOST_UNKNOWNS} unknowns; lower the degree"
        )
    return degree


def _reduced(cell: Cell, desired: Inverse, body_distance: float) -> Cell:
    """Return the same set of poses without symmetric coordinates in u, which make a design slower.

    A symmetric coordinate stays in u if the joint velocities of ``desired``, the inverse G_d,
    change with the joint of the symmetry. If ``body_distance`` is above 0, all symmetric
    coordinates stay in u.

    Raises
    ------
    InputError
        If a coordinate with the range ``"all"`` would remain.
    """
    found = cell if body_distance else reduced(cell, desired)
    for i in cell.free:
        if i not in found._removed:
            why = "body_distance=" if body_distance else "the desired inverse"
            raise InputError(
                f"'all' requires the symmetry of the arm, which {why} breaks",
                argument=cell.coordinate_names[i],
                remedy="give a half-width in rad",
            )
    return found


def _margin(value: float, name: str, unit: str = "") -> float:
    """Check a requested margin, from 0 to 1e6, and return it as float; else raise an InputError.

    The message names the argument by ``name``, and the unit by ``unit``.
    """
    number = positive(value, name, unit, zero=True)
    if number > _LARGE:
        raise InputError(f"can be at most {_LARGE:g}, not {number:g}", argument=name)
    return number


def _largest(fit: CellFit, cell: Cell, q: Array, *, quick: bool) -> tuple[float, CellDesign | None]:
    """Find a scale below 1, nearly the largest, at which one function covers the cell.

    The cell is scaled about its middle, where the configuration is q (n,). Rays, which are motions
    along straight lines from q to corners and other poses, give a first guess of the scale. A
    design confirms the guess; if it fails, the scale is multiplied by 0.8 until a design succeeds.
    With ``quick``, the designs are faster and less accurate.

    Returns
    -------
    factor : float
        The scale; 0 if no smaller cell is covered.
    design : CellDesign or None
        Design over the scaled cell; None with factor 0.
    """
    U = np.concatenate([cell.corners(), cell.sample(32, fit.seed)])
    if cell.widths[cell.widths > 0].min() < LEAST_WIDTH / _LEAST_FACTOR:
        return 0.0, None
    low, high = 0.0, 1.0
    for _ in range(5):
        factor = (low + high) / 2
        fit.report(f"scale that fits: {100 * factor:.0f} %", 0.9)
        ends = rays(fit.desired, cell.scaled(factor), q, U)
        low, high = (
            (factor, high) if (ends.reached == 1).all() and ends.least.min() > 0 else (low, factor)
        )
    while low > _LEAST_FACTOR:
        found = fit.design(cell.scaled(low), q, quick=quick)
        if isinstance(found, CellDesign) and found.evaluation.everywhere:
            return low, found
        low *= 0.8
    return 0.0, None


def _refusal(
    cell: Cell, failures: tuple[FailureReason, ...], fits: float, *, keep: bool
) -> NoFunctionError:
    """Make the error that no function covers a cell, with the reasons and the remedy.

    The message gives the most frequent of the ``failures`` first. It omits collisions, because
    these do not prevent coverage. ``fits`` is the scale of a smaller cell that is covered; 0 if
    there is none. ``keep`` is True if ``incomplete="keep"`` would return a function.
    """
    causes = (stop for stop in failures if stop.cause != "collision")
    failures = tuple(sorted(causes, key=lambda stop: -stop.share))
    why = ", and ".join(stop.what for stop in failures) or "its configurations form no function"
    ring = round_the_base(cell)
    remedy = (
        "use incomplete='shrink' to move its sides inward "
        f"(around the same middle, {cell.scaled(fits).size()} works)"
        if fits > 0
        else "no smaller cell with this middle works either; move the cell, or change posture="
    )
    if keep:
        remedy += ", or incomplete='keep' to keep the covered part of this one"
    because = f"; {ring}" if ring else ""
    fact = f"no single function covers the cell: {why}{because}"
    return NoFunctionError(fact, failures, fits, partly=keep, remedy=remedy)
