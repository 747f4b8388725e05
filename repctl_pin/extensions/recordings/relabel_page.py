"""Page of a relabelled recording: joints before and after, and figures of merit."""

from __future__ import annotations

import numpy as np

from ...show.page.html import render
from ...show.plots.motions import png
from ...show.report import DPI, framed, picture, versions
from ...show.text.headline import Headline
from ...show.text.lines import Span
from ...show.text.parts import redundant_part
from .relabel import Relabeled
from .relabel_plots import arms_figure, labels_figure, shares_figure


def relabel_sentence(relabeled: Relabeled) -> str:
    """Write in one sentence whether the recorded joints were ambiguous, and that they are not now.

    They were if the new joints have less than half their ambiguity.
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
    """Write the ambiguity of the joints before and after."""
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
            ("Joints", framed(png(labels_figure(relabeled), DPI), _LABELS)),
            (
                "Shares of the frames",
                framed(png(shares_figure(relabeled), DPI), _SHARES),
            ),
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
    """Make the figure of the arms at one pose; empty with one session, or without joints."""
    figure = arms_figure(relabeled)
    return [] if figure is None else [("Arms", picture(figure, _ARMS))]


def _notes(relabeled: Relabeled) -> tuple[Span, ...]:
    """Write the number of frames that were relabelled and that were not, and the limit margins."""
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
