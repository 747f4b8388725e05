r"""A cell's inverse kinematic function over boxes of poses: that it exists, is the only one, and
its margins.

On a box ``u_c ± h`` of the cell's coordinates, with ``z = F(u)``, along a ray ``u_c + t δ``:

.. math:: \begin{bmatrix} J(q) \\ n_{ref}(u)^T \end{bmatrix} \dot q = r(q, u)\, δ, \qquad
          r = \begin{bmatrix} E \\ n_{ref}^T ∂q_{ref} - ∂n_{ref}^T (q - q_{ref}) \end{bmatrix}

in the middle link's frame, so E depends on the joints before it only, and on the tool's place seen
from it. See docs/theory.md for the enclosure of second order."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, read_only
from ..errors import InputError
from ..inverse_function.chart import Chart
from ..inverse_function.monomials import Monomials
from ..inverse_function.rotations import left_jacobian
from ..inverse_function.sector import Sector
from .chain import Chain, chain_of, tool_reach
from .leaf_margin_bounds import Bounds, Expansion, enclosed, inverses, margins
from .potentials import U
from .remainder import relative_rounding, remainders
from .screws import between, screws, slopes, turn

_GROW = 1.3
"""How much larger than predicted the box of joints is made in which the prediction is then
verified."""


@dataclass(frozen=True, eq=False)
@read_only
class Polynomials:
    """q_ref and n_ref of a chart, their slopes, and bounds of the higher ones on the whole cell.

    Attributes
    ----------
    chart : Chart
    most : list of arrays
        ``most[d]`` (k, …, k, n, 1 + r), with d axes k: bounds of the d-th derivatives.
    third : (k, k, k, N, n, 1 + r) array
        Coefficients of the third derivatives.
    """

    chart: Chart
    most: list[Array]
    third: Array

    def __repr__(self) -> str:
        return f"<Polynomials of {self.chart.monomials.size} terms>"

    @classmethod
    def of(cls, chart: Chart) -> Polynomials:
        """Bound the derivatives of a chart's polynomials by the absolute values of their terms."""
        monomials, most = chart.monomials, [np.abs(chart.coefficients).sum(axis=0)]
        C = third = chart.coefficients[None]
        k = monomials.k
        for order in range(1, 5):
            flat = C.reshape(-1, *chart.coefficients.shape)
            C = np.stack([_derivative(monomials, one, j) for one in flat for j in range(k)])
            most.append(np.abs(C).sum(axis=1).reshape(*(k,) * order, *chart.coefficients.shape[1:]))
            if order == 3:
                third = C.reshape(*(k,) * 3, *chart.coefficients.shape)
        return cls(chart, most, third)

    def at(self, Uc: Array) -> tuple[Array, Array, Array]:
        """Evaluate (q_ref, n_ref), their slopes and curvatures: (K, n, 1 + r), (K, k, …) and (K, k,
        k, …)."""
        monomials, C = self.chart.monomials, self.chart.coefficients
        T, k = monomials.values(Uc), monomials.k
        values = np.einsum("KN,Nij->Kij", T, C, optimize=True)
        first = [_derivative(monomials, C, j) for j in range(k)]
        slopes_ = np.stack([np.einsum("KN,Nij->Kij", T, c, optimize=True) for c in first], axis=1)
        second = [
            [np.einsum("KN,Nij->Kij", T, _derivative(monomials, c, j)) for j in range(k)]
            for c in first
        ]
        return values, slopes_, np.stack([np.stack(row, axis=1) for row in second], axis=1)

    def most_in(
        self, Uc: Array, values: Array, first: Array, second: Array, h: Array
    ) -> list[Array]:
        """Bound q_ref, n_ref and their derivatives to the third order in boxes, given their values
        at the centres."""
        monomials, size = self.chart.monomials, self.third.shape
        low = monomials.starts[
            max(monomials.degree - 3, 0) + 1
        ]  # the monomials that third derivatives have
        third = monomials.values(Uc)[:, :low] @ np.moveaxis(self.third, 3, 0)[:low].reshape(low, -1)
        third = np.abs(third.reshape(len(Uc), *size[:3], *size[4:]))
        third = third + np.einsum("ibcdnx,Kd->Kibcnx", self.most[4], h)
        two = np.abs(second) + np.einsum("Kibcnx,Kc->Kibnx", third, h)
        one = np.abs(first) + np.einsum("Kibnx,Kb->Kinx", two, h)
        return [np.abs(values) + np.einsum("Kinx,Ki->Knx", one, h), one, two, third]


def _derivative(monomials: Monomials, C: Array, j: int) -> Array:
    """Differentiate polynomials with coefficients C (N, …) with respect to u_j: coefficients
    again."""
    out = np.zeros_like(C)
    powers = monomials.exponents[:, j]
    on = powers > 0
    np.add.at(out, monomials.lower[j][on], C[on] * powers[on].reshape(-1, *[1] * (C.ndim - 1)))
    return out


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


@dataclass(frozen=True, eq=False)
@read_only
class CellBounds:
    """Bounds for K boxes of poses.

    Attributes
    ----------
    leaf : Bounds
        Lower bound of ``σ_min(Nᵀ n̂_ref)``.
    limit_margin, center_limit : (K,) arrays
        A lower bound on the box, −inf where F was not shown to exist, and the value at the centre.
    found : (K,) array of bool
        Whether there is a solution at the centre.
    """

    leaf: Bounds
    limit_margin: Array
    center_limit: Array
    found: NDArray[np.bool_]

    def __repr__(self) -> str:
        return f"<CellBounds of {len(self.limit_margin)} boxes>"


class CellProof:
    """A function over a cell, to be enclosed over boxes of poses."""

    def __init__(self, chart: Chart) -> None:
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
        self.near = 1.2 * away + 0.006  # d*: F is the only solution within this of q_ref
        whole = chain_of(self.task)
        middles = range(1, len(whole.p))
        made = [whole.seen_from(k, way) for k in middles for way in (0.0, 0.5, 1.0)]
        h = np.full((1, cell.k), 0.02)
        self.chain, self.eps = whole, relative_rounding(whole)
        self.chain = min(made, key=lambda chain: self._size(chain, h))

    def __repr__(self) -> str:
        return f"<CellProof of {self.cell!r}>"

    def _size(self, chain: Chain, h: Array) -> float:
        self.chain = chain
        found = self._enclosure(np.zeros((1, self.cell.k)), h)
        size = float(found[1].sum())
        return size if np.isfinite(size) else np.inf

    def bounds(self, Uc: Array, half: Array) -> CellBounds:
        """Bound the margins of F over boxes Uc ± half, (K, k) each."""
        Q, reach, good, at, C, there = self._enclosure(Uc, half)
        task = self.task
        lower, upper, _ = task.joint_limits
        center = np.minimum(Q - lower, upper - Q).min(axis=1)
        limit = np.minimum(Q - reach - lower, upper - Q - reach).min(axis=1)
        slides = np.abs(Q) + reach
        t = (
            tool_reach(self.chain)
            + slides[:, ~task.revolute].sum(axis=1) * np.abs(self.chain.S).max()
        )
        leaf = margins(at, half, self.chain.n, self.eps, (t + np.sqrt(t * t + 4)) / 2)
        good = good & (leaf.leaf_margin > 0)
        split = (np.abs(C).max(axis=1) * half).argmax(axis=1).astype(np.int32)
        found = Bounds(
            np.where(good, leaf.leaf_margin, 0.0),
            leaf.center,
            np.where(good, leaf.sigma_min, 0.0),
            split,
        )
        return CellBounds(found, np.where(good, limit, -np.inf), center, there)

    @np.errstate(all="ignore")
    def _enclosure(
        self, Uc: Array, h: Array
    ) -> tuple[Array, Array, NDArray[np.bool_], Expansion, Array, NDArray[np.bool_]]:
        """Enclose F: centres and half-widths (K, n), where proved, J_V along it, ∂F, and where
        centres are found."""
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
        moved = np.zeros((K, n, 6, N))
        moved[:] = np.swapaxes(slopes(chain, xi, tip), 2, 3)
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
        half_F = np.einsum(
            "Kbia,Ka,Kb->Ki", np.abs(curve + np.transpose(curve, (0, 3, 2, 1))) / 2, h, h
        )

        # a box of joints: around the prediction, and around all that is within d* of q_ref
        residual = 2 * (points.residual + 1e-11) * (1 + tool_reach(chain))
        straight = np.einsum("Kia,Ka->Ki", np.abs(C), h)
        most = self.polynomials.most_in(Uc, values, first, second, h)
        bend = 0.5 * np.einsum(
            "Kibnx,Ki,Kb->Knx", most[2], h, h, optimize=True
        )  # beside the slopes of q_ref, n_ref
        n_rest = np.swapaxes(bend[..., 1:], 1, 2)
        guess = 1e-9 + (1.02 * straight + half_F)[:, :n]
        for _ in range(2):
            R, round_ = self._rest(A, J_V, theta, guess, n_rest)
            D = (
                R
                + np.einsum("Kjic,Kj->Kic", np.abs(B), guess)
                + np.einsum("Kbic,Kb->Kic", np.abs(B_u), h)
            )
            rest = self._right_rest(A, theta, guess, h, tip, turns, d, most)
            p = np.einsum("Kjia,Ka->Kij", np.abs(P), h)  # (K, N, j)
            load = np.einsum("Kia,Ka->Ki", rest, h) + (R @ straight[..., None])[..., 0]
            load += (D @ half_F[..., None])[..., 0] + 0.5 * (p @ half_F[:, :n, None])[..., 0]
            load += np.abs(A).sum(axis=2) * residual[:, None]
            whole = D.copy()
            whole[..., :n] += p
            Z, _, held = enclosed(whole, load[..., None] + 1e-15, self.eps)
            Z = Z[..., 0]
            reach = (straight + 0.5 * half_F + Z)[:, :n] * (1 + self.eps) + 4 * U * np.abs(Q)
            fits, guess = (
                (reach <= guess).all(axis=1),
                np.where(reach <= guess, guess, _GROW * reach),
            )
            if fits.all():
                break

        ahead = np.einsum("Kin,Ki->Kn", np.abs(dq), h) + bend[..., 0]
        wide = np.maximum(reach, np.abs(d) + ahead + self.near)
        R, _ = self._rest(A, J_V, theta, wide, np.zeros((K, r, n)))
        n_move = np.einsum("Kina,Ki->Kan", np.abs(dn), h) + n_rest
        D_q = R + np.einsum("Kjic,Kj->Kic", np.abs(B), wide)
        only = D_q.copy()
        only[..., :n] += np.abs(A[..., 6:]) @ n_move
        only += self._commutator(A, xi, moved, wide)
        regular = enclosed(only, np.ones((K, N, 1)), self.eps)[
            2
        ]  # F is the only solution in the box

        off = np.abs(d) + np.einsum("Kia,Ka->Ki", np.abs(C[:, :n] - np.swapaxes(dq, 1, 2)), h)
        off += (0.5 * half_F + Z)[:, :n] + bend[..., 0]
        good = held & fits & regular & (off <= self.near).all(axis=1) & points.found

        # J_V along F, to first order in u
        along = np.einsum("Kjic,Kja->Kaic", B, C[:, :n]) + B_u
        loose = (0.5 * half_F + Z)[:, :n]
        R, round_ = self._rest(A, J_V, theta, reach, n_rest)
        R = R + np.einsum("Kjic,Kj->Kic", np.abs(B), loose)
        at = self._orthonormal(A, R, along, n_ref, dn, n_rest, h, round_)
        return Q, reach, good, at, C[:, :n], points.found

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
        n_size = (self.polynomials.most[0] + self.polynomials.most[1].sum(axis=0))[:, 1:].max(
            axis=0
        )  # (r,)
        rows = np.empty((len(A), chain.N))
        rows[:, :3], rows[:, 3:6] = (columns * length * size)[:, None], (columns * size)[:, None]
        rows[:, 6:] = n_size * (1 + terms / 64)
        R += self.eps * np.einsum("Kia,Ka->Ki", np.abs(A), rows)[:, :, None]
        return R, self.eps * rows[:, 6:, None] * np.ones(n)

    def _commutator(self, A: Array, xi: Array, moved: Array, wide: Array) -> Array:
        """Bound what the straight way between two solutions at one u adds to D: the closure along
        it is not exact.

        Both are within d* of q_ref, so their joints differ by at most 2 d*.
        """
        chain, n = self.chain, self.chain.n
        S = np.abs(chain.S)
        separation = 2 * self.near  # (n,)
        eta = wide @ S[:, :n].T
        all_, reach = eta.sum(axis=1), 1 + chain.reach.max() + eta.sum(axis=1)
        turns = np.linalg.norm(xi[..., 3:], axis=2) * (1 + self.eps)
        v = np.linalg.norm(xi[..., :3], axis=2) * (1 + self.eps) + (all_ * reach)[:, None]
        steeper = (all_ * reach)[:, None, None]  # slopes of J elsewhere in the box
        vary_v = np.einsum(
            "Kjc,j,c->K",
            np.linalg.norm(moved[:, :, :3, :n], axis=2) + steeper,
            separation,
            separation,
        )
        vary_w = np.einsum(
            "Kjc,j,c->K",
            np.linalg.norm(moved[:, :, 3:, :n], axis=2) + steeper,
            separation,
            separation,
        )
        theta = S[:, :n] @ separation
        T, T_v = turns @ theta, v @ theta
        angle = 0.5 * vary_w / np.maximum(1 - 1.5 * T, 0)
        shift = (0.5 * vary_v + angle * T_v) / np.maximum(1 - 2 * T, 0)
        turned = (2 * angle[:, None] * turns) @ S
        pushed = (2 * shift[:, None] * turns + angle[:, None] * v) @ S
        found = np.linalg.norm(A[:, :, :3], axis=2)[:, :, None] * pushed[:, None]
        found += np.linalg.norm(A[:, :, 3:6], axis=2)[:, :, None] * turned[:, None]
        return np.asarray(found * (1 + self.eps), float)

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

    def _right_rest(
        self,
        A: Array,
        theta: Array,
        wide: Array,
        h: Array,
        tip: Array,
        turns: Array,
        d: Array,
        most: list[Array],
    ) -> Array:
        """Bound what A r has beside its value and its slopes in q, and in u for the last rows: (K,
        N, k)."""
        chain, n = self.chain, self.chain.n
        eta = wide @ np.abs(chain.S[:, :n]).T
        before = np.arange(chain.middle)
        H = eta[:, before[chain.revolute[before]]].sum(axis=1)[:, None]  # (K, 1)
        beyond = between(chain, len(chain.p) - 1)
        H_R = eta[:, beyond[chain.revolute[beyond]]].sum(axis=1)[:, None]
        slides = beyond[~chain.revolute[beyond]]
        H_P = eta[:, slides].sum(axis=1)[:, None]
        L = (tool_reach(chain) + (np.abs(theta) + eta)[:, slides].sum(axis=1))[:, None]
        push = np.where(self.on < self.places, self.cell.widths[self.on], 0.0)  # (k,)
        spread = np.sqrt((turns**2 * h**2).sum(axis=1))[:, None]  # |ω − ω_c|
        tip_rest = 0.5 * H_R**2 * L + H_R * H_P
        tip_move = H_R * L + H_P + tip_rest
        spin_rest = (
            0.5 * H**2 + 0.5 * spread * H + spread**2 / 6 + 1e-10
        ) * turns  # and the slope's rounding
        spin_move = (H + 0.5 * spread) * turns + spin_rest
        length = np.linalg.norm(tip, axis=1)[:, None]
        linear = 0.5 * H**2 * push + length * spin_rest + tip_rest * turns + tip_move * spin_move
        sizes = push + (1 + L) * turns
        linear, angular = (
            linear + self.eps * (1 + 2 * H + 2 * H_R) * sizes,
            spin_rest + self.eps * (1 + 2 * H) * turns,
        )
        n0, n1, n2, n3 = (m[..., 1:] for m in most)
        q1, q2, q3 = (m[..., 0] for m in most[1:])
        far = np.abs(d) + wide + np.einsum("Kin,Ki->Kn", q1, h)  # |q − q_ref|
        n_b, q_b = np.einsum("Kbna,Kb->Kna", n1, h), np.einsum("Kbn,Kb->Kn", q1, h)
        n_ib, q_ib = np.einsum("Kibna,Kb->Kina", n2, h), np.einsum("Kibn,Kb->Kin", q2, h)
        n_bc, q_bc = np.einsum("Kina,Ki->Kna", n_ib, h), np.einsum("Kin,Ki->Kn", q_ib, h)
        n_ibc = np.einsum("Kibcna,Kb,Kc->Kina", n3, h, h, optimize=True)
        q_ibc = np.einsum("Kibcn,Kb,Kc->Kin", q3, h, h, optimize=True)
        second = np.einsum("Kna,Kin->Kia", n_bc, q1) + 2 * np.einsum("Kna,Kin->Kia", n_b, q_ib)
        second += np.einsum("Kna,Kin->Kia", n0, q_ibc) + np.einsum("Kina,Kn->Kia", n_ibc, far)
        second += 2 * np.einsum("Kina,Kn->Kia", n_ib, q_b) + np.einsum("Kina,Kn->Kia", n1, q_bc)
        beta = 0.5 * second + np.einsum("Kina,Kn->Kia", n_ib, wide)
        beta += (
            self.eps
            * (1 + self.chart.monomials.size / 64)
            * (
                np.einsum("na,in->ia", *self._sizes)
                + np.einsum("ina,Kn->Kia", self.polynomials.most[1][..., 1:], far + 1)
            )
        )
        found = np.linalg.norm(A[:, :, :3], axis=2)[:, :, None] * linear[:, None]
        found += np.linalg.norm(A[:, :, 3:6], axis=2)[:, :, None] * angular[:, None]
        return np.asarray(found + np.abs(A[:, :, 6:]) @ np.swapaxes(beta, 1, 2), float)

    @property
    def _sizes(self) -> tuple[Array, Array]:
        """Bounds of n_ref and of the slopes of q_ref on the whole cell."""
        return self.polynomials.most[0][:, 1:], self.polynomials.most[1][..., 0]
