"""Search, in a thread of its own, for the level whose elbow is nearest to a given point.

A level c (r,) identifies a leaf, the set h(q) = c of a design's r potentials; it determines the
elbow at a pose. A search takes some 10 ms, longer than one period of the control loop.

``ElbowLevel`` is the level c at which the elbow is nearest to a point, and the configuration there.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
import pinocchio as pin

from ...base.arguments import Array
from ...base.errors import RepctlError
from ...strategies.elbow import ElbowLevel

_SAME = 1e-9
"""Change of pose and point, m, below which the last level is kept."""


class ElbowSearch:
    """Search, in a thread, for the level at which the elbow is nearest to a point p_e.

    The search is along the self-motion at a pose x of the frame. One search runs at a time; the
    next one is for the newest pose and point.

    Parameters
    ----------
    level
        Function (x, p_e) → :class:`ElbowLevel`, with p_e (3,) in the base frame, m; it raises a
        RepctlError if no level is found.

    Attributes
    ----------
    point : (3,) array or None
        Point p_e for the elbow, base frame, m; None while no point is set.
    said : str
        Display text: the distance of the last level's elbow from its point, or the reason why no
        level was found; empty before the first search has ended.
    """

    def __init__(self, level: Callable[[pin.SE3, Array], ElbowLevel]) -> None:
        self._level = level
        self._pool = ThreadPoolExecutor(1, "elbow")
        self.drop()

    def drop(self) -> None:
        """Drop the point; the result of a search that is still running is not used."""
        self.point: Array | None = None
        self.said = ""
        self._running: Future[ElbowLevel] | None = None
        self._asked: Array | None = None

    @property
    def searching(self) -> bool:
        """True while a search runs."""
        return self._running is not None

    def update(self, place: pin.SE3) -> Array | None:
        """Return the level (r,) that a search has found since the last call, else None.

        Begin the next search if none is running, and the pose ``place`` or the point has changed.
        RepctlError is raised if the search has found no level.
        """
        if self.point is None:
            return None
        ended = self._running if self._running is not None and self._running.done() else None
        if ended is not None:
            self._running = None
        asked = np.concatenate([place.homogeneous[:3].ravel(), self.point])
        new = self._asked is None or np.abs(asked - self._asked).max() > _SAME
        if new and self._running is None:
            self._asked = asked
            self._running = self._pool.submit(self._level, place.copy(), self.point)
        return None if ended is None else self._found(ended)

    def _found(self, ended: Future[ElbowLevel]) -> Array:
        """Return the level (r,) of a search that has ended, and describe it in :attr:`said`.

        RepctlError is raised if no level was found.
        """
        try:
            found = ended.result()
        except RepctlError as error:
            self.said = f"no level found: {error}"
            raise
        rest = "" if found.unique else ", not unique"
        self.said = f"{found.distance:.3g} m from its point{rest}"
        return found.leaf
