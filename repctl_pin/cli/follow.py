"""``repctl follow``: follow a closed path with one controller, and write the motion to files.

The controller is a saved design, a named strategy (``pseudoinverse``), or a design made here around
the motion. A leaf is the set of configurations on which a repeatable controller stays, because its
potentials are constant there. Ω is the region of joint space of a design. Within the closing radius
of a start, every closed path is proved to end in the configuration it began in. ``say`` is the
callback that receives the name of each step.

The nearest repeatable inverse is that with the smallest mean squared distance from J⁺ over Ω. The
figures of a motion are a dictionary, the one that ``--json`` prints. Among its keys are ``drift``
(one number per cycle, or None if it cannot be computed reliably), ``body_distance`` (m, None if
there are no bodies), ``nearest_bodies``, ``duration`` (s), ``slowed_by`` and ``notes``.

A problem is a task with a start, a closed path and a region. ``_Case`` is a controller, the problem
with its path, and known data of its design, each None if unknown. ``_Followed`` is a simulated
motion, the same motion with the commanded joint velocities, and notes on it.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import repctl_pin as rp

from ..base.defaults import REGION, STEPS
from ..base.errors import InputError, needed
from ..base.files import write_whole
from ..show.text.coloured_text import fitted, noted
from ..show.text.numbers import metres, number, row
from .options import Parser
from .parsed_options import Options, integer, positive, with_options
from .print_result import print_result
from .terminal import progress, say_line

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from ..base.certificate import ClosingRadius
    from ..regions import Region
    from ..strategies import Bounded, Inverse, Strategy

HELP = "follow a closed path with a saved design, or another controller, and write the joint motion"
EXAMPLE = """examples:
  repctl follow design.json --path circle:0.1 --csv motion.csv --yaml traj.yaml
  repctl follow design.json --acceleration panda --tool-speed 0.2 --csv m.csv
  repctl follow design.json --path seam.csv --acceleration panda --keep-times

Without --acceleration, the output is the periodic motion itself, which starts
and ends at path speed. With it, the motion goes from rest to rest in the
shortest time within these accelerations and the speed limits of the URDF; all
cycles but the first and last are alike."""

_OWN = ("repeatable", "pseudoinverse", "inertia")


def add_options(parser: Parser) -> None:
    """Add the options of ``repctl follow`` to its parser; :func:`run` reads them."""
    parser.what()
    add = parser.add_argument
    names = f"in place of a design: {', '.join(_OWN)}, or a registered one (default {_OWN[0]})"
    add("--strategy", metavar="NAME", help=names)
    add(
        "--potentials",
        metavar="NAME",
        help="in place of a design: design with registered potentials, around the start",
    )
    add(
        "--region",
        type=positive,
        default=REGION,
        metavar="W",
        help="with --potentials: half-width of Ω around the start, rad (default %(default)s)",
    )
    parser.surroundings()
    parser.task()
    parser.path()
    add("--cycles", type=integer, default=1, help="number of cycles (default 1)")
    add("--steps", type=integer, default=STEPS, help="points per cycle (default %(default)s)")
    add(
        "--period",
        type=positive,
        help="time of one cycle, s (default: that of the design or path, else 5)",
    )
    best = "search for the start with the largest margins (limits, default) or least joint speed"
    add("--best-leaf", nargs="?", const="limits", choices=["limits", "speed"], help=best)
    parser.limits()
    kept = "keep the path's own times (of a CSV, or --period), and only add ramps at both ends"
    add("--keep-times", action="store_true", help=f"{kept}; requires --acceleration")
    rate = "samples per second (default 1000); requires --acceleration"
    add("--rate", type=positive, help=rate)
    add(
        "--profile",
        metavar="FILE",
        help="draw joint speed over path length, as PNG; requires --acceleration",
    )
    add(
        "--csv",
        metavar="FILE",
        help="write time, positions, velocities, and accelerations if timed",
    )
    add("--yaml", metavar="FILE", help="write a ROS JointTrajectory")
    anyway = "write --csv and --yaml even if a joint exceeds its limits or bodies collide"
    add("--allow-violations", action="store_true", help=anyway)
    parser.json()


def run(options: Options) -> int:
    """Follow the path, evaluate the motion, write it to the requested files, and print a report.

    If a limit is violated or bodies collide, InputError is raised before ``--csv`` or ``--yaml`` is
    written, unless ``--allow-violations`` is given. Returns the exit code 0.
    """
    say = progress(options.json)
    from ..motion.joint_motion import violations_of

    # what moves, along which path, from where
    _check_control(options)
    case = _saved(options) if options.saved else _made(options, say)
    found = _searched_leaf(options, case, say) if options.best_leaf else None
    q0 = case.problem.start if found is None else found.q0

    # the motion, its numbers, and its times from rest to rest
    say("following the path")
    followed = _followed(options, case, q0)
    slowed = followed.commanded.retimed()
    result = _result(slowed, followed, q0)
    rest = _timed(options, followed.motion, say) if options.acceleration is not None else None
    if rest is not None:
        result |= _timed_result(rest)

    # the files, unless a limit is violated
    violated = violations_of(slowed)
    later = all(violation.moment > 0 for violation in violated)
    remedy = _remedy(options, best_leaf=case.locked and found is None, smaller=later)
    files = _written(options, slowed, rest, remedy)

    searched = [] if found is None else [found.summary()]
    print_result(options, lambda: result, lambda: _text(result, slowed, searched, files), files)
    if violated and not options.json:
        sys.stdout.flush()
        say_line(f"repctl: warning: {'; '.join(map(str, violated))}; {remedy}")
    return 0


class _Followed(NamedTuple):
    """Simulated motion along the path, the same motion with commanded velocities, and notes.

    ``commanded`` is the same motion with the joint velocities that a repeatable controller commands
    at each sample, instead of the mean velocities of the steps; for other controllers, it is
    ``motion``. ``unresolved`` is a note that the drift depends on the number of steps; empty if it
    does not. ``notes`` are the texts that the report prints.
    """

    motion: rp.Motion
    commanded: rp.Motion
    unresolved: str
    notes: list[str]


def _followed(options: Options, case: _Case, q0: Any) -> _Followed:
    """Follow the path of a case from the configuration q0 (n,); return the motion and its notes."""
    from ..model.bodies import bodies_of
    from ..motion.follow import unresolved
    from ..motion.write_motion import commanded
    from ..paths.winding import winding, winding_words

    strategy, problem = case.strategy, case.problem
    motion = rp.follow(
        strategy,
        problem.cycle,
        q0,
        cycles=options.cycles,
        steps=options.steps,
        period=options.period or case.period,
        integrator=rp.LeafLock(2) if case.locked else "rk4",
    )
    closes, elsewhere = _closing_radius(case, q0)
    motion = replace(motion, region=case.region, closing_radius=closes)
    loose = "" if case.locked else unresolved(strategy, motion)
    notes = [
        *problem.task.narrowed,
        *bodies_of(strategy.task).notes,
        *problem.notes,
        *case.notes,
        *elsewhere,
        *([f"this motion {loose}"] if loose else []),
    ]
    if not motion.first_closes:
        turns, joint = winding(motion.task, problem.cycle)
        notes = [winding_words(turns, joint), *notes] if turns else notes
    sent = commanded(motion, strategy) if isinstance(strategy, rp.RepeatableInverse) else motion
    return _Followed(motion, sent, loose, notes)


def _closing_radius(case: _Case, q0: Any) -> tuple[ClosingRadius | None, list[str]]:
    """Return the proved closing radius of a case for a start q0 (n,), and a list of notes.

    If q0 is on another leaf than the proof, the radius is None, and the list has a note on this. If
    nothing is proved, the radius is None, and the list is empty.
    """
    strategy = case.strategy
    if case.closes is None or not isinstance(strategy, rp.RepeatableInverse):
        return case.closes, []
    if strategy.same_leaf(q0, case.closes.start):
        return case.closes, []
    note = "the closing radius is proved on the design's leaf only; this motion is on another leaf"
    return None, [note]


def _timed(options: Options, motion: rp.Motion, say: Callable[[str], None]) -> rp.TimedMotion:
    """Time the motion from rest to rest.

    The limits are given by ``--acceleration``, ``--jerk`` and ``--tool-speed``.
    """
    say("timing the motion")
    return rp.timed(
        motion, options.asked_limits(), keep_times=options.keep_times, rate=options.rate or 1000.0
    )


def _searched_leaf(options: Options, case: _Case, say: Callable[[str], None]) -> rp.BestLeaf:
    """Search for the best leaf on which to follow the path, for ``--best-leaf``.

    ``limits``, the value of the option, maximises the smallest of three margins along the path:
    from the joint limits, between bodies, and from singularities. ``speed`` minimises the joint
    speed. InputError is raised if the controller is not repeatable.
    """
    if not isinstance(case.strategy, rp.RepeatableInverse):
        raise InputError("--best-leaf requires a repeatable controller, such as a saved design")
    say("searching for the best leaf")
    return rp.best_leaf(
        case.strategy,
        case.problem.cycle,
        case.problem.start,
        region=case.region,
        desired=case.desired,
        by=options.best_leaf,
    )


def _timed_result(rest: rp.TimedMotion) -> dict[str, Any]:
    """Collect the figures of the motion ``rest``, timed from rest to rest.

    ``duration`` is the time of all cycles, s. ``cycle_time`` is that of a steady cycle, s, or the
    mean if there are fewer than three cycles. ``slowed_by`` is None, because the motion was timed
    instead of slowed down. ``stops`` is the number of stops per cycle, and ``peak_speed`` the
    maximum norm of q̇, rad/s or m/s. The caller replaces the figures of :func:`_result` by these.
    """
    return {
        "duration": rest.duration,
        "slowed_by": None,
        "cycle_time": rest.cycle_time,
        "stops": rest.stops,
        "peak_speed": float((rest.qdot**2).sum(axis=1).max() ** 0.5),
    }


def _written(
    options: Options, slowed: rp.Motion, rest: rp.TimedMotion | None, remedy: str
) -> list[Path]:
    """Write the requested files, from the timed motion if there is one; return their paths.

    InputError is raised before ``--csv`` or ``--yaml`` is written if a limit is violated or bodies
    collide, unless ``--allow-violations`` is given. It is also raised if a timed motion has too few
    samples per cycle. ``remedy`` is the remedy for a violation. ``slowed`` is the motion slowed
    down to the speed limits, and ``rest`` the motion timed from rest to rest, or None.
    """
    from ..motion.csv_file import csv_text
    from ..motion.write_motion import (
        refuse_coarse,
        refuse_timed_violations,
        refuse_violations,
        yaml_text,
    )

    if (options.csv or options.yaml) and not options.allow_violations:
        refuse_violations(slowed, f"{remedy}, or write it anyway with --allow-violations")
    if (options.csv or options.yaml) and rest is not None:
        refuse_coarse(rest)
        if not options.allow_violations:
            remedy = "or write it anyway with --allow-violations"
            refuse_timed_violations(rest, slowed.task, remedy)
    written = slowed if rest is None else rest
    contents = dict[str, str | bytes]()
    if options.csv is not None:
        contents[options.csv] = csv_text(written)
    if options.yaml is not None:
        contents[options.yaml] = yaml_text(written)
    if options.profile is not None and rest is not None:
        from ..show.plots.cycles import phase_figure
        from ..show.plots.figure_layout import png

        contents[options.profile] = png(phase_figure(rest))
    return [write_whole(name, content) for name, content in contents.items()]


def _remedy(options: Options, *, best_leaf: bool, smaller: bool) -> str:
    """Make the remedy for an exceeded limit or a collision: ``try --best-leaf or …``.

    The text names --best-leaf with ``best_leaf``, another --start in any case, and a smaller --path
    with ``smaller``.
    """
    from ..studies.around_motion import NO_BETTER

    tried = options.start is None and not options.saved
    remedies = [
        *(["--best-leaf"] if best_leaf else []),
        f"your own --start ({NO_BETTER})" if tried else "another --start",
        *(["a smaller --path"] if smaller else []),
    ]
    return f"try {' or '.join(remedies)}"


def _check_control(options: Options) -> None:
    """Raise InputError for options that exclude or require each other, or name one file twice.

    The check comes first, so that no long motion is computed in vain.
    """
    given = [name for name in ("strategy", "potentials") if getattr(options, name)]
    if given and (options.saved or len(given) > 1):
        raise InputError(
            "--strategy and --potentials are mutually exclusive and require a robot, "
            "not a saved design"
        )
    for option in ("rate", "profile", "jerk", "tool_speed", "keep_times"):
        if getattr(options, option) not in (None, False) and options.acceleration is None:
            name = option.replace("_", "-")
            raise InputError(f"--{name} requires --acceleration")
    files = [file for file in (options.csv, options.yaml, options.profile) if file is not None]
    if len(set(files)) < len(files):
        raise InputError(
            f"two of --csv, --yaml and --profile name the same file, {max(files, key=files.count)}",
            remedy="give each another name",
        )
    if options.profile is not None:
        needed("matplotlib", by="--profile")


class _Case(NamedTuple):
    """Controller to follow a path with, the problem with the path, and known data of its design.

    ``region`` is Ω, the region of joint space of the design, ``period`` the duration of one cycle,
    s, and ``desired`` the desired inverse, which the design approximates. ``closes`` is the proved
    closing radius, with its ``metres`` and ``radians``. Each of these four is None if unknown.
    ``strategy`` is the controller, and ``notes`` are texts for the report.
    """

    strategy: Strategy
    problem: rp.Problem
    region: Bounded | None = None
    period: float | None = None
    notes: tuple[str, ...] = ()
    desired: Inverse | None = None
    closes: ClosingRadius | None = None

    @property
    def locked(self) -> bool:
        """True if the controller is repeatable, so that the path is followed with a leaf lock.

        The leaf lock removes integration errors by Newton steps, so that the motion stays on its
        leaf.
        """
        return isinstance(self.strategy, rp.RepeatableInverse)


def _saved(options: Options) -> _Case:
    """Load a saved design to follow, with its default cycle or the path of ``--path``.

    The result includes known data of the design: region, period and closing radius.
    """
    design = options.load_saved()
    problem = options.problem_of(design)
    return _Case(
        design.inverse,
        problem,
        problem.region,
        problem.period,
        desired=design.desired,
        closes=design.proof.closes if design.proof else None,
    )


def _made(options: Options, say: Callable[[str], None]) -> _Case:
    """Make the controller and the problem for a robot that is given without a saved design.

    ``--strategy`` names the controller, or ``--potentials`` gives functions of q that it holds
    constant. Without either, the nearest repeatable inverse is designed. ``say`` receives the name
    of each step.
    """
    say("finding a path")
    problem = options.problem()
    task = problem.task
    if options.potentials:
        return _with_potentials(options, problem)
    if options.strategy in (None, "repeatable"):
        return _nearest(options, problem, say)
    if options.strategy == "pseudoinverse":
        return _Case(rp.Pseudoinverse(task), problem)
    if options.strategy == "inertia":
        return _Case(rp.WeightedInverse(task, "inertia"), problem)
    return _Case(_plugin(options.strategy, task), problem)


def _nearest(options: Options, problem: rp.Problem, say: Callable[[str], None]) -> _Case:
    """Design the repeatable inverse nearest to J⁺ for the path; return it as the case to follow.

    Its region Ω is a tube around the motion on the path. Without ``--start``, several default
    starts are tried; the ``problem`` of the result has the start that was used.
    """
    from ..studies.around_motion import design_for, shrunk_note, timed_cycle

    plain = rp.Pseudoinverse(problem.task)

    def make(region: Region) -> rp.Design:
        return rp.nearest_repeatable(plain, None, region, degree=2, shrink=True)

    problem, design = design_for(problem, plain, make, say=say)
    cycle, slower = timed_cycle(design, problem, period=options.period)
    notes = (*shrunk_note(design), *slower)
    return _Case(design.inverse, problem, design.region, cycle.period, notes)


def _with_potentials(options: Options, problem: rp.Problem) -> _Case:
    """Design a repeatable inverse around the start, with potentials registered by a plugin.

    Potentials are functions of the joints that the controller holds constant. The region Ω is a box
    of half-width ``--region``. The error for a singularity in Ω names options that avoid it.
    """
    from ..base.plugins import plugin

    task, q0 = problem.task, problem.start
    potentials = plugin("potentials", options.potentials)(task, q0)
    box = rp.Box(q0, options.region)
    try:
        design = rp.nearest_repeatable(rp.Pseudoinverse(task), potentials, box)
    except rp.SingularRegionError as error:
        raise with_options(error) from None
    return _Case(design.inverse, problem, box)


def _plugin(name: str, task: rp.Task) -> Strategy:
    """Make the strategy, a controller, that a plugin registered under a name, for a task.

    InputError is raised for an unknown name, or an object that is not a strategy.
    """
    from ..base.plugins import plugin
    from ..strategies import Strategy

    strategy = plugin("strategies", name, known=_OWN)(task)
    if not isinstance(strategy, Strategy):
        raise InputError(
            f": the plugin {name!r} returned an object without the attributes task and "
            "velocity(q, ẋ); let it return a strategy, such as rp.Pseudoinverse(task)",
            argument="--strategy",
        )
    return strategy


def _result(slowed: rp.Motion, followed: _Followed, q0: Any) -> dict[str, Any]:
    """Collect the figures of the motion in plain Python types, for ``--json`` and for the text.

    ``slowed`` is the motion slowed down to meet the speed limits, and ``q0`` (n,) the start.
    ``followed`` has the motion before it was slowed down, and its notes. The module names the keys.
    """
    from ..studies.study_result import bodies_dict, limits_dict

    task, duration = slowed.task, float(slowed.t[-1])
    return {
        "robot": task.robot.name,
        "frame": task.frame,
        "task": task.kind,
        "joints": list(task.joint_names),
        **slowed.path.as_dict(),
        "start": [float(v) for v in q0],
        "drift": None if followed.unresolved else slowed.drift.tolist(),
        "outside": slowed.outside,
        "beyond_closing_radius": slowed.beyond_closing_radius,
        "tracking_error": float(slowed.tracking_error.max()),
        **limits_dict(slowed),
        **bodies_dict(slowed),
        "peak_speed": slowed.peak_speed,
        "duration": duration,
        "slowed_by": duration / float(followed.motion.t[-1]),
        "notes": followed.notes,
    }


def _text(result: dict[str, Any], slowed: rp.Motion, searched: list[str], files: list[Path]) -> str:
    """Make the report of a motion as text, from its figures ``result``, by key as in ``--json``.

    The text begins with a warning if the motion leaves Ω, followed by ``searched``: lines on the
    leaf that --best-leaf found. ``slowed`` is the motion, and ``files`` are the written files.
    """
    from ..show.text.table import outside_words

    loud = [*outside_words(slowed.outside or 0.0), *searched]
    return fitted("\n".join([*loud, *_lines(result, slowed, written=bool(files))]))


def _lines(result: dict[str, Any], motion: rp.Motion, *, written: bool) -> Iterator[str]:
    """Yield the lines of text that report a motion, from its figures ``result``, by key.

    If ``written`` is True, because files were written, a note on the speed at both ends of the
    motion is added.
    """
    from ..base.arguments import percentage
    from ..model.bodies import bodies_of
    from ..show.text.table import margin_words

    yield f"{result['robot']} {result['frame']}, {result['task']}: {result['path']}"
    if motion.path.options:
        yield f"path options    {motion.path.options}"
    yield f"start           {row(result['start'])}"
    yield f"joint drift     {_drift_words(result, motion)}"
    yield f"tracking error  maximum {number(result['tracking_error'])} m"
    yield f"limit margin    {margin_words(motion)}"
    if result["body_distance"] is not None:
        yield f"body distance   {_distance_words(result, motion)}"
    if unchecked := bodies_of(motion.task).not_checked:
        yield f"not checked     {unchecked}"
    yield f"time            {result['duration']:.4g} s{_timing_words(result)}"
    if motion.outside is not None:
        yield f"outside Ω       {percentage(motion.outside)}"
    if motion.beyond_closing_radius is not None:
        share = percentage(motion.beyond_closing_radius)
        yield f"closing radius  {share} beyond the proved radius"
    yield from map(noted, result["notes"])
    if written and result["slowed_by"] is not None:
        ends = "this motion starts and ends at path speed"
        yield f"note: {ends}; use --acceleration for a rest-to-rest trajectory"


def _drift_words(result: dict[str, Any], motion: rp.Motion) -> str:
    """Format the drift of ``motion`` after the first cycle and after the last, rad or m.

    If ``result["drift"]`` is None, the text says that the drift cannot be computed reliably.
    """
    if result["drift"] is None:
        return "cannot be computed reliably"
    first, last = (f"{number(d)}" for d in motion.drift[[0, -1]])
    more = f", {last} after {motion.cycles}" if motion.cycles > 1 else ""
    return f"{first} {motion.task.unit} after 1 cycle{more}"


def _distance_words(result: dict[str, Any], motion: rp.Motion) -> str:
    """Format the minimum body distance, or the collision, with the two links.

    The distance is ``result["body_distance"]``, m, negative in a collision. The links are the two
    names in ``result["nearest_bodies"]["links"]``.
    """
    from ..motion.joint_motion import checked_words

    distance = result["body_distance"]
    links = " and ".join(result["nearest_bodies"]["links"])
    least = f"minimum {metres(distance)}{checked_words(motion)}"
    if distance < 0:
        least = f"collision, overlap up to {metres(-distance)}"
    return f"{least}, between {links}"


def _timing_words(result: dict[str, Any]) -> str:
    """State how a motion was timed, as text that follows its duration; empty if not timed.

    The motion was slowed down to the speed limits (``slowed_by``), or timed from rest to rest. In
    the second case, ``stops`` is the number of stops per cycle, at corners and in pauses.
    """
    slowed = result["slowed_by"]
    if slowed is not None:
        kept = f", slowed down by {slowed:.3g} to keep the speed limits"
        return kept if slowed > 1.0001 else ""
    stops = ""
    if result["stops"]:
        stops = f", with {result['stops']} stops per cycle; blend= rounds corners"
    return f" from rest to rest, {result['cycle_time']:.4g} s per cycle{stops}"
