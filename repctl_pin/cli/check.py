"""``repctl check``: is a control repeatable on this arm, and if not, how much does it drift?"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any

import repctl_pin as rp

from ..errors import InputError
from ..show.text.lines import fitted
from ..show.text.numbers import number, row
from .given import REGION, Options, box_round, integer, natural, plain_proof, positive
from .options import Parser
from .terminal import progress, report

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..integrability import Repeatability, Surfaces
    from ..strategies import Inverse
    from ..studies.start_and_path import Setting

HELP = "say whether J⁺, a weighted inverse or a saved design is repeatable, and how much it drifts if not"
EXAMPLE = """examples:
  repctl check panda --weight inertia
  repctl check repctl-out/panda/design.json          # a saved design, over the region it was made for
  repctl check repctl-out/panda/design.json --prove  # a lower bound of its leaf margin that holds everywhere in it
  repctl check repctl-out/my_arm/design.json --robot my_arm.urdf"""

_Drift = dict[str, float]
SMALL = 4
"""Arms of up to so many joints are searched for stable surfaces."""


def add_options(parser: Parser) -> None:
    """Add the options of this subcommand."""
    parser.what()
    parser.task()
    parser.weight()
    add = parser.add_argument
    add(
        "--absolute",
        action="store_true",
        help="describe a planar arm by absolute angles, not by relative ones",
    )
    region = (
        "Ω: half-width round the start, rad, cut to the joint limits (default 0.4; a design's own)"
    )
    add("--region", type=positive, metavar="W", help=region)
    add("--samples", type=integer, default=128, help="configurations to look at (default 128)")
    add("--seed", type=natural, default=0, help="seed of those (default 0)")
    prove = "prove a lower bound of a saved design's leaf margin over its region, or over its cell"
    add("--prove", action="store_true", help=prove)
    add("--json", action="store_true", help="print JSON instead of text")


def run(options: Options) -> int:
    """Judge a strategy and print what was found."""
    say = progress(options.json)
    import numpy as np

    from ..regions import Region

    if options.prove:
        return _prove(options, say)
    strategy, name, setting = _saved(options) if options.saved else _named(options)
    task, q0 = strategy.task, setting.q0
    assert isinstance(setting.region, Region)
    say("evaluating the Lie brackets")
    verdict = rp.is_repeatable(strategy, setting.region, samples=options.samples, seed=options.seed)
    drift = _in_planes(rp.drift_per_area(strategy, q0), task)
    surfaces = None
    if task.n <= SMALL and not verdict.repeatable:
        say("looking for stable surfaces")
        low, high = np.maximum(task.lower, q0 - np.pi), np.minimum(task.upper, q0 + np.pi)
        surfaces = rp.stable_surface(strategy, rp.Box.between(low, high), seed=options.seed)
    said = f"{name}, in absolute angles" if options.absolute else name
    return report(
        options,
        lambda: _as_dict(task, name, setting, verdict, drift, surfaces),
        lambda: fitted("\n".join(_lines(task, said, setting, verdict, drift, surfaces))),
    )


def _prove(options: Options, say: Callable[[str], None]) -> int:
    """Prove what a saved design promises: again, where it holds a certificate."""
    from dataclasses import asdict

    if not options.saved:
        raise InputError(
            "--prove requires a saved design (.json); repctl design and repctl cell save one"
        )
    for option in ("weight", "absolute", "region", "start"):
        if getattr(options, option):
            raise InputError(
                f"--prove and --{option} are mutually exclusive: a design is proved over its own region"
            )
    design = options.load_saved()
    margin = design.proof.leaf_margin if design.proof else None
    proof = rp.prove(design, margin=margin, progress=lambda what, share: say(f"{what} {share:.0%}"))
    return report(options, lambda: plain_proof(asdict(proof)), lambda: fitted(proof.summary()))


def _named(options: Options) -> tuple[Inverse, str, Setting]:
    """J⁺, or a weighted inverse, of a robot."""
    from ..studies.defaults import choose_desired, choose_start
    from ..studies.start_and_path import GIVEN, Setting

    task = options.load_task()
    given = options.asked_start(task)
    q0, where = choose_start(task) if given is None else (given, GIVEN)
    if options.absolute:
        task = task.in_coordinates(rp.absolute_angles(task))
        assert task.coordinates is not None
        q0 = task.coordinates.coordinates(q0)
    region, notes = box_round(task, q0, options.region or REGION)
    return (
        *choose_desired(task, options.asked_weight()),
        Setting(q0, where, region=region, moved=notes),
    )


def _saved(options: Options) -> tuple[Inverse, str, Setting]:
    """A saved design; what chooses a strategy has no place beside it."""
    from ..studies.start_and_path import GIVEN, Setting

    for option in ("weight", "absolute"):
        if getattr(options, option):
            raise InputError(f"{options.what} is a strategy of its own; leave --{option} out")
    design = options.load_design()
    given = options.asked_start(design.task)
    q0, where = (design.region.center, "the region's center") if given is None else (given, GIVEN)
    region, notes = (
        (design.region, ())
        if options.region is None
        else box_round(design.task, q0, options.region)
    )
    return (
        design.inverse,
        f"the design in {options.what}",
        Setting(q0, where, region=region, moved=notes),
    )


def _in_planes(drift: Any, task: rp.Task) -> _Drift:
    """The drift per area in each plane of the task's axes."""
    axes = {"xz": "xz", "yz": "yz"}.get(task.kind, "xyz")
    return {axes[a] + axes[b]: float(drift[a, b]) for a, b in combinations(range(len(drift)), 2)}


def _as_dict(
    task: rp.Task,
    name: str,
    setting: Setting,
    verdict: Repeatability,
    drift: _Drift,
    surfaces: Surfaces | None,
) -> dict[str, Any]:
    from ..regions import Region
    from ..studies.study_result import picked, region_dict

    assert isinstance(setting.region, Region)
    return {
        **task.as_dict(),
        "strategy": name,
        "start": [float(v) for v in setting.q0],
        "region": region_dict(setting.region),
        **picked(verdict, "repeatable", "defect"),
        "defect_at": verdict.at,
        **picked(verdict, "tolerance", "samples"),
        "drift_per_m2": drift,
        "notes": setting.moved,
        **(
            {}
            if surfaces is None
            else {"surfaces": picked(surfaces, "stable", "candidate", "singular")}
        ),
    }


def _lines(
    task: rp.Task,
    name: str,
    setting: Setting,
    verdict: Repeatability,
    drift: _Drift,
    surfaces: Surfaces | None,
) -> list[str]:
    """What a person is told."""
    robot = task.robot
    lines = [
        f"{verdict.summary()}\n",
        f"robot     {robot.name} ({robot.description.path.name})",
        f"task      {task}",
        f"strategy  {name}",
        f"start     {row(setting.q0)} ({setting.where})",
        f"region    {setting.region}",
        *(f"note: {note}" for note in setting.moved),
    ]
    if not verdict.repeatable:
        lines += [f"worst at  {row(verdict.at)}\n", _drift_table(drift, task.unit)]
        lines += [] if surfaces is None else [f"\n{surfaces.summary()}"]
    return lines


def _drift_table(drift: _Drift, unit: str) -> str:
    from ..show.text.table import table

    rows = []
    for plane, value in drift.items():
        clean = value if value > 1e-9 else 0.0  # it is only rounding
        rows.append(["–".join(plane), *(number(clean * scale) for scale in (1, 1e-4, 1e-2))])
    header = ["plane", f"{unit} per m²", f"{unit} per cm²", "round a 10 cm square"]
    return f"joint drift of a small loop at the start, to first order in its area:\n{table(header, rows)}"
