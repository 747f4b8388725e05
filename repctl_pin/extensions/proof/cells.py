r"""Existence, uniqueness and margins of a cell's function F, proved over boxes of poses.

F is the inverse kinematic function of the cell. On a box ``u_c ± h`` of the cell's coordinates u,
Taylor models are computed of the chart's reference configuration q_ref(u) and null-space basis
n_ref(u) and of the pose x(u); coordinates that the task leaves free are those of f(q_ref(u)). From
these follow models, in the middle link's frame, of the joint screws J at q_ref(u) and of the
displacement ξ(u) from f(q_ref(u)) to x(u). Let A be an approximation of J_V⁻¹ at the centre, and D,
Y and g bounds on matrices and vectors, entry by entry.
Then, for all q with ``|q − q_ref(u)| ≤ g``,

.. math:: |A J_V(q, u) − 1| ≤ D, \qquad |A ξ| + D Y ≤ Y ≤ g ⇒ |F − q_{ref}| ≤ Y

docs/theory.md derives this.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...native import library
from ..cells.cell import Cell
from ..cells.chart import Chart
from ..cells.sector import Sector
from .cell_kernel import CellBounds, Kernel
from .cell_poses import Poses
from .chain import Chain, chain_of, frame_change, tool_reach
from .chart_bounds import Polynomials
from .commutator import commutator
from .leaf_margin_bounds import Expansion, enclosed, inverses, margins
from .potentials import U
from .remainder import relative_rounding, remainders
from .screws import screws, slopes
from .taylor import TaylorModel
from .taylor_chain import Closure, closure_of

_NEAR = 1.25, 0.02
"""Factor, and summand in rad or m, from which d* is made.

d* is the distance from q_ref within which F is proved to be unique: the factor times the largest
distance of F from q_ref that a search found, plus the summand.
"""


class CellProof:
    """Bounds over boxes of poses for the function F of one chart.

    Parameters
    ----------
    chart
        Chart of the function.
    compiled
        False to compute in NumPy even if there is the native library.
    """

    def __init__(self, chart: Chart, compiled: bool = True) -> None:
        cell = chart.cell
        self.chart, self.cell, self.task = chart, cell, cell.task
        self.polynomials, self.poses = Polynomials.of(chart), Poses.of(cell)
        self.lower, self.upper = limits_of(cell)
        self.near = _NEAR[0] * farthest(chart) + _NEAR[1]
        whole = chain_of(self.task)
        self.eps = relative_rounding(whole)
        value = self.polynomials.sizes
        self.blur = self.eps * (1 + chart.monomials.size / 64) * value  # (n, 1 + r)
        self.farthest = value[:, 0] + self.near
        made = [
            whole.seen_from(k, way)
            for k in range(1, len(whole.p))
            for way in (0.0, 0.5, 1.0)
        ]
        self.chain = min(made, key=self._size)
        self.tool = tool_reach(self.chain)
        native = library() if compiled else None
        self._kernel = None if native is None else Kernel(self, native)

    def _size(self, chain: Chain) -> float:
        """Compute the spectral radius of the bound D for uniqueness, on a box in the cell's middle.

        The smaller it is for a chain (a choice of the middle link), the fewer boxes are needed.
        """
        self.chain, self.tool = chain, tool_reach(chain)
        k = self.cell.k
        D = self._enclosure(np.zeros((1, k)), np.full((1, k), 0.1))[5][0]
        return (
            float(np.abs(np.linalg.eigvals(D)).max())
            if np.isfinite(D).all()
            else np.inf
        )

    def bounds(self, Uc: Array, half: Array) -> CellBounds:
        """Bound the margins of F over boxes Uc ± half, (K, k) each.

        The native library computes them, or without it NumPy.
        """
        return self.enclosed(Uc, half)[0]

    def enclosed(self, Uc: Array, half: Array) -> tuple[CellBounds, Array, Array]:
        """Bound the margins of F over boxes Uc ± half, (K, k) each, and enclose its values.

        Returns the bounds, and the centres and the half-widths of boxes of joints that contain F,
        (K, n) each; NaN where F was not enclosed.
        """
        if self._kernel is not None:
            return self._kernel.bounds(Uc, half)
        q, reach, good, at, cost, _ = self._enclosure(Uc, half)
        limit = np.minimum(q - reach - self.lower, self.upper - q - reach).min(axis=1)
        S = self.chain.S[~self.chain.revolute, : self.chain.n]
        slides = (
            np.abs(q @ S.T + self.chain.o[~self.chain.revolute]) + reach @ np.abs(S).T
        )
        beta = frame_change(self.task.kind, self.tool + slides.sum(axis=1))
        leaf = margins(at, np.ones_like(Uc), self.chain.n, self.eps, beta)
        good = good & (leaf.leaf_margin > 0)
        found = CellBounds(
            np.where(good, leaf.leaf_margin, 0.0),
            np.where(good, leaf.sigma_min, 0.0),
            np.where(good, limit, -np.inf),
            cost.argmax(axis=1).astype(np.int32),
        )
        return found, q, reach

    @np.errstate(all="ignore")
    def _enclosure(
        self, Uc: Array, half: Array
    ) -> tuple[Array, Array, NDArray[np.bool_], Expansion, Array, Array]:
        """Enclose F on boxes Uc ± half, (K, k) each.

        Returns the centres and the half-widths (K, n) of boxes of joints that contain F, whether
        that is proved (K,), the expansion of J_V along F, the motion of q_ref along each coordinate
        (K, k), and the bound D for uniqueness (K, N, N).
        """
        chain, n, N, K = self.chain, self.chain.n, self.chain.N, len(Uc)
        reference, normals = self._models(Uc, half)
        poses = self.poses.at(Uc, half)
        along = closure_of(chain, self.task.kind, poses, reference, self.eps)
        q_c, n_c = reference.P[..., 0], normals.P[..., 0]  # (K, n), (K, n, r)
        theta = q_c @ chain.S[:, :n].T + chain.o
        xi, tip = screws(chain, theta)
        J_V = np.zeros((K, N, N))
        J_V[:, :6], J_V[:, 6:, :n] = (
            np.einsum("Klx,lc->Kxc", xi, chain.S),
            np.swapaxes(n_c, 1, 2),
        )
        A = inverses(J_V)
        B = A[:, None, :, :6] @ np.swapaxes(
            slopes(chain, xi, tip), 2, 3
        )  # (K, j, N, N)
        first, rest = self._along_chart(A, along, normals)

        wide = reference.reach
        steps = along.xi.combined(A[..., :6]).most  # |A ξ|
        near = np.tile(self.near, (K, 1))
        R = rest + self._rest(A, B, theta, wide, near)
        D = np.abs(first).sum(axis=1) + R
        Y, held = self._distance(A, D, near, theta, wide, along, steps)
        held = held & (Y <= self.near).all(axis=1)
        norms = np.linalg.norm(A[..., :6].reshape(K, N, 2, 3), axis=3)
        separation = np.where(held[:, None], Y, near) + near
        turns = commutator(chain, separation, self.farthest)[:, chain.loose.astype(int)]
        unique = D + np.einsum("Kia,Kiac->Kic", norms, turns)
        regular = enclosed(unique, np.ones((K, N, 1)), self.eps)[2]

        R = rest + self._rest(A, B, theta, wide, Y)
        D = np.abs(first).sum(axis=1) + R
        again, closer = self._distance(A, D, Y, theta, wide, along, steps)
        Y = np.where(closer[:, None], np.minimum(again, Y), Y)
        good = held & regular
        at = self._orthonormal(A, R, first, normals)
        cost = np.abs(reference.P[..., 1 : 1 + Uc.shape[1]]).sum(axis=1)
        reach = np.where(
            good[:, None], (wide + Y) * (1 + self.eps) + 8 * U * np.abs(q_c), np.nan
        )
        return q_c, reach, good, at, cost, unique

    # ---- parts ---------------------------------------------------------------------------------

    def _models(self, Uc: Array, half: Array) -> tuple[TaylorModel, TaylorModel]:
        """Compute Taylor models of q_ref (K, n) and of n_ref (K, n, r) on boxes Uc ± half."""
        P, r = self.polynomials.shifted(Uc, half)
        both = TaylorModel(Uc.shape[1], np.moveaxis(P, 1, -1), r + self.blur)
        return both[..., 0], both[..., 1:]

    def _along_chart(
        self, A: Array, along: Closure, normals: TaylorModel
    ) -> tuple[Array, Array]:
        """Expand ``A J_V − I`` at q_ref(u) in the variables of the boxes.

        Returns its slopes at the centre (K, k, N, N), and a bound on all other terms (K, N, N).
        """
        n, N, k = self.chain.n, self.chain.N, normals.k
        K, M = len(A), normals.P.shape[-1]
        P, r = np.zeros((K, N, N, M)), np.zeros((K, N, N))
        P[:, :6], r[:, :6] = along.J.P, along.J.r
        P[:, 6:, :n], r[:, 6:, :n] = (
            np.swapaxes(normals.P, 1, 2),
            np.swapaxes(normals.r, 1, 2),
        )
        AP = np.einsum("Kix,Kxcm->Kicm", A, P)
        rest = np.abs(AP[..., 0] - np.eye(N)) + np.abs(AP[..., 1 + k :]).sum(axis=-1)
        rest += np.abs(A) @ (r + self.eps * np.abs(P).sum(axis=-1))
        return np.moveaxis(AP[..., 1 : 1 + k], -1, 1), rest

    def _rest(self, A: Array, B: Array, theta: Array, wide: Array, g: Array) -> Array:
        """Bound ``|A (J(q) − J(q_ref))|``, (K, N, N), for ``|q − q_ref| ≤ g``,
        ``|q_ref − q_c| ≤ wide``.

        B are the derivatives ``A ∂_j J`` at the centre q_c, whose joint positions are theta.
        """
        chain, n = self.chain, self.chain.n
        S = np.abs(chain.S[:, :n]).T
        both, one = (remainders(chain, theta, eta @ S) for eta in (wide + g, wide))
        linear, angular = (
            (x - y * (1 - 1e-12)) @ np.abs(chain.S)
            for x, y in zip(both, one, strict=True)
        )
        R = np.einsum("Kjic,Kj->Kic", np.abs(B), g)
        R += np.linalg.norm(A[:, :, :3], axis=2)[:, :, None] * linear[:, None]
        R += np.linalg.norm(A[:, :, 3:6], axis=2)[:, :, None] * angular[:, None]
        eta = (wide + g) @ S
        size = 1 + 2 * eta.sum(axis=1)
        length = (
            1
            + chain.reach.max()
            + (np.abs(theta) + eta)[:, ~chain.revolute].sum(axis=1)
        )
        columns = np.abs(chain.S).sum(axis=0).max()
        rows = np.repeat(
            np.stack([columns * length * size, columns * size], axis=1), 3, axis=1
        )
        R += self.eps * np.einsum("Kia,Ka->Ki", np.abs(A[..., :6]), rows)[:, :, None]
        return np.asarray(R)

    def _distance(
        self,
        A: Array,
        D: Array,
        g: Array,
        theta: Array,
        wide: Array,
        along: Closure,
        steps: Array,
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Bound the distance ``|F − q_ref|`` (K, n), by lifting a path of poses to the joints.

        The path leads from f(q_ref) to x. The bound is valid if it is at most g, within which D and
        the path's twist were bounded. The second result (K,) is False where there is no bound.
        """
        linear, angular = self._turned(g, theta, wide, along.sizes)
        load = steps + np.linalg.norm(A[:, :, :3], axis=2) * linear[:, None]
        load += np.linalg.norm(A[:, :, 3:6], axis=2) * angular[:, None]
        Y, _, solved = enclosed(D, load[..., None] * (1 + self.eps) + 1e-15, self.eps)
        return Y[:, : self.chain.n, 0] * (1 + self.eps), solved & along.near

    def _turned(
        self, g: Array, theta: Array, wide: Array, sizes: Array
    ) -> tuple[Array, Array]:
        """Bound the difference between ξ and the twist of the path of poses from f(q_ref) to x.

        The twist is seen from the middle link at any q within g of q_ref. Returns bounds on the
        linear and the angular part, (K,) each.
        """
        chain = self.chain
        S = np.abs(chain.S[:, : chain.n]).T
        off, away = g @ S, (wide + g) @ S
        before = np.arange(chain.middle)
        turning = chain.revolute[before]
        slides = (np.abs(theta) + away)[:, before[~turning]].sum(axis=1)
        turned = off[:, before[turning]].sum(axis=1)
        speeds = np.where(turning, chain.reach[before] + slides[:, None], 1.0)
        moved = (off[:, before] * speeds).sum(axis=1)
        p, e, w = sizes
        more = np.where(
            w < 0.5, np.arcsin(np.minimum(w, 0.5)) / np.maximum(w, 1e-300), np.inf
        )
        more = np.maximum(more, 1.0) * (1 + 1e-12)
        angle = w * more
        angular = (more - 1) * w + turned * angle
        linear = (more - 1) * w * p + e * angle
        linear = linear + turned * (e + p * angle + e * angle) + moved * angle
        return linear, angular

    def _orthonormal(
        self, A: Array, R: Array, first: Array, normals: TaylorModel
    ) -> Expansion:
        """Expand J_V with ``n_ref M`` in place of n_ref.

        The constant matrix M (r, r) makes its columns orthonormal at the centre of each box.
        """
        k = normals.k
        n_c, dn = normals.P[..., 0], normals.P[..., 1 : 1 + k]
        rest = np.abs(normals.P[..., 1 + k :]).sum(axis=-1) + normals.r  # (K, n, r)
        _, upper = np.linalg.qr(n_c)
        M = np.linalg.inv(upper)
        V = np.swapaxes(n_c @ M, 1, 2)
        dV = np.einsum("Knai,Kab->Kbni", dn, M)
        rest = np.swapaxes(np.abs(M), 1, 2) @ np.swapaxes(rest, 1, 2)
        turned = A.copy()
        turned[..., 6:] = A[..., 6:] @ np.swapaxes(upper, 1, 2)  # A diag(I, M^-T)
        return Expansion(turned, R + np.abs(first).sum(axis=1), R, first, V, dV, rest)


def farthest(chart: Chart) -> Array:
    """Search for the largest distance of F from q_ref over the cell, joint by joint: (n,).

    Random poses and corners are evaluated, then poses around the worst ones.
    """
    cell, r, rng = chart.cell, chart.cell.task.r, np.random.default_rng(1)

    def away(U: Array) -> Array:
        points = chart.solve(U, np.zeros((len(U), r)))
        return np.where(points.found[:, None], np.abs(points.Q - points.q_ref), 0.0)

    Y = np.concatenate([cell.sample(2048, 1), cell.corners()])
    found = away(Y)
    most, width = found.max(axis=0), 0.4
    for _ in range(5):
        worst = np.unique(np.argsort(-found, axis=0)[:4].ravel())
        near = Y[worst, None] + rng.uniform(-width, width, (len(worst), 24, cell.k))
        Y = np.concatenate([Y[worst], np.clip(near, -1, 1).reshape(-1, cell.k)])
        found, width = away(Y), width / 2
        most = np.maximum(most, found.max(axis=0))
    return np.asarray(most)


def limits_of(cell: Cell) -> tuple[Array, Array]:
    """Return the lower and upper joint limits for the F of a cell, (n,) each.

    They are narrowed by the motion of joints along the coordinates of a sector that its symmetries
    remove from u; −inf and inf for a joint whose limits bound such a coordinate.
    """
    lower, upper, _ = cell.task.joint_limits
    lower, upper = lower.copy(), upper.copy()
    if isinstance(cell, Sector):
        for one in cell.removed:
            free = one.coordinate in cell.free
            width = np.inf if free else float(cell.widths[one.coordinate])
            lower[one.joint] += -width if free else width
            upper[one.joint] += width if free else -width
    return lower, upper
