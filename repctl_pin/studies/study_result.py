"""Results of a study: one row per strategy, and the problem that was studied.

A strategy is one of the compared controllers, such as J⁺. The region Ω is the part of joint space
for which the repeatable inverse was designed. The desired inverse G_d is the one that the design
approximates. A potential is a function of the joints that the repeatable inverse keeps constant.

``Row`` is the result of one strategy in a study: its motion and figures, or why it stopped.
``Mechanism`` is the movable joints of a robot and their limits. ``JointMotion`` is a joint motion
over several cycles: q, q̇ (T + 1, n) at times t, without the path of the frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..base.arguments import Array, read_only, require_choice
from ..base.certificate import proved_words
from ..base.defaults import PERIOD
from ..base.plugins import parts
from ..design import Design
from ..model.bodies import bodies_of
from ..model.mechanism import Mechanism
from ..model.task import Task
from ..motion import Motion, elbow
from ..motion.follow import UNRESOLVED
from ..motion.joint_motion import JointMotion, Violation, violations_of
from ..motion.limits import presumed_acceleration
from ..paths import TaskPath
from ..regions import Region
from .quantities import finite, values_of


@dataclass(frozen=True)
class Row:
    """Result of one strategy in a study: its motion and figures, or the reason why it stopped.

    Attributes
    ----------
    key, label : str
        Name in files (``pseudoinverse``), and display name (``J⁺``).
    motion : Motion or None
        Motion of the strategy; None if it stopped, or if its drift depends on the number of steps,
        for the reason ``stopped``.
    stopped : str
        Reason why there is no motion; empty if there is one.
    leaf_margin : float or None
        Smallest leaf margin along the motion, the distance from an algorithmic singularity, where
        the potentials no longer determine the joints: 1 is best, 0 is singular. None if the
        strategy has no potentials.
    distance : float or None
        Relative distance ``‖G − G_d‖ / ‖G_d‖`` of the strategy's inverse G from the desired inverse
        G_d, with both norms as root mean squares over the region Ω. It is given for the design and,
        as 0, for J⁺ if G_d is J⁺; otherwise it is None.
    body_distance : float or None
        Minimum distance between bodies, m, see :attr:`.JointMotion.clearance`; None without bodies
        or without a motion.
    violations : tuple of Violation
        First violation of a joint limit and first collision of two bodies, as far as they occur.
    """

    key: str
    label: str
    motion: Motion | None
    stopped: str = ""
    leaf_margin: float | None = None
    distance: float | None = None
    body_distance: float | None = None
    violations: tuple[Violation, ...] = ()

    @cached_property
    def cycle_time(self) -> float | None:
        """Time of the first cycle from rest to rest, s.

        It is as short as the speed and acceleration limits of the robot allow. Without acceleration
        limits, each joint is assumed to reach its speed limit in 0.2 s. None without a motion, if
        the joints do not move, or if no speed is within the limits.
        """
        if self.motion is None:
            return None
        return next((least(self.motion) for least in parts("cycle_time")), None)

    @property
    def failure(self) -> str:
        """Text that says why there is no motion; it follows the name of the controller.

        The text is ``stopped: …``, or says that the drift depends on the number of steps. It is
        empty if there is a motion.
        """
        if self.motion is not None or self.stopped.startswith(UNRESOLVED):
            return self.stopped
        return f"stopped: {self.stopped}"

    def summary(self) -> str:
        """Summarise the result in one line: drift, tracking error, joint speed, and margins.

        Violations of limits and collisions follow. Without a motion, the line is :attr:`failure`.
        """
        motion = self.motion
        if motion is None:
            return self.failure
        unit = motion.task.unit
        first, last = motion.drift[0], motion.drift[-1]
        parts = [
            f"drift {first:.2g} {unit} after 1 cycle, {last:.2g} after {motion.cycles}",
            f"tracking error {motion.tracking_error.max():.2g} m",
            f"joint speed {motion.first_rms_speed:.3g} in cycle 1, {motion.rms_speed:.3g} overall",
        ]
        margin, distance = float(motion.limit_margin.min()), self.body_distance
        if np.isfinite(margin):
            parts.append(f"limit margin {margin:.2g}")
        if distance is not None:
            parts.append(f"body distance {distance:.2g} m")
        return "; ".join([*parts, *map(str, self.violations)])

    @property
    def outside(self) -> float:
        """Share of the motion that lies outside Ω, the region of the design: 0 to 1.

        Repeatability is not guaranteed there. The share is 0 without a region or a motion.
        """
        return 0.0 if self.motion is None else self.motion.outside or 0.0


def evaluated(row: Row) -> Row:
    """Add to a row the minimum body distance, m, and the violations of limits of its motion.

    Return the new row. A study does this when all motions are known. A row without a motion is
    returned as it is.
    """
    motion = row.motion
    if motion is None:
        return row
    distance = motion.clearance.distance
    return replace(
        row,
        body_distance=distance if np.isfinite(distance) else None,
        violations=violations_of(motion),
    )


@dataclass(frozen=True, eq=False)
@read_only
class Study:
    """Results of every strategy on one arm and one closed path. See :func:`study`.

    Attributes
    ----------
    task : Task
        Task of the arm.
    q0 : (n,) array
        Start configuration, rad (m for prismatic joints).
    path : TaskPath
        Closed path.
    region : Region
        Region Ω of the design, the part of joint space for which it was made.
    design : Design
        Nearest repeatable inverse.
    rows : tuple of Row
        Results, one per strategy, J⁺ first.
    notes : tuple of str
        Notes for the user.
    period : float
        Period of one cycle, s.

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
    period: float = PERIOD

    def __repr__(self) -> str:
        done = [(row.label, row.motion) for row in self.rows]
        drifts = ", ".join(
            f"{label} {motion.drift[-1]:.2g}" if motion else f"{label} stopped"
            for label, motion in done
        )
        what = f"{self.robot.name} {self.task.frame}: {self.path.name}"
        return f"<Study of {what}, drift at the end: {drifts}>"

    def summary(self) -> str:
        """Summarise the problem in one line, and each controller's result in another."""
        cycles = next((row.motion.cycles for row in self.rows if row.motion is not None), 0)
        task = f"{self.robot.name} {self.task.frame_words}, {self.task.kind}"
        head = f"{task}: {self.path.name}, {cycles} cycles"
        width = max(len(row.label) for row in self.rows)
        return "\n".join(
            [head, *(f"  {row.label.ljust(width)}  {row.summary()}" for row in self.rows)]
        )

    @property
    def robot(self) -> Mechanism:
        """Robot of the task."""
        return self.task.robot

    @property
    def elbow(self) -> int:
        """Index, from 0 among the task's joints, of the elbow joint, whose trace is drawn.

        The elbow joint is the joint in the middle of the arm whose origin moves most in
        self-motions.
        """
        return elbow(self.task, self.q0)

    def open(self) -> Path:
        """Open the animation in the browser, from a new temporary folder; return its file.

        Raises
        ------
        InputError
            If every shown controller stopped, so that there is no motion to show.
        """
        import repctl_pin as rp

        return rp.animation(self).show()

    def _repr_html_(self) -> str:
        """Show animation, table and figures in a notebook cell."""
        import repctl_pin as rp

        return rp.animation(self)._repr_html_()

    def row(self, key: str) -> Row:
        """Find a strategy's row by its key, such as ``pseudoinverse``."""
        require_choice(key, [row.key for row in self.rows], "strategy of this study")
        return next(row for row in self.rows if row.key == key)

    @property
    def setting(self) -> dict[str, str]:
        """Description of the studied problem, as texts by label, such as ``period``.

        Tables and reports print it. ``path options`` are the options of ``repctl`` for this path.
        """
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
            "leaf margin": f"{self.design.leaf_margin:.3g} at worst in Ω, "
            f"{proved_words(self.design.proof)}",
        }

    def as_dict(self) -> dict[str, Any]:
        """Collect the problem, the design and the results in plain Python types, for JSON."""
        from ..paths.winding import winding

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
                "leaf_margin_proved": design.proof.leaf_margin if design.proof else None,
                "closes": _closes(design),
                "potentials": design.potentials.size,
            },
            "winding": winding(self.task, self.path)[0],
            "not_checked": list(bodies_of(self.task).unchecked),
            "strategies": {row.key: _row_dict(row) for row in self.rows},
            "notes": list(self.notes),
        }


def picked(thing: object, *names: str) -> dict[str, Any]:
    """Collect attributes of an object, given by ``names``, in a dictionary by name."""
    return {name: getattr(thing, name) for name in names}


def region_dict(region: Region) -> dict[str, Any]:
    """Describe a region of joint space by its centre, half-width and name in plain types, for JSON.

    ``half_width`` (n,), rad or m, is that of the smallest box around the region.
    """
    return {
        "center": region.center.tolist(),
        "half_width": region.bounds.half_width.tolist(),
        "is": str(region),
    }


def bodies_dict(motion: JointMotion) -> dict[str, Any]:
    """Collect the minimum body distance and the first collision in plain Python types, for JSON.

    ``body_distance`` is in m. ``nearest_bodies`` and ``first_touch`` have the two ``links`` and the
    time in cycles, such as 1.25, as ``cycle``. ``between_samples`` is True if the values hold
    between the samples, too. All values are None if no bodies are checked; without a collision,
    ``first_touch`` is None.
    """
    keys = "body_distance", "nearest_bodies", "first_touch", "between_samples"
    least = motion.clearance.distance
    if not np.isfinite(least):
        return dict.fromkeys(keys)
    when, nearest = motion.nearest_bodies
    touch = motion.first_touch
    return {
        "body_distance": least,
        "nearest_bodies": {"cycle": when, "links": list(nearest.links)},
        "first_touch": None if touch is None else {"cycle": touch[0], "links": list(touch[1])},
        "between_samples": motion.clearance.between,
    }


def limits_dict(motion: Motion) -> dict[str, Any]:
    """Collect the minimum joint-limit margin and the first violation in plain types, for JSON.

    The keys are ``limit_margin``, rad or m, None without limits, and ``first_violation``, which has
    the ``joint`` and the time in cycles, such as 1.25, as ``cycle``; None without a violation.
    """
    violation = motion.first_violation
    return {
        **values_of(motion, "limit_margin"),
        "first_violation": None
        if violation is None
        else dict(zip(("cycle", "joint"), violation, strict=True)),
    }


def _closes(design: Design) -> dict[str, Any] | None:
    """Collect the proved closing radius of a design in plain Python types, for JSON.

    Every closed path within this radius of the start, or of the path, is proved to close in joint
    space. None if nothing was proved.
    """
    closes = design.proof.closes if design.proof else None
    return picked(closes, "metres", "radians", "around", "reason") if closes else None


def _row_dict(row: Row) -> dict[str, Any]:
    """Convert the row of one controller in a study to plain Python types, for JSON.

    Without a motion, only its label and the reason, ``stopped``, are given.
    """
    from ..motion.body_displacement import end_displacements, farthest_link

    motion = row.motion
    if motion is None:
        return {"label": row.label, "stopped": row.stopped}
    loss, ends = motion.path_loss, motion.q[[0, -1]]
    link, off = farthest_link(motion)
    return {
        "label": row.label,
        "farthest": {"link": link, "displacement": off},
        "other_ends": {
            end: float(d[-1]) for end, d in end_displacements(motion.task, ends).items()
        },
        **values_of(motion, "drift_first", "drift_last"),
        "drift": motion.drift.tolist(),
        "cycle_drift": motion.cycle_drift.tolist(),
        **values_of(motion, "outside", "beyond_closing_radius", "tracking_error"),
        "turning_error": float(motion.turning_error.max()),
        "path_loss": None
        if loss is None
        else dict(zip(("cycle", "distance", "angle"), loss, strict=True)),
        **values_of(motion, "first_rms_speed", "rms_speed", "peak_speed"),
        "speed_ratio": finite(motion.speed_ratio),
        **limits_dict(motion),
        **bodies_dict(motion),
        "cycle_time": row.cycle_time,
        "closes": motion.closes,
        **picked(row, "leaf_margin", "distance"),
    }
