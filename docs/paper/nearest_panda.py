"""Repeat the analysis of the paper on the model of a Panda, for the pose of its tool.

The Panda has seven joints and six task coordinates: r = 1, as in the paper, but no closed form. The
script answers four questions.

1. *Is J⁺ repeatable?* (24) No: the Lie bracket is outside the column space at every sampled
   configuration. The nearest repeatable inverse over a box of ±0.4 rad is repeatable, to rounding.
2. *How large is the drift?* By the small-loop law, a loop of area A in the x–y plane gives the
   drift A Δ_xy. The arm follows squares of 0.5 to 16 cm once: the smaller the square, the better
   one evaluation of the bracket predicts the drift. The repeatable inverse does not drift.
3. *Is there a stable surface?* A self-motion moves the arm at constant tool pose. The defect of J⁺
   changes along it, but does not vanish: the self-motion crosses no stable surface.
4. *What is the cost?* The script prints the mean of ‖G_r − J⁺‖² (26) by degree of the potentials,
   and the leaf margin, both on held-out configurations.

    python docs/paper/nearest_panda.py
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import repctl_pin as rp
from repctl_pin.integrability import measure
from repctl_pin.integrability.repeatability import Repeatability
from repctl_pin.redundancy import null_vector
from repctl_pin.show.palette import BLUE, INK, VERMILLION
from repctl_pin.show.text.numbers import number
from repctl_pin.show.text.table import table

Q0 = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
"""Start configuration, rad."""
HALF_WIDTH = 0.4
"""Half-width of Ω, rad."""
SIDES = (0.005, 0.01, 0.02, 0.04, 0.08, 0.16)
"""Sides of the squares, m."""


@dataclass(frozen=True)
class Result:
    """Results of the script.

    Attributes
    ----------
    verdicts
        Repeatability of J⁺ and of the repeatable inverse.
    sides
        Sides of the squares, m.
    predicted, measured, repeatable
        Drift after one square of each side, rad: predicted by the small-loop law, measured with
        J⁺, measured with the repeatable inverse.
    angle, defect, defect_repeatable
        Distance along the self-motion, rad, and the relative defects there, per rad.
    designs
        Designs by degree.
    """

    verdicts: tuple[Repeatability, Repeatability]
    sides: np.ndarray
    predicted: np.ndarray
    measured: np.ndarray
    repeatable: np.ndarray
    angle: np.ndarray
    defect: np.ndarray
    defect_repeatable: np.ndarray
    designs: dict[int, rp.Design]


def square(task: rp.Task, side: float) -> rp.TaskPath:
    """Make a square in x–y from the tool position at q0: +x, +y, −x, −y."""
    return rp.polygon(
        task, Q0, [[side, 0, 0], [side, side, 0], [0, side, 0]], name=f"square of {side:g} m"
    )


def self_motion(task: rp.Task, length: float, step: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """Integrate the self-motion in both directions: distance (K,), rad, and configurations (K, 7).

    The null vector is the generalized cross product, which is smooth; the integrator is RK4."""

    def direction(q: np.ndarray) -> np.ndarray:
        n = null_vector(task.jacobian(q))
        return n / np.linalg.norm(n)

    sides = []
    for h in (-step, step):
        q, visited = Q0, [Q0]
        for _ in range(int(length / step)):
            k1 = direction(q)
            k2 = direction(q + h / 2 * k1)
            k3 = direction(q + h / 2 * k2)
            q = q + h / 6 * (k1 + 2 * k2 + 2 * k3 + direction(q + h * k3))
            visited.append(q)
        sides.append(np.array(visited))
    Q = np.vstack([sides[0][:0:-1], sides[1]])
    return np.arange(-(len(sides[0]) - 1), len(sides[1])) * step, Q


def slice_of(plain: rp.Pseudoinverse, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Evaluate the relative defect of J⁺ over joints 2 and 4 of Ω, with the others at q0."""
    side = np.linspace(-HALF_WIDTH, HALF_WIDTH, count)
    Q = np.tile(Q0, (count * count, 1))
    Q[:, [1, 3]] += np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    return side, measure(plain, Q).norm.reshape(count, count)


def picture(found: Result, plain: rp.Pseudoinverse, count: int) -> Figure:
    """Draw the drift against the size of the loop, the defect along the self-motion, and a map of
    the defect."""
    figure = Figure(figsize=(15, 4.6), layout="constrained")
    loops, along, area = figure.subplots(1, 3)
    law = r"$A\,\|\Delta_{xy}\|$, from one evaluation"
    loops.loglog(found.sides * 100, found.predicted, color=INK, lw=1, ls="--", label=law)
    loops.loglog(found.sides * 100, found.measured, "o", color=VERMILLION, label="J⁺, measured")
    floor = np.maximum(found.repeatable, 1e-16)
    loops.loglog(found.sides * 100, floor, "s", color=BLUE, label="nearest repeatable, measured")
    loops.set(xlabel="side of the square (cm)", ylabel="drift after one cycle (rad)")
    loops.set_title("The small-loop law", fontsize=10, loc="left")
    loops.legend(fontsize=8, frameon=False, loc="center left")
    along.semilogy(found.angle, found.defect, color=VERMILLION, label="J⁺")
    along.semilogy(
        found.angle,
        np.maximum(found.defect_repeatable, 1e-17),
        color=BLUE,
        label="nearest repeatable",
    )
    along.set(xlabel="distance along the self-motion (rad)", ylabel="relative defect (per rad)")
    along.set_title("The same tool pose, other configurations", fontsize=10, loc="left")
    along.legend(fontsize=8, frameon=False, loc="center left")
    side, norm = slice_of(plain, count)
    image = area.pcolormesh(side, side, norm, cmap="cividis", shading="gouraud", rasterized=True)
    area.plot(0, 0, "o", color="white", ms=5)
    area.annotate("q₀", (0.02, 0.02), color="white")
    area.set(xlabel="joint 2 − q₀ (rad)", ylabel="joint 4 − q₀ (rad)", aspect="equal")
    area.set_title("Relative defect of J⁺ in a slice of Ω (per rad)", fontsize=10, loc="left")
    figure.colorbar(image, ax=area, shrink=0.8)
    for ax in (loops, along):
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(True, color="#dddddd", lw=0.6)
    return figure


def main(
    out: Path, *, degrees: tuple[int, ...] = (1, 2, 3), steps: int = 200, count: int = 41
) -> Result:
    """Print the tables and write the picture.

    Parameters
    ----------
    out
        Folder of the picture.
    degrees
        Degrees of the potentials to compare; the last one is followed and evaluated.
    steps
        Integration steps per square.
    count
        Points along each side of the map.
    """
    out.mkdir(parents=True, exist_ok=True)
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    plain, box = rp.Pseudoinverse(task), rp.Box(Q0, HALF_WIDTH)
    designs = {
        d: rp.nearest_repeatable(plain, rp.Polynomial(Q0, d, HALF_WIDTH), box) for d in degrees
    }
    inverse = designs[degrees[-1]].inverse

    verdicts = rp.is_repeatable(plain, box), rp.is_repeatable(inverse, box)
    print(f"over ±{HALF_WIDTH:g} rad around q0:")
    for name, verdict in zip(("J⁺", f"degree {degrees[-1]}"), verdicts, strict=True):
        print(f"  {name:9} {verdict.summary()}")

    per_area = rp.drift_per_area(plain, Q0)[0, 1]
    sides, measured, repeatable = np.array(SIDES), [], []
    for side in SIDES:
        for strategy, drifts in ((plain, measured), (inverse, repeatable)):
            motion = rp.follow(strategy, square(task, side), Q0, cycles=1, steps=steps)
            drifts.append(motion.drift[-1])
    predicted = per_area * sides**2
    print(f"\none square in x–y from q0; predicted drift: {per_area:.4g} rad/m² times its area\n")
    rows = [
        [f"{100 * s:g} cm", f"{p:.3e}", f"{m:.3e}", f"{m / p - 1:+.1%}", number(r)]
        for s, p, m, r in zip(sides, predicted, measured, repeatable, strict=True)
    ]
    print(table(["side", "predicted", "J⁺ measured", "deviation", "nearest repeatable"], rows))

    angle, Q = self_motion(task, 0.6)
    defect, defect_repeatable = measure(plain, Q).norm, measure(inverse, Q).norm
    print(
        f"\nrelative defect along {angle[-1] - angle[0]:.3g} rad of self-motion, per rad:\n"
        f"  J⁺                  {defect.min():.3g} to {defect.max():.3g}\n"
        f"  nearest repeatable  up to {defect_repeatable.max():.0e}\n"
    )
    rows = [
        [
            f"degree {d}",
            str(x.potentials.size),
            f"{x.cost:.4f}",
            f"{x.relative_distance:.1%}",
            f"{x.leaf_margin:.3f}",
        ]
        for d, x in designs.items()
    ]
    print(
        table(["potentials", "number", "mean ‖G_r − J⁺‖²", "distance from J⁺", "leaf margin"], rows)
    )

    found = Result(
        verdicts,
        sides,
        predicted,
        np.array(measured),
        np.array(repeatable),
        angle,
        defect,
        defect_repeatable,
        designs,
    )
    file = out / "nearest_panda.png"
    picture(found, plain, count).savefig(file, dpi=150)
    print(f"\nwrote {file}")
    return found


if __name__ == "__main__":
    from output_folder import output_folder

    # for inspection after python -i
    found = main(output_folder(__doc__, "repctl-out/nearest_panda"))
