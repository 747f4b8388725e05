"""Fields, regions and desired inverses as plain data (for JSON), and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import InputError
from ..fields import Field, Fourier, Joined, Polynomial
from ..regions import Box, Region
from ..regions.tube import Tube
from ..regions.workspace_box import WorkspaceBox
from ..robot.task import Task
from ..strategies import Inverse, Pseudoinverse, WeightedInverse

Plain = dict[str, Any]


def encode_field(field: Field) -> Plain:
    """Turn a family of potentials into plain data.

    Raises
    ------
    InputError
        If it holds functions of a person's own, which no file can hold.
    """
    if isinstance(field, Polynomial):
        return {
            "kind": "polynomial",
            "center": field.center.tolist(),
            "degree": field.degree,
            "scale": field.scale.tolist(),
            "variables": list(field.variables),
            "cross": field.cross,
        }
    if isinstance(field, Fourier):
        return {
            "kind": "fourier",
            "n": field.n,
            "order": field.order,
            "variables": list(field.variables),
            "period": field.period.tolist(),
            "cross": field.cross,
        }
    if isinstance(field, Joined):
        return {"kind": "joined", "parts": [encode_field(part) for part in field.parts]}
    raise InputError(
        f"{field!r} cannot be saved: a file holds polynomials and Fourier series, no functions of your own"
    )


def decode_field(data: Plain) -> Field:
    """Make a family of potentials from plain data."""
    kind = data.get("kind")
    if kind == "polynomial":
        options = _take(data, "center", "degree", "scale", "variables", "cross")
        return Polynomial(**options)
    if kind == "fourier":
        options = _take(data, "n", "order", "variables", "period", "cross")
        return Fourier(options.pop("n"), options.pop("order"), **options)
    if kind == "joined":
        return Joined(*(decode_field(part) for part in _take(data, "parts")["parts"]))
    raise InputError(f"no kind of fields {kind!r}; there is polynomial, fourier, joined")


def encode_region(region: Region) -> Plain:
    """Turn a region into plain data.

    Raises
    ------
    InputError
        If it has a density, or is of a person's own kind.
    """
    if isinstance(region, (Box, Tube, WorkspaceBox)) and region.density is not None:
        raise InputError(
            "a region with a density of your own cannot be saved, for a file holds no functions; "
            "save dataclasses.replace(design, region=…) with one without"
        )
    if isinstance(region, Box):
        return {"kind": "box", "center": region.center.tolist(), "half_width": region.half_width.tolist()}
    if isinstance(region, Tube):
        return {"kind": "tube", "samples": region.samples.tolist(), "radius": region.radius.tolist()}
    if isinstance(region, WorkspaceBox):
        return {
            "kind": "workspace",
            "position": region.position.tolist(),
            "half_width": region.half_width.tolist(),
            "within": encode_region(region.within),
        }
    raise InputError(f"a region {type(region).__name__} cannot be saved; a file holds boxes, tubes and workspace boxes")


def decode_region(data: Plain, task: Task) -> Region:
    """Make a region from plain data."""
    kind = data.get("kind")
    if kind == "box":
        return Box(**_take(data, "center", "half_width"))
    if kind == "tube":
        return Tube(**_take(data, "samples", "radius"))
    if kind == "workspace":
        options = _take(data, "position", "half_width", "within")
        within = decode_region(options["within"], task)
        if not isinstance(within, Box):
            raise InputError("a workspace box lies within a box of joints")
        return WorkspaceBox(task, options["position"], options["half_width"], within=within)
    raise InputError(f"no kind of region {kind!r}; there is box, tube, workspace")


def encode_desired(desired: Inverse) -> Plain:
    """Turn a desired inverse into plain data.

    Raises
    ------
    InputError
        If it holds functions of a person's own.
    """
    if isinstance(desired, Pseudoinverse):
        return {"kind": "pseudoinverse"}
    if isinstance(desired, WeightedInverse) and not callable(desired.weight):
        weight = desired.weight
        return {"kind": "weighted", "weight": weight if isinstance(weight, str) else np.asarray(weight).tolist()}
    raise InputError(
        f"a design whose desired inverse is a {type(desired).__name__} of your own cannot be saved, for a file holds "
        "no functions; save dataclasses.replace(design, desired=rp.Pseudoinverse(design.task)) to keep the result alone"
    )


def decode_desired(data: Plain, task: Task) -> Inverse:
    """Make a desired inverse from plain data."""
    kind = data.get("kind")
    if kind == "pseudoinverse":
        return Pseudoinverse(task)
    if kind == "weighted":
        return WeightedInverse(task, _take(data, "weight")["weight"])
    raise InputError(f"no desired inverse {kind!r}; there is pseudoinverse, weighted")


def _take(data: Plain, *names: str) -> Plain:
    """Take exactly these entries beside ``kind``."""
    missing = [name for name in names if name not in data]
    extra = sorted(set(data) - set(names) - {"kind"})
    if missing or extra:
        raise InputError(f"{data.get('kind')}: {'no ' + missing[0] if missing else 'unknown entry ' + repr(extra[0])}")
    return {name: data[name] for name in names}
