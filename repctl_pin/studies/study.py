"""Compare every strategy on one arm and one closed path."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array, as_int, function, positive, require_choice, require_type
from ..design import Design, SingularRegionError, nearest_repeatable
from ..errors import InputError, SingularityError
from ..fit_options import FitOptions
from ..integrability import drift_per_area
from ..motion import ClosedPath, Motion, TaskPath, check_length, follow
from ..motion.fitting_circle import fitting_circle
from ..motion.joint_motion import cycle_of
from ..motion.motion import ON_PATH
from ..motion.spec import parse_path
from ..paths.shapes import PLANES
from ..paths.task_path import Cycle
from ..redundancy import align, nullspace
from ..regions import Box, Region
from ..robot.bodies import bodies_of
from ..robot.robot import Robot
from ..robot.task import Task
from ..strategies import FunctionStrategy, PostureControl, Pseudoinverse, Strategy
from ..strategies.names import LABELS
from . import defaults
from .start_and_path import DEAR, Setting, choose_setting, design_from, shrunk_note, whose_fault
from .study_result import Row, Study, evaluated

Control = Strategy | Callable[[Array, Array], ArrayLike]

POSTURE_GAIN = 1.0
"""Gain of the posture in the null space, 1/s."""

EDGE = 1e-6
"""How far from the start, rad or m, another one is followed, to see whether it leads elsewhere."""

AMPLIFIED = 1000.0
"""A start is on an edge if one beside it ends a cycle so many times farther away than it began."""

LITTLE = 1e-4
"""Drift per cycle that nobody would see, rad or m."""

POSTURE_OFFSET = 0.57
"""How far off the start the posture of the third strategy lies, rad, along the null space."""


def study(
    robot: str | Robot,
    *,
    frame: str | None = None,
    kind: str | None = None,
    start: ArrayLike | None = None,
    path: str | ClosedPath | Callable[[Task, Array], TaskPath] | None = None,
    radius: float | None = None,
    plane: str | None = None,
    cycles: int = 10,
    steps: int = 500,
    region: float | Region | None = None,
    degree: int | None = None,
    weight: ArrayLike | str | None = None,
    controls: Mapping[str, Control] | None = None,
    period: float | None = None,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Study:
    """Compare J⁺, J⁺ with a posture, and the nearest repeatable inverse on one closed path.

    Parameters
    ----------
    robot
        A catalogue name, a path to a URDF, or a robot already loaded.
    frame, kind
        The frame to move and the kind of task; by default the arm's end and the first of pose,
        position, xy, xz, yz that is redundant.
    start : (n,) array, optional
        q0, rad (m for sliding joints); by default the first that can follow the path: the reference
        pose, the ready one, mid-range, or a dexterous pose near it.
    path
        A closed path, its name on the command line (``"circle:0.1"``, ``"loop.csv"``), or a
        function ``(task, q0) → path``; by default a circle the arm can follow inside its limits.
    radius, plane
        Of that circle, m; and ``xy``, ``yz`` or ``xz``, its plane or that of a path given by name.
    cycles, steps
        Number of cycles, and RK4 steps in each, open loop.
    region
        Ω: a half-width round the start, rad (and m), or a region; by default a tube round the
        cycle.
    degree
        Degree of the polynomial basis; by default 2, or 1 for arms of so many joints that 2 would
        take long.
    weight : str or (n,) or (n, n) array, optional
        Of the desired inverse, in place of J⁺: ``"inertia"``, ``"limits"``, or as
        :class:`WeightedInverse` takes it.
    controls
        Controls of your own to compare, by name: strategies on this task, or
        functions (q, ẋ) → q̇.
    period
        Period of one cycle, s; by default the path's own, else 5, or longer if that is too fast for
        a joint.
    seed
        Of the nodes.
    progress
        Called with a line on what is being done; it begins with "note: " if that will take long.

    Returns
    -------
    Study

    Raises
    ------
    InputError
        If anything given cannot be used; the message says what to give instead.
    SingularityError
        If the start is singular, or the design is, in every region tried.

    Examples
    --------
    >>> study = rp.study("ppr", cycles=2, steps=50)
    >>> bool(study.row("pseudoinverse").motion.drift[-1] > 1e-3)  # rad or m
    True
    >>> bool(study.row("repeatable").motion.drift[-1] < 1e-6)
    True
    """
    if progress is not None:
        function(progress, "progress", "a function that takes a word on what is being done")
    if isinstance(region, (int, float)):
        region = positive(region, "region, a half-width,", "rad")
    elif region is not None:
        require_type(
            region,
            Region,
            "region",
            "a half-width, rad, or a region of joint space, such as rp.Box(q0, 0.3)",
        )
    if radius is not None:
        radius = positive(radius, "the radius of a circle", "m")
        if path is not None:
            raise InputError("radius= is of the default circle; leave it out, or path=")
    if plane is not None:
        require_choice(plane, PLANES, "plane")
        if not (path is None or isinstance(path, str)):
            raise InputError(
                "plane= is of the default circle, or of a path given by name; this path has its own"
            )
    cycles, steps, seed = (
        as_int(cycles, "cycles", 1),
        as_int(steps, "steps", 1),
        as_int(seed, "seed"),
    )
    if period is not None:
        period = positive(period, "the period", "s")
    say = progress or (lambda text: None)
    say("loading the robot")
    machine = robot if isinstance(robot, Robot) else Robot.load(robot)
    moved = defaults.choose_task(machine, frame, kind)
    degree, long = defaults.choose_degree(moved, degree)
    for note in long:
        say(f"note: {note}")
    check_length(moved, cycles, steps)
    own = _own_controls(moved, {} if controls is None else controls)
    say("finding a path" if path is None else "finding a start")
    wanted_path = parse_path(path, plane) if isinstance(path, str) else path
    desired, wished = defaults.choose_desired(moved, weight)
    if weight is not None:
        own = {wished: desired} | own
    round_it = (
        partial(fitting_circle, plane=plane, radius=radius) if wanted_path is None else wanted_path
    )
    degree_text = f"designing the nearest repeatable inverse, degree {degree}"

    def report(what: str, share: float) -> None:
        say(f"{degree_text}: {what}, {share:.0%}")

    def make(box: Region) -> Design:
        say(degree_text)
        shown = report if progress is not None else False
        return nearest_repeatable(
            desired,
            None,
            box,
            degree=degree,
            options=FitOptions(seed=seed),
            shrink=region is None,
            progress=shown,
        )

    if region is None:
        setting, design = design_from(desired, start, round_it, make, seed=seed, say=say)
    else:
        setting = choose_setting(moved, start, round_it)
        design = _asked(make, region, setting.q0)
    q0, drawn = setting.q0, setting.drawn
    notes = [
        *machine.warnings,
        *(defaults.kind_note(machine, moved) if kind is None else []),
        *setting.notes,
    ]
    notes.extend([*long, *_unlimited(moved)])
    notes.extend([*bodies_of(moved).notes, *shrunk_note(design)])
    say(f"following the path for {cycles} cycles")
    rows, time, slower, edges = _followed(
        setting, design, own, cycles=cycles, steps=steps, period=period
    )
    say("evaluating body distances and fastest cycles")
    rows = [evaluated(row) for row in rows]
    notes.extend([*slower, *edges, *_off_the_path(rows), *_beyond_limits(rows)])
    notes.extend(_where_it_drifts(Pseudoinverse(moved), q0, rows[0].motion))
    notes.extend(_why_it_costs(rows[0].motion, rows[-1].motion))
    design = replace(design, cycle=Cycle(q0, drawn, time))
    return Study(moved, q0, drawn, design.region, design, tuple(rows), tuple(notes), time)


def _followed(
    setting: Setting,
    design: Design,
    own: Mapping[str, Strategy],
    *,
    cycles: int,
    steps: int,
    period: float | None,
) -> tuple[list[Row], float, list[str], list[str]]:
    """Follow the path with every control: their rows, the period, why it is longer than usual, and
    edges."""
    q0, drawn, task = setting.q0, setting.drawn, design.inverse.task
    usual = period or drawn.period or defaults.PERIOD
    options: dict[str, Any] = {"cycles": cycles, "steps": steps, "period": usual}
    last = _run("repeatable", design.inverse, drawn, q0, options)
    if last.motion is None:
        last = replace(last, stopped=whose_fault(last.stopped, task, drawn, q0))
    else:
        last = replace(last, motion=replace(last.motion, region=design.region))
    itself = (
        0.0 if type(design.desired) is Pseudoinverse else None
    )  # the distance of J⁺ from what was desired
    first = replace(_run("pseudoinverse", Pseudoinverse(task), drawn, q0, options), distance=itself)
    slower: list[str] = []
    if period is None:
        options["period"], slower = defaults.choose_period(
            usual, {row.label: row.motion for row in (last, first)}
        )
        first, last = (_slowed(row, options["period"] / usual) for row in (first, last))
    N = align(nullspace(task.jacobian(q0)), np.eye(task.n)[:, : task.r])
    away = np.clip(q0 + POSTURE_OFFSET * N[:, 0], task.lower, task.upper)
    rows = [
        first,
        _run("posture", PostureControl(task, q0, POSTURE_GAIN), drawn, q0, options),
        _run("posture_off", PostureControl(task, away, POSTURE_GAIN), drawn, q0, options),
        *(_run(name, control, drawn, q0, options) for name, control in own.items()),
        replace(
            last, leaf_margin=_leaf_margin(design, last.motion), distance=design.relative_distance
        ),
    ]
    edges = [
        *_on_an_edge(first, Pseudoinverse(task), drawn, q0, options),
        *_on_an_edge(last, design.inverse, drawn, q0, options),
    ]
    return rows, options["period"], slower, edges


def _on_an_edge(
    row: Row, strategy: Strategy, path: TaskPath, q0: Array, options: dict[str, Any]
) -> list[str]:
    """Warn if a start that differs by a millionth, along the self-motion, leads elsewhere within a
    cycle."""
    task = strategy.task
    beside = q0 + EDGE * nullspace(task.jacobian(q0))[:, 0]
    other = _run(row.key, strategy, path, beside, options | {"cycles": 1}).motion
    if row.motion is None and other is None:
        return []
    where = "stops" if other is None else "goes on"
    if row.motion is not None and other is not None:
        gap = float(np.linalg.norm(other.q[-1] - row.motion.cycle(0)[-1]))
        if gap <= AMPLIFIED * EDGE:
            return []
        where = f"ends cycle 1 {gap:.2g} {task.unit} away"
    return [
        f"{row.label}: the start is on an edge: from a start that differs by {EDGE:g} {task.unit} the motion {where}; "
        "choose another start or a smaller path"
    ]


def _own_controls(task: Task, controls: Mapping[str, Control]) -> dict[str, Strategy]:
    """Make strategies of user-defined controls."""
    own: dict[str, Strategy] = {}
    require_type(
        controls,
        Mapping,
        "controls",
        "a dictionary that gives each control a name, such as {'mine': control}",
    )
    for name, control in controls.items():
        if not isinstance(name, str) or name in (*LABELS, *LABELS.values()) or not name.strip():
            raise InputError(f"controls: {name!r} is taken; give your control another name")
        if not isinstance(control, Strategy):
            own[name] = FunctionStrategy(task, control)
        elif all(
            getattr(control.task, what) == getattr(task, what)
            for what in ("frame", "kind", "joint_names")
        ):
            own[name] = control
        else:
            raise InputError(
                f"controls: {name!r} controls {control.task.frame!r}, {control.task.kind}, "
                f"but the study is of {task.frame!r}, {task.kind}, by {task.n} joints"
            )
    return own


def _run(key: str, strategy: Strategy, path: TaskPath, q0: Array, options: dict[str, Any]) -> Row:
    """Follow the path with one strategy; a strategy that gets stuck is a finding, not a failure."""
    label = LABELS.get(key, key)
    try:
        return Row(key, label, follow(strategy, path, q0, **options))
    except SingularityError as error:
        return Row(key, label, None, stopped=str(error))


def _asked(make: Callable[[Region], Design], region: float | Region, q0: Array) -> Design:
    """Design in the region that was asked for; where it holds a singularity, say which one would
    do."""
    try:
        return make(Box(q0, float(region)) if isinstance(region, (int, float)) else region)
    except SingularRegionError as error:
        if error.free is None:
            raise error.with_remedy("choose another start") from None
        number = isinstance(region, (int, float))
        remedy = f"give region={defaults.half_width_within(error.free)}" if number else "take that"
        raise error.with_remedy(remedy) from None


def _slowed(row: Row, factor: float) -> Row:
    return row if row.motion is None else replace(row, motion=row.motion.slowed(factor))


def _unlimited(task: Task) -> list[str]:
    """Name the joints that have no speed limit."""
    limits = zip(task.robot_joints, task.joint_limits[2], strict=True)
    names = [name for name, limit in limits if not np.isfinite(limit)]
    return (
        [f"no speed limit in the URDF, so speeds are not checked: {', '.join(names)}"]
        if names
        else []
    )


def _off_the_path(rows: Sequence[Row]) -> list[str]:
    """Say under which controller the frame leaves its path, when, and by how much."""
    notes: list[str] = []
    for row in rows:
        motion = row.motion
        if motion is None or motion.path_loss is None:
            continue
        when, distance, angle = motion.path_loss
        turned = f" and {angle:.2g} rad" if angle > ON_PATH else ""
        notes.append(
            f"{row.label}: {motion.task.frame} leaves the path in cycle {cycle_of(when, motion.cycles)}, by up to "
            f"{distance:.2g} m{turned}; the arm is near a singularity, or the steps are too few"
        )
    return notes


def _why_it_costs(plain: Motion | None, closed: Motion | None) -> list[str]:
    """Say why a repeatable motion takes much more joint speed than J⁺'s: what it costs, and what
    J⁺'s drift saves."""
    if plain is None or closed is None or plain.path_loss or closed.path_loss:
        return []
    extra = closed.first_rms_speed / plain.first_rms_speed - 1
    if extra <= DEAR:
        return []
    Q, qdot = closed.q[: closed.steps], closed.qdot[: closed.steps]
    J = closed.task.jacobians(Q)
    least = (np.linalg.pinv(J) @ (J @ qdot[:, :, None]))[:, :, 0]
    same = np.sqrt((qdot**2).sum() / (least**2).sum()) - 1
    return [
        f"joint speed: {same:+.1%} relative to J⁺ at the same configurations; the rest of {extra:+.1%} is due to J⁺'s "
        f"drift of {plain.drift[0]:.2g} {plain.task.unit} in cycle 1, to configurations in which the path takes less"
    ]


def _beyond_limits(rows: Sequence[Row]) -> list[str]:
    """Say which joints leave their limits, of position or of speed, and which bodies touch, under
    which control."""
    notes: list[str] = []
    for row in rows:
        motion = row.motion
        if motion is None:
            continue
        notes.extend(f"{row.label}: {violation}" for violation in row.violations)
        if motion.speed_ratio > 1 + 1e-9:
            times = f"{motion.speed_ratio:.2g} times as fast as its limit allows"
            notes.append(f"{row.label}: {motion.fastest_joint} goes {times}")
    return notes


def _where_it_drifts(plain: Pseudoinverse, q0: Array, motion: Motion | None) -> list[str]:
    """Say in which plane J⁺ drifts, where it hardly does on the path: an arm is not repeatable for
    that."""
    task = plain.task
    if motion is None or motion.drift[0] > LITTLE or task.m < 3:
        return []
    per_area = drift_per_area(plain, q0)
    a, b = np.unravel_index(int(per_area.argmax()), per_area.shape)
    most = float(per_area[a, b])
    if most < 0.01:
        return []
    plane = "".join("xyz"[k] for k in sorted((a, b)))
    return [
        f"J⁺ hardly drifts on this path, but on small loops in {plane} it drifts by {most:.2g} {task.unit} per m²"
    ]


def _leaf_margin(design: Design, motion: Motion | None) -> float:
    """Worst leaf margin along a motion's cycles, or over Ω where there is no motion."""
    from ..redundancy import leaf_margin

    if motion is None:
        return design.leaf_margin
    Q = motion.q[:: max(1, motion.steps // 50)]
    N = nullspace(design.task.jacobians(Q))
    return float(leaf_margin(N, design.inverse.potentials.gradients(Q)).min())
