"""Rotations of many poses at once against SciPy's, and their mean against the polar factor."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from repctl_pin.model.rotations import (
    exp3,
    matrix_quaternions,
    mean_rotation,
    quaternion_matrices,
    rotation_quaternions,
)

HALF_TURNS = [[np.pi, 0, 0], [0, np.pi, 0], [0, 0, np.pi], [0, 2, 2], [1e-4, 0, 0], [0, 0, 1e-3]]


@pytest.fixture
def vectors() -> np.ndarray:
    """Rotation vectors of all lengths, tiny ones and half turns among them."""
    rng = np.random.default_rng(0)
    ways = rng.normal(size=(500, 3)) * 10.0 ** rng.uniform(-9, 0.5, size=(500, 1))
    return np.concatenate([ways, HALF_TURNS, np.zeros((1, 3))])


def test_vectors_become_quaternions_and_matrices(vectors: np.ndarray) -> None:
    due = Rotation.from_rotvec(vectors)
    assert np.allclose(rotation_quaternions(vectors), due.as_quat(), rtol=1e-15, atol=1e-15)
    assert np.allclose(exp3(vectors), [pin.exp3(v) for v in vectors], atol=1e-14)
    assert (exp3(np.zeros((3, 3))) == np.eye(3)).all() and exp3(np.zeros((0, 3))).shape == (0, 3, 3)


def test_matrices_become_quaternions_and_return(vectors: np.ndarray) -> None:
    R = exp3(vectors)
    x = matrix_quaternions(R)
    assert np.allclose(x, Rotation.from_matrix(R).as_quat(), rtol=1e-15, atol=1e-15)
    assert np.allclose(quaternion_matrices(x), R, atol=1e-14)
    assert np.allclose(quaternion_matrices(-1.0001 * x), R, atol=1e-14)  # of any length and sign
    assert np.allclose(np.linalg.norm(x, axis=1), 1.0, atol=1e-15)


def test_the_mean_is_the_rotation_nearest_to_the_sum(vectors: np.ndarray) -> None:
    """The nearest rotation to a matrix is its polar factor."""
    R = exp3(0.3 * vectors[:500] / np.linalg.norm(vectors[:500], axis=1, keepdims=True))
    U, _, V_T = np.linalg.svd(R.sum(axis=0))
    assert np.allclose(mean_rotation(R), U @ V_T, atol=1e-14)
