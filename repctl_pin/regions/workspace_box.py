"""Design region Ω of all configurations whose frame lies in a box of the workspace.

This region is the alternative of the paper (docs/notation.md) to a box in joint space. Letters: n
joints; Q (K, n), K configurations, rad (m for prismatic joints); J, the task Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import (
    MOST_NODES,
    Array,
    as_configurations,
    as_int,
    freeze,
    per_joint,
    positive,
    read_only,
    require_type,
    vector,
)
from ..base.errors import InputError
from ..model.several_frames import one_frame
from ..model.task import Task, own_task, require_task
from .box import Box
from .region import Density, Region, check_density, evaluate_density, normalised, span

_MOST_DRAWS = 2**18


@dataclass(frozen=True, eq=False, repr=False)
@read_only
class WorkspaceBox(Region):
    """All q of a joint-space box that bring the frame into a box of the workspace.

    The frame's position p satisfies ``|p_i − position_i| ≤ half_width_i``. The mean over the region
    is an integral over the task coordinates x and, for each x, over the set of configurations that
    reach x, with the volume element dσ. By the coarea formula, ``∫∫ … dσ dx = ∫ … √det(J Jᵀ) dq``,
    so each q has the weight ``√det(J Jᵀ)``.

    Parameters
    ----------
    task
        The task; the box bounds its frame's position, m.
    position, half_width : (3,) arrays
        Centre and half-widths of the workspace box, m, base frame; two numbers each for the tasks
        ``xy``, ``xz``, ``yz``. One half-width stands for all axes.
    within : Box
        Box in joint space, from which the configurations of the region are taken.
    density : function, optional
        Function Q (K, n) → (K,): factors ≥ 0 of the weights ``√det(J Jᵀ)``; by default 1.

    Attributes
    ----------
    center : (n,) array
        Configuration in the region: among 16 points of it, the nearest to the centre of ``within``.

    Raises
    ------
    InputError
        If sizes do not fit the task, a half-width is not positive, or no configuration of
        ``within`` reaches the box.

    Examples
    --------
    >>> p0 = task.placement(q0).translation[:2]  # m
    >>> region = rp.WorkspaceBox(task, p0, 0.1, within=rp.Box(q0, 0.4))
    >>> region.contains([q0])
    array([ True])
    """

    task: Task
    position: Array
    half_width: Array
    within: Box
    density: Density | None = None
    center: Array = field(init=False)

    def __init__(
        self,
        task: Task,
        position: ArrayLike,
        half_width: ArrayLike,
        *,
        within: Box,
        density: Density | None = None,
    ) -> None:
        task = own_task(one_frame(require_task(task), "a workspace box"))
        axes = task.kind.rows[task.kind.linear]
        require_type(within, Box, "within", "a box in joint space, such as rp.Box(q0, 0.5)")
        middle = vector(position, len(axes), "the center of a workspace box", "m")
        half = per_joint(
            half_width,
            len(axes),
            "the half-widths of a workspace box",
            "one per axis, m",
            finite=True,
        )
        check_density(density)
        if within.n != task.n:
            raise InputError(
                f"within= is a box in {within.n} joints, but the task has {task.n}; "
                f"give a box in the {task.n} joints of the task"
            )
        freeze(self, task=task, position=middle, half_width=half, within=within, density=density)
        reached = self.random(16, 0)
        freeze(self, center=reached[int(np.argmin(within.ratio(reached)))])

    @property
    def bounds(self) -> Box:
        """Box ``within`` in joint space, which contains the region."""
        return self.within

    def random(self, count: int, seed: int) -> Array:
        """Draw scrambled Sobol points of ``within`` with the frame in the box: (count, n).

        The same ``seed`` gives the same points.

        Raises
        ------
        InputError
            If too few of the points lie in the workspace box.
        """
        count = as_int(count, "the number of nodes", 1, MOST_NODES)
        seed = as_int(seed, "seed")
        found: list[Array] = []
        size = max(1024, count)
        drawn = 0
        part = 0
        while sum(map(len, found)) < count:
            if drawn >= max(_MOST_DRAWS, 64 * count):
                reached = sum(map(len, found))
                raise InputError(
                    f"only {reached} of {drawn} configurations in within= bring "
                    f"{self.task.frame!r} into the workspace box; make the workspace box larger, "
                    "or within= smaller"
                )
            Q = self.within.random(size, seed * 1009 + part)
            found.append(Q[self.contains(Q)])
            drawn, part = drawn + len(Q), part + 1
        return np.concatenate(found)[:count]

    def weights(self, Q: ArrayLike) -> Array:
        """Compute the quadrature weights of points Q from :meth:`random`: (K,), which sum to 1.

        The weights are proportional to ``√det(J Jᵀ)`` and to the density, see the class.
        """
        Q = as_configurations(Q, self.task.n, "this box")
        J = self.task.jacobians(Q)
        volume = np.sqrt(np.maximum(np.linalg.det(J @ np.swapaxes(J, -1, -2)), 0.0))
        return normalised(volume * evaluate_density(self.density, Q))

    def ratio(self, Q: ArrayLike) -> Array:
        """Compute the scale at which the region's boundary passes through each row of Q: (K,).

        The scale is a factor of the half-widths of both boxes: below 1 for a row of Q (K, n)
        inside, above 1 outside.
        """
        kind = self.task.kind
        axes = kind.rows[kind.linear]
        away = np.abs(self.task.positions(Q)[:, axes] - self.position) / self.half_width
        return np.maximum(away.max(-1), self.within.ratio(Q))

    def clip(self, Q: ArrayLike) -> Array:
        """Move the rows of Q (K, n) into ``within``: (K, n).

        The frame can still be outside the workspace box.
        """
        return self.within.clip(Q)

    def shrunk(self, factor: float) -> WorkspaceBox:
        """Create the region with the half-widths of both boxes multiplied by ``factor``."""
        factor = positive(factor, "the factor")
        return WorkspaceBox(
            self.task,
            self.position,
            self.half_width * factor,
            within=self.within.shrunk(factor),
            density=self.density,
        )

    def __str__(self) -> str:
        centre = ", ".join(f"{c:.3g}" for c in self.position)
        return f"{span(self.half_width, '±')} m around ({centre}) m, within a {self.within}"
