"""A design as a file, and back: JSON that says what it is for, and is refused where it does not fit."""

from __future__ import annotations

import hashlib
import json
from dataclasses import fields as attributes
from pathlib import Path
from typing import Any

import numpy as np

from .._version import __version__
from ..arguments import file_name, wanted
from ..errors import InputError, RepctlError
from ..files import read_whole, write_whole
from ..robot.task import Task, wanted_task
from ..strategies.repeatable import RepeatableInverse
from .encoding import (
    decode_desired,
    decode_field,
    decode_region,
    encode_desired,
    encode_field,
    encode_region,
)
from .identity import compare, identity, task_of
from .result import Design

FORMAT = "repctl design"
SCHEMA = 1

LARGEST = 64_000_000
_OWN = ("inverse", "desired", "fields", "region", "coefficients")
"""What of a design has a form of its own; all else are numbers, texts and lists of them."""


def save(design: Design, path: str | Path) -> Path:
    """Write a design to a file, whole or not at all.

    JSON: a schema version, the robot, frame, task kind and joints with a fingerprint of the kinematics, the
    potentials, coefficients and region, every figure of the design, and a checksum. The same design gives
    the same bytes.

    Parameters
    ----------
    design
        What :func:`nearest_repeatable` found.
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
    content: dict[str, Any] = {
        "format": FORMAT,
        "schema": SCHEMA,
        "written_by": __version__,
        "task": identity(design.task),
        "desired": encode_desired(design.desired),
        "fields": encode_field(design.fields),
        "region": encode_region(design.region),
        "coefficients": design.coefficients.tolist(),
        "figures": {a.name: _plain(getattr(design, a.name), a.name) for a in _figures()},
    }
    content["checksum"] = _checksum(content)
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
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
    where = str(path)
    content = _read(Path(path), where)
    try:
        if task is None:
            task = task_of(content["task"], where)
        compare(content["task"], task, where)
        return _design(content, task)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError, RecursionError) as error:
        if isinstance(error, RepctlError):
            raise InputError(str(error) if where in str(error) else f"{where}: {error}") from None
        raise InputError(f"{where} is no usable design: {type(error).__name__} ({error}); design again") from None


def _read(path: Path, where: str) -> dict[str, Any]:
    """Read the file and check format, schema and checksum."""
    text = read_whole(path, LARGEST)
    try:
        content = json.loads(text, object_pairs_hook=_unique, parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        raise InputError(f"{where} is no design: {error.msg} in line {error.lineno}, column {error.colno}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where} is no design: {error}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(f'{where} is no design: it does not say "format": "{FORMAT}"')
    schema = content.get("schema")
    if not isinstance(schema, int) or isinstance(schema, bool) or schema < 1:
        raise InputError(f"{where} has no schema version; design again")
    if schema > SCHEMA:
        raise InputError(
            f"{where} was written by repctl-pin {content.get('written_by')} with schema {schema}, and this is "
            f"{__version__}, which reads up to {SCHEMA}; upgrade: pip install -U repctl-pin"
        )
    if content.get("checksum") != _checksum(content):
        raise InputError(f"{where} was changed after it was written: its checksum does not fit; design again")
    return content


def _design(content: dict[str, Any], task: Task) -> Design:
    """Put a design together from checked content."""
    fields = decode_field(content["fields"])
    A = np.array(content["coefficients"], dtype=float)
    if A.shape != (fields.size, task.r) or not np.isfinite(A).all():
        raise InputError(f"the coefficients must be {fields.size} × {task.r} finite numbers; they have shape {A.shape}")
    region = decode_region(content["region"], task)
    if len(region.center) != task.n or fields.gradients(task.reference[None]).shape[1] != task.n:
        raise InputError(f"fields and region must be of {task.n} joints")
    figures = content["figures"]
    wanted = [a.name for a in _figures()]
    if sorted(figures) != sorted(wanted):
        raise InputError(f"the figures must be {', '.join(wanted)}; they are {', '.join(figures)}")
    return Design(
        inverse=RepeatableInverse(task, fields.weighted(A)),
        desired=decode_desired(content["desired"], task),
        fields=fields,
        region=region,
        coefficients=A,
        **{a.name: _typed(figures[a.name], str(a.type), a.name) for a in _figures()},
    )


def _figures() -> list[Any]:
    return [a for a in attributes(Design) if a.name not in _OWN]


def _plain(value: Any, name: str) -> Any:
    """Turn a figure into what JSON can say exactly."""
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, (tuple, list)):
        return [_plain(v, name) for v in value]
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float) and np.isfinite(value):
        return value
    raise InputError(f"design.{name} = {value!r} cannot be saved")


def _typed(value: Any, annotation: str, name: str) -> Any:
    """Turn a figure back into what the design's annotation says it is."""
    kinds: dict[str, Any] = {"float": (int, float), "int": int, "bool": bool, "str": str}
    if annotation in kinds:
        if not isinstance(value, kinds[annotation]) or (annotation != "bool" and isinstance(value, bool)):
            raise InputError(f"{name} must be a {annotation}, not {value!r}")
        return float(value) if annotation == "float" else value
    if annotation == "Array":
        return np.array(value, dtype=float)
    return _tuples(value)


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


def _checksum(content: dict[str, Any]) -> str:
    """Hash everything but the checksum itself, however it is laid out."""
    rest = {key: value for key, value in content.items() if key != "checksum"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return "sha256:" + hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"{twice!r} stands there twice")
    return found


def _refuse_constant(text: str) -> float:
    raise ValueError(f"{text} is no number of a design")
