"""One page that can be mailed: what a study found, its pictures, and all that is needed to repeat it."""

from __future__ import annotations

import base64
import hashlib
import html
import io
import platform
import re
import struct
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from .._version import __version__
from ..files import write_whole
from .page.snapshot import still_figure
from .plots.cycles import cycle_figure
from .plots.designs import cost_against_degree
from .plots.maps import joint_map
from .plots.motions import COLOURS, colours, drawn, drift_figure, joints_figure
from .plots.orbits import orbits_figure
from .study_files import study_page
from .text import captions
from .text.table import study_cells, study_notes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..studies import Study
    from ..studies.study_maps import StudyMaps

DISTRIBUTIONS = ("numpy", "scipy", "pin", "matplotlib", "meshcat", "example-robot-data")
"""Whose versions a report names."""

DPI = 130


def report_page(
    study: Study,
    *,
    maps: StudyMaps | None = None,
    options: Mapping[str, object] | None = None,
    command: str | None = None,
    animation: str | None = None,
) -> str:
    """Write the report of a study as one self-contained HTML page.

    Parameters
    ----------
    study
        What was found.
    maps
        Arrays of maps over two joints; None leaves those figures out.
    options
        Every option, as it was used, by name.
    command
        The command line that made it.
    animation
        The page of the animation, if it was made already.

    Returns
    -------
    The page's HTML: it asks nothing of a network, prints without cut figures, and every picture has captions.
    """
    folder = files("repctl_pin.show.page") / "assets"
    title = f"{study.robot.name}: {study.path.name}"
    header, rows, legend = study_cells(study)
    parts = {
        "TITLE": html.escape(title),
        "STYLE": (folder / "report.css").read_text("utf-8"),
        "LEAD": html.escape(f"{study.task.frame}, {study.task.kind} task, {study.path.name}"),
        "SUMMARY": "\n".join(f"<p>{html.escape(text)}</p>" for text in captions.summary(study)),
        "ANIMATION": html.escape(animation or study_page(study), quote=True),
        "ANIMATION_TITLE": html.escape(f"Animation: {title}", quote=True),
        "STILL": _picture(still_figure(study), captions.still_words(study)),
        "TABLE": _table(header, rows, [colours(study)[row.key] for row in study.rows]),
        "LEGEND": html.escape(" ".join(legend)),
        "FIGURES": "\n".join(_figures(study, maps)),
        "COMMAND": "" if command is None else f"<pre><code>{html.escape(command)}</code></pre>",
        "SETTING": _list(_setting(study)),
        "OPTIONS": "" if not options else f"<h3>Options</h3>\n{_list(_texts(options))}",
        "VERSIONS": _list(versions()),
        "GLOSSARY": _list(captions.GLOSSARY),
        "NOTES": _notes(study_notes(study)),
    }
    template = (folder / "report.html").read_text("utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], template)


def write_report(
    study: Study,
    path: Path,
    *,
    maps: StudyMaps | None = None,
    options: Mapping[str, object] | None = None,
    command: str | None = None,
    animation: str | None = None,
) -> Path:
    """Write :func:`report_page` to a file, whole or not at all."""
    page = report_page(study, maps=maps, options=options, command=command, animation=animation)
    return write_whole(path, page)


def versions() -> dict[str, str]:
    """Versions of all that a result depends on."""
    found = {"repctl_pin": __version__, "Python": platform.python_version()}
    for name in DISTRIBUTIONS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed as a package"
    return found | {"system": f"{platform.system()} {platform.machine()}"}


def _figures(study: Study, maps: StudyMaps | None) -> Iterable[str]:
    """Each figure with its heading, picture and captions."""
    moved = drawn(study)
    on = [m for m in moved if m[2] != COLOURS["posture_off"]]  # what comes from afar would hide the rest
    yield _section("Drift", drift_figure(moved, ""), captions.drift_words(study))
    yield _section("Joints", joints_figure(moved, ""), captions.joints_words(study))
    yield _section("Orbits in joint space", orbits_figure(on, ""), captions.orbits_words(study))
    yield _section("Speed and limits", cycle_figure(moved, ""), captions.cycles_words(study))
    if maps is not None:
        yield _section("The design over two joints", _maps_figure(study, maps), captions.maps_words(study, maps))


def _maps_figure(study: Study, maps: StudyMaps) -> Figure:
    from matplotlib.figure import Figure

    grid, task, (i, j) = maps.design, study.task, maps.design.joints
    figure = Figure(figsize=(10, 7.4 if len(maps.degrees) > 1 else 3.9), layout="constrained")
    rows = 2 if len(maps.degrees) > 1 else 1
    axes = list(figure.subplots(rows, 2 if rows == 2 else 3).ravel())
    mark = study.design.region.center[[i, j]]
    for values, label, low in (
        (maps.defect, "defect of J⁺ (0: repeatable)", True),
        (grid.distance / grid.reference, "‖G − J⁺‖ / ‖J⁺‖", True),
        (grid.leaf_margin, "leaf margin (0: singular)", False),
    ):
        joint_map(axes.pop(0), task, grid.joints, grid.x, grid.y, values, label=label, low_is_good=low, mark=mark)
    if axes:
        cost_against_degree(axes[0], maps.degrees, study.design.baselines).legend(frameon=False, fontsize=8.5)
    return figure


def _section(heading: str, figure: Figure, text: str) -> str:
    return f'<section class="figure">\n<h3>{html.escape(heading)}</h3>\n{_picture(figure, text)}\n</section>'


def _picture(figure: Figure, text: str) -> str:
    """A figure inside the page, with the words for it."""
    held = io.BytesIO()
    figure.savefig(held, format="png", dpi=DPI, bbox_inches="tight", pad_inches=0.05, metadata={"Software": None})
    width, height = struct.unpack(">II", held.getvalue()[16:24])  # as the PNG's header says
    data = base64.b64encode(held.getvalue()).decode("ascii")
    return (
        f'<figure><img src="data:image/png;base64,{data}" width="{width}" height="{height}" '
        f'alt="{html.escape(text, quote=True)}"><figcaption>{html.escape(text)}</figcaption></figure>'
    )


def _table(header: list[str], rows: list[list[str]], colours: list[str]) -> str:
    head = "".join(f'<th scope="col">{html.escape(cell)}</th>' for cell in header)
    body = "\n".join(
        f'<tr><th scope="row"><span class="chip" style="background: {colour}"></span>{html.escape(row[0])}</th>'
        + "".join(f"<td>{html.escape(cell)}</td>" for cell in row[1:])
        + "</tr>"
        for row, colour in zip(rows, colours, strict=True)
    )
    return f"<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>"


def _list(items: Mapping[str, str]) -> str:
    return (
        "<dl>\n"
        + "\n".join(f"<dt>{html.escape(k)}</dt><dd>{html.escape(v)}</dd>" for k, v in items.items())
        + "\n</dl>"
    )


def _notes(notes: list[str]) -> str:
    return "<ul>\n" + "\n".join(f"<li>{html.escape(n)}</li>" for n in notes) + "\n</ul>" if notes else "<p>None.</p>"


def _setting(study: Study) -> dict[str, str]:
    """What was studied, in full: numbers as they are held, and the robot file's fingerprint."""
    center, width = study.region.bounds.center, study.region.bounds.half_width
    return study.setting | {
        "start": _row(study.q0),
        "joints": ", ".join(study.task.joint_names),
        "region": f"{study.region}; the box round it has the centre {_row(center)} and the half-width {_row(width)}",
        "URDF, SHA-256": _fingerprint(study.robot.description.path),
    }


def _fingerprint(file: Path) -> str:
    """What ``sha256sum`` says of a file."""
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError:
        return "the file is not there any more"


def _row(values: Iterable[float]) -> str:
    return ", ".join(f"{v:.10g}" for v in values)


def _texts(options: Mapping[str, object]) -> dict[str, str]:
    def text(value: object) -> str:
        if isinstance(value, list | tuple):
            return ", ".join(map(str, value)) or "none"
        return (
            "chosen by the study"
            if value is None
            else "yes"
            if value is True
            else "no"
            if value is False
            else str(value)
        )

    return {name: text(value) for name, value in options.items()}
