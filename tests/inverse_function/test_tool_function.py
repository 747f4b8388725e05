"""The function of another tool on the same body: F'(x) = F(x T⁻¹), and what it refuses."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from cell_functions import function_of

import repctl_pin as rp

T = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.5, 1.1), np.array([0.05, -0.03, 0.12]))


@pytest.fixture(scope="module")
def F() -> rp.InverseFunction:
    return function_of("poses")


def test_it_is_the_function_of_the_frame_to_1e_12(F: rp.InverseFunction) -> None:
    own = F.with_tool(T)
    U = F.cell.sample(500, 1)
    X = [F.cell.at(u) for u in U]
    Q = own.batch([x * T for x in X])
    assert np.abs(Q - F.batch(X)).max() < 1e-12
    assert np.abs(Q[7] - own(X[7] * T)).max() < 1e-12
    for x, q in zip(X, Q, strict=True):
        away = own.task.placement(q).homogeneous - (x * T).homogeneous
        assert np.abs(away).max() < 1e-10
    poses, C = own.pose_and_leaf(Q)
    assert np.abs(C).max() < 1e-10
    assert np.abs(poses - [(x * T).homogeneous for x in X]).max() < 1e-10


def test_its_jacobian_is_the_derivative(F: rp.InverseFunction) -> None:
    """Oracle: central differences of F' over twists of the tool, base axes."""
    own = F.with_tool(T)
    x, step = F.cell.at(0.3 * np.ones(F.cell.k)) * T, 1e-6
    D = np.empty((7, 6))
    for k in range(6):
        v, w = np.split(step * np.eye(6)[k], 2)
        ends = [pin.SE3(pin.exp3(s * w) @ x.rotation, x.translation + s * v) for s in (1, -1)]
        D[:, k] = (own(ends[0]) - own(ends[1])) / (2 * step)
    assert np.abs(D - own.jacobian(x)).max() < 1e-7


@pytest.mark.slow
def test_motions_of_the_tool_close(F: rp.InverseFunction) -> None:
    own = F.with_tool(T)
    x = F.cell.placement
    path = rp.circle(own.task, F(x), 0.02)
    motion = rp.follow(own.inverse, path, F(x), cycles=2)
    assert motion.drift[-1] < 1e-9
    assert np.abs(own(path.placement(0.3)) - F(path.placement(0.3) * T.inverse())).max() < 1e-12


def test_tools_add_up_and_pickle(F: rp.InverseFunction) -> None:
    own, x = F.with_tool(T), F.cell.at(0.2 * np.ones(F.cell.k))
    assert np.abs(own.with_tool(T)(x * T * T) - F(x)).max() < 1e-12
    assert np.array_equal(pickle.loads(pickle.dumps(own))(x * T), own(x * T))
    assert np.allclose(own.leaves(x * T), F.leaves(x), atol=1e-6)
    row = np.concatenate([(x * T).translation, pin.Quaternion((x * T).rotation).coeffs()])
    assert np.abs(own.batch(row[None])[0] - F(x)).max() < 1e-9


def test_what_cannot_hold_it_refuses_it(F: rp.InverseFunction, tmp_path: Path) -> None:
    own = F.with_tool(T)
    with pytest.raises(rp.InputError, match="of_frame"):
        own.batch(F.cell.sample(3, 0))
    with pytest.raises(rp.InputError, match="outside the cell"):
        own(F.cell.placement)  # a pose of the flange, not of the tool
    with pytest.raises(rp.InputError, match="x T⁻¹"):
        rp.export_c(own.inverse, tmp_path / "c")
    with pytest.raises(rp.InputError):
        rp.export_c(own, tmp_path / "c")  # type: ignore[arg-type]
    with pytest.raises(rp.InputError, match="x T⁻¹"):
        rp.Governor(own.inverse, 0.001, rp.Limits(velocity=1.0, acceleration=5.0))
    with pytest.raises(rp.InputError, match="not position: the self-motion"):
        function_of("positions").with_tool(T)
