"""Compare every strategy on one arm and one closed path."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..design import Box, Design, Region, nearest_repeatable
from ..errors import InputError, RepctlError, SingularityError
from ..integrability import drift_per_area
from ..motion import Motion, Path, check_reach, elbow, follow, reach
from ..redundancy import align, nullspace
from ..robot.robot import Robot
from ..robot.task import Task
from ..strategies import FunctionStrategy, PostureControl, Pseudoinverse, Strategy
from . import defaults

Array = NDArray[np.float64]
Control = Strategy | Callable[[Array, Array], ArrayLike]

POSTURE_GAIN = 1.0
"""Gain of the posture in the null space, 1/s."""

RESERVED = ("pseudoinverse", "posture", "posture_off", "repeatable")
"""Keys of a study's own rows."""

LITTLE = 1e-4
"""Drift a cycle that nobody would see, rad or m."""

POSTURE_OFFSET = 0.57
"""How far off the start the posture of the third strategy lies, rad, along the null space."""


@dataclass(frozen=True)
class Row:
    """What one strategy did.

    Attributes
    ----------
    key, label : str
        A short name for files (``pseudoinverse``), and one for people (``J⁺``).
    motion : Motion or None
        None where the strategy could not go on; ``stopped`` says why.
    clearance : float or None
        Worst σ_min(Nᵀ V̂) along its motion, where the strategy has a V.
    distance : float or None
        Relative distance ``‖G − J⁺‖ / ‖J⁺‖`` in the mean over Ω; None where the strategy is no inverse.
    """

    key: str
    label: str
    motion: Motion | None
    stopped: str = ""
    clearance: float | None = None
    distance: float | None = None


@dataclass(frozen=True)
class Study:
    """One arm, one closed path, every strategy side by side. See :func:`study`."""

    task: Task
    q0: Array
    path: Path
    region: Region
    design: Design
    rows: tuple[Row, ...]
    notes: tuple[str, ...]

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.task.robot

    @property
    def elbow(self) -> int:
        """The joint whose origin a self-motion at the start moves fastest: where the creep is seen."""
        return elbow(self.task, self.q0)

    def row(self, key: str) -> Row:
        """Find a strategy's row by its key."""
        return next(row for row in self.rows if row.key == key)

    @property
    def setting(self) -> dict[str, str]:
        """What was studied, as label and text: enough to do it again."""
        task = self.task
        numbers = ", ".join(f"{v:.4g}" for v in self.q0)
        return {
            "robot": f"{self.robot.name} ({self.robot.description.path.name})",
            "task": f"{task.frame}, {task.kind}: n = {task.n} joints, m = {task.m}, r = {task.r}",
            "start": numbers,
            "path": self.path.name,
            "region": str(self.region),
            "potentials": f"degree {getattr(self.design.fields, 'degree', '?')}, {self.design.fields.size} of them",
        }

    def as_dict(self) -> dict[str, Any]:
        """Everything a script would want, in plain Python types."""
        design = self.design
        return {
            **self.task.as_dict(),
            "start": [float(v) for v in self.q0],
            "path": self.path.name,
            "region": {
                "center": design.region.center.tolist(),
                "half_width": self.region.bounds.half_width.tolist(),
                "is": str(self.region),
            },
            "design": {
                "cost": design.cost,
                "cost_error": design.cost_error,
                "relative_distance": design.relative_distance,
                "clearance": design.clearance,
                "converged": design.converged,
                "potentials": design.fields.size,
            },
            "strategies": {row.key: _row_dict(row) for row in self.rows},
            "notes": list(self.notes),
        }


def study(
    robot: str | Robot,
    *,
    frame: str | None = None,
    task: str | None = None,
    start: ArrayLike | None = None,
    path: Path | Callable[[Task, Array], Path] | None = None,
    radius: float | None = None,
    plane: str | None = None,
    cycles: int = 10,
    steps: int = 500,
    region: float | Region | None = None,
    degree: int = 2,
    controls: Mapping[str, Control] | None = None,
    period: float = 5.0,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Study:
    """Compare J⁺, J⁺ with a posture, and the nearest repeatable inverse on one closed path.

    Parameters
    ----------
    robot
        A catalogue name, a path to a URDF, or a robot already loaded.
    frame, task
        The frame to move and the kind of task; by default the arm's end and the first of pose, position,
        xy, xz, yz that is redundant.
    start : (n,) array, optional
        q0; by default the first that can follow the path: the reference pose, the ready one, mid-range, or a
        dexterous pose near it.
    path
        A closed path, or a function ``(task, q0) → path``; by default a circle the arm can follow inside
        its limits.
    radius, plane
        Of that circle, m, and ``xy``, ``yz`` or ``xz``.
    cycles, steps
        How often round, and RK4 steps a cycle, open loop.
    region
        Ω: a half-width round the start, rad (and m), or a region; by default a tube round the cycle.
    degree
        Of the polynomial potentials.
    controls
        Controls of your own to set beside these, by the names they shall have: strategies on this task, or
        functions (q, ẋ) → q̇.
    period
        Time of one cycle, s.
    seed
        Of the nodes.
    progress
        Called with a word on what is being done.

    Returns
    -------
    Study

    Raises
    ------
    InputError
        If anything given cannot be used; the message says what to give instead.
    SingularityError
        If the start is singular, or the design is, in every region tried.
    """
    say = progress or (lambda text: None)
    say("loading the robot")
    machine = robot if isinstance(robot, Robot) else Robot.load(robot)
    moved = defaults.choose_task(machine, frame, task)
    own = _own_controls(moved, controls or {})
    say("finding a path" if path is None else "finding a start")
    q0, path, found = _setting(moved, start, path, plane, radius)
    notes = [*machine.warnings, *found]

    plain = Pseudoinverse(moved)
    options: dict[str, Any] = {"cycles": cycles, "steps": steps, "period": period}
    box: Region
    if region is None:
        say("following the path with J⁺")
        box = defaults.choose_region(moved, follow(plain, path, q0, cycles=1, steps=steps, period=period))
    else:
        box = Box(q0, float(region)) if isinstance(region, (int, float)) else region

    say(f"designing the nearest repeatable inverse, degree {degree}")
    if region is None:  # J⁺ creeps away from where the repeatable inverse will be: a linear one finds the way
        linear, _, _ = _design(plain, box, 1, seed, fixed=False)
        closed = _run("", "", linear.inverse, path, q0, options | {"cycles": 1}).motion
        box = box if closed is None else defaults.choose_region(moved, closed)
    design, box, shrunk = _design(plain, box, degree, seed, fixed=region is not None)
    notes.extend(shrunk)

    say(f"following the path for {cycles} cycles")
    N = align(nullspace(moved.jacobian(q0)), np.eye(moved.n)[:, : moved.r])
    away = np.clip(q0 + POSTURE_OFFSET * N[:, 0], moved.lower, moved.upper)
    rows = [
        replace(_run("pseudoinverse", "J⁺", plain, path, q0, options), distance=0.0),
        _run("posture", "J⁺ + posture", PostureControl(moved, q0, POSTURE_GAIN), path, q0, options),
        _run(
            "posture_off",
            "J⁺ + posture, off it",
            PostureControl(moved, away, POSTURE_GAIN),
            path,
            q0,
            options,
        ),
        *(_run(name, name, control, path, q0, options) for name, control in own.items()),
    ]
    notes.extend(_where_it_creeps(plain, q0, rows[0].motion))
    repeatable = _run("repeatable", "nearest repeatable", design.inverse, path, q0, options)
    if repeatable.motion is not None:
        covered = float(np.mean(box.ratio(repeatable.motion.q) <= 1))
        if covered < 1:
            notes.append(
                f"the repeatable motion spends {1 - covered:.1%} of its time outside Ω, where nothing was designed"
            )
    rows.append(replace(repeatable, clearance=_clearance(design, repeatable.motion), distance=design.relative_distance))
    return Study(moved, q0, path, box, design, tuple(rows), tuple(notes))


def _setting(
    task: Task,
    start: ArrayLike | None,
    path: Path | Callable[[Task, Array], Path] | None,
    plane: str | None,
    radius: float | None,
) -> tuple[Array, Path, list[str]]:
    """Take the start, or the first good one from which the path can be followed; and say which it is."""
    offered = defaults.starts(task) if start is None else [(task.check(start, "--start"), "")]
    failure: RepctlError | None = None
    for q0, where in offered:
        notes = [f"start: {where}"] if where else []
        try:
            if defaults.dexterity(task, q0) < 1e-3:
                raise SingularityError(
                    f"the start is at a singularity of {task.frame!r}, {task.kind}; choose another --start"
                )
            if path is None:
                return q0, defaults.choose_path(task, q0, plane=plane, radius=radius), notes
            found = path if isinstance(path, Path) else path(task, q0)
            if np.linalg.norm(task.error(q0, found.placement(0.0))) > 1e-6:
                q0 = reach(task, q0, found.placement(0.0))
                notes.append("the start was moved to the path's first point")
            check_reach(task, q0, found)
        except RepctlError as error:
            failure = failure or error  # of the best start
            continue
        return q0, found, notes
    assert failure is not None  # there is always a start to try
    raise failure


def _own_controls(task: Task, controls: Mapping[str, Control]) -> dict[str, Strategy]:
    """Make strategies of a person's own controls."""
    own: dict[str, Strategy] = {}
    for name, control in controls.items():
        if name in RESERVED or not name.strip():
            raise InputError(f"controls: {name!r} is taken; give your control another name")
        if not isinstance(control, Strategy):
            own[name] = FunctionStrategy(task, control)
        elif (control.task.frame, control.task.kind, control.task.joint_names) == (
            task.frame,
            task.kind,
            task.joint_names,
        ):
            own[name] = control
        else:
            raise InputError(
                f"controls: {name!r} controls {control.task.frame!r}, {control.task.kind}, "
                f"but the study is of {task.frame!r}, {task.kind}, by {task.n} joints"
            )
    return own


def _run(key: str, label: str, strategy: Strategy, path: Path, q0: Array, options: dict[str, Any]) -> Row:
    """Follow the path with one strategy; a strategy that gets stuck is a finding, not a failure."""
    try:
        return Row(key, label, follow(strategy, path, q0, **options))
    except SingularityError as error:
        return Row(key, label, None, stopped=str(error))


def _design(
    plain: Pseudoinverse, region: Region, degree: int, seed: int, *, fixed: bool
) -> tuple[Design, Region, list[str]]:
    """Design in the region; one that was not asked for by name is shrunk until it is free of singularities."""
    try:
        design = nearest_repeatable(plain, None, region, degree=degree, seed=seed, shrink=not fixed)
    except SingularityError as error:
        raise SingularityError(f"{error}" + (" (--region)" if fixed else "")) from None
    note = [f"Ω was shrunk to {design.shrunk:.0%} to keep clear of singularities"] if design.shrunk < 1 else []
    return design, design.region, note


def _where_it_creeps(plain: Pseudoinverse, q0: Array, motion: Motion | None) -> list[str]:
    """Say in which plane J⁺ does creep, where it hardly does on the path: an arm is not repeatable for that."""
    task = plain.task
    if motion is None or motion.drift[0] > LITTLE or task.m < 3:
        return []
    per_area = drift_per_area(plain, q0)
    a, b = np.unravel_index(int(per_area.argmax()), per_area.shape)
    most = float(per_area[a, b])
    if most < 0.01:
        return []
    plane = "".join("xyz"[k] for k in sorted((a, b)))
    units = "rad" if task.revolute.all() else "rad and m"
    return [f"J⁺ hardly creeps on this path, but small loops in {plane} make it creep by {most:.2g} {units} per m²"]


def _clearance(design: Design, motion: Motion | None) -> float:
    """Worst clearance along a motion's cycles, or over Ω where there is no motion."""
    from ..redundancy import clearance

    if motion is None:
        return design.clearance
    Q = motion.q[:: max(1, motion.steps // 50)]
    N = nullspace(design.task.jacobians(Q))
    return float(clearance(N, design.inverse.field.gradients(Q)).min())


def _row_dict(row: Row) -> dict[str, Any]:
    motion = row.motion
    if motion is None:
        return {"label": row.label, "stopped": row.stopped}
    violation = motion.first_violation
    margin = float(motion.limit_margin.min())
    return {
        "label": row.label,
        "drift_first": float(motion.drift[0]),
        "drift_last": float(motion.drift[-1]),
        "drift": motion.drift.tolist(),
        "tracking_error": float(motion.tracking_error.max()),
        "turning_error": float(motion.turning_error.max()),
        "rms_speed": motion.rms_speed,
        "peak_speed": motion.peak_speed,
        "limit_margin": margin if np.isfinite(margin) else None,
        "first_violation": None if violation is None else {"cycle": violation[0], "joint": violation[1]},
        "clearance": row.clearance,
        "distance": row.distance,
    }


__all__ = ["InputError", "Row", "Study", "study"]
