"""Sectors whose range of radius depends on the height: closed forms, laws, and files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA
from cell_functions import f_in_numpy, panda
from controls import NEEDS_C, some
from numpy.polynomial.polynomial import polyval
from sectors import found, sector_of

import repctl_pin as rp

SHAPED = "a radius by height"
LOW, HIGH = [0.4, 0.03, 0.04], [0.55, -0.02, -0.05, 0.01, -0.01]


def test_the_sides_are_the_given_polynomials() -> None:
    """Closed form: at u = −1 and 1 the radius is that of the two polynomials, at every height."""
    sector = sector_of(SHAPED)
    middle = (LOW[0] + HIGH[0]) / 2
    assert np.allclose(sector.middle, (middle, 0.35), rtol=0, atol=1e-15)
    z = np.linspace(-1, 1, 21)
    sides = np.column_stack([polyval(z, LOW), polyval(z, HIGH)])
    assert np.allclose(sector.radii(0.35 + 0.1 * z), sides, rtol=0, atol=1e-15)
    for side in (0, 1):
        U = np.zeros((21, sector.k))
        U[:, 0], U[:, 1], U[:, 2] = 2 * side - 1, 0.7, z
        p, _ = sector.placements(U)
        assert np.allclose(np.hypot(p[:, 0], p[:, 1]), sides[:, side], rtol=0, atol=1e-15)
        assert np.allclose(p[:, 2], 0.35 + 0.1 * z, rtol=0, atol=1e-15)


def test_constant_sides_are_the_sector_of_today() -> None:
    """Closed form: two constants are one half-width, to the last bit, with zeros or without."""
    x = pin.SE3(panda().placement(Q_PANDA).rotation, np.array([0.5, 0.0, 0.35]))
    options: dict[str, Any] = {"height": 0.1, "angle": 1.0, "half_angle": 0.2, "spin": 0.3}
    usual = rp.Sector(panda(), x, radius=0.125, **options)
    same = rp.Sector(panda(), x, radius=([0.375], [0.625]), **options)
    assert same.profile.degree == 0 and repr(same) == repr(usual)
    almost = rp.Sector(panda(), x, radius=([0.375, 0.0], [0.625, 0.0, 0.0]), **options)
    U = 1.5 * usual.sample(64)
    for one in (same, almost):
        for mine, due in zip(one.placements(U), usual.placements(U), strict=True):
            assert np.array_equal(mine, due)
        R = usual.placements(U)[1]
        assert np.array_equal(one.twists(U, R), usual.twists(U, R))


@pytest.mark.parametrize("name", some([SHAPED, "an axis task by height"], SHAPED))
def test_a_part_has_the_same_poses(name: str) -> None:
    """Law: u of a part is linear in u of the whole, also for a part of a part."""
    whole = sector_of(name)
    part, low, high = whole, -np.ones(whole.k), np.ones(whole.k)
    for ends in ((-0.5, 0.9), (-0.8, 0.4)):
        first, last = np.full((2, whole.k), 1.0) * np.array(ends)[:, None]
        first, last = part._kept_middles(first, last)
        part = part._part(first, last)
        low, high = (
            (low + high) / 2 + (high - low) / 2 * first,
            (low + high) / 2 + (high - low) / 2 * last,
        )
    U = part.sample(32)
    for mine, due in zip(
        part.placements(U), whole.placements((low + high) / 2 + (high - low) / 2 * U), strict=True
    ):
        assert np.allclose(mine, due, rtol=0, atol=1e-14)
    assert part.at(np.zeros(part.k)).isApprox(part.placement, 1e-14)


def test_coordinates_are_continuous_over_the_edge_of_the_height() -> None:
    sector = sector_of(SHAPED)
    U = np.zeros((400, sector.k))
    U[:, 0], U[:, 2] = 0.8, np.linspace(0.9, 1.6, 400)
    p, R = sector.placements(U)
    back, off = sector.coordinates(p, R)
    assert np.allclose(back, U, rtol=0, atol=1e-13) and not off.any()
    assert np.abs(np.diff(p, axis=0)).max() < 1e-3
    beyond = np.abs(U[:, 2]) > 1
    with pytest.raises(rp.InputError, match=r"height is \+0\.1\d* m from the middle"):
        sector.inside(back[beyond][:1], off[:1])
    with pytest.raises(rp.InputError, match=r"radius is \+0\.0\d* m .* goes to ±0\.005"):
        sector.coordinates_of(sector.at([1.2, 0, 1, 0, 0, 0]))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"radius": ([0.4, 0.2], [0.5])}, "the largest radius is not above the smallest"),
        ({"radius": ([0.3, 0, -0.4], [0.6])}, r"of -0\.1 m at some height reaches the axis"),
        ({"radius": ([0.4, 0.1], [0.6]), "height": 0.0}, "requires a height above 0; give height="),
        (
            {"radius": ([0.4, np.nan], [0.6])},
            "must be one number, the half-width of the radius, m,",
        ),
        ({"radius": ([0.4], [0.5], [0.6])}, "must be one number, the half-width of the radius, m,"),
        ({"radius": ([0.4], 0.6)}, "must be one number, the half-width of the radius, m,"),
    ],
)
def test_sides_that_make_no_sense(change: dict[str, Any], says: str) -> None:
    x = pin.SE3(panda().placement(Q_PANDA).rotation, np.array([0.45, 0.1, 0.35]))
    with pytest.raises(rp.InputError, match=says) as error:
        rp.Sector(panda(), x, **({"height": 0.05, "angle": 0.3} | change))
    assert "\n" not in str(error.value)


def test_a_scaled_sector_does_not_cross_its_sides() -> None:
    sector = sector_of("one orientation", radius=([0.3, 0, 0.1], [0.5, 0, -0.05]))
    half = sector.scaled(0.5)
    assert np.allclose(half.radii(0.35)[0], 0.35) and half.widths[2] == 0.5 * sector.widths[2]
    with pytest.raises(rp.InputError, match="choose a smaller scale or height"):
        sector.scaled(2.0)


@NEEDS_C
@pytest.mark.parametrize("name", some([SHAPED, "an axis task by height"], SHAPED))
def test_c_has_the_numbers_of_numpy(name: str) -> None:
    """Oracle: the two laws are written twice; 1e-12 rad."""
    F = found(name).function
    U = F.cell.sample(64, seed=3)
    U = np.where(np.random.default_rng(0).random(U.shape) < 0.4, np.sign(U), U)
    slow = f_in_numpy(F)
    Q = np.array([slow(F.cell.at(u)) for u in U])
    assert np.abs(F.batch(U) - Q).max() < 1e-12
    p, R = F.cell.placements(U)
    X = np.tile(np.eye(4), (len(U), 1, 1))
    X[:, :3, :3], X[:, :3, 3] = R, p
    assert np.abs(F.batch(X) - Q).max() < 1e-12


def test_a_file_keeps_the_profile(tmp_path: Path) -> None:
    design = found(SHAPED)
    again = rp.load_cell(rp.save(design, tmp_path / "cell.json"), design.task)
    mine, due = again.function.chart.cell, design.function.chart.cell
    assert all(map(np.array_equal, mine.profile, due.profile))
    U = due.sample(16)
    assert np.allclose(mine.placements(U)[0], due.placements(U)[0], rtol=0, atol=1e-14)
    text = (tmp_path / "cell.json").read_text("utf-8")
    assert '"profile"' in text
    assert '"profile"' not in rp.save(found("pose"), tmp_path / "other.json").read_text("utf-8")


@pytest.mark.parametrize(
    ("radius", "reason"),
    [
        (([-0.3], [-0.1]), "at some height reaches the axis"),
        (([0.2, -0.4], [0.7]), "at some height reaches the axis"),
        (([0.2], [0.4, -0.2 + 1e-8]), "largest radius is not above the smallest"),
        (([-1e308], [1e308]), "not finite"),
        (([10**400], [1.0]), "at most 9 coefficients"),
    ],
)
def test_sides_that_bound_no_sector_are_refused(radius: object, reason: str) -> None:
    with pytest.raises(rp.InputError, match=reason):
        sector_of(SHAPED, radius=radius)


@pytest.mark.parametrize("coefficients", [[[0, np.nan], [1, 0]], [[0] * 12, [1] + [0] * 11]])
def test_a_profile_of_a_file_is_checked(coefficients: list[list[float]]) -> None:
    with pytest.raises(rp.InputError, match="profile of the sector"):
        sector_of(SHAPED)._profiled_by(np.array(coefficients, float))


def test_a_radius_outside_is_measured_from_the_middle_at_its_height() -> None:
    """Where the sides bend, that is not the radius of the sector's middle."""
    sector = sector_of(SHAPED)
    above = sector.placement.copy()
    above.translation = above.translation + [0.2, 0, 0.08]
    with pytest.raises(rp.InputError, match=r"radius is .* m from the middle at its height, and"):
        sector.inside(*sector.coordinates(above.translation[None], above.rotation[None]))
