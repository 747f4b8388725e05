"""Design of the repeatable inverse nearest to a desired inverse, evaluated on held-out nodes.

Nodes are the configurations of the region Ω at which the cost, the mean squared distance from the
desired inverse, is evaluated; held-out nodes are others. The leaf margin, from 0 to 1, is the
distance from an algorithmic singularity, at which the repeatable inverse fails though J has full
rank. Numbers such as (26) are equations of the paper (docs/notation.md).

``PotentialBasis`` is a basis of N functions of q, whose combinations are the potentials h of a
design. ``FitProblem`` holds the arguments of a fit: desired inverse, potentials, region Ω and
options.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from ..base import progress as reporting
from ..base.arguments import MOST_NODES, as_int, flag, progress_option, require_type, shown
from ..base.errors import InputError, SingularityError
from ..base.fit_options import FitOptions, fit_options
from ..base.threads import one_blas_thread
from ..potentials.basis import A_BASIS, PotentialBasis, check_joints
from ..potentials.polynomial import Polynomial
from ..regions import Region
from ..regions.region import A_REGION
from ..strategies.strategy import AN_INVERSE, Inverse
from .continuation import FitProblem
from .design_result import Design
from .evaluation import REPLICATES
from .fit import fit, undetermined
from .singularity_search import SHRUNK_MARGIN, LeafMargin, SingularRegionError, refuse_singular

_SHRINKINGS = 12
_MOST_DEGREE = 6
_MOST_UNKNOWNS = 1000
_WORTHWHILE = 0.01


@one_blas_thread()
def nearest_repeatable(
    desired: Inverse,
    potentials: PotentialBasis | None,
    region: Region,
    *,
    degree: int | Literal["auto"] | None = None,
    shrink: bool = False,
    options: FitOptions | None = None,
    progress: bool | Callable[[str, float], None] = False,
) -> Design:
    """Find the repeatable inverse nearest to a desired one in the mean over Ω (26), (36), (38).

    Ω is the region, V are the gradients of the r potentials that the inverse keeps constant, and N
    spans the null space of J. Linear least squares give initial coefficients of the potentials,
    which damped Gauss–Newton steps improve. A line search keeps the sign of det(Nᵀ V) at the nodes,
    because this sign changes at an algorithmic singularity. Large fits begin with a smaller set of
    nodes.

    Parameters
    ----------
    desired
        Desired inverse G_d, any strategy with ``J G = I``.
    potentials
        Basis of potentials; None with ``degree=``.
    region
        Design region Ω.
    degree
        Alternative to potentials: all polynomials up to this degree over the box around Ω.
        ``"auto"`` raises the degree from 1 until the cost on held-out nodes falls by less than 1 %;
        the search ends at degree 6 (8 for n ≤ 3), at 1000 unknowns, or when the number of
        potentials exceeds what the given ``samples`` can determine.
    shrink
        If Ω contains a singularity, or a leaf margin below 0.1, design over the largest region with
        the same centre that has neither.
    options
        Nodes, seed and stopping: :class:`FitOptions`.
    progress
        True for a progress bar on stderr, or a callback (step: str, fraction: float).

    Returns
    -------
    Design
        ``inverse``, the controller, and its evaluation: ``cost``, ``relative_distance``,
        ``leaf_margin`` …; see ``summary()``.

    Raises
    ------
    InputError
        If the task is not redundant, the potentials or the region do not fit the task, or there are
        too few nodes.
    SingularRegionError
        If J loses rank in Ω, or the nearest V has an algorithmic singularity there; the message
        names a configuration, and the largest singularity-free region with the same centre.

    Examples
    --------
    >>> options = rp.FitOptions(samples=512, held_out=512)
    >>> potentials, region = rp.Polynomial(q0, 2, 0.4), rp.Box(q0, 0.4)
    >>> found = rp.nearest_repeatable(control, potentials, region, options=options)
    >>> found.converged, found.leaf_margin > 0.9
    (True, True)
    >>> qdot = found.inverse.velocity(q0, [0.1, 0.0])  # rad/s
    """
    require_type(desired, Inverse, "desired", AN_INVERSE)
    require_type(region, Region, "region", A_REGION)
    if potentials is not None:
        require_type(potentials, PotentialBasis, "potentials", A_BASIS)
    options = fit_options(options)
    if options.samples is not None:
        as_int(options.samples, "samples", 1, MOST_NODES)
    if options.held_out is not None:
        as_int(options.held_out, "held_out", 2 * REPLICATES, MOST_NODES)
    shrink = flag(shrink, "shrink")
    progress = progress_option(progress)
    _check(desired, potentials, region, degree)
    if potentials is None:
        potentials = _polynomial(region, 1 if degree == "auto" else degree)
    problem = FitProblem(desired, potentials, region, options)
    with reporting.reporter(progress) as report:
        problem = replace(problem, report=report)
        return _auto(problem, shrink) if degree == "auto" else _shrinking(problem, shrink)


def _auto(problem: FitProblem, shrink: bool) -> Design:
    """Design with rising degree until the cost on held-out nodes stops falling; return the best.

    The search ends at degree 6 (8 for up to three joints), at too many unknowns or too few nodes,
    at a singularity, or at an improvement below 1 %. ``degrees`` of the design lists the degrees
    that were tried. With ``shrink``, the first degree is designed over the largest region with the
    same centre that has no singularity and a leaf margin of at least 0.1; later degrees use it.
    """
    best: Design | None = None
    tried: list[tuple[int, float, float]] = []
    task = problem.desired.task
    samples = problem.options.samples
    for degree in range(1, (_MOST_DEGREE + 2 if task.n <= 3 else _MOST_DEGREE) + 1):
        problem = replace(
            problem,
            potentials=_polynomial(problem.region, degree),
            warm=None if best is None else best.coefficients,
        )
        unknowns = (problem.potentials.size - task.r) * task.r
        few = samples is not None and undetermined(problem.potentials, task, samples)
        if best is not None and (few or unknowns > _MOST_UNKNOWNS):
            break
        try:
            design = _shrinking(problem, shrink and best is None)
        except SingularRegionError:
            if best is None:
                raise
            break
        if shrink and design.leaf_margin < SHRUNK_MARGIN:  # of a higher degree: one region for all
            break
        problem = replace(problem, region=design.region)
        tried.append((degree, design.cost, design.cost_error))
        worthwhile = best is None or design.cost < (1 - _WORTHWHILE) * best.cost
        if best is None or design.cost < best.cost:
            best = replace(design, shrunk=design.shrunk if best is None else best.shrunk)
        if not worthwhile or best.cost < 1e-20:
            break
    assert best is not None, "degree 1 has n ≥ r potentials"
    return replace(best, degrees=tuple(tried))


def _shrinking(problem: FitProblem, shrink: bool) -> Design:
    """Design in the requested region Ω; with ``shrink``, in a smaller one if Ω has singularities.

    The smaller region is the largest that is found free of singularities; if the design fails
    there, too, the next one is at most 0.9 times as large. With ``shrink``, a leaf margin below 0.1
    counts as a singularity. Without ``shrink``, a singularity raises an error. ``shrunk`` of the
    design is the scale of its region relative to Ω.
    """
    asked = problem.region.bounds.half_width
    attempt = 0
    while True:
        try:
            design = fit(problem)
            if shrink:
                _check_margin(design)
            return replace(design, shrunk=float(np.max(design.region.bounds.half_width / asked)))
        except SingularRegionError as error:
            if error.free is None or attempt == (_SHRINKINGS if shrink else 0):
                raise
            # first the region that the error names; a V fitted there may be singular again, so
            # then smaller ones, step by step
            region = error.free
            if attempt > 0:
                stride = problem.region.shrunk(0.9)
                region = min(region, stride, key=lambda one: one.bounds.half_width[0])
            problem = replace(problem, region=region)
            attempt += 1
        except SingularityError as error:
            raise SingularityError(
                f"{error}: the design fails there, not the arm; "
                "use a smaller region, a lower degree, or another center"
            ) from None


def _check_margin(design: Design) -> None:
    """Raise an error if the leaf margin of a design is below 0.1.

    The leaf margin is the smallest that a search of Ω found. Closer to an algorithmic singularity,
    a design is not usable: joint speeds grow as 1 / leaf margin. A region that is shrunk must have
    a leaf margin of at least 0.1, too. The error proposes such a smaller region, if there is one.
    """
    if design.leaf_margin < SHRUNK_MARGIN:
        task = design.inverse.task
        at = design.leaf_margin_at
        measure = LeafMargin(task, design.inverse.potentials, design.region.center)
        what = f"the leaf margin falls to {design.leaf_margin:.2g} in Ω"
        raise refuse_singular(what, task, measure, design.region, at[None])


def _polynomial(region: Region, degree: Any) -> Polynomial:
    box = region.bounds
    return Polynomial(box.center, degree, box.half_width)


def _check(
    desired: Inverse, potentials: PotentialBasis | None, region: Region, degree: int | str | None
) -> None:
    """Check the arguments of :func:`nearest_repeatable` before the long fit; else InputError.

    The task must be redundant, the region must be in the task's joints and overlap their limits,
    and either potentials or a degree must be given.
    """
    task = desired.task
    if task.r < 1:
        raise InputError(
            f"the task is not redundant (r = {task.r}): {task.n} joints move {task.frame!r}, and "
            f"a {task.kind} task has {task.m} coordinates",
            remedy="use a kind of task with fewer coordinates",
        )
    if potentials is None and degree is None:
        raise InputError("the potentials are missing", remedy="give potentials, or degree=2")
    if potentials is not None and degree is not None:
        raise InputError("potentials and degree= are mutually exclusive", remedy="omit one of them")
    if isinstance(degree, str) and degree != "auto":
        raise InputError(f"degree must be a whole number from 1 up, or 'auto', not {shown(degree)}")
    if len(region.center) != task.n:
        raise InputError(
            f"the region has {len(region.center)} joints, but the task has {task.n}",
            remedy="use a region in the joints of the task, such as rp.Box(task.reference, 0.4)",
        )
    box = region.bounds
    low, high = box.center - box.half_width, box.center + box.half_width
    rows = zip(task.joint_names, low, high, task.lower, task.upper, strict=True)
    for name, low, high, least, most in rows:
        if high < least or low > most:
            raise InputError(
                f"the region lies outside the joint limits: {name} from {low:.4g} to {high:.4g}, "
                f"but its limits are [{least:.4g}, {most:.4g}]; move the region"
            )
    if potentials is not None:
        check_joints(potentials, task.n)
