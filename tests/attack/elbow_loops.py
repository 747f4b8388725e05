"""Closed paths in pose and level, and in pose and a point for the elbow, on ten arms.

Law: q = F(x, c), so the joints come back whenever the inputs do. Run:
python tests/attack/elbow_loops.py [loops per arm and kind] [arm ...]

``x, c`` are smooth loops of pose and level, 160 steps each. ``x, p_e`` go through six poses and
points, on straight lines of pose and level in between. Of the loops that could be followed, the
largest distance of the joints from the start is printed, rad or m."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin

import repctl_pin as rp

sys.path.insert(0, str(Path(__file__).parents[1]))

from arms import Q_PANDA
from controls import control

ARMS = {  # r = 1, 2, 3
    "panda": (None, "pose", "panda", Q_PANDA),
    "xarm7": (None, "pose", "xarm7", [0.1, 0.3, 0.2, 0.9, 0.1, 0.6, 0.0]),
    "baxter": (None, "pose", "baxter", [0.2, -0.5, -0.6, 1.3, 0.4, 0.8, 0.1]),
    "pr2": (None, "pose", "pr2", None),
    "planar3r": (None, "xy", "planar3r", [0.3, 0.8, 0.8]),
    "panda, axis": (None, "axis", "panda", Q_PANDA),
    "tiago": (None, "pose", "tiago", None),
    "planar4r": (None, "xy", "planar4r", [0.3, 0.6, 0.6, 0.5]),
    "ur5": (None, "position", "ur5", [0.2, -1.2, 1.4, -0.9, -1.2, 0.3]),
    "z1": (None, "position", "z1", [0.1, 1.2, -1.2, 0.3, 0.2, 0.1]),
}
SIZE, WAY, JUMP = 0.06, 160, 0.2
"""Largest displacement in each coordinate, m or rad, number of steps of a loop, and longest step of
a joint, rad or m, beyond which a loop counts as not followed."""


def made(name: str) -> tuple[rp.RepeatableInverse, np.ndarray]:
    """Load an arm, and make its repeatable inverse at a start, by default a dexterous one."""
    frame, kind, robot, q0 = ARMS[name]
    task = rp.Robot.load(robot).task(frame, kind)
    low, high = np.maximum(task.lower, -2) + 0.3, np.minimum(task.upper, 2) - 0.3
    rng = np.random.default_rng(0)
    some = rng.uniform(np.minimum(low, high), np.maximum(low, high), (200, task.n))
    dexterous = max(some, key=lambda q: np.linalg.svd(task.jacobian(q))[1][-1])
    q = np.array(dexterous if q0 is None else q0)
    return control(task, q, rp.Polynomial(q, 2, 0.5)), q


def followed(
    inverse: rp.RepeatableInverse, q: np.ndarray, inputs: Iterator[tuple[pin.SE3, np.ndarray]]
) -> np.ndarray:
    """Follow poses and levels, one full Newton step each and three at the end."""
    for place, leaf in inputs:
        before, q = q, inverse.step(q, place, 1.0, leaf=leaf)
        if np.abs(q - before).max() > JUMP:
            raise rp.SingularityError("a Newton step leads across a singularity")
    for _ in range(3):
        q = inverse.step(q, place, 1.0, leaf=leaf)
    return q


def displaced(place: pin.SE3, by: np.ndarray, kind: str) -> pin.SE3:
    """Displace a pose by (v, w); tasks without a rotation ignore w."""
    v = by[:3] * [1, 1, 0] if kind == "xy" else by[:3]
    return pin.SE3(pin.exp3(by[3:]) @ place.rotation, place.translation + v)


def levels(inverse: rp.RepeatableInverse, q: np.ndarray, rng: np.random.Generator) -> float:
    """Go around a smooth loop of pose and level; return the distance of the joints at its end."""
    task, place, c = inverse.task, inverse.task.placement(q), inverse.leaf(q)
    a, b = rng.uniform(-SIZE, SIZE, (2, 3, 6)), rng.uniform(-0.15, 0.15, (2, 3, task.r))

    def at(k: int) -> tuple[pin.SE3, np.ndarray]:
        turns = 2 * np.pi * np.arange(1, 4) * k / WAY
        waves = np.array([np.sin(turns), 1 - np.cos(turns)]) / np.arange(1, 4)
        by, up = (np.einsum("ij,ijk->k", waves, way) for way in (a, b))
        return displaced(place, by, str(task.kind)), c + up

    end = followed(inverse, q, (at(k) for k in range(1, WAY + 1)))
    return float(np.abs(end - q).max())


def elbows(inverse: rp.RepeatableInverse, q0: np.ndarray, rng: np.random.Generator) -> float:
    """Go through six poses and points and back to the first; return the distance of the joints."""
    task, home, begin = inverse.task, inverse.task.placement(q0), inverse.elbow(q0)
    by = rng.uniform(-SIZE, SIZE, (6, 6))
    points = begin + rng.uniform(-0.1, 0.1, (6, 3))
    stops: list[tuple[pin.SE3, np.ndarray]] = []
    for row, point in zip([*by, by[0]], [*points, points[0]], strict=True):
        place = displaced(home, row, str(task.kind))
        q = inverse.solve(place, q0)
        stops.append((place, inverse.leaf_toward(q, elbow=point, margin=0.02).leaf))
    q, first, before = inverse.solve(*stops[0][:1], q0, leaf=stops[0][1]), None, stops[0]
    first = q
    for place, leaf in stops[1:]:
        way = before[0].inverse() * place
        turn, shares = pin.log3(way.rotation), np.arange(1, 41) / 40
        line = (
            (
                pin.SE3(
                    before[0].rotation @ pin.exp3(s * turn),
                    before[0].translation + s * (place.translation - before[0].translation),
                ),
                before[1] + s * (leaf - before[1]),
            )
            for s in shares
        )
        q, before = followed(inverse, q, line), (place, leaf)
    return float(np.abs(q - first).max())


def main() -> None:
    """Run the loops of every arm, and print a line per arm."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    total, begin = {"x, c": 0, "x, p_e": 0}, time.process_time()
    for number, name in enumerate(sys.argv[2:] or ARMS):
        inverse, q = made(name)
        said, rng = [], np.random.default_rng(number)
        kinds: dict[str, Callable[..., float]] = {"x, c": levels, "x, p_e": elbows}
        for kind, loop in kinds.items():
            worst, open_, stopped = 0.0, 0, 0
            for _ in range(count):
                try:
                    off = loop(inverse, q, rng)
                except rp.RepctlError:
                    stopped += 1
                    continue
                open_ += not off <= 1e-9
                worst = max(worst, off) if off <= 1e-9 else worst
            total[kind] += count - stopped
            said.append(
                f"{kind}: {count - stopped} followed, {open_} open, the others within {worst:.0e}"
            )
        print(f"{name:12} r = {inverse.task.r}: {'; '.join(said)}", flush=True)
    print(total, f"{time.process_time() - begin:.0f} s of processor time")


if __name__ == "__main__":
    main()
