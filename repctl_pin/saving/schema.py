"""Schema of design files: a msgspec class for each part of a file.

The decoder uses these classes, and ``docs/design.schema.json`` is made from them. For each object
that a design contains, there are two functions: ``…_file`` converts the object to its part of a
file, and ``…_of`` creates the object from that part. A part that an older file lacks is UNSET,
msgspec's value for a missing key. The check configurations of a task are four configurations, in
its ``fingerprint``, at which a robot is compared with the one in the file.

``ProofFile`` is the stored bounds that are proved over a region or cell. ``PotentialBasis`` is a
basis of N functions of q, whose combinations are the potentials h of a design. ``Cycle`` is one
cycle of a motion that ends in its start: start configuration, path and period, s. ``CycleFile`` is
the stored cycle of a design: start configuration, path and period. ``PathFile`` is the stored
closed path of a frame, as polynomial pieces. ``Region`` is a part Ω of joint space, such as a box.
``Inverse`` is a matrix function G(q) (n, m) with J G = I, evaluated at q (n,) or Q (K, n).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec
import numpy as np

from ..base.certificate import CHECKED_BEFORE, ClosingRadius, Proof
from ..base.errors import InputError
from ..design.proof_fingerprint import check_configurations, points_at
from ..model.task import Task
from ..paths.polynomial_pieces import Piece, path_of, pieces_of
from ..paths.several_paths import joined, paths_of
from ..paths.task_path import Cycle, TaskPath
from ..potentials import Joined, Polynomial, PotentialBasis
from ..potentials.arm_angle import ArmAngle
from ..potentials.fourier import Fourier
from ..regions import Box, Region, Tube, WorkspaceBox
from ..strategies import Inverse, Pseudoinverse, WeightedInverse
from ..strategies.limit_weight import LimitWeight

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

VERSION = 2
"""Version of the schema, which a file gives as ``schema``; files of other versions are refused."""

Row = list[float]
Rows = list[list[float]]


_NULLS = dict.fromkeys(
    (
        "limit_margin",
        "attainable_margin",
        "limit_margin_worst",
        "attainable_margin_worst",
        "body_distance",
        "joint_range",
    ),
    np.inf,
) | dict.fromkeys(("extra_speed_direction", "nearly", "unasked", "covered", "as_covered"), np.nan)
"""Values, by attribute, that are null in a file: JSON has neither infinity nor NaN."""


class Part(msgspec.Struct, forbid_unknown_fields=True):
    """Base class of all parts of a file; alternatives, such as box and tube, have a ``kind``."""


class PolynomialFile(Part, tag_field="kind", tag="polynomial"):
    """Potentials that are products of Legendre polynomials in ``(q − center) / scale``.

    A potential is a function of the configuration q that the controller holds constant. The
    potentials are sorted by degree, then lexically. Only the joints ``variables``, counted from 0,
    occur. If ``cross`` is false, each product contains only one of them.
    """

    center: Row
    degree: int
    scale: Row
    variables: list[int]
    cross: bool


class FourierFile(Part, tag_field="kind", tag="fourier"):
    """Potentials that are sines and cosines of integer combinations of the joints ``variables``.

    They are sin(k · u) and cos(k · u) with ``u_i = 2π q_i / period_i`` and integers k_i, whose
    absolute values sum to at most ``order``. If ``cross`` is false, only one k_i is not 0. ``n`` is
    the number of joints; ``variables`` are counted from 0.
    """

    n: int
    order: int
    variables: list[int]
    period: Row
    cross: bool


class ArmAngleFile(Part, tag_field="kind", tag="arm-angle"):
    """Arm angle as a potential: the rotation of the elbow about the line from shoulder to wrist.

    ``frames`` are shoulder, elbow and wrist. ``reference`` is the direction, in base axes, from
    which the angle is measured. ``singular`` is the direction from shoulder to wrist, in base axes,
    at which a stereographic arm angle is undefined; null if the arm angle is the conventional one.
    ``points`` are the origins of the three frames, m in the base frame, at each ``q`` of the task's
    ``fingerprint``; if they differ on loading, a frame has moved. Older files lack ``points``.
    """

    frames: tuple[str, str, str]
    reference: Row
    singular: Row | None
    points: list[Rows] | msgspec.UnsetType = msgspec.UNSET


class JoinedFile(Part, tag_field="kind", tag="joined"):
    """Several bases of potentials (functions of q), concatenated in this order."""

    parts: list[BasisFile]


class BoxFile(Part, tag_field="kind", tag="box"):
    """Region Ω of a design, a box of joint space: ``|q_i − center_i| ≤ half_width_i``."""

    center: Row
    half_width: Row


class TubeFile(Part, tag_field="kind", tag="tube"):
    """Region Ω of a design, a tube: ``|q_i − s_i| ≤ radius_i`` for one of the ``samples`` s."""

    samples: Rows
    radius: Row


class WorkspaceFile(Part, tag_field="kind", tag="workspace"):
    """Region Ω of a design: all q in a box of joint space with the frame inside a box of positions.

    The box of joint space is ``within``; the box of positions is ``position ± half_width``, m, in
    the base frame.
    """

    position: Row
    half_width: Row
    within: BoxFile


class PseudoinverseFile(Part, tag_field="kind", tag="pseudoinverse"):
    """Desired inverse J⁺, the pseudoinverse, which the design approximates."""


class WeightedFile(Part, tag_field="kind", tag="weighted"):
    """Desired inverse J⁺_M, which minimises q̇ᵀ M q̇; ``weight`` is M.

    ``weight`` is a list of n numbers, the diagonal of M; a matrix (n, n); or "inertia", for the
    robot's joint-space inertia. The key ``inertia`` then has M, kg m² and kg, at each ``q`` of the
    task's ``fingerprint``; other values on loading show that masses have changed. Older files lack
    this key.
    """

    weight: str | list[float | Row]
    inertia: list[Rows] | msgspec.UnsetType = msgspec.UNSET


class LimitsFile(Part, tag_field="kind", tag="limits"):
    """Desired inverse J⁺_M with a weight M by which joints slow down near their limits.

    The weight of a joint is about 1 in the middle of its range, and 1 + ``gain`` at a limit.
    ``onset`` is the distance from a limit at which the weight rises, as a share of half the joint's
    range.
    """

    gain: float
    onset: float


BasisFile = PolynomialFile | FourierFile | ArmAngleFile | JoinedFile
RegionFile = BoxFile | TubeFile | WorkspaceFile
Desired = PseudoinverseFile | WeightedFile | LimitsFile


class Check(Part):
    """Placement ``[R p]`` (3, 4), m, of the frame in the base frame at a configuration ``q``.

    The placement is computed again when the file is loaded; a difference shows that the robot has
    changed. For a task of F frames, the placements are stacked: (3 F, 4).
    """

    q: Row
    placement: Rows


class JointRange(Part):
    """Limits of one joint; null for no limit.

    ``lower`` and ``upper`` are positions, rad or m; ``velocity`` is a speed, rad/s or m/s.
    """

    lower: float | None
    upper: float | None
    velocity: float | None


class FrameFile(Part):
    """One frame of a task of several frames: its link, its kind of task, and its base link.

    ``base`` is null for the robot's base. The kind is a name such as ``pose`` or ``position``.
    """

    frame: str
    task: str
    base: str | None


class TaskFile(Part):
    """Robot and task of a design; the file is refused for any other robot.

    ``catalogue`` is true if the robot is in the catalogue, and ``file`` is the name of its URDF.
    ``base`` is the link that is the robot's base; null for the root link. ``lock`` lists the locked
    joints, ``task`` is the kind of task, such as ``pose``. ``fingerprint`` holds placements of the
    frame at several configurations, by which a changed robot is detected. ``limits`` are
    the limits of ``joints``; older files lack them. ``frames`` exists only for a task of several
    frames; ``frame`` and ``task`` are then their names and their kinds, joined by " + ". ``tool``
    is the placement (4, 4) of a tool in the link ``frame``, if the task controls the tool.
    ``coordinates`` occurs in older files only: null, or a matrix T (n, n) of joint coordinates ψ
    with q = T ψ; a file with T is refused.
    """

    robot: str
    catalogue: bool
    file: str
    base: str | None
    lock: list[str]
    frame: str
    task: str
    joints: list[str]
    fingerprint: list[Check]
    limits: list[JointRange] | msgspec.UnsetType = msgspec.UNSET
    frames: list[FrameFile] | msgspec.UnsetType = msgspec.UNSET
    tool: Rows | msgspec.UnsetType = msgspec.UNSET
    coordinates: Rows | msgspec.UnsetType | None = msgspec.UNSET

    def found_beside(self, where: str | Path) -> str:
        """Return the path of the robot's file, of which only the name is stored.

        The robot's file is looked for in the working folder, then beside the design's file
        ``where``. If it is in neither folder, the result is ``PATH/name``, in which the user
        replaces ``PATH`` by the folder.
        """
        near = Path(self.file), Path(where).parent / self.file
        return str(next((path for path in near if path.is_file()), Path("PATH", self.file)))


class PieceFile(Part):
    """Polynomial piece of a path from s = ``begin`` to ``end``; s runs from 0 to 1 along a cycle.

    ``coefficients`` has one row per Chebyshev polynomial of ``u = (2 s − begin − end) / (end −
    begin)``, from degree 0 on: x, y, z, m, and, if the frame rotates, a quaternion qx, qy, qz, qw.
    """

    begin: float
    end: float
    coefficients: Rows


class PathFile(Part):
    """Closed path of a frame, as polynomial pieces from s = 0 to 1, which is one cycle.

    ``path`` is the display name. ``spec`` and ``plane`` are the options ``--path`` and ``--plane``
    that recreate the path; empty if there are none. ``rotation`` (3, 3) is the orientation at s =
    0, which the frame keeps if the pieces have positions only.
    """

    path: str
    spec: str
    plane: str
    rotation: Rows
    pieces: list[PieceFile]


class CycleFile(Part):
    """Cycle that a design was made for: start configuration, closed path, and period, s.

    The path is stored as in :class:`PathFile`. ``others`` are the paths of the second and further
    frames, if the task has several.
    """

    start: Row
    period: float
    path: str
    spec: str
    plane: str
    rotation: Rows
    pieces: list[PieceFile]
    others: list[PathFile] | msgspec.UnsetType = msgspec.UNSET


class Figures(Part):
    """Figures of merit of a saved design: cost, margins and errors, as in :class:`Design`.

    They are computed when the design is made, not when it is loaded. ``cost`` is the mean over Ω of
    ‖G_r − G_d‖_F², and ``cost_error`` its standard error. ``relative_distance`` is
    ``√(cost / mean ‖G_d‖_F²)``. ``leaf_margin`` is the smallest leaf margin found in Ω, at the
    configuration ``leaf_margin_at``. ``inside_limits`` is the fraction of Ω inside the joint
    limits. ``fit_cost``, ``gradient_norm``, ``converged`` and ``steps`` are results of the
    optimiser. ``samples`` and ``held_out`` are the numbers of nodes of the fit and of the
    evaluation, and ``seed`` is their random seed. ``dropped`` lists the potentials that were left
    out. ``shrunk`` is the width of Ω divided by the requested width. ``degrees`` has (degree, cost,
    standard error) of each degree tried.
    """

    cost: float
    cost_error: float
    relative_distance: float
    leaf_margin: float
    leaf_margin_at: Row
    inside_limits: float
    fit_cost: float
    gradient_norm: float
    converged: bool
    steps: int
    samples: int
    held_out: int
    seed: int
    dropped: tuple[str, ...]
    shrunk: float
    degrees: tuple[tuple[int, float, float], ...]


class ClosingRadiusFile(Part):
    """Closing radius: closed paths within this radius of a start, or of a path, close.

    The motion along such a path ends in its initial configuration. ``metres`` and ``radians`` are
    the radius in position and orientation; ``radians`` is null if the task commands no orientation.
    ``around`` is ``start`` or ``path``, ``kind`` the kind of task, and ``start`` a configuration.
    ``positions``, m, and ``rotations``, matrices, are those of the start pose, or along the path.
    A proof divides a region into boxes; ``boxes`` is the number of boxes over which bounds were
    computed. ``complete`` is false if the proof ran out of time, and ``reason`` says why the radius
    is not larger. ``checked`` is the number of points at which the path itself was checked to
    close; 0 if that is proved, or for a radius around a start. ``leaf`` is the maximum change of
    each level h(q), from its value at ``start``, that the proof covers.
    """

    metres: float
    radians: float | None
    around: str
    kind: str
    start: Row
    positions: Rows
    rotations: list[Rows]
    boxes: int
    complete: bool
    reason: str
    checked: int = CHECKED_BEFORE
    leaf: float = 0.0


class ProofFile(Part):
    """Bounds that are proved over a whole region or cell.

    They are lower bounds of the leaf margin, the limit margin and σ_min(J). A proof divides the
    region or cell into boxes; ``boxes`` is the number of boxes over which bounds were computed.
    ``worst`` and ``half`` are the centre and the half-widths of one box: the one at which the proof
    failed, otherwise the one with the smallest bound of the leaf margin. ``what`` describes the
    design, ``proved`` is true if all that was required is proved, and ``reason`` is the cause of an
    early end. ``theorem`` is the version of the theorem. Joints in ``excepted`` are left out of the
    limit margin, and ``closes`` is the closing radius. A null ``limit_margin`` means that the robot
    has no joint limits. A null ``asked_leaf_margin`` or ``asked_limit_margin`` means that no such
    bound was required. ``subject`` is a hash of what is proved, and ``seal`` a hash of the whole
    proof; a proof without them, from an older file, is dropped. ``seconds``, the computing time, is
    in older files only.
    """

    what: str
    proved: bool
    leaf_margin: float
    limit_margin: float | None
    sigma_min: float
    boxes: int
    worst: Row
    half: Row
    reason: str
    asked_leaf_margin: float | None
    asked_limit_margin: float | None
    theorem: int
    seconds: float | msgspec.UnsetType = msgspec.UNSET
    excepted: list[str] = []
    closes: ClosingRadiusFile | msgspec.UnsetType = msgspec.UNSET
    subject: str = ""
    seal: str = ""


class Sealed(Part):
    """Fields of every design file: format, schema version, checksum and task.

    ``written_by`` is the version of repctl_pin that wrote the file. The checksum detects files that
    were edited.
    """

    format: str
    schema: int
    written_by: str
    checksum: str
    task: TaskFile


class DesignFile(Sealed):
    """Design of a repeatable inverse, whose motions keep h_j(q) = Σ_i coefficients[i][j] φ_i(q).

    The φ_i are the functions of the basis ``potentials``, in their order. ``desired`` is the
    inverse that the design approximates. ``region`` is the part of joint space, and ``cycle`` the
    motion, for which the design was made; ``cycle`` is null for a design without a path.
    """

    cycle: CycleFile | None
    desired: Desired
    potentials: BasisFile
    region: RegionFile
    coefficients: Rows
    figures: Figures
    proof: ProofFile | msgspec.UnsetType = msgspec.UNSET


P = TypeVar("P", bound=msgspec.Struct)
R = TypeVar("R", bound="DataclassInstance")


def described(kind: type[P], thing: object, **others: Any) -> P:
    """Create a part of a file, of class ``kind``, from the attributes of an object ``thing``.

    Each key of the part gets the value of the attribute with the same name. Arrays become lists;
    some attributes, such as a limit margin without limits, become null if they are not finite.
    ``others`` are the values of keys that are not taken from the object.
    """
    own = {}
    for name in kind.__struct_fields__:
        if name in others:
            continue
        value = getattr(thing, name)
        if isinstance(value, (np.ndarray, np.generic)):
            value = value.tolist()
        if name in _NULLS and not np.isfinite(value):
            value = None
        own[name] = value
    return kind(**own, **others)


def made(kind: type[R], part: msgspec.Struct, **others: Any) -> R:
    """Create an object of the dataclass ``kind`` from a part of a file.

    Each attribute gets the value of the key with the same name. Lists become arrays, and a null
    becomes None or, for numbers that need not be finite, inf or NaN. ``others`` are the values of
    attributes that are not taken from the file.
    """
    own = {}
    for name in kind.__dataclass_fields__:
        if name in others or name not in part.__struct_fields__:
            continue
        value = getattr(part, name)
        if isinstance(value, list):
            value = np.array(value)
        if value is None:
            value = _NULLS.get(name)
        own[name] = value
    return kind(**own, **others)


def proof_file(proof: Proof | None) -> ProofFile | msgspec.UnsetType:
    """Convert a proof to its part of a file.

    The result is UNSET, which omits the key, if there is no proof or nothing is proved.
    """
    if not proof:
        return msgspec.UNSET
    closes: ClosingRadiusFile | msgspec.UnsetType = msgspec.UNSET
    if proof.closes is not None:
        closes = described(ClosingRadiusFile, proof.closes)
    return described(ProofFile, proof, seconds=msgspec.UNSET, closes=closes)


def proof_of(data: ProofFile | msgspec.UnsetType) -> Proof | None:
    """Create a proof from its part of a file; None if the file has none."""
    if isinstance(data, msgspec.UnsetType):
        return None
    part, closes = data.closes, None
    if not isinstance(part, msgspec.UnsetType):
        closes = made(ClosingRadius, part)
    return made(Proof, data, closes=closes)


def basis_file(potentials: PotentialBasis) -> BasisFile:
    """Convert a basis of potentials, the functions φ_i(q) that form h, to its part of a file.

    Raises
    ------
    InputError
        If the basis contains user-defined functions, which cannot be saved.
    """
    if isinstance(potentials, Polynomial):
        return described(PolynomialFile, potentials)
    if isinstance(potentials, Fourier):
        return described(FourierFile, potentials)
    if isinstance(potentials, ArmAngle):
        task, frames = potentials.task, potentials.frames
        points = points_at(task, frames, check_configurations(task)).tolist()
        return described(ArmAngleFile, potentials, points=points)
    if isinstance(potentials, Joined):
        return JoinedFile([basis_file(part) for part in potentials.parts])
    raise InputError(
        f"{potentials!r} cannot be saved: a file holds no user-defined functions; "
        "design with rp.Polynomial, rp.Fourier or rp.ArmAngle"
    )


def basis_of(data: BasisFile, task: Task) -> PotentialBasis:
    """Create a basis of potentials, the functions φ_i(q) that form h, from its part of a file."""
    if isinstance(data, JoinedFile):
        return Joined(*(basis_of(part, task) for part in data.parts))
    if isinstance(data, ArmAngleFile):
        return ArmAngle(task, *data.frames, data.reference, singular=data.singular)
    given = msgspec.structs.asdict(data)
    return Polynomial(**given) if isinstance(data, PolynomialFile) else Fourier(**given)


def region_file(region: Region) -> RegionFile:
    """Convert a region Ω, the part of joint space of a design, to its part of a file.

    Raises
    ------
    InputError
        If the region has a density, or is user-defined.
    """
    if isinstance(region, (Box, Tube, WorkspaceBox)) and region.density is not None:
        raise InputError(
            "a design over a region with a density cannot be saved: a file holds no functions; "
            "save dataclasses.replace(design, region=r), with r the region without density="
        )
    if isinstance(region, Box):
        return described(BoxFile, region)
    if isinstance(region, Tube):
        return described(TubeFile, region)
    if isinstance(region, WorkspaceBox):
        return described(WorkspaceFile, region, within=region_file(region.within))
    raise InputError(
        f"a region of type {type(region).__name__} cannot be saved; "
        "design over an rp.Box, rp.Tube or rp.WorkspaceBox"
    )


def region_of(data: RegionFile, task: Task) -> Region:
    """Create a region Ω, the part of joint space of a design, from its part of a file."""
    if isinstance(data, WorkspaceFile):
        return WorkspaceBox(
            task, data.position, data.half_width, within=Box(**msgspec.structs.asdict(data.within))
        )
    given = msgspec.structs.asdict(data)
    return Box(**given) if isinstance(data, BoxFile) else Tube(**given)


def desired_file(desired: Inverse) -> Desired:
    """Convert a desired inverse, such as J⁺, which a design approximates, to its part of a file.

    Raises
    ------
    InputError
        If the inverse contains user-defined functions.
    """
    if isinstance(desired, Pseudoinverse):
        return PseudoinverseFile()
    if isinstance(desired, WeightedInverse):
        weight = desired.weight
        if isinstance(weight, LimitWeight) and np.array_equal(weight.lower, desired.task.lower):
            return described(LimitsFile, weight)
        if not callable(weight):
            if not isinstance(weight, str):
                return WeightedFile(np.asarray(weight).tolist())
            task = desired.task
            return WeightedFile(weight, task.inertias(check_configurations(task)).tolist())
    raise InputError(
        f"a design with the user-defined desired inverse {type(desired).__name__} cannot be saved: "
        "a file holds no functions; to save the repeatable inverse alone, save "
        "dataclasses.replace(design, desired=rp.Pseudoinverse(design.task))"
    )


def desired_of(data: Desired, task: Task) -> Inverse:
    """Create a desired inverse, which a design approximates, from its part of a file."""
    if isinstance(data, PseudoinverseFile):
        return Pseudoinverse(task)
    weight = (
        LimitWeight(task, data.gain, data.onset) if isinstance(data, LimitsFile) else data.weight
    )
    return WeightedInverse(task, weight)


def cycle_file(cycle: Cycle) -> CycleFile:
    """Convert the cycle of a design (start, closed path, period) to its part of a file."""
    path = cycle.path
    first, *others = paths_of(path)
    return described(
        CycleFile,
        cycle,
        **msgspec.structs.asdict(_path_file(first)),
        others=[_path_file(other) for other in others] or msgspec.UNSET,
    )


def _path_file(path: TaskPath) -> PathFile:
    """Convert the path of one frame to its part of a file, as polynomial pieces.

    Its display name and its options of the command line are stored, too.
    """
    return PathFile(
        path.name,
        path.spec,
        path.plane,
        path.placement(0.0).rotation.tolist(),
        [described(PieceFile, piece) for piece in pieces_of(path)],
    )


def cycle_of(data: CycleFile, task: Task) -> Cycle:
    """Create a cycle (start, closed path, period) from its part of a file.

    Raises
    ------
    InputError
        If a path's pieces do not lead from s = 0 to 1, there is not one path per frame, or the
        period or the start is invalid.
    """
    others = [] if isinstance(data.others, msgspec.UnsetType) else data.others
    parts: list[CycleFile | PathFile] = [data, *others]
    paths = [_path_of(part) for part in parts]
    if len(paths) != len(task.frames):
        raise InputError(
            f"the file has {len(paths)} paths for the {len(task.frames)} frames of the task; "
            "design again"
        )
    if not (0 < data.period < np.inf):
        raise InputError(f"the file's period is {data.period:g} s, not above 0 s; design again")
    path = paths[0] if len(paths) == 1 else joined(task, paths)
    return Cycle(task.check(data.start, "the start"), path, data.period)


def _path_of(data: CycleFile | PathFile) -> TaskPath:
    """Create the path of one frame from its part of a file.

    Raises InputError unless the pieces are in order and lead from s = 0 to 1.
    """
    ends = [0.0, *(piece.end for piece in data.pieces)]
    sizes = {np.shape(piece.coefficients)[1:] for piece in data.pieces}
    starts = [piece.begin for piece in data.pieces]
    if (
        starts != ends[:-1]
        or ends[-1] != 1
        or not (np.diff(ends) > 0).all()
        or sizes not in ({(3,)}, {(7,)})
    ):
        raise InputError("the pieces of the path do not lead from s = 0 to 1; design again")
    pieces = [made(Piece, piece) for piece in data.pieces]
    what = {"name": data.path, "spec": data.spec, "plane": data.plane, "breaks": tuple(ends[1:-1])}
    return path_of(pieces, np.array(data.rotation), **what)
