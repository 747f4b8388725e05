"""xacro files: expanded by the package ``xacro``, where it is installed."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

from ..errors import UrdfError

SECONDS = 20.0
"""The longest that an expansion may take."""

_EXPAND = """
import contextlib, resource, sys
sys.path.pop(0)  # not from the folder one happens to be in
with contextlib.suppress(ValueError, OSError):
    resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))
import xacro
xacro.main()
"""


def expand(path: Path, most: int) -> bytes:
    """Expand a xacro file into a URDF, in a process of its own that is held to 20 s and 1 GB.

    Parameters
    ----------
    path
        The file.
    most
        Bytes to take of the result.

    Raises
    ------
    UrdfError
        If ``xacro`` is not installed, or cannot expand the file: in its own words.
    """
    if importlib.util.find_spec("xacro") is None:
        raise UrdfError(
            "this is xacro: `pip install xacro`, or run `xacro file.xacro > robot.urdf` where ROS is"
        )
    command = [sys.executable, "-c", _EXPAND, str(path.absolute())]
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        try:
            text, complaints = process.communicate(timeout=SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            raise UrdfError(
                f"xacro does not expand it within {SECONDS:g} s; does a macro call itself?"
            ) from None
        except BaseException:  # stopped: nothing is to wait for it
            process.kill()
            raise
    if process.returncode != 0:
        said = [
            line for line in complaints.decode(errors="replace").splitlines() if line.strip()
        ] or ["no reason"]
        raise UrdfError(
            f"xacro cannot expand it ({said[0].strip()[:200]}); correct it, or expand it where ROS is"
        )
    return text[: most + 1]
