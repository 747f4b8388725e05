"""Draw the figures of the theory and of the page on proofs: python docs/figures.py [FOLDER]."""

from __future__ import annotations

import io
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from time import thread_time

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Rectangle
from PIL import Image

import repctl_pin as rp
from repctl_pin.extensions.cells.cell_design_result import slices
from repctl_pin.extensions.cells.show.cell_plots import cell_figure
from repctl_pin.show.palette import BLUE, GREEN, VERMILLION
from repctl_pin.show.plots.drift import drift_over_cycles
from repctl_pin.show.plots.orbits import orbit


def drift() -> Figure:
    """Draw two joints of a Panda over ten cycles of a circle, and the drift after each cycle."""
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    q0 = np.array(task.reference)
    desired, path = rp.Pseudoinverse(task), rp.circle(task, q0, radius=0.1, normal="x")
    box = rp.Box(q0, 0.4)
    nearest = rp.nearest_repeatable(
        desired, rp.Polynomial(q0, 2, 0.4), box, options=rp.FitOptions(samples=512, held_out=256)
    )
    controls = [
        ("J⁺", desired, VERMILLION),
        ("J⁺ + posture", rp.PostureControl(task, q0), GREEN),
        ("nearest repeatable", nearest.inverse, BLUE),
    ]
    motions = [
        (name, rp.follow(it, path, q0, cycles=10, steps=100), colour)
        for name, it, colour in controls
    ]
    figure = Figure(figsize=(9.6, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    orbit(left, [motions[0], motions[2]], 0, 1)
    drift_over_cycles(right, motions)
    return figure


def ring() -> Figure:
    """Draw a planar arm that goes around its base once and ends in another configuration.

    Its motion stays in Ω, where J_V is proved to be invertible: the circle cannot be shrunk to a
    point.
    """
    task = rp.Robot.load("planar3r").task("tool", "xy")
    box = rp.Box((0, 1.26, 0.385), (3.4, 0.55, 0.75))
    design = rp.nearest_repeatable(rp.Pseudoinverse(task), None, box, degree=3)
    assert rp.prove(design, margin=0.5)
    q0 = np.array([-3.1, 0.9, 0.9])
    x, y, _ = task.placement(q0).translation
    path = rp.circle(task, q0, radius=np.hypot(x, y), normal="z", start_angle=np.arctan2(y, x))
    motion = rp.follow(design.inverse, path, q0, cycles=1, steps=400)
    assert box.ratio(motion.q).max() < 1
    figure = Figure(figsize=(9.6, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    tool = np.array([task.placement(q).translation for q in motion.q])
    left.plot(tool[:, 0], tool[:, 1], ":", color="0.5", lw=1.2)
    for name, q, colour in ("start", q0, BLUE), ("end", motion.q[-1], VERMILLION):
        links = np.exp(1j * np.cumsum(q))  # 1 m each
        X = np.cumsum([0.0, *links])
        left.plot(X.real, X.imag, "o-", color=colour, lw=3, ms=5, label=name)
    left.set(aspect="equal", xlabel="x, m", ylabel="y, m")
    left.legend(loc="upper right")
    orbit(right, [("", motion, VERMILLION)], 1, 2)
    low, wide = box.center - box.half_width, 2 * box.half_width
    right.add_patch(Rectangle(low[1:], *wide[1:], fill=False, ls="--", ec="0.4"))
    right.annotate("Ω", low[1:] + wide[1:], (-16, -16), textcoords="offset points")
    right.margins(0.06)
    return figure


def cell() -> Figure:
    """Draw slices through the function for a cell of positions of a Panda, 20 × 40 × 20 cm."""
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    middle = task.placement(task.reference)
    middle.translation = middle.translation + np.array([0.15, 0.0, -0.19])
    box = rp.Cell(task, middle, (0.1, 0.2, 0.1))
    found = rp.nearest_inverse_function(
        rp.Pseudoinverse(task), box, degree=3, options=rp.FitOptions(samples=128, held_out=128)
    )
    return cell_figure(found, slices(found, 15))


def proofs() -> Figure:
    """Draw the boxes and the time that proofs take, against the half-width of Ω and against n.

    Seven planar joints at ±0.3 rad were not proved within 60 s."""
    panda = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    widths, joints = (0.1, 0.2, 0.3, 0.4), (3, 4, 5, 6)
    curves = [
        (
            "half-width of Ω, rad",
            {
                f"Panda, pose, degree {degree}": (
                    widths,
                    [proof_over(panda, panda.reference, width, degree) for width in widths],
                )
                for degree in (2, 3)
            },
        ),
        (
            "number of joints n",
            {
                "planar arm, xy, ±0.2 rad, degree 2": (
                    joints,
                    [proof_over(planar(n), np.full(n, 0.6), 0.2, 2) for n in joints],
                )
            },
        ),
    ]
    return growth(curves, "boxes", (0.5, 1e6))


def growth(
    panels: Sequence[tuple[str, dict[str, tuple[Sequence[float], list[tuple[float, float]]]]]],
    first: str,
    limits: tuple[float, float],
) -> Figure:
    """Draw two panels of curves (x, (value, processor time)): values solid, times dotted."""
    figure = Figure(figsize=(9.6, 3.8), layout="constrained")
    for left, (what, lines) in zip(figure.subplots(1, 2), panels, strict=True):
        right = left.twinx()
        for colour, (name, (x, found)) in zip((BLUE, VERMILLION), lines.items(), strict=False):
            left.plot(x, [value for value, _ in found], "o-", color=colour, label=name)
            right.plot(x, [time for _, time in found], "s:", color=colour)
        ticks = sorted({tick for x, _ in lines.values() for tick in x})
        left.set(xlabel=what, ylabel=f"{first} (solid)", yscale="log", ylim=limits, xticks=ticks)
        right.set(ylabel="processor time, s (dotted)", yscale="log", ylim=(0.01, 100))
        left.legend(loc="upper left")
    return figure


def closing() -> Figure:
    """Draw the proved closing radius and its time, against the half-width of Ω and against r."""
    robot = rp.Robot.load("panda")
    panda = robot.task("panda_hand_tcp", "pose")
    widths = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    kinds = {1: "pose", 2: "axis", 4: "position", 5: "xy"}
    bent = np.array([0.0, 1.0, 1.0, 1.0])
    by_width = {
        "Panda, pose, r = 1": (
            widths,
            [radius_over(panda, panda.reference, width) for width in widths],
        ),
        "planar arm, n = 4, xy, r = 2": (
            widths,
            [radius_over(planar(4), bent, width) for width in widths],
        ),
    }
    by_r = {
        "Panda, n = 7: pose, axis, position, xy": (
            list(kinds),
            [
                radius_over(robot.task("panda_hand_tcp", kind), panda.reference, 0.1)
                for kind in kinds.values()
            ],
        ),
        "planar arms, n = r + 2, xy": (
            (1, 2, 3, 4, 5),
            [radius_over(planar(n), np.full(n, 0.6), 0.1) for n in range(3, 8)],
        ),
    }
    panels = [("half-width of Ω, rad", by_width), ("r", by_r)]
    return growth(panels, "closing radius, cm", (0.5, 300))


def radius_over(task: rp.Task, q0: np.ndarray, width: float) -> tuple[float, float]:
    """Design with degree 2 over a box: the largest proved closing radius, cm, and its time in s."""
    design = designed(task, q0, width, 2)
    begun = thread_time()
    closes = rp.prove(design, margin=0.3 * design.leaf_margin).closes
    assert closes, closes.reason
    return 100 * closes.metres, thread_time() - begun


def proof_over(task: rp.Task, q0: np.ndarray, width: float, degree: int) -> tuple[int, float]:
    """Design over a box, and prove 80 % of the smallest leaf margin found: boxes, and time in s."""
    design = designed(task, q0, width, degree)
    begun = thread_time()
    proof = rp.prove(design, margin=0.8 * design.leaf_margin, closes=False)
    assert proof, proof.summary()
    return proof.boxes, thread_time() - begun


def designed(task: rp.Task, q0: np.ndarray, width: float, degree: int) -> rp.Design:
    """Design over the box of a half-width around q0."""
    return rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        rp.Polynomial(q0, degree, width),
        rp.Box(q0, width),
        options=rp.FitOptions(samples=1024, held_out=256),
    )


def planar(n: int) -> rp.Task:
    """Load a planar arm of n revolute joints and links of equal lengths, 2 m together."""
    text = '<robot name="planar"><link name="l0"/>'
    for i in range(n):
        text += (
            f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
            f'<origin xyz="{2 / n if i else 0} 0 0"/><axis xyz="0 0 1"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
            f'<link name="l{i + 1}"/>'
        )
    text += (
        f'<joint name="tip" type="fixed"><parent link="l{n}"/><child link="tool"/>'
        f'<origin xyz="{2 / n} 0 0"/></joint><link name="tool"/></robot>'
    )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "planar.urdf"
        file.write_text(text, encoding="utf-8")
        return rp.Robot.load(file).task("tool", "xy")


STATES = {
    "stopped": (0.5, 2.1, "STOPPED\nbrakes closed, or at a fault"),
    "approach": (0.5, 0.5, "APPROACH\nrp.approach(to='nearest')"),
    "run": (4.55, 0.5, "RUN\noverride 1, on the joint path"),
    "stopping": (4.55, 2.1, "STOPPING\noverride falls to 0,\nstill on the joint path"),
    "hold": (8.5, 2.1, "HOLD\nq constant, c known"),
    "back": (8.5, 0.5, "BACK UP\noverride −1, same joint path"),
}
"""States of a robot that plays a path: where they are drawn, and their words."""

CHANGES = (
    ("stopped", "approach", "measure q", 0.0),
    ("approach", "run", "on the path", 0.0),
    ("run", "stopping", "stop", -0.35),
    ("stopping", "run", "go on", -0.35),
    ("stopping", "hold", "override = 0", 0.0),
    ("hold", "run", "go on", 0.0),
    ("hold", "back", "back up", -0.25),
    ("back", "hold", "stop", -0.25),
    ("stopping", "stopped", "the robot's own stop,\nfrom any state", 0.0),
)
"""Changes of state: from, to, cause, and how much the arrow bends."""


def states() -> Figure:
    """Draw the states of a robot that stops, holds and goes on along a path."""
    figure = Figure(figsize=(9.6, 2.6), layout="constrained")
    axes = figure.subplots()
    axes.set(xlim=(-0.9, 9.9), ylim=(0.0, 2.6), aspect="equal")
    axes.axis("off")
    boxes = {}
    for name, (x, y, words) in STATES.items():
        title, _, rest = words.partition("\n")
        box = FancyBboxPatch(
            (x - 1.22, y - 0.32), 2.44, 0.64, "round,pad=0.08", fc="white", ec=BLUE
        )
        boxes[name] = axes.add_patch(box)
        lines = rest.count("\n")
        axes.text(x, y + 0.12 + 0.06 * lines, title, ha="center", va="center", weight="bold")
        axes.text(x, y - 0.1 - 0.02 * lines, rest, ha="center", va="center", fontsize=9)
    for start, end, cause, bend in CHANGES:
        (x0, y0, _), (x1, y1, _) = STATES[start], STATES[end]
        arrow = FancyArrowPatch(
            (x0, y0), (x1, y1), patchA=boxes[start], patchB=boxes[end], arrowstyle="-|>",
            mutation_scale=14, connectionstyle=f"arc3,rad={bend}", color="0.3", shrinkA=2,
            shrinkB=2,
        )  # fmt: skip
        axes.add_patch(arrow)
        across = bend / 2 * (y1 - y0), -bend / 2 * (x1 - x0)
        x, y = (x0 + x1) / 2 + across[0], (y0 + y1) / 2 + across[1]
        flat = y0 == y1
        axes.text(
            x + (0 if flat else 0.08), y + (0.06 if flat else 0), cause, fontsize=8,
            ha="center" if flat else "left", va="bottom" if flat else "center", color=VERMILLION,
            bbox={"fc": "white", "ec": "none", "pad": 1.0},
        )  # fmt: skip
    return figure


def survey() -> Figure:
    """Draw the drift of planar3r over the radius of its circle: eight studies from one start."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    start, radii = (0.3, 0.8, 0.8), np.linspace(0.05, 0.4, 8)  # rad, m
    rows = []
    for radius in radii:
        path = rp.circle(task, start, radius=radius)
        study = rp.study(rp.Problem(task, start=start, path=path), cycles=2, steps=100)
        rows.append({row.key: row.motion.drift[-1] for row in study.rows})
    figure = Figure(figsize=(9.6, 3.2), layout="constrained")
    axes = figure.subplots()
    shown = [("pseudoinverse", "J⁺", VERMILLION), ("repeatable", "nearest repeatable", BLUE)]
    for key, name, colour in shown:
        axes.plot(100 * radii, [row[key] for row in rows], "o-", color=colour, label=name)
    axes.set(xlabel="radius of the circle, cm", ylabel="drift after 2 cycles, rad")
    axes.legend(loc="upper left")
    return figure


FIGURES = {
    "drift": drift,
    "ring": ring,
    "cell": cell,
    "proofs": proofs,
    "closing": closing,
    "states": states,
    "survey": survey,
}


def main(folder: Path, names: Sequence[str] = tuple(FIGURES)) -> None:
    """Draw figures into a folder."""
    for name in names:
        picture = io.BytesIO()
        FIGURES[name]().savefig(picture, dpi=110)
        Image.open(picture).convert("RGB").quantize(256).save(folder / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "figures")
