"""``repctl design``: the nearest repeatable inverse over a region, and what it is worth."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import repctl_pin as rp

from ..errors import InputError
from ..files import prepare_folder, write_whole
from ..show.text.lines import fitted
from ..show.text.numbers import row
from .executors import executor_of
from .given import (
    REGION,
    Options,
    box_round,
    integer,
    natural,
    plain_proof,
    positive,
    proved,
    said_by_options,
    save_control,
)
from .options import Parser
from .terminal import progress, report

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ..design.evaluation import Baseline
    from ..regions import Region
    from ..strategies import Inverse
    from ..studies.start_and_path import Setting

HELP = "find the repeatable inverse nearest to J⁺, or to a weighted inverse, over a region of joint space"
EXAMPLE = """examples:
  repctl design panda --region 0.4 --degree auto
  repctl design panda --task position --weight inertia --shrink --region 1.2
  repctl design xarm7 --path circle:0.1 --region 0.2         # a tube round the motion
  repctl design panda --degree 3 --samples 262144 --processes 2"""


def add_options(parser: Parser) -> None:
    """Add the options of this subcommand."""
    parser.robot()
    parser.task()
    parser.weight()
    add = parser.add_argument
    add(
        "--region",
        type=positive,
        default=REGION,
        metavar="W",
        help="Ω: half-width round the start, rad (default 0.4)",
    )
    parser.path("Ω: a tube of that half-width round the motion on a path: ", "")
    workspace = (
        "Ω: only configurations with the frame within M metres of its start, along each axis"
    )
    add("--workspace", type=positive, metavar="M", help=workspace)
    add("--shrink", action="store_true", help="shrink Ω until it is free of singularities")
    add("--degree", default="auto", metavar="D", help="of the polynomials, or auto (default)")
    fourier = "add sines and cosines of up to K turns of the revolute joints"
    add("--fourier", type=integer, metavar="K", help=fourier)
    add("--samples", type=integer, help="nodes of the fit (default: by the number of unknowns)")
    add(
        "--held-out",
        type=integer,
        default=16384,
        help="nodes that judge the design (default 16384)",
    )
    add("--restarts", type=natural, default=0, metavar="K", help="more starts of the optimiser")
    add("--stream", action="store_true", help="do not keep the nodes in memory")
    add("--processes", type=integer, default=1, metavar="P", help="number of processes (default 1)")
    add("--dask", metavar="ADDRESS", help="use a Dask cluster: the address of its scheduler")
    add("--seed", type=natural, default=0, help="seed of all nodes (default 0)")
    add(
        "--prove",
        action="store_true",
        help="prove a lower bound of the leaf margin over Ω, for at most a minute",
    )
    add(
        "--out",
        metavar="FOLDER",
        help="where design.png and design.json go (default repctl-out/ROBOT)",
    )
    add("--json", action="store_true", help="print JSON instead of the table")
    add("--quiet", action="store_true", help="print nothing but errors, and what --json asks for")


def run(options: Options) -> int:
    """Design, print the table and write the picture."""
    folder = options.output_folder(Path(options.robot).stem)
    say = progress(options.quiet)
    degree = options.asked_degree()
    if options.fourier is not None and degree == "auto":
        raise InputError("--fourier needs --degree D, the degree of the polynomials beside it")
    if options.path is not None and options.workspace is not None:
        raise InputError(
            "--workspace cuts a box round the start, and Ω round a --path is a tube; leave one out"
        )
    if options.plane is not None and options.path is None:
        raise InputError("--plane is of a --path, round which Ω lies; give one")

    from ..design.design_map import degree_curve, design_map
    from ..show.plots.designs import design_figure
    from ..show.plots.motions import png
    from ..show.text.table import table
    from ..studies.defaults import check_degree, choose_desired
    from ..studies.start_and_path import shrunk_note

    task = options.load_task()
    if degree != "auto":
        check_degree(task, degree)
    desired, name = choose_desired(task, options.asked_weight())

    def share_done(what: str, share: float) -> None:
        say(f"{what} {share:.0%}" if 0 < share < 1 else what)

    with executor_of(options) as executor:

        def make(region: Region) -> rp.Design:
            potentials = _fields(task, region, degree, options.fourier)
            return rp.nearest_repeatable(
                desired,
                potentials,
                region,
                degree=degree if potentials is None else None,
                shrink=options.shrink,
                options=rp.FitOptions(
                    executor=executor,
                    **options.of("samples", "held_out", "seed", "stream", "restarts"),
                ),
                progress=share_done,
            )

        try:
            setting, design = _designed(desired, make, options, say)
        except rp.SingularRegionError as error:
            raise said_by_options(error, shrink=not options.shrink) from None
        degrees = degree_curve(design, share_done)
    baselines = design.evaluate_baselines(progress=share_done)
    notes = [*setting.moved, *shrunk_note(design)]
    say("finding a cycle inside Ω")
    design, more = _with_cycle(design, setting)
    notes.extend(more)
    design = proved(design, say) if options.prove else design
    say("comparing and drawing")
    what = f"nearest repeatable inverse of {name}, over a {design.region}"
    title = f"{task.robot.name}, {task.frame}, {task.kind}: {what}"
    saved = save_control(design, prepare_folder(folder) / "design.json")
    figure = design_figure(design, design_map(design), degrees, baselines, title=title)
    files = [write_whole(folder / "design.png", png(figure)), saved]

    def text() -> str:
        lines = [
            f"desired  {name}",
            f"start    {row(setting.q0)} ({setting.where})",
            "",
            design.summary(baselines),
        ]
        if len(degrees) > 1:
            rows = [[str(d), f"{cost:.5g}", f"{error:.1g}"] for d, cost, error in degrees]
            lines += ["", table(["degree", "cost", "± error"], rows)]
        if design.proof is not None:
            lines += ["", design.proof.summary()]
        return fitted("\n".join([*lines, *(f"note: {note}" for note in notes), ""]))

    return report(
        options, lambda: _as_dict(design, degrees, baselines, name, setting, notes), text, files
    )


def _designed(
    desired: Inverse,
    make: Callable[[Region], rp.Design],
    options: Options,
    say: Callable[[str], None],
) -> tuple[Setting, rp.Design]:
    """Design in a tube round a path's cycle, a box cut to the joint limits, or a workspace box in
    it."""
    from ..studies.defaults import choose_start
    from ..studies.start_and_path import GIVEN, Setting, design_from

    task, start = desired.task, options.asked_start(desired.task)
    if options.path is not None:
        path = options.asked_path()
        return design_from(
            desired, start, path, make, width=options.region, seed=options.seed, say=say
        )
    q0, where = choose_start(task) if start is None else (start, GIVEN)
    box, notes = box_round(task, q0, options.region)
    region: Region = box
    if options.workspace is not None:
        axes = [row for row in task.rows if row < 3]
        region = rp.WorkspaceBox(
            task, task.placement(q0).translation[axes], options.workspace, within=box
        )
    return Setting(q0, where, region=region, moved=notes), make(region)


def _with_cycle(design: rp.Design, setting: Setting) -> tuple[rp.Design, list[str]]:
    """Say which cycle the design is for: on the path asked for, or the largest circle inside Ω."""
    from ..studies.start_and_path import setting_of, with_cycle

    try:
        found = setting if setting.path is not None else setting_of(design, setting.q0)
    except InputError:
        return design, ["no circle from the start stays inside Ω; repctl follow needs a --path"]
    design, notes = with_cycle(design, found)
    assert design.cycle is not None
    return design, [
        *notes,
        f"for {found.drawn.name}, {design.cycle.period:g} s per cycle; repctl follow uses it unless --path is given",
    ]


def _fields(task: rp.Task, region: Region, degree: Any, fourier: int | None) -> Any:
    """Join Fourier basis to the polynomials, where asked to; None leaves the polynomials to the
    degree."""
    if fourier is None:
        return None
    import numpy as np

    turning = np.flatnonzero(task.revolute)
    try:
        waves = rp.Fourier(task.n, fourier, variables=[int(v) for v in turning])
    except InputError as error:
        raise InputError(f"--fourier {fourier}: {str(error).partition(';')[0]}; lower it") from None
    return rp.Polynomial(region.bounds.center, degree, region.bounds.half_width) + waves


def _as_dict(
    design: rp.Design,
    degrees: Any,
    baselines: Sequence[Baseline],
    name: str,
    setting: Setting,
    notes: list[str],
) -> dict[str, Any]:
    from ..studies.study_result import picked, region_dict

    figures = ("cost", "cost_error", "relative_distance", "leaf_margin")
    fit = ("fit_cost", "gradient_norm", "converged", "steps", "samples", "held_out", "seed")
    return {
        **design.task.as_dict(),
        "desired": name,
        "start": [float(v) for v in setting.q0],
        "start_is": setting.where,
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
            for other in baselines
        },
        "degrees": [{"degree": d, "cost": c, "cost_error": e} for d, c, e in degrees],
        **({} if design.proof is None else {"proof": plain_proof(asdict(design.proof))}),
        "notes": notes,
    }
