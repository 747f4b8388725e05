"""``repctl follow``: one closed path with one control, written for a robot."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import repctl_pin as rp

from ..errors import InputError, needed, printable
from ..files import write_whole
from ..show.text.lines import fitted
from ..show.text.numbers import number, row
from .given import REGION, Options, integer, numbers_of, positive, said_by_options
from .options import Parser
from .terminal import progress, report

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from ..strategies import Inverse, Strategy
    from ..studies.start_and_path import Setting

HELP = "follow a closed path with a saved design, or another control, and write the joints' motion"
EXAMPLE = """example: repctl follow design.json --path circle:0.1 --plane yz --csv motion.csv --yaml traj.yaml

The motion is what repeats: it begins and ends at full speed along the path. With --acceleration it goes from rest to
rest, as quickly as these accelerations and the URDF's speed limits allow, all cycles but the first and last alike:

  repctl follow design.json --acceleration panda --jerk panda --tool-speed 0.2 --csv motion.csv
  repctl follow design.json --path seam.csv --acceleration panda --keep-times --csv motion.csv"""

OWN = ("repeatable", "pseudoinverse", "inertia")


def add_options(parser: Parser) -> None:
    """Add the options of this subcommand."""
    parser.what()
    add = parser.add_argument
    names = f"in place of a design: {', '.join(OWN)}, or a registered one (default {OWN[0]})"
    add("--strategy", metavar="NAME", help=names)
    add(
        "--potentials",
        metavar="NAME",
        help="in place of a design: design with registered potentials, round the start",
    )
    add(
        "--region",
        type=positive,
        default=REGION,
        metavar="W",
        help="with --potentials: Ω (default 0.4)",
    )
    parser.surroundings()
    parser.task()
    parser.path()
    add("--cycles", type=integer, default=1, help="number of cycles (default 1)")
    add("--steps", type=integer, default=500, help="points per cycle (default 500)")
    add(
        "--period",
        type=positive,
        help="time of a cycle, s (default: the design's or the path's own, else 5)",
    )
    add("--best-leaf", action="store_true", help="start on the leaf with the most room")
    accelerations = "rad/s² (m/s²), a number, one for each joint, or panda, fr3, ur"
    add(
        "--acceleration",
        metavar="A",
        help=f"go from rest to rest within these limits: {accelerations}",
    )
    jerks = "rad/s³ (m/s³), a number, one for each joint, or panda, fr3"
    add("--jerk", metavar="J", help=f"with --acceleration: limit jerk too, in {jerks}")
    speeds = "maximum speed of the frame, m/s; or m/s,rad/s, of its rotation too"
    add("--tool-speed", metavar="V", help=f"with --acceleration: {speeds}")
    kept = "keep the path's own times (of a CSV, or --period), and only add ramps at both ends"
    add("--keep-times", action="store_true", help=f"with --acceleration: {kept}")
    add("--rate", type=positive, help="with --acceleration: samples per second (default 1000)")
    add(
        "--profile",
        metavar="FILE",
        help="with --acceleration: draw joint speed over the path's length, as PNG",
    )
    add(
        "--csv",
        metavar="FILE",
        help="write time, positions, velocities, and accelerations if timed",
    )
    add("--yaml", metavar="FILE", help="write a ROS JointTrajectory")
    broken = "write --csv and --yaml even where a joint leaves its limits, or bodies touch"
    add("--allow-violations", action="store_true", help=broken)
    add("--json", action="store_true", help="print JSON instead of text")


def run(options: Options) -> int:
    """Follow the path, judge the motion, and write it."""
    say = progress(options.json)
    from ..motion.csv_file import csv_text
    from ..motion.joint_motion import refuse_violations, violations_of
    from ..motion.write_motion import commanded, yaml_text
    from ..robot.bodies import bodies_of
    from ..show.text.table import outside_words
    from ..strategies import OnLeaves
    from ..studies.start_and_path import NO_BETTER

    _check_control(options)
    strategy, setting, desired = _saved(options) if options.saved else (*_made(options, say), None)
    q0, path = setting.q0, setting.drawn
    notes = [*bodies_of(strategy.task).notes, *setting.notes]
    found: rp.BestLeaf | None = None
    if options.best_leaf:
        if not isinstance(strategy, rp.RepeatableInverse):
            raise InputError("--best-leaf needs a repeatable control, such as a saved design")
        say("looking for the best leaf")
        found = rp.best_leaf(strategy, path, q0, region=setting.region, desired=desired)
        q0 = found.q0
    say("following the path")
    lock = 2 if isinstance(strategy, OnLeaves) else 0
    period = options.period or setting.period
    motion = rp.follow(
        strategy,
        path,
        q0,
        cycles=options.cycles,
        steps=options.steps,
        period=period,
        leaf_lock=lock,
    )
    motion = replace(motion, region=setting.region)
    slowed = (commanded(motion, strategy) if lock else motion).retimed()
    result = _result(slowed, motion.t[-1], q0, notes)
    rest: rp.TimedMotion | None = None
    if options.acceleration is not None:
        say("timing the motion")
        rest = rp.timed(motion, **_timing(options))
        result |= {
            "duration": rest.duration,
            "slowed_by": None,
            "cycle_time": rest.cycle_time,
            "stops": rest.stops,
        }
        result["peak_speed"] = float((rest.qdot**2).sum(axis=1).max() ** 0.5)
    broken = violations_of(slowed)
    remedies = (
        ["--best-leaf"] if isinstance(strategy, rp.RepeatableInverse) and found is None else []
    )
    tried = options.start is None and not options.saved
    remedies.append(f"a --start of your own ({NO_BETTER})" if tried else "another --start")
    remedies += [*(["a smaller --path"] if all(one.moment > 0 for one in broken) else [])]
    remedy = " or ".join(remedies)
    if (options.csv or options.yaml) and not options.allow_violations:
        refuse_violations(slowed, f"try {remedy}; --allow-violations writes it anyway")
    written, contents = slowed if rest is None else rest, dict[str, str | bytes]()
    if options.csv is not None:
        contents[options.csv] = csv_text(written)
    if options.yaml is not None:
        contents[options.yaml] = yaml_text(written)
    if options.profile is not None and rest is not None:
        contents[options.profile] = _drawn(rest)
    files = [write_whole(name, content) for name, content in contents.items()]

    def text() -> str:
        loud = [
            *outside_words(motion.outside or 0.0),
            *([] if found is None else [found.summary()]),
        ]
        return fitted("\n".join([*loud, *_lines(result, slowed, written=bool(files))]))

    report(options, lambda: result, text, files)
    if broken and not options.json:
        sys.stdout.flush()
        warning = f"repctl: warning: {'; '.join(map(str, broken))}; try {remedy}"
        print(printable(warning), file=sys.stderr)
    return 0


def _check_control(options: Options) -> None:
    """Refuse two controls, options of a timed motion for one that is not, and a file asked for
    twice."""
    given = [name for name in ("strategy", "potentials") if getattr(options, name)]
    if given and (options.saved or len(given) > 1):
        raise InputError(
            "--strategy and --potentials stand in place of a design and of each other; give a robot with one"
        )
    for option in ("rate", "profile", "jerk", "tool_speed", "keep_times"):
        if getattr(options, option) not in (None, False) and options.acceleration is None:
            name = option.replace("_", "-")
            raise InputError(f"--{name} is for a timed motion; give --acceleration with it")
    files = [file for file in (options.csv, options.yaml, options.profile) if file is not None]
    if len(set(files)) < len(files):
        raise InputError(
            "--csv, --yaml and --profile are files of their own; give each another name"
        )
    if options.profile is not None:
        needed("matplotlib", by="--profile")


def _saved(options: Options) -> tuple[Strategy, Setting, Inverse]:
    """A saved design, on the cycle that it is for or on the path that is asked for; and its G_d."""
    from ..studies.start_and_path import setting_of

    design = options.load_saved()
    return (
        design.inverse,
        setting_of(design, options.asked_start(design.task), options.asked_path()),
        design.desired,
    )


def _made(options: Options, say: Callable[[str], None]) -> tuple[Strategy, Setting]:
    """The control that ``--strategy`` or ``--potentials`` names, or else the nearest repeatable,
    and where it goes."""
    from ..motion.fitting_circle import fitting_circle
    from ..plugins import plugin
    from ..strategies import Strategy
    from ..studies.start_and_path import choose_setting, design_from, shrunk_note, with_cycle

    task = options.load_task()
    plain, start, path = (
        rp.Pseudoinverse(task),
        options.asked_start(task),
        options.asked_path() or fitting_circle,
    )
    if not options.potentials and options.strategy in (None, "repeatable"):
        setting, design = design_from(
            plain,
            start,
            path,
            lambda box: rp.nearest_repeatable(plain, None, box, degree=2, shrink=True),
            say=say,
        )
        design, slower = with_cycle(design, setting, period=options.period)
        assert design.cycle is not None
        moved = (*setting.moved, *shrunk_note(design), *slower)
        return design.inverse, setting._replace(
            region=design.region, period=design.cycle.period, moved=moved
        )
    say("finding a path")
    setting = choose_setting(task, start, path)
    if options.potentials:
        potentials, box = (
            plugin("potentials", options.potentials)(task, setting.q0),
            rp.Box(setting.q0, options.region),
        )
        try:
            return rp.nearest_repeatable(plain, potentials, box).inverse, setting._replace(
                region=box
            )
        except rp.SingularRegionError as error:
            raise said_by_options(error) from None
    if options.strategy in OWN:
        return (
            plain if options.strategy == "pseudoinverse" else rp.WeightedInverse(task, "inertia")
        ), setting
    strategy = plugin("strategies", options.strategy, known=OWN)(task)
    if not isinstance(strategy, Strategy):
        raise InputError(
            f"--strategy {options.strategy} makes something without a task or a velocity(q, ẋ)"
        )
    return strategy, setting


def _timing(options: Options) -> dict[str, Any]:
    """Take the options of a timed motion."""
    tool_speed = options.tool_speed
    if tool_speed is not None:
        tool_speed = numbers_of(
            tool_speed, "--tool-speed", "is not one or two numbers, m/s and rad/s"
        )
    return {
        "acceleration": _named(options.acceleration, "--acceleration"),
        "jerk": None if options.jerk is None else _named(options.jerk, "--jerk"),
        "tool_speed": tool_speed,
        "keep_times": options.keep_times,
        "rate": options.rate or 1000.0,
    }


def _named(text: str, option: str) -> str | list[float]:
    """Take --acceleration or --jerk: a name, a number, or one a joint."""
    if text.strip().isidentifier():
        return text.strip()
    return numbers_of(text, option, "is neither numbers, separated by commas, nor a name")


def _drawn(rest: rp.TimedMotion) -> bytes:
    """Draw the phase-plane profile."""
    from matplotlib.figure import Figure

    from ..show.plots.cycles import phase_plane
    from ..show.plots.motions import png

    figure = Figure(figsize=(6, 3.4), layout="constrained")
    phase_plane(figure.add_subplot(), rest)
    return png(figure)


def _result(motion: rp.Motion, asked: float, q0: Any, notes: list[str]) -> dict[str, Any]:
    from ..studies.study_result import bodies_dict, limits_dict

    task = motion.task
    return {
        "robot": task.robot.name,
        "frame": task.frame,
        "task": task.kind,
        "joints": list(task.joint_names),
        **motion.path.as_dict(),
        "start": [float(v) for v in q0],
        "drift": motion.drift.tolist(),
        "outside": motion.outside,
        "tracking_error": float(motion.tracking_error.max()),
        **limits_dict(motion),
        **bodies_dict(motion),
        "peak_speed": motion.peak_speed,
        "duration": float(motion.t[-1]),
        "slowed_by": float(motion.t[-1] / asked),
        "notes": notes,
    }


def _lines(result: dict[str, Any], motion: rp.Motion, *, written: bool) -> Iterator[str]:
    """What a person is told of a motion."""
    yield f"{result['robot']} {result['frame']}, {result['task']}: {result['path']}"
    if motion.path.options:
        yield f"path options    {motion.path.options}"
    yield f"start           {row(result['start'])}"
    last = "" if motion.cycles == 1 else f", {number(motion.drift[-1])} after {motion.cycles}"
    yield f"joint drift     {number(motion.drift[0])} {motion.task.unit} after 1 cycle{last}"
    yield f"tracking error  {number(result['tracking_error'])} m at most"
    margin, room = result["limit_margin"], result["body_distance"]
    yield f"limit margin    {'no limits' if margin is None else number(margin)}"
    if room is not None:
        links = " and ".join(result["nearest_bodies"]["links"])
        apart = (
            f"apart    {number(room)} m at least"
            if room >= 0
            else f"overlap  {number(-room)} m at most"
        )
        yield f"bodies {apart}: {links}"
    more, slowed = "", result["slowed_by"]
    if slowed is None:
        stops = (
            f", stopping {result['stops']} times in each; blend= rounds corners"
            if result["stops"]
            else ""
        )
        more = f" from rest to rest, {result['cycle_time']:.4g} s per cycle{stops}"
    elif slowed > 1.0001:
        more = f", slowed down by {slowed:.3g} to keep the speed limits"
    yield f"time            {result['duration']:.4g} s{more}"
    if motion.outside is not None:
        yield f"outside Ω       {motion.outside:.1%}"
    yield from (f"note: {note}" for note in result["notes"])
    if written and slowed is not None:
        yield "note: the motion begins and ends at full speed along the path; a robot at rest needs a ramp"
