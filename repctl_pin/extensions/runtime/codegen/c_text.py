"""Text of exported C code: numbers, structs as constants, comments, and templates.

A template is a C file in the folder ``templates`` with placeholders for the parts that differ from
export to export. Names of robots and files can contain any characters, such as ``*/``, so they are
escaped in comments.
"""

from __future__ import annotations

import ctypes
import math
import re
from collections.abc import Iterator, Mapping
from importlib.resources import files
from typing import Any

import numpy as np
import pinocchio as pin

_PLAIN = re.compile(r"[A-Za-z0-9 ,.;:+=()<>\[\]_-]")
_LONGEST = 80

_TYPES = {"frame": "Arm"}
"""Types of the members that do not bear their type's name."""


def comment(text: str) -> str:
    """Escape a text for use inside a C comment, and cut it to 80 characters.

    The result is ASCII, without ``/*`` and ``*/``: an asterisk, for example, becomes ``\\u002a``.
    """
    short = text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."
    return "".join(c if _PLAIN.match(c) else _escaped(c) for c in short)


def initialiser(value: Any) -> str:
    """Format a value as a C initialiser: a number, the name of a constant, or a list in braces.

    A str is the name of a constant. Numbers may be infinite or nan. Arrays and tuples become lists,
    and a pinocchio.SE3 becomes the list ``{position, rotation row by row}``.
    """
    if isinstance(value, str):
        return value
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, float):
        return _double(value)
    if isinstance(value, pin.SE3):
        value = value.translation, np.ravel(value.rotation)
    return f"{{{', '.join(map(initialiser, value))}}}"


def _double(x: float) -> str:
    """Format a double, which may be infinite or nan, as a C expression."""
    if math.isnan(x):
        return "(HUGE_VAL - HUGE_VAL)"
    if math.isfinite(x):
        return repr(float(x) + 0.0)  # the shortest text that parses to the same double
    return "HUGE_VAL" if x > 0 else "-HUGE_VAL"


def constants(struct: Any, kind: str, name: str) -> str:
    """Write the C definition of a struct, and of all that it points to, as ``static const``.

    Parameters
    ----------
    struct
        A filled C struct of ctypes; ``struct.held`` maps the name of each pointer in it to the
        array, or to the list of structs, that it points to.
    kind
        Name of the struct's type in C. The type of structs that a pointer points to is the
        pointer's name with a capital: that of ``part`` is ``Part``. The exception is the pointer
        ``frame``, whose structs have the type ``Arm``.
    name
        Name of the constant; the names of its arrays begin with this name.
    """
    return "\n".join(_definitions(struct, kind, name)) + "\n"


def _definitions(struct: Any, kind: str, name: str) -> Iterator[str]:
    """Yield one C definition for each array that a struct points to, and last the struct's own.

    ``struct.held`` maps the name of each pointer to what it points to, ``kind`` is the struct's
    type in C, and ``name`` the name of the constant.
    """
    entries = []
    for member, of in struct._fields_:
        held = struct.held.get(member)
        if of is not ctypes.c_void_p:
            entries.append(initialiser(getattr(struct, member)))
        elif held is None or len(held) == 0:
            entries.append("NULL")
        else:
            yield from _array(held, member, f"{name}_{member}")
            entries.append(f"{name}_{member}")
    yield f"static const {kind} {name}[1] = {{{{{', '.join(entries)}}}}};"


def _array(held: Any, member: str, name: str) -> Iterator[str]:
    """Yield the C definition of the array that the pointer ``member`` of a struct points to.

    ``held`` is the content: a NumPy array of numbers, or a list of structs, whose own arrays are
    yielded first. ``name`` is the name of the array in C.
    """
    if isinstance(held, np.ndarray):
        kind = "double" if held.dtype.kind == "f" else "int"
        values = initialiser(held.ravel())
        yield f"static const {kind} {name}[{held.size}] = {values};"
        return
    kind, entries = _TYPES.get(member, member.capitalize()), []
    for k, one in enumerate(held):
        *arrays, last = _definitions(one, kind, f"{name}_{k}")
        yield from arrays
        entries.append(last.split(" = ")[1][1:-2])
    yield f"static const {kind} {name}[{len(held)}] = {{{', '.join(entries)}}};"


def template(file: str) -> str:
    """Return the text of ``templates/FILE.in``, whose placeholders are not yet filled."""
    return (files(__package__) / "templates" / f"{file}.in").read_text(encoding="utf-8")


def pasted(*names: str) -> str:
    """Join C files of the native library, given by name, into text for one exported source file.

    An ``#include`` of a header with an include guard, or of the C library, is dropped. An
    ``#include`` of any other file is replaced by that file. Blocks ``#ifdef LEVEL``, which serve
    only to build the library for several instruction sets, are dropped too.
    """
    return "\n".join(_pasted(name) for name in names)


def _pasted(name: str) -> str:
    text = (files("repctl_pin.native") / name).read_text(encoding="utf-8")
    text = re.sub(r"(?ms)^#ifdef LEVEL.*?^#endif\n+", "", text)

    def included(found: re.Match[str]) -> str:
        inner = "" if found[1].startswith("<") else _pasted(found[1].strip('"'))
        return "" if "#ifndef REPCTL_" in inner else inner

    return re.sub(r"(?m)^#include (\S+).*\n+", included, text)


def filled(file: str, name: str, parts: Mapping[str, object]) -> str:
    """Return the text of the template ``file`` with its placeholders replaced.

    Each ``@part`` becomes ``parts["part"]``. ``arm`` and ``ARM`` become ``name``, which is the
    prefix of all exported names, in lower and in upper case.
    """
    text = re.sub(r"\bARM_", f"{name.upper()}_", template(file))
    text = re.sub(r"\barm(?=_|\.(?:h|hpp|c)\b)|(?<=namespace )arm\b", name, text)
    return re.sub(r"@([a-z]+)", lambda found: str(parts[found[1]]), text)


def _escaped(character: str) -> str:
    """Write a character as one or two escapes ``\\uXXXX``, its UTF-16 code units.

    So the character can neither end a C comment nor break its line.
    """
    units = character.encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{unit}" for unit in re.findall("....", units))
