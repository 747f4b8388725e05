"""Repeatable control for redundant robot arms.

Load any URDF, measure how far the arm drifts on a closed path, and design a controller that does
not drift. Modules are imported when one of their names is first used; ``__init__.pyi`` tells type
checkers where each name is defined.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from ._version import __version__ as __version__
from .base.plugins import all_extensions

_DOOR = {
    "base.errors": "InputError RepctlError SingularityError UrdfError",
    "base.certificate": "ClosingRadius Proof",
    "model.absolute_angles": "absolute_angles",
    "model.bodies": "Bodies",
    "model.robot": "Robot",
    "model.task": "Task",
    "regions": "Box Tube WorkspaceBox",
    "potentials": "Joined Polynomial",
    "potentials.arm_angle": "ArmAngle",
    "potentials.custom": "CustomPotentials",
    "potentials.fourier": "Fourier",
    "strategies": "PostureControl Pseudoinverse RepeatableInverse WeightedInverse",
    "strategies.custom": "CustomInverse",
    "strategies.extended": "ExtendedJacobian",
    "strategies.limit_weight": "LimitWeight",
    "base.fit_options": "FitOptions",
    "design": "Design SingularRegionError nearest_repeatable",
    "saving": "load load_design save",
    "integrability": "bracket_defect drift_per_area",
    "integrability.repeatability": "is_repeatable",
    "integrability.stable_surface": "stable_surface",
    "paths": "TaskPath circle figure_eight",
    "paths.polyline": "Waypoints polygon waypoints",
    "paths.several_paths": "several_paths",
    "paths.waypoint_file": "read_waypoints",
    "motion": "LeafLock Limits Motion follow least_closed_motion solve_ik",
    "motion.best_leaf": "BestLeaf best_leaf",
    "motion.write_motion": "write_motion",
    "motion.timed_motion": "TimedMotion",
    "show.page.animation": "Animation animation",
    "show.page.viewer": "Viewer",
    "studies.problem": "Problem",
    "studies.study_result": "Study",
    "studies.study": "study",
}
"""Public names of the core, by the module that defines them; extensions register their own."""

_MODULE_OF = {name: f"{__name__}.{m}" for m, names in _DOOR.items() for name in names.split()}


def _modules() -> dict[str, str]:
    """Find the module of each public name: a dictionary, also with the names of all extensions.

    Extensions are imported for it, so that it is called only for names that the core does not have.
    """
    return _MODULE_OF | {
        name: f"{extension.package}.{module}"
        for extension in all_extensions()
        for module, names in extension.names.items()
        for name in names.split()
    }


def __getattr__(name: str) -> Any:
    if name == "redundancy":
        return import_module(".redundancy", __name__)
    module = _MODULE_OF.get(name) or _modules().get(name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(module), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*_modules(), "redundancy", "__version__"])
