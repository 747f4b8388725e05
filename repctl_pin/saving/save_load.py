"""Saving and loading of designs of both kinds as JSON files, each for one robot and task.

One kind is the design of a repeatable inverse over a region of joint space. The other, from an
extension, is a function over a cell, a box of poses.

``FileKind`` is one kind of design file: for a design over a region, or for the function of a cell.
``Sealed`` is the fields that every design file has: format, version, checksum and task.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from ..base.arguments import file_name, shown
from ..base.errors import InputError, RepctlError
from ..base.plugins import Extension, all_extensions
from ..design import Design
from ..model.robot import Robot
from ..model.task import Task, require_task
from ..model.tool import require_pose
from .design_file import FORMAT, KIND, FileKind, read, write
from .schema import Sealed
from .task_identity import carrying_tool, compare, task_of, written_robot, written_task


def _extended(extension: Extension, module: str) -> FileKind:
    """Import a kind of design file from an extension: the constant ``KIND`` of its ``module``."""
    kind: FileKind = extension.module(module).KIND
    return kind


def _kinds() -> dict[str, Callable[[], FileKind]]:
    """List the kinds of design files: value of ``format`` → function that returns the kind.

    The module of an extension is imported only when its function is called.
    """
    return {FORMAT: lambda: KIND} | {
        name: partial(_extended, extension, module)
        for extension in all_extensions()
        for name, module in extension.files.items()
    }


def save(design: Any, path: str | Path) -> Path:
    """Write a design to a file atomically.

    The JSON file contains a schema version, the task (robot, frame, kind, joints), the design with
    its evaluation, and a checksum. A fingerprint of the robot covers all that the numbers depend
    on: kinematics, joint limits, and, if the design uses them, frames of arm angles, masses and
    collision bodies. Equal designs give equal files.

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
    for kind in _kinds().values():  # a study saves a Design, and imports no other kind
        if isinstance(design, kind().result):
            return write(kind().to_content(design), file_name(path))
    raise InputError(
        f"must be a design, such as the result of rp.nearest_repeatable; got {shown(design)}",
        argument="design",
    )


def load(path: str | Path, task: Task | None = None) -> Any:
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
        The design as it was saved, with an inverse that gives bitwise the same results; a
        :class:`CellDesign` if the file holds the function of a cell.

    Raises
    ------
    InputError
        If the file is not a design file, was changed after it was written, has another schema
        version, or is for another robot, frame, task kind or joints; or if the robot has changed
        since. The message names the difference.

    Warns
    -----
    UserWarning
        If an older file lacks part of the robot's fingerprint (see :func:`save`), if the proof in
        the file is dropped because it belongs to another design, or if a cell's body distance is
        dropped because the collision bodies have changed.

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
    where = str(path)
    content = read_design(path)
    made_for = content.task
    if task is None and not made_for.catalogue:
        raise InputError(
            f"{where} is for {made_for.robot} ({made_for.file}), which is not in the catalogue; "
            f"load it with the task: rp.load({where!r}, "
            f"rp.Robot.load({written_robot(made_for, path)}).task({written_task(made_for)}))"
        )
    if task is None:
        task = task_of(made_for, Robot.load(made_for.robot))
    return made_of(content, carrying_tool(made_for, task), where)


def load_design(path: str | Path, task: Task | None = None, *, frame: str | None = None) -> Design:
    """Read a design of a repeatable inverse from a file, see :func:`load`.

    Parameters
    ----------
    path, task
        The file, and the task to control, by default created from the robot catalogue.
    frame
        Another link, rigidly connected to the design's frame, that the design shall control; see
        :meth:`Design.with_tool`.

    Returns
    -------
    Design

    Raises
    ------
    InputError
        If the file holds the function of a cell, or for the reasons of :func:`load`; with
        ``frame``, also if a joint lies between the links, or the task is not a pose task.

    Examples
    --------
    >>> again = rp.load_design(rp.save(design, "design.json"), task)
    >>> again.cost == design.cost
    True
    """
    design = load(path, task)
    if isinstance(design, Design):
        return design if frame is None else _on_frame(design, frame)
    raise InputError(f"{path} holds the function of a cell, not a design; use rp.load_cell")


def _on_frame(design: Design, frame: str) -> Design:
    """Convert a design to another link, such as from the flange to the tip of a gripper.

    ``frame`` is the name of the link. InputError is raised if a joint lies between the two links,
    or the design is not for a pose task.
    """
    from ..design.with_tool import for_task  # few designs change their frame

    task = require_pose(design.task)
    robot = task.robot
    assert isinstance(robot, Robot), "tasks are made by robots"
    moving = robot.chain(frame)
    joints = [joint for joint in task.joint_names if joint in moving]
    own = robot.task(frame, task.kind, joints=joints)
    moved: Design = for_task(design, own)
    return moved


def read_design(path: str | Path) -> Any:
    """Read the content of a design file of any kind, and check that it was not changed.

    The result is an object of :mod:`.schema`, such as a ``DesignFile``. :func:`made_of` compares it
    with a robot and makes the design.
    """
    return read(path, _kinds())


def made_of(content: Sealed, task: Task, where: str) -> Any:
    """Create a Design or a CellDesign from the content of a file and the task that it was made for.

    If the file is from an older version, a UserWarning names what cannot be compared.

    Raises
    ------
    InputError
        If the task is another one, or the content does not describe a valid design; the message
        begins with ``where``, the name of the file.
    """
    try:
        compare(content.task, task, where)
        kind = _kinds()[content.format]()
        unchecked = kind.check(content, task)
        if unchecked:
            warnings.warn(
                f"{where} was written by repctl-pin {content.written_by}: the file lacks "
                f"{' and '.join(unchecked)}, so a change of these is not detected; design again",
                UserWarning,
                stacklevel=3,
            )
        return kind.to_result(content, task)
    except (ValueError, IndexError, OverflowError, TypeError, RepctlError) as error:
        raise InputError(str(error) if where in str(error) else f"{where}: {error}") from None
