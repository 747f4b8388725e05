"""``repctl move``: time a motion through poses of a cell, and write it to files.

A cell is a box of poses. A limit margin is the smallest distance of a joint from its limits.
Letters: P poses, T samples, n joints.

``JointMotion`` is a joint motion over several cycles: q, q̇ (T, n) at times t, without the path of
the frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import repctl_pin as rp

from ...base.errors import InputError
from ...base.files import write_whole
from ...cli.options import Parser
from ...cli.parsed_options import Options, positive
from ...cli.print_result import print_result
from ...cli.terminal import in_percent, progress
from ...show.text.coloured_text import fitted, noted
from ...show.text.numbers import counted, metres

if TYPE_CHECKING:
    from ...motion.joint_motion import JointMotion

HELP = "move through poses of a saved cell, from rest to rest, with one configuration per pose"
EXAMPLE = """examples:
  repctl move cell.json --through poses.csv --acceleration panda --csv day.csv
  repctl move cell.json --through poses.csv --acceleration 5 --jerk 100 \\
      --blend 0.02 --tool-speed 0.5 --yaml day.yaml

poses.csv has a line x,y,z or x,y,z,qx,qy,qz,qw per pose, m in the base frame.
Without quaternions, the orientation is that of the cell's middle."""


def add_options(parser: Parser) -> None:
    """Add the options of ``repctl move`` to its parser."""
    parser.what("function of a cell (.json), saved by repctl cell")
    parser.set_defaults(frame=None, task=None)
    parser.surroundings()
    add = parser.add_argument
    through = "CSV file of the poses in order: x, y, z, m, with or without qx, qy, qz, qw"
    add("--through", metavar="FILE", required=True, help=through)
    add(
        "--blend",
        type=positive,
        default=0.0,
        metavar="R",
        help="radius of the curves that round the poses, m (default: rest at every pose)",
    )
    parser.limits()
    rate = "samples per second (default 1000)"
    add("--rate", type=positive, default=1000.0, help=rate)
    csv = "write time, positions, velocities and accelerations"
    add("--csv", metavar="FILE", help=csv)
    add("--yaml", metavar="FILE", help="write a ROS JointTrajectory")
    add(
        "--allow-violations",
        action="store_true",
        help="write --csv and --yaml even if bodies collide",
    )
    parser.json(quiet=True)


def run(options: Options) -> int:
    """Time the motion through the poses of a file, and write it; return the exit code."""
    from ...motion.csv_file import csv_text
    from ...motion.write_motion import refuse_coarse, refuse_violations, yaml_text
    from .motion_between import between

    say = progress(options.quiet or options.json)
    if options.csv is not None and options.csv == options.yaml:
        raise InputError("--csv and --yaml name the same file; give each another name")
    # the function and the poses
    design = options.load_saved()
    if not isinstance(design, rp.CellDesign):
        raise InputError(
            f"this command takes the function of a cell, but {options.what} is another design",
            remedy="design a cell with repctl cell",
        )
    limits = options.asked_limits()
    X, names = _poses(options.through, design.cell)
    # the timed motion, and its violations
    moved = between(
        design.function,
        X,
        limits,
        names,
        blend=options.blend,
        rate=options.rate,
        progress=in_percent(say),
    )
    motion = moved.motion
    assert motion is not None
    say("checking for collisions")
    result = _result(moved, motion)
    if not options.allow_violations:
        refuse_violations(motion, "move the poses, or write it anyway with --allow-violations")
    if options.csv or options.yaml:
        refuse_coarse(moved)
    # the files
    texts = ((options.csv, csv_text), (options.yaml, yaml_text))
    files = [write_whole(name, text(moved)) for name, text in texts if name is not None]
    return print_result(
        options, lambda: result, lambda: fitted("\n".join(_lines(result, moved))), files
    )


def _poses(file: str, cell: rp.Cell) -> tuple[Any, list[str]]:
    """Read the poses of a CSV file, (P, 4, 4), and a name such as "line 7" for each.

    Poses without quaternions get the orientation of the cell's middle. InputError is raised if the
    file has times, because the limits determine these.
    """
    import numpy as np

    from ...paths.waypoint_file import read_waypoints
    from ..cells.targets import homogeneous

    table = read_waypoints(file)
    if table.times is not None:
        raise InputError(
            f"{file} has times, but the limits determine them; remove the column of times"
        )
    R = table.rotations
    if R is None:
        R = np.tile(cell.placement.rotation, (len(table.points), 1, 1))
    return homogeneous(table.points, R), [f"line {line}" for line in table.lines]


def _result(moved: rp.MotionBetween, motion: JointMotion) -> dict[str, Any]:
    """Collect the figures of a motion in plain Python types, for ``--json``.

    ``motion`` is ``moved.motion``: the same samples, with limit margins and body distances. The
    keys are those of the task (``robot``, ``frame``, ``joints``, …), the attributes ``duration``,
    ``times``, ``rests`` and ``lines`` of ``moved``, ``samples`` (their number), ``limit_margin``,
    the keys of :func:`bodies_dict`, and ``notes``.
    """
    from ...studies.study_result import bodies_dict

    return {
        **motion.task.as_dict(),
        "joints": moved.joints,
        "duration": moved.duration,
        "times": moved.times,
        "rests": moved.rests,
        "lines": moved.lines,
        "samples": len(moved.t),
        "limit_margin": float(motion.limit_margin.min()),
        **bodies_dict(motion),
        "notes": motion.task.narrowed,
    }


def _lines(result: dict[str, Any], moved: rp.MotionBetween) -> Iterator[str]:
    """Yield the lines of text that report the motion.

    Body distances, nearest bodies and notes are those of ``result``, the figures for ``--json``
    (keys ``body_distance``, ``nearest_bodies``, ``notes``); the rest is taken from ``moved``.
    """
    from ...model.bodies import bodies_of
    from ...motion.joint_motion import checked_words
    from ...show.text.table import margin_words

    motion = moved.motion
    assert motion is not None
    poses, rests = len(moved.poses), len(moved.rests)
    distance = result["body_distance"]
    hits = distance is not None and distance < 0
    free = "" if distance is None else f", no collision{checked_words(motion)}"
    said = "bodies collide." if hits else f"limits respected{free}."
    yield f"{counted(poses, 'pose')} in {moved.duration:.4g} s from rest to rest; {said}"
    yield ""
    blended = f", blended at {poses - rests}" if rests < poses else ""
    yield f"poses           at rest at {rests}{blended}"
    tool = moved.lines.count("tool")
    cell = len(moved.lines) - tool
    yield f"lines           {tool} of the tool, {cell} in the coordinates of the cell"
    yield f"limit margin    {margin_words(motion)}"
    if distance is not None:
        links = " and ".join(result["nearest_bodies"]["links"])
        least = f"overlap up to {metres(-distance)}" if hits else f"minimum {metres(distance)}"
        yield f"body distance   {least}, between {links}"
    if unchecked := bodies_of(motion.task).not_checked:
        yield f"not checked     {unchecked}"
    yield from map(noted, result["notes"])
