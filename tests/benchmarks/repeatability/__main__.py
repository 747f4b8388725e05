"""The repeatability benchmark: which control loops come back to their joints, and at what price.

Every program follows the same closed paths on the same arms, from the same joints, and undoes the
whole task error in each step. One command, one process, about twenty minutes; it writes the tables
of docs/benchmark.md and docs/which.md, the figure, and every number as docs/benchmark.csv:

    pip install -e '.[bench]'
    python tests/benchmarks/repeatability

Elsewhere: ``--out FOLDER``; a part of it: ``--arms panda --cycles 10``; parts put together:
``--again A.csv B.csv``."""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

import generated_c
import numpy as np
import ours
import pages
import peers
import torm
from cycles import Row, joints_of, measure, microseconds
from robots import ARMS, MORE, chain_task, task_of
from scenes import PERIOD, Scene, scenes_of

import repctl_pin as rp

REFERENCE = "pinv loop"
Make = Callable[[Scene], ours.Step]


def programs(folder: Path, inverse: rp.RepeatableInverse) -> dict[str, Make]:
    """Name everything that is compared, but the C program, which goes round by itself."""
    return {
        REFERENCE: ours.pinv_loop,
        "J⁺ + posture": ours.with_posture,
        "RMP quadratic program": ours.quadratic_program,
        "pink": peers.pink_loop,
        "pink + posture": partial(peers.pink_loop, posture_cost=1e-3),
        "mink": partial(peers.mink_loop, folder=folder),
        "mink + posture": partial(peers.mink_loop, folder=folder, posture_cost=1e-2),
        "roboplan": partial(peers.roboplan_loop, folder=folder),
        "roboplan + posture": partial(peers.roboplan_loop, folder=folder, posture=True),
        "ssik Tracker": peers.ssik_loop,
        "repctl_pin, Python": partial(ours.repeatable, inverse=inverse),
    }


def rows_of(arm: str, folder: Path, cycles: int, steps: int) -> Iterator[Row]:
    """Go round with everything on one arm."""
    if arm == "fetch":
        task = chain_task(arm, *torm.fetch_joints(), folder)
        for scene in torm.scenes_of(task, int(steps * torm.PERIOD / PERIOD)):
            yield from _rows([scene], folder, min(cycles, 10))
        return
    task = task_of(arm, folder)
    scenes = scenes_of(arm, task, steps)
    if arm in MORE:
        yield from _rows(scenes[:1], folder, min(cycles, 10))
    else:
        servo = scenes_of(arm, task, int(1000 * PERIOD))[0]
        yield from _rows(scenes, folder, cycles, servo)


def _rows(
    scenes: list[Scene], folder: Path, cycles: int, servo: Scene | None = None
) -> Iterator[Row]:
    """Make one design for some scenes, and go round each of them; and once where a servo lags."""
    arm, design = scenes[0].arm, ours.design_for(scenes)
    print(
        f"{arm}: {design.relative_distance:.1%} from J⁺, leaf margin {design.leaf_margin:.2f}",
        flush=True,
    )
    makers, program = (
        programs(folder, design.inverse),
        generated_c.build(design.inverse, folder / arm),
    )
    quick = _loops(makers, scenes[0])
    times = microseconds(quick, scenes[0])
    times["repctl_pin, C"] = generated_c.run(program, scenes[0], 20)[1]
    for scene in scenes:
        most = cycles if scene.path == "circle" else min(cycles, 10)
        yield from _all(scene, makers, program, most, times)
    if servo is not None:
        times.pop("ssik Tracker", None)  # it goes by joints of its own: no servo enters
        yield from _all(servo, makers, program, 1, times, lag=1.0)


def _loops(makers: dict[str, Make], scene: Scene) -> dict[str, ours.Step]:
    """Make every loop that can be had for this arm; say which cannot."""
    found = {}
    for name, make in makers.items():
        try:
            found[name] = make(scene)
        except (ImportError, peers.AbsentError) as error:
            print(f"  {name} is left out: {error}", flush=True)
    return found


def _all(
    scene: Scene,
    makers: dict[str, Make],
    program: Path,
    cycles: int,
    times: dict[str, float],
    lag: float = 0.0,
) -> Iterator[Row]:
    """Go round with every program; lag is the servo's time constant, ms."""
    share = 1.0 if lag == 0 else 1 - float(np.exp(-1e3 * scene.dt / lag))
    reference = None
    for name in times:
        begin = time.perf_counter()
        if name == "repctl_pin, C":
            Q, stopped = generated_c.run(program, scene, cycles, share)[0], ""
        else:
            Q, stopped = joints_of(makers[name](scene), scene, cycles, share)
        reference = Q if reference is None else reference
        row = measure(scene, name, Q, reference, lag, stopped)
        yield pages.timed(row, times[name], times[REFERENCE])
        took = time.perf_counter() - begin
        print(
            f"  {scene.path}, {scene.start}, {name}: {row.drift_1:.1e} … {row.drift_100:.1e} "
            f"({took:.1f} s) {stopped}"
        )


def main() -> None:
    """Measure, and write what was found."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    arms = [*ARMS, *MORE, "fetch"]
    parser.add_argument("--arms", nargs="+", choices=arms, default=arms)
    parser.add_argument("--cycles", type=int, default=100)
    parser.add_argument("--steps", type=int, default=250, help="a cycle of 5 s (default 250)")
    parser.add_argument(
        "--out", type=Path, help="a folder for the files, in place of the documentation's"
    )
    parser.add_argument(
        "--again", nargs="*", type=Path, help="measure nothing: write the files from these CSVs"
    )
    options = parser.parse_args()
    if options.again is not None:
        read = [pages.read(path) for path in options.again or [pages.CSV]]
        pages.write([row for found, _ in read for row in found], options.out, read[0][1])
        return
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        for arm in options.arms:
            rows += rows_of(arm, Path(folder), options.cycles, options.steps)
    pages.write(rows, options.out, pages.settings())


if __name__ == "__main__":
    main()
