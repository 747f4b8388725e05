"""What a person gives on the command line: the types of options, and what is made of them."""

from __future__ import annotations

import argparse
import re
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import repctl_pin as rp

from ..errors import InputError
from ..files import check_folder, not_left_empty

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..saving.schema import TaskFile

D = TypeVar("D", "rp.Design", "rp.CellDesign")

REGION = 0.4
"""Half-width of Ω round a start, rad, where none is given."""


class Options(argparse.Namespace):
    """The options as they were given, and what several subcommands make of them.

    Attributes
    ----------
    ending : ExitStack
        What is done when the command ends, however it ends.
    """

    ending: ExitStack

    @property
    def saved(self) -> bool:
        """Whether WHAT is a saved design."""
        return is_saved(self.what)

    def of(self, *names: str) -> dict[str, Any]:
        """Take some options by name, as they are."""
        return {name: getattr(self, name) for name in names}

    def load_robot(self) -> rp.Robot:
        """Load the robot that ROBOT or WHAT names."""
        name = self.what if "what" in self else self.robot
        if "what" in self and self.robot is not None:
            raise InputError(f"--robot goes with a saved design; the robot is {name}")
        if is_saved(name):
            raise InputError(
                f"{name} is a saved design: follow, check, animate and export take it; here a robot is wanted"
            )
        return rp.Robot.load(name, lock=self.lock, base=self.base, **self.beside())

    def beside(self) -> dict[str, Any]:
        """Say where a robot's meshes are, and what stands round it."""
        return {
            "package_dirs": self.package_dir,
            "surroundings": getattr(self, "surroundings", None),
        }

    def load_task(self) -> rp.Task:
        """Load the robot, and take the task asked for, or the first redundant one."""
        from ..studies.defaults import choose_task

        return choose_task(self.load_robot(), self.frame, self.task)

    def load_saved(self) -> rp.Design | rp.CellDesign:
        """Load the design of either kind that WHAT names, on the robot that ``--robot`` names or
        the catalogue's.

        Raises
        ------
        InputError
            If it is no design, its robot is not known, or an option contradicts it.
        """
        from ..saving.files import made_of, read_design
        from ..saving.task_identity import task_of

        content = read_design(self.what)
        return made_of(content, task_of(content.task, self._robot_of(content.task)), self.what)

    def load_design(self) -> rp.Design:
        """Load a design over joint space, as :meth:`load_saved` does."""
        design = self.load_saved()
        if isinstance(design, rp.CellDesign):
            raise InputError(
                f"{self.what} is the function of a cell, which this command does not take; repctl follow and export do"
            )
        return design

    def _robot_of(self, made_for: TaskFile) -> rp.Robot:
        """Load the robot a design was made for; an option that says otherwise is refused."""
        file = self.what
        for option in ("frame", "task", "base"):
            if getattr(self, option) not in (None, getattr(made_for, option)):
                its = getattr(made_for, option) or "none"
                raise InputError(f"{file} has its own {option}, {its}; leave --{option} out")
        for joint in self.lock:
            if joint not in made_for.lock:
                raise InputError(
                    f"{file} was made with {joint!r} free to move; leave --lock {joint} out"
                )
        if self.robot is None and not made_for.catalogue:
            raise InputError(
                f"{file} is for {made_for.robot} ({made_for.file}), which is not in the catalogue; "
                f"say where it is: --robot {made_for.file}"
            )
        robot = rp.Robot.load(self.robot or made_for.robot, **self.beside())
        if robot.name != made_for.robot:
            raise InputError(
                f"{file} is for the robot {made_for.robot!r}, not {robot.name!r}; give that with --robot"
            )
        return robot

    def asked_start(self, task: rp.Task | None = None) -> Any:
        """Read ``--start``, if it was given; for a task, check it too."""
        if self.start is None:
            return None
        numbers = numbers_of(
            self.start, "--start", "is not a list of numbers; separate them by commas"
        )
        return numbers if task is None else task.check(numbers, "--start")

    def asked_path(self) -> Any:
        """Read ``--path`` and ``--plane``: a function (task, q0) → path, or None where neither is
        given."""
        from ..motion.spec import parse_path

        return (
            None if self.path is None and self.plane is None else parse_path(self.path, self.plane)
        )

    def asked(self) -> dict[str, Any]:
        """Read the frame, task, start and path, as :func:`repctl_pin.study` takes them."""
        return {
            "frame": self.frame,
            "kind": self.task,
            "start": self.asked_start(),
            "path": self.asked_path(),
        }

    def asked_weight(self) -> Any:
        """Read ``--weight``: None, a word, or numbers."""
        if self.weight in (None, "inertia", "limits"):
            return self.weight
        return numbers_of(
            self.weight,
            "--weight",
            "is neither inertia, nor limits, nor numbers separated by commas",
        )

    def asked_degree(self) -> Any:
        """Read ``--degree``: auto, or a whole number."""
        try:
            return "auto" if self.degree == "auto" else integer(self.degree)
        except argparse.ArgumentTypeError:
            raise InputError(
                f"--degree {self.degree!r} is neither auto nor a whole number from 1 up"
            ) from None

    def output_folder(self, name: str) -> Path:
        """Where the files go: ``--out``, else ``repctl-out/NAME``. It can be written; it is not
        left empty."""
        folder = Path(self.out or Path("repctl-out") / name)
        try:
            check_folder(folder)
        except InputError as error:
            raise InputError(f"{error} (--out)") from None
        return self.ending.enter_context(not_left_empty(folder))


def is_saved(name: str) -> bool:
    """Whether a name is that of a saved design."""
    return Path(name).suffix.lower() == ".json"


def numbers_of(text: str, option: str, otherwise: str) -> list[float]:
    """Read numbers separated by commas."""
    try:
        return [float(part) for part in text.replace(" ", ",").split(",") if part]
    except ValueError:
        raise InputError(f"{option} {text!r} {otherwise}") from None


def save_control(design: rp.Design | rp.CellDesign, file: Path) -> Path:
    """Save a design; where that fails, an older one is not left under the name.

    Raises
    ------
    InputError
        If it cannot be written; the message says where the older one is.
    """
    try:
        return rp.save(design, file)
    except InputError as error:
        if not file.is_file():
            raise
        old = file.with_name(f"{file.stem}.old{file.suffix}")
        file.replace(old)
        raise InputError(f"{error}; what an earlier command wrote there is now {old}") from None


def proved(design: D, say: Callable[[str], None]) -> D:
    """Put a certificate into a design: the largest bounds that can be proved in a minute."""
    proof = rp.prove(design, progress=lambda what, share: say(f"{what} {share:.0%}"))
    return replace(design, proof=proof)


def plain_proof(values: dict[str, Any]) -> dict[str, Any]:
    """A certificate for JSON: an infinite limit margin is null."""
    infinite = values["limit_margin"] == float("inf")
    return values | ({"limit_margin": None} if infinite else {})


def box_round(task: rp.Task, q0: Any, half_width: float) -> tuple[rp.Box, tuple[str, ...]]:
    """Make Ω, a box round the start cut to the joint limits; and a note where it was cut."""
    box = rp.Box(q0, half_width).inside(task.lower, task.upper)
    cut = [
        n
        for n, w in zip(task.joint_names, box.half_width, strict=True)
        if w < half_width * (1 - 1e-9)
    ]
    return box, (f"Ω was cut at the limits of {', '.join(cut)}",) if cut else ()


def said_by_options(
    error: rp.SingularRegionError, *, shrink: bool = False
) -> rp.SingularRegionError:
    """Name the options that help where Ω holds a singularity."""
    from ..studies.defaults import half_width_within

    if error.free is None:
        return error.with_remedy(
            "choose another --start, or a smaller --region: cut at the joint limits, it has another center"
        )
    return error.with_remedy(
        "--shrink takes that" if shrink else f"give --region {half_width_within(error.free)}"
    )


def integer(text: str, least: int = 1) -> int:
    """Take a whole number from 1 up."""
    value = int(text) if re.fullmatch(r"\s*\+?[0-9]{1,15}\s*", text) else least - 1
    if value < least:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from {least} up")
    return value


def natural(text: str) -> int:
    """Take a whole number from 0 up."""
    return integer(text, 0)


def positive(text: str) -> float:
    """Take a number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value
