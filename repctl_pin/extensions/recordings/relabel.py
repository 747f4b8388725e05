"""Relabelling of recorded frames: one configuration per pose, on one leaf of a cell's function."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ... import progress as reporting
from ...arguments import (
    Array,
    file_name,
    flag_or_function,
    read_only,
    require_type,
    vector,
)
from ...errors import InputError
from ...fit_options import FitOptions, fit_options
from ...tables import Column, write_table
from ..cells.cell_design import CellDesign
from ..cells.function import InverseFunction
from ..cells.targets import homogeneous
from .ambiguity import Ambiguity, ambiguity
from .choose_cell import design_for
from .joint_log import words_of
from .recording import (
    JOINTS,
    POSES,
    POSITION,
    QUATERNION,
    Recording,
    blocks,
    forward,
    thinned,
)

_HELD_OUT = 1024
_FRAMES = 2**13
"""Maximum number of frames at which a leaf is tried."""

_MARGIN = 0.05
"""Joint-limit margin, rad or m, that a leaf must keep if the leaf c = 0 keeps as much."""

_LISTED = 3
"""Maximum number of time ranges that a summary lists."""


_OF_JOINTS = frozenset(
    """
    joint joints qpos qvel qacc q dq ddq qd qdd qdot vel velocity velocities acc acceleration
    accelerations effort efforts torque torques tau action actions command commands cmd state
    """.split()  # noqa: SIM905
)
"""Words in the name of a column that depends on the joints."""

_OF_HAND = frozenset(
    """
    gripper finger fingers hand ee eef tcp tool cartesian twist image
    """.split()  # noqa: SIM905
)
"""Words in the name of a column that does not depend on the joints of the arm."""


class _Changes(NamedTuple):
    """Names of columns that were removed, and of columns computed from the new joints."""

    removed: tuple[str, ...] = ()
    recomputed: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Gap:
    """Range of consecutive frames of one session that could not be relabelled.

    Attributes
    ----------
    session : str
        Name of the session.
    start, end : float
        Time of the first and of the last frame, s; numbers of the frames if there are no times.
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
        The cell and its function; ``design.function(pose, leaf=leaf)`` labels other poses alike.
    leaf : (r,) array
        Level c of the new configurations, rad or m.
    recorded_leaves : (K, r) array or None
        Level c of every recorded configuration, rad or m; NaN outside the cell.
    joints : (K, n) array
        New configurations, rad or m; NaN for frames that could not be relabelled.
    found : (K,) array of bool
        True for frames that were relabelled.
    gaps : tuple of Gap
        Time ranges of the frames that could not be relabelled.
    ambiguity : Ambiguity
        Misfit of a smooth fit of configurations over poses, at the relabelled frames: of the
        recorded configurations, if there are any, and of the new ones.
    margins_before, margins_after : (K,) array or None
        Joint-limit margin of the recorded and of the new configurations, rad or m.

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
    found: NDArray[np.bool_]
    gaps: tuple[_Gap, ...]
    ambiguity: Ambiguity
    margins_before: Array | None
    margins_after: Array

    @property
    def residual_before(self) -> float:
        """Ambiguity of the recorded configurations, rad or m; NaN if none were recorded."""
        residuals = self.ambiguity.residuals
        return residuals[0] if len(residuals) > 1 else float("nan")

    @property
    def residual_after(self) -> float:
        """Ambiguity of the new configurations, rad or m."""
        return self.ambiguity.residuals[-1]

    @property
    def moved(self) -> Array:
        """New minus recorded configurations (K, n), rad or m; NaN where either is missing."""
        if self.recording.joints is None:
            return np.full_like(self.joints, np.nan)
        return self.joints - self.recording.joints

    def figures(self) -> dict[str, str]:
        """Return the figures of merit as text, by name."""
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
            "limit margin": margin
            if np.isfinite(self.margins_after[self.found][0])
            else "none",
            **({} if self.recording.joints is None else {"moved": self._moved()}),
            "cell": self.design.cell.size(),
            "middle": self.design.cell.where(np.zeros(self.design.cell.k)),
            "leaf": self._leaf(),
            **({"not relabelled": self._missing()} if self.gaps else {}),
            **({"removed": ", ".join(self.removed)} if self.removed else {}),
            **({"recomputed": ", ".join(self.recomputed)} if self.recomputed else {}),
        }

    def summary(self) -> str:
        """Return the figures of merit as text, one per line."""
        task = self.recording.task
        lines = []
        for name, text in self.figures().items():
            first, *more = text.split("\n")
            lines.append(f"  {name:14}  {first}")
            lines += [f"  {'':14}  {line}" for line in more]
        return "\n".join([f"{task.robot.name} {task.frame}, {task.kind} task", *lines])

    def save(self, file: str | Path) -> Path:
        """Write the recording with the new configurations, as .csv, .npz or .parquet.

        Other columns of a file that was read are kept, except ``removed`` and ``recomputed``.
        Frames that could not be relabelled have NaN as their configuration.

        Raises
        ------
        InputError
            If the file has another suffix, or cannot be written.
        """
        return write_table(file_name(file), _columns(self)[0])

    @property
    def removed(self) -> tuple[str, ...]:
        """Names of the columns that are not written, because they belong to the old joints."""
        return _columns(self)[1].removed

    @property
    def recomputed(self) -> tuple[str, ...]:
        """Names of the columns of the pose that are computed from the new joints."""
        return _columns(self)[1].recomputed

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
        low, middle, high = np.nanquantile(
            self.recorded_leaves, [0.05, 0.5, 0.95], axis=0
        )
        near = (
            ""
            if np.allclose(middle, self.leaf, atol=5e-4)
            else f", {_row(middle)} in the median"
        )
        return f"c = {text}; recorded: {_row(low)} to {_row(high)}{near}"

    def _missing(self) -> str:
        """Write which frames were not relabelled: the longest gaps in the order of time, and how
        many frames the other gaps have."""
        longest = sorted(self.gaps, key=lambda gap: -gap.frames)[:_LISTED]
        lines = [self._gap(gap) for gap in self.gaps if gap in longest]
        rest = sum(gap.frames for gap in self.gaps if gap not in longest)
        if rest:
            lines.append(
                f"and {rest:,} frames in {len(self.gaps) - len(longest)} other ranges"
            )
        return "\n".join(lines)

    def _gap(self, gap: _Gap) -> str:
        timed = self.recording.times is not None
        span = (
            f"{gap.start:.6g}–{gap.end:.6g} s"
            if timed
            else f"{gap.start:.0f}–{gap.end:.0f}"
        )
        many = len(self.recording.names) > 1
        where = f"session {gap.session}: " if many else "" if timed else "frames "
        return f"{where}{span} ({gap.frames:,} frames), {gap.why}"

    def __repr__(self) -> str:
        return (
            f"<Relabeled: {int(self.found.sum())} of {len(self.recording)} frames, ambiguity "
            f"{self.residual_before:.3g} → {self.residual_after:.3g} {self.recording.task.unit}>"
        )


def relabel(
    recording: Recording,
    *,
    design: CellDesign | None = None,
    leaf: ArrayLike | None = None,
    options: FitOptions | None = None,
    progress: bool | Callable[[str, float], None] = False,
) -> Relabeled:
    """Give every recorded pose of a cell one configuration: ``q = F(x; c)``.

    Recorded configurations depend on where each session started and on the motion before, so that
    equal poses have different configurations. The new ones depend on the pose alone. The cell is
    the box, or the sector around the base, that holds the frames. By default the level c is near
    the median of the recorded ones.

    Parameters
    ----------
    recording
        The frames, such as ``rp.Recording.read("demos.csv", task)``.
    design
        Function of a cell to use, instead of one over the cell that holds the frames.
    leaf : (r,) array, optional
        Level c, rad or m. By default, the level between 0 and the median of the recorded levels
        that is nearest to the median, relabels as many frames as c = 0, and keeps a joint-limit
        margin as large as with c = 0, or 0.05; 0 without recorded configurations.
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
        lies in its cell.

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
    progress = flag_or_function(
        progress,
        "progress",
        "a function of what is being done and the share that is done",
        2,
    )
    given = (
        None
        if leaf is None
        else vector(np.atleast_1d(leaf), recording.task.r, "leaf", "")
    )
    with reporting.reporter(progress) as report:
        if design is None:
            options = FitOptions(
                samples=options.samples,
                held_out=options.held_out or _HELD_OUT,
                seed=options.seed,
            )
            design = design_for(recording, options, report)
        else:
            _require_same_task(recording, design)
        report("the leaf", 0.7)
        F = InverseFunction(design.function.chart)
        recorded = _leaves(F, recording)
        c = _nearest_leaf(F, recording, recorded) if given is None else given
        report("the frames", 0.8)
        Q = _labels(F, recording, c)
        found = np.isfinite(Q[:, 0])
        if not found.any():
            raise InputError(
                f"no frame has a configuration in the cell, {design.cell.size()} around "
                f"{design.cell.where(np.zeros(design.cell.k))}",
                remedy="use another cell or leaf",
            )
        report("the ambiguity", 0.9)
        return _result(recording, design, c, recorded, Q)


def _require_same_task(recording: Recording, design: CellDesign) -> None:
    require_type(
        design,
        CellDesign,
        "design",
        "the function of a cell, such as rp.load_cell(file)",
    )
    if design.task.as_dict() != recording.task.as_dict():
        raise InputError(
            f"the recording is for {recording.task!r}, the cell for {design.task!r}",
            remedy="use a cell of the recording's task",
        )


def _leaves(F: InverseFunction, recording: Recording) -> Array | None:
    """Compute the level c (K, r) of each recorded configuration; None if none were recorded."""
    if recording.joints is None:
        return None
    Q = recording.joints
    return np.concatenate([F.pose_and_leaf(Q[part])[1] for part in blocks(len(Q))])


def _labels(F: InverseFunction, recording: Recording, c: Array) -> Array:
    """Evaluate F on the leaf c at the poses of all frames: (K, n), NaN where F has no value."""
    p, R = recording.positions, recording.rotations
    parts = [
        F.batch(homogeneous(p[part], R[part]), leaf=c, missing="nan")
        for part in blocks(len(p))
    ]
    return np.concatenate(parts)


def _nearest_leaf(
    F: InverseFunction, recording: Recording, recorded: Array | None
) -> Array:
    """Find the level c nearest to the recorded median that loses no frame and no limit margin.

    Levels between the median and 0 are tried, the nearest to the median first. The function was
    designed for c = 0, which is returned if all others lose frames or margin.
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
    """Count the frames that the leaf c relabels, and find their smallest joint-limit margin."""
    Q = _labels(F, recording, c)
    Q = Q[np.isfinite(Q[:, 0])]
    return len(Q), float(F.task.limit_margin(Q).min(initial=np.inf))


def _result(
    recording: Recording, design: CellDesign, c: Array, recorded: Array | None, Q: Array
) -> Relabeled:
    """Make the result from new configurations Q (K, n), with gaps, ambiguity and limit margins."""
    task = recording.task
    before = recording.joints
    found = np.isfinite(Q[:, 0])
    cell, parts = design.cell, blocks(len(recording))
    places = [
        cell.coordinates(recording.positions[part], recording.rotations[part])
        for part in parts
    ]
    inside = np.concatenate([cell._contains(U, off) for U, off in places])
    U = np.concatenate([U for U, _ in places])[found]
    labels = [Q[found]] if before is None else [before[found], Q[found]]
    return Relabeled(
        recording,
        design,
        c,
        recorded,
        Q,
        found,
        _gaps(recording, found, inside),
        ambiguity(U, recording.session[found], labels),
        None if before is None else task.limit_margin(before).min(axis=1),
        np.where(found, task.limit_margin(Q).min(axis=1), np.nan),
    )


def _gaps(
    recording: Recording, found: NDArray[np.bool_], inside: NDArray[np.bool_]
) -> tuple[_Gap, ...]:
    """List the ranges of consecutive frames of a session that lack a label for one reason."""
    kind = np.where(found, 0, np.where(inside, 2, 1))
    order = np.argsort(recording.session, kind="stable")
    kind, session = kind[order], recording.session[order]
    t = (
        np.arange(len(kind), dtype=float)
        if recording.times is None
        else recording.times
    )
    breaks = np.flatnonzero((np.diff(kind) != 0) | (np.diff(session) != 0)) + 1
    starts = np.concatenate([[0], breaks])
    ends = np.concatenate([breaks, [len(kind)]])
    why = ("", "outside the cell", "beyond the limits")
    return tuple(
        _Gap(
            recording.names[session[a]], float(t[order[a]]), float(t[order[b - 1]]), int(b - a),
            why[kind[a]],
        )
        for a, b in zip(starts, ends, strict=True)
        if kind[a]
    )  # fmt: skip


def _columns(relabeled: Relabeled) -> tuple[dict[str, Column], _Changes]:
    """Make the columns of the file with the new configurations, by name; list what changed."""
    recording, Q = relabeled.recording, relabeled.joints
    task = recording.task
    old = recording.joints
    n = relabeled.joints.shape[1]
    joints = dict(zip(task.joint_names, Q.T, strict=True))
    poses = _poses(relabeled)
    if recording.source is None:
        return _own_columns(recording) | poses | joints, _Changes()
    source = recording.source.columns
    made = dict[str, Column]()
    removed, recomputed = list[str](), list[str]()
    for name, values in source.items():
        array = values.ndim == 2 and values.shape[1] >= n
        copy = array and old is not None and np.array_equal(values[:, :n], old)
        if name in joints:
            made[name] = joints[name]
        elif array and copy:
            made[name] = np.concatenate([Q, values[:, n:]], axis=1)
        elif name in poses:
            new = poses[name].reshape(values.shape)
            made[name] = np.where(_like(relabeled.found, new), new, values)
            recomputed.append(name)
        elif old is not None and _of_old_joints(name, task.joint_names):
            removed.append(name)
        else:
            made[name] = values
    if not (set(joints) <= set(made) or any(name in made for name in JOINTS)):
        made |= joints
    return made, _Changes(tuple(removed), tuple(recomputed))


def _like(found: NDArray[np.bool_], values: Column) -> NDArray[np.bool_]:
    """Shape ``found`` (K,) so that it selects rows of values (K, …)."""
    return found.reshape(-1, *[1] * (values.ndim - 1))


def _of_old_joints(name: str, joints: Sequence[str]) -> bool:
    """Check whether a column depends on the recorded joints, by its name.

    It holds the name of a joint, or a word such as ``action``, ``qvel`` or ``velocity``, and no
    word of the hand or the gripper.
    """
    rest = words_of(name, joints)
    held = rest != words_of(name, ())
    return held or bool(rest & _OF_JOINTS and not rest & _OF_HAND)


def _poses(relabeled: Relabeled) -> dict[str, Column]:
    """Compute the poses of the new configurations, by the names of their columns.

    A pose task keeps the recorded poses; other tasks leave a part of the pose free, which changes
    with the configuration.
    """
    from scipy.spatial.transform import Rotation

    recording = relabeled.recording
    if recording.task.m == 6:
        return {}
    p = recording.positions.copy()
    R = recording.rotations.copy()
    p[relabeled.found], R[relabeled.found] = forward(
        recording.task, relabeled.joints[relabeled.found]
    )
    quaternions = Rotation.from_matrix(R).as_quat()
    columns = dict(zip(POSITION, p.T, strict=True))
    columns |= dict(zip(QUATERNION, quaternions.T, strict=True))
    poses: Column = homogeneous(p, R)
    source = {} if recording.source is None else recording.source.columns
    for name in set(POSES) & set(source):
        size = source[name][0].size
        if size == 7:
            columns[name] = np.concatenate([p, quaternions], axis=1)
        else:
            columns[name] = p if size == 3 else poses
    return columns


def _own_columns(recording: Recording) -> dict[str, Column]:
    """Make columns of time, session and pose for a recording that was not read from a file."""
    from scipy.spatial.transform import Rotation

    columns: dict[str, Column] = {}
    if recording.times is not None:
        columns["time"] = recording.times
    if len(recording.names) > 1:
        columns["session"] = np.array(recording.names, dtype=object)[recording.session]
    columns |= dict(zip(POSITION, recording.positions.T, strict=True))
    quaternions = Rotation.from_matrix(recording.rotations).as_quat()
    return columns | dict(zip(QUATERNION, quaternions.T, strict=True))


def _row(values: Array) -> str:
    text = ", ".join(f"{v:.3g}" for v in values + 0.0)
    return f"({text})" if len(values) > 1 else text
