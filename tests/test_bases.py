"""User-defined bases of potentials and regions: what they define, and what they inherit."""

from __future__ import annotations

import numpy as np
import pytest

import repctl_pin as rp
from repctl_pin.potentials import PotentialBasis
from repctl_pin.regions import Region


class Sums(PotentialBasis):
    """The sum of all joints, and its sine."""

    size = 2

    def values(self, Q: np.ndarray) -> np.ndarray:
        s = np.sum(Q, axis=1)
        return np.stack([s, np.sin(s)], axis=1)

    def gradients(self, Q: np.ndarray) -> np.ndarray:
        s = np.sum(Q, axis=1)
        ones = np.ones((len(Q), Q.shape[1], 1))
        return np.concatenate([ones, ones * np.cos(s)[:, None, None]], axis=2)


class Ball(Region):
    """All q within a distance of a center."""

    def __init__(self, center: np.ndarray, radius: float) -> None:
        self.center, self.radius = np.asarray(center, float), radius

    @property
    def bounds(self) -> rp.Box:
        return rp.Box(self.center, self.radius)

    def random(self, count: int, seed: int) -> np.ndarray:
        return self.clip(self.bounds.random(count, seed))

    def ratio(self, Q: np.ndarray) -> np.ndarray:
        return np.linalg.norm(np.asarray(Q, float) - self.center, axis=1) / self.radius

    def clip(self, Q: np.ndarray) -> np.ndarray:
        scale = np.maximum(self.ratio(Q), 1)[:, None]
        return self.center + (np.asarray(Q, float) - self.center) / scale

    def shrunk(self, factor: float) -> Region:
        return Ball(self.center, factor * self.radius)


Q0 = np.array([0.3, 0.8, 0.8])
NODES = rp.FitOptions(samples=64, held_out=64)


def test_a_basis_of_three_definitions_is_named_weighted_and_joined() -> None:
    basis = Sums() + rp.Polynomial(Q0, 1, 0.3)
    assert basis.size == 5
    assert basis.names == ("h_1", "h_2", "P1(u_0)", "P1(u_1)", "P1(u_2)")
    assert [type(part).__name__ for part in (rp.Polynomial(Q0, 1) + Sums()).parts][1] == "Sums"
    A = np.array([[0.5], [1.0], [0.2], [0.0], [0.3]])
    h = basis.weighted(A)
    assert np.allclose(h.value(Q0), basis.values(Q0[None])[0] @ A)
    for i, d in enumerate(1e-6 * np.eye(3)):
        slope = (h.value(Q0 + d) - h.value(Q0 - d)) / 2e-6
        assert np.allclose(slope, h.gradient(Q0)[i], atol=1e-8)


def test_user_defined_bases_and_regions_make_a_design() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    ball = Ball(Q0, 0.2)
    assert ball.n == 3 and ball.contains([Q0, Q0 + 1]).tolist() == [True, False]
    Q, weights = ball.nodes(64, 0)
    assert ball.contains(Q).all() and np.isclose(weights.sum(), 1)
    own = rp.nearest_repeatable(rp.Pseudoinverse(task), Sums(), ball, options=NODES)
    assert own.coefficients.shape == (2, 1)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), rp.Polynomial(Q0, 1, 0.2) + rp.Fourier(3, 1), ball, options=NODES
    )
    assert design.region is ball and design.leaf_margin > 0.3
    with pytest.raises(rp.InputError, match="a region of type Ball cannot be saved"):
        rp.save(design, "never.json")
    assert repr(Sums()) == "<Sums: 2 potentials>"


@pytest.mark.parametrize("kind", [rp.Polynomial, rp.Fourier, rp.Joined, rp.CustomPotentials])
def test_all_bases_have_one_base(kind: type) -> None:
    assert issubclass(kind, PotentialBasis)


@pytest.mark.parametrize("kind", [rp.Box, rp.Tube, rp.WorkspaceBox])
def test_all_regions_have_one_base(kind: type) -> None:
    assert issubclass(kind, Region)


def test_a_class_of_the_same_shape_is_told_what_to_inherit_from() -> None:
    class Shape:
        size, center = 1, Q0
        values = gradients = weighted = bounds = nodes = random = weights = ratio = clip = None

    task = rp.Robot.load("planar3r").task("tool", "xy")
    desired, box = rp.Pseudoinverse(task), rp.Box(Q0, 0.2)
    with pytest.raises(rp.InputError, match=r"inherits from repctl_pin\.potentials\.PotentialB"):
        rp.nearest_repeatable(desired, Shape(), box)
    with pytest.raises(rp.InputError, match=r"inherits from repctl_pin\.regions\.Region"):
        rp.nearest_repeatable(desired, rp.Polynomial(Q0, 1), Shape())
