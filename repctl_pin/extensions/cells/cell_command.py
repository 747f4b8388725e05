"""``repctl cell``: design one inverse kinematic function for a cell of poses, and evaluate it.

A cell is a box of poses, or a sector: a cell in cylindrical coordinates around an axis. The
function q = F(x) gives one configuration for each of its poses. The whole table is the largest
sector that one function covers within the limits, without collisions, and within a requested extra
joint speed. A placement is an SE3: a position and a rotation in base axes. Notes are lines of text
below the printed table. Functions that take ``options`` read the parsed options of the command;
``report`` is a progress callback. n is the number of joints.

``Span`` is a piece of text with its tone, which is shown as colour. ``_Asked`` is the cell that the
options describe, the configuration in the cell's middle, and how both were chosen. ``WholeTable``
is the result of the search for the largest sector: its design, area and comparison with locked
joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import repctl_pin as rp

from ...base.errors import InputError, RepctlError, needed
from ...base.files import write_whole, written_together
from ...base.progress import Report
from ...cli.exit_codes import proof_code
from ...cli.options import Parser
from ...cli.parsed_options import (
    Options,
    integer,
    natural,
    numbers_of,
    positive,
    proved,
    require_proofs,
)
from ...cli.print_result import page_lines, print_result
from ...cli.terminal import in_percent, progress
from ...show.text.coloured_text import Span, fitted, noted, wrapped

if TYPE_CHECKING:
    from .table.whole_table import WholeTable

HELP = (
    "find one function for a whole cell, a box of poses or a sector around the base: it gives "
    "one configuration per pose"
)
EXAMPLE = """examples:
  repctl cell panda --down
  repctl cell panda --half-width 0.1,0.15,0.1 --half-angle 0.3
  repctl cell panda --half-width 0.15,0.3,0.2 --at 0.46,0,0.3
  repctl cell panda --size 0.3,0.3,0.2 --down --yaw 90
  repctl cell panda --path circle:0.1 --half-width 0.03
  repctl cell panda --sector --radius 0.17 --height 0.2 --angle all
  repctl cell my_arm.urdf --task position --half-width 0.2 --shrink
  repctl follow repctl-out/panda/cell.json --path circle:0.05 --csv motion.csv"""


_STEPS = 240
"""Steps per cycle of the sample path."""


def add_options(parser: Parser) -> None:
    """Add the options of ``repctl cell`` to its parser."""
    parser.robot()
    parser.task()
    parser.surroundings()
    add = parser.add_argument
    _add_sector(parser)
    width = (
        "half-width of the box, m: one number, or x,y,z along the axes of the base; with --path, "
        "the margin around the path"
    )
    add("--half-width", metavar="W", help=width)
    _add_size(parser)
    add(
        "--half-angle",
        default="0",
        metavar="A",
        help="rotations of up to A rad about each axis; in a sector, tilts about the tool's x "
        "and y (default 0)",
    )
    add(
        "--at",
        metavar="X,Y,Z",
        help="middle of the cell, m from the base (default: position of the frame at the start, "
        "chosen such that the cell fits)",
    )
    parser.path("closed path that the box encloses, beginning at --start: ", "")
    add(
        "--degree",
        default="auto",
        metavar="D",
        help="degree of the polynomial that describes the function, or auto: as high as worthwhile "
        "(default)",
    )
    add(
        "--limit-margin",
        type=positive,
        default=0.05,
        help="distance to keep from the joint limits where possible, rad (default 0.05)",
    )
    add(
        "--body-distance",
        type=float,
        default=0.0,
        help="distance to keep between bodies where possible, m (default 0: none)",
    )
    sigma = "singular value σ_min(J) to keep where possible (default 0: none)"
    add("--sigma-min", type=float, default=0.0, help=sigma)
    add(
        "--shrink",
        action="store_true",
        help="move sides of the cell inward until one function covers it",
    )
    add(
        "--keep",
        action="store_true",
        help="keep the function on the part of the cell that it covers",
    )
    held = "number of poses, not used by the fit, at which the function is evaluated (default 8192)"
    add("--held-out", type=integer, default=8192, help=held)
    add("--seed", type=natural, default=0, help="random seed of all poses (default 0)")
    add("--out", metavar="FOLDER", help="output folder (default repctl-out/ROBOT)")
    add(
        "--prove",
        action="store_true",
        help="prove bounds of the margins over the whole cell, for at most a minute per sector or "
        "box that is tried",
    )
    add("--json", action="store_true", help="print JSON instead of the table")
    add("--quiet", action="store_true", help="print only errors, and the JSON of --json")


def _add_size(parser: Parser) -> None:
    """Add ``--size`` and the other options of a box whose place the command searches for."""
    add = parser.add_argument
    add(
        "--size",
        metavar="X,Y,Z",
        help="edges of a box, m, in place of --half-width: the box is placed where it fits best, "
        "or nearest to --at; if it fits nowhere, the largest box of this shape",
    )
    for name, where in (("down", "down"), ("forward", "along x of the base")):
        text = f"orientation with the approach axis {where}; without --size, the largest sector"
        add(f"--{name}", action="store_true", help=text)
    add(
        "--approach",
        metavar="AXIS",
        help="approach axis of the tool's frame: x, y, z, -x, -y or -z (default: found from the "
        "last joint and the fingers)",
    )
    add("--rpy", metavar="R,P,Y", help="orientation as roll, pitch and yaw in degrees")
    add(
        "--yaw",
        type=float,
        default=0.0,
        metavar="DEG",
        help="turn of the tool about the base's z axis, degrees (default 0)",
    )
    add(
        "--heights",
        metavar="LOW,HIGH",
        help="range of heights of the largest sector, m from the base (default: all)",
    )
    add(
        "--most-extra",
        metavar="MEAN,WORST",
        help="maximum extra joint speed of the largest sector relative to J⁺, %%: on average, and "
        "at the worst pose (default 5,30)",
    )


def _add_sector(parser: Parser) -> None:
    """Add the options of a sector, a cell in cylindrical coordinates around an axis."""
    add = parser.add_argument
    add(
        "--sector",
        action="store_true",
        help="cell in cylindrical coordinates around an axis, in place of a box",
    )
    add("--radius", metavar="W", help="half-width of the radius, m (with --sector)")
    height = "half-width of the height, m (with --sector; default 0)"
    add("--height", default="0", metavar="W", help=height)
    add(
        "--angle",
        default="all",
        metavar="A",
        help="half-width of the angle around the base, rad, or all: as far as the joints go "
        "(default)",
    )
    add(
        "--spin",
        default="0",
        metavar="A",
        help="half-width of the rotation about the tool's z axis, rad, or all (default 0)",
    )
    add(
        "--axis",
        metavar="X,Y,Z,A,B,C",
        help="axis of the sector: a point, m from the base, and a direction (default: the base's "
        "z axis)",
    )


def run(options: Options) -> int:
    """Run ``repctl cell``: find the function, print its table, and write its files.

    The files are cell.json, cell.html and, unless the cell has a single coordinate, cell.png.
    Return the exit code: 3 if a proof requested by ``--prove`` was not reached, else 0.
    """
    folder = options.output_folder(Path(options.robot).stem)
    needed("matplotlib", "meshcat", by="repctl cell")
    _require_one_shape(options)
    if options.keep and options.prove:
        raise InputError(
            "--keep and --prove are mutually exclusive: only a cell that is covered can be proved"
        )
    say = progress(options.quiet)
    require_proofs(options.prove)
    # the cell: as given, or the best one
    asked = _asked(options, in_percent(say))
    design = asked.design
    if design is None:
        design = _designed(options, asked, in_percent(say))
    # the proof, and the files: all or none
    if options.prove and design.proof is None:
        design = proved(design, say)
    say("drawing")
    with written_together(folder) as staged:
        pictures, notes = _pictures(design, asked.reach, staged, options.command_line)
        notes = [*design.task.narrowed, *notes]
        made = [*pictures, rp.save(design, staged / "cell.json")]
    files = [folder / file.name for file in made]

    notes = _with_choices(notes, options, asked, design)

    said = {"start_is": asked.start_is, "notes": notes}
    listed = files if options.json else []  # the answer names them itself
    print_result(
        options, lambda: _as_dict(design) | said, lambda: _text(design, notes, files), listed
    )
    return proof_code(design.proof)


def _designed(options: Options, asked: _Asked, report: Report) -> rp.CellDesign:
    """Design the function over the cell ``asked``, with the settings that the options give.

    The remedy of a NoFunctionError names options of the command.
    """
    try:
        return rp.nearest_inverse_function(
            rp.Pseudoinverse(asked.cell.task),
            asked.cell,
            posture=asked.posture,
            degree=options.asked_degree(),
            incomplete="shrink" if options.shrink else "keep" if options.keep else "refuse",
            **options.of("limit_margin", "body_distance", "sigma_min"),
            options=rp.FitOptions(**options.of("held_out", "seed")),
            progress=report,
        )
    except rp.NoFunctionError as error:
        error.remedy = _remedy(error, asked)
        raise


def _text(design: rp.CellDesign, notes: Sequence[str], files: Sequence[Path]) -> list[Span]:
    """Write what the command prints: the headline, the tables, the notes and the files."""
    from .show.cell_page import cell_headline

    lines = ["", "", design.summary(), ""]
    if design.proof is not None:
        lines += [design.proof.summary(), ""]
    lines += [*map(noted, [*notes, _MEANING]), ""]
    lines += page_lines(files)
    said = cell_headline(design)
    sentences = [Span(f"{span.text} ", span.tone) for span in said.notes]
    return [*wrapped([*said.sentence, *sentences]), Span(fitted("\n".join(lines)))]


_MEANING = (
    "extra joint speed: joint speed of F relative to the usual control, the pseudoinverse J⁺, at "
    "the same configurations; J⁺ gives the minimum-norm joint velocity"
)


def _remedy(error: rp.NoFunctionError, asked: _Asked) -> str:
    """Write, with command-line options, the remedy for a cell that no function covers.

    ``asked`` has the cell. The remedy in ``error`` itself names arguments of the Python function.
    """
    if error.fits <= 0:
        remedy = "no smaller cell around this middle works either, so move it with --at, or choose "
        remedy += "another --start"
    else:
        size = asked.cell.scaled(error.fits).size()
        remedy = f"use --shrink to move its sides inward (around the same middle, {size} works)"
    if asked.crowded:
        remedy = f"it fits from none of the default starts; {remedy}"
    return f"{remedy}, or --keep to keep the covered part of this one" if error.partly else remedy


class _Asked(NamedTuple):
    """The cell that the options describe, and the configuration in its middle.

    Unless options place the cell, the middle of the cell is the pose of a start configuration.

    Attributes
    ----------
    cell : Cell
        The cell.
    posture : (n,) array or None
        Configuration in the middle of the cell; None if the design is to search for it.
    start_is : str
        How the start was found, such as ``as given`` or ``the reference pose``.
    crowded : bool
        True if the cell fits at none of the default starts. The start is then the one from which J⁺
        reaches the most corners of the cell.
    placed : tuple of str
        Notes on a cell whose place was searched for: the place, the cause that prevents a larger
        cell, and the approach axis of the tool.
    design : CellDesign or None
        Function over the largest sector, designed in the search for this sector; None for other
        cells.
    reach : list of (P, 2) arrays
        Closed lines around what the arm reaches, rows (radius, height) in m; only for the largest
        sector.
    """

    cell: rp.Cell
    posture: Any
    start_is: str
    crowded: bool
    placed: tuple[str, ...] = ()
    design: rp.CellDesign | None = None
    reach: Sequence[Any] = ()


def _asked(options: Options, report: Report) -> _Asked:
    """Make the cell that the options describe, with the configuration in its middle.

    The cell is a sector, or a box around the path, around the pose at the start, or at ``--at``.
    Without ``--start``, the start is the first default start at which the cell fits. With
    ``--size``, or with an orientation such as ``--down`` alone, the place of the cell is searched
    for. ``report`` is the progress callback. Options that cannot be used raise an InputError.
    """
    import numpy as np
    import pinocchio as pin

    from .place.posture_search import fitting_start

    around = options.path is not None or options.plane is not None
    at = None if options.at is None else np.array(_numbers(options.at, "--at", 3))
    if options.size is not None or options.down or options.forward or options.rpy is not None:
        return _placed(options, at, report)

    def cell_of(problem: rp.Problem) -> rp.Cell:
        """Make the cell of a problem: a box around its path if the options give a path.

        Otherwise, the cell is a sector with ``--sector``, else a box. Its middle is the pose at the
        start, moved to the position ``--at`` if this option is given.
        """
        task = problem.task
        if around:
            return rp.Cell.around(task, problem.cycle, *_sizes(options))
        middle = task.placement(problem.start)
        if at is not None:
            middle = pin.SE3(middle.rotation, at)
        if options.sector:
            return _sector(options, task, middle)
        return rp.Cell(task, middle, *_sizes(options))

    problem = options.problem() if around else options.problem(path=False)
    if options.start is None:
        problem, cell, fits = fitting_start(problem, cell_of)
        return _Asked(cell, None, problem.start_is, not fits)
    cell = cell_of(problem)
    posture = rp.solve_ik(problem.task, problem.start, cell.placement)
    return _Asked(cell, posture, problem.start_is, False)


def _with_choices(
    notes: list[str], options: Options, asked: _Asked, design: rp.CellDesign
) -> list[str]:
    """Return ``notes`` with notes on the size, the place and the start that the command chose."""
    cell = asked.cell
    kept = cell.widths > 0
    kept[list(cell.free)] = False
    before = list(asked.placed)
    if options.shrink and (design.cell.widths[kept] < cell.widths[kept]).any():
        sizes = f"no single function covers {cell.size()}; this one is for {design.cell.size()}"
        before.append(f"--shrink: {sizes}")
    if not asked.placed and options.start is None:
        notes = [*notes, f"the start is {asked.start_is}"]
    return [*before, *notes]


def _placed(options: Options, at: Any, report: Report) -> _Asked:
    """Find the best place for the box of ``--size``; without ``--size``, the largest sector.

    One function covers the result, within the joint limits and without collisions. A box that has
    no place at full size is scaled down, and the place of the largest box is taken. Among places
    for equally large boxes, the one nearest to ``at`` is preferred, a position (3,) in the base
    frame, m; None for no preference. The rotations of ``--half-angle`` are added to the box after
    the search; ``posture`` of the result is then None, and the design searches for a configuration.
    """
    import numpy as np

    # what the options limit
    more: dict[str, Any] = {}
    if options.heights is not None:
        more["heights"] = _numbers(options.heights, "--heights", 2)
    if options.most_extra is not None:
        more["most_extra"] = np.array(_numbers(options.most_extra, "--most-extra", 2)) / 100
    # the largest sector, or the best place for the box
    place = rp.best_cell(
        _oriented_task(options),
        None if options.size is None else _numbers(options.size, "--size"),
        orientation=_orientation(options),
        approach=options.approach,
        yaw=float(np.radians(options.yaw)),
        at=at,
        options=rp.FitOptions(seed=options.seed),
        progress=report,
        **more,
    )
    if place.table is not None:
        design, said = _whole_table(place.table, options.prove, report)
        notes, reach = (*said, *_approach_note(place)), place.table.outlines
        return _Asked(design.cell, None, "searched for the sector", False, notes, design, reach)
    cell = place.cell
    # a box, with rotations if they are given
    posture: Any = place.posture
    if options.half_angle != "0":
        angle = _numbers(options.half_angle, "--half-angle")
        cell, posture = rp.Cell(cell.task, cell.placement, cell.half_width, angle), None
    note = f"placed at {cell.where(np.zeros(cell.k))}, where J⁺ reaches every corner"
    if place.factor < 1:
        share = f"{100 * place.factor:.0f} % of the size that was asked for"
        note += f"; {share}, because at full size, {place.reason}"
    notes = (note, *_approach_note(place))
    return _Asked(cell, posture, "searched for the cell", False, notes)


def _orientation(options: Options) -> Any:
    """Return the orientation of the tool that the options request.

    It is a rotation matrix (3, 3) for ``--rpy``, the text ``"down"`` for ``--down``, ``"forward"``
    for ``--forward``, and None without any of these options.
    """
    import numpy as np
    import pinocchio as pin

    if options.rpy is not None:
        return pin.rpy.rpyToMatrix(*np.radians(_numbers(options.rpy, "--rpy", 3)))
    if options.down or options.forward:
        return "down" if options.down else "forward"
    return None


def _whole_table(table: WholeTable, prove: bool, report: Report) -> tuple[rp.CellDesign, list[str]]:
    """Choose the design over a whole table, and write the notes on its sector: (design, notes).

    The design is that of ``table``, the result of the search. With ``prove``, it is proved here if
    the sector's range of radius depends on the height. If this proof is not reached, the design
    over the largest sector with the same range of radius at all heights is returned instead. A
    design that is returned without a certificate is proved by the caller. ``report`` is the
    progress callback of the proof.
    """
    notes = []
    if prove and table.by_height:
        proof = rp.prove(table.design, progress=report)
        if proof:
            table = table._replace(design=replace(table.design, proof=proof))
        else:
            notes.append(
                "--prove took the largest sector with one range of radius: the one of "
                f"{table.area:.2g} m², whose range depends on the height, was not proved "
                f"({proof.reason}); omit --prove to have it"
            )
            # the locked joints were compared with the sector that was not proved
            table = table._replace(design=table.straight, locked=None, larger=None)
    text = str(table)
    # an arm that is the design itself has its figures already
    if table.locked is not None and table.locked.where != table.design.locked:
        text += f"; {table.locked}"
    if table.larger is not None:
        one, area = table.larger, table.area
        text += f"; a larger sector, {one.area:.2g} m² in place of {area:.2g}, has {one}"
    return table.design, [*notes, text]


def _approach_note(place: rp.BestCell) -> list[str]:
    """Write the note on the tool's approach axis: one text, or none if the search used no axis.

    The approach axis is the axis of the tool's frame that points at the work."""
    if place.approach is None:
        return []
    remedy = "" if place.approach.why == "as given" else " (--approach gives another)"
    return [f"the approach axis of the tool is {place.approach}{remedy}"]


def _oriented_task(options: Options) -> rp.Task:
    """Make the task of the options; without ``--task`` and ``--size``, one with an orientation.

    The latter is a pose task if the arm has more than 6 joints, else an axis task, which commands
    the position and the direction of the tool.
    """
    if options.task is not None or options.size is not None:
        return options.asked_task()
    robot = options.load_robot()
    frame = options.frame or robot.default_frame
    joints = len(robot.chain(frame))
    return robot.task(frame, "pose" if joints > 6 else "axis")


_NOT_BOTH = (
    ("--shrink", "--keep"),
    ("--size", "--half-width"),
    ("--size", "--path"),
    ("--size", "--sector"),
    ("--size", "--start"),
    ("--sector", "--half-width"),
    ("--sector", "--path"),
    ("--path", "--at"),
)
"""Pairs of options that are mutually exclusive."""

_ONLY_WITH = {"--sector": ("--radius", "--height", "--angle", "--spin", "--axis")}
"""Options that require another one, by that one."""

_ORIENTATIONS = ("--down", "--forward", "--rpy")
_OF_THE_TABLE = ("--heights", "--most-extra")
_NOT_OF_THE_TABLE = (
    *("--half-width", "--half-angle", "--sector", "--path", "--at", "--start", "--shrink"),
    *("--keep", "--degree", "--limit-margin", "--body-distance", "--sigma-min", "--held-out"),
)
"""Options of the largest sector, which is found where an orientation is given without a size; and
those that it does not take."""

_DEFAULTS = {
    "--yaw": 0.0,
    "--height": "0",
    "--angle": "all",
    "--spin": "0",
    "--half-angle": "0",
    "--degree": "auto",
    "--limit-margin": 0.05,
    "--body-distance": 0.0,
    "--sigma-min": 0.0,
    "--held-out": 8192,
}
"""Defaults of these options, unless they are None or False."""


def _require_one_shape(options: Options) -> None:
    """Raise an InputError if two options exclude each other, or none gives the cell's shape.

    One of ``--half-width``, ``--size``, ``--sector``, ``--down``, ``--forward`` and ``--rpy`` must
    be given. An option that requires another one which is missing is refused, too.
    """
    said = vars(options) | {"path": options.path or options.plane}

    def given(name: str) -> bool:
        value = said[name[2:].replace("-", "_")]
        return value not in (None, False, _DEFAULTS.get(name))

    # options that exclude or need one another
    if [given("--down"), given("--forward"), given("--rpy")].count(True) > 1:
        raise InputError("--down, --forward and --rpy are mutually exclusive")
    for one, other in _NOT_BOTH:
        if given(one) and given(other):
            raise InputError(f"{one} and {other} are mutually exclusive")
    for needed_one, names in _ONLY_WITH.items():
        for name in filter(given, names):
            if not given(needed_one):
                raise InputError(f"{name} requires {needed_one}")
    # options of the box, and of the whole table
    turned = next(filter(given, _ORIENTATIONS), "")
    if not turned and not given("--size"):
        for name in filter(given, ("--yaw", "--approach", *_OF_THE_TABLE)):
            raise InputError(f"{name} requires --down, --forward or --rpy")
    if turned and not given("--size"):
        for name in filter(given, _NOT_OF_THE_TABLE):
            raise InputError(f"{turned} with {name} requires --size")
    for name in _OF_THE_TABLE if given("--size") else ():
        if given(name):
            raise InputError(f"{name} and --size are mutually exclusive")
    # the shape itself
    if options.sector and options.radius is None:
        raise InputError("--sector requires --radius")
    if not (given("--half-width") or given("--size") or options.sector or turned):
        raise InputError(
            "the shape of the cell is missing; "
            "give --half-width, --size, --down, or --sector with --radius"
        )


def _sizes(options: Options) -> tuple[Any, Any]:
    """Parse the half-widths of a box: first those of the position, m, then of the rotation, rad.

    Each is a number for all coordinates, or a list with one number per coordinate.
    """
    return (
        _numbers(options.half_width, "--half-width"),
        _numbers(options.half_angle, "--half-angle"),
    )


def _sector(options: Options, task: rp.Task, middle: Any) -> rp.Cell:
    """Make the sector of ``--sector`` and its options; ``middle`` is the SE3 in its middle."""

    def turn(text: str, option: str) -> Any:
        return text if text == "all" else _numbers(text, option, 1)

    axis = None if options.axis is None else _numbers(options.axis, "--axis", 6)
    return rp.Sector(
        task,
        middle,
        radius=_numbers(options.radius, "--radius", 1),
        height=_numbers(options.height, "--height", 1),
        angle=turn(options.angle, "--angle"),
        half_angle=_numbers(options.half_angle, "--half-angle"),
        spin=turn(options.spin, "--spin"),
        axis=None if axis is None else [axis[:3], axis[3:]],
    )


def _numbers(text: str, option: str, size: int | None = None) -> Any:
    """Parse a number, or numbers separated by commas: a float, or a list of floats.

    The list must have ``size`` numbers, unless this is None. Any other text raises an InputError
    that names ``option``.
    """
    wrong = f"must be {size or 'one or more'} numbers separated by commas"
    numbers = numbers_of(text, option, wrong)
    if not numbers or size not in (None, len(numbers)):
        raise InputError(f"{option} {text!r} {wrong}")
    return numbers if len(numbers) > 1 else numbers[0]


def _pictures(
    design: rp.CellDesign, reach: Sequence[Any], folder: Path, command: str
) -> tuple[list[Path], list[str]]:
    """Write cell.html and, if there are slices, cell.png to a folder.

    A slice is a map of the function over two coordinates of the cell. The page also shows a motion
    along a sample path, what the arm reaches, and ``command``, the command line. ``reach`` has
    closed lines (P, 2) around what the arm reaches: radius and height, m. Return the files, and a
    list of notes: that the period of the motion was increased, or that the motion failed.
    """
    from ...show.plots.figure_layout import png
    from .cell_design_result import slices
    from .show.cell_page import cell_page
    from .show.cell_plots import cell_figure, map_pictures

    cuts = slices(design)
    motions, notes = _tour(design)
    picture, maps = b"", []
    if cuts:
        figure = cell_figure(design, cuts)
        picture = png(figure)
        maps = map_pictures(figure, picture)
    page = cell_page(design, maps, motions, notes, reach=reach, command=command)
    files = [write_whole(folder / "cell.html", page)]
    if picture:
        files.append(write_whole(folder / "cell.png", picture))
    return files, notes


def _tour(design: rp.CellDesign) -> tuple[dict[str, rp.Motion], list[str]]:
    """Follow a sample path through the cell with the desired inverse G_d, and with the function.

    Return the motions by display name, and a list of notes: on a period that was increased because
    the joint speed limits require it, or on a motion that failed. If the motion of the function
    failed, there are no motions.
    """
    from ...base.defaults import PERIOD
    from ...studies.period import choose_period
    from ...studies.quantities import LABELS
    from .cell_design_result import tour

    path, failed = tour(design.cell), {}

    def followed(label: str, control: Any, period: float, **how: Any) -> dict[str, rp.Motion]:
        """Follow the sample path with a controller; return {label: motion}, or {} if this fails.

        ``period`` is the duration of a cycle, s; ``how`` has further arguments of ``follow``. After
        a failure, ``failed[label]`` is the message.
        """
        try:
            q0 = design.function(path.placement(0.0))
            motion = rp.follow(control, path, q0, steps=_STEPS, period=period, **how)
        except RepctlError as error:
            failed[label] = f"{label} on the sample path: {error}"
            return {}
        return {label: motion}

    def both(period: float) -> dict[str, rp.Motion]:
        lock = rp.LeafLock(2)
        own = followed("One function, q = F(x)", design.inverse, period, integrator=lock)
        usual = LABELS["pseudoinverse"]
        return followed(usual, design.desired, period) | own if own else {}

    motions = both(PERIOD)
    period, notes = choose_period(PERIOD, motions)
    motions = both(period) if notes else motions
    slowed = [f"sample path: {note}" for note in notes]
    return motions, [*slowed, *failed.values()]


def _widths(cell: rp.Cell) -> dict[str, Any]:
    """Return the half-widths of a cell, m and rad, for JSON.

    The keys are ``half_width`` and ``rotation`` for a box; for a sector, ``sector`` has a
    dictionary of half-widths by coordinate.
    """
    from ...studies.study_result import picked

    if not isinstance(cell, rp.Sector):
        return picked(cell, "half_width", "rotation")
    return {"sector": dict(zip(cell.coordinate_names, cell.widths, strict=True))}


def _as_dict(design: rp.CellDesign) -> dict[str, Any]:
    """Convert the design of a cell's function to plain Python types, by the keys of ``--json``."""
    from ...studies.study_result import picked

    figures = asdict(design.evaluation)
    del figures["failures"]  # they come last
    turns = figures.pop("turns")
    return {
        **design.task.as_dict(),
        "middle": design.cell.placement.homogeneous,
        **_widths(design.cell),
        "posture": design.posture,
        **figures,
        "everywhere": design.evaluation.everywhere,
        "failures": [picked(stop, "cause", "share", "what") for stop in design.failures],
        **({"turns": turns} if turns else {}),
        "degrees": [{"degree": d, "cost": c} for d, c in design.degrees],
        **({} if design.proof is None else {"proof": _proof(design.proof)}),
    }


def _proof(proof: rp.Proof) -> dict[str, Any]:
    """Convert a certificate to plain Python types, by the names of its attributes, for JSON.

    ``extra_speed_direction`` is added: a bound, proved over the whole cell, on the extra joint
    speed relative to J⁺ in the worst direction of motion; 0.05 is 5 % more than J⁺.
    """
    price = proof.extra_speed_direction
    return asdict(proof) | {"extra_speed_direction": price}
