"""Planes between bodies, which leave one distance to measure, and the tolerance of distances."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from native_library import REQUIRED

import repctl_pin as rp

SIX = """<joint name="{axis}" type="prismatic"><parent link="{parent}"/><child link="at_{axis}"/>
<axis xyz="{xyz}"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="turn_{axis}" type="revolute"><parent link="at_{axis}"/><child link="turned_{axis}"/>
<axis xyz="{xyz}"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
<link name="at_{axis}"/><link name="turned_{axis}"/>"""

SHAPES = (
    '<box size="0.1 0.2 0.3"/>',
    '<sphere radius="0.1"/>',
    '<cylinder radius="0.1" length="0.3"/>',
    '<capsule radius="0.05" length="0.3"/>',
    '<mesh filename="gem.stl"/>',
)


def flying(folder: Path, shapes: tuple[str, ...], spread: float = 0.4) -> rp.Task:
    """Write a robot that moves a group of bodies freely beside another one; return its task."""
    rng = np.random.default_rng(0)
    trimesh.PointCloud(rng.normal(scale=0.05, size=(60, 3))).convex_hull.export(folder / "gem.stl")

    def group(name: str) -> str:
        places = rng.uniform(-1, 1, (len(shapes), 2, 3)) * [[[spread], [3.0]]]
        texts = [[" ".join(map(str, row)) for row in place] for place in places]
        bodies = (
            f'<collision><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{shape}</geometry></collision>'
            for (xyz, rpy), shape in zip(texts, shapes, strict=True)
        )
        return f'<link name="{name}">{"".join(bodies)}</link>'

    moves = zip("xyz", ("base", "turned_x", "turned_y"), ("1 0 0", "0 1 0", "0 0 1"), strict=True)
    joints = "".join(SIX.format(axis=axis, parent=parent, xyz=xyz) for axis, parent, xyz in moves)
    last = '<link name="turned_z"/>'
    text = group("base") + joints.replace(last, group("turned_z"))
    (folder / "flying.urdf").write_text(f'<robot name="flying" version="1.2">{text}</robot>')
    return rp.Robot.load(folder / "flying.urdf").task("turned_z")


def measured_pairs(model: Any, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list that gets the index of each pair whose distance is measured from now on."""
    calls: list[int] = []
    measure = model._apart
    monkeypatch.setattr(model, "_apart", lambda k: calls.append(k) or measure(k))
    return calls


@REQUIRED
def test_planes_bound_all_kinds_of_bodies_and_leave_one_pair_to_measure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """25 pairs of boxes, balls, cylinders, capsules and meshes, each at any place and turn."""
    task = flying(tmp_path, SHAPES)
    bodies = rp.Bodies(task)
    model = bodies._model
    Q = np.random.default_rng(1).uniform(task.lower, task.upper, (300, task.n))
    X = bodies._drive.joints(Q)
    assert len(model.pairs) == 25 and not bodies.only_contact
    least = []
    for q, boxes in zip(X, model._bounds(X), strict=True):
        model._move(q)
        exact = np.array([model._of_hulls(k) for k in range(25)])
        tight = model._bounds.tighten(q[None], boxes[None].copy())[0]
        assert (tight >= boxes).all() and (tight <= exact + 1e-9).all()
        least.append(exact.min())
    np.testing.assert_allclose(bodies.hull_distances(Q), least, rtol=0, atol=3e-6)
    apart = np.array(least) > 0
    assert apart.sum() > 50
    calls = measured_pairs(model, monkeypatch)
    bodies.distances(Q[apart])
    assert len(calls) < 1.2 * apart.sum()


@REQUIRED
def test_few_distances_are_measured_on_a_panda(
    panda_pose: rp.Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bounds by boxes left twelve."""
    bodies = rp.Bodies(panda_pose)
    Q = np.random.default_rng(1).uniform(panda_pose.lower, panda_pose.upper, (200, 7))
    Q = Q[bodies.distances(Q) > 0]
    calls = measured_pairs(bodies._model, monkeypatch)
    bodies.distances(Q)
    assert len(Q) > 50 and len(calls) < 1.5 * len(Q)


def test_distances_are_the_same_without_the_library(
    panda_pose: rp.Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    bodies = rp.Bodies(panda_pose)
    Q = np.random.default_rng(2).uniform(panda_pose.lower, panda_pose.upper, (100, 7))
    native = bodies.distances(Q)
    monkeypatch.setenv("REPCTL_NATIVE", "no")
    np.testing.assert_allclose(bodies.distances(Q), native, rtol=0, atol=2e-7)


def test_distances_of_crossed_cylinders_are_within_the_error_that_is_allowed(
    tmp_path: Path,
) -> None:
    """The distance of their axes minus both radii; coal's own tolerance gave 1.1e-6 m too much."""
    task = flying(tmp_path, ('<cylinder radius="0.05" length="20"/>',), spread=0.0)
    bodies = rp.Bodies(task)
    Q = np.random.default_rng(3).uniform(task.lower, task.upper, (400, task.n))
    true: Any = []
    for q in bodies._drive.joints(Q):
        bodies._model._move(q)
        a, b = bodies._model._placed.oMg
        across = np.cross(a.rotation[:, 2], b.rotation[:, 2])
        true.append(abs((b.translation - a.translation) @ across) / np.linalg.norm(across) - 0.1)
    true = np.array(true)
    apart = true > 0
    error = bodies.distances(Q[apart]) - true[apart]
    assert apart.sum() > 100 and error.min() > -1e-9 and error.max() < 2e-7
