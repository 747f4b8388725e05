"""Draw the figures of the theory and of the page on proofs: python docs/figures.py [FOLDER]."""

from __future__ import annotations

import io
import sys
import tempfile
from pathlib import Path
from time import thread_time

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import repctl_pin as rp
from repctl_pin.inverse_function.cell_design import slices
from repctl_pin.show.palette import BLUE, GREEN, VERMILLION
from repctl_pin.show.plots.cells import cell_figure
from repctl_pin.show.plots.cycles import orbit
from repctl_pin.show.plots.motions import drift_over_cycles


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
        (name, rp.follow(it, path, q0, cycles=10, steps=200), colour)
        for name, it, colour in controls
    ]
    figure = Figure(figsize=(9.6, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    orbit(left, [motions[0], motions[2]], 0, 1)
    drift_over_cycles(right, motions)
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
    """Draw the boxes and the time that proofs take, against the half-width of Ω and against n."""
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
    figure = Figure(figsize=(9.6, 3.8), layout="constrained")
    for left, (what, lines) in zip(figure.subplots(1, 2), curves, strict=True):
        right = left.twinx()
        for colour, (name, (x, found)) in zip((BLUE, VERMILLION), lines.items(), strict=False):
            left.plot(x, [boxes for boxes, _ in found], "o-", color=colour, label=name)
            right.plot(x, [time for _, time in found], "s:", color=colour)
        left.set(xlabel=what, ylabel="boxes (solid)", yscale="log", ylim=(0.5, 1e6), xticks=x)
        right.set(ylabel="processor time, s (dotted)", yscale="log", ylim=(0.01, 100))
        left.legend(loc="upper left")
    return figure


def proof_over(task: rp.Task, q0: np.ndarray, width: float, degree: int) -> tuple[int, float]:
    """Design over a box, and prove 80 % of the smallest leaf margin found: boxes, and time in s."""
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        rp.Polynomial(q0, degree, width),
        rp.Box(q0, width),
        options=rp.FitOptions(samples=1024, held_out=256),
    )
    begun = thread_time()
    proof = rp.prove(design, margin=0.8 * design.leaf_margin)
    assert proof, proof.summary()
    return proof.boxes, thread_time() - begun


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


FIGURES = {"drift": drift, "cell": cell, "proofs": proofs}


def main(folder: Path) -> None:
    """Draw all figures into a folder."""
    for name, figure in FIGURES.items():
        picture = io.BytesIO()
        figure().savefig(picture, dpi=110)
        Image.open(picture).convert("RGB").quantize(256).save(folder / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "figures")
