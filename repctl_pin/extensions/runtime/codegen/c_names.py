"""Names of exported C code: which are refused, because C, C++ or POSIX use them."""

from __future__ import annotations

import re
from typing import Any

from ....base.errors import InputError
from .c_text import template

_VARIANT = re.compile(r"(_r|_t|_np|f?(32|64|128)x?|f|l)$")
"""Ending of variants of a name of the C library, such as ``sinf`` and ``gamma_r``."""

_FAMILY = re.compile(
    "(aio|atomic|clock|cnd|fmaximum|fminimum|ifr|inet|inet6|int|m|mq|mtx|posix|pthread|re|sched|sem"
    "|si|tcp|thrd|timer|tss|uint)_|(pri|scn)[dioux]"
)
"""Beginning of names that POSIX and the C library keep for themselves."""


def checked_name(name: Any) -> str:
    """Check the name that becomes the prefix of all names and files of the C code; return it.

    Raises
    ------
    InputError
        If the name is not an identifier, has capitals only, or is reserved.
        ``reserved_names.txt`` lists keywords of C and C++, names of headers of C and POSIX and of
        what they declare, macros that compilers predefine, and names of the other exported files.
    """
    plain = isinstance(name, str) and re.fullmatch(
        r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*", name, re.ASCII
    )
    if not plain or len(name) > 40:
        raise InputError(
            "the name of the C code must be a letter followed by letters, digits and single _, "
            f"at most 40 characters, not {name!r:.60}"
        )
    if name.isupper():
        raise InputError(
            f"{name!r} could be a macro, because it has capitals only; use lower-case letters"
        )
    low, taken = name.lower(), template("reserved_names.txt").split()
    if low in taken or _VARIANT.sub("", low) in taken or _FAMILY.match(low):
        raise InputError(
            f"{name!r} is reserved in C, C++, POSIX or the export; choose another name, such as "
            f"'my_{low[:30].rstrip('_')}'"
        )
    return name
