"""Catalogue of known robots: URDF, task frames and reference pose of each.

The table is ``arms.toml`` beside this file; it is not read on import. The reference pose is the
usual configuration of a robot; joints that a task does not move are held there.

``Entry`` is a robot of the catalogue: its files, its frames and its reference pose.
"""

from __future__ import annotations

import functools
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..base.errors import InputError, unknown

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

READY = "ready.srdf"
"""Name of the SRDF file in ``urdf/`` that contains the ready poses."""

_DATA = "share/example-robot-data/robots"


@dataclass(frozen=True)
class Entry:
    """Catalogue entry of one robot: its files, its usual frames and its reference pose.

    Attributes
    ----------
    name : str
        Name in the catalogue.
    urdf : Path
        URDF file.
    srdf : Path or None
        SRDF file with the reference pose; None if there is none.
    package_dirs : tuple of str
        Folders in which its ``package://`` meshes are looked up.
    frames : tuple of str
        Links to offer as frames of a task; the first is the default.
    posture : str or None
        ``group_state`` of the SRDF used as the reference pose. Joints that it omits are at
        mid-range.
    note : str
        Note for the user on this robot; empty if there is none.
    ready : str or None
        Name of a working pose in ``ready.srdf`` of this package; given if the reference pose is
        singular or at a limit.
    acceleration : str or None
        Name of its published acceleration limits, for :class:`Limits`.
    """

    name: str
    urdf: Path
    srdf: Path | None
    package_dirs: tuple[str, ...]
    frames: tuple[str, ...]
    posture: str | None = None
    note: str = ""
    ready: str | None = None
    acceleration: str | None = None


def entries() -> tuple[Entry, ...]:
    """Return the entries of all robots in the catalogue.

    Raises
    ------
    InputError
        If the data of example-robot-data is not installed.
    """
    return tuple(_entry(name, row) for name, row in table().items())


def find(name: str) -> Entry:
    """Find a robot by its name or an alias, in upper or lower case.

    Raises
    ------
    InputError
        If there is no such robot (the message suggests the closest names), or its data is not
        installed.
    """
    rows = table()
    names = {
        alias: known for known, row in rows.items() for alias in (known, *row.get("aliases", ()))
    }
    known = names.get(str(name).strip().lower())
    if known is None:
        listing = "(`repctl robots` lists all names); for any other robot, give its URDF file"
        raise unknown("robot", name, rows, aliases=names, listing=listing)
    return _entry(known, rows[known])


@functools.cache
def table() -> dict[str, dict[str, Any]]:
    """Read ``arms.toml``: a dict from the name of each known robot to its settings; cached."""
    return tomllib.loads((Path(__file__).parent / "arms.toml").read_text("utf-8"))


def urdf_folder() -> Path:
    """Find the folder ``urdf/`` of this package, in an installation or a checkout.

    InputError is raised if neither has it.
    """
    here = Path(__file__).resolve().parent
    for folder in (here / "files", here.parents[1] / "urdf"):
        if (folder / READY).is_file():
            return folder
    raise InputError("the folder urdf/ of repctl-pin is missing; reinstall the package")


@functools.cache
def _data_folder() -> Path:
    """Find the ``robots`` folder of example-robot-data.

    Raises
    ------
    InputError
        If the package is not installed.
    """
    places = [Path(place) / "cmeel.prefix" / _DATA for place in sys.path] + [
        Path(sys.prefix) / _DATA
    ]
    for place in places:
        if place.is_dir():
            return place
    raise InputError(
        "example-robot-data is not installed; run `pip install 'example-robot-data>=6,<7'`"
    )


def reference_posture(srdf: Path, state: str | None = None) -> dict[str, float]:
    """Read a pose from a ``group_state`` of an SRDF: joint values, rad or m, by joint name.

    Joints with several coordinates (a floating base) are omitted, and a robot name before a slash
    is removed (``baxter/left_s0``).

    Parameters
    ----------
    srdf
        SRDF file.
    state
        Name of the ``group_state``; by default the first that names a joint.

    Raises
    ------
    InputError
        If the file cannot be read, has no such state, or a joint value in it is not a finite
        number.
    """
    from .urdf_rules import finite

    root = _read_srdf(srdf)
    states = {group.get("name"): group for group in root.iter("group_state")}
    if state is None:
        state = next(
            (name for name, group in states.items() if group.find("joint") is not None), None
        )
    if state not in states:
        raise unknown(f"group_state in {srdf}", state, states)
    posture = {}
    for joint in states[state].iter("joint"):
        words = joint.get("value", "").split()
        if len(words) == 1:
            value = finite(words[0])
            if value is None:
                raise InputError(
                    f"{srdf}: {joint.get('name')} = {words[0]!r} is not a finite number; correct it"
                )
            posture[joint.get("name", "").rpartition("/")[2]] = value
    return posture


def disabled_pairs(srdf: Path) -> set[frozenset[str]]:
    """Read the pairs of links whose collision checks an SRDF disables.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    pairs = _read_srdf(srdf).iter("disable_collisions")
    return {
        frozenset(pair.get(key, "").rpartition("/")[2] for key in ("link1", "link2"))
        for pair in pairs
    }


def _read_srdf(srdf: Path) -> Any:
    from lxml import etree

    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False
    )
    try:
        return etree.fromstring(Path(srdf).read_bytes(), parser)
    except (OSError, etree.XMLSyntaxError) as error:
        raise InputError(f"{srdf}: cannot be read as SRDF ({error}); check the file") from error


def default_package_dirs(urdf_path: str | Path) -> list[str]:
    """Find the folders in which the ``package://`` names of a URDF file are looked up.

    They are the parent folders of the file, nearest first, then those in ``ROS_PACKAGE_PATH`` and
    ``AMENT_PREFIX_PATH``.
    """
    folders = list(Path(os.path.expanduser(urdf_path)).absolute().parents)
    for place in filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)):
        # the variable can name a workspace or a package
        folders += [Path(place), Path(place).parent]
    for place in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        folders.append(Path(place) / "share")
    return [str(folder) for folder in dict.fromkeys(folders) if folder.is_dir()]


def _entry(name: str, row: dict[str, Any]) -> Entry:
    ours = "/" not in row["urdf"]
    robots = urdf_folder() if ours else _data_folder()
    srdf = row.get("srdf")
    return Entry(
        name=name,
        urdf=robots / row["urdf"],
        srdf=None if srdf is None else (robots if "/" in srdf else urdf_folder()) / srdf,
        package_dirs=() if ours else (str(robots.parents[1]),),
        frames=tuple(row["frames"]),
        **{key: row[key] for key in ("posture", "note", "ready", "acceleration") if key in row},
    )
