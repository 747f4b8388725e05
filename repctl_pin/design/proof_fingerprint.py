"""Fingerprint of a proved design, and the data of its task that the fingerprint covers.

A certificate (a proof of bounds over the region) holds for one design only. The fingerprint, a hash
of all numbers on which the proof depends, shows whether a design or a robot has changed since.

``PotentialBasis`` is a basis of N functions of q, whose combinations are the potentials h of a
design. ``Region`` is a part Ω of joint space, such as a box.
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
    """Return four configurations (4, n), at which a robot is compared with a saved one.

    A saved file holds numbers, such as placements of the frame, at these configurations; a changed
    robot gives other numbers. The first configuration is the task's reference. The others differ
    from it by fixed offsets of at most 0.7 rad or m per joint.
    """
    joints = np.arange(1, task.n + 1)
    away = [0.7 * np.sin(joints * (k + 1.3)) for k in range(_CHECKS - 1)]
    return np.array([task.reference, *(task.reference + d for d in away)])


def points_at(task: Task, frames: Sequence[str], Q: ArrayLike) -> Array:
    """Compute the origins of frames of the task's chain at every row of Q: (K, F, 3), m.

    They are relative to the root of the model, ``task.model``. ``frames`` are F names. Fingerprints
    and saved files identify frames by these points, not by their names.
    """
    ids = [frame_id(task.model, name) for name in frames]
    return frame_placements(task.model, ids, task._matrix(Q))[:, :, :3, 3]


def task_parts(task: Task) -> tuple[Any, ...]:
    """Return kind, joint chain and position limits of a task, rounded, as nested tuples.

    The chain has all placements and axes from base to frame, with locked joints in place, and the
    linear map from q to its joints, which contains mimic ratios. For several frames, the result is
    one such tuple per frame. A fingerprint hashes these data, so that a changed robot is detected.
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
    """Round an array of numbers computed from a URDF to 9 decimals.

    They differ between computers by rounding errors; unrounded, one robot would have two
    fingerprints.
    """
    return np.round(np.asarray(values, float), _DIGITS)


def subject_of(task: Task, potentials: PotentialBasis, coefficients: Array, region: Region) -> str:
    """Compute the fingerprint of a repeatable inverse over a region.

    The fingerprint covers the joint chain with its limits, the potentials, their coefficients
    (N, r) and the region. It is empty for user-defined potentials and regions, of which nothing can
    be proved.
    """
    basis = _basis_parts(potentials)
    shape = _region_parts(region)
    if basis is None or shape is None:
        return ""
    return fingerprint("region", task_parts(task), basis, coefficients, shape)


def _region_parts(region: object) -> tuple[Any, ...] | None:
    """Return the kind and the numbers that define the shape of a region; None if user-defined.

    A fingerprint hashes them. The density of a region has no effect on a proof, and is left out.
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
    """Return the kind and the numbers that define a basis of potentials; None if user-defined.

    A fingerprint hashes them. User-defined functions cannot be compared.
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
    """Test whether an inverse has the given region, and potentials with the given coefficients.

    The potentials' gradients are compared at one configuration of the region; if they are not
    defined there, the test passes. A design of which only a part was changed would show figures of
    another design.
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
