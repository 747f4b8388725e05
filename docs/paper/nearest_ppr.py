"""Find the nearest repeatable inverse of Section IV of the paper: two prismatic joints and a
revolute one.

The prismatic joints move along x and y, and the revolute joint turns a unit link (Fig. 3 of Roberts
and Maciejewski):

    x = (d₁ + cos θ₃, d₂ + sin θ₃)                                                            (39)

The null vector n̂ = (sin θ₃, −cos θ₃, 1)/√2 (41) has n̂·∇×n̂ = −1/2 everywhere (42): no surface in
joint space is stable under the pseudoinverse J⁺, and every closed path ends in another
configuration than it started in. The repeatable inverses that depend on θ₃ alone and are closest to
J⁺ form a family with one parameter k,

    G_r(θ, k) = J⁺ + (k cos θ₃ + sin θ₃) / (2 (k² + 1)) · (sin θ₃, −cos θ₃, 1)ᵀ (1, −k)        (60)

and the best k over a ≤ θ₃ ≤ b is −tan((a+b)/2) where b − a < π and cot((a+b)/2) where
π < b − a < 2π (59).

This script compares three solutions: the paper's closed form; a search over k by the criterion
itself, which needs no formula; and the general solver, which also works for a seven-joint arm, with
the potentials {d₁, d₂, polynomials of θ₃}. It prints Table I and then goes beyond the paper: with
potentials of all three joints, the mean of ‖G_r − J⁺‖² over |d₁|, |d₂|, |θ₃| ≤ 1 falls from 0.136
to 0.0186. The figure shows both foliations: a motion that starts on a leaf stays on it.

    python docs/paper/nearest_ppr.py
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from scipy.optimize import minimize_scalar

import repctl_pin as rp
from repctl_pin.show.text.table import table
from repctl_pin.strategies import Inverse

PI = np.pi
INTERVALS = (
    *((-0.5, 0.5), (-1, 1), (0.2, 1), (-1.2, 0.5), (0.3, 2.2)),
    *((-2, 2), (-1, 3), (0.5, 5), (0, PI), (0, 2 * PI)),
)
"""Intervals of θ₃: shorter than π, longer than π, and those where every k is equally good."""


class PaperInverse:
    """Repeatable inverse G_r(θ, k) of (60); with φ = atan k, k = ∞ is not a special case.

    ``rp.CustomInverse(task, function)`` would also work; this class evaluates many q at once.
    """

    def __init__(self, task: rp.Task, k: float) -> None:
        self.task, self.k = task, float(k)

    def batch(self, Q: np.ndarray, J: np.ndarray | None = None) -> np.ndarray:
        """Evaluate G_r at every row of Q (K, 3): (K, 3, 2)."""
        phi, theta = np.arctan(self.k), np.asarray(Q, float)[:, 2]
        one = np.ones_like(theta)
        direction = np.stack([np.sin(theta), -np.cos(theta), one], axis=-1)  # √2 n̂ (41)
        amount = np.sin(theta + phi)[:, None] / 2 * [np.cos(phi), -np.sin(phi)]  # w/√2 (48), (49)
        return rp.Pseudoinverse(self.task).batch(Q, J) + direction[:, :, None] * amount[:, None, :]

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """Evaluate G_r (3, 2)."""
        return self.batch(np.asarray(q, float)[None])[0]

    def velocity(self, q: np.ndarray, xdot: np.ndarray) -> np.ndarray:
        """Evaluate q̇ = G_r ẋ."""
        return self(q) @ xdot


def best_k(a: float, b: float) -> float | None:
    """Compute k* of (59): inf where the leaf is θ₃ = (a+b)/2 ± π/2, None where every k is equally
    good."""
    length = b - a
    if np.isclose(length, PI, atol=1e-12) or np.isclose(length, 2 * PI, atol=1e-12):
        return None
    phi = -(a + b) / 2 + (0 if length < PI else PI / 2)  # (58)
    folded = (phi + PI / 2) % PI - PI / 2
    return np.inf if np.isclose(abs(folded), PI / 2, atol=1e-12) else float(np.tan(folded))


def mean_cost(a: float, b: float, k: float) -> float:
    """Compute C(k) of (57), divided by the length of the interval: the mean of ½ sin²(θ₃ + φ)."""
    phi = np.arctan(k)
    return float(0.25 * (1 - (np.sin(2 * (b + phi)) - np.sin(2 * (a + phi))) / (2 * (b - a))))


@dataclass(frozen=True)
class Search:
    """The best k of (60), unless all are equally good (``unique``), and its mean ‖G_r − J⁺‖²."""

    parameter: float
    unique: bool
    cost: float


def search_family(task: rp.Task, a: float, b: float) -> Search:
    """Minimise the mean of ‖G_r(θ, k) − J⁺‖_F² (26) over φ = atan k: a scan, then Brent's method.

    Both depend on θ₃ alone, so Gauss–Legendre quadrature in θ₃ gives the mean over the box.
    """
    nodes, weights = np.polynomial.legendre.leggauss(40)
    Q = np.zeros((len(nodes), 3))
    Q[:, 2] = (a + b) / 2 + (b - a) / 2 * nodes
    J_plus = rp.Pseudoinverse(task).batch(Q)

    def k_at(phi: float) -> float:
        return np.inf if abs(np.cos(phi)) < 1e-12 else float(np.tan(phi))

    def cost(phi: float) -> float:
        difference = PaperInverse(task, k_at(phi)).batch(Q) - J_plus
        return float(weights @ np.sum(difference**2, axis=(1, 2))) / 2

    angles = np.linspace(-PI / 2, PI / 2, 49)
    costs = np.array([cost(phi) for phi in angles])
    if np.ptp(costs) < 1e-9:  # rounding errors
        return Search(0.0, False, costs[0])
    best, step = angles[np.argmin(costs)], angles[1] - angles[0]
    bounds, options = (best - step, best + step), {"xatol": 1e-10}
    found = minimize_scalar(cost, bounds=bounds, method="bounded", options=options)
    if found.fun < costs.min() * (1 - 1e-14):
        best = found.x
    return Search(k_at(best), True, cost(best))


def paper_potential(Q: np.ndarray, k: float = 0.0) -> np.ndarray:
    """Evaluate the potential h of (60), whose gradient is orthogonal to both columns of
    G_r(θ, k)."""
    angle = Q[..., 2] + np.arctan(k)
    rise = 2 * np.arctanh(np.sin(angle)) - np.sin(angle)  # ∫ (1 + sin²)/cos
    return k * Q[..., 0] + Q[..., 1] - np.hypot(1, k) * rise


@dataclass(frozen=True)
class Answer:
    """Results of the three methods on one interval."""

    a: float
    b: float
    k: float | None
    cost: float
    search: Search
    solver: dict[int, rp.Design | rp.SingularityError]

    @property
    def solver_k(self) -> float:
        """k of the last design of the solver: the ratio of the coefficients of d₁ and d₂."""
        last = self.solver[max(self.solver)]
        return (
            float(last.coefficients[0, 0] / last.coefficients[1, 0])
            if isinstance(last, rp.Design)
            else np.nan
        )

    @property
    def converged(self) -> bool:
        """Whether the cost of the solver no longer falls when the degree is raised."""
        designs = [self.solver[degree] for degree in sorted(self.solver)]
        costs = [
            found.cost if isinstance(found, rp.Design) and found.converged else np.inf
            for found in designs
        ]
        return max(costs) < np.inf and abs(costs[-1] - costs[-2]) < 1e-4 * costs[-1]


def solver(task: rp.Task, a: float, b: float, degree: int, samples: int) -> rp.Design:
    """Run the general solver with the potentials {d₁, d₂, polynomials of θ₃}."""
    center, half = [0.0, 0.0, (a + b) / 2], [1.0, 1.0, (b - a) / 2]
    potentials = rp.Polynomial(center, 1, half, variables=[0, 1]) + rp.Polynomial(
        center, degree, half, variables=[2]
    )
    return rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        potentials,
        rp.Box(center, half),
        options=rp.FitOptions(samples=samples, held_out=2048),
    )


def answer(task: rp.Task, a: float, b: float, degrees: tuple[int, ...], samples: int) -> Answer:
    """Run all three methods on a ≤ θ₃ ≤ b."""
    k = best_k(a, b)
    search = search_family(task, a, b)
    found: dict[int, rp.Design | rp.SingularityError] = {}
    for degree in degrees:
        try:
            found[degree] = solver(task, a, b, degree, samples)
        except rp.SingularityError as error:
            found[degree] = error
    return Answer(a, b, k, mean_cost(a, b, 0.0 if k is None else k), search, found)


def table_one(answers: list[Answer]) -> str:
    """Write Table I of the paper (a = −b), with the results of the search and of the solver."""
    rows = []
    for found in answers:
        b, k = found.b, found.k
        C2 = 0.5 * (np.sin(-2 * b) - np.sin(2 * b))  # (54)
        sign = "0" if abs(C2) < 1e-12 else "+" if C2 > 0 else "−"
        w = {0.0: ("sin θ₃/√2", "0"), np.inf: ("0", "−cos θ₃/√2")}
        w1, w2 = ("(49)", "(48)") if k is None else w[k]
        last = found.solver[max(found.solver)]
        by_solver = (
            number(found.solver_k)
            if found.converged
            else "singular"
            if not isinstance(last, rp.Design)
            else "–"
        )
        searched = number(found.search.parameter) if found.search.unique else "any value"
        k_text = "any value" if k is None else number(k)
        rows.append([in_pi(b), sign, k_text, w1, w2, searched, by_solver])
    return table(["b", "C₂", "k_opt", "w₁", "w₂", "search over (60)", "solver"], rows)


def interval_table(answers: list[Answer]) -> str:
    """Write the costs on many intervals; those of the solver relative to C(k*)."""
    rows = []
    for found in answers:
        excess = []
        for result in found.solver.values():
            if isinstance(result, rp.Design):
                excess.append(f"{result.fit_cost / found.cost - 1:+.0e}")
            else:
                excess.append("singular")
        verdict = "converged" if found.converged else "not converged"
        k_text = "any" if found.k is None else number(found.k)
        k_search = number(found.search.parameter) if found.search.unique else "any"
        k_solver = number(found.solver_k) if found.converged else "–"
        interval = f"[{in_pi(found.a)}, {in_pi(found.b)}]"
        cost = [f"{found.cost:.6f}", f"{found.search.cost:.6f}"]
        rows.append([interval, k_text, k_search, k_solver, *cost, *excess, verdict])
    degrees = [f"degree {d}" for d in answers[0].solver]
    return table(
        ["θ₃ in", "k* (59)", "search", "solver", "C(k*) (52)", "search", *degrees, "solver"], rows
    )


def in_pi(angle: float) -> str:
    """Write an angle, as a multiple of π if it is a simple one."""
    share = angle / PI
    for denominator in (1, 2, 4):
        whole = round(share * denominator)
        if whole and abs(share * denominator - whole) < 1e-12:
            top = {1: "π", -1: "−π"}.get(whole, f"{whole}π".replace("-", "−"))
            return top if denominator == 1 else f"{top}/{denominator}"
    return f"{angle:g}".replace("-", "−")


def number(k: float) -> str:
    """Write k, or ∞."""
    return "∞" if np.isinf(k) else f"{k if abs(k) > 5e-7 else 0.0:.5f}".replace("-", "−")


# ---- the two foliations side by side ----------------------------------------


Potential = Callable[[np.ndarray], np.ndarray]


def leaves(potential: Potential, starts: tuple[float, ...], count: int) -> np.ndarray:
    """Compute the leaves {h(q) = h(0, 0, start)} over |d₁|, |d₂| ≤ 1: points (len(starts), count,
    count, 3).

    θ₃ is NaN where a leaf is outside |θ₃| ≤ 1.
    """
    d, theta = np.linspace(-1, 1, count), np.linspace(-1, 1, 121)
    levels = potential(np.array([[0.0, 0.0, start] for start in starts]))
    points = np.empty((len(starts), count, count, 3))
    for i in range(count):
        Q = np.stack(np.meshgrid(d[i], d, theta, indexing="ij"), axis=-1)[0]  # (count, 121, 3)
        h = potential(Q.reshape(-1, 3)).reshape(Q.shape[:-1])
        up = np.sign(h[0, -1] - h[0, 0])
        if not (np.diff(h) * up > 0).all():
            raise rp.SingularityError(
                "h does not increase with θ₃: this leaf is not a graph over (d₁, d₂)"
            )
        points[:, i, :, :2] = Q[:, 0, :2]
        for j in range(count):
            points[:, i, j, 2] = np.interp(up * levels, up * h[j], theta, left=np.nan, right=np.nan)
    return points


def foliation_figure(task: rp.Task, design: rp.Design, count: int) -> Figure:
    """Draw leaves of the paper's inverse for k = 0 and of a design, coloured by ‖G_r − J⁺‖."""
    paper = PaperInverse(task, 0.0)
    views: list[tuple[str, Inverse, Potential, float]] = [
        (
            "The paper's foliation, k = 0: functions of θ₃",
            paper,
            paper_potential,
            mean_cost(-1, 1, 0.0),
        ),
        (
            f"Potentials of all three joints, degree {design.potentials.degree}",
            design.inverse,
            lambda Q: (design.potentials.values(Q) @ design.coefficients)[:, 0],
            design.cost,
        ),
    ]
    mapper = ScalarMappable(Normalize(0, 0.6), "cividis")
    figure = Figure(figsize=(11, 5.4))
    for place, (title, inverse, potential, cost) in enumerate(views):
        ax = figure.add_axes((0.0 + 0.445 * place, -0.01, 0.44, 0.92), projection="3d")
        for points in leaves(potential, (-0.7, 0.0, 0.7), count):
            flat = np.nan_to_num(points.reshape(-1, 3))
            distance = np.linalg.norm(
                inverse.batch(flat) - rp.Pseudoinverse(task).batch(flat), axis=(1, 2)
            )
            ax.plot_surface(
                *np.moveaxis(points, -1, 0),
                facecolors=mapper.to_rgba(distance.reshape(points.shape[:2])),
                rcount=count,
                ccount=count,
                shade=False,
                linewidth=0,
                antialiased=False,
            )
        ax.set(
            xlim=(-1, 1),
            ylim=(-1, 1),
            zlim=(-1, 1),
            xlabel="d₁ (m)",
            ylabel="d₂ (m)",
            zlabel="θ₃ (rad)",
        )
        ax.set(xticks=(-1, 0, 1), yticks=(-1, 0, 1), zticks=(-1, -0.5, 0, 0.5, 1))
        ax.set_box_aspect((1, 1, 0.85), zoom=0.92)
        ax.view_init(20, -60)
        ax.set_title(
            f"{title}\nmean $\\|G_r - J^+\\|^2$ over |d₁|, |d₂|, |θ₃| ≤ 1: {cost:.4f}",
            fontsize=10.5,
            y=0.97,
        )
    bar = figure.colorbar(mapper, cax=figure.add_axes((0.925, 0.2, 0.013, 0.55)))
    bar.set_label(r"$\|G_r - J^+\|$ on the leaf")
    return figure


@dataclass(frozen=True)
class Result:
    """Results of the script."""

    symmetric: list[Answer]
    intervals: list[Answer]
    all_joints: dict[int, rp.Design]
    mixed: rp.Design


def main(
    out: Path,
    *,
    pairs: tuple[tuple[float, float], ...] = INTERVALS,
    degrees: tuple[int, ...] = (3, 5, 7),
    samples: int = 4096,
    count: int = 81,
) -> Result:
    """Print the tables and write the figure.

    Parameters
    ----------
    out
        Folder of the figure.
    pairs
        Intervals of θ₃ for the second table.
    degrees
        Degrees of the polynomials of θ₃ for the solver.
    samples
        Number of nodes of the fits.
    count
        Points along each side of a drawn leaf.
    """
    out.mkdir(parents=True, exist_ok=True)
    task = rp.Robot.load("ppr").task("tool", "xy")

    here = rp.Box([0, 0, 0], [1, 1, PI])
    defect = np.linalg.norm(rp.bracket_defect(rp.Pseudoinverse(task), task.reference))
    print(f"J⁺: {rp.is_repeatable(rp.Pseudoinverse(task), here).summary()}")
    print(f"    at the origin ‖Ω₁₂‖ = {defect:.6f} rad/m², 1/√8 = {1 / np.sqrt(8):.6f}")
    for k in (0.0, 1.0, np.inf):
        verdict = rp.is_repeatable(PaperInverse(task, k), here)
        print(f"(60), k = {k:g}: {verdict.summary()}".replace("inf", "∞"))

    print("\nTable I: optimal parameters for symmetric joint limits, −b ≤ θ₃ ≤ b\n")
    symmetric = [answer(task, -b, b, degrees, samples) for b in (1.0, PI / 2, 2.0, PI)]
    print(table_one(symmetric))
    print("solver: {d₁, d₂, polynomials of θ₃}; –: not converged in the degree, see below")

    print("\nOther intervals; the columns by degree give the solver's cost relative to C(k*)\n")
    intervals = [answer(task, a, b, degrees, samples) for a, b in pairs]
    print(interval_table(intervals))
    print(
        "\nIn an interval longer than π, the best inverse of this form has the leaf θ₃ = const,\n"
        "where the potential α d₁ + β d₂ + p(θ₃) has a pole. No polynomial has a pole, so the\n"
        "solver's cost does not converge to C(k*). The search over (60) has no such limitation,\n"
        "nor has the solver with products of d₁ and θ₃:\n"
        "h = exp(d₁/2) tan(θ₃/2) exp(cos(θ₃)/2) has this leaf and no pole."
    )
    half = [1.0, 1.0, 2.0]
    products = rp.Polynomial([0, 0, 0], 6, half, variables=[0, 2])
    mixed = rp.nearest_repeatable(rp.Pseudoinverse(task), products, rp.Box([0, 0, 0], half))
    best = mean_cost(-2, 2, np.inf)
    print(f"θ₃ in [−2, 2], polynomials of (d₁, θ₃), degree 6: {mixed.cost:.6f}; C(∞) = {best:.6f}")

    print("\nBeyond the paper: potentials of all three joints over |d₁|, |d₂|, |θ₃| ≤ 1\n")
    cube = rp.Box([0, 0, 0], 1.0)
    all_joints = {
        degree: rp.nearest_repeatable(
            rp.Pseudoinverse(task), rp.Polynomial([0, 0, 0], degree, 1.0), cube
        )
        for degree in (1, 2, 3, 4)
    }
    rows = [["the paper's k = 0, θ₃ alone", f"{mean_cost(-1, 1, 0.0):.5f}", "–"]]
    for degree, design in all_joints.items():
        rows.append(
            [f"all joints, degree {degree}", f"{design.cost:.5f}", f"{design.leaf_margin:.3f}"]
        )
    print(table(["potentials", "mean ‖G_r − J⁺‖²", "leaf margin"], rows))

    file = out / "nearest_ppr_foliations.png"
    foliation_figure(task, all_joints[4], count).savefig(
        file, dpi=160, bbox_inches="tight", pad_inches=0.12
    )
    print(f"\nwrote {file}")
    return Result(symmetric, intervals, all_joints, mixed)


if __name__ == "__main__":
    from output_folder import output_folder

    # for inspection after python -i
    found = main(output_folder(__doc__))
