"""``repctl animate``: write motions to an animation page.

The motions come from a CSV file, from a saved design, or from a study made here. A playback is one
motion as the page shows it, with its label and colour. J⁺ is the pseudoinverse, the usual
controller. ``say`` is the callback that receives the name of each step.

``Playback`` is one motion of a whole robot, as the page plays it: label, configurations, times.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import repctl_pin as rp

from ..base.defaults import CYCLES, DEGREE
from ..base.errors import InputError
from ..base.files import write_whole, written_together
from .options import Parser
from .parsed_options import Options, integer, positive
from .print_result import print_result
from .terminal import progress

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ..show.page.playback import Playback

HELP = (
    "show motions in the browser: from a CSV, from a saved design, or J⁺ beside the nearest "
    "repeatable inverse"
)
EXAMPLE = """examples:
  repctl animate panda --motion motion.csv --only pseudoinverse,repeatable
  repctl animate panda --path circle:0.1"""

_Shown = tuple[str, "rp.Task", int, "dict[str, Any]"]
"""Page, task, number of cycles, and the drift by controller."""


def add_options(parser: Parser) -> None:
    """Add the options of ``repctl animate`` to its parser; :func:`run` reads them."""
    parser.what()
    parser.surroundings()
    add = parser.add_argument
    add("--motion", metavar="FILE", help="CSV of joint positions, as study and follow write it")
    add(
        "--only",
        metavar="NAMES",
        help="strategies of the CSV to show, separated by commas (default: all)",
    )
    parser.task()
    parser.path()
    add("--cycles", type=integer, help=f"number of cycles (default {CYCLES}, or that of the CSV)")
    add("--steps", type=integer, default=200, help="steps per cycle (default 200)")
    add(
        "--degree",
        type=integer,
        default=DEGREE,
        help="degree of the potentials (default %(default)s)",
    )
    add("--seconds", type=positive, help="time of one cycle, s (default: real time)")
    add("--out", metavar="FOLDER", help="folder of animation.html (default repctl-out/ROBOT)")
    parser.json()


def run(options: Options) -> int:
    """Write the page ``animation.html`` with the requested motions; return the exit code 0."""
    _check(options)
    say = progress(options.json)
    if options.saved:
        design = options.load_design()
        name = design.task.robot.name
        folder = options.output_folder(name if options.robot is None else Path(options.robot).stem)
        page, task, cycles, drift = _from_design(design, options, say)
    else:
        folder = options.output_folder(Path(options.what).stem)
        source = _from_study if options.motion is None else _from_csv
        page, task, cycles, drift = source(options, say)
    with written_together(folder) as staged:
        file = folder / write_whole(staged / "animation.html", page).name
    result = {"robot": task.robot.name, "frame": task.frame, "cycles": cycles, "drift": drift}
    return print_result(options, lambda: result, files=[file])


def _drawn(
    task: rp.Task,
    tracks: Sequence[Playback],
    options: Options,
    say: Callable[[str], None],
    **more: Any,
) -> _Shown:
    """Draw the motions ``tracks`` of one robot on a page.

    ``more`` are options of ``playback_page``: ``name`` is the display name of the path, and
    ``paths`` are the paths to draw. ``own``, from :func:`own_loop`, are data with which the page
    can follow a path that the user draws there; with None, the user cannot draw one. Return the
    HTML of the page, the task, the number of cycles, and the drift after each cycle (cycles,), rad
    or m, by controller.
    """
    from ..show.page.playback import playback_page, traced_chains
    from ..studies.quantities import KEYS

    say("drawing")
    chains = traced_chains(task, task.from_robot(tracks[0].Q[0]))
    page = playback_page(chains, tracks, seconds=options.seconds, **more)
    drift = {KEYS.get(track.label, track.label): track.drift for track in tracks}
    return page, task, tracks[0].cycles, drift


def _check(options: Options) -> None:
    """Raise InputError for options that exclude or require each other, before any work is done.

    ``--motion`` requires a robot instead of a saved design, and ``--only`` requires ``--motion``.
    """
    if options.motion is not None and options.saved:
        raise InputError("--motion requires a robot, not a saved design")
    if options.motion is None and options.only is not None:
        raise InputError("--only requires --motion")


def _from_csv(options: Options, say: Callable[[str], None]) -> _Shown:
    """Read the motions of the CSV file ``--motion``, and draw them on a page.

    The motions are those that ``--only`` names, or all. Return the HTML of the page, the task, the
    number of cycles, and the drift after each cycle (cycles,), rad or m, by controller.
    """
    from ..show.page.playback import read_playbacks

    robot = options.load_robot()
    say("reading the motion")
    tracks = read_playbacks(options.motion, robot, cycles=options.cycles)
    if options.only is not None:
        tracks = _only(options.only, tracks, options.motion)
    task = options.asked_task(robot)
    return _drawn(task, tracks, options, say, name=Path(options.motion).name)


def _only(names: str, tracks: list[Playback], file: str) -> list[Playback]:
    """Select those motions of a CSV file that ``--only`` names, in the order of the names.

    ``names`` are keys (``repeatable``) or labels (``J⁺``), separated by commas; ``tracks`` are all
    motions of the file, and ``file`` its name. An unknown name raises InputError.
    """
    from ..studies.quantities import KEYS

    there = {KEYS.get(track.label, track.label): track for track in tracks}
    labelled = {track.label: track for track in tracks} | there
    chosen = []
    for name in [names] if names in labelled else names.split(","):  # a label may hold a comma
        if name.strip() not in labelled:
            raise InputError(
                f"--only: {file} has no motion of the strategy {name.strip()!r}; "
                f"choose from {', '.join(there)}"
            )
        chosen.append(labelled[name.strip()])
    return chosen


def _names(design: rp.Design) -> tuple[str, str]:
    """Return the labels of a design's two controllers, as the page shows them.

    The first label is that of the desired inverse, which the design approximates: ``J⁺``, or
    ``desired`` for another inverse. The second is that of the repeatable inverse.
    """
    from ..studies.quantities import LABELS

    plain = type(design.desired) is rp.Pseudoinverse
    return LABELS["pseudoinverse"] if plain else "desired", LABELS["repeatable"]


def _from_design(design: rp.Design, options: Options, say: Callable[[str], None]) -> _Shown:
    """Follow the path with a saved design and with its desired inverse, and show both motions.

    The design approximates the desired inverse, usually J⁺, so the page shows what repeatability
    changes. Return the HTML of the page, the task, the number of cycles, and the drift after each
    cycle (cycles,), rad or m, by controller.
    """
    from ..paths.several_paths import paths_of
    from ..show.page.own_loop import own_loop
    from ..show.page.playback import playback_of
    from ..show.palette import COLOURS

    say("finding a path")
    problem = options.problem_of(design)
    q0, path = problem.start, problem.cycle
    cycles = options.cycles or CYCLES
    say(f"following the path for {cycles} cycles")
    laws = (design.desired, design.inverse)
    motions = [rp.follow(law, path, q0, cycles=cycles, steps=options.steps) for law in laws]
    keys = ("pseudoinverse", "repeatable")
    tracks = [
        playback_of(label, motion, COLOURS[key])
        for label, key, motion in zip(_names(design), keys, motions, strict=True)
    ]
    points = [own.points() for own in paths_of(path)]
    own = own_loop(motions[0], laws)
    return _drawn(design.task, tracks, options, say, name=path.name, paths=points, own=own)


def _from_study(options: Options, say: Callable[[str], None]) -> _Shown:
    """Run a study, and show its motions under J⁺ and the nearest repeatable inverse.

    This is the default of the command for a robot without ``--motion``. Return the HTML of the
    page, the task, the number of cycles, and the drift after each cycle (cycles,), rad or m, by
    controller.
    """
    from ..show.study_files import study_page

    cycles = options.cycles or CYCLES
    more = options.of("steps", "degree")
    found = rp.study(options.problem(), **more, cycles=cycles, progress=say)
    say("drawing")
    page = study_page(found, seconds=options.seconds)
    rows = (found.row("pseudoinverse"), found.row("repeatable"))
    drift = {row.key: row.motion.drift for row in rows if row.motion is not None}
    return page, found.task, cycles, drift
