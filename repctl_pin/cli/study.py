"""``repctl study``: measure an arm's drift on a closed path, and design a repeatable controller.

``say`` is the callback that receives the name of each step. ``Span`` is a piece of text with its
tone, which is shown as colour. ``ReportMaps`` are the maps and curves of a design for a report:
maps over two joints, costs by degree, and costs of two simpler repeatable inverses.
"""

from __future__ import annotations

import json
import webbrowser
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import repctl_pin as rp

from ..base.defaults import CYCLES, DEGREE, PERIOD, STEPS
from ..base.files import write_whole, written_together
from .options import Parser
from .parsed_options import Options, integer, natural, positive, with_options
from .print_result import page_lines, print_result
from .terminal import progress

_PATHS = """paths, lengths in m:
  circle:RADIUS:DEGREES  turned until the arm can follow it; DEGREES: start (0)
  square:SIDE   eight:RADIUS   rose:RADIUS   polygon:CORNERS:RADIUS
  FILE.csv               x,y,z per line in the frame of the base, closed;
                         a header may add qx,qy,qz,qw and time
  PATH:blend=RADIUS      with rounded corners; PATH,PATH,hold: one per frame"""
"""Grammar of --path, which the help of ``repctl study`` shows."""


if TYPE_CHECKING:
    from collections.abc import Callable

    from ..design.design_map import ReportMaps
    from ..show.text.coloured_text import Span

HELP = "measure an arm's drift on a closed path, and design a controller without it"
_DEGREE = "use --frame with fewer joints, --lock some, or --degree with a lower degree"
EXAMPLE = f"""{_PATHS}

example: repctl study panda --path circle:0.1 --plane yz --cycles 20"""


def add_options(parser: Parser) -> None:
    """Add the options of ``repctl study`` to its parser; :func:`run` reads them."""
    parser.robot()
    parser.surroundings()
    parser.task()
    parser.path()
    add = parser.add_argument
    add("--cycles", type=integer, default=CYCLES, help="number of cycles (default %(default)s)")
    add("--steps", type=integer, default=STEPS, help="RK4 steps per cycle (default %(default)s)")
    period = f"time of a cycle, s (default: the path's, else ≥ {PERIOD:g})"
    add("--period", type=positive, help=period)
    region = "half-width of Ω, rad (default: around the cycle)"
    add("--region", type=positive, metavar="W", help=region)
    degree = f"degree of the potentials (default {DEGREE}; many joints: 1)"
    add("--degree", type=integer, help=degree)
    parser.weight()
    best = "start where the path needs least joint speed"
    add("--best-leaf", choices=["speed"], help=best)
    add("--seed", type=natural, default=0, help="random seed of the nodes (default 0)")
    add("--out", metavar="FOLDER", help="output folder (default repctl-out/ROBOT)")
    add("--report", action="store_true", help="also write report.html, with all results")
    add("--open", action="store_true", help="open the animation in the browser")
    full = "print all strategies, quantities and settings"
    add("--full", action="store_true", help=full)
    parser.json("the table", quiet=True)


def run(options: Options) -> int:
    """Run the study, write its figures, animation, motions and design, and print the result.

    A short result is printed; with ``--full``, the table of all strategies; with ``--json``, JSON.
    Either all files are written, or none. Return the exit code 0.
    """
    folder = options.output_folder(Path(options.robot).stem)
    say = progress(options.quiet)
    from ..show.study_files import run_name, write_study
    from ..show.text.answer import study_answer
    from ..show.text.table import study_table

    result = _studied(options, say)
    if options.full or options.json or options.report:
        say("evaluating fastest cycles")
        _ = [row.cycle_time for row in result.rows]  # slow; kept for the table
    say("drawing the figures and the animation")
    with written_together(folder) as staged:
        control = rp.save(result.design, staged / "control.json")
        run = run_name(result, json.loads(control.read_text(encoding="utf-8"))["checksum"])
        files = [*write_study(result, staged, run=run, command=options.command_line), control]
        if options.report:
            from ..design.design_map import report_maps

            say("evaluating the maps of the report")
            maps = report_maps(result.design)
            say("writing the report")
            files.append(_report(result, maps, files[0], staged / "report.html", options, run))
        elif (folder / "report.html").exists():
            note = "report.html is from an earlier study; use --report to write a new one"
            result = replace(result, notes=(note, *result.notes))
    files = [folder / file.name for file in files]

    def text() -> str | list[Span]:
        return (
            f"{study_table(result)}\n" if options.full else study_answer(result, page_lines(files))
        )

    listed = files if options.full or options.json else []  # the answer names them itself
    code = print_result(options, lambda: result.as_dict() | {"run": run}, text, listed)
    if options.open and not webbrowser.open(files[0].resolve().as_uri()):
        say(f"note: no browser was found; open {files[0]} in one")
    return code


def _studied(options: Options, say: Callable[[str], None]) -> rp.Study:
    """Run the study; the remedies of errors name options of the command."""
    from ..studies.problem import at_minimum_speed

    say("loading the robot and finding a start and a path")
    try:
        problem = options.problem(region=options.region)
        if options.best_leaf is not None:
            say("searching for the best leaf")
            problem = at_minimum_speed(problem)
        return rp.study(
            problem,
            **options.of("cycles", "steps", "period", "degree"),
            options=rp.FitOptions(seed=options.seed),
            weight=options.asked_weight(),
            progress=say,
        )
    except rp.InputError as error:
        if error.argument == "degree" and error.remedy:
            error.remedy = _DEGREE
        raise
    except rp.SingularRegionError as error:
        raise error if options.region is None else with_options(error) from None


def _report(
    result: rp.Study, maps: ReportMaps, animation: Path, file: Path, options: Options, run: str
) -> Path:
    """Write ``report.html``, with the value of every option, to ``file``; return its path.

    ``result`` is the study, ``maps`` are the data of the plots of the design over two joints,
    ``animation`` is the file of the animation page, which the report embeds, and ``run`` the
    identifier that all files of one study share.
    """
    from ..show.report import report_page
    from ..show.study_files import with_run

    own = {
        "run",
        "ending",
        "command_line",
        "option_names",
        "json",
        "quiet",
        "report",
        "open",
        "out",
        "full",
    }
    page = report_page(
        result,
        maps=maps,
        options={
            name.replace("_", "-"): value
            for name, value in vars(options).items()
            if name not in own
        },
        command=options.command_line,
        animation=animation.read_text(encoding="utf-8"),
    )
    return write_whole(file, with_run(page, run))
