"""``repctl check``: test whether a controller is repeatable on an arm; if not, find its drift.

A controller is repeatable if every closed path of the frame ends in the configuration it began in.
Repeatability is tested in the region Ω, a part of joint space. The defect is the amount by which
the controller violates the condition of repeatability; it is 0 where the condition holds. If the
test fails, the controller may still be repeatable on a stable surface: a set of configurations that
its motions do not leave.

``_Case`` is a controller to test, its problem with the region Ω, and notes. ``Surfaces`` are the
points that a search for stable surfaces found, where the defects are 0. A problem is a task with a
start, a closed path and a region. J⁺ is the pseudoinverse, the usual controller. The reference pose
is the default configuration of a robot, from its SRDF or else mid-range.
"""

from __future__ import annotations

from functools import partial
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import repctl_pin as rp

from ..base.defaults import REGION
from ..base.errors import InputError
from ..show.text.coloured_text import fitted
from ..show.text.numbers import row
from .exit_codes import proof_code
from .options import Parser
from .parsed_options import Options, box_within_limits, cut_note, integer, natural, positive
from .print_result import print_result
from .terminal import in_percent, progress

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..integrability.repeatability import Repeatability
    from ..integrability.stable_surface import Surfaces
    from ..strategies import Inverse

HELP = (
    "test whether a controller is repeatable: J⁺, a weighted inverse or a saved design; and "
    "measure its drift"
)
EXAMPLE = """examples:
  repctl check panda --weight inertia
  repctl check repctl-out/panda/design.json          # over its region
  repctl check repctl-out/panda/design.json --prove  # its leaf margin in Ω
  repctl check repctl-out/my_arm/design.json --robot my_arm.urdf"""

_Drift = dict[str, float]
_REFUTED = (
    "the leaf margin there is",
    "the limit margin there is",
    "J_V is singular",
    "no configuration exists",
)
"""Beginnings of the reasons of a proof that found a counterexample, and did not only stop."""

_SMALL = 4
"""Maximum number of joints for which stable surfaces are searched."""


def add_options(parser: Parser) -> None:
    """Add the options of ``repctl check`` to its parser; :func:`run` reads them."""
    parser.what()
    parser.task()
    parser.weight()
    add = parser.add_argument
    region = (
        "half-width of Ω around the start, rad, cut at the joint limits "
        f"(default {REGION}, or that of the design)"
    )
    add("--region", type=positive, metavar="W", help=region)
    add(
        "--samples",
        type=integer,
        default=128,
        help="number of configurations to test (default 128)",
    )
    add("--seed", type=natural, default=0, help="random seed of the configurations (default 0)")
    prove = "prove a lower bound of a saved design's leaf margin over its region, or over its cell"
    add("--prove", action="store_true", help=prove)
    parser.levels("; requires --prove (default: as in the file's certificate)")
    parser.json()


def run(options: Options) -> int:
    """Test whether a controller is repeatable; with ``--prove``, prove a saved design instead.

    The result is printed. If the controller is not repeatable, the result includes the drift of
    small loops and, for arms of up to 4 joints, a search for stable surfaces. Return the exit code:
    0, repeatable or not, or 3 if a proof was not reached.
    """
    say = progress(options.json)
    import numpy as np

    if options.prove:
        return _prove(options, say)
    if options.leaf:
        raise InputError("--leaf requires --prove")
    case = _saved(options) if options.saved else _named(options)
    task, q0 = case.strategy.task, case.problem.start
    region = case.problem.region
    say("evaluating the Lie brackets")
    verdict = rp.is_repeatable(case.strategy, region, samples=options.samples, seed=options.seed)
    drift = _in_planes(rp.drift_per_area(case.strategy, q0), task)
    surfaces = None
    if task.n <= _SMALL and not verdict.repeatable:
        say("searching for stable surfaces")
        low = np.maximum(task.lower, q0 - np.pi)
        high = np.minimum(task.upper, q0 + np.pi)
        box = rp.Box.between(low, high)
        surfaces = rp.stable_surface(case.strategy, box, seed=options.seed)
    return print_result(
        options,
        lambda: _as_dict(case, verdict, drift, surfaces),
        lambda: fitted("\n".join(_lines(case, verdict, drift, surfaces))),
    )


def _prove(options: Options, say: Callable[[str], None]) -> int:
    """Prove the margins of a saved design over its region; print the proof, return the exit code.

    The margins are the leaf margin, which is the distance from an algorithmic singularity, and for
    a cell also the distance from the joint limits. If the file has a certificate, the bounds of
    this earlier proof are proved again; else the largest bounds that can be found. The exit code is
    0 if the proof was reached, else 3. ``say`` receives the name of each step.
    """
    from dataclasses import asdict

    import numpy as np

    if not options.saved:
        raise InputError(
            "--prove requires a saved design (.json)",
            remedy="save one with repctl design or repctl cell",
        )
    for option in ("weight", "region", "start"):
        if getattr(options, option):
            why = "a design is proved over its own region, with its own start"
            raise InputError(
                f"--prove and --{option} are mutually exclusive: {why}", remedy=f"omit --{option}"
            )
    design = options.load_saved()
    held = design.proof
    of_cell = held is not None and isinstance(design, rp.CellDesign)
    radius = None if held is None else held.closes
    proof = rp.prove(
        design,
        margin=None if held is None else held.leaf_margin,
        limit_margin=held.limit_margin
        if held is not None and of_cell and np.isfinite(held.limit_margin)
        else None,
        leaf=options.leaf or (0.0 if radius is None else radius.leaf),
        progress=in_percent(say),
    )
    against = "" if held is None or proof else _against(held, proof)
    lines = [proof.summary(), *([f"note: {against}"] if against else [])]
    print_result(
        options,
        lambda: asdict(proof) | {"notes": [against] if against else []},
        lambda: fitted("\n".join(lines)),
    )
    return proof_code(proof)


def _against(held: rp.Proof, proof: rp.Proof) -> str:
    """Make the note on an earlier proof that could not be repeated.

    ``held`` is the earlier proof, the certificate in the file, and ``proof`` the new one, which
    failed. If it failed by a counterexample, the certificate is false; if it only stopped, for
    instance for lack of time, the certificate is not refuted.
    """
    says = f"the file's certificate says {held!r}"
    if proof.reason.startswith(_REFUTED):
        return f"{says}, which is false: {proof.reason}; do not rely on it"
    why = f": {proof.reason}" if proof.reason else ""
    return f"{says}, which was not reached again{why}"


class _Case(NamedTuple):
    """What the command tests: a controller, over a region Ω of joint space.

    ``strategy`` is the controller, and ``name`` describes it. ``problem`` has the start and Ω, and
    ``start_is`` the origin of the start, such as ``the reference pose``. ``notes`` are printed with
    the result.
    """

    strategy: Inverse
    name: str
    problem: rp.Problem
    start_is: str
    notes: tuple[str, ...] = ()


def _named(options: Options) -> _Case:
    """Make the case for a robot without a design: J⁺, or the weighted inverse of ``--weight``.

    The region Ω is a box of half-width ``--region`` around the start, cut at the joint limits.
    """
    from ..studies.design_choice import choose_desired

    half_width = options.region or REGION
    box = partial(box_within_limits, half_width=half_width)
    problem = options.problem(path=False, region=box)
    strategy, name = choose_desired(problem.task, options.asked_weight())
    notes = cut_note(problem.task, problem.region, half_width)
    return _Case(strategy, name, problem, problem.start_is, notes)


def _saved(options: Options) -> _Case:
    """Make the case of a saved design, tested over its own region or that of ``--region``.

    InputError is raised for ``--weight``, which would choose another controller.
    """
    if options.weight:
        fact = f"the design in {options.what} is the controller to check"
        raise InputError(fact, remedy="omit --weight")
    design = options.load_design()
    problem = options.problem_of(design, path=False)
    start_is = problem.start_is
    notes: tuple[str, ...] = ()
    if options.region is not None:
        box = partial(box_within_limits, half_width=options.region)
        problem = rp.Problem(design.task, start=problem.start, path=False, region=box)
        notes = cut_note(design.task, problem.region, options.region)
    return _Case(design.inverse, f"the design in {options.what}", problem, start_is, notes)


def _in_planes(drift: Any, task: rp.Task) -> _Drift:
    """Convert drift per area, a matrix over axes, to a dict by plane: ``xy``, ``xz``, ``yz``.

    ``drift`` is (k, k), for the k = 2 or 3 base axes along which the task commands the position.
    Entry (a, b) is the norm of the joint drift, rad or m, per m² of a small loop in the plane of
    axes a and b.
    """
    axes = task.kind.directions
    return {axes[a] + axes[b]: float(drift[a, b]) for a, b in combinations(range(len(drift)), 2)}


def _as_dict(
    case: _Case, verdict: Repeatability, drift: _Drift, surfaces: Surfaces | None
) -> dict[str, Any]:
    """Convert the result of a test to plain Python types: the figures by the keys of ``--json``.

    ``verdict`` is the test's result: the defect, and whether it is 0. ``drift`` is the joint drift,
    rad or m, per m² of a small loop, by plane such as ``xy``. ``surfaces`` are the stable surfaces;
    None if they were not searched for.
    """
    from ..studies.study_result import picked, region_dict

    found: dict[str, Any] = {
        **case.strategy.task.as_dict(),
        "strategy": case.name,
        "start": [float(v) for v in case.problem.start],
        "region": region_dict(case.problem.region),
        **picked(verdict, "repeatable", "defect"),
        "defect_at": verdict.at,
        **picked(verdict, "tolerance", "samples"),
        "drift_per_m2": drift,
        "notes": case.notes,
    }
    if surfaces is not None:
        found["surfaces"] = picked(surfaces, "stable", "candidate", "singular")
    return found


def _lines(
    case: _Case, verdict: Repeatability, drift: _Drift, surfaces: Surfaces | None
) -> list[str]:
    """Make the report of a test, as lines of text for a terminal.

    ``verdict`` is the test's result: the defect, and whether it is 0. ``drift``, by plane, is the
    joint drift per m² of a small loop, and ``surfaces`` are the stable surfaces, or None. Both
    appear only if the controller is not repeatable.
    """
    task, problem = case.strategy.task, case.problem
    robot = task.robot
    lines = [
        f"{verdict.summary()}\n",
        f"robot     {robot.name} ({robot.description.path.name})",
        f"task      {task}",
        f"strategy  {case.name}",
        f"start     {row(problem.start)} ({case.start_is})",
        f"region    {problem.region}",
        *(f"note: {note}" for note in case.notes),
    ]
    if not verdict.repeatable:
        lines += [f"worst at  {row(verdict.at)}\n", _drift_table(drift, task.unit)]
        lines += [] if surfaces is None else [f"\n{surfaces.summary()}"]
    return lines


def _three(value: float) -> str:
    """Format a number with three digits and a short exponent: 0.108, 5.28e-5."""
    return f"{value:.3g}".replace("e-0", "e-")


def _drift_table(drift: _Drift, unit: str) -> str:
    """Format the joint drift of a small loop at the start as a table, one row per plane.

    ``drift`` has the drift per m² of the loop's area, in ``unit`` (``rad``, ``m``), by plane of the
    base axes: ``"xy"``, ``"xz"`` and ``"yz"``, or those that the task moves in. The columns give
    the drift per m², per cm², and for a square with sides of 10 cm.
    """
    from ..show.text.table import table

    rows = []
    for plane, value in drift.items():
        clean = value if value > 1e-9 else 0.0  # rounding errors
        rows.append(["–".join(plane), *(_three(clean * scale) for scale in (1, 1e-4, 1e-2))])
    header = ["plane", f"{unit} per m²", f"{unit} per cm²", "around a 10 cm square"]
    title = "joint drift of a small loop at the start, to first order in its area"
    return f"{title}:\n{table(header, rows)}"
