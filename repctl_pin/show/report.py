"""Report of a study as one HTML page: verdict, figures, and all data for repeating the study.

J⁺ is the pseudoinverse, the usual controller, and Ω the region of joint space of the design.

``ReportMaps`` are the maps and curves of a design for a report: its grid over two joints, costs by
degree, baselines.
"""

from __future__ import annotations

import base64
import hashlib
import platform
import shlex
import struct
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from matplotlib.figure import Figure

from .._version import __version__
from ..design.design_map import ReportMaps
from ..motion import Motion
from ..studies.study_result import Study
from .page.html import render
from .page.snapshot import still_figure
from .palette import COLOURS, colours
from .plots.cycles import cycle_figure
from .plots.designs import cost_against_degree, joint_map, maps_that_vary
from .plots.drift import drift_figure
from .plots.figure_layout import png
from .plots.joints import joints_figure
from .plots.motions import drawn
from .plots.orbits import orbits_figure
from .study_files import study_page
from .text import captions
from .text.answer import displacement_cells
from .text.headline import names_of, study_headline
from .text.numbers import row
from .text.table import study_cells, study_legend, study_notes

_DISTRIBUTIONS = ("numpy", "scipy", "pin", "matplotlib", "meshcat", "example-robot-data")
"""Packages whose versions a report lists."""

DPI = 130


def report_page(
    study: Study,
    *,
    maps: ReportMaps | None = None,
    options: Mapping[str, object] | None = None,
    command: str | None = None,
    animation: str | None = None,
) -> str:
    """Make the report of a study as one self-contained HTML page.

    Parameters
    ----------
    study
        The study.
    maps
        Maps of the design over two joints: its distance from J⁺, its distance from a singularity,
        and where J⁺ is not repeatable; None leaves those figures out.
    options
        Every option that was used, by name.
    command
        Command line that made the study.
    animation
        HTML of the animation page, if it exists already; None to make it.

    Returns
    -------
    str
        HTML without network access; figures are not cut when it is printed, and every picture has a
        description.
    """
    title = f"{study.robot.name}: {study.path.name}"
    colour = colours(study)
    given, rest = _chosen(options or {}, command)
    return render(
        "report.html",
        style="report.css",
        title=title,
        caption=f"{study.task.frame_words}, {study.task.kind} task, {study.path.name}",
        headline=study_headline(study),
        # the page's own heading is this page's already
        animation=(animation or study_page(study)).replace("<body>", '<body class="inside">', 1),
        still=picture(still_figure(_compared(study)), captions.still_words(study)),
        strategies=[(names_of(row.label)["title"], colour[row.key]) for row in study.rows],
        measures=[*displacement_cells(study), *study_cells(study)],
        legend=study_legend(study, lambda label: names_of(label)["title"]),
        figures=list(_figures(study, maps)),
        glossary=captions.GLOSSARY,
        notes=study_notes(study),
        command=command,
        setting=study.setting | given,
        details=_in_full(study) | rest | versions(),
    )


def versions() -> dict[str, str]:
    """Collect the versions of all packages that a result depends on, as text by package name.

    A report lists them, with Python and the operating system, so that a study can be repeated.
    """
    found = {"repctl_pin": __version__, "Python": platform.python_version()}
    for name in _DISTRIBUTIONS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed as a package"
    return found | {"system": f"{platform.system()} {platform.machine()}"}


def _compared(study: Study) -> list[tuple[str, Motion, str]]:
    """List the label, motion and colour of J⁺ and of the repeatable inverse, for the still figure.

    That figure shows the arm at the start and at the end. A strategy that stopped is left out.
    """
    rows = [study.row("pseudoinverse"), study.row("repeatable")]
    return [(row.label, row.motion, COLOURS[row.key]) for row in rows if row.motion is not None]


def _figures(study: Study, maps: ReportMaps | None) -> Iterable[tuple[str, dict[str, object]]]:
    """Yield the heading of each figure of the report, and its picture, a dict.

    A picture has ``data`` (a PNG in base64), ``width`` and ``height``, pixels, and ``words``, which
    describe it for readers who cannot see it. ``maps`` are values of the design over two joints;
    None leaves their figure out.
    """
    moved = drawn(study)
    # its first motion to the posture would hide the others
    on = [m for m in moved if m[2] != COLOURS["posture_off"]]
    yield "Drift", picture(drift_figure(moved, ""), captions.drift_words(study))
    yield "Joints", picture(joints_figure(moved, ""), captions.joints_words(study))
    yield ("Orbits in joint space", picture(orbits_figure(on), captions.orbits_words(study)))
    yield ("Speed and limits", picture(cycle_figure(moved), captions.cycles_words(study)))
    if maps is not None:
        yield (
            "The design over two joints",
            picture(_maps_figure(study, maps), captions.maps_words(study, maps)),
        )


def _maps_figure(study: Study, maps: ReportMaps) -> Figure:
    """Draw the figure of a design over two joints: distance from J⁺, defect of J⁺, and leaf margin.

    The defect is 0 where J⁺ is repeatable, the leaf margin 0 where the design is singular. Maps
    that hardly vary are left out. A further panel shows the cost against the degree. ``maps`` are
    the values to draw.
    """
    grid = maps.grid
    drawn = maps_that_vary(
        (grid.distance / grid.reference, r"distance $\|G_r - J^+\| / \|J^+\|$", None),
        (maps.defect, "defect of $J^+$ (0: repeatable)", None),
        (grid.leaf_margin, "leaf margin (0: singular, 1: best)", 1.0),
    )
    panels = len(drawn) + (len(maps.degrees) > 1)
    rows = -(-panels // 2)
    figure = Figure(figsize=(10, 3.7 * rows), layout="constrained")
    axes = [figure.add_subplot(rows, 2, k + 1) for k in range(panels)]
    for values, label, top in drawn:
        joint_map(axes.pop(0), study.design, grid, values, label, top)
    if axes:
        cost_against_degree(axes[0], maps.degrees, maps.baselines).legend(
            frameon=False, fontsize=8.5
        )
    return figure


def picture(figure: Figure, text: str) -> dict[str, object]:
    """Draw a figure, cropped to its contents, for a template of a page.

    Return a dict of ``data`` (the PNG in base64), ``width`` and ``height``, pixels, and ``words``:
    the given text, which describes the figure for readers who cannot see it.
    """
    metadata = {"Software": None}
    picture = png(figure, DPI, bbox_inches="tight", pad_inches=0.05, metadata=metadata)
    return framed(picture, text)


def framed(picture: bytes, text: str) -> dict[str, object]:
    """Encode the bytes of a PNG file for a template of a page.

    The result has the keys ``data`` (base64), ``width`` and ``height`` in pixels, and ``words``,
    the given text, which describes the picture.
    """
    width, height = struct.unpack(">II", picture[16:24])  # as its header says
    return {
        "data": base64.b64encode(picture).decode("ascii"),
        "width": width,
        "height": height,
        "words": text,
    }


def _in_full(study: Study) -> dict[str, str]:
    """Collect the settings with which the study can be repeated exactly, as text by label.

    The settings are the start, and the smallest box around the design's region Ω, both to ten
    digits; the names of the joints; and the URDF's checksum.
    """
    center, width = study.region.bounds.center, study.region.bounds.half_width
    return {
        "start, in full": row(study.q0, 10),
        "joints": ", ".join(study.task.joint_names),
        "region, in full": f"the box around it has the centre {row(center, 10)} "
        f"and the half-width {row(width, 10)}",
        "URDF, SHA-256": _fingerprint(study.robot.description.path),
    }


def _fingerprint(file: Path) -> str:
    """Compute the SHA-256 checksum of a file, to tell later whether a URDF has changed.

    A sentence is returned if the file no longer exists.
    """
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError:
        return "the file no longer exists"


def _chosen(
    options: Mapping[str, object], command: str | None
) -> tuple[dict[str, str], dict[str, str]]:
    """Split the options, as text by name, into those that the command line names and the others.

    The report shows the named options at once, and the others, which have their default values, in
    the details. Without a command line, all options count as named.
    """
    said = None if command is None else {word.partition("=")[0] for word in shlex.split(command)}
    texts = {name: _text(value) for name, value in options.items()}
    given = {name: text for name, text in texts.items() if said is None or f"--{name}" in said}
    return given, {name: text for name, text in texts.items() if name not in given}


def _text(value: object) -> str:
    """Format the value of an option for a reader: ``yes`` for True, and a list with commas.

    ``None`` is written as ``chosen by the study``.
    """
    if isinstance(value, list | tuple):
        return ", ".join(map(str, value)) or "none"
    return {"None": "chosen by the study", "True": "yes", "False": "no"}.get(str(value), str(value))
