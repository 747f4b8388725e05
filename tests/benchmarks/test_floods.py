"""Floods of an arm whose reach is known in closed form: a ring around its shoulder."""

from pathlib import Path

import floods
import numpy as np
import pinocchio as pin
import pytest

import repctl_pin as rp

UPPER_ARM, FOREARM, TOOL = 0.3, 0.2, 0.1
JOINTS = (  # axis, and the place in the link before, m
    ("0 0 1", 0.0),
    ("0 1 0", 0.0),
    ("0 1 0", UPPER_ARM),
    ("0 0 1", 0.1),
    ("0 1 0", FOREARM - 0.1),
    ("0 0 1", TOOL),
)


@pytest.fixture
def grid(tmp_path: Path) -> floods.Grid:
    """Return the grid of an arm with a spherical wrist, tool down."""
    text = "<link name='link0'/>"
    for i, (axis, z) in enumerate(JOINTS, 1):
        text += f"""<link name='link{i}'/><joint name='joint{i}' type='revolute'>
            <parent link='link{i - 1}'/><child link='link{i}'/><origin xyz='0 0 {z}'/>
            <axis xyz='{axis}'/><limit lower='-3.2' upper='3.2' effort='1' velocity='1'/></joint>"""
    (tmp_path / "arm.urdf").write_text(f"<robot name='arm'>{text}</robot>", "utf-8")
    task = rp.Robot.load(tmp_path / "arm.urdf").task("link6", "axis")
    middle = pin.SE3(np.diag([1.0, -1.0, -1.0]), np.array([0.3, 0.0, -0.1]))
    return floods.Grid(rp.Sector(task, middle, radius=0.05), np.random.default_rng(0))


def test_floods_and_the_search_without_paths_end_at_the_ring(grid: floods.Grid) -> None:
    assert grid.counted.tolist() == [False, True, True, True, True, False]
    found = floods.floods_of(grid)
    reached = np.isfinite(found[..., 0]).any(axis=0)
    anywhere = floods.AnyConfiguration(grid, found).found
    p = np.array([target.translation for target in grid.targets]) + [0.0, 0.0, TOOL]
    away = np.linalg.norm(p, axis=1)
    inside = np.minimum(away - (UPPER_ARM - FOREARM), UPPER_ARM + FOREARM - away)
    assert (anywhere == (inside > 0))[np.abs(inside) > 1e-3].all()
    assert not (reached & ~anywhere).any() and reached.sum() > 0.9 * anywhere.sum()
    # no extra joint speed: the arm has one configuration per branch
    on = np.flatnonzero(reached)
    Q = found[np.isfinite(found[:, on, 0]).argmax(axis=0), on]
    assert grid.extra_speed(on, Q) == pytest.approx(0.0, abs=1e-6)


def test_the_window_counts_what_the_sector_covers_of_the_ring_there(grid: floods.Grid) -> None:
    """A sector wider than the window and the ring gains nothing outside them."""
    middle = pin.SE3(np.diag([1.0, -1.0, -1.0]), np.array([0.5, 0.0, -0.1]))
    grid.cell = rp.Sector(grid.task, middle, radius=0.2, height=0.45)
    p = np.array([target.translation for target in grid.targets])
    ring = np.abs(np.linalg.norm(p + [0.0, 0.0, TOOL], axis=1) - UPPER_ARM) < FOREARM
    window = (p[:, 0] >= 0.2) & (p[:, 2] >= -0.4)  # the grid ends before 0.7 m and 0.8 m
    there = ring & window
    larger = ~window | (p[:, 2] > 0.25)  # but smaller in the window
    assert larger.sum() > ring.sum() and (larger & window).sum() < there.sum()
    area, share = grid.window(np.array([larger, ring]))
    assert area == pytest.approx(there.sum() * floods.SPACING**2)
    assert share == pytest.approx((p[there, 0] >= 0.3).mean())


def test_one_function_takes_no_jump(grid: floods.Grid) -> None:
    """A flood without extra joint speed is taken as a whole; with a jump, its larger side."""
    flood = max(floods.floods_of(grid), key=lambda each: np.isfinite(each[:, 0]).sum())
    reached = np.isfinite(flood[:, 0])
    whole = grid.for_one_function(flood)
    assert not (whole & ~reached).any() and whole.sum() > 0.95 * reached.sum()
    place = np.arange(grid.size) // len(grid.z)  # number of the radius
    far = whole & (place > np.quantile(place[whole], 0.7))
    flood[far, 2] += 1.0  # beyond the step
    found = grid.for_one_function(flood)
    assert not (found & far).any() and 0.5 * whole.sum() < found.sum() <= (whole & ~far).sum()


def test_the_largest_rectangle_is_that_of_a_search_over_all() -> None:
    mask = np.random.default_rng(3).random((7, 9)) < 0.8
    every = [
        (b - a) * (d - c)
        for a in range(7)
        for b in range(a, 7)
        for c in range(9)
        for d in range(c, 9)
        if mask[a : b + 1, c : d + 1].all()
    ]
    assert floods.rectangle(mask) == pytest.approx(max(every) * floods.SPACING**2)
