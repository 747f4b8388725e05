"""A saved design on the command line: the robot, frame, kind of task and joints are those it was made for."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

from ..errors import InputError

if TYPE_CHECKING:
    from ..design import Design
    from ..robot.task import Task

_KEPT: dict[str, type | tuple[type, ...]] = {
    "robot": str,
    "catalogue": bool,
    "file": str,
    "base": (str, type(None)),
    "lock": list,
    "frame": str,
    "kind": str,
    "joints": list,
    "coordinates": (list, type(None)),
}
"""What a file says of its task, see :func:`repctl_pin.design.identity.identity`."""


def load_design(options: argparse.Namespace) -> Design:
    """Load the design that WHAT names, on the robot that ``--robot`` names or the catalogue's.

    Raises
    ------
    InputError
        If it is no design, its robot is not known, or an option contradicts it.
    """
    from ..design import load

    made_for = _made_for(options.what)
    return load(options.what, None if made_for is None else _task(made_for, options))


def _made_for(file: str) -> dict[str, Any] | None:
    """Read what a file says of its task; None where it is no such file, and load() says why."""
    from ..design.storage import LARGEST
    from ..files import read_whole

    try:
        said = json.loads(read_whole(file, LARGEST))["task"]
        return said if all(isinstance(said[key], kind) for key, kind in _KEPT.items()) else None
    except (ValueError, LookupError, TypeError, RecursionError):
        return None


def _task(made_for: dict[str, Any], options: argparse.Namespace) -> Task:
    """Make the task a design was made for."""
    from ..robot.robot import Robot

    file, name = options.what, options.robot or made_for["robot"]
    for option, key in (("frame", "frame"), ("task", "kind"), ("base", "base")):
        if getattr(options, option) not in (None, made_for[key]):
            its = made_for[key] or "none"
            raise InputError(f"{file} has its own {option}, {its}; leave --{option} out")
    for joint in options.lock:
        if joint not in made_for["lock"]:
            raise InputError(f"{file} was made with {joint!r} free to move; leave --lock {joint} out")
    if options.robot is None and not made_for["catalogue"]:
        raise InputError(
            f"{file} is for {name} ({made_for['file']}), which is not in the catalogue; "
            f"say where it is: --robot {made_for['file']}"
        )
    robot = Robot.load(name, package_dirs=options.package_dir)
    if robot.name != made_for["robot"]:
        raise InputError(f"{file} is for the robot {made_for['robot']!r}, not {robot.name!r}; give that with --robot")
    if made_for["lock"] or made_for["base"]:
        robot = Robot.load(name, package_dirs=options.package_dir, lock=made_for["lock"], base=made_for["base"])
    task = robot.task(made_for["frame"], made_for["kind"], joints=made_for["joints"])
    return task if made_for["coordinates"] is None else task.in_coordinates(made_for["coordinates"])
