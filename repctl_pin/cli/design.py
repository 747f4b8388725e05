"""``repctl design``: the nearest repeatable inverse over a region, and what it is worth."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .check import strategy_of
from .executors import executor_of
from .options import (
    load_robot,
    natural,
    output_folder,
    path_options,
    positive,
    robot_options,
    said_by_options,
    task_options,
    whole,
)
from .place import Place, choose_place
from .terminal import clear_line, progress

if TYPE_CHECKING:
    from ..design import Design
    from ..regions import Region
    from ..robot.task import Task
    from ..strategies import Inverse

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
    parser.add_argument(
        "--weight",
        metavar="M",
        help="what to be near to: inertia, limits, or one number a joint separated by commas (default: 1, J⁺)",
    )
    parser.add_argument(
        "--region", type=positive, default=0.4, metavar="W", help="Ω: half-width round the start, rad (default 0.4)"
    )
    path_options(parser, "Ω: a tube of that half-width round one cycle of J⁺ on a path: ", "")
    parser.add_argument(
        "--workspace",
        type=positive,
        metavar="M",
        help="Ω: only what brings the frame within M metres (each way) of where it starts",
    )
    parser.add_argument("--shrink", action="store_true", help="shrink Ω until it is free of singularities")
    parser.add_argument("--degree", default="auto", metavar="D", help="of the polynomials, or auto (default)")
    parser.add_argument(
        "--fourier", type=whole, metavar="K", help="add sines and cosines of up to K turns of the revolute joints"
    )
    parser.add_argument("--samples", type=whole, help="nodes of the fit (default: as many as the unknowns ask for)")
    parser.add_argument("--held-out", type=whole, default=16384, help="nodes of the judgement (default 16384)")
    parser.add_argument("--restarts", type=natural, default=0, metavar="K", help="further starts of the optimiser")
    parser.add_argument("--stream", action="store_true", help="do not keep the nodes in memory")
    parser.add_argument("--processes", type=whole, default=1, metavar="P", help="spread the work (default 1)")
    parser.add_argument("--dask", metavar="ADDRESS", help="spread it over a Dask cluster, by its scheduler's address")
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

    from ..design import SingularRegionError, nearest_repeatable, save
    from ..design.design_map import degree_curve, design_map
    from ..show.plots.designs import write_design
    from ..studies.defaults import check_degree, choose_task

    robot = load_robot(options)
    task = choose_task(robot, options.frame, options.task)
    if degree != "auto":
        check_degree(task, degree)
    desired, name = _desired(task, options.weight)
    place = choose_place(task, options)
    fields = _fields(task, place.region, degree, options.fourier)

    def report(what: str, share: float) -> None:
        say(f"{what} {share:.0%}" if 0 < share < 1 else what)

    with executor_of(options) as executor:
        try:
            design = nearest_repeatable(
                desired,
                fields,
                place.region,
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
        except SingularRegionError as error:
            raise said_by_options(error, shrink=True) from None
        degrees = degree_curve(design, report)
    notes = [*place.notes]
    if design.shrunk < 1:
        notes.append(f"Ω was shrunk to {design.shrunk:.0%} of its width to keep clear of singularities")
    say("comparing and drawing")
    title = f"{robot.name}, {task.frame}, {task.kind}: nearest repeatable inverse of {name}, over a {design.region}"
    files = write_design(design, design_map(design), degrees, folder, title=title)
    try:
        files.append(save(design, folder / "design.json"))
    except InputError as error:
        notes.append(f"design.json was not written: {error}")
    result = _as_dict(design, degrees, name, place, notes)
    text = design.summary()
    clear_line()
    if options.json:
        print(json.dumps(result | {"files": [str(f) for f in files]}, indent=2, ensure_ascii=False))
    elif not options.quiet:
        print(f"desired  {name}\nstart    {', '.join(f'{v:.4g}' for v in place.q0)} ({place.where})\n")
        print(text)
        if len(degrees) > 1:
            print(f"\n{_degree_table(degrees)}")
        for note in notes:
            print(f"note: {note}")
        print()
        for file in files:
            print(f"wrote {file}")
    return 0


def _degree(options: argparse.Namespace) -> Any:
    """Read ``--degree``."""
    if options.degree == "auto":
        return "auto"
    try:
        return whole(options.degree)
    except argparse.ArgumentTypeError:
        raise InputError(f"--degree {options.degree!r} is neither auto nor a whole number from 1 up") from None


def _desired(task: Task, weight: str | None) -> tuple[Inverse, str]:
    """Make the inverse that ``--weight`` names."""
    if weight != "limits":
        return strategy_of(task, weight)
    from ..strategies import LimitWeight, WeightedInverse

    return WeightedInverse(task, LimitWeight(task)), "J⁺ weighted by the nearness of joint limits"


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


def _as_dict(design: Design, degrees: Any, name: str, place: Place, notes: list[str]) -> dict[str, Any]:
    from ..studies.result import region_dict

    task = design.task
    return {
        **task.as_dict(),
        "desired": name,
        "start": [float(v) for v in place.q0],
        "start_is": place.where,
        **({} if place.path is None else place.path.as_dict()),
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
