"""Cell around recorded frames, and a function over it near the recorded configurations.

A cell is a box of poses, or a sector around the base, over which one function q = F(x) gives the
joints. The cell should contain all frames (rows of the recording) and be no larger than necessary,
because a larger cell may have no such function. A session is one run of the recorder, such as a
demonstration. The coordinates of a sector are radius, angle and height about an axis, two tilts of
the tool, and its spin, the rotation about the tool's own axis. A share is a fraction of the frames,
0 to 1. Letters: K frames, m coordinates of a pose, n joints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pinocchio as pin

from ...base.arguments import Array
from ...base.errors import InputError
from ...base.fit_options import FitOptions
from ...model.rotations import exp3, mean_rotation
from ...model.task import Task
from ...strategies import Pseudoinverse
from ..cells.cell_design_result import CellDesign
from ..cells.fit.nearest_function import nearest_inverse_function
from ..cells.function import InverseFunction
from ..cells.geometry.cell import Cell
from ..cells.geometry.sector import ANGLE, HEIGHT, RADIUS, SPIN, Sector
from .recording import Recording, thinned

_SHARES = (1.0, 0.98, 0.9)
"""Shares of the frames that a cell has to hold, tried in this order until a function covers it."""

_FRAMES, _TRIED = 2**16, 2**12
"""Maximum numbers of frames: around which a cell is made, and at which its function is tested."""

_WIDER, _PAD_M, _PAD_RAD = 1.02, 0.005, 0.01
"""Factor and margins by which the half-widths of a cell exceed those of the frames in it."""

_HELD = 5e-7
"""Deviation from the middle, rad or m, below which a coordinate of all poses counts as constant."""

_FAR_ROUND = 0.6
"""Angle around the base, rad to either side, above which a sector is tried before a box."""

_SMALL_SPIN = 0.6


def design_for(
    recording: Recording, options: FitOptions, report: Callable[[str, float], None]
) -> CellDesign:
    """Design a function over a box or a sector that is just large enough for the recorded frames.

    The box or sector is called the cell of the function, which gives one configuration per pose.
    The cell contains all frames or, if no function covers that cell, 98 % or 90 % of the frames. If
    no function covers such a cell either, the function that covers most frames is returned. In the
    middle of the cell, the function has a typical recorded configuration, unless the design with
    that configuration fails. ``options`` are those of the design, and ``report`` is the progress
    callback (step, fraction).

    Raises
    ------
    InputError
        If there is no function over any of the cells.
    """
    thin = thinned(recording, _FRAMES)
    few = thinned(recording, _TRIED)
    best: tuple[float, CellDesign | None] = (0.0, None)
    failure = InputError(
        "no box or sector contains the recorded poses",
        remedy="give a cell, or a shorter part of the recording",
    )
    for share in _SHARES:
        for cell in _cells(thin, share):
            report(f"a function over {cell.size()}", 0.1)
            try:
                found = _design(thin, cell, options)
            except InputError as error:
                failure = error
                continue
            held = _held(found, few)
            if held >= share - 1.0 / len(few):
                return found
            best = max(best, (held, found), key=lambda pair: pair[0])
    if best[1] is None:
        raise InputError(
            f"no function covers a cell around the recorded poses: {failure.args[0]}",
            remedy="split the recording, or give the design of a smaller cell",
        )
    return best[1]


def _held(found: CellDesign, recording: Recording) -> float:
    """Compute the share of frames at whose poses the function has a value within joint limits."""
    F = InverseFunction(found.function.chart)
    Q = F.batch(recording.homogeneous, missing="nan")
    return float(np.isfinite(Q[:, 0]).mean())


def _design(recording: Recording, cell: Cell, options: FitOptions) -> CellDesign:
    """Design the function of a cell from a recorded configuration in its middle.

    The function gives one configuration per pose of the cell, near the recorded configurations.
    Without recorded joints, or if that design fails, the design searches for the configuration in
    the middle. A function that covers only a part of the cell is also returned, because it may
    still cover most frames.
    """
    control = Pseudoinverse(cell.task)
    if recording.joints is not None:
        try:
            return nearest_inverse_function(
                control, cell, posture=_posture(recording, cell), incomplete="keep", options=options
            )
        except InputError:
            pass
    return nearest_inverse_function(control, cell, incomplete="keep", options=options)


def _posture(recording: Recording, cell: Cell) -> Array:
    """Select a typical recorded configuration (n,) near the middle of a cell.

    The function's configurations should be near the recorded ones. The candidates are the
    configurations nearest to the middle, one per session. The candidate with the smallest sum of
    distances to the others is returned.
    """
    assert recording.joints is not None
    U, _ = cell.coordinates(recording.positions, recording.rotations)
    away = np.linalg.norm(U, axis=1)
    order = np.lexsort((away, recording.session))
    first = order[np.unique(recording.session[order], return_index=True)[1]]
    Q = recording.joints[first[:512]]
    distance = np.linalg.norm(Q[:, None] - Q[None], axis=2).sum(axis=1)
    return Q[int(np.argmin(distance))]


# ---- cells


def _cells(recording: Recording, share: float) -> Iterator[Cell]:
    """Yield a box, and a sector around the base, that contain a share of the recorded poses.

    The sector comes first if the poses extend far around the base, where a box would be too large.
    """
    p = recording.positions
    angle = np.arctan2(p[:, 1], p[:, 0])
    angle = np.angle(np.exp(1j * (angle - _mean_angle(angle))))
    shapes = [_box, _sector]
    if np.quantile(np.abs(angle), share) > _FAR_ROUND:
        shapes.reverse()
    for shape in shapes:
        try:
            yield shape(recording, share)
        except InputError:  # there is no such cell, as of poses all around the base
            continue


def _box(recording: Recording, share: float) -> Cell:
    """Make a box of poses that contains the given share of the frames, with a small margin.

    The middle of the box is found in two steps. The first middle has the median position and the
    mean rotation of all frames. The given share of the frames, those nearest to the first middle,
    is selected; the final middle is the centre of their range.
    """
    task = recording.task
    p = recording.positions
    R = recording.rotations
    positions = min(3, task.m)
    turns = task.m - positions
    middle = pin.SE3(mean_rotation(R), np.median(p, axis=0))
    probe = Cell(task, middle, 1.0, 0.5 if turns else 0.0)
    Y = _within(_measured(probe, p, R), share)
    between = (Y.max(axis=0) + Y.min(axis=0)) / 2
    origin, turned = middle.translation.copy(), middle.rotation
    origin[task.rows[:positions]] += between[:positions]
    if turns:  # the middle of rotation vectors is not that of the rotations
        turned = exp3(probe.vectors(between[None, positions:]))[0] @ turned
    probe = Cell(task, pin.SE3(turned, origin), 1.0, 0.5 if turns else 0.0)
    w = _widths(_within(_measured(probe, p, R), share), positions)
    return Cell(task, probe.placement, w[:positions], w[positions:] if turns else 0.0)


def _sector(recording: Recording, share: float) -> Cell:
    """Make a sector around the base that contains the given share of the frames, with a margin.

    The coordinates of a sector depend on its middle. So the middle is first estimated from medians
    and means, and then improved once. InputError is raised if there is no such sector.
    """
    task = recording.task
    p = recording.positions
    R = recording.rotations
    away = np.hypot(p[:, 0], p[:, 1])
    mean = _mean_angle(np.arctan2(p[:, 1], p[:, 0]))
    angle = np.angle(np.exp(1j * (np.arctan2(p[:, 1], p[:, 0]) - mean)))
    back = exp3(np.outer(-angle, [0.0, 0.0, 1.0]))
    turned = mean_rotation(back @ R)
    rho, z = float(np.median(away)), float(np.median(p[:, 2]))
    for _ in range(2):
        point = np.array([rho * np.cos(mean), rho * np.sin(mean), z])
        probe = _wide_sector(task, pin.SE3(turned, point), 0.5 * rho)
        Y = _within(_measured(probe, p, R), share)
        between = (Y.max(axis=0) + Y.min(axis=0)) / 2
        rho, mean = rho + between[RADIUS], mean + between[ANGLE]
        z += between[HEIGHT] if task.m > 2 else 0.0
        turned = _turned(turned, between)
    return _sector_of(probe, _widths(Y, 3))


def _turned(R: Array, y: Array) -> Array:
    """Turn the rotation R (3, 3) of a sector's middle by the angles among its coordinates y (m,).

    These are the angle about the vertical axis, the two tilts and the spin of the tool, rad. Radius
    and height are not used.
    """
    R = pin.exp3(y[ANGLE] * np.array([0.0, 0.0, 1.0])) @ R
    if len(y) > 3:
        R = R @ pin.exp3(np.append(y[3:5], 0.0))
    if len(y) > SPIN:
        R = R @ pin.exp3(np.array([0.0, 0.0, y[SPIN]]))
    return R


def _wide_sector(task: Task, middle: pin.SE3, radius: float) -> Sector:
    """Make a sector with the given middle and a half-width ``radius``, m, in the radial direction.

    The other half-widths are nominal: 1 m for the height, 1 rad for tilts, π for angle and spin.
    Coordinates that the task does not command are left out.
    """
    sizes = {"height": 1.0 if task.m > 2 else 0.0, "angle": np.pi}
    sizes |= {"half_angle": 1.0} if task.m > 3 else {}
    sizes |= {"spin": np.pi} if task.m == 6 else {}
    return Sector(task, middle, radius=radius, **sizes)


def _sector_of(probe: Sector, w: Array) -> Sector:
    """Make a sector with the middle of ``probe`` and half-widths w, one per coordinate, m or rad.

    A spin, the rotation about the tool's axis, has a half-width of its own in :class:`Sector`,
    ``spin``. If its half-width is less than 0.6 rad, it becomes the third component of
    ``half_angle`` instead, beside the two tilts.
    """
    task = probe.task
    spin = float(w[SPIN]) if task.m > SPIN else 0.0
    turns = w[3:5] if task.m > 3 else 0.0
    if 0 < spin < _SMALL_SPIN:
        turns, spin = np.append(w[3:5], spin), 0.0
    return Sector(
        task,
        probe.placement,
        radius=float(w[RADIUS]),
        height=float(w[HEIGHT]) if task.m > 2 else 0.0,
        angle=min(float(w[ANGLE]), np.pi),
        half_angle=turns,
        spin=min(spin, np.pi),
    )


def _measured(probe: Cell, p: Array, R: Array) -> Array:
    """Compute the coordinates (K, m), in m and rad, of poses in the cell ``probe``.

    p (K, 3), m, and R (K, 3, 3) are the positions and rotations of the poses. The coordinates are 0
    in the middle of the cell.
    """
    U, _ = probe.coordinates(p, R)
    return U * probe.widths[probe.moved]


def _within(Y: Array, share: float) -> Array:
    """Return the given share of the rows of Y (K, m): those nearest to the median row.

    The distance of a row is the largest over its coordinates. Distances in each coordinate are
    divided by their 0.9 quantile, so that metres and radians count alike.
    """
    if share == 1.0:
        return Y
    away = np.abs(Y - np.median(Y, axis=0))
    score = (away / np.maximum(np.quantile(away, 0.9, axis=0), _HELD)).max(axis=1)
    return Y[score <= np.quantile(score, share)]


def _widths(Y: Array, positions: int) -> Array:
    """Compute half-widths (m,) of a cell that contains poses Y (K, m), relative to its middle.

    The first ``positions`` coordinates are in m, the others in rad. Each half-width includes a
    margin. A coordinate that is 0 in all poses gets the half-width 0. If all coordinates are 0 in
    all poses, the half-widths are the margins.
    """
    reach = np.abs(Y).max(axis=0)
    pad = np.where(np.arange(len(reach)) < positions, _PAD_M, _PAD_RAD)
    widths = np.where(reach < _HELD, 0.0, _WIDER * reach + pad)
    return widths if widths.any() else pad


def _mean_angle(angle: Array) -> float:
    return float(np.angle(np.exp(1j * angle).mean()))
