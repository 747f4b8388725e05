r"""Chart of the configurations over a cell: one smooth set of them, and those beside it along the
null space."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, read_only
from ..solvers import newton_rows
from .cell import Cell
from .chart_solve import compiled_chain
from .kinematics import placed, solved
from .monomials import Monomials

_STEP = 0.3
"""Longest Newton step of any joint, rad or m."""

_ITERATIONS = 12
_EXACT = 1e-11


@dataclass(frozen=True, eq=False)
@read_only
class Chart:
    r"""Labels the fibre ``f(q) = x`` over each pose of a cell: ``n_ref(u)ᵀ (q − q_ref(u)) = s``.

    q_ref and n_ref are polynomials in the cell's coordinates u. They only have to be smooth and
    close to f(q) = x and to its null space: the q of ``f(q) = x`` with label s is exact.

    Attributes
    ----------
    cell : Cell
    monomials : Monomials
    coefficients : (N, n, 1 + r) array
        Coefficients of q_ref, then of the columns of n_ref.
    """

    cell: Cell
    monomials: Monomials
    coefficients: Array

    def reference(self, U: Array) -> tuple[Array, Array]:
        """Evaluate q_ref (K, n) and n_ref (K, n, r)."""
        both = np.tensordot(self.monomials.values(U), self.coefficients, axes=1)
        return both[:, :, 0], both[:, :, 1:]

    def slopes(self, U: Array) -> tuple[Array, Array]:
        """Differentiate q_ref and n_ref with respect to u: (K, n, k) and (K, n, r, k)."""
        monomials, coefficients = self._differentiated
        values = monomials.values(U)
        both = (values @ coefficients.reshape(len(coefficients), -1)).reshape(
            len(U), *coefficients.shape[1:]
        )
        return both[:, :, 0], both[:, :, 1:]

    @cached_property
    def _differentiated(self) -> tuple[Monomials, Array]:
        """Coefficients (N', n, 1 + r, k) of the derivatives, in monomials of a degree lower."""
        return self.monomials.differentiated(self.coefficients)

    def solve(
        self, U: Array, s: Array, Q: Array | None = None, *, iterations: int = _ITERATIONS
    ) -> Points:
        """Find the q with ``f(q) = x(u)`` and label s, at every row of U (K, k), by Newton's
        method.

        Parameters
        ----------
        U, s : (K, k) and (K, r) arrays
        Q : (K, n) array, optional
            Initial configurations; by default q_ref + n_ref s.
        """
        cell = self.cell
        q_ref, n_ref = self.reference(U)
        if Q is None:
            Q = q_ref + np.einsum("Knr,Kr->Kn", n_ref, s)
        p_goal, R_goal = cell.placements(U)
        fast = compiled_chain(cell.task)
        if fast is not None:
            Q, R, J, residual, size = fast.solved(
                (p_goal, R_goal),
                (q_ref, n_ref, s),
                Q,
                iterations=iterations,
                longest=_STEP,
                tolerance=_EXACT,
            )
            found = (size < 1e-6) & (residual < 1e-9)
            return Points(U, Q, R, J, q_ref, n_ref, residual, found)

        def correction(Q: Array, on: NDArray[np.intp]) -> Array:
            p, R, J = placed(cell.task, Q)
            e = cell.errors(p_goal[on], R_goal[on], p, R)
            g = s[on] - np.einsum("Knr,Kn->Kr", n_ref[on], Q - q_ref[on])
            J_V = np.concatenate([J, np.swapaxes(n_ref[on], 1, 2)], axis=1)
            return solved(J_V, np.concatenate([e, g], axis=1))

        Q, size = newton_rows(correction, Q, longest=_STEP, tolerance=_EXACT, iterations=iterations)
        p, R, J = placed(cell.task, Q)
        e = cell.errors(p_goal, R_goal, p, R)
        found = (size < 1e-6) & (np.abs(e).max(axis=1) < 1e-9)
        return Points(U, Q, R, J, q_ref, n_ref, np.abs(e).max(axis=1), found)

    def derivative(self, at: Points, ds: Array) -> tuple[Array, Array]:
        r"""Differentiate the function through points with respect to u, and to the label.

        .. math:: \begin{bmatrix} J \\ n_{ref}^T \end{bmatrix} \partial F = \begin{bmatrix} E \\
                  \partial s + n_{ref}^T \partial q_{ref}
                  - (\partial n_{ref}^T)(F - q_{ref}) \end{bmatrix}

        Parameters
        ----------
        at
            Result of :meth:`solve`.
        ds : (K, r, k) array
            ∂s/∂u.

        Returns
        -------
        dF : (K, n, k + l) array
            Its last l columns are the constant ones of :attr:`Cell.along`.
        B : (K, n, r) array
            ∂F/∂s.
        """
        m = self.cell.task.m
        dq, dn = self.slopes(at.U)
        below = (
            ds
            + np.einsum("Knr,Knk->Krk", at.n_ref, dq)
            - np.einsum("Knrk,Kn->Krk", dn, at.Q - at.q_ref)
        )
        n_T, r = np.swapaxes(at.n_ref, 1, 2), below.shape[1]
        below = np.concatenate([below, n_T @ self.cell.along], axis=2)
        J_V, E = np.concatenate([at.J, n_T], axis=1), self.cell.twists(at.U, at.R)
        onto = np.zeros((len(J_V), m + r, r))
        onto[:, m:] = np.eye(r)
        both = solved(J_V, np.concatenate([np.concatenate([E, below], axis=1), onto], axis=2))
        return both[:, :, : E.shape[2]], both[:, :, E.shape[2] :]


@dataclass(frozen=True, eq=False)
@read_only
class Points:
    """Configurations of a candidate function at several poses, and the kinematics there.

    Attributes
    ----------
    U, Q : (K, k) and (K, n) arrays
    R, J : (K, 3, 3) and (K, m, n) arrays
        Rotation of the frame, and Jacobian, at Q.
    q_ref, n_ref : (K, n) and (K, n, r) arrays
        Reference and null space of the chart at U.
    residual : (K,) array
        Largest entry of the task error, m or rad.
    found : (K,) array of bool
        Whether the equations are solved.
    """

    U: Array
    Q: Array
    R: Array
    J: Array
    q_ref: Array
    n_ref: Array
    residual: Array
    found: NDArray[np.bool_]

    def chosen(self, at: NDArray[np.bool_ | np.intp] | slice) -> Points:
        """Select some of the points."""
        return Points(*(getattr(self, name)[at] for name in self.__dataclass_fields__))

    def replaced(self, at: NDArray[np.intp], other: Points) -> Points:
        """Replace some of the points."""
        arrays = {name: values.copy() for name, values in vars(self).items()}
        for name, values in arrays.items():
            values[at] = getattr(other, name)
        return Points(**arrays)
