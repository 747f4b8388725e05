"""``repctl design``: find the nearest repeatable inverse over a region, and evaluate it.

The region Ω is the part of joint space for which the design is made: a box around the start, or a
tube around a motion. The design is fitted at some configurations (nodes) and evaluated at others
(held-out nodes). The design approximates the desired inverse, usually J⁺; its cost is the mean
squared distance between the two over Ω. A problem is a task with a start, a closed path and a
region. ``say`` is the callback that receives the name of each step.

``_Made`` is a design with the data of its report: problem, name of the desired inverse, costs by
degree, figures of two simpler repeatable inverses, notes.
"""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import repctl_pin as rp

from ..base.defaults import NODES, REGION
from ..base.errors import InputError
from ..base.files import write_whole, written_together
from ..show.text.coloured_text import fitted, noted
from ..show.text.numbers import row
from .exit_codes import proof_code
from .options import Parser
from .parsed_options import (
    Options,
    box_within_limits,
    cut_note,
    integer,
    natural,
    positive,
    proved,
    require_proofs,
    with_options,
)
from .print_result import print_result
from .terminal import in_percent, progress

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ..design.evaluation import Baseline
    from ..regions import Region

HELP = (
    "find the repeatable inverse nearest to J⁺, or to a weighted inverse, over a region of joint "
    "space"
)
EXAMPLE = """examples:
  repctl design panda --region 0.4 --degree auto
  repctl design panda --task position --weight inertia --shrink --region 1.2
  repctl design xarm7 --path circle:0.1 --region 0.2  # a tube around the motion
  repctl design panda --degree 3 --samples 262144"""


def add_options(parser: Parser) -> None:
    """Add the options of ``repctl design`` to its parser; :func:`run` reads them."""
    parser.robot()
    parser.task()
    parser.weight()
    add = parser.add_argument
    add(
        "--region",
        type=positive,
        default=REGION,
        metavar="W",
        help="half-width of Ω around the start, rad (default %(default)s)",
    )
    parser.path("use as Ω a tube of radius --region around the motion on this path: ", "")
    workspace = "restrict Ω to frame positions within M metres of the start, along each axis"
    add("--workspace", type=positive, metavar="M", help=workspace)
    add("--shrink", action="store_true", help="shrink Ω until it is free of singularities")
    add(
        "--degree", default="auto", metavar="D", help="degree of the polynomials, or auto (default)"
    )
    fourier = "add sines and cosines up to order K of the revolute joints"
    add("--fourier", type=integer, metavar="K", help=fourier)
    add("--samples", type=integer, help="number of fit nodes (default: by the number of unknowns)")
    add(
        "--held-out",
        type=integer,
        default=NODES,
        help="number of held-out nodes, which evaluate the design (default %(default)s)",
    )
    add(
        "--restarts",
        type=natural,
        default=0,
        metavar="K",
        help="number of extra starts of the optimiser",
    )
    add("--seed", type=natural, default=0, help="random seed of all nodes (default 0)")
    add(
        "--prove",
        action="store_true",
        help="prove a lower bound of the leaf margin over Ω, for at most a minute",
    )
    parser.levels("; requires --prove")
    add(
        "--out",
        metavar="FOLDER",
        help="folder of design.png and design.json (default repctl-out/ROBOT)",
    )
    parser.json("the table", quiet=True)


def run(options: Options) -> int:
    """Design a repeatable inverse, print its table, and write ``design.json`` and ``design.png``.

    The files are also written if a proof requested by ``--prove`` was not reached; the exit code is
    then 3, else 0.
    """
    folder = options.output_folder(Path(options.robot).stem)
    say = progress(options.quiet)
    degree = options.asked_degree()
    _check(options, degree)
    require_proofs(options.prove)

    from ..design.design_map import degree_curve
    from ..studies.around_motion import shrunk_note
    from ..studies.design_choice import choose_desired

    # the design, and what it is compared with
    problem = _problem(options, degree)
    desired, name = choose_desired(problem.task, options.asked_weight())
    share_done = in_percent(say)
    problem, design = _designed(options, problem, desired, degree, say)
    degrees = degree_curve(design, share_done)
    baselines = design.evaluate_baselines(progress=share_done)

    # its cycle, and its proof
    notes = [*problem.task.narrowed, *_cut(options, problem), *problem.moved, *shrunk_note(design)]
    say("finding a cycle inside Ω")
    design, more = _with_cycle(design, problem)
    notes.extend(more)
    if options.prove:
        design = proved(design, say, leaf=options.leaf or 0.0)
        notes.extend(_unproved(design))

    say("comparing and drawing")
    made = _Made(design, problem, name, degrees, baselines, notes)
    files = _written(made, folder)
    print_result(options, lambda: _as_dict(made), lambda: _text(made), files)
    return proof_code(design.proof)


class _Made(NamedTuple):
    """Design that the command made, with the other data of its report.

    ``name`` describes the desired inverse. ``degrees`` are tuples (degree, cost, standard error of
    the cost). ``baselines`` are the figures of two simpler repeatable inverses, for comparison: one
    with linear potentials, and the extended Jacobian. ``notes`` are texts.
    """

    design: rp.Design
    problem: rp.Problem
    name: str
    degrees: Sequence[Any]
    baselines: Sequence[Baseline]
    notes: list[str]


def _designed(
    options: Options, problem: rp.Problem, desired: Any, degree: Any, say: Callable[[str], None]
) -> tuple[rp.Problem, rp.Design]:
    """Design the repeatable inverse nearest to ``desired``.

    ``degree`` is the degree of the polynomials, or ``auto``. Return the problem with the region of
    the design, and the design. The remedy of a SingularRegionError names options of the command.
    """
    from ..studies.around_motion import design_for

    def make(region: Region) -> rp.Design:
        potentials = _potentials(problem.task, region, degree, options.fourier)
        return rp.nearest_repeatable(
            desired,
            potentials,
            region,
            degree=degree if potentials is None else None,
            shrink=options.shrink,
            options=rp.FitOptions(**options.of("samples", "held_out", "seed", "restarts")),
            progress=in_percent(say),
        )

    try:
        return design_for(problem, desired, make, width=options.region, seed=options.seed, say=say)
    except rp.SingularRegionError as error:
        raise with_options(error, shrink=not options.shrink) from None


def _written(made: _Made, folder: Path) -> list[Path]:
    """Write ``design.png`` and ``design.json`` into the folder, and return their paths."""
    from ..design.design_map import design_map
    from ..show.plots.designs import design_figure
    from ..show.plots.figure_layout import png

    design, task = made.design, made.problem.task
    what = f"nearest repeatable inverse of {made.name}, over a {design.region}"
    title = f"{task.robot.name}, {task.frame_words}, {task.kind}: {what}"
    figure = design_figure(design, design_map(design), made.degrees, made.baselines, title=title)
    with written_together(folder) as staged:
        files = [
            write_whole(staged / "design.png", png(figure)),
            rp.save(design, staged / "design.json"),
        ]
    return [folder / file.name for file in files]


def _text(made: _Made) -> str:
    """Format the design's tables and notes as text."""
    from ..show.text.table import table

    design, problem = made.design, made.problem
    lines = [
        f"desired  {made.name}",
        f"start    {row(problem.start)} ({problem.start_is})",
        "",
        design.summary(made.baselines),
    ]
    if len(made.degrees) > 1:
        rows = [[str(d), f"{cost:.5g}", f"{error:.1g}"] for d, cost, error in made.degrees]
        lines += ["", table(["degree", "cost", "± error"], rows)]
    if design.proof is not None:
        lines += ["", design.proof.summary()]
    return fitted("\n".join([*lines, *map(noted, made.notes), ""]))


def _unproved(design: rp.Design) -> list[str]:
    """Make the note that a design is saved unproved: a list of one text, empty if it is proved.

    If the proof stopped early and the potentials have a degree above 2, the note proposes degree 2.
    """
    if design.proof:
        return []
    note = "the design is saved without a certificate: its leaf margin is not proved"
    degree = getattr(design.potentials, "degree", 0)
    reason = "" if design.proof is None else design.proof.reason
    if degree > 2 and reason.startswith("stopped"):
        note += (
            f"; potentials of a lower degree need far fewer boxes than those of degree {degree}: "
            "repeat with --degree 2"
        )
    return [note]


def _check(options: Options, degree: Any) -> None:
    """Raise InputError for options that exclude or require each other, before any work is done.

    ``degree`` is ``auto``, or the number of ``--degree``.
    """
    if options.fourier is not None and degree == "auto":
        raise InputError("--fourier requires --degree D, the degree of the polynomials")
    if options.path is not None and options.workspace is not None:
        raise InputError("--workspace and --path are mutually exclusive")
    if options.plane is not None and options.path is None:
        raise InputError("--plane requires --path")
    if options.leaf and not options.prove:
        raise InputError("--leaf requires --prove")


def _problem(options: Options, degree: Any) -> rp.Problem:
    """Make the problem to design for, from the options.

    With ``--path``, the problem has no region yet; the design later takes a tube around the motion
    as Ω. Without a path, the region Ω is a box of joints around the start, cut at the joint limits.
    ``degree`` is ``auto`` or a number; InputError is raised if this degree requires too many
    polynomials.
    """
    from ..studies.design_choice import check_degree

    region = None if options.path is not None else partial(_region, options)
    problem = options.problem(path=options.path or False, region=region)
    if degree != "auto":
        check_degree(problem.task, degree)
    return problem


def _region(options: Options, task: rp.Task, q0: Any) -> Region:
    """Make the region Ω of a design without a path, from the task and the start q0 (n,).

    Ω is the box of half-width ``--region`` around q0, cut at the joint limits. With
    ``--workspace W``, Ω is restricted to the configurations of this box at which the frame's
    position differs from that at q0 by at most W metres along each base axis that the task
    commands.
    """
    box = box_within_limits(task, q0, options.region)
    if options.workspace is None:
        return box
    axes = [axis for axis in task.rows if axis < 3]
    center = task.placement(q0).translation[axes]
    return rp.WorkspaceBox(task, center, options.workspace, within=box)


def _cut(options: Options, problem: rp.Problem) -> tuple[str, ...]:
    """Make the note on the joints at whose limits the box Ω was cut: a tuple of one text.

    The tuple is empty if Ω was not cut, or is a tube around the motion on a path.
    """
    if options.path is not None:
        return ()
    box = box_within_limits(problem.task, problem.start, options.region)
    return cut_note(problem.task, box, options.region)


def _with_cycle(design: rp.Design, problem: rp.Problem) -> tuple[rp.Design, list[str]]:
    """Add a default cycle to the design: the path of the problem, or else a circle that fits.

    The circle is the largest, of several radii, on which the motion of the design stays inside its
    region Ω. ``repctl follow`` uses the cycle if the user gives no path. Return the design, and
    notes on the cycle, or on why there is none.
    """
    from dataclasses import replace

    from ..studies.around_motion import timed_cycle
    from ..studies.of_design import problem_of

    try:
        closed = problem if problem.path is not None else problem_of(design, start=problem.start)
    except InputError:
        return design, ["no circle from the start stays inside Ω; repctl follow requires --path"]
    cycle, notes = timed_cycle(design, closed)
    saved = f"default cycle saved with the design: {cycle.path.name}, {cycle.period:g} s"
    used = "repctl follow uses it unless --path is given"
    return replace(design, cycle=cycle), [*notes, f"{saved}; {used}"]


def _potentials(task: rp.Task, region: Region, degree: Any, fourier: int | None) -> Any:
    """Make the basis of potentials of ``--fourier``; None without ``--fourier``.

    The basis has polynomials up to ``degree`` in all joints, and sines and cosines of the revolute
    joints up to the order ``fourier``. For None, the design makes the polynomials itself.
    """
    if fourier is None:
        return None
    import numpy as np

    turning = np.flatnonzero(task.revolute)
    try:
        waves = rp.Fourier(task.n, fourier, variables=[int(v) for v in turning])
    except InputError as error:
        error.argument, error.remedy = f"--fourier {fourier}:", "lower it"
        raise
    return rp.Polynomial(region.bounds.center, degree, region.bounds.half_width) + waves


def _as_dict(made: _Made) -> dict[str, Any]:
    """Convert the design and its report to plain Python types, by the keys of ``--json``."""
    from ..studies.study_result import picked, region_dict

    design = made.design
    figures = ("cost", "cost_error", "relative_distance", "leaf_margin")
    fit = ("fit_cost", "gradient_norm", "converged", "steps", "samples", "held_out", "seed")
    return {
        **design.task.as_dict(),
        "desired": made.name,
        "start": [float(v) for v in made.problem.start],
        "start_is": made.problem.start_is,
        **(
            {}
            if design.cycle is None
            else design.cycle.path.as_dict() | {"period": design.cycle.period}
        ),
        "region": region_dict(design.region),
        "shrunk": design.shrunk,
        "potentials": design.potentials.size,
        "dropped": design.dropped,
        **picked(design, *figures, "leaf_margin_at", "inside_limits", *fit),
        "baselines": {
            other.name: {"refused": other.refused}
            if other.evaluation is None
            else picked(other.evaluation, *figures)
            for other in made.baselines
        },
        "degrees": [{"degree": d, "cost": c, "cost_error": e} for d, c, e in made.degrees],
        **({} if design.proof is None else {"proof": asdict(design.proof)}),
        "notes": made.notes,
    }
