"""Benchmarks print ratios within one run; one BLAS thread, so that a ratio means what it says."""

from __future__ import annotations

import os

os.environ.update(
    dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
)

from collections.abc import Callable

import pytest

import repctl_pin as rp


@pytest.fixture(scope="session")
def panda_pose() -> rp.Task:
    return rp.Robot.load("panda").task("panda_hand_tcp", "pose")


@pytest.fixture
def say(capsys: pytest.CaptureFixture) -> Callable[[str], None]:
    """Print past pytest's capture."""

    def print_(text: str) -> None:
        with capsys.disabled():
            print(f"\n  {text}", flush=True)

    return print_
