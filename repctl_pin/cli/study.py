"""``repctl study``: the main job."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from .options import load_robot, output_folder, positive, robot_options, start_of, task_options, whole
from .terminal import clear_line, progress

if TYPE_CHECKING:
    from ..studies import Study

HELP = "show how far an arm creeps on a closed path, and the control that does not"
EXAMPLE = "example: repctl study panda --path circle:0.1 --plane yz --cycles 20"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this subcommand."""
    robot_options(parser)
    task_options(parser)
    parser.add_argument(
        "--path",
        metavar="PATH",
        help="circle:0.1, square:0.2, eight:0.1, rose:0.1, polygon:5:0.1 or points.csv, m",
    )
    parser.add_argument("--plane", metavar="PLANE", help="xy, yz or xz (default: the first that fits)")
    parser.add_argument("--cycles", type=whole, default=10, help="how often round (default 10)")
    parser.add_argument("--steps", type=whole, default=500, help="RK4 steps a cycle (default 500)")
    parser.add_argument("--period", type=positive, default=5.0, help="time of a cycle, s (default 5)")
    parser.add_argument(
        "--region",
        type=positive,
        metavar="W",
        help="Ω: half-width round the start, rad (default: round the cycle)",
    )
    parser.add_argument("--degree", type=whole, default=2, help="degree of the potentials, 1 to 4 (default 2)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the design's nodes (default 0)")
    parser.add_argument("--out", metavar="FOLDER", help="where the files go (default repctl-out/ROBOT)")
    parser.add_argument("--report", action="store_true", help="write report.html too: one page to mail, with all of it")
    parser.add_argument("--json", action="store_true", help="print JSON instead of the table")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def run(options: argparse.Namespace) -> int:
    """Run the study and write its files."""
    folder = output_folder(options)
    say = progress(options.quiet)
    say("starting up")
    from ..files import prepare_folder
    from ..motion.spec import parse_path

    radius, path = None, None
    if options.path is not None:
        kind, _, size = options.path.partition(":")
        path = parse_path(options.path, options.plane or "xy")
        if kind == "circle" and ":" not in size:
            radius, path = float(size), None  # the study finds the direction in which it fits
    start = start_of(options)
    prepare_folder(folder)

    from ..show.study_files import write_study
    from ..show.table import study_table
    from ..studies import study

    result = study(
        load_robot(options),
        frame=options.frame,
        task=options.task,
        start=start,
        path=path,
        radius=radius,
        plane=options.plane,
        cycles=options.cycles,
        steps=options.steps,
        period=options.period,
        region=options.region,
        degree=options.degree,
        seed=options.seed,
        progress=say,
    )
    say("drawing the figures and the animation")
    files = write_study(result, folder)
    if options.report:
        say("writing the report")
        files.append(_report(result, files[0], folder / "report.html", options))
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
    from ..studies.maps import study_maps

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
