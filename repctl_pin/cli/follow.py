"""``repctl follow``: one closed path with one control, written for a robot."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .options import load_robot, positive, start_of, task_options, whole
from .terminal import clear_line, progress

if TYPE_CHECKING:
    from ..motion import BestLeaf, Motion
    from ..strategies import Strategy

HELP = "follow a closed path with a saved design, or another control, and write the joints' motion"
EXAMPLE = "example: repctl follow design.json --path circle:0.1 --plane yz --csv motion.csv --yaml traj.yaml"

OWN = ("pseudoinverse", "inertia")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this subcommand."""
    parser.add_argument("what", metavar="WHAT", help="a design that was saved (.json), or a robot for --strategy")
    parser.add_argument("--robot", metavar="ROBOT", help="the robot of a design that is not in the catalogue")
    parser.add_argument(
        "--package-dir", action="append", default=[], metavar="DIR", help="where package:// is looked up"
    )
    parser.add_argument(
        "--strategy", metavar="NAME", help=f"in place of a design: {', '.join(OWN)}, or a registered one"
    )
    parser.add_argument(
        "--fields", metavar="NAME", help="in place of a design: design with registered fields, round the start"
    )
    parser.add_argument("--region", type=positive, default=0.4, metavar="W", help="with --fields: Ω (default 0.4)")
    task_options(parser)
    parser.add_argument("--path", default="circle:0.1", metavar="PATH", help="as for study (default circle:0.1)")
    parser.add_argument("--plane", default="xy", metavar="PLANE", help="xy, yz or xz (default xy)")
    parser.add_argument("--cycles", type=whole, default=1, help="how often round (default 1)")
    parser.add_argument("--steps", type=whole, default=500, help="points a cycle (default 500)")
    parser.add_argument("--period", type=positive, default=5.0, help="time of a cycle, s (default 5)")
    parser.add_argument("--best-leaf", action="store_true", help="start where limits and clearance have most room")
    parser.add_argument("--csv", metavar="FILE", help="write time, positions, velocities")
    parser.add_argument("--yaml", metavar="FILE", help="write a ROS JointTrajectory")
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")


def run(options: argparse.Namespace) -> int:
    """Follow the path, judge the motion, and write it."""
    say = progress(options.json)
    say("starting up")
    import numpy as np

    from ..files import write_whole
    from ..motion import best_leaf, follow, reach
    from ..motion.export import commanded, csv_text, yaml_text
    from ..motion.spec import parse_path
    from ..strategies import OnLeaves, RepeatableInverse

    make_path = parse_path(options.path, options.plane)
    strategy, q0 = _strategy(options)
    task = strategy.task
    path = make_path(task, q0)
    if np.linalg.norm(task.error(q0, path.placement(0.0))) > 1e-9:
        q0 = reach(task, q0, path.placement(0.0))
    found: BestLeaf | None = None
    if options.best_leaf:
        if not isinstance(strategy, RepeatableInverse):
            raise InputError("--best-leaf needs a repeatable control, such as a saved design")
        say("looking for the best leaf")
        found = best_leaf(strategy, path, q0)
        q0 = found.q0
    say("following the path")
    lock = 2 if isinstance(strategy, OnLeaves) else 0
    motion = follow(strategy, path, q0, cycles=options.cycles, steps=options.steps, period=options.period, lock=lock)
    timed = (commanded(motion, strategy) if lock else motion).retimed()
    files = [
        write_whole(name, text(timed))
        for name, text in ((options.csv, csv_text), (options.yaml, yaml_text))
        if name is not None
    ]
    clear_line()
    result = _result(timed, motion.t[-1], q0, files)
    if options.json:
        print(json.dumps(result, indent=2, ensure_ascii=False))
        return 0
    if found is not None:
        print(found.summary())
    _print(result, timed)
    return 0


def _strategy(options: argparse.Namespace) -> tuple[Strategy, Any]:
    """Load the design, or make the control that is to be used in its place; and its start."""
    from ..design import Box, load, nearest_repeatable
    from ..plugins import plugin
    from ..strategies import Pseudoinverse, Strategy, WeightedInverse
    from ..studies.defaults import choose_start, choose_task

    saved = Path(options.what).suffix.lower() == ".json"
    if saved and (options.strategy or options.fields):
        raise InputError("--strategy and --fields stand in place of a design; give a robot with them")
    given = start_of(options)
    if saved:
        if options.robot is None and (options.frame or options.task):
            raise InputError("a saved design has its own frame and task; leave --frame and --task out")
        task = None
        if options.robot is not None:
            options.lock, options.base = [], None
            task = choose_task(load_robot(options), options.frame, options.task)
        design = load(options.what, task)
        q0 = design.region.center if given is None else design.task.check(given, "--start")
        return design.inverse, q0
    if not (options.strategy or options.fields):
        raise InputError(f"{options.what!r} is no saved design (.json); for a robot say --strategy, such as {OWN[0]}")
    options.robot, options.lock, options.base = options.what, [], None
    task = choose_task(load_robot(options), options.frame, options.task)
    q0 = choose_start(task)[0] if given is None else task.check(given, "--start")
    if options.fields:
        fields = plugin("fields", options.fields)(task, q0)
        return nearest_repeatable(Pseudoinverse(task), fields, Box(q0, options.region)).inverse, q0
    if options.strategy in OWN:
        return Pseudoinverse(task) if options.strategy == OWN[0] else WeightedInverse(task, "inertia"), q0
    strategy = plugin("strategies", options.strategy, known=OWN)(task)
    if not isinstance(strategy, Strategy):
        raise InputError(f"--strategy {options.strategy} makes {strategy!r}, which has no task or no velocity(q, ẋ)")
    return strategy, q0


def _result(motion: Motion, asked: float, q0: Any, files: list[Path]) -> dict[str, Any]:
    margin = float(motion.limit_margin.min())
    violation = motion.first_violation
    return {
        "robot": motion.task.robot.name,
        "frame": motion.task.frame,
        "task": motion.task.kind,
        "joints": list(motion.task.joint_names),
        "path": motion.path.name,
        "start": [float(v) for v in q0],
        "drift": motion.drift.tolist(),
        "tracking_error": float(motion.tracking_error.max()),
        "limit_margin": margin if margin < float("inf") else None,
        "first_violation": None if violation is None else {"cycle": violation[0], "joint": violation[1]},
        "peak_speed": motion.peak_speed,
        "duration": float(motion.t[-1]),
        "slowed_by": float(motion.t[-1] / asked),
        "files": [str(file) for file in files],
    }


def _print(result: dict[str, Any], motion: Motion) -> None:
    print(f"{result['robot']} {result['frame']}, {result['task']}: {result['path']}")
    print(f"start           {', '.join(f'{v:.4g}' for v in result['start'])}")
    print(f"joint drift     {motion.drift[0]:.2g} after 1 cycle, {motion.drift[-1]:.2g} after {motion.cycles}")
    print(f"tracking error  {result['tracking_error']:.2g} m at most")
    margin = result["limit_margin"]
    print(f"limit margin    {'no limits' if margin is None else f'{margin:.3g}'}")
    if result["first_violation"] is not None:
        joint = result["first_violation"]["joint"]
        print(f"                {joint} LEAVES ITS LIMITS; try --best-leaf or another --start")
    slowed = (
        "" if result["slowed_by"] < 1.0001 else f", slowed down by {result['slowed_by']:.3g} to keep the speed limits"
    )
    print(f"time            {result['duration']:.4g} s{slowed}")
    for file in result["files"]:
        print(f"wrote {file}")
