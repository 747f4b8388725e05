r"""A cell's inverse kinematic function over boxes of poses: that it exists, is the only one, and
its margins.

On a box ``u_c ± h`` of the cell's coordinates, with ``z = F(u)``, along a ray ``u_c + t δ``:

.. math:: \begin{bmatrix} J(q) \\ n_{ref}(u)^T \end{bmatrix} \dot q = r(q, u)\, δ, \qquad
          r = \begin{bmatrix} E \\ n_{ref}^T ∂q_{ref} - ∂n_{ref}^T (q - q_{ref}) \end{bmatrix}

in the middle link's frame, so E depends on the joints before it only, and on the tool's place seen
from it. See docs/theory.md for the enclosure of second order."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..errors import InputError
from ..inverse_function.chart import Chart
from ..inverse_function.rotations import left_jacobian
from ..inverse_function.sector import Sector
from .cell_bounds import CellBounds
from .cell_kernel import Kernel, library
from .chain import Chain, chain_of, tool_reach
from .chart_bounds import Polynomials
from .commutator import commutator
from .leaf_margin_bounds import Bounds, Expansion, enclosed, inverses, margins
from .potentials import U
from .remainder import relative_rounding, remainders
from .screws import between, screws, slopes, turn

_NEAR = 1.2, 0.03
"""d*: this times the largest distance of F from q_ref that was sampled, plus this, rad or m."""


def left_jacobian_slope(omega: Array, e: Array, d: Array) -> Array:
    """Differentiate ``J_l(ω) e`` of SO(3) along d, at every row of ω (K, 3): (K, 3).

    ``J_l(ω) = ∫ exp(s ω̂) ds`` over s from 0 to 1, so its first derivative is at most ½, its second
    at most ⅓."""
    square = (omega**2).sum(axis=1)
    theta = np.sqrt(square)
    small = theta < 0.05
    t = np.where(small, 1.0, theta)
    c, s = np.cos(t), np.sin(t)
    a = np.where(small, 0.5 - square / 24 + square**2 / 720, (1 - c) / t**2)
    b = np.where(small, 1 / 6 - square / 120 + square**2 / 5040, (t - s) / t**3)
    da = np.where(
        small, -1 / 12 + square / 180 - square**2 / 6720, (t * s - 2 * (1 - c)) / t**4
    )  # a' / θ
    db = np.where(
        small, -1 / 60 + square / 1260 - square**2 / 60480, ((1 - c) * t - 3 * (t - s)) / t**5
    )
    along = omega @ d
    one, two = np.cross(omega, e), np.cross(omega, np.cross(omega, e))
    return np.asarray(
        (da * along)[:, None] * one
        + a[:, None] * np.cross(d, e)
        + (db * along)[:, None] * two
        + b[:, None] * (np.cross(d, one) + np.cross(omega, np.cross(d, e))),
        float,
    )


class CellProof:
    """A function over a cell, to be enclosed over boxes of poses."""

    def __init__(self, chart: Chart, compiled: bool = True) -> None:
        cell = chart.cell
        if cell.task.kind != "pose":
            raise InputError(
                f"nothing can be proved of a cell of {cell.task.kind} tasks yet; use a pose task"
            )
        if isinstance(cell, Sector):
            raise InputError("nothing can be proved of a sector yet; use a cell, rp.Cell")
        self.chart, self.cell, self.task = chart, cell, cell.task
        self.polynomials = Polynomials.of(chart)
        self.on = np.flatnonzero(cell.widths > 0)
        self.places = len(cell.half_width)
        U_all = np.concatenate([cell.sample(1024, 1), cell.corners()])
        sample = chart.solve(U_all, np.zeros((len(U_all), self.task.r)))
        away = np.abs(sample.Q - sample.q_ref)[sample.found].max(axis=0, initial=0.0)
        self.near = _NEAR[0] * away + _NEAR[1]  # d*: F is the only solution within this of q_ref
        whole = chain_of(self.task)
        self.eps = relative_rounding(whole)
        # sizes of q_ref, n_ref and their slopes, all derivatives added, for the rounding
        value, slope = self.polynomials.sizes()
        n_size, beta_size = (
            value[:, 1:].max(axis=0),
            np.einsum("na,in->ia", value[:, 1:], slope[..., 0]),
        )
        self.sizes = n_size, beta_size, slope[..., 1:]
        self.blur = self.eps * (1 + chart.monomials.size / 64) * value[:, 0]
        self.farthest = value[:, 0] + self.near
        made = [whole.seen_from(k, way) for k in range(1, len(whole.p)) for way in (0.0, 0.5, 1.0)]
        self._set(min(made, key=self._size))
        kernel = library() if compiled else None
        self._kernel = None if kernel is None else Kernel(self, kernel)

    def __repr__(self) -> str:
        return f"<CellProof of {self.cell!r}>"

    def _set(self, chain: Chain) -> None:
        self.chain, self.tool = chain, tool_reach(chain)
        self.commutator = commutator(chain, self.near, self.farthest) * (1 + self.eps)

    def _size(self, chain: Chain) -> float:
        """Width of the enclosure of F in a small box in the middle."""
        self._set(chain)
        found = self._enclosure(np.zeros((1, self.cell.k)), np.full((1, self.cell.k), 0.02))
        size = float(found[1].sum())
        return size if np.isfinite(size) else np.inf

    def bounds(self, Uc: Array, half: Array) -> CellBounds:
        """Bound the margins of F over boxes Uc ± half, (K, k) each, in C where there is a
        compiler."""
        return self.enclosed(Uc, half)[0]

    def enclosed(self, Uc: Array, half: Array) -> tuple[CellBounds, Array, Array]:
        """Bound the margins of F over boxes, and give the centre and the half-widths of a box of
        joints that F stays in, (K, n) each; NaN where none was found."""
        if self._kernel is not None:
            return self._kernel.bounds(Uc, half)
        Q, reach, good, at, cost, there = self._enclosure(Uc, half)
        lower, upper, _ = self.task.joint_limits
        center = np.where(there, np.minimum(Q - lower, upper - Q).min(axis=1), -np.inf)
        limit = np.minimum(Q - reach - lower, upper - Q - reach).min(axis=1)
        S = self.chain.S[~self.chain.revolute, : self.chain.n]
        slides = np.abs(Q @ S.T + self.chain.o[~self.chain.revolute]) + reach @ np.abs(S).T
        t = self.tool + slides.sum(axis=1)
        leaf = margins(at, half, self.chain.n, self.eps, (t + np.sqrt(t * t + 4)) / 2)
        good = good & (leaf.leaf_margin > 0)
        split = np.where(there, cost.argmax(axis=1), 0).astype(np.int32)
        found = Bounds(
            np.where(good, leaf.leaf_margin, 0.0),
            np.where(there, leaf.center, 0.0),
            np.where(good, leaf.sigma_min, 0.0),
            split,
        )
        return CellBounds(found, np.where(good, limit, -np.inf), center, there), Q, reach

    @np.errstate(all="ignore")
    def _enclosure(
        self, Uc: Array, h: Array
    ) -> tuple[Array, Array, NDArray[np.bool_], Expansion, Array, NDArray[np.bool_]]:
        """Enclose F: centres and half-widths (K, n), where proved, J_V along it, the costs of the
        directions, and where centres are found."""
        chain, n, N, cell = self.chain, self.chain.n, self.chain.N, self.cell
        K, k, r = len(Uc), cell.k, self.task.r
        points = self.chart.solve(Uc, np.zeros((K, r)))
        Q = points.Q
        S = chain.S[:, :n]
        theta = Q @ S.T + chain.o
        xi, tip = screws(chain, theta)
        values, first, second = self.polynomials.at(Uc)
        q_ref, n_ref = values[:, :, 0], values[:, :, 1:]  # (K, n), (K, n, r)
        dq, dn = first[..., 0], first[..., 1:]  # (K, k, n), (K, k, n, r)
        J_V = np.zeros((K, N, N))
        J_V[:, :6], J_V[:, 6:, :n] = np.einsum("Klx,lc->Kxc", xi, chain.S), np.swapaxes(n_ref, 1, 2)
        A = inverses(J_V)
        # slopes of J_V in q and in u
        moved = np.swapaxes(slopes(chain, xi, tip), 2, 3)  # (K, n, 6, N)
        B = A[:, None, :, :6] @ moved  # (K, j, N, N)
        B_u = np.zeros((K, k, N, N))
        B_u[..., :n] = A[:, None, :, 6:] @ np.swapaxes(dn, 2, 3)
        # the right-hand side and its slopes
        E, E_q, E_u, turns = self._twists(Uc, Q, xi, tip)
        d = Q - q_ref
        beta = np.einsum("Kna,Kin->Kai", n_ref, dq) - np.einsum("Kina,Kn->Kai", dn, d)
        rhs = np.concatenate([E, beta], axis=1)  # (K, N, k)
        rhs_q = np.concatenate([E_q, -np.einsum("Kija->Kjai", dn)], axis=2)  # (K, j, N, k)
        ddq, ddn = second[..., 0], second[..., 1:]
        beta_u = (
            np.einsum("Kbna,Kin->Kbai", dn, dq)
            + np.einsum("Kna,Kibn->Kbai", n_ref, ddq)
            - np.einsum("Kibna,Kn->Kbai", ddn, d)
            + np.einsum("Kina,Kbn->Kbai", dn, dq)
        )
        C = A @ rhs  # (K, N, k): dF/du
        r_q, r_u = A[:, None] @ rhs_q, A[:, None] @ np.concatenate([E_u, beta_u], axis=2)
        P = r_q - B @ C[:, None]  # (K, j, N, k)
        curve = (
            np.einsum("Kjia,Kjb->Kbia", P, C[:, :n]) + r_u - B_u @ C[:, None]
        )  # F'': (K, b, N, a)
        curve = np.abs(curve + np.transpose(curve, (0, 3, 2, 1))) / 2
        half_F = np.einsum("Kbia,Ka,Kb->Ki", curve, h, h)
        along = np.einsum("Kjic,Kja->Kaic", B, C[:, :n]) + B_u  # slopes of J_V along F
        turned = np.einsum("Kaic,Ka->Kic", np.abs(along), h)

        # the prediction q_c + C δ, and how far q_ref is from it
        straight = np.einsum("Kia,Ka->Ki", np.abs(C), h)
        most = self.polynomials.most_in(Uc, values, first, second, h)
        bend = 0.5 * np.einsum(
            "Kibnx,Ki,Kb->Knx", most[2], h, h, optimize=True
        )  # beside the slopes of q_ref, n_ref
        n_rest = np.swapaxes(bend[..., 1:], 1, 2)
        lean = np.abs(d) + bend[..., 0] + self.blur
        lean = lean + np.einsum("Kia,Ka->Ki", np.abs(C[:, :n] - np.swapaxes(dq, 1, 2)), h)
        allowed, wide = self.near - lean, (self.near + lean) * (1 + self.eps)

        # F exists: beside the prediction its way stays below Φ/2 + Z, which fits into d*
        residual = 2 * (points.residual + 1e-11) * (1 + self.tool)
        p = np.einsum("Kjia,Ka->Kij", np.abs(P), h)  # (K, N, j)
        chained = np.einsum("lj,Kja->Kla", S, C[:, :n])
        loose = np.minimum(allowed, half_F[:, :n])
        held = points.found & (allowed > 0.5 * half_F[:, :n]).all(axis=1)
        away, fits = loose, np.zeros(K, bool)
        for _ in range(4):
            reach = straight[:, :n] + loose
            R, _ = self._rest(A, J_V, theta, reach, n_rest)
            D = R + turned + np.einsum("Kjic,Kj->Kic", np.abs(B), loose)
            rest = self._right_rest(A, theta, (reach, loose), h, chained, xi, tip, turns, most)
            load = np.einsum("Kia,Ka->Ki", rest, h) + (R @ straight[..., None])[..., 0]
            load += (D @ half_F[..., None])[..., 0] + 0.5 * (p @ half_F[:, :n, None])[..., 0]
            load += np.abs(A).sum(axis=2) * residual[:, None]
            whole = D.copy()
            whole[..., :n] += p
            Z, _, solved = enclosed(whole, load[..., None] + 1e-15, self.eps)
            held = held & (fits | solved)
            away = np.where(fits[:, None], away, 0.5 * half_F[:, :n] + Z[:, :n, 0])
            slack = away * (1 + self.eps)
            fits = fits | (held & (slack <= loose).all(axis=1))
            held = held & (slack <= allowed).all(axis=1)
            loose = np.where(fits[:, None], loose, np.minimum(allowed, 1.4 * slack))
            if not (held & ~fits).any():
                break
        held = held & fits
        reach = (straight[:, :n] + away) * (1 + self.eps) + 8 * U * np.abs(Q)

        # F is the only solution within d* of q_ref
        R, _ = self._rest(A, J_V, theta, straight[:, :n] + wide, n_rest)
        norms = np.linalg.norm(A[..., :6].reshape(K, N, 2, 3), axis=3)
        D = R + turned + np.einsum("Kjic,Kj->Kic", np.abs(B), wide) + norms @ self.commutator
        regular = enclosed(D, np.ones((K, N, 1)), self.eps)[2]

        # J_V along F, to first order in u
        R, round_ = self._rest(A, J_V, theta, reach, n_rest)
        R = R + np.einsum("Kjic,Kj->Kic", np.abs(B), away)
        at = self._orthonormal(A, R, along, n_ref, dn, n_rest, h, round_)
        cost = np.abs(C[:, :n]).sum(axis=1) * h
        good = held & regular
        reach = np.where(good[:, None], reach, np.nan)
        return Q, reach, good, at, cost, points.found

    # ---- parts ---------------------------------------------------------------------------------

    def _orthonormal(
        self,
        A: Array,
        R: Array,
        along: Array,
        n_ref: Array,
        dn: Array,
        n_rest: Array,
        h: Array,
        round_: Array,
    ) -> Expansion:
        """Take n_ref in a gauge M with orthonormal columns, which turns the last rows of J_V by
        Mᵀ."""
        _, upper = np.linalg.qr(n_ref)
        M = np.linalg.inv(upper)
        V = np.swapaxes(n_ref @ M, 1, 2)
        dV = np.einsum("Kina,Kab->Kbni", dn, M)
        rest = np.swapaxes(np.abs(M), 1, 2) @ (n_rest + round_)
        turned = A.copy()
        turned[..., 6:] = A[..., 6:] @ np.swapaxes(upper, 1, 2)  # A diag(I, M^-T)
        return Expansion(
            turned, R + np.einsum("Kaic,Ka->Kic", np.abs(along), h), R, along, V, dV, rest
        )

    def _rest(
        self, A: Array, J_V: Array, theta: Array, wide: Array, n_rest: Array
    ) -> tuple[Array, Array]:
        """Bound what A J_V has beside 1 and its slopes, (K, N, N), in boxes of joints; and the
        rounding of n_ref."""
        chain, n = self.chain, self.chain.n
        eta = wide @ np.abs(chain.S[:, :n]).T
        linear, angular = (rest @ np.abs(chain.S) for rest in remainders(chain, theta, eta))
        R = np.abs(A @ J_V - np.eye(chain.N))
        R += np.linalg.norm(A[:, :, :3], axis=2)[:, :, None] * linear[:, None]
        R += np.linalg.norm(A[:, :, 3:6], axis=2)[:, :, None] * angular[:, None]
        R[..., :n] += np.abs(A[..., 6:]) @ n_rest
        size = 1 + 2 * eta.sum(axis=1)
        length = 1 + chain.reach.max() + (np.abs(theta) + eta)[:, ~chain.revolute].sum(axis=1)
        columns = np.abs(chain.S).sum(axis=0).max()
        terms = self.chart.monomials.size
        rows = np.empty((len(A), chain.N))
        rows[:, :3], rows[:, 3:6] = (columns * length * size)[:, None], (columns * size)[:, None]
        rows[:, 6:] = self.sizes[0] * (1 + terms / 64)
        R += self.eps * np.einsum("Kia,Ka->Ki", np.abs(A), rows)[:, :, None]
        return R, self.eps * rows[:, 6:, None] * np.ones(n)

    def _twists(
        self, Uc: Array, Q: Array, xi: Array, tip: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Evaluate E (K, 6, k) in the middle link's frame, ∂E/∂q (K, n, 6, k), ∂E/∂u (K, k, 6, k),
        and θ (k,)."""
        cell, chain, n, K = self.cell, self.chain, self.chain.n, len(Uc)
        k, places = cell.k, self.places
        base = self._to_middle(Q)  # R_1ᵀ (K, 3, 3)
        push, spin = np.zeros((K, 3, k)), np.zeros((K, 3, k))
        Y = cell.spread(Uc)
        axes: dict[int, Array] = {}
        vectors = cell.vectors(Y[:, places:]) if cell.rotation.any() else None
        for i, which in enumerate(self.on):
            if which < places:
                push[:, self.task.rows[which], i] = cell.widths[which]
            else:
                assert vectors is not None, "the cell has rotations"
                unit = np.zeros((1, len(cell.widths) - places))
                unit[0, which - places] = cell.widths[which]
                axes[i] = cell.vectors(unit)[0]
                spin[:, :, i] = left_jacobian(vectors) @ axes[i]
        turns = np.where(self.on >= places, cell.widths[self.on], 0.0)
        bend = np.zeros((K, k, 3, k))
        for b, i in product(axes, repeat=2):
            assert vectors is not None, "the cell has rotations"
            bend[:, b, :, i] = left_jacobian_slope(vectors, axes[i], axes[b])
        bend = base[:, None] @ bend
        E_u = np.concatenate([np.cross(tip[:, None, :, None], bend, axis=2), bend], axis=2)
        push, spin = base @ push, base @ spin
        E = np.concatenate([push + np.cross(tip[:, :, None], spin, axis=1), spin], axis=1)
        E_q = np.zeros((K, n, 6, k))
        for joint in range(len(chain.p)):
            for j in np.flatnonzero(chain.S[joint, :n]):
                w, v, s = xi[:, joint, 3:, None], xi[:, joint, :3], chain.S[joint, j]
                if joint < chain.middle:  # the middle link turns against the base
                    spun = -np.cross(w, spin, axis=1)
                    pushed = -np.cross(w, push, axis=1) + np.cross(tip[:, :, None], spun, axis=1)
                else:  # the tool moves against the middle link
                    spun = np.zeros_like(spin)
                    moved = np.cross(xi[:, joint, 3:], tip) + v
                    pushed = np.cross(moved[:, :, None], spin, axis=1)
                E_q[:, j] += s * np.concatenate([pushed, spun], axis=1)
        return E, E_q, E_u, turns

    def _to_middle(self, Q: Array) -> Array:
        """Rotations (K, 3, 3) from the base's axes to the middle link's."""
        chain = self.chain
        theta = Q @ chain.S[:, : chain.n].T + chain.o
        R = np.tile(np.eye(3), (len(Q), 1, 1))
        for joint in range(chain.middle):
            R = R @ chain.R[joint]
            if chain.revolute[joint]:
                R = R @ turn(chain.a[joint], theta[:, joint])
        return np.swapaxes(R, 1, 2)

    def _twists_rest(
        self,
        theta: Array,
        joints: tuple[Array, Array],
        h: Array,
        chained: Array,
        xi: Array,
        tip: Array,
        turns: Array,
    ) -> tuple[Array, Array]:
        """Bound the linear and the angular part of what E has beside its value and slopes, (K, k)
        each."""
        chain, (wide, loose) = self.chain, joints
        S = np.abs(chain.S[:, : chain.n])
        eta, off = wide @ S.T, loose @ S.T
        before = np.arange(chain.middle)[chain.revolute[: chain.middle]]
        beyond = between(chain, len(chain.p) - 1)
        sliding = beyond[~chain.revolute[beyond]]
        H, H_R, H_P = (
            eta[:, some].sum(axis=1)[:, None]
            for some in (before, beyond[chain.revolute[beyond]], sliding)
        )
        L = (self.tool + (np.abs(theta) + eta)[:, sliding].sum(axis=1))[:, None]
        # to first order: the middle link's rotation, and the way of the tool seen from it
        spun = np.einsum("Klx,Kla->Kax", xi[:, before, 3:], chained[:, before])
        spun = np.einsum("Ka,Ka->K", np.linalg.norm(spun, axis=2), h) + off[:, before].sum(axis=1)
        last = slice(chain.middle, None)
        ways = np.cross(xi[:, last, 3:], tip[:, None]) + xi[:, last, :3]
        moved = np.linalg.norm(np.einsum("Klx,Kla->Kax", ways, chained[:, last]), axis=2)
        moved = np.einsum("Ka,Ka->K", moved, h)
        moved += np.einsum("Kl,Kl->K", np.linalg.norm(ways, axis=2), off[:, last])
        pairs = 0.5 * (H**2 - (eta[:, before] ** 2).sum(axis=1)[:, None])
        fast = np.minimum(H, spun[:, None] + pairs)
        bent = np.minimum(H**2, fast**2 + pairs)
        push = np.where(self.on < self.places, self.cell.widths[self.on], 0.0)  # (k,)
        spread = np.sqrt((turns**2 * h**2).sum(axis=1))[:, None]  # |ω − ω_c|
        tip_rest = 0.5 * H_R**2 * L + H_R * H_P
        tip_move = moved[:, None] + tip_rest
        spin_rest = (
            0.5 * bent + 0.5 * spread * fast + spread**2 / 6 + 1e-10
        ) * turns  # and the slope's rounding
        spin_move = (fast + 0.5 * spread) * turns + spin_rest
        length = np.linalg.norm(tip, axis=1)[:, None]
        linear = 0.5 * bent * push + length * spin_rest + tip_rest * turns + tip_move * spin_move
        sizes = push + (1 + L) * turns
        linear, angular = (
            linear + self.eps * (1 + 2 * H + 2 * H_R) * sizes,
            spin_rest + self.eps * (1 + 2 * H) * turns,
        )
        return linear, angular

    def _right_rest(
        self,
        A: Array,
        theta: Array,
        joints: tuple[Array, Array],
        h: Array,
        chained: Array,
        xi: Array,
        tip: Array,
        turns: Array,
        most: list[Array],
    ) -> Array:
        """Bound what A r has beside its value and its slopes in q, and in u for the last rows: (K,
        N, k). ``joints``: half-widths, and those beside ``C δ``; ``chained``: C for every θ."""
        wide, far = joints[0], self.near  # |q − q_c|, |q − q_ref|
        linear, angular = self._twists_rest(theta, joints, h, chained, xi, tip, turns)
        n0, n1, n2, n3 = (m[..., 1:] for m in most)
        q1, q2, q3 = (m[..., 0] for m in most[1:])
        n_b, q_b = np.einsum("Kbna,Kb->Kna", n1, h), np.einsum("Kbn,Kb->Kn", q1, h)
        n_ib, q_ib = np.einsum("Kibna,Kb->Kina", n2, h), np.einsum("Kibn,Kb->Kin", q2, h)
        n_bc, q_bc = np.einsum("Kina,Ki->Kna", n_ib, h), np.einsum("Kin,Ki->Kn", q_ib, h)
        n_ibc = np.einsum("Kibcna,Kb,Kc->Kina", n3, h, h, optimize=True)
        q_ibc = np.einsum("Kibcn,Kb,Kc->Kin", q3, h, h, optimize=True)
        second = np.einsum("Kna,Kin->Kia", n_bc, q1) + 2 * np.einsum("Kna,Kin->Kia", n_b, q_ib)
        second += np.einsum("Kna,Kin->Kia", n0, q_ibc) + np.einsum("Kina,n->Kia", n_ibc, far)
        second += 2 * np.einsum("Kina,Kn->Kia", n_ib, q_b) + np.einsum("Kina,Kn->Kia", n1, q_bc)
        beta = 0.5 * second + np.einsum("Kina,Kn->Kia", n_ib, wide)
        tiny = self.sizes[1] + np.einsum("ina,n->ia", self.sizes[2], far + 1)
        tiny = tiny + np.einsum("Kna,Kin->Kia", n_b, q1) + np.einsum("Kna,Kin->Kia", n0, q_ib)
        tiny += np.einsum("Kina,n->Kia", n_ib, far) + np.einsum("Kina,Kn->Kia", n1, q_b)
        beta += self.eps * (1 + self.chart.monomials.size / 64) * tiny
        found = np.linalg.norm(A[:, :, :3], axis=2)[:, :, None] * linear[:, None]
        found += np.linalg.norm(A[:, :, 3:6], axis=2)[:, :, None] * angular[:, None]
        return np.asarray(found + np.abs(A[:, :, 6:]) @ np.swapaxes(beta, 1, 2), float)
