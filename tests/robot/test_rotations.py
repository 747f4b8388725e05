"""Rotations of many poses at once, through public names, against SciPy's and Pinocchio's."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import repctl_pin as rp

HALF_TURNS = [[np.pi, 0, 0], [0, np.pi, 0], [0, 0, np.pi], [0, 2, 2], [1e-4, 0, 0], [0, 0, 1e-3]]


@pytest.fixture
def vectors() -> np.ndarray:
    """Rotation vectors of all lengths, tiny ones and half turns among them."""
    rng = np.random.default_rng(0)
    ways = rng.normal(size=(500, 3)) * 10.0 ** rng.uniform(-9, 0.5, size=(500, 1))
    return np.concatenate([ways, HALF_TURNS, np.zeros((1, 3))])


def test_recorded_quaternions_are_rotations(vectors: np.ndarray) -> None:
    task = rp.Robot.load("panda").task()
    due = Rotation.from_rotvec(vectors)
    poses = np.concatenate([np.full((len(vectors), 3), 0.3), 1.0001 * due.as_quat()], axis=1)
    recording = rp.Recording(task, poses=poses)
    assert np.allclose(recording.rotations, due.as_matrix(), rtol=0, atol=1e-15)


def test_coordinates_of_a_cell_are_rotation_vectors(vectors: np.ndarray) -> None:
    task = rp.Robot.load("panda").task()
    cell = rp.Cell(task, pin.SE3.Identity(), 0.1, 0.5)
    U = np.concatenate([np.zeros_like(vectors), vectors], axis=1)
    due = [pin.exp3(0.5 * v) for v in vectors]
    assert np.allclose(cell.placements(U)[1], due, rtol=0, atol=1e-14)
