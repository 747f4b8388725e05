"""Relabelling of recorded frames: one configuration per pose, on one leaf of a cell's function.

A cell is a box of poses, or a sector around the base, over which a function q = F(x; c) gives the
joints. The level c selects the leaf, the set of configurations F(x; c), and so the position of the
elbow along the self-motion. The limit margin is the smallest distance of a joint from its limits. A
frame is one row of a recording. A session is one run of the recorder, such as a demonstration.
Letters: K frames, n joints, r components of c.

``DataSet`` is the demonstrations of a data set as one table, with the names of its special columns.
``Columns`` are the columns of a relabelled recording: new numbers, removed and recomputed columns.
``_Gap`` is a range of consecutive frames of one session that could not be relabelled, and the
reason.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base import progress as reporting
from ...base.arguments import Array, file_name, progress_option, read_only, require_type, vector
from ...base.data_tables import write_table
from ...base.errors import InputError
from ...base.fit_options import FitOptions, fit_options
from ...base.threads import one_blas_thread
from ..cells.cell_design_result import CellDesign
from ..cells.function import InverseFunction
from ..cells.targets import homogeneous
from .ambiguity import Ambiguity, ambiguity
from .choose_cell import design_for
from .data_sets.data_set import DataSet
from .recording import Recording, in_blocks, thinned
from .relabeled_columns import Columns, plain_columns, relabeled_columns

_HELD_OUT = 1024
_FRAMES = 2**13
"""Maximum number of frames at which a leaf is tried."""

_MARGIN = 0.05
"""Joint-limit margin, rad or m, that a leaf must keep if the leaf c = 0 keeps as much."""

_LISTED = 3
"""Maximum number of time ranges that a summary lists."""


@dataclass(frozen=True)
class _Gap:
    """Range of consecutive frames of one session that could not be relabelled.

    Attributes
    ----------
    session : str
        Name of the session.
    start, end : float
        Times of the first and of the last frame, s; without times, the indices of these frames.
    frames : int
        Number of frames.
    why : str
        Reason: ``outside the cell`` or ``beyond the limits``.
    """

    session: str
    start: float
    end: float
    frames: int
    why: str


@dataclass(frozen=True, eq=False)
@read_only
class Relabeled:
    """A recording with one configuration per pose: result of :func:`relabel`.

    Attributes
    ----------
    recording : Recording
        The frames as recorded.
    design : CellDesign
        The cell and its function. At other poses, ``design.function(pose, leaf=leaf)`` gives the
        configurations that belong with the new ones.
    leaf : (r,) array
        Level c of the new configurations, rad or m.
    recorded_leaves : (K, r) array or None
        Level c of every recorded configuration, rad or m; NaN outside the cell.
    joints : (K, n) array
        New configurations, rad or m; NaN for frames that could not be relabelled.
    gaps : tuple
        Ranges of consecutive frames that could not be relabelled, each with its attributes
        ``session``, ``start``, ``end``, ``frames`` and ``why``.
    ambiguity : Ambiguity
        Misfit of a smooth function of the pose at the relabelled frames: that of the recorded
        configurations, if any, and that of the new configurations.
    further : dict of str to (K, n) array
        New configurations of further columns of a data set, such as its actions, by name; rad or
        m.

    Examples
    --------
    >>> Q = q0 + 0.05 * np.sin(np.arange(300.0))[:, None] * [1, 1, -1]  # rad
    >>> relabeled = rp.relabel(rp.Recording(task, joints=Q))
    >>> bool(relabeled.residual_after < relabeled.residual_before)
    True
    """

    recording: Recording
    design: CellDesign
    leaf: Array
    recorded_leaves: Array | None
    joints: Array
    gaps: tuple[_Gap, ...]
    ambiguity: Ambiguity
    further: dict[str, Array] = field(default_factory=dict)

    @property
    def found(self) -> NDArray[np.bool_]:
        """Mask (K,): True for frames that were relabelled."""
        return np.isfinite(self.joints[:, 0])

    @property
    def margins_before(self) -> Array | None:
        """Joint-limit margin of the recorded configurations: (K,), rad or m.

        A margin is negative beyond a limit. The result is None if no configurations were recorded.
        """
        before = self.recording.joints
        return None if before is None else self._margins(before)

    @property
    def margins_after(self) -> Array:
        """Joint-limit margin of each new configuration: (K,), rad or m; NaN if there is none."""
        return self._margins(self.joints)

    def _margins(self, Q: Array) -> Array:
        return np.asarray(self.recording.task.limit_margin(Q).min(axis=1), float)

    @property
    def residual_before(self) -> float:
        """Ambiguity of the recorded configurations, rad or m; NaN if none were recorded.

        This rms misfit of a smooth function of the pose is large if equal poses have different
        configurations.
        """
        residuals = self.ambiguity.residuals
        return residuals[0] if len(residuals) > 1 else float("nan")

    @property
    def residual_after(self) -> float:
        """Ambiguity of the new configurations: rms misfit, rad or m, of a function of the pose."""
        return self.ambiguity.residuals[-1]

    @property
    def moved(self) -> Array:
        """New minus recorded configurations: (K, n), rad or m; NaN where either is missing."""
        if self.recording.joints is None:
            return np.full_like(self.joints, np.nan)
        return self.joints - self.recording.joints

    def figures(self) -> dict[str, str]:
        """Return the figures of the relabelling as text, by display name.

        The figures are the numbers of frames, the ambiguity and the smallest limit margin before
        and after, the changes of the joints, the cell, the level, and the columns that change.
        """
        unit = self.recording.task.unit
        count = len(self.recording)
        sessions = len(self.recording.names)
        frames = f"{count:,} in {sessions} session{'s' * (sessions > 1)}: "
        frames += f"{int(self.found.sum()):,} relabelled"
        before, after = self.residual_before, self.residual_after
        arrow = "" if np.isnan(before) else f"{before:.3g} → "
        margin = f"{np.nanmin(self.margins_after):.3g} {unit}"
        if self.margins_before is not None:
            margin = f"{np.nanmin(self.margins_before[self.found]):.3g} → {margin}"
        return {
            "frames": frames,
            "ambiguity": f"{arrow}{after:.3g} {unit}\n{self.ambiguity.method}",
            "limit margin": margin if np.isfinite(self.margins_after[self.found][0]) else "none",
            **({} if self.recording.joints is None else {"moved": self._moved()}),
            "cell": self.design.cell.size(),
            "middle": self.design.cell.where(np.zeros(self.design.cell.k)),
            "leaf": self._leaf(),
            **({"not relabelled": self._missing()} if self.gaps else {}),
            **({"written": ", ".join(self.written)} if self.written else {}),
            **({"removed": ", ".join(self.removed)} if self.removed else {}),
            **({"recomputed": ", ".join(self.recomputed)} if self.recomputed else {}),
        }

    def summary(self) -> str:
        """Return the texts of :meth:`figures` as one text, each with its name, under a title."""
        task = self.recording.task
        lines = []
        for name, text in self.figures().items():
            first, *more = text.split("\n")
            lines.append(f"  {name:14}  {first}")
            lines += [f"  {'':14}  {line}" for line in more]
        return "\n".join([f"{task.robot.name} {task.frame}, {task.kind} task", *lines])

    def save(self, file: str | Path) -> Path:
        """Write the recording with the new configurations, as .csv, .npz or .parquet.

        A data set is written in the format in which it was read, with new statistics. It is written
        completely or not at all, and never replaces an existing file or folder.

        If the recording was read from a file, its other columns are kept, except those that depend
        on the recorded joints: they are left out (:attr:`removed`) or, for poses, computed from the
        new joints (:attr:`recomputed`). If the format is that of the file, the columns that are
        kept have the same values and types, and the metadata are unchanged. New joints are rounded
        to the type of their column. Configurations of frames that could not be relabelled are NaN.

        Raises
        ------
        InputError
            If the suffix is not supported, the file cannot be written, or frames of a data set have
            no new configurations.
        """
        path, source = file_name(file), self.recording.source
        if source is None or not source.same_format(path):
            return write_table(path, plain_columns(self.recording, self.joints, self.further))
        if isinstance(source, DataSet):
            self._require_all(source)
        return source.save(path, self._columns.new, self.removed)

    def _require_all(self, source: DataSet) -> None:
        """Raise InputError if a frame of a data set has no new configuration."""
        columns = {str(source.joints): self.joints} | self.further
        for name, Q in columns.items():
            missing = np.isnan(Q).any(axis=1)
            if missing.any():
                raise InputError(
                    f"{int(missing.sum()):,} of {len(Q):,} rows of {name!r} have no configuration "
                    "in the cell within the limits, so nothing was written; the first is "
                    f"{source.where(int(np.argmax(missing)))}",
                    remedy="use the function of a larger cell, or another level (leaf=, --leaf)",
                )

    @property
    def written(self) -> tuple[str, ...]:
        """Names of the columns that hold the new joints.

        If a column has several numbers per row, the indices of the joints follow in brackets.
        """
        return self._columns.written

    @property
    def removed(self) -> tuple[str, ...]:
        """Names of the columns that are not written, because they belong to the recorded joints."""
        return self._columns.removed

    @property
    def recomputed(self) -> tuple[str, ...]:
        """Names of the columns of the pose that are computed from the new joints.

        Empty for a pose task, where relabelling keeps the pose. Other tasks command only a part of
        the pose, and the rest changes with the joints.
        """
        return self._columns.recomputed

    @cached_property
    def _columns(self) -> Columns:
        if self.recording.source is None:
            return Columns({})
        return relabeled_columns(self.recording, self.joints, self.further)

    def _moved(self) -> str:
        task = self.recording.task
        away = np.abs(self.moved[self.found])
        joint = int(np.argmax(away.max(axis=0)))
        mean = float(np.sqrt((away**2).sum(axis=1).mean()))
        return (
            f"{mean:.3g} {task.unit} (rms), at most {away[:, joint].max():.3g} "
            f"({task.joint_names[joint]})"
        )

    def _leaf(self) -> str:
        text = ", ".join(f"{c:.3g}" for c in self.leaf + 0.0)
        if self.recorded_leaves is None:
            return f"c = {text}"
        low, middle, high = np.nanquantile(self.recorded_leaves, [0.05, 0.5, 0.95], axis=0)
        near = (
            "" if np.allclose(middle, self.leaf, atol=5e-4) else f", {_row(middle)} in the median"
        )
        return f"c = {text}; recorded: {_row(low)} to {_row(high)}{near}"

    def _missing(self) -> str:
        """Write which frames were not relabelled: the three longest gaps, in order of time.

        A last line gives the number of frames in the other gaps.
        """
        longest = sorted(self.gaps, key=lambda gap: -gap.frames)[:_LISTED]
        lines = [self._gap(gap) for gap in self.gaps if gap in longest]
        rest = sum(gap.frames for gap in self.gaps if gap not in longest)
        if rest:
            lines.append(f"and {rest:,} frames in {len(self.gaps) - len(longest)} other ranges")
        return "\n".join(lines)

    def _gap(self, gap: _Gap) -> str:
        timed = self.recording.times is not None
        span = f"{gap.start:.6g}–{gap.end:.6g} s" if timed else f"{gap.start:.0f}–{gap.end:.0f}"
        many = len(self.recording.names) > 1
        where = f"session {gap.session}: " if many else "" if timed else "frames "
        return f"{where}{span} ({gap.frames:,} frames), {gap.why}"

    def __repr__(self) -> str:
        return (
            f"<Relabeled: {int(self.found.sum())} of {len(self.recording)} frames, ambiguity "
            f"{self.residual_before:.3g} → {self.residual_after:.3g} {self.recording.task.unit}>"
        )


@one_blas_thread()
def relabel(
    recording: Recording,
    *,
    design: CellDesign | None = None,
    leaf: ArrayLike | None = None,
    options: FitOptions | None = None,
    progress: bool | Callable[[str, float], None] = False,
) -> Relabeled:
    """Give every recorded pose of a cell one configuration: ``q = F(x; c)``.

    Recorded configurations depend on where each session started and on the preceding motion, so
    equal poses can have different configurations. New configurations depend only on the pose. The
    cell is a box of poses, or a sector around the base, that contains the frames; F is the function
    designed for it. The level c sets the position of the elbow along the self-motion; by default, c
    is near the median of the recorded levels.

    Parameters
    ----------
    recording
        The frames, such as ``rp.Recording.read("demos.csv", task)``.
    design
        Design of a cell's function to use; by default, a function is designed over a cell that
        contains the frames.
    leaf : (r,) array, optional
        Level c, rad or m. By default, levels between the median of the recorded levels and 0 are
        tried, and the one nearest to the median that is as good as c = 0 is used. A level is as
        good as c = 0 if at least as many frames are relabelled at this level, and if the smallest
        joint-limit margin over these frames is at least as large, or at least 0.05 rad or m.
        Without recorded configurations, c = 0.
    options
        ``samples``, ``held_out`` and ``seed`` of the function's design, see :class:`FitOptions`.
    progress
        True for a progress bar on stderr, or a callback (step: str, fraction: float).

    Returns
    -------
    Relabeled
        New configurations and report; see ``summary()`` and ``save()``.

    Raises
    ------
    InputError
        If no function covers a cell around the frames, the design is for another task, or no frame
        has a configuration in its cell, within the joint limits.

    Examples
    --------
    >>> Q = q0 + 0.05 * np.sin(np.arange(300.0))[:, None] * [1, 1, -1]  # rad
    >>> relabeled = rp.relabel(rp.Recording(task, joints=Q))
    >>> again = relabeled.design.function(task.placement(Q[7]), leaf=relabeled.leaf)
    >>> bool(np.abs(again - relabeled.joints[7]).max() < 1e-9)
    True
    """
    what = "a recording, such as rp.Recording(task, joints=Q)"
    require_type(recording, Recording, "recording", what)
    options = fit_options(options)
    options.require_only(("samples", "held_out", "seed"), "relabel")
    progress = progress_option(progress)
    if leaf is not None:
        leaf = vector(np.atleast_1d(leaf), recording.task.r, "leaf", "")
    with reporting.reporter(progress) as report:
        every = _with_further(recording)
        if design is None:
            options = replace(options, held_out=options.held_out or _HELD_OUT)
            design = design_for(every, options, report)
        else:
            _require_same_task(recording, design)
        report("the leaf", 0.7)
        F = InverseFunction(design.function.chart)
        recorded = _leaves(F, recording)
        c = _nearest_leaf(F, every, recorded) if leaf is None else leaf
        report("the frames", 0.8)
        Q, *others = np.split(_labels(F, every, c), 1 + len(recording.further))
        if np.isnan(Q[:, 0]).all():
            raise InputError(
                "the function has no configuration at any recorded pose; its cell is "
                f"{design.cell.size()} around {design.cell.where(np.zeros(design.cell.k))}",
                remedy="use a cell around the recorded poses, or another level (leaf=)",
            )
        report("the ambiguity", 0.9)
        further = dict(zip(recording.further, others, strict=True))
        return replace(_result(recording, design, c, recorded, Q), further=further)


def _require_same_task(recording: Recording, design: CellDesign) -> None:
    require_type(design, CellDesign, "design", "the function of a cell, such as rp.load_cell(file)")
    if design.task.as_dict() != recording.task.as_dict():
        raise InputError(
            f"the recording is for {recording.task!r}, but the cell is for {design.task!r}",
            remedy="use a cell of the recording's task",
        )


def _with_further(recording: Recording) -> Recording:
    """Copy a recording, without its times, and append each further column of joints as K frames.

    Further columns are those in ``recording.further``, such as commanded joints. With these frames,
    the cell also contains the poses of the further columns, and the level is chosen such that F
    reaches these poses. Without further columns, the recording itself is returned.
    """
    if not recording.further:
        return recording
    Q = np.concatenate([recording.joints, *(A for _, A in recording.further.values())])
    sessions = np.tile(recording.session, 1 + len(recording.further))
    return Recording(recording.task, joints=Q, sessions=sessions)


def _leaves(F: InverseFunction, recording: Recording) -> Array | None:
    """Compute the level c (K, r), rad or m, of each recorded configuration; None without joints.

    A row is NaN if its pose lies outside the cell. The level is the position of the elbow along the
    self-motion; in consistent demonstrations, it is constant.
    """
    if recording.joints is None:
        return None
    return in_blocks(lambda Q: F.pose_and_leaf(Q)[1], recording.joints)


def _labels(F: InverseFunction, recording: Recording, c: Array) -> Array:
    """Evaluate the cell's function F at the poses of all frames, with the level c (r,): (K, n).

    Rows are NaN where F has no value: outside the cell, or beyond a joint limit.
    """

    def label(p: Array, R: Array) -> Array:
        return F.batch(homogeneous(p, R), leaf=c, missing="nan")

    return in_blocks(label, recording.positions, recording.rotations)


def _nearest_leaf(F: InverseFunction, recording: Recording, recorded: Array | None) -> Array:
    """Find the level c (r,) nearest to the median of the recorded levels that is as good as c = 0.

    A level is as good as c = 0 if F reaches at least as many of the recorded poses at this level,
    and if the smallest limit margin at these poses is at least as large, or at least 0.05 rad or m.
    Levels between the median of ``recorded`` (K, r) and 0 are tried, the nearest to the median
    first. If none is as good, or there are no recorded levels, the result is 0, the level for which
    the function was designed.
    """
    zero = np.zeros(F.task.r)
    if recorded is None or np.isnan(recorded).all():
        return zero
    c = np.nanmedian(recorded, axis=0)
    few = thinned(recording, _FRAMES)
    found, margin = _kept(F, few, zero)
    for share in np.linspace(1.0, 0.0, 11)[:-1]:
        count, least = _kept(F, few, share * c)
        if count >= found and least >= min(margin, _MARGIN):
            return np.asarray(share * c)
    return zero


def _kept(F: InverseFunction, recording: Recording, c: Array) -> tuple[int, float]:
    """Return the number of recorded poses that F reaches at level c, and the smallest limit margin.

    The margin, rad or m, is that of the configurations of F at these poses; inf if F reaches no
    pose.
    """
    Q = _labels(F, recording, c)
    Q = Q[np.isfinite(Q[:, 0])]
    return len(Q), float(F.task.limit_margin(Q).min(initial=np.inf))


def _result(
    recording: Recording, design: CellDesign, c: Array, recorded: Array | None, Q: Array
) -> Relabeled:
    """Make the result from the new configurations Q (K, n), with gaps and ambiguity.

    ``c`` (r,) is the level of the new configurations, and ``recorded`` (K, r) are the levels of the
    recorded configurations; None without recorded configurations.
    """
    before, found = recording.joints, np.isfinite(Q[:, 0])
    U, off = in_blocks(design.cell.coordinates, recording.positions, recording.rotations)
    labels = [Q[found]] if before is None else [before[found], Q[found]]
    return Relabeled(
        recording,
        design,
        c,
        recorded,
        Q,
        _gaps(recording, found, design.cell._contains(U, off)),
        ambiguity(U[found], recording.session[found], labels),
    )


def _gaps(
    recording: Recording, found: NDArray[np.bool_], inside: NDArray[np.bool_]
) -> tuple[_Gap, ...]:
    """List the ranges of consecutive frames of one session that were not relabelled for one reason.

    ``found`` (K,) is True for frames with new joints, ``inside`` (K,) for poses in the cell. A pose
    in the cell is without new joints if these would violate the joint limits.
    """
    reason = np.where(found, 0, np.where(inside, 2, 1))
    order = np.argsort(recording.session, kind="stable")
    reason, session = reason[order], recording.session[order]
    t = np.arange(len(order)) if recording.times is None else recording.times
    breaks = np.flatnonzero((np.diff(reason) != 0) | (np.diff(session) != 0)) + 1
    why = ("", "outside the cell", "beyond the limits")
    gaps = []
    for a, b in pairwise([0, *breaks.tolist(), len(order)]):
        if reason[a]:
            name, start, end = recording.names[session[a]], t[order[a]], t[order[b - 1]]
            gaps.append(_Gap(name, float(start), float(end), b - a, why[reason[a]]))
    return tuple(gaps)


def _row(values: Array) -> str:
    text = ", ".join(f"{v:.3g}" for v in values + 0.0)
    return f"({text})" if len(values) > 1 else text
