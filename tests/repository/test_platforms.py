"""Issue item 26.19: the package resolves from wheels alone on the platforms that README names."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from controls import some

ROOT = Path(__file__).parents[2]
PLATFORMS = ["x86_64-unknown-linux-gnu", "aarch64-unknown-linux-gnu", "aarch64-apple-darwin"]
NO_NETWORK = ["connect", "dns", "timed out", "fetch", "network"]


@pytest.mark.slow
@pytest.mark.parametrize("python", some(["3.10", "3.13"], "3.13"))
@pytest.mark.parametrize("platform", some(PLATFORMS, "aarch64-apple-darwin"))
def test_26_19_it_can_be_installed_from_wheels(platform: str, python: str) -> None:
    """uv resolves the requirements of each machine with only binaries."""
    beside = Path(sys.executable).with_name("uv")
    uv = str(beside) if beside.exists() else shutil.which("uv")
    if uv is None:
        pytest.skip("uv is not installed")
    options = ["--python-platform", platform, "--python-version", python, "--only-binary", ":all:"]
    command = [uv, "pip", "compile", "-q", *options, "pyproject.toml"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    if done.returncode and any(word in done.stderr.lower() for word in NO_NETWORK):
        pytest.skip("no network")
    assert done.returncode == 0, done.stderr
    assert "\npin==" in done.stdout and "\ntoppra==" not in done.stdout
