"""pink task that holds h(q) = c for repeatable motion; requires the extra ``pink``.

Letters: n joints of the design, nv joint velocities of pink's model, r potentials h.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...base.arguments import Array, require_type, vector
from ...base.errors import InputError
from ...model.several_frames import one_frame
from ...strategies import RepeatableInverse

try:
    from pink import Configuration
    from pink.tasks import Task as PinkTask
except ImportError as error:
    raise ImportError("this module requires pink; run `pip install pin-pink`") from error


class RepeatableTask(PinkTask):
    """pink task that holds h(q) = c; together with a frame task, it makes the motion repeatable.

    pink solves for joint velocities that serve several tasks. A frame task leaves a self-motion
    free; the r potentials h of a design, held at the level c, determine it. The set h(q) = c is a
    leaf. The error is ``e(q) = h(q) − c``, its Jacobian ``∂h/∂q``. The joints are found in pink's
    model by name; other joints are not affected.

    Parameters
    ----------
    inverse
        Repeatable inverse, such as ``design.inverse``. Its task should control the same frame as
        pink's frame task, in the same coordinates, such as a pose.
    cost : float or (r,) numbers
        Weight of each of the r errors relative to the costs of other tasks. This task and the frame
        task do not conflict: together they determine all joints.
    gain
        Fraction of the error that is corrected per step, from 0 to 1; below 1, the arm returns
        gradually after a disturbance.
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
        one_frame(inverse.task, "a pink task")
        super().__init__(cost=cost, gain=gain, lm_damping=lm_damping)
        self.inverse = inverse
        self.leaf: Array | None = None
        self._names = inverse.task.joint_names
        self._model: pin.Model | None = None
        self._at = self._columns = np.zeros(0, int)
        self._circular = np.zeros(0, bool)

    def set_target(self, leaf: ArrayLike) -> None:
        """Set the level c (r,) to hold, such as ``inverse.leaf(q)``."""
        self.leaf = vector(leaf, self.inverse.task.r, "the level c", "one per potential")

    def set_target_from_configuration(self, configuration: Configuration) -> None:
        """Set the level c to hold: c = h(q), with q from a configuration of pink."""
        self.set_target(self.inverse.potentials.value(self._joints(configuration)))

    def compute_error(self, configuration: Configuration) -> Array:
        """Evaluate the error e = h(q) − c, (r,), at a configuration of pink.

        InputError is raised if no level c is set.
        """
        if self.leaf is None:
            raise InputError(
                "no level c is set; call set_target_from_configuration(configuration) first"
            )
        return self.inverse.potentials.value(self._joints(configuration)) - self.leaf

    def compute_jacobian(self, configuration: Configuration) -> Array:
        """Evaluate ∂h/∂q of the potentials for pink's nv joint velocities: (r, nv).

        Columns of joints that the design does not have are 0.
        """
        V = self.inverse.potentials.gradient(self._joints(configuration))
        J = np.zeros((V.shape[1], configuration.model.nv))
        J[:, self._columns] = V.T
        return J

    def _joints(self, configuration: Configuration) -> Array:
        """Extract the design's joint positions (n,) from pink's configuration, rad or m.

        Pinocchio stores a continuous joint as (cos, sin), which becomes an angle.
        """
        if configuration.model is not self._model:
            self._find(configuration.model)
        q = configuration.q[self._at]
        if self._circular.any():  # Pinocchio represents a continuous joint as (cos, sin)
            turned = self._at[self._circular]
            q[self._circular] = np.arctan2(configuration.q[turned + 1], configuration.q[turned])
        return q

    def _find(self, model: pin.Model) -> None:
        """Find the design's joints in pink's model by name, and store their indices in q and v.

        A mask of the continuous joints, which are (cos, sin) pairs in q, is stored, too. InputError
        is raised if a joint is missing.
        """
        missing = [name for name in self._names if not model.existJointName(name)]
        if missing:
            raise InputError(
                f"pink's model has no joint {missing[0]!r}, which the design requires; "
                "load the file of the design's robot"
            )
        joints = [model.joints[model.getJointId(name)] for name in self._names]
        self._at = np.array([joint.idx_q for joint in joints])
        self._columns = np.array([joint.idx_v for joint in joints])
        self._circular = np.array([joint.nq == 2 for joint in joints])
        self._model = model

    def __repr__(self) -> str:
        weights = f"cost={self.cost}, gain={self.gain}, lm_damping={self.lm_damping}"
        return f"RepeatableTask({self.inverse.task!r}, {weights})"
