"""What a design was made for: robot, frame, joints, and a fingerprint of the kinematics."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import InputError
from ..robot.robot import Robot
from ..robot.task import Task

_CHECKS = 4
_TOLERANCE = 1e-9


def identity(task: Task) -> dict[str, Any]:
    """Describe a task: names, and where its frame lies at a few configurations.

    Placements are the fingerprint: they depend on every link and joint axis of the chain and on the joints that
    are held, and, compared to 1e-9, on no machine's rounding.
    """
    robot = task.robot
    configurations = [task.reference, *(task.reference + 0.7 * np.sin(np.arange(1, task.n + 1) * (k + 1.3))
                                        for k in range(_CHECKS - 1))]  # fmt: skip
    return {
        "robot": robot.name,
        "catalogue": robot.entry is not None,
        "file": robot.description.path.name,
        "base": robot.base,
        "lock": list(robot.locked),
        "frame": task.frame,
        "kind": task.kind,
        "joints": list(task.robot_joints),
        "coordinates": None if task.coordinates is None else task.coordinates.T.tolist(),
        "fingerprint": [
            {"q": q.tolist(), "placement": np.round(task.placement(q).homogeneous[:3], 12).tolist()}
            for q in configurations
        ],
    }


def task_of(data: dict[str, Any], where: str) -> Task:
    """Make the task that a design was made for, from the catalogue.

    Raises
    ------
    InputError
        If its robot is not from the catalogue.
    """
    if not data["catalogue"]:
        raise InputError(
            f"{where} is for {data['robot']} ({data['file']}), which is not in the catalogue; load it with the task: "
            f"rp.load({where!r}, Robot.load({data['file']!r}).task({data['frame']!r}, {data['kind']!r}))"
        )
    robot = Robot.load(data["robot"], lock=data["lock"], base=data["base"])
    task = robot.task(data["frame"], data["kind"], joints=data["joints"])
    return task if data["coordinates"] is None else task.in_coordinates(data["coordinates"])


def compare(data: dict[str, Any], task: Task, where: str) -> None:
    """Refuse a task that is not the one a design was made for.

    Raises
    ------
    InputError
        Naming the first difference.
    """
    mine = identity(task)
    names = {"robot": "robot", "base": "base", "frame": "frame", "kind": "task kind"}
    for key, name in names.items():
        if data[key] != mine[key]:
            raise InputError(f"{where} is for the {name} {data[key]!r}, not {mine[key]!r}; give that {name}")
    if data["joints"] != mine["joints"]:
        raise InputError(
            f"{where} is for the joints {', '.join(data['joints'])}, in this order, not {', '.join(mine['joints'])}"
        )
    T, own = data["coordinates"], mine["coordinates"]
    if (T is None) != (own is None) or (T is not None and not np.array_equal(np.array(T), np.array(own))):
        raise InputError(f"{where} is for other joint coordinates; its T of q = T ψ is {T}")
    for check in data["fingerprint"]:
        q, expected = np.array(check["q"], float), np.array(check["placement"], float)
        if q.shape != (task.n,) or expected.shape != (3, 4):
            raise InputError(f"{where} has a damaged fingerprint; design again")
        away = task.placement(q).homogeneous[:3] - expected
        if not np.abs(away).max() < _TOLERANCE:
            raise InputError(
                f"{where} is for another {data['robot']}: at its check configurations the frame {data['frame']!r} lies "
                f"{np.abs(away[:, 3]).max():.3g} m and {np.abs(away[:, :3]).max():.3g} rad elsewhere; "
                "the URDF or the held joints have changed, so design again"
            )
