"""Comparison of all strategies on one problem: one arm and one closed path.

A strategy is a controller, such as J⁺ or the nearest repeatable inverse. A row has the result of
one strategy: its motion, or the reason why it stopped. The design is the repeatable inverse made
for the problem. Ω is the region of joint space for which the design is made; its potentials are the
functions of the joints that its motions keep constant. A self-motion moves the joints while the
frame rests. A posture is the configuration to which a posture task pulls the joints by self-motion.

``Row`` is the result of one strategy in a study: its motion and figures, or why it stopped.
``Inverse`` is a matrix function G(q) (n, m) with J G = I, evaluated at q (n,) or Q (K, n).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from time import thread_time
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array, as_int, function, positive, require_type
from ..base.defaults import CYCLES, PERIOD, STEPS
from ..base.errors import InputError, SingularityError
from ..base.fit_options import FitOptions, fit_options
from ..base.plugins import parts
from ..design import Design, nearest_repeatable
from ..model.bodies import bodies_of
from ..model.robot import Robot
from ..model.task import Task
from ..motion import Motion, check_length, followed, unresolved
from ..paths import Cycle, TaskPath
from ..redundancy import align, leaf_margin, nullspace
from ..regions import Region
from ..strategies import Inverse, PostureControl, Pseudoinverse, Strategy
from .around_motion import design_for, own_failure, shrunk_note
from .design_choice import choose_degree, choose_desired
from .period import choose_period
from .problem import Problem
from .quantities import LABELS
from .study_notes import least_motion_notes, motion_notes, unlimited_speeds
from .study_result import Row, Study, evaluated
from .task_choice import kind_note

_Control = Strategy | Callable[[Array, Array], ArrayLike]

_POSTURE_GAIN = 1.0
"""Gain of the posture task in the null space, 1/s."""

_EDGE = 1e-6
"""Distance between the start and a second start, rad or m. Their motions are compared to see
whether the start lies on an edge: starts on its two sides lead to different motions."""

_AMPLIFIED = 1000.0
"""Growth factor of the distance ``_EDGE`` in one cycle above which the start is on an edge."""

_POSTURE_OFFSET = 0.57
"""Distance of the second posture from the start, rad, along the first null vector."""


def study(
    robot: str | Robot | Task | Problem,
    *,
    cycles: int = CYCLES,
    steps: int = STEPS,
    period: float | None = None,
    degree: int | None = None,
    weight: ArrayLike | str | None = None,
    controls: Mapping[str, _Control] | None = None,
    options: FitOptions | None = None,
    progress: Callable[[str], None] | None = None,
) -> Study:
    """Compare J⁺, J⁺ with a posture, and the nearest repeatable inverse on one closed path.

    The study shows how far an arm drifts under the usual controllers, and designs one that does not
    drift.

    Parameters
    ----------
    robot : str, Robot, Task or Problem
        Problem to study, with its frame, kind, start, path and region Ω. A robot or a task is
        converted by :class:`Problem`, with default values of all these parts.
    cycles, steps
        Number of cycles, and RK4 steps per cycle, open loop.
    period
        Period of one cycle, s; by default the path's own, else 5, or longer if a joint would exceed
        its speed limit.
    degree
        Degree of the polynomial basis of the potentials; by default 2, or 1 if degree 2 would take
        long because of the number of joints.
    weight : str or (n,) or (n, n) array, optional
        Weight of the desired inverse, which then replaces J⁺: ``"inertia"``, ``"limits"``,
        ``"absolute"``, n positive numbers, or a positive definite (n, n) matrix.
    controls
        Custom controllers to compare, by name: strategies for this task, or functions
        (q, ẋ) → q̇.
    options
        Options of the design's fit, such as ``rp.FitOptions(seed=1)``.
    progress
        Callback that receives a description (str) of each step when it begins; a description that
        begins with "note: " warns of a long computation.

    Returns
    -------
    Study

    Raises
    ------
    InputError
        If an argument cannot be used; the message says what to give instead.
    SingularityError
        If the start is singular, or no region tried is free of singularities of the design.

    Examples
    --------
    >>> study = rp.study("ppr", cycles=2, steps=50)
    >>> bool(study.row("pseudoinverse").motion.drift[-1] > 1e-3)  # rad or m
    True
    >>> bool(study.row("repeatable").motion.drift[-1] < 1e-6)
    True
    >>> problem = rp.Problem("ppr", path="circle:0.2", start=[0.2, 0.2, 0.3])
    >>> rp.study(problem, cycles=1, steps=50).path.name
    'circle of radius 0.2 m in xy'
    """
    begun = thread_time()
    say = _reporter(progress)
    cycles = as_int(cycles, "cycles", 1)
    steps = as_int(steps, "steps", 1)
    options = fit_options(options)
    if period is not None:
        period = positive(period, "period", "s")
    say("loading the robot and finding a start and a path")
    problem = robot if isinstance(robot, Problem) else Problem(robot)
    task = problem.task
    _ = problem.cycle  # refuses a problem without a path
    degree, long = choose_degree(task, degree)
    for note in long:
        say(f"note: {note}")
    check_length(task, cycles, steps)
    custom = _custom_controls(task, {} if controls is None else controls)
    desired, name = choose_desired(task, weight)
    if weight is not None:
        custom = {name: desired} | custom
    problem, design = _designed(problem, desired, degree, options, say, quiet=progress is None)
    design = replace(design, cycle=Cycle(problem.start, problem.cycle, period or PERIOD))
    for addition in parts("study_design"):
        design = addition(design, thread_time() - begun, say)
    say(f"following the path for {cycles} cycles")
    rows, time, slower = _rows(problem, design, custom, cycles=cycles, steps=steps, period=period)
    say("evaluating body distances")
    rows = [evaluated(row) for row in rows]
    design = replace(design, cycle=Cycle(problem.start, problem.cycle, time))
    return Study(
        task=task,
        q0=problem.start,
        path=problem.cycle,
        region=design.region,
        design=design,
        rows=tuple(rows),
        notes=tuple(_notes(problem, design, rows, long, slower)),
        period=time,
    )


def _reporter(progress: Callable[[str], None] | None) -> Callable[[str], None]:
    """Check the progress callback; for None, return a function that does nothing."""
    if progress is None:
        return lambda text: None
    function(progress, "progress", "a function that takes the name of the step that begins")
    return progress


def _designed(
    problem: Problem,
    desired: Inverse,
    degree: int,
    options: FitOptions,
    say: Callable[[str], None],
    *,
    quiet: bool,
) -> tuple[Problem, Design]:
    """Design the repeatable inverse nearest to ``desired``; return problem and design.

    The returned problem can have another start than ``problem``, unless the user gave the start or
    the region: default starts are tried, as :func:`design_for` describes, until the repeatable
    motion keeps the limits, with a joint speed at most 5 % above that of J⁺. ``degree`` is that of
    the polynomials. ``say`` receives the name of each step; if ``quiet``, the steps of the fit are
    not reported.
    """
    designing = f"designing the nearest repeatable inverse, degree {degree}"

    def report(step: str, fraction: float) -> None:
        say(f"{designing}: {step}, {100 * fraction:.0f} %")

    def make(region: Region) -> Design:
        say(designing)
        return nearest_repeatable(
            desired,
            None,
            region,
            degree=degree,
            options=options,
            shrink="region" not in problem.given,
            progress=False if quiet else report,
        )

    return design_for(problem, desired, make, seed=options.seed, say=say)


def _notes(
    problem: Problem, design: Design, rows: list[Row], long: list[str], slower: list[str]
) -> list[str]:
    """Collect the notes of a study, in the order in which they are shown.

    ``long`` are the notes on the choice of the degree, and ``slower`` those on the period and the
    start. The others are made here.
    """
    task = problem.task
    return [
        *problem.warnings,
        *(note for found in parts("study_notes") for note in found(design)),
        *([] if "kind" in problem.given else kind_note(task)),
        *problem.notes,
        *long,
        *unlimited_speeds(task),
        *bodies_of(task).notes,
        *shrunk_note(design),
        *slower,
        *motion_notes(task, problem.start, rows),
        *least_motion_notes(design, problem.cycle, problem.start),
    ]


def _rows(
    problem: Problem,
    design: Design,
    custom: Mapping[str, Strategy],
    *,
    cycles: int,
    steps: int,
    period: float | None,
) -> tuple[list[Row], float, list[str]]:
    """Follow the path with every controller of a study, and choose the period, the same for all.

    Controllers are J⁺, J⁺ with two postures, ``custom`` by name, and the design's inverse, in this
    order. ``cycles`` and ``steps`` are the numbers of cycles, and of steps per cycle. If ``period``
    is None, it is chosen so that no joint exceeds its speed limit in cycle 1 of J⁺ and of the
    design's inverse. Returns the rows, the period, s, and notes: on the period, and on J⁺ or the
    design's inverse if its motion changes when the start moves by 1e-6 along the self-motion.
    """
    q0 = problem.start
    path = problem.cycle
    task = design.inverse.task
    plain = Pseudoinverse(task)
    usual = period or path.period or PERIOD
    options: dict[str, Any] = {"cycles": cycles, "steps": steps, "period": usual}
    # J⁺ and the repeatable inverse, which decide the period
    last = _repeatable(design, path, q0, options)
    followed = _run("pseudoinverse", plain, path, q0, options)
    first = _resolved(followed, plain)
    if type(design.desired) is Pseudoinverse:
        first = replace(first, distance=0.0)
    slower: list[str] = []
    if period is None:
        motions = {row.label: row.motion for row in (last, first)}
        options["period"], slower = choose_period(usual, motions)
        factor = options["period"] / usual
        first, last = (
            replace(row, motion=row.motion.slowed(factor)) if row.motion else row
            for row in (first, last)
        )
    # all controllers, in the order of the table
    near, other = _postures(task, q0)
    margin = _leaf_margin(design, last.motion)
    rows = [
        first,
        _run("posture", near, path, q0, options),
        _run("posture_off", other, path, q0, options),
        *(_run(name, control, path, q0, options) for name, control in custom.items()),
        replace(last, leaf_margin=margin, distance=design.relative_distance),
    ]
    # starts on an edge between two motions
    edges = [
        *edge_warning(followed, plain, path, q0, options),
        *edge_warning(last, design.inverse, path, q0, options),
    ]
    return rows, options["period"], [*slower, *edges]


def _postures(task: Task, q0: Array) -> tuple[PostureControl, PostureControl]:
    """Make two controllers with a posture task: at q0 (n,), and at a configuration beside q0.

    The second posture is a step of 0.57 rad or m from q0 in the null space of J, clipped to the
    joint limits.
    """
    N = align(nullspace(task.jacobian(q0)), np.eye(task.n)[:, : task.r])
    away = np.clip(q0 + _POSTURE_OFFSET * N[:, 0], task.lower, task.upper)
    near, other = (PostureControl(task, posture, _POSTURE_GAIN) for posture in (q0, away))
    return near, other


def _repeatable(design: Design, path: TaskPath, q0: Array, options: dict[str, Any]) -> Row:
    """Follow the path with the design's inverse from q0 (n,), and return its row of the study.

    The design's region Ω and its proved closing radius are added to the motion, as its attributes
    ``region`` and ``closing_radius``. Closed paths within this radius of the start, or of a path,
    close in joint space. If the design cannot follow a path that J⁺ can follow, the attribute
    ``stopped`` of the row names the design as the cause. ``options`` are passed to ``follow``.
    """
    row = _run("repeatable", design.inverse, path, q0, options)
    if row.motion is not None:
        closes = design.proof.closes if design.proof else None
        motion = replace(row.motion, region=design.region, closing_radius=closes)
        return replace(row, motion=motion)
    failure = own_failure(design.task, path, q0)
    return row if failure is None else replace(row, stopped=str(failure))


def edge_warning(
    row: Row, strategy: Strategy, path: TaskPath, q0: Array, options: dict[str, Any]
) -> list[str]:
    """Make a warning if the motion changes when its start moves by 1e-6 along the self-motion.

    From such a start, the motion depends on rounding errors. ``row`` is the result of ``strategy``
    from q0 (n,), and ``options`` are passed to ``follow``. Cycle 1 is followed again from a start
    1e-6 rad or m beside q0. The list is empty if both motions end cycle 1 within 1e-3 rad or m of
    each other, or if both stop; otherwise it has one text.
    """
    task = strategy.task
    beside = q0 + _EDGE * nullspace(task.jacobian(q0))[:, 0]
    other = _run(row.key, strategy, path, beside, options | {"cycles": 1}).motion
    if row.motion is None and other is None:
        return []
    where = "stops" if other is None else "goes on"
    if row.motion is not None and other is not None:
        gap = float(np.linalg.norm(other.q[-1] - row.motion.cycle(0)[-1]))
        if gap <= _AMPLIFIED * _EDGE:
            return []
        where = f"ends cycle 1 {gap:.2g} {task.unit} away"
    differs = f"from a start that differs by {_EDGE:g} {task.unit} the motion {where}"
    edge = f"{row.label}: the start is on an edge between two motions: {differs}"
    return [f"{edge}; choose another start or a smaller path"]


def _custom_controls(task: Task, controls: Mapping[str, _Control]) -> dict[str, Strategy]:
    """Convert the user's controllers, given by name, to strategies for a task, by name.

    InputError is raised if the controllers are not in a dictionary, or one cannot be converted.
    """
    what = "a dictionary that gives each controller a name, such as {'mine': control}"
    require_type(controls, Mapping, "controls", what)
    return {name: _custom_control(task, name, control) for name, control in controls.items()}


def _custom_control(task: Task, name: object, control: _Control) -> Strategy:
    """Convert a custom controller, a function (q, ẋ) → q̇ or a strategy, to a strategy for a task.

    Raises
    ------
    InputError
        If the name is empty, no text, or that of another controller of the study, or if the
        strategy is for a different task.
    """
    if not isinstance(name, str) or not name.strip():
        raise InputError(
            f": a name must be a text that is not empty; got {name!r}", argument="controls"
        )
    if name in (*LABELS, *LABELS.values()):
        raise InputError(
            f": {name!r} is the name of a controller of the study",
            argument="controls",
            remedy="give the custom controller another name",
        )
    if not isinstance(control, Strategy):
        from ..strategies.custom import FunctionStrategy

        return FunctionStrategy(task, control)
    same = ("frame", "kind", "joint_names")
    if all(getattr(control.task, part) == getattr(task, part) for part in same):
        return control
    raise InputError(
        f": {name!r} is for a {control.task.kind} task of {control.task.frame!r} "
        f"({', '.join(control.task.joint_names)}), but the study is for a {task.kind} task of "
        f"{task.frame!r} ({', '.join(task.joint_names)})",
        argument="controls",
        remedy="make the controller for the task of the study",
    )


def _run(key: str, strategy: Strategy, path: TaskPath, q0: Array, options: dict[str, Any]) -> Row:
    """Follow the path with one controller from q0 (n,), and return its row of the study.

    If the motion stops at a singularity, the row has no motion, and the reason is in ``stopped``.
    ``key`` is the controller's name in files; ``options`` are passed to ``follow``.
    """
    label = LABELS.get(key, key)
    try:
        return Row(key, label, followed(strategy, path, q0, **options))
    except SingularityError as error:
        return Row(key, label, None, stopped=str(error))


def _resolved(row: Row, strategy: Strategy) -> Row:
    """Remove the motion of a row if its drift depends on the number of steps; return the row.

    Such a drift is an integration error near a singularity. The reason is then in ``stopped``.
    """
    why = "" if row.motion is None else unresolved(strategy, row.motion)
    return replace(row, motion=None, stopped=why) if why else row


def _leaf_margin(design: Design, motion: Motion | None) -> float:
    """Evaluate the minimum leaf margin along a motion, at about 50 points per cycle.

    The leaf margin is the distance from an algorithmic singularity, where the potentials no longer
    determine the joints: 1 is best, 0 is singular. Without a motion, the minimum over the design's
    region is returned.
    """
    if motion is None:
        return design.leaf_margin
    Q = motion.q[:: max(1, motion.steps // 50)]
    N = nullspace(design.task.jacobians(Q))
    return float(leaf_margin(N, design.inverse.potentials.gradients(Q)).min())
