"""Plugins: strategies, potentials and paths that other packages register as entry points.

In the ``pyproject.toml`` of such a package::

    [project.entry-points."repctl_pin.strategies"]
    my_control = "my_package:MyControl"          # task → strategy

    [project.entry-points."repctl_pin.potentials"]
    my_waves = "my_package:waves"                # (task, q0) → basis of potentials

    [project.entry-points."repctl_pin.paths"]
    spiral = "my_package:spiral"                 # (task, q0, *numbers, plane=…) → closed path

A plugin is imported only when it is requested by name.
"""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from typing import Any

from .errors import InputError, unknown

_ONE_OF = {
    "strategies": "strategy",
    "potentials": "basis of potentials",
    "paths": "path",
}
"""Kinds of plugins, and the singular noun for each."""


def registered(kind: str) -> dict[str, EntryPoint]:
    """Find the plugins of a kind, by name, without importing them."""
    assert kind in _ONE_OF, kind
    return {point.name: point for point in entry_points(group=f"repctl_pin.{kind}")}


def plugin(kind: str, name: str, *, known: tuple[str, ...] = ()) -> Any:
    """Import and return the plugin that another package registered under a name.

    Parameters
    ----------
    kind
        ``strategies``, ``potentials`` or ``paths``.
    name
        Name under which it is registered.
    known
        Built-in names, for the message.

    Raises
    ------
    InputError
        If no plugin has this name, or it cannot be imported or is not callable; the message names
        the package.
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
        raise InputError(
            f"{name!r} of {package} must be a function or a class, not {made!r}"
        )
    return made
