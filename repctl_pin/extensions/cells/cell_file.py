"""File content of a cell's design: conversion to plain data, and back.

A cell is a box of poses; its design is a function q = F(x) with one configuration for each pose. A
sector is a cell in cylindrical coordinates; one of its coordinates is symmetric if a single joint
moves the frame along it. u (k,) are the coordinates of a pose in the cell, from −1 to 1. The
function covers a pose if it has a configuration there inside the joint limits. Letters: n joints, m
task coordinates, r = n − m. The classes describe the objects of the JSON file, with attributes
named like the keys. A fingerprint is a hash, or numbers, that differ if the described thing has
changed.

``_CellFile`` is the content of the file of an inverse kinematic function over a cell.
``_BodiesFile`` is a fingerprint of the collision bodies: a hash of their shapes, and numbers for
their places. ``Description`` is the content of a validated URDF as plain data. ``Shape`` is a shape
of a URDF as plain data: its kind, size, link and place, or its mesh file. ``_SectorFile`` is the
stored coordinates of a sector: its axis, free and symmetric coordinates, and profile.
"""

from __future__ import annotations

import hashlib
import warnings
from functools import lru_cache
from math import comb
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...base.arguments import Array, as_int
from ...base.certificate import fingerprint
from ...base.errors import InputError
from ...design.proof_fingerprint import check_configurations
from ...model.catalogue import disabled_pairs
from ...model.model import fixed_placements, link_frames
from ...model.packages import find_mesh
from ...model.shapes import Shape
from ...model.task import Task
from ...model.urdf import Description
from ...saving.design_file import FileKind, head
from ...saving.save_load import load
from ...saving.schema import (
    Desired,
    Part,
    ProofFile,
    Row,
    Rows,
    Sealed,
    described,
    desired_file,
    desired_of,
    made,
    proof_file,
    proof_of,
)
from ...saving.task_identity import configurations, require_masses, require_ranges
from .cell_design_result import CellDesign, function_of
from .chart.chart import Chart
from .chart.monomials import Monomials
from .evaluate.cell_evaluation import Evaluation
from .evaluate.cell_failures import FailureReason
from .evaluate.symmetric_coordinates import Turn
from .geometry.cell import Cell
from .geometry.sector import SPIN, Sector

_FORMAT = "repctl cell"
_MOST_DEGREE = 64


class _FailureFile(Part):
    """Reason why a function fails at some poses of its cell.

    ``cause`` is ``reach``, ``singularity``, ``limit``, ``fold`` or ``collision``. At a fold, the
    leaf (the set of the function's configurations) turns back along the self-motion, and is no
    longer a function of the pose. ``share`` is the fraction of the sampled poses that fail for this
    cause. ``u`` is the worst pose, in all coordinates of the cell, and ``what`` a message that
    describes the failure at this pose.
    """

    cause: str
    share: float
    u: Row
    what: str


class _TurnFile(Part):
    """Range of a function along a symmetric coordinate of its sector, rad.

    All ranges are full widths. ``joint_range`` is the range of the joint, null without limits; in
    the other numbers, null stands for an unknown one. ``spread`` is the difference between the
    joint's largest and smallest value over the covered poses. In the range ``reach`` of the
    coordinate, the joint stays within its limits at every covered pose. In the range ``nearly`` it
    does so at 99.9 % of the covered poses, in ``most`` at 99 %, and in ``as_covered`` at the
    fraction ``covered``. ``covered`` is the fraction of the sampled poses that the function covers;
    the limits of joints that move a coordinate with the range ``"all"`` do not count. ``price`` and
    ``unasked`` compare the function with a second one, designed for the range ``"all"`` instead of
    the requested one: ``price`` is the extra joint speed of the function minus that of the second
    one, and ``unasked`` is the ``reach`` of the second one. ``bodies`` are the links that collide
    just beyond the range of the function; empty if no bodies end this range.
    """

    coordinate: str
    joint: str
    joint_range: float | None
    spread: float
    reach: float
    most: float
    nearly: float | None = None
    price: float = 0.0
    unasked: float | None = None
    covered: float | None = None
    as_covered: float | None = None
    bodies: str = ""


class _SectorFile(Part):
    """Cylindrical coordinates of a sector: radius, angle, height, two tilts, spin, numbered from 0.

    Their half-widths are in :attr:`_CellFile.widths`, in this order, rad or m. ``axis`` has two
    rows, in the base frame: a point of the axis, m, and its direction. ``free`` has the coordinates
    whose range ends only at the joint limits, and ``symmetric`` those that the polynomials leave
    out, by their numbers. ``spin_middle`` is the middle of the spin, rad; it is present only if
    the sector has tilts and the spin is in ``free``. ``profile`` is present only if the range of
    radius depends on the height. It has two rows: the coefficients of the bend, which shifts the
    range, and of the stretch, which scales the range, in powers of the height above the middle, m;
    see :class:`repctl_pin.extensions.cells.geometry.sector_profile.Profile`.
    """

    axis: Rows
    free: list[int]
    symmetric: list[int]
    spin_middle: float | msgspec.UnsetType = msgspec.UNSET
    profile: Rows | msgspec.UnsetType = msgspec.UNSET


class _BodiesFile(Part):
    """Fingerprints of the collision bodies: ``shapes`` of their shapes, ``places`` of their places.

    ``shapes`` is a hash. ``places`` has one number for each of four fixed configurations; the
    numbers change if any body is placed elsewhere. If the bodies have changed since the file was
    written, the body distance in the file is dropped.
    """

    shapes: str
    places: Row


class _CellFigures(Part):
    """Figures of a saved cell, with the names of the attributes of :class:`Evaluation`.

    A margin is null without joint limits, and ``body_distance`` is null without collision bodies.
    Figures with a default are missing in older files. The leaf margin is stored as
    ``least_leaf_margin``. In older files, ``leaf_margin`` is a different figure, which is not read.
    """

    cost: float
    cost_error: float
    extra_speed: float
    extra_speed_error: float
    extra_speed_worst: float
    limit_margin: float | None
    attainable_margin: float | None
    smallest_singular_value: float
    body_distance: float | None
    nearest_bodies: tuple[str, str]
    residual: float
    coverage: float
    failures: list[_FailureFile]
    limit_margin_worst: float | None = None
    attainable_margin_worst: float | None = None
    extra_speed_direction: float | None = None
    turns: tuple[_TurnFile, ...] = ()
    leaf_margin: float | msgspec.UnsetType = msgspec.UNSET
    least_leaf_margin: float | None = None


class _CellFile(Sealed):
    """File content: an inverse kinematic function over a cell of poses.

    ``placement`` (4, 4) is the pose in the middle of the cell, in the base frame; ``widths`` (m,)
    are the half-widths of its coordinates, m and rad. ``coefficients`` (N, n, 1 + r) are the
    coefficients of the polynomials q_ref and n_ref in the N monomials of u up to the ``degree``.
    ``bodies`` is the fingerprint of the collision bodies. Older files, and files without a known
    body distance, do not have this key. ``desired`` is the inverse to which ∂F/∂x is near, and
    ``posture`` (n,) the configuration in the middle. ``degrees`` are the degrees that were tried,
    with their costs; ``sector`` are the coordinates of a sector. The other keys are numbers of the
    fit, and requested minima of the margins, as in :class:`CellDesign`.
    """

    desired: Desired
    placement: Rows
    widths: Row
    degree: int
    coefficients: list[Rows]
    posture: Row
    figures: _CellFigures
    degrees: tuple[tuple[int, float], ...]
    samples: int
    held_out: int
    seed: int
    steps: int
    requested_limit_margin: float
    requested_body_distance: float = 0.0
    requested_sigma_min: float = 0.0
    proof: ProofFile | msgspec.UnsetType = msgspec.UNSET
    sector: _SectorFile | msgspec.UnsetType = msgspec.UNSET
    bodies: _BodiesFile | msgspec.UnsetType = msgspec.UNSET


def cell_file(design: CellDesign) -> _CellFile:
    """Convert the design of a cell's function to the content of a file.

    Raises
    ------
    InputError
        If the design contains user-defined functions.
    """
    chart, cell, evaluation = design.function.chart, design.cell, design.evaluation
    figures = described(
        _CellFigures,
        evaluation,
        failures=[described(_FailureFile, reason) for reason in evaluation.failures],
        turns=tuple(described(_TurnFile, turn) for turn in evaluation.turns),
        leaf_margin=msgspec.UNSET,
        least_leaf_margin=None if np.isnan(evaluation.leaf_margin) else evaluation.leaf_margin,
    )
    return described(
        _CellFile,
        design,
        **head(_FORMAT, design.task),
        desired=desired_file(design.desired),
        placement=cell.placement.homogeneous.tolist(),
        widths=cell.widths.tolist(),
        degree=chart.monomials.degree,
        coefficients=chart.coefficients.tolist(),
        figures=figures,
        proof=proof_file(design.proof),
        sector=_sector_file(chart.cell),
        bodies=_bodies_file(design),
    )


def _bodies_file(design: CellDesign) -> _BodiesFile | msgspec.UnsetType:
    """Compute the fingerprints of the bodies of a design; UNSET if its body distance is not known.

    With UNSET, the file has no fingerprints.
    """
    if np.isnan(design.body_distance):
        return msgspec.UNSET
    task = design.task
    places = _bodies_at(task, check_configurations(task)).tolist()
    return _BodiesFile(_shapes_fingerprint(task), places)


def _known_distance(content: _CellFile, task: Task) -> float:
    """Return the body distance of a file, m; NaN with a warning if the bodies have changed.

    The distance is infinite if there are no bodies. If a file has no fingerprint of the bodies, the
    result is the file's distance, or NaN if the file has no distance.
    """
    distance, bodies = content.figures.body_distance, content.bodies
    if isinstance(bodies, msgspec.UnsetType):
        return np.nan if distance is None else distance
    now = _bodies_at(task, configurations(content.task))
    changed = (
        "their shapes or mesh files"
        if bodies.shapes != _shapes_fingerprint(task)
        else "their places"
        if not np.allclose(bodies.places, now, rtol=0, atol=1e-8)
        else ""
    )
    if not changed:
        return np.inf if distance is None else distance
    warnings.warn(
        f"the cell's body distance and collisions were dropped: the bodies of {task.robot.name} "
        f"have changed since ({changed}); design the cell again to evaluate them",
        UserWarning,
        stacklevel=5,
    )
    return np.nan


def _shapes_fingerprint(task: Task) -> str:
    """Compute the fingerprint of all collision shapes of a robot and its surroundings.

    The fingerprint covers the sizes of the shapes, their places on their links, the content of
    their mesh files, and the pairs of links that the SRDF disables. If a file has another
    fingerprint, its body distance is dropped.
    """
    robot = task.robot
    entry = robot.entry
    srdf = None if entry is None else entry.srdf
    pairs = [] if srdf is None else sorted(map(sorted, disabled_pairs(srdf)))
    parts = [
        [_solid(solid, description, robot.package_dirs) for solid in description.collisions]
        for description in (robot.description, robot.surroundings)
        if description is not None
    ]
    return fingerprint(parts, pairs)


def _bodies_at(task: Task, Q: ArrayLike) -> Array:
    """Compute, per configuration of Q (K, n), a number that changes if any body is displaced: (K,).

    The number is a weighted sum of all entries of the placements of the links and surroundings with
    bodies.
    """
    robot = task.robot
    model, drive = task.bodies_model()
    data = model.createData()
    frames = link_frames(model)
    links = dict.fromkeys(solid.link for solid in robot.description.collisions)
    standing = []
    if robot.surroundings is not None:
        places = fixed_placements(robot.surroundings)
        standing = [places[solid.link] for solid in robot.surroundings.collisions]
    Q = np.asarray(Q, float)
    sums = []
    for q in drive.joints(Q):
        pin.forwardKinematics(model, data, q)
        moved = [data.oMi[frames[link].parentJoint] * frames[link].placement for link in links]
        numbers = np.array([place.homogeneous[:3] for place in moved + standing]).ravel()
        sums.append(float(numbers @ np.sin(1.0 + np.arange(len(numbers)))))
    return np.array(sums)


def _solid(
    solid: Shape, description: Description, package_dirs: tuple[str, ...]
) -> tuple[object, ...]:
    """List the data of a collision shape that a fingerprint hashes.

    The data are link, xyz, rpy, kind, size, scale, and the hash of the mesh file. The hash is
    ``missing`` if the file is not found, and None if the shape is no mesh. ``description`` is the
    URDF that has the shape ``solid``; ``package_dirs`` are folders in which packages are looked up.
    """
    mesh = None
    if solid.filename:
        file = find_mesh(solid.filename, description.path, package_dirs)
        mesh = "missing" if file is None else _content(file, file.stat().st_mtime_ns)
    shape = solid.kind, solid.size, solid.scale, mesh
    return solid.link, solid.xyz, solid.rpy, *shape


@lru_cache(maxsize=256)
def _content(file: Path, changed: int) -> str:
    """Hash the content of a file as a hexadecimal text; cached.

    ``changed`` is the file's modification time, so that a changed file is hashed again.
    """
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _sector_file(cell: Cell) -> _SectorFile | msgspec.UnsetType:
    """Convert the coordinates of a sector to plain data; UNSET for a box, which has none."""
    if not isinstance(cell, Sector):
        return msgspec.UNSET
    symmetric = [one.coordinate for one in cell.removed]
    return _SectorFile(
        cell.axis.tolist(),
        list(cell.free),
        symmetric,
        cell.spin_middle if cell.tilted and SPIN in cell.free else msgspec.UNSET,
        np.array(cell.profile).tolist() if cell.profile.degree else msgspec.UNSET,
    )


def _cell(content: _CellFile, task: Task) -> Cell:
    """Create the cell of a file: a box of poses, or a sector.

    Symmetric coordinates of a sector are not part of u.

    InputError is raised if the numbers do not describe a cell of this task.
    """
    widths, at, positions = (np.array(content.widths), np.array(content.placement), min(3, task.m))
    if widths.shape != (task.m,) or at.shape != (4, 4):
        raise InputError(
            f"the cell of the file must have {task.m} widths, one per task coordinate, and a "
            "placement of 4 × 4 numbers; design the cell again"
        )
    if not np.array_equal(at[3], [0.0, 0.0, 0.0, 1.0]):
        raise InputError(
            "the last row of the cell's placement must be 0, 0, 0, 1; design the cell again"
        )
    data = content.sector
    if isinstance(data, msgspec.UnsetType):
        turns = widths[positions:] if task.m > positions else 0.0
        return Cell(task, pin.SE3(at), widths[:positions], turns)
    w = np.pad(widths, (0, 6 - task.m))
    names: dict[str, Any] = {
        "radius": w[0],
        "angle": w[1],
        "height": w[2],
        "half_angle": w[3:5],
        "spin": w[5],
    }
    return _as_stored(Sector(task, pin.SE3(at), **names, axis=data.axis), data)


def _as_stored(sector: Sector, data: _SectorFile) -> Sector:
    """Restore the profile, the symmetries and the middle of the spin of a sector from its file.

    InputError is raised if these do not fit the sector.
    """
    if not isinstance(data.profile, msgspec.UnsetType):
        sector = sector._profiled_by(np.array(data.profile))
    used = [one for one in sector.symmetries if one.coordinate in data.symmetric]
    if [one.coordinate for one in used] != data.symmetric or not {*data.free} <= {*data.symmetric}:
        raise InputError(
            "the file uses a symmetry that the arm does not have; design the cell again"
        )
    sector = sector.without(used, data.free)
    middle, moved = data.spin_middle, sector.tilted and SPIN in data.free
    if isinstance(middle, msgspec.UnsetType):
        if moved:
            raise InputError(
                "the file lacks the middle of the spin, because an older version wrote it, with "
                "tilts about the wrong axes; design the cell again"
            )
        return sector
    if not moved or abs(middle) > 2 * np.pi:
        raise InputError(
            "the middle of the spin must be from −2π to 2π rad, and is stored only for a sector "
            "with tilts and the spin range 'all'; design the cell again"
        )
    return sector.turned({SPIN: middle}, {SPIN: float(sector.widths[SPIN])})


def cell_of(content: _CellFile, task: Task) -> CellDesign:
    """Create the design of a cell's function for a task from the content of a file.

    Raises
    ------
    InputError
        If the content does not describe a valid design for this task.
    """
    if not content.degrees:
        raise InputError(
            "a cell's file must name at least one polynomial degree that was tried; "
            "design the cell again"
        )
    degree = as_int(content.degree, "the degree of a cell's polynomials", 0, _MOST_DEGREE)
    # the cell, and coefficients of the due shape
    cell = _cell(content, task)
    C, due = (np.array(content.coefficients), (comb(cell.k + degree, cell.k), task.n, 1 + task.r))
    if C.shape != due:
        raise InputError(
            f"the coefficients must be {due[0]} × {due[1]} × {due[2]} numbers; "
            f"they have shape {C.shape}; design the cell again"
        )
    figures = content.figures
    if any(len(reason.u) != cell.whole.k for reason in figures.failures):
        raise InputError(
            f"each pose of the cell at which the function failed must be {cell.whole.k} numbers; "
            "design the cell again"
        )
    # figures that older files lack
    if figures.limit_margin_worst is None:  # infinite, or not in older files
        figures.limit_margin_worst = figures.limit_margin
    if figures.attainable_margin_worst is None:
        figures.attainable_margin_worst = figures.attainable_margin
    # bodies that have changed since are not known
    distance = _known_distance(content, task)
    failures = tuple(
        made(FailureReason, reason)
        for reason in figures.failures
        if reason.cause != "collision" or not np.isnan(distance)
    )
    evaluation = made(
        Evaluation,
        figures,
        body_distance=distance,
        nearest_bodies=("", "") if np.isnan(distance) else figures.nearest_bodies,
        failures=failures,
        turns=tuple(made(Turn, turn) for turn in figures.turns),
        leaf_margin=np.nan if figures.least_leaf_margin is None else figures.least_leaf_margin,
    )
    # the function on its chart
    chart = Chart(cell, Monomials(cell.k, degree), C)
    return made(
        CellDesign,
        content,
        function=function_of(chart, evaluation),
        desired=desired_of(content.desired, task),
        posture=task.check(content.posture, "the posture"),
        evaluation=evaluation,
        proof=proof_of(content.proof),
    )


def _unchecked(content: _CellFile, task: Task) -> list[str]:
    """Refuse a robot that has changed since the file was written; return what cannot be checked.

    If a joint limit or a mass differs, an InputError is raised. Older files lack limits, masses or
    collision bodies; the names of the missing data are returned.
    """
    known = content.bodies is not msgspec.UNSET
    return [
        *require_ranges(content.task, task, speeds=False),
        *([] if known else ["the collision bodies"]),
        *require_masses(content.desired, content.task, task),
    ]


KIND = FileKind(_CellFile, CellDesign, cell_file, cell_of, _unchecked)


def load_cell(path: str | Path, task: Task | None = None) -> CellDesign:
    """Read a function over a cell from a file, and check that it was made for this task.

    Parameters
    ----------
    path
        A file that :func:`save` wrote.
    task
        Task to control, which must be that of the file; by default created from the robot
        catalogue. Required if the robot is not in the catalogue.

    Returns
    -------
    CellDesign

    Raises
    ------
    InputError
        If the file holds a repeatable inverse, is no design file, was changed after it was written,
        or is for another robot or task; or if the robot has changed since.

    Examples
    --------
    >>> again = rp.load_cell(rp.save(found, "cell.json"), task)
    >>> again.cost == found.cost
    True
    """
    design = load(path, task)
    if isinstance(design, CellDesign):
        return design
    raise InputError(f"{path} holds a repeatable inverse; use rp.load_design")
