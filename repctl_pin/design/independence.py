"""Selection of linearly independent potentials of a basis over a region Ω.

With dependent potentials, the coefficients of a fit are undetermined. The module also finds
coordinates in which the gradients of the potentials are orthonormal, so that the fit is well
conditioned. As sizes, N is the number of potentials of the basis, and N' that of the independent
ones; N is also a matrix whose columns span the null space of J. Nodes are the configurations in Ω
at which the gradients are evaluated.

``PotentialBasis`` is a basis of N functions of q, whose combinations are the potentials h of a
design. ``Independent`` are the independent potentials of a basis: their indices, and the names of
the dropped ones. ``Inverse`` is a matrix function G(q) (n, m) with J G = I, evaluated at q (n,) or
Q (K, n).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # which imports its parts when they are needed
from numpy.typing import NDArray

from ..base.arguments import Array, read_only
from ..base.errors import InputError
from ..potentials.basis import PotentialBasis
from ..strategies.strategy import Inverse
from .criterion import evaluate

_CONSTANT = 1e-12
"""RMS gradient relative to the largest one of the basis, at or below which a potential counts as
constant."""

_ROW_SPACE = 1e-9
_DEPENDENT = 1e-8


@dataclass(frozen=True, eq=False)
@read_only
class Independent:
    """The independent potentials of a basis, which a fit over a region Ω uses.

    Attributes
    ----------
    kept : (N',) array of int
        Indices of the independent potentials in the basis.
    dropped : tuple of str
        Names of the potentials that are left out, each with the reason.
    basis : (N', N') array
        B: the columns of D B, with D the gradients of the independent potentials, are orthonormal
        in the mean over Ω. The optimiser uses the coordinates B⁻¹ A, so that its result does not
        depend on the given basis. B is upper triangular, so the leading (k, k) block of B does the
        same for the first k potentials.
    size : int
        N, the number of all potentials of the basis.
    """

    kept: NDArray[np.intp]
    dropped: tuple[str, ...]
    basis: Array
    size: int

    def spread(self, A: Array) -> Array:
        """Convert coefficients A of the first independent potentials to those of the whole basis.

        A fit works with A, which has a row for each of the first independent potentials and r
        columns. A saved design has the result (N, r), which is 0 in all other rows.
        """
        whole = np.zeros((self.size, A.shape[1]))
        whole[self.kept[: len(A)]] = A
        return whole


def independent(
    desired: Inverse, potentials: PotentialBasis, Q: Array, weights: Array
) -> Independent:
    """Select the independent potentials of a basis over Ω.

    Left out are potentials that are constant over Ω, that are functions of the task coordinates x =
    f(q) alone, or whose gradients are linear combinations of those of earlier potentials. The
    gradient of a function of x alone lies in the row space of J, and makes J_V = [J; Vᵀ] singular
    everywhere.

    Parameters
    ----------
    desired, potentials
        G_d, for its task and a check of its values, and the basis.
    Q, weights : (K, n), (K,) arrays
        Nodes in Ω with ``K n ≥ N``, and their quadrature weights.

    Raises
    ------
    InputError
        If fewer than r potentials are left; the message gives the reasons.
    """
    r = desired.task.r
    triangle, size, part = _gradients(desired, potentials, Q, weights)
    constant = size <= _CONSTANT * np.max(size)
    in_rows = ~constant & (part <= _ROW_SPACE * size)
    left = np.flatnonzero(~(constant | in_rows))
    R, kept = _sequential(triangle[:, left])
    dropped = _dropped(potentials, constant, in_rows, np.setdiff1d(left, left[kept]))
    if len(kept) < r:
        why = f" ({'; '.join(dropped[:4])}{'; …' if len(dropped) > 4 else ''})" if dropped else ""
        raise InputError(
            f"{len(kept)} independent potentials are too few for r = {r}, the number of redundant "
            f"joints{why}; raise the degree of the potentials, or add others"
        )
    return Independent(
        left[kept],
        tuple(dropped),
        scipy.linalg.solve_triangular(R, np.eye(len(R))),
        potentials.size,
    )


def _gradients(
    desired: Inverse, potentials: PotentialBasis, Q: Array, weights: Array
) -> tuple[Array, Array, Array]:
    """Compute a triangular factor and two norms of the gradients of the potentials at Q (K, n).

    Return R (N, N) of the QR factorisation of the gradients (K n, N), the norms of the gradients
    (N,), and the norms of their components in the null space of J (N,). Each row is weighted by the
    square root of the quadrature weight ``weights`` (K,) of its node.
    """
    triangle = np.zeros((0, potentials.size))
    square = 0.0
    in_null = 0.0
    for i in range(0, len(Q), 1024):
        N, _, D = evaluate(desired, potentials, Q[i : i + 1024])
        D = D * np.sqrt(weights[i : i + 1024])[:, None, None]
        square = square + np.sum(D**2, axis=(0, 1))
        in_null = in_null + np.sum((np.swapaxes(N, -1, -2) @ D) ** 2, axis=(0, 1))
        triangle = np.asarray(
            np.linalg.qr(np.concatenate([triangle, D.reshape(-1, potentials.size)]), mode="r")
        )
    return triangle, np.sqrt(square), np.sqrt(in_null)


def _dropped(
    potentials: PotentialBasis,
    constant: NDArray[np.bool_],
    in_rows: NDArray[np.bool_],
    dependent: NDArray[np.intp],
) -> list[str]:
    """List the potentials that are left out, as texts "name: reason".

    ``constant`` (N,) is True for potentials that are constant, ``in_rows`` (N,) for functions of
    the task coordinates alone. ``dependent`` are the indices of potentials that depend linearly on
    earlier ones.
    """
    reasons = {
        "constant over the region": np.flatnonzero(constant),
        "in the row space of J, a function of the task alone": np.flatnonzero(in_rows),
        "depends linearly on the potentials before it": dependent,
    }
    return [
        f"{potentials.names[int(j)]}: {why}" for why, numbers in reasons.items() for j in numbers
    ]


def _sequential(triangle: Array) -> tuple[Array, list[int]]:
    """Factor ``triangle`` (N, N) by QR, without the columns that depend on earlier columns.

    A column belongs to a potential; earlier ones have lower degree. Return R (N', N') of the N'
    remaining columns, and their indices. A column is dependent if less than 1e-8 of its norm is
    perpendicular to all earlier columns.
    """
    size = np.linalg.norm(triangle, axis=0)
    kept = list(range(triangle.shape[1]))
    while True:  # a small diagonal entry of R shows the first dependent column; again without it
        R = np.linalg.qr(triangle[:, kept] / size[kept], mode="r")
        small = np.abs(np.diagonal(R)) <= _DEPENDENT
        if not small.any():
            return R * size[kept], kept
        del kept[int(np.argmax(small))]
