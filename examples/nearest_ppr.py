"""Section IV of the paper: the nearest repeatable inverse of an arm with two slides and one joint.

The arm slides along x and y and turns a unit link (Fig. 3 of Roberts and Maciejewski):

    x = (d₁ + cos θ₃, d₂ + sin θ₃)
    (39)

Its null vector n̂ = (sin θ₃, −cos θ₃, 1)/√2 (41) has n̂·∇×n̂ = −1/2 everywhere (42): no surface in
joint space is stable under the pseudoinverse J⁺, and every closed path ends with other joint
positions than it started with. The repeatable inverses of θ₃ alone that lie nearest to J⁺ form a
family in one number k,

    G_r(θ, k) = J⁺ + (k cos θ₃ + sin θ₃) / (2 (k² + 1)) · (sin θ₃, −cos θ₃, 1)ᵀ (1, −k)
    (60)

and the best k over a ≤ θ₃ ≤ b is −tan((a+b)/2) where b − a < π and cot((a+b)/2) where π < b − a <
2π (59).

This script lays three answers beside each other: the paper's closed form; a search over k by the
criterion itself, which needs no formula; and the general engine that serves a seven-joint arm,
given the potentials {d₁, d₂, polynomials of θ₃}. It prints Table I, and then goes on where the
paper stops: with potentials of all three joints the mean of ‖G_r − J⁺‖² over |d₁|, |d₂|, |θ₃| ≤ 1
falls from 0.136 to 0.0186. The figure shows both foliations: a motion that starts on a surface
stays on it.

    python examples/nearest_ppr.py
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

import repctl_pin as rp
from repctl_pin.design import FamilyDesign, cost_has_converged, nearest_in_family
from repctl_pin.show.text.table import table
from repctl_pin.strategies import Inverse

PI = np.pi
INTERVALS = (
    *((-0.5, 0.5), (-1, 1), (0.2, 1), (-1.2, 0.5), (0.3, 2.2)),
    *((-2, 2), (-1, 3), (0.5, 5), (0, PI), (0, 2 * PI)),
)
"""Shorter than π, longer, and where every k is as good."""


class PaperInverse:
    """G_r(θ, k) of (60), k = ∞ included: written with φ = atan k it has no case apart.

    ``rp.CustomInverse(task, function)`` would do as well; this one takes all of its q at once.
    """

    def __init__(self, task: rp.Task, k: float) -> None:
        self.task, self.k = task, float(k)

    def batch(self, Q: np.ndarray, J: np.ndarray | None = None) -> np.ndarray:
        """Evaluate G_r at every row of Q (K, 3): (K, 3, 2)."""
        phi, theta = np.arctan(self.k), np.asarray(Q, float)[:, 2]
        direction = np.stack(
            [np.sin(theta), -np.cos(theta), np.ones_like(theta)], axis=-1
        )  # √2 n̂ (41)
        amount = np.sin(theta + phi)[:, None] / 2 * [np.cos(phi), -np.sin(phi)]  # w/√2 (48), (49)
        return rp.Pseudoinverse(self.task).batch(Q, J) + direction[:, :, None] * amount[:, None, :]

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """Evaluate G_r (3, 2)."""
        return self.batch(np.asarray(q, float)[None])[0]

    def velocity(self, q: np.ndarray, xdot: np.ndarray) -> np.ndarray:
        """Choose q̇ = G_r ẋ."""
        return self(q) @ xdot


def best_k(a: float, b: float) -> float | None:
    """k* of (59); inf where θ₃ = (a+b)/2 ± π/2 is the leaf, None where every k is as good."""
    length = b - a
    if np.isclose(length, PI, atol=1e-12) or np.isclose(length, 2 * PI, atol=1e-12):
        return None
    phi = -(a + b) / 2 + (0 if length < PI else PI / 2)  # (58)
    folded = (phi + PI / 2) % PI - PI / 2
    return np.inf if np.isclose(abs(folded), PI / 2, atol=1e-12) else float(np.tan(folded))


def mean_cost(a: float, b: float, k: float) -> float:
    """C(k) of (57) over the length of the interval: the mean of ½ sin²(θ₃ + φ)."""
    phi = np.arctan(k)
    return float(0.25 * (1 - (np.sin(2 * (b + phi)) - np.sin(2 * (a + phi))) / (2 * (b - a))))


def paper_potential(Q: np.ndarray, k: float = 0.0) -> np.ndarray:
    """h, constant along the motions of (60): its gradient is orthogonal to both columns of G_r(θ,
    k)."""
    angle = Q[..., 2] + np.arctan(k)
    rise = 2 * np.arctanh(np.sin(angle)) - np.sin(angle)  # ∫ (1 + sin²)/cos
    return k * Q[..., 0] + Q[..., 1] - np.hypot(1, k) * rise


@dataclass(frozen=True)
class Answer:
    """What each of the three ways says about one interval."""

    a: float
    b: float
    k: float | None
    cost: float
    search: FamilyDesign
    engine: dict[int, rp.Design | rp.SingularityError]

    @property
    def engine_k(self) -> float:
        """k of the engine's last design: the ratio of the coefficients of d₁ and d₂."""
        last = self.engine[max(self.engine)]
        return (
            float(last.coefficients[0, 0] / last.coefficients[1, 0])
            if isinstance(last, rp.Design)
            else np.nan
        )

    @property
    def settled(self) -> bool:
        """The engine's cost no longer falls when the degree is raised."""
        return cost_has_converged([self.engine[degree] for degree in sorted(self.engine)])


def engine(task: rp.Task, a: float, b: float, degree: int, samples: int) -> rp.Design:
    """Ask the general engine, with the potentials {d₁, d₂, polynomials of θ₃}."""
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
    """Ask all three about a ≤ θ₃ ≤ b."""
    k = best_k(a, b)
    region = rp.Box.between([-1, -1, a], [1, 1, b])
    search = nearest_in_family(
        rp.Pseudoinverse(task), lambda k: PaperInverse(task, k), region, samples=samples
    )
    found: dict[int, rp.Design | rp.SingularityError] = {}
    for degree in degrees:
        try:
            found[degree] = engine(task, a, b, degree, samples)
        except rp.SingularityError as error:
            found[degree] = error
    return Answer(a, b, k, mean_cost(a, b, 0.0 if k is None else k), search, found)


def table_one(answers: list[Answer]) -> str:
    """Table I of the paper (a = −b), and what the search and the engine find there."""
    rows = []
    for found in answers:
        b, k = found.b, found.k
        C2 = 0.5 * (np.sin(-2 * b) - np.sin(2 * b))  # (54)
        sign = "0" if abs(C2) < 1e-12 else "+" if C2 > 0 else "−"
        w = {0.0: ("sin θ₃/√2", "0"), np.inf: ("0", "−cos θ₃/√2")}
        w1, w2 = ("(49)", "(48)") if k is None else w[k]
        last = found.engine[max(found.engine)]
        by_engine = (
            number(found.engine_k)
            if found.settled
            else "singular"
            if not isinstance(last, rp.Design)
            else "–"
        )
        searched = number(found.search.parameter) if found.search.unique else "any value"
        k_text = "any value" if k is None else number(k)
        rows.append([in_pi(b), sign, k_text, w1, w2, searched, by_engine])
    return table(["b", "C₂", "k_opt", "w₁", "w₂", "search over (60)", "engine"], rows)


def interval_table(answers: list[Answer]) -> str:
    """Costs of many intervals, the engine's as what they exceed C(k*) by."""
    rows = []
    for found in answers:
        excess = []
        for result in found.engine.values():
            if isinstance(result, rp.Design):
                excess.append(f"{result.fit_cost / found.cost - 1:+.0e}")
            else:
                excess.append("singular")
        verdict = "settled" if found.settled else "NOT settled"
        k_text = "any" if found.k is None else number(found.k)
        k_search = number(found.search.parameter) if found.search.unique else "any"
        k_engine = number(found.engine_k) if found.settled else "–"
        interval = f"[{in_pi(found.a)}, {in_pi(found.b)}]"
        cost = [f"{found.cost:.6f}", f"{found.search.cost:.6f}"]
        rows.append([interval, k_text, k_search, k_engine, *cost, *excess, verdict])
    degrees = [f"degree {d}" for d in answers[0].engine]
    return table(
        ["θ₃ in", "k* (59)", "search", "engine", "C(k*) (52)", "search", *degrees, "engine is"],
        rows,
    )


def in_pi(angle: float) -> str:
    """Write an angle, as a share of π where it is one."""
    share = angle / PI
    for denominator in (1, 2, 4):
        whole = round(share * denominator)
        if whole and abs(share * denominator - whole) < 1e-12:
            top = {1: "π", -1: "−π"}.get(whole, f"{whole}π".replace("-", "−"))
            return top if denominator == 1 else f"{top}/{denominator}"
    return f"{angle:g}".replace("-", "−")


def number(k: float) -> str:
    """Write k: ∞ where it is."""
    return "∞" if np.isinf(k) else f"{k if abs(k) > 5e-7 else 0.0:.5f}".replace("-", "−")


# ---- the two foliations side by side ------------------------------------------------------------


Potential = Callable[[np.ndarray], np.ndarray]


def leaves(potential: Potential, starts: tuple[float, ...], count: int) -> np.ndarray:
    """Find the leaves {h(q) = h(0, 0, start)} over |d₁|, |d₂| ≤ 1: points (len(starts), count,
    count, 3).

    θ₃ is NaN where a leaf has left |θ₃| ≤ 1.
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
                "h does not rise along θ₃: this leaf is no graph over (d₁, d₂)"
            )
        points[:, i, :, :2] = Q[:, 0, :2]
        for j in range(count):
            points[:, i, j, 2] = np.interp(up * levels, up * h[j], theta, left=np.nan, right=np.nan)
    return points


def foliation_figure(task: rp.Task, design: rp.Design, count: int) -> Figure:
    """Draw leaves of the paper's k = 0 control and of a design, coloured by ‖G_r − J⁺‖."""
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
    """What the script found, for who wants to check it."""

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
        Degrees in θ₃ to ask the engine for.
    samples
        Nodes of the fits and searches.
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
        print(
            f"(60), k = {k:g}: {rp.is_repeatable(PaperInverse(task, k), here).summary()}".replace(
                "inf", "∞"
            )
        )

    print("\nTable I: optimal parameters for symmetric joint limits, −b ≤ θ₃ ≤ b\n")
    symmetric = [answer(task, -b, b, degrees, samples) for b in (1.0, PI / 2, 2.0, PI)]
    print(table_one(symmetric))
    print(
        "engine: {d₁, d₂, polynomials of θ₃}; – where its cost still falls with the degree, see below"
    )

    print(
        "\nIntervals of every kind; the engine's columns tell by what share its cost lies above C(k*)\n"
    )
    intervals = [answer(task, a, b, degrees, samples) for a, b in pairs]
    print(interval_table(intervals))
    print(
        "\nAn interval longer than π holds, under the best control of this form, the leaf θ₃ = const, where the\n"
        "potential of the form α d₁ + β d₂ + p(θ₃) has a pole: no polynomial gets there, and raising the degree\n"
        "does not settle the engine's cost at C(k*). The search over (60) has no such limit. Nor has the engine,\n"
        "once d₁ and θ₃ may be multiplied: h = exp(d₁/2) tan(θ₃/2) exp(cos(θ₃)/2) has the leaf and no pole."
    )
    half = [1.0, 1.0, 2.0]
    products = rp.Polynomial([0, 0, 0], 6, half, variables=[0, 2])
    mixed = rp.nearest_repeatable(rp.Pseudoinverse(task), products, rp.Box([0, 0, 0], half))
    print(
        f"θ₃ in [−2, 2], polynomials of (d₁, θ₃), degree 6: {mixed.cost:.6f}; C(∞) = {mean_cost(-2, 2, np.inf):.6f}"
    )

    print("\nBeyond the paper: potentials of all three joints over |d₁|, |d₂|, |θ₃| ≤ 1\n")
    cube = rp.Box([0, 0, 0], 1.0)
    all_joints = {
        degree: rp.nearest_repeatable(
            rp.Pseudoinverse(task), rp.Polynomial([0, 0, 0], degree, 1.0), cube
        )
        for degree in (1, 2, 3, 4)
    }
    rows = [["the paper's k = 0, of θ₃ alone", f"{mean_cost(-1, 1, 0.0):.5f}", "–"]]
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
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("repctl-out"),
        help="folder for the figure (default: repctl-out)",
    )
    found = main(parser.parse_args().out)  # to look into, after python -i
