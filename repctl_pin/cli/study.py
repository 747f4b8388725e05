"""``repctl study``: the main job."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from .options import (
    asked_path,
    load_robot,
    natural,
    output_folder,
    path_options,
    positive,
    robot_options,
    said_by_options,
    save_control,
    start_of,
    surroundings_option,
    task_options,
    weight_of,
    weight_option,
    whole,
)
from .terminal import clear_line, progress

if TYPE_CHECKING:
    from ..studies import Study

HELP = "show how far an arm drifts on a closed path, and the control that does not"
EXAMPLE = "example: repctl study panda --path circle:0.1 --plane yz --cycles 20"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this subcommand."""
    robot_options(parser)
    surroundings_option(parser)
    task_options(parser)
    path_options(parser)
    parser.add_argument("--cycles", type=whole, default=10, help="number of cycles (default 10)")
    parser.add_argument("--steps", type=whole, default=500, help="RK4 steps a cycle (default 500)")
    parser.add_argument(
        "--period",
        type=positive,
        help="time of a cycle, s (default: the path's own, else 5, or longer to keep the speed limits)",
    )
    parser.add_argument(
        "--region",
        type=positive,
        metavar="W",
        help="Ω: half-width round the start, rad (default: round the cycle)",
    )
    parser.add_argument(
        "--degree",
        type=whole,
        default=2,
        help="degree of the potentials (default 2); 3 or 4 may come nearer to J⁺, and the work grows fast",
    )
    weight_option(parser)
    parser.add_argument("--seed", type=natural, default=0, help="seed of the design's nodes (default 0)")
    parser.add_argument("--out", metavar="FOLDER", help="where the files go (default repctl-out/ROBOT)")
    parser.add_argument("--report", action="store_true", help="also write report.html: one page with all of it")
    parser.add_argument("--json", action="store_true", help="print JSON instead of the table")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors, and what --json asks for")


def run(options: argparse.Namespace) -> int:
    """Run the study and write its files."""
    with output_folder(options, Path(options.robot).stem) as folder:
        return _run(options, folder)


def _run(options: argparse.Namespace, folder: Path) -> int:
    say = progress(options.quiet)
    say("starting up")
    start = start_of(options)
    from ..design import SingularRegionError
    from ..files import prepare_folder
    from ..show.study_files import write_study
    from ..show.text.table import study_table
    from ..studies import study

    try:
        result = study(
            load_robot(options),
            frame=options.frame,
            task=options.task,
            start=start,
            path=asked_path(options),
            cycles=options.cycles,
            steps=options.steps,
            period=options.period,
            region=options.region,
            degree=options.degree,
            weight=weight_of(options),
            seed=options.seed,
            progress=say,
        )
    except SingularRegionError as error:
        raise error if options.region is None else said_by_options(error) from None
    say("drawing the figures and the animation")
    prepare_folder(folder)
    control = save_control(result.design, folder / "control.json")
    files = [*write_study(result, folder), control]
    if options.report:
        say("writing the report")
        files.append(_report(result, files[0], folder / "report.html", options))
    elif (folder / "report.html").exists():
        result = replace(
            result, notes=(*result.notes, "the report.html there is from an earlier study; --report writes a new one")
        )
    clear_line()
    if options.json:
        print(json.dumps(result.as_dict() | {"files": [str(f) for f in files]}, indent=2, ensure_ascii=False))
    elif not options.quiet:
        print(study_table(result))
        print()
        for file in files:
            print(f"wrote {file}")
    return 0


def _report(result: Study, animation: Path, file: Path, options: argparse.Namespace) -> Path:
    """Write the report, with every option as it was used."""
    from ..show.report import write_report
    from ..studies.study_maps import study_maps

    own = {"run", "command_line", "json", "quiet", "report", "out"}
    used = {name.replace("_", "-"): value for name, value in vars(options).items() if name not in own}
    return write_report(
        result,
        file,
        maps=study_maps(result),
        options=used,
        command=options.command_line,
        animation=animation.read_text(encoding="utf-8"),
    )
