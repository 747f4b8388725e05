"""The extended Jacobian of Baillieul: every motion keeps ``h = Nᵀ ∇U`` constant.

U(q) is a function that is kept stationary, and N (n, r) a basis of the null space of J. The r
potentials h are constant in a motion, which so stays on a leaf, the set h(q) = c. For r > 1, N is
the basis closest to N_ref, the one at a reference configuration.

``_Given`` is a potential U given as a function, with its derivatives. ``_Posture`` is the potential
``U = ½ ‖q − posture‖²``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array, evaluated, function, row, vector
from ..base.errors import InputError, SingularityError
from ..model.task import Task, own_task
from ..potentials.basis import Potentials
from ..potentials.custom import CustomPotentials
from ..redundancy.inverses import pseudoinverse
from ..redundancy.nullspace import nullspace
from .repeatable import RepeatableInverse


class ExtendedJacobian(RepeatableInverse):
    """``q̇ = G_r ẋ`` with ``V = ∂hᵀ/∂q``, ``h = Nᵀ ∇U``, the extended Jacobian.

    U is a function to be kept stationary, such as the distance from a posture; the r potentials
    that the controller holds constant are h. On the leaf h = 0, U is stationary among the
    configurations with the same x = f(q). N is a null-space basis that depends on q alone. For
    r = 1, it is the unit null vector with ``det [J; Nᵀ] > 0``. For r > 1, it is the basis closest
    to the one at a reference configuration, on which the leaves h ≠ 0 then depend.

    Parameters
    ----------
    task
        The task to control.
    potential
        U: a posture (n,), rad (m for prismatic joints), for ``U = ½ ‖q − posture‖²``, or a function
        q (n,) → U.
    gradient, hessian
        Functions q → ∇U (n,) and q → ∂²U/∂q² (n, n), if U is a function. Without them U is
        differentiated numerically, with relative errors of about 1e-9 and 1e-5.
    reference : (n,) array, optional
        Reference configuration of N for r > 1; by default the posture, or the task's reference.

    Raises
    ------
    InputError
        If the potential is neither a posture nor a function, or has the wrong size, or the task is
        not redundant.

    Examples
    --------
    >>> G = rp.ExtendedJacobian(task, q0)  # stays where ½ ‖q − q0‖² is minimal
    >>> bool(rp.follow(G, path, q0, cycles=2, steps=100).drift[-1] < 1e-6)  # rad
    True
    """

    def __init__(
        self,
        task: Task,
        potential: ArrayLike | Callable[[Array], float],
        *,
        gradient: Callable[[Array], ArrayLike] | None = None,
        hessian: Callable[[Array], ArrayLike] | None = None,
        reference: ArrayLike | None = None,
    ) -> None:
        task = own_task(task)
        if task.r < 1:
            raise InputError(
                f"the task is not redundant (r = {task.r}), "
                "but an extended Jacobian requires r ≥ 1",
                remedy="use a kind of task with fewer coordinates",
            )
        if callable(potential):
            for given, name in ((gradient, "gradient"), (hessian, "hessian")):
                if given is not None:
                    function(given, name, "a function of q")
            shape: _Posture | _Given = _Given(potential, gradient, hessian)
            anchor = task.reference if reference is None else reference
        else:
            posture = vector(potential, task.n, "a posture (or give U as a function)")
            shape = _Posture(posture)
            anchor = posture if reference is None else reference
        super().__init__(task, _ExtendedMap(task, shape, nullspace(task.jacobian(anchor))))


class _ExtendedMap(Potentials):
    """The r potentials ``h = Nᵀ ∇U`` of an extended Jacobian, and their gradients V = ∂hᵀ/∂q.

    With these potentials an extended Jacobian is an ordinary repeatable inverse. U is the function
    to be kept stationary, and N a basis of the null space of J.
    """

    def __init__(self, task: Task, potential: _Posture | _Given, N_reference: Array) -> None:
        self.task, self.potential, self.N_reference, self.n = (task, potential, N_reference, task.n)

    def value(self, q: Array) -> Array:
        """Evaluate h(q) = Nᵀ ∇U (r,), which is 0 where U is stationary in the self-motion."""
        q = np.asarray(q, float)
        N, _ = self._aligned(self.task.jacobian(q)[None], q[None])
        return N[0].T @ self.potential.gradients(q[None])[0]

    def gradients(self, Q: Array) -> Array:
        r"""Evaluate V = ∂hᵀ/∂q at every row of Q (K, n): (K, n, r).

        .. math:: \frac{\partial h}{\partial q_k}
                  = \frac{\partial N}{\partial q_k}^T \nabla U + N^T \nabla^2 U e_k, \qquad
                  \frac{\partial N}{\partial q_k} = -J^+ H_k N + N Z_k,

        with :math:`H_k = \partial J/\partial q_k`, the k-th unit vector :math:`e_k`, and the
        antisymmetric :math:`Z_k` that keeps :math:`S = N^T N_{ref}` symmetric: :math:`Z_k S + S Z_k
        = B_k - B_k^T`, :math:`B_k = -N^T H_k^T J^{+T} N_{ref}`.
        """
        Q = np.asarray(Q, float)
        J, H = self.task.jacobians(Q), self.task.hessians(Q)  # (K, m, n), (K, m, n, n)
        N, S = self._aligned(J, Q)
        g = self.potential.gradients(Q)
        U2 = self.potential.hessians(Q)
        J_plus = pseudoinverse(J)
        HN = np.einsum("Kaik,Kir->Kark", H, N)  # H_k N
        pulled = np.einsum("Kia,Ki->Ka", J_plus, g)  # J⁺ᵀ ∇U
        V = U2 @ N - np.einsum("Kark,Ka->Kkr", HN, pulled)  # (K, n, r)
        r = N.shape[-1]
        if r > 1:
            B = -np.einsum("Kark,Kas->Krsk", HN, np.swapaxes(J_plus, -1, -2) @ self.N_reference)
            skew = B - np.swapaxes(B, 1, 2)  # (K, r, r, n)
            s, T = np.linalg.eigh(S)
            turned = np.einsum("Kra,Krsk,Ksb->Kabk", T, skew, T)
            turned /= (s[:, :, None] + s[:, None, :])[..., None]
            Z = np.einsum("Kra,Kabk,Ksb->Krsk", T, turned, T)
            along = np.einsum("Kir,Ki->Kr", N, g)  # Nᵀ ∇U
            V += np.einsum("Krsk,Kr->Kks", Z, along)  # Z_kᵀ Nᵀ ∇U
        return V

    def _aligned(self, J: Array, Q: Array) -> tuple[Array, Array]:
        """Evaluate a null-space basis N (K, n, r) that is smooth in q, and ``S = Nᵀ N_ref``.

        J (K, m, n) are the Jacobians at the rows of Q. For r = 1, N is the unit null vector with
        ``det [J; Nᵀ] > 0``; for r > 1, the basis closest to N_ref, the one at the reference
        configuration. S (K, r, r) is symmetric. SingularityError is raised if a direction of the
        null space is perpendicular to N_ref, for r > 1.
        """
        N = nullspace(J)
        alignment = np.swapaxes(N, -1, -2) @ self.N_reference
        if N.shape[-1] == 1:  # n̂ of (41), with det [J; n̂ᵀ] > 0: smooth wherever J has full rank
            J_N = np.concatenate([J, np.swapaxes(N, -1, -2)], axis=1)
            side = np.sign(np.linalg.det(J_N))[:, None, None]
            return N * side, alignment * side
        U, s, Vt = np.linalg.svd(alignment)
        if (s[:, -1] < 1e-9).any():
            at = row(Q[int(np.argmin(s[:, -1]))])
            raise SingularityError(
                f"at q = {at}, a direction of the null space is perpendicular to the null space "
                "at the reference configuration",
                remedy="choose a reference= nearer to this q",
            )
        return N @ U @ Vt, np.einsum("Kar,Ka,Kas->Krs", Vt, s, Vt)


class _Posture:
    """Potential ``U = ½ ‖q − posture‖²``, which keeps an extended Jacobian near a posture."""

    def __init__(self, posture: Array) -> None:
        self.posture = posture

    def gradients(self, Q: Array) -> Array:
        """Evaluate ``∇U = q − posture`` at every row of Q: (K, n)."""
        return Q - self.posture

    def hessians(self, Q: Array) -> Array:
        """Evaluate ∂²U/∂q², the identity, at every row of Q: (K, n, n)."""
        return np.broadcast_to(np.eye(Q.shape[1]), (*Q.shape, Q.shape[1]))


class _Given:
    """Potential U given as a function, with given or numerical derivatives.

    The methods :meth:`gradients` and :meth:`hessians` evaluate ∇U (K, n) and ∂²U/∂q² (K, n, n) at
    the rows of Q, as those of :class:`_Posture` do. The functions ``gradient`` and ``hessian`` of
    the user return ∇U (n,) and ∂²U/∂q² (n, n) at q; None means central differences.
    """

    def __init__(
        self,
        function: Callable[[Array], float],
        gradient: Callable[[Array], ArrayLike] | None,
        hessian: Callable[[Array], ArrayLike] | None,
    ) -> None:
        given = function if gradient is None else (function, gradient)
        self._U = CustomPotentials([given], names=["U"])
        self._hessian = hessian

    def gradients(self, Q: Array) -> Array:
        """Evaluate ∇U, or central differences of U, at every row of Q: (K, n).

        U is the user's function, which the extended Jacobian keeps stationary.
        """
        return self._U.gradients(Q)[:, :, 0]

    def hessians(self, Q: Array) -> Array:
        """Evaluate ∂²U/∂q², or central differences of ∇U, at every row of Q: (K, n, n).

        The differences are made symmetric. Their step is longer if ∇U is numerical, too.
        """
        K, n = Q.shape
        if self._hessian is not None:
            what = "the Hessian of potential U"
            return np.array([evaluated(self._hessian, q, (n, n), what) for q in Q])
        step = 1e-4 if any(self._U.numerical) else 1e-6
        moves = step * np.eye(n)
        near = np.concatenate([Q[:, None] + moves, Q[:, None] - moves])  # (2 K, n, n)
        ahead, behind = self.gradients(near.reshape(-1, n)).reshape(2, K, n, n)
        H = (ahead - behind) / (2 * step)
        return (H + np.swapaxes(H, 1, 2)) / 2
