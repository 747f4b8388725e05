"""C as text: names, numbers, comments that no file's words can end, and templates."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from importlib.resources import files
from typing import Any

import numpy as np
import pinocchio as pin

from ..errors import InputError
from .expressions import number

_PLAIN = re.compile(r"[A-Za-z0-9 ,.;:+=()<>\[\]_-]")
_LONGEST = 80


def checked_name(name: Any) -> str:
    """Take the name that every name of the C code begins with, and its files too.

    Raises
    ------
    InputError
        If it is no plain identifier, or one that C, C++ or the other files have already.
    """
    plain = isinstance(name, str) and re.fullmatch(
        r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*", name, re.ASCII
    )
    if not plain or len(name) > 40:
        raise InputError(
            f"the name of the C code is a letter and then letters, digits and single _, 40 at most, not {name!r:.60}"
        )
    if (
        name.lower() in template("taken.txt").split()
    ):  # words of C and C++, headers, and our other files
        raise InputError(
            f"{name!r} means something else in C, C++ or the export; choose another name"
        )
    return name


def comment(text: str) -> str:
    """Write a text that came out of a file so that it ends no comment: ASCII, all but plain marks
    as ``\\u002a``."""
    short = text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."
    return "".join(c if _PLAIN.match(c) else _escaped(c) for c in short)


def table(rows: Iterable[Iterable[float]], indent: str = "        ") -> str:
    """Write the rows of a table of doubles."""
    return ",\n".join(f"{indent}{{{', '.join(map(number, row))}}}" for row in rows)


def row(values: Iterable[float]) -> str:
    """Write one row of doubles."""
    return f"{{{', '.join(map(value, values))}}}"


def pose(placement: pin.SE3) -> str:
    """Write a placement: position, and rotation row by row."""
    return f"{{{row(placement.translation)}, {row(np.ravel(placement.rotation))}}}"


def value(x: float) -> str:
    """Write a double that need not be finite."""
    if math.isnan(x):
        return "(HUGE_VAL - HUGE_VAL)"
    return number(x) if math.isfinite(x) else "HUGE_VAL" if x > 0 else "-HUGE_VAL"


def integer(values: Iterable[int]) -> str:
    """Write one row of whole numbers."""
    return f"{{{', '.join(str(int(v)) for v in values)}}}"


def template(file: str) -> str:
    """Read a template: C as it stands, but for ``@part`` and the name ``arm``."""
    return (files(__package__) / "assets" / file).read_text(encoding="utf-8")


def filled(file: str, name: str, parts: Mapping[str, object]) -> str:
    """Fill a template: parts in the place of ``@part``, the name in that of ``arm`` and ``ARM``."""
    text = re.sub(r"\bARM_", f"{name.upper()}_", template(file))
    text = re.sub(r"\barm(?=_|\.(?:h|hpp|c)\b)|(?<=namespace )arm\b", name, text)
    return re.sub(r"@([a-z]+)", lambda found: str(parts[found[1]]), text)


def _escaped(character: str) -> str:
    """Its UTF-16 code units; a lone surrogate is one itself."""
    units = character.encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{unit}" for unit in re.findall("....", units))
