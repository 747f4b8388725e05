"""Where ``repctl design`` designs: the start, and Ω round it or round a path."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import InputError
from .options import box_round, start_of

if TYPE_CHECKING:
    from ..motion import TaskPath
    from ..regions import Region
    from ..robot.task import Task


class Place(NamedTuple):
    """Where to design."""

    q0: Any
    where: str  # what the start is
    region: Region
    path: TaskPath | None  # that Ω follows
    notes: list[str]


def choose_place(task: Task, options: argparse.Namespace) -> Place:
    """Make Ω: a tube round a path's cycle, a box cut to the joint limits, or a workspace box in it."""
    from ..regions import WorkspaceBox
    from ..studies.defaults import choose_start

    start = start_of(options, task)
    if options.path is not None:
        return _round_a_path(task, start, options)
    if options.plane is not None:
        raise InputError("--plane is of a --path, round which Ω lies; give one")
    q0, where = choose_start(task) if start is None else (start, "as given")
    box, notes = box_round(task, q0, options.region)
    if options.workspace is None:
        return Place(q0, where, box, None, notes)
    axes = [row for row in task.rows if row < 3]
    region = WorkspaceBox(task, task.placement(q0).translation[axes], options.workspace, within=box)
    return Place(q0, where, region, None, notes)


def _round_a_path(task: Task, start: Any, options: argparse.Namespace) -> Place:
    """Lay a tube round one cycle of J⁺ on a path."""
    from ..motion import follow
    from ..motion.spec import parse_path
    from ..regions import Tube
    from ..strategies import Pseudoinverse
    from ..studies.start_and_path import choose_setting

    setting = choose_setting(task, start, parse_path(options.path, options.plane))
    cycle = follow(Pseudoinverse(task), setting.path, setting.q0, cycles=1, steps=200).cycle(0)
    there = f"--start={','.join(f'{v:.9g}' for v in setting.q0)} {setting.path.options}"
    notes = [*setting.moved, f"Ω follows {setting.path.name}; to follow it: {there}"]
    return Place(setting.q0, setting.where, Tube(cycle, options.region), setting.path, notes)
