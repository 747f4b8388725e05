"""Extra joint speed of whole tables beside the smallest of any function on the same domain.

Run ``python tests/benchmarks/nearness.py [ARM …]``, for arms with r = 1 whose table has the angle
round the base and the spin of the tool as symmetries. What is left is a function of radius and
height. Its configurations on a grid, q_ij = F_ij moved by a_ij along the self-motion, are free
here, without polynomials, limits or bodies: ``mean ‖(∂F − J⁺E) C‖_F²`` is minimised over all a_ij
by nonlinear least squares, from F and from leaves on both sides of it. Each line gives, by the same
differences on the same grid, that mean and the mean extra joint speed: of F, and of the minimum.
"""

from __future__ import annotations

import sys
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.sparse import csr_array, kron

import repctl_pin as rp

Array = NDArray[np.float64]

ARMS = ("panda", "xarm7", "baxter")
SIDE = 21
"""Nodes along radius and along height."""

SHIFTS = (0.0, 0.3, -0.3)
"""Distances along the self-motion at which the search starts, rad."""

TITLES = "arm | mean, F | minimum | above it | extra speed, F | at the minimum | moved, rad"


class Figures(NamedTuple):
    """Mean squared distance from J⁺, and mean extra joint speed, of configurations on the grid."""

    distance: float
    extra_speed: float


class Grid:
    """A function of radius and height on a grid over the domain of a table.

    Letters: K = SIDE² nodes, L = (SIDE − 1)² squares between them, k coordinates of the cell, n
    joints.
    """

    def __init__(self, design: rp.CellDesign) -> None:
        self.task, self.cell = design.task, design.cell
        self.F = design.function
        names = list(self.cell.names)
        self.free = [names.index("radius"), names.index("height")]
        self.turns = [i for i in range(self.cell.k) if i not in self.free]
        nodes = np.linspace(-1, 1, SIDE)
        self.step = nodes[1] - nodes[0]
        U = self.coordinates(nodes)
        self.targets = [pin.SE3(R, p) for p, R in zip(*self.cell.placements(U), strict=True)]
        self.q = self.F.batch(U)
        self.along = self.along_turns(U)
        self.null = oriented(null_vectors(self.task.jacobians(self.q)))
        middles = self.coordinates((nodes[1:] + nodes[:-1]) / 2)
        self.C = self.cell.speeds(middles)  # (L, k, k)
        self.null_middles = of_corners(self.null)

    def coordinates(self, values: Array) -> Array:
        """Return U (K, k) of the points with these values of radius and of height."""
        U = np.zeros((len(values) ** 2, self.cell.k))
        U[:, self.free] = np.stack(np.meshgrid(values, values, indexing="ij"), -1).reshape(-1, 2)
        return U

    def along_turns(self, U: Array, h: float = 1e-5) -> Array:
        """Return ∂q/∂u (n, k − 2) for the turns, which is the same at all configurations."""
        slopes = []
        for i in self.turns:
            e = h * np.eye(self.cell.k)[i]
            slope = (self.F.batch(U + e) - self.F.batch(U - e)) / (2 * h)
            assert slope.std(axis=0).max() < 1e-6, "this turn is not a symmetry"
            slopes.append(slope.mean(axis=0))
        return np.stack(slopes, axis=1)

    def moved(self, a: Array) -> Array:
        """Return the configurations (K, n) at the targets, from F moved by a (K,) along n̂."""
        Q = self.q + a[:, None] * self.null
        for _ in range(20):
            error = self.task.errors(Q, self.targets)
            if np.abs(error).max() < 1e-12:
                return Q
            J = self.task.jacobians(Q)
            Jt = np.swapaxes(J, 1, 2)
            Q = Q + (Jt @ np.linalg.solve(J @ Jt, error[..., None]))[..., 0]
        raise ValueError("the targets were not reached")

    def slopes(self, Q: Array) -> tuple[Array, Array]:
        """Return ∂q/∂u (L, n, k) and q (L, n) in the middles of the squares."""
        q = Q.reshape(SIDE, SIDE, -1)
        low, high = q[:-1], q[1:]
        by_radius = (high[:, :-1] + high[:, 1:] - low[:, :-1] - low[:, 1:]) / (2 * self.step)
        by_height = (low[:, 1:] + high[:, 1:] - low[:, :-1] - high[:, :-1]) / (2 * self.step)
        n = q.shape[2]
        slopes = np.empty(((SIDE - 1) ** 2, n, self.cell.k))
        slopes[:, :, self.free[0]] = by_radius.reshape(-1, n)
        slopes[:, :, self.free[1]] = by_height.reshape(-1, n)
        slopes[:, :, self.turns] = self.along
        return slopes, of_corners(Q) / 4

    def residuals(self, a: Array) -> Array:
        """Return n̂ᵀ ∂F C (L, k): ``‖(∂F − J⁺E) C‖_F²`` is the sum of its squares in a row."""
        slopes, q = self.slopes(self.moved(a))
        null = null_vectors(self.task.jacobians(q))
        null *= np.sign((null * self.null_middles).sum(axis=1))[:, None]
        return np.asarray(np.einsum("li, lij, ljk -> lk", null, slopes, self.C))

    def figures(self, a: Array) -> Figures:
        """Evaluate the configurations moved by a (K,) along the self-motion."""
        distance = (self.residuals(a) ** 2).sum(axis=1)
        slopes, _ = self.slopes(self.moved(a))
        own = ((slopes @ self.C) ** 2).sum(axis=(1, 2))
        ratio = own.mean() / (own - distance).mean()  # of ∂F C = J⁺E C + n̂ n̂ᵀ ∂F C
        return Figures(float(distance.mean()), float(np.sqrt(ratio) - 1))

    def minimum(self, shift: float) -> Array:
        """Minimise over a (K,) from a leaf at this distance, rad; return the minimiser."""
        ends = csr_array((np.ones(2 * SIDE - 2), corners_of_intervals()))
        entries = kron(kron(ends, ends), np.ones((self.cell.k, 1)))
        found = least_squares(
            lambda a: self.residuals(a).ravel(),
            np.full(SIDE**2, shift),
            jac_sparsity=entries,
            max_nfev=60,
        )
        return np.asarray(found.x)


def corners_of_intervals() -> tuple[Array, Array]:
    """Return rows and columns of the (SIDE − 1, SIDE) matrix of each interval's two ends."""
    intervals = np.arange(SIDE - 1)
    return np.concatenate([intervals, intervals]), np.concatenate([intervals, intervals + 1])


def null_vectors(J: Array) -> Array:
    """Return n̂ (K, n), of either sign, of Jacobians J (K, n − 1, n)."""
    return np.asarray(np.linalg.svd(J)[2][:, -1])


def oriented(null: Array) -> Array:
    """Return null vectors (K, n) of the grid with signs that agree between neighbours."""
    grid = null.reshape(SIDE, SIDE, -1).copy()
    for i, j in np.ndindex(SIDE, SIDE):
        near = grid[i - 1, j] if i else grid[i, max(j - 1, 0)]
        grid[i, j] *= np.sign(grid[i, j] @ near)
    return grid.reshape(null.shape)


def of_corners(values: Array) -> Array:
    """Sum values (K, n) at the four corners of each square: (L, n)."""
    grid = values.reshape(SIDE, SIDE, -1)
    corners = grid[1:, 1:] + grid[1:, :-1] + grid[:-1, 1:] + grid[:-1, :-1]
    return corners.reshape(-1, values.shape[1])


def line(name: str) -> list[str]:
    """Compare the whole table of one arm with the smallest on its domain."""
    robot = rp.Robot.load(name)
    task = robot.task(robot.default_frame, "pose")
    grid = Grid(rp.best_cell(task, orientation="down").table.design)
    own = grid.figures(np.zeros(SIDE**2))
    found = [grid.minimum(shift) for shift in SHIFTS]
    a = min(found, key=lambda a: grid.figures(a).distance)
    least = grid.figures(a)
    return [
        name,
        f"{own.distance:.3f}",
        f"{least.distance:.3f}",
        f"{100 * (own.distance / least.distance - 1):.1f} %",
        f"{100 * own.extra_speed:.2f} %",
        f"{100 * least.extra_speed:.2f} %",
        f"{np.abs(a).max():.2f}",
    ]


if __name__ == "__main__":
    print(f"| {TITLES} |")
    for arm in sys.argv[1:] or ARMS:
        print("| " + " | ".join(line(arm)) + " |", flush=True)
