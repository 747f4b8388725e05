"""Parsed options, and the robots, problems and designs that they describe.

WHAT and ROBOT are the positional arguments of commands. A saved design is a .json file of ``repctl
design``, ``study`` or ``cell``. A problem is a task with a start, a closed path and a region. The
region Ω is the part of joint space for which a design was made.

``TaskFile`` is the stored robot and task of a design; the file is refused for any other robot.
"""

from __future__ import annotations

import argparse
import re
import warnings
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import repctl_pin as rp

from ..base.errors import InputError
from ..base.files import check_folder, not_left_empty
from .terminal import in_percent, say_line

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..regions import Region
    from ..saving.schema import TaskFile

D = TypeVar("D", "rp.Design", "rp.CellDesign")


class Options(argparse.Namespace):
    """Parsed options of a command, with methods that make the objects described by them.

    Attributes
    ----------
    ending : ExitStack
        Context managers to leave at the end of the command, also after an error.
    option_names : dict of str
        Command-line option for each argument name of the library, such as ``--task`` for ``kind``.
    """

    ending: ExitStack
    option_names: dict[str, str]

    @property
    def saved(self) -> bool:
        """True if the argument WHAT names a saved design."""
        return is_saved(self.what)

    def of(self, *names: str) -> dict[str, Any]:
        """Select options by name, as a dictionary: ``of("steps")`` is ``{"steps": 200}``."""
        return {name: getattr(self, name) for name in names}

    def load_robot(self) -> rp.Robot:
        """Load the robot that the argument ROBOT or WHAT names, with --lock and --base applied.

        InputError is raised for a saved design, and for --robot, which only a saved design takes.
        """
        name = self.what if "what" in self else self.robot
        if "what" in self and self.robot is not None:
            remedy = f"omit --robot to use {name}"
            raise InputError("--robot requires a saved design", remedy=remedy)
        if is_saved(name):
            raise InputError(
                f"this command requires a robot, but {name} is a saved design",
                remedy="use it with follow, check, animate or export",
            )
        return rp.Robot.load(name, lock=self.lock, base=self.base, **self.beside())

    def beside(self) -> dict[str, Any]:
        """Return two keyword arguments of ``Robot.load``: the mesh folders, and the surroundings.

        They are the values of ``--package-dir`` and, for commands that have it, ``--surroundings``.
        """
        return {
            "package_dirs": self.package_dir,
            "surroundings": getattr(self, "surroundings", None),
        }

    def asked_task(self, robot: rp.Robot | None = None) -> rp.Task:
        """Make the task that the options describe, without a search for a start or a path.

        ``robot`` is loaded if it is None.
        """
        from ..studies.task_choice import choose_task

        return choose_task(robot or self.load_robot(), *self.asked_frames())

    def problem(self, robot: rp.Robot | None = None, **parts: Any) -> rp.Problem:
        """Make the problem that the options describe: task, start and path.

        ``parts`` are arguments of :class:`Problem`, such as ``region=``, and are used instead of
        the options: with ``path=False``, ``--path`` is ignored, and the problem has no path.
        """
        frame, kind = self.asked_frames()
        asked = {
            "frame": frame,
            "kind": kind,
            "start": self.asked_start(),
            "path": self.asked_path(),
            "plane": getattr(self, "plane", None),
        }
        return rp.Problem(robot or self.load_robot(), **(asked | parts))

    def problem_of(self, design: rp.Design | rp.CellDesign, **parts: Any) -> rp.Problem:
        """Make the problem of a saved design: its task and region, with a start and a path.

        Start and path are those of the options or, if these are not given, of the design.
        ``parts`` (``start=``, ``path=``, ``plane=``) are used instead of the options.
        """
        from ..studies.of_design import problem_of

        asked = {"start": self.asked_start()}
        if "path" in self:
            asked |= self.of("path", "plane")
        return problem_of(design, **(asked | parts))

    def load_saved(self) -> rp.Design | rp.CellDesign:
        """Load the design that WHAT names, on the robot of ``--robot`` or of the catalogue.

        The result is a design over joint space, or the function of a cell, which gives a
        configuration for each pose in a box of poses. Warnings are printed as notes.

        Raises
        ------
        InputError
            If the file is not a design, its robot is not known, or an option contradicts it.
        """
        from ..saving.save_load import made_of, read_design
        from ..saving.task_identity import task_of

        if not self.saved:
            raise InputError(
                f"{self.what!r} is not a saved design (.json)",
                remedy="make one with repctl design, study or cell",
            )
        content = read_design(self.what)
        task = task_of(content.task, self._robot_of(content.task))
        with warnings.catch_warnings(record=True) as notes:
            warnings.simplefilter("always")
            design = made_of(content, task, self.what)
        for note in notes:
            say_line(f"note: {note.message}")
        return design

    def load_design(self) -> rp.Design:
        """Load the saved design over joint space that WHAT names.

        InputError is raised for a saved function of a cell, which the command cannot use.
        """
        design = self.load_saved()
        if isinstance(design, rp.CellDesign):
            raise InputError(
                f"{self.what} holds the function of a cell, which this command cannot use",
                remedy="use it with follow or export",
            )
        return design

    def _robot_of(self, made_for: TaskFile) -> rp.Robot:
        """Load the robot that a saved design was made for, from ``--robot`` or the catalogue.

        ``made_for`` is the description of the task in the design's file. InputError is raised if an
        option contradicts it (another frame, task, base or lock), if the robot is not in the
        catalogue and ``--robot`` is missing, or if ``--robot`` names another robot.
        """
        file = self.what
        for option in ("frame", "task", "base"):
            if getattr(self, option) not in (None, getattr(made_for, option)):
                its = getattr(made_for, option) or "none"
                raise InputError(
                    f"the design in {file} has its own {option}, {its}", remedy=f"omit --{option}"
                )
        for joint in self.lock:
            if joint not in made_for.lock:
                raise InputError(
                    f"the design in {file} was made with {joint!r} free to move",
                    remedy=f"omit --lock {joint}",
                )
        if self.robot is None and not made_for.catalogue:
            raise InputError(
                f"{file} is a design for the robot {made_for.robot}, which is not in the catalogue",
                remedy=f"give the path of its file: --robot {made_for.found_beside(file)}",
            )
        robot = rp.Robot.load(self.robot or made_for.robot, **self.beside())
        if robot.name != made_for.robot:
            raise InputError(
                f"{file} is a design for the robot {made_for.robot!r}, not {robot.name!r}",
                remedy=f"give the file of {made_for.robot} with --robot",
            )
        return robot

    def asked_frames(self) -> tuple[Any, str | None]:
        """Parse ``--frame`` and ``--task``: one of each, or several separated by commas.

        Return ``frame`` and ``kind`` as :class:`Problem` takes them: a text or None for one frame,
        a list for several frames. With one kind per frame, ``frame`` is a list of pairs (frame,
        kind), and ``kind`` is None.
        """
        frames = _listed(self.frame)
        kinds = _listed(self.task)
        if len(frames) < 2:
            return self.frame, self.task
        if len(kinds) < 2:
            return frames, self.task
        if len(kinds) != len(frames):
            raise InputError(
                f"has {len(kinds)} kinds for {len(frames)} frames",
                argument="kind",
                remedy="give one kind for all frames, or one per frame",
            )
        return list(zip(frames, kinds, strict=True)), None

    def asked_path(self) -> Any:
        """Parse ``--path``: one path, or one per frame, separated by commas.

        Return the argument ``path`` of :class:`Problem`, or None without ``--path``. For one frame,
        it is the text of the option. For several frames, it is a list with one entry per frame: the
        text of its path, or None for the word ``hold``, with which the frame does not move. A
        single path is that of the first frame; the other frames do not move. A single CSV file
        stays a text, because it names the frames that move.
        """
        path = getattr(self, "path", None)
        frames, paths = _listed(self.frame), _listed(path)
        if path is None or len(frames) < 2:
            return path
        if len(paths) == 1 and ".csv" in path.lower():
            return path
        if len(paths) == 1:
            paths += ["hold"] * (len(frames) - 1)
        return [None if one == "hold" else one for one in paths]

    def asked_start(self) -> list[float] | None:
        """Parse ``--start``: joint positions, rad or m, with commas; None if it is not given.

        InputError is raised for a text that is not a list of numbers; their count is checked later.
        """
        if self.start is None:
            return None
        what = "is not a list of numbers; separate them by commas"
        return numbers_of(self.start, "--start", what)

    def asked_weight(self) -> Any:
        """Parse ``--weight``, the joint weights of the desired inverse: a word, numbers, or None.

        The word is ``inertia``, ``limits`` or ``absolute``; numbers are returned as a list, of any
        length. InputError is raised for any other text.
        """
        if self.weight in (None, "inertia", "limits", "absolute"):
            return self.weight
        return numbers_of(
            self.weight,
            "--weight",
            "is neither inertia, limits, absolute, nor numbers separated by commas",
        )

    def asked_degree(self) -> Any:
        """Parse ``--degree``, the degree of a design's polynomials: ``auto`` or a number from 1 up.

        InputError is raised for any other text.
        """
        try:
            return "auto" if self.degree == "auto" else integer(self.degree)
        except argparse.ArgumentTypeError:
            fact = f"{self.degree!r} is neither auto nor a whole number from 1 up"
            raise InputError(fact, argument="--degree") from None

    def asked_limits(self) -> rp.Limits:
        """Parse ``--acceleration``, ``--jerk`` and ``--tool-speed``, the limits of a motion.

        Accelerations and jerks are given as a robot's name, one number, or one number per joint;
        the tool speed as one or two numbers, m/s and rad/s. InputError is raised for any other
        text.
        """
        tool_speed = self.tool_speed
        if tool_speed is not None:
            tool_speed = numbers_of(
                tool_speed, "--tool-speed", "is not one or two numbers, m/s and rad/s"
            )
        return rp.Limits(
            acceleration=_named(self.acceleration, "--acceleration"),
            jerk=_named(self.jerk, "--jerk"),
            tool_speed=tool_speed,
        )

    def output_folder(self, name: str) -> Path:
        """Return the output folder: ``--out``, or ``repctl-out/NAME`` with the given ``name``.

        InputError is raised if it is not writable; the check comes before the work, so that no
        result is lost. A new folder that is still empty when the command ends is removed.
        """
        folder = Path(self.out or Path("repctl-out") / name)
        try:
            check_folder(folder)
        except InputError as error:
            raise InputError(f": {error}", argument="--out") from None
        return self.ending.enter_context(not_left_empty(folder))


def _listed(text: str | None) -> list[str]:
    """Split a text at its commas into parts without spaces around them; an empty list for None."""
    return [] if text is None else [part.strip() for part in text.split(",")]


def is_saved(name: str) -> bool:
    """Test whether an argument names a saved design (a .json file) rather than a robot."""
    return Path(name).suffix.lower() == ".json"


def numbers_of(text: str, option: str, otherwise: str) -> list[float]:
    """Parse numbers separated by commas or spaces; InputError for any other text.

    The message is ``option``, the text, and ``otherwise``, such as ``is not a list of numbers``.
    """
    try:
        return [float(part) for part in text.replace(" ", ",").split(",") if part]
    except ValueError:
        raise InputError(f"{option} {text!r} {otherwise}") from None


def _named(text: str | None, option: str) -> str | list[float] | None:
    """Parse --acceleration or --jerk: a name such as panda, one number, or one per joint.

    Numbers are returned as a list, a name as it is. None stays None; ``urdf`` also gives None,
    which means the limits of the URDF. ``option`` is the option that an InputError names.
    """
    if text is None or text.strip() == "urdf":
        return None
    if text.strip().isidentifier():
        return text.strip()
    return numbers_of(text, option, "is neither numbers, separated by commas, nor a name")


def proved(design: D, say: Callable[[str], None], leaf: float = 0.0) -> D:
    """Return a copy of a design with a proof of the largest bounds that can be found in a minute.

    The proof bounds the leaf margin, the distance from an algorithmic singularity, over the whole
    region. A proof that was not reached is also added, with the reason. ``say`` receives the
    progress; ``leaf`` is the maximum change of the levels, the values of the potentials, along
    closed paths.
    """
    proof = rp.prove(design, leaf=leaf, progress=in_percent(say))
    return replace(design, proof=proof)


def require_proofs(asked: bool) -> None:
    """Raise InputError if proofs are ``asked`` for, and the native library that proves is missing.

    Commands call this before the design, which takes long and would otherwise be made in vain.
    """
    if asked:
        from ..native import required_library  # loads NumPy

        required_library("a proof")


def box_within_limits(task: rp.Task, q0: Any, half_width: float) -> rp.Box:
    """Make the region Ω as a box of a half-width around the start q0 (n,), cut at the joint limits.

    Beyond the limits the arm has no configurations to design or test for. The half-width is in rad
    (m for prismatic joints).
    """
    return rp.Box(q0, half_width).inside(task.lower, task.upper)


def cut_note(task: rp.Task, box: Region, half_width: float) -> tuple[str, ...]:
    """Make the note on the joints at whose limits a box was cut: a tuple of one text, or empty.

    The box was cut in a joint if it is narrower there than the requested ``half_width``, rad or m.
    """
    sides = zip(task.joint_names, box.bounds.half_width, strict=True)
    cut = [joint for joint, width in sides if width < half_width * (1 - 1e-9)]
    return (f"Ω was cut at the joint limits of {', '.join(cut)}",) if cut else ()


def with_options(error: rp.SingularRegionError, *, shrink: bool = False) -> rp.SingularRegionError:
    """Replace the remedy of an error on a singular Ω by command-line options; return this error.

    The library's remedy names arguments of Python functions. ``error.free`` is a smaller region
    without a singularity, or None if none was found. If there is one, the new remedy is --region
    with the half-width of this region or, if ``shrink`` is True, --shrink; set ``shrink`` only for
    a command with this option. Without one, it is another --start or a smaller --region.
    """
    from ..studies.around_motion import half_width_within

    if error.free is None:
        center = "a box cut at the joint limits has another centre"
        error.remedy = f"choose another --start, or a smaller --region: {center}"
    elif shrink:
        error.remedy = "use --shrink to design in this smaller region"
    else:
        error.remedy = f"use --region {half_width_within(error.free)}"
    return error


def integer(text: str, least: int = 1) -> int:
    """Parse a whole number from ``least`` up; for argparse, as the type of an option."""
    value = int(text) if re.fullmatch(r"\s*\+?[0-9]{1,15}\s*", text) else least - 1
    if value < least:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from {least} up")
    return value


def natural(text: str) -> int:
    """Parse a whole number from 0 up; for argparse, as the type of an option."""
    return integer(text, 0)


def positive(text: str) -> float:
    """Parse a finite number above 0; for argparse, as the type of an option."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value
