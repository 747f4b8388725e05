"""An arm of which some joints mimic others."""

from __future__ import annotations

from pathlib import Path

import numpy as np

JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>
<limit lower="{lower}" upper="{upper}" effort="1" velocity="{speed}"/>
{mimic}</joint><link name="{child}"><inertial><origin xyz="0.1 0.02 0.03"/><mass value="1.5"/>
<inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.03" iyz="0" izz="0.01"/></inertial></link>"""


def arm(folder: Path, mimics: dict[int, str], n: int = 7, **joints: dict[str, object]) -> Path:
    """Write an arm of n joints, the fourth one prismatic, some of which mimic others."""
    rng, lines, parent = (np.random.default_rng(5), ['<robot name="arm"><link name="l0"/>'], "l0")
    for i in range(1, n + 1):
        xyz, rpy, axis = (
            " ".join(f"{v:.4f}" for v in s * rng.uniform(-1, 1, 3)) for s in (0.4, 1.0, 1.0)
        )
        values = {
            "kind": "prismatic" if i == 4 else "revolute",
            "lower": -2,
            "upper": 2,
            "speed": 1,
        }
        values |= joints.get(f"j{i}", {})
        mimic = f"<mimic {mimics[i]}/>" if i in mimics else ""
        lines.append(
            JOINT.format(
                name=f"j{i}",
                parent=parent,
                child=f"l{i}",
                xyz=xyz,
                rpy=rpy,
                axis=axis,
                mimic=mimic,
                **values,
            )
        )
        parent = f"l{i}"
    path = folder / "arm.urdf"
    path.write_text("\n".join([*lines, "</robot>"]))
    return path


MIMICS = {
    3: 'joint="j2" multiplier="-0.5" offset="0.3"',
    4: 'joint="j1" multiplier="0.2"',
    6: 'joint="j5"',
}
