"""``repctl design``: the nearest repeatable inverse over a region, and what it is worth."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .executors import executor_of
from .options import (
    REGION,
    asked_path,
    box_round,
    load_robot,
    natural,
    output_folder,
    path_options,
    positive,
    robot_options,
    said_by_options,
    save_control,
    start_of,
    task_options,
    weight_of,
    weight_option,
    whole,
)
from .terminal import clear_line, progress, tell

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..design import Design
    from ..regions import Region
    from ..robot.task import Task
    from ..strategies import Inverse
    from ..studies.start_and_path import Setting

HELP = "find the repeatable inverse nearest to J⁺, or to a weighted inverse, over a region of joint space"
EXAMPLE = """examples:
  repctl design panda --region 0.4 --degree auto
  repctl design panda --task position --weight inertia --shrink --region 1.2
  repctl design xarm7 --path circle:0.1 --region 0.2         # a tube round one cycle of J⁺
  repctl design panda --degree 3 --samples 262144 --processes 2"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this subcommand."""
    robot_options(parser)
    task_options(parser)
    weight_option(parser)
    parser.add_argument(
        "--region", type=positive, default=REGION, metavar="W", help="Ω: half-width round the start, rad (default 0.4)"
    )
    path_options(parser, "Ω: a tube of that half-width round one cycle of J⁺ on a path: ", "")
    parser.add_argument(
        "--workspace",
        type=positive,
        metavar="M",
        help="Ω: only configurations with the frame within M metres of its start, along each axis",
    )
    parser.add_argument("--shrink", action="store_true", help="shrink Ω until it is free of singularities")
    parser.add_argument("--degree", default="auto", metavar="D", help="of the polynomials, or auto (default)")
    parser.add_argument(
        "--fourier", type=whole, metavar="K", help="add sines and cosines of up to K turns of the revolute joints"
    )
    parser.add_argument("--samples", type=whole, help="nodes of the fit (default: by the number of unknowns)")
    parser.add_argument("--held-out", type=whole, default=16384, help="nodes that judge the design (default 16384)")
    parser.add_argument("--restarts", type=natural, default=0, metavar="K", help="more starts of the optimiser")
    parser.add_argument("--stream", action="store_true", help="do not keep the nodes in memory")
    parser.add_argument("--processes", type=whole, default=1, metavar="P", help="number of processes (default 1)")
    parser.add_argument("--dask", metavar="ADDRESS", help="use a Dask cluster: the address of its scheduler")
    parser.add_argument("--seed", type=natural, default=0, help="seed of all nodes (default 0)")
    parser.add_argument(
        "--out", metavar="FOLDER", help="where design.png and design.json go (default repctl-out/ROBOT)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of the table")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors, and what --json asks for")


def run(options: argparse.Namespace) -> int:
    """Design, print the table and write the picture."""
    with output_folder(options, Path(options.robot).stem) as folder:
        return _run(options, folder)


def _run(options: argparse.Namespace, folder: Path) -> int:
    say = progress(options.quiet)
    say("starting up")
    degree = _degree(options)

    from ..design import SingularRegionError, nearest_repeatable
    from ..design.design_map import degree_curve, design_map
    from ..files import prepare_folder
    from ..show.plots.designs import write_design
    from ..studies.defaults import check_degree, choose_desired, choose_task

    robot = load_robot(options)
    task = choose_task(robot, options.frame, options.task)
    if degree != "auto":
        check_degree(task, degree)
    desired, name = choose_desired(task, weight_of(options))

    def report(what: str, share: float) -> None:
        say(f"{what} {share:.0%}" if 0 < share < 1 else what)

    with executor_of(options) as executor:

        def make(region: Region) -> Design:
            fields = _fields(task, region, degree, options.fourier)
            return nearest_repeatable(
                desired,
                fields,
                region,
                degree=degree if fields is None else None,
                samples=options.samples,
                held_out=options.held_out,
                seed=options.seed,
                stream=options.stream,
                executor=executor,
                shrink=options.shrink,
                restarts=options.restarts,
                progress=report,
            )

        try:
            setting, design = _designed(desired, make, options, say)
        except SingularRegionError as error:
            raise said_by_options(error, shrink=True) from None
        degrees = degree_curve(design, report)
    notes = [*setting.moved]
    if design.shrunk < 1:
        notes.append(f"Ω was shrunk to {design.shrunk:.0%} of its width to keep clear of singularities")
    say("finding a cycle inside Ω")
    design, more = _with_cycle(design, setting)
    notes.extend(more)
    say("comparing and drawing")
    title = f"{robot.name}, {task.frame}, {task.kind}: nearest repeatable inverse of {name}, over a {design.region}"
    saved = save_control(design, prepare_folder(folder) / "design.json")
    files = [*write_design(design, design_map(design), degrees, folder, title=title), saved]
    result = _as_dict(design, degrees, name, setting, notes)
    clear_line()
    if options.json:
        print(json.dumps(result | {"files": [str(f) for f in files]}, indent=2, ensure_ascii=False))
    elif not options.quiet:
        start = ", ".join(f"{v:.4g}" for v in setting.q0)
        tell(f"desired  {name}\nstart    {start} ({setting.where})\n\n{design.summary()}")
        if len(degrees) > 1:
            tell(f"\n{_degree_table(degrees)}")
        for note in notes:
            tell(f"note: {note}")
        print("\n" + "\n".join(f"wrote {file}" for file in files))
    return 0


def _degree(options: argparse.Namespace) -> Any:
    """Read ``--degree``."""
    if options.degree == "auto":
        return "auto"
    try:
        return whole(options.degree)
    except argparse.ArgumentTypeError:
        raise InputError(f"--degree {options.degree!r} is neither auto nor a whole number from 1 up") from None


def _designed(
    desired: Inverse, make: Callable[[Region], Design], options: argparse.Namespace, say: Callable[[str], None]
) -> tuple[Setting, Design]:
    """Design in a tube round a path's cycle, a box cut to the joint limits, or a workspace box in it."""
    from ..regions import WorkspaceBox
    from ..studies.defaults import choose_start
    from ..studies.start_and_path import GIVEN, Setting, design_along, first_design, settings

    task, start = desired.task, start_of(options, desired.task)
    if options.path is not None:
        width, seed = options.region, options.seed
        return first_design(
            settings(task, start, asked_path(options)),
            lambda it: design_along(desired, it, make, width=width, seed=seed, say=say),
            given=start is not None,
        )
    if options.plane is not None:
        raise InputError("--plane is of a --path, round which Ω lies; give one")
    q0, where = choose_start(task) if start is None else (start, GIVEN)
    box, notes = box_round(task, q0, options.region)
    region: Region = box
    if options.workspace is not None:
        axes = [row for row in task.rows if row < 3]
        region = WorkspaceBox(task, task.placement(q0).translation[axes], options.workspace, within=box)
    return Setting(q0, where, region=region, moved=tuple(notes)), make(region)


def _with_cycle(design: Design, setting: Setting) -> tuple[Design, list[str]]:
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


def _fields(task: Task, region: Region, degree: Any, fourier: int | None) -> Any:
    """Join Fourier potentials to the polynomials, where asked to; None leaves the polynomials to the degree."""
    if fourier is None:
        return None
    import numpy as np

    from ..fields import Fourier, Polynomial

    turning = np.flatnonzero(task.revolute)
    if degree == "auto":
        raise InputError("--fourier needs --degree D, the degree of the polynomials beside it")
    try:
        waves = Fourier(task.n, fourier, variables=[int(v) for v in turning])
    except InputError as error:
        raise InputError(f"--fourier {fourier}: {str(error).partition(';')[0]}; lower it") from None
    return Polynomial(region.bounds.center, degree, region.bounds.half_width) + waves


def _degree_table(degrees: Any) -> str:
    from ..show.text.table import table

    rows = [[str(d), f"{cost:.5g}", f"{error:.1g}"] for d, cost, error in degrees]
    return table(["degree", "cost", "± error"], rows)


def _as_dict(design: Design, degrees: Any, name: str, setting: Setting, notes: list[str]) -> dict[str, Any]:
    from ..studies.result import region_dict

    task = design.task
    return {
        **task.as_dict(),
        "desired": name,
        "start": [float(v) for v in setting.q0],
        "start_is": setting.where,
        **({} if design.cycle is None else design.cycle.path.as_dict() | {"period": design.cycle.period}),
        "region": region_dict(design.region),
        "shrunk": design.shrunk,
        "potentials": design.fields.size,
        "dropped": list(design.dropped),
        "cost": design.cost,
        "cost_error": design.cost_error,
        "relative_distance": design.relative_distance,
        "leaf_margin": design.leaf_margin,
        "leaf_margin_at": design.leaf_margin_at.tolist(),
        "inside_limits": design.inside_limits,
        "fit_cost": design.fit_cost,
        "gradient_norm": design.gradient_norm,
        "converged": design.converged,
        "steps": design.steps,
        "samples": design.samples,
        "held_out": design.held_out,
        "seed": design.seed,
        "baselines": {
            b.name: {"refused": b.refused}
            if b.judgement is None
            else {
                "cost": b.judgement.cost,
                "cost_error": b.judgement.cost_error,
                "relative_distance": b.judgement.relative_distance,
                "leaf_margin": b.judgement.leaf_margin,
            }
            for b in design.baselines
        },
        "degrees": [{"degree": d, "cost": c, "cost_error": e} for d, c, e in degrees],
        "notes": notes,
    }
