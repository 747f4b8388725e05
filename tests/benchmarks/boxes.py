"""Random boxes with the tool down, against floods: does a box fit whenever a flood covers it?

Run ``python tests/benchmarks/boxes.py [--boxes N] [--first K] [ARM …]``. Each line is one box of
edges 0.2 to 0.5 m at a random yaw: the share of it that ``rp.best_cell`` places, for two seeds, and
whether floods cover it. A flood covers a box if, at some middle, each node of a grid of 3 cm in the
box has a node of the flood, turned about the arm's axis, inside the limits of all joints, with the
bodies apart, and if no joint moves by 1 rad or m between neighbouring nodes. A line ends in ``!``
where a seed changes the verdict, or a flood covers a box that does not fit. Floods and boxes are
seeded apart from the search.
"""

from __future__ import annotations

import argparse
import time
from itertools import islice

import numpy as np
from numpy.typing import NDArray

import repctl_pin as rp
from repctl_pin.extensions.cells.table import flood_sets, sectors

ARMS = {"panda": "pose", "xarm7": "pose", "baxter": "pose", "ur5": "axis", "kinova": "axis"}
SEEDS, ANGLES, LOOKED, AT_ONCE, JUMP = (0, 1), 16, 24, 32, 1.0
"""Seeds of the search; angles of the middles around the arm; middles whose bodies are tested;
configurations that are tested together; and joint step between neighbouring nodes, rad or m, from
which on it is a jump."""


def floods_of(
    task: rp.Task, rotation: NDArray[np.float64]
) -> tuple[flood_sets.Table, tuple, NDArray]:
    """Flood the reach of an arm at one orientation, from another seed than the search."""
    rng = np.random.default_rng(77)
    line, symmetries = sectors.axis_and_symmetries(task)
    heights = (-np.inf, np.inf)
    table, nodes, Q = flood_sets.drawn_nodes(task, rotation, line, symmetries, heights, rng)
    locked = flood_sets.locked_floods(table, nodes, Q, rng)
    return table, symmetries, flood_sets.free_floods(table, nodes, Q, locked).Q


def counts_of(size: NDArray[np.float64]) -> list[int]:
    """Return the numbers of nodes, at most 3 cm apart, along the edges of a box, m."""
    return [int(np.ceil(e / flood_sets.SPACING)) + 1 for e in size]


def grid_of(size: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the nodes (K, 3) of a grid of at most 3 cm that fills a box, from its middle, m."""
    ways = [np.linspace(-e / 2, e / 2, n) for e, n in zip(size, counts_of(size), strict=True)]
    return np.stack(np.meshgrid(*ways, indexing="ij"), axis=-1).reshape(-1, 3)


def configurations(
    table: flood_sets.Table, symmetries: tuple, flood: NDArray, p: NDArray
) -> NDArray:
    """Turn a flood's configurations to positions p (C, K, 3) of C boxes: (C, K, n); NaN outside.

    Over each box, the angle around the arm is continuous. The spin turns back, if there is one.
    """
    rho, angle = np.hypot(p[..., 0], p[..., 1]), np.arctan2(p[..., 1], p[..., 0])
    i = np.rint((rho - table.radii[0]) / flood_sets.SPACING).astype(int)
    j = np.rint((p[..., 2] - table.heights[0]) / flood_sets.SPACING).astype(int)
    inside = (i >= 0) & (i < len(table.radii)) & (j >= 0) & (j < len(table.heights))
    Q = np.where(inside[..., None], flood[np.where(inside, i, 0), np.where(inside, j, 0)], np.nan)
    angle = angle[:, :1] + (angle - angle[:, :1] + np.pi) % (2 * np.pi) - np.pi
    back = -float(np.sign(table.rotation[2, 2]))
    for one, turn in zip(symmetries, (angle, back * angle), strict=False):
        q = Q[..., one.joint] + one.sign * turn
        ends = table.task.lower[one.joint], table.task.upper[one.joint]
        if np.isfinite(ends).all():  # full turns bring the box nearest to the middle of the range
            away = (q.max(axis=1) + q.min(axis=1) - sum(ends)) / 2
            q -= 2 * np.pi * np.round(away / (2 * np.pi))[:, None]
        Q[..., one.joint] = q
    return Q


def middles(table: flood_sets.Table, symmetries: tuple, flood: NDArray, size: NDArray) -> NDArray:
    """List middles (C, 3) at which a flood reaches all nodes of a box inside the limits, m."""
    task, grid = table.task, grid_of(size)
    corners = np.flatnonzero((np.abs(grid) > 0.49 * size).all(axis=1))
    rho, z = (part.ravel() for part in np.meshgrid(table.radii, table.heights, indexing="ij"))
    outside = rho > size[:2].max() / 2  # so that the box does not contain the axis
    rho, z = rho[outside], z[outside]
    good = []
    for angle in 2 * np.pi / ANGLES * np.arange(ANGLES):
        c = np.column_stack([rho * np.cos(angle), rho * np.sin(angle), z])
        for nodes in (grid[corners], grid):
            Q = configurations(table, symmetries, flood, c[:, None] + nodes)
            margins = task.limit_margin(Q.reshape(-1, task.n)).reshape(-1, len(nodes) * task.n)
            c = c[margins.min(axis=1) > 0]
        good.append(c)
    return np.concatenate(good)


def smooth(Q: NDArray, counts: list[int]) -> bool:
    """Test whether configurations (K, n) at the nodes of a grid have no jump between neighbours."""
    nodes = Q.reshape(*counts, -1)
    return max(np.abs(np.diff(nodes, axis=axis)).max() for axis in range(3)) < JUMP


def covered(task: rp.Task, parts: tuple, size: NDArray) -> str:
    """Find a middle at which one flood covers a box: no jump, no collision; empty if none does."""
    table, symmetries, floods = parts
    grid, rng, bodies = grid_of(size), np.random.default_rng(5), rp.Bodies(task)
    for flood in floods[np.argsort(-np.isfinite(floods[..., 0]).sum(axis=(1, 2)))]:
        found = rng.permutation(middles(table, symmetries, flood, size))
        reached = (
            (c, configurations(table, symmetries, flood, (c + grid)[None])[0]) for c in found
        )
        without_jump = ((c, Q) for c, Q in reached if smooth(Q, counts_of(size)))
        for c, Q in islice(without_jump, LOOKED):
            # a few at a time, because most floods have a collision somewhere
            parts = np.array_split(rng.permutation(Q), len(Q) // AT_ONCE + 1)
            if all(bodies.distances(part).min() > 0 for part in parts):
                return np.array2string(c + 0.0, precision=2, suppress_small=True)
    return ""


def box_line(name: str, task: rp.Task, k: int) -> str:
    """Compare the search with floods for the k-th box of an arm; return one line."""
    rng = np.random.default_rng([k, *name.encode()])
    size, yaw = rng.uniform(0.2, 0.5, 3), float(rng.uniform(-np.pi, np.pi))
    begin, shares, whys, place = time.process_time(), [], [], None
    for seed in SEEDS:
        try:
            place = rp.best_cell(
                task, size, orientation="down", yaw=yaw, options=rp.FitOptions(seed=seed)
            )
            shares.append(place.factor)
            whys.append(place.reason)
        except rp.InputError as error:
            shares.append(0.0)
            whys.append(str(error))
    seconds = (time.process_time() - begin) / len(SEEDS)
    # its task has the approach axis z
    place = place or rp.best_cell(task, 0.02, orientation="down", yaw=yaw)
    turned = place.cell.task
    by_flood = covered(turned, floods_of(turned, place.cell.placement.rotation), size)
    fits = [share == 1 for share in shares]
    wrong = len(set(fits)) > 1 or (by_flood and not all(fits))
    found = " ".join(f"{share:.1f}" for share in shares)
    edges = " ".join(f"{edge:.3f}" for edge in size)
    line = f"{name} {k}: {edges} yaw {np.degrees(yaw):.0f}°: {found}; flood {by_flood or 'no'}; "
    return line + f"{seconds:.0f} s {'!' * bool(wrong)} {next(filter(None, whys), '')}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("arms", nargs="*", default=list(ARMS))
    parser.add_argument("--boxes", type=int, default=3)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    for arm in given.arms:
        robot = rp.Robot.load(arm)
        made = robot.task(robot.default_frame, ARMS[arm])
        for number in range(given.first, given.first + given.boxes):
            print(box_line(arm, made, number), flush=True)
