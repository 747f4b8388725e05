"""A pose of the whole robot out of values for some of its joints."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..urdf.gate import Joint

ONE_NUMBER = ("revolute", "continuous", "prismatic")
"""Kinds of joint whose position is one number."""


def pose(
    model: pin.Model, joints: Mapping[str, Joint], named: Mapping[str, float], notes: list[str]
) -> NDArray[np.float64]:
    """Make a pose of every joint, inside its limits: the named values, else mid-range; mimics follow.

    Parameters
    ----------
    model
        Of the whole robot, no joint locked.
    joints
        The joints of its file.
    named
        Values by joint name, rad or m.
    notes
        Gets a line for every value that had to be moved inside the limits.

    Returns
    -------
    (nq,) array
    """
    posture = pin.neutral(model)
    for name in tuple(model.names)[1:]:
        joint, q = joints[name], model.joints[model.getJointId(name)].idx_q
        if joint.kind not in ONE_NUMBER:
            continue
        if name in named:
            value = _inside(named[name], joint)
            if abs(value - named[name]) > 1e-3:
                notes.append(f"reference pose: {name} = {named[name]:g} is outside its limits, {value:g} used")
        elif np.isfinite(joint.lower) and np.isfinite(joint.upper):
            value = (joint.lower + joint.upper) / 2
        else:
            value = float(np.clip(0.0, joint.lower, joint.upper))
        posture[q] = value
    for name in tuple(model.names)[1:]:
        joint = joints[name]
        if joint.mimic is not None and model.existJointName(joint.mimic):
            q, leader = (model.joints[model.getJointId(j)].idx_q for j in (name, joint.mimic))
            posture[q] = np.clip(joint.multiplier * posture[leader] + joint.offset, joint.lower, joint.upper)
    return posture


def _inside(value: float, joint: Joint) -> float:
    """Move a joint value inside its limits: by a full turn if that does it, else to the nearer limit."""
    turns = (0.0, 2 * np.pi, -2 * np.pi) if joint.kind != "prismatic" else (0.0,)
    inside = [value + turn for turn in turns if joint.lower <= value + turn <= joint.upper]
    return float(inside[0] if inside else np.clip(value, joint.lower, joint.upper))
