"""Drift in other planes: does J⁺ drift more on other circles or loops than on the study's path?

On some paths, J⁺ hardly drifts by chance. A note then names a plane in which it drifts more.
"""

from __future__ import annotations

import numpy as np

from ..base.arguments import Array
from ..base.errors import InputError, SingularityError
from ..motion import Motion, followed
from ..motion.fitting_circle import fitting_circle
from ..strategies import Pseudoinverse

_HARDLY = 0.01
"""Displacement of every part, m, below which J⁺ counts as hardly drifting on a path."""

_FEW = 100
"""Number of steps per cycle on circles in other planes."""

_LITTLE = 1e-4
"""Drift per cycle, rad or m, up to which J⁺ counts as hardly drifting on a path."""


def drift_in_other_planes(plain: Pseudoinverse, q0: Array, motion: Motion | None) -> list[str]:
    """Make a note on a plane in which J⁺ drifts more, if J⁺ hardly drifts on the study's path.

    ``plain`` is J⁺, and ``motion`` is its motion from q0 (n,), or None if it stopped. First circles
    of the same size in other planes are tried, then small loops in all planes. The list has at most
    one text.
    """
    task = plain.task
    if motion is None or task.m < 3:
        return []
    from ..motion.body_displacement import farthest_link

    _, off = farthest_link(motion)
    found = _other_circle(plain, q0, motion) if off < _HARDLY else None
    if found is not None and found[2] >= max(_HARDLY, 2 * off):
        plane, link, most = found
        more = f"{link} is {100 * most:.2g} cm from its start after {motion.cycles} cycles"
        return [f"on a circle of the same size in {plane} J⁺ drifts more: {more}"]
    if motion.drift[0] > _LITTLE:
        return []
    from ..integrability import drift_per_area

    per_area = drift_per_area(plain, q0)
    a, b = np.unravel_index(int(per_area.argmax()), per_area.shape)
    most = float(per_area[a, b])
    if most < 0.01:
        return []
    plane = "".join("xyz"[k] for k in sorted((a, b)))
    small = f"on small loops in {plane} it drifts by {most:.2g} {task.unit} per m²"
    return [f"J⁺ hardly drifts on this path, but {small}"]


def _other_circle(plain: Pseudoinverse, q0: Array, motion: Motion) -> tuple[str, str, float] | None:
    """Find the circle of the same radius in another plane on which J⁺, ``plain``, drifts most.

    Returns the plane (``yz``), the link that is displaced most at the end of all cycles, and by how
    far, m. None if the path is not a circle, or the arm can follow no such circle from q0.
    """
    from ..motion.body_displacement import farthest_link

    task, path = plain.task, motion.path
    kind, _, size = path.spec.partition(":")
    found: list[tuple[str, str, float]] = []
    for plane in task.kind.planes if kind == "circle" else ():
        if plane == path.plane:
            continue
        try:
            radius = float(size.partition(":")[0])
            other = fitting_circle(task, q0, plane=plane, radius=radius)
            again = followed(plain, other, q0, cycles=motion.cycles, steps=_FEW)
        except (InputError, SingularityError):
            continue
        found.append((plane, *farthest_link(again)))
    return max(found, key=lambda one: one[2], default=None)
