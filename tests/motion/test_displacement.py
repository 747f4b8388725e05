"""How far bodies are off on a page, and where it says that the drift leads, against brute force."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from arms import planar_urdf, spatial_urdf
from page_file import Visuals, read

import repctl_pin as rp

Q0 = np.array([0.3, 0.8, 0.8])
POINTS = np.random.default_rng(0).normal(size=(60, 3)) * [0.3, 0.5, 0.2]
"""Of a body, m."""


@cache
def made(cycles: int = 2) -> rp.Motion:
    task = rp.Robot.load("planar3r").task(kind="xy")
    path = rp.circle(task, Q0, 0.1)
    return rp.follow(rp.Pseudoinverse(task), path, Q0, cycles=cycles, steps=40)


def with_a_body(text: str, shape: str, folder: Path) -> tuple[rp.Task, rp.Task]:
    """The tasks of an arm's tool and of its third link, which has the only body."""
    body = (
        '<visual><origin xyz="0.2 -0.1 0.3" rpy="0 0 0.4"/>'
        f"<geometry>{shape}</geometry></visual></link>"
    )
    text = text.replace('<link name="link3"/>', f'<link name="link3">{body}')
    (folder / "arm.urdf").write_text(text, encoding="utf-8")
    robot = rp.Robot.load(folder / "arm.urdf")
    return robot.task("tool", "xy"), robot.task("link3", "xy")


def off(motion: rp.Motion) -> np.ndarray:
    """How far the page says that the farthest part is off at the ends of the cycles, m."""
    scene = read(rp.animation({"J⁺": motion}).page)[0]
    pairs = np.array(scene["arms"][0]["off"])  # at the beginning and at the end of each cycle
    assert np.array_equal(pairs[1:, 0], pairs[:-1, 1])
    return np.r_[pairs[:1, 0], pairs[:, 1]]


def farthest_point(ends: np.ndarray) -> np.ndarray:
    moved = (ends - ends[0]) @ np.c_[POINTS, np.ones(len(POINTS))].T
    return np.linalg.norm(moved, axis=1).max(axis=1)


def farthest_of_round(ends: np.ndarray) -> np.ndarray:
    """Of a disc or ball of radius R that moves in its plane: ``‖d‖ + 2 R sin(φ/2)``, with d the way
    of its centre and φ its turn."""
    turn = ends[:, :3, :3] @ ends[0, :3, :3].T
    phi = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
    way = np.linalg.norm((ends - ends[0])[:, :3, 3], axis=1)
    return way + 2 * 0.2 * np.abs(np.sin(phi / 2))


@pytest.mark.parametrize(
    ("shape", "farthest", "tolerance"),
    [
        ('<mesh filename="points.stl"/>', farthest_point, 1e-5),
        ('<sphere radius="0.2"/>', farthest_of_round, 0.01),
        ('<cylinder radius="0.2" length="0.5"/>', farthest_of_round, 0.01),
    ],
    ids=["mesh", "sphere", "cylinder"],
)
def test_a_body_is_off_by_the_way_of_its_farthest_point(
    shape: str, farthest: Callable[[np.ndarray], np.ndarray], tolerance: float, tmp_path: Path
) -> None:
    """A mesh in space, whose points inside its hull are not in its file; what is round in a
    plane."""
    trimesh.convex.convex_hull(POINTS).export(tmp_path / "points.stl")
    arm = spatial_urdf(4, 1) if "mesh" in shape else planar_urdf((1.0, 0.8, 0.6))
    task, link = with_a_body(arm, shape, tmp_path)
    q0 = np.full(task.n, 0.3)
    path = rp.circle(task, q0, 0.05)
    motion = rp.follow(rp.Pseudoinverse(task), path, q0, cycles=3, steps=20)
    body = np.eye(4)
    body[:3, 3] = 0.2, -0.1, 0.3
    body[:2, :2] = [[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]]
    cycles, rng = np.arange(61)[:, None] / 20, np.random.default_rng(0)
    for _ in range(6):
        q = motion.q + cycles * rng.normal(size=task.n)
        ends = np.array([link.placement(p).homogeneous @ body for p in q[::20, :3]])
        found = off(replace(motion, q=q))
        np.testing.assert_allclose(found, farthest(ends), rtol=tolerance, atol=1e-6)
        assert found[0] == 0 and found.max() > 0.3


@pytest.mark.parametrize("stray", [0.73, 0.2])
@pytest.mark.parametrize("collision", ["mesh", "box", "small", "none", "missing"])
def test_stray_points_of_a_mesh_do_not_count(stray: float, collision: str, tmp_path: Path) -> None:
    """Item 26.9: a triangle 0.73 m from a link of 0.2 m. Near points count, and so do all of a mesh
    that the link's collision shapes do not cover."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    corner = np.array([[stray, 0, 0], [stray, 0.01, 0], [stray, 0, 0.01]])
    points = np.r_[ball.vertices, corner]
    faces = np.r_[ball.faces, [[len(points) - 3, len(points) - 2, len(points) - 1]]]
    trimesh.Trimesh(points, faces, process=False).export(tmp_path / "ball.stl")
    ball.export(tmp_path / "hull.stl")
    solids = {
        "mesh": '<mesh filename="hull.stl"/>',
        "box": '<box size="0.2 0.2 0.2"/>',
        "small": '<sphere radius="0.02"/>',
        "missing": '<mesh filename="nowhere.stl"/>',
    }
    task, link = with_a_body(planar_urdf((1.0, 0.8, 0.6)), '<mesh filename="ball.stl"/>', tmp_path)
    if collision in solids:
        text = (tmp_path / "arm.urdf").read_text()
        body = re.search(r"<visual>(<origin[^>]*>)", text)
        geometry = f"<collision>{body[1]}<geometry>{solids[collision]}</geometry></collision>"
        (tmp_path / "arm.urdf").write_text(text.replace("<visual>", f"{geometry}<visual>"))
        robot = rp.Robot.load(tmp_path / "arm.urdf")
        task, link = robot.task("tool", "xy"), robot.task("link3", "xy")
    path = rp.circle(task, Q0, 0.05)
    motion = rp.follow(rp.Pseudoinverse(task), path, Q0, cycles=2, steps=20)
    motion = replace(motion, q=motion.q + np.arange(41)[:, None] / 200)
    body = np.eye(4)
    body[:3, 3] = 0.2, -0.1, 0.3
    body[:2, :2] = [[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]]
    ends = np.array([link.placement(p).homogeneous @ body for p in motion.q[::20]])
    left_out = stray == 0.73 and collision in ("mesh", "box")
    law = np.c_[ball.vertices if left_out else points, np.ones(len(points) - 3 * left_out)]
    moved = np.linalg.norm((ends - ends[0]) @ law.T, axis=1).max(axis=1)
    np.testing.assert_allclose(off(motion), moved, rtol=1e-4, atol=1e-6)
    others = np.linalg.norm((ends - ends[0]) @ np.c_[points, np.ones(len(points))].T, axis=1)
    assert left_out == (others.max() > 1.05 * moved.max())


def leaves(motion: rp.Motion) -> list[tuple[str, ...]]:
    """When a page says that a joint leaves its range: joints and cycles."""
    page = rp.animation({"J⁺": motion}).page
    return re.findall(r"like cycle \d+, (\S+) leaves its range in cycle (\d+)", page)


def moving(q: np.ndarray) -> rp.Motion:
    """A motion of planar3r with these joint positions."""
    return replace(made(), q=q, qdot=np.zeros_like(q), drift=np.ones(2))


@pytest.mark.parametrize("rate", [0.11, -0.11])
def test_a_steady_drift_leaves_the_range_when_it_says(rate: float) -> None:
    """Joint 2 swings and creeps by 0.11 rad a cycle: the same motion run on, step by step."""
    task = made().task
    lower, upper = task.lower, task.upper

    def at(s: np.ndarray) -> np.ndarray:
        swing = 0.1 * np.sin(2 * np.pi * s)
        return np.c_[0.3 + swing, 0.8 + rate * s + swing, 0.8 - 0.01 * s]

    s = np.linspace(0, 100, 4001)
    q2 = at(s)[:, 1]
    left = np.argmax((q2 > upper[1]) | (q2 < lower[1])) / 40
    found = leaves(moving(at(np.linspace(0, 2, 81))))
    assert found == [(task.joint_names[1], str(int(left) + 1))]


def test_no_drift_leads_nowhere() -> None:
    still = np.tile(Q0, (81, 1))
    assert leaves(moving(still)) == []
    gone = still + np.linspace(0, 10, 81)[:, None]  # beyond the range already
    assert leaves(moving(gone)) == []
    slow = still + np.linspace(0, 2, 81)[:, None] * [0, 0.04, 0]  # not in 100 cycles
    assert leaves(moving(slow)) == []


def test_a_hull_that_is_cached_on_disk_needs_no_mesh_reader(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same mesh in another folder, of which this process has read nothing."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def corners(name: str) -> list[np.ndarray]:
        folder = tmp_path / name
        folder.mkdir()
        (folder / "body.stl").write_bytes(mesh)
        body = '<mesh filename="body.stl"/>'
        task, _ = with_a_body(planar_urdf((1.0, 0.8, 0.6)), body, folder)
        return Visuals.of(task.robot).corners()

    mesh = trimesh.convex.convex_hull(POINTS).export(file_type="stl")
    read_first = corners("first")
    assert max(map(len, read_first)) > 8
    monkeypatch.setitem(sys.modules, "trimesh", None)
    for one, other in zip(read_first, corners("other"), strict=True):
        assert np.array_equal(one, other)
    (tmp_path / "cache").rename(tmp_path / "gone")
    with pytest.raises(ModuleNotFoundError, match="trimesh"):  # there is no other way to it
        corners("third")
