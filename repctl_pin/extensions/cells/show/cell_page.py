"""Page of a function over a cell: animation of a sample path, slices, and figures of merit.

The function gives one configuration for each pose of the cell, a box of poses or a sector. A slice
is a map of the function over two coordinates of the cell. A sector is a cell in cylindrical
coordinates around an axis. Its angle is that about the axis; its spin is the rotation of the tool
about its own z axis. A single joint may move the arm along the angle, another the tool along the
spin. The range of the angle or of the spin is given in rad or as ``"all"``: then it ends only at
the limits of the joint that moves the frame along it. Extra joint speed is the joint speed relative
to that of the desired inverse, such as J⁺, minus 1.

``Dialog`` is the texts of a page's dialog, by name. ``Headline`` is a sentence on the drift, and
notes on joint speed, limits and bodies. ``Span`` is a piece of text with its tone, which is shown
as colour.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise, product
from typing import Any

import numpy as np

from ....base.arguments import Array, ratio_in_percent
from ....base.certificate import below, length_below
from ....model.bodies import bodies_of
from ....motion import Motion, elbow
from ....show.page.html import Dialog, render
from ....show.page.playback import TracedChain, playback_of, playback_page
from ....show.page.snapshot import still_figure
from ....show.palette import BLUE, VERMILLION
from ....show.report import framed, picture, versions
from ....show.text.coloured_text import Span, capital
from ....show.text.headline import NEAR, Headline
from ..cell_design_result import NO_EXTRA_SPEED, CellDesign
from ..evaluate.symmetric_coordinates import Turn
from ..geometry.cell import Cell
from ..geometry.ranges import degrees_turned, gap_phrase, range_phrase, tool_direction
from ..geometry.sector import ANGLE, HEIGHT, RADIUS, Sector
from .cell_loop import cell_loop
from .cell_words import cell_uses, cell_words, reach_words, same_joints, shape_word, usual

_ROUND = [0, 1, 3, 2, 0, 4, 5, 1, 5, 7, 3, 7, 6, 2, 6, 4]
"""Corners of a box, counted in binary, in an order that traces every edge."""

_OF_THE_TOUR = "A sample path through the {0}; the values above are for the whole {0}."
_STILL = "The arm at the start of the sample path, in grey, and at its end, in colour."

_HALF_SIDE = 17
"""Number of heights of the surface of a sector whose range of radius depends on the height."""

_ARC, _SIDE = 31, 17
"""Numbers of points along each arc of a sector, and along each side of its last face, which is bent
if the range of the radius depends on the height."""


def _box_of(cell: Cell) -> Array:
    """Return points (P, 3), m, of a line along all edges of a cell's box of positions.

    The line encloses a rectangle or a segment if some positions are fixed.
    """
    if isinstance(cell, Sector):
        return _edges(cell)
    corners = np.array(list(product((-1.0, 1.0), repeat=3)))[_ROUND]
    offsets = np.zeros_like(corners)
    rows = cell.task.rows[: len(cell.half_width)]
    offsets[:, rows] = cell.half_width * corners[:, rows]
    return cell.placement.translation + offsets


def _cover_of(design: CellDesign, reach: Sequence[Array]) -> dict[str, Any]:
    """Describe the surface around a cell's positions, for the page's script.

    The keys ``inner`` and ``outer`` are two lines of points (x, y, z), m, in the base frame: the
    inner and the outer side of a section through the cell. In a box, the page shifts the section by
    ``shift``, m. In a sector, the page turns the section around the sector's axis, a point
    ``origin`` and a direction ``axis``, from the angle ``from`` to the angle ``to``, rad. ``turns``
    has the full widths of the ranges of the sector's angle, tilts and spin by name, degrees; it is
    empty for a box.

    The argument ``reach`` has closed lines (P, 2) of radius and height, m, which the page draws
    around all that the arm reaches; for a box, they are not used. The key ``reach`` has each line
    as a list of numbers in mm, radius and height alternately. The key ``around`` is the range, rad,
    of the joint that turns the arm, at most a full turn. The page draws the reach over this range,
    one half to either side of the middle of the sector.
    """
    cell = design.cell
    if isinstance(cell, Sector):
        sides, motion = _turned(cell)
        motion["turns"] = degrees_turned(cell, _reaches(design))
        if reach:
            motion["reach"] = [np.rint(1e3 * line).astype(int).tolist() for line in reach]
            motion["around"] = min(_joint_range(design), 2 * np.pi)
    else:
        sides, motion = _shifted(cell)
    inner, outer = (np.round(side, 4).tolist() for side in sides)
    return {"inner": inner, "outer": outer} | motion


def _turned(cell: Sector) -> tuple[list[Array], dict[str, Any]]:
    """Return both sides of a sector's section, (P, 3) each, m, and, by key, its axis and angles."""
    heights = np.linspace(-1.0, 1.0, _HALF_SIDE if cell.profile.degree else 2)
    sides = []
    for radius in (-1.0, 1.0):
        Y = np.zeros((len(heights), 6))
        Y[:, RADIUS], Y[:, HEIGHT] = radius, heights
        sides.append(cell.placements(Y[:, cell.moved])[0])
    origin, axis = cell.axis
    half = float(cell.widths[ANGLE])
    return sides, {"origin": _plain(origin), "axis": _plain(axis), "from": -half, "to": half}


def _shifted(cell: Cell) -> tuple[list[Array], dict[str, Any]]:
    """Return both sides of a box's section, (2, 3) each, m, and, by key, its displacement."""
    across = np.zeros((3, 3))
    rows = cell.task.rows[: len(cell.half_width)]
    across[rows, rows] = cell.half_width
    x, y, z = across
    corner = cell.placement.translation - x - y - z
    side = np.array([corner, corner + 2 * z])
    return [side, side + 2 * x], {"shift": _plain(2 * y), "turns": {}}


def _joint_range(design: CellDesign) -> float:
    """Return the range, rad, of the joint that turns the arm along the angle of a sector."""
    turns = design.evaluation.turns
    return next((one.joint_range for one in turns if one.coordinate == "angle"), np.inf)


def _plain(vector: Array) -> list[float]:
    return np.round(vector, 6).tolist()


def _edges(sector: Sector) -> Array:
    """Return points (P, 3), m, of a line along the edges of a sector's range of positions."""
    there = np.linspace(-1.0, 1.0, _ARC)
    arc, corners = ([*there, *there[::-1]], [(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)])
    traced = [(*corner, angle) for corner in corners for angle in arc]
    traced += [(*corners[0], angle) for angle in there]
    points = _SIDE if sector.profile.degree else 2
    for first, last in pairwise(corners):
        traced += [(*point, 1.0) for point in np.linspace(first, last, points)]
    if sector.profile.degree:  # the bent sides at half the height, too
        traced += [(-1, height, 1.0) for height in np.linspace(-1, 0, _SIDE)]
        traced += [(-1, 0, angle) for angle in there[::-1]]
        traced += [(1, 0, angle) for angle in there]
    Y = np.zeros((len(traced), 6))
    Y[:, [RADIUS, HEIGHT, ANGLE]] = traced
    return sector.placements(Y[:, sector.moved])[0]


def cell_page(
    design: CellDesign,
    maps: Sequence[tuple[bytes, str, str]],
    motions: Mapping[str, Motion],
    notes: Sequence[str] = (),
    *,
    reach: Sequence[Array] = (),
    command: str | None = None,
) -> str:
    """Write the self-contained HTML page of a function over a cell.

    Parameters
    ----------
    design
        The function and its figures of merit.
    maps
        Maps of slices. Each is a tuple: the bytes of a PNG file, a CSS polygon around the text in
        the picture, and a description.
    motions
        Motions along a sample path through the cell, by controller: the desired inverse, unless it
        failed, and the function.
    notes
        Notes on these motions.
    reach
        Closed lines (P, 2) around what the arm reaches: radius and height, m.
    command
        Command line that made the page; by default none is shown.
    """
    task, joint = design.task, elbow(design.task, design.posture)
    shape, words = shape_word(design), cell_words(design, motions)
    dialog = Dialog(cell_uses(design), words | reach_words() if reach else words)
    animation, still = "", None
    if motions:
        cycles = next(iter(motions.values())).cycles
        shown = _coloured(motions)
        name = f"{cycles} cycles of a sample path"
        animation = _tour_page(design, shown, joint, name, dialog, reach)
        still = picture(still_figure(shown), _STILL)
    legend = [_OF_THE_TOUR.format(shape), *(f"{capital(note)}." for note in notes)]
    return render(
        "cell.html",
        style="report.css",
        title=f"{task.robot.name}: one function for a {shape} of its workspace",
        caption=f"{task.frame_words}: {task.kind.words}, {task.n} joints, {task.r} redundant",
        headline=cell_headline(design, motions),
        brief=_brief(design, motions),
        shape=shape,
        animation=animation.replace("<body>", '<body class="inside">', 1),
        still=still,
        tour=" ".join(legend),
        maps=[framed(cut, words) | {"around": around} for cut, around, words in maps],
        slices=_slice_words(design),
        figures=design.figures(),
        dialog=dialog,
        command=command,
        details={"joints": ", ".join(task.joint_names), "seed": str(design.seed)} | versions(),
    )


def _slice_words(design: CellDesign) -> str:
    """Write the caption of the slices, maps of the function over pairs of coordinates."""
    words = (
        f"Slices through the middle of the {shape_word(design)} (+). First: the smallest "
        f"joint-limit margin. Second: joint speed relative to the {usual(design)} control at the "
        "same configurations."
    )
    if isinstance(design.cell, Sector) and design.cell.profile.degree:
        words += " The radius in the first line is the range at the height of the +."
    if isinstance(design.cell, Sector) and design.evaluation.turns and design.cell.tilted:
        words += " Third: range of the angle that is inside the joint's limits at every tilt."
    return words


def _coloured(motions: Mapping[str, Motion]) -> list[tuple[str, Motion, str]]:
    """Return (display name, motion, colour) of each controller; the last is the function's."""
    colours = [VERMILLION, BLUE][-len(motions) :]
    return [(*one, colour) for one, colour in zip(motions.items(), colours, strict=True)]


def _tour_page(
    design: CellDesign,
    motions: Sequence[tuple[str, Motion, str]],
    joint: int,
    name: str,
    dialog: Dialog,
    reach: Sequence[Array],
) -> str:
    """Write the page with the animated motions side by side, and the outline of the cell.

    ``motions`` are (display name of the controller, motion, colour). ``joint`` is the index of the
    joint whose path is drawn, and ``name`` is the name of the path on the page. ``dialog`` has the
    texts of the page's dialog. ``reach`` has closed lines (P, 2) of radius and height, m, around
    all that the arm reaches. Return the page's HTML.
    """
    tracks = [playback_of(*one) for one in motions]
    way = motions[0][1].path.points()
    return playback_page(
        [TracedChain(design.task, joint)],
        tracks,
        paths=[_box_of(design.cell), way],
        name=name,
        dialog=dialog,
        own=cell_loop(design, {label: motion for label, motion, _ in motions}),
        cover=_cover_of(design, reach),
    )


def cell_headline(design: CellDesign, motions: Mapping[str, Motion] | None = None) -> Headline:
    """Write the headline: what the function covers, with notes on joint speed, limits and bodies.

    Parameters
    ----------
    design
        The function and its figures of merit.
    motions
        Motions along a sample path, by controller; the last one is the function's. By default none.
    """
    path = list((motions or {}).values())[-1:]
    said = [*_gap(design), _cost(design), _limits(design, path), *_bodies(design, path)]
    for motion in path:
        if over := motion.worst_overspeed:
            times = f"{over[2]:.2g} times the speed limit"
            said.append(Span(f"On the sample path, {times}.", "bad"))
    said.append(_evidence(design))
    return Headline((_unbroken(Span(_covered(design))),), tuple(map(_unbroken, said)))


def _brief(design: CellDesign, motions: Mapping[str, Motion]) -> list[Span]:
    """Write the notes of the headline in short, for a first screen with little space.

    Notes on violations are left out, because the first screen shows them in any case.
    """
    path = list(motions.values())[-1:]
    proved = "Function proved, distances tested." if design.proof else "Tested, not proved."
    shares = design.extra_speed, design.extra_speed_worst
    mean, worst = (_signed(max(share, 0.0), 2) for share in shares)
    small = max(shares) < NO_EXTRA_SPEED
    speed = f"Joint speed above {usual(design)}: {mean}, at worst {worst}."
    cost = _cost(design).text if small else speed
    bodies = [note for note in _bodies(design, path, "{}: {}.") if note.tone != "bad"]
    return [_unbroken(note) for note in (Span(cost), *bodies, Span(proved))]


def _covered(design: CellDesign) -> str:
    """Write which poses the function covers and, if not all, what prevents the others.

    This is the first sentence of the page.
    """
    found = design.evaluation
    ranges = range_phrase(design.cell, _reaches(design), tool=_tool(design))
    if found.everywhere:
        return f"{same_joints(design)}, however the hand gets there: {ranges}. "
    causes = [stop for stop in design.failures if stop.cause != "collision"]
    most = max(causes, key=lambda stop: stop.share, default=None)
    why = "" if most is None else f": {most.what}"
    shape = shape_word(design)
    return f"One function covers {found.covered}{why}. The {shape} asked for: {ranges}. "


def _tool(design: CellDesign) -> str | None:
    """Return the direction of the tool if it is ``down`` or ``up`` in the whole cell, else None."""
    return tool_direction(design.cell) if isinstance(design.cell, Sector) else None


def _gap(design: CellDesign) -> list[Span]:
    """Write what a covered sector leaves out around its axis; empty if it leaves out nothing."""
    if not (isinstance(design.cell, Sector) and design.evaluation.everywhere):
        return []
    gap = gap_phrase(design.cell, _reaches(design))
    return [Span(f"Not covered: {gap}.")] if gap else []


def _reaches(design: CellDesign) -> dict[str, float]:
    """Return the full width, rad, of the ranges of angle and spin inside joint limits, by name."""
    return {turn.coordinate: turn.reach for turn in design.evaluation.turns}


def _cost(design: CellDesign) -> Span:
    """Write the extra joint speed, on average and at the worst pose of the cell.

    Both are relative to the desired inverse, by default J⁺, and are rms values over all directions
    of motion. The text then gives the extra joint speed in the worst single direction.
    """
    every = design.extra_speed, design.extra_speed_worst
    if max(every) < NO_EXTRA_SPEED:
        return Span(f"Joint speed as under the {usual(design)} control.")
    mean, worst = (_signed(share, 2) for share in every)
    said = f"Joint speed of all poses above that of the {usual(design)} control: "
    said += f"{mean} on average, at worst {worst}"
    if design.extra_speed_direction > design.extra_speed_worst:
        more = _signed(design.extra_speed_direction)
        said += f", up to {more} in a single direction of motion"
    return Span(f"{said}.")


def _signed(share: float, digits: int = 3) -> str:
    """Format an extra joint speed with its sign: ``+4.7 %``, ``−0.2 %``, ``under 0.001 %``."""
    sign = "+" if share >= 1e-5 else ""
    return sign + ratio_in_percent(share, digits).replace("-", "−")


def _evidence(design: CellDesign) -> Span:
    """Write whether the function is proved, or at how many poses it was tested."""
    if not design.proof:
        return Span(f"Tested at {design.held_out:,} poses, not proved.")
    limits, without = "", design.proof.excepted
    if design.proof.limit_margin > 0:
        limits = " and its joint limits"
        limits += f", without those of {' and '.join(without)}," if without else ""
    return Span(f"The function{limits} proved at every pose, body distances tested.")


def _limits(design: CellDesign, path: Sequence[Motion]) -> Span:
    """Write the smallest known distance from the joint limits, and which joints do not count.

    ``path`` is empty, or has the motion along the sample path, whose distances then count too. If
    the angle or spin of a sector has the range ``"all"`` and ends at the limits of a joint, this
    joint does not count, because its distance from the limits is 0 there. A joint that makes a full
    turn within its limits counts.
    """
    found, unit = design.evaluation, design.task._joint_unit
    margins = [float(motion.limit_margin.min()) for motion in path]
    if min(margins, default=0.0) < 0:
        by = f"by {-min(margins):.2g} {unit} on the sample path"
        return Span(f"Joint limits exceeded {by}.", "bad")
    turns = _whole_turns(design)
    counted = [turn.left for turn in turns if turn.left]
    least = min(found.limit_margin, found.limit_margin_worst, *counted)
    if least < 0:
        by = f"by {-least:.2g} {unit} at the worst pose"
        return Span(f"Joint limits exceeded {by}.", "bad")
    asked = design.requested_limit_margin
    short = f" (requested {asked:g})" if least < asked else ""
    finite = np.isfinite(least)
    kept = f"kept by {below(least, 2)} {unit} or more{short}" if finite else "kept"
    ends = [turn.joint for turn in turns if not turn.left]
    use = "use their whole ranges" if len(ends) > 1 else "uses its whole range"
    if not (np.isfinite(least) or ends):
        return Span("The joints have no limits.")
    if not ends:
        return Span(f"Joint limits {kept}.")
    others = f"; the limits of all other joints are {kept}" if finite else ""
    return Span(f"{' and '.join(ends)} {use}{others}.")


def _whole_turns(design: CellDesign) -> list[Turn]:
    """List the angle and spin of a sector that have the range ``"all"`` and a joint with limits."""
    free = [design.cell.coordinate_names[i] for i in design.cell.free]
    turns = design.evaluation.turns
    return [turn for turn in turns if turn.coordinate in free and np.isfinite(turn.joint_range)]


def _bodies(
    design: CellDesign, path: Sequence[Motion], near: str = "{} come as near as {}."
) -> list[Span]:
    """Write the smallest known distance between bodies, or that there are none.

    ``path`` is empty, or has the motion along the sample path, whose distances then count too.
    ``near`` is the sentence on bodies that come near, with places for their names and for the
    distance.
    """
    unchecked = bodies_of(design.task).not_checked
    more = [Span(f"Collisions not checked: {unchecked}.", "near")] if unchecked else []
    found = [(design.body_distance, design.evaluation.nearest_bodies)]
    found += [(motion.clearance.distance, motion.clearance.links) for motion in path]
    least, links = min(found, key=lambda one: one[0])
    if not np.isfinite(least):
        return more or [Span("No collision bodies: collisions are not checked.")]
    named = " and ".join(links)
    if least < 0:
        return [Span(f"{named} collide.", "bad"), *more]
    if least < NEAR:
        return [Span(near.format(named, length_below(least)), "near"), *more]
    return [Span(f"Links are at least {length_below(least)} apart at the tested poses."), *more]


def _unbroken(span: Span) -> Span:
    """Keep numbers and their units on one line, by no-break spaces in the text of a span."""
    text = re.sub(r"(\d) (%|rad\b|m\b|cm\b|mm\b|s\b)", "\\1\u00a0\\2", span.text)
    return span._replace(text=text)
