"""What a robot file holds, as data and as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from .table import table

if TYPE_CHECKING:
    from ..robot.robot import Robot


def inspection(robot: Robot, redundancy: Mapping[str, Mapping[str, int]]) -> dict[str, Any]:
    """Collect what a file holds in plain Python types.

    Parameters
    ----------
    robot
        The robot.
    redundancy
        For each frame worth offering, r by task kind.
    """
    joints = {joint.name: joint for joint in robot.description.joints}
    return {
        "robot": robot.name,
        "file": str(robot.description.path),
        "links": len(robot.description.links),
        "joints": [
            {
                "name": name,
                "kind": joints[name].kind,
                "lower": _finite(robot.lower[i]),
                "upper": _finite(robot.upper[i]),
                "speed": _finite(robot.velocity[i]),
                "reference": float(robot.reference[i]),
            }
            for i, name in enumerate(robot.joint_names)
        ],
        "locked": [
            {"name": name, "why": f"mimics {joints[name].mimic}" if joints[name].mimic else joints[name].kind}
            for name in robot.locked
        ],
        "frames": {
            frame: {"chain": list(robot.chain(frame)), "redundancy": dict(kinds)} for frame, kinds in redundancy.items()
        },
        "meshes": len(robot.description.meshes),
        "warnings": [*robot.description.notes, *robot.warnings],
    }


def inspection_text(found: Mapping[str, Any]) -> str:
    """Write an inspection for a terminal."""
    rows = [
        [
            j["name"],
            j["kind"],
            _number(j["lower"]),
            _number(j["upper"]),
            _number(j["speed"]),
            f"{j['reference']:.4g}",
        ]
        for j in found["joints"]
    ]
    lines = [
        f"{found['robot']}: {len(rows)} movable joints, {found['links']} links, {found['meshes']} meshes",
        f"from {found['file']}",
        "",
        table(["joint", "kind", "lower", "upper", "speed", "reference"], rows),
        "rad or m, and per second; – where the file sets no limit",
    ]
    if found["locked"]:
        lines += ["", "locked: " + ", ".join(f"{j['name']} ({j['why']})" for j in found["locked"])]
    for frame, chain in found["frames"].items():
        kinds = ", ".join(f"{kind} r = {r}" for kind, r in chain["redundancy"].items()) or "no task at full rank"
        lines += [
            "",
            f"frame {frame}, moved by {len(chain['chain'])}: {', '.join(chain['chain'])}",
            f"  {kinds}",
        ]
    lines += [f"note: {text}" for text in found["warnings"]]
    return "\n".join(lines)


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"
