"""A saved design on the command line: the robot, frame, kind of task and joints are those it was made for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..errors import InputError
from .options import Options

if TYPE_CHECKING:
    from ..design import Design
    from ..design.schema import TaskFile
    from ..robot.robot import Robot
    from ..section import CellDesign


def load_design(options: Options) -> Design:
    """Load the design that WHAT names, on the robot that ``--robot`` names or the catalogue's.

    Raises
    ------
    InputError
        If it is no design over joint space, its robot is not known, or an option contradicts it.
    """
    from ..section import CellDesign

    design = load_saved(options)
    if isinstance(design, CellDesign):
        raise InputError(
            f"{options.what} is the function of a cell, which this command does not take; repctl follow does"
        )
    return design


def load_saved(options: Options) -> Design | CellDesign:
    """Load the design of either kind that WHAT names, as :func:`load_design` does."""
    from ..design.identity import task_of
    from ..saving.files import made_of, read_design

    content = read_design(options.what)
    robot = _robot(content.task, options)
    return made_of(content, task_of(content.task, robot), options.what)


def _robot(made_for: TaskFile, options: Options) -> Robot:
    """Load the robot a design was made for; an option that says otherwise is refused."""
    from ..robot.robot import Robot

    file = options.what
    for option in ("frame", "task", "base"):
        if getattr(options, option) not in (None, getattr(made_for, option)):
            its = getattr(made_for, option) or "none"
            raise InputError(f"{file} has its own {option}, {its}; leave --{option} out")
    for joint in options.lock:
        if joint not in made_for.lock:
            raise InputError(f"{file} was made with {joint!r} free to move; leave --lock {joint} out")
    if options.robot is None and not made_for.catalogue:
        raise InputError(
            f"{file} is for {made_for.robot} ({made_for.file}), which is not in the catalogue; "
            f"say where it is: --robot {made_for.file}"
        )
    robot = Robot.load(options.robot or made_for.robot, **options.beside())
    if robot.name != made_for.robot:
        raise InputError(f"{file} is for the robot {made_for.robot!r}, not {robot.name!r}; give that with --robot")
    return robot
