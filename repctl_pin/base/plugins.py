"""Additions to the core: this package's extensions, and plugins of other packages.

A folder in ``extensions/`` registers its additions in its ``__init__``, as an :class:`Extension`.
The core imports no extension: it finds the additions here, by name, when they are needed.

Other packages register strategies, potentials and paths as entry points, in ``pyproject.toml``::

    [project.entry-points."repctl_pin.strategies"]
    my_control = "my_package:MyControl"          # task → strategy

    [project.entry-points."repctl_pin.potentials"]
    my_waves = "my_package:waves"                # (task, q0) → basis of potentials

    [project.entry-points."repctl_pin.paths"]
    spiral = "my_package:spiral"                 # (task, q0, *numbers, plane=…) → closed path

A plugin is imported only when it is requested by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any

from .errors import InputError, unknown

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

_ONE_OF = {"strategies": "strategy", "potentials": "basis of potentials", "paths": "path"}
"""Kinds of plugins, and the singular noun for each."""


@dataclass(frozen=True)
class Extension:
    """Additions of one extension to the core, given as names of modules, which are imported later.

    Attributes
    ----------
    package : str
        The extension's own name, ``__name__``.
    commands
        Module of each command, by the name of the command.
    files
        Module that reads each kind of design file, by the ``format`` in the file. Its variable
        ``KIND`` has the functions that convert the file's content to a design, and back.
    parts
        Objects that the core uses, each given as ``module:name``, by their purpose. The purposes
        are the values of ``place`` in :func:`parts`.
    """

    package: str
    commands: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)
    parts: Mapping[str, str] = field(default_factory=dict)

    def module(self, name: str) -> Any:
        """Import a module of the extension, given by its name inside the extension's package."""
        return import_module(f"{self.package}.{name}")


@cache
def all_extensions() -> tuple[Extension, ...]:
    """Find the extensions of this package, in alphabetical order; cached.

    Each folder in ``extensions/`` is one. Only its ``__init__`` is imported here.
    """
    package = import_module("repctl_pin.extensions")
    names = sorted(found.name for found in iter_modules(package.__path__))
    return tuple(import_module(f"{package.__name__}.{name}").EXTENSION for name in names)


def parts(place: str) -> list[Any]:
    """Import the objects that extensions add to the core for one purpose, such as study notes.

    The core gets them here by the name of the purpose, because it imports no extension itself.

    Parameters
    ----------
    place
        Purpose. For ``study_design``, the objects are functions (design, seconds spent, progress
        callback) → design. For ``study_notes``, they are functions from the design of a study to
        its notes. For ``cycle_time``, they are functions from a motion to the minimum duration of
        its first cycle, s, or None. For ``problem``, they are pairs of a design class and a
        function (design, start, path, plane) → problem. Such a problem is a start with a closed
        path inside the design's region.

    Returns
    -------
    list
        One object for each extension that has such a part.
    """
    found = []
    for extension in all_extensions():
        if place in extension.parts:
            module, _, name = extension.parts[place].partition(":")
            found.append(getattr(extension.module(module), name))
    return found


def registered(kind: str) -> dict[str, EntryPoint]:
    """Map the name of each plugin of a kind to its entry point; import none.

    ``kind`` is ``strategies``, ``potentials`` or ``paths``.
    """
    assert kind in _ONE_OF, kind
    from importlib.metadata import entry_points  # a fifth of the time of --help

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
            f"plugin {name!r} of the package {package} cannot be imported: "
            f"{type(error).__name__}: {error}; correct or uninstall {package}"
        ) from error
    if not callable(made):
        raise InputError(
            f"plugin {name!r} of the package {package} must be a function or a class, "
            f"not {made!r}; correct or uninstall {package}"
        )
    return made
