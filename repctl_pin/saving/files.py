"""Save and load designs of both kinds as JSON files, each bound to its robot and task."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from ..arguments import file_name, require_type
from ..design import Design
from ..errors import InputError, RepctlError
from ..robot.robot import Robot
from ..robot.task import Task, require_task
from .changes import require_arm_angles, require_masses, require_ranges
from .design_file import FORMAT, design_file, design_of, read, write
from .schema import DesignFile
from .task_identity import compare, task_of

if TYPE_CHECKING:
    from ..inverse_function import CellDesign
    from .cell_file import CellFile


def save(design: Design | CellDesign, path: str | Path) -> Path:
    """Write a design to a file atomically.

    The file is JSON. It contains a schema version; the robot, frame, task kind and joints with a
    fingerprint of all that its numbers depend on: the kinematics, joint limits, the frames of arm
    angles, masses and bodies; the design with its evaluation; and a checksum. The output is
    deterministic.

    Parameters
    ----------
    design
        Result of :func:`nearest_repeatable` or :func:`nearest_inverse_function`, or of a study.
    path
        The file, usually ``something.json``.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If the design contains user-defined functions, or the file cannot be written. An existing
        file is then unchanged.

    Examples
    --------
    >>> rp.save(design, "design.json").name
    'design.json'
    """
    if isinstance(design, Design):
        return write(design_file(design), file_name(path))
    from ..inverse_function import CellDesign  # a study has no need of it
    from .cell_file import cell_file

    what = "a design, as rp.nearest_repeatable makes them"
    return write(
        cell_file(require_type(design, CellDesign, "design", what)), file_name(path)
    )


def load(path: str | Path, task: Task | None = None) -> Design | CellDesign:
    """Read a design from a file, and check that it was made for this task.

    Parameters
    ----------
    path
        A file that :func:`save` wrote.
    task
        Task to control; by default created from the robot catalogue. Required if the robot is not
        in the catalogue.

    Returns
    -------
    Design or CellDesign
        The design as it was saved; its inverse gives bitwise the same results.

    Raises
    ------
    InputError
        If the file is not a design file, was changed after it was written, has another schema
        version, or is for another robot, frame, task kind or joints, or for a robot that was
        changed since; the message names the difference.

    Warns
    -----
    UserWarning
        If an older file lacks part of the fingerprint, if its certificate is dropped because it
        proves something else, or if a cell's body distance is, because the bodies have changed.

    Examples
    --------
    >>> file = rp.save(design, "design.json")
    >>> again = rp.load(file, task)
    >>> np.array_equal(again.inverse(q0), design.inverse(q0))
    True
    """
    path = file_name(path)
    if task is not None:
        require_task(task)
    where, content = str(path), read_design(path)
    made_for = content.task
    if task is None and not made_for.catalogue:
        raise InputError(
            f"{where} is for {made_for.robot} ({made_for.file}), which is not in the catalogue; "
            f"load it with the task: rp.load({where!r}, rp.Robot.load({made_for.file!r})"
            f".task({made_for.frame!r}, {made_for.task!r}))"
        )
    return made_of(
        content, task or task_of(made_for, Robot.load(made_for.robot)), where
    )


def load_design(path: str | Path, task: Task | None = None) -> Design:
    """Read a design of a repeatable inverse from a file, see :func:`load`.

    Parameters
    ----------
    path, task
        As for :func:`load`.

    Returns
    -------
    Design

    Raises
    ------
    InputError
        If the file holds a cell, or as for :func:`load`.

    Examples
    --------
    >>> again = rp.load_design(rp.save(design, "design.json"), task)
    >>> again.cost == design.cost
    True
    """
    design = load(path, task)
    if isinstance(design, Design):
        return design
    raise InputError(f"{path} holds a function over a cell; use rp.load_cell")


def load_cell(path: str | Path, task: Task | None = None) -> CellDesign:
    """Read a function over a cell from a file, see :func:`load`.

    Parameters
    ----------
    path, task
        As for :func:`load`.

    Returns
    -------
    CellDesign

    Raises
    ------
    InputError
        If the file holds a repeatable inverse, or as for :func:`load`.

    Examples
    --------
    >>> again = rp.load_cell(rp.save(found, "cell.json"), task)
    >>> again.cost == found.cost
    True
    """
    design = load(path, task)
    if not isinstance(design, Design):
        return design
    raise InputError(f"{path} holds a repeatable inverse; use rp.load_design")


def read_design(path: str | Path) -> DesignFile | CellFile:
    """Read the content of a design file of either kind, and check that it was not changed."""
    from . import cell_file

    content: DesignFile | CellFile = read(
        path, {FORMAT: DesignFile, cell_file.FORMAT: cell_file.CellFile}
    )
    return content


def made_of(
    content: DesignFile | CellFile, task: Task, where: str
) -> Design | CellDesign:
    """Create a design from the content of a file, for the task it was made for.

    Raises
    ------
    InputError
        If the task is another one, or the content does not describe a valid design; the message
        begins with ``where``, the name of the file.
    """
    try:
        compare(content.task, task, where)
        unchecked = _require_unchanged(content, task)
        if unchecked:
            warnings.warn(
                f"{where} was written by repctl-pin {content.written_by}: it does not hold, so a "
                f"change is not detected, of {' and '.join(unchecked)}",
                UserWarning,
                stacklevel=3,
            )
        if isinstance(content, DesignFile):
            return design_of(content, task)
        from .cell_file import cell_of

        return cell_of(content, task)
    except (ValueError, IndexError, OverflowError, TypeError, RepctlError) as error:
        raise InputError(
            str(error) if where in str(error) else f"{where}: {error}"
        ) from None


def _require_unchanged(content: DesignFile | CellFile, task: Task) -> list[str]:
    """Check that everything is as it was that numbers of the file depend on, but for the bodies.

    Returns the names of what an older file does not hold, so that it is not checked.
    """
    made_for = content.task
    if isinstance(content, DesignFile):
        timed = content.cycle is not None
        unchecked = require_ranges(made_for, task, speeds=timed)
        unchecked += require_arm_angles(content.potentials, made_for, task)
    else:
        unchecked = require_ranges(made_for, task, speeds=False)
        known = content.bodies is not msgspec.UNSET
        unchecked += [] if known else ["the collision bodies"]
    return unchecked + require_masses(content.desired, made_for, task)
