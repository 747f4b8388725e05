"""Designs with given potentials, and independent evaluations of the leaf margin, for the tests of
proofs."""

from __future__ import annotations

from typing import Any

import numpy as np

import repctl_pin as rp
from repctl_pin import redundancy


def design_of(task: rp.Task, potentials: Any, region: object) -> rp.Design:
    """Make a design of given potentials; its figures are empty."""
    inverse = rp.RepeatableInverse(task, potentials, region=region)
    nothing = dict.fromkeys(
        (
            "cost",
            "cost_error",
            "relative_distance",
            "leaf_margin",
            "inside_limits",
            "fit_cost",
            "gradient_norm",
        ),
        0.0,
    )
    counts = dict.fromkeys(("steps", "samples", "held_out", "seed"), 0)
    basis = rp.CustomPotentials(
        [
            (lambda q, j=j: potentials.value(q)[j], lambda q, j=j: potentials.gradient(q)[:, j])
            for j in range(task.r)
        ]
    )
    return rp.Design(
        inverse,
        rp.Pseudoinverse(task),
        basis,
        region,
        np.eye(task.r),
        leaf_margin_at=task.reference,
        converged=True,
        **nothing,
        **counts,
    )


def margins(design: rp.Design, Q: np.ndarray) -> np.ndarray:
    """Evaluate the leaf margin at every row of Q (K, n), without anything of the proof."""
    N = np.array([redundancy.nullspace(design.task.jacobian(q)) for q in Q])
    return redundancy.leaf_margin(N, design.inverse.potentials.gradients(Q))


def smallest_singular_values(task: rp.Task, Q: np.ndarray) -> np.ndarray:
    """Evaluate σ_min of J at every row of Q (K, n)."""
    return np.linalg.svd(task.jacobians(Q), compute_uv=False)[:, -1]


def regular_start(task: rp.Task, seed: int = 0) -> np.ndarray:
    """The configuration of some random ones at which J is farthest from losing rank."""
    rng = np.random.default_rng(seed)
    Q = task.reference + rng.uniform(-0.7, 0.7, (64, task.n))
    return np.asarray(Q[np.argmax(smallest_singular_values(task, Q))])


def near_null_space(
    task: rp.Task, q: np.ndarray, width: float, seed: int, *, rough: float = 1.0, degree: int = 2
) -> rp.Polynomial:
    """Random potentials, by default quadratic, whose gradients at q span the null space of J,
    near to regular around it."""
    rng = np.random.default_rng(seed)
    potentials = rp.Polynomial(q, degree, width)
    A = rough * 0.2 * width * rng.standard_normal((potentials.size, task.r))
    D = potentials.gradients(q[None])[0]  # (n, N)
    A += np.linalg.lstsq(D, redundancy.nullspace(task.jacobian(q)) - D @ A, rcond=None)[0]
    return potentials.weighted(A)
