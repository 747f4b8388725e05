"""``repctl animate``: one page that shows motions, written to a file or opened live."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .options import load_robot, positive, start_of, task_options, whole
from .terminal import clear_line, progress

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..robot.robot import Robot
    from ..robot.task import Task
    from ..show.tracks import Track

HELP = "show motions in the browser: from a CSV, from a saved design, or J⁺ beside the nearest repeatable"
EXAMPLE = "example: repctl animate panda --motion repctl-out/panda/motion.csv --only pseudoinverse,repeatable --live"

_Shown = tuple["Task", "list[Track]", "dict[str, Any]"]


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this subcommand."""
    parser.add_argument("what", metavar="WHAT", help="a robot (catalogue name or URDF), or a saved design (.json)")
    parser.add_argument("--robot", metavar="ROBOT", help="the robot of a design that is not in the catalogue")
    parser.add_argument(
        "--package-dir", action="append", default=[], metavar="DIR", help="where package:// is looked up"
    )
    parser.add_argument(
        "--lock", action="append", default=[], metavar="JOINT", help="hold a joint at the reference pose"
    )
    parser.add_argument("--base", metavar="LINK", help="link to hold still; x is measured in its frame")
    parser.add_argument("--motion", metavar="FILE", help="a CSV of joint positions, as study and follow write it")
    parser.add_argument("--only", metavar="NAMES", help="of the CSV's strategies, these, separated by commas")
    task_options(parser)
    parser.add_argument("--path", metavar="PATH", help="as for study (default: a circle that fits)")
    parser.add_argument("--plane", metavar="PLANE", help="xy, yz or xz (default: the first that fits)")
    parser.add_argument("--cycles", type=whole, help="how often round (default 10, or what the CSV says)")
    parser.add_argument("--steps", type=whole, default=200, help="steps a cycle (default 200)")
    parser.add_argument("--degree", type=whole, default=2, help="degree of the potentials (default 2)")
    parser.add_argument("--seconds", type=positive, default=4.0, help="time of a cycle on the screen, s (default 4)")
    parser.add_argument("--out", metavar="FOLDER", help="where animation.html goes (default repctl-out/ROBOT)")
    parser.add_argument("--live", action="store_true", help="open it in the browser, served to this machine only")
    parser.add_argument("--port", type=int, default=0, help="with --live: where to listen (default: a free port)")
    parser.add_argument("--no-browser", action="store_true", help="with --live: only print the address")
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")


def run(options: argparse.Namespace) -> int:
    """Make the page; write it, or serve it until Ctrl-C."""
    say = progress(options.json)
    say("starting up")
    saved = Path(options.what).suffix.lower() == ".json"
    if options.motion is not None and saved:
        raise InputError("--motion is shown on a robot; give its name or URDF, not a design")
    if options.motion is None and options.only is not None:
        raise InputError("--only chooses among the strategies of a --motion file")
    make = _from_csv if options.motion is not None else _from_design if saved else _from_study
    task, tracks, more = make(options, say)

    from ..files import prepare_folder, write_whole
    from ..motion import elbow
    from ..show.tracks import Limb, tracks_page

    say("drawing")
    limb = Limb(task, elbow(task, task.part(tracks[0].Q[0])))
    page = tracks_page([limb], tracks, seconds=options.seconds, **more)
    result: dict[str, Any] = {
        "robot": task.robot.name,
        "frame": task.frame,
        "cycles": tracks[0].cycles,
        "drift": {track.label: track.drift.tolist() for track in tracks},
    }
    files = []
    if options.out is not None or not options.live:
        stem = Path(options.what).stem if not saved else task.robot.name
        folder = prepare_folder(Path(options.out or Path("repctl-out") / stem))
        files = [str(write_whole(folder / "animation.html", page))]
    clear_line()
    if options.live:
        return _serve(page, result | {"files": files}, options)
    print(json.dumps(result | {"files": files}, indent=2, ensure_ascii=False) if options.json else f"wrote {files[0]}")
    return 0


def _serve(page: str, result: dict[str, Any], options: argparse.Namespace) -> int:
    """Show the page until Ctrl-C or SIGTERM."""
    from ..show.live import LivePage

    with LivePage(page, port=options.port) as live:
        if options.json:
            print(json.dumps(result | {"url": live.url}, ensure_ascii=False), flush=True)
        else:
            for file in result["files"]:
                print(f"wrote {file}")
            print(f"showing at {live.url} until Ctrl-C", flush=True)
        if not options.no_browser:
            live.open()
        live.wait()
    return 0


def _from_csv(options: argparse.Namespace, say: Callable[[str], None]) -> _Shown:
    """Motions as a file holds them."""
    from ..show.tracks import LABELS, read_tracks
    from ..studies.defaults import choose_task

    robot = _robot(options)
    say("reading the motion")
    tracks = read_tracks(options.motion, robot, cycles=options.cycles)
    if options.only is not None:
        wanted = [LABELS.get(name.strip(), name.strip()) for name in options.only.split(",")]
        there = {track.label: track for track in tracks}
        missing = next((name for name in wanted if name not in there), None)
        if missing is not None:
            raise InputError(f"--only: {options.motion} has no strategy {missing!r}; it has {', '.join(there)}")
        tracks = [there[name] for name in wanted]
    return choose_task(robot, options.frame, options.task), tracks, {"name": Path(options.motion).name}


def _from_design(options: argparse.Namespace, say: Callable[[str], None]) -> _Shown:
    """A saved design, beside the inverse that it is the nearest to."""
    import numpy as np

    from ..design import load
    from ..motion import follow, reach
    from ..motion.spec import parse_path
    from ..show.figures import COLOURS
    from ..show.tracks import track_of
    from ..strategies import Pseudoinverse
    from ..studies.defaults import choose_path, choose_task

    task = None
    if options.robot is not None:
        task = choose_task(load_robot(options), options.frame, options.task)
    design = load(options.what, task)
    task, given = design.task, start_of(options)
    q0 = design.region.center if given is None else task.check(given, "--start")
    say("finding a path")
    if options.path is None:
        path = choose_path(task, q0, plane=options.plane)
    else:
        path = parse_path(options.path, options.plane or "xy")(task, q0)
    if np.linalg.norm(task.error(q0, path.placement(0.0))) > 1e-9:
        q0 = reach(task, q0, path.placement(0.0))
    cycles = options.cycles or 10
    say(f"following the path for {cycles} cycles")
    tracks = [
        track_of(label, follow(strategy, path, q0, cycles=cycles, steps=options.steps), COLOURS[key])
        for label, key, strategy in (
            ("J⁺" if type(design.desired) is Pseudoinverse else "desired", "pseudoinverse", design.desired),
            ("nearest repeatable", "repeatable", design.inverse),
        )
    ]
    return task, tracks, {"name": path.name, "paths": [path.points()]}


def _from_study(options: argparse.Namespace, say: Callable[[str], None]) -> _Shown:
    """J⁺ and the nearest repeatable inverse, as a study finds them."""
    from ..motion.spec import parse_path
    from ..show.figures import COLOURS
    from ..show.tracks import track_of
    from ..studies import study

    found = study(
        _robot(options),
        frame=options.frame,
        task=options.task,
        start=start_of(options),
        path=None if options.path is None else parse_path(options.path, options.plane or "xy"),
        plane=options.plane,
        cycles=options.cycles or 10,
        steps=options.steps,
        degree=options.degree,
        progress=say,
    )
    rows = (found.row("pseudoinverse"), found.row("repeatable"))
    tracks = [track_of(row.label, row.motion, COLOURS[row.key]) for row in rows if row.motion is not None]
    return found.task, tracks, {"name": found.path.name, "paths": [found.path.points()]}


def _robot(options: argparse.Namespace) -> Robot:
    """The robot that WHAT names."""
    if options.robot is not None:
        raise InputError("--robot goes with a saved design; the robot to show is WHAT")
    options.robot = options.what
    return load_robot(options)
