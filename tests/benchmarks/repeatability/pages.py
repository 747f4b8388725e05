"""Write what was measured: every number as CSV, tables into the pages, and the figure."""

from __future__ import annotations

import csv
import os
import platform
from collections.abc import Iterable, Sequence
from dataclasses import asdict, fields, replace
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from cycles import Row
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from robots import ARMS, MORE

BLUE, GREEN, VERMILLION = "#0072B2", "#009E73", "#D55E00"
"""Okabe and Ito's colours, as in the figures of a study."""

DARKER = {GREEN: "#008762", VERMILLION: "#C35600"}
"""Colours of text, with a contrast of 4.5:1 on white."""

ROOT = Path(__file__).parents[3]
CSV = ROOT / "docs" / "benchmark.csv"
PACKAGES = ("repctl-pin", "pin", "pin-pink", "mink", "mujoco", "roboplan", "ssik", "daqp", "numpy")
PAGES = (ROOT / "docs" / "benchmark.md", ROOT / "docs" / "which.md")
COLUMNS = (
    "program",
    "drift, cycle 1",
    "cycle 10",
    "cycle 100",
    "in the last cycle",
    "extra joint speed",
    "largest step",
    "tracking error",
    "limits violated",
    "body distance",
    "time of pinv",
)


def timed(row: Row, microseconds: float, pinv: float) -> Row:
    """Add what a step takes."""
    return replace(row, microseconds=microseconds, of_pinv=microseconds / pinv)


def write(rows: Sequence[Row], out: Path | None, said: str) -> None:
    """Write everything: into the documentation, or into a folder."""
    folder = CSV.parent if out is None else out
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / CSV.name).open("w", encoding="utf-8", newline="") as file:
        file.write(f"# {said}\n")
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow([field.name for field in fields(Row)])
        lines.writerows([_short(value) for value in asdict(row).values()] for row in rows)
    rows = read(folder / CSV.name)[0]  # tables say what the file does, to its last digit
    figure(rows, folder / "benchmark.png")
    for page in PAGES:
        if out is None:
            page.write_text(filled(page.read_text(encoding="utf-8"), rows, said), encoding="utf-8")
    for name, lines in tables(rows).items():
        print("", name, "", *lines, sep="\n")
    print("", said, sep="\n")


def read(path: Path = CSV) -> tuple[list[Row], str]:
    """Read the CSV again: the rows, and the settings."""
    said, *lines = path.read_text(encoding="utf-8").splitlines()
    words = {"arm", "path", "start", "program", "failure"}
    given = csv.DictReader(lines)
    return [
        Row(**{k: v if k in words else float(v) for k, v in row.items()}) for row in given
    ], said[2:]


def settings() -> str:
    """Say when, on what and with which versions."""
    found = []
    for name in PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            found.append(f"{name} not installed")
    system = f"{platform.system()} {platform.machine()}"
    machine = f"{system}, {os.cpu_count()} cores, Python {platform.python_version()}"
    return f"{date.today().isoformat()}; {machine}; {', '.join(found)}"


def filled(text: str, rows: Sequence[Row], said: str) -> str:
    """Put the tables where a page has their marks."""
    made = tables(rows) | {"settings": [said]}
    for name, lines in made.items():
        before, mark, after = text.partition(f"<!-- benchmark: {name} -->\n")
        if mark:
            rest = after[after.index("<!-- end -->") :]
            text = "\n".join([before + mark, *lines, "", rest])
    return text


def tables(rows: Sequence[Row]) -> dict[str, list[str]]:
    """Make every table, by its name, as lines of Markdown."""
    six = [row for row in rows if row.arm in ARMS]
    plain = [row for row in six if row.lag_ms == 0]
    circle = [row for row in plain if row.start == "on" and row.path == "circle"]
    more = [row for row in rows if row.arm in MORE]
    torm = [row for row in rows if row.arm == "fetch"]
    found = {
        "lead": _lead(plain),
        "short": _short_table(plain),
        "on": _summary(row for row in plain if row.start == "on"),
        "off": _summary(row for row in plain if row.start == "off"),
        "lag": _summary(row for row in six if row.lag_ms > 0),
        "arms": _drifts(circle, "arm"),
        "times": _times(circle),
        "more": _drifts(more, "arm"),
        "more summary": _summary(more),
        "torm": _drifts(torm, "path"),
        "torm summary": _summary(torm),
        "failures": [
            f"- {row.arm}, {row.path}, {row.start}, {row.program}: {row.failure}"
            for row in rows
            if row.failure
        ],
    }
    found["failures"] = found["failures"] or ["None."]
    return found


def _summary(rows: Iterable[Row]) -> list[str]:
    """One line per program: the median over arms and paths, and below it the worst."""
    lines = []
    for name, of in _grouped(rows, "program").items():
        broken = sum(row.limit_margin < -1e-5 for row in of)
        stopped = sum(bool(row.failure) for row in of)
        cells = [
            _middle([getattr(row, key) for row in of])
            for key in ("drift_1", "drift_10", "drift_100", "last_cycle")
        ]
        speed = [row.extra_speed for row in of]
        lines.append(
            [
                _bold(name),
                *cells,
                f"{_percent(np.nanmedian(speed))}<br>{_percent(np.nanmax(speed))}",
                _middle([row.jump for row in of]),
                _middle([row.tracking for row in of]),
                f"{broken} of {len(of)}" + (f"<br>{stopped} stopped" if stopped else ""),
                _number(min(row.body_distance for row in of)),
                f"{np.nanmedian([row.of_pinv for row in of]):.2f}",
            ]
        )
    return _markdown(COLUMNS, lines)


def _lead(rows: Sequence[Row]) -> list[str]:
    """One line per program, narrow enough for a phone: the median drift after ten cycles."""
    lines = []
    for name, of in _grouped(rows, "program").items():
        starts = ([row.drift_10 for row in of if row.start == s] for s in ("on", "off"))
        lines.append([_bold(name), *map(_median, starts)])
    return _markdown(("drift, rad", "at the posture", "0.5 rad away"), lines)


def _short_table(rows: Sequence[Row]) -> list[str]:
    """One line per program: medians, started at the posture and away from it."""
    header = (
        "program",
        "drift, cycle 1",
        "cycle 10",
        "cycle 100",
        "off the posture: cycle 10",
        "off the posture: extra joint speed",
    )
    lines = []
    for name, of in _grouped(rows, "program").items():
        on, off = ([row for row in of if row.start == start] for start in ("on", "off"))
        drift = [
            _median([getattr(row, key) for row in on])
            for key in ("drift_1", "drift_10", "drift_100")
        ]
        speed = _percent(np.nanmedian([row.extra_speed for row in off]))
        jump = _median([row.jump for row in off])
        took = f"{np.nanmedian([row.of_pinv for row in of]):.2f}"
        lines.append(
            [_bold(name), *drift, _median([row.drift_10 for row in off]), speed, jump, took]
        )
    return _markdown((*header, "off the posture: largest step", "time of pinv"), lines)


def _drifts(rows: Sequence[Row], key: str) -> list[str]:
    """Drift after ten cycles: programs down, arms or paths across."""
    across = list(_grouped(rows, key))
    lines = []
    for name, of in _grouped(rows, "program").items():
        drift = {
            getattr(row, key): (row.failure and "stopped") or _number(row.drift_10) for row in of
        }
        lines.append([_bold(name), *(drift.get(one, "–") for one in across)])
    return _markdown(("program", *across), lines)


def _times(rows: Sequence[Row]) -> list[str]:
    """Microseconds per step: programs down, arms across; the pinv loop in the first line."""
    arms = list(_grouped(rows, "arm"))
    lines = []
    for name, of in _grouped(rows, "program").items():
        took = {row.arm: f"{row.microseconds:.1f} ({row.of_pinv:.2f})" for row in of}
        lines.append([_bold(name), *(took.get(arm, "–") for arm in arms)])
    return _markdown(("µs per step (of pinv)", *arms), lines)


def figure(rows: Sequence[Row], path: Path) -> None:
    """Draw drift, extra joint speed and time, one above the other so that a phone shows them.

    There is one row per program, with every arm and path.

    A small dot is one arm and path, a large one the median; hollow if started away from the
    posture."""
    rows = [row for row in rows if row.arm in ARMS and row.lag_ms == 0]
    programs = _grouped(rows, "program")
    panels = (
        ("drift after 10 cycles, rad", lambda row: max(row.drift_10, 1e-15), "log"),
        ("extra joint speed, %", lambda row: max(100 * row.extra_speed, -5), "symlog"),
        ("time per step, of the pinv loop", lambda row: row.of_pinv, "log"),
    )
    canvas = Figure(figsize=(4.8, 0.74 * len(programs) + 2.6), layout="constrained")
    for ax, (words, value, scale) in zip(canvas.subplots(3, 1), panels, strict=True):
        for k, (name, of) in enumerate(programs.items()):
            for start, offset in (("on", -0.16), ("off", 0.16)):
                found = [value(row) for row in of if row.start == start]
                found = [one for one in found if np.isfinite(one)]
                if found:
                    _row(ax, k + offset, found, _colour(name), hollow=start == "off")
        ax.set_xscale(scale, **({"linthresh": 10} if scale == "symlog" else {}))
        ax.set_title(words, fontsize=10, weight="bold", x=0, ha="left")
        ax.tick_params(labelsize=9, length=0)
        ax.grid(axis="x", color="#dddddd", lw=0.6)
        ax.spines[["top", "right", "left"]].set_visible(False)
        ax.set_yticks(range(len(programs)), programs, fontsize=9)
        ax.invert_yaxis()
        for label, name in zip(ax.get_yticklabels(), programs, strict=True):
            label.set_color(DARKER.get(_colour(name), _colour(name)))
            label.set_weight("bold" if name.startswith("repctl_pin") else "normal")
    drift, speed, time = canvas.axes
    drift.set_xticks([1e-15, 1e-10, 1e-5, 1], ["1e−15", "1e−10", "1e−5", "1"])
    speed.set_xticks([0, 10, 100], ["0", "10", "100"])
    time.set_xticks([0.01, 0.1, 1, 10], ["0.01", "0.1", "1", "10"])
    canvas.suptitle(
        "small dot: one arm and path; large dot: median\nhollow: started 0.5 rad off the posture",
        fontsize=9, x=0.01, ha="left",
    )  # fmt: skip
    canvas.savefig(path, dpi=160)


def _row(ax: Axes, y: float, values: Sequence[float], colour: str, *, hollow: bool) -> None:
    """Draw the values of one program in one row, and their median."""
    ax.plot(values, [y] * len(values), "o", ms=2.5, color=colour, alpha=0.45, mew=0)
    face = "white" if hollow else colour
    ax.plot(np.median(values), y, "o", ms=7, mfc=face, mec=colour, mew=1.6)


def _colour(name: str) -> str:
    """The colours of the product: of J⁺, J⁺ + posture, and the repeatable inverse; others grey."""
    if name.startswith("repctl_pin"):
        return BLUE
    return {"pinv loop": VERMILLION, "J⁺ + posture": GREEN}.get(name, "#767676")


def _grouped(rows: Iterable[Row], key: str) -> dict[str, list[Row]]:
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(getattr(row, key), []).append(row)
    return found


def _middle(values: Sequence[float]) -> str:
    """Median and worst."""
    if np.isnan(values).all():
        return "–"
    return f"{_number(np.nanmedian(values))}<br>{_number(np.nanmax(values))}"


def _median(values: Sequence[float]) -> str:
    return "–" if np.isnan(values).all() else _number(float(np.nanmedian(values)))


def _number(value: float) -> str:
    if not np.isfinite(value):
        return "–"
    # no line ends there
    return (f"{value:.0e}" if 0 < abs(value) < 1e-3 else f"{value:.2g}").replace("-", "−")


def _percent(share: float) -> str:
    return f"{round(100 * share, 1) + 0.0:+.1f} %".replace("-", "−").replace(" ", "\u202f")


def _short(value: object) -> object:
    return f"{value:.4g}" if isinstance(value, float) else value


def _bold(name: str) -> str:
    return f"**{name}**" if name.startswith("repctl_pin") else name


def _markdown(header: Sequence[str], lines: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(line)} |" for line in (header, ["---"] * len(header), *lines)]
