"""A design as a file, and back: JSON that says what it is for, and is refused where it does not fit."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from .._version import __version__
from ..arguments import file_name, wanted
from ..errors import InputError, RepctlError
from ..files import read_whole, write_whole
from ..robot.robot import Robot
from ..robot.task import Task, wanted_task
from ..strategies.repeatable import RepeatableInverse
from .identity import compare, identity, task_of
from .result import Design
from .schema import (
    DesignFile,
    Figures,
    cycle_file,
    cycle_of,
    desired_file,
    desired_of,
    field_file,
    field_of,
    region_file,
    region_of,
)

FORMAT = "repctl design"
SCHEMA = 1

_LARGEST = 64_000_000


def save(design: Design, path: str | Path) -> Path:
    """Write a design to a file, whole or not at all.

    JSON: a schema version, the robot, frame, task kind and joints with a fingerprint of the kinematics, the
    cycle the control is for, the potentials, coefficients and region, every figure of the design, and a checksum.
    The same design gives the same bytes.

    Parameters
    ----------
    design
        What :func:`nearest_repeatable` found, or a study's.
    path
        The file, usually ``something.json``.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If the design holds functions of a person's own, or the file cannot be written; an old one stays.
    """
    wanted(design, Design, "design", "a design, as rp.nearest_repeatable makes them")
    path = file_name(path)
    content = DesignFile(
        format=FORMAT,
        schema=SCHEMA,
        written_by=__version__,
        checksum="",
        task=identity(design.task),
        cycle=None if design.cycle is None else cycle_file(design.cycle),
        desired=desired_file(design.desired),
        fields=field_file(design.fields),
        region=region_file(design.region),
        coefficients=design.coefficients.tolist(),
        figures=_figures(design),
    )
    plain = msgspec.to_builtins(content)
    text = json.dumps(plain | {"checksum": _checksum(plain)}, indent=1, ensure_ascii=False, allow_nan=False)
    return write_whole(path, text + "\n")


def load(path: str | Path, task: Task | None = None) -> Design:
    """Read a design from a file and make sure that it is for this task.

    Parameters
    ----------
    path
        A file that :func:`save` wrote.
    task
        What to control; by default made anew from the catalogue.

    Returns
    -------
    Design
        Its inverse steps bit for bit as the saved one's.

    Raises
    ------
    InputError
        If the file is not such a file, was changed after it was written, comes from a newer schema, or is
        for another robot, frame, task kind or joints; the difference is named.
    """
    path = file_name(path)
    if task is not None:
        wanted_task(task)
    where, content = str(path), read_design(path)
    made_for = content.task
    if task is None and not made_for.catalogue:
        raise InputError(
            f"{where} is for {made_for.robot} ({made_for.file}), which is not in the catalogue; load it with the task: "
            f"rp.load({where!r}, rp.Robot.load({made_for.file!r}).task({made_for.frame!r}, {made_for.task!r}))"
        )
    return design_of(content, task or task_of(made_for, Robot.load(made_for.robot)), where)


def read_design(path: str | Path) -> DesignFile:
    """Read a file and make sure that it is a design, of this schema, as it was written.

    Raises
    ------
    InputError
        Where it is not.
    """
    where, text = str(path), read_whole(path, _LARGEST)
    try:
        head = msgspec.json.decode(text, type=_Head)
        if head.format != FORMAT:
            raise InputError(f'{where} is no design: it does not say "format": "{FORMAT}"')
        if head.schema > SCHEMA:
            raise InputError(
                f"{where} was written by repctl-pin {head.written_by} with schema {head.schema}, and this is "
                f"{__version__}, which reads up to {SCHEMA}; upgrade: pip install -U repctl-pin"
            )
        content = msgspec.json.decode(text, type=DesignFile)
    except msgspec.ValidationError as error:
        raise InputError(f"{where} is no design: {error}") from None
    except (msgspec.DecodeError, RecursionError, UnicodeError) as error:
        raise InputError(f"{where} is no design: it is no JSON ({error})") from None
    if content.checksum != _checksum(msgspec.to_builtins(content)):
        raise InputError(f"{where} was changed after it was written: its checksum does not fit; design again")
    return content


def design_of(content: DesignFile, task: Task, where: str) -> Design:
    """Make a design of a file's content, for the task it was made for.

    Raises
    ------
    InputError
        If the task is another one, or the numbers make no design.
    """
    try:
        compare(content.task, task, where)
        fields, A = field_of(content.fields), np.array(content.coefficients, dtype=float)
        if A.shape != (fields.size, task.r):
            raise InputError(f"the coefficients must be {fields.size} × {task.r} numbers; they have shape {A.shape}")
        region = region_of(content.region, task)
        if len(region.center) != task.n or fields.gradients(task.reference[None]).shape[1] != task.n:
            raise InputError(f"fields and region must be of {task.n} joints")
        figures = msgspec.structs.asdict(content.figures)
        return Design(
            inverse=RepeatableInverse(task, fields.weighted(A), region=region),
            desired=desired_of(content.desired, task),
            fields=fields,
            region=region,
            coefficients=A,
            cycle=None if content.cycle is None else cycle_of(content.cycle, task),
            **figures | {"leaf_margin_at": np.array(content.figures.leaf_margin_at)},
        )
    except (ValueError, IndexError, OverflowError, TypeError, RepctlError) as error:
        raise InputError(str(error) if where in str(error) else f"{where}: {error}") from None


class _Head(msgspec.Struct):
    """What every file says, of whatever schema."""

    format: str
    schema: int
    written_by: str = ""


def _figures(design: Design) -> Figures:
    """Take every figure of a design as plain numbers.

    Raises
    ------
    InputError
        If one is not finite.
    """
    values = {}
    for name in Figures.__struct_fields__:
        value = getattr(design, name)
        values[name] = value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value
        if isinstance(values[name], float) and not np.isfinite(values[name]):
            raise InputError(f"design.{name} = {value!r} cannot be saved")
    return Figures(**values)


def _checksum(content: dict[str, Any]) -> str:
    """Hash everything but the checksum itself, however it is laid out."""
    rest = {key: value for key, value in content.items() if key != "checksum"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return "sha256:" + hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
