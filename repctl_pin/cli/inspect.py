"""``repctl inspect``: joints, limits, frames and redundancy of a robot or a URDF.

The redundancy r = n − m is the number of joints that move a frame minus that of task coordinates.
The reference pose is the default configuration of a robot, from its SRDF or else mid-range.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import repctl_pin as rp

from ..show.text.coloured_text import fitted, noted
from .options import Parser
from .parsed_options import Options
from .print_result import print_result

HELP = "list what a robot or a URDF holds: joints, limits, frames and redundancy"
EXAMPLE = """examples:
  repctl inspect my_arm.urdf          the ends of its arms, with positions
  repctl inspect my_arm.urdf --all    every frame"""


def add_options(parser: Parser) -> None:
    """Add the options of ``repctl inspect`` to its parser; :func:`run` reads them."""
    parser.robot()
    parser.add_argument(
        "--all", action="store_true", help="list every frame that moves, not only the ends of arms"
    )
    parser.json()


def run(options: Options) -> int:
    """Load a robot, and print its joints, limits, frames and redundancy as text or JSON.

    Redundancy is given for each frame and kind of task: r = n − m, the number of joints that move
    the frame minus that of task coordinates. Returns the exit code 0.
    """
    from ..studies.task_choice import redundant_kinds

    robot = options.load_robot()
    frames = robot.movable_frames if options.all else robot.end_frames
    found = _inspection(robot, {frame: redundant_kinds(robot, frame) for frame in frames})
    return print_result(options, lambda: found, lambda: fitted(_text(found)))


def _inspection(robot: rp.Robot, redundancy: Mapping[str, Mapping[str, int]]) -> dict[str, Any]:
    """Collect the contents of a robot file in plain Python types, for JSON output and for the text.

    Parameters
    ----------
    robot
        The robot.
    redundancy
        Redundancy r = n − m by kind of task, for each frame to list.

    Returns
    -------
    dict
        ``robot`` and ``file`` (names), ``links`` (their number), ``joints`` (with limits),
        ``locked`` (with the reason), ``driven`` (joints that mimic another), ``default_frame``,
        ``frames`` (each with the joints that move it, its position at the reference pose, in the
        base frame, m, and its redundancy), ``frames_left_out`` (number of other movable frames),
        ``meshes`` (their number), ``collision`` (numbers of links, from :func:`_with_bodies`) and
        ``warnings``.
    """
    positions = robot.reference_positions()
    joints = {joint.name: joint for joint in robot.description.joints}
    return {
        "robot": robot.name,
        "file": str(robot.description.path),
        "links": len(robot.description.links),
        "joints": [
            {
                "name": name,
                "kind": joints[name].kind,
                "lower": float(robot.lower[i]),
                "upper": float(robot.upper[i]),
                "speed": float(robot.velocity_limit[i]),
                "reference": float(robot.reference[i]),
            }
            for i, name in enumerate(robot.joint_names)
        ],
        "locked": [
            {
                "name": name,
                "why": f"mimics {joints[name].mimic}" if joints[name].mimic else joints[name].kind,
            }
            for name in robot.locked
        ],
        "driven": [
            {"name": j.name, "by": j.mimic, "multiplier": j.multiplier, "offset": j.offset}
            for j in robot.joints.values()
            if j.mimic is not None and j.name not in robot.locked
        ],
        "default_frame": robot.default_frame,
        "frames": {
            frame: {
                "chain": list(robot.chain(frame)),
                "position": [round(float(x), 6) + 0.0 for x in positions[frame]],
                "redundancy": dict(kinds),
            }
            for frame, kinds in redundancy.items()
        },
        "frames_left_out": len(set(robot.movable_frames) - set(redundancy)),
        "meshes": len(robot.description.meshes),
        "collision": _with_bodies(robot),
        "warnings": [*robot.narrowed.values(), *robot.warnings],
    }


def _with_bodies(robot: rp.Robot) -> dict[str, int]:
    """Count the links whose collisions can be checked, and all links that have a shape.

    The keys are ``links_with_body`` and ``links``. Links that no joint separates count as one. A
    link has a body if one of its collision shapes is no mesh, or a mesh whose file exists; the file
    is not read. ``links`` counts the links with a visual or a collision shape, or all links of the
    robot if none has a shape.
    """
    from ..model.model import link_frames
    from ..model.packages import find_mesh

    description = robot.description
    joint = {name: frame.parentJoint for name, frame in link_frames(robot.model).items()}
    shaped = [shape.link for shape in (*description.shapes, *description.collisions)]
    found = {
        joint[shape.link]
        for shape in description.collisions
        if shape.kind != "mesh" or find_mesh(shape.filename, description.path, robot.package_dirs)
    }
    every = {joint[link] for link in shaped or description.links}
    return {"links_with_body": len(found), "links": len(every)}


def _text(found: Mapping[str, Any]) -> str:
    """Format the contents of a robot file for a terminal, as one text of several lines.

    ``found`` has the contents by key, as in ``--json``. The text is a table of joints, then locked
    and mimic joints, chains, frames, and notes.
    """
    from ..show.text.table import table

    rows = []
    for joint in found["joints"]:
        numbers = [joint[key] for key in ("lower", "upper", "speed", "reference")]
        rows.append([joint["name"], joint["kind"], *map(_number, numbers)])
    lines = [
        f"{found['robot']}: {len(rows)} movable joints, {found['links']} links, "
        f"{found['meshes']} meshes",
        f"from {found['file']}",
        "",
        table(["joint", "kind", "lower", "upper", "speed", "reference"], rows),
        "units: rad or m, rad/s or m/s; –: no limit in the model",
    ]
    with_body, of = (found["collision"][key] for key in ("links_with_body", "links"))
    counted = "links fixed to each other count as one"
    lines.append(f"collision: {with_body} of {of} links have a body ({counted})")
    locked = [f"{joint['name']} ({joint['why']})" for joint in found["locked"]]
    if locked:
        lines += ["", f"locked: {', '.join(locked)}"]
    driven = [f"{joint['name']} (follows {joint['by']})" for joint in found["driven"]]
    if driven:
        lines += ["", f"mimic joints: {', '.join(driven)}"]
    lines += _chains(found)
    lines += ["", *_frames(found)]
    lines += [noted(text) for text in found["warnings"]]
    return "\n".join(lines)


def _chains(found: Mapping[str, Any]) -> list[str]:
    """Format the joints of kinematic chains, and r by task kind: two lines per chain.

    A chain is shown if it moves a frame in ``found``, and has as many joints as the chain of the
    default frame. If it moves several frames, it is shown once, for the first of them. ``found``
    has the contents of the file by key, as in ``--json``.
    """
    frames = found["frames"]
    lines: list[str] = []
    listed: list[list[str]] = []
    most = len(frames[found["default_frame"]]["chain"])
    for name, frame in frames.items():
        chain = frame["chain"]
        if len(chain) != most or chain in listed:
            continue
        listed.append(chain)
        kinds = [f"{kind} r = {r}" for kind, r in frame["redundancy"].items()]
        lines += ["", f"frame {name}, moved by {len(chain)}: {', '.join(chain)}"]
        lines.append(f"  {', '.join(kinds) or 'no task at full rank'}")
    return lines


def _frames(found: Mapping[str, Any]) -> list[str]:
    """Format a table of the frames' positions in the base frame, m, and a legend: two texts.

    ``found`` has the contents of the file by key, as in ``--json``.
    """
    from ..show.text.table import table

    rows = []
    for name, frame in found["frames"].items():
        label = f"{name} (default)" if name == found["default_frame"] else name
        place = [f"{round(x, 4) + 0.0:.4f}" for x in frame["position"]]
        rows.append([label, str(len(frame["chain"])), *place])
    legend = "x, y, z in m from the base, at the reference pose; choose one with --frame"
    if found["frames_left_out"]:
        legend += f"; --all lists {found['frames_left_out']} more"
    return [table(["frame", "joints", "x", "y", "z"], rows), legend]


def _number(value: float) -> str:
    """Format a limit with four digits; no limit is a dash."""
    return f"{value:.4g}" if math.isfinite(value) else "–"
