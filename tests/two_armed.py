"""A flat robot of a turning waist and two arms of three joints: both hands share the waist."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from controls import control

import repctl_pin as rp

_LINK = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/>
<origin xyz="{xyz}"/><axis xyz="0 0 1"/>
<limit lower="-2.8" upper="2.8" velocity="2" effort="1"/></joint>
<link name="{name}"><collision><origin xyz="0.2 0 0" rpy="0 1.5708 0"/>
<geometry><cylinder radius="0.03" length="0.36"/></geometry></collision></link>"""
_HAND = """<joint name="to_{name}" type="fixed"><parent link="{parent}"/><child link="{name}"/>
<origin xyz="0.4 0 0"/></joint><link name="{name}"/>"""

Q0 = np.array([0.1, 0.9, -0.8, -0.5, -0.7, 0.6, 0.7])
"""Both hands before the robot, 0.6 m apart."""


def two_armed(folder: Path, *frames: str | tuple[str, ...]) -> rp.RepeatableInverse:
    """Write the robot, and make an inverse of some of its frames: "left", "right", …"""
    parts = [_LINK.format(name="waist", parent="base", xyz="0 0 0")]
    for side, y in (("left", 0.2), ("right", -0.2)):
        places = [("waist", f"0 {y} 0"), *((f"{side}_{k}", "0.4 0 0") for k in (1, 2))]
        parts += [
            _LINK.format(name=f"{side}_{k}", parent=parent, xyz=xyz)
            for k, (parent, xyz) in enumerate(places, 1)
        ]
        parts.append(_HAND.format(name=side, parent=f"{side}_3"))
    path = folder / "two_armed.urdf"
    path.write_text(f'<robot name="two"><link name="base"/>{"".join(parts)}</robot>')
    task = rp.Robot.load(path).task(list(frames or (("left", "xy"), ("right", "xy"))))
    return control(task, Q0, rp.Polynomial(Q0, 2, 0.5))
