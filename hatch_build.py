"""Build backend: hatchling, the native library, and a C compiler from PyPI where there is none.

An installation never fails for want of a compiler. Without one, the backend asks the frontend (pip
or uv) for the package ziglang if the package index has it, and else installs without the library.
"""

import os
import runpy
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from hatchling import build as hatchling
from hatchling.build import *  # noqa: F403
from hatchling.builders.hooks.plugin.interface import BuildHookInterface

native = SimpleNamespace(**runpy.run_path("repctl_pin/native/build.py"))

FLAGS = {"--no-index", "--offline"}
VALUED = {
    "-f",
    "--find-links",
    "-i",
    "--index-url",
    "--extra-index-url",
    "--default-index",
    "--index",
}
"""Options of pip and uv that say where packages come from, alone and with a value."""


def get_requires_for_build_wheel(config_settings: Any = None) -> list[str]:
    return hatchling.get_requires_for_build_wheel(config_settings) + needed()


def get_requires_for_build_editable(config_settings: Any = None) -> list[str]:
    return hatchling.get_requires_for_build_editable(config_settings) + needed()


def needed() -> list[str]:
    """Ask for ziglang, where no other C compiler works and the package index has it."""
    if os.environ.get("REPCTL_NATIVE") == "no":
        return []
    try:
        native.compiler(zig=False)
    except native.NoCompilerError:
        return ["ziglang"] if obtainable("ziglang") else []
    return []


def obtainable(package: str) -> bool:
    """Ask the frontend whether it finds a package, with the options that it was given.

    What get_requires_for_build_wheel returns and the frontend does not find ends the installation.
    """
    environment = {name: text for name, text in os.environ.items() if name != "PYTHONPATH"}
    with tempfile.TemporaryDirectory() as folder:
        if "UV" in os.environ:
            dry = ["--dry-run", "--no-deps", "--target", folder]
            line = [os.environ["UV"], "pip", "install", *dry, package]
        else:
            line = [sys.executable, "-m", "pip", "index", "versions", package]
        answer = subprocess.run(
            [*line, *index_options(frontend())], env=environment, capture_output=True, text=True
        )
    return answer.returncode == 0 or "No module named pip" in answer.stderr


def frontend() -> list[str]:
    """Return the command line of the process that runs this backend."""
    parent = os.getppid()
    try:
        return Path(f"/proc/{parent}/cmdline").read_text().split("\0")
    except OSError:  # macOS
        listed = subprocess.run(
            ["ps", "-o", "args=", "-p", str(parent)], capture_output=True, text=True
        )
        return listed.stdout.split()


def index_options(words: list[str]) -> list[str]:
    """Select the options of a command line that say where packages come from."""
    kept = []
    for word, value in zip(words, [*words[1:], ""], strict=True):
        name, equals, _ = word.partition("=")
        if name in FLAGS | VALUED:
            kept += [word, value] if name in VALUED and not equals else [word]
    return kept


class CustomBuildHook(BuildHookInterface):
    """Add the native library to a wheel.

    It is built in its folder, where the next build finds it; elsewhere for another machine, and if
    that folder cannot be written to.
    """

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if os.environ.get("REPCTL_NATIVE") == "no":
            return
        self.folder = tempfile.TemporaryDirectory()
        editable = version == "editable"
        here = os.access(native.FOLDER, os.W_OK) and "REPCTL_TARGET" not in os.environ
        library = Path(self.folder.name) / "librepctl.so.1"
        if editable or here:
            library = native.LIBRARY
        try:
            native.build(library)
        except native.NoCompilerError as error:
            self.app.display_warning(f"the native library is left out: {error}")
            return
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{platform_tag()}"
        if not editable:
            build_data["force_include"][str(library)] = "repctl_pin/native/librepctl.so.1"


def platform_tag() -> str:
    """Name the platform of the library as wheels do: ``manylinux_2_17_x86_64``."""
    machine, system = native.target().split("-", 1)
    if system == "macos.11.0":
        return f"macosx_11_0_{machine.replace('aarch64', 'arm64')}"
    return f"manylinux_2_17_{machine}" if "REPCTL_TARGET" in os.environ else f"linux_{machine}"
