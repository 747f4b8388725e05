"""Export of a repeatable inverse or a cell function as C files for a robot's control loop.

Test vectors, which are inputs with Python's results for them, are also exported. They check a build
on the robot's computer. A repeatable inverse keeps r potentials, functions of q, constant. Ω is the
region of joint space, or the cell of poses, of the design. The closing radius, a part of the
design's certificate, is the distance from a start or a path within which closed paths are proved to
end in the configuration that they began in. The function of a cell is q = F(x; c), with the pose x
and the level c (r,), which is the position along the self-motion. n is the number of joints.

``Source`` is the texts of the C header and of the C source file, and parts of the C++ header.
``Bounded`` is a region of joint space that computes how far inside or outside configurations lie.
``Vector`` is a test vector: a configuration, and the other inputs of the exported C functions.
"""

from __future__ import annotations

import hashlib
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ...._version import __version__
from ....base.arguments import Array, file_name, require_type
from ....base.certificate import ClosingRadius
from ....base.errors import InputError
from ....base.files import write_whole, written_together
from ....regions import Region
from ....regions.region import A_REGION
from ....strategies.repeatable import Bounded, RepeatableInverse
from ...cells.chart.chart import CellPotentials
from ...cells.function import InverseFunction
from ...cells.geometry.cell import Cell
from ...cells.geometry.sector import Sector
from .c_names import checked_name
from .c_text import filled, initialiser
from .kdl import kdl_header, quoted
from .source import Source, about, region_of, write_source
from .test_vectors import BAD_NUMBER, OUTSIDE, STATUS, Vector, answers, asked, targets, vectors

_SIGNED = "written by repctl_pin"

_LOW = 0.03
"""Largest half-height of the example loop in a sector whose range of radius depends on the height,
m."""


def export_c(
    control: RepeatableInverse | InverseFunction,
    folder: str | Path,
    name: str = "arm_control",
    *,
    region: Region | None = None,
    closes: ClosingRadius | None = None,
) -> list[Path]:
    """Export a repeatable inverse or a cell function as C99, with C++17 interfaces.

    In the names below, ``name`` stands for the argument ``name``. ``name.h`` and ``name.c`` depend
    on ``<math.h>`` only. These files define the functions placement, jacobian, inverse, leaf,
    velocity, step, torque and inside, with the prefix ``name_``; ``step``, for example, is
    :meth:`RepeatableInverse.step`. The functions do not allocate memory, keep no state, and return
    a status. ``name.hpp`` has these functions with ``std::array``, and ``name_kdl.hpp`` has solvers
    of Orocos KDL. The program ``check.c`` compares a build with Python's results in
    ``test_vectors.h``. ``loop.c`` is an example of a control loop at 1 kHz, and ``CMakeLists.txt``
    builds all. The output is deterministic.

    ``name_governor_step`` is :class:`Governor` in C, which stays within the limits at run time. The
    state of the governor is a struct that the caller owns.

    Parameters
    ----------
    control
        Inverse, such as ``design.inverse``, with potentials that are polynomials, Fourier series,
        or their sums. Or the function of a cell, such as ``found.function``, which is exported as
        ``name_F``, together with its inverse.
    folder
        Folder for the files, created if it does not exist.
    name
        Prefix of the files and of every name in C.
    region
        Region, such as ``design.region``, that ``name_inside`` checks and from which the test
        vectors are sampled. The default is the inverse's own Ω; for the function of a cell, and for
        the inverse of this function, Ω is the cell. With the option ``stay_inside = 1``,
        ``name_step`` refuses a step from a q outside the region, or to a q beyond the joint limits.
    closes
        Closing radius of the design's certificate, ``design.proof.closes``. With this argument,
        ``name_within_closing_radius`` tests whether a pose is within the radius.

    Returns
    -------
    list of Path
        Paths of the files written.

    Raises
    ------
    InputError
        If the name is not an identifier; if the inverse or the region contains user-defined
        functions; or if the folder cannot be written to, contains the export of another inverse, or
        contains a file of one of these names that was edited, or that repctl_pin did not write.

    Examples
    --------
    >>> files = rp.export_c(design.inverse, "c", name="planar")
    >>> sorted(file.name for file in files)[:4]
    ['CMakeLists.txt', 'check.c', 'loop.c', 'planar.c']
    """
    name, folder = checked_name(name), file_name(folder, "folder")
    if region is not None:
        require_type(region, Region, "region", A_REGION)
    if closes is not None:
        require_type(closes, ClosingRadius, "closes", "design.proof.closes")
    source = write_source(control, name, region, closes=closes)
    texts = _texts(control, name, source, region)
    where = Path(folder)
    for other in where.glob("*.hpp"):
        stem = other.stem.removesuffix("_kdl")
        if name not in (stem, other.stem) and where.joinpath("test_vectors.h").exists():
            raise InputError(
                f"{where} already contains the export {stem!r}: an export requires a folder of "
                "its own; choose another folder"
            )
    for file in texts:
        _refuse_foreign(where / file)
    with written_together(where) as staged:
        for file, text in texts.items():
            write_whole(staged / file, _signed(file, text))
    return [where / file for file in texts]


def _texts(
    control: RepeatableInverse | InverseFunction, name: str, source: Source, region: Region | None
) -> dict[str, str]:
    """Compose the texts of all exported files, by file name.

    ``name`` is the prefix of the files and of the C functions; ``source`` has the texts of header
    and source file, and parts of the C++ header. The test vectors lie in ``region``; with None, in
    the inverse's own Ω.
    """
    if isinstance(control, InverseFunction):
        inverse = control.inverse
        declared, functions = (filled("function.hpp", name, {}), _function_vectors(control, name))
    else:
        inverse = control
        declared = functions = ""
    kept = region_of(inverse, region)
    start = _start(inverse, kept)
    found = [(vector, answers(inverse, kept, vector)) for vector in vectors(inverse, kept, start)]
    parts = {
        "about": about(control, kept),
        "count": len(found),
        "vectors": ",\n".join(_vector(v, said, inverse, name) for v, said in found),
        "function": declared,
        "governor": source.governor,
        "closing": source.closing,
        "functions": functions,
        "torque": filled("torque.hpp", name, {}),
        "names": "{" + ", ".join(map(quoted, control.task.joint_names)) + "}",
        "frame": quoted(control.task.frame),
    }
    return {
        f"{name}.h": source.header,
        f"{name}.c": source.code,
        f"{name}.hpp": filled("arm.hpp", name, parts),
        f"{name}_kdl.hpp": kdl_header(control, name, about(control, kept), start),
        "test_vectors.h": filled("test_vectors.h", name, parts),
        "check.c": filled("check.c", name, {}),
        "loop.c": filled("loop.c", name, {"start": initialiser(start)} | _loop(inverse, kept)),
        "CMakeLists.txt": filled("CMakeLists.txt", name, {}),
    }


def _signed(file: str, text: str) -> str:
    """Put a comment line before the text of ``file``: origin, version and checksum of the text.

    The checksum prevents a later export from overwriting an edited file.
    """
    said = f"{_SIGNED} {__version__}; checksum of the lines below: {_checksum(text.encode())}"
    return f"# {said}\n{text}" if file == "CMakeLists.txt" else f"/* {said} */\n{text}"


def _checksum(text: bytes) -> str:
    """Hash the text of a file: 16 hex digits."""
    return hashlib.sha256(text).hexdigest()[:16]


def _refuse_foreign(path: Path) -> None:
    """Raise InputError for a file that repctl_pin did not write, or that was edited afterwards.

    The export would overwrite such a file. The first line of each exported file has a checksum of
    its other lines.
    """
    if not path.is_file():
        return
    with path.open("rb") as file:
        first = file.readline(200)
        ours = _SIGNED.encode() in first and _checksum(file.read()).encode() in first
    if not ours:
        raise InputError(
            f"{path} is not overwritten: it was not written by repctl_pin, or was edited since; "
            "choose another folder, or move that file"
        )


def _start(inverse: RepeatableInverse, region: Bounded | None) -> Array:
    """Choose the configuration (n,) at which the example and the test vectors begin.

    For a cell, the result is F(x; 0) at the middle pose x of the cell. For any other region, it is
    the region's centre; without a region, it is the task's reference configuration.
    """
    if isinstance(region, Cell) and isinstance(inverse.potentials, CellPotentials):
        return InverseFunction(inverse.potentials.chart)(region.placement)
    return region.center if isinstance(region, Region) else inverse.task.reference


def _loop(inverse: RepeatableInverse, region: Bounded | None) -> dict[str, str]:
    """Write the closed path of the example ``loop.c`` as C text, by name: ``along`` and ``radii``.

    The path is an ellipse, ``p = p_0 + r_1 a_1 (cos s − 1) + r_2 a_2 sin s``, from the start p_0 of
    the frame, with the rows a_1 and a_2 of ``along`` and the radii r_1 and r_2, m. The orientation
    is constant. If Ω is a cell, the path lies inside. A sector is a cell in cylindrical
    coordinates: radius, angle and height. In a sector, the orientation of a pose depends on the
    angle, so the path lies at a constant angle, in the plane of radius and height. A planar task
    has no height and leaves the orientation free; the path then extends along radius and angle.
    """
    axes = [int(axis) for axis in inverse.task.rows if axis < 3]
    along, most = np.eye(3)[axes], np.full(len(axes), np.inf)
    if isinstance(region, Sector):
        outward, around, up = region.directions
        radius, angle, *height = region.widths
        along = np.stack([outward, up if height else around])
        chord = (region.middle[0] - radius) * np.sin(min(angle, np.pi / 2))
        if region.profile.degree:  # a rectangle that is inside at all its heights
            height = [min(height[0], _LOW)]
            z = region.middle[1] + np.linspace(-height[0], height[0], 9)
            radius = float(np.abs(region.radii(z) - region.middle[0]).min())
        most = np.array([radius, height[0] if height else chord])
    elif isinstance(region, Cell):
        most = region.half_width
    first, second = np.argsort(-most, kind="stable")[:2]
    radii = min(0.02, 0.45 * most[first]), min(0.02, 0.9 * most[second])
    rows = ",\n".join(f"        {initialiser(along[k])}" for k in (first, second))
    return {"along": rows, "radii": initialiser(radii)}


def _vector(vector: Vector, said: dict[str, Any], inverse: RepeatableInverse, name: str) -> str:
    """Write a test vector, and Python's results for it, as the C initialiser of a struct.

    ``said`` is the dict that :func:`answers` returns for the vector, and ``name`` is the prefix of
    all exported C names.
    """
    task = inverse.task
    limit = np.full(task.n, np.inf) if vector.limit is None else vector.limit
    gain = -1.0 if vector.gain is None else vector.gain
    r, nowhere = np.zeros(task.r), (pin.SE3.Identity(),) * len(task.frames)
    codes = ("usable", "inside", "velocity", "step", "torque")
    entries = [
        vector.q,
        vector.xdot,
        vector.target,
        vector.dt,
        *_optional(vector.twist, task.twist_size),
        *_optional(vector.leaf, task.r),
        (gain, limit, vector.damping, vector.stay_inside),
        vector.joint_speed,
        np.ravel(vector.M),
        vector.bias,
        vector.gains,
        *_optional(vector.observer, task.r),
        *(f"{name.upper()}_{STATUS[said[code]]}" for code in codes),
        said.get("placement", nowhere),
        np.ravel(said.get("J", np.zeros((task.m, task.n)))),
        said.get("c", r),
        said["qdot"],
        said["q_next"],
        said["tau"],
        said.get("observer", r),
    ]
    return "    {" + ",\n     ".join(map(initialiser, entries)) + "}"


def _optional(given: Array | None, size: int) -> tuple[int, Array]:
    """Convert an optional vector for C: (1, vector) or, if it is None, (0, zeros (size,))."""
    return int(given is not None), np.zeros(size) if given is None else given


def _function_vectors(function: InverseFunction, name: str) -> str:
    """Write C test vectors of a cell's function q = F(x; c): targets, levels, statuses and q.

    Targets lie inside and outside the cell; outside, the status is OUTSIDE. ``name`` is the prefix
    of all exported C names.
    """
    rows = []
    for target, leaf in targets(function):
        status, q = asked(partial(function, target, leaf=leaf), function.task.n)
        # targets are valid placements, so the cell is the only cause
        status = OUTSIDE if status == BAD_NUMBER else status
        entries = (target, leaf, f"{name.upper()}_{STATUS[status]}", q)
        rows.append(f"    {initialiser(entries)}")
    return filled("function_vectors.h", name, {"count": len(rows), "vectors": ",\n".join(rows)})
