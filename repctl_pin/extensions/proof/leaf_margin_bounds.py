r"""Lower bounds of the leaf margin over boxes of joint space, batched.

On a box ``q_c ± h``, with ``J_c = [J; V_cᵀ]``, V_c the value of V at the centre, and any
``A ≈ J_c(q_c)⁻¹``:

.. math::

   |A J_c(q) − I| ≤ D = Σ_j |A ∂_j J_c| h_j + |A| \,(\text{remainders, rounding})
   + |A J_c(q_c) − I|, \\
   F + D Y ≤ Y,\; Y > 0 ⇒ J_c \text{ is regular}, \qquad |J_c⁻¹| ≤ Y \text{ with } F = |A|

The last r columns N of ``J_c⁻¹`` span the null space of J; they are expanded to second order in q −
q_c. Relative to the span of V_c, the null space and the span of V are the graphs of linear maps T
and P to its complement. With ``S = (T − P)(I + PᵀT)⁻¹``

.. math:: \text{leaf margin} ≥ 1 / \sqrt{1 + ‖S‖² (1 + ‖P‖²)}

The native library computes them (leaf_margin_bounds.c); without it NumPy does, with the same
formulas.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array, read_only
from ...model.task import Task
from ...native import PROBLEM, filled_struct, library
from ...potentials.basis import Potentials
from ...regions.box import Box
from .chain import Chain, chain_of, frame_change, tool_reach
from .potentials import PRODUCT, SINE, Features, features_of
from .remainder import relative_rounding, remainders, screw_sizes
from .screws import screws, slopes

_BATCH = 2048


@dataclass(frozen=True, eq=False)
@read_only
class LeafMarginBounds:
    """Bounds on the leaf margin and σ_min(J) over K boxes of joint space.

    Attributes
    ----------
    leaf_margin : (K,) array
        Lower bound on the whole box; 0 where J_V was not shown to be regular.
    center : (K,) array
        Leaf margin at the centre, rounded up: no lower bound of the box can be larger.
    sigma_min : (K,) array
        Lower bound of σ_min(J) on the whole box; 0 where there is none.
    split : (K,) array of int
        Index of the joint along which to halve the box.
    """

    leaf_margin: Array
    center: Array
    sigma_min: Array
    split: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
@read_only
class LeafMarginProblem:
    """The leaf margin of potentials on a task, prepared to be bounded over boxes inside one region.

    Attributes
    ----------
    chain : Chain
        Extended chain of the task.
    features : Features
        The potentials as sums of features.
    round : (6 + r,) array
        Bounds of the rounding errors in the rows of J_V.
    eps : float
        Relative rounding error of sums.
    beta : float
        Factor β of ``σ_min(J) ≥ 1 / (β ‖Y‖_F)``, with Y a bound of a right inverse of J: norm of
        the change of frame from the middle link to the task.
    """

    chain: Chain
    features: Features
    round: Array
    eps: float
    beta: float

    def bounds(self, Q: Array, half: Array) -> LeafMarginBounds:
        """Bound the leaf margin in boxes Q ± half, (K, n) each.

        The native library computes the bounds, or without it NumPy.
        """
        native = library()
        return (
            in_numpy(self, Q, half) if native is None else _in_c(self, native, Q, half)
        )

    def undefined(self, Q: Array, half: Array) -> NDArray[np.bool_]:
        """Test for arm angles that are not shown to be defined in boxes Q ± half, (K, n) each."""
        rests = [arm.gradient_bounds(Q, half).rest for arm in self.features.arms]
        found = [~np.isfinite(rest).all(axis=1) for rest in rests]
        return np.any([np.zeros(len(Q), bool), *found], axis=0)


def leaf_margin_of(task: Task, field: Potentials, box: Box) -> LeafMarginProblem:
    """Prepare the leaf margin of potentials for bounds inside a box of joint space.

    The middle link of the chain is the one expected to need the fewest boxes.
    """
    features, chain = features_of(field, task.n, box), chain_of(task)

    def needed(one: LeafMarginProblem) -> float:
        """Evaluate the spectral radius of the bound D on a box; below 1, J_V is regular there."""
        D = _expansion(one, box.center[None], box.half_width[None] / 8).D[0]
        finite = np.isfinite(D).all()
        return float(np.abs(np.linalg.eigvals(D)).max()) if finite else np.inf

    middles = range(len(chain.p) + 1)
    made = [_prepared(task, chain.seen_from(k, 0.5), features, box) for k in middles]
    best = min(made, key=needed)
    ends = [chain.seen_from(best.chain.middle, way) for way in (0.0, 1.0)]
    return min(
        [best, *(_prepared(task, end, features, box) for end in ends)], key=needed
    )


def _prepared(
    task: Task, chain: Chain, features: Features, box: Box
) -> LeafMarginProblem:
    S = np.abs(chain.S[:, : chain.n])
    theta, eta = chain.S[:, : chain.n] @ box.center + chain.o, S @ box.half_width
    eps = relative_rounding(chain)
    round_ = np.concatenate(
        [
            eps * screw_sizes(chain, theta, eta),
            eps * features.size + features.E.max(axis=1),
        ]
    )
    t = tool_reach(chain) + float((np.abs(theta) + eta)[~chain.revolute].sum())
    beta = float(frame_change(task.kind, np.array(t))) * (1 + 1e-9)
    return LeafMarginProblem(chain, features, round_, eps, beta)


# ---- NumPy -------------------------------------------------------------------------------------


def in_numpy(problem: LeafMarginProblem, Q: Array, half: Array) -> LeafMarginBounds:
    """Bound the leaf margin in boxes Q ± half, (K, n) each, in NumPy."""
    n, eps, beta = problem.chain.n, problem.eps, problem.beta
    parts = []
    for i in range(0, len(Q), _BATCH):
        some = half[i : i + _BATCH]
        at = _expansion(problem, Q[i : i + _BATCH], some)
        parts.append(margins(at, some, n, eps, beta))
    return LeafMarginBounds(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in LeafMarginBounds.__dataclass_fields__
        )
    )


@dataclass(frozen=True, eq=False)
@read_only
class Expansion:
    """First-order expansion of J_V in K boxes, multiplied by A: ``A J_V = I + Σ δ_j B_j + …``.

    δ are the k variables of a box, from its centre: joints, or coordinates of a cell.

    Attributes
    ----------
    A, D, R : (K, N, N) arrays
        ``A ≈ J_V(q_c)⁻¹``, the bound D of ``|A J_V − I|``, and the part R of D that does not come
        from the slopes B.
    B : (K, k, N, N) array
        Slopes ``A ∂_j J_V`` at the centre.
    V, dV : (K, r, n) and (K, r, n, k) arrays
        Vᵀ at the centre, and its derivatives.
    rest : (K, r, n) array
        Bound on the difference of Vᵀ from its first-order expansion, rounding included.
    """

    A: Array
    D: Array
    R: Array
    B: Array
    V: Array
    dV: Array
    rest: Array


@dataclass(frozen=True, eq=False)
@read_only
class Graphs:
    """Enclosures of the null space of J and of the span of V in K boxes, for leaf-margin bounds.

    Both are graphs over the span of V_c, V at the centre of the box.

    With δ the k variables of a box from its centre, ``N = X + Σ δ_j N_j + ν`` is a basis of the
    null space. In the complement of V_c, ``T_c`` at the centre and ``P = Σ δ_j P_j + π`` define the
    graphs. Then ``PᵀN = Σ δ_j P_jᵀ T_c + β`` and ``S = (T − P) (I + PᵀT)⁻¹ = T_c + Σ δ_j S_j + ρ``;
    docs/theory.md derives this.

    Attributes
    ----------
    X, T, nu, P, pi, rho : (K, n, r) arrays
        X, T_c, and bounds of ``|ν|``, ``|P|``, ``|π|`` and ``|ρ|``.
    dN, dP, dS : (K, k, n, r) arrays
        The slopes N_j, P_j and S_j.
    beta, square : (K, r, r) arrays
        Bounds of ``|β|`` and ``|SᵀS|``.
    both : (K, k, r, r) array
        Bounds of the change of ``SᵀS`` along each variable, to first order.
    Y : (K, N, 6) array
        Bounds of the first six columns of ``J_c⁻¹``.
    B : (K, k, N, N) array
        ``A ∂_j J_c``, with V_c in place of V.
    defect : (K,) array
        Deviation of V_c and X from ``V_cᵀ V_c = V_cᵀ X = I``.
    regular, sure : (K,) arrays of bool
        ``regular`` is True if J_c was shown to be regular, and ``sure`` if the bounds of P, β
        and S hold.
    """

    X: Array
    T: Array
    nu: Array
    P: Array
    pi: Array
    rho: Array
    dN: Array
    dP: Array
    dS: Array
    beta: Array
    square: Array
    both: Array
    Y: Array
    B: Array
    defect: Array
    regular: NDArray[np.bool_]
    sure: NDArray[np.bool_]


@np.errstate(all="ignore")
def margins(
    at: Expansion, half: Array, n: int, eps: float, beta: float | Array
) -> LeafMarginBounds:
    """Bound the leaf margin in boxes from the first-order expansion of J_V there.

    half (K, k) are the half-widths of the boxes in the k variables of the expansion; ``eps`` and
    ``beta`` are those of :class:`LeafMarginProblem`.
    """
    at = _along_axes(at)
    found = graphs(at, half, n, eps)
    norm, below = _spectral(found.X)
    sigma = (1 - eps) / (
        np.sqrt((found.Y[:, :n] ** 2).sum(axis=(1, 2))) * (1 + eps) * beta
    )
    slack = 1 + eps
    bound = _cosine(
        _spectral(found.square)[0] * slack, _spectral(found.P)[0] * slack, eps
    )
    bound = np.where(found.sure, bound / (1 + 16 * found.defect), np.nan)

    good = found.regular & np.isfinite(bound)
    share = np.abs(found.B)[:, :, :n].sum(axis=(2, 3)) * half
    slopes = np.abs(np.moveaxis(at.dV, 3, 1))
    share += np.einsum("Kia,Kjal,Kj->Kj", np.abs(found.X), slopes, half, optimize=True)
    second = _size(found.rho)[:, None] * share / share.sum(axis=1)[:, None]
    cost = 0.5 * np.sqrt((found.both**2).sum(axis=(2, 3))) / norm[:, None] + 2 * second
    share = np.where(np.isfinite(share).all(axis=1)[:, None], share, half)
    split = np.where(good, cost.argmax(axis=1), share.argmax(axis=1)).astype(np.int32)
    center = np.where(np.isfinite(below) & (below > 0), 1 / below, 0.0)
    return LeafMarginBounds(
        np.where(good, bound, 0.0), center, np.where(found.regular, sigma, 0.0), split
    )


@np.errstate(all="ignore")
def graphs(at: Expansion, half: Array, n: int, eps: float) -> Graphs:
    """Compare the null space with the span of V: compute ``S = (T − P) (I + PᵀT)⁻¹`` with bounds.

    See :class:`Graphs`.
    """
    V, r, slack = np.swapaxes(at.V, 1, 2), at.V.shape[1], 1 + eps
    B, all_dN, all_first, all_nu, Y, regular = _null_space(at, half, n, eps)
    X, dN, first, nu = (
        at.A[:, :n, 6:],
        all_dN[:, :, :n],
        all_first[:, :n],
        all_nu[:, :n],
    )
    T = X - V
    defect = eps + np.abs(at.V @ V - np.eye(r)).sum(axis=(1, 2))
    defect += np.abs(at.V @ X - np.eye(r)).sum(axis=(1, 2))
    tiny = defect[:, None, None]
    dP, pi, P, turned = _span_of_V(at, half, tiny, eps)

    PT = np.swapaxes(dP, 2, 3) @ T[:, None]
    beta = (
        np.swapaxes(P, 1, 2) @ (first + nu) + np.swapaxes(pi, 1, 2) @ np.abs(T) + tiny
    )
    b = _summed(PT, half) + beta
    size = _size(b) * slack
    dS = dN - dP - T[:, None] @ PT
    wide = _summed(dS, half)
    rho = nu + pi + np.abs(T) @ beta + tiny
    again = (wide + rho) @ b  # of (S − T) P^T N, and once more to the end
    row = np.sqrt((again**2).sum(axis=2)) * (size / (1 - size) * slack)[:, None]
    rho = rho + again + row[:, :, None] + eps

    both, square = _square(X, T, dS, wide, rho, half, eps)
    sure = (turned < 0.5) & (defect < 0.01) & (size < 0.9)
    return Graphs(
        X,
        T,
        nu,
        P,
        pi,
        rho,
        dN,
        dP,
        dS,
        beta,
        square,
        both,
        Y,
        B,
        defect,
        regular,
        sure,
    )


def _null_space(
    at: Expansion, half: Array, n: int, eps: float
) -> tuple[Array, Array, Array, Array, Array, NDArray[np.bool_]]:
    """Expand the basis ``N = J_c⁻¹ [0; I]`` of the null space in K boxes, around their centres.

    Returns, for each box:

    - B, the derivatives ``∂_j (A J_c)`` at the centre,
    - the derivatives ``∂_j N`` at the centre,
    - a bound of the first-order terms of N in the box,
    - a bound of the terms of second and higher order of N,
    - a bound of the six columns of ``J_c⁻¹`` before those of N,
    - whether J_c is regular in the whole box.
    """
    A, X = at.A, at.A[:, :, 6:]  # X: (K, N, r)
    slopes = np.moveaxis(at.dV, 3, 1)  # (K, k, r, n)
    B = at.B.copy()
    B[..., :n] -= X[:, None] @ slopes
    D = at.R + np.einsum("Kjic,Kj->Kic", np.abs(B), half)
    dN = -B @ X[:, None]  # (K, k, N, r)
    first, rough = np.einsum("Kjia,Kj->Kia", np.abs(dN), half), at.R @ np.abs(X)
    pairs = np.einsum("Kjic,Kkca->Kjkia", B, dN, optimize=True)
    pairs = np.abs(pairs + np.swapaxes(pairs, 1, 2)) / 2
    second = np.einsum("Kjkia,Kj,Kk->Kia", pairs, half, half, optimize=True)
    second += at.R @ first + D @ rough + eps
    F = np.concatenate([np.abs(A[:, :, :6]) + eps, second], axis=2)
    Y, _, regular = enclosed(D, F, eps)
    return B, dN, first, rough + Y[:, :, 6:], Y[:, :, :6], regular


def _span_of_V(
    at: Expansion, half: Array, tiny: Array, eps: float
) -> tuple[Array, Array, Array, Array]:
    """Expand ``P = (V − V_c V_cᵀV) (V_cᵀV)⁻¹`` in boxes.

    Returns the slopes of P, the bound of its remainder, the bound of |P|, and that of
    ``‖V_cᵀV − I‖`` (K,).
    """
    slack, V, slopes = 1 + eps, np.swapaxes(at.V, 1, 2), np.moveaxis(at.dV, 3, 1)
    rest = np.swapaxes(at.rest, 1, 2)
    M = slopes @ V[:, None]  # of V^T V_c
    dP = np.swapaxes(slopes, 2, 3) - V[:, None] @ np.swapaxes(M, 2, 3)
    turned = _size(_summed(M, half) + at.rest @ np.abs(V) + tiny) * slack
    whole = np.einsum("Kjab,Kj->K", np.abs(slopes), half)[:, None, None]
    pi = rest + np.abs(V) @ (np.abs(at.V) @ rest) + tiny * (1 + whole)
    P = _summed(dP, half)
    row = (
        np.sqrt(((P + pi) ** 2).sum(axis=2)) * (turned / (1 - turned) * slack)[:, None]
    )
    pi = pi + row[:, :, None]
    return dP, pi, P + pi, turned


def _square(
    X: Array, T: Array, dS: Array, wide: Array, rho: Array, half: Array, eps: float
) -> tuple[Array, Array]:
    """Bound ``|SᵀS|``, with ``S = T_c + Σ δ_j S_j + ρ``.

    Returns the bounds of its first-order change along each variable (K, k, r, r), and of all of it
    (K, r, r).
    """
    T_T = np.swapaxes(T, 1, 2)
    both = T_T[:, None] @ dS
    both = np.abs(both + np.swapaxes(both, 2, 3)) * half[:, :, None, None]
    cross = np.abs(T_T) @ rho
    square = np.abs(T_T @ T) + both.sum(axis=1) + cross + np.swapaxes(cross, 1, 2)
    square += np.swapaxes(wide + rho, 1, 2) @ (wide + rho)
    square += eps * (np.abs(np.swapaxes(X, 1, 2)) @ np.abs(X) + 1)
    return both, square


def _cosine(square: Array, P: Array, eps: float) -> Array:
    """Bound the leaf margin from below, from upper bounds of ``‖S‖²`` and ``‖P‖``."""
    return np.asarray(
        (1 - eps) / (np.sqrt(1 + square * (1 + P**2 * (1 + eps))) * (1 + eps))
    )


def _summed(slopes: Array, half: Array) -> Array:
    """Sum absolute values of slopes (K, k, a, b) times half-widths (K, k): (K, a, b)."""
    return np.asarray(np.einsum("Kjab,Kj->Kab", np.abs(slopes), half))


def _size(matrices: Array) -> Array:
    """Compute the Frobenius norms (K,) of matrices (K, a, b)."""
    return np.asarray(np.sqrt((matrices**2).sum(axis=(1, 2))))


def _along_axes(at: Expansion) -> Expansion:
    """Change the basis of V by a rotation, so that ``(X − V)ᵀ (X − V)`` is diagonal at the centre.

    The bounds are closer in this basis.
    """
    T = at.A[:, : at.V.shape[2], 6:] - np.swapaxes(at.V, 1, 2)
    G = np.swapaxes(T, 1, 2) @ T
    G[~np.isfinite(G).all(axis=(1, 2))] = 0.0
    axes = np.linalg.eigh(G)[1]
    turned = np.swapaxes(axes, 1, 2)
    A = np.concatenate([at.A[:, :, :6], at.A[:, :, 6:] @ axes], axis=2)
    V, dV = turned @ at.V, np.einsum("Kba,Kbij->Kaij", axes, at.dV)
    return Expansion(A, at.D, at.R, at.B, V, dV, np.abs(turned) @ at.rest)


@np.errstate(all="ignore")
def _expansion(problem: LeafMarginProblem, Q: Array, half: Array) -> Expansion:
    """Expand the augmented Jacobian J_V around the centres of boxes Q ± half, (K, n) each.

    The result holds its inverse, its slopes along each joint, and bounds of the remainder."""
    chain, n, N = problem.chain, problem.chain.n, problem.chain.N
    S = chain.S[:, :n]
    theta, eta = Q @ S.T + chain.o, half @ np.abs(S).T
    xi, tip = screws(chain, theta)
    linear, angular = (
        rest @ np.abs(chain.S) for rest in remainders(chain, theta, eta)
    )  # (K, N)
    V, dV, rest, round_V = _potentials(problem, Q, half)
    r = V.shape[1]
    J_V = np.zeros((len(Q), N, N))
    J_V[:, :6], J_V[:, 6:, :n] = np.einsum("Klx,lc->Kxc", xi, chain.S), V
    A = inverses(J_V)
    R = np.abs(A @ J_V - np.eye(N))
    R += np.linalg.norm(A[:, :, :3], axis=2)[:, :, None] * linear[:, None]
    R += np.linalg.norm(A[:, :, 3:6], axis=2)[:, :, None] * angular[:, None]
    round_ = np.concatenate(
        [np.broadcast_to(problem.round[:6], (len(Q), 6)), round_V], axis=1
    )
    R += np.einsum("Kia,Ka->Ki", np.abs(A), round_)[:, :, None]
    slope = np.zeros((len(Q), n, 6 + r, N))
    slope[:, :, :6] = np.swapaxes(slopes(chain, xi, tip), 2, 3)
    slope[:, :, 6:, :n] = np.transpose(dV, (0, 3, 1, 2))
    B = A[:, None] @ slope
    D = R + np.einsum("Kjic,Kj->Kic", np.abs(B), half)
    return Expansion(A, D, R, B, V, dV, rest + round_V[:, :, None])


def enclosed(D: Array, F: Array, eps: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Find Y > 0 with ``(1 + ε) D Y + F ≤ (1 − ε) Y``.

    Y is the solution of ``(1 + ε) D Y + F = (1 − 2 ε) Y``, which leaves slack for rounding. Returns
    Y, D Y, and whether the inequality holds as computed (K,).
    """
    Y = _solved((1 - 2 * eps) * np.eye(D.shape[1]) - (1 + eps) * D, F)
    DY = D @ Y
    held = (Y > 0) & ((1 + eps) * DY + F <= (1 - eps) * Y)
    return Y, DY, np.asarray(held.all(axis=(1, 2)))


def _potentials(
    problem: LeafMarginProblem, Q: Array, half: Array
) -> tuple[Array, Array, Array, Array]:
    """Evaluate Vᵀ (K, r, n), its derivatives (K, r, n, n), and bounds, at the centres of boxes.

    The bounds are those of the remainder (K, r, n) and of rounding (K, r). V is taken in a basis
    that is orthonormal at the centres.
    """
    parts = problem.features
    phi = _features(parts, Q)
    V, dV = (
        np.einsum("aif,Kf->Kai", parts.G, phi),
        np.einsum("aijf,Kf->Kaij", parts.C, phi),
    )
    rest = (
        0.5 * np.einsum("aijl,Kj,Kl->Kai", parts.T, half, half, optimize=True) + parts.E
    )
    if len(parts.third):
        third = np.abs(
            np.einsum("aijlf,Kf->Kaijl", parts.C3, phi[:, parts.third], optimize=True)
        )
        third += np.einsum("aijlm,Km->Kaijl", parts.T4, half) / 3
        rest = rest + 0.5 * np.einsum(
            "Kaijl,Kj,Kl->Kai", third, half, half, optimize=True
        )
    round_ = np.tile(problem.round[6:], (len(Q), 1))
    for arm in parts.arms:
        found = arm.gradient_bounds(Q, half)
        c, size = arm.weights, np.abs(arm.weights)
        V = V + c[:, None] * found.V[:, None]
        dV = dV + c[:, None, None] * found.dV[:, None]
        rest = rest + size[:, None] * found.rest[:, None]
        round_ = round_ + problem.eps * size * found.size[:, None]
    for a in range(V.shape[1]):
        for b in [*range(a), *range(a)]:
            s = (V[:, a] * V[:, b]).sum(axis=1)
            V[:, a] -= s[:, None] * V[:, b]
            dV[:, a] -= s[:, None, None] * dV[:, b]
            rest[:, a] += np.abs(s)[:, None] * rest[:, b]
            round_[:, a] += np.abs(s) * round_[:, b]
        norm = np.linalg.norm(V[:, a], axis=1)
        V[:, a] /= norm[:, None]
        dV[:, a] /= norm[:, None, None]
        rest[:, a] /= norm[:, None]
        round_[:, a] /= norm
    return V, dV, rest, round_


def _features(parts: Features, Q: Array) -> Array:
    """Evaluate the features at every row of Q (K, n): (K, F)."""
    z = Q @ parts.Z.T - parts.z0
    phi = np.ones((len(Q), len(parts.kind)))
    for f, (kind, parent, variable) in enumerate(
        zip(parts.kind, parts.parent, parts.variable, strict=True)
    ):
        if kind == PRODUCT:
            phi[:, f] = phi[:, parent] * z[:, variable]
        elif kind:
            phi[:, f] = (
                np.sin(z[:, variable]) if kind == SINE else np.cos(z[:, variable])
            )
    return phi


def inverses(matrices: Array) -> Array:
    """Invert matrices (K, N, N); NaN where a matrix is singular."""
    try:
        return np.asarray(np.linalg.inv(matrices), float)
    except np.linalg.LinAlgError:
        regular = np.isfinite(matrices).all(axis=(1, 2)) & (
            np.linalg.svd(matrices, compute_uv=False)[:, -1] > 1e-14
        )
        inverses = np.full_like(matrices, np.nan)
        inverses[regular] = np.linalg.inv(matrices[regular])
        return inverses


def _solved(M: Array, B: Array) -> Array:
    """Solve M Y = B by elimination without pivoting; NaN where a pivot is not positive."""
    M, Y = M.copy(), B.copy()
    N = M.shape[1]
    for c in range(N):
        M[:, c, c] = np.where(M[:, c, c] > 1e-12, M[:, c, c], np.nan)
        factor = M[:, c + 1 :, c] / M[:, c, c, None]
        M[:, c + 1 :, c + 1 :] -= factor[:, :, None] * M[:, c, None, c + 1 :]
        Y[:, c + 1 :] -= factor[:, :, None] * Y[:, c, None]
    for c in range(N - 1, -1, -1):
        Y[:, c] = (
            Y[:, c] - np.einsum("Kl,Klj->Kj", M[:, c, c + 1 :], Y[:, c + 1 :])
        ) / M[:, c, c, None]
    return Y


def _spectral(X: Array) -> tuple[Array, Array]:
    """Bound the spectral norms of X (K, n, r): upper and lower bounds, (K,) each.

    With ``G = XᵀX`` and its largest eigenvalue λ, ``λ ≤ (tr G^256)^(1/256) ≤ r^(1/256) λ``.
    """
    r = X.shape[2]
    G = np.swapaxes(X, 1, 2) @ X
    scale, power = np.zeros(len(X)), 1
    for _ in range(0 if r == 1 else 8):
        trace = np.trace(G, axis1=1, axis2=2)
        scale += np.log(trace) / power
        power *= 2
        G = G / trace[:, None, None]
        G = G @ G
    top = scale + np.log(np.trace(G, axis1=1, axis2=2)) / power
    return np.exp(top / 2), np.exp((top - np.log(r) / power) / 2)


# ---- C -----------------------------------------------------------------------------------------


def c_problem(problem: LeafMarginProblem) -> tuple[Any, list[NDArray[np.generic]]]:
    """Create the C struct of a problem, and the arrays that must live as long as it."""
    chain, parts, n = problem.chain, problem.features, problem.chain.n
    S = chain.S
    row, column = np.nonzero(S)
    upper = np.triu_indices(n)
    ints = {
        "revolute": chain.revolute,
        "level": chain.level,
        "first": np.searchsorted(row, np.arange(len(S) + 1)),
        "column": column,
        "kind": parts.kind,
        "parent": parts.parent,
        "variable": parts.variable,
        "third": parts.third,
    }
    reals = {
        "R": chain.R,
        "p": chain.p,
        "a": chain.a,
        "shift": chain.shift,
        "reach": chain.reach,
        "S": S[row, column],
        "o": chain.o,
        "Zq": parts.Z,
        "z0": parts.z0,
        "G": parts.G,
        "C": parts.C[:, upper[0], upper[1]],
        "C3": parts.C3[:, :, upper[0], upper[1]],
        "T": parts.T,
        "T4": parts.T4,
        "E": parts.E,
        "round": problem.round,
    }
    sizes = {"P": len(S), "k": chain.middle, "n": n, "N": chain.N, "r": len(parts.G)}
    sizes |= {"Z": len(parts.Z), "F": len(parts.kind), "F3": len(parts.third)}
    scalars = sizes | {"eps": problem.eps, "beta": problem.beta}
    return filled_struct(PROBLEM, ints, reals, scalars)


def _in_c(
    problem: LeafMarginProblem, native: ctypes.CDLL, Q: Array, half: Array
) -> LeafMarginBounds:
    struct, held = c_problem(problem)
    Q, half = (np.ascontiguousarray(values, float) for values in (Q, half))
    bound, center, sigma = np.zeros((3, len(Q)))
    split = np.zeros(len(Q), np.int32)
    address = [
        ctypes.c_void_p(array.ctypes.data)
        for array in (Q, half, bound, center, sigma, split)
    ]
    arms = arm_angles_for_c(problem, Q, half)
    native.leaf_margins(
        ctypes.byref(struct),
        ctypes.c_long(len(Q)),
        *address,
        None if arms is None else ctypes.c_void_p(arms.ctypes.data),
    )
    del held  # alive until here
    return LeafMarginBounds(bound, center, sigma, split)


def arm_angles_for_c(problem: LeafMarginProblem, Q: Array, half: Array) -> Array | None:
    """Lay out the arm angles' V, dV, rest and rounding (K, r (n² + 2 n + 1)) for the C kernel.

    None if there are no arm angles.
    """
    if not problem.features.arms:
        return None
    r, n, K = len(problem.features.G), Q.shape[1], len(Q)
    out = np.zeros((K, r, n * n + 2 * n + 1))
    for arm in problem.features.arms:
        found = arm.gradient_bounds(Q, half)
        sizes = problem.eps * found.size[:, None]
        both = np.concatenate([found.V, found.dV.reshape(K, -1)], axis=1)
        out[..., : n + n * n] += arm.weights[:, None] * both[:, None]
        both = np.concatenate([found.rest, sizes], axis=1)
        out[..., n + n * n :] += np.abs(arm.weights)[:, None] * both[:, None]
    return out
