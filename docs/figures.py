"""Draw the figures of the theory page: python docs/figures.py [FOLDER]."""

from __future__ import annotations

import io
import sys
from pathlib import Path

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


FIGURES = {"drift": drift, "cell": cell}


def main(folder: Path) -> None:
    """Draw all figures into a folder."""
    for name, figure in FIGURES.items():
        picture = io.BytesIO()
        figure().savefig(picture, dpi=110)
        Image.open(picture).convert("RGB").quantize(256).save(folder / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "figures")
