"""Errors that this package raises: a base class, and three classes derived from it.

A message is one line: the name of an argument, a fact and a remedy.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from importlib.util import find_spec
from types import MappingProxyType
from typing import Any

_LONGEST = 800
"""Maximum number of characters of a message, which may quote a name of any length."""


def printable(text: str, *, lines: bool = False) -> str:
    """Escape unprintable characters, such as terminal control sequences.

    Texts from a user's file could otherwise change the terminal. With ``lines``, line breaks are
    kept.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or (lines and c == "\n") else ascii(c)[1:-1] for c in text)


class RepctlError(Exception):
    """Base of the errors that this package raises on purpose.

    The message reads ``argument fact; remedy``. The fact describes the fault and its cause. If
    there is an argument, the fact continues its name, such as ``must be above 0``. A fact that
    begins with a colon follows the name without a space, such as ``: there is no such folder``.

    A program that shows the message can replace ``argument`` and ``remedy`` by its own words;
    :func:`str` uses the current ones.

    Attributes
    ----------
    argument : str
        Name of the argument at fault; empty if the message names none.
    remedy : str
        Remedy, in the imperative; empty if the fact contains it.
    at : object
        Configuration, pose or line of a file at which the fault occurs; None if there is none.

    Examples
    --------
    >>> try:
    ...     rp.Robot.load("no_such_arm")
    ... except rp.RepctlError as error:  # any of this package's
    ...     print(type(error).__name__)
    InputError
    """

    def __init__(
        self, fact: str = "", *, argument: str = "", remedy: str = "", at: Any = None
    ) -> None:
        super().__init__(fact)
        self.argument = argument
        self.remedy = remedy
        self.at = at

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy all parts, whatever arguments a subclass's constructor takes."""
        return _restored, (type(self), self.args, vars(self))

    def __str__(self) -> str:
        """Format the message on one line of bounded length, whatever it quotes.

        A message may quote a file or a name of the user.
        """
        fact = super().__str__()
        joint = "" if not self.argument or fact.startswith(":") else " "
        parts = (f"{self.argument}{joint}{fact}", self.remedy)
        text = "; ".join(part for part in parts if part)
        text = text if text.isprintable() else printable(" ".join(text.split()))
        return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 200]} … {text[-200:]}"


def _restored(kind: type[RepctlError], args: tuple[Any, ...], parts: dict[str, Any]) -> RepctlError:
    """Create an error of the class ``kind`` from its parts, without calling its constructor.

    Worker processes pickle their errors. ``args`` is the error's tuple ``args``, and ``parts`` are
    its attributes by name.
    """
    error = kind.__new__(kind, *args)
    vars(error).update(parts)
    return error


class InputError(RepctlError, ValueError):
    """An argument (a name, a size, a file) cannot be used.

    Examples
    --------
    >>> try:
    ...     rp.study("panda", cycles=0)
    ... except rp.InputError as error:
    ...     print(error.argument)
    cycles
    """


class UrdfError(InputError):
    """A robot file cannot be used; the message names the line at fault.

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
    """J, or J_V at an algorithmic singularity, loses rank, so there is no inverse.

    J is the Jacobian of the task, and J_V = [J; Vᵀ] with the gradients V of the potentials that a
    repeatable inverse keeps constant.

    Examples
    --------
    >>> try:
    ...     control.velocity(np.zeros(3), [0.1, 0.0])  # stretched out
    ... except rp.SingularityError as error:
    ...     print(type(error).__name__)
    SingularityError
    """


_PACKAGES = {"collada": "pycollada", "PIL": "pillow", "umsgpack": "meshcat"}
"""Names of packages, by the name of their module where it differs."""


def needed(*modules: str, by: str) -> None:
    """Check that optional packages are installed; ``by`` names the feature that requires them.

    Raises
    ------
    InputError
        If a package is missing; the message contains the command that installs it.
    """
    missing = " ".join(
        dict.fromkeys(_PACKAGES.get(name, name) for name in modules if find_spec(name) is None)
    )
    if missing:
        are = "is" if " " not in missing else "are"
        what = missing.replace(" ", ", ")
        raise InputError(
            f"{by} requires {what}, which {are} not installed",
            remedy=f"run `pip install {missing}`",
        )


def unknown(
    kind: str,
    name: object,
    known: Iterable[str],
    *,
    aliases: Mapping[str, str] = MappingProxyType({}),
    likely: Sequence[str] = (),
    listing: str = "",
) -> InputError:
    """Create the error for an unknown name, with the most similar known names.

    Parameters
    ----------
    kind
        Kind of name that was expected: ``"frame"``, ``"joint"``, ``"robot"``.
    name
        The unknown name.
    known
        All known names.
    aliases
        Other spellings, with the name that each stands for.
    likely
        Names to list first if no known name is similar.
    listing
        Sentence that tells where to find all names, such as a command; ends the message.
    """
    name = f"{name[:59]}…" if isinstance(name, str) and len(name) > 60 else name
    every = list(dict.fromkeys([*likely, *map(str, known)]))
    near = _near(str(name), {k: k for k in every} | dict(aliases))
    if near:
        hint = f"did you mean {' or '.join(map(repr, near))}?"
    elif len(every) <= 12:
        hint = f"choose from {', '.join(every)}" if every else "there are none to choose from"
    else:
        hint = f"there are {len(every)}, such as {', '.join(every[:6])}"
    remedy = f"{hint} {listing}" if listing else hint
    return InputError(f"no {kind} {name!r}", remedy=remedy)


def _near(name: str, names: Mapping[str, str]) -> list[str]:
    """Find up to four names to suggest for the unknown ``name``; an empty list if none is similar.

    ``names`` maps each known spelling to the name that is suggested for it; an alias maps to the
    name that it stands for. Spellings that begin with ``name`` or, if it has more than two letters,
    contain it give the first suggestions. Spellings that resemble ``name`` give the next ones.
    """
    written = name.strip().lower()
    folded = {k.lower(): v for k, v in names.items()}
    holding = [
        k
        for k in folded
        if written and (k.startswith(written) or (len(written) > 2 and written in k))
    ]
    alike = difflib.get_close_matches(written, folded, n=4, cutoff=0.5)
    return list(dict.fromkeys(folded[k] for k in [*holding, *alike]))[:4]
