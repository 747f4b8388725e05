"""``repctl check``: is a control repeatable on this arm, and if not, how much does it drift?"""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import InputError
from .options import box_round, is_saved, natural, positive, robot_of, start_of, task_options, what_options, whole
from .saved import load_design
from .terminal import clear_line, progress

if TYPE_CHECKING:
    from ..integrability import Repeatability, Surfaces
    from ..regions import Region
    from ..robot.task import Task
    from ..strategies import Inverse

HELP = "say whether J⁺, a weighted inverse or a saved design is repeatable, and how much it drifts if not"
EXAMPLE = """examples:
  repctl check panda --weight inertia
  repctl check repctl-out/panda/design.json          # a saved design, over the region it was made for
  repctl check repctl-out/my_arm/design.json --robot my_arm.urdf"""

SMALL = 4
"""Arms of up to so many joints are searched for stable surfaces."""


class _Case(NamedTuple):
    """What is to be checked."""

    strategy: Inverse
    name: str
    q0: Any
    where: str  # what the start is
    region: Region
    notes: list[str]


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this subcommand."""
    what_options(parser)
    task_options(parser)
    parser.add_argument(
        "--weight", metavar="M", help="inertia, or one number a joint separated by commas (default: 1, which is J⁺)"
    )
    parser.add_argument(
        "--absolute", action="store_true", help="describe a planar arm by absolute angles, not by relative ones"
    )
    parser.add_argument(
        "--region",
        type=positive,
        metavar="W",
        help="Ω: half-width round the start, rad, cut to the joint limits (default 0.25; a design's own)",
    )
    parser.add_argument("--samples", type=whole, default=128, help="configurations to look at (default 128)")
    parser.add_argument("--seed", type=natural, default=0, help="seed of those (default 0)")
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")


def run(options: argparse.Namespace) -> int:
    """Judge a strategy and print what was found."""
    say = progress(options.json)
    say("starting up")
    import numpy as np

    from ..integrability import drift_per_area, is_repeatable, stable_surface
    from ..regions import Box

    case = _saved(options) if is_saved(options.what) else _named(options)
    task = case.strategy.task
    say("evaluating the Lie brackets")
    verdict = is_repeatable(case.strategy, case.region, samples=options.samples, seed=options.seed)
    drift = drift_per_area(case.strategy, case.q0)
    surfaces = None
    if task.n <= SMALL and not verdict.repeatable:
        say("looking for stable surfaces")
        low, high = np.maximum(task.lower, case.q0 - np.pi), np.minimum(task.upper, case.q0 + np.pi)
        surfaces = stable_surface(case.strategy, Box.between(low, high), seed=options.seed)
    clear_line()
    result = _as_dict(case, verdict, drift, surfaces)
    if options.json:
        print(json.dumps(result, indent=2, ensure_ascii=False))
    else:
        _print(case, verdict, result["drift_per_m2"], surfaces, absolute=options.absolute)
    return 0


def _named(options: argparse.Namespace) -> _Case:
    """J⁺, or a weighted inverse, of a robot."""
    from ..robot.absolute_angles import absolute_angles
    from ..studies.defaults import choose_start, choose_task

    task = choose_task(robot_of(options), options.frame, options.task)
    given = start_of(options, task)
    q0, where = choose_start(task) if given is None else (given, "as given")
    if options.absolute:
        task = task.in_coordinates(absolute_angles(task))
        assert task.coordinates is not None
        q0 = task.coordinates.coordinates(q0)
    strategy, name = strategy_of(task, options.weight)
    return _Case(strategy, name, q0, where, *box_round(task, q0, options.region or 0.25))


def _saved(options: argparse.Namespace) -> _Case:
    """A saved design; what chooses a strategy has no place beside it."""
    for option in ("weight", "absolute"):
        if getattr(options, option):
            raise InputError(f"{options.what} is a strategy of its own; leave --{option} out")
    design = load_design(options)
    given = start_of(options, design.task)
    q0, where = (design.region.center, "the region's center") if given is None else (given, "as given")
    name = f"the design in {options.what}"
    if options.region is None:
        return _Case(design.inverse, name, q0, where, design.region, [])
    return _Case(design.inverse, name, q0, where, *box_round(design.task, q0, options.region))


def strategy_of(task: Task, weight: str | None) -> tuple[Inverse, str]:
    """Make the strategy that ``--weight`` names, and a name for it."""
    from ..strategies import Pseudoinverse, WeightedInverse

    if weight is None:
        return Pseudoinverse(task), "J⁺"
    if weight == "inertia":
        return WeightedInverse(task, "inertia"), "J⁺ weighted by the inertia (least kinetic energy)"
    try:
        numbers = [float(part) for part in weight.replace(" ", ",").split(",") if part]
    except ValueError:
        raise InputError(f"--weight {weight!r} is neither inertia nor numbers separated by commas") from None
    if len(numbers) != task.n:
        raise InputError(f"--weight has {len(numbers)} numbers, but the task has {task.n} joints")
    return WeightedInverse(task, numbers), f"J⁺ weighted by {', '.join(f'{x:g}' for x in numbers)}"


def _as_dict(case: _Case, verdict: Repeatability, drift: Any, surfaces: Surfaces | None) -> dict[str, Any]:
    from ..studies.result import region_dict

    task = case.strategy.task
    axes = {"xz": "xz", "yz": "yz"}.get(task.kind, "xyz")
    planes = [(a, b) for a in range(len(drift)) for b in range(a + 1, len(drift))]
    result = {
        **task.as_dict(),
        "strategy": case.name,
        "start": [float(v) for v in case.q0],
        "region": region_dict(case.region),
        "repeatable": verdict.repeatable,
        "defect": verdict.defect,
        "defect_at": verdict.at.tolist(),
        "tolerance": verdict.tolerance,
        "samples": verdict.samples,
        "drift_per_m2": {axes[a] + axes[b]: float(drift[a, b]) for a, b in planes},
        "notes": case.notes,
    }
    if surfaces is not None:
        result["surfaces"] = {
            "stable": surfaces.stable.tolist(),
            "candidate": surfaces.candidate.tolist(),
            "singular": surfaces.singular.tolist(),
        }
    return result


def _print(
    case: _Case, verdict: Repeatability, drift: dict[str, float], surfaces: Surfaces | None, *, absolute: bool
) -> None:
    task, robot = case.strategy.task, case.strategy.task.robot
    print(f"robot     {robot.name} ({robot.description.path.name})")
    print(f"task      {task.frame}, {task.kind}: n = {task.n} joints, m = {task.m}, r = {task.r}")
    print(f"strategy  {case.name}{', in absolute angles' if absolute else ''}")
    print(f"start     {_row(case.q0)} ({case.where})")
    print(f"region    {case.region}")
    for note in case.notes:
        print(f"note: {note}")
    print()
    print(verdict.summary())
    if verdict.repeatable:
        return
    print(f"worst at  {_row(verdict.at)}")
    print()
    print(_drift_table(drift, task.unit))
    if surfaces is not None:
        print()
        print(surfaces.summary())


def _drift_table(drift: dict[str, float], unit: str) -> str:
    from ..show.text.table import table

    rows = [
        [f"{plane[0]}–{plane[1]}", *(f"{_clean(value) * scale:.{d}g}" for scale, d in ((1, 4), (1e-4, 3), (1e-2, 3)))]
        for plane, value in drift.items()
    ]
    header = ["plane", f"{unit} per m²", f"{unit} per cm²", "round a 10 cm square"]
    return f"joint drift of a small loop at the start, to first order in its area:\n{table(header, rows)}"


def _row(q: Any) -> str:
    return ", ".join(f"{value:.4g}" for value in q)


def _clean(value: float) -> float:
    """A drift that is only rounding as 0."""
    return value if value > 1e-9 else 0.0
