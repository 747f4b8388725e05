"""Figure of the joints: the positions of those that drift most, over all cycles.

A figure shows several motions from one start; ``motions`` lists a label, the motion and a colour
for each.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...motion import Motion
from ...motion.joint_motion import violations_of
from ..palette import GREY, INK
from .figure_layout import arrange, legend_below, plain, quiet, titled
from .motions import BEYOND, motions_on_one_scale, stays

_SHOWN_JOINTS = 4
"""Maximum number of joints in ``joints.png``."""


def joints_figure(motions: Sequence[tuple[str, Motion, str]], title: str) -> Figure:
    """Draw the figure ``joints.png``: the positions of the joints that drift most, over all cycles.

    ``motions`` lists the label, motion and colour of each controller. A motion that moves away in
    cycle 1 and would hide the others' drift is left out.
    """
    motions = motions_on_one_scale(motions)
    n = motions[0][1].task.n
    joints = liveliest_joints(motions, _SHOWN_JOINTS)
    columns = 2 if len(joints) == _SHOWN_JOINTS else 1
    rows = len(joints) // columns
    most = f": the {len(joints)} joints of {n} that drift most" if n > len(joints) else ""
    size = (10, 1.9 * rows + 0.9) if columns == 2 else (7, 1.7 * rows + 0.9)
    heading = f"{title}{most}".removeprefix(": ")
    figure = titled(*size, heading, layout=None)
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False)
    for joint, ax in zip(joints, axes.ravel(), strict=True):
        _joint_over_cycles(ax, motions, joint)
    for ax in axes[-1]:
        ax.set_xlabel("cycle")
    arrange(figure, axes, top=0.45 if heading else 0.25, bottom=0.78, gap=0.31)
    return legend_below(figure, axes[0, 0])


def liveliest_joints(motions: Sequence[tuple[str, Motion, str]], count: int = 3) -> list[int]:
    """Find the joints that drift most at the ends of cycles; return their indices.

    At most ``count`` indices are returned, counted from 0, in increasing order. Motions that move
    away in the first cycle and then stay are ignored, unless all motions do so.
    """
    going = [motion for _, motion, _ in motions if not stays(motion.drift)]
    ends = [
        np.abs(motion.q[motion.steps :: motion.steps] - motion.q[0]).max(axis=0)
        for motion in going or [motion for _, motion, _ in motions]
    ]
    order = np.argsort(-np.max(ends, axis=0), kind="stable")[:count]
    return sorted(int(joint) for joint in order)


def _joint_over_cycles(ax: Axes, motions: Sequence[tuple[str, Motion, str]], joint: int) -> Axes:
    """Draw the position of one joint against time in cycles, with nearby limits as dashed lines.

    ``joint`` is the joint's index, from 0. A cross marks where a motion first exceeds a joint
    limit, if the limit is that of this joint.
    """
    task = motions[0][1].task
    for label, motion, colour in motions:
        ax.plot(
            motion.t / motion.t[-1] * motion.cycles,
            motion.q[:, joint],
            color=colour,
            lw=1.1,
            label=label,
        )
        for beyond in violations_of(motion):
            if beyond.names == task.joint_names[joint : joint + 1]:
                ax.plot(
                    beyond.moment, motion.q[round(beyond.moment * motion.steps), joint], **BEYOND
                )
    low, high = ax.get_ylim()
    span = high - low
    limits = task.lower[joint], task.upper[joint]
    for limit in limits:
        if low - 0.5 * span < limit < high + 0.5 * span:
            ax.axhline(limit, color=INK, lw=0.8, ls="--")
    # y=1.0 keeps matplotlib from measuring all tick labels to place a title above them
    ax.set_title(plain(task.joint_names[joint]), fontsize=9, loc="left", y=1.0)
    ends = " to ".join(f"{limit:.2f}" if np.isfinite(limit) else "∞" for limit in limits)
    words = f"limits {ends}" if np.isfinite(limits).any() else "no limits"
    ax.set_title(words.replace("-", "−"), fontsize=8, loc="right", color=GREY, y=1.0)
    ax.set_ylabel("rad" if task.revolute[joint] else "m")
    return quiet(ax, whole=True)
