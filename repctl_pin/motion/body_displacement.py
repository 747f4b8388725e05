"""Displacement of bodies between two placements.

A drawn body, or drawn shape, is a visible shape of the robot: a visual shape of its URDF, or what
is drawn instead if there is none. The **most displaced part** is the arm link whose drawn body
contains the point with the largest displacement. That point gives the displacement of the part, in
every text, table, page and figure.

``JointMotion`` is a joint motion over several cycles: q, q̇ (T + 1, n) at times t, without the path
of the frame. ``Shape`` is a shape of a URDF as plain data: its kind, size, link and place, or its
mesh file.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import Array, read_only
from ..model.arm_links import arm_links, link_origins
from ..model.coupled_ends import other_ends
from ..model.shapes import Shape
from ..model.task import Task
from ..model.visuals import Visuals
from .joint_motion import JointMotion

_off_after: WeakKeyDictionary[JointMotion, tuple[Sequence[Shape], Array]] = WeakKeyDictionary()
"""Cache of each motion's displacements after its cycles; notes, table and figures share it."""


def displacements(
    before: Array, after: Array, bodies: Sequence[Array]
) -> tuple[Array, NDArray[np.intp]]:
    """Compute how far each body moves between two placements: the maximum over its points.

    This expresses drift in metres instead of joint angles. If a body has the placements X before
    and X′ after, a point p of the body moves by ``(X′ − X) p̃`` with ``p̃ = (p, 1)``. The length of
    this vector is a convex function of p, so the maximum over a polytope is at a corner.

    Parameters
    ----------
    before, after : (T, S, 4, 4) arrays
        Rigid placements of S bodies at T moments, in one fixed frame, m. A first axis of length 1
        stands for the same placements at all moments.
    bodies : sequence of S arrays (P, 3)
        Corners of each body's convex hull in its own frame, m; at least one.

    Returns
    -------
    displacement : (T, S) array
        Displacement of each body, m.
    which : (T, S) array of int
        Index of the corner of each body that has this displacement.
    """
    D = (after - before)[..., :3, :]  # (T, S, 3, 4)
    way = np.empty(D.shape[:2])
    which = np.empty(D.shape[:2], np.intp)
    upper = np.triu_indices(4)
    twice = np.where(upper[0] == upper[1], 1.0, 2.0)
    for s, points in enumerate(bodies):
        p = np.c_[points, np.ones(len(points))]
        squares = p[:, upper[0]] * p[:, upper[1]] * twice  # (P, 10)
        G = np.swapaxes(D[:, s], 1, 2) @ D[:, s]  # (T, 4, 4): ‖D p̃‖² = p̃ᵀ G p̃
        which[:, s] = np.argmax(G[:, upper[0], upper[1]] @ squares.T, axis=1)
        way[:, s] = np.linalg.norm((D[:, s] @ p[which[:, s], :, None])[..., 0], axis=1)
    return way, which


def farthest(shapes: Sequence[Shape], off: Array, links: Collection[str]) -> tuple[str, float]:
    """Find the link with the most displaced shape: its name, and the displacement, m.

    The result is ("", 0) if no shape belongs to one of the links.

    Parameters
    ----------
    shapes : sequence of S shapes
        Shapes of a robot.
    off : (S,) array
        Displacement of each shape between two placements, m.
    links
        Names of the links to consider, such as those of the arm.
    """
    own = [k for k, shape in enumerate(shapes) if shape.link in links]
    which = max(own, key=lambda k: off[k], default=-1)
    return ("", 0.0) if which < 0 else (shapes[which].link, float(off[which]))


def farthest_link(motion: JointMotion) -> tuple[str, float]:
    """Find the most displaced part of an arm at the end of a motion: (link, displacement, m).

    The displacement is from the start of the motion. The result is ("", 0) if no link of the arm
    has a drawn shape.
    """
    shapes, off = _off(motion)
    return farthest(shapes, off[-1], arm_links(motion.task))


def cycle_displacements(motion: JointMotion) -> Array:
    """Compute the displacement of the most displaced part after each cycle: (cycles,), m.

    The displacement is from the start of the motion; the part can differ from cycle to cycle.
    """
    return _off(motion)[1].max(axis=1, initial=0.0)


def _off(motion: JointMotion) -> tuple[Sequence[Shape], Array]:
    """Compute how far each drawn shape of an arm is from the start after each cycle of a motion.

    Return the S shapes on links of the arm, and their displacements: (cycles, S), m. The
    displacement of a shape is the maximum over its points.
    """
    if motion not in _off_after:
        task, links = motion.task, arm_links(motion.task)
        visuals = Visuals.of(task.robot)
        own = [k for k, shape in enumerate(visuals.shapes) if shape.link in links]
        placements = visuals.placements(task.to_robot(motion.q[:: motion.steps]))[:, own]
        bodies = visuals.corners()
        off, _ = displacements(placements[:1], placements[1:], [bodies[k] for k in own])
        _off_after[motion] = [visuals.shapes[k] for k in own], off
    return _off_after[motion]


@dataclass(frozen=True, eq=False)
@read_only
class LinkPoints:
    """The most displaced point of each link of an arm in a motion.

    Create the object with :meth:`of`, from the motion's configurations: the displacement is that
    from the first of them. :meth:`at` returns the positions of the points.

    Attributes
    ----------
    task : Task
        Task of the arm.
    links : tuple of str
        Names of the L links of the arm that have a drawn shape.
    """

    task: Task
    links: tuple[str, ...]
    _visuals: Visuals
    _shape: NDArray[np.intp]  # (L,)
    _point: Array  # (L, 4), in the shape's own frame

    @classmethod
    def of(cls, task: Task, Q: Array) -> LinkPoints:
        """Choose, on each link, the point with the largest displacement in a motion Q (K, n).

        The displacement of a point is the largest distance, over the K configurations, from its
        position at the first of them.
        """
        visuals = Visuals.of(task.robot)
        own = arm_links(task)
        bodies = visuals.corners()
        placements = visuals.placements(task.to_robot(Q))
        off, which = displacements(placements[:1], placements, bodies)
        when = off.argmax(axis=0)  # (S,)
        most = off.max(axis=0)
        best: dict[str, int] = {}
        for s, shape in enumerate(visuals.shapes):
            if shape.link in own and most[s] >= most[best.get(shape.link, s)]:
                best[shape.link] = s
        points = [[*bodies[s][which[when[s], s]], 1.0] for s in best.values()]
        return cls(task, tuple(best), visuals, np.array([*best.values()]), np.array(points))

    def at(self, Q: Array) -> Array:
        """Compute the positions of the L points at Q (K, n): (K, L, 3), m, in the root frame."""
        placements = self._visuals.placements(self.task.to_robot(Q))
        return np.einsum("KLij,Lj->KLi", placements[:, self._shape, :3], self._point)


def end_displacements(task: Task, Q: Array) -> dict[str, Array]:
    """Compute the displacements of the other end effectors from their start, by link: (T,) each, m.

    The other end effectors are links that the task does not control, but its joints move. On a
    robot with two arms on one waist, for example, the other hand drifts as well. The displacement
    is that of the origin of the link.

    Parameters
    ----------
    task
        Task of the arm.
    Q : (T, n) array
        Configurations, of which the first is the start.
    """
    ends = other_ends(task)
    if not ends:
        return {}
    places = link_origins(task, ends, Q)
    return dict(zip(ends, np.linalg.norm(places - places[0], axis=2).T, strict=True))
