"""A region of the workspace, with all the configurations that reach it: the paper's alternative to
a box of joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import (
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
from ..errors import InputError
from ..robot.task import Task, own_task
from .box import Box, Density, check_density, evaluate_density, normalised, span

_MOST_DRAWS = 2**18


@dataclass(frozen=True, eq=False)
@read_only
class WorkspaceBox:
    """All q of a box of joints whose frame lies in a box of the workspace, ``|p_i − center_i| ≤
    half_width_i``.

    The mean is over the workspace *and* the self-motions that reach each of its points. By the
    coarea formula, ``∫∫ … dσ dx = ∫ … √det(J Jᵀ) dq``, so each q has the weight ``√det(J Jᵀ)``.

    Parameters
    ----------
    task
        The task; the box bounds its frame's position, m.
    position, half_width : (3,) arrays
        The box, in m in the base frame; two numbers for the tasks ``xy``, ``xz``, ``yz``. One
        half-width serves all axes.
    within : Box
        A box of joints: it selects among the arm's postures.
    density : function, optional
        Q (K, n) → (K,) weights from 0 up, on top of the above.

    Raises
    ------
    InputError
        If sizes do not fit the task, a half-width is not positive, or no configuration of
        ``within`` reaches the box.

    Examples
    --------
    >>> region = rp.WorkspaceBox(task, task.placement(q0).translation[:2], 0.1, within=rp.Box(q0, 0.4))  # m
    >>> region.contains([q0])
    array([ True])
    """

    task: Task
    position: Array
    half_width: Array
    within: Box
    density: Density | None = None

    def __init__(
        self,
        task: Task,
        position: ArrayLike,
        half_width: ArrayLike,
        *,
        within: Box,
        density: Density | None = None,
    ) -> None:
        task = own_task(task)
        axes = [row for row in task.rows if row < 3]
        require_type(within, Box, "within", "a box of the joints, such as rp.Box(q0, 0.5)")
        middle = vector(position, len(axes), "the center of a workspace box", "m")
        half = per_joint(
            half_width,
            len(axes),
            "the half-widths of a workspace box",
            "one an axis, m",
            finite=True,
        )
        check_density(density)
        if within.n != task.n:
            raise InputError(f"within= has {within.n} joints, but the task has {task.n}")
        freeze(self, task=task, position=middle, half_width=half, within=within, density=density)
        reached = self._draw(16, 0)
        freeze(self, _center=reached[int(np.argmin(within.ratio(reached)))])

    @property
    def center(self) -> Array:
        """A configuration that reaches the box, near the middle of ``within``."""
        return self._center  # type: ignore[attr-defined]

    @property
    def bounds(self) -> Box:
        """The box of joints, ``within``."""
        return self.within

    def nodes(self, count: int, seed: int) -> tuple[Array, Array]:
        """Quadrature nodes Q (K, n), K ≥ count, and weights (K,) that sum to 1."""
        Q = self.random(count, seed)
        return Q, self.weights(Q)

    def random(self, count: int, seed: int) -> Array:
        """Scrambled Sobol points of ``within`` whose frame lies in the box: (count, n)."""
        return self._draw(count, seed)

    def weights(self, Q: Array) -> Array:
        """``√det(J Jᵀ)``, scaled to sum 1: (K,)."""
        Q = as_configurations(Q, self.task.n, "this box")
        J = self.task.jacobians(Q)
        volume = np.sqrt(np.maximum(np.linalg.det(J @ np.swapaxes(J, -1, -2)), 0.0))
        return normalised(volume * evaluate_density(self.density, Q))

    def ratio(self, Q: ArrayLike) -> Array:
        """Factor by which the region would have to be scaled for each row of Q to lie on its
        boundary: (K,).

        Above 1 is outside.
        """
        axes = [row for row in self.task.rows if row < 3]
        away = np.abs(self.task.positions(Q)[:, axes] - self.position) / self.half_width
        return np.maximum(away.max(-1), self.within.ratio(Q))

    def contains(self, Q: ArrayLike) -> NDArray[np.bool_]:
        """Say which rows of Q (K, n) lie inside."""
        return self.ratio(Q) <= 1 + 1e-12

    def clip(self, Q: Array) -> Array:
        """Move joints that have left ``within`` back; the frame may still be outside its box."""
        return self.within.clip(Q)

    def shrunk(self, factor: float) -> WorkspaceBox:
        """Shrink both boxes, of joints and of the workspace."""
        factor = positive(factor, "the factor")
        return WorkspaceBox(
            self.task,
            self.position,
            self.half_width * factor,
            within=self.within.shrunk(factor),
            density=self.density,
        )

    def _draw(self, count: int, seed: int) -> Array:
        """Draw points of ``within`` until enough of them reach the box."""
        count, seed = as_int(count, "the number of nodes", 1, MOST_NODES), as_int(seed, "seed")
        found: list[Array] = []
        size, drawn, part = max(1024, count), 0, 0
        while sum(map(len, found)) < count:
            if drawn >= max(_MOST_DRAWS, 64 * count):
                raise InputError(
                    f"of {drawn} configurations of within= only {sum(map(len, found))} bring {self.task.frame!r} into "
                    "the workspace box; make it larger, or within= smaller"
                )
            Q = self.within.random(size, seed * 1009 + part)
            found.append(Q[self.contains(Q)])
            drawn, part = drawn + len(Q), part + 1
        return np.concatenate(found)[:count]

    def __repr__(self) -> str:
        return f"<WorkspaceBox: {self}>"

    def __str__(self) -> str:
        centre = ", ".join(f"{c:.3g}" for c in self.position)
        return f"{span(self.half_width, '±')} m round ({centre}) m, within a {self.within}"
