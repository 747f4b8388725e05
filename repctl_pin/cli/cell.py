"""``repctl cell``: one function for a whole cell of the workspace, and what it is worth."""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import repctl_pin as rp

from ..errors import InputError, RepctlError, needed
from ..files import prepare_folder, write_whole
from ..show.text.lines import fitted
from .given import (
    Options,
    integer,
    natural,
    numbers_of,
    plain_proof,
    positive,
    proved,
    save_control,
)
from .options import Parser
from .terminal import progress, report

HELP = "find one function for a whole cell: a pose in, the same joints out, everywhere in a box of poses"
EXAMPLE = """examples:
  repctl cell panda --half-width 0.1,0.15,0.1 --half-angle 0.3
  repctl cell panda --half-width 0.15,0.3,0.2 --at 0.46,0,0.3
  repctl cell panda --path circle:0.1 --half-width 0.03
  repctl cell my_arm.urdf --frame tool0 --task position --half-width 0.2 --shrink
  repctl follow repctl-out/panda/cell.json --path circle:0.05 --csv motion.csv"""


_OPTIONS = {
    "incomplete='shrink'": "--shrink",
    "incomplete='keep'": "--keep",
    "posture=": "--start",
    "half_width": "--half-width",
    "held_out": "--held-out",
}
"""What the words of Python's messages are called here."""

_STEPS = 240
"""Steps of a cycle of the tour."""


def add_options(parser: Parser) -> None:
    """Add the options of this subcommand."""
    parser.robot()
    parser.task()
    parser.surroundings()
    add = parser.add_argument
    width = (
        "of the box, m: one number, or x,y,z along the base's axes; with --path, the room around it"
    )
    add("--half-width", required=True, metavar="W", help=width)
    add(
        "--half-angle",
        default="0",
        metavar="A",
        help="rotations of up to A rad about each axis (default 0)",
    )
    add(
        "--at",
        metavar="X,Y,Z",
        help="the middle, m from the base (default: where the start's frame is)",
    )
    parser.path("the box goes round this closed path, or these poses, starting at --start: ", "")
    add("--degree", default="auto", metavar="D", help="degree of the polynomial, or auto (default)")
    add(
        "--limit-margin",
        type=positive,
        default=0.05,
        help="distance kept from limits, rad (default 0.05)",
    )
    add(
        "--body-distance",
        type=float,
        default=0.0,
        help="distance kept between bodies, m (default 0: none)",
    )
    add("--sigma-min", type=float, default=0.0, help="σ_min of J that is kept (default 0: none)")
    add("--shrink", action="store_true", help="shrink the cell until one function covers it")
    add(
        "--keep",
        action="store_true",
        help="keep the function on the part of the cell that it covers",
    )
    add("--held-out", type=integer, default=8192, help="held-out poses (default 8192)")
    add("--seed", type=natural, default=0, help="seed of all nodes (default 0)")
    add("--out", metavar="FOLDER", help="where the files go (default repctl-out/ROBOT)")
    add(
        "--prove",
        action="store_true",
        help="prove bounds of the margins over the whole cell, for at most a minute",
    )
    add("--json", action="store_true", help="print JSON instead of the table")


def run(options: Options) -> int:
    """Find the function, print the table, write cell.json, cell.html and cell.png."""
    try:
        return _run(options)
    except InputError as error:
        raise InputError(
            re.sub("|".join(map(re.escape, _OPTIONS)), lambda m: _OPTIONS[m[0]], str(error))
        ) from None


def _run(options: Options) -> int:
    folder = options.output_folder(Path(options.robot).stem)
    say = progress(options.json)
    needed("matplotlib", "meshcat", by="repctl cell")
    if options.shrink and options.keep:
        raise InputError("--shrink and --keep are two answers to one question; give one")
    if options.keep and options.prove:
        raise InputError(
            "--keep and --prove are mutually exclusive: only a cell that is covered can be proved"
        )
    task = options.load_task()
    if options.prove and task.kind != "pose":
        raise InputError(
            f"--prove requires --task pose: nothing can be proved of a cell of {task.kind} tasks yet"
        )
    cell, posture = _cell(options, task)
    design = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        cell,
        posture=posture,
        degree=options.asked_degree(),
        incomplete="shrink" if options.shrink else "keep" if options.keep else "refuse",
        **options.of("limit_margin", "body_distance", "sigma_min"),
        options=rp.FitOptions(**options.of("held_out", "seed")),
        progress=lambda what, share: say(f"{what} {share:.0%}"),
    )
    design = proved(design, say) if options.prove else design
    say("drawing")
    prepare_folder(folder)
    pictures, note = _pictures(design, folder, options.command_line)
    files = [save_control(design, folder / "cell.json"), *pictures]

    def text() -> str:
        lines = [design.summary()]
        if design.cell.size() != cell.size():
            lines.append(
                f"\nnote: --shrink: no single function covers {cell.size()}; this is for {design.cell.size()}"
            )
        least = "extra joint speed: of the function over J⁺ at the same joints; J⁺ is the least that any control needs"
        lines.append(f"\n{least}\n")
        if design.proof is not None:
            lines.append(f"{design.proof.summary()}\n")
        return fitted("\n".join(lines + [f"note: {note}\n"] * bool(note)))

    return report(options, lambda: _as_dict(design), text, files)


def _cell(options: Options, task: rp.Task) -> tuple[rp.Cell, Any]:
    """Read the cell; and the posture in its middle, where --start gives one."""
    import numpy as np
    import pinocchio as pin

    start, path_of = options.asked_start(task), options.asked_path()
    sizes = (
        _numbers(options.half_width, "--half-width"),
        _numbers(options.half_angle, "--half-angle"),
    )
    if path_of is not None:
        if options.at is not None:
            raise InputError("--path and --at are two answers to one question; give one")
        q0 = task.reference if start is None else start
        cell = rp.Cell.around(task, path_of(task, q0), *sizes)
        return cell, None if start is None else rp.solve_ik(task, start, cell.placement)
    x = task.placement(task.reference if start is None else start)
    if options.at is not None:
        x = pin.SE3(x.rotation, np.array(_numbers(options.at, "--at", 3)))
    cell = rp.Cell(task, x, *sizes)
    return cell, start if start is None or options.at is None else rp.solve_ik(task, start, x)


def _numbers(text: str, option: str, size: int | None = None) -> Any:
    """Read one number, or numbers separated by commas."""
    wrong = f"must be {size or 'one or more'} numbers separated by commas"
    numbers = numbers_of(text, option, wrong)
    if not numbers or size not in (None, len(numbers)):
        raise InputError(f"{option} {text!r} {wrong}")
    return numbers if len(numbers) > 1 else numbers[0]


def _pictures(design: rp.CellDesign, folder: Path, command: str) -> tuple[list[Path], str]:
    """Draw the slices, and the page with a tour through the cell; why there is no tour, where there
    is none."""
    from ..inverse_function.cell_design import slices
    from ..inverse_function.sample_path import tour
    from ..show.cell_page import cell_page
    from ..show.plots.cells import cell_figure
    from ..show.plots.motions import png
    from ..strategies.names import LABELS

    cuts, motions, note = slices(design), {}, ""
    path = tour(design.cell)
    try:
        q0 = design.function(path.placement(0.0))
        motions["q = F(x)"] = rp.follow(
            design.inverse, path, q0, steps=_STEPS, integrator=rp.LeafLock(2)
        )
        motions = {
            LABELS["pseudoinverse"]: rp.follow(design.desired, path, q0, steps=_STEPS)
        } | motions
    except RepctlError as error:
        note = f"on the tour through the cell: {error}"
    picture = png(cell_figure(design, cuts)) if cuts else None
    files = [
        write_whole(folder / "cell.html", cell_page(design, picture, motions, command=command))
    ]
    return files if picture is None else [*files, write_whole(folder / "cell.png", picture)], note


def _as_dict(design: rp.CellDesign) -> dict[str, Any]:
    import numpy as np

    from ..studies.study_result import picked

    figures = asdict(design.evaluation)
    del figures["failures"]  # which come last, in words
    infinite = [
        name
        for name, value in figures.items()
        if isinstance(value, float) and not np.isfinite(value)
    ]
    return {
        **design.task.as_dict(),
        "middle": design.cell.placement.homogeneous,
        **picked(design.cell, "half_width", "rotation"),
        "posture": design.posture,
        **figures | dict.fromkeys(infinite),
        "everywhere": design.evaluation.everywhere,
        "failures": [picked(stop, "cause", "share", "what") for stop in design.failures],
        "degrees": [{"degree": d, "cost": c} for d, c in design.degrees],
        **({} if design.proof is None else {"proof": plain_proof(asdict(design.proof))}),
    }
