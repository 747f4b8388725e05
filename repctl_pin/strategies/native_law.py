"""The control law of a repeatable inverse in the native library (arm.c), for one thread."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin

from ..arguments import Array
from ..errors import SingularityError
from ..model.task import Task
from ..native import CALL, filled_struct, library
from ..redundancy.augmented import SINGULAR
from .fast_loop import StepLimits, failure

_WHOLE_STEP = -1.0
_TWIST, _LEAF, _BOUNDED = 1, 2, 4
_SINGULAR = 1


@cache
def _held() -> ctypes.PyDLL:
    """Load the library once more: its functions then keep Python's global interpreter lock."""
    native = library()
    assert native is not None
    return ctypes.PyDLL(native._name)


class NativeLaw:
    """Control law in C on arguments that are already checked, with the memory of one thread.

    Calls for one configuration keep Python's global interpreter lock, which is faster; calls for
    batches release it.

    Parameters
    ----------
    task
        Task, for error messages.
    arm
        Its struct Arm with potentials, from :func:`native_arm`.
    """

    def __init__(self, task: Task, arm: Any) -> None:
        n, m, r = task.n, task.m, task.r
        sizes = {"q": n, "xdot": m, "twist": 6, "leaf": r, "limit": n}
        sizes |= {"target": 16, "numbers": 5, "result": n}
        self._task, self._arm = task, arm
        parts = {name: np.zeros(size) for name, size in sizes.items()}
        self._call, _ = filled_struct(CALL, {}, parts, {"arm": ctypes.addressof(arm)})
        self._address = ctypes.c_void_p(ctypes.addressof(self._call))
        self._q, self._xdot, self._twist = parts["q"], parts["xdot"], parts["twist"]
        self._leaf, self._limit = parts["leaf"], parts["limit"]
        self._target = parts["target"].reshape(4, 4)
        self._numbers, self._result = parts["numbers"], parts["result"]
        self._run_velocity, self._run_step = _held().call_velocity, _held().call_step
        self._run_leaf = _held().call_leaf

    def velocity(self, q: Array, xdot: Array) -> Array:
        """Compute q̇ (n,) with ``J q̇ = ẋ`` and ``Vᵀ q̇ = 0``."""
        self._q[:] = q
        self._xdot[:] = xdot
        status = self._run_velocity(self._address)
        if status:
            raise self._refused(status, q)
        return self._result.copy()

    def leaf(self, q: Array) -> Array:
        """Evaluate c = h(q) (r,)."""
        self._q[:] = q
        status = self._run_leaf(self._address)
        if status:
            raise self._refused(status, q)
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
        """Compute the next q (n,)."""
        given = 0
        self._q[:] = q
        self._target[:] = target.homogeneous
        numbers = self._numbers
        numbers[0] = dt
        numbers[1] = _WHOLE_STEP if gain is None else gain
        if leaf is not None:
            self._leaf[:] = leaf
            given |= _LEAF
        if twist is not None:
            self._twist[:] = twist
            given |= _TWIST
        if bounds is not None:
            self._limit[:] = bounds.velocity_limit
            numbers[2] = bounds.damping
            given |= _BOUNDED
        status = self._run_step(self._address, given)
        if status:
            raise self._refused(status, q, target)
        return self._result.copy()

    def report(self) -> tuple[float, float]:
        """Return the damping λ of the last step, and the factor of the speed limits."""
        return float(self._numbers[3]), float(self._numbers[4])

    def inverses(self, Q: Array) -> Array:
        """Evaluate G_r (K, n, m) at the rows of Q (K, n)."""
        G = np.empty((len(Q), self._task.n, self._task.m))
        return self._many("call_inverses", Q, G)

    def velocities(self, Q: Array, Xdot: Array) -> Array:
        """Compute q̇ (K, n) at the rows of Q (K, n) and Ẋ (K, m)."""
        return self._many("call_velocities", Q, Xdot, np.empty((len(Q), self._task.n)))

    def _many(self, name: str, *arrays: Array) -> Array:
        """Call a C function on all rows of arrays, the last of which receives the results."""
        native = library()
        assert native is not None
        kept = [np.ascontiguousarray(array) for array in arrays]
        run = native[name]
        run.restype = ctypes.c_long
        rows = (ctypes.c_void_p(array.ctypes.data) for array in kept)
        done = run(ctypes.byref(self._arm), ctypes.c_long(len(kept[0])), *rows)
        if done < len(kept[0]):
            raise SingularityError(f"{SINGULAR}, at row {done}")
        return kept[-1]

    def _refused(self, status: int, q: Array, target: Any = None) -> Exception:
        """Create the exception for a status of C."""
        if status != _SINGULAR and target is not None and np.isfinite(q).all():
            self._task.error(q, target)  # raises if it is not a rotation
        bad = 0.0 if status == _SINGULAR else np.nan
        return failure(self._task, q, np.array([bad]))
