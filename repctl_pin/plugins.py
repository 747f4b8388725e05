"""What other packages register: strategies, potentials and paths, by entry point.

In the ``pyproject.toml`` of such a package::

    [project.entry-points."repctl_pin.strategies"]
    my_control = "my_package:MyControl"          # task → strategy

    [project.entry-points."repctl_pin.potentials"]
    my_waves = "my_package:waves"                # (task, q0) → family of potentials

    [project.entry-points."repctl_pin.paths"]
    spiral = "my_package:spiral"                 # (task, q0, *numbers, plane=…) → closed path

Nothing of it is imported before it is asked for by name.
"""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from typing import Any

from .errors import InputError, unknown

_ONE_OF = {"strategies": "strategy", "potentials": "basis of potentials", "paths": "path"}
"""What is registered, and what one of each kind is called."""


def registered(kind: str) -> dict[str, EntryPoint]:
    """List what is registered of a kind, by name: nothing is imported."""
    assert kind in _ONE_OF, kind
    return {point.name: point for point in entry_points(group=f"repctl_pin.{kind}")}


def plugin(kind: str, name: str, *, known: tuple[str, ...] = ()) -> Any:
    """Import what another package registered under a name.

    Parameters
    ----------
    kind
        ``strategies``, ``potentials`` or ``paths``.
    name
        The name it was registered under.
    known
        Names that we have ourselves, for the message.

    Raises
    ------
    InputError
        If there is no such name, or it cannot be imported or called; the package is named.
    """
    found = registered(kind)
    if name not in found:
        raise unknown(_ONE_OF[kind], name, [*known, *found])
    point = found[name]
    package = point.dist.name if point.dist is not None else point.value
    try:
        made = point.load()
    except Exception as error:
        raise InputError(
            f"{name!r} of {package} cannot be imported: {type(error).__name__}: {error}"
        ) from error
    if not callable(made):
        raise InputError(f"{name!r} of {package} must be something to call, not {made!r}")
    return made
