"""Reach of arms with the tool down, by floods that share no code with the search for whole tables.

Run ``python tests/benchmarks/floods.py [ARM …]``; arms are named as in ``whole_tables.py``. The
sector that ``rp.best_cell`` finds gives the axis, the orientation and the middle of the angle. The
rest is Newton's method on a grid of radius and height, 3 cm apart, at this angle. Joints that alone
turn the arm about the axis, or the tool about its own, have no limits here.

A node is *reached* by a flood if Newton's method leads to it from a neighbour that is reached, and
no joint moves by more than 0.45 rad or m. At each node, joints keep 0.05 rad (or 5 % of a range
below 1 rad or m) from their limits, bodies are apart (> 0), and σ_min(J) is above 2 % of σ_max(J).
Floods begin at 24 random configurations far apart, and in the middles of the 24 largest floods with
r joints locked. A node has *any* configuration if one is found within the same limits and with
bodies apart, but at a singularity, too, and without a path to it: by a flood, from 40 random
starts, along the self-motion, or from a neighbour. Both searches give lower bounds. A node is
*affordable* if a configuration of a flood is there through which a function can have at most 30 %
extra joint speed, the limit of the search. Only the configuration at the node itself counts.
*One function* is the largest connected set of affordable nodes of one flood over which a function
could be taken: neighbours differ by at most 0.45 rad or m, the mean extra joint speed is at most
5 %, and the joints that turn the arm and the tool leave half a turn of angle and spin, or what the
designed sector has of it if that is less.

Areas are in m²: 9 cm² per node of a set; of rectangles, between the outer nodes. The best flood has
the most nodes, and the first rectangle is the largest in any one flood. The share is that of the
designed sector, in percent of each area. It exceeds a set by a part of its nodes, in percent. In
the window (``RADIUS``, ``HEIGHT``), the best flood is the one with the most nodes there; the share
is that of its nodes which the sector covers.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from whole_tables import print_table, task_of

import repctl_pin as rp

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Nodes = NDArray[np.intp]

SPACING, MARGIN, STEP, SINGULAR = 0.03, 0.05, 0.45, 0.02
DRAWN, SEEDS, LOCKED = 1500, 24, 96
"""Random configurations, floods of each origin, and floods with locked joints."""

TRIALS, WALKED, WALK, STRIDE = 40, 8, 40, 0.15
"""Random starts per node; walks per node along the self-motion to either side, their steps, and the
length of a step, rad or m."""

MOST_EXTRA, MEAN_EXTRA = 0.3, 0.05
"""Maximum extra joint speeds, at the worst pose and on average, that the search permits by
default."""

RADIUS, HEIGHT = (0.2, 0.7), (-0.4, 0.8)
"""Window of a table top at arm's length: distance from the axis, and height above the base, m."""

TITLES = (
    "arm | reach: best flood, union, any, affordable, one function | rectangle in: one flood, "
    "union, any, affordable, one function | one range | designed | share | exceeds | window: best "
    "flood, share | time, s"
)


class Grid:
    """Grid of poses over radius and height; N nodes, numbered radius by radius, n joints.

    ``beside`` (N, 4) are the neighbours of each node, −1 where there is none. ``counted`` (n,) is
    True for the joints whose limits count. K is a number of configurations.
    """

    def __init__(self, cell: rp.Sector, rng: np.random.Generator) -> None:
        self.cell, self.task, self.rng = cell, cell.task, rng
        self.bodies = rp.Bodies(self.task)
        lower, upper = self.task.lower, self.task.upper
        self.low = np.where(np.isfinite(lower), lower, -np.pi)
        self.high = np.where(np.isfinite(upper), upper, np.pi)
        self.margin = MARGIN * np.minimum(1.0, self.high - self.low)
        self.counted = ~turning(self.task, cell)
        self.rho, self.z = self.coordinates(self.task.positions(self.drawn(DRAWN)))
        self.shape = len(self.rho), len(self.z)
        number = np.pad(np.arange(self.size).reshape(self.shape), 1, constant_values=-1)
        sides = number[2:, 1:-1], number[:-2, 1:-1], number[1:-1, 2:], number[1:-1, :-2]
        self.beside = np.stack([side.ravel() for side in sides], axis=1)
        self.targets = list(map(self.target, range(self.size)))

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self.rho) * len(self.z)

    def coordinates(self, p: Array) -> tuple[Array, Array]:
        """Return radii and heights, m, of a grid that spans positions p (K, 3)."""
        x, y, z = ((p - self.cell.axis[0]) @ self.cell.directions.T).T / SPACING
        return (
            SPACING * np.arange(2, np.hypot(x, y).max() + 1),
            SPACING * np.arange(z.min() // 1, z.max() + 1),
        )

    def target(self, node: int) -> pin.SE3:
        """Return the pose of a node."""
        i, j = divmod(node, len(self.z))
        p = np.array([self.rho[i], 0.0, self.z[j]]) @ self.cell.directions
        return pin.SE3(self.cell.placement.rotation, self.cell.axis[0] + p)

    def drawn(self, count: int) -> Array:
        """Draw random configurations (count, n) within the limits."""
        return self.rng.uniform(self.low, self.high, (count, self.task.n))

    def solved(
        self, nodes: Nodes, Q: Array, steps: int, held: Mask | None = None
    ) -> tuple[Array, Mask]:
        """Solve for the poses of nodes (K,) by Newton's method from Q (K, n).

        Joints that are ``held`` (K, n) do not move. At first, the others also move away from near
        limits, along the self-motion. Return the configurations, and a mask of the exact ones.
        """
        Q, left, on = Q.copy(), np.full(len(Q), np.inf), np.arange(len(Q))
        moved = np.ones(Q.shape) if held is None else 1.0 - held
        for i in range(steps):
            e = self.task.errors(Q[on], [self.targets[k] for k in nodes[on]])
            left[on] = np.abs(e).max(axis=1, initial=0.0)
            on, e = on[left[on] > 1e-9], e[left[on] > 1e-9]
            if not len(on):
                break
            J = self.task.jacobians(Q[on]) * moved[on, None]
            b = np.zeros_like(Q[on])
            if i < steps // 3:
                inner = np.clip(Q[on], self.low + 4 * self.margin, self.high - 4 * self.margin)
                b = 0.3 * (inner - Q[on]) * self.counted * moved[on]
            dQ = least(J, e - np.einsum("Kmn,Kn->Km", J, b)) + b
            longest = np.abs(dQ).max(axis=1, keepdims=True)
            Q[on] += dQ * np.minimum(1.0, STEP / np.maximum(longest, 1e-9))
        return Q, left < 1e-7

    def allowed(self, Q: Array, exact: Mask) -> Mask:
        """Test which of the exact Q (K, n) are within the limits, with bodies apart: (K,)."""
        inside = (Q >= self.low + self.margin) & (Q <= self.high - self.margin)
        good = exact & (inside | ~self.counted).all(axis=1)
        if good.any() and self.bodies.pairs:
            good[good] = self.bodies.distances(Q[good]) > 0
        return good

    def regular(self, Q: Array, held: Mask) -> Mask:
        """Test which Q (K, n) are not singular with these joints locked: (K,)."""
        sigma = np.linalg.svd(self.task.jacobians(Q) * ~held[:, None], compute_uv=False)
        return np.asarray(sigma[:, -1] > SINGULAR * sigma[:, 0])

    def wrapped(self, Q: Array) -> Array:
        """Move revolute joints of Q (K, n) that are beyond their limits back by full turns."""
        over = np.ceil((Q - self.high) / (2 * np.pi)).clip(0)
        under = np.ceil((self.low - Q) / (2 * np.pi)).clip(0)
        return np.asarray(Q + 2 * np.pi * (under - over) * self.task.revolute)

    def flooded(self, nodes: Nodes, Q: Array, held: Mask) -> Array:
        """Flood from S nodes (S,) with configurations Q (S, n): (S, N, n), NaN outside."""
        found = np.full((len(Q), self.size, self.task.n), np.nan)
        found[np.arange(len(Q)), nodes] = Q
        front = np.column_stack([np.arange(len(Q)), nodes])
        while len(front):
            new = np.column_stack([np.repeat(front, 4, axis=0), self.beside[front[:, 1]].ravel()])
            new = new[(new[:, 2] >= 0) & np.isnan(found[new[:, 0], new[:, 2], 0])]
            new = new[np.unique(new[:, [0, 2]], axis=0, return_index=True)[1]]
            flood, start, node = new.T
            before = found[flood, start]
            Q, good = self.solved(node, before, 9, held[flood])
            good &= np.abs(Q - before).max(axis=1, initial=0.0) <= STEP
            good = self.allowed(Q, good & self.regular(Q, held[flood]))
            found[flood[good], node[good]] = Q[good]
            front = new[good][:, [0, 2]]
        return found

    def middle(self, flood: Array) -> int:
        """Return the node of a flood (N, n) nearest to the mean of its nodes."""
        on = np.flatnonzero(np.isfinite(flood[:, 0]))
        at = np.column_stack(np.unravel_index(on, self.shape))
        return int(on[np.linalg.norm(at - at.mean(axis=0), axis=1).argmin()])

    def extra_speed(self, nodes: Nodes, Q: Array) -> Array:
        """Compute the minimum extra joint speed (K,) of functions through Q (K, n) at K nodes."""
        own, least = self.squares(nodes, Q)
        return np.asarray(np.sqrt(own / least) - 1)

    def squares(self, nodes: Nodes, Q: Array) -> list[Array]:
        """Compute squared joint speeds of a function through Q (K, n) at nodes (K,), and of J⁺.

        Along radius and height, such a function moves as J⁺ does at best. Along the angle and the
        spin, the joint that alone turns the arm, or the tool, moves alone.
        """
        outward, around, up = self.cell.directions
        turns, posed = np.flatnonzero(~self.counted), self.task.kind == "pose"
        E = np.zeros((len(Q), 6, 4))
        E[:, :3, 0], E[:, :3, 1], E[:, 3:, 2] = outward, up, up
        E[:, :3, 2] = self.rho[nodes // len(self.z), None] * around
        E[:, 3:, 3] = self.cell.placement.rotation[:, 2]
        E = E[:, : self.task.m, : 2 + len(turns)] if posed else E[:, : self.task.m, :3]
        E[:, 3:] *= posed  # turns about the vertical do not tilt the tool
        least = np.linalg.pinv(self.task.jacobians(Q)) @ E
        own = least.copy()
        own[:, :, 2:] = np.eye(self.task.n)[:, turns[: E.shape[2] - 2]]
        W = np.linalg.inv(E.swapaxes(1, 2) @ E)
        return [np.einsum("Kni,Kij,Knj->K", X, W, X) for X in (own, least)]

    def affordable(self, floods: Array) -> Mask:
        """Return a mask (N,) of the nodes with an affordable configuration in a flood."""
        flood, node = np.nonzero(np.isfinite(floods[..., 0]))
        found = np.zeros(self.size, bool)
        found[node[self.extra_speed(node, floods[flood, node]) <= MOST_EXTRA]] = True
        return found

    def for_one_function(self, flood: Array) -> Mask:
        """Return a mask (N,) of a connected set of nodes over which a function could be taken."""
        nodes = np.flatnonzero(np.isfinite(flood[:, 0]))
        own, least = self.squares(nodes, flood[nodes])
        extra = np.sqrt(own / least) - 1
        good = extra <= MOST_EXTRA
        for joint in np.flatnonzero(~self.counted):
            turn = min(np.pi, 2 * self.cell.widths[1])
            room = self.task.upper[joint] - self.task.lower[joint] - turn
            q = flood[nodes, joint]
            low = np.sort(q[good])
            inside = np.searchsorted(low, low + room, side="right") - np.arange(len(low))
            if len(low):
                first = low[inside.argmax()]
                good &= (q >= first) & (q <= first + room)
        order = np.flatnonzero(good)[np.argsort(extra[good])]
        mean = np.sqrt(np.cumsum(own[order]) / np.cumsum(least[order])) - 1
        within = np.zeros(self.size, bool)
        within[nodes[order[: np.searchsorted(mean, MEAN_EXTRA)]]] = True
        return self.connected(flood, within)

    def connected(self, flood: Array, within: Mask) -> Mask:
        """Return the largest part of a mask (N,) whose neighbours differ by at most the step."""
        a, way = np.nonzero((self.beside >= 0) & within[:, None] & within[self.beside])
        b = self.beside[a, way]
        near = np.abs(flood[a] - flood[b]).max(axis=1) <= STEP
        links = coo_array((np.ones(near.sum()), (a[near], b[near])), shape=2 * (self.size,))
        part = connected_components(links, directed=False)[1]
        return np.asarray(within & (part == np.bincount(part[within], minlength=1).argmax()))

    def places(self) -> list[Array]:
        """Return radius and height (N,) of each node, m, relative to the axis."""
        return [each.ravel() for each in np.meshgrid(self.rho, self.z, indexing="ij")]

    def window(self, floods: Mask) -> tuple[float, float]:
        """Return area and covered share, 0 to 1, of the best flood (S, N) in the window."""
        rho, z = self.places()
        within = (RADIUS[0] <= rho) & (rho <= RADIUS[1]) & (HEIGHT[0] <= z) & (z <= HEIGHT[1])
        best = max(floods & within, key=np.sum)
        return SPACING**2 * best.sum(), self.covered()[best].sum() / max(best.sum(), 1)

    def covered(self) -> Mask:
        """Return a mask (N,) of the nodes inside the sector."""
        rho, z = self.places()
        low, high = self.cell.radii(z).T
        level = np.abs(z - self.cell.middle[1]) <= self.cell.widths[2]
        return np.asarray(level & (rho >= low) & (rho <= high))


def least(J: Array, x: Array) -> Array:
    """Return J⁺ x (K, n), damped by 1e-10, for J (K, m, n) and x (K, m)."""
    Jt = J.swapaxes(1, 2)
    return np.asarray(
        (Jt @ np.linalg.solve(J @ Jt + 1e-10 * np.eye(J.shape[1]), x[..., None]))[..., 0]
    )


def turning(task: rp.Task, cell: rp.Sector) -> Mask:
    """Return a mask (n,) of the joints that alone turn the arm about the axis, or the tool."""
    turns = task.revolute.copy()
    for q in task.reference + np.random.default_rng(1).uniform(-1, 1, (4, task.n)):
        x, axes, origins = task.placement(q), task.axes(q), task.joint_origins(q)
        away = [
            np.linalg.norm(np.cross(axes, way), axis=1)
            + np.linalg.norm(np.cross(origins - point, way), axis=1)
            for point, way in (cell.axis, (x.translation, x.rotation[:, 2]))
        ]
        turns &= np.min(away, axis=0) < 5e-3
    return turns


def far_apart(Q: Array, count: int) -> Nodes:
    """Choose ``count`` rows of Q (K, n), each as far as possible from those before it."""
    chosen, away = [0], np.linalg.norm(Q - Q[0], axis=1)
    while len(chosen) < min(count, len(Q)):
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(Q - Q[chosen[-1]], axis=1))
    return np.array(chosen)


def floods_of(grid: Grid) -> Array:
    """Flood from random configurations, and from the middles of floods with locked joints."""
    nodes, Q = grid.rng.integers(grid.size, size=DRAWN), grid.drawn(DRAWN)
    Q, exact = grid.solved(nodes, Q, 40)
    Q = grid.wrapped(Q)
    good = grid.allowed(Q, exact & grid.regular(Q, np.zeros(Q.shape, bool)))
    nodes, Q = nodes[good], Q[good]
    seeds = far_apart(Q * grid.counted, SEEDS)
    more = middles(grid, nodes, Q)
    nodes, Q = np.append(nodes[seeds], more[0]), np.concatenate([Q[seeds], more[1]])
    return grid.flooded(nodes, Q, np.zeros(Q.shape, bool))


def middles(grid: Grid, nodes: Nodes, Q: Array) -> tuple[Nodes, Array]:
    """Return the middles of the largest floods with r joints locked at their values in Q (K, n)."""
    turns = np.linalg.matrix_rank(grid.task.jacobian(Q[0])[:, ~grid.counted], tol=0.02)
    redundant = int(grid.counted.sum() + turns) - grid.task.m
    if not redundant:
        return nodes[:0], Q[:0]
    rows = grid.rng.integers(len(Q), size=LOCKED)
    held = np.zeros((LOCKED, grid.task.n), bool)
    for each in held:
        each[grid.rng.choice(np.flatnonzero(grid.counted), redundant, replace=False)] = True
    rows, held = (part[grid.regular(Q[rows], held)] for part in (rows, held))
    floods = grid.flooded(nodes[rows], Q[rows], held)
    floods = floods[np.isfinite(floods[..., 0]).sum(axis=1).argsort()[::-1][:SEEDS]]
    nodes = np.array(list(map(grid.middle, floods)))
    return nodes, floods[np.arange(len(floods)), nodes]


class AnyConfiguration:
    """Search for a configuration at each node: ``found`` (N,) are the nodes that have one, Q."""

    def __init__(self, grid: Grid, floods: Array) -> None:
        self.grid = grid
        reached = np.isfinite(floods[..., 0])
        self.found = reached.any(axis=0)
        self.Q = floods[reached.argmax(axis=0), np.arange(grid.size)]
        ends = [self.tried(nodes := self.open, grid.drawn(len(nodes))) for _ in range(TRIALS)]
        nodes, starts = (np.concatenate(part) for part in zip(*ends, strict=True))
        order = grid.rng.permutation(len(nodes))
        order = order[np.argsort(nodes[order], kind="stable")]
        rank = np.arange(len(order)) - np.searchsorted(nodes[order], nodes[order])
        walked = order[rank < WALKED]
        way = grid.counted * grid.rng.normal(size=grid.task.n)
        for each in (way, -way):
            for place in self.walk(nodes[walked], starts[walked], each):
                self.take(*place)
        before = -1
        while self.found.sum() > before:
            before = int(self.found.sum())
            for beside in grid.beside.T:
                nodes = self.open[(beside >= 0)[self.open] & self.found[beside[self.open]]]
                self.tried(nodes, self.Q[beside[nodes]])

    @property
    def open(self) -> Nodes:
        """Nodes without a configuration."""
        return np.flatnonzero(~self.found)

    def take(self, nodes: Nodes, Q: Array) -> Mask:
        """Keep those of the exact configurations Q (K, n) that are allowed; return their mask."""
        good = self.grid.allowed(Q, ~self.found[nodes])
        self.found[nodes[good]], self.Q[nodes[good]] = True, Q[good]
        return good

    def tried(self, nodes: Nodes, starts: Array) -> tuple[Nodes, Array]:
        """Solve from starts (K, n); return the exact configurations that are not allowed."""
        Q, exact = self.grid.solved(nodes, starts, 25)
        nodes, Q = nodes[exact], self.grid.wrapped(Q[exact])
        rest = ~self.take(nodes, Q)
        return nodes[rest], Q[rest]

    def walk(self, nodes: Nodes, Q: Array, way: Array) -> Iterator[tuple[Nodes, Array]]:
        """Walk along self-motions from Q (K, n), first along ``way`` (n,); yield each step."""
        ahead = np.broadcast_to(way, Q.shape)
        for _ in range(WALK):
            J = self.grid.task.jacobians(Q)
            ahead = ahead - least(J, np.einsum("Kmn,Kn->Km", J, ahead))
            size = np.linalg.norm(ahead, axis=1)
            ahead = ahead / np.maximum(size, 1e-9)[:, None]
            Q, exact = self.grid.solved(nodes, Q + STRIDE * ahead, 5)
            on = exact & (size > 1e-6) & ~self.found[nodes]
            nodes, Q, ahead = nodes[on], Q[on], ahead[on]
            yield nodes, self.grid.wrapped(Q)


def rectangle(mask: Mask) -> float:
    """Compute the area of the largest rectangle of nodes in a mask (I, J), m²."""
    most, place = 0, np.arange(mask.shape[1])
    for i in range(len(mask)):
        rows = np.ones(mask.shape[1], bool)
        for k in range(i, len(mask)):
            rows = rows & mask[k]
            last = np.maximum.accumulate(np.where(rows, -1, place))
            most = max(most, (k - i) * int((place - last).max() - 1))
    return most * SPACING**2


def line(name: str) -> list[str]:
    """Flood the reach of one arm; return the entries of its line."""
    table = rp.best_cell(task_of(name), orientation="down").table
    begin, design = time.process_time(), table.design
    grid = Grid(design.cell, np.random.default_rng(5))
    floods = floods_of(grid)
    reached = np.isfinite(floods[..., 0])
    any_ = AnyConfiguration(grid, floods).found
    seconds = time.process_time() - begin
    best = reached[reached.sum(axis=1).argmax()]
    one = max(map(grid.for_one_function, floods), key=np.sum)
    sets = np.array([best, reached.any(axis=0), any_, grid.affordable(floods), one])
    areas, inside = SPACING**2 * sets.sum(axis=1), grid.covered()
    rectangles = [rectangle(mask.reshape(grid.shape)) for mask in sets]
    rectangles[0] = max(rectangle(mask.reshape(grid.shape)) for mask in reached)
    area, share = grid.window(reached)
    return [
        f"{design.task.robot.name}, {design.task.kind}",
        ", ".join(f"{area:.3f}" for area in areas),
        ", ".join(f"{area:.3f}" for area in rectangles),
        f"{table._replace(design=table.straight).area:.3f}",
        f"{table.area:.3f}",
        ", ".join(f"{100 * share:.0f}" for share in table.area / areas),
        ", ".join(f"{100 * (inside & ~each).sum() / inside.sum():.1f}" for each in sets),
        f"{area:.3f}, {100 * share:.0f}",
        f"{seconds:.0f}",
    ]


if __name__ == "__main__":
    print_table(TITLES, line)
