"""Write and read design files: a design as plain data in JSON, sealed by a checksum.

The content of a file is an object of :mod:`.schema`, which holds texts, numbers and lists only. A
cell is a box of poses over which a function gives one configuration per pose. A kind of file
(:class:`FileKind`) converts a design to such content and back. Its name is the value of ``format``
in the file.

``Sealed`` is the fields that every design file has: format, version, checksum and task.
``DesignFile`` is the stored design of a repeatable inverse.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from .._version import __version__
from ..base.errors import InputError, printable
from ..base.files import read_whole, write_whole
from ..design.design_result import Design
from ..model.task import Task
from ..strategies.repeatable import RepeatableInverse
from . import schema
from .schema import VERSION, DesignFile, Figures, Sealed, described, made
from .task_identity import identity, require_arm_angles, require_masses, require_ranges

FORMAT = "repctl design"

_LARGEST = 64_000_000


def write(content: Sealed, path: str | Path) -> Path:
    """Write the content of a design, with its checksum, to a JSON file atomically.

    ``content`` is an object of :mod:`.schema`, such as a ``DesignFile``; its checksum is replaced.
    Returns the path. If writing fails, an existing file stays unchanged.
    """
    plain = _printable(msgspec.to_builtins(content))
    text = json.dumps(
        plain | {"checksum": _checksum_of(plain)}, indent=1, ensure_ascii=False, allow_nan=False
    )
    return write_whole(path, text + "\n")


class FileKind(NamedTuple):
    """One kind of design file: for a design over a region, or for the function of a cell.

    Attributes
    ----------
    content : type
        Class of the file's content, a subclass of :class:`.schema.Sealed`.
    result : type
        Class of the design.
    to_content, to_result : function
        Conversions: design → content, and (content, task) → design.
    check : function
        (content, task) → names, such as "the masses", of the quantities that cannot be compared
        because an older file lacks them. InputError is raised if a quantity of the robot on which
        the design depends has changed since the file was written.
    """

    content: type[Sealed]
    result: type
    to_content: Callable[[Any], Sealed]
    to_result: Callable[[Any, Task], Any]
    check: Callable[[Any, Task], list[str]]


def read(path: str | Path, kinds: Mapping[str, Callable[[], FileKind]]) -> Any:
    """Read the content of a design file, and check format, schema version and checksum.

    ``kinds`` maps each value of the file's key ``format`` to a function that imports and returns
    the :class:`FileKind`. The result is an object of that kind's class ``content``; whether it fits
    a robot is not checked.

    Raises
    ------
    InputError
        If the file is not a design file, has another schema version, or was changed after it was
        written.
    """
    where = str(path)
    text = read_whole(path, _LARGEST)
    # format and schema first, then the content by its class
    try:
        head = msgspec.json.decode(text, type=_Head)
        if head.format not in kinds:
            raise InputError(
                f'{where} is not a design file: its "format" is {head.format!r}; '
                "give a file written by repctl design, repctl cell or rp.save"
            )
        if head.schema > VERSION:
            raise InputError(
                f"{where} was written by repctl-pin {head.written_by} with schema {head.schema}, "
                f"but repctl-pin {__version__} reads schema {VERSION}; "
                "upgrade repctl-pin"
            )
        if head.schema < 1:
            raise InputError(
                f"{where} is not a design file: it has schema {head.schema}, but schemas begin "
                "with 1; design again"
            )
        if head.schema < VERSION:
            raise InputError(
                f"{where} has schema {head.schema}, but repctl-pin {__version__} reads schema "
                f"{VERSION}; design again, or install repctl-pin {head.written_by}, which wrote it"
            )
        content = msgspec.json.decode(text, type=kinds[head.format]().content)
    except msgspec.ValidationError as error:
        raise InputError(f"{where} is not a valid design file: {error}; design again") from None
    except (msgspec.DecodeError, RecursionError, UnicodeError) as error:
        raise InputError(
            f"{where} is not a design file: it is not valid JSON ({error}); give a file written by "
            "repctl design, repctl cell or rp.save"
        ) from None
    # no control characters, and unchanged since it was written
    plain = json.loads(text)  # as written: an older file has fewer fields than its class
    if _printable(plain) != plain:
        raise InputError(
            f"{where} is not a valid design file: a text contains a control character "
            "or a line break; design again"
        )
    if content.checksum != _checksum_of(plain):
        raise InputError(
            f"{where} was changed after it was written: its checksum does not match; design again"
        )
    return content


def head(kind: str, task: Task) -> dict[str, Any]:
    """Create the fields that every design file has, for a task: format, version, checksum, task.

    ``kind`` is the value of ``format``, such as "repctl design". The checksum is empty until the
    file is written.
    """
    return {
        "format": kind,
        "schema": VERSION,
        "written_by": __version__,
        "checksum": "",
        "task": identity(task),
    }


def _design_file(design: Design) -> DesignFile:
    """Convert a design of a repeatable inverse to the content of a file.

    Raises
    ------
    InputError
        If the design contains user-defined functions, or a figure is not finite.
    """
    figures = described(Figures, design)
    for name, value in msgspec.structs.asdict(figures).items():
        if isinstance(value, float) and not np.isfinite(value):
            raise InputError(
                f"the design cannot be saved: its {name} is {value!r}, not finite; "
                "design again over a smaller region"
            )
    cycle = None if design.cycle is None else schema.cycle_file(design.cycle)
    desired = schema.desired_file(design.desired)
    potentials = schema.basis_file(design.potentials)
    region = schema.region_file(design.region)
    return described(
        DesignFile,
        design,
        **head(FORMAT, design.task),
        cycle=cycle,
        desired=desired,
        potentials=potentials,
        region=region,
        figures=figures,
        proof=schema.proof_file(design.proof),
    )


def _design_of(content: DesignFile, task: Task) -> Design:
    """Create a design from the content of a file and the task that it was made for.

    Raises
    ------
    InputError
        If the content does not describe a valid design for this task.
    """
    potentials = schema.basis_of(content.potentials, task)
    A = np.array(content.coefficients, dtype=float)
    if A.shape != (potentials.size, task.r):
        raise InputError(
            f"the coefficients have shape {A.shape}, not {(potentials.size, task.r)}, as "
            f"{potentials.size} potentials and r = {task.r} require; design again"
        )
    region = schema.region_of(content.region, task)
    if len(region.center) != task.n or potentials.gradients(region.center[None]).shape[1] != task.n:
        raise InputError(
            f"the potentials or the region are not for the {task.n} joints of the task; "
            "design again"
        )
    inverse = RepeatableInverse(task, potentials.weighted(A), region=region)
    desired = schema.desired_of(content.desired, task)
    cycle = None if content.cycle is None else schema.cycle_of(content.cycle, task)
    return made(
        Design,
        content.figures,
        inverse=inverse,
        desired=desired,
        potentials=potentials,
        region=region,
        coefficients=A,
        cycle=cycle,
        proof=schema.proof_of(content.proof),
    )


class _Head(msgspec.Struct):
    """Fields that a file has in every schema version, so that an error can name the version.

    ``format`` is the kind of file, ``schema`` its schema version, and ``written_by`` the version of
    this package that wrote it; empty if unknown.
    """

    format: str
    schema: int
    written_by: str = ""


def _printable(value: Any) -> Any:
    """Escape unprintable characters in all texts of nested dicts, lists and tuples.

    Texts from a file are printed, and could contain control sequences for a terminal.
    """
    if isinstance(value, dict):
        return {key: _printable(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return type(value)(map(_printable, value))
    return printable(value) if isinstance(value, str) else value


def _checksum_of(content: dict[str, Any]) -> str:
    """Hash the content of a file without its checksum: ``sha256:`` and 64 hex digits.

    The hash does not depend on the order of keys and on the indentation of the file.
    """
    rest = {key: value for key, value in content.items() if key != "checksum"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return "sha256:" + hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _unchecked(content: DesignFile, task: Task) -> list[str]:
    """Compare the robot of a task with that of the file ``content``.

    Returns the names of the quantities that an older file lacks. InputError is raised if joint
    limits, frames of an arm angle or masses differ. Speed limits are compared only if the design
    has a cycle, whose period depends on them.
    """
    timed = content.cycle is not None
    return [
        *require_ranges(content.task, task, speeds=timed),
        *require_arm_angles(content.potentials, content.task, task),
        *require_masses(content.desired, content.task, task),
    ]


KIND = FileKind(DesignFile, Design, _design_file, _design_of, _unchecked)
