"""The four kinds of errors, each with a message of one line."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from importlib.util import find_spec
from types import MappingProxyType

_LONGEST = 800
"""Characters of a message: a name that is quoted may have any number."""


def printable(text: str, *, lines: bool = False) -> str:
    """Escape what does not print, such as a terminal's control sequences; ``lines`` keeps line
    breaks."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or (lines and c == "\n") else ascii(c)[1:-1] for c in text)


class RepctlError(Exception):
    """Base of every error this package raises on purpose.

    Examples
    --------
    >>> try:
    ...     rp.Robot.load("no_such_arm")
    ... except rp.RepctlError as error:  # any of this package's
    ...     print(type(error).__name__)
    InputError
    """

    def __str__(self) -> str:
        """The message, on one line of bounded length whatever it quotes."""
        text = super().__str__()
        text = text if text.isprintable() else printable(" ".join(text.split()))
        return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 200]} … {text[-200:]}"


class InputError(RepctlError, ValueError):
    """An argument (a name, a size, a file, an option) cannot be used.

    Examples
    --------
    >>> try:
    ...     rp.Box([0.0, 0.0], -1.0)
    ... except rp.InputError as error:
    ...     print(type(error).__name__)
    InputError
    """


class UrdfError(InputError):
    """A robot file is refused; the message names the line at fault.

    Examples
    --------
    >>> from pathlib import Path
    >>> _ = Path("broken.urdf").write_text("<robot name='arm'>")
    >>> try:
    ...     rp.Robot.load("broken.urdf")
    ... except rp.UrdfError as error:
    ...     print(type(error).__name__)
    UrdfError
    """


class SingularityError(RepctlError):
    """J loses rank, or J_V does (an algorithmic singularity), so there is no inverse.

    Examples
    --------
    >>> try:
    ...     control.velocity(np.zeros(3), [0.1, 0.0])  # stretched out
    ... except rp.SingularityError as error:
    ...     print(type(error).__name__)
    SingularityError
    """


_PACKAGES = {"collada": "pycollada", "PIL": "pillow", "umsgpack": "meshcat"}
"""Modules whose package has another name."""


def needed(*modules: str, by: str) -> None:
    """Refuse to begin without packages that the installation on a robot's computer may have left
    out.

    Raises
    ------
    InputError
        If one is missing, with the command that installs it.
    """
    missing = " ".join(
        dict.fromkeys(_PACKAGES.get(name, name) for name in modules if find_spec(name) is None)
    )
    if missing:
        raise InputError(f"{by} needs what is not installed here: run `pip install {missing}`")


def unknown(
    kind: str,
    name: object,
    known: Iterable[str],
    *,
    aliases: Mapping[str, str] = MappingProxyType({}),
    likely: Sequence[str] = (),
    listing: str = "",
) -> InputError:
    """Make the error for a name that does not exist, with the nearest names that do.

    Parameters
    ----------
    kind
        What the name should have been: ``"frame"``, ``"joint"``, ``"robot"``.
    name
        What was given.
    known
        The names that exist.
    aliases
        What else may be written, and the name it stands for.
    likely
        Those to show first where none is near.
    listing
        Where a person can see them all, appended to the message.
    """
    name = f"{name[:59]}…" if isinstance(name, str) and len(name) > 60 else name
    every = list(dict.fromkeys([*likely, *map(str, known)]))
    near = _near(str(name), {k: k for k in every} | dict(aliases))
    if near:
        hint = f"did you mean {' or '.join(map(repr, near))}?"
    elif len(every) <= 12:
        hint = f"choose from {', '.join(every)}" if every else "there is none"
    else:
        hint = f"there are {len(every)}, such as {', '.join(every[:6])}"
    return InputError(f"no {kind} {name!r}; {hint}{' ' + listing if listing else ''}")


def _near(name: str, names: Mapping[str, str]) -> list[str]:
    """At most four names that hold what was written, or begin with it, or are spelled like it."""
    written, folded = name.strip().lower(), {k.lower(): v for k, v in names.items()}
    holding = [
        k
        for k in folded
        if written and (k.startswith(written) or (len(written) > 2 and written in k))
    ]
    alike = difflib.get_close_matches(written, folded, n=4, cutoff=0.5)
    return list(dict.fromkeys(folded[k] for k in [*holding, *alike]))[:4]
