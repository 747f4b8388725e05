"""Repeatable control for redundant robot arms.

Load any URDF, see how far the arm creeps on a closed path, design the control that does not.
Everything is imported when it is first asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import redundancy as redundancy
    from .design import Box as Box
    from .design import Design as Design
    from .design import nearest_repeatable as nearest_repeatable
    from .errors import InputError as InputError
    from .errors import RepctlError as RepctlError
    from .errors import SingularityError as SingularityError
    from .errors import UrdfError as UrdfError
    from .fields import Polynomial as Polynomial
    from .motion import Motion as Motion
    from .motion import Path as Path
    from .motion import circle as circle
    from .motion import figure_eight as figure_eight
    from .motion import follow as follow
    from .motion import polygon as polygon
    from .motion import reach as reach
    from .motion import read_waypoints as read_waypoints
    from .motion import rose as rose
    from .motion import waypoints as waypoints
    from .robot.robot import Robot as Robot
    from .robot.task import Task as Task
    from .strategies import PostureControl as PostureControl
    from .strategies import Pseudoinverse as Pseudoinverse
    from .strategies import RepeatableInverse as RepeatableInverse
    from .strategies import WeightedInverse as WeightedInverse
    from .studies import Study as Study
    from .studies import study as study

__version__ = "0.1.0"

_DOOR = {
    "errors": ("InputError", "RepctlError", "SingularityError", "UrdfError"),
    "robot.robot": ("Robot",),
    "robot.task": ("Task",),
    "fields": ("Polynomial",),
    "strategies": ("PostureControl", "Pseudoinverse", "RepeatableInverse", "WeightedInverse"),
    "design": ("Box", "Design", "nearest_repeatable"),
    "motion": (
        "Motion",
        "Path",
        "circle",
        "figure_eight",
        "follow",
        "polygon",
        "reach",
        "read_waypoints",
        "rose",
        "waypoints",
    ),
    "studies": ("Study", "study"),
}
_ROOM_OF = {name: room for room, names in _DOOR.items() for name in names}


def __getattr__(name: str) -> Any:
    if name == "redundancy":
        return import_module(".redundancy", __name__)
    if name not in _ROOM_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_ROOM_OF[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*_ROOM_OF, "redundancy", "__version__"])
