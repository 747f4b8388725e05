"""Models loaded by other libraries, ``yourdfpy.URDF`` and ``mujoco.MjModel``, as URDF text."""

from __future__ import annotations

import sys
from typing import Any

from ..errors import UrdfError


def loaded(given: Any) -> tuple[bytes | None, Any, list[str]]:
    """Convert a loaded model to URDF text.

    Returns the text, a name in place of its file, and notes. Anything else is returned as it is,
    with None for the text.

    Raises
    ------
    UrdfError
        If the model has what a URDF has not.
    """
    notes: list[str] = []
    if _is(given, "yourdfpy", "URDF"):
        text = given.write_xml_string()
        return bytes(text), f"{given.robot.name}.urdf", notes
    if _is(given, "mujoco", "MjModel"):
        from .mjcf import urdf_of_model

        try:
            return urdf_of_model(given, notes), "mujoco_model.xml", notes
        except UrdfError as error:
            raise UrdfError(f"mujoco.MjModel: {error}") from error
    return None, given, notes


def _is(given: Any, module: str, name: str) -> bool:
    """Test whether an object is of a class of a module, which is not imported for it."""
    kind = getattr(sys.modules.get(module), name, None)
    return isinstance(kind, type) and isinstance(given, kind)
