"""Page of a function over a cell: animation of a sample path, slices, and figures of merit."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import product

import numpy as np

from ..arguments import Array, ratio_in_percent
from ..inverse_function import Cell, CellDesign, Sector
from ..inverse_function.sector import ANGLE, HEIGHT, RADIUS
from ..motion import Motion, elbow
from .page.html import render
from .page.playback import TracedChain, playback_of, playback_page
from .palette import BLUE, VERMILLION
from .report import framed, versions
from .text.headline import Headline
from .text.lines import Span
from .text.numbers import metres

_ROUND = [0, 1, 3, 2, 0, 4, 5, 1, 5, 7, 3, 7, 6, 2, 6, 4]
"""Corners of a box, counted in binary, in an order that traces every edge."""

_OF_THE_TOUR = (
    "One sample path; the values above are the worst known in the whole cell."
)

_ARC = 49
"""Number of points along each arc of a sector."""


def box_of(cell: Cell) -> Array:
    """Trace the edges of a cell's range of positions: points (P, 3), m.

    It is a rectangle or a line if some positions are fixed.
    """
    if isinstance(cell, Sector):
        return _edges(cell)
    positions = len(cell.half_width)
    low_high = np.zeros((3, 2))
    low_high[cell.task.rows[:positions]] = cell.half_width[:, None] * [-1, 1]
    corners = np.array(list(product(*low_high))) + cell.placement.translation
    return corners[_ROUND]


def _edges(sector: Sector) -> Array:
    """Trace the arcs and edges of a sector's range of positions: points (P, 3), m."""
    there = np.linspace(-1.0, 1.0, _ARC)
    arc, corners = (
        np.concatenate([there, there[::-1]]),
        [(-1, -1), (1, -1), (1, 1), (-1, 1)],
    )
    traced = [(*corner, angle) for corner in [*corners, corners[0]] for angle in arc]
    traced += [(*corners[0], angle) for angle in there]
    traced += [(*corner, 1.0) for corner in [*corners, corners[0]]]
    Y = np.zeros((len(traced), 6))
    Y[:, [RADIUS, HEIGHT, ANGLE]] = traced
    return sector.placements(Y[:, sector.moved])[0]


def cell_page(
    design: CellDesign,
    slices: bytes | None,
    motions: Mapping[str, Motion],
    *,
    command: str | None = None,
) -> str:
    """Write the self-contained HTML page of a function over a cell.

    Parameters
    ----------
    design
        The function and its figures of merit.
    slices
        PNG file of the figure of slices; None leaves the figure out.
    motions
        Motions along a sample path through the cell, by controller: the desired one, if there is
        one, and the function.
    command
        Command line that made the page.
    """
    task, joint = design.task, elbow(design.task, design.posture)
    words = (
        "Slices through the centre of the cell (+). First: the smallest joint-limit margin. "
        "Second: joint speed relative to the desired controller at the same configurations."
    )
    if isinstance(design.cell, Sector) and design.evaluation.turns:
        words += " Third: range of the angle that is inside the joint's limits at every tilt."
    animation = ""
    if motions:
        cycles = next(iter(motions.values())).cycles
        animation = _tour_page(
            design, motions, joint, f"{cycles} cycles of a sample path"
        )
    return render(
        "cell.html",
        style="report.css",
        title=f"{task.robot.name}: one function for a cell",
        caption=f"{task.frame}, {task.kind} task, n = {task.n}, r = {task.r}: {design.cell.size()}",
        headline=Headline((Span(_sentence(design, motions)),), ()),
        animation=animation.replace("<body>", '<body class="inside">', 1),
        tour=_OF_THE_TOUR,
        slices=None if slices is None else framed(slices, words),
        figures=_figures(design, motions),
        command=command,
        details={"joints": ", ".join(task.joint_names), "seed": str(design.seed)}
        | versions(),
    )


def _tour_page(
    design: CellDesign, motions: Mapping[str, Motion], joint: int, name: str
) -> str:
    """Write the animation page of the motions side by side, with the outline of the cell."""
    colours = [VERMILLION, BLUE][-len(motions) :]
    tracks = [
        playback_of(label, motions[label], colour)
        for label, colour in zip(motions, colours, strict=True)
    ]
    way = next(iter(motions.values())).path.points()
    return playback_page(
        [TracedChain(design.task, joint)],
        tracks,
        paths=[box_of(design.cell), way],
        name=name,
    )


def _worst(
    design: CellDesign, motions: Mapping[str, Motion]
) -> tuple[float, float, float]:
    """Find the worst known limit margin, body distance and extra joint speed of a function.

    They are taken from the held-out poses, from searches over the cell, and from the sample path.
    """
    path = list(motions.values())[-1:]  # the function's
    margins = [float(motion.limit_margin.min()) for motion in path]
    distances = [float(motion.coarse.body_distance.min()) for motion in path]
    direction = design.evaluation.extra_speed_direction  # NaN in older files
    return (
        min([design.limit_margin, design.limit_margin_worst, *margins]),
        min([design.body_distance, *distances]),
        float(np.nanmax([design.evaluation.extra_speed_worst, direction])),
    )


def _figures(design: CellDesign, motions: Mapping[str, Motion]) -> dict[str, str]:
    """Return the figures of merit as text, by name; the worst known values come first."""
    margin, distance, speed = _worst(design, motions)
    unit, worst = design.task.unit, []
    if np.isfinite(margin):
        worst.append(f"limit margin {margin:.2g} {unit}")
    if np.isfinite(distance):
        worst.append(
            f"body distance {metres(distance) if distance >= 0 else 'below 0'}"
        )
    sign = "+" if speed >= 0 else ""
    worst.append(f"joint speed {sign}{ratio_in_percent(speed, 2)}")
    return {"worst known": ", ".join(worst)} | design.figures()


def _sentence(design: CellDesign, motions: Mapping[str, Motion]) -> str:
    """Write a sentence that sums up a function.

    It gives the extra joint speed, the coverage, and the worst known limit margin and body
    distance.
    """
    margin, distance, speed = _worst(design, motions)
    every = "every pose" if design.evaluation.everywhere else "each covered pose"
    mean = f"{ratio_in_percent(design.extra_speed, 2)} more joint speed on average"
    parts = [
        f"{mean}, at most {ratio_in_percent(speed, 2)}",
        f"{design.evaluation.covered} covered",
        "no joint limits"
        if not np.isfinite(margin)
        else f"limits {'kept' if margin >= 0 else 'exceeded'} by {abs(margin):.2g} "
        f"{design.task.unit} at the worst pose",
    ]
    if np.isfinite(distance):
        parts.append(
            "bodies collide"
            if distance < 0
            else f"bodies {metres(distance)} apart or more"
        )
    unbroken = re.sub(r"(\d) (%|rad\b|m\b|cm\b|mm\b)", "\\1\u00a0\\2", ", ".join(parts))
    return f"One configuration for {every}: {unbroken}."
