"""Random closed paths near a pose or a path, and their lifts on a leaf, without anything of the
proof."""

from __future__ import annotations

from typing import Any

import numpy as np

import repctl_pin as rp

_NEWTON = 12
_EXACT = 1e-13


def turns(vectors: np.ndarray) -> np.ndarray:
    """Rotations about vectors (…, 3) by their lengths: (…, 3, 3)."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vectors, -1, 0)
    o = np.zeros_like(x)
    hat = np.stack([o, -z, y, z, o, -x, -y, x, o], axis=-1).reshape(*x.shape, 3, 3)
    return (
        np.eye(3) + np.sinc(angle / np.pi) * hat + np.sinc(angle / (2 * np.pi)) ** 2 / 2 * hat @ hat
    )


def turned_by(R: np.ndarray) -> np.ndarray:
    """Rotation vectors (…, 3) of rotations by less than π."""
    axis = np.stack([R[..., i, j] - R[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0))], -1)
    sine = np.linalg.norm(axis, axis=-1) / 2
    angle = np.arctan2(sine, (np.trace(R, axis1=-2, axis2=-1) - 1) / 2)
    return axis / 2 * (angle / np.where(sine > 0, sine, 1.0))[..., None]


def wild_poses(
    closes: Any, share: float, corners: int, paths: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Closed polygons of poses within a share of a closing radius: positions (C + 1, P, 3), and
    rotations (C + 1, P, 3, 3); the corners follow the path, if there is one."""
    kind, angle = closes.kind, share * (closes.radians or 0.0)
    about = np.arange(corners) * len(closes.positions) // corners
    d, a = rng.standard_normal((2, corners, paths, 3))
    if len(kind) == 2:
        d[..., ["xyz".index(x) for x in "xyz" if x not in kind]] = 0
    if kind == "axis":
        a[..., 2] = 0
    near, turned = rng.uniform(0, 1, (2, corners, paths, 1)) ** 0.3
    d *= share * closes.metres * near / np.linalg.norm(d, axis=-1, keepdims=True)
    a *= angle * turned / np.linalg.norm(a, axis=-1, keepdims=True)
    p = closes.positions[about][:, None] + d
    R = closes.rotations[about][:, None] @ turns(a)
    return np.concatenate([p, p[:1]]), np.concatenate([R, R[:1]])


def lift(
    design: rp.Design, Q: np.ndarray, p: np.ndarray, R: np.ndarray, count: int
) -> tuple[np.ndarray, float]:
    """Follow straight lines from the poses of Q (P, n) through the given ones on their leaves.

    Each line has ``count`` steps of Newton's method. Returns the ends (P, n), and the largest share
    of Ω that was used.
    """
    task, h = design.task, design.inverse.potentials
    c = np.array([h.value(q) for q in Q])
    most, pose = 0.0, np.tile(np.eye(4), (len(Q), 1, 1))
    for a in range(len(p) - 1):
        turn = turned_by(np.swapaxes(R[a], 1, 2) @ R[a + 1])
        for s in (np.arange(count) + 1) / count:
            pose[:, :3, 3] = (1 - s) * p[a] + s * p[a + 1]
            pose[:, :3, :3] = R[a] @ turns(s * turn)
            for _ in range(_NEWTON):
                e = np.concatenate([task.errors(Q, pose), c - values(h, Q)], axis=1)
                V = np.swapaxes(h.gradients(Q), 1, 2)
                J_V = np.concatenate([task.jacobians(Q), V], axis=1)
                Q = Q + np.linalg.solve(J_V, e[:, :, None])[:, :, 0]
                if np.abs(e).max() < _EXACT:
                    break
            most = max(most, float(design.region.ratio(Q).max()))
    return Q, most


def values(h: Any, Q: np.ndarray) -> np.ndarray:
    return np.array([h.value(q) for q in Q])


def lifted_round(
    design: rp.Design,
    closes: Any,
    corners: int,
    rng: np.random.Generator,
    *,
    paths: int = 1,
    share: float = 0.999,
    step: float = 0.1,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Go from the start to random closed polygons within the closing radius, and once round.

    Returns the configurations at their first corners before and after, (P, n) each, and the largest
    share of Ω that was used.
    """
    p, R = wild_poses(closes, share, corners, paths, rng)
    count = max(4, int(np.ceil(2 / step)))
    ahead = [
        np.stack([np.broadcast_to(x[0], y[0].shape), y[0]])
        for x, y in ((closes.positions, p), (closes.rotations, R))
    ]
    before, first = lift(design, np.tile(closes.start, (paths, 1)), *ahead, count)
    after, most = lift(design, before, p, R, count)
    return before, after, max(first, most)
