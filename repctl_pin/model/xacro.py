"""Expansion of xacro files by the package ``xacro``."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from ..errors import UrdfError

_SECONDS = 20.0
"""Maximum time of an expansion, s."""

_EXPAND = """
import contextlib, os, resource, sys
sys.path.pop(0)  # do not import from the current folder
folders = sys.argv[2:]
del sys.argv[2:]
with contextlib.suppress(ValueError, OSError):
    resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))
import xacro
from xacro import substitution_args

def find(package):
    inside = [os.path.join(folder, package) for folder in folders]
    named = [folder for folder in folders if os.path.basename(folder) == package]
    found = [folder for folder in inside + named if os.path.isdir(folder)]
    return found[0] if found else sys.exit(f"package {package!r} not found")

substitution_args._eval_find = substitution_args._eval_dict["find"] = find
xacro.main()
"""
"""Program of the process: ``$(find package)`` is looked up in the folders of its arguments."""


def expand(path: Path, most: int, package_dirs: Sequence[str] = ()) -> bytes:
    """Expand a xacro file to a URDF in a separate process, limited to 20 s and 1 GB.

    Parameters
    ----------
    path
        The xacro file.
    most
        Maximum size of the result, bytes; a longer result is cut after one byte more.
    package_dirs
        Folders in which ``$(find package)`` is looked up: packages, or folders with packages.

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
    folders = [os.path.abspath(folder) for folder in package_dirs]
    command = [sys.executable, "-c", _EXPAND, str(path.absolute()), *folders]
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        try:
            text, complaints = process.communicate(timeout=_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            raise UrdfError(
                f"xacro did not finish within {_SECONDS:g} s; look for a macro that calls itself"
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
        stated = [
            line.strip() for line in said if line.startswith(("package ", "error:"))
        ]
        reason = (stated or said)[0][:200]
        remedy = (
            "give the folder that contains it (--package-dir, package_dirs=)"
            if reason.startswith("package ")
            else "correct it"
        )
        raise UrdfError(f"xacro cannot expand it ({reason}); {remedy}")
    return text[: most + 1]
