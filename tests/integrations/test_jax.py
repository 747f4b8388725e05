"""The checks of JAX's form run in a process of their own: JAX's threads do not survive forks."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

CHECKS = Path(__file__).with_name("jax_checks.py")


def run(*options: str) -> None:
    if find_spec("jax") is None:
        pytest.skip("there is no JAX on this machine")
    command = [sys.executable, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider", *options]
    quick = {"XLA_FLAGS": "--xla_backend_optimization_level=0"}  # compiling is dear
    done = subprocess.run(
        [*command, str(CHECKS)], capture_output=True, text=True, check=False, env=os.environ | quick
    )
    assert done.returncode == 0, done.stdout[-4000:]


def test_numbers_derivatives_and_refusals() -> None:
    run()


@pytest.mark.slow
def test_every_kind_single_precision_and_many_poses() -> None:
    run("-m", "slow")
