"""Repeatable control for redundant robot arms.

Load any URDF, measure how far the arm drifts on a closed path, and design a controller that does
not drift. Modules are imported when one of their names is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ._version import __version__ as __version__

if TYPE_CHECKING:
    from . import redundancy as redundancy
    from .codegen import compiled as compiled
    from .codegen import export_c as export_c
    from .design import Design as Design
    from .design import SingularRegionError as SingularRegionError
    from .design.compare import compare as compare
    from .design.nearest import nearest_repeatable as nearest_repeatable
    from .errors import InputError as InputError
    from .errors import RepctlError as RepctlError
    from .errors import SingularityError as SingularityError
    from .errors import UrdfError as UrdfError
    from .fit_options import FitOptions as FitOptions
    from .integrability import bracket_defect as bracket_defect
    from .integrability import drift_per_area as drift_per_area
    from .integrability import is_repeatable as is_repeatable
    from .integrability import stable_surface as stable_surface
    from .inverse_function import Cell as Cell
    from .inverse_function import CellDesign as CellDesign
    from .inverse_function import InverseFunction as InverseFunction
    from .inverse_function import NoFunctionError as NoFunctionError
    from .inverse_function import Sector as Sector
    from .inverse_function import nearest_inverse_function as nearest_inverse_function
    from .motion import BestLeaf as BestLeaf
    from .motion import Governor as Governor
    from .motion import LeafLock as LeafLock
    from .motion import Limits as Limits
    from .motion import Motion as Motion
    from .motion import Run as Run
    from .motion import Status as Status
    from .motion import TimedMotion as TimedMotion
    from .motion import approach as approach
    from .motion import best_leaf as best_leaf
    from .motion import follow as follow
    from .motion import least_closed_motion as least_closed_motion
    from .motion import solve_ik as solve_ik
    from .motion import timed as timed
    from .motion import write_motion as write_motion
    from .paths import TaskPath as TaskPath
    from .paths import Waypoints as Waypoints
    from .paths import circle as circle
    from .paths import figure_eight as figure_eight
    from .paths import polygon as polygon
    from .paths import read_waypoints as read_waypoints
    from .paths import waypoints as waypoints
    from .potentials import CustomPotentials as CustomPotentials
    from .potentials import Fourier as Fourier
    from .potentials import Joined as Joined
    from .potentials import Polynomial as Polynomial
    from .problem import Problem as Problem
    from .proof import Proof as Proof
    from .proof import prove as prove
    from .recordings import Audit as Audit
    from .recordings import Recording as Recording
    from .recordings import Relabeled as Relabeled
    from .recordings.audit import audit as audit
    from .recordings.relabel import relabel as relabel
    from .regions import Box as Box
    from .regions import Tube as Tube
    from .regions import WorkspaceBox as WorkspaceBox
    from .robot.absolute_angles import absolute_angles as absolute_angles
    from .robot.bodies import Bodies as Bodies
    from .robot.robot import Robot as Robot
    from .robot.task import Task as Task
    from .saving import load as load
    from .saving import load_cell as load_cell
    from .saving import load_design as load_design
    from .saving import save as save
    from .show.page.animation import Animation as Animation
    from .show.page.animation import animation as animation
    from .show.page.viewer import Viewer as Viewer
    from .strategies import ArmAngle as ArmAngle
    from .strategies import CustomInverse as CustomInverse
    from .strategies import ExtendedJacobian as ExtendedJacobian
    from .strategies import LeafImpedance as LeafImpedance
    from .strategies import LimitWeight as LimitWeight
    from .strategies import PostureControl as PostureControl
    from .strategies import Pseudoinverse as Pseudoinverse
    from .strategies import RepeatableInverse as RepeatableInverse
    from .strategies import WeightedInverse as WeightedInverse
    from .studies import Study as Study
    from .studies.study import study as study

_DOOR = {
    "errors": "InputError RepctlError SingularityError UrdfError",
    "robot.absolute_angles": "absolute_angles",
    "robot.bodies": "Bodies",
    "robot.robot": "Robot",
    "robot.task": "Task",
    "regions": "Box Tube WorkspaceBox",
    "potentials": "CustomPotentials Fourier Joined Polynomial",
    "strategies": (
        "ArmAngle CustomInverse ExtendedJacobian LeafImpedance LimitWeight PostureControl "
        "Pseudoinverse RepeatableInverse WeightedInverse"
    ),
    "fit_options": "FitOptions",
    "design": "Design SingularRegionError compare nearest_repeatable",
    "codegen": "compiled export_c",
    "saving": "load load_cell load_design save",
    "inverse_function": (
        "Cell CellDesign InverseFunction NoFunctionError Sector nearest_inverse_function"
    ),
    "proof": "Proof prove",
    "integrability": "bracket_defect drift_per_area is_repeatable stable_surface",
    "paths": "TaskPath Waypoints circle figure_eight polygon read_waypoints waypoints",
    "motion": (
        "BestLeaf Governor LeafLock Limits Motion Run Status TimedMotion approach best_leaf follow "
        "least_closed_motion solve_ik timed write_motion"
    ),
    "show.page.animation": "Animation animation",
    "show.page.viewer": "Viewer",
    "problem": "Problem",
    "recordings": "Audit Recording Relabeled audit relabel",
    "studies": "Study study",
}
"""Public names, by the module that defines them."""

_ROOM_OF = {name: module for module, names in _DOOR.items() for name in names.split()}


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
