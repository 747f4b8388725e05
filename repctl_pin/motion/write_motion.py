"""A motion as a file for a robot: CSV, or ROS's JointTrajectory in YAML."""

from __future__ import annotations

from pathlib import Path

from ..arguments import file_name, flag, wanted
from ..errors import InputError
from ..files import write_whole
from .csv_file import csv_text
from .motion import Motion
from .timing import TimedMotion
from .violations import refuse_violations
from .yaml_file import yaml_text


def write_motion(motion: Motion | TimedMotion, file: str | Path, *, allow_violations: bool = False) -> Path:
    """Write a motion for a robot: time, positions, velocities, and accelerations if it is timed.

    Parameters
    ----------
    motion
        From :func:`follow`, :func:`timed` or :func:`approach`.
    file
        ``.csv``, or ``.yaml`` for ROS 2's ``trajectory_msgs/msg/JointTrajectory``. s, rad or m, per s and per s².
    allow_violations
        Write it even if a joint leaves its limits, or bodies touch.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If the motion breaks a limit or bodies touch, the name ends otherwise, or the file cannot be written.

    Examples
    --------
    >>> file = rp.write_motion(rp.timed(motion, acceleration=5.0), "motion.csv")
    >>> file.read_text().splitlines()[0].startswith("time,")
    True
    """
    if not isinstance(motion, TimedMotion):
        wanted(motion, Motion, "motion", "a motion, such as rp.follow or rp.timed makes")
    path = Path(file_name(file, "file"))
    if path.suffix not in (".csv", ".yaml", ".yml"):
        raise InputError(f"{str(path)!r} must end in .csv or .yaml")
    followed = motion.motion if isinstance(motion, TimedMotion) else motion
    if followed is not None and not flag(allow_violations, "allow_violations"):
        refuse_violations(followed, "choose another start or path; allow_violations=True writes it anyway")
    return write_whole(path, csv_text(motion) if path.suffix == ".csv" else yaml_text(motion))
