"""Robots and tasks that many tests share."""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # the tests run side by side; one core each

import numpy as np
import pytest
from arms import Q_PANDA

import repctl_pin as rp


@pytest.fixture(scope="session")
def panda() -> rp.Robot:
    return rp.Robot.load("panda")


@pytest.fixture(scope="session")
def panda_pose(panda: rp.Robot) -> rp.Task:
    return panda.task("panda_hand_tcp", "pose")


@pytest.fixture(scope="session")
def q_panda() -> np.ndarray:
    return Q_PANDA.copy()


@pytest.fixture(scope="session")
def panda_design(panda_pose: rp.Task) -> rp.Design:
    """The quadratic design of the theory: J⁺, box ±0.4 rad."""
    return rp.nearest_repeatable(rp.Pseudoinverse(panda_pose), rp.Polynomial(Q_PANDA, 2, 0.4), rp.Box(Q_PANDA, 0.4))
