"""Page of a relabelled recording, and its figures: joints, misfit and limit margin.

The misfit is the distance of the joints from a smooth function of the pose: it is large if the
demonstrations reached equal poses with different elbows.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...base.arguments import Array
from ...show.page.html import render
from ...show.page.scene import is_planar
from ...show.page.snapshot import bones, viewed
from ...show.palette import BLUE, INK, VERMILLION
from ...show.plots.motions import axis_label, legend_below, png, quiet, titled
from ...show.report import DPI, framed, picture, versions
from ...show.text.headline import Headline
from ...show.text.lines import Span
from ...show.text.parts import redundant_part
from .relabel import Relabeled

_POINTS = 1500
_COLUMNS = 2
_BEFORE, _AFTER = "recorded", "relabelled"

_MOST_ARMS = 6
"""Maximum number of arms drawn at one pose."""

_TRIED = 200
"""Number of frames at which the arms are compared."""

_NEAR = 0.1
"""Distance of two poses in the cell's coordinates, in which the cell is ±1, that hardly counts."""


def relabel_sentence(relabeled: Relabeled) -> str:
    """Write in one sentence whether the recorded joints were ambiguous, and that they are not now.

    They were, if the ambiguity of the new joints, the misfit of a smooth function of the pose, is
    less than half of theirs.
    """
    before = relabeled.residual_before
    part = redundant_part(relabeled.recording.task)
    if np.isnan(before):
        return f"Every pose has one {part}."
    if relabeled.residual_after < 0.5 * before:
        several = "elbows" if part.startswith("elbow") else f"{part}s"
        return f"Your demonstrations used several {several} for one pose; now one."
    return f"Your demonstrations used one {part} for each pose already."


def ambiguity_words(relabeled: Relabeled) -> str:
    """Write the ambiguity of the joints before and after relabelling, as a sentence.

    It is the rms misfit of a smooth function of the pose, rad or m.
    """
    unit, after = relabeled.recording.task.unit, f"{relabeled.residual_after:.2g}"
    if np.isnan(relabeled.residual_before):
        return f"Ambiguity of the joints: {after} {unit}."
    return f"Ambiguity of the joints: {relabeled.residual_before:.2g} → {after} {unit}."


def relabel_page(relabeled: Relabeled, *, command: str | None = None) -> str:
    """Write the self-contained HTML page of a relabelled recording.

    Parameters
    ----------
    relabeled
        The recording with new configurations.
    command
        Command line that made the page.
    """
    task = relabeled.recording.task
    return render(
        "relabel.html",
        style="report.css",
        title=f"{task.robot.name}: one configuration per recorded pose",
        caption=f"{task.frame}, {task.kind} task, n = {task.n}, r = {task.r}",
        headline=Headline((Span(relabel_sentence(relabeled)),), _notes(relabeled)),
        figures=[
            *_arms(relabeled),
            ("Joints", framed(png(_labels_figure(relabeled), DPI), _LABELS)),
            ("Shares of the frames", framed(png(_shares_figure(relabeled), DPI), _SHARES)),
        ],
        terms_of=relabeled.figures(),
        glossary=_GLOSSARY,
        command=command,
        details={"joints": ", ".join(task.joint_names)} | versions(),
    )


_ARMS = (
    "The arm in several sessions, at the frames whose poses are nearest to one pose: as recorded, "
    "and relabelled."
)
_LABELS = (
    "Each joint over the frames, session after session: recorded, and relabelled. Dashed lines are "
    "joint limits. Where sessions began with different elbows, the recorded joints differ at equal "
    "poses; the leaf c, which measures the elbow, becomes one number."
)
_SHARES = (
    "Left: share of the frames at which a smooth fit of the joints over the pose, made without "
    "them, misses the joints by less. Right: share of the frames with a smaller joint-limit margin."
)
_GLOSSARY = {
    "ambiguity": "root mean square of ‖q − q̂(x)‖ on held-out frames. q̂ is a polynomial of degree 3 "
    "in the cell's coordinates of the pose, fitted with a ridge penalty to the other sessions, or "
    "to the other blocks of time of a single session. What remains for consistent joints is the "
    "error of that fit, not of the joints.",
    "limit margin": "smallest distance of a joint from its limit, at any of the frames",
    "leaf": "the set of configurations, one for each pose, with the same c: the elbow's position "
    "along the self-motion",
}


def _arms(relabeled: Relabeled) -> list[tuple[str, dict[str, object]]]:
    """Make the figure of the arms at one pose, as a list of (title, picture).

    The list is empty if there is one session only, or joints were not recorded.
    """
    figure = _arms_figure(relabeled)
    return [] if figure is None else [("Arms", picture(figure, _ARMS))]


def _notes(relabeled: Relabeled) -> tuple[Span, ...]:
    """Write the lines below the headline: ambiguity, frames relabelled or not, and margins."""
    found = relabeled.found
    lost = int((~found).sum())
    margin = float(relabeled.margins_after[found].min())
    unit = relabeled.recording.task.unit
    notes = [Span(ambiguity_words(relabeled))]
    notes.append(Span(f"{int(found.sum()):,} frames relabelled."))
    if lost:
        notes.append(Span(f"{lost:,} not relabelled.", "bad"))
    if relabeled.margins_before is not None and np.isfinite(margin):
        before = float(relabeled.margins_before[found].min())
        text = f"Limit margin {before:.2g} → {margin:.2g} {unit}."
        notes.append(Span(text, "bad" if margin < 0 else ""))
    return tuple(notes)


def _arms_figure(relabeled: Relabeled) -> Figure | None:
    """Draw the arms of several sessions at nearly one pose, before and after relabelling.

    Before, their elbows differ; after, they are one. None if the joints were not recorded, or if
    fewer than two sessions come to one pose.
    """
    rows = _at_one_pose(relabeled)
    before, task = relabeled.recording.joints, relabeled.recording.task
    if before is None or len(rows) < 2:
        return None
    arms = {_BEFORE: before[rows], _AFTER: relabeled.joints[rows]}
    lines = {name: [bones(task, q) for q in Q] for name, Q in arms.items()}
    every = np.concatenate([*lines[_BEFORE], *lines[_AFTER]])
    flat = is_planar(every)
    figure = Figure(figsize=(10.0, 4.6), layout="constrained")
    axes: list[Any] = []
    for k, (name, drawn) in enumerate(lines.items(), 1):
        ax: Any = figure.add_subplot(1, 2, k, projection=None if flat else "3d")
        colour = VERMILLION if name == _BEFORE else BLUE
        for line in drawn:
            ax.plot(*line.T[: 2 if flat else 3], color=colour, lw=2.4, marker="o", ms=4.5,
                    alpha=0.75, solid_capstyle="round")  # fmt: skip
        ax.set_title(f"{name}, {len(rows)} sessions", fontsize=10)
        axes.append(ax)
    return viewed(figure, axes, every, flat)


def _at_one_pose(relabeled: Relabeled) -> list[int]:
    """Choose a frame of each of several sessions, all at nearly one pose, far apart in the joints.

    The figure of the arms shows them, as the clearest example of an ambiguous pose. Some frames of
    the first session are tried; the one is taken whose nearest poses of the other sessions differ
    most in the joints, per distance of the poses. Returns row numbers, empty without two sessions.
    """
    recording, found = relabeled.recording, relabeled.found
    if recording.joints is None:
        return []
    cell = relabeled.design.cell
    U, _ = cell.coordinates(recording.positions, recording.rotations)
    sessions = [
        np.flatnonzero(found & (recording.session == k)) for k in range(len(recording.names))
    ]
    sessions = [frames for frames in sessions if len(frames)][:_MOST_ARMS]
    if len(sessions) < 2:
        return []
    best: list[int] = []
    most = 0.0
    some = np.linspace(0, len(sessions[0]) - 1, _TRIED).astype(int)
    for first in np.unique(sessions[0][some]):
        gaps = [np.linalg.norm(U[frames] - U[first], axis=1) for frames in sessions]
        rows = [int(at[gap.argmin()]) for at, gap in zip(sessions, gaps, strict=True)]
        spread = float(np.ptp(recording.joints[rows], axis=0).max())
        score = spread / (_NEAR + max(float(gap.min()) for gap in gaps))
        best, most = (rows, score) if score > most else (best, most)
    return best


def _labels_figure(relabeled: Relabeled) -> Figure:
    """Draw each joint over the frames, recorded and relabelled, and the level c of the leaf.

    The level says where along the self-motion the elbow is; it becomes one number. Dashed lines are
    joint limits that lie within a panel, and thin lines separate the sessions.
    """
    recording, task = relabeled.recording, relabeled.recording.task
    order = np.argsort(recording.session, kind="stable")
    order = order[np.linspace(0, len(order) - 1, min(_POINTS, len(order))).astype(int)]
    borders = np.flatnonzero(np.diff(recording.session[order])).astype(float) + 0.5
    panels = task.n + (relabeled.recorded_leaves is not None)
    rows = -(-panels // _COLUMNS)
    figure = titled(10.0, 0.8 + 1.35 * rows, "")
    axes = list(figure.subplots(rows, _COLUMNS, sharex=True, squeeze=False).ravel())
    for ax in axes[panels:]:
        ax.set_visible(False)
    before = recording.joints
    for joint, ax in zip(range(task.n), axes, strict=False):
        old = None if before is None else before[order, joint]
        _series(ax, old, relabeled.joints[order, joint], borders)
        low, high = ax.get_ylim()
        for limit in (task.lower[joint], task.upper[joint]):
            if low < limit < high:
                ax.axhline(limit, color=INK, lw=0.9, ls="--")
        ax.set_ylabel(axis_label(task, joint), fontsize=8)
    if relabeled.recorded_leaves is not None:
        new = np.where(relabeled.found, relabeled.leaf[0], np.nan)[order]
        _series(axes[panels - 1], relabeled.recorded_leaves[order, 0], new, borders)
        axes[panels - 1].set_ylabel("leaf c (elbow)", fontsize=8)
    for ax in axes[max(0, panels - _COLUMNS) : panels]:
        ax.set_xlabel("frames, by session", fontsize=9)
        ax.set_xticks([])
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside lower center", ncols=2, markerscale=5, frameon=False
    )
    return figure


def _series(ax: Axes, old: Array | None, new: Array, borders: Array) -> None:
    frames = np.arange(len(new))
    if old is not None:
        ax.plot(frames, old, ".", color=VERMILLION, ms=2, label=_BEFORE)
    ax.plot(frames, new, ".", color=BLUE, ms=2, label=_AFTER)
    for border in borders if len(borders) < 40 else []:
        ax.axvline(border, color="#bbbbbb", lw=0.6, zorder=0)
    ax.tick_params(labelsize=8)
    quiet(ax)


def _shares_figure(relabeled: Relabeled) -> Figure:
    """Draw which share of the frames has a smaller misfit, and a smaller limit margin, than x.

    The misfit is that of a smooth function of the pose, with the recorded and the new joints.
    """
    unit, found = relabeled.recording.task.unit, relabeled.found
    figure = titled(10.0, 3.4, "")
    left, right = figure.subplots(1, 2)
    misfits = [np.maximum(one, 1e-12) for one in relabeled.ambiguity.misfits]
    _shares_below(left, misfits[0] if len(misfits) > 1 else None, misfits[-1])
    left.set_xscale("log")
    left.set_xlabel(f"misfit of a smooth fit q(pose), {unit}")
    before = relabeled.margins_before
    old = None if before is None else before[found]
    _shares_below(right, old, relabeled.margins_after[found])
    right.axvline(0.0, color=INK, lw=0.9, ls="--")
    right.set_xlabel(f"joint-limit margin, {unit}")
    left.set_ylabel("share of the frames below, %")
    return legend_below(figure, left)


def _shares_below(ax: Axes, old: Array | None, new: Array) -> None:
    """Draw the share of the frames with a value below x, over x, for recorded and new values.

    ``old`` is None if no joints were recorded. Values of which one is infinite are not drawn: the
    margin of an arm without limits is.
    """
    for values, colour, label in ((old, VERMILLION, _BEFORE), (new, BLUE, _AFTER)):
        if values is not None and np.isfinite(values).all():
            share = np.linspace(0.0, 1.0, min(_POINTS, len(values)))
            below = np.quantile(values, share)
            ax.plot(below, 100 * share, color=colour, lw=2, label=label)
    quiet(ax)
