"""A pink task that gives a pink program a repeatable null space; it needs the extra ``pink``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arguments import Array, require_type, vector
from ..errors import InputError
from ..strategies import RepeatableInverse

try:
    from pink import Configuration
    from pink.tasks import Task as PinkTask
except ImportError as error:
    raise ImportError("this needs pink: pip install pin-pink") from error


class RepeatableTask(PinkTask):
    """Hold h(q) = c: beside a frame task, pink's arm then closes every closed path.

    ``e(q) = h(q) − c``, with the Jacobian ``∂h/∂q``. The joints are found in pink's model by their
    names; its other joints are left alone.

    Parameters
    ----------
    inverse
        A repeatable inverse, such as ``design.inverse``; its task's frame and kind should be the
        frame task's.
    cost : float or (r,) numbers
        Weight of each of the r errors beside the other tasks' costs. The two kinds of tasks do not
        compete: together they fix all joints.
    gain
        Share of the error that is undone in one step, from 0 to 1; below 1 the arm returns slowly
        after a push.
    lm_damping
        pink's Levenberg–Marquardt damping.
    """

    def __init__(
        self,
        inverse: RepeatableInverse,
        cost: float | Sequence[float] = 1.0,
        gain: float = 1.0,
        lm_damping: float = 0.0,
    ) -> None:
        require_type(
            inverse, RepeatableInverse, "inverse", "a repeatable inverse, such as design.inverse"
        )
        super().__init__(cost=cost, gain=gain, lm_damping=lm_damping)
        if inverse.task.coordinates is not None:
            raise InputError("a pink task needs a design in the robot's own joint coordinates")
        self.inverse = inverse
        self.leaf: Array | None = None
        self._names = inverse.task.joint_names
        self._model: pin.Model | None = None
        self._at = self._columns = np.zeros(0, int)
        self._circular = np.zeros(0, bool)

    def set_target(self, leaf: ArrayLike) -> None:
        """Set c (r,), the leaf to stay on: ``inverse.leaf(q)``."""
        self.leaf = vector(leaf, self.inverse.task.r, "the leaf c", "one per potential")

    def set_target_from_configuration(self, configuration: Configuration) -> None:
        """Stay on the leaf of a configuration."""
        self.set_target(self.inverse.potentials.value(self._joints(configuration)))

    def compute_error(self, configuration: Configuration) -> Array:
        """Evaluate h(q) − c: (r,)."""
        if self.leaf is None:
            raise InputError(
                "no leaf is set; call set_target_from_configuration(configuration) at the start"
            )
        return self.inverse.potentials.value(self._joints(configuration)) - self.leaf

    def compute_jacobian(self, configuration: Configuration) -> Array:
        """Evaluate ∂h/∂q: (r, nv), 0 in the columns of joints that are not the design's."""
        V = self.inverse.potentials.gradient(self._joints(configuration))
        J = np.zeros((V.shape[1], configuration.model.nv))
        J[:, self._columns] = V.T
        return J

    def _joints(self, configuration: Configuration) -> Array:
        """Take the design's joints (n,) out of pink's configuration: one number each."""
        if configuration.model is not self._model:
            self._find(configuration.model)
        q = configuration.q[self._at]
        if self._circular.any():  # Pinocchio keeps a continuous joint as (cos, sin)
            turned = self._at[self._circular]
            q[self._circular] = np.arctan2(configuration.q[turned + 1], configuration.q[turned])
        return q

    def _find(self, model: pin.Model) -> None:
        """Find the joints in a model: where in q, where in v, and which are (cos, sin) pairs."""
        missing = [name for name in self._names if not model.existJointName(name)]
        if missing:
            raise InputError(f"pink's model has no joint {missing[0]!r}, which the design needs")
        joints = [model.joints[model.getJointId(name)] for name in self._names]
        self._at = np.array([joint.idx_q for joint in joints])
        self._columns = np.array([joint.idx_v for joint in joints])
        self._circular = np.array([joint.nq == 2 for joint in joints])
        self._model = model

    def __repr__(self) -> str:
        return f"RepeatableTask({self.inverse.task!r}, cost={self.cost}, gain={self.gain}, lm_damping={self.lm_damping})"
