"""Conversion of a design to another tool on the same body, with the same potentials and leaves.

The Jacobian of the new tool is ``J' = A J`` with an invertible A, so the null space N, the leaf
margin ``σ_min(Nᵀ V̂)`` and the joint paths of closed motions stay the same, and ``G_r' = G_r A⁻¹``.
See :mod:`repctl_pin.model.tool`. A leaf is the set h(q) = c on which the potentials h are constant;
the leaf margin is the distance from a configuration at which G_r fails. A certificate is a proof of
bounds over the region of the design.

``Inverse`` is a matrix function G(q) (n, m) with J G = I, evaluated at q (n,) or Q (K, n).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from ..base.arguments import Array
from ..base.certificate import ClosingRadius, Proof
from ..base.errors import InputError
from ..model.task import Task
from ..model.tool import placement_between, require_pose
from ..regions import WorkspaceBox
from ..strategies import Pseudoinverse, RepeatableInverse, WeightedInverse
from ..strategies.custom import CustomInverse
from ..strategies.strategy import Inverse
from .evaluation import evaluate_design
from .proof_fingerprint import subject_of

_SAME_ANGLE = 1e-7
"""Maximum rotation error, rad, of a pose of constant orientation; see :class:`ClosingRadius`."""

_BELOW = 1 - 1e-12
"""Factor that keeps a lower bound below its value where the conversion rounds."""


def for_task(design: Any, task: Task) -> Any:
    """Convert a :class:`Design` to ``task``, the task of another frame on the same body.

    So a changed gripper needs no new fit. Cost and margins are evaluated again on the design's
    held-out nodes; the figures of the fit are kept, and the cycle is dropped.

    Raises
    ------
    InputError
        If the frame is on another body, the task is not a pose task, or Ω is a
        :class:`WorkspaceBox`, which bounds positions of the original frame.
    """
    require_pose(design.task)
    tool = placement_between(design.task, task)
    region = design.region
    if isinstance(region, WorkspaceBox):
        raise InputError(
            "a design over a workspace box cannot be converted to another tool, because the box "
            "bounds positions of the original frame",
            remedy="design again with the new tool's frame",
        )
    inverse = RepeatableInverse(task, design.inverse.potentials, region=region)
    desired = _desired(design.desired, task)
    evaluation = evaluate_design(
        inverse, desired, region, samples=design.held_out, seed=design.seed + 1
    )
    subject = subject_of(task, design.potentials, design.coefficients, region)
    proof = None if design.proof is None else _proof(design.proof, tool)
    return replace(
        design,
        inverse=inverse,
        desired=desired,
        cycle=None,
        proof=None if proof is None else proof.sealed(subject),
        **vars(evaluation),
    )


def _desired(desired: Inverse, task: Task) -> Inverse:
    """Convert a desired inverse: ``G_d' = G_d A⁻¹``, where ``J' = A J`` is the tool's Jacobian.

    A depends on the tool's offset. For J⁺ and a weighted inverse, the result is the same kind of
    inverse, made for the new task; other inverses are multiplied by A⁻¹ at each configuration.
    """
    if isinstance(desired, Pseudoinverse):
        return Pseudoinverse(task)
    if isinstance(desired, WeightedInverse):
        return WeightedInverse(task, desired.weight)
    here, there = desired.task.placement, task.placement

    def moved(q: Array) -> Array:
        A_inverse = np.eye(6)
        A_inverse[:3, 3:] = pin.skew(there(q).translation - here(q).translation)
        return desired(q) @ A_inverse

    return CustomInverse(task, moved)


def _proof(proof: Proof, tool: pin.SE3) -> Proof:
    """Convert a certificate to a tool with an offset t, m, from the frame that was proved.

    The leaf margin and the limit margin do not depend on the tool. The bound on σ_min(J) is divided
    by ``‖A⁻¹‖₂ = (|t| + √(|t|² + 4)) / 2``, since ``σ_min(A J) ≥ σ_min(J) / ‖A⁻¹‖₂``.
    """
    length = float(np.linalg.norm(tool.translation))
    norm = (length + np.sqrt(length**2 + 4)) / 2
    sigma = proof.sigma_min / norm * _BELOW if length else proof.sigma_min
    closes = proof.closes and _closes(proof.closes, tool)
    what = f"{proof.what}, converted to another tool"
    return replace(proof, what=what, sigma_min=sigma, closes=closes, seal="")


def _closes(closes: ClosingRadius, tool: pin.SE3) -> ClosingRadius:
    """Convert the closing radius of a frame to that of the tool, under the same proof.

    The radius of the frame is ρ metres and α radians; that of the tool is λρ and λα, with
    ``λ = ρ / (ρ + α|t|)``. The tool has the offset t, m, from the frame, so the frame's position is
    ``p = p' − R t``, with p' the tool's position and R the rotation of both. Let p₀ be the frame's
    position at the start or on the path. If the tool is within its radius, the frame is within its
    own, because ``|p − p₀| ≤ λρ + 2 sin(λα/2) |t| ≤ λ (ρ + α|t|) = ρ``.
    """
    length = float(np.linalg.norm(tool.translation))
    angle = (closes.radians or 0.0) + _SAME_ANGLE
    factor = closes.metres / (closes.metres + angle * length) * _BELOW if closes else 1.0
    poses = zip(closes.positions, closes.rotations, strict=True)
    tools = [pin.SE3(R, p) * tool for p, R in poses]
    return replace(
        closes,
        metres=factor * closes.metres,
        radians=None if closes.radians is None else factor * closes.radians,
        positions=np.array([one.translation for one in tools]),
        rotations=np.array([one.rotation for one in tools]),
    )
