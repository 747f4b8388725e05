"""Expansion of xacro files by the package ``xacro``."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

from ..errors import UrdfError

SECONDS = 20.0
"""Maximum time of an expansion, s."""

_EXPAND = """
import contextlib, resource, sys
sys.path.pop(0)  # do not import from the current folder
with contextlib.suppress(ValueError, OSError):
    resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))
import xacro
xacro.main()
"""


def expand(path: Path, most: int) -> bytes:
    """Expand a xacro file to a URDF in a separate process, limited to 20 s and 1 GB.

    Parameters
    ----------
    path
        The xacro file.
    most
        Maximum size of the result, bytes; a longer result is cut after one byte more.

    Raises
    ------
    UrdfError
        If ``xacro`` is not installed, or cannot expand the file; the message quotes xacro's error.
    """
    if importlib.util.find_spec("xacro") is None:
        raise UrdfError(
            "a xacro file requires xacro, which is not installed; run `pip install xacro`, "
            "or run `xacro file.xacro > robot.urdf` on a machine with ROS"
        )
    command = [sys.executable, "-c", _EXPAND, str(path.absolute())]
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        try:
            text, complaints = process.communicate(timeout=SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            raise UrdfError(
                f"xacro did not finish within {SECONDS:g} s; look for a macro that calls itself"
            ) from None
        except BaseException:  # interrupted: do not wait for the process
            process.kill()
            raise
    if process.returncode != 0:
        said = [
            line
            for line in complaints.decode(errors="replace").splitlines()
            if line.strip()
        ] or ["no reason"]
        raise UrdfError(
            f"xacro cannot expand it ({said[0].strip()[:200]}); "
            "correct it, or expand it on a machine with ROS"
        )
    return text[: most + 1]
