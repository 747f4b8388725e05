"""Numbers of a task's collision bodies that body distances depend on, for their fingerprint."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...arguments import Array
from ...certificate import fingerprint
from ...model.catalogue import disabled_pairs
from ...model.model import fixed_placements, link_frames
from ...model.shapes import Shape, find_mesh
from ...model.task import Task
from ...model.urdf import Description


def shapes_fingerprint(task: Task) -> str:
    """Compute the fingerprint of all collision shapes of a robot and its surroundings.

    It covers their sizes and places on their links, the content of their mesh files, and the pairs
    of links that the SRDF disables.
    """
    robot = task.robot
    entry = robot.entry
    srdf = None if entry is None else entry.srdf
    pairs = [] if srdf is None else sorted(map(sorted, disabled_pairs(srdf)))
    parts = [
        [
            _solid(solid, description, robot.package_dirs)
            for solid in description.collisions
        ]
        for description in (robot.description, robot.surroundings)
        if description is not None
    ]
    return fingerprint(parts, pairs)


def bodies_at(task: Task, Q: ArrayLike) -> Array:
    """Compute one number per row of Q (K, n) that changes if any body is placed elsewhere: (K,).

    It is a sum of all entries of the placements of the links with bodies, each with its own factor.
    """
    robot = task.robot
    model, drive = task.bodies_model()
    data = model.createData()
    frames = link_frames(model)
    links = dict.fromkeys(solid.link for solid in robot.description.collisions)
    standing = []
    if robot.surroundings is not None:
        places = fixed_placements(robot.surroundings)
        standing = [places[solid.link] for solid in robot.surroundings.collisions]
    Q = np.asarray(Q, float)
    sums = []
    for q in drive.joints(Q):
        pin.forwardKinematics(model, data, q)
        moved = [
            data.oMi[frames[link].parentJoint] * frames[link].placement
            for link in links
        ]
        numbers = np.array(
            [place.homogeneous[:3] for place in moved + standing]
        ).ravel()
        sums.append(float(numbers @ np.sin(1.0 + np.arange(len(numbers)))))
    return np.array(sums)


def _solid(
    solid: Shape, description: Description, package_dirs: tuple[str, ...]
) -> tuple[object, ...]:
    """Return a shape as plain data, with the content of its mesh file."""
    mesh = None
    if solid.filename:
        file = find_mesh(solid.filename, description.path, package_dirs)
        mesh = "missing" if file is None else _content(file, file.stat().st_mtime_ns)
    shape = solid.kind, solid.size, solid.scale, mesh
    return solid.link, solid.xyz, solid.rpy, *shape


@lru_cache(maxsize=256)
def _content(file: Path, changed: int) -> str:
    """Hash the content of a file; ``changed`` is its modification time, which renews the cache."""
    return hashlib.sha256(file.read_bytes()).hexdigest()
