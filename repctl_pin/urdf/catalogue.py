"""The robots known by name: where the URDF is, which frames to control, which pose to start from.

The table itself is ``arms.toml`` beside this file; importing this module reads nothing.
"""

from __future__ import annotations

import functools
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import InputError, unknown

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

READY = "ready.srdf"
"""Poses of our own, in urdf/, to work from."""

_DATA = "share/example-robot-data/robots"


@dataclass(frozen=True)
class Entry:
    """One robot of the catalogue.

    Attributes
    ----------
    name : str
        Its name here.
    urdf : Path
    srdf : Path or None
        The file that holds its reference pose; None where there is none.
    package_dirs : tuple of str
        Folders that resolve its ``package://`` meshes.
    frames : tuple of str
        The end frames worth offering; the first is the default.
    posture : str or None
        The ``group_state`` of the SRDF that is the reference pose. Joints it does not name are
        meant to stay in the middle of their range.
    note : str
        What a person should know.
    ready : str or None
        A pose in our own ``ready.srdf`` to work from, where the reference is singular or on a
        limit.
    acceleration : str or None
        Whose published accelerations its joints have, by their name in ``motion.timing``.
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
    """List every robot.

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
        If there is no such robot (the nearest names are said), or its data is not installed.
    """
    rows = table()
    names = {
        alias: known for known, row in rows.items() for alias in (known, *row.get("aliases", ()))
    }
    known = names.get(str(name).strip().lower())
    if known is None:
        listing = "(`repctl robots` lists them all); for any other robot give its URDF file"
        raise unknown("robot", name, rows, aliases=names, listing=listing)
    return _entry(known, rows[known])


@functools.cache
def table() -> dict[str, dict[str, Any]]:
    """Read the table of known arms: name → what ``arms.toml`` says of it."""
    return tomllib.loads((Path(__file__).parent / "arms.toml").read_text("utf-8"))


def urdf_folder() -> Path:
    """Find our own ``urdf/``: inside an installed package, or at the top of a checkout."""
    here = Path(__file__).resolve().parent
    for folder in (here / "files", here.parents[1] / "urdf"):
        if (folder / READY).is_file():
            return folder
    raise InputError("the folder urdf/ of repctl-pin is missing; install the package again")


@functools.cache
def data_folder() -> Path:
    """Find the ``robots`` folder of example-robot-data.

    Raises
    ------
    InputError
        If it is not installed.
    """
    places = [Path(place) / "cmeel.prefix" / _DATA for place in sys.path] + [
        Path(sys.prefix) / _DATA
    ]
    for place in places:
        if place.is_dir():
            return place
    raise InputError(
        "the robots of example-robot-data are missing; run `pip install 'example-robot-data>=6,<7'`"
    )


def reference_posture(srdf: Path, state: str | None = None) -> dict[str, float]:
    """Read a pose, joint name → rad or m, from a ``group_state`` of an SRDF.

    Joints of more than one number (a floating base) are left out, and so is a robot's name before a
    slash (``baxter/left_s0``).

    Parameters
    ----------
    srdf
        The file.
    state
        The name of the ``group_state``; by default the first that names a joint.

    Raises
    ------
    InputError
        If the file cannot be read, or has no such state.
    """
    from .checks import finite

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
    """Read the pairs of links that an SRDF says need no look at whether they collide.

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
    """List the folders in which ``package://`` names of a user's own file are looked up.

    The file's ancestors, nearest first, then what ``ROS_PACKAGE_PATH`` and ``AMENT_PREFIX_PATH``
    name."""
    folders = list(Path(os.path.expanduser(urdf_path)).absolute().parents)
    for place in filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)):
        folders += [
            Path(place),
            Path(place).parent,
        ]  # the variable may name a workspace or a package
    for place in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        folders.append(Path(place) / "share")
    return [str(folder) for folder in dict.fromkeys(folders) if folder.is_dir()]


def _entry(name: str, row: dict[str, Any]) -> Entry:
    ours = "/" not in row["urdf"]
    robots = urdf_folder() if ours else data_folder()
    srdf = row.get("srdf")
    return Entry(
        name=name,
        urdf=robots / row["urdf"],
        srdf=None if srdf is None else (robots if "/" in srdf else urdf_folder()) / srdf,
        package_dirs=() if ours else (str(robots.parents[1]),),
        frames=tuple(row["frames"]),
        **{key: row[key] for key in ("posture", "note", "ready", "acceleration") if key in row},
    )
