"""What goes wrong, in four kinds, each with one clear line for the person at the keyboard."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class RepctlError(Exception):
    """Base of every error this package raises on purpose."""


class InputError(RepctlError, ValueError):
    """Something a person gave (a name, a size, a file, an option) cannot be used."""


class UrdfError(InputError):
    """The gatekeeper refuses a robot file."""


class SingularityError(RepctlError):
    """J loses rank, or J_V does (an algorithmic singularity), where an inverse is asked for."""


def unknown(kind: str, name: object, known: Iterable[str], *, listing: str = "") -> InputError:
    """Make the error for a name that does not exist, with the nearest names that do.

    Parameters
    ----------
    kind
        What the name should have been: ``"frame"``, ``"joint"``, ``"robot"``.
    name
        What was given.
    known
        The names that exist.
    listing
        Where a person can see them all, appended to the message.
    """
    known = [str(k) for k in known]
    folded = {k.lower(): k for k in known}
    near = [folded[k] for k in difflib.get_close_matches(str(name).lower(), folded, n=4, cutoff=0.5)]
    if near:
        hint = f"did you mean {' or '.join(repr(k) for k in near)}?"
    elif len(known) <= 12:
        hint = f"there is {', '.join(known)}" if known else "there is none"
    else:
        hint = f"there are {len(known)}, such as {', '.join(known[:6])}"
    return InputError(f"no {kind} {name!r}; {hint}{' ' + listing if listing else ''}")
