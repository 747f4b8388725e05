"""The control law of a repeatable inverse in the native library (arm.c), for one thread.

The arguments of the C functions are in one block of memory, the struct Call, which is allocated
once: a control loop then allocates nothing but its result. The inverse keeps r potentials h(q)
constant, with the gradients V = ∂hᵀ/∂q; a leaf is the set h(q) = c, and c (r,) its level. With the
Jacobian J, J_V = [J; Vᵀ]. ẋ (m,) is the task velocity, f(q) is the pose of the frame, and x − f(q)
the task error (m,) of a target x.

``Potentials`` are r functions h(q) that a repeatable controller holds constant. ``StepLimits`` are
the limits of a step: joint speeds (n,), and the maximum damping.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin

from ..base.arguments import Array
from ..base.errors import InputError
from ..model.task import Task
from ..native import CALL, filled_struct, library
from ..potentials.basis import Potentials
from ..redundancy.augmented import augmented_inverse
from .step_arguments import StepLimits, failure

_WHOLE_STEP = -1.0
_TWIST, _LEAF, _BOUNDED = 1, 2, 4
_SINGULAR = 1


@cache
def holding_library() -> ctypes.PyDLL:
    """Load the native library so that its functions keep Python's global interpreter lock.

    Keeping the lock is faster for one configuration. Batches load the library in the usual way,
    which releases the lock.
    """
    native = library()
    assert native is not None
    return ctypes.PyDLL(native._name)


def call_memory(task: Task, arm: Any, **more: Array) -> tuple[dict[str, Array], Any]:
    """Allocate the arguments of C functions for one thread: the struct Call of law_calls.c.

    ``arm`` is the struct ARM, and ``more`` are arrays for further members of Call, by name. Return
    the arrays of all members by name, and a pointer to the struct, which is the argument of the C
    functions. The memory is allocated once, because allocation takes longer than the arithmetic of
    a step.
    """
    n, m, r = task.n, task.m, task.r
    sizes = {"q": n, "xdot": m, "twist": task.twist_size, "leaf": r, "limit": n}
    sizes |= {"target": 16 * len(task.frames), "numbers": 5, "result": n, "inverse": n * m}
    parts = {name: np.zeros(size) for name, size in sizes.items()} | more
    call, _ = filled_struct(CALL, {}, parts, {"arm": ctypes.addressof(arm)})
    call.held["arm"] = arm
    return call.held, ctypes.byref(call)  # which holds the struct, and it the arrays


class NativeLaw:
    """Control law in C, for checked arguments; an object must not be shared between threads.

    Calls for one configuration keep Python's global interpreter lock, which is faster; calls for
    batches release it.

    Parameters
    ----------
    task, potentials
        Task and potentials h of the repeatable inverse.
    arm
        Struct :data:`ARM` of both, see :func:`native_arm`.
    """

    def __init__(self, task: Task, potentials: Potentials, arm: Any) -> None:
        self._task = task
        self._potentials = potentials
        self.arm = arm
        parts, self._call = call_memory(task, arm)
        self._q = parts["q"]
        self._xdot = parts["xdot"]
        self._twist = parts["twist"]
        self._leaf = parts["leaf"]
        self._limit = parts["limit"]
        self._target = parts["target"].reshape(-1, 4)
        self._numbers = parts["numbers"]
        self._result = parts["result"]
        self._inverse = parts["inverse"].reshape(task.n, task.m)
        held = holding_library()
        self._run_inverse = held.call_inverse
        self._run_velocity = held.call_velocity
        self._run_step = held.call_step
        self._run_leaf = held.call_leaf

    def velocity(self, q: Array, xdot: Array) -> Array:
        """Compute q̇ (n,) with ``J q̇ = ẋ`` and ``Vᵀ q̇ = 0``.

        The frame moves with ẋ, and the arm stays on its leaf, because V are the gradients of the
        potentials. A SingularityError is raised where [J; Vᵀ] is singular, and an InputError for
        numbers that are not finite.
        """
        self._q[...] = q
        self._xdot[...] = xdot
        status = self._run_velocity(self._call)
        if status:
            raise self._refused(status, q)
        return self._result.copy()

    def inverse(self, q: Array) -> Array:
        """Evaluate the repeatable inverse G_r (n, m) at q (n,).

        A SingularityError is raised where J_V is singular, and an InputError if q is not finite.
        """
        self._q[...] = q
        status = self._run_inverse(self._call)
        if status:
            raise self._refused(status, q)
        return self._inverse.copy()

    def leaf(self, q: Array) -> Array:
        """Evaluate the level c = h(q) (r,) of the potentials, which identifies the leaf of q.

        An InputError is raised if q or h(q) is not finite.
        """
        self._q[...] = q
        if self._run_leaf(self._call):
            raise InputError(
                "is so large that h(q) is not finite",
                argument="q",
                remedy="give a configuration within the joint limits",
            )
        return self._result[: self._task.r].copy()

    def step(
        self,
        q: Array,
        target: pin.SE3,
        dt: float,
        twist: Array | None,
        leaf: Array | None,
        gain: float | None,
        bounds: StepLimits | None,
    ) -> Array:
        """Compute ``q + J_V⁻¹ (dt [ẋ; 0] + K dt [x − f(q); c − h(q)])`` (n,), the next q.

        ``target`` is the placement x, ``twist`` the feed-forward (v, ω), m/s and rad/s, whose task
        coordinates are ẋ, and ``leaf`` the level c. If ``twist`` or ``leaf`` is None, its term is
        omitted. ``gain`` is K, 1/s; None removes the whole error in one step. ``bounds`` are the
        speed limits and the maximum damping; with None, the step is neither shortened nor damped.
        ``dt`` is the duration of the step, s. If C finds no step, an InputError or a
        SingularityError is raised.
        """
        given = 0
        self._q[...] = q
        self._target[...] = target.homogeneous
        numbers = self._numbers
        numbers[0] = dt
        numbers[1] = _WHOLE_STEP if gain is None else gain
        if leaf is not None:
            self._leaf[...] = leaf
            given |= _LEAF
        if twist is not None:
            self._twist[...] = twist
            given |= _TWIST
        if bounds is not None:
            self._limit[...] = bounds.velocity_limit
            numbers[2] = bounds.damping
            given |= _BOUNDED
        status = self._run_step(self._call, given)
        if status:
            raise self._refused(status, q, target)
        return self._result.copy()

    def report(self) -> tuple[float, float]:
        """Return (λ, factor) of the last step; (0, 1) if it had no ``bounds``.

        λ is the damping. The factor, 0 to 1, is that by which the step was shortened to the joint
        speed limits; 1 if it was not.
        """
        return float(self._numbers[3]), float(self._numbers[4])

    def inverses(self, Q: Array) -> Array:
        """Evaluate G_r (K, n, m), the repeatable inverse, at the rows of Q (K, n).

        If a row is singular, NumPy computes all rows again, and its error gives the number of
        singular rows.
        """
        task, h = self._task, self._potentials
        G = np.empty((len(Q), task.n, task.m))
        if self._run_rows("call_inverses", Q, G):
            return G
        J, V = task.jacobians(Q), h.gradients(Q)  # for the error
        return augmented_inverse(J, V)[:, :, : task.m]

    def velocities(self, Q: Array, Xdot: Array) -> Array:
        """Compute q̇ (K, n) of the repeatable inverse at the rows of Q (K, n) and Ẋ (K, m).

        If C fails at a row, NumPy computes all rows, and raises the error.
        """
        Qdot = np.empty((len(Q), self._task.n))
        if self._run_rows("call_velocities", Q, Xdot, Qdot):
            return Qdot
        return (self.inverses(Q) @ Xdot[..., None])[..., 0]

    def _run_rows(self, name: str, *arrays: Array) -> bool:
        """Call the C function ``name`` on all rows of arrays; the last array receives the results.

        Return True if all rows were computed, and False if the function failed at a row, such as a
        singular one.
        """
        native = library()
        assert native is not None
        kept = [np.ascontiguousarray(array) for array in arrays]
        run = native[name]
        run.restype = ctypes.c_long
        rows = (ctypes.c_void_p(array.ctypes.data) for array in kept)
        count = len(kept[0])
        done: int = run(ctypes.byref(self.arm), ctypes.c_long(count), *rows)
        return done == count

    def _refused(self, status: int, q: Array, target: Any = None) -> Exception:
        """Create the exception for a status of C: InputError or SingularityError, with its message.

        ``status`` is 1 for a singularity; other values mean numbers that are not finite, in q or in
        the target.
        """
        if status != _SINGULAR and target is not None and np.isfinite(q).all():
            self._task.error(q, target)  # raises if it is not a rotation
        bad = 0.0 if status == _SINGULAR else np.nan
        return failure(self._task, q, np.array([bad]))
