"""What a study found: a row a strategy, and how to do it again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arguments import Array, read_only, require_choice
from ..design import Design
from ..errors import InputError
from ..motion import Motion, TaskPath, elbow, timed
from ..motion.joint_motion import Violation, violations_of
from ..motion.timing import presumed_acceleration
from ..regions import Region
from ..robot.mechanism import Mechanism
from ..robot.task import Task


@dataclass(frozen=True)
class Row:
    """What one strategy did.

    Attributes
    ----------
    key, label : str
        A short name for files (``pseudoinverse``), and one for people (``J⁺``).
    motion : Motion or None
        None where the strategy could not go on; ``stopped`` says why.
    leaf_margin : float or None
        Worst σ_min(Nᵀ V̂) along its motion, where the strategy has a V.
    distance : float or None
        Relative distance ``‖G − J⁺‖ / ‖J⁺‖`` in the mean over Ω; None where the strategy is no
        inverse.
    body_distance : float or None
        Minimum distance between bodies at 100 points per cycle, m; None where there are none, or no
        motion.
    violations : tuple of Violation
        When a joint first exceeds its limits, and when two bodies first collide.
    cycle_time : float or None
        Time of the first cycle from rest to rest, s, as short as the robot's speed limits and the
        accelerations of :func:`presumed_acceleration` allow; None where it cannot be timed.
    """

    key: str
    label: str
    motion: Motion | None
    stopped: str = ""
    leaf_margin: float | None = None
    distance: float | None = None
    body_distance: float | None = None
    violations: tuple[Violation, ...] = ()
    cycle_time: float | None = None

    def summary(self) -> str:
        """Say in a line what the strategy did."""
        motion = self.motion
        if motion is None:
            return f"stopped: {self.stopped}"
        unit = motion.task.unit
        parts = [
            f"drift {motion.drift[0]:.2g} {unit} after 1 cycle, {motion.drift[-1]:.2g} after {motion.cycles}",
            f"tracking error {motion.tracking_error.max():.2g} m",
            f"joint speed {motion.first_rms_speed:.3g} in cycle 1, {motion.rms_speed:.3g} overall",
        ]
        margin = float(motion.limit_margin.min())
        parts += [f"limit margin {margin:.2g}"] if np.isfinite(margin) else []
        parts += (
            [f"body distance {self.body_distance:.2g} m"] if self.body_distance is not None else []
        )
        return "; ".join([*parts, *map(str, self.violations)])

    @property
    def outside(self) -> float:
        """Share of the motion that lies outside Ω; 0 where there is no Ω, or no motion."""
        return 0.0 if self.motion is None else self.motion.outside or 0.0


def evaluated(row: Row) -> Row:
    """Evaluate a motion's body distance, violations and fastest first cycle."""
    motion = row.motion
    if motion is None:
        return row
    distance = float(motion.coarse.body_distance.min())
    return replace(
        row,
        body_distance=distance if np.isfinite(distance) else None,
        violations=violations_of(motion, motion.coarse),
        cycle_time=fastest_cycle(motion),
    )


def fastest_cycle(motion: Motion) -> float | None:
    """Time the first cycle from rest to rest, s; None where it cannot be timed."""
    end = motion.steps + 1
    once = replace(motion, cycles=1, t=motion.t[:end], q=motion.q[:end], qdot=motion.qdot[:end])
    acceleration = presumed_acceleration(motion.task)[0]
    try:
        return timed(once, acceleration=acceleration).duration
    except InputError:  # it does not move, or no speed is slow enough
        return None


@dataclass(frozen=True, eq=False)
@read_only
class Study:
    """One arm, one closed path, every strategy side by side. See :func:`study`.

    Attributes
    ----------
    task : Task
    q0 : (n,) array
        The start, rad (m for sliding joints).
    path : TaskPath
    region : Region
        Ω, for which the repeatable control was designed.
    design : Design
    rows : tuple of Row
        One per strategy: its name and its motion.
    notes : tuple of str
        What a user should know.
    period : float
        Time of one cycle, s.

    Examples
    --------
    >>> study.row("repeatable").motion.drift.shape  # one per cycle
    (2,)
    >>> study.design.leaf_margin > 0.5
    True
    """

    task: Task
    q0: Array
    path: TaskPath
    region: Region
    design: Design
    rows: tuple[Row, ...]
    notes: tuple[str, ...]
    period: float = 5.0

    def __repr__(self) -> str:
        done = [(row.label, row.motion) for row in self.rows]
        drifts = ", ".join(
            f"{label} {motion.drift[-1]:.2g}" if motion else f"{label} stopped"
            for label, motion in done
        )
        return f"<Study of {self.robot.name} {self.task.frame}: {self.path.name}, drift at the end: {drifts}>"

    def summary(self) -> str:
        """Say for each strategy where it ended: drift, tracking error, joint speed, and margins."""
        cycles = next((row.motion.cycles for row in self.rows if row.motion is not None), 0)
        head = f"{self.robot.name} {self.task.frame}, {self.task.kind}: {self.path.name}, {cycles} cycles"
        width = max(len(row.label) for row in self.rows)
        return "\n".join(
            [head, *(f"  {row.label.ljust(width)}  {row.summary()}" for row in self.rows)]
        )

    @property
    def robot(self) -> Mechanism:
        """The robot."""
        return self.task.robot

    @property
    def elbow(self) -> int:
        """The joint whose origin a self-motion at the start moves fastest: where the displacement
        is seen."""
        return elbow(self.task, self.q0)

    def row(self, key: str) -> Row:
        """Find a strategy's row by its key."""
        require_choice(key, [row.key for row in self.rows], "strategy of this study")
        return next(row for row in self.rows if row.key == key)

    @property
    def setting(self) -> dict[str, str]:
        """What was studied, as label and text; ``path options`` is the path as the command line
        takes it."""
        task = self.task
        start = ", ".join(f"{v:.4g}" for v in self.q0)
        return {
            "robot": f"{self.robot.name} ({self.robot.description.path.name})",
            "task": str(task),
            "start": start,
            "path": self.path.name,
            **({"path options": self.path.options} if self.path.options else {}),
            "period": f"{self.period:g} s",
            "region Ω": str(self.region),
            "accelerations": presumed_acceleration(task)[1],
            "potentials": str(self.design.potentials),
        }

    def as_dict(self) -> dict[str, Any]:
        """Everything a script would want, in plain Python types."""
        design = self.design
        return {
            **self.task.as_dict(),
            "start": [float(v) for v in self.q0],
            **self.path.as_dict(),
            "period": self.period,
            "region": region_dict(self.region),
            "design": {
                **picked(
                    design, "cost", "cost_error", "relative_distance", "leaf_margin", "converged"
                ),
                "potentials": design.potentials.size,
            },
            "strategies": {row.key: _row_dict(row) for row in self.rows},
            "notes": list(self.notes),
        }


def picked(thing: object, *names: str) -> dict[str, Any]:
    """Take some attributes by name."""
    return {name: getattr(thing, name) for name in names}


def region_dict(region: Region) -> dict[str, Any]:
    """Say what a region is, in plain Python types."""
    return {
        "center": region.center.tolist(),
        "half_width": region.bounds.half_width.tolist(),
        "is": str(region),
    }


def bodies_dict(motion: Motion) -> dict[str, Any]:
    """Say how near bodies come, when and which, and when they first touch, in plain Python
    types."""
    least = float(motion.body_distance.min())
    if not np.isfinite(least):
        return {"body_distance": None, "nearest_bodies": None, "first_touch": None}
    when, nearest = motion.nearest_bodies
    touch = motion.first_touch
    return {
        "body_distance": least,
        "nearest_bodies": {"cycle": when, "links": list(nearest.links)},
        "first_touch": None if touch is None else {"cycle": touch[0], "links": list(touch[1])},
    }


def limits_dict(motion: Motion) -> dict[str, Any]:
    """Say how near joints come to their limits, and which first leaves them and when, in plain
    Python types."""
    margin, violation = float(motion.limit_margin.min()), motion.first_violation
    return {
        "limit_margin": margin if np.isfinite(margin) else None,
        "first_violation": None
        if violation is None
        else dict(zip(("cycle", "joint"), violation, strict=True)),
    }


def _path_loss(motion: Motion) -> dict[str, float] | None:
    """Say when the frame leaves its path, and by how much."""
    loss = motion.path_loss
    return None if loss is None else dict(zip(("cycle", "distance", "angle"), loss, strict=True))


def _row_dict(row: Row) -> dict[str, Any]:
    motion = row.motion
    if motion is None:
        return {"label": row.label, "stopped": row.stopped}
    return {
        "label": row.label,
        "drift_first": float(motion.drift[0]),
        "drift_last": float(motion.drift[-1]),
        "drift": motion.drift.tolist(),
        "cycle_drift": motion.cycle_drift.tolist(),
        "outside": motion.outside,
        "tracking_error": float(motion.tracking_error.max()),
        "turning_error": float(motion.turning_error.max()),
        "path_loss": _path_loss(motion),
        **picked(motion, "first_rms_speed", "rms_speed", "peak_speed"),
        "speed_ratio": motion.speed_ratio if np.isfinite(motion.speed_ratio) else None,
        **limits_dict(motion),
        **bodies_dict(motion.coarse),
        "cycle_time": row.cycle_time,
        "closes": motion.closes,
        **picked(row, "leaf_margin", "distance"),
    }
