"""Follow the ten squares of Section V of the paper under the pseudoinverse and two repeatable
inverses.

The arm of Section IV has two prismatic joints and a revolute one with a unit link. It starts at
q = (0, 0, 0) with its tool at (x, y) = (1, 0) and draws ten squares: right, down, left, up
(Fig. 5). The printed paper gives no sizes; sides of 0.4, 0.8, …, 4.0 m at ‖ẋ‖ = 0.04 m/s agree with
its text.

Under the pseudoinverse J⁺ no joint path closes: every motion ends at another point of the spiral of
configurations with the tool at (1, 0) (Fig. 6). Under the repeatable inverse G_r(θ, k) of (60) with
k = 0, which equals J⁺ at θ₃ = 0, all ten joint paths close, and all lie on one leaf (Fig. 7). On
the largest square, A → B → C → D → E = A, the paper marks three points:

    F   J⁺ and k = 0 separate, at the corner C;
    G   J⁺ has θ₃ = −5π/4. There k = −tan(−5π/4) = 1 agrees with J⁺, and a run with k = 1 starts;
    H   J⁺ and k = 1 have the same configuration again, but different speeds.

The paper does not give the position of H. Integrated exactly, the two runs meet at G and differ for
the rest of the cycle; they meet once, on A → B, in the second cycle of J⁺. The script marks that
point as H.

The script writes Figures 4 to 12 as PNG, for comparison with the paper, and prints the final
configuration of every square.

    python docs/paper/ten_squares.py
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

import repctl_pin as rp
from repctl_pin.show.palette import BLUE, GREEN, INK, VERMILLION
from repctl_pin.show.text.numbers import number
from repctl_pin.show.text.table import table

PI = np.pi
SIDES = tuple(0.4 * i for i in range(1, 11))
"""Sides of the squares, m."""
SPEED = 0.04
"""‖ẋ‖, m/s."""
START, TOOL = np.zeros(3), np.array([1.0, 0.0, 0.0])
"""Start configuration, and the tool position there, m."""
STYLE = {"J⁺": VERMILLION, "k = 0": BLUE, "k = 1": GREEN}
JOINTS = ("d₁ (m)", "d₂ (m)", "θ₃ (rad)")
VIEWS = ((0, 1), (0, 2), (1, 2))


Control = rp.CustomInverse | rp.Pseudoinverse


# ---- controllers, squares, runs ---------------------------------------------


def paper_inverse(task: rp.Task, k: float) -> rp.CustomInverse:
    """Make G_r(θ, k) of (60) as a plain function of q."""
    pseudoinverse, phi = rp.Pseudoinverse(task), np.arctan(k)
    w = np.array([np.cos(phi), -np.sin(phi)])

    def G(q: np.ndarray) -> np.ndarray:
        theta = q[2]
        direction = np.array([np.sin(theta), -np.cos(theta), 1.0])  # √2 n̂ (41)
        return pseudoinverse(q) + np.sin(theta + phi) / 2 * np.outer(direction, w)

    return rp.CustomInverse(task, G)


def corners(side: float) -> np.ndarray:
    """Compute the corners A, B, C, D of a square relative to A: (4, 3), m."""
    return side * np.array([[0, 0, 0], [1, 0, 0], [1, -1, 0], [0, -1, 0]], float)


def ring(side: float) -> np.ndarray:
    """Compute the corners of a square in the workspace, A to E: (5, 3), m."""
    return TOOL + np.vstack([corners(side), corners(side)[:1]])


def square(strategy: Control, side: float, steps: int, cycles: int = 1) -> rp.Motion:
    """Follow a square from its corner A at ``SPEED``, from q = (0, 0, 0)."""
    path = rp.polygon(strategy.task, START, corners(side)[1:], name=f"square of side {side:g} m")
    return rp.follow(strategy, path, START, cycles=cycles, steps=steps, period=4 * side / SPEED)


@dataclass(frozen=True)
class Run:
    """One cycle on the largest square, as a function of the position of the tool.

    Attributes
    ----------
    s : (T,) array
        Distance from A along A → B → C → D → E, m.
    q, qdot : (T, 3) arrays
        Joint positions and velocities there.
    """

    s: np.ndarray
    q: np.ndarray
    qdot: np.ndarray

    @property
    def speed(self) -> np.ndarray:
        """Joint speed ‖q̇‖ at every s: (T,)."""
        return np.linalg.norm(self.qdot, axis=1)

    def theta(self) -> CubicHermiteSpline:
        """Interpolate θ₃(s), to fourth order in the step except in the last step of a side."""
        return CubicHermiteSpline(self.s, self.q[:, 2], self.qdot[:, 2] / SPEED)

    def at(self, s: float) -> np.ndarray:
        """Interpolate the configuration at s (3,), which follows from the tool position and θ₃
        (39)."""
        theta = float(self.theta()(s))
        return place(s) - [np.cos(theta), np.sin(theta), -theta]


def place(s: float) -> np.ndarray:
    """Compute the tool position at s: (x, y, 0), m."""
    return np.array([np.interp(s, SIDES[-1] * np.arange(5), x) for x in ring(SIDES[-1]).T])


def turn(motion: rp.Motion, count: int = 0) -> Run:
    """Extract one cycle from a motion that started at A."""
    rows = slice(count * motion.steps, (count + 1) * motion.steps + 1)
    return Run((motion.t[rows] - motion.t[rows][0]) * SPEED, motion.q[rows], motion.qdot[rows])


def turn_from(strategy: Control, s: float, q: np.ndarray, steps: int) -> tuple[Run, float]:
    """Follow the largest square once from a point on D → A; return the run sorted from A on, and
    ‖q − q₀‖ at its end."""
    side = SIDES[-1]
    path = rp.polygon(strategy.task, q, ring(side)[:4] - place(s), name="largest square, from G")
    motion = rp.follow(strategy, path, q, cycles=1, steps=steps, period=4 * side / SPEED)
    along = motion.t * SPEED + s
    after = along >= 4 * side - 1e-9  # past E = A
    order = np.concatenate([np.flatnonzero(after), np.flatnonzero(~after)])
    along = np.where(after, along - 4 * side, along)[order]
    run = Run(
        np.append(along, 4 * side),
        *(np.vstack([a[order], a[order[:1]]]) for a in (motion.q, motion.qdot)),
    )
    keep = np.append(np.diff(run.s) > 1e-9, True)  # G occurs twice, as start and as end
    return Run(run.s[keep], run.q[keep], run.qdot[keep]), float(motion.drift[0])


def crossing(run: Run, other: Run, low: float, high: float) -> float:
    """Find s in [low, high] where two runs have the same θ₃, and so the same configuration."""
    one, two = run.theta(), other.theta()
    return float(brentq(lambda s: one(s) - two(s), low, high, xtol=1e-12))


@dataclass(frozen=True)
class Result:
    """Results of the script.

    Attributes
    ----------
    task : Task
        Tool position of the arm.
    squares : dict
        Strategy → ten motions, by increasing side.
    runs : dict
        Strategy → its cycle on the largest square; with k = 1, from G.
    second : Run
        Second cycle of J⁺.
    points : dict
        Letter → position on the square, distance from A in m.
    closed : float
        ‖q − q₀‖ of the run with k = 1 after one cycle from G.
    figures : tuple of Path
        Files written.
    """

    task: rp.Task
    squares: dict[str, list[rp.Motion]]
    runs: dict[str, Run]
    second: Run
    points: dict[str, float]
    closed: float
    figures: tuple[Path, ...] = ()


def compute(steps: int = 800) -> Result:
    """Follow all squares, with ``steps`` integration steps each."""
    task = rp.Robot.load("ppr").task("tool", "xy")
    pseudoinverse, k0, k1 = (
        rp.Pseudoinverse(task),
        paper_inverse(task, 0.0),
        paper_inverse(task, 1.0),
    )
    squares = {
        "J⁺": [square(pseudoinverse, side, steps) for side in SIDES],
        "k = 0": [square(k0, side, steps) for side in SIDES],
    }
    twice = square(pseudoinverse, SIDES[-1], steps, cycles=2)
    first, second, zero = turn(twice), turn(twice, 1), turn(squares["k = 0"][-1])

    side = SIDES[-1]
    differ = np.abs(first.q - zero.q).max(axis=1) > 1e-9
    F = float(first.s[int(np.argmax(differ)) - 1])
    theta = first.theta()
    G = float(brentq(lambda s: theta(s) + 5 * PI / 4, 3 * side, 4 * side, xtol=1e-12))
    one, closed = turn_from(k1, G, first.at(G), steps)
    H = crossing(second, one, 0.0, side)
    points = {letter: i * side for i, letter in enumerate("ABCDE")} | {"F": F, "G": G, "H": H}
    return Result(task, squares, {"J⁺": first, "k = 0": zero, "k = 1": one}, second, points, closed)


# ---- figures ----------------------------------------------------------------


def fiber(low: float = -6.0, high: float = 1.2) -> np.ndarray:
    """Compute the configurations with the tool at (1, 0), a spiral: (T, 3)."""
    theta = np.linspace(low, high, 400)
    return np.stack([1 - np.cos(theta), -np.sin(theta), theta], axis=-1)


def leaf_k0(theta: np.ndarray) -> np.ndarray:
    """Compute d₂ on the leaf of k = 0 through the origin, for any d₁: ∫ (1 + sin²θ)/cos θ dθ."""
    return 2 * np.arctanh(np.sin(theta)) - np.sin(theta)


def three_views(title: str) -> tuple[Figure, list[Axes]]:
    """Make a figure with empty axes for three orthogonal views of joint space."""
    figure = Figure(figsize=(12.5, 4.4), layout="constrained")
    axes = list(figure.subplots(1, 3))
    for ax, (i, j) in zip(axes, VIEWS, strict=True):
        tidy(ax, JOINTS[i], JOINTS[j])
    axes[0].set_aspect("equal", adjustable="datalim")
    figure.suptitle(title, fontsize=11, x=0.01, ha="left")
    return figure, axes


def tidy(ax: Axes, xlabel: str, ylabel: str) -> None:
    ax.set(xlabel=xlabel, ylabel=ylabel)
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(True, color="#e2e2e2", lw=0.6)
    ax.set_axisbelow(True)


def letter(
    ax: Axes, text: str, x: float, y: float, offset: tuple[float, float] = (6, 6), dot: bool = True
) -> None:
    """Mark a point and write its letter beside it."""
    if dot:
        ax.plot([x], [y], "o", ms=4.5, color=INK, zorder=6)
    ax.annotate(
        text,
        (x, y),
        xytext=offset,
        textcoords="offset points",
        fontsize=11,
        weight="bold",
        color=INK,
        ha="center",
        va="center",
        zorder=7,
    )


def shade(side: float) -> tuple[float, float, float, float]:
    """Choose the colour of a square by its side."""
    return colormaps["viridis"](0.92 * (1 - side / SIDES[-1]))


def side_bar(figure: Figure, axes: list[Axes]) -> None:
    """Draw a colour bar for the sides of the squares."""
    bar = figure.colorbar(
        ScalarMappable(Normalize(0, SIDES[-1]), colormaps["viridis"].reversed()), ax=axes, pad=0.01
    )
    bar.set_label("side of the square (m)")
    bar.set_ticks(SIDES)


def figure_4(task: rp.Task) -> Figure:
    """Draw ‖w‖ = ‖G_r − J⁺‖ over θ₃ and k, as a surface and as a map."""
    theta, ks = np.linspace(-PI, PI, 121), np.linspace(-4, 4, 65)
    Q = np.stack([0 * theta, 0 * theta, theta], axis=-1)
    desired = rp.Pseudoinverse(task).batch(Q)
    norm = np.array(
        [np.linalg.norm(paper_inverse(task, k).batch(Q) - desired, 2, axis=(1, 2)) for k in ks]
    )
    figure = Figure(figsize=(12, 5))
    ax = figure.add_axes((0.0, 0.0, 0.5, 0.95), projection="3d")
    X, Y = np.meshgrid(theta, ks)
    ax.plot_surface(
        X, Y, norm, cmap="cividis", rcount=65, ccount=121, linewidth=0, antialiased=False
    )
    ax.set(xlabel="θ₃ (rad)", ylabel="k", zlabel="‖w‖₂", zlim=(0, 0.75))
    ax.set_xticks(*pi_ticks(-1, 1))
    ax.set_box_aspect((1.2, 1, 0.6), zoom=0.95)
    ax.view_init(32, -58)
    flat = figure.add_axes((0.55, 0.13, 0.37, 0.75))
    mesh = flat.contourf(X, Y, norm, levels=np.linspace(0, 0.71, 72), cmap="cividis")
    lines = flat.contour(X, Y, norm, levels=[0.1, 0.3, 0.5, 0.7], colors="white", linewidths=0.7)
    flat.clabel(lines, fontsize=8)
    phi = np.linspace(-1.32, 1.32, 200)
    for turn_by in (-PI, 0, PI):
        flat.plot(turn_by - phi, np.tan(phi), color=VERMILLION, lw=1.6)
    flat.plot([], [], color=VERMILLION, lw=1.6, label=r"k = −tan θ₃: $G_r = J^+$")
    flat.set(xlabel="θ₃ (rad)", ylabel="k", xlim=(-PI, PI), ylim=(-4, 4))
    flat.set_xticks(*pi_ticks(-1, 1))
    flat.legend(loc="lower right", bbox_to_anchor=(1, 1), frameon=False, fontsize=9)
    bar = figure.colorbar(mesh, cax=figure.add_axes((0.93, 0.13, 0.012, 0.75)))
    bar.set_ticks(np.arange(0, 0.71, 0.1))
    bar.set_label("‖w‖₂")
    figure.text(
        0.01,
        0.96,
        r"Fig. 4: the norm of the difference between $G_r$(θ, k) and $J^+$",
        fontsize=11,
        va="top",
    )
    return figure


def pi_ticks(low: int, high: int, parts: int = 2) -> tuple[list[float], list[str]]:
    """Make ticks at multiples of π/parts, from low π to high π."""
    multiples = range(low * parts, high * parts + 1)
    names = []
    for i in multiples:
        sign = "−" if i < 0 else ""
        top, bottom = (abs(i) // parts, "") if i % parts == 0 else (abs(i), f"/{parts}")
        names.append(f"{sign}{top if top != 1 else ''}π{bottom}" if i else "0")
    return [i * PI / parts for i in multiples], names


def figure_5() -> Figure:
    """Draw the ten squares in the workspace."""
    figure = Figure(figsize=(5.6, 5.2), layout="constrained")
    ax = figure.add_subplot()
    tidy(ax, "x (m)", "y (m)")
    for side in SIDES:
        ax.plot(*ring(side)[:, :2].T, color=shade(side), lw=1.4)
    for start, end in pairwise(ring(SIDES[-1])):
        middle, step = (start + end)[:2] / 2, 0.02 * (end - start)[:2]
        ax.annotate(
            "",
            middle + step,
            middle - step,
            arrowprops={"arrowstyle": "-|>", "color": shade(SIDES[-1])},
        )
    for text, (x, y), offset in zip(
        ("A, E", "B", "C", "D"),
        ring(SIDES[-1])[:4, :2],
        [(-2, 11), (6, 11), (6, -11), (-6, -11)],
        strict=True,
    ):
        letter(ax, text, x, y, offset)
    ax.set_aspect("equal")
    ax.margins(0.08)
    side_bar(figure, [ax])
    ax.set_title("Fig. 5: paths of the tool from (1, 0)", fontsize=11, loc="left")
    return figure


def draw_fiber(axes: Sequence[Axes], spiral: np.ndarray) -> None:
    """Draw the fibre of the start in three orthogonal views of joint space."""
    for k, (ax, (i, j)) in enumerate(zip(axes, VIEWS, strict=True)):
        label = "fibre of (x, y) = (1, 0)" if k == 1 else None
        dashed = {"color": "#8a8a8a", "lw": 1.2, "ls": (0, (4, 2)), "zorder": 1}
        ax.plot(spiral[:, i], spiral[:, j], label=label, **dashed)


def figure_6_or_7(motions: list[rp.Motion], title: str, *, leaf: bool) -> Figure:
    """Draw ten motions in three orthogonal views of joint space, and the fibre of the start."""
    figure, axes = three_views(title)
    theta = np.linspace(-1.42, 0.9, 200)
    for ax, (i, j) in zip(axes, VIEWS, strict=True):
        if leaf and (i, j) == (1, 2):
            ax.plot(leaf_k0(theta), theta, color=VERMILLION, lw=5, alpha=0.28, zorder=1)
        for side, motion in reversed(list(zip(SIDES, motions, strict=True))):
            ax.plot(motion.q[:, i], motion.q[:, j], color=shade(side), lw=1.3)
            if not leaf:
                ax.plot(
                    *motion.q[-1, [i, j]],
                    "o",
                    ms=5,
                    color=shade(side),
                    mec="white",
                    mew=0.6,
                    zorder=5,
                )
        ax.plot(0, 0, "s", ms=6, color=INK, zorder=6)
    axes[1].plot([], [], "s", ms=6, color=INK, ls="", label="start")
    if leaf:
        axes[1].plot(
            [],
            [],
            color=VERMILLION,
            lw=5,
            alpha=0.28,
            label="leaf of k = 0 through the start, seen edge-on",
        )
    else:
        axes[1].plot([], [], "o", ms=5, color=shade(2.0), ls="", label="end")
    draw_fiber(axes, fiber())
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    side_bar(figure, axes)
    return figure


def figure_8(result: Result) -> Figure:
    """Draw the leaf of k = 0 through the origin, and the motion of J⁺ that leaves the leaf."""
    run, points = result.runs["J⁺"], result.points
    figure = Figure(figsize=(8.2, 6.6))
    ax: Axes3D = figure.add_axes((0.0, 0.02, 0.98, 0.92), projection="3d", computed_zorder=False)
    d1, theta = np.linspace(-0.5, 5.2, 30), np.linspace(-1.47, 0.45, 90)
    X, T = np.meshgrid(d1, theta)
    ax.plot_surface(
        X,
        leaf_k0(T),
        T,
        color="#56B4E9",
        alpha=0.45,
        rcount=45,
        ccount=24,
        linewidth=0.25,
        edgecolor="#ffffff",
        shade=True,
        zorder=1,
    )
    on = run.s <= points["F"]
    ax.plot(*run.q[on].T, color=BLUE, lw=2.6, zorder=4, label="J⁺ on the leaf, A to F")
    ax.plot(*run.q[~on].T, color=VERMILLION, lw=2.6, zorder=4, label="J⁺ off the leaf, from F on")
    zero = result.runs["k = 0"]
    off = zero.s >= points["F"]
    ax.plot(
        *zero.q[off].T,
        color=BLUE,
        lw=1.6,
        ls=(0, (3, 1.5)),
        zorder=4,
        label="k = 0 from F back to the start",
    )
    shifts = [
        (-0.3, 0.1, 0.3),
        (0.15, 0.1, 0.25),
        (0.2, -0.3, 0.3),
        (-0.3, 0, -0.3),
        (0, 0.2, -0.35),
    ]
    for text, shift in zip("ABCDE", shifts, strict=True):
        q = run.at(points[text])
        ax.plot(*q[:, None], "o", ms=5, color=INK, zorder=6)
        ax.text(
            *(q + shift),
            "C, F" if text == "C" else text,
            fontsize=12,
            weight="bold",
            color=INK,
            zorder=7,
        )
    ax.set(
        xlabel="d₁ (m)",
        ylabel="d₂ (m)",
        zlabel="θ₃ (rad)",
        xlim=(-0.5, 5.2),
        ylim=(-5.2, 1),
        zlim=(-4.6, 0.8),
    )
    ax.set_box_aspect((1, 1, 0.95), zoom=0.95)
    ax.view_init(24, -128)
    figure.legend(loc="lower center", ncols=3, frameon=False, fontsize=9)
    ax.set_title(
        "Fig. 8: a motion of J⁺ and the leaf of k = 0 through the origin", fontsize=11, y=1.0
    )
    return figure


OFFSETS_9 = {
    (0, 1): {
        "A": (-10, 6),
        "B": (9, 8),
        "C": (20, 4),
        "D": (-9, -9),
        "E": (-3, 11),
        "G": (11, -6),
        "H": (7, -11),
    },
    (0, 2): {
        "A": (9, 9),
        "B": (8, 9),
        "C": (19, 5),
        "D": (-11, 6),
        "E": (-10, -8),
        "G": (-10, 8),
        "H": (12, 5),
    },
    (1, 2): {
        "A": (10, 4),
        "B": (-14, 9),
        "C": (-12, 10),
        "D": (-11, 4),
        "E": (11, 2),
        "G": (-11, -5),
        "H": (13, -2),
    },
}


def figure_9(result: Result) -> Figure:
    """Draw three motions on the largest square in three orthogonal views of joint space."""
    figure, axes = three_views(
        "Fig. 9: J⁺ and the repeatable inverses k = 0 and k = 1 on the largest square"
    )
    for ax, (i, j) in zip(axes, VIEWS, strict=True):
        draw_runs(ax, result, lambda run, i=i: run.q[:, i], lambda run, j=j: run.q[:, j])
        ax.margins(0.07)
        for text, offset in OFFSETS_9[i, j].items():
            run = result.second if text == "H" else result.runs["J⁺"]
            q = run.at(result.points[text])
            letter(ax, "C, F" if text == "C" else text, q[i], q[j], offset)
    draw_fiber(axes, fiber(-5.2))
    handles, labels = axes[1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    return figure


def draw_runs(
    ax: Axes, result: Result, x: Callable[[Run], np.ndarray], y: Callable[[Run], np.ndarray]
) -> None:
    """Draw the three runs, with the beginning of the second cycle of J⁺."""
    wide = {"J⁺": 3.2, "k = 0": 1.5, "k = 1": 1.8}
    for label, run in result.runs.items():
        ax.plot(
            x(run), y(run), color=STYLE[label], lw=wide[label], label=label, solid_capstyle="butt"
        )
    second = result.second
    part = second.s <= SIDES[-1] / 2
    cut = Run(second.s[part], second.q[part], second.qdot[part])
    ax.plot(x(cut), y(cut), color=STYLE["J⁺"], lw=1.6, ls=(0, (1, 1)), label="J⁺, second cycle")


def along_the_square(title: str, ylabel: str) -> tuple[Figure, Axes]:
    """Make a figure with the position of the tool on the largest square as horizontal axis."""
    figure = Figure(figsize=(9, 4.6), layout="constrained")
    ax = figure.add_subplot()
    tidy(ax, "position of the tool: distance from A along the square (m)", ylabel)
    side = SIDES[-1]
    for i, text in enumerate("ABCDE"):
        ax.axvline(i * side, color="#bbbbbb", lw=0.8, zorder=0)
        ax.annotate(
            text,
            (i * side, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 7),
            weight="bold",
            textcoords="offset points",
            ha="center",
            fontsize=11,
        )
    ax.set_xlim(-0.02 * side, 4.02 * side)
    ax.set_xticks(np.arange(0, 4 * side + 0.1, side / 2))
    figure.suptitle(title, fontsize=11, x=0.01, ha="left")
    return figure, ax


def figure_10(result: Result) -> Figure:
    """Draw θ₃, which with the position of the tool determines the configuration."""
    figure, ax = along_the_square(
        "Fig. 10: the configuration, given by θ₃, along the largest square", "θ₃ (rad)"
    )
    draw_runs(ax, result, lambda run: run.s, lambda run: run.q[:, 2])
    for text, offset in {"F": (9, 9), "G": (4, 12), "H": (8, 9)}.items():
        run, s = (result.second if text == "H" else result.runs["J⁺"], result.points[text])
        letter(ax, text, s, run.at(s)[2], offset)
    ax.set_yticks(*quarter_ticks(-7, 0))
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)
    return figure


def quarter_ticks(low: int, high: int) -> tuple[list[float], list[str]]:
    """Make ticks at multiples of π/4."""
    text = {
        0: "0",
        -1: "−π/4",
        -2: "−π/2",
        -3: "−3π/4",
        -4: "−π",
        -5: "−5π/4",
        -6: "−3π/2",
        -7: "−7π/4",
    }
    return [i * PI / 4 for i in range(low, high + 1)], [text[i] for i in range(low, high + 1)]


def figure_11(result: Result) -> Figure:
    """Draw ‖q̇‖ along the square."""
    figure, ax = along_the_square(
        "Fig. 11: the norm of the joint velocity along the largest square, ‖ẋ‖ = 0.04 m/s",
        "‖q̇‖ (m/s and rad/s)",
    )
    # The velocity at E belongs to the next side.
    draw_runs(ax, result, lambda run: run.s[:-1], lambda run: run.speed[:-1])
    zero = result.runs["k = 0"]
    F = result.points["F"]
    letter(ax, "F", F, zero.speed[np.searchsorted(zero.s, F) - 1], (-9, 7))
    for text, run, offset in (
        ("G", result.runs["J⁺"], (-8, 8)),
        ("H", result.second, (-9, -5)),
        ("H", result.runs["k = 1"], (9, -8)),
    ):
        s = result.points[text]
        letter(ax, text, s, float(np.interp(s, run.s, run.speed)), offset)
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)
    return figure


def figure_12(result: Result) -> Figure:
    """Draw the cost of repeatability at each configuration of the run with k = 0."""
    difference, bound = penalty(result)
    figure, ax = along_the_square(
        "Fig. 12: joint velocity of k = 0 relative to J⁺ at the same configuration",
        "norm (m/s and rad/s)",
    )
    s = result.runs["k = 0"].s
    ax.plot(s, difference, color=BLUE, lw=2.2, label="‖q̇(k = 0) − J⁺ ẋ‖")
    ax.plot(
        s, bound, color=VERMILLION, lw=1.6, ls=(0, (4, 2)), label="‖w‖₂ ‖ẋ‖₂, the worst direction"
    )
    ax.set_ylim(bottom=-0.0004)
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)
    return figure


def penalty(result: Result) -> tuple[np.ndarray, np.ndarray]:
    """Compute ‖q̇ − J⁺ ẋ‖ along the run with k = 0 for the ẋ of the square, and its upper bound
    ‖w‖₂ ‖ẋ‖₂."""
    run, task = result.runs["k = 0"], result.task
    J = task.jacobians(run.q)
    desired = rp.Pseudoinverse(task).batch(run.q, J)
    xdot = np.einsum("kan,kn->ka", J, run.qdot)
    difference = np.linalg.norm(run.qdot - np.einsum("kna,ka->kn", desired, xdot), axis=1)
    w = np.linalg.norm(paper_inverse(task, 0.0).batch(run.q, J) - desired, 2, axis=(1, 2))
    return difference, w * SPEED


def main(out: Path, *, steps: int = 800, dpi: int = 150) -> Result:
    """Follow the squares, print their final configurations, write Figures 4 to 12.

    Parameters
    ----------
    out
        Folder of the figures.
    steps
        Integration steps per square.
    dpi
        Resolution of the figures, dots per inch.
    """
    out.mkdir(parents=True, exist_ok=True)
    result = compute(steps)
    rows = []
    for side, by_J, by_k in zip(SIDES, result.squares["J⁺"], result.squares["k = 0"], strict=True):
        end = ", ".join(f"{value:.8f}".replace("-", "−") for value in by_J.q[-1])
        rows.append([f"{side:.1f} m", end, f"{by_J.drift[0]:.4f}", number(by_k.drift[0])])
    print(table(["side", "J⁺ ends at (d₁, d₂, θ₃)", "‖q − q₀‖ of J⁺", "of k = 0"], rows))
    G, H = result.points["G"], result.points["H"]
    print(f"\nG = {G:.4f} m from A, where J⁺ has θ₃ = −5π/4: k = 1 starts there")
    print(f"‖q − q₀‖ of k = 1 after one cycle from G: {result.closed:.0e}")
    second, one = result.second, result.runs["k = 1"]
    of_J = np.interp(H, second.s, second.speed)
    of_one = np.interp(H, one.s, one.speed)
    print(f"H = {H:.4f} m from A, in the second cycle of J⁺: J⁺ and k = 1 have the same q,")
    print(f"but ‖q̇‖ = {of_J:.4f} (J⁺) and {of_one:.4f} (k = 1)")

    figures = {
        4: figure_4(result.task),
        5: figure_5(),
        6: figure_6_or_7(
            result.squares["J⁺"], "Fig. 6: the ten motions of J⁺ in joint space", leaf=False
        ),
        7: figure_6_or_7(
            result.squares["k = 0"], "Fig. 7: the ten motions of k = 0 in joint space", leaf=True
        ),
        8: figure_8(result),
        9: figure_9(result),
        10: figure_10(result),
        11: figure_11(result),
        12: figure_12(result),
    }
    files = tuple(out / f"figure_{k:02d}.png" for k in figures)
    for file, figure in zip(files, figures.values(), strict=True):
        figure.savefig(file, dpi=dpi, bbox_inches="tight", pad_inches=0.12)
    print(f"\nwrote {files[0]} … {files[-1].name}")
    return replace(result, figures=files)


if __name__ == "__main__":
    from output_folder import output_folder

    # for inspection after python -i
    found = main(output_folder(__doc__))
