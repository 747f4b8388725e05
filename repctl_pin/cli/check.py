"""``repctl check``: is a control repeatable on this arm, and if not, how much does it drift?"""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .options import (
    REGION,
    box_round,
    is_saved,
    natural,
    positive,
    robot_of,
    start_of,
    task_options,
    weight_of,
    weight_option,
    what_options,
    whole,
)
from .saved import load_design
from .terminal import clear_line, progress, tell

if TYPE_CHECKING:
    from ..integrability import Repeatability, Surfaces
    from ..robot.task import Task
    from ..strategies import Inverse
    from ..studies.start_and_path import Setting

HELP = "say whether J⁺, a weighted inverse or a saved design is repeatable, and how much it drifts if not"
EXAMPLE = """examples:
  repctl check panda --weight inertia
  repctl check repctl-out/panda/design.json          # a saved design, over the region it was made for
  repctl check repctl-out/my_arm/design.json --robot my_arm.urdf"""

SMALL = 4
"""Arms of up to so many joints are searched for stable surfaces."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this subcommand."""
    what_options(parser)
    task_options(parser)
    weight_option(parser)
    parser.add_argument(
        "--absolute", action="store_true", help="describe a planar arm by absolute angles, not by relative ones"
    )
    parser.add_argument(
        "--region",
        type=positive,
        metavar="W",
        help="Ω: half-width round the start, rad, cut to the joint limits (default 0.4; a design's own)",
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
    from ..regions import Box, Region

    strategy, name, setting = _saved(options) if is_saved(options.what) else _named(options)
    task, q0 = strategy.task, setting.q0
    assert isinstance(setting.region, Region)
    say("evaluating the Lie brackets")
    verdict = is_repeatable(strategy, setting.region, samples=options.samples, seed=options.seed)
    drift = drift_per_area(strategy, q0)
    surfaces = None
    if task.n <= SMALL and not verdict.repeatable:
        say("looking for stable surfaces")
        low, high = np.maximum(task.lower, q0 - np.pi), np.minimum(task.upper, q0 + np.pi)
        surfaces = stable_surface(strategy, Box.between(low, high), seed=options.seed)
    clear_line()
    result = _as_dict(strategy, name, setting, verdict, drift, surfaces)
    if options.json:
        print(json.dumps(result, indent=2, ensure_ascii=False))
    else:
        said = f"{name}, in absolute angles" if options.absolute else name
        _print(task, said, setting, verdict, result["drift_per_m2"], surfaces)
    return 0


def _named(options: argparse.Namespace) -> tuple[Inverse, str, Setting]:
    """J⁺, or a weighted inverse, of a robot."""
    from ..robot.absolute_angles import absolute_angles
    from ..studies.defaults import choose_desired, choose_start, choose_task
    from ..studies.start_and_path import GIVEN, Setting

    task = choose_task(robot_of(options), options.frame, options.task)
    given = start_of(options, task)
    q0, where = choose_start(task) if given is None else (given, GIVEN)
    if options.absolute:
        task = task.in_coordinates(absolute_angles(task))
        assert task.coordinates is not None
        q0 = task.coordinates.coordinates(q0)
    region, notes = box_round(task, q0, options.region or REGION)
    return (*choose_desired(task, weight_of(options)), Setting(q0, where, region=region, moved=tuple(notes)))


def _saved(options: argparse.Namespace) -> tuple[Inverse, str, Setting]:
    """A saved design; what chooses a strategy has no place beside it."""
    from ..studies.start_and_path import GIVEN, Setting

    for option in ("weight", "absolute"):
        if getattr(options, option):
            raise InputError(f"{options.what} is a strategy of its own; leave --{option} out")
    design = load_design(options)
    given = start_of(options, design.task)
    q0, where = (design.region.center, "the region's center") if given is None else (given, GIVEN)
    region, notes = (design.region, []) if options.region is None else box_round(design.task, q0, options.region)
    return design.inverse, f"the design in {options.what}", Setting(q0, where, region=region, moved=tuple(notes))


def _as_dict(
    strategy: Inverse, name: str, setting: Setting, verdict: Repeatability, drift: Any, surfaces: Surfaces | None
) -> dict[str, Any]:
    from ..regions import Region
    from ..studies.result import region_dict

    task = strategy.task
    assert isinstance(setting.region, Region)
    axes = {"xz": "xz", "yz": "yz"}.get(task.kind, "xyz")
    planes = [(a, b) for a in range(len(drift)) for b in range(a + 1, len(drift))]
    result = {
        **task.as_dict(),
        "strategy": name,
        "start": [float(v) for v in setting.q0],
        "region": region_dict(setting.region),
        "repeatable": verdict.repeatable,
        "defect": verdict.defect,
        "defect_at": verdict.at.tolist(),
        "tolerance": verdict.tolerance,
        "samples": verdict.samples,
        "drift_per_m2": {axes[a] + axes[b]: float(drift[a, b]) for a, b in planes},
        "notes": list(setting.moved),
    }
    if surfaces is not None:
        result["surfaces"] = {
            "stable": surfaces.stable.tolist(),
            "candidate": surfaces.candidate.tolist(),
            "singular": surfaces.singular.tolist(),
        }
    return result


def _print(
    task: Task, name: str, setting: Setting, verdict: Repeatability, drift: dict[str, float], surfaces: Surfaces | None
) -> None:
    robot = task.robot
    tell(f"{verdict.summary()}\n")
    tell(f"robot     {robot.name} ({robot.description.path.name})")
    tell(f"task      {task}")
    tell(f"strategy  {name}")
    tell(f"start     {_row(setting.q0)} ({setting.where})")
    tell(f"region    {setting.region}")
    for note in setting.moved:
        tell(f"note: {note}")
    if verdict.repeatable:
        return
    tell(f"worst at  {_row(verdict.at)}")
    print()
    tell(_drift_table(drift, task.unit))
    if surfaces is not None:
        print()
        tell(surfaces.summary())


def _drift_table(drift: dict[str, float], unit: str) -> str:
    from ..show.text.numbers import number
    from ..show.text.table import table

    rows = [
        [f"{plane[0]}–{plane[1]}", *(number(_clean(value) * scale) for scale in (1, 1e-4, 1e-2))]
        for plane, value in drift.items()
    ]
    header = ["plane", f"{unit} per m²", f"{unit} per cm²", "round a 10 cm square"]
    return f"joint drift of a small loop at the start, to first order in its area:\n{table(header, rows)}"


def _row(q: Any) -> str:
    return ", ".join(f"{value:.4g}" for value in q)


def _clean(value: float) -> float:
    """A drift that is only rounding as 0."""
    return value if value > 1e-9 else 0.0
