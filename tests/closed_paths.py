"""Random closed paths near a pose or a path, and their lifts on a leaf, without anything of the
proof."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin

import repctl_pin as rp


def wild_poses(
    kind: str,
    center: list[pin.SE3],
    metres: float,
    radians: float,
    corners: int,
    rng: np.random.Generator,
) -> list[pin.SE3]:
    """A closed polygon of poses within both distances of a pose, or of each of several in turn."""
    out = []
    for c in range(corners):
        about = center[c * len(center) // corners]
        d, a = rng.standard_normal((2, 3))
        d *= metres * rng.uniform(0.3, 1) ** 0.3 / np.linalg.norm(d)
        if len(kind) == 2:
            d[["xyz".index(x) for x in "xyz" if x not in kind]] = 0
        if kind == "axis":
            a[2] = 0
        if kind in ("pose", "axis"):
            a *= radians * rng.uniform(0, 1) ** 0.3 / np.linalg.norm(a)
        else:
            a[:] = 0
        out.append(pin.SE3(about.rotation @ pin.exp3(a), about.translation + d))
    return [*out, out[0]]


def between(a: pin.SE3, b: pin.SE3, steps: int) -> list[pin.SE3]:
    """Poses on the straight line from a to b, with rotation about one axis."""
    turn = pin.log3(a.rotation.T @ b.rotation)
    s = (np.arange(steps) + 1) / steps
    return [
        pin.SE3(
            a.rotation @ pin.exp3(t * turn), (1 - t) * a.translation + t * b.translation
        )
        for t in s
    ]


def lift(design: rp.Design, q: np.ndarray, poses: list[pin.SE3]) -> np.ndarray:
    """Follow poses on the leaf of q by Newton's method: the configurations, q first."""
    task, h = design.task, design.inverse.potentials
    c, out = h.value(q), [q]
    for pose in poses:
        for _ in range(12):
            e = np.concatenate([task.error(q, pose), c - h.value(q)])
            J_V = np.concatenate([task.jacobian(q), h.gradient(q).T])
            q = q + np.linalg.solve(J_V, e)
            if np.abs(e).max() < 1e-13:
                break
        out.append(q)
    return np.array(out)


def lifted_round(
    design: rp.Design,
    closes: Any,
    corners: int,
    rng: np.random.Generator,
    *,
    share: float = 0.999,
    step: float = 0.1,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Go from the start to a random closed polygon within the closing radius, and once round.

    Returns the configurations at its first corner before and after, and the largest share of Ω
    that was used.
    """
    center = [
        pin.SE3(R, p) for R, p in zip(closes.rotations, closes.positions, strict=True)
    ]
    metres, radians = share * closes.metres, share * (closes.radians or 0.0)
    corner = wild_poses(closes.kind, center, metres, radians, corners, rng)
    count = max(4, int(np.ceil(2 / step)))
    q = lift(design, closes.start, between(center[0], corner[0], count))
    before = q[-1]
    way = [p for a, b in pairwise(corner) for p in between(a, b, count)]
    Q = lift(design, before, way)
    return before, Q[-1], float(design.region.ratio(Q).max())
