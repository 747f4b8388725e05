"""``repctl follow``: one closed path with one control, written for a robot."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .options import (
    is_saved,
    path_options,
    positive,
    robot_of,
    said_by_options,
    start_of,
    task_options,
    what_options,
    whole,
)
from .saved import load_design
from .terminal import clear_line, progress

if TYPE_CHECKING:
    from ..motion import BestLeaf, Motion, TimedMotion
    from ..robot.task import Task
    from ..strategies import Strategy

HELP = "follow a closed path with a saved design, or another control, and write the joints' motion"
EXAMPLE = """example: repctl follow design.json --path circle:0.1 --plane yz --csv motion.csv --yaml traj.yaml

The motion is what repeats: it begins and ends at full speed along the path. With --acceleration it goes from rest to
rest, as quickly as these and the URDF's speed limits allow, all cycles but the first and last alike."""

OWN = ("pseudoinverse", "inertia")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this subcommand."""
    what_options(parser)
    parser.add_argument(
        "--strategy", metavar="NAME", help=f"in place of a design: {', '.join(OWN)}, or a registered one"
    )
    parser.add_argument(
        "--fields", metavar="NAME", help="in place of a design: design with registered fields, round the start"
    )
    parser.add_argument("--region", type=positive, default=0.4, metavar="W", help="with --fields: Ω (default 0.4)")
    task_options(parser)
    path_options(parser)
    parser.add_argument("--cycles", type=whole, default=1, help="how often round (default 1)")
    parser.add_argument("--steps", type=whole, default=500, help="points a cycle (default 500)")
    parser.add_argument("--period", type=positive, help="time of a cycle, s (default: the path's own, else 5)")
    parser.add_argument("--best-leaf", action="store_true", help="start where limits and leaf margin have most room")
    parser.add_argument(
        "--acceleration",
        metavar="A",
        help="go from rest to rest within these: rad/s² (m/s²), one number or one a joint, or panda, fr3, ur",
    )
    parser.add_argument("--rate", type=positive, default=1000.0, help="with it: samples a second (default 1000)")
    parser.add_argument("--profile", metavar="FILE", help="with it: draw joint speed over the path's length, as PNG")
    parser.add_argument("--csv", metavar="FILE", help="write time, positions, velocities, and accelerations if timed")
    parser.add_argument("--yaml", metavar="FILE", help="write a ROS JointTrajectory")
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")


def run(options: argparse.Namespace) -> int:
    """Follow the path, judge the motion, and write it."""
    say = progress(options.json)
    say("starting up")
    from ..files import write_whole
    from ..motion import best_leaf, follow, timed
    from ..motion.csv_file import csv_text, timed_csv_text
    from ..motion.export import commanded, yaml_text
    from ..motion.spec import parse_path
    from ..strategies import OnLeaves, RepeatableInverse
    from ..studies.defaults import choose_task, share_outside
    from ..studies.start_and_path import choose_setting

    make_path = parse_path(options.path, options.plane)
    _check_control(options)
    design = load_design(options) if is_saved(options.what) else None
    task = choose_task(robot_of(options), options.frame, options.task) if design is None else design.task
    start = start_of(options, task)
    if start is None and design is not None:
        start = design.region.center
    say("finding a path")
    setting = choose_setting(task, start, make_path)
    q0, path, notes = setting.q0, setting.path, setting.notes
    strategy = _control(options, task, q0) if design is None else design.inverse
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
    if design is not None and (share := share_outside(design.region, motion)) > 0:
        notes.append(f"the motion spends {share:.1%} of its time outside the design's Ω, where nothing was designed")
    slowed = (commanded(motion, strategy) if lock else motion).retimed()
    result = _result(slowed, motion.t[-1], q0, notes)
    contents: dict[str | None, Callable[[], str | bytes]] = {
        options.csv: lambda: csv_text(slowed),
        options.yaml: lambda: yaml_text(slowed),
    }
    if options.acceleration is not None:
        say("timing the motion")
        rest = timed(motion, acceleration=_accelerations(options.acceleration), rate=options.rate)
        result |= {"duration": rest.duration, "slowed_by": None, "cycle_time": rest.cycle_time, "stops": rest.stops}
        contents = {
            options.csv: lambda: timed_csv_text(rest),
            options.yaml: lambda: yaml_text(rest),
            options.profile: lambda: _drawn(rest),
        }
    elif options.profile is not None:
        raise InputError("--profile is of a timed motion; give --acceleration with it")
    result["files"] = [str(write_whole(name, text())) for name, text in contents.items() if name is not None]
    clear_line()
    if options.json:
        print(json.dumps(result, indent=2, ensure_ascii=False))
        return 0
    if found is not None:
        print(found.summary())
    _print(result, slowed)
    _warn(slowed, repeatable=isinstance(strategy, RepeatableInverse) and found is None)
    return 0


def _check_control(options: argparse.Namespace) -> None:
    """Refuse two controls, or none."""
    other = options.strategy or options.fields
    if is_saved(options.what) and other:
        raise InputError("--strategy and --fields stand in place of a design; give a robot with them")
    if not is_saved(options.what) and not other:
        raise InputError(f"{options.what!r} is no saved design (.json); for a robot say --strategy, such as {OWN[0]}")


def _control(options: argparse.Namespace, task: Task, q0: Any) -> Strategy:
    """Make the control that is to be used in place of a design."""
    from ..design import SingularRegionError, nearest_repeatable
    from ..plugins import plugin
    from ..regions import Box
    from ..strategies import Pseudoinverse, Strategy, WeightedInverse

    if options.fields:
        fields = plugin("fields", options.fields)(task, q0)
        try:
            return nearest_repeatable(Pseudoinverse(task), fields, Box(q0, options.region)).inverse
        except SingularRegionError as error:
            raise said_by_options(error) from None
    if options.strategy in OWN:
        return Pseudoinverse(task) if options.strategy == OWN[0] else WeightedInverse(task, "inertia")
    strategy = plugin("strategies", options.strategy, known=OWN)(task)
    if not isinstance(strategy, Strategy):
        raise InputError(f"--strategy {options.strategy} makes {strategy!r}, which has no task or no velocity(q, ẋ)")
    return strategy


def _accelerations(text: str) -> str | list[float]:
    """Take --acceleration: a name, a number, or one a joint."""
    if text.strip().isidentifier():
        return text.strip()
    try:
        return [float(part) for part in text.replace(" ", ",").split(",") if part]
    except ValueError:
        raise InputError(f"--acceleration {text!r} is neither numbers, separated by commas, nor a name") from None


def _drawn(rest: TimedMotion) -> bytes:
    """Draw the phase-plane profile."""
    from matplotlib.figure import Figure

    from ..show.plots.motions import png
    from ..show.plots.phase_plane import phase_plane

    figure = Figure(figsize=(6, 3.4), layout="constrained")
    phase_plane(figure.add_subplot(), rest)
    return png(figure)


def _result(motion: Motion, asked: float, q0: Any, notes: list[str]) -> dict[str, Any]:
    margin = float(motion.limit_margin.min())
    violation = motion.first_violation
    return {
        "robot": motion.task.robot.name,
        "frame": motion.task.frame,
        "task": motion.task.kind,
        "joints": list(motion.task.joint_names),
        **motion.path.as_dict(),
        "start": [float(v) for v in q0],
        "drift": motion.drift.tolist(),
        "tracking_error": float(motion.tracking_error.max()),
        "limit_margin": margin if margin < float("inf") else None,
        "first_violation": None if violation is None else {"cycle": violation[0], "joint": violation[1]},
        "peak_speed": motion.peak_speed,
        "duration": float(motion.t[-1]),
        "slowed_by": float(motion.t[-1] / asked),
        "notes": notes,
    }


def _print(result: dict[str, Any], motion: Motion) -> None:
    from ..show.plots.motions import unit

    print(f"{result['robot']} {result['frame']}, {result['task']}: {result['path']}")
    if motion.path.options:
        print(f"path again      {motion.path.options}")
    print(f"start           {', '.join(f'{v:.4g}' for v in result['start'])}")
    last = "" if motion.cycles == 1 else f", {motion.drift[-1]:.2g} after {motion.cycles}"
    print(f"joint drift     {motion.drift[0]:.2g} {unit(motion)} after 1 cycle{last}")
    print(f"tracking error  {result['tracking_error']:.2g} m at most")
    margin = result["limit_margin"]
    print(f"limit margin    {'no limits' if margin is None else f'{margin:.3g}'}")
    more = ""
    if result["slowed_by"] is None:
        stops = f", stopping {result['stops']} times in each; blend= rounds corners" if result["stops"] else ""
        more = f" from rest to rest, {result['cycle_time']:.4g} s a cycle{stops}"
    elif result["slowed_by"] > 1.0001:
        more = f", slowed down by {result['slowed_by']:.3g} to keep the speed limits"
    print(f"time            {result['duration']:.4g} s{more}")
    for note in result["notes"]:
        print(f"note: {note}")
    if result["files"] and result["slowed_by"] is not None:
        print("note: the motion begins and ends at full speed along the path; a robot at rest needs a ramp")
    for file in result["files"]:
        print(f"wrote {file}")


def _warn(motion: Motion, *, repeatable: bool) -> None:
    """Warn of a motion that no robot can follow."""
    if motion.first_violation is None:
        return
    joint = motion.first_violation[1]
    remedy = "--best-leaf, another --start" if repeatable else "another --start"
    sys.stdout.flush()
    print(
        f"repctl: warning: {joint} leaves its limits in cycle {motion.broken_cycle}; try {remedy} or a smaller --path",
        file=sys.stderr,
    )
