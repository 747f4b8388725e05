"""Fingerprint of a proved design, and the data of its task that the fingerprint covers.

A certificate (a proof of bounds over the region) holds for one design only. The fingerprint, a hash
of all numbers on which the proof depends, shows whether a design or a robot has changed since.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array
from ..base.certificate import fingerprint
from ..base.errors import SingularityError
from ..model.joint_chain import joint_chain
from ..model.model import frame_id, frame_placements
from ..model.several_frames import SeveralFrames
from ..model.task import Task
from ..potentials import Joined, Polynomial, PotentialBasis
from ..regions import Box, Region, Tube, WorkspaceBox
from ..strategies.repeatable import RepeatableInverse

_CHECKS = 4
_DIGITS = 9
"""Decimals of numbers that are computed from a URDF: fewer than rounding can change."""


def check_configurations(task: Task) -> Array:
    """Choose generic configurations (4, n), at which a changed robot is detected.

    A saved file holds the placements of the frame at these configurations. The first one is the
    task's reference configuration.
    """
    joints = np.arange(1, task.n + 1)
    away = [0.7 * np.sin(joints * (k + 1.3)) for k in range(_CHECKS - 1)]
    return np.array([task.reference, *(task.reference + d for d in away)])


def points_at(task: Task, frames: Sequence[str], Q: ArrayLike) -> Array:
    """Compute the origins of frames of the task's chain at every row of Q: (K, F, 3), m.

    Fingerprints and saved files identify frames by these points, not by their names.
    """
    ids = [frame_id(task.model, name) for name in frames]
    return frame_placements(task.model, ids, task._matrix(Q))[:, :, :3, 3]


def task_parts(task: Task) -> tuple[Any, ...]:
    """Return kind, joint chain and position limits of a task as plain data.

    The chain has all placements and axes from base to frame, with locked joints in place, and the
    map from q to its joints: mimic ratios. For several frames, the result is one such tuple per
    frame. The fingerprint of a proof contains these data, so that the robot is recognised.
    """
    if isinstance(task, SeveralFrames):
        return tuple(task_parts(part) for part in task.parts)
    chain = joint_chain(task)
    numbers = (chain.R, chain.p, chain.axes, chain.S, chain.offset, task.lower, task.upper)
    return (
        str(task.kind),
        chain.revolute,
        # older certificates have the identity here
        np.eye(task.n),
        *(rounded(each) for each in numbers),
    )


def rounded(values: ArrayLike) -> Array:
    """Round numbers computed from a URDF to 9 decimals.

    Rounding errors differ between computers; without this the same robot would get two
    fingerprints.
    """
    return np.round(np.asarray(values, float), _DIGITS)


def subject_of(task: Task, potentials: PotentialBasis, coefficients: Array, region: Region) -> str:
    """Compute the fingerprint of a repeatable inverse over a region.

    The fingerprint covers the joint chain with its limits, the potentials, their coefficients and
    the region. It is empty for user-defined potentials and regions, of which nothing can be proved.
    """
    basis = _basis_parts(potentials)
    shape = _region_parts(region)
    if basis is None or shape is None:
        return ""
    return fingerprint("region", task_parts(task), basis, coefficients, shape)


def _region_parts(region: object) -> tuple[Any, ...] | None:
    """Return the shape of a region as plain data; None if its shape is not known.

    The data are what a fingerprint hashes: a tuple of the kind of region, and its numbers. A
    density has no effect on the shape, and so none on a proof.
    """
    if isinstance(region, Box):
        return "box", region.center, region.half_width
    if isinstance(region, Tube):
        return "tube", region.samples, region.radius
    if isinstance(region, WorkspaceBox):
        within = _region_parts(region.within)
        return "workspace", region.position, region.half_width, within
    return None


def _basis_parts(potentials: PotentialBasis) -> tuple[Any, ...] | None:
    """Return a basis of potentials as plain data; None if it has user-defined functions.

    The data are what a fingerprint hashes: a tuple of the kind of basis, and its numbers.
    User-defined functions cannot be compared, so that nothing is proved of them.
    """
    if isinstance(potentials, Polynomial):
        box = potentials.center, potentials.scale
        kind = potentials.degree, potentials.variables, potentials.cross
        return "polynomial", *box, *kind
    if isinstance(potentials, Joined):
        parts = [_basis_parts(part) for part in potentials.parts]
        return None if None in parts else ("joined", *parts)
    # a study has no need of these two
    from ..potentials.arm_angle import ArmAngle
    from ..potentials.fourier import Fourier

    if isinstance(potentials, Fourier):
        kind = potentials.order, potentials.variables, potentials.cross
        return "fourier", potentials.n, potentials.period, *kind
    if isinstance(potentials, ArmAngle):
        task = potentials.task
        directions = (potentials.reference, potentials.singular)
        points = points_at(task, potentials.frames, check_configurations(task))
        return "arm angle", rounded(points), *directions
    return None


def belong_together(
    inverse: RepeatableInverse, potentials: PotentialBasis, coefficients: Array, region: Region
) -> bool:
    """Test whether an inverse, the potentials, the coefficients and the region belong together.

    The gradients of the potentials are compared at one configuration of the region. If they are not
    defined there, the test passes. A partly changed result would show the figures of another
    design.
    """
    if inverse.region is not region:
        shapes = _region_parts(inverse.region), _region_parts(region)
        if None in shapes or fingerprint(shapes[0]) != fingerprint(shapes[1]):
            return False
    A = np.asarray(coefficients, float)
    if A.shape != (potentials.size, inverse.task.r):
        return False
    half = region.bounds.half_width
    q = region.clip((region.center + 0.3 * half * np.sin(1 + np.arange(len(half))))[None])
    try:
        V = inverse.potentials.gradients(q)
    except SingularityError:
        return True
    return np.allclose(V, potentials.gradients(q) @ A, rtol=0, atol=1e-6 * np.abs(V).max())
